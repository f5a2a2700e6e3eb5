"""A bent tube, with a plan that keeps clear of its wall and one that does not."""

from __future__ import annotations

import dataclasses
import math

import pytest

from bozzini.motion import PlannerOptions, Scope, plan_insertion
from bozzini.physics.study import Scenery
from tests.shapes import bend_curve, tube_lumen

RADIUS = 6.0


@pytest.fixture(scope="session")
def clear() -> Scenery:
    """A certified plan."""
    field, line = tube_lumen(bend_curve(25.0, 0.5 * math.pi, 30.0), RADIUS)
    plan = plan_insertion(
        field,
        line,
        scope=Scope(diameter=6.0, link_length=8.0),
        options=PlannerOptions(head_step=1.0),
    )
    assert plan.certified
    return Scenery(plan=plan, duct=field)


@pytest.fixture(scope="session")
def touching(clear: Scenery) -> Scenery:
    """The same motion by a body that is too thick for it."""
    thick = dataclasses.replace(clear.plan, scope=Scope(diameter=11.0, link_length=8.0))
    return dataclasses.replace(clear, plan=thick)
