"""Files whose JSON or YAML is nested deeply are refused in one line, whatever reads them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bozzini.cli.main import main

PLAN = Path(__file__).parents[1] / "data" / "plan_0_1_best.npz"
DEEP = "[" * 900 + "]" * 900
COMMANDS = (
    "certify PLAN", "certify PLAN x.stl", "show PLAN", "export ros2 PLAN --out o.yaml",
    "export urdf PLAN --out o.urdf", "execute PLAN x.stl --out o", "record PLAN --out o.gif",
    "uncertainty PLAN x.stl --out o", "continuum rank PLAN",
)  # fmt: skip
OF_FILES = (
    "continuum pose x.yaml", "muscle curve --muscle x.yaml", "duct limits x.json --diameter 4mm",
    "show x.json", "plan x.stl --options x.yaml --out o", "study run x.yaml --out o",
    "uncertainty x.yaml --out o",
    "vision plan-setup --board x.yaml --height 2mm --diameter 1mm --ring 2mm",
    "muscle trace-loop x.yaml x.csv", "vision track x.csv --cameras x.yaml --out o",
    "effector tip-error --fit x.yaml --pressure R=0.4MPa", "muscle predict x.yaml",
    "effector curve --muscle-preset x.yaml", "continuum pose x.yaml --json", "study status results",
    "study export results --out o.csv", "study resume results",
)  # fmt: skip


def _refuse(words: str, capsys: pytest.CaptureFixture[str]) -> str:
    before = sorted(Path().rglob("*"))
    assert main(words.split()) == 2
    error = capsys.readouterr().err
    assert error.startswith("bozzini: error: ") and error.count("\n") == 1
    assert sorted(Path().rglob("*")) == before
    return error


@pytest.mark.parametrize("where", ["more", "options", "centreline", "input", "candidates"])
@pytest.mark.parametrize("words", COMMANDS)
def test_the_meta_of_a_plan(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: str,
    where: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    with np.load(PLAN, allow_pickle=False) as file:
        arrays = dict(file.items())
    meta = {**json.loads(str(arrays["meta"])), where: "HERE"}
    arrays["meta"] = np.array(json.dumps(meta).replace('"HERE"', DEEP))
    np.savez(tmp_path / "plan.npz", **arrays)
    (tmp_path / "x.stl").write_text("solid")
    assert "nested more than 50 lists" in _refuse(words.replace("PLAN", "plan.npz"), capsys)


@pytest.mark.parametrize("words", OF_FILES)
def test_files_of_all_kinds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("x.yaml", "x.json"):
        (tmp_path / name).write_text(f'{{"name": {DEEP}}}')
    for name in ("x.stl", "x.csv"):
        (tmp_path / name).write_text("a,b\n1,2\n")
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "study.json").write_text(DEEP)
    np.savez(tmp_path / "robot.npz", record=np.array(DEEP))
    assert "nested more than 50 lists" in _refuse(words, capsys)
