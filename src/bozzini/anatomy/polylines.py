"""Lines with radii in files of other tools: VTK poly data of VMTK, curves of 3D Slicer."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError
from ..io.records import load_data
from ..numeric.arrays import Floats
from ..numeric.polylines import measure_arc_length
from ._surface_formats import (
    Numbers,
    load_legacy,
    open_xml,
    read_point_data,
    split_lines,
    tell_damage,
)
from .files import check_file, has_suffix
from .frame import convert_frame
from .tract import FARTHEST_MM

SUFFIXES = (".vtp", ".vtk", ".mrk.json")

RADII = ("MaximumInscribedSphereRadius", "Radius")
"""What radii are called by VMTK and by 3D Slicer."""

SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/"
    "Schema/markups-schema-v1.0.3.json#"
)

_SPACE = re.compile(r"\b(RAS|LPS)\b")


@dataclass(frozen=True, eq=False)
class RoundLines:
    """Lines, each with the radius about its points.

    Parameters
    ----------
    points : tuple of (n, 3) float
        Of each line [mm].
    radius : tuple of (n,) float
        At these [mm].
    frame : str, optional
        Where the axes point in the patient, as far as the file states it: ``"RAS"`` or ``"LPS"``.
    """

    points: tuple[Floats, ...]
    radius: tuple[Floats, ...]
    frame: str | None = None

    def turn(self, frame: str | None) -> RoundLines:
        """Return the lines in another frame; where either is not known as they are."""
        if frame is None or self.frame is None:
            return self
        turn = convert_frame(np.eye(4), self.frame, frame)[:3, :3]
        return RoundLines(tuple(line @ turn.T for line in self.points), self.radius, frame)


def has_lines(path: str | os.PathLike[str]) -> bool:
    """Whether a file of poly data has lines and no triangles, or is one of Slicer's markups."""
    if not has_suffix(path, SUFFIXES):
        return False
    file = Path(path)
    check_file(file)
    if has_suffix(path, (".mrk.json",)):
        return True
    if has_suffix(path, (".vtk",)):
        found = load_legacy(file)
        return bool(found.lines) and len(found.faces) == 0
    root, _ = open_xml(file)
    counts = {
        name: sum(int(piece.get(f"NumberOf{name}", "0") or 0) for piece in root.iter("Piece"))
        for name in ("Lines", "Polys", "Strips")
    }
    return counts["Lines"] > 0 and counts["Polys"] == counts["Strips"] == 0


def read_round_lines(path: str | os.PathLike[str]) -> RoundLines:
    """Read lines with their radii.

    Parameters
    ----------
    path : path-like
        Poly data of VTK (``.vtp``, ``.vtk``) whose points have `RADII`, or curves of 3D Slicer
        (``.mrk.json``) with a measurement of that name at their control points.

    Raises
    ------
    FileFormatError
        If it cannot be read, has no lines, or no radii above 0.
    """
    check_file(path)
    file = Path(path)
    read = _read_markups if has_suffix(path, (".mrk.json",)) else _read_poly_data
    lines = read(file)
    for points, radius in zip(lines.points, lines.radius, strict=True):
        if radius.shape != (len(points),):
            raise FileFormatError(
                f"{path} has a line of {len(points)} points with {radius.size} radii"
            )
        legal = (np.abs(points) <= FARTHEST_MM).all() and (radius > 0.0).all()
        if not (legal and (radius <= FARTHEST_MM).all()):
            raise FileFormatError(
                f"{path} has a point too far off or a radius of {radius.min():g} mm: places "
                f"must be within {FARTHEST_MM:g} mm, radii above 0"
            )
    return lines


def _read_poly_data(path: Path) -> RoundLines:
    pieces = []
    if has_suffix(path, (".vtk",)):
        found = load_legacy(path)
        space = found.title
        with tell_damage(path):
            if found.lines:
                arrays = read_point_data(found.rest, found.take)
                pieces.append((found.points, found.lines, arrays[_choose_radius(path, arrays)]))
    else:
        root, reader = open_xml(path)
        with tell_damage(path):
            fields = [item for item in root.iter("Array") if item.get("Name") == "SPACE"]
            codes = [bytes(reader.read(item).astype(np.uint8)) for item in fields]
            space = b"".join(codes).decode("ascii", "replace")
            for piece in root.iter("Piece"):
                table = reader.read_cells(piece, "Lines")
                rows = [] if table is None else split_lines(*table)
                if rows:
                    items = {each.get("Name", ""): each for each in piece.iterfind("PointData/*")}
                    radius = reader.read(items[_choose_radius(path, items)])
                    pieces.append((reader.read_points(piece), rows, radius))
    if not pieces:
        raise FileFormatError(f"{path} has no lines: a tree is poly data with lines")
    with tell_damage(path):
        lines = _cut_lines(pieces, _find_space(space))
    if not lines.points:
        raise FileFormatError(f"{path} has no lines of more than one point")
    return lines


def _choose_radius(path: Path, names: Iterable[str]) -> str:
    """Return the name of the array of radii."""
    known = [name for name in RADII if name in names]
    if not known:
        raise FileFormatError(
            f"{path}: its points must have an array {' or '.join(RADII)}, they have "
            f"{', '.join(sorted(names)) or 'none'}"
        )
    return known[0]


def _cut_lines(
    pieces: Sequence[tuple[Floats, list[NDArray[np.int64]], Numbers]], frame: str | None
) -> RoundLines:
    points, radii = [], []
    for places, lines, radius in pieces:
        for line in lines:
            if line.min(initial=0) < 0:
                raise ValueError("negative number of a point")
            if len(line) < 2:
                continue
            points.append(places[line])
            radii.append(np.asarray(radius, dtype=np.float64)[line])
    return RoundLines(tuple(points), tuple(radii), frame)


def _find_space(text: str) -> str | None:
    """Return the frame that Slicer states in a title or a field."""
    found = _SPACE.search(text)
    return None if found is None else found[1]


def _read_markups(path: Path) -> RoundLines:
    data = load_data(path)
    points, radii, frames = [], [], set()
    try:
        curves = [each for each in data["markups"] if each["type"] == "Curve"]  # type: ignore[index]
        for curve in curves:
            points.append(
                np.array([each["position"] for each in curve["controlPoints"]], dtype=np.float64)
            )
            values = [
                each["controlPointValues"]
                for each in curve.get("measurements", ())
                if each["name"] in RADII and "controlPointValues" in each
            ]
            radii.append(np.array(values[0] if values else [], dtype=np.float64))
            frames.add(str(curve.get("coordinateSystem", "LPS")))
    except (TypeError, ValueError, KeyError, AttributeError):
        raise FileFormatError(f"{path} has no list of Slicer's markups: it must have one") from None
    if not curves or not all(line.ndim == 2 and line.shape[1] == 3 for line in points):
        raise FileFormatError(f"{path} has no curves: a tree is curves of points in space")
    if not all(len(values) for values in radii):
        raise FileFormatError(
            f"{path}: each curve must have a measurement Radius with a value at each control point"
        )
    if frames not in ({"LPS"}, {"RAS"}):
        raise FileFormatError(f"{path} is in the frame {', '.join(sorted(frames))}: it must be RAS "
                              "or LPS")  # fmt: skip
    return RoundLines(tuple(points), tuple(radii), frames.pop())


def format_curves(
    names: Sequence[str],
    lines: Sequence[Floats],
    radius: Sequence[Floats | None],
    *,
    frame: str,
) -> str:
    """Return lines as curves of 3D Slicer, their radius as a measurement at the control points.

    Parameters
    ----------
    names : sequence of str
        Of each line; ``""`` leaves it to Slicer.
    lines : sequence of (n, 3) float
        Points of each [mm].
    radius : sequence of (n,) float or None
        About these [mm]; None leaves it out.
    frame : str
        Of the points. Markups know RAS and LPS only: any other one is turned to RAS.
    """
    system = frame if frame in ("RAS", "LPS") else "RAS"
    turn = convert_frame(np.eye(4), frame, system)[:3, :3]
    curves = []
    for name, line, around in zip(names, lines, radius, strict=True):
        arcs = measure_arc_length(line)
        points = [
            {
                "id": f"{number}",
                "label": f"{arc:.0f} mm",
                "position": [round(float(value), 4) for value in point],
                "selected": True,
                "locked": True,
                "visibility": False,
                "positionStatus": "defined",
            }
            for number, (point, arc) in enumerate(zip(line @ turn.T, arcs, strict=True), start=1)
        ]
        length = round(float(arcs[-1]), 4)
        measured: list[dict[str, object]] = [{"name": "length", "value": length}]
        if around is not None:
            radii = [round(float(value), 4) for value in around]
            measured.append({"name": "Radius", "controlPointValues": radii})
        curves.append(
            {
                "type": "Curve",
                **({"name": name} if name else {}),
                "coordinateSystem": system,
                "coordinateUnits": "mm",
                "labelFormat": "%N-%d",
                "controlPoints": points,
                "measurements": [{**each, "enabled": True, "units": "mm"} for each in measured],
                "display": {"visibility": True, "pointLabelsVisibility": False},
            }
        )
    return json.dumps({"@schema": SCHEMA, "markups": curves}, indent=1, allow_nan=False) + "\n"
