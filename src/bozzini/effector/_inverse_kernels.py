"""Numba kernels of the inverse: the two muscles of a target, and a muscle's pressure.

For a target, muscles come in the order of their angles. ``cosines`` and ``sines`` are those of the
angles, ``covered[k]`` says whether muscles ``k`` and ``k + 1`` (the last and the first) are less
than half a turn apart, and ``amplitudes`` are the largest displacements [mm]. Kinds and rows of
numbers of a muscle are those of `_equilibrium_kernels`.
"""

from __future__ import annotations

import math

from numba import njit

from ..muscle._kernels import braid_swell, find_force, swell_terms
from ..muscle._thesis_kernels import measure_closure
from ._equilibrium_kernels import BLIND, ENERGY, OTHER, _free_contraction, _row
from ._linkage_kernels import find_contraction, measure_lateral

__all__ = [
    "LIMITED",
    "OUTSIDE",
    "PEAK",
    "REACHED",
    "find_energy_pressure",
    "find_pressure",
    "find_sector",
    "find_thesis_pressure",
    "measure_left_over",
    "place_displacements",
    "solve_pressures",
    "split_target",
    "split_targets",
]

REACHED, LIMITED, PEAK, OUTSIDE = 0, 1, 2, 3
"""Whole target; cut by a muscle's amplitude; by the largest deflection; a direction in a gap."""

ANGLE_SLACK = 1e-12
"""By how much a target may lie outside a sector [rad]: round-off of a target on an edge."""

SHARE_SLACK = 1e-12
"""Share of a target that may be cut off before it counts as not reached: round-off."""

SMALL = 1e-6
"""Share of a contraction by which it may be off for a miss to be taken to first order."""

MAX_ITERATIONS = 200


@njit(cache=True)
def find_sector(cosines, sines, covered, x, y):
    """The sector of a target that is not zero; -1 if none, and then a muscle along it or -1."""
    count = cosines.size
    slack = ANGLE_SLACK * math.hypot(x, y)
    for k in range(count):
        if covered[k]:
            j = (k + 1) % count
            first = x * sines[j] - y * cosines[j]
            second = y * cosines[k] - x * sines[k]
            if min(first, second) >= -slack:
                return k, -1
    for k in range(count):
        along = x * cosines[k] + y * sines[k]
        if along > 0.0 and abs(y * cosines[k] - x * sines[k]) <= slack:
            return -1, k
    return -1, -1


@njit(cache=True)
def split_target(cosines, sines, covered, amplitudes, peak, x, y, displacements):
    """Fill the displacements (m,) of a target; the muscles, the share delivered and a code.

    Eq. (4.13) for the two muscles of the sector, and
    ``t = min(1, A_i / a_i, A_j / a_j, peak / |v|)`` for (4.15) and (4.16).
    """
    count = cosines.size
    for k in range(count):
        displacements[k] = 0.0
    if x == 0.0 and y == 0.0:
        return -1, -1, 1.0, REACHED
    sector, alone = find_sector(cosines, sines, covered, x, y)
    size = math.hypot(x, y)
    i, j = alone, -1
    first, second = size, 0.0
    if sector >= 0:
        i, j = sector, (sector + 1) % count
        sine = cosines[i] * sines[j] - sines[i] * cosines[j]
        first = max(0.0, (x * sines[j] - y * cosines[j]) / sine)
        second = max(0.0, (y * cosines[i] - x * sines[i]) / sine)
    elif alone < 0:
        return -1, -1, 0.0, OUTSIDE
    share = 1.0
    code = REACHED
    if first > amplitudes[i]:
        share = amplitudes[i] / first
    if j >= 0 and second > amplitudes[j]:
        share = min(share, amplitudes[j] / second)
    if share < 1.0 - SHARE_SLACK:
        code = LIMITED
    # A muscle that could go on past the largest deflection has that as its amplitude.
    if size * share >= peak * (1.0 - SHARE_SLACK):
        share = min(share, peak / size)
        if share < 1.0 - SHARE_SLACK:
            code = PEAK
    displacements[i] = min(share * first, amplitudes[i])
    if j >= 0:
        displacements[j] = min(share * second, amplitudes[j])
    return i, j, share, code


@njit(cache=True)
def split_targets(
    order, cosines, sines, covered, amplitudes, peak, targets, displacements, pair, share, code
):
    """`split_target` of a batch; displacements (n, m) and pair (n, 2) in the design's order."""
    row = cosines * 0.0
    for n in range(targets.shape[0]):
        i, j, share[n], code[n] = split_target(
            cosines, sines, covered, amplitudes, peak, targets[n, 0], targets[n, 1], row
        )
        for k in range(order.size):
            displacements[n, order[k]] = row[k]
        pair[n, 0] = order[i] if i >= 0 else -1
        pair[n, 1] = order[j] if j >= 0 else -1


@njit(cache=True)
def find_energy_pressure(design, stretch, pull):
    """The pressure at which a braided tube in contact pulls so at a stretch; and that of contact.

    At a given stretch the pull is linear in the pressure between tube and braid. A contact pressure
    that is not positive is no answer. ``design`` is that of `muscle._kernels`; no friction.
    """
    first, second = design[6], design[7]
    wall = design[4] - design[3]
    swell, braid_slope, _ = braid_swell(design, stretch)
    f, slope, _ = swell_terms(design, swell)
    inverse = 1.0 / stretch
    square = inverse * inverse
    w_z = wall * (first * stretch - second * square * inverse) + (second - first * square) * f
    if not braid_slope < 0.0:  # the braid is locked: no pressure makes it contract further
        return math.inf, math.inf
    contact = (2.0 * math.pi * w_z - pull) / (math.pi * braid_slope)
    return contact + 2.0 * (first * inverse + second * stretch) * slope, contact


@njit(cache=True)
def find_thesis_pressure(design, contact, free, length, limit):
    """The pressure in [contact, limit] at which the thesis's muscle contracts so without load.

    The closure falls with the pressure at a given angle: Anderson and Bjoerck's regula falsi. At a
    contraction that the limit does not give, the limit. Returns the iterations too.
    """
    angle = math.acos((length - free) * design[6] / design[4])
    left, right = 0.0, limit - contact
    miss_left, _, _ = measure_closure(design, left, angle)
    miss_right, _, _ = measure_closure(design, right, angle)
    if not miss_right < 0.0:
        return limit, 1
    if not miss_left > 0.0:
        return contact, 1
    last = right
    for iteration in range(1, MAX_ITERATIONS):
        middle = (left * miss_right - right * miss_left) / (miss_right - miss_left)
        if iteration % 16 == 0 or not left < middle < right:
            middle = 0.5 * (left + right)
        miss, _, _ = measure_closure(design, middle, angle)
        if miss == 0.0 or min(right - left, abs(middle - last)) <= 4e-16 * right:
            return contact + middle, iteration
        last = middle
        if miss < 0.0:
            scale = 1.0 - miss / miss_right
            miss_left *= scale if scale > 0.0 else 0.5
            right, miss_right = middle, miss
        else:
            scale = 1.0 - miss / miss_left
            miss_right *= scale if scale > 0.0 else 0.5
            left, miss_left = middle, miss
    return contact + 0.5 * (left + right), MAX_ITERATIONS


@njit(cache=True)
def find_pressure(kind, numbers, contraction, force, limit):
    """The pressure of a muscle that pulls so at a contraction, at most the limit; iterations."""
    design = _row(numbers)
    if kind == ENERGY:
        pressure, _ = find_energy_pressure(design, 1.0 - contraction / numbers[11], force)
        return min(pressure, limit), 0
    free = contraction if kind == BLIND else contraction + force / numbers[16]
    return find_thesis_pressure(design, numbers[11], free, numbers[12], limit)


@njit(cache=True)
def place_displacements(linkage, top, displacements, contractions, residuals, iterations):
    """Fill the contractions (n, m) of displacements, what is left over [mm] and iterations (n,)."""
    highest, _, _ = measure_lateral(linkage, top)
    for n in range(displacements.shape[0]):
        residuals[n] = 0.0
        iterations[n] = 0
        for k in range(displacements.shape[1]):
            wanted = displacements[n, k]
            contractions[n, k] = 0.0
            if wanted >= highest:
                # Where the linkage ends its slope is endless: no step comes as near as this.
                contractions[n, k] = top
                residuals[n] = max(residuals[n], wanted - highest)
            elif wanted > 0.0:
                # The deflection grows about with the square of the contraction.
                start = 0.8 * top * math.sqrt(wanted / highest)
                contractions[n, k], steps = find_contraction(linkage, wanted, top, start)
                iterations[n] += steps
                reached, _, failed = measure_lateral(linkage, contractions[n, k])
                miss = abs(reached - wanted) if failed == 0 else wanted
                residuals[n] = max(residuals[n], miss)


@njit(cache=True)
def measure_left_over(kind, numbers, linkage, compliance, displacement, contraction, pressure):
    """By how much a muscle then misses its displacement, to first order [mm].

    What is left over of its pull, through the compliance, less what the muscle gives way; all of
    it where the contraction would change by no small part, and first order means nothing.
    """
    _, slope, _ = measure_lateral(linkage, contraction)
    if kind == BLIND:
        off = _free_contraction(numbers, pressure)[0] - contraction
        small = abs(off) <= SMALL * contraction
        return off * (max(slope, 0.0) if small else displacement / contraction)
    if kind == ENERGY:
        stretch = 1.0 - contraction / numbers[11]
        pull, steep, _, _ = find_force(_row(numbers), pressure, stretch, 0.0)
        stiffness = steep / numbers[11]
    else:
        free, _ = _free_contraction(numbers, pressure)
        stiffness = numbers[16]
        pull = stiffness * (free - contraction)
    miss = compliance * pull - displacement
    give = max(slope, 0.0) + compliance * max(stiffness, 0.0)
    if not abs(miss) <= SMALL * give * contraction:
        return miss
    return miss * max(slope, 0.0) / give


@njit(cache=True)
def solve_pressures(
    kinds,
    rows,
    linkage,
    compliance,
    limit,
    displacements,
    contractions,
    pressures,
    residuals,
    iterations,
):
    """Fill the pressures (n, m) of muscles with a kernel; 0 MPa where there is no displacement.

    Residuals (n,) become the largest miss, by the muscles' equations too [mm].
    """
    for k in range(kinds.size):
        if kinds[k] == OTHER:
            continue
        kind, numbers = kinds[k], rows[k]
        for n in range(displacements.shape[0]):
            pressures[n, k] = 0.0
            wanted = displacements[n, k]
            if wanted > 0.0:
                x = contractions[n, k]
                pressure, steps = find_pressure(kind, numbers, x, wanted / compliance, limit)
                left = measure_left_over(kind, numbers, linkage, compliance, wanted, x, pressure)
                pressures[n, k] = pressure
                residuals[n] = max(residuals[n], abs(left))
                iterations[n] += steps
