"""Stitched quads: the exact outline, the inverse of the bilinear map, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.duct import Duct, Polygon, StitchedQuads
from bozzini.duct.shapes.quads import invert_quads
from bozzini.errors import GeometryError

SEEDS = st.integers(0, 10**6)


def random_strip(seed, count=None):
    """Quads along a winding way of random widths; the way never bends enough to fold."""
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 12)) if count is None else count
    heading = np.cumsum(random.uniform(-0.25, 0.25, count + 1))
    way = np.cumsum(6.0 * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
    across = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    left = way + random.uniform(1.0, 6.0, (count + 1, 1)) * across
    right = way - random.uniform(1.0, 6.0, (count + 1, 1)) * across
    return random, StitchedQuads(left, right)


def in_convex(corners, points):
    """Which points are in a convex polygon, by its half planes."""
    sides = np.roll(corners, -1, axis=0) - corners
    away = points[:, None] - corners
    turns = sides[:, 0] * away[..., 1] - sides[:, 1] * away[..., 0]
    return (turns >= 0.0).all(axis=1) | (turns <= 0.0).all(axis=1)


def wall_distance(vertices, points):
    best = np.full(len(points), np.inf)
    for a, b in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        u = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - a - u[:, None] * (b - a), axis=1))
    return best


def scatter(random, duct, count):
    low, high = duct.bounds
    return random.uniform(low - 5.0, high + 5.0, (count, 2))


def quad_corners(duct, k):
    return np.stack([duct.left[k], duct.left[k + 1], duct.right[k + 1], duct.right[k]])


@given(seed=SEEDS)
def test_side_and_distance_agree_with_the_quads_one_by_one(seed):
    random, duct = random_strip(seed)
    points = scatter(random, duct, 300)
    value = duct.signed_distance(points)
    held = [in_convex(quad_corners(duct, k), points) for k in range(len(duct.left) - 1)]
    inside = np.any(held, axis=0)
    sure = np.abs(value) > 1e-9
    assert np.array_equal(value[sure] < 0.0, inside[sure])
    corners = np.concatenate([duct.left, duct.right[::-1]])
    assert np.abs(value) == pytest.approx(wall_distance(corners, points), abs=1e-9)


@pytest.mark.slow
def test_a_hundred_thousand_points_agree_with_the_quads():
    random, duct = random_strip(7, 10)
    points = scatter(random, duct, 100_000)
    value = duct.signed_distance(points)
    held = [in_convex(quad_corners(duct, k), points) for k in range(10)]
    assert np.array_equal(value < 0.0, np.any(held, axis=0))
    corners = np.concatenate([duct.left, duct.right[::-1]])
    assert np.abs(np.abs(value) - wall_distance(corners, points)).max() < 1e-9
    found = duct.coordinates(points)
    assert np.array_equal(found.quad >= 0, value <= 0.0)


@given(seed=SEEDS)
def test_coordinates_and_points_are_each_others_inverse(seed):
    random, duct = random_strip(seed)
    quad = random.integers(0, len(duct.left) - 1, 200)
    along, across = random.uniform(0.0, 1.0, (2, 200))
    points = duct.locate(quad, along, across=across)
    found = duct.coordinates(points)
    assert np.array_equal(found.quad, quad)
    assert found.along == pytest.approx(along, abs=1e-9)
    assert found.across == pytest.approx(across, abs=1e-9)
    assert np.all(duct.signed_distance(points) <= 1e-9)


@given(seed=SEEDS)
def test_the_discriminant_is_the_square_of_the_jacobian(seed):
    random, duct = random_strip(seed)
    quad = random.integers(0, len(duct.left) - 1, 50)
    along, across = random.uniform(0.05, 0.95, (2, 50))
    step = 1e-5
    ds = duct.locate(quad, along + step, across=across) - duct.locate(
        quad, along - step, across=across
    )
    dv = duct.locate(quad, along, across=across + step) - duct.locate(
        quad, along, across=across - step
    )
    jacobian = (ds[:, 0] * dv[:, 1] - ds[:, 1] * dv[:, 0]) / (4.0 * step**2)
    found = duct.coordinates(duct.locate(quad, along, across=across))
    assert found.discriminant == pytest.approx(jacobian**2, rel=1e-6)


@given(seed=SEEDS)
def test_both_solutions_solve_the_bilinear_map_complex_ones_too(seed):
    random = np.random.default_rng(seed)
    p, q = random.uniform(-9.0, 9.0, (2, 2)), random.uniform(-9.0, 9.0, (2, 2))
    x = random.uniform(-20.0, 20.0, (20, 2))
    s, v, _ = invert_quads(p, q, x)
    s, v = s[:, 0, :, None], v[:, 0, :, None]
    back = (1 - v) * ((1 - s) * p[0] + s * p[1]) + v * ((1 - s) * q[0] + s * q[1])
    assert np.abs(back - x[:, None]).max() < 1e-6 * (1.0 + np.abs(s).max() * np.abs(v).max())


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ([(0, 1), (4, 1)], [(0, -1), (4, -1)]),  # a rectangle: A = 0
        ([(0, 1), (4, 1)], [(-1, -1), (5, -1)]),  # a trapezium: walls parallel
        ([(0, 1), (4, 3)], [(0, -1), (4, -3)]),  # rungs parallel
    ],
)
def test_parallel_sides_have_one_solution(left, right):
    duct = StitchedQuads(left, right)
    along, across = np.meshgrid([0.0, 0.3, 1.0], [0.0, 0.7, 1.0])
    found = duct.coordinates(duct.locate(np.zeros((3, 3), dtype=int), along, across=across))
    assert np.all(found.quad == 0)
    assert found.along == pytest.approx(along, abs=1e-12)
    assert found.across == pytest.approx(across, abs=1e-12)


def test_outside_there_are_no_coordinates():
    duct = StitchedQuads([(0, 1), (4, 1)], [(0, -1), (4, -1)])
    found = duct.coordinates([[2.0, 0.5], [2.0, 1.5]])
    assert found.quad.tolist() == [0, -1]
    assert (
        np.isnan(found.along[1]) and np.isnan(found.across[1]) and np.isnan(found.discriminant[1])
    )


def test_a_share_of_the_width_is_no_clearance():
    # The thesis's margin of 1/4 in v: 0.25 mm at the narrow end, 2 mm at the wide one.
    duct = StitchedQuads([(0, 0.5), (20, 4)], [(0, -0.5), (20, -4)])
    narrow, wide = duct.locate([0, 0], [0.1, 0.8], across=[0.25, 0.25])
    assert -duct.signed_distance(narrow) < 0.5 < 1.2 < -duct.signed_distance(wide)


@given(seed=SEEDS, amount=st.floats(0.01, 4.0))
def test_eroded_and_inflated_move_the_wall_by_the_amount(seed, amount):
    random, duct = random_strip(seed)
    points = scatter(random, duct, 100)
    value = duct.signed_distance(points)
    assert duct.inflate(amount).signed_distance(points) == pytest.approx(value - amount)
    thin = min(amount, max(-0.9 * float(value.min()), 0.0))
    assert duct.erode(thin).signed_distance(points) == pytest.approx(value + thin)
    assert duct.inflate(amount).kind == "bound"


def test_it_is_a_planar_duct_and_the_same_as_its_outline():
    random, duct = random_strip(5)
    assert isinstance(duct, Duct)
    assert (duct.kind, duct.error, duct.bounds.shape) == ("exact", 0.0, (2, 2))
    outline = Polygon(np.concatenate([duct.left, duct.right[::-1]]))
    points = scatter(random, duct, 100)
    assert np.array_equal(duct.signed_distance(points), outline.signed_distance(points))
    assert np.array_equal(duct.gradient(points), outline.gradient(points))


def test_a_duct_that_runs_into_itself_is_refused_with_the_quads():
    turn = np.linspace(0.0, 2.1 * np.pi, 22)
    way = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    with pytest.raises(GeometryError, match="quads 0 and (19|20) overlap or touch"):
        StitchedQuads(8.0 * way, 12.0 * way)
    StitchedQuads(8.0 * way[:20], 12.0 * way[:20])
