"""Writing a tract to a file, by its suffix."""

from __future__ import annotations

import gzip
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, OutputError
from ..io.files import write_bytes
from ._reading import quiet_libraries
from .frame import convert_frame
from .labels import write_label_table
from .surfaces import MARK
from .tract import LabelTract, SurfaceTract

__all__ = ["check_target", "encode_volume", "write_tract"]

_LABELS = (".nii", ".nii.gz")
_SURFACES = (".stl", ".ply", ".obj", ".glb")


def check_target(path: str | os.PathLike[str], *, force: bool = False) -> str:
    """Say which form a file's name asks for, ``"labels"`` or ``"surface"``.

    Raises
    ------
    InputError
        If the suffix is of no known kind.
    OutputError
        If the file exists and `force` is not given, or its directory does not.
    """
    name = os.fspath(path).lower()
    if not name.endswith(_LABELS + _SURFACES):
        raise InputError(
            f"{path}: cannot tell what to write from the name; known are "
            f"{', '.join(_SURFACES + _LABELS)}"
        )
    target = Path(path)
    if target.is_dir():
        raise OutputError(f"{path} is a directory: give the name of a file")
    if target.exists() and not force:
        raise OutputError(f"{path} exists already: choose another name or give --force")
    if not target.parent.is_dir():
        raise OutputError(f"cannot write {path}: {target.parent} is not a directory")
    return "labels" if name.endswith(_LABELS) else "surface"


def write_tract(
    path: str | os.PathLike[str], tract: LabelTract | SurfaceTract, *, force: bool = False
) -> Path:
    """Write labels as NIfTI or a surface as STL, PLY, OBJ or GLB, in its own frame.

    NIfTI is RAS by definition: labels of another known frame (LPS of NRRD or DICOM) are written
    so that they lie at the same place of the patient. Names of labels are written with them.

    All are in mm but GLB, which is in m as its standard says; its axes are as they are, and their
    frame is kept in the file.

    Parameters
    ----------
    path : path-like
        The suffix decides the format.
    tract : LabelTract or SurfaceTract
    force : bool
        Replace a file that exists.

    Raises
    ------
    InputError
        If the suffix is unknown, or does not suit the form of the tract.
    OutputError
        If the file cannot be written, or exists and `force` is not given.
    """
    kind = check_target(path, force=force)
    if kind != tract.kind:
        raise InputError(f"{path} holds a {kind} tract, but the tract given is {tract.kind}")
    if isinstance(tract, LabelTract):
        affine, frame, names = tract.affine, tract.frame, tract.label_names
        data = encode_volume(path, tract.labels, affine=affine, frame=frame, names=names)
    else:
        data = _encode(path, tract)
    return write_bytes(path, data)


def _encode(path: str | os.PathLike[str], tract: SurfaceTract) -> bytes:
    import trimesh

    kind = Path(path).suffix.lower().lstrip(".")
    scale = 1e-3 if kind == "glb" else 1.0
    with quiet_libraries():
        mesh = trimesh.Trimesh(vertices=tract.vertices * scale, faces=tract.faces, process=False)
        if kind == "glb":
            gltf: Any = trimesh.exchange.gltf
            data: Any = gltf.export_glb(
                mesh, tree_postprocessor=lambda tree: _mark_frame(tree, tract.frame)
            )
        else:
            data = mesh.export(file_type=kind)
    return data.encode("utf-8") if isinstance(data, str) else bytes(data)


def _mark_frame(tree: dict[str, Any], frame: str | None) -> None:
    tree["asset"]["extras"] = {MARK: {"frame": frame}}


def encode_volume(
    path: str | os.PathLike[str],
    values: NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32],
    *,
    affine: NDArray[np.float64],
    frame: str | None,
    names: Mapping[int, str] | None = None,
) -> bytes:
    """Return a volume as the bytes of a NIfTI file, compressed if its name ends in ``.gz``.

    Parameters
    ----------
    path : path-like
        Its suffix decides on the compression.
    values : ndarray, shape (nx, ny, nz)
        Labels, which take 8 bits where these are enough, or numbers.
    affine : ndarray, shape (4, 4)
        Voxel index to world [mm].
    frame : str or None
        Where the world axes point; NIfTI has one frame, RAS, and axes of another are turned.
    names : mapping of int to str, optional
        Names of the labels, which are kept in the file.
    """
    import nibabel

    nifti: Any = nibabel
    if values.dtype == np.uint16 and values.max() < 256:
        values = values.astype(np.uint8)
    affine = affine if frame is None else convert_frame(affine, frame)
    image: Any = nifti.Nifti1Image(values, affine)
    image.header.set_xyzt_units("mm")
    image.set_sform(affine, code="scanner")
    image.set_qform(affine, code="scanner")
    if names:
        table = write_label_table(names).encode()
        image.header.extensions.append(nifti.nifti1.Nifti1Extension(0, table))
    data: bytes = image.to_bytes()
    if os.fspath(path).lower().endswith(".gz"):
        return gzip.compress(data, compresslevel=4, mtime=0)
    return data
