"""``bozzini execute`` and ``bozzini export``: what they write, and how they end."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import mujoco
import pytest

from bozzini.cli.main import main
from tests.cli.plan_cases import SCOPE, Outcome, Tracts

CAPTURE = pytest.CaptureFixture[str]
FAST = ("--speed", "100mm/s", "--step", "4ms")


@pytest.fixture(scope="module")
def plan(tracts: Tracts, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("plan") / "out"
    arguments = ["plan", str(tracts.surface), *SCOPE, "--quiet", "--json", "--out", str(out)]
    assert main(arguments) == 0
    return out / "plan.npz"


def run(capsys: CAPTURE, *arguments: object) -> Outcome:
    capsys.readouterr()
    code = main([*map(str, arguments), "--quiet"])
    return Outcome(code, *capsys.readouterr())


@pytest.mark.slow
def test_a_plan_is_driven_beside_a_pushed_scope(
    capsys: CAPTURE, plan: Path, tracts: Tracts, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    soft = ("--rigidity", "200N mm^2", "--tip-length", "20mm")
    outcome = run(
        capsys, "execute", plan, tracts.surface, *FAST, *soft, "--compare", "--json", "--out", out
    )
    assert outcome.code == 0, outcome.err
    result = outcome.result
    assert result["complete"] and not result["outside"]
    assert result["compared"][0]["drive"] == "push"
    assert result["normal_sum_N"] <= result["compared"][0]["normal_sum_N"]
    assert set(result["files"]) == {path.name for path in out.iterdir()}
    assert (
        json.loads((out / "summary.json").read_text(encoding="utf-8"))["wall"]["stiffness"] == 0.3
    )
    assert outcome.err == ""


@pytest.mark.slow
def test_a_manoeuvre_is_made_and_its_limits_are_said(
    capsys: CAPTURE, plan: Path, tracts: Tracts, tmp_path: Path
) -> None:
    file, out = tmp_path / "manoeuvre.yaml", tmp_path / "out"
    file.write_text("steps: [{push: 15 mm}, {twist: 30 deg}, {pull: 5 mm}]", encoding="utf-8")
    made = ("execute", plan, tracts.surface, *FAST, "--drive", "push", "--manoeuvre", file)
    outcome = run(capsys, *made, "--out", out)
    assert outcome.code == 0, outcome.err
    assert "twist 30 deg" in outcome.out and "Limit: the wall is held in place" in outcome.out
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    moved = [step["base_moved_mm"] for step in summary["manoeuvre"]]
    assert moved == pytest.approx([15.0, 0.0, -5.0], abs=0.1)
    assert "manoeuvre.csv" in summary["files"]
    file.write_text("steps: [{push: 15 mm}, {pull: 20 mm}]", encoding="utf-8")
    outcome = run(capsys, *made, "--out", tmp_path / "none")
    assert outcome.code == 2 and outcome.err.count("\n") == 1
    assert "steps[1].pull is 20 mm" in outcome.err and not (tmp_path / "none").exists()


@pytest.mark.slow
def test_a_tract_is_planned_first(capsys: CAPTURE, tracts: Tracts, tmp_path: Path) -> None:
    outcome = run(
        capsys, "execute", tracts.surface, *SCOPE[:4], *FAST, "--check", "--wall", "prism",
        "--faces", "800", "--out", tmp_path / "out",
    )  # fmt: skip
    assert outcome.code == 0, outcome.err
    changes = outcome.out[outcome.out.index("changes with") :]
    assert all(name in changes for name in ("half_step", "friction_0 ", "friction_0.3"))


def test_a_scope_that_does_not_fit_is_refused_by_the_planner(
    capsys: CAPTURE, tracts: Tracts, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    outcome = run(capsys, "execute", tracts.surface, "--diameter", "30mm", "--out", out)
    assert outcome.code == 1
    assert outcome.out.startswith("Refused by the planner: ")
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("execute", "PLAN"), "give the file that it was made from too"),
        (("execute", "PLAN", "VOLUME"), "is not the file that the plan was made from"),
        (("execute", "SURFACE", "SURFACE"), "leave out"),
        (("execute", "PLAN", "SURFACE", "--unit", "m"), "--unit has no effect with a plan"),
        (("execute", "PLAN", "SURFACE", "--link", "5mm"), "--link has no effect with a plan"),
        (("execute", "PLAN", "SURFACE", "--drive", "tendons"), "no motion of a tendon robot"),
        (("execute", "--repeats", "3"), "--repeats is 3: without --seeds it must be 1"),
        (("execute", "PLAN", "--seeds", "3"), "--seeds takes no file"),
        (("execute", "--stiffness", "0N/mm"), "stiffness is 0 N/mm: it must lie in [0.0001"),
        (("execute", "--manoeuvre", "PLAN"), "--manoeuvre is of a pushed scope: give --drive push"),
        (("execute", "--drive", "push", "--manoeuvre", "none.yaml"), "none.yaml"),
        (("execute", "--torsion", "1 N mm^2"), "--torsion is of a shaft that is twisted: give"),
        (("certify", "."), "is a directory: give the plan in it, such as plan.npz"),
        (("execute", "--robot", "PLAN"), "--robot has no effect on a phantom"),
        (("execute", "--seeds", "2", "--unit", "m"), "--unit has no effect on a phantom"),
        (("execute", "--drive", "tendons"), "--drive is tendons: give a tract with --robot"),
        (
            ("export", "ros2", "PLAN", "--faces", "300", "--out", "a.yaml"),
            "--faces has no effect for ros2",
        ),
        (
            ("export", "urdf", "PLAN", "--speed", "3mm/s", "--out", "a.urdf"),
            "--speed has no effect for urdf",
        ),
        (("export", "urdf", "PLAN", "--out", "a.xml"), "for urdf it must end in .urdf"),
        (("export", "urdf", "PLAN", "SURFACE", "--out", "a.urdf"), "urdf takes no wall"),
        (("export", "mujoco", "PLAN", "--out", "a.xml"), "mujoco also needs the file"),
        (
            ("export", "mujoco", "PLAN", "VOLUME", "--out", "a.xml"),
            "is not the file that the plan was made from",
        ),
    ],
)
def test_wrong_use_is_one_line(
    capsys: CAPTURE, plan: Path, tracts: Tracts, tmp_path: Path, monkeypatch, arguments, message
) -> None:
    monkeypatch.chdir(tmp_path)
    names = {"PLAN": plan, "SURFACE": tracts.surface, "VOLUME": tracts.volume}
    outcome = run(capsys, *(names.get(word, word) for word in arguments))
    assert outcome.code == 2
    assert message in outcome.err
    assert outcome.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_phantoms_that_are_all_refused_leave_no_numbers(capsys: CAPTURE, tmp_path: Path) -> None:
    out = tmp_path / "out"
    outcome = run(capsys, "execute", "--seeds", "1", "--diameter", "30mm", "--json", "--out", out)
    assert outcome.code == 1
    assert outcome.result["reason"] == "the planner refused all phantoms"
    assert set(outcome.result["refused"]) == {"0"}
    assert outcome.result["normal_peak_N"] is None and outcome.result["share"] is None


def test_without_the_extra_the_message_names_it(
    capsys: CAPTURE, plan: Path, tracts: Tracts, tmp_path: Path, monkeypatch
) -> None:
    for name in list(sys.modules):
        if name.startswith("bozzini.physics.") and not name.endswith("options"):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    out = tmp_path / "out"
    outcome = run(capsys, "execute", plan, tracts.surface, "--out", out)
    assert (outcome.code, outcome.err.count("\n")) == (2, 1)
    assert "pip install 'bozzini[physics]'" in outcome.err
    assert not out.exists()


@pytest.mark.parametrize(("form", "suffix"), [("mujoco", "xml"), ("urdf", "urdf")])
def test_exports_are_read_by_mujoco(
    capsys: CAPTURE, plan: Path, tracts: Tracts, tmp_path: Path, form, suffix
) -> None:
    file = tmp_path / f"scene.{suffix}"
    wall = [tracts.surface, "--faces", "600"] if form == "mujoco" else []
    outcome = run(capsys, "export", form, plan, *wall, "--out", file)
    assert outcome.code == 0, outcome.err
    model = mujoco.MjModel.from_xml_path(str(file))
    assert model.nv % 2 == 1
    assert (model.nmesh > 0) == (form == "mujoco")
