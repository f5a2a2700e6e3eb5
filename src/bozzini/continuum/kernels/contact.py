"""Numba kernels of walls: their distance made smooth, with gradient and curvature.

The distance is a cubic B-spline through its values on a lattice, so that the kinks of a sampled
field, or of a duct that is pieced together, have a gradient and a curvature.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

SPLINE_NODES = 4
"""Nodes of the lattice that a place takes along each axis."""


@njit(cache=True)
def place_nodes(points, step, nodes):
    """Fill the lattice nodes (m, 4^dim, dim) around places (m, dim)."""
    dim = points.shape[1]
    for row in range(points.shape[0]):
        for node in range(nodes.shape[1]):
            rest = node
            for axis in range(dim):
                cell = math.floor(points[row, axis] / step)
                nodes[row, node, axis] = (cell - 1 + rest % SPLINE_NODES) * step
                rest //= SPLINE_NODES


@njit(cache=True)
def weigh_nodes(points, step, values, distance, gradient, curvature):
    """Fill distance (m,), gradient (m, 3) and Hessian (m, 3, 3) of the spline of ``values``."""
    dim = points.shape[1]
    weights = np.empty((3, 3, SPLINE_NODES))
    distance[:] = 0.0
    gradient[:] = 0.0
    curvature[:] = 0.0
    orders = np.empty(3, dtype=np.int64)
    for row in range(points.shape[0]):
        for axis in range(dim):
            x = points[row, axis] / step
            u = x - math.floor(x)
            v = 1.0 - u
            weights[axis, 0, 0] = v**3 / 6.0
            weights[axis, 0, 1] = (3.0 * u**3 - 6.0 * u**2 + 4.0) / 6.0
            weights[axis, 0, 2] = (3.0 * v**3 - 6.0 * v**2 + 4.0) / 6.0
            weights[axis, 0, 3] = u**3 / 6.0
            weights[axis, 1, 0] = -0.5 * v**2 / step
            weights[axis, 1, 1] = (1.5 * u**2 - 2.0 * u) / step
            weights[axis, 1, 2] = (-1.5 * v**2 + 2.0 * v) / step
            weights[axis, 1, 3] = 0.5 * u**2 / step
            weights[axis, 2, 0] = v / step**2
            weights[axis, 2, 1] = (3.0 * u - 2.0) / step**2
            weights[axis, 2, 2] = (3.0 * v - 2.0) / step**2
            weights[axis, 2, 3] = u / step**2
        # Differences from one node keep the second derivatives free of round-off.
        first = values[row, 0]
        distance[row] = first
        for node in range(values.shape[1]):
            value = values[row, node] - first
            for i in range(-1, dim):
                for k in range(-1 if i < 0 else i, dim):
                    orders[:] = 0
                    if i >= 0:
                        orders[i] += 1
                    if k >= 0:
                        orders[k] += 1
                    rest, share = node, value
                    for axis in range(dim):
                        share *= weights[axis, orders[axis], rest % SPLINE_NODES]
                        rest //= SPLINE_NODES
                    if i < 0 and k < 0:
                        distance[row] += share
                    elif i < 0:
                        gradient[row, k] += share
                    else:
                        curvature[row, i, k] += share
                        if k != i:
                            curvature[row, k, i] += share
