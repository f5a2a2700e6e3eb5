"""Numba kernel that smooths a path in a sampled field.

Points (n, 3) are in the grid's frame and moved in place, all at once in each sweep; the first and
the last stay. Each goes halfway to the middle of its neighbours.
"""

from __future__ import annotations

import numpy as np

from ...numeric.compiling import kernel
from .clearance import grid_slope


@kernel(nogil=True)
def smooth_path(duct, points, target, most, sweeps):
    """Smooth a path; where it has less clearance than `target` (n,), push it back.

    By `most` [mm] at most in each sweep.
    """
    before = np.empty_like(points)
    for _ in range(sweeps):
        for i in range(points.shape[0]):
            for axis in range(3):
                before[i, axis] = points[i, axis]
        for i in range(1, points.shape[0] - 1):
            for axis in range(3):
                points[i, axis] += 0.25 * (
                    before[i - 1, axis] - 2.0 * before[i, axis] + before[i + 1, axis]
                )
            depth, x, y, z = grid_slope(duct, points[i, 0], points[i, 1], points[i, 2])
            push = min(max(target[i] - depth, 0.0), most)
            points[i, 0] += push * x
            points[i, 1] += push * y
            points[i, 2] += push * z
