"""Numba kernels of stability: the second variation of a rod's energy, under what holds its tendons.

The form is that of a chain of steps, each by the turns of its two ends. Under tensions that are
held, an equilibrium is stable if it is positive. Where lengths are held, or tendons stretch, let
``A`` be the form, ``B`` the lengths' gradients and ``C`` the tendons' compliances: by the inertia
of the bordered matrix there are as many negative directions as ``A`` has, less those of ``C + B
A^-1 B^T``, which is how lengths give way to tension. That is so for rigid tendons, ``C = 0``, too.

A cable of the commanded length without tension holds what would lengthen it, and goes slack under
what shortens it. The energy falls with such cables where it does with all of them held, and where
one of the directions in which it falls without them lengthens none.
"""

from __future__ import annotations

import numpy as np
from numba import njit

BAND = 6
"""Entries of a row up to the diagonal: turns of two neighbours."""

NONE = 1e-9
"""Part of the largest eigenvalue of how lengths give way that is round-off."""

MOST_PROJECTIONS = 300
"""Steps of the search for a direction that lengthens no idle cable."""

SHORTENS = 1e-3
"""Size of what is left, of 1 for each cable, above which there is such a direction."""


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def count_negative(form, compliances, taut, idle, shift):
    """Directions in which the energy falls, less `shift` times the backbone's own energy.

    ``form`` is that of `fill_form`, ``compliances`` (k,) are those of the tendons, ``taut`` (k,)
    which of them hold a length, and ``idle`` (k,) which of these are cables without tension. One
    stands for all directions that lengthen no idle cable.
    """
    matrices, metrics, rows, softness = form
    steps, count, held = len(matrices), 0, np.empty(taut.size, dtype=np.int64)
    for m in range(taut.size):
        if taut[m]:
            held[count] = m
            count += 1
    band = np.zeros((3 * steps, BAND))
    for n in range(steps):
        for i in range(6):
            for j in range(i + 1):
                a, b = 3 * (n - 1) + i, 3 * (n - 1) + j
                if b < 0:
                    continue
                sign = 1.0 if (i < 3) == (j < 3) else -1.0
                own = sign * metrics[n, i % 3, j % 3]
                band[a, b - a + BAND - 1] += matrices[n, i, j] - shift * own
    negative = factor_band(band)
    if negative == 0 or count == 0:
        return negative
    right, give = np.zeros((3 * steps, count)), np.zeros((count, count))
    for n in range(steps):
        for c in range(count):
            for i in range(6):
                if n > 0 or i >= 3:
                    right[3 * (n - 1) + i, c] += rows[n, held[c], i]
            for d in range(count):
                give[c, d] += softness[n, held[c], held[d]]
    for i in range(3 * steps):
        for m in range(max(0, i - BAND + 1), i):
            part = band[i, m - i + BAND - 1]
            for c in range(count):
                right[i, c] -= part * right[m, c]
    for i in range(3 * steps):
        for c in range(count):
            part = right[i, c] / band[i, BAND - 1]
            for d in range(count):
                give[c, d] += part * right[i, d]
    for c in range(count):
        give[c, c] += compliances[held[c]]
    left = negative - count_below(give.copy())
    if left > 0:
        return left
    tight = np.array([c for c in range(count) if not idle[held[c]]], dtype=np.int64)
    loose = np.array([c for c in range(count) if idle[held[c]]], dtype=np.int64)
    if len(loose) == 0 or negative == count_below(give[tight][:, tight]):
        return left
    for c in loose:
        give[c, c] -= compliances[held[c]]
    lengths = give[loose][:, loose]
    if len(tight) > 0:
        cross = give[tight][:, loose]
        lengths -= cross.T @ np.linalg.solve(give[tight][:, tight], cross)
    return 1 if may_slacken(lengths) else 0


@njit(cache=True, error_model="numpy")
def may_slacken(lengths):
    """Whether a direction in which the energy falls lengthens no idle cable.

    ``lengths`` (k, k) is how their lengths give way to tension. By projections in turn on its
    negative eigenvectors and on lengths that all shorten, which end at 0 if only that is in both.
    """
    sizes, ways = np.linalg.eigh(0.5 * (lengths + lengths.T))
    ways = np.ascontiguousarray(ways[:, sizes < -NONE * np.abs(sizes).max()])
    change = np.ones(len(lengths))
    for _ in range(MOST_PROJECTIONS):
        change = np.maximum(ways @ (ways.T @ change), 0.0)
    return bool((change**2).sum() > SHORTENS**2 * len(change))


@njit(cache=True, error_model="numpy")
def count_below(matrix):
    """Eigenvalues below round-off of a symmetric matrix, which is changed: by its pivots."""
    size, largest, below = len(matrix), 0.0, 0
    left = np.ones(size, dtype=np.bool_)
    for i in range(size):
        for j in range(size):
            largest = max(largest, abs(matrix[i, j]))
    for i in range(size):
        matrix[i, i] += NONE * largest
    for _ in range(size):
        p = -1
        for i in range(size):
            if left[i] and (p < 0 or abs(matrix[i, i]) > abs(matrix[p, p])):
                p = i
        left[p] = False
        if matrix[p, p] < 0.0:
            below += 1
        for i in range(size):
            if left[i] and matrix[i, p] != 0.0:
                part = matrix[i, p] / matrix[p, p]
                for j in range(size):
                    matrix[i, j] -= part * matrix[p, j]
    return below


MOST_HALVINGS = 16
"""Steps of the search for the least eigenvalue."""

LOWEST = 1e6
"""Size of the eigenvalues below which the search ends."""


@njit(cache=True, error_model="numpy")
def measure_stability(form, compliances, taut, idle):
    """Least eigenvalue of the second variation, by the elastic energy of the backbone alone.

    It is 1 for a rod at rest, and falls to 0 where it buckles.
    """
    high, low = 1.0 - 1e-9, 0.0
    if count_negative(form, compliances, taut, idle, high) == 0:
        return 1.0
    while count_negative(form, compliances, taut, idle, low) > 0:
        high, low = low, 2.0 * low - 1.0
        if low < -LOWEST:
            return low
    for _ in range(MOST_HALVINGS):
        middle = 0.5 * (low + high)
        if count_negative(form, compliances, taut, idle, middle) > 0:
            high = middle
        else:
            low = middle
    return low
