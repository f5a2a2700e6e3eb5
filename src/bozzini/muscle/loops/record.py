"""Recorded loops: reading, turning points, rests, and sampling along the way."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ...checks import (
    add_hint,
    check_array,
    check_integer,
    check_path,
    check_range,
    check_word,
    name_at,
)
from ...errors import FileFormatError, InputError
from ...numeric.arrays import Floats
from ...results import Shown, take_axes
from ..design import PRESSURE_LIMIT
from ..hysteresis.operator import LIMIT
from ..hysteresis.prandtl_ishlinskii import trace_symmetric_plays
from ..table import ZERO_SHARE, read_columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Response = Literal["contraction", "force"]

RESPONSES = {"contraction": "mm", "force": "N"}
"""What a record may hold beside time and pressure, and its unit."""

FEWEST = 10
"""Samples that a record must have."""

_ANY = "; 'bozzini hysteresis fit' takes any input and output"
_REST_SHARE = 0.02  # of the span: so near to the lowest value is there
_HELD_SHARE = 0.1  # of its largest value: what is held changes by less
_NOISES = 3.0  # a pressure has turned when it is back by so many times its noise
_SMALLEST_TURN = 0.002  # of the span, and by this at least
_WAY_SHARE = 0.8  # of the samples kept are spread over the way of the pressure, others over time
_STILL = 0.1  # a sample with less than this share of the mean way is at rest


@dataclass(frozen=True, eq=False, kw_only=True)
class LoopRecord(Shown):
    """Pressure and response of a muscle over time.

    Parameters
    ----------
    time : (n,) array_like
        Times, increasing [s].
    pressure : (n,) array_like
        Pressures [MPa]. Negative ones down to 2 % of the largest are an error of the sensor's zero
        and become 0.
    response : (n,) array_like
        Contraction [mm] or force [N]. It may be off by a constant.
    kind : str
        ``"contraction"`` or ``"force"``.
    held : float
        What is held: the load [N] while the contraction is recorded, the contraction [mm] while the
        force is.
    longest : float
        Length that contractions are counted from [mm], where lengths were recorded; 0 otherwise.
    source : str
        Name of the file.
    notes : tuple of str
        What was changed.

    Raises
    ------
    InputError
        If there are fewer than 10 samples, the time does not increase, the pressure is constant, or
        a value is out of its range.
    """

    time: Floats
    pressure: Floats
    response: Floats
    kind: Response = "contraction"
    held: float = 0.0
    longest: float = 0.0
    source: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_word("kind", self.kind, tuple(RESPONSES))
        for name in ("time", "pressure", "response"):
            array = np.array(check_array(name, getattr(self, name)))
            check_range(name, array, -LIMIT, LIMIT)
            if array.ndim != 1 or array.shape != np.shape(self.time):
                raise InputError(f"{name} has shape {array.shape}: all columns must be (n,)")
            object.__setattr__(self, name, array)
        if len(self.time) < FEWEST:
            raise InputError(f"the record has {len(self.time)} sample(s): it must have {FEWEST}")
        steps = np.diff(self.time)
        if steps.min() <= 0.0:
            index = int(np.argmax(steps <= 0.0)) + 1
            raise InputError(
                f"{name_at('time', self.time, index)} is {self.time[index]:g} s after "
                f"{self.time[index - 1]:g} s: it must increase"
            )
        least, most = float(self.pressure.min()), float(self.pressure.max())
        if least == most:
            raise InputError(f"pressure is {most:g} MPa all along: it must change")
        with add_hint(_ANY):
            low = -ZERO_SHARE * max(most, 0.0)
            check_range("pressure", self.pressure, low, PRESSURE_LIMIT, "MPa")
        if least < 0.0:
            count = int((self.pressure < 0.0).sum())
            object.__setattr__(self, "pressure", np.maximum(self.pressure, 0.0))
            note = f"{count} pressures down to {1e3 * least:.3g} kPa are taken as 0"
            object.__setattr__(self, "notes", (*self.notes, note))

    @property
    def unit(self) -> str:
        """Unit of the response."""
        return RESPONSES[self.kind]

    @property
    def starts_at_rest(self) -> bool:
        """Whether it begins without pressure, to 2 % of the largest."""
        return bool(self.pressure[0] <= _REST_SHARE * self.pressure.max())

    def take(self, rows: slice) -> LoopRecord:
        """Return some of the samples."""
        return replace(
            self, **{name: getattr(self, name)[rows] for name in ("time", "pressure", "response")}
        )

    def resample(self, count: int = 2000) -> LoopSamples:
        """Return means of samples that follow each other: about `count`, and one more at each turn.

        Four fifths are spread evenly over the way of the pressure, up and down, and one fifth over
        time, so that a rest does not count more than a loop. A mean never goes over a turning
        point: where the pressure has come back by three times its noise, or 0.2 % of its span. The
        noise is taken from the second differences.

        Raises
        ------
        InputError
            If the count is not 20 to 100,000.
        """
        count = check_integer("samples", count, low=20, high=100_000)
        first, ways = find_bins(self.time, smooth_input(self.pressure), count)
        sizes = np.diff(first, append=len(self.time))
        columns = (self.time, self.pressure, self.response)
        time, pressure, response = (np.add.reduceat(column, first) / sizes for column in columns)
        return LoopSamples(time, pressure, response, ways)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the response over the pressure, and return the axes."""
        axes = take_axes(ax, x="pressure [kPa]", y=f"{self.kind} [{self.unit}]")
        axes.plot(1e3 * self.pressure, self.response, lw=0.8)
        return axes


def smooth_input(inputs: Floats) -> Floats:
    """Return how far an input (n,) is from its first value, behind a play as wide as its noise."""
    changes = np.diff(inputs, 2)
    noise = float(np.median(np.abs(changes))) / 0.6745 / np.sqrt(6.0)
    width = max(_NOISES * noise, _SMALLEST_TURN * float(np.ptp(inputs)))
    away = inputs - inputs[0]
    steady = trace_symmetric_plays(away[None], [0.5 * width])[0, :, 0]
    return np.asarray(steady if np.ptp(steady) > 0.0 else away)


def find_bins(time: Floats, steady: Floats, count: int) -> tuple[NDArray[np.intp], Floats]:
    """Return the first samples of about `count` groups, and the way of each: see `resample`.

    The way is 1 up, -1 down and 0 at rest; `steady` is the input without its noise (n,).
    """
    steps = np.abs(np.diff(steady, prepend=steady[0]))
    ways = np.sign(np.diff(steady, prepend=steady[0]))
    held = np.maximum.accumulate(np.where(ways != 0.0, np.arange(len(ways)), 0))
    ways = ways[held]
    span = time[-1] - time[0]
    way = np.cumsum(steps) / steps.sum()
    place = _WAY_SHARE * way + (1.0 - _WAY_SHARE) * (time - time[0]) / span
    bins = np.floor(count * place)
    first = np.flatnonzero(np.diff(bins, prepend=-1.0) + np.abs(np.diff(ways, prepend=0.0)))
    moved = np.add.reduceat(steps, first) > _STILL * _WAY_SHARE * steps.sum() / count
    return first, np.where(moved, ways[first], 0.0)


@dataclass(frozen=True, eq=False)
class LoopSamples(Shown):
    """Means of a record's samples, in the order of time.

    Attributes
    ----------
    time, pressure, response : (n,) ndarray
        As in `LoopRecord`.
    direction : (n,) ndarray
        1 where the pressure rises, -1 where it falls, 0 where it rests.
    """

    time: Floats
    pressure: Floats
    response: Floats
    direction: Floats = field(repr=False)

    def __len__(self) -> int:
        return len(self.time)

    def take(self, rows: slice) -> LoopSamples:
        """Return some of the samples."""
        return LoopSamples(*(getattr(self, item.name)[rows] for item in fields(self)))


def read_loop(
    path: str | os.PathLike[str],
    *,
    kind: Response | None = None,
    held: float | None = None,
    units: Mapping[str, str] | None = None,
) -> LoopRecord:
    """Read a record of time, pressure and contraction, length or force from a table.

    Columns are named as in `bozzini.muscle.read_measurements`, with their units. A length becomes
    a contraction, less than the longest one. Of a table with both contraction and force the
    response is the one that changes more, relative to its largest value; the mean of the other is
    what is held.

    Parameters
    ----------
    path : path-like
        A table as `bozzini.muscle.read_measurements` takes it.
    kind : str, optional
        The response, where it is not to be chosen so: ``"contraction"`` or ``"force"``.
    held : float, optional
        Load [N], or contraction [mm] of a record of forces; by default that of the table, or 0.
    units : mapping, optional
        Unit of a column whose name has none, such as ``{"pressure": "kPa"}``.

    Raises
    ------
    FileFormatError, UnitError, InputError, MissingExtraError
        If the file is no such table or the record is not legal; one line names the file.
    """
    source = check_path("path", path).name
    names = ("time", "pressure", "contraction", "length", "load")
    columns, notes = read_columns(path, names, units=units)
    try:
        for name in ("time", "pressure"):
            if name not in columns:
                there = ", ".join(columns) or "none of those it needs"
                raise FileFormatError(f"there is no column {name}: the table has {there}{_ANY}")
        answers, said = take_responses(columns)
        known = _choose_response(answers) if kind is None else kind
        check_word("kind", known, RESPONSES)
        if known not in answers:
            raise FileFormatError(f"there is no column for the {known}")
        others = [values for name, values in answers.items() if name != known]
        notes = (*notes, *said)
        if held is None and others:
            held = float(others[0].mean())
            if np.ptp(others[0]) > _HELD_SHARE * np.abs(others[0]).max():
                other = next(name for name in answers if name != known)
                unit = RESPONSES[other]
                notes += (
                    f"the {other} changes by {np.ptp(others[0]):.4g} {unit} over the record: its "
                    f"mean is taken, {held:.4g} {unit}",
                )
        return LoopRecord(
            time=columns["time"],
            pressure=columns["pressure"],
            response=answers[known],
            kind=known,
            longest=float(columns.get("length", np.zeros(1)).max()),
            held=0.0 if held is None else held,
            source=source,
            notes=notes,
        )
    except InputError as error:
        raise type(error)(f"{source}: {error}") from None


def take_responses(columns: Mapping[str, Floats]) -> tuple[dict[Response, Floats], tuple[str, ...]]:
    """Return contraction and force of a table, those that there are, and notes on them."""
    if "contraction" in columns and "length" in columns:
        raise FileFormatError("there are columns contraction and length: give one of them")
    notes: tuple[str, ...] = ()
    answers: dict[Response, Floats] = {}
    if "contraction" in columns:
        answers["contraction"] = columns["contraction"]
    if "length" in columns:
        longest = float(columns["length"].max())
        answers["contraction"] = longest - columns["length"]
        notes = (f"contraction is {longest:g} mm, the longest length, less the length",)
    if "load" in columns:
        answers["force"] = columns["load"]
    if not answers:
        raise FileFormatError("there is no column contraction, length or force")
    return answers, notes


def _choose_response(answers: Mapping[Response, Floats]) -> Response:
    """Return the response that changes more, relative to its largest value."""

    def change(values: Floats) -> float:
        return float(np.ptp(values)) / (float(np.abs(values).max()) or 1.0)

    return max(answers, key=lambda name: change(answers[name]))
