"""What no duct takes: numbers out of range, things that are no ducts, and where nothing is left."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from bozzini.duct import (
    BetweenCurves,
    Circles,
    ConnectedCylinders,
    ConvexPolyhedra,
    Eroded,
    Moved,
    PlanarField,
    PointCloud,
    Polygon,
    RoundCones,
    SampledField,
    StitchedQuads,
    SuperEllipses,
    SuperEllipsoids,
    TriangleMesh,
    union,
)
from bozzini.errors import GeometryError, InputError
from bozzini.thesis import ducts as forms
from tests.motion.pipes import NAMES, make_pipes

HUGE = 1e300
CUBE = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
PLANES = np.column_stack([np.concatenate([np.eye(3), -np.eye(3)]), np.full(6, -1.0)])
CORNER = 10.0 * (2.0 - np.sqrt(2.0))
ELL = Polygon([(0, 0), (100, 0), (100, 10), (10, 10), (10, 100), (0, 100)])


def tube():
    return RoundCones([(0, 0, 0), (0, 0, 40)], [5.0, 5.0])


def ellipse(half_axes=(5.0, 1.0)):
    return SuperEllipses([(0, 0)], [half_axes], powers=[2.0], angles=[0.0])


def ellipsoid(**change):
    given = {
        "centres": [(0, 0, 0)],
        "half_axes": [(1, 1, 1)],
        "e1": [1.0],
        "e2": [1.0],
        "rotations": [np.eye(3)],
    }
    return SuperEllipsoids(**{**given, **change})


def field(**change):
    given = {
        "values": np.zeros((2, 2, 2), np.float32),
        "spacing": np.ones(3),
        "origin": np.zeros(3),
        "rotation": np.eye(3),
    }
    return SampledField(**{**given, **change})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: RoundCones([(0, 0, HUGE)], [1.0]),
            r"centres\[0, 2\] is 1e\+300 mm: .*1e\+06\] mm",
        ),
        (lambda: RoundCones([(0, 0, 0)], [HUGE]), r"radii\[0\] is 1e\+300 mm: .*1e\+06\] mm"),
        (lambda: RoundCones([(0, 0, 0)], [1e-300]), r"radii\[0\] is 1e-300 mm: .*\[1e-06, "),
        (lambda: RoundCones([(0, 0, 0)], [1.0], inflation=HUGE), r"inflation is 1e\+300 mm"),
        (lambda: RoundCones(np.zeros((1, 3), complex), [1.0]), "centres must be an array of num"),
        (lambda: Circles([(0, HUGE)], [1.0]), r"centres\[0, 1\] is 1e\+300 mm"),
        (lambda: Polygon([(0, 0), (HUGE, 0), (0, 1)]), r"vertices\[1, 0\] is 1e\+300 mm"),
        (lambda: StitchedQuads([(0, 0), (2e6, 0)], [(0, 1), (1, 1)]), r"left\[1, 0\] is 2e\+06"),
        (lambda: BetweenCurves([(0, 0), (2e6, 0)], [(0, 1), (1, 1)]), r"first\[1, 0\] is 2e\+06"),
        (lambda: ellipse((1e-9, 1.0)), r"half axes\[0\] is \[1e-09, 1\.0\] mm: each must lie in"),
        (lambda: ellipsoid(half_axes=[(1, 2e6, 1)]), r"half axes\[0\] is .* each must lie in"),
        (lambda: ellipsoid(centres=[(0, 0, -HUGE)]), r"centres\[0, 2\] is -1e\+300 mm"),
        (lambda: TriangleMesh(CUBE * HUGE, [(0, 1, 2)]), r"vertices\[.\, .\] is 1e\+300 mm"),
        (lambda: PointCloud(CUBE, HUGE, seeds=[(0, 0, 0)]), r"spacing is 1e\+300 mm"),
        (lambda: PointCloud(CUBE, 1.0, seeds=[(HUGE, 0, 0)]), r"seeds\[0, 0\] is 1e\+300 mm"),
        (
            lambda: ConvexPolyhedra([PLANES * [1, 1, 1, HUGE]]),
            r"pieces\[0\]\[0\] is a plane 1e\+300",
        ),
        (lambda: ConvexPolyhedra([PLANES * [1e-305, 1, 1, 1]]), r"is a plane 1e\+305 mm from"),
        (lambda: ConvexPolyhedra([PLANES * [1, 1, 1, 1.5e6]]), r"piece 0 reaches to 1\.5e\+06 mm"),
        (lambda: ConvexPolyhedra(None), "pieces is a NoneType: it must be a sequence"),
        (lambda: ConvexPolyhedra("abc"), "pieces is a str: it must be a sequence"),
        (lambda: Moved(tube(), rotation=np.diag([1, 1, -1])), "reflection, its determinant is -1"),
        (lambda: Moved(tube(), rotation=np.eye(3) * HUGE), r"rotation is no rotation"),
        (lambda: field(origin=np.full(3, np.nan)), "field origin has 1 point"),
        (lambda: field(origin=np.zeros(2)), r"field origin has shape \(2,\)"),
        (lambda: field(spacing=np.full(3, np.inf)), "field spacing is .* three lengths in"),
        (lambda: field(spacing=[1.0, np.nan, 1.0]), "field spacing is .* three lengths in"),
        (lambda: field(values=np.zeros((2, 2, 2), int)), "field values are int64: they must be"),
        (lambda: field(values=[1.0]), "field values are list: they must be"),
        (lambda: field(reach=-1.0), "reach is -1 mm"),
        (lambda: PlanarField(3), "layer is a int: it must be a SampledField"),
        (lambda: PlanarField(tube().sample(2.0)), r"layer has values of shape .* two equal sheets"),
        (lambda: PlanarField(field(rotation=np.eye(3)[[0, 2, 1]])), "layer is tilted"),
    ],
)
def test_a_duct_out_of_range_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


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
    ("make", "message"),
    [
        (lambda: union(3), "part 0 is a int: it must be a duct"),
        (lambda: Eroded(3, 1.0), "duct is a int: it must be a duct"),
        (lambda: Moved("x"), "duct is a str: it must be a duct"),
        (lambda: Eroded("x", 1.0), "duct is a str: it must be a duct"),
        (lambda: tube().sample(0.5).inflate("a"), "distance is 'a'"),
        (lambda: ELL.sample(0.5).inflate("a"), "distance is 'a'"),
        (lambda: tube().sample(1e-300), r"voxel is 1e-300 mm: .* at least about 0\.023 mm"),
        (lambda: ellipse().outline(5), r"shape is 5: it must lie in \[0, 0\]"),
        (lambda: ellipse().outline(0, count=0), "count is 0"),
        (lambda: ellipse().measure_seam(0, 3), r"second is 3: it must lie in \[0, 0\]"),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_line(make, message):
    with warnings.catch_warnings(), pytest.raises(InputError, match=message) as caught:
        warnings.simplefilter("error")
        make()
    assert "\n" not in str(caught.value)


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


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda p: forms.circle_5_14(p, (0, 0), -1.0), "radius is -1 mm"),
        (lambda p: forms.circle_5_14(p, (0, 0), np.nan), "radius is nan"),
        (lambda p: forms.circle_5_14(p, np.zeros((3, 2)), 1.0), r"centre has shape \(3, 2\)"),
        (lambda p: forms.super_ellipse_5_16(p, (0, 0), (0, 1), 2.0), r"half axes\[0\] is"),
        (lambda p: forms.super_ellipse_5_16(p, (0, 0), (-1, 1), 2.0), r"half axes\[0\] is"),
        (lambda _: forms.frame_5_17(np.nan, (0, 0)), "angle is nan"),
        (lambda p: forms.to_shape(p, np.zeros((4, 4))), "rotation of the frame is no rotation"),
        (lambda p: forms.to_shape(p, np.eye(3)), r"frame has shape \(3, 3\): it must be \(4, 4\)"),
        (lambda p: forms.half_planes_5_20(p, [(0, 0)] * 2, [(0, 0)] * 2), "quad 0 has a side with"),
        (lambda p: forms.half_planes_5_20(p, [(0, 0), (1, 0)], [(2, 0), (4, 0)]), "no area"),
        (lambda _: forms.minimum_5_18([]), r"values have shape \(0,\)"),
        (
            lambda p: forms.solve_6_1(p, [(0, 0), (1, 0)], [(0, 1), (1, 1)]),
            r"point has shape \(1, 2\)",
        ),
    ],
)
def test_the_thesis_forms_take_no_nonsense(ask, message):
    with pytest.raises(InputError, match=message):
        ask([(0.5, 0.5)])


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
