"""Estimate shape and loads of a table of commands and readings: the job, and its columns."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..checks import check_path, quantity
from ..errors import FileFormatError, InputError
from ..io.sheets import Sheet, read_sheet, split_title, take_numbers
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..task import Task
from .calibration import Command, Marker
from .energy import EnergyModel
from .error_fit import EstimateHistory, SensorRecord, follow_record
from .estimation import ModelError, ShapeEstimator, UnknownLoad
from .kinematics import ContinuumRobot
from .measured import KINDS, MISSING, TIP, check_sheet, find_factor
from .sensors import BodySensor, CurvatureSensor, PlaceSensor, PoseSensor, TensionSensor
from .unknowns import RobotSetup

TITLES = {
    "time": re.compile(r"(time)"),
    "displacement": re.compile(r"(.+) displacement"),
    "tension": re.compile(r"(.+) tension"),
    "rotation": re.compile(r"(.+?)[\s_]+rotation[\s_]+([xyz])"),
    "curvature": re.compile(r"curvature at ([0-9.]+) mm[\s_]+([xy])"),
    "place": re.compile(r"(.+?)[\s_]+([xyz])"),
}
"""Names of columns, and what they are of."""
QUANTITIES = {"time": "time", "rotation": "angle", "curvature": "curvature", "place": "length"}
QUANTITIES |= KINDS
"""Kind of quantity of each."""


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """Standard deviations of what sensors of a table read.

    Parameters
    ----------
    place, angle : float
        Of each coordinate of a place [mm], of each part of a rotation [rad].
    bend, bend_share : float
        Of a curvature [rad/mm], and its part that grows with it.
    tension : float
        [N].
    """

    place: float = quantity("length", "Noise of places.", low=1e-9, default=0.5)
    angle: float = quantity("angle", "Noise of rotations.", low=1e-9, default=0.01)
    bend: float = quantity("curvature", "Noise of curvatures.", low=1e-12, default=1e-5)
    bend_share: float = quantity(help="Noise by the curvature.", low=0.0, default=0.01)
    tension: float = quantity("force", "Noise of tensions.", low=1e-9, default=0.1)


@dataclass(frozen=True, kw_only=True)
class SensorTable:
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
    [rad]`` for a pose; ``curvature at 50 mm x [rad/m]`` about x and y of the cross-section. Cells
    of readings may be empty.

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
        return _take_sheet(read_sheet(file), robot, noise)
    except InputError as error:
        raise type(error)(f"{file.name}: {error}") from None


def _take_sheet(sheet: Sheet, robot: ContinuumRobot, noise: SensorNoise) -> SensorTable:
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
        if match is None or (kind in ("place", "rotation") and own not in known):
            ignored.append(title)
            continue
        if kind in KINDS and own not in robot.tendon_names:
            raise InputError(
                f"column '{title}' is of no tendon: they are {', '.join(robot.tendon_names)}"
            )
        if match.groups() in found[kind]:
            raise FileFormatError(f"column '{title}' is there twice")
        empty = () if kind in ("time", "displacement") else MISSING
        values = find_factor(title, QUANTITIES[kind]) * take_numbers(sheet, place, empty=empty)
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
    if command == "displacement":
        for (own,), values in found["tension"].items():
            sensors.append(TensionSensor(name=own, deviation=noise.tension))
            readings[own] = values[:, None]
    return sensors, readings


@dataclass(frozen=True, kw_only=True)
class ContinuumEstimating(Task):
    """Find where a robot is from commands and sensors: shape, loads, slow errors, with intervals.

    TABLE has a row for each moment: commands as `T1 displacement [mm]` or `T1 tension [N]`;
    readings as `tip x [mm]` (or a marker of the robot's calibration), `tip rotation x [rad]`,
    `curvature at 50 mm x [rad/m]`, and tensions beside displacements; `time [s]`. Cells of readings
    may be empty. Errors of the model are as large as their options say; curvature, zeros and the
    base's position are forgotten after `--memory`, the others stay.

    The picture is the tip over time with its 95 % band; of one row, the shape.

    Exit code 0: done; 1: a row has no estimate; 2: bad input.
    """

    name = "estimate"
    group = "continuum"
    result = EstimateHistory

    robot: str = quantity("file", "A robot file.")
    table: str = quantity("file", "Commands and readings.")
    load: bool = quantity("flag", "Look for one unknown force across the body.", default=False)
    load_place: float | None = quantity(
        "length", "Where it acts (default: unknown).", low=0.0, default=None
    )
    load_force: float = quantity(
        "force", "Standard deviation of that force along each axis.", default=1.0, low=1e-9
    )
    ahead: int = quantity(
        help="Rows ahead that are predicted and compared.", default=0, low=0, whole=True
    )
    between: int = quantity(
        help="Further cross-sections between two discs.", default=0, low=0, high=100, whole=True
    )
    noise: SensorNoise = SensorNoise()
    error: ModelError = ModelError()

    def run(self, progress: Progress = no_progress) -> EstimateHistory:
        """Return the estimates of all rows."""
        robot = ContinuumRobot.from_yaml(self.robot)
        table = read_sensor_table(self.table, robot, noise=self.noise)
        if table.command == "tension":
            # Noise of a measured tension about 0: a cable does not push.
            measured = table.record.commands
            pulls = np.where(robot.pushes, measured, np.maximum(measured, 0.0))
            commands = robot.to_tensions(pulls)
        else:
            commands = robot.to_displacements(table.record.commands, in_time=True)
        record = SensorRecord(
            times=table.record.times, commands=commands, readings=table.record.readings
        )
        loads: Sequence[UnknownLoad] = ()
        if self.load:
            loads = (UnknownLoad(arc_length=self.load_place, force=self.load_force),)
        estimator = ShapeEstimator(
            model=EnergyModel(robot, segment="channel", between=self.between),
            sensors=table.sensors,
            error=self.error,
            loads=loads,
            command=table.command,
        )
        ahead = (self.ahead,) if self.ahead else ()
        return follow_record(estimator, record, ahead=ahead, progress=progress)

    def describe(self, found: EstimateHistory) -> str:
        """Return the last row, and how well rows ahead were predicted."""
        last = found.estimates[-1]
        spread = last.deviations[-1]
        tip = ", ".join(
            f"{value:.2f} ± {1.96 * deviation:.2f}"
            for value, deviation in zip(last.tip, spread, strict=True)
        )
        lines = [f"{len(found.times)} row(s); after the last: tip {tip} mm (95 %)"]
        for load in last.loads:
            lines.append(
                f"force {load.force:.3g} N ({load.force_low:.3g} to {load.force_high:.3g}) at "
                f"{load.place:.1f} mm ({load.place_low:.1f} to {load.place_high:.1f})"
            )
        for one in found.predictions:
            if not math.isnan(one.rms):
                lines.append(
                    f"{one.ahead} row(s) ahead: {one.rms:.3g} rms, "
                    f"{100.0 * one.measure_coverage():.1f} % within 95 % intervals"
                )
        return "\n".join([*lines, *filter(None, [found.reason])])
