"""Numba kernels of the hysteresis operators (thesis 2.2.10): one pass over each input history.

With the input ``P`` and what each element remembers, ``-`` for the sample before::

    play          H = max(lower(P), min(upper(P), H-)) ,  y = sum_j w_j H_j + slope P + offset
    Maxwell slip  F = clip(F- + k (P - P-), -limit, limit) ,  y = sum_j F_j
    relay         R = +1 from P >= on level,  -1 from P <= off level,  y = sum_j w_j R_j + offset
    friction band y = P (1 + d (kappa1 + kappa2 P)) ,  d = +1 after a rise, -1 after a fall
    Bouc-Wen      dh = alpha dP - gamma dP |h|^n - beta h |dP| |h|^(n - 1)

Edges of plays are quadratic in the input, coefficients (3,) from the constant on. The Bouc-Wen
equation is solved for ``z = h / bound``, ``bound = (alpha / (beta + gamma))^(1/n)``, over ``x = P
alpha / bound``: on a rise ``dz/dx = 1 - c |z|^n`` with c = 1 for z > 0 and ``(gamma - beta) /
(gamma + beta)`` for z < 0, and a fall from z is a rise from -z. `bozzini.muscle.hysteresis` has the
operators, docs/theory/hysteresis.md what they remember.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_vector

# Numba kernels of the hysteresis operators: one pass over each history of a batch.
#
# ``history`` is (m, n); ``memory`` (m, k) is brought to the end of each history in place.


@kernel
def move_play(position, input_, lower, upper):
    """``max(lower, min(upper, position))`` with edges that are quadratic in the input."""
    high = upper[0] + input_ * (upper[1] + input_ * upper[2])
    if position > high:
        position = high
    low = lower[0] + input_ * (lower[1] + input_ * lower[2])
    return low if position < low else position


@kernel
def run_plays(history, lower, upper, weights, slope, offset, memory):
    """Weighted sum of plays, plus ``slope`` times the input and ``offset``; edges (k, 3)."""
    rows, count = history.shape
    output = np.empty((rows, count))
    for row in range(rows):
        for i in range(count):
            input_ = history[row, i]
            total = offset + slope * input_
            for j in range(len(weights)):
                position = move_play(memory[row, j], input_, lower[j], upper[j])
                memory[row, j] = position
                total += weights[j] * position
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
                position = move_play(memory[row, j], history[row, i], lower[j], upper[j])
                memory[row, j] = position
                output[row, i, j] = position
    return output


@kernel
def add_plays(input_, lower, upper, weights, slope, offset, memory):
    """What the sum of plays would be at an input, without moving them."""
    total = offset + slope * input_
    for j in range(len(weights)):
        total += weights[j] * move_play(memory[j], input_, lower[j], upper[j])
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
            input_ = 0.5 * (low + high)
            output[row, i] = input_
            for j in range(len(weights)):
                memory[row, j] = move_play(memory[row, j], input_, lower[j], upper[j])
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
def run_friction_band(history, kappa1, kappa2, last, memory):
    """``P (1 + d (kappa1 + kappa2 P))``, d = +1 rising and -1 falling; ``memory`` is d."""
    rows, count = history.shape
    output = np.empty((rows, count))
    for row in range(rows):
        before = last[row]
        for i in range(count):
            pressure = history[row, i]
            if pressure > before:
                memory[row, 0] = 1.0
            elif pressure < before:
                memory[row, 0] = -1.0
            before = pressure
            output[row, i] = pressure * (1.0 + memory[row, 0] * (kappa1 + kappa2 * pressure))
    return output


# Numba kernels of `BoucWen`: its differential equation from one input to the next.
#
# All is normalised: the state z by its bound, the input by what would yield it at the first slope.
# ``beta_fraction`` is beta / (beta + gamma). By symmetry a fall from z is a rise from -z.


@kernel
def climb_linear(state, input_rise, beta_fraction):
    """`climb` for an exponent of 1, in closed form."""
    if state < 0.0:
        rate = 1.0 - 2.0 * beta_fraction
        depth = -state
        if rate * depth >= 1.0:  # only if beta is 0, at the bound
            return state
        small = abs(rate) < 1e-12
        to_zero = depth if small else -math.log1p(-rate * depth) / rate
        if input_rise < to_zero:
            growth = input_rise if small else math.expm1(rate * input_rise) / rate
            return -(depth + (rate * depth - 1.0) * growth)
        input_rise -= to_zero
        state = 0.0
    return 1.0 + (state - 1.0) * math.exp(-input_rise)


@kernel
def slope_of(state, exponent, beta_fraction):
    """``dz/dx = 1 - c |z|^n``, c = 1 for z > 0, 1 - 2 beta_fraction below."""
    if state > 0.0:
        return 1.0 - state**exponent
    return 1.0 - (1.0 - 2.0 * beta_fraction) * (-state) ** exponent


@kernel
def climb(state, input_rise, exponent, beta_fraction):
    """The normalised state after the input has risen by ``input_rise`` yields: Dormand-Prince 5(4).

    Close to the bound it goes on in closed form: however far the input goes, few steps are taken.
    """
    if exponent == 1.0:
        return climb_linear(state, input_rise, beta_fraction)
    done, step = 0.0, min(input_rise, 0.1)
    while done < input_rise and step > 0.0:
        if state > 1.0 - 1e-8:  # there 1 - z falls as exp(-n way), to n (1 - z)^2
            return 1.0 - (1.0 - state) * math.exp(-exponent * (input_rise - done))
        step = min(step, input_rise - done)
        a = slope_of(state, exponent, beta_fraction)
        b = slope_of(state + step * a / 5.0, exponent, beta_fraction)
        c = slope_of(state + step * (3.0 * a + 9.0 * b) / 40.0, exponent, beta_fraction)
        d = slope_of(
            state + step * (44.0 / 45.0 * a - 56.0 / 15.0 * b + 32.0 / 9.0 * c),
            exponent,
            beta_fraction,
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
            beta_fraction,
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
            beta_fraction,
        )
        new = state + step * (
            35.0 / 384.0 * a
            + 500.0 / 1113.0 * c
            + 125.0 / 192.0 * d
            - 2187.0 / 6784.0 * e
            + 11.0 / 84.0 * f
        )
        g = slope_of(new, exponent, beta_fraction)
        error = step * abs(
            71.0 / 57600.0 * a
            - 71.0 / 16695.0 * c
            + 71.0 / 1920.0 * d
            - 17253.0 / 339200.0 * e
            + 22.0 / 525.0 * f
            - 1.0 / 40.0 * g
        )
        if not error < 1e6:  # overshot, maybe not a number
            step *= 0.1
            continue
        if error <= 1e-13 or step <= 1e-9:
            done += step
            state = min(new, 1.0)
            if slope_of(state, exponent, beta_fraction) <= 0.0:  # at a bound that is never left
                break
        step *= min(4.0, max(0.2, 0.9 * (1e-13 / max(error, 1e-20)) ** 0.2))
    return state


@kernel
def run_bouc_wen(history, exponent, beta_fraction, inverse_yield, last, memory):
    """Normalised Bouc-Wen states; ``inverse_yield`` is 1 over the input that yields it."""
    rows, count = history.shape
    output = np.empty((rows, count))
    for row in range(rows):
        before, state = last[row], memory[row, 0]
        for i in range(count):
            step = (history[row, i] - before) * inverse_yield
            before = history[row, i]
            if step > 0.0:
                state = climb(state, step, exponent, beta_fraction)
            elif step < 0.0:
                state = -climb(-state, -step, exponent, beta_fraction)
            output[row, i] = state
        memory[row, 0] = state
    return output
