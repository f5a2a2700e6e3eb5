"""Reading a tract from a file: a label volume (NIfTI) or the triangles of its wall."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BozziniError, FileFormatError, InputError, UnitError
from ._quiet import quiet_libraries
from .findings import Finding
from .labels import tract_from_labels
from .surface import tract_from_surface
from .tract import LabelTract, SurfaceTract

__all__ = ["LABEL_SUFFIXES", "SURFACE_SUFFIXES", "read_labels", "read_surface", "read_tract"]

LABEL_SUFFIXES = (".nii", ".nii.gz")
SURFACE_SUFFIXES = (".stl", ".ply", ".obj", ".glb", ".off", ".vtk")

_UNIT_WORD = re.compile(r"[^\W\d_][^\W\d]*")
"""A word: a number in it would multiply the unit."""

_SCALE_TO_MM = {"mm": 1.0, "meter": 1000.0, "micron": 0.001}


def read_tract(
    path: str | os.PathLike[str], *, labels: Sequence[int] | None = None, unit: str = "mm"
) -> LabelTract | SurfaceTract:
    """Read a tract from a label volume or a surface, by the suffix of the file.

    Parameters
    ----------
    path : path-like
        ``.nii``, ``.nii.gz`` (labels) or ``.stl``, ``.ply``, ``.obj``, ``.glb``, ``.off``,
        ``.vtk`` (surface).
    labels : sequence of int, optional
        The labels that make up the lumen; only for a label volume.
    unit : str
        Unit of the file's coordinates; only for a surface (a volume's header states its own).

    Raises
    ------
    FileFormatError
        If the file is missing, empty, broken, or of a kind that is not read.
    InputError, GeometryError, UnitError
        If what it holds cannot be used, or an argument does not go with it.
    """
    if _suffix(path, LABEL_SUFFIXES):
        if unit != "mm":
            raise InputError(f"unit is '{unit}': a NIfTI file states its own unit, leave it out")
        return read_labels(path, labels=labels)
    if _suffix(path, SURFACE_SUFFIXES):
        if labels is not None:
            raise InputError(f"{path} is a surface: it has no labels to select")
        return read_surface(path, unit=unit)
    raise FileFormatError(
        f"{path}: cannot tell its kind from the name; known are "
        f"{', '.join(LABEL_SUFFIXES + SURFACE_SUFFIXES)}"
    )


def read_labels(path: str | os.PathLike[str], *, labels: Sequence[int] | None = None) -> LabelTract:
    """Read a label volume from a NIfTI file, in its world frame (RAS+) in mm.

    Parameters
    ----------
    path : path-like
        A ``.nii`` or ``.nii.gz`` file.
    labels : sequence of int, optional
        The labels that make up the lumen; by default every value but 0.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, truncated or not NIfTI.
    InputError, GeometryError
        As `tract_from_labels` does.
    """
    _check_file(path)
    if not _suffix(path, LABEL_SUFFIXES):
        raise FileFormatError(f"{path} is not named .nii or .nii.gz")
    array, affine, found = _read_nifti(path)
    return tract_from_labels(array, affine, labels=labels, source=_name(path), findings=found)


def read_surface(path: str | os.PathLike[str], *, unit: str = "mm") -> SurfaceTract:
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

    if not _UNIT_WORD.fullmatch(unit):
        raise UnitError(f"unit is '{unit}': it must be a unit of length such as mm, cm, m or in")
    scale = parse_quantity(f"1 {unit}", "length")
    _check_file(path)
    if not _suffix(path, SURFACE_SUFFIXES):
        raise FileFormatError(f"{path} is not named {', '.join(SURFACE_SUFFIXES)}")
    if _suffix(path, (".vtk",)):
        from ._vtk import read_vtk

        vertices, faces = read_vtk(Path(path))
    else:
        vertices, faces = _read_mesh(path)
    if len(faces) == 0:
        raise FileFormatError(f"{path} holds no triangles")
    return tract_from_surface(vertices * scale, faces, source=_name(path))


def _suffix(path: str | os.PathLike[str], known: tuple[str, ...]) -> bool:
    return os.fspath(path).lower().endswith(known)


def _name(path: str | os.PathLike[str]) -> str:
    return Path(path).name


def _check_file(path: str | os.PathLike[str]) -> None:
    file = Path(path)
    try:
        if not file.exists():
            raise FileFormatError(f"{path}: no such file")
        if not file.is_file():
            raise FileFormatError(f"{path} is not a file")
        if file.stat().st_size == 0:
            raise FileFormatError(f"{path} is empty (0 bytes)")
        with file.open("rb") as handle:
            handle.read(1)
    except (OSError, ValueError) as error:
        if isinstance(error, BozziniError):
            raise
        raise FileFormatError(f"{path} cannot be read: {_explain(error)}") from None


def _explain(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    text = " ".join(str(error).split())
    return text[:160] if text else type(error).__name__


def _read_nifti(
    path: str | os.PathLike[str],
) -> tuple[NDArray[Any], NDArray[np.float64], list[Finding]]:
    import nibabel

    with quiet_libraries():
        try:
            image: Any = nibabel.load(os.fspath(path), mmap=False)
            header: Any = image.header
            unit = header.get_xyzt_units()[0]
            framed = int(header["qform_code"]) > 0 or int(header["sform_code"]) > 0
            affine = np.array(image.affine, dtype=np.float64)
        except Exception as error:  # nibabel and gzip raise many kinds on a broken file
            raise FileFormatError(f"{path} is not a NIfTI volume: {_explain(error)}") from None
        _check_dimensions(path, tuple(int(length) for length in image.shape))
        try:
            array = np.asarray(image.dataobj)
        except MemoryError:
            raise FileFormatError(
                f"{path} does not fit in memory: its shape is {image.shape}"
            ) from None
        except Exception as error:  # as above
            raise FileFormatError(
                f"{path} is truncated or damaged: its voxels cannot be read ({_explain(error)})"
            ) from None
    found = []
    if unit in _SCALE_TO_MM:
        affine[:3] *= _SCALE_TO_MM[unit]
    if unit == "unknown":
        message = "the file states no unit of length: taken as mm"
        found.append(Finding("unit-unknown", "note", message))
    elif unit != "mm":
        message = f"the file is in {unit}: converted to mm"
        found.append(Finding("unit-converted", "note", message))
    if not framed:
        message = (
            "the file states no world frame (qform and sform codes are 0): the origin is the "
            "middle of the volume, left and right are by NIfTI's default"
        )
        found.append(Finding("frame-unknown", "warning", message))
    return array, affine, found


def _check_dimensions(path: str | os.PathLike[str], shape: tuple[int, ...]) -> None:
    """Refuse a series of volumes before its voxels are read."""
    extra = [length for length in shape[3:] if length != 1]
    if len(shape) < 3 or extra:
        raise FileFormatError(
            f"{path} has {len(shape)} dimensions, shape {shape}: a label volume has 3"
        )


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
                f"{path} is not {kind.upper()} triangles: {_explain(error)}"
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
