"""Bookkeeping on triangles with NumPy: edges, parts, sheets, fans, holes, winding."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Edges",
    "Hole",
    "agree",
    "count_edges",
    "count_fans",
    "drop_degenerate",
    "fill_small_holes",
    "find_holes",
    "label_fans",
    "label_parts",
    "label_sheets",
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


class Hole(NamedTuple):
    """A hole of a surface, and the flat cap that closes it.

    Attributes
    ----------
    point : (3,) float
        Middle of its border [mm].
    radius : float
        Of the circle of the area that the border encloses [mm].
    deviation : float
        Farthest of its border from the plane through its middle [mm].
    length : float
        Of its border [mm].
    edges : (k, 2) int
        Its border, in the sense in which the cap runs through it.
    """

    point: NDArray[np.float64]
    radius: float
    deviation: float
    length: float
    edges: NDArray[np.int64]


def find_holes(points: Vertices, faces: Faces) -> list[Hole]:
    """Return the holes of triangles that agree in their turn, the largest first.

    A border edge is one that is not run through as often one way as the other. Triangles from the
    border's edges to its middle, ``(a, b, middle)``, close the surface exactly.
    """
    directed = _directed(faces)
    width = int(faces.max()) + 1
    forward = directed[:, 0] < directed[:, 1]
    key, index = np.unique(np.sort(directed, axis=1) @ np.array([width, 1]), return_inverse=True)
    net = np.bincount(index.reshape(-1), weights=np.where(forward, 1.0, -1.0), minlength=len(key))
    net = np.rint(net).astype(np.int64)
    pairs = np.stack((key // width, key % width), axis=1)
    back = np.where((net > 0)[:, None], pairs[:, ::-1], pairs)  # the cap runs the other way
    edges = np.repeat(back, np.abs(net), axis=0)
    if len(edges) == 0:
        return []
    loop = label_parts(edges, width)
    holes = []
    for k in range(int(loop.max()) + 1):
        border = edges[loop == k]
        start, end = points[border[:, 0]], points[border[:, 1]]
        lengths = np.linalg.norm(end - start, axis=1)
        total = float(lengths.sum())
        weights = lengths / total if total > 0.0 else np.full(len(lengths), 1.0 / len(lengths))
        middle = np.asarray((0.5 * (start + end) * weights[:, None]).sum(axis=0))
        area = 0.5 * np.cross(start - middle, end - middle).sum(axis=0)
        size = float(np.linalg.norm(area))
        radius = float(np.sqrt(size / np.pi))
        off = (start - middle) @ area / size if size > 0.0 else np.linalg.norm(start - middle)
        holes.append(Hole(middle, radius, float(np.abs(off).max()), total, border))
    return sorted(holes, key=lambda hole: -hole.radius)


def fill_small_holes(points: Vertices, faces: Faces) -> tuple[Faces, list[Hole]]:
    """Fill holes of three or four edges with one or two triangles; return the holes filled."""
    faces, _ = agree(faces, len(points))
    filled, caps = [], [faces]
    for hole in find_holes(points, faces):
        following = {int(a): int(b) for a, b in hole.edges}
        ring = [int(hole.edges[0, 0])]
        while len(ring) < len(hole.edges) and following.get(ring[-1], ring[0]) != ring[0]:
            ring.append(following[ring[-1]])
        if len(hole.edges) > 4 or len(ring) != len(hole.edges):
            continue
        caps += [np.array([(ring[0], ring[k], ring[k + 1])]) for k in range(1, len(ring) - 1)]
        filled.append(hole)
    return np.concatenate(caps), filled


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


def _pair_corners(faces: Faces) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the corners (3 face + corner) that meet across edges of exactly two triangles."""
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
    return (
        np.concatenate((low[first], high[first])),
        np.concatenate((low[first + 1], high[first + 1])),
    )


def _join(
    one: NDArray[np.int64], other: NDArray[np.int64], size: int
) -> tuple[int, NDArray[np.int64]]:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    ones = np.ones(len(one), dtype=np.int8)
    graph = coo_matrix((ones, (one, other)), shape=(size, size))
    number, label = connected_components(graph, directed=False)
    return int(number), np.asarray(label, dtype=np.int64)


def label_sheets(faces: Faces) -> tuple[int, NDArray[np.int64]]:
    """Number the sheets (m,): triangles joined by edges that have no third triangle."""
    rows, columns = _pair_corners(faces)
    return _join(rows // 3, columns // 3, len(faces))


def label_fans(faces: Faces) -> tuple[int, NDArray[np.int64]]:
    """Number the fans of triangles around vertices, for each corner (m, 3).

    Corners of two triangles at one vertex belong to one fan where the triangles share an edge that
    has no third triangle. There are more fans than vertices where a surface touches itself.
    """
    rows, columns = _pair_corners(faces)
    number, label = _join(rows, columns, 3 * len(faces))
    return number, label.reshape(-1, 3)


def count_fans(faces: Faces) -> tuple[int, int]:
    """Count the fans of triangles around vertices, and the sheets of triangles."""
    return label_fans(faces)[0], label_sheets(faces)[0]
