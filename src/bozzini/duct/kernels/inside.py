"""Numba kernels of a triangle mesh: its winding number about points, counted along a ray.

Triangles are projected along one axis, onto the plane (p, q) of the two others, and sorted into a
grid of columns. The winding number about a point is the number of triangles met by the ray from
it up the axis, those turned along it positive. Whether a column's triangle is met is the winding
number of its projection, a sum over its edges that is antisymmetric in each edge's direction: so
over a closed mesh nothing is counted twice or lost, edges and corners hit included.
"""

from __future__ import annotations

import numpy as np

from ...numeric.compiling import kernel


@kernel
def _column_range(vertices, faces, f, p, q, low_p, low_q, cell, shape):
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    p0 = min(vertices[a, p], vertices[b, p], vertices[c, p])
    p1 = max(vertices[a, p], vertices[b, p], vertices[c, p])
    q0 = min(vertices[a, q], vertices[b, q], vertices[c, q])
    q1 = max(vertices[a, q], vertices[b, q], vertices[c, q])
    i0 = min(max(int((p0 - low_p) / cell), 0), shape[0] - 1)
    i1 = min(max(int((p1 - low_p) / cell), 0), shape[0] - 1)
    j0 = min(max(int((q0 - low_q) / cell), 0), shape[1] - 1)
    j1 = min(max(int((q1 - low_q) / cell), 0), shape[1] - 1)
    return i0, i1, j0, j1


@kernel
def fill_columns(vertices, faces, p, q, low_p, low_q, cell, shape):
    """Return (first, members): the triangles of column k are members[first[k]:first[k + 1]]."""
    first = np.zeros(shape[0] * shape[1] + 1, dtype=np.int64)
    for f in range(faces.shape[0]):
        i0, i1, j0, j1 = _column_range(vertices, faces, f, p, q, low_p, low_q, cell, shape)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                first[i * shape[1] + j + 1] += 1
    for k in range(first.shape[0] - 1):
        first[k + 1] += first[k]
    place = first[:-1].copy()
    members = np.empty(first[-1], dtype=np.int64)
    for f in range(faces.shape[0]):
        i0, i1, j0, j1 = _column_range(vertices, faces, f, p, q, low_p, low_q, cell, shape)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                members[place[i * shape[1] + j]] = f
                place[i * shape[1] + j] += 1
    return first, members


@kernel
def _edge_winding(vertices, a, b, p, q, x, y):
    """+1 or -1 where the edge from a to b, projected, crosses the ray from (x, y) along p."""
    up = vertices[b, q] > y
    if (vertices[a, q] > y) == up:
        return 0
    # The same numbers whichever way round the edge is run through.
    low, high = (a, b) if a < b else (b, a)
    ep = vertices[high, p] - vertices[low, p]
    eq = vertices[high, q] - vertices[low, q]
    turn = ep * (y - vertices[low, q]) - eq * (x - vertices[low, p])
    if (turn > 0.0) != (eq > 0.0):
        return 0
    return 1 if up else -1


@kernel
def count_windings(vertices, faces, first, members, p, q, r, low_p, low_q, cell, shape, points, w):
    """Fill `w` (n,) with the winding number of a closed mesh about `points` (n, 3).

    The ray goes up axis `r`; (p, q, r) is an even permutation of the axes.
    """
    for n in range(points.shape[0]):
        w[n] = 0
        x = points[n, p]
        y = points[n, q]
        z = points[n, r]
        fi = (x - low_p) / cell
        fj = (y - low_q) / cell
        if not (0.0 <= fi < shape[0] and 0.0 <= fj < shape[1]):
            continue
        k = int(fi) * shape[1] + int(fj)
        for m in range(first[k], first[k + 1]):
            f = members[m]
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            if z >= max(vertices[a, r], vertices[b, r], vertices[c, r]):
                continue
            turn = (
                _edge_winding(vertices, a, b, p, q, x, y)
                + _edge_winding(vertices, b, c, p, q, x, y)
                + _edge_winding(vertices, c, a, p, q, x, y)
            )
            if turn == 0:
                continue
            ax = vertices[b, p] - vertices[a, p]
            ay = vertices[b, q] - vertices[a, q]
            az = vertices[b, r] - vertices[a, r]
            bx = vertices[c, p] - vertices[a, p]
            by = vertices[c, q] - vertices[a, q]
            bz = vertices[c, r] - vertices[a, r]
            side = (
                (ay * bz - az * by) * (x - vertices[a, p])
                + (az * bx - ax * bz) * (y - vertices[a, q])
                + (ax * by - ay * bx) * (z - vertices[a, r])
            )
            if side * turn < 0.0:
                w[n] += turn


# In which Delaunay cell of a cloud of samples points lie.


@kernel
def _side(points, a, b, c, x, y, z):
    """Six times the signed volume of corners a, b, c and (x, y, z)."""
    ax = points[a, 0] - x
    ay = points[a, 1] - y
    az = points[a, 2] - z
    bx = points[b, 0] - x
    by = points[b, 1] - y
    bz = points[b, 2] - z
    cx = points[c, 0] - x
    cy = points[c, 1] - y
    cz = points[c, 2] - z
    return ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)


@kernel
def locate_cells(points, cells, neighbours, places, found):
    """Fill `found` (n,) with the cell that holds each of `places` (n, 3), -1 outside the hull.

    From the last cell found, through any side that the place lies beyond: among Delaunay cells
    that leads to the place without a circle (Devillers, Pion and Teillaud 2002). Should rounding
    make one, the place counts as outside.
    """
    cell = 0
    for n in range(places.shape[0]):
        x = places[n, 0]
        y = places[n, 1]
        z = places[n, 2]
        before = -1
        found[n] = -1
        for _ in range(cells.shape[0] + 4):
            following = -2
            for k in range(4):
                if neighbours[cell, k] >= 0 and neighbours[cell, k] == before:
                    continue
                a = cells[cell, (k + 1) % 4]
                b = cells[cell, (k + 2) % 4]
                c = cells[cell, (k + 3) % 4]
                d = cells[cell, k]
                own = _side(points, a, b, c, points[d, 0], points[d, 1], points[d, 2])
                there = _side(points, a, b, c, x, y, z)
                if (own > 0.0 and there < 0.0) or (own < 0.0 and there > 0.0):
                    following = neighbours[cell, k]
                    break
            if following == -2:
                found[n] = cell
                break
            if following == -1:
                break
            before = cell
            cell = following
