"""Which places a cloud of wall samples keeps apart: balls about them, by their Delaunay cells.

Balls of one radius about the samples keep two places apart exactly if their tetrahedra are not
joined through triangles that the balls leave open (Edelsbrunner, Discrete Comput. Geom. 13,
1995: the balls' union and its alpha shape have the same complement, up to homotopy). The way
through a triangle runs between the centres of its tetrahedra's circumspheres, equally far from
its corners all along. It is nearest to them in the middle of the triangle's own circle, or, where
a fourth corner lies in the ball of that circle, at one of its ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Cells", "find_cells", "find_opening", "make_cells"]


FLAT = 1e-9
"""A cell is flat, a triangle a needle, or a corner on a circle, within this share of its size."""


class Cells(NamedTuple):
    """Delaunay cells of samples, and what joins them.

    Attributes
    ----------
    samples : (n, 3) float
        Where they are [mm].
    corners, neighbours : (m, 4) int
        Samples of each cell, and the cell beyond the side opposite to each, -1 for none.
    centres, radii : (m, 3) and (m,) float
        Of the circumspheres [mm]; infinite for flat cells.
    gates : (g, 2) int
        Cells on both sides of each triangle, -1 for outside the hull.
    widths : (g,) float
        Radius of the largest ball that passes each triangle [mm].
    groups : (m,) int
        Which cells are joined by open triangles; group 0 is joined with the outside.
    """

    samples: NDArray[np.float64]
    corners: NDArray[np.int64]
    neighbours: NDArray[np.int64]
    centres: NDArray[np.float64]
    radii: NDArray[np.float64]
    gates: NDArray[np.int64]
    widths: NDArray[np.float64]
    groups: NDArray[np.int64]


def make_cells(samples: NDArray[np.float64], radius: float) -> Cells:
    """Return the cells of samples (n, 3), not all in a plane, whose balls have `radius` [mm]."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import Delaunay

    delaunay = Delaunay(samples)
    cells = delaunay.simplices.astype(np.int64)
    neighbours = delaunay.neighbors.astype(np.int64)
    centres, radii = _find_spheres(samples, cells)
    gates, widths = _measure_gates(samples, cells, neighbours, radii)
    wide = gates[widths > radius] + 1  # node 0 is the outside
    count = len(cells) + 1
    graph = coo_matrix((np.ones(len(wide), np.int8), (wide[:, 0], wide[:, 1])), (count, count))
    _, label = connected_components(graph, directed=False)
    _, groups = np.unique(np.where(label == label[0], -1, label), return_inverse=True)
    groups = groups.reshape(-1)[1:].astype(np.int64)
    return Cells(samples, cells, neighbours, centres, radii, gates, widths, groups)


def _find_spheres(
    samples: NDArray[np.float64], cells: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return centres (m, 3) and radii (m,) of the circumspheres; infinite for flat cells."""
    a, b, c, d = np.moveaxis(samples[cells], 1, 0)
    b, c, d = b - a, c - a, d - a
    bc, cd, db = np.cross(b, c), np.cross(c, d), np.cross(d, b)
    squares = [np.einsum("ij,ij->i", side, side) for side in (b, c, d)]
    volume = np.einsum("ij,ij->i", b, cd)
    flat = np.abs(volume) <= FLAT * np.max(squares, axis=0) ** 1.5
    top = squares[0][:, None] * cd + squares[1][:, None] * db + squares[2][:, None] * bc
    centre = top / np.where(flat, 1.0, 2.0 * volume)[:, None]
    radii = np.where(flat, np.inf, np.linalg.norm(centre, axis=1))
    return np.where(flat[:, None], np.inf, a + centre), radii


def _measure_gates(
    samples: NDArray[np.float64],
    cells: NDArray[np.int64],
    neighbours: NDArray[np.int64],
    radii: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the cells on both sides of every triangle, and its width."""
    cell, corner = np.nonzero(np.arange(len(cells))[:, None] > neighbours)
    other = neighbours[cell, corner]
    shared = cells[cell[:, None], (corner[:, None] + np.array([1, 2, 3])) % 4]
    a, b, c = np.moveaxis(samples[shared], 1, 0)
    b, c = b - a, c - a
    normal = np.cross(b, c)
    square = np.einsum("ij,ij->i", normal, normal)
    bb, cc = np.einsum("ij,ij->i", b, b), np.einsum("ij,ij->i", c, c)
    thin = square <= (FLAT * np.maximum(bb, cc)) ** 2  # a needle: its circle is not known
    top = bb[:, None] * np.cross(c, normal) + cc[:, None] * np.cross(normal, b)
    middle = top / np.where(thin, 1.0, 2.0 * square)[:, None]
    radius = np.linalg.norm(middle, axis=1)
    middle = middle + a
    outside = other < 0
    # The fourth corners: the one of the cell, and the one of the neighbour that is not shared.
    fourth = cells[cell, corner]
    beyond = np.where(outside, fourth, cells[other].sum(axis=1) - shared.sum(axis=1))
    nearest = np.minimum(
        np.linalg.norm(samples[fourth] - middle, axis=1),
        np.linalg.norm(samples[beyond] - middle, axis=1),
    )
    at_ends = np.minimum(radii[cell], np.where(outside, np.inf, radii[other]))
    empty = (nearest >= radius * (1.0 - FLAT)) & ~thin
    return np.stack([cell, other], axis=1), np.where(empty, radius, at_ends)


def find_cells(cells: Cells, points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the cell (n,) of each point (n, 3), -1 outside the samples' hull."""
    from ._cloud_kernels import locate_cells

    found = np.empty(len(points), dtype=np.int64)
    locate_cells(cells.samples, cells.corners, cells.neighbours, points, found)
    return found


def find_opening(cells: Cells, cell: int) -> tuple[float, int]:
    """Return the width of the widest way from a cell to the outside, and its narrowest gate."""
    parent = np.arange(len(cells.groups) + 1)

    def find(k: int) -> int:
        while parent[k] != k:
            parent[k] = parent[parent[k]]
            k = int(parent[k])
        return k

    for gate in np.argsort(-cells.widths):
        a, b = (find(int(k) + 1) for k in cells.gates[gate])
        parent[a] = b
        if find(0) == find(cell + 1):
            return float(cells.widths[gate]), int(gate)
    return 0.0, 0
