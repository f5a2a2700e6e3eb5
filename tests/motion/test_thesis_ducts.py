"""The thesis's scheme in every representation of a duct, each plan held against the duct again."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.duct import Centreline, Polygon, RoundCones
from bozzini.motion import FreeSpace, Introducer, Scope, certify_plan
from bozzini.motion.thesis import move_by_thesis
from tests.motion.pipes import NAMES, load_example, make_pipes
from tests.motion.plans import insert
from tests.motion.test_link_ducts import room_at
from tests.motion.test_planar import measure_exact
from tests.shapes import bend_curve

SCOPE = Scope(diameter=6.0, link_length=9.0)


def plan_pipe(name, scope=SCOPE, head_step=0.5):
    duct = make_pipes()[name]
    line = load_example().make_line(duct)
    return duct, line, insert(duct, line, scope=scope, method="thesis", head_step=head_step)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_chain_goes_through_every_pipe_and_is_checked_again(name):
    duct, line, plan = plan_pipe(name)
    assert (plan.status, plan.reason) == ("complete", "")
    assert plan.joints.shape[2] == duct.bounds.shape[1]
    assert plan.joints[-1, 0] == pytest.approx(line.points[-1], abs=1e-9)
    lengths = np.linalg.norm(np.diff(plan.joints, axis=1), axis=2)
    assert lengths == pytest.approx(9.0, abs=1e-9)
    # joints keep the scope's radius once they are ahead of the entry
    introducer = plan.introducer
    joints = plan.joints[1:].reshape(-1, plan.joints.shape[2])
    joints = joints[(joints - introducer.entry) @ introducer.outward < 0.0]
    assert room_at(duct, joints).min() >= 3.0 - 2e-9
    # some are at the wall, so that it was felt
    assert np.mean(room_at(duct, joints) < 3.0 + 1e-6) > 0.02
    # the whole body, again: the proof, by itself from the plan, and random places of the body
    proved = plan.certificate.clearance
    assert certify_plan(plan, duct).clearance == proved
    found = measure_exact(plan, duct, 4_000).min()
    assert proved <= found + 1e-9
    assert plan.certified == (proved >= 0.0)
    moves = np.linalg.norm(np.diff(plan.joints, axis=0), axis=2)
    assert moves.max() <= 4.0 * 0.5 + 1e-9


@pytest.mark.slow
def test_alike_pipes_are_passed_alike():
    # The same polygon by three names, and its sampling; the same tube with facets and without.
    planar = [plan_pipe(name)[2].joints for name in ("polygon", "stitched quads")]
    assert planar[0].shape == planar[1].shape
    assert planar[0] == pytest.approx(planar[1], abs=1e-6)
    for name, other, loose in (
        ("polygon", "sampled, planar", 0.1),
        ("polygon", "between curves", 0.15),
        ("round cones", "sampled field", 0.3),
        ("round cones", "cylinders", 0.3),
        ("round cones", "mesh", 0.3),
    ):
        a, b = plan_pipe(name)[2], plan_pipe(other)[2]
        gap = np.linalg.norm(a.joints[-1] - b.joints[-1], axis=1)
        assert gap.max() < loose, f"{name}, {other}"


def test_a_planar_pipe_is_the_middle_of_a_tall_one():
    # In a channel with flat walls a chain that starts in the middle plane stays in it.
    _, _, flat = plan_pipe("polygon")
    _, _, round_ = plan_pipe("round cones")
    assert np.abs(round_.joints[..., 2]).max() < 1e-6
    assert np.linalg.norm(flat.joints[-1] - round_.joints[-1][:, :2], axis=1).max() < 0.3


def test_obstacles_are_kept_off():
    duct, _, plan = plan_pipe("with obstacles")
    (circles,) = duct.obstacles
    introducer = plan.introducer
    joints = plan.joints.reshape(-1, 2)
    joints = joints[(joints - introducer.entry) @ introducer.outward < 0.0]
    gaps = np.linalg.norm(joints[:, None] - circles.centres, axis=2) - circles.radii
    assert 3.0 - 2e-9 <= gaps.min() <= 3.0 + 1e-6
    free = plan_pipe("polygon")[2]
    assert np.abs(free.joints[-1] - plan.joints[-1]).max() > 0.5


def test_a_lock_is_where_it_is_in_the_sampled_tube():
    # Thesis Fig. 5.30: joints only, a link too long for a half turn.
    curve = bend_curve(15.0, np.pi, 60.0)
    cones = RoundCones(curve, np.full(len(curve), 5.0))
    line = Centreline.from_points(curve[3:-4], cones)
    scope = Scope(diameter=0.2, link_length=22.0)
    plans = [
        insert(duct, line, scope=scope, method="thesis") for duct in (cones, cones.sample(1.0))
    ]
    for plan in plans:
        assert (plan.status, plan.reason_code) == ("stopped", "LINK_LOCKED")
        assert plan.reason.startswith(f"link 2 locks in step {plan.steps}, with the head at ")
        assert "its nearest tail at 22 mm with 0.10 mm from the wall is a jump of" in plan.reason
        head = [float(v) for v in plan.reason.split("(")[1].split(")")[0].split(",")]
        assert head == pytest.approx(plan.joints[-1, 0], abs=0.1)
    assert plans[0].inserted == pytest.approx(plans[1].inserted, abs=1.0)


def test_a_link_without_a_place_is_said_with_all_that_was_asked():
    # Without a tube to come from, a link longer than the room has nowhere to be.
    room = Polygon([(0, -5), (20, -5), (20, 5), (0, 5)])
    line = Centreline.from_points([(5.0, 0.0), (15.0, 0.0)], room)
    tube = Introducer(entry=line.points[0], outward=np.array([-1.0, 0.0]), bore=0.0)
    scope = Scope(diameter=2.0, link_length=30.0)
    motion = move_by_thesis(FreeSpace(room, line, tube), scope, links=2, head_step=0.25)
    assert motion.reason_code == "LINK_INFEASIBLE"
    assert motion.joints.shape == (1, 3, 2)
    # from (5, 0) the farthest places with 1 mm are (19, +-4)
    lack = 30.0 - np.hypot(14.0, 4.0)
    assert motion.reason.startswith("link 1 has no place in step 1, with the head at 0.0 mm (5.0, ")
    assert "no tail at 30 mm has 1.00 mm from the wall, the best lacks" in motion.reason
    lacks = float(motion.reason.split("lacks ")[1].split(" mm")[0])
    assert 0.5 * lack < lacks < lack + 0.5
