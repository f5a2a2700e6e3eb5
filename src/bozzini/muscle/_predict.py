"""What a model says at the rows of measurements: contraction, force, stiffness."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import BozziniError
from .dataset import Measurements
from .model import StaticModel
from .models.explicit import ExplicitModel

if TYPE_CHECKING:
    from .model import MuscleModel

__all__ = [
    "answer_rows",
    "ask_contraction",
    "predict_contraction",
    "predict_force",
    "predict_stiffness",
    "try_contraction",
]


def answer_rows(
    answer: Callable[[Measurements], NDArray[np.float64]], data: Measurements
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return what a model answers at the rows, and which rows it has an answer for.

    Where it refuses a batch, the halves are asked, down to single rows.

    Parameters
    ----------
    answer : callable
        From measurements of k rows to an array of shape (k, m).
    data : Measurements

    Returns
    -------
    values : ndarray, shape (n, m)
        0 in rows without an answer.
    held : ndarray of bool, shape (n,)
    """
    try:
        values = answer(data)
        return values, np.ones(len(data), dtype=np.bool_)
    except BozziniError:
        if len(data) == 1:
            return np.zeros((1, 1)), np.zeros(1, dtype=np.bool_)
    half = len(data) // 2
    rows = np.arange(len(data))
    parts = [answer_rows(answer, data.select(part)) for part in (rows[:half], rows[half:])]
    width = max(values.shape[1] for values, _ in parts)
    table = [np.broadcast_to(values, (len(values), width)) for values, _ in parts]
    return np.concatenate(table), np.concatenate([held for _, held in parts])


def predict_contraction(model: MuscleModel, data: Measurements) -> NDArray[np.float64]:
    """Return the model's contraction at the pressure, load and direction of each row [mm].

    Raises
    ------
    InputError
        If the model has no answer for a row; the row is named.
    """
    try:
        return ask_contraction(model, data)
    except BozziniError as error:
        for row in range(len(data)):
            word = str(data.direction[row]) or None
            try:
                model.contraction(float(data.pressure[row]), float(data.load[row]), direction=word)
            except BozziniError as at_row:
                raise type(at_row)(f"{data.name_row(row)}: {at_row}") from None
        raise error


def try_contraction(
    model: MuscleModel, data: Measurements
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the contraction at each row [mm], and which rows the model has one for."""
    if isinstance(model, ExplicitModel):
        with contextlib.suppress(BozziniError):
            return model.try_contraction(data.pressure, data.load, direction=_take_direction(data))
    predicted, held = answer_rows(lambda rows: ask_contraction(model, rows)[:, None], data)
    return predicted[:, 0], held


def ask_contraction(model: MuscleModel, data: Measurements) -> NDArray[np.float64]:
    """Return the model's contraction at each row [mm]; errors do not name the row."""
    answer = model.contraction(data.pressure, data.load, direction=_take_direction(data))
    return np.array(answer, dtype=np.float64)


def predict_force(
    model: MuscleModel, data: Measurements, contraction: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the model's pull at the pressure and direction of each row, held so [N]."""
    answer = model.force(data.pressure, contraction, direction=_take_direction(data))
    return np.asarray(answer, dtype=np.float64)


def predict_stiffness(
    model: MuscleModel, data: Measurements, contraction: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the model's stiffness there, along the branch of friction [N/mm]."""
    direction = _take_direction(data)
    if direction is None:
        return np.asarray(model.stiffness(data.pressure, contraction), dtype=np.float64)
    if isinstance(model, StaticModel):
        return np.asarray(model.stiffness(data.pressure, contraction, direction=direction))
    step = 1e-5
    ahead, behind = (predict_force(model, data, contraction + s) for s in (step, -step))
    return (behind - ahead) / (2.0 * step)


def _take_direction(data: Measurements) -> NDArray[np.str_] | None:
    return data.direction if (data.direction != "").any() else None
