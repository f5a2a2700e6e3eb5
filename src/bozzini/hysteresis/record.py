"""Tables of loops: an input and an output of any quantity, in runs."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..checks import check_path
from ..errors import FileFormatError, InputError, UnitError
from ..io.sheets import (
    Sheet,
    find_title,
    read_sheet,
    rename_titles,
    show_cell,
    split_title,
    take_numbers,
)
from ..muscle.hysteresis.operator import LIMIT
from ..muscle.loops.record import find_bins, smooth_input
from ..numeric.arrays import Floats
from ..results import Shown

FEWEST = 20
"""Rows that a table of loops must have."""
_NOT_SEEN = ("", "nan", "na", "-")


@dataclass(frozen=True, kw_only=True)
class LoopTitles:
    """Which columns of a table are taken, by their titles, with or without their units.

    Without an input or an output there must be two columns of numbers beside time and run: the
    other one is meant, or the first as the input. `run` labels the rows of each run; a time that
    goes back begins one, too.
    """

    input: str = ""
    output: str = ""
    time: str = ""
    run: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopRuns(Shown):
    """Rows of inputs and outputs in the order of time, run after run.

    Parameters
    ----------
    input : ndarray, shape (n,)
    output : ndarray, shape (n,)
        NaN where there is none.
    time : ndarray, shape (n,)
        [s, or the unit of the table]; numbers of rows where there is no time.
    labels : tuple of str
        Of the runs.
    first : ndarray of int, shape (r,)
        First row of each.
    input_title, output_title, time_title : str
        As in the table, with units; the last is empty without a time.
    source : str
    notes : tuple of str
        What was left out.
    """

    input: Floats
    output: Floats
    time: Floats
    labels: tuple[str, ...]
    first: tuple[int, ...]
    input_title: str
    output_title: str = ""
    time_title: str = ""
    source: str = ""
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.input)

    @property
    def slices(self) -> list[slice]:
        """The rows of each run."""
        ends = [*self.first[1:], len(self)]
        return [slice(a, b) for a, b in zip(self.first, ends, strict=True)]

    @property
    def unit(self) -> str:
        """Unit of the output, empty for none."""
        return split_title(self.output_title)[1]

    @property
    def input_unit(self) -> str:
        """Unit of the input, empty for none."""
        return split_title(self.input_title)[1]

    def list_labels(self) -> list[str]:
        """Return the label of the run of each row."""
        return [
            label
            for label, place in zip(self.labels, self.slices, strict=True)
            for _ in range(place.stop - place.start)
        ]

    def join_times(self) -> Floats:
        """Return times (n,) that go on from run to run: one that restarts follows the last row."""
        step = float(np.median(np.abs(np.diff(self.time)))) if len(self) > 1 else 0.0
        times, end = self.time.copy(), -np.inf
        for place in self.slices:
            if times[place.start] < end:
                times[place] += end + step - times[place.start]
            end = float(times[place].max())
        return times

    def thin(self, count: int, groups: Floats) -> tuple[LoopRuns, Floats]:
        """Return about `count` means of rows that follow each other, and the first row of each.

        They are spread as by `LoopRecord.resample`. With fewer rows all are kept. Of rows with an
        output and without, those with one make the mean. None is of rows of more than one of
        `groups` (n,).
        """
        if len(self) <= count:
            return self, np.arange(len(self), dtype=np.float64)
        parts, begins, first = [], [], [0]
        for place in self.slices:
            time, input_ = self.time[place], self.input[place]
            time = time if np.ptp(time) > 0.0 else np.arange(len(time), dtype=np.float64)
            share = max(int(count * len(time) / len(self)), 10)
            if len(time) <= share or not np.ptp(input_) > 0.0:
                bins = np.arange(len(time))
            else:
                bins, _ = find_bins(time, smooth_input(input_), share)
                bins = np.union1d(bins, np.flatnonzero(np.diff(groups[place])) + 1)
            output = self.output[place]
            seen = np.isfinite(output)
            known = np.add.reduceat(seen, bins, dtype=np.intp)
            seen |= np.repeat(known == 0, np.diff(bins, append=len(time)))
            sizes = np.add.reduceat(seen, bins, dtype=np.intp)
            columns = (input_, output, self.time[place])
            parts.append(
                [np.add.reduceat(np.where(seen, column, 0.0), bins) / sizes for column in columns]
            )
            begins.append(place.start + bins)
            first.append(first[-1] + len(bins))
        inputs, outputs, times = (np.concatenate(part) for part in zip(*parts, strict=True))
        thinned = replace(self, input=inputs, output=outputs, time=times, first=tuple(first[:-1]))
        return thinned, np.concatenate(begins).astype(np.float64)


def read_loops(
    path: str | os.PathLike[str],
    titles: LoopTitles,
    *,
    columns: Mapping[str, str] | None = None,
    like: LoopTitles | None = None,
) -> LoopRuns:
    """Read a table of loops.

    Parameters
    ----------
    path : path-like
        A file that `bozzini.io.sheets.read_sheet` reads: text, packed or not, Parquet, Excel or
        MATLAB.
    titles : LoopTitles
    columns : mapping, optional
        Titles to read in place of those in the file, by these.
    like : LoopTitles, optional
        Titles of an input and an output that hold where none is given. With these the table need
        have no output.

    Raises
    ------
    FileFormatError, MissingExtraError
        If it is no such table; one line names the file.
    """
    path = check_path("path", path)
    sheet = read_sheet(path)
    try:
        return replace(_take(sheet, titles, columns or {}, like), source=path.name)
    except InputError as error:
        raise type(error)(f"{path.name}: {error}") from None


def _take(
    sheet: Sheet, titles: LoopTitles, columns: Mapping[str, str], like: LoopTitles | None
) -> LoopRuns:
    shown = [title.strip() for title in rename_titles(sheet, columns).titles]
    run = _look_for(shown, titles.run, ("run", "window"))
    time = _look_for(shown, titles.time, ("time", "t", "timestamp"))
    needs_output = like is None
    answer: int | None
    if like is None:
        others = [k for k in range(len(shown)) if k not in (run, time)]
        place, answer = _pair(shown, titles, others)
    else:
        place = find_title(shown, titles.input or like.input)
        wanted = titles.output or (like.output if _has(shown, like.output) else "")
        answer = find_title(shown, wanted) if wanted else None
    if place == answer:
        raise FileFormatError(f"'{shown[place]}' is both input and output")
    numbers = [take_numbers(sheet, place, empty=_NOT_SEEN)]
    numbers.append(
        np.full(len(numbers[0]), np.nan)
        if answer is None
        else take_numbers(sheet, answer, empty=_NOT_SEEN)
    )
    numbers.append(
        np.arange(len(numbers[0]), dtype=np.float64)
        if time is None
        else take_numbers(sheet, time, empty=_NOT_SEEN)
    )
    words = [""] * len(numbers[0])
    if run is not None:
        words = [show_cell(row[run]) for row in sheet.rows]
    times, undated = _fill_times(numbers[2], shown[time] if time is not None else "")
    kept = np.isfinite(numbers[0])
    inputs, outputs, times = (values[kept] for values in (*numbers[:2], times))
    words = [word for word, keep in zip(words, kept, strict=True) if keep]
    breaks = np.diff(np.flatnonzero(kept), prepend=-1) > 1
    known = int(np.isfinite(outputs).sum()) if needs_output else len(inputs)
    least = FEWEST if needs_output else 1
    if known < least:
        raise FileFormatError(f"{known} rows have all numbers: {least} are needed")
    for name, values in (("input", inputs), ("output", outputs)):
        if np.abs(values[np.isfinite(values)]).max(initial=0.0) > LIMIT:
            raise FileFormatError(f"the {name} has a number beyond {LIMIT:g}")
    labels, first = _part(words, times, breaks)
    blind = len(inputs) - known
    lost = len(kept) - len(inputs)
    notes = {
        f"{_count(blind)} without an output: only the input is taken there": blind,
        f"{_count(lost)} without an input left out: a run begins after each gap": lost,
        f"{_count(undated)} without a time: that of the row before is taken": undated,
    }
    return LoopRuns(
        input=inputs,
        output=outputs,
        time=times,
        labels=labels,
        first=first,
        input_title=shown[place],
        output_title="" if answer is None else shown[answer],
        time_title="" if time is None else shown[time],
        notes=tuple(note for note, count in notes.items() if count),
    )


def _count(rows: int) -> str:
    return f"{rows} row{'s' * (rows != 1)}"


def _fill_times(times: Floats, title: str) -> tuple[Floats, int]:
    """Return times (n,), that of the row before where there is none, and how many have none."""
    seen = np.flatnonzero(np.isfinite(times))
    if not len(seen):
        raise FileFormatError(f"'{title}' has no number")
    place = np.searchsorted(seen, np.arange(len(times)), side="right") - 1
    return times[seen[np.maximum(place, 0)]], len(times) - len(seen)


def _part(
    words: Sequence[str], times: Floats, breaks: NDArray[np.bool_]
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return labels and first rows of runs: where the label changes, at breaks, or time goes back.

    By less than ten steps it is jitter, unless it is back where the run began.
    """
    same = np.array([one == two for one, two in itertools.pairwise(words)], dtype=np.bool_)
    steps = np.diff(times)
    if np.count_nonzero(steps[same] < 0.0) > np.count_nonzero(steps[same] > 0.0):
        raise FileFormatError(
            f"the time falls from row to row, first {times[0]:g} and last {times[-1]:g}: "
            "sort the rows by time"
        )
    step = float(np.median(np.abs(steps))) if len(steps) else 0.0
    first = [0]
    for row in range(1, len(words)):
        goes_back = times[row] < times[row - 1] - 10.0 * step
        restarts = times[row] < min(times[row - 1] - 1.5 * step, times[first[-1]] + 0.5 * step)
        if breaks[row] or not same[row - 1] or goes_back or restarts:
            first.append(row)
    names = [words[row] for row in first]
    labels = [name or f"{k + 1}" for k, name in enumerate(names)]
    for k, name in enumerate(labels):
        if labels.count(name) > 1:
            labels[k] = f"{name} ({labels[:k].count(name) + 1})"
    return tuple(labels), tuple(first)


def _pair(titles: Sequence[str], given: LoopTitles, others: Sequence[int]) -> tuple[int, int]:
    """Return the places of input and output; of two columns the one that is not named is meant."""
    named = [find_title(titles, title) if title else None for title in (given.input, given.output)]
    free = [k for k in others if k not in named]
    lacking = named.count(None)
    if lacking and len(free) != lacking:
        names = ", ".join(f"'{titles[k]}'" for k in others) or "none"
        if len(others) < 2:
            raise FileFormatError(
                f"there must be an input and an output: beside time and run the table has {names}"
            )
        raise FileFormatError(f"input and output must be named: the table has the columns {names}")
    first, second = (free.pop(0) if place is None else place for place in named)
    return first, second


def _has(titles: Sequence[str], wanted: str) -> bool:
    """Whether some column has a name, be it more than one."""
    names = [split_title(title)[0].lower() for title in titles]
    return bool(wanted) and split_title(wanted)[0].lower() in names


def _look_for(titles: Sequence[str], wanted: str, names: Sequence[str]) -> int | None:
    """Return the place of the column that is wanted, or of one with one of some names, if any."""
    if wanted:
        return find_title(titles, wanted)
    for name in names:
        for k, title in enumerate(titles):
            if re.fullmatch(rf"{name}(_m?s)?", split_title(title)[0], re.IGNORECASE):
                return k
    return None


def check_units(runs: LoopRuns, *, input_title: str, output_title: str) -> None:
    """Raise `UnitError` if a table has other units than those of a fit."""
    for own, known in ((runs.input_title, input_title), (runs.output_title, output_title)):
        one, two = split_title(own)[1], split_title(known)[1]
        if own and one and two and one != two:
            raise UnitError(
                f"{runs.source}: '{own}' has another unit than the fit, which has '{known}'"
            )
