"""Sampled fields of tracts: exact distances at the nodes, and finer nodes along a line."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..anatomy.frame import fit_frame, measure_shift
from ..checks import check_number, check_points, show_value
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import show_briefly
from .base import PackedDuct, Wrapped
from .base import SampledField as SampledField
from .packed import BricksData

if TYPE_CHECKING:
    from ..anatomy.tract import LabelTract, SurfaceTract
    from .kernels.nearest import Tree

# What a field is sampled from: a mesh or voxels, as a tree for distances and a rule for inside.

MARK_SLACK = 0.5 + 1.0 / math.sqrt(3.0)
"""A point of a triangle has a marked node within so many cells along each axis."""


@dataclass(frozen=True, eq=False)
class MeshWall:
    """A closed triangle mesh; inside is where it winds at least once.

    Parameters
    ----------
    vertices : (n, 3) float
        World frame [mm].
    faces : (m, 3) int
    """

    vertices: Floats
    faces: NDArray[np.int64]
    origin: Floats = field(default_factory=lambda: np.zeros(3))
    rotation: Floats = field(default_factory=lambda: np.eye(3))

    @cached_property
    def tree(self) -> Tree:
        """Of the triangles."""
        corners = self.vertices[self.faces]
        sides = corners[:, 1:] - corners[:, :1]
        parts = np.concatenate([corners[:, 0], sides.reshape(-1, 6)], axis=1)
        return _plant(parts, corners.min(axis=1), corners.max(axis=1))

    def mark(self, flags: NDArray[np.uint8], low: Floats, step: Floats) -> Floats:
        """Mark nodes near the wall; return within how many cells each of its points has one.

        Triangles are cut finer along long sides only, so that long thin ones cost no more than
        their length.
        """
        from .kernels.scan import mark_triangles

        corners = self.vertices[self.faces] - low
        sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        # Side k runs from corner k to k + 1: turn the corners until the shortest is from 1 to 2.
        turn = (np.argmin(sides, axis=1)[:, None] + np.array([2, 0, 1])) % 3
        corners = np.take_along_axis(corners, turn[:, :, None], axis=1)
        mark_triangles(np.ascontiguousarray(corners), float(step[0]), flags)
        return np.full(3, MARK_SLACK)

    def flag_inside(self, flags: NDArray[np.uint8], low: Floats, step: Floats) -> None:
        """Flag the nodes inside; columns where the mesh is open by its winding number."""
        from .kernels.nearest import INSIDE
        from .kernels.scan import fill_inside

        columns = (flags.shape[0], flags.shape[1])
        first, heights, turns, holes = self._scan(np.ones(columns, dtype=bool), low, step)
        fill_inside(first, heights, turns, flags, np.uint8(INSIDE))
        for c in np.flatnonzero(holes):
            i, j = divmod(int(c), columns[1])
            nodes = np.stack(np.broadcast_arrays(i, j, np.arange(flags.shape[2])), axis=1)
            inside = self._wind(nodes * step + low)
            flags[i, j] = np.where(inside, flags[i, j] | INSIDE, flags[i, j] & ~np.uint8(INSIDE))

    def find_inside(
        self, corners: NDArray[np.int64], size: int, low: Floats, step: Floats
    ) -> NDArray[np.bool_]:
        """Return which nodes of bricks (n, size, size, size) are inside."""
        from .kernels.scan import find_inside

        shape = corners[:, :2].max(axis=0) + size
        wanted = np.zeros(shape, dtype=bool)
        for i, j in np.unique(corners[:, :2], axis=0):
            wanted[i : i + size, j : j + size] = True
        first, heights, turns, holes = self._scan(wanted, low, step)
        inside = np.zeros((len(corners), size, size, size), dtype=bool)
        find_inside(first, heights, turns, (int(shape[0]), int(shape[1])), corners, inside)
        open_columns = holes.reshape(wanted.shape)
        if open_columns.any():
            for brick, (i, j, k) in zip(inside, corners, strict=True):
                for a, b in np.argwhere(open_columns[i : i + size, j : j + size]):
                    nodes = np.stack(np.broadcast_arrays(i + a, j + b, k + np.arange(size)), 1)
                    brick[a, b] = self._wind(nodes * step + low)
        return inside

    def _scan(
        self, wanted: NDArray[np.bool_], low: Floats, step: Floats
    ) -> tuple[NDArray[np.int64], Floats, NDArray[np.int8], NDArray[np.bool_]]:
        """Return where each column's crossings begin, their heights [cells], turns, and holes."""
        from .kernels.scan import count_crossings, fill_crossings, sort_crossings

        corners = np.ascontiguousarray(((self.vertices - low) / step)[self.faces])
        counts = np.zeros(wanted.shape, dtype=np.int64)
        count_crossings(corners, wanted, counts)
        first = np.concatenate([[0], np.cumsum(counts.reshape(-1))])
        heights = np.empty(first[-1])
        turns = np.empty(first[-1], dtype=np.int8)
        fill_crossings(corners, wanted, first[:-1].reshape(counts.shape).copy(), heights, turns)
        holes = np.zeros(counts.size, dtype=bool)
        sort_crossings(first, heights, turns, holes)
        return first, heights, turns, holes

    def _wind(self, points: Floats) -> NDArray[np.bool_]:
        import igl

        winding = igl.fast_winding_number(self.vertices, self.faces, np.ascontiguousarray(points))
        return np.asarray(winding > 0.5)

    def find_bodies(self) -> Floats:
        """Return middles (k, 3) of the triangles of parts that do not enclose lumen.

        Bodies turned inwards, sheets that are there twice, and parts turned inside out: they do not
        move outwards with the wall.
        """
        part, volumes = measure_parts(self.vertices, self.faces)
        corners = self.vertices[self.faces]
        return np.asarray(corners[volumes[part] <= 1e-9 * volumes.max()].mean(axis=1))

    def refuse_bodies(self) -> None:
        """Raise `GeometryError` where there are such parts, with the place of one."""
        bodies = self.find_bodies()
        if len(bodies):
            where = ", ".join(f"{x:.1f}" for x in bodies[0])
            raise GeometryError(
                f"the mesh has bodies, sheets or parts turned inside out near ({where}) mm, "
                f"{len(bodies)} triangles: its wall cannot be moved outwards, they do not move "
                "with it"
            )


@dataclass(frozen=True, eq=False)
class VoxelWall:
    """The faces between the voxels of a lumen and the others.

    Points are in a frame with the middle of voxel (0, 0, 0) at 0 and its axes along the voxels.

    Parameters
    ----------
    lumen : (nx, ny, nz) bool
        Cropped, with one layer of other voxels around.
    spacing : (3,) float
        Size of a voxel [mm].
    origin, rotation : (3,), (3, 3) float
        The frame in the world.
    shift : float
        How far squaring the axes moved the wall, at most [mm].
    """

    lumen: NDArray[np.bool_]
    spacing: Floats
    origin: Floats
    rotation: Floats
    shift: float

    @classmethod
    def from_mask(cls, mask: NDArray[np.bool_], affine: Floats) -> VoxelWall:
        """Crop a mask to its lumen, and square its axes about the lumen's middle."""
        lumen, matrix = _crop(mask, affine)
        rotation, spacing = fit_frame(matrix)
        middle = 0.5 * (np.array(lumen.shape) - 1.0)
        corner = matrix[:3, 3] + (matrix[:3, :3] - rotation * spacing) @ middle
        shift = measure_shift(matrix, tuple(n - 2 for n in lumen.shape))
        return cls(lumen, spacing, corner, rotation, shift)

    @cached_property
    def _faces(self) -> Floats:
        """Flat boxes (n, 6), lower and upper corner: faces, joined in rows along one axis."""
        from .kernels.scan import list_faces

        first = np.zeros(len(self.lumen) + 1, dtype=np.int64)
        list_faces(self.lumen, first, np.empty((0, 6)))
        first[1:] = np.cumsum(first[:-1])
        first[0] = 0
        boxes = np.empty((int(first[-1]), 6))
        list_faces(self.lumen, first, boxes)
        boxes *= np.tile(self.spacing, 2)
        return boxes

    @cached_property
    def tree(self) -> Tree:
        """Of the faces."""
        return _plant(self._faces, self._faces[:, :3], self._faces[:, 3:])

    def mark(self, flags: NDArray[np.uint8], low: Floats, step: Floats) -> Floats:
        """Mark nodes near the wall; return within how many cells each of its points has one."""
        from .kernels.scan import mark_boxes

        start, stop = self._faces[:, :3], self._faces[:, 3:]
        mark_boxes((start - low) / step, (stop - low) / step, flags)
        return np.ones(3)

    def flag_inside(self, flags: NDArray[np.uint8], low: Floats, step: Floats) -> None:
        """Flag the nodes in voxels of the lumen."""
        from .kernels.nearest import INSIDE
        from .kernels.scan import flag_voxels

        index, within = self._locate([np.arange(n) for n in flags.shape], low, step)
        x, y, z = (np.where(w, i, -1) for i, w in zip(index, within, strict=True))
        flag_voxels(self.lumen, x, y, z, np.uint8(INSIDE), flags)

    def find_inside(
        self, corners: NDArray[np.int64], size: int, low: Floats, step: Floats
    ) -> NDArray[np.bool_]:
        """Return which nodes of bricks (n, size, size, size) are inside."""
        inside = np.zeros((len(corners), size, size, size), dtype=bool)
        for brick, corner in zip(inside, corners, strict=True):
            index, within = self._locate([c + np.arange(size) for c in corner], low, step)
            brick[:] = self.lumen[np.ix_(*index)]
            brick &= within[0][:, None, None] & within[1][:, None] & within[2]
        return inside

    def _locate(
        self, nodes: list[NDArray[np.int64]], low: Floats, step: Floats
    ) -> tuple[list[NDArray[np.int64]], list[NDArray[np.bool_]]]:
        """Return the voxel of nodes along each axis, clipped to the array, and where it was in."""
        index, within = [], []
        for a in range(3):
            voxel = np.floor((low[a] + nodes[a] * step[a]) / self.spacing[a] + 0.5).astype(int)
            within.append((voxel >= 0) & (voxel < self.lumen.shape[a]))
            index.append(np.clip(voxel, 0, self.lumen.shape[a] - 1))
        return index, within


def measure_parts(vertices: Floats, faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], Floats]:
    """Return the connected part (m,) of each triangle, and six times each part's volume [mm^3]."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    start, stop = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    ones = np.ones(len(start), dtype=np.int8)
    graph = coo_matrix((ones, (start, stop)), shape=(len(vertices), len(vertices)))
    part = connected_components(graph, directed=False)[1][faces[:, 0]].astype(np.int64)
    a, b, c = np.moveaxis(vertices[faces] - vertices[faces].mean(axis=(0, 1)), 1, 0)
    volumes = np.bincount(part, weights=np.einsum("ij,ij->i", a, np.cross(b, c)))
    return part, volumes.astype(np.float64)


def check_tract(name: str, tract: object, *, legal: str = "a LabelTract or a SurfaceTract") -> None:
    """Raise `InputError` unless `tract` is a tract; a file must be read first."""
    from ..anatomy.tract import LabelTract, SurfaceTract

    if not isinstance(tract, (LabelTract, SurfaceTract)):
        if isinstance(tract, (str, os.PathLike)):
            raise InputError(
                f"{name} is {show_value(str(tract))}: read the file by read_tract first"
            )
        raise InputError(f"{name} is a {type(tract).__name__}: it must be {legal}")


def make_wall(tract: LabelTract | SurfaceTract) -> MeshWall | VoxelWall:
    """Return the wall of a tract."""
    if tract.kind == "labels":
        return VoxelWall.from_mask(tract.mask, tract.affine)  # type: ignore[union-attr]
    return MeshWall(tract.vertices, tract.faces)  # type: ignore[union-attr]


def _plant(parts: Floats, low: Floats, high: Floats) -> Tree:
    from .kernels.nearest import Tree, build_tree

    order, boxes, right, first, count = build_tree(
        np.ascontiguousarray(low), np.ascontiguousarray(high)
    )
    return Tree(np.ascontiguousarray(parts[order]), boxes, right, first, count)


def _crop(lumen: NDArray[np.bool_], affine: Floats) -> tuple[NDArray[np.bool_], Floats]:
    """Crop to the lumen's box plus one layer of wall, and carry the affine along."""
    if not lumen.any():
        raise GeometryError("the lumen is empty: no voxel is set")
    bounds = []
    for axis in range(3):
        others = tuple(a for a in range(3) if a != axis)
        hit = np.flatnonzero(lumen.any(axis=others))
        bounds.append((int(hit[0]), int(hit[-1]) + 1))
    core = lumen[tuple(slice(low, high) for low, high in bounds)]
    matrix = affine.copy()
    first = np.array([low - 1 for low, _ in bounds], dtype=np.float64)
    matrix[:3, 3] = affine[:3, :3] @ first + affine[:3, 3]
    return np.pad(core, 1), matrix


MAX_NODES = 40_000_000
"""Largest grid that is built [nodes]; about 160 MB of float32."""

NODE_SPACING = 1.5
"""Voxels are divided until nodes are no farther apart than this by default [mm]."""

INFLATION_MAX = 30.0
"""Largest inflation [mm]: it makes a tube 60 mm wider, as wide as a colon full of gas."""

MARGIN = 6.0
"""How far the grid, and exact distances, reach beyond the (inflated) lumen [mm]."""

SHARES, CALLS = 64, 10
"""Into how many shares the nodes are divided for the processors, and how often progress shows."""

Grid = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]


def build_field(
    tract: LabelTract | SurfaceTract,
    *,
    voxel: float | None = None,
    inflate: float = 0.0,
    reach: float | None = None,
    progress: Progress = no_progress,
) -> SampledField:
    """Sample the signed distance to the wall of a tract.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
        What `bozzini.anatomy.read_tract` or `make_phantom` gives.
    voxel : float, optional
        Distance between nodes [mm]. By default, for a label volume its voxels divided until they
        are at most 1.5 mm (the wall stays the faces of the data's voxels), for a surface the
        median edge (at most 1 mm); a grid beyond 40 million nodes is made coarser.
    inflate : float
        Move the wall outwards by this much [mm], `INFLATION_MAX` at most.
    reach : float, optional
        How far the wall may be moved outwards later, in all [mm]: see `SampledField.inflate`.
        Distances outside are exact up to two cells more than this, and than the inflation, and up
        to 6 mm more than the inflation.
    progress : Progress
        Called with the stage and a fraction.

    Raises
    ------
    InputError
        If `tract` is no tract, or `voxel`, `inflate` or `reach` is not legal.
    GeometryError
        If the grid would be too large, or no node lies inside the lumen.
    """
    check_tract("tract", tract)
    options = {"voxel": voxel, "inflate": inflate, "reach": reach, "progress": progress}
    # A body of wall within the lumen would shrink if the wall moved outwards.
    bodies = any(item.code == "cavities" for item in tract.findings)
    if bodies and max(inflate, reach or 0.0) > 0.0:
        raise GeometryError(
            f"inflation is {max(inflate, reach or 0.0):g} mm: it must be 0 mm, because "
            f"{tract.source} has closed cavities in its lumen, which count as wall; fill them first"
        )
    field = _sample(make_wall(tract), **options)  # type: ignore[arg-type]
    error = field.wall_error
    if tract.wall_error is not None:
        # What squaring the axes of labels moved comes on top.
        more = 0.0 if error is None else error - 0.5 * float(np.linalg.norm(tract.spacing))  # type: ignore[union-attr]
        error = tract.wall_error + max(more, 0.0)
    return replace(
        field,
        wall=tract.wall or field.wall,
        wall_error=error,
        frame=tract.frame,
        exact_outside=field.exact_outside and not bodies,
    )


def field_from_mask(
    mask: ArrayLike,
    affine: ArrayLike,
    *,
    voxel: float | None = None,
    inflate: float = 0.0,
    reach: float | None = None,
    progress: Progress = no_progress,
) -> SampledField:
    """Sample the distance to the faces between lumen voxels and the others.

    The lumen is the union of the closed boxes of the voxels in `mask`, the wall the faces where
    it meets other voxels (or the volume's border). Node distances are exact, and rounded towards 0
    to float32; outside the lumen up to the field's reach.

    Parameters
    ----------
    mask : (nx, ny, nz) bool
        The lumen.
    affine : (4, 4) float
        Voxel index to world [mm]; rotation and scaling. Axes not quite at right angles are
        squared about the middle of the lumen, and how far that moves the wall is added to the
        field's `wall_error`.
    """
    wall = VoxelWall.from_mask(np.asarray(mask, dtype=bool), np.asarray(affine, dtype=np.float64))
    return _sample(wall, voxel=voxel, inflate=inflate, reach=reach, progress=progress)


def field_from_mesh(
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    voxel: float | None = None,
    inflate: float = 0.0,
    reach: float | None = None,
    progress: Progress = no_progress,
) -> SampledField:
    """Sample the distance to a closed triangle mesh; inside is where it winds at least once.

    Node distances are exact, and rounded towards 0 to float32; outside the lumen up to the field's
    reach. All triangles are wall, also those within the lumen: where closed parts overlap, the
    distance is a lower bound of the clearance. A sheet that is there twice, once turned each way,
    is a wall with lumen on both sides, and a body turned inwards one without. These do not move
    with a wall that is moved outwards: that is refused where there are any. Where a fold of the
    mesh is inside out, such a wall may reach farther, by the fold's size (`TriangleMesh` refuses
    it).

    Parameters
    ----------
    vertices : (n, 3) float
        World frame [mm].
    faces : (m, 3) int
        Outward oriented.

    Raises
    ------
    GeometryError
        If the grid would be too large, no node lies inside, or a wall that is to be moved outwards
        has bodies, sheets or parts turned inside out, with where.
    """
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    triangles = np.ascontiguousarray(faces, dtype=np.int64)
    wall = MeshWall(points, triangles)
    return _sample(wall, voxel=voxel, inflate=inflate, reach=reach, progress=progress)


def _sample(
    wall: MeshWall | VoxelWall,
    *,
    voxel: float | None,
    inflate: float,
    reach: float | None,
    progress: Progress,
) -> SampledField:
    check_number("inflation", inflate, low=0.0, high=INFLATION_MAX, unit="mm")
    if voxel is not None:
        check_number("voxel", voxel, low=0.0, low_open=True, unit="mm")
    if reach is not None:
        check_number("reach", reach, low=0.0, high=200.0, unit="mm")
    pad = max(inflate, reach or 0.0) + MARGIN
    if isinstance(wall, VoxelWall):
        low, spacing, counts = _lay_on_voxels(wall, voxel, pad)
        stated = {
            "wall": "faces between lumen voxels and the others",
            "wall_error": 0.5 * float(np.linalg.norm(wall.spacing)) + wall.shift,
        }
    else:
        low, spacing, counts = _lay_on_mesh(wall, voxel, pad)
        stated = {"wall": "triangles of the surface", "wall_error": None}
    limit = max(inflate + MARGIN, max(inflate, reach or 0.0) + 2.0 * float(spacing.max()))
    exact = True
    if isinstance(wall, MeshWall):
        if max(inflate, reach or 0.0) > 0.0:
            wall.refuse_bodies()
        else:
            exact = len(wall.find_bodies()) == 0
    values = _measure(wall, low, spacing, counts, limit, progress)
    if not float(values.min()) < 0.0:
        raise GeometryError(
            f"no node of the {spacing.max():g} mm grid lies inside the lumen: use a smaller --voxel"
        )
    return SampledField(
        values=values,
        spacing=spacing,
        origin=wall.origin + wall.rotation @ low,
        rotation=wall.rotation,
        inflation=float(inflate),
        reach=limit,
        exact_outside=exact,
        **stated,  # type: ignore[arg-type]
    )


def _lay_on_voxels(wall: VoxelWall, voxel: float | None, pad: float) -> Grid:
    """Return node 0, spacing and counts of the grid for a wall of voxels."""
    voxels = wall.spacing
    size = np.array(wall.lumen.shape) * voxels
    spacing = divide_voxels(voxels, size + 2 * pad) if voxel is None else np.full(3, float(voxel))
    parts = voxels / spacing
    if np.allclose(parts, np.rint(parts)):  # then nodes lie on the centres of the voxels
        start = -spacing * np.ceil((pad + 0.5 * voxels) / spacing)
    else:
        # Nodes stay where they are when the wall is inflated.
        start = -0.5 * voxels - spacing * np.ceil(pad / spacing)
    return start, spacing.astype(np.float64), _count_nodes(size + 2 * pad, spacing, more=3)


def _lay_on_mesh(wall: MeshWall, voxel: float | None, pad: float) -> Grid:
    """Return node 0, spacing and counts of the grid for a mesh."""
    points = wall.vertices
    low, high = points.min(axis=0) - pad, points.max(axis=0) + pad
    if voxel is None:
        edges = points[wall.faces] - points[np.roll(wall.faces, 1, axis=1)]
        wanted = min(1.0, float(np.median(np.linalg.norm(edges, axis=2))))
        wanted = max(wanted, float(np.ptp(points, axis=0).max() + 2.0 * MARGIN) / 400.0)
        voxel = wanted * max(1.0, _coarsen(high - low, np.full(3, wanted)))
    spacing = np.full(3, float(voxel))
    # Nodes stay where they are when the wall is inflated.
    low = points.min(axis=0) - voxel * np.ceil(pad / voxel)
    return low, spacing, _count_nodes(high - low, spacing, more=1)


def _measure(
    wall: MeshWall | VoxelWall,
    low: NDArray[np.float64],
    spacing: NDArray[np.float64],
    counts: NDArray[np.int64],
    limit: float,
    progress: Progress,
) -> NDArray[np.float32]:
    """Return the distance at all nodes: exact in the lumen, and outside it up to `limit`."""
    from scipy.ndimage import maximum_filter

    from .kernels.nearest import BAND, INSIDE, MARKED, fill_grid

    progress("distance", 0.0)
    shape = tuple(int(c) for c in counts)
    flags = np.zeros(shape, dtype=np.uint8)
    slack = wall.mark(flags, low, spacing)
    progress("distance", 0.1)
    cells = np.floor(limit / spacing + slack).astype(np.int64)
    near = maximum_filter(flags & MARKED, size=2 * cells + 1, mode="constant")
    flags |= np.where(near, np.uint8(BAND), np.uint8(0))
    del near
    wall.flag_inside(flags, low, spacing)
    progress("distance", 0.2)
    below = np.float32(limit)
    below = np.nextafter(below, np.float32(0.0)) if below > limit else below
    values = np.full(shape, below, dtype=np.float32)
    work = np.count_nonzero(flags & (INSIDE | BAND), axis=2).reshape(-1).cumsum()
    tree = wall.tree
    # Rows of nodes in shares of about the same work, some for each time that progress is shown.
    rows = np.searchsorted(work, np.linspace(0.0, float(work[-1]), SHARES * CALLS + 1))
    rows[0], rows[-1] = 0, len(work)
    for call in range(CALLS):
        part = rows[call * SHARES : (call + 1) * SHARES + 1]
        fill_grid(tree, flags, low, spacing, float(limit), part, values)
        progress("distance", 0.2 + 0.8 * (call + 1) / CALLS)
    return values


def divide_voxels(spacing: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Divide voxels into nodes at most `NODE_SPACING` apart, as far as the grid may grow."""
    # The 1 % is for voxel sizes rounded in the header.
    parts = np.maximum(1.0, np.ceil(spacing / NODE_SPACING - 0.01))
    while parts.max() > 1.0 and _coarsen(size, spacing / parts) > 1.0:
        finest = int(np.argmin(np.where(parts > 1.0, spacing / parts, np.inf)))
        parts[finest] -= 1.0
    nodes = spacing / parts
    return np.asarray(nodes * max(1.0, _coarsen(size, nodes)))


def _coarsen(size: NDArray[np.float64], spacing: NDArray[np.float64]) -> float:
    """By what factor the spacing must grow to stay within `MAX_NODES`."""
    return float((np.prod(size / spacing) / (0.9 * MAX_NODES)) ** (1.0 / 3.0))


def _count_nodes(
    size: NDArray[np.float64], spacing: NDArray[np.float64], *, more: int
) -> NDArray[np.int64]:
    """Return how many nodes a box takes along each axis, or raise if they are too many."""
    counts = np.ceil(size / np.maximum(spacing, 1e-30)) + more
    nodes = float(np.prod(counts))
    if nodes > MAX_NODES:
        least = spacing.min() * (nodes / MAX_NODES) ** (1.0 / 3.0)
        shown = f"{int(nodes):,}" if nodes < 1e15 else f"{nodes:.3g}"
        raise GeometryError(
            f"voxel {spacing.min():g} mm makes a grid of {shown} nodes: the limit is "
            f"{MAX_NODES:,}, give at least {least * 1.02:.3g} mm"
        )
    return counts.astype(np.int64)


# Finer nodes in bricks along a line: for passages that the coarse bound hides.

CELLS = 8
"""A brick has so many cells along each axis, and one node more."""

BRICKS_MAX = 100_000
"""So many bricks are made at most: about 290 MB."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RefinedField(Wrapped, PackedDuct):
    """A sampled field with finer nodes in some bricks; elsewhere the field itself answers.

    Its frame, bounds and wall are those of the field it refines.

    Parameters
    ----------
    coarse : SampledField
        What answers outside the bricks; grid searches (`find_passage`) use it.
    values : (n, m, m, m) float32
        Signed distance to the wall before inflation at the bricks' nodes [mm].
    table : (a, b, c) int32
        Which brick a box of the grid's frame has; -1 for none.
    spacing : (3,) float
        Distance between the finer nodes along each grid axis [mm].
    """

    __repr__ = show_briefly

    coarse: SampledField
    values: NDArray[np.float32]
    table: NDArray[np.int32]
    spacing: NDArray[np.float64]
    _rounding: float = field(init=False, repr=False, default=0.0)

    kind = "sampled"
    dim = 3

    def __post_init__(self) -> None:
        most = max(-float(self.values.min()), float(self.values.max())) * 2.0**-23
        object.__setattr__(self, "_rounding", max(most, self.coarse._rounding))

    @property
    def _inner(self) -> SampledField:
        return self.coarse

    def pack(self) -> BricksData:
        """Return the field for compiled kernels."""
        return BricksData(
            self.values,
            self.table,
            self.spacing,
            self.coarse.values,
            self.coarse.spacing,
            float(self.inflation),
            self._rounding,
        )

    def inflate(self, distance: float) -> RefinedField:
        """Return the same lumen with its wall moved outwards by `distance` mm more.

        Raises
        ------
        InputError
            As `SampledField.inflate`.
        """
        return replace(self, coarse=self.coarse.inflate(distance))


def refine_field(
    field: SampledField,
    tract: LabelTract | SurfaceTract,
    *,
    line_points_world: ArrayLike,
    voxel: float = 0.5,
    distance: float = 8.4,
    progress: Progress = no_progress,
) -> RefinedField:
    """Add finer nodes with exact distances to a field, along a line.

    Parameters
    ----------
    field : SampledField
        What `build_field` made of `tract`.
    tract : LabelTract or SurfaceTract
    line_points_world : (n, 3) float
        World frame [mm]; points on it no farther apart than `distance`.
    voxel : float
        Distance between the finer nodes, at most [mm]; the field's cells are divided evenly.
    distance : float
        All places within this of the line's points get finer nodes [mm].

    Raises
    ------
    InputError
        If a number is not legal, or the bricks would be too many.
    """
    from .kernels.nearest import fill_bricks

    points = check_points("line", line_points_world)
    check_number("voxel", voxel, low=0.0, low_open=True, unit="mm")
    check_number("distance", distance, low=0.0, unit="mm")
    parts = np.ceil(field.spacing / voxel - 1e-9)
    spacing = field.spacing / parts
    corners = _find_bricks(field, field.to_grid(points), spacing * CELLS, distance)
    if len(corners) > BRICKS_MAX:
        raise InputError(
            f"voxel is {voxel:g} mm: finer nodes along the line would take {len(corners):,} "
            f"bricks, the limit is {BRICKS_MAX:,}; give a larger voxel or a smaller distance"
        )
    progress("distance", 0.0)
    wall = make_wall(tract)
    if np.abs(wall.rotation - field.rotation).max() > 1e-9:
        raise InputError("field and tract do not belong together: their frames differ")
    low = wall.rotation.T @ (field.origin - wall.origin)
    nodes = corners * CELLS
    inside = wall.find_inside(nodes, CELLS + 1, low, spacing)
    progress("distance", 0.3)
    values = np.empty(inside.shape, dtype=np.float32)
    fill_bricks(wall.tree, nodes, inside, low, spacing, float(field.reach), values)
    size = (np.array(field.values.shape) - 1) * field.spacing
    table = np.full(np.ceil(size / (spacing * CELLS) - 1e-9).astype(int), -1, dtype=np.int32)
    table[tuple(corners.T)] = np.arange(len(corners))
    progress("distance", 1.0)
    return RefinedField(coarse=field, values=values, table=table, spacing=spacing)


def _find_bricks(
    field: SampledField,
    points: NDArray[np.float64],
    side: NDArray[np.float64],
    distance: float,
) -> NDArray[np.int64]:
    """Return the bricks (n, 3) with a place within `distance` of points of the grid frame."""
    from scipy.spatial import KDTree

    size = (np.array(field.values.shape) - 1) * field.spacing
    counts = np.ceil(size / side - 1e-9).astype(int)
    half = 0.5 * float(np.linalg.norm(side))
    reach = np.ceil((distance + side) / side).astype(int)
    around = np.stack(np.meshgrid(*[np.arange(-r, r + 1) for r in reach], indexing="ij"), -1)
    home = np.unique(np.floor(points / side).astype(int), axis=0)
    bricks = np.unique((home[:, None] + around.reshape(-1, 3)).reshape(-1, 3), axis=0)
    bricks = bricks[np.all((bricks >= 0) & (bricks < counts), axis=1)]
    near = KDTree(points).query((bricks + 0.5) * side)[0] <= distance + half
    bricks = bricks[near]
    # Of these, the ones whose box itself is near enough.
    gaps = np.full(len(bricks), np.inf)
    for point in points:
        away = np.maximum(np.maximum(bricks * side - point, point - (bricks + 1) * side), 0.0)
        np.minimum(gaps, np.einsum("ij,ij->i", away, away), out=gaps)
    return np.asarray(bricks[gaps <= distance**2], dtype=np.int64)
