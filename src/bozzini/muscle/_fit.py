"""What a fit needs: predictions of a model, and their derivatives by its unknowns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import BozziniError
from ._predict import (
    answer_rows,
    ask_contraction,
    predict_contraction,
    predict_force,
    predict_stiffness,
    try_contraction,
)
from ._unknowns import choose_scale
from .dataset import Measurements

if TYPE_CHECKING:
    from .design import Muscle
    from .model import MuscleModel

__all__ = ["Problem", "differentiate", "predict_contraction"]

_MISS = 1e5  # what the search sees at a row that a trial has no answer for [mm]
_STEEPEST = 1e9  # of a derivative, so that its square is finite [mm]
_LITTLE = 1e-12  # keeps a quotient finite where a model has no stiffness [N/mm]
_STEP = 1e-4  # of a difference, in scales: small against curvature, large against round-off


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A least-squares problem whose unknowns are those of a muscle and a model, each in its scale.

    Parameters
    ----------
    model_class : callable
        Makes the model from a `Muscle`, and from constants by their names.
    muscle : Muscle
        Start of the free fields, and values of the others.
    free : tuple of str
        Fields of the muscle and constants of the model.
    data : Measurements
    limits : ndarray, shape (k, 2)
        Bounds of the free parameters.
    constants : mapping of str to float
        Start of those of the free parameters that are constants of the model.
    """

    model_class: Callable[..., MuscleModel]
    muscle: Muscle
    free: tuple[str, ...]
    data: Measurements
    limits: NDArray[np.float64]
    constants: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def start(self) -> dict[str, float]:
        """Where the free parameters start."""
        return {
            name: float(
                self.constants[name] if name in self.constants else getattr(self.muscle, name)
            )
            for name in self.free
        }

    @cached_property
    def scales(self) -> NDArray[np.float64]:
        """How much of each parameter matters, shape (k,)."""
        return np.array(
            [
                choose_scale(name, value, own=name in self.constants)
                for name, value in self.start.items()
            ]
        )

    def choose_start(self) -> NDArray[np.float64]:
        """Return where to start, off the bounds: a search hardly leaves one."""
        start = np.array(list(self.start.values()))
        low, high = self.limits.T
        room = np.minimum(0.5 * self.scales, 0.25 * (high - low))
        inside: NDArray[np.float64] = np.clip(start, low + room, high - room)
        return inside / self.scales

    def name_values(self, point: NDArray[np.float64]) -> dict[str, float]:
        """Return the parameters at a point of the search."""
        values = np.clip(point * self.scales, self.limits[:, 0], self.limits[:, 1])
        return dict(zip(self.free, values.tolist(), strict=True))

    def build(self, values: Mapping[str, float]) -> MuscleModel:
        """Return the model with some parameters."""
        own = {name: value for name, value in values.items() if name in self.constants}
        fields = {name: value for name, value in values.items() if name not in own}
        return self.model_class(self.muscle.replace(**fields), **own)

    def evaluate(self, point: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return model less measurement [mm], and which rows the trial has an answer for."""
        try:
            model = self.build(self.name_values(point))
        except BozziniError:  # each value is legal, but not all together
            return np.zeros(len(self.data)), np.zeros(len(self.data), dtype=np.bool_)
        predicted, held = try_contraction(model, self.data)
        return np.where(held, predicted - self.data.contraction, 0.0), held

    def miss(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the search makes small: `evaluate`, huge in rows without an answer.

        With constants of the model, which may start far off, it is `steps` there, moved away from
        0, so that the search finds back.
        """
        miss, held = self.evaluate(point)
        if held.all() or not self.constants:
            return np.where(held, miss, _MISS)
        steps = self.steps(point)
        return np.where(held, miss, steps + np.copysign(self.muscle.length, steps))

    def slope(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivatives of `miss`, shape (n, k).

        In rows without an answer 0, or with constants of the model those of `steps`.
        """
        residuals, held = self.evaluate(point)
        table = np.zeros((len(self.data), len(self.free)))
        if held.any():
            rows = self.data.select(held)
            table[held] = self.scales * differentiate(
                self.build,
                self.name_values(point),
                bounds=self.limits,
                scales=self.scales,
                data=rows,
                predicted=residuals[held] + rows.contraction,
            )
        if self.constants and not held.all():
            here = self.steps(point)
            for column, step in enumerate(self._choose_steps(point)):
                there = point.copy()
                there[column] += step
                table[~held, column] = ((self.steps(there) - here) / step)[~held]
        return np.clip(np.nan_to_num(table), -_STEEPEST, _STEEPEST)

    def steps(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a step of Newton's method from each measured state, shape (n,) [mm].

        It is ``(force - load) / stiffness``, to first order the model's contraction less the
        measured one, bent to stay below half the muscle's length; that length in rows without an
        answer.
        """
        most = 0.5 * self.muscle.length
        try:
            model = self.build(self.name_values(point))
        except BozziniError:
            return np.full(len(self.data), most)

        def answer(rows: Measurements) -> NDArray[np.float64]:
            force = predict_force(model, rows, rows.contraction)
            stiffness = predict_stiffness(model, rows, rows.contraction)
            return np.stack([force - rows.load, stiffness], axis=1)

        table, held = answer_rows(answer, self.data)
        with np.errstate(all="ignore"):
            steps = table[:, 0] / (np.abs(table[:, -1]) + _LITTLE)
            bent = steps / np.hypot(1.0, steps / most)
        return np.where(held & np.isfinite(bent), bent, most)

    def _choose_steps(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return small steps that stay inside the bounds, in scales."""
        return np.where(point + _STEP * 10.0 <= self.limits[:, 1] / self.scales, 1.0, -1.0) * (
            _STEP * 10.0
        )


def differentiate(
    build: Callable[[Mapping[str, float]], MuscleModel],
    values: Mapping[str, float],
    *,
    bounds: NDArray[np.float64],
    scales: NDArray[np.float64],
    data: Measurements,
    predicted: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the derivatives of contraction by the parameters, shape (n, k).

    By the theorem of implicit functions, dx/dp = (dF/dp) / stiffness: the one is a difference of
    the force, which has a closed form in `EnergyMuscle`, the other the model's own. For a model
    without force, or where a difference leaves its domain, they are differences of the contraction.

    Parameters
    ----------
    build : callable
        Makes the model from values of the parameters.
    values : mapping
        The parameters.
    bounds : ndarray, shape (k, 2)
    scales : ndarray, shape (k,)
    data : Measurements
    predicted : ndarray, shape (n,)
        Contraction of the model at `values` [mm].
    """
    pairs = []
    for (name, value), (low, high), scale in zip(values.items(), bounds, scales, strict=True):
        step = _STEP * max(scale, abs(value))  # the start may have been next to 0
        pairs.append((name, max(low, value - step), min(high, value + step)))
    try:
        return _differentiate_implicitly(build, values, pairs, data, predicted)
    except (BozziniError, ZeroDivisionError, FloatingPointError):
        return _differentiate_directly(build, values, pairs, data)


def _differentiate_implicitly(
    build: Callable[[Mapping[str, float]], MuscleModel],
    values: Mapping[str, float],
    pairs: Sequence[tuple[str, float, float]],
    data: Measurements,
    predicted: NDArray[np.float64],
) -> NDArray[np.float64]:
    stiffness = predict_stiffness(build(values), data, predicted)
    columns = []
    for name, low, high in pairs:
        force = [
            predict_force(build({**values, name: value}), data, predicted) for value in (low, high)
        ]
        columns.append((force[1] - force[0]) / (high - low))
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        table: NDArray[np.float64] = np.stack(columns, axis=-1) / stiffness[:, None]
    return table


def _differentiate_directly(
    build: Callable[[Mapping[str, float]], MuscleModel],
    values: Mapping[str, float],
    pairs: Sequence[tuple[str, float, float]],
    data: Measurements,
) -> NDArray[np.float64]:
    columns = []
    for name, low, high in pairs:
        ends = [ask_contraction(build({**values, name: value}), data) for value in (low, high)]
        columns.append((ends[1] - ends[0]) / (high - low))
    return np.stack(columns, axis=-1)
