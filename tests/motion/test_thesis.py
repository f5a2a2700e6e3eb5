"""The thesis's scheme: exact lengths, joints inside, honest stops."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.motion import Scope
from bozzini.motion.measures import measure_angles
from tests.motion.plans import insert
from tests.shapes import bend_curve, curve_distance, sample_field, tube_lumen


def insert_tube(curve, radius, *, diameter, link, **options):
    field, line = tube_lumen(curve, radius)
    scope = Scope(diameter=diameter, link_length=link)
    options = {"method": "thesis", **options}
    return field, line, insert(field, line, scope=scope, **options)


@pytest.fixture(scope="module")
def bend():
    return insert_tube(bend_curve(20.0, 2.5, 30.0), 6.0, diameter=4.0, link=8.0)


@pytest.mark.slow
def test_the_head_follows_the_path_to_its_end(bend):
    _, line, plan = bend
    assert plan.status == "complete"
    assert plan.reason == ""
    assert plan.inserted == pytest.approx(line.length)
    heads = np.stack(
        [np.interp(plan.head_arc_length, line.arc_length, column) for column in line.points.T],
        axis=1,
    )
    assert plan.joints[:, 0] == pytest.approx(heads, abs=1e-9)


def test_link_lengths_are_kept(bend):
    lengths = np.linalg.norm(np.diff(bend[2].joints, axis=1), axis=2)
    assert lengths == pytest.approx(8.0, abs=1e-9)


def test_joints_keep_the_radius_from_the_wall(bend):
    field, _, plan = bend
    entry = plan.introducer.entry
    outward = np.array(plan.introducer.outward)
    inside = (plan.joints - entry) @ outward < 0.0
    assert field.signed_distance(plan.joints[inside]).max() <= -2.0 + 1e-8


@pytest.mark.slow
def test_unconstrained_joints_attenuate():
    # A straight wide tube, a slightly wavy head path: no wall is met, so nothing is amplified.
    z = np.arange(0.0, 120.0)
    curve = np.stack([1.5 * np.sin(z / 12.0), 0 * z, z], axis=1)
    field, line = tube_lumen(np.stack([0 * z, 0 * z, z], axis=1), 15.0)
    line = type(line)(points=curve, arc_length=line.arc_length, radius=line.radius)
    plan = insert(field, line, scope=Scope(diameter=1.0, link_length=7.0), method="thesis")
    travel = np.linalg.norm(np.diff(plan.joints, axis=0), axis=2).sum(axis=0)
    assert np.all(np.diff(travel) <= 1e-9)


def test_body_may_leave_where_joints_do_not():
    # Long links in a tight bend: the scheme completes, and the body check tells the truth.
    _, _, plan = insert_tube(bend_curve(14.0, 2.2, 40.0), 5.0, diameter=2.0, link=14.0)
    assert plan.status == "complete"
    assert plan.clearance_min < -0.3


@pytest.mark.slow
def test_a_lock_is_reported_and_not_jumped_over():
    # A half turn, joints only: a long link's tail stays behind in the near limb and is dragged
    # backward until no small move is left (thesis Fig. 5.30); a short link passes.
    curve = bend_curve(15.0, np.pi, 60.0)
    assert insert_tube(curve, 5.0, diameter=0.2, link=16.0)[2].status == "complete"
    _, _, plan = insert_tube(curve, 5.0, diameter=0.2, link=24.0)
    assert plan.status == "stopped"
    assert plan.reason_code in ("LINK_LOCKED", "LINK_INFEASIBLE")
    assert "head at" in plan.reason and "link" in plan.reason
    assert 100.0 < plan.inserted < 166.5
    moves = np.linalg.norm(np.diff(plan.joints, axis=0), axis=2)
    assert moves.max() <= 1.0 + 1e-9


def test_a_narrow_place_stops_the_head_with_what_it_offers():
    curve = np.stack([np.zeros(100), np.zeros(100), np.arange(100.0)], axis=1)
    field, line = tube_lumen(curve, 6.0)

    def distance(points):
        whole = curve_distance(curve, 6.0)(points)
        z = points[..., 2]
        narrow = np.linalg.norm(points[..., :2], axis=-1) - 2.0
        return np.where((z > 60) & (z < 66), np.maximum(whole, narrow), whole)

    pinched = sample_field(distance, (-9, -9, -9), (9, 9, 108), 1.0)
    scope = Scope(diameter=8.0, link_length=6.0)
    plan = insert(pinched, line, scope=scope, method="thesis")
    assert plan.status == "stopped"
    assert plan.reason_code == "HEAD_CLEARANCE"
    assert "needs 4.00 mm" in plan.reason
    assert plan.inserted == pytest.approx(60.0, abs=1.5)
    assert field.signed_distance(line.points).max() < 0.0


def test_an_entry_too_narrow_is_an_answer():
    _, _, plan = insert_tube(bend_curve(30.0, 1.0, 20.0), 3.0, diameter=8.0, link=5.0)
    assert plan.status == "stopped"
    assert plan.steps == 1
    assert plan.reason_code == "ENTRY_CLEARANCE"


def test_a_finer_head_step_changes_little(bend):
    coarse = bend[2]
    fine = insert_tube(bend_curve(20.0, 2.5, 30.0), 6.0, diameter=4.0, link=8.0, head_step=0.0625)[
        2
    ]
    assert np.linalg.norm(coarse.joints[-1] - fine.joints[-1], axis=1).max() < 0.3


@pytest.mark.slow
def test_motion_is_carried_by_a_rigid_motion_of_the_tract():
    random = np.random.default_rng(0)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    field, line = tube_lumen(bend_curve(20.0, 1.5, 30.0), 6.0)
    scope = Scope(diameter=4.0, link_length=8.0)
    plain = insert(field, line, scope=scope, method="thesis")
    moved_field = type(field)(
        values=field.values,
        spacing=field.spacing,
        origin=turn @ field.origin + 5.0,
        rotation=turn @ field.rotation,
    )
    moved_line = type(line)(
        points=line.points @ turn.T + 5.0, arc_length=line.arc_length, radius=line.radius
    )
    moved = insert(moved_field, moved_line, scope=scope, method="thesis")
    assert moved.joints == pytest.approx(plain.joints @ turn.T + 5.0, abs=1e-6)
    assert moved.clearance_min == pytest.approx(plain.clearance_min, abs=1e-6)


def test_a_shorter_scope_is_inserted_as_far_as_it_is_long():
    field, line = tube_lumen(bend_curve(20.0, 1.5, 40.0), 6.0)
    scope = Scope(diameter=4.0, link_length=8.0, length=30.0)
    plan = insert(field, line, scope=scope, method="thesis")
    assert plan.links == 4
    assert (plan.status, plan.reason_code) == ("stopped", "SCOPE_TOO_SHORT")
    assert plan.inserted == pytest.approx(30.0, abs=1.0)
    assert "30 mm long" in plan.reason


def test_angles_against_the_dot_product():
    joints = np.random.default_rng(2).normal(size=(7, 6, 3))
    links = np.diff(joints, axis=1)
    unit = links / np.linalg.norm(links, axis=2, keepdims=True)
    expected = np.arccos(np.clip((unit[:, 1:] * unit[:, :-1]).sum(axis=2), -1.0, 1.0))
    assert measure_angles(joints) == pytest.approx(expected, abs=1e-7)
