"""Numba kernels of the widest way between two nodes of a grid."""

from __future__ import annotations

import numpy as np

from ...numeric.compiling import kernel


@kernel
def _find(parent, n):
    while parent[n] != n:
        parent[n] = parent[parent[n]]
        n = parent[n]
    return n


@kernel
def widest_level(clearance, nodes, order, place, start, goal):
    """Add nodes from the widest on until start and goal are connected (26 neighbours).

    Parameters
    ----------
    clearance : (n,) float
        Of the nodes that may be on the way.
    nodes : (n,) int
        Their flat indices in the grid.
    order : (n,) int
        Their numbers by falling clearance.
    place : (nx, ny, nz) int32
        -1 everywhere; filled with where in `order` a node is.
    start, goal : int
        Numbers.

    Returns
    -------
    level : float
        The clearance of the last node added: no way on the grid has more everywhere; -inf if none.
    node : int
        Its number, -1 if none.
    """
    nx, ny, nz = place.shape
    parent = np.full(clearance.shape[0], -1, np.int32)
    first = last = -1
    for t in range(order.shape[0]):
        n = order[t]
        parent[t] = t
        if n == start:
            first = t
        if n == goal:
            last = t
        i = nodes[n] // (ny * nz)
        j = (nodes[n] // nz) % ny
        k = nodes[n] % nz
        place[i, j, k] = t
        for a in range(max(i - 1, 0), min(i + 2, nx)):
            for b in range(max(j - 1, 0), min(j + 2, ny)):
                for c in range(max(k - 1, 0), min(k + 2, nz)):
                    m = place[a, b, c]
                    if m >= 0 and m != t:
                        p = _find(parent, m)
                        q = _find(parent, t)
                        if p != q:
                            parent[p] = q
        if first >= 0 and last >= 0 and _find(parent, first) == _find(parent, last):
            return clearance[n], n
    return -np.inf, -1


@kernel
def find_rim(values, level, rim):
    """List the flat indices of nodes at or above `level` with a neighbour (of 6) below it.

    Returns how many there are; with `rim` of length 0 they are only counted.
    """
    nx, ny, nz = values.shape
    n = 0
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if values[i, j, k] >= level and (
                    (i > 0 and values[i - 1, j, k] < level)
                    or (i < nx - 1 and values[i + 1, j, k] < level)
                    or (j > 0 and values[i, j - 1, k] < level)
                    or (j < ny - 1 and values[i, j + 1, k] < level)
                    or (k > 0 and values[i, j, k - 1] < level)
                    or (k < nz - 1 and values[i, j, k + 1] < level)
                ):
                    if rim.shape[0] > 0:
                        rim[n] = (i * ny + j) * nz + k
                    n += 1
    return n
