"""Numba kernels for a whole chain: advance it along the path, and look at its whole body.

The constrained link step (thesis (5.15)) finds the tail ``t`` of a link, its head at ``h``, nearest
to where the tail was, ``t_0``, at the link's length L and in free space::

    minimise |t - t_0|  such that  |t - h| = L ,   c(t) = s(t) + needed <= 0

with the signed distance ``s`` to the free space, negative inside, and the clearance ``needed``
[mm]. Unknowns are normal coordinates (a, b) [rad] of the direction from the head about that to
``t_0``, whose norm is the angle: ``t = h + L (cos |(a, b)| w + sin |(a, b)| / |(a, b)| (a e + b
f))``. A bundle of linear cuts of ``c`` solves it locally, to 1e-9 mm; a step by more than 0.3 rad
is held against a search of all directions by branch and bound. Links follow from the head on.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from ...duct.kernels.clearance import clearance_estimate, space_estimate, space_slope, split_along
from ...duct.packed import GridData
from ...numeric.compiling import kernel

# All directions of one link: the nearest feasible one, and that with the most clearance.
#
# A direction is given by its normal coordinates (a, b) around the old one, whose norm is the angle
# between them; ``frame`` holds the old direction and two unit vectors normal to it. The exponential
# map of a sphere never lengthens, so two tails are at most ``length`` times the distance of their
# coordinates apart, and a duct whose value changes by at most `slope` per mm bounds a whole square
# of directions by the value at its centre. In the plane b = 0, and squares are intervals.

TOLERANCE = 1e-9
"""Feasibility and convergence tolerance of the link step [mm]."""

MARCH = 1e-3
"""Least step of the march around a circle [mm]: a gap in the wall may hide in it."""


def bound_packed_slope(data: object) -> float:
    """Return by how much the value of a packed duct changes per mm at most; not compiled.

    1 for shapes; sqrt(3) for the trilinear interpolant of a sampled field, each of whose three
    partial derivatives is a mean of difference quotients of distances.
    """
    return math.sqrt(3.0) if isinstance(data, GridData) else 1.0


@kernel
def point_tail(head, frame, length, a, b, tail):
    """Fill `tail` with the point at `length` from `head` in the direction (a, b)."""
    angle = math.sqrt(a * a + b * b)
    ahead = length * math.cos(angle)
    aside = length * (math.sin(angle) / angle if angle > 1e-12 else 1.0)
    for n in range(3):
        tail[n] = head[n] + ahead * frame[0, n] + aside * (a * frame[1, n] + b * frame[2, n])


@kernel
def _value_at(space, head, frame, length, needed, a, b, tail):
    """Return how much clearance lacks in the direction (a, b), and fill `tail`."""
    point_tail(head, frame, length, a, b, tail)
    return needed - space_estimate(space, tail[0], tail[1], tail[2])


@kernel
def _first_fit(space, head, frame, length, needed, a, b, low, c_low, high, c_high, tail):
    """Return the fraction of (a, b), in (low, high], at which it is feasible; fill `tail`.

    False position with the Illinois rule; at `low` `c_low` of the clearance lacks, at `high` none.
    """
    scale = math.sqrt(a * a + b * b)
    last = c_high
    side = 0
    while last < -TOLERANCE and (high - low) * scale > 1e-12:
        middle = low + c_low / (c_low - c_high) * (high - low)
        if not low < middle < high:
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
        c = _value_at(space, head, frame, length, needed, middle * a, middle * b, tail)
        if c <= 0.0:
            high = middle
            last = c_high = c
            if side == 1:
                c_low *= 0.5
            side = 1
        else:
            low = middle
            c_low = c
            if side == -1:
                c_high *= 0.5
            side = -1
    point_tail(head, frame, length, high * a, high * b, tail)
    return high


@kernel
def march_circle(space, head, frame, length, needed, slope, tail):
    """Find the nearest feasible direction in the plane, marching both ways from the old one.

    Where c lacks, none is within a chord of c / slope. No step is shorter than `MARCH`:
    a feasible stretch is only missed if it offers less than ``slope MARCH / 2`` more than asked.

    Returns
    -------
    found : bool
    angle : float
        Signed, of the direction found, whose point is put into `tail`.
    """
    start = _value_at(space, head, frame, length, needed, 0.0, 0.0, tail)
    least = MARCH / length
    angles = np.zeros(2)
    lacking = np.full(2, start)
    limit = math.pi
    answer = 0.0
    found = False
    while True:
        side = 0 if angles[0] <= angles[1] else 1
        if angles[side] >= limit:
            break
        sign = 1.0 - 2.0 * side
        before = angles[side]
        c_before = lacking[side]
        skip = 2.0 * math.asin(min(0.5 * c_before / (slope * length), 1.0))
        after = min(before + max(skip, least), limit)
        c = _value_at(space, head, frame, length, needed, sign * after, 0.0, tail)
        angles[side] = after
        lacking[side] = c
        if c <= 0.0:
            after = _first_fit(
                space,
                head,
                frame,
                length,
                needed,
                sign,
                0.0,
                before,
                c_before,
                after,
                c,
                tail,
            )
            found = True
            limit = after
            answer = sign * after
            angles[side] = after
    if found:
        point_tail(head, frame, length, answer, 0.0, tail)
    return found, answer


@kernel
def _nearest_in_square(a, b, half):
    """Distance from the origin to the square around (a, b)."""
    da = max(abs(a) - half, 0.0)
    db = max(abs(b) - half, 0.0)
    return math.sqrt(da * da + db * db)


@kernel
def search_sphere(
    space,
    head,
    frame,
    length,
    needed,
    slope,
    known,
    angle_tolerance,
    finest,
    budget,
    coordinates,
):
    """Find the nearest feasible direction, and a bound below which none is: branch and bound.

    Squares of directions are taken up nearest first, and divided where the bound on the value does
    not exclude feasible ones in them, down to `finest`.

    Parameters
    ----------
    known : float
        Angle of a direction known to be feasible; infinite if there is none.
    gap : float
        By how much an angle may miss the least one [rad].
    finest : float
        Half the side of the smallest squares [rad]: a feasible one is only missed if it offers
        less than ``slope * length * sqrt(2) * finest`` more than asked.
    budget : int
        Values of the duct at most.
    coordinates : (2,) float
        Filled with the direction found, where it is nearer than `known`.

    Returns
    -------
    found : bool
        Whether a nearer direction than `known` was found.
    angle : float
        Of the nearest direction, infinite if none is feasible.
    bound : float
        No direction nearer than this is feasible, but for the slack of `finest`.
    count : int
        Values of the duct used.
    """
    tail = np.empty(3)
    heap = [(0.0, 0.0, 0.0, math.pi)]
    angle = known
    bound = np.inf
    found = False
    count = 0
    while len(heap) > 0:
        key, a, b, half = heapq.heappop(heap)
        if key >= angle - angle_tolerance or count >= budget:
            bound = min(bound, key)
            break
        c = _value_at(space, head, frame, length, needed, a, b, tail)
        count += 1
        own_angle = math.sqrt(a * a + b * b)
        if c <= 0.0 and own_angle < angle and own_angle <= math.pi:
            start = _value_at(space, head, frame, length, needed, 0.0, 0.0, tail)
            fraction = _first_fit(
                space, head, frame, length, needed, a, b, 0.0, start, 1.0, c, tail
            )
            angle = fraction * own_angle
            coordinates[0] = fraction * a
            coordinates[1] = fraction * b
            found = True
        reach = min(math.sqrt(2.0) * half, math.pi)
        if c > 2.0 * slope * length * math.sin(0.5 * reach):
            continue
        if half <= finest:
            if c <= 0.0:
                bound = min(bound, key)
            continue
        half *= 0.5
        for i in range(4):
            na = a + (half if i % 2 == 0 else -half)
            nb = b + (half if i < 2 else -half)
            near = _nearest_in_square(na, nb, half)
            if near < angle - angle_tolerance and near < math.pi:
                heapq.heappush(heap, (near, na, nb, half))
    return found, angle, max(min(bound, angle - angle_tolerance), 0.0), count


@kernel
def find_clearest(space, head, frame, length, needed, slope, planar, floor, budget, tail):
    """Find the direction where the least clearance lacks: branch and bound.

    Parameters
    ----------
    floor : float
        Where some lacks everywhere that was looked, the search goes on until none can have
        more than this to spare [mm].

    Returns
    -------
    lack : float
        The least found [mm], at the point put into `tail`.
    bound : float
        No direction lacks less than this; within 0.01 mm of `lack`, or a hundredth of it if that
        is more, and at least `-floor` if `lack` is positive, if the budget of values was enough.
    """
    point = np.empty(3)
    best = np.inf
    best_a = 0.0
    best_b = 0.0
    enough = np.inf
    bound = np.inf
    heap = [(-np.inf, 0.0, 0.0, math.pi)]
    count = 0
    while len(heap) > 0:
        key, a, b, half = heapq.heappop(heap)
        if key >= enough or count >= budget:
            bound = key
            break
        half *= 0.5
        for i in range(2 if planar else 4):
            na = a + (half if i % 2 == 0 else -half)
            nb = 0.0 if planar else b + (half if i < 2 else -half)
            value = _value_at(space, head, frame, length, needed, na, nb, point)
            count += 1
            if value < best:
                best = value
                best_a = na
                best_b = nb
                enough = best - max(0.01, 0.01 * best)
                if best > 0.0:
                    enough = max(enough, -floor)
            reach = min(half if planar else math.sqrt(2.0) * half, math.pi)
            low = value - 2.0 * slope * length * math.sin(0.5 * reach)
            if low < enough and _nearest_in_square(na, nb, half) < math.pi:
                heapq.heappush(heap, (low, na, nb, half))
    point_tail(head, frame, length, best_a, best_b, tail)
    return best, min(bound, enough)


# One constrained link: the tail that moves least, at its distance, in the duct.
#
# All points are in the duct's own frame; the free space is packed for `duct.kernels.clearance`.
# What a tail lacks is the clearance needed less the free space's.

FREE = 0
WALL = 1
SEARCHED = 2
INFEASIBLE = 3

SMOOTH_ITERATIONS = 10
MAX_ITERATIONS = 40

NEARBY = 0.3
"""A local step that turns by more than this is compared with a search of all directions [rad]."""
GAP = 1e-3
"""By how much the search may miss the least turn before it is polished [rad]."""
FINEST = 1e-3
"""Half the side of the smallest square of directions that the search looks at [rad]."""
CLOSE = 0.01
"""What clearance a refused direction may have to spare, in moves over the smallest square."""
BUDGET = 200_000
"""Values of the duct in a search at most."""


@kernel
def _least_norm(cuts, count):
    """Return (ok, a, b): the shortest 2-vector with ``c + g.(a, b) <= 0`` for every cut."""
    best = np.inf
    best_a = 0.0
    best_b = 0.0
    worst = 0.0
    for i in range(count):
        worst = max(worst, cuts[i, 2])
    if worst <= 0.0:
        return True, 0.0, 0.0
    for i in range(count):
        size = cuts[i, 0] ** 2 + cuts[i, 1] ** 2
        if size > 0.0 and cuts[i, 2] > 0.0:
            a = -cuts[i, 2] * cuts[i, 0] / size
            b = -cuts[i, 2] * cuts[i, 1] / size
            fits = True
            for k in range(count):
                if cuts[k, 2] + cuts[k, 0] * a + cuts[k, 1] * b > 1e-12:
                    fits = False
            if fits and a * a + b * b < best:
                best = a * a + b * b
                best_a = a
                best_b = b
    for i in range(count):
        for j in range(i):
            det = cuts[i, 0] * cuts[j, 1] - cuts[i, 1] * cuts[j, 0]
            if abs(det) > 1e-14:
                a = (-cuts[i, 2] * cuts[j, 1] + cuts[j, 2] * cuts[i, 1]) / det
                b = (-cuts[i, 0] * cuts[j, 2] + cuts[j, 0] * cuts[i, 2]) / det
                fits = True
                for k in range(count):
                    if cuts[k, 2] + cuts[k, 0] * a + cuts[k, 1] * b > 1e-12:
                        fits = False
                if fits and a * a + b * b < best:
                    best = a * a + b * b
                    best_a = a
                    best_b = b
    return best < np.inf, best_a, best_b


@kernel
def _frame(w, e, f):
    """Fill `e`, `f` with two unit vectors normal to the unit vector `w`."""
    if abs(w[0]) <= abs(w[1]) and abs(w[0]) <= abs(w[2]):
        ax, ay, az = 0.0, -w[2], w[1]
    elif abs(w[1]) <= abs(w[2]):
        ax, ay, az = w[2], 0.0, -w[0]
    else:
        ax, ay, az = -w[1], w[0], 0.0
    scale = 1.0 / math.sqrt(ax * ax + ay * ay + az * az)
    e[0] = ax * scale
    e[1] = ay * scale
    e[2] = az * scale
    f[0] = w[1] * e[2] - w[2] * e[1]
    f[1] = w[2] * e[0] - w[0] * e[2]
    f[2] = w[0] * e[1] - w[1] * e[0]


@kernel
def _local_step(space, head, frame, length, needed, start, cuts, tail):
    """Minimise the turn from direction `w` subject to the duct; a bundle of linear cuts in 2-D.

    Unknown: the normal coordinates (a, b) of the direction around `w`, whose norm is the angle,
    so the objective is exact. Each evaluation gives a linear cut. Where the field is smooth the
    newest cut alone converges. Where the iterates keep moving, at a kink of the trilinear field,
    up to three are kept as long as they were made near the iterate on the scale of its last move,
    which settles the kink as a corner of half-planes.
    `start` holds the first (a, b), and the last in the end. Returns (converged, angle).
    """
    w = (frame[0, 0], frame[0, 1], frame[0, 2])
    e = (frame[1, 0], frame[1, 1], frame[1, 2])
    f = (frame[2, 0], frame[2, 1], frame[2, 2])
    a = start[0]
    b = start[1]
    count = 0
    last_move = np.inf
    for iteration in range(MAX_ITERATIONS):
        # value and gradient at (a, b)
        angle = math.sqrt(a * a + b * b)
        if angle > 1e-12:
            ca = math.cos(angle)
            sinc = math.sin(angle) / angle
            ua = a / angle
            ub = b / angle
        else:
            ca = 1.0
            sinc = 1.0
            ua = 1.0
            ub = 0.0
        for n in range(3):
            tail[n] = head[n] + length * (ca * w[n] + sinc * (a * e[n] + b * f[n]))
        clearance, gx, gy, gz = space_slope(space, tail[0], tail[1], tail[2])
        c = needed - clearance
        # derivative along the radial direction and across it
        radial = 0.0
        across = 0.0
        g = (-gx, -gy, -gz)
        sa = sinc * angle
        for n in range(3):
            along = ua * e[n] + ub * f[n]
            radial += g[n] * (ca * along - sa * w[n])
            across += g[n] * sinc * (ua * f[n] - ub * e[n])
        radial *= length
        across *= length
        ga = radial * ua - across * ub
        gb = radial * ub + across * ua
        kept = 0
        for i in range(count):
            distance = math.sqrt((cuts[i, 3] - a) ** 2 + (cuts[i, 4] - b) ** 2)
            near = iteration >= SMOOTH_ITERATIONS and distance <= 4.0 * last_move
            if near and not (count == 3 and i == 0):
                for n in range(5):
                    cuts[kept, n] = cuts[i, n]
                kept += 1
        cuts[kept, 0] = ga
        cuts[kept, 1] = gb
        cuts[kept, 2] = c - ga * a - gb * b
        cuts[kept, 3] = a
        cuts[kept, 4] = b
        count = kept + 1
        ok, na, nb = _least_norm(cuts, count)
        if not ok and count > 1:
            for n in range(5):
                cuts[0, n] = cuts[kept, n]
            count = 1
            ok, na, nb = _least_norm(cuts, count)
        if not ok:
            return False, angle
        move = math.sqrt((na - a) ** 2 + (nb - b) ** 2)
        if move * length <= TOLERANCE and c <= TOLERANCE:
            start[0] = a
            start[1] = b
            return True, angle
        limit = 0.5
        if move > limit:
            na = a + (na - a) * limit / move
            nb = b + (nb - b) * limit / move
            move = limit
        last_move = move
        a = na
        b = nb
        if a * a + b * b > math.pi * math.pi:
            return False, angle
    return False, math.sqrt(a * a + b * b)


@kernel
def make_frame(head, old, planar, frame):
    """Fill `frame` (3, 3 or more) with the direction from `head` to `old`, and two normal to it.

    In the plane the second one lies in it. Where the points coincide, all tails are equally near:
    the direction is along x then.
    """
    dx = old[0] - head[0]
    dy = old[1] - head[1]
    dz = old[2] - head[2]
    size = math.sqrt(dx * dx + dy * dy + dz * dz)
    if size > 0.0:
        frame[0, 0] = dx / size
        frame[0, 1] = dy / size
        frame[0, 2] = dz / size
    else:
        frame[0, 0] = 1.0
        frame[0, 1] = 0.0
        frame[0, 2] = 0.0
    if planar:
        frame[1, 0] = -frame[0, 1]
        frame[1, 1] = frame[0, 0]
        frame[1, 2] = 0.0
        frame[2, 0] = 0.0
        frame[2, 1] = 0.0
        frame[2, 2] = 1.0
    else:
        _frame(frame[0], frame[1], frame[2])


@kernel
def _search(space, head, length, needed, slope, planar, known, work, tail):
    """Search all directions, with a local step's turn `known` if it has converged."""
    frame = work[:3]
    start = work[0, 3:]
    if planar:
        found, _ = march_circle(space, head, frame, length, needed, slope, tail)
        if found:
            return WALL, 0.0
    else:
        # As an int64: for a constant it would be compiled anew beside the one for Python.
        budget = np.int64(BUDGET)
        found, least, _, _ = search_sphere(
            space, head, frame, length, needed, slope, known, GAP, FINEST, budget, start
        )
        if found:
            a = start[0]
            b = start[1]
            ok, turn = _local_step(space, head, frame, length, needed, start, work[3:6], tail)
            if not ok or turn > least:
                point_tail(head, frame, length, a, b, tail)
            return SEARCHED, 0.0
        if known < np.inf:
            point_tail(head, frame, length, start[0], start[1], tail)
            return WALL, 0.0
    floor = CLOSE * slope * length * FINEST
    lack, _ = find_clearest(space, head, frame, length, needed, slope, planar, floor, BUDGET, tail)
    if lack <= 0.0:
        return SEARCHED, 0.0
    return INFEASIBLE, lack


@kernel
def place_tail(space, head, old, length, needed, slope, planar, work, tail):
    """One constrained link step (thesis eq. 5.15).

    Fill `tail` with the point at `length` from `head`, in the duct with at least `needed` to the
    wall, that is nearest to `old`: in the plane (`planar`) by marching both ways, in space by a
    local step, and by a search of all directions where that fails or turns far. ``slope`` bounds
    how fast the duct's value changes; ``work`` is a (6, 5) scratch array.

    Returns
    -------
    code : int
        0 free (the tractrix step is feasible), 1 at the wall, 2 found by the global search only,
        3 infeasible: no direction found, nor one that has 1e-5 of the length to spare (on a
        sampled field sqrt(3) times that), unless the search ran out; `tail` is the best one.
    lack : float
        For code 3 how much clearance lacks at least on the sphere, to 0.01 mm or 1 %, else 0.
    """
    frame = work[:3]
    make_frame(head, old, planar, frame)
    for n in range(3):
        tail[n] = head[n] + length * frame[0, n]
    if needed - space_estimate(space, tail[0], tail[1], tail[2]) <= 0.0:
        return FREE, 0.0
    known = np.inf
    if not planar:
        start = work[0, 3:]
        start[0] = 0.0
        start[1] = 0.0
        ok, turn = _local_step(space, head, frame, length, needed, start, work[3:6], tail)
        if ok:
            known = turn
            if turn <= NEARBY:
                return WALL, 0.0
    return _search(space, head, length, needed, slope, planar, known, work, tail)


DONE = 0
BUFFER_FULL = 1
HEAD_BLOCKED = 2
LINK_INFEASIBLE = 3
LINK_LOCKED = 4


@kernel
def _point_on_path(path, arc, s, where, point):
    """Fill `point` with the path's point at arc length `s`; `where` is the last segment used."""
    n = arc.shape[0]
    while where < n - 2 and arc[where + 1] < s:
        where += 1
    span = arc[where + 1] - arc[where]
    u = min(max((s - arc[where]) / span, 0.0), 1.0)
    for k in range(3):
        point[k] = path[where, k] + u * (path[where + 1, k] - path[where, k])
    return where


@kernel
def advance_chain(
    space,
    path,
    arc,
    length,
    needed,
    slope,
    planar,
    head_step,
    jump,
    chain,
    state,
    out,
    trail,
):
    """Advance the head along the path and let every next joint follow (thesis 5.3, corrected).

    A joint that would move by more than `jump` has its head step halved, down to 1/64; if the
    jump does not shrink below `jump` then, the link is locked.

    Parameters
    ----------
    space : named tuple
        The packed free space.
    slope, planar
        As for `place_tail`.
    chain : (joints, 3) float
        The chain, updated in place to the last accepted step.
    state : (4,) float
        In and out: head arc length of the last accepted step, link index, value (how much clearance
        lacks, or jump), and where the head was in the step that failed.
    out : (rows, joints, 3) float
        Filled with accepted steps.
    trail : (rows,) float
        Filled with the head's arc length at each.

    Returns
    -------
    code : int
        Why it returned.
    rows : int
        How many rows were filled.
    """
    joints = chain.shape[0]
    trial = np.empty_like(chain)
    work = np.empty((6, 5))
    where = 0
    rows = 0
    end = arc[-1]
    s = state[0]
    size = head_step
    floor = head_step / 64.0
    while s < end - 1e-12:
        if rows == out.shape[0]:
            state[0] = s
            return BUFFER_FULL, rows
        target = min(s + size, end)
        where = _point_on_path(path, arc, target, where, trial[0])
        depth = -space_estimate(space, trial[0, 0], trial[0, 1], trial[0, 2])
        if depth + needed > 0.0:
            if size > floor:
                size *= 0.5
                where = 0
                continue
            state[0] = s
            state[2] = depth
            state[3] = target
            return HEAD_BLOCKED, rows
        code = 0
        value = 0.0
        link = 0
        for j in range(1, joints):
            code, value = place_tail(
                space, trial[j - 1], chain[j], length, needed, slope, planar, work, trial[j]
            )
            move = math.sqrt(
                (trial[j, 0] - chain[j, 0]) ** 2
                + (trial[j, 1] - chain[j, 1]) ** 2
                + (trial[j, 2] - chain[j, 2]) ** 2
            )
            if code == INFEASIBLE:
                link = j
                break
            if move > jump:
                code = LINK_LOCKED
                value = move
                link = j
                break
        if code >= LINK_INFEASIBLE:
            if size > floor:
                size *= 0.5
                where = 0
                continue
            state[0] = s
            state[1] = link
            state[2] = value
            state[3] = target
            return code, rows
        s = target
        for j in range(joints):
            for k in range(3):
                chain[j, k] = trial[j, k]
                out[rows, j, k] = trial[j, k]
        trail[rows] = s
        rows += 1
        size = min(2.0 * size, head_step)
    state[0] = s
    return DONE, rows


@kernel
def _lies_in(introducer, x, y, z):
    """Return whether a point lies behind the entry and in the bore."""
    along, off = split_along(introducer, x, y, z)
    return along >= 0.0 and off <= introducer[6]


@kernel
def measure_body(space, chains, radius, pitch, clearance, worst):
    """Estimate the clearance of every link of every step by samples along the links.

    The tail end of the chain that still is in the introducer is left out: from the tail towards
    the head, everything up to the first sample that is ahead of the entry or outside the bore.

    Parameters
    ----------
    space : named tuple
        The packed free space.
    chains : (steps, joints, 3) float
    radius : float
        Of the body [mm].
    pitch : float
        Largest distance between samples [mm].
    clearance : (steps, joints - 1) float
        Filled; infinite for links wholly in the introducer.
    worst : (4,) float
        Filled with the place (3,) of the smallest clearance, and its value.
    """
    duct, introducer = space
    worst[3] = np.inf
    for t in range(chains.shape[0]):
        waiting = introducer[6] > 0.0
        for j in range(chains.shape[1] - 1, 0, -1):
            ax, ay, az = chains[t, j, 0], chains[t, j, 1], chains[t, j, 2]
            dx = chains[t, j - 1, 0] - ax
            dy = chains[t, j - 1, 1] - ay
            dz = chains[t, j - 1, 2] - az
            size = math.sqrt(dx * dx + dy * dy + dz * dz)
            parts = max(1, int(math.ceil(size / pitch - 1e-6)))
            least = np.inf
            if waiting and (
                _lies_in(introducer, ax, ay, az) and _lies_in(introducer, ax + dx, ay + dy, az + dz)
            ):
                clearance[t, j - 1] = least  # so does all between: the tube is convex
                continue
            skip = 0
            for m in range(parts + 1):
                if skip > 0:
                    # The interpolant falls by at most sqrt(3) per mm: nothing less can be here.
                    skip -= 1
                    continue
                u = m / parts
                x = ax + u * dx
                y = ay + u * dy
                z = az + u * dz
                if waiting:
                    if _lies_in(introducer, x, y, z):
                        continue
                    waiting = False
                gap = clearance_estimate(duct, x, y, z) - radius
                skip = int(max(gap - least, 0.0) * parts / (1.7321 * max(size, 1e-9)))
                if gap < least:
                    least = gap
                    if gap < worst[3]:
                        worst[0] = x
                        worst[1] = y
                        worst[2] = z
                        worst[3] = gap
            clearance[t, j - 1] = least


@kernel
def measure_moves(joints, heads):
    """Measure the moves of a chain, joints (steps, joints, dim) and its head's way (steps,).

    Returns
    -------
    largest, ratio, travel, angle : float
        Largest move of a joint in a step, the same over the head's where that moves, the sum of
        all moves, and the largest angle between neighbouring links.
    """
    steps, count, dim = joints.shape
    largest = ratio = travel = 0.0
    for t in range(1, steps):
        step = 0.0
        for j in range(count):
            square = 0.0
            for q in range(dim):
                square += (joints[t, j, q] - joints[t - 1, j, q]) ** 2
            travel += math.sqrt(square)
            step = max(step, square)
        step = math.sqrt(step)
        head = abs(heads[t] - heads[t - 1])
        largest = max(largest, step)
        if head > 1e-9:
            ratio = max(ratio, step / head)
    # Of unit vectors a and b: |a - b| over |a + b| keeps full accuracy near 0 and pi.
    apart, together = 0.0, 1.0
    before, now = np.zeros(dim), np.zeros(dim)
    for t in range(steps):
        for j in range(1, count):
            square = 0.0
            for q in range(dim):
                now[q] = joints[t, j, q] - joints[t, j - 1, q]
                square += now[q] * now[q]
            scale = 1.0 / math.sqrt(max(square, 1e-300))
            less = more = 0.0
            for q in range(dim):
                now[q] *= scale
                less += (before[q] - now[q]) ** 2
                more += (before[q] + now[q]) ** 2
                before[q] = now[q]
            if j > 1 and less * together > apart * more:
                apart, together = less, more
    return largest, ratio, travel, 2.0 * math.atan2(math.sqrt(apart), math.sqrt(together))
