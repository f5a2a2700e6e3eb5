"""The main job in one call: two forms of a tract agree, the frame does not matter, all is kept."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bozzini import plot, report, scene
from bozzini.anatomy import Finding
from bozzini.anatomy.labels import tract_from_labels
from bozzini.anatomy.surface import tract_from_surface
from bozzini.anatomy.tract import LabelTract, SurfaceTract
from bozzini.errors import InputError, OutputError
from bozzini.motion import FreeSpace, Scope
from bozzini.study import InsertionOptions, InsertionStudy, run_insertion
from tests.shapes import bend_curve, curve_distance

VOXEL = 1.5
RADIUS = 8.0
CURVE = bend_curve(25.0, 1.4, 22.0)
SCOPE = Scope(diameter=5.0, link_length=8.0)
START, END = CURVE[4], CURVE[-5]


def sample_tube() -> tuple[np.ndarray, np.ndarray]:
    """Distance to a bent tube at voxel centres, and where the first of them is."""
    low, high = CURVE.min(axis=0) - 12.0, CURVE.max(axis=0) + 12.0
    axes = [np.arange(a, b, VOXEL) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return curve_distance(CURVE, RADIUS)(points), low


def make_labels(turn: np.ndarray | None = None, **options: object) -> LabelTract:
    distance, low = sample_tube()
    labels = np.where(distance < 0.0, np.where(np.arange(distance.shape[2]) < 15, 1, 2), 0)
    affine = np.diag([VOXEL, VOXEL, VOXEL, 1.0])
    affine[:3, 3] = low
    if turn is not None:
        affine = turn @ affine
    return tract_from_labels(labels.astype(np.uint16), affine, source="tube", **options)


@pytest.fixture(scope="module")
def labels() -> LabelTract:
    return make_labels()


@pytest.fixture(scope="module")
def surface() -> SurfaceTract:
    from skimage.measure import marching_cubes

    distance, low = sample_tube()
    vertices, faces, _, _ = marching_cubes(distance, level=0.0, spacing=(VOXEL,) * 3)
    return tract_from_surface(vertices + low, faces, source="tube")


def run(
    tract: LabelTract | SurfaceTract,
    *,
    scope: Scope = SCOPE,
    inputs: dict[str, object] | None = None,
    **options: object,
) -> InsertionStudy:
    given = InsertionOptions(**{"start": START, "end": END, "head_step": 1.0, **options})
    return run_insertion(tract, scope, options=given, inputs=inputs)


@pytest.fixture(scope="module")
def study(labels: LabelTract) -> InsertionStudy:
    return run(labels, inputs={"file": "tube.nii"})


def test_labels_and_surface_of_one_tube_agree_within_their_errors(
    study: InsertionStudy, surface: SurfaceTract
) -> None:
    other = run(surface, voxel=VOXEL)
    assert (study.plan.status, other.plan.status) == ("complete", "complete")
    assert other.line.length == pytest.approx(study.line.length, rel=0.02)
    # Each radius is off by its interpolation and its wall at most.
    allowed = sum(s.field.error for s in (study, other)) + study.field.wall_error
    for part in (study, other):
        assert part.line.radius == pytest.approx(RADIUS, abs=part.field.error + VOXEL)
    assert np.median(study.line.radius) == pytest.approx(np.median(other.line.radius), abs=allowed)
    # The same motion in the other field has the same clearance, within both errors.
    from bozzini.motion.measures import measure_body

    introducer = study.plan.introducer
    crossed, _ = measure_body(
        FreeSpace(other.field, introducer=introducer), study.plan.joints, SCOPE
    )
    both = np.isfinite(crossed) & np.isfinite(study.plan.clearance)
    assert both.any()
    stated = sum(s.plan.field.clearance_error for s in (study, other))
    gap = np.abs(crossed[both] - study.plan.clearance[both]).max()
    assert gap <= stated + study.field.wall_error


def test_a_turned_and_moved_scan_gives_the_turned_and_moved_plan(study: InsertionStudy) -> None:
    random = np.random.default_rng(4)
    rotation, _ = np.linalg.qr(random.normal(size=(3, 3)))
    turn = np.eye(4)
    turn[:3, :3], turn[:3, 3] = rotation, [100.0, -40.0, 7.0]
    ends = [point @ rotation.T + turn[:3, 3] for point in (START, END)]
    turned = run(make_labels(turn), start=ends[0], end=ends[1])
    expected = study.plan.joints @ rotation.T + turn[:3, 3]
    assert turned.plan.joints.shape == expected.shape
    assert turned.plan.joints == pytest.approx(expected, abs=1e-3)
    finite = np.isfinite(study.plan.clearance)
    assert np.array_equal(np.isfinite(turned.plan.clearance), finite)
    assert turned.plan.clearance[finite] == pytest.approx(study.plan.clearance[finite], abs=1e-3)


def test_the_study_is_a_result_with_a_table_and_a_picture(study: InsertionStudy) -> None:
    assert study.converged is study.fits is True and study.reason == ""
    assert study.residual == study.plan.meta["field"]["clearance_error_mm"]
    assert study.to_frame().loc[0, "status"] == "complete"
    axes = study.plot()
    assert study.plot(axes) is axes
    over, smallest = axes.lines[0].get_data()
    assert np.max(over) == pytest.approx(study.plan.inserted)
    assert np.nanmin(smallest) == pytest.approx(study.plan.clearance_min)


def test_inflation_adds_its_room_along_the_same_centreline(
    study: InsertionStudy, labels: LabelTract
) -> None:
    wide = run(labels, inflate=2.0)
    assert wide.line.points == pytest.approx(study.line.points, abs=1e-6)
    assert wide.line.radius == pytest.approx(study.line.radius + 2.0, abs=1e-5)
    assert wide.to_dict()["inflation_mm"] == 2.0
    assert wide.plan.clearance_min > study.plan.clearance_min


def test_reverse_is_the_same_as_swapped_ends(labels: LabelTract) -> None:
    back = run(labels, reverse=True)
    swapped = run(labels, start=END, end=START)
    assert back.line.points[0] == pytest.approx(END, abs=1e-6)
    assert back.line.length == pytest.approx(swapped.line.length, rel=0.01)


def test_an_end_in_a_label_lies_in_it(labels: LabelTract) -> None:
    found = run(labels, start=2, end=1)
    inverse = np.linalg.inv(labels.affine)
    for point, label in ((found.line.points[0], 2), (found.line.points[-1], 1)):
        index = np.rint(inverse[:3, :3] @ point + inverse[:3, 3]).astype(int)
        assert labels.labels[tuple(index)] == label
    assert found.plan.input.more["start"] == 2


def test_findings_are_carried_to_plan_and_summary() -> None:
    finding = Finding("odd", "warning", "something odd")
    found = run(make_labels(findings=[finding]))
    shown = {"code": "odd", "severity": "warning", "message": "something odd"}
    assert shown in found.to_dict()["findings"]
    assert "warning: something odd" in found.plan.findings


def test_summary_is_json_and_says_what_the_plan_says(study: InsertionStudy) -> None:
    summary = study.to_dict()
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["clearance_min_mm"] == pytest.approx(study.plan.clearance_min)
    assert summary["radius_min_mm"] == study.line.radius.min()
    at = np.interp(summary["radius_min_where_mm"], study.line.arc_length, study.line.radius)
    assert at == pytest.approx(summary["radius_min_mm"])
    assert summary["input"]["file"] == "tube.nii"
    assert summary["fits"] == study.fits == summary["certified"]
    assert study.plan.clearance_min >= summary["clearance_certified_mm"] - 1e-6


def test_seconds_by_stage(study: InsertionStudy, tmp_path: Path) -> None:
    assert {"distance", "centreline", "plan"} <= set(study.seconds)
    summary = study.write(tmp_path / "plan")
    stages = {key: value for key, value in summary["seconds"].items() if key != "total"}
    assert {"scene", "report"} <= set(stages)
    assert all(value >= 0.0 for value in stages.values())
    assert summary["seconds"]["total"] == pytest.approx(sum(stages.values()), abs=1e-3)


@pytest.mark.parametrize("stage", ["write_scene", "draw_overview", "write_report"])
@pytest.mark.parametrize("error", [OutputError("cannot write it"), ZeroDivisionError("a fault")])
def test_a_stage_that_fails_leaves_nothing_behind(
    study: InsertionStudy,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    stage: str,
    error: Exception,
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    place = {"write_scene": scene, "draw_overview": plot, "write_report": report}[stage]
    monkeypatch.setattr(place, stage, fail)
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "summary.json").write_text(own := '{"files": ["summary.json"]}')
    for place, force in ((tmp_path / "plan", False), (tmp_path / "kept", True)):
        with pytest.raises(type(error), match=str(error)):
            study.write(place, force=force)
    left = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")}
    assert left == {"kept", "kept/summary.json"}
    assert (tmp_path / "kept" / "summary.json").read_text(encoding="utf-8") == own


def test_a_study_that_does_not_enter_is_a_result_too(labels: LabelTract, tmp_path: Path) -> None:
    thick = run(labels, scope=Scope(diameter=30.0, link_length=8.0))
    summary = thick.write(tmp_path / "plan")
    assert (summary["status"], summary["fits"], summary["stopped_at_mm"]) == ("stopped", False, 0.0)
    assert summary["clearance_min_mm"] is None
    json.dumps(summary, allow_nan=False)


def test_a_label_may_be_any_whole_number(labels: LabelTract) -> None:
    found = run(labels, start=np.int64(2), end=np.uint8(1))
    assert found.plan.input.more["start"] == 2
    assert found.line.points == pytest.approx(run(labels, start=2, end=1).line.points)


@pytest.mark.parametrize("route", [[1.0, 0.0], (1, 0), np.array([1.0, 0.0]), "in-out"])
def test_a_route_is_a_name_or_any_sequence(route: object) -> None:
    assert InsertionOptions(route=route).motion.route == (1.0, 0.0)


def test_an_implausible_size_is_said_again_where_a_later_stage_fails() -> None:
    finding = Finding("scale", "warning", "the tract is implausibly small: try --unit m")
    with pytest.raises(
        InputError, match="link length is 5000 mm.*; the tract is implausibly small"
    ):
        run(make_labels(findings=[finding]), scope=Scope(diameter=5.0, link_length=5000.0))


def test_another_end_is_a_finding(labels: LabelTract, monkeypatch: pytest.MonkeyPatch) -> None:
    from dataclasses import replace

    from bozzini.duct import find_centreline
    from bozzini.duct.centreline import OtherEnd

    other = OtherEnd(end="end", point=(1.0, 2.0, 3.0), distance=90.0)
    monkeypatch.setattr(
        "bozzini.study.ends.find_centreline",
        lambda *given, **options: replace(find_centreline(*given, **options), other_ends=(other,)),
    )
    forth, back = run(labels), run(labels, reverse=True)
    for found, name in ((forth, "end"), (back, "start")):
        (item,) = (entry for entry in found.to_dict()["findings"] if entry["code"] == "branches")
        assert item["severity"] == "warning"
        assert "(1, 2, 3) mm" in item["message"] and f"--{name} " in item["message"]
        assert f"warning: {item['message']}" in found.plan.findings
