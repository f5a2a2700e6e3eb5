"""From a tract to a sampled field: exact distances at the nodes, to the tract's own wall."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..anatomy.frame import fit_frame, measure_shift
from ..checks import check_number
from ..errors import GeometryError
from ..progress import Progress, no_progress
from ._mesh_sides import check_sides
from .field import SampledField

if TYPE_CHECKING:
    from ..anatomy.tract import LabelTract, SurfaceTract

__all__ = ["INFLATION_MAX", "build_field", "field_from_mask", "field_from_mesh"]

MAX_NODES = 40_000_000
"""Largest grid that is built [nodes]; about 160 MB of float32."""

NODE_SPACING = 1.5
"""Voxels are divided until nodes are no farther apart than this by default [mm]."""

INFLATION_MAX = 30.0
"""Largest inflation [mm]: it makes a tube 60 mm wider, as wide as a colon full of gas."""

ROUNDING = 1e-6
"""Depth in the lumen below which a node counts as on the wall [mm]."""

MARGIN = 6.0
"""How far the grid reaches beyond the (inflated) lumen [mm]."""


def build_field(
    tract: LabelTract | SurfaceTract,
    *,
    voxel: float | None = None,
    inflate: float = 0.0,
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
    progress : Progress
        Called with the stage and a fraction.

    Raises
    ------
    InputError
        If `voxel` or `inflate` is not legal.
    GeometryError
        If the grid would be too large, or no node lies inside the lumen.
    """
    check_number("inflation", inflate, low=0.0, high=INFLATION_MAX, unit="mm")
    if voxel is not None:
        check_number("voxel", voxel, low=0.0, low_open=True, unit="mm")
    if tract.kind == "labels":
        return field_from_mask(
            tract.mask,  # type: ignore[union-attr]
            tract.affine,  # type: ignore[union-attr]
            voxel=voxel,
            inflate=inflate,
            progress=progress,
        )
    return field_from_mesh(
        tract.vertices,  # type: ignore[union-attr]
        tract.faces,  # type: ignore[union-attr]
        voxel=voxel,
        inflate=inflate,
        progress=progress,
    )


def field_from_mask(
    mask: ArrayLike,
    affine: ArrayLike,
    *,
    voxel: float | None = None,
    inflate: float = 0.0,
    progress: Progress = no_progress,
) -> SampledField:
    """Sample the distance to the faces between lumen voxels and the others.

    The lumen is the union of the closed boxes of the voxels in `mask`, the wall the faces where
    it meets other voxels (or the volume's border). Node distances are exact (to float32).

    Parameters
    ----------
    mask : (nx, ny, nz) bool
        The lumen.
    affine : (4, 4) float
        Voxel index to world [mm]; rotation and scaling. Axes not quite at right angles are
        squared about the middle of the lumen, and how far that moves the wall is added to the
        field's `wall_error`.
    """
    lumen, matrix = _crop(np.asarray(mask, dtype=bool), np.asarray(affine, dtype=np.float64))
    rotation, spacing_data = fit_frame(matrix)
    middle = 0.5 * (np.array(lumen.shape) - 1.0)
    corner = matrix[:3, 3] + (matrix[:3, :3] - rotation * spacing_data) @ middle
    shift = measure_shift(matrix, tuple(n - 2 for n in lumen.shape))
    size = np.array(lumen.shape) * spacing_data
    pad = inflate + MARGIN
    spacing = _divide(spacing_data, size + 2 * pad) if voxel is None else np.full(3, float(voxel))
    parts = spacing_data / spacing
    if np.allclose(parts, np.rint(parts)):  # then nodes lie on the centres of the voxels
        start = -spacing * np.ceil((pad + 0.5 * spacing_data) / spacing)
    else:
        start = -0.5 * spacing_data - pad
    counts = _count_nodes(size + 2 * pad, spacing, more=2)
    axes = [start[a] + spacing[a] * np.arange(counts[a]) for a in range(3)]
    progress("distance", 0.0)
    inside = _box_distance(~lumen, axes, spacing_data, beyond=True)
    progress("distance", 0.5)
    outside = _box_distance(lumen, axes, spacing_data, beyond=False)
    # A node on a face between two wall voxels is off it by rounding, and not in the lumen.
    values = np.where(inside > ROUNDING, -inside, outside).astype(np.float32)
    if not (values < 0.0).any():
        raise GeometryError(
            f"no node of the {spacing.max():g} mm grid lies inside the lumen: use a smaller --voxel"
        )
    progress("distance", 1.0)
    return SampledField(
        values=np.ascontiguousarray(values),
        spacing=spacing.astype(np.float64),
        origin=corner + rotation @ start,
        rotation=rotation,
        inflation=float(inflate),
        wall="faces between lumen voxels and the others",
        wall_error=0.5 * float(np.linalg.norm(spacing_data)) + shift,
    )


def _crop(
    lumen: NDArray[np.bool_], affine: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
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


def _divide(spacing: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.float64]:
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
        told = f"{int(nodes):,}" if nodes < 1e15 else f"{nodes:.3g}"
        raise GeometryError(
            f"voxel {spacing.min():g} mm makes a grid of {told} nodes: the limit is "
            f"{MAX_NODES:,}, give at least {least * 1.02:.3g} mm"
        )
    return counts.astype(np.int64)


def _box_distance(
    boxes: NDArray[np.bool_],
    axes: list[NDArray[np.float64]],
    spacing: NDArray[np.float64],
    *,
    beyond: bool,
) -> NDArray[np.float32]:
    """Distance from the nodes to the union of voxel boxes; `beyond`: all outside counts as box."""
    from ._kernels import box_distance_pass

    squared = np.where(boxes, 0.0, np.inf)
    for axis in range(3):
        moved = np.ascontiguousarray(np.moveaxis(squared, axis, -1))
        rows = moved.reshape(-1, moved.shape[-1])
        result = np.empty((rows.shape[0], len(axes[axis])))
        box_distance_pass(rows, axes[axis], float(spacing[axis]), result)
        squared = np.moveaxis(result.reshape(*moved.shape[:-1], -1), -1, axis)
    distance = np.sqrt(squared, out=np.ascontiguousarray(squared))
    if beyond:
        for axis in range(3):
            low = -0.5 * spacing[axis]
            high = low + boxes.shape[axis] * spacing[axis]
            out = (axes[axis] <= low) | (axes[axis] >= high)
            index: list[slice | NDArray[np.bool_]] = [slice(None)] * 3
            index[axis] = out
            distance[tuple(index)] = 0.0
    return distance.astype(np.float32)


def field_from_mesh(
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    voxel: float | None = None,
    inflate: float = 0.0,
    progress: Progress = no_progress,
) -> SampledField:
    """Sample the distance to a closed triangle mesh, the inside by its winding number.

    Node distances are exact inside and, outside, up to the inflation plus two cells; farther out
    they are upper bounds (nearest exact node plus the way to it). A fold of the mesh that is inside
    out counts as wall, though it is not the lumen's: moved outwards, the wall may reach farther
    there, by the fold's size (`TriangleMesh` refuses it).

    Parameters
    ----------
    vertices : (n, 3) float
        World frame [mm].
    faces : (m, 3) int
        Outward oriented.

    Raises
    ------
    GeometryError
        If the grid would be too large, no node lies inside, or a part of the mesh is turned inside
        out, with where.
    """
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    triangles = np.ascontiguousarray(faces, dtype=np.int64)
    pad = inflate + MARGIN
    low, high = points.min(axis=0) - pad, points.max(axis=0) + pad
    if voxel is None:
        edges = points[triangles] - points[np.roll(triangles, 1, axis=1)]
        wanted = min(1.0, float(np.median(np.linalg.norm(edges, axis=2))))
        wanted = max(wanted, float((high - low).max()) / 400.0)
        voxel = wanted * max(1.0, _coarsen(high - low, np.full(3, wanted)))
    spacing = np.full(3, float(voxel))
    counts = _count_nodes(high - low, spacing, more=1)
    values, reach = _mesh_distance(points, triangles, low, float(voxel), counts, inflate, progress)
    if not (values < 0.0).any():
        raise GeometryError(
            f"no node of the {voxel:g} mm grid lies inside the surface: use a smaller --voxel"
        )
    return SampledField(
        values=values,
        spacing=spacing,
        origin=low,
        rotation=np.eye(3),
        inflation=float(inflate),
        wall="triangles of the surface",
        reach=reach,
    )


def _mesh_distance(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    low: NDArray[np.float64],
    voxel: float,
    counts: NDArray[np.int64],
    inflate: float,
    progress: Progress,
) -> tuple[NDArray[np.float32], float]:
    import igl
    from scipy import ndimage

    check_sides(
        vertices,
        faces,
        lambda places: igl.fast_winding_number(vertices, faces, np.ascontiguousarray(places)),
        everywhere=False,
    )
    shape = tuple(int(c) for c in counts)
    reach = inflate + 2.0 * voxel
    # Every wall point has a marked node within 1.5 cells (see _mark_wall).
    to_marked = ndimage.distance_transform_edt(
        ~_mark_wall(vertices, faces, low, voxel, shape), sampling=voxel
    )
    near = to_marked <= 2.5 * voxel
    # All other nodes are more than one cell away from the wall, so connected ones lie on one side
    # of it: one winding number settles each component.
    blocks, count = ndimage.label(~near)
    first = ndimage.minimum(
        np.arange(near.size).reshape(shape), blocks, index=np.arange(1, count + 1)
    )
    queries = np.concatenate([np.asarray(first, dtype=np.int64), np.flatnonzero(near)])
    winding = igl.fast_winding_number(vertices, faces, _node_points(queries, shape, low, voxel))
    inside = np.concatenate([[False], winding[:count] > 0.5])[blocks]
    inside[near] = winding[count:] > 0.5
    exact = inside | (to_marked <= reach + 1.5 * voxel)
    index = np.flatnonzero(exact)
    boxes = igl.AABB()
    boxes.init(vertices, faces)
    distance = np.full(near.size, np.inf)
    chunk = 50_000
    for start in range(0, len(index), chunk):
        part = index[start : start + chunk]
        squared = boxes.squared_distance(vertices, faces, _node_points(part, shape, low, voxel))[0]
        distance[part] = np.sqrt(squared)
        progress("distance", min(1.0, (start + len(part)) / len(index)))
    signed = np.where(inside.reshape(-1), -distance, distance).reshape(shape)
    if not exact.all():
        way, nearest = ndimage.distance_transform_edt(~exact, sampling=voxel, return_indices=True)
        signed = np.where(exact, signed, signed[tuple(nearest)] + way)
    return np.ascontiguousarray(signed, dtype=np.float32), reach


def _mark_wall(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    low: NDArray[np.float64],
    voxel: float,
    shape: tuple[int, ...],
) -> NDArray[np.bool_]:
    """Mark the nodes nearest to points spread over the triangles.

    A wall point is within 1/sqrt(3) cell of such a point (`mark_triangles`), and that within
    sqrt(3)/2 cell of its node: 1.45 cells in all. Triangles are cut finer along long sides only,
    so that long thin ones cost no more than their length.
    """
    from ._kernels import mark_triangles

    corners = vertices[faces] - low
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    # Side k runs from corner k to k + 1: turn the corners until the shortest is from 1 to 2.
    turn = (np.argmin(sides, axis=1)[:, None] + np.array([2, 0, 1])) % 3
    corners = np.take_along_axis(corners, turn[:, :, None], axis=1)
    marked = np.zeros(shape, dtype=bool)
    mark_triangles(np.ascontiguousarray(corners), voxel, marked)
    return marked


def _node_points(
    index: NDArray[np.int64], shape: tuple[int, ...], low: NDArray[np.float64], voxel: float
) -> NDArray[np.float64]:
    return np.ascontiguousarray(np.stack(np.unravel_index(index, shape), axis=1) * voxel + low)
