"""Numba kernels that complete the Gauss-Newton matrix of the inverse to the second derivative.

Where a target is out of reach its miss does not vanish, and the second derivatives of the chain
count: without them the last steps to the nearest shape are many. A section turns all that lies
beyond it, so across sections the second derivative is a turn of the first one; within a section it
follows from ``L (f2 bx, f2 by, f1) + R v`` with ``R v = cos v + f1 w x v + f2 w (w . v)``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ._arc_kernels import arc_factors
from ._chain_arc_kernels import place_point

__all__ = ["add_curvature", "fill_arc_curvature"]

SERIES_BELOW = 0.25


@njit(cache=True)
def _second_factors(square, f1, g1, g2):
    """Second derivatives of f1 and f2 with ``theta ** 2``."""
    if square >= SERIES_BELOW:
        return (
            -(0.5 * f1 + 1.5 * g1) / (2.0 * square),
            (0.25 * g1 - g2) / square,
        )
    first = 0.0
    second = 0.0
    term = 1.0 / 120.0  # (-square)**(k - 2) / (2 k + 1)!
    for k in range(2, 11):
        first += k * (k - 1) * term
        second += k * (k - 1) * term / (2 * k + 2)
        term *= -square / ((2 * k + 2) * (2 * k + 3))
    return first, second


@njit(cache=True)
def fill_arc_curvature(length, bx, by, pull, arm, out):
    """Fill the second derivative of ``pull . (place + R arm)`` with the bend of one arc.

    Parameters
    ----------
    length, bx, by : float
        Length [mm] and bend [rad].
    pull : (3,) float
        Vector in the frame of the arc's start.
    arm : (3,) float
        Vector in the frame of its end, from there.
    out : (2, 2) float
        Filled.
    """
    square = bx * bx + by * by
    f1, f2, _, g1, g2 = arc_factors(square)
    second1, second2 = _second_factors(square, f1, g1, g2)
    dot = pull[0] * arm[0] + pull[1] * arm[1] + pull[2] * arm[2]
    turn_x = arm[2] * pull[0] - arm[0] * pull[2]
    turn_y = -(arm[1] * pull[2] - arm[2] * pull[1])
    p = (pull[1], -pull[0])
    s = (arm[1], -arm[0])
    along_p = p[0] * bx + p[1] * by
    along_s = s[0] * bx + s[1] * by
    value1 = length * pull[2] + turn_x * bx + turn_y * by
    value2 = length * (pull[0] * bx + pull[1] * by) + along_p * along_s
    b = (bx, by)
    slope1 = (turn_x, turn_y)
    slope2 = (
        length * pull[0] + p[0] * along_s + s[0] * along_p,
        length * pull[1] + p[1] * along_s + s[1] * along_p,
    )
    # Derivatives of cos with the square are -f1 / 2 and -g1 / 4.
    bent = 4.0 * (second1 * value1 + second2 * value2) - g1 * dot
    even = g1 * value1 + g2 * value2 - f1 * dot
    for i in range(2):
        for j in range(2):
            out[i, j] = (
                bent * b[i] * b[j]
                + g1 * (b[i] * slope1[j] + b[j] * slope1[i])
                + g2 * (b[i] * slope2[j] + b[j] * slope2[i])
                + f2 * (p[i] * s[j] + p[j] * s[i])
            )
        out[i, i] += even


@njit(cache=True)
def _into(frame, vector, out):
    """Turn a vector of the base's frame into that of `frame`."""
    for k in range(3):
        out[k] = frame[0, k] * vector[0] + frame[1, k] * vector[1] + frame[2, k] * vector[2]


@njit(cache=True)
def _add_between(turns, rows, pull, last, matrix):
    """Add what different sections, up to `last`, have in common."""
    for i in range(last):
        for a in range(2):
            wx = turns[i, a, 0]
            wy = turns[i, a, 1]
            wz = turns[i, a, 2]
            x = pull[1] * wz - pull[2] * wy
            y = pull[2] * wx - pull[0] * wz
            z = pull[0] * wy - pull[1] * wx
            for j in range(2 * i + 2, 2 * last + 2):
                matrix[j, 2 * i + a] += rows[j, 0] * x + rows[j, 1] * y + rows[j, 2] * z


@njit(cache=True)
def add_curvature(goal, bends, work, matrix):
    """Add the second derivatives to the lower half of a Gauss-Newton matrix.

    Parameters are those of `evaluate`, which has filled `work` at the same bends.
    """
    lengths, owner, share, places, weights, axes, turn, _ = goal
    frames, slopes, turns, point, rows = work
    sections = lengths.size
    pull = np.empty(3)
    local = np.empty(3)
    beyond = np.empty(3)
    arm = np.empty(3)
    block = np.empty((2, 2))
    for k in range(owner.size):
        last = owner[k]
        place_point(lengths, bends, frames, slopes, turns, last, share[k], point, rows)
        for r in range(3):
            pull[r] = weights[k] * weights[k] * (point[r] - places[k, r])
        _add_between(turns, rows, pull, last, matrix)
        for i in range(last + 1):
            part = share[k] if i == last else 1.0
            _into(frames[i], pull, local)
            for r in range(3):
                beyond[r] = 0.0 if i == last else point[r] - frames[i + 1, r, 3]
            _into(frames[i + 1], beyond, arm)
            fill_arc_curvature(
                part * lengths[i], part * bends[i, 0], part * bends[i, 1], local, arm, block
            )
            _add_block(block, part * part, i, matrix)
    weight = turn * turn / (1.0 if axes.shape[0] == 1 else 2.0)
    tip = frames[sections]
    for c in range(axes.shape[0]):
        column = (2 + c) % 3
        for r in range(3):
            beyond[r] = tip[r, column]
            pull[r] = weight * (beyond[r] - axes[c, r])
        for i in range(2 * sections):
            wx = turns[i // 2, i % 2, 0]
            wy = turns[i // 2, i % 2, 1]
            wz = turns[i // 2, i % 2, 2]
            rows[i, 0] = wy * beyond[2] - wz * beyond[1]
            rows[i, 1] = wz * beyond[0] - wx * beyond[2]
            rows[i, 2] = wx * beyond[1] - wy * beyond[0]
        _add_between(turns, rows, pull, sections - 1, matrix)
        for i in range(sections):
            _into(frames[i], pull, local)
            _into(frames[i + 1], beyond, arm)
            fill_arc_curvature(0.0, bends[i, 0], bends[i, 1], local, arm, block)
            _add_block(block, 1.0, i, matrix)


@njit(cache=True)
def _add_block(block, scale, section, matrix):
    for a in range(2):
        for b in range(a + 1):
            matrix[2 * section + a, 2 * section + b] += scale * block[a, b]
