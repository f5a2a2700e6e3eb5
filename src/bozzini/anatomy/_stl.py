"""Triangles of STL files, binary and ASCII."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError

__all__ = ["read_stl"]

HEAD = 84
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")


def read_stl(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read the triangles of an STL file, each with its own corners.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    vertices : ndarray, shape (3 m, 3)
        In the file's unit.
    faces : ndarray, shape (m, 3)

    Raises
    ------
    FileFormatError
        If it is no STL file, or its size is not that of the triangles that it states.
    """
    data = path.read_bytes()
    number = int.from_bytes(data[80:HEAD], "little") if len(data) >= HEAD else -1
    if number >= 0 and len(data) == HEAD + _TRIANGLE.itemsize * number:
        table = np.frombuffer(data, dtype=_TRIANGLE, offset=HEAD, count=number)
        corners = table["corners"].astype(np.float64)
    elif data.lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        words = _VERTEX.findall(data)
        facets = len(re.findall(rb"\bendfacet\b", data))
        ended = re.search(rb"\bendsolid\b", data) is not None
        if len(words) != 3 * facets or not ended:
            raise FileFormatError(f"{path} is not STL triangles: it is cut short or damaged")
        try:
            corners = np.array(words, dtype=np.float64).reshape(-1, 3, 3)
        except ValueError:
            raise FileFormatError(f"{path} is not STL triangles: a vertex is no number") from None
    else:
        stated = f": {number} triangles stated, {len(data)} bytes there" if number >= 0 else ""
        raise FileFormatError(f"{path} is not STL triangles{stated}")
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)
