"""Measured robots: tables of commands and of points seen on the body."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from ..checks import check_array, check_path, check_word
from ..errors import FileFormatError, InputError, UnitError
from ..io.sheets import Sheet, read_sheet, show_cell, split_title, take_frame, take_numbers
from ..numeric.arrays import Floats
from ..results import Shown
from ..units import parse_unit
from .calibration import Command, Marker
from .checks import check_items
from .kinematics import ContinuumRobot

if TYPE_CHECKING:
    import pandas

    from .robot import RobotDesign

KINDS: dict[str, str] = {"displacement": "length", "tension": "force"}
"""Kind of quantity of each command."""

EXAMPLES = {"length": "mm", "force": "N", "time": "s", "angle": "deg"}
MISSING = ("", "nan", "na", "none")
"""Cells of a value that was not measured, in lower case."""

TIP = "tip"
"""Name of the point that is the tip unless a marker of this name is described."""

_BASE = dict.fromkeys(("base x", "base y", "base z"), "length") | dict.fromkeys(
    ("base rx", "base ry", "base rz"), "angle"
)
_LOAD = re.compile(r"load [1-9][0-9]{0,2}")
_AXIS = re.compile(r"(.+?)[\s_]+([xyz])")


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotMeasurements(Shown):
    """Commands of a robot's tendons, and where points of its body were seen.

    Rows are in the order of time where that matters. A row without a point is not compared with
    anything, but its command is part of the history of the rows after it.

    Parameters
    ----------
    command : {"displacement", "tension"}
        What is commanded.
    tendons : tuple of str
        Tendons that are commanded.
    commands : ndarray, shape (n, t)
        Displacements [mm] or tensions [N].
    markers : tuple of Marker
        What was seen.
    points : ndarray, shape (n, m, 3)
        Where, in the world [mm]; NaN where a point was not seen.
    blocks : ndarray of str, shape (n,)
        Label of each row, for validation; empty texts where the table has none.
    times : ndarray, shape (n,)
        Of the rows of a motion [s], growing; none (0,) of rows at rest.
    source : str
        Name of the file.
    notes : tuple of str
        What a user should know of the table.

    Raises
    ------
    InputError
        If the arrays do not go together, or nothing was seen.
    """

    command: Command
    tendons: tuple[str, ...]
    commands: Floats
    markers: tuple[Marker, ...]
    points: Floats
    blocks: NDArray[np.str_] = field(default_factory=lambda: np.zeros(0, dtype=np.str_))
    times: Floats = field(default_factory=lambda: np.zeros(0))
    source: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_word("command", self.command, get_args(Command))
        object.__setattr__(self, "markers", check_items("markers", self.markers, Marker))
        commands = check_array("commands", self.commands)
        points = np.asarray(self.points, dtype=np.float64)
        rows, seen = len(commands), len(self.markers)
        if commands.shape != (rows, len(self.tendons)):
            raise InputError(
                f"commands have shape {commands.shape}: they must be ({rows}, {len(self.tendons)}),"
                " a column for each tendon"
            )
        if points.shape != (rows, seen, 3):
            raise InputError(
                f"points have shape {points.shape}: they must be ({rows}, {seen}, 3), a place for "
                "each row and marker"
            )
        blocks = self.blocks if len(self.blocks) else np.full(rows, "")
        if len(blocks) != rows:
            raise InputError(f"there are {len(blocks)} blocks for {rows} rows: give one for each")
        times = np.asarray(self.times, dtype=np.float64)
        if times.size:
            check_times(times, rows)
        if not np.isfinite(points).all(axis=-1).any():
            raise InputError("no point was seen: the places are all empty")
        object.__setattr__(self, "commands", commands)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "blocks", np.asarray(blocks, dtype=np.str_))

    def __len__(self) -> int:
        return len(self.commands)

    @property
    def seen_rows(self) -> NDArray[np.int64]:
        """Indices of the rows with a point, (k,)."""
        return np.flatnonzero(np.isfinite(self.points).all(axis=-1).any(axis=-1))

    @property
    def span(self) -> float:
        """Largest extent of the points along an axis [mm]."""
        flat = self.points.reshape(-1, 3)
        return float(np.nanmax(np.nanmax(flat, axis=0) - np.nanmin(flat, axis=0)))

    @property
    def is_ordered(self) -> bool:
        """Whether rows that follow each other are alike, as in a recording over time.

        They are if the points of neighbours are half as far apart as those of any two, or less.
        """
        rows = self.seen_rows
        flat = np.nan_to_num(self.points[rows].reshape(len(rows), -1))
        if len(flat) < 8:
            return False
        other = flat[np.random.default_rng(0).permutation(len(flat))]
        near = np.median(np.linalg.norm(np.diff(flat, axis=0), axis=1))
        return bool(near <= 0.5 * np.median(np.linalg.norm(flat - other, axis=1)))

    def select(self, rows: NDArray[np.generic] | Sequence[int]) -> RobotMeasurements:
        """Return some of the rows, by mask or index.

        The others are gone from the history of those after them, which backlash and friction ask
        for: to keep them there, set their points to NaN instead.
        """
        return dataclasses.replace(
            self,
            commands=self.commands[rows],
            points=self.points[rows],
            blocks=self.blocks[rows],
            times=self.times[rows] if self.times.size else self.times,
        )

    def order_commands(self, robot: RobotDesign) -> Floats:
        """Return the commands of all tendons of a robot, shape (n, t).

        A tendon without a column has no tension; among displacements every one must be there.

        Raises
        ------
        InputError
            If the robot has no tendon of a name, or a displacement is not commanded.
        """
        lacking = [name for name in robot.tendon_names if name not in self.tendons]
        if lacking and self.command == "displacement":
            raise _miss_tendon(lacking[0], robot)
        columns = dict(zip(self.tendons, self.commands.T, strict=True))
        _check_known(self.tendons, robot)
        none = np.zeros(len(self))
        return np.stack([columns.get(name, none) for name in robot.tendon_names], axis=-1)


def _miss_tendon(name: str, robot: RobotDesign) -> InputError:
    return InputError(
        f"there is no column '{name} displacement [mm]': every tendon of robot '{robot.name}' "
        "needs one"
    )


def check_times(times: Floats, rows: int) -> None:
    """Raise `InputError` unless times (n,) are so many, and grow."""
    if times.shape != (rows,):
        raise InputError(
            f"times have shape {times.shape}: they must be ({rows},), one for each row"
        )
    wrong = np.flatnonzero(~(np.diff(times) > 0.0))
    if wrong.size:
        k = int(wrong[0])
        raise InputError(
            f"time {times[k + 1]:g} s of row {k + 2} comes after {times[k]:g} s: times must grow"
        )


def _check_known(names: Sequence[str], robot: RobotDesign) -> None:
    for name in names:
        if name not in robot.tendon_names:
            raise InputError(
                f"there is no tendon '{name}': those of robot '{robot.name}' are "
                f"{', '.join(robot.tendon_names) or 'none'}"
            )


def read_robot_measurements(
    table: str | os.PathLike[str] | pandas.DataFrame,
    *,
    robot: RobotDesign,
    markers: Sequence[Marker] = (),
    columns: Mapping[str, str] | None = None,
    blocks: str = "",
    timed: bool = False,
) -> RobotMeasurements:
    """Read what was commanded and seen of a robot from a CSV or Parquet file.

    Commands are columns such as ``T1 displacement [mm]`` or ``T1 tension [N]``, with the name of
    the tendon; positive displacements are pulled. Points are three columns each, such as
    ``tip x [mm]`` or ``marker_1_x [mm]``, in the world. The unit is in the title, perhaps with a
    number, as in ``[0.1 mm]``. A place that is empty or ``nan`` was not seen; the command of
    a row without a point is the history of the rows after it. Other columns are ignored. A table of
    ``bozzini vision track`` has a row for each point, and the commands as columns that it copied.

    Parameters
    ----------
    table : path-like or DataFrame
        The table; CSV as in `bozzini.muscle.read_measurements`.
    robot : RobotDesign
        The robot, whose tendons and tip are meant.
    markers : sequence of Marker
        Where points of the table are on the body; each must be there. Markers of the robot's
        calibration and ``tip`` need not be there.
    columns : mapping of str to str, optional
        Titles to read for titles of the file, such as ``{"tip_x": "tip x [mm]"}``.
    blocks : str
        Title of a column with labels of rows that belong together.
    timed : bool
        Whether the rows are of a motion: there must be a column ``time [s]``.

    Raises
    ------
    FileFormatError
        If the file is no such table; the message names row and column.
    UnitError
        If a column has no unit or a wrong one.
    InputError
        If a tendon or a marker is not there.
    """
    named = isinstance(table, (str, os.PathLike))
    path = check_path("table", table) if named else Path("the table")
    sheet = read_sheet(path) if named else take_frame(table)
    try:
        sheet = _spread_points(sheet)
        data = _take_sheet(
            sheet, robot, {item.name: item for item in markers}, columns, (blocks, timed)
        )
    except InputError as error:
        raise type(error)(f"{path.name}: {error}") from None
    return dataclasses.replace(data, source=path.name if named else "")


class TimedCommands(NamedTuple):
    """Commands of all tendons of a robot over time.

    Attributes
    ----------
    command : {"displacement", "tension"}
        What is commanded.
    times : (n,) ndarray
        Times [s].
    commands : (n, t) ndarray
        Displacements [mm] or tensions [N], 0 of tendons without a column.
    notes : tuple of str
        What of the table was ignored.
    factors : dict of int to ndarray
        By what loads are multiplied, by their number from 1 on, (n,).
    base : (n, 4, 4) ndarray, optional
        Frames of the base in its own frame at rest [mm], if the table has any of it.
    """

    command: Command
    times: Floats
    commands: Floats
    notes: tuple[str, ...] = ()
    factors: Mapping[int, Floats] = MappingProxyType({})
    base: Floats | None = None

    def take_factors(self, count: int) -> Floats | None:
        """Return the factors of loads (n, count), 1 where the table has none.

        Raises
        ------
        InputError
            If it has one of a load that is not there.
        """
        found = np.ones((len(self.times), count))
        for number, values in self.factors.items():
            if number > count:
                raise InputError(f"the table has a column 'load {number}': there are {count} loads")
            found[:, number - 1] = values
        return found if self.factors else None


def read_timed_commands(path: str | os.PathLike[str], robot: RobotDesign) -> TimedCommands:
    """Read commands of a robot over time: ``time [s]``, and commands as in measurements.

    Raises
    ------
    FileFormatError
        If the file is no such table.
    UnitError
        If a column has no unit or a wrong one.
    InputError
        If a tendon is not there.
    """
    file = check_path("path", path)
    try:
        sheet = read_sheet(file)
        titles = [title.strip() for title in sheet.titles]
        check_sheet(sheet, titles)
        found, _ = _find_columns(titles, robot, {}, demanded=(), needs_points=False)
        command, places = next(iter(found.items()))
        timed = _find_times(titles)
        named = {split_title(title)[0]: place for place, title in enumerate(titles)}
        moving = {named[name]: kind for name, kind in _BASE.items() if name in named}
        kinds = {timed: "time", **dict.fromkeys(places.values(), KINDS[command]), **moving}
        values = {
            place: find_factor(titles[place], kind) * take_numbers(sheet, place)
            for place, kind in kinds.items()
        }
        loads = {int(name[5:]): place for name, place in named.items() if _LOAD.fullmatch(name)}
        factors = {number: take_numbers(sheet, place) for number, place in loads.items()}
    except InputError as error:
        raise type(error)(f"{file.name}: {error}") from None
    commands = np.zeros((len(sheet.rows), len(robot.tendons)))
    for name, place in places.items():
        commands[:, robot.tendon_names.index(name)] = values[place]
    base = None
    if moving:
        from scipy.spatial.transform import Rotation

        zero = np.zeros(len(sheet.rows))
        x, y, z, *turns = (values.get(named.get(name, -1), zero) for name in _BASE)
        base = np.tile(np.eye(4), (len(zero), 1, 1))
        base[:, :3, :3] = Rotation.from_rotvec(np.stack(turns, axis=1)).as_matrix()
        base[:, :3, 3] = np.stack([x, y, z], axis=1)
    kind: Command = "displacement" if command == "displacement" else "tension"
    notes = _note_ignored(titles, {*kinds, *loads.values()})
    return TimedCommands(kind, values[timed], commands, notes, factors, base)


class RobotRows(NamedTuple):
    """Commands of a robot in the order of time, and where its markers were seen, if they were.

    Attributes
    ----------
    command : {"displacement", "tension"}
        What is commanded.
    commands : (n, t) ndarray
        Of all tendons: displacements [mm] or tensions [N].
    points : (n, m, 3) ndarray
        In the world [mm]; NaN where a marker was not seen.
    notes : tuple of str
        What of the table was ignored.
    """

    command: Command
    commands: Floats
    points: Floats
    notes: tuple[str, ...] = ()


def read_robot_rows(
    path: str | os.PathLike[str],
    robot: RobotDesign,
    *,
    markers: Sequence[Marker],
    columns: Mapping[str, str] | None = None,
) -> RobotRows:
    """Read commands of a robot, and where markers were seen if there are columns of them.

    Columns are those of `read_robot_measurements`; no marker need be there.

    Raises
    ------
    FileFormatError, UnitError, InputError
        As `read_robot_measurements` does.
    """
    file = check_path("path", path)
    try:
        sheet = _spread_points(read_sheet(file))
        titles = _rename(sheet.titles, columns or {})
        check_sheet(sheet, titles)
        sheet = dataclasses.replace(sheet, titles=titles)
        known = {marker.name: marker for marker in markers}
        found, seen = _find_columns(titles, robot, known, demanded=(), needs_points=False)
        name, places = next(iter(found.items()))
        command: Command = "displacement" if name == "displacement" else "tension"
        lacking = [tendon for tendon in robot.tendon_names if tendon not in places]
        if lacking and command == "displacement":
            raise _miss_tendon(lacking[0], robot)
        values, axes = _take_values(sheet, KINDS[name], places, seen)
    except InputError as error:
        raise type(error)(f"{file.name}: {error}") from None
    commands = np.zeros((len(sheet.rows), len(robot.tendons)))
    for tendon, place in places.items():
        commands[:, robot.tendon_names.index(tendon)] = values[place]
    points = np.full((len(sheet.rows), len(markers), 3), np.nan)
    for k, marker in enumerate(markers):
        if marker.name in axes:
            points[:, k] = axes[marker.name]
    return RobotRows(command, commands, points, _note_ignored(titles, values))


def _take_values(
    sheet: Sheet, kind: str, commands: Mapping[str, int], seen: Mapping[str, list[int]]
) -> tuple[dict[int, Floats], dict[str, Floats]]:
    """Return the columns of commands and points by their places, and points (n, 3) by marker.

    A point of which a coordinate is missing is NaN.
    """
    of_axes = [place for axes in seen.values() for place in axes]
    kinds = dict.fromkeys(commands.values(), kind) | dict.fromkeys(of_axes, "length")
    values = {
        place: find_factor(sheet.titles[place], each)
        * take_numbers(sheet, place, empty=MISSING if place in of_axes else ())
        for place, each in kinds.items()
    }
    points = {
        name: np.stack([values[place] for place in axes], axis=-1) for name, axes in seen.items()
    }
    for places in points.values():
        places[~np.isfinite(places).all(axis=-1)] = np.nan
    return values, points


def _note_ignored(titles: Sequence[str], used: Collection[int]) -> tuple[str, ...]:
    """Return a note on the columns of a table that are not at the places `used`, if any."""
    ignored = [title for place, title in enumerate(titles) if place not in used]
    return (f"ignored columns: {', '.join(ignored)}",) if ignored else ()


def _find_times(titles: Sequence[str]) -> int:
    """Return where the times are."""
    timed = [place for place, title in enumerate(titles) if split_title(title)[0] == "time"]
    if len(timed) != 1:
        raise FileFormatError(
            f"there are {len(timed)} columns of times: one must be 'time [s]'; the table has "
            f"{_quote(titles)}"
        )
    return timed[0]


def _take_sheet(
    sheet: Sheet,
    robot: RobotDesign,
    known: dict[str, Marker],
    columns: Mapping[str, str] | None,
    rest: tuple[str, bool],
) -> RobotMeasurements:
    blocks, timed = rest
    titles = _rename(sheet.titles, columns or {})
    check_sheet(sheet, titles)
    calibration = robot.calibration if isinstance(robot, ContinuumRobot) else None
    own = {item.name: item for item in (calibration.markers if calibration else ())}
    everything = {TIP: Marker(name=TIP)} | own | known
    commands, seen = _find_columns(titles, robot, everything, demanded=known)
    label = titles.index(blocks) if blocks in titles else -1
    if blocks and label < 0:
        raise FileFormatError(f"there is no column '{blocks}' with labels of blocks")
    command = next(iter(commands))
    sheet = dataclasses.replace(sheet, titles=titles)
    values, places = _take_values(sheet, KINDS[command], commands[command], seen)
    if timed:
        at = _find_times(titles)
        values[at] = find_factor(titles[at], "time") * take_numbers(sheet, at)
    points = np.stack([*places.values()], axis=1)
    empty = int((~np.isfinite(points).any(axis=(1, 2))).sum())
    notes = []
    if empty:
        notes.append(
            f"{empty} row(s) without a point are not compared; their commands are history of the "
            "rows after them"
        )
    lacking = [name for name in own if name not in seen]
    if lacking:
        notes.append(f"markers of the robot without columns are left out: {', '.join(lacking)}")
    notes += _note_ignored(titles, (*values, label))
    words = [str(row[label]) for row in sheet.rows] if blocks else [""] * len(sheet.rows)
    return RobotMeasurements(
        command="displacement" if command == "displacement" else "tension",
        tendons=tuple(commands[command]),
        commands=np.stack([values[place] for place in commands[command].values()], axis=-1),
        markers=tuple(everything[name] for name in seen),
        points=points,
        blocks=np.asarray(words),
        times=values[at] if timed else np.zeros(0),
        notes=tuple(notes),
    )


TRACKED = ("row", "marker", "x_mm", "y_mm", "z_mm")
"""Columns of a table of ``bozzini vision track``, which has a row for each point."""


def _spread_points(sheet: Sheet) -> Sheet:
    """Return a table with a row for each moment of one with a row for each point, else as it is."""
    titles = [title.strip() for title in sheet.titles]
    if not set(TRACKED) <= set(titles):
        return sheet
    check_sheet(sheet, titles)
    row, marker, *axes = (titles.index(name) for name in TRACKED)
    copied = [place for place in range(marker) if place != row]
    points: dict[str, dict[str, Sequence[object]]] = {}
    numbers: list[int] = []
    for number, cells in zip(sheet.numbers, sheet.rows, strict=True):
        moment, name = str(cells[row]).strip(), str(cells[marker]).strip()
        if moment not in points:
            numbers.append(number)
        seen = points.setdefault(moment, {})
        if name in seen:
            raise FileFormatError(f"row {number}: marker '{name}' is in row {moment} twice")
        seen[name] = cells
    names = list(dict.fromkeys(name for seen in points.values() for name in seen))
    rows = [
        [next(iter(seen.values()))[place] for place in copied]
        + [seen[name][axis] if name in seen else "" for name in names for axis in axes]
        for seen in points.values()
    ]
    heads = [titles[place] for place in copied]
    heads += [f"{name} {axis} [mm]" for name in names for axis in "xyz"]
    return Sheet(heads, rows, numbers, sheet.may_have_commas)


def _rename(titles: Sequence[str], columns: Mapping[str, str]) -> list[str]:
    """Return the titles, other ones in place of some."""
    stripped = [title.strip() for title in titles]
    for old in columns:
        if old not in stripped:
            raise FileFormatError(f"there is no column '{old}': the table has {_quote(stripped)}")
    return [columns.get(title, title) for title in stripped]


def _quote(titles: Sequence[str]) -> str:
    return ", ".join(f"'{title}'" for title in titles)


def check_sheet(sheet: Sheet, titles: Sequence[str]) -> None:
    """Raise `FileFormatError` if there are no rows, or one has not a cell for each title."""
    if not sheet.rows:
        raise FileFormatError("the table has a header and no rows")
    for number, row in zip(sheet.numbers, sheet.rows, strict=True):
        if len(row) != len(titles):
            raise FileFormatError(
                f"row {number}: it has {len(row)} cell(s): the header has {len(titles)}"
            )


def _find_columns(
    titles: Sequence[str],
    robot: RobotDesign,
    known: Mapping[str, Marker],
    *,
    demanded: Collection[str],
    needs_points: bool = True,
) -> tuple[dict[str, dict[str, int]], dict[str, list[int]]]:
    """Return where the commands are, by kind and tendon, and the coordinates of each marker."""
    commands: dict[str, dict[str, int]] = {}
    seen: dict[str, dict[str, int]] = {}
    others: list[str] = []
    for place, title in enumerate(titles):
        name = split_title(title)[0]
        tendon, _, kind = name.rpartition(" ")
        axis = _AXIS.fullmatch(name)
        if kind in KINDS and tendon:
            _check_known([tendon.strip()], robot)
            found, key = commands.setdefault(kind, {}), tendon.strip()
        elif axis and axis[1] in known:
            found, key = seen.setdefault(axis[1], {}), axis[2]
        else:
            others += [axis[1]] if axis else []
            continue
        if key in found:
            raise FileFormatError(f"columns '{titles[found[key]]}' and '{title}' are the same")
        found[key] = place
    if not commands:
        raise FileFormatError(
            "there is no column with a command, such as 'T1 displacement [mm]' or 'T1 tension "
            f"[N]': rename columns or give their titles (--column); there are {_quote(titles)}"
        )
    if len(commands) > 1:
        raise FileFormatError("there are columns of displacements and of tensions: give one kind")
    if not seen and needs_points:
        hint = f": say where '{others[0]}' is on the body" if others else ""
        raise FileFormatError(
            f"there is no column with a point, such as 'tip x [mm]'{hint}; the table has "
            f"{_quote(titles)}"
        )
    for name in known:
        lacking = [axis for axis in "xyz" if axis not in seen.get(name, {})]
        if lacking and (name in seen or name in demanded):
            raise FileFormatError(f"there is no column '{name} {lacking[0]} [mm]' of '{name}'")
    return commands, {name: [axes[axis] for axis in "xyz"] for name, axes in seen.items()}


def find_factor(title: str, kind: str) -> float:
    """Return the value of one unit of a column."""
    unit = split_title(title)[1]
    if not unit:
        example = EXAMPLES[kind]
        raise UnitError(f"column '{title}' has no unit: write '{show_cell(title)} [{example}]'")
    try:
        return parse_unit(unit, kind)
    except UnitError as error:
        raise UnitError(f"column '{title}': {error}") from None
