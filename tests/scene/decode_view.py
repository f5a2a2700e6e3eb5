"""Reads the container of a view in Python, as the page does: for the tests alone."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

from bozzini.scene.view import MAGIC


def decode_view(data: bytes) -> dict[str, Any]:
    """Return the header with arrays in place of their descriptions."""
    magic, length = struct.unpack("<II", data[:8])
    assert magic == MAGIC and length % 4 == 0
    header: dict[str, Any] = json.loads(data[8 : 8 + length])
    body = data[8 + length :]
    for item in header["surfaces"]:
        item["vertices"] = _unpack(body, item["vertices"])
        item["faces"] = _unpack(body, item["faces"]).astype(np.int64)
    for item in header["bodies"]:
        item["joints"] = _unpack(body, item["joints"])
        if item["clearance"] is not None:
            item["clearance"] = _unpack(body, item["clearance"])
    for item in header["clouds"]:
        item["points"] = _unpack(body, item["points"])
    return header


def _unpack(body: bytes, item: dict[str, Any]) -> np.ndarray:
    assert item["at"] % 4 == 0
    count = int(np.prod(item["shape"]))
    planes = np.frombuffer(body, np.uint8, count * item["bytes"], item["at"])
    folded = sum(
        plane.astype(np.int64) << (8 * k)
        for k, plane in enumerate(planes.reshape(item["bytes"], count))
    )
    whole = np.where(folded % 2, -(folded + 1) // 2, folded // 2).reshape(item["shape"])
    for _ in range(item["order"]):
        whole = np.cumsum(whole, axis=0)
    values = whole * item["step"] + np.array(item.get("low", 0.0))
    return np.where(whole == item["none"], np.nan, values) if "none" in item else values
