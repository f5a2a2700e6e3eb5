"""Predictions of a fitted model at states that were not measured, with their bands.

To first order in the errors of the fitted parameters ``p``, of covariance ``C``, the response ``f``
has the variance ``g C g`` with ``g = df/dp``: of its mean, the confidence band. A single reading
scatters about that with the standard deviation ``s`` of the fit as well: the prediction band.
Both are symmetric, with Student's t. What the specimens of a fit have of their own is known of one
more by as few values as there are specimens; the degrees of freedom of all parts together are
Satterthwaite's (Biometrics Bulletin 2, 1946, 110-114). The bands know only what the fit knew: what
all specimens of the fit shared, and a new one does not, is not in them.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_kind, check_number, list_quantities
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Json, Result, take_axes
from .data import GEOMETRY, Measurements, describe_field
from .design import Muscle
from .files import FitSummary, MuscleFile
from .model import MuscleModel
from .problem import (
    DIFFERENCE_STEP,
    END_FIELDS,
    FitData,
    change_model,
    choose_scale,
    differentiate,
    move_model,
    try_response,
)
from .table import take_measurements

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


MOST_LEVEL = 0.999999
"""Largest probability of a band: that of 1 has no end."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction(Result):
    """What a fitted model predicts at states; all in the unit of the response.

    Parameters
    ----------
    task : FitData
        The response, and the states.
    predicted : ndarray, shape (n,)
        The response; 0 where the model has no answer.
    answered : ndarray of bool, shape (n,)
        Where it has one.
    confidence, prediction : ndarray, shape (n,)
        Half the width of the band of the mean, and of a single reading.
    level : float
        Probability of the bands.
    """

    task: FitData
    predicted: Floats
    answered: NDArray[np.bool_]
    confidence: Floats
    prediction: Floats
    level: float

    @property
    def converged(self) -> bool:
        """Whether the model has an answer at every state."""
        return bool(self.answered.all())

    @property
    def reason(self) -> str:
        """At how many states it has none; empty if at all."""
        count = int((~self.answered).sum())
        return f"the model has no answer at {count} of {len(self.answered)} states" if count else ""

    @property
    def residual(self) -> float:
        """Root mean square of measured less predicted response, if the states were measured."""
        return float(np.sqrt(np.mean(self._miss**2)))

    @property
    def _miss(self) -> Floats:
        return np.where(self.answered, self.predicted - self.task.measured, self.task.worst)

    @property
    def residual_by_specimen(self) -> dict[str, float]:
        """The same of each specimen."""
        data = self.task.data
        return {
            name: float(np.sqrt(np.mean(self._miss[data.specimen == name] ** 2)))
            for name in data.list_specimens()
        }

    @property
    def covered(self) -> float:
        """Share of the measured responses that lie in the prediction band."""
        inside = np.abs(self.predicted - self.task.measured) <= self.prediction
        return float(np.mean(inside & self.answered))

    def list_columns(self) -> dict[str, object]:
        """Return the columns of `to_frame`, a row for each state."""
        states, unit = self.task.states, self.task.unit
        columns: dict[str, object] = {
            "pressure_MPa": states.pressure,
            "contraction_mm": states.contraction,
            "load_N": states.load,
        }
        name = f"{self.task.response}_{unit}"
        columns.pop("load_N" if self.task.response == "force" else name, None)
        return columns | {
            name: self.predicted,
            f"confidence_{unit}": self.confidence,
            f"prediction_{unit}": self.prediction,
            "answered": self.answered,
        }

    def to_dict(self) -> Json:
        """Return the prediction as plain values, columns with units in their names."""
        values = {"response": self.task.response, "level": self.level, **self.list_columns()}
        values |= {"converged": self.converged, "reason": self.reason}
        return {name: x.tolist() if isinstance(x, np.ndarray) else x for name, x in values.items()}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the prediction with its band over the pressure, and return the axes.

        Specimens are apart, and so is what was measured if the response is not 0 throughout.
        """
        task, pressure = self.task, self.task.states.pressure
        axes = take_axes(ax, x="pressure [MPa]", y=f"{task.response} [{task.unit}]")
        for name in task.data.list_specimens():
            every = task.data.specimen == name
            rows = every & self.answered
            words = f"{name}: " if name else ""
            bars = axes.errorbar(
                pressure[rows], self.predicted[rows], self.prediction[rows], fmt="o",
                markersize=3.0, linewidth=0.8, label=f"{words}{100.0 * self.level:g} % of readings",
            )  # fmt: skip
            if task.measured.any():
                axes.plot(
                    pressure[every], task.measured[every], "x", color=bars.lines[0].get_color(),
                    markersize=5.0, label=f"{words}measured",
                )  # fmt: skip
        axes.legend()
        return axes


def predict(
    fitted: MuscleFile,
    data: Measurements | pandas.DataFrame,
    *,
    length: float | None = None,
    free_length: tuple[float, float] | None = None,
    level: float = 0.95,
) -> Prediction:
    """Predict the response of a fitted muscle, also of a specimen that was not in the fit.

    Parameters
    ----------
    fitted : MuscleFile
        A fit, from `Calibration.to_file` or a file.
    data : Measurements or DataFrame
        The states. Geometry in it is that of the specimens; a specimen of the fit, by its name,
        has its own values, and must be there with its geometry. What is predicted need not be in
        it.
    length : float, optional
        Rest length of the muscle [mm], if it is another.
    free_length : tuple of float, optional
        Pressure [MPa] and length without load [mm], from which the offset follows; if there is
        none, and none in the data, it is the fit's.
    level : float
        Probability of the bands, above 0 and at most `MOST_LEVEL`.

    Raises
    ------
    InputError
        If the file holds no fit, or a value is not legal.
    """
    check_kind("fitted", fitted, MuscleFile)
    fit = fitted.fit
    if fit is None:
        raise InputError("the muscle file holds no fit: write one by 'bozzini muscle fit --out'")
    if fit.rms is None:
        raise InputError("the fit has no rms: without it there is no band of readings")
    check_number("level", level, low=0.0, high=MOST_LEVEL, low_open=True, unit="")
    from scipy.stats import t as student

    muscle = fitted.muscle if length is None else fitted.muscle.replace(length=length)
    data = take_measurements(data, muscle=muscle, measured=fit.response != "contraction")
    own = bool(data.free_lengths) and fit.anchored and free_length is None
    known = set(fit.specimens) & set(data.list_specimens())
    task = FitData(
        muscle=muscle,
        data=data,
        response=fit.response,
        anchored=own,
        each=fit.each if known else (),
    )
    _check_specimens(fit, task)
    count = len(data)
    predicted, held = np.zeros(count), np.zeros(count, dtype=np.bool_)
    variance, between = np.zeros(count), np.zeros(count)  # of which between is among specimens
    base = fitted.build()
    for part in task.parts:
        values = {
            name: value
            for name, value in fit.specimens.get(part.specimen, {}).items()
            if name in fit.names
        }
        anchor = part.anchor if own else free_length
        build = functools.partial(_change, base, part.muscle, values, anchor)
        model, rows = build({}), task.states.select(part.rows)
        found, good = try_response(model, rows, fit.response)
        predicted[part.rows], held[part.rows] = found, good
        if fit.names and good.any():
            at = read_values(model, fit.names)
            steps = [
                DIFFERENCE_STEP * max(choose_scale(n, x, own=True), abs(x)) for n, x in at.items()
            ]
            slopes = differentiate(
                build,
                at,
                pairs=[
                    (n, x - step, x + step) for (n, x), step in zip(at.items(), steps, strict=True)
                ],
                data=rows.select(good),
                predicted=found[good],
                response=fit.response,
            )
            covariance = _find_covariance(fit, part.specimen)
            variance[part.rows[good]] = np.einsum("ij,jk,ik->i", slopes, covariance, slopes)
            if part.specimen not in fit.specimens:
                between[part.rows[good]] = slopes**2 @ find_spread(fit).sum(axis=0)
    fitted_count = len(fit.names) + len(fit.each) * max(len(fit.specimens) - 1, 0)
    freedom = max(fit.rows - fitted_count, 1)
    within = np.maximum(variance - between, 0.0)

    def widen(scatter: float) -> Floats:
        """Half the band with a variance of readings, with the freedom of all parts."""
        total = np.maximum(within + between + scatter, 1e-300)
        shares = (
            (within / total) ** 2 / (fit.freedom or freedom)
            + (between / total) ** 2 / max(len(fit.specimens) - 1, 1)
            + (scatter / total) ** 2 / freedom
        )
        each = 1.0 / np.maximum(shares, 1.0 / max(freedom, fit.freedom))
        return np.asarray(student.ppf(0.5 + 0.5 * level, each) * np.sqrt(total))

    return Prediction(
        task=task,
        predicted=np.where(held, predicted, 0.0),
        answered=held,
        confidence=widen(0.0),
        prediction=widen(fit.rms**2),
        level=level,
    )


def _check_specimens(fit: FitSummary, task: FitData) -> None:
    """Raise `InputError` if a specimen of the fit is there without its geometry."""
    for name in task.data.list_specimens():
        for key, value in fit.specimens.get(name, {}).items():
            given = task.muscle.given.get(key, value)
            if key in fit.names or key in task.data.geometry:
                continue
            if not math.isclose(given, value, rel_tol=1e-9):
                title = f"{describe_field(key)} [{GEOMETRY[key].unit}]"
                raise InputError(
                    f"specimen {name!r} was fitted with a {describe_field(key)} of {value:g}, the "
                    f"muscle has {given:g}: give a column '{title}', or another name"
                )


def _find_covariance(fit: FitSummary, specimen: str) -> Floats:
    """Return the covariance of the fitted numbers for a specimen.

    The file's is that for one more specimen. For one of the fit what specimens differ by is taken
    off again, and what it has of its own is known as well as one value, where its mean over
    specimens is known better, by their number at most.
    """
    covariance = np.array(fit.covariance).reshape(len(fit.names), len(fit.names))
    if specimen not in fit.specimens:
        return covariance
    spreads = find_spread(fit).sum(axis=0)
    for index, (name, spread) in enumerate(zip(fit.names, spreads, strict=True)):
        if spread > 0.0:
            count = sum(name in known for known in fit.specimens.values())
            covariance[index, index] = count * max(covariance[index, index] - spread, 0.0)
    return covariance


def find_spread(fit: FitSummary) -> Floats:
    """Return variances of each of the k fitted numbers (2, k): among the specimens, of their mean.

    Their sum is that of one more specimen.
    """
    spread = np.zeros((2, len(fit.names)))
    for index, name in enumerate(fit.names):
        own = [known[name] for known in fit.specimens.values() if name in known]
        if name in fit.each and len(own) > 1:
            among = float(np.var(own, ddof=1))
            spread[:, index] = among, among / len(own)
    return spread


def _change(
    base: MuscleModel,
    muscle: Muscle,
    change: Mapping[str, float],
    anchor: tuple[float, float] | None,
    values: Mapping[str, float],
) -> MuscleModel:
    """Return the model of a specimen with some values of the fitted numbers."""
    return change_model(move_model(base, muscle), {**change, **values}, anchor=anchor)


def read_values(model: MuscleModel, names: tuple[str, ...]) -> dict[str, float]:
    """Return the fitted numbers of a model."""
    ends = getattr(model, "ends", None)
    inner = getattr(model, "model", model)
    found = {}
    for name in names:
        if name in END_FIELDS:
            value = getattr(ends, name, None)
            found[name] = float(value) if isinstance(value, (int, float)) else 0.0
        elif name in list_quantities(Muscle):
            found[name] = float(getattr(inner.muscle, name))
        else:
            keywords = getattr(inner, "keywords", {})
            value = keywords[name] if name in keywords else getattr(inner, name, None)
            if not isinstance(value, (int, float)):
                raise InputError(
                    f"the fit names '{name}', which the model {inner.name} does not have"
                )
            found[name] = float(value)
    return found
