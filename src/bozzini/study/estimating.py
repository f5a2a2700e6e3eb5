"""The job of estimates: where a robot is, from commands and readings of a table or of stdin."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..checks import quantity
from ..continuum.energy import EnergyModel
from ..continuum.error_fit import (
    EstimateHistory,
    SensorRecord,
    follow_record,
    predict_unread,
)
from ..continuum.estimation import ShapeEstimator
from ..continuum.kinematics import ContinuumRobot
from ..continuum.model_error import ModelError, UnknownLoad
from ..continuum.motion_log import write_estimates
from ..continuum.sensor_table import (
    TITLES,
    SensorNoise,
    SensorTable,
    convert_record,
    read_sensor_table,
    take_sensor_sheet,
)
from ..continuum.shape_estimate import LIMIT
from ..errors import FileFormatError, InputError
from ..io.sheets import Sheet, format_table, split_title
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..task import Task


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
        "length", "Where it acts (default: unknown).", low=0.0, default=None, by_name=True
    )
    load_force: float | None = quantity(
        "force", "Standard deviation of that force along each axis (default: 1 N).", default=None,
        low=1e-9,
        by_name=True,
    )  # fmt: skip
    load_memory: float | None = quantity(
        "time",
        "After which it is forgotten (default: at once).",
        default=None,
        low=0.0,
        by_name=True,
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
        help="Further cross-sections between two discs.",
        default=0,
        low=0,
        high=100,
        whole=True,
        by_name=True,
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

    def stream(self, lines: Iterable[str]) -> Iterator[tuple[str, bool]]:
        """Return lines of CSV for rows of CSV, each as soon as it is there, and if it converged.

        Raises
        ------
        InputError
            If a row is not legal.
        """
        for count, found in enumerate(self.follow(lines)):
            text = format_table(found.list_columns())
            yield text if count == 0 else text.split("\n", 1)[1], found.converged

    def follow(self, lines: Iterable[str] | None = None) -> Iterator[EstimateHistory]:
        """Give the estimate of each row, as soon as it is there: of rows of CSV, or of the table.

        Raises
        ------
        InputError
            If a row is not legal.
        """
        robot = ContinuumRobot.from_yaml(self.robot)
        estimator, last, factors = None, None, (1.0, "")
        for number, table, record in self._list_rows(robot, lines):
            if estimator is None:
                estimator = self._make_estimator(robot, table)
                factors = self._calibrate(robot, table)
            state = None
            if last is not None:
                elapsed = float(record.times[0] - last.times[-1])
                if elapsed < 0.0:
                    raise InputError(
                        f"row {number}: time {record.times[0]:g} s is before the last row's"
                    )
                state = estimator.wait(last.state, elapsed)
            last = follow_record(estimator, record, state=state)
            yield last.widen(*factors)

    def _list_rows(
        self, robot: ContinuumRobot, lines: Iterable[str] | None
    ) -> Iterator[tuple[int, SensorTable, SensorRecord]]:
        """Give each row: its number, the table, and the recording of this row alone."""
        if lines is None:
            table = read_sensor_table(self.table, robot, noise=self.noise)
            record = convert_record(robot, table)
            for row in range(len(record)):
                yield row + 2, table, record.select([row])
            return
        if self.ahead:
            raise InputError("ahead has no effect on rows that come one by one: leave it out")
        rows = csv.reader(lines)
        titles = next(rows, None)
        if titles is None:
            raise FileFormatError("there is no header")
        timed = any(TITLES["time"].fullmatch(split_title(one.strip())[0]) for one in titles)
        before: Sequence[Floats] = ()
        count = 0
        for number, cells in enumerate(rows, start=2):
            if not any(cell.strip() for cell in cells):
                continue
            table = take_sensor_sheet(Sheet(titles, [cells], [number]), robot, self.noise)
            times = table.record.times if timed else table.record.times + float(count)
            record = convert_record(robot, table, before=before)
            yield number, table, dataclasses.replace(record, times=times)
            # What the commands came to is all that backlash needs to know of the rows before.
            before = (robot.to_commands(record.commands),) if table.command != "tension" else ()
            count += 1

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
        if np.isnan(last.tip).any():
            lines = [f"{len(found.times)} row(s); of the last there is no estimate"]
        for load in last.loads if last.converged else ():
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
