"""Numba kernels: what a sweep states of a design, for many designs at once.

The same equations as `find_reach`, `workspace` and `find_needed_pressure`, of muscles by
`bozzini.muscle.kernels.energy`.
"""

from __future__ import annotations

import math

import numpy as np

from ...muscle.kernels.energy import pack_design
from ...numeric.compiling import kernel
from .balance import NO_ANSWER, find_balance
from .inverse import place_displacement, solve_pressure, split_target
from .linkage import find_end, find_top, measure_lateral

FEASIBLE, NOT_BUILT, ABOVE_LIMIT, UNREACHED, BEYOND_PEAK, NO_MODEL_ANSWER = 0, 1, 2, 3, 4, 5
"""Works; no legal design; needs more than its pressure limit; no pressure reaches the deflection;
the backbone does not deflect so far; the model has no answer at the pressure limit"""

DIRECTIONS = 12
"""Directions in which the boundary is looked for, besides those of its corners."""


@kernel
def find_corners(cosines, sines, covered, amplitudes, corners):
    """Fill the corner of each sector (m, 2)."""
    count = cosines.size
    for k in range(count):
        j = (k + 1) % count
        share = 1.0 if covered[k] else 0.0
        corners[k, 0] = amplitudes[k] * cosines[k] + share * (amplitudes[j] * cosines[j])
        corners[k, 1] = amplitudes[k] * sines[k] + share * (amplitudes[j] * sines[j])


@kernel
def fill_directions(cosines, sines, corners, directions):
    """Fill unit vectors (3, ...) of muscles, corners and a circle, by angle; how many there are.

    The third row is the angle.
    """
    count = cosines.size
    total = 0
    for k in range(2 * count + DIRECTIONS):
        if k < count:
            x, y = cosines[k], sines[k]
        elif k < 2 * count:
            x, y = corners[k - count, 0], corners[k - count, 1]
            size = math.hypot(x, y)
            if not size > 0.0:
                continue
            x, y = x / size, y / size
        else:
            angle = (k - 2 * count) * (2.0 * math.pi / DIRECTIONS)
            x, y = math.cos(angle), math.sin(angle)
        angle = math.atan2(y, x) % (2.0 * math.pi)
        place = total
        while place > 0 and directions[2, place - 1] > angle:
            for row in range(3):
                directions[row, place] = directions[row, place - 1]
            place -= 1
        directions[0, place] = x
        directions[1, place] = y
        directions[2, place] = angle
        total += 1
    return total


@kernel
def fill_boundary(cosines, sines, covered, amplitudes, peak, directions, boundary):
    """Fill the corners (2, ...) of the boundary, none like the one before; their number."""
    count = cosines.size
    corners = np.empty((count, 2))
    displacements = np.empty(count)
    find_corners(cosines, sines, covered, amplitudes, corners)
    total = fill_directions(cosines, sines, corners, directions)
    far = 0.0
    for k in range(count):
        far += amplitudes[k]
    far = 2.0 * (far + peak)
    slack = 1e-9 * far
    for k in range(total):
        x, y = far * directions[0, k], far * directions[1, k]
        _, _, share, _ = split_target(
            cosines, sines, covered, amplitudes, peak, x, y, displacements
        )
        directions[0, k] = share * x
        directions[1, k] = share * y
    kept = 0
    for k in range(total):
        before = k - 1 if k > 0 else total - 1
        dx = directions[0, k] - directions[0, before]
        dy = directions[1, k] - directions[1, before]
        if math.hypot(dx, dy) > slack:
            boundary[0, kept] = directions[0, k]
            boundary[1, kept] = directions[1, k]
            kept += 1
    if kept == 0:
        boundary[0, 0] = directions[0, 0]
        boundary[1, 0] = directions[1, 0]
        kept = 1
    return kept


@kernel
def measure_boundary(boundary, count, covers_all):
    """Distance from the origin to the nearest edge [mm], and the area [mm^2]."""
    area = 0.0
    inner = math.inf
    for k in range(count):
        j = (k + 1) % count
        x, y = boundary[0, k], boundary[1, k]
        dx, dy = boundary[0, j] - x, boundary[1, j] - y
        area += x * boundary[1, j] - boundary[0, j] * y
        square = dx * dx + dy * dy
        along = -(x * dx + y * dy) / square if square > 0.0 else 0.0
        along = min(max(along, 0.0), 1.0)
        inner = min(inner, math.hypot(x + along * dx, y + along * dy))
    return inner if covers_all and count >= 3 else 0.0, 0.5 * area


@kernel
def find_needed(
    functions, numbers, linkage, compliance, top, deflection, limits, tolerance, same, work
):
    """The largest of the pressures at which each muscle alone deflects so far, and a code.

    Looked for up to each of ``limits`` in turn; ``numbers`` (m, n) are the muscles'.
    """
    highest, _, _ = measure_lateral(linkage, top)
    contraction, off, _ = place_displacement(linkage, top, highest, deflection)
    count = 1 if same else numbers.shape[0]
    for limit in limits:
        needed = 0.0
        done = True
        for k in range(count):
            pressure, left, _ = solve_pressure(
                functions, numbers[k], linkage, compliance, limit, deflection, contraction, work
            )
            done = done and max(off, left) <= tolerance and pressure > 0.0
            needed = max(needed, pressure)
        if done:
            return needed, FEASIBLE
    return math.nan, UNREACHED


@kernel(nogil=True)
def sweep_designs(
    functions,
    muscles,
    sections,
    cosines,
    sines,
    order,
    covered,
    legal,
    deflection,
    highest_pressure,
    tolerance,
    past_locking,
    same,
    out,
    codes,
):
    """Fill ``out`` (n, 5) and codes (n,) for n designs of m muscles.

    ``muscles`` (n, m, 9): inner and outer radius, braid angle, gap, modulus, Mooney ratio, friction
    length, length, dead length; with ``same`` those of a design are alike. ``sections`` (n, 6):
    offset, length, segments, rigidity, beam factor, pressure limit. Cosines, sines, order and
    covered (n or 1, m) are those of the sectors. ``functions`` (3,) are the addresses of the
    model's. Columns of ``out``: least and largest amplitude, inner radius, area, needed pressure;
    NaN where there is none.
    """
    count = cosines.shape[1]
    packed = 1 if same else count
    numbers = np.zeros((count, 32))
    amplitudes = np.empty(count)
    sorted_amplitudes = np.empty(count)
    directions = np.empty((3, 2 * count + DIRECTIONS))
    boundary = np.empty((2, 2 * count + DIRECTIONS))
    work = np.empty(3)
    for i in range(codes.size):
        out[i, :] = math.nan
        codes[i] = NOT_BUILT
        if not legal[i]:
            continue
        for k in range(packed):
            muscle = muscles[i, k]
            design = pack_design(
                muscle[0],
                muscle[1],
                muscle[2],
                muscle[3],
                muscle[4],
                muscle[5],
                muscle[6],
                past_locking,
            )
            for j in range(11):
                numbers[k, j] = design[j]
            numbers[k, 11] = muscle[7] - muscle[8]
        offset, length, limit = sections[i, 0], sections[i, 1], sections[i, 5]
        linkage = (offset, length, int(sections[i, 2]))
        compliance = offset * length**2 / (sections[i, 4] * sections[i, 3])
        top, peak, _ = find_top(linkage, find_end(linkage))
        answered = True
        for k in range(count):
            if k >= packed:
                amplitudes[k] = amplitudes[0]
                continue
            _, lateral, _, _, code = find_balance(
                functions[0], functions[1], numbers[k], linkage, compliance, top, limit, work
            )
            answered = answered and code != NO_ANSWER
            amplitudes[k] = min(lateral, peak)
        if not answered:
            codes[i] = NO_MODEL_ANSWER
            continue
        row = i if cosines.shape[0] > 1 else 0
        covers_all = True
        for k in range(count):
            sorted_amplitudes[k] = amplitudes[order[row, k]]
            covers_all = covers_all and covered[row, k]
        kept = fill_boundary(
            cosines[row], sines[row], covered[row], sorted_amplitudes, peak, directions, boundary
        )
        out[i, 0], out[i, 1] = amplitudes.min(), amplitudes.max()
        out[i, 2], out[i, 3] = measure_boundary(boundary, kept, covers_all)
        codes[i] = FEASIBLE
        if deflection > 0.0:
            if deflection > peak:
                codes[i] = BEYOND_PEAK
                continue
            out[i, 4], codes[i] = find_needed(
                functions,
                numbers,
                linkage,
                compliance,
                top,
                deflection,
                (limit, highest_pressure),
                tolerance,
                same,
                work,
            )
            if out[i, 4] > limit:
                codes[i] = ABOVE_LIMIT
