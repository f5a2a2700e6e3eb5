"""The family's kernels: culling changes nothing, every kind answers as its duct, inflation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.duct import (
    Circles,
    ConnectedCylinders,
    ConvexPolyhedra,
    Polygon,
    RoundCones,
    StitchedQuads,
    SuperEllipses,
    SuperEllipsoids,
    union,
    without,
)
from bozzini.duct.kernels import shapes as kernels
from bozzini.duct.search import find_least

SEEDS = st.integers(0, 10**6)


def random_ducts(seed):
    """One duct of every kind that the family knows."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 6))
    way = np.cumsum(random.uniform(0.5, 2.0, (n, 2)), axis=0)
    line = np.cumsum([[3.0, 0, 0]] * n + random.uniform(-0.4, 0.4, (n, 3)), axis=0)
    turns = np.linalg.qr(random.normal(size=(n, 3, 3)))[0]
    turns *= np.sign(np.linalg.det(turns))[:, None, None]
    sizes = random.uniform(3.0, 5.0, (n, 3))
    planar = [
        SuperEllipses(
            way, sizes[:, :2], powers=random.uniform(1, 20, n), angles=random.uniform(-3, 3, n)
        ),
        Circles(way, sizes[:, 0]),
        Polygon([(0, 0), (6, 0), (6, 3), (2, 3), (2, 6), (0, 6)]),
        StitchedQuads([(0, 1), (5, 2)], [(0, -2), (5, -1)]),
    ]
    solid = [
        SuperEllipsoids(
            line,
            sizes,
            e1=random.uniform(0.1, 2.0, n),
            e2=random.uniform(0.1, 2.0, n),
            rotations=turns,
        ),
        ConnectedCylinders(
            line, normals=np.tile([1.0, 0, 0], (n, 1)), radii=random.uniform(0.5, 1.0, n)
        ),
        ConvexPolyhedra.from_points([random.uniform(-4.0, 4.0, (12, 3))]),
        RoundCones(line, random.uniform(0.5, 3.0, n)),
    ]
    return random, planar, solid


def scatter(random, duct, count):
    low, high = duct.bounds
    return random.uniform(low - 8.0, high + 8.0, (count, len(low)))


def one_by_one(shapes, points):
    """The value without culling: every shape and every ball at every point."""
    flat = np.zeros((len(points), 3))
    flat[:, : points.shape[1]] = points
    values = np.empty((len(points), len(shapes.kinds)))
    for k, (kind, first) in enumerate(zip(shapes.kinds, shapes.first, strict=True)):
        own = [kernels.shape_value(kind, shapes.params, first, *p) for p in flat]
        ball = np.linalg.norm(flat - shapes.boxes[k, :3], axis=1) - shapes.boxes[k, 3]
        values[:, k] = np.maximum(own, ball) - shapes.offsets[k]
    best = values[:, ~shapes.obstacles].min(axis=1)
    if shapes.obstacles.any():
        best = np.maximum(best, (-values[:, shapes.obstacles]).max(axis=1))
    return best


@pytest.mark.slow
@given(seed=SEEDS)
def test_passing_over_far_shapes_changes_nothing(seed):
    random, planar, solid = random_ducts(seed)
    for parts in (planar, solid):
        lumen, obstacles = parts[:3], [part.erode(0.3) for part in parts[3:]]
        duct = without(union(*lumen, connected=False).erode(0.2), *obstacles)
        shapes = duct.family_shapes
        assert shapes is not None
        points = scatter(random, duct, 40)
        assert duct.signed_distance(points) == pytest.approx(one_by_one(shapes, points), abs=1e-9)


@pytest.mark.slow
@given(seed=SEEDS, amount=st.floats(0.0, 2.0))
def test_every_kind_is_the_same_alone_and_in_a_union(seed, amount):
    random, planar, solid = random_ducts(seed)
    for part in planar + solid:
        wide = part.inflate(amount)
        points = scatter(random, wide, 40)
        joined = union(wide)
        assert joined.family_shapes is not None
        assert joined.signed_distance(points) == pytest.approx(
            wide.signed_distance(points), abs=1e-7
        )
        assert joined.gradient(points) == pytest.approx(wide.gradient(points), abs=1e-5)
        assert np.all(joined.clearance_bound(points) <= -wide.signed_distance(points) + 1e-7)


@given(seed=SEEDS)
def test_every_kind_is_1_lipschitz_alone_and_inflated(seed):
    random, planar, solid = random_ducts(seed)
    for part in planar + solid:
        for duct in (part, part.inflate(1.3)):
            a = scatter(random, duct, 60)
            b = a + random.normal(size=a.shape) * random.choice([1e-3, 0.3, 5.0], size=(60, 1))
            change = np.abs(duct.signed_distance(a) - duct.signed_distance(b))
            assert np.all(change <= np.linalg.norm(a - b, axis=1) * (1.0 + 1e-9) + 1e-6)


@settings(max_examples=12)
@given(seed=SEEDS, amount=st.floats(0.1, 2.0))
def test_inflation_never_says_there_is_room_beyond_it(seed, amount):
    # Points at least the amount away from all of the lumen: far from every one of its samples
    # by more than that and the samples' pitch.
    random, planar, solid = random_ducts(seed)
    for part in planar + solid:
        wide = part.inflate(amount)
        points = scatter(random, wide, 40)
        low, high = part.bounds
        pitch = 0.35
        axes = [np.arange(a, b + pitch, pitch) for a, b in zip(low, high, strict=True)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(low))
        # A node farther from the lumen than its cell's half diagonal has none in its cell.
        half = 0.5 * pitch * np.sqrt(len(low)) + 1e-9
        held = nodes[part.signed_distance(nodes) <= half]
        beyond = np.array([np.linalg.norm(held - p, axis=1).min() - half > amount for p in points])
        assert np.all(wide.signed_distance(points[beyond]) >= 0.0)


def test_shapes_of_other_ducts_are_not_made_up():
    assert RoundCones([(0, 0, 0)], [1.0]).sample(0.5).family_shapes is None


@given(seed=SEEDS)
def test_the_least_value_is_bracketed(seed):
    random = np.random.default_rng(seed)
    dim = int(random.integers(1, 4))
    centres = random.uniform(-2.0, 2.0, (2, dim))

    def larger(points):
        return np.max([np.linalg.norm(points - c, axis=1) for c in centres], axis=0)

    box = np.full(dim, 3.0)
    found = find_least(larger, -box, box, tolerance=1e-4)
    half = 0.5 * np.linalg.norm(centres[1] - centres[0])
    assert found.bound <= half + 1e-12 <= found.value + 1e-11
    assert found.value - half <= 1e-4
    early = find_least(larger, -box, box, tolerance=1e-9, enough=half + 0.5)
    assert early.value <= half + 0.5
    none = find_least(larger, -box, box, tolerance=1e-9, enough=0.9 * half - 0.01)
    assert none.bound > 0.9 * half - 0.01
