"""Measured end-effectors: tables of commands, in time or at rest, and of what was seen."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ..checks import check_array, check_number, check_path
from ..errors import FileFormatError, InputError, UnitError
from ..io.sheets import read_sheet, split_title, take_frame, take_numbers
from ..numeric.arrays import Floats
from ..results import Shown
from ..units import is_unit, parse_unit
from .view import ANGLES, LATERAL

if TYPE_CHECKING:
    import pandas

Command = Literal["pressure", "contraction"]

MISSING = ("", "nan", "na", "none")
"""Cells of what was not seen, in lower case."""
TIME_STEP = 1e-9
"""Least step in time that counts as one [s]."""

_COMMANDS = {"pressure": "pressure", "command": "voltage", "contraction": "length"}
_EXAMPLES = {"pressure": "kPa", "voltage": "V", "length": "mm", "time": "s", "angle": "deg",
             "force": "N"}  # fmt: skip
_SPOT_WORDS = ("spot", "dot")


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectorMeasurements(Shown):
    """What was commanded of an end-effector, and what was seen.

    Parameters
    ----------
    muscles : tuple of str
        Names of the muscles with a command.
    commands : ndarray, shape (n, m)
        Pressures [MPa], or contractions [mm].
    channels : tuple of str
        What was seen; see `TipView.observe`. ``R force`` is the pull of muscle R [N].
    seen : ndarray, shape (n, q)
        Values [mm, rad, N]; NaN where nothing was seen.
    times : ndarray, shape (n,), optional
        Time of each row [s]; a run begins where the label changes. Without, rows are at rest.
    runs : ndarray of str, shape (n,)
        Label of each row: its run, or the group that it is left out with.
    command : {"pressure", "contraction"}
        What is commanded.
    source : str
        Name of the file.
    notes : tuple of str
        What a user should know of the table.

    Raises
    ------
    InputError
        If the arrays do not go together, times run backwards, or nothing was seen.
    """

    muscles: tuple[str, ...]
    commands: Floats
    channels: tuple[str, ...]
    seen: Floats
    times: Floats | None = None
    runs: NDArray[np.str_] = field(default_factory=lambda: np.zeros(0, dtype=np.str_))
    command: Command = "pressure"
    source: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        commands = check_array("commands", self.commands)
        seen = np.asarray(self.seen, dtype=np.float64)
        count = len(commands)
        if commands.shape != (count, len(self.muscles)) or not np.isfinite(commands).all():
            raise InputError(
                f"commands have shape {commands.shape}: they must be finite numbers "
                f"(n, {len(self.muscles)}), one for each of {list(self.muscles)}"
            )
        if seen.shape != (count, len(self.channels)):
            raise InputError(
                f"seen has shape {seen.shape}: it must be ({count}, {len(self.channels)}), a value "
                f"for each of {list(self.channels)}"
            )
        if self.channels and not np.isfinite(seen).any():
            raise InputError("nothing was seen: the values are all empty")
        runs = self.runs if len(self.runs) else np.full(count, "")
        if len(runs) != count:
            raise InputError(f"there are {len(runs)} runs for {count} rows: give one for each")
        object.__setattr__(self, "commands", commands)
        object.__setattr__(self, "seen", seen)
        object.__setattr__(self, "runs", np.asarray(runs, dtype=np.str_))
        if self.times is not None:
            self._take_times(check_array("times", self.times))

    def _take_times(self, times: Floats) -> None:
        if times.shape != (len(self),) or not np.isfinite(times).all():
            raise InputError(
                f"times have shape {times.shape}: they must be {len(self)} finite numbers, one "
                "for each row"
            )
        object.__setattr__(self, "times", times)
        names = [str(self.runs[part.start]) for part in self.parts]
        if twice := {name for name in names if names.count(name) > 1}:
            raise InputError(
                f"the rows of run '{sorted(twice)[0]}' are in two places: rows of a run must "
                "follow each other, and each run needs a name of its own"
            )
        for part in self.parts:
            back = np.flatnonzero(np.diff(times[part]) < TIME_STEP)
            if back.size:
                row = part.start + int(back[0])
                raise InputError(
                    f"time runs backwards or stands at row {row + 2} of the data: "
                    f"{times[row + 1]:g} s after {times[row]:g} s; if a run begins there, name the "
                    "runs in a column 'run'"
                )

    def __len__(self) -> int:
        return len(self.commands)

    @cached_property
    def parts(self) -> list[slice]:
        """The rows of each run, in the order of the table."""
        ends = np.flatnonzero(self.runs[1:] != self.runs[:-1]) + 1
        edges = [0, *ends.tolist(), len(self)]
        return [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]

    @property
    def span(self) -> float:
        """Largest range of what was seen."""
        return float(np.max(np.nanmax(self.seen, axis=0) - np.nanmin(self.seen, axis=0)))

    def check_range(self, limit: float, *, scale: float = 1.0) -> None:
        """Raise `InputError` for a pressure, over its command by a scale, outside of [0, limit]."""
        pressures = scale * self.commands
        legal = (pressures >= 0.0) & (pressures <= limit * (1.0 + 1e-12))  # round-off of a unit
        outside = np.argwhere(~legal)
        if outside.size:
            row, muscle = (int(place) for place in outside[0])
            raise InputError(
                f"{self.source or 'the table'}: row {row + 1} of the data: the pressure of muscle "
                f"{self.muscles[muscle]} is {pressures[row, muscle]:g} MPa: it must lie in "
                f"[0, {limit:g}] MPa, the limit of the design"
            )

    def select(self, runs: list[str] | tuple[str, ...]) -> EffectorMeasurements:
        """Return the rows of some runs, by name.

        Raises
        ------
        InputError
            If there is no such run.
        """
        known = list(dict.fromkeys(self.runs.tolist()))
        for name in runs:
            if known == [""]:
                raise InputError(f"there is no run '{name}': the table has no column 'run'")
            if name not in known:
                raise InputError(f"there is no run '{name}': there are {', '.join(known)}")
        rows = np.isin(self.runs, runs)
        times = None if self.times is None else self.times[rows]
        return dataclasses.replace(
            self, commands=self.commands[rows], seen=self.seen[rows], runs=self.runs[rows],
            times=times,
        )  # fmt: skip


def read_effector_measurements(
    table: str | os.PathLike[str] | pandas.DataFrame,
    *,
    per_volt: float | None = None,
    columns: Mapping[str, str] | None = None,
    seen_needed: bool = True,
) -> EffectorMeasurements:
    """Read what was commanded and seen of an end-effector from a CSV or Parquet file.

    Commands are columns such as ``R pressure [kPa]``, ``command R [V]`` (of a regulator, with
    `per_volt`) or ``R contraction [mm]``; what was seen is ``tip x [mm]``, ``spot x [cm]`` (or
    ``dot``), ``lateral [mm]``, ``bend [deg]``, ``azimuth [deg]``, ``R force [N]``, and ``NAME x
    [mm]`` of a marker. ``time [s]`` makes it a recording, ``run`` names its runs. Blanks may be
    ``_``, and the unit may be the last word, as in ``command_1_V``. A value that is empty or
    ``nan`` was not seen; the command of its row is history of the rows after it.

    Parameters
    ----------
    table : path-like or DataFrame
    per_volt : float, optional
        Pressure per volt of the regulators [MPa/V].
    columns : mapping of str to str, optional
        Titles to read for titles of the file.
    seen_needed : bool
        Whether there must be a column of what was seen.

    Raises
    ------
    FileFormatError
        If the file is no such table; the message names row and column.
    UnitError
        If a column has no unit or a wrong one.
    InputError
        If times run backwards, or there are volts and no `per_volt`.
    """
    named = isinstance(table, (str, os.PathLike))
    path = check_path("table", table) if named else Path("the table")
    sheet = read_sheet(path) if named else take_frame(table)
    if per_volt is not None:
        check_number("pressure per volt", per_volt, low=0.0, low_open=True, high=10.0, unit="MPa")
    if not sheet.rows:
        raise FileFormatError(f"{path.name}: the table has a header and no rows")
    commands: dict[str, Floats] = {}
    seen: dict[str, Floats] = {}
    kinds, ignored = set(), []
    times: Floats | None = None
    runs: list[str] = []
    try:
        there = [title.strip() for title in sheet.titles]
        for old, new in (columns or {}).items():
            if old not in there and new not in there:
                raise FileFormatError(f"there is no column '{old}' to read as '{new}'")
        for place, old in enumerate(sheet.titles):
            words, unit = _read_title((columns or {}).get(old.strip(), old))
            role, name, kind = _find_role(words)
            if role == "run":
                runs = [str(row[place]).strip() for row in sheet.rows]
                if "" in runs:
                    raise FileFormatError(
                        f"row {sheet.numbers[runs.index('')]}: the run has no name"
                    )
                continue
            if not role:
                ignored.append(old)
                continue
            factor = _find_factor(old, unit, kind)
            values = factor * take_numbers(sheet, place, empty=MISSING if role == "seen" else ())
            if role == "time":
                if times is not None:
                    raise FileFormatError(f"column '{old}' is a second time: leave one out")
                times = values
                continue
            if role == "command":
                kinds.add(kind)
                if kind == "voltage":
                    if per_volt is None:
                        raise InputError(
                            f"column '{old}' has volts: say how much pressure a volt is when the "
                            "end-effector is fitted, such as --per-volt 100kPa"
                        )
                    values = per_volt * values
            target = commands if role == "command" else seen
            if name in target:
                raise FileFormatError(f"column '{old}' is there twice")
            target[name] = values
        if not commands or (seen_needed and not seen):
            lacking = "a command, such as 'R pressure [kPa]'" if not commands else (
                "what was seen, such as 'tip x [mm]' or 'spot x [cm]'")  # fmt: skip
            raise FileFormatError(f"there is no column with {lacking}: rename columns (--column)")
        if "length" in kinds and len(kinds) > 1:
            raise FileFormatError("there are pressures and contractions: give one kind of command")
        values = np.stack(list(seen.values()), axis=-1) if seen else np.zeros((len(sheet.rows), 0))
        lost = int((~np.isfinite(values)).any(axis=-1).sum())
        notes = []
        if lost:
            notes.append(
                f"{lost} row(s) lack what was seen: they are not compared, but their commands are "
                "history of the rows after them"
            )
        notes += [f"ignored columns: {', '.join(ignored)}"] if ignored else []
        return EffectorMeasurements(
            muscles=tuple(commands),
            commands=np.stack(list(commands.values()), axis=-1),
            channels=tuple(seen),
            seen=values,
            times=times,
            runs=np.asarray(runs, dtype=np.str_),
            command="contraction" if "length" in kinds else "pressure",
            source=path.name if named else "",
            notes=tuple(notes),
        )
    except InputError as error:
        raise type(error)(f"{path.name}: {error}") from None


def _read_title(title: str) -> tuple[list[str], str]:
    """Return the words of a title and its unit."""
    name, unit = split_title(title)
    words = [word for word in re.split(r"[\s_]+", name.strip()) if word]
    if not unit and len(words) > 1 and is_unit(words[-1]):
        unit = words.pop()
    return words, unit


def _find_role(words: list[str]) -> tuple[str, str, str]:
    """Return what a column is: its role, its name, and its kind of quantity; empty for none."""
    low = [word.lower() for word in words]
    if low in (["run"], ["time"]):
        return low[0], low[0], "time"
    for word, kind in _COMMANDS.items():
        if word in low and len(low) == 2:
            return "command", words[1 - low.index(word)], kind
    if low == [LATERAL]:
        return "seen", LATERAL, "length"
    if len(low) == 1 and low[0] in ANGLES:
        return "seen", low[0], "angle"
    if len(low) == 2 and low[1] == "force":
        return "seen", f"{words[0]} force", "force"
    if len(low) > 1 and low[-1] in ("x", "y", "z"):
        name = " ".join(words[:-1])
        return "seen", f"{'spot' if name.lower() in _SPOT_WORDS else name} {low[-1]}", "length"
    return "", "", ""


def _find_factor(title: str, unit: str, kind: str) -> float:
    """Return the value of one unit of a column."""
    if not unit:
        raise UnitError(f"column '{title}' has no unit: write '{title} [{_EXAMPLES[kind]}]'")
    try:
        return parse_unit(unit, kind)
    except UnitError as error:
        raise UnitError(f"column '{title}': {error}") from None
