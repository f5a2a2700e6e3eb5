"""Numba kernel of the tensions: a small convex quadratic problem with bounds.

``minimise 1/2 T^T A T + b^T T`` over ``low <= T <= high``, by an active-set method: bounds are
released one at a time, the free ones solved by Cholesky. With a strictly convex ``A`` (the caller
adds a little to its diagonal) it ends after finitely many steps.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = ["solve_bounded"]


@njit(cache=True)
def solve_cholesky(matrix, right, size):
    """Solve in place; the answer is in ``right``, ``matrix`` is lost. False if not definite."""
    for i in range(size):
        for k in range(i + 1):
            total = matrix[i, k]
            for n in range(k):
                total -= matrix[i, n] * matrix[k, n]
            if i > k:
                matrix[i, k] = total / matrix[k, k]
            elif total <= 0.0:
                return False
            else:
                matrix[i, i] = math.sqrt(total)
    for i in range(size):
        for n in range(i):
            right[i] -= matrix[i, n] * right[n]
        right[i] /= matrix[i, i]
    for i in range(size - 1, -1, -1):
        for n in range(i + 1, size):
            right[i] -= matrix[n, i] * right[n]
        right[i] /= matrix[i, i]
    return True


@njit(cache=True)
def solve_bounded(matrix, vector, low, high, tension):
    """Fill ``tension`` (k,) with the minimiser, from where it stands. False if it did not end."""
    size = vector.size
    state = np.zeros(size, dtype=np.int8)  # 0 free, -1 at the lower bound, 1 at the upper
    blocked = np.zeros(size, dtype=np.bool_)
    free = np.empty(size, dtype=np.int64)
    square = np.empty((size, size))
    right = np.empty(size)
    scale = 0.0
    for k in range(size):
        tension[k] = min(max(tension[k], low[k]), high[k])
        if tension[k] <= low[k]:
            state[k] = -1
        elif tension[k] >= high[k]:
            state[k] = 1
        scale = max(scale, abs(vector[k]))
    for _ in range(20 * size + 20):
        # The free ones, until all of them stay inside their bounds.
        for _ in range(size + 1):
            count = 0
            for k in range(size):
                if state[k] == 0:
                    free[count] = k
                    count += 1
            if count == 0:
                break
            for i in range(count):
                total = -vector[free[i]]
                for k in range(size):
                    if state[k] != 0:
                        total -= matrix[free[i], k] * tension[k]
                right[i] = total
                for k in range(count):
                    square[i, k] = matrix[free[i], free[k]]
            if not solve_cholesky(square, right, count):
                return False
            share, first = 1.0, -1
            for i in range(count):
                k = free[i]
                move = right[i] - tension[k]
                if right[i] < low[k] and (low[k] - tension[k]) > share * move:
                    share, first = (low[k] - tension[k]) / move, i
                elif right[i] > high[k] and (high[k] - tension[k]) < share * move:
                    share, first = (high[k] - tension[k]) / move, i
            for i in range(count):
                tension[free[i]] += share * (right[i] - tension[free[i]])
            if share > 0.0:
                blocked[:] = False
            if first < 0:
                break
            k = free[first]
            state[k] = -1 if right[first] < low[k] else 1
            tension[k] = low[k] if state[k] < 0 else high[k]
            blocked[k] = True
        # The bound that most wants to be released.
        worst, most = -1, 1e-15 * scale
        for k in range(size):
            if state[k] == 0 or blocked[k]:
                continue
            pull = vector[k]
            reach = abs(vector[k])
            for i in range(size):
                pull += matrix[k, i] * tension[i]
                reach = max(reach, abs(matrix[k, i] * tension[i]))
            gain = -pull if state[k] < 0 else pull
            if gain > most and gain > 1e-14 * reach:
                worst, most = k, gain
        if worst < 0:
            return True
        state[worst] = 0
    return False
