"""Reading a table of measurements: columns, units, numbers; and one clear line for a bad one."""

from __future__ import annotations

import csv
import dataclasses
import difflib
import io
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import FileFormatError, InputError, MissingExtraError, UnitError
from ..files import write_atomically
from ..units import parse_quantity
from .dataset import LOAD_LIMIT, PRESSURE_LIMIT, Measurements, check_length

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
LIMITS = {"pressure": (PRESSURE_LIMIT, "MPa"), "load": (LOAD_LIMIT, "N")}
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
        data = _take_sheet(sheet, muscle, units)
    except InputError as error:
        raise type(error)(f"{path.name}: {error}") from None
    return dataclasses.replace(data, source=path.name)


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
    content = text.getvalue().encode("utf-8")
    return write_atomically(path, lambda temporary: _put_bytes(temporary, content))


def _put_bytes(path: Path, content: bytes) -> None:
    path.write_bytes(content)


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
    columns = [column.to_pylist() for column in table.columns]
    rows = [["" if cell is None else cell for cell in row] for row in zip(*columns, strict=True)]
    return _Sheet([_show(name) for name in table.column_names], rows, range(1, len(rows) + 1))


def _take_sheet(sheet: _Sheet, muscle: Muscle | None, units: Mapping[str, str]) -> Measurements:
    columns, ignored = _find_columns(sheet.titles, units)
    if not sheet.rows:
        raise FileFormatError("the table has a header and no rows")
    if "length" in columns and muscle is None:
        raise InputError(f"column '{columns['length'].title}' needs the muscle: its free length")
    strand = math.inf if muscle is None else muscle.braid.strand_length
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
                taken["contraction"].append(muscle.length - check_length(where, value, strand))
            else:
                taken[name].append(value)
        if "contraction" in columns and muscle is not None:
            check_length(where, muscle.length - taken["contraction"][-1], strand)
    return Measurements(
        pressure=np.array(taken["pressure"]),
        contraction=np.array(taken["contraction"]),
        load=np.array(taken["load"]) if taken["load"] else np.zeros(len(sheet.rows)),
        direction=np.array(taken["direction"] or [""] * len(sheet.rows)),
        specimen=np.array(taken["specimen"] or [""] * len(sheet.rows)),
        ignored=ignored,
        numbers=np.array(sheet.numbers, dtype=np.int64),
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
                f"{where}direction is '{_show(cell)}': it must be inflating, deflating or empty"
            )
        return BRANCHES[word]
    value = _take_number(where, name, cell) * column.factor
    high, unit = LIMITS.get(name, (math.inf, ""))
    if name in LIMITS and not 0.0 <= value <= high:
        raise InputError(
            f"{where}{name} is {_show(cell)} in '{column.title}', {value:g} {unit}: it must lie in "
            f"[0, {high:g}] {unit}"
        )
    return value


def _show(cell: Any) -> str:
    """Return a cell as one short line."""
    text = " ".join(str(cell).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def _take_number(where: str, name: str, cell: Any) -> float:
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
