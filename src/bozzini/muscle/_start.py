"""Where the search for a model's constants starts: many trials of a cheap measure of the misfit.

The measure is one step of Newton's method from each measured state, ``(F - load) / stiffness``: to
first order how much farther the model contracts there, without an equilibrium to solve. A few
trials start about the guess, the first at it; from each, the constants that the force is linear in
are found by bounded linear least squares as well.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from ..errors import BozziniError
from ._constants import draw_point
from ._fit import Problem
from ._predict import predict_force, predict_stiffness

__all__ = ["find_starts"]

Floats = NDArray[np.float64]

_TRIALS = 16
_SEARCHES = 8  # how many of the trials are searched from
_EVALUATIONS = 40  # of each search
_ROUNDS = 4  # of linear least squares, whose weights depend on the answer
_SAME = 1e-3  # relative difference of two misfits that are taken for the same minimum
_LITTLE = 1e-12  # keeps a weight finite where the model has no stiffness [N/mm]


def find_starts(
    problem: Problem, *, linear: tuple[str, ...], seed: int = 0, count: int = 6
) -> list[Problem]:
    """Return the problem with a few starts, the most promising first.

    Parameters
    ----------
    problem : Problem
    linear : tuple of str
        Those of the unknowns that the force is linear in.
    seed : int
        Of the trials.
    count : int
        Largest number of starts.
    """
    random = np.random.default_rng(seed)
    points = [problem.choose_start()]
    points += [draw_point(problem, random) for _ in range(_TRIALS - 1)]
    begins = []
    for point in points:
        better = _solve_linear(problem, point, linear)
        begins.append(point if better is None else better)
    begins.sort(key=lambda point: float(np.sum(problem.steps(point) ** 2)))
    trials: list[tuple[float, Floats]] = []
    for start in begins[:_SEARCHES]:
        found, cost = _descend(problem, start)
        if all(abs(cost - other) > _SAME * (cost + other) for other, _ in trials):
            trials.append((cost, found))
    points = [point for _, point in sorted(trials, key=lambda trial: trial[0])]
    points.sort(key=lambda point: float(np.sum(problem.miss(point) ** 2)))
    return [_move(problem, point) for point in points[:count]]


def _move(problem: Problem, point: Floats) -> Problem:
    """Return the problem with another start, and the scales that go with it."""
    values = problem.name_values(point)
    own = {name: values[name] for name in problem.constants}
    fields = {name: value for name, value in values.items() if name not in own}
    return dataclasses.replace(problem, muscle=problem.muscle.replace(**fields), constants=own)


def _descend(problem: Problem, start: Floats) -> tuple[Floats, float]:
    """Return the nearest minimum of the measure, and the measure there."""
    from scipy.optimize import least_squares

    low, high = problem.limits.T / problem.scales
    room = 1e-9 * (high - low)
    found = least_squares(
        problem.steps,
        np.clip(start, low + room, high - room),
        bounds=(low, high),
        x_scale="jac",
        max_nfev=_EVALUATIONS,
    )
    return np.asarray(found.x), float(found.cost)


def _solve_linear(problem: Problem, point: Floats, linear: tuple[str, ...]) -> Floats | None:
    """Return the point with the best of the linear unknowns, or None if that is no better.

    The force is affine in them, so that steps of one after the other give all of it. The stiffness,
    which the rows are weighted by, is that of the round before.
    """
    from scipy.optimize import lsq_linear

    columns = [problem.free.index(name) for name in linear if name in problem.free]
    if not columns:
        return None
    limits = problem.limits[columns] / problem.scales[columns, None]
    before = float(np.sum(problem.steps(point) ** 2))
    best, least = None, before
    now = np.array(point)
    data = problem.data
    try:
        for _ in range(_ROUNDS):
            model = problem.build(problem.name_values(now))
            force = predict_force(model, data, data.contraction)
            weights = 1.0 / (np.abs(predict_stiffness(model, data, data.contraction)) + _LITTLE)
            table = []
            for column, (low, high) in zip(columns, limits, strict=True):
                there = now.copy()
                there[column] += 1.0 if now[column] + 1.0 <= high else -1.0
                there[column] = max(there[column], low)
                other = problem.build(problem.name_values(there))
                change = predict_force(other, data, data.contraction) - force
                table.append(change / (there[column] - now[column]))
            slope = np.stack(table, axis=1)
            target = data.load - force + slope @ now[columns]
            found = lsq_linear(
                slope * weights[:, None], target * weights, bounds=(limits[:, 0], limits[:, 1])
            )
            now[columns] = found.x
            cost = float(np.sum(problem.steps(now) ** 2))
            if cost < least:
                best, least = now.copy(), cost
    except (BozziniError, ValueError, np.linalg.LinAlgError):  # not affine there, or no answer
        pass
    return best
