"""Numba kernels of loads on the discrete rod: potential, gradient, Hessian, places of points.

A rotation ``w_j`` of segment j moves everything beyond it as a rigid body: a point at ``p`` by
``(moving_j + turning_j x p) dw_j``, where ``turning_j`` and ``moving_j`` are 3x3 (`fill_twists`).
Sums over what lies beyond a segment give gradient and Hessian in O(n^2).

``grid`` is that of the kernels of the energy model. ``stations`` are points of the body: the
segment of each (p,), the part of it that lies before the point (p,), in [0, 1], and the point's
place in the cross-section's frame there (p, 3) [mm]. All vectors are in the frame of the base.
"""

from __future__ import annotations

import numpy as np

from ...numeric.compiling import kernel
from .energy import (
    CHORD,
    add_form,
    add_form_hessian,
    fill_frames,
    fill_functions,
    fill_rotation,
    move_forward,
)


@kernel
def cross(a, b, out):
    """Cross product of two vectors (3,)."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def multiply(a, b, out):
    """Product of two 3x3 matrices."""
    for i in range(3):
        for k in range(3):
            out[i, k] = a[i, 0] * b[0, k] + a[i, 1] * b[1, k] + a[i, 2] * b[2, k]


@kernel
def rotate_back(rotation, vector, out):
    """Vector (3,) in the axes of a rotation matrix."""
    for i in range(3):
        out[i] = (
            rotation[0, i] * vector[0] + rotation[1, i] * vector[1] + rotation[2, i] * vector[2]
        )


@kernel
def fill_twists(grid, rotation_vectors, rotations, points, turning, moving):
    """Fill frames of the discs, base first, and how each segment's rotation moves what is beyond.

    ``rotations`` (n + 1, 3, 3) and ``points`` (n + 1, 3) as of `fill_frames`; ``turning`` and
    ``moving`` (n, 3, 3): a point at ``p`` beyond segment j moves by ``moving_j dw + (turning_j dw)
    x p``, a frame there rotates by ``turning_j dw``.
    """
    spans, _, _, _, _, segment = grid
    fill_frames(grid, rotation_vectors, rotations, points)
    f, half = np.empty(8), np.empty(8)
    step, slope, left_jacobian, way = np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for j in range(spans.size):
        w = rotation_vectors[j]
        q = w[0] ** 2 + w[1] ** 2 + w[2] ** 2
        fill_functions(q, f)
        fill_functions(0.25 * q, half)
        move_forward(w, f, half, spans[j], segment, step, slope)
        fill_rotation(w, f[1:], left_jacobian)
        multiply(rotations[j], left_jacobian, turning[j])
        multiply(rotations[j], slope, moving[j])
        for k in range(3):
            cross(points[j + 1], turning[j, :, k], way)
            for i in range(3):
                moving[j, i, k] += way[i]


@kernel
def locate_station(
    grid, rotation_vectors, frames, station, offset, place, rotation, own, own_turning
):
    """Place (3,) and frame (3, 3) of a point of the body, and their change by its own segment.

    ``frames`` are rotations and points of the discs, ``station`` the segment and the part of it,
    and ``offset`` (3,) the place in the cross-section there. ``own`` (3, 3) moves the point,
    ``own_turning`` (3, 3) rotates its frame.
    """
    spans, _, _, _, _, segment = grid
    rotations, points = frames
    j, part = station
    w = rotation_vectors[j]
    q = w[0] ** 2 + w[1] ** 2 + w[2] ** 2
    f, half = np.empty(8), np.empty(8)
    step, slope, rotation_part = np.zeros(3), np.zeros((3, 3)), np.empty((3, 3))
    fill_functions(part * part * q, f)
    if segment == CHORD:
        fill_functions(0.25 * q, half)
        add_form(w, half, 0, 0.0, 0.0, 1.0, part * spans[j], 0.5, step, slope)
    else:
        add_form(w, f, 1, 0.0, 0.0, 1.0, part * spans[j], part, step, slope)
    add_form(w, f, 0, offset[0], offset[1], offset[2], 1.0, part, step, slope)
    for i in range(3):
        place[i] = points[j, i]
        for k in range(3):
            place[i] += rotations[j, i, k] * step[k]
    multiply(rotations[j], slope, own)
    inner = part * w
    fill_rotation(inner, f, rotation_part)
    multiply(rotations[j], rotation_part, rotation)
    fill_rotation(inner, f[1:], rotation_part)
    multiply(rotations[j], part * rotation_part, own_turning)


@kernel
def fill_station_jacobian(twists, station, state, jacobian):
    """Fill how the segments' rotations move a point of the body: rotation, then place, (6, 3 n).

    ``twists`` are turning and moving of all segments, ``station`` is the point's segment and the
    part of it, ``state`` what `locate_station` fills: place, rotation, own and own_turning.
    """
    turning, moving = twists
    place, _, own, own_turning = state
    jacobian[:] = 0.0
    way = np.empty(3)
    for j in range(station[0]):
        for k in range(3):
            cross(turning[j, :, k], place, way)
            for i in range(3):
                jacobian[i, 3 * j + k] = turning[j, i, k]
                jacobian[3 + i, 3 * j + k] = moving[j, i, k] + way[i]
    for i in range(3):
        for k in range(3):
            jacobian[i, 3 * station[0] + k] = own_turning[i, k]
            jacobian[3 + i, 3 * station[0] + k] = own[i, k]


@kernel
def locate_stations(grid, rotation_vectors, stations, places, rotations, jacobians):
    """Fill places (p, 3), frames (p, 3, 3) and Jacobians (p, 6, 3 n) of points of the body.

    Rows of a Jacobian are the rotation and the motion of the point, in the base's frame; columns
    are the rotations, segment by segment. No Jacobian is filled where there is no space for one.
    """
    segments, parts, offsets = stations
    n = rotation_vectors.shape[0]
    discs, points = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    turning, moving = np.empty((n, 3, 3)), np.empty((n, 3, 3))
    fill_twists(grid, rotation_vectors, discs, points, turning, moving)
    own, own_turning = np.empty((3, 3)), np.empty((3, 3))
    for p in range(segments.size):
        station = segments[p], parts[p]
        locate_station(
            grid,
            rotation_vectors,
            (discs, points),
            station,
            offsets[p],
            places[p],
            rotations[p],
            own,
            own_turning,
        )
        if p < len(jacobians):
            state = places[p], rotations[p], own, own_turning
            fill_station_jacobian((turning, moving), station, state, jacobians[p])


@kernel
def add_matrix_hessian(w, f, pairs, hessian):
    """Add to ``hessian`` the second derivative by ``w`` of ``sum d . exp(w) r``.

    ``pairs`` (3, 3) is ``sum r d^T``, ``f`` are the functions of ``w``.
    """
    x = (
        pairs[1, 2] - pairs[2, 1],
        pairs[2, 0] - pairs[0, 2],
        pairs[0, 1] - pairs[1, 0],
    )
    dot = pairs[0, 0] + pairs[1, 1] + pairs[2, 2]
    cross_part = w[0] * x[0] + w[1] * x[1] + w[2] * x[2]
    both = np.empty(3)
    square = 0.0
    for i in range(3):
        both[i] = 0.0
        for k in range(3):
            both[i] += (pairs[i, k] + pairs[k, i]) * w[k]
        square += 0.5 * both[i] * w[i]
    first = -f[1] * dot + (f[3] - f[2]) * cross_part + (2.0 * f[4] - f[3]) * square
    second = (
        (f[2] - f[3]) * dot
        + (f[3] - 3.0 * f[4] + 3.0 * f[5]) * cross_part
        + (f[4] - 5.0 * f[5] + 8.0 * f[6]) * square
    )
    slope = np.empty(3)
    for i in range(3):
        slope[i] = (f[3] - f[2]) * x[i] + (2.0 * f[4] - f[3]) * both[i] + 0.5 * second * w[i]
    for i in range(3):
        hessian[i, i] += first
        for k in range(3):
            hessian[i, k] += w[i] * slope[k] + w[k] * slope[i] + f[2] * (pairs[i, k] + pairs[k, i])


@kernel
def add_step_hessian(grid, w, index, part, force, hessian):
    """Add the second derivative by ``w`` of ``force . step``, up to a part of a segment.

    ``force`` (3,) is in the frame where the segment begins.
    """
    spans, _, _, _, _, segment = grid
    f = np.empty(8)
    q = w[0] ** 2 + w[1] ** 2 + w[2] ** 2
    long = part * spans[index]
    if segment == CHORD:
        fill_functions(0.25 * q, f)
        add_form_hessian(w, f, 0, 0.0, 0.0, 1.0, force, long, 0.5, hessian)
    else:
        fill_functions(part * part * q, f)
        add_form_hessian(w, f, 1, 0.0, 0.0, 1.0, force, long, part, hessian)


@kernel
def measure_loads(grid, rotation_vectors, stations, loads, gradient, hessian):
    """Potential of loads [N mm], minus their work by rotation, and minus how that changes.

    ``loads`` are forces (p, 3) [N], moments (p, 3) [N mm] at the ``stations``, and which of both
    keep to the body's frame there (p,); the others keep to the base's. Fills ``gradient`` (n, 3),
    the residual of the loads, and ``hessian`` (3 n, 3 n), its tangent. Forces that keep to the
    base's frame have a potential, which is returned, and these are its gradient and exact Hessian;
    moments and forces that follow the body have none, and their tangent is not symmetric.
    """
    segments, parts, offsets = stations
    forces, moments, follows = loads
    n, count = rotation_vectors.shape[0], segments.size
    rotations, points = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    turning, moving = np.empty((n, 3, 3)), np.empty((n, 3, 3))
    fill_twists(grid, rotation_vectors, rotations, points, turning, moving)
    gradient[:] = 0.0
    hessian[:] = 0.0
    potential = 0.0
    # Force, place by force and moment beyond each segment, and what acts on its own rotation.
    force_on_segment, lever = np.zeros((n + 1, 3)), np.zeros((n + 1, 3, 3))
    moment = np.zeros((n + 1, 3))
    arm, twist, diagonal = np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
    places, owns, own_turnings = (
        np.empty((count, 3)),
        np.empty((count, 3, 3)),
        np.empty((count, 3, 3)),
    )
    rotation, force, torque = np.empty((3, 3)), np.empty((count, 3)), np.empty((count, 3))
    local, way, f = np.empty(3), np.empty(3), np.empty(8)
    has_moments = False
    for p in range(count):
        j, part = segments[p], parts[p]
        own, own_turning, place = owns[p], own_turnings[p], places[p]
        locate_station(
            grid,
            rotation_vectors,
            (rotations, points),
            (j, part),
            offsets[p],
            place,
            rotation,
            own,
            own_turning,
        )
        for i in range(3):
            force[p, i], torque[p, i] = forces[p, i], moments[p, i]
            if follows[p]:
                force[p, i], torque[p, i] = 0.0, 0.0
                for k in range(3):
                    force[p, i] += rotation[i, k] * forces[p, k]
                    torque[p, i] += rotation[i, k] * moments[p, k]
        for i in range(3):
            if not follows[p]:
                potential -= force[p, i] * place[i]
            force_on_segment[j, i] += force[p, i]
            moment[j, i] += torque[p, i]
            for k in range(3):
                lever[j, i, k] += place[i] * force[p, k]
                gradient[j, k] -= own[i, k] * force[p, i] + own_turning[i, k] * torque[p, i]
        for k in range(3):
            cross(own[:, k], force[p], way)
            for i in range(3):
                arm[j, i, k] += way[i]
            cross(own_turning[:, k], torque[p], way)
            for i in range(3):
                twist[j, i, k] += way[i]
        w = rotation_vectors[j]
        rotate_back(rotations[j], force[p], local)
        add_step_hessian(grid, w, j, part, local, diagonal[j])
        fill_functions(part * part * (w[0] ** 2 + w[1] ** 2 + w[2] ** 2), f)
        r = offsets[p]
        if r[0] != 0.0 or r[1] != 0.0 or r[2] != 0.0:
            add_form_hessian(w, f, 0, r[0], r[1], r[2], local, 1.0, part, diagonal[j])
        if torque[p, 0] != 0.0 or torque[p, 1] != 0.0 or torque[p, 2] != 0.0:
            has_moments = True
            rotate_back(rotations[j], torque[p], local)
            way[:] = 0.0
            slope = np.zeros((3, 3))
            add_form(w, f, 1, local[0], local[1], local[2], part, -part, way, slope)
            for i in range(3):
                for k in range(3):
                    diagonal[j, i, k] += slope[i, k]
    # From the tip to the base: sums over what lies beyond.
    beyond, beyond_lever, beyond_moment = np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    pairs, whole = np.empty((3, 3)), np.empty((3, 3))
    for j in range(n - 1, -1, -1):
        w = rotation_vectors[j]
        trace = beyond_lever[0, 0] + beyond_lever[1, 1] + beyond_lever[2, 2]
        whirl = (
            beyond_lever[1, 2] - beyond_lever[2, 1],
            beyond_lever[2, 0] - beyond_lever[0, 2],
            beyond_lever[0, 1] - beyond_lever[1, 0],
        )
        for k in range(3):
            cross(moving[j, :, k], beyond, way)
            for i in range(3):
                gradient[j, k] -= moving[j, i, k] * beyond[i] + turning[j, i, k] * (
                    whirl[i] + beyond_moment[i]
                )
                arm[j, i, k] += way[i] - trace * turning[j, i, k]
                for m in range(3):
                    arm[j, i, k] += beyond_lever[i, m] * turning[j, m, k]
            if has_moments:
                cross(turning[j, :, k], beyond_moment, way)
                for i in range(3):
                    twist[j, i, k] += way[i]
        rotate_back(rotations[j], beyond, local)
        add_step_hessian(grid, w, j, 1.0, local, diagonal[j])
        for i in range(3):
            for k in range(3):
                whole[i, k] = beyond_lever[i, k] - points[j + 1, i] * beyond[k]
        multiply(rotations[j + 1].T, whole, pairs)
        multiply(pairs, rotations[j], whole)
        fill_functions(w[0] ** 2 + w[1] ** 2 + w[2] ** 2, f)
        add_matrix_hessian(w, f, whole, diagonal[j])
        if has_moments:
            rotate_back(rotations[j], beyond_moment, local)
            way[:] = 0.0
            add_form(w, f, 1, local[0], local[1], local[2], 1.0, -1.0, way, diagonal[j])
        for i in range(3):
            beyond[i] += force_on_segment[j, i]
            beyond_moment[i] += moment[j, i]
            for k in range(3):
                beyond_lever[i, k] += lever[j, i, k]
    for j in range(n):
        for a in range(3):
            for b in range(3):
                hessian[3 * j + a, 3 * j + b] -= diagonal[j, a, b]
        for m in range(j):
            for a in range(3):
                for b in range(3):
                    value, extra = 0.0, 0.0
                    for i in range(3):
                        value += turning[m, i, a] * arm[j, i, b]
                        extra += turning[m, i, a] * twist[j, i, b]
                    hessian[3 * m + a, 3 * j + b] -= value
                    hessian[3 * j + b, 3 * m + a] -= value + extra
    for p in range(count):
        if follows[p]:
            _add_following(
                (turning, moving),
                segments[p],
                (places[p], rotation, owns[p], own_turnings[p]),
                (force[p], torque[p]),
                hessian,
            )
    return potential


@kernel
def _add_following(twists, segment, state, load, hessian):
    """Subtract the change of a force and a moment as they turn with the body."""
    size = 3 * segment + 3
    jacobian = np.empty((6, hessian.shape[0]))
    fill_station_jacobian(twists, (segment, 1.0), state, jacobian)
    force, torque = load
    moved, turned = np.empty(3), np.empty(3)
    for m in range(size):
        cross(jacobian[:3, m], force, moved)
        cross(jacobian[:3, m], torque, turned)
        for k in range(size):
            total = 0.0
            for i in range(3):
                total += jacobian[3 + i, k] * moved[i] + jacobian[i, k] * turned[i]
            hessian[k, m] -= total
