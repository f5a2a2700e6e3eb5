"""Jobs of routings and of motions with contact, angles as factors, jobs of other packages."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from bozzini.continuum import ContinuumRobot, RobotDesign, Section
from bozzini.continuum.routing import RoutingLimits
from bozzini.io.records import read_record
from bozzini.motion.routing import design_routing
from bozzini.study import JOBS, Study, StudySpec, read_rows, run_study
from bozzini.study.jobs import plan_row
from tests.study.test_insertion_map import write_tube
from tests.study.test_sweep_rows import SERIAL

ROOT = Path(__file__).resolve().parents[2]
MODULE = """
from bozzini.checks import Quantity
from bozzini.errors import InputError
from bozzini.study import RowJob

class Spring(RowJob):
    name = "spring"

    @classmethod
    def list_inputs(cls, names):
        return {"load": Quantity(kind="force", low=0.0, label="load"),
                "tilt": Quantity(kind="angle", label="tilt"), "rate": Quantity(low=0.1)}

    @property
    def outputs(self):
        return {"stretch": "mm"}

    def measure(self, row):
        if row["tilt"] > 1.0:
            raise InputError("too steep")
        return {"stretch": row["load"] / row["rate"]}
"""


def install(folder: Path, **places: str) -> None:
    """Write the metadata of a package with jobs, as an installer does."""
    about = folder / "foreign_package-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: foreign-package\nVersion: 1.0\n")
    lines = [f"{name} = {place}" for name, place in places.items()]
    (about / "entry_points.txt").write_text("\n".join(["[bozzini.studies]", *lines]) + "\n")


def make_study(base: Path, **given: Any) -> Study:
    plain = {"format": "bozzini-study-1", "sampling": {"method": "grid"}} | given
    return Study(read_record(plain, StudySpec), base)


@pytest.mark.slow(20)
def test_a_job_of_an_installed_package(tmp_path: Path) -> None:
    (tmp_path / "foreign.py").write_text(MODULE)
    install(tmp_path, spring="foreign:Spring")
    study = {
        "format": "bozzini-study-1",
        "job": "spring",
        "fixed": {"rate": 2},
        "factors": {
            "load": {"values": ["1 N", "3 N"]},
            "tilt": {"values": ["36 deg", "90 deg"]},
        },
        "sampling": {"method": "grid"},
        "chunk": 1,
    }
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(study))
    places = [str(tmp_path), str(ROOT / "src"), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]

    def run(*words: str) -> str:
        return subprocess.run(
            [sys.executable, "-m", "bozzini", "study", *words],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(places)},
            check=True,
            capture_output=True,
            text=True,
            timeout=120,
        ).stdout

    assert "foreign:Spring" in run("jobs")
    run("run", "study.yaml", "--workers", "2", "--out", "out")
    rows = read_rows(tmp_path / "out")
    assert rows["tilt_rad"].to_numpy() == pytest.approx(np.radians([36.0, 90.0, 36.0, 90.0]))
    assert rows["stretch_mm"].to_numpy()[[0, 2]] == pytest.approx([0.5, 1.5])
    assert rows["reason"].tolist() == ["", "too steep"] * 2
    (tmp_path / "foreign.py").write_text(MODULE.replace("> 1.0", "> 2.0"))
    with pytest.raises(subprocess.CalledProcessError) as caught:  # the rows would be mixed
        run("resume", "out")
    assert caught.value.returncode == 2 and "cannot be resumed" in caught.value.stderr


def test_angles_of_tendons_are_factors(tmp_path: Path) -> None:
    robot = ROOT / "examples" / "two_sections.yaml"
    study = make_study(
        robot.parent,
        job="robot-sections",
        fixed={"robot": robot.name, "displacement.T1": "2 mm"},
        factors={"sections.1.tendons.1.angle": {"values": ["0 deg", "36 deg"]}},
    )
    rows = run_study(study, tmp_path / "out", engine=SERIAL).read()
    assert rows["reason"].tolist() == ["", ""]
    assert rows["sections.1.tendons.1.angle_rad"].to_numpy() == pytest.approx([0.0, 0.2 * np.pi])
    plain = ContinuumRobot.from_yaml(robot).to_dict()
    plain["sections"][0]["tendons"][0]["angle"] = 0.2 * np.pi
    tip = ContinuumRobot.from_dict(plain).forward({"T1": 2.0}).tip
    assert rows.loc[1, ["tip_x_mm", "tip_y_mm", "tip_z_mm"]].to_numpy(float) == pytest.approx(tip)


@pytest.mark.slow(20)
def test_routings_are_those_of_the_design(tmp_path: Path) -> None:
    write_tube(tmp_path / "tube.nii.gz", 6.0)
    fixed = {"tract": "tube.nii.gz", "organ": "colon", "diameter": "5 mm", "link_length": "6 mm"}
    study = make_study(
        tmp_path,
        job="routing",
        fixed=fixed,
        factors={"offset_max": {"values": ["1.5 mm", "2 mm", "9 mm"]}},
    )
    rows = run_study(study, tmp_path / "out", engine=SERIAL).read()
    assert rows["code"].tolist() == [0, 0, 1] and "offset max" in rows["reason"][2]
    made = plan_row(study.fixed)
    plan = made.plan
    section = Section(length=1.0, radius=2.5, bending_stiffness=200.0)
    for row, offset in zip(rows.to_dict("records"), (1.5, 2.0), strict=False):
        found = design_routing(
            plan,
            limits=RoutingLimits(offset_max=offset),
            robot=RobotDesign((section,)),
            duct=made.duct,
        )
        assert row["error_max_mm"] == pytest.approx(found.error_max, rel=1e-6)
        assert row["tension_sum_N"] == pytest.approx(found.tensions.sum(), rel=1e-6)
        assert row["clearance_mm"] == pytest.approx(found.clearance, rel=1e-6)
    # What bends the same backbone is a moment: tension goes down as the offset goes up.
    assert rows["tension_sum_N"][1] < rows["tension_sum_N"][0]


@pytest.mark.slow(30)
def test_motions_with_contact(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco")
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    place = stated["entry-points"]["bozzini.studies"]["execution"]
    if "execution" not in JOBS:  # installed before it was stated
        install(tmp_path, execution=place)
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(JOBS.__dict__, "plugins", raising=False)
    write_tube(tmp_path / "tube.nii.gz", 6.0)
    fixed = {
        **{"tract": "tube.nii.gz", "organ": "colon", "diameter": "5 mm", "link_length": "6 mm"},
        **{"speed": "200 mm/s", "step": "4 ms"},
    }
    study = make_study(
        tmp_path,
        job="execution",
        fixed=fixed,
        factors={
            "drive": {"values": ["plan", "tractrix", "tendons"]},
            "stiffness": {"values": ["0.3 N/mm", "3 N/mm"]},
        },
    )
    rows = run_study(study, tmp_path / "out", engine=SERIAL).read()
    assert rows["code"].tolist() == [0, 0, 0, 0, 1, 1]
    plan, dragged = rows[rows["drive"] == "plan"], rows[rows["drive"] == "tractrix"]
    assert (plan["complete"] == 1.0).all()
    # A chain that is dragged cuts the bend: it presses on the wall more than the planned one.
    assert (dragged["normal_peak_N"].to_numpy() > plan["normal_peak_N"].to_numpy()).all()
    assert "no motion of a tendon robot" in rows["reason"][4]
    monkeypatch.undo()
    JOBS.__dict__.pop("plugins", None)
