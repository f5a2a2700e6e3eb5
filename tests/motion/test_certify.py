"""The certificate: below the exact clearance always, near to it, and hard to cheat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.duct import field_from_mask
from bozzini.duct.centreline import Centreline
from bozzini.motion import FreeSpace, Plan, Scope, certify_motion, certify_plan
from tests.exact import VoxelWall, body_points, outside_introducer, sample_body, voxelise
from tests.motion.plans import insert
from tests.shapes import bend_curve

DIAMETER, LINK = 4.0, 9.0
RADIUS = 0.5 * DIAMETER


class Case:
    """A voxel lumen, its exact wall, and a plan of every method through it."""

    def __init__(self, curve, radius):
        mask, affine = voxelise(curve, radius)
        self.mask, self.affine, self.curve = mask, affine, curve
        self.field = field_from_mask(mask, affine)
        self.wall = VoxelWall(mask, affine)
        self.line = Centreline.from_points(curve, self.field)
        self.scope = Scope(diameter=DIAMETER, link_length=LINK)

    def plan(self, **options):
        return insert(self.field, self.line, scope=self.scope, **options)

    def exact(self, plan, points):
        introducer = plan.introducer
        counts = outside_introducer(points, introducer, RADIUS)
        clearance = np.full(len(points), np.inf)
        clearance[counts] = self.wall.clearance(points[counts]) - RADIUS
        return clearance


@pytest.fixture(scope="module")
def bend():
    return Case(bend_curve(14.0, 2.6, 32.0)[8:-8], 5.4)


@pytest.fixture(scope="module")
def plans(bend):
    return {
        "tube": bend.plan(),
        "follow": bend.plan(method="follow"),
        "thesis": bend.plan(method="thesis"),
        "in and out": bend.plan(route=(1.0, 0.2, 0.9), head_step=1.0),
    }


@pytest.mark.parametrize("name", ["tube", "follow", "thesis", "in and out"])
def test_no_body_point_is_nearer_to_the_wall_than_certified(bend, plans, name):
    plan = plans[name]
    certificate = certify_plan(plan, bend.field)
    random = np.random.default_rng(0)
    points, *_ = sample_body(plan.joints, 30_000, random)
    # ... and many around the place that the certificate names.
    steps = (max(certificate.step - 1.0, 0.0), min(certificate.step + 1.0, plan.steps - 1.0))
    near, *_ = sample_body(
        plan.joints, 5_000, random, steps=steps, links=(certificate.link, certificate.link)
    )
    least = bend.exact(plan, np.concatenate([points, near])).min()
    assert certificate.resolved
    assert certificate.clearance <= least + 1e-9
    assert least - certificate.clearance <= 0.4
    assert certificate.clearance <= certificate.found <= certificate.clearance + 0.1 + 1e-9


def test_certified_says_what_the_sign_says(bend, plans):
    for plan in plans.values():
        certificate = certify_plan(plan, bend.field)
        assert certificate.certified == (certificate.clearance >= 0.0)
        assert plan.certified == certificate.certified
    assert plans["tube"].certified


@settings(max_examples=25)
@given(data=st.data())
def test_one_joint_out_of_place_at_one_step_is_caught(bend, plans, data):
    plan = plans["tube"]
    step = data.draw(st.integers(plan.steps // 3, plan.steps - 1), label="step")
    inside = int(plan.inserted * step / plan.steps / LINK)
    joint = data.draw(st.integers(0, max(inside - 1, 0)), label="joint")
    direction = np.array(data.draw(st.tuples(*[st.floats(-1.0, 1.0)] * 3), label="direction"))
    if np.linalg.norm(direction) < 0.1:
        direction = np.array([0.0, 1.0, 0.0])
    direction /= np.linalg.norm(direction)
    share = data.draw(st.floats(0.0, 8.0), label="by")
    joints = plan.joints.copy()
    joints[step, joint] += share * direction
    broken = replace(plan, joints=joints)
    # The exact clearance of the joint itself and of the two links at that step.
    u = np.linspace(0.0, 1.0, 60)
    points = np.concatenate(
        [
            body_points(joints, np.full(60, float(step)), np.full(60, link), u)
            for link in (max(joint, 1), joint + 1)
        ]
    )
    least = bend.exact(broken, points).min()
    certificate = certify_plan(broken, bend.field)
    assert certificate.clearance <= least + 1e-9
    if least < 0.0:
        assert not certificate.certified


def test_a_link_across_the_inner_wall_is_caught_though_its_joints_are_clear(bend):
    turn = int(np.argmax(bend.curve[:, 2]))
    chain = bend.curve[[turn + 14, turn - 14]][None]
    assert bend.wall.clearance(chain[0]).min() > RADIUS + 1.0
    assert bend.wall.clearance(chain[0].mean(axis=0)[None])[0] == 0.0
    certificate = certify_motion(chain, bend.field, radius=RADIUS)
    assert certificate.clearance < -RADIUS
    assert 0.0 < np.linalg.norm(certificate.place - chain[0, 0]) < np.ptp(chain[0], axis=0).max()


def test_a_motion_through_the_wall_between_two_clear_steps_is_caught(bend):
    turn = int(np.argmax(bend.curve[:, 2]))
    chains = np.stack([bend.curve[[k, k - 4]] for k in (turn + 22, turn - 18)])
    for chain in chains:
        alone = certify_motion(chain[None], bend.field, radius=RADIUS)
        assert alone.certified
    certificate = certify_motion(chains, bend.field, radius=RADIUS)
    assert certificate.clearance < 0.0
    assert 0.0 < certificate.step < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(25))
def test_a_lone_peg_is_never_overlooked(seed):
    # A wide cave with a few single wall voxels in it, and big moves of long links past them.
    random = np.random.default_rng(seed)
    mask = np.ones((44, 44, 44), dtype=bool)
    mask[tuple(random.integers(8, 36, (3, 4)))] = False
    field, wall = field_from_mask(mask, np.eye(4)), VoxelWall(mask, np.eye(4))
    joints = random.uniform(5.0, 38.0, (3, 3, 3))
    time, share = np.meshgrid(np.linspace(0.0, 2.0, 121), np.linspace(0.0, 1.0, 61))
    least = min(
        wall.clearance(
            body_points(joints, time.ravel(), np.full(time.size, link), share.ravel())
        ).min()
        for link in (1, 2)
    )
    for tolerance in (0.05, 1.0):
        certificate = certify_motion(joints, field, radius=0.0, tolerance=tolerance)
        assert certificate.clearance <= least + 1e-9
        assert certificate.clearance >= least - 1.2 - tolerance


@pytest.mark.slow
def test_a_lone_peg_is_never_overlooked_by_links_at_rest():
    random = np.random.default_rng(0)
    share = np.linspace(0.0, 1.0, 400)
    for case in range(600):
        if case % 100 == 0:
            mask = np.ones((44, 44, 44), dtype=bool)
            mask[tuple(random.integers(8, 36, (3, 3)))] = False
            field, wall = field_from_mask(mask, np.eye(4)), VoxelWall(mask, np.eye(4))
        chain = random.uniform(4.0, 39.0, (1, 2, 3))
        points = chain[0, 1] + share[:, None] * (chain[0, 0] - chain[0, 1])
        certificate = certify_motion(chain, field, radius=0.0, tolerance=0.05)
        assert certificate.clearance <= wall.clearance(points).min() + 1e-9


def test_tolerance_is_kept_and_a_finer_one_proves_more(bend, plans):
    bounds = []
    for tolerance in (0.5, 0.1, 0.03):
        certificate = certify_plan(plans["tube"], bend.field, tolerance=tolerance)
        assert certificate.resolved
        assert certificate.found - certificate.clearance <= tolerance + 1e-9
        bounds.append(certificate)
    assert bounds[0].clearance <= bounds[2].clearance + 1e-9
    assert bounds[0].evaluations < bounds[1].evaluations < bounds[2].evaluations


@pytest.mark.parametrize("budget", [1, 1000])
def test_an_exhausted_budget_leaves_a_valid_bound_and_says_so(bend, plans, budget):
    full = certify_plan(plans["tube"], bend.field, tolerance=0.01)
    short = certify_plan(plans["tube"], bend.field, tolerance=0.01, budget=budget)
    assert not short.resolved
    assert short.clearance <= full.found
    assert short.evaluations < full.evaluations


def test_a_bound_of_either_sign_is_settled_where_it_can_be(bend, plans):
    plan = plans["tube"]
    certificate = certify_plan(plan, bend.field)
    # A body thicker by nearly all that was found: 0.05 mm are left, less than the tolerance.
    radius = RADIUS + certificate.found - 0.05
    space = FreeSpace(bend.field, introducer=plan.introducer)
    assert not certify_motion(plan.joints, space, settle=False, radius=radius).certified
    assert certify_motion(plan.joints, space, radius=radius).certified


def test_a_plan_from_a_file_gets_the_same_certificate(bend, plans, tmp_path):
    plan = plans["follow"]
    loaded = Plan.load(plan.save(tmp_path / "plan.npz"))
    assert certify_plan(loaded, bend.field).clearance == pytest.approx(
        certify_plan(plan, bend.field).clearance, abs=1e-12
    )


def test_a_hand_made_plan_is_judged_by_its_joints_alone(bend, plans):
    plan = plans["tube"]
    poor = replace(
        plan,
        method="drawn by hand",
        clearance=np.full_like(plan.clearance, 99.0),
        head_arc_length=plan.head_arc_length[::-1],
        path=plan.path + 100.0,
    )
    assert certify_plan(poor, bend.field).clearance == certify_plan(plan, bend.field).clearance


def test_points_put_between_steps_change_nothing(bend, plans):
    joints = plans["in and out"].joints
    fine = np.repeat(joints, 2, axis=0)[:-1]
    fine[1::2] = 0.5 * (joints[1:] + joints[:-1])
    space = FreeSpace(bend.field, introducer=plans["in and out"].introducer)
    options = {"radius": RADIUS, "tolerance": 0.01}
    coarse = certify_motion(joints, space, **options)
    assert certify_motion(fine, space, **options).clearance == pytest.approx(
        coarse.clearance, abs=0.011
    )


def test_the_bound_moves_with_the_body_and_the_lumen(bend, plans):
    plan = plans["tube"]
    turn = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))[0]
    shift = np.array([40.0, -7.0, 3.0])
    affine = np.eye(4)
    affine[:3, :3] = turn @ bend.affine[:3, :3]
    affine[:3, 3] = turn @ bend.affine[:3, 3] + shift
    tube = plan.introducer
    there = replace(tube, entry=turn @ tube.entry + shift, outward=turn @ tube.outward)
    moved = replace(plan, joints=plan.joints @ turn.T + shift, introducer=there)
    assert certify_plan(moved, field_from_mask(bend.mask, affine)).clearance == pytest.approx(
        certify_plan(plan, bend.field).clearance, abs=1e-6
    )


def test_a_thicker_body_has_that_much_less(bend, plans):
    joints = plans["tube"].joints[-1:, : int(plans["tube"].inserted / LINK)]
    thin = certify_motion(joints, bend.field, radius=1.0)
    thick = certify_motion(joints, bend.field, radius=2.5)
    assert thin.clearance - thick.clearance == pytest.approx(1.5, abs=1e-9)


@pytest.fixture(scope="module")
def followers(bend):
    """A chain of many short links on one path, and where it enters."""
    scope = Scope(diameter=DIAMETER, link_length=3.0)
    plan = insert(bend.field, bend.line, scope=scope, method="follow", head_step=0.5)
    return plan.joints, FreeSpace(bend.field, introducer=plan.introducer)


@pytest.mark.parametrize("aside", [0.0, 0.02, 0.4, 3.0])
def test_links_that_follow_are_bounded_as_if_each_were_alone(followers, aside):
    joints, space = followers[0].copy(), followers[1]
    steps, count, _ = joints.shape
    # Later, one joint behind the head leaves the path that the others keep to, and comes back.
    late = np.arange(steps)[:, None] - 0.8 * steps
    joints[:, 5] += aside * np.exp(-((late / 5.0) ** 2)) * [0.0, 1.0, 0.0]
    whole = certify_motion(joints, space, radius=RADIUS)
    alone = [
        certify_motion(joints[:, j - 1 : j + 1], space, radius=RADIUS) for j in range(1, count)
    ]
    assert whole.clearance <= min(each.found for each in alone) + 1e-9
    assert whole.clearance >= min(each.clearance for each in alone) - 0.1
    assert whole.found <= whole.clearance + 0.1 + 1e-9
    # ... by a small part of the work.
    assert whole.evaluations < 0.4 * sum(each.evaluations for each in alone)
