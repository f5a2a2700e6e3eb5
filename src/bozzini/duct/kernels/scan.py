"""Numba kernels of scan conversion: which nodes a mesh winds about, column by column along z.

A column crosses the triangles whose projections along z wind about it. A point is wound about as
often as the triangles above it turn, so a closed mesh is settled by its crossings alone. All is in
cells: the nodes are the integers. For voxels: their faces, and the nodes in them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ...numeric.compiling import kernel

ASIDE = 1e-6
"""Columns are looked at this far beyond a triangle's box too [cells]: rounding is less."""


@kernel
def _cross(corners, f, i, j):
    """How a triangle's projection winds about a column: 1 if its normal points up, -1, or 0.

    The sides that the half line from the column along +x meets are counted, with a side's lower end
    but not its upper one. On which side of the column it is, is settled from the lower to the upper
    end: so it is the same for both triangles at it, whatever the rounding, and the turns of a
    closed mesh always add up to 0.
    """
    turn = 0
    for e in range(3):
        a = e
        b = (e + 1) % 3
        up = 1
        if corners[f, a, 1] > corners[f, b, 1]:
            a, b = b, a
            up = -1
        if corners[f, a, 1] <= j and j < corners[f, b, 1]:
            width = corners[f, b, 0] - corners[f, a, 0]
            height = corners[f, b, 1] - corners[f, a, 1]
            if width * (j - corners[f, a, 1]) > (i - corners[f, a, 0]) * height:
                turn += up
    return turn


@kernel
def _find_box(corners, f, columns):
    """Columns (low i, high i, low j, high j) that a triangle may cross; the high ones excluded."""
    x0 = min(corners[f, 0, 0], corners[f, 1, 0], corners[f, 2, 0])
    x1 = max(corners[f, 0, 0], corners[f, 1, 0], corners[f, 2, 0])
    y0 = min(corners[f, 0, 1], corners[f, 1, 1], corners[f, 2, 1])
    y1 = max(corners[f, 0, 1], corners[f, 1, 1], corners[f, 2, 1])
    return (
        max(int(math.ceil(x0 - ASIDE)), 0),
        min(int(math.floor(x1 + ASIDE)) + 1, columns.shape[0]),
        max(int(math.ceil(y0 - ASIDE)), 0),
        min(int(math.floor(y1 + ASIDE)) + 1, columns.shape[1]),
    )


@kernel
def count_crossings(corners, wanted, counts):
    """Count the crossings of each column with triangles (m, 3, 3)."""
    for f in range(corners.shape[0]):
        i0, i1, j0, j1 = _find_box(corners, f, counts)
        for i in range(i0, i1):
            for j in range(j0, j1):
                if wanted[i, j] and _cross(corners, f, i, j) != 0:
                    counts[i, j] += 1


@kernel
def fill_crossings(corners, wanted, free, heights, turns):
    """Write the heights of the crossings, and how they turn, from `free` (nx, ny) on."""
    for f in range(corners.shape[0]):
        i0, i1, j0, j1 = _find_box(corners, f, free)
        if i0 >= i1 or j0 >= j1:
            continue
        ux = corners[f, 1, 0] - corners[f, 0, 0]
        uy = corners[f, 1, 1] - corners[f, 0, 1]
        uz = corners[f, 1, 2] - corners[f, 0, 2]
        vx = corners[f, 2, 0] - corners[f, 0, 0]
        vy = corners[f, 2, 1] - corners[f, 0, 1]
        vz = corners[f, 2, 2] - corners[f, 0, 2]
        nx = uy * vz - uz * vy
        ny = uz * vx - ux * vz
        nz = ux * vy - uy * vx
        low = min(corners[f, 0, 2], corners[f, 1, 2], corners[f, 2, 2])
        high = max(corners[f, 0, 2], corners[f, 1, 2], corners[f, 2, 2])
        for i in range(i0, i1):
            for j in range(j0, j1):
                turn = _cross(corners, f, i, j) if wanted[i, j] else 0
                if turn != 0:
                    z = high
                    if nz != 0.0:
                        dx = i - corners[f, 0, 0]
                        dy = j - corners[f, 0, 1]
                        z = corners[f, 0, 2] - (nx * dx + ny * dy) / nz
                        z = min(max(z, low), high)
                    heights[free[i, j]] = z
                    turns[free[i, j]] = turn
                    free[i, j] += 1


@kernel
def sort_crossings(first, heights, turns, open_columns):
    """Sort each column's crossings from the top down; mark the columns that do not add up to 0."""
    for c in range(first.shape[0] - 1):
        total = 0
        for n in range(first[c], first[c + 1]):
            z = heights[n]
            turn = turns[n]
            total += turn
            k = n
            while k > first[c] and heights[k - 1] < z:
                heights[k] = heights[k - 1]
                turns[k] = turns[k - 1]
                k -= 1
            heights[k] = z
            turns[k] = turn
        open_columns[c] = total != 0


@kernel
def fill_inside(first, heights, turns, flags, bit):
    """Set a bit of the flags (nx, ny, nz) at all nodes that are wound about at least once."""
    nx, ny, nz = flags.shape
    for i in range(nx):
        for j in range(ny):
            c = i * ny + j
            winding = 0
            n = first[c]
            while n < first[c + 1]:
                top = heights[n]
                winding += turns[n]
                n += 1
                bottom = heights[n] if n < first[c + 1] else top
                if winding > 0:
                    # A node at the crossing above it is not below that.
                    k1 = min(int(math.ceil(top)), nz)
                    k0 = max(int(math.ceil(bottom)), 0)
                    for k in range(k0, k1):
                        flags[i, j, k] |= bit


@kernel(parallel=True)
def find_inside(first, heights, turns, shape, corners, inside):
    """Set `inside` (n, m, m, m) at the nodes of bricks that are wound about at least once."""
    for b in prange(corners.shape[0]):
        for i in range(inside.shape[1]):
            for j in range(inside.shape[2]):
                column = (corners[b, 0] + i, corners[b, 1] + j)
                if column[0] >= shape[0] or column[1] >= shape[1]:
                    continue
                c = column[0] * shape[1] + column[1]
                for k in range(inside.shape[3]):
                    z = corners[b, 2] + k
                    winding = 0
                    for n in range(first[c], first[c + 1]):
                        if heights[n] <= z:
                            break
                        winding += turns[n]
                    inside[b, i, j, k] = winding > 0


@kernel
def list_faces(lumen, first, boxes):
    """List the faces between voxels of a lumen and others, joined in rows, as flat boxes.

    Called twice: with no boxes it counts, then it fills.

    Parameters
    ----------
    lumen : (nx, ny, nz) bool
        Its outermost voxels are False.
    first : (nx + 1,) int
        How many boxes begin at each i, to be counted; or where they go.
    boxes : (n, 6) float
        Lower and upper corner in voxels; (0, 6) to count.
    """
    nx, ny, nz = lumen.shape
    counting = boxes.shape[0] == 0
    for i in range(nx - 1):
        at = np.int64(0) if counting else first[i]
        began = np.full(nz, -1)
        for j in range(ny - 1):
            row_x = -1
            row_y = -1
            for k in range(nz - 1):
                here = lumen[i, j, k]
                # Rows along k of faces towards i + 1, and towards j + 1.
                if lumen[i + 1, j, k] != here:
                    if row_x < 0:
                        row_x = k
                elif row_x >= 0:
                    if not counting:
                        _put_box(boxes[at], i + 0.5, j - 0.5, row_x - 0.5, 0.0, 1.0, k - row_x)
                    at += 1
                    row_x = -1
                if lumen[i, j + 1, k] != here:
                    if row_y < 0:
                        row_y = k
                elif row_y >= 0:
                    if not counting:
                        _put_box(boxes[at], i - 0.5, j + 0.5, row_y - 0.5, 1.0, 0.0, k - row_y)
                    at += 1
                    row_y = -1
                # Rows along j of faces towards k + 1.
                if lumen[i, j, k + 1] != here:
                    if began[k] < 0:
                        began[k] = j
                elif began[k] >= 0:
                    if not counting:
                        row = began[k]
                        _put_box(boxes[at], i - 0.5, row - 0.5, k + 0.5, 1.0, j - row, 0.0)
                    at += 1
                    began[k] = -1
            if row_x >= 0:
                if not counting:
                    _put_box(boxes[at], i + 0.5, j - 0.5, row_x - 0.5, 0.0, 1.0, nz - 1 - row_x)
                at += 1
            if row_y >= 0:
                if not counting:
                    _put_box(boxes[at], i - 0.5, j + 0.5, row_y - 0.5, 1.0, 0.0, nz - 1 - row_y)
                at += 1
        for k in range(nz - 1):
            if began[k] >= 0:
                if not counting:
                    row = began[k]
                    _put_box(boxes[at], i - 0.5, row - 0.5, k + 0.5, 1.0, ny - 1 - row, 0.0)
                at += 1
        if counting:
            first[i] = at


@kernel
def _put_box(box, x, y, z, dx, dy, dz):
    box[0] = x
    box[1] = y
    box[2] = z
    box[3] = x + dx
    box[4] = y + dy
    box[5] = z + dz


@kernel
def flag_voxels(lumen, at_x, at_y, at_z, flag, flags):
    """Set a flag at the nodes whose voxel, by its index along each axis, is lumen; -1 is none."""
    for i in range(flags.shape[0]):
        if at_x[i] < 0:
            continue
        for j in range(flags.shape[1]):
            if at_y[j] < 0:
                continue
            for k in range(flags.shape[2]):
                if at_z[k] >= 0 and lumen[at_x[i], at_y[j], at_z[k]]:
                    flags[i, j, k] |= flag


@kernel
def mark_boxes(low, high, marked):
    """Mark the nodes of the cells that boxes, (m, 3) in cells, touch."""
    nx, ny, nz = marked.shape
    for n in range(low.shape[0]):
        i0 = max(int(math.floor(low[n, 0])), 0)
        j0 = max(int(math.floor(low[n, 1])), 0)
        k0 = max(int(math.floor(low[n, 2])), 0)
        i1 = min(int(math.ceil(high[n, 0])) + 1, nx)
        j1 = min(int(math.ceil(high[n, 1])) + 1, ny)
        k1 = min(int(math.ceil(high[n, 2])) + 1, nz)
        for i in range(i0, i1):
            for j in range(j0, j1):
                for k in range(k0, k1):
                    marked[i, j, k] = True


@kernel
def mark_triangles(corners, voxel, marked):
    """Mark the nodes nearest to points spread over triangles.

    Parameters
    ----------
    corners : (m, 3, 3) float
        From node 0 [mm]; the side from corner 1 to corner 2 is the shortest.
    voxel : float
        Distance between nodes [mm].
    marked : (nx, ny, nz) bool
        Set where a node is the nearest.

    A triangle is cut into n strips parallel to its shortest side, each strip into cells along its
    middle row, and the middle of each cell is taken. A point of the strip goes to the row along
    the line through corner 0, at most half a strip's height there, ``longest / (2 n)``, and along
    the row to the middle of a cell, at most ``row / (2 cells)``. Both are at most
    ``voxel / (2 sqrt 3)``.
    """
    step = voxel / math.sqrt(3.0)
    nx, ny, nz = marked.shape
    side = np.empty(3)
    for f in range(corners.shape[0]):
        for e in range(3):
            total = 0.0
            for a in range(3):
                d = corners[f, (e + 1) % 3, a] - corners[f, e, a]
                total += d * d
            side[e] = math.sqrt(total)
        strips = max(1, math.ceil(max(side[0], side[2]) / step))
        for i in range(strips):
            s = (i + 0.5) / strips
            cells = max(1, math.ceil(s * side[1] / step))
            for j in range(cells):
                t = (j + 0.5) / cells
                w0 = 1.0 - s
                w1 = s * (1.0 - t)
                w2 = s * t
                x = w0 * corners[f, 0, 0] + w1 * corners[f, 1, 0] + w2 * corners[f, 2, 0]
                y = w0 * corners[f, 0, 1] + w1 * corners[f, 1, 1] + w2 * corners[f, 2, 1]
                z = w0 * corners[f, 0, 2] + w1 * corners[f, 1, 2] + w2 * corners[f, 2, 2]
                p = min(max(int(math.floor(x / voxel + 0.5)), 0), nx - 1)
                q = min(max(int(math.floor(y / voxel + 0.5)), 0), ny - 1)
                r = min(max(int(math.floor(z / voxel + 0.5)), 0), nz - 1)
                marked[p, q, r] = True
