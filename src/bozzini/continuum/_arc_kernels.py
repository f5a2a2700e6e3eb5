"""Numba kernels of constant-curvature chains, smooth through the straight robot.

A section of length ``L`` that bends by ``b = theta (cos phi, sin phi)`` ends at
``L (f2 bx, f2 by, f1)``, turned by the rotation vector ``(-by, bx, 0)``, where
``f1 = sin(theta)/theta``, ``f2 = (1 - cos(theta))/theta^2``, ``f3 = (theta - sin(theta))/theta^3``.
These are functions of ``theta^2``, taken as series where the closed forms would cancel.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = ["arc_factors", "fill_arc_frames", "fill_tip_jacobians", "put_arc"]

SERIES = 0.25
"""``theta^2`` below which series are used; their first term left out is below 1e-18."""


@njit(cache=True)
def arc_factors(square):
    """``f1, f2, f3`` and the slopes ``d f1 / theta d theta``, ``d f2 / theta d theta``."""
    if square < SERIES:
        f1 = 0.0
        f2 = 0.0
        f3 = 0.0
        g1 = 0.0
        g2 = 0.0
        power = 1.0  # (-square)^k
        factorial = 1.0  # (2 k + 1)!
        for k in range(9):
            n = 2.0 * k
            f1 += power / factorial
            f2 += power / (factorial * (n + 2.0))
            f3 += power / (factorial * (n + 2.0) * (n + 3.0))
            following = factorial * (n + 2.0) * (n + 3.0)
            g1 -= power * (n + 2.0) / following
            g2 -= power * (n + 2.0) / (following * (n + 4.0))
            power *= -square
            factorial = following
        return f1, f2, f3, g1, g2
    theta = math.sqrt(square)
    sine = math.sin(theta)
    half = math.sin(0.5 * theta)
    f1 = sine / theta
    f2 = 2.0 * half * half / square
    f3 = (1.0 - f1) / square
    g1 = (math.cos(theta) - f1) / square
    g2 = (f1 - 2.0 * f2) / square
    return f1, f2, f3, g1, g2


@njit(cache=True)
def put_arc(before, length, bend_x, bend_y, after):
    """Fill the frame `after` an arc that starts at the frame `before`."""
    f1, f2, _, _, _ = arc_factors(bend_x * bend_x + bend_y * bend_y)
    axis_x, axis_y = -bend_y, bend_x
    # exp([w]) = 1 + f1 [w] + f2 [w]^2 for w = (axis_x, axis_y, 0).
    r00 = 1.0 - f2 * axis_y * axis_y
    r01 = f2 * axis_x * axis_y
    r02 = f1 * axis_y
    r11 = 1.0 - f2 * axis_x * axis_x
    r12 = -f1 * axis_x
    r22 = 1.0 - f2 * (axis_x * axis_x + axis_y * axis_y)
    x = length * f2 * bend_x
    y = length * f2 * bend_y
    z = length * f1
    for i in range(3):
        a = before[i, 0]
        b = before[i, 1]
        c = before[i, 2]
        after[i, 3] = before[i, 3] + a * x + b * y + c * z
        after[i, 0] = a * r00 + b * r01 - c * r02
        after[i, 1] = a * r01 + b * r11 - c * r12
        after[i, 2] = a * r02 + b * r12 + c * r22
    after[3, 0] = 0.0
    after[3, 1] = 0.0
    after[3, 2] = 0.0
    after[3, 3] = 1.0


@njit(cache=True)
def fill_arc_frames(lengths, owner, share, bends, frames):
    """Fill ``frames`` (n, k, 4, 4) for ``bends`` (n, m, 2).

    Station ``k`` lies in section ``owner[k]``, a ``share[k]`` of its length from its start.
    """
    start = np.eye(4)
    end = np.eye(4)
    for n in range(bends.shape[0]):
        section = 0
        start[:] = np.eye(4)
        for k in range(owner.size):
            while section < owner[k]:
                put_arc(start, lengths[section], bends[n, section, 0], bends[n, section, 1], end)
                start[:] = end
                section += 1
            part = share[k]
            put_arc(
                start,
                part * lengths[section],
                part * bends[n, section, 0],
                part * bends[n, section, 1],
                frames[n, k],
            )


@njit(cache=True)
def fill_tip_jacobians(lengths, bends, tips, jacobians):
    """Fill tip frames (n, 4, 4) and geometric Jacobians (n, 6, 2 m) in the base frame.

    Rows are velocity of the tip's point, then angular velocity, per unit of each bend.
    """
    sections = lengths.size
    for n in range(bends.shape[0]):
        frames = np.empty((sections + 1, 4, 4))
        frames[0] = np.eye(4)
        for i in range(sections):
            put_arc(frames[i], lengths[i], bends[n, i, 0], bends[n, i, 1], frames[i + 1])
        tip = frames[sections]
        tips[n] = tip
        for i in range(sections):
            x = bends[n, i, 0]
            y = bends[n, i, 1]
            f1, f2, f3, g1, g2 = arc_factors(x * x + y * y)
            for j in range(2):
                along = x if j == 0 else y
                dx = lengths[i] * (g2 * along * x + (f2 if j == 0 else 0.0))
                dy = lengths[i] * (g2 * along * y + (f2 if j == 1 else 0.0))
                dz = lengths[i] * g1 * along
                # Left Jacobian of rotation: 1 + f2 [w] + f3 [w]^2 with w = (-y, x, 0).
                vx = -1.0 if j == 1 else 0.0
                vy = 1.0 if j == 0 else 0.0
                wx = -y
                wy = x
                cross = wx * vy - wy * vx
                ox = vx + f3 * wy * cross
                oy = vy - f3 * wx * cross
                oz = f2 * cross
                frame = frames[i]
                column = 2 * i + j
                turn = np.empty(3)
                move = np.empty(3)
                arm = np.empty(3)
                for r in range(3):
                    move[r] = frame[r, 0] * dx + frame[r, 1] * dy + frame[r, 2] * dz
                    turn[r] = frame[r, 0] * ox + frame[r, 1] * oy + frame[r, 2] * oz
                    arm[r] = tip[r, 3] - frames[i + 1, r, 3]
                jacobians[n, 0, column] = move[0] + turn[1] * arm[2] - turn[2] * arm[1]
                jacobians[n, 1, column] = move[1] + turn[2] * arm[0] - turn[0] * arm[2]
                jacobians[n, 2, column] = move[2] + turn[0] * arm[1] - turn[1] * arm[0]
                for r in range(3):
                    jacobians[n, 3 + r, column] = turn[r]
