from .board import Board, CharucoBoard, Checkerboard, Detection, StripBoard, load_board
from .camera import Camera, CameraSet, aim_camera, load_cameras, triangulate
from .length import LengthOptions, MuscleLength, measure_length
from .pictures import Picture, read_picture, write_picture
from .planning import (
    DemoOptions,
    LengthSetup,
    RenderedSetup,
    SetupPlan,
    plan_setup,
    write_demo,
)
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
    "RenderedSetup",
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
