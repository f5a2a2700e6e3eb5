"""Planners: listed with those of other packages, and certified like any other."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import numpy as np
import pytest

from bozzini.errors import InputError, PluginError
from bozzini.motion import (
    PLANNERS,
    FreeSpace,
    Motion,
    Planner,
    PlannerOptions,
    Scope,
    certify_plan,
    plan_insertion,
    verify_plan,
)
from tests.shapes import bend_curve, tube_lumen

SCOPE = Scope(diameter=3.0, link_length=6.0)


class Straight(Planner):
    """Pushes the straight chain in, whatever is in the way."""

    name = "straight"
    ignored = ("slip", "angle_limit", "route")

    def move(self, space, scope, *, options, progress=None):
        """Return the motion of a rod along the first direction of the line."""
        tube, line = space.tube, space.centreline
        depth = np.arange(0.0, min(line.length, 60.0), options.head_step)
        chain = tube.place_chain(scope.count_links(line.length) + 1, scope.link_length)
        joints = chain - depth[:, None, None] * tube.outward
        path = joints[[0, -1], 0]
        return Motion(
            joints=joints,
            head_arc_length=depth,
            path=path,
            reason_code="ROD",
            reason="a rod goes straight on",
        )


class NoPlanner:
    """Not a planner."""


@pytest.fixture
def plugins(monkeypatch):
    places = {"straight": "Straight", "none": "NoPlanner", "gone": "Gone"}
    points = {
        name: EntryPoint(name, f"tests.motion.test_planners:{place}", "bozzini.planners")
        for name, place in places.items()
    }
    monkeypatch.setitem(PLANNERS.__dict__, "plugins", points)


@pytest.fixture(scope="module")
def tubes():
    straight = np.arange(0.0, 90.0, 0.5)[:, None] * np.array([1.0, 0.0, 0.0])
    bend = bend_curve(14.0, 2.2, 30.0)
    return {"straight": tube_lumen(straight, 6.0), "bend": tube_lumen(bend, 5.0)}


def test_planners_of_other_packages_stand_beside_the_own(plugins):
    assert list(PLANNERS) == ["best", "tube", "follow", "thesis", "straight", "none", "gone"]
    for name in ("best", "tube", "follow", "thesis", "straight"):
        assert issubclass(PLANNERS[name], Planner) and PLANNERS[name].name == name


def test_a_plan_of_another_package_is_certified_like_ours(plugins, tubes):
    for kind, clear in (("straight", True), ("bend", False)):
        field, line = tubes[kind]
        options = PlannerOptions(head_step=1.0)
        plan = plan_insertion(field, line, scope=SCOPE, method="straight", options=options)
        assert (plan.method, plan.status, plan.reason_code) == ("straight", "stopped", "ROD")
        assert plan.certified == clear
        assert certify_plan(plan, field).clearance == plan.certificate.clearance
        # The samples of the body never lie below the bound by more than their error.
        assert plan.clearance_min >= plan.certificate.clearance - plan.field.clearance_error
        assert verify_plan(plan, field).consistent


def test_what_is_no_planner_is_refused_in_one_line(plugins, tubes):
    for method, words in (
        ("none", "it must be a Planner"),
        ("gone", "cannot be imported"),
        ("other", "one of best, tube, follow, thesis, straight"),
    ):
        with pytest.raises((InputError, PluginError), match=words):
            plan_insertion(*tubes["straight"], scope=SCOPE, method=method)


def test_options_that_a_planner_ignores_must_be_as_by_default(plugins, tubes):
    space = FreeSpace(*tubes["straight"])
    with pytest.raises(InputError, match="'straight' has no slip, angle limit or route: .* best"):
        Straight().plan(space, SCOPE, options=PlannerOptions(slip=0.5))

    class Slipping(Straight):
        ignored = ("route",)

    with pytest.raises(InputError, match="'straight' has no route: leave it out, or use one of "):
        Slipping().plan(space, SCOPE, options=PlannerOptions(slip=0.5, route=(1.0, 0.0)))


def test_a_name_is_known_without_importing_what_it_names(plugins):
    assert "gone" in PLANNERS and "best" in PLANNERS and "nobody" not in PLANNERS
