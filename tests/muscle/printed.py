"""The thesis's system as it is printed (with its errata), for SciPy's fsolve; mm, N, MPa."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from bozzini.muscle import Muscle


def constants(lame, inner, outer, radii):
    """(3.3), P_o with the sign that meets the boundary: functions of P_i, P_o and P_s."""
    first, second = lame
    r_i, r_o = radii
    p_i, p_o, p_s = inner, outer[0], outer[1]
    wall = r_o**2 - r_i**2
    bulk = second * (3.0 * first + 2.0 * second)
    c1 = (
        (first + 2.0 * second)
        / (2.0 * bulk)
        * (p_i * r_i**2 / wall - p_o * r_o**2 / wall - p_s * first / (first + 2.0 * second))
    )
    c2 = r_i**2 * r_o**2 / wall * (p_i - p_o) / (2.0 * second)
    c3 = (
        first / bulk * (-p_i * r_i**2 / wall + p_o * r_o**2 / wall + p_s * (first + second) / first)
    )
    return c1, c2, c3


def solve_printed(
    muscle: Muscle, pressure: float, fsolve: Callable[..., Any]
) -> tuple[float, float, float]:
    """Contact pressure (3.12), contraction at a higher pressure, and the largest residual.

    The unknowns of the second phase are c1, c2, c3, the angle and the axial stress P_s, in which
    the thesis's F_u ends up; P_o is that of (3.23), from (3.17), (3.21) and (3.22).
    """
    lame = muscle.tube.lame_constants
    r_i, r_o, length = muscle.inner_radius, muscle.outer_radius, muscle.length
    r_b = r_o + muscle.gap
    start = muscle.braid_angle

    def inflection(p):
        share = p[0] * r_i**2 / (r_o**2 - r_i**2)
        c1, c2, c3 = constants(lame, p[0], (0.0, share), (r_i, r_o))
        braid = np.sqrt(1.0 - (math.cos(start) * (1.0 + c3)) ** 2) / math.sin(start)
        return [1e3 * (c1 * r_o + c2 / r_o - muscle.gap - r_b * (braid - 1.0))]

    contact = float(fsolve(inflection, [0.05], xtol=1e-12)[0])
    share = contact * r_i**2 / (r_o**2 - r_i**2)
    c1, c2, c3 = constants(lame, contact, (0.0, share), (r_i, r_o))
    inner, outer = r_i + c1 * r_i + c2 / r_i, r_o + c1 * r_o + c2 / r_o
    reset = length * (1.0 + c3)
    angle = math.acos(reset / length * math.cos(start))
    excess = pressure - contact
    nylon = muscle.strands * math.pi * muscle.strand_radius**2 * muscle.strand_modulus
    silicone = math.cos(start) * math.pi * (r_o**2 - r_i**2) * muscle.modulus
    least = 0.5 * math.asin(muscle.strand_radius * muscle.strands / (math.pi * r_o))
    touched = (math.sin(least) * math.cos(least)) ** 2
    end = muscle.end_length

    def braid_pressure(c1, c2, c3, theta):
        bore = inner + c1 * inner + c2 / inner
        pull = nylon / (nylon + silicone) * math.pi * bore**2 * excess
        radial = pull * reset / outer * np.tan(theta) * math.tan(angle)
        radius = outer * np.sin(theta) / math.sin(angle)
        share = touched / (np.sin(theta) * np.cos(theta)) ** 2
        area = share * 2.0 * math.pi * radius * (reset - 2.0 * end) * (1.0 + c3)
        return radial / (area + 2.0 * math.pi * (outer + radius) * end * (1.0 + c3))

    def system(x):
        c1, c2, c3, theta, p_s = x
        outside = braid_pressure(c1, c2, c3, theta)
        k1, k2, k3 = constants(lame, excess, (outside, p_s), (inner, outer))
        return [
            c1 - k1,
            c2 - k2,
            c3 - k3,
            c1 + c2 / outer**2 - (np.sin(theta) / math.sin(angle) - 1.0),
            c3 - (np.cos(theta) / math.cos(angle) - 1.0),
        ]

    # From zero the contact area is not defined; the angle begins where the braid is.
    found, _, _, _ = fsolve(system, [0.0, 0.0, 0.0, angle, 0.0], xtol=1e-12, full_output=True)
    residual = float(np.abs(system(found)).max())
    return contact, length - reset * (1.0 + found[2]), residual
