"""Discs, sleeves and the routing of tendon robots: files against the tendons' own paths."""

from __future__ import annotations

import csv
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from bozzini.continuum import ContinuumRobot, Helix, Section, Tendon
from bozzini.errors import GeometryError, InputError, MissingExtraError
from bozzini.fabricate import BodyOptions, build_body, tabulate_routing, write_body, write_step
from tests.fabricate.read_back import read_cylinders, read_step, read_walls

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
TWO, HELICAL = (
    ContinuumRobot.from_yaml(EXAMPLES / f"{name}.yaml") for name in ("two_sections", "helical")
)
SHORT = ContinuumRobot(
    [
        Section(
            length=12.0,
            radius=4.0,
            discs=2,
            tendons=[
                Tendon(name="A", offset=3.0, angle=Helix(start=0.3, turns=0.4)),
                Tendon(name="B", offset=[(0.0, 3.0), (8.0, 2.0)], angle=3.0, end=8.0),
            ],
        )
    ]
)
HOLE = 0.35
NEAR = {"rtol": 0.0, "atol": 1e-5}


def holes(walls):
    return [wall for wall in walls if wall.inside and abs(wall.diameter - HOLE) < 1e-4]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("body") / "out"
    write_body(SHORT, out, options=BodyOptions(thickness=1.0))
    return out


def test_channels_of_discs_lie_along_the_tendons(folder):
    for row in json.loads((folder / "summary.json").read_text(encoding="utf-8"))["parts"]:
        ((_, _, place),) = row["places_mm"]
        found = holes(read_cylinders(folder / f"{row['name']}.stl"))
        tendons = [t for t in SHORT.tendons if t.end >= place]
        assert len(found) == len(tendons)
        for tendon in tendons:
            middle = tendon.place_at(place)
            hole = min(found, key=lambda h, m=middle: np.linalg.norm(h.point[:2] - m))
            np.testing.assert_allclose(hole.point[:2], middle, **NEAR)
            way = np.append(tendon.slope_at(place), 1.0)
            np.testing.assert_allclose(hole.way, way / np.linalg.norm(way), **NEAR)


def test_channels_of_a_sleeve_follow_the_tendons(tmp_path):
    (sleeve,) = build_body(SHORT, BodyOptions(form="sleeve"))
    sleeve.mesh(0.4).export(tmp_path / "sleeve.stl")
    walls = [w for w in read_walls(tmp_path / "sleeve.stl") if w.inside]
    assert len(walls) == 3
    swept = max(walls, key=lambda wall: len(wall.rings))
    (blind,) = (w for w in walls if abs(max(w.rings) - 8.0) < 1e-6)
    for wall, tendon in ((swept, SHORT.tendons[0]), (blind, SHORT.tendons[1])):
        assert min(wall.rings) == pytest.approx(0.0)
        assert max(wall.rings) == pytest.approx(tendon.end)
        for z, ring in wall.rings.items():
            middle, slope = tendon.place_at(z), tendon.slope_at(z)
            np.testing.assert_allclose(ring.mean(axis=0), middle, **NEAR)
            # Every corner lies on the circle across the tendon.
            way = np.append(slope, 1.0) / math.sqrt(1.0 + slope @ slope)
            away = np.column_stack([ring - middle, np.zeros(len(ring))])
            across = np.linalg.norm(away - np.outer(away @ way, way), axis=1)
            np.testing.assert_allclose(across, HOLE / 2, **NEAR)


def test_discs_of_one_shape_are_one_part():
    parts = build_body(TWO)
    assert [part.count for part in parts] == [13, 10]  # the base's with those of section 1
    assert sorted(z for part in parts for _, _, z in part.places) == pytest.approx(
        [0.0, *TWO.disc_arc_length]
    )
    assert [len(part.channels) for part in parts] == [7, 4]
    assert len(build_body(HELICAL)) == 40  # the one at the end stands as the one at the base


def test_mesh_volumes_are_those_of_the_polygons(tmp_path):
    first = build_body(TWO)[0]
    area = math.pi * (5.0**2 - 6 * (HOLE / 2) ** 2 - 0.55**2)
    assert first.volume == pytest.approx(2.0 * area, rel=1e-12)
    mesh = first.mesh(0.4)
    mesh.export(tmp_path / "disc.stl")
    area = 0.0
    for wall in read_walls(tmp_path / "disc.stl"):
        corners = len(wall.rings[-1.0])
        polygon = 0.5 * corners * math.sin(math.tau / corners) * (wall.diameter / 2) ** 2
        area += -polygon if wall.inside else polygon
    assert mesh.volume == pytest.approx(2.0 * area, rel=1e-6)
    assert mesh.volume == pytest.approx(first.volume, rel=3e-3)


@pytest.mark.parametrize("form", ["discs", "sleeve"])
@pytest.mark.parametrize("robot", [SHORT, TWO], ids=lambda robot: robot.name)
def test_all_parts_are_closed(robot, form):
    for part in build_body(robot, BodyOptions(form=form)):
        mesh = part.mesh(0.4)
        assert mesh.is_volume
        assert mesh.volume == pytest.approx(part.volume, rel=5e-3)
        through = sum(c.centre[-1, 2] == part.high for c in part.channels)
        assert mesh.euler_number == 2 - 2 * through  # a handle for each


def test_routing_table_holds_the_paths_and_the_discs(folder):
    with (folder / "routing.csv").open() as file:
        rows = list(csv.DictReader(file))
    for tendon in SHORT.tendons:
        mine = [row for row in rows if row["tendon"] == tendon.name]
        s, x, y = (np.array([float(r[c]) for r in mine]) for c in ("s_mm", "x_mm", "y_mm"))
        np.testing.assert_allclose(np.column_stack([x, y]), tendon.place_at(s), rtol=0, atol=1e-7)
        angle, offset = (np.array([float(r[c]) for r in mine]) for c in ("angle_rad", "offset_mm"))
        back = offset * np.exp(1j * angle)
        np.testing.assert_allclose(back, x + 1j * y, rtol=0, atol=1e-7)
        at = s[[row["at_disc"] == "True" for row in mine]]
        discs = np.array([0.0, *SHORT.disc_arc_length])
        np.testing.assert_allclose(at, discs[discs <= tendon.end], rtol=0, atol=1e-7)
        assert s[-1] == tendon.end
    # Chords converge to the length of the smooth curve with the square of the step.
    missing = [
        HELICAL.rest_lengths[0] - tabulate_routing(HELICAL, step).to_dict()["H1"]["length_mm"]
        for step in (1.0, 0.25)
    ]
    assert 0.0 < missing[1] < missing[0] / 3.0


def test_routing_is_drawn_into_given_axes():
    from matplotlib.figure import Figure

    axes = Figure().add_subplot()
    assert tabulate_routing(HELICAL).plot(axes) is axes
    assert axes.get_ylabel().endswith("[deg]")
    assert tabulate_routing(TWO).plot().get_figure() is not None


@pytest.mark.slow
def test_step_files_have_the_cylinders_and_the_volume(tmp_path):
    pytest.importorskip("OCP", reason="the extra 'cad' is not installed")
    for part in build_body(SHORT, BodyOptions(thickness=1.0)):
        path = write_step(part, tmp_path / f"{part.name}.step")
        found = [(p, w) for p, w, d in read_step(path) if abs(d - HOLE) < 1e-9]
        for channel in part.channels[1:]:
            way = np.append(channel.slope[0], 1.0) / channel.stretch[0]
            middle = channel.centre.mean(axis=0)
            gaps = [np.linalg.norm(p - middle) + np.linalg.norm(w - way) for p, w in found]
            assert min(gaps) < 1e-9
        assert measure_step(path) == pytest.approx(part.volume, rel=1e-9)
    blind = place(Tendon(name="A", offset=3.0, end=15.0), Tendon(name="B", offset=2.0, angle=1.0))
    for robot in (SHORT, blind):
        (sleeve,) = build_body(robot, BodyOptions(form="sleeve"))
        path = write_step(sleeve, tmp_path / "sleeve.step")
        assert measure_step(path) == pytest.approx(sleeve.volume, rel=1e-7)


def measure_step(path):
    """Return the volume of what Open CASCADE reads from a STEP file."""
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps
    from OCP.STEPControl import STEPControl_Reader

    reader = STEPControl_Reader()
    reader.ReadFile(str(path))
    reader.TransferRoots()
    found = GProp_GProps()
    BRepGProp.VolumeProperties_s(reader.OneShape(), found, 1e-9)  # relative error
    return found.Mass()


def test_step_without_the_extra_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "OCP", None)
    monkeypatch.setitem(sys.modules, "OCP.collections", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'bozzini\[cad\]'"):
        write_body(SHORT, tmp_path / "out", step=True)
    assert not list(tmp_path.iterdir())


def place(*tendons):
    return ContinuumRobot([Section(length=20.0, radius=4.0, discs=4, tendons=tendons)])


@pytest.mark.parametrize(
    ("robot", "options", "words"),
    [
        (SHORT, {"thickness": 6.0}, "thickness is 6 mm: it must be below 6 mm, the distance"),
        # At 1 mm from the middle: 4 - hypot(3, 0.628) - 0.175 sqrt(1 + 0.628^2).
        (SHORT, {"wall": 0.9}, "wall of 0.728 mm is left between tendon A and the outside at z"),
        (SHORT, {"backbone_diameter": 8.0}, "disc-00: no wall .* is left between the backbone and"),
        (SHORT, {"clearance": -0.1}, r"clearance is -0.1 mm: it must lie in \[0, 10\] mm"),
        (SHORT, {"form": "spiral"}, "form is 'spiral': it must be one of discs, sleeve"),
        (
            place(Tendon(name="A", offset=3.9)),
            {},
            "no wall .* is left between tendon A and the outs",
        ),
        (
            place(Tendon(name="A", offset=3.0), Tendon(name="B", offset=3.0, angle=0.2)),
            {},
            "wall of 0.249 mm is left between tendon A and tendon B",
        ),
        (
            place(Tendon(name="A", offset=3.0, end=19.9)),
            {"form": "sleeve"},
            "wall of 0.1 mm is left between tendon A and the end face at z = 19.9 mm",
        ),
        (None, {}, "robot is of type NoneType"),
    ],
)
def test_what_cannot_be_made_is_named(robot, options, words):
    with pytest.raises(InputError, match=words):
        build_body(robot, BodyOptions(**options))


def test_a_tendon_that_crosses_the_axis_needs_a_body_without_backbone():
    robot = place(
        Tendon(name="A", offset=[(0.0, 2.0), (10.0, 0.01), (20.0, 2.0)], angle=0.0),
    )
    with pytest.raises(GeometryError, match="between the backbone and tendon A at z"):
        build_body(robot, BodyOptions(form="sleeve"))
    (sleeve,) = build_body(robot, BodyOptions(form="sleeve", backbone_diameter=0.0))
    assert sleeve.mesh(0.4).is_volume
