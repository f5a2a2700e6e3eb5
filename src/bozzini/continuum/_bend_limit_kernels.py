"""Numba kernels of a quadratic step inside the limits of bends and tendons.

A set of bends is legal where every section's bend lies in a disc, ``|b_i| <= limit_i``, and linear
rows, the tendons' travel among them, lie in ranges. That set is convex, and the lowest point of a
convex quadratic in it is found by the dual active-set method of Goldfarb and Idnani (1983). A disc
counts as the family of all its tangents: the most violated one is added.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = ["factor_shifted", "measure_violation", "solve_factored", "step_inside"]

VIOLATION = 1e-11
"""Distance outside a limit that counts as none [rad]."""

DEPENDENT = 1e-18
"""Square of the sine between constraints below which they count as one."""

SOLVED = 0
EMPTY = 1
UNFINISHED = 2


@njit(cache=True)
def factor_shifted(matrix, shift, factor):
    """Fill the Cholesky factor of ``matrix + shift * 1``; False if it is not positive definite."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j] + (shift if i == j else 0.0)
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if not total > 1e-14 * (abs(matrix[i, i]) + shift):
                    return False
                factor[i, i] = math.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    return True


@njit(cache=True)
def _solve_lower(factor, vector):
    for i in range(vector.size):
        for k in range(i):
            vector[i] -= factor[i, k] * vector[k]
        vector[i] /= factor[i, i]


@njit(cache=True)
def _solve_upper(factor, vector):
    for i in range(vector.size - 1, -1, -1):
        for k in range(i + 1, vector.size):
            vector[i] -= factor[k, i] * vector[k]
        vector[i] /= factor[i, i]


@njit(cache=True)
def solve_factored(factor, vector):
    """Solve the factored system in place."""
    _solve_lower(factor, vector)
    _solve_upper(factor, vector)


@njit(cache=True)
def measure_violation(x, limits, rows, low, high, normal):
    """Return how far `x` is outside the limit it breaks most, and fill its inward normal.

    Parameters
    ----------
    x : (2 m,) float
        Bends.
    limits : (m,) float
        Largest bend of each section.
    rows : (c, 2 m) float
        Rows of length 1.
    low, high : (c,) float
        Range of each row times `x`.
    normal : (2 m,) float
        Filled if the violation is positive.
    """
    worst = 0.0
    which = -1
    for i in range(limits.size):
        over = math.hypot(x[2 * i], x[2 * i + 1]) - limits[i]
        if over > worst:
            worst = over
            which = i
    side = 0.0
    for j in range(low.size):
        value = 0.0
        for k in range(x.size):
            value += rows[j, k] * x[k]
        if low[j] - value > worst:
            worst = low[j] - value
            which = limits.size + j
            side = 1.0
        if value - high[j] > worst:
            worst = value - high[j]
            which = limits.size + j
            side = -1.0
    if which >= limits.size:
        for k in range(x.size):
            normal[k] = side * rows[which - limits.size, k]
    elif which >= 0:
        normal[:] = 0.0
        size = math.hypot(x[2 * which], x[2 * which + 1])
        normal[2 * which] = -x[2 * which] / size
        normal[2 * which + 1] = -x[2 * which + 1] / size
    return worst


@njit(cache=True)
def _split(vector, count, basis, upper, share, rest):
    """Write `vector` as ``share`` of the first active vectors and a `rest` across them.

    The active vectors are ``upper.T @ basis``. `share` is first in the basis, and stays so in the
    column ``upper[:, count]``. Returns the square of the rest's length.
    """
    n = vector.size
    for k in range(n):
        rest[k] = vector[k]
    for j in range(count):
        upper[j, count] = 0.0
    for _ in range(2):  # once more, against round-off
        for j in range(count):
            part = 0.0
            for k in range(n):
                part += basis[j, k] * rest[k]
            upper[j, count] += part
            for k in range(n):
                rest[k] -= part * basis[j, k]
    square = 0.0
    for k in range(n):
        square += rest[k] * rest[k]
    for i in range(count - 1, -1, -1):
        share[i] = upper[i, count]
        for j in range(i + 1, count):
            share[i] -= upper[i, j] * share[j]
        share[i] /= upper[i, i]
    return square


@njit(cache=True)
def _append(rest, square, count, basis, upper):
    """Make the vector that `_split` took apart the last active one."""
    size = math.sqrt(square)
    upper[count, count] = size
    for k in range(rest.size):
        basis[count, k] = rest[k] / size


@njit(cache=True)
def step_inside(factor, x, limits, rows, low, high):
    """Move `x`, the lowest point of a quadratic, to the lowest one inside the limits.

    Parameters
    ----------
    factor : (2 m, 2 m) float
        Cholesky factor of the quadratic's matrix.
    x : (2 m,) float
        In and out.
    limits, rows, low, high
        As in `measure_violation`.

    Returns
    -------
    int
        ``SOLVED``, ``EMPTY`` if nothing lies inside, or ``UNFINISHED``.
    """
    n = x.size
    normal = np.empty(n)
    violation = measure_violation(x, limits, rows, low, high, normal)
    if violation <= VIOLATION:
        return SOLVED
    active = np.empty((n + 1, n))
    weight = np.empty(n + 1)
    basis = np.empty((n, n))
    upper = np.empty((n, n + 1))
    share = np.empty(n)
    rest = np.empty(n)
    count = 0
    for _ in range(40 * (limits.size + 1) + 4 * low.size):
        _solve_lower(factor, normal)
        whole = 0.0
        for k in range(n):
            whole += normal[k] * normal[k]
        force = 0.0
        while True:
            free = _split(normal, count, basis, upper, share, rest)
            step = math.inf
            leaves = -1
            for j in range(count):
                if share[j] > 0.0 and weight[j] < step * share[j]:
                    step = weight[j] / share[j]
                    leaves = j
            moves = count < n and free > DEPENDENT * whole
            if moves and violation <= step * free:
                step = violation / free
                leaves = -1
            elif leaves < 0:
                return EMPTY
            for j in range(count):
                weight[j] -= step * share[j]
            force += step
            if moves:
                violation -= step * free
                if leaves < 0:
                    _append(rest, free, count, basis, upper)
                _solve_upper(factor, rest)
                for k in range(n):
                    x[k] += step * rest[k]
            if leaves < 0:
                active[count] = normal
                weight[count] = force
                count += 1
                break
            count -= 1
            for j in range(leaves, count):
                active[j] = active[j + 1]
                weight[j] = weight[j + 1]
                square = _split(active[j], j, basis, upper, share, rest)
                _append(rest, square, j, basis, upper)
        violation = measure_violation(x, limits, rows, low, high, normal)
        if violation <= VIOLATION:
            return SOLVED
    return UNFINISHED
