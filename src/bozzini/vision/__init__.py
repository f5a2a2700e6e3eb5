"""Measurement by pictures: boards, cameras, calibration, markers, and rendered pictures.

OpenCV (the extra ``vision``) is loaded where it is used, not by this package's import.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .board import Board, CharucoBoard, Checkerboard, Detection, StripBoard, load_board
    from .camera import Camera, CameraSet, aim_camera, load_cameras, triangulate
    from .length import LengthOptions, MuscleLength, measure_length
    from .pictures import Picture, read_picture, write_picture
    from .planning import DemoOptions, LengthSetup, SetupPlan, plan_setup, write_demo
    from .render import (
        HungMuscle,
        Light,
        PairLayout,
        RenderedTube,
        Scene,
        Sensor,
        bend_curve,
        make_backbone_scene,
        make_board_poses,
        render_picture,
    )
    from .series import LengthSeries, measure_series, write_series
    from .shape import BackboneShape, ShapeOptions, measure_shape
    from .shape_series import ShapeComparison, compare_shapes, measure_shapes

__all__ = [
    "BackboneShape",
    "Board",
    "Camera",
    "CameraSet",
    "CharucoBoard",
    "Checkerboard",
    "ShapeComparison",
    "DemoOptions",
    "Detection",
    "HungMuscle",
    "LengthOptions",
    "LengthSeries",
    "LengthSetup",
    "Light",
    "MuscleLength",
    "PairLayout",
    "Picture",
    "Scene",
    "Sensor",
    "SetupPlan",
    "ShapeOptions",
    "StripBoard",
    "RenderedTube",
    "aim_camera",
    "bend_curve",
    "compare_shapes",
    "load_board",
    "load_cameras",
    "make_backbone_scene",
    "make_board_poses",
    "measure_length",
    "measure_series",
    "measure_shape",
    "measure_shapes",
    "plan_setup",
    "read_picture",
    "render_picture",
    "triangulate",
    "write_demo",
    "write_picture",
    "write_series",
]

_MODULES = {
    name: module
    for module, names in {
        "board": ("Board", "CharucoBoard", "Checkerboard", "Detection", "StripBoard", "load_board"),
        "camera": ("Camera", "CameraSet", "aim_camera", "load_cameras", "triangulate"),
        "length": ("LengthOptions", "MuscleLength", "measure_length"),
        "pictures": ("Picture", "read_picture", "write_picture"),
        "planning": ("DemoOptions", "LengthSetup", "SetupPlan", "plan_setup", "write_demo"),
        "series": ("LengthSeries", "measure_series", "write_series"),
        "render": (
            "HungMuscle",
            "Light",
            "PairLayout",
            "Scene",
            "Sensor",
            "RenderedTube",
            "bend_curve",
            "make_backbone_scene",
            "make_board_poses",
            "render_picture",
        ),
        "shape": ("BackboneShape", "ShapeOptions", "measure_shape"),
        "shape_series": ("ShapeComparison", "compare_shapes", "measure_shapes"),
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
