"""The same passive rod pushed round the same bend: MuJoCo's chain and the least energy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bozzini.continuum import ContactModel, ContinuumRobot, Section, insert_robot
from bozzini.continuum.walls import ContactOptions
from bozzini.motion.scope import Introducer
from bozzini.physics.execute import execute
from bozzini.physics.options import ScopeOptions, WallOptions
from bozzini.physics.robots import PushDrive
from bozzini.physics.walls import LumenWall
from tests.shapes import bend_curve, tube_lumen

RADIUS, RIGIDITY, LENGTH = 2.0, 500.0, 90.0


@pytest.mark.slow
def test_push_and_wall_forces_agree_within_a_tenth() -> None:
    curve = bend_curve(40.0, 0.5 * math.pi, 30.0)
    field, _ = tube_lumen(curve, 6.0, voxel=0.5)
    rod = ContinuumRobot(
        (Section(length=LENGTH, tendons=(), radius=RADIUS, bending_stiffness=RIGIDITY),)
    )
    # 2 N/mm for each mm of the rod, and 5 N/mm at places 2 to 2.5 mm apart.
    model = ContactModel(rod, field, options=ContactOptions(wall_stiffness=2.0))
    wanted = insert_robot(model, curve, step=3.0)
    tube = Introducer(entry=curve[0], outward=np.array([0.0, 0.0, -1.0]), bore=6.0)
    drive = PushDrive(
        line=curve, introducer=tube, diameter=2.0 * RADIUS, length=LENGTH, link=4.0, speed=10.0,
        options=ScopeOptions(rigidity=RIGIDITY), steered=False,
    )  # fmt: skip
    options = WallOptions(stiffness=5.0, friction=0.0)
    wall = LumenWall(duct=field, introducer=tube, guide=RADIUS + 0.05, options=options)
    found = execute(drive, wall, line=curve)
    assert wanted.converged and not found.outside
    # From where it lies on the bend: before, its tip alone touches, as a ball here.
    late = wanted.inserted > 74.0
    assert np.count_nonzero(late) >= 5
    push = np.convolve(found.push_force, np.ones(7) / 7.0, "same")
    for ours, theirs in (
        (push, wanted.push_force),
        (found.normal_sum, wanted.contact_force),
    ):
        there = np.interp(wanted.inserted[late][:-1], found.inserted, ours)
        assert there == pytest.approx(theirs[late][:-1], rel=0.1)
