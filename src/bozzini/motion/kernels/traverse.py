"""Numba kernels: chords of a line that are free, and the longest free segment through a section.

Clearance ``d`` [mm] is 1-Lipschitz, ``|d(x) - d(y)| <= |x - y|``. So on a chord between two points
it is at least ``(d(x) + d(y) - |x - y|) / 2``, and a grid of upper bounds ``D_i`` at nodes ``y_i``
bounds it by ``min_i (D_i + |x - y_i|)``. Segments are ``x + u q`` with middle ``x`` in a section
and direction ``u``; all those of a cell, by half sides h of its square and s on a face of the cube
of directions, lie within ``sqrt(2) (h + s q)`` of its middle one. `bozzini.motion.traverse` states
what is bounded, and why that is a proof.
"""

from __future__ import annotations

import math

import numpy as np

from ...duct.kernels.clearance import clearance_bound
from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_vector

# Numba kernels: the chords of a line that have the clearance for a body, and those that have not.

WALL = 1
TURN = 2

NEAR = 16
"""Pairs of segments this near along the line are judged by the directions between them."""

SAMPLES = 128
"""A chord is looked at in about this many places at most."""

SMALLEST = 1e-9
"""Cells so much smaller than a step along a ray are not divided: the rim of a plane never ends."""

TABLE_MAX = 2500
"""For lines of more segments what is known of shorter chords is not kept: it takes their square."""


@kernel
def _bound_chord_clearance(duct, middles, i, j, needed, least_step):
    """Lower bound of the clearance along a chord between two places, or a value below `needed`."""
    ax, ay, az = middles[i, 0], middles[i, 1], middles[i, 2]
    dx = middles[j, 0] - ax
    dy = middles[j, 1] - ay
    dz = middles[j, 2] - az
    size = math.sqrt(dx * dx + dy * dy + dz * dz)
    clearance = clearance_bound(duct, ax, ay, az)
    if clearance < needed:
        return clearance
    least = clearance
    t = 0.0
    while t < size:
        step = max(clearance - needed, least_step)
        end = min(t + step, size)
        step = end - t
        u = end / size
        ahead = clearance_bound(duct, ax + u * dx, ay + u * dy, az + u * dz)
        if ahead < needed:
            return ahead
        # From either end the clearance falls by at most 1 per mm.
        least = min(least, 0.5 * (clearance + ahead - step))
        if least < needed:
            return least
        clearance = ahead
        t = end
    return least


@kernel
def _measure_distance(middles, i, j, m):
    """Distance of a place from the chord between two others."""
    square = 0.0
    along = 0.0
    for c in range(3):
        d = middles[j, c] - middles[i, c]
        square += d * d
        along += d * (middles[m, c] - middles[i, c])
    u = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
    square_distance = 0.0
    for c in range(3):
        d = middles[m, c] - middles[i, c] - u * (middles[j, c] - middles[i, c])
        square_distance += d * d
    return math.sqrt(square_distance)


@kernel
def _turns_back(points, i, j, half_sum):
    """Whether a chord from segment i to segment j may be 90 degrees or more from either."""
    n = points.shape[1]
    if j - i <= NEAR:
        ahead = True
        for k in range(i, j + 1):
            first = 0.0
            last = 0.0
            for c in range(n):
                part = points[k + 1, c] - points[k, c]
                first += part * (points[i + 1, c] - points[i, c])
                last += part * (points[j + 1, c] - points[j, c])
            if first <= 0.0 or last <= 0.0:
                ahead = False
                break
        if ahead:
            return False
    first = 0.0
    last = 0.0
    size_i = 0.0
    size_j = 0.0
    for c in range(n):
        chord = 0.5 * (points[j, c] + points[j + 1, c] - points[i, c] - points[i + 1, c])
        ti = points[i + 1, c] - points[i, c]
        tj = points[j + 1, c] - points[j, c]
        first += chord * ti
        last += chord * tj
        size_i += ti * ti
        size_j += tj * tj
    return first <= half_sum * math.sqrt(size_i) or last <= half_sum * math.sqrt(size_j)


@kernel
def scan_chords(duct, points, radius, longest, stop, length, reason):
    """From every segment of a line, find the first later one to which a link does not fit.

    Points on segments i and j are at most half a segment from their middles, so every point of a
    chord between them is within half of the longer one of the chord between the middles.

    Parameters
    ----------
    duct : named tuple
        The packed duct.
    points : (n, 3) float
        The line, in the kernels' frame.
    radius : float
        Of the body [mm].
    longest : float
        Chords longer than this are not looked at [mm].
    stop : (n - 1,) int
        Filled with the segment j at which the scan from i ended; n - 1 if it never did.
    length : (n - 1,) float
        Filled with a lower bound of the length of chords there; infinite if it never ended.
    reason : (n - 1,) int
        Filled with `WALL` or `TURN`.
    """
    count = points.shape[0] - 1
    sides = np.empty(count)
    middles = np.empty((count, 3))
    for i in range(count):
        square = 0.0
        for c in range(3):
            square += (points[i + 1, c] - points[i, c]) ** 2
            middles[i, c] = 0.5 * (points[i, c] + points[i + 1, c])
        sides[i] = math.sqrt(square)
    # Lower bounds of the clearance along chords, from later rows on.
    kept = count if count <= TABLE_MAX else 0
    margins = np.full((kept, kept), -np.inf)
    for i in range(count - 1, -1, -1):
        margin = -np.inf
        stop[i] = count
        length[i] = np.inf
        reason[i] = 0
        for j in range(i, count):
            allowance = 0.5 * max(sides[i], sides[j])
            half_sum = 0.5 * (sides[i] + sides[j])
            cause = 0
            square = 0.0
            for c in range(3):
                square += (middles[j, c] - middles[i, c]) ** 2
            size = math.sqrt(square)
            if size - half_sum > longest:
                break
            if j > i and _turns_back(points, i, j, half_sum):
                cause = TURN
            if cause == 0:
                # From the last chord, from two shorter ones, then along the chord itself.
                if j > i:
                    margin -= 0.5 * (sides[j - 1] + sides[j])
                if margin < radius + allowance and j > i + 1 and kept > 0:
                    # A chord is no farther from two shorter ones than the place between is.
                    m = (i + j) // 2
                    sag = _measure_distance(middles, i, j, m)
                    margin = max(margin, min(margins[i, m], margins[m, j]) - sag)
                if margin < radius + allowance:
                    least_step = max(0.25 * allowance, size / SAMPLES)
                    margin = _bound_chord_clearance(
                        duct, middles, i, j, radius + allowance, least_step
                    )
                if kept > 0:
                    margins[i, j] = margin
                if margin < radius + allowance:
                    cause = WALL
            if cause != 0:
                stop[i] = j
                length[i] = max(size - half_sum, 0.0)
                reason[i] = cause
                break


CELL = 9
"""Columns of a cell: bound, midpoint (3), its half side, face, p, q, their half side."""


@kernel
def measure_ceiling(values, step, floor, x, y, z):
    """Upper bound of the clearance at a point, from upper bounds ``-values`` at the nodes.

    Clearance is 1-Lipschitz, so it is at most any node's plus the distance to that node. Nodes
    below `floor` only say that they are below it. Off the grid there is no lumen.
    """
    nx, ny, nz = values.shape
    cx = min(max(x, 0.0), (nx - 1) * step[0])
    cy = min(max(y, 0.0), (ny - 1) * step[1])
    cz = min(max(z, 0.0), (nz - 1) * step[2])
    i = min(int(cx / step[0]), nx - 2)
    j = min(int(cy / step[1]), ny - 2)
    k = min(int(cz / step[2]), nz - 2)
    best = np.inf
    for a in range(2):
        dx = cx - (i + a) * step[0]
        for b in range(2):
            dy = cy - (j + b) * step[1]
            flat = dx * dx + dy * dy
            for c in range(2):
                dz = cz - (k + c) * step[2]
                clearance = max(-float(values[i + a, j + b, k + c]), floor)
                best = min(best, clearance + math.sqrt(flat + dz * dz))
    if cx != x or cy != y or cz != z:
        off = math.sqrt((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2)
        best = min(best + off, max(best, 0.0) - off)
    return best


@kernel
def _bound_reach(values, step, floor, cell, u, sign, radius, slack, spread, limit, least_step):
    """Upper bound of how far rays of a cell go with at least `radius` of clearance.

    Rays of the cell are within ``slack + t * spread`` of its middle ray at t.
    """
    t = 0.0
    while t < limit:
        needed = radius - slack - t * spread
        along = sign * t
        clearance = measure_ceiling(
            values,
            step,
            floor,
            cell[1] + along * u[0],
            cell[2] + along * u[1],
            cell[3] + along * u[2],
        )
        if clearance < needed:
            return t
        t += max((clearance - needed) / (1.0 + spread), least_step)
    return limit


@kernel
def _fill_direction(face, p, q, axes, planar, u):
    """Fill `u` with a direction of a face of the cube (of the square) over `axes`."""
    sign = 1.0 if face < 3 else -1.0
    f = face % 3
    if planar:
        for c in range(3):
            u[c] = sign * axes[f, c] + p * axes[1 - f, c]
    else:
        for c in range(3):
            u[c] = sign * axes[f, c] + p * axes[(f + 1) % 3, c] + q * axes[(f + 2) % 3, c]
    size = math.sqrt(u[0] ** 2 + u[1] ** 2 + u[2] ** 2)
    for c in range(3):
        u[c] /= size


@kernel
def _push(heap, count, cell):
    n = count
    while n > 0:
        m = (n - 1) // 2
        if heap[m, 0] >= cell[0]:
            break
        copy_vector(heap[m], heap[n])
        n = m
    copy_vector(cell, heap[n])
    return count + 1


@kernel
def _pop(heap, count, cell):
    copy_vector(heap[0], cell)
    count -= 1
    n = 0
    while True:
        m = 2 * n + 1
        if m >= count:
            break
        if m + 1 < count and heap[m + 1, 0] > heap[m, 0]:
            m += 1
        if heap[m, 0] <= heap[count, 0]:
            break
        heap[n] = heap[m]
        n = m
    heap[n] = heap[count]
    return count


@kernel
def _bound_cell(
    values, step, floor, axes, planar, back, radius, limit, least_step, cell, u, found, tolerance
):
    """Put the upper bound of lengths into a cell, or 0; improve `found` by its middle segment."""
    diagonal = 1.0 if planar else math.sqrt(2.0)
    slack = cell[4] * diagonal
    spread = min(cell[8] * diagonal, 2.0)
    _fill_direction(int(cell[5]), cell[6], cell[7], axes, planar, u)
    behind = u[0] * axes[2, 0] + u[1] * axes[2, 1] + u[2] * axes[2, 2]
    if back:
        if behind > spread:
            cell[0] = 0.0
            return
    ends = 1.0 if back else 2.0
    top = min(cell[0], limit) / ends
    ahead = _bound_reach(values, step, floor, cell, u, 1.0, radius, slack, spread, top, least_step)
    if not back and ahead * ends > found[0] * tolerance:
        ahead = _bound_reach(
            values, step, floor, cell, u, -1.0, radius, slack, spread, ahead, least_step
        )
    cell[0] = ahead * ends
    if cell[0] > found[0] and not (back and behind > 0.0):
        size = _bound_reach(values, step, floor, cell, u, 1.0, radius, 0.0, 0.0, ahead, least_step)
        if not back and size * ends > found[0]:
            size = _bound_reach(
                values, step, floor, cell, u, -1.0, radius, 0.0, 0.0, size, least_step
            )
        if size * ends > found[0]:
            found[0] = size * ends
            for c in range(3):
                found[1 + c] = cell[1 + c]
                found[4 + c] = u[c]


@kernel
def find_longest(
    values,
    step,
    floor,
    starts,
    half,
    axes,
    planar,
    back,
    radius,
    limit,
    least_step,
    tolerance,
    heap,
):
    """Bound the longest free segment with its middle in a section, or from one point backwards.

    Branch and bound over the middle (squares of the section) and the direction (squares on the
    faces of a cube, where equal distances are no smaller than on the sphere).

    Parameters
    ----------
    values, step, floor
        See `measure_ceiling`.
    starts : (k, 3) float
        Middles of squares that cover the section; with `back` the point alone.
    half : float
        Half a side of these squares [mm]; 0 with `back`.
    axes : (3, 3) float
        Rows: two axes of the section and its normal. If planar, the first row is in the plane and
        so is the second, the normal, which the third repeats.
    planar : bool
        Whether the duct is planar.
    back : bool
        The segment starts at the point and goes against the normal.
    radius : float
        Of the body [mm].
    limit : float
        Longer ones are not looked for [mm].
    grain : float
        Smallest step along a ray [mm].
    tolerance : float
        Stop when the bound is at most this factor above a segment that was found.
    heap : (m, 9) float
        Room for cells.

    Returns
    -------
    bound : float
        No segment is longer [mm].
    found : (7,) float
        Length of the longest segment found, by the same upper bounds of clearance; its middle (or
        start) and direction.
    """
    found = np.zeros(7)
    cell = np.empty(CELL)
    child = np.empty(CELL)
    u = np.empty(3)
    count = 0
    parts = 4
    capacity = heap.shape[0] - 8
    dropped = 0.0
    faces = 2 if planar else 3
    for n in range(starts.shape[0]):
        for sign in range(2 if back else 1):
            for f in range(faces):
                for a in range(parts):
                    for b in range(1 if planar else parts):
                        child[0] = limit
                        copy_vector(starts[n], child[1:4])
                        child[4] = half
                        child[5] = f + 3 * sign
                        child[6] = -1.0 + (2 * a + 1) / parts
                        child[7] = 0.0 if planar else -1.0 + (2 * b + 1) / parts
                        child[8] = 1.0 / parts
                        _bound_cell(
                            values, step, floor, axes, planar, back, radius, limit, least_step,
                            child, u, found, tolerance,
                        )  # fmt: skip
                        if child[0] > found[0]:
                            if count < capacity:
                                count = _push(heap, count, child)
                            else:
                                dropped = max(dropped, child[0])
    diagonal = 1.0 if planar else math.sqrt(2.0)
    ends = 1.0 if back else 2.0
    # The cell of the largest bound is divided: its square, or its directions if these spread more.
    while count > 0:
        bound = max(heap[0, 0], dropped)
        if (
            bound <= max(found[0] * tolerance, least_step)
            or count >= capacity
            or dropped >= heap[0, 0]
        ):
            return max(bound, found[0]), found
        count = _pop(heap, count, cell)
        wide = min(cell[8] * diagonal, 2.0) * cell[0] / ends
        if max(cell[4] * diagonal, wide) < SMALLEST * least_step:
            return max(bound, found[0]), found
        if cell[4] * diagonal > wide:
            side, first, second = 0.5 * cell[4], 0, 1
            for a in range(2):
                for b in range(1 if planar else 2):
                    copy_vector(cell, child)
                    child[4] = side
                    for c in range(3):
                        child[1 + c] += (2 * a - 1) * side * axes[first, c]
                        if not planar:
                            child[1 + c] += (2 * b - 1) * side * axes[second, c]
                    _bound_cell(
                        values, step, floor, axes, planar, back, radius, limit, least_step,
                        child, u, found, tolerance,
                    )  # fmt: skip
                    if child[0] > found[0]:
                        count = _push(heap, count, child)
        else:
            side = 0.5 * cell[8]
            for a in range(2):
                for b in range(1 if planar else 2):
                    copy_vector(cell, child)
                    child[8] = side
                    child[6] += (2 * a - 1) * side
                    if not planar:
                        child[7] += (2 * b - 1) * side
                    _bound_cell(
                        values, step, floor, axes, planar, back, radius, limit, least_step,
                        child, u, found, tolerance,
                    )  # fmt: skip
                    if child[0] > found[0]:
                        count = _push(heap, count, child)
    return max(found[0], dropped), found


@kernel
def measure_ceilings(values, step, floor, points, result):
    """Fill `result` (n,) with upper bounds of the clearance at `points` (n, 3)."""
    for n in range(points.shape[0]):
        result[n] = measure_ceiling(values, step, floor, points[n, 0], points[n, 1], points[n, 2])
