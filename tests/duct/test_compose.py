"""Ducts made of ducts: shapes and parts answer alike, obstacles, frames, sampling, refusals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bozzini.duct import (
    Circles,
    Duct,
    Eroded,
    Moved,
    PlanarField,
    Polygon,
    RoundCones,
    SampledField,
    StitchedQuads,
    SuperEllipses,
    SuperEllipsoids,
    union,
    without,
)
from bozzini.errors import GeometryError, InputError

SEEDS = st.integers(0, 10**6)


@dataclass(frozen=True, eq=False)
class Opaque(Duct):
    """Any duct: nothing is known of it but the distance that NumPy gives."""

    inner: Duct
    kind: str = "bound"
    error: float = 0.0
    wall: str = "opaque"

    @property
    def bounds(self):
        return self.inner.bounds

    def signed_distance(self, points):
        return self.inner.signed_distance(points)

    def gradient(self, points):
        return self.inner.gradient(points)


def capsule(start=(0.0, 0.0, 0.0), stop=(10.0, 0.0, 0.0), radius=3.0):
    return RoundCones([start, stop], [radius, radius])


def strip():
    return StitchedQuads([(0, 2), (10, 3), (20, 2)], [(0, -2), (10, -1), (20, -2)])


def planar_parts():
    discs = Circles([(18.0, 0.0), (21.0, 2.0)], [3.0, 2.0])
    ovals = SuperEllipses(
        [(24.0, 2.0), (27.0, 5.0)], [(4.0, 2.0), (3.0, 3.0)], powers=[2.0, 6.0], angles=[0.5, 1.0]
    )
    room = Polygon([(26, 4), (40, 4), (40, 12), (35, 12), (35, 7), (26, 7)])
    return strip(), discs, ovals, room


def solid_parts():
    egg = SuperEllipsoids(
        [(12.0, 0.0, 0.0)],
        [(4.0, 3.0, 2.0)],
        e1=[0.7],
        e2=[1.2],
        rotations=Rotation.from_rotvec([[0.3, 0.2, -0.4]]).as_matrix(),
    )
    return capsule(), egg


def scatter(random, duct, count):
    low, high = duct.bounds
    return random.uniform(low - 4.0, high + 4.0, (count, len(low)))


@pytest.mark.parametrize("parts", [planar_parts(), solid_parts()], ids=["planar", "solid"])
@given(seed=SEEDS)
def test_a_union_is_the_least_of_its_parts_as_shapes_and_as_parts(parts, seed):
    random = np.random.default_rng(seed)
    shapes = union(*parts)
    opaque = union(*(Opaque(part) for part in parts), connected=False)
    points = scatter(random, shapes, 200)
    wanted = np.min([part.signed_distance(points) for part in parts], axis=0)
    assert shapes.signed_distance(points) == pytest.approx(wanted, abs=1e-9)
    assert opaque.signed_distance(points) == pytest.approx(wanted, abs=1e-12)
    assert opaque.gradient(points) == pytest.approx(shapes.gradient(points), abs=1e-6)
    assert np.all(shapes.clearance_bound(points) <= -wanted)
    assert np.all(opaque.clearance_bound(points) <= -wanted)
    assert shapes.clearance_bound(points) == pytest.approx(-wanted, abs=1e-9)


@given(seed=SEEDS)
def test_obstacles_are_taken_away_as_shapes_and_as_parts(seed):
    random = np.random.default_rng(seed)
    duct = strip()
    disc = Circles(random.uniform((2, -1), (18, 1), (3, 2)), random.uniform(0.2, 1.5, 3))
    oval = SuperEllipses([(5.0, 0.0)], [(0.5, 1.5)], powers=[4.0], angles=[random.uniform(0, 3)])
    shapes = without(duct, disc, oval)
    opaque = without(Opaque(duct), Opaque(disc), Opaque(oval))
    points = scatter(random, duct, 300)
    wanted = np.maximum(
        duct.signed_distance(points),
        np.maximum(-disc.signed_distance(points), -oval.signed_distance(points)),
    )
    assert shapes.signed_distance(points) == pytest.approx(wanted, abs=1e-9)
    assert opaque.signed_distance(points) == pytest.approx(wanted, abs=1e-12)
    assert opaque.gradient(points) == pytest.approx(shapes.gradient(points), abs=1e-6)
    inside = wanted < 0.0
    assert not np.any(inside & (disc.signed_distance(points) < 0.0))
    assert np.all(opaque.clearance_bound(points) <= -wanted)


@given(seed=SEEDS)
def test_what_is_left_has_the_room_it_says(seed):
    # Against the distance to all walls, sampled.
    random = np.random.default_rng(seed)
    duct = without(strip(), Circles([(7.0, 1.0), (13.0, 0.5)], [1.0, 0.7]))
    turn = np.linspace(0.0, 2.0 * np.pi, 1001)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rim = [c + r * ring for c, r in zip(((7.0, 1.0), (13.0, 0.5)), (1.0, 0.7), strict=True)]
    points = scatter(random, duct, 200)
    to_rim = np.linalg.norm(points[:, None] - np.concatenate(rim), axis=-1).min(axis=1)
    room = np.minimum(-strip().signed_distance(points), to_rim)
    value = duct.signed_distance(points)
    assert np.all(-value[value < 0.0] <= room[value < 0.0] + 1e-9)
    assert -value[value < 0.0] == pytest.approx(room[value < 0.0], abs=np.pi / 1000)


@pytest.mark.parametrize("dim", [2, 3])
@given(seed=SEEDS)
def test_a_moved_duct_is_the_same_elsewhere(dim, seed):
    random = np.random.default_rng(seed)
    parts = planar_parts() if dim == 2 else solid_parts()
    if dim == 2:
        a = random.uniform(-3.0, 3.0)
        rotation = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    else:
        rotation = Rotation.random(random_state=seed).as_matrix()
    shift = random.uniform(-50.0, 50.0, dim)
    duct = union(*parts)
    moved = Moved(duct, rotation=rotation, shift=shift)
    points = scatter(random, duct, 100)
    there = points @ rotation.T + shift
    assert moved.signed_distance(there) == pytest.approx(duct.signed_distance(points), abs=1e-9)
    assert moved.gradient(there) == pytest.approx(duct.gradient(points) @ rotation.T, abs=1e-6)
    assert np.all(moved.clearance_bound(there) <= -duct.signed_distance(points))
    assert moved.to_world(moved.to_grid(there)) == pytest.approx(there, abs=1e-9)
    low, high = moved.bounds
    inside = moved.signed_distance(there) < 0.0
    assert np.all((there[inside] >= low) & (there[inside] <= high))
    # In a union its shapes are moved one by one, as kernels see all parts in one frame.
    again = union(moved, connected=False)
    assert again.family_shapes is not None
    assert again.signed_distance(there) == pytest.approx(duct.signed_distance(points), abs=1e-9)


def test_parts_of_all_solid_kinds_can_be_moved_or_are_sampled():
    from bozzini.duct import ConnectedCylinders, ConvexPolyhedra

    turn = {"rotation": Rotation.from_rotvec([0.5, -0.2, 0.9]).as_matrix(), "shift": [5.0, 6.0, 7]}
    random = np.random.default_rng(0)
    box = ConvexPolyhedra.from_points([random.uniform(-4.0, 4.0, (12, 3))])
    bend = ConnectedCylinders(
        [(0.0, 0, 0), (4.0, 0, 0)], normals=[(1.0, 0, 0), (1.0, 0.2, 0)], radii=[2.0, 1.5]
    )
    for part, known in ((box, True), (bend, False)):
        moved = Moved(part, **turn)
        points = scatter(random, moved, 300)
        joined = union(moved, voxel=0.5)
        assert (joined.family_shapes is not None) == known
        off = joined.signed_distance(points) - moved.signed_distance(points)
        assert np.abs(off).max() < 1e-9


@cache
def make_whole(kind):
    """A union in the plane, one in space, and a mesh; compiled when a test asks for it."""
    return {
        "planar": lambda: union(*planar_parts()),
        "solid": lambda: union(*solid_parts()),
        "strip": strip,
    }[kind]()


@pytest.mark.parametrize("kind", ["planar", "solid", "strip"])
@given(seed=SEEDS, clearance=st.floats(0.0, 1.0))
def test_eroding_takes_the_clearance_off_everywhere(kind, seed, clearance):
    duct = make_whole(kind)
    random = np.random.default_rng(seed)
    thin = duct.erode(clearance)
    points = scatter(random, duct, 100)
    assert thin.signed_distance(points) == pytest.approx(
        duct.signed_distance(points) + clearance, abs=1e-12
    )
    assert thin.clearance_bound(points) == pytest.approx(
        duct.clearance_bound(points) - clearance, abs=1e-12
    )
    inside = points[thin.signed_distance(points) < 0.0]
    low, high = thin.bounds
    assert np.all((inside >= low) & (inside <= high))
    # What kernels get says the same.
    again = union(thin, connected=False)
    assert again.signed_distance(points) == pytest.approx(thin.signed_distance(points), abs=1e-9)
    assert type(thin.pack()) is type(duct.pack())


def test_kernels_of_each_kind_see_the_erosion():
    from bozzini.duct.kernels.clearance import evaluate_bound

    random = np.random.default_rng(0)
    field = capsule().sample(1.0)
    moved = [Moved(one, shift=[1.0, 2.0, 3.0]) for one in (field, union(*solid_parts()))]
    for duct in (capsule(), field, union(*solid_parts()), *moved):
        points = scatter(random, duct, 50)
        thin = Eroded(duct, 0.7)
        bounds = np.empty((2, 50))
        for row, one in zip(bounds, (duct, thin), strict=True):
            evaluate_bound(one.pack(), np.ascontiguousarray(one.to_grid(points)), row)
        assert bounds[1] == pytest.approx(bounds[0] - 0.7, abs=1e-9)


@given(seed=SEEDS)
def test_erosion_within_a_difference_draws_obstacles_out(seed):
    random = np.random.default_rng(seed)
    duct = without(strip(), Circles([(9.0, 1.0)], [1.0]))
    thin = without(duct.erode(0.3), Circles([(15.0, 0.0)], [0.5]))
    points = scatter(random, duct, 100)
    wanted = np.maximum(
        duct.signed_distance(points) + 0.3, 0.5 - np.linalg.norm(points - [15.0, 0.0], axis=1)
    )
    assert thin.family_shapes is not None
    assert thin.signed_distance(points) == pytest.approx(wanted, abs=1e-9)


@given(seed=SEEDS, amount=st.floats(0.0, 3.0))
def test_inflating_moves_the_lumen_not_the_obstacles(seed, amount):
    random = np.random.default_rng(seed)
    disc = Circles([(9.0, 1.0)], [1.0])
    duct = without(strip(), disc)
    points = scatter(random, duct, 100)
    wanted = np.maximum(strip().signed_distance(points) - amount, -disc.signed_distance(points))
    assert duct.inflate(amount).signed_distance(points) == pytest.approx(wanted, abs=1e-9)
    both = union(*planar_parts())
    parts = [part.inflate(amount).signed_distance(points) for part in planar_parts()]
    wide = both.inflate(amount)
    assert wide.signed_distance(points) == pytest.approx(np.min(parts, axis=0), abs=1e-9)
    assert wide.inflation == amount


@pytest.mark.parametrize(
    "make",
    [
        lambda: union(*solid_parts()),
        lambda: without(capsule(), capsule((5, 0, 2), (5, 0, 4), 1.0)),
        lambda: Opaque(capsule(), kind="sampled", error=0.2),
        lambda: capsule().inflate(0.5),
    ],
    ids=["union", "obstacle", "with error", "inflated"],
)
def test_a_sampled_duct_keeps_its_bounds(make):
    duct = make()
    field = duct.sample(0.8)
    assert isinstance(field, SampledField)
    random = np.random.default_rng(0)
    points = random.uniform(*(duct.bounds + [[-1.0], [1.0]]), (20_000, 3))
    value = duct.signed_distance(points)
    off = field.signed_distance(points) - value - duct.error
    assert np.abs(off).max() <= field.error
    assert np.abs(off).max() > 0.1 * field.error
    assert not np.any((field.clearance_bound(points) > 0.0) & (value >= 0.0))


def test_what_a_duct_may_promise_too_much_is_taken_off_when_it_is_sampled():
    # At a node the interpolant is the value, so that nothing else hides the error.
    duct = Opaque(capsule(), kind="sampled", error=0.2)
    field = duct.sample(0.8)
    node = field.origin + 0.8 * np.array([6.0, 5.0, 6.0])
    assert field.signed_distance(node) == pytest.approx(duct.signed_distance(node) + 0.2, abs=1e-5)


def test_the_bound_of_a_sampled_duct_is_below_the_exact_room():
    # A straight capsule's depth is exact, so that the bound can be held against it.
    duct = Opaque(capsule())
    field = duct.sample(0.7)
    points = scatter(np.random.default_rng(0), duct, 50_000)
    room = -duct.signed_distance(points)
    assert np.all(field.clearance_bound(points) <= np.maximum(room, 0.0))
    assert field.clearance_bound([5.0, 0.0, 0.0]) > 2.4


@given(seed=SEEDS)
def test_a_planar_duct_can_be_sampled_too(seed):
    random = np.random.default_rng(seed)
    duct = strip()
    field = duct.sample(0.25)
    assert isinstance(field, PlanarField) and isinstance(field, Duct)
    assert field.bounds.shape == (2, 2)
    assert field.error < 0.18
    points = random.uniform(*duct.bounds, (200, 2))
    value = duct.signed_distance(points)
    assert np.abs(field.signed_distance(points) - value).max() <= field.error
    assert np.all(field.clearance_bound(points) <= np.maximum(-value, 0.0))
    assert field.to_world(field.to_grid(points)) == pytest.approx(points, abs=1e-9)
    thin, wide = field.erode(0.2), field.inflate(0.2)
    assert thin.signed_distance(points) == pytest.approx(field.signed_distance(points) + 0.2)
    assert wide.signed_distance(points) == pytest.approx(field.signed_distance(points) - 0.2)
    step = 1e-7 * random.normal(size=points.shape)
    rise = field.signed_distance(points + step) - field.signed_distance(points - step)
    slope = 2.0 * np.sum(field.gradient(points) * step, axis=1)
    assert np.mean(np.abs(rise - slope) < 1e-9) > 0.95  # but for points beside a node's line


def test_a_field_of_lower_bounds_is_not_inflated():
    field = union(*solid_parts()).sample(1.0)
    assert not field.exact_outside
    with pytest.raises(InputError, match=r"distance is 0\.5 mm: .* inflate the duct before"):
        field.inflate(0.5)
    box = Opaque(capsule(), kind="exact").sample(1.0)
    assert box.inflate(0.5).inflation == 0.5


@given(seed=SEEDS)
def test_parts_that_are_no_shapes_give_kernels_a_rigorous_field(seed):
    from bozzini.duct.kernels.clearance import GridData, evaluate_bound

    random = np.random.default_rng(seed)
    parts = solid_parts()
    duct = union(Opaque(parts[0]), parts[1], voxel=0.8, connected=False)
    assert isinstance(duct.pack(), GridData)
    points = scatter(random, duct, 200)
    bound = np.empty(200)
    evaluate_bound(duct.pack(), np.ascontiguousarray(duct.to_grid(points)), bound)
    value = duct.signed_distance(points)
    assert np.all(bound[value >= 0.0] <= 0.0)
    assert duct.to_world(duct.to_grid(points)) == pytest.approx(points, abs=1e-9)


def test_a_sampled_part_makes_the_union_sampled():
    field = capsule().sample(0.5)
    duct = union(field, solid_parts()[1])
    assert (duct.kind, duct.error) == ("sampled", field.error)
    assert Moved(duct, shift=[1.0, 0, 0]).kind == "sampled"
    points = scatter(np.random.default_rng(0), duct, 2000)
    exact = union(*solid_parts()).signed_distance(points)
    assert np.all(duct.clearance_bound(points) <= np.maximum(-exact, 0.0) + 1e-9)
    low, high = duct.bounds
    assert np.all(low <= solid_parts()[1].bounds[0]) and np.all(high >= capsule().bounds[1])


def test_obstacles_in_one_part_of_a_union_stay_there():
    cut = without(capsule(), capsule((5, 0, 0), (5, 0, 1), 1.0))
    duct = union(cut, capsule((5, 0, 0), (5, 9, 0), 2.0), voxel=0.8)
    assert duct.family_shapes is None
    assert duct.signed_distance([5.0, 0.0, 0.0]) == pytest.approx(-2.0)


@given(seed=SEEDS)
def test_parts_that_do_not_meet_are_refused(seed):
    random = np.random.default_rng(seed)
    count = int(random.integers(2, 6))
    parts = [capsule((8.0 * k, 0, 0), (8.0 * k + 8.0, 0, 0), 2.0) for k in range(count)]
    order = random.permutation(count)
    union(*(parts[k] for k in order))
    k = int(random.integers(1, count))
    far = [Moved(part, shift=[0.0, 0.0, 4.1]) for part in parts[k:]]
    with pytest.raises(GeometryError, match=r"the union is not connected.*part \d+ and part \d+"):
        union(*parts[:k], *far)
    near = [Moved(part, shift=[0.0, 0.0, 3.9]) for part in parts[k:]]
    union(*parts[:k], *near)
    union(*parts[:k], *far, connected=False)


def test_compositions_are_ducts():
    flat = without(union(*planar_parts()), Circles([(5.0, 0.0)], [0.5]))
    for duct in (flat, flat.erode(0.1), Moved(flat, shift=[1.0, 2.0]), flat.sample(0.5)):
        assert isinstance(duct, Duct)
        assert duct.bounds.shape == (2, 2)
        assert duct.kind in ("bound", "sampled")
        assert duct.wall and duct.wall_error == 0.0
    assert "obstacle" in flat.wall and "0.1 mm inside" in flat.erode(0.1).wall
    assert union(capsule(), capsule()).wall.count("(") == 1
