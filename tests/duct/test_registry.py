"""All shapes of the registry alike, and shapes of other packages beside them."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
import trimesh

from bozzini.checks import quantity
from bozzini.duct import (
    DUCT_SHAPES,
    BetweenCurves,
    Centreline,
    Circles,
    ConnectedCylinders,
    ConvexPolyhedra,
    Duct,
    DuctShape,
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
from bozzini.duct.shape_files import read_shapes, write_shapes
from bozzini.errors import FileFormatError, GeometryError, InputError
from bozzini.motion import Scope, certify_motion, plan_insertion
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Ball(DuctShape):
    """A ball, or what goes wrong in a class of one's own."""

    radius: float = quantity("length", "Radius.", low=0.0, low_open=True)
    stretch: float = 1.0
    bulge: float = 0.0
    cut: float = 0.0
    value: float = 0.0
    count: int = 1

    name = "ball"

    @property
    def bounds(self):
        return np.full((2, 3), self.radius + self.inflation - self.cut) * [[-1.0], [1.0]]

    def signed_distance(self, points):
        points = np.asarray(points, dtype=np.float64)
        away = self.stretch * np.linalg.norm(points, axis=-1) + self.value
        distance = away + self.bulge * np.abs(points).sum(axis=-1) - self.radius - self.inflation
        return distance if self.count == 1 else np.stack([distance] * self.count)


@dataclass(frozen=True, kw_only=True, eq=False)
class Balls(DuctShape):
    """A union of balls, which leaves its columns to be checked by the base."""

    name = "balls"
    columns = {"place": ("places", "lengths"), "size": ("sizes", "length")}

    places: np.ndarray
    sizes: np.ndarray

    @property
    def bounds(self):
        reach = (self.sizes + self.inflation)[:, None]
        return [(self.places - reach).min(axis=0), (self.places + reach).max(axis=0)]

    def signed_distance(self, points):
        away = np.linalg.norm(np.asarray(points)[..., None, :] - self.places, axis=-1)
        return (away - self.sizes).min(axis=-1) - self.inflation


@pytest.fixture
def plugins(monkeypatch):
    """Both tori as another package brings them."""
    found = {
        name: EntryPoint(name, f"tests.duct.torus:{type(duct).__name__}", DUCT_SHAPES.group)
        for name, duct in TORI.items()
    }
    monkeypatch.setitem(DUCT_SHAPES.__dict__, "plugins", found)


def scatter(duct, count=300):
    low, high = duct.bounds
    return np.random.default_rng(0).uniform(low - 2.0, high + 2.0, (count, len(low)))


def test_every_shape_is_here():
    assert set(OWN) == set(DUCT_SHAPES.own)
    assert all(DUCT_SHAPES[name] is type(duct) for name, duct in OWN.items())


@pytest.mark.parametrize("name", [*OWN, *TORI])
def test_every_shape_is_a_duct_that_is_saved_moved_and_drawn(name, plugins, tmp_path):
    duct = (OWN | TORI)[name]
    points = scatter(duct)
    value = duct.signed_distance(points)
    assert isinstance(duct, Duct) and DUCT_SHAPES[name] is type(duct)
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


@pytest.mark.slow
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


def add_units(value, kind):
    """Write the lengths among numbers with a unit, as a file can have them."""
    if isinstance(value, list):
        row = isinstance(kind, tuple) and not isinstance(value[0], list)
        return [add_units(item, kind[k] if row else kind) for k, item in enumerate(value)]
    return f"{0.1 * value!r} cm" if kind == "length" else value


@pytest.mark.parametrize("name", OWN)
def test_a_file_may_state_every_length_with_its_unit(name):
    duct = OWN[name]
    data = write_shapes(duct)
    forms = {key: form.rstrip("s") for key, (_, form) in duct.columns.items()}
    for piece in data["shapes"]:
        for key, value in piece.items():
            piece[key] = add_units(value, forms.get(key) or duct.unit_kinds.get(key))
    assert " cm" in str(data)
    points = scatter(duct)
    wanted = duct.signed_distance(points)
    assert read_shapes(data).signed_distance(points) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.slow
def test_code_compiled_for_a_package_that_is_gone_harms_no_other(tmp_path):
    field = "import numpy as np\nfrom bozzini.duct import SampledField\n"
    field += "at = dict(spacing=np.ones(3), origin=np.zeros(3), rotation=np.eye(3))\n"
    field += "values = np.full((2, 2, 2), -1.0, dtype=np.float32)\n"
    field += "print(SampledField(values=values, **at).signed_distance([(0.5, 0.5, 0.5)]))"
    torus = "from lost import PackedTorus\n"
    torus += "print(PackedTorus(9.0, 2.0).signed_distance([(9, 0, 0)]))"
    (tmp_path / "lost.py").write_bytes((Path(__file__).parent / "torus.py").read_bytes())
    for code, answer in ((field, "[-1.]"), (torus, "[-2.]"), (field, "[-1.]")):
        done = subprocess.run(
            [sys.executable, "-c", code],
            cwd=tmp_path,
            env={
                **os.environ,
                "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
                "PYTHONPATH": os.pathsep.join(sys.path),
            },
            capture_output=True,
            text=True,
            timeout=250,
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.strip() == answer
        if code == torus:
            (tmp_path / "lost.py").unlink()


def test_units_of_a_shape_of_another_package_are_its_quantities(monkeypatch):
    found = {"ball": EntryPoint("ball", f"{__name__}:Ball", DUCT_SHAPES.group)}
    monkeypatch.setitem(DUCT_SHAPES.__dict__, "plugins", found)
    data = write_shapes(Ball(radius=4.0))
    data["shapes"] = [{"radius": "0.4 cm"}]
    assert read_shapes(data | {"inflation": "1 mm"}).inflate(1.0).bounds[1].tolist() == [6.0] * 3
    for radius, message in (
        ("4 kg", r"^shapes\[0\]\.radius: '4 kg'"),
        (-4.0, r"^radius is -4 mm: it must lie in \(0, inf\) mm"),
    ):
        with pytest.raises(InputError, match=message):
            read_shapes(data | {"shapes": [{"radius": radius}]})


def test_columns_of_a_shape_of_another_package_become_arrays_of_one_length(monkeypatch):
    found = {"balls": EntryPoint("balls", f"{__name__}:Balls", DUCT_SHAPES.group)}
    monkeypatch.setitem(DUCT_SHAPES.__dict__, "plugins", found)
    given = Balls(places=[[0, 0, 0], [0, 0, 5]], sizes=[3, 4])
    again = read_shapes(write_shapes(given))
    assert np.array_equal(again.places, given.places) and np.array_equal(again.sizes, [3.0, 4.0])
    assert again.signed_distance((0, 0, 5)) == given.signed_distance((0, 0, 5)) == -4.0
    for change, message in (
        ({"sizes": [3.0]}, r"^sizes has 1 value\(s\): it must have one per row of places, 2"),
        ({"sizes": ["3", "4"]}, r"^sizes must be an array of numbers of shape \(n,\)"),
        ({"places": [[0, 0], [0, 5]]}, r"^places has shape \(2, 2\): it must be \(n, 3\)"),
    ):
        with pytest.raises(InputError, match=message):
            replace(given, **change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stretch": 1.2}, "changes by more than .* 1 mm per mm"),
        ({"stretch": 0.0, "bulge": 0.9, "cut": -1.0}, "changes by more than .* 1 mm per mm"),
        ({"cut": 1.0}, "is -.* mm at .*: bounds must be a box that holds the whole duct"),
        ({"value": np.nan}, "is nan at .*: it must be finite"),
        ({"count": 2}, r"has shape \(.*\) at points of shape .*: it must be"),
    ],
)
def test_a_distance_that_is_none_is_refused_before_anything_is_proved_with_it(change, message):
    ball = Ball(radius=4.0)
    assert ball.sample(0.5).signed_distance((0.0, 0.0, 0.0)) == pytest.approx(-4.0, abs=0.5)
    wrong = replace(ball, **change)
    line = Centreline.from_points([(0, 0, -2), (0, 0, 2)], ball)
    for use in (
        lambda: wrong.sample(0.5),
        wrong.pack,
        lambda: certify_motion(np.zeros((1, 2, 3)), wrong, radius=1.0),
        lambda: plan_insertion(wrong, line, scope=Scope(diameter=1.0, link_length=1.0)),
    ):
        with pytest.raises(GeometryError, match=f"^the signed distance of a Ball {message}"):
            use()


@pytest.mark.parametrize("change", [{"inflation": -1.0}, {"wall_error": -1.0}, {"radius": -1.0}])
def test_a_shape_checks_its_fields_by_itself(change):
    name = next(iter(change)).replace("_", " ")
    with pytest.raises(InputError, match=f"^{name} is -1 mm: it must lie in"):
        Ball(**({"radius": 4.0} | change))


def test_what_is_not_in_the_registry_has_no_file_form(tmp_path):
    with pytest.raises(InputError, match="a Torus has no file form: polygon, quads"):
        save(TORI["torus"], tmp_path / "t.json")
    (tmp_path / "t.json").write_text(
        '{"format": "bozzini shapes", "version": 1, "kind": "torus", "shapes": [{}]}'
    )
    with pytest.raises(FileFormatError, match="kind is 'torus': it must be one of polygon"):
        load(tmp_path / "t.json")
