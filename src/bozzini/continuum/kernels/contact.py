"""Numba kernels of walls: their distance made smooth, and what they do to a discrete rod.

The distance is a cubic B-spline through its values on a lattice, so that the kinks of a sampled
field, or of a duct that is pieced together, have a gradient and a curvature.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_matrix
from .loads import cross, fill_twists

SPLINE_NODES = 4
"""Nodes of the lattice that a place takes along each axis."""


@kernel
def weigh_nodes(points, step, values, distance, gradient, curvature):
    """Fill distance (m,), gradient (m, 3) and Hessian (m, 3, 3) of the spline of ``values``."""
    dim = points.shape[1]
    weights = np.empty((3, 3, SPLINE_NODES))
    distance[:] = 0.0
    gradient[:] = 0.0
    curvature[:] = 0.0
    orders = np.empty(3, dtype=np.int64)
    for row in range(points.shape[0]):
        for axis in range(dim):
            x = points[row, axis] / step
            u = x - math.floor(x)
            v = 1.0 - u
            weights[axis, 0, 0] = v**3 / 6.0
            weights[axis, 0, 1] = (3.0 * u**3 - 6.0 * u**2 + 4.0) / 6.0
            weights[axis, 0, 2] = (3.0 * v**3 - 6.0 * v**2 + 4.0) / 6.0
            weights[axis, 0, 3] = u**3 / 6.0
            weights[axis, 1, 0] = -0.5 * v**2 / step
            weights[axis, 1, 1] = (1.5 * u**2 - 2.0 * u) / step
            weights[axis, 1, 2] = (-1.5 * v**2 + 2.0 * v) / step
            weights[axis, 1, 3] = 0.5 * u**2 / step
            weights[axis, 2, 0] = v / step**2
            weights[axis, 2, 1] = (3.0 * u - 2.0) / step**2
            weights[axis, 2, 2] = (3.0 * v - 2.0) / step**2
            weights[axis, 2, 3] = u / step**2
        # Differences from one node keep the second derivatives free of round-off.
        first = values[row, 0]
        distance[row] = first
        for node in range(values.shape[1]):
            value = values[row, node] - first
            for i in range(-1, dim):
                for k in range(-1 if i < 0 else i, dim):
                    orders[:] = 0
                    if i >= 0:
                        orders[i] += 1
                    if k >= 0:
                        orders[k] += 1
                    rest, weight = node, value
                    for axis in range(dim):
                        weight *= weights[axis, orders[axis], rest % SPLINE_NODES]
                        rest //= SPLINE_NODES
                    if i < 0 and k < 0:
                        distance[row] += weight
                    elif i < 0:
                        gradient[row, k] += weight
                    else:
                        curvature[row, i, k] += weight
                        if k != i:
                            curvature[row, k, i] += weight


@kernel
def press_walls(touched, multipliers, compliances, width, pressed):
    """Fill the forces of walls on points, and how they change; returns their potential and error.

    ``touched`` are the walls (m,) and the points (m,) of the touches, gaps ``c`` (m,), and their
    gradient and curvature; ``multipliers`` the last forces ``f0`` and those that are expected (w,
    n) [N], ``compliances`` ``e`` of the wall and ``r`` of the penalty (n,) [mm/N], and ``width``
    the distance over which contact begins [mm]. ``pressed`` is filled: forces, stiffnesses (w, n)
    and slopes (w, n, 3), force and expected force on each point (n, 3), its stiffness without and
    with that of the penalty (n, 3, 3), and the least gap (n,).
    """
    rows, places, gaps, gradients, curvatures = touched
    last, expected = multipliers
    compliance, penalty = compliances
    forces, stiffnesses, gap_gradients, body, expected_body, bare, blocks, least_gap = pressed
    forces[:] = 0.0
    stiffnesses[:] = 0.0
    gap_gradients[:] = 0.0
    body[:] = 0.0
    expected_body[:] = 0.0
    bare[:] = 0.0
    blocks[:] = 0.0
    least_gap[:] = math.inf
    value, violation = 0.0, 0.0
    for m in range(gaps.size):
        row, point = rows[m], places[m]
        flexibility = compliance[point] + penalty[point]
        smoothing = width / flexibility
        unsmoothed = (penalty[point] * last[row, point] - gaps[m]) / flexibility
        root = math.sqrt(unsmoothed**2 + 4.0 * smoothing**2)
        force = (
            0.5 * (unsmoothed + root)
            if unsmoothed > 0.0
            else 2.0 * smoothing**2 / (root - unsmoothed)
        )
        expected_force = expected[row, point]
        # The stiffness of the contact about the force that is expected: primal-dual.
        stiffness = 1.0 / (
            flexibility + flexibility * (force - unsmoothed) / max(expected_force, 1e-300)
        )
        value += flexibility * (
            0.25 * (unsmoothed**2 + unsmoothed * root)
            + smoothing**2 * math.asinh(unsmoothed / (2.0 * smoothing))
        )
        violation = max(violation, abs(penalty[point] * (last[row, point] - force)))
        forces[row, point] = force
        stiffnesses[row, point] = stiffness
        least_gap[point] = min(least_gap[point], gaps[m])
        for i in range(3):
            gap_gradients[row, point, i] = gradients[m, i]
            body[point, i] += force * gradients[m, i]
            expected_body[point, i] += expected_force * gradients[m, i]
            for k in range(3):
                geometric = expected_force * curvatures[m, i, k]
                bare[point, i, k] -= geometric
                blocks[point, i, k] += stiffness * gradients[m, i] * gradients[m, k] - geometric
    return value, violation


@kernel
def add_contacts(grid, rotation_vectors, blocks, errors, gradient, hessian):
    """Add to gradient (n, 3) and Hessian (3 n, 3 n) what springs at the ends of segments do.

    ``blocks`` (n, 3, 3) are their stiffnesses and ``errors`` (n, 3) forces against the motion of
    the points. By sums over what lies beyond a segment, whose rotation moves it as one body.
    """
    n = rotation_vectors.shape[0]
    rotations, points = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    # How a rotation moves what is beyond the segment: motion of the origin, and rotation.
    moving, turning = np.empty((n, 3, 3)), np.empty((n, 3, 3))
    fill_twists(grid, rotation_vectors, rotations, points, turning, moving)
    twists = np.empty((n, 6, 3))
    for j in range(n):
        copy_matrix(moving[j], twists[j])
        copy_matrix(turning[j], twists[j, 3:])
    stiffness, wrench, lever, part = np.zeros((6, 6)), np.zeros(6), np.empty(3), np.zeros((3, 6))
    bent = np.empty((6, 3))
    for j in range(n - 1, -1, -1):
        x, y, z = points[j + 1]
        part[0, 0], part[1, 1], part[2, 2] = 1.0, 1.0, 1.0
        part[0, 4], part[0, 5] = z, -y
        part[1, 3], part[1, 5] = -z, x
        part[2, 3], part[2, 4] = y, -x
        cross(points[j + 1], errors[j], lever)
        for a in range(6):
            wrench[a] += errors[j, a] if a < 3 else lever[a - 3]
            for b in range(6):
                for i in range(3):
                    if part[i, a] != 0.0:
                        for k in range(3):
                            stiffness[a, b] += part[i, a] * blocks[j, i, k] * part[k, b]
        for c in range(3):
            for a in range(6):
                gradient[j, c] += twists[j, a, c] * wrench[a]
                bent[a, c] = 0.0
                for b in range(6):
                    bent[a, c] += stiffness[a, b] * twists[j, b, c]
        for m in range(j + 1):
            for a in range(3):
                for c in range(3):
                    total = 0.0
                    for b in range(6):
                        total += twists[m, b, a] * bent[b, c]
                    hessian[3 * m + a, 3 * j + c] += total
                    if m < j:
                        hessian[3 * j + c, 3 * m + a] += total
