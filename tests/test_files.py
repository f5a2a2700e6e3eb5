"""Files: a result is there whole or not at all, and nothing temporary stays behind."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from bozzini.errors import OutputError
from bozzini.files import (
    check_new_directory,
    check_new_file,
    new_directory,
    write_atomically,
    write_text,
)

as_root = hasattr(os, "geteuid") and os.geteuid() == 0


def _fail(_: Path) -> None:
    raise RuntimeError("half way")


def _fill_then_fail(path: Path) -> None:
    path.write_text("half")
    raise OSError(28, "No space left on device")


def test_written_text_comes_back(tmp_path: Path) -> None:
    path = write_text(tmp_path / "note.txt", "5 µm\n")
    assert path == tmp_path / "note.txt"
    assert path.read_bytes() == "5 µm\n".encode()
    assert os.listdir(tmp_path) == ["note.txt"]


def test_temporary_file_keeps_the_suffix(tmp_path: Path) -> None:
    seen = []
    write_atomically(tmp_path / "scan.npz", lambda path: seen.append(path.suffix))
    assert seen == [".npz"]


def test_permissions_are_those_of_an_ordinary_file(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    path = write_text(tmp_path / "ours", "")
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


@pytest.mark.parametrize("write", [_fail, _fill_then_fail])
def test_failure_leaves_what_was_there(tmp_path: Path, write: object) -> None:
    target = write_text(tmp_path / "plan", "old")
    with pytest.raises((RuntimeError, OutputError)):
        write_atomically(target, write)  # type: ignore[arg-type]
    assert target.read_text() == "old"
    assert os.listdir(tmp_path) == ["plan"]


def test_system_error_becomes_one_line(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot write .*plan: No space left on device$"):
        write_atomically(tmp_path / "plan", _fill_then_fail)


@pytest.mark.parametrize("name", ["missing/plan", "file/plan", "x" * 300, "a\0b"])
def test_impossible_places_are_output_errors(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write"):
        write_text(tmp_path / name, "x")
    assert os.listdir(tmp_path) == ["file"]


def test_directory_appears_only_at_the_end(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "out"
    with new_directory(target) as place:
        (place / "a").write_text("1")
        assert not target.exists()
    assert (target / "a").read_text() == "1"
    assert os.listdir(tmp_path / "deep") == ["out"]


def test_directory_does_not_appear_when_the_block_fails(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), new_directory(tmp_path / "out") as place:
        _fail(place)
    assert os.listdir(tmp_path) == []


def test_existing_directory_needs_force(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    with pytest.raises(OutputError, match="exists already.*--force"), new_directory(target):
        pass
    assert os.listdir(target) == []


def test_force_replaces_same_names_and_keeps_the_rest(tmp_path: Path) -> None:
    target = tmp_path / "out"
    (target / "sub").mkdir(parents=True)
    for name in ("mine", "report", "sub/mine", "sub/report"):
        (target / name).write_text("old")
    with new_directory(target, force=True) as place:
        (place / "sub").mkdir()
        (place / "report").write_text("new")
        (place / "sub" / "report").write_text("new")
    found = {str(p.relative_to(target)): p.read_text() for p in target.rglob("*") if p.is_file()}
    assert found == {"mine": "old", "report": "new", "sub/mine": "old", "sub/report": "new"}
    assert os.listdir(tmp_path) == ["out"]


def test_failure_with_force_leaves_what_was_there(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    (target / "report").write_text("old")
    with pytest.raises(RuntimeError), new_directory(target, force=True) as place:
        (place / "report").write_text("new")
        _fail(place)
    assert (target / "report").read_text() == "old"
    assert os.listdir(tmp_path) == ["out"]


@pytest.mark.parametrize("name", ["file", "file/out", "x" * 300, "a\0b"])
def test_impossible_directories_are_refused_at_once(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        check_new_directory(tmp_path / name, force=True)


@pytest.mark.skipif(as_root, reason="permissions do not bind the superuser")
def test_directory_without_permission_is_refused_at_once(tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    with pytest.raises(OutputError, match="no permission"):
        check_new_directory(closed / "out")
    with pytest.raises(OutputError, match="cannot write"):
        write_text(closed / "plan", "x")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.txt", "ends in '.txt': it must end in .png, .svg"),
        ("no/a.png", "no is not a directory"),
        ("file/a.png", "file is not a directory"),
        ("folder.png", "folder.png is a directory: choose a file"),
        ("x" * 300 + ".png", "cannot write"),
        ("a\0b.png", "cannot write"),
    ],
)
def test_impossible_files_are_refused_at_once(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(OutputError, match=message):
        check_new_file(tmp_path / name, (".png", ".svg"), force=True)
    assert sorted(os.listdir(tmp_path)) == ["file", "folder.png"]


def test_a_file_that_can_be_written_is_not_touched_by_asking(tmp_path: Path) -> None:
    check_new_file(tmp_path / "a.PNG", (".png",))
    assert os.listdir(tmp_path) == []
    (tmp_path / "a.png").write_text("old")
    check_new_file(tmp_path / "a.png", (".png",), force=True)
    with pytest.raises(OutputError, match="exists already"):
        check_new_file(tmp_path / "a.png", (".png",))
    assert (tmp_path / "a.png").read_text() == "old"


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="a place that takes no file at all")
def test_a_place_that_takes_no_file_is_refused_at_once() -> None:
    with pytest.raises(OutputError, match="cannot write /proc/a.png"):
        check_new_file("/proc/a.png", (".png",))
