"""The way through the middle of a chain of shapes: of these it is known, and need not be sought."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_points, check_range
from ..errors import GeometryError, InputError
from ._lumen_graph import find_first_crest
from .centreline import SPACING, Centreline
from .cones import RoundCones
from .cylinders import ConnectedCylinders

__all__ = ["follow_chain"]

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
