"""Polylines: arc length, and points at equal distances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def measure_arc_length(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (n,) arc length along a polyline (n, dim)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def resample_polyline(points: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return points on a polyline at (almost) equal arc length; the ends stay."""
    arc = measure_arc_length(points)
    count = max(2, round(float(arc[-1]) / spacing) + 1)
    wanted = np.linspace(0.0, arc[-1], count)
    return np.stack([np.interp(wanted, arc, column) for column in points.T], axis=1)
