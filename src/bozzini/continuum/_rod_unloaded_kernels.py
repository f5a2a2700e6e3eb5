"""Numba kernel of the rod without loads: lengths of its tendons under tensions, in closed steps.

Without loads nothing goes over a cross-section but what the tendons do there, so every curvature
is a minimum by itself. ``sum over s of min_u (1/2 u K u + sum T_k |t_k(u)|) - T . limits`` is the
dual function of "least elastic energy at these lengths": its gradient by the tensions are the
lengths, and its Hessian is ``- J H^-1 J^T``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ._rod_curvature_kernels import expand_potential, find_curvature, solve_three

__all__ = ["measure_unloaded"]


@njit(cache=True)
def measure_unloaded(grid, tensions, lengths, give):
    """Fill lengths (k,) and how they give way to tension (k, k); the dual's value, or NaN.

    ``grid`` is that of `integrate_rod`, whose rule along a step this is, for curvatures that do
    not depend on what came before.
    """
    places, stiffness, guides, present = grid
    k = tensions.size
    u, work, free = np.zeros(3), np.empty((11, 3)), np.zeros(3)
    ways, carried = np.zeros((k, 3)), np.zeros((k, 3))
    lengths[:] = 0.0
    give[:] = 0.0
    total = 0.0
    for n in range(places.size - 1):
        h = places[n + 1] - places[n]
        for stage in range(3):
            weight = (1.0, 4.0, 1.0)[stage] * h / 6.0
            here = guides[n, stage]
            if not find_curvature(stiffness[n], here, present[n], tensions, free, u, work):
                return math.nan
            matrix, least = work[0:3], work[10]
            least[:] = 0.0
            value, _ = expand_potential(
                stiffness[n], here, present[n], tensions, free, u, False, work[3], matrix
            )
            total += weight * value
            for m in range(k):
                if not present[n, m]:
                    continue
                x, y = here[m, 0], here[m, 1]
                v0 = here[m, 2] - u[2] * y
                v1 = here[m, 3] + u[2] * x
                v2 = 1.0 + u[0] * y - u[1] * x
                long = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
                lengths[m] += weight * long
                if long == 0.0:
                    return math.nan
                ways[m, 0], ways[m, 1] = v2 * y / long, -v2 * x / long
                ways[m, 2] = (v1 * x - v0 * y) / long
                if not solve_three(matrix, ways[m], least, carried[m]):
                    return math.nan
                for j in range(m + 1):
                    if present[n, j]:
                        for i in range(3):
                            give[m, j] += weight * ways[j, i] * carried[m, i]
    for m in range(k):
        for j in range(m):
            give[j, m] = give[m, j]
    return total
