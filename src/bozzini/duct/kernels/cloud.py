"""Numba kernel of a cloud of samples: in which Delaunay cell points lie."""

from __future__ import annotations

from numba import njit


@njit(cache=True)
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


@njit(cache=True)
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
