"""Tendon robots in a human upper tract: proved clear, or the reason why not."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from bozzini.motion import Scope
from bozzini.motion.actuate.actuate import actuate_plan
from tests.exact import VoxelWall
from tests.human import load_human
from tests.motion.actuate.motions import make_robot, place_at
from tests.motion.plans import insert


@pytest.fixture(scope="module")
def human(upper_gi_dir):
    tract, field, line = load_human(upper_gi_dir, "labels")
    return field, line, VoxelWall(tract.mask, tract.affine)


def plan_for(human, robot, **options):
    field, line, _ = human
    link = 0.5 * robot.sections[0].length
    scope = Scope(diameter=2.0 * robot.radius, link_length=link)
    return insert(field, line, scope=scope, **options)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("section", "radius", "count", "bend"), [(20.0, 2.5, 17, 80.0), (30.0, 2.0, 12, 120.0)]
)
def test_the_robot_passes_certified(human, section, radius, count, bend):
    field, line, wall = human
    robot = make_robot(section, count, radius=radius, max_bend=math.radians(bend))
    moved = actuate_plan(plan_for(human, robot), robot, field)
    assert moved.fits
    assert moved.head_arc_length[-1] > 0.95 * line.length
    assert moved.certificate.clearance > 0.1
    assert moved.fit_rms.max() < 0.04 * section
    random = np.random.default_rng(7)
    places = np.array(
        [
            place_at(moved, random.uniform(0.0, moved.steps - 1.0), random.uniform(0, robot.length))
            for _ in range(2500)
        ]
    )
    outside = (places - moved.frame[:3, 3]) @ moved.frame[:3, 2] > 0.0
    exact = wall.clearance(places[outside]) - radius
    assert exact.min() >= moved.certificate.clearance


@pytest.mark.slow
def test_a_robot_that_cannot_says_why(human):
    robot = make_robot(40.0, 9, radius=3.0, max_bend=math.radians(60.0))
    moved = actuate_plan(plan_for(human, robot, head_step=1.0), robot, human[0])
    assert moved.status == "stopped"
    assert moved.reason_code in ("BEND_LIMIT", "WALL")  # it lacks both; one ends it first
    bend = re.search(r"section (\d) would have to bend ([\d.]+) deg .* head at ([\d.]+) mm",
                     moved.reason)  # fmt: skip
    assert bend is not None and float(bend[2]) > 60.0
    assert "its limit is 60.0 deg" in moved.reason
    assert "goes through the wall by" in moved.reason
    free = make_robot(40.0, 9, radius=3.0)
    assert actuate_plan(plan_for(human, free, head_step=1.0), free, human[0]).reason_code == "WALL"
