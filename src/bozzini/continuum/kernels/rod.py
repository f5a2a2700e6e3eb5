"""Numba kernels of the rod: its strains under tendons, and one pass from the base.

Cut anywhere and look at the whole of what lies beyond, tendons and all: force ``N`` and moment
``M`` over the cut balance the loads beyond it, and the rod's own share of the moment is what the
tendons do not take. With the tangent ``t_k`` of tendon k at its place ``r_k``, all in the frame of
the cross-section::

    K u + sum_k T_k r_k x t_k(u) = R^T M ,   t_k = unit(e_z + u x r_k + r_k')
    p' = R e_z ,   R' = R [u] ,   M' = -p' x N

It is the integrated form of the equations of Rucker and Webster (2011). A rod that shears and
stretches has ``p' = R (e_z + e)`` with ``K e + sum_k T_k t_k = R^T N`` beside it, and ``e`` in the
tendons' tangents. Both laws are the gradient of ``1/2 e K e + 1/2 u K u + sum T_k |t_k| - n e - m
u``, which is strictly convex where no tendon pushes: there is one solution. Otherwise there may be
several, and a minimum of it is taken, for at others the rod would not be stable. A curvature that
the rod has by nature adds ``K`` times it to the moment.

Derivatives are carried along as solutions of the linearised equations. A small change of the rod
is a rotation ``f`` of its cross-sections, and changes of force and moment; with the flexibility
``C`` of a cross-section, strains change by ``C (dN + N x f, dM + M x f)``, all in base axes.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.linear_algebra import (
    factor_cholesky,
    invert_three,
    solve_lower,
    solve_three,
    solve_upper,
)
from ...numeric.kernels.rotations import fill_quaternion_rotation

# The strains of a cross-section under tensions, force and moment.

FOUND = 1e-15
"""Curvature [1/mm] that is round-off."""

MOST_STEPS = 840
"""Newton steps for a curvature; it takes a few. Between two multiples of `PATIENCE`."""

PATIENCE = 50
"""Steps after which one may go up."""

OWN, OTHER = 5.0 / 12.0, 1.0 / 12.0
"""Shares of a step's ends in the square of the turns, by themselves and by each other."""

SMALLEST_PART = 1e-6
"""Smallest part of a Newton step."""

THIN = 1e-6
"""Part of the rod's stiffness that must be left of it where tendons push."""

SETTLED = 3e-7
"""Newton step, against the curvature, after which there is only round-off."""

ROUGH = 1e-7
"""Error of a curvature that is taken for round-off, where a stiff part pulls at a flexible one."""


@kernel(error_model="numpy")
def expand_potential(stiffness, guides, present, tensions, moment, u, pushing, right, matrix):
    """Expand ``1/2 u K u + sum T_k |t_k(u)| - m u`` about ``u``; its value and its round-off.

    ``right`` (3,) gets minus the gradient, the lower half of ``matrix`` (3, 3) the Hessian; of
    tendons that push the share ``pushing``, for without them it is always positive.
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
        share = (pull if pull > 0.0 else pushing * pull) / long
        matrix[0, 0] += share * (y * y - m0 * m0)
        matrix[1, 1] += share * (x * x - m1 * m1)
        matrix[2, 2] += share * (x * x + y * y - m2 * m2)
        matrix[1, 0] += share * (-x * y - m0 * m1)
        matrix[2, 0] -= share * m0 * m2
        matrix[2, 1] -= share * m1 * m2
    return value, 1e-15 * size


@kernel(error_model="numpy")
def measure_way(guides, strain):
    """Rate of a tendon's place along the rod in the cross-section's axes, and its length."""
    wide = strain.size - 3
    x, y = guides[0], guides[1]
    t0 = guides[2] - strain[wide + 2] * y
    t1 = guides[3] + strain[wide + 2] * x
    t2 = 1.0 + strain[wide] * y - strain[wide + 1] * x
    if wide:
        t0 += strain[0]
        t1 += strain[1]
        t2 += strain[2]
    return t0, t1, t2, math.sqrt(t0 * t0 + t1 * t1 + t2 * t2)


@kernel(error_model="numpy")
def expand_strain(stiffness, guides, present, tensions, load, strain, pushing, right, matrix):
    """As `expand_potential`, of shear and stretch too: strains and loads are (6,)."""
    value, size = 0.0, 0.0
    for i in range(6):
        right[i] = load[i] - stiffness[i] * strain[i]
        value += (0.5 * stiffness[i] * strain[i] - load[i]) * strain[i]
        size += (0.5 * stiffness[i] * abs(strain[i]) + abs(load[i])) * abs(strain[i])
        for n in range(6):
            matrix[i, n] = 0.0
        matrix[i, i] = stiffness[i]
    for k in range(tensions.size):
        if not present[k] or tensions[k] == 0.0:
            continue
        t0, t1, t2, long = measure_way(guides[k], strain)
        if long == 0.0:
            continue
        x, y, pull = guides[k, 0], guides[k, 1], tensions[k]
        t0, t1, t2 = t0 / long, t1 / long, t2 / long
        way = (t0, t1, t2, t2 * y, -t2 * x, t1 * x - t0 * y)
        value += pull * long
        size += abs(pull) * long
        for i in range(6):
            right[i] -= pull * way[i]
        share = (pull if pull > 0.0 else pushing * pull) / long
        for i in range(6):
            for n in range(i + 1):
                matrix[i, n] -= share * way[i] * way[n]
        for i in range(3):
            matrix[i, i] += share
        # The moments' rows by the forces' columns: the cross product with the place.
        matrix[3, 2] += share * y
        matrix[4, 2] -= share * x
        matrix[5, 0] -= share * y
        matrix[5, 1] += share * x
        matrix[3, 3] += share * y * y
        matrix[4, 3] -= share * x * y
        matrix[4, 4] += share * x * x
        matrix[5, 5] += share * (x * x + y * y)
    return value, 1e-15 * size


@kernel(error_model="numpy")
def expand(stiffness, guides, present, tensions, load, strain, pushing, right, matrix):
    """Expand the potential by the curvature (3,), or by shear, stretch and curvature (6,)."""
    args = (stiffness, guides, present, tensions, load, strain, pushing, right, matrix)
    return expand_potential(*args) if strain.size == 3 else expand_strain(*args)


@kernel(error_model="numpy")
def _solve(matrix, right, least, step):
    size = right.size
    if size == 3:
        return solve_three(matrix, right, least, step)
    # ``least`` may be nothing: then what is positive will do.
    if not factor_cholesky(matrix, size, 0.0, THIN if least[0] > 0.0 else 0.0, matrix):
        return False
    for i in range(size):
        step[i] = right[i]
    solve_lower(matrix, step, size)
    solve_upper(matrix, step, size)
    return True


@kernel(error_model="numpy")
def find_curvature(stiffness, guides, present, tensions, load, strain, work):
    """Improve ``strain`` until it is a minimum, where the rod's load balances; False if not.

    It is the curvature (3,) under a moment, or shear, stretch and curvature (6,) under force and
    moment, all in this frame. ``guides`` (k, 4) are the tendons' places and slopes here. Every
    step of Newton's method is cut until it goes down; but some are not, for without rods that push
    steps may go to and fro across a valley. ``work`` is (11, 3) or (11, 6).
    """
    size = strain.size
    matrix, right, step, least = work[0:size], work[size], work[size + 1], work[10]
    before, last, part, flat, exact = math.inf, math.inf, 1.0, False, True
    for count in range(MOST_STEPS):
        if count % PATIENCE == PATIENCE - 1:
            before = math.inf
        pushing = 1.0 if exact else 0.0
        value, round_off = expand(
            stiffness, guides, present, tensions, load, strain, pushing, right, matrix
        )
        if not math.isfinite(value):
            return False
        if exact:
            if value > before + round_off and part > SMALLEST_PART:
                for i in range(size):
                    strain[i] -= 0.5 * part * step[i]
                part *= 0.5
                continue
            flat = not value < before - round_off
            before = value
        for i in range(size):
            least[i] = THIN * stiffness[i] if exact else 0.0
        if not _solve(matrix, right, least, step):
            # Once more without those that push.
            if not exact:
                return False
            exact = False
            continue
        moved, whole = 0.0, 0.0
        for i in range(size):
            moved, whole = max(moved, abs(step[i])), max(whole, abs(strain[i]))
        # Where it does not go down any more, and steps do not get smaller, there is round-off.
        if flat and not moved < 0.5 * last:
            return moved <= ROUGH * whole + FOUND
        part, last, whole = 1.0, moved, 0.0
        for i in range(size):
            strain[i] += step[i]
            whole = max(whole, abs(strain[i]))
        # Digits double from one step to the next.
        if moved <= (SETTLED if exact else 1e-14) * whole + FOUND:
            return True
        exact = True
    return False


# Numba kernel of the rod without loads: lengths of its tendons under tensions, in closed steps.
#
# Without loads nothing goes over a cross-section but what the tendons do there, so every curvature
# is a minimum by itself. ``sum over s of min_u (1/2 u K u + sum T_k |t_k(u)|) - T . limits`` is the
# dual function of "least elastic energy at these lengths": its gradient by the tensions are the
# lengths, and its Hessian is ``- J H^-1 J^T``.


@kernel(error_model="numpy")
def measure_unloaded(grid, tensions, lengths, give):
    """Fill lengths (k,) and how they give way to tension (k, k); the dual's value, or NaN.

    ``grid`` is that of `integrate_rod`, whose rule along a step this is, for curvatures that do
    not depend on what came before.
    """
    places, stiffness, rest, guides, present = grid
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
            here, own = guides[n, stage], stiffness[n, stage, 3:]
            for i in range(3):
                free[i] = own[i] * rest[n, stage, i]
            if not find_curvature(own, here, present[n], tensions, free, u, work):
                return math.nan
            matrix, least = work[0:3], work[10]
            least[:] = 0.0
            value, _ = expand_potential(
                own, here, present[n], tensions, free, u, 1.0, work[3], matrix
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


# One pass along a rod, with derivatives if asked for.

PLACE, TURN, FORCE, MOMENT, BEND, LENGTHS = 0, 3, 7, 10, 13, 16
"""Columns of a state: place, quaternion, force, moment, integral of curvature, tendon lengths."""

BY_LENGTHS = 9
"""Row of derivatives of tendon lengths; before it turn, moment and force, after it the place."""


@kernel(error_model="numpy")
def fill_rates(state, section, line, pulls, strain, frame, rates, work):
    """Rates (16 + k,) of a state; fills the rotation ``frame`` (3, 3) and improves ``strain``.

    ``section`` is stiffness (6,), natural curvature (3,), guides (k, 4) and where tendons run
    (k,); ``line`` (2, 3) are forces per length in the base's and in the body's axes.
    """
    stiffness, rest, guides, present = section
    size = 0.0
    for i in range(TURN, FORCE):
        size += state[i] * state[i]
    size = 1.0 / math.sqrt(size)
    w, x, y, z = size * state[3], size * state[4], size * state[5], size * state[6]
    fill_quaternion_rotation(w, x, y, z, frame)
    wide = strain.size - 3
    load = work[11]
    for i in range(3):
        load[wide + i] = stiffness[3 + i] * rest[i]
        for j in range(3):
            load[wide + i] += frame[j, i] * state[MOMENT + j]
    v0, v1, v2 = 0.0, 0.0, 1.0
    if wide:
        for i in range(3):
            load[i] = 0.0
            for j in range(3):
                load[i] += frame[j, i] * state[FORCE + j]
    if not find_curvature(stiffness[3 - wide :], guides, present, pulls, load, strain, work):
        return False
    if wide:
        v0, v1, v2 = strain[0], strain[1], 1.0 + strain[2]
    u0, u1, u2 = strain[wide], strain[wide + 1], strain[wide + 2]
    for i in range(3):
        rates[i] = frame[i, 0] * v0 + frame[i, 1] * v1 + frame[i, 2] * v2
        rates[FORCE + i] = -line[0, i]
        for j in range(3):
            rates[FORCE + i] -= frame[i, j] * line[1, j]
        rates[BEND + i] = strain[wide + i]
    rates[3] = 0.5 * (-x * u0 - y * u1 - z * u2)
    rates[4] = 0.5 * (w * u0 + y * u2 - z * u1)
    rates[5] = 0.5 * (w * u1 + z * u0 - x * u2)
    rates[6] = 0.5 * (w * u2 + x * u1 - y * u0)
    rates[10] = state[8] * rates[2] - state[9] * rates[1]
    rates[11] = state[9] * rates[0] - state[7] * rates[2]
    rates[12] = state[7] * rates[1] - state[8] * rates[0]
    for k in range(pulls.size):
        rates[LENGTHS + k] = measure_way(guides[k], strain)[3] if present[k] else 0.0
    return True


@kernel(error_model="numpy")
def fill_cross(x, y, z, scale, out):
    """Fill ``out`` (3, 3) with the matrix of a cross product."""
    out[0, 0], out[0, 1], out[0, 2] = 0.0, -scale * z, scale * y
    out[1, 0], out[1, 1], out[1, 2] = scale * z, 0.0, -scale * x
    out[2, 0], out[2, 1], out[2, 2] = -scale * y, scale * x, 0.0


@kernel(error_model="numpy")
def fill_flexibility(section, pulls, strain, frame, give, ways, work):
    """Fill how strains give way (6, 6), and the tendons' ways (k, 6), in base axes.

    Both have force and shear first; False where the cross-section is not stable.
    """
    stiffness, rest, guides, present = section
    size = strain.size
    wide = size - 3
    matrix, column = work[0:size], work[size]
    own, load = stiffness[3 - wide :], work[11]
    expand(own, guides, present, pulls, load, strain, 1.0, column, matrix)
    if not factor_cholesky(matrix, size, 0.0, 0.0, matrix):
        return False
    give[:] = 0.0
    for j in range(size):
        # A base axis in the body, what gives way to it, and that in base axes.
        part = 3 * (j // 3)
        column[:] = 0.0
        for i in range(3):
            column[part + i] = frame[j - part, i]
        solve_lower(matrix, column, size)
        solve_upper(matrix, column, size)
        for i in range(size):
            first = 3 * (i // 3)
            total = 0.0
            for m in range(3):
                total += frame[i - first, m] * column[first + m]
            give[3 - wide + i, 3 - wide + j] = total
    for k in range(pulls.size):
        ways[k] = 0.0
        if not present[k]:
            continue
        t0, t1, t2, long = measure_way(guides[k], strain)
        if long == 0.0:
            return False
        t0, t1, t2 = t0 / long, t1 / long, t2 / long
        x, y = guides[k, 0], guides[k, 1]
        m0, m1, m2 = t2 * y, -t2 * x, t1 * x - t0 * y
        for i in range(3):
            ways[k, i] = frame[i, 0] * t0 + frame[i, 1] * t1 + frame[i, 2] * t2
            ways[k, 3 + i] = frame[i, 0] * m0 + frame[i, 1] * m1 + frame[i, 2] * m2
    return True


@kernel(error_model="numpy")
def fill_flow(state, rates, frame, line, give, ways, others, free, flow, work):
    """Fill rates of derivatives: ``flow`` (12 + k, 9 + k + m) by turn, moment, force and sources.

    Sources are the tensions, and ``others`` (m, 6): forces and moments that strains take up.
    """
    first, count = (0 if give[0, 0] > 0.0 else 3), len(ways)
    at = BY_LENGTHS + count
    cross, strains = work[0:3], work[3:9]
    columns = flow.shape[1]
    strains[:] = 0.0
    fill_cross(state[7], state[8], state[9], 1.0, cross)
    for c in range(columns):
        if free == 6 and c >= 6 and c < 9:
            continue
        for i in range(first, 6):
            total = 0.0
            if c < 3:
                if first == 0:
                    for j in range(3):
                        total += give[i, j] * cross[j, c]
                # The cross product with the moment, column by column.
                a, b = (c + 1) % 3, (c + 2) % 3
                total += give[i, 3 + a] * state[10 + b] - give[i, 3 + b] * state[10 + a]
            elif c < 6:
                total = give[i, c]
            elif c < 9:
                total = give[i, c - 6]
            elif c < 9 + count:
                for j in range(first, 6):
                    total -= give[i, j] * ways[c - 9, j]
            else:
                for j in range(first, 6):
                    total -= give[i, j] * others[c - 9 - count, j]
            strains[i, c] = total
    for c in range(columns):
        for i in range(3):
            flow[i, c] = strains[3 + i, c]
            flow[at + i, c] = strains[i, c]
            flow[6 + i, c] = 0.0
        for k in range(count):
            total = 0.0
            for i in range(first, 6):
                total += ways[k, i] * strains[i, c]
            flow[BY_LENGTHS + k, c] = total
    # By a turn the tangent and forces of the body turn too.
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        flow[at + a, c] -= rates[b]
        flow[at + b, c] += rates[a]
        for j in range(3):
            flow[6 + a, c] += frame[b, j] * line[1, j]
            flow[6 + b, c] -= frame[a, j] * line[1, j]
    for c in range(columns):
        p0, p1, p2 = flow[at, c], flow[at + 1, c], flow[at + 2, c]
        flow[3, c] = state[8] * p2 - state[9] * p1
        flow[4, c] = state[9] * p0 - state[7] * p2
        flow[5, c] = state[7] * p1 - state[8] * p0
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        flow[3 + a, 6 + c] -= rates[b]
        flow[3 + b, 6 + c] += rates[a]


@kernel(error_model="numpy")
def carry(flow, slopes, free, out):
    """Fill rates ``out`` of derivatives by the ``free`` first unknowns, and by sources."""
    rows, columns = slopes.shape
    for r in range(rows):
        if free == 6 and r >= 6 and r < 9:
            continue
        for c in range(columns):
            out[r, c] = flow[r, 9 + c - free] if c >= free else 0.0
        for j in range(free):
            part = flow[r, j]
            if part != 0.0:
                for c in range(columns):
                    out[r, c] += part * slopes[j, c]


@kernel(error_model="numpy")
def integrate_rod(first, last, rod, share, tensions, states, slopes, sections, form):
    """Pass from step ``first`` up to ``last`` by the Runge-Kutta method of fourth order.

    ``rod`` is the grid, the loads, and whether it shears and stretches. The grid is the steps'
    ends (n + 1,), and at start, middle and end of each step the stiffness against shear, stretch,
    bend and twist (n, 3, 6), the natural curvature (n, 3, 3), places and slopes of tendons
    (n, 3, k, 4), and whether they run there (n, k). Loads are forces per length (n, 3, 2, 3) in
    axes of base and body, what is put on at the steps' ends (n + 1, 4, 3), force and moment in
    base axes and in the body's, and by how much tensions differ from ``tensions``, (n, 3, k) or
    empty. A ``share`` of the loads is taken. Loads of the world may follow, (n, 3, 3, 3) and
    (n + 1, 6, 3): those among the ones in base axes that do not turn with the base.

    Goes on from ``states[first]`` and fills ``states`` (n + 1, 16 + k), each beyond the load there.
    If not empty, ``slopes`` (9 + k or 12 + k, d + k + 2 m) are carried along: derivatives by d = 6
    or 9 unknowns, turn, moment and force, by the tensions, and by relative changes of EI and GJ of
    each of m ``sections``, which are those of the steps (n,) and their count. 2 k + 3 columns more
    are by the routing (`fill_routing`) and by a turn of the base as it changes loads of the world.
    `form` is filled with what `fill_form` has of the steps, if not empty. False where it breaks
    down.
    """
    grid, loads, shears = rod
    places, stiffness, rest, guides, present = grid
    lines, points, changes = loads
    count, k = states.shape[1], tensions.size
    pulls, line = tensions.copy(), np.empty((2, 3))
    strain = np.zeros(6 if shears else 3)
    past, trend, before = np.zeros((2, strain.size)), np.zeros((2, strain.size)), 0.0
    work, frame = np.zeros((12, strain.size)), np.empty((3, 3))
    rates, trial = np.empty((4, count)), np.empty(count)
    known = slopes.size > 0
    rows, columns = slopes.shape
    owners, parts = sections
    free = min(columns - k - 2 * parts, 9)
    give, ways = np.zeros((6, 6)), np.zeros((k, 6))
    others, longer = np.zeros((max(columns - free - k, 0), 6)), np.zeros(2 * k)
    routed = len(others) > 2 * parts
    flow, room = np.zeros((12 + k, 9 + k + len(others))), np.zeros((9, 9 + k + len(others)))
    moves, moved = np.zeros((4, rows, columns)), np.zeros((rows, columns))
    for n in range(first, last):
        h = places[n + 1] - places[n]
        for stage in range(4):
            part = (0.0, 0.5, 0.5, 1.0)[stage] * h
            row = (0, 1, 1, 2)[stage]
            for i in range(count):
                trial[i] = states[n, i]
                if stage > 0:
                    trial[i] += part * rates[stage - 1, i]
            for i in range(3):
                line[0, i] = share * lines[n, row, 0, i]
                line[1, i] = share * lines[n, row, 1, i]
            if changes.size > 0:
                for m in range(k):
                    pulls[m] = tensions[m] + changes[n, row, m]
            # As the step before went on, in second order: Newton's method then takes a step or two.
            if before > 0.0 and (stage == 1 or stage == 3):
                near, far = (0.0 if stage == 1 else 0.5 * h) / before, part / before
                for i in range(strain.size):
                    strain[i] += (far - near) * (trend[0, i] + (far + near) * trend[1, i])
            section = stiffness[n, row], rest[n, row], guides[n, row], present[n]
            if not fill_rates(trial, section, line, pulls, strain, frame, rates[stage], work):
                return False
            if stage == 0 or stage == 2:
                for i in range(strain.size):
                    past[stage // 2, i] = strain[i]
            if not known:
                continue
            if not fill_flexibility(section, pulls, strain, frame, give, ways, work):
                return False
            if parts:
                others[:] = 0.0
                for m in range(3):
                    own = stiffness[n, row, 3 + m]
                    own *= strain[strain.size - 3 + m] - rest[n, row, m]
                    for i in range(3):
                        others[2 * owners[n] + m // 2, 3 + i] += frame[i, m] * own
            if routed:
                fill_routing(
                    guides[n, row], present[n], pulls, strain, frame, others[2 * parts :], longer
                )
            fill_flow(trial, rates[stage], frame, line, give, ways, others, free, flow, room)
            if routed:
                at = 9 + k + 2 * parts
                for m in range(2 * k):
                    flow[BY_LENGTHS + m // 2, at + m] += longer[m]
                turn_load(lines[n, row, 2], -share, flow[6:9, at + 2 * k :])
            if stage == 0:
                carry(flow, slopes, free, moves[0])
            else:
                for r in range(rows):
                    for c in range(columns):
                        moved[r, c] = slopes[r, c] + part * moves[stage - 1, r, c]
                carry(flow, moved, free, moves[stage])
            if stage == 2 and len(form[0]):
                fill_form(n, h, trial, rates[2], stiffness[n, 1], frame, give, ways, form)
        before = h
        for i in range(strain.size):
            trend[0, i] = past[0, i] - 4.0 * past[1, i] + 3.0 * strain[i]
            trend[1, i] = 2.0 * (past[0, i] - 2.0 * past[1, i] + strain[i])
        for i in range(count):
            states[n + 1, i] = states[n, i] + h / 6.0 * (
                rates[0, i] + 2.0 * rates[1, i] + 2.0 * rates[2, i] + rates[3, i]
            )
        size = 0.0
        for i in range(TURN, FORCE):
            size += states[n + 1, i] ** 2
        size = 1.0 / math.sqrt(size)
        for i in range(TURN, FORCE):
            states[n + 1, i] *= size
        if known:
            for r in range(rows):
                for c in range(columns):
                    slopes[r, c] += (h / 6.0) * (
                        moves[0, r, c]
                        + 2.0 * moves[1, r, c]
                        + 2.0 * moves[2, r, c]
                        + moves[3, r, c]
                    )
        put_on(points[n + 1], share, states[n + 1], frame, slopes)
        if routed:
            turn_load(points[n + 1, 4], -share, slopes[6:9, columns - 3 :])
            turn_load(points[n + 1, 5], -share, slopes[3:6, columns - 3 :])
        for i in range(count):
            if not math.isfinite(states[n + 1, i]):
                return False
    return True


@kernel(error_model="numpy")
def put_on(point, share, state, frame, slopes):
    """Take a point's force and moment, (4, 3) as of `integrate_rod`, off a state and its slopes."""
    size = 0.0
    for i in range(4):
        for j in range(3):
            size += abs(point[i, j])
    if size == 0.0:
        return
    fill_quaternion_rotation(state[3], state[4], state[5], state[6], frame)
    for part in range(2):
        at, row = (FORCE, 6) if part == 0 else (MOMENT, 3)
        b0, b1, b2 = 0.0, 0.0, 0.0
        for j in range(3):
            b0 += share * frame[0, j] * point[2 + part, j]
            b1 += share * frame[1, j] * point[2 + part, j]
            b2 += share * frame[2, j] * point[2 + part, j]
        state[at] -= share * point[part, 0] + b0
        state[at + 1] -= share * point[part, 1] + b1
        state[at + 2] -= share * point[part, 2] + b2
        for c in range(slopes.shape[1]):
            f0, f1, f2 = slopes[0, c], slopes[1, c], slopes[2, c]
            slopes[row, c] += b1 * f2 - b2 * f1
            slopes[row + 1, c] += b2 * f0 - b0 * f2
            slopes[row + 2, c] += b0 * f1 - b1 * f0


# What changes the rod from outside: its tendons' routing, and the way that the base looks.


@kernel
def turn_load(load, share, out):
    """Add ``share`` of a vector's cross products with the axes to the columns of ``out`` (3, 3)."""
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        out[a, c] += share * load[b]
        out[b, c] -= share * load[a]


@kernel
def fill_routing(guides, present, pulls, strain, frame, others, longer):
    """Fill what a relative change of each tendon's offset does here, and an angle of its clocking.

    Force and moment that the tendons then put on (2 k, 6), in base axes, and by how much they get
    longer per length of the rod (2 k,).
    """
    wide = strain.size - 3
    u0, u1, u2 = strain[wide], strain[wide + 1], strain[wide + 2]
    own = np.empty(6)
    for m in range(2 * pulls.size):
        others[m] = 0.0
        longer[m] = 0.0
        k = m // 2
        if not present[k]:
            continue
        t0, t1, t2, long = measure_way(guides[k], strain)
        x, y, dx, dy = guides[k, 0], guides[k, 1], guides[k, 0], guides[k, 1]
        d0, d1 = guides[k, 2], guides[k, 3]
        if m % 2 == 1:
            dx, dy, d0, d1 = -y, x, -guides[k, 3], guides[k, 2]
        d0, d1, d2 = d0 - u2 * dy, d1 + u2 * dx, u0 * dy - u1 * dx
        t0, t1, t2 = t0 / long, t1 / long, t2 / long
        more = t0 * d0 + t1 * d1 + t2 * d2
        longer[m] = more
        # How the tangent turns.
        d0, d1, d2 = (d0 - t0 * more) / long, (d1 - t1 * more) / long, (d2 - t2 * more) / long
        own[0], own[1], own[2] = d0, d1, d2
        own[3] = y * d2 + dy * t2
        own[4] = -x * d2 - dx * t2
        own[5] = x * d1 - y * d0 + dx * t1 - dy * t0
        for part in range(0, 6, 3):
            for i in range(3):
                for j in range(3):
                    others[m, part + i] += pulls[k] * frame[i, j] * own[part + j]


# The second variation of the energy, in steps.
#
# Turned by a small rotation ``f`` of its cross-sections, a rod under dead loads and tensions has
# the second variation ``f' P f' - M . (f x f') - N . (f x (f x p'))``, with ``P`` its stiffness
# against bending and twist, tendons included; shear and stretch settle by themselves and add
# ``- 2 q E f' - q D q`` with ``q = N x f``.


@kernel(error_model="numpy")
def fill_form(n, h, state, rates, stiffness, frame, give, ways, form):
    """Fill a step's second variation by the turns of its ends: linear between them.

    What goes with the turns' square is shared out by 5/12 and 1/12, between linear turns and a sum
    over the ends: the errors of both in the buckling load cancel to fourth order.

    ``form`` is that (n, 6, 6), the backbone's own (n, 3, 3) by the difference of the turns,
    gradients of tendon lengths (n, k, 6), and what shear and stretch add to how these give way to
    tension (n, k, k). Forces are taken to keep their direction.
    """
    matrices, metrics, rows, softness = form
    p, e, d = np.empty((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    s, u, cross, part = np.zeros((3, 3)), np.zeros((3, 3)), np.empty((3, 3)), np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            cross[i, j] = give[3 + i, 3 + j]
    invert_three(cross, np.zeros(3), p)
    wide = give[0, 0] > 0.0
    fill_cross(state[10], state[11], state[12], -0.5, s)
    if wide:
        fill_cross(state[7], state[8], state[9], 1.0, cross)
        for i in range(3):
            for j in range(3):
                d[i, j] = give[i, j]
                for m in range(3):
                    e[i, j] += give[i, 3 + m] * p[m, j]
        for i in range(3):
            for j in range(3):
                for m in range(3):
                    d[i, j] -= e[i, m] * give[3 + m, j]
                    s[i, j] -= e[m, i] * cross[m, j]
        for i in range(3):
            for j in range(3):
                for m in range(3):
                    part[i, j] += d[i, m] * cross[m, j]
        for i in range(3):
            for j in range(3):
                for m in range(3):
                    u[i, j] -= cross[m, i] * part[m, j]
    along = state[7] * rates[0] + state[8] * rates[1] + state[9] * rates[2]
    for i in range(3):
        u[i, i] += along
        for j in range(3):
            u[i, j] -= 0.5 * (rates[i] * state[7 + j] + state[7 + i] * rates[j])
    for i in range(3):
        for j in range(3):
            even, odd = 0.5 * (s[i, j] + s[j, i]), 0.5 * (s[i, j] - s[j, i])
            matrices[n, i, j] = p[i, j] / h - even + OWN * h * u[i, j]
            matrices[n, 3 + i, 3 + j] = p[i, j] / h + even + OWN * h * u[i, j]
            matrices[n, 3 + i, j] = -p[i, j] / h + odd + OTHER * h * u[i, j]
            matrices[n, j, 3 + i] = matrices[n, 3 + i, j]
            total = 0.0
            for m in range(3):
                total += frame[i, m] * stiffness[3 + m] * frame[j, m]
            metrics[n, i, j] = total / h
    for k in range(len(ways)):
        for i in range(3):
            by_rate, by_turn = ways[k, 3 + i], 0.0
            if wide:
                for j in range(3):
                    by_rate += e[j, i] * ways[k, j]
                    for m in range(3):
                        by_turn += ways[k, m] * d[m, j] * cross[j, i]
            rows[n, k, i] = -by_rate + 0.5 * h * by_turn
            rows[n, k, 3 + i] = by_rate + 0.5 * h * by_turn
        for m in range(len(ways)):
            total = 0.0
            for i in range(3):
                for j in range(3):
                    total += ways[k, i] * d[i, j] * ways[m, j]
            softness[n, k, m] = h * total
