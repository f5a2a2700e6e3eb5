"""Numba: contact of a chain with a wall that is known by its signed distance.

Points are in the duct's own frame [mm], forces in mN, so that mass is in kg and time in s. The
introducer is a straight tube: seven numbers, its inner end, its direction out of the tract and its
inner radius.
"""

from __future__ import annotations

import math

import numpy as np

from ...duct.kernels.clearance import clearance_slope, split_along
from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_matrix, copy_vector

SWEEPS, ROUNDS = 200, 10
SEEN = 0.1  # a ray that is this near to the wall meets it [mm]
SURE = 0.7  # size of a distance's gradient above which it shows where the wall is


@kernel
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


@kernel(nogil=True)
def look_ahead(wall, eye, axes, lens, image):
    """Fill an image (n, n) with the light of the tip that the wall throws back, 0 to 1.

    `wall` is as in `find_contacts`; `eye` (3,) and `axes` (3, 3) are the camera in the world, whose
    columns go right, down and ahead; `lens` has the tangent of half the angle of view, where the
    light saturates, and how far it reaches [mm].

    A place at a distance d is seen as bright as the root of its cosine times its part of the light,
    which falls with d squared: a camera of gamma 2.
    """
    (duct, tube, frame), (half, near, far) = wall, lens
    n = image.shape[0]
    start, way, lumen_alone = np.empty(3), np.empty(3), np.zeros(7)
    for k in range(3):
        start[k] = frame[3, k]
        for j in range(3):
            start[k] += frame[j, k] * eye[j]
    for row in range(n):
        for column in range(n):
            across = half * (2.0 * (column + 0.5) / n - 1.0)
            down = half * (2.0 * (row + 0.5) / n - 1.0)
            size = math.sqrt(across**2 + down**2 + 1.0)
            for k in range(3):
                way[k] = 0.0
                for j in range(3):
                    ray = (axes[j, 0] * across + axes[j, 1] * down + axes[j, 2]) / size
                    way[k] += frame[j, k] * ray
            gone = 0.0
            image[row, column] = 0.0
            # Past the entry plane a ray is in the introducer only if it came there through it.
            before, off = split_along(tube, start[0], start[1], start[2])
            around = tube if before < 0.0 or off <= tube[6] else lumen_alone
            while gone < far:
                x, y, z = (
                    start[0] + gone * way[0], start[1] + gone * way[1], start[2] + gone * way[2],
                )  # fmt: skip
                along, off = split_along(tube, x, y, z)
                if (along < 0.0) != (before < 0.0):
                    around = tube if along < 0.0 or off <= tube[6] else lumen_alone
                before = along
                clear, gx, gy, gz = measure_gap(duct, around, x, y, z)
                if clear < SEEN:
                    slope = math.sqrt(gx * gx + gy * gy + gz * gz)
                    cosine = -(gx * way[0] + gy * way[1] + gz * way[2]) / max(slope, 1e-9)
                    light = min(1.0, near / max(gone, 1e-9))
                    image[row, column] = light * math.sqrt(min(max(cosine, 0.0), 1.0))
                    break
                gone += max(clear, SEEN)


@kernel
def find_contacts(wall, links, samples, points, size, index, depth, normal):
    """List the samples of the body that touch or come near to touching.

    `wall` is the packed duct, the introducer (7,), and a frame (4, 3) that takes the world to the
    duct's own: three rows and the place of the origin. `links` are the places (b, 3) and the turns
    (b, 9) of MuJoCo's bodies, `samples` the body of each sample (m,) and how far it is along its
    axis (m,); `size` has the body's radius and how near is near. They go from the base to the tip:
    what has once left the introducer is in the lumen alone, also past the entry plane.

    A sample is a ball. Its direction to the wall is that of its centre's gradient first, then twice
    that of the place on its skin which that gives: near the middle of a narrow lumen the gradient
    at the centre says little. Where the skin is beyond the middle of a thin wall between two lumens
    its gradient points to the other one: there the centre's is kept, if the wall is what it shows.

    Fills where samples are, and for each contact which sample it is, its depth and the unit normal
    into the lumen; returns how many there are, the least clearance of the centres, and its sample.
    """
    radius, near = size
    (duct, tube, frame), (places, turns), (bodies, along) = wall, links, samples
    count, least, where = 0, math.inf, 0
    local, lumen_alone = np.empty(3), np.zeros(7)
    for i in range(points.shape[0]):
        for k in range(3):
            points[i, k] = places[bodies[i], k] + along[i] * turns[bodies[i], 3 * k + 2]
        for k in range(3):
            local[k] = frame[3, k]
            for j in range(3):
                local[k] += frame[j, k] * points[i, j]
        if split_along(tube, local[0], local[1], local[2])[0] < 0.0:
            tube = lumen_alone
        clear, gx, gy, gz = measure_gap(duct, tube, local[0], local[1], local[2])
        if clear < least:
            least, where = clear, i
        if clear > radius + near or count == index.shape[0]:
            continue
        first, ax, ay, az = clear, gx, gy, gz
        sure = ax * ax + ay * ay + az * az > SURE**2
        for _ in range(2):
            scale = radius / max(math.sqrt(gx * gx + gy * gy + gz * gz), 1e-9)
            clear, gx, gy, gz = measure_gap(
                duct, tube, local[0] - scale * gx, local[1] - scale * gy, local[2] - scale * gz
            )
            if sure and gx * ax + gy * ay + gz * az <= 0.0:
                clear, gx, gy, gz = first - radius, ax, ay, az
                break
        length = math.sqrt(gx * gx + gy * gy + gz * gz)
        if clear < near and length > 1e-6:
            index[count] = i
            depth[count] = -clear
            normal[count, 0] = gx / length
            normal[count, 1] = gy / length
            normal[count, 2] = gz / length
            count += 1
    return count, least, where


@kernel
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
            if off < near * near and same > 0.5:
                kept[i] = False
                break


@kernel
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


@kernel
def factor_mass(mass):
    """Replace the lower triangle of a positive matrix M (v, v) by L of M = L^T L.

    From the last row up: each row is taken from those above as a whole, which compiles to vectors.
    """
    for k in range(mass.shape[0] - 1, -1, -1):
        mass[k, k] = math.sqrt(mass[k, k])
        for i in range(k):
            mass[k, i] /= mass[k, k]
        for i in range(k):
            scale = mass[k, i]
            for j in range(i + 1):
                mass[i, j] -= scale * mass[k, j]


@kernel
def solve_upper(factor, rows):
    """Replace rows (r, v) by what solves L^T for each of them."""
    for r in range(rows.shape[0]):
        for k in range(factor.shape[0] - 1, -1, -1):
            if rows[r, k] == 0.0:  # as beyond the link that a contact is at
                continue
            rows[r, k] /= factor[k, k]
            scale = rows[r, k]
            for i in range(k):
                rows[r, i] -= scale * factor[k, i]


@kernel
def solve_mass(factor, force):
    """Return the acceleration (v,) by a force (v,)."""
    n = factor.shape[0]
    rows = force.copy().reshape(1, n)
    solve_upper(factor, rows)
    found = rows[0]
    for i in range(n):
        for k in range(i):
            found[i] -= factor[i, k] * found[k]
        found[i] /= factor[i, i]
    return found


@kernel
def fill_speeds(axes, anchors, places, owners, normals, rates, speeds):
    """Fill (n,): velocity of places along their normals by the rates of the joints (v,)."""
    count = rates.shape[0]
    turn, shift = np.zeros((count + 1, 3)), np.zeros((count + 1, 3))
    for v in range(count):
        copy_vector(turn[v], turn[v + 1])
        copy_vector(shift[v], shift[v + 1])
        if v == 0:
            for i in range(3):
                shift[1, i] += rates[0] * axes[0, i]
            continue
        x, y, z = rates[v] * axes[v, 0], rates[v] * axes[v, 1], rates[v] * axes[v, 2]
        turn[v + 1, 0] += x
        turn[v + 1, 1] += y
        turn[v + 1, 2] += z
        shift[v + 1, 0] -= y * anchors[v, 2] - z * anchors[v, 1]
        shift[v + 1, 1] -= z * anchors[v, 0] - x * anchors[v, 2]
        shift[v + 1, 2] -= x * anchors[v, 1] - y * anchors[v, 0]
    for c in range(places.shape[0]):
        k = owners[c]
        x, y, z = turn[k]
        place, normal = places[c], normals[c]
        speeds[c] = (
            (shift[k, 0] + (y * place[2] - z * place[1])) * normal[0]
            + (shift[k, 1] + (z * place[0] - x * place[2])) * normal[1]
            + (shift[k, 2] + (x * place[1] - y * place[0])) * normal[2]
        )


@kernel
def press_contacts(mass, state, joints, contacts, law, force, frames):
    """Find the contact forces at the end of a step.

    Returns what they do at the joints (v,) [mN], and whether they settled.

    The wall's force is its stiffness times the depth at the end of the step, and its damping times
    the velocity then, both unknown. It is never negative; friction stops what slides, up to
    Coulomb's limit. Contacts that would not press are left out, until the others press them.

    Parameters
    ----------
    mass : (v, v) float
        With damping over the step; is replaced by its factor.
    state : (v,) float, (v,) float
        Rates at the beginning, and all other forces.
    joints : (v, 3) float, (v, 3) float
        Axes and places of the joints.
    contacts : (n, 3) float, (n, 3) float, (n,) float, (n,) int
        Places, normals, depths at the beginning, and how many joints move each.
    law : tuple
        Stiffness, damping, friction, the length of the step and the tolerance.
    force : (n, 3) float
        Along the normal and two tangents; as in the step before, is changed.
    frames : (n, 3, 3) float
        Is filled: normal and tangents.
    """
    factor_mass(mass)
    free = state[0] + law[3] * solve_mass(mass, state[1])
    return hold_contacts(mass, free, joints, contacts, law, force, frames)


@kernel
def hold_contacts(mass, free, joints, contacts, law, force, frames):
    """Do the work of `press_contacts`, by the factor and the rates that are without contacts."""
    axes, anchors = joints
    places, normals, depth, owners = contacts
    stiffness, damping, _, step, _ = law
    gain = stiffness * step + damping
    n = depth.shape[0]
    speeds = np.empty(n)
    fill_speeds(axes, anchors, places, owners, normals, free, speeds)
    active = np.zeros(n, dtype=np.bool_)
    for c in range(n):
        copy_vector(normals[c], frames[c, 0])
        active[c] = force[c, 0] > 0.0 or stiffness * depth[c] > gain * speeds[c]
    total = np.zeros(free.shape[0])
    settled = True
    for _ in range(ROUNDS):
        which = np.flatnonzero(active)
        if which.shape[0] == 0:
            return total, True
        rows = np.empty((3 * which.shape[0], free.shape[0]))
        there = frames[which]
        fill_jacobian(axes, anchors, places[which], owners[which], there, rows)
        velocity = np.dot(rows, free)
        spread = rows.copy()
        solve_upper(mass, spread)
        effect = step * np.dot(spread, spread.T)
        found = force[which].ravel()
        settled = balance_contacts(effect, velocity, depth[which], law, found)
        total = np.dot(found, rows)
        for i in range(which.shape[0]):
            copy_vector(found[3 * i : 3 * i + 3], force[which[i]])
            copy_matrix(there[i], frames[which[i]])
        added = False
        fill_speeds(
            axes, anchors, places, owners, normals, free + step * solve_mass(mass, total), speeds
        )
        for c in range(n):
            if not active[c] and stiffness * depth[c] > gain * speeds[c]:
                active[c] = added = True
        if not added:
            return total, settled
    return total, False


@kernel
def balance_contacts(effect, velocity, depth, law, force):
    """Find the contact forces (3 n,) by Gauss and Seidel, from those given; return if they settled.

    Parameters
    ----------
    effect : (3 n, 3 n) float
        Velocity at the end of the step, normal and two tangents of each contact, by the forces.
    velocity : (3 n,) float
        Without forces.
    depth : (n,) float
        At the beginning of the step.
    law : tuple
        Stiffness, damping, friction, the length of the step and the tolerance.
    force : (3 n,) float
        Is changed.
    """
    stiffness, damping, friction, step, tolerance = law
    n = depth.shape[0]
    gain = stiffness * step + damping
    moved = velocity + np.dot(effect, force)
    for _ in range(SWEEPS):
        change, largest = 0.0, 1e-9
        for c in range(n):
            i = 3 * c
            own = effect[i, i]
            free = moved[i] - own * force[i]
            new = max((stiffness * depth[c] - gain * free) / (1.0 + gain * own), 0.0)
            added = new - force[i]
            if added != 0.0:
                for k in range(3 * n):
                    moved[k] += effect[i, k] * added
                force[i] = new
            change = max(change, abs(added))
            largest = max(largest, new)
            was_t, was_s = force[i + 1], force[i + 2]
            if (new == 0.0 or friction <= 0.0) and was_t == 0.0 and was_s == 0.0:
                continue
            a, b, both = effect[i + 1, i + 1], effect[i + 2, i + 2], effect[i + 1, i + 2]
            stop = 2.0 / max(a + b + math.sqrt((a - b) ** 2 + 4.0 * both**2), 1e-12)
            along, across = was_t - stop * moved[i + 1], was_s - stop * moved[i + 2]
            size, most = math.sqrt(along**2 + across**2), friction * new
            if size > most:
                along *= most / size
                across *= most / size
            for k in range(3 * n):
                moved[k] += effect[i + 1, k] * (along - was_t) + effect[i + 2, k] * (across - was_s)
            force[i + 1], force[i + 2] = along, across
            change = max(change, abs(along - was_t), abs(across - was_s))
        if change < tolerance * largest:
            return True
    return False
