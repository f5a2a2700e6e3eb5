"""Cross-validation: how far off a model is at rows that it was not fitted to."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import BozziniError, InputError
from ._predict import predict_contraction
from .dataset import Measurements

if TYPE_CHECKING:
    from .model import MuscleModel

__all__ = ["CrossValidation", "count_states", "cross_validate", "split_rows"]

_TOLERANCE = 1e-6  # difference of pressures that counts as none [MPa]


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossValidation:
    """How far off a model is at rows that it was not fitted to.

    Parameters
    ----------
    error : float
        Root mean square over all rows, each left out once [mm]; infinite if there is a `reason`.
    errors : ndarray, shape (f,)
        The same of each fold; infinite in the folds that failed.
    reason : str
        Why a fold has no error, the first one that has none; empty if all have.
    unsettled : int
        How many of the folds have a fit that did not converge.
    """

    error: float
    errors: NDArray[np.float64]
    reason: str = ""
    unsettled: int = 0


def split_rows(data: Measurements, *, folds: int, seed: int = 0) -> tuple[NDArray[np.bool_], ...]:
    """Deal the rows into folds at random; rows that repeat a state stay in one.

    Returns
    -------
    tuple of ndarray of bool, shape (n,)
        For each fold the rows that are left out.

    Raises
    ------
    InputError
        If there are fewer states than folds.
    """
    states, of_row = _find_states(data)
    if folds > states:
        raise InputError(f"folds is {folds}: there are {states} different state(s) to deal")
    order = np.random.default_rng(seed).permutation(states)
    fold_of = np.empty(states, dtype=np.int64)
    fold_of[order] = np.arange(states) % folds
    return tuple(fold_of[of_row] == fold for fold in range(folds))


def count_states(data: Measurements) -> int:
    """Return how many different states the rows have: pressure, load and direction."""
    return _find_states(data)[0]


def _find_states(data: Measurements) -> tuple[int, NDArray[np.int64]]:
    """Return how many states there are, and which one each row has, shape (n,)."""
    keys = list(
        zip(
            np.round(data.pressure / _TOLERANCE).tolist(),
            data.load.tolist(),
            data.direction.tolist(),
            strict=True,
        )
    )
    states = {key: index for index, key in enumerate(dict.fromkeys(keys))}
    return len(states), np.array([states[key] for key in keys])


def cross_validate(
    fit: Callable[[Measurements], tuple[MuscleModel, bool]],
    data: Measurements,
    parts: tuple[NDArray[np.bool_], ...],
) -> CrossValidation:
    """Return the error at rows left out, each part in turn.

    Parameters
    ----------
    fit : callable
        From some rows to the model fitted to them, and whether that fit converged.
    data : Measurements
    parts : tuple of ndarray of bool, shape (n,)
        The rows left out in each turn.
    """
    squares, reason, unsettled = [], "", 0
    for part in parts:
        rows = data.select(part)
        try:
            model, settled = fit(data.select(~part))
            unsettled += not settled
            miss = predict_contraction(model, rows) - rows.contraction
            squares.append(float(miss @ miss))
        except BozziniError as error:
            squares.append(math.inf)
            reason = reason or str(error)
    counts = np.array([part.sum() for part in parts])
    total = np.array(squares)
    return CrossValidation(
        error=float(np.sqrt(total.sum() / counts.sum())),
        errors=np.sqrt(total / counts),
        reason=reason,
        unsettled=unsettled,
    )
