"""The search for the smallest sum of squares, past the kinks at which it can be caught.

Contraction over pressure has a kink where the tube meets the braid. As a trial moves the pressure
of contact past a measured pressure, the sum of squares has a kink as well, and can have a minimum
on both sides. So a fit of the gap is begun anew from gaps for which contact lies between other
neighbours of the measured pressures, until none of them is better.

Constants of a model can have several minima, and rows without an answer on the way. So they are
searched for from several starts, each a little, and the best of those searches go on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BozziniError, InputError
from ._fit import Problem

__all__ = ["EVALUATIONS", "find_constants", "find_minimum"]

EVALUATIONS = 200
"""Largest number of evaluations of one search."""

_FIRST = 15  # evaluations from each start for constants
_KEPT = 2  # how many of those searches, the best, go on
_SECOND = 65  # evaluations that each of these has then; the best of them has the rest
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


def find_constants(starts: Sequence[Problem]) -> tuple[Any, Problem]:
    """Return the best of searches from several starts, and the problem it began with.

    A search that ends with an answer at all rows is better than any that does not.

    Parameters
    ----------
    starts : sequence of Problem
        One problem, with several starts.

    Raises
    ------
    InputError
        If none of the searches ends with an answer at all rows.
    """
    tries = [(find_minimum(one, one.choose_start(), limit=_FIRST), one) for one in starts]
    tries.sort(key=_judge)
    ends = [_go_on(*search, limit=_SECOND) for search in tries[:_KEPT]]
    found, begun = _go_on(*min(ends, key=_judge), limit=EVALUATIONS - _FIRST - _SECOND)
    found.nfev += sum(search.nfev for search, one in (*ends, *tries[_KEPT:]) if one is not begun)
    _demand_answers(begun, found.x)
    return found, begun


def _go_on(found: Any, problem: Problem, *, limit: int) -> tuple[Any, Problem]:
    """Return a search that has not ended taken further."""
    if found.status != 0:
        return found, problem
    more = find_minimum(problem, found.x, limit=limit)
    more.nfev += found.nfev
    return more, problem


def _judge(search: tuple[Any, Problem]) -> tuple[bool, float]:
    """Return the key to sort searches by."""
    found, problem = search
    return not problem.evaluate(found.x)[1].all(), float(found.cost)


def _demand_answers(problem: Problem, point: NDArray[np.float64]) -> None:
    """Raise `InputError` if the model has no answer at a row with the best constants found."""
    _, held = problem.evaluate(point)
    if held.all():
        return
    data, row = problem.data, int(np.argmin(held))
    values = problem.name_values(point)
    words = ", ".join(f"{name} = {value:.4g}" for name, value in values.items())
    raise InputError(
        f"no constants were found with which the model has an answer at all rows: with {words} it "
        f"has none at {len(data) - held.sum()} of {len(data)}, the first is {data.name_row(row)} "
        f"({data.pressure[row]:g} MPa, {data.load[row]:g} N)"
    )


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
