"""``bozzini doctor``: what it states is what is there."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import pytest

import bozzini
from bozzini.cli import doctor
from bozzini.cli.main import main
from bozzini.io import files
from bozzini.rig import firmware

REQUIRES = ["numpy>=1.26", "PyYAML>=6.0", "SimpleITK>=2.4; extra == 'ct'", "x_y[z]<2; extra == 'a'"]


def _ask(capsys: pytest.CaptureFixture[str], code: int = 0) -> dict[str, object]:
    assert main(["doctor", "--json"]) == code
    found = json.loads(capsys.readouterr().out)
    assert isinstance(found, dict)
    return found


def test_it_states_what_is_here(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    found = _ask(capsys)
    assert found["bozzini"] == bozzini.__version__
    assert str(found["python"]).startswith(platform.python_version())
    assert found["cores"] == os.cpu_count()
    assert found["environment"]["NUMBA_NUM_THREADS"] == "1"  # type: ignore[index]
    assert found["packages"]["numpy"] == metadata.version("numpy")  # type: ignore[index]
    assert main(["doctor"]) == 0
    text = capsys.readouterr().out
    assert all(line in text for line in (f"Bozzini {bozzini.__version__}", "NUMBA_NUM_THREADS=1"))


def test_requirements_are_sorted_by_their_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metadata, "requires", lambda _: [*REQUIRES, "ruff; extra == 'dev'"])
    assert doctor.list_requirements() == {
        "": ["numpy", "PyYAML"],
        "ct": ["SimpleITK"],
        "a": ["x_y"],
    }


def _lose(name: str) -> Callable[[str], str]:
    find = metadata.version

    def version(package: str) -> str:
        if package == name:
            raise metadata.PackageNotFoundError(name)
        return find(package)

    return version


def test_a_missing_extra_is_named_with_what_brings_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(metadata, "requires", lambda _: REQUIRES[:3])
    monkeypatch.setattr(metadata, "version", _lose("SimpleITK"))
    assert main(["doctor"]) == 0
    assert "extra ct: SimpleITK missing  (pip install 'bozzini[ct]')" in capsys.readouterr().out


def test_a_missing_package_of_the_core_is_exit_code_1(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(metadata, "requires", lambda _: REQUIRES[:2])
    monkeypatch.setattr(metadata, "version", _lose("PyYAML"))
    assert _ask(capsys, code=1)["packages"]["PyYAML"] is None  # type: ignore[index]


def test_what_cannot_be_loaded_is_a_fault_and_no_traceback() -> None:
    code = "import sys; sys.modules['numba'] = None; from bozzini.cli.main import main"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}; sys.exit(main(['doctor']))"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (1, "")
    assert "bozzini.scene.film fails: ModuleNotFoundError" in done.stdout
    assert f"numba {metadata.version('numba')}" in done.stdout  # there, and yet not loaded


def test_the_place_of_compiled_code_is_one_that_can_be_written(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    assert _ask(capsys)["compiled_code"] == str(tmp_path / "cache")
    monkeypatch.setattr(files, "find_compiled_code", lambda: None)
    assert _ask(capsys, code=1)["compiled_code"] is None
    assert main(["doctor"]) == 1
    assert "set NUMBA_CACHE_DIR" in capsys.readouterr().out


def test_the_name_of_the_home_directory_is_not_shown(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    assert _ask(capsys)["compiled_code"] == "~/cache"


def test_programs_that_are_not_there_are_null(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(firmware, "find_missing_tools", lambda: {"avr-gcc": "gcc-avr"})
    found = _ask(capsys)
    assert set(found["programs"].values()) == {None}  # type: ignore[attr-defined]
    tool = tmp_path / "ffmpeg"
    tool.write_text(f"#!{sys.executable}\n")
    tool.chmod(0o755)
    assert _ask(capsys)["programs"]["ffmpeg"] == str(tool)  # type: ignore[index]
    assert main(["doctor"]) == 0
    assert "lacks avr-gcc (apt-get install gcc-avr)" in capsys.readouterr().out
