"""Super-ellipses: a metric lower bound, exact circles, unions that hang together or are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import KDTree

from bozzini.duct import Circles, Duct, SuperEllipses
from bozzini.errors import GeometryError

SEEDS = st.integers(0, 10**6)


def random_shapes(seed, count=1):
    """Shapes of all powers, thin and round, turned; a chain whose neighbours hold each other."""
    random = np.random.default_rng(seed)
    half_axes = np.exp(random.uniform(np.log(0.5), np.log(20.0), (count, 2)))
    powers = random.choice([1.0, 2.0, 20.0, random.uniform(1.0, 20.0)], count)
    steps = random.normal(size=(count, 2))
    steps *= 0.5 * half_axes.min(axis=1)[:, None] / np.linalg.norm(steps, axis=1)[:, None]
    centres = random.uniform(-50.0, 50.0, 2) + np.cumsum(steps, axis=0)
    angles = random.uniform(-4.0, 4.0, count)
    return random, SuperEllipses(centres, half_axes, powers=powers, angles=angles, connected=False)


def single(half_axes, power, angle=0.0, centre=(0.0, 0.0)):
    return SuperEllipses([centre], [half_axes], powers=[power], angles=[angle])


def scatter(random, duct, count):
    low, high = duct.bounds
    return random.uniform(low - 0.3 * (high - low), high + 0.3 * (high - low), (count, 2))


def true_room(duct, points, count=4000):
    """Side by each gauge, and distance to the samples of the union's wall: never too small."""
    samples = [duct.outline(k, count=count) for k in range(len(duct.centres))]
    wall = []
    for k, line in enumerate(samples):
        others = np.delete(duct.evaluate_gauge(line), k, axis=1)
        wall.append(line[(others >= 1.0).all(axis=1)])
    inside = (duct.evaluate_gauge(points) < 1.0).any(axis=1)
    distance = KDTree(np.concatenate(wall)).query(points)[0]
    return np.where(inside, -distance, distance)


def outline_room(duct, points, count=4000):
    """Signed distance to a polygon in one shape, all but its sagittae."""
    line = duct.outline(0, count=count)
    nearest = KDTree(line).query(points)[1]
    best = np.full(len(points), np.inf)
    for other in (nearest - 1, (nearest + 1) % count):
        a, along = line[nearest], line[other] - line[nearest]
        t = np.sum((points - a) * along, axis=1) / np.sum(along * along, axis=1)
        foot = a + np.clip(t, 0.0, 1.0)[:, None] * along
        best = np.minimum(best, np.linalg.norm(points - foot, axis=1))
    return np.where(duct.evaluate_gauge(points)[:, 0] < 1.0, -best, best)


def test_a_hundred_thousand_points_are_on_the_right_side_and_never_too_deep():
    random, duct = random_shapes(3, 6)
    points = scatter(random, duct, 100_000)
    value, truth = duct.signed_distance(points), true_room(duct, points)
    sure = np.abs(value) > 1e-9
    assert np.array_equal(value[sure] < 0.0, truth[sure] < 0.0)
    assert np.all(np.abs(value) <= np.abs(truth) + 1e-9)
    # Outside it is only said to be negative or zero.
    assert np.all(duct.clearance_bound(points) <= np.maximum(-truth, 0.0))


@given(seed=SEEDS, count=st.integers(1, 5))
def test_no_promise_is_too_large(seed, count):
    random, duct = random_shapes(seed, count)
    points = scatter(random, duct, 300)
    value, truth = duct.signed_distance(points), true_room(duct, points, 1000)
    sure = np.abs(value) > 1e-9
    assert np.array_equal(value[sure] < 0.0, truth[sure] < 0.0)
    assert np.all(np.abs(value) <= np.abs(truth) + 1e-9)


@given(seed=SEEDS)
def test_the_value_changes_no_faster_than_the_point(seed):
    random, duct = random_shapes(seed, 3)
    a = scatter(random, duct, 200)
    b = a + random.normal(size=a.shape) * random.choice([1e-3, 0.3, 5.0], size=(200, 1))
    change = np.abs(duct.signed_distance(a) - duct.signed_distance(b))
    assert np.all(change <= np.linalg.norm(a - b, axis=1) + 1e-10)


@given(seed=SEEDS)
def test_the_gradient_is_the_slope_of_the_value(seed):
    random, duct = random_shapes(seed, 2)
    points = scatter(random, duct, 100)
    step = 1e-6
    slope = np.stack(
        [
            (duct.signed_distance(points + d) - duct.signed_distance(points - d)) / (2.0 * step)
            for d in step * np.eye(2)
        ],
        axis=-1,
    )
    off = np.linalg.norm(duct.gradient(points) - slope, axis=1)
    # Kinks (where another shape decides, at the corners of large powers) are few.
    assert np.mean(off < 1e-4) > 0.9


@given(seed=SEEDS)
def test_ellipses_with_equal_axes_are_circles(seed):
    random = np.random.default_rng(seed)
    centres, radii = random.uniform(-9.0, 9.0, (4, 2)), random.uniform(0.5, 5.0, 4)
    angles = random.uniform(-3.0, 3.0, 4)
    discs = Circles(centres, radii)
    duct = SuperEllipses(
        centres, radii[:, None] * [1, 1], powers=[2.0] * 4, angles=angles, connected=False
    )
    points = scatter(random, duct, 200)
    away = np.linalg.norm(points[:, None] - centres, axis=-1) - radii
    assert discs.signed_distance(points) == pytest.approx(away.min(axis=1), abs=1e-9)
    assert duct.signed_distance(points) == pytest.approx(away.min(axis=1), abs=1e-9)


@given(seed=SEEDS)
def test_the_gauge_brackets_the_distance(seed):
    # r |G - 1| <= |d| <= |y| |1 - 1 / G|: along the ray from the centre there is a wall.
    random, duct = random_shapes(seed, 1)
    points = scatter(random, duct, 200)
    gauge = duct.evaluate_gauge(points)[:, 0]
    truth = np.abs(true_room(duct, points, 8000))
    radial = np.linalg.norm(points - duct.centres[0], axis=1) * np.abs(1.0 - 1.0 / gauge)
    pitch = 2.0 * np.pi * duct.half_axes.max() / 8000 * 20
    assert np.all(duct.least_radii[0] * np.abs(gauge - 1.0) <= truth + 1e-9)
    assert np.all(truth <= radial + pitch)


@given(seed=SEEDS)
def test_least_radius_area_and_bounds_are_those_of_the_outline(seed):
    _, duct = random_shapes(seed, 1)
    line = duct.outline(0, count=20_000)
    least = np.linalg.norm(line - duct.centres[0], axis=1).min()
    assert duct.least_radii[0] == pytest.approx(least, rel=1e-3)
    x, y = (line - duct.centres[0]).T
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    assert duct.areas[0] == pytest.approx(area, rel=1e-2)
    pitch = np.linalg.norm(np.diff(line, axis=0), axis=1).max()
    assert np.stack([line.min(axis=0), line.max(axis=0)]) == pytest.approx(duct.bounds, abs=pitch)
    assert duct.signed_distance(duct.centres[0]) == pytest.approx(-duct.least_radii[0])


def test_powers_tend_to_a_rhomb_and_a_box():
    rhomb = single((4.0, 2.0), 1.0)
    assert rhomb.least_radii[0] == pytest.approx(4.0 * 2.0 / np.hypot(4.0, 2.0))
    assert rhomb.areas[0] == pytest.approx(2.0 * 4.0 * 2.0)
    box = single((4.0, 2.0), 20.0)
    assert box.areas[0] == pytest.approx(4.0 * 4.0 * 2.0, rel=0.01)
    assert box.signed_distance([0.0, 1.0]) == pytest.approx(-1.0)


@given(seed=SEEDS, amount=st.floats(0.01, 5.0))
def test_an_inflated_wall_never_promises_room_beyond_the_amount(seed, amount):
    random, duct = random_shapes(seed)
    wide = duct.inflate(amount)
    points = scatter(random, wide, 300)
    room = np.maximum(amount - outline_room(duct, points), 0.0)
    assert np.all(wide.clearance_bound(points) <= room + 1e-4 * duct.half_axes.max())
    inside = duct.signed_distance(points) < 0.0
    assert np.all(wide.signed_distance(points[inside]) < duct.signed_distance(points[inside]))
    assert np.all(wide.bounds[0] <= duct.bounds[0])


def test_inflated_circles_are_larger_circles():
    points = np.random.default_rng(0).uniform(-9.0, 9.0, (500, 2))
    one = single((3.0, 3.0), 2.0).inflate(1.5)
    assert one.signed_distance(points) == pytest.approx(np.linalg.norm(points, axis=1) - 4.5)


def test_the_seam_between_two_circles_is_known():
    # Two unit circles 1.6 apart: min() says depth 0.2 at the middle, the true seam is 0.6 wide.
    pair = SuperEllipses(
        [(0.0, 0.0), (1.6, 0.0)], [(1.0, 1.0)] * 2, powers=[2.0] * 2, angles=[0.0] * 2
    )
    assert pair.measure_seam(0, 1) == pytest.approx(0.2, abs=1e-6)
    assert pair.signed_distance([0.8, 0.0]) == pytest.approx(-0.2)
    assert pair.erode(0.199).signed_distance([0.8, 0.0]) == pytest.approx(-0.001)
    with pytest.raises(
        GeometryError, match=r"clearance is 0\.21 mm: .*shape 0 and shape 1.*0\.2 mm"
    ):
        pair.erode(0.21)


@given(seed=SEEDS)
def test_an_eroded_duct_has_the_clearance_everywhere(seed):
    random, duct = random_shapes(seed, 3)
    clearance = 0.4 * float(duct.least_radii.min())
    thin = duct.erode(clearance)
    points = scatter(random, duct, 300)
    kept = thin.signed_distance(points) <= 0.0
    assert np.all(true_room(duct, points, 2000)[kept] <= -clearance + 1e-9)


@given(seed=SEEDS)
def test_shapes_pulled_apart_are_found_out(seed):
    random = np.random.default_rng(seed)
    count = int(random.integers(2, 8))
    half_axes = random.uniform(2.0, 6.0, (count, 2))
    centres = np.cumsum(np.tile([1.5, 0.3], (count, 1)), axis=0)
    options = {"powers": random.uniform(1.0, 20.0, count), "angles": random.uniform(0, 3, count)}
    SuperEllipses(centres, half_axes, **options)
    k = int(random.integers(1, count))
    centres[k:] += 200.0
    with pytest.raises(GeometryError, match="the union is not connected"):
        SuperEllipses(centres, half_axes, **options)
    SuperEllipses(centres, half_axes, connected=False, **options)


def test_shapes_may_hang_together_out_of_order():
    SuperEllipses(
        [(0.0, 0.0), (8.0, 0.0), (4.0, 0.0)], [(3.0, 1.0)] * 3, powers=[2.0] * 3, angles=[0.0] * 3
    )


def test_it_is_a_planar_duct():
    _, duct = random_shapes(1, 2)
    assert isinstance(duct, Duct)
    assert (duct.kind, duct.error, duct.bounds.shape) == ("bound", 0.0, (2, 2))
    assert replace(duct, wall="colon").wall == "colon"


@given(seed=SEEDS)
def test_links_between_joints_outside_guarded_circles_stay_clear(seed):
    random = np.random.default_rng(seed)
    disc = Circles([(1.0, 2.0)], [random.uniform(0.2, 3.0)])
    length, body = random.uniform(0.1, 6.0), random.uniform(0.0, 1.0)
    guarded = disc.guard_links(length, radius=body)
    head = random.uniform(-9.0, 9.0, (400, 2))
    turn = random.uniform(0.0, 2.0 * np.pi, 400)
    tail = head + length * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    free = (guarded.signed_distance(head) >= 0.0) & (guarded.signed_distance(tail) >= 0.0)
    for share in np.linspace(0.0, 1.0, 11):
        between = head[free] + share * (tail - head)[free]
        assert np.all(disc.signed_distance(between) >= body - 1e-9)
