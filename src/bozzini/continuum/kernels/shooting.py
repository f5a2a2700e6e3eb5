"""Numba kernels of multiple shooting: a rod under loads, its tendons, and the way to a command.

Unknowns are the moment at the base, then turn and moment at the start of every further piece; with
loads that turn with the body the forces too. Each step of Newton's method solves for them as
functions of the tensions, and for the tensions by the lengths that are asked for. Derivatives are
those of `integrate_rod`. Commands and loads are raised together, on few steps, and the last
solution is improved on all steps with the derivatives of the few.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.rotations import find_turn, turn_quaternion
from .rod import BY_LENGTHS, FORCE, MOMENT, TURN, integrate_rod

NO_SECTIONS = (np.zeros(0, dtype=np.int64), 0)


@kernel(error_model="numpy")
def sum_forces(rod, share, state):
    """Set a state's force to that which the loads put on the base; of those of one direction."""
    places = rod[0][0]
    lines, points, _ = rod[1]
    for i in range(3):
        total = 0.0
        for n in range(places.size - 1):
            h = places[n + 1] - places[n]
            whole = lines[n, 0, 0, i] + 4.0 * lines[n, 1, 0, i] + lines[n, 2, 0, i]
            total += h / 6.0 * whole + points[n + 1, 0, i]
        state[FORCE + i] = share * total


@kernel(error_model="numpy")
def shoot(rod, cuts, unit, share, state, jumps, system, form):
    """Pass through all pieces: fills the ``jumps`` (n,), and derivatives unless form is empty.

    ``state`` are tensions (k,), quaternions (p, 4), moments and forces (p, 3) at the pieces'
    starts, and states at all places; ``system`` the matrix (n, n), derivatives by tension (n, k)
    and lengths' by unknowns (k, n) and tensions (k, k). Moments are in units of ``unit``, forces of
    that by the rod's length. Returns the largest jump, by 1 and the largest moment; or infinity.
    """
    tensions, turns, moments, forces, states = state
    matrix, by_tension, by_unknown, by_pull = system
    pieces, k = len(turns), tensions.size
    free = 6 if jumps.size == 6 * pieces - 3 else 9
    length = rod[0][0][-1]
    wants = len(form[0]) > 0
    owners = np.zeros(0, dtype=np.int64)
    none = owners, owners.size
    slopes = np.zeros((BY_LENGTHS + k, free + k) if wants else (0, 0))
    turn = np.empty(3)
    sizes = np.ones(9)
    for i in range(3):
        sizes[3 + i] = unit
        sizes[6 + i] = unit / length
    if wants:
        matrix[:] = 0.0
        by_pull[:] = 0.0
    if free == 6:
        sum_forces(rod, share, states[0])
    for piece in range(pieces):
        first, last = cuts[piece], cuts[piece + 1]
        for i in range(4):
            states[first, TURN + i] = turns[piece, i]
        for i in range(3):
            states[first, MOMENT + i] = moments[piece, i]
            if free == 9:
                states[first, FORCE + i] = forces[piece, i]
        if wants:
            slopes[:] = 0.0
            for i in range(free):
                slopes[i, i] = 1.0
        if not integrate_rod(first, last, rod, share, tensions, states, slopes, none, form):
            return math.inf
        final = piece == pieces - 1
        top, low = free * piece, (3 if final else 0)
        if not final:
            find_turn(turns[piece + 1], states[last, TURN:FORCE], turn)
            w, x, y, z = turns[piece + 1]
            # The rotation between them in base axes: turned by that of the piece's start.
            for i in range(3):
                jumps[top + i] = 0.0
            rotate(w, x, y, z, turn, jumps[top : top + 3])
        for i in range(3):
            jumps[top + 3 - low + i] = states[last, MOMENT + i]
            if not final:
                jumps[top + 3 + i] -= moments[piece + 1, i]
            jumps[top + 3 - low + i] /= sizes[3]
            if free == 9:
                jumps[top + 6 - low + i] = states[last, FORCE + i]
                if not final:
                    jumps[top + 6 + i] -= forces[piece + 1, i]
                jumps[top + 6 - low + i] /= sizes[6]
        if not wants:
            continue
        begin = 3 if piece == 0 else 0
        for r in range(low, free):
            for c in range(begin, free):
                matrix[top - low + r, top - 3 + c] = slopes[r, c] * sizes[c] / sizes[r]
            for m in range(k):
                by_tension[top - low + r, m] = slopes[r, free + m] / sizes[r]
            if not final:
                matrix[top + r, top + free - 3 + r] -= 1.0
        for m in range(k):
            for c in range(begin, free):
                by_unknown[m, top - 3 + c] = slopes[BY_LENGTHS + m, c] * sizes[c]
            for j in range(k):
                by_pull[m, j] += slopes[BY_LENGTHS + m, free + j]
    off, whole = 0.0, 0.0
    for i in range(jumps.size):
        if not math.isfinite(jumps[i]):
            return math.inf
        off = max(off, abs(jumps[i]))
    for piece in range(pieces):
        for i in range(3):
            whole = max(whole, abs(moments[piece, i]))
    return off / (1.0 + whole / unit)


@kernel(error_model="numpy")
def rotate(w, x, y, z, vector, out):
    """Fill ``out`` (3,) with a vector turned by a unit quaternion."""
    a, b, c = vector[0], vector[1], vector[2]
    p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    out[0] = a + w * p + y * r - z * q
    out[1] = b + w * q + z * p - x * r
    out[2] = c + w * r + x * q - y * p


@kernel(error_model="numpy")
def move(state, unit, length, step, part):
    """Take part of a step (n,) of the unknowns."""
    _, turns, moments, forces, _ = state
    pieces = len(turns)
    free = 6 if step.size == 6 * pieces - 3 else 9
    turn, body, out = np.empty(3), np.empty(3), np.empty(4)
    for piece in range(pieces):
        at = free * piece - 3
        if piece > 0:
            w, x, y, z = turns[piece]
            for i in range(3):
                turn[i] = part * step[at + i]
            rotate(w, -x, -y, -z, turn, body)
            turn_quaternion(turns[piece], body, out)
            size = math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
            for i in range(4):
                turns[piece, i] = out[i] / size
        for i in range(3):
            moments[piece, i] += part * unit * step[at + 3 + i]
            if free == 9:
                forces[piece, i] += part * unit / length * step[at + 6 + i]
