"""A smooth line in space from headings, straight pieces and circular bends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Leg", "measure_turn", "trace_line"]

Vector = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Leg:
    """A bend into a heading, then a straight piece along it.

    Attributes
    ----------
    heading : tuple of float
        Direction after the bend (right, front, up); need not be of unit length.
    bend : float
        Radius of the bend that leads into it [mm].
    straight : float
        Length of the straight piece after it [mm].
    """

    heading: tuple[float, float, float]
    bend: float
    straight: float


def measure_turn(one: tuple[float, float, float], other: tuple[float, float, float]) -> float:
    """Return the angle between two headings [rad]."""
    a, b = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def trace_line(
    legs: list[Leg], *, step: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Trace the legs from the origin, the first without its bend.

    Parameters
    ----------
    legs : list of Leg
    step : float
        Largest distance between samples along the line [mm].

    Returns
    -------
    points : ndarray, shape (n, 3)
        Samples; bends are circular arcs in the plane of the two headings.
    bend : ndarray, shape (n,)
        Radius of the bend that a sample lies on, infinite on straight pieces [mm].
    breaks : ndarray, shape (len(legs) + 1,)
        Arc length at the end of each leg's straight piece, with 0 in front [mm].
    """
    place = np.zeros(3)
    heading = _unit(legs[0].heading)
    points, bends = [place], [math.inf]
    breaks, length = [0.0], 0.0
    for number, leg in enumerate(legs):
        target = _unit(leg.heading)
        angle = measure_turn(tuple(heading), tuple(target)) if number else 0.0
        if angle > 1e-9:
            inward = _unit(target - (target @ heading) * heading)
            count = max(math.ceil(leg.bend * angle / step), 1)
            for turn in angle * np.arange(1, count + 1) / count:
                arc = math.sin(turn) * heading + (1.0 - math.cos(turn)) * inward
                points.append(place + leg.bend * arc)
                bends.append(leg.bend)
            place = points[-1]
            length += leg.bend * angle
        heading = target
        if leg.straight > 0:
            count = max(math.ceil(leg.straight / step), 1)
            for part in leg.straight * np.arange(1, count + 1) / count:
                points.append(place + part * heading)
                bends.append(math.inf)
            place = points[-1]
            length += leg.straight
        breaks.append(length)
    return np.array(points), np.array(bends), np.array(breaks)


def _unit(vector: tuple[float, float, float] | Vector) -> Vector:
    array = np.asarray(vector, dtype=np.float64)
    return np.asarray(array / np.linalg.norm(array))
