"""Polylines: arc length, points at given distances, frames that turn no more than they do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NEAR_MM = 40.0
"""Along the way, between places of the tip in neighbouring rows."""


def measure_arc_length(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (n,) arc length along a polyline (n, dim)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def resample_polyline(points: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return points on a polyline at (almost) equal arc length; the ends stay."""
    arc = measure_arc_length(points)
    count = max(2, round(float(arc[-1]) / spacing) + 1)
    wanted = np.linspace(0.0, arc[-1], count)
    return interpolate_polyline(points, arc, wanted)


def interpolate_polyline(
    points: NDArray[np.float64], arc_length: NDArray[np.float64], wanted: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return points (k, dim) of a polyline (n, dim) at the arc lengths `wanted` (k,)."""
    return np.stack([np.interp(wanted, arc_length, column) for column in points.T], axis=1)


def follow_way(
    line: NDArray[np.float64], arc: NDArray[np.float64], tip: NDArray[np.float64], *, before: float
) -> float:
    """Return how far a tip is along a way (m, 3), near where it was `before` [mm]."""
    first, last = np.searchsorted(arc, [before - NEAR_MM, before + NEAR_MM])
    start, stop = max(int(first) - 1, 0), min(int(last) + 1, len(arc))
    ways, lengths = np.diff(line[start:stop], axis=0), np.diff(arc[start:stop])
    off = tip - line[start : stop - 1]
    share = np.clip(np.sum(off * ways, axis=1) / np.maximum(lengths, 1e-12) ** 2, 0.0, 1.0)
    nearest = int(np.argmin(np.linalg.norm(off - share[:, None] * ways, axis=1)))
    return float(arc[start + nearest] + share[nearest] * lengths[nearest])


def carry_frames(tangents: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, 3, 3) frames with the tangents as third column, turned no more than they do."""
    frames = np.empty((len(tangents), 3, 3))
    axis = np.eye(3)[int(np.argmin(np.abs(tangents[0])))]
    for index, tangent in enumerate(tangents):
        if index > 0:
            # The smallest rotation from one tangent to the next.
            before = tangents[index - 1]
            turn = 1.0 + float(before @ tangent)
            if turn > 1e-9:
                axis = axis - (axis @ tangent) / turn * (before + tangent)
        axis = axis - (axis @ tangent) * tangent
        axis = axis / np.linalg.norm(axis)
        frames[index] = np.stack([axis, np.cross(tangent, axis), tangent], axis=1)
    return frames
