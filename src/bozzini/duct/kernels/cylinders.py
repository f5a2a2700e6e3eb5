"""Numba kernels of a chain of connected cylinders: its sign, its coordinates, its nearest wall.

A segment joins two circles by straight rulings. With w = x - c1, a(t) and b(t) the spokes of the
blended circle, a in the plane of the bend and b across it, x lies in the blended disc where
(w - t d) . (a x b) = 0, a quadratic in t. The wall of a segment is its rulings, and that of the
chain all rulings and the two end discs; the discs between segments are none.

The slice of a chain: how many segments, tolerance, both end discs (centre, outward normal,
radius), then `SEGMENT` numbers for each (`cylinders.pack_chain`).
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel

# Numba kernels of the wall of one cylinder segment: the nearest of its rulings, for certain.
#
# The numbers of a segment are those below, from `at` on.

SAMPLES = 12
"""Rulings at which the search begins."""

DEEPEST = 2.0 * math.pi / SAMPLES * 2.0**-26
"""Intervals of angle smaller than this are within the tolerance anyway [rad]."""


@kernel
def _ruling_gap(params, at, ww, wa, wk, wd, wda, c, s):
    """Squared distance to the ruling at the angle with cosine c and sine s."""
    r1 = params[at + 15]
    start = ww - 2.0 * (c * wa + s * r1 * wk) + r1 * r1
    along = (
        wd
        + c * (wda - params[at + 28])
        + s * (params[at + 16] * wk - params[at + 29])
        - c * c * params[at + 33]
        - s * s * params[at + 34]
    )
    square = (
        params[at + 30]
        + 2.0 * (c * params[at + 31] + s * params[at + 32])
        + c * c * params[at + 35]
        + s * s * params[at + 36]
    )
    t = min(max(along / square, 0.0), 1.0)
    return max(start - 2.0 * t * along + t * t * square, 0.0)


@kernel
def search_rulings(params, at, x, y, z, best, tolerance, stack):
    """Return (distance, cosine, sine) of the nearest ruling, if nearer than `best`.

    The squared distance to a ruling, less M theta^2 / 2, is concave in the angle theta: it is the
    least over t of distances to points of blended circles, whose second derivatives are at most
    M. So its values at the ends of an interval bound it from below between them, and intervals
    are halved until none can hold a wall nearer than the best found less `tolerance`.
    """
    wx = x - params[at]
    wy = y - params[at + 1]
    wz = z - params[at + 2]
    ww = wx * wx + wy * wy + wz * wz
    wa = wx * params[at + 6] + wy * params[at + 7] + wz * params[at + 8]
    wk = wx * params[at + 12] + wy * params[at + 13] + wz * params[at + 14]
    wd = wx * params[at + 3] + wy * params[at + 4] + wz * params[at + 5]
    wda = wx * params[at + 9] + wy * params[at + 10] + wz * params[at + 11]
    r1 = params[at + 15]
    r2 = r1 + params[at + 16]
    kd = params[at + 29] / r1
    # Bernstein coefficients of (x - c(t)) . a(t) and (x - c(t)) . b(t): no value is beyond them.
    middle = wa + 0.5 * (wda - params[at + 28])
    end = wa + wda - params[at + 28] - params[at + 31]
    most_a = max(abs(wa), abs(middle), abs(end))
    most_b = max(abs(r1 * wk), abs(0.5 * (r1 * (wk - kd) + r2 * wk)), abs(r2 * (wk - kd)))
    bend = 2.0 * math.sqrt(most_a * most_a + most_b * most_b) + 2.0 * params[at + 27]
    bend = max(bend, 1e-300)

    least = best * best
    cosine = sine = 0.0
    found = False
    step = 2.0 * math.pi / SAMPLES
    c0 = 1.0
    s0 = 0.0
    turn_c = math.cos(step)
    turn_s = math.sin(step)
    g0 = _ruling_gap(params, at, ww, wa, wk, wd, wda, c0, s0)
    if g0 < least:
        least = g0
        cosine = c0
        sine = s0
        found = True
    for i in range(SAMPLES):
        c1 = c0 * turn_c - s0 * turn_s
        s1 = s0 * turn_c + c0 * turn_s
        g1 = _ruling_gap(params, at, ww, wa, wk, wd, wda, c1, s1)
        if g1 < least:
            least = g1
            cosine = c1
            sine = s1
            found = True
        stack[i, 0] = c0
        stack[i, 1] = s0
        stack[i, 2] = g0
        stack[i, 3] = c1
        stack[i, 4] = s1
        stack[i, 5] = g1
        stack[i, 6] = step
        c0 = c1
        s0 = s1
        g0 = g1
    goal = max(math.sqrt(least) - tolerance, 0.0) ** 2
    count = SAMPLES
    while count > 0:
        count -= 1
        c0 = stack[count, 0]
        s0 = stack[count, 1]
        g0 = stack[count, 2]
        c1 = stack[count, 3]
        s1 = stack[count, 4]
        g1 = stack[count, 5]
        step = stack[count, 6]
        if step < DEEPEST:
            continue
        reach = bend * step * step
        if 2.0 * abs(g1 - g0) >= reach:
            low = min(g0, g1)
        else:
            low = 0.5 * (g0 + g1) - 0.125 * reach - 0.5 * (g1 - g0) ** 2 / reach
        if low >= goal:
            continue
        c = c0 + c1
        s = s0 + s1
        norm = math.sqrt(c * c + s * s)
        c /= norm
        s /= norm
        g = _ruling_gap(params, at, ww, wa, wk, wd, wda, c, s)
        if g < least:
            least = g
            cosine = c
            sine = s
            found = True
            goal = max(math.sqrt(least) - tolerance, 0.0) ** 2
        # The half with the nearer end is on top: it is searched first.
        lower = count if g0 > g1 else count + 1
        upper = count + 1 if g0 > g1 else count
        stack[lower, 0] = c0
        stack[lower, 1] = s0
        stack[lower, 2] = g0
        stack[lower, 3] = c
        stack[lower, 4] = s
        stack[lower, 5] = g
        stack[lower, 6] = 0.5 * step
        stack[upper, 0] = c
        stack[upper, 1] = s
        stack[upper, 2] = g
        stack[upper, 3] = c1
        stack[upper, 4] = s1
        stack[upper, 5] = g1
        stack[upper, 6] = 0.5 * step
        count += 2
    if not found:
        return best, 2.0, 0.0
    return math.sqrt(least), cosine, sine


@kernel
def _wall_point(params, at, x, y, z, c, s):
    """Return the point nearest to x on a ruling, the ruling's t, and the wall's tangents there."""
    r1 = params[at + 15]
    dr = params[at + 16]
    px = params[at] + c * params[at + 6] + s * r1 * params[at + 12]
    py = params[at + 1] + c * params[at + 7] + s * r1 * params[at + 13]
    pz = params[at + 2] + c * params[at + 8] + s * r1 * params[at + 14]
    qx = params[at + 3] + c * params[at + 9] + s * dr * params[at + 12]
    qy = params[at + 4] + c * params[at + 10] + s * dr * params[at + 13]
    qz = params[at + 5] + c * params[at + 11] + s * dr * params[at + 14]
    square = qx * qx + qy * qy + qz * qz
    t = ((x - px) * qx + (y - py) * qy + (z - pz) * qz) / square
    t = min(max(t, 0.0), 1.0)
    r = r1 + t * dr
    ax = params[at + 6] + t * params[at + 9]
    ay = params[at + 7] + t * params[at + 10]
    az = params[at + 8] + t * params[at + 11]
    hx = -s * ax + c * r * params[at + 12]
    hy = -s * ay + c * r * params[at + 13]
    hz = -s * az + c * r * params[at + 14]
    return px + t * qx, py + t * qy, pz + t * qz, t, hx, hy, hz, qx, qy, qz


@kernel
def polish_ruling(params, at, x, y, z, c, s):
    """Newton's steps along the circles to the nearest wall point, as long as it gets nearer."""
    vx, vy, vz, t, hx, hy, hz, qx, qy, qz = _wall_point(params, at, x, y, z, c, s)
    far = math.sqrt((x - vx) ** 2 + (y - vy) ** 2 + (z - vz) ** 2)
    for _ in range(8):
        ex = x - vx
        ey = y - vy
        ez = z - vz
        slope = -(ex * hx + ey * hy + ez * hz)
        cx = vx - params[at] - t * params[at + 3]
        cy = vy - params[at + 1] - t * params[at + 4]
        cz = vz - params[at + 2] - t * params[at + 5]
        curve = hx * hx + hy * hy + hz * hz + ex * cx + ey * cy + ez * cz
        if 0.0 < t < 1.0:
            kx = -s * params[at + 9] + c * params[at + 16] * params[at + 12]
            ky = -s * params[at + 10] + c * params[at + 16] * params[at + 13]
            kz = -s * params[at + 11] + c * params[at + 16] * params[at + 14]
            mixed = hx * qx + hy * qy + hz * qz - (ex * kx + ey * ky + ez * kz)
            curve -= mixed * mixed / (qx * qx + qy * qy + qz * qz)
        if curve <= 0.0:
            break
        step = -slope / curve
        if abs(step) > 0.1 or abs(step) < 1e-15:
            break
        c1 = c * math.cos(step) - s * math.sin(step)
        s1 = s * math.cos(step) + c * math.sin(step)
        ux, uy, uz, t1, h1x, h1y, h1z, q1x, q1y, q1z = _wall_point(params, at, x, y, z, c1, s1)
        near = math.sqrt((x - ux) ** 2 + (y - uy) ** 2 + (z - uz) ** 2)
        if near >= far:
            break
        far = near
        c, s, t = c1, s1, t1
        vx, vy, vz = ux, uy, uz
        hx, hy, hz = h1x, h1y, h1z
        qx, qy, qz = q1x, q1y, q1z
    nx = hy * qz - hz * qy
    ny = hz * qx - hx * qz
    nz = hx * qy - hy * qx
    norm = math.sqrt(nx * nx + ny * ny + nz * nz)
    return far, vx, vy, vz, nx / norm, ny / norm, nz / norm


@kernel
def disc_gap(params, at, x, y, z):
    """Return (distance, nearest point (3)) of a disc: centre, normal, radius."""
    wx = x - params[at]
    wy = y - params[at + 1]
    wz = z - params[at + 2]
    along = wx * params[at + 3] + wy * params[at + 4] + wz * params[at + 5]
    ox = wx - along * params[at + 3]
    oy = wy - along * params[at + 4]
    oz = wz - along * params[at + 5]
    off = math.sqrt(ox * ox + oy * oy + oz * oz)
    radius = params[at + 6]
    if off <= radius:
        return abs(along), params[at] + ox, params[at + 1] + oy, params[at + 2] + oz
    share = radius / off
    gap = math.sqrt(along * along + (off - radius) ** 2)
    return gap, params[at] + share * ox, params[at + 1] + share * oy, params[at + 2] + share * oz


SEGMENT = 37
"""Numbers of a segment."""

HEAD = 16
"""Numbers before the first segment."""

EDGE = 1e-12
"""A blended disc this far beyond the end of a segment still counts, or rounding would open it."""


@kernel
def _place_root(params, at, wx, wy, wz, t):
    """Return u^2 of the point in the blended disc at t."""
    px = wx - t * params[at + 3]
    py = wy - t * params[at + 4]
    pz = wz - t * params[at + 5]
    ax = params[at + 6] + t * params[at + 9]
    ay = params[at + 7] + t * params[at + 10]
    az = params[at + 8] + t * params[at + 11]
    along = (px * ax + py * ay + pz * az) / (ax * ax + ay * ay + az * az)
    across = (px * params[at + 12] + py * params[at + 13] + pz * params[at + 14]) / (
        params[at + 15] + t * params[at + 16]
    )
    return along * along + across * across


@kernel
def _invert_segment(params, at, x, y, z):
    """Return (u^2, t): the smaller u of the roots with t in [0, 1]; u^2 is infinite without one."""
    wx = x - params[at]
    wy = y - params[at + 1]
    wz = z - params[at + 2]
    dx, dy, dz = params[at + 3], params[at + 4], params[at + 5]
    c = wx * params[at + 17] + wy * params[at + 18] + wz * params[at + 19]
    b = (
        wx * params[at + 20]
        + wy * params[at + 21]
        + wz * params[at + 22]
        - dx * params[at + 17]
        - dy * params[at + 18]
        - dz * params[at + 19]
    )
    a = -(dx * params[at + 20] + dy * params[at + 21] + dz * params[at + 22])
    inside = b * b - 4.0 * a * c
    if inside < 0.0:
        return np.inf, 0.0
    q = -0.5 * (b + math.copysign(math.sqrt(inside), b))
    best = np.inf
    place = 0.0
    if q != 0.0:
        t = c / q
        if -EDGE <= t <= 1.0 + EDGE:
            best = _place_root(params, at, wx, wy, wz, t)
            place = t
    if a != 0.0:
        t = q / a
        if -EDGE <= t <= 1.0 + EDGE:
            square = _place_root(params, at, wx, wy, wz, t)
            if square < best:
                best = square
                place = t
    return best, place


@kernel
def _nearest_wall(params, first, x, y, z):
    """Return (inside, distance, nearest wall point (3), outward normal there (3))."""
    count = int(params[first])
    tolerance = params[first + 1]
    gap, px, py, pz = disc_gap(params, first + 2, x, y, z)
    end = first + 2
    other, ox, oy, oz = disc_gap(params, first + 9, x, y, z)
    if other < gap:
        gap, px, py, pz = other, ox, oy, oz
        end = first + 9
    nx, ny, nz = params[end + 3], params[end + 4], params[end + 5]

    inside = False
    start = 0
    least = np.inf
    at = first + HEAD
    for i in range(count):
        square = (
            (x - params[at + 23]) ** 2 + (y - params[at + 24]) ** 2 + (z - params[at + 25]) ** 2
        )
        if not inside and square <= params[at + 26] ** 2:
            inside = _invert_segment(params, at, x, y, z)[0] <= 1.0
        if square < least:
            least = square
            start = i
        at += SEGMENT

    stack = np.empty((SAMPLES + 32, 7))
    best = gap
    where = -1
    cosine = sine = 0.0
    for n in range(count):
        i = start + n
        if i >= count:
            i -= count
        at = first + HEAD + i * SEGMENT
        reach = best + params[at + 26]
        square = (
            (x - params[at + 23]) ** 2 + (y - params[at + 24]) ** 2 + (z - params[at + 25]) ** 2
        )
        if square >= reach * reach:
            continue
        distance, c, s = search_rulings(params, at, x, y, z, best, tolerance, stack)
        if distance < best:
            best = distance
            where = at
            cosine = c
            sine = s
    if where >= 0:
        gap, px, py, pz, nx, ny, nz = polish_ruling(params, where, x, y, z, cosine, sine)
    return inside, gap, px, py, pz, nx, ny, nz


@kernel
def cylinder_chain_value(params, first, x, y, z):
    """Signed distance to the wall of a chain of cylinders, nearer to it by the tolerance."""
    inside, gap, _, _, _, _, _, _ = _nearest_wall(params, first, x, y, z)
    gap = max(gap - params[first + 1], 0.0)
    return -gap if inside else gap


@kernel
def cylinder_chain_slope(params, first, x, y, z):
    """The same with its gradient."""
    inside, gap, px, py, pz, nx, ny, nz = _nearest_wall(params, first, x, y, z)
    value = max(gap - params[first + 1], 0.0)
    if inside:
        value = -value
    if gap <= 1e-9:
        return value, nx, ny, nz
    scale = -1.0 / gap if inside else 1.0 / gap
    return value, (x - px) * scale, (y - py) * scale, (z - pz) * scale


@kernel
def locate_points(params, points, segment, result):
    """Fill `segment` (n,) and `result` (n, 4): t, u, and cosine and sine of theta times u.

    Of several segments that hold a point the one of the smallest u; -1 and u infinite without.
    """
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        segment[n] = -1
        result[n, 0] = result[n, 2] = result[n, 3] = 0.0
        result[n, 1] = np.inf
        least = np.inf
        for i in range(int(params[0])):
            at = HEAD + i * SEGMENT
            square, t = _invert_segment(params, at, x, y, z)
            if square >= least:
                continue
            least = square
            segment[n] = i
            px = x - params[at] - t * params[at + 3]
            py = y - params[at + 1] - t * params[at + 4]
            pz = z - params[at + 2] - t * params[at + 5]
            ax = params[at + 6] + t * params[at + 9]
            ay = params[at + 7] + t * params[at + 10]
            az = params[at + 8] + t * params[at + 11]
            result[n, 0] = min(max(t, 0.0), 1.0)
            result[n, 1] = math.sqrt(square)
            result[n, 2] = (px * ax + py * ay + pz * az) / (ax * ax + ay * ay + az * az)
            result[n, 3] = (px * params[at + 12] + py * params[at + 13] + pz * params[at + 14]) / (
                params[at + 15] + t * params[at + 16]
            )
