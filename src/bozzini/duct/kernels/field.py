"""Numba kernels of the sampled field: small, scalar, in the field's own frame (mm from node 0).

A field is passed as ``values`` (float32, node distances to the wall before inflation), the three
spacings, and ``inflation``; the signed distance is the trilinear interpolant minus ``inflation``.
Outside the grid it is the value at the nearest point of the grid plus the distance to it, which
keeps it an upper bound of the lesser of distance and reach (never more room than there is).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def field_value(values, hx, hy, hz, inflation, x, y, z):
    """Signed distance at one point."""
    nx, ny, nz = values.shape
    fx = x / hx
    fy = y / hy
    fz = z / hz
    cx = min(max(fx, 0.0), nx - 1.0)
    cy = min(max(fy, 0.0), ny - 1.0)
    cz = min(max(fz, 0.0), nz - 1.0)
    i = min(int(cx), nx - 2)
    j = min(int(cy), ny - 2)
    k = min(int(cz), nz - 2)
    u = cx - i
    v = cy - j
    w = cz - k
    c00 = values[i, j, k] * (1.0 - w) + values[i, j, k + 1] * w
    c01 = values[i, j + 1, k] * (1.0 - w) + values[i, j + 1, k + 1] * w
    c10 = values[i + 1, j, k] * (1.0 - w) + values[i + 1, j, k + 1] * w
    c11 = values[i + 1, j + 1, k] * (1.0 - w) + values[i + 1, j + 1, k + 1] * w
    s = (c00 * (1.0 - v) + c01 * v) * (1.0 - u) + (c10 * (1.0 - v) + c11 * v) * u
    if cx != fx or cy != fy or cz != fz:
        dx = (fx - cx) * hx
        dy = (fy - cy) * hy
        dz = (fz - cz) * hz
        s += math.sqrt(dx * dx + dy * dy + dz * dz)
    return s - inflation


@njit(cache=True)
def field_and_gradient(values, hx, hy, hz, inflation, x, y, z):
    """Signed distance at one point, and the gradient of the interpolant there."""
    nx, ny, nz = values.shape
    fx = x / hx
    fy = y / hy
    fz = z / hz
    cx = min(max(fx, 0.0), nx - 1.0)
    cy = min(max(fy, 0.0), ny - 1.0)
    cz = min(max(fz, 0.0), nz - 1.0)
    i = min(int(cx), nx - 2)
    j = min(int(cy), ny - 2)
    k = min(int(cz), nz - 2)
    u = cx - i
    v = cy - j
    w = cz - k
    v000 = float(values[i, j, k])
    v001 = float(values[i, j, k + 1])
    v010 = float(values[i, j + 1, k])
    v011 = float(values[i, j + 1, k + 1])
    v100 = float(values[i + 1, j, k])
    v101 = float(values[i + 1, j, k + 1])
    v110 = float(values[i + 1, j + 1, k])
    v111 = float(values[i + 1, j + 1, k + 1])
    c00 = v000 * (1.0 - w) + v001 * w
    c01 = v010 * (1.0 - w) + v011 * w
    c10 = v100 * (1.0 - w) + v101 * w
    c11 = v110 * (1.0 - w) + v111 * w
    c0 = c00 * (1.0 - v) + c01 * v
    c1 = c10 * (1.0 - v) + c11 * v
    s = c0 * (1.0 - u) + c1 * u
    gx = (c1 - c0) / hx
    gy = ((c01 - c00) * (1.0 - u) + (c11 - c10) * u) / hy
    g0 = (v001 - v000) * (1.0 - v) + (v011 - v010) * v
    g1 = (v101 - v100) * (1.0 - v) + (v111 - v110) * v
    gz = (g0 * (1.0 - u) + g1 * u) / hz
    if cx != fx or cy != fy or cz != fz:
        dx = (fx - cx) * hx
        dy = (fy - cy) * hy
        dz = (fz - cz) * hz
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        s += distance
        if dx != 0.0:
            gx = dx / distance
        if dy != 0.0:
            gy = dy / distance
        if dz != 0.0:
            gz = dz / distance
    return s - inflation, gx, gy, gz


@njit(cache=True, parallel=False)
def evaluate_field(values, hx, hy, hz, inflation, points, distance, gradient):
    """Fill `distance` (n,) and, if it has rows, `gradient` (n, 3) at `points` (n, 3)."""
    with_gradient = gradient.shape[0] == points.shape[0]
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if with_gradient:
            s, gx, gy, gz = field_and_gradient(values, hx, hy, hz, inflation, x, y, z)
            distance[n] = s
            gradient[n, 0] = gx
            gradient[n, 1] = gy
            gradient[n, 2] = gz
        else:
            distance[n] = field_value(values, hx, hy, hz, inflation, x, y, z)


@njit(cache=True)
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


@njit(cache=True)
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
