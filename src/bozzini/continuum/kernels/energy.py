"""Numba kernels of the discrete rod: Newton's method on its energy under the tendons' lengths.

The rod, straight at rest and without loads, is a row of segments with one rotation vector ``w_j``
each. It takes the least ``1/2 sum w^T K w``, ``K = diag(EI, EI, GJ) / h``, for which no tendon is
longer than the cable it was given: the tensions ``T`` are the multipliers of that, so none is
negative, and a tendon that is not needed hangs slack by itself. Its conditions are ::

    K w_j + J_j^T T = 0  for every segment,  J_kj = dl_k/dw_j ,   sum_j l_kj - c_k T_k <= limit_k

with equality where ``T_k > 0`` or the tendon pushes. With the blocks ``H_j = K + sum_k T_k
d2l_k/dw_j^2``, or their positive part, a step takes ``(J H^-1 J^T + c) T = l - limit - J H^-1 K w``
as a bounded problem (`solve_bounded`), whose unknowns are the tensions (t,), and ``dw = -H^-1 (K w
+ J^T T)``. It ends when no segment rotates by more than 1e-10 rad, or 1e-6 where steps get no
smaller, and lengths are right.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_matrix, copy_vector, set_identity
from ...numeric.kernels.linear_algebra import invert_three, solve_bounded

# Numba kernels of one segment of the discrete rod: tendon length, its gradient and its Hessian.
#
# Everything is a sum of ``d . f(w) r`` with ``f(w) = f_n I + f_(n+1) [w] + f_(n+2) w w^T`` and the
# entire functions ``f_n(q) = sum_k (-q)^k / (2 k + n)!`` of ``q = |w|^2``: the rotation itself is
# n = 0, and the integral of rotations along an arc is n = 1. They are smooth at ``w = 0``.

CHORD = 0
ARC = 1
CHANNEL = 2

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(3)
POINTS, WEIGHTS = 0.5 * (1.0 + POINTS), 0.5 * WEIGHTS
"""Gauss points of a segment, from 0 to 1, and their weights."""

FACTORIALS = np.array([1.0, 1.0, 2.0, 6.0, 24.0, 120.0, 720.0, 5040.0])


@kernel
def fill_functions(q, f):
    """Fill ``f`` (8,) with ``f_n(q)``: the two last by their series, then down from them."""
    for n in (6, 7):
        term = 1.0 / FACTORIALS[n]
        total = term
        for k in range(1, 40):
            term *= -q / ((2 * k + n) * (2 * k + n - 1))
            total += term
            if abs(term) < 1e-17 * abs(total):
                break
        f[n] = total
    for n in range(5, -1, -1):
        f[n] = 1.0 / FACTORIALS[n] - q * f[n + 2]


@kernel
def fill_rotation(w, f, rotation):
    """Rotation matrix (3, 3) of the rotation vector ``w``, given its functions ``f``."""
    for i in range(3):
        for k in range(3):
            rotation[i, k] = f[2] * w[i] * w[k]
        rotation[i, i] += f[0]
    rotation[0, 1] -= f[1] * w[2]
    rotation[0, 2] += f[1] * w[1]
    rotation[1, 0] += f[1] * w[2]
    rotation[1, 2] -= f[1] * w[0]
    rotation[2, 0] -= f[1] * w[1]
    rotation[2, 1] += f[1] * w[0]


@kernel
def add_form(w, f, n, r0, r1, r2, scale, inner, value, gradient):
    """Add ``scale f(inner w) r`` to ``value`` and its derivative by ``w`` to ``gradient`` (3, 3).

    ``f`` are the functions of ``inner w``.
    """
    w0, w1, w2 = inner * w[0], inner * w[1], inner * w[2]
    along = w0 * r0 + w1 * r1 + w2 * r2
    c0, c1, c2 = w1 * r2 - w2 * r1, w2 * r0 - w0 * r2, w0 * r1 - w1 * r0
    value[0] += scale * (f[n] * r0 + f[n + 1] * c0 + f[n + 2] * along * w0)
    value[1] += scale * (f[n] * r1 + f[n + 1] * c1 + f[n + 2] * along * w1)
    value[2] += scale * (f[n] * r2 + f[n + 1] * c2 + f[n + 2] * along * w2)
    # Twice the derivatives by q: 2 f_n' = n f_(n+2) - f_(n+1).
    p0 = n * f[n + 2] - f[n + 1]
    p1 = (n + 1) * f[n + 3] - f[n + 2]
    p2 = (n + 2) * f[n + 4] - f[n + 3]
    s = scale * inner
    e0 = s * (p0 * r0 + p1 * c0 + p2 * along * w0)
    e1 = s * (p0 * r1 + p1 * c1 + p2 * along * w1)
    e2 = s * (p0 * r2 + p1 * c2 + p2 * along * w2)
    a, b = s * f[n + 1], s * f[n + 2]
    gradient[0, 0] += e0 * w0 + b * (along + w0 * r0)
    gradient[0, 1] += e0 * w1 + a * r2 + b * w0 * r1
    gradient[0, 2] += e0 * w2 - a * r1 + b * w0 * r2
    gradient[1, 0] += e1 * w0 - a * r2 + b * w1 * r0
    gradient[1, 1] += e1 * w1 + b * (along + w1 * r1)
    gradient[1, 2] += e1 * w2 + a * r0 + b * w1 * r2
    gradient[2, 0] += e2 * w0 + a * r1 + b * w2 * r0
    gradient[2, 1] += e2 * w1 - a * r0 + b * w2 * r1
    gradient[2, 2] += e2 * w2 + b * (along + w2 * r2)


@kernel
def add_form_hessian(w, f, n, r0, r1, r2, d, scale, inner, hessian):
    """Add to ``hessian`` (3, 3) the second derivative by ``w`` of ``scale d . f(inner w) r``."""
    w0, w1, w2 = inner * w[0], inner * w[1], inner * w[2]
    d0, d1, d2 = d[0], d[1], d[2]
    x0, x1, x2 = r1 * d2 - r2 * d1, r2 * d0 - r0 * d2, r0 * d1 - r1 * d0
    dot = d0 * r0 + d1 * r1 + d2 * r2
    cross_part = w0 * x0 + w1 * x1 + w2 * x2
    wr = w0 * r0 + w1 * r1 + w2 * r2
    wd = w0 * d0 + w1 * d1 + w2 * d2
    p0 = n * f[n + 2] - f[n + 1]
    p1 = (n + 1) * f[n + 3] - f[n + 2]
    p2 = (n + 2) * f[n + 4] - f[n + 3]
    # Four times the second derivatives by q.
    t0 = f[n + 2] - (2 * n + 1) * f[n + 3] + n * (n + 2) * f[n + 4]
    t1 = f[n + 3] - (2 * n + 3) * f[n + 4] + (n + 1) * (n + 3) * f[n + 5]
    t2 = f[n + 4] - (2 * n + 5) * f[n + 5] + (n + 2) * (n + 4) * f[n + 6]
    s = scale * inner * inner
    first = s * (p0 * dot + p1 * cross_part + p2 * wr * wd)
    second = s * (t0 * dot + t1 * cross_part + t2 * wr * wd)
    g0 = s * (p1 * x0 + p2 * (wd * r0 + wr * d0)) + 0.5 * second * w0
    g1 = s * (p1 * x1 + p2 * (wd * r1 + wr * d1)) + 0.5 * second * w1
    g2 = s * (p1 * x2 + p2 * (wd * r2 + wr * d2)) + 0.5 * second * w2
    b = s * f[n + 2]
    hessian[0, 0] += first + 2.0 * (w0 * g0 + b * r0 * d0)
    hessian[1, 1] += first + 2.0 * (w1 * g1 + b * r1 * d1)
    hessian[2, 2] += first + 2.0 * (w2 * g2 + b * r2 * d2)
    h01 = w0 * g1 + w1 * g0 + b * (r0 * d1 + r1 * d0)
    h02 = w0 * g2 + w2 * g0 + b * (r0 * d2 + r2 * d0)
    h12 = w1 * g2 + w2 * g1 + b * (r1 * d2 + r2 * d1)
    hessian[0, 1] += h01
    hessian[1, 0] += h01
    hessian[0, 2] += h02
    hessian[2, 0] += h02
    hessian[1, 2] += h12
    hessian[2, 1] += h12


@kernel
def move_forward(w, f, half, length, backbone, value, slope):
    """Step of the backbone over a segment (3,) and its derivative by ``w`` (3, 3).

    A chord of the segment's length half-way between its two tangents, or the arc of that length.
    ``f`` are the functions of ``w``, ``half`` those of ``w / 2``.
    """
    value[:] = 0.0
    slope[:] = 0.0
    if backbone == CHORD:
        add_form(w, half, 0, 0.0, 0.0, 1.0, length, 0.5, value, slope)
    else:
        add_form(w, f, 1, 0.0, 0.0, 1.0, length, 1.0, value, slope)


@kernel
def measure_length(backbone, ends, tension, work, slope, psd, full):
    """Length of one tendon over a segment [mm], straight between the discs.

    ``backbone`` is the rotation vector, its functions and those of its half, length and kind of the
    segment, and what `move_forward` fills. ``ends`` (2, 2) are the tendon's places in the two
    discs. Fills its gradient ``slope`` (3,) and adds ``tension`` times its Hessian to ``full``, and
    the part of the Hessian that cannot be negative to ``psd``. ``work`` is (5, 3).
    """
    w, f, half, length, kind, step, step_slope = backbone
    value, matrix = work[0], work[1:4]
    for i in range(3):
        value[i] = step[i]
        for k in range(3):
            matrix[i, k] = step_slope[i, k]
    add_form(w, f, 0, ends[1, 0], ends[1, 1], 0.0, 1.0, 1.0, value, matrix)
    value[0] -= ends[0, 0]
    value[1] -= ends[0, 1]
    size = math.sqrt(value[0] ** 2 + value[1] ** 2 + value[2] ** 2)
    direction = work[4]
    for i in range(3):
        direction[i] = value[i] / size
    for k in range(3):
        slope[k] = (
            direction[0] * matrix[0, k] + direction[1] * matrix[1, k] + direction[2] * matrix[2, k]
        )
    if tension == 0.0:
        return size
    tension_per_length = tension / size
    for i in range(3):
        for k in range(3):
            square = (
                matrix[0, i] * matrix[0, k]
                + matrix[1, i] * matrix[1, k]
                + matrix[2, i] * matrix[2, k]
            )
            part = tension_per_length * (square - slope[i] * slope[k])
            full[i, k] += part
            if tension > 0.0:
                psd[i, k] += part
    add_form_hessian(w, f, 0, ends[1, 0], ends[1, 1], 0.0, direction, tension, 1.0, full)
    if kind == CHORD:
        add_form_hessian(w, half, 0, 0.0, 0.0, 1.0, direction, tension * length, 0.5, full)
    else:
        add_form_hessian(w, f, 1, 0.0, 0.0, 1.0, direction, tension * length, 1.0, full)
    return size


@kernel
def measure_channel(w, length, guides, tension, slope, psd, full):
    """Length of one tendon in a smooth channel of a segment of constant curvature and twist [mm].

    ``guides`` (g, 4) are place and slope of the channel at the Gauss points. Fills and adds as
    `measure_length`; this length is convex in ``w``.
    """
    total = 0.0
    slope[:] = 0.0
    u0, u1, u2 = w[0] / length, w[1] / length, w[2] / length
    for g in range(WEIGHTS.size):
        x, y = guides[g, 0], guides[g, 1]
        v0 = guides[g, 2] - u2 * y
        v1 = guides[g, 3] + u2 * x
        v2 = 1.0 + u0 * y - u1 * x
        size = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
        total += WEIGHTS[g] * length * size
        m0, m1, m2 = v2 * y / size, -v2 * x / size, (v1 * x - v0 * y) / size
        slope[0] += WEIGHTS[g] * m0
        slope[1] += WEIGHTS[g] * m1
        slope[2] += WEIGHTS[g] * m2
        if tension == 0.0:
            continue
        tension_per_length = tension * WEIGHTS[g] / (length * size)
        h00, h01, h02 = (
            tension_per_length * (y * y - m0 * m0),
            tension_per_length * (-x * y - m0 * m1),
            -tension_per_length * m0 * m2,
        )
        h11, h12 = tension_per_length * (x * x - m1 * m1), -tension_per_length * m1 * m2
        h22 = tension_per_length * (x * x + y * y - m2 * m2)
        for part in range(2 if tension > 0.0 else 1):
            matrix = full if part == 0 else psd
            matrix[0, 0] += h00
            matrix[1, 1] += h11
            matrix[2, 2] += h22
            matrix[0, 1] += h01
            matrix[1, 0] += h01
            matrix[0, 2] += h02
            matrix[2, 0] += h02
            matrix[1, 2] += h12
            matrix[2, 1] += h12
    return total


# Numba kernels of the discrete rod: lengths of its tendons, its frames, and its linear problem.
#
# A ``grid`` is what they all take: the segments' lengths (n,), their moments by rotation about x, y
# and z (n, 3), the tendons' places in the cross-sections (k, n + 1, 2), their places and slopes at
# the Gauss points (k, n, g, 4), how many segments each tendon passes (k,), and the kind of segment.


@kernel
def measure_lengths(grid, rotation_vectors, tensions, lengths, length_gradients, psd, full):
    """Fill tendon lengths (k,), their gradients (k, n, 3), and the Hessians (n, 3, 3) by tension.

    ``full`` gets ``sum_k T_k d2l_k/dw2`` and ``psd`` the part of it that cannot be negative.
    """
    spans, _, paths, guides, counts, segment = grid
    f, half = np.empty(8), np.empty(8)
    step, step_slope, work = np.empty(3), np.empty((3, 3)), np.empty((5, 3))
    lengths[:] = 0.0
    length_gradients[:] = 0.0
    psd[:] = 0.0
    full[:] = 0.0
    for j in range(spans.size):
        w = rotation_vectors[j]
        if segment == CHANNEL:
            for k in range(counts.size):
                if j < counts[k]:
                    lengths[k] += measure_channel(
                        w,
                        spans[j],
                        guides[k, j],
                        tensions[k],
                        length_gradients[k, j],
                        psd[j],
                        full[j],
                    )
            continue
        q = w[0] ** 2 + w[1] ** 2 + w[2] ** 2
        fill_functions(q, f)
        fill_functions(0.25 * q, half)
        move_forward(w, f, half, spans[j], segment, step, step_slope)
        backbone = w, f, half, spans[j], segment, step, step_slope
        for k in range(counts.size):
            if j < counts[k]:
                ends, tension = paths[k, j : j + 2], tensions[k]
                lengths[k] += measure_length(
                    backbone, ends, tension, work, length_gradients[k, j], psd[j], full[j]
                )


@kernel
def differentiate_routing(grid, rotation_vectors, lengths, slopes):
    """Fill derivatives of tendon lengths (k, 2) and of their gradients (k, 2, n, 3) by routing.

    By a relative change of a tendon's offset, and by an angle of its clocking [rad].
    """
    spans, _, paths, guides, counts, segment = grid
    f, half, step, step_slope = np.empty(8), np.empty(8), np.empty(3), np.empty((3, 3))
    value, matrix, direction = np.empty(3), np.empty((3, 3)), np.empty(3)
    change, turned, tilted = np.empty(3), np.empty((3, 3)), np.empty(3)
    ends, moves, slope = np.empty((2, 2)), np.empty((2, 2)), np.empty(3)
    lengths[:] = 0.0
    slopes[:] = 0.0
    for j in range(spans.size):
        w = rotation_vectors[j]
        q = w[0] ** 2 + w[1] ** 2 + w[2] ** 2
        if segment != CHANNEL:
            fill_functions(q, f)
            fill_functions(0.25 * q, half)
            move_forward(w, f, half, spans[j], segment, step, step_slope)
        for k in range(counts.size):
            if j >= counts[k]:
                continue
            for kind in range(2):
                if segment == CHANNEL:
                    lengths[k, kind] += differentiate_channel(
                        w, spans[j], guides[k, j], kind, slopes[k, kind, j]
                    )
                    continue
                for end in range(2):
                    copy_vector(paths[k, j + end], ends[end])
                    copy_vector(ends[end], moves[end])
                    if kind == 1:
                        moves[end, 0], moves[end, 1] = -ends[end, 1], ends[end, 0]
                copy_vector(step, value)
                copy_matrix(step_slope, matrix)
                change[:], turned[:] = 0.0, 0.0
                add_form(w, f, 0, ends[1, 0], ends[1, 1], 0.0, 1.0, 1.0, value, matrix)
                add_form(w, f, 0, moves[1, 0], moves[1, 1], 0.0, 1.0, 1.0, change, turned)
                for i in range(2):
                    value[i] -= ends[0, i]
                    change[i] -= moves[0, i]
                size = math.sqrt(value[0] ** 2 + value[1] ** 2 + value[2] ** 2)
                length_change = 0.0
                for i in range(3):
                    direction[i] = value[i] / size
                    length_change += direction[i] * change[i]
                for i in range(3):
                    tilted[i] = (change[i] - direction[i] * length_change) / size
                for c in range(3):
                    slope[c] = 0.0
                    for i in range(3):
                        slope[c] += tilted[i] * matrix[i, c] + direction[i] * turned[i, c]
                lengths[k, kind] += length_change
                copy_vector(slope, slopes[k, kind, j])


@kernel
def differentiate_channel(w, length, guides, kind, slope):
    """As `differentiate_routing`, in one segment of a smooth channel; adds to ``slope`` (3,)."""
    total = 0.0
    u0, u1, u2 = w[0] / length, w[1] / length, w[2] / length
    for g in range(WEIGHTS.size):
        x, y, along, across = guides[g]
        dx, dy, da, db = x, y, along, across
        if kind == 1:
            dx, dy, da, db = -y, x, -across, along
        v0, v1, v2 = along - u2 * y, across + u2 * x, 1.0 + u0 * y - u1 * x
        d0, d1, d2 = da - u2 * dy, db + u2 * dx, u0 * dy - u1 * dx
        size = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
        length_change = (v0 * d0 + v1 * d1 + v2 * d2) / size
        total += WEIGHTS[g] * length * length_change
        weight, relative_change = WEIGHTS[g] / size, length_change / size
        slope[0] += weight * (d2 * y + v2 * dy - v2 * y * relative_change)
        slope[1] -= weight * (d2 * x + v2 * dx - v2 * x * relative_change)
        twist_arm = v1 * x - v0 * y
        slope[2] += weight * (d1 * x + v1 * dx - d0 * y - v0 * dy - twist_arm * relative_change)
    return total


@kernel
def fill_frames(grid, rotation_vectors, rotations, points):
    """Frames of the discs, base first: rotations (n + 1, 3, 3) and origins (n + 1, 3)."""
    spans, _, _, _, _, segment = grid
    f, half = np.empty(8), np.empty(8)
    step, slope, rotation = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    set_identity(rotations[0])
    points[0] = 0.0
    for j in range(spans.size):
        w = rotation_vectors[j]
        q = w[0] ** 2 + w[1] ** 2 + w[2] ** 2
        fill_functions(q, f)
        fill_functions(0.25 * q, half)
        move_forward(w, f, half, spans[j], segment, step, slope)
        fill_rotation(w, f, rotation)
        for i in range(3):
            points[j + 1, i] = points[j, i]
            for k in range(3):
                points[j + 1, i] += rotations[j, i, k] * step[k]
                rotations[j + 1, i, k] = 0.0
                for m in range(3):
                    rotations[j + 1, i, k] += rotations[j, i, m] * rotation[m, k]


@kernel
def invert_blocks(stiffness, psd, full, exact, inverses):
    """Invert the Hessian (n, 3, 3); where it is not positive, the part of it that is. Counts."""
    block, least = np.empty((3, 3)), np.empty(3)
    replaced = 0
    for j in range(stiffness.shape[0]):
        done = False
        if exact:
            for i in range(3):
                least[i] = 1e-3 * stiffness[j, i]
                for k in range(3):
                    block[i, k] = full[j, i, k]
                block[i, i] += stiffness[j, i]
            done = invert_three(block, least, inverses[j])
        if not done:
            replaced += 1
            least[:] = 0.0
            for i in range(3):
                for k in range(3):
                    block[i, k] = psd[j, i, k] if exact else 0.0
                block[i, i] += stiffness[j, i]
            invert_three(block, least, inverses[j])
    return replaced


@kernel
def reduce_problem(length_gradients, counts, inverses, forces, matrix, vector, carried):
    """Fill ``J H^-1 J^T`` (k, k) and ``J H^-1 g`` (k,), and keep ``J H^-1`` in ``carried``."""
    matrix[:] = 0.0
    vector[:] = 0.0
    for k in range(counts.size):
        for j in range(counts[k]):
            for i in range(3):
                carried[k, j, i] = (
                    length_gradients[k, j, 0] * inverses[j, 0, i]
                    + length_gradients[k, j, 1] * inverses[j, 1, i]
                    + length_gradients[k, j, 2] * inverses[j, 2, i]
                )
                vector[k] += carried[k, j, i] * forces[j, i]
        for m in range(k + 1):
            total = 0.0
            for j in range(min(counts[k], counts[m])):
                for i in range(3):
                    total += carried[k, j, i] * length_gradients[m, j, i]
            matrix[k, m] = total
            matrix[m, k] = total


CONVERGED = 0
NOT_CONVERGED = 1
OVERLOADED = 2
FOLDED = 3

STEP_LIMIT = 0.5
"""Largest rotation of one segment in one step [rad]."""

FOLD_ANGLE = math.pi
"""Rotation of one segment at which the rod counts as folded [rad]."""

STEP_TOLERANCE = 1e-10
"""Rotation of every segment, in the last step, at which a solution counts as found [rad]."""

ROUGH = 1e-6
"""The same where steps do not get smaller any more: a stiff part pulls at a flexible one [rad]."""

ROUND_OFF = 1e-11
"""Error of a tendon's length that is round-off, against the longest of them."""

RIDGE = 1e-11
"""Added to the tendons' own flexibility, so that redundant tendons have one answer."""

MOST_OVERLOADED = 10
"""Steps with tensions out of bounds after which a command counts as impossible."""

SMALLEST_SHARE = 1.0 / 64.0
"""Smallest part of a command by which it is raised where the whole of it fails."""


@kernel
def solve_command(rod, limits, tolerance, rotation_vectors, tensions, lengths):
    """One command, from where ``rotation_vectors`` and ``tensions`` stand; both are changed.

    ``rod`` is the grid, the tendons' compliances (k,), their lowest and highest tensions (k,), and
    the most steps; ``limits`` are the cables' lengths. Returns a code, the steps taken, the error
    of the tendons' lengths against them [mm], and how many segments are not stable by themselves.
    """
    grid, compliances, low, high, most_steps = rod
    spans, stiffness, _, _, counts, _ = grid
    n, k = spans.size, counts.size
    length_gradients, carried = np.empty((k, n, 3)), np.empty((k, n, 3))
    psd, full, inverses = np.empty((n, 3, 3)), np.empty((n, 3, 3)), np.empty((n, 3, 3))
    matrix, vector, forces = np.empty((k, k)), np.empty(k), np.empty((n, 3))
    wanted, step = np.empty(k), np.empty((n, 3))
    exact, replaced, error, overloaded = True, 0, 0.0, 0
    largest_step, before = math.inf, math.inf
    for count in range(most_steps + 1):
        measure_lengths(grid, rotation_vectors, tensions, lengths, length_gradients, psd, full)
        error = 0.0
        loaded = True
        for m in range(k):
            residual = lengths[m] - limits[m] - compliances[m] * tensions[m]
            if tensions[m] == 0.0 and low[m] == 0.0:
                residual = max(residual, 0.0)
            error = max(error, abs(residual))
            loaded = loaded and abs(tensions[m]) < high[m]
        fine = error <= tolerance + ROUND_OFF * limits.max()
        rest = largest_step <= STEP_TOLERANCE or (
            largest_step <= ROUGH and largest_step > 0.5 * before
        )
        if count > 0 and rest and fine and loaded:
            return CONVERGED, count, error, replaced
        if count == most_steps:
            break
        replaced = invert_blocks(stiffness, psd, full, exact, inverses)
        for j in range(n):
            for i in range(3):
                forces[j, i] = stiffness[j, i] * rotation_vectors[j, i]
        reduce_problem(length_gradients, counts, inverses, forces, matrix, vector, carried)
        most = 0.0
        for m in range(k):
            matrix[m, m] += compliances[m]
            most = max(most, matrix[m, m])
        for m in range(k):
            if compliances[m] == 0.0:
                # About the tensions there are, so that it goes away as they settle.
                matrix[m, m] += RIDGE * most
                vector[m] -= RIDGE * most * tensions[m]
            vector[m] += limits[m] - lengths[m]
            wanted[m] = tensions[m]
        if not solve_bounded(matrix, vector, low, high, wanted):
            return NOT_CONVERGED, count, error, replaced
        loaded = True
        for m in range(k):
            loaded = loaded and abs(wanted[m]) < high[m]
        exact = loaded
        overloaded += 0 if loaded else 1
        if overloaded == MOST_OVERLOADED:
            return OVERLOADED, count, error, replaced
        before, largest_step = largest_step, 0.0
        for j in range(n):
            for i in range(3):
                step[j, i] = -(
                    inverses[j, i, 0] * forces[j, 0]
                    + inverses[j, i, 1] * forces[j, 1]
                    + inverses[j, i, 2] * forces[j, 2]
                )
                for m in range(k):
                    if j < counts[m]:
                        step[j, i] -= carried[m, j, i] * wanted[m]
            largest_step = max(
                largest_step, math.sqrt(step[j, 0] ** 2 + step[j, 1] ** 2 + step[j, 2] ** 2)
            )
        damping = min(1.0, STEP_LIMIT / largest_step) if largest_step > 0.0 else 1.0
        for j in range(n):
            for i in range(3):
                rotation_vectors[j, i] += damping * step[j, i]
            if (
                rotation_vectors[j, 0] ** 2
                + rotation_vectors[j, 1] ** 2
                + rotation_vectors[j, 2] ** 2
                > FOLD_ANGLE**2
            ):
                return FOLDED, count + 1, error, replaced
        copy_vector(wanted, tensions)
    return NOT_CONVERGED, most_steps, error, replaced


@kernel
def share_tensions(
    stiffness, counts, length_gradients, rotation_vectors, taut, low, high, tensions
):
    """Least tensions that hold the rod as it is: what redundant tendons leave open."""
    n, k = rotation_vectors.shape[0], counts.size
    inverses, forces = np.zeros((n, 3, 3)), np.empty((n, 3))
    for j in range(n):
        for i in range(3):
            inverses[j, i, i] = 1.0 / stiffness[j, i]
            forces[j, i] = stiffness[j, i] * rotation_vectors[j, i]
    matrix, vector, carried = np.empty((k, k)), np.empty(k), np.empty((k, n, 3))
    reduce_problem(length_gradients, counts, inverses, forces, matrix, vector, carried)
    least, most, shared = low.copy(), high.copy(), tensions.copy()
    largest = 0.0
    for m in range(k):
        largest = max(largest, matrix[m, m])
        if not taut[m]:
            least[m] = 0.0
            most[m] = 0.0
            shared[m] = 0.0
    ridge = 1e-8 * largest
    centred = vector.copy()
    for m in range(k):
        matrix[m, m] += ridge
    for _ in range(3):
        # Each pass takes out what the ridge did to the one before it.
        if not solve_bounded(matrix, centred, least, most, shared):
            return
        for m in range(k):
            centred[m] = vector[m] - ridge * shared[m]
    copy_vector(shared, tensions)


@kernel
def follow_command(
    rod, natural, displacement, tolerance, parts, rotation_vectors, tensions, lengths
):
    """One command from the straight rod, at once or else in parts, as far as it can be followed.

    ``parts`` are the part of the command that is tried at once, and the smallest one.

    Returns what `solve_command` does of the last part, the share of the command that was reached,
    and all steps taken.
    """
    low, (first, smallest) = rod[2], parts
    rotation_vectors[:] = 0.0
    tensions[:] = 0.0
    kept_turns, kept_tensions = rotation_vectors.copy(), tensions.copy()
    limits = np.empty(displacement.size)
    reached, increment, steps = 0.0, first, 0
    while True:
        load_factor = min(1.0, reached + increment)
        if load_factor > 1.0 - 1e-9:
            load_factor = 1.0
        for m in range(displacement.size):
            limits[m] = natural[m] - load_factor * displacement[m]
            if low[m] == 0.0:
                limits[m] += tolerance
        code, count, error, unstable = solve_command(
            rod, limits, tolerance, rotation_vectors, tensions, lengths
        )
        steps += count
        if code == CONVERGED:
            reached = load_factor
            if reached == 1.0:
                return code, error, unstable, reached, steps
            copy_matrix(rotation_vectors, kept_turns)
            copy_vector(tensions, kept_tensions)
        else:
            copy_matrix(kept_turns, rotation_vectors)
            copy_vector(kept_tensions, tensions)
            increment *= 0.5
            if increment < smallest:
                return code, error, unstable, reached, steps


@kernel
def measure_least(stiffness, full):
    """Least eigenvalue of the segments' Hessians (n, 3, 3), against the straight rod's.

    In closed form (Smith 1961).
    """
    least = math.inf
    a = np.empty((3, 3))
    for j in range(stiffness.shape[0]):
        mean, square = 0.0, 0.0
        for i in range(3):
            for k in range(3):
                a[i, k] = full[j, i, k] / math.sqrt(stiffness[j, i] * stiffness[j, k])
            mean += a[i, i] / 3.0
        for i in range(3):
            a[i, i] -= mean
            for k in range(3):
                square += a[i, k] ** 2
        size = math.sqrt(square / 6.0)
        value = mean
        if size > 0.0:
            det = (
                a[0, 0] * (a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1])
                - a[0, 1] * (a[1, 0] * a[2, 2] - a[1, 2] * a[2, 0])
                + a[0, 2] * (a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0])
            )
            angle = math.acos(min(1.0, max(-1.0, 0.5 * det / size**3))) / 3.0
            value += 2.0 * size * math.cos(angle + 2.0 * math.pi / 3.0)
        least = min(least, 1.0 + value)
    return least


@kernel
def solve_commands(rod, natural, displacements, firsts, tolerance, answers):
    """Solve a batch of commands (b, k), each from the straight rod; fills the arrays of `answers`.

    ``rod`` is that of `solve_command`, ``natural`` (k,) the tendons' lengths in the straight rod,
    ``firsts`` (b,) the parts of the commands that are tried at once. Answers are rotations (b, n,
    3), tensions and lengths (b, k), and codes, steps, errors, shares and `measure_least` (b,).
    Where a command fails, its share is how much of it can be followed, and the shape is that.
    """
    rotation_vectors, tensions, lengths, codes, steps, errors, load_factors, stability = answers
    grid, compliances, low, high, _ = rod
    spans, stiffness, _, _, counts, _ = grid
    n, k = spans.size, counts.size
    length_gradients = np.empty((k, n, 3))
    psd, full = np.empty((n, 3, 3)), np.empty((n, 3, 3))
    taut = np.empty(k, dtype=np.bool_)
    for b in range(displacements.shape[0]):
        steps[b] = 0
        # As commanded to round-off; with the tolerance, and in parts, only where that cannot be.
        for attempt in range(3):
            allowed = tolerance if attempt > 0 else 1e-4 * tolerance
            smallest = SMALLEST_SHARE * firsts[b] if attempt == 2 else firsts[b]
            parts, state = (firsts[b], smallest), (rotation_vectors[b], tensions[b], lengths[b])
            codes[b], errors[b], _, load_factors[b], count = follow_command(
                rod, natural, displacements[b], allowed, parts, *state
            )
            steps[b] += count
            if codes[b] == CONVERGED:
                break
        measure_lengths(
            grid, rotation_vectors[b], tensions[b], lengths[b], length_gradients, psd, full
        )
        for m in range(k):
            slack_length = natural[m] - load_factors[b] * displacements[b, m] - lengths[b, m]
            taut[m] = low[m] < 0.0 or slack_length <= tolerance
        stability[b] = measure_least(stiffness, full)
        # Tendons that stretch leave nothing open.
        if compliances.max() == 0.0:
            share_tensions(
                stiffness,
                counts,
                length_gradients,
                rotation_vectors[b],
                taut,
                low,
                high,
                tensions[b],
            )
