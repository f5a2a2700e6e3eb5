"""The command line's own promises: exit codes, one line on stderr, one object on stdout."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import click
import numpy as np
import pytest

from bozzini import __version__
from bozzini.cli import common
from bozzini.cli import main as cli
from bozzini.errors import BozziniError, GeometryError, OutputError
from bozzini.progress import Progress

Setup = Callable[[Callable[..., object]], None]


@pytest.fixture
def use(monkeypatch: pytest.MonkeyPatch) -> Iterator[Setup]:
    """Put a function in as the command ``bozzini probe``."""

    def put(function: Callable[..., object]) -> None:
        @click.command("probe")
        @click.option("--diameter", type=common.QuantityType("length"), default="5mm")
        @click.option("--start", type=common.VectorType("length"))
        @click.option("--labels", type=common.LabelsType())
        @common.json_option
        def command(**options: object) -> object:
            return function(**options)

        module = ModuleType("bozzini.cli.probe")
        module.command = command  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "bozzini.cli.probe", module)
        monkeypatch.setitem(cli.COMMANDS, "probe", "A command of the tests.")

    yield put


def _raise(error: BaseException) -> Callable[..., object]:
    def function(**_: object) -> None:
        raise error

    return function


def test_help_lists_every_command_and_exits_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--help"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert all(f"  {name}" in out and line in out for name, line in cli.COMMANDS.items())
    assert cli.main([]) == 0
    assert capsys.readouterr().out == out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"bozzini {__version__}\n"


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_of_the_table_exists_and_explains_itself(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([name, "--help"]) == 0
    assert capsys.readouterr().out.startswith(f"Usage: bozzini {name}")


@pytest.mark.parametrize(("other", "name"), cli.OTHER_NAMES.items())
def test_another_name_of_a_command_is_that_command(
    other: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([*name.split(), "--help"]) == 0
    answer = capsys.readouterr().out
    assert cli.main([*other.split(), "--help"]) == 0
    assert capsys.readouterr().out == answer


@pytest.mark.parametrize(
    ("word", "said"),
    [("mucsle", ", did you mean 'muscle'?"), ("robt", ", did you mean 'robot'?"), ("xyz", " (")],
)
def test_a_command_that_is_misspelt(
    word: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([word, "solve"]) == 2
    assert f"there is no command '{word}'{said}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("outcome", "code"),
    [
        (lambda **_: None, 0),
        (lambda **_: common.EXIT_NEGATIVE, 1),
        (lambda **_: common.run_exit(common.EXIT_NEGATIVE), 1),
        (lambda **_: common.run_exit(common.EXIT_DONE), 0),
        (_raise(BozziniError("no")), 2),
        (_raise(OutputError("cannot write x: no")), 2),
        (_raise(MemoryError()), 2),
        (_raise(ZeroDivisionError("oh")), 70),
        (_raise(AssertionError()), 70),
        (_raise(KeyboardInterrupt()), 130),
        (_raise(BrokenPipeError()), 141),
    ],
)
def test_exit_codes(use: Setup, outcome: Callable[..., object], code: int) -> None:
    use(outcome)
    assert cli.main(["probe"]) == code


def test_an_error_is_one_line_on_stderr(use: Setup, capsys: pytest.CaptureFixture[str]) -> None:
    use(_raise(GeometryError("surface is open:\n  4 boundary edges")))
    assert cli.main(["probe"]) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ("", "bozzini: error: surface is open: 4 boundary edges\n")


def test_an_internal_error_is_one_line_and_shows_its_traceback_when_asked(
    use: Setup, capsys: pytest.CaptureFixture[str]
) -> None:
    use(_raise(ZeroDivisionError("oh")))
    assert cli.main(["probe"]) == 70
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert err.startswith("bozzini: internal error: ZeroDivisionError: oh; run with --debug")
    for arguments in (["--debug", "probe"], ["probe", "--debug"]):
        assert cli.main(arguments) == 70
        err = capsys.readouterr().err
        assert "Traceback (most recent call last)" in err
        assert err.endswith("bozzini: internal error: ZeroDivisionError: oh\n")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["frobnicate"], ["'frobnicate'", "try 'bozzini --help'"]),
        (["probe", "--colour", "red"], ["--colour", "try 'bozzini probe --help'"]),
        (["probe", "surplus"], ["surplus", "try 'bozzini probe --help'"]),
        (["probe", "--diameter"], ["--diameter"]),
        (["probe", "--diameter", "5 foobar"], ["--diameter", "unknown unit 'foobar'", "5mm"]),
        (["probe", "--diameter", "5 kg"], ["--diameter", "wrong kind of unit"]),
        (["probe", "--start", "1,2"], ["--start", "give 3"]),
        (["probe", "--labels", "1,-2"], ["--labels", "'1,-2'", "[1, 65535]"]),
        (["probe", "--labels", "0"], ["--labels", "background"]),
        (["probe", "--labels", ""], ["--labels"]),
    ],
)
@pytest.mark.parametrize("as_json", [False, True])
def test_wrong_usage_is_one_line_and_exit_2(
    use: Setup,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    words: list[str],
    as_json: bool,
) -> None:
    use(lambda **_: None)
    assert cli.main(arguments[:1] + ["--json"] * as_json + arguments[1:]) == 2
    out, err = capsys.readouterr()
    assert err.startswith("bozzini: error: ")
    assert err.count("\n") == 1
    assert all(word in err for word in words)
    if as_json:
        assert json.loads(out)["error"]["type"] == "UsageError"
        assert err == f"bozzini: error: {json.loads(out)['error']['message']}\n"
    else:
        assert out == ""


def test_options_arrive_in_internal_units(use: Setup) -> None:
    got: dict[str, object] = {}
    use(lambda **options: got.update(options))
    arguments = ["probe", "--diameter", "0.2in", "--start", "1cm,-2,3 mm", "--labels", "3,1,3"]
    assert cli.main(arguments) == 0
    assert got["diameter"] == pytest.approx(5.08)
    assert got["start"] == pytest.approx((10.0, -2.0, 3.0))
    assert got["labels"] == (3, 1)
    assert cli.main(["probe"]) == 0
    assert (got["diameter"], got["start"], got["labels"]) == (5.0, None, None)
    assert cli.main(["probe", "--diameter", "-5mm"]) == 0
    assert got["diameter"] == -5.0  # the legal range is the library's to judge


def test_json_is_one_object_of_plain_values(
    use: Setup, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    result = {
        "clearance_min_mm": np.float32(0.5),
        "worst": math.nan,
        "far": -np.inf,
        "where_mm": np.array([1.0, np.nan]),
        "steps": np.int64(3),
        "certified": np.bool_(False),
        "report": tmp_path,
        "stages": ({"name": "lecture é"}, None),
    }
    use(lambda as_json, **_: common.emit(result, as_json=as_json, text="for people"))
    assert cli.main(["probe", "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert json.loads(out) == {
        "clearance_min_mm": 0.5,
        "worst": None,
        "far": None,
        "where_mm": [1.0, None],
        "steps": 3,
        "certified": False,
        "report": str(tmp_path),
        "stages": [{"name": "lecture é"}, None],
    }
    assert cli.main(["probe"]) == 0
    assert capsys.readouterr().out == "for people\n"


def test_json_without_a_form_is_an_error_not_a_guess() -> None:
    with pytest.raises(TypeError, match="object has no JSON form"):
        common.clean_json({"x": [object()]})


@pytest.mark.parametrize(
    ("error", "kind"),
    [(GeometryError("open"), "GeometryError"), (ZeroDivisionError("oh"), "InternalError")],
)
def test_json_mode_gives_one_object_for_an_error_too(
    use: Setup, capsys: pytest.CaptureFixture[str], error: Exception, kind: str
) -> None:
    use(_raise(error))
    cli.main(["probe", "--json"])
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert found["error"]["type"] == kind
    assert found["error"]["message"] in err


def test_json_mode_never_gives_two_objects(use: Setup, capsys: pytest.CaptureFixture[str]) -> None:
    def emit_then_fail(as_json: bool, **_: object) -> None:
        common.emit({"steps": 1}, as_json=as_json, text="")
        raise OutputError("cannot write x: disk full")

    use(emit_then_fail)
    assert cli.main(["probe", "--json"]) == 2
    out, err = capsys.readouterr()
    assert json.loads(out) == {"steps": 1}
    assert "disk full" in err


def test_flags_after_a_double_dash_are_arguments(
    use: Setup, capsys: pytest.CaptureFixture[str]
) -> None:
    use(lambda **_: None)
    assert cli.main(["probe", "--", "--json"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "--json" in err


def test_reader_that_goes_away_is_no_traceback() -> None:
    code = (
        "import sys, click; from types import ModuleType; from bozzini.cli import main as cli\n"
        "module = ModuleType('probe')\n"
        "module.command = click.Command('probe', callback=lambda: click.echo('x' * 10**6))\n"
        "sys.modules['bozzini.cli.probe'] = module; cli.COMMANDS['probe'] = ''\n"
        "sys.exit(cli.main(['probe']))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    err = process.stderr.read()
    process.stderr.close()
    assert process.wait(timeout=60) == 141
    assert err == b""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX closes them")
@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", ">&- 2>&- <&-"])
def test_closed_streams_are_no_error(tmp_path: Path, closed: str) -> None:
    table = tmp_path / "curve.csv"
    words = f'"{sys.executable}" -m bozzini muscle curve --points 2 --out "{table}" --force'
    for more, code in (("", 0), (" --json", 0), (" --help", 0), (" --no-such", 2)):
        shell = ["sh", "-c", f"{words}{more} {closed}"]
        done = subprocess.run(shell, capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stderr
        assert "Traceback" not in done.stderr
        if code == 0 and more != " --help":
            # The file has its own content, not what was printed.
            assert table.read_text(encoding="utf-8").count(
                "\n"
            ) == 3 and "{" not in table.read_text(encoding="utf-8")
            table.unlink()


def test_a_path_that_the_system_refuses_is_one_line(
    use: Setup, capsys: pytest.CaptureFixture[str]
) -> None:
    use(_raise(PermissionError(13, "Permission denied", "/root/scans")))
    assert cli.main(["probe"]) == 2
    assert capsys.readouterr().err == "bozzini: error: /root/scans: Permission denied\n"


_WRITING = """
import sys, time, click
from types import ModuleType
from pathlib import Path
from bozzini.cli import main as cli
from bozzini.io.files import new_directory, reserve_directory
def work():
    click.get_current_context().with_resource(reserve_directory("deep/out"))
    with new_directory("deep/out") as place:
        (place / "report").write_text("half")
        print("begun", flush=True)
        time.sleep(100)
module = ModuleType("probe")
module.command = click.Command("probe", callback=work)
sys.modules["bozzini.cli.probe"] = module
cli.COMMANDS["probe"] = ""
sys.exit(cli.main(["probe"]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals are others there")
@pytest.mark.parametrize(
    ("number", "code", "words"),
    [
        (signal.SIGINT, 130, "bozzini: interrupted\n"),
        (signal.SIGTERM, -signal.SIGTERM, "bozzini: interrupted\n"),
        (signal.SIGHUP, -signal.SIGHUP, "bozzini: interrupted\n"),
    ],
)
def test_a_signal_leaves_nothing_half_written(
    tmp_path: Path, number: int, code: int, words: str
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", _WRITING],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None and process.stdout.readline() == "begun\n"
    assert len(list((tmp_path / "deep").iterdir())) == 2  # the lock and what is being written
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (code, words)
    assert list(tmp_path.iterdir()) == []


_CALLING_BACK = """
import ctypes, os, sys, time, click
from types import ModuleType
from bozzini.cli import main as cli
def work(number, fails):
    # As a compiler does: what is raised while C calls back is dropped by Python.
    back = ctypes.CFUNCTYPE(None)(lambda: (os.kill(os.getpid(), number), time.sleep(0.01)))
    back()
    if fails:
        raise RuntimeError("no code was made")
    time.sleep(60)
module = ModuleType("probe")
module.command = click.Command("probe", callback=lambda: work({number}, {fails}))
sys.modules["bozzini.cli.probe"] = module
cli.COMMANDS["probe"] = ""
sys.exit(cli.main(["probe"]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals are others there")
@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, -signal.SIGTERM)]
)
def test_a_signal_inside_a_callback_of_compiled_code_ends_the_run(
    number: int, code: int, fails: bool
) -> None:
    script = _CALLING_BACK.format(number=int(number), fails=fails)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=50
    )
    assert (done.returncode, done.stderr) == (code, "bozzini: interrupted\n")


_LOADING = """
import runpy, sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "bozzini.cli.common":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupting())
runpy.run_module("bozzini", run_name="__main__")
"""


def test_an_interruption_while_loading_is_one_line() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _LOADING], capture_output=True, text=True, timeout=50
    )
    assert (done.returncode, done.stderr) == (130, "bozzini: interrupted\n")


def test_signals_are_as_before_after_a_run(use: Setup) -> None:
    before = signal.getsignal(signal.SIGTERM)
    seen = []
    use(lambda **_: seen.append(signal.getsignal(signal.SIGTERM)))
    assert cli.main(["probe"]) == 0
    assert seen[0] is not before
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("arguments", [["data", "list"], ["data", "list", "--json"]])
def test_a_full_disk_under_stdout_is_one_line(arguments: list[str]) -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = subprocess.run(
            [sys.executable, "-m", "bozzini", *arguments],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
        )
    assert done.returncode == 2
    assert done.stderr == "bozzini: error: cannot write: No space left on device\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_an_error_in_json_on_a_full_disk_is_bad_input_too() -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = subprocess.run(
            [sys.executable, "-m", "bozzini", "certify", "nope.npz", "--json"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
        )
    assert done.returncode == 2
    assert done.stderr.splitlines()[1:] == ["bozzini: error: cannot write: No space left on device"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="names are no bytes there")
@pytest.mark.parametrize(
    "locale",
    [
        {"LC_ALL": "C.UTF-8"},
        {"LC_ALL": "C"},
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        {"PYTHONIOENCODING": "cp1252"},
    ],
    ids=lambda locale: ",".join(locale.values()),
)
def test_any_file_name_is_told_in_any_locale(tmp_path: Path, locale: dict[str, str]) -> None:
    name = b"\xff \xe6\x97\xa5 \xc3\xa9.csv"  # not UTF-8 as a whole
    for options in ([], ["--json"]):
        command = [sys.executable, "-m", "bozzini", "muscle", "fit", name, *options]
        done = subprocess.run(
            command, cwd=tmp_path, capture_output=True, timeout=120, env={**os.environ, **locale}
        )
        assert done.returncode == 2, done.stderr
        assert done.stderr.startswith(b"bozzini: error: ") and done.stderr.count(b"\n") == 1
        if options:
            found = json.loads(done.stdout)["error"]["message"]
            assert found.encode("utf-8", "surrogateescape").find(name) >= 0
        elif "PYTHONUTF8" not in locale and "PYTHONIOENCODING" not in locale:
            assert name in done.stderr


def test_python_dash_m_is_the_command() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "bozzini", "--version"], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout) == (0, f"bozzini {__version__}\n")


def _work(progress: Progress) -> None:
    for stage in ("reading", "planning"):
        for step in range(5):
            progress(stage, step / 4)


def test_progress_says_nothing_when_quiet_or_quick(capsys: pytest.CaptureFixture[str]) -> None:
    for quiet in (True, False):
        with common.progress_bar(quiet=quiet) as progress:
            _work(progress)
        assert capsys.readouterr() == ("", "")


def test_progress_in_a_log_is_whole_lines(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(common.LineProgress, "interval", 0.0)
    with common.progress_bar() as progress:
        _work(progress)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines()[0] == "bozzini: reading 0 %"
    assert err.splitlines()[-1] == "bozzini: planning 100 %"


def test_progress_on_a_terminal_is_a_bar_of_each_stage(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with common.progress_bar(delay=0.0) as progress:
        _work(progress)
    out, err = capsys.readouterr()
    assert out == ""
    assert "reading" in err
    assert "planning: 100%" in err
    assert "Traceback" not in err
