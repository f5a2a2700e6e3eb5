"""Numba kernels for one constrained link: the tail that moves least, at its distance, in the duct.

All points are in the duct's own frame; a duct is packed for `duct._clearance_kernels`. A room that
lacks is the signed distance to the free space (`_direction_kernels`) plus the room asked for.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ._direction_kernels import (
    TOLERANCE,
    duct_and_gradient,
    duct_value,
    find_roomiest,
    march_circle,
    point_tail,
    search_sphere,
)

__all__ = ["FREE", "INFEASIBLE", "SEARCHED", "WALL", "make_frame", "place_tail"]

FREE = 0
WALL = 1
SEARCHED = 2
INFEASIBLE = 3

SMOOTH_ITERATIONS = 10
MAX_ITERATIONS = 40

NEARBY = 0.3
"""A local step that turns by more than this is held against a search of all directions [rad]."""
GAP = 1e-3
"""By how much the search may miss the least turn before it is polished [rad]."""
FINEST = 1e-3
"""Half the side of the smallest square of directions that the search looks at [rad]."""
CLOSE = 0.01
"""What room a refused direction may have to spare, by what moving over the smallest square is."""
BUDGET = 200_000
"""Values of the duct in a search at most."""


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def _local_step(duct, intro, head, frame, length, room, start, cuts, tail):
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
        c, gx, gy, gz = duct_and_gradient(duct, intro, tail[0], tail[1], tail[2])
        c += room
        # derivative along the radial direction and across it
        radial = 0.0
        across = 0.0
        g = (gx, gy, gz)
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
            gap = math.sqrt((cuts[i, 3] - a) ** 2 + (cuts[i, 4] - b) ** 2)
            near = iteration >= SMOOTH_ITERATIONS and gap <= 4.0 * last_move
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


@njit(cache=True)
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


@njit(cache=True)
def _search(duct, intro, head, length, room, slope, planar, known, work, tail):
    """Search all directions, with a local step's turn `known` if it has converged."""
    frame = work[:3]
    start = work[0, 3:]
    if planar:
        found, _ = march_circle(duct, intro, head, frame, length, room, slope, tail)
        if found:
            return WALL, 0.0
    else:
        found, least, _, _ = search_sphere(
            duct, intro, head, frame, length, room, slope, known, GAP, FINEST, BUDGET, start
        )
        if found:
            a = start[0]
            b = start[1]
            ok, turn = _local_step(duct, intro, head, frame, length, room, start, work[3:6], tail)
            if not ok or turn > least:
                point_tail(head, frame, length, a, b, tail)
            return SEARCHED, 0.0
        if known < np.inf:
            point_tail(head, frame, length, start[0], start[1], tail)
            return WALL, 0.0
    floor = CLOSE * slope * length * FINEST
    lack, _ = find_roomiest(
        duct, intro, head, frame, length, room, slope, planar, floor, BUDGET, tail
    )
    if lack <= 0.0:
        return SEARCHED, 0.0
    return INFEASIBLE, lack


@njit(cache=True)
def place_tail(duct, intro, head, old, length, room, slope, planar, work, tail):
    """One constrained link step (thesis eq. 5.15).

    Fill `tail` with the point at `length` from `head`, in the duct with at least `room` to the
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
        For code 3 the least value of ``duct + room`` on the sphere, to 0.01 mm or 1 %, else 0.
    """
    frame = work[:3]
    make_frame(head, old, planar, frame)
    for n in range(3):
        tail[n] = head[n] + length * frame[0, n]
    if duct_value(duct, intro, tail[0], tail[1], tail[2]) + room <= 0.0:
        return FREE, 0.0
    known = np.inf
    if not planar:
        start = work[0, 3:]
        start[0] = 0.0
        start[1] = 0.0
        ok, turn = _local_step(duct, intro, head, frame, length, room, start, work[3:6], tail)
        if ok:
            known = turn
            if turn <= NEARBY:
                return WALL, 0.0
    return _search(duct, intro, head, length, room, slope, planar, known, work, tail)
