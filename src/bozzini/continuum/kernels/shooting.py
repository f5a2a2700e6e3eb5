"""Numba kernels of multiple shooting: defects of a rod cut into pieces, and their derivatives.

Unknowns ``x``, in this order: moment at the base, and force if loads turn with the body; then for
the start of every further piece a rotation about base axes, moment, and force likewise. Defects
``d``: at the end of every piece the rotation from the next one's start to what was integrated,
moment less the next one's, force likewise; beyond the load on the tip moment, and force likewise,
which must be 0. Both are n = 6 p - 3 or 9 p - 3 for p pieces; rotations in rad, moments in units of
`Rod.unit`, forces of that by the length. The place has no defect: no law depends on it, and each
piece begins where the one before ends. Equations and method are those of `rod_solver`; derivatives
are carried along by `integrate_rod`.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.rotations import find_turn, turn_quaternion
from .rod import BY_LENGTHS, FORCE, MOMENT, QUATERNION, integrate_rod

NO_SECTIONS = (np.zeros(0, dtype=np.int64), 0)


@kernel(error_model="numpy")
def sum_forces(rod, load_factor, base_state):
    """Set a state's force to the sum of all loads, by Simpson's rule; of those of one direction."""
    places = rod[0][0]
    lines, points, _ = rod[1]
    for i in range(3):
        total = 0.0
        for n in range(places.size - 1):
            h = places[n + 1] - places[n]
            whole = lines[n, 0, 0, i] + 4.0 * lines[n, 1, 0, i] + lines[n, 2, 0, i]
            total += h / 6.0 * whole + points[n + 1, 0, i]
        base_state[FORCE + i] = load_factor * total


@kernel(error_model="numpy")
def shoot(rod, cuts, unit, load_factor, variables, defects, system, form):
    """Pass through all pieces: fills the ``defects`` (n,), and derivatives unless form is empty.

    ``variables`` are tensions (k,), quaternions (p, 4), moments and forces (p, 3) at the pieces'
    starts, and states at all places; ``system`` the matrix (n, n), derivatives by tension (n, k)
    and lengths' by unknowns (k, n) and tensions (k, k). Moments are in units of ``unit``, forces of
    that by the rod's length. Returns the largest defect over 1 + the largest moment; or infinity.
    """
    tensions, quaternions, moments, forces, states = variables
    matrix, defect_by_tension, length_by_variable, length_by_tension = system
    pieces, k = len(quaternions), tensions.size
    free = 6 if defects.size == 6 * pieces - 3 else 9
    length = rod[0][0][-1]
    wants = len(form[0]) > 0
    owners = np.zeros(0, dtype=np.int64)
    none = owners, owners.size
    sensitivities = np.zeros((BY_LENGTHS + k, free + k) if wants else (0, 0))
    rotation = np.empty(3)
    scales = np.ones(9)
    for i in range(3):
        scales[3 + i] = unit
        scales[6 + i] = unit / length
    if wants:
        matrix[:] = 0.0
        length_by_tension[:] = 0.0
    if free == 6:
        sum_forces(rod, load_factor, states[0])
    for piece in range(pieces):
        first, last = cuts[piece], cuts[piece + 1]
        for i in range(4):
            states[first, QUATERNION + i] = quaternions[piece, i]
        for i in range(3):
            states[first, MOMENT + i] = moments[piece, i]
            if free == 9:
                states[first, FORCE + i] = forces[piece, i]
        if wants:
            sensitivities[:] = 0.0
            for i in range(free):
                sensitivities[i, i] = 1.0
        if not integrate_rod(
            first, last, rod, load_factor, tensions, states, sensitivities, none, form
        ):
            return math.inf
        final = piece == pieces - 1
        top, low = free * piece, (3 if final else 0)
        if not final:
            find_turn(quaternions[piece + 1], states[last, QUATERNION:FORCE], rotation)
            w, x, y, z = quaternions[piece + 1]
            # The rotation between them in base axes: turned by that of the piece's start.
            for i in range(3):
                defects[top + i] = 0.0
            rotate(w, x, y, z, rotation, defects[top : top + 3])
        for i in range(3):
            defects[top + 3 - low + i] = states[last, MOMENT + i]
            if not final:
                defects[top + 3 + i] -= moments[piece + 1, i]
            defects[top + 3 - low + i] /= scales[3]
            if free == 9:
                defects[top + 6 - low + i] = states[last, FORCE + i]
                if not final:
                    defects[top + 6 + i] -= forces[piece + 1, i]
                defects[top + 6 - low + i] /= scales[6]
        if not wants:
            continue
        begin = 3 if piece == 0 else 0
        for r in range(low, free):
            for c in range(begin, free):
                matrix[top - low + r, top - 3 + c] = sensitivities[r, c] * scales[c] / scales[r]
            for m in range(k):
                defect_by_tension[top - low + r, m] = sensitivities[r, free + m] / scales[r]
            if not final:
                matrix[top + r, top + free - 3 + r] -= 1.0
        for m in range(k):
            for c in range(begin, free):
                length_by_variable[m, top - 3 + c] = sensitivities[BY_LENGTHS + m, c] * scales[c]
            for j in range(k):
                length_by_tension[m, j] += sensitivities[BY_LENGTHS + m, free + j]
    largest_defect, largest_moment = 0.0, 0.0
    for i in range(defects.size):
        if not math.isfinite(defects[i]):
            return math.inf
        largest_defect = max(largest_defect, abs(defects[i]))
    for piece in range(pieces):
        for i in range(3):
            largest_moment = max(largest_moment, abs(moments[piece, i]))
    return largest_defect / (1.0 + largest_moment / unit)


@kernel(error_model="numpy")
def rotate(w, x, y, z, vector, out):
    """Fill ``out`` (3,) with a vector turned by a unit quaternion."""
    a, b, c = vector[0], vector[1], vector[2]
    p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    out[0] = a + w * p + y * r - z * q
    out[1] = b + w * q + z * p - x * r
    out[2] = c + w * r + x * q - y * p


@kernel(error_model="numpy")
def move(variables, unit, length, step, damping):
    """Take part of a step (n,) of the unknowns."""
    _, quaternions, moments, forces, _ = variables
    pieces = len(quaternions)
    free = 6 if step.size == 6 * pieces - 3 else 9
    rotation, body_rotation, out = np.empty(3), np.empty(3), np.empty(4)
    for piece in range(pieces):
        at = free * piece - 3
        if piece > 0:
            w, x, y, z = quaternions[piece]
            for i in range(3):
                rotation[i] = damping * step[at + i]
            rotate(w, -x, -y, -z, rotation, body_rotation)
            turn_quaternion(quaternions[piece], body_rotation, out)
            size = math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
            for i in range(4):
                quaternions[piece, i] = out[i] / size
        for i in range(3):
            moments[piece, i] += damping * unit * step[at + 3 + i]
            if free == 9:
                forces[piece, i] += damping * unit / length * step[at + 6 + i]
