"""Numba kernel of the certificate: branch and bound over steps and links, for any saved motion.

The body is the links between joints; between recorded steps joints move along straight lines. A
cell is a range of steps and a range along one link. The clearance at its middle, bounded from
below, minus the farthest that any of its points is from the middle, bounds the whole cell,
because a distance changes no faster than the point moves. Cells that do not decide are split.
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
    for j in range(1, count):
        # One cell for every block of steps, so that no stack grows deep in time.
        block = 0
        while True:
            last = min(block + 16, steps - 1)
            top = 0
            stack[0, 0] = block
            stack[0, 1] = last
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
                if _stands_in_introducer(waiting, j - 1, first, final):
                    continue
                introduced = _comes_from_introducer(waiting, j, first, final)
                if introduced and _cell_in_bore(intro, radius, joints, j, t0, t1, u0, u1):
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
                if g - reach >= found - tolerance or reach <= 0.25 * tolerance:
                    bound = min(bound, g - reach)
                    continue
                if used >= budget:
                    code = UNRESOLVED
                    bound = min(bound, g - reach)
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
            block = last
            if block >= steps - 1:
                break
    return code, bound, found, used
