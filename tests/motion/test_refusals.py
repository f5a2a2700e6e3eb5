"""Refusals of the motion package: one clear line with the field and the range."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import trimesh

from bozzini.duct import Centreline, Polygon, RoundCones
from bozzini.errors import FileFormatError, InputError
from bozzini.motion import (
    FreeSpace,
    Plan,
    PlannerOptions,
    Scope,
    certify_motion,
    certify_plan,
    find_diameter_limits,
    find_link_limits,
    move_free_chain,
    place_tail,
    plan_insertion,
    replan,
    verify_plan,
)
from bozzini.motion.recheck import recheck_motion, surface_wall
from tests.motion.plans import forge, insert, rewrite
from validation.thesis.traverse_bend import Bend, limit_by_turning

NAN, INF = float("nan"), float("inf")
TUBE = RoundCones([(0, 0, 0), (0, 0, 60)], [6.0, 6.0])
LINE = Centreline.from_points([(0, 0, 0), (0, 0, 60)], TUBE)
STRIP = Polygon([(0, 0), (40, 0), (40, 6), (0, 6)])
FLAT = Centreline.from_points([(3, 3), (37, 3)], STRIP)
SCOPE = Scope(diameter=4.0, link_length=8.0)
LINK = [(0, 0), (0, 1)]
CUBE = trimesh.creation.box((1.0, 1.0, 1.0))
WALL = surface_wall(np.array(CUBE.vertices), np.array(CUBE.faces))


@cache
def plan() -> Plan:
    """A plan that is complete and certified."""
    made = insert(TUBE, LINE, scope=SCOPE, method="follow", head_step=2.0)
    assert made.certified and made.converged
    return made


def place(head: Any = (30.0, 2.0), old: Any = (10.0, 2.0), **change: float) -> object:
    return place_tail(STRIP, head, old_tail=old, **({"length": 20.0} | change))


def state(change: Callable[[dict[str, Any]], object]) -> object:
    """Load a plan whose file states something else."""
    with TemporaryDirectory() as folder:
        return Plan.load(forge(plan().save(Path(folder) / "plan.npz"), change))


def hold(**arrays: np.ndarray) -> object:
    """Load a plan whose file holds another array."""
    line = np.stack([np.arange(5.0), np.zeros(5), np.zeros(5)], axis=1)
    sound = Plan(
        joints=np.zeros((3, 4, 3)),
        head_arc_length=np.zeros(3),
        clearance=np.ones((3, 3)),
        path=line,
        path_arc_length=np.arange(5.0),
        path_radius=np.ones(5),
        method="drawn",
        status="stopped",
    )
    with TemporaryDirectory() as folder:
        return Plan.load(rewrite(sound.save(Path(folder) / "plan.npz"), **arrays))


# fmt: off
REFUSALS: list[tuple[Callable[[], object], type[InputError], str, str]] = [
    # Things of another kind
    (lambda: plan_insertion(TUBE, "middle", scope=SCOPE),
     InputError, "line is 'middle'", "a Centreline"),
    (lambda: plan_insertion(TUBE, LINE, scope=6.0), InputError, "scope is 6.0", "a Scope"),
    (lambda: plan_insertion(TUBE, LINE, scope=SCOPE, options=[]),
     InputError, "options is []", "a PlannerOptions"),
    (lambda: FreeSpace(TUBE, LINE, "tube"), InputError, "introducer is 'tube'", "an Introducer"),
    (lambda: PlannerOptions(advise="yes"), InputError, "advise is 'yes'", "a bool"),
    (lambda: certify_motion("x", TUBE, radius=1.0), InputError, "joints is 'x'", "numbers"),
    (lambda: certify_plan(None, TUBE), InputError, "plan is None", "a Plan"),
    (lambda: verify_plan("mine"), InputError, "plan is 'mine'", "a Plan"),
    (lambda: Plan.load(None), InputError, "plan is None", "the path of a file"),
    # Scopes, routes and options
    (lambda: Scope(diameter=0.0, link_length=5.0),
     InputError, "scope diameter is 0 mm", "[0.1, 500] mm"),
    (lambda: Scope(diameter=NAN, link_length=5.0),
     InputError, "scope diameter is nan mm", "[0.1, 500] mm"),
    (lambda: Scope(diameter=INF, link_length=5.0),
     InputError, "scope diameter is inf mm", "[0.1, 500] mm"),
    (lambda: Scope(diameter="wide", link_length=5.0),
     InputError, "scope diameter is 'wide'", "[0.1, 500] mm"),
    (lambda: Scope(diameter=None, link_length=5.0),
     InputError, "scope diameter is None", "[0.1, 500] mm"),
    (lambda: Scope(diameter=5.0, link_length=-1.0),
     InputError, "link length is -1 mm", "[0.1, 10000] mm"),
    (lambda: Scope(diameter=5.0, link_length=None),
     InputError, "link length is None", "[0.1, 10000] mm"),
    (lambda: Scope(diameter=2.0, link_length=5.0, length=4.0),
     InputError, "scope length is 4 mm", "[5, 10000] mm"),
    (lambda: Scope(diameter=2.0, link_length=8.0, length=1e9),
     InputError, "scope length is 1e+09 mm", "[8, 10000] mm"),
    (lambda: PlannerOptions(head_step=NAN), InputError, "head step is nan mm", "[0.001, 10000] mm"),
    (lambda: PlannerOptions(head_step=None), InputError, "head step is None", "[0.001, 10000] mm"),
    (lambda: PlannerOptions(head_step=0.0), InputError, "head step is 0 mm", "[0.001, 10000] mm"),
    (lambda: PlannerOptions(slip=1.5), InputError, "slip is 1.5", "[0, 1]"),
    (lambda: PlannerOptions(angle_limit=0.0),
     InputError, "angle limit is 0 rad", "(0, 3.14159] rad"),
    (lambda: PlannerOptions(route=(0.0,)), InputError, "route is (0.0,)", "(0, 1]"),
    (lambda: PlannerOptions(route=(2.0,)), InputError, "route is 2", "[0, 1]"),
    (lambda: PlannerOptions(route=0.5), InputError, "route is 0.5", "a sequence of fractions"),
    (lambda: PlannerOptions(route="in"), InputError, "route is 'in'", "a sequence of fractions"),
    # Planning
    (lambda: insert(TUBE, LINE, scope=SCOPE, method="magic"),
     InputError, "method is 'magic'", "best, tube, follow, thesis"),
    (lambda: insert(TUBE, LINE, scope=SCOPE, head_step=9.0),
     InputError, "head step is 9 mm", "[0.001, 8] mm"),
    (lambda: insert(TUBE, LINE, scope=Scope(diameter=4.0, link_length=500.0)),
     InputError, "link length is 500 mm", "at most the tract's centreline, 60 mm"),
    (lambda: insert(TUBE, LINE, scope=Scope(diameter=2.0, link_length=8.0, length=8000.0),
        head_step=1e-3),
     InputError, "head step is 0.001 mm", "at least 0.00607 mm for 1001 joints on a"),
    (lambda: insert(TUBE, LINE, scope=SCOPE, method="thesis", slip=0.5),
     InputError, "method 'thesis' has no slip, angle limit or route",
     "leave them out, or use one of best, tube,"),
    (lambda: insert(STRIP, LINE, scope=SCOPE),
     InputError, "the centreline's points have shape (61, 3)", "this duct needs (n, 2)"),
    (lambda: insert(3, LINE, scope=SCOPE), InputError, "duct is a int", "a duct"),
    (lambda: FreeSpace(TUBE).centreline,
     InputError, "this free space has no line from the entry to the goal", "give one"),
    (lambda: FreeSpace(TUBE, LINE).tube,
     InputError, "this free space has no introducer", "give one"),
    # Certificates
    (lambda: certify_motion(np.zeros((3, 1, 3)), TUBE, radius=1.0),
     InputError, "joints of shape (3, 1, 3) must be finite and (steps,", ""),
    (lambda: certify_motion(np.zeros((3, 3)), TUBE, radius=1.0),
     InputError, "joints of shape (3, 3) must be finite and (steps, joints,", ""),
    (lambda: certify_motion(np.full((2, 2, 3), NAN), TUBE, radius=1.0),
     InputError, "joints of shape (2, 2, 3) must be finite and (steps,", ""),
    (lambda: certify_motion(np.zeros((2, 2, 3)), TUBE, radius=-1.0),
     InputError, "radius is -1 mm", "[0, inf) mm"),
    (lambda: certify_motion(np.zeros((2, 2, 3)), TUBE, radius=1.0, tolerance=0.0),
     InputError, "tolerance is 0 mm", "[0.0001, 10] mm"),
    (lambda: certify_motion(np.zeros((1, 2, 3)), STRIP, radius=1.0),
     InputError, "joints have shape (1, 2, 3)", "the duct needs (steps, joints, 2)"),
    (lambda: certify_plan(replace(plan(), scope=None), TUBE),
     InputError, "the plan has no scope", "scope diameter and link length are not"),
    (lambda: recheck_motion(np.zeros((2, 2, 2)), WALL, radius=1.0),
     InputError, "joints have shape (2, 2, 2)", "(steps, joints, 3)"),
    (lambda: recheck_motion(np.full((2, 2, 3), NAN), WALL, radius=1.0),
     InputError, "joints are not all finite", ""),
    (lambda: recheck_motion(np.zeros((2, 2, 3)), WALL, radius=-1.0),
     InputError, "radius is -1 mm", "[0, inf) mm"),
    (lambda: recheck_motion(np.zeros((2, 2, 3)), WALL, radius=1.0, inflation=-1.0),
     InputError, "inflation is -1 mm", "[0, inf) mm"),
    (lambda: recheck_motion(np.zeros((2, 2, 3)), WALL, radius=1.0, tolerance=0.0),
     InputError, "tolerance is 0 mm", "[0.0001, 10] mm"),
    # One link, and free chains
    (lambda: place(length=0.0), InputError, "length is 0 mm", "[1e-06, 1e+06] mm"),
    (lambda: place(length=NAN), InputError, "length is nan mm", "[1e-06, 1e+06] mm"),
    (lambda: place(clearance=-1.0), InputError, "clearance is -1 mm", "[0, 1e+06] mm"),
    (lambda: place(gap=1.0), InputError, "gap is 1 rad", "[1e-05, 0.1] rad"),
    (lambda: place(head=(1.0, 2.0, 3.0)), InputError, "head has shape (3,)", "(..., 2)"),
    (lambda: place(head=[(1.0, 2.0)]), InputError, "head has shape (1, 2)", "one point, (2,)"),
    (lambda: place(head=(1e200, 2.0)), InputError, "head[0] is 1e+200 mm", "[-1e+06, 1e+06] mm"),
    (lambda: place(old=(30.0, 2.0)),
     InputError, "the head is on the old tail, [30.0, 2.0] mm",
     "the direction to it must be known, use a"),
    (lambda: place(old=(INF, 0.0)),
     InputError, "old tail has 1 point(s) that are not finite (NaN or", ""),
    (lambda: move_free_chain([(0, 0)], [(0, 0)]),
     InputError, "joints have shape (1, 2)", "(joints >= 2, 2 or 3)"),
    (lambda: move_free_chain([(0, 0), (0, 0)], [(1, 0)]),
     InputError, "link 1 has length 0", "above 0 mm"),
    (lambda: move_free_chain(LINK, [(NAN, 0)]),
     InputError, "head path has 1 point(s) that are not finite (NaN or", ""),
    (lambda: move_free_chain(LINK, [(1, 0, 0)]),
     InputError, "head path has shape (1, 3)", "(..., 2)"),
    (lambda: move_free_chain(LINK, [(1, 0)], slip=1.2), InputError, "slip is 1.2", "[0, 1]"),
    (lambda: move_free_chain(LINK, [(1, 0)], substep=2.0),
     InputError, "substep is 2 mm", "(0, 1] mm"),
    (lambda: move_free_chain(LINK, [(1, 0)], scheme="best"),
     InputError, "scheme is 'best'", "one of exact, least"),
    (lambda: move_free_chain(LINK, [(0, 1)], scheme="least"),
     InputError, "head step 0", "link 1's head lands on the old place of its"),
    # Planning again
    (lambda: replan(replace(plan(), method="thesis"), TUBE),
     InputError, "a plan by method 'thesis' cannot be planned again",
     "by 'tube' or 'follow' (use plan_insertion)"),
    (lambda: replan(replace(plan(), scope=None), TUBE),
     InputError, "the plan has no scope", "scope diameter and link length are not"),
    (lambda: replan(replace(plan(), introducer=None), TUBE, scope=SCOPE),
     InputError, "the plan has no introducer", ""),
    (lambda: replan(plan(), TUBE, advect=lambda points: points[1:]),
     InputError, "advect returns (120, 3) for points (121, 3)", "they must agree"),
    (lambda: replan(plan(), TUBE, advect=lambda points: points * NAN),
     InputError, "what advect returns has 121 point(s) that are not finite", ""),
    (lambda: replan(plan(), TUBE, advect=lambda points: 0.0 * points),
     InputError, "advect folds the tissue at the entry", "the introducer has no direction"),
    (lambda: replan(plan(), TUBE, scope=Scope(diameter=4.0, link_length=500.0)),
     InputError, "link length is 500 mm", "at most the tract's centreline, 60 mm"),
    (lambda: replan(plan(), STRIP),
     InputError, "the last plan has 3 dimensions, the duct has 2", "they must agree"),
    # Limits of links
    (lambda: find_link_limits(STRIP, FLAT, diameter=-1.0),
     InputError, "diameter is -1 mm", "[0, inf) mm"),
    (lambda: find_link_limits(STRIP, FLAT, diameter=1.0, stations=0),
     InputError, "stations is 0", "[1, inf]"),
    (lambda: find_link_limits(STRIP, FLAT, diameter=1.0, stations=3).judge(0.0),
     InputError, "link is 0 mm", "(0, inf) mm"),
    (lambda: find_diameter_limits(STRIP, FLAT, link=-1.0),
     InputError, "link is -1 mm", "[0, inf) mm"),
    (lambda: Bend(radius=0, half_width=1),
     InputError, "radius of the bend is 0 mm", "[1e-06, 1e+06] mm"),
    (lambda: Bend(radius=NAN, half_width=1),
     InputError, "radius of the bend is nan mm", "[1e-06, 1e+06] mm"),
    (lambda: Bend(radius=1e200, half_width=1),
     InputError, "radius of the bend is 1e+200 mm", "[1e-06, 1e+06] mm"),
    (lambda: Bend(radius=3, half_width=1, body_radius=1),
     InputError, "body radius is 1 mm", "[0, 1) mm"),
    (lambda: Bend(radius=3, half_width=1, angle=4),
     InputError, "angle of the bend is 4 rad", "[1e-06, 3.14159] rad"),
    (lambda: Bend(radius=30, half_width=10, angle=5e-324),
     InputError, "angle of the bend is 4.94066e-324 rad", "[1e-06, 3.14159] rad"),
    (lambda: Bend(radius=30, half_width=13, body_radius=5, angle=0.5).limit_rigid(flat_ends=True),
     InputError, "angle of the bend is 0.5 rad", "[1.784, pi] rad"),
    (lambda: Bend(radius=1, half_width=3, body_radius=0.5).first_joint_lock(),
     InputError, "a bend without an inner wall does not lock a link", ""),
    (lambda: Bend(radius=3, half_width=1).limit_with_head_at(4.5),
     InputError, "head radius is 4.5 mm", "[2, 4] mm"),
    (lambda: Bend(radius=3, half_width=1).measure_joint_only_depth(5.5),
     InputError, "length is 5.5 mm", "(1, 5] mm"),
    (lambda: limit_by_turning(-1.0), InputError, "curvature is -1 1/mm", "[0, inf)"),
    # Plans and their files
    (lambda: replace(plan(), joints=np.zeros((4, 1, 3))),
     InputError, "joints has shape (4, 1, 3)", "(steps, joints, dim) with at least 1 step,"),
    (lambda: replace(plan(), clearance=np.zeros((4, 3))),
     InputError, "clearance has shape (4, 3)", "(31, 8)"),
    (lambda: replace(plan(), head_arc_length=np.zeros(3)),
     InputError, "head_arc_length has shape (3,)", "(31,)"),
    (lambda: replace(plan(), status="done"),
     InputError, "status is 'done'", "'complete' or 'stopped'"),
    (lambda: state(lambda meta: meta.update(certified="yes")),
     FileFormatError, "meta.certified is 'yes'", "true or false"),
    (lambda: state(lambda meta: meta["certificate"].update(clearance_mm=-0.5)),
     FileFormatError, "meta.certified is true, but the certificate has a clearance",
     "at least 0 mm"),
    (lambda: state(lambda meta: meta.pop("certificate")),
     FileFormatError, "meta.certified is true, but the certificate has no clearance",
     "at least 0 mm"),
    (lambda: state(lambda meta: meta["certificate"].update(clearance_mm=7.0)),
     FileFormatError, "the certificate's clearance is 7 mm",
     "the clearances at the steps allow at most"),
    (lambda: state(lambda meta: meta["certificate"].update(clearance_mm=NAN)),
     FileFormatError, "meta.certificate.clearance_mm is not a finite number", ""),
    (lambda: state(lambda meta: meta["certificate"].update(place_mm="abc")),
     FileFormatError, "meta.certificate.place_mm is 'abc'", "a list of numbers"),
    (lambda: state(lambda meta: meta["certificate"].update(place_mm=[])),
     FileFormatError, "meta.certificate.place_mm is []", "a list of numbers"),
    (lambda: state(lambda meta: meta["scope"].update(diameter_mm=-5.0)),
     FileFormatError, "meta.scope.diameter_mm is -5 mm", "[0.1, 500] mm"),
    (lambda: state(lambda meta: meta["scope"].update(diameter_mm="5")),
     FileFormatError, "meta.scope.diameter_mm is '5'", "a number"),
    (lambda: state(lambda meta: meta["scope"].update(link_length_mm=0)),
     FileFormatError, "meta.scope.link_length_mm is 0 mm", "[0.1, 10000] mm"),
    (lambda: state(lambda meta: meta["scope"].update(length_mm=1.0)),
     FileFormatError, "meta.scope: scope length is 1 mm", "[8, 10000] mm"),
    (lambda: state(lambda meta: meta["introducer"].update(bore_mm=-1.0)),
     FileFormatError, "meta.introducer.bore_mm is -1 mm", "(0, 1e+06] mm"),
    (lambda: state(lambda meta: meta["introducer"].update(outward=[0, 0, 2])),
     FileFormatError, "meta.introducer.outward has length 2", "1"),
    (lambda: state(lambda meta: meta["introducer"].update(outward={})),
     FileFormatError, "meta.introducer.outward is {}", "a list of numbers"),
    (lambda: state(lambda meta: meta["introducer"].update(entry_mm=[0, 0])),
     FileFormatError, "meta.introducer.entry_mm has shape (2,)", "(3,)"),
    (lambda: state(lambda meta: meta["introducer"].update(entry_mm="abc")),
     FileFormatError, "meta.introducer.entry_mm is 'abc'", "a list of numbers"),
    (lambda: state(lambda meta: meta["introducer"].update(entry_mm=5)),
     FileFormatError, "meta.introducer.entry_mm is 5", "a list of numbers"),
    (lambda: state(lambda meta: meta["field"].update(inflation_mm=-1.0)),
     FileFormatError, "meta.field.inflation_mm is -1 mm", "[0, 1e+06] mm"),
    (lambda: state(lambda meta: meta.update(soft_wall={"used_mm": 3.0, "allowed_mm": 1.0})),
     FileFormatError, "meta.soft_wall.used_mm is 3 mm", "at most what is allowed and part of"),
    (lambda: state(lambda meta: meta.update(scope=[5])),
     FileFormatError, "meta.scope is [5]", "an object"),
    (lambda: state(lambda meta: meta.update(status="done")),
     FileFormatError, "status is 'done'", "'complete' or 'stopped'"),
    (lambda: state(lambda meta: meta.update(status=None)),
     FileFormatError, "status is None", "text"),
    (lambda: state(lambda meta: meta.update(method="")),
     FileFormatError, "method is empty", "it must name the planner"),
    (lambda: state(lambda meta: meta.update(reason="it locks")),
     FileFormatError, "status is 'complete', but a reason to stop is given ('')",
     "one of them is wrong"),
    (lambda: state(lambda meta: meta.update(format="bozzini-plan-9")),
     FileFormatError, "is not a plan of format 'bozzini-plan-1'", ""),
    (lambda: hold(joints=np.full((3, 4, 3), NAN)),
     FileFormatError, "joints[0, 0, 0] is nan", "finite"),
    (lambda: hold(joints=np.zeros((3, 4, 4))),
     FileFormatError, "joints has shape (3, 4, 4)", "(steps, joints, dim) with at least 1 step,"),
    (lambda: hold(joints=np.zeros((3, 4, 1))),
     FileFormatError, "joints has shape (3, 4, 1)", "(steps, joints, dim) with at least 1 step,"),
    (lambda: hold(joints=np.full((3, 4, 3), 1e9)),
     FileFormatError, "joints reaches 1e+09 mm", "within 1e+06 mm"),
    (lambda: hold(joints=np.zeros((3, 4, 3), dtype=complex)),
     FileFormatError, "joints is complex128", "an array of numbers"),
    (lambda: hold(path=np.zeros((5, 2))),
     FileFormatError, "path has shape (5, 2)", "(m, 3) with m at least 2"),
    (lambda: hold(path=np.full((5, 3), INF)), FileFormatError, "path[0, 0] is inf", "finite"),
    (lambda: hold(path_arc_length=np.arange(5.0)[::-1].copy()),
     FileFormatError, "path_arc_length must begin at 0 and never fall", ""),
    (lambda: hold(path_radius=np.ones(4)), FileFormatError, "path_radius has shape (4,)", "(5,)"),
    (lambda: hold(clearance=np.full((3, 3), -INF)),
     FileFormatError, "clearance[0, 0] is -inf", "finite"),
    (lambda: hold(head_arc_length=np.full(3, NAN)),
     FileFormatError, "head_arc_length[0] is nan", "finite"),
    (lambda: hold(meta=np.array("{")), FileFormatError, "is not a Bozzini plan", ""),
    (lambda: hold(meta=np.array("[" * 100_000)), FileFormatError, "is not a Bozzini plan", ""),
    (lambda: hold(meta=np.array(["a"], dtype=object)),
     FileFormatError, "is not a Bozzini plan", ""),
    (lambda: hold(meta=np.zeros(3)), FileFormatError, "is not a Bozzini plan", ""),
]
# fmt: on
"""What is asked, the error, the field that the message names, and what it states as legal."""


@pytest.mark.parametrize(("call", "error", "field", "legal"), REFUSALS)
def test_refused(
    call: Callable[[], object], error: type[InputError], field: str, legal: str
) -> None:
    with pytest.raises(error) as caught:
        call()
    line = re.sub(r"^\S*plan\.npz:? ", "", str(caught.value))
    assert line.startswith(field) and legal in line
    assert "\n" not in line and len(line) < 300
