"""Measurement by pictures: boards, cameras, calibration, markers, and rendered pictures.

OpenCV (the extra ``vision``) is loaded where it is used, not by this package's import.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .board import Board, CharucoBoard, Checkerboard, Detection, StripBoard, load_board
    from .camera import Camera, CameraSet, aim_camera, load_cameras, triangulate
    from .pictures import Picture, read_picture, write_picture
    from .render import (
        HungMuscle,
        Light,
        PairLayout,
        Scene,
        Sensor,
        Tube,
        bend_curve,
        make_backbone_scene,
        make_board_poses,
        render_picture,
    )

__all__ = [
    "Board",
    "Camera",
    "CameraSet",
    "CharucoBoard",
    "Checkerboard",
    "Detection",
    "HungMuscle",
    "Light",
    "PairLayout",
    "Picture",
    "Scene",
    "Sensor",
    "StripBoard",
    "Tube",
    "aim_camera",
    "bend_curve",
    "load_board",
    "load_cameras",
    "make_backbone_scene",
    "make_board_poses",
    "read_picture",
    "render_picture",
    "triangulate",
    "write_picture",
]

_MODULES = {
    name: module
    for module, names in {
        "board": ("Board", "CharucoBoard", "Checkerboard", "Detection", "StripBoard", "load_board"),
        "camera": ("Camera", "CameraSet", "aim_camera", "load_cameras", "triangulate"),
        "pictures": ("Picture", "read_picture", "write_picture"),
        "render": (
            "HungMuscle",
            "Light",
            "PairLayout",
            "Scene",
            "Sensor",
            "Tube",
            "bend_curve",
            "make_backbone_scene",
            "make_board_poses",
            "render_picture",
        ),
    }.items()
    for name in names
}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
