"""Numba: what fits ask very often, of super-ellipsoids and of chains of round cones."""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel


@kernel
def turn_matrix(x, y, z):
    """Return the rotation (3, 3) by a rotation vector (Rodrigues' formula)."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-4:
        sine, rest = 1.0 - angle * angle / 6.0, 0.5 - angle * angle / 24.0
    else:
        sine, rest = math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle)
    turn = np.empty((3, 3))
    turn[0, 0] = 1.0 - rest * (y * y + z * z)
    turn[1, 1] = 1.0 - rest * (x * x + z * z)
    turn[2, 2] = 1.0 - rest * (x * x + y * y)
    turn[0, 1], turn[1, 0] = rest * x * y - sine * z, rest * x * y + sine * z
    turn[0, 2], turn[2, 0] = rest * x * z + sine * y, rest * x * z - sine * y
    turn[1, 2], turn[2, 1] = rest * y * z - sine * x, rest * y * z + sine * x
    return turn


@kernel
def least_gauge(points, half, e1, e2, turn):
    """Return the least gauge of points (n, 3) about the centre; axes are the columns of `turn`.

    So many times as large, the shape still holds none of them.
    """
    inner = 2.0 / e2
    outer = 2.0 / e1
    best = np.inf
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        u = abs(x * turn[0, 0] + y * turn[1, 0] + z * turn[2, 0]) / half[0]
        v = abs(x * turn[0, 1] + y * turn[1, 1] + z * turn[2, 1]) / half[1]
        w = abs(x * turn[0, 2] + y * turn[1, 2] + z * turn[2, 2]) / half[2]
        # A gauge is at least its largest term.
        if max(u, max(v, w)) >= best:
            continue
        big = max(u, v)
        flat = big * (1.0 + (min(u, v) / big) ** inner) ** (1.0 / inner) if big > 0.0 else 0.0
        big = max(flat, w)
        if big > 0.0:
            big *= (1.0 + (min(flat, w) / big) ** outer) ** (1.0 / outer)
        best = min(best, big)
    return best


@kernel
def find_balls(points, centres, radii, distance, index, place):
    """Fill the distances of points (n, 3) from a chain of round cones, and the nearest balls.

    The nearest ball is `place` of the step from ball `index` to the next.
    """
    for n in range(points.shape[0]):
        distance[n] = np.inf
        for k in range(centres.shape[0] - 1):
            ax = centres[k + 1, 0] - centres[k, 0]
            ay = centres[k + 1, 1] - centres[k, 1]
            az = centres[k + 1, 2] - centres[k, 2]
            dx = points[n, 0] - centres[k, 0]
            dy = points[n, 1] - centres[k, 1]
            dz = points[n, 2] - centres[k, 2]
            size = math.sqrt(ax * ax + ay * ay + az * az)
            grow = radii[k + 1] - radii[k]
            if size <= abs(grow):
                # One ball holds the other.
                t = 1.0 if grow > 0.0 else 0.0
            else:
                along = (dx * ax + dy * ay + dz * az) / size
                off = math.sqrt(max(dx * dx + dy * dy + dz * dz - along * along, 0.0))
                slant = grow / math.sqrt((size - grow) * (size + grow))
                t = min(max((along + off * slant) / size, 0.0), 1.0)
            ball = math.sqrt((dx - t * ax) ** 2 + (dy - t * ay) ** 2 + (dz - t * az) ** 2)
            value = ball - radii[k] - t * grow
            if value < distance[n]:
                distance[n] = value
                index[n] = k
                place[n] = t
