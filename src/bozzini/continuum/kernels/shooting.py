"""Numba kernels of multiple shooting: a rod under loads, its tendons, and the way to a command.

Unknowns are the moment at the base, then turn and moment at the start of every further piece; with
loads that turn with the body the forces too. Each step of Newton's method solves for them as
functions of the tensions, and for the tensions by the lengths that are asked for. Derivatives are
those of `integrate_rod`. Commands and loads are raised together, on few steps, and the last
solution is improved on all steps with the derivatives of the few.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ...numeric.kernels.linear_algebra import (
    factor_lu,
    solve_bounded,
    solve_complementary,
    solve_lu,
)
from ...numeric.kernels.rotations import find_turn, turn_quaternion
from .rod import BY_LENGTHS, FORCE, LENGTHS, MOMENT, TURN, integrate_rod
from .stability import count_negative

FOUND, STOPPED, BROKEN, BUCKLING, HELD, UNSTABLE = range(6)
"""Codes: found; no equilibrium; no derivative; singular; tendons as tight as can be; a saddle."""

MOST_STEPS, FEW_MORE = 25.0, 6.0
"""Newton steps for one part of a command, and with derivatives that are known."""

SMALL_JUMP, ROUGH_JUMP = 1e-10, 1e-3
"""Jumps between pieces that are none, in the end and on the way there [rad], or of moments."""

FAIR_JUMP = 1e-6
"""The same on few steps, before all of them are taken."""

TURN_LIMIT = 0.5
"""Largest turn between two pieces in one step [rad]."""

MOST_HALVINGS = 4
"""Times that a step of Newton's method is halved where the rod breaks down or jumps grow."""

GROWTH = 3.0
"""Growth of the jumps at which a step is halved."""

RIDGE = 1e-8
"""Added to the tendons' own flexibility, so that redundant tendons have one answer."""

SLOW = 0.3
"""Factor by which jumps must fall where derivatives are those of another grid."""

ROUND_OFF = 1e-3
"""Part of the tolerance of lengths that is let through unless more is needed."""

SMALLEST_PART = 1.0 / 64.0
"""Smallest part, of the first one, by which a command is raised where more of it fails."""


NO_SECTIONS = (np.zeros(0, dtype=np.int64), 0)


@njit(cache=True)
def sum_forces(rod, share, state):
    """Set a state's force to that which the loads put on the base; of those of one direction."""
    places = rod[0][0]
    lines, points, _ = rod[1]
    for i in range(3):
        total = 0.0
        for n in range(places.size - 1):
            h = places[n + 1] - places[n]
            whole = lines[n, 0, 0, i] + 4.0 * lines[n, 1, 0, i] + lines[n, 2, 0, i]
            total += h / 6.0 * whole + points[n + 1, 0, i]
        state[FORCE + i] = share * total


@njit(cache=True)
def shoot(rod, cuts, unit, share, state, jumps, system, form):
    """Pass through all pieces: fills the ``jumps`` (n,), and derivatives unless form is empty.

    ``state`` are tensions (k,), quaternions (p, 4), moments and forces (p, 3) at the pieces'
    starts, and states at all places; ``system`` the matrix (n, n), derivatives by tension (n, k)
    and lengths' by unknowns (k, n) and tensions (k, k). Moments are in units of ``unit``, forces of
    that by the rod's length. Returns whether it got through.
    """
    tensions, turns, moments, forces, states = state
    matrix, by_tension, by_unknown, by_pull = system
    pieces, k = len(turns), tensions.size
    free = 6 if jumps.size == 6 * pieces - 3 else 9
    length = rod[0][0][-1]
    wants = len(form[0]) > 0
    owners = np.zeros(0, dtype=np.int64)
    none = owners, owners.size
    slopes = np.zeros((BY_LENGTHS + k, free + k) if wants else (0, 0))
    turn = np.empty(3)
    sizes = np.ones(9)
    sizes[3:6], sizes[6:9] = unit, unit / length
    if wants:
        matrix[:] = 0.0
        by_pull[:] = 0.0
    if free == 6:
        sum_forces(rod, share, states[0])
    for piece in range(pieces):
        first, last = cuts[piece], cuts[piece + 1]
        states[first, TURN:FORCE] = turns[piece]
        states[first, MOMENT : MOMENT + 3] = moments[piece]
        if free == 9:
            states[first, FORCE:MOMENT] = forces[piece]
        if wants:
            slopes[:] = 0.0
            for i in range(free):
                slopes[i, i] = 1.0
        if not integrate_rod(first, last, rod, share, tensions, states, slopes, none, form):
            return False
        final = piece == pieces - 1
        top, low = free * piece, (3 if final else 0)
        if not final:
            find_turn(turns[piece + 1], states[last, TURN:FORCE], turn)
            w, x, y, z = turns[piece + 1]
            # The rotation between them in base axes: turned by that of the piece's start.
            for i in range(3):
                jumps[top + i] = 0.0
            rotate(w, x, y, z, turn, jumps[top : top + 3])
        for i in range(3):
            jumps[top + 3 - low + i] = states[last, MOMENT + i]
            if not final:
                jumps[top + 3 + i] -= moments[piece + 1, i]
            jumps[top + 3 - low + i] /= sizes[3]
            if free == 9:
                jumps[top + 6 - low + i] = states[last, FORCE + i]
                if not final:
                    jumps[top + 6 + i] -= forces[piece + 1, i]
                jumps[top + 6 - low + i] /= sizes[6]
        if not wants:
            continue
        begin = 3 if piece == 0 else 0
        for r in range(low, free):
            for c in range(begin, free):
                matrix[top - low + r, top - 3 + c] = slopes[r, c] * sizes[c] / sizes[r]
            for m in range(k):
                by_tension[top - low + r, m] = slopes[r, free + m] / sizes[r]
            if not final:
                matrix[top + r, top + free - 3 + r] -= 1.0
        for m in range(k):
            for c in range(begin, free):
                by_unknown[m, top - 3 + c] = slopes[BY_LENGTHS + m, c] * sizes[c]
            for j in range(k):
                by_pull[m, j] += slopes[BY_LENGTHS + m, free + j]
    for i in range(jumps.size):
        if not math.isfinite(jumps[i]):
            return False
    return True


@njit(cache=True)
def rotate(w, x, y, z, vector, out):
    """Fill ``out`` (3,) with a vector turned by a unit quaternion."""
    a, b, c = vector[0], vector[1], vector[2]
    p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    out[0] = a + w * p + y * r - z * q
    out[1] = b + w * q + z * p - x * r
    out[2] = c + w * r + x * q - y * p


@njit(cache=True)
def move(state, unit, length, step, part):
    """Take part of a step (n,) of the unknowns."""
    tensions, turns, moments, forces, states = state
    pieces = len(turns)
    free = 6 if step.size == 6 * pieces - 3 else 9
    body, out = np.empty(3), np.empty(4)
    for piece in range(pieces):
        at = free * piece - 3
        if piece > 0:
            w, x, y, z = turns[piece]
            rotate(w, -x, -y, -z, step[at : at + 3], body)
            turn_quaternion(turns[piece], part * body, out)
            size = math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
            for i in range(4):
                turns[piece, i] = out[i] / size
        for i in range(3):
            moments[piece, i] += part * unit * step[at + 3 + i]
            if free == 9:
                forces[piece, i] += part * unit / length * step[at + 6 + i]


@njit(cache=True)
def miss_lengths(aim, lengths, tensions, gaps):
    """Fill how far lengths are from what is asked [mm], and return the largest; 0 for slack ones.

    ``aim`` is a tendon's length or tension (k,), which of the two (k,), the compliances (k,), and
    the lowest and highest tensions (k,).
    """
    goals, holds, compliances, low, high = aim
    worst = 0.0
    for m in range(gaps.size):
        gaps[m] = 0.0
        if not holds[m]:
            continue
        gaps[m] = lengths[m] - compliances[m] * tensions[m] - goals[m]
        if low[m] == 0.0 and tensions[m] == 0.0:
            gaps[m] = max(gaps[m], 0.0)
        worst = max(worst, abs(gaps[m]))
    return worst


@njit(cache=True)
def find_taut(aim, lengths, tensions, tolerance):
    """Which tendons hold a length: those with tension, and those that are about to have one."""
    goals, holds, compliances, low, high = aim
    taut = np.zeros(tensions.size, dtype=np.bool_)
    for m in range(tensions.size):
        gap = lengths[m] - compliances[m] * tensions[m] - goals[m]
        taut[m] = holds[m] and (tensions[m] != 0.0 or gap > -2.0 * tolerance)
    return taut


@njit(cache=True)
def pull(aim, give, gaps, tensions, wanted):
    """Tensions for which lengths would be as asked, by how they give way to tension (k, k).

    ``gaps`` are those without a change of tension, those of slack tendons too. Returns a code.
    """
    goals, holds, compliances, low, high = aim
    k = tensions.size
    held = np.flatnonzero(holds)
    for m in range(k):
        wanted[m] = tensions[m] if holds[m] else goals[m]
    size = held.size
    if size == 0:
        return FOUND
    exact, even = np.empty((size, size)), np.empty((size, size))
    vector, least, most = np.empty(size), np.empty(size), np.empty(size)
    now, found = np.empty(size), np.empty(size)
    largest = 0.0
    for a in range(size):
        i = held[a]
        vector[a], least[a], most[a], now[a] = -gaps[i], low[i], high[i], tensions[i]
        for j in range(k):
            if not holds[j]:
                vector[a] += give[i, j] * (goals[j] - tensions[j])
        for b in range(size):
            exact[a, b] = give[i, held[b]]
            even[a, b] = 0.5 * (give[i, held[b]] + give[held[b], i])
        largest = max(largest, abs(even[a, a]))
    # By the change of tensions, so that neither the ridge nor the symmetry is left in the answer.
    found[:] = now
    for a in range(size):
        even[a, a] += RIDGE * largest
        if compliances[held[a]] == 0.0:
            exact[a, a] += RIDGE * largest
    definite = solve_bounded(even, vector - even @ now, least, most, found)
    if not definite:
        # Buckled but for its tendons: those that pull, or are too long, are taken to be taut.
        for a in range(size):
            found[a] = now[a]
            if least[a] == 0.0 and now[a] == 0.0 and vector[a] < 0.0:
                found[a] = 1e-9 * most[a]
    # A moment of fixed direction has no potential: then the problem is not symmetric.
    even[0] = found
    if not solve_complementary(exact, vector - exact @ now, least, most, found):
        if not definite:
            return STOPPED
        found[:] = even[0]
    code = FOUND
    for a in range(size):
        wanted[held[a]] = found[a]
        if abs(found[a]) >= most[a]:
            code = HELD
    return code


@njit(cache=True)
def improve(rod, cuts, unit, share, aim, state, known, form, limits):
    """Improve a state by Newton's method; returns a code and the steps taken.

    ``known`` are the derivatives' factors: the matrix, its order, how unknowns follow tensions
    (n, k), lengths' derivatives by unknowns (k, n), and how lengths give way to tension (k, k);
    they are filled unless ``form`` is empty, and otherwise taken as they are. ``limits`` are the
    jump and the gap that are let through, and the most steps.
    """
    tensions, turns, moments, forces, states = state
    matrix, order, carried, by_unknown, give = known
    small, loose, most_steps = limits
    k, size = tensions.size, order.size
    length = rod[0][0][-1]
    fresh = len(form[0]) > 0
    by_pull, jumps, step = np.empty((k, k)), np.empty(size), np.empty((size, 1))
    gaps, wanted, base = np.empty(k), np.empty(k), np.empty(k)
    kept = tensions.copy(), turns.copy(), moments.copy(), forces.copy()
    before, part, halved = math.inf, 1.0, 0
    goals, holds, compliances, low, high = aim
    for m in range(k):
        if not holds[m]:
            # At once: the lengths follow.
            tensions[m] = goals[m]
    count = -1
    while True:
        count += 1
        good = shoot(
            rod, cuts, unit, share, state, jumps, (matrix, carried, by_unknown, by_pull), form
        )
        off, whole = 0.0, 0.0
        for i in range(size):
            off = max(off, abs(jumps[i]))
        for piece in range(len(moments)):
            for i in range(3):
                whole = max(whole, abs(moments[piece, i]))
        off /= 1.0 + whole / unit
        if not good or (fresh and off > GROWTH * before and off > 0.1):
            if count == 0 or halved == MOST_HALVINGS or not fresh:
                return BROKEN, count
            halved += 1
            part *= 0.5
            tensions[:], turns[:], moments[:], forces[:] = kept
            move(state, unit, length, step[:, 0], part)
            for m in range(k):
                tensions[m] += part * (wanted[m] - kept[0][m])
            continue
        if fresh:
            if not factor_lu(matrix, order):
                return BUCKLING, count
            solve_lu(matrix, order, carried)
            for i in range(k):
                for j in range(k):
                    total = -by_pull[i, j]
                    for c in range(size):
                        total += by_unknown[i, c] * carried[c, j]
                    give[i, j] = total
                give[i, i] += compliances[i]
        gap = miss_lengths(aim, states[-1, LENGTHS:], tensions, gaps)
        if off <= small and gap <= loose:
            return FOUND, count
        if count >= most_steps or (not fresh and max(off, gap / length) > SLOW * before):
            return STOPPED, count
        before, halved = max(off, gap / length), 0
        step[:, 0] = jumps
        solve_lu(matrix, order, step)
        for m in range(k):
            base[m] = states[-1, LENGTHS + m] - compliances[m] * tensions[m] - goals[m]
            for c in range(size):
                base[m] -= by_unknown[m, c] * step[c, 0]
        code = pull(aim, give, base, tensions, wanted)
        if code != FOUND:
            tensions[:] = wanted
            return code, count
        widest = 0.0
        for c in range(size):
            step[c, 0] = -step[c, 0]
            for m in range(k):
                step[c, 0] -= carried[c, m] * (wanted[m] - tensions[m])
        free = 6 if size == 6 * len(turns) - 3 else 9
        for piece in range(1, len(turns)):
            at = free * piece - 3
            widest = max(
                widest, math.sqrt(step[at, 0] ** 2 + step[at + 1, 0] ** 2 + step[at + 2, 0] ** 2)
            )
        part = min(1.0, TURN_LIMIT / widest) if widest > 0.0 else 1.0
        kept[0][:], kept[1][:], kept[2][:], kept[3][:] = tensions, turns, moments, forces
        move(state, unit, length, step[:, 0], part)
        for m in range(k):
            tensions[m] += part * (wanted[m] - kept[0][m])


@njit(cache=True)
def follow(rods, unit, command, bounds, state, known, forms, way):
    """Raise command and loads from where a state stands, as far as an equilibrium can be followed.

    ``rods`` are those of few and of all steps, with their cuts; ``command`` is what is asked of
    tendons at rest and how it changes up to the whole command (k,), and which are lengths (k,);
    ``bounds`` the compliances and the lowest and highest tensions (k,). ``way`` is the first part,
    the tolerance [mm], and whether saddles are passed. Returns a code, the steps taken, the share
    that was reached, the one that failed, and the gap that was let through.
    """
    (few, few_cuts, few_states), (many, many_cuts, many_states) = rods
    rest, change, holds = command
    compliances, low, high = bounds
    first, tolerance, passes = way
    form, none = forms
    tensions, turns, moments, forces = state
    kept = tensions.copy(), turns.copy(), moments.copy(), forces.copy()
    trial = tensions, turns, moments, forces, few_states
    matrix, order, carried, by_unknown, give = known
    one = few[0][0].size == many[0][0].size
    reached, part, smallest, steps, code = 0.0, first, SMALLEST_PART * first, 0, FOUND
    failed = 1.0
    loose = ROUND_OFF * tolerance
    cables = (holds & (low == 0.0)).astype(np.float64)
    while reached < 1.0:
        share = min(1.0, reached + part)
        if share > 1.0 - 1e-9:
            share = 1.0
        aim = rest + share * change + loose * cables, holds, compliances, low, high
        last = share == 1.0
        jump = (SMALL_JUMP if one else FAIR_JUMP) if last else ROUGH_JUMP
        fits = max(loose, (0.0 if last and one else 1e-2 * jump * few[0][0][-1]))
        code, count = improve(
            few, few_cuts, unit, share, aim, trial, known, form, (jump, fits, MOST_STEPS)
        )
        steps += count
        if code == FOUND and not passes:
            taut = find_taut(aim, few_states[-1, LENGTHS:], tensions, tolerance)
            if count_negative(form, compliances, taut, 0.0) > 0:
                code = UNSTABLE
        if code == FOUND:
            kept[0][:], kept[1][:], kept[2][:], kept[3][:] = tensions, turns, moments, forces
            reached = share
            part *= 1.5
            continue
        failed = share
        tensions[:], turns[:], moments[:], forces[:] = kept
        if loose < tolerance and code != UNSTABLE and code != BUCKLING:
            loose = tolerance
            continue
        part *= 0.5
        if part < smallest:
            break
    if reached == 1.0 and not one:
        trial = tensions, turns, moments, forces, many_states
        aim = rest + change + loose * cables, holds, compliances, low, high
        code, count = improve(
            many, many_cuts, unit, 1.0, aim, trial, known, none, (SMALL_JUMP, loose, FEW_MORE)
        )
        steps += count
    return code, steps, reached, failed, loose
