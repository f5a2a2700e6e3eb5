"""Compare models on measurements, fit them all, and rank them."""

from __future__ import annotations

import math
import pickle
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_integer, check_number, check_word, show_apart, show_value
from ..errors import BozziniError, InputError, PluginError
from ..numeric.least_squares import Clock, OutOfTimeError
from ..numeric.processes import open_processes
from ..progress import Progress, no_progress
from ..results import Json, Result, Shown, take_axes, to_plain
from .data import Measurements
from .design import Muscle, check_muscle, preset
from .model import MuscleModel
from .models import MODELS
from .muscle_fit import (
    Calibration,
    FitOptions,
    conclude,
    find_minimum,
    find_poor,
    fit_task,
    release,
)
from .problem import (
    END_FIELDS,
    FITTED_UNSET,
    HELD_UNSET,
    Answers,
    FitData,
    Problem,
    Response,
    SpecimenRows,
    Unknowns,
    assemble,
    choose_bounds,
    choose_unknowns,
    explain_gap,
    find_states,
    label_unknown,
    list_own,
    list_unused,
    move_model,
    name_default_fields,
    predict_parts,
    settle_unset,
)
from .table import take_measurements

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

_LEAST_CONTRACTION_MM = 1e-3  # largest contraction that errors can be a percentage of [mm]
_LEAST_SPAN = 1e-9  # the same of other responses [N], [MPa]


Criterion = Literal["aicc", "bic", "cv"]
CRITERIA: tuple[Criterion, ...] = get_args(Criterion)
"""What models can be ranked by."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelScore(Shown):
    """How near one model comes to the measurements.

    All in the unit of the response. A row that the model has no answer for counts with the span of
    the measured response, or the largest if that is more.

    Parameters
    ----------
    name : str
    unit : str
        The unit of the response: mm, N or MPa.
    standard_error : float
        ``sqrt(sum(r^2) / (n - k))`` with k parameters fitted to these very data.
    standard_error_percent : float
        The same as a percentage of the largest measured response: of contractions the thesis's
        measure (section 3.3.4), which does not define its standard error further.
    rmse : float
        ``sqrt(mean(r^2))``.
    bias : float
        Mean of model less measurement, at the rows that have an answer.
    largest : float
        Largest difference, without sign.
    predicted : ndarray, shape (n,)
        Response of the model at each row; the measured one where it has none.
    answered : ndarray of bool, shape (n,)
        Which rows the model has an answer for.
    """

    name: str
    unit: str
    standard_error: float
    standard_error_percent: float
    rmse: float
    bias: float
    largest: float
    predicted: NDArray[np.float64]
    answered: NDArray[np.bool_]

    def to_dict(self) -> Json:
        """Return the score as plain values, with units in the names."""
        return {
            "model": self.name,
            f"standard_error_{self.unit}": self.standard_error,
            "standard_error_percent": self.standard_error_percent,
            f"rmse_{self.unit}": self.rmse,
            f"bias_{self.unit}": self.bias,
            f"largest_error_{self.unit}": self.largest,
            "rows_answered": int(self.answered.sum()),
        }

    def format_row(self, wide: int) -> str:
        """Return the score as a row of a table whose first column is so wide."""
        unit = f"{self.unit:<2}"
        return (
            f"{self.name:<{wide}}  {self.standard_error:6.3f} {unit}"
            f"{self.standard_error_percent:5.1f} %{self.rmse:7.3f} {unit}"
            f"{self.bias:+7.3f} {unit}{self.largest:7.3f} {unit}"
        )

    @property
    def gaps(self) -> str:
        """At how many rows there is an answer, in words; empty if at all."""
        count, rows = int(self.answered.sum()), len(self.answered)
        return "" if count == rows else f"{count:,} of {rows:,} rows"


def list_columns(rows: Sequence[dict[str, object]]) -> dict[str, list[object]]:
    """Return rows as columns; what only some rows have is None in the others."""
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


class ScoredModels(Result):
    """Models with scores on the same measurements, and those without an answer."""

    refusals: dict[str, str]

    @abstractmethod
    def _list_scores(self) -> Sequence[ModelScore]:
        """The scores, the best first."""

    def to_dict(self) -> Json:
        """Return the models as plain values, the best first, and why others have no answer."""
        values = {name: getattr(self, name) for name in ("converged", "reason", "residual")}
        values |= {"models": self._list_models(), "refusals": self.refusals}
        return {name: to_plain(value) for name, value in values.items()}

    def _list_models(self) -> list[Json]:
        """Return what `to_dict` has of each model."""
        return [{**score.to_dict(), "fitted": {}} for score in self._list_scores()]

    @property
    def converged(self) -> bool:
        """Whether a model has an answer."""
        return bool(self._list_scores())

    @property
    def reason(self) -> str:
        """Why models have none, the first reason; empty if all have."""
        return next(iter(self.refusals.values()), "")

    @property
    def residual(self) -> float:
        """Smallest root mean square of all models [unit of the response]; infinite without any."""
        return min((score.rmse for score in self._list_scores()), default=math.inf)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the models' root mean squares as bars, the best first, and return the axes."""
        scores = self._list_scores()
        unit = scores[0].unit if scores else "mm"
        axes = take_axes(ax, x=f"root mean square error [{unit}]", y="")
        axes.barh([score.name for score in scores], [score.rmse for score in scores])
        axes.invert_yaxis()
        return axes


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison(ScoredModels):
    """Scores of models on the same measurements, the nearest first.

    Parameters
    ----------
    data : Measurements
    scores : tuple of ModelScore
    refusals : dict
        Models that have no answer for any row, and why.
    response : str
        What was compared.
    """

    data: Measurements
    scores: tuple[ModelScore, ...]
    refusals: dict[str, str]
    response: Response = "contraction"

    def format_table(self) -> str:
        """Return the scores as a table of text."""
        wide = max([5, *(len(score.name) for score in self.scores)])
        lines = [f"{'model':<{wide}}  standard error      RMSE      bias   largest"]
        lines += [f"{score.format_row(wide)}  {score.gaps}".rstrip() for score in self.scores]
        lines += [f"{name}: no answer: {reason}" for name, reason in self.refusals.items()]
        return "\n".join(lines)

    def list_columns(self) -> dict[str, list[object]]:
        """Return the columns of `to_frame`, a row for each model."""
        return list_columns([score.to_dict() for score in self.scores])

    def _list_scores(self) -> Sequence[ModelScore]:
        return self.scores


def compare_models(
    models: Mapping[str, MuscleModel],
    data: Measurements,
    *,
    fitted: Mapping[str, int] | None = None,
    refusals: Mapping[str, str] | None = None,
    response: Response | None = None,
) -> Comparison:
    """Compare the answers of models with the measured ones.

    Parameters
    ----------
    models : mapping of str to MuscleModel
        The models by the name to show. Of a specimen whose geometry is measured, the model is that
        of a muscle with this geometry.
    data : Measurements
    fitted : mapping of str to int, optional
        How many parameters of a model were fitted to these data; 0 by default.
    refusals : mapping of str to str, optional
        Models without an answer already before, in their calibration for example, and why.
    response : str, optional
        What is compared: ``"force"``, ``"contraction"`` or ``"pressure"``; that of the data by
        default.

    Raises
    ------
    InputError
        If there is no model, the largest contraction is below 0.001 mm, there are no more rows than
        fitted parameters, or `fitted` names a model that is not there.
    """
    counts = dict(fitted or {})
    for name in counts:
        if name not in models:
            raise InputError(
                f"parameters are fitted in '{name}': the models are {', '.join(models) or 'none'}"
            )
    refused = dict(refusals or {})
    if not models and not refused:
        raise InputError("there are 0 models to compare: give 1 or more")
    chosen: Response = data.response if response is None else response
    scores = []
    for name, model in models.items():
        count = check_integer(
            f"number of parameters fitted in {name}", counts.get(name, 0), low=0, high=len(data) - 1
        )
        task = FitData(muscle=model.muscle, data=data, response=chosen)
        task.check()
        check_largest(task)
        try:
            predicted, held = predict_parts(
                task,
                lambda part, model=model: move_model(model, part.muscle),  # type: ignore[misc]
            )
        except BozziniError as error:
            refused[name] = str(error)
            continue
        if not held.any():
            refused[name] = explain_gap(model, data, chosen)
            continue
        scores.append(score_model(name, (predicted, held), task, fitted=count))
    scores.sort(key=lambda score: score.standard_error)
    return Comparison(data=data, scores=tuple(scores), refusals=refused, response=chosen)


def check_largest(task: FitData) -> None:
    """Raise `InputError` if there is no response that errors could be a percentage of."""
    largest = float(np.abs(task.measured).max())
    least = _LEAST_CONTRACTION_MM if task.response == "contraction" else _LEAST_SPAN
    if not largest >= least:
        shown = show_apart(largest, least)
        raise InputError(
            f"the largest {task.response} is {shown[0]} {task.unit}: it must be "
            f"{shown[1]} {task.unit} or more, since errors are percentages of it"
        )


def score_model(name: str, answers: Answers, task: FitData, *, fitted: int) -> ModelScore:
    """Return how near predicted responses come to the measured ones."""
    predicted, held = answers
    difference = np.where(held, predicted - task.measured, 0.0)
    error = np.where(held, difference, task.worst)
    squares, rows = float(error @ error), len(error)
    standard = float(np.sqrt(squares / (rows - fitted)))
    return ModelScore(
        name=name,
        unit=task.unit,
        standard_error=standard,
        standard_error_percent=100.0 * standard / float(np.abs(task.measured).max()),
        rmse=float(np.sqrt(squares / rows)),
        bias=float(difference[held].mean()) if held.any() else 0.0,
        largest=float(np.abs(error).max()),
        predicted=np.where(held, predicted, task.measured),
        answered=held,
    )


# Information criteria: how much of a better fit is owed to more parameters.
#
# For independent normal errors of one unknown variance, with n rows, k fitted parameters and the
# sum of squares S (Burnham, Anderson, Model selection and multimodel inference, 2002, section 2.2
# and 6.4)::
#
#     AICc = n ln(S / n) + 2 K + 2 K (K + 1) / (n - K - 1)
#     BIC  = n ln(S / n) + K ln n             with K = k + 1, for the variance is fitted too
#
# Only differences between models of the same rows mean something.


def compute_aicc(squares: float, rows: int, parameters: int) -> float:
    """Return Akaike's criterion, corrected for few rows."""
    count = check_integer("number of fitted parameters", parameters, low=0) + 1
    check_integer("number of rows", rows, low=count + 2)
    return (
        _weigh_misfit(squares, rows) + 2.0 * count + 2.0 * count * (count + 1) / (rows - count - 1)
    )


def compute_bic(squares: float, rows: int, parameters: int) -> float:
    """Return the Bayesian (Schwarz's) criterion; the arguments are those of `compute_aicc`."""
    count = check_integer("number of fitted parameters", parameters, low=0) + 1
    check_integer("number of rows", rows, low=1)
    return _weigh_misfit(squares, rows) + count * math.log(rows)


def weigh_models(criteria: Sequence[float] | ArrayLike) -> NDArray[np.float64]:
    """Return Akaike's weights, ``exp(-difference / 2)`` made to sum to 1."""
    values = np.atleast_1d(check_array("criteria", criteria))
    if not values.size:
        raise InputError("there are 0 models to weigh: give 1 or more")
    weights = np.exp(-0.5 * (values - values.min()))
    return np.asarray(weights / weights.sum())


def _weigh_misfit(squares: float, rows: int) -> float:
    number = check_number("sum of squares", squares, low=0.0, low_open=True)
    return rows * math.log(number / rows)


LeaveOut = Literal["rows", "specimen", "pressure"]
LEAVE_OUTS: tuple[LeaveOut, ...] = get_args(LeaveOut)
"""What is left out of a fit at a time: rows dealt at random, a specimen, a level of pressure."""

_LEVEL_SHARE = 0.02  # of the largest pressure: neighbours that are farther apart are two levels
_MOST_LEVELS = 20  # if there are more or fewer than 2, the pressures are cut into bands
_BANDS = 10  # of equal width


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossValidation:
    """How far off a model is at rows that it was not fitted to.

    Parameters
    ----------
    error : float
        Root mean square over all rows, each left out once [unit of the response]; infinite if there
        is a `reason`. A row without an answer counts with `FitData.worst`.
    errors : ndarray, shape (f,)
        The same of each fold; infinite in the folds that failed.
    names : tuple of str
        What was left out in each.
    gaps : int
        How many rows had no answer.
    reason : str
        Why a fold has no error, the first one that has none; empty if all have.
    unsettled : int
        How many of the folds have a fit that did not converge.
    """

    error: float
    errors: NDArray[np.float64]
    names: tuple[str, ...] = ()
    gaps: int = 0
    reason: str = ""
    unsettled: int = 0


Folds = Mapping[str, NDArray[np.bool_]]
"""The rows left out in each turn, by what they are."""


def split_rows(task: FitData, *, folds: int, seed: int = 0) -> dict[str, NDArray[np.bool_]]:
    """Deal the rows into folds at random; rows that repeat a state stay in one."""
    states, of_row = find_states(task)
    if folds > states:
        raise InputError(f"folds is {folds}: there are {states} different state(s) to deal")
    order = np.random.default_rng(seed).permutation(states)
    fold_of = np.empty(states, dtype=np.int64)
    fold_of[order] = np.arange(states) % folds
    return {f"fold {fold + 1}": fold_of[of_row] == fold for fold in range(folds)}


def split_specimens(task: FitData) -> dict[str, NDArray[np.bool_]]:
    """Return the rows of each specimen."""
    data = task.data
    found = {name: data.specimen == name for name in data.list_specimens()}
    if len(found) < 2:
        raise InputError(
            f"there is {len(found)} specimen: to leave one out there must be 2 or more"
        )
    return found


def split_pressures(task: FitData) -> dict[str, NDArray[np.bool_]]:
    """Return the rows of each level of pressure.

    Pressures are one level if none of their neighbours, in order, is farther than 2 % of the
    largest; with fewer than 2 or more than 20 levels they are ten bands of equal width instead.
    """
    pressure = task.data.pressure
    order = np.argsort(pressure, kind="stable")
    far = np.diff(pressure[order]) > _LEVEL_SHARE * pressure.max()
    level = np.empty(len(pressure), dtype=np.int64)
    level[order] = np.concatenate([[0], np.cumsum(far)])
    if not 2 <= level.max() + 1 <= _MOST_LEVELS:
        width = float(np.ptp(pressure)) / _BANDS or 1.0
        level = np.minimum((pressure - pressure.min()) // width, _BANDS - 1).astype(np.int64)
    found = {}
    for each in np.unique(level).tolist():
        rows = level == each
        low, high = 1e3 * pressure[rows].min(), 1e3 * pressure[rows].max()
        found[f"{low:.0f} to {high:.0f} kPa"] = rows
    if len(found) < 2:
        raise InputError(
            "the rows are of 1 level of pressure: to leave one out there must be 2 or more"
        )
    return found


def cross_validate(
    fit: Callable[[FitData], tuple[Callable[[SpecimenRows], MuscleModel], bool]],
    task: FitData,
    folds: Folds,
) -> CrossValidation:
    """Return the error at rows left out, each fold in turn."""
    squares, reason, unsettled, gaps = [], "", 0, 0
    for part in folds.values():
        rows = task.select(part)
        try:
            build, settled = fit(task.select(~part))
            unsettled += not settled
            predicted, held = predict_parts(rows, build)
            miss = np.where(held, predicted - rows.measured, task.worst)
            gaps += int((~held).sum())
            squares.append(float(miss @ miss))
        except BozziniError as error:
            squares.append(math.inf)
            reason = reason or str(error)
    counts = np.array([part.sum() for part in folds.values()])
    total = np.array(squares)
    return CrossValidation(
        error=float(np.sqrt(total.sum() / counts.sum())),
        errors=np.sqrt(total / counts),
        names=tuple(folds),
        gaps=gaps,
        reason=reason,
        unsettled=unsettled,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class RankedModel(Shown):
    """A model fitted to the measurements, with its errors and criteria.

    Parameters
    ----------
    score : ModelScore
        How near it comes, after the fit.
    model : MuscleModel
        The model as fitted.
    calibration : Calibration or None
        Its fit; None if there was nothing to fit.
    held : dict
        Unknown constants that were not fitted, and why.
    parameters : int
        How many were fitted.
    aicc, bic : float
        Criteria by `compute_aicc` and `compute_bic`. A root mean square below 1e-9 of the largest
        contraction counts as that: among models that fit exactly the fewest parameters win.
        `aicc` is infinite with fewer than `parameters` + 3 rows.
    weight : float
        Akaike's weight among the models ranked. Models with one curve and equally many parameters
        count once: `same_as` and the model it names have the same weight.
    validation : CrossValidation or None
        How far off the rows are that were left out of the fit; None if not asked for.
    same_as : str
        A model ranked above that has the same curve; empty if there is none.
    """

    score: ModelScore
    model: MuscleModel
    calibration: Calibration | None
    held: dict[str, str]
    parameters: int
    aicc: float
    bic: float
    weight: float
    validation: CrossValidation | None
    same_as: str = ""

    @property
    def name(self) -> str:
        """The name it was ranked under."""
        return self.score.name

    @property
    def validation_error(self) -> float:
        """Root mean square of the rows left out; infinite where it could not be had."""
        found = self.validation
        return math.inf if found is None or found.reason else found.error

    def to_dict(self) -> Json:
        """Return the entry as plain values, with units in the names."""
        left_out, found = self.validation, self.calibration
        fit: dict[str, object] = {"fitted": {}}
        if found is not None:
            fit = {
                "fitted": found.estimates,
                "fit_warnings": found.warnings,
                "fit_converged": found.converged,
                "fit_reason": found.reason,
            }
        return {
            **self.score.to_dict(),
            "aicc": self.aicc,
            "bic": self.bic,
            "weight": self.weight,
            "parameters": self.parameters,
            f"left_out_{self.score.unit}": self.validation_error,
            "left_out_reason": "" if left_out is None else left_out.reason,
            "left_out_not_converged": 0 if left_out is None else left_out.unsettled,
            "left_out_each": {}
            if left_out is None
            else dict(zip(left_out.names, left_out.errors.tolist(), strict=True)),
            "same_as": self.same_as,
            "held": self.held,
            **fit,
        }

    @property
    def doubt(self) -> str:
        """Which fits did not converge or have gaps, in words; empty if none."""
        words = [self.score.gaps] if self.score.gaps else []
        if self.calibration is not None and not self.calibration.converged:
            stopped = self.calibration.reason.startswith("stopped")
            words.append("stopped" if stopped else "not converged")
        folds = 0 if self.validation is None else self.validation.unsettled
        if folds:
            words.append(f"{folds} of the folds not converged")
        return ", ".join(words)


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranking(ScoredModels):
    """Models fitted to the same measurements, the best first.

    Parameters
    ----------
    data : Measurements
    models : tuple of RankedModel
    refusals : dict
        Models that were not fitted, and why.
    criterion : str
        One of `CRITERIA`.
    folds : int
        Of the cross-validation; 0 for none.
    seed : int
        Of folds and starts.
    task : FitData
        What the models were fitted to, and in which response.
    leave_out : str
        One of `LEAVE_OUTS`.
    """

    data: Measurements
    models: tuple[RankedModel, ...]
    refusals: dict[str, str]
    criterion: Criterion
    folds: int
    seed: int
    task: FitData
    leave_out: LeaveOut = "rows"

    @property
    def is_poor(self) -> bool:
        """Whether the model that comes nearest is poor in absolute terms, see `find_poor`."""
        if not self.models:
            return True
        best = min(self.models, key=lambda entry: entry.score.rmse)
        return best.score.rmse > find_poor(self.task)

    @property
    def notes(self) -> tuple[str, ...]:
        """What unset fields were fitted, and which models lack a criterion, and why."""
        lines = []
        muscle = self.task.muscle
        fitted = [name for name in FITTED_UNSET if name in muscle.unset]
        if fitted:
            words = " and ".join(name.replace("_", " ") for name in fitted)
            lines.append(f"not given, so fitted in each model that uses them: {words}")
        fits = [entry.calibration for entry in self.models if entry.calibration is not None]
        freed = {name for fit in fits for name in fit.free}
        held = [name for name in HELD_UNSET if name in muscle.unset and name not in freed]
        lines += [
            f"not given, so held at a typical value: {name.replace('_', ' ')} "
            f"{getattr(muscle.fill((name,)), name):g} mm"
            for name in held
        ]
        without = [entry.name for entry in self.models if math.isinf(entry.aicc)]
        if without:
            last = "" if self.criterion != "aicc" else (
                "; they come last, by BIC" if len(without) < len(self.models)
                else "; the models are ranked by BIC instead"
            )  # fmt: skip
            lines.append(
                f"no AICc for {', '.join(without)}: it needs 3 rows more than constants fitted, "
                f"there are {len(self.data)} row(s){last}"
            )
        last = " (it comes last, by BIC)" if self.criterion == "cv" else ""
        for entry in self.models:
            if entry.validation is not None and entry.validation.reason:
                reason = entry.validation.reason
                lines.append(f"{entry.name}: no error of the rows left out{last}: {reason}")
        if self.models and self.is_poor:
            best = min(entry.score.rmse for entry in self.models)
            off, above = show_apart(best, find_poor(self.task), digits=3)
            lines.append(
                f"no model fits: the nearest is off by {off} {self.task.unit}, "
                f"{100.0 * best / self.task.span:.0f} % of the span of the measured "
                f"{self.task.response}; above {above} {self.task.unit} a fit is "
                "poor"
                + (
                    ""
                    if any(name in END_FIELDS for fit in fits for name in fit.free)
                    else "; of a measured muscle try --free offset,slack-force,compliance as well"
                )
            )
        return tuple(lines)

    def format_table(self) -> str:
        """Return the ranking as a table of text, with its notes."""
        wide = max([5, *(len(entry.name) for entry in self.models)])
        lines = []
        if self.models:
            head = f"{'model':<{wide}}  standard error      RMSE      bias   largest"
            left_out = "  left out" if self.folds else ""
            lines.append(f"{head}{left_out}  constants  dAICc   dBIC  weight")
        best = {name: min((getattr(entry, name) for entry in self.models), default=0.0)
                for name in ("aicc", "bic")}  # fmt: skip
        counts = {entry.name: entry.parameters for entry in self.models}
        for entry in self.models:
            line = entry.score.format_row(wide)
            if self.folds:
                error = entry.validation_error
                line += (
                    f"{error:7.3f} {entry.score.unit:<2}"
                    if math.isfinite(error)
                    else f"{'none':>10}"
                )
            above = f"{entry.aicc - best['aicc']:7.1f}" if math.isfinite(entry.aicc) else "   none"
            counted = counts.get(entry.same_as) != entry.parameters
            weight = f"{entry.weight:.3f}" if counted else f"({entry.weight:.3f})"
            line += f"{entry.parameters:11d}{above}{entry.bic - best['bic']:7.1f}{weight:>8}"
            words = [f"as {entry.same_as}" if entry.same_as else "", entry.doubt]
            lines.append("  ".join([line, *(word for word in words if word)]))
        lines += self.notes
        reasons: dict[str, list[str]] = {}
        for name, reason in self.refusals.items():
            reasons.setdefault(reason, []).append(name)
        lines += [f"not fitted: {', '.join(names)}: {why}" for why, names in reasons.items()]
        return "\n".join(lines)

    def to_dict(self) -> Json:
        """Return the ranking as plain values, the best model first."""
        values = {
            "ranked_by": self.criterion,
            "folds": self.folds,
            "seed": self.seed,
            "response": self.task.response,
            "left_out": self.leave_out,
            "poor": self.is_poor,
            "notes": self.notes,
        }
        return super().to_dict() | {name: to_plain(value) for name, value in values.items()}

    def _list_models(self) -> list[Json]:
        return [entry.to_dict() for entry in self.models]

    def list_columns(self) -> dict[str, list[object]]:
        """Return the columns of `to_frame`, a row for each model, the best first."""
        rows = [entry.to_dict() for entry in self.models]
        return list_columns(
            [
                {name: value for name, value in row.items() if not isinstance(value, (dict, tuple))}
                for row in rows
            ]
        )

    def _list_scores(self) -> Sequence[ModelScore]:
        return [entry.score for entry in self.models]


_FOLDS = 5
_FLOOR = 1e-9  # of the largest response: residuals below may be those of the solver
_EVALUATIONS = 50  # of the fit to a fold, which starts at that to all rows
_BETTER = 1e-3  # relative decrease of the sum of squares for which a fit begins anew
_SAME_CURVE = 1e-7  # of the largest response: curves that differ by less are the same


@dataclass(frozen=True, kw_only=True)
class RankOptions(Shown):
    """What is fitted of each model, and what the models are ranked by.

    Parameters
    ----------
    fields : tuple of str, optional
        Fields of the muscle to fit in each model that uses them, and end effects to fit in all. By
        default modulus and dead length in `EnergyMuscle`, modulus and end length in `ThesisMuscle`,
        the modulus in others. An unset braid angle or modulus is fitted in any case, and an unset
        inner radius held at a typical value unless it is named.
    criterion : str
        What to rank by: ``"aicc"``, ``"bic"``, or ``"cv"`` for the rows left out.
    leave_out : str
        What is left out of the fit at a time, for validation: ``"rows"``, dealt into folds at
        random; ``"specimen"``; or ``"pressure"``, a level of it. Nothing is fitted to what is left
        out: what each specimen has its own value of is, for one left out, as measured of it if
        that is in the table, else the mean of the others.
    folds : int, optional
        Of rows left out, parts that they are dealt into, at least 2; 0 for none. Rows that repeat a
        state stay together. 5 by default, or as many as there are states if fewer.
    jobs : int
        Models fitted at the same time, each by a process of its own.
    fit : FitOptions
        Response, end effects, what each specimen has its own value of, seed of the folds and
        starts, and the processor time that a model may take, 60 s by default; validation
        included. Its bounds and starts are not used.
    """

    fields: tuple[str, ...] | None = None
    criterion: Criterion = "aicc"
    leave_out: LeaveOut = "rows"
    folds: int | None = None
    jobs: int = 1
    fit: FitOptions = field(default_factory=lambda: FitOptions(budget=60.0))


DEFAULT_OPTIONS = RankOptions()
"""A ranking by AICc."""


def rank(
    data: Measurements | pandas.DataFrame,
    muscle: Muscle | None = None,
    *,
    models: Sequence[str] | Mapping[str, Callable[..., MuscleModel]] | None = None,
    refusals: Mapping[str, str] | None = None,
    options: RankOptions = DEFAULT_OPTIONS,
    progress: Progress = no_progress,
) -> Ranking:
    """Fit models to measurements as `calibrate` does, and rank them.

    Every model is fitted with what is unknown of it, see `calibrate`; a model without unknowns is
    taken as it is. So that models with many constants do not win by them alone, they are ranked by
    an information criterion or by the rows left out of the fit. A row that a model has no answer
    for counts with the span of the measured response, or the largest if that is more, so that no
    model wins by its gaps.

    Parameters
    ----------
    data : Measurements or DataFrame
    muscle : Muscle, optional
        The muscle measured: where its free fields start, and the values of the others; the preset
        ``effector-45`` by default.
    models : sequence of str or mapping of str to callable, optional
        Names in `MODELS`, or what makes each model, by the name to show: a class, or a
        ``functools.partial`` of it with the constants and laws that are known. All of `MODELS` by
        default.
    refusals : mapping of str to str, optional
        Models without an answer already before, and why.
    options : RankOptions
        What is fitted, and what to rank by.
    progress : Progress
        Called for each model.

    Returns
    -------
    Ranking
        Models that cannot be fitted are in `Ranking.refusals`: a law is missing, the model has no
        answer for any row, or it is another package's that is broken.

    Raises
    ------
    InputError
        If there is no model or one that is unknown, the criterion is unknown, the largest
        contraction is below 0.001 mm, there are fewer states than folds, or none is left out and
        the criterion is ``"cv"``.
    """
    criterion, seed = options.criterion, options.fit.seed
    muscle = preset("effector-45") if muscle is None else muscle
    check_muscle(muscle)
    names, kinds = _take_models(models)
    refused = dict(refusals or {})
    if not names and not refused:
        raise InputError("there are 0 models to rank: give 1 or more")
    check_word("criterion", criterion, CRITERIA)
    check_word("leave_out", options.leave_out, LEAVE_OUTS)
    check_integer("seed", seed, low=0)
    check_integer("jobs", options.jobs, low=1, high=64)
    task = options.fit.make_task(muscle, take_measurements(data, muscle=muscle))
    check_largest(task)
    folds = _choose_folds(task, options)
    if criterion == "cv" and not folds:
        if options.folds is None:
            raise InputError(
                "the rows are of 1 state: to rank by the rows left out there must be 2 or more "
                "different ones"
            )
        raise InputError(
            f"folds is {options.folds}: to rank by the rows left out it must be 2 or more"
        )
    entries, sound = [], {}
    for name in names:
        try:
            sound[name] = kinds[name]
        except PluginError as error:
            refused[name] = str(error)
    for name, found in _fit_all(sound, task, options, folds, progress):
        if isinstance(found, RankedModel):
            entries.append(found)
        else:
            refused[name] = found
    progress("fitted", 1.0)
    entries.sort(key=lambda entry: _order(entry, criterion))
    return Ranking(
        data=task.data,
        models=_finish(entries, task),
        refusals={name: refused[name] for name in (*(refusals or {}), *names) if name in refused},
        criterion=criterion,
        folds=len(folds),
        seed=seed,
        task=task,
        leave_out=options.leave_out,
    )


def _fit_all(
    kinds: Mapping[str, Callable[..., MuscleModel]],
    task: FitData,
    options: RankOptions,
    folds: Folds,
    progress: Progress,
) -> Iterator[tuple[str, RankedModel | str]]:
    """Yield each model as fitted, or why it is not; in processes if there are to be several."""
    alone = list(kinds)
    if options.jobs > 1:
        alone = [name for name in kinds if not _is_portable(kinds[name])]
        apart = [name for name in kinds if name not in alone]
        with open_processes(options.jobs, "rank") as pool:
            todo = {
                pool.submit(_try_model, name, kinds[name], task, options, folds): name
                for name in apart
            }
            for count, future in enumerate(as_completed(todo)):
                progress(f"fitted {todo[future]}", count / len(kinds))
                yield todo[future], future.result()
    for index, name in enumerate(alone, start=len(kinds) - len(alone)):
        progress(f"fitting {name}", index / len(kinds))
        yield name, _try_model(name, kinds[name], task, options, folds)


def _is_portable(kind: Callable[..., MuscleModel]) -> bool:
    """Whether another process can be given what makes a model."""
    try:
        pickle.dumps(kind)
    except Exception:  # pickle raises many kinds
        return False
    return True


def _try_model(
    name: str, kind: Callable[..., MuscleModel], task: FitData, options: RankOptions, folds: Folds
) -> RankedModel | str:
    """Return a model as fitted, or why it is not."""
    try:
        return _fit_model(name, kind, task, options, folds)
    except BozziniError as error:
        return str(error)


def _take_models(
    models: Sequence[str] | Mapping[str, Callable[..., MuscleModel]] | None,
) -> tuple[list[str], Mapping[str, Callable[..., MuscleModel]]]:
    """Return the names of the models to rank, and what makes them."""
    if models is None or models is MODELS:
        return [*MODELS], MODELS
    if isinstance(models, Mapping):
        for name, make in models.items():
            kind = make.func if isinstance(make, partial) else make
            if not callable(kind) or (isinstance(kind, type) and not issubclass(kind, MuscleModel)):
                raise InputError(
                    f"the model '{name}' is {show_value(make)}: it must be a class of muscle "
                    "models, or what makes one of a Muscle"
                )
        return [*models], models
    if isinstance(models, str) or not isinstance(models, Sequence):
        raise InputError(
            f"models is {show_value(models)}: it must be a sequence of names, or a mapping of them "
            "to classes"
        )
    for name in models:
        if not isinstance(name, str) or name not in MODELS:
            raise InputError(
                f"model is {show_value(name)}: it must be a name in bozzini.muscle.MODELS, such as "
                "'energy'"
            )
    return [*dict.fromkeys(models)], MODELS


def _choose_folds(task: FitData, options: RankOptions) -> Folds:
    """Return the rows left out in each turn; none without cross-validation."""
    folds = options.folds
    if folds is not None:
        check_integer("folds", folds, low=0)
        if folds == 1:
            raise InputError("folds is 1: it must be 2 or more, or 0 for no cross-validation")
    if options.leave_out != "rows":
        if folds is not None:
            raise InputError(
                f"folds is {folds}: it has no effect where a {options.leave_out} is left out"
            )
        split = split_specimens if options.leave_out == "specimen" else split_pressures
        return split(task)
    if folds is None:
        states = find_states(task)[0]
        folds = 0 if states < 2 else min(_FOLDS, states)
    return split_rows(task, folds=folds, seed=options.fit.seed) if folds else {}


def _fit_model(
    name: str, kind: Callable[..., MuscleModel], task: FitData, options: RankOptions, folds: Folds
) -> RankedModel:
    unused = list_unused(kind)
    wanted = name_default_fields(kind) if options.fields is None else options.fields
    wanted = tuple(field for field in wanted if field in END_FIELDS or field not in unused)
    task, unset = settle_unset(kind, task)
    wanted = tuple(dict.fromkeys((*wanted, *unset)))
    clock = Clock(options.fit.budget)
    unknowns = choose_unknowns(kind, task, fields=wanted)
    task = replace(
        task,
        muscle=task.muscle.fill(unknowns.free),
        each=tuple(each for each in task.each if each in unknowns.free),
    )
    found: Calibration | None = None
    if unknowns.free:
        how = replace(options.fit, bounds={}, start={}, force=True, each=task.each)
        found = fit_task(unknowns.build, task, free=unknowns.free, options=how, clock=clock)
    validation, better = _validate(unknowns, found, task, folds, clock)
    if found is not None and better is not None:  # the fit to all rows was caught on its way
        again = _refit(unknowns, better, task, clock)
        if again.squares < found.squares:
            found = again
            validation, _ = _validate(unknowns, found, task, folds, clock)
    errors: NDArray[np.float64] | None = None
    if found is None:
        model = task.ends.mount(unknowns.build(task.muscle))
        answers = predict_parts(task, lambda part: _build_known(unknowns, task, part))
        if not answers[1].any():
            raise InputError(explain_gap(model, task.data, task.response))
        errors = _make_problem(unknowns, task, {}, clock).compare({})[2]
    else:
        model = found.fitted
        answers = task.measured - found.residuals, found.answered
    count = 0 if found is None else len(found.free)
    score = score_model(name, answers, task, fitted=count)
    least, scatter = (
        _FLOOR * float(np.abs(task.measured).max()),
        0.0 if found is None else found.scatter,
    )
    squares = len(task.data) * max(score.rmse, least) ** 2
    if found is not None and task.response_errors is not None:
        squares = max(found.squares, squares * 1e-300)
    elif errors is not None:
        miss = np.where(answers[1], answers[0] - task.measured, task.worst) / errors
        squares = max(float(miss @ miss), squares * 1e-300)
        scatter = float(np.mean(2.0 * np.log(errors)))
    more, rows = len(task.data) * scatter, len(task.data)
    return RankedModel(
        score=score,
        model=model,
        calibration=found,
        held=unknowns.held,
        parameters=count,
        aicc=compute_aicc(squares, rows, count) + more if rows >= count + 3 else math.inf,
        bic=compute_bic(squares, rows, count) + more,
        weight=0.0,
        validation=validation,
    )


def _build_known(unknowns: Unknowns, task: FitData, part: SpecimenRows) -> MuscleModel:
    """Return the model of a part where nothing is fitted."""
    return assemble(unknowns.build, part.muscle, {}, task=task, anchor=part.anchor)


def _make_problem(
    unknowns: Unknowns, task: FitData, start: Mapping[str, float], clock: Clock
) -> Problem:
    """Return a fit that starts from values of the unknowns, or their means over specimens."""
    constants = {
        name: float(np.mean([x for label, x in start.items() if _is_of(label, name)]))
        for name in unknowns.start
    }
    return Problem(
        model_class=unknowns.build,
        task=task,
        free=unknowns.free,
        limits=choose_bounds(unknowns.free, task, {}, list_own(unknowns.build)),
        constants=constants,
        starts=start,
        clock=clock,
    )


def _is_of(label: str, name: str) -> bool:
    """Whether an unknown is a parameter, or a specimen's value of it."""
    return label == name or label.startswith(f"{name}[")


def _refit(
    unknowns: Unknowns, start: Mapping[str, float], task: FitData, clock: Clock
) -> Calibration:
    """Return the fit to all rows from a start alone."""
    problem = _make_problem(unknowns, task, start, clock)
    found = release(find_minimum(problem, problem.choose_start()), problem)
    return conclude(problem, found, held={}, options=FitOptions(force=True))


def _validate(
    unknowns: Unknowns, found: Calibration | None, task: FitData, folds: Folds, clock: Clock
) -> tuple[CrossValidation | None, dict[str, float] | None]:
    """Return the error of the rows left out, and a better start for the fit to all rows if any.

    The fit to each part starts from that to all rows. If it ends nearer to all rows than that,
    which is a minimum at best, there is a better one.
    """
    if not folds:
        return None, None
    if found is None:
        return (
            cross_validate(
                lambda _: (lambda p: _build_known(unknowns, task, p), True), task, folds
            ),
            None,
        )
    estimates, whole = found.estimates, _make_problem(unknowns, task, found.estimates, clock)
    least = (1.0 - _BETTER) * found.squares
    better: list[tuple[float, dict[str, float]]] = []

    def fit(rows: FitData) -> tuple[Callable[[SpecimenRows], MuscleModel], bool]:
        if clock.is_over:
            raise OutOfTimeError(f"stopped: the time of {clock.limit:g} s is used up")
        problem = _make_problem(unknowns, rows, estimates, clock)
        again = find_minimum(problem, problem.choose_start(), limit=_EVALUATIONS)
        again = release(again, problem)
        values = problem.name_values(again.point)
        if problem.unknowns == whole.unknowns:
            cost = whole.measure_cost(np.array(list(values.values())) / whole.scales)
            if cost < least:
                better.append((cost, values))

        def build(part: SpecimenRows) -> MuscleModel:
            own = _choose_values(problem, values, part)
            return assemble(unknowns.build, part.muscle, own, task=rows, anchor=part.anchor)

        return build, again.converged

    validation = cross_validate(fit, task, folds)
    return validation, min(better, key=lambda each: each[0])[1] if better else None


def _choose_values(
    problem: Problem, values: Mapping[str, float], part: SpecimenRows
) -> dict[str, float]:
    """Return the parameters of a specimen, also of one that was not in the fit.

    What each specimen has its own value of is then as measured of it, else the mean of the others.
    """
    own = {}
    for name in problem.free:
        label = label_unknown(name, part.specimen)
        if name in values:
            own[name] = values[name]
        elif label in values:
            own[name] = values[label]
        elif name not in problem.task.data.geometry:
            own[name] = float(np.mean([x for key, x in values.items() if _is_of(key, name)]))
    return own


def _order(entry: RankedModel, criterion: Criterion) -> tuple[float, float, int, float]:
    """Return the key to sort by.

    Those without a value come last, by BIC, which all have. Equal but for round-off, the fewer
    parameters come first, then the smaller error.
    """
    value = entry.validation_error if criterion == "cv" else getattr(entry, criterion)
    known = math.isfinite(value)
    return (
        round(value, 6) if known else math.inf,
        0.0 if known else round(entry.bic, 6),
        entry.parameters,
        entry.score.rmse,
    )


def _finish(entries: list[RankedModel], task: FitData) -> tuple[RankedModel, ...]:
    """Put in which models have the same curve, and the weights."""
    least = _SAME_CURVE * float(np.abs(task.measured).max())
    done: list[RankedModel] = []
    for entry in entries:
        same = ""
        for other in done:
            apart = np.abs(other.score.predicted - entry.score.predicted).max()
            alike = np.array_equal(other.score.answered, entry.score.answered)
            if not other.same_as and alike and apart <= least:
                same = other.name
                break
        done.append(replace(entry, same_as=same))
    weighed = {entry.name: entry.aicc for entry in done
               if math.isfinite(entry.aicc) and not _find_twin(entry, done)}  # fmt: skip
    if not weighed:
        return tuple(done)
    weights = dict(zip(weighed, weigh_models(list(weighed.values())).tolist(), strict=True))
    return tuple(
        replace(entry, weight=weights.get(_find_twin(entry, done) or entry.name, 0.0))
        for entry in done
    )


def _find_twin(entry: RankedModel, others: Sequence[RankedModel]) -> str:
    """Return the name of a model with the same curve and as many constants, or none."""
    names = (other.name for other in others if other.parameters == entry.parameters)
    return entry.same_as if entry.same_as in names else ""
