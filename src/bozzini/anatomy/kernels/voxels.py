"""Voxels as runs: stretches of one label along the last axis, and how they join.

A lumen fills a few per cent of its volume: everything but one pass over the voxels is work on
its runs. A row is a line of voxels along the last axis; row ``i * ny + j`` of an array of shape
``(nx, ny, nz)``.
"""

from __future__ import annotations

import numpy as np

from ...numeric.compiling import kernel


@kernel
def find_runs(voxels):
    """Return the first run of each row, and of each run its row, begin, end (open) and label."""
    nx, ny, nz = voxels.shape
    first = np.zeros(nx * ny + 1, np.int64)
    for i in range(nx):
        for j in range(ny):
            line = voxels[i, j]
            before = line[0] * 0
            count = 0
            for k in range(nz):
                value = line[k]
                if value != before:
                    if value != 0:
                        count += 1
                    before = value
            first[i * ny + j + 1] = first[i * ny + j] + count
    total = first[nx * ny]
    rows = np.empty(total, np.int32)
    begins = np.empty(total, np.int32)
    ends = np.empty(total, np.int32)
    labels = np.empty(total, np.int32)
    at = 0
    for i in range(nx):
        for j in range(ny):
            if first[i * ny + j + 1] == first[i * ny + j]:
                continue
            line = voxels[i, j]
            before = line[0] * 0
            for k in range(nz):
                value = line[k]
                if value != before:
                    if before != 0:
                        ends[at - 1] = k
                    if value != 0:
                        rows[at] = i * ny + j
                        begins[at] = k
                        labels[at] = value
                        at += 1
                    before = value
            if before != 0:
                ends[at - 1] = nz
    return first, rows, begins, ends, labels


@kernel
def _find_root(parents, at):
    while parents[at] != at:
        parents[at] = parents[parents[at]]
        at = parents[at]
    return at


@kernel
def join_runs(first, begins, ends, ny, corners):
    """Return the number of the component of each run, and how many there are.

    Runs are joined through the faces of their voxels, with `corners` also through edges and
    corners.
    """
    parents = np.arange(len(begins))
    reach = 1 if corners else 0
    for row in range(len(first) - 1):
        i, j = row // ny, row % ny
        for at in range(first[row] + 1, first[row + 1]):
            if ends[at - 1] == begins[at]:
                one, two = _find_root(parents, at - 1), _find_root(parents, at)
                parents[max(one, two)] = min(one, two)
        for side in range(4):
            # ... the rows before it: across j, then those of the layer before
            if side == 0:
                other, legal = row - 1, j > 0
            else:
                step = side - 2
                other = row - ny + step
                legal = i > 0 and 0 <= j + step < ny and (corners or step == 0)
            if not legal:
                continue
            a, b = first[row], first[other]
            while a < first[row + 1] and b < first[other + 1]:
                if begins[a] < ends[b] + reach and begins[b] < ends[a] + reach:
                    one, two = _find_root(parents, a), _find_root(parents, b)
                    parents[max(one, two)] = min(one, two)
                if ends[a] < ends[b]:
                    a += 1
                else:
                    b += 1
    numbers = np.empty(len(begins), np.int64)
    count = 0
    for at in range(len(begins)):
        if parents[at] == at:
            numbers[at] = count
            count += 1
        else:
            numbers[at] = numbers[_find_root(parents, at)]
    return numbers, count


@kernel
def paint_runs(target, rows, begins, ends, values, ny, shift):
    """Write each run's value into an array whose voxel 0 lies at voxel ``-shift``."""
    for at in range(len(rows)):
        i, j = rows[at] // ny + shift[0], rows[at] % ny + shift[1]
        for k in range(begins[at] + shift[2], ends[at] + shift[2]):
            target[i, j, k] = values[at]


@kernel
def count_euler(voxels):
    """Return the Euler number of the voxels that are not 0, joined through faces.

    Voxels less pairs that share a face, plus full squares of four, less full cubes of eight.
    """
    nx, ny, nz = voxels.shape
    total = 0
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if voxels[i, j, k] == 0:
                    continue
                x = i + 1 < nx and voxels[i + 1, j, k] != 0
                y = j + 1 < ny and voxels[i, j + 1, k] != 0
                z = k + 1 < nz and voxels[i, j, k + 1] != 0
                xy = x and y and voxels[i + 1, j + 1, k] != 0
                xz = x and z and voxels[i + 1, j, k + 1] != 0
                yz = y and z and voxels[i, j + 1, k + 1] != 0
                total += 1 - (x + y + z) + (xy + xz + yz)
                if xy and xz and yz and voxels[i + 1, j + 1, k + 1] != 0:
                    total -= 1
    return total


@kernel
def count_faces(voxels, lumen, number):
    """Return the outer faces of every label up to `number`, and those that touch the lumen.

    `lumen` has the shape of `voxels`; a face between voxels of one label is not an outer one.
    """
    nx, ny, nz = voxels.shape
    outer = np.zeros(number + 1, np.int64)
    touching = np.zeros(number + 1, np.int64)
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                value = voxels[i, j, k]
                if value == 0 or lumen[i, j, k] != 0:
                    continue
                for side in range(6):
                    a = i + (side == 0) - (side == 1)
                    b = j + (side == 2) - (side == 3)
                    c = k + (side == 4) - (side == 5)
                    if a < 0 or b < 0 or c < 0 or a >= nx or b >= ny or c >= nz:
                        outer[value] += 1
                    elif voxels[a, b, c] != value:
                        outer[value] += 1
                        if lumen[a, b, c] != 0:
                            touching[value] += 1
    return outer, touching
