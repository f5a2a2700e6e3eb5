"""Tables of commands and readings of a robot's sensors, and their columns."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..checks import check_fields, check_path, quantity
from ..errors import FileFormatError, InputError
from ..io.sheets import Sheet, read_sheet, split_title, take_numbers
from ..numeric.arrays import Floats
from ..results import Shown
from .calibration import Command, Marker
from .error_fit import SensorRecord
from .kinematics import ContinuumRobot
from .measured import KINDS, MISSING, TIP, check_sheet, find_factor
from .sensors import (
    BodySensor,
    CurvatureSensor,
    PlaceSensor,
    PoseSensor,
    SightSensor,
    StrainSensor,
    TensionSensor,
)
from .unknowns import RobotSetup

SIGNED = r"-?[0-9]+(?:\.[0-9]*)?"
NUMBER = r"([0-9]+(?:\.[0-9]*)?)"
TITLES = {
    "time": re.compile(r"(time)"),
    "displacement": re.compile(r"(.+) displacement"),
    "tension": re.compile(r"(.+) tension"),
    "rotation": re.compile(r"(.+?)[\s_]+rotation[\s_]+([xyz])"),
    "curvature": re.compile(rf"curvature at {NUMBER} mm[\s_]+([xy])"),
    "strain": re.compile(rf"strain at {NUMBER} mm beside ({SIGNED}) ({SIGNED}) mm"),
    "camera": re.compile(r"(.+?)[\s_]+camera([0-9]*)[\s_]+([xyz])"),
    "ray": re.compile(r"(.+?)[\s_]+ray([0-9]*)[\s_]+([xyz])"),
    "place": re.compile(r"(.+?)[\s_]+([xyz])"),
}
"""Names of columns, and what they are of."""
QUANTITIES = {"time": "time", "rotation": "angle", "curvature": "curvature", "place": "length"}
QUANTITIES |= {"strain": "dimensionless", "camera": "length", "ray": "dimensionless"}
QUANTITIES |= KINDS
"""Kind of quantity of each; strains and directions may have no unit."""
OF_MARKERS = ("place", "rotation", "camera", "ray")
"""What is of the tip or a marker."""
FORMS = ("curvature at", "strain at")
FORM_HELP = "write 'curvature at 50 mm x [rad/m]' or 'strain at 50 mm beside 0.5 -0.3 mm'"
"""How columns begin that are meant as readings, and what they look like."""


@dataclass(frozen=True, kw_only=True)
class SensorNoise(Shown):
    """Standard deviations of what sensors of a table read.

    Parameters
    ----------
    place, angle : float
        Of each coordinate of a place [mm], of each part of a rotation [rad].
    bend, bend_share : float
        Of a curvature [rad/mm], and its part that grows with it.
    tension : float
        [N].
    strain, strain_bias : float
        Of a strain, and of its constant error, such as of the temperature.
    sight : float
        Of the direction of a ray [rad].
    """

    place: float = quantity("length", "Noise of places.", low=1e-4, default=0.5, by_name=True)
    angle: float = quantity("angle", "Noise of rotations.", low=1e-6, default=0.01, by_name=True)
    bend: float = quantity(
        "curvature", "Noise of curvatures.", low=1e-9, default=1e-5, by_name=True
    )
    bend_share: float = quantity(
        help="Noise by the curvature.", low=0.0, default=0.01, by_name=True
    )
    tension: float = quantity("force", "Noise of tensions.", low=1e-6, default=0.1, by_name=True)
    strain: float = quantity(help="Noise of strains.", low=1e-9, default=1e-6, by_name=True)
    strain_bias: float = quantity(
        help="Constant error of each strain.", low=0.0, default=0.0, by_name=True
    )
    sight: float = quantity("angle", "Noise of rays.", low=1e-6, default=1e-3, by_name=True)

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class SensorTable(Shown):
    """What a table holds for a robot.

    Parameters
    ----------
    command : {"displacement", "tension"}
    sensors : tuple of BodySensor
    record : SensorRecord
        As commanded: before zeros, scale and backlash of the robot's calibration.
    ignored : tuple of str
        Titles of other columns.
    """

    command: Command
    sensors: tuple[BodySensor, ...]
    record: SensorRecord
    ignored: tuple[str, ...] = ()


def read_sensor_table(
    path: str | Path, robot: ContinuumRobot, *, noise: SensorNoise = SensorNoise()
) -> SensorTable:
    """Read commands and readings, a row each moment.

    Columns: ``time [s]``, a second a row without it; ``T1 displacement [mm]``, or ``T1 tension
    [N]``, which are commands if no displacement is given and readings otherwise; places in the
    world, ``tip x [mm]``, of the tip or a marker of the robot's calibration, with ``tip rotation x
    [rad]`` for a pose; ``curvature at 50 mm x [rad/m]`` about x and y of the cross-section;
    ``strain at 50 mm beside 0.5 -0.3 mm`` of a fibre there; ``tip camera x [mm]`` and ``tip
    ray x``, centre and direction of a sight, ``camera2``, ``ray2`` of another. Cells of readings
    may be empty.

    Raises
    ------
    FileFormatError
        If the file is no such table.
    UnitError
        If a column has no unit or a wrong one.
    InputError
        If a tendon or marker is not there.
    """
    file = check_path("table", path)
    try:
        return take_sensor_sheet(read_sheet(file), robot, noise)
    except InputError as error:
        raise type(error)(f"{file.name}: {error}") from None


def take_sensor_sheet(sheet: Sheet, robot: ContinuumRobot, noise: SensorNoise) -> SensorTable:
    """Return what `read_sensor_table` does of a table as text."""
    titles = [title.strip() for title in sheet.titles]
    check_sheet(sheet, titles)
    known = {TIP: Marker(name=TIP)} | {
        marker.name: marker for marker in RobotSetup.of(robot).markers
    }
    found: dict[str, dict[tuple[str, ...], Floats]] = {kind: {} for kind in TITLES}
    ignored = []
    for place, title in enumerate(titles):
        name = split_title(title)[0]
        kind, match = next(
            ((kind, match) for kind, form in TITLES.items() if (match := form.fullmatch(name))),
            ("", None),
        )
        own = "" if match is None else match[1]
        if kind not in ("curvature", "strain") and name.lower().startswith(FORMS):
            raise FileFormatError(f"column '{title}' is not understood: {FORM_HELP}")
        if match is None or (kind in OF_MARKERS and own not in known):
            ignored.append(title)
            continue
        if kind in KINDS and own not in robot.tendon_names:
            raise InputError(
                f"column '{title}' is of no tendon: they are {', '.join(robot.tendon_names)}"
            )
        if match.groups() in found[kind]:
            raise FileFormatError(f"column '{title}' is there twice")
        empty = () if kind in ("time", "displacement") else MISSING
        unit = split_title(title)[1] if kind in ("strain", "ray") else "given"
        factor = find_factor(title, QUANTITIES[kind]) if unit else 1.0
        values = factor * take_numbers(sheet, place, empty=empty)
        found[kind][match.groups()] = values
    command: Command = "displacement" if found["displacement"] else "tension"
    commands = [found[command].get((name,)) for name in robot.tendon_names]
    lacking = [name for name, one in zip(robot.tendon_names, commands, strict=True) if one is None]
    if lacking and (command == "displacement" or len(lacking) == len(commands)):
        raise FileFormatError(f"there is no column '{lacking[0]} displacement [mm]'")
    rows = len(sheet.rows)
    sensors, readings = _find_sensors(found, command, robot, known=known, noise=noise)
    record = SensorRecord(
        times=found["time"].get(("time",), np.arange(rows, dtype=np.float64)),
        commands=np.stack([np.zeros(rows) if one is None else one for one in commands], axis=-1),
        readings=readings,
    )
    return SensorTable(
        command=command, sensors=tuple(sensors), record=record, ignored=tuple(ignored)
    )


def _find_sensors(
    found: dict[str, dict[tuple[str, ...], Floats]],
    command: Command,
    robot: ContinuumRobot,
    *,
    known: dict[str, Marker],
    noise: SensorNoise,
) -> tuple[list[BodySensor], dict[str, Floats]]:
    """Return the sensors of columns, and their readings."""
    sensors: list[BodySensor] = []
    readings: dict[str, Floats] = {}

    def join(kind: str, own: str, axes: str) -> Floats:
        lacking = [axis for axis in axes if (own, axis) not in found[kind]]
        if lacking:
            raise FileFormatError(f"{kind} '{own}' has no column of its axis {lacking[0]}")
        return np.stack([found[kind][own, axis] for axis in axes], axis=-1)

    for own, *_ in found["rotation"]:
        if not any(key[0] == own for key in found["place"]):
            raise FileFormatError(
                f"rotation '{own}' has no place: give '{own} x [mm]', y and z, too"
            )
    for own in dict.fromkeys(key[0] for key in found["place"]):
        marker, values = known[own], join("place", own, "xyz")
        turned = any(key[0] == own for key in found["rotation"])
        at = {"name": own, "arc_length": marker.arc_length, "offset": marker.offset}
        if turned:
            values = np.concatenate([values, join("rotation", own, "xyz")], axis=-1)
            sensors.append(
                PoseSensor(**at, deviation=noise.place, rotation_deviation=noise.angle)  # type: ignore[arg-type]
            )
        else:
            sensors.append(PlaceSensor(**at, deviation=noise.place))  # type: ignore[arg-type]
        readings[own] = values
    for own in dict.fromkeys(key[0] for key in found["curvature"]):
        name = f"curvature at {own} mm"
        sensors.append(
            CurvatureSensor(
                name=name, arc_length=float(own), deviation=noise.bend, share=noise.bend_share
            )
        )
        readings[name] = join("curvature", own, "xy")
    for (own, x, y), values in found["strain"].items():
        name = f"strain at {own} mm beside {x} {y} mm"
        sensors.append(
            StrainSensor(
                name=name,
                arc_length=float(own),
                offset=(float(x), float(y)),
                deviation=noise.strain,
                bias=noise.strain_bias,
            )
        )
        readings[name] = values[:, None]
    for own, number in dict.fromkeys(key[:2] for kind in ("camera", "ray") for key in found[kind]):
        parts = [
            found[kind].get((own, number, axis)) for kind in ("camera", "ray") for axis in "xyz"
        ]
        if any(one is None for one in parts):
            raise FileFormatError(
                f"'{own} ray{number}' has not all columns: '{own} camera{number} x [mm]' and "
                f"'{own} ray{number} x', with y and z"
            )
        name, marker = f"{own} ray{number}", known[own]
        sensors.append(
            SightSensor(
                name=name, arc_length=marker.arc_length, offset=marker.offset, angle=noise.sight
            )
        )
        readings[name] = np.stack(parts, axis=-1)  # type: ignore[arg-type]
    if command == "displacement":
        for (own,), values in found["tension"].items():
            sensors.append(TensionSensor(name=own, deviation=noise.tension))
            readings[own] = values[:, None]
    return sensors, readings


def convert_record(
    robot: ContinuumRobot, table: SensorTable, *, before: Sequence[Floats] = ()
) -> SensorRecord:
    """Return the recording of a table with what its commands come to, after commands before it."""
    rows = np.concatenate([*before, table.record.commands])
    if table.command == "tension":
        # Noise of a measured tension about 0: a cable does not push.
        commands = robot.to_tensions(np.where(robot.pushes, rows, np.maximum(rows, 0.0)))
    else:
        commands = robot.to_displacements(rows, in_time=True)
    return dataclasses.replace(table.record, commands=commands[-len(table.record) :])
