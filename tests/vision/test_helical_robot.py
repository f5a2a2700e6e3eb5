"""Real pictures: a stereo camera, a board on a telephone's screen, and markers on a robot.

Source: rasdm, "A Quantitative Comparison of Analytical Models for Helical Tendon-Driven Continuum
Robots", Apache-2.0. Its own calibration gives a baseline of 72.99 mm, by corners refined in windows
of 23 px where corners are 20 px apart. `test_the_published_baseline_comes_from_wide_windows` shows
that; refined in windows that hold one corner the same pictures give 74.3 mm, in every subset.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from bozzini.vision import Checkerboard, load_cameras, read_picture
from bozzini.vision.calibrate import (
    BoardView,
    CalibrationOptions,
    calibrate_cameras,
    detect_views,
)
from bozzini.vision.pictures import read_manifest
from bozzini.vision.track import read_pixels, track_markers

BOARD = Checkerboard(columns=9, rows=6, square=5.5)
PUBLISHED_BASELINE = 72.99
NAMES = ("left", "right")

pytestmark = pytest.mark.slow(40)  # 84 pictures


@pytest.fixture(scope="module")
def views(helical_robot_dir) -> list[BoardView]:
    names, views = detect_views(helical_robot_dir / "stereo", BOARD)
    assert names == NAMES
    return views


@pytest.fixture(scope="module")
def calibration(views):
    return calibrate_cameras(views, BOARD, NAMES)


def test_all_views_are_used_and_fit(calibration):
    assert calibration.converged
    assert all(not view.reason for view in calibration.views)
    assert calibration.residual < 0.1
    assert calibration.hold_out.rms < 0.1
    assert calibration.hold_out.length_rms < 0.03  # of 5.5 mm


def test_the_baseline_is_the_same_from_views_held_out(views, calibration):
    quick = CalibrationOptions(resamples=0)
    halves = [
        calibrate_cameras(part, BOARD, NAMES, options=quick).cameras.baseline
        for part in (views[::2], views[1::2], views[:21], views[21:])
    ]
    assert halves == pytest.approx([calibration.cameras.baseline] * 4, rel=0.005)
    assert np.std(halves) < 4.0 * calibration.baseline_uncertainty
    # 1.8 % above the published one, whose origin the next test shows.
    assert calibration.cameras.baseline == pytest.approx(PUBLISHED_BASELINE, rel=0.02)


def test_the_published_baseline_comes_from_wide_windows(helical_robot_dir, views):
    """Repeat the source's calibration, whose windows of 23 px hold several corners."""
    points = np.zeros((54, 3), np.float32)
    points[:, :2] = 5.5 * np.mgrid[0:9, 0:6].T.reshape(-1, 2)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 1e-3)
    size, board = (840, 600), [points] * 42
    corners, apart = {}, {}
    for i, name in enumerate(NAMES):
        corners[name], apart[name] = [], []
        for k, view in enumerate(views):
            grey = read_picture(helical_robot_dir / "stereo" / f"{name}_{k:02d}.png").bytes
            _, seen = cv2.findChessboardCorners(grey, (9, 6), None)
            corners[name].append(cv2.cornerSubPix(grey, seen, (11, 11), (-1, -1), stop))
            ours = view.detections[i]
            off = np.reshape(corners[name][-1], (-1, 2))[ours.ids] - ours.corners
            apart[name].append(np.abs(off).max())
    lenses = [cv2.calibrateCamera(board, corners[n], size, None, None)[1:3] for n in NAMES]
    rms, *_, shift, _, _ = cv2.stereoCalibrate(
        *(board, corners["left"], corners["right"], *lenses[0], *lenses[1], size),
        criteria=stop,
        flags=cv2.CALIB_FIX_INTRINSIC,
    )
    assert np.linalg.norm(shift) == pytest.approx(PUBLISHED_BASELINE, rel=0.001)
    assert rms > 0.3  # such a calibration is refused here
    # Its corners were drawn away to their neighbours in some of the right pictures.
    assert np.median(apart["right"]) < 0.5
    assert max(apart["right"]) > 5.0


@pytest.mark.parametrize("name", ["steps_tendon_1.csv", "loop_tendon_1.csv"])
def test_markers_become_points_with_uncertainty(helical_robot_dir, calibration, tmp_path, name):
    cameras = load_cameras(calibration.cameras.save(tmp_path / "cameras.yaml"))
    manifest = read_manifest(helical_robot_dir / name, ())
    found = track_markers(read_pixels(manifest, cameras), cameras)
    there = np.isfinite(found.points[..., 0])
    both = there.all(axis=1)
    apart = np.linalg.norm(found.points[:, 0] - found.points[:, 1], axis=1)[both]
    # Both markers are on one disc: their distance stays, within the uncertainty of the pixels.
    assert apart.mean() == pytest.approx(22.0, abs=0.2)
    away = np.sqrt(found.uncertainty[both].mean(axis=0).prod(axis=0).mean())
    claimed = np.median(found.uncertainty[both][..., :2]) * np.sqrt(2.0)
    assert 0.4 < apart.std() / claimed < 2.0
    assert away > 0.0
    assert found.residual < 1.0
    if name.startswith("loop"):
        # A marker is lost to another spot in 26 rows; in 11 of them the other has its name.
        assert found.status.count("failed") == 26
        assert sum("markers_swapped" in flag for flag in found.flags[::2]) == 11
        assert "outside_calibrated_area" not in ";".join(found.flags)
    else:
        assert found.converged
