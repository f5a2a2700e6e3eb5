"""Fit a muscle model to measurements, and report what the data do not determine."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number, describe_fields
from ..errors import BozziniError, InputError
from ..results import Json, Result, take_axes, to_plain
from .data import Measurements
from .design import check_muscle
from .problem import (
    PARAMETER_UNITS,
    Problem,
    choose_bounds,
    choose_unknowns,
    draw_point,
    guess_constants,
    list_own,
    list_parameters,
    predict_contraction,
)
from .table import take_measurements

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from scipy.optimize import OptimizeResult

    from .design import Muscle
    from .model import MuscleModel
    from .models.card import Parameter

# Which parameters of a muscle can be determined from which data.
#
# The rules were found by fits to synthetic data of `EnergyMuscle`, where the truth is known: 20
# pressures up to 827 kPa, errors of 0.1 mm. There one curve determines the modulus and the dead
# length (to 0.006 MPa and 0.17 mm); the braid angle is lost in the dead length unless there are
# rows under load or blocked, and so is friction unless there are both directions.


CONDITION_LIMIT = 30.0
"""Above this condition of the Jacobian, its columns scaled to length 1, a warning is given."""
CORRELATION_LIMIT = 0.98
"""Above this correlation of two parameters a warning is given."""
GAP_PRESSURES = 3
GAP_SPAN = 3.0
"""A free gap needs so many pressures, above none and below `GAP_SPAN` times that of contact."""


def judge_parameters(
    free: Sequence[str], data: Measurements, *, contact_pressure: float = 0.0
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return sets that must not be fitted together, and what the data hardly determine."""
    never, doubts = [], []
    if "braid_angle" in free and not data.has_load:
        reason = "needs rows at a second load, or forces of the blocked muscle"
        if "dead_length" in free:
            never.append(f"braid_angle and dead_length do the same to one curve: this {reason}")
        else:
            doubts.append(f"braid_angle {reason}: other errors of length hide in it")
    if "friction_length" in free and not data.has_both_directions:
        reason = "needs rows of inflation and of deflation"
        if "dead_length" in free:
            never.append(f"friction_length and dead_length do the same to one curve: this {reason}")
        else:
            doubts.append(f"friction_length {reason}: other losses hide in it")
    if "gap" in free:
        span = GAP_SPAN * contact_pressure
        low = len(np.unique(data.pressure[(data.pressure > 0.0) & (data.pressure < span)]))
        if low < GAP_PRESSURES:
            doubts.append(
                f"gap has {low} pressure(s) above 0 and below {1e3 * span:.0f} kPa, {GAP_SPAN:g} "
                f"times the contact pressure: it needs {GAP_PRESSURES}"
            )
    return tuple(never), tuple(doubts)


def judge_fit(
    free: Sequence[str], correlations: NDArray[np.float64], condition: float
) -> list[str]:
    """Return warnings on what a fit could not determine."""
    warnings = []
    if condition > CONDITION_LIMIT:
        warnings.append(
            f"the data determine the parameters poorly: condition {condition:.0f} is above "
            f"{CONDITION_LIMIT:.0f}"
        )
    for i, j in combinations(range(len(free)), 2):
        if abs(correlations[i, j]) > CORRELATION_LIMIT:
            warnings.append(
                f"{free[i]} and {free[j]} cannot be distinguished: correlation "
                f"{correlations[i, j]:+.3f}"
            )
    return warnings


def judge_repeats(
    data: Measurements, residuals: NDArray[np.float64], *, parameters: int
) -> list[str]:
    """Return a warning if a fit misses the data by more than the data miss each other.

    The F-test of lack of fit at 0.1 %: it needs rows that repeat a state.
    """
    from scipy.stats import f as fisher

    repeats = data.repeat_statistics()
    states, freedom = len(repeats.count), repeats.degrees_of_freedom
    pure = freedom * repeats.pooled_deviation**2
    lack = float(residuals @ residuals) - pure
    if freedom < 1 or states <= parameters or lack <= 0.0:
        return []
    limit = float(fisher.ppf(0.999, states - parameters, freedom))
    if lack / (states - parameters) <= limit * pure / freedom:
        return []
    rest = float(np.sqrt(residuals @ residuals / (len(data) - parameters)))
    return [
        f"the model does not fit: it is off by {rest:.3g} mm, repeats by "
        f"{repeats.pooled_deviation:.3g} mm; the intervals are too sure"
    ]


# The search for the smallest sum of squares, past the kinks at which it can be caught.
#
# Contraction over pressure has a kink where the tube meets the braid. As a trial moves the pressure
# of contact past a measured pressure, the sum of squares has a kink as well, and can have a minimum
# on both sides. So a fit of the gap is begun anew from gaps for which contact lies between other
# neighbours of the measured pressures, until none of them is better.
#
# Constants of a model can have several minima, and rows without an answer on the way. So they are
# searched for from several starts, each a little, and the best of those searches go on.


EVALUATIONS = 200
"""Largest number of evaluations of one search."""

_FIRST = 15  # evaluations from each start for constants
_KEPT = 2  # how many of those searches, the best, go on
_SECOND = 65  # evaluations that each of these has then; the best of them has the rest
_BETTER = 1e-9  # relative decrease of the sum of squares that counts as one


def find_minimum(
    problem: Problem, start: NDArray[np.float64], *, limit: int = EVALUATIONS
) -> OptimizeResult:
    """Return SciPy's result of the best search; `nfev` counts all of them."""
    best = _search(problem, start, limit)
    evaluations = best.nfev
    if "gap" in problem.free:
        levels = np.unique(np.append(problem.data.pressure, 0.0))
        tried = {_place(problem, best.x, levels)}
        while True:
            here = _place(problem, best.x, levels)
            fresh = [i for i in (here - 1, here + 1) if 1 <= i < len(levels) and i not in tried]
            if not fresh:
                break
            for place in fresh:
                tried.add(place)
                middle = 0.5 * (levels[place - 1] + levels[place])
                found = _search(problem, _move_contact(problem, best.x, float(middle)), limit)
                evaluations += found.nfev
                if found.cost < (1.0 - _BETTER) * best.cost:
                    best = found
    best.nfev = evaluations
    return best


def find_constants(starts: Sequence[Problem]) -> tuple[OptimizeResult, Problem]:
    """Return the best of searches from several starts, and the problem it began with.

    A search that ends with an answer at all rows is better than any that does not.
    """
    tries = [(find_minimum(one, one.choose_start(), limit=_FIRST), one) for one in starts]
    tries.sort(key=_judge)
    ends = [_go_on(*search, limit=_SECOND) for search in tries[:_KEPT]]
    found, begun = _go_on(*min(ends, key=_judge), limit=EVALUATIONS - _FIRST - _SECOND)
    found.nfev += sum(search.nfev for search, one in (*ends, *tries[_KEPT:]) if one is not begun)
    _demand_answers(begun, found.x)
    return found, begun


def _go_on(
    found: OptimizeResult, problem: Problem, *, limit: int
) -> tuple[OptimizeResult, Problem]:
    """Return a search that has not ended taken further."""
    if found.status != 0:
        return found, problem
    more = find_minimum(problem, found.x, limit=limit)
    more.nfev += found.nfev
    return more, problem


def _judge(search: tuple[OptimizeResult, Problem]) -> tuple[bool, float]:
    """Return the key to sort searches by."""
    found, problem = search
    return not problem.evaluate(found.x)[1].all(), float(found.cost)


def _demand_answers(problem: Problem, point: NDArray[np.float64]) -> None:
    """Raise `InputError` if the model has no answer at a row with the best constants found."""
    _, held = problem.evaluate(point)
    if held.all():
        return
    data, row = problem.data, int(np.argmin(held))
    values = problem.name_values(point)
    words = ", ".join(f"{name} = {value:.4g}" for name, value in values.items())
    raise InputError(
        f"no constants were found with which the model has an answer at all rows: with {words} it "
        f"has none at {len(data) - held.sum()} of {len(data)}, the first is {data.name_row(row)} "
        f"({data.pressure[row]:g} MPa, {data.load[row]:g} N)"
    )


def _search(problem: Problem, start: NDArray[np.float64], limit: int) -> OptimizeResult:
    from scipy.optimize import least_squares

    low, high = problem.limits.T / problem.scales
    found = least_squares(
        problem.miss,
        start,
        jac=problem.slope,
        bounds=(low, high),
        xtol=1e-10,
        ftol=1e-12,
        gtol=1e-12,
        x_scale="jac" if problem.constants else 1.0,
        max_nfev=limit,
    )
    found.x = np.choose(found.active_mask + 1, (low, found.x, high))
    return found


def _contact(problem: Problem, point: NDArray[np.float64]) -> float:
    try:
        return float(problem.build(problem.name_values(point)).dead_band())
    except BozziniError:
        return 0.0


def _place(problem: Problem, point: NDArray[np.float64], levels: NDArray[np.float64]) -> int:
    """Return between which pressures contact lies: above ``levels[place - 1]``."""
    return max(1, int(np.searchsorted(levels, _contact(problem, point))))


def _move_contact(
    problem: Problem, point: NDArray[np.float64], pressure: float
) -> NDArray[np.float64]:
    """Return the point with another gap, for contact near a pressure; it grows with the gap."""
    index = problem.free.index("gap")
    low, high = problem.limits[index] / problem.scales[index]
    margin = 1e-3 * (high - low)
    low, high = low + margin, high - margin
    moved = np.array(point)
    # Inside the bounds in all parameters: a search hardly leaves one.
    ends = problem.limits.T / problem.scales
    moved = np.clip(
        moved, ends[0] + 1e-3 * (ends[1] - ends[0]), ends[1] - 1e-3 * (ends[1] - ends[0])
    )
    for _ in range(20):
        moved[index] = 0.5 * (low + high)
        if _contact(problem, moved) < pressure:
            low = moved[index]
        else:
            high = moved[index]
    return moved


# Where the search for a model's constants starts: many trials of a cheap measure of the misfit.
#
# The measure is one step of Newton's method from each measured state, ``(F - load) / stiffness``,
# to first order how much farther the model contracts there: no equilibrium is solved. A few trials
# start about the guess, the first at it. From each, the constants that the force is linear in are
# found by bounded linear least squares as well.


Floats = NDArray[np.float64]

_TRIALS = 16
_SEARCHES = 8  # how many of the trials are searched from
_EVALUATIONS = 40  # of each search
_ROUNDS = 4  # of linear least squares, whose weights depend on the answer
_SAME_MISFIT = 1e-3  # relative difference of two misfits that are taken for the same minimum
_LEAST_STIFFNESS_N_PER_MM = 1e-12  # keeps a weight finite where the model has no stiffness [N/mm]


def find_starts(
    problem: Problem, *, linear: tuple[str, ...], seed: int = 0, count: int = 6
) -> list[Problem]:
    """Return the problem with a few starts, the most promising first."""
    random = np.random.default_rng(seed)
    points = [problem.choose_start()]
    points += [draw_point(problem, random) for _ in range(_TRIALS - 1)]
    begins = []
    for point in points:
        better = _solve_linear(problem, point, linear)
        begins.append(point if better is None else better)
    begins.sort(key=lambda point: float(np.sum(problem.steps(point) ** 2)))
    trials: list[tuple[float, Floats]] = []
    for start in begins[:_SEARCHES]:
        found, cost = _descend(problem, start)
        if all(abs(cost - other) > _SAME_MISFIT * (cost + other) for other, _ in trials):
            trials.append((cost, found))
    points = [point for _, point in sorted(trials, key=lambda trial: trial[0])]
    points.sort(key=lambda point: float(np.sum(problem.miss(point) ** 2)))
    return [_move(problem, point) for point in points[:count]]


def _move(problem: Problem, point: Floats) -> Problem:
    """Return the problem with another start, and the scales that go with it."""
    values = problem.name_values(point)
    own = {name: values[name] for name in problem.constants}
    fields = {name: value for name, value in values.items() if name not in own}
    return dataclasses.replace(problem, muscle=problem.muscle.replace(**fields), constants=own)


def _descend(problem: Problem, start: Floats) -> tuple[Floats, float]:
    """Return the nearest minimum of the measure, and the measure there."""
    from scipy.optimize import least_squares

    low, high = problem.limits.T / problem.scales
    margin = 1e-9 * (high - low)
    found = least_squares(
        problem.steps,
        np.clip(start, low + margin, high - margin),
        bounds=(low, high),
        x_scale="jac",
        max_nfev=_EVALUATIONS,
    )
    return np.asarray(found.x), float(found.cost)


def _solve_linear(problem: Problem, point: Floats, linear: tuple[str, ...]) -> Floats | None:
    """Return the point with the best of the linear unknowns, or None if that is no better.

    The force is affine in them, so that steps of one after the other give all of it. The stiffness,
    which the rows are weighted by, is that of the round before.
    """
    from scipy.optimize import lsq_linear

    columns = [problem.free.index(name) for name in linear if name in problem.free]
    if not columns:
        return None
    limits = problem.limits[columns] / problem.scales[columns, None]
    before = float(np.sum(problem.steps(point) ** 2))
    best, least = None, before
    now = np.array(point)
    data = problem.data
    try:
        for _ in range(_ROUNDS):
            model = problem.build(problem.name_values(now))
            force = model.force(data.pressure, data.contraction, direction=data.branch)
            stiffness = np.abs(
                model.stiffness(data.pressure, data.contraction, direction=data.branch)
            )
            weights = 1.0 / (stiffness + _LEAST_STIFFNESS_N_PER_MM)
            table = []
            for column, (low, high) in zip(columns, limits, strict=True):
                there = now.copy()
                there[column] += 1.0 if now[column] + 1.0 <= high else -1.0
                there[column] = max(there[column], low)
                other = problem.build(problem.name_values(there))
                change = other.force(data.pressure, data.contraction, direction=data.branch) - force
                table.append(change / (there[column] - now[column]))
            slope = np.stack(table, axis=1)
            target = data.load - force + slope @ now[columns]
            found = lsq_linear(
                slope * weights[:, None], target * weights, bounds=(limits[:, 0], limits[:, 1])
            )
            now[columns] = found.x
            cost = float(np.sum(problem.steps(now) ** 2))
            if cost < least:
                best, least = now.copy(), cost
    except (BozziniError, ValueError, np.linalg.LinAlgError):  # not affine there, or no answer
        pass
    return best


def choose_free(
    free: Sequence[str] | None,
    model_class: Callable[..., MuscleModel],
    muscle: Muscle,
    data: Measurements,
    own: Mapping[str, Parameter],
) -> tuple[Callable[..., MuscleModel], tuple[str, ...], dict[str, str]]:
    """Return what makes the model, what is free, and what is held and why."""
    build, held = model_class, {}
    known = {item.name for item in list_parameters(model_class)} - set(own)
    if free is None:
        unknowns = choose_unknowns(model_class, muscle, data)
        build, free, held = unknowns.build, unknowns.free, unknowns.held
    names = tuple(dict.fromkeys(free))
    if not names:
        raise InputError("no parameter is free: name one or more")
    for name in names:
        if name not in PARAMETER_UNITS and name not in own:
            why = "given, so it cannot be free" if name in known else "not known"
            legal = ", ".join((*PARAMETER_UNITS, *own))
            raise InputError(f"parameter '{name}' is {why}: use {legal}")
    if len(data) <= len(names):
        raise InputError(
            f"{len(data)} row(s) are too few for {len(names)} parameter(s): "
            f"there must be {len(names) + 1} or more"
        )
    return build, names, held


def choose_constants(
    model_class: Callable[..., MuscleModel],
    muscle: Muscle,
    names: tuple[str, ...],
    limits: NDArray[np.float64],
    own: Mapping[str, Parameter],
    start: Mapping[str, float] | None,
) -> dict[str, float]:
    """Return where the free constants of the model start."""
    for name in start or {}:
        if name not in own or name not in names:
            legal = ", ".join(name for name in names if name in own) or "none"
            raise InputError(f"a start is given for {name}: the free constants are {legal}")
    guess = {**guess_constants(model_class, muscle), **(start or {})}
    constants = {}
    for name, (low, high) in zip(names, limits, strict=True):
        if name in own:
            middle = 0.5 * (low + high)
            value = check_number(f"start of {name}", guess.get(name, middle), unit=own[name].unit)
            constants[name] = float(np.clip(value, low, high))
    return constants


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """Bounds and starts of a fit.

    Parameters
    ----------
    bounds : mapping
        ``(low, high)`` of a free parameter; there are wide ones by default.
    start : mapping
        Where free constants of the model start; with all of them no other start is tried.
    force : bool
        Fit also what the data do not determine; the warnings then name it.
    seed : int
        Of the starts.
    """

    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    force: bool = False
    seed: int = 0


DEFAULT_OPTIONS = FitOptions()
"""A fit with wide bounds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration(Result):
    """What a fit found, and how far it can be trusted.

    Parameters
    ----------
    model : str
        Name of the model.
    free : tuple of str
        The parameters that were fitted, the order of `correlations`.
    units : dict
        Their units: mm, MPa, rad, or those on the model's card.
    estimates : dict
        Their values.
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
        Unknown constants that were not fitted, and why.
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
    units: dict[str, str]
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
        """Whether the fit converged without warnings."""
        return self.converged and not self.warnings

    @property
    def residual(self) -> float:
        """Standard deviation of a row about the fit [mm], `sigma`."""
        return self.sigma

    def to_dict(self) -> Json:
        """Return the fit as plain values, with units in the names or beside the values."""
        estimates = {
            name: {
                "value": self.estimates[name],
                "unit": self.units[name],
                "standard_error": self.standard_errors[name],
                "interval_95": self.intervals[name],
            }
            for name in self.free
        }
        values: Json = {
            "estimates": estimates,
            "held": self.held,
            "correlations": self.correlations,
            "condition": self.condition,
            "sigma_mm": self.sigma,
            "warnings": self.warnings,
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.residual,
            "muscle": describe_fields(self.muscle),
        }
        return {name: to_plain(value) for name, value in values.items()}

    def list_columns(self) -> dict[str, list[object]]:
        """Return the columns of `to_frame`, a row for each parameter."""
        return {
            "parameter": list(self.free),
            "estimate": [self.estimates[name] for name in self.free],
            "unit": [self.units[name] for name in self.free],
            "standard_error": [self.standard_errors[name] for name in self.free],
            "low_95": [self.intervals[name][0] for name in self.free],
            "high_95": [self.intervals[name][1] for name in self.free],
        }

    def format_table(self) -> str:
        """Return the estimates as a table of text, with what is to be known of them."""
        wide = max(16, *(len(name) + 1 for name in self.free))
        lines = [
            f"{name:<{wide}}{self.estimates[name]:10.4g} {self.units[name]:<4} "
            "95 %: {:.4g} to {:.4g}".format(*self.intervals[name])
            for name in self.free
        ]
        lines.append(
            f"residuals {self.sigma:.3g} mm, condition {self.condition:.1f}; "
            f"{'converged' if self.converged else 'not converged'}: {self.reason}"
        )
        lines += [f"{name}: {reason}" for name, reason in self.held.items()]
        return "\n".join([*lines, *(f"warning: {text}" for text in self.warnings)])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the residuals in the order of the rows, and return the axes."""
        axes = take_axes(ax, x="row", y="measured less fitted contraction [mm]")
        axes.plot(self.residuals, "o")
        axes.axhline(0.0, linewidth=0.8)
        return axes


def calibrate(
    model_class: Callable[..., MuscleModel],
    muscle: Muscle,
    *,
    data: Measurements | pandas.DataFrame,
    free: Sequence[str] | None = None,
    options: FitOptions = DEFAULT_OPTIONS,
) -> Calibration:
    """Fit parameters of a muscle so that the model's contraction meets the measured one.

    The default pair of `EnergyMuscle`, modulus and dead length, is well determined by one curve of
    contraction over pressure. Free the gap only with rows at low pressure, the braid angle only
    with rows under load or blocked, and the friction length only with both directions.

    A model of the catalogue has constants of its own. By default those are free that its source
    fitted or that it must be given and has not got, as far as the data determine them, and the
    modulus if the model has one. The search for them starts from a few points: the model's own
    guess, and others drawn about it. Those that the force is linear in come from linear least
    squares. The best two go on to a minimum, constants with an answer at all rows before all
    others. It can be one of several minima: another `FitOptions.seed` draws other points.

    Parameters
    ----------
    model_class : callable
        Makes the model from a `Muscle`: `EnergyMuscle`, a class of `MODELS`, or for example
        ``functools.partial(EnergyMuscle, ends="trellis")``, ``functools.partial(TonduLopez,
        kappa2=1.0)``.
    muscle : Muscle
        Where the fit starts, and the values of all that is not free.
    data : Measurements or DataFrame
    free : sequence of str, optional
        Fields of `Muscle`, and constants of the model, to fit.
    options : FitOptions
        Bounds and starts.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        If a parameter is unknown or has no effect, if there are too few rows, if the data cannot
        distinguish the parameters (unless `force`), or if the model has no answer for a row: at
        the start, or, with constants of its own, with any that were found.
    MissingLawError
        If the model needs a law that is not given.
    """
    check_muscle(muscle)
    data = take_measurements(data, muscle=muscle)
    own = list_own(model_class)
    build, names, held = choose_free(free, model_class, muscle, data, own)
    muscle = muscle.fill(names)
    never, _ = judge_parameters(names, data)
    if never and not options.force:
        raise InputError("; ".join(never))
    limits = choose_bounds(names, muscle, options.bounds, own)
    widest = limits[names.index("braid_angle"), 1] if "braid_angle" in names else None
    data.check_lengths(muscle, braid_angle=widest)
    problem = Problem(
        model_class=build,
        muscle=muscle,
        free=names,
        data=data,
        limits=limits,
        constants=choose_constants(model_class, muscle, names, limits, own, options.start),
    )
    found, problem = _find_best(problem, own, options)
    values = problem.name_values(found.x)
    constants = {name: values[name] for name in problem.constants}
    model = build(
        muscle.replace(**{name: values[name] for name in names if name not in constants}),
        **constants,
    )
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
        answered=answered,
        fitted=model,
        held=held,
    )


def _find_best(
    problem: Problem, own: Mapping[str, Parameter], options: FitOptions
) -> tuple[OptimizeResult, Problem]:
    """Return the best of the searches from a few starts, and the problem as it was begun."""
    if not problem.constants:
        model = problem.build(problem.start)
        predict_contraction(model, problem.data)  # one clear line, if it cannot hold a row
        begin = problem.choose_start()
        _check_effect(problem.free, problem.slope(begin))
        return find_minimum(problem, begin), problem
    if not set(problem.constants) - set(options.start):
        return find_constants([problem])
    linear = tuple(name for name in problem.constants if own[name].linear)
    return find_constants([*find_starts(problem, linear=linear, seed=options.seed), problem])


def _check_effect(free: Sequence[str], jacobian: NDArray[np.float64]) -> None:
    for name, column in zip(free, np.asarray(jacobian).T, strict=True):
        if not np.abs(column).max() > 1e-9:
            raise InputError(
                f"{name} has no effect on the contraction at these rows: it cannot be fitted"
            )


def _explain_end(status: int, *, answered: bool) -> str:
    if not answered:
        return "the model has no answer for some rows"
    if status <= 0:
        return f"no minimum within {EVALUATIONS} evaluations"
    reasons = {1: "the gradient vanished", 2: "the sum of squares settled"}
    return reasons.get(status, "the parameters settled")


def _conclude(
    problem: Problem,
    found: OptimizeResult,
    *,
    warnings: list[str],
    answered: bool,
    fitted: MuscleModel,
    held: dict[str, str],
) -> Calibration:
    """Put the statistics together from the residuals and the Jacobian at the minimum."""
    from scipy.stats import t as student

    free, residuals = problem.free, -np.asarray(found.fun)
    units = PARAMETER_UNITS | {item.name: item.unit for item in fitted.list_parameters()}
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
        units={name: units[name] for name in free},
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
        muscle=fitted.muscle,
        fitted=fitted,
        held=held,
        warnings=(
            *warnings,
            *judge_fit(free, correlations, condition),
            *judge_repeats(problem.data, residuals, parameters=len(free)),
        ),
        converged=bool(found.status > 0 and answered),
        reason=_explain_end(found.status, answered=answered),
        evaluations=int(found.nfev),
    )
