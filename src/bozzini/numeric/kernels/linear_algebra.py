"""Numba kernels of small linear systems: Cholesky, bounded quadratic problems, 3x3 matrices."""

from __future__ import annotations

import math

import numpy as np

from ..compiling import kernel


@kernel
def factor_cholesky(matrix, size, shift, least, factor):
    """Fill the lower Cholesky factor of the first `size` rows of ``matrix + shift * 1``.

    Pivots must exceed ``least`` times the diagonal; False if one does not. `factor` may be
    `matrix` itself.
    """
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            if i == j:
                floor = least * (abs(total) + shift)
                total += shift
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = total / factor[j, j]
            elif not total > floor:
                return False
            else:
                factor[i, i] = math.sqrt(total)
    return True


@kernel
def solve_lower(factor, vector, size):
    """Solve ``L x = vector`` in place."""
    for i in range(size):
        for k in range(i):
            vector[i] -= factor[i, k] * vector[k]
        vector[i] /= factor[i, i]


@kernel
def solve_upper(factor, vector, size):
    """Solve ``L^T x = vector`` in place, given ``L``."""
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            vector[i] -= factor[k, i] * vector[k]
        vector[i] /= factor[i, i]


@kernel
def factor_lu(matrix, order):
    """Factor a matrix in place with row exchanges, kept in ``order`` (n,); False if singular."""
    size = order.size
    for k in range(size):
        pivot, most = k, abs(matrix[k, k])
        for i in range(k + 1, size):
            if abs(matrix[i, k]) > most:
                pivot, most = i, abs(matrix[i, k])
        order[k] = pivot
        if not most > 0.0 or not math.isfinite(most):
            return False
        if pivot != k:
            for j in range(size):
                matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
        for i in range(k + 1, size):
            part = matrix[i, k] / matrix[k, k]
            matrix[i, k] = part
            if part != 0.0:
                for j in range(k + 1, size):
                    matrix[i, j] -= part * matrix[k, j]
    return True


@kernel
def solve_lu(factors, order, right):
    """Solve for the columns of ``right`` (n, m) in place, given the answer of `factor_lu`."""
    size = order.size
    columns = right.shape[1]
    for k in range(size):
        if order[k] != k:
            for c in range(columns):
                right[k, c], right[order[k], c] = right[order[k], c], right[k, c]
    for i in range(size):
        for j in range(i):
            part = factors[i, j]
            if part != 0.0:
                for c in range(columns):
                    right[i, c] -= part * right[j, c]
    for i in range(size - 1, -1, -1):
        for j in range(i + 1, size):
            part = factors[i, j]
            if part != 0.0:
                for c in range(columns):
                    right[i, c] -= part * right[j, c]
        for c in range(columns):
            right[i, c] /= factors[i, i]


BLOCKS = 3
"""Exchanges of all wrong bounds at once that may fail to make them fewer."""


@kernel
def solve_bounded(matrix, vector, low, high, values):
    """Minimise ``1/2 T A T + b T`` over ``low <= T <= high`` by an active-set method.

    Bounds are released one at a time, the free ones solved by Cholesky's method. With a strictly
    convex ``A`` it ends after finitely many steps. Fills ``values`` (k,) from where it stands;
    False if it did not end.
    """
    size = vector.size
    state = np.zeros(size, dtype=np.int8)  # 0 free, -1 at the lower bound, 1 at the upper
    blocked = np.zeros(size, dtype=np.bool_)
    free = np.empty(size, dtype=np.int64)
    square = np.empty((size, size))
    right = np.empty(size)
    scale = 0.0
    for k in range(size):
        values[k] = min(max(values[k], low[k]), high[k])
        if values[k] <= low[k]:
            state[k] = -1
        elif values[k] >= high[k]:
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
                        total -= matrix[free[i], k] * values[k]
                right[i] = total
                for k in range(count):
                    square[i, k] = matrix[free[i], free[k]]
            if not factor_cholesky(square, count, 0.0, 0.0, square):
                return False
            solve_lower(square, right, count)
            solve_upper(square, right, count)
            share, first = 1.0, -1
            for i in range(count):
                k = free[i]
                move = right[i] - values[k]
                if right[i] < low[k] and (low[k] - values[k]) > share * move:
                    share, first = (low[k] - values[k]) / move, i
                elif right[i] > high[k] and (high[k] - values[k]) < share * move:
                    share, first = (high[k] - values[k]) / move, i
            for i in range(count):
                values[free[i]] += share * (right[i] - values[free[i]])
            if share > 0.0:
                blocked[:] = False
            if first < 0:
                break
            k = free[first]
            state[k] = -1 if right[first] < low[k] else 1
            values[k] = low[k] if state[k] < 0 else high[k]
            blocked[k] = True
        # The bound that most wants to be released.
        worst, most = -1, 1e-15 * scale
        for k in range(size):
            if state[k] == 0 or blocked[k]:
                continue
            pull = vector[k]
            reach = abs(vector[k])
            for i in range(size):
                pull += matrix[k, i] * values[i]
                reach = max(reach, abs(matrix[k, i] * values[i]))
            gain = -pull if state[k] < 0 else pull
            if gain > most and gain > 1e-14 * reach:
                worst, most = k, gain
        if worst < 0:
            return True
        state[worst] = 0
    return False


@kernel
def solve_complementary(matrix, vector, low, high, values):
    """Find ``low <= T <= high`` with ``A T + b`` 0 where inside, and outward on the bounds.

    ``A`` need not be symmetric: where its symmetric part is positive definite there is one answer.
    Block principal pivoting, one bound at a time where that does not get on (Judice and Pires
    1994). Fills ``values`` (k,) from the bounds where they stand; False if it did not end.
    """
    size = vector.size
    state = np.zeros(size, dtype=np.int8)  # 0 free, -1 at the lower bound, 1 at the upper
    wanted = np.zeros(size, dtype=np.int8)
    free = np.empty(size, dtype=np.int64)
    for k in range(size):
        state[k] = -1 if values[k] <= low[k] else (1 if values[k] >= high[k] else 0)
    fewest, patience = size + 1, BLOCKS
    for _ in range(100 * size + 100):
        for k in range(size):
            if state[k] != 0:
                values[k] = low[k] if state[k] < 0 else high[k]
        count = 0
        for k in range(size):
            if state[k] == 0:
                free[count] = k
                count += 1
        square, order = np.empty((count, count)), np.empty(count, dtype=np.int64)
        right = np.empty((count, 1))
        for i in range(count):
            right[i, 0] = -vector[free[i]]
            for k in range(size):
                if state[k] != 0:
                    right[i, 0] -= matrix[free[i], k] * values[k]
            for k in range(count):
                square[i, k] = matrix[free[i], free[k]]
        if not factor_lu(square, order):
            return False
        solve_lu(square, order, right)
        for i in range(count):
            values[free[i]] = right[i, 0]
        wrong, last = 0, -1
        for k in range(size):
            wanted[k] = state[k]
            if state[k] == 0:
                wanted[k] = -1 if values[k] < low[k] else (1 if values[k] > high[k] else 0)
            else:
                total, reach = vector[k], abs(vector[k])
                for i in range(size):
                    total += matrix[k, i] * values[i]
                    reach = max(reach, abs(matrix[k, i] * values[i]))
                if state[k] * total > 1e-14 * reach:
                    wanted[k] = 0
            if wanted[k] != state[k]:
                wrong, last = wrong + 1, k
        if wrong == 0:
            return True
        if wrong < fewest:
            fewest, patience = wrong, BLOCKS
        else:
            patience -= 1
        for k in range(size):
            if patience >= 0 or k == last:
                state[k] = wanted[k]
    return False


@kernel
def _factor_three(a, least):
    """Factors ``L D L^T`` of a symmetric 3x3 matrix, by its lower half, and if they are good.

    ``D`` must exceed ``least`` (3,). Returns that, ``D``, and ``L``'s entries 10, 20 and 21.
    """
    d0 = a[0, 0]
    if not d0 > least[0]:
        return False, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0
    m1, m2 = a[1, 0] / d0, a[2, 0] / d0
    d1 = a[1, 1] - m1 * a[1, 0]
    if not d1 > least[1]:
        return False, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0
    e = a[2, 1] - m1 * a[2, 0]
    m3 = e / d1
    d2 = a[2, 2] - m2 * a[2, 0] - m3 * e
    return d2 > least[2], d0, d1, d2, m1, m2, m3


@kernel
def solve_three(a, b, least, out):
    """Fill ``out`` with the solution of a symmetric 3x3 system; False unless it is positive.

    ``least`` (3,) is what its pivots must exceed.
    """
    good, d0, d1, d2, m1, m2, m3 = _factor_three(a, least)
    if not good:
        return False
    y1 = b[1] - m1 * b[0]
    y2 = b[2] - m2 * b[0] - m3 * y1
    out[2] = y2 / d2
    out[1] = y1 / d1 - m3 * out[2]
    out[0] = b[0] / d0 - m1 * out[1] - m2 * out[2]
    return True


@kernel
def invert_three(a, least, inverse):
    """Fill the inverse of a symmetric 3x3 matrix; False as of `solve_three`."""
    good, d0, d1, d2, m1, m2, m3 = _factor_three(a, least)
    if not good:
        return False
    n2 = m1 * m3 - m2  # L^-1 has -m1, n2 and -m3
    inverse[0, 0] = 1.0 / d0 + m1 * m1 / d1 + n2 * n2 / d2
    inverse[0, 1] = -m1 / d1 - n2 * m3 / d2
    inverse[0, 2] = n2 / d2
    inverse[1, 1] = 1.0 / d1 + m3 * m3 / d2
    inverse[1, 2] = -m3 / d2
    inverse[2, 2] = 1.0 / d2
    inverse[1, 0], inverse[2, 0], inverse[2, 1] = inverse[0, 1], inverse[0, 2], inverse[1, 2]
    return True
