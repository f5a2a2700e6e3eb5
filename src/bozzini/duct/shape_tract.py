"""Shapes as a tract: triangles on their wall, so that whatever takes a tract takes shapes too."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..anatomy.files import has_suffix
from ..anatomy.labels import Labels
from ..anatomy.read import PartNames, read_tract
from ..anatomy.surface import tract_from_surface
from ..anatomy.tract import Finding, LabelTract, SurfaceTract
from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.level_sets import find_level_set
from .base import Duct
from .shape_files import SUFFIXES, ShapesFile, load_shapes_file

SPACING = 0.5
"""Spacing of the nodes that the wall of shapes is sought between [mm], if these are not more..."""
MOST_NODES = 30_000_000
"""...than this."""
BLOCK = 8
"""Cells along the edge of a block: where the wall cannot be, one distance is enough for all."""


def open_tract(
    path: str | os.PathLike[str],
    *,
    labels: Labels | None = None,
    part: PartNames | None = None,
    unit: str | None = None,
    frame: str | None = None,
    repair: bool = False,
) -> LabelTract | SurfaceTract:
    """Read a tract from a label volume or a surface, or make one of a file of shapes.

    Parameters
    ----------
    path : path-like
        As for `bozzini.anatomy.read_tract`, or a file of shapes in space (.json, .yaml).
    labels, part, unit, frame, repair
        As for `bozzini.anatomy.read_tract`; shapes take none of it.

    Raises
    ------
    BozziniError
        As `read_tract` and `load_shapes_file` do; if the shapes are planar, or something is given
        that they do not have.
    """
    if not has_suffix(path, SUFFIXES):
        return read_tract(path, labels=labels, part=part, unit=unit, frame=frame, repair=repair)
    given = {"labels": labels, "part": part, "unit": unit != "mm" and unit, "frame": frame}
    for name, value in {**given, "repair": repair}.items():
        if value:
            raise InputError(f"{path} is a file of shapes, in mm: it has no {name}, leave it out")
    return make_shape_tract(load_shapes_file(path), source=Path(path).name)


def make_shape_tract(file: ShapesFile, *, source: str = "shapes") -> LabelTract | SurfaceTract:
    """Return triangles on the wall of shapes; the finding says how far off they are.

    The wall is where the signed distance is 0, by marching cubes; as it changes by 1 mm per mm at
    most, blocks that it cannot be in are told by one distance each. Corners are moved onto the wall
    along the gradient. `wall_error` is the largest distance from the wall of corners, middles of
    edges and middles of triangles, on top of what the file states.

    Raises
    ------
    InputError
        If the shapes are planar.
    GeometryError
        If they enclose nothing, or not one space.
    """
    duct = file.shapes
    if duct.dim != 3:
        raise InputError(
            f"{source} holds planar shapes: a scope is planned in space; for a chain in the plane "
            "use 'bozzini duct chain'"
        )
    vertices, faces, spacing = _find_wall(duct)
    for _ in range(2):
        vertices = _move_onto_wall(duct, vertices)
    corners = vertices[faces]
    middles = 0.5 * (corners + np.roll(corners, 1, axis=1))
    places = np.concatenate([vertices, middles.reshape(-1, 3), corners.mean(axis=1)])
    off = float(np.abs(duct.signed_distance(places)).max())
    name = str(getattr(duct, "name", type(duct).__name__))
    message = (
        f"the wall of {name} is made of {len(faces)} triangles, {off:.2g} mm off it at most at "
        f"their corners and middles (nodes {spacing:.2g} mm apart)"
    )
    found = [Finding("shapes-meshed", "note", message)]
    if file.fit == "least squares":
        message = "the shapes were fitted through the wall of a tract: they reach beyond it"
        found.append(Finding("shapes-outside", "warning", message))
    tract = tract_from_surface(vertices, faces, source=source, findings=found)
    error = duct.wall_error
    return replace(
        tract,
        wall=f"triangles on the wall of {name}",
        wall_error=None if error is None else error + off,
    )


def _find_wall(duct: Duct) -> tuple[Floats, NDArray[np.int64], float]:
    """Return vertices [mm] and triangles where the distance is 0, and the spacing of the nodes."""
    low, high = duct.bounds
    size = high - low
    spacing = max(SPACING, float((np.prod(size) / MOST_NODES) ** (1.0 / 3.0)))
    spacing = min(spacing, float(size.min()) / 16.0)
    counts = np.ceil(size / (BLOCK * spacing)).astype(int) + 1
    origin = low - 0.5 * (BLOCK * spacing * counts - size)
    half = 0.5 * BLOCK * spacing
    blocks = np.indices(counts).reshape(3, -1).T
    middle = duct.signed_distance(origin + (blocks + 0.5) * (2.0 * half))
    nodes = BLOCK * counts + 1
    values = np.repeat(
        np.repeat(np.repeat(middle.reshape(counts), BLOCK, 0), BLOCK, 1), BLOCK, 2
    ).astype(np.float32)
    values = np.pad(values, [(0, 1)] * 3, mode="edge")
    within = np.indices((BLOCK + 1,) * 3).reshape(3, -1).T
    near = np.flatnonzero(np.abs(middle) <= np.sqrt(3.0) * half * (1.0 + 1e-9))
    for part in np.array_split(near, max(1, len(near) // 512)):
        index = (BLOCK * blocks[part])[:, None] + within
        flat = np.ravel_multi_index(tuple(index.reshape(-1, 3).T), tuple(nodes))
        values.reshape(-1)[flat] = duct.signed_distance(origin + index.reshape(-1, 3) * spacing)
    vertices, faces = find_level_set(values)
    return origin + vertices * spacing, faces, spacing


def _move_onto_wall(duct: Duct, points: Floats) -> Floats:
    """Return points a step of Newton nearer to the wall, where that brings them nearer."""
    distance = duct.signed_distance(points)
    moved = points - distance[:, None] * duct.gradient(points)
    nearer = np.abs(duct.signed_distance(moved)) < np.abs(distance)
    return np.where(nearer[:, None], moved, points)
