"""Fit the parameters of a muscle model to measurements, and say what the data do not tell.

Bounded least squares in contraction, of fields of the muscle and of a model's own constants. Which
parameters can be told apart from which data is in `bozzini.muscle.identify`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ._begin import choose_constants, choose_free
from ._constants import list_own
from ._fit import Problem
from ._predict import predict_contraction
from ._search import EVALUATIONS, find_constants, find_minimum
from ._start import find_starts
from ._unknowns import choose_bounds
from .dataset import Measurements
from .identify import judge_fit, judge_parameters, judge_repeats

if TYPE_CHECKING:
    from .design import Muscle
    from .model import MuscleModel
    from .models.card import Parameter

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
        Their values, in mm, MPa, rad, or the unit on the model's card.
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
    fitted : MuscleModel
        The model of that muscle, with the estimates of its own constants.
    held : dict
        Constants that were not fitted although nobody knows them, and why.
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
    fitted: MuscleModel
    held: dict[str, str]
    warnings: tuple[str, ...]
    converged: bool
    reason: str
    evaluations: int

    @property
    def trusted(self) -> bool:
        """Whether the fit converged and nothing speaks against its estimates."""
        return self.converged and not self.warnings


def calibrate(
    model_class: Callable[..., MuscleModel],
    muscle: Muscle,
    data: Measurements,
    *,
    free: Sequence[str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    start: Mapping[str, float] | None = None,
    force: bool = False,
    seed: int = 0,
) -> Calibration:
    """Fit parameters of a muscle so that the model's contraction meets the measured one.

    The default pair of `EnergyMuscle`, modulus and dead length, is well told by one curve of
    contraction over pressure. Free the gap only with rows at low pressure, the braid angle only
    with rows under load or blocked, and the friction length only with both directions.

    A model of the catalogue has constants of its own. By default those are free that its source
    fitted or that it must be given and has not got, as far as the data tell them, and the modulus
    if the model has one. The search for them starts from a few points: the model's own guess, and
    others drawn about it; those that the force is linear in come from linear least squares. The
    best two go on to a minimum, constants with an answer at all rows before all others. It can be
    one of several minima: another `seed` draws other points.

    Parameters
    ----------
    model_class : callable
        Makes the model from a `Muscle`: `EnergyMuscle`, a class of `CATALOGUE`, or for example
        ``functools.partial(EnergyMuscle, ends="trellis")``, ``functools.partial(TonduLopez,
        kappa2=1.0)``.
    muscle : Muscle
        Where the fit starts, and the values of all that is not free.
    data : Measurements
    free : sequence of str, optional
        Fields of `Muscle`, and constants of the model, to fit.
    bounds : mapping, optional
        ``(low, high)`` of a free parameter; there are wide ones by default.
    start : mapping, optional
        Where free constants of the model start; with all of them no other start is tried.
    force : bool
        Fit also what the data cannot tell; the warnings then say so.
    seed : int
        Of the starts.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        If a parameter is unknown or has no effect, if there are too few rows, if the data cannot
        tell the parameters apart (unless `force`), or if the model has no answer for a row: at
        the start, or, with constants of its own, with any that were found.
    MissingLawError
        If the model needs a law that is not given.
    """
    own = list_own(model_class)
    build, names, held = choose_free(free, model_class, muscle, data, own)
    never, _ = judge_parameters(names, data)
    if never and not force:
        raise InputError("; ".join(never))
    limits = choose_bounds(names, muscle, {} if bounds is None else bounds, own)
    widest = limits[names.index("braid_angle"), 1] if "braid_angle" in names else None
    data.check_lengths(muscle, braid_angle=widest)
    problem = Problem(
        model_class=build,
        muscle=muscle,
        free=names,
        data=data,
        limits=limits,
        constants=choose_constants(model_class, muscle, names, limits, own, start),
    )
    found, problem = _find_best(problem, own, start, seed)
    values = problem.name_values(found.x)
    constants = {name: values[name] for name in problem.constants}
    fitted = muscle.replace(**{name: values[name] for name in names if name not in constants})
    model = build(fitted, **constants)
    contact = float(model.dead_band()) if "gap" in names else 0.0
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
        fitted=model,
        held=held,
    )


def _find_best(
    problem: Problem, own: Mapping[str, Parameter], start: Mapping[str, float] | None, seed: int
) -> tuple[Any, Problem]:
    """Return the best of the searches from a few starts, and the problem as it was begun."""
    if not problem.constants:
        model = problem.build(problem.start)
        predict_contraction(model, problem.data)  # one clear line, if it cannot hold a row
        begin = problem.choose_start()
        _check_effect(problem.free, problem.slope(begin))
        return find_minimum(problem, begin), problem
    if not set(problem.constants) - set(start or {}):
        return find_constants([problem])
    linear = tuple(name for name in problem.constants if own[name].linear)
    return find_constants([*find_starts(problem, linear=linear, seed=seed), problem])


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
    fitted: MuscleModel,
    held: dict[str, str],
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
        model=fitted.name,
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
        fitted=fitted,
        held=held,
        warnings=(
            *warnings,
            *judge_fit(free, correlations, condition),
            *judge_repeats(problem.data, residuals, parameters=len(free)),
        ),
        converged=converged,
        reason=reason,
        evaluations=int(found.nfev),
    )
