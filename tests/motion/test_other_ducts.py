"""A chain of round cones under the planner, beside its own sampled field."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.duct import Centreline, Duct, Polygon, RoundCones
from bozzini.motion import Scope, certify_plan, find_passage
from tests.motion.plans import insert
from tests.motion.test_planar import measure_exact
from tests.shapes import bend_curve

pytestmark = pytest.mark.slow  # planners are compiled anew for ducts that are no fields

CURVE = bend_curve(25.0, 2.2, 40.0, spacing=4.0)


def make_tube(radii):
    duct = RoundCones(CURVE, np.broadcast_to(radii, len(CURVE)))
    return duct, Centreline.from_points(CURVE[3:-1], duct)


@pytest.mark.parametrize("method", ["tube", "follow"])
def test_a_bent_tube_is_passed_with_a_proof(method):
    duct, line = make_tube(6.0)
    scope = Scope(diameter=5.0, link_length=9.0)
    plan = insert(duct, line, scope=scope, method=method)
    assert plan.status == "complete" and plan.certified
    assert plan.joints.shape[2] == 3
    lengths = np.linalg.norm(np.diff(plan.joints, axis=1), axis=2)
    assert lengths == pytest.approx(9.0, abs=1e-9)
    proved = plan.certificate.clearance
    assert 0.0 <= proved <= measure_exact(plan, duct, 40_000).min() <= proved + 0.3
    assert (plan.field.kind, plan.field.interpolation_error) == ("bound", 0.0)


def test_sampled_and_analytic_tube_agree():
    duct, line = make_tube(6.0)
    scope = Scope(diameter=5.0, link_length=9.0)
    field = duct.sample(0.5)
    plan = insert(duct, line, scope=scope)
    other = insert(field, line, scope=scope)
    assert plan.status == other.status == "complete"
    # Either's proof, held against the other's wall.
    loose = 0.25
    for made in (plan, other):
        exact = certify_plan(made, duct).clearance
        assert exact > 0.0
        assert certify_plan(made, field).clearance == pytest.approx(exact, abs=loose)
    assert plan.clearance_min == pytest.approx(other.clearance_min, abs=loose)


def test_a_neck_is_proved_too_narrow_and_the_plan_goes_up_to_it():
    arc = np.linspace(-1.0, 1.0, len(CURVE))
    duct, line = make_tube(6.0 - 4.0 * np.exp(-((arc / 0.15) ** 2)))
    neck = line.arc_length[np.argmin(line.radius)]
    plan = insert(duct, line, scope=Scope(diameter=6.0, link_length=6.0))
    assert (plan.status, plan.reason_code) == ("stopped", "NO_PASSAGE")
    assert plan.refusal.at == pytest.approx(neck, abs=4.0)
    assert plan.certified
    assert 0.5 * neck < plan.inserted < neck
    thin = insert(duct, line, scope=Scope(diameter=3.0, link_length=6.0))
    assert thin.status == "complete" and thin.certified


@settings(max_examples=4)
@given(seed=st.integers(0, 10**6))
def test_the_passage_is_bounded_from_above(seed):
    # The chain's own axis is a way, so no bound may be below its narrowest ball.
    random = np.random.default_rng(seed)
    radii = random.uniform(2.0, 5.0, len(CURVE))
    duct, line = make_tube(radii)
    passage = find_passage(duct, line.points[0], goal=line.points[-1])
    assert passage.bound >= line.radius.min()
    assert passage.level <= passage.bound
    # In a tube whose radius hardly changes it is also not much above it.
    duct, line = make_tube(radii[0])
    passage = find_passage(duct, line.points[0], goal=line.points[-1])
    assert line.radius.min() <= passage.bound <= 1.15 * radii[0]


def test_a_tube_thinner_than_the_scope_is_refused_at_the_entry():
    duct, line = make_tube(3.0)
    plan = insert(duct, line, scope=Scope(diameter=7.0, link_length=9.0))
    assert (plan.status, plan.reason_code, plan.inserted) == ("stopped", "ENTRY_CLEARANCE", 0.0)
    assert "needs 3.50 mm" in plan.reason
    assert 2.99 <= plan.refusal.offers <= 3.0
    assert not plan.certified


def test_a_goal_too_near_to_the_end_is_told():
    radii = np.full(len(CURVE), 6.0)
    radii[-2:] = 2.0
    duct, line = make_tube(radii)
    plan = insert(duct, line, scope=Scope(diameter=6.0, link_length=6.0))
    assert (plan.status, plan.reason_code) == ("stopped", "GOAL_CLEARANCE")
    assert plan.certified
    assert line.length - 25.0 < plan.inserted < line.length


def test_the_thesis_scheme_runs_on_the_cones_themselves():
    duct, line = make_tube(6.0)
    scope = Scope(diameter=4.0, link_length=8.0)
    plan = insert(duct, line, scope=scope, method="thesis")
    other = insert(duct.sample(1.0), line, scope=scope, method="thesis")
    assert plan.status == other.status == "complete"
    assert np.linalg.norm(plan.joints[-1] - other.joints[-1], axis=1).max() < 0.3


@pytest.mark.parametrize("sampled", [True, False])
def test_a_way_that_exists_is_never_denied(sampled):
    # Starts beside the axis: the way goes to the axis first, and nowhere has less room than here.
    duct = RoundCones([(0, 0, 0), (0, 0, 12)], [5.0, 5.0])
    free = duct.sample(2.0) if sampled else duct
    random = np.random.default_rng(6)
    for _ in range(40):
        turn, off = random.uniform(0.0, 2.0 * np.pi), random.uniform(0.0, 4.9)
        start = np.array([off * np.cos(turn), off * np.sin(turn), random.uniform(0.0, 3.0)])
        goal = np.array([0.0, 0.0, 12.0])
        assert find_passage(free, start, goal=goal).bound >= -duct.signed_distance(start) - 1e-6


def test_every_duct_is_a_duct():
    duct, _ = make_tube(6.0)
    square = Polygon([(0, 0), (9, 0), (9, 9), (0, 9)])
    for each, dim in ((duct, 3), (duct.sample(4.0), 3), (square, 2)):
        assert isinstance(each, Duct)
        assert each.bounds.shape == (2, dim)
        place = each.bounds.mean(axis=0)
        assert each.to_grid(place).shape == (3,)
        assert each.to_world(each.to_grid(place)) == pytest.approx(place)
