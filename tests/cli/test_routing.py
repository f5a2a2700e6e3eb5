"""``bozzini continuum design`` and ``rank``: what they print is what the library says."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.continuum import ContinuumRobot
from bozzini.motion.routing import design_routing
from tests.cli.plan_cases import SCOPE


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):  # type: ignore[no-untyped-def]
    monkeypatch.chdir(tmp_path)

    def call(*arguments):  # type: ignore[no-untyped-def]
        capsys.readouterr()
        code = main(["continuum", *map(str, arguments)])
        return code, *capsys.readouterr()

    return call


@pytest.fixture
def curve(tmp_path: Path) -> Path:
    """A quarter of a turn of a helix, as a table."""
    turn = np.linspace(0.0, 2.0, 60)
    points = np.stack([20.0 * np.cos(turn), 20.0 * np.sin(turn), 8.0 * turn], axis=1)
    path = tmp_path / "curve.csv"
    np.savetxt(path, points, delimiter=",", header="x,y,z", comments="")
    return path


def test_design_is_the_library_and_writes_the_robot(run, curve) -> None:  # type: ignore[no-untyped-def]
    code, out, err = run("design", curve, "--out", "robot.yaml", "--figure", "robot.png", "--json")
    assert (code, err) == (0, "")
    said = json.loads(out)
    points = np.loadtxt(curve, delimiter=",", skiprows=1)
    design = design_routing(points)
    assert said["tension_sum_N"] == pytest.approx(design.tensions.sum())
    assert said["error_rms_mm"] == pytest.approx(design.error_rms)
    assert ContinuumRobot.from_yaml("robot.yaml").tendons == design.robot.tendons
    assert Path("robot.png").read_bytes()[:4] == b"\x89PNG"
    code, out, _ = run("design", curve)
    assert code == 0
    assert "+1 % tension" in out


def test_a_limit_that_is_not_kept_is_a_negative_answer(run, curve) -> None:  # type: ignore[no-untyped-def]
    code, out, err = run(
        "design", curve, "--tendons", 1, "--straight", "--error-max", "1um", "--out", "robot.yaml"
    )
    assert (code, err) == (1, "")
    assert "allowed is 0.001 mm" in out
    assert not Path("robot.yaml").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "either a curve or a plan, or --tract"),
        (("curve.csv", "--tract", "x.stl"), "either a curve or a plan, or --tract"),
        (("curve.csv", "--tendons", 5), "tendons is 5: it must lie in [1, 4]"),
        (("curve.csv", "--core-radius", "3mm"), "core radius is 3 mm: it must lie in [0, 2] mm"),
        (("curve.csv", "--lumen", "x.stl"), "--lumen goes with a plan"),
        (("curve.csv", "--diameters", 3), "--diameters has no effect without --tract"),
        (("curve.csv", "--organ", "colon"), "--organ has no effect without --tract"),
        (
            ("curve.csv", "--straight", "--gap-min", "1mm"),
            "--gap-min has no effect with --straight",
        ),
        (("--tract", "x.stl", "--tendons", 3), "--tendons has no effect with --tract"),
        (("none.csv",), "cannot read none.csv"),
        (("bad.csv",), "bad.csv has the columns a, b: it needs x, y and z"),
        (("blank.csv",), "blank.csv: column 4 has no title and the number 7 in row 2"),
        (("none.npz",), "none.npz"),
    ],
)
def test_a_wrong_input_is_one_line(run, curve, arguments, words) -> None:  # type: ignore[no-untyped-def]
    Path("bad.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    Path("blank.csv").write_text("x,y,z,\n1,2,3,7\n", encoding="utf-8")
    code, out, err = run("design", *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert len(err.splitlines()) == 1


def test_counts_of_rank_are_whole_numbers(run) -> None:  # type: ignore[no-untyped-def]
    code, _, err = run("rank", "none.npz", "--modes", "4,x")
    assert code == 2
    assert "--modes is '4,x'" in err


@pytest.mark.slow
def test_the_pose_of_a_plan_is_certified_in_the_lumen_it_was_made_from(run, tracts) -> None:  # type: ignore[no-untyped-def]
    assert main(["plan", str(tracts.volume), *SCOPE, "--quiet", "--out", "plan"]) == 0
    plan = Path("plan/plan.npz")
    code, out, _ = run("design", plan, "--lumen", tracts.volume, "--json")
    said = json.loads(out)
    assert code == 0
    assert said["clearance_certified_mm"] > 0.0
    _, out, _ = run("design", plan, "--json")
    assert json.loads(out)["clearance_certified_mm"] is None
    assert json.loads(out)["tensions_N"] == said["tensions_N"]
    for given, words in (
        (("--lumen", "none.stl"), "none.stl: no such file"),
        (("--lumen", tracts.surface), "is not the file that the plan was made from"),
        (("--lumen", tracts.volume, "--robot", "none.yaml"), "none.yaml"),
    ):
        code, out, err = run("design", plan, *given)
        assert (code, out) == (2, "")
        assert words in err
        assert len(err.splitlines()) == 1
