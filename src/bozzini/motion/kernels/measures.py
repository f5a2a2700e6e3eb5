"""Numba kernels of the widest way between two nodes of a grid."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

# Numba kernels of measures: how far joints travel, and by the pure tractrix on the same path.


@njit(cache=True)
def total_travel(joints):
    """Return the sum over steps and joints of how far each joint moves [mm]."""
    total = 0.0
    for t in range(1, joints.shape[0]):
        for j in range(joints.shape[1]):
            square = 0.0
            for k in range(joints.shape[2]):
                square += (joints[t, j, k] - joints[t - 1, j, k]) ** 2
            total += math.sqrt(square)
    return total


@njit(cache=True)
def tractrix_travel(heads, chain, length):
    """Return the same sum for a free chain pulled along `heads` (steps, dim).

    Each joint is pulled straight towards the one before (thesis eq. 5.13, the discrete tractrix,
    first order in the head step). `chain` (joints, dim) is changed in place.
    """
    total = 0.0
    dim = chain.shape[1]
    for t in range(heads.shape[0]):
        square = 0.0
        for k in range(dim):
            square += (heads[t, k] - chain[0, k]) ** 2
            chain[0, k] = heads[t, k]
        total += math.sqrt(square)
        for j in range(1, chain.shape[0]):
            size = 0.0
            for k in range(dim):
                size += (chain[j, k] - chain[j - 1, k]) ** 2
            size = math.sqrt(size)
            scale = length / max(size, 1e-300)
            square = 0.0
            for k in range(dim):
                moved = chain[j - 1, k] + scale * (chain[j, k] - chain[j - 1, k])
                square += (moved - chain[j, k]) ** 2
                chain[j, k] = moved
            total += math.sqrt(square)
    return total


@njit(cache=True)
def _find(parent, n):
    while parent[n] != n:
        parent[n] = parent[parent[n]]
        n = parent[n]
    return n


@njit(cache=True)
def widest_level(room, nodes, order, place, start, goal):
    """Add nodes from the roomiest on until start and goal are connected (26 neighbours).

    Parameters
    ----------
    room : (n,) float
        Of the nodes that may be on the way.
    nodes : (n,) int
        Their flat indices in the grid.
    order : (n,) int
        Their numbers by falling room.
    place : (nx, ny, nz) int32
        -1 everywhere; filled with where in `order` a node is.
    start, goal : int
        Numbers.

    Returns
    -------
    level : float
        The room of the last node added: no way on the grid has more everywhere; -inf if none.
    node : int
        Its number, -1 if none.
    """
    nx, ny, nz = place.shape
    parent = np.full(room.shape[0], -1, np.int32)
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
            return room[n], n
    return -np.inf, -1


@njit(cache=True)
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
