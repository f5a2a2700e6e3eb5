"""Shapes of a tube from two rendered pictures, against the curve that was rendered."""

from __future__ import annotations

import math
import zlib
from dataclasses import replace

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.vision import (
    PairLayout,
    Picture,
    RenderedTube,
    Sensor,
    ShapeOptions,
    bend_curve,
    compare_shapes,
    make_backbone_scene,
    measure_shape,
    render_picture,
    write_picture,
)
from bozzini.vision.camera import CameraSet
from bozzini.vision.pictures import read_manifest
from bozzini.vision.shape_series import measure_shapes, read_model, write_shapes
from tests.vision.sets import PAIR

pytest.importorskip("cv2", reason="the extra 'vision' is not installed")

LENGTH = 47.0
KNOWN = ShapeOptions(length=LENGTH)
SMALL = CameraSet(names=("cam0", "cam1"), cameras=PAIR)


def render_pair(curve, cameras=SMALL, *, name="pair", sensor=Sensor(), covers=(None, None)):
    """Return both pictures of a tube, with a further tube before each camera."""
    scene = make_backbone_scene(curve)
    pictures = []
    for i, (camera, cover) in enumerate(zip(cameras.cameras, covers, strict=True)):
        own = replace(scene, tubes=(*scene.tubes, cover)) if cover else scene
        seed = zlib.crc32(f"{name}{i}".encode())
        pictures.append(render_picture(own, camera, sensor=sensor, seed=seed))
    return pictures


@pytest.fixture(scope="module")
def bent(bent_tube):
    """Give a curve and its two pictures."""
    return bent_tube


@pytest.fixture(scope="module")
def shape(bent):
    """Give the shape measured in these."""
    return measure_shape(bent[1], SMALL, options=KNOWN)


def find_misses(shape, curve) -> np.ndarray:
    """Return the distance of each measured point from the true curve [mm]."""
    fine = np.stack([np.interp(np.linspace(0, 399, 8001), range(400), c) for c in curve.T], axis=1)
    return np.linalg.norm(shape.points[:, None] - fine, axis=2).min(axis=1)


def test_the_measured_shape_is_that_which_was_rendered(bent, shape) -> None:
    curve, _ = bent
    assert shape.converged and shape.rings.all()
    assert np.linalg.norm(shape.tip - curve[-1]) < 0.15
    assert find_misses(shape, curve).max() < 0.15
    assert abs(shape.length - LENGTH) < 0.1 and abs(shape.radius - 3.5) < 0.05
    error = shape.tip - curve[-1]
    assert error @ np.linalg.solve(shape.tip_covariance, error) < 16.0
    last = curve[-1] - curve[-2]
    assert shape.tangents[-1] @ last / np.linalg.norm(last) > math.cos(0.02)


def test_a_holder_moves_the_tip_along_the_tangent(bent, shape) -> None:
    longer = measure_shape(bent[1], SMALL, options=replace(KNOWN, holder=10.0))
    assert np.allclose(longer.tip, shape.tip + 10.0 * shape.tangents[-1])
    assert longer.tip_uncertainty > shape.tip_uncertainty


def test_swapped_cameras_give_the_same_shape(bent, shape) -> None:
    swapped = CameraSet(names=SMALL.names[::-1], cameras=SMALL.cameras[::-1])
    other = measure_shape(bent[1][::-1], swapped, options=KNOWN)
    assert np.abs(other.points - shape.points).max() < 0.01


def test_a_wrong_length_or_diameter_is_refused(bent) -> None:
    for word, value in (("length", 50.0), ("diameter", 8.0)):
        wrong = replace(KNOWN, **{word: value})
        refused = measure_shape(bent[1], SMALL, options=wrong)
        assert word in refused.reason and np.isnan(refused.tip).all()
        assert np.isnan(refused.points).all()


def test_pictures_without_a_tube_are_refused(bent) -> None:
    black = Picture(np.zeros((400, 640), np.float32))
    refused = measure_shape([bent[1][0], black], SMALL)
    assert "no silhouette" in refused.reason and math.isnan(refused.length)
    with pytest.raises(InputError, match="640 x 400"):
        measure_shape([bent[1][0], Picture(np.zeros((10, 10), np.float32))], SMALL)


def test_a_curve_equals_itself_and_a_turned_model_is_turned_back(bent, shape) -> None:
    curve, _ = bent
    same = compare_shapes([shape], [curve], alignment="world")
    assert same.residual < 0.15
    turned = bend_curve(LENGTH, math.radians(60.0), plane=-2.0)
    assert compare_shapes([shape], [turned]).residual < 0.3
    straight = compare_shapes([shape], [bend_curve(LENGTH, 0.0)])
    assert straight.residual > 5.0
    apart = np.linalg.norm(bend_curve(LENGTH, 0.0)[-1] - curve[-1])
    assert straight.distances[0, -1] == pytest.approx(apart, abs=1.0)


def test_a_table_gives_files_and_a_reason_for_each_row(bent, tmp_path) -> None:
    curve, pictures = bent
    for name, picture in zip(SMALL.names, pictures, strict=True):
        write_picture(picture, tmp_path / f"{name}.png")
    table = tmp_path / "table.csv"
    table.write_text("pose,cam0,cam1,p_r_kpa\na,cam0.png,cam1.png,100\nb,cam0.png,none.png,200\n")
    lines = [f"{pose},{x},{y},{z}" for pose in "ab" for x, y, z in curve[::21]]
    (tmp_path / "model.csv").write_text("\n".join(["pose,x_mm,y_mm,z_mm", *lines]))
    found = measure_shapes(read_manifest(table, SMALL.names), SMALL, options=KNOWN)
    curves = read_model(tmp_path / "model.csv", ["a"])
    comparison = compare_shapes(found.shapes[:1], curves, names=["a"], alignment="world")
    summary = write_shapes(found, tmp_path / "out", cameras=SMALL, comparison=comparison)
    assert (summary["ok"], summary["failed"]) == (1, 1) and not found.converged
    assert "no such picture" in found.rows[1]["reason"]
    frame = found.to_frame()
    assert list(frame["p_r_kpa"]) == ["100", "200"] and np.isnan(frame["tip_x_mm"][1])
    points = found.list_points()
    places = np.transpose([points[f"{axis}_mm"] for axis in "xyz"])
    assert np.allclose(places, found.shapes[0].points)
    assert summary["comparison"]["rms_mm"] < 0.15
    assert {"shape_points.csv", "shape_summary.csv", "comparison.png"} <= set(summary["files"])


LARGE = CameraSet(names=("cam0", "cam1"), cameras=PairLayout().make_cameras())
BENT = bend_curve(LENGTH, math.radians(50.0), plane=1.0)


def cover_point(point, *, radius, half, albedo=0.02, nearer=8.0) -> RenderedTube:
    """Return a bar across the view of a point by the first large camera."""
    ahead = LARGE.cameras[0].centre - point
    middle = point + nearer * ahead / np.linalg.norm(ahead)
    return RenderedTube(
        curve=np.stack([middle - np.array(half), middle + np.array(half)]),
        radius=radius,
        albedo=albedo,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cover", "flag"),
    [
        (cover_point(BENT[200], radius=1.5, half=(20.0, 0.0, 0.0)), "parts"),
        (cover_point(BENT[200], radius=7.5, half=(20.0, 0.0, 0.0)), ""),
        (
            cover_point(BENT[200], radius=3.0, half=(30.0, 0.0, 10.0), albedo=0.8, nearer=12.0),
            "",
        ),
    ],
    ids=["narrow", "wide", "bright"],
)
def test_what_covers_the_tube_is_flagged_or_refused(cover: RenderedTube, flag: str) -> None:
    pictures = render_pair(BENT, LARGE, covers=(cover, None))
    shape = measure_shape(pictures, LARGE, options=KNOWN)
    if not flag:
        assert shape.reason and np.isnan(shape.tip).all()
    else:
        assert shape.converged and flag in shape.flags
        assert np.linalg.norm(shape.tip - BENT[-1]) < 0.2


@pytest.mark.slow
def test_a_hidden_ring_is_flagged_and_uncertain() -> None:
    ahead = LARGE.cameras[0].centre - BENT[-1]
    middle = BENT[-1] + 10.0 * ahead / np.linalg.norm(ahead)
    bar = RenderedTube(curve=np.stack([middle, middle + [0.0, 0.0, 8.0]]), radius=4.0, albedo=0.02)
    shape = measure_shape(render_pair(BENT, LARGE, covers=(bar, None)), LARGE, options=KNOWN)
    error = shape.tip - BENT[-1]
    assert shape.converged and "ring_missing" in shape.flags
    assert np.linalg.norm(error) < 0.2 and shape.tip_uncertainty > 0.05
    assert error @ np.linalg.solve(shape.tip_covariance, error) < 16.0


@pytest.mark.slow
@pytest.mark.parametrize("bend", [70.0, 100.0, 115.0])
def test_a_tube_towards_a_camera_is_flagged_or_refused(bend: float) -> None:
    eye = LARGE.cameras[0].centre
    curve = bend_curve(LENGTH, math.radians(bend), plane=math.atan2(eye[1], eye[0]))
    shape = measure_shape(render_pair(curve, LARGE), LARGE, options=KNOWN)
    error = shape.tip - curve[-1]
    assert shape.reason or error @ np.linalg.solve(shape.tip_covariance, error) < 16.0
    assert bool(shape.reason) == (bend > 110.0)
    assert "end_on" in shape.flags


@pytest.mark.slow
@pytest.mark.parametrize(
    "sensor",
    [Sensor(noise=0.05), Sensor(aperture=8.0, focus=240.0), Sensor(exposure=0.08)],
    ids=["noise", "defocus", "dark"],
)
def test_bad_pictures_keep_their_uncertainty(sensor: Sensor) -> None:
    shape = measure_shape(render_pair(BENT, LARGE, sensor=sensor), LARGE, options=KNOWN)
    error = shape.tip - BENT[-1]
    assert shape.converged and np.linalg.norm(error) < 0.2
    assert find_misses(shape, BENT).max() < 0.25
    assert error @ np.linalg.solve(shape.tip_covariance, error) < 27.0
