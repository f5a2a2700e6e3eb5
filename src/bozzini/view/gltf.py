"""A small writer of binary glTF 2.0 files (``.glb``): arrays in, one file out.

It packs NumPy arrays into the file's one buffer and keeps the JSON lists beside it. It knows
nothing of scopes or tracts; `bozzini.view.scene` does.

Source: Khronos Group, glTF 2.0 Specification (ISO/IEC 12113:2022), sections 3.6 (binary data),
3.11 (animations) and 4 (GLB container).
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

__all__ = ["ARRAY_BUFFER", "ELEMENT_ARRAY_BUFFER", "GlbDocument"]

ARRAY_BUFFER = 34962
"""Buffer target of vertex attributes."""

ELEMENT_ARRAY_BUFFER = 34963
"""Buffer target of vertex indices."""

_COMPONENTS = {
    np.dtype(np.uint8): 5121,
    np.dtype(np.uint16): 5123,
    np.dtype(np.uint32): 5125,
    np.dtype(np.float32): 5126,
}
_WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_MAGIC, _VERSION = 0x46546C67, 2
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942


class GlbDocument:
    """A glTF document being built: JSON lists and one binary buffer.

    Parameters
    ----------
    generator : str
        Name of the writing program, kept in ``asset.generator``.
    extras : dict, optional
        Free notes, kept in ``asset.extras``.

    Notes
    -----
    The same calls give the same bytes: nothing depends on the time or the machine.
    """

    def __init__(self, *, generator: str, extras: dict[str, Any] | None = None) -> None:
        asset: dict[str, Any] = {"version": "2.0", "generator": generator}
        if extras:
            asset["extras"] = extras
        self._json: dict[str, Any] = {"asset": asset}
        self._chunks: list[bytes] = []
        self._length = 0

    def add(self, kind: str, item: dict[str, Any]) -> int:
        """Append `item` to a top-level list (``"nodes"``, ``"meshes"``, …); return its index."""
        items: list[dict[str, Any]] = self._json.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def get(self, kind: str, index: int) -> dict[str, Any]:
        """Return an item of a top-level list, to be completed in place."""
        item: dict[str, Any] = self._json[kind][index]
        return item

    def set_scene(self, index: int) -> None:
        """Make scene `index` the one that viewers show."""
        self._json["scene"] = index

    def use_extension(self, name: str, content: dict[str, Any] | None = None) -> None:
        """Declare an optional extension, with its document-level content if it has one."""
        used: list[str] = self._json.setdefault("extensionsUsed", [])
        if name not in used:
            used.append(name)
        if content is not None:
            self._json.setdefault("extensions", {})[name] = content

    def add_array(
        self, array: NDArray[Any], *, target: int | None = None, bounds: bool = False
    ) -> int:
        """Store one array and return its accessor's index.

        Parameters
        ----------
        array : ndarray, shape (n,) or (n, width)
            uint8, uint16, uint32 or float32 values; `width` is 1, 2, 3, 4 or 16.
        target : int, optional
            `ARRAY_BUFFER` or `ELEMENT_ARRAY_BUFFER`; none for animation data.
        bounds : bool
            Whether to write the accessor's min and max (positions and times need them).

        Raises
        ------
        InputError
            If glTF has no accessor for this type or shape.
        """
        return self.add_arrays(array[np.newaxis], target=target, bounds=bounds)[0]

    def add_arrays(
        self, arrays: NDArray[Any], *, target: int | None = None, bounds: bool = False
    ) -> list[int]:
        """Store a stack of equal arrays in one buffer view; return one accessor for each.

        Parameters
        ----------
        arrays : ndarray, shape (stack, n) or (stack, n, width)
            As for `add_array`.
        target, bounds
            As for `add_array`.

        Raises
        ------
        InputError
            If glTF has no accessor for this type or shape, or a row is not 4-byte aligned.
        """
        data = np.ascontiguousarray(arrays)
        width = 1 if data.ndim == 2 else int(np.prod(data.shape[2:]))
        if data.dtype not in _COMPONENTS or data.ndim not in (2, 3) or width not in _WIDTHS:
            raise InputError(
                f"array of type {data.dtype} and shape {data.shape} has no glTF accessor: it must "
                "be uint8, uint16, uint32 or float32 of shape (n,) or (n, 1|2|3|4|16)"
            )
        if data.size == 0:
            raise InputError(f"array of shape {data.shape} is empty: glTF accessors are not")
        stride = data[0].nbytes
        if (len(data) > 1 and stride % 4) or (target == ARRAY_BUFFER and data[0, 0].nbytes % 4):
            raise InputError(
                f"array of type {data.dtype} and shape {data.shape} would not be aligned to 4 bytes"
            )
        view = self._add_view(data.astype(data.dtype.newbyteorder("<")).tobytes(), target)
        accessors = []
        for index, item in enumerate(data):
            accessor: dict[str, Any] = {
                "bufferView": view,
                "componentType": _COMPONENTS[data.dtype],
                "count": len(item),
                "type": _WIDTHS[width],
            }
            if index:
                accessor["byteOffset"] = index * stride
            if bounds:
                rows = item.reshape(len(item), width)
                accessor["min"] = rows.min(axis=0).tolist()
                accessor["max"] = rows.max(axis=0).tolist()
            accessors.append(self.add("accessors", accessor))
        return accessors

    def add_indices(self, faces: NDArray[Any], vertices: int) -> int:
        """Store faces over so many vertices in the smallest type that holds them.

        The largest value of a type is left free: some graphics interfaces use it as a mark.
        """
        kind = np.uint16 if vertices <= 65535 else np.uint32
        return self.add_array(faces.ravel().astype(kind), target=ELEMENT_ARRAY_BUFFER)

    def to_bytes(self) -> bytes:
        """Return the whole ``.glb`` file."""
        binary = b"".join(self._chunks)
        content = dict(self._json)
        if binary:
            content["buffers"] = [{"byteLength": len(binary)}]
        text = json.dumps(content, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        parts = [struct.pack("<II", len(text), _JSON_CHUNK), text]
        if binary:
            parts += [struct.pack("<II", len(binary), _BINARY_CHUNK), binary]
        length = 12 + sum(len(part) for part in parts)
        return b"".join([struct.pack("<III", _MAGIC, _VERSION, length), *parts])

    def _add_view(self, data: bytes, target: int | None) -> int:
        view: dict[str, Any] = {
            "buffer": 0,
            "byteOffset": self._length,
            "byteLength": len(data),
        }
        if target is not None:
            view["target"] = target
        padded = data + b"\0" * (-len(data) % 4)
        self._chunks.append(padded)
        self._length += len(padded)
        return self.add("bufferViews", view)
