"""Compare models on measurements, fit them all, and rank them."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_integer, check_number, check_word, show_value
from ..errors import BozziniError, InputError
from ..progress import Progress, no_progress
from ..results import Json, Result, take_axes, to_plain
from .data import Measurements
from .design import Muscle, check_muscle, preset
from .fit import Calibration, FitOptions, calibrate, find_minimum
from .model import MuscleModel
from .models import MODELS
from .problem import (
    Problem,
    Unknowns,
    choose_bounds,
    choose_unknowns,
    list_own,
    list_unused,
    predict_contraction,
)
from .table import take_measurements

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

_LEAST_CONTRACTION_MM = 1e-3  # largest contraction that errors can be a percentage of [mm]


Criterion = Literal["aicc", "bic", "cv"]
CRITERIA: tuple[Criterion, ...] = get_args(Criterion)
"""What models can be ranked by."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelScore:
    """How near one model comes to the measurements.

    Parameters
    ----------
    name : str
    standard_error : float
        ``sqrt(sum(r^2) / (n - k))`` with k parameters fitted to these very data [mm].
    standard_error_percent : float
        The same as a percentage of the largest measured contraction: the thesis's measure
        (section 3.3.4), which does not define its standard error further.
    rmse : float
        ``sqrt(mean(r^2))`` [mm].
    bias : float
        Mean of model less measurement [mm].
    largest : float
        Largest difference, without sign [mm].
    predicted : ndarray, shape (n,)
        Contraction of the model at each row [mm].
    """

    name: str
    standard_error: float
    standard_error_percent: float
    rmse: float
    bias: float
    largest: float
    predicted: NDArray[np.float64]

    def to_dict(self) -> Json:
        """Return the score as plain values, with units in the names."""
        return {
            "model": self.name,
            "standard_error_mm": self.standard_error,
            "standard_error_percent": self.standard_error_percent,
            "rmse_mm": self.rmse,
            "bias_mm": self.bias,
            "largest_error_mm": self.largest,
        }

    def format_row(self, wide: int) -> str:
        """Return the score as a row of a table whose first column is so wide."""
        return (
            f"{self.name:<{wide}}  {self.standard_error:6.3f} mm"
            f"{self.standard_error_percent:5.1f} %{self.rmse:7.3f} mm"
            f"{self.bias:+7.3f} mm{self.largest:7.3f} mm"
        )


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
        """Smallest root mean square of all models [mm]; infinite without any."""
        return min((score.rmse for score in self._list_scores()), default=math.inf)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the models' root mean squares as bars, the best first, and return the axes."""
        axes, scores = take_axes(ax, x="root mean square error [mm]", y=""), self._list_scores()
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
        Models that have no answer for some row, and why.
    """

    data: Measurements
    scores: tuple[ModelScore, ...]
    refusals: dict[str, str]

    def format_table(self) -> str:
        """Return the scores as a table of text."""
        wide = max([5, *(len(score.name) for score in self.scores)])
        lines = [f"{'model':<{wide}}  standard error      RMSE      bias   largest"]
        lines += [score.format_row(wide) for score in self.scores]
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
) -> Comparison:
    """Compare the contractions of models with the measured ones.

    Parameters
    ----------
    models : mapping of str to MuscleModel
        The models by the name to show.
    data : Measurements
    fitted : mapping of str to int, optional
        How many parameters of a model were fitted to these data; 0 by default.
    refusals : mapping of str to str, optional
        Models without an answer already before, in their calibration for example, and why.

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
    check_largest(data)
    scores = []
    for name, model in models.items():
        count = check_integer(
            f"number of parameters fitted in {name}", counts.get(name, 0), low=0, high=len(data) - 1
        )
        try:
            predicted = predict_contraction(model, data)
        except BozziniError as error:
            refused[name] = str(error)
            continue
        scores.append(score_model(name, predicted, data, fitted=count))
    scores.sort(key=lambda score: score.standard_error)
    return Comparison(data=data, scores=tuple(scores), refusals=refused)


def check_largest(data: Measurements) -> None:
    """Raise `InputError` if the largest contraction is below a micrometre."""
    if not data.largest_contraction >= _LEAST_CONTRACTION_MM:
        raise InputError(
            f"the largest contraction is {data.largest_contraction:g} mm: it must be "
            f"{_LEAST_CONTRACTION_MM:g} mm or more, since errors are percentages of it"
        )


def score_model(
    name: str, predicted: NDArray[np.float64], data: Measurements, *, fitted: int
) -> ModelScore:
    """Return how near predicted contractions [mm] of shape (n,) come to the measured ones."""
    error = predicted - data.contraction
    squares = float(error @ error)
    standard = float(np.sqrt(squares / (len(data) - fitted)))
    return ModelScore(
        name=name,
        standard_error=standard,
        standard_error_percent=100.0 * standard / data.largest_contraction,
        rmse=float(np.sqrt(squares / len(data))),
        bias=float(error.mean()),
        largest=float(np.abs(error).max()),
        predicted=predicted,
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
    """Deal the rows into folds at random; rows that repeat a state stay in one."""
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
    """Return the error at rows left out, each part in turn."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class RankedModel:
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
        """Root mean square of the rows left out [mm]; infinite where it could not be had."""
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
            "left_out_mm": self.validation_error,
            "left_out_reason": "" if left_out is None else left_out.reason,
            "left_out_not_converged": 0 if left_out is None else left_out.unsettled,
            "same_as": self.same_as,
            "held": self.held,
            **fit,
        }

    @property
    def doubt(self) -> str:
        """Which fits did not converge, in words; empty if all did."""
        words = []
        if self.calibration is not None and not self.calibration.converged:
            words.append("not converged")
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
    """

    data: Measurements
    models: tuple[RankedModel, ...]
    refusals: dict[str, str]
    criterion: Criterion
    folds: int
    seed: int

    @property
    def notes(self) -> tuple[str, ...]:
        """Which models lack a criterion, and why; empty if none does."""
        lines = []
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
                line += f"{error:7.3f} mm" if math.isfinite(error) else f"{'none':>10}"
            above = f"{entry.aicc - best['aicc']:7.1f}" if math.isfinite(entry.aicc) else "   none"
            counted = counts.get(entry.same_as) != entry.parameters
            weight = f"{entry.weight:.3f}" if counted else f"({entry.weight:.3f})"
            line += f"{entry.parameters:11d}{above}{entry.bic - best['bic']:7.1f}{weight:>8}"
            words = [f"as {entry.same_as}" if entry.same_as else "", entry.doubt]
            lines.append("  ".join([line, *(word for word in words if word)]))
        lines += self.notes
        lines += [f"{name}: not fitted: {reason}" for name, reason in self.refusals.items()]
        return "\n".join(lines)

    def to_dict(self) -> Json:
        """Return the ranking as plain values, the best model first."""
        values = {
            "ranked_by": self.criterion,
            "folds": self.folds,
            "seed": self.seed,
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
_FLOOR = 1e-9  # of the largest contraction: residuals below may be those of the solver
_EVALUATIONS = 50  # of the fit to a fold, which starts at that to all rows
_BETTER = 1e-3  # relative decrease of the sum of squares for which a fit begins anew
_SAME_CURVE = 1e-7  # of the largest contraction: curves that differ by less are the same


@dataclass(frozen=True, kw_only=True)
class RankOptions:
    """What is fitted of each model, and what the models are ranked by.

    Parameters
    ----------
    fields : tuple of str, optional
        Fields of the muscle to fit in each model that uses them. By default modulus and dead
        length in `EnergyMuscle`, modulus and end length in `ThesisMuscle`, the modulus in others.
    criterion : str
        What to rank by: ``"aicc"``, ``"bic"``, or ``"cv"`` for the rows left out.
    folds : int, optional
        Parts that the rows are dealt into for cross-validation, at least 2; 0 for none. Rows that
        repeat a state stay together. 5 by default, or as many as there are states if fewer.
    seed : int
        Of the folds, and of the starts of the fits.
    """

    fields: tuple[str, ...] | None = None
    criterion: Criterion = "aicc"
    folds: int | None = None
    seed: int = 0


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
    an information criterion or by the rows left out of the fit.

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
        answer for a row, or it is another package's that is broken.

    Raises
    ------
    InputError
        If there is no model or one that is unknown, the criterion is unknown, the largest
        contraction is below 0.001 mm, there are fewer states than folds, or none is left out and
        the criterion is ``"cv"``.
    """
    criterion, folds, seed = options.criterion, options.folds, options.seed
    muscle = preset("effector-45") if muscle is None else muscle
    check_muscle(muscle)
    data = take_measurements(data, muscle=muscle)
    names, kinds = _take_models(models)
    refused = dict(refusals or {})
    if not names and not refused:
        raise InputError("there are 0 models to rank: give 1 or more")
    check_word("criterion", criterion, CRITERIA)
    seed = check_integer("seed", seed, low=0)
    check_largest(data)
    parts = _choose_parts(data, folds, seed)
    if criterion == "cv" and not parts:
        if folds is None:
            raise InputError(
                "the rows are of 1 state: to rank by the rows left out there must be 2 or more "
                "different ones"
            )
        raise InputError(f"folds is {folds}: to rank by the rows left out it must be 2 or more")
    entries = []
    for index, name in enumerate(names):
        progress(f"fitting {name}", index / len(names))
        try:
            entries.append(_fit_model(name, kinds[name], muscle, data, options, parts))
        except BozziniError as error:
            refused[name] = str(error)
    progress("fitted", 1.0)
    entries.sort(key=lambda entry: _order(entry, criterion))
    return Ranking(
        data=data,
        models=_finish(entries, data),
        refusals=refused,
        criterion=criterion,
        folds=len(parts),
        seed=seed,
    )


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


def _choose_parts(
    data: Measurements, folds: int | None, seed: int
) -> tuple[NDArray[np.bool_], ...]:
    """Return the rows left out in each turn; none without cross-validation."""
    if folds is None:
        states = count_states(data)
        folds = 0 if states < 2 else min(_FOLDS, states)
    check_integer("folds", folds, low=0)
    if folds == 1:
        raise InputError("folds is 1: it must be 2 or more, or 0 for no cross-validation")
    return split_rows(data, folds=folds, seed=seed) if folds else ()


def _fit_model(
    name: str,
    kind: Callable[..., MuscleModel],
    muscle: Muscle,
    data: Measurements,
    options: RankOptions,
    parts: tuple[NDArray[np.bool_], ...],
) -> RankedModel:
    wanted = options.fields
    if wanted is not None:
        wanted = tuple(field for field in wanted if field not in list_unused(kind))
    unknowns = choose_unknowns(kind, muscle, data, fields=wanted)
    count = len(unknowns.free)
    found: Calibration | None = None
    if count:
        found = calibrate(
            unknowns.build,
            muscle,
            data=data,
            free=unknowns.free,
            options=FitOptions(force=True, seed=options.seed),
        )
    validation, better = _validate(unknowns, found, muscle, data, parts)
    if found is not None and better is not None:  # the fit to all rows was caught on its way
        again = _refit(unknowns, better, muscle, data)
        if again.sigma < found.sigma:
            found = again
            validation, _ = _validate(unknowns, found, muscle, data, parts)
    model = unknowns.build(muscle) if found is None else found.fitted
    score = score_model(name, predict_contraction(model, data), data, fitted=count)
    least = _FLOOR * data.largest_contraction
    squares = len(data) * max(score.rmse, least) ** 2
    return RankedModel(
        score=score,
        model=model,
        calibration=found,
        held=unknowns.held,
        parameters=count,
        aicc=compute_aicc(squares, len(data), count) if len(data) >= count + 3 else math.inf,
        bic=compute_bic(squares, len(data), count),
        weight=0.0,
        validation=validation,
    )


def _refit(
    unknowns: Unknowns, start: Mapping[str, float], muscle: Muscle, data: Measurements
) -> Calibration:
    """Return the fit to all rows from a start alone."""
    limits = choose_bounds(unknowns.free, muscle, {}, list_own(unknowns.build))
    return calibrate(
        unknowns.build,
        muscle.replace(**{name: start[name] for name in unknowns.fields}),
        data=data,
        free=unknowns.free,
        options=FitOptions(
            bounds={
                name: (low, high) for name, (low, high) in zip(unknowns.free, limits, strict=True)
            },
            start={name: start[name] for name in unknowns.start},
            force=True,
        ),
    )


def _validate(
    unknowns: Unknowns,
    found: Calibration | None,
    muscle: Muscle,
    data: Measurements,
    parts: tuple[NDArray[np.bool_], ...],
) -> tuple[CrossValidation | None, dict[str, float] | None]:
    """Return the error of the rows left out, and a better start for the fit to all rows if any.

    The fit to each part starts from that to all rows. If it ends nearer to all rows than that,
    which is a minimum at best, there is a better one.
    """
    if not parts:
        return None, None
    if found is None:
        model = unknowns.build(muscle)
        return cross_validate(lambda rows: (model, True), data, parts), None
    limits = choose_bounds(found.free, muscle, {}, list_own(unknowns.build))
    constants = {name: found.estimates[name] for name in unknowns.start}
    least = (1.0 - _BETTER) * float(found.residuals @ found.residuals)
    better: list[tuple[float, dict[str, float]]] = []

    def fit(rows: Measurements) -> tuple[MuscleModel, bool]:
        problem = Problem(
            model_class=unknowns.build,
            muscle=found.muscle,
            free=found.free,
            data=rows,
            limits=limits,
            constants=constants,
        )
        again = find_minimum(problem, problem.choose_start(), limit=_EVALUATIONS)
        miss, held = replace(problem, data=data).evaluate(again.x)
        values = problem.name_values(again.x)
        if held.all() and miss @ miss < least:
            better.append((float(miss @ miss), values))
        return problem.build(values), again.status > 0

    validation = cross_validate(fit, data, parts)
    return validation, min(better, key=lambda each: each[0])[1] if better else None


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


def _finish(entries: list[RankedModel], data: Measurements) -> tuple[RankedModel, ...]:
    """Put in which models have the same curve, and the weights."""
    least = _SAME_CURVE * data.largest_contraction
    done: list[RankedModel] = []
    for entry in entries:
        same = ""
        for other in done:
            apart = np.abs(other.score.predicted - entry.score.predicted).max()
            if not other.same_as and apart <= least:
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
