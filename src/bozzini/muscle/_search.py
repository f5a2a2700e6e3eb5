"""The search for the smallest sum of squares, past the kinks at which it can be caught.

Contraction over pressure has a kink where the tube meets the braid. As a trial moves the pressure
of contact past a measured pressure, the sum of squares has a kink as well, and can have a minimum
on both sides. So a fit of the gap is begun anew from gaps for which contact lies between other
neighbours of the measured pressures, until none of them is better.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BozziniError
from ._fit import Problem

__all__ = ["EVALUATIONS", "find_minimum"]

EVALUATIONS = 200
"""Largest number of evaluations of one search."""

_BETTER = 1e-9  # relative decrease of the sum of squares that counts as one


def find_minimum(problem: Problem, start: NDArray[np.float64], *, limit: int = EVALUATIONS) -> Any:
    """Return SciPy's result of the best search; `nfev` counts all of them.

    Parameters
    ----------
    problem : Problem
    start : ndarray, shape (k,)
    limit : int
        Largest number of evaluations of one search.
    """
    best = _search(problem, start, limit)
    evaluations = best.nfev
    if "gap" in problem.free:
        levels = np.unique(np.append(problem.data.pressure, 0.0))
        tried = {_place(problem, best.x, levels)}
        while True:
            here = _place(problem, best.x, levels)
            fresh = [i for i in (here - 1, here + 1) if 1 <= i < len(levels) and i not in tried]
            if not fresh:
                break
            for place in fresh:
                tried.add(place)
                middle = 0.5 * (levels[place - 1] + levels[place])
                found = _search(problem, _move_contact(problem, best.x, float(middle)), limit)
                evaluations += found.nfev
                if found.cost < (1.0 - _BETTER) * best.cost:
                    best = found
    best.nfev = evaluations
    return best


def _search(problem: Problem, start: NDArray[np.float64], limit: int) -> Any:
    from scipy.optimize import least_squares

    low, high = problem.limits.T / problem.scales
    found = least_squares(
        problem.miss,
        start,
        jac=problem.slope,
        bounds=(low, high),
        xtol=1e-10,
        ftol=1e-12,
        gtol=1e-12,
        x_scale="jac" if problem.constants else 1.0,
        max_nfev=limit,
    )
    found.x = np.choose(found.active_mask + 1, (low, found.x, high))
    return found


def _contact(problem: Problem, point: NDArray[np.float64]) -> float:
    try:
        return float(problem.build(problem.name_values(point)).dead_band())
    except BozziniError:
        return 0.0


def _place(problem: Problem, point: NDArray[np.float64], levels: NDArray[np.float64]) -> int:
    """Return between which pressures contact lies: above ``levels[place - 1]``."""
    return max(1, int(np.searchsorted(levels, _contact(problem, point))))


def _move_contact(
    problem: Problem, point: NDArray[np.float64], pressure: float
) -> NDArray[np.float64]:
    """Return the point with another gap, for contact near a pressure; it grows with the gap."""
    index = problem.free.index("gap")
    low, high = problem.limits[index] / problem.scales[index]
    room = 1e-3 * (high - low)
    low, high = low + room, high - room
    moved = np.array(point)
    # Inside the bounds in all parameters: a search hardly leaves one.
    ends = problem.limits.T / problem.scales
    moved = np.clip(
        moved, ends[0] + 1e-3 * (ends[1] - ends[0]), ends[1] - 1e-3 * (ends[1] - ends[0])
    )
    for _ in range(20):
        moved[index] = 0.5 * (low + high)
        if _contact(problem, moved) < pressure:
            low = moved[index]
        else:
            high = moved[index]
    return moved
