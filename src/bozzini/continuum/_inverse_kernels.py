"""Numba kernels of the inverse: damped least squares over the bends of a chain, inside limits.

Wanted are places of points of the backbone, and axes of the tip's frame. An axis that is ``angle``
away counts with ``2 sin(angle / 2)``, which is smooth everywhere, unlike a rotation vector.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ._bend_limit_kernels import SOLVED, factor_shifted, solve_factored, step_inside
from ._chain_arc_kernels import fill_chain, place_point
from ._curvature_kernels import add_curvature

__all__ = ["improve", "rank_starts", "search"]

REACHED = 0
SETTLED = 1
RUN_OUT = 2
STALLED = 3

FIRST_DAMPING = 1e-3
STEP_CAP = 1.0
"""Largest change of a section's bend in a step [rad]."""

GRAIN = 1e-15
"""Share of the cost that is round-off."""

SMALL_STEP = 1e-10
"""Step that counts as none [rad]."""


@njit(cache=True)
def evaluate(goal, bends, work, gradient, matrix):
    """Return the cost and the two misses of `bends`; fill gradient and Gauss-Newton matrix.

    Parameters
    ----------
    goal : tuple
        ``lengths`` (m,) of the sections [mm]; for each point its section ``owner`` (k,), its
        ``share`` (k,) of the way along it, where it shall be, ``places`` (k, 3) [mm], and
        ``weights`` (k,); wanted ``axes`` (a, 3) of the tip: none, the tangent alone, or tangent,
        x and y; ``turn``, the millimetres that a radian counts [mm]; ``small``, the weight of the
        squares of the bends [mm^2/rad^2].
    bends : (m, 2) float
        Bends [rad].
    work : tuple of ndarray
        Room for `fill_chain` and a point.
    gradient : (2 m,) float
        Filled; of size 0 where only the cost is asked for.
    matrix : (2 m, 2 m) float
        Filled likewise.

    Returns
    -------
    cost : float
        Half the weighted sum of squares.
    distance : float
        Largest distance of a point from its place [mm].
    angle : float
        Angle of the tip from its axes [rad].
    """
    lengths, owner, share, places, weights, axes, turn, small = goal
    frames, slopes, turns, point, rows = work
    sections = lengths.size
    n = 2 * sections
    derive = gradient.size > 0
    fill_chain(lengths, bends, frames, slopes, turns)
    cost = 0.0
    for i in range(sections):
        cost += small * (bends[i, 0] ** 2 + bends[i, 1] ** 2)
    if derive:
        matrix[:] = 0.0
        for i in range(n):
            gradient[i] = small * bends[i // 2, i % 2]
            matrix[i, i] = small
    distance = 0.0
    for k in range(owner.size):
        place_point(lengths, bends, frames, slopes, turns, owner[k], share[k], point, rows)
        square = 0.0
        for r in range(3):
            point[r] -= places[k, r]
            square += point[r] * point[r]
        distance = max(distance, square)
        weight = weights[k] * weights[k]
        cost += weight * square
        if derive:
            _add_rows(rows, point, weight, 2 * owner[k] + 2, gradient, matrix)
    apart = 0.0
    if axes.shape[0] > 0:
        tip = frames[sections]
        weight = turn * turn / (1.0 if axes.shape[0] == 1 else 2.0)
        square = 0.0
        for c in range(axes.shape[0]):
            column = (2 + c) % 3
            x = tip[0, column]
            y = tip[1, column]
            z = tip[2, column]
            point[0] = x - axes[c, 0]
            point[1] = y - axes[c, 1]
            point[2] = z - axes[c, 2]
            square += point[0] ** 2 + point[1] ** 2 + point[2] ** 2
            if derive:
                for i in range(n):
                    wx = turns[i // 2, i % 2, 0]
                    wy = turns[i // 2, i % 2, 1]
                    wz = turns[i // 2, i % 2, 2]
                    rows[i, 0] = wy * z - wz * y
                    rows[i, 1] = wz * x - wx * z
                    rows[i, 2] = wx * y - wy * x
                _add_rows(rows, point, weight, n, gradient, matrix)
        cost += weight * square
        apart = math.sqrt(square if axes.shape[0] == 1 else 0.5 * square)
    return 0.5 * cost, math.sqrt(distance), 2.0 * math.asin(min(0.5 * apart, 1.0))


@njit(cache=True)
def _add_rows(rows, miss, weight, size, gradient, matrix):
    for i in range(size):
        a = weight * rows[i, 0]
        b = weight * rows[i, 1]
        c = weight * rows[i, 2]
        gradient[i] += a * miss[0] + b * miss[1] + c * miss[2]
        for j in range(i + 1):
            matrix[i, j] += a * rows[j, 0] + b * rows[j, 1] + c * rows[j, 2]


@njit(cache=True)
def make_work(sections):
    """Return room for `evaluate`."""
    frames = np.zeros((sections + 1, 3, 4))
    for r in range(3):
        frames[0, r, r] = 1.0
    return (
        frames,
        np.empty((sections, 2, 3)),
        np.empty((sections, 2, 3)),
        np.empty(3),
        np.empty((2 * sections, 3)),
    )


@njit(cache=True)
def improve(goal, bounds, bends, tolerances, plan):
    """Improve `bends`, which are inside the limits, in place.

    Parameters
    ----------
    goal : tuple
        As of `evaluate`.
    bounds : tuple
        Limits, rows, low, high of `step_inside`.
    bends : (m, 2) float
        In and out.
    tolerances : (2,) float
        Distance [mm] and angle [rad] that are near enough.
    plan : (3,) int
        Largest number of steps; steps in which the cost must fall by a tenth; 1 to use the whole
        second derivative, 0 for Gauss and Newton's part of it.

    Returns
    -------
    code, steps, cost, distance, angle
    """
    limits, rows, low, high = bounds
    sections = goal[0].size
    small = goal[7]
    most = plan[0]
    patience = plan[1]
    exact = plan[2] == 1
    n = 2 * sections
    work = make_work(sections)
    gradient = np.empty(n)
    matrix = np.empty((n, n))
    none = np.empty(0)
    nothing = np.empty((0, 0))
    factor = np.zeros((n, n))
    step = np.empty(n)
    trial = np.empty((sections, 2))
    cost, distance, angle = evaluate(goal, bends, work, gradient, matrix)
    largest = 0.0
    for i in range(n):
        largest += matrix[i, i]  # the trace does not mind turning
    if exact:
        add_curvature(goal, bends, work, matrix)
    damping = FIRST_DAMPING * largest
    growth = 2.0
    before = cost
    for done in range(most):
        if small == 0.0 and distance <= tolerances[0] and angle <= tolerances[1]:
            return REACHED, done, cost, distance, angle
        if done % patience == patience - 1:
            if cost > 0.9 * before:
                return STALLED, done, cost, distance, angle
            before = cost
        fits = factor_shifted(matrix, damping, factor)
        if fits:
            for i in range(n):
                step[i] = -gradient[i]
            solve_factored(factor, step)
            for i in range(n):
                step[i] += bends[i // 2, i % 2]
            fits = step_inside(factor, step, limits, rows, low, high) == SOLVED
        if not fits:
            damping = max(damping * growth, 1e-12 * largest)
            growth *= 2.0
            continue
        size = 0.0
        for i in range(sections):
            step[2 * i] -= bends[i, 0]
            step[2 * i + 1] -= bends[i, 1]
            size = max(size, math.hypot(step[2 * i], step[2 * i + 1]))
        part = min(1.0, STEP_CAP / size) if size > 0.0 else 1.0
        fall = 0.0
        for i in range(n):
            step[i] *= part
            trial[i // 2, i % 2] = bends[i // 2, i % 2] + step[i]
            fall -= gradient[i] * step[i]
            fall -= 0.5 * matrix[i, i] * step[i] * step[i]
            for j in range(i):
                fall -= matrix[i, j] * step[i] * step[j]
        if size <= SMALL_STEP and damping <= largest or fall <= GRAIN * cost:
            return SETTLED, done, cost, distance, angle
        new_cost, _, _ = evaluate(goal, trial, work, none, nothing)
        ratio = (cost - new_cost) / fall
        if ratio > 1e-4:
            bends[:] = trial
            cost, distance, angle = evaluate(goal, bends, work, gradient, matrix)
            if exact:
                add_curvature(goal, bends, work, matrix)
            damping *= max(0.1, 1.0 - (2.0 * ratio - 1.0) ** 3)
            growth = 2.0
        else:
            damping = max(damping * growth, 1e-12 * largest)
            growth *= 2.0
            if damping > 1e16 * largest:
                return SETTLED, done, cost, distance, angle
    return RUN_OUT, most, cost, distance, angle


@njit(cache=True)
def move_inside(bounds, bends):
    """Move `bends` to the nearest legal ones; False if there are none."""
    limits, rows, low, high = bounds
    flat = bends.ravel()
    return step_inside(np.eye(flat.size), flat, limits, rows, low, high) == SOLVED


@njit(cache=True)
def rank_starts(goal, starts, costs):
    """Fill the cost of each of a set of starts (n, m, 2)."""
    work = make_work(goal[0].size)
    none = np.empty(0)
    nothing = np.empty((0, 0))
    for k in range(starts.shape[0]):
        costs[k], _, _ = evaluate(goal, starts[k], work, none, nothing)


@njit(cache=True)
def search(goal, bounds, starts, tolerances, plans, best):
    """Improve one start after the other until one reaches the goal; the best one is kept.

    Parameters
    ----------
    goal, bounds, tolerances
        As of `improve`.
    plans : (2, 3) int
        Plan of each start, and of the best of all, which goes on.
    starts : (k, m, 2) float
        Starts, the most promising first; those outside the limits are moved inside.
    best : (m, 2) float
        Filled with the best bends.

    Returns
    -------
    code, steps, tried, cost, distance, angle
    """
    steps = 0
    least = np.inf
    code = RUN_OUT
    distance = np.inf
    angle = np.inf
    for k in range(starts.shape[0]):
        bends = starts[k].copy()
        if not move_inside(bounds, bends):
            continue
        found, took, cost, far, off = improve(goal, bounds, bends, tolerances, plans[0])
        steps += took
        if cost < least or found == REACHED:
            best[:] = bends
            least = cost
            code = found
            distance = far
            angle = off
        if found == REACHED:
            return code, steps, k + 1, cost, far, off
    if least < np.inf:
        code, took, least, distance, angle = improve(goal, bounds, best, tolerances, plans[1])
        steps += took
    return code, steps, starts.shape[0], least, distance, angle
