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

__all__ = ["arc_factors", "fill_arc", "fill_arc_frames", "put_arc"]

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
def _close_arc(length, bx, by, f1, f2):
    """Place and upper half of the rotation at the end of an arc, ``1 + f1 [w] + f2 [w]^2``."""
    return (
        length * f2 * bx,
        length * f2 * by,
        length * f1,
        1.0 - f2 * bx * bx,
        -f2 * bx * by,
        f1 * bx,
        1.0 - f2 * by * by,
        f1 * by,
        1.0 - f2 * (bx * bx + by * by),
    )


@njit(cache=True)
def put_arc(before, length, bend_x, bend_y, after):
    """Fill the frame `after` an arc that starts at the frame `before`."""
    f1, f2, _, _, _ = arc_factors(bend_x * bend_x + bend_y * bend_y)
    x, y, z, r00, r01, r02, r11, r12, r22 = _close_arc(length, bend_x, bend_y, f1, f2)
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
def fill_arc(length, bx, by, frame, slope, turn):
    """Fill frame, derivatives and turns of one arc, in the frame of its start.

    Parameters
    ----------
    length, bx, by : float
        Length [mm] and bend [rad].
    frame : (3, 4) float
        Filled with rotation and place of the end.
    slope : (2, 3) float
        Filled with the derivative of the place with `bx` and `by` [mm/rad].
    turn : (2, 3) float
        Filled with the rotation of the end per change of `bx` and `by`:
        ``(1 + f2 [w] + f3 [w]^2) dw``, the left Jacobian of SO(3).
    """
    f1, f2, f3, g1, g2 = arc_factors(bx * bx + by * by)
    x, y, z, r00, r01, r02, r11, r12, r22 = _close_arc(length, bx, by, f1, f2)
    frame[0, 0] = r00
    frame[0, 1] = r01
    frame[0, 2] = r02
    frame[0, 3] = x
    frame[1, 0] = r01
    frame[1, 1] = r11
    frame[1, 2] = r12
    frame[1, 3] = y
    frame[2, 0] = -r02
    frame[2, 1] = -r12
    frame[2, 2] = r22
    frame[2, 3] = z
    slope[0, 0] = length * (f2 + bx * bx * g2)
    slope[0, 1] = length * bx * by * g2
    slope[0, 2] = length * bx * g1
    slope[1, 0] = slope[0, 1]
    slope[1, 1] = length * (f2 + by * by * g2)
    slope[1, 2] = length * by * g1
    turn[0, 0] = -f3 * bx * by
    turn[0, 1] = 1.0 - f3 * by * by
    turn[0, 2] = -f2 * by
    turn[1, 0] = f3 * bx * bx - 1.0
    turn[1, 1] = f3 * bx * by
    turn[1, 2] = f2 * bx


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
