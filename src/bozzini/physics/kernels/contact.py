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

SWEEPS = 200
TOLERANCE = 1e-6


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
def find_contacts(duct, tube, frame, bodies, turns, along, points, size, index, depth, normal):
    """List the samples of the body that touch or come near to touching.

    `frame` (4, 3) takes the world to the duct's own frame: three rows and the place of the origin.
    `bodies` (m, 3) and `turns` (m, 3) are the place and the axis of each sample's link, `along` how
    far it is along that; `size` has the body's radius and how near is near.

    A sample is a ball. Its direction to the wall is that of its centre's gradient first, then twice
    that of the place on its skin which that gives: near the middle of a narrow lumen the gradient
    at the centre says little.

    Fills where samples are, and for each contact which sample it is, its depth and the unit normal
    into the lumen; returns how many there are, the least clearance of the centres, and its sample.
    """
    radius, near = size
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
        if clear > radius + near or count == index.shape[0]:
            continue
        for _ in range(2):
            scale = radius / max(math.sqrt(gx * gx + gy * gy + gz * gz), 1e-9)
            clear, gx, gy, gz = measure_gap(
                duct, tube, local[0] - scale * gx, local[1] - scale * gy, local[2] - scale * gz
            )
        length = math.sqrt(gx * gx + gy * gy + gz * gz)
        if clear < near and length > 1e-6:
            index[count] = i
            depth[count] = -clear
            normal[count, 0] = gx / length
            normal[count, 1] = gy / length
            normal[count, 2] = gz / length
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
            ax, ay, az = axes[v, 0], axes[v, 1], axes[v, 2]
            if v > 0:
                dx = places[c, 0] - anchors[v, 0]
                dy = places[c, 1] - anchors[v, 1]
                dz = places[c, 2] - anchors[v, 2]
                ax, ay, az = ay * dz - az * dy, az * dx - ax * dz, ax * dy - ay * dx
            for r in range(3):
                f = frames[c, r]
                jacobian[3 * c + r, v] = f[0] * ax + f[1] * ay + f[2] * az


@njit(cache=True)
def balance_contacts(rows, effect, velocity, depth, law, force):
    """Find the contact forces (3 n,) at the end of a step, and return the last change [mN].

    The wall's force is its stiffness times the depth at the end of the step, and its damping times
    the velocity then, both unknown. It is never negative; friction stops what slides, up to
    Coulomb's limit. Gauss and Seidel, from the forces given.

    Parameters
    ----------
    rows, effect : (3 n, v) float
        Velocity of each contact, normal and two tangents, by those of the joints; and what a force
        there does to these in a second.
    velocity : (3 n,) float
        At the end of the step without forces.
    depth : (n,) float
        At its beginning.
    law : tuple
        Stiffness, damping, friction and the length of the step.
    force : (3 n,) float
        Is changed.
    """
    stiffness, damping, friction, step = law
    n, count = depth.shape[0], rows.shape[1]
    gain = stiffness * step + damping
    own = np.empty(3 * n)
    joint = np.zeros(count)  # what all forces do to the joints' velocities
    for i in range(3 * n):
        own[i] = 0.0
        for v in range(count):
            own[i] += step * rows[i, v] * effect[i, v]
            joint[v] += step * effect[i, v] * force[i]
    change = 0.0
    for _ in range(SWEEPS):
        change, largest = 0.0, 1e-9
        for c in range(n):
            i = 3 * c
            moved = velocity[i]
            for v in range(count):
                moved += rows[i, v] * joint[v]
            moved -= own[i] * force[i]
            new = max((stiffness * depth[c] - gain * moved) / (1.0 + gain * own[i]), 0.0)
            added = new - force[i]
            if added != 0.0:
                for v in range(count):
                    joint[v] += step * effect[i, v] * added
                force[i] = new
            change = max(change, abs(added))
            largest = max(largest, new)
            was_t, was_s = force[i + 1], force[i + 2]
            if (new == 0.0 or friction <= 0.0) and was_t == 0.0 and was_s == 0.0:
                continue
            along, across = velocity[i + 1], velocity[i + 2]
            for v in range(count):
                along += rows[i + 1, v] * joint[v]
                across += rows[i + 2, v] * joint[v]
            stop = 1.0 / max(own[i + 1] + own[i + 2], 1e-12)
            force[i + 1] -= stop * along
            force[i + 2] -= stop * across
            size = math.sqrt(force[i + 1] ** 2 + force[i + 2] ** 2)
            most = friction * new
            if size > most:
                force[i + 1] *= most / size
                force[i + 2] *= most / size
            for v in range(count):
                joint[v] += step * (
                    effect[i + 1, v] * (force[i + 1] - was_t)
                    + effect[i + 2, v] * (force[i + 2] - was_s)
                )
            change = max(change, abs(force[i + 1] - was_t), abs(force[i + 2] - was_s))
        if change < TOLERANCE * largest:
            break
    return change
