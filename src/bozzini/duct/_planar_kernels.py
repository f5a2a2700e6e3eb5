"""Numba kernels of the planar shapes, each a slice of one flat array of numbers; z is ignored.

``<kind>_value(params, first, x, y, z)`` is the signed value at a point, 1-Lipschitz: inside
(negative) never deeper than the wall is far, outside never farther than the shape.
``<kind>_slope`` is the value with its gradient.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ._norm_kernels import power_norm

__all__ = [
    "circle_slope",
    "circle_value",
    "outline_slope",
    "outline_value",
    "super_ellipse_slope",
    "super_ellipse_value",
]


@njit(cache=True)
def super_ellipse_value(params, first, x, y, z):
    """Least radius times (gauge - 1).

    Slice: centre (2), cosine and sine of the angle, half axes (2), power, least radius.
    """
    dx = x - params[first]
    dy = y - params[first + 1]
    u = abs(params[first + 2] * dx + params[first + 3] * dy) / params[first + 4]
    v = abs(params[first + 2] * dy - params[first + 3] * dx) / params[first + 5]
    return params[first + 7] * (power_norm(u, v, params[first + 6]) - 1.0)


@njit(cache=True)
def super_ellipse_slope(params, first, x, y, z):
    """The same with its gradient; zero at the centre, where it has all of them."""
    dx = x - params[first]
    dy = y - params[first + 1]
    c = params[first + 2]
    s = params[first + 3]
    a = params[first + 4]
    b = params[first + 5]
    p = params[first + 6]
    least = params[first + 7]
    along = c * dx + s * dy
    across = c * dy - s * dx
    u = abs(along) / a
    v = abs(across) / b
    gauge = power_norm(u, v, p)
    if gauge == 0.0:
        return -least, 0.0, 0.0, 0.0
    # d|.|_p / du = (u / |.|_p)^(p - 1); a power of 0 may be 1, which the sign of 0 undoes.
    gu = least * (u / gauge) ** (p - 1.0) / a * np.sign(along)
    gv = least * (v / gauge) ** (p - 1.0) / b * np.sign(across)
    return least * (gauge - 1.0), c * gu - s * gv, s * gu + c * gv, 0.0


@njit(cache=True)
def circle_value(params, first, x, y, z):
    """Signed distance to a circle. Slice: centre (2), radius."""
    dx = x - params[first]
    dy = y - params[first + 1]
    return math.sqrt(dx * dx + dy * dy) - params[first + 2]


@njit(cache=True)
def circle_slope(params, first, x, y, z):
    """The same with its gradient; zero at the centre."""
    dx = x - params[first]
    dy = y - params[first + 1]
    away = math.sqrt(dx * dx + dy * dy)
    if away < 1e-300:
        return -params[first + 2], 0.0, 0.0, 0.0
    return away - params[first + 2], dx / away, dy / away, 0.0


@njit(cache=True)
def _nearest_edge(params, first, x, y):
    """Return (signed distance, where the nearest edge is in the slice); as `nearest_edge`."""
    best = np.inf
    index = first + 1
    inside = False
    at = first + 1
    for _ in range(int(params[first])):
        ax = params[at]
        ay = params[at + 1]
        ex = params[at + 2] - ax
        ey = params[at + 3] - ay
        wx = x - ax
        wy = y - ay
        u = min(max((wx * ex + wy * ey) * params[at + 4], 0.0), 1.0)
        gap = (wx - u * ex) ** 2 + (wy - u * ey) ** 2
        if gap < best:
            best = gap
            index = at
        if (ay > y) != (params[at + 3] > y):
            turn = ex * wy - ey * wx
            if (turn > 0.0) == (ey > 0.0):
                inside = not inside
        at += 5
    s = math.sqrt(best)
    return (-s if inside else s), index


@njit(cache=True)
def outline_value(params, first, x, y, z):
    """Exact signed distance to a simple polygon, counter-clockwise.

    Slice: how many edges, then start (2), end (2) and 1 / length squared of each.
    """
    s, _ = _nearest_edge(params, first, x, y)
    return s


@njit(cache=True)
def outline_slope(params, first, x, y, z):
    """The same with its gradient."""
    s, at = _nearest_edge(params, first, x, y)
    ax = params[at]
    ay = params[at + 1]
    ex = params[at + 2] - ax
    ey = params[at + 3] - ay
    if abs(s) < 1e-12:
        scale = math.sqrt(params[at + 4])
        return s, ey * scale, -ex * scale, 0.0
    wx = x - ax
    wy = y - ay
    u = min(max((wx * ex + wy * ey) * params[at + 4], 0.0), 1.0)
    return s, (wx - u * ex) / s, (wy - u * ey) / s, 0.0
