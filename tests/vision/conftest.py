"""Fixtures of vision: one rendered calibration set for all tests."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from bozzini.vision.calibrate import (
    BoardView,
    CalibrationOptions,
    CameraCalibration,
    calibrate_cameras,
)
from bozzini.vision.render import bend_curve, make_backbone_scene, render_picture
from tests.conftest import _find_data
from tests.vision.sets import BOARD, PAIR, render_views

pytest.importorskip("cv2", reason="the extra 'vision' is not installed")


@pytest.fixture(scope="session")
def pair_pictures():
    """Give 12 views of a board by two cameras."""
    return render_views()


@pytest.fixture(scope="session")
def pair_views(pair_pictures) -> list[BoardView]:
    """Give the corners in these."""
    return [
        BoardView(f"{k:02d}", tuple(BOARD.detect(picture) for picture in pictures))
        for k, pictures in enumerate(pair_pictures[0])
    ]


@pytest.fixture(scope="session")
def pair_calibration(pair_views) -> CameraCalibration:
    """Give the calibration from these."""
    options = CalibrationOptions(resamples=6)
    return calibrate_cameras(pair_views, BOARD, ("cam0", "cam1"), options=options)


@pytest.fixture(scope="session")
def bent_tube():
    """Give a curve and its two small pictures."""
    curve = bend_curve(47.0, math.radians(60.0), plane=0.4)
    scene = make_backbone_scene(curve)
    return curve, [render_picture(scene, camera, seed=i) for i, camera in enumerate(PAIR)]


@pytest.fixture(scope="session")
def helical_robot_dir() -> Path:
    """Give the pictures and markers of a helical robot (rasdm, Apache-2.0)."""
    return _find_data("helical_robot")
