"""The way through the middle of a chain of shapes: of these it is known, and need not be sought."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_points, check_range
from ..errors import GeometryError, InputError
from ..numeric.polylines import resample_polyline
from .base import Duct
from .centreline import SPACING, Centreline, find_first_crest
from .shapes.cones import RoundCones
from .shapes.cylinders import ConnectedCylinders

# A way moved to where a duct itself has more room, not only the grid that the way was found on.

STEPS = (1.0, 1.0, 0.5, 0.5, 0.25, 0.25, 0.12, 0.06)
"""How far points are moved across the way, one after the other [mm]."""

DIRECTIONS = 12

SHARE = 1.25
"""So many times the least room, or more, a point may have less of after smoothing."""


def widen_line(line: Centreline, duct: Duct) -> Centreline:
    """Return a way between the same ends with more room where it is tight, if there is one near.

    Points move across the way to where the duct has more room, and are smoothed where that does
    not make a tight place tighter.

    Parameters
    ----------
    line : Centreline
        In space, inside the duct or nearly so.
    duct : Duct
        Its room is the negative of its signed distance.

    Raises
    ------
    GeometryError
        If the way found leaves the duct, with the place.
    """
    points = line.points.copy()
    turn = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    around = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    room = -duct.signed_distance(points)
    for step in STEPS:
        places = points[1:-1, None] + step * around @ _find_axes(points)[1:-1]
        found = -duct.signed_distance(places)
        best = found.argmax(axis=1)
        better = np.take_along_axis(found, best[:, None], axis=1)[:, 0] > room[1:-1]
        chosen = places[np.arange(len(places)), best]
        points[1:-1] = np.where(better[:, None], chosen, points[1:-1])
        room = -duct.signed_distance(points)
        enough = SHARE * float(room.min())
        for _ in range(3):
            smooth = points.copy()
            smooth[1:-1] = 0.5 * points[1:-1] + 0.25 * (points[:-2] + points[2:])
            left = -duct.signed_distance(smooth)
            keep = left >= np.minimum(room, enough)
            points[keep], room[keep] = smooth[keep], left[keep]
    wider = Centreline.from_points(resample_polyline(points, SPACING), duct)
    if wider.radius.min() <= float(-duct.signed_distance(line.points).max()):
        return Centreline.from_points(line.points, duct)
    return wider


def _find_axes(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return two axes (n, 2, 3) across a way at each of its points."""
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    helper = np.eye(3)[np.abs(along).argmin(axis=1)]
    one = np.cross(along, helper)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return np.stack([one, np.cross(along, one)], axis=1)


REACH = 1e6
"""No coordinate of an end is beyond this [mm]."""

POINTS_MAX = 10_000
"""A very long way has about this many points."""

INSET = 1e-3
"""The way begins this far, as a share of its first step, from the middle of an end's wall."""


def follow_chain(
    chain: RoundCones | ConnectedCylinders,
    ends: tuple[ArrayLike | None, ArrayLike | None] = (None, None),
) -> Centreline:
    """Return the way along the centres of a chain, from its first shape to its last.

    Parameters
    ----------
    chain : RoundCones or ConnectedCylinders
    ends : pair of (3,) float or None
        Start and end inside it [mm]: the way goes between the places of it nearest to them. None:
        the chain's own ends; of cylinders, whose ends are flat walls, so far from these that they
        do not take the room away.

    Raises
    ------
    InputError
        If an end has not three coordinates.
    GeometryError
        If an end lies outside, or there is no way: a single ball, or both ends at one place.
    """
    centres = np.asarray(chain.centres, dtype=np.float64)
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    centres = centres[np.concatenate([[True], steps > 0.0])]
    if len(centres) < 2:
        raise GeometryError("the chain is one ball: there is no way along it")
    # In the middle of a flat end there is no room yet.
    way = centres.copy()
    way[0] += INSET * (centres[1] - centres[0])
    way[-1] += INSET * (centres[-2] - centres[-1])
    spacing = max(SPACING, float(steps.sum()) / POINTS_MAX)
    line = Centreline.from_points(way, chain, spacing=spacing)
    first, goal = (
        _locate(chain, line, name, end) for name, end in zip(("start", "end"), ends, strict=True)
    )
    tips = _find_tips(chain, line)
    if first is None:
        first = tips[0] if goal is None else _go_far(line, goal, tips)
    if goal is None:
        goal = tips[1] if ends[0] is None else _go_far(line, first, tips)
    if first == goal:
        raise GeometryError("start and end are at the same place of the chain: no way between them")
    kept = line.points[min(first, goal) : max(first, goal) + 1]
    found = Centreline.from_points(kept, chain, spacing=spacing)
    return found if first < goal else found.reverse()


def _find_tips(chain: RoundCones | ConnectedCylinders, line: Centreline) -> tuple[int, int]:
    last = len(line.points) - 1
    if isinstance(chain, RoundCones):  # its ends are balls, which have their room in the middle
        return 0, last
    first = find_first_crest(line.points, line.radius)
    other = last - find_first_crest(line.points[::-1], line.radius[::-1])
    return (first, other) if first < other else (0, last)


def _go_far(line: Centreline, place: int, tips: tuple[int, int]) -> int:
    """Return the one of both tips that is farther along the line."""
    return max(tips, key=lambda tip: abs(line.arc_length[tip] - line.arc_length[place]))


def _locate(
    chain: RoundCones | ConnectedCylinders, line: Centreline, name: str, end: ArrayLike | None
) -> int | None:
    """Return the point of the line nearest to an end that is given."""
    if end is None:
        return None
    point: NDArray[np.float64] = check_points(name, end)
    if point.shape != (3,):
        raise InputError(f"{name} has shape {point.shape}: it must be (3,)")
    check_range(name, point, -REACH, REACH, "mm")
    distance = float(chain.signed_distance(point))
    if distance >= 0.0:
        raise GeometryError(
            f"{name} ({', '.join(f'{v:g}' for v in point)}) mm lies outside the shapes by "
            f"{distance:.1f} mm: give a point inside them, or leave it out"
        )
    return int(np.argmin(np.linalg.norm(line.points - point, axis=1)))
