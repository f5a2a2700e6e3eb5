"""Robots: sections in series, what passes where, plain data and YAML."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from bozzini.continuum import ContinuumRobot, Helix, RobotCalibration, Section, Tendon
from bozzini.errors import FileFormatError
from tests.continuum.robots import QUARTER, ROBOT_FILE, THIRD, antagonistic_robots, make_robot


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "robot.yaml"
    path.write_text(ROBOT_FILE, encoding="utf-8")
    return path


def test_tendons_come_base_first_and_end_with_their_section() -> None:
    robot = make_robot(THIRD, QUARTER, length=50.0)
    assert robot.tendon_names == ("t00", "t01", "t02", "t10", "t11", "t12", "t13")
    assert robot.tendon_sections.tolist() == [0, 0, 0, 1, 1, 1, 1]
    assert robot.tendon_ends.tolist() == [50.0] * 3 + [100.0] * 4
    assert [tendon.end for tendon in robot.tendons] == robot.tendon_ends.tolist()
    assert robot.length == 100.0


def test_the_scale_of_a_calibration_is_of_what_was_commanded_alone() -> None:
    commands = np.array([[1.0, 2.0, 0.5], [0.0, 3.0, 1.0]])
    plain = make_robot(THIRD)
    pulled, moved = (
        dataclasses.replace(plain, calibration=RobotCalibration(command=command, scale=1.25))
        for command in ("tension", "displacement")
    )
    np.testing.assert_allclose(pulled.to_tensions(commands), 1.25 * commands)
    np.testing.assert_allclose(pulled.to_commands(pulled.to_tensions(commands)), commands)
    for robot in (plain, moved):
        np.testing.assert_array_equal(robot.to_tensions(commands), commands)
    np.testing.assert_array_equal(pulled.to_displacements(commands), commands)


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


def test_a_tendon_that_tapers_passes_a_thinner_section() -> None:
    thin = Section(length=50.0, radius=3.0)
    tendon = Tendon(name="w", offset=((0.0, 2.0), (50.0, 3.0), (100.0, 5.0)))
    ContinuumRobot((thin, Section(length=50.0, radius=5.0, tendons=(tendon,))))


@pytest.mark.parametrize("turns", ["360 deg", "1", "1 turn", "6.283185307179586 rad"])
def test_turns_are_a_number_or_an_angle(file: Path, turns: str) -> None:
    plain = ContinuumRobot.from_yaml(file)
    file.write_text(ROBOT_FILE.replace("turns: 1", f"turns: {turns}", 1), encoding="utf-8")
    again = ContinuumRobot.from_yaml(file)
    helix, wanted = again.tendons[3], plain.tendons[3]
    assert helix.angle_at([0.0, 100.0]) == pytest.approx(wanted.angle_at([0.0, 100.0]))


@pytest.mark.parametrize("text", ["1e-3 N m^2", "1000Nmm^2", "1000 N*mm^2", "1000", "1 mN m²"])
def test_stiffness_takes_its_units(file: Path, text: str) -> None:
    file.write_text(ROBOT_FILE.replace("1e-3 N m^2", text, 1), encoding="utf-8")
    assert ContinuumRobot.from_yaml(file).sections[0].bending_stiffness == pytest.approx(1000.0)


def test_null_is_no_limit_of_travel(file: Path) -> None:
    file.write_text(ROBOT_FILE.replace("[-10 mm, null]", "null", 1), encoding="utf-8")
    assert ContinuumRobot.from_yaml(file).tendons[0].travel == (-math.inf, math.inf)


@pytest.mark.parametrize(
    ("old", "new"),
    [("120 deg}", "120}"), ("max_bend: 120 deg", "max_bend: 120"), ("10 deg", "90")],
)
def test_degrees_without_their_unit_are_refused(file: Path, old: str, new: str) -> None:
    file.write_text(ROBOT_FILE.replace(old, new, 1), encoding="utf-8")
    number = new.split()[-1].rstrip("}")
    with pytest.raises(FileFormatError, match=f"{number}: radians\\? write {number} deg, or"):
        ContinuumRobot.from_yaml(file)
    file.write_text(ROBOT_FILE.replace(old, old.replace("deg", "rad"), 1), encoding="utf-8")
    ContinuumRobot.from_yaml(file)


def test_angles_beyond_a_turn_come_back(tmp_path: Path) -> None:
    tendons = (
        Tendon(name="a", offset=4.0, angle=Helix(turns=-3.0)),
        Tendon(name="b", offset=4.0, angle=7.0),
    )
    robot = ContinuumRobot((Section(length=60.0, radius=5.0, tendons=tendons, max_bend=9.0),))
    assert ContinuumRobot.from_yaml(robot.to_yaml(tmp_path / "robot.yaml")) == robot
    assert ContinuumRobot.from_yaml(robot.to_yaml(tmp_path / "robot.json")) == robot
    assert ContinuumRobot.from_dict(robot.to_dict()) == robot


def test_names_of_other_kinds_of_text_can_be_written(tmp_path: Path) -> None:
    tendon = Tendon(name=np.str_("a"), offset=1.0)
    robot = ContinuumRobot(
        (Section(length=10.0, radius=2.0, tendons=(tendon,), name=np.str_("s")),), name=np.str_("r")
    )
    assert ContinuumRobot.from_yaml(robot.to_yaml(tmp_path / "robot.yaml")) == robot
