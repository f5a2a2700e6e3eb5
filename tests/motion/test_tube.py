"""The tube tractrix: exact lengths, bounded motion, and its two limits."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.duct import field_from_mask
from bozzini.duct.centreline import Centreline
from bozzini.motion import Scope, certify_plan
from bozzini.motion.kernels.tube import move_in_tube as move
from bozzini.motion.tube import DEVIATION_CAP, STEP_RATIO_MAX
from bozzini.numeric.polylines import measure_arc_length
from tests.exact import voxelise
from tests.motion.plans import insert
from tests.shapes import bend_curve

LINK = 9.0


@pytest.fixture(scope="module")
def bend():
    curve = bend_curve(14.0, 2.6, 32.0)
    field = field_from_mask(*voxelise(curve, 5.6))
    return field, Centreline.from_points(curve[8:-8], field)


def plan(bend, **options):
    return insert(*bend, scope=Scope(diameter=4.0, link_length=LINK), **options)


def travel(joints):
    return float(np.linalg.norm(np.diff(joints, axis=0), axis=2).sum())


def distance_to_polyline(points, line):
    start, stop = line[:-1], line[1:]
    along = stop - start
    share = np.einsum("nmk,mk->nm", points[:, None] - start, along) / (along**2).sum(axis=1)
    share = np.clip(share, 0.0, 1.0)[..., None]
    return np.linalg.norm(points[:, None] - start - share * along, axis=2).min(axis=1)


@pytest.mark.parametrize(
    "options",
    [{}, {"method": "follow"}, {"slip": 0.6}, {"route": (1.0, 0.0, 0.8)}, {"head_step": 2.0}],
)
def test_link_lengths_are_exact_and_the_motion_is_certified(bend, options):
    result = plan(bend, **options)
    assert result.status == "complete"
    lengths = np.linalg.norm(np.diff(result.joints, axis=1), axis=2)
    assert lengths == pytest.approx(LINK, abs=1e-9)
    assert result.certified
    assert certify_plan(result, bend[0]).clearance >= 0.0


def test_followers_stay_on_the_path(bend):
    result = plan(bend, method="follow", head_step=1.0)
    entry = result.path[0]
    outward = np.array(result.introducer.outward)
    line = np.concatenate([[entry + 500.0 * outward], result.path])
    joints = result.joints[::5].reshape(-1, 3)
    assert distance_to_polyline(joints, line).max() < 1e-6


def test_the_head_follows_its_path_and_reaches_the_goal(bend):
    for options in ({}, {"method": "follow"}):
        result = plan(bend, **options)
        assert distance_to_polyline(result.joints[::7, 0], result.path).max() < 1e-6
        assert result.joints[-1, 0] == pytest.approx(bend[1].points[-1], abs=1e-6)


def test_the_tube_spares_motion(bend):
    assert travel(plan(bend, method="tube").joints) <= travel(plan(bend, method="follow").joints)


def test_joints_move_boundedly_however_fine_the_head_steps(bend):
    ratios = []
    for step in (0.4, 0.4 / 16.0):
        result = plan(bend, head_step=step)
        moves = np.linalg.norm(np.diff(result.joints, axis=0), axis=2).max()
        ratios.append(moves / np.diff(result.head_arc_length).max())
    assert ratios[0] < 2.0
    assert ratios[1] == pytest.approx(ratios[0], rel=0.1)


def test_in_out_in_ends_where_in_ends(bend):
    once = plan(bend)
    again = plan(bend, route=(1.0, 0.0, 1.0))
    assert again.certified
    # The motion has hysteresis, as a tractrix has: most where joints have hardly entered.
    gaps = np.linalg.norm(again.joints[-1] - once.joints[-1], axis=1)
    assert gaps.max() <= DEVIATION_CAP * LINK
    assert gaps[: len(gaps) // 2].max() < 0.5
    out = again.joints[np.argmin(again.head_arc_length[1:]) + 1]
    assert out[0] == pytest.approx(once.joints[0, 0], abs=1e-9)


def glide(path, heads, chain, *, slip=0.0, freedom=1.0, tube=1e6, cap=0.999):
    """Move one chain along a polyline, far from all walls."""
    arc = measure_arc_length(path)
    out = np.empty((len(heads), len(chain), 3))
    behind = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(chain, axis=0), axis=1))])
    length = float(np.linalg.norm(chain[1] - chain[0]))
    move(
        path,
        arc,
        np.full(len(path), float(tube)),
        np.asarray(heads, dtype=float),
        length,
        cap,
        slip,
        freedom,
        chain.copy(),
        heads[0] - behind,
        out,
    )
    return out


def oblique_chain(angle, head, length=10.0):
    """One link whose tail is `angle` off the x axis, behind the head."""
    tail = head + length * np.array([-np.cos(angle), np.sin(angle), 0.0])
    return np.stack([head, tail])


X_AXIS = np.arange(-200.0, 200.5, 1.0)[:, None] * np.array([1.0, 0.0, 0.0])


def test_without_walls_it_is_the_tractrix_and_of_first_order():
    # Pulled straight, tan(theta / 2) falls as exp(-s / L); theta from the travel to the link.
    length, start, way = 10.0, 0.9, 15.0
    errors = []
    for count in (60, 120, 240):
        heads = 200.0 + np.linspace(0.0, way, count + 1)
        joints = glide(X_AXIS, heads, oblique_chain(start, np.zeros(3), length))
        link = joints[-1, 0] - joints[-1, 1]
        theta = np.arctan2(-link[1], link[0])
        exact = 2.0 * np.arctan(np.tan(start / 2.0) * np.exp(-way / length))
        errors.append(abs(theta - exact))
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert errors[-1] < 0.01
    assert np.all((ratios > 1.9) & (ratios < 2.1))


def test_full_slip_moves_the_chain_like_the_head():
    chain = oblique_chain(0.8, np.zeros(3))
    heads = 200.0 + np.linspace(0.0, 8.0, 30)
    joints = glide(X_AXIS, heads, chain, slip=1.0)
    shift = joints - joints[:1]
    assert shift[:, 1] == pytest.approx(shift[:, 0], abs=1e-9)


@pytest.mark.parametrize("slip", [0.3, 0.7])
def test_slip_stretches_the_link_in_the_law_of_the_tractrix(slip):
    # Appendix C corrected: the exponent is (1 - slip) s / L.
    length, start, way = 10.0, 0.9, 15.0
    heads = 200.0 + np.linspace(0.0, way, 6001)
    joints = glide(X_AXIS, heads, oblique_chain(start, np.zeros(3), length), slip=slip)
    link = joints[-1, 0] - joints[-1, 1]
    exact = np.tan(start / 2.0) * np.exp(-(1.0 - slip) * way / length)
    assert np.tan(0.5 * np.arctan2(-link[1], link[0])) == pytest.approx(exact, rel=2e-3)


def test_a_narrow_tube_holds_the_joint_near_the_path():
    chain = oblique_chain(0.5, np.zeros(3))
    heads = 200.0 + np.linspace(0.0, 10.0, 40)
    for tube in (0.0, 0.4, 2.0):
        joints = glide(X_AXIS, heads, chain, tube=tube)
        expected = X_AXIS[0] + (heads[:, None] - 10.0) * np.array([1.0, 0.0, 0.0])
        assert np.linalg.norm(joints[:, 1] - expected, axis=1).max() <= tube + 1e-9


def test_an_angle_that_following_keeps_is_no_reason_to_stop(bend):
    follow = plan(bend, method="follow")
    limit = follow.measures.joint_angle_max + 0.005
    free = plan(bend, method="tube")
    assert free.measures.joint_angle_max > limit
    held = plan(bend, method="tube", angle_limit=limit)
    assert held.status == "complete"
    assert held.measures.joint_angle_max <= limit
    tight = plan(bend, method="tube", angle_limit=0.5 * limit)
    assert (tight.status, tight.reason_code) == ("stopped", "ANGLE")
    assert tight.certified


@pytest.mark.parametrize(("diameter", "link"), [(2.0, 6.0), (4.0, 9.0), (6.0, 14.0)])
def test_the_best_plan_has_the_most_certified_clearance(bend, diameter, link):
    scope = Scope(diameter=diameter, link_length=link)
    best, *others = (insert(*bend, scope=scope, method=name) for name in ("best", "tube", "follow"))
    proved = best.certificate.clearance
    ratio = best.measures.joint_step_ratio_max
    for other in others:
        assert other.certificate.clearance <= proved + 1e-9
    # It is the candidate that it names, and the best of the calm ones.
    assert best.method in ("tube", "follow")
    assert (best.method == "follow") == (best.freedom == 0.0)
    assert best.asked == "best"
    calm = [one for one in best.candidates if one.joint_step_ratio <= STEP_RATIO_MAX]
    assert len(best.candidates) >= 3
    assert proved == pytest.approx(max(one.clearance for one in calm), abs=1e-9)
    assert ratio <= STEP_RATIO_MAX
    assert certify_plan(best, bend[0]).clearance == pytest.approx(proved)


def test_a_best_motion_whose_joints_jump_is_not_taken(bend):
    # Links nearly as long as the bend is wide: some candidates may move fast, none is chosen then.
    scope = Scope(diameter=2.0, link_length=24.0)
    best = insert(*bend, scope=scope)
    ratios = [one.joint_step_ratio for one in best.candidates]
    chosen = best.measures.joint_step_ratio_max
    assert best.status == "complete"
    assert chosen <= STEP_RATIO_MAX or chosen == pytest.approx(min(ratios))
