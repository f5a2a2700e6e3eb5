"""The polygon: exact on both sides, simple or refused, planar in a 3-D frame."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.path import Path

from bozzini.duct import Centreline, Duct, Polygon
from bozzini.errors import GeometryError, InputError


def random_star(seed):
    """A star-shaped, hence simple, polygon with random radii."""
    random = np.random.default_rng(seed)
    count = int(random.integers(3, 25))
    angles = 2.0 * np.pi * (np.arange(count) + random.uniform(-0.2, 0.2, count)) / count
    radii = random.uniform(3.0, 20.0, count)
    vertices = radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return random, Polygon(vertices + random.uniform(-50.0, 50.0, 2))


def scatter(random, duct, count):
    low, high = duct.bounds
    return random.uniform(low - 5.0, high + 5.0, size=(count, 2))


def wall_distance(vertices, points):
    """Distance to the edges, one by one."""
    best = np.full(len(points), np.inf)
    for a, b in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        u = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - a - u[:, None] * (b - a), axis=1))
    return best


@given(seed=st.integers(0, 10**6))
def test_distance_and_side_agree_with_others(seed):
    random, duct = random_star(seed)
    points = scatter(random, duct, 200)
    distance = duct.signed_distance(points)
    assert np.abs(distance) == pytest.approx(wall_distance(duct.vertices, points), abs=1e-10)
    inside = Path(duct.vertices).contains_points(points)
    sure = np.abs(distance) > 1e-9
    assert np.array_equal(distance[sure] < 0.0, inside[sure])


def test_it_is_exact_at_a_hundred_thousand_places():
    random, duct = random_star(12)
    points = scatter(random, duct, 100_000)
    distance = duct.signed_distance(points)
    assert np.abs(np.abs(distance) - wall_distance(duct.vertices, points)).max() <= 1e-9
    inside = Path(duct.vertices).contains_points(points)
    sure = np.abs(distance) > 1e-9
    assert np.array_equal(distance[sure] < 0.0, inside[sure])
    assert np.all(duct.clearance_bound(points) <= -distance)


def test_the_level_of_a_vertex_does_not_confuse_the_side():
    # A ray through vertices, and along edges.
    duct = Polygon([(0, 0), (4, 0), (4, 2), (6, 2), (6, 0), (10, 0), (10, 4), (5, 2.5), (0, 4)])
    points = np.array([(x, y) for x in (-1.0, 2.0, 5.0, 8.0, 11.0) for y in (0.0, 2.0, 2.5, 4.0)])
    distance = duct.signed_distance(points)
    inside = np.array([(x in (2.0, 8.0)) and y in (2.0, 2.5) for x, y in points])
    sure = np.abs(distance) > 1e-12
    assert np.array_equal(distance[sure] < 0.0, inside[sure])


@given(seed=st.integers(0, 10**6))
def test_distance_changes_no_faster_than_the_point(seed):
    random, duct = random_star(seed)
    a = scatter(random, duct, 100)
    b = a + random.normal(size=a.shape) * random.choice([1e-3, 0.3, 5.0], size=(100, 1))
    change = np.abs(duct.signed_distance(a) - duct.signed_distance(b))
    assert np.all(change <= np.linalg.norm(a - b, axis=1) + 1e-12)


@given(seed=st.integers(0, 10**6))
def test_the_gradient_leads_to_the_wall_from_both_sides(seed):
    random, duct = random_star(seed)
    points = scatter(random, duct, 100)
    gradient = duct.gradient(points)
    assert np.linalg.norm(gradient, axis=1) == pytest.approx(1.0, abs=1e-9)
    foot = points - duct.signed_distance(points)[:, None] * gradient
    assert np.abs(duct.signed_distance(foot)).max() < 1e-9


def test_on_the_wall_the_gradient_points_out():
    duct = Polygon([(0, 0), (0, 10), (10, 10), (10, 0)])
    assert duct.gradient([[5.0, 0.0], [10.0, 5.0]]) == pytest.approx(np.array([[0, -1], [1, 0]]))


@given(seed=st.integers(0, 10**6))
def test_the_way_round_does_not_matter(seed):
    random, duct = random_star(seed)
    points = scatter(random, duct, 50)
    other = Polygon(duct.vertices[::-1])
    closed = Polygon(np.concatenate([duct.vertices, duct.vertices[:1]]))
    assert duct.area == pytest.approx(other.area) and duct.area > 0.0
    assert np.array_equal(duct.vertices, closed.vertices)
    assert other.signed_distance(points) == pytest.approx(duct.signed_distance(points), abs=1e-12)


@given(seed=st.integers(0, 10**6), amount=st.floats(0.1, 4.0))
def test_inflation_promises_only_room_that_is_there(seed, amount):
    random, duct = random_star(seed)
    wider = duct.inflate(amount)
    assert (wider.kind, wider.inflation) == ("bound", amount)
    points = scatter(random, duct, 100)
    room = wider.clearance_bound(points)
    inside = room > 0.0
    turn = random.uniform(0.0, 2.0 * np.pi, size=(50, 1))
    around = points[inside] + room[inside][:, None] * np.stack([np.cos(turn), np.sin(turn)], -1)
    # all of it lies within `amount` of the polygon
    assert np.all(duct.signed_distance(around) <= amount + 1e-9)
    assert np.all(wider.bounds == duct.bounds + amount * np.array([[-1.0], [1.0]]))


def test_kernels_see_the_same_and_ignore_height():
    from bozzini.duct.kernels.clearance import evaluate_bound

    random, duct = random_star(4)
    points = scatter(random, duct, 100)
    embedded = duct.to_grid(points)
    assert embedded.shape == (100, 3) and np.all(embedded[:, 2] == 0.0)
    assert np.array_equal(duct.to_world(embedded), points)
    bound, lifted = np.empty(100), np.empty(100)
    evaluate_bound(duct.pack(), embedded, bound)
    evaluate_bound(duct.pack(), embedded + [0.0, 0.0, 7.0], lifted)
    assert np.array_equal(bound, duct.clearance_bound(points))
    assert np.array_equal(bound, lifted)
    assert np.all(bound <= -duct.signed_distance(points))
    assert bound == pytest.approx(-duct.signed_distance(points), abs=1e-10)


@given(seed=st.integers(0, 10**6))
def test_two_vertices_swapped_are_found_out(seed):
    # In a convex polygon swapping two neighbours makes exactly the edges around them cross.
    random = np.random.default_rng(seed)
    count = int(random.integers(4, 40))
    angles = 2.0 * np.pi * np.arange(count) / count
    vertices = np.stack([3.0 * np.cos(angles), 2.0 * np.sin(angles)], axis=1)
    Polygon(vertices)
    k = int(random.integers(0, count))
    after = (k + 1) % count
    vertices[[k, after]] = vertices[[after, k]]
    before = (k - 1) % count
    first, second = sorted((before, after))
    with pytest.raises(GeometryError, match=f"edges {first} and {second} of the polygon"):
        Polygon(vertices)


def test_it_is_a_duct_with_two_dimensions():
    _, duct = random_star(1)
    assert isinstance(duct, Duct)
    assert (duct.kind, duct.error, duct.bounds.shape) == ("exact", 0.0, (2, 2))
    with pytest.raises(InputError, match=r"points has shape \(3,\): it must be \(\.\.\., 2\)"):
        duct.signed_distance([0.0, 0.0, 0.0])


def test_a_planar_way_becomes_a_centreline():
    duct = Polygon([(0, 0), (30, 0), (30, 30), (20, 30), (20, 10), (0, 10)])
    line = Centreline.from_points([(5, 5), (25, 5), (25, 25)], duct)
    assert line.points.shape[1] == 2
    assert line.length == pytest.approx(40.0)
    assert line.radius == pytest.approx(-duct.signed_distance(line.points))
    with pytest.raises(GeometryError, match="the way leaves the duct"):
        Centreline.from_points([(5, 5), (25, 25)], duct)
