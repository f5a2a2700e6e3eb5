"""The commands of muscles and effectors answer as they did, within rounding."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.muscle_commands import COMMANDS, run, write_data

KEPT = json.loads((Path(__file__).parent / "muscle_commands.json").read_text(encoding="utf-8"))

SOLVER = {"iterations", "evaluations"}
"""What may differ between versions of SciPy and kinds of processor."""


SEARCHED = ("muscle fit", "muscle compare", "least-pressure", "residual", "error")
"""Where a value is what a search ended at, good to its tolerance."""


def _compare(found: Any, kept: Any, where: str) -> None:
    if isinstance(kept, dict):
        assert list(found) == list(kept), where
        for key in kept:
            if key not in SOLVER:
                _compare(found[key], kept[key], f"{where}/{key}")
    elif isinstance(kept, list):
        assert len(found) == len(kept), where
        for index, (one, other) in enumerate(zip(found, kept, strict=True)):
            _compare(one, other, f"{where}[{index}]")
    elif isinstance(kept, float):
        loose = any(word in where for word in SEARCHED)
        assert found == pytest.approx(kept, rel=1e-3 if loose else 1e-5, abs=1e-6), where
    else:
        assert found == kept, where


@pytest.mark.parametrize("line", COMMANDS.strip().splitlines())
def test_answers_are_those_kept(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_data(tmp_path / "data.csv")
    found = run(line)
    assert found["exit"] == KEPT[line]["exit"], found
    _compare(found["answer"], KEPT[line]["answer"], line)


def test_every_command_is_kept() -> None:
    assert set(KEPT) == set(COMMANDS.strip().splitlines())
