"""Tables and files of results: for people, as CSV, and whether a file may be written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

__all__ = ["PICTURES", "check_target", "format_csv", "format_rows"]

PICTURES = (".png", ".svg", ".pdf")
"""Endings of a picture's file."""


def check_target(out: Path | None, suffixes: tuple[str, ...], *, force: bool) -> None:
    """Refuse a file that could not be written later, before any work is done.

    Raises
    ------
    OutputError
        If it ends otherwise than in `suffixes`, is a directory, exists and may not be replaced,
        or its place takes no new file.
    """
    from ..files import check_new_file

    if out is not None:
        check_new_file(out, suffixes, force=force)


def format_csv(columns: Mapping[str, Any]) -> str:
    """Return columns of one length as the text of a CSV file; None is an empty cell."""
    import csv
    import io

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow([_format_cell(cell) for cell in row])
    return text.getvalue()


def format_rows(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table for people, its columns aligned to the right but for the first."""
    table = [list(head), *(list(row) for row in rows)]
    widths = [max(len(line[i]) for line in table) for i in range(len(head))]
    lines = []
    for line in table:
        others = zip(line[1:], widths[1:], strict=True)
        cells = [line[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in others)]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


def _format_cell(cell: Any) -> str:
    if cell is None:
        return ""
    if isinstance(cell, str):
        return cell
    number = cell.item() if hasattr(cell, "item") else cell
    return str(int(number)) if isinstance(number, (bool, int)) else f"{float(number):.9g}"
