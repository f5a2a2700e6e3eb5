"""Parts of a study's results: Parquet files that are whole or not there at all."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, cast

from ..io.files import write_atomically
from ..io.records import parse_json
from ..results import Json
from .definition import Study

if TYPE_CHECKING:
    import pyarrow

KEY = b"bozzini.study"
"""Key of a part's metadata; its value is JSON."""

BEYOND = "a constraint is not kept"
"""Reason of a row that is computed and not within the constraints."""


def part_name(index: int) -> str:
    """Return the name of a part's file."""
    return f"part-{index:06d}.parquet"


def write_part(study: Study, table: pyarrow.Table, path: Path) -> Json:
    """Write a part so that it is there whole or not at all; return what `read_part` does."""
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    reasons = table.filter(pc.invert(table["feasible"]))["reason"].value_counts().to_pylist()
    known: Json = {
        "key": study.key,
        "first": table["row"][0].as_py(),
        "rows": table.num_rows,
        "feasible": int(pc.sum(table["feasible"]).as_py() or 0),
        "reasons": {entry["values"] or BEYOND: entry["counts"] for entry in reasons},
    }
    more = {KEY: json.dumps(known).encode()}
    table = table.replace_schema_metadata(more)

    def write(place: Path) -> None:
        with place.open("wb") as stream:
            pq.write_table(
                table, pa.PythonFile(stream), compression="zstd", write_page_checksum=True
            )
            stream.flush()
            os.fsync(stream.fileno())

    write_atomically(path, write)
    return known


def read_part(path: Path, key: str, *, rows: int, first: int, deep: bool = False) -> Json | None:
    """Return what a part states of itself; None unless it is whole, and has these rows of a study.

    With -1 for `rows` any are right. What it holds is read, and its check sums compared, if `deep`.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        found = pq.read_metadata(path)
        if deep:
            load_part(path)
        known = cast(Json, parse_json(found.metadata[KEY]))
        stated = (known["key"], known["rows"], known["first"])
    except (OSError, pa.ArrowException, KeyError, TypeError, ValueError):
        return None
    wanted = (key, found.num_rows, first)
    if rows == -1:
        wanted = (key, found.num_rows, known["first"])
    elif rows != found.num_rows:
        return None
    return known if stated == wanted else None


def load_part(path: Path, columns: list[str] | None = None) -> pyarrow.Table:
    """Return the rows of a part; an error of pyarrow or of reading if it is damaged."""
    import pyarrow.parquet as pq

    table = pq.read_table(path, columns=columns, page_checksum_verification=True)
    table.validate(full=True)
    return table
