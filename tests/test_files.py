"""Files: a result is there whole or not at all, and nothing temporary stays behind."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import bozzini
from bozzini.errors import OutputError
from bozzini.io.files import (
    check_new_directory,
    check_new_file,
    new_directory,
    reserve_directory,
    write_atomically,
    write_text,
)

as_root = hasattr(os, "geteuid") and os.geteuid() == 0


def _fail(_: Path) -> None:
    raise RuntimeError("half way")


def _fill_then_fail(path: Path) -> None:
    path.write_text("half", encoding="utf-8")
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


@pytest.mark.parametrize("there", [False, True])
def test_a_file_is_written_where_a_link_leads(tmp_path: Path, there: bool) -> None:
    (tmp_path / "data").mkdir()
    link, target = tmp_path / "plan", tmp_path / "data" / "plan"
    link.symlink_to(Path("data", "plan"))
    if there:
        target.write_text("old")
    check_new_file(link, ("",), force=there)
    assert write_text(link, "new") == link
    assert (
        link.is_symlink()
        and target.read_text(encoding="utf-8") == "new"
        and not target.is_symlink()
    )
    assert sorted(os.listdir(tmp_path / "data")) == ["plan"]


def test_a_directory_is_made_where_a_link_leads(tmp_path: Path) -> None:
    (tmp_path / "out").symlink_to("data")
    with new_directory(tmp_path / "out") as place:
        (place / "report").write_text("new")
    assert (tmp_path / "out").is_symlink() and (tmp_path / "data" / "report").is_file()


def test_links_in_a_circle_and_devices_are_refused(tmp_path: Path) -> None:
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    (tmp_path / "null").symlink_to(os.devnull)
    for name, words in (("circle", "in a circle"), ("null", "a device or a pipe")):
        for force in (False, True):
            with pytest.raises(OutputError, match=words):
                check_new_file(tmp_path / name, ("",), force=force)
        with pytest.raises(OutputError, match=words):
            write_text(tmp_path / name, "x")
    assert sorted(os.listdir(tmp_path)) == ["circle", "null"]
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)


@pytest.mark.parametrize("write", [_fail, _fill_then_fail])
def test_failure_leaves_what_was_there(tmp_path: Path, write: object) -> None:
    target = write_text(tmp_path / "plan", "old")
    with pytest.raises((RuntimeError, OutputError)):
        write_atomically(target, write)  # type: ignore[arg-type]
    assert target.read_text(encoding="utf-8") == "old"
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
    assert (target / "a").read_text(encoding="utf-8") == "1"
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


def _put_result(target: Path, *names: str, **contents: str) -> Path:
    """Write files, and the summary that lists them."""
    with new_directory(target, force=True) as place:
        for name in names:
            (place / name).parent.mkdir(exist_ok=True)
            (place / name).write_text(contents.get("text", "old"))
        files = json.dumps({"files": [*names, "summary.json"]})
        (place / "summary.json").write_text(files)
    return target


def _read_all(folder: Path) -> dict[str, str]:
    return {
        str(p.relative_to(folder)): p.read_text(encoding="utf-8")
        for p in folder.rglob("*")
        if p.is_file()
    }


def test_force_replaces_a_result_as_a_whole(tmp_path: Path) -> None:
    target = _put_result(tmp_path / "out", "report", "robot", "sub/map")
    (target / ".DS_Store").write_text("of the desktop")
    with new_directory(target, force=True) as place:
        (place / "report").write_text("new")
        assert (target / "robot").read_text(
            encoding="utf-8"
        ) == "old"  # until the new one is complete
    assert _read_all(target) == {"report": "new"}
    assert os.listdir(tmp_path) == ["out"]


def test_an_empty_directory_is_replaced_by_force(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir(mode=0o750)
    with new_directory(tmp_path / "out", force=True) as place:
        (place / "report").write_text("new")
    assert _read_all(tmp_path) == {"out/report": "new"}
    assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == 0o750


@pytest.mark.parametrize("name", ["notes.txt", "sub/notes.txt", "link", "report.html"])
@pytest.mark.parametrize("with_result", [False, True])
def test_force_never_removes_files_of_the_user(
    tmp_path: Path, name: str, with_result: bool
) -> None:
    target = tmp_path / "out"
    target.mkdir()
    if with_result:
        _put_result(target, "plan")
    (target / name).parent.mkdir(exist_ok=True)
    if name == "link":
        (tmp_path / "elsewhere").mkdir()
        (target / name).symlink_to(tmp_path / "elsewhere")
    else:
        (target / name).write_text("mine")
    before = _read_all(tmp_path)
    with pytest.raises(OutputError, match=f"out holds '{name}', .*--force would remove it"):
        check_new_directory(target, force=True)
    with pytest.raises(OutputError), new_directory(target, force=True):
        pytest.fail("the work had begun")
    assert _read_all(tmp_path) == before
    assert (target / name).exists()


def test_a_file_that_comes_during_the_work_is_not_removed(tmp_path: Path) -> None:
    target = _put_result(tmp_path / "out", "report")
    with (
        pytest.raises(OutputError, match="out holds 'notes.txt'"),
        new_directory(target, force=True) as place,
    ):
        (place / "report").write_text("new")
        (target / "notes.txt").write_text("mine")
    assert (target / "notes.txt").read_text(encoding="utf-8") == "mine"
    assert (target / "report").read_text(encoding="utf-8") == "old"
    assert os.listdir(tmp_path) == ["out"]


def test_a_result_of_the_first_version_is_known(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    for name in ("plan.npz", "report.html", "scene.glb", "plan-follow.npz"):
        (target / name).write_text("old")
    with pytest.raises(OutputError, match="holds"):  # it has no summary
        check_new_directory(target, force=True)
    (target / "summary.json").write_text('{"clearance_min_mm": null}')
    check_new_directory(target, force=True)
    for wrong in ("[]", "{", "null", "{}", '{"files": 3}', '{"files": [[1]]}', "[" * 100_000):
        (target / "summary.json").write_text(wrong)
        with pytest.raises(OutputError, match="holds"):
            check_new_directory(target, force=True)


def test_failure_with_force_leaves_what_was_there(tmp_path: Path) -> None:
    target = _put_result(tmp_path / "out", "report")
    with pytest.raises(RuntimeError), new_directory(target, force=True) as place:
        (place / "report").write_text("new")
        _fail(place)
    assert (target / "report").read_text(encoding="utf-8") == "old"
    assert os.listdir(tmp_path) == ["out"]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("call", [1, 2])
def test_failure_of_either_rename_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, call: int
) -> None:
    target = _put_result(tmp_path / "out", "report")
    rename, calls = Path.rename, []

    def fail(self: Path, place: Path) -> Path:
        calls.append(self)
        if len(calls) == call:
            raise error
        return rename(self, place)

    monkeypatch.setattr(Path, "rename", fail)
    expected = KeyboardInterrupt if isinstance(error, KeyboardInterrupt) else OutputError
    with pytest.raises(expected), new_directory(target, force=True) as place:
        (place / "report").write_text("new")
    assert len(calls) >= call
    assert (target / "report").read_text(encoding="utf-8") == "old"
    assert os.listdir(tmp_path) == ["out"]


def test_an_error_of_the_system_inside_the_block_is_one_line(tmp_path: Path) -> None:
    with (
        pytest.raises(OutputError, match="^cannot write .*out: No space left on device$"),
        new_directory(tmp_path / "deep" / "out") as place,
    ):
        _fill_then_fail(place / "report")
    assert os.listdir(tmp_path) == []


def test_a_symbolic_link_is_followed(tmp_path: Path) -> None:
    _put_result(tmp_path / "real", "report")
    link = tmp_path / "link"
    link.symlink_to("real")
    with new_directory(link, force=True) as place:
        (place / "report").write_text("new")
    assert link.is_symlink() and _read_all(link) == {"report": "new"}
    (tmp_path / "dangling").symlink_to(tmp_path / "far" / "place")
    with new_directory(tmp_path / "dangling") as place:
        (place / "report").write_text("new")
    assert _read_all(tmp_path / "far") == {"place/report": "new"}
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(OutputError, match="circle"):
        check_new_directory(tmp_path / "a")


@pytest.mark.parametrize("place", [".", "..", "/", "../here", "./."])
def test_the_working_directory_is_never_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with pytest.raises(OutputError, match="is the working directory or holds it"):
        check_new_directory(place, force=True)
    with pytest.raises(OutputError, match="exists already"):
        check_new_directory(place)


def test_a_reservation_is_used_by_the_same_process(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "out"
    with reserve_directory(target), new_directory(target) as place:
        (place / "report").write_text("new")
    assert _read_all(tmp_path) == {"deep/out/report": "new"}
    with pytest.raises(RuntimeError), reserve_directory(tmp_path / "b" / "c" / "d"):
        assert (tmp_path / "b" / "c").is_dir()
        _fail(tmp_path)
    assert os.listdir(tmp_path) == ["deep"]  # directories made for it go with it
    assert os.listdir(tmp_path / "deep") == ["out"]


_HOLD = """
import sys, time
from bozzini.io.files import new_directory, reserve_directory
with reserve_directory(sys.argv[1]), new_directory(sys.argv[1]) as place:
    (place / "report").write_text("first")
    print("held", flush=True)
    sys.stdin.readline()
"""


@pytest.fixture
def other(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Give a process that writes to the directory ``out`` until it reads a line."""
    command = [sys.executable, "-c", _HOLD, str(tmp_path / "out")]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=tmp_path
    )
    assert process.stdout is not None and process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.communicate()


def _list_hidden(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name.startswith("."))


@pytest.mark.skipif(sys.platform == "win32", reason="no locks are used there")
@pytest.mark.parametrize("next_one", ["out", "another"])
def test_what_a_killed_process_left_is_removed_by_the_next(
    tmp_path: Path, other: subprocess.Popen[str], next_one: str
) -> None:
    (tmp_path / ".bozzini-mine").mkdir()
    while_it_works = _list_hidden(tmp_path)
    with new_directory(tmp_path / "another") as place:  # it lives: nothing of it is removed
        (place / "summary.json").write_text('{"files": ["summary.json"]}')
    assert _list_hidden(tmp_path) == while_it_works
    other.kill()
    other.wait()
    with new_directory(tmp_path / next_one, force=True) as place:
        (place / "report").write_text("new")
    assert _list_hidden(tmp_path) == [".bozzini-mine"]


@pytest.mark.skipif(sys.platform == "win32", reason="no locks are used there")
def test_an_old_result_is_there_again_after_a_kill_between_the_renames(tmp_path: Path) -> None:
    code = """
import os, sys
from pathlib import Path
from bozzini.io.files import new_directory
rename = Path.rename
def stop(self, target):
    rename(self, target)
    os._exit(9)
Path.rename = stop
with new_directory("out", force=True) as place:
    (place / "report").write_text("new")
"""
    with new_directory(tmp_path / "out") as place:
        (place / "summary.json").write_text('{"files": ["summary.json"]}')
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False)
    assert done.returncode == 9 and not (tmp_path / "out").exists()
    with pytest.raises(OutputError, match="exists already"), new_directory(tmp_path / "out"):
        pytest.fail("the old result would be lost")
    assert _read_all(tmp_path) == {"out/summary.json": '{"files": ["summary.json"]}'}


@pytest.mark.skipif(sys.platform == "win32", reason="no locks are used there")
@pytest.mark.parametrize("force", [False, True])
def test_the_second_of_two_runs_fails_at_once(
    tmp_path: Path, other: subprocess.Popen[str], force: bool
) -> None:
    for spelling in (tmp_path / "out", tmp_path / "x" / ".." / "out"):
        with (
            pytest.raises(OutputError, match="another run is writing .*out: choose another"),
            reserve_directory(spelling, force=force),
        ):
            pytest.fail("both have it")
    with reserve_directory(tmp_path / "out2"):
        pass
    other.communicate("go on\n")
    assert other.returncode == 0
    assert _read_all(tmp_path) == {"out/report": "first"}
    assert os.listdir(tmp_path) == ["out"]


@pytest.mark.skipif(sys.platform == "win32", reason="no locks are used there")
def test_a_dead_process_blocks_nobody(tmp_path: Path, other: subprocess.Popen[str]) -> None:
    other.kill()
    other.wait()
    assert any(name.endswith(".lock") for name in os.listdir(tmp_path))
    with new_directory(tmp_path / "out") as place:
        (place / "report").write_text("second")
    assert (tmp_path / "out" / "report").read_text(encoding="utf-8") == "second"
    assert not any(name.endswith(".lock") for name in os.listdir(tmp_path))


def test_a_name_that_is_not_utf8_can_be_written(tmp_path: Path) -> None:
    try:
        (tmp_path / "\udcff").touch()
    except (OSError, UnicodeError):
        pytest.skip("this file system takes UTF-8 only")
    write_text(tmp_path / "\udcff.html", "of \udcff")
    assert (tmp_path / "\udcff.html").read_text(encoding="utf-8") == "of \\udcff"
    with new_directory(tmp_path / "\udcff\udcfe") as place:
        write_text(place / "é", "1")
    assert (tmp_path / "\udcff\udcfe" / "é").read_text(encoding="utf-8") == "1"


def test_the_longest_names_can_be_written(tmp_path: Path) -> None:
    name = "é" * 127
    write_text(tmp_path / name, "1")
    with new_directory(tmp_path / f"{name}x") as place:
        write_text(place / name, "1")
    assert sorted(os.listdir(tmp_path)) == [name, f"{name}x"]


@pytest.mark.parametrize("name", ["file", "file/out", "x" * 300, "a\0b"])
def test_impossible_directories_are_refused_at_once(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        check_new_directory(tmp_path / name, force=True)


@pytest.fixture
def closing_place(tmp_path: Path) -> Iterator[Path]:
    """Give a directory where a test closes directories, which are opened again at the end."""
    yield tmp_path
    for folder in (path for path in tmp_path.rglob("*") if path.is_dir()):
        folder.chmod(0o755)


def _drop_privileges() -> None:
    """Let permissions bind this process from its next program on, the superuser's too."""
    if as_root:
        prctl = ctypes.CDLL(None, use_errno=True).prctl
        for capability in (1, 2):  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
            if prctl(24, capability, 0, 0, 0):  # PR_CAPBSET_DROP
                os._exit(77)


def run_bound(*words: str, cwd: Path, **env: str) -> subprocess.CompletedProcess[str]:
    """Run Python so that permissions bind it."""
    others = {key: os.environ[key] for key in ("PATH", "LANG") if key in os.environ}
    done = subprocess.run(
        [sys.executable, "-B", *words],
        capture_output=True,
        text=True,
        timeout=250,
        cwd=cwd,
        env={**others, "MPLBACKEND": "Agg", **env},
        preexec_fn=_drop_privileges,
    )
    if done.returncode == 77:
        pytest.skip("permissions do not bind the superuser, and he cannot be bound here")
    return done


needs_users = pytest.mark.skipif(sys.platform == "win32", reason="permissions are others there")


@needs_users
def test_directory_without_permission_is_refused_at_once(closing_place: Path) -> None:
    closed = closing_place / "closed"
    (closed / "result").mkdir(parents=True)
    closed.chmod(0o555)
    source = Path(bozzini.__file__).resolve().parents[1]
    shutil.copytree(source / "bozzini", closing_place / "bozzini", ignore=_compiled)
    code = (
        "import sys; from bozzini.errors import OutputError; from bozzini.io import files\n"
        "for name, force in (('out', False), ('deep/out', False), ('result', True)):\n"
        "    try: files.check_new_directory('closed/' + name, force=force)\n"
        "    except OutputError as error: print(error)\n"
        "try: files.write_text('closed/plan', 'x')\n"
        "except OutputError as error: print(error)\n"
    )
    done = run_bound("-c", code, cwd=closing_place, PYTHONPATH=str(closing_place))
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 4
    assert all("no permission in" in line and "closed" in line for line in lines[:3])
    assert lines[3] == "cannot write closed/plan: Permission denied"
    assert os.listdir(closed) == ["result"]


_compiled = shutil.ignore_patterns("__pycache__")


@pytest.mark.slow
@needs_users
@pytest.mark.parametrize("with_home", [False, True])
def test_a_read_only_installation_without_a_home_computes(
    closing_place: Path, with_home: bool
) -> None:
    source = Path(bozzini.__file__).resolve().parents[1]
    shutil.copytree(source / "bozzini", closing_place / "bozzini", ignore=_compiled)
    for path in (closing_place / "bozzini", *(closing_place / "bozzini").rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)
    for name in ("tmp", "home"):
        (closing_place / name).mkdir()
        (closing_place / name).chmod(0o777)
    home = closing_place / "home" if with_home else closing_place / "bozzini" / "none"
    call = ("-m", "bozzini", "muscle", "curve", "--model", "thesis")
    env = {
        "HOME": str(home),
        "TMPDIR": str(closing_place / "tmp"),
        "PYTHONPATH": str(closing_place),
    }
    done = run_bound(*call, "--out", "tmp/curve.png", cwd=closing_place, **env)
    assert done.returncode == 0, done.stderr
    kept = list((closing_place / ("home" if with_home else "tmp")).rglob("*.nbi"))
    assert kept
    if with_home:
        # Compiling is told where it takes over 2 s, as on a busy machine.
        assert done.stderr in ("", "bozzini: note: compiling (once)\n")
        assert os.listdir(closing_place / "tmp") == ["curve.png"]
    else:
        assert done.stderr.startswith("bozzini: note: compiled code is kept in ")
        told = done.stderr.removesuffix(
            "bozzini: note: compiling (once)\n"
        )  # a slow machine says it
        assert told.count("\n") == 1 and "NUMBA_CACHE_DIR" in told
        # Where a run fails the error stays the last line.
        failed = run_bound("-m", "bozzini", "plan", "none.nii", cwd=closing_place, **env)
        note, error = failed.stderr.splitlines()
        assert note.startswith("bozzini: note: compiled code") and "error: " in error
        # The next run finds it; a directory that others can write is not trusted.
        times = {path: path.stat().st_mtime_ns for path in kept}
        assert run_bound(*call, cwd=closing_place, **env).returncode == 0
        assert {path: path.stat().st_mtime_ns for path in kept} == times
        assert run_bound("-m", "bozzini", "--version", cwd=closing_place, **env).stderr == ""
        (private,) = (path for path in (closing_place / "tmp").iterdir() if path.is_dir())
        assert stat.S_IMODE(private.stat().st_mode) == 0o700
        private.chmod(0o777)
        code = "import os, bozzini; print(os.environ['NUMBA_CACHE_DIR'])"
        done = run_bound("-c", code, cwd=closing_place, **env)
        assert done.returncode == 0, done.stderr
        assert not Path(done.stdout.strip()).is_relative_to(private)
        # What the user chose is used.
        env["NUMBA_CACHE_DIR"] = str(closing_place / "home" / "mine")
        assert (
            run_bound("-c", code, cwd=closing_place, **env).stdout.strip() == env["NUMBA_CACHE_DIR"]
        )


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
    assert (tmp_path / "a.png").read_text(encoding="utf-8") == "old"


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="a place that takes no file at all")
def test_a_place_that_takes_no_file_is_refused_at_once() -> None:
    with pytest.raises(OutputError, match="cannot write /proc/a.png"):
        check_new_file("/proc/a.png", (".png",))
