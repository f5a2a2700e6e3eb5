"""The thesis's printed forms of solid ducts: what holds of them, and what does not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from bozzini.duct import ConnectedCylinders, ConvexPolyhedra
from validation.thesis.solids import (
    PrintedCircle,
    centroid_form,
    cylinder_form,
    cylinder_point,
    half_space_form,
    invert_cylinder,
    measure_pinch,
    super_ellipsoid_form,
)


def box(low, high):
    """The planes of a box, normals of length 2."""
    eye = np.eye(3)
    return np.concatenate(
        [np.c_[2.0 * eye, -2.0 * np.array(high)], np.c_[-2.0 * eye, 2.0 * np.array(low)]]
    )


def test_printed_exponents_of_an_ellipsoid_are_one_and_one_not_two():
    points = np.random.default_rng(0).normal(size=(50, 3)) * 3.0
    ball = np.linalg.norm(points, axis=1) / 2.0 - 1.0
    assert super_ellipsoid_form(points, (2, 2, 2), e=1.0, n=1.0) == pytest.approx(ball, abs=1e-12)
    octahedron = np.abs(points).sum(axis=1) / 2.0 - 1.0
    diamond = super_ellipsoid_form(points, (2, 2, 2), e=2.0, n=2.0)
    assert diamond == pytest.approx(octahedron, abs=1e-12)
    assert float(super_ellipsoid_form([3.0, 0.0, 0.0], (2, 2, 2), e=1.0, n=1.0)) == 0.5


def test_printed_frames_are_orthonormal_and_turn_about_x_after_y():
    circle = PrintedCircle((0, 0, 0), 1.0, 0.4, -0.7)
    turn = Rotation.from_euler("x", 0.4) * Rotation.from_euler("y", -0.7)
    assert circle.frame == pytest.approx(turn.as_matrix(), abs=1e-15)


def test_the_cubic_of_the_printed_form_is_the_quadratic_of_twist_free_frames():
    random = np.random.default_rng(6)
    compared = 0
    for _ in range(60):
        # Turned about X only: the printed frames are then without twist.
        first, second = random.uniform(-0.4, 0.4, 2)
        start = PrintedCircle((0.0, 0.0, 0.0), random.uniform(1, 2), first, 0.0)
        stop = PrintedCircle(
            (*random.uniform(-0.5, 0.5, 2), 5.0), random.uniform(1, 2), second, 0.0
        )
        circles = (start, stop)
        duct = ConnectedCylinders(
            [c.centre for c in circles],
            [c.frame[:, 2] for c in circles],
            [c.radius for c in circles],
        )
        asked = (random.uniform(0.05, 0.95), random.uniform(0.1, 0.95), random.uniform(-3, 3))
        point = cylinder_point(start, stop, u=asked[1], t=asked[0], theta=asked[2])
        held = [root for root in invert_cylinder(start, stop, point) if 0 <= root[0] <= 1]
        best = min(held, key=lambda root: root[1])
        assert best == pytest.approx(asked, abs=1e-8)
        found = duct.locate(point)
        assert (float(found.t), float(found.u)) == pytest.approx(asked[:2], abs=1e-9)
        printed = float(cylinder_form([start, stop], point))
        assert printed == pytest.approx(asked[1] - 1.0, abs=1e-8)
        compared += 1
    assert compared == 60


def test_the_printed_form_pinches_where_a_circle_is_flipped():
    start = PrintedCircle((0, 0, 0), 1.0, 0.0, 0.0)
    flipped = PrintedCircle((0, 0, 4), 1.0, np.pi, 0.0)
    middle = cylinder_point(start, flipped, u=1.0, t=0.5, theta=[0.0, np.pi / 4, np.pi / 2])
    assert np.hypot(middle[:, 0], middle[:, 1]) == pytest.approx(
        [1.0, np.sqrt(0.5), 0.0], abs=1e-12
    )
    assert measure_pinch(start, flipped) == pytest.approx(0.0, abs=1e-12)
    assert measure_pinch(start, PrintedCircle((0, 0, 4), 1.0, 0.0, 0.0)) == pytest.approx(1.0)
    wider = PrintedCircle((0, 0, 4), 2.0, np.pi, 0.0)  # crosses the axis a third of the way
    assert measure_pinch(start, wider) == pytest.approx(0.0, abs=1e-7)
    # The sign of a normal is free here: the same circles make a full cylinder.
    duct = ConnectedCylinders([(0, 0, 0), (0, 0, 4)], [(0, 0, 1), (0, 0, -1)], [1.0, 1.0])
    assert float(duct.signed_distance([0.0, 0.0, 2.0])) == pytest.approx(-1.0, abs=1.1e-7)
    assert np.array_equal(duct.normals, [(0, 0, 1), (0, 0, 1)])


def test_the_printed_half_spaces_fill_a_bend():
    limbs = [box((0, 0, 0), (10, 2, 2)), box((8, 0, 0), (10, 10, 2)), box((0, 8, 0), (10, 10, 2))]
    duct = ConvexPolyhedra(limbs)
    cloud = np.concatenate(duct.corners)
    between = np.array([3.0, 5.0, 1.0])
    triangles = cloud[ConvexHull(cloud).simplices]
    assert np.all(half_space_form(between, triangles, inner=(5.0, 5.0, 1.0)) < 0.0)
    assert float(duct.signed_distance(between)) > 1.0
    # "Contains the origin" turns planes through the origin's corner the wrong way.
    assert not np.all(half_space_form((9.0, 1.0, 1.0), triangles, inner=(-1.0, 1.0, 1.0)) < 0.0)


def test_the_printed_centroid_form_pushes_outwards():
    random = np.random.default_rng(0)
    cloud = random.normal(size=(4000, 3))
    cloud /= np.linalg.norm(cloud, axis=1, keepdims=True)
    cloud = np.concatenate([cloud, -cloud])
    away = centroid_form([(2.0, 0, 0), (1.5, 0, 0), (1.1, 0, 0), (0.9, 0, 0)], cloud)
    assert away == pytest.approx([1 / 2.0, 1 / 1.5, 1 / 1.1, 0.0], abs=1e-12)
    ball = ConvexPolyhedra.from_points([cloud])
    outside = np.linspace(1.1, 4.0, 20)[:, None] * np.array([1.0, 0.0, 0.0])
    assert np.all(np.diff(centroid_form(outside, cloud)) < 0.0)
    assert np.all(np.diff(ball.signed_distance(outside)) > 0.0)
