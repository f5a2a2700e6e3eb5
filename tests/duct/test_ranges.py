"""What no duct takes: numbers out of range, things that are no ducts, and where nothing is left."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from bozzini.duct import (
    BetweenCurves,
    ConnectedCylinders,
    ConvexPolyhedra,
    Polygon,
    RoundCones,
    SampledField,
    TriangleMesh,
    union,
)
from bozzini.errors import GeometryError, InputError
from tests.motion.pipes import NAMES, make_pipes

CUBE = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
PLANES = np.column_stack([np.concatenate([np.eye(3), -np.eye(3)]), np.full(6, -1.0)])
CORNER = 10.0 * (2.0 - np.sqrt(2.0))
ELL = Polygon([(0, 0), (100, 0), (100, 10), (10, 10), (10, 100), (0, 100)])


def tube():
    return RoundCones([(0, 0, 0), (0, 0, 40)], [5.0, 5.0])


def field(**change):
    given = {
        "values": np.zeros((2, 2, 2), np.float32),
        "spacing": np.ones(3),
        "origin": np.zeros(3),
        "rotation": np.eye(3),
    }
    return SampledField(**{**given, **change})


@pytest.mark.parametrize("size", [1e300, 1e-300, 1e-320])
def test_normals_may_have_any_length(size):
    points = np.random.default_rng(0).uniform(-2.0, 3.0, (200, 3))
    ways = np.array([(0, 0, 1), (0, 0.3, 1)], dtype=float)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        long, unit = (
            ConnectedCylinders([(0, 0, 0), (0, 0, 9)], scale * ways, [1.0, 1.0])
            for scale in (size, 1.0)
        )
        # A number near the smallest has few digits.
        digits = 1e-2 if size < 1e-307 else 1e-12
        assert long.normals == pytest.approx(unit.normals, abs=digits)
        if size < 1e-307:
            return
        scaled = ConvexPolyhedra([PLANES * size])
    assert scaled.signed_distance(points) == pytest.approx(
        ConvexPolyhedra([PLANES]).signed_distance(points), abs=1e-12
    )


@pytest.mark.parametrize("name", NAMES)
def test_points_that_no_duct_is_asked_at(name):
    duct = make_pipes()[name]
    dim = duct.bounds.shape[1]
    for answer in (duct.signed_distance, duct.clearance_bound, duct.gradient):
        with pytest.raises(
            InputError, match=r"points\[0\] is 1e\+308 mm: it must lie in \[-1e\+09"
        ):
            answer(np.full(dim, 1e308))
        with pytest.raises(InputError, match="points must be an array of numbers"):
            answer(np.ones(dim, dtype=complex))
    far = np.full(dim, 1e9)
    assert np.isfinite(duct.gradient(far)).all() and duct.clearance_bound(far) < -1e8
    assert duct.signed_distance(np.empty((0, dim))).shape == (0,)


@pytest.mark.parametrize(
    ("make", "most", "place"),
    [
        # In the corner of the L: |x - c| = c - 10 from the inner corner, c = 10 (2 - sqrt(2)).
        (lambda: ELL, CORNER, (CORNER, CORNER)),
        (lambda: ELL.sample(1.0), CORNER, (CORNER, CORNER)),
        (lambda: union(tube(), RoundCones([(0, 0, 40), (0, 30, 40)], [5.0, 5.0])), 5.0, (0, 0, 20)),
        (lambda: TriangleMesh(CUBE, [
            (0, 1, 3), (0, 3, 2), (4, 7, 5), (4, 6, 7), (0, 5, 1), (0, 4, 5),
            (2, 3, 7), (2, 7, 6), (0, 6, 4), (0, 2, 6), (1, 5, 7), (1, 7, 3),
        ]), 0.5, (0.5, 0.5, 0.5)),
    ],
)  # fmt: skip
def test_erosion_that_leaves_nothing_is_refused(make, most, place):
    duct = make()
    slack = duct.error + 1e-3
    thin = duct.erode(most - 2.0 * slack)
    assert -4.0 * slack <= thin.signed_distance(place) <= 0.0
    box = 0.5 * float(np.ptp(duct.bounds, axis=0).min())
    if most + 2.0 * slack < box:
        with pytest.raises(GeometryError, match="nothing is left, the largest clearance found is"):
            duct.erode(most + 2.0 * slack)
    with pytest.raises(InputError, match="nothing is left of a duct whose box is"):
        duct.erode(2.0 * box)


@pytest.mark.parametrize("duct", [tube(), ELL], ids=["space", "plane"])
def test_a_sampled_duct_is_drawn_in_and_sampled_like_any(duct):
    first = duct.sample(1.0)
    again, thin = first.sample(0.7), first.erode(1.0)
    low, high = duct.bounds
    points = np.random.default_rng(0).uniform(low, high, (5000, len(low)))
    value = first.signed_distance(points)
    # The second field is sampled from the first, to be on the safe side by the first one's error.
    assert np.abs(again.signed_distance(points) - value - first.error).max() <= 3**0.5 * again.error
    assert np.all(again.clearance_bound(points) <= np.maximum(-duct.signed_distance(points), 0.0))
    assert thin.signed_distance(points) == pytest.approx(value + 1.0)
    assert np.all(thin.clearance_bound(points) <= -duct.signed_distance(points) - 1.0 + 1e-6)


def test_a_region_whose_error_is_estimated_says_so():
    def second(u):
        return np.stack([u, 10.0 - 8.0 * np.exp(-(((u - 3.3) / 1e-3) ** 2))], axis=1)

    def first(u):
        return np.stack([u, 0.0 * u], axis=1)

    duct = BetweenCurves(first, second, span=(0.0, 10.0))
    # Seven probes in a chord do not see a spike as thin: the bound is no proof.
    assert duct.clearance_bound((3.3, 3.0)) > 0.0
    assert duct.wall.endswith("error estimated")
    assert duct.inflate(1.0).wall == duct.wall
    assert "estimated" not in BetweenCurves(first, first_up, span=(0, 1), curvature=1.0).wall
    assert "estimated" not in BetweenCurves([(0, 0), (1, 0)], [(0, 1), (1, 1)]).wall


def first_up(u):
    return np.stack([u, 0.0 * u + 1.0], axis=1)
