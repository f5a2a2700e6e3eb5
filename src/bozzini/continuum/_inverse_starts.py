"""Bends from which the inverse starts, in closed form or evenly spread."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from .arc import arc_frames
from .robot import ContinuumRobot
from .tendon import GRAIN

__all__ = ["CANDIDATES", "bend_towards", "guess_bends", "spread_bends"]

Floats = NDArray[np.float64]

CANDIDATES = 256
"""Sets of bends among which starts are chosen."""


def bend_towards(place: Floats) -> Floats:
    """Return the bend of the arc from the base, along z, through a place [rad], shape (2,)."""
    across = math.hypot(place[0], place[1])
    if across == 0.0:
        return np.zeros(2)
    return np.asarray(2.0 * math.atan2(across, place[2]) * (place[:2] / across))


def guess_bends(robot: ContinuumRobot, places: Floats, along: Floats) -> Floats:
    """Return bends of arcs through the curve's points at the sections' ends, one after another."""
    order = np.argsort(along, kind="stable")
    arc = np.concatenate([[0.0], along[order]])
    line = np.concatenate([np.zeros((1, 3)), places[order]])
    bends = np.zeros((len(robot.sections), 2))
    for index, end in enumerate(robot.section_ends):
        if end > arc[-1] + GRAIN and robot.section_starts[index] >= arc[-1] - GRAIN:
            break
        reached = min(end, arc[-1])
        joint = np.array([np.interp(reached, arc, line[:, k]) for k in range(3)])
        frame = arc_frames(robot, bends, arc_length=[robot.section_starts[index]])[0]
        share = (reached - robot.section_starts[index]) / robot.sections[index].length
        bends[index] = bend_towards(frame[:3, :3].T @ (joint - frame[:3, 3])) / share
    return bends


@functools.lru_cache(maxsize=32)
def spread_bends(sections: int) -> Floats:
    """Return `CANDIDATES` sets of bends, the same ones each time, evenly in discs of radius 1."""
    draws = np.random.default_rng(20).random((CANDIDATES, sections, 2))
    angle = 2.0 * math.pi * draws[..., 0]
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(np.sqrt(draws[..., 1:]) * unit)
