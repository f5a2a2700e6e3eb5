"""Rays from inside a duct to its wall, many at a time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .protocol import Duct

__all__ = ["cast_rays", "spread_directions"]

STEP = 0.1
"""Smallest step of a ray [mm]: a wall thinner than this may be passed over."""

PLACE = 1e-11
"""How exactly the wall is found [mm]."""


def cast_rays(
    duct: Duct, starts: NDArray[np.float64], directions: NDArray[np.float64], *, reach: float
) -> NDArray[np.float64]:
    """Return (n,) how far rays go from `starts` until they first leave the duct [mm].

    A ray goes on by as much as it has room, so it passes over no wall that is thicker than
    `STEP`; then the wall is found by bisection.

    Parameters
    ----------
    duct : Duct
    starts : (n, dim) float
        A ray that starts outside the duct has length 0.
    directions : (n, dim) float
        Unit vectors.
    reach : float
        A ray ends here at the latest [mm].
    """
    # The interpolant of a sampled distance is steeper than the distance, by up to sqrt(3).
    slope = math.sqrt(3.0) if duct.kind == "sampled" else 1.0
    last = np.zeros(len(starts))  # still inside
    ahead = np.zeros(len(starts))  # to be asked; in the end outside
    going = np.arange(len(starts))
    while len(going):
        points = starts[going] + ahead[going, None] * directions[going]
        room = -duct.signed_distance(points)
        inside = room > 0.0
        going, room = going[inside], room[inside]
        last[going] = ahead[going]
        ahead[going] += np.maximum(room / slope, STEP)
        gone = ahead[going] >= reach
        last[going[gone]] = ahead[going[gone]] = reach
        going = going[~gone]
    going = np.flatnonzero(ahead > last)
    while len(going):
        middle = 0.5 * (last[going] + ahead[going])
        inside = duct.signed_distance(starts[going] + middle[:, None] * directions[going]) < 0.0
        last[going[inside]] = middle[inside]
        ahead[going[~inside]] = middle[~inside]
        going = going[(ahead[going] - last[going] > PLACE) & (middle > last[going] - PLACE)]
    return last


def spread_directions(count: int) -> NDArray[np.float64]:
    """Return (count, 3) unit vectors spread evenly over all directions (a Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    height = 1.0 - 2.0 * k / count
    turn = math.pi * (1.0 + math.sqrt(5.0)) * k
    off = np.sqrt(1.0 - height**2)
    return np.stack([off * np.cos(turn), off * np.sin(turn), height], axis=1)
