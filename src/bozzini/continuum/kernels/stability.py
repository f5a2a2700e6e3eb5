"""Numba kernels of stability: the factors of a chain's quadratic form, and signs of eigenvalues.

The second variation of a rod in n steps, by the rotations ``f_0 = 0`` at the base to ``f_n``, is a
sum over steps of ``(f_j-1, f_j) . A_j (f_j-1, f_j)`` with blocks (6, 6) of `rod.fill_form`. Less
``shift`` times the backbone's own ``(f_j - f_j-1) . K_j (f_j - f_j-1)`` it is a band matrix ``A``
of 3 n unknowns. Factored as ``L D L^T`` it has as many negative eigenvalues as pivots (Sylvester),
and ``B A^-1 B^T`` follows by substitution, for the gradients ``B`` of tendon lengths.
`continuum.stability` says what follows for the rod.
"""

from __future__ import annotations

import numpy as np

from ...numeric.compiling import kernel

BAND = 6
"""Entries of a row up to the diagonal: rotations of two neighbours."""

ROUND_OFF = 1e-9
"""Part of the largest eigenvalue of the lengths' flexibility that is round-off."""


@kernel(error_model="numpy")
def factor_band(band):
    """Factor ``L D L^T`` in place, rows up to the diagonal (n, 6); returns the negative pivots."""
    size = len(band)
    negative = 0
    for i in range(size):
        low = max(0, i - BAND + 1)
        for j in range(low, i + 1):
            total = band[i, j - i + BAND - 1]
            for m in range(max(low, j - BAND + 1), j):
                total -= band[i, m - i + BAND - 1] * band[j, m - j + BAND - 1] * band[m, BAND - 1]
            if j < i:
                total /= band[j, BAND - 1]
            elif total == 0.0:
                total = 1e-300
            band[i, j - i + BAND - 1] = total
        if band[i, BAND - 1] < 0.0:
            negative += 1
    return negative


@kernel(error_model="numpy")
def reduce_form(form, held, shift, flexibility):
    """Negative directions of a form; fills the flexibility of held lengths, ``B A^-1 B^T``.

    ``form`` is that of `fill_form`, less ``shift`` times the backbone's own energy, and ``held``
    (c,) are the tendons of ``flexibility`` (c, c), to which that of shear and stretch is added. It
    is not filled if no direction is negative.
    """
    matrices, backbone, length_gradients, length_flexibility = form
    steps, count = len(matrices), held.size
    band = np.zeros((3 * steps, BAND))
    for n in range(steps):
        for i in range(6):
            for j in range(i + 1):
                a, b = 3 * (n - 1) + i, 3 * (n - 1) + j
                if b < 0:
                    continue
                sign = 1.0 if (i < 3) == (j < 3) else -1.0
                backbone_entry = sign * backbone[n, i % 3, j % 3]
                band[a, b - a + BAND - 1] += matrices[n, i, j] - shift * backbone_entry
    negative = factor_band(band)
    if negative == 0 or count == 0:
        return negative
    right = np.zeros((3 * steps, count))
    flexibility[:] = 0.0
    for n in range(steps):
        for c in range(count):
            for i in range(6):
                if n > 0 or i >= 3:
                    right[3 * (n - 1) + i, c] += length_gradients[n, held[c], i]
            for d in range(count):
                flexibility[c, d] += length_flexibility[n, held[c], held[d]]
    for i in range(3 * steps):
        for m in range(max(0, i - BAND + 1), i):
            factor = band[i, m - i + BAND - 1]
            for c in range(count):
                right[i, c] -= factor * right[m, c]
    for i in range(3 * steps):
        for c in range(count):
            factor = right[i, c] / band[i, BAND - 1]
            for d in range(count):
                flexibility[c, d] += factor * right[i, d]
    return negative


@kernel(error_model="numpy")
def count_below(matrix):
    """Eigenvalues below round-off of a symmetric matrix, which is changed: by its pivots."""
    size, largest, below = len(matrix), 0.0, 0
    remaining = np.ones(size, dtype=np.bool_)
    for i in range(size):
        for j in range(size):
            largest = max(largest, abs(matrix[i, j]))
    for i in range(size):
        matrix[i, i] += ROUND_OFF * largest
    for _ in range(size):
        pivot = -1
        for i in range(size):
            if remaining[i] and (pivot < 0 or abs(matrix[i, i]) > abs(matrix[pivot, pivot])):
                pivot = i
        remaining[pivot] = False
        if matrix[pivot, pivot] < 0.0:
            below += 1
        for i in range(size):
            if remaining[i] and matrix[i, pivot] != 0.0:
                factor = matrix[i, pivot] / matrix[pivot, pivot]
                for j in range(size):
                    matrix[i, j] -= factor * matrix[pivot, j]
    return below
