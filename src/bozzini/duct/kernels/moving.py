"""Numba kernels of a wall that moves: a tree refitted to moved triangles, nodes near a path.

Places are in the reference field's own frame [mm from its node 0]. Near the middle of each block
of nodes the deformation phi is known with its gradient; at x, near a middle x1,
``|phi(x) - phi(x1) - D phi(x1) (x - x1)| <= H |x - x1|^2 / 2``, H bounding its second derivative.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_matrix
from .clearance import field_value, nodes_bound
from .nearest import DEPTH, nearest, round_down

ROUNDING = 1e-12
"""Share of a side's squared length by which the square of its change may be off, and in mm^2."""

WALL, BOUND, EXACT = 0, 1, 2
"""What a node got: 0 mm, the bound from the reference field, or the distance to the moved wall."""

SPARE = 0.6
"""A bound is kept where it exceeds the body's radius by so much [mm]."""

CAP = 2.1
"""Distances are measured up to so much more than the body's radius [mm]."""

CELL = 1.8
"""A node this many cells nearer to the wall than the radius has no body in its cells."""


@kernel(parallel=True)
def move_parts(vertices, corners, rest, parts, gradient, excess):
    """Put moved triangles (n, 9) into `parts`, and what their sides change beyond the bound.

    Parameters
    ----------
    vertices : (v, 3) float
        Moved.
    corners : (n, 3) int
        Of the triangles, in the order of the tree.
    rest : (n, 9) float
        The triangles at rest.
    gradient : float
        Bound of the displacement's gradient.
    excess : (n,) float
        Filled: above 0 where a side changes by more than the bound allows [mm^2].
    """
    for n in prange(corners.shape[0]):
        a, b, c = corners[n, 0], corners[n, 1], corners[n, 2]
        uu = 0.0
        vv = 0.0
        ww = 0.0
        du = 0.0
        dv = 0.0
        dw = 0.0
        for k in range(3):
            u = vertices[b, k] - vertices[a, k]
            v = vertices[c, k] - vertices[a, k]
            parts[n, k] = vertices[a, k]
            parts[n, 3 + k] = u
            parts[n, 6 + k] = v
            p = rest[n, 3 + k]
            q = rest[n, 6 + k]
            uu += p * p
            vv += q * q
            ww += (p - q) ** 2
            du += (u - p) ** 2
            dv += (v - q) ** 2
            dw += (u - v - p + q) ** 2
        most = gradient * gradient + ROUNDING
        excess[n] = max(du - most * uu, dv - most * vv, dw - most * ww) - ROUNDING


@kernel
def refit_boxes(tree):
    """Fit the boxes of a tree of triangles to its parts, which were moved."""
    parts, boxes = tree.parts, tree.boxes
    for node in range(boxes.shape[0] - 1, -1, -1):
        other = tree.right[node]
        if other >= 0:
            for k in range(3):
                boxes[node, k] = min(boxes[node + 1, k], boxes[other, k])
                boxes[node, 3 + k] = max(boxes[node + 1, 3 + k], boxes[other, 3 + k])
            continue
        start = tree.first[node]
        for k in range(3):
            low = np.inf
            high = -np.inf
            for n in range(start, start + tree.counts[node]):
                a = parts[n, k]
                b = a + parts[n, 3 + k]
                c = a + parts[n, 6 + k]
                low = min(low, a, b, c)
                high = max(high, a, b, c)
            # The sums above are rounded.
            slack = 4.0e-16 * max(abs(low), abs(high))
            boxes[node, k] = low - slack
            boxes[node, 3 + k] = high + slack


@kernel
def mark_path(path, reach, low, step, side, flags, table, nodes, blocks, corners):
    """List the nodes within `reach` of points (n, 3) of a path, and the blocks that have them.

    Parameters
    ----------
    low : (3,) int
        First node of the box that is looked at, a multiple of `side` along each axis.
    step : (3,) float
        Distance between nodes [mm].
    side : int
        Nodes of a block along each axis.
    flags : (nx, ny, nz) uint8
        Zeros; left with the nodes marked.
    table : (ceil(nx / side), ...) int32
        Filled with -1; left with the number of each block.
    nodes : (m, 3) int32, blocks : (m,) int32
        Filled: nodes in the box, and the block of each.
    corners : (m, 3) int32
        Filled: the first node of each block, in the box.

    Returns
    -------
    count, number : int
        Of nodes and of blocks.
    """
    count = 0
    number = 0
    square = reach * reach
    first = np.empty(3, np.int64)
    last = np.empty(3, np.int64)
    for p in range(path.shape[0]):
        for a in range(3):
            first[a] = max(int(math.ceil((path[p, a] - reach) / step[a])) - low[a], 0)
            last[a] = min(
                int(math.floor((path[p, a] + reach) / step[a])) - low[a], flags.shape[a] - 1
            )
        for i in range(first[0], last[0] + 1):
            dx = (i + low[0]) * step[0] - path[p, 0]
            for j in range(first[1], last[1] + 1):
                dy = (j + low[1]) * step[1] - path[p, 1]
                left = square - dx * dx - dy * dy
                if left < 0.0:
                    continue
                for k in range(first[2], last[2] + 1):
                    dz = (k + low[2]) * step[2] - path[p, 2]
                    if dz * dz > left or flags[i, j, k] != 0:
                        continue
                    flags[i, j, k] = 1
                    block = table[i // side, j // side, k // side]
                    if block < 0:
                        block = number
                        table[i // side, j // side, k // side] = block
                        corners[number, 0] = i // side * side
                        corners[number, 1] = j // side * side
                        corners[number, 2] = k // side * side
                        number += 1
                    nodes[count, 0] = i
                    nodes[count, 1] = j
                    nodes[count, 2] = k
                    blocks[count] = block
                    count += 1
    return count, number


@kernel
def _find_eigenvalues(a, b, c, d, e, f):
    """Return the ends of the spectrum of the symmetric matrix [[a, d, e], [d, b, f], [e, f, c]].

    In closed form, by the trigonometric solution of the cubic.
    """
    off = d * d + e * e + f * f
    mean = (a + b + c) / 3.0
    spread = (a - mean) ** 2 + (b - mean) ** 2 + (c - mean) ** 2 + 2.0 * off
    p = math.sqrt(spread / 6.0)
    if p < 1e-12:
        return mean, mean
    a, b, c = (a - mean) / p, (b - mean) / p, (c - mean) / p
    d, e, f = d / p, e / p, f / p
    half = 0.5 * (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
    angle = math.acos(min(max(half, -1.0), 1.0)) / 3.0
    largest = mean + 2.0 * p * math.cos(angle)
    least = mean + 2.0 * p * math.cos(angle + 2.0 * math.pi / 3.0)
    return least, largest


@kernel
def singular_values(m):
    """Return the least and the largest singular value of a matrix (3, 3), to about 1e-7."""
    a = m[0, 0] ** 2 + m[1, 0] ** 2 + m[2, 0] ** 2
    b = m[0, 1] ** 2 + m[1, 1] ** 2 + m[2, 1] ** 2
    c = m[0, 2] ** 2 + m[1, 2] ** 2 + m[2, 2] ** 2
    d = m[0, 0] * m[0, 1] + m[1, 0] * m[1, 1] + m[2, 0] * m[2, 1]
    e = m[0, 0] * m[0, 2] + m[1, 0] * m[1, 2] + m[2, 0] * m[2, 2]
    f = m[0, 1] * m[0, 2] + m[1, 1] * m[1, 2] + m[2, 1] * m[2, 2]
    least, largest = _find_eigenvalues(a, b, c, d, e, f)
    # The closed form is rounded, most where two eigenvalues are nearly equal.
    return math.sqrt(max(least - 1e-7, 0.0)), math.sqrt(max(largest, 0.0))


@kernel
def describe_middles(rest, moves, probe, gradient, bend, middles):
    """Describe the deformation near places at rest (b, 3), as `bound_nodes` takes it.

    Parameters
    ----------
    moves : (7, b, 3) float
        The displacement there, `probe` mm farther along each axis, and `probe` mm less far.
    gradient, bend : float
        Stated bounds of its gradient and of its second derivative.

    Returns
    -------
    gradient, where, second, where
        The largest lower bound of a gradient, and of a second derivative, that was found, and at
        which place.
    """
    doubt = 0.5 * math.sqrt(3.0) * bend * probe
    g = np.empty((3, 3))
    last = np.empty((3, 3))
    change = np.empty((3, 3))
    most, most_at = 0.0, 0
    second, second_at = 0.0, 0
    for b in range(rest.shape[0]):
        for k in range(3):
            square = 0.0
            for a in range(3):
                g[a, k] = (moves[1 + k, b, a] - moves[4 + k, b, a]) / (2.0 * probe)
                jump = moves[1 + k, b, a] - 2.0 * moves[0, b, a] + moves[4 + k, b, a]
                square += jump * jump
            turn = math.sqrt(square) / (probe * probe)
            if turn > second:
                second, second_at = turn, b
        _, size = singular_values(g)
        if size - doubt > most:
            most, most_at = size - doubt, b
        if b > 0:
            # Gradients at two places differ by at most H times their distance.
            away = 0.0
            for a in range(3):
                away += (rest[b, a] - rest[b - 1, a]) ** 2
                for k in range(3):
                    change[a, k] = g[a, k] - last[a, k]
            _, size = singular_values(change)
            turn = (size - 2.0 * doubt) / max(math.sqrt(away), 1e-9)
            if turn > second:
                second, second_at = turn, b
        copy_matrix(g, last)
        for a in range(3):
            middles[b, a] = rest[b, a]
            middles[b, 3 + a] = rest[b, a] + moves[0, b, a]
        for a in range(3):
            g[a, a] += 1.0
        least, _ = singular_values(g)
        c00 = g[1, 1] * g[2, 2] - g[1, 2] * g[2, 1]
        c01 = g[1, 2] * g[2, 0] - g[1, 0] * g[2, 2]
        c02 = g[1, 0] * g[2, 1] - g[1, 1] * g[2, 0]
        det = g[0, 0] * c00 + g[0, 1] * c01 + g[0, 2] * c02
        if det <= 1e-9:
            middles[b, 6:15] = 0.0
            least = 0.0
        else:
            middles[b, 6] = c00 / det
            middles[b, 9] = c01 / det
            middles[b, 12] = c02 / det
            middles[b, 7] = (g[0, 2] * g[2, 1] - g[0, 1] * g[2, 2]) / det
            middles[b, 10] = (g[0, 0] * g[2, 2] - g[0, 2] * g[2, 0]) / det
            middles[b, 13] = (g[0, 1] * g[2, 0] - g[0, 0] * g[2, 1]) / det
            middles[b, 8] = (g[0, 1] * g[1, 2] - g[0, 2] * g[1, 1]) / det
            middles[b, 11] = (g[0, 2] * g[1, 0] - g[0, 0] * g[1, 2]) / det
            middles[b, 14] = (g[0, 0] * g[1, 1] - g[0, 1] * g[1, 0]) / det
        middles[b, 15] = least
        middles[b, 16] = doubt
        middles[b, 17] = bend
        middles[b, 18] = 1.0 + gradient
        for a in range(3):
            g[a, a] -= 1.0
    return most, most_at, second, second_at


@kernel(inline="always")
def bound_moved(stretch, bend, distance):
    """Lower bound of a moved distance: the integral of the least singular value along it.

    `stretch` is the least singular value at the place, and falls by at most `bend` per mm.
    """
    if bend * distance >= stretch:
        return 0.5 * stretch * stretch / bend if stretch > 0.0 and bend > 0.0 else 0.0
    return distance * (stretch - 0.5 * bend * distance)


@kernel(parallel=True)
def bound_nodes(field, middles, nodes, blocks, low, limits, places, bounds, kinds):
    """Bound the moved distance at nodes by that at rest; say where it has to be measured.

    Parameters
    ----------
    field : GridData
        The reference field.
    middles : (b, 19) float
        Of each block: x1, phi(x1), the inverse of D phi(x1) by rows, its least singular value,
        by how much D phi may be wrong, H, and 1 + the gradient's bound.
    limits : (5,) float
        Radius of the body, what a facet may be off, by how much an estimate of the field may be
        wrong, the longest side of a cell [mm], and 1 where distances can be measured, else 0.
    places : (m, 3) int32
        Filled: the node of the reference field nearest to where each node's tissue is at rest.
    bounds : (m,) float
        Filled [mm].
    kinds : (m,) uint8
        Filled.
    """
    step = field.step
    shape = field.values.shape
    radius, facet, error, cell = limits[0], limits[1], limits[2], limits[3]
    x = np.empty((nodes.shape[0], 3))
    for n in prange(nodes.shape[0]):
        b = blocks[n]
        square = 0.0
        dy0 = (nodes[n, 0] + low[0]) * step[0] - middles[b, 3]
        dy1 = (nodes[n, 1] + low[1]) * step[1] - middles[b, 4]
        dy2 = (nodes[n, 2] + low[2]) * step[2] - middles[b, 5]
        for a in range(3):
            move = (
                middles[b, 6 + 3 * a] * dy0
                + middles[b, 7 + 3 * a] * dy1
                + middles[b, 8 + 3 * a] * dy2
            )
            square += move * move
            x[n, a] = middles[b, a] + move
            places[n, a] = min(max(int(round(x[n, a] / step[a])), 0), shape[a] - 1)
        far = math.sqrt(square)
        doubt = middles[b, 16]
        bend = middles[b, 17]
        miss = 0.5 * bend * square + doubt * far
        stretch = middles[b, 15] - doubt - bend * far
        d = nodes_bound(field.values, step, x[n, 0], x[n, 1], x[n, 2])
        d += field.inflation - field.slack
        kinds[n] = WALL
        bounds[n] = 0.0
        if d <= 0.0:
            continue
        bound = max(bound_moved(stretch, bend, d), (2.0 - middles[b, 18]) * d) - miss - facet
        if bound <= 0.0:
            continue
        bounds[n] = bound
        kinds[n] = BOUND
        if bound >= radius + SPARE or limits[4] == 0.0:
            continue
        most = -field_value(
            field.values, step[0], step[1], step[2], field.inflation, x[n, 0], x[n, 1], x[n, 2]
        )
        if middles[b, 18] * (most + error) + miss + facet < radius - CELL * cell:
            kinds[n] = WALL
        else:
            kinds[n] = EXACT


@kernel
def store_nodes(nodes, bounds, kinds, values, wanted):
    """Store what is bounded in `values`; list the nodes to be measured, and return how many."""
    count = 0
    for n in range(nodes.shape[0]):
        if kinds[n] == EXACT:
            wanted[count] = n
            count += 1
        elif kinds[n] == BOUND:
            values[nodes[n, 0], nodes[n, 1], nodes[n, 2]] = -round_down(bounds[n])
    return count


@kernel(parallel=True)
def measure_nodes(tree, nodes, wanted, low, step, limit, places, seeds, values, shares):
    """Store the distance to the moved wall at the nodes listed, measured up to `limit` [mm].

    `seeds`, of the reference field's shape, has the part nearest to each tissue node in the last
    frame, plus 1, and is left with those of this one.
    """
    count = wanted.shape[0]
    for share in prange(shares):
        stack = np.empty(DEPTH, np.int64)
        gaps = np.empty(DEPTH)
        seed = -1
        for m in range(share * count // shares, (share + 1) * count // shares):
            n = wanted[m]
            i, j, k = nodes[n, 0], nodes[n, 1], nodes[n, 2]
            x = (i + low[0]) * step[0]
            y = (j + low[1]) * step[1]
            z = (k + low[2]) * step[2]
            known = seeds[places[n, 0], places[n, 1], places[n, 2]] - 1
            if known >= 0:
                seed = known
            best, seed = nearest(tree, stack, gaps, x, y, z, limit * limit, seed)
            if seed >= 0:
                seeds[places[n, 0], places[n, 1], places[n, 2]] = seed + 1
            values[i, j, k] = -round_down(math.sqrt(best))
