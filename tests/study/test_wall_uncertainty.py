"""Contact of a plan with a wall that is off: against tails, limits, and displaced walls."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.measure import marching_cubes

from bozzini.anatomy import LabelTract, SurfaceTract, make_phantom
from bozzini.cli.main import main
from bozzini.duct import Centreline, RoundCones, build_field, find_centreline
from bozzini.errors import BozziniError, InputError
from bozzini.motion import Certificate, Scope, certify_plan, plan_insertion
from bozzini.motion.recheck import surface_wall
from bozzini.motion.verify import build_wall
from bozzini.study import ContactRiskOptions, WallError, bound_contact, study_contact
from bozzini.study.contact_risk import _WallToMove, displace_wall, replan_draws
from bozzini.study.wall import (
    choose_deciding,
    count_interval,
    draw_reaches,
    draw_stations,
    sample_body,
)
from tests.exact import body_points, outside_introducer, voxelise
from tests.shapes import bend_curve, curve_distance

CURVE = bend_curve(25.0, 1.0, 16.0)
RADIUS = 4.0
SCOPE = Scope(diameter=6.0, link_length=6.0)


def mesh_tube(radius=RADIUS, voxel=1.0):
    low, high = CURVE.min(axis=0) - radius - 3.0, CURVE.max(axis=0) + radius + 3.0
    axes = [np.arange(a, b, voxel) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distance = curve_distance(CURVE, radius)(points)
    vertices, faces, _, _ = marching_cubes(distance, level=0.0, spacing=(voxel,) * 3)
    return SurfaceTract(vertices=vertices + low, faces=faces.astype(np.int64), source="tube")


@pytest.fixture(scope="module")
def case():
    """A plan in a tube as triangles, the tube, its field, and the body's samples."""
    tract = mesh_tube()
    duct = build_field(tract)
    line = Centreline.from_points(CURVE, duct)
    plan = plan_insertion(duct, line, scope=SCOPE, method="tube")
    assert plan.certified and plan.status == "complete"
    return plan, tract, duct, sample_body(plan, duct, build_wall(tract))


# An error that is the same everywhere.


@given(
    st.floats(0.0, 5.0), st.floats(-1.0, 1.0), st.floats(0.05, 3.0), st.floats(0.0, 0.003)
)  # fmt: skip
def test_a_uniform_offset_is_the_tail_at_the_clearance(clearance, mean, sd, gap):
    proof = Certificate(clearance=clearance, found=clearance + gap)
    low, high = WallError(sd=sd, mean=mean).bound_contact(proof)
    for bound, at in ((high, clearance), (low, clearance + gap)):
        assert bound == pytest.approx(0.5 * math.erfc((at - mean) / sd / math.sqrt(2)), abs=1e-9)
    evenly = bound_contact(proof, scipy.stats.uniform(-1.0, 4.0))
    assert evenly[1] == pytest.approx(min(max((3.0 - clearance) / 4.0, 0.0), 1.0), abs=1e-12)


def test_what_is_not_proved_bounds_nothing_and_what_never_enters_touches_nothing():
    offset = scipy.stats.norm(0.0, 0.5)
    assert bound_contact(Certificate(clearance=-0.2, found=0.3), offset)[1] == 1.0
    assert bound_contact(Certificate(), offset) == (0.0, 0.0)
    with pytest.raises(InputError, match="distribution of scipy"):
        bound_contact(Certificate(), 0.5)


@pytest.fixture(scope="module")
def analytic():
    duct = RoundCones(CURVE, np.full(len(CURVE), RADIUS))
    plan = plan_insertion(
        duct, Centreline.from_points(CURVE, duct), scope=replace(SCOPE, diameter=4.0), method="tube"
    )
    # Narrow enough for every wall of the test.
    return replace(plan, introducer=replace(plan.introducer, bore=2.2))


@given(offset=st.floats(0.01, 1.7))
def test_a_narrower_duct_takes_exactly_the_offset_off(analytic, offset):
    narrow = RoundCones(CURVE, np.full(len(CURVE), RADIUS - offset))
    wide = RoundCones(CURVE, np.full(len(CURVE), RADIUS))
    known = certify_plan(analytic, wide, tolerance=0.003, settle=False)
    found = certify_plan(analytic, narrow, tolerance=0.003, settle=False)
    assert found.clearance == pytest.approx(known.clearance - offset, abs=1e-9)
    assert found.found == pytest.approx(known.found - offset, abs=1e-9)
    # So that the plan is certified if and only if the offset is below the clearance.
    assert found.certified == (offset <= known.clearance)


# The random field.


def test_a_draw_depends_on_its_number_alone_and_on_no_other_place():
    places = np.random.default_rng(1).uniform(-100.0, 300.0, (5000, 3))
    error = WallError(sd=0.7, correlation=8.0, mean=0.1)
    whole = error.draw(places, seed=3, number=7)
    some = np.array([4999, 17, 4096, 4095, 0])
    assert np.array_equal(error.draw(places[some], seed=3, number=7), whole[some])
    for other in ({"seed": 4, "number": 7}, {"seed": 3, "number": 8}):
        assert np.abs(error.draw(places, **other) - whole).max() > 0.5


def test_draws_are_the_same_whatever_the_parts(case):
    plan, _, _, samples = case
    error = WallError(sd=0.4)
    whole = draw_reaches(samples, error, seed=2, numbers=range(30))
    parts = [
        draw_reaches(samples, error, seed=2, numbers=numbers)
        for numbers in (range(11), range(11, 12), range(12, 30))
    ]
    for k in range(2):
        assert np.array_equal(whole[k], np.concatenate([part[k] for part in parts]))


@pytest.mark.parametrize("away", [0.0, 3.0, 8.0, 16.0, 60.0])
def test_the_field_has_the_stated_mean_deviation_and_correlation(away):
    error, count = WallError(sd=0.5, correlation=8.0, mean=-0.2), 3000
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    places = np.array([50.0, 20.0, 90.0]) + np.outer([0.0, away], direction)
    drawn = np.array([error.draw(places, seed=5, number=k) for k in range(count)])
    assert np.abs(drawn.mean(axis=0) + 0.2).max() < 4.0 * 0.5 / math.sqrt(count)
    wanted = 0.25 * math.exp(-(away**2) / 128.0)
    assert np.cov(drawn.T)[0, 1] == pytest.approx(wanted, abs=4.0 * 0.25 * math.sqrt(2.0 / count))
    assert scipy.stats.kstest((drawn[:, 0] + 0.2) / 0.5, "norm").pvalue > 1e-3


# The body's samples.


def test_samples_lie_between_the_certificate_and_the_body(case):
    plan, _, duct, samples = case
    proof = certify_plan(plan, duct, tolerance=0.003)
    nearest = samples.distance.min() - SCOPE.radius
    # Exact distances are never below what is proved, and the field's bound is not far below.
    assert proof.clearance <= nearest + 1e-9
    assert nearest <= proof.clearance + 0.3
    feet = np.linalg.norm(samples.points - samples.foot, axis=1)
    assert np.allclose(feet, np.abs(samples.distance), atol=1e-9)
    assert outside_introducer(samples.points, plan.introducer, SCOPE.radius).all()


def test_no_place_of_the_body_is_nearer_to_the_wall_than_the_samples_say(case):
    plan, tract, _, samples = case
    random = np.random.default_rng(0)
    step = random.integers(0, plan.steps, 20_000).astype(float)
    link = random.integers(1, plan.links + 1, len(step))
    points = body_points(plan.joints, step, link, random.uniform(0.0, 1.0, len(step)))
    inside = (points - plan.introducer.entry) @ plan.introducer.outward < 0.0
    clearance = build_wall(tract).measure_clearance(points[inside])
    # Samples are 0.25 mm apart, and the field that chooses one of a cube is not exact.
    assert samples.distance.min() <= clearance.min() + 0.05


# Kept plans in random walls.


def measure_brute(plan, tract, samples, error, count, duct):
    """Displace the wall, and measure all samples that are not far from it: (count,) [mm]."""
    near = samples.distance < samples.distance.min() + 6.0 * error.sd + 1.0
    points = samples.points[near]
    least, wall = [], _WallToMove.of(tract, duct)
    moved = displace_wall(tract, error, seed=1, number=0, duct=duct)
    assert np.array_equal(moved.vertices, wall.move(error, seed=1, number=0))
    for number in range(count):
        vertices = wall.move(error, seed=1, number=number)
        least.append(surface_wall(vertices, moved.faces).measure_clearance(points).min())
    return np.array(least)


@pytest.mark.slow
def test_first_order_agrees_with_displaced_walls(case):
    plan, tract, duct, samples = case
    error = WallError(sd=0.4, correlation=12.0)
    deciding = choose_deciding(samples, error, SCOPE.radius)
    reach, _ = draw_reaches(deciding, error, seed=1, numbers=range(25))
    brute = measure_brute(plan, tract, samples, error, 25, duct)
    assert np.std(reach - brute) < 0.03
    assert abs(np.mean(reach - brute)) < 0.03
    assert 0.05 < np.mean(brute < SCOPE.radius) < 0.95
    assert abs(np.mean(reach < SCOPE.radius) - np.mean(brute < SCOPE.radius)) <= 0.05


@pytest.fixture(scope="module")
def phantom_case():
    """A plan in a phantom as triangles, the phantom, its field, and the body's samples."""
    tract = make_phantom(seed=3).to_surface(2.0)
    duct = build_field(tract, voxel=1.5)
    scope = Scope(diameter=8.0, link_length=10.0)
    plan = plan_insertion(duct, find_centreline(duct), scope=scope, method="tube")
    return plan, tract, duct, sample_body(plan, duct, build_wall(tract))


@pytest.mark.slow
@pytest.mark.parametrize(("sd", "correlation"), [(0.5, 10.0), (0.25, 10.0), (0.5, 30.0)])
def test_first_order_agrees_with_displaced_walls_of_a_phantom(phantom_case, sd, correlation):
    plan, tract, duct, samples = phantom_case
    # As wide a body as gives a probability that is neither 0 nor 1.
    radius = samples.distance.min() - 1.5 * sd
    error = WallError(sd=sd, correlation=correlation)
    deciding = choose_deciding(samples, error, radius)
    reach, _ = draw_reaches(deciding, error, seed=1, numbers=range(30))
    brute = measure_brute(plan, tract, samples, error, 30, duct)
    assert np.std(reach - brute) <= 0.03
    share = np.mean(brute < radius)
    assert 0.02 < share < 0.98
    assert abs(np.mean(reach < radius) - share) <= 0.05


@pytest.mark.slow
def test_one_error_everywhere_is_the_limit_of_a_long_correlation(case):
    plan, _, _, samples = case
    error = WallError(sd=0.5, correlation=1e4)
    deciding = choose_deciding(samples, error, SCOPE.radius)
    reach, _ = draw_reaches(deciding, error, seed=1, numbers=range(4000))
    tail = scipy.stats.norm.sf((samples.distance.min() - SCOPE.radius) / 0.5)
    hits = int((reach < SCOPE.radius).sum())
    assert scipy.stats.binomtest(hits, len(reach), tail).pvalue > 1e-3
    # Errors of their own along the way make contact likelier.
    short, _ = draw_reaches(
        choose_deciding(samples, WallError(sd=0.5, correlation=8.0), SCOPE.radius),
        WallError(sd=0.5, correlation=8.0),
        seed=1,
        numbers=range(150),
    )
    assert np.mean(short < SCOPE.radius) > tail + 0.1


def test_samples_that_cannot_decide_are_rightly_left_out(case):
    plan, _, _, samples = case
    error = WallError(sd=0.3)
    few = choose_deciding(samples, error, SCOPE.radius)
    some, _ = draw_reaches(few, error, seed=1, numbers=range(20))
    everything, _ = draw_reaches(samples, error, seed=1, numbers=range(20))
    assert (everything <= some + 1e-12).all()
    assert np.abs(everything - some).max() < 0.05


@pytest.fixture(scope="module")
def found(case):
    plan, tract, duct, _ = case
    options = ContactRiskOptions(sd=0.4, draws=300, replan=3, diameters=(4.0, 5.5, 6.0, 6.5, 8.5))
    return study_contact(plan, tract, options=options, duct=duct)


@pytest.mark.slow
def test_the_probability_rises_with_the_diameter(found):
    table = found.over_diameters
    assert (np.diff(table["contact"]) >= 0.0).all()
    assert table["contact"][0] < 0.01 and table["contact"][-1] == 1.0
    assert table["contact"][2] == found.contact
    assert (table["contact_low"] <= table["contact"]).all()
    assert (table["contact"] <= table["contact_high"]).all()


@pytest.mark.slow
def test_another_diameter_from_the_same_draws_is_that_body_s_own_study(case, found):
    plan, tract, duct, _ = case
    thin = replace(plan, scope=replace(plan.scope, diameter=5.5))
    own = study_contact(
        thin, tract, options=ContactRiskOptions(sd=0.4, draws=300, diameters=(8.5,)), duct=duct
    )
    assert own.contact == pytest.approx(found.over_diameters["contact"][1], abs=0.003)
    assert np.allclose(own.clearance, found.clearance + 0.25, atol=0.05)


@pytest.mark.slow
def test_the_way_shows_where_the_clearance_goes(case, found):
    plan, _, _, samples = case
    along = found.stations
    assert along.nominal.min() == pytest.approx(found.nearest)
    assert (np.diff(along.quantiles, axis=1) >= 0.0).all()
    whole = found.clearance[: along.draws]
    # The least of one station is not below the least of all, but for cells of another size.
    assert along.contact.max() <= np.mean(whole < 0.0) + 0.02
    assert along.quantiles[:, 1].min() >= np.median(whole) - 0.03
    again = draw_stations(samples, found.error, radius=SCOPE.radius, seed=1, draws=20)
    assert np.allclose(again.nominal, along.nominal)
    assert found.place.min() >= 0.0 and found.place.max() <= plan.path_arc_length[-1] + 1e-9


@settings(max_examples=20)
@given(count=st.integers(1, 500), share=st.floats(0.0, 1.0))
def test_the_interval_holds_the_share_and_shrinks_with_the_draws(count, share):
    hits = round(share * count)
    low, high = count_interval(hits, count)
    assert 0.0 <= low <= hits / count <= high <= 1.0
    wide, narrow = high - low, np.diff(count_interval(100 * hits, 100 * count))[0]
    assert narrow < wide
    # Exact: the ends are where so many hits have a tail of 2.5 %.
    if hits < count:
        assert scipy.stats.binom.cdf(hits, count, high) == pytest.approx(0.025, abs=1e-6)


def test_where_first_order_is_doubtful_a_note_says_so(case):
    plan, tract, duct, _ = case

    def list_notes(**given):
        options = ContactRiskOptions(draws=1, **given)
        return " ".join(study_contact(plan, tract, options=options, duct=duct).notes)

    assert "doubtful" not in list_notes(sd=0.3, correlation=10.0)
    assert "is less than 2 times the distance" in list_notes(sd=0.1, correlation=5.0)
    assert "sd over correlation length" in list_notes(sd=1.5, correlation=10.0)


# Planned anew.


def test_a_wall_with_a_mean_alone_is_moved_by_that():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    tract = SurfaceTract(
        vertices=np.array(ball.vertices), faces=np.array(ball.faces), source="ball"
    )
    moved = displace_wall(tract, WallError(sd=1e-9, mean=0.5), seed=0, number=0)
    assert np.allclose(np.linalg.norm(moved.vertices, axis=1), 9.5, atol=1e-4)
    assert 0.0 < moved.volume < tract.volume


def test_plans_anew_are_certified_in_the_displaced_wall(case, found):
    plan, tract, duct, samples = case
    again = found.replanned
    assert 0 < again.failed + np.isfinite(again.clearance).sum() == 3
    for number, proved in enumerate(again.clearance):
        moved = displace_wall(tract, found.error, seed=1, number=number, duct=duct)
        wall = surface_wall(moved.vertices, moved.faces)
        kept = wall.measure_clearance(samples.points).min() - SCOPE.radius
        assert kept == pytest.approx(found.clearance[number], abs=0.06)
        assert bool(again.reasons[number]) == bool(np.isnan(proved))
        if kept > 0.2:  # the plan as it is would do
            assert proved > 0.0
        if again.kept[number]:
            assert proved <= kept + 0.05
        if np.isnan(proved):
            assert again.rebuilt[number]


def test_where_the_wall_closes_no_plan_is_found_and_the_reason_is_given(case):
    plan, tract, duct, _ = case
    closed = WallError(sd=0.05, mean=1.3)
    options = ContactRiskOptions(replan=1)
    again = replan_draws(plan, tract, closed, duct=duct, options=options)
    assert again.failed == 1 and again.rebuilt.all() and all(again.reasons)
    assert again.interval[1] == 1.0


def test_a_plan_that_stops_cannot_be_planned_anew(case):
    plan, tract, duct, _ = case
    stopped = replace(plan, status="stopped", reason_code="NO_PASSAGE", reason="too narrow")
    with pytest.raises(InputError, match="stopped"):
        replan_draws(
            stopped, tract, WallError(sd=0.1), duct=duct, options=ContactRiskOptions(replan=1)
        )


def test_labels_have_a_deviation_of_their_own_and_are_planned_anew():
    mask, affine = voxelise(CURVE, 5.0)
    tract = LabelTract(labels=mask.astype(np.uint16), affine=affine, source="tube")
    duct = build_field(tract)
    plan = plan_insertion(duct, Centreline.from_points(CURVE, duct), scope=SCOPE, method="tube")
    result = study_contact(plan, tract, options=ContactRiskOptions(draws=200, replan=2), duct=duct)
    assert result.error.sd == pytest.approx(1.0 / math.sqrt(12.0))
    assert "rounding to voxels" in result.notes[0]
    # The faces of voxels stand inwards of the tube by up to half a voxel.
    assert result.uniform[0] <= result.uniform[1] <= 1.0
    assert result.replanned.failed < 2


def test_a_surface_needs_a_deviation(case):
    plan, tract, duct, _ = case
    with pytest.raises(InputError, match="sd is not given"):
        study_contact(plan, tract, duct=duct)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"sd": 0.0}, r"sd is 0 mm: it must lie in \(0, 20\] mm"),
        ({"correlation": 0.01}, "correlation is 0.01 mm"),
        ({"draws": 0}, "draws is 0"),
        ({"draws": 5, "replan": 6}, "at most the number of draws"),
        ({"diameters": (3.0, -1.0)}, r"diameters\[1\] is -1 mm"),
    ],
)
def test_what_is_not_legal_is_named(given, words):
    with pytest.raises(BozziniError, match=words):
        ContactRiskOptions(**given)


# The command.


@pytest.fixture(scope="module")
def files(case, tmp_path_factory):
    plan, tract, _, _ = case
    folder = tmp_path_factory.mktemp("uncertainty")
    trimesh.Trimesh(tract.vertices, tract.faces, process=False).export(folder / "tube.ply")
    trimesh.Trimesh(tract.vertices + 9.0, tract.faces, process=False).export(folder / "other.ply")
    plan.save(folder / "plan.npz")
    return folder


def call(capsys, *arguments):
    capsys.readouterr()
    code = main(["uncertainty", *map(str, arguments), "--quiet"])
    return code, *capsys.readouterr()


@pytest.mark.slow
def test_the_command_writes_tables_a_figure_and_a_report(capsys, files, tmp_path):
    given = (files / "plan.npz", files / "tube.ply", "--sd", "400um", "--draws", "100")
    code, out, err = call(
        capsys, *given, "--diameters", "4mm,0.6cm", "--replan", "2", "--json",
        "--out", tmp_path / "a",
    )  # fmt: skip
    assert code == 0, err
    summary = json.loads(out)
    assert summary["files"] == sorted(path.name for path in (tmp_path / "a").iterdir())
    assert summary["contact_kept"]["low"] < summary["contact_kept"]["share"]
    assert summary["replanned"]["draws"] == 2
    rows = (tmp_path / "a" / "draws.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 101
    touched = sum(row.split(",")[4] == "True" for row in rows[1:])
    assert touched / 100 == pytest.approx(summary["contact_kept"]["share"])
    sizes = (tmp_path / "a" / "diameters.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert [float(row.split(",")[0]) for row in sizes] == [4.0, 6.0]
    page = (tmp_path / "a" / "report.html").read_text(encoding="utf-8")
    assert "no certified plan after planning anew, the same 2" in page and "<script" not in page
    code, out, _ = call(capsys, *given, "--out", tmp_path / "b", "--json")
    assert json.loads(out)["contact_kept"] == summary["contact_kept"]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("plan.npz",), "give the file that it was made from too"),
        (("tube.ply", "tube.ply"), "is not a Bozzini plan"),
        (("plan.npz", "other.ply", "--sd", "0.3mm"), "is not what the plan was made from"),
        (("plan.npz", "tube.ply"), "sd is not given"),
        (("plan.npz", "tube.ply", "--sd", "0.3mm", "--diameters", "4mm,-2mm"), "diameters[1]"),
        (("plan.npz", "tube.ply", "--sd", "30mm"), "sd is 30 mm: it must lie in (0, 20] mm"),
    ],
)
def test_wrong_input_is_one_line_and_nothing_is_written(capsys, files, tmp_path, given, words):
    names = [files / word if word.endswith((".npz", ".ply")) else word for word in given]
    code, out, err = call(capsys, *names, "--out", tmp_path / "out")
    assert code == 2 and out == ""
    lines = err.strip().splitlines()
    assert len([line for line in lines if "warning" not in line]) == 1 and words in err
    assert not (tmp_path / "out").exists()
