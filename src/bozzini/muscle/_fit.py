"""What a fit needs: predictions of a model, their derivatives, and what is known of a parameter."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import BozziniError, InputError
from .braid import BRAID_ANGLES
from .dataset import Measurements

if TYPE_CHECKING:
    from .design import Muscle
    from .model import MuscleModel

__all__ = ["PARAMETER_UNITS", "Problem", "choose_bounds", "differentiate", "predict_contraction"]

PARAMETER_UNITS = {
    "modulus": "MPa",
    "dead_length": "mm",
    "gap": "mm",
    "braid_angle": "rad",
    "friction_length": "mm",
    "mooney_ratio": "",
    "outer_radius": "mm",
    "inner_radius": "mm",
    "length": "mm",
    "end_length": "mm",
    "poisson_ratio": "",
    "strand_radius": "mm",
    "strand_modulus": "MPa",
}
"""The parameters of a `Muscle` that may be fitted, and their units."""

_SCALES = {
    "modulus": 0.1,
    "dead_length": 2.0,
    "gap": 0.02,
    "braid_angle": 0.03,
    "friction_length": 0.02,
    "mooney_ratio": 0.3,
    "poisson_ratio": 0.01,
}
_MISS = 1e5  # residual of a row that a trial has no answer for [mm]: longer than any muscle
_STEP = 1e-4  # of a difference, in scales: small against curvature, large against round-off


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A least-squares problem whose unknowns are parameters of a muscle, each in its own scale.

    Parameters
    ----------
    model_class : callable
        Makes the model from a `Muscle`.
    muscle : Muscle
        Start of the free parameters, and values of the others.
    free : tuple of str
    data : Measurements
    limits : ndarray, shape (k, 2)
        Bounds of the free parameters.
    """

    model_class: Callable[[Muscle], MuscleModel]
    muscle: Muscle
    free: tuple[str, ...]
    data: Measurements
    limits: NDArray[np.float64]

    @cached_property
    def scales(self) -> NDArray[np.float64]:
        """How much of each parameter matters, shape (k,)."""
        start = [abs(float(getattr(self.muscle, name))) for name in self.free]
        return np.array(
            [
                _SCALES.get(name, 0.1 * value or 0.1)
                for name, value in zip(self.free, start, strict=True)
            ]
        )

    def choose_start(self) -> NDArray[np.float64]:
        """Return the muscle's own values, off the bounds: a search hardly leaves one."""
        start = np.array([float(getattr(self.muscle, name)) for name in self.free])
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
        return self.model_class(self.muscle.replace(**values))

    def miss(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return model less measurement [mm]; huge in rows that the trial has no answer for."""
        answer = np.full(len(self.data), _MISS)
        try:
            model = self.build(self.name_values(point))
        except InputError:  # each value is legal, but not all together
            return answer
        with contextlib.suppress(InputError):
            return predict_contraction(model, self.data) - self.data.contraction
        for row in range(len(self.data)):
            one = self.data.select([row])
            with contextlib.suppress(InputError):
                answer[row] = (predict_contraction(model, one) - one.contraction)[0]
        return answer

    def answers_all(self, residuals: NDArray[np.float64]) -> bool:
        """Say whether these residuals are those of a model with an answer for every row."""
        return bool(np.all(np.abs(residuals) < 0.5 * _MISS))

    def slope(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivatives of `miss`, shape (n, k); 0 in rows without an answer."""
        residuals = self.miss(point)
        held = np.abs(residuals) < 0.5 * _MISS
        table = np.zeros((len(self.data), len(self.free)))
        if held.any():
            rows = self.data.select(held)
            table[held] = differentiate(
                self.build,
                self.name_values(point),
                bounds=self.limits,
                scales=self.scales,
                data=rows,
                predicted=residuals[held] + rows.contraction,
            )
        return table * self.scales


def choose_bounds(
    free: Sequence[str], muscle: Muscle, bounds: Mapping[str, tuple[float, float]]
) -> NDArray[np.float64]:
    """Return the bounds of the free parameters, shape (k, 2): those given, or wide ones.

    Raises
    ------
    InputError
        If a bound is given for a parameter that is not free, or low is not below high.
    """
    radius = muscle.outer_radius
    wide = {
        "modulus": (0.01, 20.0),
        "dead_length": (0.0, 0.8 * muscle.length),
        "gap": (0.0, 0.5 * radius),
        "braid_angle": (math.radians(15.0), BRAID_ANGLES[1]),
        "friction_length": (0.0, 0.25 * radius),
        "mooney_ratio": (0.0, 1.0),
        "inner_radius": (0.05 * radius, 0.95 * radius),
        "outer_radius": (1.05 * muscle.inner_radius, 3.0 * radius),
        "end_length": (0.0, 0.4 * muscle.length),
        "poisson_ratio": (0.3, 0.4999),
    }
    for name in bounds:
        if name not in free:
            raise InputError(f"bounds are given for {name}: the free ones are {', '.join(free)}")
    table = []
    for name in free:
        value = float(getattr(muscle, name))
        low, high = bounds.get(name, wide.get(name, (0.2 * value, 5.0 * value)))
        if name not in bounds:
            # Inside the legal range, with room for the steps of numeric differences.
            least, most = muscle.legal_range(name)
            low, high = max(low, least), min(high, most - 1e-4 * (most - least))
        check_number(f"lower bound of {name}", low, unit=PARAMETER_UNITS[name])
        check_number(f"upper bound of {name}", high, low=low, low_open=True)
        table.append((low, high))
    return np.array(table, dtype=np.float64)


def predict_contraction(model: MuscleModel, data: Measurements) -> NDArray[np.float64]:
    """Return the model's contraction at the pressure, load and direction of each row [mm].

    Raises
    ------
    InputError
        If the model has no answer for a row.
    """
    answer = model.contraction(data.pressure, data.load, direction=_take_direction(data))
    return np.array(answer, dtype=np.float64)


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

    By the theorem of implicit functions, dx/dp = -(dF/dp) / (dF/dx): both are differences of the
    force, which has a closed form in `EnergyMuscle`. For a model without force, or where a
    difference leaves its domain, they are differences of the contraction.

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
        step = _STEP * scale
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
    step = 1e-5
    here = build(values)
    ahead, behind = (_predict_force(here, data, predicted + s) for s in (step, -step))
    slope = (ahead - behind) / (2.0 * step)
    columns = []
    for name, low, high in pairs:
        force = [
            _predict_force(build({**values, name: value}), data, predicted) for value in (low, high)
        ]
        columns.append((force[1] - force[0]) / (high - low))
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        table: NDArray[np.float64] = -np.stack(columns, axis=-1) / slope[:, None]
    return table


def _differentiate_directly(
    build: Callable[[Mapping[str, float]], MuscleModel],
    values: Mapping[str, float],
    pairs: Sequence[tuple[str, float, float]],
    data: Measurements,
) -> NDArray[np.float64]:
    columns = []
    for name, low, high in pairs:
        ends = [predict_contraction(build({**values, name: value}), data) for value in (low, high)]
        columns.append((ends[1] - ends[0]) / (high - low))
    return np.stack(columns, axis=-1)


def _predict_force(
    model: MuscleModel, data: Measurements, contraction: NDArray[np.float64]
) -> NDArray[np.float64]:
    answer = model.force(data.pressure, contraction, direction=_take_direction(data))
    return np.asarray(answer, dtype=np.float64)


def _take_direction(data: Measurements) -> NDArray[np.str_] | None:
    return data.direction if (data.direction != "").any() else None
