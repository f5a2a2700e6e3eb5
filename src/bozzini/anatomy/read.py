"""Reading a tract from a file: a label volume or the triangles of its wall."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Sequence
from pathlib import Path

from ..errors import FileFormatError, InputError
from ._reading import explain, has_suffix
from .labels import Labels
from .surfaces import SURFACE_SUFFIXES, read_surface
from .tract import LabelTract, SurfaceTract
from .volumes import LABEL_SUFFIXES, is_volume, read_labels

__all__ = [
    "LABEL_SUFFIXES",
    "SURFACE_SUFFIXES",
    "hash_input",
    "read_labels",
    "read_surface",
    "read_tract",
]


def hash_input(path: str | os.PathLike[str]) -> str:
    """Return the SHA-256 of a tract's file, of all files of a folder, or of a header and its data.

    Parameters
    ----------
    path : path-like
        What `read_tract` reads. Of a folder the names of the files count too: they may be those of
        the labels.

    Raises
    ------
    FileFormatError
        If it is missing or cannot be read.
    """
    try:
        return _hash_files(Path(path))
    except FileNotFoundError:
        raise FileFormatError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise FileFormatError(f"{path} cannot be read: {explain(error)}") from None


def _hash_files(place: Path) -> str:
    total = hashlib.sha256()
    files = [place]
    if place.is_dir():
        files = sorted(
            item for item in place.iterdir() if item.is_file() and not item.name.startswith(".")
        )
        total.update(b"".join(os.fsencode(item.name) + b"\0" for item in files))
    if has_suffix(place, (".nhdr", ".mhd")):
        found = re.search(
            rb"(?im)^(?:data ?file\s*:|ElementDataFile\s*=)\s*(.+?)\s*$", place.read_bytes()
        )
        if found and (place.parent / os.fsdecode(found[1])).is_file():
            files.append(place.parent / os.fsdecode(found[1]))
    for file in files:
        with file.open("rb") as handle:
            while piece := handle.read(1 << 20):
                total.update(piece)
    return total.hexdigest()


def read_tract(
    path: str | os.PathLike[str],
    *,
    labels: Labels | None = None,
    part: str | int | Sequence[str | int] | None = None,
    unit: str | None = None,
    frame: str | None = None,
    repair: bool = False,
) -> LabelTract | SurfaceTract:
    """Read a tract from a label volume or a surface, by the suffix of the file.

    Parameters
    ----------
    path : path-like
        ``.nii``, ``.nii.gz``, ``.nrrd``, ``.nhdr``, ``.mha``, ``.mhd`` or a folder of such masks
        (labels), or ``.stl``, ``.ply``, ``.obj``, ``.glb``, ``.off``,
        ``.vtk`` (surface).
    labels : sequence of int or str, optional
        The labels that make up the lumen, by number or name, or ``"all"``; only for a label
        volume.
    part : str, int or sequence of them, optional
        Parts of a scene by name or number, ``"all"``; several are united. Only for a surface.
    unit : str, optional
        Unit of the file's coordinates; only for a surface (a volume's header states its own).
    frame : str, optional
        Where the world axes of the file point in the patient, such as ``"LPS"``; by default as
        the file says.
    repair : bool
        Mend what can be mended safely; only for a surface.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, broken, or of a kind that is not read.
    InputError, GeometryError, UnitError
        If what it holds cannot be used, or an argument does not go with it.
    """
    if is_volume(path):
        if unit not in (None, "mm"):
            raise InputError(f"unit is '{unit}': a label volume states its own unit, leave it out")
        if part is not None:
            raise InputError(f"{path} is a label volume: it has labels, no parts")
        return read_labels(path, labels=labels, frame=frame)
    if has_suffix(path, SURFACE_SUFFIXES):
        if labels is not None:
            raise InputError(f"{path} is a surface: it has no labels to select")
        return read_surface(path, part=part, unit=unit, frame=frame, repair=repair)
    raise FileFormatError(
        f"{path}: cannot tell its kind from the name; known are "
        f"{', '.join(LABEL_SUFFIXES + SURFACE_SUFFIXES)}"
    )
