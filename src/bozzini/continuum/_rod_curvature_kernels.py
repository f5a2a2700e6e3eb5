"""Numba kernels of the Kirchhoff rod's curvature under the tensions of its tendons and a moment.

It is the minimum of ``1/2 u K u + sum T_k |t_k(u)| - m u`` with ``t_k = e_z + u x r_k + r_k'``, see
`_rod_kernels`.
"""

from __future__ import annotations

import math

from numba import njit

__all__ = ["expand_potential", "find_curvature", "solve_three"]

FOUND = 1e-15
"""Curvature [1/mm] that is round-off."""

MOST_STEPS = 200
"""Newton steps for a curvature; it takes a few."""

SMALLEST_PART = 1e-6
"""Smallest part of a Newton step."""

THIN = 1e-6
"""Part of the rod's stiffness that must be left of it where tendons push."""

ROUGH = 1e-7
"""Error of a curvature that is taken for round-off, where a stiff part pulls at a flexible one."""


@njit(cache=True)
def solve_three(a, b, least, out):
    """Fill ``out`` with the solution of a symmetric 3x3 system; False unless it is positive.

    ``least`` (3,) is what its pivots must exceed.
    """
    l0 = a[0, 0]
    if not l0 > least[0]:
        return False
    m1, m2 = a[1, 0] / l0, a[2, 0] / l0
    d1 = a[1, 1] - m1 * a[1, 0]
    if not d1 > least[1]:
        return False
    e = a[2, 1] - m1 * a[2, 0]
    m3 = e / d1
    d2 = a[2, 2] - m2 * a[2, 0] - m3 * e
    if not d2 > least[2]:
        return False
    y1 = b[1] - m1 * b[0]
    y2 = b[2] - m2 * b[0] - m3 * y1
    out[2] = y2 / d2
    out[1] = y1 / d1 - m3 * out[2]
    out[0] = b[0] / l0 - m1 * out[1] - m2 * out[2]
    return True


@njit(cache=True)
def expand_potential(stiffness, guides, present, tensions, moment, u, pulled, right, matrix):
    """Expand ``1/2 u K u + sum T_k |t_k(u)| - m u`` about ``u``; its value and its round-off.

    ``right`` (3,) gets minus the gradient, the lower half of ``matrix`` (3, 3) the Hessian; of
    tendons that push only if not ``pulled``, for without them it is always positive.
    """
    value = 0.0
    size = 0.0
    for i in range(3):
        right[i] = moment[i] - stiffness[i] * u[i]
        value += (0.5 * stiffness[i] * u[i] - moment[i]) * u[i]
        size += (0.5 * stiffness[i] * abs(u[i]) + abs(moment[i])) * abs(u[i])
        for n in range(3):
            matrix[i, n] = 0.0
        matrix[i, i] = stiffness[i]
    for k in range(tensions.size):
        if not present[k] or tensions[k] == 0.0:
            continue
        x, y = guides[k, 0], guides[k, 1]
        v0 = guides[k, 2] - u[2] * y
        v1 = guides[k, 3] + u[2] * x
        v2 = 1.0 + u[0] * y - u[1] * x
        long = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
        if long == 0.0:
            # The tendon is a point here: any direction of it will do.
            continue
        m0, m1, m2 = v2 * y / long, -v2 * x / long, (v1 * x - v0 * y) / long
        pull = tensions[k]
        value += pull * long
        size += abs(pull) * long
        right[0] -= pull * m0
        right[1] -= pull * m1
        right[2] -= pull * m2
        if pulled and pull < 0.0:
            continue
        share = pull / long
        matrix[0, 0] += share * (y * y - m0 * m0)
        matrix[1, 1] += share * (x * x - m1 * m1)
        matrix[2, 2] += share * (x * x + y * y - m2 * m2)
        matrix[1, 0] += share * (-x * y - m0 * m1)
        matrix[2, 0] -= share * m0 * m2
        matrix[2, 1] -= share * m1 * m2
    return value, 1e-15 * size


@njit(cache=True)
def find_curvature(stiffness, guides, present, tensions, moment, u, work):
    """Improve ``u`` (3,) until it is a minimum, where the rod's moment balances; False if not.

    ``guides`` (k, 4) are the tendons' places and slopes here, ``moment`` is in this frame. Every
    step of Newton's method is cut until it goes down.
    """
    matrix, right, step, least = work[0:3], work[3], work[4], work[10]
    before, last, part = math.inf, math.inf, 1.0
    step[:] = 0.0
    for _ in range(MOST_STEPS):
        value, grain = expand_potential(
            stiffness, guides, present, tensions, moment, u, False, right, matrix
        )
        if not math.isfinite(value):
            return False
        if value > before + grain and part > SMALLEST_PART:
            for i in range(3):
                u[i] -= 0.5 * part * step[i]
            part *= 0.5
            continue
        flat = not value < before - grain
        before = value
        for i in range(3):
            least[i] = THIN * stiffness[i]
        if not solve_three(matrix, right, least, step):
            expand_potential(stiffness, guides, present, tensions, moment, u, True, right, matrix)
            least[:] = 0.0
            if not solve_three(matrix, right, least, step):
                return False
        part = 1.0
        size, whole = 0.0, 0.0
        for i in range(3):
            size = max(size, abs(step[i]))
        # Where it does not go down any more, and steps do not get smaller, there is round-off.
        if flat and not size < 0.5 * last:
            for i in range(3):
                whole = max(whole, abs(u[i]))
            return size <= ROUGH * whole + FOUND
        last = size
        for i in range(3):
            u[i] += step[i]
            whole = max(whole, abs(u[i]))
        if size <= 1e-14 * whole + FOUND:
            return True
    return False
