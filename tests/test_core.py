"""The core works without the packages that only an extra brings."""

from __future__ import annotations

import csv
import subprocess
import sys
from pathlib import Path

import pytest

LOST = ("pandas", "pyarrow", "skimage", "networkx")
RUN = f"""
import sys
sys.modules |= dict.fromkeys({LOST})
from bozzini.cli.main import main
for line in sys.argv[1:]:
    code = main(line.split())
    assert code < 2, (line, code)  # 1 is an honest negative answer
"""
FRAME = f"""
import sys
sys.modules |= dict.fromkeys({LOST})
from dataclasses import dataclass
from bozzini.errors import MissingExtraError
from bozzini.muscle import Measurements
from bozzini.results import ClosedForm
@dataclass
class Answer(ClosedForm):
    area: float = 1.0
assert Answer()._repr_html_() is None
for item in (Measurements(pressure=[0.1, 0.2], contraction=[1.0, 2.0]), Answer()):
    try:
        item.to_frame()
    except MissingExtraError as error:
        print(error)
"""
DATA = """pressure [kPa],contraction [mm],load [N],direction
100,1.0,0,inflating
200,2.6,0,inflating
300,4.0,0,inflating
400,5.1,0,inflating
300,4.4,0,deflating
200,3.0,0,deflating
100,1.4,0,deflating
"""


def _run(code: str, *words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=280, cwd=cwd
    )
    assert done.returncode == 0, done.stderr
    return done


@pytest.mark.slow
def test_commands_of_the_core_need_none_of_them(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text(DATA)
    _run(
        RUN,
        "muscle export --model energy --points 3 --out forces.csv",
        "effector pose --pressure R=0.4MPa",
        "effector sweep --vary offset=3mm,4mm --out sweep.png",
        "effector sweep --vary offset=3mm,4mm",
        "phantom --voxel 4mm --out phantom.stl",
        "vision --help",
        cwd=tmp_path,
    )
    with (tmp_path / "forces.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 9
    assert {"phantom.stl", "sweep.png"} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.slow
def test_long_commands_of_the_core_need_none_of_them(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text(DATA)
    _run(
        RUN,
        "demo --voxel 4mm --diameter 5mm --out demo",
        "muscle fit data.csv --mean --out fit.yaml",
        "muscle predict fit.yaml data.csv",
        "rig run --duration 0.5s --out log.csv",
        "rig replay log.csv",
        cwd=tmp_path,
    )


def test_a_table_of_pandas_names_the_extra(tmp_path: Path) -> None:
    line = (
        "this needs the package 'pandas', which is not installed: pip install 'bozzini[tables]'\n"
    )
    assert _run(FRAME, cwd=tmp_path).stdout == 2 * line
