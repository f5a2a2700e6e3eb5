"""A command whose extra is not installed says so in one line, and writes nothing."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from bozzini.cli.main import main
from tests.plot.fake_motion import make_plan

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
CORE: list[str] = PROJECT["dependencies"]
EXTRAS: dict[str, list[str]] = PROJECT["optional-dependencies"]
OFFERED = set(EXTRAS) - {"dev", "docs"}

COMMANDS = {
    # The module that is not there, and a command that needs it.
    "cad": [("OCP", "effector fabricate --step --out parts")],
    "cockpit": [("websockets", "cockpit")],
    "ct": [("SimpleITK", "plan series"), ("highdicom", "plan segments.dcm")],
    "film": [("imageio_ffmpeg", "record plan.npz --out film.mp4")],
    "igtl": [("pyigtl", "plan tract.stl --igtl 18944")],
    "mcap": [("mcap_ros2", "continuum simulate study.yaml plan.npz --out motion.mcap")],
    "physics": [("mujoco", "execute plan.npz tract.stl")],
    "rig": [
        ("serial", "rig run --port /dev/ttyNone --duration 0.1s"),
        ("pygame", "rig run --board native --stick gamepad --duration 0.1s"),
    ],
    "sweeps": [
        ("pandas", "study run study.yaml --out results"),
        ("pyarrow", "study run study.yaml --out results"),
        ("distributed", "study run study.yaml --cluster local --out results"),
        ("pymoo", "study run nsga2.yaml --out results"),
        ("optuna", "study run tpe.yaml --out results"),
    ],
    "tables": [
        ("pandas", "muscle export --model energy --out table.parquet"),
        ("pyarrow", "muscle export --model energy --out table.parquet"),
    ],
    "vision": [("cv2", "vision board charuco --out board.pdf")],
}
PACKAGES = {
    "OCP": "cadquery-ocp-novtk",
    "imageio_ffmpeg": "imageio-ffmpeg",
    "mcap_ros2": "mcap-ros2-support",
    "serial": "pyserial",
    "pygame": "pygame-ce",
    "cv2": "opencv-python-headless",
}
"""Of modules that are called otherwise than their distribution."""

WITHOUT = """
import sys
sys.modules[sys.argv[1]] = None
from bozzini.cli.main import main
sys.exit(main(sys.argv[2:]))
"""


def _name(requirement: str) -> str:
    return re.split(r"[<>=\[ ]", requirement)[0]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a directory with the files that the commands name."""
    monkeypatch.chdir(tmp_path)
    make_plan().save(tmp_path / "plan.npz")
    (tmp_path / "series").mkdir()
    (tmp_path / "series" / "1.dcm").write_bytes(bytes(128) + b"DICM")
    segmentation = bytes(128) + b"DICM 1.2.840.10008.5.1.4.1.1.66.4"
    (tmp_path / "segments.dcm").write_bytes(segmentation)
    (tmp_path / "tract.stl").write_text("solid\n")
    assert main(["new", "study"]) == 0
    text = (tmp_path / "study.yaml").read_text("utf-8").partition("sampling:")[0]
    for method, aims in (("nsga2", "[needed_pressure, area]"), ("tpe", "[needed_pressure]")):
        search = f"search: {{minimise: {aims}, method: {method}, evaluations: 20}}\n"
        (tmp_path / f"{method}.yaml").write_text(text + search)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("extra", "module", "line"),
    [(extra, *case) for extra, cases in COMMANDS.items() for case in cases],
)
def test_a_missing_extra_is_one_line_that_names_it(
    extra: str, module: str, line: str, folder: Path
) -> None:
    before = sorted(folder.rglob("*"))
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, module, *line.split()],
        capture_output=True,
        text=True,
        timeout=200,
        cwd=folder,
    )
    package = PACKAGES.get(module, module)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr == (
        f"bozzini: error: this needs the package '{package}', which is not installed: "
        f"pip install 'bozzini[{extra}]'\n"
    )
    assert package in map(_name, EXTRAS[extra])
    assert sorted(folder.rglob("*")) == before


def test_every_extra_has_such_a_command() -> None:
    assert set(COMMANDS) == OFFERED - {"all"}


def test_all_is_all_of_them() -> None:
    (requirement,) = EXTRAS["all"]
    assert set(re.findall(r"\w+", requirement)) - {"bozzini"} == OFFERED - {"all"}


def test_the_page_of_installation_lists_every_extra() -> None:
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    table = page.partition("## Extras")[2].partition("\n## ")[0]
    assert set(re.findall(r"`(\w+)`", "".join(re.findall(r"^\| .*? \|", table, re.M)))) == set(
        EXTRAS
    )


@pytest.mark.parametrize("extra", sorted(OFFERED - {"all"}))
def test_the_tests_run_with_every_extra(extra: str) -> None:
    assert set(EXTRAS[extra]) <= set(EXTRAS["dev"])
