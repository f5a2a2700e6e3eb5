"""Convex polyhedra: exact inside, a bound outside, and what the printed forms get wrong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.duct.base import Duct
from bozzini.duct.shapes.polyhedron import ConvexPolyhedra


def draw(seed, count=None):
    """Hulls of clouds that overlap in a row."""
    random = np.random.default_rng(seed)
    count = count or int(random.integers(1, 5))
    groups = [random.normal(size=(20, 3)) * 3.0 + [2.0 * k, 0.0, 0.0] for k in range(count)]
    return random, groups, ConvexPolyhedra.from_points(groups)


def box(low, high):
    """The planes of a box, normals of length 2."""
    eye = np.eye(3)
    return np.concatenate(
        [np.c_[2.0 * eye, -2.0 * np.array(high)], np.c_[-2.0 * eye, 2.0 * np.array(low)]]
    )


def scatter(random, duct, count):
    low, high = duct.bounds
    return random.uniform(low - 3.0, high + 3.0, (count, 3))


def test_a_box_is_exact_inside_and_a_bound_outside():
    duct = ConvexPolyhedra([box((-1, -2, -3), (1, 2, 3))])
    points = scatter(np.random.default_rng(0), duct, 100_000)
    over = np.abs(points) - [1.0, 2.0, 3.0]
    exact = np.linalg.norm(np.maximum(over, 0.0), axis=1) + np.minimum(over.max(axis=1), 0.0)
    value = duct.signed_distance(points)
    inside = exact < 0.0
    assert value[inside] == pytest.approx(exact[inside], abs=1e-9)
    assert np.array_equal(value < 0.0, inside)
    assert np.all(value[~inside] <= exact[~inside] + 1e-12)
    assert duct.bounds == pytest.approx(np.array([[-1, -2, -3], [1, 2, 3]]), abs=1e-12)


@given(seed=st.integers(0, 10**6))
def test_inside_one_hull_the_depth_is_the_distance_to_its_faces(seed):
    from scipy.spatial import ConvexHull

    random, groups, duct = draw(seed, count=1)
    hull = ConvexHull(groups[0])
    points = scatter(random, duct, 200)
    value = duct.signed_distance(points)
    corners = groups[0][hull.simplices]
    share = random.dirichlet(np.ones(3), (len(corners), 50))
    wall = np.einsum("fsk,fkd->fsd", share, corners).reshape(-1, 3)
    near = np.linalg.norm(points[:, None] - wall, axis=-1).min(axis=1)
    assert np.all(np.abs(value) <= near + 1e-9)
    # And it is reached: the foot on the deciding plane lies on the wall.
    inside = value < 0.0
    foot = points[inside] - value[inside][:, None] * duct.gradient(points[inside])
    assert np.abs(duct.signed_distance(foot)).max(initial=0.0) < 1e-9


@settings(max_examples=8)
@given(seed=st.integers(0, 10**6))
def test_sign_is_that_of_the_triangulated_groups(seed):
    from scipy.spatial import Delaunay

    random, groups, duct = draw(seed)
    points = scatter(random, duct, 400)
    inside = np.any([Delaunay(group).find_simplex(points) >= 0 for group in groups], axis=0)
    value = duct.signed_distance(points)
    clear = np.abs(value) > 1e-9
    assert np.array_equal((value < 0.0)[clear], inside[clear])


@given(seed=st.integers(0, 10**6))
def test_distance_changes_no_faster_than_the_point_and_has_room(seed):
    random, _, duct = draw(seed)
    a = scatter(random, duct, 200)
    b = a + random.normal(size=a.shape) * random.choice([1e-3, 0.5], (200, 1))
    value = duct.signed_distance(a)
    change = np.abs(duct.signed_distance(b) - value)
    assert np.all(change <= np.linalg.norm(a - b, axis=1) + 1e-11)
    room = duct.clearance_bound(a)
    turn = random.normal(size=(60, 1, 3))
    turn /= np.linalg.norm(turn, axis=-1, keepdims=True)
    around = a[room > 0.0] + room[room > 0.0][:, None] * turn
    assert np.all(duct.signed_distance(around) <= 1e-12)


def test_bounds_are_those_of_the_points():
    _, groups, duct = draw(4, count=3)
    points = np.concatenate(groups)
    assert duct.bounds == pytest.approx(np.stack([points.min(axis=0), points.max(axis=0)]))


def test_planes_and_points_make_the_same():
    corners = np.array(np.meshgrid([-1, 1], [-2, 2], [0, 5], indexing="ij")).reshape(3, -1).T
    hull = ConvexPolyhedra.from_points([corners])
    planes = ConvexPolyhedra([box((-1, -2, 0), (1, 2, 5))])
    points = scatter(np.random.default_rng(1), hull, 300)
    assert hull.signed_distance(points) == pytest.approx(planes.signed_distance(points), abs=1e-12)
    # Each face of the box is two triangles of the hull, and one plane here.
    assert len(hull.pieces[0]) == 6


def test_it_is_a_duct():
    _, _, duct = draw(1)
    assert isinstance(duct, Duct)
    assert (duct.kind, duct.error) == ("bound", 0.0)
