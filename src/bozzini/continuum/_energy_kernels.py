"""Numba kernels of the discrete rod: lengths of its tendons, its frames, and its linear problem.

A ``grid`` is what they all take: the segments' lengths (n,), their moments by turn about x, y and
z (n, 3), the tendons' places in the cross-sections (k, n + 1, 2), their places and slopes at the
Gauss points (k, n, g, 4), how many segments each tendon passes (k,), and the kind of segment.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ._energy_segment_kernels import (
    CHANNEL,
    fill_functions,
    fill_rotation,
    measure_channel,
    measure_length,
    move_forward,
)

__all__ = ["POINTS", "WEIGHTS", "fill_frames", "invert_blocks", "measure_lengths", "reduce_problem"]

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(3)
POINTS, WEIGHTS = 0.5 * (1.0 + POINTS), 0.5 * WEIGHTS
"""Gauss points of a segment, from 0 to 1, and their weights."""


@njit(cache=True)
def measure_lengths(grid, turns, tensions, lengths, slopes, psd, full):
    """Fill tendon lengths (k,), their gradients (k, n, 3), and the Hessians (n, 3, 3) by tension.

    ``full`` gets ``sum_k T_k d2l_k/dw2`` and ``psd`` the part of it that cannot be negative.
    """
    spans, _, paths, guides, counts, segment = grid
    f, half = np.empty(8), np.empty(8)
    step, step_slope, work = np.empty(3), np.empty((3, 3)), np.empty((5, 3))
    lengths[:] = 0.0
    slopes[:] = 0.0
    psd[:] = 0.0
    full[:] = 0.0
    for j in range(spans.size):
        w = turns[j]
        if segment == CHANNEL:
            for k in range(counts.size):
                if j < counts[k]:
                    lengths[k] += measure_channel(
                        w,
                        spans[j],
                        guides[k, j],
                        WEIGHTS,
                        tensions[k],
                        slopes[k, j],
                        psd[j],
                        full[j],
                    )
            continue
        q = w[0] ** 2 + w[1] ** 2 + w[2] ** 2
        fill_functions(q, f)
        fill_functions(0.25 * q, half)
        move_forward(w, f, half, spans[j], segment, step, step_slope)
        for k in range(counts.size):
            if j < counts[k]:
                lengths[k] += measure_length(
                    w,
                    f,
                    half,
                    spans[j],
                    segment,
                    paths[k, j],
                    paths[k, j + 1],
                    step,
                    step_slope,
                    tensions[k],
                    work,
                    slopes[k, j],
                    psd[j],
                    full[j],
                )


@njit(cache=True)
def fill_frames(grid, turns, rotations, points):
    """Frames of the discs, base first: rotations (n + 1, 3, 3) and origins (n + 1, 3)."""
    spans, _, _, _, _, segment = grid
    f, half = np.empty(8), np.empty(8)
    step, slope, turn = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    rotations[0] = np.eye(3)
    points[0] = 0.0
    for j in range(spans.size):
        w = turns[j]
        q = w[0] ** 2 + w[1] ** 2 + w[2] ** 2
        fill_functions(q, f)
        fill_functions(0.25 * q, half)
        move_forward(w, f, half, spans[j], segment, step, slope)
        fill_rotation(w, f, turn)
        for i in range(3):
            points[j + 1, i] = points[j, i]
            for k in range(3):
                points[j + 1, i] += rotations[j, i, k] * step[k]
                rotations[j + 1, i, k] = 0.0
                for m in range(3):
                    rotations[j + 1, i, k] += rotations[j, i, m] * turn[m, k]


@njit(cache=True)
def invert(matrix, least, inverse):
    """Inverse of a symmetric 3x3 matrix; False unless its pivots exceed ``least`` (3,)."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, g = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    if a <= least[0]:
        return False
    second = d - b * b / a
    if second <= least[1]:
        return False
    cross = e - b * c / a
    third = g - c * c / a - cross * cross / second
    if third <= least[2]:
        return False
    whole = a * second * third
    inverse[0, 0] = (d * g - e * e) / whole
    inverse[0, 1] = (c * e - b * g) / whole
    inverse[0, 2] = (b * e - c * d) / whole
    inverse[1, 1] = (a * g - c * c) / whole
    inverse[1, 2] = (b * c - a * e) / whole
    inverse[2, 2] = (a * d - b * b) / whole
    inverse[1, 0], inverse[2, 0], inverse[2, 1] = inverse[0, 1], inverse[0, 2], inverse[1, 2]
    return True


@njit(cache=True)
def invert_blocks(stiffness, psd, full, exact, inverses):
    """Invert the Hessian (n, 3, 3); where it is not positive, the part of it that is. Counts."""
    block, least = np.empty((3, 3)), np.empty(3)
    replaced = 0
    for j in range(stiffness.shape[0]):
        done = False
        if exact:
            for i in range(3):
                least[i] = 1e-3 * stiffness[j, i]
                for k in range(3):
                    block[i, k] = full[j, i, k]
                block[i, i] += stiffness[j, i]
            done = invert(block, least, inverses[j])
        if not done:
            replaced += 1
            least[:] = 0.0
            for i in range(3):
                for k in range(3):
                    block[i, k] = psd[j, i, k] if exact else 0.0
                block[i, i] += stiffness[j, i]
            invert(block, least, inverses[j])
    return replaced


@njit(cache=True)
def reduce_problem(slopes, counts, inverses, forces, matrix, vector, carried):
    """Fill ``J H^-1 J^T`` (k, k) and ``J H^-1 g`` (k,), and keep ``J H^-1`` in ``carried``."""
    matrix[:] = 0.0
    vector[:] = 0.0
    for k in range(counts.size):
        for j in range(counts[k]):
            for i in range(3):
                carried[k, j, i] = (
                    slopes[k, j, 0] * inverses[j, 0, i]
                    + slopes[k, j, 1] * inverses[j, 1, i]
                    + slopes[k, j, 2] * inverses[j, 2, i]
                )
                vector[k] += carried[k, j, i] * forces[j, i]
        for m in range(k + 1):
            total = 0.0
            for j in range(min(counts[k], counts[m])):
                for i in range(3):
                    total += carried[k, j, i] * slopes[m, j, i]
            matrix[k, m] = total
            matrix[m, k] = total
