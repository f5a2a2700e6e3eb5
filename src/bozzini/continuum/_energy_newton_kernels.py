"""Numba kernels of the discrete rod: Newton's method on its energy under the tendons' lengths.

The rod is a row of segments with one rotation vector each. It takes the least
``1/2 sum w^T K w`` for which no tendon is longer than the cable it was given: the tensions are the
multipliers of that, so none is negative, and a tendon that is not needed hangs slack by itself.
Every step is a quadratic problem whose dual has one unknown per tendon (`solve_bounded`).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ._energy_kernels import invert_blocks, measure_lengths, reduce_problem
from ._energy_tension_kernels import solve_bounded

__all__ = ["CONVERGED", "FOLDED", "NOT_CONVERGED", "OVERLOADED", "solve_commands"]

CONVERGED = 0
NOT_CONVERGED = 1
OVERLOADED = 2
FOLDED = 3

STEP_LIMIT = 0.5
"""Largest turn of one segment in one step [rad]."""

TURN_LIMIT = math.pi
"""Turn of one segment at which the rod counts as folded [rad]."""

STEP_TOLERANCE = 1e-10
"""Turn of every segment at which a solution counts as found [rad]."""

ROUGH = 1e-6
"""The same where steps do not get smaller any more: a stiff part pulls at a flexible one [rad]."""

ROUND_OFF = 1e-11
"""Error of a tendon's length that is round-off, against the longest of them."""

RIDGE = 1e-11
"""Added to the tendons' own flexibility, so that redundant tendons have one answer."""

MOST_OVERLOADED = 10
"""Steps with tensions out of bounds after which a command counts as impossible."""

SMALLEST_SHARE = 1.0 / 64.0
"""Smallest part of a command by which it is raised where the whole of it fails."""


@njit(cache=True)
def solve_command(
    grid,
    limits,
    compliances,
    low,
    high,
    tolerance,
    most_steps,
    turns,
    tensions,
    lengths,
):
    """One command, from where ``turns`` and ``tensions`` stand; both are changed.

    ``limits`` are the cables' lengths. Returns a code, the steps taken, the error of the tendons'
    lengths against them [mm], and how many segments are not stable by themselves.
    """
    spans, stiffness, _, _, counts, _ = grid
    n, k = spans.size, counts.size
    slopes, carried = np.empty((k, n, 3)), np.empty((k, n, 3))
    psd, full, inverses = np.empty((n, 3, 3)), np.empty((n, 3, 3)), np.empty((n, 3, 3))
    matrix, vector, forces = np.empty((k, k)), np.empty(k), np.empty((n, 3))
    wanted, move = np.empty(k), np.empty((n, 3))
    exact, replaced, error, overloaded = True, 0, 0.0, 0
    size, before = math.inf, math.inf
    for count in range(most_steps + 1):
        measure_lengths(grid, turns, tensions, lengths, slopes, psd, full)
        error = 0.0
        loaded = True
        for m in range(k):
            gap = lengths[m] - limits[m] - compliances[m] * tensions[m]
            if tensions[m] == 0.0 and low[m] == 0.0:
                gap = max(gap, 0.0)
            error = max(error, abs(gap))
            loaded = loaded and abs(tensions[m]) < high[m]
        fine = error <= tolerance + ROUND_OFF * limits.max()
        rest = size <= STEP_TOLERANCE or (size <= ROUGH and size > 0.5 * before)
        if count > 0 and rest and fine and loaded:
            return CONVERGED, count, error, replaced
        if count == most_steps:
            break
        replaced = invert_blocks(stiffness, psd, full, exact, inverses)
        for j in range(n):
            for i in range(3):
                forces[j, i] = stiffness[j, i] * turns[j, i]
        reduce_problem(slopes, counts, inverses, forces, matrix, vector, carried)
        most = 0.0
        for m in range(k):
            matrix[m, m] += compliances[m]
            most = max(most, matrix[m, m])
        for m in range(k):
            if compliances[m] == 0.0:
                # About the tensions there are, so that it goes away as they settle.
                matrix[m, m] += RIDGE * most
                vector[m] -= RIDGE * most * tensions[m]
            vector[m] += limits[m] - lengths[m]
            wanted[m] = tensions[m]
        if not solve_bounded(matrix, vector, low, high, wanted):
            return NOT_CONVERGED, count, error, replaced
        loaded = True
        for m in range(k):
            loaded = loaded and abs(wanted[m]) < high[m]
        exact = loaded
        overloaded += 0 if loaded else 1
        if overloaded == MOST_OVERLOADED:
            return OVERLOADED, count, error, replaced
        before, size = size, 0.0
        for j in range(n):
            for i in range(3):
                move[j, i] = -(
                    inverses[j, i, 0] * forces[j, 0]
                    + inverses[j, i, 1] * forces[j, 1]
                    + inverses[j, i, 2] * forces[j, 2]
                )
                for m in range(k):
                    if j < counts[m]:
                        move[j, i] -= carried[m, j, i] * wanted[m]
            size = max(size, math.sqrt(move[j, 0] ** 2 + move[j, 1] ** 2 + move[j, 2] ** 2))
        share = min(1.0, STEP_LIMIT / size) if size > 0.0 else 1.0
        for j in range(n):
            for i in range(3):
                turns[j, i] += share * move[j, i]
            if turns[j, 0] ** 2 + turns[j, 1] ** 2 + turns[j, 2] ** 2 > TURN_LIMIT**2:
                return FOLDED, count + 1, error, replaced
        tensions[:] = wanted
    return NOT_CONVERGED, most_steps, error, replaced


@njit(cache=True)
def share_tensions(stiffness, counts, slopes, turns, taut, low, high, tensions):
    """Least tensions that hold the rod as it is: what redundant tendons leave open."""
    n, k = turns.shape[0], counts.size
    inverses, forces = np.zeros((n, 3, 3)), np.empty((n, 3))
    for j in range(n):
        for i in range(3):
            inverses[j, i, i] = 1.0 / stiffness[j, i]
            forces[j, i] = stiffness[j, i] * turns[j, i]
    matrix, vector, carried = np.empty((k, k)), np.empty(k), np.empty((k, n, 3))
    reduce_problem(slopes, counts, inverses, forces, matrix, vector, carried)
    least, most, shared = low.copy(), high.copy(), tensions.copy()
    largest = 0.0
    for m in range(k):
        largest = max(largest, matrix[m, m])
        if not taut[m]:
            least[m] = 0.0
            most[m] = 0.0
            shared[m] = 0.0
    ridge = 1e-8 * largest
    centred = vector.copy()
    for m in range(k):
        matrix[m, m] += ridge
    for _ in range(3):
        # Each pass takes out what the ridge did to the one before it.
        if not solve_bounded(matrix, centred, least, most, shared):
            return
        for m in range(k):
            centred[m] = vector[m] - ridge * shared[m]
    tensions[:] = shared


@njit(cache=True)
def follow_command(
    grid,
    natural,
    displacement,
    tolerance,
    first,
    smallest,
    compliances,
    low,
    high,
    most_steps,
    turns,
    tensions,
    lengths,
):
    """One command from the straight rod, at once or else in parts, as far as it can be followed.

    ``first`` is the part of the command that is tried at once, ``smallest`` the smallest one.

    Returns what `solve_command` does of the last part, the share of the command that was reached,
    and all steps taken.
    """
    turns[:] = 0.0
    tensions[:] = 0.0
    kept_turns, kept_tensions = turns.copy(), tensions.copy()
    limits = np.empty(displacement.size)
    reached, part, steps = 0.0, first, 0
    while True:
        share = min(1.0, reached + part)
        if share > 1.0 - 1e-9:
            share = 1.0
        for m in range(displacement.size):
            limits[m] = natural[m] - share * displacement[m]
            if low[m] == 0.0:
                limits[m] += tolerance
        code, count, error, unstable = solve_command(
            grid,
            limits,
            compliances,
            low,
            high,
            tolerance,
            most_steps,
            turns,
            tensions,
            lengths,
        )
        steps += count
        if code == CONVERGED:
            reached = share
            if reached == 1.0:
                return code, error, unstable, reached, steps
            kept_turns[:] = turns
            kept_tensions[:] = tensions
        else:
            turns[:] = kept_turns
            tensions[:] = kept_tensions
            part *= 0.5
            if part < smallest:
                return code, error, unstable, reached, steps


@njit(cache=True)
def solve_commands(
    grid,
    natural,
    displacements,
    firsts,
    tolerance,
    compliances,
    pushes,
    strongest,
    most_steps,
    turns,
    tensions,
    lengths,
    codes,
    steps,
    errors,
    shares,
    unstable,
):
    """Solve a batch of commands (b, k), each from the straight rod; fills the arrays from `turns`.

    ``firsts`` (b,) are the parts of them that are tried at once.

    Where a command fails, ``shares`` tells how much of it can be followed, and the shape is that.
    """
    spans, stiffness, _, _, counts, _ = grid
    n, k = spans.size, counts.size
    low, high = np.zeros(k), np.full(k, strongest)
    for m in range(k):
        if pushes[m]:
            low[m] = -strongest
    slopes = np.empty((k, n, 3))
    psd, full = np.empty((n, 3, 3)), np.empty((n, 3, 3))
    taut = np.empty(k, dtype=np.bool_)
    for b in range(displacements.shape[0]):
        steps[b] = 0
        # As commanded to round-off; with the tolerance, and in parts, only where that cannot be.
        for attempt in range(3):
            allowed = tolerance if attempt > 0 else 1e-4 * tolerance
            smallest = SMALLEST_SHARE * firsts[b] if attempt == 2 else firsts[b]
            codes[b], errors[b], unstable[b], shares[b], count = follow_command(
                grid,
                natural,
                displacements[b],
                allowed,
                firsts[b],
                smallest,
                compliances,
                low,
                high,
                most_steps,
                turns[b],
                tensions[b],
                lengths[b],
            )
            steps[b] += count
            if codes[b] == CONVERGED:
                break
        measure_lengths(grid, turns[b], tensions[b], lengths[b], slopes, psd, full)
        for m in range(k):
            gap = natural[m] - shares[b] * displacements[b, m] - lengths[b, m]
            taut[m] = pushes[m] or gap <= tolerance
        # Tendons that stretch leave nothing open.
        if compliances.max() == 0.0:
            share_tensions(stiffness, counts, slopes, turns[b], taut, low, high, tensions[b])
