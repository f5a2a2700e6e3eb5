"""The commands answer as they did, and write the same files, within rounding."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import pytest

from tests.cli.recorded_commands import (
    COMMANDS,
    RECORDS,
    SLOW_COMMANDS,
    UNSTABLE,
    list_lines,
    run_in_copy,
    write_inputs,
)

KEPT = json.loads(RECORDS.read_text(encoding="utf-8"))

SEARCHED = ("muscle fit", "muscle compare", "least-pressure", "residual", "error")
"""Where a value is what a search ended at, good to its tolerance."""

SETTLED = ("the parameters settled", "the sum of squares settled")
"""What ends a search; round-off decides which of them is seen first."""

NUMBER = re.compile(r"(?<![A-Za-z_])\d[\d.,]*(e[-+]?\d*)?")


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    write_inputs(folder)
    return folder


def _choose_tolerances(where: str) -> dict[str, float]:
    """Return the relative and the absolute tolerance of a value."""
    if where.endswith("outside_found_mm"):
        # Of several maxima about as large, round-off decides which one the search finds.
        return {"rel": 0.02, "abs": 1e-4}
    if not where.startswith(("muscle", "effector")):
        return {"rel": 1e-4, "abs": 1e-4}
    return {"rel": 1e-3 if any(word in where for word in SEARCHED) else 1e-5, "abs": 1e-6}


def _compare(found: Any, kept: Any, where: str) -> None:
    if isinstance(kept, dict):
        assert sorted(found) == sorted(kept), where
        for key in kept:
            if key not in UNSTABLE:
                _compare(found[key], kept[key], f"{where}/{key}")
    elif isinstance(kept, list):
        assert len(found) == len(kept), where
        for index, (one, other) in enumerate(zip(found, kept, strict=True)):
            _compare(one, other, f"{where}[{index}]")
    elif isinstance(kept, float):
        if where.endswith("_rad"):  # an angle of pi is one of -pi
            found = kept + math.remainder(found - kept, 2.0 * math.pi)
        assert found == pytest.approx(kept, **_choose_tolerances(where)), where
    elif kept in SETTLED:
        assert found in SETTLED, where
    elif isinstance(kept, str) and " " in kept and not where.endswith("error/message"):
        # Numbers in a text are rounded; their values stand beside it.
        assert NUMBER.sub("#", found) == NUMBER.sub("#", kept), where
    else:
        assert found == kept, where


def _compare_line(line: str, inputs: Path) -> None:
    found = run_in_copy(line, inputs)
    assert found["exit"] == KEPT[line]["exit"], found
    _compare(found, KEPT[line], line)


@pytest.mark.parametrize("line", COMMANDS.strip().splitlines())
def test_answers_and_files_are_those_recorded(line: str, inputs: Path) -> None:
    _compare_line(line, inputs)


@pytest.mark.slow
@pytest.mark.parametrize("line", SLOW_COMMANDS.strip().splitlines())
def test_answers_and_files_of_long_runs_are_those_recorded(line: str, inputs: Path) -> None:
    _compare_line(line, inputs)


def test_every_command_is_recorded() -> None:
    assert sorted(KEPT) == sorted(list_lines())
    words = ("demo", "plan", "certify", "phantom", "segment", "data", "duct", "muscle")
    for word in (*words, "continuum", "effector"):
        assert any(line.rpartition("&& ")[2].startswith(word) for line in KEPT), word
