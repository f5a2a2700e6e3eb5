"""Absurd lengths: every option of every command refuses them in one line, exit code 2."""

from __future__ import annotations

import json
import re
from pathlib import Path

import click
import pytest

from bozzini.cli.common import QuantityType
from bozzini.cli.main import COMMANDS, main, root

ABSURD = ("5parsec", "1e300mm", "1e300", "nan", "inf", "-infmm", "1e999mm", "9lightyear")
SCOPE = ("--diameter", "--link", "--length", "--head-step", "--voxel", "--inflate")


def list_options() -> list[tuple[str, ...]]:
    """Every option that is a length, with the words of its command before it."""
    found: list[tuple[str, ...]] = []

    def visit(command: click.Command, words: tuple[str, ...]) -> None:
        context = click.Context(command)
        if isinstance(command, click.Group):
            for name in command.list_commands(context):
                inner = command.get_command(context, name)
                if inner is not None:
                    visit(inner, (*words, name))
            return
        for option in command.params:
            if isinstance(option.type, QuantityType) and option.type.name == "length":
                found.append((*words, option.opts[0]))

    for name in COMMANDS:
        command = root.get_command(click.Context(root), name)
        assert command is not None
        visit(command, (name,))
    return found


def refuse(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main([*arguments]) == 2
    told = capsys.readouterr()
    assert told.out == "" and told.err.count("\n") == 1 and "Traceback" not in told.err
    return told.err


@pytest.mark.slow
def test_every_length_of_every_command_has_an_end(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    options = list_options()
    assert ("plan", "--diameter") in options and len(options) > 15
    for *words, option in options:
        for value in ABSURD:
            line = refuse(capsys, *words, f"{option}={value}")
            assert option in line, (words, line)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("value", ["1e-30mm", "-5mm", "1e5mm", "1e-320"])
@pytest.mark.parametrize("option", SCOPE)
def test_a_length_outside_its_range_is_refused_with_that(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, option: str, value: str
) -> None:
    out = tmp_path / "out"
    given = ["plan", str(tmp_path / "none.nii.gz"), f"{option}={value}", "--out", str(out)]
    line = refuse(capsys, *given)
    if (option, value[0]) == ("--inflate", "1") and "e-" in value:
        assert "no such file" in line  # no inflation to speak of is legal
        return
    if (option, value) == ("--voxel", "1e5mm"):
        assert "no such file" in line  # how wide a voxel may be depends on the tract
        return
    assert re.search(r"must lie in [\[(].*[\])] mm|must be at most", line), line
    assert main([*given, "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["error"]
    assert not out.exists()
