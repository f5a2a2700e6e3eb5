"""Numba kernels of the discrete rod under loads: Newton's method with the exact Hessian.

The least of elastic energy and the loads' potential ``V``, with tendons whose length or whose
tension is commanded. Unknowns are the rotation vectors ``w`` (n, 3) of the segments [rad], scaled
by the root of the stiffness. With the compliance ``c`` of a tendon, that of the penalty ``r``, and
the last multiplier ``T0``::

    L(w) = 1/2 (w - u) . K (w - u) + V(w) + sum_k [T (l_k - limit_k) - 1/2 c T^2 - 1/2 r (T - T0)^2]
    T = (l_k - limit_k + r T0) / (c + r) ,  of a cable at least 0 ;  a given tension has T l_k
    Hessian = K + d2V + sum_k T_k d2l_k + sum_k dl_k dl_k^T / (c + r)  of taut tendons

That is an augmented Lagrangian (Nocedal and Wright 2006, chapter 17): every
step is one of Newton's method on it, with a Hessian that is shifted until it is positive, and a
line search; so what is found is a minimum, unless the search begins at a saddle. Loads without a
potential have no such function: there the residual's norm has to fall.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_matrix, copy_vector
from ...numeric.kernels.linear_algebra import factor_lu, solve_lu
from .energy import (
    CONVERGED,
    FOLD_ANGLE,
    FOLDED,
    NOT_CONVERGED,
    ROUGH,
    STEP_LIMIT,
    STEP_TOLERANCE,
    measure_lengths,
)
from .loads import measure_loads

PROXIMITY = 1e-5
"""Flexibility of the augmented Lagrangian, against the backbone's as a tendon has it."""

LEAST_DECREASE = 1e-4
"""Share of the promised decrease that a step has to bring."""

FIRST_SHIFT = 1e-2
"""First shift of a Hessian that is not positive, against the straight rod's."""

SADDLE_TOLERANCE = 1e-13
"""Turn at which a point counts as a saddle, where the Hessian is not positive [rad]."""

SETTLED = 1e-13
"""Error of a tendon's length, against the longest, below which no further step is taken."""

LEAST_PIVOT = 1e-13
"""Pivot of a Hessian that counts as zero, against its diagonal."""

MOST_HALVINGS = 25
"""Halvings of a step in the line search."""


@kernel
def fill_proximities(grid, compliances, held, proximities):
    """Flexibility (k,) [mm/N] by which the lengths are held in one step; 0 of soft tendons."""
    _, stiffness, paths, _, counts, _ = grid
    for k in range(counts.size):
        give = 0.0
        for j in range(counts[k]):
            square = paths[k, j + 1, 0] ** 2 + paths[k, j + 1, 1] ** 2
            give += square / min(stiffness[j, 0], stiffness[j, 1])
        soft = compliances[k] > PROXIMITY * give
        proximities[k] = 0.0 if soft or not held[k] else PROXIMITY * max(give, 1e-300)


@kernel
def measure_equilibrium(rod, limits, rotation_vectors, tensions, state):
    """Augmented Lagrangian at the rotations, its gradient and what its Hessian is made of.

    ``rod`` is the grid, the rotations at rest (n, 3), the tendons and the loads. Tendons are their
    compliances (k,) [mm/N], which are held at a length (k,), which only pull (k,), the tensions of
    those that are not held (k,) [N], and `fill_proximities`. Loads are ``stations`` and ``loads``
    of `measure_loads`. ``limits`` (k,) are the free lengths of held tendons.

    ``state`` is filled: lengths, trial tensions, slopes (k, n, 3), psd and full (n, 3, 3) of
    `measure_lengths`, gradient (n, 3), and Hessian (3 n, 3 n) without the part of the lengths.
    """
    grid, rest, tendons, stations, loads = rod
    compliances, held, one_sided, pulls, proximities = tendons
    lengths, trial, length_gradients, psd, full, gradient, hessian = state
    stiffness = grid[1]
    n, k = rotation_vectors.shape[0], lengths.size
    value = measure_loads(grid, rotation_vectors, stations, loads, gradient, hessian)
    trial[:] = 0.0
    measure_lengths(grid, rotation_vectors, trial, lengths, length_gradients, psd, full)
    for m in range(k):
        if held[m]:
            whole = compliances[m] + proximities[m]
            trial[m] = (lengths[m] - limits[m] + proximities[m] * tensions[m]) / whole
            if one_sided[m]:
                trial[m] = max(trial[m], 0.0)
            value += trial[m] * (lengths[m] - limits[m]) - 0.5 * compliances[m] * trial[m] ** 2
            value -= 0.5 * proximities[m] * (trial[m] - tensions[m]) ** 2
        else:
            trial[m] = pulls[m]
            value += pulls[m] * lengths[m]
    measure_lengths(grid, rotation_vectors, trial, lengths, length_gradients, psd, full)
    for j in range(n):
        for i in range(3):
            bent = rotation_vectors[j, i] - rest[j, i]
            value += 0.5 * stiffness[j, i] * bent * bent
            gradient[j, i] += stiffness[j, i] * bent
            for m in range(k):
                gradient[j, i] += trial[m] * length_gradients[m, j, i]
            hessian[3 * j + i, 3 * j + i] += stiffness[j, i]
            for b in range(3):
                hessian[3 * j + i, 3 * j + b] += full[j, i, b]
    return value


@kernel
def make_state(n, k):
    """Empty arrays of `measure_equilibrium`."""
    return (
        np.empty(k),
        np.empty(k),
        np.empty((k, n, 3)),
        np.empty((n, 3, 3)),
        np.empty((n, 3, 3)),
        np.empty((n, 3)),
        np.empty((3 * n, 3 * n)),
    )


@kernel
def _factor_upper(matrix, shift, factor):
    """Fill the upper Cholesky factor of ``matrix + shift * 1``; False if it is not positive.

    By rows: for matrices of a hundred rows it is several times faster than by dot products.
    """
    size = matrix.shape[0]
    for i in range(size):
        for m in range(i, size):
            factor[i, m] = matrix[i, m]
        factor[i, i] += shift
    for k in range(size):
        row = factor[k]
        if not row[k] > LEAST_PIVOT * (abs(matrix[k, k]) + shift):
            return False
        scale = 1.0 / math.sqrt(row[k])
        for m in range(k, size):
            row[m] *= scale
        for i in range(k + 1, size):
            other, factor_entry = factor[i], row[i]
            if factor_entry != 0.0:
                for m in range(i, size):
                    other[m] -= factor_entry * row[m]
    return True


@kernel
def _solve_factored(factor, vector):
    """Solve ``U^T U x = vector`` in place."""
    size = vector.size
    for k in range(size):
        vector[k] /= factor[k, k]
        for m in range(k + 1, size):
            vector[m] -= factor[k, m] * vector[k]
    for k in range(size - 1, -1, -1):
        for m in range(k + 1, size):
            vector[k] -= factor[k, m] * vector[m]
        vector[k] /= factor[k, k]


@kernel
def _find_step(rod, state, scale, conservative, matrix, factor, step, shift):
    """Newton's step (3 n,) in scaled rotations; returns the Hessian's shift, -1 if none did."""
    _, _, tendons, _, _ = rod
    compliances, held, one_sided, _, proximities = tendons
    _, trial, length_gradients, _, _, gradient, hessian = state
    size = step.size
    n = size // 3
    for i in range(size):
        for m in range(size):
            matrix[i, m] = hessian[i, m] * scale[i] * scale[m]
        step[i] = -gradient[i // 3, i % 3] * scale[i]
    row = np.empty(size)
    for m in range(trial.size):
        if not held[m] or (one_sided[m] and trial[m] <= 0.0):
            continue
        for j in range(n):
            for i in range(3):
                row[3 * j + i] = length_gradients[m, j, i] * scale[3 * j + i]
        weight = 1.0 / (compliances[m] + proximities[m])
        for i in range(size):
            if row[i] != 0.0:
                for b in range(size):
                    matrix[i, b] += weight * row[i] * row[b]
    if not conservative:
        order, right = np.empty(size, dtype=np.int64), step.reshape(size, 1)
        if not factor_lu(matrix, order):
            return -1.0
        solve_lu(matrix, order, right)
        return 0.0
    used = 0.0
    for _ in range(40):
        if _factor_upper(matrix, used, factor):
            _solve_factored(factor, step)
            return used
        used = max(FIRST_SHIFT, 0.25 * shift) if used == 0.0 else 4.0 * used
    return -1.0


@kernel
def solve_equilibrium(rod, limits, tolerance, most_steps, rotation_vectors, tensions, state):
    """One equilibrium, from where ``rotation_vectors`` and ``tensions`` stand; both are changed.

    Returns a code, the steps taken, the error of the tendons' lengths [mm], and the shift of the
    last Hessian: more than 0 if it was not positive. ``state`` is as of the last rotations.
    """
    grid, _, tendons, _, loads = rod
    compliances, held, one_sided, _, proximities = tendons
    n, k = rotation_vectors.shape[0], tensions.size
    forces, moments, follows = loads
    conservative = True
    for p in range(follows.size):
        moment = moments[p, 0] != 0.0 or moments[p, 1] != 0.0 or moments[p, 2] != 0.0
        conservative = conservative and not follows[p] and not moment
    size = 3 * n
    scale, step = np.empty(size), np.empty(size)
    matrix, factor = np.empty((size, size)), np.empty((size, size))
    other, before = rotation_vectors.copy(), rotation_vectors.copy()
    for j in range(n):
        for i in range(3):
            scale[3 * j + i] = 1.0 / math.sqrt(grid[1][j, i])
    value = measure_equilibrium(rod, limits, rotation_vectors, tensions, state)
    lengths, trial, length_gradients, _, _, gradient, _ = state
    shift, last, error, missed, longest = 0.0, math.inf, 0.0, math.inf, 0.0
    for m in range(k):
        longest = max(longest, limits[m])
    for count in range(most_steps):
        shift = _find_step(rod, state, scale, conservative, matrix, factor, step, shift)
        if shift < 0.0:
            return NOT_CONVERGED, count, error, shift
        largest_step, decrease, gradient_square = 0.0, 0.0, 0.0
        for j in range(n):
            square = 0.0
            for i in range(3):
                g = gradient[j, i] * scale[3 * j + i]
                decrease += g * step[3 * j + i]
                gradient_square += g * g
                square += (step[3 * j + i] * scale[3 * j + i]) ** 2
            largest_step = max(largest_step, math.sqrt(square))
        missed, error = error if count > 0 else math.inf, 0.0
        for m in range(k):
            if held[m]:
                residual = lengths[m] - limits[m] - compliances[m] * trial[m]
                if one_sided[m] and trial[m] == 0.0:
                    residual = max(residual, 0.0)
                error = max(error, abs(residual))
        quiet = largest_step <= (STEP_TOLERANCE if shift == 0.0 else SADDLE_TOLERANCE)
        quiet = quiet or (shift == 0.0 and largest_step <= ROUGH and largest_step > 0.5 * last)
        settled = error <= SETTLED * longest or error > 0.5 * missed
        if quiet and settled and error <= tolerance:
            copy_vector(trial, tensions)
            return CONVERGED, count, error, shift
        last = largest_step
        damping = min(1.0, STEP_LIMIT / largest_step) if largest_step > 0.0 else 1.0
        copy_matrix(rotation_vectors, before)
        kept = trial.copy()
        active = np.zeros(k)
        for m in range(k):
            if held[m] and (trial[m] > 0.0 or not one_sided[m]):
                for j in range(n):
                    for i in range(3):
                        active[m] += length_gradients[m, j, i] * step[3 * j + i] * scale[3 * j + i]
                active[m] /= compliances[m] + proximities[m]
        good = False
        for _ in range(MOST_HALVINGS):
            folded = False
            for j in range(n):
                square = 0.0
                for i in range(3):
                    other[j, i] = before[j, i] + damping * step[3 * j + i] * scale[3 * j + i]
                    square += other[j, i] ** 2
                folded = folded or square > FOLD_ANGLE**2
            if not folded:
                found = measure_equilibrium(rod, limits, other, tensions, state)
                fresh = 0.0
                for j in range(n):
                    for i in range(3):
                        fresh += (gradient[j, i] * scale[3 * j + i]) ** 2
                if conservative:
                    noise = 1e-12 * (abs(value) + abs(found))
                    good = found <= value + LEAST_DECREASE * damping * decrease or (
                        found <= value + noise and fresh <= gradient_square
                    )
                else:
                    good = fresh <= (1.0 - LEAST_DECREASE * damping) * gradient_square
                good = good or largest_step <= ROUGH
            if good:
                break
            damping *= 0.5
        if not good:
            copy_matrix(before, rotation_vectors)
            measure_equilibrium(rod, limits, rotation_vectors, tensions, state)
            return FOLDED if folded else NOT_CONVERGED, count, error, shift
        copy_matrix(other, rotation_vectors)
        value = found
        if damping == 1.0 and shift == 0.0:
            # The tensions that Newton's method on the conditions themselves would take.
            moved = False
            for m in range(k):
                if proximities[m] > 0.0:
                    fresh = kept[m] + active[m]
                    if one_sided[m]:
                        fresh = max(fresh, 0.0)
                    moved = moved or fresh != tensions[m]
                    tensions[m] = fresh
            if moved:
                value = measure_equilibrium(rod, limits, rotation_vectors, tensions, state)
    copy_vector(trial, tensions)
    return NOT_CONVERGED, most_steps, error, shift
