"""Results in the formats of other tools: 3D Slicer markups, VTK poly data, NIfTI volumes.

Coordinates stay in the frame of the input [mm]. Slicer's markups name that frame, RAS or LPS; a
NIfTI file's world is RAS+ by its standard, so there the axes are turned.
"""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..anatomy.frame import convert_frame
from ..anatomy.tract import LabelTract, SurfaceTract
from ..duct import Centreline, SampledField
from ..files import write_atomically, write_text

__all__ = ["write_centreline", "write_volumes"]

MARKUPS_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/"
    "Resources/Schema/markups-schema-v1.0.3.json#"
)


def write_centreline(line: Centreline, folder: Path, *, frame: str) -> None:
    """Write centreline.mrk.json and centreline.vtp into a folder.

    Parameters
    ----------
    frame : str
        Of the line's coordinates, such as ``"RAS"``. Markups know RAS and LPS only: coordinates
        in any other frame are turned to RAS there.
    """
    write_text(folder / "centreline.mrk.json", _format_markups(line, frame))
    write_text(folder / "centreline.vtp", _format_poly_line(line))


def _format_markups(line: Centreline, frame: str) -> str:
    system, points = frame, line.points
    if frame not in ("RAS", "LPS"):
        system, points = "RAS", points @ convert_frame(np.eye(4), frame)[:3, :3].T
    record = {
        "@schema": MARKUPS_SCHEMA,
        "markups": [
            {
                "type": "Curve",
                "coordinateSystem": system,
                "coordinateUnits": "mm",
                "labelFormat": "%N-%d",
                "controlPoints": [
                    {
                        "id": f"{number}",
                        "label": f"{arc:.0f} mm",
                        "position": [round(float(value), 4) for value in point],
                        "selected": True,
                        "locked": True,
                        "visibility": False,
                        "positionStatus": "defined",
                    }
                    for number, (point, arc) in enumerate(
                        zip(points, line.arc_length, strict=True), start=1
                    )
                ],
                "measurements": [
                    {
                        "name": "length",
                        "enabled": True,
                        "value": round(line.length, 4),
                        "units": "mm",
                    }
                ],
                "display": {"visibility": True, "pointLabelsVisibility": False},
            }
        ],
    }
    return json.dumps(record, indent=1, allow_nan=False) + "\n"


def _format_poly_line(line: Centreline) -> str:
    count = len(line.points)

    def array(name: str, values: NDArray[np.float64], parts: int = 1) -> str:
        text = " ".join(f"{value:.6g}" for value in np.asarray(values).ravel())
        return (
            f'<DataArray type="Float64" Name="{name}" NumberOfComponents="{parts}" '
            f'format="ascii">{text}</DataArray>'
        )

    connectivity = " ".join(str(number) for number in range(count))
    return (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian">\n<PolyData>\n'
        f'<Piece NumberOfPoints="{count}" NumberOfVerts="0" NumberOfLines="1" '
        'NumberOfStrips="0" NumberOfPolys="0">\n'
        '<PointData Scalars="MaximumInscribedSphereRadius">\n'
        f"{array('MaximumInscribedSphereRadius', line.radius)}\n"
        f"{array('ArcLength', line.arc_length)}\n</PointData>\n"
        f"<Points>\n{array('Points', line.points, 3)}\n</Points>\n<Lines>\n"
        f'<DataArray type="Int64" Name="connectivity" format="ascii">{connectivity}</DataArray>\n'
        f'<DataArray type="Int64" Name="offsets" format="ascii">{count}</DataArray>\n'
        "</Lines>\n</Piece>\n</PolyData>\n</VTKFile>\n"
    )


def write_volumes(
    field: SampledField, tract: LabelTract | SurfaceTract, folder: Path, *, frame: str
) -> None:
    """Write the distance field and the lumen as field.nii.gz and labels.nii.gz.

    The field is the signed distance to the (inflated) wall [mm], negative inside. The lumen has
    the labels of the tract, cropped to it as the tract is; of a surface it is 1 at the nodes of
    the field that lie inside.
    """
    axes = np.eye(4)
    axes[:3, :3] = field.rotation * field.spacing
    axes[:3, 3] = field.origin
    values = np.asarray(field.values, dtype=np.float32) - np.float32(field.inflation)
    _write_nifti(folder / "field.nii.gz", values, axes, frame)
    if isinstance(tract, LabelTract):
        _write_nifti(folder / "labels.nii.gz", tract.labels, tract.affine, frame)
    else:
        inside = np.asarray(field.values < 0.0).astype(np.uint8)
        _write_nifti(folder / "labels.nii.gz", inside, axes, frame)


def _write_nifti(
    path: Path, values: NDArray[np.generic], affine: NDArray[np.float64], frame: str
) -> None:
    import nibabel

    image: Any = nibabel.Nifti1Image(values, convert_frame(affine, frame))  # type: ignore[no-untyped-call]
    image.header.set_xyzt_units("mm")
    data = gzip.compress(image.to_bytes(), compresslevel=4, mtime=0)

    def write(temporary: Path) -> None:
        temporary.write_bytes(data)

    write_atomically(path, write)
