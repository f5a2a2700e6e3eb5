"""Numba kernels of the hysteresis operators."""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_vector

# Numba kernels of the hysteresis operators: one pass over each history of a batch.
#
# ``history`` is (m, n); ``memory`` (m, k) is brought to the end of each history in place.


@kernel
def move_play(value, point, lower, upper):
    """``max(lower, min(upper, value))`` with edges that are quadratic in the input."""
    high = upper[0] + point * (upper[1] + point * upper[2])
    if value > high:
        value = high
    low = lower[0] + point * (lower[1] + point * lower[2])
    return low if value < low else value


@kernel
def run_plays(history, lower, upper, weights, slope, offset, memory):
    """Weighted sum of plays, plus ``slope`` times the input and ``offset``; edges (k, 3)."""
    rows, count = history.shape
    output = np.empty((rows, count))
    for row in range(rows):
        for i in range(count):
            point = history[row, i]
            total = offset + slope * point
            for j in range(len(weights)):
                value = move_play(memory[row, j], point, lower[j], upper[j])
                memory[row, j] = value
                total += weights[j] * value
            output[row, i] = total
    return output


@kernel
def trace_plays(history, lower, upper, memory):
    """Positions of all plays along the histories (m, n, k)."""
    rows, count = history.shape
    size = len(lower)
    output = np.empty((rows, count, size))
    for row in range(rows):
        for i in range(count):
            for j in range(size):
                value = move_play(memory[row, j], history[row, i], lower[j], upper[j])
                memory[row, j] = value
                output[row, i, j] = value
    return output


@kernel
def add_plays(point, lower, upper, weights, slope, offset, memory):
    """What the sum of plays would be at an input, without moving them."""
    total = offset + slope * point
    for j in range(len(weights)):
        total += weights[j] * move_play(memory[j], point, lower[j], upper[j])
    return total


@kernel
def invert_plays(response, lower, upper, weights, slope, offset, memory, least, most, clip):
    """Inputs in ``[least, most]`` that give these outputs, by bisection to the last bits.

    The sum must increase with the input. Outputs out of reach get the nearest end if they are to be
    clipped. Otherwise also returns the row and the sample of the first one and what can be reached
    there; a row of -1 if there is none.
    """
    rows, count = response.shape
    output = np.empty((rows, count))
    for row in range(rows):
        for i in range(count):
            target = response[row, i]
            low, high = least, most
            bottom = add_plays(low, lower, upper, weights, slope, offset, memory[row])
            top = add_plays(high, lower, upper, weights, slope, offset, memory[row])
            slack = 1e-12 * (abs(bottom) + abs(top))
            if clip and target >= top:
                low = high
            elif clip and target <= bottom:
                high = low
            elif not bottom - slack <= target <= top + slack:
                return output, row, i, bottom, top
            for _ in range(200):
                middle = 0.5 * (low + high)
                if not low < middle < high:
                    break
                if add_plays(middle, lower, upper, weights, slope, offset, memory[row]) > target:
                    high = middle
                else:
                    low = middle
            point = 0.5 * (low + high)
            output[row, i] = point
            for j in range(len(weights)):
                memory[row, j] = move_play(memory[row, j], point, lower[j], upper[j])
    return output, -1, 0, 0.0, 0.0


@kernel
def run_slips(history, stiffnesses, limits, last, memory):
    """Sum of the forces of springs in series with sliders."""
    rows, count = history.shape
    output = np.empty((rows, count))
    for row in range(rows):
        before = last[row]
        for i in range(count):
            step = history[row, i] - before
            before = history[row, i]
            total = 0.0
            for j in range(len(limits)):
                force = memory[row, j] + stiffnesses[j] * step
                force = min(max(force, -limits[j]), limits[j])
                memory[row, j] = force
                total += force
            output[row, i] = total
    return output


@kernel
def trace_slips(history, yields):
    """Stretches of springs of stiffness 1 that slip at ``yields``, from rest at 0 (m, n, k)."""
    rows, count = history.shape
    size = len(yields)
    output = np.empty((rows, count, size))
    for row in range(rows):
        for j in range(size):
            before, stretch = 0.0, 0.0
            for i in range(count):
                stretch = stretch + history[row, i] - before
                stretch = min(max(stretch, -yields[j]), yields[j])
                before = history[row, i]
                output[row, i, j] = stretch
    return output


@kernel
def switch_relays(point, before, levels, signs):
    """Switch the relays between two inputs; whether any can have changed.

    Relay ``i (i + 1) / 2 + j`` turns on at ``levels[i + 1]`` and off at ``levels[j]``, j <= i.
    """
    size = len(levels) - 1
    changed = False
    if point > before:
        for i in range(size):
            if before < levels[i + 1] <= point:
                changed = True
                for j in range(i + 1):
                    signs[i * (i + 1) // 2 + j] = 1.0
    elif point < before:
        for j in range(size):
            if point <= levels[j] < before:
                changed = True
                for i in range(j, size):
                    signs[i * (i + 1) // 2 + j] = -1.0
    return changed


@kernel
def run_relays(history, levels, weights, offset, last, memory):
    """Weighted sum of relays. It is added up anew at each switching: no error piles up."""
    rows, count = history.shape
    output = np.empty((rows, count))
    for row in range(rows):
        before = last[row]
        total = offset
        fresh = True
        for i in range(count):
            changed = switch_relays(history[row, i], before, levels, memory[row])
            before = history[row, i]
            if changed or fresh:
                total = offset
                for j in range(len(weights)):
                    total += weights[j] * memory[row, j]
                fresh = False
            output[row, i] = total
    return output


@kernel
def trace_relays(history, levels, last, memory):
    """Signs of all relays along the histories (m, n, k)."""
    rows, count = history.shape
    output = np.empty((rows, count, memory.shape[1]))
    for row in range(rows):
        before = last[row]
        for i in range(count):
            switch_relays(history[row, i], before, levels, memory[row])
            before = history[row, i]
            copy_vector(memory[row], output[row, i])
    return output


@kernel
def run_friction_band(history, first, second, last, memory):
    """``P (1 + way (first + second P))``, way +1 rising and -1 falling; ``memory`` is the way."""
    rows, count = history.shape
    output = np.empty((rows, count))
    for row in range(rows):
        before = last[row]
        for i in range(count):
            point = history[row, i]
            if point > before:
                memory[row, 0] = 1.0
            elif point < before:
                memory[row, 0] = -1.0
            before = point
            output[row, i] = point * (1.0 + memory[row, 0] * (first + second * point))
    return output


# Numba kernels of `BoucWen`: its differential equation from one input to the next.
#
# All is normalised: the state z by its bound, the input by what would yield it at the first slope.
# By symmetry a fall from z is a rise from -z.


@kernel
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


@kernel
def slope_of(state, exponent, share):
    """``dz/dx = 1 - c |z|^n``, c = 1 for z > 0 and 1 - 2 share for z < 0."""
    if state > 0.0:
        return 1.0 - state**exponent
    return 1.0 - (1.0 - 2.0 * share) * (-state) ** exponent


@kernel
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


@kernel
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
