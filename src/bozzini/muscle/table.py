"""Tables of measurements: reading files and data frames, and writing them."""

from __future__ import annotations

import dataclasses
import difflib
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_path, show_apart
from ..errors import FileFormatError, InputError, UnitError
from ..io.files import write_text
from ..io.sheets import (
    DECIMAL_COMMA,
    Sheet,
    format_table,
    read_sheet,
    rename_titles,
    show_cell,
    split_title,
    take_frame,
    take_number,
)
from ..units import drop_in, is_mass, parse_unit
from .data import (
    GEOMETRY,
    LOAD_LIMIT,
    MEASURED,
    Measurements,
    describe_field,
    name_free_length,
    parse_free_length,
    sort_columns,
)
from .design import LOCKING_ANGLE, PRESSURE_LIMIT, Muscle

if TYPE_CHECKING:
    import pandas

ZERO_SHARE = 0.02
"""Negative pressures up to this share of the largest are the error of a sensor's zero."""


def read_measurements(
    path: str | os.PathLike[str],
    *,
    muscle: Muscle | None = None,
    units: Mapping[str, str] | None = None,
    columns: Mapping[str, str] | None = None,
    measured: bool = True,
) -> Measurements:
    """Read measurements from a CSV or Parquet file.

    Columns: `pressure`; `contraction` or `length`; if there, `load` (or `force`, `mass`),
    `direction` and `specimen`. A length, and a contraction in % of the rest length or as a ratio
    (`strain`), need the rest length: that of the muscle, or a column ``rest length [mm]``. Further
    columns give the geometry of each specimen, by the names of the fields of `Muscle` or as
    diameters, the standard errors of the measured ones, such as ``load error [N]``, and the length
    of each specimen without load at a pressure, such as ``length at 620 kPa [mm]``. The unit
    of a column stands in its name, as in ``pressure [kPa]``, ``length (mm)`` or ``load_N``, or in
    `units`. A load in kg is a weight.

    A CSV file is UTF-8 with ``,``, ``;`` or tabs between columns. Numbers have a decimal point, or
    throughout a decimal comma if the columns are not separated by commas. A line that begins with
    ``#`` is a comment. Other columns are ignored, and named in `Measurements.ignored`; what looks
    like a load and is not understood is an error. Negative pressures of at most 2 % of the largest
    one are 0: `Measurements.notes` has what was changed.

    Parameters
    ----------
    path : path-like
        A file ending in .csv, .tsv, .txt, .parquet, .pq, .xlsx or .mat; Parquet needs the extra
        ``tables``.
    muscle : Muscle, optional
        The muscle measured: turns length into contraction, and lengths are checked against its
        strand.
    units : mapping, optional
        Unit of a column whose name has none, such as ``{"pressure": "kPa"}``.
    columns : mapping, optional
        Titles to read in place of those in the file, by these.
    measured : bool
        Of states whose contraction is to be predicted it need not be known: it is 0 then.

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
    sheet = read_sheet(path)
    try:
        sheet = rename_titles(sheet, columns or {})
        data = _take_sheet(sheet, muscle, units or {}, measured=measured)
    except InputError as error:
        raise type(error)(f"{path.name}: {error}") from None
    return dataclasses.replace(data, source=path.name)


def read_columns(
    path: str | os.PathLike[str],
    names: Sequence[str],
    *,
    units: Mapping[str, str] | None = None,
) -> tuple[dict[str, NDArray[np.float64]], tuple[str, ...]]:
    """Return some columns of a table by name, in Bozzini's units, and notes on what was read.

    Parameters
    ----------
    path : path-like
        As in `read_measurements`, from which the columns have their names and units.
    names : sequence of str
        Those that are taken, of ``time``, ``pressure``, ``contraction``, ``length`` and ``load``;
        a column that is not there is not in the answer.
    units : mapping, optional
        As in `read_measurements`.

    Raises
    ------
    FileFormatError, UnitError, InputError, MissingExtraError
        As `read_measurements` does.
    """
    path = check_path("path", path)
    sheet = read_sheet(path)
    columns: dict[str, _Column] = {}
    notes: list[str] = []
    try:
        given = _name_units(units or {}, names)
        for place, title in enumerate(sheet.titles):
            word, unit = _split_title(title)
            name, shown = _find_name(word), title.strip()
            if name in columns:
                both = f"'{columns[name].title}' and '{shown}'"
                raise FileFormatError(f"columns {both} are both {name}")
            if name not in names:
                notes += [] if name in (*KINDS, *WORDS) else _refuse_slip(shown, word, unit)
                continue
            column = _take_column(place, shown, word, unit, given.get(name, ""))
            if column.is_ratio:
                raise UnitError(f"column '{shown}' is a ratio: write 'contraction [mm]'")
            columns[name] = column
            notes += _describe_reading(column, word, unit or given.get(name, ""))
        values, _, commas = _take_cells(sheet, columns)
    except InputError as error:
        raise type(error)(f"{path.name}: {error}") from None
    notes += ["numbers have a decimal comma"] if commas else []
    return values, tuple(notes)


def take_measurements(
    data: Measurements | pandas.DataFrame,
    *,
    muscle: Muscle | None = None,
    units: Mapping[str, str] | None = None,
    measured: bool = True,
) -> Measurements:
    """Return measurements from a table of pandas; measurements are returned as they are.

    The columns are those that `read_measurements` reads, units in their names.

    Parameters
    ----------
    data : Measurements or DataFrame
    muscle, units, measured : optional
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
    return _take_sheet(take_frame(data), muscle, units or {}, measured=measured)


def write_measurements(path: str | os.PathLike[str], data: Measurements) -> Path:
    """Write measurements as a CSV file that `read_measurements` reads back exactly.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    return write_text(path, format_table(data.list_table()))


_MEASURED_KINDS = {
    "pressure": "pressure",
    "contraction": "length",
    "length": "length",
    "load": "force",
}
KINDS = {
    **_MEASURED_KINDS,
    **{f"{name} error": _MEASURED_KINDS[name] for name in MEASURED},
    **{describe_field(name): known.kind for name, known in GEOMETRY.items()},
}
"""The columns that hold quantities, and the kind of each."""
_KINDS = {**KINDS, "time": "time"}
WORDS = ("direction", "specimen")
"""The columns that hold text."""
SYNONYMS = {
    **dict.fromkeys(("force", "tension", "weight", "mass"), "load"),
    **dict.fromkeys(("displacement", "stroke", "strain", "contraction ratio"), "contraction"),
    "p": "pressure",
    "force error": "load error",
    "length error": "contraction error",
    "free length": "rest length",
    "branch": "direction",
}
DIAMETERS = {f"{name} diameter": f"{name} radius" for name in ("outer", "inner", "strand")}
RATIOS = ("strain", "contraction ratio")
"""Names of contractions over the rest length, which need no unit."""
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
EXAMPLES = {"pressure": "kPa", "length": "mm", "force": "N", "angle": "deg", "time": "s"}

_RATIO = re.compile(r"%|percent|1|-|([^\W\d_]+)\s*/\s*\1")
_LOAD_WORDS = re.compile(r"\b(load|force|tension|weight|mass|pull)s?\b")


@dataclass(frozen=True)
class _Column:
    """Where a column stands, how it is called in the file, and what its numbers are times.

    The numbers of a ratio are times the rest length as well.
    """

    place: int
    title: str
    factor: float = 1.0
    is_ratio: bool = False


def _take_sheet(
    sheet: Sheet, muscle: Muscle | None, units: Mapping[str, str], *, measured: bool
) -> Measurements:
    columns, ignored, notes = _find_columns(sheet.titles, units, measured=measured)
    values, words, commas = _take_cells(sheet, columns)
    if not measured and "length" not in values:
        values.setdefault("contraction", np.zeros(len(values["pressure"])))
    _find_contractions(values, columns, muscle)
    notes += ["numbers have a decimal comma"] if commas else []
    notes += _mend_pressures(values, columns["pressure"].title, sheet.numbers)
    notes += _judge_loads(values.get("load", np.zeros(1)), columns, muscle)
    for name in GEOMETRY:
        if (title := describe_field(name)) in values:
            values[name] = values.pop(title)
    data = Measurements(
        **sort_columns({**values, **words}),
        ignored=ignored,
        numbers=np.array(sheet.numbers, dtype=np.int64),
        notes=tuple(notes),
    )
    if muscle is not None:
        data.check_lengths(muscle)
    return data


def _take_cells(
    sheet: Sheet, columns: Mapping[str, _Column]
) -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.str_]], bool]:
    """Return the numbers and the words of columns, and whether they have a decimal comma."""
    if not sheet.rows:
        raise FileFormatError("the table has a header and no rows")
    commas = sheet.may_have_commas and any(
        DECIMAL_COMMA.fullmatch(str(row[column.place]).strip())
        for row in sheet.rows
        for name, column in columns.items()
        if name not in WORDS and column.place < len(row)
    )
    numbers: dict[str, list[float]] = {name: [] for name in columns if name not in WORDS}
    words: dict[str, list[str]] = {name: [] for name in columns if name in WORDS}
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
            else:
                numbers[name].append(_take_quantity(where, name, column, cell, commas=commas))
    values = {name: np.array(column) for name, column in numbers.items()}
    return values, {name: np.array(column) for name, column in words.items()}, commas


def _find_contractions(
    values: dict[str, NDArray[np.float64]], columns: Mapping[str, _Column], muscle: Muscle | None
) -> None:
    """Turn lengths and ratios into contractions, by the rest length of each row."""
    relative = [column.title for column in columns.values() if column.is_ratio]
    relative += [columns["length"].title] if "length" in columns else []
    if not relative:
        return
    rest = values.get("rest length", None if muscle is None else np.asarray(muscle.length))
    if rest is None:
        raise InputError(
            f"column '{relative[0]}' needs the muscle: its free length, or a column "
            "'rest length [mm]'"
        )
    for name, column in columns.items():
        if column.is_ratio:
            values[name] = values[name] * rest
    if "length" in values:
        values["contraction"] = rest - values.pop("length")


def _mend_pressures(
    values: dict[str, NDArray[np.float64]], title: str, numbers: Sequence[int]
) -> list[str]:
    """Set small negative pressures to 0; return what to say of it."""
    pressure = values["pressure"]
    below, least, most = pressure < 0.0, float(pressure.min()), float(pressure.max())
    if not below.any():
        return []
    if least < -ZERO_SHARE * most:
        shown = show_apart(1e3 * least, 1e3 * PRESSURE_LIMIT, 100 * ZERO_SHARE, 1e3 * most)
        raise InputError(
            f"row {numbers[int(np.argmin(pressure))]}: pressure is {shown[0]} kPa in "
            f"'{title}': it must lie in [0, {shown[1]}] kPa; down to "
            f"-{shown[2]} % of the largest, {shown[3]} kPa, is taken as 0"
        )
    values["pressure"] = np.maximum(pressure, 0.0)
    return [
        f"{int(below.sum())} row(s) have a negative pressure, down to {1e3 * least:g} kPa: taken "
        "as 0, the error of the sensor's zero"
    ]


def _judge_loads(
    load: NDArray[np.float64], columns: Mapping[str, _Column], muscle: Muscle | None
) -> list[str]:
    """Return what to say of negative loads, or raise `InputError` where no load is positive.

    A muscle that gets longer under pressure may push all along.
    """
    if not (load < 0.0).any():
        return []
    extends = muscle is not None and muscle.given.get("braid_angle", 0.0) > LOCKING_ANGLE
    if load.max() <= 0.0 and not extends:
        raise InputError(
            f"no load is positive in '{columns['load'].title}', and one is {load.min():g} N: "
            "the pull of a muscle is positive, turn the sign of the column"
        )
    return [
        f"{int((load < 0.0).sum())} row(s) have a negative load, down to {load.min():g} N: the "
        "muscle pushes" + ("" if extends else "; only a force can be compared with them")
    ]


def _find_columns(
    titles: Sequence[str], units: Mapping[str, str], *, measured: bool
) -> tuple[dict[str, _Column], tuple[str, ...], list[str]]:
    """Return the known columns by name, the titles of the others, and what to say of them."""
    given = _name_units(units, tuple(KINDS))
    columns: dict[str, _Column] = {}
    ignored, notes = [], []
    for place, title in enumerate(titles):
        word, unit = _split_title(title)
        name, shown = _find_name(word), title.strip()
        at = parse_free_length(title)
        if at is not None:
            name = name_free_length(at)
            if name in columns:
                raise FileFormatError(
                    f"columns '{columns[name].title}' and '{shown}' are both {name}"
                )
            factor = _find_factor(shown, "length", unit or "mm")
            columns[name] = _Column(place, shown, factor)
            continue
        if name not in KINDS and name not in WORDS:
            notes += _refuse_slip(shown, word, unit)
            ignored.append(shown)
            continue
        if name in columns:
            raise FileFormatError(f"columns '{columns[name].title}' and '{title}' are both {name}")
        if name in WORDS:
            columns[name] = _Column(place, shown)
            continue
        columns[name] = _take_column(place, shown, word, unit, given.get(name, ""))
        notes += _describe_reading(columns[name], word, unit or given.get(name, ""))
    there = ", ".join(f"'{title.strip()}'" for title in titles)
    if "pressure" not in columns:
        raise FileFormatError(f"there is no column pressure: the table has {there}")
    if "contraction" in columns and "length" in columns:
        raise FileFormatError("there are columns contraction and length: give one of them")
    if measured and "contraction" not in columns and "length" not in columns:
        raise FileFormatError(
            "there is no column contraction or length, at which a force is measured or predicted: "
            f"the table has {there}"
        )
    return columns, tuple(ignored), notes


def _name_units(units: Mapping[str, str], legal: Sequence[str]) -> dict[str, str]:
    """Return units that were given, by the names of the columns."""
    given: dict[str, str] = {}
    for word, text in units.items():
        name, unit = _find_name(word), drop_in(text)
        if name not in legal:
            raise UnitError(f"unit given for '{word}': a unit has one of {', '.join(legal)}")
        if given.setdefault(name, unit) != unit:
            raise UnitError(f"{name} is given two units, '{given[name]}' and '{unit}': give one")
    return given


def _find_name(word: str) -> str:
    """Return the column that a word stands for, or the word."""
    return DIAMETERS.get(word) or SYNONYMS.get(word, word)


def _split_title(title: str) -> tuple[str, str]:
    """Return the name and the unit in a column's title; the unit is empty if there is none.

    The unit is in brackets, or after the last underscore of a name that is not known with it.
    """
    text, unit = split_title(title)
    first, mark, last = text.rpartition("_")
    whole, short = (" ".join(re.split(r"[\s_-]+", part)).lower() for part in (text, first))
    is_known = _find_name(whole) in _KINDS or _find_name(whole) in WORDS
    if not unit and mark and not is_known and _find_name(short) in (*_KINDS, *WORDS):
        return short, last
    return whole, unit


def _refuse_slip(title: str, name: str, unit: str) -> list[str]:
    """Raise if to ignore a column would change the result; return what to say of it otherwise."""
    if name.endswith("noise"):
        of = name.removesuffix("noise").strip()
        return [
            f"'{title}' is ignored: scatter within a reading is not its error; name it "
            f"'{of} error' to weight rows by it"
        ]
    near = difflib.get_close_matches(
        name, [*KINDS, *WORDS, *SYNONYMS, *DIAMETERS], n=1, cutoff=0.75
    )
    if near:
        raise FileFormatError(f"column '{title}' is not known: is it {near[0]}?")
    if _LOAD_WORDS.search(name) or _is_load_unit(unit):
        raise FileFormatError(
            f"column '{title}' looks like a load and is not understood: call it 'load [N]' or "
            "'mass [kg]', or leave it out"
        )
    return []


def _is_load_unit(unit: str) -> bool:
    try:
        parse_unit(unit, "force")
    except UnitError:
        return False
    return bool(unit)


def _describe_reading(column: _Column, word: str, unit: str) -> list[str]:
    """Return what to say of a column that is taken for something else than it is called."""
    if is_mass(unit) and _find_name(word).startswith("load"):
        return [f"'{column.title}' is taken as weight: 1 kg is 9.80665 N"]
    if word in ("displacement", "stroke", "strain"):
        what = "contraction over rest length" if column.is_ratio else "contraction"
        return [f"'{column.title}' is taken as {what}: positive where the muscle is shorter"]
    return []


def _take_column(place: int, title: str, word: str, unit: str, given: str) -> _Column:
    """Return a column of numbers, with the factor of its unit."""
    name = _find_name(word)
    kind = _KINDS[name]
    if unit and given:
        one, two = (_find_factor(title, kind, text) for text in (unit, given))
        if not math.isclose(one, two):
            raise UnitError(f"column '{title}' has another unit than the '{given}' given")
    unit = unit or given
    if name in ("contraction", "contraction error") and (
        _RATIO.fullmatch(unit) or (word in RATIOS and not unit)
    ):
        factor = 0.01 if unit in ("%", "percent") else 1.0
        return _Column(place, title, factor, is_ratio=True)
    if word == "mass" and not is_mass(unit):
        wrong = f"has the unit '{unit}'" if unit else "has no unit"
        raise UnitError(f"column '{title}' {wrong}: write 'mass [kg]', or 'load [N]' for a force")
    if kind == "dimensionless" and unit in ("", "1", "-"):
        return _Column(place, title)
    if not unit:
        raise UnitError(
            f"column '{title}' has no unit: write '{word} [{EXAMPLES[kind]}]', or give it by "
            f"--unit {word}={EXAMPLES[kind]}"
        )
    factor = _find_factor(title, kind, unit)
    return _Column(place, title, 0.5 * factor if word in DIAMETERS else factor)


def _find_factor(title: str, kind: str, unit: str) -> float:
    """Return the value of one unit."""
    try:
        return parse_unit(unit, kind)
    except UnitError as error:
        raise UnitError(f"column '{title}': {error}") from None


def _take_word(where: str, name: str, cell: object) -> str:
    word = str(cell).strip()
    if name == "specimen":
        return word
    if word.lower() not in BRANCHES:
        raise FileFormatError(
            f"{where}direction is '{show_cell(cell)}': it must be inflating, deflating or empty"
        )
    return BRANCHES[word.lower()]


def _take_quantity(where: str, name: str, column: _Column, cell: object, *, commas: bool) -> float:
    value = take_number(where, name, cell, commas=commas) * column.factor
    high, unit = LIMITS.get(name, (math.inf, ""))
    if name in LIMITS and not -high <= value <= high:
        hint = "; is it in kPa?" if name == "pressure" and column.factor == 1.0 else ""
        low = -high if name == "load" else 0.0
        shown = show_apart(value, low, high)
        raise InputError(
            f"{where}{name} is {show_cell(cell)} in '{column.title}', {shown[0]} {unit}: it must "
            f"lie in [{shown[1]}, {shown[2]}] {unit}{hint}"
        )
    return value
