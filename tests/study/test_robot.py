"""The main job with a tendon robot: its time table, its proof, its place in the summary."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bozzini.continuum import ContinuumRobot
from bozzini.motion import FreeSpace, Introducer, Scope
from bozzini.motion.actuate.actuation import Actuation
from bozzini.motion.actuate.executed import certify_arcs
from bozzini.motion.plan import read_record
from bozzini.study import InsertionOptions, InsertionStudy, run_insertion
from tests.motion.actuate.motions import make_robot
from tests.study.test_insertion import END, START, make_labels

SCOPE = Scope(diameter=5.0, link_length=8.0)
ROBOT_FILES = {"tendons.csv", "tendons.parquet", "robot.npz", "robot.png"}


def run(*, robot: ContinuumRobot, scope: Scope = SCOPE, **options: object) -> InsertionStudy:
    given = InsertionOptions(start=START, end=END, head_step=1.0, **options)
    return run_insertion(make_labels(), scope, options=given, robot=robot)


@pytest.fixture(scope="module")
def study() -> InsertionStudy:
    return run(robot=make_robot(15.0, 6, radius=2.5))


def test_a_robot_goes_the_planned_way(study: InsertionStudy) -> None:
    assert study.robot is not None and study.fits and study.robot.fits
    assert np.array_equal(study.robot.head_arc_length, study.plan.head_arc_length)
    assert study.seconds["robot"] > 0.0


def test_everything_of_the_robot_is_written(study: InsertionStudy, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    summary = study.write(tmp_path / "out")
    assert ROBOT_FILES <= {path.name for path in (tmp_path / "out").iterdir()}
    assert json.loads((tmp_path / "out" / "summary.json").read_text("utf-8")) == summary
    again = Actuation.load(tmp_path / "out" / "robot.npz")
    assert summary["robot"] == again.to_dict()
    header = (tmp_path / "out" / "tendons.csv").read_text("utf-8").splitlines()[0]
    assert header.startswith("step,head_arc_length_mm,base_advance_mm,s0a_mm")


def test_without_parquet_there_is_csv(
    study: InsertionStudy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bozzini.study.insertion.has_parquet", lambda: False)
    study.write(tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert "tendons.csv" in names and "tendons.parquet" not in names


@pytest.mark.slow
def test_a_robot_that_does_not_get_there_is_a_finding(tmp_path: Path) -> None:
    short = run(robot=make_robot(15.0, 3, radius=2.5))
    assert short.plan.status == "complete" and short.plan.certified
    assert not short.fits and not short.to_dict()["fits"]
    (finding,) = (item for item in short.findings if item.code == "robot")
    assert finding.severity == "warning" and "more section(s)" in finding.message
    summary = short.write(tmp_path / "out")
    assert summary["robot"]["reason_code"] == "ROBOT_TOO_SHORT"
    assert "more section(s)" in (tmp_path / "out" / "report.html").read_text("utf-8")


@pytest.mark.slow
def test_a_wall_that_gives_way_gives_way_to_the_robot_too() -> None:
    thick = Scope(diameter=15.0, link_length=8.0)
    robot = make_robot(15.0, 6, radius=7.0)
    assert not run(robot=robot, scope=thick).fits
    soft = run(robot=robot, scope=thick, soft_wall=6.0)
    assert soft.robot is not None and soft.robot.fits
    moved = soft.robot
    used = soft.plan.soft_wall.used
    # At rest the lumen offers the introducer that much less, too.
    introducer = read_record(Introducer, moved.meta["introducer"], "introducer")
    rest = certify_arcs(
        robot,
        moved.bends,
        moved.base_advance,
        FreeSpace(soft.field, introducer=replace(introducer, bore=introducer.bore - used)),
    )
    assert used > 0.0
    assert rest.clearance == pytest.approx(moved.certificate.clearance - used, abs=0.2)
