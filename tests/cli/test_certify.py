"""``bozzini certify``: what it checks, what it says, and how it ends."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import nibabel
import numpy as np
import pytest
import trimesh

from bozzini.cli.main import main
from bozzini.motion import Plan
from tests.cli.plan_cases import SCOPE, Outcome, Tracts, write_volume
from tests.duct.test_refined import shift_affine
from tests.motion.plans import describe_anew, forge
from tests.motion.planted import plant

CAPTURE = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def plans(tracts: Tracts, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("plans")
    made = {}
    for name, source, options in (
        ("labels", tracts.volume, ["--inflate", "1mm", "--labels", "1"]),
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


@pytest.mark.slow
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
    stated = Plan.load(plans[name]).certificate.clearance
    assert result["clearance_claimed_mm"] == stated
    assert stated <= result["clearance_certified_mm"] + 1e-6
    assert result["clearance_certified_mm"] <= second["found_mm"]
    assert second["clearance_mm"] <= second["found_mm"] <= second["clearance_mm"] + 0.05 + 1e-9
    assert second["clear"] and second["samples"] > 1000
    text = certify(capsys, plans[name], source)
    assert text.code == 0 and text.out.splitlines()[-1].startswith("Certified. The 5 mm scope")


@pytest.mark.slow
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
    # What another file offers says nothing about the plan: nothing else is checked.
    assert [(item["name"], item["ok"]) for item in outcome.result["checks"]] == [("input", False)]
    text = certify(capsys, plans["surface"], other)
    first, last = text.out.splitlines()
    assert first.startswith("FAILED input: the plan was made from another file")
    assert last == f"Not certified. {other} is not the file that the plan was made from."


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
    wider = replace(plan.introducer, bore=plan.introducer.bore + by)
    forged = replace(plan, introducer=wider).save(tmp_path / "plan.npz")
    outcome = certify(capsys, forged, tracts.surface)
    assert outcome.code == code
    assert ("FAILED bore: the introducer's bore" in outcome.out) == (by > 0.0)


def forge_half(plan: Plan) -> Plan:
    """Cut the motion and its path at a step half way, still called complete."""
    step = plan.steps // 4
    head = plan.head_arc_length[step]
    kept = plan.path_arc_length < head - 1e-9
    return replace(
        plan,
        joints=plan.joints[: step + 1],
        head_arc_length=plan.head_arc_length[: step + 1],
        clearance=plan.clearance[: step + 1],
        path=np.vstack([plan.path[kept], plan.joints[step, 0]]),
        path_arc_length=np.append(plan.path_arc_length[kept], head),
        path_radius=plan.path_radius[: int(kept.sum()) + 1],
        options=replace(plan.options, route=(1.0,)),
        measures=replace(plan.measures, clearance_min=float(plan.clearance[: step + 1].min())),
    )


def stop(plan: Plan) -> Plan:
    return replace(plan, status="stopped", reason_code="NO_PASSAGE", reason="does not fit (proved)")


def change(**parts: dict[str, object]) -> Callable[[Plan], Plan]:
    """Return a function that changes entries of parts of the meta; None removes one."""

    def apply(plan: Plan) -> Plan:
        meta = dict(plan.meta)
        for part, values in parts.items():
            meta[part] = {**meta.get(part, {}), **values}
            meta[part] = {key: value for key, value in meta[part].items() if value is not None}
        return describe_anew(plan, meta)

    return apply


NOWHERE: dict[str, object] = {
    "points_mm": [[0.0, 0.0, 0.0]] * 2,
    "arc_length_mm": [0.0, 0.0],
    "radius_mm": [1.0, 1.0],
}
SOFT: dict[str, object] = {"allowed_mm": 5.0, "used_mm": 5.0}


@pytest.mark.parametrize(
    ("forge", "check"),
    [
        (lambda plan: plan, None),
        (forge_half, "ends"),
        (stop, "ends"),
        (change(centreline=NOWHERE), "ends"),
        (change(scope={"diameter_mm": 0.5}), "clearances"),
        (change(field={"inflation_mm": 20.0}), "inflation"),
        (
            change(field={"inflation_mm": 5.0}, soft_wall={"allowed_mm": 5.0, "used_mm": 5.0}),
            "grid",
        ),
        pytest.param(change(input={"unit": "cm"}), "grid", marks=pytest.mark.slow),
        (change(input={"voxel_mm": 1.3}), "grid"),
        (change(input={"sha256": None}), "input"),
        (change(field={"nodes": [3, 3, 3]}), "grid"),
    ],
)
def test_a_plan_that_contradicts_itself_or_its_file_is_not_accepted(
    capsys: CAPTURE,
    plans: dict[str, Path],
    tracts: Tracts,
    tmp_path: Path,
    forge: Callable[[Plan], Plan],
    check: str | None,
) -> None:
    plan = Plan.load(plans["surface"])
    forged = forge(plan)
    outcome = certify(capsys, forged.save(tmp_path / "plan.npz"), tracts.surface, "--json")
    failed = {item["name"] for item in outcome.result["checks"] if not item["ok"]}
    if forged is plan:
        assert outcome.code == 0 and not failed
        return
    assert outcome.code == 1
    assert check in failed


def alter_more(plan: Plan) -> Plan:
    first = {**plan.more["ends"][0], "point_mm": [0.0, 0.0, 0.0]}
    return replace(plan, more={**plan.more, "ends": [first, *plan.more["ends"][1:]]})


def bend_less(plan: Plan) -> Plan:
    return replace(plan, options=replace(plan.options, angle_limit=0.01))


def shift_path(plan: Plan) -> Plan:
    return replace(plan, path_radius=plan.path_radius + 1.0)


STATEMENTS = {
    "errors": [
        change(field={"clearance_error_mm": 100.0}),
        change(field={"interpolation_error_mm": 0.0}),
    ],
    "ends": [alter_more],
    "moves": [bend_less],
    "steps": [lambda plan: replace(plan, options=replace(plan.options, head_step=5.0))],
    "measures": [
        change(measures={"joint_travel_mm": 1.0}),
        change(measures={"joint_angle_max_rad": 0.001}),
        change(measures={"joint_step_max_mm": 100.0}),
        change(measures={"joint_step_ratio_max": 0.5}),
        change(measures={"clearance_insertion_mm": 1.5}),
        change(measures={"clearance_min_mm": 2.9}),
    ],
    "closest place": [
        change(certificate={"place_mm": [0.0, 0.0, 900.0]}),
        change(certificate={"link": 400}),
        change(certificate={"step": 9000.0}),
    ],
    "scope": [change(scope={"length_mm": 16.0})],
    "method": [change(options={"asked": "thesis"})],
    "refusal": [change(refusal={"code": "NO_PASSAGE", "at_mm": 5.0})],
}
"""Statements that are not so, by the check that must fail."""


@pytest.mark.parametrize("check", STATEMENTS)
def test_every_statement_of_a_plan_is_compared_with_its_motion(
    capsys: CAPTURE, plans: dict[str, Path], tmp_path: Path, check: str
) -> None:
    plan = Plan.load(plans["surface"])
    for alter in STATEMENTS[check]:
        outcome = certify(capsys, alter(plan).save(tmp_path / "plan.npz"), "--json")
        failed = [item for item in outcome.result["checks"] if not item["ok"]]
        assert outcome.code == 1 and check in [item["name"] for item in failed]
        assert all("\n" not in item["message"] for item in failed)
        assert all(" rad" not in item["message"] for item in failed if item["name"] == "moves")


def test_an_absurd_error_of_the_clearances_is_one_clear_line(
    capsys: CAPTURE, plans: dict[str, Path], tmp_path: Path
) -> None:
    plan = change(field={"clearance_error_mm": 100.0})(Plan.load(plans["surface"]))
    outcome = certify(capsys, plan.save(tmp_path / "plan.npz"))
    line = next(line for line in outcome.out.splitlines() if line.startswith("FAILED"))
    assert line.startswith("FAILED errors: the plan states field.clearance_error_mm 100, but ")
    assert line.endswith(", whose sum it must be")
    assert outcome.out.splitlines()[-1].startswith("Not consistent.")


@pytest.mark.parametrize(
    ("alter", "check"),
    [
        (change(field={"interpolation_error_mm": 50.0, "clearance_error_mm": 50.5}), "field"),
        (change(field={"wall_error_mm": 9.0}), "field"),
        (change(field={"kind": "exact"}), "field"),
        (shift_path, "path"),
        (lambda plan: replace(plan, wall="faces between lumen voxels and the others"), "wall"),
        (change(certificate={"resolved": False}), "certificate"),
        (lambda plan: replace(plan, findings=("note: all is well",)), "findings"),
        (change(measures={"clearance_where_mm": 1.0}), "clearances"),
    ],
)
def test_every_statement_of_a_plan_is_compared_with_its_wall(
    capsys: CAPTURE,
    plans: dict[str, Path],
    tracts: Tracts,
    tmp_path: Path,
    alter: Callable[[Plan], Plan],
    check: str,
) -> None:
    plan = alter(Plan.load(plans["surface"]))
    outcome = certify(capsys, plan.save(tmp_path / "plan.npz"), tracts.surface, "--json")
    assert outcome.code == 1 and outcome.result["certified"] is False
    assert check in [item["name"] for item in outcome.result["checks"] if not item["ok"]]


def test_what_was_read_is_said_by_label_name_part_and_unit(
    capsys: CAPTURE, plans: dict[str, Path], tracts: Tracts, tmp_path: Path
) -> None:
    outcome = certify(capsys, plans["labels"], tracts.volume, "--json")
    reading = outcome.result["reading"]
    assert reading["file"] == str(tracts.volume) and reading["form"] == "labels"
    assert reading["labels"] == [1] and reading["unit"] == "mm"
    assert outcome.result["input_stated"]["labels"] == [1]
    text = certify(capsys, plans["labels"], tracts.volume).out
    assert f"ok     reading: {tracts.volume}: label 1, unit mm, frame RAS" in text
    text = certify(capsys, plans["surface"], tracts.surface).out
    assert f"reading: {tracts.surface}: part all of it, unit mm, by default" in text
    alone = certify(capsys, plans["labels"])
    assert "the plan states its input as file tube.nii.gz, labels 1" in alone.out
    assert json.loads(certify(capsys, plans["labels"], "--json").out)["reading"] is None


def test_what_the_file_says_twice_is_told_when_it_is_read_again(
    capsys: CAPTURE, tracts: Tracts, tmp_path: Path
) -> None:
    image = nibabel.load(tracts.volume)
    turned = image.affine.copy()
    turned[0] = -turned[0]
    image.set_sform(image.affine, code=1)
    image.set_qform(turned, code=1)
    source = tmp_path / "flip.nii.gz"
    nibabel.save(image, source)
    words = "bozzini: warning: the qform (scanner) and the sform (scanner) of the file differ by up"
    assert main(["plan", str(source), *SCOPE, "--quiet", "--out", str(tmp_path / "way")]) == 0
    said = capsys.readouterr().err
    assert words in said and "left and right are swapped: the sform is taken" in said
    assert words[18:] in (tmp_path / "way" / "report.html").read_text(encoding="utf-8")
    outcome = certify(capsys, tmp_path / "way" / "plan.npz", source)
    assert outcome.code == 0 and outcome.err.startswith(words)


def test_a_plan_of_no_stated_file_or_planner_says_so(
    capsys: CAPTURE, plans: dict[str, Path], tracts: Tracts, tmp_path: Path
) -> None:
    plan = change(input={"sha256": None, "file": None})(Plan.load(plans["surface"]))
    path = replace(plan, method="drawn by hand").save(tmp_path / "plan.npz")
    outcome = certify(capsys, path, tracts.surface)
    assert outcome.code == 0
    assert "input: the plan does not state from which file it was made" in outcome.out
    assert "method: 'drawn by hand' is none of this package's planners" in outcome.out


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
    path = forge(plan.save(tmp_path / "p.npz"), lambda meta: meta["input"].update(change))
    outcome = certify(capsys, path, tracts.volume)
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


def plan(source: Path, out: Path, *options: str) -> Plan:
    assert main(["plan", str(source), *options, "--quiet", "--json", "--out", str(out)]) == 0
    return Plan.load(out / "plan.npz")


@pytest.mark.slow
def test_a_plan_that_needed_the_finer_grid_is_certified_on_it_and_not_without(
    capsys: CAPTURE, tmp_path: Path
) -> None:
    tube = plant(2, grid=1.0, spare=0.3)
    source, ends = tmp_path / "narrow.nii", []
    labels = np.pad(tube.wall.mask, 1).astype(np.uint8)
    nibabel.save(nibabel.Nifti1Image(labels, shift_affine(tube.wall)), source)
    for name, point in (("--start", tube.curve[0]), ("--end", tube.curve[40])):
        ends += [f"{name}=" + ",".join(f"{value:.3f}mm" for value in point)]
    scope = tube.scope
    made = plan(
        source,
        tmp_path / "plan",
        *(f"--diameter={scope.diameter}mm", f"--link={scope.link_length}mm"),
        *("--head-step=1mm", "--voxel=1mm", "--method=tube", *ends),
    )
    assert made.field.fine_spacing == 0.5
    outcome = certify(capsys, tmp_path / "plan" / "plan.npz", source, "--independent", "--json")
    assert (outcome.code, outcome.err) == (0, "")
    claimed = made.certificate.clearance
    assert outcome.result["clearance_certified_mm"] == pytest.approx(claimed, abs=1e-6)
    for name, value in (("fine_distance_mm", -1.0), ("fine_spacing_mm", 0.001)):
        forged = shutil.copy(tmp_path / "plan" / "plan.npz", tmp_path / "forged.npz")
        forge(forged, lambda meta: meta["field"].update({name: value}))  # noqa: B023
        wrong = certify(capsys, forged, source)
        assert wrong.code == 2 and f"meta.field.{name} is {value:g}" in wrong.err
    field = replace(made.field, fine_spacing=None, fine_distance=None)
    coarse = certify(capsys, replace(made, field=field).save(tmp_path / "coarse.npz"), source)
    assert coarse.code == 1 and "FAILED certificate" in coarse.out


@pytest.mark.slow
def test_several_parts_of_a_scene_go_from_plan_to_certificate(
    capsys: CAPTURE, tmp_path: Path
) -> None:
    scene = trimesh.Scene()
    for name, height in (("low", 0.0), ("middle", 20.0), ("high", 40.0)):
        piece = trimesh.creation.cylinder(8.0, 24.0, sections=24)
        piece.apply_translation([0.0, 0.0, height])
        scene.add_geometry(piece, node_name=name, geom_name=name)
    source = tmp_path / "scene.glb"
    scene.export(source)
    options = [*SCOPE, "--unit=mm", "--voxel=2mm", "--method=tube", "--organ=colon"]
    options += ["--part=low", "--part=middle"]
    made = plan(source, tmp_path / "two", *options)
    assert made.input.part == ("low", "middle")
    assert np.ptp(made.path, axis=0).max() < 40.0
    outcome = certify(capsys, tmp_path / "two" / "plan.npz", source, "--json")
    assert outcome.code == 0 and outcome.result["certified"] is True
    for part, code in (("middle,low", 0), ("all", 1)):
        other = replace(made, input=replace(made.input, part=part))
        assert certify(capsys, other.save(tmp_path / "other.npz"), source).code == code
    for parts, code in ((["middle", "high"], 1), ([{}], 2)):
        path = forge(made.save(tmp_path / "other.npz"), lambda m: m["input"].update(part=parts))  # noqa: B023
        assert certify(capsys, path, source).code == code


@pytest.mark.slow
def test_a_folder_of_masks_is_known_by_its_hash(
    capsys: CAPTURE, tracts: Tracts, tmp_path: Path
) -> None:
    folder = tmp_path / "masks"
    folder.mkdir()
    for label, name in ((1, "a"), (2, "b")):
        write_volume(folder / f"{name}.nii.gz", (tracts.labels == label).astype(np.uint8))
    made = plan(folder, tmp_path / "plan", *SCOPE, "--labels=all", "--voxel=2mm", "--compare")
    assert len(made.input.sha256) == 64
    for name in ("plan", "plan-tube", "plan-follow", "plan-thesis"):
        outcome = certify(capsys, tmp_path / "plan" / f"{name}.npz", folder, "--json")
        checks = {item["name"]: item for item in outcome.result["checks"]}
        assert checks["input"]["ok"] and made.input.sha256 in checks["input"]["message"]
    (folder / "b.nii.gz").rename(folder / "c.nii.gz")
    outcome = certify(capsys, tmp_path / "plan" / "plan.npz", folder)
    assert outcome.code == 1 and "FAILED input: the plan was made from another" in outcome.out
