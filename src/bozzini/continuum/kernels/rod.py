"""Numba kernels of the Kirchhoff rod: its curvature under tendons, and one pass from the base.

Cut anywhere and look at the whole of what lies beyond, tendons and all: force ``N`` and moment
``M`` over the cut balance the loads beyond it, and the rod's own share of the moment is what the
tendons do not take. With the tangent ``t_k`` of tendon k at its place ``r_k``, all in the frame of
the cross-section::

    K u + sum_k T_k r_k x t_k(u) = R^T M ,   t_k = unit(e_z + u x r_k + r_k')
    p' = R e_z ,   R' = R [u] ,   M' = -p' x N

It is the integrated form of the equations of Rucker and Webster (2011) for a rod that neither
shears nor stretches. The first line is the gradient of ``1/2 u K u + sum T_k |t_k(u)| - m u``,
which is strictly convex where no tendon pushes: there is one ``u``. Otherwise there may be
several, and a minimum of it is taken, for at others the rod would not be stable.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ...numeric.kernels.linear_algebra import solve_three
from ...numeric.kernels.rotations import fill_quaternion_rotation, find_turn, turn_quaternion

# Numba kernels of the Kirchhoff rod's curvature under the tensions of its tendons and a moment.
#
# It is the minimum of ``1/2 u K u + sum T_k |t_k(u)| - m u`` with ``t_k = e_z + u x r_k + r_k'``,
# see below.

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
        value, round_off = expand_potential(
            stiffness, guides, present, tensions, moment, u, False, right, matrix
        )
        if not math.isfinite(value):
            return False
        if value > before + round_off and part > SMALLEST_PART:
            for i in range(3):
                u[i] -= 0.5 * part * step[i]
            part *= 0.5
            continue
        flat = not value < before - round_off
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


# Numba kernel of the rod without loads: lengths of its tendons under tensions, in closed steps.
#
# Without loads nothing goes over a cross-section but what the tendons do there, so every curvature
# is a minimum by itself. ``sum over s of min_u (1/2 u K u + sum T_k |t_k(u)|) - T . limits`` is the
# dual function of "least elastic energy at these lengths": its gradient by the tensions are the
# lengths, and its Hessian is ``- J H^-1 J^T``.


@njit(cache=True)
def measure_unloaded(grid, tensions, lengths, give):
    """Fill lengths (k,) and how they give way to tension (k, k); the dual's value, or NaN.

    ``grid`` is that of `integrate_rod`, whose rule along a step this is, for curvatures that do
    not depend on what came before.
    """
    places, stiffness, guides, present = grid
    k = tensions.size
    u, work, free = np.zeros(3), np.empty((11, 3)), np.zeros(3)
    ways, carried = np.zeros((k, 3)), np.zeros((k, 3))
    lengths[:] = 0.0
    give[:] = 0.0
    total = 0.0
    for n in range(places.size - 1):
        h = places[n + 1] - places[n]
        for stage in range(3):
            weight = (1.0, 4.0, 1.0)[stage] * h / 6.0
            here = guides[n, stage]
            if not find_curvature(stiffness[n], here, present[n], tensions, free, u, work):
                return math.nan
            matrix, least = work[0:3], work[10]
            least[:] = 0.0
            value, _ = expand_potential(
                stiffness[n], here, present[n], tensions, free, u, False, work[3], matrix
            )
            total += weight * value
            for m in range(k):
                if not present[n, m]:
                    continue
                x, y = here[m, 0], here[m, 1]
                v0 = here[m, 2] - u[2] * y
                v1 = here[m, 3] + u[2] * x
                v2 = 1.0 + u[0] * y - u[1] * x
                long = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
                lengths[m] += weight * long
                if long == 0.0:
                    return math.nan
                ways[m, 0], ways[m, 1] = v2 * y / long, -v2 * x / long
                ways[m, 2] = (v1 * x - v0 * y) / long
                if not solve_three(matrix, ways[m], least, carried[m]):
                    return math.nan
                for j in range(m + 1):
                    if present[n, j]:
                        for i in range(3):
                            give[m, j] += weight * ways[j, i] * carried[m, i]
    for m in range(k):
        for j in range(m):
            give[j, m] = give[m, j]
    return total


STEP_TURN = 1e-4
"""Step of the differences by a turn [rad]."""


@njit(cache=True)
def fill_rates(state, stiffness, guides, present, tensions, force, u, rates, work):
    """Rates of place (3), quaternion (4), moment (3) and tendon lengths (k)."""
    w, x, y, z = state[3], state[4], state[5], state[6]
    size = math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / size, x / size, y / size, z / size
    turn, along, moment = work[5:8], work[8], work[9]
    fill_quaternion_rotation(w, x, y, z, turn)
    for i in range(3):
        along[i] = turn[i, 2]
        moment[i] = turn[0, i] * state[7] + turn[1, i] * state[8] + turn[2, i] * state[9]
    found = find_curvature(stiffness, guides, present, tensions, moment, u, work)
    rates[0:3] = along
    rates[3] = 0.5 * (-x * u[0] - y * u[1] - z * u[2])
    rates[4] = 0.5 * (w * u[0] + y * u[2] - z * u[1])
    rates[5] = 0.5 * (w * u[1] + z * u[0] - x * u[2])
    rates[6] = 0.5 * (w * u[2] + x * u[1] - y * u[0])
    rates[7] = force[1] * along[2] - force[2] * along[1]
    rates[8] = force[2] * along[0] - force[0] * along[2]
    rates[9] = force[0] * along[1] - force[1] * along[0]
    for k in range(tensions.size):
        rates[10 + k] = 0.0
        if present[k]:
            v0 = guides[k, 2] - u[2] * guides[k, 1]
            v1 = guides[k, 3] + u[2] * guides[k, 0]
            v2 = 1.0 + u[0] * guides[k, 1] - u[1] * guides[k, 0]
            rates[10 + k] = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
    return found


@njit(cache=True)
def integrate_rod(first, last, grid, tensions, loads, states, bends):
    """Pass from step ``first`` up to ``last`` by the Runge-Kutta method of fourth order.

    ``grid`` is the steps' ends (n + 1,), the stiffness (n, 3) of every step, places and slopes of
    the tendons at its start, middle and end (n, 3, k, 4), and whether they run there (n, k);
    ``loads`` are the force on the tip, that per length, and by how much tensions differ from
    ``tensions`` at start, middle and end of steps, (n, 3, k) or empty. Goes on from
    ``states[first]`` and ``bends[first]``: fills ``states`` (n + 1, 10 + k), and ``bends``
    (n + 1, 3) with the integral of ``u``. False where it breaks down.
    """
    places, stiffness, guides, present = grid
    tip_force, line_force, changes = loads
    count = states.shape[1]
    pulls = tensions.copy()
    u, work = np.zeros(3), np.empty((11, 3))
    rates, trial, force = np.empty((4, count)), np.empty(count), np.empty(3)
    length = places[-1]
    for n in range(first, last):
        h = places[n + 1] - places[n]
        for i in range(3):
            bends[n + 1, i] = bends[n, i]
        for stage in range(4):
            part = (0.0, 0.5, 0.5, 1.0)[stage]
            weight = (1.0, 2.0, 2.0, 1.0)[stage] * h / 6.0
            for i in range(count):
                trial[i] = states[n, i]
                if stage > 0:
                    trial[i] += part * h * rates[stage - 1, i]
            for i in range(3):
                force[i] = tip_force[i] + line_force[i] * (length - places[n] - part * h)
            row = (0, 1, 1, 2)[stage]
            if changes.size > 0:
                for k in range(tensions.size):
                    pulls[k] = tensions[k] + changes[n, row, k]
            if not fill_rates(
                trial,
                stiffness[n],
                guides[n, row],
                present[n],
                pulls,
                force,
                u,
                rates[stage],
                work,
            ):
                return False
            for i in range(3):
                bends[n + 1, i] += weight * u[i]
        for i in range(count):
            states[n + 1, i] = states[n, i] + h / 6.0 * (
                rates[0, i] + 2.0 * rates[1, i] + 2.0 * rates[2, i] + rates[3, i]
            )
        size = 0.0
        for i in range(3, 7):
            size += states[n + 1, i] ** 2
        for i in range(3, 7):
            states[n + 1, i] /= math.sqrt(size)
        for i in range(count):
            if not math.isfinite(states[n + 1, i]):
                return False
    return True


@njit(cache=True)
def differentiate_piece(
    first,
    last,
    grid,
    tensions,
    loads,
    states,
    bends,
    target,
    step_moment,
    step_tension,
    values,
    slopes,
):
    """A piece's end from ``states[first]`` on, and how it depends on start and tensions.

    Fills ``values`` (6 + k,) with the turn from the quaternion ``target`` (4,) to the end, the
    end's moment and the lengths; ``slopes`` (6 + k, 6 + k) are central differences by the turn
    and the moment of the start, and by the tensions. False where it breaks down.
    """
    k = tensions.size
    start = states[first].copy()
    pulls, move, plus, minus = tensions.copy(), np.zeros(3), np.empty(6 + k), np.empty(6 + k)
    for column in range(6 + k):
        if column < 3:
            step = STEP_TURN
        elif column < 6:
            step = step_moment
        else:
            step = step_tension
        for side in range(2):
            change = step if side == 0 else -step
            states[first] = start
            if column < 3:
                move[:] = 0.0
                move[column] = change
                turn_quaternion(start[3:7], move, states[first, 3:7])
            elif column < 6:
                states[first, 4 + column] += change
            else:
                pulls[column - 6] = tensions[column - 6] + change
            good = integrate_rod(first, last, grid, pulls, loads, states, bends)
            if column >= 6:
                pulls[column - 6] = tensions[column - 6]
            if not good:
                states[first] = start
                return False
            out = plus if side == 0 else minus
            find_turn(target, states[last, 3:7], out[0:3])
            out[3:] = states[last, 7:]
        for i in range(6 + k):
            slopes[i, column] = (plus[i] - minus[i]) / (2.0 * step)
    states[first] = start
    good = integrate_rod(first, last, grid, tensions, loads, states, bends)
    find_turn(target, states[last, 3:7], values[0:3])
    values[3:] = states[last, 7:]
    return good
