"""Wires and profiles as backbones: closed forms, means, weight, the base, files with units."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from bozzini.continuum import ContinuumRobot, Section, Tendon, Wire
from bozzini.errors import FileFormatError, InputError

NITINOL = Wire(diameter=1.0, modulus=50_000.0, density=6450.0)


def make(**fields: object) -> Section:
    return Section(length=40.0, radius=5.0, **fields)  # type: ignore[arg-type]


def test_a_wire_has_its_closed_forms() -> None:
    shear_x, _, along, bending, _, torsion = NITINOL.stiffness_at(7.0)
    area, second = math.pi / 4.0, math.pi / 64.0
    assert bending == pytest.approx(50_000.0 * second)
    assert torsion == pytest.approx(bending / 1.3)
    assert along == pytest.approx(50_000.0 * area)
    # Cowper's solid circle: 6 (1 + nu) / (7 + 6 nu).
    assert shear_x == pytest.approx(6.0 * 1.3 / 8.8 * 50_000.0 / 2.6 * area)
    # A cubic metre of it, as wire.
    assert NITINOL.weight_at(0.0) / area * 1e9 == pytest.approx(6450.0 * 9.80665)


def test_a_thin_tube_has_half_its_area_in_shear() -> None:
    # Cowper: k goes to 2 (1 + nu) / (4 + 3 nu) as the wall gets thin.
    tube = Wire(diameter=1.0, modulus=1.0, inner_diameter=1.0 - 1e-6)
    across, _, along, *_ = tube.stiffness_at(0.0)
    assert 2.6 * across / along == pytest.approx(2.6 / 4.9, rel=1e-5)
    wire, hole = Wire(diameter=2.0, modulus=3.0), Wire(diameter=1.0, modulus=3.0)
    both = Wire(diameter=2.0, modulus=3.0, inner_diameter=1.0).stiffness_at(0.0)
    whole = wire.stiffness_at(0.0) - hole.stiffness_at(0.0)
    assert both[2:] == pytest.approx(whole[2:])


@pytest.mark.parametrize("name", ["bending", "torsional", "stretch", "shear"])
def test_a_profile_of_one_value_is_the_number(name: str) -> None:
    field = f"{name}_stiffness"
    number, knots = make(**{field: 70.0}), make(**{field: ((0.0, 70.0), (9.0, 70.0), (40.0, 70.0))})
    places = np.linspace(0.0, 40.0, 9)
    assert np.array_equal(number.stiffness_at(places), knots.stiffness_at(places))
    assert np.allclose(number.mean_stiffness, knots.mean_stiffness)


def test_the_mean_of_a_taper_is_its_integral() -> None:
    section = make(wire=Wire(diameter=((0.0, 2.0), (15.0, 1.5), (40.0, 1.0)), modulus=1000.0))
    places = (np.arange(20_000) + 0.5) * 40.0 / 20_000
    assert section.mean_stiffness == pytest.approx(
        section.stiffness_at(places)[:, 3:].mean(axis=0), rel=1e-7
    )
    line = make(bending_stiffness=((0.0, 100.0), (40.0, 300.0)))
    assert line.mean_stiffness == pytest.approx([200.0, 200.0, 200.0 / 1.3])


def test_places_of_a_robot_have_the_values_of_their_sections() -> None:
    first = make(
        bending_stiffness=((0.0, 100.0), (40.0, 300.0)),
        line_weight=0.002,
        disc_weight=0.01,
        discs=3,
    )
    second = make(wire=NITINOL, curvature=((0.0, 0.01, 0.0, 0.0), (40.0, 0.03, 0.0, 0.5)), discs=2)
    robot = ContinuumRobot((first, second))
    bending = robot.stiffness_at([0.0, 10.0, 40.0, 41.0])[:, 3]
    wire = NITINOL.stiffness_at(0.0)[3]
    assert bending == pytest.approx([100.0, 150.0, 300.0, wire])
    assert robot.curvature_at([10.0, 60.0]) == pytest.approx(np.array([[0, 0, 0], [0.02, 0, 0.25]]))
    assert robot.weight_at([40.0, 40.5]) == pytest.approx([0.002, float(NITINOL.weight_at(0.0))])
    assert robot.disc_weights.tolist() == [0.01] * 3 + [0.0] * 2
    assert robot.has_line_weight and not robot.is_straight


FILE = """\
sections:
  - length: 5 cm
    radius: 4 mm
    wire: {diameter: [[0, 1 mm], [5 cm, 0.5 mm]], modulus: 50 GPa, density: 6450 kg/m^3}
    curvature: [[0, 0.5 deg/mm, 0, 0], [50, 0, 0, 0.01 rad/mm]]
    disc_weight: 2 gf
    tendons:
      - {name: T1, offset: 3 mm, stiffness: 10 kN, pretension: 1 N, tension_limit: 20 N}
  - length: 40
    radius: 4
    bending_stiffness: [[0, 200 N mm^2], [40 mm, 1e-4 N m^2]]
    curvature: [0.01, 0, 0]
    line_weight: 1 N/m
base_position: [1 cm, 0, 0]
base_rotation: [0, 90 deg, 0]
"""


def test_files_take_units_and_come_back(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(FILE, encoding="utf-8")
    robot = ContinuumRobot.from_yaml(path)
    first, second = robot.sections
    assert first.wire is not None and first.wire.modulus == pytest.approx(50_000.0)
    assert first.curvature_at(0.0)[0] == pytest.approx(math.radians(0.5))
    assert first.disc_weight == pytest.approx(0.0196133)
    assert second.stiffness_at(20.0)[3] == pytest.approx(150.0)
    assert robot.weight_at(60.0) == pytest.approx(0.001)
    assert robot.tendon_stiffness.tolist() == [10_000.0]
    assert robot.base_frame[:3, 2] == pytest.approx([1.0, 0.0, 0.0])
    assert robot.base_frame[:3, 3].tolist() == [10.0, 0.0, 0.0]
    assert ContinuumRobot.from_yaml(robot.to_yaml(tmp_path / "again.yaml")) == robot
    assert ContinuumRobot.from_dict(robot.to_dict()) == robot


def test_what_is_not_given_is_not_written() -> None:
    plain = ContinuumRobot((make(tendons=(Tendon(name="a", offset=3.0),)),)).to_dict()
    assert list(plain) == ["name", "sections"]
    assert list(plain["sections"][0]) == [
        "length", "radius", "tendons", "discs", "bending_stiffness", "torsional_stiffness"
    ]  # fmt: skip
    assert list(plain["sections"][0]["tendons"][0]) == ["name", "offset", "angle"]


def test_a_turn_is_a_vector_or_a_matrix() -> None:
    vector = ContinuumRobot((make(),), base_rotation=(0.3, -0.2, 1.0))
    matrix = ContinuumRobot((make(),), base_rotation=vector.base_frame[:3, :3])
    assert matrix.base_rotation == pytest.approx(vector.base_rotation)


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        ({"wire": NITINOL, "bending_stiffness": 3.0}, "section has a wire and a bending stiffness"),
        ({"wire": 3.0}, "section wire is 3.0: it must be a Wire"),
        ({"wire": Wire(diameter=10.1, modulus=1.0)}, "wire diameter is 10.1 mm"),
        ({"bending_stiffness": ((0.0, 1.0), (39.0, 1.0))}, "they must reach from 0 mm"),
        ({"curvature": (1.0, 2.0)}, "section curvature is (1.0, 2.0): it must be (ux, uy, uz)"),
        ({"curvature": ((0.0, 0.0, 0.0, 0.0), (30.0, 1.0, 0.0, 0.0))}, "from 0 to 30 mm"),
        ({"line_weight": -1.0}, "section line weight is -1 N/mm: it must lie in [0, inf) N/mm"),
        ({"stretch_stiffness": 0.0}, "section stretch stiffness is 0 N: it must lie in (0, inf) N"),
    ],
)
def test_sections_are_refused(fields: dict[str, object], line: str) -> None:
    with pytest.raises(InputError) as caught:
        make(**fields)
    assert line in str(caught.value)


def test_wires_tendons_and_bases_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"inner diameter is 1 mm: it must lie in \[0, 1\) mm"):
        Wire(diameter=1.0, modulus=1.0, inner_diameter=1.0)
    with pytest.raises(InputError, match="pretension is 3 N: it must lie in"):
        Tendon(name="a", offset=1.0, pretension=3.0, tension_limit=2.0)
    with pytest.raises(InputError, match="base_rotation is no frame: its axes miss"):
        ContinuumRobot((make(),), base_rotation=np.ones((3, 3)))
    path = tmp_path / "robot.yaml"
    path.write_text(FILE.replace("50 GPa", "50 mm"), encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"sections\[0\].wire.modulus: '50 mm' has the wrong"):
        ContinuumRobot.from_yaml(path)
