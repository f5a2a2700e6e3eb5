"""Numba kernels for one constrained link: the tail that moves least, at its distance, in the duct.

All points are in the field's own frame. The duct is the sampled field united with the introducer,
a ray from ``entry`` along ``outward`` with radius ``bore`` (a capsule, exact distance); a bore
of 0 or less means no introducer. ``duct`` in comments is the minimum of both distances.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ..duct._kernels import field_and_gradient, field_value

__all__ = ["duct_and_gradient", "duct_value", "place_tail"]

TOLERANCE = 1e-9
"""Feasibility and convergence tolerance of the link step [mm]."""

SMOOTH_ITERATIONS = 10
MAX_ITERATIONS = 40


@njit(cache=True)
def duct_value(values, step, inflation, intro, x, y, z):
    """Signed distance to the lumen united with the introducer.

    ``step`` holds the three spacings; ``intro`` the entry, the outward unit vector and the bore.
    """
    s = field_value(values, step[0], step[1], step[2], inflation, x, y, z)
    if intro[6] > 0.0:
        dx = x - intro[0]
        dy = y - intro[1]
        dz = z - intro[2]
        t = max(dx * intro[3] + dy * intro[4] + dz * intro[5], 0.0)
        dx -= t * intro[3]
        dy -= t * intro[4]
        dz -= t * intro[5]
        s = min(s, math.sqrt(dx * dx + dy * dy + dz * dz) - intro[6])
    return s


@njit(cache=True)
def duct_and_gradient(values, step, inflation, intro, x, y, z):
    """Signed distance to the lumen united with the introducer, and its gradient."""
    s, gx, gy, gz = field_and_gradient(values, step[0], step[1], step[2], inflation, x, y, z)
    if intro[6] > 0.0:
        dx = x - intro[0]
        dy = y - intro[1]
        dz = z - intro[2]
        t = max(dx * intro[3] + dy * intro[4] + dz * intro[5], 0.0)
        dx -= t * intro[3]
        dy -= t * intro[4]
        dz -= t * intro[5]
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        if distance - intro[6] < s:
            s = distance - intro[6]
            scale = 1.0 / max(distance, 1e-12)
            gx = dx * scale
            gy = dy * scale
            gz = dz * scale
    return s, gx, gy, gz


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
def _local_step(values, step, inflation, intro, head, w, e, f, length, room, start_c, cuts, tail):
    """Minimise the turn from direction `w` subject to the duct; a bundle of linear cuts in 2-D.

    Unknown: the normal coordinates (a, b) of the direction around `w`, whose norm is the angle,
    so the objective is exact. Each evaluation gives a linear cut. Where the field is smooth the
    newest cut alone converges. Where the iterates keep moving, at a kink of the trilinear field,
    up to three are kept as long as they were made near the iterate on the scale of its last move,
    which settles the kink as a corner of half-planes.
    Returns (converged, angle).
    """
    a = 0.0
    b = 0.0
    c = start_c
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
        c, gx, gy, gz = duct_and_gradient(values, step, inflation, intro, tail[0], tail[1], tail[2])
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
def _ring_search(values, step, inflation, intro, head, w, e, f, length, room, resolution, tail):
    """Search the sphere ring by ring outwards from `w` for the nearest feasible direction.

    A ring is passed over only as far as the field's slope (at most sqrt(3) for the interpolant)
    and the distance of its samples allow, but at least by `resolution`.
    Returns (found, angle, best): `best` is the smallest constraint value seen, and `tail` the
    nearest feasible point, or the best one if none is feasible.
    """
    slope = math.sqrt(3.0) * length
    best = np.inf
    bx, by, bz = 0.0, 0.0, 0.0
    angle = 0.0
    last = 0.0
    while angle <= math.pi:
        around = max(1, int(math.ceil(2.0 * math.pi * math.sin(angle) / resolution)))
        ca = math.cos(angle)
        sa = math.sin(angle)
        ring = np.inf
        for m in range(around):
            phi = 2.0 * math.pi * m / around
            cp = math.cos(phi) * sa
            sp = math.sin(phi) * sa
            x = head[0] + length * (ca * w[0] + cp * e[0] + sp * f[0])
            y = head[1] + length * (ca * w[1] + cp * e[1] + sp * f[1])
            z = head[2] + length * (ca * w[2] + cp * e[2] + sp * f[2])
            c = duct_value(values, step, inflation, intro, x, y, z) + room
            ring = min(ring, c)
            if c < best:
                best = c
                bx, by, bz = x, y, z
            if c <= 0.0:
                # bisect back along this meridian to where it becomes feasible
                low = last
                high = angle
                while high - low > 1e-12:
                    mid = 0.5 * (low + high)
                    sm = math.sin(mid)
                    cm = math.cos(mid)
                    cp = math.cos(phi) * sm
                    sp = math.sin(phi) * sm
                    mx = head[0] + length * (cm * w[0] + cp * e[0] + sp * f[0])
                    my = head[1] + length * (cm * w[1] + cp * e[1] + sp * f[1])
                    mz = head[2] + length * (cm * w[2] + cp * e[2] + sp * f[2])
                    if duct_value(values, step, inflation, intro, mx, my, mz) + room <= 0.0:
                        high = mid
                        x, y, z = mx, my, mz
                    else:
                        low = mid
                tail[0] = x
                tail[1] = y
                tail[2] = z
                return True, high, c
        last = angle
        gap = ring / slope - 0.5 * resolution
        angle += max(gap, resolution)
    tail[0] = bx
    tail[1] = by
    tail[2] = bz
    return False, math.pi, best


@njit(cache=True)
def place_tail(values, step, inflation, intro, head, old, length, room, work, tail):
    """One constrained link step (thesis eq. 5.15).

    Fill `tail` with the point at `length` from `head`, in the duct with at least `room` to the
    wall, that is nearest to `old`. ``work`` is a (6, 5) scratch array.

    Returns
    -------
    code : int
        0 free (the tractrix step is feasible), 1 at the wall, 2 found by the global search only,
        3 infeasible: no direction is feasible, `tail` is the best one.
    best : float
        For code 3 the smallest value of ``duct + room`` found on the sphere [mm], else 0.
    """
    w = work[0, :3]
    e = work[1, :3]
    f = work[2, :3]
    dx = old[0] - head[0]
    dy = old[1] - head[1]
    dz = old[2] - head[2]
    size = math.sqrt(dx * dx + dy * dy + dz * dz)
    w[0] = dx / size
    w[1] = dy / size
    w[2] = dz / size
    for n in range(3):
        tail[n] = head[n] + length * w[n]
    c = duct_value(values, step, inflation, intro, tail[0], tail[1], tail[2]) + room
    if c <= 0.0:
        return 0, 0.0
    _frame(w, e, f)
    ok, _ = _local_step(
        values, step, inflation, intro, head, w, e, f, length, room, c, work[3:6], tail
    )
    if ok:
        return 1, 0.0
    found, _, best = _ring_search(
        values, step, inflation, intro, head, w, e, f, length, room, 0.02, tail
    )
    if found:
        return 2, 0.0
    return 3, best
