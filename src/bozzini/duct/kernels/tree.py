"""Numba kernels that take the lines of a tree out of the paths of one flood (see `graph`)."""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel


@kernel(nogil=True)
def add_lengths(order, number, nodes, before, step, lengths):
    """Fill `lengths` (n,) with that of each node's path [mm]; `order`: a node after its `before`.

    It is 0 where a path begins.
    """
    _, ny, nz = number.shape
    for here in order:
        last = before[here]
        if last < 0:
            lengths[here] = 0.0
            continue
        one, two = nodes[here], nodes[last]
        x = (one // (ny * nz) - two // (ny * nz)) * step[0]
        y = ((one // nz) % ny - (two // nz) % ny) * step[1]
        z = (one % nz - two % nz) * step[2]
        lengths[here] = lengths[last] + math.sqrt(x * x + y * y + z * z)


@kernel
def _find_beside(here, number, nodes, costs, owner, own):
    """Return the neighbour on another path that is nearest to the root, nearer than `here`; or -1.

    `own` is the number of the path of `here`.
    """
    nx, ny, nz = number.shape
    flat = nodes[here]
    i, j, k = flat // (ny * nz), (flat // nz) % ny, flat % nz
    best, least = -1, costs[here]
    for a in range(max(i - 1, 0), min(i + 2, nx)):
        for b in range(max(j - 1, 0), min(j + 2, ny)):
            for c in range(max(k - 1, 0), min(k + 2, nz)):
                there = number[a, b, c]
                if there >= 0 and owner[there] >= 0 and owner[there] != own:
                    if costs[there] < least:
                        best, least = there, costs[there]
    return best


@kernel(nogil=True)
def take_lines(order, number, nodes, before, costs, lengths, depths, step, least, owner, tips):
    """Trace back paths, the farthest node first, each until it meets another; return how many.

    Where a path would run on beside another for three times the clearance and four voxels, as in
    the middle of an even number of voxels, it goes over to it, and `before` is changed.

    A path covers what is joined with each of its nodes within a ball round it: as far beyond the
    wall as the node has clearance, and at least `least`. No path begins where another covers
    (Sato et al., TEASAR, 2000).

    Parameters
    ----------
    order : (m,) int
        Nodes, the one with the longest path first.
    before : (n,) int32
        The node before on the path.
    costs, lengths : (n,) float
        Of each node's path.
    depths : (n,) float
        Clearance [mm].
    owner : (n,) int32
        -1 at first; filled with the number of the path that a node is on.
    tips : (k,) int32
        Filled with the nodes where the paths begin; no more than k are taken.
    """
    nx, ny, nz = number.shape
    count = nodes.shape[0]
    covered = np.zeros(count, np.bool_)
    seen = np.full(count, -1, np.int32)
    stack = np.empty(count, np.int32)
    found = 0
    for tip in order:
        if covered[tip]:
            continue
        if found == tips.shape[0]:
            break
        tips[found] = tip
        here = tip
        left = 0.0  # until the next ball: one in each sixth of a radius is enough
        while here >= 0 and owner[here] < 0:
            owner[here] = found
            covered[here] = True
            flat = nodes[here]
            i, j, k = flat // (ny * nz), (flat // nz) % ny, flat % nz
            if left <= 0.0:
                left = depths[here] / 6.0
                reach = depths[here] + max(depths[here], least)
                stack[0], top = here, 1
                seen[here] = here
                while top > 0:
                    top -= 1
                    other = nodes[stack[top]]
                    p, q, r = other // (ny * nz), (other // nz) % ny, other % nz
                    for a in range(max(p - 1, 0), min(p + 2, nx)):
                        for b in range(max(q - 1, 0), min(q + 2, ny)):
                            for c in range(max(r - 1, 0), min(r + 2, nz)):
                                there = number[a, b, c]
                                if there < 0 or seen[there] == here:
                                    continue
                                x = (a - i) * step[0]
                                y = (b - j) * step[1]
                                z = (c - k) * step[2]
                                if x * x + y * y + z * z <= reach * reach:
                                    seen[there] = here
                                    covered[there] = True
                                    stack[top] = there
                                    top += 1
            beside = _find_beside(here, number, nodes, costs, owner, found)
            if beside >= 0:
                on, way, far = here, 0.0, 3.0 * depths[here] + 4.0 * max(step[0], step[1], step[2])
                while way < far and before[on] >= 0 and owner[before[on]] < 0:
                    on = before[on]
                    way = lengths[here] - lengths[on]
                if way >= far and _find_beside(on, number, nodes, costs, owner, found) >= 0:
                    before[here] = beside
            last = before[here]
            if last >= 0:
                flat = nodes[last]
                x = (flat // (ny * nz) - i) * step[0]
                y = ((flat // nz) % ny - j) * step[1]
                z = (flat % nz - k) * step[2]
                left -= math.sqrt(x * x + y * y + z * z)
            here = last
        found += 1
    return found


@kernel
def _are_apart(one, two, before, depths, lengths, voxel):
    """Whether two places of lines are far from each other along these: see `find_fronts`."""
    left = 3.0 * (depths[one] + depths[two]) + 4.0 * voxel
    while one != two and left >= 0.0:
        if lengths[one] < lengths[two]:
            one, two = two, one
        left -= lengths[one] - lengths[before[one]]
        one = before[one]
    return left < 0.0


@kernel(nogil=True)
def find_fronts(number, nodes, before, depths, lengths, feet, voxel, fronts, is_open):
    """Find neighbours whose ways to the root part long before them; return how many there are.

    Their feet, the places of lines nearest to them, are farther from each other along the lines
    than three times the clearance at both, and four voxels. A front is open where one gets from
    one of its sides to the other past its edge, in a triangle of neighbours. A closed one cuts a
    loop: it is a cocycle of the neighbours' clique complex, which has the topology of the voxels,
    and the way round, by the lines and once across, crosses it once.

    Parameters
    ----------
    lengths : (n,) float
        Of each node's path; negative where none leads.
    feet : (n,) int32
        The place of a line that is nearest to a node through the lumen.
    fronts : (k, 2) int32
        Filled with pairs of nodes, as many as it holds.
    is_open : (k,) bool
        Filled with whether an edge is there.
    """
    nx, ny, nz = number.shape
    found = 0
    for here in range(nodes.shape[0]):
        if lengths[here] < 0.0:
            continue
        flat = nodes[here]
        i, j, k = flat // (ny * nz), (flat // nz) % ny, flat % nz
        one = feet[here]
        for a in range(max(i - 1, 0), min(i + 2, nx)):
            for b in range(max(j - 1, 0), min(j + 2, ny)):
                for c in range(max(k - 1, 0), min(k + 2, nz)):
                    there = number[a, b, c]
                    if there <= here or feet[there] == one:
                        continue
                    two = feet[there]
                    if not _are_apart(one, two, before, depths, lengths, voxel):
                        continue
                    if found < fronts.shape[0]:
                        fronts[found, 0], fronts[found, 1] = here, there
                        is_open[found] = False
                        for p in range(max(i, a) - 1, min(i, a) + 2):
                            for q in range(max(j, b) - 1, min(j, b) + 2):
                                for r in range(max(k, c) - 1, min(k, c) + 2):
                                    if p < 0 or q < 0 or r < 0 or p >= nx or q >= ny or r >= nz:
                                        continue
                                    third = number[p, q, r]
                                    if third < 0 or third == here or third == there:
                                        continue
                                    foot = feet[third]
                                    if not (
                                        _are_apart(one, foot, before, depths, lengths, voxel)
                                        or _are_apart(two, foot, before, depths, lengths, voxel)
                                    ):
                                        is_open[found] = True
                    found += 1
    return found
