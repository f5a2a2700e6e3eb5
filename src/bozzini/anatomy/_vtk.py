"""The legacy VTK file of triangles (``# vtk DataFile``, ASCII PolyData), read with NumPy alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError

__all__ = ["read_vtk"]


def read_vtk(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read the points and triangles of an ASCII legacy VTK PolyData file.

    Polygons of more than three corners are split into fans; strips, lines and attributes are
    not read.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    vertices : ndarray, shape (n, 3)
        In the file's unit.
    faces : ndarray, shape (m, 3)

    Raises
    ------
    FileFormatError
        If it is not such a file, or it is cut short.
    """
    try:
        text = path.read_bytes().decode("ascii")
    except UnicodeDecodeError:
        raise FileFormatError(
            f"{path} is not an ASCII legacy VTK file: save it as ASCII, or as STL or PLY"
        ) from None
    lines = text.split("\n", 4)
    if not lines[0].startswith("# vtk DataFile") or len(lines) < 5:
        raise FileFormatError(f"{path} is not a legacy VTK file")
    if lines[2].strip().upper() != "ASCII" or lines[3].split()[:2] != ["DATASET", "POLYDATA"]:
        raise FileFormatError(
            f"{path} is {lines[2].strip()} {lines[3].strip()}: only ASCII DATASET POLYDATA is read"
        )
    words = lines[4].split()
    try:
        vertices = _read_points(words)
        faces = _read_polygons(words)
    except (ValueError, IndexError):
        raise FileFormatError(
            f"{path} is cut short or damaged: its numbers do not add up"
        ) from None
    return vertices, faces


def _read_points(words: list[str]) -> NDArray[np.float64]:
    at = words.index("POINTS")
    number = int(words[at + 1])
    return np.array(words[at + 3 : at + 3 + 3 * number], dtype=np.float64).reshape(number, 3)


def _read_polygons(words: list[str]) -> NDArray[np.int64]:
    at = words.index("POLYGONS")
    number, size = int(words[at + 1]), int(words[at + 2])
    table = np.array(words[at + 3 : at + 3 + size], dtype=np.int64)
    if len(table) != size:
        raise ValueError("too few numbers")
    if size == 4 * number and (table[::4] == 3).all():
        return table.reshape(number, 4)[:, 1:]
    faces, place = [], 0
    for _ in range(number):
        corners = table[place + 1 : place + 1 + table[place]]
        faces += [(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)]
        place += int(table[place]) + 1
    return np.array(faces, dtype=np.int64).reshape(-1, 3)
