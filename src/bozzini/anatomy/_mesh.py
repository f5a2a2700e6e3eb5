"""Bookkeeping on triangles with NumPy: edges, parts, fans, winding."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Edges",
    "agree",
    "count_edges",
    "count_fans",
    "drop_degenerate",
    "fill_small_holes",
    "label_parts",
    "measure_part_volumes",
    "measure_volume",
    "weld",
]

Vertices = NDArray[np.float64]
Faces = NDArray[np.int64]


class Edges(NamedTuple):
    """The edges of a mesh: pairs of vertices (n, 2), and how many triangles each has (n,)."""

    pairs: NDArray[np.int64]
    counts: NDArray[np.int64]


def weld(points: Vertices, faces: Faces, *, tolerance: float = 0.0) -> tuple[Vertices, Faces]:
    """Merge equal vertices, or those within about `tolerance` [mm] of each other."""
    if tolerance > 0:
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        pairs = cKDTree(points).query_pairs(tolerance, output_type="ndarray")
        ones = np.ones(len(pairs), dtype=np.int8)
        graph = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
        _, group = connected_components(graph, directed=False)
        _, first, index = np.unique(group, return_index=True, return_inverse=True)
    else:
        points = points + 0.0  # -0.0 and 0.0 are one place
        order = np.lexsort(points.T)
        fresh = np.ones(len(points), dtype=bool)
        fresh[1:] = (points[order[1:]] != points[order[:-1]]).any(axis=1)
        first = order[fresh]
        index = np.empty(len(points), dtype=np.int64)
        index[order] = np.cumsum(fresh) - 1
    return points[first], index.reshape(-1)[faces].astype(np.int64)


def drop_degenerate(faces: Faces) -> Faces:
    """Drop triangles with two equal corners, and every second copy of a triangle."""
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    if len(faces) == 0:
        return faces
    key = np.sort(faces, axis=1)
    order = np.lexsort(key.T)
    fresh = np.ones(len(faces), dtype=bool)
    fresh[1:] = (key[order[1:]] != key[order[:-1]]).any(axis=1)
    return faces[np.sort(order[fresh])]


def _directed(faces: Faces) -> NDArray[np.int64]:
    """Edges (3 m, 2): those from corner 0 to 1 of all faces, then 1 to 2, then 2 to 0."""
    return np.concatenate((faces[:, (0, 1)], faces[:, (1, 2)], faces[:, (2, 0)]))


def count_edges(faces: Faces) -> Edges:
    """Return the edges and the number of triangles at each."""
    pairs = np.sort(_directed(faces), axis=1)
    width = int(faces.max()) + 1
    key, counts = np.unique(pairs[:, 0] * width + pairs[:, 1], return_counts=True)
    return Edges(np.stack((key // width, key % width), axis=1), counts)


def label_parts(items: NDArray[np.int64], number: int) -> NDArray[np.int64]:
    """Number the connected parts of faces or edges (m, k) that share vertices, shape (m,)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    rows = np.concatenate([items[:, 0]] * (items.shape[1] - 1))
    columns = np.concatenate([items[:, k] for k in range(1, items.shape[1])])
    ones = np.ones(len(rows), dtype=np.int8)
    graph = coo_matrix((ones, (rows, columns)), shape=(number, number))
    _, part = connected_components(graph, directed=False)
    _, label = np.unique(part[items[:, 0]], return_inverse=True)
    return np.asarray(label.reshape(-1), dtype=np.int64)


def measure_part_volumes(
    points: Vertices, faces: Faces, part: NDArray[np.int64], number: int
) -> NDArray[np.float64]:
    """Return the signed volume of each part [mm^3], exact where the part is closed."""
    corners = points[faces] - points.mean(axis=0)
    signed = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    return np.asarray(np.bincount(part, weights=signed, minlength=number), dtype=np.float64)


def measure_volume(points: Vertices, faces: Faces) -> float:
    """Return the signed volume [mm^3]: positive where faces turn outwards."""
    return float(measure_part_volumes(points, faces, np.zeros(len(faces), dtype=np.int64), 1)[0])


def fill_small_holes(points: Vertices, faces: Faces) -> tuple[Vertices, Faces]:
    """Fill holes of three or four edges."""
    import trimesh

    from ._quiet import quiet_libraries

    with quiet_libraries():
        mesh = trimesh.Trimesh(vertices=points, faces=faces, process=False)
        trimesh.repair.fill_holes(mesh)
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)


def agree(faces: Faces, number: int) -> tuple[Faces, int]:
    """Turn faces so that neighbours agree; return them and how many were turned.

    An edge of two triangles must be run through once each way. The turns are found on the graph
    of neighbours doubled into "as it is" and "turned" copies. Within a part the smaller number
    is turned. Where no choice agrees everywhere (a one-sided surface) the faces stay as they are.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    directed = _directed(faces)
    key = np.sort(directed, axis=1) @ np.array([number, 1])
    forward = directed[:, 0] < directed[:, 1]
    face = np.tile(np.arange(len(faces)), 3)
    order = np.argsort(key, kind="stable")
    key, forward, face = key[order], forward[order], face[order]
    first = np.flatnonzero(np.r_[True, key[1:] != key[:-1]])
    first = first[np.diff(np.r_[first, len(key)]) == 2]  # only edges of exactly two triangles
    one, other, clash = face[first], face[first + 1], forward[first] == forward[first + 1]
    if not clash.any():
        return faces, 0
    m = len(faces)
    rows = np.concatenate((one, one + m))
    columns = np.concatenate((other + m * clash, other + m * ~clash))
    graph = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * m, 2 * m))
    count, part = connected_components(graph, directed=False)
    plain, flipped = part[:m], part[m:]
    if (plain == flipped).any():
        return faces, 0
    votes = np.bincount(plain, minlength=count)  # of a part's two copies, the one of more votes
    turn = (votes[flipped] > votes[plain]) | ((votes[flipped] == votes[plain]) & (flipped < plain))
    result = faces.copy()
    result[turn] = result[turn, ::-1]
    return result, int(np.count_nonzero(turn))


def count_fans(faces: Faces) -> tuple[int, int]:
    """Count the fans of triangles around vertices, and the sheets of triangles.

    Corners of two triangles at one vertex are joined into a fan, and the triangles into a sheet,
    where the triangles share an edge that has no other triangle. There are more fans than
    vertices where a surface touches itself.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    m = len(faces)
    directed = _directed(faces)
    width = int(faces.max()) + 1
    key = np.sort(directed, axis=1) @ np.array([width, 1])
    face = np.tile(np.arange(m), 3)
    start = np.repeat([0, 1, 2], m)  # the corner at which the edge starts
    swap = directed[:, 0] > directed[:, 1]
    end = (start + 1) % 3
    low = face * 3 + np.where(swap, end, start)
    high = face * 3 + np.where(swap, start, end)
    order = np.argsort(key, kind="stable")
    key, low, high = key[order], low[order], high[order]
    first = np.flatnonzero(np.r_[True, key[1:] != key[:-1]])
    first = first[np.diff(np.r_[first, len(key)]) == 2]
    rows = np.concatenate((low[first], high[first]))
    columns = np.concatenate((low[first + 1], high[first + 1]))
    counts = []
    for size, one, other in ((3 * m, rows, columns), (m, rows // 3, columns // 3)):
        ones = np.ones(len(one), dtype=np.int8)
        graph = coo_matrix((ones, (one, other)), shape=(size, size))
        counts.append(int(connected_components(graph, directed=False)[0]))
    return counts[0], counts[1]
