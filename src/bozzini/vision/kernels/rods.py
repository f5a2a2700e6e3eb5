"""Numba: a bent rod, the outline of the tube about it in a picture, and matching of two curves."""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_vector


@kernel
def _turn(frame, wx, wy, wz):
    """Return a frame turned by a rotation vector in its own axes."""
    angle = math.sqrt(wx * wx + wy * wy + wz * wz)
    if angle < 1e-6:
        a, b = 1.0 - angle * angle / 6.0, 0.5 - angle * angle / 24.0
    else:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2
    cross = np.array([[0.0, -wz, wy], [wz, 0.0, -wx], [-wy, wx, 0.0]])
    return frame @ (np.eye(3) + a * cross + b * (cross @ cross))


@kernel
def bend_rod(theta, steps):
    """Return points and tangents (steps + 1, 3) of the rod, by arcs between.

    Its parameters are the place (3) and rotation vector (3) of its base, the curvatures about two
    axes as coefficients of Legendre polynomials, as many each, its length, and the tube's radius.
    """
    n = (len(theta) - 8) // 2
    length = theta[-2]
    h = length / steps
    frame = _turn(np.eye(3), theta[3], theta[4], theta[5])
    points = np.empty((steps + 1, 3))
    tangents = np.empty((steps + 1, 3))
    at = theta[:3].copy()
    copy_vector(at, points[0])
    copy_vector(frame[:, 2], tangents[0])
    for i in range(steps):
        x = 2.0 * (i + 0.5) / steps - 1.0
        bases = np.ones(n)
        bases[1] = x
        for k in range(2, n):
            bases[k] = ((2 * k - 1) * x * bases[k - 1] - (k - 1) * bases[k - 2]) / k
        u, v = 0.0, 0.0
        for k in range(n):
            u += theta[6 + k] * bases[k]
            v += theta[6 + n + k] * bases[k]
        wx, wy = -v * h, u * h
        angle = math.sqrt(wx * wx + wy * wy)
        if angle < 1e-4:
            b, c = 0.5 - angle**2 / 24.0, 1.0 - angle**2 / 6.0
        else:
            b, c = (1.0 - math.cos(angle)) / angle**2, math.sin(angle) / angle
        # The step in the frame at its start: an arc about (wx, wy, 0).
        at = at + h * (frame[:, 0] * (b * wy) - frame[:, 1] * (b * wx) + frame[:, 2] * c)
        frame = _turn(frame, wx, wy, 0.0)
        copy_vector(at, points[i + 1])
        copy_vector(frame[:, 2], tangents[i + 1])
    return points, tangents


@kernel
def outline_tube(points, tangents, radius, turn, shift, focal):
    """Return where a camera sees a tube: its two limbs and the line nearest to it, (3, n, 2).

    Pixels are those of a pinhole with its principal point at (0, 0). At a limb the normal of the
    tube's surface is normal to the ray; that is exact for a bent tube, too.
    """
    n = len(points)
    out = np.full((3, n, 2), np.nan)
    for i in range(n):
        p = turn @ points[i] + shift
        t = turn @ tangents[i]
        across = p - (p @ t) * t
        away = math.sqrt(across @ across)
        if away < 1.0001 * radius:
            continue
        across /= away
        cut = radius / away
        side = math.sqrt(1.0 - cut * cut) * np.cross(t, across)
        for k in range(3):
            if k < 2:
                q = p + radius * (-cut * across + (1.0 - 2.0 * k) * side)
            else:
                q = p - radius * across
            if q[2] > 0.0:
                out[k, i, 0] = focal * q[0] / q[2]
                out[k, i, 1] = focal * q[1] / q[2]
    return out


@kernel
def miss_line(edges, line, most):
    """Return how far each edge (x, y, normal x, normal y) is from a line (n, 2), along its normal.

    The distance is positive where the line lies ahead along the normal; `most` where there is none.
    """
    out = np.full(len(edges), most)
    for e in range(len(edges)):
        x, y, nx, ny = edges[e]
        best = most
        before = -(line[0, 0] - x) * ny + (line[0, 1] - y) * nx
        for i in range(1, len(line)):
            after = -(line[i, 0] - x) * ny + (line[i, 1] - y) * nx
            if (before <= 0.0) != (after <= 0.0):
                share = before / (before - after)
                px = line[i - 1, 0] + share * (line[i, 0] - line[i - 1, 0])
                py = line[i - 1, 1] + share * (line[i, 1] - line[i - 1, 1])
                d = (px - x) * nx + (py - y) * ny
                if abs(d) < abs(best):
                    best = d
            before = after
        out[e] = best
    return out


@kernel
def match_curves(cost, step):
    """Return the pairs (k, 2) of the cheapest way through costs (n, m), both indices growing.

    It may begin and end on any side of the table; a step of one index alone costs `step` more.
    """
    n, m = cost.shape
    total = np.empty((n, m))
    back = np.zeros((n, m), np.int8)
    for i in range(n):
        for j in range(m):
            best, way = math.inf, 0
            if i == 0 or j == 0:
                best = 0.0
            if i > 0 and j > 0 and total[i - 1, j - 1] < best:
                best, way = total[i - 1, j - 1], 1
            if i > 0 and total[i - 1, j] + step < best and j > 0:
                best, way = total[i - 1, j] + step, 2
            if j > 0 and total[i, j - 1] + step < best and i > 0:
                best, way = total[i, j - 1] + step, 3
            total[i, j] = best + cost[i, j]
            back[i, j] = way
    i, j, least = n - 1, m - 1, math.inf
    # Free ends: mean cost of the way, or the shortest way would be the cheapest.
    for k in range(n + m):
        a, b = (k, m - 1) if k < n else (n - 1, k - n)
        if a + b < n:
            continue
        mean = total[a, b] / (a + b)
        if mean < least:
            i, j, least = a, b, mean
    pairs = np.empty((n + m, 2), np.int64)
    count = 0
    while True:
        pairs[count, 0], pairs[count, 1] = i, j
        count += 1
        way = back[i, j]
        if way == 0:
            break
        if way != 3:
            i -= 1
        if way != 2:
            j -= 1
    return pairs[:count][::-1].copy()
