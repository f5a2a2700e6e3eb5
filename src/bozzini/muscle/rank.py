"""Fit all models that can be fitted to one set of measurements, and rank them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer
from ..errors import BozziniError, InputError
from ..progress import Progress, no_progress
from ._constants import Unknowns, choose_unknowns, list_own
from ._fit import Problem
from ._folds import CrossValidation, count_states, cross_validate, split_rows
from ._predict import predict_contraction
from ._search import find_minimum
from ._unknowns import choose_bounds
from .calibration import Calibration, calibrate
from .compare import check_largest, score_model
from .dataset import Measurements
from .information import compute_aicc, compute_bic, weigh_models
from .models import CATALOGUE, MODELS
from .rank_result import RankedModel, Ranking

if TYPE_CHECKING:
    from .design import Muscle
    from .model import MuscleModel

__all__ = ["CRITERIA", "RankedModel", "Ranking", "rank_models"]

CRITERIA = ("aicc", "bic", "cv")
"""What models can be ranked by."""

_FOLDS = 5
_FLOOR = 1e-9  # of the largest contraction: residuals below may be those of the solver
_EVALUATIONS = 50  # of the fit to a fold, which starts at that to all rows
_BETTER = 1e-3  # relative decrease of the sum of squares for which a fit begins anew
_SAME = 1e-7  # of the largest contraction: curves that differ by less are the same


def rank_models(
    muscle: Muscle,
    data: Measurements,
    *,
    models: Mapping[str, Callable[..., MuscleModel]] | None = None,
    fields: tuple[str, ...] | None = None,
    refusals: Mapping[str, str] | None = None,
    criterion: str = "aicc",
    folds: int | None = None,
    seed: int = 0,
    progress: Progress = no_progress,
) -> Ranking:
    """Fit models to measurements as `calibrate` does, and rank them.

    Every model is fitted with what is unknown of it, see `calibrate`; a model without unknowns is
    taken as it is. So that models with many constants do not win by them alone, they are ranked by
    an information criterion or by the rows left out of the fit.

    Parameters
    ----------
    muscle : Muscle
        The muscle measured: where its free fields start, and the values of the others.
    data : Measurements
    models : mapping of str to callable, optional
        What makes each model, by the name to show: a class, or a ``functools.partial`` of it with
        the constants and laws that are known. All of `MODELS` and `CATALOGUE` by default.
    fields : tuple of str, optional
        Fields of the muscle to fit in each model that uses them. By default modulus and dead
        length in `EnergyMuscle`, modulus and end length in `ThesisMuscle`, the modulus in others.
    refusals : mapping of str to str, optional
        Models that gave up before, and why.
    criterion : str
        What to rank by: ``"aicc"``, ``"bic"``, or ``"cv"`` for the rows left out.
    folds : int, optional
        Parts that the rows are dealt into for cross-validation, at least 2; 0 for none. Rows that
        repeat a state stay together. 5 by default, or as many as there are states if fewer.
    seed : int
        Of the folds, and of the starts of the fits.
    progress : Progress
        Told of each model.

    Returns
    -------
    Ranking
        Models that cannot be fitted are in `Ranking.refusals`: a law is missing, or the model has
        no answer for a row.

    Raises
    ------
    InputError
        If there is no model, the criterion is unknown, the largest contraction is below 0.001 mm,
        there are fewer states than folds, or none is left out and the criterion is ``"cv"``.
    """
    kinds: Mapping[str, Callable[..., MuscleModel]] = (
        {**MODELS, **CATALOGUE} if models is None else models
    )
    refused = dict(refusals or {})
    if not kinds and not refused:
        raise InputError("there are 0 models to rank: give 1 or more")
    if criterion not in CRITERIA:
        raise InputError(f"criterion is {criterion!r}: it must be one of {', '.join(CRITERIA)}")
    check_integer("seed", seed, low=0)
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
    for index, (name, kind) in enumerate(kinds.items()):
        progress(f"fitting {name}", index / len(kinds))
        try:
            entries.append(_fit_model(name, kind, muscle, data, fields, parts, seed))
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
    fields: tuple[str, ...] | None,
    parts: tuple[NDArray[np.bool_], ...],
    seed: int,
) -> RankedModel:
    wanted = fields
    if fields is not None:
        unused: Any = getattr(getattr(kind, "func", kind), "unused", ())
        wanted = tuple(field for field in fields if field not in unused)
    unknowns = choose_unknowns(kind, muscle, data, fields=wanted)
    count = len(unknowns.free)
    found: Calibration | None = None
    if count:
        found = calibrate(unknowns.build, muscle, data, free=unknowns.free, force=True, seed=seed)
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
        data,
        free=unknowns.free,
        bounds={name: (low, high) for name, (low, high) in zip(unknowns.free, limits, strict=True)},
        start={name: start[name] for name in unknowns.start},
        force=True,
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


def _order(entry: RankedModel, criterion: str) -> tuple[float, float, int, float]:
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
    least = _SAME * data.largest_contraction
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
