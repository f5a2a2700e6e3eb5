"""Building the firmware: sizes, sources, cache, missing tools, and the fuzz programs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from bozzini.io.files import find_cache
from bozzini.rig import PlantDesign
from bozzini.rig.board import NativeBoard
from bozzini.rig.firmware import ToolchainError, build, find_build_id, find_sources
from bozzini.rig.protocol import (
    FEEDFORWARD_COUNTS,
    PROTOCOL_VERSION,
    SETPOINT_MAX,
    Configuration,
    GetConfiguration,
)
from tests.rig.host import Host
from tests.rig.loops import CHAMBER

ROOT = Path(__file__).resolve().parents[2]


def copy_sources(target: Path) -> Path:
    shutil.copytree(find_sources(), target, ignore=shutil.ignore_patterns("build"))
    return target


def patch(sources: Path, file: str, old: str, new: str) -> None:
    """Replace a text that occurs once."""
    path = sources / file
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{file} holds {text.count(old)} times: {old}"
    path.write_text(text.replace(old, new), encoding="utf-8")


def test_program_is_small(toolchain):
    done = subprocess.run(
        ["avr-size", str(build("firmware.elf"))], capture_output=True, text=True, check=True
    )
    text, data, bss = map(int, done.stdout.splitlines()[1].split()[:3])
    assert text + data < 16 * 1024  # [B] of flash
    assert data + bss < 2 * 1024  # [B] of memory


@pytest.mark.slow
def test_everything_builds_without_a_warning(toolchain, tmp_path):
    sources = copy_sources(tmp_path / "firmware")
    targets = ["avr", "avr-test", "native", "emulator", "fuzz"]
    done = subprocess.run(["make", "-C", sources, *targets], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stderr


def test_board_reports_what_it_was_built_from(ordinary_board):
    host = Host(ordinary_board)
    host.run(20)
    host.ask(GetConfiguration())
    configuration = next(frame for frame in host.frames if isinstance(frame, Configuration))
    assert configuration.build_id == find_build_id()
    assert configuration.version == PROTOCOL_VERSION
    assert not configuration.is_test_build
    assert configuration.setpoint_max < configuration.overpressure
    assert configuration.host_timeout == pytest.approx(0.1)
    assert configuration.setpoint_max == pytest.approx(SETPOINT_MAX)
    assert configuration.pwm_counts == FEEDFORWARD_COUNTS
    # The controller's constants follow from those of the plant.
    design = PlantDesign()
    assert configuration.sensor_span == pytest.approx(design.sensor_range)
    volume = design.line_volume + CHAMBER.volume.mean()
    for time, share, valve in (
        (configuration.fill_time, 2.0 / 3.0, design.fill_valve),
        (configuration.bleed_time, 0.5, design.bleed_valve),
    ):
        assert time == pytest.approx(share * valve.time_constant(volume), rel=0.03)
    jump = configuration.jump / configuration.pwm_counts
    half_play = 0.5 * design.valve_hysteresis
    assert design.valve_dead_zone < jump < design.valve_dead_zone + half_play


def test_changed_sources_are_built_anew(toolchain, tmp_path):
    sources = copy_sources(tmp_path / "firmware")
    assert build("native.so", sources) == build("native.so")
    patch(sources, "src/config.h", "#define BZ_TELEMETRY_TICKS 2u", "#define BZ_TELEMETRY_TICKS 5u")
    assert build("native.so", sources) != build("native.so")
    assert find_build_id(sources) != find_build_id()
    with NativeBoard(sources=sources) as board:
        host = Host(board)
        host.run(100)
        assert len(host.list_telemetry()) < 25


def test_error_of_the_compiler_is_passed_on(toolchain, tmp_path):
    sources = copy_sources(tmp_path / "firmware")
    patch(sources, "src/config.h", "#define BZ_TICK_HZ 1000u", "#define BZ_TICK_HZ oops")
    with pytest.raises(ToolchainError, match="native.so does not build: .*oops.* undeclared"):
        build("native.so", sources)


def test_missing_tool_is_named_with_its_package(tmp_path):
    code = "from bozzini.rig.firmware import build; build('emulator.so')"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
    )
    last = done.stderr.splitlines()[-1]
    assert "ToolchainError: building emulator.so needs make, cc, simavr/sim_avr.h" in last
    assert "apt-get install make gcc libsimavr-dev libelf-dev" in last


def test_cache_that_cannot_be_written_is_replaced(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert find_cache("firmware") == tmp_path / "bozzini" / "firmware"
    (tmp_path / "file").write_text("no directory")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    other = find_cache("firmware")
    assert other.is_dir()
    assert tmp_path not in other.parents
    assert other.stat().st_mode & 0o022 == 0


@pytest.mark.slow
def test_processes_build_the_same_at_once(toolchain, tmp_path):
    code = "from bozzini.rig.firmware import build; print(build('native.so'))"

    def run(_):
        return subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "XDG_CACHE_HOME": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()

    with ThreadPoolExecutor(2) as pool:
        (path,) = set(pool.map(run, range(2)))
    assert [file.name for file in Path(path).parent.iterdir()] == ["native.so"]


@pytest.mark.slow
def test_random_bytes_harm_nothing(toolchain):
    """1e8 bytes under the address and undefined-behaviour sanitizers."""
    done = subprocess.run([build("fuzz-parser"), "100000000", "7"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    words = done.stdout.split()
    counts = dict(zip(words[::2], map(int, words[1::2]), strict=True))
    assert counts["bytes"] >= 100_000_000
    assert counts["accepted_random"] == 0
    assert counts["accepted_frames"] > 100_000


@pytest.mark.slow
def test_random_measurements_and_commands_break_no_rule(toolchain):
    """2e7 ticks: what `fuzz/control.c` lists holds after each."""
    done = subprocess.run([build("fuzz-control"), "20000000", "7"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    words = done.stdout.split()
    counts = dict(zip(words[::2], map(int, words[1::2]), strict=True))
    assert counts["armed"] > 1_000_000
    assert counts["faults"] > 1_000


@pytest.mark.slow
def test_wheel_holds_the_sources(tmp_path):
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    prefix = "bozzini/rig/firmware/"
    with zipfile.ZipFile(wheel) as archive:
        held = {name.removeprefix(prefix) for name in archive.namelist() if prefix in name}
    files = {
        path.relative_to(find_sources()).as_posix()
        for path in find_sources().rglob("*")
        if path.is_file() and "build" not in path.relative_to(find_sources()).parts
    }
    assert held == files
