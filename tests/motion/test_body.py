"""The body check: every link's clearance, against brute force; the introducer left out."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.motion import FreeSpace, Introducer, Scope
from bozzini.motion.measures import measure_body
from bozzini.motion.plan import write_record
from tests.motion.plans import insert
from tests.shapes import bend_curve, curve_distance, tube_lumen


@pytest.fixture(scope="module")
def case():
    curve = bend_curve(18.0, 2.0, 30.0)
    field, line = tube_lumen(curve, 6.0)
    plan = insert(field, line, scope=Scope(diameter=4.0, link_length=9.0))
    return curve, field, line, plan


def test_clearance_against_the_analytic_wall(case):
    curve, field, _, plan = case
    exact_distance = curve_distance(curve, 6.0)
    along = np.linspace(0.0, 1.0, 60)[:, None, None]
    error = field.error + 0.5 * FreeSpace(field).pitch
    for step in range(0, plan.steps, 37):
        ends = plan.joints[step]
        body = ends[1:] + along * (ends[:-1] - ends[1:])
        exact = (-exact_distance(body)).min(axis=0) - 2.0
        counted = np.isfinite(plan.clearance[step])
        # A link that is partly in the introducer counts with its inner part only.
        whole = counted & np.concatenate([counted[1:], [False]])
        assert plan.clearance[step][whole] == pytest.approx(exact[whole], abs=error)


def test_smallest_clearance_is_at_the_place_reported(case):
    _, field, line, plan = case
    introducer = Introducer.at_start(line, bore=float(line.radius[0]), along=9.0)
    scope = Scope(diameter=4.0, link_length=9.0)
    clearance, worst = measure_body(FreeSpace(field, introducer=introducer), plan.joints, scope)
    assert worst[3] == clearance.min() == plan.clearance_min
    assert -field.signed_distance(worst[:3]) - 2.0 == pytest.approx(worst[3], abs=1e-9)
    measures = plan.measures
    place = np.argmin(np.linalg.norm(line.points - worst[:3], axis=1))
    assert measures.clearance_where == line.arc_length[place]


def test_links_in_the_introducer_are_not_counted(case):
    plan = case[3]
    inserted = np.isfinite(plan.clearance).sum(axis=1)
    assert inserted[0] == 0
    assert np.all(np.abs(inserted - np.ceil(plan.head_arc_length / 9.0)) <= 1)
    order = np.isfinite(plan.clearance).astype(int)
    assert np.all(np.diff(order, axis=1) <= 0)


def test_a_link_broken_on_purpose_is_seen(case):
    _, field, line, plan = case
    joints = plan.joints.copy()
    joints[-5, 3] += [0.0, 8.0, 0.0]
    introducer = Introducer.at_start(line, bore=float(line.radius[0]), along=9.0)
    scope = Scope(diameter=4.0, link_length=9.0)
    clearance, worst = measure_body(FreeSpace(field, introducer=introducer), joints, scope)
    assert worst[3] < -2.0
    assert np.unravel_index(clearance.argmin(), clearance.shape)[0] == plan.steps - 5


def test_introducer_is_straight_and_starts_at_the_entry(case):
    line = case[2]
    introducer = Introducer.at_start(line, bore=5.0, along=9.0)
    chain = introducer.place_chain(5, 9.0)
    assert chain[0] == pytest.approx(line.points[0])
    assert np.linalg.norm(np.diff(chain, axis=0), axis=1) == pytest.approx(9.0)
    assert introducer.outward @ (line.points[3] - line.points[0]) < 0.0
    assert write_record(introducer)["bore_mm"] == 5.0
