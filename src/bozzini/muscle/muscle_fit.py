"""Fit a muscle model to measurements, and report what the data do not determine."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer, check_number, describe_fields, show_apart
from ..errors import BozziniError, InputError
from ..numeric.arrays import Floats
from ..numeric.estimation import (
    Blocks,
    determine,
    draw_rows,
    judge_fit,
    make_blocks,
    measure_spread,
)
from ..numeric.least_squares import (
    OUT_OF_TIME,
    Clock,
    LeastSquares,
    Minimum,
    describe_bounds,
    explain_end,
)
from ..results import Json, Result, Shown, take_axes, to_plain
from .data import Measurements
from .design import check_muscle
from .ends import EndEffects, MountedMuscle
from .files import FitSummary, MuscleFile
from .prediction import Prediction, predict
from .problem import (
    ALL_UNITS,
    END_FIELDS,
    HELD_UNSET,
    PARAMETER_UNITS,
    FitData,
    Problem,
    Response,
    assemble,
    choose_bounds,
    choose_unknowns,
    draw_point,
    explain_gap,
    find_states,
    guess_constants,
    label_unknown,
    list_constants,
    list_own,
    list_parameters,
    list_unused,
    name_default_fields,
    settle_unset,
)
from .table import take_measurements

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

    from .design import Muscle
    from .model import MuscleModel
    from .models.card import Parameter


# Which parameters of a muscle can be determined from which data.
#
# The rules were found by fits to synthetic data of `EnergyMuscle`, where the truth is known: 20
# pressures up to 827 kPa, errors of 0.1 mm. There one curve determines the modulus and the dead
# length (to 0.006 MPa and 0.17 mm); the braid angle is lost in the dead length unless there are
# rows under load or blocked, and so is friction unless there are both directions.

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


def measure_repeats(task: FitData, errors: Floats | None = None) -> tuple[float, int]:
    """Return the sum of squares about the means of rows that repeat a state, and the states.

    With errors (n,) of the rows the means are weighted, and the squares are over those of errors.
    """
    states, of_row = find_states(task)
    weights = np.ones(len(of_row)) if errors is None else 1.0 / errors**2
    mean = np.bincount(of_row, weights * task.measured) / np.bincount(of_row, weights)
    return float(np.sum(weights * (task.measured - mean[of_row]) ** 2)), states


def judge_repeats(
    task: FitData, residuals: Floats, *, parameters: int, errors: Floats | None = None
) -> list[str]:
    """Return a warning if a fit misses the data by more than the data miss each other.

    There is one, too, if the data have no more states than the fit has parameters. The F-test of
    lack of fit at 0.1 %: it needs rows that repeat a state. With errors (n,) of the rows it is that
    of residuals over errors.
    """
    from scipy.stats import f as fisher

    pure, states = measure_repeats(task, errors)
    scale = np.ones(len(residuals)) if errors is None else errors
    unit = task.unit if errors is None else "standard errors"
    squares = float(np.sum((residuals / scale) ** 2))
    freedom, lack = len(residuals) - states, squares - pure
    if states <= parameters:
        return [
            f"the rows are of {states} state(s) for {parameters} parameter(s): they cannot show "
            "whether the model fits"
        ]
    exact = float(np.sum((_EXACT * task.worst / scale) ** 2))
    if freedom < 1 or lack <= exact:
        return []
    limit = float(fisher.ppf(0.999, states - parameters, freedom))
    if lack / (states - parameters) <= limit * pure / freedom:
        return []
    rest = float(np.sqrt(squares / (len(residuals) - parameters)))
    return [
        f"the model does not fit: it is off by {rest:.3g} {unit}, repeats by "
        f"{np.sqrt(pure / freedom):.3g} {unit}; the intervals are too sure"
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
_CAUGHT = 1e-3  # relative decrease that the gradient promises: more where a search was caught
_RELEASES = 1  # times that a search that was caught is taken further
_MOST_CORNERS = 8  # unknowns: with more a simplex takes too long
_SIMPLEX = 0.02  # of the residuals: by how much the corners of a simplex change them
_TRIED = 20  # trials of a simplex for each unknown
_EXACT = 1e-11  # of the span: with a root mean square below no other start is tried
_BETTER = 1e-9  # relative decrease of the sum of squares that counts as one


def find_minimum(
    problem: Problem, start: NDArray[np.float64], *, limit: int = EVALUATIONS
) -> Minimum:
    """Return where the best search ended; `evaluations` counts all of them."""
    best = _search(problem, start, limit)
    evaluations = best.evaluations
    if "gap" in problem.free and len(problem.task.parts) == 1:
        levels = np.unique(np.append(problem.task.data.pressure, 0.0))
        tried = {_place(problem, best.point, levels)}
        while True:
            here = _place(problem, best.point, levels)
            fresh = [i for i in (here - 1, here + 1) if 1 <= i < len(levels) and i not in tried]
            if not fresh or problem.clock.is_over:
                break
            for place in fresh:
                tried.add(place)
                middle = 0.5 * (levels[place - 1] + levels[place])
                found = _search(problem, _move_contact(problem, best.point, float(middle)), limit)
                evaluations += found.evaluations
                if found.cost < (1.0 - _BETTER) * best.cost:
                    best = found
    return dataclasses.replace(best, evaluations=evaluations)


def find_constants(starts: Sequence[Problem]) -> tuple[Minimum, Problem]:
    """Return the best of searches from several starts, and the problem it began with.

    A row without an answer counts as `FitData.worst`.
    """
    tries: list[tuple[Minimum, Problem]] = []
    for one in starts:
        rough = dataclasses.replace(one, rough=True)
        found = find_minimum(rough, one.choose_start(), limit=_FIRST)
        if found.converged:  # its derivatives are rough: it goes on
            found = dataclasses.replace(found, status=0)
        tries.append((found, one))
        if _judge(tries[-1]) <= len(one.task.data) * (_EXACT * one.task.span) ** 2:
            break
    tries.sort(key=_judge)
    ends = [_go_on(*search, limit=_SECOND) for search in tries[:_KEPT]]
    found, begun = _go_on(*min(ends, key=_judge), limit=EVALUATIONS - _FIRST - _SECOND)
    others = (search for search, one in (*ends, *tries[_KEPT:]) if one is not begun)
    evaluations = found.evaluations + sum(search.evaluations for search in others)
    return release(dataclasses.replace(found, evaluations=evaluations), begun), begun


def release(found: Minimum, problem: Problem) -> Minimum:
    """Return a search taken further that was caught at an edge of the sum of squares.

    At the edge a row has no answer any more, or a muscle goes slack: the gradient points over it,
    and no step along the gradient helps. A simplex finds along it (Nelder and Mead, Computer
    Journal 7, 1965, 308-313), and the search goes on from there.
    """
    from scipy.optimize import minimize

    low, high = problem.bounds.T / problem.scales
    for _ in range(_RELEASES if len(problem.unknowns) <= _MOST_CORNERS else 0):
        free = found.sides == 0
        table, rest = found.slope[:, free], found.misfit
        if problem.clock.is_over or not found.converged or not free.any():
            break
        gain = float(np.sum((table @ np.linalg.lstsq(table, rest, rcond=None)[0]) ** 2))
        if gain <= _CAUGHT * float(rest @ rest):
            break
        sizes = _SIMPLEX * np.linalg.norm(rest) / np.maximum(np.linalg.norm(table, axis=0), 1e-12)
        sizes = np.minimum(sizes, 0.1 * (high - low)[free])
        begin = found.point[free]
        sizes = np.where(begin + sizes <= high[free], sizes, -sizes)

        def fill(
            part: Floats, free: NDArray[np.bool_] = free, point: Floats = found.point
        ) -> Floats:
            full = point.copy()
            full[free] = part
            return full

        moved = minimize(
            lambda part, fill=fill: problem.measure_cost(fill(part)),
            begin,
            method="Nelder-Mead",
            bounds=list(zip(low[free], high[free], strict=True)),
            options={
                "maxfev": _TRIED * len(begin),
                "initial_simplex": np.vstack([begin, begin + np.diag(sizes)]),
            },
        )
        if moved.fun < (1.0 - _BETTER) * 2.0 * found.cost:
            more = find_minimum(problem, fill(moved.x), limit=_SECOND)
            tried = found.evaluations + int(moved.nfev)
            found = dataclasses.replace(more, evaluations=more.evaluations + tried)
    return found


def _go_on(found: Minimum, problem: Problem, *, limit: int) -> tuple[Minimum, Problem]:
    """Return a search that has not ended taken further."""
    if found.status != 0:
        return found, problem
    more = find_minimum(problem, found.point, limit=limit)
    evaluations = more.evaluations + found.evaluations
    return dataclasses.replace(more, evaluations=evaluations), problem


def _judge(search: tuple[Minimum, Problem]) -> float:
    """Return the key to sort searches by."""
    found, problem = search
    return problem.measure_cost(found.point)


MOST_RESAMPLES = 100_000
"""Largest number of resamples."""


def _search(problem: Problem, start: Floats, limit: int) -> Minimum:
    low, high = problem.bounds.T / problem.scales
    found = LeastSquares(
        misfit=problem.measure_residuals,
        slope=problem.measure_jacobian,
        bounds=(low, high),
        scale="jac" if problem.constants else 1.0,
        xtol=1e-10,
        ftol=1e-12,
        gtol=1e-12,
        clock=problem.clock,
    ).descend(start, evaluations=limit)
    return dataclasses.replace(found, point=np.choose(found.sides + 1, (low, found.point, high)))


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
# For the contraction the measure is one step of Newton's method from each measured state,
# ``(F - load) / stiffness``, to first order how much farther the model contracts there: no
# equilibrium is solved. For the force it is the misfit itself, which is as cheap. A few trials
# start about the guess, the first at it. In others, the free fields of the muscle are spread evenly
# between their bounds: misfits in force have a minimum with a weak wall at a small braid angle
# beside that of the muscle. From each, the constants that the force is linear in are found by
# bounded linear least squares as well.

_TRIALS = 16
_SPREAD = 4, 6  # trials with fields anywhere between their bounds: 2^4 by 2 for each, at most 2^6
_SPREAD_KEPT = 4  # how many of these trials are searched from
_APART = 0.2  # of the range between the bounds: that far apart are these in one field or more
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
        better = None if problem.clock.is_over else _solve_linear(problem, point, linear)
        begins.append(point if better is None else better)
    begins.sort(key=lambda point: float(np.sum(problem.measure(point) ** 2)))
    if problem.task.response == "contraction":
        trials: list[tuple[float, Floats]] = []
        for start in begins[:_SEARCHES]:
            if trials and problem.clock.is_over:
                break
            found, cost = _descend(problem, start)
            if all(abs(cost - other) > _SAME_MISFIT * (cost + other) for other, _ in trials):
                trials.append((cost, found))
        begins = [point for _, point in sorted(trials, key=lambda trial: trial[0])]
        begins.sort(key=lambda point: float(np.sum(problem.measure_residuals(point) ** 2)))
    begins = begins[:count] + _spread_fields(problem, random, linear)
    return [problem.move(problem.name_values(point)) for point in begins]


def _spread_fields(
    problem: Problem, random: np.random.Generator, linear: tuple[str, ...]
) -> list[Floats]:
    """Return the best trials with the fields of the muscle anywhere between their bounds.

    The trials are a Sobol sequence, on a scale of logarithms where the bounds are wide. Those that
    are returned are apart, since the best minimum may be the narrow one.
    """
    from scipy.stats.qmc import Sobol

    fields = [i for i, name in enumerate(problem.names) if name in PARAMETER_UNITS]
    if not fields or problem.task.response != "force":
        return []
    low, high = problem.bounds[fields].T / problem.scales[fields]
    steep = (low > 0.0) & (low < 0.1 * high)
    count = min(_SPREAD[0] + len(fields), _SPREAD[1])
    trials: list[tuple[float, Floats, Floats]] = []
    for place in Sobol(len(fields), seed=random).random_base2(count):
        if problem.clock.is_over:
            break
        point = draw_point(problem, random)
        even = low + place * (high - low)
        even[steep] = low[steep] * (high[steep] / low[steep]) ** place[steep]
        point[fields] = even
        better = _solve_linear(problem, point, linear)
        point = point if better is None else better
        trials.append((float(np.sum(problem.measure(point) ** 2)), place, point))
    kept: list[tuple[Floats, Floats]] = []
    for _, place, point in sorted(trials, key=lambda trial: trial[0]):
        if all(np.abs(place - other).max() > _APART for other, _ in kept):
            kept.append((place, point))
    return [point for _, point in kept[:_SPREAD_KEPT]]


def _descend(problem: Problem, start: Floats) -> tuple[Floats, float]:
    """Return the nearest minimum of the measure, and the measure there."""
    low, high = problem.bounds.T / problem.scales
    search = LeastSquares(
        misfit=problem.take_newton_steps, bounds=(low, high), margin=1e-9, scale="jac"
    )
    found = search.descend(start, evaluations=_EVALUATIONS)
    return found.point, found.cost


def _solve_linear(problem: Problem, point: Floats, linear: tuple[str, ...]) -> Floats | None:
    """Return the point with the best of the linear unknowns, or None if that is no better.

    The force is affine in them, so that steps of one after the other give all of it. In a response
    of contraction the rows are weighted by the stiffness of the round before.
    """
    from scipy.optimize import lsq_linear

    columns = [index for index, name in enumerate(problem.names) if name in linear]
    if not columns or problem.task.response == "pressure":
        return None
    limits = problem.bounds[columns] / problem.scales[columns, None]
    best, least = None, float(np.sum(problem.measure(point) ** 2))
    now, load = np.array(point), problem.task.data.load
    errors = problem.task.response_errors
    try:
        for _ in range(_ROUNDS if problem.task.response == "contraction" else 1):
            force, weights = problem.find_forces(now)
            if errors is not None:
                weights = weights / errors
            table = []
            for column, (low, high) in zip(columns, limits, strict=True):
                there = now.copy()
                there[column] += 1.0 if now[column] + 1.0 <= high else -1.0
                there[column] = max(there[column], low)
                change = problem.find_forces(there)[0] - force
                table.append(change / (there[column] - now[column]))
            slope = np.stack(table, axis=1)
            target = load - force + slope @ now[columns]
            found = lsq_linear(
                slope * weights[:, None], target * weights, bounds=(limits[:, 0], limits[:, 1])
            )
            now[columns] = found.x
            cost = float(np.sum(problem.measure(now) ** 2))
            if cost < least:
                best, least = now.copy(), cost
    except (BozziniError, ValueError, np.linalg.LinAlgError):  # not affine there, or no answer
        pass
    return best


def choose_free(
    free: Sequence[str] | None,
    model_class: Callable[..., MuscleModel],
    task: FitData,
    unset: tuple[str, ...],
) -> tuple[Callable[..., MuscleModel], tuple[str, ...], dict[str, str]]:
    """Return what makes the model, what is free, and what is held and why.

    Fields that are `unset` are free in any case.
    """
    build, held, own = model_class, {}, list_own(model_class)
    _check_names("free", free)
    known = {item.name for item in list_parameters(model_class)} - set(own)
    if free is None:
        wanted = (*name_default_fields(model_class), *unset)
        unknowns = choose_unknowns(model_class, task, fields=tuple(dict.fromkeys(wanted)))
        build, free, held = unknowns.build, unknowns.free, unknowns.held
    else:
        free = (*free, *unset)
    names = tuple(dict.fromkeys(free))
    if not names:
        raise InputError("no parameter is free: name one or more")
    for name in names:
        if name not in ALL_UNITS and name not in own:
            why = "given, so it cannot be free" if name in known else "not known"
            unused = list_unused(model_class)
            legal = ", ".join(one for one in (*ALL_UNITS, *own) if one not in unused)
            raise InputError(f"parameter '{name}' is {why}: use {legal}")
    for name in task.each:
        if name not in names:
            raise InputError(
                f"{name} is to be fitted for each specimen, but it is not free: the free ones are "
                f"{', '.join(names)}"
            )
    if task.anchored and "offset" in names:
        raise InputError("offset follows from the free lengths, so it cannot be free")
    count = sum(len(task.parts) if name in task.each else 1 for name in names)
    if len(task.data) <= count:
        raise InputError(
            f"{len(task.data)} row(s) are too few for {count} parameter(s): "
            f"there must be {count + 1} or more"
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


def _check_names(name: str, words: Sequence[str] | None) -> None:
    """Raise `InputError` for one text in the place of several."""
    if isinstance(words, str):
        raise InputError(
            f"{name} is '{words}': it must be a sequence of names, such as ['{words}']"
        )


@dataclass(frozen=True, kw_only=True)
class FitOptions(Shown):
    """What is fitted, from where and for how long.

    Parameters
    ----------
    response : str, optional
        What the model is compared in: ``"force"`` at pressure and length, ``"contraction"`` at
        pressure and load, or ``"pressure"`` at force and length. By default that of the data, see
        `Measurements.response`.
    ends : EndEffects
        End effects of the rig: where free ones start, and the others.
    anchored : bool
        Whether the offset of each specimen is taken from its free length at a pressure, see
        `Measurements.free_lengths`.
    each : tuple of str
        Free parameters that each specimen has its own value of; the others are shared. For a
        specimen that was not in the fit the mean of the values is taken.
    bounds : mapping
        ``(low, high)`` of a free parameter; there are wide ones by default.
    start : mapping
        Where free constants of the model start; with all of them no other start is tried.
    force : bool
        Fit also what the data do not determine; the warnings then name it.
    seed : int
        Of the starts, and of the resamples.
    budget : float, optional
        Processor time after which the search is stopped [s]; none by default.
    resamples : int
        How many times the fit is repeated with blocks of rows drawn anew, for the covariance; with
        0, the default, it is the linearised one. At most `MOST_RESAMPLES`.
    """

    response: Response | None = None
    ends: EndEffects = field(default_factory=EndEffects)
    anchored: bool = False
    each: tuple[str, ...] = ()
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    force: bool = False
    seed: int = 0
    budget: float | None = None
    resamples: int = 0

    def make_task(self, muscle: Muscle, data: Measurements) -> FitData:
        """Return what is fitted to what, checked."""
        _check_names("each", self.each)
        check_integer("seed", self.seed, low=0)
        if check_integer("resamples", self.resamples, low=0, high=MOST_RESAMPLES) == 1:
            raise InputError("resamples is 1: it must be 2 or more, or 0 for none")
        if self.budget is not None:
            check_number("budget", self.budget, low=0.0, unit="s")
        task = FitData(
            muscle=muscle,
            data=data,
            response=data.response if self.response is None else self.response,
            ends=self.ends,
            anchored=self.anchored,
            each=tuple(self.each),
        )
        task.check()
        return task


DEFAULT_OPTIONS = FitOptions()
"""A fit with wide bounds."""

POOR_SHARE = 0.05
"""A fit is poor if it misses by more than this share of the span of the measured response."""
POOR_FACTOR = 2.0
"""It is not as long as it misses by less than so many standard deviations of repeated rows."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration(Result):
    """What a fit found, and how far it can be trusted.

    Parameters
    ----------
    model : str
        Name of the model.
    task : FitData
        What was fitted to what: response, data, end effects, what is each specimen's own.
    free : tuple of str
        The parameters that were fitted, the order of `correlations`; those of each specimen as
        ``name[specimen]``.
    units : dict
        Their units: mm, MPa, rad, or those on the model's card.
    estimates : dict
        Their values.
    standard_errors : dict
        Standard deviations of the estimates, linearised or of the resamples.
    intervals : dict
        95 % confidence intervals, with Student's t. They hold if the model is right and the blocks
        of `interval_rule` are independent. They are not cut at bounds.
    interval_rule : str
        Which rows the intervals take as independent, see `bozzini.numeric.estimation`: runs in the
        order of the table, within each specimen where it has constants of its own, or the specimens
        where these are 5 or more and have none.
    freedom : int
        Degrees of freedom of the covariance.
    correlations, covariance : ndarray, shape (k, k)
    condition : float
        Condition number of the Jacobian with columns of length 1.
    sigma : float
        Standard deviation of a row about the fit, ``sqrt(sum(r^2) / (n - k))`` [unit of the
        response].
    residuals : ndarray, shape (n,)
        Measured less fitted response [its unit]; `FitData.worst` where the model has no answer.
    answered : ndarray of bool, shape (n,)
        Which rows the model has an answer for.
    squares : float
        The sum of squares that was made small; in it residuals are over their standard errors, if
        these are known.
    scatter : float
        Mean logarithm of the variances of the rows, 0 if no errors are known.
    muscle : Muscle
        The muscle with the estimates in it.
    fitted : MuscleModel
        The model of that muscle, with the estimates of its own constants and end effects. What
        each specimen has its own value of is the mean of them.
    models : dict
        The model of each specimen; one model, of no name, if nothing tells specimens apart.
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
    task: FitData
    free: tuple[str, ...]
    units: dict[str, str]
    estimates: dict[str, float]
    standard_errors: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    interval_rule: str
    freedom: int
    correlations: NDArray[np.float64]
    covariance: NDArray[np.float64]
    condition: float
    sigma: float
    residuals: NDArray[np.float64]
    answered: NDArray[np.bool_]
    squares: float
    scatter: float
    muscle: Muscle
    fitted: MuscleModel
    models: dict[str, MuscleModel]
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
    def response(self) -> Response:
        """What was fitted."""
        return self.task.response

    @property
    def unit(self) -> str:
        """The unit of the response."""
        return self.task.unit

    @property
    def residual(self) -> float:
        """Standard deviation of a row about the fit [unit of the response], `sigma`."""
        return self.sigma

    def to_file(self) -> MuscleFile:
        """Return what a muscle file holds of the fit: what predicts a specimen that is not in it.

        What each specimen has its own value of is the mean of them, its variance that of one more
        specimen: of the mean, and among the specimens.
        """
        model, ends = self.fitted, None
        if isinstance(model, MountedMuscle):
            ends, model = model.ends, model.model
        names = tuple(dict.fromkeys(label.partition("[")[0] for label in self.free))
        share = np.zeros((len(names), len(self.free)))
        for column, label in enumerate(self.free):
            share[names.index(label.partition("[")[0]), column] = 1.0
        share /= share.sum(axis=1, keepdims=True)
        covariance = share @ self.covariance @ share.T
        np.fill_diagonal(covariance, np.maximum(np.diag(covariance), 0.0))  # of round-off
        specimens: dict[str, dict[str, float]] = {}
        for name in self.task.data.list_specimens() if len(self.models) > 1 else ():
            row = int(np.argmax(self.task.data.specimen == name))
            specimens[name] = {
                key: float(values[row]) for key, values in self.task.data.geometry.items()
            }
        for index, name in enumerate(names):
            own = [x for key, x in self.estimates.items() if key.partition("[")[0] == name]
            if len(own) > 1:
                covariance[index, index] += float(np.var(own, ddof=1)) * (1.0 + 1.0 / len(own))
            for specimen, known in specimens.items():
                label = label_unknown(name, specimen)
                if label in self.estimates:
                    known[name] = self.estimates[label]
        each = tuple(name for name in names if name in self.task.each)
        return MuscleFile(
            muscle=model.muscle,
            model=model.name,
            constants=list_constants(model),
            ends=ends,
            fit=FitSummary(
                response=self.response,
                names=names,
                covariance=tuple(map(tuple, np.clip(covariance, -1e15, 1e15).tolist())),
                shared=tuple(name for name in names if name not in each),
                each=each,
                specimens=specimens,
                source=self.task.data.source,
                rms=self.sigma,
                rows=len(self.residuals),
                freedom=self.freedom,
                anchored=self.task.anchored,
            ),
        )

    def predict(self, data: Measurements | pandas.DataFrame, *, level: float = 0.95) -> Prediction:
        """Return the response at states, with bands, see `bozzini.muscle.predict`."""
        return predict(self.to_file(), data, level=level)

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
            "response": self.response,
            "estimates": estimates,
            "held": self.held,
            "interval_rule": self.interval_rule,
            "correlations": self.correlations,
            "condition": self.condition,
            f"sigma_{self.unit}": self.sigma,
            "rows_answered": int(self.answered.sum()),
            "warnings": self.warnings,
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.residual,
            "muscle": describe_fields(self.muscle),
        }
        if isinstance(self.fitted, MountedMuscle):
            values["end_effects"] = describe_fields(self.fitted.ends)
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
        """Return the estimates as a table of text, angles in degrees, and what to know of them."""
        wide = max(16, *(len(name) + 1 for name in self.free))
        lines = []
        for name in self.free:
            ends = self.intervals[name]
            value, low, high, unit = show_estimate(
                self.estimates[name], ends, unit=self.units[name]
            )
            interval = f"95 %: {low} to {high}" if math.isfinite(ends[0]) else "not determined"
            lines.append(f"{name:<{wide}}{value:>10} {unit:<4} {interval}")
        lines.append(self.interval_rule)
        lines.append(
            f"residuals {self.sigma:.3g} {self.unit}, condition {self.condition:.1f}; "
            f"{'converged' if self.converged else 'not converged'}: {self.reason}"
        )
        lines += [f"{name}: {reason}" for name, reason in self.held.items()]
        return "\n".join([*lines, *(f"warning: {text}" for text in self.warnings)])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the fitted response over the measured one, by specimen, and return the axes."""
        task = self.task
        axes = take_axes(
            ax,
            x=f"measured {task.response} [{task.unit}]",
            y=f"fitted {task.response} [{task.unit}]",
        )
        fitted = task.measured - self.residuals
        for name in task.data.list_specimens():
            rows = (task.data.specimen == name) & self.answered
            axes.plot(task.measured[rows], fitted[rows], ".", label=name or "rows")
        ends = [task.measured.min(), task.measured.max()]
        axes.plot(ends, ends, "k-", linewidth=0.8)
        axes.legend()
        return axes


def show_estimate(
    value: float, interval: tuple[float, float], *, unit: str
) -> tuple[str, str, str, str]:
    """Return the texts of a value and of the ends of its interval, and their unit."""
    values = [value, *interval]
    if unit == "rad":  # people read angles in degrees
        values, unit = [math.degrees(each) for each in values], "deg"
    shown, low, high = show_apart(*values, digits=4)
    return shown, low, high, unit


def calibrate(
    model_class: Callable[..., MuscleModel],
    muscle: Muscle,
    *,
    data: Measurements | pandas.DataFrame,
    free: Sequence[str] | None = None,
    options: FitOptions = DEFAULT_OPTIONS,
) -> Calibration:
    """Fit parameters of a muscle so that the model's response meets the measured one.

    The response is the force, the contraction or the pressure, see `FitOptions.response`. The
    model is judged at every row. A row that it has no answer for counts with the span of the
    measured response, or the largest if that is more, so that no model gains by it; it is reported.
    Where the data have errors of their rows, residuals are weighted by them; with errors in several
    columns by the effective variance, see `bozzini.muscle.problem`.

    The default pair of `EnergyMuscle`, modulus and dead length, is well determined by one curve of
    contraction over pressure. Free the gap only with rows at low pressure, the braid angle only
    with rows under load or blocked, and the friction length only with both directions.

    A model of the catalogue has constants of its own. By default those are free that its source
    fitted or that it must be given and has not got, as far as the data determine them, and the
    modulus if the model has one. The search for them starts from a few points: the model's own
    guess, and others drawn about it. Those that the force is linear in come from linear least
    squares. The best two go on to a minimum. It can be one of several minima: another
    `FitOptions.seed` draws other points.

    A braid angle or modulus that the muscle has not is fitted in any case, and an inner radius held
    at a typical value, which `Calibration.held` states.

    Parameters
    ----------
    model_class : callable
        Makes the model from a `Muscle`: `EnergyMuscle`, a class of `MODELS`, or for example
        ``functools.partial(EnergyMuscle, ends="trellis")``, ``functools.partial(TonduLopez,
        kappa2=1.0)``.
    muscle : Muscle
        Where the fit starts, and the values of all that is neither free nor measured of the
        specimens.
    data : Measurements or DataFrame
    free : sequence of str, optional
        Fields of `Muscle`, constants of the model, and end effects (``offset``, ``compliance``,
        ``slack_force``) to fit.
    options : FitOptions
        Response, specimens, end effects, bounds and starts.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        If a parameter is unknown or has no effect, if there are too few rows, if the data cannot
        distinguish the parameters (unless `force`), or if the model has no answer for any row.
    MissingLawError
        If the model needs a law that is not given.
    """
    check_muscle(muscle)
    task = options.make_task(muscle, take_measurements(data, muscle=muscle))
    return fit_task(model_class, task, free=free, options=options)


def fit_task(
    model_class: Callable[..., MuscleModel],
    task: FitData,
    *,
    free: Sequence[str] | None,
    options: FitOptions,
    clock: Clock | None = None,
) -> Calibration:
    """Return the fit of a task, as `calibrate` does."""
    own = list_own(model_class)
    clock = Clock(options.budget) if clock is None else clock
    given = task.muscle
    task, unset = settle_unset(model_class, task)
    build, names, held = choose_free(free, model_class, task, unset)
    task = dataclasses.replace(task, muscle=task.muscle.fill(names))
    held |= _describe_typical(model_class, given, task.muscle, names)
    never, _ = judge_parameters(names, task.data)
    if never and not (options.force or unset):
        raise InputError("; ".join(never))
    limits = choose_bounds(names, task, options.bounds, own)
    if task.response == "contraction":
        widest = limits[names.index("braid_angle"), 1] if "braid_angle" in names else None
        if not task.data.geometry:
            task.data.check_lengths(task.muscle, braid_angle=widest)
    problem = Problem(
        model_class=build,
        task=task,
        free=names,
        limits=limits,
        constants=choose_constants(model_class, task.muscle, names, limits, own, options.start),
        clock=clock,
    )
    found, problem = _find_best(problem, own, options)
    return conclude(problem, found, held=held, options=options)


def _describe_typical(
    model_class: Callable[..., MuscleModel], given: Muscle, filled: Muscle, free: Sequence[str]
) -> dict[str, str]:
    """Return why fields that are not given have the value they have."""
    unused = (*free, *list_unused(model_class))
    return {
        name: f"not given, so held at a typical value, {getattr(filled, name):g} mm"
        for name in HELD_UNSET
        if name in given.unset and name not in unused
    }


def _find_best(
    problem: Problem, own: Mapping[str, Parameter], options: FitOptions
) -> tuple[Minimum, Problem]:
    """Return the best of the searches from a few starts, and the problem as it was begun."""
    begin = problem.choose_start()
    if not problem.constants:
        if problem.task.response == "contraction" or len(problem.unknowns) == 1:
            _demand_answer(problem, begin)
            _check_effect(problem.unknowns, _find_idle(problem.measure_jacobian(begin)))
            return find_minimum(problem, begin), problem
        starts = find_starts(problem, linear=(), seed=options.seed, count=2)
        return find_constants([problem, *starts])
    if not set(problem.constants) - set(options.start):
        return find_constants([problem])
    linear = tuple(name for name in problem.constants if own[name].linear)
    return find_constants([*find_starts(problem, linear=linear, seed=options.seed), problem])


def _demand_answer(problem: Problem, point: NDArray[np.float64]) -> None:
    """Raise `InputError` if the model has no answer at any row."""
    if problem.evaluate(point)[1].any():
        return
    task = problem.task
    model = problem.build(problem.name_values(point))
    reason = explain_gap(model, task.data.select(task.parts[0].rows), task.response)
    raise InputError(reason or "the model has no answer for any row")


def _find_idle(jacobian: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which unknowns have no effect, by derivatives (n, k) in their scales."""
    return np.asarray(~(np.abs(jacobian).max(axis=0) > 1e-9))


def _check_effect(names: Sequence[str], idle: NDArray[np.bool_]) -> None:
    if idle.any():
        lost = [name for name, none in zip(names, idle, strict=True) if none]
        what = "it cannot be fitted" if len(lost) == 1 else "they cannot be fitted"
        verb = "has" if len(lost) == 1 else "have"
        raise InputError(f"{' and '.join(lost)} {verb} no effect at these rows: {what}")


def find_poor(task: FitData) -> float:
    """Return the root mean square above which a fit is poor [unit of the response].

    It is 5 % of the span of the measured response, or twice the standard deviation of rows that
    repeat a state if there are any and that is more.
    """
    pure, states = measure_repeats(task)
    freedom = len(task.data) - states
    noise = float(np.sqrt(pure / freedom)) if freedom else 0.0
    return max(POOR_SHARE * task.span, POOR_FACTOR * noise)


def judge_size(task: FitData, residuals: NDArray[np.float64]) -> list[str]:
    """Return a warning if a fit is poor in absolute terms, see `find_poor`."""
    rms, most = float(np.sqrt(np.mean(residuals**2))), find_poor(task)
    if rms <= most:
        return []
    off, above = show_apart(rms, most, digits=3)
    return [
        f"the fit is poor: it is off by {off} {task.unit}, {100.0 * rms / task.span:.0f} % of "
        f"the span of the measured {task.response}, {task.span:.3g} {task.unit}; above "
        f"{above} {task.unit} it is poor"
    ]


def conclude(
    problem: Problem, found: Minimum, *, held: dict[str, str], options: FitOptions
) -> Calibration:
    """Put the statistics together from the residuals and the Jacobian at the minimum."""
    task, unknowns = problem.task, problem.unknowns
    values = problem.name_values(found.point)
    miss, answered, errors = problem.compare(values)
    if not answered.any():
        _demand_answer(problem, found.point)
    models = {part.specimen: problem.build(values, i) for i, part in enumerate(task.parts)}
    shared = {
        name: float(np.mean([values[pairs[name]] for pairs in map(dict, problem.of_part)]))
        for name in problem.free
    }
    fitted = next(iter(models.values()))
    if len(models) > 1 or problem.task.each:
        fitted = _build_mean(problem, shared, models)
    count, rows = len(unknowns), len(task.data)
    residuals = np.where(answered, -miss, task.worst)
    weighted = residuals if errors is None else residuals / errors
    squares = float(weighted @ weighted)
    freedom = rows - count
    sigma = float(np.sqrt(residuals @ residuals / freedom))
    scaled = np.where(answered[:, None], found.slope, 0.0)
    idle = _find_idle(scaled)
    own = np.array([name not in END_FIELDS for name in problem.names])
    if (idle & own).any() and not options.force:  # where the search began as well as where it ended
        _check_effect(
            unknowns, idle & own & _find_idle(problem.measure_jacobian(problem.choose_start()))
        )
    jacobian = scaled / problem.scales
    known_by = determine(jacobian)
    correlations, condition = known_by.correlations, known_by.condition
    blocks = _make_blocks(task)
    spread = measure_spread(jacobian, weighted, blocks, lost=True)
    short: list[str] = []
    drawn = _resample(problem, found.point, options, blocks) if options.resamples else []
    enough = len(drawn) > min(count, options.resamples - 1)
    if len(drawn) < options.resamples:
        short = [
            f"the time of the fit is used up after {len(drawn)} of {options.resamples} resamples"
            + ("" if enough else ": the errors are linearised")
        ]
    if options.resamples and enough:
        covariance = np.atleast_2d(np.cov(np.array(drawn), rowvar=False))
        spread = dataclasses.replace(spread, covariance=covariance)
    covariance, deviations = spread.covariance, spread.deviations
    spreads = dict(zip(unknowns, np.where(idle, np.inf, deviations).tolist(), strict=True))
    scales = np.maximum(deviations, 1e-150)
    shown = np.clip(covariance / np.outer(scales, scales), -1.0, 1.0)
    np.fill_diagonal(shown, 1.0)
    known = ALL_UNITS | {item.name: item.unit for item in list_parameters(problem.model_class)}
    contact = float(fitted.dead_band()) if "gap" in problem.free else 0.0
    never, doubts = judge_parameters(problem.free, task.data, contact_pressure=contact)
    lost = [
        f"{label} has no effect at these rows: its value means nothing"
        for label, none in zip(unknowns, idle, strict=True)
        if none
    ]
    gaps = []
    if not answered.all():
        row = int(np.argmin(answered))
        part = next(part for part in task.parts if row in part.rows)
        why = explain_gap(models[part.specimen], task.data.select([row]), task.response)
        gaps = [f"the model has an answer at {int(answered.sum())} of {rows} rows; {why}"]
    return Calibration(
        model=fitted.name,
        task=task,
        free=unknowns,
        units={label: known[name] for label, name in zip(unknowns, problem.names, strict=True)},
        estimates=values,
        standard_errors=spreads,
        intervals={
            name: (value - spread.factor * spreads[name], value + spread.factor * spreads[name])
            for name, value in values.items()
        },
        interval_rule=spread.describe(),
        freedom=spread.freedom,
        correlations=shown,
        covariance=covariance,
        condition=condition,
        sigma=sigma,
        residuals=residuals,
        answered=answered,
        squares=squares,
        scatter=0.0 if errors is None else float(np.mean(2.0 * np.log(errors))),
        muscle=fitted.muscle,
        fitted=fitted,
        models=models,
        held=held,
        warnings=(
            *never,
            *doubts,
            *describe_bounds(unknowns, found.sides != 0),
            *lost,
            *gaps,
            *short,
            *judge_fit(unknowns, correlations, condition),
            *judge_repeats(task, residuals, parameters=count, errors=errors),
            *judge_size(task, residuals),
        ),
        converged=found.converged,
        reason=explain_end(found.status, EVALUATIONS),
        evaluations=found.evaluations,
    )


def _build_mean(
    problem: Problem, shared: Mapping[str, float], models: Mapping[str, MuscleModel]
) -> MuscleModel:
    """Return the model of the task's muscle, with the mean of what specimens have of their own."""
    offsets = [model.ends.offset for model in models.values() if isinstance(model, MountedMuscle)]
    task = problem.task
    if task.anchored and offsets:
        task = dataclasses.replace(task, ends=task.ends.replace(offset=float(np.mean(offsets))))
    try:
        return assemble(problem.model_class, task.muscle, shared, task=task, anchor=None)
    except BozziniError:  # the values are those of other geometries
        return next(iter(models.values()))


def _make_blocks(task: FitData) -> Blocks:
    """Return which rows count as independent."""
    return make_blocks(task.data.specimen, apart=bool(task.each), noun="specimens")


def _resample(
    problem: Problem, point: NDArray[np.float64], options: FitOptions, blocks: Blocks
) -> list[list[float]]:
    """Return the fits to blocks of rows drawn with replacement, until time is up.

    Where specimens have constants of their own they are drawn within each specimen.
    """
    random = np.random.default_rng(options.seed)
    task: FitData = problem.task
    groups = [part.rows for part in task.parts] if task.each else [np.arange(len(task.data))]
    found: list[list[float]] = []
    for _ in range(options.resamples):
        data = task.data.select(draw_rows(blocks, groups, random=random))
        again = dataclasses.replace(problem, task=dataclasses.replace(task, data=data))
        start = again.move(problem.name_values(point))
        end = find_minimum(start, start.choose_start(), limit=_SECOND)
        if end.status == OUT_OF_TIME:  # it is where it began, as all that follow would be
            break
        found.append(list(start.name_values(end.point).values()))
    return found
