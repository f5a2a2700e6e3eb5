"""Vectors: planar cross products, rotations, directions, orders of points, layout in memory."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def cross_planar(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (...) cross product of vectors (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def nearest_rotation(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation nearest to a matrix that is one but for rounding."""
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ right)


def spread_directions(count: int) -> NDArray[np.float64]:
    """Return (count, 3) unit vectors spread evenly over all directions (a Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    height = 1.0 - 2.0 * k / count
    turn = math.pi * (1.0 + math.sqrt(5.0)) * k
    off = np.sqrt(1.0 - height**2)
    return np.stack([off * np.cos(turn), off * np.sin(turn), height], axis=1)


CROWD = 1000
"""Fewer points than this are asked as they come."""


def order_points(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the order (n,) in which points (n, 3) lie near to each other: by cubes, in rows.

    Searches from one to the next then find what they need in the cache, or start near the goal.
    """
    if len(points) < CROWD:
        return np.arange(len(points))
    size = max(float(np.ptp(points, axis=0).max()), 1e-300)
    cubes = ((points - points.min(axis=0)) * (63.0 / size)).astype(np.int64)
    cubes[:, 1] = np.where(cubes[:, 0] % 2, 63 - cubes[:, 1], cubes[:, 1])
    row = (cubes[:, 0] << 6) | cubes[:, 1]
    last = np.where(row % 2, 63 - cubes[:, 2], cubes[:, 2])
    return np.argsort((row << 6) | last, kind="stable")


def settle_layout(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return an array as kernels take it, in C order and writable; where it is not so, a copy.

    Numba compiles anew for another layout, and for an array that must not be written.
    """
    return np.require(array, requirements=["C", "W"])
