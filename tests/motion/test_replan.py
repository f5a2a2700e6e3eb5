"""Planning again in a lumen that has moved: it moves with the tissue, and is proved anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bozzini.anatomy import read_tract
from bozzini.duct import Centreline, Polygon, RoundCones, field_from_mask, find_centreline
from bozzini.errors import InputError
from bozzini.motion import Plan, Scope, certify_plan, replan
from tests.motion.plans import insert
from tests.shapes import bend_curve, curve_distance, sample_field, tube_lumen

RADIUS = 5.0
CURVE = bend_curve(20.0, 2.2, 24.0, spacing=3.0)
SCOPE = Scope(diameter=5.0, link_length=8.0)


def sway(points, amount):
    """Shear the tissue along x, by up to `amount` mm."""
    moved = np.array(points, dtype=float)
    moved[..., 0] += amount * np.cos(moved[..., 2] / 12.0)
    return moved


def lumen(curve, radius=RADIUS):
    return tube_lumen(curve, radius, voxel=1.5)


@pytest.fixture(scope="module")
def at_rest():
    field, line = lumen(CURVE)
    plan = insert(field, line, scope=SCOPE, head_step=0.5)
    assert plan.status == "complete"
    return field, line, plan


def gap_to(points, path):
    """Largest distance from points to a polyline."""
    return float((curve_distance(path, 0.0)(points)).max())


def test_where_nothing_moved_the_path_stays(at_rest):
    field, _, plan = at_rest
    again = replan(plan, field)
    note = again.replan
    assert note.warm
    assert note.sweeps == 0
    assert note.tissue_move == 0.0
    assert again.path[[0, -1]] == pytest.approx(plan.path[[0, -1]], abs=1e-12)
    assert gap_to(again.path, plan.path) < 0.05  # resampled, not bent
    assert again.certified
    assert again.joints.shape[1] == plan.joints.shape[1]


def test_a_rigid_move_takes_the_whole_plan_along(at_rest):
    # The same values of the field in a moved frame: everything moves, nothing else changes.
    field, _, plan = at_rest
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    shift = np.array([120.0, -45.0, 9.0])
    moved = replace(field, origin=field.origin @ turn.T + shift, rotation=turn @ field.rotation)
    still = replan(plan, field)
    there = replan(plan, moved, advect=lambda points: points @ turn.T + shift)
    assert there.replan.warm
    assert there.joints == pytest.approx(still.joints @ turn.T + shift, abs=1e-6)
    assert there.certificate.clearance == pytest.approx(still.certificate.clearance, abs=1e-6)
    assert there.introducer.outward == pytest.approx(turn @ plan.introducer.outward, abs=1e-9)


@pytest.mark.parametrize("amount", [-2.0, 2.0])
def test_what_is_proved_holds_in_the_lumen_as_it_is_now(at_rest, amount):
    _, _, plan = at_rest
    curve = sway(CURVE, amount)
    field, _ = lumen(curve)
    moved = replan(plan, field, advect=lambda points: sway(points, amount))
    assert moved.replan.warm
    assert moved.replan.tissue_move == pytest.approx(
        np.linalg.norm(sway(plan.path, amount) - plan.path, axis=1).max()
    )
    assert moved.status == "complete"
    bound = moved.certificate.clearance
    assert bound >= 0.0
    assert certify_plan(moved, field).clearance == pytest.approx(bound)
    # and against the true wall, at random places and times, links within the lumen's reach
    rng = np.random.default_rng(0)
    step = rng.integers(0, moved.steps - 1, 20_000)
    link = rng.integers(0, moved.links, 20_000)
    time, along = rng.random((2, 20_000, 1))
    heads, tails = moved.joints[:, :-1], moved.joints[:, 1:]
    body = sum(
        weight * ((1.0 - along) * heads[at, link] + along * tails[at, link])
        for weight, at in ((1.0 - time, step), (time, step + 1))
    )
    entry = np.array(moved.introducer.entry)
    outside = (body - entry) @ np.array(moved.introducer.outward) > -RADIUS
    room = -curve_distance(curve, RADIUS)(body[~outside]) - SCOPE.radius
    assert len(room) > 5_000
    assert room.min() >= bound


@pytest.mark.slow
def test_many_breaths_do_not_wear_the_path_out(at_rest):
    field, _, plan = at_rest
    last, proved = 0.0, []
    for frame in range(1, 25):
        amount = 2.5 * np.sin(2.0 * np.pi * frame / 8.0)
        field, _ = lumen(sway(CURVE, amount))
        change = amount - last
        plan = replan(plan, field, advect=lambda points, change=change: sway(points, change))
        last = amount
        assert plan.replan.warm
        assert plan.status == "complete"
        proved.append(plan.certificate.clearance)
    first, third = np.array(proved).reshape(3, 8)[[0, 2]]
    assert min(proved) > 0.0
    assert third.min() > 0.5 * first.min()
    assert plan.measures.joint_step_ratio_max < 2.0


def test_the_goal_must_move_with_its_tissue(at_rest):
    # Left where they were, entry and goal are no longer in the lumen: said, not hidden.
    _, _, plan = at_rest
    far = np.array([0.0, 8.0, 0.0])
    field, line = lumen(CURVE + far)
    left = replan(plan, field)
    assert left.status == "stopped"
    assert not left.replan.warm
    assert left.replan.reason == "the entry is narrower than the scope"
    assert left.reason_code == "ENTRY_CLEARANCE"
    taken = replan(plan, field, advect=lambda points: points + far)
    assert taken.status == "complete"
    assert taken.replan.warm
    # with the way as it is now there is a full plan, introducer included
    full = replan(plan, field, line=line)
    assert full.status == "complete"
    assert not full.replan.warm
    assert full.path[0] == pytest.approx(line.points[0])


def test_a_pinch_stops_it_and_an_opening_lets_it_go_on(at_rest):
    field, line, plan = at_rest
    radii = np.full(len(CURVE) - 1, RADIUS)
    radii[11:18] = 1.0
    low, high = CURVE.min(axis=0) - 8.0, CURVE.max(axis=0) + 8.0
    pinched = sample_field(curve_distance(CURVE, radii), low, high, 1.0)
    stopped = replan(plan, pinched)
    assert stopped.status == "stopped"
    assert stopped.reason_code == "NO_PASSAGE"
    assert not stopped.replan.warm
    assert "are needed" in stopped.replan.reason
    with pytest.raises(InputError, match="the last plan stopped .NO_PASSAGE.*give line"):
        replan(stopped, field)
    opened = replan(stopped, field, line=line)
    assert opened.status == "complete"
    assert opened.replan.reason == "the last plan did not reach its goal"


def test_the_request_is_the_last_plans(at_rest, tmp_path):
    field, line, _ = at_rest
    asked = {"method": "follow", "head_step": 0.8, "route": (1.0, 0.2), "slip": 0.25}
    plan = insert(field, line, scope=SCOPE, angle_limit=1.5, **asked)
    again = replan(Plan.load(plan.save(tmp_path / "plan.npz")), field)
    assert again.method == "follow"
    for key in ("options", "scope"):
        assert getattr(again, key) == getattr(plan, key)
    share = again.head_arc_length / again.head_arc_length.max()
    assert share[-1] == pytest.approx(0.2)
    # every joint of "follow" is on the path, or in the introducer before it
    inner = again.joints[np.argmax(share), :6]
    assert gap_to(inner, again.path) < 1e-6


def test_another_scope_may_be_asked_for(at_rest):
    field, _, plan = at_rest
    thin = Scope(diameter=4.0, link_length=6.0, length=60.0)
    again = replan(plan, field, scope=thin)
    assert (again.scope.diameter, again.scope.link_length) == (4.0, 6.0)
    assert again.links == 10
    assert again.certified


def test_the_last_plan_is_left_as_it_was(at_rest):
    field, _, plan = at_rest
    path, joints = plan.path.copy(), plan.joints.copy()

    def push(points):
        points += 1.0  # a careless function must not reach the plan
        return points

    replan(plan, field, advect=push)
    assert np.array_equal(plan.path, path)
    assert np.array_equal(plan.joints, joints)
    assert plan.replan is None


def test_planar_and_analytic_lumens_are_planned_again_too():
    middle = CURVE[:, [0, 2]]
    normals = np.gradient(middle, axis=0)[:, ::-1] * [1.0, -1.0]
    normals *= RADIUS / np.linalg.norm(normals, axis=1, keepdims=True)

    def sway_plane(points, amount):
        return points + amount * np.stack([np.cos(points[:, 1] / 12.0), 0.0 * points[:, 1]], axis=1)

    def channel(amount):
        walls = np.concatenate([middle + normals, (middle - normals)[::-1]])
        return Polygon(sway_plane(walls, amount))

    inner = middle[2:-2]
    duct = channel(0.0)
    plan = insert(duct, Centreline.from_points(inner, duct), scope=SCOPE, head_step=0.5)
    flat = replan(plan, channel(2.0), advect=lambda points: sway_plane(points, 2.0))
    assert flat.replan.warm
    assert flat.certified
    assert flat.joints.shape[2] == 2

    duct = RoundCones(CURVE, np.full(len(CURVE), RADIUS))
    plan = insert(duct, Centreline.from_points(CURVE, duct), scope=SCOPE, head_step=0.5)
    moved = RoundCones(sway(CURVE, 2.0), np.full(len(CURVE), RADIUS))
    space = replan(plan, moved, advect=lambda points: sway(points, 2.0))
    assert space.replan.warm
    assert space.certified


@pytest.mark.slow
def test_a_human_tract_in_a_breath(upper_gi_dir):
    tract = read_tract(upper_gi_dir / "upper_gi_labels_1mm.nii.gz", labels="all")
    mask, affine = np.pad(tract.mask, 6), tract.affine.copy()
    affine[:3, 3] -= 6.0 * affine[:3, :3].sum(axis=1)
    field = field_from_mask(mask, affine, voxel=2.0)
    plan = insert(
        field,
        find_centreline(field),
        scope=Scope(diameter=5.5, link_length=12.0),
        method="tube",
    )
    assert plan.status == "complete"

    def breathe(points, sign=1.0):
        moved = np.array(points)
        moved[..., 0] += sign * 2.1 * np.cos(moved[..., 2] / 32.0)
        return moved

    index = np.argwhere(np.ones_like(mask))
    source = breathe(index @ affine[:3, :3].T + affine[:3, 3], -1.0)
    source = np.rint((source - affine[:3, 3]) @ np.linalg.inv(affine[:3, :3]).T).astype(int)
    source = np.clip(source, 0, np.array(mask.shape) - 1)
    moved = field_from_mask(mask[tuple(source.T)].reshape(mask.shape), affine, voxel=2.0)
    again = replan(plan, moved, advect=breathe)
    assert again.status == "complete"
    assert again.certified
    assert again.replan.warm
    assert certify_plan(again, moved).certified
    # the old motion would not do: the tissue has moved into it
    assert not certify_plan(plan, moved).certified


def test_a_centreline_may_be_made_of_the_moved_one(at_rest):
    _, line, plan = at_rest
    curve = sway(line.points, 2.0)
    field, _ = lumen(sway(CURVE, 2.0))
    way = Centreline.from_points(curve, field)
    again = replan(plan, field, advect=lambda points: sway(points, 2.0), line=way)
    assert again.replan.warm
    assert again.measures.clearance_where <= way.length
