"""Robots: sections in series, what passes where, plain data and YAML."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from bozzini.continuum import ContinuumRobot, Helix, Section, Tendon
from bozzini.errors import BozziniError, FileFormatError, InputError
from tests.continuum.robots import QUARTER, THIRD, antagonistic_robots, make_robot

TEXT = """\
name: two sections
sections:
  - name: base
    length: 6 cm
    radius: 7 mm
    discs: 6
    bending_stiffness: 1e-3 N m^2
    max_bend: 120 deg
    tendons:
      - {name: a1, offset: 5 mm, angle: 0 deg, travel: [-10 mm, null]}
      - {name: a2, offset: 5 mm, angle: 120 deg}
      - {name: a3, offset: 0.5 cm, angle: 240 deg}
  - length: 40
    radius: 6
    disc_positions: [10, 2.5 cm, 40]
    tendons:
      - {name: h, offset: [[0, 6 mm], [10 cm, 2 mm]], angle: {start: 10 deg, turns: 1}}
      - {name: b, offset: 5mm, angle: 90deg, pushes: true, end: 80, interpolation: cubic}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "robot.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return path


def test_tendons_come_base_first_and_end_with_their_section() -> None:
    robot = make_robot(THIRD, QUARTER, length=50.0)
    assert robot.tendon_names == ("t00", "t01", "t02", "t10", "t11", "t12", "t13")
    assert robot.tendon_sections.tolist() == [0, 0, 0, 1, 1, 1, 1]
    assert robot.tendon_ends.tolist() == [50.0] * 3 + [100.0] * 4
    assert [tendon.end for tendon in robot.tendons] == robot.tendon_ends.tolist()
    assert robot.length == 100.0


def test_stations_hold_base_and_discs() -> None:
    robot = ContinuumRobot(
        (
            Section(length=30.0, radius=5.0, disc_positions=(2.0, 9.0, 30.0)),
            Section(length=20.0, radius=4.0, discs=2),
        )
    )
    assert robot.disc_arc_length.tolist() == [2.0, 9.0, 30.0, 40.0, 50.0]
    assert robot.stations().tolist() == [0.0, 2.0, 9.0, 30.0, 40.0, 50.0]
    assert robot.stations(between=1)[:5].tolist() == [0.0, 1.0, 2.0, 5.5, 9.0]
    assert robot.radius == 5.0
    assert robot.section_at([0.0, 29.9, 30.0, 30.1, 50.0]).tolist() == [0, 0, 0, 1, 1]


def test_rest_lengths_are_those_of_line_taper_and_helix() -> None:
    robot = ContinuumRobot(
        (
            Section(
                length=100.0,
                radius=6.0,
                tendons=(
                    Tendon(name="line", offset=4.0, angle=1.0),
                    Tendon(name="taper", offset=((0.0, 6.0), (100.0, 2.0))),
                    Tendon(name="helix", offset=4.0, angle=Helix(turns=1.0), end=100.0),
                    Tendon(name="bent", offset=((0.0, 5.0), (60.0, 5.0), (100.0, 2.0))),
                ),
            ),
        )
    )
    wanted = [100.0, math.hypot(100, 4), math.hypot(100, 8 * math.pi), 60.0 + math.hypot(40, 3)]
    assert np.allclose(robot.rest_lengths, wanted, rtol=1e-12)


def test_yaml_takes_units(file: Path) -> None:
    robot = ContinuumRobot.from_yaml(file)
    base, tip = robot.sections
    assert robot.name == "two sections"
    assert (base.length, base.radius, base.discs) == (60.0, 7.0, 6)
    assert base.bending_stiffness == pytest.approx(1000.0)
    assert base.max_bend == pytest.approx(math.radians(120.0))
    assert base.tendons[0].travel == (-10.0, math.inf)
    assert base.tendons[2].offset == pytest.approx(5.0)
    assert tip.disc_positions == (10.0, 25.0, 40.0)
    helix, rod = robot.tendons[3:]
    assert np.allclose(helix.angle_at([0.0, 100.0]) - math.radians(10.0), [0.0, 2.0 * math.pi])
    assert helix.offset_at(50.0) == pytest.approx(4.0)
    assert rod.pushes and rod.end == 80.0


def test_yaml_round_trip(file: Path, tmp_path: Path) -> None:
    robot = ContinuumRobot.from_yaml(file)
    again = ContinuumRobot.from_yaml(robot.to_yaml(tmp_path / "again.yaml"))
    assert again == robot


@given(robot=antagonistic_robots())
def test_plain_data_round_trip(robot: ContinuumRobot) -> None:
    assert ContinuumRobot.from_dict(robot.to_dict()) == robot


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("6 cm", "-6 cm", r"sections\[0\]\.length is -60 mm: it must lie in \(0, "),
        ("6 cm", "6 kg", r"sections\[0\]\.length: '6 kg' has the wrong kind"),
        ("6 cm", "", r"sections\[0\]\.length is None"),
        ("6 cm", "true", r"sections\[0\]\.length is True"),
        ("radius: 7 mm", "radius: 4 mm", r"'a1' offset is 5 mm in section 1 'base'.*\(0, 4\] mm"),
        ("name: a2", "name: a1", "two tendons are called 'a1'"),
        ("turns: 1", "turn: 1", "'turn': did you mean 'turns'"),
        ("discs: 6", "discs: 0", r"discs is 0: it must lie in \[1, "),
        ("discs: 6", "discs: six", "discs is 'six'"),
        ("angle: 0 deg", "angle: 0 deg, angle: 1", "line 10.*'angle' is given twice"),
        ("[10 cm, 2 mm]", "[5 cm, 2 mm]", "from 0 to 50 mm: they must reach"),
        ("1e-3 N m^2", "3 N", r"bending_stiffness: '3 N' has the wrong kind of unit"),
        ("sections:", "section:", "unknown field 'section'"),
        ("- {name: a1", "- {nam: a1", r"sections\[0\]\.tendons\[0\] has an unknown field 'nam'"),
        ("name: two", "name: [two", "not YAML in line 2"),
        ("pushes: true", "pushes: 1", "pushes is 1"),
        ("[[0, 6 mm], [10 cm, 2 mm]]", "[0, 6 mm]", r"offset\[0\] is 0"),
        ("[-10 mm, null]", "[5, 1]", "travel"),
        ("[-10 mm, null]", "5", "travel is 5: it must be a list"),
        ("end: 80", "end: 60", r"'b' end is 60 mm: .*section 2 and must lie in \(60, 100\] mm"),
        ("name: base", "name: 3", "name is 3"),
        ("turns: 1", "turns: 1 mm", r"turns: '1 mm' has the wrong kind of unit: give an angle"),
        ("discs: 6", "torsional_stiffness: 0", r"stiffness is 0 N mm\^2: .* leave it out"),
        ("name: a1", "name: 'a=1'", "tendon name is 'a=1'"),
    ],
)
def test_wrong_file_is_refused_in_one_line(file: Path, old: str, new: str, words: str) -> None:
    assert old in TEXT
    file.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(FileFormatError, match=words) as caught:
        ContinuumRobot.from_yaml(file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unreadable_file_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="cannot read"):
        ContinuumRobot.from_yaml(tmp_path / "none.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00name")
    with pytest.raises(FileFormatError, match="cannot read"):
        ContinuumRobot.from_yaml(tmp_path / "binary.yaml")


@pytest.mark.parametrize("data", [None, [], "robot", {}, {"sections": 3}, {"sections": []}])
def test_data_that_is_no_robot_is_refused(data: object) -> None:
    with pytest.raises(InputError):
        ContinuumRobot.from_dict(data)  # type: ignore[arg-type]


def test_file_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(BozziniError):
        make_robot(THIRD).to_yaml(tmp_path / "no" / "robot.yaml")
    assert not list(tmp_path.iterdir())


def test_robot_needs_sections_and_one_name_each() -> None:
    with pytest.raises(InputError, match="at least 1 section"):
        ContinuumRobot(())
    with pytest.raises(InputError, match="each must be a Section"):
        ContinuumRobot((3,))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="two sections are called 'x'"):
        ContinuumRobot((Section(length=1, radius=1, name="x"),) * 2)


def test_tendon_must_stay_inside_every_section_it_passes() -> None:
    thin = Section(length=50.0, radius=3.0)
    tendon = Tendon(name="w", offset=((0.0, 2.0), (50.0, 3.0), (100.0, 5.0)))
    ContinuumRobot((thin, Section(length=50.0, radius=5.0, tendons=(tendon,))))
    wide = Tendon(name="w", offset=((0.0, 2.0), (25.0, 3.5), (100.0, 5.0)))
    with pytest.raises(InputError, match=r"'w' offset is 4 mm in section 1"):
        ContinuumRobot((thin, Section(length=50.0, radius=5.0, tendons=(wide,))))


@pytest.mark.parametrize("turns", ["360 deg", "1", "1 turn", "6.283185307179586 rad"])
def test_turns_are_a_number_or_an_angle(file: Path, turns: str) -> None:
    plain = ContinuumRobot.from_yaml(file)
    file.write_text(TEXT.replace("turns: 1", f"turns: {turns}", 1), encoding="utf-8")
    again = ContinuumRobot.from_yaml(file)
    helix, wanted = again.tendons[3], plain.tendons[3]
    assert helix.angle_at([0.0, 100.0]) == pytest.approx(wanted.angle_at([0.0, 100.0]))


@pytest.mark.parametrize("text", ["1e-3 N m^2", "1000Nmm^2", "1000 N*mm^2", "1000", "1 mN m²"])
def test_stiffness_takes_its_units(file: Path, text: str) -> None:
    file.write_text(TEXT.replace("1e-3 N m^2", text, 1), encoding="utf-8")
    assert ContinuumRobot.from_yaml(file).sections[0].bending_stiffness == pytest.approx(1000.0)


def test_null_is_no_limit_of_travel(file: Path) -> None:
    file.write_text(TEXT.replace("[-10 mm, null]", "null", 1), encoding="utf-8")
    assert ContinuumRobot.from_yaml(file).tendons[0].travel == (-math.inf, math.inf)


def test_names_of_other_kinds_of_text_can_be_written(tmp_path: Path) -> None:
    tendon = Tendon(name=np.str_("a"), offset=1.0)
    robot = ContinuumRobot(
        (Section(length=10.0, radius=2.0, tendons=(tendon,), name=np.str_("s")),), name=np.str_("r")
    )
    assert ContinuumRobot.from_yaml(robot.to_yaml(tmp_path / "robot.yaml")) == robot
    with pytest.raises(InputError, match="robot name is 5"):
        ContinuumRobot(robot.sections, name=5)  # type: ignore[arg-type]
