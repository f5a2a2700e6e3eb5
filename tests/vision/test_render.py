from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.numeric.polylines import resample_polyline
from bozzini.vision import (
    Camera,
    HungMuscle,
    Light,
    PairLayout,
    RenderedTube,
    Scene,
    Sensor,
    StripBoard,
    aim_camera,
    bend_curve,
    make_backbone_scene,
    render_picture,
)
from bozzini.vision.kernels.rays import undistort_grid
from bozzini.vision.render import _find_rays, _trace_scene

CLEAN = Sensor(blur=0.0, noise=0.0, uneven=0.0, gamma=1.0, jpeg=0, bits=16, exposure=0.85)
FLAT = Light(ambient=1.0, diffuse=0.0)


def _camera(size=(300, 200), pitch=0.2, distortion=(-0.1, 0.04, 3e-4, -2e-4, 0.0)) -> Camera:
    return aim_camera(
        (5.0, -8.0, -200.0), (0.0, 0.0, 0.0), focal=200.0 / pitch, size=size, distortion=distortion
    )


def _ball(middle, radius, albedo=0.8) -> RenderedTube:
    ends = np.array([middle, middle]) + np.outer([-1e-4, 1e-4], [0.0, 0.0, 1.0])
    return RenderedTube(curve=ends, radius=radius, albedo=albedo)


def test_compiled_rays_are_those_of_the_camera():
    camera = _camera(distortion=(-0.32, 0.15, 3e-4, -6e-4, -0.045))
    fx, fy, cx, cy = camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    x, y = np.arange(0.0, 300.0, 7.0), np.arange(0.0, 200.0, 9.0)
    grid = undistort_grid((x - cx) / fx, (y - cy) / fy, *camera.distortion)
    pixels = np.stack(np.meshgrid(x, y), axis=-1)
    assert grid == pytest.approx(camera.undistort(pixels), abs=1e-6)


def test_a_ball_covers_the_cone_of_its_tangents():
    camera, radius = _camera(distortion=(0.0,) * 5), 6.0
    middle = np.array([3.0, 2.0, -5.0])
    scene = Scene(tubes=(_ball(middle, radius),), light=FLAT, background=0.0)
    picture = render_picture(scene, camera, sensor=dataclasses.replace(CLEAN, supersampling=4))
    x, y = np.meshgrid(np.arange(300), np.arange(200))
    rays = camera.rays(np.stack([x, y], axis=-1).astype(float))
    to_middle = middle - camera.centre
    away = np.linalg.norm(np.cross(rays, to_middle), axis=-1)
    pixel = 0.2 * 1.1
    assert (picture.values[away < radius - pixel] > 0.79).all()
    assert (picture.values[away > radius + pixel] < 0.01).all()
    half = np.interp(
        radius, np.sort(away.ravel()), picture.values.ravel()[np.argsort(away.ravel())]
    )
    assert 0.1 < half < 0.7


def test_no_ray_at_the_limb_of_a_bent_tube_is_lost():
    curve, radius = bend_curve(40.0, 1.2, plane=0.4), 3.5
    camera = aim_camera((30.0, -150.0, 20.0), (8.0, 0.0, 20.0), focal=450.0, size=(180, 150))
    depth = _trace_scene(Scene(tubes=(RenderedTube(curve=curve, radius=radius),)), camera, 1)[1]
    grid = _find_rays(camera, 1)
    rays = np.dstack([grid, np.ones(grid.shape[:2])]).reshape(-1, 3).astype(float)
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    points = camera.to_camera(resample_polyline(curve, 0.02))
    along = rays @ points.T
    away = np.sqrt(np.maximum((points**2).sum(axis=1) - along**2, 0.0).min(axis=1))
    hit = np.isfinite(depth.ravel())
    assert (np.abs(away - radius) < 0.1).sum() > 100
    assert hit[away < radius - 2e-4].all() and not hit[away > radius + 2e-4].any()


def test_tubes_hide_what_is_behind_them():
    near, far = _ball((0, 0, -20.0), 3.0, 0.8), _ball((0, 0, 20.0), 5.0, 0.2)
    camera = aim_camera((0, 0, -200.0), (0, 0, 0), focal=1000.0, size=(100, 100))
    for tubes in ((near, far), (far, near)):
        values = render_picture(Scene(tubes=tubes, light=FLAT), camera, sensor=CLEAN).values
        assert values[50, 50] == pytest.approx(0.8, abs=0.01)
        assert values[50, 50 + 20] == pytest.approx(0.2, abs=0.01)


def test_rings_are_where_they_are_said_to_be():
    board, muscle = StripBoard(), HungMuscle(length=30.0, angle=0.1, tilt=0.05, offset=(2.0, -1.0))
    marks = muscle.find_marks(board)
    assert np.linalg.norm(marks[1] - marks[0]) == pytest.approx(30.0)
    assert marks[:, 2].mean() == pytest.approx(-muscle.height)
    camera = aim_camera((30, 35, -300), (30, 35, 0), focal=2500.0, size=(480, 640))
    values = render_picture(muscle.make_scene(board, light=FLAT), camera, sensor=CLEAN).values
    column, row = np.round(camera.project(marks)).astype(int).T
    assert values[row, column] == pytest.approx(muscle.dark, abs=0.01)
    column, row = np.round(camera.project(marks.mean(axis=0))).astype(int)
    assert values[row, column] == pytest.approx(muscle.body, abs=0.01)


def test_a_straight_tube_is_the_same_from_two_points_or_many():
    camera = aim_camera((0, 0, -150.0), (0, 0, 0), focal=1000.0, size=(400, 40))
    first, second = (
        render_picture(
            Scene(
                tubes=(RenderedTube(curve=np.linspace([-25.0, 0, 0], [25.0, 0, 0], n), radius=1.0),)
            ),
            camera,
            sensor=CLEAN,
        ).values
        for n in (2, 51)
    )
    assert first == pytest.approx(second, abs=2e-3)


def test_a_picture_is_the_same_whatever_was_rendered_before():
    camera, board = _camera(), StripBoard()
    scenes = [HungMuscle(length=length).make_scene(board) for length in (20.0, 24.0)]
    for scene in (*scenes, dataclasses.replace(scenes[0], background=0.3)):
        found = render_picture(scene, camera, sensor=CLEAN).values
        fresh = dataclasses.replace(scene, board=dataclasses.replace(board))
        anew = render_picture(fresh, dataclasses.replace(camera), sensor=CLEAN).values
        assert np.array_equal(found, anew)


@pytest.mark.parametrize("lean", [0.0, 0.2])
@pytest.mark.parametrize("samples", [1, 2])
def test_edges_of_bands_cover_their_share_of_a_pixel(samples, lean):
    camera = aim_camera((0, 0, -200.0), (0, 0, 0), focal=1000.0, size=(120, 40))
    sensor = dataclasses.replace(CLEAN, supersampling=samples)
    along = np.array([math.cos(lean), math.sin(lean), 0.0])
    curve, x = np.outer([-15.0, 15.0], along), np.arange(120)
    for start in np.linspace(-1.0, -0.8, 5):
        tube = RenderedTube(
            curve=curve, radius=3.0, albedo=0.8, bands=((15 + start, 17 + start, 0.1),)
        )
        values = render_picture(Scene(tubes=(tube,), light=FLAT), camera, sensor=sensor).values
        dark = (0.8 - values[19:21].mean(axis=0)[30:90]) / 0.7  # either side of the axis
        at, _ = camera.project([(start + 1.0) / along[0], 0.0, -3.0])
        assert dark.sum() == pytest.approx(2.0 / along[0] * 1000.0 / 197.0, abs=0.01)
        assert dark @ x[30:90] / dark.sum() == pytest.approx(at, abs=0.01)


def test_the_same_seed_gives_the_same_picture():
    scene, camera = Scene(tubes=(_ball((0, 0, 0), 5.0),)), _camera()
    first, again, other = (render_picture(scene, camera, seed=k) for k in (7, 7, 8))
    assert np.array_equal(first.values, again.values)
    assert not np.array_equal(first.values, other.values)


def test_noise_gamma_and_bits_do_what_they_say():
    scene, camera = Scene(background=0.4), _camera()
    noisy = render_picture(
        scene, camera, sensor=dataclasses.replace(CLEAN, noise=0.05), seed=1
    ).values
    assert noisy.mean() == pytest.approx(0.4, abs=0.001)
    assert noisy.std() == pytest.approx(0.05 * np.sqrt(0.1 + 0.9 * 0.4), rel=0.02)
    bent = render_picture(scene, camera, sensor=dataclasses.replace(CLEAN, gamma=2.0)).values
    assert bent.mean() == pytest.approx(np.sqrt(0.4), abs=1e-4)
    full = render_picture(Scene(background=9.0), camera, sensor=dataclasses.replace(CLEAN, bits=8))
    assert full.saturated == 1.0
    uneven = render_picture(scene, camera, sensor=dataclasses.replace(CLEAN, uneven=0.5)).values
    assert uneven[0, 0] / uneven[-1, -1] == pytest.approx(2.0, rel=0.01)


def _edge_width(values: np.ndarray) -> float:
    row = values[100].astype(float)
    share = (row - row.min()) / np.ptp(row)
    return float(
        np.interp(0.9, share[:150], np.arange(150)) - np.interp(0.1, share[:150], np.arange(150))
    )


def test_defocus_grows_with_the_distance_from_the_plane_in_focus():
    camera = aim_camera((0, 0, -200.0), (0, 0, 0), focal=1000.0, size=(300, 200))
    scene = Scene(tubes=(_ball((0, 0, 0), 15.0),), light=FLAT, background=0.0)
    sharp, near, far = (
        _edge_width(
            render_picture(scene, camera, sensor=dataclasses.replace(CLEAN, **given)).values
        )
        for given in ({}, {"aperture": 4.0, "focus": 180.0}, {"aperture": 4.0, "focus": 150.0})
    )
    assert sharp < 1.0 < near < far
    # A disc's edge rises from 10 to 90 % over about 1.37 radii.
    radius = 0.5 * 4.0 * 1000.0 * (1 / 150.0 - 1 / 199.0)
    assert far == pytest.approx(1.37 * radius, rel=0.2)


def test_gloss_adds_a_highlight_where_the_light_is_mirrored():
    camera = aim_camera((0, 0, -300.0), (0, 0, 0), focal=2000.0, size=(300, 200))
    light = Light(position=(0.0, -400.0, -300.0), gloss=0.5, exponent=80.0)
    scene = Scene(tubes=(_ball((0, 0, 0), 8.0, albedo=0.2),), light=light)
    values = render_picture(scene, camera, sensor=CLEAN).values
    dull = dataclasses.replace(scene, light=dataclasses.replace(light, gloss=0.0))
    extra = values - render_picture(dull, camera, sensor=CLEAN).values
    row, column = np.unravel_index(np.argmax(extra), extra.shape)
    eye, lamp = np.array([0, 0, -1.0]), np.array([0, -0.8, -0.6])
    half = (eye + lamp) / np.linalg.norm(eye + lamp)
    assert (column, row) == pytest.approx(camera.project(8.0 * half), abs=3.0)
    assert extra.max() > 0.3


def test_jpeg_costs_little_of_a_picture():
    scene, camera = Scene(tubes=(_ball((0, 0, 0), 9.0),)), _camera()
    plain = Sensor(jpeg=0)
    whole = render_picture(scene, camera, sensor=plain).values
    losses = [
        np.sqrt(np.mean((render_picture(scene, camera, sensor=Sensor(jpeg=q)).values - whole) ** 2))
        for q in (95, 50, 10)
    ]
    assert 0.0 < losses[0] < losses[1] < losses[2] < 0.1


def test_a_backbone_has_its_rings_at_the_ends_of_the_curve():
    curve = bend_curve(40.0, 1.0, plane=0.7)
    assert np.linalg.norm(np.diff(curve, axis=0), axis=1).sum() == pytest.approx(40.0, abs=1e-3)
    assert curve[1] / np.linalg.norm(curve[1]) == pytest.approx([0, 0, 1], abs=0.01)
    scene = make_backbone_scene(curve, diameter=6.0, light=FLAT)
    for camera in PairLayout(size=(320, 200), pitch=0.4, target=(0, 0, 20)).make_cameras():
        values = render_picture(scene, camera, sensor=CLEAN).values
        ahead = camera.centre - curve[0]
        on_skin = curve[0] + 3.0 * (ahead - [0, 0, ahead[2]]) / np.linalg.norm(ahead[:2])
        column, row = np.round(camera.project(on_skin)).astype(int)
        assert values[row, column] < 0.2
        column, row = np.round(camera.project(curve[200])).astype(int)
        assert values[row, column] > 0.6


def test_what_cannot_be_rendered_is_one_line():
    camera = _camera()
    behind = Scene(tubes=(_ball(camera.centre, 5.0),))
    with pytest.raises(InputError, match="behind the camera"):
        render_picture(behind, camera)
    with pytest.raises(InputError, match="bits"):
        Sensor(bits=12)
    with pytest.raises(InputError, match="seed"):
        render_picture(Scene(), camera, seed=-1)
    with pytest.raises(InputError, match="curve"):
        RenderedTube(curve=np.zeros((1, 3)), radius=1.0)
