"""Numba: the norm of two coordinates that super-ellipses and super-ellipsoids are made of."""

from __future__ import annotations

import math

from numba import njit

__all__ = ["power_norm"]


@njit(cache=True)
def power_norm(a, b, p):
    """(a^p + b^p)^(1/p) of two numbers >= 0, without overflow."""
    big = max(a, b)
    small = min(a, b)
    if big == 0.0:
        return 0.0
    if p == 2.0:
        return math.sqrt(big * big + small * small)
    if p == 1.0:
        return big + small
    return big * math.exp(math.log1p((small / big) ** p) / p)
