"""Numba kernels of the rod: its strains under tendons, and one pass from the base.

Cut anywhere and look at the whole of what lies beyond, tendons and all: force ``N`` and moment
``M`` over the cut balance the loads beyond it, and the rod's own part of the moment is what the
tendons do not take. With the unit tangent ``t_k`` of tendon k at its place ``r_k``, all in the
frame of the cross-section, and the force ``f`` per length in base axes::

    K u + sum_k T_k r_k x t_k(u) = R^T M ,   t_k = unit(e_z + u x r_k + r_k')
    p' = R e_z ,   R' = R [u] ,   N' = -f ,   M' = -p' x N

The state that is integrated has, in this order, place ``p`` [mm], quaternion of ``R`` (real part
first), ``N`` [N] and ``M`` [N mm] in base axes, integral of ``u`` [rad], and the tendons' lengths
from the base on [mm]; point loads are taken off ``N`` and ``M`` where they act.

It is the integrated form of the equations of Rucker and Webster (2011). A rod that shears and
stretches has ``p' = R (e_z + e)`` with ``K e + sum_k T_k t_k = R^T N`` beside it, and ``e`` in the
tendons' tangents. Both laws are the gradient of ``1/2 e K e + 1/2 u K u + sum T_k |t_k| - n e - m
u``, which is strictly convex where no tendon pushes: there is one solution. Otherwise there may be
several, and a minimum of it is taken, for at others the rod would not be stable. A curvature that
the rod has by nature adds ``K`` times it to the moment.

Derivatives are carried along as solutions of the linearised equations. A small change of the rod
is a rotation ``f`` of its cross-sections, and changes of force and moment; with the flexibility
``C`` of a cross-section, strains change by ``C (dN + N x f, dM + M x f)``, all in base axes.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.linear_algebra import (
    factor_cholesky,
    invert_three,
    solve_lower,
    solve_three,
    solve_upper,
)
from ...numeric.kernels.rotations import fill_quaternion_rotation

# The strains of a cross-section under tensions, force and moment.

FOUND = 1e-15
"""Curvature [1/mm] that is round-off."""

MOST_STEPS = 840
"""Newton steps for a curvature; it takes a few. Between two multiples of `PATIENCE`."""

PATIENCE = 50
"""Steps after which one may go up."""

OWN, OTHER = 5.0 / 12.0, 1.0 / 12.0
"""Weights of a step's ends in the square of the rotations, by themselves and by each other."""

SMALLEST_PART = 1e-6
"""Smallest part of a Newton step."""

THIN = 1e-6
"""Part of the rod's stiffness that must be left of it where tendons push."""

SETTLED = 3e-7
"""Newton step, against the curvature, after which there is only round-off."""

ROUGH = 1e-7
"""Error of a curvature that is taken for round-off, where a stiff part pulls at a flexible one."""


@kernel(error_model="numpy")
def expand_potential(stiffness, guides, present, tensions, moment, u, pushing, right, matrix):
    """Expand ``1/2 u K u + sum T_k |t_k(u)| - m u`` about ``u``; its value and its round-off.

    ``right`` (3,) gets minus the gradient, the lower half of ``matrix`` (3, 3) the Hessian; of
    tendons that push the part ``pushing``, for without them it is always positive. With ``t`` not
    normalised, ``d|t|/du = r x t / |t| = m`` and ``d2|t|/du2 = ([r]^T [r] - m m^T) / |t|``.
    """
    value = 0.0
    size = 0.0
    for i in range(3):
        right[i] = moment[i] - stiffness[i] * u[i]
        value += (0.5 * stiffness[i] * u[i] - moment[i]) * u[i]
        size += (0.5 * stiffness[i] * abs(u[i]) + abs(moment[i])) * abs(u[i])
        for n in range(3):
            matrix[i, n] = 0.0
        matrix[i, i] = stiffness[i]
    for k in range(tensions.size):
        if not present[k] or tensions[k] == 0.0:
            continue
        x, y = guides[k, 0], guides[k, 1]
        v0 = guides[k, 2] - u[2] * y
        v1 = guides[k, 3] + u[2] * x
        v2 = 1.0 + u[0] * y - u[1] * x
        length_rate = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
        if length_rate == 0.0:
            # The tendon is a point here: any direction of it will do.
            continue
        m0, m1, m2 = v2 * y / length_rate, -v2 * x / length_rate, (v1 * x - v0 * y) / length_rate
        tension = tensions[k]
        value += tension * length_rate
        size += abs(tension) * length_rate
        right[0] -= tension * m0
        right[1] -= tension * m1
        right[2] -= tension * m2
        tension_per_length = (tension if tension > 0.0 else pushing * tension) / length_rate
        matrix[0, 0] += tension_per_length * (y * y - m0 * m0)
        matrix[1, 1] += tension_per_length * (x * x - m1 * m1)
        matrix[2, 2] += tension_per_length * (x * x + y * y - m2 * m2)
        matrix[1, 0] += tension_per_length * (-x * y - m0 * m1)
        matrix[2, 0] -= tension_per_length * m0 * m2
        matrix[2, 1] -= tension_per_length * m1 * m2
    return value, 1e-15 * size


@kernel(error_model="numpy")
def measure_tangent(guides, strain):
    """Tangent ``e_z + e + u x r + r'`` of a tendon in the cross-section's axes, and its length."""
    wide = strain.size - 3
    x, y = guides[0], guides[1]
    t0 = guides[2] - strain[wide + 2] * y
    t1 = guides[3] + strain[wide + 2] * x
    t2 = 1.0 + strain[wide] * y - strain[wide + 1] * x
    if wide:
        t0 += strain[0]
        t1 += strain[1]
        t2 += strain[2]
    return t0, t1, t2, math.sqrt(t0 * t0 + t1 * t1 + t2 * t2)


@kernel(error_model="numpy")
def expand_strain(stiffness, guides, present, tensions, load, strain, pushing, right, matrix):
    """As `expand_potential`, of shear and stretch too: strains and loads are (6,)."""
    value, size = 0.0, 0.0
    for i in range(6):
        right[i] = load[i] - stiffness[i] * strain[i]
        value += (0.5 * stiffness[i] * strain[i] - load[i]) * strain[i]
        size += (0.5 * stiffness[i] * abs(strain[i]) + abs(load[i])) * abs(strain[i])
        for n in range(6):
            matrix[i, n] = 0.0
        matrix[i, i] = stiffness[i]
    for k in range(tensions.size):
        if not present[k] or tensions[k] == 0.0:
            continue
        t0, t1, t2, length_rate = measure_tangent(guides[k], strain)
        if length_rate == 0.0:
            continue
        x, y, tension = guides[k, 0], guides[k, 1], tensions[k]
        t0, t1, t2 = t0 / length_rate, t1 / length_rate, t2 / length_rate
        wrench = (t0, t1, t2, t2 * y, -t2 * x, t1 * x - t0 * y)
        value += tension * length_rate
        size += abs(tension) * length_rate
        for i in range(6):
            right[i] -= tension * wrench[i]
        tension_per_length = (tension if tension > 0.0 else pushing * tension) / length_rate
        for i in range(6):
            for n in range(i + 1):
                matrix[i, n] -= tension_per_length * wrench[i] * wrench[n]
        for i in range(3):
            matrix[i, i] += tension_per_length
        # The moments' rows by the forces' columns: the cross product with the place.
        matrix[3, 2] += tension_per_length * y
        matrix[4, 2] -= tension_per_length * x
        matrix[5, 0] -= tension_per_length * y
        matrix[5, 1] += tension_per_length * x
        matrix[3, 3] += tension_per_length * y * y
        matrix[4, 3] -= tension_per_length * x * y
        matrix[4, 4] += tension_per_length * x * x
        matrix[5, 5] += tension_per_length * (x * x + y * y)
    return value, 1e-15 * size


@kernel(error_model="numpy")
def expand(stiffness, guides, present, tensions, load, strain, pushing, right, matrix):
    """Expand the potential by the curvature (3,), or by shear, stretch and curvature (6,)."""
    args = (stiffness, guides, present, tensions, load, strain, pushing, right, matrix)
    return expand_potential(*args) if strain.size == 3 else expand_strain(*args)


@kernel(error_model="numpy")
def _solve(matrix, right, least, step):
    size = right.size
    if size == 3:
        return solve_three(matrix, right, least, step)
    # ``least`` may be nothing: then what is positive will do.
    if not factor_cholesky(matrix, size, 0.0, THIN if least[0] > 0.0 else 0.0, matrix):
        return False
    for i in range(size):
        step[i] = right[i]
    solve_lower(matrix, step, size)
    solve_upper(matrix, step, size)
    return True


@kernel(error_model="numpy")
def find_curvature(stiffness, guides, present, tensions, load, strain, work):
    """Improve ``strain`` until it is a minimum, where the rod's load balances; False if not.

    It is the curvature (3,) under a moment, or shear, stretch and curvature (6,) under force and
    moment, all in this frame. ``guides`` (k, 4) are the tendons' places and slopes here. Every
    step of Newton's method is cut until it goes down; but some are not, for without rods that push
    steps may go to and fro across a valley. ``work`` is (11, 3) or (11, 6).
    """
    size = strain.size
    matrix, right, step, least = work[0:size], work[size], work[size + 1], work[10]
    before, last, damping, flat, exact = math.inf, math.inf, 1.0, False, True
    for count in range(MOST_STEPS):
        if count % PATIENCE == PATIENCE - 1:
            before = math.inf
        pushing = 1.0 if exact else 0.0
        value, round_off = expand(
            stiffness, guides, present, tensions, load, strain, pushing, right, matrix
        )
        if not math.isfinite(value):
            return False
        if exact:
            if value > before + round_off and damping > SMALLEST_PART:
                for i in range(size):
                    strain[i] -= 0.5 * damping * step[i]
                damping *= 0.5
                continue
            flat = not value < before - round_off
            before = value
        for i in range(size):
            least[i] = THIN * stiffness[i] if exact else 0.0
        if not _solve(matrix, right, least, step):
            # Once more without those that push.
            if not exact:
                return False
            exact = False
            continue
        change, largest = 0.0, 0.0
        for i in range(size):
            change, largest = max(change, abs(step[i])), max(largest, abs(strain[i]))
        # Where it does not go down any more, and steps do not get smaller, there is round-off.
        if flat and not change < 0.5 * last:
            return change <= ROUGH * largest + FOUND
        damping, last, largest = 1.0, change, 0.0
        for i in range(size):
            strain[i] += step[i]
            largest = max(largest, abs(strain[i]))
        # Digits double from one step to the next.
        if change <= (SETTLED if exact else 1e-14) * largest + FOUND:
            return True
        exact = True
    return False


# Numba kernel of the rod without loads: lengths of its tendons under tensions, in closed steps.
#
# Without loads nothing goes over a cross-section but what the tendons do there, so every curvature
# is a minimum by itself. ``sum over s of min_u (1/2 u K u + sum T_k |t_k(u)|) - T . limits`` is the
# dual function of "least elastic energy at these lengths": its gradient by the tensions are the
# lengths, and its Hessian is ``- J H^-1 J^T``.


@kernel(error_model="numpy")
def measure_unloaded(grid, tensions, lengths, flexibility):
    """Fill lengths (k,) and their flexibility under tension (k, k); the dual's value, or NaN.

    ``grid`` is that of `integrate_rod`, whose rule along a step this is, for curvatures that do
    not depend on what came before.
    """
    places, stiffness, rest, guides, present = grid
    tendons = tensions.size
    u, work, natural_moment = np.zeros(3), np.empty((11, 3)), np.zeros(3)
    length_gradients, curvature_by_tension = np.zeros((tendons, 3)), np.zeros((tendons, 3))
    lengths[:] = 0.0
    flexibility[:] = 0.0
    total = 0.0
    for n in range(places.size - 1):
        h = places[n + 1] - places[n]
        for stage in range(3):
            weight = (1.0, 4.0, 1.0)[stage] * h / 6.0
            here, own = guides[n, stage], stiffness[n, stage, 3:]
            for i in range(3):
                natural_moment[i] = own[i] * rest[n, stage, i]
            if not find_curvature(own, here, present[n], tensions, natural_moment, u, work):
                return math.nan
            matrix, least = work[0:3], work[10]
            least[:] = 0.0
            value, _ = expand_potential(
                own, here, present[n], tensions, natural_moment, u, 1.0, work[3], matrix
            )
            total += weight * value
            for k in range(tendons):
                if not present[n, k]:
                    continue
                x, y = here[k, 0], here[k, 1]
                v0 = here[k, 2] - u[2] * y
                v1 = here[k, 3] + u[2] * x
                v2 = 1.0 + u[0] * y - u[1] * x
                length_rate = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
                lengths[k] += weight * length_rate
                if length_rate == 0.0:
                    return math.nan
                length_gradients[k, 0], length_gradients[k, 1] = (
                    v2 * y / length_rate,
                    -v2 * x / length_rate,
                )
                length_gradients[k, 2] = (v1 * x - v0 * y) / length_rate
                if not solve_three(matrix, length_gradients[k], least, curvature_by_tension[k]):
                    return math.nan
                for j in range(k + 1):
                    if present[n, j]:
                        for i in range(3):
                            flexibility[k, j] += (
                                weight * length_gradients[j, i] * curvature_by_tension[k, i]
                            )
    for k in range(tendons):
        for j in range(k):
            flexibility[j, k] = flexibility[k, j]
    return total


# One pass along a rod, with derivatives if asked for.

POSITION, QUATERNION, FORCE, MOMENT, BEND, LENGTHS = 0, 3, 7, 10, 13, 16
"""Columns of a state: place, quaternion, force, moment, integral of curvature, tendon lengths."""

BY_LENGTHS = 9
"""Row of sensitivities of tendon lengths; before it rotation, moment and force, then the place."""


@kernel(error_model="numpy")
def fill_rates(state, section, line_load, local_tensions, strain, frame, rates, work):
    """Rates (16 + k,) of a state; fills the rotation ``frame`` (3, 3) and improves ``strain``.

    ``section`` is stiffness (6,), natural curvature (3,), guides (k, 4) and where tendons run
    (k,); ``line_load`` (2, 3) are forces per length in the base's and in the body's axes.
    """
    stiffness, rest, guides, present = section
    size = 0.0
    for i in range(QUATERNION, FORCE):
        size += state[i] * state[i]
    size = 1.0 / math.sqrt(size)
    w, x, y, z = size * state[3], size * state[4], size * state[5], size * state[6]
    fill_quaternion_rotation(w, x, y, z, frame)
    wide = strain.size - 3
    load = work[11]
    for i in range(3):
        load[wide + i] = stiffness[3 + i] * rest[i]
        for j in range(3):
            load[wide + i] += frame[j, i] * state[MOMENT + j]
    v0, v1, v2 = 0.0, 0.0, 1.0
    if wide:
        for i in range(3):
            load[i] = 0.0
            for j in range(3):
                load[i] += frame[j, i] * state[FORCE + j]
    if not find_curvature(
        stiffness[3 - wide :], guides, present, local_tensions, load, strain, work
    ):
        return False
    if wide:
        v0, v1, v2 = strain[0], strain[1], 1.0 + strain[2]
    u0, u1, u2 = strain[wide], strain[wide + 1], strain[wide + 2]
    for i in range(3):
        rates[i] = frame[i, 0] * v0 + frame[i, 1] * v1 + frame[i, 2] * v2
        rates[FORCE + i] = -line_load[0, i]
        for j in range(3):
            rates[FORCE + i] -= frame[i, j] * line_load[1, j]
        rates[BEND + i] = strain[wide + i]
    rates[3] = 0.5 * (-x * u0 - y * u1 - z * u2)
    rates[4] = 0.5 * (w * u0 + y * u2 - z * u1)
    rates[5] = 0.5 * (w * u1 + z * u0 - x * u2)
    rates[6] = 0.5 * (w * u2 + x * u1 - y * u0)
    rates[10] = state[8] * rates[2] - state[9] * rates[1]
    rates[11] = state[9] * rates[0] - state[7] * rates[2]
    rates[12] = state[7] * rates[1] - state[8] * rates[0]
    for k in range(local_tensions.size):
        rates[LENGTHS + k] = measure_tangent(guides[k], strain)[3] if present[k] else 0.0
    return True


@kernel(error_model="numpy")
def fill_cross(x, y, z, scale, out):
    """Fill ``out`` (3, 3) with the matrix of a cross product."""
    out[0, 0], out[0, 1], out[0, 2] = 0.0, -scale * z, scale * y
    out[1, 0], out[1, 1], out[1, 2] = scale * z, 0.0, -scale * x
    out[2, 0], out[2, 1], out[2, 2] = -scale * y, scale * x, 0.0


@kernel(error_model="numpy")
def fill_flexibility(section, local_tensions, strain, frame, flexibility, wrenches, work):
    """Fill the flexibility (6, 6) and the tendons' wrenches by tension (k, 6), in base axes.

    The flexibility is strain by force and moment, the inverse of `expand`'s Hessian; a wrench is
    ``(t, r x t)``. Both have force and shear first; False where the cross-section is not stable.
    """
    stiffness, rest, guides, present = section
    size = strain.size
    wide = size - 3
    matrix, column = work[0:size], work[size]
    own, load = stiffness[3 - wide :], work[11]
    expand(own, guides, present, local_tensions, load, strain, 1.0, column, matrix)
    if not factor_cholesky(matrix, size, 0.0, 0.0, matrix):
        return False
    flexibility[:] = 0.0
    for j in range(size):
        # A base axis in the body, the strain under a unit load along it, and that in base axes.
        part = 3 * (j // 3)
        column[:] = 0.0
        for i in range(3):
            column[part + i] = frame[j - part, i]
        solve_lower(matrix, column, size)
        solve_upper(matrix, column, size)
        for i in range(size):
            first = 3 * (i // 3)
            total = 0.0
            for m in range(3):
                total += frame[i - first, m] * column[first + m]
            flexibility[3 - wide + i, 3 - wide + j] = total
    for k in range(local_tensions.size):
        wrenches[k] = 0.0
        if not present[k]:
            continue
        t0, t1, t2, length_rate = measure_tangent(guides[k], strain)
        if length_rate == 0.0:
            return False
        t0, t1, t2 = t0 / length_rate, t1 / length_rate, t2 / length_rate
        x, y = guides[k, 0], guides[k, 1]
        m0, m1, m2 = t2 * y, -t2 * x, t1 * x - t0 * y
        for i in range(3):
            wrenches[k, i] = frame[i, 0] * t0 + frame[i, 1] * t1 + frame[i, 2] * t2
            wrenches[k, 3 + i] = frame[i, 0] * m0 + frame[i, 1] * m1 + frame[i, 2] * m2
    return True


@kernel(error_model="numpy")
def fill_flow(state, rates, frame, line_load, flexibility, wrenches, sources, free, flow, work):
    """Fill the linearised equations: ``flow`` (12 + k, 9 + k + m), rates of the sensitivities.

    Rows are rotation ``f``, moment, force, tendon lengths and place; columns rotation, moment,
    force, the tensions, and ``sources`` (m, 6): forces and moments that strains take up. With the
    flexibility ``C`` and a tendon's wrench ``w_k``, all in base axes::

        d(e, u) = C (dN + N x f, dM + M x f) - C (sum_k w_k dT_k + sources)
        f' = du ,  dp' = de + f x p' ,  dM' = N x dp' + dN x p' ,  dl_k' = w_k . d(e, u)

    and ``dN' = -f x`` the line load of the body.
    """
    first, count = (0 if flexibility[0, 0] > 0.0 else 3), len(wrenches)
    at = BY_LENGTHS + count
    cross, strains = work[0:3], work[3:9]
    columns = flow.shape[1]
    strains[:] = 0.0
    fill_cross(state[7], state[8], state[9], 1.0, cross)
    for c in range(columns):
        if free == 6 and c >= 6 and c < 9:
            continue
        for i in range(first, 6):
            total = 0.0
            if c < 3:
                if first == 0:
                    for j in range(3):
                        total += flexibility[i, j] * cross[j, c]
                # The cross product with the moment, column by column.
                a, b = (c + 1) % 3, (c + 2) % 3
                total += (
                    flexibility[i, 3 + a] * state[10 + b] - flexibility[i, 3 + b] * state[10 + a]
                )
            elif c < 6:
                total = flexibility[i, c]
            elif c < 9:
                total = flexibility[i, c - 6]
            elif c < 9 + count:
                for j in range(first, 6):
                    total -= flexibility[i, j] * wrenches[c - 9, j]
            else:
                for j in range(first, 6):
                    total -= flexibility[i, j] * sources[c - 9 - count, j]
            strains[i, c] = total
    for c in range(columns):
        for i in range(3):
            flow[i, c] = strains[3 + i, c]
            flow[at + i, c] = strains[i, c]
            flow[6 + i, c] = 0.0
        for k in range(count):
            total = 0.0
            for i in range(first, 6):
                total += wrenches[k, i] * strains[i, c]
            flow[BY_LENGTHS + k, c] = total
    # By a rotation the tangent p' and the loads of the body turn too.
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        flow[at + a, c] -= rates[b]
        flow[at + b, c] += rates[a]
        for j in range(3):
            flow[6 + a, c] += frame[b, j] * line_load[1, j]
            flow[6 + b, c] -= frame[a, j] * line_load[1, j]
    for c in range(columns):
        p0, p1, p2 = flow[at, c], flow[at + 1, c], flow[at + 2, c]
        flow[3, c] = state[8] * p2 - state[9] * p1
        flow[4, c] = state[9] * p0 - state[7] * p2
        flow[5, c] = state[7] * p1 - state[8] * p0
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        flow[3 + a, 6 + c] -= rates[b]
        flow[3 + b, 6 + c] += rates[a]


@kernel(error_model="numpy")
def carry(flow, sensitivities, free, out):
    """Fill rates ``out`` of derivatives by the ``free`` first unknowns, and by sources."""
    rows, columns = sensitivities.shape
    for r in range(rows):
        if free == 6 and r >= 6 and r < 9:
            continue
        for c in range(columns):
            out[r, c] = flow[r, 9 + c - free] if c >= free else 0.0
        for j in range(free):
            coefficient = flow[r, j]
            if coefficient != 0.0:
                for c in range(columns):
                    out[r, c] += coefficient * sensitivities[j, c]


@kernel(error_model="numpy")
def integrate_rod(first, last, rod, load_factor, tensions, states, sensitivities, sections, form):
    """Integrate from step ``first`` up to ``last`` by the Runge-Kutta method of fourth order.

    ``rod`` is the grid, the loads, and whether it shears and stretches. The grid is the steps'
    ends (n + 1,), and at start, middle and end of each step the stiffness against shear, stretch,
    bend and twist (n, 3, 6), the natural curvature (n, 3, 3), places and slopes of tendons
    (n, 3, k, 4), and whether they run there (n, k). Loads are forces per length (n, 3, 2, 3) in
    axes of base and body, what is put on at the steps' ends (n + 1, 4, 3), force and moment in
    base axes and in the body's, and by how much tensions differ from ``tensions``, (n, 3, k) or
    empty. A ``load_factor`` of the loads is taken. Loads of the world may follow, (n, 3, 3, 3) and
    (n + 1, 6, 3): those among the ones in base axes that do not turn with the base.

    Goes on from ``states[first]`` and fills ``states`` (n + 1, 16 + k), each beyond the load there.
    If not empty, ``sensitivities`` (9 + k or 12 + k, d + k + 2 m) are carried along, rows as of
    `fill_flow`: derivatives by d = 6 or 9 unknowns at the start, rotation, moment and force there,
    by the tensions, and by relative changes of EI and GJ of each of m ``sections``, which are those
    of the steps (n,) and their count. 2 k + 3 columns more are by the routing (`fill_routing`) and
    by a rotation of the base as it turns loads of the world.

    `form` is filled with what `fill_form` has of the steps, if not empty. False where it breaks
    down.
    """
    grid, loads, shears = rod
    places, stiffness, rest, guides, present = grid
    line_loads, point_loads, tension_changes = loads
    count, k = states.shape[1], tensions.size
    local_tensions, line_load = tensions.copy(), np.empty((2, 3))
    strain = np.zeros(6 if shears else 3)
    past, trend, before = np.zeros((2, strain.size)), np.zeros((2, strain.size)), 0.0
    work, frame = np.zeros((12, strain.size)), np.empty((3, 3))
    rates, trial = np.empty((4, count)), np.empty(count)
    wants_sensitivities = sensitivities.size > 0
    rows, columns = sensitivities.shape
    owners, parts = sections
    free = min(columns - k - 2 * parts, 9)
    flexibility, wrenches = np.zeros((6, 6)), np.zeros((k, 6))
    sources, length_sources = np.zeros((max(columns - free - k, 0), 6)), np.zeros(2 * k)
    routed = len(sources) > 2 * parts
    flow, room = np.zeros((12 + k, 9 + k + len(sources))), np.zeros((9, 9 + k + len(sources)))
    sensitivity_rates, trial_sensitivities = np.zeros((4, rows, columns)), np.zeros((rows, columns))
    for n in range(first, last):
        h = places[n + 1] - places[n]
        for stage in range(4):
            ahead = (0.0, 0.5, 0.5, 1.0)[stage] * h
            row = (0, 1, 1, 2)[stage]
            for i in range(count):
                trial[i] = states[n, i]
                if stage > 0:
                    trial[i] += ahead * rates[stage - 1, i]
            for i in range(3):
                line_load[0, i] = load_factor * line_loads[n, row, 0, i]
                line_load[1, i] = load_factor * line_loads[n, row, 1, i]
            if tension_changes.size > 0:
                for m in range(k):
                    local_tensions[m] = tensions[m] + tension_changes[n, row, m]
            # As the step before went on, in second order: Newton's method then takes a step or two.
            if before > 0.0 and (stage == 1 or stage == 3):
                near, far = (0.0 if stage == 1 else 0.5 * h) / before, ahead / before
                for i in range(strain.size):
                    strain[i] += (far - near) * (trend[0, i] + (far + near) * trend[1, i])
            # The equations, then the linearised ones.
            section = stiffness[n, row], rest[n, row], guides[n, row], present[n]
            if not fill_rates(
                trial, section, line_load, local_tensions, strain, frame, rates[stage], work
            ):
                return False
            if stage == 0 or stage == 2:
                for i in range(strain.size):
                    past[stage // 2, i] = strain[i]
            if not wants_sensitivities:
                continue
            if not fill_flexibility(
                section, local_tensions, strain, frame, flexibility, wrenches, work
            ):
                return False
            if parts:
                sources[:] = 0.0
                for m in range(3):
                    own = stiffness[n, row, 3 + m]
                    own *= strain[strain.size - 3 + m] - rest[n, row, m]
                    for i in range(3):
                        sources[2 * owners[n] + m // 2, 3 + i] += frame[i, m] * own
            if routed:
                fill_routing(
                    guides[n, row],
                    present[n],
                    local_tensions,
                    strain,
                    frame,
                    sources[2 * parts :],
                    length_sources,
                )
            fill_flow(
                trial,
                rates[stage],
                frame,
                line_load,
                flexibility,
                wrenches,
                sources,
                free,
                flow,
                room,
            )
            if routed:
                at = 9 + k + 2 * parts
                for m in range(2 * k):
                    flow[BY_LENGTHS + m // 2, at + m] += length_sources[m]
                add_load_rotation(line_loads[n, row, 2], -load_factor, flow[6:9, at + 2 * k :])
            if stage == 0:
                carry(flow, sensitivities, free, sensitivity_rates[0])
            else:
                for r in range(rows):
                    for c in range(columns):
                        trial_sensitivities[r, c] = (
                            sensitivities[r, c] + ahead * sensitivity_rates[stage - 1, r, c]
                        )
                carry(flow, trial_sensitivities, free, sensitivity_rates[stage])
            if stage == 2 and len(form[0]):
                fill_form(
                    n, h, trial, rates[2], stiffness[n, 1], frame, flexibility, wrenches, form
                )
        before = h
        for i in range(strain.size):
            trend[0, i] = past[0, i] - 4.0 * past[1, i] + 3.0 * strain[i]
            trend[1, i] = 2.0 * (past[0, i] - 2.0 * past[1, i] + strain[i])
        for i in range(count):
            states[n + 1, i] = states[n, i] + h / 6.0 * (
                rates[0, i] + 2.0 * rates[1, i] + 2.0 * rates[2, i] + rates[3, i]
            )
        size = 0.0
        for i in range(QUATERNION, FORCE):
            size += states[n + 1, i] ** 2
        size = 1.0 / math.sqrt(size)
        for i in range(QUATERNION, FORCE):
            states[n + 1, i] *= size
        if wants_sensitivities:
            for r in range(rows):
                for c in range(columns):
                    sensitivities[r, c] += (h / 6.0) * (
                        sensitivity_rates[0, r, c]
                        + 2.0 * sensitivity_rates[1, r, c]
                        + 2.0 * sensitivity_rates[2, r, c]
                        + sensitivity_rates[3, r, c]
                    )
        apply_point_load(point_loads[n + 1], load_factor, states[n + 1], frame, sensitivities)
        if routed:
            add_load_rotation(
                point_loads[n + 1, 4], -load_factor, sensitivities[6:9, columns - 3 :]
            )
            add_load_rotation(
                point_loads[n + 1, 5], -load_factor, sensitivities[3:6, columns - 3 :]
            )
        for i in range(count):
            if not math.isfinite(states[n + 1, i]):
                return False
    return True


@kernel(error_model="numpy")
def apply_point_load(point_load, load_factor, state, frame, sensitivities):
    """Take a point load (4, 3), as of `integrate_rod`, off a state, and off its sensitivities."""
    size = 0.0
    for i in range(4):
        for j in range(3):
            size += abs(point_load[i, j])
    if size == 0.0:
        return
    fill_quaternion_rotation(state[3], state[4], state[5], state[6], frame)
    for part in range(2):
        at, row = (FORCE, 6) if part == 0 else (MOMENT, 3)
        b0, b1, b2 = 0.0, 0.0, 0.0
        for j in range(3):
            b0 += load_factor * frame[0, j] * point_load[2 + part, j]
            b1 += load_factor * frame[1, j] * point_load[2 + part, j]
            b2 += load_factor * frame[2, j] * point_load[2 + part, j]
        state[at] -= load_factor * point_load[part, 0] + b0
        state[at + 1] -= load_factor * point_load[part, 1] + b1
        state[at + 2] -= load_factor * point_load[part, 2] + b2
        for c in range(sensitivities.shape[1]):
            f0, f1, f2 = sensitivities[0, c], sensitivities[1, c], sensitivities[2, c]
            sensitivities[row, c] += b1 * f2 - b2 * f1
            sensitivities[row + 1, c] += b2 * f0 - b0 * f2
            sensitivities[row + 2, c] += b0 * f1 - b1 * f0


# What changes the rod from outside: its tendons' routing, and the orientation of the base.


@kernel
def add_load_rotation(load, factor, out):
    """Add ``factor`` times ``load x e_c`` to each column c of ``out`` (3, 3)."""
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        out[a, c] += factor * load[b]
        out[b, c] -= factor * load[a]


@kernel
def fill_routing(guides, present, local_tensions, strain, frame, sources, length_sources):
    """Fill what a relative change of each tendon's offset does here, and an angle of its clocking.

    Force and moment that the tendons then add (2 k, 6), in base axes, and by how much they get
    longer per length of the rod (2 k,).
    """
    wide = strain.size - 3
    u0, u1, u2 = strain[wide], strain[wide + 1], strain[wide + 2]
    own = np.empty(6)
    for m in range(2 * local_tensions.size):
        sources[m] = 0.0
        length_sources[m] = 0.0
        k = m // 2
        if not present[k]:
            continue
        t0, t1, t2, length_rate = measure_tangent(guides[k], strain)
        x, y, dx, dy = guides[k, 0], guides[k, 1], guides[k, 0], guides[k, 1]
        d0, d1 = guides[k, 2], guides[k, 3]
        if m % 2 == 1:
            dx, dy, d0, d1 = -y, x, -guides[k, 3], guides[k, 2]
        d0, d1, d2 = d0 - u2 * dy, d1 + u2 * dx, u0 * dy - u1 * dx
        t0, t1, t2 = t0 / length_rate, t1 / length_rate, t2 / length_rate
        length_change = t0 * d0 + t1 * d1 + t2 * d2
        length_sources[m] = length_change
        # Change of the unit tangent.
        d0, d1, d2 = (
            (d0 - t0 * length_change) / length_rate,
            (d1 - t1 * length_change) / length_rate,
            (d2 - t2 * length_change) / length_rate,
        )
        own[0], own[1], own[2] = d0, d1, d2
        own[3] = y * d2 + dy * t2
        own[4] = -x * d2 - dx * t2
        own[5] = x * d1 - y * d0 + dx * t1 - dy * t0
        for part in range(0, 6, 3):
            for i in range(3):
                for j in range(3):
                    sources[m, part + i] += local_tensions[k] * frame[i, j] * own[part + j]


# The second variation of the energy, in steps.
#
# Turned by a small rotation ``f`` of its cross-sections, a rod under dead loads and tensions has
# the second variation ``f' P f' - M . (f x f') - N . (f x (f x p'))``, with ``P`` its stiffness
# against bending and twist, tendons included; shear and stretch settle by themselves and add
# ``- 2 q E f' - q D q`` with ``q = N x f``.


@kernel(error_model="numpy")
def fill_form(n, h, state, rates, stiffness, frame, flexibility, wrenches, form):
    """Fill a step's second variation by the rotations of its ends: linear between them.

    What goes with the rotations' square has the weights 5/12 and 1/12, between those of linear
    rotations and of a sum over the ends: the errors of both in the buckling load cancel to fourth
    order.

    ``form`` is that (n, 6, 6), the backbone's own (n, 3, 3) by the difference of the rotations,
    gradients of tendon lengths (n, k, 6), and what shear and stretch add to their flexibility under
    tension (n, k, k). Forces are taken to keep their direction.
    """
    matrices, backbone, length_gradients, length_flexibility = form
    p, e, d = np.empty((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    s, u, cross, part = np.zeros((3, 3)), np.zeros((3, 3)), np.empty((3, 3)), np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            cross[i, j] = flexibility[3 + i, 3 + j]
    invert_three(cross, np.zeros(3), p)
    wide = flexibility[0, 0] > 0.0
    # -M . (f x f'): half of it by each end.
    fill_cross(state[10], state[11], state[12], -0.5, s)
    if wide:
        fill_cross(state[7], state[8], state[9], 1.0, cross)
        for i in range(3):
            for j in range(3):
                d[i, j] = flexibility[i, j]
                for m in range(3):
                    e[i, j] += flexibility[i, 3 + m] * p[m, j]
        for i in range(3):
            for j in range(3):
                for m in range(3):
                    d[i, j] -= e[i, m] * flexibility[3 + m, j]
                    s[i, j] -= e[m, i] * cross[m, j]
        for i in range(3):
            for j in range(3):
                for m in range(3):
                    part[i, j] += d[i, m] * cross[m, j]
        for i in range(3):
            for j in range(3):
                for m in range(3):
                    u[i, j] -= cross[m, i] * part[m, j]
    # -N . (f x (f x p')) = (N . p') |f|^2 - (N . f) (p' . f)
    along = state[7] * rates[0] + state[8] * rates[1] + state[9] * rates[2]
    for i in range(3):
        u[i, i] += along
        for j in range(3):
            u[i, j] -= 0.5 * (rates[i] * state[7 + j] + state[7 + i] * rates[j])
    for i in range(3):
        for j in range(3):
            even, odd = 0.5 * (s[i, j] + s[j, i]), 0.5 * (s[i, j] - s[j, i])
            matrices[n, i, j] = p[i, j] / h - even + OWN * h * u[i, j]
            matrices[n, 3 + i, 3 + j] = p[i, j] / h + even + OWN * h * u[i, j]
            matrices[n, 3 + i, j] = -p[i, j] / h + odd + OTHER * h * u[i, j]
            matrices[n, j, 3 + i] = matrices[n, 3 + i, j]
            total = 0.0
            for m in range(3):
                total += frame[i, m] * stiffness[3 + m] * frame[j, m]
            backbone[n, i, j] = total / h
    for k in range(len(wrenches)):
        for i in range(3):
            by_rate, by_turn = wrenches[k, 3 + i], 0.0
            if wide:
                for j in range(3):
                    by_rate += e[j, i] * wrenches[k, j]
                    for m in range(3):
                        by_turn += wrenches[k, m] * d[m, j] * cross[j, i]
            length_gradients[n, k, i] = -by_rate + 0.5 * h * by_turn
            length_gradients[n, k, 3 + i] = by_rate + 0.5 * h * by_turn
        for m in range(len(wrenches)):
            total = 0.0
            for i in range(3):
                for j in range(3):
                    total += wrenches[k, i] * d[i, j] * wrenches[m, j]
            length_flexibility[n, k, m] = h * total
