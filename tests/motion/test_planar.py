"""Planar ducts: the same planner in two dimensions, with a proof, exact lengths and no height."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.duct import Centreline, Polygon
from bozzini.motion import FreeSpace, Plan, Scope, certify_motion, certify_plan
from tests.motion.plans import insert


def make_channel(middle, half):
    """A channel around a polyline, mitred, `half` wide to each side at each of its points."""
    middle = np.asarray(middle, dtype=float)
    along = np.diff(middle, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    mitre = (normal[:-1] + normal[1:]) / (1.0 + np.sum(normal[:-1] * normal[1:], axis=1))[:, None]
    offset = np.concatenate([normal[:1], mitre, normal[-1:]])
    offset *= np.broadcast_to(half, len(middle))[:, None]
    return Polygon(np.concatenate([middle + offset, (middle - offset)[::-1]]))


def shorten(middle, start, stop):
    """The way along `middle`, away from the channel's closed ends."""
    way = np.array(middle, dtype=float)
    for end, step, size in ((0, 1, start), (-1, -2, stop)):
        ahead = way[step] - way[end]
        way[end] += size * ahead / np.linalg.norm(ahead)
    return way


ZIGZAG = np.array([(0, 0), (50, 0), (75, 30), (115, 30), (140, 0), (180, 0)], dtype=float)


@pytest.fixture(scope="module")
def zigzag():
    duct = make_channel(ZIGZAG, 8.0)
    return duct, Centreline.from_points(shorten(ZIGZAG, 20.0, 9.0), duct)


def measure_exact(plan, duct, count, seed=0):
    """The clearance at random times and places of the body that have left the introducer."""
    random = np.random.default_rng(seed)
    introducer = plan.introducer
    radius = 0.5 * plan.scope.diameter
    t = random.uniform(0.0, plan.steps - 1.0, count)
    step = np.minimum(t.astype(int), plan.steps - 2)
    part = (t - step)[:, None]
    link = random.integers(0, plan.links, count)
    u = random.uniform(size=(count, 1))
    ends = [
        (1 - part) * plan.joints[step, link + k] + part * plan.joints[step + 1, link + k]
        for k in (0, 1)
    ]
    body = (1 - u) * ends[0] + u * ends[1]
    inside = (body - introducer.entry) @ introducer.outward < 0.0
    return -duct.signed_distance(body[inside]) - radius


@pytest.mark.parametrize("method", ["tube", "follow"])
def test_a_zigzag_is_passed_with_a_proof(zigzag, method):
    duct, line = zigzag
    scope = Scope(diameter=5.0, link_length=10.0)
    plan = insert(duct, line, scope=scope, method=method)
    assert (plan.status, plan.reason, plan.method) == ("complete", "", method)
    assert plan.joints.shape[2] == plan.path.shape[1] == 2
    lengths = np.linalg.norm(np.diff(plan.joints, axis=1), axis=2)
    assert lengths == pytest.approx(10.0, abs=1e-9)
    assert plan.joints[-1, 0] == pytest.approx(line.points[-1], abs=1e-9)
    assert plan.certified
    proved = plan.certificate.clearance
    exact = measure_exact(plan, duct, 40_000)
    assert len(exact) > 10_000
    assert 0.0 <= proved <= exact.min() <= proved + 0.3
    assert plan.field.kind == "exact"
    assert plan.field.nodes is None


def test_the_estimate_agrees_with_the_proof(zigzag):
    duct, line = zigzag
    plan = insert(duct, line, scope=Scope(diameter=5.0, link_length=10.0))
    slack = plan.field.clearance_error
    assert slack == pytest.approx(0.125)
    assert plan.clearance_min >= plan.certificate.clearance - 1e-9
    assert plan.clearance_min <= plan.certificate.found + 2.0 * slack
    place = plan.measures.clearance_where
    assert 0.0 <= place <= line.length


@pytest.mark.parametrize("method", ["tube", "follow"])
def test_in_out_in(zigzag, method):
    duct, line = zigzag
    scope = Scope(diameter=5.0, link_length=8.0)
    plan = insert(duct, line, scope=scope, route=(1.0, 0.0, 1.0), method=method)
    assert plan.status == "complete" and plan.certified
    turned = int(np.argmin(plan.head_arc_length[1:])) + 1
    assert plan.joints[turned, 0] == pytest.approx(line.points[0], abs=1e-9)
    if method == "follow":
        assert plan.joints[turned] == pytest.approx(plan.joints[0], abs=1e-6)
    assert plan.joints[-1, 0] == pytest.approx(line.points[-1], abs=1e-9)
    assert measure_exact(plan, duct, 20_000).min() >= plan.certificate.clearance


def test_a_pinch_is_proved_and_the_plan_goes_up_to_it():
    middle = np.insert(ZIGZAG, 3, (95.0, 30.0), axis=0)
    duct = make_channel(middle, [8.0, 8.0, 8.0, 2.0, 8.0, 8.0, 8.0])
    line = Centreline.from_points(shorten(middle, 20.0, 9.0), duct)
    pinch = line.arc_length[np.argmin(line.radius)]
    plan = insert(duct, line, scope=Scope(diameter=6.0, link_length=8.0))
    assert (plan.status, plan.reason_code) == ("stopped", "NO_PASSAGE")
    refusal = plan.refusal
    assert refusal.at == pytest.approx(pinch, abs=3.0)
    assert line.radius.min() <= refusal.offers < 3.0
    assert plan.certified
    assert 0.7 * pinch < plan.inserted < pinch
    # What it advises fits.
    advised = Scope(diameter=0.95 * refusal.diameter_max, link_length=8.0)
    assert insert(duct, line, scope=advised).status == "complete"


@pytest.mark.slow
def test_links_too_long_for_a_bend_are_told(zigzag):
    duct, line = zigzag
    plan = insert(duct, line, scope=Scope(diameter=9.0, link_length=30.0))
    assert plan.status == "stopped"
    assert plan.reason_code in ("LINK_TOO_LONG", "FOLD")
    assert plan.certified
    shorter = Scope(diameter=9.0, link_length=4.0)
    assert insert(duct, line, scope=shorter).status == "complete"


@pytest.mark.slow
def test_a_wall_moved_outwards_lets_a_wider_scope_pass(zigzag):
    duct, line = zigzag
    scope = Scope(diameter=17.0, link_length=8.0)
    plan = insert(duct, line, scope=scope)
    assert plan.reason_code == "ENTRY_CLEARANCE"
    plan = insert(duct.inflate(4.0), line, scope=scope)
    assert plan.status == "complete" and plan.certified
    assert plan.field.inflation == 4.0
    assert measure_exact(plan, duct, 20_000).min() >= -4.0


def test_a_saved_planar_plan_is_proved_again(zigzag, tmp_path):
    duct, line = zigzag
    plan = insert(duct, line, scope=Scope(diameter=5.0, link_length=10.0))
    back = Plan.load(plan.save(tmp_path / "planar.npz"))
    again = certify_plan(back, duct)
    assert again.certified and again.place.shape == (2,)
    assert again.clearance == pytest.approx(plan.certificate.clearance)


def test_one_joint_through_the_wall_is_caught(zigzag):
    duct, line = zigzag
    plan = insert(duct, line, scope=Scope(diameter=5.0, link_length=10.0))
    introducer = plan.introducer
    joints = plan.joints.copy()
    joints[-40, 2] += [0.0, 9.0]
    broken = certify_motion(joints, FreeSpace(duct, introducer=introducer), radius=2.5)
    assert not broken.certified
    assert abs(broken.step - (plan.steps - 40)) <= 1.0 and broken.link in (2, 3)


@pytest.mark.slow
@settings(max_examples=8)
@given(seed=st.integers(0, 10**6))
def test_a_planted_passage_is_found(seed):
    # A scope of half the channel's width, links no longer than its width, bends up to 60 deg.
    random = np.random.default_rng(seed)
    count = int(random.integers(3, 6))
    turns = np.cumsum(random.uniform(-1.0, 1.0, count)) * 0.5
    sizes = random.uniform(40.0, 60.0, count)
    steps = sizes[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    middle = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    duct = make_channel(middle, 8.0)
    line = Centreline.from_points(shorten(middle, 20.0, 10.0), duct)
    plan = insert(duct, line, scope=Scope(diameter=8.0, link_length=8.0), head_step=0.5)
    assert plan.status == "complete", plan.reason
    assert plan.certified
    assert measure_exact(plan, duct, 5_000, seed).min() >= plan.certificate.clearance
