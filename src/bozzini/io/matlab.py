"""Matrices of numbers in files of MATLAB 5 to 7.2 (``-v6`` and ``-v7``).

SciPy's reader ends the process on some damaged files, hence this one. The format is that of
MathWorks' "MAT-File Format", chapter "Version 7 MAT-File Format".
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError

Matrix = NDArray[np.generic]

_MATRIX, _COMPRESSED = 14, 15
_STORED = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8",
            15: "u8"}  # fmt: skip
_COMPLEX = 0x0800
_MOST_BYTES = 1 << 28


def read_matrices(path: Path) -> dict[str, Matrix | None]:
    """Return the variables of a file by name; None for those that are no real numbers.

    Raises
    ------
    FileFormatError
        If it cannot be read, or is no such file.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileFormatError(f"cannot read {path}: {error.strerror or error}") from None
    if data[:10] == b"MATLAB 7.3":
        raise FileFormatError(f"{path} is a MATLAB 7.3 file: save it with '-v7' in MATLAB")
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None or data[:6] != b"MATLAB":
        raise FileFormatError(f"{path} is no file of MATLAB 5 to 7.2")
    try:
        return dict(_read_variables(data, order))
    except (struct.error, zlib.error, ValueError, IndexError, OverflowError) as error:
        raise FileFormatError(f"{path} is a damaged MATLAB file: {error}") from None


def _read_variables(data: bytes, order: str) -> Iterator[tuple[str, Matrix | None]]:
    place = 128
    while place + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, place)
        body = data[place + 8 : place + 8 + size]
        if len(body) < size:
            raise ValueError(f"it ends {size - len(body)} bytes too early")
        place += 8 + size
        if kind == _COMPRESSED:
            body = zlib.decompressobj().decompress(body, _MOST_BYTES)
            kind, size = struct.unpack_from(f"{order}II", body)
            body = body[8 : 8 + size]
        if kind == _MATRIX and body:
            yield _read_variable(body, order)


def _read_variable(body: bytes, order: str) -> tuple[str, Matrix | None]:
    """Return name and value; parts of a variable stand one after the other."""
    parts = _split(body, order)
    flags = struct.unpack_from(f"{order}I", next(parts)[1])[0]
    shape = [int(n) for n in np.frombuffer(next(parts)[1], f"{order}i4")]
    name = next(parts)[1].decode("ascii", "replace")
    chosen = _CLASSES.get(flags & 0xFF)
    if chosen is None or flags & _COMPLEX:
        return name, None
    kind, values = next(parts)
    if kind not in _STORED:
        raise ValueError(f"the values of '{name}' are of the unknown type {kind}")
    if len(shape) < 2 or min(shape) < 0:
        raise ValueError(f"'{name}' has the shape {shape}")
    # Whole numbers are stored as such, whatever the class of the matrix.
    numbers = np.frombuffer(values, order + _STORED[kind])
    if numbers.size != math.prod(shape):
        raise ValueError(f"'{name}' has {numbers.size} values, not {math.prod(shape)}")
    return name, numbers.astype(chosen).reshape(shape, order="F")


def _split(body: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Give type and bytes of each part; short ones stand in the tag itself."""
    place = 0
    while True:
        word = struct.unpack_from(f"{order}I", body, place)[0]
        if word >> 16:
            kind, size, begin, step = word & 0xFFFF, word >> 16, place + 4, 8
        else:
            kind, size = struct.unpack_from(f"{order}II", body, place)
            begin, step = place + 8, 8 + 8 * math.ceil(size / 8)
        if begin + size > len(body):
            raise ValueError("a part is longer than its variable")
        yield kind, body[begin : begin + size]
        place += step
