"""A closed triangle mesh as a duct: exact distance, the inside by the winding number."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import GeometryError, InputError
from ...numeric.vectors import order_points
from ..base import DuctShape, SampledField
from ..checks import check_places, freeze_places, set_fields
from ..field import MeshWall, field_from_mesh, measure_parts

if TYPE_CHECKING:
    import igl

# Which side of a mesh's triangles is inside: parts that are turned inside out are found.

ASIDE = 1e-6
"""How far off a triangle it is looked on which side is inside, as a fraction of the mesh's size."""


def check_sides(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    count_windings: Callable[[NDArray[np.float64]], NDArray[np.int64]],
    *,
    everywhere: bool,
) -> None:
    """Raise `GeometryError` where a closed mesh winds about places beside it in the wrong sense.

    Such places are outside, and the triangles around them no wall: moved outwards, these would
    make a lumen of nothing.

    Parameters
    ----------
    vertices : (n, 3) float
        [mm].
    faces : (m, 3) int
    count_windings : callable
        Takes points (k, 3), returns how often the mesh winds about them (k,).
    everywhere : bool
        Whether all triangles are looked at, by their middles; else those of connected parts with
        a negative volume, which are legal only as holes in others.
    """
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    part, volumes = measure_parts(vertices, faces)
    sizes = np.linalg.norm(normals, axis=1)
    asked = np.flatnonzero((sizes > 0.0) & (everywhere | (volumes[part] < 0.0)))
    if len(asked) == 0:
        return
    aside = ASIDE * float(np.ptp(vertices, axis=0).max())
    middles = corners[asked].mean(axis=1)
    wrong = count_windings(middles + aside / sizes[asked, None] * normals[asked]) < -0.5
    if wrong.any():
        k = int(np.argmax(wrong))
        where = ", ".join(f"{x:.1f}" for x in middles[k])
        size = int(np.sum(part == part[asked[k]]))
        raise GeometryError(
            f"the mesh is turned inside out near ({where}) mm: {int(wrong.sum())} triangles, of a "
            f"part of {size}, have the inside in front of them"
        )


MOST_COLUMNS = 2000
"""Columns of triangles along one side, at most."""

THIN_MM = 1e-9
"""Distance below which a point lies on a triangle, whose normal is then the gradient [mm]."""


@dataclass(frozen=True, eq=False)
class TriangleMesh(DuctShape):
    """The inside of a closed triangle mesh.

    Parameters
    ----------
    vertices : (n, 3) float
        World frame [mm].
    faces : (m, 3) int
        Triangles that agree in their turn. Kept outward.
    inflation, wall, wall_error
        See `DuctShape`.

    Raises
    ------
    InputError
        If a vertex is not finite, or a face points nowhere.
    GeometryError
        If the mesh is open or its triangles do not agree, with where; or it encloses no volume.
        `bozzini.anatomy.tract_from_surface` mends small faults. If a part of the mesh is turned
        inside out, with where; as a hole in another part it may be, unless the wall is moved.

    Notes
    -----
    The distance to the triangles is exact (libigl's tree of boxes, built once), and so is the
    signed distance if no sheets of the mesh cross. A point is inside where the mesh
    winds about it at least once, counted along a ray: for a closed mesh the generalised winding
    number of Jacobson, Kavan and Sorkine-Hornung (2013), without its sum over all triangles. So
    where sheets of the mesh cross, what any of them encloses is inside, and the distance, which
    is to any triangle, a lower bound of the clearance. That is not looked for: `kind` is "bound".
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    wall: str = field(default="triangles of a mesh", kw_only=True)
    wall_error: float | None = field(default=None, kw_only=True)

    name = "mesh"
    unit_kinds = {"vertices": "length"}
    dim = 3
    exact_outside = True

    def __post_init__(self) -> None:
        vertices = freeze_places("vertices", self.vertices, 3, least=4)
        faces = np.array(self.faces, order="C")
        if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
            raise InputError(
                f"faces are {faces.dtype} of shape {faces.shape}: they must be integers (m, 3)"
            )
        if faces.size == 0 or faces.min() < 0 or faces.max() >= len(vertices):
            span = f"[{faces.min()}, {faces.max()}]" if faces.size else "none at all"
            raise InputError(
                f"faces point at vertices {span}: they must lie in [0, {len(vertices) - 1}]"
            )
        faces = faces.astype(np.int64)
        super().__post_init__()
        _check_closed(vertices, faces)
        volume = measure_parts(vertices, faces)[1].sum() / 6.0
        if abs(volume) <= 1e-9 * float(np.ptp(vertices[faces], axis=(0, 1)).max()) ** 3:
            raise GeometryError(f"the mesh encloses no volume: {volume:.3g} mm^3")
        if volume < 0.0:
            faces = np.ascontiguousarray(faces[:, ::-1])
        faces.flags.writeable = False
        set_fields(self, vertices=vertices, faces=faces)
        check_sides(vertices, faces, self.count_windings, everywhere=self.inflation > 0.0)
        if self.inflation > 0.0:
            MeshWall(vertices, faces).refuse_bodies()

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) corners of the box around the mesh [mm]."""
        corners = self.vertices[self.faces].reshape(-1, 3)
        return np.stack(
            [corners.min(axis=0) - self.inflation, corners.max(axis=0) + self.inflation]
        )

    @property
    def volume(self) -> float:
        """Volume before inflation [mm^3]."""
        return float(measure_parts(self.vertices, self.faces)[1].sum()) / 6.0

    def count_windings(self, points: ArrayLike) -> NDArray[np.int64]:
        """Return how often the mesh winds about points (..., 3): 0 outside, 1 or more inside."""
        from ..kernels.inside import count_windings

        array = check_places("points", points)
        flat = np.array(array.reshape(-1, 3), order="C")
        result = np.empty(len(flat), dtype=np.int64)
        arguments = (self.vertices, self.faces, *self._columns, flat, result)
        count_windings(*arguments)
        return result.reshape(array.shape[:-1])

    def _nearest(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
        """Return distances (n,), triangles (n,) and feet (n, 3) of points."""
        order = order_points(points)
        squared, triangle, foot = self._boxes.squared_distance(
            self.vertices, self.faces, points[order]
        )
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        return np.sqrt(squared)[back], triangle[back], foot[back]

    def signed_distance(self, points: ArrayLike, /) -> NDArray[np.float64]:
        """Return the (...) signed distance at points (..., 3) [mm], negative inside."""
        array = check_places("points", points)
        flat = np.array(array.reshape(-1, 3), order="C")
        gap = self._nearest(flat)[0]
        value = np.where(self.count_windings(flat) > 0, -gap, gap)
        return value.reshape(array.shape[:-1]) - self.inflation

    def gradient(self, points: ArrayLike, /) -> NDArray[np.float64]:
        """Return the (..., 3) gradient of the signed distance; where it has several, one."""
        array = check_places("points", points)
        flat = np.array(array.reshape(-1, 3), order="C")
        gap, triangle, foot = self._nearest(flat)
        sign = np.where(self.count_windings(flat) > 0, -1.0, 1.0)
        near = gap <= THIN_MM
        away = (flat - foot) * (sign / np.where(near, 1.0, gap))[:, None]
        if near.any():
            a, b, c = np.moveaxis(self.vertices[self.faces[triangle[near]]], 1, 0)
            normal = np.cross(b - a, c - a)
            size = np.linalg.norm(normal, axis=1, keepdims=True)
            away[near] = normal / np.where(size > 0.0, size, 1.0)
        return away.reshape(array.shape)

    def sample(self, voxel: float | None = None) -> SampledField:
        """Sample the signed distance on a grid: see `bozzini.duct.field_from_mesh`."""
        grid = field_from_mesh(self.vertices, self.faces, voxel=voxel, inflate=self.inflation)
        return replace(grid, wall=self.wall, wall_error=self.wall_error)

    @cached_property
    def _boxes(self) -> igl.AABB:
        import igl

        boxes = igl.AABB()
        boxes.init(self.vertices, self.faces)
        return boxes

    @cached_property
    def _columns(self) -> tuple[object, ...]:
        """The triangles in columns along the shortest side of the box: see `kernels.inside`."""
        from ..kernels.inside import fill_columns

        corners = self.vertices[self.faces]
        low = corners.min(axis=(0, 1))
        size = corners.max(axis=(0, 1)) - low
        r = int(np.argmin(size))
        p, q = (r + 1) % 3, (r + 2) % 3
        # About two columns a triangle, and a dozen columns for a triangle of the mean size.
        sides = np.ptp(corners, axis=1)
        area = max(
            size[p] * size[q] / (2.0 * len(self.faces)), (sides[:, p] * sides[:, q]).mean() / 12
        )
        cell = max(float(np.sqrt(area)), float(size.max()) / MOST_COLUMNS)
        # Points on the far border are in the last column.
        shape = (int(size[p] / cell) + 1, int(size[q] / cell) + 1)
        head = (p, q, float(low[p]), float(low[q]), cell, shape)
        first, members = fill_columns(self.vertices, self.faces, *head)
        return first, members, p, q, r, *head[2:]


def _check_closed(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    """Raise `GeometryError` unless every edge is run through as often one way as the other."""
    start = faces.reshape(-1)
    stop = np.roll(faces, -1, axis=1).reshape(-1)
    owner = np.repeat(np.arange(len(faces)), 3)
    loop = start == stop
    if loop.any():
        raise GeometryError(f"triangle {int(owner[np.argmax(loop)])} has two equal corners")
    low, high = np.minimum(start, stop), np.maximum(start, stop)
    key, index, counts = np.unique(
        low * len(vertices) + high, return_inverse=True, return_counts=True
    )
    balance = np.bincount(index, weights=np.where(start < stop, 1.0, -1.0), minlength=len(key))
    open_edges = np.flatnonzero(counts % 2 == 1)
    if len(open_edges):
        ends = np.stack([key[open_edges] // len(vertices), key[open_edges] % len(vertices)], 1)
        hole, holes = _follow_hole(ends)
        where = ", ".join(f"{x:.1f}" for x in vertices[np.unique(hole)].mean(axis=0))
        raise GeometryError(
            f"the mesh is not closed: {len(open_edges)} edges have no second triangle, in {holes} "
            f"{'hole' if holes == 1 else 'holes'}, the largest with {len(hole)} edges near "
            f"({where}) mm"
        )
    clash = np.flatnonzero(balance != 0.0)
    if len(clash):
        both = owner[np.flatnonzero(index == clash[0])]
        where = ", ".join(f"{x:.1f}" for x in vertices[faces[both[0]]].mean(axis=0))
        raise GeometryError(
            f"triangles {both[0]} and {both[1]} near ({where}) mm do not agree on which side is "
            f"out, nor do those at {len(clash) - 1} more edges"
        )


def _follow_hole(ends: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Return the edges (k, 2) of the largest hole, and how many holes there are."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    names, short = np.unique(ends, return_inverse=True)
    short = short.reshape(-1, 2)
    ones = np.ones(len(short), dtype=np.int8)
    graph = coo_matrix((ones, (short[:, 0], short[:, 1])), shape=(len(names), len(names)))
    number, part = connected_components(graph, directed=False)
    of_edge = part[short[:, 0]]
    largest = int(np.argmax(np.bincount(of_edge, minlength=number)))
    return ends[of_edge == largest], int(number)
