"""How large the errors of a model are, from a recording; and how well it then predicts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array, check_integer, check_kind, check_word
from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.estimation import find_conformal_limit
from ..progress import Progress, no_progress
from ..results import Json, Result, Shown, take_axes
from .estimation import ShapeEstimator
from .model_error import ModelError
from .shape_estimate import LIMIT, EstimatorState, ShapeEstimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TAILS = 4.0
"""Degrees of freedom of Student's distribution, whose tails outliers ask for."""
SPAN = 2.0
"""Standard deviation of the logarithm of a size before anything is measured."""
MOST_FITTED = 120
"""Evaluations of the likelihood."""
SHOWN = 5
"""Rows that a warning names."""
APART = 1e6
"""Time between parts of a recording that do not follow each other [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorRecord(Shown):
    """Commands and readings in the order of time.

    Parameters
    ----------
    times : (n,) ndarray
        [s].
    commands : (n, t) ndarray
        Displacements [mm] or tensions [N].
    readings : mapping of str to (n, k) ndarray
        Of each sensor; NaN where it read nothing.
    """

    times: Floats
    commands: Floats
    readings: Mapping[str, Floats]

    def __post_init__(self) -> None:
        times = check_array("times", self.times)
        commands = check_array("commands", self.commands)
        if commands.ndim != 2 or times.shape != commands.shape[:1]:
            raise InputError(
                f"commands have shape {commands.shape} and times {times.shape}: a row of commands "
                "for each time"
            )
        if np.any(np.diff(times) < 0.0):
            raise InputError("times must not fall: rows are in the order of time")
        if not len(times):
            raise InputError("there are no rows: a recording has one or more")
        readings = {
            name: np.asarray(values, dtype=np.float64).reshape(len(values), -1)
            for name, values in self.readings.items()
        }
        for name, values in readings.items():
            if len(values) != len(times):
                raise InputError(f"there are {len(values)} readings of '{name}': {len(times)} rows")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "commands", commands)
        object.__setattr__(self, "readings", readings)

    def __len__(self) -> int:
        return len(self.times)

    def read(self, row: int) -> dict[str, Floats]:
        """Return the readings of a row."""
        return {name: values[row] for name, values in self.readings.items()}

    def select(self, rows: ArrayLike) -> SensorRecord:
        """Return some of the rows; a gap between them is long: what has a memory is forgotten."""
        chosen = np.asarray(rows)
        places = np.flatnonzero(chosen) if chosen.dtype == bool else chosen
        gaps = np.where(np.diff(places, prepend=places[:1] - 1) > 1, APART, 0.0)
        return SensorRecord(
            times=self.times[places] + np.cumsum(gaps),
            commands=self.commands[places],
            readings={name: values[places] for name, values in self.readings.items()},
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class AheadPrediction(Shown):
    """What was predicted some rows ahead, against what was read there.

    Parameters
    ----------
    ahead : int
        Rows.
    misses : (n, k) ndarray
        Readings less predictions, all numbers of all sensors, in their units; NaN where none.
    deviations : (n, k) ndarray
        Their standard deviations as predicted, noise included.
    """

    ahead: int
    misses: Floats
    deviations: Floats

    @property
    def rms(self) -> float:
        """Root mean square of the length of a row's misses: of a place, its distance."""
        known = np.isfinite(self.misses)
        squares = np.sum(np.where(known, self.misses, 0.0) ** 2, axis=1)
        return _find_root_mean(squares[known.any(axis=1)])

    @property
    def ratio(self) -> float:
        """Root mean square of all misses, by their standard deviations: 1 is as expected."""
        squares = (self.misses / self.deviations) ** 2
        return _find_root_mean(squares[np.isfinite(squares)])

    def measure_coverage(self, widening: float = 1.0) -> float:
        """Return the share of numbers within their 95 % interval, times a factor."""
        known = np.isfinite(self.misses)
        inside = np.abs(self.misses) <= widening * LIMIT * self.deviations
        return float(np.mean(inside[known])) if known.any() else math.nan

    def find_widening(self) -> float:
        """Return the factor by which 95 % intervals hold 95 % of these numbers (conformal)."""
        return find_conformal_limit(np.abs(self.misses) / self.deviations, 0.95) / LIMIT


def _find_root_mean(squares: Floats) -> float:
    return math.sqrt(float(np.mean(squares))) if len(squares) else math.nan


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimateHistory(Result):
    """Estimates of a recording, row by row, each from the ones before.

    Parameters
    ----------
    times : (n,) ndarray
        [s].
    estimates : tuple of ShapeEstimate
        After the readings of each row.
    predictions : tuple of AheadPrediction
    commands : (n, t) ndarray
        Displacements [mm] or tensions [N] that reached the tendons.
    widening : float
        By which bands of shape and tensions were made wider.
    why : str
        What that is from.
    notes : tuple of str
    """

    times: Floats
    estimates: tuple[ShapeEstimate, ...]
    predictions: tuple[AheadPrediction, ...]
    commands: Floats
    widening: float = 1.0
    why: str = ""
    notes: tuple[str, ...] = ()

    def widen(self, factor: float, why: str = "") -> EstimateHistory:
        """Return it with bands of shape and tensions that are a factor wider, and why."""
        if factor == 1.0:
            return self
        return dataclasses.replace(
            self,
            estimates=tuple(one.widen(factor) for one in self.estimates),
            widening=factor * self.widening,
            why=why,
        )

    def describe_notes(self) -> list[str]:
        """Return what a user should know, a line each."""
        lines = [*filter(None, [self.why]), *(f"note: {one}" for one in self.notes)]
        if wrong := self.unexpected:
            worst = max((self.estimates[k - 1] for k in wrong), key=lambda one: one.surprise)
            rows = ", ".join(map(str, wrong[:SHOWN])) + (", ..." if len(wrong) > SHOWN else "")
            lines.append(
                f"warning: readings of {len(wrong)} of {len(self.times)} row(s) ({rows}) cannot be "
                f"by the sizes of errors, up to {worst.surprise:.3g} times what is expected: "
                "intervals are too narrow; give larger errors, or --memory"
            )
        return lines

    @property
    def state(self) -> EstimatorState:
        """What is known after the last row."""
        return self.estimates[-1].state

    @property
    def converged(self) -> bool:
        """Whether every row has an estimate."""
        return all(one.converged for one in self.estimates)

    @property
    def reason(self) -> str:
        """Return why the first row without one has none."""
        wrong = [k for k, one in enumerate(self.estimates) if not one.converged]
        return f"row {wrong[0] + 1}: {self.estimates[wrong[0]].reason}" if wrong else ""

    @property
    def unexpected(self) -> list[int]:
        """Rows, from 1, whose readings are where by the sizes of errors they cannot be."""
        return [k + 1 for k, one in enumerate(self.estimates) if not one.expected]

    @property
    def residual(self) -> float:
        """Root mean square of what readings miss, by their noise."""
        return math.sqrt(float(np.mean([one.residual**2 for one in self.estimates])))

    def to_dict(self) -> Json:
        """Return verdict and errors of prediction, and the last estimate."""
        return {
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.residual,
            "rows": len(self.times),
            "unexpected_rows": self.unexpected,
            "widening": self.widening,
            "notes": self.notes,
            "predictions": [
                {
                    "ahead": one.ahead,
                    "rms": one.rms,
                    "ratio": one.ratio,
                    "coverage": one.measure_coverage(),
                }
                for one in self.predictions
            ],
            "last": self.estimates[-1].to_dict(),
        }

    def list_columns(self) -> Json:
        """Return the columns of `to_frame`, a row for each row of the recording."""
        first = self.estimates[0]
        columns: Json = {"time_s": self.times}
        for k, axis in enumerate("xyz"):
            columns[f"tip_{axis}_mm"] = [one.tip[k] for one in self.estimates]
            columns[f"tip_{axis}_deviation_mm"] = [one.deviations[-1, k] for one in self.estimates]
        for k, name in enumerate(first.robot.tendon_names):
            columns[f"{name}_N"] = [one.tensions[k] for one in self.estimates]
        for k in range(len(first.loads)):
            for name in ("place", "force"):
                unit = "mm" if name == "place" else "N"
                for end in ("", "_low", "_high"):
                    columns[f"load_{k + 1}_{name}{end}_{unit}"] = [
                        getattr(one.loads[k], f"{name}{end}") for one in self.estimates
                    ]
        if first.contact is not None or any(one.contact is not None for one in self.estimates):
            contacts = [one.contact for one in self.estimates]
            columns["gap_mm"] = [math.nan if one is None else one.gaps.min() for one in contacts]
            columns["wall_force_N"] = [
                math.nan if one is None else one.sizes.sum() for one in contacts
            ]
        columns["surprise"] = [one.surprise for one in self.estimates]
        columns["converged"] = [one.converged for one in self.estimates]
        columns["reason"] = [one.reason for one in self.estimates]
        return columns

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the tip over time with its 95 % band, of one row the shape; return the axes."""
        if len(self.times) == 1:
            return self.estimates[0].plot(ax)
        axes = take_axes(ax, x="time [s]", y="tip [mm]")
        tips = np.array([one.tip for one in self.estimates])
        half = LIMIT * np.array([one.deviations[-1] for one in self.estimates])
        for k, axis in enumerate("xyz"):
            (line,) = axes.plot(self.times, tips[:, k], label=axis)
            ends = (tips + half)[:, k], (tips - half)[:, k]
            axes.fill_between(self.times, *ends, alpha=0.3, color=line.get_color())
        axes.legend()
        return axes


def follow_record(
    estimator: ShapeEstimator,
    record: SensorRecord,
    *,
    ahead: Sequence[int] = (),
    state: EstimatorState | None = None,
    progress: Progress = no_progress,
) -> EstimateHistory:
    """Return estimates of all rows of a recording, and predictions so many rows ahead of them.

    A prediction knows the commands up to its row, and readings up to as many rows before.
    """
    check_kind("record", record, SensorRecord)
    for steps in ahead:
        check_integer("ahead", steps, low=1)
    estimates: list[ShapeEstimate] = []
    count = sum(sensor.count for sensor in estimator.sensors)
    missed = np.full((len(ahead), 2, len(record), count), np.nan)
    for row in range(len(record)):
        progress("rows", row / len(record))
        if estimates:
            elapsed = float(record.times[row] - record.times[row - 1])
            state = estimator.wait(estimates[-1].state, elapsed)
        found = estimator.estimate(record.commands[row], record.read(row), state=state)
        estimates.append(found)
        for place, steps in enumerate(ahead):
            if (later := row + steps) < len(record):
                elapsed = float(record.times[later] - record.times[row])
                if elapsed >= APART:  # another part of the recording
                    continue
                missed[place, :, later] = estimator.miss(
                    record.commands[later],
                    record.read(later),
                    state=estimator.wait(found.state, elapsed),
                )
    progress("followed", 1.0)
    return EstimateHistory(
        times=record.times,
        commands=record.commands,
        estimates=tuple(estimates),
        predictions=tuple(
            AheadPrediction(ahead=steps, misses=pair[0], deviations=pair[1])
            for steps, pair in zip(ahead, missed, strict=True)
        ),
    )


def predict_unread(
    estimator: ShapeEstimator, record: SensorRecord, *, read: Sequence[str]
) -> AheadPrediction:
    """Return what sensors that are not read miss of estimates, row by row, for calibration.

    Where all are read, each row is predicted from those before it; `ahead` is then 1, else 0.

    Raises
    ------
    InputError
        If a sensor that is read is not the estimator's.
    """
    names = [one.name for one in estimator.sensors]
    for name in read:
        check_word("read", name, names)
    unread, state = [name for name in names if name not in read], None
    missed = np.full((2, len(record), sum(one.count for one in estimator.sensors)), np.nan)
    told = np.concatenate([np.full(one.count, one.name not in read) for one in estimator.sensors])
    for row in range(len(record)):
        whole, command = record.read(row), record.commands[row]
        if state is not None:
            state = estimator.wait(state, float(record.times[row] - record.times[row - 1]))
            if not unread:
                missed[:, row] = estimator.miss(command, whole, state=state)
        given = {name: values for name, values in whole.items() if name in read}
        state = estimator.estimate(command, given, state=state).state
        if unread:
            missed[:, row] = estimator.miss(command, whole, state=state)
            missed[:, row, ~told] = np.nan
    return AheadPrediction(ahead=0 if unread else 1, misses=missed[0], deviations=missed[1])


class _Rows(NamedTuple):
    """A recording, linearised where the model makes no error: whitened misses, and slopes."""

    times: Floats
    missed: list[Floats]
    slopes: list[Floats]


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorFit(Result):
    """Sizes of a model's errors.

    Parameters
    ----------
    error : ModelError
    noise : float
        Factor on the noise that sensors state.
    widenings : mapping of int to float
        By rows ahead, the factor by which predicted 95 % intervals hold 95 % of the recording.
    residual : float
        Negative logarithm of the likelihood, by rows.
    converged : bool
    reason : str
    """

    error: ModelError
    noise: float
    widenings: Mapping[int, float]
    residual: float
    converged: bool
    reason: str


def fit_model_error(
    estimator: ShapeEstimator,
    record: SensorRecord,
    *,
    free: Sequence[str] = (),
    ahead: Sequence[int] = (1, 5, 20),
    most: int = MOST_FITTED,
    progress: Progress = no_progress,
) -> ErrorFit:
    """Return the sizes of errors by which a recording is most likely, predicted rows ahead.

    Misses count by Student's distribution, as a few are large. The recording is linearised once,
    where the model makes no error.

    Parameters
    ----------
    estimator : ShapeEstimator
        Its sizes are where the search begins.
    record : SensorRecord
    free : sequence of str
        Fields of `ModelError` to be fitted; all but `reach` that are given and above 0 if none.
        With ``noise`` that of the sensors is, too, all by one factor.
    ahead : sequence of int
        Rows.
    most : int
        Evaluations of the likelihood.
    progress : callable
        Told the share of the recording that is linearised.
    """
    from scipy.optimize import minimize

    rows, error = _linearise(estimator, record, progress), estimator.error
    unused = "zero" if estimator.command == "tension" else "pull"
    names = list(free) or [
        one.name
        for one in dataclasses.fields(error)
        if one.name not in ("reach", unused) and getattr(error, one.name)
    ]
    if len(record) < 2:
        raise InputError("the recording has one row: predictions of it need two or more")
    if not ahead:
        raise InputError("ahead is empty: give rows ahead that are predicted")
    for steps in ahead:
        check_integer("ahead", steps, low=1, high=len(record) - 1)
    legal = [one.name for one in dataclasses.fields(error) if one.name != "reach"]
    for name in names:
        check_word("free", name, ["noise", *legal])
        if not getattr(error, name, 1.0):
            raise InputError(f"'{name}' is free and {getattr(error, name)}: begin above 0")
    begin = np.log([getattr(error, name, 1.0) for name in names])

    def change(values: Floats) -> tuple[ShapeEstimator, float]:
        sizes = dict(zip(names, np.exp(values).tolist(), strict=True))
        noise = sizes.pop("noise", 1.0)
        return dataclasses.replace(estimator, error=dataclasses.replace(error, **sizes)), noise

    def judge(values: Floats) -> float:
        try:
            scores = _filter(estimator, change(values), rows, ahead)
        except InputError:  # a size that is not legal
            return math.inf
        far = 0.5 * float(np.sum(((values - begin) / SPAN) ** 2))
        return far + sum(_measure_tails(*pair) for pair in scores) / len(ahead)

    simplex = np.vstack([begin, begin + 0.7 * np.eye(len(begin))])
    found = minimize(
        judge,
        begin,
        method="Nelder-Mead",
        options={"maxfev": most, "xatol": 0.05, "fatol": 0.3, "initial_simplex": simplex},
    )
    best, noise = change(np.asarray(found.x))
    widenings = {}
    for steps, (misses, spreads) in zip(
        ahead, _filter(estimator, (best, noise), rows, ahead), strict=True
    ):
        deviations = [np.sqrt(np.diag(spread)) for spread in spreads]
        told = AheadPrediction(
            ahead=steps,
            misses=np.concatenate(misses)[:, None],
            deviations=np.concatenate(deviations)[:, None],
        )
        widenings[steps] = told.find_widening()
    return ErrorFit(
        error=best.error,
        noise=noise,
        widenings=widenings,
        residual=float(found.fun) / len(record),
        converged=bool(found.success),
        reason="" if found.success else f"the search ended after {most} evaluations",
    )


def _linearise(estimator: ShapeEstimator, record: SensorRecord, progress: Progress) -> _Rows:
    missed, slopes = [], []
    state = estimator.begin()
    for row in range(len(record)):
        progress("linearised", row / len(record))
        own, way, state = estimator.linearise(record.commands[row], record.read(row), state=state)
        missed.append(own)
        slopes.append(way)
    return _Rows(record.times, missed, slopes)


def _filter(
    first: ShapeEstimator,
    changed: tuple[ShapeEstimator, float],
    rows: _Rows,
    ahead: Sequence[int],
) -> list[tuple[list[Floats], list[Floats]]]:
    """Return misses of predictions and their covariances, with the sizes of another estimator."""
    # Slopes are by the modes of the first one: those of the other are as many times larger.
    other, noise = changed
    scale, variance = first.measure_scale(other), noise**2
    ways = [slopes * scale for slopes in rows.slopes]
    state = other.begin()
    start = state.mean
    found: list[tuple[list[Floats], list[Floats]]] = [([], []) for _ in ahead]
    last = rows.times[0]
    for row, (time, missed, own) in enumerate(zip(rows.times, rows.missed, ways, strict=True)):
        state = other.wait(state, float(time - last))
        last = time
        if not len(missed):
            continue
        crossed = own @ state.covariance
        inner = crossed @ own.T + variance * np.eye(len(own))
        gain = np.linalg.solve(inner, crossed).T
        state = dataclasses.replace(
            state,
            mean=state.mean + gain @ (missed - own @ state.mean),
            covariance=state.covariance - gain @ crossed,
        )
        for place, steps in enumerate(ahead):
            later = row + steps
            if later < len(rows.times) and len(rows.missed[later]):
                elapsed = float(rows.times[later] - time)
                if elapsed >= APART:
                    continue
                kept, grown = other.fade(elapsed)
                way, near = ways[later], ways[later] * kept
                found[place][0].append(
                    rows.missed[later] - way @ start - near @ (state.mean - start)
                )
                spread = near @ state.covariance @ near.T + (way * grown) @ way.T
                found[place][1].append(spread + variance * np.eye(len(way)))
    return found


def _measure_tails(misses: list[Floats], spreads: list[Floats]) -> float:
    """Return the negative logarithm of a likelihood with tails."""
    total = 0.0
    for count in {len(miss) for miss in misses}:
        own = [k for k, miss in enumerate(misses) if len(miss) == count]
        miss, spread = (np.array([values[k] for k in own]) for values in (misses, spreads))
        square = np.sum(miss * np.linalg.solve(spread, miss[..., None])[..., 0], axis=1)
        total += 0.5 * float(np.sum(np.linalg.slogdet(spread)[1]))
        total += 0.5 * (TAILS + count) * float(np.sum(np.log1p(square / (TAILS - 2.0))))
    return total
