"""Numba kernels of tendons with friction: how they lie in a bent rod, and a Newton step of tension.

Points of a tendon are the start, middle and end of every step, ``(n, 3)``; the interval of a point
is the one that ends there, so that of a step's start is the kink between two steps. With the angle
``phi_i`` by which the tangent turns in the interval, the friction coefficient ``mu``, the tension
``T_i`` [N] and what slips ``s_i`` [mm] at a point, equations are the capstan law and Dahl's::

    T_i = T_i-1 exp(-mu phi_i sigma_i) ,   sigma_i = clip(memory_i + s_i / delta, -1, 1)

Unknowns of a Newton step are the changes ``dT_i`` and ``ds_i`` at all points and the tensions at
the base; slip follows from the lengths beyond, so ``ds_i = slopes_i dT_i + offsets_i`` is
eliminated from the tip on, and ``dT_i = factors_i dT_i-1 + shifts_i`` is put in from the base on.
`bozzini.continuum.friction` has the law of slip and the method.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_vector
from ...numeric.kernels.linear_algebra import factor_lu, solve_lu, solve_three
from .rod import expand_potential, find_curvature


@kernel(error_model="numpy")
def _rotate(rotation, vector, out):
    """Fill `out` with ``vector`` turned by the rotation vector `rotation` (Rodrigues)."""
    square = rotation[0] ** 2 + rotation[1] ** 2 + rotation[2] ** 2
    angle = math.sqrt(square)
    first = math.sin(angle) / angle if angle > 1e-8 else 1.0
    second = 2.0 * math.sin(0.5 * angle) ** 2 / square if angle > 1e-8 else 0.5
    along = rotation[0] * vector[0] + rotation[1] * vector[1] + rotation[2] * vector[2]
    cosine = math.cos(angle)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        across = rotation[j] * vector[k] - rotation[k] * vector[j]
        out[i] = cosine * vector[i] + first * across + second * along * rotation[i]


@kernel(error_model="numpy")
def measure_angle(one, other):
    """Angle between two vectors [rad]; 0 if one has no length."""
    across = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        across += (one[j] * other[k] - one[k] * other[j]) ** 2
    along = one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
    return math.atan2(math.sqrt(across), along)


@kernel(error_model="numpy")
def measure_tendons(grid, profile, moments, curvatures, rates, flexibility, wrap_angles):
    """Fill how tendons lie in a rod under tensions `profile` (n, 3, k); False if it breaks down.

    ``grid`` is that of `integrate_rod`, ``moments`` (n, 3, 3) are those over the cross-section, in
    its frame. Improves ``curvatures`` (n, 3, 3), fills the tendons' ``rates`` of length (n, 3, k),
    how these give way to tension, ``flexibility`` (n, 3, k, k), and the angles ``wrap_angles`` (n,
    3, k) through which tendons turn in the interval of each point.
    """
    places, stiffness, rest, guides, present = grid
    k = profile.shape[2]
    work, least, moment = np.empty((11, 3)), np.zeros(3), np.empty(3)
    length_gradients, curvature_by_tension = np.zeros((k, 3)), np.zeros((k, 3))
    before, mean, turned = np.zeros((k, 3)), np.zeros(3), np.zeros(3)
    tangents = np.zeros((k, 3))
    for n in range(places.size - 1):
        half = 0.5 * (places[n + 1] - places[n])
        for stage in range(3):
            here, local_tensions, u = guides[n, stage], profile[n, stage], curvatures[n, stage]
            own, matrix = stiffness[n, stage, 3:], work[0:3]
            for i in range(3):
                moment[i] = moments[n, stage, i] + own[i] * rest[n, stage, i]
            if not find_curvature(own, here, present[n], local_tensions, moment, u, work):
                return False
            expand_potential(own, here, present[n], local_tensions, moment, u, 1.0, work[3], matrix)
            if stage > 0:
                for i in range(3):
                    mean[i] = 0.5 * half * (curvatures[n, stage - 1, i] + u[i])
            else:
                mean[:] = 0.0
            for m in range(k):
                rates[n, stage, m] = 0.0
                wrap_angles[n, stage, m] = 0.0
                flexibility[n, stage, m] = 0.0
                if not present[n, m]:
                    continue
                x, y = here[m, 0], here[m, 1]
                v0 = here[m, 2] - u[2] * y
                v1 = here[m, 3] + u[2] * x
                v2 = 1.0 + u[0] * y - u[1] * x
                length_rate = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
                rates[n, stage, m] = length_rate
                if length_rate == 0.0:
                    return False
                tangents[m, 0], tangents[m, 1], tangents[m, 2] = (
                    v0 / length_rate,
                    v1 / length_rate,
                    v2 / length_rate,
                )
                _rotate(mean, tangents[m], turned)
                if n + stage > 0:
                    wrap_angles[n, stage, m] = measure_angle(before[m], turned)
                copy_vector(tangents[m], before[m])
                length_gradients[m, 0], length_gradients[m, 1] = (
                    v2 * y / length_rate,
                    -v2 * x / length_rate,
                )
                length_gradients[m, 2] = (v1 * x - v0 * y) / length_rate
                if not solve_three(matrix, length_gradients[m], least, curvature_by_tension[m]):
                    return False
                for j in range(m + 1):
                    if present[n, j]:
                        for i in range(3):
                            flexibility[n, stage, m, j] += (
                                length_gradients[j, i] * curvature_by_tension[m, i]
                            )
                        flexibility[n, stage, j, m] = flexibility[n, stage, m, j]
    return True


@kernel(error_model="numpy")
def reduce_slip(spans, friction, state, geometry, presliding, factors, shifts, slopes, offsets):
    """Eliminate a linearised tendon from the tip on: slip at a point by the tension there.

    ``state`` are tensions, slips, memory of shares and the shares now, each (n, 3, k); where these
    are within (-1, 1) the tendon is taken to stick. ``geometry`` are wrap angles and flexibility of
    `measure_tendons`. Fills, for every point i, ``dT_i = factors_i dT_(i-1) + shifts_i`` and
    ``dslip_i = slopes_i dT_i + offsets_i``, (n, 3, k, k) and (n, 3, k).
    """
    profile, slips, memory, sigmas = state
    wrap_angles, flexibility = geometry
    count, k = spans.size, friction.size
    slope, offset = np.zeros((k, k)), np.zeros(k)
    matrix, right, order = np.empty((k, k)), np.empty((k, k + 1)), np.empty(k, dtype=np.int64)
    for n in range(count - 1, -1, -1):
        for stage in range(2, -1, -1):
            # A tendon gets shorter by tension at points, half of it on either side, and slides
            # between them: slips of intervals next to each other differ by that of the point.
            width = 0.25 * spans[n] if stage > 0 else 0.0
            for i in range(k):
                offsets[n, stage, i] = offset[i]
                for j in range(k):
                    slopes[n, stage, i, j] = slope[i, j] + width * flexibility[n, stage, i, j]
            if n + stage == 0:
                break
            back, last = (n, stage - 1) if stage > 0 else (n - 1, 2)
            middle = slopes[n, stage]
            for i in range(k):
                tension = profile[back, last, i]
                bound = friction[i] * wrap_angles[n, stage, i] * (1.0 if tension >= 0.0 else -1.0)
                sigma = sigmas[n, stage, i]
                ratio = math.exp(-bound * sigma)
                by_slip, missing = 0.0, 0.0
                if abs(sigma) < 1.0:
                    by_slip = -bound * tension * ratio / presliding
                    missing = memory[n, stage, i] - sigma + slips[n, stage, i] / presliding
                for j in range(k):
                    matrix[i, j] = -by_slip * middle[i, j]
                    right[i, j] = 0.0
                matrix[i, i] += 1.0
                right[i, i] = ratio
                right[i, k] = by_slip * offset[i] + tension * ratio * (1.0 - bound * missing)
                right[i, k] -= profile[n, stage, i]
            if not factor_lu(matrix, order):
                return False
            solve_lu(matrix, order, right)
            for i in range(k):
                still = offset[i]
                for j in range(k):
                    still += middle[i, j] * right[j, k]
                    slope[i, j] = width * flexibility[back, last, i, j]
                    factors[n, stage, i, j] = right[i, j]
                    for m in range(k):
                        slope[i, j] += middle[i, m] * right[m, j]
                offset[i] = still
                shifts[n, stage, i] = right[i, k]
    return True


@kernel(error_model="numpy")
def move_tensions(friction, state, wrap_angles, sizes, answers, first):
    """Take the step of `reduce_slip` from the base tensions ``first`` (k,) on.

    Tensions and shares change. ``answers`` are its four answers, ``sizes`` the slip at which
    friction acts in full, and the part of the step that the shares take. The share of the friction
    that acts is that of the slip as it will be, and tensions follow from it exactly: so they keep
    their sign.
    """
    profile, slips, memory, sigmas = state
    factors, shifts, slopes, offsets = answers
    presliding, step_part = sizes
    count, k = wrap_angles.shape[0], friction.size
    change, moved, after = np.empty(k), np.empty(k), np.empty(k)
    before = np.empty(k)
    for n in range(count):
        for stage in range(3):
            for i in range(k):
                if n + stage == 0:
                    change[i] = first[i] - profile[0, 0, i]
                else:
                    change[i] = shifts[n, stage, i]
                    for j in range(k):
                        change[i] += factors[n, stage, i, j] * moved[j]
            for i in range(k):
                after[i] = offsets[n, stage, i]
                for j in range(k):
                    after[i] += slopes[n, stage, i, j] * change[j]
                if n + stage == 0:
                    profile[0, 0, i] = first[i]
                else:
                    shift = slips[n, stage, i] + after[i]
                    sigma = min(1.0, max(-1.0, memory[n, stage, i] + shift / presliding))
                    sigma = sigmas[n, stage, i] + step_part * (sigma - sigmas[n, stage, i])
                    sigmas[n, stage, i] = sigma
                    bound = (
                        friction[i] * wrap_angles[n, stage, i] * (1.0 if before[i] >= 0.0 else -1.0)
                    )
                    profile[n, stage, i] = before[i] * math.exp(-bound * sigma)
                before[i] = profile[n, stage, i]
            copy_vector(change, moved)
