"""Fit the parameters of a muscle model to measurements, and say what the data do not tell.

Bounded least squares in contraction. Which parameters can be told apart from which data is in
`bozzini.muscle.identify`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ._fit import PARAMETER_UNITS, Problem, choose_bounds, predict_contraction
from ._search import EVALUATIONS, find_minimum
from .dataset import Measurements
from .identify import judge_fit, judge_parameters, judge_repeats

if TYPE_CHECKING:
    from .design import Muscle
    from .model import MuscleModel

__all__ = ["Calibration", "calibrate"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """What a fit found, and how far it can be trusted.

    Parameters
    ----------
    model : str
        Name of the model.
    free : tuple of str
        The parameters that were fitted, the order of `correlations`.
    estimates : dict
        Their values, in mm, MPa, rad.
    standard_errors : dict
        Standard deviations of the estimates, linearised.
    intervals : dict
        95 % confidence intervals, linearised, with Student's t. They hold if the model is right
        and the errors of the rows are alike and independent. They are not cut at bounds.
    correlations : ndarray, shape (k, k)
    condition : float
        Condition number of the Jacobian with columns of length 1.
    sigma : float
        Standard deviation of a row about the fit, ``sqrt(sum(r^2) / (n - k))`` [mm].
    residuals : ndarray, shape (n,)
        Measured less fitted contraction [mm].
    muscle : Muscle
        The muscle with the estimates in it.
    warnings : tuple of str
        What the estimates suffer from; empty if nothing was found.
    converged : bool
        Whether the fit ended at a minimum.
    reason : str
        Why the fit ended.
    evaluations : int
        How often the model was evaluated.
    """

    model: str
    free: tuple[str, ...]
    estimates: dict[str, float]
    standard_errors: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    correlations: NDArray[np.float64]
    condition: float
    sigma: float
    residuals: NDArray[np.float64]
    muscle: Muscle
    warnings: tuple[str, ...]
    converged: bool
    reason: str
    evaluations: int

    @property
    def trusted(self) -> bool:
        """Whether the fit converged and nothing speaks against its estimates."""
        return self.converged and not self.warnings


def calibrate(
    model_class: Callable[[Muscle], MuscleModel],
    muscle: Muscle,
    data: Measurements,
    *,
    free: Sequence[str] = ("modulus", "dead_length"),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    force: bool = False,
) -> Calibration:
    """Fit parameters of a muscle so that the model's contraction meets the measured one.

    The default pair is well told by one curve of contraction over pressure. Free the gap only
    with rows at low pressure, the braid angle only with rows under load or blocked, and the
    friction length only with both directions.

    Parameters
    ----------
    model_class : callable
        Makes the model from a `Muscle`: `EnergyMuscle`, `ThesisMuscle`, or for example
        ``functools.partial(EnergyMuscle, ends="trellis")``.
    muscle : Muscle
        Where the fit starts, and the values of all that is not free.
    data : Measurements
    free : sequence of str
        Fields of `Muscle` to fit.
    bounds : mapping, optional
        ``(low, high)`` of a free parameter; there are wide ones by default.
    force : bool
        Fit also what the data cannot tell; the warnings then say so.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        If a parameter is unknown or has no effect, if there are too few rows, if the data cannot
        tell the parameters apart (unless `force`), or if the model has no answer for a row at
        the start.
    """
    names = _check_free(free, data)
    never, _ = judge_parameters(names, data)
    if never and not force:
        raise InputError("; ".join(never))
    limits = choose_bounds(names, muscle, {} if bounds is None else bounds)
    widest = limits[names.index("braid_angle"), 1] if "braid_angle" in names else None
    data.check_lengths(muscle, braid_angle=widest)
    problem = Problem(model_class=model_class, muscle=muscle, free=names, data=data, limits=limits)
    predict_contraction(model_class(muscle), data)  # one clear line, if it cannot hold a row
    start = problem.choose_start()
    _check_effect(names, problem.slope(start))
    found = find_minimum(problem, start)
    fitted = muscle.replace(**problem.name_values(found.x))
    contact = float(model_class(fitted).dead_band()) if "gap" in names else 0.0
    never, doubts = judge_parameters(names, data, contact_pressure=contact)
    at_bound = [
        f"{name} is at its bound, where its interval does not hold"
        for name, active in zip(names, found.active_mask, strict=True)
        if active
    ]
    answered = bool(problem.evaluate(found.x)[1].all())
    return _conclude(
        problem,
        found,
        warnings=[*never, *doubts, *at_bound],
        converged=bool(found.status > 0 and answered),
        reason=_tell_reason(found.status, answered=answered),
        muscle=fitted,
    )


def _check_free(free: Sequence[str], data: Measurements) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(free))
    if not names:
        raise InputError("no parameter is free: name one or more")
    for name in names:
        if name not in PARAMETER_UNITS:
            raise InputError(f"parameter '{name}' is not known: use {', '.join(PARAMETER_UNITS)}")
    if len(data) <= len(names):
        raise InputError(
            f"{len(data)} row(s) are too few for {len(names)} parameter(s): "
            f"there must be {len(names) + 1} or more"
        )
    return names


def _check_effect(free: Sequence[str], jacobian: NDArray[np.float64]) -> None:
    for name, column in zip(free, np.asarray(jacobian).T, strict=True):
        if not np.abs(column).max() > 1e-9:
            raise InputError(
                f"{name} has no effect on the contraction at these rows: it cannot be fitted"
            )


def _tell_reason(status: int, *, answered: bool) -> str:
    if not answered:
        return "the model has no answer for some rows"
    if status <= 0:
        return f"no minimum within {EVALUATIONS} evaluations"
    reasons = {1: "the gradient vanished", 2: "the sum of squares settled"}
    return reasons.get(status, "the parameters settled")


def _conclude(
    problem: Problem,
    found: Any,
    *,
    warnings: list[str],
    converged: bool,
    reason: str,
    muscle: Muscle,
) -> Calibration:
    """Put the statistics together from the residuals and the Jacobian at the minimum."""
    from scipy.stats import t as student

    free, residuals = problem.free, -np.asarray(found.fun)
    freedom = len(residuals) - len(free)
    sigma = float(np.sqrt(residuals @ residuals / freedom))
    jacobian = np.asarray(found.jac) / problem.scales
    # Huge, not infinite, where all is lost.
    length = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12)
    _, singular, basis = np.linalg.svd(jacobian / length, full_matrices=False)
    singular = np.maximum(singular, 1e-12)
    inverse = (basis.T / singular**2) @ basis
    spread = np.sqrt(np.diag(inverse))
    correlations = np.clip(inverse / np.outer(spread, spread), -1.0, 1.0)
    errors = dict(zip(free, (sigma * spread / length).tolist(), strict=True))
    factor = float(student.ppf(0.975, freedom))
    estimates = problem.name_values(found.x)
    condition = float(singular[0] / singular[-1])
    return Calibration(
        model=problem.model_class(muscle).name,
        free=free,
        estimates=estimates,
        standard_errors=errors,
        intervals={
            name: (value - factor * errors[name], value + factor * errors[name])
            for name, value in estimates.items()
        },
        correlations=correlations,
        condition=condition,
        sigma=sigma,
        residuals=residuals,
        muscle=muscle,
        warnings=(
            *warnings,
            *judge_fit(free, correlations, condition),
            *judge_repeats(problem.data, residuals, parameters=len(free)),
        ),
        converged=converged,
        reason=reason,
        evaluations=int(found.nfev),
    )
