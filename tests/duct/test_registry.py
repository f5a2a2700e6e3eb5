"""All shapes of the registry alike, and shapes of other packages beside them."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import numpy as np
import pytest
import trimesh

from bozzini.duct import (
    SHAPES,
    BetweenCurves,
    Centreline,
    Circles,
    ConnectedCylinders,
    ConvexPolyhedra,
    Duct,
    Moved,
    PointCloud,
    Polygon,
    RoundCones,
    StitchedQuads,
    SuperEllipses,
    SuperEllipsoids,
    TriangleMesh,
    load,
    save,
    union,
    without,
)
from bozzini.errors import FileFormatError, InputError
from bozzini.motion import Scope, plan_insertion
from tests.duct.torus import PackedTorus, Torus

BALL = trimesh.creation.icosphere(subdivisions=2, radius=4.0)
LEFT, RIGHT = [(0, 2), (10, 3), (20, 2)], [(0, -2), (10, -1), (20, -2)]
OWN = {
    "polygon": Polygon([(0, 0), (8, 0), (8, 3), (3, 4)], inflation=0.2),
    "quads": StitchedQuads(LEFT, RIGHT),
    "curves": BetweenCurves(LEFT, RIGHT),
    "circles": Circles([(0, 0), (2, 1)], [1.5, 1.0]),
    "superellipses": SuperEllipses([(0, 0)], [(3, 1)], powers=[8.0], angles=[0.4]),
    "superellipsoids": SuperEllipsoids(
        [(0, 0, 0)],
        [(3, 1, 2)],
        e1=[0.5],
        e2=[1.5],
        rotations=[[[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]]],
    ),
    "cones": RoundCones([(0, 0, 0), (6, 0, 0), (6, 5, 0)], [1.5, 1.0, 2.0]),
    "cylinders": ConnectedCylinders([(0, 0, 0), (4, 0, 0)], [(1, 0, 0), (1, 0, 0)], [1.0, 1.5]),
    "polyhedra": ConvexPolyhedra.from_points([np.eye(3).tolist() + [[0, 0, 0]]]),
    "mesh": TriangleMesh(BALL.vertices, BALL.faces),
    "cloud": PointCloud(BALL.vertices, 2.0, seeds=[(0, 0, 0)]),
}
TORI = {"torus": Torus(20.0, 5.0), "packed-torus": PackedTorus(20.0, 5.0)}


@pytest.fixture
def plugins(monkeypatch):
    """Both tori as another package brings them."""
    found = {
        name: EntryPoint(name, f"tests.duct.torus:{type(duct).__name__}", SHAPES.group)
        for name, duct in TORI.items()
    }
    monkeypatch.setitem(SHAPES.__dict__, "plugins", found)


def scatter(duct, count=300):
    low, high = duct.bounds
    return np.random.default_rng(0).uniform(low - 2.0, high + 2.0, (count, len(low)))


def test_every_shape_is_here():
    assert set(OWN) == set(SHAPES.own)
    assert all(SHAPES[name] is type(duct) for name, duct in OWN.items())


@pytest.mark.parametrize("name", [*OWN, *TORI])
def test_every_shape_is_a_duct_that_is_saved_moved_and_drawn(name, plugins, tmp_path):
    duct = (OWN | TORI)[name]
    points = scatter(duct)
    value = duct.signed_distance(points)
    assert isinstance(duct, Duct) and SHAPES[name] is type(duct)
    assert np.all(duct.clearance_bound(points) <= -value)
    for suffix in ("json", "yaml"):
        same = load(save(duct, tmp_path / f"a.{suffix}"))
        assert same.signed_distance(points) == pytest.approx(value, abs=1e-12)
    turn = np.eye(duct.dim)
    turn[:2, :2] = [[0.6, -0.8], [0.8, 0.6]]
    moved = Moved(duct, rotation=turn, shift=np.arange(duct.dim) + 1.0)
    there = points @ turn.T + moved.shift
    assert moved.signed_distance(there) == pytest.approx(value, abs=1e-9)
    if moved.family_shapes is not None:
        assert union(moved).signed_distance(there) == pytest.approx(value, abs=1e-9)
    step = 1e-6 * np.random.default_rng(1).normal(size=points.shape)
    rise = duct.signed_distance(points + step) - duct.signed_distance(points - step)
    slope = 2.0 * np.sum(duct.gradient(points) * step, axis=1)
    assert np.mean(np.abs(rise - slope) < 1e-8) > 0.9  # but for points where it has a kink
    assert duct.plot().get_xlabel()


@pytest.mark.parametrize("name", TORI)
def test_a_shape_of_another_package_is_composed_and_planned_in(name):
    torus, stone = TORI[name], RoundCones([(20, 0, 3)], [1.0])
    other = RoundCones([(20, 0, 0), (40, 0, 0)], [4.0, 4.0])
    duct = union(without(torus, stone), other, voxel=1.0)
    points = scatter(duct)
    wanted = np.minimum(
        np.maximum(torus.signed_distance(points), -stone.signed_distance(points)),
        other.signed_distance(points),
    )
    assert duct.signed_distance(points) == pytest.approx(wanted, abs=1e-9)
    angle = np.linspace(0.0, np.pi, 80)
    ring = 20.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    line = Centreline.from_points(ring, torus)
    plan = plan_insertion(torus, line, scope=Scope(diameter=4.0, link_length=6.0))
    assert plan.status == "complete" and plan.meta["certified"]
    heads = plan.joints[:, 0]
    assert np.all(torus.clearance_bound(heads) >= 2.0)
    wide = torus.inflate(1.0)
    assert wide.erode(1.0).signed_distance(points) == pytest.approx(torus.signed_distance(points))
    assert torus.sample(1.0).error < 1.0


def test_what_is_not_in_the_registry_has_no_file_form(tmp_path):
    with pytest.raises(InputError, match="a Torus has no file form: polygon, quads"):
        save(TORI["torus"], tmp_path / "t.json")
    (tmp_path / "t.json").write_text(
        '{"format": "bozzini shapes", "version": 1, "kind": "torus", "shapes": [{}]}'
    )
    with pytest.raises(FileFormatError, match="kind is 'torus': it must be one of polygon"):
        load(tmp_path / "t.json")
