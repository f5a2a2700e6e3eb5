"""Numba kernels of `BoucWen`: its differential equation from one input to the next.

All is normalised: the state z by its bound, the input by what would yield it at the first slope.
By symmetry a fall from z is a rise from -z.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = ["run_bouc_wen"]


@njit(cache=True)
def climb_linear(state, way, share):
    """`climb` for an exponent of 1, in closed form."""
    if state < 0.0:
        pull = 1.0 - 2.0 * share
        depth = -state
        if pull * depth >= 1.0:  # only without recovery: share 0, at the bound
            return state
        small = abs(pull) < 1e-12
        to_zero = depth if small else -math.log1p(-pull * depth) / pull
        if way < to_zero:
            grown = way if small else math.expm1(pull * way) / pull
            return -(depth + (pull * depth - 1.0) * grown)
        way -= to_zero
        state = 0.0
    return 1.0 + (state - 1.0) * math.exp(-way)


@njit(cache=True)
def slope_of(state, exponent, share):
    """``dz/dx = 1 - c |z|^n``, c = 1 for z > 0 and 1 - 2 share for z < 0."""
    if state > 0.0:
        return 1.0 - state**exponent
    return 1.0 - (1.0 - 2.0 * share) * (-state) ** exponent


@njit(cache=True)
def climb(state, way, exponent, share):
    """The normalised state after the input has risen by ``way`` yields: Dormand-Prince 5(4).

    Close to the bound it goes on in closed form: however far the input goes, few steps are taken.
    """
    if exponent == 1.0:
        return climb_linear(state, way, share)
    done, step = 0.0, min(way, 0.1)
    while done < way and step > 0.0:
        if state > 1.0 - 1e-8:  # there 1 - z falls as exp(-n way), to n (1 - z)^2
            return 1.0 - (1.0 - state) * math.exp(-exponent * (way - done))
        step = min(step, way - done)
        a = slope_of(state, exponent, share)
        b = slope_of(state + step * a / 5.0, exponent, share)
        c = slope_of(state + step * (3.0 * a + 9.0 * b) / 40.0, exponent, share)
        d = slope_of(
            state + step * (44.0 / 45.0 * a - 56.0 / 15.0 * b + 32.0 / 9.0 * c), exponent, share
        )
        e = slope_of(
            state
            + step
            * (
                19372.0 / 6561.0 * a
                - 25360.0 / 2187.0 * b
                + 64448.0 / 6561.0 * c
                - 212.0 / 729.0 * d
            ),
            exponent,
            share,
        )
        f = slope_of(
            state
            + step
            * (
                9017.0 / 3168.0 * a
                - 355.0 / 33.0 * b
                + 46732.0 / 5247.0 * c
                + 49.0 / 176.0 * d
                - 5103.0 / 18656.0 * e
            ),
            exponent,
            share,
        )
        new = state + step * (
            35.0 / 384.0 * a
            + 500.0 / 1113.0 * c
            + 125.0 / 192.0 * d
            - 2187.0 / 6784.0 * e
            + 11.0 / 84.0 * f
        )
        g = slope_of(new, exponent, share)
        wrong = step * abs(
            71.0 / 57600.0 * a
            - 71.0 / 16695.0 * c
            + 71.0 / 1920.0 * d
            - 17253.0 / 339200.0 * e
            + 22.0 / 525.0 * f
            - 1.0 / 40.0 * g
        )
        if not wrong < 1e6:  # overshot, maybe not a number
            step *= 0.1
            continue
        if wrong <= 1e-13 or step <= 1e-9:
            done += step
            state = min(new, 1.0)
            if slope_of(state, exponent, share) <= 0.0:  # at a bound that is never left
                break
        step *= min(4.0, max(0.2, 0.9 * (1e-13 / max(wrong, 1e-20)) ** 0.2))
    return state


@njit(cache=True)
def run_bouc_wen(history, exponent, share, inverse_yield, last, memory):
    """Normalised Bouc-Wen states; ``inverse_yield`` is 1 over the input that yields it."""
    rows, count = history.shape
    output = np.empty((rows, count))
    for row in range(rows):
        before, state = last[row], memory[row, 0]
        for i in range(count):
            step = (history[row, i] - before) * inverse_yield
            before = history[row, i]
            if step > 0.0:
                state = climb(state, step, exponent, share)
            elif step < 0.0:
                state = -climb(-state, -step, exponent, share)
            output[row, i] = state
        memory[row, 0] = state
    return output
