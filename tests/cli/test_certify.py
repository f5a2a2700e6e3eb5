"""``bozzini certify``: what it checks, what it says, and how it ends."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.motion import Plan
from tests.cli.plan_cases import SCOPE, Outcome, Tracts

CAPTURE = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def plans(tracts: Tracts, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("plans")
    made = {}
    for name, source, options in (
        ("labels", tracts.volume, ["--inflate", "1mm", "--labels", "1,2"]),
        ("surface", tracts.surface, ["--route", "in-out"]),
    ):
        arguments = ["plan", str(source), *SCOPE, *options, "--quiet", "--json"]
        assert main([*arguments, "--out", str(folder / name)]) == 0
        made[name] = folder / name / "plan.npz"
    return made


def certify(capsys: CAPTURE, *arguments: object) -> Outcome:
    capsys.readouterr()
    code = main(["certify", *map(str, arguments), "--quiet"])
    return Outcome(code, *capsys.readouterr())


@pytest.mark.parametrize("name", ["labels", "surface"])
def test_a_plan_is_certified_anew_by_both_methods(
    capsys: CAPTURE, plans: dict[str, Path], tracts: Tracts, name: str
) -> None:
    source = tracts.volume if name == "labels" else tracts.surface
    outcome = certify(capsys, plans[name], source, "--independent", "--json")
    assert (outcome.code, outcome.err) == (0, "")
    result, second = outcome.result, outcome.result["second_check"]
    assert result["certified"] is True and result["consistent"] is True
    assert all(item["ok"] for item in result["checks"])
    stated = Plan.load(plans[name]).meta["certificate"]["clearance_mm"]
    assert result["clearance_claimed_mm"] == stated
    assert stated <= result["clearance_certified_mm"] + 1e-6
    assert result["clearance_certified_mm"] <= second["found_mm"]
    assert second["clearance_mm"] <= second["found_mm"] <= second["clearance_mm"] + 0.05 + 1e-9
    assert second["clear"] and second["samples"] > 1000
    text = certify(capsys, plans[name], source)
    assert text.code == 0 and text.out.splitlines()[-1].startswith("Certified. The 5 mm scope")


def test_without_the_input_nothing_is_said_about_the_wall(
    capsys: CAPTURE, plans: dict[str, Path]
) -> None:
    outcome = certify(capsys, plans["labels"], "--json")
    assert outcome.code == 0
    assert outcome.result["certified"] is None and outcome.result["consistent"] is True
    text = certify(capsys, plans["labels"])
    assert "Nothing about the wall was checked" in text.out
    assert certify(capsys, plans["labels"], "--independent").code == 2


def test_another_file_is_not_the_one_of_the_plan(
    capsys: CAPTURE, plans: dict[str, Path], tracts: Tracts, tmp_path: Path
) -> None:
    other = tmp_path / "tube.stl"
    tracts.mesh.copy().apply_translation([0.0, 0.0, 0.1]).export(other)
    outcome = certify(capsys, plans["surface"], other, "--json")
    assert outcome.code == 1 and outcome.result["certified"] is False
    failed = [item["name"] for item in outcome.result["checks"] if not item["ok"]]
    assert "input" in failed


@pytest.mark.parametrize(("by", "code"), [(0.0, 0), (0.4, 1), (50.0, 1)])
def test_a_wider_bore_is_not_accepted(
    capsys: CAPTURE,
    plans: dict[str, Path],
    tracts: Tracts,
    tmp_path: Path,
    by: float,
    code: int,
) -> None:
    plan = Plan.load(plans["surface"])
    plan.meta["introducer"]["bore_mm"] += by
    forged = plan.save(tmp_path / "plan.npz")
    outcome = certify(capsys, forged, tracts.surface)
    assert outcome.code == code
    assert ("FAILED bore: the introducer's bore" in outcome.out) == (by > 0.0)


def test_a_body_moved_through_the_wall_is_found(
    capsys: CAPTURE, plans: dict[str, Path], tracts: Tracts, tmp_path: Path
) -> None:
    plan = Plan.load(plans["labels"])
    plan.joints[-1, 3] += [0.0, 12.0, 0.0]
    outcome = certify(capsys, plan.save(tmp_path / "p.npz"), tracts.volume, "--independent")
    assert outcome.code == 1
    for name in ("links", "moves", "certificate"):
        assert f"FAILED {name}:" in outcome.out
    assert outcome.out.splitlines()[-1].startswith("Not certified. It is not proved")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"labels": [7]}, "7"),
        ({"labels": "all"}, "labels"),
        ({"labels": [True]}, "labels"),
        ({"unit": 3}, "meta.input.unit is 3"),
        ({"voxel_mm": -1.0}, "voxel"),
        ({"voxel_mm": "fine"}, "voxel"),
        ({"voxel_mm": 1e-9}, "voxel"),
    ],
)
def test_an_input_that_cannot_be_read_as_stated_is_one_line(
    capsys: CAPTURE,
    plans: dict[str, Path],
    tracts: Tracts,
    tmp_path: Path,
    change: dict[str, object],
    message: str,
) -> None:
    plan = Plan.load(plans["labels"])
    plan.meta["input"].update(change)
    outcome = certify(capsys, plan.save(tmp_path / "p.npz"), tracts.volume)
    assert outcome.code == 2
    assert message in outcome.err and outcome.err.count("\n") == 1


@pytest.mark.parametrize("content", [None, b"", b"PK\x03\x04 and no more", b"solid x\n"])
def test_a_file_that_is_no_plan_is_one_line(
    capsys: CAPTURE, tmp_path: Path, content: bytes | None
) -> None:
    path = tmp_path / "plan.npz"
    if content is not None:
        path.write_bytes(content)
    outcome = certify(capsys, path, "--json")
    assert outcome.code == 2
    assert outcome.err.count("\n") == 1 and json.loads(outcome.out)["error"]


def test_a_missing_input_and_a_plane_plan_are_one_line(
    capsys: CAPTURE, plans: dict[str, Path], tracts: Tracts, tmp_path: Path
) -> None:
    outcome = certify(capsys, plans["labels"], tmp_path / "none.nii.gz")
    assert outcome.code == 2 and "no such file" in outcome.err
    flat = Plan(
        joints=np.zeros((1, 2, 2)),
        head_arc_length=np.zeros(1),
        clearance=np.ones((1, 1)),
        path=np.array([[0.0, 0.0], [1.0, 0.0]]),
        path_arc_length=np.array([0.0, 1.0]),
        path_radius=np.ones(2),
        method="drawn",
        status="stopped",
    )
    outcome = certify(capsys, flat.save(tmp_path / "flat.npz"), tracts.surface)
    assert outcome.code == 2 and "2 dimensions" in outcome.err
