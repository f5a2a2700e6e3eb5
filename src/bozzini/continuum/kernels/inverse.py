"""Numba kernels of the inverse: damped least squares over the bends of a chain, inside limits.

Wanted are places ``q_k`` of points ``p_k`` of the backbone, and axes ``d_c`` of the tip's frame
``t_c``, the tangent or all three. Unknowns are the bends ``b`` (2 m,) [rad], section by section,
``theta cos(phi)``, then ``theta sin(phi)``; what is made small within the limits of bends and
travel is ::

    1/2 sum_k w_k^2 |p_k(b) - q_k|^2 + 1/2 (h^2 / n) sum_c |t_c(b) - d_c|^2 + 1/2 small |b|^2

with a length ``h`` for a radian [mm], and n = 1 for the tangent alone, 2 for three axes: so an
orientation that is ``angle`` away counts with ``2 sin(angle / 2)``, which is smooth everywhere,
unlike a rotation vector. Steps are Levenberg and Marquardt's, with all second derivatives on
request.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_matrix, copy_vector, set_identity
from ...numeric.kernels.linear_algebra import factor_cholesky, solve_lower, solve_upper
from .arc import arc_factors, fill_chain, place_point

# Numba kernels of a quadratic step inside the limits of bends and tendons.
#
# A set of bends is legal where every section's bend lies in a disc, ``|b_i| <= limit_i``, and
# linear rows, the tendons' travel among them, lie in ranges. That set is convex, and the lowest
# point of a convex quadratic in it is found by the dual active-set method of Goldfarb and Idnani
# (1983). A disc counts as the family of all its tangents: the most violated one is added.

VIOLATION = 1e-11
"""Distance outside a limit that counts as none [rad]."""

DEPENDENT = 1e-18
"""Square of the sine between constraints below which they count as one."""

PIVOT = 1e-14
"""Share of a matrix's diagonal that its pivots must exceed."""

SOLVED = 0
EMPTY = 1
UNFINISHED = 2


@kernel
def measure_violation(x, limits, rows, low, high, normal):
    """Return how far `x` is outside the limit it breaks most, and fill its inward normal.

    Parameters
    ----------
    x : (2 m,) float
        Bends.
    limits : (m,) float
        Largest bend of each section.
    rows : (c, 2 m) float
        Rows of length 1.
    low, high : (c,) float
        Range of each row times `x`.
    normal : (2 m,) float
        Filled if the violation is positive.
    """
    worst = 0.0
    which = -1
    for i in range(limits.size):
        over = math.hypot(x[2 * i], x[2 * i + 1]) - limits[i]
        if over > worst:
            worst = over
            which = i
    side = 0.0
    for j in range(low.size):
        value = 0.0
        for k in range(x.size):
            value += rows[j, k] * x[k]
        if low[j] - value > worst:
            worst = low[j] - value
            which = limits.size + j
            side = 1.0
        if value - high[j] > worst:
            worst = value - high[j]
            which = limits.size + j
            side = -1.0
    if which >= limits.size:
        for k in range(x.size):
            normal[k] = side * rows[which - limits.size, k]
    elif which >= 0:
        normal[:] = 0.0
        size = math.hypot(x[2 * which], x[2 * which + 1])
        normal[2 * which] = -x[2 * which] / size
        normal[2 * which + 1] = -x[2 * which + 1] / size
    return worst


@kernel
def _split(vector, count, basis, upper, coefficients, rest):
    """Write `vector` as ``coefficients`` of the first active vectors and a `rest` across them.

    The active vectors are ``upper.T @ basis``. `coefficients` is first in the basis, and stays so
    in the column ``upper[:, count]``. Returns the square of the rest's length.
    """
    n = vector.size
    for k in range(n):
        rest[k] = vector[k]
    for j in range(count):
        upper[j, count] = 0.0
    for _ in range(2):  # once more, against round-off
        for j in range(count):
            part = 0.0
            for k in range(n):
                part += basis[j, k] * rest[k]
            upper[j, count] += part
            for k in range(n):
                rest[k] -= part * basis[j, k]
    square = 0.0
    for k in range(n):
        square += rest[k] * rest[k]
    for i in range(count - 1, -1, -1):
        coefficients[i] = upper[i, count]
        for j in range(i + 1, count):
            coefficients[i] -= upper[i, j] * coefficients[j]
        coefficients[i] /= upper[i, i]
    return square


@kernel
def _append(rest, square, count, basis, upper):
    """Make the vector that `_split` took apart the last active one."""
    size = math.sqrt(square)
    upper[count, count] = size
    for k in range(rest.size):
        basis[count, k] = rest[k] / size


@kernel
def step_inside(factor, x, limits, rows, low, high):
    """Move `x`, the lowest point of a quadratic, to the lowest one inside the limits.

    Parameters
    ----------
    factor : (2 m, 2 m) float
        Cholesky factor of the quadratic's matrix.
    x : (2 m,) float
        In and out.
    limits, rows, low, high
        As in `measure_violation`.

    Returns
    -------
    int
        ``SOLVED``, ``EMPTY`` if nothing lies inside, or ``UNFINISHED``.
    """
    n = x.size
    normal = np.empty(n)
    violation = measure_violation(x, limits, rows, low, high, normal)
    if violation <= VIOLATION:
        return SOLVED
    active = np.empty((n + 1, n))
    weight = np.empty(n + 1)
    basis = np.empty((n, n))
    upper = np.empty((n, n + 1))
    share = np.empty(n)
    rest = np.empty(n)
    count = 0
    for _ in range(40 * (limits.size + 1) + 4 * low.size):
        solve_lower(factor, normal, n)
        whole = 0.0
        for k in range(n):
            whole += normal[k] * normal[k]
        force = 0.0
        while True:
            free = _split(normal, count, basis, upper, share, rest)
            step = math.inf
            leaves = -1
            for j in range(count):
                if share[j] > 0.0 and weight[j] < step * share[j]:
                    step = weight[j] / share[j]
                    leaves = j
            moves = count < n and free > DEPENDENT * whole
            if moves and violation <= step * free:
                step = violation / free
                leaves = -1
            elif leaves < 0:
                return EMPTY
            for j in range(count):
                weight[j] -= step * share[j]
            force += step
            if moves:
                violation -= step * free
                if leaves < 0:
                    _append(rest, free, count, basis, upper)
                solve_upper(factor, rest, n)
                for k in range(n):
                    x[k] += step * rest[k]
            if leaves < 0:
                copy_vector(normal, active[count])
                weight[count] = force
                count += 1
                break
            count -= 1
            for j in range(leaves, count):
                copy_vector(active[j + 1], active[j])
                weight[j] = weight[j + 1]
                square = _split(active[j], j, basis, upper, share, rest)
                _append(rest, square, j, basis, upper)
        violation = measure_violation(x, limits, rows, low, high, normal)
        if violation <= VIOLATION:
            return SOLVED
    return UNFINISHED


# Numba kernels that complete the Gauss-Newton matrix of the inverse to the second derivative.
#
# Where a target is out of reach its miss does not vanish, and the second derivatives of the chain
# count: without them the last steps to the nearest shape are many. A section turns all that lies
# beyond it, so across sections the second derivative is a turn of the first one; within a section
# it follows from ``L (f2 bx, f2 by, f1) + R v`` with ``R v = cos v + f1 w x v + f2 w (w . v)``.

SERIES_BELOW = 0.25


@kernel
def _second_factors(square, f1, g1, g2):
    """Second derivatives of f1 and f2 with ``theta ** 2``."""
    if square >= SERIES_BELOW:
        return (
            -(0.5 * f1 + 1.5 * g1) / (2.0 * square),
            (0.25 * g1 - g2) / square,
        )
    first = 0.0
    second = 0.0
    term = 1.0 / 120.0  # (-square)**(k - 2) / (2 k + 1)!
    for k in range(2, 11):
        first += k * (k - 1) * term
        second += k * (k - 1) * term / (2 * k + 2)
        term *= -square / ((2 * k + 2) * (2 * k + 3))
    return first, second


@kernel
def fill_arc_curvature(length, bx, by, pull, arm, out):
    """Fill the second derivative of ``pull . (place + R arm)`` with the bend of one arc.

    Parameters
    ----------
    length, bx, by : float
        Length [mm] and bend [rad].
    pull : (3,) float
        Vector in the frame of the arc's start.
    arm : (3,) float
        Vector in the frame of its end, from there.
    out : (2, 2) float
        Filled.
    """
    square = bx * bx + by * by
    f1, f2, _, g1, g2 = arc_factors(square)
    second1, second2 = _second_factors(square, f1, g1, g2)
    dot = pull[0] * arm[0] + pull[1] * arm[1] + pull[2] * arm[2]
    turn_x = arm[2] * pull[0] - arm[0] * pull[2]
    turn_y = -(arm[1] * pull[2] - arm[2] * pull[1])
    p = (pull[1], -pull[0])
    s = (arm[1], -arm[0])
    along_p = p[0] * bx + p[1] * by
    along_s = s[0] * bx + s[1] * by
    value1 = length * pull[2] + turn_x * bx + turn_y * by
    value2 = length * (pull[0] * bx + pull[1] * by) + along_p * along_s
    b = (bx, by)
    slope1 = (turn_x, turn_y)
    slope2 = (
        length * pull[0] + p[0] * along_s + s[0] * along_p,
        length * pull[1] + p[1] * along_s + s[1] * along_p,
    )
    # Derivatives of cos with the square are -f1 / 2 and -g1 / 4.
    bent = 4.0 * (second1 * value1 + second2 * value2) - g1 * dot
    even = g1 * value1 + g2 * value2 - f1 * dot
    for i in range(2):
        for j in range(2):
            out[i, j] = (
                bent * b[i] * b[j]
                + g1 * (b[i] * slope1[j] + b[j] * slope1[i])
                + g2 * (b[i] * slope2[j] + b[j] * slope2[i])
                + f2 * (p[i] * s[j] + p[j] * s[i])
            )
        out[i, i] += even


@kernel
def _into(frame, vector, out):
    """Turn a vector of the base's frame into that of `frame`."""
    for k in range(3):
        out[k] = frame[0, k] * vector[0] + frame[1, k] * vector[1] + frame[2, k] * vector[2]


@kernel
def _add_between(angular_jacobians, rows, residual, last, matrix):
    """Add what different sections, up to `last`, have in common."""
    for i in range(last):
        for a in range(2):
            wx = angular_jacobians[i, a, 0]
            wy = angular_jacobians[i, a, 1]
            wz = angular_jacobians[i, a, 2]
            x = residual[1] * wz - residual[2] * wy
            y = residual[2] * wx - residual[0] * wz
            z = residual[0] * wy - residual[1] * wx
            for j in range(2 * i + 2, 2 * last + 2):
                matrix[j, 2 * i + a] += rows[j, 0] * x + rows[j, 1] * y + rows[j, 2] * z


@kernel
def add_curvature(goal, bends, work, matrix):
    """Add the second derivatives to the lower half of a Gauss-Newton matrix.

    Parameters are those of `evaluate`, which has filled `work` at the same bends.
    """
    lengths, owner, fractions, places, weights, axes, radian_length, _ = goal
    frames, linear_jacobians, angular_jacobians, point, rows = work
    sections = lengths.size
    residual = np.empty(3)
    local = np.empty(3)
    beyond = np.empty(3)
    arm = np.empty(3)
    block = np.empty((2, 2))
    for k in range(owner.size):
        last = owner[k]
        place_point(
            lengths,
            bends,
            frames,
            linear_jacobians,
            angular_jacobians,
            last,
            fractions[k],
            point,
            rows,
        )
        for r in range(3):
            residual[r] = weights[k] * weights[k] * (point[r] - places[k, r])
        _add_between(angular_jacobians, rows, residual, last, matrix)
        for i in range(last + 1):
            part = fractions[k] if i == last else 1.0
            _into(frames[i], residual, local)
            for r in range(3):
                beyond[r] = 0.0 if i == last else point[r] - frames[i + 1, r, 3]
            _into(frames[i + 1], beyond, arm)
            fill_arc_curvature(
                part * lengths[i], part * bends[i, 0], part * bends[i, 1], local, arm, block
            )
            _add_block(block, part * part, i, matrix)
    weight = radian_length * radian_length / (1.0 if axes.shape[0] == 1 else 2.0)
    tip = frames[sections]
    for c in range(axes.shape[0]):
        column = (2 + c) % 3
        for r in range(3):
            beyond[r] = tip[r, column]
            residual[r] = weight * (beyond[r] - axes[c, r])
        for i in range(2 * sections):
            wx = angular_jacobians[i // 2, i % 2, 0]
            wy = angular_jacobians[i // 2, i % 2, 1]
            wz = angular_jacobians[i // 2, i % 2, 2]
            rows[i, 0] = wy * beyond[2] - wz * beyond[1]
            rows[i, 1] = wz * beyond[0] - wx * beyond[2]
            rows[i, 2] = wx * beyond[1] - wy * beyond[0]
        _add_between(angular_jacobians, rows, residual, sections - 1, matrix)
        for i in range(sections):
            _into(frames[i], residual, local)
            _into(frames[i + 1], beyond, arm)
            fill_arc_curvature(0.0, bends[i, 0], bends[i, 1], local, arm, block)
            _add_block(block, 1.0, i, matrix)


@kernel
def _add_block(block, scale, section, matrix):
    for a in range(2):
        for b in range(a + 1):
            matrix[2 * section + a, 2 * section + b] += scale * block[a, b]


REACHED = 0
SETTLED = 1
RUN_OUT = 2
STALLED = 3

FIRST_DAMPING = 1e-3
STEP_CAP = 1.0
"""Largest change of a section's bend in a step [rad]."""

ROUND_OFF_SHARE = 1e-15
"""Share of the cost that is round-off."""

SMALL_STEP = 1e-10
"""Step that counts as none [rad]."""


@kernel
def evaluate(goal, bends, work, gradient, matrix):
    """Return the cost and the two misses of `bends`; fill gradient and Gauss-Newton matrix.

    Parameters
    ----------
    goal : tuple
        ``lengths`` (m,) of the sections [mm]; for each point its section ``owner`` (k,), its
        ``fractions`` (k,) of the way along it, where it shall be, ``places`` (k, 3) [mm], and
        ``weights`` (k,); wanted ``axes`` (a, 3) of the tip: none, the tangent alone, or tangent, x
        and y; ``radian_length``, the millimetres that a radian counts [mm]; ``small``, the weight
        of the squares of the bends [mm^2/rad^2].
    bends : (m, 2) float
        Bends [rad].
    work : tuple of ndarray
        Work arrays of `fill_chain` and of a point.
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
    lengths, owner, fractions, places, weights, axes, radian_length, small = goal
    frames, linear_jacobians, angular_jacobians, point, rows = work
    sections = lengths.size
    n = 2 * sections
    derive = gradient.size > 0
    fill_chain(lengths, bends, frames, linear_jacobians, angular_jacobians)
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
        place_point(
            lengths,
            bends,
            frames,
            linear_jacobians,
            angular_jacobians,
            owner[k],
            fractions[k],
            point,
            rows,
        )
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
        weight = radian_length * radian_length / (1.0 if axes.shape[0] == 1 else 2.0)
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
                    wx = angular_jacobians[i // 2, i % 2, 0]
                    wy = angular_jacobians[i // 2, i % 2, 1]
                    wz = angular_jacobians[i // 2, i % 2, 2]
                    rows[i, 0] = wy * z - wz * y
                    rows[i, 1] = wz * x - wx * z
                    rows[i, 2] = wx * y - wy * x
                _add_rows(rows, point, weight, n, gradient, matrix)
        cost += weight * square
        apart = math.sqrt(square if axes.shape[0] == 1 else 0.5 * square)
    return 0.5 * cost, math.sqrt(distance), 2.0 * math.asin(min(0.5 * apart, 1.0))


@kernel
def _add_rows(rows, miss, weight, size, gradient, matrix):
    for i in range(size):
        a = weight * rows[i, 0]
        b = weight * rows[i, 1]
        c = weight * rows[i, 2]
        gradient[i] += a * miss[0] + b * miss[1] + c * miss[2]
        for j in range(i + 1):
            matrix[i, j] += a * rows[j, 0] + b * rows[j, 1] + c * rows[j, 2]


@kernel
def make_work(sections):
    """Return work arrays for `evaluate`."""
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


@kernel
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
        fits = factor_cholesky(matrix, n, damping, PIVOT, factor)
        if fits:
            for i in range(n):
                step[i] = -gradient[i]
            solve_lower(factor, step, n)
            solve_upper(factor, step, n)
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
        if size <= SMALL_STEP and damping <= largest or fall <= ROUND_OFF_SHARE * cost:
            return SETTLED, done, cost, distance, angle
        new_cost, _, _ = evaluate(goal, trial, work, none, nothing)
        ratio = (cost - new_cost) / fall
        if ratio > 1e-4:
            copy_matrix(trial, bends)
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


@kernel
def move_inside(bounds, bends):
    """Move `bends` to the nearest legal ones; False if there are none."""
    limits, rows, low, high = bounds
    flat = bends.ravel()
    identity = np.empty((flat.size, flat.size))
    set_identity(identity)
    return step_inside(identity, flat, limits, rows, low, high) == SOLVED


@kernel
def rank_starts(goal, starts, costs):
    """Fill the cost of each of a set of starts (n, m, 2)."""
    work = make_work(goal[0].size)
    none = np.empty(0)
    nothing = np.empty((0, 0))
    for k in range(starts.shape[0]):
        costs[k], _, _ = evaluate(goal, starts[k], work, none, nothing)


@kernel
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
            copy_matrix(bends, best)
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


# Numba kernel that draws bends evenly from all that a robot can take.


@kernel
def _narrow(value, slope, low, high, interval):
    """Narrow an interval of steps to those with ``low <= value + step * slope <= high``."""
    if abs(slope) < 1e-300:
        return
    first = (low - value) / slope
    last = (high - value) / slope
    interval[0] = max(interval[0], min(first, last))
    interval[1] = min(interval[1], max(first, last))


@kernel
def draw_bends(random, start, basis, limits, rows, low, high, thin, out):
    """Fill ``out`` (n, 2 m) by hit-and-run (Smith 1984), which tends to an even density.

    Parameters
    ----------
    random : Generator
        Source of random numbers.
    start : (2 m,) float
        Legal bends to walk from.
    basis : (p, 2 m) float
        Directions to walk in.
    limits, rows, low, high
        As of `measure_violation`.
    thin : int
        Steps from one sample to the next.
    """
    n = start.size
    x = start.copy()
    way = np.empty(n)
    interval = np.empty(2)
    for sample in range(out.shape[0]):
        for _ in range(thin):
            way[:] = 0.0
            for j in range(basis.shape[0]):
                part = random.standard_normal()
                for k in range(n):
                    way[k] += part * basis[j, k]
            interval[0] = -math.inf
            interval[1] = math.inf
            for i in range(limits.size):
                vx = way[2 * i]
                vy = way[2 * i + 1]
                square = vx * vx + vy * vy
                if square < 1e-300:
                    continue
                middle = -(x[2 * i] * vx + x[2 * i + 1] * vy) / square
                aside = (x[2 * i] * vy - x[2 * i + 1] * vx) / math.sqrt(square)
                half = math.sqrt(max(limits[i] ** 2 - aside * aside, 0.0) / square)
                interval[0] = max(interval[0], middle - half)
                interval[1] = min(interval[1], middle + half)
            for j in range(low.size):
                value = 0.0
                slope = 0.0
                for k in range(n):
                    value += rows[j, k] * x[k]
                    slope += rows[j, k] * way[k]
                if high[j] - low[j] > 1e-9:
                    _narrow(value, slope, low[j], high[j], interval)
            if interval[1] > interval[0]:
                step = interval[0] + random.random() * (interval[1] - interval[0])
                for k in range(n):
                    x[k] += step * way[k]
        copy_vector(x, out[sample])
