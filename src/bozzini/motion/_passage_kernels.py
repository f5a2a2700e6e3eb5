"""Numba kernel of the widest way between two nodes of a grid."""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["widest_level"]


@njit(cache=True)
def _find(parent, n):
    while parent[n] != n:
        parent[n] = parent[parent[n]]
        n = parent[n]
    return n


@njit(cache=True)
def widest_level(room, order, shape, start, goal):
    """Add nodes from the roomiest on until start and goal are connected (26 neighbours).

    Parameters
    ----------
    room : (n,) float
        Of all nodes, flat.
    order : (k,) int
        Nodes by falling room.
    start, goal : int
        Flat indices.

    Returns
    -------
    level : float
        The room of the last node added: no way on the grid has more everywhere; -inf if none.
    node : int
        That node.
    """
    nx, ny, nz = shape
    parent = np.full(room.shape[0], -1, np.int64)
    for n in order:
        parent[n] = n
        i = n // (ny * nz)
        j = (n // nz) % ny
        k = n % nz
        for a in range(max(i - 1, 0), min(i + 2, nx)):
            for b in range(max(j - 1, 0), min(j + 2, ny)):
                for c in range(max(k - 1, 0), min(k + 2, nz)):
                    m = (a * ny + b) * nz + c
                    if parent[m] >= 0 and m != n:
                        p = _find(parent, m)
                        q = _find(parent, n)
                        if p != q:
                            parent[p] = q
        if parent[start] >= 0 and parent[goal] >= 0 and _find(parent, start) == _find(parent, goal):
            return room[n], n
    return -np.inf, -1
