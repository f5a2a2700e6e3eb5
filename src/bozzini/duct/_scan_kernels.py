"""Numba kernels of scan conversion: which nodes a mesh winds about, column by column along z.

A column crosses the triangles whose projections along z wind about it. A point is wound about as
often as the triangles above it turn, so a closed mesh is settled by its crossings alone. All is in
cells: the nodes are the integers.
"""

from __future__ import annotations

import math

from numba import njit, prange

__all__ = ["count_crossings", "fill_crossings", "fill_inside", "sort_crossings"]

ASIDE = 1e-6
"""Columns are looked at this far beyond a triangle's box too [cells]: rounding is less."""


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def count_crossings(corners, wanted, counts):
    """Count the crossings of each column with triangles (m, 3, 3)."""
    for f in range(corners.shape[0]):
        i0, i1, j0, j1 = _find_box(corners, f, counts)
        for i in range(i0, i1):
            for j in range(j0, j1):
                if wanted[i, j] and _cross(corners, f, i, j) != 0:
                    counts[i, j] += 1


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True, parallel=True)
def fill_inside(first, heights, turns, flags, bit):
    """Set a bit of the flags (nx, ny, nz) at all nodes that are wound about at least once."""
    nx, ny, nz = flags.shape
    for i in prange(nx):
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


@njit(cache=True, parallel=True)
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
