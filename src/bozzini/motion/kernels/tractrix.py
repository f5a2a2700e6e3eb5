"""Numba kernels of the tractrix: a chain in a tube along a shaped path, and a free chain.

A link of length L has its head at ``h`` and its tail at ``h + L w``. As the head moves by ``dh``,
the tail moves along the link, and with the slip ``nu`` takes on part of the head's motion::

    dw = -(1 - nu) / L (dh - (w . dh) w)

A single step of any size is ``w+ = unit(w - (1 - nu) dh / L)``, the least motion for ``nu = 0``
(thesis (5.13), (6.6) and Appendix C, corrected). Along a straight ``dh = e |dh|`` the equation has
the solution ``w+ ~ 2 q w + (c (1 - q)^2 - (1 - q^2)) e`` with ``c = w . e`` and ``q = exp(-(1 - nu)
|dh| / L)``. Joints follow one after the other, from the head on. Neither kernel asks the field.
"""

from __future__ import annotations

import math

from ...numeric.compiling import kernel


@kernel
def _locate(arc, s, k):
    """Return the segment of arc length s, searched from segment k on."""
    n = arc.shape[0]
    while k < n - 2 and arc[k + 1] < s:
        k += 1
    while k > 0 and arc[k] > s:
        k -= 1
    return k


OFF_LINE = 1e-10
"""Joints that are nearer to a straight line count as on it [mm]."""


@kernel
def _leave_line(path, back, x, y, z):
    """Return how far a point is from the straight line that the path begins with."""
    dx, dy, dz = x - path[0, 0], y - path[0, 1], z - path[0, 2]
    along = dx * back[0] + dy * back[1] + dz * back[2]
    dx, dy, dz = dx - along * back[0], dy - along * back[1], dz - along * back[2]
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@kernel
def move_in_tube(path, arc, tube, heads, length, cap, slip, freedom, chain, arc_lengths, out):
    """Move a chain so that every joint stays within the tube around the path.

    Each joint takes the tractrix step (with slip: thesis Appendix C, corrected), unless that
    leaves the ball of radius rho around y, the path's first point at distance L behind the joint
    before; then it takes the nearest point of the ball on the sphere of radius L. The ball always
    meets the sphere, so there is always a place. Joints that queue on the straight line that the
    path begins with stay on it.

    Parameters
    ----------
    path : (n, 3), arc : (n,), tube : (n,) float
        The shaped path, introducer included, its arc length, and the tube radius.
    heads : (steps,) float
        Arc length of the head at each step.
    cap : float
        Largest deviation as a fraction of the link.
    slip : float
        0 tractrix ... 1 the tail moves like the head.
    freedom : float
        Scales the tube radius: 1 as far as it is free, 0 follow the leader.
    chain : (joints, 3), places : (joints,) float
        The chain and its arc lengths, updated to the last step.
    out : (steps, joints, 3) float
        Filled.
    """
    joints = chain.shape[0]
    head_segment = 0
    back = (path[0] - path[1]) / (arc[1] - arc[0])
    straight = 1
    while straight < path.shape[0] and (
        _leave_line(path, back, path[straight, 0], path[straight, 1], path[straight, 2]) <= OFF_LINE
    ):
        ahead = 0.0  # a path may turn back on its own line
        for q in range(3):
            ahead += (path[straight - 1, q] - path[straight, q]) * back[q]
        if ahead < 0.0:
            break
        straight += 1
    queue = joints
    while queue > 0 and (
        _leave_line(path, back, chain[queue - 1, 0], chain[queue - 1, 1], chain[queue - 1, 2])
        <= OFF_LINE
    ):
        queue -= 1
    for t in range(heads.shape[0]):
        s = heads[t]
        head_segment = _locate(arc, s, head_segment)
        span = arc[head_segment + 1] - arc[head_segment]
        u = min(max((s - arc[head_segment]) / span, 0.0), 1.0)
        tube_before = tube[head_segment] + u * (tube[head_segment + 1] - tube[head_segment])
        k = head_segment
        qx, qy, qz = chain[0, 0], chain[0, 1], chain[0, 2]
        hx = path[k, 0] + u * (path[k + 1, 0] - path[k, 0])
        hy = path[k, 1] + u * (path[k + 1, 1] - path[k, 1])
        hz = path[k, 2] + u * (path[k + 1, 2] - path[k, 2])
        chain[0, 0], chain[0, 1], chain[0, 2] = hx, hy, hz
        arc_lengths[0] = s
        out[t, 0, 0], out[t, 0, 1], out[t, 0, 2] = hx, hy, hz
        square = length * length
        queued = queue
        for j in range(1, joints):
            if (
                j > queued
                and arc_lengths[j - 1] <= arc[straight - 1]
                and _leave_line(path, back, hx, hy, hz) <= OFF_LINE
            ):
                queue = j - 1
                for i in range(j, joints):
                    hx += length * back[0]
                    hy += length * back[1]
                    hz += length * back[2]
                    arc_lengths[i] = arc_lengths[i - 1] - length
                    chain[i, 0], chain[i, 1], chain[i, 2] = hx, hy, hz
                    out[t, i, 0], out[t, i, 1], out[t, i, 2] = hx, hy, hz
                break
            queue = joints
            # y: first point of the path behind the place of j - 1, at distance L from it.
            ax = path[k, 0] - hx
            ay = path[k, 1] - hy
            az = path[k, 2] - hz
            while k > 0 and ax * ax + ay * ay + az * az < square:
                k -= 1
                ax = path[k, 0] - hx
                ay = path[k, 1] - hy
                az = path[k, 2] - hz
            bx = path[k + 1, 0] - path[k, 0]
            by = path[k + 1, 1] - path[k, 1]
            bz = path[k + 1, 2] - path[k, 2]
            bb = bx * bx + by * by + bz * bz
            ab = ax * bx + ay * by + az * bz
            aa = ax * ax + ay * ay + az * az
            root = math.sqrt(max(ab * ab - bb * (aa - square), 0.0))
            w = (-ab - root) / bb
            if w < 0.0 or w > 1.0:
                w = (-ab + root) / bb
            w = min(max(w, 0.0), 1.0)
            yx = ax + w * bx
            yy = ay + w * by
            yz = az + w * bz
            scale = 1.0 / math.sqrt(yx * yx + yy * yy + yz * yz)
            yx *= scale
            yy *= scale
            yz *= scale
            arc_lengths[j] = arc[k] + w * (arc[k + 1] - arc[k])
            tube_here = tube[k] + w * (tube[k + 1] - tube[k])
            rho = freedom * min(min(tube_before, tube_here), cap * length)
            # The tractrix step, with slip.
            ox, oy, oz = chain[j, 0], chain[j, 1], chain[j, 2]
            tx = ox - hx + slip * (hx - qx)
            ty = oy - hy + slip * (hy - qy)
            tz = oz - hz + slip * (hz - qz)
            scale = 1.0 / math.sqrt(tx * tx + ty * ty + tz * tz)
            tx *= scale
            ty *= scale
            tz *= scale
            cos = tx * yx + ty * yy + tz * yz
            chord = rho / length
            # Out of the ball, |X - y| = L sqrt(2 - 2 cos) > rho: turned back to its rim, towards y.
            if chord == 0.0:
                tx, ty, tz = yx, yy, yz
            elif 2.0 - 2.0 * cos > chord * chord:
                ex = tx - cos * yx
                ey = ty - cos * yy
                ez = tz - cos * yz
                size = math.sqrt(ex * ex + ey * ey + ez * ez)
                ca = 1.0 - 0.5 * chord * chord
                sa = chord * math.sqrt(max(1.0 - 0.25 * chord * chord, 0.0))
                if size > 1e-12:
                    tx = ca * yx + sa * ex / size
                    ty = ca * yy + sa * ey / size
                    tz = ca * yz + sa * ez / size
                else:
                    tx, ty, tz = yx, yy, yz
            hx += length * tx
            hy += length * ty
            hz += length * tz
            chain[j, 0], chain[j, 1], chain[j, 2] = hx, hy, hz
            out[t, j, 0], out[t, j, 1], out[t, j, 2] = hx, hy, hz
            qx, qy, qz = ox, oy, oz
            tube_before = tube_here


@kernel
def pull_chain(chain, lengths, heads, slip, substep, out):
    """Pull a chain by its head along straight steps to `heads` (steps, dim); fill `out`.

    `substep` 0: each tail moves once per step, least (thesis eq. 5.13 and 6.6). Otherwise each
    step is cut into parts of at most `substep`, and each link moves by the closed form for a
    straight move of its head. `chain` (joints, dim) is updated to the last step. Returns (-1, -1),
    or the step and the link that was left without a direction.
    """
    joints, dim = chain.shape
    for t in range(heads.shape[0]):
        square = 0.0
        for k in range(dim):
            square += (heads[t, k] - chain[0, k]) ** 2
        parts = 1
        if substep > 0.0:
            parts = max(1, math.ceil(math.sqrt(square) / substep - 1e-9))
        for part in range(parts):
            fraction = 1.0 / (parts - part)
            for k in range(dim):
                out[t, 0, k] = (
                    heads[t, k]
                    if fraction == 1.0
                    else (chain[0, k] + fraction * (heads[t, k] - chain[0, k]))
                )
            for j in range(1, joints):
                if not _move_tail(chain, out, t, j, lengths[j - 1], slip, substep > 0.0):
                    return t, j
            for j in range(joints):
                for k in range(dim):
                    chain[j, k] = out[t, j, k]
    return -1, -1


@kernel
def _move_tail(chain, out, t, j, length, slip, exact):
    """Place joint j after joint j - 1 has moved; False if the link has no direction left."""
    dim = chain.shape[1]
    step = 0.0
    along = 0.0
    for k in range(dim):
        move = out[t, j - 1, k] - chain[j - 1, k]
        step += move * move
        along += move * (chain[j, k] - chain[j - 1, k])
    step = math.sqrt(step)
    head_part = 0.0
    tail_part = 1.0
    if exact and step > 0.0:
        # w unit from head to tail, e unit along the head's move, c = w.e, sigma the head's move
        # over the effective length, q = exp(-sigma):
        # w+ ~ (w - c e) + (c cosh sigma - sinh sigma) e ~ 2q w + (c (1 - q)^2 - (1 - q^2)) e
        cosine = min(max(along / (step * length), -1.0), 1.0)
        sigma = (1.0 - slip) * step / length
        q = math.exp(-sigma)
        tail_part = 2.0 * q
        head_part = cosine * (1.0 - q) ** 2 - (1.0 - q * q)
        head_part /= step
    elif not exact:
        head_part = -(1.0 - slip) / length
    size = 0.0
    for k in range(dim):
        move = out[t, j - 1, k] - chain[j - 1, k]
        value = tail_part * (chain[j, k] - chain[j - 1, k]) / length + head_part * move
        out[t, j, k] = value
        size += value * value
    size = math.sqrt(size)
    if size < 1e-9:
        return False
    for k in range(dim):
        out[t, j, k] = out[t, j - 1, k] + length * out[t, j, k] / size
    return True
