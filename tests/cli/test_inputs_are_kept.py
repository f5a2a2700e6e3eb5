"""No output of a command takes the place of what the command reads."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import click
import pytest

from bozzini.anatomy.read import read_tract
from bozzini.anatomy.tissue import RecordedMotion
from bozzini.cli.common import INPUT, OUTPUT
from bozzini.cli.main import main
from bozzini.errors import BozziniError, OutputError
from bozzini.io.files import check_new_file, new_directory, write_text
from bozzini.io.inputs import keep_inputs, note_input
from bozzini.io.records import load_data
from bozzini.io.sheets import read_sheet
from bozzini.motion import Plan
from bozzini.motion.actuate import Actuation
from bozzini.muscle import MuscleFile, preset, write_muscle
from bozzini.vision.pictures import read_picture
from tests.cli.plan_cases import write_scan

if not hasattr(os, "fork"):
    pytest.skip("the commands are listed by the fuzz program", allow_module_level=True)

from tests.fuzz.__main__ import FILES, LEGAL, _split, find_commands

COMMANDS = find_commands()


def _list_paths(command: click.Command) -> list[click.Parameter]:
    return [item for item in command.params if isinstance(item.type, click.Path)]


def test_every_path_is_declared_as_one_or_the_other() -> None:
    outputs = {"out", "figure", "plot", "forces"}
    for name, command in COMMANDS.items():
        for item in _list_paths(command):
            assert item.type in (INPUT, OUTPUT), f"{name} {item.name}"
            assert (item.type is OUTPUT) == (item.name in outputs), f"{name} {item.name}"


def _list_lines(name: str) -> Iterator[list[str]]:
    """Yield the legal lines of a command that read a file, where it writes one."""
    flags = [item.opts[0] for item in _list_paths(COMMANDS[name]) if item.name == "out"]
    for text in LEGAL.get(name, (0, ""))[1].split("|"):
        words = _split(text)
        if flags and any(word.startswith("<") for word in words):
            at = words.index(flags[0]) if flags[0] in words else len(words)
            yield [*words[:at], *words[at + 2 :], flags[0], "OUT"]


LINES = [(name, line) for name in COMMANDS for line in _list_lines(name)]


@pytest.mark.parametrize(("name", "line"), LINES, ids=[name for name, _ in LINES])
def test_no_command_replaces_a_file_that_it_is_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, line: list[str]
) -> None:
    words = []
    for index, word in enumerate(line):
        if word.startswith("<"):
            kind = word[1:].replace("_", " ")
            suffix = "".join(Path(FILES[kind][0]).suffixes)
            word = str(tmp_path / f"in{index}{suffix}")
            Path(word).write_text(
                "diameter: 5 mm\n" if kind == "options" else "dear", encoding="utf-8"
            )
            if kind == "muscle":
                write_muscle(word, MuscleFile(muscle=preset("effector-45")))
        words.append(word)
    given = {path: path.read_text(encoding="utf-8") for path in sorted(tmp_path.iterdir())}
    for target in given:
        code = main([*name.split(), *words[:-1], str(target), "--force"])
        error = capsys.readouterr().err
        assert code == 2
        assert "is an input of this command, which would be lost: choose another file" in error
    assert {path: path.read_text(encoding="utf-8") for path in sorted(tmp_path.iterdir())} == given


def test_lines_are_of_nearly_all_commands_that_read_and_write() -> None:
    both = {
        name
        for name, command in COMMANDS.items()
        if click.Argument in {type(item) for item in _list_paths(command) if item.type is INPUT}
        and any(item.name == "out" for item in _list_paths(command))
    }
    assert len(both & {name for name, _ in LINES}) > 44


@pytest.mark.parametrize("link", ["same", "symbolic", "hard", "dotted"])
def test_a_scan_is_not_replaced_by_its_labels(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], link: str
) -> None:
    scan = write_scan(tmp_path / "ct.nii.gz")
    before, out = scan.read_bytes(), tmp_path / "labels.nii.gz"
    if link == "same":
        out = scan
    elif link == "dotted":
        out = tmp_path / "folder" / ".." / "ct.nii.gz"
        (tmp_path / "folder").mkdir()
    else:
        (out.symlink_to if link == "symbolic" else out.hardlink_to)(scan)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert main(["segment", str(scan), "--out", str(out), "--force", "--quiet"]) == 2
    assert "is an input of this command" in capsys.readouterr().err
    assert scan.read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == names


def test_a_table_is_not_replaced_by_what_is_predicted(tmp_path: Path) -> None:
    rows = [f"{100 * k},{k / (k + 4)},0" for k in range(8)]
    table = tmp_path / "t.csv"
    table.write_text("\n".join(["pressure [kPa],contraction [mm],load [N]", *rows]) + "\n")
    fit = str(tmp_path / "fit.yaml")
    words = ["muscle", "fit", str(table), "--free", "modulus", "--out", fit]
    assert main(words) in (0, 1)
    before = table.read_bytes(), Path(fit).read_bytes()
    for out in (str(table), fit):
        assert main(["muscle", "predict", fit, str(table), "--out", out, "--force"]) == 2
    for more in ("--figure", "--out"):
        assert main([*words[:-2], more, str(table), "--force"]) == 2
    assert (table.read_bytes(), Path(fit).read_bytes()) == before
    other = str(tmp_path / "predicted.csv")
    for _ in range(2):  # what it wrote itself is no input
        assert main(["muscle", "predict", fit, str(table), "--out", other, "--force"]) in (0, 1)


def _read_model(path: Path) -> None:
    """Read a surface, and what the JSON of its model says of it."""
    folder = path.parent
    (folder / "tube.vtk").write_text(
        "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 3 float\n"
        "0 0 0 9 0 0 0 9 0\nPOLYGONS 1 4\n3 0 1 2\n"
    )
    path.write_text(
        '{"model_objects": [{"filename": "tube.vtk", "voxel_size": [1, 1, 1]}]}', encoding="utf-8"
    )
    read_tract(folder / "tube.vtk")


def _read_detached(path: Path) -> None:
    path.write_bytes(bytes(27))
    header = path.with_suffix(".mhd")
    lines = [
        "ObjectType = Image",
        "NDims = 3",
        "DimSize = 3 3 3",
        "ElementSpacing = 1 1 1",
        "Offset = 0 0 0",
        "ElementType = MET_UCHAR",
    ]
    header.write_text("\n".join([*lines, f"ElementDataFile = {path.name}", ""]))
    read_tract(header)


READERS = {
    "x.yaml": load_data, "x.json": load_data, "x.csv": read_sheet, "x.npz": Plan.load,
    "robot.npz": Actuation.load, "motion.npz": RecordedMotion.load, "x.png": read_picture,
    "x.stl": read_tract, "x.nii.gz": read_tract, "model.json": _read_model, "x.raw": _read_detached,
}  # fmt: skip
"""What reads files that another file may name, or that are sought beside it."""


@pytest.mark.parametrize("name", READERS)
def test_a_file_named_by_another_is_kept_too(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text("x: 1\n" if name == "x.yaml" else "{}")
    with keep_inputs():
        with suppress(BozziniError):
            READERS[name](path)
        before = path.read_bytes()
        with pytest.raises(OutputError, match="is an input of this command"):
            write_text(path, "new")
        with pytest.raises(OutputError, match="is an input of this command"):
            check_new_file(path, (path.suffix,), force=True)
    assert path.read_bytes() == before
    write_text(path, "from Python a file may be replaced by what it became")


def test_the_picture_beside_an_output_is_kept(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"dear")
    with keep_inputs():
        note_input(tmp_path / "a.png")
        with pytest.raises(OutputError, match="input of this command"):
            check_new_file((tmp_path / "a.yaml").with_suffix(".png"), (".png",), force=True)


def test_another_file_may_get_the_number_of_one_that_is_gone(tmp_path: Path) -> None:
    with keep_inputs():
        for k in range(20):
            path = tmp_path / str(k)
            path.write_text("x")
            note_input(path)
            path.unlink()
        for k in range(20, 40):
            (tmp_path / str(k)).write_text("x")
            write_text(tmp_path / str(k), "y")


def _fill(folder: Path) -> Path:
    (folder / "parts").mkdir(parents=True)
    (folder / "parts" / "plan.npz").write_text("dear")
    (folder / "summary.json").write_text('{"files": ["parts/plan.npz", "summary.json"]}')
    return folder


@pytest.mark.parametrize("what", ["parts/plan.npz", "parts", "", "hard"])
def test_a_directory_that_holds_an_input_is_not_replaced(tmp_path: Path, what: str) -> None:
    result = _fill(tmp_path / "result")
    read = result / what
    if what == "hard":
        read = tmp_path / "plan.npz"
        read.hardlink_to(result / "parts" / "plan.npz")
    with keep_inputs():
        note_input(read)
        with pytest.raises(OutputError, match="input of this command"):
            with new_directory(result, force=True) as folder:
                (folder / "summary.json").write_text("{}")
    assert (result / "parts" / "plan.npz").read_text(encoding="utf-8") == "dear"
    with new_directory(result, force=True) as folder:
        (folder / "summary.json").write_text("{}")
    assert [path.name for path in result.iterdir()] == ["summary.json"]


def test_a_plan_is_not_replaced_by_its_execution(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = _fill(tmp_path / "result")
    plan = Path(__file__).parents[1] / "data" / "plan_0_1_best.npz"
    shutil.copy(plan, result / "parts" / "plan.npz")
    words = ["uncertainty", str(result / "parts" / "plan.npz"), str(tmp_path / "x.stl")]
    assert main([*words, "--out", str(result), "--force"]) == 2
    assert "holds 'parts', an input" not in (error := capsys.readouterr().err)
    assert "holds 'parts/plan.npz', an input of this command" in error
    assert (result / "parts" / "plan.npz").read_bytes() == plan.read_bytes()
