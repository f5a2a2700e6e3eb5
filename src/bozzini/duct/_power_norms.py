"""Norms of two coordinates, (a^p + b^p)^(1/p): their duals, and the radii of their unit curves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["dual_norm", "join_norm", "largest_radius", "least_radius"]

Array = NDArray[np.float64]


def join_norm(a: Array, b: Array, power: Array) -> Array:
    """Return (a^p + b^p)^(1/p) of numbers >= 0, without overflow."""
    big = np.maximum(a, b)
    ratio = np.minimum(a, b) / np.where(big > 0.0, big, 1.0)
    return np.asarray(big * np.exp(np.log1p(ratio**power) / power))


def dual_norm(a: Array, b: Array, power: Array) -> Array:
    """Return how far the unit curve of power p >= 1 reaches along (a, b): the norm of p/(p - 1)."""
    corner = power <= 1.0 + 1e-9
    q = power / np.where(corner, 1.0, power - 1.0)
    return np.where(corner, np.maximum(a, b), join_norm(a, b, q))


def least_radius(a: Array, b: Array, power: Array) -> Array:
    """Return the least radius of |x/a|^p + |y/b|^p = 1, p >= 1 (Hoelder's inequality)."""
    return _find_radius(a, b, power, outer=False)


def largest_radius(a: Array, b: Array, power: Array) -> Array:
    """Return the largest radius of the same."""
    return _find_radius(a, b, power, outer=True)


def _find_radius(a: Array, b: Array, power: Array, *, outer: bool) -> Array:
    small, big = np.minimum(a, b), np.maximum(a, b)
    # Up to p = 2 the farthest point is on the longer axis, from 2 on the nearest on the shorter.
    plain = power <= 2.0 if outer else power >= 2.0
    base = big if outer else small
    q = 2.0 * power / np.where(plain, 1.0, np.abs(2.0 - power))
    factor = (1.0 + (small / big) ** q) ** ((1.0 if outer else -1.0) / q)
    return np.asarray(np.where(plain, base, base * factor))
