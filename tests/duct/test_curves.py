"""Between two curves: the outline's error is kept, coordinates are found, folds are refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import KDTree

from bozzini.duct import BetweenCurves, Circles, Duct, Polygon, without
from bozzini.errors import InputError

SPAN = (0.0, 2.0 * np.pi)


def lower(u):
    return np.stack([u, np.sin(u)], axis=1)


def upper(u):
    return np.stack([u, np.sin(u + np.pi / 8.0) + 1.0], axis=1)


def sines(**options):
    """Thesis Fig. 5.21."""
    return BetweenCurves(lower, upper, **{"span": SPAN, **options})


def annulus(inner, outer, turn, **options):
    def circle(radius):
        return lambda u: radius * np.stack([np.cos(u), np.sin(u)], axis=1)

    return BetweenCurves(circle(inner), circle(outer), span=(0.0, turn), **options)


def arc_room(points, inner, outer, turn):
    """Exact signed distance to a sector of a ring, turn up to pi."""
    radius = np.linalg.norm(points, axis=1)
    angle = np.mod(np.arctan2(points[:, 1], points[:, 0]), 2.0 * np.pi)
    within = angle <= turn
    best = np.full(len(points), np.inf)
    for wall in (inner, outer):
        ends = [wall * np.array([np.cos(a), np.sin(a)]) for a in (0.0, turn)]
        off = [np.linalg.norm(points - end, axis=1) for end in ends]
        best = np.minimum(best, np.where(within, np.abs(radius - wall), np.minimum(*off)))
    for a in (0.0, turn):
        d = np.array([np.cos(a), np.sin(a)])
        s = np.clip(points @ d, inner, outer)
        best = np.minimum(best, np.linalg.norm(points - s[:, None] * d, axis=1))
    inside = within & (radius > inner) & (radius < outer)
    return np.where(inside, -best, best)


@pytest.mark.parametrize("tolerance", [0.3, 0.01, 0.001])
@pytest.mark.parametrize("known", [True, False])
def test_the_outline_is_off_by_no_more_than_it_says(tolerance, known):
    duct = annulus(3.0, 7.0, 2.5, tolerance=tolerance, curvature=7.0 if known else None)
    assert 0.0 < duct.error <= tolerance
    points = np.random.default_rng(0).uniform(-9.0, 9.0, (100_000, 2))
    truth = arc_room(points, 3.0, 7.0, 2.5)
    value = duct.signed_distance(points)
    worst = np.abs(value - truth).max()
    assert worst <= duct.error
    assert worst > 0.05 * duct.error
    assert np.all(duct.clearance_bound(points) <= -truth)


@given(seed=st.integers(0, 10**6))
def test_the_value_changes_no_faster_than_the_point(seed):
    random = np.random.default_rng(seed)
    a = random.uniform(-2.0, 8.0, (200, 2))
    b = a + random.normal(size=a.shape) * random.choice([1e-3, 0.3, 3.0], size=(200, 1))
    duct = sines()
    change = np.abs(duct.signed_distance(a) - duct.signed_distance(b))
    assert np.all(change <= np.linalg.norm(a - b, axis=1) + 1e-12)


def test_the_thesiss_curves_never_meet_and_half_the_share_is_not_half_the_width():
    # The least vertical gap is 1 - 2 sin(pi / 16); v = 1/2 is 0.707 to 0.98 of half of it away.
    u = np.linspace(*SPAN, 20_001)
    gap = (upper(u) - lower(u))[:, 1]
    assert gap.min() == pytest.approx(1.0 - 2.0 * np.sin(np.pi / 16.0), abs=1e-7)
    duct = sines(span=(-1.0, 7.5), tolerance=1e-4)
    middle = duct.locate(u[::20], np.full(1001, 0.5))
    share = -duct.signed_distance(middle) / (0.5 * gap[::20])
    assert 0.70 < share.min() < 0.72
    assert 0.97 < share.max() < 0.99


@given(seed=st.integers(0, 10**6))
def test_coordinates_and_points_are_each_others_inverse(seed):
    random = np.random.default_rng(seed)
    along, across = random.uniform(*SPAN, 100), random.uniform(0.0, 1.0, 100)
    duct = sines(tolerance=0.05)
    points = duct.locate(along, across)
    found = duct.coordinates(points)
    assert found.inside.all()
    assert found.along == pytest.approx(along, abs=1e-8)
    assert found.across == pytest.approx(across, abs=1e-8)
    # With both x = u the solution is known in closed form.
    x, y = points.T
    assert found.across == pytest.approx(
        (y - np.sin(x)) / (np.sin(x + np.pi / 8.0) - np.sin(x) + 1.0), abs=1e-8
    )


def test_coordinates_are_found_where_the_outline_cuts_the_region_off():
    duct = annulus(3.0, 7.0, 2.5, tolerance=0.3)
    u = 0.5 * (duct.parameters[:-1] + duct.parameters[1:])
    points = duct.locate(u, np.full(len(u), 0.9999))  # beyond the chords of the outer circle
    assert np.all(duct.signed_distance(points) > 0.0)
    found = duct.coordinates(points)
    assert found.inside.all()
    assert found.along == pytest.approx(u, abs=1e-8)
    outside = duct.coordinates([[0.0, 0.0], [8.0, 0.0]])
    assert not outside.inside.any() and np.isnan(outside.across).all()


def test_coordinates_do_not_depend_on_the_inflation():
    plain, wide = sines(), sines(inflation=0.5)
    points = np.random.default_rng(1).uniform((0.0, -1.5), (6.0, 2.5), (300, 2))
    a, b = plain.coordinates(points), wide.coordinates(points)
    assert np.array_equal(a.inside, b.inside)
    assert np.array_equal(a.along, b.along, equal_nan=True)


def test_samples_are_taken_as_the_wall_itself():
    u = np.linspace(*SPAN, 40)
    duct = BetweenCurves(lower(u), upper(u), span=SPAN)
    outline = Polygon(np.concatenate([lower(u), upper(u)[::-1]]))
    points = np.random.default_rng(2).uniform(-2.0, 8.0, (2000, 2))
    assert (duct.kind, duct.error) == ("exact", 0.0)
    assert np.array_equal(duct.signed_distance(points), outline.signed_distance(points))
    found = duct.coordinates(points)
    assert np.array_equal(found.inside, duct.signed_distance(points) <= 0.0)
    back = duct.locate(found.along[found.inside], found.across[found.inside])
    assert back == pytest.approx(points[found.inside], abs=1e-9)


def test_finer_samples_come_nearer_to_the_curves():
    fine = np.linspace(*SPAN, 200_001)
    wall = KDTree(np.concatenate([lower(fine), upper(fine)]))
    errors = []
    for tolerance in (0.1, 0.025, 0.00625):
        duct = sines(tolerance=tolerance)
        corners = np.concatenate([duct.quads.left, duct.quads.right])
        assert wall.query(corners)[0].max() < 1e-4
        errors.append(duct.error)
    assert errors[0] > errors[1] > errors[2]


def test_it_is_a_planar_duct():
    duct = sines()
    assert isinstance(duct, Duct)
    assert (duct.kind, duct.bounds.shape) == ("sampled", (2, 2))
    assert duct.inflate(0.2).signed_distance([3.0, 1.0]) == pytest.approx(
        duct.signed_distance([3.0, 1.0]) - 0.2
    )


def test_among_shapes_the_error_is_taken_off():
    duct = annulus(3.0, 7.0, 2.5, tolerance=0.3)
    cut = without(duct, Circles([(0.0, 5.0)], [0.5]))
    points = np.random.default_rng(0).uniform(-9.0, 9.0, (20_000, 2))
    wanted = duct.signed_distance(points) + duct.error
    wanted = np.maximum(wanted, 0.5 - np.linalg.norm(points - [0.0, 5.0], axis=1))
    assert (cut.kind, cut.error) == ("bound", 0.0)
    assert cut.signed_distance(points) == pytest.approx(wanted, abs=1e-9)
    room = -arc_room(points, 3.0, 7.0, 2.5)
    inside = cut.signed_distance(points) < 0.0
    assert np.all(-cut.signed_distance(points)[inside] <= room[inside])
    with pytest.raises(InputError, match="obstacle 0 is sampled"):
        without(Circles([(0.0, 0.0)], [20.0]), duct)
