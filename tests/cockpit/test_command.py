"""``bozzini cockpit`` as a process: ready, in use, interrupted, and with its operator."""

from __future__ import annotations

import csv
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from websockets.sync.client import connect

from bozzini.cli.main import main
from bozzini.rig.firmware import find_missing_tools

READY = 15.0
"""Three times what a computer with nothing else to do may take [s]."""
GONE = 6.0
"""As `READY`, after an interrupt [s]."""


@contextmanager
def start(*arguments: str) -> Iterator[subprocess.Popen]:
    command = [sys.executable, "-m", "bozzini", "cockpit", "--no-browser", *arguments]
    with subprocess.Popen(command, stdout=-1, stderr=-1, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("is_compiled", [True, False])
def test_ready_soon_and_gone_soon_with_two_windows(is_compiled, tmp_path, monkeypatch) -> None:
    if not is_compiled:  # the drive and the plan are still being compiled at the end
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    begin = time.monotonic()
    with start("--port", "0") as process:
        address = process.stdout.readline().strip()
        assert time.monotonic() - begin < READY
        host = address.removeprefix("http://").rstrip("/")
        with connect(f"ws://{host}/ws", origin=f"http://{host}") as one:
            with connect(f"ws://{host}/ws", origin=f"http://{host}") as other:
                for window in (one, other):
                    assert window.recv(timeout=10)
                begin = time.monotonic()
                process.send_signal(signal.SIGINT)
                assert process.wait(20) == 0
                assert time.monotonic() - begin < GONE
        assert process.stderr.read() == ""


def test_port_in_use_is_one_line(capsys) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["cockpit", "--port", str(port), "--no-browser"]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    assert f"port is {port}" in err and "--port" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--port", "70000"), "70000"),
        (("--host", "no.such.host.invalid"), "no.such.host.invalid"),
        (("--host", "192.0.2.1"), "192.0.2.1"),
        (("--rig", "usb"), "demo, or serial"),
        (("--controller", "predictive"), "--controller has no effect without --rig"),
        (("--operator", "square"), "square"),
        (("--moving", "none.npz"), "breathing, peristalsis"),
        (("none.stl",), "no such file"),
        (("--labels", "1"), "--labels has no effect"),
        (("--out", "a.html"), "--out has no effect"),
        (("--operator", "line", "--out", "a.txt"), "must end in"),
        (("--diameter", "0mm"), "diameter is 0"),
    ],
)
def test_bad_input_is_one_line(capsys, tmp_path, monkeypatch, arguments, words) -> None:
    monkeypatch.chdir(tmp_path)
    given = arguments if "--port" in arguments else (*arguments, "--port", "0")
    assert main(["cockpit", "--no-browser", *given]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("bozzini: error: ") and err.count("\n") == 1
    assert words in err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [(("--effector", "none"), "none"), (("--rig", "serial:/dev/none"), "/dev/none")],
)
def test_drive_that_cannot_be_had_ends_it_with_one_line(arguments, words) -> None:
    with start("--port", "0", *arguments) as process:
        assert process.wait(60) == 2
        err = process.stderr.read()
    assert err.count("\n") == 1 and words in err


@pytest.mark.slow
def test_operator_draws_through_the_socket_with_the_rig(tmp_path) -> None:
    if missing := find_missing_tools():
        pytest.skip(f"no {', '.join(missing)}")
    table, page = tmp_path / "circle.csv", tmp_path / "line.html"
    common = ("--port", "0", "--rig", "demo", "--board", "native", "--json")
    with start(*common, "--operator", "circle", "--out", str(table)) as process:
        out, err = process.communicate(timeout=90)
    found = json.loads(out)
    assert process.returncode == 0 and found["converged"], err
    assert "token=" in err
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert found["samples"] == len(rows) > 400
    # The operator's way, told again from the table: the radius is kept, once round.
    tips = [(float(row["tip_x_mm"]), float(row["tip_y_mm"])) for row in rows]
    radii = [(x * x + y * y) ** 0.5 for x, y in tips]
    assert max(abs(radius - found["size_mm"]) for radius in radii) == pytest.approx(
        found["off_path_max_mm"], abs=1e-6
    )
    assert found["error_rms_mm"] < 0.1 * found["size_mm"]
    assert min(x for x, _ in tips) < -0.9 * found["size_mm"]
    assert float(rows[0]["time_s"]) == 0.0
    with start(*common[2:], "--port", "0", "--operator", "line", "--out", str(page)) as process:
        out, _ = process.communicate(timeout=90)
    assert process.returncode == 0
    text = page.read_text(encoding="utf-8")
    assert "by the emulated rig: " in text
    assert (
        "data:image/png" in text
        and "off path rms mm" in text
        and "http" not in text.split("<h1>")[1]
    )


def test_lacking_extra_is_named_in_one_line(tmp_path) -> None:
    (tmp_path / "starlette.py").write_text("raise ImportError(name='starlette')")
    known = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    command = [sys.executable, "-m", "bozzini", "cockpit", "--port", "0", "--no-browser"]
    found = subprocess.run(command, env=known, capture_output=True, text=True, timeout=60)
    assert found.returncode == 2 and found.stderr.count("\n") == 1
    assert "bozzini[cockpit]" in found.stderr


def test_package_and_help_load_none_of_it() -> None:
    code = (
        "import sys, bozzini; from bozzini.cli.main import main; main(['--help']);"
        "main(['cockpit', '--help']);"
        "names = {'starlette', 'uvicorn', 'websockets', 'bozzini.cockpit'};"
        "print(sorted(names & set(sys.modules)), file=sys.stderr)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert found.stderr.strip() == "[]"
