"""Compare models on one set of measurements: standard error, RMSE, bias."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer
from ..errors import BozziniError, InputError
from ._predict import predict_contraction
from .dataset import Measurements

if TYPE_CHECKING:
    from .model import MuscleModel

_SMALLEST = 1e-3  # largest contraction that errors can be a percentage of [mm]

__all__ = ["Comparison", "ModelScore", "check_largest", "compare_models", "score_model"]


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
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
        lines += [
            f"{score.name:<{wide}}  {score.standard_error:6.3f} mm"
            f"{score.standard_error_percent:5.1f} %{score.rmse:7.3f} mm"
            f"{score.bias:+7.3f} mm{score.largest:7.3f} mm"
            for score in self.scores
        ]
        lines += [f"{name}: no answer: {reason}" for name, reason in self.refusals.items()]
        return "\n".join(lines)


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
        Models that gave up before, in their calibration for example, and why.

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
    if not data.largest_contraction >= _SMALLEST:
        raise InputError(
            f"the largest contraction is {data.largest_contraction:g} mm: it must be "
            f"{_SMALLEST:g} mm or more, since errors are percentages of it"
        )


def score_model(
    name: str, predicted: NDArray[np.float64], data: Measurements, *, fitted: int
) -> ModelScore:
    """Return how near predicted contractions [mm] of shape (n,) come to the measured ones.

    Parameters
    ----------
    name : str
        Name of the model.
    predicted : ndarray, shape (n,)
    data : Measurements
    fitted : int
        How many parameters were fitted to these data, less than n.
    """
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
