"""Numba kernels of measures: how far joints travel, and by the pure tractrix on the same path."""

from __future__ import annotations

import math

from numba import njit

__all__ = ["total_travel", "tractrix_travel"]


@njit(cache=True)
def total_travel(joints):
    """Return the sum over steps and joints of how far each joint moves [mm]."""
    total = 0.0
    for t in range(1, joints.shape[0]):
        for j in range(joints.shape[1]):
            square = 0.0
            for k in range(joints.shape[2]):
                square += (joints[t, j, k] - joints[t - 1, j, k]) ** 2
            total += math.sqrt(square)
    return total


@njit(cache=True)
def tractrix_travel(heads, chain, length):
    """Return the same sum for a free chain pulled along `heads` (steps, dim).

    Each joint is pulled straight towards the one before (thesis eq. 5.13, the discrete tractrix,
    first order in the head step). `chain` (joints, dim) is changed in place.
    """
    total = 0.0
    dim = chain.shape[1]
    for t in range(heads.shape[0]):
        square = 0.0
        for k in range(dim):
            square += (heads[t, k] - chain[0, k]) ** 2
            chain[0, k] = heads[t, k]
        total += math.sqrt(square)
        for j in range(1, chain.shape[0]):
            size = 0.0
            for k in range(dim):
                size += (chain[j, k] - chain[j - 1, k]) ** 2
            size = math.sqrt(size)
            scale = length / max(size, 1e-300)
            square = 0.0
            for k in range(dim):
                moved = chain[j - 1, k] + scale * (chain[j, k] - chain[j - 1, k])
                square += (moved - chain[j, k]) ** 2
                chain[j, k] = moved
            total += math.sqrt(square)
    return total
