"""Numba: contact of a chain with a wall that is known by its signed distance.

Points are in the duct's own frame [mm], forces in mN, so that mass is in kg and time in s. The
introducer is a straight tube: seven numbers, its inner end, its direction out of the tract and its
inner radius.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ...duct.kernels.clearance import clearance_slope


@njit(cache=True)
def measure_gap(duct, tube, x, y, z):
    """Return the clearance of a point in the lumen or the introducer, and its gradient."""
    clear, gx, gy, gz = clearance_slope(duct, x, y, z)
    if tube[6] > 0.0:
        dx, dy, dz = x - tube[0], y - tube[1], z - tube[2]
        along = dx * tube[3] + dy * tube[4] + dz * tube[5]
        if along >= 0.0:  # in the introducer's free space, or beside it
            dx -= along * tube[3]
            dy -= along * tube[4]
            dz -= along * tube[5]
            off = math.sqrt(dx * dx + dy * dy + dz * dz)
            if tube[6] - off > clear:
                scale = -1.0 / max(off, 1e-9)
                return tube[6] - off, scale * dx, scale * dy, scale * dz
    return clear, gx, gy, gz


@njit(cache=True)
def find_contacts(duct, tube, frame, bodies, turns, along, points, margin, index, depth, normal):
    """List the samples on the body's axis that touch or come within `margin` of touching.

    `frame` (4, 3) takes the world to the duct's own frame: three rows and the place of the origin.
    `bodies` (m, 3) and `turns` (m, 3) are the place and the axis of each sample's link, `along` how
    far it is along that; `margin` is what is added to the depth of the axis.

    Fills where samples are, and for each contact which sample it is, its depth and the unit normal
    into the lumen; returns how many there are, the least clearance of the axis, and its sample.
    """
    count, least, where = 0, math.inf, 0
    local = np.empty(3)
    for i in range(points.shape[0]):
        for k in range(3):
            points[i, k] = bodies[i, k] + along[i] * turns[i, k]
        for k in range(3):
            local[k] = frame[3, k]
            for j in range(3):
                local[k] += frame[j, k] * points[i, j]
        clear, gx, gy, gz = measure_gap(duct, tube, local[0], local[1], local[2])
        if clear < least:
            least, where = clear, i
        size = math.sqrt(gx * gx + gy * gy + gz * gz)
        if clear < margin and size > 1e-6 and count < index.shape[0]:
            index[count] = i
            depth[count] = -clear
            normal[count, 0] = gx / size
            normal[count, 1] = gy / size
            normal[count, 2] = gz / size
            count += 1
    return count, least, where


@njit(cache=True)
def merge_contacts(order, places, normals, links, near, kept):
    """Mark in `kept` (n,) one of the contacts of a link that are at one place, the first in order.

    Triangles side by side are touched at one place each: to count them all would make the wall as
    many times as stiff.
    """
    for a in range(order.shape[0]):
        i = order[a]
        kept[i] = True
        for b in range(a):
            j = order[b]
            if not kept[j] or links[j] != links[i]:
                continue
            off, same = 0.0, 0.0
            for k in range(3):
                off += (places[i, k] - places[j, k]) ** 2
                same += normals[i, k] * normals[j, k]
            if off < near * near and same > 0.9:
                kept[i] = False
                break


@njit(cache=True)
def fill_jacobian(axes, anchors, places, owners, frames, jacobian):
    """Fill (3 n, v) rows: velocity of each contact point along its normal and two tangents.

    Of `frames` (n, 3, 3) the first row is given, the normal; the tangents are filled in.

    The chain's first degree of freedom is a slide, all others are hinges; `owners` says how many of
    them move the point.
    """
    for c in range(places.shape[0]):
        n = frames[c, 0]
        k = 0
        for j in range(1, 3):
            if abs(n[j]) < abs(n[k]):
                k = j
        t = np.zeros(3)
        t[k] = 1.0
        t -= n[k] * n
        t /= math.sqrt(t[0] ** 2 + t[1] ** 2 + t[2] ** 2)
        s = np.cross(n, t)
        frames[c, 1] = t
        frames[c, 2] = s
        for v in range(jacobian.shape[1]):
            if v >= owners[c]:
                jacobian[3 * c : 3 * c + 3, v] = 0.0
                continue
            w = axes[v] if v == 0 else np.cross(axes[v], places[c] - anchors[v])
            jacobian[3 * c, v] = n[0] * w[0] + n[1] * w[1] + n[2] * w[2]
            jacobian[3 * c + 1, v] = t[0] * w[0] + t[1] * w[1] + t[2] * w[2]
            jacobian[3 * c + 2, v] = s[0] * w[0] + s[1] * w[1] + s[2] * w[2]


@njit(cache=True)
def balance_contacts(coupling, velocity, depth, law, force):
    """Find the contact forces (3 n,) at the end of a step, and return the last change [mN].

    The wall's force is its stiffness times the depth at the end of the step, and its damping times
    the velocity then, both unknown: `coupling` (3 n, 3 n) says how forces change velocities. It is
    never negative; friction stops what slides, up to Coulomb's limit. Gauss and Seidel, from the
    forces given. `law` holds stiffness, damping, friction and the length of the step.
    """
    stiffness, damping, friction, step = law
    n = depth.shape[0]
    change = 0.0
    for _ in range(500):
        change, largest = 0.0, 1e-9
        for c in range(n):
            i = 3 * c
            gain = stiffness * step + damping
            moved = velocity[i]
            for j in range(3 * n):
                if j != i:
                    moved += step * coupling[i, j] * force[j]
            new = (stiffness * depth[c] - gain * moved) / (1.0 + gain * step * coupling[i, i])
            new = max(new, 0.0)
            change = max(change, abs(new - force[i]))
            force[i] = new
            largest = max(largest, new)
            if friction <= 0.0:
                force[i + 1] = 0.0
                force[i + 2] = 0.0
                continue
            was_t, was_s = force[i + 1], force[i + 2]
            for k in (i + 1, i + 2):
                moved = velocity[k]
                for j in range(3 * n):
                    moved += step * coupling[k, j] * force[j]
                force[k] -= moved / (step * max(coupling[k, k], 1e-12))
            size = math.sqrt(force[i + 1] ** 2 + force[i + 2] ** 2)
            most = friction * new
            if size > most:
                force[i + 1] *= most / size
                force[i + 2] *= most / size
            change = max(change, abs(force[i + 1] - was_t), abs(force[i + 2] - was_s))
        if change < 1e-7 * largest:
            break
    return change
