"""Numba kernels of the discrete rod in time: inertia, damping, one implicit stage for each step.

The rod is that of `kernels.energy`. *Unknowns*: the rotation vectors ``q`` (n, 3) of its segments
[rad], and with them the momenta ``pi = J^T P`` (n, 3) [N mm s], where ``v = J q' + v_base`` are
velocity and spin of the points that have mass, the middles of the segments and discs, and ``P = m
v``, ``L = R I R^T omega`` their momenta. With ``K = diag(EI, EI, GJ) / h``, the damping time
``tau``, the drag ``c`` and forces ``F`` and moments ``M`` of one direction::

    pi' = J'^T P - J^T (F, M) (its sign turned) - K (q - u) - tau K q' - J^T c v - sum_k T_k dl_k/dq
    pi = J^T P ;  T_k given, or max(0, (l_k - limit_k) / c_k) of a tendon whose length is held

``J'`` is the rate of J: ``J'^T P`` is the derivative of the kinetic energy by q at given q', so
these are Hamilton's equations, with the static model's equilibria. Tendons have no mass.

*In time* they are solved by the generalised alpha method for systems of first order (Jansen,
Whiting and Hulbert 2000), which has one parameter, the spectral radius rho of an infinitely fast
mode after one step: ``a_m = (3 - rho) / (2 + 2 rho)``, ``a_f = 1 / (1 + rho)``, ``g = 1/2 + a_m -
a_f``. It is of second order; rho = 1 is the implicit midpoint rule, rho = 0 forgets fast modes in
one step. A stage has ``q`` alone:
with ``s = a_m / (a_f g dt)``, ``q' = s (q - q_h)`` and ``pi' = s (pi - pi_h)``.

*Energy*: linear motions gain none at any step. Others may, as inertia ``M(q) = J^T m J`` changes
with the shape and the roll of thin segments, with hardly any inertia, is never resolved by a step.
So energy is counted after each, and one after which more than `GAIN` of it came from nowhere is
made anew, with rho = 0, then by the implicit Euler method (a_m = a_f = g = 1). That gains at most
``q'^T (dt M'[q'] - M_1 + M_0) q' / 2`` and what the potential bends down, both of second order in
the step's own motion, and loses ``m |v_1 - v_0|^2 / 2``. Then it is halved. Tendons with friction
are left out, as their balance is of first order.

*Newton's method* takes the tangent ``s^2 J^T m J + s (J^T c J + tau K) + d2V/dq2``; gyroscopic
terms, of the order of the rotation in one step, are left out, so it converges by about that factor.
The tangent is a chain: eliminating segment by segment from the tip, as the articulated-body method
does, takes O(n) (`factor_chain`). Held tendons add a matrix of rank t. Those with friction have in
each segment the tension of `kernels.capstan`, whose changes join all segments: the tangent is dense
then, and what contacts turn by is left out of it.

*Walls* press on the ends of the segments. In one step a wall is the plane ``c = c_0 + n . (x -
x_0)`` that its gap has where the end is expected, and a gap ``c`` below 0 gives the force ``-c /
e`` along ``n``, with the wall's compliance ``e``, as in `kernels.contact`. Friction is a spring of
the slip ``u`` across ``n``: ``f = -mu N u / max(|u|, u_0)``, with the normal force N of the step
before; u grows with the motion and is never longer than u_0 after a step (Coulomb with elastic
slip). A step with a wall's force is of the implicit Euler method, of first order: it remembers no
blow. Where the plane misses the wall's energy at the place that is found, a new one is taken there.

*A base that is free* has a place, and a rotation vector from its turn at the step's start. Its
momenta are the whole rod's, linear and about the origin, whose rates are all forces and moments: so
both are kept where there are none. The chain leaves six equations for it.

``body`` are the points with mass or load: segment (p,), in rising order, part of it before the
point (p,), mass (p,) [t], moments of inertia in the body's axes (p, 3) [t mm^2], drag (p,)
[N s/mm]. ``base`` is the motion of the base: rotation (3, 3), place, velocity, spin, and the rates
of these two (3,).
Vectors are in the axes of the base at rest.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_matrix, copy_vector
from ...numeric.kernels.linear_algebra import factor_lu, solve_lu
from .capstan import (
    add_tendon,
    begin_strings,
    keep_shares,
    keep_strings,
    make_strings,
    measure_strings,
    return_strings,
    settle_tensions,
)
from .energy import (
    CHORD,
    FOLD_ANGLE,
    STEP_LIMIT,
    add_form,
    add_form_hessian,
    fill_functions,
    fill_rotation,
    measure_lengths,
    move_forward,
)
from .loads import cross, multiply, rotate_back

MOST_ITERATIONS = 40
"""Steps of Newton's method in one stage."""

SLOW = 0.2
"""Ratio of two of its steps above which the tangent is made anew."""

TURN_TOLERANCE = 1e-9
"""Rotation of every segment that a further step of Newton's method would have [rad]."""

FREE_TOLERANCE = 1e-12
"""The same with a free base: a thin rod has little inertia about itself."""

WIDTH_MM = 1e-4
"""Distance over which contact begins [mm]."""

LEAST_CONTRACTION = 1e-3
"""Ratio of two steps that is counted on at best."""

LEAST_PART = 1.0 / 1024.0
"""Smallest part of a step that is tried where Newton's method fails, or the error is too large."""

FIRST_PART = 1.0 / 32.0
"""Part of a step that is tried first where its error is looked at."""

GAIN = 0.01
"""Energy that may come from nowhere since that was least, as a share of the most there or done."""

SMALL_BEND = 0.2
"""Bend of the whole rod, whose energy is the least that gains are judged by [rad]."""

CALM, EULER = 1, 2
"""How a step that gained is made anew: with a spectral radius of 0, by the implicit Euler's."""

CALM_STEPS = 8
"""Steps that go on so."""

LEAST_CALM = 1.0 / 16.0
"""Smallest part of a step that is tried for its energy."""

GAINED = -1
"""What `advance` returns of a step among walls that gained, and was not made."""

CAUTION, LEAST_CHANGE, MOST_CHANGE = 0.85, 0.2, 2.0
"""Change of a step by that which would just keep the tolerance, and bounds of it."""


@kernel
def make_motion(n, p):
    """Empty arrays of a motion.

    ``stations``: rotations (n + 1, 3, 3), places, velocities, spins (n + 1, 3). ``segments``:
    functions of ``q`` and of its half (n, 8), and what the change of its own rotation vector does
    to the segment's end: ``moving`` and ``turning`` (n, 3, 3). ``points``: functions (p, 8), arm
    from the start of the segment (p, 3), moving and turning (p, 3, 3), which are not filled of
    points at a segment's end; velocity, spin and angular momentum (p, 3), tensor of inertia (p, 3,
    3), the static forces and moments (p, 3) with their sign turned, the points' axes (p, 3, 3), and
    those forces and moments (p, 3) that turn with the body, as they are now.
    """
    stations = (
        np.empty((n + 1, 3, 3)),
        np.empty((n + 1, 3)),
        np.empty((n + 1, 3)),
        np.empty((n + 1, 3)),
    )
    segments = np.empty((n, 8)), np.empty((n, 8)), np.empty((n, 3, 3)), np.empty((n, 3, 3))
    points = (
        np.empty((p, 8)),
        np.empty((p, 3)),
        np.empty((p, 3, 3)),
        np.empty((p, 3, 3)),
        np.empty((p, 3)),
        np.empty((p, 3)),
        np.empty((p, 3)),
        np.empty((p, 3, 3)),
        np.empty((p, 3)),
        np.empty((p, 3)),
        np.empty((p, 3, 3)),
        np.zeros((2, p, 3)),
    )
    return stations, segments, points


@kernel
def fill_places(grid, q, base, body, motion):
    """Fill what does not depend on velocities; see `make_motion`."""
    spans, _, _, _, _, kind = grid
    rotations, places = motion[0][:2]
    functions, halves, moving, turning = motion[1]
    own_functions, arms, own_moving, own_turning = motion[2][:4]
    tensors, kept_axes = motion[2][7], motion[2][10]
    segments, parts, _, inertias, _ = body
    copy_matrix(base[0], rotations[0])
    copy_vector(base[1], places[0])
    step, slope, turn, inner = np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    inner_axes = np.empty((3, 3))
    p = 0
    for j in range(spans.size):
        w, f, half, rotation = q[j], functions[j], halves[j], rotations[j]
        square = w[0] ** 2 + w[1] ** 2 + w[2] ** 2
        fill_functions(square, f)
        fill_functions(0.25 * square, half)
        move_forward(w, f, half, spans[j], kind, step, slope)
        multiply(rotation, slope, moving[j])
        fill_rotation(w, f[1:], turn)
        multiply(rotation, turn, turning[j])
        fill_rotation(w, f, turn)
        multiply(rotation, turn, rotations[j + 1])
        for i in range(3):
            places[j + 1, i] = (
                places[j, i]
                + rotation[i, 0] * step[0]
                + rotation[i, 1] * step[1]
                + rotation[i, 2] * step[2]
            )
        while p < segments.size and segments[p] == j:
            part, own, axes = parts[p], own_functions[p], rotations[j + 1]
            if part < 1.0:
                axes = inner_axes
                if part == 0.5:
                    copy_vector(half, own)
                else:
                    fill_functions(part * part * square, own)
                step[:] = 0.0
                slope[:] = 0.0
                if kind == CHORD:
                    add_form(w, half, 0, 0.0, 0.0, 1.0, part * spans[j], 0.5, step, slope)
                else:
                    add_form(w, own, 1, 0.0, 0.0, 1.0, part * spans[j], part, step, slope)
                for i in range(3):
                    arms[p, i] = (
                        rotation[i, 0] * step[0]
                        + rotation[i, 1] * step[1]
                        + rotation[i, 2] * step[2]
                    )
                    inner[i] = part * w[i]
                multiply(rotation, slope, own_moving[p])
                fill_rotation(inner, own[1:], turn)
                for i in range(3):
                    for k in range(3):
                        turn[i, k] *= part
                multiply(rotation, turn, own_turning[p])
                fill_rotation(inner, own, turn)
                multiply(rotation, turn, axes)
            copy_matrix(axes, kept_axes[p])
            for i in range(3):
                for k in range(i + 1):
                    tensors[p, i, k] = (
                        axes[i, 0] * inertias[p, 0] * axes[k, 0]
                        + axes[i, 1] * inertias[p, 1] * axes[k, 1]
                        + axes[i, 2] * inertias[p, 2] * axes[k, 2]
                    )
                    tensors[p, k, i] = tensors[p, i, k]
            p += 1


@kernel
def _add_rates(moving, turning, rate, velocity, spin):
    for i in range(3):
        for k in range(3):
            velocity[i] += moving[i, k] * rate[k]
            spin[i] += turning[i, k] * rate[k]


@kernel
def _carry(velocity, spin, arm, velocity_there, spin_there):
    """Velocity and spin of the same rigid body at the end of an arm."""
    cross(spin, arm, velocity_there)
    for i in range(3):
        velocity_there[i] += velocity[i]
        spin_there[i] = spin[i]


@kernel
def fill_velocities(rate, base, body, motion):
    """Fill velocities, spins and angular momenta, where places are known."""
    _, places, velocities, spins = motion[0]
    moving, turning = motion[1][2:]
    _, arms, own_moving, own_turning, own_velocity, own_spin, angular, tensors = motion[2][:8]
    segments, parts = body[0], body[1]
    copy_vector(base[2], velocities[0])
    copy_vector(base[3], spins[0])
    arm, p = np.empty(3), 0
    for j in range(len(rate)):
        for i in range(3):
            arm[i] = places[j + 1, i] - places[j, i]
        _carry(velocities[j], spins[j], arm, velocities[j + 1], spins[j + 1])
        _add_rates(moving[j], turning[j], rate[j], velocities[j + 1], spins[j + 1])
        while p < segments.size and segments[p] == j:
            if parts[p] < 1.0:
                _carry(velocities[j], spins[j], arms[p], own_velocity[p], own_spin[p])
                _add_rates(own_moving[p], own_turning[p], rate[j], own_velocity[p], own_spin[p])
            else:
                copy_vector(velocities[j + 1], own_velocity[p])
                copy_vector(spins[j + 1], own_spin[p])
            for i in range(3):
                angular[p, i] = (
                    tensors[p, i, 0] * own_spin[p, 0]
                    + tensors[p, i, 1] * own_spin[p, 1]
                    + tensors[p, i, 2] * own_spin[p, 2]
                )
            p += 1


@kernel
def _add_transposed(matrix, vector, out):
    """Add ``matrix^T vector`` to ``out`` (3,)."""
    for k in range(3):
        out[k] += matrix[0, k] * vector[0] + matrix[1, k] * vector[1] + matrix[2, k] * vector[2]


@kernel
def _shift(arm, force, moment):
    """Add the moment of a force at the end of an arm."""
    moment[0] += arm[1] * force[2] - arm[2] * force[1]
    moment[1] += arm[2] * force[0] - arm[0] * force[2]
    moment[2] += arm[0] * force[1] - arm[1] * force[0]


@kernel
def _add_step_hessian(w, f, half, span, part, kind, force, out):
    """Add the second derivative of ``force . step`` up to a part of a segment to ``out`` (3, 3)."""
    if kind == CHORD:
        add_form_hessian(w, half, 0, 0.0, 0.0, 1.0, force, part * span, 0.5, out)
    else:
        add_form_hessian(w, f, 1, 0.0, 0.0, 1.0, force, part * span, part, out)


@kernel
def _subtract_inertial(w, kind, segment, state, momentum, scratch, out):
    """Subtract ``J'^T P`` of one lever: what lies beyond a segment, or a point of it.

    ``segment`` are rotation and spin where it begins, its span, the rate of its rotation vector and
    the functions of its half; ``state`` the part of it, the functions there, moving and turning;
    ``momentum`` linear and angular.
    """
    rotation, spin, span, rate, half = segment
    part, f, moving, turning = state
    linear, angular = momentum
    way, local, hessian = scratch
    cross(spin, linear, way)
    _add_transposed(moving, way, out)
    cross(spin, angular, way)
    _add_transposed(turning, way, out)
    hessian[:] = 0.0
    rotate_back(rotation, linear, local)
    _add_step_hessian(w, f, half, span, part, kind, local, hessian)
    rotate_back(rotation, angular, local)
    way[:] = 0.0
    add_form(w, f, 1, local[0], local[1], local[2], part, -part, way, hessian)
    for i in range(3):
        for k in range(3):
            out[i] -= hessian[i, k] * rate[k]


@kernel
def press_end(walls, j, place, velocity, pushes):
    """Take the forces of walls on a segment's end from ``pushes`` (3,); returns friction's power.

    ``walls`` are where the ends are expected (n, 3), their gaps there (w, n), infinite where a wall
    is far, and the gaps' gradients (w, n, 3); compliances of the wall (n,) [mm/N]; friction and its
    elastic slip [mm]; slips (w, n, 3), normal forces (w, n) [N] and ends (n, 3) of the step before;
    and what is filled: slips (w, n, 3), normal forces (w, n) and the stiffness (n, 3, 3) by the
    motion of the ends.
    """
    origins, gaps, normals, compliances, law, before, filled = walls
    slips, forces_before, places_before = before
    slips_now, forces, blocks = filled
    friction, small = law
    power = 0.0
    blocks[j] = 0.0
    flexibility, softness = compliances[j], WIDTH_MM / compliances[j]
    for w in range(len(gaps)):
        forces[w, j] = 0.0
        slips_now[w, j] = 0.0
        if gaps[w, j] == math.inf:
            continue
        normal, gap = normals[w, j], gaps[w, j]
        for i in range(3):
            gap += normal[i] * (place[i] - origins[j, i])
        hard = -gap / flexibility
        root = math.sqrt(hard * hard + 4.0 * softness * softness)
        force = 0.5 * (hard + root) if hard > 0.0 else 2.0 * softness * softness / (root - hard)
        stiffness = force / (root * flexibility)
        forces[w, j] = force
        for i in range(3):
            pushes[i] -= force * normal[i]
            for k in range(3):
                blocks[j, i, k] += stiffness * normal[i] * normal[k]
        limit = friction * forces_before[w, j]
        square = normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2
        if limit == 0.0 or square == 0.0:
            continue
        slip, along = slips_now[w, j], 0.0
        for i in range(3):
            slip[i] = slips[w, j, i] + place[i] - places_before[j, i]
            along += normal[i] * slip[i]
        size = 0.0
        for i in range(3):
            slip[i] -= along / square * normal[i]
            size += slip[i] * slip[i]
        size = math.sqrt(size)
        sticks, hold = size <= small, limit / max(size, small)
        for i in range(3):
            pushes[i] += hold * slip[i]
            power -= hold * slip[i] * velocity[i]
            for k in range(3):
                across = (1.0 if i == k else 0.0) - normal[i] * normal[k] / square
                if not sticks:
                    across -= slip[i] * slip[k] / (size * size)
                blocks[j, i, k] += hold * across
        for i in range(3):
            slip[i] *= min(1.0, small / max(size, small))
    return power


@kernel
def _measure_press(walls, ahead):
    """Deepest place in a wall [mm]: of the step before and as expected if ``ahead``, or now."""
    gaps, compliances, forces_before, forces = walls[1], walls[3], walls[5][1], walls[6][1]
    deepest = 0.0
    for w in range(len(gaps)):
        for j in range(len(compliances)):
            depth = compliances[j] * (forces_before[w, j] if ahead else forces[w, j])
            deepest = max(deepest, depth - 2.0 * WIDTH_MM, -gaps[w, j] if ahead else 0.0)
    return deepest


@kernel
def _keep_contacts(walls, places):
    """Make what a step has found of walls what the next one starts from."""
    slips, forces, places_before = walls[5]
    slips_now, forces_now, _ = walls[6]
    for w in range(len(forces)):
        for j in range(len(places_before)):
            forces[w, j] = forces_now[w, j]
            copy_vector(slips_now[w, j], slips[w, j])
    for j in range(len(places_before)):
        copy_vector(places[j + 1], places_before[j])


@kernel
def measure_motion(rod, q, rate, drive, motion, beyond, momentum, force):
    """Momenta and minus their rate without tendons, of rotations and their rates.

    ``rod`` is the grid, the rotations at rest (n, 3), the segments' damping (n, 3) by their rates
    [N mm s] and the ``body``; ``drive`` the base, the forces and moments (p, 3), the weights (p,
    3) that are among the forces, the walls of `press_end`, and forces and moments in the body's
    axes (2, p, 3), none if there is none. Fills ``motion``, ``beyond`` (n + 2, 2, 3), the static
    forces and moments beyond each segment with their sign turned, ``momentum`` and ``force`` (n,
    3), so that ``momentum' + force = 0``. Returns the powers of loads and base, and of all damping
    [N mm/s].
    """
    grid, rest, damping, body = rod
    base, forces, moments, weights, walls, turning_loads = drive
    spans, stiffness, _, _, _, kind = grid
    fill_places(grid, q, base, body, motion)
    fill_velocities(rate, base, body, motion)
    rotations, places, velocities, spins = motion[0]
    functions, halves, moving, turning = motion[1]
    own_functions, arms, own_moving, own_turning, own_velocity, own_spin = motion[2][:6]
    angular, _, pushes, twists, point_axes, turned_loads = motion[2][6:]
    segments, parts, masses, _, drags = body
    power, lost = 0.0, 0.0
    linear_beyond, angular_beyond = np.zeros(3), np.zeros(3)
    force_beyond, moment_beyond = np.zeros(3), np.zeros(3)
    linear, way, arm = np.empty(3), np.empty(3), np.empty(3)
    scratch = np.empty(3), np.empty(3), np.empty((3, 3))
    for p in range(segments.size):
        for i in range(3):
            v = own_velocity[p, i]
            pushes[p, i] = drags[p] * v - forces[p, i]
            twists[p, i] = -moments[p, i]
            power += (forces[p, i] - weights[p, i]) * v + moments[p, i] * own_spin[p, i]
            lost += drags[p] * v * v
        for i in range(3 if turning_loads.shape[1] > 0 else 0):
            f, m = 0.0, 0.0
            for k in range(3):
                f += point_axes[p, i, k] * turning_loads[0, p, k]
                m += point_axes[p, i, k] * turning_loads[1, p, k]
            turned_loads[0, p, i], turned_loads[1, p, i] = f, m
            pushes[p, i] -= f
            twists[p, i] -= m
            power += f * own_velocity[p, i] + m * own_spin[p, i]
        if parts[p] == 1.0 and len(walls[1]) > 0:
            j = segments[p]
            lost -= press_end(walls, j, places[j + 1], own_velocity[p], pushes[p])
    p = segments.size - 1
    for j in range(spans.size - 1, -1, -1):
        w, f, half = q[j], functions[j], halves[j]
        segment = rotations[j], spins[j], spans[j], rate[j], half
        while p >= 0 and segments[p] == j and parts[p] == 1.0:
            for i in range(3):
                linear_beyond[i] += masses[p] * own_velocity[p, i]
                angular_beyond[i] += angular[p, i]
                force_beyond[i] += pushes[p, i]
                moment_beyond[i] += twists[p, i]
            p -= 1
        copy_vector(force_beyond, beyond[j, 0])
        copy_vector(moment_beyond, beyond[j, 1])
        for i in range(3):
            bent = q[j, i] - rest[j, i]
            lost += damping[j, i] * rate[j, i] ** 2
            force[j, i] = stiffness[j, i] * bent + damping[j, i] * rate[j, i]
            momentum[j, i] = 0.0
            arm[i] = places[j + 1, i] - places[j, i]
        _add_transposed(moving[j], linear_beyond, momentum[j])
        _add_transposed(turning[j], angular_beyond, momentum[j])
        _add_transposed(moving[j], force_beyond, force[j])
        cross(velocities[j + 1], linear_beyond, way)
        for i in range(3):
            way[i] += moment_beyond[i]
        _add_transposed(turning[j], way, force[j])
        state = 1.0, f, moving[j], turning[j]
        known = linear_beyond, angular_beyond
        _subtract_inertial(w, kind, segment, state, known, scratch, force[j])
        _shift(arm, linear_beyond, angular_beyond)
        _shift(arm, force_beyond, moment_beyond)
        while p >= 0 and segments[p] == j:
            for i in range(3):
                linear[i] = masses[p] * own_velocity[p, i]
            _add_transposed(own_moving[p], linear, momentum[j])
            _add_transposed(own_turning[p], angular[p], momentum[j])
            _add_transposed(own_moving[p], pushes[p], force[j])
            _add_transposed(own_turning[p], twists[p], force[j])
            state = parts[p], own_functions[p], own_moving[p], own_turning[p]
            known = linear, angular[p]
            _subtract_inertial(w, kind, segment, state, known, scratch, force[j])
            for i in range(3):
                linear_beyond[i] += linear[i]
                angular_beyond[i] += angular[p, i]
                force_beyond[i] += pushes[p, i]
                moment_beyond[i] += twists[p, i]
            _shift(arms[p], linear, angular_beyond)
            _shift(arms[p], pushes[p], moment_beyond)
            p -= 1
    copy_vector(linear_beyond, beyond[spans.size, 0])
    copy_vector(angular_beyond, beyond[spans.size, 1])
    copy_vector(force_beyond, beyond[spans.size + 1, 0])
    copy_vector(moment_beyond, beyond[spans.size + 1, 1])
    # What moves the base does P' . v + (H' + v x P) . omega with what holds the loads; of that
    # (P . v + H . omega)' is in `measure_energies`.
    cross(base[2], linear_beyond, way)
    for i in range(3):
        power += force_beyond[i] * base[2][i] + (moment_beyond[i] + way[i]) * base[3][i]
        power -= linear_beyond[i] * base[4][i] + angular_beyond[i] * base[5][i]
    return power, lost


@kernel
def make_chain(n):
    """Empty arrays of `factor_chain`."""
    return (
        np.empty((n, 3, 3)),
        np.empty((n, 3, 6)),
        np.empty((n, 6, 3)),
        np.empty((n, 3, 3)),
        np.empty((n, 3, 3)),
        np.empty((n, 3)),
        np.empty((6, 6)),
        np.empty(6, dtype=np.int64),
    )


@kernel
def _invert(a, inverse):
    """Fill the inverse of a 3x3 matrix; False if it is singular."""
    c0 = a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]
    c1 = a[1, 2] * a[2, 0] - a[1, 0] * a[2, 2]
    c2 = a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0]
    det = a[0, 0] * c0 + a[0, 1] * c1 + a[0, 2] * c2
    if not abs(det) > 0.0 or not math.isfinite(det):
        return False
    scale = 1.0 / det
    inverse[0, 0], inverse[1, 0], inverse[2, 0] = scale * c0, scale * c1, scale * c2
    inverse[0, 1] = scale * (a[0, 2] * a[2, 1] - a[0, 1] * a[2, 2])
    inverse[1, 1] = scale * (a[0, 0] * a[2, 2] - a[0, 2] * a[2, 0])
    inverse[2, 1] = scale * (a[0, 1] * a[2, 0] - a[0, 0] * a[2, 1])
    inverse[0, 2] = scale * (a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1])
    inverse[1, 2] = scale * (a[0, 2] * a[1, 0] - a[0, 0] * a[1, 2])
    inverse[2, 2] = scale * (a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0])
    return True


@kernel
def _add_branch(weights, arm, moving, turning, rotational, block, gain, lift, whole):
    """Add a point's share: ``weights`` are its mass and its drag, as of the rates' squares.

    ``rotational`` (3, 3) is the same of its rotation.
    """
    a0, a1, a2 = arm[0], arm[1], arm[2]
    turned = np.empty((3, 3))
    multiply(rotational, turning, turned)
    for i in range(3):
        for k in range(3):
            total = 0.0
            for m in range(3):
                total += weights * moving[m, i] * moving[m, k] + turning[m, i] * turned[m, k]
            block[i, k] += total
            gain[i, k] += weights * moving[k, i]
            lift[k, i] += weights * moving[k, i]
            whole[3 + i, 3 + k] += rotational[i, k]
        # -O^T [a] has rows a x O_i.
        o0, o1, o2 = weights * moving[0, i], weights * moving[1, i], weights * moving[2, i]
        c0, c1, c2 = a1 * o2 - a2 * o1, a2 * o0 - a0 * o2, a0 * o1 - a1 * o0
        gain[i, 3] += c0 + turned[0, i]
        gain[i, 4] += c1 + turned[1, i]
        gain[i, 5] += c2 + turned[2, i]
        lift[3, i] += c0 + turned[0, i]
        lift[4, i] += c1 + turned[1, i]
        lift[5, i] += c2 + turned[2, i]
        whole[i, i] += weights
    x, y, z = weights * a0, weights * a1, weights * a2
    whole[0, 4] += z
    whole[0, 5] -= y
    whole[1, 3] -= z
    whole[1, 5] += x
    whole[2, 3] += y
    whole[2, 4] -= x
    whole[4, 0] += z
    whole[5, 0] -= y
    whole[3, 1] -= z
    whole[5, 1] += x
    whole[3, 2] += y
    whole[4, 2] -= x
    square = x * a0 + y * a1 + z * a2
    whole[3, 3] += square - x * a0
    whole[4, 4] += square - y * a1
    whole[5, 5] += square - z * a2
    whole[3, 4] -= x * a1
    whole[4, 3] -= x * a1
    whole[3, 5] -= x * a2
    whole[5, 3] -= x * a2
    whole[4, 5] -= y * a2
    whole[5, 4] -= y * a2


@kernel
def _add_lever(w, kind, segment, state, load, block, gain, lift, whole):
    """Add how the work of constant forces on a lever changes to second order."""
    rotation, _, span, _, half = segment
    part, f, moving, turning = state
    arm, force, moment = load
    local, way = np.empty(3), np.zeros(3)
    rotate_back(rotation, force, local)
    _add_step_hessian(w, f, half, span, part, kind, local, block)
    rotate_back(rotation, moment, local)
    add_form(w, f, 1, local[0], local[1], local[2], part, -part, way, block)
    for i in range(3):
        # B^T [F] has rows B_i x F; -[F] B has columns B_i x F.
        cross(moving[:, i], force, way)
        for k in range(3):
            gain[i, 3 + k] += way[k]
            lift[3 + k, i] += way[k]
        cross(turning[:, i], moment, way)
        for k in range(3):
            gain[i, 3 + k] += way[k]
    dot = force[0] * arm[0] + force[1] * arm[1] + force[2] * arm[2]
    for i in range(3):
        whole[3 + i, 3 + i] -= dot
        for k in range(3):
            whole[3 + i, 3 + k] += arm[i] * force[k]


@kernel
def factor_chain(rod, q, scale, elastic, eliminates, stiffnesses, motion, beyond, chain):
    """Eliminate the segments of the tangent from the tip to the base; False if it is singular.

    Unless it ``eliminates``, ``chain`` is filled for `fill_tangent`.

    The tangent is ``s^2 m + s c`` of the points, and where ``elastic`` is 1, not 0, the segments'
    ``K + s tau K``, ``stiffnesses``, what constant forces ``beyond`` (n, 2, 3) add, and those of
    walls: the former two of the segments and of their ends (n, 3, 3), the last empty without walls.
    ``chain`` is filled: inverses (n, 3, 3), gains (n, 3, 6), lifts (n, 6, 3), moving, turning (n,
    3, 3) and arm (n, 3).
    """
    grid, _, damping, body = rod
    blocks, springs = stiffnesses
    spans, stiffness, _, _, _, kind = grid
    rotations, places, _, spins = motion[0]
    functions, halves, moving, turning = motion[1]
    own_functions, arms, own_moving, own_turning = motion[2][:4]
    tensors, pushes, twists, _, turned_loads = motion[2][7:]
    segments, parts, masses, _, drags = body
    inverses, gains, lifts, kept_moving, kept_turning, kept_arms, at_base, order = chain
    whole, before = np.zeros((6, 6)), np.zeros((6, 6))
    side, block, gain, lift = np.empty((6, 3)), np.empty((3, 3)), np.empty((3, 6)), np.empty((6, 3))
    rotational = np.empty((3, 3))
    p = segments.size - 1
    for j in range(spans.size - 1, -1, -1):
        w, mover, turner, arm = q[j], moving[j], turning[j], kept_arms[j]
        for i in range(3):
            for k in range(3):
                whole[i, k] += elastic * springs[j, i, k] if len(springs) > 0 else 0.0
        while p >= 0 and segments[p] == j and parts[p] == 1.0:
            for i in range(3):
                whole[i, i] += scale * (scale * masses[p] + elastic * drags[p])
                for k in range(3):
                    whole[3 + i, 3 + k] += scale * scale * tensors[p, i, k]
            for part in range(2 if elastic > 0.0 else 0):  # loads that turn by the rotation here
                x, y, z = (
                    turned_loads[part, p, 0],
                    turned_loads[part, p, 1],
                    turned_loads[part, p, 2],
                )
                first = 3 * part
                whole[first, 4] -= z
                whole[first, 5] += y
                whole[first + 1, 3] += z
                whole[first + 1, 5] -= x
                whole[first + 2, 3] -= y
                whole[first + 2, 4] += x
            p -= 1
        for i in range(3):
            arm[i] = places[j + 1, i] - places[j, i]
        copy_matrix(mover, kept_moving[j])
        copy_matrix(turner, kept_turning[j])
        # What lies beyond, by the state where this segment begins.
        for i in range(6):
            for k in range(3):
                side[i, k] = 0.0
                gain[k, i] = 0.0
                for m in range(3):
                    side[i, k] += whole[i, m] * mover[m, k] + whole[i, 3 + m] * turner[m, k]
                    gain[k, i] += mover[m, k] * whole[m, i] + turner[m, k] * whole[3 + m, i]
            x, y, z = whole[i, 0], whole[i, 1], whole[i, 2]
            for m in range(6):
                before[i, m] = whole[i, m]
            before[i, 3] += arm[1] * z - arm[2] * y
            before[i, 4] += arm[2] * x - arm[0] * z
            before[i, 5] += arm[0] * y - arm[1] * x
        for i in range(3):
            for k in range(3):
                block[i, k] = blocks[j, i, k] if elastic > 0.0 else 0.0
                lift[i, k] = side[i, k]
                for m in range(3):
                    block[i, k] += mover[m, i] * side[m, k] + turner[m, i] * side[3 + m, k]
            block[i, i] += elastic * (stiffness[j, i] + scale * damping[j, i])
        for k in range(3):
            x, y, z = side[0, k], side[1, k], side[2, k]
            lift[3, k] = side[3, k] + arm[1] * z - arm[2] * y
            lift[4, k] = side[4, k] + arm[2] * x - arm[0] * z
            lift[5, k] = side[5, k] + arm[0] * y - arm[1] * x
            x, y, z = gain[k, 0], gain[k, 1], gain[k, 2]
            gain[k, 3] += arm[1] * z - arm[2] * y
            gain[k, 4] += arm[2] * x - arm[0] * z
            gain[k, 5] += arm[0] * y - arm[1] * x
        for k in range(6):
            x, y, z = before[0, k], before[1, k], before[2, k]
            for i in range(6):
                whole[i, k] = before[i, k]
            whole[3, k] += arm[1] * z - arm[2] * y
            whole[4, k] += arm[2] * x - arm[0] * z
            whole[5, k] += arm[0] * y - arm[1] * x
        segment = rotations[j], spins[j], spans[j], w, halves[j]
        if elastic > 0.0:
            state = 1.0, functions[j], mover, turner
            load = arm, beyond[j, 0], beyond[j, 1]
            _add_lever(w, kind, segment, state, load, block, gain, lift, whole)
        while p >= 0 and segments[p] == j:
            for i in range(3):
                for k in range(3):
                    rotational[i, k] = scale * scale * tensors[p, i, k]
            weight = scale * scale * masses[p] + elastic * scale * drags[p]
            _add_branch(
                weight, arms[p], own_moving[p], own_turning[p], rotational, block, gain, lift, whole
            )
            if elastic > 0.0:
                state = parts[p], own_functions[p], own_moving[p], own_turning[p]
                load = arms[p], pushes[p], twists[p]
                _add_lever(w, kind, segment, state, load, block, gain, lift, whole)
            p -= 1
        if not eliminates:
            copy_matrix(block, inverses[j])
            copy_matrix(gain, gains[j])
            copy_matrix(lift, lifts[j])
            continue
        if not _invert(block, inverses[j]):
            return False
        for i in range(3):
            for k in range(6):
                gains[j, i, k] = 0.0
                for m in range(3):
                    gains[j, i, k] += inverses[j, i, m] * gain[m, k]
        for i in range(6):
            for k in range(3):
                lifts[j, i, k] = lift[i, k]
            for k in range(6):
                for m in range(3):
                    whole[i, k] -= lift[i, m] * gains[j, m, k]
    copy_matrix(whole, at_base)
    factor_lu(at_base, order)
    return True


@kernel
def fill_tangent(chain, matrix):
    """Fill the whole tangent (3 n, 3 n) from the answer of `factor_chain` without elimination."""
    blocks, gains, lifts, moving, turning, arms = chain[:6]
    gain, lift = np.empty((3, 6)), np.empty((6, 3))
    for j in range(len(blocks)):
        copy_matrix(gains[j], gain)
        copy_matrix(lifts[j], lift)
        for a in range(3):
            for b in range(3):
                matrix[3 * j + a, 3 * j + b] = blocks[j, a, b]
        for i in range(j - 1, -1, -1):
            for a in range(3):
                for b in range(3):
                    by_base, by_segment = 0.0, 0.0
                    for m in range(3):
                        by_base += gain[a, m] * moving[i, m, b] + gain[a, 3 + m] * turning[i, m, b]
                        by_segment += (
                            moving[i, m, a] * lift[m, b] + turning[i, m, a] * lift[3 + m, b]
                        )
                    matrix[3 * j + a, 3 * i + b] = by_base
                    matrix[3 * i + a, 3 * j + b] = by_segment
            arm = arms[i]
            for a in range(3):
                x, y, z = gain[a, 0], gain[a, 1], gain[a, 2]
                gain[a, 3] += arm[1] * z - arm[2] * y
                gain[a, 4] += arm[2] * x - arm[0] * z
                gain[a, 5] += arm[0] * y - arm[1] * x
                x, y, z = lift[0, a], lift[1, a], lift[2, a]
                lift[3, a] += arm[1] * z - arm[2] * y
                lift[4, a] += arm[2] * x - arm[0] * z
                lift[5, a] += arm[0] * y - arm[1] * x


@kernel
def solve_chain(chain, right, out, ground):
    """Solve for ``right`` (n, 3) by the answer of `factor_chain`; ``out`` may be the same array.

    ``ground`` (2, 3) is the same of a free base, force and moment, then its motion and turn; (0, 3)
    where the base does not move.
    """
    inverses, gains, lifts, moving, turning, arms, at_base, order = chain
    push, twist, rest = np.zeros(3), np.zeros(3), np.empty(3)
    for j in range(len(inverses) - 1, -1, -1):
        for i in range(3):
            rest[i] = right[j, i]
        _add_transposed(moving[j], push, rest)
        _add_transposed(turning[j], twist, rest)
        for i in range(3):
            out[j, i] = (
                inverses[j, i, 0] * rest[0]
                + inverses[j, i, 1] * rest[1]
                + inverses[j, i, 2] * rest[2]
            )
        _shift(arms[j], push, twist)
        for i in range(3):
            for k in range(3):
                push[i] -= lifts[j, i, k] * out[j, k]
                twist[i] -= lifts[j, 3 + i, k] * out[j, k]
    moved, turned, way = np.zeros(3), np.zeros(3), np.empty(3)
    if len(ground) > 0:
        column = np.empty((6, 1))
        for i in range(3):
            column[i, 0], column[3 + i, 0] = ground[0, i] + push[i], ground[1, i] + twist[i]
        solve_lu(at_base, order, column)
        for i in range(3):
            moved[i] = ground[0, i] = column[i, 0]
            turned[i] = ground[1, i] = column[3 + i, 0]
    for j in range(len(inverses)):
        for i in range(3):
            for k in range(3):
                out[j, i] -= gains[j, i, k] * moved[k] + gains[j, i, 3 + k] * turned[k]
        cross(turned, arms[j], way)
        for i in range(3):
            moved[i] += way[i]
            for k in range(3):
                moved[i] += moving[j, i, k] * out[j, k]
                turned[i] += turning[j, i, k] * out[j, k]


@kernel
def find_velocity(rod, q, momentum, drive, ground, work, rate):
    """Fill the rates (n, 3) that have a momentum (n, 3), and the motion; False if there are none.

    ``chain`` of the work then is that of the inertia alone. The velocity of a free base is that
    of its ``ground``.
    """
    motion, beyond, chain, found, force = work
    grid, _, _, body = rod
    base = drive[0]
    rate[:] = 0.0
    if len(ground) > 0:
        base[2][:] = 0.0
        base[3][:] = 0.0
    if base[2].any() or base[3].any():
        measure_motion(rod, q, rate, drive, motion, beyond, found, force)
    else:
        fill_places(grid, q, base, body, motion)
        found[:] = 0.0
    stiffnesses = motion[1][2], drive[4][6][2]
    good = factor_chain(rod, q, 1.0, 0.0, True, stiffnesses, motion, beyond, chain)
    for j in range(len(q)):
        for i in range(3):
            force[j, i] = momentum[j, i] - found[j, i]
    about = np.empty((min(len(ground), 2), 3))
    if len(ground) > 0:
        cross(ground[3], ground[6], about[1])
        for i in range(3):
            about[0, i], about[1, i] = ground[6, i], ground[7, i] - about[1, i]
    solve_chain(chain, force, rate, about)
    if len(ground) > 0:
        copy_vector(about[0], base[2])
        copy_vector(about[1], base[3])
    fill_velocities(rate, base, body, motion)
    return good


@kernel
def measure_energies(rod, q, drive, motion):
    """Kinetic, elastic and gravitational energy of a motion that is known [N mm].

    And ``P . v + H . omega`` of the whole momentum about the base with the base's velocity, spin.
    """
    grid, rest, _, body = rod
    base, weights = drive[0], drive[3]
    segments, parts, masses, _, _ = body
    _, arms, _, _, velocities, spins, angular = motion[2][:7]
    places = motion[0][1]
    kinetic, elastic, gravity, carried = 0.0, 0.0, 0.0, 0.0
    arm, way = np.empty(3), np.empty(3)
    for p in range(segments.size):
        j = segments[p]
        for i in range(3):
            kinetic += 0.5 * (masses[p] * velocities[p, i] ** 2 + angular[p, i] * spins[p, i])
            there = places[j + 1, i] if parts[p] == 1.0 else places[j, i] + arms[p, i]
            gravity -= weights[p, i] * there
            arm[i] = there - places[0, i]
        cross(base[3], arm, way)
        for i in range(3):
            carried += masses[p] * velocities[p, i] * (base[2][i] + way[i])
            carried += angular[p, i] * base[3][i]
    for j in range(len(q)):
        for i in range(3):
            elastic += 0.5 * grid[1][j, i] * (q[j, i] - rest[j, i]) ** 2
    return kinetic, elastic, gravity, carried


@kernel
def fill_drive(tables, row, time, drive, targets, slopes):
    """Fill base, forces and tendon commands at a time after a row [s].

    ``tables`` are times (k,), coefficients of the base's motion (k - 1, 4, 6), of powers from 3 to
    0 of the time after the row, weights (p, 3), forces and moments of the loads (l, p, 3), those in
    the body's axes (l, 2, p, 3), or (l, 2, 0, 3), their factors (k, l), and commands (k, t), linear
    between rows.
    """
    times, coefficients, weights, load_forces, load_moments, body_loads, factors, commands = tables
    base, forces, moments, _, _, turning_loads = drive
    share = time / (times[row + 1] - times[row])
    f, turn, swing, change = np.empty(8), np.empty(3), np.empty(3), np.zeros((3, 3))
    c = coefficients[row]
    for i in range(3):
        base[1][i] = ((c[0, i] * time + c[1, i]) * time + c[2, i]) * time + c[3, i]
        base[2][i] = (3.0 * c[0, i] * time + 2.0 * c[1, i]) * time + c[2, i]
        turn[i] = ((c[0, 3 + i] * time + c[1, 3 + i]) * time + c[2, 3 + i]) * time + c[3, 3 + i]
        swing[i] = (3.0 * c[0, 3 + i] * time + 2.0 * c[1, 3 + i]) * time + c[2, 3 + i]
    fill_functions(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2, f)
    base[3][:] = 0.0
    add_form(turn, f, 1, swing[0], swing[1], swing[2], 1.0, 1.0, base[3], change)
    fill_rotation(turn, f[1:], base[0])
    for i in range(3):
        base[4][i] = 6.0 * c[0, i] * time + 2.0 * c[1, i]
        base[5][i] = 0.0
        for k in range(3):
            base[5][i] += base[0][i, k] * (6.0 * c[0, 3 + k] * time + 2.0 * c[1, 3 + k])
            base[5][i] += change[i, k] * swing[k]
    fill_rotation(turn, f, base[0])
    for p in range(len(weights)):
        for i in range(3):
            forces[p, i] = weights[p, i]
            moments[p, i] = 0.0
            for m in range(len(load_forces)):
                now = factors[row, m] + share * (factors[row + 1, m] - factors[row, m])
                forces[p, i] += now * load_forces[m, p, i]
                moments[p, i] += now * load_moments[m, p, i]
    turning_loads[:] = 0.0
    for m in range(len(body_loads)):
        now = factors[row, m] + share * (factors[row + 1, m] - factors[row, m])
        for part in range(2):
            for p in range(body_loads.shape[2]):
                for i in range(3):
                    turning_loads[part, p, i] += now * body_loads[m, part, p, i]
    for m in range(targets.size):
        slopes[m] = (commands[row + 1, m] - commands[row, m]) / (times[row + 1] - times[row])
        targets[m] = commands[row, m] + time * slopes[m]


@kernel
def make_pull(n, k):
    """Empty arrays of `pull_tendons`."""
    return (
        np.zeros(k),
        np.zeros(k),
        np.zeros((k, n, 3)),
        np.zeros((n, 3, 3)),
        np.zeros((n, 3, 3)),
    )


@kernel
def pull_tendons(grid, tendons, targets, q, bending, pull, strings, force):
    """Fill tensions (k,), lengths (k,) and their gradients (k, n, 3); add to ``force`` (n, 3).

    ``tendons`` are their compliances (k,), whether lengths, not tensions, are commanded, which only
    pull (k,), and ``rubbing`` and ``strings`` what `settle_tensions` takes, empty without friction.
    ``bending`` asks for the second derivatives (n, 3, 3) too. Returns whether tensions were found.
    """
    compliances, held, one_sided, rubbing = tendons
    tensions, lengths, gradients, psd, blocks = pull
    if rubbing[0].size > 0:
        now = strings[0]
        measure_strings(grid, rubbing[1], q, bending, pull, now)
        for m in range(targets.size):
            told, lengths[m] = (targets[m], held, one_sided[m]), 0.0
            if not settle_tensions(m, grid[4][m], rubbing, told, tensions, strings):
                return False
            for j in range(grid[4][m]):
                lengths[m] += now[0][m, j]
                for i in range(3):
                    force[j, i] += now[2][m, j] * gradients[m, j, i]
        return True
    for m in range(targets.size):
        tensions[m] = targets[m] if bending and not held else 0.0
    measure_lengths(grid, q, tensions, lengths, gradients, psd, blocks)
    for m in range(targets.size):
        tensions[m] = targets[m]
        if held:
            tensions[m] = (lengths[m] - targets[m]) / compliances[m]
            if one_sided[m]:
                tensions[m] = max(tensions[m], 0.0)
    if held and bending:
        measure_lengths(grid, q, tensions, lengths, gradients, psd, blocks)
    for m in range(targets.size):
        if tensions[m] != 0.0:
            for j in range(len(q)):
                for i in range(3):
                    force[j, i] += tensions[m] * gradients[m, j, i]
    return True


@kernel
def _stiffen(tendons, chain, pull, active, carried, matrix, order):
    """Prepare the held tendons that are taut: how they move the rod, and their joint stiffness.

    Returns how many there are, -1 if the matrix is singular.
    """
    compliances, held, one_sided, _ = tendons
    tensions, _, gradients, _, _ = pull
    count = 0
    for m in range(tensions.size if held else 0):
        if tensions[m] > 0.0 or not one_sided[m]:
            active[count] = m
            solve_chain(chain, gradients[m], carried[count], gradients[m, :0])
            count += 1
    for a in range(count):
        for b in range(count):
            matrix[a, b] = compliances[active[a]] if a == b else 0.0
            one, other = gradients[active[a]], carried[b]
            for j in range(len(one)):
                for i in range(3):
                    matrix[a, b] += one[j, i] * other[j, i]
    if count > 0 and not factor_lu(matrix[:count, :count], order[:count]):
        return -1
    return count


@kernel
def solve_stage(rod, tendons, drive, targets, stage, work, solver, q, rate):
    """One implicit stage by Newton's method: rotations (n, 3) from a guess, and their rates.

    ``stage`` is the scale s, the rotations and momenta that it starts from, and the state of a
    free base as of `advance`, six more rows of which are filled: what place, turn and momenta
    start from, place and turn; ``work`` as of `make_work`. Returns the steps taken, 0 if there is
    no answer, and what `measure_motion` does.
    """
    scale, q_before, momentum_before, ground = stage
    about, loose = np.empty((min(len(ground), 2), 3)), len(ground) > 0
    tolerance = FREE_TOLERANCE if loose else TURN_TOLERANCE
    motion, beyond, chain, momentum, force = work
    pull, active, carried, matrix, order, fresh_right, state, strings = solver
    grid, rubbing = rod[0], tendons[3]
    n, rubs, dense = len(q), rubbing[0].size > 0, strings[4]
    step, last, known, contraction = fresh_right, math.inf, state[0] > 0.0, state[2]
    if rubs:
        return_strings(pull[0], strings)
        contraction = 1.0  # contacts that begin to slide change the tangent from step to step
    count, powers = int(state[1]), (0.0, 0.0)
    for iteration in range(MOST_ITERATIONS):
        for j in range(n):
            for i in range(3):
                rate[j, i] = scale * (q[j, i] - q_before[j, i])
        if loose:
            _move_base(scale, ground, drive[0])
        powers = measure_motion(rod, q, rate, drive, motion, beyond, momentum, force)
        if loose:
            powers = (powers[0] - _weigh_base(scale, ground, drive[0], beyond, about), powers[1])
        bending = not known
        if not pull_tendons(grid, tendons, targets, q, bending, pull, strings, force):
            break
        if last * max(contraction, LEAST_CONTRACTION) <= tolerance:
            state[0], state[1], state[2] = 1.0, count, contraction
            return iteration, powers
        if not known:
            stiffnesses = pull[4], drive[4][6][2]
            if not factor_chain(rod, q, scale, 1.0, not rubs, stiffnesses, motion, beyond, chain):
                break
            if rubs:
                fill_tangent(chain, dense[0])
                for m in range(targets.size):
                    add_tendon(
                        m, grid[4][m], rubbing, tendons[1], pull[0][m], pull[2][m], iteration == 0,
                        strings,
                    )  # fmt: skip
                count = 0 if factor_lu(dense[0], dense[1]) else -1
            else:
                count = _stiffen(tendons, chain, pull, active, carried, matrix, order)
            if count < 0:
                break
            known = True
        for j in range(n):
            for i in range(3):
                step[j, i] = -(scale * (momentum[j, i] - momentum_before[j, i]) + force[j, i])
        if rubs:
            keep_shares(strings[0], strings[2])
            copy_vector(step.reshape(3 * n), dense[2][:, 0])
            solve_lu(dense[0], dense[1], dense[2])
            copy_vector(dense[2][:, 0], step.reshape(3 * n))
        else:
            solve_chain(chain, step, step, about)
        if count > 0:
            right = np.zeros((count, 1))
            for a in range(count):
                own = pull[2][active[a]]
                for j in range(n):
                    for i in range(3):
                        right[a, 0] += own[j, i] * step[j, i]
            solve_lu(matrix[:count, :count], order[:count], right)
            for a in range(count):
                for j in range(n):
                    for i in range(3):
                        step[j, i] -= right[a, 0] * carried[a, j, i]
        largest = 0.0
        for j in range(n):
            largest = max(largest, step[j, 0] ** 2 + step[j, 1] ** 2 + step[j, 2] ** 2)
        for i in range(3 if loose else 0):
            largest = max(largest, about[1, i] ** 2)
        largest = math.sqrt(largest)
        if not math.isfinite(largest):
            break
        part = min(1.0, STEP_LIMIT / largest) if largest > 0.0 else 1.0
        folded = False
        for i in range(3 if loose else 0):
            ground[14, i] += part * about[0, i]
            ground[15, i] += part * about[1, i]
        for j in range(n):
            square = 0.0
            for i in range(3):
                q[j, i] += part * step[j, i]
                square += q[j, i] ** 2
            folded = folded or square > FOLD_ANGLE**2
        if folded:
            break
        if iteration > 0:
            contraction = min(largest / last, 1.0)
        known = contraction <= SLOW or iteration == 0
        last = largest
    state[0], state[2] = 0.0, 1.0
    return 0, powers


@kernel
def _turn_base(vector, rate, before, turn, spin):
    """Fill the rotation (3, 3) by a vector from one before, and the spin that its rate makes."""
    f, change, own = np.empty(8), np.zeros((3, 3)), np.empty((3, 3))
    fill_functions(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2, f)
    spin[:] = 0.0
    add_form(vector, f, 1, rate[0], rate[1], rate[2], 1.0, 1.0, spin, change)
    fill_rotation(vector, f, own)
    multiply(own, before, turn)


@kernel
def _move_base(scale, ground, base):
    """Fill the motion of a free base in a stage."""
    rate = np.empty(3)
    for i in range(3):
        base[1][i] = ground[14, i]
        base[2][i] = scale * (ground[14, i] - ground[10, i])
        rate[i] = scale * (ground[15, i] - ground[11, i])
    _turn_base(ground[15], rate, ground[:3], base[0], base[3])


@kernel
def _weigh_base(scale, ground, base, beyond, about):
    """Fill what is missing of the base's balances, force and moment about it (2, 3).

    Returns the power that `measure_motion` takes for that of what moves the base.
    """
    n = len(beyond) - 2
    linear, angular, force, moment = beyond[n, 0], beyond[n, 1], beyond[n + 1, 0], beyond[n + 1, 1]
    way, whole, power = np.empty(3), np.empty(3), 0.0
    cross(base[2], linear, way)
    for i in range(3):
        power += force[i] * base[2][i] + (moment[i] + way[i]) * base[3][i]
        about[0, i] = -scale * (linear[i] - ground[12, i]) - force[i]
    cross(base[1], linear, whole)
    cross(base[1], force, way)
    for i in range(3):
        about[1, i] = -scale * (angular[i] + whole[i] - ground[13, i]) - moment[i] - way[i]
    cross(base[1], about[0], way)
    for i in range(3):
        about[1, i] -= way[i]
    return power


@kernel
def _place_base(ground, base):
    """Fill place and turn of a free base, at rest."""
    copy_matrix(ground[:3], base[0])
    copy_vector(ground[3], base[1])
    base[2][:] = 0.0
    base[3][:] = 0.0


@kernel
def _step_base(size, scheme, scale, ground, base, beyond):
    """Move a free base on over a step, by its stage."""
    alpha_m, gamma = scheme
    n = len(beyond) - 2
    moment, rates, ends = np.empty(3), np.empty((4, 3)), np.empty((4, 3))
    cross(base[1], beyond[n + 1, 0], moment)
    for i in range(3):
        rates[0, i] = base[2][i]
        rates[1, i] = scale * (ground[15, i] - ground[11, i])
        rates[2, i] = -beyond[n + 1, 0, i]
        rates[3, i] = -beyond[n + 1, 1, i] - moment[i]
    for part in range(4):
        kept = part + 4 if part < 2 else part + 6
        for i in range(3):
            new = (rates[part, i] - (1.0 - alpha_m) * ground[kept, i]) / alpha_m
            ends[part, i] = size * ((1.0 - gamma) * ground[kept, i] + gamma * new)
            ground[kept, i] = new
    for i in range(3):
        ground[3, i] += ends[0, i]
        ground[6, i] += ends[2, i]
        ground[7, i] += ends[3, i]
    before, spin = ground[:3].copy(), ground[5].copy()
    _turn_base(ends[1], spin, before, ground[:3], ground[5])


@kernel
def make_work(n, p):
    """Empty arrays of a motion, of forces beyond, of a chain, and two of the segments."""
    return (
        make_motion(n, p),
        np.empty((n + 2, 2, 3)),
        make_chain(n),
        np.empty((n, 3)),
        np.empty((n, 3)),
    )


@kernel
def make_memory(n, p, k, rubs):
    """Empty arrays of `advance`: what one call leaves to the next.

    The works of a stage and of a row's end, the solver, nine arrays (n, 3): rotations and rates of
    the stage, what it starts from, the last rates and those before, those of a row's end, and the
    last two for the error; and totals (18,): energies put in and lost, the last powers and their
    time, the last scale, one of the first row, what friction of tendons took, the step that its
    error asks for, and the time of the last rate but one. Then of energy: the least that came from
    nowhere, the most there or done, what was there at first, of it gravity's, how steps are made
    and for how many yet, and what came from nowhere.
    """
    solver_state = np.ones(3)
    solver_state[0] = 0.0
    solver = (
        make_pull(n, k),
        np.zeros(k, dtype=np.int64),
        np.empty((k, n, 3)),
        np.empty((k, k)),
        np.empty(k, dtype=np.int64),
        np.empty((n, 3)),
        solver_state,
        make_strings(n, k if rubs else 0),
    )
    return make_work(n, p), make_work(n, p), solver, np.zeros((9, n, 3)), np.zeros(18)


@kernel
def advance(rod, tendons, tables, walls, scheme, window, state, memory, rows):
    """Move on over a window of steps and rows of the tables; returns how many rows were reached.

    ``walls`` are those of `press_end`, at the first step of the window. ``scheme`` is a_m, a_f, g
    and the error of the segments' ends in a step [mm], 0 for whole steps. ``window`` is the row
    and step to begin with, the row and step to end before, and how many steps there are between
    two rows (k - 1,). ``state`` is the rotations, momenta, and the rates of both (n, 3), and of a
    base that is free: turn (3, 3), place, velocity, spin, momenta and their rates, six rows for
    `solve_stage`, (0, 3) if it is not; they are changed; if ``fresh``, the last of the window, is
    2 momenta and their rates are not known yet, if it is 1 they are, and if it is 0 the window
    goes on from the ``memory`` of the last one; it may begin and end with a part of a step.
    ``rows`` are filled: rotations (k, s, 3, 3),
    places, velocities (k, s, 3) of the stations, tensions and lengths (k, t), energies (k, 8):
    kinetic, elastic, of gravity, of tendons, work of loads and tendons, dissipated, of walls,
    dissipated by friction of tendons; steps of Newton's method (k,); forces of walls (k, s, 3) and
    least gaps (k, s). Lengths are those without tension where tensions are commanded.
    """
    first_row, first_step, end_row, end_step, steps, fresh = window
    q, momentum, rate, momentum_rate, ground = state
    loose, about = len(ground) > 0, np.empty((2, 3))
    n, p, k = len(q), len(rod[3][0]), len(tendons[0])
    times, weights = tables[0], tables[2]
    still = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    turning_loads = np.empty((2, tables[5].shape[2], 3))
    drive = (
        (np.empty((3, 3)), *still),
        np.empty((p, 3)),
        np.empty((p, 3)),
        weights,
        walls,
        turning_loads,
    )
    targets, slopes = np.empty(k), np.empty(k)
    work, end_work, solver, arrays, totals = memory
    pull, solver_state, strings, rubbing = solver[0], solver[6], solver[7], tendons[3]
    stage_q, stage_rate, q_before, momentum_before = arrays[0], arrays[1], arrays[2], arrays[3]
    guess, guess_before, end_rate = arrays[4], arrays[5], arrays[6]
    tolerance = scheme[3]
    kept = (
        (q.copy(), momentum.copy(), rate.copy(), momentum_rate.copy(), ground.copy()),
        arrays.copy(),
        totals.copy(),
        (walls[5][0].copy(), walls[5][1].copy(), walls[5][2].copy()),
        (strings[1][0].copy(), strings[1][1].copy(), strings[1][2].copy()),
    )
    if fresh > 0:
        fill_drive(tables, 0, 0.0, drive, targets, slopes)
        if loose:
            _place_base(ground, drive[0])
        if rubbing[0].size > 0:
            if fresh == 2:
                measure_strings(rod[0], rubbing[1], q, False, pull, strings[0])
                spread_evenly(rod[0], tendons, targets, pull, strings)
            return_strings(pull[0], strings)
        if fresh == 2:
            measure_motion(rod, q, rate, drive, work[0], work[1], momentum, momentum_rate)
            pull_tendons(rod[0], tendons, targets, q, False, pull, strings, momentum_rate)
            for j in range(n):
                for i in range(3):
                    momentum_rate[j, i] = -momentum_rate[j, i]
            for i in range(3 if loose else 0):
                ground[8, i], ground[9, i] = -work[1][n + 1, 0, i], -work[1][n + 1, 1, i]
        if not _fill_row(rod, tendons, drive, targets, state, end_work, end_rate, solver, rows, 0):
            return 0
        if loose and fresh == 1:
            copy_matrix(rate, end_rate)  # by momenta those of roll are noise
        copy_matrix(end_rate, guess)
        copy_matrix(end_rate, guess_before)
        totals[7], rows[6][0] = rows[5][0, 4], 0
        powers = measure_motion(rod, q, end_rate, drive, work[0], work[1], work[3], work[4])
        if loose:
            powers = (powers[0] - _weigh_base(1.0, ground, drive[0], work[1], about), powers[1])
        totals[2], totals[3] = _measure_powers(powers, tendons, solver, end_rate, slopes, 0.0)
        totals[4] = totals[10] = times[0]
        totals[9], totals[12], totals[14] = 0.0, _bend_slightly(rod), rows[5][0, 2]
        _count_energy(rows[5][0], totals)
        totals[13], totals[17] = totals[17], 0.0
        copy_matrix(end_rate, arrays[7])
        copy_matrix(end_rate, arrays[8])
    for row in range(first_row, len(steps)):
        begin = first_step if row == first_row else 0.0
        end = end_step if row == end_row else float(steps[row])
        if row > end_row or begin >= end:
            break
        if begin == 0.0:
            rows[6][row + 1] = 0
        whole = (times[row + 1] - times[row]) / steps[row]
        done, part = begin, 1.0
        if tolerance > 0.0:
            part = min(1.0, totals[9] / whole if totals[9] > 0.0 else FIRST_PART)
        pressed = _measure_press(walls, True) > 0.0
        calm, calm_steps = int(totals[15]), int(totals[16])
        while done < end - 1e-9:
            if tolerance > 0.0 and part < end - done < 2.0 * part:
                part = 0.5 * (end - done)  # no last step that is much smaller
            part = min(part, end - done)
            size = part * whole
            alpha_m, alpha_f, gamma = scheme[:3]
            euler = pressed or calm == EULER
            if euler:
                alpha_m, alpha_f, gamma = 1.0, 1.0, 1.0
            elif calm == CALM:
                alpha_m, alpha_f, gamma = 1.5, 1.0, 1.0
            c = alpha_f * gamma / alpha_m * size
            scale = 1.0 / c
            if abs(scale - totals[5]) > 1e-9 * scale or len(walls[1]) > 0:
                solver_state[0] = 0.0
            totals[5] = scale
            at = done * whole + alpha_f * size
            for j in range(n):
                for i in range(3):
                    head = alpha_f * size * (1.0 - gamma / alpha_m)
                    q_before[j, i] = q[j, i] + head * rate[j, i]
                    momentum_before[j, i] = momentum[j, i] + head * momentum_rate[j, i]
                    ahead = 2.0 * guess[j, i] - guess_before[j, i]
                    stage_q[j, i] = q_before[j, i] + c * ahead
            fill_drive(tables, row, at, drive, targets, slopes)
            for i in range(3 if loose else 0):
                head = alpha_f * size * (1.0 - gamma / alpha_m)
                ground[10, i] = ground[3, i] + head * ground[4, i]
                ground[11, i] = head * ground[5, i]
                ground[12, i] = ground[6, i] + head * ground[8, i]
                ground[13, i] = ground[7, i] + head * ground[9, i]
                ground[14, i] = ground[10, i] + c * ground[4, i]
                ground[15, i] = ground[11, i] + c * ground[5, i]
            stage = scale, q_before, momentum_before, ground
            count, energies = solve_stage(
                rod, tendons, drive, targets, stage, work, solver, stage_q, stage_rate
            )
            if count > 0 and not pressed and _measure_press(walls, False) > 0.0:
                pressed = True  # it meets a wall: anew, so that no step after it knows of the blow
                copy_matrix(guess, guess_before)
                continue
            if count == 0:
                part *= 0.5
                copy_matrix(guess, guess_before)
                if part < LEAST_PART:
                    return row + 1
                continue
            rows[6][row + 1] += count
            _copy_course(state, arrays, totals, walls[5], strings[1], kept, True)
            time = times[row] + at
            between = time - totals[4]
            change = MOST_CHANGE
            if tolerance > 0.0:
                change = _change_step(
                    stage_rate, arrays, totals, (time, size, tolerance), euler, work[0]
                )
                if change < CAUTION and part > LEAST_PART:
                    part = max(part * change, LEAST_PART)
                    continue
                totals[10] = totals[4]
                copy_matrix(arrays[7], arrays[8])
                copy_matrix(stage_rate, arrays[7])
            copy_matrix(guess, guess_before)
            copy_matrix(stage_rate, guess)
            powers = _measure_powers(energies, tendons, solver, stage_rate, slopes, between)
            _keep_contacts(walls, work[0][0][1])
            if rubbing[0].size > 0:
                totals[8] += size / between * keep_strings(rubbing, pull[0], strings)
            shift = 0.0 if euler else (0.5 - alpha_f) * size / between
            totals[0] += size * (powers[0] + shift * (powers[0] - totals[2]))
            totals[1] += size * (powers[1] + shift * (powers[1] - totals[3]))
            totals[2], totals[3], totals[4] = powers[0], powers[1], time
            for j in range(n):
                for i in range(3):
                    new = (stage_rate[j, i] - (1.0 - alpha_m) * rate[j, i]) / alpha_m
                    q[j, i] += size * ((1.0 - gamma) * rate[j, i] + gamma * new)
                    rate[j, i] = new
                    new = (-work[4][j, i] - (1.0 - alpha_m) * momentum_rate[j, i]) / alpha_m
                    momentum[j, i] += size * ((1.0 - gamma) * momentum_rate[j, i] + gamma * new)
                    momentum_rate[j, i] = new
            if loose:
                _step_base(size, (alpha_m, gamma), scale, ground, drive[0], work[1])
            fill_drive(tables, row, (done + part) * whole, drive, targets, slopes)
            if loose:
                _place_base(ground, drive[0])
            filled = _fill_row(
                rod, tendons, drive, targets, state, end_work, end_rate, solver, rows, row + 1
            )
            kept_energy = filled and _count_energy(rows[5][row + 1], totals)
            watched = not filled or rubbing[0].size == 0
            if not kept_energy and watched and (not euler or part > LEAST_CALM):
                _copy_course(state, arrays, totals, walls[5], strings[1], kept, False)
                if rubbing[0].size > 0:
                    return_strings(pull[0], strings)
                if euler and len(walls[1]) > 0:
                    return GAINED  # planes of other places are needed
                if euler:
                    part *= 0.5
                calm, calm_steps = EULER if euler else calm + 1, CALM_STEPS
                solver_state[0] = 0.0
                copy_matrix(guess, guess_before)
                continue
            if not filled:
                return row + 1
            # What could not be helped is not held against what comes after.
            totals[11] = min(max(totals[11], totals[17] - GAIN * totals[12]), totals[17])
            calm_steps -= 1
            calm = calm if calm_steps > 0 else 0
            totals[15], totals[16] = calm, calm_steps
            done += part
            # A step of the same size goes on with the tangent it has.
            part = min(1.0, part * (change if change > 1.2 else min(change, 1.0)))
            if tolerance > 0.0:
                wish = part * whole
                totals[9] = max(totals[9], wish) if done > end - 1e-9 else wish
        if end < steps[row]:
            break
    return len(times)


@kernel
def _change_step(rate, arrays, totals, sizes, pressed, motion):
    """By what a step may change for the ends of the segments to err by a tolerance [mm] in it.

    ``sizes`` are the stage's time, the step and the tolerance. The error is that of a third
    derivative, from the rates of three stages, or, if a wall is ``pressed``, of a second.
    """
    time, size, tolerance = sizes
    last, before = arrays[7], arrays[8]
    places = motion[0][1]
    moving, turning = motion[1][2:]
    moved, turned, way, arm = np.zeros(3), np.zeros(3), np.empty(3), np.empty(3)
    first, second, largest = time - totals[4], totals[4] - totals[10], 0.0
    for j in range(len(rate)):
        for i in range(3):
            arm[i] = places[j + 1, i] - places[j, i]
        cross(turned, arm, way)
        for i in range(3):
            moved[i] += way[i]
        for k in range(3):
            error = (rate[j, k] - last[j, k]) / first
            if pressed:
                error *= 0.5 * size * size
            elif second > 0.0:
                error -= (last[j, k] - before[j, k]) / second
                error *= size**3 / (6.0 * (first + second))
            else:
                error *= size**2 / 6.0
            for i in range(3):
                moved[i] += moving[j, i, k] * error
                turned[i] += turning[j, i, k] * error
        largest = max(largest, moved[0] ** 2 + moved[1] ** 2 + moved[2] ** 2)
    if largest == 0.0:
        return MOST_CHANGE
    change = CAUTION * (tolerance / math.sqrt(largest)) ** (0.5 if pressed else 1.0 / 3.0)
    return min(max(change, LEAST_CHANGE), MOST_CHANGE)


@kernel
def _copy_course(state, arrays, totals, contacts, strings, kept, keep):
    """Keep what a step changes, or go back to it."""
    for i in range(5):
        _copy(state[i], kept[0][i], keep)
    _copy(arrays, kept[1], keep)
    _copy(totals, kept[2], keep)
    _copy(contacts[0], kept[3][0], keep)
    _copy(contacts[1], kept[3][1], keep)
    _copy(contacts[2], kept[3][2], keep)
    for i in range(3):
        _copy(strings[i], kept[4][i], keep)


@kernel
def _copy(one, other, keep):
    for i in range(one.size):
        if keep:
            other.flat[i] = one.flat[i]
        else:
            one.flat[i] = other.flat[i]


@kernel
def _bend_slightly(rod):
    """Energy of a rod that is bent evenly by `SMALL_BEND` [N mm]."""
    stiffness, flexible = rod[0][1], 0.0
    for j in range(len(stiffness)):
        flexible += 1.0 / stiffness[j, 0]
    return 0.5 * SMALL_BEND**2 / flexible


@kernel
def _count_energy(energies, totals):
    """Complete the energies (8,) of a row; returns whether none came from nowhere, but `GAIN`."""
    energies[4] += totals[0] - totals[7]
    energies[5], energies[7] = totals[1] + totals[8], totals[8]
    there = energies[0] + energies[1] + abs(energies[3]) + energies[6]
    most = max(there + abs(energies[2] - totals[14]), abs(energies[4]), abs(energies[5]))
    totals[12] = max(totals[12], most)
    totals[17] = energies[:4].sum() + energies[6] - energies[4] + energies[5] - totals[13]
    return totals[17] - totals[11] <= GAIN * totals[12]


@kernel
def spread_evenly(grid, tendons, targets, pull, strings):
    """Let tendons with friction, of known lengths, hold what they are told without it."""
    compliances, held, one_sided, rubbing = tendons
    tensions = pull[0]
    for m in range(targets.size):
        tensions[m] = targets[m]
        if held:
            gap = strings[0][0][m, : grid[4][m]].sum() - targets[m]
            tensions[m] = max(gap, 0.0) if one_sided[m] else gap
            tensions[m] /= compliances[m]
    begin_strings(grid, rubbing, tensions, strings)


@kernel
def _measure_powers(energies, tendons, solver, rate, slopes, between):
    """Powers of loads and tendons, and of damping [N mm/s].

    Tendons with friction are followed over the time ``between`` two stages: they stretch.
    """
    held, rubbing = tendons[1], tendons[3]
    tensions, _, gradients, _, _ = solver[0]
    now, before = solver[7][:2]
    power = energies[0]
    for m in range(tensions.size if rubbing[0].size > 0 and between > 0.0 and not held else 0):
        for j in range(len(rate)):
            change = now[2][m, j] - before[0][m, j + 1]
            power += tensions[m] * rubbing[2][m, j] * change / between
    for m in range(tensions.size):
        if held:
            power -= tensions[m] * slopes[m]
        elif tensions[m] != 0.0:
            for j in range(len(rate)):
                for i in range(3):
                    power -= tensions[m] * gradients[m, j, i] * rate[j, i]
    return power, energies[1]


@kernel
def _fill_row(rod, tendons, drive, targets, state, work, rate, solver, rows, row):
    """Fill a row of `advance`, its work with what the base carries; False if that fails."""
    q, momentum, _, _, ground = state
    pull, strings, rubbing = solver[0], solver[7], tendons[3]
    rotations, places, velocities, tensions, lengths, energies, _, forces, gaps = rows
    if not find_velocity(rod, q, momentum, drive, ground, work, rate):
        return False
    found = measure_energies(rod, q, drive, work[0])
    if not pull_tendons(rod[0], tendons, targets, q, False, pull, strings, work[4]):
        return False
    stations = work[0][0]
    for j in range(len(q) + 1):
        copy_matrix(stations[0][j], rotations[row, j])
    copy_matrix(stations[1], places[row])
    copy_matrix(stations[2], velocities[row])
    copy_vector(pull[0], tensions[row])
    copy_vector(pull[1], lengths[row])
    for i in range(3):
        energies[row, i] = found[i]
    carried = found[3] if len(ground) == 0 else 0.0
    energies[row, 3], energies[row, 4], energies[row, 6] = 0.0, carried, 0.0
    walls, push = drive[4], np.empty(3)
    for j in range(len(q) if len(walls[1]) > 0 else 0):
        push[:] = 0.0
        gaps[row, j + 1] = math.inf
        press_end(walls, j, stations[1][j + 1], stations[2][j + 1], push)
        for i in range(3):
            forces[row, j + 1, i] = -push[i]
        for w in range(len(walls[1])):
            if walls[1][w, j] < math.inf:
                energies[row, 6] += 0.5 * walls[3][j] * walls[6][1][w, j] ** 2
                gap = walls[1][w, j]
                for i in range(3):
                    gap += walls[2][w, j, i] * (stations[1][j + 1, i] - walls[0][j, i])
                gaps[row, j + 1] = min(gaps[row, j + 1], gap)
    energies[row, 7] = 0.0
    for m in range(len(targets)):
        if rubbing[0].size > 0:
            for j in range(len(q)):
                stretch = rubbing[2][m, j] * strings[0][2][m, j]
                energies[row, 3] += 0.5 * stretch * strings[0][2][m, j]
                lengths[row, m] -= stretch
        elif tendons[1]:
            energies[row, 3] += 0.5 * tendons[0][m] * pull[0][m] ** 2
        else:
            lengths[row, m] -= tendons[0][m] * pull[0][m]
    return True
