"""Relative curvature: shapes of known curvature, other parameters, and the printed form's error."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from bozzini.duct import Polygon, RoundCones
from bozzini.errors import GeometryError
from validation.thesis import traverse_curvature as tc


def _torus(major, minor, u, v):
    """Derivatives of a torus at angles u (around the axis), v (around the tube); outward normal."""
    off = major + minor * np.cos(v)
    cu, su, cv, sv = np.cos(u), np.sin(u), np.cos(v), np.sin(v)
    zero = np.zeros_like(u + v)

    def pack(*parts):
        return np.stack(np.broadcast_arrays(*parts, zero)[:-1], axis=-1)

    return (
        pack(-off * su, off * cu, zero),
        pack(-minor * sv * cu, -minor * sv * su, minor * cv),
        pack(-off * cu, -off * su, zero),
        pack(minor * sv * su, -minor * sv * cu, zero),
        pack(-minor * cv * cu, -minor * cv * su, -minor * sv),
        pack(cv * cu, cv * su, sv),
    )


@given(st.floats(0.1, 50.0), st.floats(0.05, 6.2))
def test_a_circle_has_its_own_curvature(radius: float, turn: float) -> None:
    first = radius * np.array([-math.sin(turn), math.cos(turn)])
    second = -radius * np.array([math.cos(turn), math.sin(turn)])
    inside = tc.measure_curve(first, second, side="left")
    assert inside == pytest.approx(1.0 / radius)
    assert tc.measure_curve(first, second, side="right") == pytest.approx(-1.0 / radius)
    # From inside, smaller circles roll and larger ones do not; from outside, all do.
    assert tc.is_traversable(inside, 0.99 * radius)
    assert not tc.is_traversable(inside, 1.01 * radius)
    assert tc.is_traversable(-inside, 100.0 * radius)


@given(st.floats(0.2, 5.0), st.floats(-2.0, 2.0))
def test_curvature_does_not_depend_on_the_parameter(power: float, x: float) -> None:
    # y = x^2 by t with x = sinh(power t) / power
    t = math.asinh(power * x) / power
    dx, ddx = math.cosh(power * t), power * math.sinh(power * t)
    first, second = np.array([dx, 2 * x * dx]), np.array([ddx, 2 * dx**2 + 2 * x * ddx])
    plain = tc.measure_curve([1.0, 2 * x], [0.0, 2.0])
    assert tc.measure_curve(first, second) == pytest.approx(float(plain), rel=1e-9)
    assert plain == pytest.approx(2.0 / (1.0 + 4.0 * x * x) ** 1.5)


def test_the_rolling_circle_really_touches_once() -> None:
    # A ball in the parabola y = x^2: at its foot the largest one that stays above has radius 1/2.
    x = np.linspace(-3.0, 3.0, 20001)
    free = tc.find_rolling_radius(
        tc.measure_curve(np.stack([1 + 0 * x, 2 * x], axis=1), np.stack([0 * x, 2 + 0 * x], axis=1))
    )
    assert free == pytest.approx(0.5)
    for radius, above in ((0.99 * free, True), (1.02 * free, False)):
        gap = np.hypot(x, x * x - radius) - radius  # tangent at the foot
        assert bool(gap.min() >= -1e-12) is above


def test_a_flat_wall_lets_every_circle_roll_but_not_as_printed() -> None:
    assert tc.is_traversable(0.0, 1e6)
    assert tc.find_rolling_radius([0.0, -0.2]) == math.inf
    assert tc.printed_curve(0.0, 0.0, 5.0) == pytest.approx(-0.2)  # "not traversable"
    # As printed, the sign is the opposite everywhere.
    slope, bend = np.linspace(-2, 2, 9), np.linspace(-1, 3, 9)
    right = tc.relative_curvature(
        tc.measure_curve(
            np.stack([np.ones(9), slope], axis=1), np.stack([np.zeros(9), bend], axis=1)
        ),
        0.7,
    )
    np.testing.assert_allclose(tc.printed_curve(slope, bend, 0.7), -right, atol=1e-14)


def test_a_torus_by_its_derivatives() -> None:
    u, v = np.meshgrid(np.linspace(0, 6, 7), np.linspace(0, 6, 9))
    *parts, outward = _torus(10.0, 3.0, u, v)
    found = tc.measure_surface(*parts, toward=-outward)
    around = np.cos(v) / (10.0 + 3.0 * np.cos(v))
    expected = np.sort(np.stack([np.full_like(v, 1 / 3), around], axis=-1), axis=-1)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_allclose(
        tc.measure_surface(*parts, toward=outward), -expected[..., ::-1], atol=1e-12
    )
    assert tc.find_rolling_radius(found) == pytest.approx(3.0)


@given(st.floats(0.1, 5.0), st.floats(0.1, 5.0), st.floats(-0.9, 0.9))
def test_the_shape_operator_does_not_depend_on_the_parameters(a, b, shear) -> None:
    *parts, outward = _torus(10.0, 3.0, np.array(0.3), np.array(1.1))
    one, two, uu, uv, vv = parts
    # u = a s + shear t, v = b t
    changed = (
        a * one,
        shear * one + b * two,
        a * a * uu,
        a * shear * uu + a * b * uv,
        shear * shear * uu + 2 * shear * b * uv + b * b * vv,
    )
    np.testing.assert_allclose(
        tc.measure_surface(*changed, toward=-outward),
        tc.measure_surface(*parts, toward=-outward),
        rtol=1e-9,
        atol=1e-12,
    )


def test_the_printed_matrix_depends_on_the_parameters() -> None:
    # A ball of radius 2 in a ball of radius 4, by unit tangents and by angles.
    zero = np.zeros(3)
    toward = np.array([-1.0, 0.0, 0.0])
    e1, e2 = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    unit = (e1, e2, toward / 4, zero, toward / 4)
    angles = (4 * e1, 4 * e2, 4 * toward, zero, 4 * toward)
    values = [tc.printed_surface(*p, toward=toward, radius=2.0) for p in (unit, angles)]
    assert values[0] == pytest.approx(1 / 4 - 1 / 2)
    assert values[1] == pytest.approx(4 - 1 / 2)
    right = [tc.measure_surface(*p, toward=toward) for p in (unit, angles)]
    np.testing.assert_allclose(right, 1 / 4)


def test_walls_of_ducts() -> None:
    # The side of a cone of half angle s at the radius q from its axis: cos(s)/q around, 0 along.
    cone = RoundCones([[0, 0, 0], [100, 0, 0]], [5.0, 10.0])
    sine = 0.05
    around = np.linspace(0.0, 6.0, 9)
    q = (7.0 + 1e-9) * math.sqrt(1 - sine**2)
    x = 100 * (7.0 - 5.0) / 5.0 - 7.0 * sine
    wall = np.stack([np.full(9, x), q * np.cos(around), q * np.sin(around)], axis=1)
    assert abs(cone.signed_distance(wall)).max() < 1e-6
    found = tc.measure_wall(cone, wall, step=0.05)
    np.testing.assert_allclose(found[:, 0], 0.0, atol=1e-6)
    np.testing.assert_allclose(found[:, 1], math.sqrt(1 - sine**2) / q, rtol=1e-3)
    ball = RoundCones([[1.0, 2.0, 3.0]], [4.0])
    np.testing.assert_allclose(tc.measure_wall(ball, [5.0, 2.0, 3.0]), 0.25, rtol=1e-3)
    with pytest.raises(GeometryError, match=r"no gradient at \(1, 2, 3\) mm"):
        tc.measure_wall(ball, [1.0, 2.0, 3.0])
    flat = Polygon([[0, 0], [40, 0], [40, 6], [0, 6]])
    assert tc.measure_wall(flat, [20.0, 0.5]) == pytest.approx(0.0, abs=1e-9)


def test_a_sampled_ball() -> None:
    field = RoundCones([[0, 0, 0]], [12.0]).sample(0.5)
    random = np.random.default_rng(0).normal(size=(200, 3))
    wall = 12.0 * random / np.linalg.norm(random, axis=1, keepdims=True)
    found = tc.measure_wall(field, wall, step=2.0)
    assert np.median(abs(found - 1 / 12)) < 0.01


def test_meshes() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=5.0)
    np.testing.assert_allclose(tc.measure_mesh(ball.vertices, ball.faces), 0.2, rtol=0.01)
    torus = trimesh.creation.torus(10.0, 3.0, major_sections=96, minor_sections=64)
    cosine = (np.hypot(*torus.vertices.T[:2]) - 10.0) / 3.0
    around = cosine / (10.0 + 3.0 * cosine)
    expected = np.sort(np.stack([np.full_like(around, 1 / 3), around], axis=1), axis=1)
    np.testing.assert_allclose(tc.measure_mesh(torus.vertices, torus.faces), expected, atol=0.025)
