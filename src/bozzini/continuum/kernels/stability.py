"""Numba kernels of stability: the second variation of a rod's energy, under what holds its tendons.

The form is that of a chain of steps, each by the turns of its two ends. Under tensions that are
held, an equilibrium is stable if it is positive. Where lengths are held, or tendons stretch, let
``A`` be the form, ``B`` the lengths' gradients and ``C`` the tendons' compliances: by the inertia
of the bordered matrix there are as many negative directions as ``A`` has, less those of ``C + B
A^-1 B^T``, which is how lengths give way to tension. That is so for rigid tendons, ``C = 0``, too.
"""

from __future__ import annotations

import numpy as np
from numba import njit

BAND = 6
"""Entries of a row up to the diagonal: turns of two neighbours."""

NONE = 1e-9
"""Part of the largest eigenvalue of how lengths give way that is round-off."""


@njit(cache=True)
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


@njit(cache=True)
def count_negative(form, compliances, taut, shift):
    """Directions in which the energy falls, less `shift` times the backbone's own energy.

    ``form`` is that of `fill_form`, ``compliances`` (k,) are those of the tendons and ``taut`` (k,)
    which of them hold a length.
    """
    matrices, metrics, rows, softness = form
    steps, held = len(matrices), np.flatnonzero(taut)
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
    if negative == 0 or held.size == 0:
        return negative
    right, give = np.zeros((3 * steps, held.size)), np.zeros((held.size, held.size))
    for n in range(steps):
        for c in range(held.size):
            for i in range(6):
                if n > 0 or i >= 3:
                    right[3 * (n - 1) + i, c] += rows[n, held[c], i]
            for d in range(held.size):
                give[c, d] += softness[n, held[c], held[d]]
    for i in range(3 * steps):
        for m in range(max(0, i - BAND + 1), i):
            part = band[i, m - i + BAND - 1]
            for c in range(held.size):
                right[i, c] -= part * right[m, c]
    for i in range(3 * steps):
        for c in range(held.size):
            part = right[i, c] / band[i, BAND - 1]
            for d in range(held.size):
                give[c, d] += part * right[i, d]
    for c in range(held.size):
        give[c, c] += compliances[held[c]]
    values = np.linalg.eigvalsh(give)
    largest = np.abs(values).max()
    for value in values:
        if value < -NONE * largest:
            negative -= 1
    return negative


MOST_HALVINGS = 16
"""Steps of the search for the least eigenvalue."""

LOWEST = 1e6
"""Size of the eigenvalues below which the search ends."""


@njit(cache=True)
def measure_stability(form, compliances, taut):
    """Least eigenvalue of the second variation, by the elastic energy of the backbone alone.

    It is 1 for a rod at rest, and falls to 0 where it buckles.
    """
    high, low = 1.0 - 1e-9, 0.0
    if count_negative(form, compliances, taut, high) == 0:
        return 1.0
    while count_negative(form, compliances, taut, low) > 0:
        high, low = low, 2.0 * low - 1.0
        if low < -LOWEST:
            return low
    for _ in range(MOST_HALVINGS):
        middle = 0.5 * (low + high)
        if count_negative(form, compliances, taut, middle) > 0:
            high = middle
        else:
            low = middle
    return low
