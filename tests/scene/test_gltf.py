"""The binary glTF writer, read back by a parser written here from the specification."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bozzini.errors import InputError
from bozzini.scene.gltf import ARRAY_BUFFER, GlbDocument

TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def parse(data: bytes) -> tuple[dict[str, Any], bytes]:
    """Split a GLB into its JSON and its buffer, checking every length on the way."""
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    chunks, at = [], 12
    while at < len(data):
        size, kind = struct.unpack_from("<I4s", data, at)
        assert size % 4 == 0
        chunks.append((kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    assert at == len(data)
    assert [kind for kind, _ in chunks] == [b"JSON", b"BIN\0"][: len(chunks)]
    return json.loads(chunks[0][1]), chunks[1][1] if len(chunks) > 1 else b""


def read(content: dict[str, Any], binary: bytes, index: int) -> np.ndarray:
    """Read one accessor."""
    accessor = content["accessors"][index]
    view = content["bufferViews"][accessor["bufferView"]]
    width, kind = WIDTHS[accessor["type"]], np.dtype(TYPES[accessor["componentType"]])
    start, count = accessor.get("byteOffset", 0), accessor["count"] * width
    assert start + count * kind.itemsize <= view["byteLength"]
    assert view["byteOffset"] + view["byteLength"] <= content["buffers"][0]["byteLength"]
    assert (start + view["byteOffset"]) % 4 == 0
    values = np.frombuffer(binary, kind, count, view["byteOffset"] + start)
    return values.reshape(-1, width)


finite = st.floats(-1e6, 1e6, width=32)


@given(
    rows=arrays(np.float32, st.tuples(st.integers(1, 9), st.sampled_from([1, 2, 3, 4, 16])),
                elements=finite),
    bytes_=arrays(np.uint8, st.integers(1, 9)),
    shorts=arrays(np.uint16, st.integers(1, 9)),
)  # fmt: skip
def test_arrays_of_any_length_come_back_as_they_went(rows, bytes_, shorts):
    document = GlbDocument(generator="test")
    stored = [document.add_array(array, bounds=True) for array in (bytes_, shorts, rows)]
    content, binary = parse(document.to_bytes())
    for index, array in zip(stored, (bytes_, shorts, rows), strict=True):
        values = read(content, binary, index)
        np.testing.assert_array_equal(values, array.reshape(values.shape))
        assert content["accessors"][index]["min"] == values.min(axis=0).tolist()
        assert content["accessors"][index]["max"] == values.max(axis=0).tolist()


def test_a_stack_shares_one_view_and_keeps_its_order():
    stack = np.arange(4 * 5 * 3, dtype=np.float32).reshape(4, 5, 3)
    document = GlbDocument(generator="test")
    stored = document.add_arrays(stack)
    content, binary = parse(document.to_bytes())
    assert len(content["bufferViews"]) == 1
    for index, item in zip(stored, stack, strict=True):
        np.testing.assert_array_equal(read(content, binary, index), item)


def test_lists_extensions_and_notes_are_kept():
    document = GlbDocument(generator="test", extras={"unit": "metre"})
    assert document.add("nodes", {"name": "a"}) == 0
    assert document.add("nodes", {"name": "b"}) == 1
    document.get("nodes", 0)["children"] = [1]
    document.use_extension("X")
    document.use_extension("X", {"lights": []})
    document.set_scene(document.add("scenes", {"nodes": [0]}))
    content, binary = parse(document.to_bytes())
    assert binary == b"" and "buffers" not in content
    assert content["asset"] == {
        "version": "2.0",
        "generator": "test",
        "extras": {"unit": "metre"},
    }
    assert content["nodes"] == [{"name": "a", "children": [1]}, {"name": "b"}]
    assert content["extensionsUsed"] == ["X"] and content["extensions"] == {"X": {"lights": []}}


@pytest.mark.parametrize(
    ("array", "target"),
    [
        (np.zeros((3, 3)), None),
        (np.zeros((3, 5), dtype=np.float32), None),
        (np.zeros((2, 2, 3), dtype=np.float32), None),
        (np.zeros((0, 3), dtype=np.float32), None),
        (np.zeros((4, 3), dtype=np.uint8), ARRAY_BUFFER),
    ],
)
def test_what_gltf_cannot_hold_is_refused(array, target):
    with pytest.raises(InputError):
        GlbDocument(generator="test").add_array(array, target=target)


def test_a_stack_that_would_lose_its_alignment_is_refused():
    with pytest.raises(InputError, match="aligned"):
        GlbDocument(generator="test").add_arrays(np.zeros((2, 3), dtype=np.uint8))


@pytest.mark.parametrize(("vertices", "kind"), [(65535, 5123), (65536, 5125)])
def test_indices_are_short_while_they_can_be(vertices, kind):
    faces = np.array([[0, 1, vertices - 1]])
    document = GlbDocument(generator="test")
    index = document.add_indices(faces, vertices)
    content, binary = parse(document.to_bytes())
    assert content["accessors"][index]["componentType"] == kind
    np.testing.assert_array_equal(read(content, binary, index).ravel(), faces.ravel())
