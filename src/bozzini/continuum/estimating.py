"""Estimate shape and loads of a table of commands and readings: the job, and its columns."""

from __future__ import annotations

import csv
import dataclasses
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from ..checks import check_fields, check_path, quantity
from ..errors import FileFormatError, InputError
from ..io.sheets import Sheet, format_table, read_sheet, split_title, take_numbers
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..task import Task
from .calibration import Command, Marker
from .energy import EnergyModel
from .error_fit import EstimateHistory, SensorRecord, follow_record, predict_unread
from .estimation import ModelError, ShapeEstimator, UnknownLoad
from .kinematics import ContinuumRobot
from .measured import KINDS, MISSING, TIP, check_sheet, find_factor
from .motion_log import write_estimates
from .sensors import (
    BodySensor,
    CurvatureSensor,
    PlaceSensor,
    PoseSensor,
    SightSensor,
    StrainSensor,
    TensionSensor,
)
from .shape_estimate import LIMIT
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
    strain, strain_bias : float
        Of a strain, and of its constant error, such as of the temperature.
    sight : float
        Of the direction of a ray [rad].
    """

    place: float = quantity("length", "Noise of places.", low=1e-4, default=0.5)
    angle: float = quantity("angle", "Noise of rotations.", low=1e-6, default=0.01)
    bend: float = quantity("curvature", "Noise of curvatures.", low=1e-9, default=1e-5)
    bend_share: float = quantity(help="Noise by the curvature.", low=0.0, default=0.01)
    tension: float = quantity("force", "Noise of tensions.", low=1e-6, default=0.1)
    strain: float = quantity(help="Noise of strains.", low=1e-9, default=1e-6)
    strain_bias: float = quantity(help="Constant error of each strain.", low=0.0, default=0.0)
    sight: float = quantity("angle", "Noise of rays.", low=1e-6, default=1e-3)

    def __post_init__(self) -> None:
        check_fields(self)


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
    [rad]`` for a pose; ``curvature at 50 mm x [rad/m]`` about x and y of the cross-section;
    ``strain at 50 mm beside 0.5 -0.3 mm`` of a fibre there; ``tip camera x [mm]`` and ``tip ray x``,
    centre and direction of a sight, ``camera2``, ``ray2`` of another. Cells of readings may be
    empty.

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


@dataclass(frozen=True, kw_only=True)
class ContinuumEstimating(Task):
    """Find where a robot is from commands and sensors: shape, loads, slow errors, with intervals.

    TABLE has a row for each moment: commands as `T1 displacement [mm]` or `T1 tension [N]`;
    readings as `tip x [mm]` (or a marker of the robot's calibration), `tip rotation x [rad]`,
    `curvature at 50 mm x [rad/m]`, `strain at 50 mm beside 0.5 -0.3 mm`, of a camera
    `tip camera x [mm]` (its centre) with `tip ray x` (a direction; camera2, ray2 of another), and
    tensions beside displacements; `time [s]`. Cells of readings may be empty. With - for TABLE
    rows of CSV come from stdin, and each is answered at once on stdout.

    Errors of the model are as large as their options say; curvature, zeros and the base's position
    are forgotten after --memory, the others stay; the unknown force is new at each moment, or lasts
    as --load-memory says. Rows that by these sizes cannot be are told, and how far off they are
    (surprise: 1 is as expected). With --calibrate bands are as wide as that table asks for: by
    sensors that TABLE does not have, or else by predictions of its rows from those before.

    The picture is the tip over time with its 95 % band; of one row, the shape.

    Exit code 0: done; 1: a row has no estimate; 2: bad input.
    """

    name = "estimate"
    group = "continuum"
    result = EstimateHistory
    streamed = "table"
    formats: ClassVar[Mapping[str, Callable[..., object]]] = {".mcap": write_estimates}

    robot: str = quantity("file", "A robot file.")
    table: str = quantity("file", "Commands and readings.")
    load: bool = quantity("flag", "Look for one unknown force across the body.", default=False)
    load_place: float | None = quantity(
        "length", "Where it acts (default: unknown).", low=0.0, default=None
    )
    load_force: float | None = quantity(
        "force", "Standard deviation of that force along each axis (default: 1 N).", default=None,
        low=1e-9,
    )  # fmt: skip
    load_memory: float | None = quantity(
        "time", "After which it is forgotten (default: at once).", default=None, low=0.0
    )
    shapes: str | None = quantity("file", "A file of shapes that the body is in.", default=None)
    wall_stiffness: float | None = quantity(
        "pressure", "Of their wall per length of the body (default: rigid).", default=None, low=0.0,
        low_open=True,
    )  # fmt: skip
    calibrate: str | None = quantity(
        "file", "A table by which bands are made as wide as they must be.", default=None
    )
    ahead: int = quantity(
        help="Rows ahead that are predicted and compared.", default=0, low=0, whole=True
    )
    between: int = quantity(
        help="Further cross-sections between two discs.", default=0, low=0, high=100, whole=True
    )
    noise: SensorNoise = SensorNoise()
    error: ModelError = ModelError()

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("load_place", "load_force", "load_memory"):
            if getattr(self, name) is not None and not self.load:
                raise InputError(f"{name.replace('_', '-')} is given without load")
        if self.wall_stiffness is not None and self.shapes is None:
            raise InputError("wall-stiffness is given without shapes")

    def run(self, progress: Progress = no_progress) -> EstimateHistory:
        """Return the estimates of all rows."""
        robot = ContinuumRobot.from_yaml(self.robot)
        table = read_sensor_table(self.table, robot, noise=self.noise)
        rows = len(table.record)
        if self.ahead >= rows:
            raise InputError(f"ahead is {self.ahead}: it must be below {rows}, the table's rows")
        estimator = self._make_estimator(robot, table)
        record = convert_record(robot, table)
        ahead = (self.ahead,) if self.ahead else ()
        found = follow_record(estimator, record, ahead=ahead, progress=progress)
        return dataclasses.replace(
            found.widen(*self._calibrate(robot, table)), notes=self._note(table)
        )

    def stream(self, lines: Iterable[str]) -> Iterator[str]:
        """Return a line of CSV for the header, and each row, of such lines as soon as it is there.

        Raises
        ------
        InputError
            If a row is not legal.
        """
        robot = ContinuumRobot.from_yaml(self.robot)
        if self.ahead:
            raise InputError("ahead has no effect on rows that come one by one: leave it out")
        rows = csv.reader(lines)
        titles = next(rows, None)
        if titles is None:
            raise FileFormatError("there is no header")
        estimator, last, factors = None, None, (1.0, "")
        commands: list[Floats] = []
        for number, cells in enumerate(rows, start=2):
            if not any(cell.strip() for cell in cells):
                continue
            table = _take_sheet(Sheet(titles, [cells], [number]), robot, self.noise)
            commands.append(table.record.commands)
            times = table.record.times
            if not any(TITLES["time"].fullmatch(split_title(one.strip())[0]) for one in titles):
                times = times + len(commands) - 1.0
            record = convert_record(robot, table, before=commands[:-1])
            record = dataclasses.replace(record, times=times)
            if estimator is None:
                estimator = self._make_estimator(robot, table)
                factors = self._calibrate(robot, table)
            state = None
            if last is not None:
                elapsed = float(times[0] - last.times[-1])
                state = estimator.wait(last.state, elapsed)
            last = follow_record(estimator, record, state=state)
            text = format_table(last.widen(*factors).list_columns())
            yield text if len(commands) == 1 else text.split("\n", 1)[1]

    def _make_estimator(self, robot: ContinuumRobot, table: SensorTable) -> ShapeEstimator:
        loads: Sequence[UnknownLoad] = ()
        if self.load:
            force = 1.0 if self.load_force is None else self.load_force
            memory = self.load_memory or 0.0
            loads = (UnknownLoad(arc_length=self.load_place, force=force, memory=memory),)
        duct = None
        if self.shapes is not None:
            from ..duct.shape_files import load_shapes

            duct = load_shapes(self.shapes)
        return ShapeEstimator(
            model=EnergyModel(robot, segment="channel", between=self.between),
            sensors=table.sensors,
            error=self.error,
            loads=loads,
            command=table.command,
            duct=duct,
            wall_stiffness=self.wall_stiffness,
        )

    def _calibrate(self, robot: ContinuumRobot, table: SensorTable) -> tuple[float, str]:
        """Return the factor of bands, and what it is from."""
        if self.calibrate is None:
            return 1.0, ""
        other = read_sensor_table(self.calibrate, robot, noise=self.noise)
        if other.command != table.command:
            raise InputError(f"{self.calibrate} has {other.command}s as commands, the table others")
        names = [one.name for one in table.sensors]
        found = predict_unread(
            self._make_estimator(robot, other), convert_record(robot, other), read=names
        )
        factor = found.find_widening()
        if math.isnan(factor):
            raise InputError(f"{self.calibrate} has no reading to compare with")
        count = int(np.isfinite(found.misses).sum())
        return factor, (
            f"bands are {factor:.3g} times as wide as without --calibrate, by {count} readings of "
            f"which they held {100.0 * found.measure_coverage():.1f} %"
        )

    def _note(self, table: SensorTable) -> tuple[str, ...]:
        notes = []
        if not table.sensors:
            notes.append("no column is a reading: this is the model alone")
        if table.ignored:
            notes.append(f"not read: {', '.join(repr(one) for one in table.ignored)}")
        return tuple(notes)

    def describe(self, found: EstimateHistory) -> str:
        """Return the last row, and how well rows ahead were predicted."""
        last = found.estimates[-1]
        tip = ", ".join(
            f"{value:.2f} ± {LIMIT * deviation:.2f}"
            for value, deviation in zip(last.tip, last.deviations[-1], strict=True)
        )
        lines = [f"{len(found.times)} row(s); after the last: tip {tip} mm (95 %)"]
        for load in last.loads:
            lines.append(
                f"force {load.force:.3g} N ({load.force_low:.3g} to {load.force_high:.3g}) at "
                f"{load.place:.1f} mm ({load.place_low:.1f} to {load.place_high:.1f})"
            )
        if last.contact is not None:
            spread = LIMIT * np.sqrt(np.diag(last.contact.resultant_covariance))
            parts = zip(last.contact.resultant, spread, strict=True)
            force = ", ".join(f"{value:.3g} ± {half:.2g}" for value, half in parts)
            lines.append(f"the wall presses with {force} N (95 %)")
        for one in found.predictions:
            if not math.isnan(one.ratio):
                lines.append(
                    f"{one.ahead} row(s) ahead: readings miss by {one.ratio:.3g} times what is "
                    f"expected, {100.0 * one.measure_coverage():.1f} % are within 95 % intervals"
                )
        return "\n".join([*lines, *found.describe_notes(), *filter(None, [found.reason])])


def convert_record(
    robot: ContinuumRobot, table: SensorTable, *, before: Sequence[Floats] = ()
) -> SensorRecord:
    """Return the recording of a table with what its commands come to, after rows before it."""
    rows = np.concatenate([*before, table.record.commands])
    if table.command == "tension":
        # Noise of a measured tension about 0: a cable does not push.
        commands = robot.to_tensions(np.where(robot.pushes, rows, np.maximum(rows, 0.0)))
    else:
        commands = robot.to_displacements(rows, in_time=True)
    return dataclasses.replace(table.record, commands=commands[-len(table.record) :])
