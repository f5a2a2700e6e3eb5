"""Numba kernels of tendons with friction: how they lie in a bent rod, and a Newton step of tension.

Points of a tendon are the start, middle and end of every step, ``(n, 3)``; the interval of a point
is the one that ends there, so that of a step's start is the kink between two steps.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_vector
from ...numeric.kernels.linear_algebra import factor_lu, solve_lu, solve_three
from .rod import expand_potential, find_curvature


@kernel(error_model="numpy")
def _turn_back(turn, way, out):
    """Fill `out` with ``way`` turned by the rotation vector `turn` (Rodrigues)."""
    square = turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2
    angle = math.sqrt(square)
    first = math.sin(angle) / angle if angle > 1e-8 else 1.0
    second = 2.0 * math.sin(0.5 * angle) ** 2 / square if angle > 1e-8 else 0.5
    along = turn[0] * way[0] + turn[1] * way[1] + turn[2] * way[2]
    cosine = math.cos(angle)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        across = turn[j] * way[k] - turn[k] * way[j]
        out[i] = cosine * way[i] + first * across + second * along * turn[i]


@kernel(error_model="numpy")
def _measure_angle(one, other):
    """Angle between two vectors [rad]; 0 if one has no length."""
    across = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        across += (one[j] * other[k] - one[k] * other[j]) ** 2
    along = one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
    return math.atan2(math.sqrt(across), along)


@kernel(error_model="numpy")
def measure_tendons(grid, profile, moments, curvatures, rates, give, wraps):
    """Fill how tendons lie in a rod under tensions `profile` (n, 3, k); False if it breaks down.

    ``grid`` is that of `integrate_rod`, ``moments`` (n, 3, 3) are those over the cross-section, in
    its frame. Improves ``curvatures`` (n, 3, 3), fills the tendons' ``rates`` of length (n, 3, k),
    how these give way to tension, ``give`` (n, 3, k, k), and the angles ``wraps`` (n, 3, k) through
    which tendons turn in the interval of each point.
    """
    places, stiffness, rest, guides, present = grid
    k = profile.shape[2]
    work, least, moment = np.empty((11, 3)), np.zeros(3), np.empty(3)
    ways, carried = np.zeros((k, 3)), np.zeros((k, 3))
    before, mean, turned = np.zeros((k, 3)), np.zeros(3), np.zeros(3)
    tangents = np.zeros((k, 3))
    for n in range(places.size - 1):
        half = 0.5 * (places[n + 1] - places[n])
        for stage in range(3):
            here, pulls, u = guides[n, stage], profile[n, stage], curvatures[n, stage]
            own, matrix = stiffness[n, stage, 3:], work[0:3]
            for i in range(3):
                moment[i] = moments[n, stage, i] + own[i] * rest[n, stage, i]
            if not find_curvature(own, here, present[n], pulls, moment, u, work):
                return False
            expand_potential(own, here, present[n], pulls, moment, u, 1.0, work[3], matrix)
            if stage > 0:
                for i in range(3):
                    mean[i] = 0.5 * half * (curvatures[n, stage - 1, i] + u[i])
            else:
                mean[:] = 0.0
            for m in range(k):
                rates[n, stage, m] = 0.0
                wraps[n, stage, m] = 0.0
                give[n, stage, m] = 0.0
                if not present[n, m]:
                    continue
                x, y = here[m, 0], here[m, 1]
                v0 = here[m, 2] - u[2] * y
                v1 = here[m, 3] + u[2] * x
                v2 = 1.0 + u[0] * y - u[1] * x
                long = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
                rates[n, stage, m] = long
                if long == 0.0:
                    return False
                tangents[m, 0], tangents[m, 1], tangents[m, 2] = v0 / long, v1 / long, v2 / long
                _turn_back(mean, tangents[m], turned)
                if n + stage > 0:
                    wraps[n, stage, m] = _measure_angle(before[m], turned)
                copy_vector(tangents[m], before[m])
                ways[m, 0], ways[m, 1] = v2 * y / long, -v2 * x / long
                ways[m, 2] = (v1 * x - v0 * y) / long
                if not solve_three(matrix, ways[m], least, carried[m]):
                    return False
                for j in range(m + 1):
                    if present[n, j]:
                        for i in range(3):
                            give[n, stage, m, j] += ways[j, i] * carried[m, i]
                        give[n, stage, j, m] = give[n, stage, m, j]
    return True


@kernel(error_model="numpy")
def reduce_slip(spans, friction, state, lying, presliding, factors, shifts, slopes, offsets):
    """Eliminate a linearised tendon from the tip on: slip at a point by the tension there.

    ``state`` are tensions, slips, memory of shares and the shares now, each (n, 3, k); where these
    are within (-1, 1) the tendon is taken to stick. ``lying`` are wraps and give of
    `measure_tendons`. Fills, for every point i, ``dT_i = factors_i dT_(i-1) + shifts_i`` and
    ``dslip_i = slopes_i dT_i + offsets_i``, (n, 3, k, k) and (n, 3, k).
    """
    profile, slips, memory, shares = state
    wraps, give = lying
    count, k = spans.size, friction.size
    slope, offset = np.zeros((k, k)), np.zeros(k)
    matrix, right, order = np.empty((k, k)), np.empty((k, k + 1)), np.empty(k, dtype=np.int64)
    for n in range(count - 1, -1, -1):
        for stage in range(2, -1, -1):
            # A tendon gives way at points, half of it on either side, and slides between them: the
            # slip of intervals next to each other differs by what the point between gives way.
            width = 0.25 * spans[n] if stage > 0 else 0.0
            for i in range(k):
                offsets[n, stage, i] = offset[i]
                for j in range(k):
                    slopes[n, stage, i, j] = slope[i, j] + width * give[n, stage, i, j]
            if n + stage == 0:
                break
            back, last = (n, stage - 1) if stage > 0 else (n - 1, 2)
            middle = slopes[n, stage]
            for i in range(k):
                pull = profile[back, last, i]
                bound = friction[i] * wraps[n, stage, i] * (1.0 if pull >= 0.0 else -1.0)
                share = shares[n, stage, i]
                kept = math.exp(-bound * share)
                turn, missing = 0.0, 0.0
                if abs(share) < 1.0:
                    turn = -bound * pull * kept / presliding
                    missing = memory[n, stage, i] - share + slips[n, stage, i] / presliding
                for j in range(k):
                    matrix[i, j] = -turn * middle[i, j]
                    right[i, j] = 0.0
                matrix[i, i] += 1.0
                right[i, i] = kept
                right[i, k] = turn * offset[i] + pull * kept * (1.0 - bound * missing)
                right[i, k] -= profile[n, stage, i]
            if not factor_lu(matrix, order):
                return False
            solve_lu(matrix, order, right)
            for i in range(k):
                still = offset[i]
                for j in range(k):
                    still += middle[i, j] * right[j, k]
                    slope[i, j] = width * give[back, last, i, j]
                    factors[n, stage, i, j] = right[i, j]
                    for m in range(k):
                        slope[i, j] += middle[i, m] * right[m, j]
                offset[i] = still
                shifts[n, stage, i] = right[i, k]
    return True


@kernel(error_model="numpy")
def move_tensions(friction, state, wraps, sizes, parts, first):
    """Take the step of `reduce_slip` from the base tensions ``first`` (k,) on.

    Tensions and shares change. ``parts`` are its four answers, ``sizes`` the slip at which friction
    acts in full, and the part of the step that the shares take. The share of the friction that acts
    is that of the slip as it will be, and tensions follow from it exactly: so they keep their sign.
    """
    profile, slips, memory, shares = state
    factors, shifts, slopes, offsets = parts
    presliding, part = sizes
    count, k = wraps.shape[0], friction.size
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
                    share = min(1.0, max(-1.0, memory[n, stage, i] + shift / presliding))
                    share = shares[n, stage, i] + part * (share - shares[n, stage, i])
                    shares[n, stage, i] = share
                    bound = friction[i] * wraps[n, stage, i] * (1.0 if before[i] >= 0.0 else -1.0)
                    profile[n, stage, i] = before[i] * math.exp(-bound * share)
                before[i] = profile[n, stage, i]
            copy_vector(change, moved)
