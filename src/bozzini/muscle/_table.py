"""Reading a table of measurements: columns, units, numbers; and one clear line for a bad one."""

from __future__ import annotations

import csv
import difflib
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import FileFormatError, InputError, MissingExtraError, UnitError
from ..files import write_text
from ..units import parse_quantity
from .dataset import PRESSURE_LIMIT, Measurements, check_length

if TYPE_CHECKING:
    from .design import Muscle

__all__ = ["read_table", "write_table"]

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
EXAMPLES = {"pressure": "kPa", "contraction": "mm", "length": "mm", "load": "N"}
DEFAULTS = {"load": "0", "direction": "", "specimen": ""}

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
    rows: Sequence[Sequence[Any]]
    numbers: Sequence[int]


def read_table(path: Path, *, muscle: Muscle | None, units: Mapping[str, str]) -> Measurements:
    """Read a file of measurements; see `bozzini.muscle.dataset.read_measurements`."""
    suffix = path.suffix.lower()
    if suffix in _PARQUET_SUFFIXES:
        sheet = _read_parquet(path)
    elif suffix in _TEXT_SUFFIXES:
        sheet = _read_text(path)
    else:
        known = ", ".join(_TEXT_SUFFIXES + _PARQUET_SUFFIXES)
        raise FileFormatError(f"{path.name} ends in '{suffix}': a table ends in one of {known}")
    try:
        return _take_sheet(sheet, muscle, units)
    except InputError as error:
        raise type(error)(f"{path.name}: {error}") from None


def write_table(path: Path, data: Measurements) -> Path:
    """Write measurements as CSV with their units in the header."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = ["pressure [MPa]", "contraction [mm]", "load [N]", "direction", "specimen"]
    writer.writerow(names)
    for p, x, f, direction, specimen in zip(
        data.pressure, data.contraction, data.load, data.direction, data.specimen, strict=True
    ):
        writer.writerow([repr(float(p)), repr(float(x)), repr(float(f)), direction, specimen])
    return write_text(path, text.getvalue())


def _read_text(path: Path) -> _Sheet:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FileFormatError(f"cannot read {path}: {error.strerror or error}") from None
    except (UnicodeDecodeError, ValueError):
        raise FileFormatError(f"{path.name} is not text in UTF-8: save the table as CSV") from None
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1)]
    lines = [(number, line) for number, line in lines if line.strip() and line.lstrip()[0] != "#"]
    if not lines:
        raise FileFormatError(f"{path.name} is empty: a table has a header and rows")
    mark = max(",;\t", key=lines[0][1].count)
    cells = []
    for number, line in lines:
        try:
            cells.append(next(csv.reader([line], delimiter=mark, skipinitialspace=True)))
        except csv.Error as error:
            raise FileFormatError(f"{path.name}: row {number} is not CSV: {error}") from None
    kept = [(n, row) for (n, _), row in zip(lines, cells, strict=True) if any(map(str.strip, row))]
    return _Sheet(cells[0], [row for _, row in kept[1:]], [number for number, _ in kept[1:]])


def _read_parquet(path: Path) -> _Sheet:
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise MissingExtraError("pyarrow", "parquet") from None
    try:
        table = parquet.read_table(path)
    except OSError as error:
        raise FileFormatError(f"cannot read {path}: {error.strerror or error}") from None
    except ArrowException as error:
        raise FileFormatError(f"{path.name} is not a Parquet file: {error}") from None
    columns = [column.to_pylist() for column in table.columns]
    rows = [["" if cell is None else cell for cell in row] for row in zip(*columns, strict=True)]
    return _Sheet(table.column_names, rows, range(1, len(rows) + 1))


def _take_sheet(sheet: _Sheet, muscle: Muscle | None, units: Mapping[str, str]) -> Measurements:
    columns, ignored = _find_columns(sheet.titles, units)
    if not sheet.rows:
        raise FileFormatError("the table has a header and no rows")
    if "length" in columns and muscle is None:
        raise InputError(f"column '{columns['length'].title}' needs the muscle: its free length")
    taken: dict[str, list[Any]] = {name: [] for name in ("pressure", "contraction", *DEFAULTS)}
    for number, row in zip(sheet.numbers, sheet.rows, strict=True):
        where = f"row {number}: "
        if len(row) != len(sheet.titles):
            raise FileFormatError(
                f"{where}it has {len(row)} cell(s): the header has {len(sheet.titles)}"
            )
        for name, column in columns.items():
            cell = row[column.place]
            value = _take_cell(where, name, column, cell)
            if name == "length" and muscle is not None:
                taken["contraction"].append(muscle.length - check_length(where, value, muscle))
            else:
                taken[name].append(value)
        if "contraction" in columns and muscle is not None:
            check_length(where, muscle.length - taken["contraction"][-1], muscle)
    return Measurements(
        pressure=np.array(taken["pressure"]),
        contraction=np.array(taken["contraction"]),
        load=np.array(taken["load"]) if taken["load"] else np.zeros(len(sheet.rows)),
        direction=np.array(taken["direction"] or [""] * len(sheet.rows)),
        specimen=np.array(taken["specimen"] or [""] * len(sheet.rows)),
        ignored=ignored,
    )


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


def _take_cell(where: str, name: str, column: _Column, cell: Any) -> Any:
    if name == "specimen":
        return str(cell).strip()
    if name == "direction":
        word = str(cell).strip().lower()
        if word not in BRANCHES:
            raise FileFormatError(
                f"{where}direction is '{cell}': it must be inflating, deflating or empty"
            )
        return BRANCHES[word]
    value = _take_number(where, name, cell) * column.factor
    if name == "pressure" and not 0.0 <= value <= PRESSURE_LIMIT:
        raise InputError(
            f"{where}pressure is {cell} in '{column.title}', {value:g} MPa: it must lie in "
            f"[0, {PRESSURE_LIMIT:g}] MPa"
        )
    return value


def _take_number(where: str, name: str, cell: Any) -> float:
    text = str(cell).strip()
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if "_" not in text and math.isfinite(value) and not isinstance(cell, bool):
        return value
    hint = ""
    if not text:
        hint = " (the cell is empty)"
    elif re.fullmatch(r"[-+]?\d+,\d+", text):
        hint = " with a decimal point"
    elif re.match(r"[-+.\d]+\s*[A-Za-zµ]", text) and math.isnan(value):
        hint = ": a unit belongs into the header, one for the whole column"
    raise FileFormatError(f"{where}{name} is '{text}': it must be a finite number{hint}")
