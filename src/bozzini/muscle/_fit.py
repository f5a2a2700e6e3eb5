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
from .model import StaticModel

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
    "end_length": "mm",
    "poisson_ratio": "",
    "strand_radius": "mm",
    "strand_modulus": "MPa",
}
"""The parameters of a `Muscle` that may be fitted, and their units.

The free length is not one of them: a table of lengths becomes contractions by it, so it has to be
measured.
"""

_SCALES = {
    "modulus": 0.1,
    "dead_length": 2.0,
    "gap": 0.02,
    "braid_angle": 0.03,
    "friction_length": 0.02,
    "mooney_ratio": 0.3,
    "poisson_ratio": 0.01,
}
_MISS = 1e5  # what the search sees at a row that a trial has no answer for [mm]
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

    def evaluate(self, point: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return model less measurement [mm], and which rows the trial has an answer for."""
        miss = np.zeros(len(self.data))
        held = np.zeros(len(self.data), dtype=np.bool_)
        try:
            model = self.build(self.name_values(point))
        except BozziniError:  # each value is legal, but not all together
            return miss, held
        with contextlib.suppress(BozziniError):
            return _predict(model, self.data) - self.data.contraction, ~held
        for row in range(len(self.data)):
            one = self.data.select([row])
            with contextlib.suppress(BozziniError):
                miss[row] = (_predict(model, one) - one.contraction)[0]
                held[row] = True
        return miss, held

    def miss(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the search makes small: `evaluate`, huge in rows without an answer."""
        miss, held = self.evaluate(point)
        return np.where(held, miss, _MISS)

    def slope(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivatives of `miss`, shape (n, k); 0 in rows without an answer."""
        residuals, held = self.evaluate(point)
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
        If bounds are given for a parameter that is not free, are no pair, lie outside what the
        muscle may have, or low is not below high.
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
    if not isinstance(bounds, Mapping):
        raise InputError(
            f"bounds must be a mapping from names to pairs: it is a {type(bounds).__name__}"
        )
    for name in bounds:
        if name not in free:
            raise InputError(f"bounds are given for {name}: the free ones are {', '.join(free)}")
    table = []
    for name in free:
        value = float(getattr(muscle, name))
        least, most = muscle.legal_range(name)
        if name in bounds:
            low, high = _take_pair(name, bounds[name], least, most)
        else:
            # Inside the legal range, with room for the steps of numeric differences.
            low, high = wide.get(name, (0.2 * value, 5.0 * value))
            low, high = max(low, least), min(high, most - 1e-4 * (most - least))
        table.append((low, high))
    return np.array(table, dtype=np.float64)


def _take_pair(name: str, pair: object, least: float, most: float) -> tuple[float, float]:
    if not isinstance(pair, Sequence) or isinstance(pair, str) or len(pair) != 2:
        raise InputError(f"bounds of {name} is {pair!r:.60}: it must be a pair (low, high)")
    unit = PARAMETER_UNITS[name]
    low = check_number(f"lower bound of {name}", pair[0], low=least, high=most, unit=unit)
    high = check_number(
        f"upper bound of {name}", pair[1], low=low, high=most, low_open=True, unit=unit
    )
    return low, high


def predict_contraction(model: MuscleModel, data: Measurements) -> NDArray[np.float64]:
    """Return the model's contraction at the pressure, load and direction of each row [mm].

    Raises
    ------
    InputError
        If the model has no answer for a row; the row is named.
    """
    try:
        return _predict(model, data)
    except BozziniError as error:
        for row in range(len(data)):
            word = str(data.direction[row]) or None
            try:
                model.contraction(float(data.pressure[row]), float(data.load[row]), direction=word)
            except BozziniError as at_row:
                raise type(at_row)(f"{data.name_row(row)}: {at_row}") from None
        raise error


def _predict(model: MuscleModel, data: Measurements) -> NDArray[np.float64]:
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
    stiffness = _predict_stiffness(build(values), data, predicted)
    columns = []
    for name, low, high in pairs:
        force = [
            _predict_force(build({**values, name: value}), data, predicted) for value in (low, high)
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
        ends = [_predict(build({**values, name: value}), data) for value in (low, high)]
        columns.append((ends[1] - ends[0]) / (high - low))
    return np.stack(columns, axis=-1)


def _predict_force(
    model: MuscleModel, data: Measurements, contraction: NDArray[np.float64]
) -> NDArray[np.float64]:
    answer = model.force(data.pressure, contraction, direction=_take_direction(data))
    return np.asarray(answer, dtype=np.float64)


def _predict_stiffness(
    model: MuscleModel, data: Measurements, contraction: NDArray[np.float64]
) -> NDArray[np.float64]:
    direction = _take_direction(data)
    if direction is None:
        return np.asarray(model.stiffness(data.pressure, contraction), dtype=np.float64)
    if isinstance(model, StaticModel):
        return np.asarray(model.stiffness(data.pressure, contraction, direction=direction))
    step = 1e-5
    ahead, behind = (_predict_force(model, data, contraction + s) for s in (step, -step))
    return (behind - ahead) / (2.0 * step)


def _take_direction(data: Measurements) -> NDArray[np.str_] | None:
    return data.direction if (data.direction != "").any() else None
