"""Numba kernels of the inverse: the two muscles of a target, and a muscle's pressure.

For a target, muscles come in the order of their angles. ``cosines`` and ``sines`` are those of the
angles, ``covered[k]`` is whether muscles ``k`` and ``k + 1`` (the last and the first) are less
than half a turn apart, and ``amplitudes`` are the largest displacements [mm]. Functions and
rows of numbers of a muscle are those of `balance`.
"""

from __future__ import annotations

import math

import numpy as np

from ...muscle.kernels import interface
from ...muscle.kernels.interface import call_pressure, call_pull, call_start
from ...numeric.compiling import kernel
from .linkage import find_contraction, measure_lateral

REACHED, LIMITED, PEAK, OUTSIDE = 0, 1, 2, 3
"""Whole target; cut by a muscle's amplitude; by the largest deflection; a direction in a gap."""

ANGLE_SLACK = 1e-12
"""By how much a target may lie outside a sector [rad]: round-off of a target on an edge."""

SHARE_SLACK = 1e-12
"""Share of a target that may be cut off before it counts as not reached: round-off."""

FIRST_ORDER_SHARE = 1e-6
"""Share of a contraction by which it may be off for a miss to be taken to first order."""

_RIGID = interface.RIGID


@kernel
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


@kernel
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


@kernel
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


@kernel
def place_displacement(linkage, top, highest, wanted):
    """Contraction of a displacement, what is left over [mm] and iterations."""
    if wanted >= highest:
        # Where the linkage ends its slope is endless: no step comes as near as this.
        return top, wanted - highest, 0
    if not wanted > 0.0:
        return 0.0, 0.0, 0
    # The deflection grows about with the square of the contraction.
    start = 0.8 * top * math.sqrt(wanted / highest)
    contraction, steps = find_contraction(linkage, wanted, top, start)
    reached, _, failed = measure_lateral(linkage, contraction)
    return contraction, abs(reached - wanted) if failed == 0 else wanted, steps


@kernel
def place_displacements(linkage, top, displacements, contractions, residuals, iterations):
    """Fill the contractions (n, m) of displacements, what is left over [mm] and iterations (n,)."""
    highest, _, _ = measure_lateral(linkage, top)
    for n in range(displacements.shape[0]):
        residuals[n] = 0.0
        iterations[n] = 0
        for k in range(displacements.shape[1]):
            contractions[n, k], miss, steps = place_displacement(
                linkage, top, highest, displacements[n, k]
            )
            iterations[n] += steps
            residuals[n] = max(residuals[n], miss)


@kernel
def measure_left_over(
    start, pull, numbers, linkage, compliance, displacement, contraction, pressure, out
):
    """By how much a muscle then misses its displacement, to first order [mm].

    What is left over of its pull, through the compliance, less what the muscle gives way; all of
    it where the contraction would change by no small part, and first order means nothing.
    """
    row, results = numbers.ctypes.data, out.ctypes.data
    _, slope, _ = measure_lateral(linkage, contraction)
    kind = call_start(start, row, pressure, contraction, results)
    state = out[0]
    if kind == _RIGID:
        off = state - contraction
        small = abs(off) <= FIRST_ORDER_SHARE * contraction
        return off * (max(slope, 0.0) if small else displacement / contraction)
    call_pull(pull, row, state, pressure, contraction, results)
    miss = compliance * out[0] - displacement
    give = max(slope, 0.0) + compliance * max(-out[1], 0.0)
    if not abs(miss) <= FIRST_ORDER_SHARE * give * contraction:
        return miss
    return miss * max(slope, 0.0) / give


@kernel
def solve_pressure(addresses, numbers, linkage, compliance, limit, displacement, contraction, out):
    """The pressure of a muscle with a kernel, by how much it then misses [mm], and iterations.

    ``addresses`` (3,) are those of its functions, ``out`` (3,) is overwritten.
    """
    steps = call_pressure(
        addresses[2],
        numbers.ctypes.data,
        contraction,
        displacement / compliance,
        limit,
        out.ctypes.data,
    )
    pressure = out[0]
    left = measure_left_over(
        addresses[0],
        addresses[1],
        numbers,
        linkage,
        compliance,
        displacement,
        contraction,
        pressure,
        out,
    )
    left = abs(left)
    return pressure, left if left < math.inf else math.inf, steps


@kernel
def solve_pressures(
    functions,
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
    work = np.empty(3)
    for k in range(functions.shape[0]):
        if functions[k, 0] == 0:
            continue
        for n in range(displacements.shape[0]):
            pressures[n, k] = 0.0
            wanted = displacements[n, k]
            if wanted > 0.0:
                pressures[n, k], left, steps = solve_pressure(
                    functions[k],
                    rows[k],
                    linkage,
                    compliance,
                    limit,
                    wanted,
                    contractions[n, k],
                    work,
                )
                residuals[n] = max(residuals[n], left)
                iterations[n] += steps
