"""Places that were marked in 3D Slicer: a point of a markups file."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_points, show_value
from ..errors import FileFormatError
from ..io.records import load_data
from ..numeric.arrays import Floats
from .frame import convert_frame

_SYSTEMS = {"0": "RAS", "1": "LPS", "RAS": "RAS", "LPS": "LPS"}


def read_fiducial(path: str | os.PathLike[str], frame: str | None) -> Floats:
    """Return the one place (3,) that a file of Slicer's markups has [mm].

    Parameters
    ----------
    path : path-like
        A ``.mrk.json`` or a ``.fcsv``.
    frame : str, optional
        Of the world that it is asked in, such as ``"RAS"``, which it is by default.

    Raises
    ------
    FileFormatError
        If it is no such file, or has no place or more than one.
    """
    source = Path(path)
    system, places = _read_csv(source) if source.suffix.lower() == ".fcsv" else _read_json(source)
    if len(places) != 1:
        raise FileFormatError(f"{path} has {len(places)} places: it must have 1")
    if system not in _SYSTEMS:
        raise FileFormatError(f"{path} is in the frame {show_value(system)}: it must be RAS or LPS")
    turn = convert_frame(np.eye(4), _SYSTEMS[system], frame or "RAS")[:3, :3]
    return np.asarray(check_points(f"the place of {path}", places[0]) @ turn.T)


def _read_json(path: Path) -> tuple[str, list[ArrayLike]]:
    data = load_data(path)
    markups = data.get("markups") if isinstance(data, Mapping) else None
    try:
        (markup,) = markups  # type: ignore[misc]
        places = [point["position"] for point in markup["controlPoints"]]
        return str(markup.get("coordinateSystem", "LPS")), places
    except (TypeError, ValueError, KeyError, AttributeError):
        raise FileFormatError(f"{path} has no list of Slicer's markups: it must have one") from None


def _read_csv(path: Path) -> tuple[str, list[ArrayLike]]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise FileFormatError(f"cannot read {path}: {error}") from None
    system = "RAS"
    places: list[ArrayLike] = []
    for line in lines:
        if line.startswith("#"):
            name, _, value = line.lstrip("# ").partition("=")
            system = value.strip() if name.strip() == "CoordinateSystem" else system
            continue
        cells = next(csv.reader([line]), [])
        try:
            places.append([float(cell) for cell in cells[1:4]])
        except ValueError:
            raise FileFormatError(
                f"{path} has the row {show_value(line)}: it has no place"
            ) from None
    return system, places
