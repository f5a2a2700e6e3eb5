"""Tables as text: sheets of text, Parquet, Excel or MATLAB files or of pandas, and numbers."""

from __future__ import annotations

import csv
import io
import itertools
import math
import os
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ..checks import check_path
from ..errors import FileFormatError, InputError
from ..results import make_frame
from ..units import drop_in, is_unit
from .files import check_parquet, write_parquet, write_text
from .inputs import note_input
from .matlab import Matrix, read_matrices

if TYPE_CHECKING:
    import pandas

_HEADER = re.compile(r"\s*(.+?)\s*(?:\[((?:[^][]|\[[^][]*\])*)\]|\(((?:[^()]|\([^()]*\))*)\))?\s*")
# What pandas calls a column that has no title, and a unit without a name.
_UNNAMED = re.compile(
    r"\s*(?:Unnamed: [0-9]+(?:\.[0-9]+)?|nan|\[[^\]]*\]|\([^)]*\))?\s*", re.IGNORECASE
)
_BEGINS_WITH_NUMBER = re.compile(r"[\s\"']*[-+]?[.,]?[0-9]")
DECIMAL_COMMA = re.compile(r"[-+]?[0-9]*,[0-9]+(?:[eE][-+]?[0-9]+)?")
TEXT_SUFFIXES = (".csv", ".tsv", ".txt")
PARQUET_SUFFIXES = (".parquet", ".pq")
OTHER_SUFFIXES = (".xlsx", ".mat")
PACKED_SUFFIXES = (".gz", ".bz2", ".xz")
_LARGEST = 2**30
"""Most bytes of a text that was packed."""
_MOST_COLUMNS = 1000
"""Of a workbook: what is left out in a row takes memory."""


@dataclass(frozen=True)
class Sheet:
    """A table as text: its titles, its rows, and the number of each row in the file.

    `may_have_commas` is whether a comma may be a decimal one.
    """

    titles: Sequence[str]
    rows: Sequence[Sequence[object]]
    numbers: Sequence[int]
    may_have_commas: bool = False


def split_title(title: str) -> tuple[str, str]:
    """Return name and unit of a title such as ``pressure [kPa]``; the unit is empty without one.

    Of ``pressure (in kPa)`` it is kPa as well.
    """
    match = _HEADER.fullmatch(title)
    if match is None:
        return title.strip(), ""
    return match[1], drop_in(match[2] or match[3] or "")


def take_frame(table: pandas.DataFrame) -> Sheet:
    """Return the sheet of a table of pandas; what is missing there is an empty cell.

    Raises
    ------
    FileFormatError
        If a column of numbers has no title.
    """
    cells = table.astype(object).where(table.notna(), "").to_numpy().tolist()
    titles = ["" if name is None or name != name else show_cell(name) for name in table.columns]
    return _tidy(Sheet(titles, cells, range(1, len(cells) + 1)))


def format_table(columns: Mapping[str, object], *, digits: int | None = None) -> str:
    """Return columns as the text of a CSV file; what is missing, NaN as well, is an empty cell.

    Parameters
    ----------
    columns : mapping
        Values by title, of one length; a single value stands in every row.
    digits : int, optional
        Significant ones of a number with a fraction; by default as many as it has.
    """
    arrays = [np.asarray(values, dtype=object) for values in columns.values()]
    count = max((len(values) for values in arrays if values.ndim), default=0)
    cells = [np.broadcast_to(values, count).tolist() for values in arrays]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*cells, strict=True):
        writer.writerow([_format_cell(cell, digits) for cell in row])
    return text.getvalue()


def _format_cell(cell: object, digits: int | None) -> object:
    cell = cell.item() if isinstance(cell, np.generic) else cell
    if cell is None or cell != cell:
        return ""
    return f"{cell:.{digits}g}" if isinstance(cell, float) and digits else cell


def write_table(
    path: str | os.PathLike[str], columns: Mapping[str, object], *, digits: int | None = None
) -> Path:
    """Write columns as Parquet if the path ends so, else as `format_table` makes text of them.

    Raises
    ------
    MissingExtraError, OutputError
        As `write_parquet` does.
    """
    if check_path("path", path).suffix.lower() in PARQUET_SUFFIXES:
        check_parquet()
        return write_parquet(path, make_frame(columns))
    return write_text(path, format_table(columns, digits=digits))


def _tidy(sheet: Sheet) -> Sheet:
    """Return a sheet with the units of a row under the titles in these, see `refuse_untitled`."""
    titles, rows, numbers = sheet.titles, sheet.rows, sheet.numbers
    if rows and len(rows[0]) == len(titles) and _is_row_of_units(rows[0]):
        titles = [_add_unit(*pair, numbers[0]) for pair in zip(titles, rows[0], strict=True)]
        sheet = replace(sheet, titles=titles, rows=rows[1:], numbers=numbers[1:])
    return refuse_untitled(sheet)


def refuse_untitled(sheet: Sheet) -> Sheet:
    """Return a sheet without empty columns that have no title.

    Raises
    ------
    FileFormatError
        If a column without a title holds a number: it may be what a result depends on.
    """
    titles, rows = [*sheet.titles], sheet.rows
    whole = all(len(row) == len(titles) for row in rows)
    kept = []
    for place, title in enumerate(titles):
        if not _UNNAMED.fullmatch(title):
            kept.append(place)
            continue
        filled = False
        for number, row in zip(sheet.numbers, rows, strict=True):
            cell = show_cell(row[place]) if place < len(row) else ""
            filled |= bool(cell)
            if _BEGINS_WITH_NUMBER.match(cell):
                raise FileFormatError(
                    f"column {place + 1} has no title and the number {cell} in row {number}: "
                    "give it a title, or leave it out"
                )
        titles[place] = f"column {place + 1} without a title"
        kept += [place] if filled or not whole else []
    if len(kept) < len(titles):
        titles, rows = [titles[k] for k in kept], [[row[k] for k in kept] for row in rows]
    return replace(sheet, titles=titles, rows=rows)


def _is_row_of_units(row: Sequence[object]) -> bool:
    units = [_bare_unit(cell) for cell in row]
    known = [unit for unit in units if unit not in ("", "-")]
    return bool(known) and all(map(is_unit, known))


def _bare_unit(cell: object) -> str:
    """Return the unit in a cell, without brackets."""
    text = str(cell).strip()
    match = re.fullmatch(r"\[(.*)\]|\((.*)\)", text)
    return drop_in((match[1] or match[2] or "") if match else text)


def _add_unit(title: str, cell: object, number: int) -> str:
    """Return a title with the unit that stands in the row below."""
    own, unit = split_title(title)[1], _bare_unit(cell)
    if unit in ("", "-") or own == unit:
        return title
    if own and is_unit(own):
        raise FileFormatError(f"row {number}: '{unit}' is another unit than that of '{title}'")
    return f"{title.strip()} [{unit}]" if title.strip() else title


def _read_bytes(path: Path) -> bytes:
    note_input(path)
    try:
        return path.read_bytes()
    except OSError as error:
        raise FileFormatError(f"cannot read {path}: {error.strerror or error}") from None
    except ValueError as error:  # a null byte in the name
        raise FileFormatError(f"cannot read {path}: {error}") from None


def find_suffix(path: Path) -> str:
    """Return the ending of a table's name, in lower case, without that of its packing."""
    is_packed = path.suffix.lower() in PACKED_SUFFIXES
    return (path.with_suffix("") if is_packed else path).suffix.lower()


def _unpack(path: Path) -> bytes:
    """Return the bytes of a text that may be packed."""
    data, suffix = io.BytesIO(_read_bytes(path)), path.suffix.lower()
    if suffix not in PACKED_SUFFIXES:
        return data.getvalue()
    import bz2
    import gzip
    import lzma

    kinds: Mapping[str, Callable[[io.BytesIO], io.BufferedIOBase]] = {
        ".gz": lambda file: gzip.GzipFile(fileobj=file),
        ".bz2": bz2.BZ2File,
        ".xz": lzma.LZMAFile,
    }
    try:
        text = kinds[suffix](data).read(_LARGEST + 1)
    except (OSError, EOFError, zlib.error, lzma.LZMAError) as error:
        what = " ".join(str(error).split()) or "it ends too early"
        raise FileFormatError(f"{path.name} is damaged and cannot be unpacked: {what}") from None
    if len(text) > _LARGEST:
        raise FileFormatError(f"{path.name} has more than {_LARGEST} bytes unpacked: divide it")
    return text


def _read_text(path: Path) -> Sheet:
    try:
        text = _unpack(path).decode("utf-8-sig")
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
    return _name_file(path, Sheet(titles, rows, [numbers[i] for i in kept], records.mark != ","))


def _name_file(path: Path, sheet: Sheet) -> Sheet:
    """Return a tidy sheet; an error names the file."""
    try:
        return _tidy(sheet)
    except FileFormatError as error:
        raise FileFormatError(f"{path.name}: {error}") from None


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
    check_parquet()
    from pyarrow import ArrowException, parquet

    try:
        table = parquet.read_table(io.BytesIO(_read_bytes(path)))
    except (ArrowException, OSError) as error:
        what = " ".join(str(error).split())
        raise FileFormatError(f"{path.name} is not a Parquet file: {what}") from None
    return take_frame(table.to_pandas())


_XML = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
_LINK = "{http://schemas.openxmlformats.org/officeDocument/2006/relationships}id"


def _read_excel(path: Path) -> Sheet:
    """Return the first sheet of a workbook; of a formula its last value."""
    try:
        with zipfile.ZipFile(io.BytesIO(_read_bytes(path))) as book:
            if sum(item.file_size for item in book.infolist()) > _LARGEST:
                raise FileFormatError(f"{path.name} has more than {_LARGEST} bytes unpacked")
            sheets = _read_xml(book, "xl/workbook.xml").iter(f"{_XML}sheet")
            link = next(sheets).get(_LINK)
            links = {item.get("Id"): item.get("Target", "") for item in
                     _read_xml(book, "xl/_rels/workbook.xml.rels")}  # fmt: skip
            place = links[link]
            place = place.lstrip("/") if place.startswith("/") else f"xl/{place}"
            shared: list[str] = []
            if "xl/sharedStrings.xml" in book.namelist():
                strings = _read_xml(book, "xl/sharedStrings.xml").iter(f"{_XML}si")
                shared = [_join_text(item) for item in strings]
            rows = [
                (int(row.get("r") or k), _list_cells(row, shared))
                for k, row in enumerate(_read_xml(book, place).iter(f"{_XML}row"), start=1)
            ]
    except FileFormatError:
        raise
    except (zipfile.BadZipFile, ElementTree.ParseError, KeyError, ValueError, IndexError,
            StopIteration, NotImplementedError, RuntimeError, zlib.error, EOFError):  # fmt: skip
        raise FileFormatError(f"{path.name} is not a workbook of Excel (.xlsx)") from None
    rows = [(number, cells) for number, cells in rows if any(map(str.strip, cells))]
    if not rows:
        raise FileFormatError(f"{path.name} is empty: a table has a header and rows")
    width = max(len(cells) for _, cells in rows)
    (_, titles), *kept = ((n, cells + [""] * (width - len(cells))) for n, cells in rows)
    sheet = Sheet(list(map(show_cell, titles)), [c for _, c in kept], [n for n, _ in kept])
    return _name_file(path, sheet)


def _read_xml(book: zipfile.ZipFile, name: str) -> ElementTree.Element:
    return ElementTree.fromstring(book.read(name))


def _join_text(item: ElementTree.Element) -> str:
    return "".join(part.text or "" for part in item.iter(f"{_XML}t"))


def _list_cells(row: ElementTree.Element, shared: Sequence[str]) -> list[str]:
    """Return the cells of a row as text, those left out as empty ones."""
    cells: list[str] = []
    for cell in row.iter(f"{_XML}c"):
        letters = re.match(r"[A-Z]{1,3}", cell.get("r", ""))
        if letters:
            column = 0
            for letter in letters[0]:
                column = 26 * column + ord(letter) - ord("A") + 1
            if column > _MOST_COLUMNS:
                raise FileFormatError(
                    f"there is a cell in column {letters[0]}: {_MOST_COLUMNS} columns are read"
                )
            cells += [""] * (column - 1 - len(cells))
        value = cell.find(f"{_XML}v")
        text = "" if value is None else value.text or ""
        kind = cell.get("t")
        cells.append(shared[int(text)] if kind == "s" else _join_text(cell) if kind == "inlineStr"
                     else text)  # fmt: skip
    return cells


def _read_matlab(path: Path) -> Sheet:
    """Return the variables as columns: vectors by their names, those of a matrix with a number.

    They are those that are as long as the longest.
    """
    note_input(path)
    found = {name: item for name, item in read_matrices(path).items() if item is not None}
    columns: dict[str, Matrix] = {}
    for name, item in found.items():
        if item.ndim == 2 and item.size:
            tall = item if item.shape[0] >= item.shape[1] else item.T
            count = tall.shape[1]
            names = [name] if count == 1 else [f"{name} {k + 1}" for k in range(count)]
            columns |= dict(zip(names, tall.T, strict=True))
    if not columns:
        raise FileFormatError(f"{path.name} has no vector or matrix of numbers")
    longest = max(map(len, columns.values()))
    columns = {name: values for name, values in columns.items() if len(values) == longest}
    rows = np.stack([values.astype(np.float64) for values in columns.values()], axis=-1)
    cells = [["" if cell != cell else cell for cell in row] for row in rows.tolist()]
    return Sheet(list(columns), cells, range(1, longest + 1))


def read_sheet(path: Path) -> Sheet:
    """Return the table in a file ending in .csv, .tsv, .txt, .parquet, .pq, .xlsx or .mat.

    A text may be packed, and end in .gz, .bz2 or .xz after that. Of a workbook it is the first
    sheet; of a MATLAB file the vectors by their names, and the columns of its matrices, such as
    ``data 1``.

    Raises
    ------
    FileFormatError
        If it cannot be read as one.
    MissingExtraError
        If a Parquet file is given and ``pyarrow`` or ``pandas`` is not installed.
    """
    suffix = path.suffix.lower()
    if suffix in PARQUET_SUFFIXES:
        return _read_parquet(path)
    if suffix == ".xlsx":
        return _read_excel(path)
    if suffix == ".mat":
        return _read_matlab(path)
    if find_suffix(path) in TEXT_SUFFIXES:
        return _read_text(path)
    known = ", ".join(TEXT_SUFFIXES + PARQUET_SUFFIXES + OTHER_SUFFIXES)
    raise FileFormatError(f"{path.name} ends in '{suffix}': a table ends in one of {known}")


def find_title(titles: Sequence[str], wanted: str) -> int:
    """Return the place of a column by its title, or by its name without the unit.

    Raises
    ------
    FileFormatError
        If there is none, or more than one.
    """
    forms = (
        lambda title: title.strip(),
        lambda title: title.strip().lower(),
        lambda title: split_title(title)[0].lower(),
    )
    for form in forms:
        found = [k for k, title in enumerate(titles) if form(title) == form(wanted)]
        if len(found) == 1:
            return found[0]
        if found:
            raise FileFormatError(f"{len(found)} columns are called '{wanted}'")
    there = ", ".join(f"'{title}'" for title in titles)
    raise FileFormatError(f"there is no column '{wanted}': the table has {there}")


def parse_columns(texts: Iterable[str]) -> dict[str, str]:
    """Return titles to read in place of some in a file, by these, from ``TITLE=OLD``."""
    columns: dict[str, str] = {}
    for text in texts:
        title, mark, old = (part.strip() for part in text.partition("="))
        if not (title and mark and old):
            raise InputError(f"--column is '{text}': it must be TITLE=TITLE IN THE FILE")
        if old in columns:
            raise InputError(f"--column names '{old}' more than once: give it once")
        columns[old] = title
    return columns


def rename_titles(sheet: Sheet, columns: Mapping[str, str]) -> Sheet:
    """Return a sheet with other titles in place of some, by these, as `find_title` finds them."""
    titles = [*sheet.titles]
    for old, title in columns.items():
        titles[find_title(sheet.titles, old)] = title
    return replace(sheet, titles=titles)


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


def take_numbers(
    sheet: Sheet, place: int, *, where: str = "", empty: Sequence[str] = ()
) -> NDArray[np.float64]:
    """Return the numbers of a column (n,); NaN where a cell is one of `empty`, in lower case."""
    title = sheet.titles[place].strip()
    for number, row in zip(sheet.numbers, sheet.rows, strict=True):
        if len(row) != len(sheet.titles):
            raise FileFormatError(
                f"{where}row {number}: it has {len(row)} cell(s): the header has "
                f"{len(sheet.titles)}"
            )
    cells = [str(row[place]).strip() for row in sheet.rows]
    commas = sheet.may_have_commas and any(map(DECIMAL_COMMA.fullmatch, cells))
    values = np.full(len(cells), np.nan)
    for index, (number, cell) in enumerate(zip(sheet.numbers, cells, strict=True)):
        if cell.lower() not in empty:
            line = f"{where}row {number}: "
            values[index] = take_number(line, f"'{title}'", cell, commas=commas)
    return values
