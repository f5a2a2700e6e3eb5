from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bozzini.errors import InputError
from bozzini.vision import (
    Camera,
    CameraSet,
    Checkerboard,
    Scene,
    Sensor,
    aim_camera,
    load_cameras,
    render_picture,
    write_picture,
)
from bozzini.vision.board import Detection
from bozzini.vision.calibrate import (
    BoardView,
    CalibrationOptions,
    _find_fault,
    calibrate_cameras,
    detect_views,
    list_pictures,
)
from bozzini.vision.length import _fit_pose
from bozzini.vision.pictures import import_opencv
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


SMALL = Sensor(supersampling=2)
FISHEYE = np.array([0.03, -0.012, 0.006, -0.001])
"""k1 to k4 of a lens that sees 150 degrees across its picture."""


def make_fisheye_views(cameras: tuple[Camera, ...], count: int = 14, noise: float = 0.03):
    """Return views of a board that OpenCV's own fisheye projects into cameras."""
    cv2 = import_opencv()
    rng = np.random.default_rng(3)
    board = BOARD.corners
    views = []
    for k in range(count):
        away = rng.uniform(25.0, 45.0)
        angle = rng.uniform(0.0, 2.0 * math.pi)
        off = away * math.tan(math.radians(rng.uniform(0.0, 45.0)))
        turn = Rotation.from_euler("xyz", rng.uniform(-0.6, 0.6, 3)).as_matrix()
        middle = np.array([off * math.cos(angle), off * math.sin(angle), away])
        shift = middle - turn @ board.mean(axis=0)
        seen = []
        for camera in cameras:
            pose = camera.rotation @ turn, camera.rotation @ shift + camera.translation
            pixels, _ = cv2.fisheye.projectPoints(
                board[None], cv2.Rodrigues(pose[0])[0], pose[1], camera.matrix, camera.distortion
            )
            own = pixels.reshape(-1, 2)
            placed = board @ pose[0].T + pose[1]
            good = placed[:, 2] > 5.0
            good &= ((own >= 0.0) & (own <= np.array(camera.size) - 1.0)).all(axis=1)
            own = own + rng.normal(0.0, noise, own.shape)
            seen.append(Detection(own[good], board[good], np.flatnonzero(good), camera.size, ""))
        views.append(BoardView(f"{k:02d}", tuple(seen)))
    return views


@pytest.fixture(scope="module")
def fisheyes() -> tuple[Camera, ...]:
    matrix = np.array([[300.0, 0.0, 402.0], [0.0, 301.0, 297.0], [0.0, 0.0, 1.0]])
    first = Camera(matrix=matrix, distortion=FISHEYE, size=(800, 600))
    turn = Rotation.from_euler("y", 8.0, degrees=True).as_matrix()
    return first, dataclasses.replace(first, rotation=turn, translation=np.array([-12.0, 0.5, 1.0]))


def test_a_fisheye_is_that_of_opencv_there_and_back(fisheyes, tmp_path):
    cv2 = import_opencv()
    camera = fisheyes[1]
    rng = np.random.default_rng(0)
    angle, around = rng.uniform(0.0, 1.45, 500), rng.uniform(0.0, 2.0 * math.pi, 500)
    ways = np.stack(
        [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)], axis=1
    )
    inside = ways * rng.uniform(5.0, 90.0, (500, 1))
    points = (inside - camera.translation) @ camera.rotation
    pixels = camera.project(points)
    theirs, _ = cv2.fisheye.projectPoints(
        inside[None], np.zeros(3), np.zeros(3), camera.matrix, camera.distortion
    )
    np.testing.assert_allclose(pixels, theirs.reshape(-1, 2), atol=1e-9)
    along = (points - camera.centre) / np.linalg.norm(points - camera.centre, axis=1)[:, None]
    np.testing.assert_allclose(camera.rays(pixels), along, atol=1e-9)
    # What lies beside the camera has no x/z, nor has what it never shows.
    assert np.isnan(camera.undistort([[402.0 + 800.0, 297.0]])).all()
    assert camera.undistort([[402.0, 297.0]]) == pytest.approx(0.0)
    cameras = CameraSet(names=("a", "b"), cameras=fisheyes)
    back = load_cameras(cameras.save(tmp_path / "cameras.yaml"))
    assert [each.is_fisheye for each in back.cameras] == [True, True]
    np.testing.assert_allclose(back.cameras[1].rays(pixels), along, atol=1e-9)


def test_a_board_is_placed_by_a_fisheye(fisheyes):
    camera = fisheyes[0]
    turn = Rotation.from_euler("xyz", (0.3, -0.2, 0.1)).as_matrix()
    shift = np.array([12.0, -25.0, 30.0])
    placed = BOARD.corners @ turn.T + shift
    found = Detection(
        camera.project(placed), BOARD.corners, np.arange(len(placed)), camera.size, ""
    )
    plane = _fit_pose(found, camera)
    assert plane.miss < 1e-3
    np.testing.assert_allclose(plane.foot, (-turn.T @ shift)[:2], atol=1e-3)


def test_a_picture_is_rendered_through_a_fisheye_and_its_board_found():
    middle = BOARD.corners.mean(axis=0)
    camera = aim_camera(
        middle + [5.0, 4.0, -36.0], middle, focal=330.0, size=(640, 480), distortion=FISHEYE
    )
    found = BOARD.detect(render_picture(Scene(board=BOARD), camera, sensor=SMALL))
    assert len(found.ids) > 30  # where the light is bright enough
    off = camera.project(found.points) - found.corners
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.15
    plain = dataclasses.replace(camera, distortion=np.zeros(5))
    assert np.abs(plain.project(found.points) - found.corners).max() > 20.0
    wide = dataclasses.replace(camera, distortion=np.array([-0.2, 0.0, 0.0, 0.0]))
    with pytest.raises(InputError, match="less than 180 degrees"):
        render_picture(Scene(board=BOARD), wide)


def test_a_pair_of_fisheyes_comes_back_where_the_plain_lens_is_refused(fisheyes):
    views = make_fisheye_views(fisheyes)
    options = dataclasses.replace(QUICK, lens="fisheye")
    found = calibrate_cameras(views, BOARD, NAMES, options=options)
    assert not found.reason and found.residual < 0.08  # noise of 0.03 px in x and y
    true = np.linalg.norm(fisheyes[1].centre - fisheyes[0].centre)
    assert found.cameras.baseline == pytest.approx(true, rel=2e-3)
    for own, camera in zip(found.cameras.cameras, fisheyes, strict=True):
        grid = np.stack(np.meshgrid(np.linspace(150, 650, 9), np.linspace(100, 500, 9)), axis=-1)
        ways, theirs = own.undistort(grid), camera.undistort(grid)
        off = np.arctan(np.linalg.norm(ways, axis=-1)) - np.arctan(np.linalg.norm(theirs, axis=-1))
        assert np.abs(off).max() < 2e-3
    # One camera alone, and the other model of the same views.
    alone = [dataclasses.replace(view, detections=view.detections[:1]) for view in views]
    assert not calibrate_cameras(alone, BOARD, options=options).reason
    plain = calibrate_cameras(alone, BOARD, options=QUICK)
    assert plain.residual > 3.0 * found.residual
