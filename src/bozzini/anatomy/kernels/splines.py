"""Numba kernel of a vector field given by cubic B-splines on a grid."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ...numeric.compiling import kernel

SHARES = 8
"""Into how many shares points are divided for the processors."""


@kernel(parallel=True)
def evaluate_spline(coefficients, low, step, points, result):
    """Fill `result` (n, 3) with a field at points (n, 3); beyond the grid the last ones hold.

    Parameters
    ----------
    coefficients : (nx, ny, nz, 3) float
    low, step : (3,) float
        Place of the first coefficient, and their distance [mm].
    """
    shape = coefficients.shape
    count = points.shape[0]
    for share in prange(SHARES):
        weights = np.empty((3, 4))
        nodes = np.empty((3, 4), np.int64)
        for n in range(share * count // SHARES, (share + 1) * count // SHARES):
            for a in range(3):
                f = (points[n, a] - low[a]) / step[a]
                f = min(max(f, -3.0), shape[a] + 2.0)
                i = math.floor(f)
                t = f - i
                weights[a, 0] = (1.0 - t) ** 3 / 6.0
                weights[a, 1] = (3.0 * t**3 - 6.0 * t**2 + 4.0) / 6.0
                weights[a, 2] = (-3.0 * t**3 + 3.0 * t**2 + 3.0 * t + 1.0) / 6.0
                weights[a, 3] = t**3 / 6.0
                for k in range(4):
                    nodes[a, k] = min(max(int(i) - 1 + k, 0), shape[a] - 1)
            x = 0.0
            y = 0.0
            z = 0.0
            for i in range(4):
                for j in range(4):
                    w = weights[0, i] * weights[1, j]
                    for k in range(4):
                        v = w * weights[2, k]
                        x += v * coefficients[nodes[0, i], nodes[1, j], nodes[2, k], 0]
                        y += v * coefficients[nodes[0, i], nodes[1, j], nodes[2, k], 1]
                        z += v * coefficients[nodes[0, i], nodes[1, j], nodes[2, k], 2]
            result[n, 0] = x
            result[n, 1] = y
            result[n, 2] = z
