"""A plan becomes tendon displacements: what is executed is clear, or it is said why not."""

from __future__ import annotations

import csv
import math
from dataclasses import replace

import numpy as np
import pytest

from bozzini.continuum import ArcModel, ContinuumRobot, Helix, Section, Tendon
from bozzini.continuum.coupling import coupling_matrix
from bozzini.errors import FileFormatError, GeometryError, InputError, MissingExtraError
from bozzini.motion import FreeSpace, Introducer, Scope
from bozzini.motion.actuate.actuate import actuate_plan
from bozzini.motion.actuate.actuation import ACTUATION_CODES, Actuation
from bozzini.motion.actuate.executed import certify_arcs
from bozzini.motion.plan import read_record
from tests.motion.actuate.motions import EXACT, make_plan, make_robot, make_tube, place_at
from tests.motion.plans import insert


@pytest.fixture(scope="module")
def tube():
    return make_tube()[0]


@pytest.fixture(scope="module")
def plan():
    return make_plan()


@pytest.fixture(scope="module")
def moved(plan, tube):
    return actuate_plan(plan, make_robot(20.0, 6), tube)


def test_the_robot_gets_there_and_it_is_proved(moved, plan):
    assert moved.fits and moved.status == "complete" and moved.reason == ""
    assert moved.steps == plan.steps
    assert np.array_equal(moved.head_arc_length, plan.head_arc_length)
    assert moved.certificate.clearance <= moved.clearance.min()


def test_the_proof_holds_at_random_times_against_the_exact_wall(moved):
    random = np.random.default_rng(5)
    places = [
        place_at(moved, random.uniform(0.0, moved.steps - 1.0), random.uniform(0.0, 120.0))
        for _ in range(3000)
    ]
    away = np.array(places) - moved.frame[:3, 3]
    outside = away @ moved.frame[:3, 2] > 0.0
    exact = -EXACT(np.array(places)[outside]) - moved.robot.radius
    assert outside.sum() > 500
    assert exact.min() >= moved.certificate.clearance
    # Clearance at the steps is an estimate; between steps it is hardly smaller.
    assert exact.min() >= moved.clearance.min() - 0.3


def test_the_table_through_the_public_model_gives_the_certified_body(moved, tmp_path):
    with moved.write_csv(tmp_path / "tendons.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    assert tuple(rows[0]) == moved.columns
    table = np.array(rows[1:], dtype=float)
    assert np.array_equal(table[:, 0], np.arange(moved.steps))
    assert np.array_equal(table[:, 3:], moved.displacements)  # in full
    model = ArcModel(moved.robot)
    worst = np.inf
    for time in np.linspace(0.0, moved.steps - 1.0, 331):
        row = np.array([np.interp(time, table[:, 0], column) for column in table.T[2:]])
        shape = model.shape(row[1:]).require()
        local = shape.points + [0.0, 0.0, row[0] - moved.robot.length]
        world = local @ moved.frame[:3, :3].T + moved.frame[:3, 3]
        inside = world[local[:, 2] > 0.0]
        if len(inside):
            worst = min(worst, float(-EXACT(inside).max()) - moved.robot.radius)
    assert worst >= moved.certificate.clearance
    assert worst == pytest.approx(moved.clearance.min(), abs=0.5)


def test_displacements_are_those_of_the_bends(moved):
    flat = moved.bends.reshape(moved.steps, -1)
    expected = flat @ coupling_matrix(moved.robot).T
    assert moved.displacements == pytest.approx(expected, abs=1e-12)


def test_the_tip_leads_and_the_body_stays_near_the_path(moved, plan):
    tips = moved.place_body(np.arange(moved.steps))[:, 0]
    ahead = np.array(
        [np.interp(moved.head_arc_length, plan.path_arc_length, row) for row in plan.path.T]
    ).T
    assert np.linalg.norm(tips - ahead, axis=1).max() < moved.fit_max.max() + 0.5
    assert moved.fit_rms.max() < 0.5
    assert (moved.fit_rms <= moved.fit_max + 1e-12).all()
    # Sections wholly in the introducer are straight, and the base never turns back on the way in.
    left = moved.robot.section_ends[None, :] - (moved.robot.length - moved.base_advance[:, None])
    assert np.abs(moved.bends[left <= 0.0]).max(initial=0.0) == 0.0
    assert np.diff(moved.base_advance).min() > 0.0


def test_shorter_sections_come_closer_to_the_path(plan, tube):
    errors = [
        float(np.median(actuate_plan(plan, make_robot(size, count), tube).fit_rms))
        for size, count in ((10.0, 12), (20.0, 6), (40.0, 3))
    ]
    assert errors[0] < 0.7 * errors[1] < 0.5 * errors[2]


def test_finer_steps_change_nothing_but_the_number_of_rows(plan, tube):
    coarse = actuate_plan(plan, make_robot(20.0, 6), tube)
    fine_plan = make_plan(head_step=0.25)
    fine = actuate_plan(
        replace(fine_plan, path=plan.path, path_arc_length=plan.path_arc_length,
                path_radius=plan.path_radius),
        make_robot(20.0, 6),
        tube,
    )  # fmt: skip
    at = np.interp(coarse.head_arc_length, fine.head_arc_length, fine.displacements[:, -1])
    assert at == pytest.approx(coarse.displacements[:, -1], abs=0.02)
    assert fine.certificate.clearance == pytest.approx(coarse.certificate.clearance, abs=0.2)


def test_a_turned_base_needs_turned_tendons(plan, tube):
    roll = 0.7
    plain = actuate_plan(plan, make_robot(20.0, 6), tube)
    turned = actuate_plan(plan, make_robot(20.0, 6, turn=-roll), tube, roll=roll)
    assert turned.displacements == pytest.approx(plain.displacements, abs=1e-6)
    assert turned.place_body([40.0]) == pytest.approx(plain.place_body([40.0]), abs=1e-6)


def test_in_and_out_ends_where_it_began(tube):
    plan = make_plan(route=(1.0, 0.0))
    moved = actuate_plan(plan, make_robot(20.0, 6), tube)
    assert moved.fits
    assert np.abs(moved.displacements[-1]).max() < 1e-6
    out = np.argmax(moved.head_arc_length) // 2
    back = moved.steps - 1 - out
    assert moved.head_arc_length[out] == pytest.approx(moved.head_arc_length[back], abs=1.0)
    assert moved.displacements[out] == pytest.approx(moved.displacements[back], abs=0.1)


def test_limits_are_kept_or_named(plan, tube, moved):
    needed = np.linalg.norm(moved.bends, axis=2).max()
    easy = actuate_plan(plan, make_robot(20.0, 6, max_bend=0.95 * needed), tube)
    assert easy.fits
    assert np.linalg.norm(easy.bends, axis=2).max() <= 0.95 * needed
    hard = actuate_plan(plan, make_robot(20.0, 6, max_bend=0.25 * needed), tube)
    assert (hard.status, hard.reason_code) == ("stopped", "BEND_LIMIT")
    assert "would have to bend" in hard.reason and "section" in hard.reason
    assert hard.meta["shortfall"]["needs"] == pytest.approx(needed, rel=0.05)
    assert hard.meta["shortfall"]["offers"] == pytest.approx(0.25 * needed)
    assert np.linalg.norm(hard.bends, axis=2).max() <= 0.25 * needed
    # What is left of the motion is certified, and could not go on by much.
    assert hard.certified and 1 < hard.steps < plan.steps
    assert hard.head_arc_length[-1] < 60.0


def test_stretches_proved_one_by_one_prove_the_whole(plan, tube, moved):
    hard = actuate_plan(
        plan, make_robot(20.0, 6, max_bend=0.25 * np.linalg.norm(moved.bends, axis=2).max()), tube
    )
    proof = certify_arcs(
        hard.robot,
        hard.bends,
        hard.base_advance,
        FreeSpace(tube, introducer=read_record(Introducer, hard.meta["introducer"], "tube")),
    )
    assert proof.certified
    assert proof.clearance == pytest.approx(hard.certificate.clearance, abs=0.15)
    assert 0.0 <= hard.certificate.step <= hard.steps - 1


def test_tendons_keep_their_travel_or_are_named(plan, tube, moved):
    needed = np.abs(moved.displacements).max()
    easy = actuate_plan(plan, make_robot(20.0, 6, travel=0.95 * needed), tube)
    assert easy.fits
    assert np.abs(easy.displacements).max() <= 0.95 * needed
    hard = actuate_plan(plan, make_robot(20.0, 6, travel=0.15 * needed), tube)
    assert (hard.status, hard.reason_code) == ("stopped", "TENDON_TRAVEL")
    assert "tendon 's" in hard.reason
    assert np.abs(hard.displacements).max() <= 0.15 * needed


def test_a_short_robot_says_how_much_is_missing(plan, tube):
    short = actuate_plan(plan, make_robot(20.0, 3), tube)
    assert (short.status, short.reason_code) == ("stopped", "ROBOT_TOO_SHORT")
    assert short.base_advance.max() < 60.0
    assert "3 more section(s)" in short.reason or "2 more section(s)" in short.reason
    assert short.certified


def test_a_body_through_the_wall_says_where_and_by_how_much(plan, tube):
    stiff = actuate_plan(plan, make_robot(60.0, 2, radius=4.5), tube)
    assert (stiff.status, stiff.reason_code) == ("stopped", "WALL")
    assert "through the wall by" in stiff.reason
    told = stiff.meta["shortfall"]
    assert told["needs"] == 4.5 and told["offers"] < 4.5
    assert stiff.certificate.clearance >= 0.0
    assert stiff.head_arc_length[-1] < told["head_mm"]


def test_a_robot_thicker_than_the_bore_does_not_begin(plan, tube):
    thick = actuate_plan(plan, make_robot(20.0, 6, radius=9.0), tube)
    assert (thick.steps, thick.reason_code) == (1, "INTRODUCER")
    assert not thick.fits


def test_a_plan_that_stops_is_followed_as_far_as_it_goes():
    duct, line = make_tube()
    scope = Scope(diameter=4.0, link_length=5.0, length=60.0)
    plan = insert(duct, line, scope=scope, head_step=1.0)
    moved = actuate_plan(plan, make_robot(20.0, 6), duct)
    assert (moved.reason_code, moved.steps) == ("PLAN_STOPPED", plan.steps)
    assert moved.certified and not moved.fits


def test_everything_comes_back_from_the_file(moved, tmp_path):
    again = Actuation.load(moved.save(tmp_path / "robot.npz"))
    assert again.to_dict() == moved.to_dict()
    for name in ("displacements", "bends", "base_advance", "frame", "clearance"):
        assert np.array_equal(getattr(again, name), getattr(moved, name))
    with pytest.raises(FileFormatError, match="no such file"):
        Actuation.load(tmp_path / "nothing.npz")
    (tmp_path / "text.npz").write_text("words")
    with pytest.raises(FileFormatError, match="not a Bozzini actuation"):
        Actuation.load(tmp_path / "text.npz")
    with pytest.raises(FileFormatError):
        Actuation.load(make_plan().save(tmp_path / "plan.npz"))


def test_parquet_holds_the_same_table(moved, tmp_path, monkeypatch):
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(moved.write_parquet(tmp_path / "tendons.parquet"))
    assert tuple(table.column_names) == moved.columns
    columns = np.column_stack([table[name].to_numpy() for name in table.column_names[3:]])
    assert np.array_equal(columns, moved.displacements)
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match="tables"):
        moved.write_parquet(tmp_path / "other.parquet")


def test_the_summary_counts_what_the_table_holds(moved):
    told = moved.to_dict()
    assert told["bend"]["max_rad"] == np.linalg.norm(moved.bends, axis=2).max()
    first = moved.displacements[:, 0]
    item = told["tendons"][moved.robot.tendon_names[0]]
    assert (item["min_mm"], item["max_mm"]) == (first.min(), first.max())
    rates = np.abs(np.diff(first)) / np.diff(moved.head_arc_length)
    assert item["rate_max"] == pytest.approx(rates.max())
    assert told["base"]["rate_max"] >= 1.0 - 1e-6 or told["base"]["max_mm"] < 1.0


def test_robots_that_cannot_be_steered_are_refused(plan, tube):
    flat = ContinuumRobot(
        [
            Section(
                length=120.0,
                radius=2.0,
                tendons=[
                    Tendon(name="a", offset=1.5, angle=0.0),
                    Tendon(name="b", offset=1.5, angle=math.pi),
                ],
            )
        ]
    )
    with pytest.raises(GeometryError, match="one plane only"):
        actuate_plan(plan, flat, tube)
    two = ContinuumRobot(
        [
            Section(
                length=120.0,
                radius=2.0,
                tendons=[
                    Tendon(name="a", offset=1.5, angle=math.pi),
                    Tendon(name="b", offset=1.5, angle=1.5 * math.pi),
                ],
            )
        ]
    )
    with pytest.raises(GeometryError, match="give each section tendons all around, or rods"):
        actuate_plan(plan, two, tube)
    with pytest.raises(GeometryError, match="parallel"):
        helix = Tendon(name="h", offset=1.5, angle=Helix(turns=1.0), end=20.0)
        actuate_plan(
            plan, ContinuumRobot([Section(length=20.0, radius=2.0, tendons=[helix])]), tube
        )


def test_planar_ducts_and_foreign_plans_are_refused(plan, tube):
    from bozzini.duct import Polygon

    square = Polygon([(0.0, 0.0), (200.0, 0.0), (200.0, 50.0), (0.0, 50.0)])
    with pytest.raises(InputError, match="planar"):
        actuate_plan(plan, make_robot(20.0, 6), square)
    with pytest.raises(InputError, match="no introducer"):
        actuate_plan(replace(plan, introducer=None), make_robot(20.0, 6), tube)
    with pytest.raises(InputError, match="roll"):
        actuate_plan(plan, make_robot(20.0, 6), tube, roll=math.nan)


def test_every_reason_has_a_code_that_is_explained(plan, tube):
    for robot in (make_robot(20.0, 3), make_robot(60.0, 2, radius=4.5)):
        assert actuate_plan(plan, robot, tube).reason_code in ACTUATION_CODES
