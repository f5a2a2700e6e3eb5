"""What can be fitted of a robot: names of unknowns, and a robot with changed numbers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, cast

import numpy as np

from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Json, Shown
from .calibration import Marker, RobotCalibration, convert_commands
from .dynamics import DynamicsOptions
from .kinematics import ContinuumRobot
from .section import Section, Tendon

Group = Literal["sections", "tendons", "markers", "base", "commands", "motion"]
Change = Literal["factor", "shift"]
"""Whether a number is multiplied or moved; a factor is searched by its logarithm."""

WIDEST = 6.0
"""Largest logarithm of the factor of a stiffness."""
WIDEST_LENGTH = 1.0
"""Largest logarithm of the factor of a length."""

MOST_FRICTION = 2.0
"""Largest coefficient of friction."""

WIDEST_ZERO_MM = 20.0
"""Largest change of a tendon's zero [mm]."""


@dataclass(frozen=True)
class Known:
    """How a field is changed: factor or shift, its unit, and the bounds of the change.

    A search of what may not be negative begins at `begin` where the number is 0.
    """

    change: Change
    unit: str
    low: float = -math.inf
    high: float = math.inf
    begin: float = 0.0


def _factor(unit: str, widest: float) -> Known:
    return Known("factor", unit, -widest, widest)


FIELDS: dict[Group, dict[str, Known]] = {
    "sections": {
        "length": _factor("mm", WIDEST_LENGTH),
        "bending_stiffness": _factor("N mm^2", WIDEST),
        "torsional_stiffness": _factor("N mm^2", WIDEST),
        "stretch_stiffness": _factor("N", WIDEST),
        "shear_stiffness": _factor("N", WIDEST),
        "modulus": _factor("MPa", WIDEST),
        "line_weight": _factor("N/mm", WIDEST),
    },
    "tendons": {
        "offset": _factor("mm", WIDEST_LENGTH),
        "angle": Known("shift", "rad", -math.pi, math.pi),
        "stiffness": _factor("N", 2.0 * WIDEST),
        "pretension": Known("shift", "N", begin=0.1),
        "friction": Known("shift", "", high=MOST_FRICTION, begin=0.05),
        "zero": Known("shift", "mm", -WIDEST_ZERO_MM, WIDEST_ZERO_MM),
    },
    "markers": {
        "arc_length": Known("shift", "mm"),
        "x": Known("shift", "mm"),
        "y": Known("shift", "mm"),
        "z": Known("shift", "mm"),
    },
    "base": {
        **{f"position.{axis}": Known("shift", "mm") for axis in "xyz"},
        **{f"rotation.{axis}": Known("shift", "rad", -4.0, 4.0) for axis in "xyz"},
    },
    "commands": {
        "scale": _factor("", WIDEST_LENGTH),
        "backlash": Known("shift", "mm", begin=0.02),
    },
    "motion": {
        "damping_time": _factor("s", WIDEST),
        "drag": _factor("N s/mm^2", WIDEST),
        "tip_weight": _factor("N", WIDEST),
    },
}
"""Fields that can be fitted."""

STIFFNESSES = ("bending_stiffness", "torsional_stiffness", "stretch_stiffness", "shear_stiffness")
"""Fields of a section that are in proportion to its modulus."""

PIECES_LOOKED_AT = 200
"""Places of a section where a tendon is checked to stay inside of the body."""
LEAST_OFFSET_MM = 1e-9

POSES = ("position", "rotation")


@dataclass(frozen=True)
class RobotSetup(Shown):
    """A robot, how it is commanded, and what is seen of it.

    Parameters
    ----------
    robot : ContinuumRobot
    markers : tuple of Marker
        Points that are seen.
    zeros : tuple of float
        What is added to the displacement of each tendon [mm].
    scale : float
        By what commands are multiplied.
    backlash : float
        Half the play between a command and the tendon [mm].
    dynamics : DynamicsOptions, optional
        How it moves; None of a robot whose shapes are at rest.
    """

    robot: ContinuumRobot
    markers: tuple[Marker, ...] = ()
    zeros: tuple[float, ...] = ()
    scale: float = 1.0
    backlash: float = 0.0
    dynamics: DynamicsOptions | None = None

    @classmethod
    def of(cls, robot: ContinuumRobot) -> RobotSetup:
        """Return a robot with what its calibration holds."""
        known = robot.calibration or RobotCalibration()
        zeros = tuple(known.order_zeros(robot.tendon_names).tolist())
        return cls(robot, known.markers, zeros, known.scale, known.backlash)

    def convert(self, commands: Floats) -> Floats:
        """Return what reaches the tendons of commands (n, t) in the order of time."""
        zeros = np.asarray(self.zeros) if any(self.zeros) else None
        return convert_commands(commands, scale=self.scale, zeros=zeros, backlash=self.backlash)


@dataclass(frozen=True)
class Unknown(Shown):
    """One number of a fit: a change of the same field of some items.

    Parameters
    ----------
    name : str
        As it was asked for, ``sections.2.bending_stiffness``.
    group : str
        Of which items.
    field : str
        Which field.
    items : tuple of int
        Indices of the items.
    """

    name: str
    group: Group
    field: str
    items: tuple[int, ...] = ()

    @property
    def known(self) -> Known:
        """How the field is changed."""
        return FIELDS[self.group][self.field]

    @property
    def moves_robot(self) -> bool:
        """Whether the shape depends on it, and not only where it is seen."""
        return self.group in ("sections", "tendons", "commands", "motion")

    def limit(self, setup: RobotSetup) -> tuple[float, float, float]:
        """Return the bounds of the change, and where a search begins."""
        known = self.known
        if self.field == "offset":
            inside = min(_measure_margin(setup.robot, index) for index in self.items)
            return known.low, min(known.high, inside), 0.0
        if not known.begin:
            return known.low, known.high, 0.0
        value = self.read(setup) or 0.0
        return -value, known.high - value, known.begin if value == 0.0 else 0.0

    def read(self, setup: RobotSetup) -> float | None:
        """Return the number before it is changed, or None if items differ or have a profile."""
        values = {_read_field(setup, self.group, self.field, index) for index in self.items or (0,)}
        value = values.pop()
        return float(value) if not values and isinstance(value, (int, float)) else None


def _measure_margin(robot: ContinuumRobot, index: int) -> float:
    """Return the logarithm of by how much a tendon's offset may grow inside of the body."""
    tendon, margins = robot.tendons[index], []
    for section, start in zip(robot.sections, robot.section_starts, strict=True):
        end = min(start + section.length, robot.tendon_ends[index])
        if start < end:
            places = np.linspace(start, end, PIECES_LOOKED_AT)
            most = max(float(tendon.offset_at(places).max()), LEAST_OFFSET_MM)
            margins.append(math.log(section.radius / most))
    return max(min(margins) - 1e-6, 0.0)


def _read_field(setup: RobotSetup, group: Group, name: str, index: int) -> object:
    if group == "base":
        return 0.0 if name.startswith("rotation") else setup.robot.base_position[_axis(name)]
    if group == "commands":
        return getattr(setup, name)
    if group == "motion":
        return getattr(setup.dynamics, name)
    if name == "zero":
        return setup.zeros[index] if setup.zeros else 0.0
    if group == "markers":
        marker = setup.markers[index]
        place = setup.robot.length if marker.arc_length is None else marker.arc_length
        return place if name == "arc_length" else marker.offset[_axis(name)]
    if group == "tendons":
        value: object = getattr(setup.robot.tendons[index], name)
    elif name == "modulus":
        wire = setup.robot.sections[index].wire
        value = None if wire is None else wire.modulus
    else:
        value = getattr(setup.robot.sections[index], name)
    return value if isinstance(value, (int, float)) else None


def _axis(name: str) -> int:
    return "xyz".index(name[-1])


# Names: group, which, field.


def parse_unknowns(names: Sequence[str], setup: RobotSetup) -> tuple[Unknown, ...]:
    """Return the unknowns that names stand for.

    A name is a path as in the robot file: ``sections.2.bending_stiffness``, ``tendons.T1.zero``,
    ``base.position.x``, ``markers.tip.z``, ``commands.scale``, ``motion.damping_time``. Sections,
    tendons and markers go by name or by number from 1; ``*`` is all of them with one number,
    ``each`` all with one each.
    ``sections.2.tendons.zero`` is one number for the tendons that end in section 2, and
    ``sections.each.tendons.zero`` one for those of each section. ``base`` is all of its pose,
    ``base.position`` its three coordinates.

    Raises
    ------
    InputError
        If a name is none of these, is there twice, or changes what has no value.
    """
    found = [one for name in names for one in _parse(name.strip(), setup)]
    for index, one in enumerate(found):
        _check_value(one, setup)
        for other in found[:index]:
            same = other.group == one.group and other.field == one.field
            if same and (set(other.items) == set(one.items) or other.name == one.name):
                raise InputError(f"'{one.name}' is free more than once: name it once")
    return tuple(found)


def _parse(name: str, setup: RobotSetup) -> list[Unknown]:
    head, *rest = name.split(".")
    if head == "base":
        fields = [field for field in FIELDS["base"] if field.startswith(".".join(rest))]
        if rest and ".".join(rest) not in (*POSES, *FIELDS["base"]):
            raise _refuse(name, (f"base.{field}" for field in ("position", *FIELDS["base"])))
        return [Unknown(f"base.{field}", "base", field) for field in fields]
    if head == "commands" or (head == "motion" and setup.dynamics is not None):
        group = cast("Group", head)
        _check_field(name, group, ".".join(rest))
        return [Unknown(name, group, rest[0])]
    if head == "motion":
        raise InputError(f"'{name}' is of a motion: the shapes are at rest, not in time")
    if head not in ("sections", "tendons", "markers") or len(rest) < 2:
        raise _refuse(name, ("sections.1.bending_stiffness", "tendons.*.stiffness",
                             "sections.each.tendons.zero", "base", "commands.scale"))  # fmt: skip
    group, which, field = cast("Group", head), rest[0], ".".join(rest[1:])
    labels = _list_labels(group, setup)
    if group == "sections" and field.startswith("tendons."):
        field = field.removeprefix("tendons.")
        _check_field(name, "tendons", field)
        ends = setup.robot.tendon_sections
        sets = {k: tuple(int(i) for i in np.flatnonzero(ends == k)) for k in range(len(labels))}
        chosen = _choose(name, which, labels)
        pick = [tuple(i for k in one for i in sets[k]) for one in chosen]
        names = [_spell(group, labels, one, f"tendons.{field}") for one in chosen]
        return [
            Unknown(own, "tendons", field, one) for own, one in zip(names, pick, strict=True) if one
        ]
    _check_field(name, group, field)
    chosen = _choose(name, which, labels)
    return [Unknown(_spell(group, labels, one, field), group, field, one) for one in chosen]


def _list_labels(group: Group, setup: RobotSetup) -> list[str]:
    """Return how items are called."""
    if group == "sections":
        return [section.name or str(k + 1) for k, section in enumerate(setup.robot.sections)]
    if group == "tendons":
        return list(setup.robot.tendon_names)
    return [marker.name for marker in setup.markers]


def _spell(group: Group, labels: Sequence[str], items: tuple[int, ...], field: str) -> str:
    which = labels[items[0]] if len(items) == 1 else "*"
    return f"{group}.{which}.{field}"


def _choose(name: str, which: str, labels: Sequence[str]) -> list[tuple[int, ...]]:
    """Return the items that each unknown changes."""
    every = range(len(labels))
    if which == "*":
        return [tuple(every)]
    if which == "each":
        return [(index,) for index in every]
    if which in labels:
        return [(list(labels).index(which),)]
    if which.isdecimal() and 1 <= int(which) <= len(labels):
        return [(int(which) - 1,)]
    raise InputError(
        f"'{name}' names '{which}': there are {', '.join(labels) or 'none'}, * for all with one "
        "number, each for all with one each"
    )


def _check_field(name: str, group: Group, field: str) -> None:
    if field not in FIELDS[group]:
        raise _refuse(name, FIELDS[group])


def _refuse(name: str, legal: Iterable[str]) -> InputError:
    return InputError(f"'{name}' cannot be fitted: use {', '.join(legal)}")


def _check_value(one: Unknown, setup: RobotSetup) -> None:
    """Raise `InputError` for a factor of nothing or of infinity."""
    if one.known.change != "factor" or one.field == "modulus":
        return
    value = one.read(setup)
    if value is not None and (value == 0.0 or not math.isfinite(value)):
        where = "" if one.group == "motion" else " in the robot file"
        raise InputError(f"'{one.name}' is {value:g}{where}: give a value from which to start")


# Changes.


def change_setup(setup: RobotSetup, unknowns: Sequence[Unknown], changes: Floats) -> RobotSetup:
    """Return the setup with changed numbers; a factor is the exponential of its change.

    Raises
    ------
    InputError
        If a number is not legal.
    """
    by_section: dict[int, dict[str, float]] = {}
    by_tendon: dict[int, dict[str, float]] = {}
    by_marker: dict[int, dict[str, float]] = {}
    tables: Mapping[str, dict[int, dict[str, float]]] = {
        "sections": by_section, "tendons": by_tendon, "markers": by_marker,
    }  # fmt: skip
    base, scale, backlash = np.zeros((2, 3)), setup.scale, setup.backlash
    dynamics = setup.dynamics
    for one, change in zip(unknowns, np.asarray(changes).tolist(), strict=True):
        if one.group == "base":
            base[POSES.index(one.field.partition(".")[0]), _axis(one.field)] += change
        elif one.group == "motion" and dynamics is not None:
            value = getattr(dynamics, one.field) * math.exp(change)
            dynamics = dataclasses.replace(dynamics, **{one.field: value})
        elif one.field == "scale":
            scale *= math.exp(change)
        elif one.field == "backlash":
            backlash += change
        else:
            for index in one.items:
                own = tables[one.group].setdefault(index, {})
                own[one.field] = own.get(one.field, 0.0) + change
    zeros = list(setup.zeros or [0.0] * len(setup.robot.tendon_names))
    for index, own in by_tendon.items():
        zeros[index] += own.pop("zero", 0.0)
    robot = _change_robot(setup.robot, by_section, by_tendon)
    markers = tuple(
        _change_marker(setup, index, by_marker.get(index, {}))
        for index in range(len(setup.markers))
    )
    if any("length" in own for own in by_section.values()):
        stretch = _map_lengths(setup.robot, robot)
        markers = tuple(
            marker
            if marker.arc_length is None
            else dataclasses.replace(marker, arc_length=stretch(marker.arc_length))
            for marker in markers
        )
    if base.any():
        robot = _move_base(robot, base)
    return RobotSetup(robot, markers, tuple(zeros), scale, backlash, dynamics)


def _move_base(robot: ContinuumRobot, base: Floats) -> ContinuumRobot:
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_rotvec(base[1]) * Rotation.from_rotvec(robot.base_rotation)
    return dataclasses.replace(
        robot,
        base_position=tuple((np.asarray(robot.base_position) + base[0]).tolist()),
        base_rotation=tuple(turned.as_rotvec().tolist()),
    )


def _change_marker(setup: RobotSetup, index: int, own: dict[str, float]) -> Marker:
    marker = setup.markers[index]
    if not own:
        return marker
    place = marker.arc_length
    if "arc_length" in own:
        place = (setup.robot.length if place is None else place) + own["arc_length"]
        place = float(np.clip(place, 0.0, setup.robot.length))
    offset = np.asarray(marker.offset) + [own.get(axis, 0.0) for axis in "xyz"]
    return dataclasses.replace(marker, arc_length=place, offset=tuple(offset.tolist()))


def _change_robot(
    robot: ContinuumRobot,
    by_section: Mapping[int, Mapping[str, float]],
    by_tendon: Mapping[int, Mapping[str, float]],
) -> ContinuumRobot:
    if not by_section and not by_tendon:
        return robot
    lengths = [
        section.length * math.exp(by_section.get(k, {}).get("length", 0.0))
        for k, section in enumerate(robot.sections)
    ]
    longer = lengths != [section.length for section in robot.sections]
    stretch = _interpolate(robot.section_ends, np.cumsum(lengths)) if longer else None
    tendons = [
        _change_tendon(tendon, by_tendon.get(k, {}), stretch)
        for k, tendon in enumerate(robot.tendons)
    ]
    sections = []
    for k, section in enumerate(robot.sections):
        own = tuple(
            tendon for tendon, end in zip(tendons, robot.tendon_sections, strict=True) if end == k
        )
        sections.append(_change_section(section, by_section.get(k, {}), own))
    return dataclasses.replace(robot, sections=tuple(sections))


def _map_lengths(robot: ContinuumRobot, other: ContinuumRobot) -> Callable[[float], float]:
    return _interpolate(robot.section_ends, other.section_ends)


def _interpolate(before: Floats, after: Floats) -> Callable[[float], float]:
    """Return where an arc length is after sections have become longer."""
    ends = np.append(0.0, before), np.append(0.0, after)
    return lambda place: float(np.interp(place, *ends))


_Profile: TypeAlias = "float | Sequence[Sequence[float]] | None"


def _scale(profile: _Profile, factor: float) -> _Profile:
    """Return a number or knots with values times a factor."""
    if profile is None or isinstance(profile, (int, float)):
        return None if profile is None else profile * factor
    return tuple((knot[0], *(value * factor for value in knot[1:])) for knot in profile)


def _shift(profile: _Profile, step: float) -> _Profile:
    if profile is None or isinstance(profile, (int, float)):
        return None if profile is None else profile + step
    return tuple((place, value + step) for place, value in profile)


def _move_knots(profile: _Profile, stretch: Callable[[float], float]) -> _Profile:
    if profile is None or isinstance(profile, (int, float)):
        return profile
    return tuple((stretch(knot[0]), *knot[1:]) for knot in profile)


def _change_tendon(
    tendon: Tendon, own: Mapping[str, float], stretch: Callable[[float], float] | None
) -> Tendon:
    if not own and stretch is None:
        return tendon
    fields: Json = {"offset": tendon.offset, "angle": tendon.angle, "path": tendon.path}
    factor = math.exp(own.get("offset", 0.0))
    if tendon.path is not None:
        c, s = math.cos(own.get("angle", 0.0)) * factor, math.sin(own.get("angle", 0.0)) * factor
        fields["path"] = tuple((p, c * x - s * y, s * x + c * y) for p, x, y in tendon.path)
    else:
        fields["offset"] = _scale(tendon.offset, factor)
        fields["angle"] = _shift(cast("_Profile", tendon.angle), own.get("angle", 0.0))
    if stretch is not None:
        fields = {name: _move_knots(value, stretch) for name, value in fields.items()}
        fields["end"] = stretch(cast("float", tendon.end))
    if "stiffness" in own:
        fields["stiffness"] = tendon.stiffness * math.exp(own["stiffness"])
    for name in ("pretension", "friction"):
        if name in own:
            fields[name] = max(getattr(tendon, name) + own[name], 0.0)
    return dataclasses.replace(tendon, **fields)


def _change_section(
    section: Section, own: Mapping[str, float], tendons: tuple[Tendon, ...]
) -> Section:
    fields: Json = {"tendons": tendons}
    if section.wire is not None and any(name in own for name in STIFFNESSES):
        raise InputError("the stiffnesses follow from the wire: fit sections.*.modulus")
    by_modulus = own.get("modulus", 0.0)
    if section.wire is not None and "modulus" in own:
        modulus = section.wire.modulus * math.exp(by_modulus)
        fields["wire"] = dataclasses.replace(section.wire, modulus=modulus)
    else:
        for name in STIFFNESSES:
            if by_modulus or name in own:
                factor = math.exp(by_modulus + own.get(name, 0.0))
                fields[name] = _scale(getattr(section, name), factor)
    if "line_weight" in own:
        fields["line_weight"] = section.line_weight * math.exp(own["line_weight"])
    if "length" in own:
        factor = math.exp(own["length"])
        fields["length"] = section.length * factor
        fields["disc_positions"] = tuple(place * factor for place in section.disc_positions)
        profiles = ("curvature", *(STIFFNESSES if section.wire is None else ()))
        for name in profiles:
            value = fields.get(name, getattr(section, name))
            if not isinstance(value, (int, float)) and value and not _is_number(value[0]):
                fields[name] = _move_knots(value, lambda place: place * factor)
        wire = fields.get("wire", section.wire)
        if wire is not None:
            diameter = _move_knots(wire.diameter, lambda place: place * factor)
            fields["wire"] = dataclasses.replace(wire, diameter=diameter)
    if tendons == section.tendons and len(fields) == 1:
        return section
    return dataclasses.replace(section, **fields)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float))
