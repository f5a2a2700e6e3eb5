"""Round cones: against their definition, and the promises that planners rely on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.duct import Centreline, Duct, RoundCones


def random_chain(seed, count=None):
    random = np.random.default_rng(seed)
    count = count or int(random.integers(1, 12))
    steps = random.normal(size=(count, 3)) * random.choice([0.5, 4.0, 12.0], size=(count, 1))
    return random, RoundCones(np.cumsum(steps, axis=0), random.uniform(0.5, 6.0, count))


def scatter(random, duct, count):
    low, high = duct.bounds
    return random.uniform(low - 4.0, high + 4.0, size=(count, duct.dim))


def distance_by_search(duct, points):
    """The definition: the least |p - c| - r over each segment, convex along it."""
    centres, radii = duct.centres, duct.radii
    best = np.linalg.norm(points - centres[0], axis=-1) - radii[0]
    for k in range(len(centres) - 1):
        low, high = np.zeros(len(points)), np.ones(len(points))

        def value(u, k=k):
            place = centres[k] + u[:, None] * (centres[k + 1] - centres[k])
            radius = radii[k] + u * (radii[k + 1] - radii[k])
            return np.linalg.norm(points - place, axis=-1) - radius

        for _ in range(60):
            a, b = low + (high - low) / 3.0, high - (high - low) / 3.0
            left = value(a) < value(b)
            high, low = np.where(left, b, high), np.where(left, low, a)
        ends = np.minimum(value(np.zeros_like(low)), value(np.ones_like(low)))
        best = np.minimum(best, np.minimum(value(low), ends))
    return best


@given(seed=st.integers(0, 10**6))
def test_distance_is_the_least_over_all_balls(seed):
    random, duct = random_chain(seed)
    points = scatter(random, duct, 60)
    assert duct.signed_distance(points) == pytest.approx(distance_by_search(duct, points), abs=1e-9)


@pytest.mark.slow
def test_it_is_exact_at_a_hundred_thousand_places():
    random, duct = random_chain(7, count=6)
    points = scatter(random, duct, 100_000)
    value = duct.signed_distance(points)
    assert np.abs(value - distance_by_search(duct, points)).max() <= 1e-9
    held = np.linalg.norm(points[:, None] - duct.centres, axis=-1) < duct.radii
    assert np.all(value[held.any(axis=1)] < 0.0)
    assert np.all(duct.clearance_bound(points) <= -value)


def test_many_cones_are_searched_as_one_by_one():
    random, duct = random_chain(5, count=150)
    points = scatter(random, duct, 3000)
    each = [
        RoundCones(duct.centres[k : k + 2], duct.radii[k : k + 2]).signed_distance(points)
        for k in range(149)
    ]
    assert duct.signed_distance(points) == pytest.approx(np.min(each, axis=0), abs=1e-12)


@given(seed=st.integers(0, 10**6))
def test_distance_changes_no_faster_than_the_point(seed):
    random, duct = random_chain(seed)
    a = scatter(random, duct, 100)
    b = a + random.normal(size=a.shape) * random.choice([1e-3, 0.3, 5.0], size=(100, 1))
    change = np.abs(duct.signed_distance(a) - duct.signed_distance(b))
    assert np.all(change <= np.linalg.norm(a - b, axis=1) + 1e-12)


@given(seed=st.integers(0, 10**6))
def test_the_ball_that_is_promised_lies_inside(seed):
    random, duct = random_chain(seed)
    points = scatter(random, duct, 400)
    room = duct.clearance_bound(points)
    inside = room > 0.0
    turn = random.normal(size=(200, 1, 3))
    turn /= np.linalg.norm(turn, axis=-1, keepdims=True)
    around = points[inside] + room[inside][:, None] * turn
    assert np.all(duct.signed_distance(around) <= 1e-12)


@given(seed=st.integers(0, 10**6))
def test_outside_the_gradient_leads_to_the_wall(seed):
    random, duct = random_chain(seed)
    points = scatter(random, duct, 100)
    distance = duct.signed_distance(points)
    outside = distance > 1e-6
    foot = points[outside] - distance[outside][:, None] * duct.gradient(points[outside])
    assert np.abs(duct.signed_distance(foot)).max(initial=0.0) < 1e-9


def test_gradient_is_the_slope_of_the_distance():
    random, duct = random_chain(3, count=8)
    points = scatter(random, duct, 300)
    step = 1e-6
    slope = np.stack(
        [
            (duct.signed_distance(points + e) - duct.signed_distance(points - e)) / (2 * step)
            for e in step * np.eye(3)
        ],
        axis=1,
    )
    smooth = np.abs(np.linalg.norm(slope, axis=1) - 1.0) < 1e-6
    assert smooth.mean() > 0.9
    assert duct.gradient(points)[smooth] == pytest.approx(slope[smooth], abs=1e-5)


def test_on_the_axis_the_gradient_is_finite_and_points_to_the_narrow_end():
    cone = RoundCones([(0, 0, 0), (20, 0, 0)], [5.0, 2.0])
    assert cone.gradient([10.0, 0.0, 0.0]) == pytest.approx([0.15, 0.0, 0.0])
    assert np.all(cone.gradient(cone.centres[0]) == 0.0)


def test_one_ball_and_a_ball_inside_a_ball_are_balls():
    points = np.random.default_rng(2).normal(size=(50, 3)) * 6.0
    ball = np.linalg.norm(points, axis=1) - 4.0
    for centres, radii in (
        ([(0, 0, 0)], [4.0]),
        ([(0, 0, 0), (0, 0, 0)], [4.0, 3.0]),
        ([(0, 1, 0), (0, 0, 0)], [2.0, 4.0]),
        ([(0, 0, 0), (0, 0, 2)], [4.0, 2.0]),
    ):
        assert RoundCones(centres, radii).signed_distance(points) == pytest.approx(ball, abs=1e-12)


@given(seed=st.integers(0, 10**6), amount=st.floats(0.0, 0.45))
def test_erosion_and_inflation_shift_the_distance(seed, amount):
    random, duct = random_chain(seed)
    points = scatter(random, duct, 50)
    distance = duct.signed_distance(points)
    assert duct.erode(amount).signed_distance(points) == pytest.approx(distance + amount, abs=1e-9)
    wider = duct.inflate(amount)
    assert wider.signed_distance(points) == pytest.approx(distance - amount, abs=1e-9)
    assert wider.inflation == amount
    assert wider.erode(amount).signed_distance(points) == pytest.approx(distance, abs=1e-9)


def test_a_sampled_chain_answers_the_same_within_its_error():
    random, duct = random_chain(11, count=6)
    duct = duct.inflate(0.5)
    field = duct.sample(1.0)
    points = scatter(random, duct, 500)
    inside = duct.signed_distance(points) < 2.0
    gap = field.signed_distance(points) - duct.signed_distance(points)
    assert np.abs(gap[inside]).max() <= field.error
    assert field.inflation == 0.5 and field.wall == f"{duct.wall}, sampled every 1 mm"
    assert field.inflate(0.5).inflation == 1.0
    assert np.all(duct.bounds[0] >= field.bounds[0]) and np.all(duct.bounds[1] <= field.bounds[1])


@given(seed=st.integers(0, 10**6))
def test_bounds_hold_the_tube_and_touch_it(seed):
    random, duct = random_chain(seed)
    low, high = duct.bounds
    points = scatter(random, duct, 200)
    held = np.all((points >= low) & (points <= high), axis=1)
    assert np.all(held[duct.signed_distance(points) < 0.0])
    k = int(np.argmin(duct.centres[:, 0] - duct.radii))
    touch = duct.centres[k] - [duct.radii[k], 0.0, 0.0]
    assert touch[0] == low[0] and abs(float(duct.signed_distance(touch))) < 1e-9


def test_it_is_a_duct():
    _, duct = random_chain(1)
    assert isinstance(duct, Duct)
    assert (duct.kind, duct.error, duct.wall_error) == ("bound", 0.0, 0.0)
    with pytest.raises(ValueError, match="read-only"):
        duct.centres[0] = 0.0


def test_a_given_way_becomes_a_centreline():
    duct = RoundCones([(0, 0, 0), (30, 0, 0), (30, 40, 0)], [5.0, 4.0, 3.0])
    line = Centreline.from_points(duct.centres, duct)
    assert line.length == pytest.approx(70.0)
    assert np.diff(line.arc_length).max() <= 1.0 + 1e-9
    corner = np.argmin(np.linalg.norm(line.points - duct.centres[1], axis=1))
    assert line.points[corner] == pytest.approx(duct.centres[1], abs=1e-12)
    assert line.radius == pytest.approx(-duct.signed_distance(line.points))
