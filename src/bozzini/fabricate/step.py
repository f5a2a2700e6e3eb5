"""STEP files of parts by Open CASCADE (the extra ``cad``): exact cylinders, swept channels."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import MissingExtraError, OutputError
from ..io.files import write_atomically
from .part import Channel, Floats, Part

if TYPE_CHECKING:
    from OCP.TopoDS import TopoDS_Shape


FIT_ERROR_MM = 1e-3
"""How far the spline of a swept channel may pass from its middle line [mm]."""


def check_step() -> None:
    """Raise `MissingExtraError` if STEP files cannot be written."""
    try:
        import OCP.collections  # noqa: F401  # there since version 8
    except ImportError:
        raise MissingExtraError("cadquery-ocp-novtk", "cad") from None


def write_step(part: Part, path: str | os.PathLike[str]) -> Path:
    """Write a part as a STEP file in mm, and return the path.

    Straight channels are cylinders; others are pipes round a spline within 0.001 mm of the line.

    Raises
    ------
    MissingExtraError
        If the extra ``cad`` is not installed.
    OutputError
        If the kernel cannot make the solid, or the file cannot be written.
    """
    check_step()
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer

    shape = _make_solid(part)
    if shape is None or not BRepCheck_Analyzer(shape).IsValid():
        raise OutputError(f"cannot write {path}: Open CASCADE makes no valid solid of {part.name}")

    def save(temporary: Path) -> None:
        with _quiet():
            writer = STEPControl_Writer()
            writer.Transfer(shape, STEPControl_StepModelType.STEPControl_AsIs)
            status = writer.Write(str(temporary))
        if status != IFSelect_ReturnStatus.IFSelect_RetDone:
            raise OutputError(f"cannot write {path}: Open CASCADE failed")

    return write_atomically(path, save)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Open CASCADE from writing statistics on stdout."""
    from OCP.Message import Message, Message_Gravity

    printers = list(Message.DefaultMessenger_s().Printers())
    levels = [printer.GetTraceLevel() for printer in printers]
    for printer in printers:
        printer.SetTraceLevel(Message_Gravity.Message_Fail)
    try:
        yield
    finally:
        for printer, level in zip(printers, levels, strict=True):
            printer.SetTraceLevel(level)


def _make_solid(part: Part) -> TopoDS_Shape | None:
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut

    heights, radii = np.array(part.outline).T
    axis = np.column_stack([np.zeros((len(heights), 2)), heights])
    shape = _turn(axis, radii)
    for channel in part.channels:
        tool = _turn_channel(channel, part) if channel.is_straight else _sweep(channel, part)
        cut = BRepAlgoAPI_Cut(shape, tool)
        if not cut.IsDone():
            return None
        shape = cut.Shape()
    return shape


def _turn(line: Floats, radii: Floats) -> TopoDS_Shape:
    """Return the solid of revolution with these radii at places (n, 3) along a straight line."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakePolygon
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeRevol
    from OCP.gp import gp_Ax1, gp_Dir, gp_Pnt

    way = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
    aside = np.cross(way, [0.0, 1.0, 0.0])
    aside /= np.linalg.norm(aside)
    profile = [line[0], *(line + radii[:, None] * aside), line[-1]]
    polygon = BRepBuilderAPI_MakePolygon()
    for point in profile:
        polygon.Add(gp_Pnt(*point.tolist()))
    polygon.Close()
    face = BRepBuilderAPI_MakeFace(polygon.Wire()).Face()
    axis = gp_Ax1(gp_Pnt(*line[0].tolist()), gp_Dir(*way.tolist()))
    return BRepPrimAPI_MakeRevol(face, axis).Shape()


def _turn_channel(channel: Channel, part: Part) -> TopoDS_Shape:
    line = _lengthen(channel.centre, channel, part)
    sizes = 0.5 * channel.diameter
    return _turn(line, np.concatenate([sizes[:1], sizes, sizes[-1:]]))


def _lengthen(line: Floats, channel: Channel, part: Part) -> Floats:
    """Return a line (n + 2, 3) that goes on straight through the faces where it meets them.

    A blind end is lengthened by nothing to speak of, so that there are as many places.
    """
    ends = []
    for k, face in ((0, part.low), (-1, part.high)):
        is_open = abs(line[k, 2] - face) <= 1e-9
        beyond = 1.0 + channel.diameter[k] * channel.stretch[k] if is_open else 1e-4
        way = np.append(channel.slope[k], 1.0) / channel.stretch[k]
        ends.append(line[k] + (beyond if k else -beyond) * way)
    return np.vstack([ends[0], line, ends[1]])


def _sweep(channel: Channel, part: Part) -> TopoDS_Shape:
    """Return the pipe round a curved middle line."""
    from OCP.BRepBuilderAPI import (
        BRepBuilderAPI_MakeEdge,
        BRepBuilderAPI_MakeFace,
        BRepBuilderAPI_MakeWire,
    )
    from OCP.BRepOffsetAPI import BRepOffsetAPI_MakePipe
    from OCP.collections import Array1_gp_Pnt
    from OCP.GeomAbs import GeomAbs_Shape
    from OCP.GeomAPI import GeomAPI_PointsToBSpline
    from OCP.gp import gp_Ax2, gp_Circ, gp_Dir, gp_Pnt

    line = _lengthen(channel.centre, channel, part)
    points = Array1_gp_Pnt(1, len(line))
    for k, point in enumerate(line, start=1):
        points.SetValue(k, gp_Pnt(*point.tolist()))
    spline = GeomAPI_PointsToBSpline(points, 3, 8, GeomAbs_Shape.GeomAbs_C2, FIT_ERROR_MM)
    curve = spline.Curve()
    spine = BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(curve).Edge()).Wire()
    way = gp_Dir(*np.append(channel.slope[0], 1.0).tolist())
    circle = gp_Circ(gp_Ax2(gp_Pnt(*line[0].tolist()), way), 0.5 * float(channel.diameter[0]))
    rim = BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(circle).Edge()).Wire()
    return BRepOffsetAPI_MakePipe(spine, BRepBuilderAPI_MakeFace(rim).Face()).Shape()
