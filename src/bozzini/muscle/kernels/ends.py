"""Numba kernels of the tapered ends: a trellis net over a wall, from the fitting to the cylinder.

Along a strand the net's angle is fixed by its radius (``sin = s0/rb0 r``: crossings do not slip),
so a point of the taper is given by its local stretch ``t``, the cylinder's at one end and 1 at the
fitting. With ``A = P pi r**2 + F`` and ``w = 2 pi c0 W`` the potential per strand length is
``w - A z'``, which has no explicit arc length; its first integral gives ``z'`` and ``r'``.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from .energy import (
    CONVERGED,
    MAX_ITERATIONS,
    STOPPED,
    braid_swell,
    find_force,
    find_stretch,
    wall_energy,
)

NODES, WEIGHTS = np.polynomial.legendre.leggauss(48)
FEW_NODES, FEW_WEIGHTS = np.polynomial.legendre.leggauss(5)

INTEGRATED_SPAN = 0.05
"""Change of stretch below which differences of energy are integrated, not subtracted."""

ROUND_OFF_STRETCH = 1e-13
"""Shortening that is round-off."""

LINEAR_SPAN = 1e-6
"""Change of stretch below which the taper is taken to first order."""

NO_TAPER = 4


@kernel
def cylinder_potential(design, pressure, load, stretch):
    """``A cos - w`` of a cylinder at a stretch, per strand length [N]; largest at equilibrium."""
    swell, _, _ = braid_swell(design, stretch)
    pull = pressure * math.pi * (swell + design[4]) + load * stretch
    return design[0] * (pull - 2.0 * math.pi * wall_energy(design, stretch, swell))


@kernel
def potential_drop(design, pressure, load, stretch, local):
    """By how much the cylinder's potential falls from ``stretch`` to ``local`` [N]."""
    span = local - stretch
    if span > INTEGRATED_SPAN:
        return cylinder_potential(design, pressure, load, stretch) - cylinder_potential(
            design, pressure, load, local
        )
    total = 0.0
    for k in range(FEW_NODES.size):
        point = stretch + 0.5 * span * (1.0 + FEW_NODES[k])
        pull, _, _, _ = find_force(design, pressure, point, 0.0)
        total += 0.5 * span * FEW_WEIGHTS[k] * (pull - load)
    return design[0] * total


@kernel
def measure_end(design, pressure, stretch):
    """One tapered end against the same strands on the cylinder.

    Returns by how much it is shorter [mm], holds less [mm^3] and has more potential [N mm], and a
    code. A muscle that is not shorter than at rest counts as a cylinder all along: its braid
    would have to widen towards the fittings.
    """
    if stretch >= 1.0 - ROUND_OFF_STRETCH:
        return 0.0, 0.0, 0.0, CONVERGED
    load, stiffness, contact, _ = find_force(design, pressure, stretch, 0.0)
    c0, s0, rb0 = design[0], design[1], design[2]
    area = math.pi * (rb0 / s0) ** 2
    square = (stretch * c0) ** 2
    # Smallest at the fitting, where the radius is.
    if contact <= 0.0 or pressure * math.pi * rb0 * rb0 + load <= 0.0:
        return 0.0, 0.0, 0.0, NO_TAPER
    span = 1.0 - stretch
    if span < LINEAR_SPAN:
        pull = pressure * area * (1.0 - square) + load
        return -span * c0 / math.sqrt(stiffness / (pull * stretch)), 0.0, 0.0, CONVERGED
    shorter = 0.0
    less = 0.0
    more = 0.0
    volume = area * (1.0 - square) * stretch * c0
    for k in range(NODES.size):
        local = stretch + 0.5 * span * (1.0 + NODES[k])
        square = (local * c0) ** 2
        cosine = local * c0
        section = area * (1.0 - square)
        pull = pressure * section + load
        drop = potential_drop(design, pressure, load, stretch, local)
        if drop <= 0.0:
            return 0.0, 0.0, 0.0, NO_TAPER
        total = pull * cosine + drop
        along = cosine * pull * cosine / total
        outward = cosine * math.sqrt(drop * (2.0 * pull * cosine + drop)) / total
        radius_slope = rb0 * c0 * cosine / (s0 * math.sqrt(1.0 - square))
        strand = 0.5 * span * WEIGHTS[k] * radius_slope / outward
        shorter += strand * (stretch * c0 - along)
        less += strand * (volume - section * along)
        more += strand * (drop + pull * (cosine - along))
    return shorter, less, more, CONVERGED


@kernel
def fill_ends(design, pressures, stretches, out):
    """Fill ``out`` (3, n) from `measure_end`; the code and index of the first that has none."""
    for n in range(stretches.size):
        shorter, less, more, code = measure_end(design, pressures[n], stretches[n])
        if code != CONVERGED:
            return code, n
        out[0, n] = shorter
        out[1, n] = less
        out[2, n] = more
    return CONVERGED, -1


@kernel
def find_ended_stretches(design, active, pressures, contractions, signs, stretches):
    """Fill the stretches of the cylinder at given contractions of a muscle with ends.

    Returns a code and the index of the first that has none, or that ran out of iterations.
    """
    for n in range(stretches.size):
        target = contractions[n]
        if target <= ROUND_OFF_STRETCH * active:
            stretches[n] = 1.0 - target / active
            continue
        low, code, _ = find_stretch(design, pressures[n], 0.0, signs[n])
        if code == STOPPED:
            return STOPPED, n
        if code != CONVERGED or low >= 1.0:
            return NO_TAPER, n
        high = 1.0
        stretch = max(low, 1.0 - target / active)
        miss = target
        settled = False
        for _ in range(MAX_ITERATIONS):
            shorter, _, _, code = measure_end(design, pressures[n], stretch)
            if code == CONVERGED:
                miss = active * (1.0 - stretch) + 2.0 * shorter - target
                following = stretch + miss / active
            else:  # too short for a taper
                miss = target
                following = 2.0
            if miss > 0.0:
                low = stretch
            else:
                high = stretch
            if not low <= following <= high:
                following = 0.5 * (low + high)
            if abs(following - stretch) <= 1e-15:
                settled = True
                break
            stretch = following
        if not settled:
            return STOPPED, n
        if abs(miss) > 1e-12 * active:
            return NO_TAPER, n
        stretches[n] = stretch
    return CONVERGED, -1
