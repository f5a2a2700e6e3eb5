"""Tables of results: what is written comes back, columns stand in line."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest

from bozzini.cli.common import PICTURES, check_target, format_csv, format_rows
from bozzini.errors import OutputError


def test_a_table_comes_back() -> None:
    numbers = np.random.default_rng(0).normal(size=6) * 10.0 ** np.arange(-6, 6, 2)
    columns = {"name": list("abcd,f"), "n": np.arange(6), "x": numbers, "none": [None] * 6}
    rows = list(csv.DictReader(io.StringIO(format_csv(columns))))
    assert [row["name"] for row in rows] == list("abcd,f")
    assert [int(row["n"]) for row in rows] == list(range(6))
    assert [float(row["x"]) for row in rows] == pytest.approx(numbers.tolist(), rel=1e-8)
    assert {row["none"] for row in rows} == {""}


def test_columns_of_different_lengths_are_a_fault() -> None:
    with pytest.raises(ValueError, match="zip"):
        format_csv({"a": [1, 2], "b": [1]})


def test_numbers_stand_in_line() -> None:
    rows = [["first", "1.00", "-20.5"], ["x", "-300.25", "4"]]
    lines = format_rows(["name", "length", "angle [deg]"], rows).splitlines()
    ends = [lines[0].index("length") + 6, len(lines[0])]
    for line, (name, *values) in zip(lines[1:], rows, strict=True):
        assert line.startswith(name)
        assert [line[: ends[0]].split()[-1], line[ends[0] :].strip()] == values
        assert len(line) == ends[1]


def test_a_target_is_refused_before_any_work(tmp_path: Path) -> None:
    there = tmp_path / "a.PNG"
    check_target(None, PICTURES, force=False)
    check_target(there, PICTURES, force=False)
    there.touch()
    check_target(there, PICTURES, force=True)
    for path, words in (
        (there, "exists already"),
        (tmp_path / "a.csv", r"must end in \.png, \.svg, \.pdf"),
        (tmp_path / "none" / "a.png", "is not a directory"),
    ):
        with pytest.raises(OutputError, match=words):
            check_target(path, PICTURES, force=False)
