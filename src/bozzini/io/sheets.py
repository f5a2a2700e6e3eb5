"""Tables as text: sheets of a CSV or Parquet file or of pandas, and the numbers in their cells."""

from __future__ import annotations

import csv
import io
import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import FileFormatError, MissingExtraError
from .inputs import note_input

if TYPE_CHECKING:
    import pandas

DECIMAL_COMMA = re.compile(r"[-+]?[0-9]*,[0-9]+(?:[eE][-+]?[0-9]+)?")
TEXT_SUFFIXES = (".csv", ".tsv", ".txt")
PARQUET_SUFFIXES = (".parquet", ".pq")


@dataclass(frozen=True)
class Sheet:
    """A table as text: its titles, its rows, and the number of each row in the file.

    `may_have_commas` is whether a comma may be a decimal one.
    """

    titles: Sequence[str]
    rows: Sequence[Sequence[object]]
    numbers: Sequence[int]
    may_have_commas: bool = False


def take_frame(table: pandas.DataFrame) -> Sheet:
    """Return the sheet of a table of pandas; what is missing there is an empty cell."""
    cells = table.astype(object).where(table.notna(), "").to_numpy().tolist()
    return Sheet([show_cell(name) for name in table.columns], cells, range(1, len(cells) + 1))


def _read_bytes(path: Path) -> bytes:
    note_input(path)
    try:
        return path.read_bytes()
    except OSError as error:
        raise FileFormatError(f"cannot read {path}: {error.strerror or error}") from None
    except ValueError as error:  # a null byte in the name
        raise FileFormatError(f"cannot read {path}: {error}") from None


def _read_text(path: Path) -> Sheet:
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
    titles = [show_cell(title) for title in cells[0]]
    rows = [cells[i] for i in kept]
    return Sheet(titles, rows, [numbers[i] for i in kept], records.mark != ",")


class _Records:
    """The records of a CSV text, without comments; a quoted cell may hold ends of lines.

    `start` is the line on which the last one begins, counted from 1; `mark` stands between cells.
    """

    def __init__(self, text: str) -> None:
        self.start = 0
        self._fresh = True
        # Unlike str.splitlines this breaks lines where CSV does and nowhere else.
        self._lines = enumerate(io.StringIO(text, newline=""), start=1)
        first = next(self._feed(), "")
        self.mark = max(",;\t", key=first.count)
        self._reader = csv.reader(
            itertools.chain([first] if first else [], self._feed()),
            delimiter=self.mark,
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


def _read_parquet(path: Path) -> Sheet:
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise MissingExtraError("pyarrow", "parquet") from None
    try:
        table = parquet.read_table(io.BytesIO(_read_bytes(path)))
    except (ArrowException, OSError) as error:
        what = " ".join(str(error).split())
        raise FileFormatError(f"{path.name} is not a Parquet file: {what}") from None
    return take_frame(table.to_pandas())


def read_sheet(path: Path) -> Sheet:
    """Return the table in a file ending in .csv, .tsv, .txt, .parquet or .pq.

    Raises
    ------
    FileFormatError
        If it cannot be read as one.
    MissingExtraError
        If a Parquet file is given and ``pyarrow`` is not installed.
    """
    suffix = path.suffix.lower()
    if suffix in PARQUET_SUFFIXES:
        return _read_parquet(path)
    if suffix in TEXT_SUFFIXES:
        return _read_text(path)
    known = ", ".join(TEXT_SUFFIXES + PARQUET_SUFFIXES)
    raise FileFormatError(f"{path.name} ends in '{suffix}': a table ends in one of {known}")


def show_cell(cell: object) -> str:
    """Return a cell as one short line."""
    text = " ".join(str(cell).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def take_number(where: str, name: str, cell: object, *, commas: bool) -> float:
    """Return the number in a cell; in a table with decimal commas a point is none."""
    text = str(cell).strip()
    try:
        value = float(text.replace(",", ".") if commas and "." not in text else text)
    except ValueError:
        value = math.nan
    mixed = commas and "." in text
    # Python's own float takes 1_000 and the digits of every script.
    is_plain = "_" not in text and text.isascii() and not isinstance(cell, bool)
    if is_plain and math.isfinite(value) and not mixed:
        return value
    hint = ""
    if not text:
        hint = " (the cell is empty)"
    elif mixed:
        hint = " with a decimal comma, as in the rest of the table"
    elif DECIMAL_COMMA.fullmatch(text):
        hint = " with a decimal point"
    elif re.match(r"[-+.0-9]+\s*[A-Za-zµ]", text) and math.isnan(value):
        hint = ": a unit belongs into the header, one for the whole column"
    raise FileFormatError(f"{where}{name} is '{show_cell(text)}': it must be a finite number{hint}")
