"""Files of tracts: what readers share, names of labels in a header, and writing."""

from __future__ import annotations

import gzip
import logging
import math
import os
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from ..checks import check_path
from ..errors import BozziniError, FileFormatError, InputError
from ..io.files import check_new_file, write_bytes
from ..io.inputs import note_input
from .frame import convert_frame
from .tract import LabelTract, SurfaceTract

PathLike = str | os.PathLike[str]


def has_suffix(path: PathLike, known: tuple[str, ...]) -> bool:
    """Whether a name ends in one of some suffixes, in small or capital letters."""
    return os.fspath(check_path("path", path)).lower().endswith(known)


def declares_entities(data: bytes) -> bool:
    """Whether XML declares entities, by which a small file may unfold to a huge one."""
    return b"<!DOCTYPE" in data or b"<!ENTITY" in data


def check_file(path: PathLike) -> None:
    """Raise `FileFormatError` if a file is missing, empty or cannot be read."""
    file = Path(path)
    note_input(file)
    try:
        if not file.exists():
            raise FileFormatError(f"{path}: no such file")
        if not file.is_file():
            raise FileFormatError(f"{path} is not a file")
        if file.stat().st_size == 0:
            raise FileFormatError(f"{path} is empty (0 bytes)")
        with file.open("rb") as handle:
            handle.read(1)
    except BozziniError:
        raise
    except (OSError, ValueError) as error:
        raise FileFormatError(f"{path} cannot be read: {explain(error)}") from None


def explain(error: BaseException) -> str:
    """Return what went wrong as one short line."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return " ".join(str(error).split())[:160] or type(error).__name__


_LIBRARIES = ("nibabel", "trimesh", "PIL", "pydicom", "highdicom")
"""Whose loggers print on their own, some with a traceback, where they can go on."""


def read_number(word: str) -> float:
    """Return a word as a number, NaN where it is none."""
    try:
        return float(word)
    except ValueError:
        return math.nan


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """Silence all loggers and warnings of the libraries that read: what matters is a finding."""
    known = list(logging.root.manager.loggerDict)
    loggers = [logging.getLogger(name) for name in known if name.split(".")[0] in _LIBRARIES]
    before = [logger.disabled for logger in loggers]
    for logger in loggers:
        logger.disabled = True
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, state in zip(loggers, before, strict=True):
            logger.disabled = state


def read_label_table(text: str) -> dict[int, str]:
    """Return the names in a label table of a NIfTI header extension; {} where it is none.

    The form is that of Caret and of TotalSegmentator: ``<Label Key="1">name</Label>``.
    """
    begin, end = text.find("<LabelTable>"), text.find("</LabelTable>")
    if begin < 0 or end < 0 or "<!" in re.sub(r"<!\[CDATA\[", "", text[begin:end]):
        return {}
    try:
        root = ElementTree.fromstring(text[begin : end + len("</LabelTable>")])
        found = {int(item.get("Key", "")): (item.text or "").strip() for item in root}
    except (ElementTree.ParseError, ValueError):
        return {}
    return {label: name for label, name in found.items() if label > 0 and name}


def _write_label_table(names: Mapping[int, str]) -> str:
    rows = "".join(
        f'<Label Key="{label}" Red="1" Green="1" Blue="1" Alpha="1">{escape(name)}</Label>'
        for label, name in sorted(names.items())
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?><CaretExtension><VolumeInformation Index="0">'
        f"<LabelTable>{rows}</LabelTable><VolumeType>Label</VolumeType></VolumeInformation>"
        "</CaretExtension>"
    )


FRAME_KEY = "bozzini"
"""Key under which a GLB keeps the frame of its axes."""

_LABELS = (".nii", ".nii.gz")
_SURFACES = (".stl", ".ply", ".obj", ".glb")


def check_target(path: PathLike, *, force: bool = False) -> str:
    """Return which form a file's name asks for, ``"labels"`` or ``"surface"``.

    Raises
    ------
    InputError
        If the suffix is of no known kind.
    OutputError
        If the file exists and `force` is not given, or its place takes no new file.
    """
    if not has_suffix(path, _LABELS + _SURFACES):
        raise InputError(
            f"{path}: cannot tell what to write from the name; known are "
            f"{', '.join(_SURFACES + _LABELS)}"
        )
    check_new_file(path, (Path(path).suffix.lower(),), force=force)
    return "labels" if has_suffix(path, _LABELS) else "surface"


def write_tract(path: PathLike, tract: LabelTract | SurfaceTract, *, force: bool = False) -> Path:
    """Write labels as NIfTI or a surface as STL, PLY, OBJ or GLB, in its own frame.

    NIfTI is RAS by definition: labels of another known frame (LPS of NRRD or DICOM) are written
    so that they lie at the same place of the patient. Names of labels are written with them.

    All are in mm but GLB, which is in m as its standard states; its axes are as they are, and their
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
        data = _encode_surface(Path(path).suffix.lower().lstrip("."), tract)
    return write_bytes(path, data)


def _encode_surface(kind: str, tract: SurfaceTract) -> bytes:
    from trimesh import Trimesh
    from trimesh.exchange.gltf import export_glb

    def mark_frame(tree: dict[str, dict[str, object]]) -> None:
        tree["asset"]["extras"] = {FRAME_KEY: {"frame": tract.frame}}

    scale = 1e-3 if kind == "glb" else 1.0
    with quiet_libraries():
        mesh = Trimesh(vertices=tract.vertices * scale, faces=tract.faces, process=False)
        if kind == "glb":
            return bytes(export_glb(mesh, tree_postprocessor=mark_frame))
        data = mesh.export(file_type=kind)
    return data.encode("utf-8") if isinstance(data, str) else bytes(data)


def encode_volume(
    path: PathLike,
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
    from nibabel.nifti1 import Nifti1Extension, Nifti1Image

    if values.dtype == np.uint16 and values.max() < 256:
        values = values.astype(np.uint8)
    affine = affine if frame is None else convert_frame(affine, frame)
    image = Nifti1Image(values, affine)
    image.header.set_xyzt_units("mm")
    image.set_sform(affine, code="scanner")
    image.set_qform(affine, code="scanner")
    if names:
        image.header.extensions.append(Nifti1Extension(0, _write_label_table(names).encode()))
    data: bytes = image.to_bytes()
    return gzip.compress(data, compresslevel=4, mtime=0) if has_suffix(path, (".gz",)) else data
