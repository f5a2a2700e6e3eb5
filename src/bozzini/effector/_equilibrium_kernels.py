"""Numba kernels: one muscle on the section, at rest under a pressure.

What is solved is ``pull(P, x) = lateral(x) / c`` for the contraction ``x`` on the rising branch of
the deflection, with the section's compliance ``c``. The left side falls and the right side rises,
so that there is one root between no contraction and the end of the branch.

A muscle is a kind and a row of numbers:

- ``ENERGY``: ``design`` of `muscle._kernels` (11), then the length that contracts;
- ``BLIND``, ``BULK``: ``design`` of `muscle._thesis_kernels` (11), the pressure of contact, the
  free length, the strain per pressure before contact, the bracket of angles (2) and the stiffness
  of the load path.
"""

from __future__ import annotations

import math

from numba import njit

from ..muscle._kernels import find_force
from ..muscle._thesis_kernels import find_angle, measure_closure
from ._linkage_kernels import measure_lateral

__all__ = ["find_balance", "settle"]

OTHER, ENERGY, BLIND, BULK = -1, 0, 1, 2

BALANCED, SLACK, SATURATED, NO_ANSWER, STOPPED = 0, 1, 2, 3, 4

STEP = 1e-11
"""Newton's last step, relative to the backbone: the next one would be its square."""

MISS = 1e-10
"""What may be left over before that step, relative to the pull.

Where the linkage ends its slope is endless and a step is short far from the root.
"""

ROUND_OFF = 2.3e-16

MAX_ITERATIONS = 100


@njit(cache=True)
def _row(numbers):
    return (
        numbers[0],
        numbers[1],
        numbers[2],
        numbers[3],
        numbers[4],
        numbers[5],
        numbers[6],
        numbers[7],
        numbers[8],
        numbers[9],
        numbers[10],
    )


@njit(cache=True)
def _free_contraction(numbers, pressure):
    """Contraction without load of the thesis's model [mm], and whether there is one."""
    contact, length = numbers[11], numbers[12]
    if pressure <= contact:
        return -length * numbers[13] * pressure, True
    design = _row(numbers)
    angle, _, iterations = find_angle(design, pressure - contact, numbers[14], numbers[15])
    _, _, opened = measure_closure(design, pressure - contact, angle)
    found = iterations >= 0 and opened > 0.0
    return length - design[4] * math.cos(angle) / design[6], found


@njit(cache=True)
def find_balance(kind, numbers, linkage, compliance, peak, pressure):
    """Contraction, lateral deflection [mm], residual [N], iterations and a code."""
    if pressure == 0.0:
        return 0.0, 0.0, 0.0, 0, BALANCED
    design = _row(numbers)
    active = numbers[11]
    stiffness = numbers[16]
    free = 0.0
    high = peak
    if kind == ENERGY:
        pull, slope, _, _ = find_force(design, pressure, 1.0, 0.0)
        if pull <= 0.0:
            return 0.0, 0.0, 0.0, 1, BALANCED if pull == 0.0 else SLACK
        high = min(peak, active * (1.0 - design[9]))
        x = min(0.5 * high, pull * active / slope) if slope > 0.0 else 0.5 * high
    else:
        free, found = _free_contraction(numbers, pressure)
        if not found:
            return 0.0, 0.0, 0.0, 0, NO_ANSWER
        if free <= 0.0:
            return 0.0, 0.0, 0.0, 1, BALANCED if free == 0.0 else SLACK
        if kind == BLIND:
            code = SATURATED if free > peak else BALANCED
            x = min(free, peak)
            lateral, _, failed = measure_lateral(linkage, x)
            return x, lateral, 0.0, 1, STOPPED if failed > 0 else code
        high = min(peak, free)
        x = 0.75 * high
    low = 0.0
    high_known = False
    code = STOPPED
    iterations = 0
    step_limit = STEP * linkage[1]
    for iteration in range(1, MAX_ITERATIONS):
        iterations = iteration
        lateral, lateral_slope, failed = measure_lateral(linkage, x)
        if kind == ENERGY:
            pull, slope, _, _ = find_force(design, pressure, 1.0 - x / active, 0.0)
            slope /= -active
        else:
            pull = stiffness * (free - x)
            slope = -stiffness
        miss = pull - lateral / compliance if failed == 0 else -math.inf
        if miss == 0.0:
            code = BALANCED
            break
        if miss > 0.0:
            low = x
            if x >= high:
                code = SATURATED if high >= peak else STOPPED
                break
        else:
            high = x
            high_known = True
        small = ROUND_OFF * linkage[1] * abs(slope)
        slope -= lateral_slope / compliance
        small += MISS * abs(pull) + ROUND_OFF * x * abs(slope)
        following = x - miss / slope if slope < 0.0 else (peak if miss > 0.0 else -1.0)
        near = abs(following - x) <= step_limit and abs(miss) <= small
        if low <= following <= high and near:
            x = following
            code = BALANCED
            break
        if following >= high and not high_known:
            # Only now is it worth to look at the end: if it pulls more there, there is no root.
            following = high
        elif not low < following < high:
            following = 0.5 * (low + high)
            if not low < following < high:
                code = BALANCED
                break
        x = following
    lateral, _, failed = measure_lateral(linkage, x)
    if failed > 0:
        code = STOPPED
    if kind == ENERGY:
        pull, _, _, _ = find_force(design, pressure, 1.0 - x / active, 0.0)
    else:
        pull = stiffness * (free - x)
    return x, lateral, pull - lateral / compliance, iterations, code


@njit(cache=True)
def settle(kinds, rows, linkage, compliance, peak, pressures, out, iterations, codes):
    """Fill ``out`` (3, k, m), iterations and codes (k, m) for pressures (k, m).

    Muscles of another kind are left as they are.
    """
    for j in range(kinds.size):
        if kinds[j] == OTHER:
            continue
        for i in range(pressures.shape[0]):
            out[0, i, j], out[1, i, j], out[2, i, j], iterations[i, j], codes[i, j] = find_balance(
                kinds[j], rows[j], linkage, compliance, peak, pressures[i, j]
            )
