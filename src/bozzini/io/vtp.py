"""Polylines as VTK poly data (``.vtp``), in text: what ParaView, 3D Slicer and VMTK open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..numeric.arrays import Floats


def format_polylines(
    lines: Sequence[Floats],
    point_data: Mapping[str, Floats],
    *,
    cell_data: Mapping[str, Floats] | None = None,
    frame: str | None = None,
) -> str:
    """Return lines as VTK poly data.

    Parameters
    ----------
    lines : sequence of (n, 3) float
        Points of each line.
    point_data : mapping of str to (m,) float
        Values at the points of all lines, one line after the other; the first are its scalars.
    cell_data : mapping of str to (l,) float, optional
        A value for each line.
    frame : str, optional
        Of the points; 3D Slicer takes ``"RAS"`` or ``"LPS"``, others are not stated.
    """
    points = np.concatenate(list(lines))
    ends = np.cumsum([len(line) for line in lines])
    connectivity = " ".join(str(number) for number in range(len(points)))
    offsets = " ".join(str(end) for end in ends)
    scalars = next(iter(point_data))
    values = "\n".join(_format_array(name, array) for name, array in point_data.items())
    cells = "".join(f"{_format_array(name, array)}\n" for name, array in (cell_data or {}).items())
    return (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian">\n<PolyData>\n'
        + (_format_space(frame) if frame in ("RAS", "LPS") else "")
        + f'<Piece NumberOfPoints="{len(points)}" NumberOfVerts="0" NumberOfLines="{len(ends)}" '
        'NumberOfStrips="0" NumberOfPolys="0">\n'
        f'<PointData Scalars="{scalars}">\n'
        f"{values}\n</PointData>\n"
        + (f"<CellData>\n{cells}</CellData>\n" if cells else "")
        + f"<Points>\n{_format_array('Points', points, 3)}\n</Points>\n<Lines>\n"
        f'<DataArray type="Int64" Name="connectivity" format="ascii">{connectivity}</DataArray>\n'
        f'<DataArray type="Int64" Name="offsets" format="ascii">{offsets}</DataArray>\n'
        "</Lines>\n</Piece>\n</PolyData>\n</VTKFile>\n"
    )


def _format_space(frame: str) -> str:
    codes = " ".join(str(code) for code in frame.encode())
    return (
        '<FieldData>\n<Array type="String" Name="SPACE" NumberOfTuples="1" format="ascii">'
        f"{codes} 0</Array>\n</FieldData>\n"
    )


def _format_array(name: str, values: Floats, parts: int = 1) -> str:
    text = " ".join(f"{value:.6g}" for value in np.asarray(values).ravel())
    return (
        f'<DataArray type="Float64" Name="{name}" NumberOfComponents="{parts}" '
        f'format="ascii">{text}</DataArray>'
    )
