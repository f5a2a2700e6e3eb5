"""A way moved to where a duct itself has more room, not only the grid that the way was found on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .centreline import SPACING, Centreline
from .polyline import resample_polyline
from .protocol import Duct

__all__ = ["widen_line"]

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
