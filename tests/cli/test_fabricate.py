"""``bozzini continuum fabricate`` and ``bozzini effector fabricate``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bozzini.cli.main import main

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ROBOT = ("continuum", "fabricate", str(EXAMPLES / "two_sections.yaml"))
EFFECTOR = ("effector", "fabricate")


@pytest.mark.parametrize("command", [ROBOT, (*EFFECTOR, "--holder-diameter", "11mm")])
def test_json_lists_the_files_of_the_directory(command, tmp_path, capsys):
    out = tmp_path / "out"
    assert main([*command, "--out", str(out), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["output"] == str(out)
    assert sorted(path.name for path in out.iterdir()) == answer["files"]
    assert {f"{part['name']}.stl" for part in answer["parts"]} <= set(answer["files"])
    saved = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert saved["parts"] == answer["parts"]
    assert main([*command, "--out", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main([*command, "--out", str(out), "--force"]) == 0
    assert "volume [mm^3]" in capsys.readouterr().out


def test_step_files_leave_one_object_on_stdout(tmp_path, capfd):
    pytest.importorskip("OCP", reason="the extra 'cad' is not installed")
    command = (*EFFECTOR, "--holder-diameter", "11mm", "--step", "--json")
    assert main([*command, "--out", str(tmp_path / "out")]) == 0
    answer = json.loads(capfd.readouterr().out)
    assert sum(name.endswith(".step") for name in answer["files"]) == 4


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((*ROBOT, "--thickness", "7mm"), "thickness is 7 mm: it must be below 5 mm"),
        ((*ROBOT, "--wall", "2mm"), "at least 2 mm must be"),
        ((*ROBOT, "--tendon-diameter", "0mm"), "tendon diameter is 0 mm: it must lie in"),
        (EFFECTOR, "with walls of 0.3 mm need at least 10.6 mm"),
        ((*EFFECTOR, "--air-bore", "1mm"), "air bore is 1 mm"),
    ],
)
def test_what_cannot_be_made_is_one_line(arguments, words, tmp_path, capsys):
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert words in lines[-1]
    assert not list(tmp_path.iterdir())
