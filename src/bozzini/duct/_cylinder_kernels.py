"""Numba kernels of a chain of connected cylinders: its sign, its coordinates, its nearest wall.

A segment joins two circles by straight rulings. With w = x - c1, a(t) and b(t) the spokes of the
blended circle, a in the plane of the bend and b across it, x lies in the blended disc where
(w - t d) . (a x b) = 0, a quadratic in t. The wall of a segment is its rulings, and that of the
chain all rulings and the two end discs; the discs between segments are none.

The slice of a chain: how many segments, tolerance, both end discs (centre, outward normal,
radius), then `SEGMENT` numbers for each (`cylinders.pack_chain`).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ._ruling_kernels import SAMPLES, disc_gap, polish_ruling, search_rulings

__all__ = ["SEGMENT", "cylinder_chain_slope", "cylinder_chain_value", "locate_points"]

SEGMENT = 37
"""Numbers of a segment."""

HEAD = 16
"""Numbers before the first segment."""

EDGE = 1e-12
"""A blended disc this far beyond the end of a segment still counts, or rounding would open it."""


@njit(cache=True)
def _place_root(params, at, wx, wy, wz, t):
    """Return u^2 of the point in the blended disc at t."""
    px = wx - t * params[at + 3]
    py = wy - t * params[at + 4]
    pz = wz - t * params[at + 5]
    ax = params[at + 6] + t * params[at + 9]
    ay = params[at + 7] + t * params[at + 10]
    az = params[at + 8] + t * params[at + 11]
    along = (px * ax + py * ay + pz * az) / (ax * ax + ay * ay + az * az)
    across = (px * params[at + 12] + py * params[at + 13] + pz * params[at + 14]) / (
        params[at + 15] + t * params[at + 16]
    )
    return along * along + across * across


@njit(cache=True)
def _invert_segment(params, at, x, y, z):
    """Return (u^2, t): the smaller u of the roots with t in [0, 1]; u^2 is infinite without one."""
    wx = x - params[at]
    wy = y - params[at + 1]
    wz = z - params[at + 2]
    dx, dy, dz = params[at + 3], params[at + 4], params[at + 5]
    c = wx * params[at + 17] + wy * params[at + 18] + wz * params[at + 19]
    b = (
        wx * params[at + 20]
        + wy * params[at + 21]
        + wz * params[at + 22]
        - dx * params[at + 17]
        - dy * params[at + 18]
        - dz * params[at + 19]
    )
    a = -(dx * params[at + 20] + dy * params[at + 21] + dz * params[at + 22])
    inside = b * b - 4.0 * a * c
    if inside < 0.0:
        return np.inf, 0.0
    q = -0.5 * (b + math.copysign(math.sqrt(inside), b))
    best = np.inf
    place = 0.0
    if q != 0.0:
        t = c / q
        if -EDGE <= t <= 1.0 + EDGE:
            best = _place_root(params, at, wx, wy, wz, t)
            place = t
    if a != 0.0:
        t = q / a
        if -EDGE <= t <= 1.0 + EDGE:
            square = _place_root(params, at, wx, wy, wz, t)
            if square < best:
                best = square
                place = t
    return best, place


@njit(cache=True)
def _nearest_wall(params, first, x, y, z):
    """Return (inside, distance, nearest wall point (3), outward normal there (3))."""
    count = int(params[first])
    tolerance = params[first + 1]
    gap, px, py, pz = disc_gap(params, first + 2, x, y, z)
    end = first + 2
    other, ox, oy, oz = disc_gap(params, first + 9, x, y, z)
    if other < gap:
        gap, px, py, pz = other, ox, oy, oz
        end = first + 9
    nx, ny, nz = params[end + 3], params[end + 4], params[end + 5]

    inside = False
    start = 0
    least = np.inf
    at = first + HEAD
    for i in range(count):
        square = (
            (x - params[at + 23]) ** 2 + (y - params[at + 24]) ** 2 + (z - params[at + 25]) ** 2
        )
        if not inside and square <= params[at + 26] ** 2:
            inside = _invert_segment(params, at, x, y, z)[0] <= 1.0
        if square < least:
            least = square
            start = i
        at += SEGMENT

    stack = np.empty((SAMPLES + 32, 7))
    best = gap
    where = -1
    cosine = sine = 0.0
    for n in range(count):
        i = start + n
        if i >= count:
            i -= count
        at = first + HEAD + i * SEGMENT
        reach = best + params[at + 26]
        square = (
            (x - params[at + 23]) ** 2 + (y - params[at + 24]) ** 2 + (z - params[at + 25]) ** 2
        )
        if square >= reach * reach:
            continue
        distance, c, s = search_rulings(params, at, x, y, z, best, tolerance, stack)
        if distance < best:
            best = distance
            where = at
            cosine = c
            sine = s
    if where >= 0:
        gap, px, py, pz, nx, ny, nz = polish_ruling(params, where, x, y, z, cosine, sine)
    return inside, gap, px, py, pz, nx, ny, nz


@njit(cache=True)
def cylinder_chain_value(params, first, x, y, z):
    """Signed distance to the wall of a chain of cylinders, nearer to it by the tolerance."""
    inside, gap, _, _, _, _, _, _ = _nearest_wall(params, first, x, y, z)
    gap = max(gap - params[first + 1], 0.0)
    return -gap if inside else gap


@njit(cache=True)
def cylinder_chain_slope(params, first, x, y, z):
    """The same with its gradient."""
    inside, gap, px, py, pz, nx, ny, nz = _nearest_wall(params, first, x, y, z)
    value = max(gap - params[first + 1], 0.0)
    if inside:
        value = -value
    if gap <= 1e-9:
        return value, nx, ny, nz
    scale = -1.0 / gap if inside else 1.0 / gap
    return value, (x - px) * scale, (y - py) * scale, (z - pz) * scale


@njit(cache=True)
def locate_points(params, points, segment, result):
    """Fill `segment` (n,) and `result` (n, 4): t, u, and cosine and sine of theta times u.

    Of several segments that hold a point the one of the smallest u; -1 and u infinite without.
    """
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        segment[n] = -1
        result[n, 0] = result[n, 2] = result[n, 3] = 0.0
        result[n, 1] = np.inf
        least = np.inf
        for i in range(int(params[0])):
            at = HEAD + i * SEGMENT
            square, t = _invert_segment(params, at, x, y, z)
            if square >= least:
                continue
            least = square
            segment[n] = i
            px = x - params[at] - t * params[at + 3]
            py = y - params[at + 1] - t * params[at + 4]
            pz = z - params[at + 2] - t * params[at + 5]
            ax = params[at + 6] + t * params[at + 9]
            ay = params[at + 7] + t * params[at + 10]
            az = params[at + 8] + t * params[at + 11]
            result[n, 0] = min(max(t, 0.0), 1.0)
            result[n, 1] = math.sqrt(square)
            result[n, 2] = (px * ax + py * ay + pz * az) / (ax * ax + ay * ay + az * az)
            result[n, 3] = (px * params[at + 12] + py * params[at + 13] + pz * params[at + 14]) / (
                params[at + 15] + t * params[at + 16]
            )
