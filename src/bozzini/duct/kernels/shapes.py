"""Numba kernels of the analytic ducts: a chain of round cones, and a simple polygon.

A round cone is the convex hull of two balls; its signed distance is the smallest of |p - c| - r
over the balls between them, in closed form.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def cone_value(cones, i, x, y, z):
    """Signed distance to round cone `i`; see `pack_cones` for the columns."""
    dx = x - cones[i, 0]
    dy = y - cones[i, 1]
    dz = z - cones[i, 2]
    along = dx * cones[i, 3] + dy * cones[i, 4] + dz * cones[i, 5]
    size = cones[i, 6]
    sine = cones[i, 7]
    cosine = cones[i, 8]
    ox = dx - along * cones[i, 3]
    oy = dy - along * cones[i, 4]
    oz = dz - along * cones[i, 5]
    off = math.sqrt(ox * ox + oy * oy + oz * oz)
    place = along - off * sine / cosine
    if place <= 0.0:
        return math.sqrt(off * off + along * along) - cones[i, 9]
    if place >= size:
        return math.sqrt(off * off + (along - size) ** 2) - cones[i, 10]
    return off * cosine + along * sine - cones[i, 9]


@njit(cache=True)
def nearest_cone(cones, blocks, x, y, z):
    """Return (s, i): the smallest signed distance over all cones, and whose it is.

    Blocks and cones whose bounding ball is farther than the best so far are passed over.
    """
    count = blocks.shape[0]
    first = 0
    least = np.inf
    for b in range(count):
        gap = (
            math.sqrt((x - blocks[b, 0]) ** 2 + (y - blocks[b, 1]) ** 2 + (z - blocks[b, 2]) ** 2)
            - blocks[b, 3]
        )
        if gap < least:
            least = gap
            first = b
    best = np.inf
    index = 0
    for n in range(count):
        b = first + n
        if b >= count:
            b -= count
        if n > 0:
            reach = best + blocks[b, 3]
            square = (x - blocks[b, 0]) ** 2 + (y - blocks[b, 1]) ** 2 + (z - blocks[b, 2]) ** 2
            if reach <= 0.0 or square >= reach * reach:
                continue
        for i in range(int(blocks[b, 4]), int(blocks[b, 5])):
            reach = best + cones[i, 14]
            square = (x - cones[i, 11]) ** 2 + (y - cones[i, 12]) ** 2 + (z - cones[i, 13]) ** 2
            if reach <= 0.0 or square >= reach * reach:
                continue
            s = cone_value(cones, i, x, y, z)
            if s < best:
                best = s
                index = i
    return best, index


@njit(cache=True)
def cone_slope(cones, i, x, y, z):
    """Gradient of the signed distance to round cone `i`; on its axis the mean of all that meet."""
    dx = x - cones[i, 0]
    dy = y - cones[i, 1]
    dz = z - cones[i, 2]
    ux, uy, uz = cones[i, 3], cones[i, 4], cones[i, 5]
    along = dx * ux + dy * uy + dz * uz
    size = cones[i, 6]
    sine = cones[i, 7]
    cosine = cones[i, 8]
    ox = dx - along * ux
    oy = dy - along * uy
    oz = dz - along * uz
    off = math.sqrt(ox * ox + oy * oy + oz * oz)
    place = along - off * sine / cosine
    if 0.0 < place < size:
        radial = cosine / off if off > 1e-12 else 0.0
        return radial * ox + sine * ux, radial * oy + sine * uy, radial * oz + sine * uz
    rest = along if place <= 0.0 else along - size
    gx = ox + rest * ux
    gy = oy + rest * uy
    gz = oz + rest * uz
    norm = math.sqrt(gx * gx + gy * gy + gz * gz)
    if norm < 1e-12:
        return 0.0, 0.0, 0.0
    return gx / norm, gy / norm, gz / norm


@njit(cache=True)
def nearest_edge(edges, x, y):
    """Return (s, i): the signed distance to a simple polygon, and its nearest edge.

    Columns of `edges`: start (2), end (2), 1 / length squared. The sign is that of the crossing
    number of a ray.
    """
    best = np.inf
    index = 0
    inside = False
    for i in range(edges.shape[0]):
        ax = edges[i, 0]
        ay = edges[i, 1]
        ex = edges[i, 2] - ax
        ey = edges[i, 3] - ay
        wx = x - ax
        wy = y - ay
        u = min(max((wx * ex + wy * ey) * edges[i, 4], 0.0), 1.0)
        gap = (wx - u * ex) ** 2 + (wy - u * ey) ** 2
        if gap < best:
            best = gap
            index = i
        if (ay > y) != (edges[i, 3] > y):
            turn = ex * wy - ey * wx
            if (turn > 0.0) == (ey > 0.0):
                inside = not inside
    s = math.sqrt(best)
    return (-s if inside else s), index


@njit(cache=True)
def polygon_slope(edges, i, s, x, y):
    """Gradient of the signed distance `s` at a point whose nearest edge is `i`."""
    ax = edges[i, 0]
    ay = edges[i, 1]
    ex = edges[i, 2] - ax
    ey = edges[i, 3] - ay
    if abs(s) < 1e-12:
        scale = math.sqrt(edges[i, 4])
        return ey * scale, -ex * scale
    wx = x - ax
    wy = y - ay
    u = min(max((wx * ex + wy * ey) * edges[i, 4], 0.0), 1.0)
    return (wx - u * ex) / s, (wy - u * ey) / s
