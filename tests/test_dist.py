"""Wheel and source archive hold the same, and run where there is nothing but what they need."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
BUILD = [sys.executable, "-m", "hatchling", "build"]


def _run(*command: object, **options: object) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [*map(str, command)],
        capture_output=True,
        text=True,
        timeout=900,
        **options,  # type: ignore[call-overload]
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return the wheel and the source archive of this checkout."""
    place = tmp_path_factory.mktemp("dist")
    _run(*BUILD, "-d", place, cwd=ROOT)
    (wheel,), (source,) = place.glob("*.whl"), place.glob("*.tar.gz")
    return wheel, source


def _read(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.mark.slow
def test_the_source_archive_builds_the_same_wheel(
    archives: tuple[Path, Path], tmp_path: Path
) -> None:
    wheel, source = archives
    with tarfile.open(source) as archive:
        archive.extractall(tmp_path, filter="data")
    (folder,) = tmp_path.iterdir()
    _run(*BUILD, "-t", "wheel", "-d", tmp_path / "again", cwd=folder)
    (again,) = (tmp_path / "again").glob("*.whl")
    assert _read(again) == _read(wheel)


def test_the_wheel_holds_all_that_the_package_reads(archives: tuple[Path, Path]) -> None:
    names = set(_read(archives[0]))
    package = ROOT / "src" / "bozzini"
    for path in package.rglob("*"):
        if path.is_file() and "__pycache__" not in path.parts:
            assert f"bozzini/{path.relative_to(package).as_posix()}" in names
    assert "bozzini/rig/firmware/Makefile" in names
    assert not [
        name for name in names if name.startswith(("tests", "validation")) or "__pycache__" in name
    ]


def _list_needed(names: list[str]) -> set[metadata.Distribution]:
    """Return the installed distributions that some need, and those that these need."""
    found: dict[str, metadata.Distribution] = {}
    while names:
        line = names.pop()
        name = re.split(r"[^\w.-]", line, maxsplit=1)[0].lower().replace("_", "-")
        if "extra ==" in line or name in found:
            continue
        try:
            found[name] = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            if ";" in line:  # of other systems or versions of Python
                continue
            raise
        names += found[name].requires or []
    return set(found.values())


@pytest.fixture(scope="module")
def bare(archives: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the Python of an environment that holds the wheel and what its core needs, no more.

    What it needs is linked from this environment, so that nothing is fetched; pip checks that it
    is what the wheel asks for.
    """
    wheel, _ = archives
    place = tmp_path_factory.mktemp("bare") / "venv"
    _run(sys.executable, "-m", "venv", "--without-pip", place)
    python = place / "bin" / "python"
    site = Path(sysconfig.get_path("purelib", "venv", {"base": str(place), "platbase": str(place)}))
    stated = re.search(r"^(?:.*\n)+?\n", _read(wheel)[_find_metadata(wheel)].decode())
    assert stated is not None
    needs = re.findall(r"^Requires-Dist: (.*)$", stated[0], re.M)
    for package in _list_needed(needs):
        for file in package.files or []:
            if ".." in file.parts:
                continue
            (site / file).parent.mkdir(parents=True, exist_ok=True)
            (site / file).symlink_to(str(file.locate()))
    options = ["--no-index", "--quiet", "--disable-pip-version-check"]
    _run(sys.executable, "-m", "pip", "--python", python, "install", *options, wheel)
    return python


def _find_metadata(wheel: Path) -> str:
    return next(name for name in _read(wheel) if name.endswith(".dist-info/METADATA"))


@pytest.mark.slow(120)
def test_the_demo_runs_in_a_bare_environment(bare: Path, tmp_path: Path) -> None:
    outside = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    program = bare.with_name("bozzini")
    done = _run(program, "demo", "--voxel", "3mm", "--out", "demo", cwd=tmp_path, env=outside)
    assert "proved" in done.stdout
    assert {"report.html", "plan.npz", "summary.json"} <= {
        path.name for path in (tmp_path / "demo").iterdir()
    }
    told = _run(program, "doctor", cwd=tmp_path, env=outside).stdout
    assert str(bare.parent.parent) in told
    assert "simpleitk missing  (pip install 'bozzini[ct]')" in told.lower()
    assert "missing" not in re.search(r"^packages: .*$", told, re.M)[0]  # type: ignore[index]
