"""Numba kernels of an end-effector in time: lags, the balance of pulls, and past samples."""

from __future__ import annotations

import math

from ...numeric.compiling import kernel


@kernel
def follow(times, inputs, rise, fall, held, state, out):
    """Fill ``out`` (b, n, m) with what follows inputs (b, n, m) with first-order lags [s].

    ``rise`` and ``fall`` (m,) are the time constants on the way up and down; 0 is none. ``state``
    (b, m) is the output at the first time, and that at the last one afterwards. With ``held`` an
    input holds from its time to the next, otherwise from the time before it.
    """
    for i in range(inputs.shape[0]):
        for j in range(inputs.shape[2]):
            value = state[i, j]
            out[i, 0, j] = value
            for k in range(1, inputs.shape[1]):
                target = inputs[i, k - 1, j] if held else inputs[i, k, j]
                lag = rise[j] if target > value else fall[j]
                if lag > 0.0:
                    value = target + (value - target) * math.exp((times[k - 1] - times[k]) / lag)
                else:
                    value = target
                out[i, k, j] = value
            state[i, j] = value


@kernel
def balance_pulls(laws, cosines, sines, offset, compliance, pressures, bends):
    """Fill bends (n, 2) [rad] of a section in balance with all pulls under pressures (n, m) [MPa].

    ``laws`` (m, 5) are the numbers of each muscle's `MusclePull`; ``compliance`` is the bend per
    moment [rad/(N mm)]. A pull falls with the muscle's contraction, which the bend gives: two
    linear equations.
    """
    for i in range(pressures.shape[0]):
        xx, xy, yy, x, y = 1.0, 0.0, 1.0, 0.0, 0.0
        for j in range(pressures.shape[1]):
            p = pressures[i, j]
            moment = compliance * offset * p * (laws[j, 0] + p * (laws[j, 1] + p * laws[j, 2]))
            held = compliance * offset * offset * (laws[j, 3] + laws[j, 4] * p)
            x += moment * cosines[j]
            y += moment * sines[j]
            xx += held * cosines[j] * cosines[j]
            xy += held * cosines[j] * sines[j]
            yy += held * sines[j] * sines[j]
        whole = xx * yy - xy * xy
        bends[i, 0] = (yy * x - xy * y) / whole
        bends[i, 1] = (xx * y - xy * x) / whole


@kernel
def run_polynomial(inputs, weights, quadratic, limit, out):
    """Fill ``out`` (n, q) from its first two rows on by a polynomial of past samples.

    Its variables are the two rows before, and the two inputs (n, m) before; ``weights`` (f, q) are
    for 1, the variables, and with ``quadratic`` their products. Rows are kept within ``limit``.
    """
    size, wide = out.shape[1], inputs.shape[1]
    count = 2 * (size + wide)
    for k in range(2, out.shape[0]):
        for c in range(size):
            total = weights[0, c]
            place = 1
            for a in range(count):
                total += weights[place, c] * _take_past(inputs, out, k, a)
                place += 1
            if quadratic:
                for a in range(count):
                    first = _take_past(inputs, out, k, a)
                    for b in range(a, count):
                        total += weights[place, c] * first * _take_past(inputs, out, k, b)
                        place += 1
            out[k, c] = min(max(total, -limit), limit)


@kernel(inline="always")
def _take_past(inputs, out, k, place):
    size, wide = out.shape[1], inputs.shape[1]
    if place < 2 * size:
        return out[k - 1 - place // size, place % size]
    place -= 2 * size
    return inputs[k - 1 - place // wide, place % wide]
