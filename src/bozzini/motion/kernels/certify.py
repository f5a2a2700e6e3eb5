"""Numba kernel of the certificate: branch and bound over steps and links, for any saved motion.

The body is the links between joints; between recorded steps joints move along straight lines. A
cell is a range of steps and a range along one link. The clearance at its middle, bounded from
below, minus the farthest that any of its points is from the middle, bounds the whole cell,
because a distance changes no faster than the point moves. Cells that do not decide are split.

Most of the body only follows. Let link j, from step t to t + 1, be matched with the motion of link
j - 1 over some span of earlier time, such that its two joints are never farther than delta from
those of link j - 1. A point at the same fraction of both links is a mean of the joints, so it is
within delta too, and link j has at least the clearance proved for link j - 1 in that span, less
delta. Both motions are polygons; cut at the corners of both, each piece is linear in one parameter
common to both, so the distance between them is convex there and largest at a corner. Any match is
sound, the nearest one is tried; a link is looked at itself where that does not decide.
"""

from __future__ import annotations

import math

import numpy as np

from ...duct.kernels.clearance import clearance_bound, split_along
from ...numeric.compiling import kernel

RESOLVED = 0
UNRESOLVED = 1


@kernel
def _in_bore(intro, radius, x, y, z):
    """Whether the body around a point lies in the bore, behind the entry plane."""
    a, off = split_along(intro, x, y, z)
    return a >= 0.0 and off <= intro[6] - radius + 1e-9


@kernel
def _through_mouth(intro, p, q):
    """Whether the way from p to q comes within the bore's radius of the entry."""
    dd = 0.0
    pd = 0.0
    for k in range(3):
        d = q[k] - p[k]
        dd += d * d
        pd += d * (intro[k] - p[k])
    w = min(max(pd / dd, 0.0), 1.0) if dd > 0.0 else 0.0
    gap = 0.0
    for k in range(3):
        gap += (p[k] + w * (q[k] - p[k]) - intro[k]) ** 2
    return gap <= intro[6] * intro[6]


@kernel
def mark_introduced(joints, intro, radius, waiting):
    """Fill `waiting` (steps,): joints from this index on stand in the introducer.

    A joint does if the body around it is in the bore, all joints behind it are too, it was there
    from the start or came in through the mouth, and the first link in front leaves through the
    mouth: a tract that passes through the bore's straight continuation farther out is no
    introducer.

    Returns
    -------
    needed : float
        Radius of bore that these joints need: of the one farthest from the axis, plus the body's
        radius; 0 if there is none.
    """
    count = joints.shape[1]
    needed = 0.0
    for t in range(joints.shape[0]):
        k = count
        if intro[6] > 0.0:
            while k > 0:
                x, y, z = joints[t, k - 1, 0], joints[t, k - 1, 1], joints[t, k - 1, 2]
                if not _in_bore(intro, radius, x, y, z):
                    break
                if (
                    t > 0
                    and k - 1 < waiting[t - 1]
                    and not _through_mouth(intro, joints[t - 1, k - 1], joints[t, k - 1])
                ):
                    break
                _, off = split_along(intro, x, y, z)
                needed = max(needed, off + radius)
                k -= 1
            # The link that leaves the bore must do so at the mouth, not sideways farther out.
            if 0 < k < count and not _through_mouth(intro, joints[t, k], joints[t, k - 1]):
                k = count
        waiting[t] = k
    return needed


@kernel
def _stands_in_introducer(waiting, j, first, last):
    """Whether joint j stands in the introducer at every step from `first` to `last`."""
    for t in range(first, last + 1):
        if j < waiting[t]:
            return False
    return True


@kernel
def _comes_from_introducer(waiting, j, first, last):
    """Whether joint j stands in the introducer at one end of every step, or at both."""
    if first == last:
        return j >= waiting[first]
    for t in range(first, last):
        if j < waiting[t] and j < waiting[t + 1]:
            return False
    return True


@kernel
def _cell_in_bore(intro, radius, joints, j, t0, t1, u0, u1):
    """Whether a whole cell lies in the bore: it is convex, and the cell between its corners."""
    steps = joints.shape[0]
    t = t0
    while True:
        n = min(int(t), steps - 1)
        m = min(n + 1, steps - 1)
        f = t - n
        for side in range(2):
            u = u0 if side == 0 else u1
            x = np.empty(3)
            for q in range(3):
                a = joints[n, j, q] + f * (joints[m, j, q] - joints[n, j, q])
                b = joints[n, j - 1, q] + f * (joints[m, j - 1, q] - joints[n, j - 1, q])
                x[q] = a + u * (b - a)
            if not _in_bore(intro, radius, x[0], x[1], x[2]):
                return False
        if t >= t1:
            return True
        t = min(math.floor(t) + 1.0, t1)


BLOCK = 16
"""So many steps are looked at together."""

CORNERS = 16
"""A step is not matched with a span of time that has more recorded steps within."""

RESERVE = 0.1
"""Links that others are compared with keep this share of the tolerance for them."""

FINER = 0.5
"""Share of the tolerance for what others will follow, so that they have something to lose, ..."""

CLOSE = 0.25
"""... which are those that come within this share of the tolerance of another link."""

DONE, LOOK, LOOK_FINER = 0, 1, 2

ROUND_OFF = 1e-9
"""Taken off each bound that is passed on: more than the arithmetic of a match can err [mm]."""


@kernel
def _find_place(joints, link, n, pair, last):
    """Return (m, u): link `link` stood nearest to the joints `pair` (6,) at step m + u.

    The search goes downhill from step n, up to step `last`.
    """
    turn = 0
    while True:
        dot = 0.0
        square = 0.0
        for q in range(3):
            a, b = joints[n, link - 1, q], joints[n, link, q]
            da, db = joints[n + 1, link - 1, q] - a, joints[n + 1, link, q] - b
            dot += da * (pair[q] - a) + db * (pair[q + 3] - b)
            square += da * da + db * db
        if dot > square and turn >= 0 and n + 1 < last:
            turn = 1
            n += 1
        elif dot < 0.0 and turn <= 0 and n > 0:
            turn = -1
            n -= 1
        else:
            return n, min(max(dot / square, 0.0), 1.0) if square > 0.0 else 0.0


@kernel
def _measure_gap(joints, j, t, f, r, n, u):
    """Return how far link j at step t + f is from link r at step n + u, at the worse joint."""
    worst = 0.0
    for i in range(2):
        square = 0.0
        for q in range(3):
            own = joints[t, j - i, q]
            if f > 0.0:
                own += f * (joints[t + 1, j - i, q] - own)
            other = joints[n, r - i, q]
            if u > 0.0:
                other += u * (joints[n + 1, r - i, q] - other)
            square += (own - other) ** 2
        worst = max(worst, square)
    return math.sqrt(worst)


@kernel
def _measure_corner(joints, j, t, r, n):
    """Return how far link j is, between steps t and t + 1, from link r at step n, at least."""
    dot = 0.0
    square = 0.0
    for i in range(2):
        for q in range(3):
            d = joints[t + 1, j - i, q] - joints[t, j - i, q]
            dot += d * (joints[n, r - i, q] - joints[t, j - i, q])
            square += d * d
    f = min(max(dot / square, 0.0), 1.0) if square > 0.0 else 0.0
    return _measure_gap(joints, j, t, f, r, n, 0.0)


@kernel
def _learn(known, j, first, final, value):
    """Lower what is known of link j from step `first` to `final` to a bound."""
    value -= abs(value) * 2.0**-22  # rounded down to float32
    for t in range(first, final):
        known[t, j] = min(known[t, j], value)


@kernel
def _follow(joints, known, j, r, n, block, last, target, close, task):
    """Bound link j from step `block` to `last` by what link r, before it, has been proved to have.

    Parameters
    ----------
    n : int
        Near which step link r stood where j stands at `block`.
    target : float
        Bounds below this are of no use.
    close : float
        Distance between the links up to which it is worth to look at link j finer.
    task : (BLOCK,) int
        What is still to be done about each step, updated.

    Returns
    -------
    bound : float
        Of the steps that are bounded here.
    n : int
        As given, at `last`.
    """
    pair = np.empty(6)
    gap = u = 0.0
    bound = np.inf
    for t in range(block, last + 1):
        for q in range(3):
            pair[q] = joints[t, j - 1, q]
            pair[q + 3] = joints[t, j, q]
        m, v = _find_place(joints, r, n, pair, last)
        gap_then = _measure_gap(joints, j, t, 0.0, r, m, v)
        k = t - 1 - block
        if t > block and task[k] != DONE:
            # From (n, u) to (m, v), over the corners between, in either direction.
            low, high = (n, m) if n <= m else (m, n)
            if high - low <= CORNERS:
                gap = max(gap, gap_then)
                least = known[low, r]
                for corner in range(low + 1, high + 1):
                    gap = max(gap, _measure_corner(joints, j, t - 1, r, corner))
                    if corner < high or (v if high == m else u) > 0.0:
                        least = min(least, known[corner, r])
                if gap < close:
                    task[k] = LOOK_FINER
                least -= gap + ROUND_OFF
                if least >= target:
                    bound = min(bound, least)
                    known[t - 1, j] = np.inf
                    _learn(known, j, t - 1, t, least)
                    task[k] = DONE
        n, u, gap = m, v, gap_then
    return bound, n


@kernel
def bound_motion(space, joints, radius, tolerance, budget, worst):
    """Bound the clearance of the whole body over a motion from below.

    Parameters
    ----------
    space : named tuple
        The packed free space, with the bore that is exempt from the wall.
    joints : (steps, joints, 3) float
        In the duct's own frame.
    radius : float
        Of the body [mm].
    tolerance : float
        The bound is refined until it is this near to the smallest clearance found [mm].
    budget : int
        Evaluations of the field at most.
    worst : (6,) float
        Filled: step, link, fraction from the tail joint, and the point of the smallest clearance.

    Returns
    -------
    code : int
    bound : float
        No point of the body comes nearer to the wall than this minus ``radius``.
    found : float
        Smallest bound of the clearance found at a point.
    used : int
        Evaluations.
    """
    steps, count, _ = joints.shape
    waiting = np.empty(steps, np.int64)
    duct, intro = space.lumen, space.introducer.copy()
    found = np.inf
    bound = np.inf
    worst[:] = 0.0
    used = 0
    needed = mark_introduced(joints, intro, radius, waiting)
    if needed > 0.0:
        # A bore wider than the lumen at the entry counts only as far as the scope needs it; if
        # it does need it, the introducer's round end is in the wall.
        g = clearance_bound(duct, intro[0], intro[1], intro[2])
        intro[6] = min(intro[6], max(g, needed))
        used += 1
        if g < intro[6]:
            found = g - intro[6] + radius
            bound = found
            worst[1] = 1.0
            worst[3], worst[4], worst[5] = intro[0], intro[1], intro[2]
    # A first look at joints, to have something to compare with.
    for t in range(0, steps, max(1, steps // 200)):
        for j in range(min(waiting[t], count)):
            g = clearance_bound(duct, joints[t, j, 0], joints[t, j, 1], joints[t, j, 2])
            used += 1
            if g < found:
                found = g
                worst[0], worst[1], worst[2] = t, max(j, 1), 0.0 if j > 0 else 1.0
                worst[3], worst[4], worst[5] = joints[t, j, 0], joints[t, j, 1], joints[t, j, 2]
    size = 256
    stack = np.empty((size, 5))
    code = RESOLVED
    # Proved of each link between a step and the next; -inf where nothing is.
    known = np.full((max(steps - 1, 1), count), -np.inf, dtype=np.float32)
    task = np.empty(BLOCK, np.int64)
    place = np.full(count, -1)
    lag = 0
    # One cell for every block of steps, so that no stack grows deep in time.
    block = 0
    while True:
        last = min(block + BLOCK, steps - 1)
        fewest = most = waiting[block]
        for t in range(block, last + 1):
            fewest = min(fewest, waiting[t])
            most = max(most, waiting[t])
        for j in range(1, min(most, count - 1) + 1):
            for k in range(BLOCK):
                task[k] = LOOK_FINER if j == 1 and steps > BLOCK else LOOK
            if 1 < j < fewest and last > block:
                # j less its lowest bit, or half of it: a bound is passed on a few times only.
                r = j & (j - 1)
                r = r if r > 0 else j // 2
                n = place[j] if place[j] >= 0 else max(last - 1 - (j - r) * lag, 0)
                target = found - tolerance * (1.0 if j % 2 == 1 else 1.0 - RESERVE)
                close = CLOSE * tolerance
                least, n = _follow(joints, known, j, r, n, block, last, target, close, task)
                bound = min(bound, least)
                place[j] = n
                lag = (last - n) // (j - r)
                if r < j - 1 and task[: last - block].any():
                    r, n = j - 1, max(last - 1 - lag, 0)
                    least, _ = _follow(joints, known, j, r, n, block, last, target, close, task)
                    bound = min(bound, least)
            begin = block
            while begin < max(last, block + 1):
                kind = task[begin - block]
                if kind == DONE:
                    begin += 1
                    continue
                within = tolerance * (FINER if kind == LOOK_FINER else 1.0)
                end = begin
                while end < last and task[end - block] == kind:
                    end += 1
                    known[end - 1, j] = np.inf
                stack[0, 0] = begin
                stack[0, 1] = end
                stack[0, 2] = 0.0
                stack[0, 3] = 1.0
                top = 1
                while top > 0:
                    top -= 1
                    t0 = stack[top, 0]
                    t1 = stack[top, 1]
                    u0 = stack[top, 2]
                    u1 = stack[top, 3]
                    span = t1 - t0
                    # the middle
                    if span >= 2.0:
                        tc = math.floor(0.5 * (t0 + t1))
                    else:
                        tc = 0.5 * (t0 + t1)
                    it = min(int(tc), steps - 1)
                    ft = tc - it
                    jt = min(it + 1, steps - 1)
                    ax = joints[it, j, 0] + ft * (joints[jt, j, 0] - joints[it, j, 0])
                    ay = joints[it, j, 1] + ft * (joints[jt, j, 1] - joints[it, j, 1])
                    az = joints[it, j, 2] + ft * (joints[jt, j, 2] - joints[it, j, 2])
                    bx = joints[it, j - 1, 0] + ft * (joints[jt, j - 1, 0] - joints[it, j - 1, 0])
                    by = joints[it, j - 1, 1] + ft * (joints[jt, j - 1, 1] - joints[it, j - 1, 1])
                    bz = joints[it, j - 1, 2] + ft * (joints[jt, j - 1, 2] - joints[it, j - 1, 2])
                    link = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2 + (bz - az) ** 2)
                    uc = 0.5 * (u0 + u1)
                    x = ax + uc * (bx - ax)
                    y = ay + uc * (by - ay)
                    z = az + uc * (bz - az)
                    # how far the two joints get from where they are at tc
                    ma = 0.0
                    mb = 0.0
                    if span > 1.0:
                        for t in range(int(t0), int(t1) + 1):
                            da = (
                                (joints[t, j, 0] - ax) ** 2
                                + (joints[t, j, 1] - ay) ** 2
                                + (joints[t, j, 2] - az) ** 2
                            )
                            db = (
                                (joints[t, j - 1, 0] - bx) ** 2
                                + (joints[t, j - 1, 1] - by) ** 2
                                + (joints[t, j - 1, 2] - bz) ** 2
                            )
                            ma = max(ma, da)
                            mb = max(mb, db)
                        ma = math.sqrt(ma)
                        mb = math.sqrt(mb)
                    elif span > 0.0:
                        h = int(t0)
                        n = min(h + 1, steps - 1)
                        part = 0.5 * span
                        for q in range(3):
                            ma += (joints[n, j, q] - joints[h, j, q]) ** 2
                            mb += (joints[n, j - 1, q] - joints[h, j - 1, q]) ** 2
                        ma = part * math.sqrt(ma)
                        mb = part * math.sqrt(mb)
                    # at fraction u the point moves by at most (1 - u) ma + u mb
                    drift = max((1.0 - u0) * ma + u0 * mb, (1.0 - u1) * ma + u1 * mb)
                    along = 0.5 * (u1 - u0) * link
                    reach = drift + along
                    first = int(math.floor(t0))
                    final = min(int(math.ceil(t1)), steps - 1)
                    introduced = _comes_from_introducer(waiting, j, first, final)
                    if _stands_in_introducer(waiting, j - 1, first, final) or (
                        introduced and _cell_in_bore(intro, radius, joints, j, t0, t1, u0, u1)
                    ):
                        _learn(known, j, first, final, -np.inf)
                        continue
                    g = clearance_bound(duct, x, y, z)
                    used += 1
                    # Behind the entry plane the bore is the wall, not the lumen's cap.
                    if g < found and not (
                        _comes_from_introducer(waiting, j, it, min(int(math.ceil(tc)), steps - 1))
                        and _in_bore(intro, radius, x, y, z)
                    ):
                        found = g
                        worst[0], worst[1], worst[2] = tc, j, uc
                        worst[3], worst[4], worst[5] = x, y, z
                    settled = g - reach >= found - within or reach <= 0.25 * within
                    if settled or used >= budget:
                        code = code if settled else UNRESOLVED
                        bound = min(bound, g - reach)
                        _learn(known, j, first, final, g - reach)
                        continue
                    if drift > along and span > 0.0:
                        stack[top, 0] = t0
                        stack[top, 1] = tc
                        stack[top, 2] = u0
                        stack[top, 3] = u1
                        stack[top + 1, 0] = tc
                        stack[top + 1, 1] = t1
                        stack[top + 1, 2] = u0
                        stack[top + 1, 3] = u1
                    else:
                        stack[top, 0] = t0
                        stack[top, 1] = t1
                        stack[top, 2] = u0
                        stack[top, 3] = uc
                        stack[top + 1, 0] = t0
                        stack[top + 1, 1] = t1
                        stack[top + 1, 2] = uc
                        stack[top + 1, 3] = u1
                    top += 2
                    if top + 2 > size:
                        code = UNRESOLVED
                        bound = -np.inf
                        return code, bound, found, used
                begin = max(end, begin + 1)
        block = last
        if block >= steps - 1:
            break
    return code, bound, found, used
