"""Measurements of muscles: a checked table, its statistics, and reading and writing it."""

from __future__ import annotations

import csv
import dataclasses
import difflib
import io
import itertools
import math
import os
import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number, check_path
from ..errors import FileFormatError, InputError, MissingExtraError, UnitError
from ..io.files import write_text
from ..results import Json, take_axes
from ..units import parse_quantity
from .design import PRESSURE_LIMIT

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

    from .design import Muscle


DIRECTIONS = ("inflating", "deflating", "")
"""What a row's direction may be; empty means that it is not known or does not matter."""

LOAD_LIMIT = 1e6
"""A load above this [N] is taken for a wrong unit."""

COLUMNS = ("pressure", "contraction", "load", "direction", "specimen")
_RANGES = {
    "pressure": (0.0, PRESSURE_LIMIT, "MPa"),
    "contraction": (-math.inf, math.inf, "mm"),
    "load": (0.0, LOAD_LIMIT, "N"),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurements:
    """Measured states of one kind of muscle, a row each. The arrays are read-only.

    A blocked muscle is a row as well: its contraction is 0 and its force is the load.

    Parameters
    ----------
    pressure : array_like, shape (n,)
        Gauge pressure, 0 to 100 [MPa].
    contraction : array_like, shape (n,)
        Free length less length [mm].
    load : array_like, shape (n,), optional
        Axial tension that the muscle holds, 0 to 1e6 [N]; one number counts for all rows. A muscle
        cannot push.
    direction : sequence of str, optional
        ``"inflating"``, ``"deflating"`` or ``""``; one text counts for all rows.
    specimen : sequence of str, optional
        Which muscle, without control characters; one text counts for all rows. Blanks at its ends
        are dropped.
    ignored : tuple of str
        Columns of the file that were not used.
    numbers : array_like of int, shape (n,), optional
        Row of each in its file, by which messages name it; by default counted from 1.
    source : str
        Name of the file, for messages.
    notes : tuple of str
        What `mean_of_directions` left out.

    Raises
    ------
    InputError
        If there is no row, or a value is not finite or outside its range; the row is named.
    """

    pressure: NDArray[np.float64]
    contraction: NDArray[np.float64]
    load: NDArray[np.float64] = field(default_factory=lambda: np.zeros(()))
    direction: NDArray[np.str_] = field(default_factory=lambda: np.array(""))
    specimen: NDArray[np.str_] = field(default_factory=lambda: np.array(""))
    ignored: tuple[str, ...] = ()
    numbers: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    source: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        count = np.size(self.pressure)
        if np.ndim(self.pressure) == 1 and count == 0:
            raise InputError("the measurements have 0 rows: there must be 1 or more")
        for name in ("pressure", "contraction", "load"):
            array = np.array(check_array(name, getattr(self, name)))  # a copy
            self._keep(name, array, "(n,)" if name == "pressure" else "")
        numbers = np.array(self.numbers)
        numbers = numbers if numbers.size else np.arange(1, count + 1)
        if numbers.dtype.kind not in "iu":
            raise InputError("numbers must be whole numbers, one for each row")
        self._keep("numbers", numbers.astype(np.int64))
        for name in ("direction", "specimen"):
            self._keep(name, np.char.strip(np.array(getattr(self, name), dtype=np.str_)))
        for name, (low, high, unit) in _RANGES.items():
            values = getattr(self, name)
            legal = (values >= low) & (values <= high) & np.isfinite(values)
            if not legal.all():
                index = int(np.argmin(legal))
                words = f"{self.name_row(index)}: {name}"
                check_number(words, float(values[index]), low=low, high=high, unit=unit)
        for index, (direction, specimen) in enumerate(
            zip(self.direction.tolist(), self.specimen.tolist(), strict=True)
        ):
            if direction not in DIRECTIONS:
                raise InputError(
                    f"{self.name_row(index)}: direction is {direction!r}: it must be inflating, "
                    "deflating or empty"
                )
            if any(unicodedata.category(letter) in ("Cc", "Cs") for letter in specimen):
                raise InputError(
                    f"{self.name_row(index)}: specimen is {specimen!r}: it must be text without "
                    "control characters"
                )

    def _keep(self, name: str, array: NDArray[np.generic], wanted: str = "") -> None:
        """Keep a read-only column; what is one value counts for all rows."""
        count = np.size(self.pressure)
        if array.ndim == 0 and not wanted and name != "numbers":
            array = np.full(count, array)
        if array.ndim != 1 or len(array) != count:
            wanted = wanted or f"({count},), one for each pressure"
            raise InputError(f"{name} has shape {array.shape}: it must be {wanted}")
        array.flags.writeable = False
        object.__setattr__(self, name, array)

    def name_row(self, index: int) -> str:
        """Return how messages name the row of an index, such as ``data.csv: row 3``."""
        where = f"{self.source}: " if self.source else ""
        return f"{where}row {self.numbers[index]}"

    def __len__(self) -> int:
        return len(self.pressure)

    @property
    def branch(self) -> NDArray[np.str_] | None:
        """The directions, as models take them; None if no row has one."""
        return self.direction if (self.direction != "").any() else None

    @property
    def largest_contraction(self) -> float:
        """Largest measured contraction [mm], what percentages are of."""
        return float(self.contraction.max())

    @property
    def has_load(self) -> bool:
        """Whether the rows were measured under more than one load."""
        return bool(np.ptp(self.load) > 1e-9)

    @property
    def has_both_directions(self) -> bool:
        """Whether there are rows of inflation and rows of deflation."""
        return {"inflating", "deflating"} <= set(self.direction.tolist())

    def to_frame(self) -> pandas.DataFrame:
        """Return the table, units in the names of the columns; `take_measurements` goes back."""
        import pandas

        units = {name: f"{name} [{unit}]" for name, (_, _, unit) in _RANGES.items()}
        return pandas.DataFrame({units.get(name, name): getattr(self, name) for name in COLUMNS})

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw contraction over pressure, by direction, and return the axes."""
        axes = take_axes(ax, x="pressure [MPa]", y="contraction [mm]")
        for direction in np.unique(self.direction).tolist():
            rows = self.direction == direction
            label = direction or "measured"
            axes.plot(self.pressure[rows], self.contraction[rows], "o", label=label)
        axes.legend()
        return axes

    def select(self, rows: ArrayLike) -> Measurements:
        """Return the rows of a mask or of indices.

        Raises
        ------
        InputError
            If no row is left, a mask has another length, or there is no row of an index.
        """
        count, index = len(self), np.atleast_1d(np.asarray(rows))
        if index.size == 0:
            index = np.zeros(0, dtype=np.int64)
        elif index.ndim != 1 or index.dtype.kind not in "biu":
            raise InputError(
                f"rows has dtype {index.dtype}: it must be a mask or whole numbers (k,)"
            )
        elif index.dtype.kind == "b" and len(index) != count:
            raise InputError(f"the mask of rows has {len(index)} entries: it must have {count}")
        elif index.dtype.kind != "b" and not (-count <= index.min() and index.max() < count):
            wrong = index[(index < -count) | (index >= count)][0]
            raise InputError(f"row index is {wrong}: it must lie in [{-count}, {count - 1}]")
        columns = {name: getattr(self, name)[index] for name in (*COLUMNS, "numbers")}
        return dataclasses.replace(self, **columns)

    def check_lengths(self, muscle: Muscle, *, braid_angle: float | None = None) -> None:
        """Check that every measured length lies between 0 and the length of the strand.

        Parameters
        ----------
        muscle : Muscle
        braid_angle : float, optional
            In place of the muscle's [rad]: strands of a larger angle are longer.

        Raises
        ------
        InputError
            If one does not; the row is named.
        """
        strand = muscle.braid.strand_length
        if braid_angle is not None:
            strand = muscle.length / math.cos(braid_angle)
        for index, value in enumerate(self.contraction.tolist()):
            check_length(f"{self.name_row(index)}: ", muscle.length - value, strand)

    def mean_of_directions(self) -> Measurements:
        """Return the mean of inflation and deflation, per specimen and load.

        At each pressure of the inflation that the deflation reaches as well, the deflation is
        interpolated linearly and averaged with it; repeats at one pressure are averaged first.
        Rows without a direction are kept as they are. Rows of the inflation that the deflation does
        not reach, such as the turning point, are left out; `Measurements.notes` names them. (There
        friction still holds one way: the mean curve is not known.)

        Raises
        ------
        InputError
            If a specimen at a load has only one direction, or the two share no pressure.
        """
        import pandas

        frame, notes = self._list_rows(), list(self.notes)
        known = frame["direction"] != ""
        parts = [frame[~known]]
        for (load, specimen), rows in frame[known].groupby(["load", "specimen"]):
            words = f"specimen {str(specimen)!r} at {load:g} N"
            branches = rows.groupby(["direction", "pressure"])["contraction"].mean()
            for name in ("inflating", "deflating"):
                if name not in branches:
                    raise InputError(f"{words} has no {name} row: a mean of directions needs both")
            risen, fallen = branches["inflating"], branches["deflating"]
            up, down = risen.index.to_numpy(), fallen.index.to_numpy()
            shared = (up >= down[0]) & (up <= down[-1])
            reached = f"deflation at {down[0]:g} to {down[-1]:g} MPa"
            if not shared.any():
                raise InputError(
                    f"{words}: inflation at {up[0]:g} to {up[-1]:g} MPa and {reached} share none"
                )
            if not shared.all():
                lost = ", ".join(f"{p:g}" for p in up[~shared])
                notes.append(
                    f"{words}: inflation at {lost} MPa left out, which the {reached} does not reach"
                )
            mean = 0.5 * (risen.to_numpy() + np.interp(up, down, fallen.to_numpy()))
            columns = {"pressure": up[shared], "contraction": mean[shared], "load": load}
            parts.append(pandas.DataFrame({**columns, "direction": "", "specimen": specimen}))
        merged = pandas.concat([part for part in parts if len(part)])
        return Measurements(
            **{name: merged[name].to_numpy() for name in COLUMNS},
            ignored=self.ignored,
            notes=tuple(notes),
        )

    def _list_rows(self) -> pandas.DataFrame:
        """Return the rows as a table, loads that are equal but for round-off made equal."""
        import pandas

        frame = pandas.DataFrame({name: getattr(self, name) for name in COLUMNS})
        return frame.assign(load=frame["load"].round(9))

    def repeat_statistics(self, *, tolerance: float = 1e-6) -> RepeatStatistics:
        """Return mean and spread of the rows that repeat a state.

        Rows repeat each other if they have the same load and direction, and their pressures,
        in order, lie within `tolerance` of the next one. All specimens count together.

        Parameters
        ----------
        tolerance : float
            Difference of pressures that counts as none [MPa].

        Raises
        ------
        InputError
            If the tolerance is negative.
        """
        check_number("tolerance", tolerance, low=0.0, unit="MPa")
        order = np.lexsort((self.pressure, self.direction, self.load.round(9)))
        pressure, load = self.pressure[order], self.load.round(9)[order]
        direction, measured = self.direction[order], self.contraction[order]
        fresh = np.ones(len(self), dtype=np.bool_)
        fresh[1:] = (np.diff(pressure) > tolerance) | (np.diff(load) != 0.0)
        fresh[1:] |= direction[1:] != direction[:-1]
        state = np.cumsum(fresh) - 1
        count = np.bincount(state)
        mean = np.bincount(state, measured) / count
        squares = np.bincount(state, (measured - mean[state]) ** 2)
        freedom = int((count - 1).sum())
        return RepeatStatistics(
            pressure=np.bincount(state, pressure) / count,
            load=load[fresh],
            direction=direction[fresh],
            count=count,
            mean=mean,
            deviation=np.sqrt(squares / np.maximum(count - 1, 1)),
            pooled_deviation=float(np.sqrt(squares.sum() / max(freedom, 1))),
            degrees_of_freedom=freedom,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RepeatStatistics:
    """Mean and spread of repeated measurements, an entry for each state.

    Parameters
    ----------
    pressure, load : ndarray, shape (k,)
        The state [MPa], [N].
    direction : ndarray of str, shape (k,)
    count : ndarray of int, shape (k,)
        How many rows.
    mean : ndarray, shape (k,)
        Mean contraction [mm].
    deviation : ndarray, shape (k,)
        Standard deviation with n - 1 [mm]; 0 where there is one row.
    pooled_deviation : float
        Standard deviation of a single measurement, from all repeats together [mm].
    degrees_of_freedom : int
        Of `pooled_deviation`; 0 means that nothing was repeated and the deviation is meaningless.
    """

    pressure: NDArray[np.float64]
    load: NDArray[np.float64]
    direction: NDArray[np.str_]
    count: NDArray[np.int64]
    mean: NDArray[np.float64]
    deviation: NDArray[np.float64]
    pooled_deviation: float
    degrees_of_freedom: int


def read_measurements(
    path: str | os.PathLike[str],
    *,
    muscle: Muscle | None = None,
    units: Mapping[str, str] | None = None,
) -> Measurements:
    """Read measurements from a CSV or Parquet file.

    Columns: `pressure`; `contraction`, or `length`, which needs the muscle; if there, `load`
    (or `force`), `direction` and `specimen`. The unit of a column stands in its name, as in
    ``pressure [kPa]``, ``length (mm)`` or ``load_N``, or in `units`. A CSV file is UTF-8 with
    ``,``, ``;`` or tabs between columns and a decimal point; a line that begins with ``#`` is a
    comment. Other columns are ignored, and named in `Measurements.ignored`.

    Parameters
    ----------
    path : path-like
        A file ending in .csv, .tsv, .txt, .parquet or .pq; Parquet needs the extra ``parquet``.
    muscle : Muscle, optional
        The muscle measured: turns length into contraction, and lengths are checked against its
        strand.
    units : mapping, optional
        Unit of a column whose name has none, such as ``{"pressure": "kPa"}``.

    Raises
    ------
    FileFormatError
        If the file cannot be read as such a table. The row is named: the line of a CSV file, the
        record of a Parquet file counted from 1.
    UnitError
        If a column has no unit, two, or a wrong one.
    InputError
        If a value is outside its range.
    MissingExtraError
        If a Parquet file is given and ``pyarrow`` is not installed.
    """
    path = check_path("path", path)
    suffix = path.suffix.lower()
    if suffix in _PARQUET_SUFFIXES:
        sheet = _read_parquet(path)
    elif suffix in _TEXT_SUFFIXES:
        sheet = _read_text(path)
    else:
        known = ", ".join(_TEXT_SUFFIXES + _PARQUET_SUFFIXES)
        raise FileFormatError(f"{path.name} ends in '{suffix}': a table ends in one of {known}")
    try:
        data = _take_sheet(sheet, muscle, units or {})
    except InputError as error:
        raise type(error)(f"{path.name}: {error}") from None
    return dataclasses.replace(data, source=path.name)


def take_measurements(
    data: Measurements | pandas.DataFrame,
    *,
    muscle: Muscle | None = None,
    units: Mapping[str, str] | None = None,
) -> Measurements:
    """Return measurements from a table of pandas; measurements are returned as they are.

    The columns are those that `read_measurements` reads, units in their names.

    Parameters
    ----------
    data : Measurements or DataFrame
    muscle, units : optional
        As in `read_measurements`.

    Raises
    ------
    FileFormatError, UnitError, InputError
        As `read_measurements` does; rows are counted from 1.
    """
    if isinstance(data, Measurements):
        return data
    if not hasattr(data, "columns"):
        raise InputError(f"data is a {type(data).__name__}: it must be Measurements or a DataFrame")
    return _take_sheet(_take_frame(data), muscle, units or {})


def write_measurements(path: str | os.PathLike[str], data: Measurements) -> Path:
    """Write measurements as a CSV file that `read_measurements` reads back exactly.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    return write_text(path, data.to_frame().to_csv(index=False, lineterminator="\n"))


def check_length(where: str, length: float, strand: float) -> float:
    """Return a measured length if a muscle of such strands can have it, or raise `InputError`."""
    if length > strand:
        raise InputError(
            f"{where}length is {length:g} mm, longer than the strand: "
            f"it must lie in (0, {strand:g}] mm"
        )
    return check_number(f"{where}length", length, low=0.0, low_open=True, high=strand, unit="mm")


KINDS = {"pressure": "pressure", "contraction": "length", "length": "length", "load": "force"}
"""The columns that hold quantities, and the kind of each."""
WORDS = ("direction", "specimen")
"""The columns that hold text."""
SYNONYMS = {"force": "load", "branch": "direction"}
BRANCHES = {
    "inflating": "inflating",
    "inflation": "inflating",
    "up": "inflating",
    "deflating": "deflating",
    "deflation": "deflating",
    "down": "deflating",
    "": "",
}
LIMITS = {"pressure": (PRESSURE_LIMIT, "MPa"), "load": (LOAD_LIMIT, "N")}
EXAMPLES = {"pressure": "kPa", "contraction": "mm", "length": "mm", "load": "N"}

# A name, and perhaps a unit in brackets or after an underscore.
_HEADER = re.compile(r"\s*([A-Za-z]+)\s*(?:[\[(]\s*([^\])]*?)\s*[\])]|_([^\s\[(]+))?\s*")
_TEXT_SUFFIXES = (".csv", ".tsv", ".txt")
_PARQUET_SUFFIXES = (".parquet", ".pq")


@dataclass(frozen=True)
class _Column:
    """Where a column stands, how it is called in the file, and what its numbers are times."""

    place: int
    title: str
    factor: float


@dataclass(frozen=True)
class _Sheet:
    """A table as text: its titles, its rows, and the number of each row in the file."""

    titles: Sequence[str]
    rows: Sequence[Sequence[object]]
    numbers: Sequence[int]


def _take_frame(table: pandas.DataFrame) -> _Sheet:
    cells = table.astype(object).where(table.notna(), "").to_numpy().tolist()
    return _Sheet([_show(name) for name in table.columns], cells, range(1, len(cells) + 1))


def _read_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise FileFormatError(f"cannot read {path}: {error.strerror or error}") from None
    except ValueError as error:  # a null byte in the name
        raise FileFormatError(f"cannot read {path}: {error}") from None


def _read_text(path: Path) -> _Sheet:
    try:
        text = _read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FileFormatError(f"{path.name} is not text in UTF-8: save the table as CSV") from None
    records = _Records(text)
    cells, numbers = [], []
    try:
        for row in records:
            cells.append(row)
            numbers.append(records.start)
    except csv.Error as error:
        raise FileFormatError(f"{path.name}: row {records.start} is not CSV: {error}") from None
    if not cells:
        raise FileFormatError(f"{path.name} is empty: a table has a header and rows")
    kept = [i for i, row in enumerate(cells) if i and any(map(str.strip, row))]
    titles = [_show(title) for title in cells[0]]
    return _Sheet(titles, [cells[i] for i in kept], [numbers[i] for i in kept])


class _Records:
    """The records of a CSV text, without comments; a quoted cell may hold ends of lines.

    `start` is the line on which the last one begins, counted from 1.
    """

    def __init__(self, text: str) -> None:
        self.start = 0
        self._fresh = True
        # Unlike str.splitlines this breaks lines where CSV does and nowhere else.
        self._lines = enumerate(io.StringIO(text, newline=""), start=1)
        first = next(self._feed(), "")
        mark = max(",;\t", key=first.count)
        self._reader = csv.reader(
            itertools.chain([first] if first else [], self._feed()),
            delimiter=mark,
            skipinitialspace=True,
            strict=True,  # a quote that is not closed would take the rest of the file
        )

    def __iter__(self) -> Iterator[list[str]]:
        return self

    def __next__(self) -> list[str]:
        row = next(self._reader)
        self._fresh = True
        return row

    def _feed(self) -> Iterator[str]:
        for number, line in self._lines:
            if self._fresh:
                if not line.strip() or line.lstrip().startswith("#"):
                    continue
                self.start = number
            self._fresh = False
            yield line


def _read_parquet(path: Path) -> _Sheet:
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise MissingExtraError("pyarrow", "parquet") from None
    try:
        table = parquet.read_table(io.BytesIO(_read_bytes(path)))
    except (ArrowException, OSError) as error:
        what = " ".join(str(error).split())
        raise FileFormatError(f"{path.name} is not a Parquet file: {what}") from None
    return _take_frame(table.to_pandas())


def _take_sheet(sheet: _Sheet, muscle: Muscle | None, units: Mapping[str, str]) -> Measurements:
    columns, ignored = _find_columns(sheet.titles, units)
    if not sheet.rows:
        raise FileFormatError("the table has a header and no rows")
    if "length" in columns and muscle is None:
        raise InputError(f"column '{columns['length'].title}' needs the muscle: its free length")
    numbers: dict[str, list[float]] = {"pressure": [], "contraction": [], "load": []}
    words: dict[str, list[str]] = {"direction": [], "specimen": []}
    for number, row in zip(sheet.numbers, sheet.rows, strict=True):
        where = f"row {number}: "
        if len(row) != len(sheet.titles):
            raise FileFormatError(
                f"{where}it has {len(row)} cell(s): the header has {len(sheet.titles)}"
            )
        for name, column in columns.items():
            cell = row[column.place]
            if name in WORDS:
                words[name].append(_take_word(where, name, cell))
                continue
            value = _take_quantity(where, name, column, cell)
            if muscle is not None and name in ("length", "contraction"):
                length = value if name == "length" else muscle.length - value
                check_length(where, length, muscle.braid.strand_length)
                value = muscle.length - length if name == "length" else value
            numbers["contraction" if name == "length" else name].append(value)
    given: Json = {
        name: np.array(values) for name, values in {**numbers, **words}.items() if values
    }
    return Measurements(**given, ignored=ignored, numbers=np.array(sheet.numbers, dtype=np.int64))


def _find_columns(
    titles: Sequence[str], units: Mapping[str, str]
) -> tuple[dict[str, _Column], tuple[str, ...]]:
    """Return the known columns by name, and the titles of the others."""
    for name in units:
        if name not in KINDS:
            raise UnitError(f"unit given for '{name}': a unit has one of {', '.join(KINDS)}")
    columns: dict[str, _Column] = {}
    ignored = []
    for place, title in enumerate(titles):
        name, unit = _split_title(title)
        if name not in KINDS and name not in WORDS:
            _refuse_slip(title, name)
            ignored.append(title.strip())
            continue
        if name in columns:
            raise FileFormatError(f"columns '{columns[name].title}' and '{title}' are both {name}")
        factor = _find_factor(name, title, unit, units) if name in KINDS else 1.0
        columns[name] = _Column(place, title.strip(), factor)
    there = ", ".join(f"'{title.strip()}'" for title in titles)
    if "pressure" not in columns:
        raise FileFormatError(f"there is no column pressure: the table has {there}")
    if "contraction" in columns and "length" in columns:
        raise FileFormatError("there are columns contraction and length: give one of them")
    if "contraction" not in columns and "length" not in columns:
        raise FileFormatError(f"there is no column contraction or length: the table has {there}")
    return columns, tuple(ignored)


def _split_title(title: str) -> tuple[str, str]:
    """Return the name and the unit in a column's title; the unit is empty if there is none."""
    match = _HEADER.fullmatch(str(title))
    if match is None:
        return str(title).strip().lower(), ""
    name = match[1].lower()
    return SYNONYMS.get(name, name), match[2] or match[3] or ""


def _refuse_slip(title: str, name: str) -> None:
    """Raise if the name is likely a slip of the pen: to ignore it would change the result."""
    near = difflib.get_close_matches(name, [*KINDS, *WORDS, *SYNONYMS], n=1, cutoff=0.75)
    if near:
        raise FileFormatError(f"column '{title.strip()}' is not known: is it {near[0]}?")


def _find_factor(name: str, title: str, unit: str, units: Mapping[str, str]) -> float:
    given = units.get(name, "")
    example = f"'{name} [{EXAMPLES[name]}]'"
    if unit and given:
        one, two = (
            parse_quantity(f"1 {unit}", KINDS[name]),
            parse_quantity(f"1 {given}", KINDS[name]),
        )
        if not math.isclose(one, two):
            raise UnitError(f"column '{title.strip()}' has another unit than the '{given}' given")
    if not (unit or given):
        raise UnitError(f"column '{title.strip()}' has no unit: write {example}, or give the unit")
    try:
        return parse_quantity(f"1 {unit or given}", KINDS[name])
    except UnitError as error:
        raise UnitError(f"column '{title.strip()}': {error}") from None


def _take_word(where: str, name: str, cell: object) -> str:
    word = str(cell).strip()
    if name == "specimen":
        return word
    if word.lower() not in BRANCHES:
        raise FileFormatError(
            f"{where}direction is '{_show(cell)}': it must be inflating, deflating or empty"
        )
    return BRANCHES[word.lower()]


def _take_quantity(where: str, name: str, column: _Column, cell: object) -> float:
    value = _take_number(where, name, cell) * column.factor
    high, unit = LIMITS.get(name, (math.inf, ""))
    if name in LIMITS and not 0.0 <= value <= high:
        raise InputError(
            f"{where}{name} is {_show(cell)} in '{column.title}', {value:g} {unit}: it must lie in "
            f"[0, {high:g}] {unit}"
        )
    return value


def _show(cell: object) -> str:
    """Return a cell as one short line."""
    text = " ".join(str(cell).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def _take_number(where: str, name: str, cell: object) -> float:
    text = str(cell).strip()
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    # Python's own float takes 1_000 and the digits of every script.
    if "_" not in text and text.isascii() and math.isfinite(value) and not isinstance(cell, bool):
        return value
    hint = ""
    if not text:
        hint = " (the cell is empty)"
    elif re.fullmatch(r"[-+]?[0-9]+,[0-9]+", text):
        hint = " with a decimal point"
    elif re.match(r"[-+.0-9]+\s*[A-Za-zµ]", text) and math.isnan(value):
        hint = ": a unit belongs into the header, one for the whole column"
    raise FileFormatError(f"{where}{name} is '{_show(text)}': it must be a finite number{hint}")
