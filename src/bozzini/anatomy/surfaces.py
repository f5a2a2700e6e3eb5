"""The triangles of a lumen's wall from files."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError, UnitError
from ._files import check_file, explain, has_suffix, name_file
from ._quiet import quiet_libraries
from .surface import tract_from_surface
from .tract import SurfaceTract

__all__ = ["SURFACE_SUFFIXES", "read_surface"]

SURFACE_SUFFIXES = (".stl", ".ply", ".obj", ".glb", ".off", ".vtk")

_UNIT_WORD = re.compile(r"[^\W\d_][^\W\d]*")
"""A word: a number in it would multiply the unit."""


def read_surface(
    path: str | os.PathLike[str],
    *,
    part: str | None = None,
    unit: str | None = None,
    frame: str | None = None,
    repair: bool = False,
) -> SurfaceTract:
    """Read the wall of a lumen from a file of triangles, as mm in the file's own frame.

    A scene of several parts (GLB) is joined, each part moved to where its node puts it.

    Parameters
    ----------
    path : path-like
        A ``.stl``, ``.ply``, ``.obj``, ``.glb``, ``.off`` or (ASCII legacy) ``.vtk`` file.
    unit : str
        Unit of the file's coordinates, for example ``"mm"``, ``"m"``, ``"in"``. The file's own
        word is not asked: STL, PLY, OBJ and OFF have none, and GLB written from anatomy is
        in mm as often as in the m that its standard prescribes.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, broken or holds no triangles.
    UnitError
        If the unit is not a length.
    InputError, GeometryError
        As `tract_from_surface` does.
    """
    from ..units import parse_quantity

    unit = "mm" if unit is None else unit
    if not _UNIT_WORD.fullmatch(unit):
        raise UnitError(f"unit is '{unit}': it must be a unit of length such as mm, cm, m or in")
    scale = parse_quantity(f"1 {unit}", "length")
    check_file(path)
    if not has_suffix(path, SURFACE_SUFFIXES):
        raise FileFormatError(f"{path} is not named {', '.join(SURFACE_SUFFIXES)}")
    if has_suffix(path, (".vtk",)):
        from ._vtk import read_vtk

        vertices, faces = read_vtk(Path(path))
    else:
        vertices, faces = _read_mesh(path)
    if len(faces) == 0:
        raise FileFormatError(f"{path} holds no triangles")
    return tract_from_surface(vertices * scale, faces, source=name_file(path))


def _read_mesh(path: str | os.PathLike[str]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    import trimesh

    file = Path(path)
    kind = file.suffix.lower().lstrip(".")
    with quiet_libraries():
        try:
            with file.open("rb") as handle:
                loaded: Any = trimesh.load(handle, file_type=kind, process=False)
            parts = _list_parts(loaded)
        except Exception as error:  # trimesh's loaders raise many kinds on a broken file
            raise FileFormatError(
                f"{path} is not {kind.upper()} triangles: {explain(error)}"
            ) from None
    if not parts:
        raise FileFormatError(f"{path} holds no triangles")
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts[:-1]])
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([faces + at for (_, faces), at in zip(parts, starts, strict=True)]),
    )


def _list_parts(loaded: Any) -> list[tuple[NDArray[np.float64], NDArray[np.int64]]]:
    """Return the vertices, moved to the world, and the faces of each mesh of what was loaded."""
    import trimesh

    placed: list[tuple[Any, NDArray[np.float64]]] = [(loaded, np.eye(4))]
    if isinstance(loaded, trimesh.Scene):
        placed = []
        for node in loaded.graph.nodes_geometry:
            transform, name = loaded.graph[node]
            placed.append((loaded.geometry[name], np.asarray(transform, dtype=np.float64)))
    parts = []
    for mesh, transform in placed:
        if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
            continue
        vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
        faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
        parts.append((vertices @ transform[:3, :3].T + transform[:3, 3], faces))
    return parts
