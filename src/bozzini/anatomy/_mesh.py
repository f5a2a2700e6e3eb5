"""Triangles: welding, edges, connected parts, sheets, fans, holes and winding."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vertices = NDArray[np.float64]
Faces = NDArray[np.int64]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]

MOST_PLACES = 100
"""Corners of a sheet that are asked whether they lie inside another."""


def weld(
    points: Vertices, faces: Faces, *, tolerance: float = 0.0, among: Integers | None = None
) -> tuple[Vertices, Faces]:
    """Merge equal vertices, or those (of `among`) within about `tolerance` [mm] of each other."""
    if tolerance > 0:
        from scipy.spatial import cKDTree

        chosen = np.arange(len(points)) if among is None else among
        pairs = chosen[cKDTree(points[chosen]).query_pairs(tolerance, output_type="ndarray")]
        group = label_graph(pairs, len(points))
        _, first, index = np.unique(group, return_index=True, return_inverse=True)
    else:
        first, index = _find_unique(points + 0.0)  # -0.0 and 0.0 are one place
    return points[first], index.reshape(-1)[faces].astype(np.int64)


def _find_unique(rows: Vertices) -> tuple[Integers, Integers]:
    """Return the first of each set of equal rows, and the set of each row.

    trimesh rounds to 1e-8, which would join parts that almost meet in a corner.
    """
    order = np.lexsort(rows.T)
    fresh = np.ones(len(rows), dtype=bool)
    fresh[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    index = np.empty(len(rows), dtype=np.int64)
    index[order] = np.cumsum(fresh) - 1
    return order[fresh], index


def drop_degenerate(faces: Faces) -> Faces:
    """Drop triangles with two equal corners, and every second copy of a triangle."""
    from trimesh.grouping import unique_rows

    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    return faces[np.sort(unique_rows(np.sort(faces, axis=1))[0])] if len(faces) else faces


def label_graph(pairs: Integers, number: int) -> Integers:
    """Number the connected components of a graph, the same number for joined nodes."""
    from trimesh.graph import connected_component_labels

    return np.asarray(connected_component_labels(pairs, node_count=number), dtype=np.int64)


def label_parts(items: Integers, number: int) -> Integers:
    """Number the connected parts of faces or edges (m, k) that share vertices, shape (m,)."""
    pairs = np.concatenate([items[:, (0, k)] for k in range(1, items.shape[1])])
    return _count_up(label_graph(pairs, number)[items[:, 0]])


def split_by(faces: Faces, label: Integers) -> list[Faces]:
    """Return the faces of each label from 0 on."""
    order = np.argsort(label, kind="stable")
    return np.split(faces[order], np.cumsum(np.bincount(label))[:-1])


class MeshEdges(NamedTuple):
    """The edges of a mesh, lower vertex first (n, 2), and how many triangles each has (n,).

    `net` is how much more often an edge is run through upwards than downwards.
    """

    pairs: Integers
    counts: Integers
    net: Integers


def count_edges(faces: Faces) -> MeshEdges:
    """Return the edges, and the number and direction of the triangles at each."""
    directed = np.concatenate((faces[:, (0, 1)], faces[:, (1, 2)], faces[:, (2, 0)]))
    width = int(faces.max()) + 1
    key, index, counts = np.unique(
        np.sort(directed, axis=1) @ np.array([width, 1]), return_inverse=True, return_counts=True
    )
    way = np.where(directed[:, 0] < directed[:, 1], 1.0, -1.0)
    net = np.rint(np.bincount(index.reshape(-1), weights=way, minlength=len(key)))
    return MeshEdges(np.stack((key // width, key % width), axis=1), counts, net.astype(np.int64))


def measure_part_volumes(
    points: Vertices, faces: Faces, part: Integers, number: int
) -> NDArray[np.float64]:
    """Return the signed volume of each part [mm^3], exact where the part is closed."""
    corners = points[faces] - points.mean(axis=0)
    signed = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    return np.asarray(np.bincount(part, weights=signed, minlength=number), dtype=np.float64)


def measure_volume(points: Vertices, faces: Faces) -> float:
    """Return the signed volume [mm^3]: positive where faces turn outwards."""
    return float(measure_part_volumes(points, faces, np.zeros(len(faces), dtype=np.int64), 1)[0])


def measure_area(points: Vertices, faces: Faces) -> float:
    """Return the area [mm^2]."""
    from trimesh.triangles import area

    return float(area(points[faces]).sum())


def wind(points: Vertices, faces: Faces, places: Vertices) -> NDArray[np.float64]:
    """Return the winding number of triangles about places."""
    import igl

    arrays = (np.ascontiguousarray(array) for array in (points, faces, places))
    return np.asarray(igl.fast_winding_number(*arrays), dtype=np.float64)


def find_nearest(
    points: Vertices, faces: Faces, places: Vertices
) -> tuple[NDArray[np.float64], Integers]:
    """Return the distance of places from triangles [mm], and the nearest triangle of each."""
    import igl

    mesh = np.ascontiguousarray(points), np.ascontiguousarray(faces)
    boxes = igl.AABB()
    boxes.init(*mesh)
    squared, nearest, _ = boxes.squared_distance(*mesh, np.ascontiguousarray(places))
    return np.sqrt(squared), np.asarray(nearest)


def find_crossing(points: Vertices, faces: Faces, group: Integers | None = None) -> Mask:
    """Return which triangles cross one of another group; without groups, any other triangle."""
    from .kernels.meshes import cross_groups

    faces = np.ascontiguousarray(faces)
    extent = np.ptp(points[faces], axis=1).max(axis=1)
    # A cell of about two triangles; the kernel enlarges it where triangles differ much.
    cell = max(2.0 * float(np.median(extent)), 1e-6 * float(np.ptp(points, axis=0).max()), 1e-9)
    groups = np.arange(len(faces)) if group is None else group
    return np.asarray(cross_groups(points, faces, cell, groups), dtype=np.bool_)


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
    edges: Integers


def find_holes(points: Vertices, faces: Faces) -> list[Hole]:
    """Return the holes of triangles that agree in their turn, the largest first.

    A border edge is one that is not run through as often one way as the other. Triangles from the
    border's edges to its middle, ``(a, b, middle)``, close the surface exactly.
    """
    pairs, _, net = count_edges(faces)
    back = np.where((net > 0)[:, None], pairs[:, ::-1], pairs)  # the cap runs the other way
    edges = np.repeat(back, np.abs(net), axis=0)
    if len(edges) == 0:
        return []
    holes = []
    for border in split_by(edges, label_parts(edges, int(faces.max()) + 1)):
        start, end = points[border[:, 0]], points[border[:, 1]]
        lengths = np.linalg.norm(end - start, axis=1)
        total = float(lengths.sum())
        weights = lengths / total if total > 0.0 else np.full(len(lengths), 1.0 / len(lengths))
        middle = np.asarray((0.5 * (start + end) * weights[:, None]).sum(axis=0))
        area = 0.5 * np.cross(start - middle, end - middle).sum(axis=0)
        size = float(np.linalg.norm(area))
        off = (start - middle) @ area / size if size > 0.0 else np.linalg.norm(start - middle)
        radius = float(np.sqrt(size / np.pi))
        holes.append(Hole(middle, radius, float(np.abs(off).max()), total, border))
    return sorted(holes, key=lambda hole: -hole.radius)


def fill_small_holes(points: Vertices, faces: Faces) -> tuple[Faces, list[Hole]]:
    """Fill holes of three or four edges with one or two triangles; return the holes filled."""
    faces, _ = agree(faces)
    filled, caps = [], [faces]
    for hole in find_holes(points, faces):
        following = {int(a): int(b) for a, b in hole.edges}
        ring = [int(hole.edges[0, 0])]
        while len(ring) < len(hole.edges) and following.get(ring[-1], ring[0]) != ring[0]:
            ring.append(following[ring[-1]])
        if len(hole.edges) <= 4 and len(ring) == len(hole.edges):
            caps += [np.array([(ring[0], ring[k], ring[k + 1])]) for k in range(1, len(ring) - 1)]
            filled.append(hole)
    return np.concatenate(caps), filled


def _pair_corners(faces: Faces) -> tuple[Integers, Integers]:
    """Return the pairs of faces that share an edge of exactly two, and the corners at its ends.

    Corners have the shape (pairs, 2 faces, 2 ends of the edge), each 0, 1 or 2.
    """
    from trimesh.graph import face_adjacency

    pairs, edges = face_adjacency(faces, return_edges=True)
    corners = (faces[pairs][:, :, None, :] == edges[:, None, :, None]).argmax(axis=3)
    return pairs, corners


def agree(faces: Faces) -> tuple[Faces, int]:
    """Turn faces so that neighbours agree; return them and how many were turned.

    An edge of two triangles must be run through once each way. The turns are found on the graph
    of neighbours doubled into "as it is" and "turned" copies. Within a part the smaller number
    is turned. A part in which no choice agrees everywhere (a one-sided surface) stays as it is.
    """
    pairs, corners = _pair_corners(faces)
    forward = (corners[:, :, 1] - corners[:, :, 0]) % 3 == 1
    clash = forward[:, 0] == forward[:, 1]
    if not clash.any():
        return faces, 0
    m = len(faces)
    one, other = pairs.T
    rows, columns = np.r_[one, one + m], np.r_[other + m * clash, other + m * ~clash]
    plain, flipped = np.split(label_graph(np.stack((rows, columns), axis=1), 2 * m), 2)
    votes = np.bincount(plain, minlength=2 * m)  # of a part's two copies, the one of more votes
    turn = (votes[flipped] > votes[plain]) | ((votes[flipped] == votes[plain]) & (flipped < plain))
    return np.where(turn[:, None], faces[:, ::-1], faces), int(np.count_nonzero(turn))


def turn_outwards(points: Vertices, faces: Faces, part: Integers) -> Faces:
    """Turn faces to agree, each closed sheet outwards, and one inside another of its part inwards.

    A part of several sheets is one whose sheets touch in a corner or an edge. The open ones of a
    part are turned together, by their volume.
    """
    faces, _ = agree(faces)
    fan, sheet = label_fans(faces)
    number = int(sheet.max()) + 1
    owner, group = np.zeros(int(fan.max()) + 1, dtype=np.int64), np.zeros(number, dtype=np.int64)
    owner[fan], group[sheet] = sheet[:, None], part
    edges = count_edges(fan)
    loose = np.zeros(number, dtype=bool)
    loose[owner[edges.pairs[edges.counts % 2 == 1, 0]]] = True
    volume = measure_part_volumes(points, faces, sheet, number)
    side = np.where(volume < 0.0, -1, 1)
    total = np.bincount(group[loose], weights=volume[loose], minlength=int(group.max()) + 1)
    side[loose] = np.where(total[group[loose]] < 0.0, -1, 1)
    shared = ~loose & (np.bincount(group[~loose], minlength=len(total))[group] > 1)
    for k in np.flatnonzero(shared):
        places = points[np.unique(faces[sheet == k])[:MOST_PLACES]]
        for j in np.flatnonzero(shared & (group == group[k]) & (np.abs(volume) > abs(volume[k]))):
            if np.median(np.abs(wind(points, faces[sheet == j], places))) > 0.5:
                side[k] = -side[k]
    return np.where((side[sheet] < 0)[:, None], faces[:, ::-1], faces)


def measure_sheets(points: Vertices, faces: Faces) -> float:
    """Return the volume of all sheets with flat caps, without regard to how they turn [mm^3]."""
    pieces = split_by(faces, label_sheets(faces))
    return sum(abs(SurfaceSheet.find(points, piece).volume) for piece in pieces)


def label_sheets(faces: Faces) -> Integers:
    """Number the sheets (m,): triangles joined by edges that have no third triangle."""
    return _count_up(label_graph(_pair_corners(faces)[0], len(faces)))


def label_fans(faces: Faces) -> tuple[Faces, Integers]:
    """Number the fans of triangles around vertices, for each corner (m, 3), and the sheets (m,).

    Corners of two triangles at one vertex belong to one fan where the triangles share an edge that
    has no third triangle. There are more fans than vertices where a surface touches itself.
    """
    pairs, corners = _pair_corners(faces)
    nodes = np.moveaxis(3 * pairs[:, :, None] + corners, 1, 2).reshape(-1, 2)
    fan = _count_up(label_graph(nodes, 3 * len(faces)))
    return fan.reshape(-1, 3), _count_up(label_graph(pairs, len(faces)))


def _count_up(label: Integers) -> Integers:
    """Return labels as numbers without gaps, from 0 on."""
    return np.unique(label, return_inverse=True)[1].reshape(-1)


@dataclass(frozen=True, kw_only=True)
class SurfaceSheet:
    """Triangles that agree in their turn, joined by edges that have no third triangle.

    Attributes
    ----------
    faces : (m, 3) int
    holes : list of Hole
        Where it is open.
    volume : float
        With flat caps, positive where the triangles turn outwards [mm^3].
    area : float
        Without caps [mm^2].
    """

    faces: Faces
    holes: list[Hole]
    volume: float
    area: float

    @staticmethod
    def find(points: Vertices, faces: Faces) -> SurfaceSheet:
        """Make the faces agree, and measure them."""
        faces, _ = agree(faces)
        holes = find_holes(points, faces)
        volume = measure_volume(*close_holes(points, faces, holes))
        return SurfaceSheet(
            faces=faces, holes=holes, volume=volume, area=measure_area(points, faces)
        )

    def close(self, points: Vertices) -> tuple[Vertices, Faces]:
        """Return corners and triangles with flat caps."""
        return close_holes(points, self.faces, self.holes)

    def turn_outwards(self) -> SurfaceSheet:
        """Return the same sheet, its triangles turned outwards."""
        if self.volume >= 0.0:
            return self
        holes = [hole._replace(edges=hole.edges[:, ::-1]) for hole in self.holes]
        faces = np.ascontiguousarray(self.faces[:, ::-1])
        return SurfaceSheet(faces=faces, holes=holes, volume=-self.volume, area=self.area)


def close_holes(points: Vertices, faces: Faces, holes: list[Hole]) -> tuple[Vertices, Faces]:
    """Close holes by triangles from their border to its middle."""
    if not holes:
        return points, faces
    middles = [hole.point for hole in holes]
    caps = [
        np.column_stack((hole.edges, np.full(len(hole.edges), len(points) + k)))
        for k, hole in enumerate(holes)
    ]
    return np.concatenate((points, middles)), np.concatenate((faces, *caps)).astype(np.int64)


LEAST_CORNERS, LEAST_PLANES = 100, 3
"""A surface of fewer corners, or on fewer planes of a grid, does not show its voxels."""

MOST_EMPTY = 3.0
"""Planes of a grid from end to end, by those that hold a corner of a mask's surface."""

GRID_SHARE, GRID_TOLERANCE = 0.9, 1e-3
"""Share of the corners that lie on edges of the grid, and how near, by its step."""

LEAST_EDGES = 0.01
"""Share of the corners that lie on edges of one direction, at least."""


def find_voxels(points: Vertices) -> Vertices | None:
    """Return the voxels (3,) [mm] that the corners (n, 3) of a surface betray, or None.

    Marching cubes leave each corner on an edge of the grid: two of its coordinates are whole
    steps of the grid, and one is not. Turned, smoothed or reduced surfaces betray nothing.
    """
    if len(points) < LEAST_CORNERS:
        return None
    choices: list[list[tuple[float, Mask]]] = []
    for values in points.T:
        tolerance = 1e-6 * float(np.abs(values).max()) + 1e-9
        order = np.sort(values)
        starts = np.append(0, np.flatnonzero(np.diff(order) > tolerance) + 1)
        planes, counts = order[starts], np.diff(np.append(starts, len(order)))
        most = np.argsort(-counts, kind="stable")
        # Of a mask all coordinates are whole or half steps; else two of three are whole: then take
        # the fullest planes, which hold a third.
        least = float(np.diff(planes).min(initial=np.inf))
        mask = np.ptp(values) < MOST_EMPTY * len(planes) * least
        share = len(values) * (1.0 if mask else 1.0 / 3.0)
        enough = int(np.searchsorted(np.cumsum(counts[most]), share)) + 1
        levels = np.sort(planes[most[:enough]])
        if len(levels) < LEAST_PLANES:
            return None
        step = float(np.diff(levels).min())
        # The smallest difference of two numbers is rounded: take the mean over many.
        step = float(levels[-1] - levels[0]) / float(np.rint((levels[-1] - levels[0]) / step))
        index = (values - levels[0]) / step
        on = np.abs(index - np.rint(index)) < GRID_TOLERANCE
        odd = np.rint(index).astype(np.int64) % 2 == 1
        halves = [(2.0 * step, on & ~odd), (2.0 * step, on & odd)]
        choices.append([*halves, (step, on)] if mask else [(step, on)])
    for chosen in itertools.product(*choices):
        if _lie_on_edges(np.stack([on for _, on in chosen], axis=1)):
            return np.array([step for step, _ in chosen])
    return None


def _lie_on_edges(on: Mask) -> bool:
    """Whether of corners with coordinates on planes of a grid (n, 3) nearly all lie on its edges.

    A corner on a node of the grid has three. Edges of all three directions must be among them.
    """
    edges = ~on[on.sum(axis=1) == 2]
    return bool(
        len(edges) > GRID_SHARE * len(on) and edges.sum(axis=0).min() > LEAST_EDGES * len(on)
    )
