"""An option that is given twice: no value is lost without a word, in any command."""

from __future__ import annotations

from pathlib import Path

import click
import pytest

from bozzini.cli.common import LabelsType
from bozzini.cli.main import main
from tests.fuzz.__main__ import find_commands

COMMANDS = find_commands()


def _parse(command: click.Command, arguments: list[str]) -> dict[str, object]:
    context = click.Context(command, info_name="it")
    given: dict[str, object] = command.make_parser(context).parse_args(arguments)[0]
    return given


@pytest.mark.parametrize("name", COMMANDS)
def test_no_command_loses_a_value(name: str) -> None:
    command, taken = COMMANDS[name], 0
    for item in command.params:
        if not isinstance(item, click.Option) or item.is_flag or "--set" in item.opts:
            continue
        taken += 1
        first, last = item.opts[0], item.opts[-1]
        twice = [first, "1", f"{last}=2"]
        same = _parse(command, [first, "1", first, "1"])
        if item.name in same:  # what is an argument today goes there
            assert same[item.name] in ("1", "1,1", ["1", "1"])
        else:
            assert item.hidden and "1" in same.values()
        if item.multiple:
            assert _parse(command, twice)[item.name] == ["1", "2"]
        elif isinstance(item.type, LabelsType) or str(item.metavar).endswith(",..."):
            assert _parse(command, twice)[item.name] == "1,2"
        else:
            words = f"^{first} is given more than once, as '1' and '2': give it once$"
            with pytest.raises(click.UsageError, match=words):
                _parse(command, twice)
    assert (
        taken
        or not any(isinstance(item, click.Option) for item in command.params)
        or (all(item.is_flag for item in command.params if isinstance(item, click.Option)))
    )


TABLE = "pressure [kPa],contraction [mm],load\n" + "".join(
    f"{p},{p**0.5 / 20 + 0.1 * f},{f}\n" for p in range(100, 600, 50) for f in (0, 1, 2)
)


@pytest.fixture
def table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("data.csv").write_text(TABLE, encoding="utf-8")
    return "data.csv"


def test_free_adds(table: str, capsys: pytest.CaptureFixture[str]) -> None:
    shared = ["muscle", "fit", table, "--unit", "load=N", "--anyway"]
    main([*shared, "--free", "modulus", "--shared", "dead-length"])
    apart = capsys.readouterr()
    main([*shared, "--free", "modulus,dead-length"])
    assert apart == capsys.readouterr()
    assert "modulus" in apart.out and "dead_length" in apart.out


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--length", "45mm", "--length", "50mm"], "--length is given more than once, as '45mm'"),
        (["--unit", "load=kN"], "--unit names 'load' more than once: give it once"),
        (["--unit", "force=kN"], "load is given two units, 'N' and 'kN': give one"),
        (["--set", "a=1", "--set", "a=2"], "--set names"),
    ],
)
def test_two_values_are_one_line(
    table: str, capsys: pytest.CaptureFixture[str], more: list[str], words: str
) -> None:
    assert main(["muscle", "fit", table, "--unit", "load=N", "--free", "modulus", *more]) == 2
    out, err = capsys.readouterr()
    assert out == "" and len(err.splitlines()) == 1
    assert words in err


def test_a_marker_is_described_once(capsys: pytest.CaptureFixture[str]) -> None:
    from bozzini.cli.fit import FitTable
    from bozzini.errors import InputError

    texts = ("m1=3mm", "m1=5mm")
    with pytest.raises(InputError, match="--marker names 'm1' more than once"):
        FitTable(marker_texts=texts, column_texts=(), blocks="").list_markers()
