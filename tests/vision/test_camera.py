from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bozzini.errors import BozziniError, FileFormatError, InputError
from bozzini.vision import Camera, CameraSet, aim_camera, load_cameras, triangulate
from bozzini.vision.camera import align
from tests.vision.sets import PAIR

LENS = np.array([-0.32, 0.15, 3e-4, -6e-4, -0.045])


@pytest.fixture
def wide() -> Camera:
    """Give a wide-angle camera that is no simple case in anything."""
    return Camera(
        matrix=np.array([[426.0, 0.0, 406.0], [0.0, 425.0, 298.0], [0.0, 0.0, 1.0]]),
        distortion=LENS,
        size=(840, 600),
        rotation=Rotation.from_rotvec([0.2, -0.1, 0.3]).as_matrix(),
        translation=np.array([3.0, -2.0, 90.0]),
    )


def _points(rng: np.random.Generator, count: int = 50) -> np.ndarray:
    return rng.uniform(-25.0, 25.0, (count, 3))


def test_it_projects_as_opencv_does(wide):
    points = _points(np.random.default_rng(0))
    turn = cv2.Rodrigues(wide.rotation)[0]
    other, _ = cv2.projectPoints(points, turn, wide.translation, wide.matrix, wide.distortion)
    assert wide.project(points) == pytest.approx(other.reshape(-1, 2), abs=1e-9)


def test_a_ray_goes_through_the_point_that_is_projected(wide):
    points = _points(np.random.default_rng(1))
    rays = wide.rays(wide.project(points))
    to_points = points - wide.centre
    to_points /= np.linalg.norm(to_points, axis=1)[:, None]
    assert rays == pytest.approx(to_points, abs=1e-9)


def test_points_behind_and_pixels_beyond_the_fold_are_nan(wide):
    behind = wide.centre - 10.0 * wide.rotation[2]
    assert np.isnan(wide.project(behind)).all()
    assert np.isnan(wide.undistort([9000.0, 9000.0])).all()
    assert np.isnan(wide.project([np.nan, 0.0, 0.0])).all()


def test_a_moved_world_changes_no_pixel(wide):
    turn = Rotation.from_rotvec([0.4, 0.5, -0.6]).as_matrix()
    shift = np.array([1.0, 2.0, 3.0])
    points = _points(np.random.default_rng(2))
    moved = wide.move_world(turn, shift)
    assert moved.project(points) == pytest.approx(wide.project(points @ turn.T + shift))


def test_an_aimed_camera_sees_its_target_in_the_middle():
    camera = aim_camera((30, 20, -300), (30, 35, 5), focal=2000, size=(1280, 800), down=(1, 0, 0))
    assert camera.project([30, 35, 5]) == pytest.approx([639.5, 399.5])
    across = camera.project([30, 35, 5]) - camera.project([31, 35, 5])
    assert across[1] < 0.0  # +x of the world is down in the picture
    with pytest.raises(InputError, match="parallel"):
        aim_camera((0, 0, 0), (1, 0, 0), focal=100, size=(10, 10), down=(1, 0, 0))


def test_triangulation_undoes_projection_and_is_the_best_fit():
    rng = np.random.default_rng(3)
    points = _points(rng, 20).reshape(4, 5, 3) + [0, 0, 25]
    pixels = np.stack([camera.project(points) for camera in PAIR])
    assert triangulate(PAIR, pixels) == pytest.approx(points, abs=1e-8)
    noisy = pixels + rng.normal(0.0, 0.5, pixels.shape)
    found = triangulate(PAIR, noisy)

    def cost(candidates):
        off = [own - camera.project(candidates) for own, camera in zip(noisy, PAIR, strict=True)]
        return np.sum(np.square(off), axis=(0, -1))

    # Least squares in undistorted pixels: near the lens's axis these are those of the picture.
    for _ in range(20):
        step = rng.normal(size=3)
        assert (cost(found + 0.1 * step / np.linalg.norm(step)) > cost(found)).all()


def test_a_lost_pixel_loses_its_point_alone():
    pixels = np.stack([camera.project([[0, 0, 25], [5, 0, 20]]) for camera in PAIR])
    pixels[1, 0] = np.nan
    found = triangulate(PAIR, pixels)
    assert np.isnan(found[0]).all()
    assert found[1] == pytest.approx([5, 0, 20])


def test_alignment_undoes_a_motion():
    rng = np.random.default_rng(4)
    points, turn = _points(rng), Rotation.random(random_state=0).as_matrix()
    found, shift = align(points, points @ turn.T + [1, 2, 3])
    assert found == pytest.approx(turn)
    assert shift == pytest.approx([1, 2, 3])


@pytest.mark.parametrize("name", ["cameras.yaml", "cameras.json"])
def test_a_set_comes_back_from_its_file(tmp_path, name):
    shaken = tuple(
        camera.place(camera.rotation, camera.translation + k)
        for k, camera in enumerate(PAIR, start=1)
    )
    whole = CameraSet(
        names=("left", "right"),
        cameras=PAIR,
        world="the board of view 3",
        rms=0.1,
        resamples=(shaken, PAIR),
        scale_uncertainty=3e-4,
        areas=((1.0, 2.0, 3.0, 4.0), (0.0, 0.0, 9.0, 9.0)),
    )
    back = load_cameras(whole.save(tmp_path / name))
    points = _points(np.random.default_rng(5)) + [0, 0, 25]
    pixels = np.stack([camera.project(points) for camera in PAIR])
    assert back.triangulate(pixels) == pytest.approx(points)
    covariance = whole.calibration_covariance(pixels)
    assert back.calibration_covariance(pixels) == pytest.approx(covariance)
    assert (back.names, back.world, back.areas) == (whole.names, whole.world, whole.areas)
    assert back.baseline == pytest.approx(whole.baseline)


def test_the_scale_of_the_board_is_an_uncertainty_along_the_line_from_the_origin():
    whole = CameraSet(names=("a", "b"), cameras=PAIR, scale_uncertainty=1e-3)
    point = np.array([3.0, -4.0, 12.0])
    pixels = np.stack([camera.project(point) for camera in PAIR])
    covariance = whole.calibration_covariance(pixels)
    assert covariance @ point == pytest.approx(1e-6 * point * (point @ point))
    assert np.trace(covariance) == pytest.approx((1e-3 * 13.0) ** 2)


def test_wrong_cameras_are_one_line(tmp_path):
    with pytest.raises(InputError, match="rotation"):
        Camera(matrix=np.eye(3), size=(10, 10), rotation=2.0 * np.eye(3))
    with pytest.raises(InputError, match="fx"):
        Camera(matrix=np.diag([-1.0, 1.0, 1.0]), size=(10, 10))
    with pytest.raises(InputError, match="name for each"):
        CameraSet(names=("one",), cameras=PAIR)
    with pytest.raises(InputError, match="two or more"):
        triangulate(PAIR[:1], np.zeros((1, 2)))
    path = CameraSet(names=("a", "b"), cameras=PAIR).save(tmp_path / "c.yaml")
    text = path.read_text(encoding="utf-8")
    for old, new in (("size: [640", "size: ['x'"), ("matrix:", "matrx:"), ("[0.0, 0.0, 1.0]", "3")):
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(FileFormatError) as caught:
            load_cameras(path)
        assert "\n" not in str(caught.value)
        assert "c.yaml" in str(caught.value)
        assert isinstance(caught.value, BozziniError)
