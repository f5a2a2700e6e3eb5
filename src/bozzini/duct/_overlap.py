"""Whether two shapes overlap, and how deep: branch and bound on a function with bounded slope."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Least", "find_least"]

CELLS_MAX = 400_000
"""The search ends when this many boxes are open."""


class Least(NamedTuple):
    """The least value found, where, and a bound below which there is none."""

    value: float
    place: NDArray[np.float64]
    bound: float


def find_least(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    *,
    tolerance: float,
    enough: float = -np.inf,
    slope: float = 1.0,
) -> Least:
    """Search a box for the least value of a function.

    Parameters
    ----------
    function : callable
        Takes points (n, dim), returns (n,) values that change by at most `slope` per mm.
    low, high : (dim,) float
        Corners of the box [mm].
    tolerance : float
        The search ends when the value is known this well.
    enough : float
        It ends also at a value this low, and when there can be none.
    slope : float
        Lipschitz constant.

    Notes
    -----
    Each box is halved along its longer sides; one whose value at the middle less `slope` times
    half its diagonal is above the best so far is dropped.
    """
    dim = len(low)
    centres = 0.5 * (low + high)[None]
    half = 0.5 * (high - low)
    values = function(centres)
    best = float(values[0])
    place = centres[0]
    while True:
        reach = slope * float(np.linalg.norm(half))
        bound = float(values.min()) - reach
        done = best <= enough or bound > enough > -np.inf or best - bound <= tolerance
        if done or len(centres) > CELLS_MAX or reach <= 1e-15 * (1.0 + abs(best)):
            return Least(best, place, min(bound, best))
        cut = half > 0.6 * half.max()
        steps = [np.array([-0.5, 0.5]) * half[a] if cut[a] else np.zeros(1) for a in range(dim)]
        shifts = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, dim)
        half = np.where(cut, 0.5 * half, half)
        centres = (centres[:, None] + shifts[None]).reshape(-1, dim)
        values = function(centres)
        index = int(np.argmin(values))
        if values[index] < best:
            best, place = float(values[index]), centres[index]
        keep = values - slope * float(np.linalg.norm(half)) <= best
        if not keep.any():
            keep[index] = True
        centres, values = centres[keep], values[keep]
