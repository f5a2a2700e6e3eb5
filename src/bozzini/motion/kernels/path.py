"""Numba kernels for the head path: shape it for a link length, and tabulate the free tube.

The path is a polyline whose first points lie in the introducer. Its *chords* join each point to
the first point behind it at distance L: where a link lies when all joints follow the path. Free
space is the lumen united with the introducer; all bounds are rigorous (`clearance_bound`).
"""

from __future__ import annotations

import math

import numpy as np

from ...duct.kernels.clearance import clearance_slope, space_bound
from ...numeric.compiling import kernel

TRACE_STEP = 0.25
"""Smallest step of a sphere trace along a chord [mm]."""


@kernel
def tail_on_path(path, i, length):
    """Return (k, w): the first point behind vertex i at distance `length` is P_k + w (P_k+1 - P_k).

    k is -1 if the path ends before.
    """
    x, y, z = path[i, 0], path[i, 1], path[i, 2]
    square = length * length
    k = i - 1
    while k >= 0:
        ax = path[k, 0] - x
        ay = path[k, 1] - y
        az = path[k, 2] - z
        if ax * ax + ay * ay + az * az >= square:
            bx = path[k + 1, 0] - path[k, 0]
            by = path[k + 1, 1] - path[k, 1]
            bz = path[k + 1, 2] - path[k, 2]
            bb = bx * bx + by * by + bz * bz
            ab = ax * bx + ay * by + az * bz
            aa = ax * ax + ay * ay + az * az
            w = (-ab - math.sqrt(max(ab * ab - bb * (aa - square), 0.0))) / max(bb, 1e-300)
            if w < 0.0 or w > 1.0:
                w = (-ab + math.sqrt(max(ab * ab - bb * (aa - square), 0.0))) / max(bb, 1e-300)
            return k, min(max(w, 0.0), 1.0)
        k -= 1
    return -1, 0.0


@kernel
def trace_chord(space, ax, ay, az, bx, by, bz, needed, pitch, stop):
    """Return (least, u): the smallest bound seen from a to b, and where.

    Wide places are passed in steps of 0.7 times the bound minus `needed`, so `least` is exact only
    where it is near or below `needed`; no step is smaller than `pitch`. The trace ends early where
    the bound is `stop` or less.
    """
    dx = bx - ax
    dy = by - ay
    dz = bz - az
    size = math.sqrt(dx * dx + dy * dy + dz * dz)
    t = 0.0
    least = np.inf
    where = 0.0
    while True:
        u = min(t / max(size, 1e-12), 1.0)
        g = space_bound(space, ax + u * dx, ay + u * dy, az + u * dz)
        if g < least:
            least = g
            where = u
        if t >= size or g <= stop:
            return least, where
        t = min(t + max(0.7 * (g - needed), pitch), size)


@kernel
def check_chords(space, path, first, length, needed, clearance):
    """Fill `clearance` (n,) with the smallest bound along each vertex's chord; return the worst.

    Vertices before `first` (in the introducer) are taken as clear. Also the vertex itself counts.
    """
    worst = np.inf
    for i in range(path.shape[0]):
        clearance[i] = np.inf
        if i < first:
            continue
        k, w = tail_on_path(path, i, length)
        if k < 0:
            continue
        bx = path[k, 0] + w * (path[k + 1, 0] - path[k, 0])
        by = path[k, 1] + w * (path[k + 1, 1] - path[k, 1])
        bz = path[k, 2] + w * (path[k + 1, 2] - path[k, 2])
        g, _ = trace_chord(
            space, path[i, 0], path[i, 1], path[i, 2], bx, by, bz, needed, TRACE_STEP, -np.inf
        )
        clearance[i] = g
        worst = min(worst, g)
    return worst


@kernel
def _push(path, first, centre, weight, reach, px, py, pz):
    """Move the points around `centre` by `weight` times p, tapering off over `reach` points."""
    last = path.shape[0] - 1
    for k in range(-reach, reach + 1):
        i = centre + k
        if i > first and i < last:
            h = weight * (1.0 - abs(k) / (reach + 1.0))
            path[i, 0] += h * px
            path[i, 1] += h * py
            path[i, 2] += h * pz


@kernel
def relax_path(space, path, first, length, needed, sweeps, tension, reach):
    """Run sweeps of an elastic band that bends the path until every chord is clear by `needed`.

    Parameters
    ----------
    path : (n, 3) float
        Changed in place; vertices up to `first` and the last one stay.
    sweeps : int
    tension : float
        Pull towards the middle of the neighbours; decays to 0 over the first 70 % of the sweeps.
    reach : int
        A push is spread over this many points to each side.

    Returns
    -------
    worst : float
        Smallest chord bound seen in the last sweep.
    """
    n = path.shape[0]
    pitch = max(TRACE_STEP, length / 40.0)
    worst = -np.inf
    # A chord seen with clearance to spare is left alone until the path may have moved that much.
    drift = 0.0
    wake = np.zeros(n)
    seen = np.full(n, np.inf)
    for sweep in range(sweeps):
        alpha = tension * max(0.0, 1.0 - sweep / (0.7 * sweeps))
        if alpha > 0.0:
            for _ in range(2):
                largest = 0.0
                ox, oy, oz = path[first, 0], path[first, 1], path[first, 2]
                for i in range(first + 1, n - 1):
                    cx, cy, cz = path[i, 0], path[i, 1], path[i, 2]
                    dx = alpha * (0.5 * (ox + path[i + 1, 0]) - cx)
                    dy = alpha * (0.5 * (oy + path[i + 1, 1]) - cy)
                    dz = alpha * (0.5 * (oz + path[i + 1, 2]) - cz)
                    path[i, 0] += dx
                    path[i, 1] += dy
                    path[i, 2] += dz
                    largest = max(largest, dx * dx + dy * dy + dz * dz)
                    ox, oy, oz = cx, cy, cz
                drift += math.sqrt(largest)
        worst = np.inf
        pushed = 0.0
        for order in range(n - first):
            i = first + order if sweep % 2 == 0 else n - 1 - order
            if drift + pushed < wake[i]:
                worst = min(worst, seen[i])
                continue
            k, w = tail_on_path(path, i, length)
            if k < 0:
                continue
            bx = path[k, 0] + w * (path[k + 1, 0] - path[k, 0])
            by = path[k, 1] + w * (path[k + 1, 1] - path[k, 1])
            bz = path[k, 2] + w * (path[k + 1, 2] - path[k, 2])
            ax, ay, az = path[i, 0], path[i, 1], path[i, 2]
            g, u = trace_chord(space, ax, ay, az, bx, by, bz, needed, pitch, -np.inf)
            worst = min(worst, g)
            if g >= needed:
                # Between samples there is at least 0.3 of this to spare; a chord's tail moves up
                # to a few times as far as the path.
                wake[i] = drift + pushed + 0.1 * (g - needed)
                seen[i] = g
            else:
                x = ax + u * (bx - ax)
                y = ay + u * (by - ay)
                z = az + u * (bz - az)
                _, gx, gy, gz = clearance_slope(space.lumen, x, y, z)
                slope = gx * gx + gy * gy + gz * gz
                if slope < 1e-6:
                    continue
                here = 1.0 - u
                there0 = u * (1.0 - w)
                there1 = u * w
                norm = (here * here + there0 * there0 + there1 * there1) * slope
                push = (needed - g) / norm
                limit = 1.0 / math.sqrt(slope)
                push = min(push, limit)
                pushed = max(pushed, 2.0 * push * math.sqrt(slope))
                px, py, pz = push * gx, push * gy, push * gz
                _push(path, first, i, here, reach, px, py, pz)
                _push(path, first, k, there0, reach, px, py, pz)
                _push(path, first, k + 1, there1, reach, px, py, pz)
        drift += pushed
        if worst >= needed and alpha == 0.0:
            break
    return worst


@kernel
def tabulate_tube(space, path, first, length, needed, cap, slope, tube):
    """Tabulate m: how far joints may stray from the path, all links staying clear by `needed`.

    m(s) is the largest e such that each chord from p(s) to a p(s') behind it with
    ||p(s) - p(s')| - L| <= e has a clearance of needed + e; it is min over s' of
    max(clearance - needed, ||p(s) - p(s')| - L|), capped, and made Lipschitz with `slope`.
    """
    n = path.shape[0]
    pitch = max(TRACE_STEP, length / 40.0)
    for i in range(n):
        if i < first:
            tube[i] = max(0.0, min(cap, space.introducer[6] - needed))
            continue
        m = cap
        if i > 0:
            # The slope would cut it down to this afterwards anyway.
            ds = math.sqrt(
                (path[i, 0] - path[i - 1, 0]) ** 2
                + (path[i, 1] - path[i - 1, 1]) ** 2
                + (path[i, 2] - path[i - 1, 2]) ** 2
            )
            m = min(m, tube[i - 1] + slope * ds)
        ax, ay, az = path[i, 0], path[i, 1], path[i, 2]
        near = (length - m) ** 2
        k = i - 1
        while k >= 0:
            dx = path[k, 0] - ax
            dy = path[k, 1] - ay
            dz = path[k, 2] - az
            if dx * dx + dy * dy + dz * dz >= near:
                break
            k -= 1
        k = min(k + 1, i - 1)
        while k >= 0:
            dx = path[k, 0] - ax
            dy = path[k, 1] - ay
            dz = path[k, 2] - az
            gap = math.sqrt(dx * dx + dy * dy + dz * dz) - length
            if gap > m:
                break
            g, _ = trace_chord(
                space,
                ax,
                ay,
                az,
                path[k, 0],
                path[k, 1],
                path[k, 2],
                needed + m,
                pitch,
                needed + abs(gap),
            )
            m = min(m, max(g - needed, abs(gap)))
            k -= 1
        tube[i] = max(m, 0.0)
    for i in range(n - 2, -1, -1):
        ds = math.sqrt(
            (path[i, 0] - path[i + 1, 0]) ** 2
            + (path[i, 1] - path[i + 1, 1]) ** 2
            + (path[i, 2] - path[i + 1, 2]) ** 2
        )
        tube[i] = min(tube[i], tube[i + 1] + slope * ds)


@kernel
def measure_tail_cosines(path, first, length, cosines):
    """Fill `cosines` (n,): between each vertex's chord and the path's direction at its tail."""
    for i in range(first, path.shape[0]):
        k, w = tail_on_path(path, i, length)
        if k < 0:
            continue
        cx = path[i, 0] - path[k, 0] - w * (path[k + 1, 0] - path[k, 0])
        cy = path[i, 1] - path[k, 1] - w * (path[k + 1, 1] - path[k, 1])
        cz = path[i, 2] - path[k, 2] - w * (path[k + 1, 2] - path[k, 2])
        dx = path[k + 1, 0] - path[k, 0]
        dy = path[k + 1, 1] - path[k, 1]
        dz = path[k + 1, 2] - path[k, 2]
        size = math.sqrt(cx * cx + cy * cy + cz * cz) * math.sqrt(dx * dx + dy * dy + dz * dz)
        cosines[i] = (cx * dx + cy * dy + cz * dz) / max(size, 1e-300)
