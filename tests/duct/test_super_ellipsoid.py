"""Super-ellipsoids: the gauge's properties, and a distance that never promises too much."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bozzini.duct.base import Duct
from bozzini.duct.shapes.super_ellipses import SuperEllipsoids
from bozzini.errors import GeometryError
from validation.thesis.solids import super_ellipsoid_form

EXPONENTS = (0.1, 0.25, 1.0, 1.5, 2.0)


def draw(seed, count=None, *, connected=False):
    """A few shapes, turned at random; each in reach of the one before."""
    random = np.random.default_rng(seed)
    count = count or int(random.integers(1, 6))
    axes = random.uniform(1.0, 6.0, (count, 3)) * random.choice([1.0, 3.0], (count, 1))
    steps = random.normal(size=(count, 3))
    steps *= 2.0 / np.linalg.norm(steps, axis=1, keepdims=True)
    return random, SuperEllipsoids(
        np.cumsum(steps, axis=0),
        axes,
        e1=random.choice(EXPONENTS, count),
        e2=random.uniform(0.1, 2.0, count),
        rotations=Rotation.random(count, random_state=seed).as_matrix(),
        connected=connected,
    )


def one(half_axes, e1, e2, rotation=None, centre=(0.0, 0.0, 0.0)):
    turn = np.eye(3) if rotation is None else rotation
    return SuperEllipsoids([centre], [half_axes], e1=[e1], e2=[e2], rotations=[turn])


def raise_signed(value, power):
    return np.sign(value) * np.abs(value) ** power


def wall_of(duct, k, count, random):
    """Points on the wall of shape k, by Barr's parameters."""
    along = random.uniform(-0.5 * np.pi, 0.5 * np.pi, count)
    around = random.uniform(-np.pi, np.pi, count)
    e1, e2 = duct.e1[k], duct.e2[k]
    flat = raise_signed(np.cos(along), e1)
    local = np.stack(
        [
            flat * raise_signed(np.cos(around), e2),
            flat * raise_signed(np.sin(around), e2),
            raise_signed(np.sin(along), e1),
        ],
        axis=1,
    )
    return duct.centres[k] + (local * duct.half_axes[k]) @ duct.rotations[k].T


def scatter(random, duct, count):
    low, high = duct.bounds
    return random.uniform(low - 5.0, high + 5.0, (count, 3))


@pytest.mark.parametrize("e1", [0.25, 1.0, 2.0])
@pytest.mark.parametrize("e2", [0.25, 1.0, 2.0])
def test_the_gauge_is_homogeneous_and_1_on_the_wall(e1, e2):
    random = np.random.default_rng(3)
    duct = one((2.0, 3.0, 5.0), e1, e2, Rotation.random(random_state=1).as_matrix(), (1, 2, 3))
    points = scatter(random, duct, 200)
    gauge = duct.evaluate_gauge(points)[:, 0]
    stretched = duct.centres[0] + 2.5 * (points - duct.centres[0])
    assert duct.evaluate_gauge(stretched)[:, 0] == pytest.approx(2.5 * gauge, rel=1e-12)
    assert duct.evaluate_gauge(wall_of(duct, 0, 500, random)) == pytest.approx(1.0, abs=1e-12)
    local = (points - duct.centres[0]) @ duct.rotations[0]
    printed = super_ellipsoid_form(local, duct.half_axes[0], e=e2, n=e1)
    assert printed == pytest.approx(gauge - 1.0, rel=1e-10, abs=1e-10)


def test_a_ball_is_exact():
    random = np.random.default_rng(1)
    duct = one((4.0, 4.0, 4.0), 1.0, 1.0, centre=(1.0, -2.0, 3.0))
    points = scatter(random, duct, 1000)
    exact = np.linalg.norm(points - duct.centres[0], axis=1) - 4.0
    assert duct.signed_distance(points) == pytest.approx(exact, abs=1e-9)


def test_sign_bound_and_slope_at_many_points():
    random, duct = draw(7, count=4)
    points = scatter(random, duct, 100_000)
    value = duct.signed_distance(points)
    assert np.array_equal(value < 0.0, duct.evaluate_gauge(points).min(axis=1) < 1.0)
    assert (value < 0.0).sum() > 3000
    other = points + random.normal(size=points.shape) * random.choice([1e-4, 1.0], (len(points), 1))
    change = np.abs(duct.signed_distance(other) - value)
    assert np.all(change <= np.linalg.norm(other - points, axis=1) + 1e-11)


@given(seed=st.integers(0, 10**6))
def test_value_is_never_above_the_distance_to_the_wall(seed):
    from scipy.spatial import cKDTree

    random, duct = draw(seed, count=1)
    points = scatter(random, duct, 300)
    value = duct.signed_distance(points)
    wall = wall_of(duct, 0, 4000, random)
    assert np.all(np.abs(value) <= cKDTree(wall).query(points)[0] + 1e-9)
    # At the centre it is the least radius, which the wall has somewhere.
    assert -float(duct.signed_distance(duct.centres[0])) == pytest.approx(duct.least_radii[0])


@pytest.mark.parametrize("e1", EXPONENTS)
@pytest.mark.parametrize("e2", EXPONENTS)
def test_the_least_radius_is_that_of_the_wall(e1, e2):
    duct = one((2.0, 2.5, 3.0), e1, e2)
    directions = np.random.default_rng(0).normal(size=(200_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    axes = np.concatenate([directions, np.eye(3)])
    radii = 1.0 / duct.evaluate_gauge(axes)[:, 0]
    least = float(duct.least_radii[0])
    assert least <= radii.min() + 1e-12
    assert radii.min() <= least * 1.003


@given(seed=st.integers(0, 10**6))
def test_the_ball_that_is_promised_lies_inside(seed):
    random, duct = draw(seed)
    points = scatter(random, duct, 400)
    room = duct.clearance_bound(points)
    inside = room > 0.0
    turn = random.normal(size=(100, 1, 3))
    turn /= np.linalg.norm(turn, axis=-1, keepdims=True)
    around = points[inside] + room[inside][:, None] * turn
    assert np.all(duct.evaluate_gauge(around).min(axis=-1) <= 1.0 + 1e-12)


@given(seed=st.integers(0, 10**6))
def test_gradient_is_the_slope_of_the_distance(seed):
    random, duct = draw(seed)
    points = scatter(random, duct, 60)
    step = 1e-6
    slope = np.stack(
        [
            (duct.signed_distance(points + e) - duct.signed_distance(points - e)) / (2.0 * step)
            for e in step * np.eye(3)
        ],
        axis=1,
    )
    gradient = duct.gradient(points)
    near = np.abs(gradient - slope).max(axis=1) < 1e-3
    # Off: edges of octahedra, places between two shapes.
    assert near.mean() > 0.85
    assert np.linalg.norm(gradient, axis=1).max() <= 1.0 + 1e-9


def test_bounds_hold_the_walls_and_touch_them():
    random, duct = draw(11, count=3)
    low, high = duct.bounds
    wall = np.concatenate([wall_of(duct, k, 100_000, random) for k in range(3)])
    assert np.all(wall >= low - 1e-9) and np.all(wall <= high + 1e-9)
    assert wall.min(axis=0) == pytest.approx(low, abs=0.15)
    assert wall.max(axis=0) == pytest.approx(high, abs=0.15)


@pytest.mark.parametrize(("e1", "e2"), [(1.0, 1.0), (0.3, 1.7), (2.0, 0.5)])
def test_volume_is_the_share_of_points_inside(e1, e2):
    duct = one((2.0, 3.0, 4.0), e1, e2)
    points = np.random.default_rng(5).uniform(-1.0, 1.0, (200_000, 3)) * duct.half_axes[0]
    share = np.mean(duct.signed_distance(points) < 0.0)
    assert duct.volumes[0] == pytest.approx(share * 8.0 * 24.0, rel=0.02)


def test_erosion_keeps_what_has_the_clearance():
    random, duct = draw(5, count=3)
    points = scatter(random, duct, 500)
    eroded = duct.erode(0.3)
    assert eroded.signed_distance(points) == pytest.approx(duct.signed_distance(points) + 0.3)


@given(seed=st.integers(0, 10**6))
def test_inflation_never_promises_more_than_its_amount(seed):
    random, duct = draw(seed)
    points = scatter(random, duct, 100)
    change = duct.signed_distance(points) - duct.inflate(0.7).signed_distance(points)
    assert np.all(change >= -1e-12) and np.all(change <= 0.7 + 1e-12)


def test_shapes_that_meet_beside_the_line_of_their_centres_hang_together():
    # Two long rods in a V: they cross at its tip, far from the line between their centres.
    turn = Rotation.from_euler("z", [[30.0], [-30.0]], degrees=True).as_matrix()
    centres = turn[:, :, 0] * 9.0
    rods = {"e1": [1.0, 1.0], "e2": [1.0, 1.0], "rotations": turn}
    duct = SuperEllipsoids(centres, [(10.0, 1.0, 1.0)] * 2, **rods)
    assert float(duct.signed_distance([0.0, 0.0, 0.0])) < 0.0
    with pytest.raises(GeometryError, match="is not connected: shape 0 and shape 1 come nearest"):
        SuperEllipsoids(centres * 1.2, [(10.0, 1.0, 1.0)] * 2, **rods)


def test_a_union_that_falls_apart_names_the_shapes():
    centres = np.arange(6)[:, None] * np.array([3.0, 0.0, 0.0]) + np.array([1.0, 0.0, 0.0])
    centres[4:] += [2.0, 0.0, 0.0]
    same = {"e1": np.ones(6), "e2": np.ones(6), "rotations": np.tile(np.eye(3), (6, 1, 1))}
    with pytest.raises(GeometryError, match="shape 3 and shape 4 come nearest, and do not overlap"):
        SuperEllipsoids(centres, np.full((6, 3), 2.0), **same)
    SuperEllipsoids(centres, np.full((6, 3), 2.0), **same, connected=False)
    SuperEllipsoids(
        centres[[0, 2, 1, 3]], np.full((4, 3), 2.0), **{k: v[:4] for k, v in same.items()}
    )


def test_it_is_a_duct():
    _, duct = draw(1)
    assert isinstance(duct, Duct)
    assert (duct.kind, duct.error, duct.wall_error) == ("bound", 0.0, 0.0)
    with pytest.raises(ValueError, match="read-only"):
        duct.half_axes[0] = 0.0
