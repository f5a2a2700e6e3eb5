"""What commands alone predict of points: baselines that a fitted robot stands beside."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import combinations_with_replacement

import numpy as np

from ..numeric.arrays import Floats

NEAREST = 5
"""Rows whose mean the nearest-rows baseline is."""
RIDGES = (1e-2, 1.0, 1e2, 1e4)
"""Weights of the squares of a polynomial's coefficients, its terms scaled to a deviation of 1."""
PARTS = 4
"""Runs of rows, each predicted by the others, that choose among these."""
MOST_TERMS = 1000
"""A polynomial of more terms is left out."""


def list_monomials(values: Floats, degree: int) -> Floats:
    """Return all products (n, p) of 0 to `degree` of the columns (n, k), the constant first."""
    columns = [np.ones(len(values))]
    for order in range(1, degree + 1):
        for chosen in combinations_with_replacement(range(values.shape[1]), order):
            columns.append(np.prod(values[:, list(chosen)], axis=1))
    return np.stack(columns, axis=1)


def _average_nearest(commands: Floats, places: Floats, asked: Floats) -> Floats:
    """Return the means (k, 3) of the places of the rows whose commands are nearest."""
    from scipy.spatial import cKDTree

    count = min(NEAREST, len(commands))
    _, rows = cKDTree(commands).query(asked, k=count)
    return np.asarray(places[np.reshape(rows, (len(asked), count))].mean(axis=1))


def _fit_polynomial(degree: int, commands: Floats, places: Floats, asked: Floats) -> Floats:
    """Return the places (k, 3) of a polynomial with ridge; commands are cut to those fitted."""
    low, high = commands.min(axis=0), commands.max(axis=0)
    terms = list_monomials(np.concatenate([commands, np.clip(asked, low, high)]), degree)[:, 1:]
    fitted = terms[: len(commands)]
    scale = fitted.std(axis=0)
    kept = scale > 1e-9 * (1.0 + np.abs(fitted).max(axis=0))
    terms = (terms[:, kept] - fitted[:, kept].mean(axis=0)) / scale[kept]
    matrix, mean = terms[: len(commands)], places.mean(axis=0)
    target = places - mean
    square, product = matrix.T @ matrix, matrix.T @ target
    unit = np.eye(len(square))
    errors = dict.fromkeys(RIDGES, 0.0)
    for rows in np.array_split(np.arange(len(commands)), PARTS):
        own, there = matrix[rows], target[rows]
        for ridge in RIDGES:
            found = np.linalg.solve(square - own.T @ own + ridge * unit, product - own.T @ there)
            errors[ridge] += float(np.square(own @ found - there).sum())
    ridge = min(RIDGES, key=errors.__getitem__)
    return np.asarray(
        mean + terms[len(commands) :] @ np.linalg.solve(square + ridge * unit, product)
    )


_KINDS: dict[str, Callable[[Floats, Floats, Floats], Floats]] = {
    f"mean of the nearest {NEAREST} rows": _average_nearest,
    "quadratic of the commands": partial(_fit_polynomial, 2),
    "cubic of the commands": partial(_fit_polynomial, 3),
}


def predict_by_commands(commands: Floats, points: Floats, asked: Floats) -> dict[str, Floats]:
    """Return the points (k, m, 3) [mm] that each baseline predicts for the commands asked.

    Parameters
    ----------
    commands : ndarray, shape (n, t)
        Of the rows that are known.
    points : ndarray, shape (n, m, 3)
        Seen in these [mm]; NaN where a point was not.
    asked : ndarray, shape (k, t)
        Commands of other rows.
    """
    moving = commands.std(axis=0) > 0.0
    scale = np.where(moving, commands.std(axis=0), 1.0)
    known, wanted = ((values / scale)[:, moving] for values in (commands, asked))
    found = {}
    for name, predict in _KINDS.items():
        degree = predict.args[0] if isinstance(predict, partial) else 0
        terms = np.prod([(moving.sum() + k) / k for k in range(1, degree + 1)])
        if terms > MOST_TERMS or not moving.any():
            continue
        there = np.full((len(asked), *points.shape[1:]), np.nan)
        for marker in range(points.shape[1]):
            seen = np.isfinite(points[:, marker]).all(axis=-1)
            if seen.any():
                there[:, marker] = predict(known[seen], points[seen, marker], wanted)
        found[name] = there
    return found
