"""The passage: how much room any way from the entry to the goal can have, proved.

If a scope of radius r came through at all, its centre would have r of room everywhere. Where its
way crosses from cell to cell, through a face, the nearest corner of that face is at most half a
face's diagonal away and so has at least r minus that; corners of faces of one cell are
neighbours. So if the widest way on the grid has less, nothing passes, whatever its links.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..duct.field import SampledField

__all__ = ["Passage", "find_passage"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Passage:
    """The widest way between two points.

    Parameters
    ----------
    level : float
        Smallest room of the nodes along the widest way on the grid [mm].
    bound : float
        No way at all has more room than this everywhere [mm]; proved.
    place : (3,) float
        Where the widest way is tightest, world frame [mm].
    """

    level: float
    bound: float
    place: NDArray[np.float64]


def find_passage(duct: SampledField, start: ArrayLike, goal: ArrayLike) -> Passage:
    """Find the widest way from `start` to `goal` (world frame, mm) through a sampled field.

    Room is what the field answers: with inflation, the inflation minus the signed distance to
    the wall before it.
    """
    from ._passage_kernels import widest_level

    room = (duct.inflation - duct.values.astype(np.float64)).ravel()
    shape = duct.values.shape
    ends = []
    for point in (start, goal):
        node = np.rint(duct.to_grid(point) / duct.spacing).astype(int)
        node = np.clip(node, 0, np.array(shape) - 1)
        ends.append(int(np.ravel_multi_index(tuple(node), shape)))
    inside = np.flatnonzero(room > 0.0)
    order = inside[np.argsort(-room[inside], kind="stable")]
    level, node = widest_level(room, order, shape, ends[0], ends[1])
    half = 0.5 * float(np.linalg.norm(np.sort(duct.spacing)[1:]))
    index = np.array(np.unravel_index(max(int(node), 0), shape))
    return Passage(
        level=float(level),
        bound=max(float(level), 0.0) + half,
        place=duct.to_world(index * duct.spacing),
    )
