"""Numba kernels: one muscle on the section, at rest under a pressure.

What is solved is ``pull(P, x) = lateral(x) / c`` for the contraction ``x`` on the rising branch of
the deflection, with the section's compliance ``c``. The left side falls and the right side rises,
so that there is one root between no contraction and the end of the branch.

A muscle is a row of numbers, and the addresses of its model's functions ``start``, ``pull`` and
``pressure`` (`bozzini.muscle.kernels.interface`), 0 where the model has none.
"""

from __future__ import annotations

import math

import numpy as np

from ...muscle.kernels import interface
from ...muscle.kernels.interface import call_pull, call_start
from ...numeric.compiling import kernel
from .linkage import measure_lateral

BALANCED, SLACK, SATURATED, NO_ANSWER, STOPPED = 0, 1, 2, 3, 4
"""Equilibrium; no pull; none up to the largest deflection; no answer of the model; not converged"""

STEP_TOLERANCE = 1e-11
"""Newton's last step, relative to the backbone: the next one would be its square."""

PULL_TOLERANCE = 1e-10
"""What may be left over before that step, relative to the pull.

Where the linkage ends its slope is endless and a step is short far from the root.
"""

ROUND_OFF = 2.3e-16
"""Relative round-off of a double."""

MAX_ITERATIONS = 100

_RIGID, _SLACK, _NO_ANSWER = interface.RIGID, interface.SLACK, interface.NO_ANSWER


@kernel
def find_balance(start, pull, numbers, linkage, compliance, peak, pressure, out):
    """Contraction, lateral deflection [mm], residual [N], iterations and a code.

    ``start`` and ``pull`` are addresses, ``out`` (3,) is overwritten.
    """
    if pressure == 0.0:
        return 0.0, 0.0, 0.0, 0, BALANCED
    row, results = numbers.ctypes.data, out.ctypes.data
    kind = call_start(start, row, pressure, peak, results)
    state, high, x = out[0], out[1], out[2]
    if kind == _NO_ANSWER:
        return 0.0, 0.0, 0.0, 0, NO_ANSWER
    if kind == _RIGID:
        if state <= 0.0:
            return 0.0, 0.0, 0.0, 1, BALANCED if state == 0.0 else SLACK
        x = min(state, peak)
        lateral, _, failed = measure_lateral(linkage, x)
        if failed > 0:
            return x, lateral, 0.0, 1, STOPPED
        return x, lateral, 0.0, 1, SATURATED if state > peak else BALANCED
    if kind == _SLACK or high <= 0.0:
        return 0.0, 0.0, 0.0, 1, SLACK if kind == _SLACK else BALANCED
    low = 0.0
    high_known = False
    code = STOPPED
    iterations = 0
    step_limit = STEP_TOLERANCE * linkage[1]
    for iteration in range(1, MAX_ITERATIONS):
        iterations = iteration
        lateral, lateral_slope, failed = measure_lateral(linkage, x)
        call_pull(pull, row, state, pressure, x, results)
        force, slope = out[0], out[1]
        miss = force - lateral / compliance if failed == 0 else -math.inf
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
        small += PULL_TOLERANCE * abs(force) + ROUND_OFF * x * abs(slope)
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
    call_pull(pull, row, state, pressure, x, results)
    return x, lateral, out[0] - lateral / compliance, iterations, code


@kernel
def settle(functions, rows, linkage, compliance, peak, pressures, out, iterations, codes):
    """Fill ``out`` (3, k, m), iterations and codes (k, m) for pressures (k, m).

    ``functions`` (m, 3) are the addresses, ``rows`` (m, n) the numbers; muscles whose model has no
    compiled functions are left as they are.
    """
    work = np.empty(3)
    for j in range(functions.shape[0]):
        start, pull = functions[j, 0], functions[j, 1]
        if start == 0:
            continue
        for i in range(pressures.shape[0]):
            out[0, i, j], out[1, i, j], out[2, i, j], iterations[i, j], codes[i, j] = find_balance(
                start, pull, rows[j], linkage, compliance, peak, pressures[i, j], work
            )
