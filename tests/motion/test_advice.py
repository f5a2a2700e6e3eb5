"""Advice is what was planned: every value that a refusal names is re-run from scratch."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bozzini.duct import build_field, field_from_mask, find_centreline
from bozzini.motion import FreeSpace, PlannerOptions, Scope, find_largest, largest, plan_insertion
from bozzini.motion.planner import advise_plan
from bozzini.numeric.polylines import measure_arc_length
from tests.exact import voxelise
from tests.human import load_human
from tests.motion.plans import insert
from tests.motion.planted import random_curve
from tests.shapes import bend_curve


class Lumen:
    """A voxel lumen that can be built anew with an inflation, as a new run does."""

    def __init__(self, build, ends, made=None):
        self.build, self.ends = build, ends
        self.field, self.line = made or self.make(0.0)

    def make(self, inflation):
        field = self.build(inflation)
        return field, find_centreline(field, self.ends)

    def plan(self, *, diameter, link, inflation=0.0, **options):
        field, line = (self.field, self.line) if inflation == 0.0 else self.make(inflation)
        scope = Scope(diameter=diameter, link_length=link)
        return insert(field, line, scope=scope, head_step=1.0, **options)


def make_tube(curve, radius, ends=None):
    mask, affine = voxelise(curve, radius)
    return Lumen(
        lambda inflation: field_from_mask(mask, affine, inflate=inflation),
        ends or (curve[12], curve[-12]),
    )


@cache
def make_straight(kind):
    curve = np.arange(0.0, 100.0)[:, None] * np.array([0.1, 0.0, 1.0])
    s = measure_arc_length(curve)
    radius = {
        "waist": 6.0 - 3.5 * np.exp(-(((s - 60.0) / 6.0) ** 2)),
        "goal": np.where(s < 75.0, 6.0, 3.5),
        "entry": np.where(s > 25.0, 6.0, 3.5),
    }[kind]
    return make_tube(curve, radius)


@cache
def make_hairpin():
    return make_tube(bend_curve(9.0, np.pi, 40.0), 5.0)


@cache
def make_random(seed):
    random = np.random.default_rng(seed)
    curve = random_curve(random, random.uniform(60.0, 90.0), random.uniform(14.0, 40.0))
    s = measure_arc_length(curve)
    radius = random.uniform(4.0, 6.0) + np.interp(s, np.linspace(0, s[-1], 9), random.random(9))
    at = random.uniform(0.3, 0.7) * s[-1]
    radius -= random.uniform(1.0, 2.5) * np.exp(-(((s - at) / random.uniform(4.0, 12.0)) ** 2))
    return make_tube(curve, radius, (curve[24], curve[-24]))


def check_advice(lumen, *, diameter, link, **options):
    """Re-run all that a refusal advises; return how many of each kind held."""
    plan = lumen.plan(diameter=diameter, link=link, **options)
    if plan.status == "complete":
        return None
    refusal = plan.refusal
    held = {"refusal": 1, "code": plan.reason_code}
    assert plan.reason.count(". ") <= 1, plan.reason
    # What is re-run is what is printed.
    printed = {
        "diameter": re.search(r"a scope of (\d+\.\d\d) mm diameter", plan.reason),
        "link": re.search(r"links of (\d+\.\d\d) mm(?: or|$)", plan.reason.partition(". ")[2]),
        "inflation": re.search(r"inflated by (\d+\.\d) mm", plan.reason),
    }
    keys = {"diameter": "diameter_max", "link": "link_max", "inflation": "inflate"}
    for name, found in printed.items():
        assert (found is None) == (getattr(refusal, keys[name]) is None)
        if found is None:
            continue
        changed = {"diameter": diameter, "link": link, **options, name: float(found[1])}
        again = lumen.plan(**changed)
        assert again.status == "complete", (name, found[1], plan.reason, again.reason)
        assert again.certified
        held[name] = 1
    return held


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "scope", "code", "kinds"),
    [
        (lambda: make_straight("waist"), (8.0, 9.0), "NO_PASSAGE", {"diameter", "inflation"}),
        (lambda: make_straight("goal"), (8.0, 9.0), "GOAL_CLEARANCE", {"diameter", "inflation"}),
        (lambda: make_straight("entry"), (8.0, 9.0), "ENTRY_CLEARANCE", {"diameter", "inflation"}),
        (make_hairpin, (5.0, 22.0), "LINK_TOO_LONG", {"link"}),
    ],
)
def test_what_a_refusal_advises_fits(make, scope, code, kinds):
    held = check_advice(make(), diameter=scope[0], link=scope[1])
    assert held["code"] == code
    assert kinds <= set(held)


def test_an_angle_limit_is_kept_by_the_links_that_are_advised():
    held = check_advice(make_hairpin(), diameter=4.0, link=9.0, angle_limit=0.7)
    assert held["code"] == "ANGLE"
    assert "link" in held


def test_the_largest_that_is_printed_fits():
    lumen = make_straight("waist")
    found = find_largest(lumen.field, lumen.line, scope=Scope(diameter=3.0, link_length=9.0))
    assert found.diameter > 3.0 and found.link > 9.0
    for diameter, link in ((found.diameter, 9.0), (3.0, found.link)):
        printed = float(f"{diameter:.2f}"), float(f"{link:.2f}")
        assert lumen.plan(diameter=printed[0], link=printed[1]).status == "complete"


def test_advice_after_the_answer_is_the_same_and_takes_few_certificates(monkeypatch):
    lumen, scope = make_straight("waist"), Scope(diameter=8.0, link_length=9.0)
    options = PlannerOptions(head_step=1.0, advise=False)
    answer = plan_insertion(lumen.field, lumen.line, scope=scope, options=options)
    assert "Would fit" not in answer.reason and answer.refusal.diameter_max is None
    certified = []
    monkeypatch.setattr(
        largest._Trials, "find_motion", record(certified, largest._Trials.find_motion)
    )
    again = advise_plan(answer, FreeSpace(lumen.field, lumen.line))
    whole = replace(options, advise=True)
    asked = plan_insertion(lumen.field, lumen.line, scope=scope, options=whole)
    assert again.refusal == asked.refusal and again.reason == asked.reason != answer.reason
    assert 2 <= len(certified) // 2 <= 4  # one confirms each of what is named
    # A scope that is too short has no advice: a thinner one would be as short.
    short = replace(scope, diameter=4.0, length=40.0)
    plan = plan_insertion(lumen.field, lumen.line, scope=short, options=options)
    assert advise_plan(plan, FreeSpace(lumen.field, lumen.line)) is plan


def record(calls, function):
    def call(*args):
        calls.append(args)
        return function(*args)

    return call


def test_no_inflation_is_advised_beyond_what_the_field_knows():
    lumen = make_straight("waist")
    scope = Scope(diameter=8.0, link_length=9.0)
    advised = insert(lumen.field, lumen.line, scope=scope).refusal.inflate
    for reach in (0.0, advised - 0.15):
        field = replace(lumen.field, reach=reach)
        plan = insert(field, lumen.line, scope=scope)
        assert plan.refusal.inflate is None
    field = replace(lumen.field, exact_outside=False)
    assert insert(field, lumen.line, scope=scope).refusal.inflate is None


def list_scopes(seed):
    random = np.random.default_rng(1000 + seed)
    for _ in range(3):
        yield random.uniform(5.0, 11.0), random.uniform(5.0, 25.0)


@pytest.mark.slow
def test_all_advice_on_random_tubes_fits():
    held = []
    for seed in range(8, 16):
        for diameter, link in list_scopes(seed):
            held.append(check_advice(make_random(seed), diameter=diameter, link=link))
    held = [each for each in held if each is not None]
    assert len(held) >= 14
    assert sum("diameter" in each for each in held) >= 8
    assert sum("inflation" in each for each in held) >= 11
    assert len({each["code"] for each in held}) >= 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "scopes"), [("labels", [(9.0, 8.0), (7.0, 35.0)]), ("surface", [(9.0, 20.0)])]
)
def test_all_advice_on_a_human_tract_fits(upper_gi_dir, kind, scopes):
    tract, *made = load_human(upper_gi_dir, kind)
    lumen = Lumen(lambda inflation: build_field(tract, inflate=inflation), (None, None), made)
    for diameter, link in scopes:
        held = check_advice(lumen, diameter=diameter, link=link)
        assert held is not None and "inflation" in held
