"""What a field is sampled from: a mesh or voxels, as a tree for distances and a rule for inside."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..anatomy.frame import fit_frame, measure_shift
from ..errors import GeometryError

if TYPE_CHECKING:
    from ..anatomy.tract import LabelTract, SurfaceTract
    from ._nearest_kernels import Tree

__all__ = ["MeshWall", "VoxelWall", "make_wall"]

Floats = NDArray[np.float64]

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
        from ._kernels import mark_triangles

        corners = self.vertices[self.faces] - low
        sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        # Side k runs from corner k to k + 1: turn the corners until the shortest is from 1 to 2.
        turn = (np.argmin(sides, axis=1)[:, None] + np.array([2, 0, 1])) % 3
        corners = np.take_along_axis(corners, turn[:, :, None], axis=1)
        mark_triangles(np.ascontiguousarray(corners), float(step[0]), flags)
        return np.full(3, MARK_SLACK)

    def flag_inside(self, flags: NDArray[np.uint8], low: Floats, step: Floats) -> None:
        """Flag the nodes inside; columns where the mesh is open by its winding number."""
        from ._nearest_kernels import INSIDE
        from ._scan_kernels import fill_inside

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
        from ._scan_kernels import find_inside

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
        from ._scan_kernels import count_crossings, fill_crossings, sort_crossings

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
        from ._mesh_sides import find_parts

        corners = self.vertices[self.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        part = find_parts(len(self.vertices), self.faces)
        around = corners[:, 0] - corners.mean(axis=(0, 1))
        volumes = np.bincount(part, weights=np.einsum("ij,ij->i", around, normals))
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
        from ._scan_kernels import list_faces

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
        from ._kernels import mark_boxes

        start, stop = self._faces[:, :3], self._faces[:, 3:]
        mark_boxes((start - low) / step, (stop - low) / step, flags)
        return np.ones(3)

    def flag_inside(self, flags: NDArray[np.uint8], low: Floats, step: Floats) -> None:
        """Flag the nodes in voxels of the lumen."""
        from ._nearest_kernels import INSIDE
        from ._scan_kernels import flag_voxels

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


def make_wall(tract: LabelTract | SurfaceTract) -> MeshWall | VoxelWall:
    """Return the wall of a tract."""
    if tract.kind == "labels":
        return VoxelWall.from_mask(tract.mask, tract.affine)  # type: ignore[union-attr]
    return MeshWall(tract.vertices, tract.faces)  # type: ignore[union-attr]


def _plant(parts: Floats, low: Floats, high: Floats) -> Tree:
    from ._nearest_kernels import Tree, build_tree

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
