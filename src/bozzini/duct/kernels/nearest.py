"""Numba kernels of exact distances to triangles or boxes: a tree of boxes, and grids filled by it.

A wall is given by its parts, rows of `parts`: of a triangle one corner and the two sides from it
(9 numbers), of an axis-parallel box its lower and upper corner (6 numbers). The tree is binary, in
preorder: the left child follows its parent, `right` has the other one, or -1 in a leaf.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from ...numeric.compiling import kernel

MARKED, INSIDE, BAND = 1, 2, 16
"""Bits of a node's flag: near the wall; in the lumen; to be measured though it is outside."""

LEAF = 4
"""Parts in a leaf, at most."""

DEPTH = 64
"""Nodes that a search keeps for later, at most: one per level of the tree, and that is balanced."""

ON_WALL = 1e-6
"""Depth in the lumen up to which a node counts as on the wall [mm]."""


class Tree(NamedTuple):
    """The parts of a wall in the order of the tree's leaves, and the tree."""

    parts: NDArray[np.float64]
    boxes: NDArray[np.float64]
    right: NDArray[np.int32]
    first: NDArray[np.int32]
    counts: NDArray[np.int32]


@kernel
def _select(order, keys, low, high, middle):
    """Order `order[low:high]` so that keys up to `middle` are not above those from there on."""
    high -= 1
    while low < high:
        pivot = keys[order[(low + high) // 2]]
        i = low
        j = high
        while i <= j:
            while keys[order[i]] < pivot:
                i += 1
            while keys[order[j]] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@kernel
def build_tree(low, high):
    """Build a tree over boxes from `low` (n, 3) to `high` (n, 3): (order, boxes, right, first, n).

    Each node is split in halves across the longest side of the box around the parts' middles.
    """
    n = low.shape[0]
    order = np.arange(n)
    keys = np.empty(n)
    boxes = np.empty((2 * n + 1, 6))
    right = np.full(2 * n + 1, -1, np.int32)
    first = np.zeros(2 * n + 1, np.int32)
    count = np.zeros(2 * n + 1, np.int32)
    stack = np.empty((DEPTH, 3), np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, n, -1
    top = 1
    nodes = 0
    middle_low = np.empty(3)
    middle_high = np.empty(3)
    while top > 0:
        top -= 1
        start, stop, parent = stack[top, 0], stack[top, 1], stack[top, 2]
        node = nodes
        nodes += 1
        if parent >= 0:
            right[parent] = node
        for a in range(3):
            boxes[node, a] = np.inf
            boxes[node, 3 + a] = -np.inf
            middle_low[a] = np.inf
            middle_high[a] = -np.inf
        for k in range(start, stop):
            p = order[k]
            for a in range(3):
                boxes[node, a] = min(boxes[node, a], low[p, a])
                boxes[node, 3 + a] = max(boxes[node, 3 + a], high[p, a])
                m = low[p, a] + high[p, a]
                middle_low[a] = min(middle_low[a], m)
                middle_high[a] = max(middle_high[a], m)
        if stop - start <= LEAF:
            first[node] = start
            count[node] = stop - start
            continue
        axis = 0
        for a in range(1, 3):
            if middle_high[a] - middle_low[a] > middle_high[axis] - middle_low[axis]:
                axis = a
        for k in range(start, stop):
            p = order[k]
            keys[p] = low[p, axis] + high[p, axis]
        half = (start + stop) // 2
        _select(order, keys, start, stop, half)
        # The left half is taken next, so that it follows its parent.
        stack[top, 0], stack[top, 1], stack[top, 2] = half, stop, node
        stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = start, half, -1
        top += 2
    return order, boxes[:nodes].copy(), right[:nodes].copy(), first[:nodes], count[:nodes]


@kernel(inline="always")
def _box_gap(boxes, n, x, y, z):
    """Squared distance to a box."""
    dx = max(boxes[n, 0] - x, x - boxes[n, 3], 0.0)
    dy = max(boxes[n, 1] - y, y - boxes[n, 4], 0.0)
    dz = max(boxes[n, 2] - z, z - boxes[n, 5], 0.0)
    return dx * dx + dy * dy + dz * dz


@kernel
def _segment_gap(px, py, pz, ux, uy, uz):
    """Squared distance from p to the segment from 0 to u."""
    uu = ux * ux + uy * uy + uz * uz
    t = 0.0
    if uu > 0.0:
        t = min(max((px * ux + py * uy + pz * uz) / uu, 0.0), 1.0)
    dx = px - t * ux
    dy = py - t * uy
    dz = pz - t * uz
    return dx * dx + dy * dy + dz * dz


@kernel
def _triangle_gap(parts, n, x, y, z):
    """Squared distance to a triangle: to its plane above it, else to its sides."""
    ux, uy, uz = parts[n, 3], parts[n, 4], parts[n, 5]
    vx, vy, vz = parts[n, 6], parts[n, 7], parts[n, 8]
    px = x - parts[n, 0]
    py = y - parts[n, 1]
    pz = z - parts[n, 2]
    nx = uy * vz - uz * vy
    ny = uz * vx - ux * vz
    nz = ux * vy - uy * vx
    nn = nx * nx + ny * ny + nz * nz
    uu = ux * ux + uy * uy + uz * uz
    vv = vx * vx + vy * vy + vz * vz
    flat = nn <= 1e-18 * max(uu, vv) ** 2  # a needle is its sides
    if not flat:
        # Above the triangle where p is on the inner side of all three sides.
        s = nx * (uy * pz - uz * py) + ny * (uz * px - ux * pz) + nz * (ux * py - uy * px)
        t = nx * (py * vz - pz * vy) + ny * (pz * vx - px * vz) + nz * (px * vy - py * vx)
        if s >= 0.0 and t >= 0.0 and s + t <= nn:
            d = px * nx + py * ny + pz * nz
            return d * d / nn
        best = np.inf
        if s < 0.0:
            best = _segment_gap(px, py, pz, ux, uy, uz)
        if t < 0.0:
            best = min(best, _segment_gap(px, py, pz, vx, vy, vz))
        if s + t > nn:
            gap = _segment_gap(px - ux, py - uy, pz - uz, vx - ux, vy - uy, vz - uz)
            best = min(best, gap)
        return best
    best = _segment_gap(px, py, pz, ux, uy, uz)
    best = min(best, _segment_gap(px, py, pz, vx, vy, vz))
    return min(best, _segment_gap(px - ux, py - uy, pz - uz, vx - ux, vy - uy, vz - uz))


@kernel
def _part_gap(parts, n, x, y, z):
    if parts.shape[1] == 6:
        return _box_gap(parts, n, x, y, z)
    return _triangle_gap(parts, n, x, y, z)


@kernel
def nearest(tree, stack, gaps, x, y, z, best, seed):
    """Return (squared distance, part) of the part nearest to a point, if nearer than `best`.

    Parameters
    ----------
    stack : (DEPTH,) int
    gaps : (DEPTH,) float
        Both for the search to write in.
    best : float
        Squared; farther parts are not looked for.
    seed : int
        A part that is probably near, or -1. Returned if none is nearer.
    """
    found = seed
    if seed >= 0:
        best = min(best, _part_gap(tree.parts, seed, x, y, z))
    top = 0
    node = 0
    if _box_gap(tree.boxes, 0, x, y, z) >= best:
        return best, found
    while True:
        other = tree.right[node]
        if other < 0:
            for k in range(tree.first[node], tree.first[node] + tree.counts[node]):
                gap = _part_gap(tree.parts, k, x, y, z)
                if gap < best:
                    best = gap
                    found = k
        else:
            near = node + 1
            far = other
            a = _box_gap(tree.boxes, near, x, y, z)
            b = _box_gap(tree.boxes, far, x, y, z)
            if b < a:
                near, far = far, near
                a, b = b, a
            if b < best:
                stack[top] = far
                gaps[top] = b
                top += 1
            if a < best:
                node = near
                continue
        while top > 0 and gaps[top - 1] >= best:
            top -= 1
        if top == 0:
            return best, found
        top -= 1
        node = stack[top]


@kernel
def round_down(distance):
    """Return the float32 nearest to a distance that is not above it."""
    value = np.float32(distance)
    return np.nextafter(value, np.float32(0.0)) if value > distance else value


@kernel
def _measure(tree, stack, gaps, x, y, z, inside, limit, seed):
    """Return the node's value and the nearest part; `limit` bounds what is measured outside."""
    best, seed = nearest(tree, stack, gaps, x, y, z, np.inf if inside else limit * limit, seed)
    distance = math.sqrt(best)
    if inside:
        if distance <= ON_WALL:
            return np.float32(0.0), seed
        return -round_down(distance), seed
    return round_down(min(distance, limit)), seed


@kernel(parallel=True)
def fill_grid(tree, flags, low, step, limit, rows, values):
    """Fill `values` at the nodes that are flagged: the distance to the wall, negative inside.

    Parameters
    ----------
    flags : (nx, ny, nz) uint8
    low, step : (3,) float
        Node 0 and the distance between nodes [mm].
    limit : float
        Outside the lumen distances are not measured beyond this [mm].
    rows : (k + 1,) int
        Where the shares of the work begin: columns ``i * ny + j`` from each to the next.
    values : (nx, ny, nz) float32
    """
    _, ny, nz = flags.shape
    for share in prange(rows.shape[0] - 1):
        stack = np.empty(DEPTH, np.int64)
        gaps = np.empty(DEPTH)
        seed = -1
        for row in range(rows[share], rows[share + 1]):
            i = row // ny
            j = row % ny
            x = low[0] + i * step[0]
            y = low[1] + j * step[1]
            for k in range(nz):
                flag = flags[i, j, k]
                if flag & (INSIDE | BAND):
                    z = low[2] + k * step[2]
                    inside = (flag & INSIDE) != 0
                    values[i, j, k], seed = _measure(
                        tree, stack, gaps, x, y, z, inside, limit, seed
                    )


@kernel(parallel=True)
def fill_bricks(tree, corners, inside, low, step, limit, values):
    """Fill the nodes of bricks (n, m, m, m): the distance to the wall, negative inside.

    Parameters
    ----------
    corners : (n, 3) int
        The node of the lattice that a brick begins with.
    inside : (n, m, m, m) bool
    """
    for b in prange(corners.shape[0]):
        stack = np.empty(DEPTH, np.int64)
        gaps = np.empty(DEPTH)
        seed = -1
        for i in range(inside.shape[1]):
            x = low[0] + (corners[b, 0] + i) * step[0]
            for j in range(inside.shape[2]):
                y = low[1] + (corners[b, 1] + j) * step[1]
                for k in range(inside.shape[3]):
                    z = low[2] + (corners[b, 2] + k) * step[2]
                    values[b, i, j, k], seed = _measure(
                        tree, stack, gaps, x, y, z, inside[b, i, j, k], limit, seed
                    )
