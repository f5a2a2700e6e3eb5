"""Which end is the entry, named places, what is not reached, and the files for other tools."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import nibabel
import numpy as np
import pytest
import trimesh

from bozzini.anatomy.files import write_tract
from bozzini.anatomy.labels import tract_from_labels
from bozzini.anatomy.surface import tract_from_surface
from bozzini.anatomy.tract import ORGANS, Component, LabelTract, Opening
from bozzini.checks import ceil_mm
from bozzini.duct import Centreline, build_field, find_centreline
from bozzini.duct.centreline import OtherEnd
from bozzini.duct.field import INFLATION_MAX
from bozzini.duct.fitting.fit import KINDS
from bozzini.motion import PLANNERS, Scope
from bozzini.report.verdict import judge_plan
from bozzini.study import InsertionOptions, options, run_insertion
from bozzini.study.ends import list_branches, measure_gap, orient_centreline, resolve_places
from bozzini.study.insertion import write_centreline, write_volumes
from bozzini.study.reach import Unreached, find_unreached
from tests.shapes import curve_distance

VOXEL = 2.0
SCOPE = Scope(diameter=5.0, link_length=8.0)
LOW, HIGH = np.array([0.0, -30.0, -60.0]), np.array([50.0, 10.0, 20.0])
# Up on one side, across, and half-way down on the other: the wide end is the low one.
COLON = np.array([LOW, [0.0, 0.0, 50.0], [50.0, 0.0, 50.0], HIGH])


def make_tract(*curves: np.ndarray, radius: float = 8.0, split: bool = False) -> LabelTract:
    points = np.concatenate(curves)
    low = points.min(axis=0) - radius - 4.0 * VOXEL
    axes = [
        np.arange(a, b + radius + 4.0 * VOXEL, VOXEL)
        for a, b in zip(low, points.max(axis=0), strict=True)
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = np.min([curve_distance(curve, radius)(grid) for curve in curves], axis=0) < 0.0
    labels = np.where(inside, np.where(split & (grid[..., 2] > 30.0), 2, 1), 0).astype(np.uint16)
    affine = np.diag([VOXEL, VOXEL, VOXEL, 1.0])
    affine[:3, 3] = low
    return tract_from_labels(labels, affine, source="tube")


@pytest.fixture(scope="module")
def tract() -> LabelTract:
    made = make_tract(COLON, split=True)
    return replace(
        made,
        frame="RAS",
        label_names={1: "sigmoid", 2: "transverse"},
        landmarks={"splenic flexure": (0.0, 0.0, 50.0), "appendix tip": tuple(HIGH)},
        openings=(
            Opening(point=(0.0, -34.0, -67.0), radius=8.0, name="opening 1"),
            Opening(point=(0.0, 8.0, 50.0), radius=2.0, name="opening 2"),
        ),
    )


def plan(tract: LabelTract, *, scope: Scope = SCOPE, head_step: float = 2.0, **given: object):
    return run_insertion(tract, scope, options=InsertionOptions(head_step=head_step, **given))


def near(point: np.ndarray, place: np.ndarray, reach: float = 16.0) -> bool:
    return bool(np.linalg.norm(point - place) < reach)


def way_of(tract: LabelTract, *ends: object, **options: object) -> object:
    return orient_centreline(tract, build_field(tract), resolve_places(tract, *ends), **options)


@pytest.mark.parametrize(
    ("organ", "frame", "landmark", "first"),
    [
        ("colon", "RAS", None, LOW),
        ("upper-tract", "RAS", None, HIGH),
        ("small-bowel", "LPS", None, HIGH),
        # +z to the feet: what has the smaller z lies higher in the patient.
        ("colon", "RPI", None, HIGH),
        ("upper-tract", "RPI", None, LOW),
        # A landmark at the entry is worth more than any axis, and says which organ it is.
        ("colon", "RPI", ("anus", LOW), LOW),
        (None, None, ("Anus", LOW), LOW),
        (None, None, ("mouth", LOW), LOW),
    ],
)
def test_the_organ_decides_the_entry(tract, organ, frame, landmark, first) -> None:
    marks = {landmark[0]: tuple(landmark[1])} if landmark else {}
    way = way_of(replace(tract, organ=organ, frame=frame, landmarks=marks), None, None)
    assert near(way.line.points[0], first), way.basis
    assert way.decided
    assert not [item for item in way.findings if item.code == "frame-assumed"]


def test_level_ends_of_a_colon_are_told_apart_by_the_back() -> None:
    rear, front = np.array([0.0, -40.0, 0.0]), np.array([60.0, 20.0, 0.0])
    level = make_tract(np.array([rear, [0.0, 0.0, 60.0], [60.0, 0.0, 60.0], front]))
    for frame, first in (("RAS", rear), ("RPS", front)):
        way = way_of(replace(level, organ="colon", frame=frame), None, None)
        assert near(way.line.points[0], first)
        assert "rear" in way.basis


def test_an_assumed_frame_is_a_finding(tract) -> None:
    way = way_of(replace(tract, organ="colon", frame=None, landmarks={}), None, None)
    assert [item.code for item in way.findings] == ["frame-assumed"]
    assert near(way.line.points[0], LOW)


@pytest.mark.slow
def test_places_have_names(tract) -> None:
    by_name = {
        "splenic flexure": [0.0, 0.0, 50.0],
        "Opening 1": [0.0, -34.0, -67.0],
        "largest-opening": [0.0, -34.0, -67.0],
    }
    for name, place in by_name.items():
        way = way_of(tract, name, None)
        assert near(way.line.points[0], np.array(place), 10.0), name
        assert way.line.radius[0] > 4.0  # a place on the wall is moved into the lumen
    for name, number in (("Transverse", 2), ("sigmoid", 1)):
        named, numbered = way_of(tract, name, None), way_of(tract, number, None)
        assert named.line.points == pytest.approx(numbered.line.points)
    assert way_of(tract, None, "appendix tip").goal == "the given end (landmark 'appendix tip')"


def test_a_landmark_at_an_end_gives_the_point_that_is_found_there(tract) -> None:
    colon = replace(tract, organ="colon")
    found = way_of(colon, None, None).line.points[0]
    marked = replace(colon, landmarks={**colon.landmarks, "anus": (0.0, -40.0, -74.0)})
    for name in ("anus", "opening 1"):
        for end in (None, "splenic flexure"):
            assert way_of(marked, name, end).line.points[0] == pytest.approx(found), (name, end)
    back = way_of(marked, "splenic flexure", "anus").line
    assert back.points[-1] == pytest.approx(found)


def test_an_end_that_was_found_is_named_by_its_opening(tract) -> None:
    top = Opening(point=(50.0, 14.0, 27.0), radius=8.0, name="opening 2")
    capped = replace(tract, organ="colon", openings=(tract.openings[0], top), landmarks={})
    way = way_of(capped, None, None)
    assert (way.goal, way.goal_given) == ("opening 2", False)
    assert way_of(capped, None, None, reverse=True).goal == "opening 1"
    assert way_of(replace(capped, openings=()), None, None).goal == "the far end"
    assert way_of(capped, None, "opening 2").goal_given


def test_a_landmark_is_read_by_words(tract) -> None:
    for name, marks in (("spinal canal", False), ("anal_verge", True), ("oropharynx", True)):
        way = way_of(replace(tract, organ=None, landmarks={name: tuple(LOW)}), None, None)
        assert way.decided is marks, name


def test_two_names_of_a_place_are_one_candidate(tract) -> None:
    far = (0.0, 0.0, -125.0)
    odd = replace(tract, landmarks={"appendix orifice": far, "AO": far, "anus": tuple(LOW)})
    assert [c.name for c in way_of(odd, None, None).candidates if c.kind == "landmark"] == [
        "appendix orifice",
        "anus",
    ]


@pytest.mark.parametrize("surface", [False, True])
def test_how_far_a_point_lies_outside(tract, surface: bool) -> None:
    solid = tract
    if surface:
        from skimage.measure import marching_cubes

        vertices, faces, _, _ = marching_cubes(tract.mask.astype(np.float32), 0.5)
        world = vertices @ tract.affine[:3, :3].T + tract.affine[:3, 3]
        solid = tract_from_surface(world, faces, source="tube")
    assert measure_gap(solid, COLON[1]) == 0.0
    for away in (20.0, 60.0):
        gap = measure_gap(solid, np.array([0.0, 0.0, 0.0]) - [away, 0.0, 0.0])
        assert gap == pytest.approx(away - 8.0, abs=3.0 * VOXEL)


def test_via_chooses_between_two_ways() -> None:
    # A ring: the short half is taken, unless the way shall go through the long one.
    low, high = np.array([0.0, 0.0, -60.0]), np.array([0.0, 0.0, 60.0])
    short = np.array([low, [0.0, 0.0, -30.0], [20.0, 0.0, 0.0], [0.0, 0.0, 30.0], high])
    long = np.array([[0.0, 0.0, -30.0], [-45.0, 0.0, 0.0], [0.0, 0.0, 30.0]])
    ring = make_tract(short, long, radius=7.0)
    field = build_field(ring)
    plain = find_centreline(field, (low, high))
    there = np.array([-45.0, 0.0, 0.0])
    through = find_centreline(field, (low, high), via=[there])
    assert np.linalg.norm(plain.points - there, axis=1).min() > 40.0
    assert np.linalg.norm(through.points - there, axis=1).min() < 8.0
    assert through.length > plain.length + 10.0
    assert np.all(field.signed_distance(through.points) < 0.0)
    # The same by a label.
    labels = ring.labels.copy()
    centres = np.argwhere(labels > 0) @ ring.affine[:3, :3].T + ring.affine[:3, 3]
    chosen = np.argwhere(labels > 0)[centres[:, 0] < -35.0]
    labels[tuple(chosen.T)] = 5
    marked = replace(ring, labels=labels)
    way = orient_centreline(marked, field, resolve_places(marked, low, high, (5,)))
    assert way.line.points[:, 0].min() < -35.0


@pytest.fixture(scope="module")
def both(tract):
    bare = replace(tract, organ=None, landmarks={}, openings=())
    return bare, plan(bare)


def test_of_an_unknown_organ_both_ends_are_tried_and_named(both) -> None:
    bare, study = both
    summary = study.to_dict()
    assert len(summary["entries"]) == 2
    firsts = np.array([entry["point_mm"] for entry in summary["entries"]])
    assert firsts[0] == pytest.approx(study.line.points[0], abs=1e-3)
    assert firsts[1] == pytest.approx(study.line.points[-1], abs=1e-3)
    (note,) = (item for item in study.findings if item.code == "organ-unknown")
    for point in firsts:
        assert f"({', '.join(f'{v:.0f}' for v in point)}) mm" in note.message
    other = plan(bare, reverse=True)
    assert other.line.points[0] == pytest.approx(study.line.points[-1])
    known = plan(replace(bare, organ="colon"))
    assert "entries" not in known.to_dict()
    same = study if near(study.line.points[0], LOW) else other
    assert known.plan.joints == pytest.approx(same.plan.joints)


def test_the_end_that_gets_farther_is_taken() -> None:
    # Narrow at its higher end, and a scope that does not go through there.
    wide, narrow = np.array([[0, 0, -80.0], [0, 0, 20.0]]), np.array([[0, 0, 20.0], [0, 0, 70.0]])
    points = np.concatenate([wide, narrow])
    low = points.min(axis=0) - 20.0
    axes = [np.arange(a, b + 20.0, 1.5) for a, b in zip(low, points.max(axis=0), strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = np.minimum(curve_distance(wide, 9.0)(grid), curve_distance(narrow, 5.0)(grid)) < 0.0
    affine = np.diag([1.5, 1.5, 1.5, 1.0])
    affine[:3, 3] = low
    funnel = tract_from_labels(inside.astype(np.uint16), affine, source="funnel")
    study = plan(funnel, scope=Scope(diameter=13.0, link_length=8.0))
    assert study.line.points[0, 2] < study.line.points[-1, 2]
    entries = study.to_dict()["entries"]
    assert entries[0]["inserted_mm"] > entries[1]["inserted_mm"]


def test_the_reported_entry_is_stated_as_it_came_out_of_the_finer_grid() -> None:
    # A waist through which the coarser grid cannot prove a way.
    pieces = (((0.0, 30.0), 9.0), ((30.0, 50.0), 5.1), ((50.0, 80.0), 9.0))
    axes = [np.arange(-14.0, 14.1, 2.0)] * 2 + [np.arange(-16.0, 96.1, 2.0)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    lines = [(np.array([[0.0, 0.0, z] for z in heights]), radius) for heights, radius in pieces]
    inside = np.min([curve_distance(line, radius)(grid) for line, radius in lines], axis=0) < 0.0
    waist = tract_from_labels(inside.astype(np.uint16), np.diag([2.0, 2.0, 2.0, 1.0]), source="w")
    study = plan(waist, scope=Scope(diameter=8.3, link_length=8.0))
    assert "finer-grid" in [finding.code for finding in study.findings]
    reported, other = study.to_dict()["entries"]
    assert (reported["status"], reported["inserted_mm"]) == ("complete", study.plan.inserted)
    assert other["status"] == "stopped"
    (text,) = [each.message for each in study.findings if each.code == "organ-unknown"]
    assert f"reaches the other end after {study.plan.inserted:.0f} mm" in text
    assert "coarser grid" in text


def test_what_lies_beyond_a_given_end_stands_in_the_verdict(tract) -> None:
    end = COLON[1]
    study = plan(replace(tract, organ="colon"), end=end, start=LOW)
    (part,) = study.unreached
    assert part.kind == "beyond"
    # The rest of the tube, but for about a sphere round the end.
    rest = np.linalg.norm(COLON[2] - COLON[1]) + np.linalg.norm(COLON[3] - COLON[2])
    whole = rest + np.linalg.norm(COLON[1] - COLON[0])
    assert 0.5 * rest / whole < part.share < rest / whole
    summary = study.to_dict()
    verdict = judge_plan(study.plan, summary, error=summary["clearance_error_mm"])
    assert verdict.label.startswith("Fits to the given end")
    assert "beyond the goal" in verdict.sentence


def test_a_whole_tube_is_reached_and_a_side_branch_is_not(tract) -> None:
    field = build_field(tract)
    assert find_unreached(tract, field, find_centreline(field)) == ()
    branch = np.array([[0.0, 0.0, 50.0], [0.0, 75.0, 50.0]])
    forked = make_tract(COLON, branch)
    lumen = build_field(forked)
    line = find_centreline(lumen, (LOW, HIGH))
    (part,) = find_unreached(forked, lumen, line)
    assert part.kind == "branch" and part.stated
    assert near(np.array(part.point), branch[1])
    flexure = line.arc_length[np.argmin(np.linalg.norm(line.points - branch[0], axis=1))]
    assert part.at == pytest.approx(flexure, abs=15.0)


def test_a_component_that_is_not_joined_stands_in_the_verdict(tract, both) -> None:
    bare, study = both
    part = Component(volume=0.3 * bare.volume, point=(0.0, 0.0, 0.0), label_names=("caecum",))
    torn = replace(
        study, unreached=find_unreached(replace(bare, not_reached=(part,)), study.field, study.line)
    )
    summary = torn.to_dict()
    (record,) = summary["unreached"]
    assert record["kind"] == "component"
    assert record["share"] == pytest.approx(0.3 / 1.3, rel=0.01)
    verdict = judge_plan(torn.plan, summary)
    assert "of the lumen not reached" in verdict.label and verdict.tone == "amber"
    assert verdict.label.startswith("Reaches the end of a part") and not torn.fits
    assert "separate component (caecum)" in verdict.sentence
    # A side branch is part of the lumen, too; it is not, where the goal was given.
    forked = replace(torn, unreached=(replace(torn.unreached[0], kind="branch"),))
    assert not forked.fits
    assert forked.verdict.label.startswith("Reaches the far end, proved; 23 % of the lumen not")
    assert replace(forked, centreline=replace(forked.centreline, goal_given=True)).fits
    whole = judge_plan(study.plan, study.to_dict())
    assert whole.label.startswith("Fits, proved") and "lumen" not in whole.label


def test_missing_lumen_and_landmarks_outside_stand_in_the_verdict(tract, both) -> None:
    bare, study = both
    far = (0.0, 0.0, -125.0)
    marks = {"ileocaecal valve": far, "ICV": far, "flexure": (0.0, 0.0, 50.0)}
    gone = Component(volume=0.07 * bare.volume, point=(0.0, 0.0, -110.0))
    lacking = replace(bare, missing=(gone,), landmarks=marks)
    torn = replace(study, unreached=find_unreached(lacking, study.field, study.line))
    assert [part.kind for part in torn.unreached] == ["missing", "landmark"]
    verdict = judge_plan(torn.plan, torn.to_dict())
    size = f"{gone.volume / 1000.0:.3g} mL of lumen are missing in the file"
    assert f"{size}; not reached: ileocaecal valve." in verdict.sentence
    assert verdict.label.endswith("lumen is missing in the file") and verdict.tone == "amber"
    assert "; 7 % of the lumen" in verdict.label and not verdict.label.startswith("Fits")
    assert not torn.fits


def test_the_error_of_a_surface_is_not_known_unless_it_is_stated(both) -> None:
    study = both[1]
    proved = study.plan.proved
    bare = study.to_dict() | {"wall_error_mm": None}
    verdict = judge_plan(study.plan, bare)
    assert verdict.tone == "amber" and verdict.label.startswith("Fits this surface, proved; ")
    assert "own error is not known" in verdict.label
    assert "--label-error" in verdict.notes[-1]
    for stated, tone in ((0.5 * proved, "green"), (2.0 * proved, "amber")):
        verdict = judge_plan(study.plan, bare | {"label_error_mm": stated})
        assert verdict.tone == tone and "not known" not in verdict.label


def test_surface_and_voxels_of_one_lumen_agree() -> None:
    from skimage.measure import marching_cubes

    step = 3.0
    grid = np.stack(np.meshgrid(*[np.arange(-18.0, 19.0, step)] * 2, np.arange(0.0, 91.0, step),
                                indexing="ij"), axis=-1)  # fmt: skip
    line = np.array([[0.0, 0.0, 12.0], [0.0, 0.0, 78.0]])
    mask = curve_distance(line, 8.0)(grid) < 0.0
    corners, faces, _, _ = marching_cubes(mask.astype(np.float32), 0.5, spacing=(step,) * 3)
    ask = {"scope": Scope(diameter=8.0, link_length=8.0), "method": "follow"}
    made = plan(replace(tract_from_surface(corners, faces), organ="colon"), **ask)
    voxels = tract_from_labels(mask.astype(np.uint16), np.diag([step] * 3 + [1.0]), source="v")
    same = plan(replace(voxels, organ="colon"), **ask)
    assert made.plan.certified and same.plan.certified
    assert made.verdict.tone == same.verdict.tone == "amber"
    # The voxels that it was made from are seen, and half of their diagonal is named.
    assert f"{0.5 * np.sqrt(3.0) * step:.2f} mm" in made.verdict.notes[-1]
    assert made.to_dict()["verdict"]["label"] == made.verdict.label


def test_a_proof_below_the_error_of_the_wall_is_amber(both) -> None:
    study = both[1]
    for error, tone, label in (
        (1e-3, "green", "Fits, proved"),
        (9.0, "amber", "Fits, proved for the stated wall"),
    ):
        verdict = judge_plan(study.plan, study.to_dict() | {"wall_error_mm": error})
        assert (verdict.tone, verdict.label) == (tone, label)


@pytest.mark.parametrize(("share", "fits"), [(0.42, False), (0.03, False), (0.015, True)])
@pytest.mark.parametrize("kind", ["branch", "missing", "before", "beyond"])
def test_a_lumen_not_reached_is_no_fit_and_its_share_is_in_the_label(both, share, fits, kind):
    part = Unreached(kind=kind, volume=100.0, share=share, point=(0.0, 0.0, 0.0), length=5.0)
    study = replace(both[1], unreached=(part,))
    fits = fits and kind != "missing"  # of that nothing is known, however little it is
    assert study.fits is study.to_dict()["fits"] is fits
    verdict = study.verdict
    if not fits:
        assert f"{100 * share:.0f} % of the lumen" in verdict.label
        assert "Fits" not in verdict.label and verdict.tone == "amber"


def test_a_small_part_is_less_than_one_percent() -> None:
    part = Unreached(kind="component", volume=99.0, share=0.0002, point=(0.0, 0.0, 0.0))
    assert "(<1 % of the lumen)" in part.words and not part.stated


@pytest.mark.parametrize("where", [45.0, 60.0, 80.0])
def test_a_sheet_across_the_lumen_parts_it(where) -> None:
    tube = trimesh.creation.cylinder(radius=8.0, segment=[[0, 0, 0], [0, 0, 120.0]])
    sheet = np.array([[-15, -15, where], [15, -15, where], [15, 15, where], [-15, 15, where]])
    faces = np.concatenate([tube.faces, np.array([[0, 1, 2], [0, 2, 3]]) + len(tube.vertices)])
    closed = tract_from_surface(np.concatenate([tube.vertices, sheet]), faces)
    field = build_field(closed)
    line = find_centreline(field)
    parts = find_unreached(closed, field, line)
    assert [part.kind for part in parts] == ["component"]
    rest = (where if line.points[0, 2] > where else 120.0 - where) / 120.0
    assert parts[0].share == pytest.approx(rest, abs=0.03)
    assert np.sign(parts[0].point[2] - where) != np.sign(line.points[0, 2] - where)


def test_a_septum_that_closes_the_lumen_is_no_fit() -> None:
    whole = make_tract(HOOK)
    centres = np.indices(whole.labels.shape)[0] * VOXEL + whole.affine[0, 3]
    labels = np.where((centres > 29.0) & (centres < 31.0) & (whole.labels > 0), 0, whole.labels)
    closed = replace(tract_from_labels(labels, whole.affine, source="tube"), organ="colon")
    study = plan(closed, method="follow")
    assert study.plan.status == "complete" and study.plan.certified
    assert not study.fits and not study.to_dict()["fits"]
    verdict = judge_plan(study.plan, study.to_dict())
    assert verdict.label.startswith("Reaches the end of a part, proved")
    asked = plan(closed, method="follow", end=study.line.points[-1])
    assert asked.fits
    assert judge_plan(asked.plan, asked.to_dict()).label.startswith("Fits to the given end")


HOOK = np.array([[26.0, 0, 0], [60.0, 0, 0], [60.0, 0, 50.0], [0, 0, 50.0], [0, 0, -40.0]])
# Its one end points at its other limb, across a few mm of tissue.


@pytest.mark.parametrize(
    ("ends", "crosses"),
    [
        ({"organ": "colon"}, ""),
        ({"start": HOOK[-1], "end": HOOK[0]}, ""),
        ({"start": HOOK[0], "end": HOOK[-1]}, "lumen of the tract again"),
        ({"end": HOOK[-1]}, "lumen of the tract again"),
        ({"start": (0.0, 0.0, 5.0), "end": HOOK[0]}, "the wall of lumen that goes on"),
        ({"start": (30.0, 0.0, 50.0), "end": HOOK[0]}, "the wall of lumen that goes on"),
        ({"start": (2.0, 0.0, 48.0), "end": HOOK[0]}, "the wall of lumen that goes on"),
        ({"start": (0.0, 0.0, 0.0), "end": HOOK[-1]}, "the wall of lumen that goes on"),
        ({"start": (2.0, 3.0, -36.0), "end": HOOK[0]}, ""),
    ],
)
def test_an_introducer_through_the_wall_is_stated(ends, crosses) -> None:
    ends = dict(ends)
    hook = replace(make_tract(HOOK), organ=ends.pop("organ", "upper-tract"))
    study = plan(hook, method="follow", **ends)
    found = [item for item in study.findings if item.code == "introducer-crosses"]
    verdict = judge_plan(study.plan, study.to_dict())
    assert study.plan.status == "complete"
    assert ("the introducer crosses" in verdict.label) == bool(crosses) == bool(found)
    if not crosses:
        return
    assert crosses in found[0].message and crosses in verdict.sentence
    assert verdict.tone == "amber"
    # The place that is named is on the introducer, and at a wall of the lumen.
    place = np.array([float(v) for v in found[0].message.split("(")[1].split(")")[0].split(",")])
    tube = study.plan.introducer
    off = np.cross(place - tube.entry, tube.outward)
    assert np.linalg.norm(off) <= tube.bore
    assert abs(float(study.field.signed_distance(place))) < VOXEL


def test_two_tubes_in_one_field_are_two_components() -> None:
    far = COLON + [0.0, 60.0, 0.0]
    first = make_tract(COLON, far)  # the tract keeps one of them
    assert len(first.not_reached) == 1
    field = build_field(first)
    (part,) = find_unreached(first, field, find_centreline(field))
    assert part.share == pytest.approx(0.5, abs=0.05)
    assert part.kind == "component"


def test_the_verdict_states_up_to_which_wall_error_the_proof_holds(both) -> None:
    summary = both[1].to_dict()
    proved = summary["clearance_certified_mm"]
    assert proved > 0.0
    for stated, covers in ((0.5 * proved, True), (2.0 * proved, False)):
        asked = replace(both[1], label_error=stated)
        assert asked.fits is covers  # the user asked for it
        verdict = judge_plan(asked.plan, asked.to_dict())
        (note,) = verdict.notes
        assert ("does not cover" in note) is not covers
        assert (verdict.tone == "green") is covers
        assert f"{ceil_mm(summary['wall_error_mm'])} mm" in note


@pytest.mark.parametrize("frame", ["RAS", "LPS", "LSA"])
def test_files_for_other_tools_keep_the_place(tract, tmp_path: Path, frame: str) -> None:
    field = build_field(tract)
    line = find_centreline(field)
    write_centreline(line, tmp_path, frame=frame)
    write_volumes(field, tract, tmp_path, frame=frame)
    to_ras = {
        "RAS": np.eye(3),
        "LPS": np.diag([-1.0, -1.0, 1.0]),
        "LSA": np.array([[-1.0, 0, 0], [0, 0, 1.0], [0, 1.0, 0]]),
    }[frame]
    (curve,) = json.loads((tmp_path / "centreline.mrk.json").read_text(encoding="utf-8"))["markups"]
    points = np.array([item["position"] for item in curve["controlPoints"]])
    system = frame if frame != "LSA" else "RAS"
    assert curve["coordinateSystem"] == system
    expected = line.points if frame != "LSA" else line.points @ to_ras.T
    assert points == pytest.approx(expected, abs=1e-3)
    piece = ElementTree.parse(tmp_path / "centreline.vtp").getroot().find("PolyData/Piece")
    arrays = {
        item.get("Name"): np.array((item.text or "").split(), dtype=float)
        for item in piece.iter("DataArray")
    }
    assert arrays["Points"].reshape(-1, 3) == pytest.approx(line.points, abs=1e-3)
    assert arrays["MaximumInscribedSphereRadius"] == pytest.approx(line.radius, abs=1e-4)
    assert arrays["ArcLength"] == pytest.approx(line.arc_length, abs=1e-2)
    # A world point, turned to RAS+ by hand, finds its own voxel in both volumes.
    for name in ("field", "labels"):
        image = nibabel.load(tmp_path / f"{name}.nii.gz")
        data, inverse = np.asarray(image.dataobj), np.linalg.inv(image.affine)
        ras = line.points[::20] @ to_ras.T
        at = np.rint(ras @ inverse[:3, :3].T + inverse[:3, 3]).astype(int)
        found = data[tuple(at.T)]
        if name == "field":
            centres = (at @ image.affine[:3, :3].T + image.affine[:3, 3]) @ to_ras
            assert found == pytest.approx(field.signed_distance(centres), abs=1e-3)
        else:
            assert np.all(found > 0)


def test_the_labels_of_an_export_are_those_of_the_tract(tract, tmp_path: Path) -> None:
    write_volumes(build_field(tract), tract, tmp_path, frame="RAS")
    write_tract(tmp_path / "own.nii.gz", tract)
    exported, own = (nibabel.load(tmp_path / f"{name}.nii.gz") for name in ("labels", "own"))
    assert np.array_equal(np.asarray(exported.dataobj), np.asarray(own.dataobj))
    assert exported.affine == pytest.approx(own.affine)
    assert exported.header == own.header


def test_a_named_end_is_searched_once(tract, monkeypatch: pytest.MonkeyPatch) -> None:
    found = []

    def search(*given, **known):
        found.append(given)
        return find_centreline(*given, **known)

    monkeypatch.setattr("bozzini.study.ends.find_centreline", search)
    field = build_field(tract)
    named = orient_centreline(tract, field, resolve_places(tract, "appendix tip", None))
    assert len(found) == 1
    again = find_centreline(field, (named.line.points[0], None))
    assert named.line.length == pytest.approx(again.length, rel=0.01)
    assert near(named.line.points[-1], again.points[-1], 2.0)


def test_options_know_every_organ_method_and_shape() -> None:
    assert options.ORGANS == ORGANS
    fields = options.InsertionOptions.__dataclass_fields__
    assert fields["method"].metadata["quantity"].words == tuple(PLANNERS)
    assert options.FITTED_KINDS == KINDS
    assert options.INFLATION_MAX == INFLATION_MAX


def test_many_other_ends_are_counted() -> None:
    others = tuple(OtherEnd(end="end", point=(0.0, 0.0, 1.0 * k), distance=50.0) for k in range(5))
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 9.0]])
    line = Centreline(points=points, arc_length=points[:, 2], radius=np.ones(2), other_ends=others)
    said = [finding.message for finding in list_branches(line)]
    assert len(said) == 4 and "2 more ends were found" in said[-1]
    assert "more" not in "".join(
        f.message for f in list_branches(replace(line, other_ends=others[:3]))
    )
