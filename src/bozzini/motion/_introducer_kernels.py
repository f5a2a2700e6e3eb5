"""Numba kernel on the introducer, a capsule that is open at its far end.

It is a ray from ``intro[:3]`` along the unit vector ``intro[3:6]`` with the radius ``intro[6]``; a
radius of 0 or less means none.
"""

from __future__ import annotations

from numba import njit

__all__ = ["offset_from_ray"]


@njit(cache=True, inline="always")
def offset_from_ray(intro, x, y, z):
    """Vector to a point from the nearest point of the introducer's ray."""
    dx = x - intro[0]
    dy = y - intro[1]
    dz = z - intro[2]
    t = max(dx * intro[3] + dy * intro[4] + dz * intro[5], 0.0)
    return dx - t * intro[3], dy - t * intro[4], dz - t * intro[5]
