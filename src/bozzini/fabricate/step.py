"""STEP files of parts by Open CASCADE (the extra ``cad``): exact cylinders, swept channels."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import MissingExtraError, OutputError
from ..io.files import write_atomically
from ..numeric.arrays import Floats
from .part import Channel, Part, cut, drill

if TYPE_CHECKING:
    from OCP.Geom import Geom_BSplineSurface
    from OCP.TopoDS import TopoDS_Face, TopoDS_Shape, TopoDS_Wire
    from scipy.interpolate import BSpline


FIT_ERROR_MM = 1e-5
"""How far the spline of a swept channel may pass from its cuts [mm]."""

SEAM_MM = 1e-6
"""Within what distance edges of faces are one edge [mm]."""


def check_step() -> None:
    """Raise `MissingExtraError` if STEP files cannot be written."""
    try:
        import OCP.collections  # noqa: F401  # there since version 8
    except ImportError:
        raise MissingExtraError("cadquery-ocp-novtk", "cad") from None


def write_step(part: Part, path: str | os.PathLike[str]) -> Path:
    """Write a part as a STEP file in mm, and return the path.

    Straight channels are cylinders; swept ones are splines within 1e-5 mm of their cuts.

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

    if not all(channel.is_straight for channel in part.channels):
        return _sew(part)
    heights, radii = np.array(part.outline).T
    axis = np.column_stack([np.zeros((len(heights), 2)), heights])
    shape = _turn(axis, radii)
    for channel in part.channels:
        rest = BRepAlgoAPI_Cut(shape, _turn_channel(channel, part))
        if not rest.IsDone():
            return None
        shape = rest.Shape()
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
    """Return a line (n + 2, 3) that goes on straight through the faces where it meets them."""
    ends = []
    for k, face in ((0, part.low), (-1, part.high)):
        is_open = abs(line[k, 2] - face) <= 1e-9
        beyond = 1.0 + channel.diameter[k] * channel.stretch[k] if is_open else 0.0
        way = np.append(channel.slope[k], 1.0) / channel.stretch[k]
        ends.append(line[k] + (beyond if k else -beyond) * way)
    return np.vstack([ends[0], line, ends[1]])


def _sew(part: Part) -> TopoDS_Shape | None:
    """Return a part without steps, sewn of its faces: cuts by long swept channels take minutes."""
    from OCP.BRepBuilderAPI import (
        BRepBuilderAPI_MakeFace,
        BRepBuilderAPI_MakeSolid,
        BRepBuilderAPI_Sewing,
    )
    from OCP.BRepLib import BRepLib
    from OCP.gp import gp_Dir, gp_Pln, gp_Pnt
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    radius = part.outline[0][1]
    body = drill("outside", 2.0 * radius, *np.array([[0.0, 0.0, part.low], [0.0, 0.0, part.high]]))
    sewing = BRepBuilderAPI_Sewing(SEAM_MM)
    rims: dict[float, list[TopoDS_Wire]] = {}
    for channel in (body, *part.channels):
        face, low, high = _wrap(channel)
        sewing.Add(face)
        for z, rim in ((channel.centre[0, 2], low), (channel.centre[-1, 2], high)):
            rims.setdefault(round(float(z), 9), []).append(rim)
    for z, loops in rims.items():
        plane = gp_Pln(gp_Pnt(0.0, 0.0, z), gp_Dir(0.0, 0.0, 1.0))
        is_end = z in (round(part.low, 9), round(part.high, 9))
        cap = BRepBuilderAPI_MakeFace(plane, loops[0])
        for loop in loops[1:] if is_end else []:
            cap.Add(TopoDS.Wire(loop.Reversed()))
        sewing.Add(cap.Face())
        for loop in [] if is_end else loops[1:]:
            sewing.Add(BRepBuilderAPI_MakeFace(plane, loop).Face())
    sewing.Perform()
    found = TopExp_Explorer(sewing.SewedShape(), TopAbs_ShapeEnum.TopAbs_SHELL)
    if not found.More() or sewing.NbFreeEdges():
        return None
    solid = BRepBuilderAPI_MakeSolid(TopoDS.Shell(found.Current())).Solid()
    BRepLib.OrientClosedSolid_s(solid)
    return solid


def _wrap(channel: Channel) -> tuple[TopoDS_Face, TopoDS_Wire, TopoDS_Wire]:
    """Return the wall of a channel and its two rims.

    Across z it is an exact ellipse, a rational quadratic of nine poles; along z a cubic spline.
    """
    from OCP.BRepBuilderAPI import (
        BRepBuilderAPI_MakeEdge,
        BRepBuilderAPI_MakeFace,
        BRepBuilderAPI_MakeWire,
    )
    from OCP.Geom import Geom_CylindricalSurface
    from OCP.gp import gp_Ax3, gp_Dir, gp_Pnt

    low, high = channel.centre[[0, -1], 2].tolist()
    if channel.is_straight and not channel.slope.any():
        axis = gp_Ax3(gp_Pnt(*channel.centre[0].tolist()), gp_Dir(0.0, 0.0, 1.0))
        surface = Geom_CylindricalSurface(axis, 0.5 * float(channel.diameter[0]))
        low, high = 0.0, high - low
        face = BRepBuilderAPI_MakeFace(surface, 0.0, 2.0 * math.pi, low, high, SEAM_MM).Face()
    else:
        surface = _make_surface(channel)
        face = BRepBuilderAPI_MakeFace(surface, SEAM_MM).Face()
    rims = [
        BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(surface.VIso(v)).Edge()).Wire()
        for v in (low, high)
    ]
    return face, rims[0], rims[1]


def _make_surface(channel: Channel) -> Geom_BSplineSurface:
    from OCP.collections import Array1_double, Array1_int, Array2_double, Array2_gp_Pnt
    from OCP.Geom import Geom_BSplineSurface
    from OCP.gp import gp_Pnt

    square = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]
    rings = cut(channel, np.array(square, dtype=float))
    spline = _fit(channel.centre[:, 2], rings.reshape(len(rings), -1))
    knots, counts = np.unique(spline.t, return_counts=True)
    rows = spline.c.reshape(-1, len(square), 3)
    poles = Array2_gp_Pnt(1, len(square), 1, len(rows))
    weights = Array2_double(1, len(square), 1, len(rows))
    for v, row in enumerate(rows.tolist(), start=1):
        for u, pole in enumerate(row, start=1):
            poles.SetValue(u, v, gp_Pnt(*pole))
            weights.SetValue(u, v, 1.0 if u % 2 else math.sqrt(0.5))

    def fill(kind: type[Array1_double], values: list[float]) -> Array1_double:
        array = kind(1, len(values))
        for k, value in enumerate(values, start=1):
            array.SetValue(k, value)
        return array

    return Geom_BSplineSurface(
        poles,
        weights,
        fill(Array1_double, [0.0, 0.25, 0.5, 0.75, 1.0]),
        fill(Array1_double, knots.tolist()),
        fill(Array1_int, [3, 2, 2, 2, 3]),
        fill(Array1_int, counts.tolist()),
        2,
        spline.k,
    )


def _fit(z: Floats, values: Floats) -> BSpline:
    """Return a spline of few pieces that passes all values (n, m) within `FIT_ERROR_MM`."""
    from scipy.interpolate import make_interp_spline

    degree = min(3, len(z) - 1)
    stride = 1 << (len(z) // 4).bit_length()
    while True:
        kept = np.union1d(np.arange(0, len(z), stride), np.linspace(0, len(z) - 1, 4).astype(int))
        spline = make_interp_spline(z[kept], values[kept], k=degree)
        if stride == 1 or np.abs(spline(z) - values).max() <= FIT_ERROR_MM:
            return spline
        stride //= 2
