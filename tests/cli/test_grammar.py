"""One grammar, ``bozzini NOUN VERB FILE``: what stands where, and names of before."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from bozzini.cli.common import OLD_OPTIONS, Description, FieldOption, OldOption
from bozzini.cli.main import OTHER_NAMES, main, root
from bozzini.cli.new import KINDS
from bozzini.cli.schema import SCHEMAS


def _walk(group: click.Group, words: tuple[str, ...]) -> Iterator[tuple[str, click.Command]]:
    context = click.Context(group)
    for word in group.list_commands(context):
        command = group.get_command(context, word)
        assert command is not None
        if isinstance(command, click.Group):
            yield from _walk(command, (*words, word))
        else:
            yield " ".join((*words, word)), command


LEAVES = dict(_walk(root, ()))
FIELDS = {
    name: fields
    for name, command in LEAVES.items()
    if (fields := [item for item in command.params if isinstance(item, FieldOption)])
}


def _parse(command: click.Command, words: list[str]) -> dict[str, object]:
    given, _, _ = command.make_parser(click.Context(command)).parse_args(words)
    left = {name: value for name, value in given.items() if isinstance(value, (str, list, bool))}
    return {name: value for name, value in left.items() if value != []}


def test_a_command_is_a_noun_and_a_verb() -> None:
    assert all(len(name.split()) <= 2 for name in LEAVES)


def test_descriptions_stand_before_the_files_that_are_worked_on() -> None:
    for name, command in LEAVES.items():
        places = [item for item in command.params if isinstance(item, click.Argument)]
        described = [isinstance(item, Description) for item in places]
        assert described == sorted(described, reverse=True), name
        # What may be left out but a description comes last.
        needed = [item.required for item in places if not isinstance(item, Description)]
        assert needed == sorted(needed, reverse=True), name
        of_noun = [item.name for item in places if str(item.name).startswith("robot")]
        assert not of_noun or of_noun == [places[0].name], name


@pytest.mark.parametrize("name", FIELDS)
def test_a_field_is_set_by_its_name_as_by_its_option(name: str) -> None:
    command = LEAVES[name]
    for item in FIELDS[name]:
        assert not (item.is_flag or item.multiple)
        by_name = _parse(command, ["--set", f"{item.name}=7"])
        assert by_name == _parse(command, [item.opts[0], "7"]) != {}
        with pytest.raises(click.UsageError, match="needs a value"):
            _parse(command, ["--set", str(item.name)])
        with pytest.raises(click.UsageError, match="more than once"):
            _parse(command, ["--set", f"{item.name}=7", "--set", f"{item.name}=8"])
        assert str(item.name) in command.get_help(click.Context(command))


def test_a_description_is_what_its_options_of_before_give() -> None:
    found = 0
    for name, command in LEAVES.items():
        for item in (item for item in command.params if isinstance(item, OldOption)):
            files = [
                f"f{k}" for k, p in enumerate(command.params) if p.param_type_name == "argument"
            ]
            others = files[1:] if len(files) > 1 else []
            today = _parse(command, ["one.yaml", *others])
            assert _parse(command, [*others, item.opts[0], "one.yaml"]) == today, name
            with pytest.raises(click.UsageError, match="more than once"):
                _parse(command, ["two.yaml", *others, item.opts[0], "one.yaml"])
            found += 1
    assert found > 30


def test_an_option_of_before_is_that_of_today() -> None:
    for old, option in OLD_OPTIONS.items():
        takers = [c for c in LEAVES.values() if any(option in item.opts for item in c.params)]
        assert takers
        for command in takers:
            assert _parse(command, [old, "2"]) == _parse(command, [option, "2"])


def test_names_of_before_lead_to_commands_that_are() -> None:
    for name in OTHER_NAMES.values():
        assert any(leaf == name or leaf.startswith(f"{name} ") for leaf in LEAVES), name


def test_all_kinds_that_are_written_have_a_schema() -> None:
    assert {"options" if name == "plan" else name for name in KINDS} == {*SCHEMAS} - {"plan"}


SPELLINGS = """
muscle solve effector-45 --pressure 0.3MPa | muscle solve --preset effector-45 --pressure 0.3MPa
muscle solve m.yaml --pressure 0.3MPa | muscle solve --muscle m.yaml --pressure 0.3MPa
effector pose thesis --pressure R=0.3MPa | effector pose --preset thesis --pressure R=0.3MPa
effector trace --radius 3mm --points 4 | effector trace circle --radius 3mm --points 4
effector pose --set beam_factor=3 --pressure R=0.3MPa | tip pose --beam 3 --pressure R=0.3MPa
"""


@pytest.mark.parametrize("spelling", SPELLINGS.strip().splitlines())
def test_an_answer_does_not_depend_on_the_spelling(
    spelling: str, capsys: pytest.CaptureFixture[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["new", "muscle", "m.yaml"]) == 0
    answers = []
    for line in spelling.split(" | "):
        capsys.readouterr()
        assert main([*line.split(), "--json"]) == 0
        answers.append(json.loads(capsys.readouterr().out))
    assert answers[0] == answers[1]


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_is_written_to_a_file_or_to_one_of_its_name(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", kind]) == main(["new", kind, "a.yaml"]) == 0
    assert main(["new", kind, "--out", "b.yaml"]) == 0
    texts = {
        Path(name).read_text().replace(name, "") for name in (f"{kind}.yaml", "a.yaml", "b.yaml")
    }
    assert len(texts) == 1


def test_an_effector_and_shapes_that_are_written_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "effector"]) == main(["new", "shapes"]) == 0
    tips = []
    for words in (["effector.yaml"], []):
        capsys.readouterr()
        assert main(["effector", "pose", *words, "--pressure", "R=0.3MPa", "--json"]) == 0
        tips.append(json.loads(capsys.readouterr().out)["tip_mm"])
    assert tips[0] == pytest.approx(tips[1], abs=1e-9)
    assert main(["duct", "show", "shapes.yaml", "--out", "shapes.png"]) == 0
