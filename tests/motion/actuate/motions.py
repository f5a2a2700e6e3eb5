"""Robots in a bent tube, and their bodies by a route that shares nothing with the kernels."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from bozzini.continuum import ContinuumRobot, Section, Tendon
from bozzini.motion import Scope
from tests.motion.plans import insert
from tests.shapes import bend_curve, curve_distance, tube_lumen

TUBE_RADIUS = 7.0
CURVE = bend_curve(30.0, 1.2, 25.0)
EXACT = curve_distance(CURVE, TUBE_RADIUS)


def make_robot(length, count, *, radius=2.0, max_bend=math.inf, travel=math.inf, turn=0.0):
    """Return `count` sections of `length` with three tendons each, turned by `turn`."""
    return ContinuumRobot(
        [
            Section(
                length=length,
                radius=radius,
                max_bend=max_bend,
                tendons=[
                    Tendon(
                        name=f"s{index}{'abc'[k]}",
                        offset=0.8 * radius,
                        angle=turn + 2.0 * math.pi * (k + index / count) / 3.0,
                        travel=(-travel, travel),
                    )
                    for k in range(3)
                ],
            )
            for index in range(count)
        ],
        name="arm",
    )


def make_tube():
    return tube_lumen(CURVE, TUBE_RADIUS, voxel=1.0)


def make_plan(*, diameter=4.0, link=5.0, head_step=1.0, **options):
    duct, line = make_tube()
    scope = Scope(diameter=diameter, link_length=link)
    return insert(duct, line, scope=scope, head_step=head_step, **options)


NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


def place_point(lengths, bends, arc):
    """Return a point of a chain of arcs (m, 2), by quadrature of the turned tangent."""
    turn, place = Rotation.identity(), np.zeros(3)
    for length, (x, y) in zip(lengths, bends, strict=True):
        part = min(arc, length)
        axis = np.array([-y, x, 0.0]) / length
        along = 0.5 * part * (NODES + 1.0)
        tangents = Rotation.from_rotvec(along[:, None] * axis).apply([0.0, 0.0, 1.0])
        place = place + turn.apply(0.5 * part * (WEIGHTS @ tangents))
        turn = turn * Rotation.from_rotvec(part * axis)
        arc -= part
        if arc <= 0.0:
            break
    return place


def place_at(motion, time, arc):
    """Return where the point at `arc` of a robot is at `time`: world frame, arcs and quadrature."""
    step = min(int(time), motion.steps - 2)
    share = time - step
    bends = (1.0 - share) * motion.bends[step] + share * motion.bends[step + 1]
    advance = (1.0 - share) * motion.base_advance[step] + share * motion.base_advance[step + 1]
    local = place_point([section.length for section in motion.robot.sections], bends, arc)
    local = local + [0.0, 0.0, advance - motion.robot.length]
    return motion.frame[:3, :3] @ local + motion.frame[:3, 3]
