"""Fixtures of vision: one rendered calibration set for all tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from bozzini.vision.calibrate import Calibration, CalibrationOptions, View, calibrate_cameras
from tests.conftest import _find_data
from tests.vision.sets import BOARD, render_views

pytest.importorskip("cv2", reason="the extra 'vision' is not installed")


@pytest.fixture(scope="session")
def pair_pictures():
    """Give 12 views of a board by two cameras."""
    return render_views()


@pytest.fixture(scope="session")
def pair_views(pair_pictures) -> list[View]:
    """Give the corners in these."""
    return [
        View(f"{k:02d}", tuple(BOARD.detect(picture) for picture in pictures))
        for k, pictures in enumerate(pair_pictures[0])
    ]


@pytest.fixture(scope="session")
def pair_calibration(pair_views) -> Calibration:
    """Give the calibration from these."""
    options = CalibrationOptions(resamples=6)
    return calibrate_cameras(pair_views, BOARD, ("cam0", "cam1"), options=options)


@pytest.fixture(scope="session")
def helical_robot_dir() -> Path:
    """Give the pictures and markers of a helical robot (rasdm, Apache-2.0)."""
    return _find_data("helical_robot")
