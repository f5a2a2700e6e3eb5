"""Refusals of every function of the continuum package: one line with the field and the range."""

from __future__ import annotations

import dataclasses
import math
import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bozzini.continuum import (
    CONTINUUM_MODELS,
    ArcModel,
    ContinuumRobot,
    EnergyModel,
    Helix,
    LinkageModel,
    RodModel,
    Section,
    Tendon,
    arc_frames,
    displacements_for,
    jacobian,
    manipulability,
    measure_dexterity,
    sample_workspace,
    solve_curve,
    solve_pose,
    solve_section,
    solve_tip,
)
from bozzini.continuum.workspace import map_dexterity, measure_volume, tendon_travel
from bozzini.errors import BozziniError, FileFormatError, GeometryError, InputError, OutputError
from tests.continuum.robots import ROBOT_FILE, THIRD, make_robot
from validation.thesis.section_arc import solve_direction, solve_extensible, solve_joints

ROBOT = make_robot(THIRD)
TWO = make_robot(THIRD, THIRD, length=30.0)
OPPOSED = make_robot((0.0, 180.0))
RODS = make_robot((0.0, 180.0), pushes=True)
BARE = make_robot(())
PLACE = (1.0, 2.0, 3.0)


@cache
def shape():
    return ArcModel(ROBOT).shape([[2.0, -1.0, -1.0]] * 2)


def make_tendon(**fields: Any) -> Tendon:
    return Tendon(**{"name": "a", "offset": 4.0, **fields})


def make_section(**fields: Any) -> Section:
    return Section(**{"length": 30.0, "radius": 5.0, **fields})


def make_single(*tendons: Tendon, **fields: Any) -> ContinuumRobot:
    """Return a robot of one section of 100 mm."""
    section = {"length": 100.0, "radius": 6.0, "tendons": tendons, **fields}
    return ContinuumRobot((Section(**section),))


HELICAL = make_single(make_tendon(angle=Helix(turns=1.0), end=100.0))
CONVERGING = make_single(make_tendon(offset=((0.0, 5.0), (100.0, 2.0))))
SHORT = make_single(make_tendon(end=60.0))
STUCK = make_single(
    *(make_tendon(name=f"t{k}", angle=2.1 * k, travel=(1.0, 3.0)) for k in range(3))
)


def read_robot(old: str = "", new: str = "", *, data: bytes | None = None) -> ContinuumRobot:
    """Read the robot's file with a part of its text replaced, or with other data."""
    assert old in ROBOT_FILE
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.yaml"
        path.write_bytes(ROBOT_FILE.replace(old, new, 1).encode() if data is None else data)
        try:
            return ContinuumRobot.from_yaml(path)
        except FileFormatError as error:
            name, line = f"{path}: ", str(error)
            assert line.count(str(path)) == 1
            raise FileFormatError(line.removeprefix(name).replace(str(path), path.name)) from None


def pass_wide() -> ContinuumRobot:
    """Return a robot whose distal tendon passes a thinner section."""
    tendon = make_tendon(offset=((0.0, 2.0), (25.0, 3.5), (100.0, 5.0)))
    distal = make_section(length=50.0, radius=5.0, tendons=(tendon,))
    return ContinuumRobot((make_section(length=50.0, radius=3.0), distal))


def sample() -> Any:
    return sample_workspace(TWO, 5)


def scale(x: float, y: float, z: float, last: float = 1.0) -> Any:
    return np.diag([x, y, z, last])


# fmt: off


class NotIterable:
    """As a quantity of pint that is one number: it has ``__iter__``, which fails."""

    def __iter__(self) -> Iterator[object]:
        raise TypeError("'float' object is not iterable")


REFUSALS: list[tuple[Callable[[], object], type[BozziniError], str, str]] = [
    (lambda: make_section(length=0.0), InputError, "section length is 0 mm", "(0, 100000] mm"),
    (lambda: make_section(length=math.nan),
     InputError, "section length is nan mm", "(0, 100000] mm"),
    (lambda: make_section(radius=-1.0), InputError, "section radius is -1 mm", "(0, 10000] mm"),
    (lambda: make_section(bending_stiffness=0.0),
     InputError, "section bending stiffness is 0 N mm^2", "[1e-09, 1e+15] N mm^2"),
    (lambda: make_section(bending_stiffness=1e300),
     InputError, "section bending stiffness is 1e+300 N mm^2", "[1e-09, 1e+15] N mm^2"),
    (lambda: make_section(bending_stiffness=1e-300),
     InputError, "section bending stiffness is 1e-300 N mm^2", "[1e-09, 1e+15] N mm^2"),
    (lambda: make_section(torsional_stiffness=-1.0),
     InputError, "section torsional stiffness is -1 N mm^2", "[1e-10, 1e+15] N mm^2"),
    (lambda: make_section(torsional_stiffness=1e16),
     InputError, "section torsional stiffness is 1e+16 N mm^2", "[1e-10, 1e+15] N mm^2"),
    (lambda: make_section(torsional_stiffness=1e-20),
     InputError, "section torsional stiffness is 1e-20 N mm^2", "[1e-10, 1e+15] N mm^2"),
    (lambda: make_section(max_bend=0.0), InputError, "section max bend is 0 rad", "(0, inf) rad"),
    (lambda: make_section(max_bend=np.ones(3)),
     InputError, "section max bend is array([1., 1., 1.])", "a number in (0, inf) rad"),
    (lambda: make_section(discs=2.5),
     InputError, "section discs is 2.5", "a whole number in [1, 10000]"),
    (lambda: make_section(discs=-1), InputError, "section discs is -1", "[1, 10000]"),
    (lambda: make_section(discs=3, disc_positions=(30.0,)),
     InputError, "section discs is 3 but disc_positions has 1", "leave one out"),
    (lambda: make_section(disc_positions=(10.0, 10.0, 30.0)),
     InputError, "section disc_positions[1] is 10 mm", "it must lie after 10 mm"),
    (lambda: make_section(disc_positions=(10.0, 20.0)),
     InputError, "section disc_positions ends at 20 mm",
     "the last disc must stand at the section's end, 30 mm"),
    (lambda: make_section(disc_positions=(10.0, 31.0)),
     InputError, "section disc_positions[1] is 31 mm", "[0, 30] mm"),
    (lambda: make_section(disc_positions=(True, 30.0)),
     InputError, "section disc_positions[0] is True", "a number in [0, 30] mm"),
    (lambda: make_section(disc_positions=5),
     InputError, "section disc_positions is 5", "a sequence of arc lengths in mm"),
    (lambda: make_section(disc_positions=None),
     InputError, "section disc_positions is None", "a sequence of arc lengths in mm"),
    (lambda: make_section(tendons=("a",)),
     InputError, "section tendons hold 'a'", "each must be a Tendon"),
    (lambda: make_section(tendons=make_tendon()),
     InputError, "section tendons is Tendon(name='a', offset=4.0, ",
     "a sequence of Tendon"),
    (lambda: make_section(tendons=None),
     InputError, "section tendons is None", "a sequence of Tendon"),
    (lambda: make_section(name=3), InputError, "section name is 3", "a text"),
    (lambda: make_tendon(name=" "), InputError, "tendon name is ' '", "a text that is not empty"),
    (lambda: make_tendon(name="a,b"),
     InputError, "tendon name is 'a,b'",
     "printable, without ',' and '=', and without blanks around it"),
    (lambda: make_tendon(name="a=1"),
     InputError, "tendon name is 'a=1'",
     "printable, without ',' and '=', and without blanks around it"),
    (lambda: make_tendon(name=" a"),
     InputError, "tendon name is ' a'",
     "printable, without ',' and '=', and without blanks around it"),
    (lambda: make_tendon(name="a\nb"),
     InputError, "tendon name is 'a\\nb'",
     "printable, without ',' and '=', and without blanks around it"),
    (lambda: make_tendon(offset=0.0), InputError, "tendon 'a' offset is 0 mm", "(0, inf) mm"),
    (lambda: make_tendon(offset="wide"),
     InputError, "tendon 'a' offset is 'wide'", "a number in (0, inf) mm"),
    (lambda: make_tendon(offset=((0.0, 1.0),)),
     InputError, "tendon 'a' offset has 1 knot(s)", "give a number or at least 2 knots"),
    (lambda: make_tendon(offset=((0.0, 1.0), (0.0, 2.0))),
     InputError, "tendon 'a' offset knot 1 stands at 0 mm, not after the one before it at 0",
     "arc lengths must increase"),
    (lambda: make_tendon(offset=((0.0, 1.0), (9.0, -2.0))),
     InputError, "tendon 'a' offset knot 1 is -2 mm", "(0, inf) mm"),
    (lambda: make_tendon(offset=((0.0, 1.0), (9.0,))),
     InputError, "tendon 'a' offset knot 1 is (9.0,)", "(arc length, value)"),
    (lambda: make_tendon(angle=math.inf),
     InputError, "tendon 'a' angle is inf rad", "(-inf, inf) rad"),
    (lambda: make_tendon(angle=Helix(turns=1.0, start="x"), end=60.0),
     InputError, "helix start is 'x'", "a number in (-inf, inf) rad"),
    (lambda: make_tendon(end=-1.0), InputError, "tendon 'a' end is -1 mm", "(0, inf) mm"),
    (lambda: make_tendon(end=20.0, angle=((0.0, 1.0), (9.0, 2.0))),
     InputError, "tendon 'a' angle has knots from 0 to 9 mm",
     "they must reach from 0 mm, the robot's base, to 20 mm, the"),
    (lambda: make_tendon(end=5.0, angle=((1.0, 1.0), (9.0, 2.0))),
     InputError, "tendon 'a' angle has knots from 1 to 9 mm",
     "they must reach from 0 mm, the robot's base, to 5 mm, the"),
    (lambda: make_tendon(travel=(2.0, 1.0)),
     InputError, "tendon 'a' travel is (2.0, 1.0) mm",
     "the smallest must not be above the largest"),
    (lambda: make_tendon(travel=(math.nan, 1.0)),
     InputError, "tendon 'a' travel[0] is nan mm", "(-inf, inf) mm"),
    (lambda: make_tendon(travel="12"), InputError, "tendon 'a' travel is '12'", "a pair in mm"),
    (lambda: make_tendon(travel=(False, True)),
     InputError, "tendon 'a' travel[0] is False", "a number in (-inf, inf) mm"),
    (lambda: make_tendon(travel=(math.inf, math.inf)),
     InputError, "tendon 'a' travel[0] is inf mm", "(-inf, inf) mm"),
    (lambda: make_tendon(travel=3.0), InputError, "tendon 'a' travel is 3.0", "a pair in mm"),
    (lambda: make_tendon(pushes=1), InputError, "tendon 'a' pushes is 1", "true or false"),
    (lambda: make_tendon(interpolation="quintic"),
     InputError, "tendon 'a' interpolation is 'quintic'", "it must be one of linear, cubic"),
    (lambda: make_tendon(interpolation=["cubic"]),
     InputError, "tendon 'a' interpolation is ['cubic']", "it must be one of linear, cubic"),
    (lambda: make_tendon(end=50.0).place_at([1.0, 50.1]),
     InputError, "arc length on tendon 'a' is 50.1 mm", "[0, 50] mm"),
    (lambda: make_tendon(end=50.0).place_at(math.nan),
     InputError, "arc length on tendon 'a' is nan mm", "[0, 50] mm"),
    (lambda: ContinuumRobot(()), InputError, "a robot needs at least 1 section, got none", ""),
    (lambda: ContinuumRobot((3,)),
     InputError, "a robot's sections hold 3", "each must be a Section"),
    (lambda: ContinuumRobot((make_section(name="x"),) * 2),
     InputError, "two sections are called 'x'", "names must differ"),
    (lambda: ContinuumRobot((make_section(),), name=5), InputError, "robot name is 5", "a text"),
    (pass_wide,
     InputError, "tendon 'a' offset is 4 mm in section 1", "(0, 3] mm, inside the body's radius"),
    (lambda: ContinuumRobot.from_dict(None),
     InputError, "robot is None", "it must hold the fields sections, name"),
    (lambda: ContinuumRobot.from_dict([]),
     InputError, "robot is []", "it must hold the fields sections, name"),
    (lambda: ContinuumRobot.from_dict("robot"),
     InputError, "robot is 'robot'", "it must hold the fields sections, name"),
    (lambda: ContinuumRobot.from_dict({}),
     InputError, "robot has no 'sections'", "it needs sections"),
    (lambda: ContinuumRobot.from_dict({"sections": 3}), InputError, "sections is 3", "a list"),
    (lambda: ContinuumRobot.from_dict({"sections": []}),
     InputError, "a robot needs at least 1 section, got none", ""),
    (lambda: ContinuumRobot.from_yaml("none.yaml"),
     FileFormatError, "cannot read none.yaml", "No such file or directory"),
    (lambda: ROBOT.to_yaml(Path("no") / "such" / "robot.yaml"),
     OutputError, "cannot write no/such/robot.yaml", "No such file or directory"),
    (lambda: read_robot(data=b"\xff\xfe\x00name"),
     FileFormatError, "cannot read robot.yaml",
     "it is not UTF-8 text ('utf-8' codec can't decode byte 0xff in"),
    (lambda: read_robot("6 cm", "-6 cm"),
     FileFormatError, "sections[0].length is -60 mm", "(0, 100000] mm"),
    (lambda: read_robot("6 cm", "6 kg"),
     FileFormatError, "sections[0].length",
     "'6 kg' has the wrong kind of unit: give a length such as 5mm,"),
    (lambda: read_robot("6 cm", ""), FileFormatError, "sections[0].length is None", "a length"),
    (lambda: read_robot("6 cm", "true"), FileFormatError, "sections[0].length is True", "a length"),
    (lambda: read_robot("radius: 7 mm", "radius: 4 mm"),
     FileFormatError, "tendon 'a1' offset is 5 mm in section 1 'base'",
     "(0, 4] mm, inside the body's radius"),
    (lambda: read_robot("name: a2", "name: a1"),
     FileFormatError, "two tendons are called 'a1'", "names must differ"),
    (lambda: read_robot("turns: 1", "turn: 1"),
     FileFormatError, "sections[1].tendons[0].angle has an unknown field 'turn'",
     "did you mean 'turns'?"),
    (lambda: read_robot("discs: 6", "discs: 0"),
     FileFormatError, "sections[0].discs is 0", "[1, 10000], or leave it out"),
    (lambda: read_robot("discs: 6", "discs: six"),
     FileFormatError, "sections[0].discs is 'six'",
     "a whole number in [1, 10000], or leave it out"),
    (lambda: read_robot("angle: 0 deg", "angle: 0 deg, angle: 1"),
     FileFormatError, "line 10", "the field 'angle' is given twice"),
    (lambda: read_robot("[10 cm, 2 mm]", "[5 cm, 2 mm]"),
     FileFormatError, "tendon 'h' offset has knots from 0 to 50 mm",
     "they must reach from 0 mm, the robot's base, to 100 mm, the"),
    (lambda: read_robot("1e-3 N m^2", "3 N"),
     FileFormatError, "sections[0].bending_stiffness",
     "'3 N' has the wrong kind of unit: give a rigidity such as"),
    (lambda: read_robot("sections:", "section:"),
     FileFormatError, "robot has an unknown field 'section'", "did you mean 'sections'?"),
    (lambda: read_robot("- {name: a1", "- {nam: a1"),
     FileFormatError, "sections[0].tendons[0] has an unknown field 'nam'", "did you mean 'name'?"),
    (lambda: read_robot("name: two", "name: [two"),
     FileFormatError, "not YAML in line 2", "expected ',' or ']', but got ':'"),
    (lambda: read_robot("pushes: true", "pushes: 1"),
     FileFormatError, "sections[1].tendons[1].pushes is 1", "true or false"),
    (lambda: read_robot("[[0, 6 mm], [10 cm, 2 mm]]", "[0, 6 mm]"),
     FileFormatError, "sections[1].tendons[0].offset[0] is 0", "a list of 2"),
    (lambda: read_robot("[-10 mm, null]", "[5, 1]"),
     FileFormatError, "sections[0].tendons[0]",
     "tendon 'a1' travel is (5.0, 1.0) mm: the smallest must not be"),
    (lambda: read_robot("[-10 mm, null]", "5"),
     FileFormatError, "sections[0].tendons[0].travel is 5", "a list of 2"),
    (lambda: read_robot("end: 80", "end: 60"),
     FileFormatError, "tendon 'b' end is 60 mm",
     "it belongs to section 2 and must lie in (60, 100] mm"),
    (lambda: read_robot("name: base", "name: 3"), FileFormatError, "sections[0].name is 3", "text"),
    (lambda: read_robot("turns: 1", "turns: 1 mm"),
     FileFormatError, "sections[1].tendons[0].angle.turns",
     "'1 mm' has the wrong kind of unit: give an angle in turns"),
    (lambda: read_robot("discs: 6", "torsional_stiffness: 0"),
     FileFormatError, "sections[0].torsional_stiffness is 0 N mm^2",
     "[1e-10, 1e+15] N mm^2, or leave it out"),
    (lambda: read_robot("name: a1", "name: 'a=1'"),
     FileFormatError, "sections[0].tendons[0]",
     "tendon name is 'a=1': it must be printable, without ',' and"),
    (lambda: ArcModel(ROBOT).shape([1.0, 2.0]),
     InputError, "displacements has shape (2,)",
     "(..., 3), one for each of the tendons ['t00', 't01', 't02']"),
    (lambda: ArcModel(ROBOT).shape(1.0),
     InputError, "displacements has shape ()",
     "(..., 3), one for each of the tendons ['t00', 't01', 't02']"),
    (lambda: ArcModel(ROBOT).shape([1.0, np.inf, 0.0]),
     InputError, "displacement of tendon 't01' is inf", "not finite"),
    (lambda: ArcModel(ROBOT).shape([[0.0, 0.0, 0.0], [0.0, 0.0, np.inf]]),
     InputError, "displacement of tendon 't02' is inf", "not finite"),
    (lambda: ArcModel(ROBOT).shape(["a", "b", "c"]),
     InputError, "displacements is ['a', 'b', 'c']", "a number or an array of numbers"),
    (lambda: EnergyModel(ROBOT).shape([1.0, 2.0]),
     InputError, "displacements has shape (2,)",
     "(..., 3), one for each of the tendons ['t00', 't01', 't02']"),
    (lambda: EnergyModel(ROBOT).shape([1.0, 2.0, math.inf]),
     InputError, "displacement of tendon 't02' is inf", "not finite"),
    (lambda: ArcModel(OPPOSED).shape([5.0, 0.0]).require(),
     GeometryError, "tendon 't00' is pulled 2.5 mm more than the nearest shape gives way",
     "it would have to stretch (let out those on the other side)"),
    (lambda: ArcModel(ROBOT).shape([1.0, 1.0, 1.0]).require(),
     GeometryError, "tendon 't00' is pulled 1 mm more than the nearest shape gives way",
     "it would have to stretch (let out those on the other side)"),
    (lambda: ArcModel(ROBOT).shape([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]).require(),
     GeometryError, "tendon 't00' is pulled 1 mm more than the nearest shape gives way",
     "(displacements [1])"),
    (lambda: ArcModel(RODS).shape([5.0, -10.0]).require(),
     GeometryError, "rod 't01' is pushed 2.5 mm more than the nearest shape gives way",
     "it would have to be squeezed (pull those on the other side)"),
    (lambda: LinkageModel(ROBOT).points([1.0, 1.0, 1.0]),
     GeometryError, "tendon 't00' is pulled 1 mm more than the nearest shape gives way",
     "it would have to stretch (let out those on the other side)"),
    (lambda: ArcModel(CONVERGING),
     GeometryError, "tendon 'a' changes its offset or angle on its way",
     "the arc model takes tendons parallel to the backbone up to"),
    (lambda: ArcModel(HELICAL),
     GeometryError, "tendon 'a' changes its offset or angle on its way",
     "the arc model takes tendons parallel to the backbone up to"),
    (lambda: ArcModel(SHORT),
     GeometryError, "tendon 'a' ends at 60 mm, before its section does at 100 mm",
     "the arc model takes tendons parallel to the backbone up to"),
    (lambda: ArcModel(BARE), GeometryError, "robot 'robot' has no tendons", "nothing can move it"),
    (lambda: LinkageModel(HELICAL),
     GeometryError, "tendon 'a' changes its offset or angle on its way",
     "the linkage model takes tendons parallel to the backbone up"),
    (lambda: EnergyModel(BARE),
     GeometryError, "robot 'robot' has no tendons", "nothing can move it"),
    (lambda: LinkageModel(ROBOT, segments=0), InputError, "segments is 0", "[1, 1000000]"),
    (lambda: LinkageModel(ROBOT, segments=2.5),
     InputError, "segments is 2.5", "a whole number in [1, 1000000]"),
    (lambda: LinkageModel(ROBOT, segments="many"),
     InputError, "segments is 'many'", "a whole number in [1, 1000000]"),
    (lambda: LinkageModel(ROBOT, segments=(3, 4)),
     InputError, "segments has 2 numbers", "give one, or 1, one a section"),
    (lambda: LinkageModel(ROBOT, segments=(0,)), InputError, "segments[0] is 0", "[1, 1000000]"),
    (lambda: EnergyModel(ROBOT, segment="line"),
     InputError, "segment is 'line'", "one of chord, arc, channel"),
    (lambda: EnergyModel(ROBOT, segment=["chord"]),
     InputError, "segment is ['chord']", "one of chord, arc, channel"),
    (lambda: EnergyModel(ROBOT, between=-1), InputError, "between is -1", "[0, 1000]"),
    (lambda: EnergyModel(ROBOT, tendon_stiffness=0.0),
     InputError, "tendon stiffness is 0 N", "(0, inf) N"),
    (lambda: EnergyModel(ROBOT, tendon_stiffness=np.ones(2)),
     InputError, "tendon stiffness is array([1., 1.])", "a number in (0, inf) N"),
    (lambda: EnergyModel(ROBOT, tendon_stiffness=-math.inf),
     InputError, "tendon stiffness is -inf N", "(0, inf) N"),
    (lambda: EnergyModel(ROBOT, tolerance=math.nan),
     InputError, "tolerance is nan mm", "(0, 1] mm"),
    (lambda: RodModel(ROBOT, tip_force=(1.0, 2.0)),
     InputError, "tip_force has shape (2,)", "(3,)"),
    (lambda: RodModel(ROBOT, distributed_force=(0.0, math.inf, 0.0)),
     InputError, "distributed_force has values that are not finite (NaN or infinite)", ""),
    (lambda: EnergyModel(ROBOT).trace_path([0.0] * 3, varied="load"),
     InputError, "varied is 'load'", "one of loads, command, both"),
    (lambda: EnergyModel(ROBOT).trace_path([0.0] * 3, given="tension"),
     InputError, "given is 'tension'", "one of displacements, tensions"),
    (lambda: EnergyModel(ROBOT).trace_path([0.0] * 3, factors=(1.0,)),
     InputError, "factors has shape (1,)", "(2,)"),
    (lambda: RodModel(ROBOT).jacobian(3), InputError, "shape is 3", "a Shape"),
    (lambda: RodModel(ROBOT).jacobian(RodModel(ROBOT).shape(np.zeros((0, 3)))),
     InputError, "shape holds no shapes", "nothing to differentiate"),
    (lambda: RodModel(ROBOT, steps=3), InputError, "steps is 3", "[10, 100000]"),
    (lambda: RodModel(ROBOT, tendon_stiffness=-1.0),
     InputError, "tendon stiffness is -1 N", "(0, inf) N"),
    (lambda: RodModel(ROBOT).shape_under_tensions([1.0, -1.0, 0.0]),
     InputError, "tension of tendon 't01' is -1 N", "[0, inf) N, for a cable does not push"),
    (lambda: ROBOT.forward({"t": 1.0}),
     InputError, "there is no tendon 't'", "those of robot 'robot' are t00, t01, t02"),
    (lambda: ROBOT.forward({"t00": "far"}),
     InputError, "displacement of tendon 't00' is 'far'", "a number or an array of numbers"),
    (lambda: ROBOT.forward({"t00": [1.0, 2.0], "t01": [1.0, 2.0, 3.0]}),
     InputError, "these shapes do not go together", "t00 (2,), t01 (3,), t02 ()"),
    (lambda: ROBOT.inverse([1.0, 2.0]),
     InputError, "target has shape (2,)", "(3,), (4, 4) or (k, 3)"),
    (lambda: ROBOT.inverse(PLACE, tolerence=0.1),
     InputError, "the inverse has no option 'tolerence'",
     "it has initial, starts, tolerance, angle_tolerance,"),
    (lambda: ROBOT.forward([0.0, 0.0, 0.0], model=["arc"]),
     InputError, "there is no model ['arc']", "arc, linkage, energy, rod"),
    (lambda: make_section(tendons=NotIterable()),
     InputError, "section tendons is ", "a sequence of Tendon"),
    (lambda: ROBOT.forward([0.0, 0.0, 0.0], model="pcc"),
     InputError, "there is no model 'pcc'", "choose one of arc, linkage, energy, rod"),
    (lambda: ROBOT.forward([0.0, 0.0, 0.0], steps=20),
     InputError, "the arc model has no option 'steps'", "it has tolerance, between"),
    (lambda: ROBOT.inverse(np.eye(4), direction=(0, 0, 1)),
     InputError, "target has shape (4, 4)", "a direction goes with a place, (3,), only"),
    (lambda: ROBOT.forward(np.zeros((101, 3))).plot(),
     InputError, "the batch has 101 shapes", "at most 100 are drawn"),
    (lambda: dataclasses.replace(shape(), frames=shape().frames[:1]),
     InputError, "shape's frames has shape (1, 21, 4, 4)", "(2, 21, 4, 4)"),
    (lambda: dataclasses.replace(shape(), slack=shape().slack[:1]),
     InputError, "shape's slack has shape (1, 3)", "(2, 3)"),
    (lambda: dataclasses.replace(shape(), residual=shape().residual[:1]),
     InputError, "shape's residual has shape (1,)", "(2,)"),
    (lambda: dataclasses.replace(shape(), reason=shape().reason[:1]),
     InputError, "shape's reason has shape (1,)", "(2,)"),
    (lambda: dataclasses.replace(shape(), tendon_lengths=shape().tendon_lengths[:1]),
     InputError, "shape's tendon_lengths has shape (1, 3)", "(2, 3)"),
    (lambda: dataclasses.replace(shape(), disc_arc_length=np.array([10.0, 12.3])),
     InputError, "shape's arc_length has no station at the disc at 12.3 mm", ""),
    (lambda: arc_frames(ROBOT, [[0.1, 0.2]], arc_length=[0.0, 101.0]),
     InputError, "arc_length spans [0, 101] mm", "[0, 100] mm"),
    (lambda: arc_frames(ROBOT, [[0.1, 0.2]], arc_length=[5.0, 1.0]),
     InputError, "arc_length must not decrease", ""),
    (lambda: arc_frames(ROBOT, [[0.1, 0.2]], arc_length=5.0),
     InputError, "arc_length has shape ()", "(k,), k at least 1"),
    (lambda: arc_frames(ROBOT, [[0.1, 0.2]], arc_length=[0.0, math.nan]),
     InputError, "arc_length spans [nan, nan] mm", "[0, 100] mm"),
    (lambda: jacobian(ROBOT, [0.1, 0.2]), InputError, "bends has shape (2,)", "(..., 1, 2)"),
    (lambda: displacements_for(ROBOT, [[math.nan, 0.0]]),
     InputError, "bends has values that are not finite (NaN or infinite)", ""),
    (lambda: solve_tip(TWO.sections[0], PLACE),
     InputError, "robot is of type Section", "a ContinuumRobot"),
    (lambda: solve_tip(TWO, (1.0, 2.0)), InputError, "target has shape (2,)", "(3,)"),
    (lambda: solve_tip(TWO, (1.0, 2.0, math.nan)),
     InputError, "target has values that are not finite (NaN or infinite)", ""),
    (lambda: solve_tip(TWO, "abc"),
     InputError, "target is 'abc'", "a number or an array of numbers"),
    (lambda: solve_tip(TWO, ["30", "0", "60"]),
     InputError, "target is ['30', '0', '60']", "a number or an array of numbers"),
    (lambda: solve_tip(TWO, [True, False, True]),
     InputError, "target is [True, False, True]", "a number or an array of numbers"),
    (lambda: solve_tip(TWO, (1e200, 0, 1e200)),
     InputError, "target has the value 1e+200 mm", "[-1e+09, 1e+09] mm"),
    (lambda: solve_tip(TWO, PLACE, direction=(0, 0, 0)),
     InputError, "direction is (0, 0, 0)", "a direction must not be zero"),
    (lambda: solve_tip(TWO, PLACE, direction=np.ones((2, 3))),
     InputError, "direction has shape (2, 3)", "(3,)"),
    (lambda: solve_tip(TWO, PLACE, initial=[[0, 0]]),
     InputError, "initial has shape (1, 2)", "(2, 2)"),
    (lambda: solve_tip(TWO, PLACE, initial=np.full((2, 2), 1e300)),
     InputError, "initial has the value 1e+300", "[-1e+09, 1e+09]"),
    (lambda: solve_tip(TWO, PLACE, starts=0), InputError, "starts is 0", "[1, 256]"),
    (lambda: solve_tip(TWO, PLACE, tolerance=0.0), InputError, "tolerance is 0 mm", "(0, inf) mm"),
    (lambda: solve_pose(TWO, np.eye(3)), InputError, "target has shape (3, 3)", "(4, 4)"),
    (lambda: solve_pose(TWO, scale(1.0, 1.0, -1.0)),
     InputError, "target is no frame", "its axes are left-handed, a mirror image: they must be"),
    (lambda: solve_pose(TWO, scale(1.0, 1.0, 1.0, 2.0)),
     InputError, "target is no frame",
     "its last row is [0.0, 0.0, 0.0, 2.0]: it must be [0, 0, 0, 1]"),
    (lambda: solve_pose(TWO, scale(2.0, 2.0, 2.0)),
     InputError, "target is no frame", "its axes miss being orthonormal by 3: by 1e-06 they may"),
    (lambda: solve_curve(TWO, [[0, 0, 1e200]]),
     InputError, "points has the value 1e+200 mm", "[-1e+09, 1e+09] mm"),
    (lambda: solve_curve(TWO, np.zeros((0, 3))),
     InputError, "points has shape (0, 3)", "(k, 3), k at least 1"),
    (lambda: solve_curve(TWO, [[0, 0, 99.0]]),
     InputError, "arc_length of the points spans [99, 99] mm", "[0, 60] mm, the robot's length"),
    (lambda: solve_curve(TWO, [[0, 0, 9.0]], weights=[-1]),
     InputError, "weights has -1", "none may be negative, nor all 0"),
    (lambda: solve_curve(TWO, [[0, 0, 9.0]], arc_length=[1, 2]),
     InputError, "arc_length has shape (2,)", "(1,)"),
    (lambda: solve_tip(HELICAL, PLACE),
     GeometryError, "tendon 'a' changes its offset or angle on its way",
     "the inverse, like the workspace, takes sections that bend in"),
    (lambda: solve_tip(STUCK, PLACE),
     GeometryError, "robot 'robot' has no legal shape",
     "no bends within its limits move all its tendons within their"),
    (lambda: solve_section(1.0, (1e200, 0.0, 1e200)),
     InputError, "target has the value 1e+200 mm", "[-1e+09, 1e+09] mm"),
    (lambda: solve_section(1e300, (0.0, 0.0, 1.0)),
     InputError, "length is 1e+300 mm", "(0, 1e+09] mm"),
    (lambda: solve_section(-1.0, (0.0, 0.0, 1.0)), InputError, "length is -1 mm", "(0, 1e+09] mm"),
    (lambda: solve_section(1.0, (0.0, 0.0, 1.0), max_bend=7.0),
     InputError, "max_bend is 7 rad", "(0, 6.28319] rad"),
    (lambda: solve_section(1.0, np.ones((2, 3))), InputError, "target has shape (2, 3)", "(3,)"),
    (lambda: solve_extensible((0.0, 0.0, 1e200)),
     InputError, "tips has the value 1e+200 mm", "[-1e+09, 1e+09] mm"),
    (lambda: solve_extensible([PLACE, (0.0, 0.0, 0.0)]),
     InputError, "tip (0, 0, 0) mm lies at the start of the section or straight behind it,",
     "z must be positive where x = y = 0"),
    (lambda: solve_extensible([PLACE, (0.0, 0.0, -3.0)]),
     InputError, "tip (0, 0, -3) mm lies at the start of the section or straight behind it,",
     "z must be positive where x = y = 0"),
    (lambda: solve_joints((0.0, 0.0, 1.0)),
     InputError, "joints has shape (3,)", "(m, 3), m at least 1"),
    (lambda: solve_joints([(0.0, 0.0, 10.0), (0.0, 0.0, 10.0)]),
     GeometryError, "joint 2 lies straight behind the start of section 2, where no arc leads", ""),
    (lambda: solve_joints([(0.0, 0.0, 10.0), (0.0, 0.0, 7.0)]),
     GeometryError, "joint 2 lies straight behind the start of section 2, where no arc leads", ""),
    (lambda: solve_direction([(0.0, 0.0, 1.0), (0.0, 0.0, 0.0)]),
     InputError, "tangents holds (0, 0, 0)", "a direction must not be zero"),
    (lambda: sample_workspace(TWO, 0), InputError, "count is 0", "[1, 10000000]"),
    (lambda: sample_workspace(TWO, 5, seed=-1), InputError, "seed is -1", "[0, inf]"),
    (lambda: sample_workspace(TWO, 5, bend_cap=0.0),
     InputError, "bend_cap is 0 rad", "(0, inf) rad"),
    (lambda: sample_workspace(HELICAL, 5),
     GeometryError, "tendon 'a' changes its offset or angle on its way",
     "the inverse, like the workspace, takes sections that bend in"),
    (lambda: sample_workspace(STUCK, 5),
     GeometryError, "robot 'robot' has no legal shape",
     "no bends within its limits move all its tendons within their"),
    (lambda: measure_volume(np.zeros((4, 2)), cell=1.0),
     InputError, "tips has shape (4, 2)", "(..., 3)"),
    (lambda: measure_volume(np.zeros((0, 3)), cell=1.0),
     InputError, "tips has shape (0, 3)", "(n, 3), n at least 1"),
    (lambda: measure_volume(np.zeros((4, 3)), cell=-1.0),
     InputError, "cell is -1 mm", "[1e-06, 1e+09] mm"),
    (lambda: measure_volume(np.zeros((4, 3)), cell=1e200),
     InputError, "cell is 1e+200 mm", "[1e-06, 1e+09] mm"),
    (lambda: measure_volume(np.full((4, 3), 1e200), cell=1.0),
     InputError, "tips has the value 1e+200 mm", "[-1e+09, 1e+09] mm"),
    (lambda: tendon_travel(TWO, [[0.0, 0.0]]), InputError, "bends has shape (1, 2)", "(..., 2, 2)"),
    (lambda: tendon_travel(HELICAL, np.zeros((1, 2))),
     GeometryError, "tendon 'a' changes its offset or angle on its way",
     "a workspace takes sections that bend in arcs, by tendons"),
    (lambda: manipulability(TWO, np.zeros((2, 2)), part="speed"),
     InputError, "part is 'speed'", "it must be one of position, rotation, pose"),
    (lambda: manipulability(TWO, np.zeros((2, 2)), part=["pose"]),
     InputError, "part is ['pose']", "it must be one of position, rotation, pose"),
    (lambda: manipulability(HELICAL, np.zeros((1, 2))),
     GeometryError, "tendon 'a' changes its offset or angle on its way",
     "the inverse, like the workspace, takes sections that bend in"),
    (lambda: measure_dexterity(TWO, (1.0, 2.0)), InputError, "place has shape (2,)", "(3,)"),
    (lambda: measure_dexterity(TWO, PLACE, directions=0),
     InputError, "directions is 0", "[1, 100000]"),
    (lambda: measure_dexterity(TWO, (1e200, 0, 0)),
     InputError, "place has the value 1e+200 mm", "[-1e+09, 1e+09] mm"),
    (lambda: map_dexterity(sample(), cell=0.0),
     InputError, "cell is 0 mm", "[0.06, 1e+09] mm, at most 1000 cells along the robot's 60 mm"),
    (lambda: map_dexterity(sample(), cell=1e-3),
     InputError, "cell is 0.001 mm",
     "[0.06, 1e+09] mm, at most 1000 cells along the robot's 60 mm"),
]
# fmt: on
"""What is asked, the error, the field that the message names, and what it states as legal."""


@pytest.mark.parametrize(("call", "error", "field", "legal"), REFUSALS)
def test_refused(
    call: Callable[[], object], error: type[BozziniError], field: str, legal: str
) -> None:
    with pytest.raises(error) as caught:
        call()
    line = str(caught.value)
    assert line.startswith(field) and legal in line
    assert "\n" not in line and len(line) < 300


@pytest.mark.parametrize("name", list(CONTINUUM_MODELS))
@pytest.mark.parametrize(
    ("robot", "options", "field", "legal"),
    [
        (None, {}, "robot is of type NoneType", "a ContinuumRobot"),
        (3, {}, "robot is of type int", "a ContinuumRobot"),
        (ROBOT.sections[0], {}, "robot is of type Section", "a ContinuumRobot"),
        (ROBOT, {"tolerance": 0.0}, "tolerance is 0 mm", "(0, 1] mm"),
    ],
)
def test_every_model_refuses(
    name: str, robot: Any, options: Mapping[str, Any], field: str, legal: str
) -> None:
    with pytest.raises(InputError) as caught:
        CONTINUUM_MODELS[name](robot, **options)
    assert str(caught.value).startswith(field) and legal in str(caught.value)


@pytest.mark.parametrize(
    "call", [solve_tip, sample_workspace, manipulability, tendon_travel], ids=lambda f: f.__name__
)
def test_no_model_is_advised_where_only_arcs_will_do(call: Callable[..., object]) -> None:
    with pytest.raises(GeometryError) as caught:
        call(HELICAL, PLACE if call is solve_tip else 5 if call is sample_workspace else [[0, 0]])
    assert "take the energy" not in str(caught.value)


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(BozziniError):
        ROBOT.to_yaml(tmp_path / "no" / "robot.yaml")
    assert not list(tmp_path.iterdir())
