from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.vision import Checkerboard, write_picture
from bozzini.vision.calibrate import (
    BoardView,
    CalibrationOptions,
    _find_fault,
    calibrate_cameras,
    detect_views,
    list_pictures,
)
from tests.vision.sets import BOARD, PAIR, TARGET, render_views

NAMES = ("cam0", "cam1")
QUICK = CalibrationOptions(resamples=0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"tilt": math.radians(14.98)}, "tilted by 14.98 degrees at most: it must be 15.00 or"),
        ({"coverage": (0.0996, 0.9)}, "cover 9.96 % of the picture of cam0: it must be 10.00 %"),
    ],
)
def test_why_a_calibration_is_refused_does_not_contradict_itself(
    pair_calibration, change, words
) -> None:
    found = dataclasses.replace(pair_calibration, **change)
    assert words in _find_fault(found, QUICK)


def test_the_true_cameras_come_back_in_the_frame_of_the_board(pair_calibration, pair_pictures):
    found = pair_calibration
    assert found.converged and not found.reason
    assert found.residual < 0.1
    rng = np.random.default_rng(0)
    points = TARGET + rng.uniform(-20.0, 20.0, (200, 3))
    pixels = np.stack([camera.project(points) for camera in PAIR])
    turn, shift = pair_pictures[1][0]  # of the board of the first view
    off = found.cameras.triangulate(pixels) - (points - shift) @ turn
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.02
    assert found.cameras.baseline == pytest.approx(
        np.linalg.norm(PAIR[0].centre - PAIR[1].centre), rel=1e-3
    )


def test_its_uncertainty_is_that_of_the_errors(pair_calibration, pair_pictures):
    rng = np.random.default_rng(1)
    points = TARGET + rng.uniform(-20.0, 20.0, (200, 3))
    pixels = np.stack([camera.project(points) for camera in PAIR])
    turn, shift = pair_pictures[1][0]
    off = pair_calibration.cameras.triangulate(pixels) - (points - shift) @ turn
    covariance = pair_calibration.cameras.calibration_covariance(pixels)
    claimed = np.sqrt(np.trace(covariance, axis1=-2, axis2=-1).mean())
    ratio = np.sqrt(np.mean(np.sum(off**2, axis=1))) / claimed
    assert 0.2 < ratio < 2.0  # one draw of few degrees of freedom


def test_views_left_out_fit_as_those_used(pair_calibration):
    held = pair_calibration.hold_out
    assert held.views == 3
    assert held.rms < 2.0 * pair_calibration.residual
    assert held.length_rms < 0.02
    assert held.baseline == pytest.approx(pair_calibration.cameras.baseline, rel=2e-3)


def test_the_world_is_the_view_that_is_asked_for(pair_views):
    options = CalibrationOptions(resamples=0, world="04")
    found = calibrate_cameras(pair_views, BOARD, NAMES, options=options)
    view = pair_views[4]
    for camera, seen in zip(found.cameras.cameras, view.detections, strict=True):
        assert camera.project(seen.points) == pytest.approx(seen.corners, abs=0.5)
    with pytest.raises(InputError, match="world is 'x'"):
        calibrate_cameras(
            pair_views, BOARD, NAMES, options=CalibrationOptions(resamples=0, world="x")
        )


def test_one_camera_by_itself(pair_views):
    views = [BoardView(view.name, view.detections[:1]) for view in pair_views]
    found = calibrate_cameras(views, BOARD, options=CalibrationOptions(resamples=4))
    assert found.converged
    camera, (spread,) = found.cameras.cameras[0], found.focal_uncertainty
    assert abs(camera.focal - PAIR[0].focal) < 5.0 * spread + 0.002 * PAIR[0].focal
    assert math.isnan(found.hold_out.baseline) and found.hold_out.rms < 0.15
    assert found.to_dict()["baseline_mm"] is None


def test_a_wrong_size_of_squares_shows_by_a_known_baseline(pair_views):
    wrong = dataclasses.replace(BOARD, square=5.5)
    scaled = [
        dataclasses.replace(
            view,
            detections=tuple(
                dataclasses.replace(found, points=wrong.corners[found.ids])
                for found in view.detections
            ),
        )
        for view in pair_views
    ]
    true = float(np.linalg.norm(PAIR[0].centre - PAIR[1].centre))
    options = CalibrationOptions(resamples=0, baseline=true)
    refused = calibrate_cameras(scaled, wrong, NAMES, options=options)
    assert not refused.converged
    assert "size of the board's squares" in refused.reason
    assert refused.cameras.baseline == pytest.approx(true * 5.5 / 6.0, rel=1e-3)
    assert calibrate_cameras(pair_views, BOARD, NAMES, options=options).converged


def test_corners_in_one_place_and_a_board_never_tilted_are_refused(pair_views):
    first = pair_views[0].detections[0]
    # The same view eight times, a little displaced: nothing tells focal length from distance.
    rng = np.random.default_rng(0)
    shaken = [
        BoardView(
            str(k),
            (dataclasses.replace(first, corners=first.corners + rng.normal(0.0, 0.05, (1, 2))),),
        )
        for k in range(8)
    ]
    assert "tilted" in calibrate_cameras(shaken, BOARD, options=QUICK).reason
    small = [
        BoardView(
            view.name,
            (dataclasses.replace(view.detections[0], size=(4000, 3000)),),
        )
        for view in pair_views
    ]
    assert "corners cover" in calibrate_cameras(small, BOARD, options=QUICK).reason


def test_large_residuals_are_refused_and_one_wrong_view_is_left_out(pair_views):
    rng = np.random.default_rng(0)

    def shake(view: BoardView, size: float) -> BoardView:
        return dataclasses.replace(
            view,
            detections=tuple(
                dataclasses.replace(
                    found, corners=found.corners + rng.normal(0.0, size, found.corners.shape)
                )
                for found in view.detections
            ),
        )

    noisy = calibrate_cameras(
        [shake(view, 1.0) for view in pair_views], BOARD, NAMES, options=QUICK
    )
    assert "residuals of" in noisy.reason
    one = [shake(view, 3.0) if view.name == "05" else view for view in pair_views]
    found = calibrate_cameras(one, BOARD, NAMES, options=QUICK)
    assert found.converged
    assert [view.name for view in found.views if view.reason] == ["05"]
    assert "left out" in found.views[5].reason
    assert found.to_frame()["reason"].ne("").sum() == 1


def test_too_few_views_are_one_line_with_a_reason(pair_views):
    with pytest.raises(InputError, match=r"7 of 7 views can be used, a calibration needs 8"):
        calibrate_cameras(pair_views[:7], BOARD, NAMES)
    with pytest.raises(InputError, match="each view needs a detection for each"):
        calibrate_cameras(pair_views, BOARD, ("one",))


def test_a_folder_of_pictures_with_every_fault(tmp_path, pair_pictures):
    pictures, _ = pair_pictures
    for k, views in enumerate(pictures):
        for i, picture in enumerate(views):
            write_picture(picture, tmp_path / f"cam{i}_{k:02d}.png")
    (tmp_path / "cam1_02.png").unlink()
    whole = (tmp_path / "cam0_05.png").read_bytes()
    (tmp_path / "cam0_05.png").write_bytes(whole[: len(whole) // 3])
    mirrored = dataclasses.replace(pictures[7][1], values=pictures[7][1].values[:, ::-1])
    write_picture(mirrored, tmp_path / "cam1_07.png")
    half = dataclasses.replace(pictures[8][0], values=pictures[8][0].values[:200])
    write_picture(half, tmp_path / "cam0_08.png")
    (tmp_path / "notes.txt").write_text("of no matter")
    (tmp_path / "readme.png").write_text("no number, so no view")
    names, views = detect_views(tmp_path, BOARD)
    assert names == NAMES
    reasons = {view.name: [found.reason for found in view.detections] for view in views}
    assert "missing" in reasons["02"][1]
    assert "cannot be read" in reasons["05"][0]
    assert reasons["07"][1] == "the board is mirrored"
    found = calibrate_cameras(views, BOARD, names, options=QUICK)
    assert found.converged
    bad = {view.name: view.reason for view in found.views if view.reason}
    assert set(bad) == {"02", "05", "07", "08"}
    assert "640 x 200 px, others have 640 x 400" in bad["08"]
    assert any("4 of 12 views" in flag for flag in found.flags)


def test_names_of_pictures_tell_camera_and_view(tmp_path):
    for name in ("left_00.png", "right_00.png", "left_1.JPG", "IMG.png"):
        (tmp_path / name).touch()
    names, views = list_pictures(tmp_path)
    assert names == ("left", "right")
    assert [(view, sorted(each)) for view, each in views] == [
        ("00", ["left", "right"]),
        ("1", ["left"]),
    ]
    (tmp_path / "left-00.tif").touch()
    with pytest.raises(InputError, match="two pictures are view 00"):
        list_pictures(tmp_path)
    (tmp_path / "top_3.png").touch()
    for place in (tmp_path / "none", tmp_path):
        with pytest.raises(InputError):
            list_pictures(place)


@pytest.mark.slow
def test_a_plain_chess_board_does_as_well():
    board = Checkerboard(columns=9, rows=6, square=6.0)
    pictures, _ = render_views(board, PAIR[:1], count=12)
    views = [BoardView(str(k), (board.detect(views[0]),)) for k, views in enumerate(pictures)]
    found = calibrate_cameras(views, board, options=QUICK)
    assert found.converged
    assert found.cameras.cameras[0].focal == pytest.approx(PAIR[0].focal, rel=0.005)


def test_the_picture_shows_every_corner(pair_calibration):
    ax = pair_calibration.plot()
    assert [text.get_text() for text in ax.texts] == list(NAMES)
    drawn = sum(len(item.get_offsets()) for item in ax.collections)
    assert drawn == sum(len(errors) for errors in pair_calibration.errors)


@pytest.mark.slow  # four sets of pictures
def test_the_claimed_uncertainty_is_that_of_many_calibrations():
    points = TARGET + np.random.default_rng(0).uniform(-20.0, 20.0, (200, 3))
    pixels = np.stack([camera.project(points) for camera in PAIR])
    ratios = []
    for seed in range(4):
        pictures, poses = render_views(seed=seed)
        views = [
            BoardView(f"{k:02d}", tuple(map(BOARD.detect, pair))) for k, pair in enumerate(pictures)
        ]
        found = calibrate_cameras(views, BOARD, NAMES)
        assert found.converged
        cameras = dataclasses.replace(found.cameras, scale_uncertainty=0.0)  # the print is perfect
        turn, shift = poses[[not view.reason for view in found.views].index(True)]
        off = cameras.triangulate(pixels) - (points - shift) @ turn
        claimed = np.trace(cameras.calibration_covariance(pixels), axis1=-2, axis2=-1).mean()
        ratios.append(np.mean(np.sum(off**2, axis=1)) / claimed)
    assert 0.7 < np.sqrt(np.mean(ratios)) < 2.0
