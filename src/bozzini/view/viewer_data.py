"""What the report's slider needs: a thinned plan, packed small, and the pictures behind it."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .fluoroscopy import Projection
from .palette import ClearanceScale, color_lumen, list_clearance_colors
from .sampling import MotionSample
from .scope_drawing import find_violations

__all__ = ["encode_picture", "pack_viewer"]

JOINT_STEP = 0.1
CLEARANCE_STEP = 0.01
IN_INTRODUCER = -32768
_PICTURE_PIXELS = 900


def encode_picture(picture: Projection) -> str:
    """Return a projection as a ``data:`` address of a PNG, enlarged smoothly."""
    from PIL import Image

    zoom = _PICTURE_PIXELS / max(picture.width, picture.height)
    size = (max(1, round(zoom * picture.width)), max(1, round(zoom * picture.height)))
    levels = Image.fromarray(np.rint(255.0 * picture.image).astype(np.uint8))
    indexed = levels.resize(size, Image.Resampling.BICUBIC)
    colors = np.rint(255.0 * color_lumen(np.linspace(0.0, 1.0, 256))).astype(np.uint8)
    indexed.putpalette(colors.tobytes())
    stream = io.BytesIO()
    indexed.save(stream, format="PNG", compress_level=6)
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


def pack_viewer(
    sample: MotionSample,
    pictures: Sequence[Projection],
    *,
    places: NDArray[np.float64],
    scale: ClearanceScale,
    radius: float,
) -> dict[str, Any]:
    """Return a JSON-able object for the report's script.

    `places` says where along the tract each step is tightest [mm]. Joints are given per picture
    from its upper left corner, right and down, in steps of 0.1 mm; clearances in steps of
    0.01 mm, with -32768 for links still in the introducer. Both are little-endian 16-bit
    integers in base64.
    """
    views = []
    for picture in pictures:
        place = picture.project(sample.joints)
        corner = np.array([picture.extent[0], picture.extent[3]])
        views.append(
            {
                "width": round(picture.width, 3),
                "height": round(picture.height, 3),
                "joints": _pack((place - corner) * [1.0, -1.0] / JOINT_STEP),
            }
        )
    clearance = np.where(sample.in_tract, sample.clearance / CLEARANCE_STEP, IN_INTRODUCER)
    return {
        "count": len(sample.steps),
        "joints": int(sample.joints.shape[1]),
        "radius": radius,
        "steps": [int(step) for step in sample.steps],
        "insertion": [round(float(value), 2) for value in sample.insertion],
        "smallest": [
            round(float(value), 3) if np.isfinite(value) else None for value in sample.smallest
        ],
        "place": [round(float(value), 1) for value in places],
        "spots": [find_violations(row) for row in sample.visible],
        "clearance": _pack(clearance),
        "views": views,
        "scale": {
            "low": scale.low,
            "high": scale.high,
            "colors": list_clearance_colors(scale),
        },
    }


def _pack(values: NDArray[np.float64]) -> str:
    whole = np.clip(np.rint(values), -32768, 32767).astype("<i2")
    return base64.b64encode(whole.tobytes()).decode("ascii")
