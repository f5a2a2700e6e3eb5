"""3MF (3D Manufacturing Format, core specification 1.3): its meshes, each where the build puts it.

trimesh reads it by lxml; it is a ZIP archive of XML, for which Python has all.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError
from .files import declares_entities, explain

MOST_BYTES = 1 << 30
"""Of a model when it is unpacked."""

MOST_MESHES, DEEPEST = 1000, 20
"""Meshes of a file, and components in components."""

UNITS = {
    "micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8,
    "meter": 1000.0,
}  # fmt: skip
"""In mm."""

_PATH = "{http://schemas.microsoft.com/3dmanufacturing/production/2015/06}path"
_MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"

Matrix = NDArray[np.float64]
Part = tuple[str, NDArray[np.float64], NDArray[np.int64]]


def read_3mf(file: Path) -> tuple[list[Part], float]:
    """Return name, corners and triangles of each mesh of the build, and the unit [mm].

    Raises
    ------
    FileFormatError
        If the file is broken.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            return _read_build(archive)
    except FileFormatError as error:
        raise FileFormatError(f"{file} is not read: {error}") from None
    except Exception as error:  # of the archive, of XML, of numbers
        raise FileFormatError(f"{file} is not 3MF triangles: {explain(error)}") from None


def _read_build(archive: zipfile.ZipFile) -> tuple[list[Part], float]:
    @cache
    def load(path: str) -> ElementTree.Element:
        return _load(archive, path.lstrip("/"))

    def list_meshes(path: str, item: ElementTree.Element, depth: int) -> Iterator[Part]:
        """Give the meshes of an item of the build, or of a component, each where it puts them."""
        if depth > DEEPEST:
            raise FileFormatError(f"its components are more than {DEEPEST} deep")
        path, wanted = item.get(_PATH, path), item.get("objectid")
        objects = load(path).iterfind("{*}resources/{*}object")
        thing = next((each for each in objects if each.get("id") == wanted), None)
        if thing is None:
            raise FileFormatError(f"it has no object {wanted}")
        if thing.get("type") in ("support", "solidsupport"):
            return
        numbers = np.array(item.get("transform", "1 0 0 0 1 0 0 0 1 0 0 0").split(), dtype=float)
        turn = numbers.reshape(4, 3)  # of rows: a place times the first three, plus the last
        mesh = thing.find("{*}mesh")
        if mesh is not None:
            corners = _read_numbers(mesh, "vertices", "xyz").astype(np.float64)
            faces = _read_numbers(mesh, "triangles", ("v1", "v2", "v3")).astype(np.int64)
            yield thing.get("name") or str(wanted), corners @ turn[:3] + turn[3], faces
        for component in thing.iterfind("{*}components/{*}component"):
            for name, corners, faces in list_meshes(path, component, depth + 1):
                yield name, corners @ turn[:3] + turn[3], faces

    links = _load(archive, "_rels/.rels")
    start = next(link.get("Target", "") for link in links if link.get("Type") == _MODEL)
    root = load(start)
    unit = root.get("unit", "millimeter")
    if unit not in UNITS:
        raise FileFormatError(f"its unit is '{unit[:40]}': known are {', '.join(UNITS)}")
    parts: list[Part] = []
    for item in root.iterfind("{*}build/{*}item"):
        for part in list_meshes(start, item, 0):
            if len(parts) == MOST_MESHES:
                raise FileFormatError(f"it has more than {MOST_MESHES} meshes")
            parts.append(part)
    return parts, UNITS[unit]


def _load(archive: zipfile.ZipFile, path: str) -> ElementTree.Element:
    if archive.getinfo(path).file_size > MOST_BYTES:
        raise FileFormatError(f"{path} is larger than {MOST_BYTES} bytes")
    data = archive.read(path)
    if declares_entities(data):
        raise FileFormatError("it declares XML entities")
    return ElementTree.fromstring(data)


def _read_numbers(mesh: ElementTree.Element, rows: str, names: str | tuple[str, ...]) -> Matrix:
    table = [[float(row.attrib[name]) for name in names] for row in mesh.iterfind(f"{{*}}{rows}/*")]
    return np.reshape(table, (-1, 3))
