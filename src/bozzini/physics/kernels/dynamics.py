"""Numba: a chain in a lumen with a penalty wall, stepped as MuJoCo's ``implicitfast`` steps it.

Without Python and without its lock between the steps, so that threads step many chains at once.
Units are mm, kg, s and mN. The chain is a slide, and two hinges, about x and then about y, at the
base of each link; body 0 is the world and body 1 the base, as in MuJoCo's arrays.
"""

from __future__ import annotations

import math

import numpy as np

from ...duct.kernels.clearance import clearance_slope, split_along
from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_vector
from .contact import factor_mass, find_contacts, hold_contacts, solve_mass

WILD = 1e10  # a rate from which on MuJoCo, too, calls a simulation not stable


@kernel
def place_links(base, lengths, positions, state):
    """Fill where bodies, joints and the tip are for the slide and the hinges (v,)."""
    places, turns, axes, anchors, tip = state
    turn = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            turn[i, j] = turns[1, 3 * i + j] = base[i, j]
        axes[0, i] = base[i, 2]
        places[1, i] = anchors[0, i] = base[i, 3] + positions[0] * base[i, 2]
        tip[0, i] = places[1, i]
    for k in range(lengths.shape[0]):
        ca, sa = math.cos(positions[1 + 2 * k]), math.sin(positions[1 + 2 * k])
        cb, sb = math.cos(positions[2 + 2 * k]), math.sin(positions[2 + 2 * k])
        for i in range(3):
            places[k + 2, i] = anchors[1 + 2 * k, i] = anchors[2 + 2 * k, i] = tip[0, i]
            x, y, z = turn[i, 0], turn[i, 1], turn[i, 2]
            across, ahead = ca * y + sa * z, ca * z - sa * y
            axes[1 + 2 * k, i], axes[2 + 2 * k, i] = x, across
            turn[i, 0], turn[i, 1], turn[i, 2] = cb * x - sb * ahead, across, sb * x + cb * ahead
            for j in range(3):
                turns[k + 2, 3 * i + j] = turn[i, j]
            tip[0, i] += lengths[k] * turn[i, 2]


@kernel(inline="always")
def _apply(body, w, v, out):
    """Fill (6,) with momentum about the origin: angular, linear; of a body's ten moments."""
    m, x, y, z = body[0], body[1], body[2], body[3]
    out[0] = body[4] * w[0] + body[5] * w[1] + body[6] * w[2] + y * v[2] - z * v[1]
    out[1] = body[5] * w[0] + body[7] * w[1] + body[8] * w[2] + z * v[0] - x * v[2]
    out[2] = body[6] * w[0] + body[8] * w[1] + body[9] * w[2] + x * v[1] - y * v[0]
    out[3] = m * v[0] + w[1] * z - w[2] * y
    out[4] = m * v[1] + w[2] * x - w[0] * z
    out[5] = m * v[2] + w[0] * y - w[1] * x


@kernel(inline="always")
def _add_cross(a, b, scale, out):
    """Add scale a x b to out (3,)."""
    out[0] += scale * (a[1] * b[2] - a[2] * b[1])
    out[1] += scale * (a[2] * b[0] - a[0] * b[2])
    out[2] += scale * (a[0] * b[1] - a[1] * b[0])


@kernel
def weigh_chain(inertia, state, rates, mass, bias):
    """Fill the lower triangle of the mass matrix (v, v), and the forces of motion itself (v,).

    `inertia` has the masses of the base and of the links (n + 1,), how far ahead of its joint each
    link's centre is, and its moments about an axis across and along it (n,). By composite bodies
    and by Newton and Euler, moments about the place of the first hinge, which stands still here.
    """
    masses, centres, across, along = inertia
    places, turns, axes, anchors, _ = state
    count, size = centres.shape[0], rates.shape[0]
    bodies, forces = np.empty((count, 10)), np.empty((count, 6))
    screws = np.empty((6, size))  # turn and shift of each joint's unit rate
    turn, shift, more_turn, more_shift = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    own_turn, own_shift, arm = np.zeros(3), np.zeros(3), np.zeros(3)
    momentum, force = np.empty(6), np.zeros(6)
    origin = places[2]
    for v in range(size):
        for i in range(3):
            own_turn[i] = 0.0 if v == 0 else axes[v, i]
            own_shift[i] = axes[v, i] if v == 0 else 0.0
            arm[i] = anchors[v, i] - origin[i]
        _add_cross(arm, own_turn, 1.0, own_shift)
        for i in range(3):
            screws[i, v], screws[3 + i, v] = own_turn[i], own_shift[i]
        if v > 0:
            _add_cross(turn, own_turn, rates[v], more_turn)
            _add_cross(turn, own_shift, rates[v], more_shift)
            _add_cross(shift, own_turn, rates[v], more_shift)
        for i in range(3):
            turn[i] += rates[v] * own_turn[i]
            shift[i] += rates[v] * own_shift[i]
        if v == 0 or v % 2 == 1:
            continue
        k = v // 2 - 1
        m, ahead, thick, thin = masses[k + 1], centres[k], across[k], along[k]
        body, t = bodies[k], turns[k + 2]
        for i in range(3):
            arm[i] = places[k + 2, i] - origin[i] + ahead * t[3 * i + 2]
            body[1 + i] = m * arm[i]
        body[0], at = m, 4
        square = arm[0] ** 2 + arm[1] ** 2 + arm[2] ** 2
        for i in range(3):
            for j in range(i, 3):
                body[at] = (thin - thick) * t[3 * i + 2] * t[3 * j + 2] - m * arm[i] * arm[j]
                if i == j:
                    body[at] += thick + m * square
                at += 1
        _apply(body, turn, shift, momentum)
        _apply(body, more_turn, more_shift, forces[k])
        _add_cross(turn, momentum[:3], 1.0, forces[k, :3])
        _add_cross(shift, momentum[3:], 1.0, forces[k, :3])
        _add_cross(turn, momentum[3:], 1.0, forces[k, 3:])
    whole = np.zeros(10)
    for v in range(size - 1, -1, -1):
        if v > 0 and v % 2 == 0:
            for i in range(10):
                whole[i] += bodies[v // 2 - 1, i]
            for i in range(6):
                force[i] += forces[v // 2 - 1, i]
        for i in range(3):
            own_turn[i], own_shift[i] = screws[i, v], screws[3 + i, v]
        _apply(whole, own_turn, own_shift, momentum)
        a, b, c, d, e, f = (
            momentum[0], momentum[1], momentum[2], momentum[3], momentum[4], momentum[5],
        )  # fmt: skip
        for i in range(v + 1):
            mass[v, i] = (
                a * screws[0, i] + b * screws[1, i] + c * screws[2, i]
                + d * screws[3, i] + e * screws[4, i] + f * screws[5, i]
            )  # fmt: skip
        bias[v] = 0.0
        for i in range(6):
            bias[v] += screws[i, v] * force[i]
    mass[0, 0] += masses[0]


@kernel
def is_in_tube(duct, tube, x, y, z):
    """Whether the wall at a point is the introducer's, not the lumen's."""
    if tube[6] <= 0.0:
        return False
    along, off = split_along(tube, x, y, z)
    return along >= 0.0 and tube[6] - off > clearance_slope(duct, x, y, z)[0]


@kernel(nogil=True)
def advance_chain(wall, chain, drives, motion, state, scene, law, memory):
    """Make steps in which the drives go evenly from one place to another.

    Returns the sum of the normal forces of the last step [mN] but for those in the introducer, the
    least clearance of the axis and its sample, how many steps did not settle, the work of the
    drives [mN mm], and how many steps were made: less than wanted if it was not stable.

    Parameters
    ----------
    wall : tuple
        The packed duct, the introducer (7,) and the frame (4, 3), as in `find_contacts`.
    chain : tuple
        Base (4, 4), lengths (n,), and the four of `weigh_chain`.
    drives : tuple
        Of all joints (v,): stiffness, damping, and what armature and damping over a step add to the
        mass; of the drives (u,): joint, gain, damping, and how far ahead of it a rate puts one [s].
    motion : tuple
        Where the drives are and are to be (u,), and the number of steps.
    state : tuple
        Places and rates of the joints (v,); are changed.
    scene : tuple
        Places and turns of bodies, axes and places of joints, the tip; are filled.
    law : tuple
        As in `press_contacts`, and the body's radius and the margin.
    memory : tuple
        Body and place of the samples (m,), (m,); their points (m, 3) and forces (m, 3), changed.
    """
    duct, tube, frame = wall
    base, lengths = chain[0], chain[1]
    stiffness, damping, added, driven, gains, damps, lags = drives
    start, goal, count = motion
    positions, rates = state
    pressing, radius, margin = law
    bodies, along, points, before = memory
    step, size, many = pressing[3], rates.shape[0], points.shape[0]
    mass, bias, force = np.empty((size, size)), np.empty(size), np.empty(size)
    index, depth, normal = np.empty(many, np.int64), np.empty(many), np.empty((many, 3))
    pressed, least, where, unsettled, work = 0.0, math.inf, 0, 0, 0.0
    for s in range(1, count + 1):
        place_links(base, lengths, positions, scene)
        weigh_chain((chain[2], chain[3], chain[4], chain[5]), scene, rates, mass, bias)
        for v in range(size):
            mass[v, v] += added[v]
            force[v] = -stiffness[v] * positions[v] - damping[v] * rates[v] - bias[v]
        for u in range(driven.shape[0]):
            way = goal[u] - start[u]
            wanted = start[u] + s / count * way + lags[u] * way / (count * step)
            v = driven[u]
            force[v] += gains[u] * (wanted - positions[v]) - damps[u] * rates[v]
        near = margin + 2.0 * step * abs(rates[0])
        found, least, where = find_contacts(
            wall, (scene[0], scene[1]), (bodies, along), points, (radius, near), index, depth,
            normal,
        )  # fmt: skip
        factor_mass(mass)
        free = rates + step * solve_mass(mass, force)
        pressed = 0.0
        if found:
            places, normals = np.empty((found, 3)), np.empty((found, 3))
            owners, forces = np.empty(found, np.int64), np.empty((found, 3))
            for c in range(found):
                owners[c] = 2 * bodies[index[c]] - 1
                for i in range(3):
                    normals[c, i] = 0.0
                    for j in range(3):
                        normals[c, i] += frame[i, j] * normal[c, j]
                    places[c, i] = points[index[c], i] - radius * normals[c, i]
                    forces[c, i] = before[index[c], i]
            total, settled = hold_contacts(
                mass, free, (scene[2], scene[3]), (places, normals, depth[:found], owners),
                pressing, forces, np.empty((found, 3, 3)),
            )  # fmt: skip
            unsettled += not settled
            free += step * solve_mass(mass, total)
        before[:] = 0.0
        for c in range(found):
            copy_vector(forces[c], before[index[c]])
            if s == count and forces[c, 0] > 0.0:
                x, y, z = frame[3, 0], frame[3, 1], frame[3, 2]
                for j in range(3):
                    x += frame[j, 0] * places[c, j]
                    y += frame[j, 1] * places[c, j]
                    z += frame[j, 2] * places[c, j]
                if not is_in_tube(duct, tube, x, y, z):
                    pressed += forces[c, 0]
        for u in range(driven.shape[0]):
            way, v = goal[u] - start[u], driven[u]
            wanted = start[u] + s / count * way + lags[u] * way / (count * step)
            work += step * free[v] * (gains[u] * (wanted - positions[v]) - damps[u] * free[v])
        for v in range(size):
            if not abs(free[v]) < WILD:
                return pressed, least, where, unsettled, work, s - 1
            rates[v] = free[v]
            positions[v] += step * free[v]
    return pressed, least, where, unsettled, work, count
