"""Constants fitted to rows of measurements: declared, found, and how far they can be trusted.

What is fitted is declared by name (`FitParameter`): free or fixed, one value for all rows or one
for each of some groups, with bounds and a scale. `estimate` makes the squares of the misfits small,
or a robust loss of them, and an `Estimation` says what came of it: values with intervals by blocks
of rows, what is not determined, what is at a bound, and what the fit misses rows by that it has
not seen. For a fit with searches of its own there is `bozzini.numeric.least_squares`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer, check_number, check_word
from ..errors import InputError
from .arrays import Floats
from .estimation import (
    LEAST_LABELS,
    Blocks,
    Determination,
    FitCovariance,
    Places,
    describe_lost,
    determine,
    draw_rows,
    find_lost,
    judge_fit,
    make_blocks,
    measure_spread,
)
from .least_squares import (
    OUT_OF_TIME,
    ROBUST,
    Clock,
    LeastSquares,
    Loss,
    Minimum,
    describe_bounds,
    explain_end,
    measure_scatter,
    weigh,
)

Misfit = Callable[[Mapping[str, Floats], Places], Floats]
"""Returns what rows (m,) are missed by, (m,) or (m, q), with values by name.

A value has no axis, or one with an entry for each group of the parameter. A row may be there twice.
"""

EVALUATIONS = 200
"""Largest number of evaluations of one search."""

_TRIAL = 15  # evaluations from each start, where there are several
_REACH = 10.0  # scales by which further starts are off where there are no bounds
_TINY = float(np.finfo(np.float64).eps)  # least slope of an influence, as SciPy has it


@dataclass(frozen=True)
class FitParameter:
    """A constant of a fit.

    Parameters
    ----------
    name : str
    start : float
        Where the search begins; the value where it is fixed.
    low, high : float
        Bounds.
    scale : float, optional
        How much of it matters: steps of differences and further starts go by it. A tenth of the
        start, or 0.1, without.
    fixed : bool
        Whether it stays at its start.
    groups : tuple of str
        Names of what has a value each: muscles, or labels of the rows; one value without.

    Raises
    ------
    InputError
        If the bounds are no range, the start is outside of them, the scale is not positive, or a
        group is named twice.
    """

    name: str
    start: float
    _: KW_ONLY
    low: float = -math.inf
    high: float = math.inf
    scale: float | None = None
    fixed: bool = False
    groups: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise InputError(
                f"bounds of {self.name} are {self.low:g} and {self.high:g}: the first must be less"
            )
        check_number(f"start of {self.name}", self.start, low=self.low, high=self.high)
        if self.scale is not None:
            check_number(f"scale of {self.name}", self.scale, low=0.0, low_open=True)
        if len(set(self.groups)) < len(self.groups):
            raise InputError(f"groups of {self.name} are {', '.join(self.groups)}: each once")

    @property
    def labels(self) -> tuple[str, ...]:
        """Its name, or one with each group: ``name[group]``."""
        return tuple(f"{self.name}[{group}]" for group in self.groups) or (self.name,)

    @property
    def size(self) -> float:
        """The scale."""
        return 0.1 * abs(self.start) or 0.1 if self.scale is None else self.scale


@dataclass(frozen=True, kw_only=True)
class EstimateOptions:
    """How constants are looked for.

    Parameters
    ----------
    loss : {"linear", "soft_l1", "huber"}
        The robust ones follow a fit by least squares, and count a misfit above 1.5 times its
        scatter less than by its square.
    starts : int
        Starts of the search: that declared, and others at random between the bounds, or about it
        where there are none; those at which a misfit is not finite are left out.
    budget : float, optional
        Seconds of one search [s].
    """

    loss: Loss = "linear"
    starts: int = 1
    budget: float | None = None

    def __post_init__(self) -> None:
        check_word("loss", self.loss, get_args(Loss))
        check_integer("starts", self.starts, low=1)
        if self.budget is not None:
            check_number("budget", self.budget, low=0.0, low_open=True, unit="s")


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimation:
    """Constants that were fitted, and how far they can be trusted.

    Parameters
    ----------
    task : FitTask
        What was fitted to what.
    point : ndarray, shape (k,)
        Values of the unknowns, in the order of `names`.
    misfit : ndarray, shape (n,) or (n, q)
        What the rows are missed by.
    slope : ndarray, shape (n q, k)
        Derivatives of the misfits.
    loss_scale : float
        Misfit from which a robust loss counts less than the square.
    spread : FitCovariance
        Covariance of the unknowns.
    at_bound : ndarray of bool, shape (k,)
    status, evaluations : int
        As of `Minimum`.
    """

    task: FitTask
    point: Floats
    misfit: Floats
    slope: Floats
    loss_scale: float
    spread: FitCovariance
    at_bound: NDArray[np.bool_]
    status: int
    evaluations: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns; ``name[group]`` where a parameter has groups."""
        return self.task.names

    @property
    def values(self) -> dict[str, Floats]:
        """All parameters by name, without an axis or with one of groups."""
        return self.task.name_values(self.point)

    @cached_property
    def known(self) -> Determination:
        """How far the rows determine the unknowns: condition and correlations."""
        return determine(self.slope)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Sets of unknowns that the rows do not determine, a sentence each."""
        return tuple(describe_lost(self.names, self.known))

    @property
    def deviations(self) -> Floats:
        """Standard errors (k,); infinite where the rows do not determine an unknown."""
        lost = [i for members, _ in find_lost(self.known) for i in members]
        deviations = self.spread.deviations
        deviations[lost] = math.inf
        return deviations

    @property
    def intervals(self) -> Floats:
        """Ends of the 95 % intervals (k, 2), cut at the bounds."""
        half = self.spread.factor * self.deviations
        low, high = self.task.bounds
        ends = np.stack([self.point - half, self.point + half], axis=1)
        return np.clip(ends, low[:, None], high[:, None])

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the values suffer from; what is not determined is in `undetermined`."""
        found = describe_bounds(self.names, self.at_bound)
        if not self.undetermined:
            found += judge_fit(self.names, self.known.correlations, self.known.condition)
        count = len(np.unique(self.task.labels))
        if 1 < count < LEAST_LABELS and not self.task.is_apart:
            found.append(
                f"{count} groups do not tell how groups differ, {LEAST_LABELS} would: the "
                "intervals are too short if rows of a group err alike"
            )
        return tuple(found)

    @property
    def converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return self.status > 0

    @property
    def reason(self) -> str:
        """Why the search ended."""
        return explain_end(self.status, EVALUATIONS)

    @property
    def residual(self) -> float:
        """Root mean square of the misfits."""
        return float(np.sqrt(np.mean(self.misfit**2)))

    def leave_out(self) -> Floats:
        """Return what rows are missed by, (n,) or (n, q), each by the fit to all other groups.

        A value that only the group left out has is the mean of those of the other groups, or where
        the search began if there are none.

        Raises
        ------
        InputError
            If all rows are of one group.
        """
        labels = self.task.labels
        groups = np.unique(labels)
        if len(groups) < 2:
            raise InputError(f"all rows are of the group {str(labels[0])!r}: it cannot be left out")
        misfit = np.empty_like(self.misfit)
        for group in groups:
            rows = np.flatnonzero(labels == group)
            found = self._fit_again(np.flatnonzero(labels != group))
            values = self.task.name_values(self.task.fill_idle(found))
            misfit[rows] = self.task.misfit(values, rows)
        return misfit

    def resample(self, count: int, *, seed: int = 0) -> FitCovariance:
        """Return the covariance by fits to blocks of rows drawn with replacement.

        Within each label of rows where these have values of their own.

        Raises
        ------
        InputError
            If there are no more draws than unknowns, or the time of a fit is used up.
        """
        check_integer("count", count, low=len(self.names) + 1)
        random, task = np.random.default_rng(seed), self.task
        parts = [np.arange(len(task.labels))]
        if task.is_apart:
            parts = [np.flatnonzero(task.labels == group) for group in np.unique(task.labels)]
        points = []
        for _ in range(count):
            found = self._fit_again(draw_rows(task.blocks, parts, random=random))
            if found.status == OUT_OF_TIME:  # it is where it began
                raise InputError(f"the budget of {task.options.budget:g} s is too short for a fit")
            points.append(task.place(found))
        covariance = np.atleast_2d(np.cov(np.array(points), rowvar=False))
        return replace(self.spread, covariance=covariance)

    def _fit_again(self, rows: Places) -> Minimum:
        """Return the fit to some rows, begun at that to all."""
        search = self.task.make_search(rows, self.loss_scale)
        return search.descend(self.point / self.task.scales, evaluations=EVALUATIONS)


@dataclass(frozen=True, kw_only=True, eq=False)
class FitTask:
    """Parameters, and the misfits of rows that depend on them; see `estimate`."""

    misfit: Misfit
    parameters: tuple[FitParameter, ...]
    labels: NDArray[np.str_]
    options: EstimateOptions

    @cached_property
    def _unknowns(self) -> list[tuple[str, FitParameter]]:
        return [(name, one) for one in self.parameters if not one.fixed for name in one.labels]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(name for name, _ in self._unknowns)

    @property
    def start(self) -> Floats:
        """Where the search begins (k,)."""
        return np.array([one.start for _, one in self._unknowns])

    @cached_property
    def scales(self) -> Floats:
        """How much of each unknown matters (k,)."""
        return np.array([one.size for _, one in self._unknowns])

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Smallest and largest values, (k,) each."""
        ends = [(one.low, one.high) for _, one in self._unknowns]
        low, high = np.array(ends, dtype=np.float64).T
        return low, high

    @property
    def is_apart(self) -> bool:
        """Whether labels of rows are groups of a parameter, with values of their own."""
        labels = set(self.labels.tolist())
        return any(labels.intersection(one.groups) for _, one in self._unknowns)

    @cached_property
    def blocks(self) -> Blocks:
        """Which rows count as independent."""
        return make_blocks(self.labels, apart=self.is_apart, noun="groups")

    def name_values(self, point: Floats) -> dict[str, Floats]:
        """Return the parameters by name, with values (k,) of the unknowns."""
        known = dict(zip(self.names, point, strict=True))
        return {
            one.name: np.array([known.get(name, one.start) for name in one.labels]).reshape(
                (len(one.groups),) if one.groups else ()
            )
            for one in self.parameters
        }

    def place(self, found: Minimum) -> Floats:
        """Return the values (k,) at the end of a search."""
        return np.asarray(np.clip(found.point * self.scales, *self.bounds))

    def fill_idle(self, found: Minimum) -> Floats:
        """Return values (k,) in which what no row depends on has the mean of other groups."""
        point, acts = self.place(found), np.asarray(found.slope.any(axis=0))
        kin = [one for _, one in self._unknowns]
        for index in np.flatnonzero(~acts):
            own = [i for i, one in enumerate(kin) if one is kin[index] and acts[i]]
            point[index] = point[own].mean() if own else kin[index].start
        return point

    def make_search(self, rows: Places, loss_scale: float = 0.0) -> LeastSquares:
        """Return the search for a fit to rows, in units of the scales; 0 is for no robust loss."""
        low, high = self.bounds

        def miss(x: Floats) -> Floats:
            values = self.name_values(np.clip(x * self.scales, low, high))
            return self.misfit(values, rows).ravel()

        return LeastSquares(
            misfit=miss,
            bounds=(low / self.scales, high / self.scales),
            scale="jac",
            loss=self.options.loss if loss_scale else "linear",
            loss_scale=loss_scale or 1.0,
            clock=Clock(self.options.budget),
        )

    def draw_starts(self) -> list[Floats]:
        """Return where searches begin, in units of the scales: as declared, and at random."""
        random, (low, high) = np.random.default_rng(0), self.bounds
        bounded = np.isfinite(high - low)
        starts = [self.start]
        for _ in range(self.options.starts - 1):
            off = self.start + _REACH * self.scales * random.normal(size=len(self.scales))
            even = random.uniform(np.where(bounded, low, 0.0), np.where(bounded, high, 1.0))
            starts.append(np.clip(np.where(bounded, even, off), low, high))
        return [start / self.scales for start in starts]


def estimate(
    misfit: Misfit,
    parameters: Sequence[FitParameter],
    *,
    labels: Sequence[str] | NDArray[np.str_],
    options: EstimateOptions | None = None,
) -> Estimation:
    """Fit constants so that the squares of misfits are small, or a robust loss of them.

    Parameters
    ----------
    misfit : callable
        Returns what rows are missed by, with values of the parameters by name; see `Misfit`.
    parameters : sequence of FitParameter
    labels : sequence of str, shape (n,)
        Group of each row: its run, or its specimen. Groups, or runs of rows, are the blocks of the
        intervals (`make_blocks`), and `Estimation.leave_out` leaves groups out.
    options : EstimateOptions, optional

    Raises
    ------
    InputError
        If two parameters have one name, none is free, there are no more misfits than unknowns, a
        misfit is not finite where the search begins, or a derivative on the way.
    """
    task = FitTask(
        misfit=misfit,
        parameters=tuple(parameters),
        labels=np.asarray(labels, dtype=np.str_),
        options=EstimateOptions() if options is None else options,
    )
    every, count = [one.name for one in parameters], len(task.names)
    if len(set(every)) < len(every):
        raise InputError(f"parameters are {', '.join(every)}: each must have a name of its own")
    if not count:
        raise InputError("no parameter is free: name one or more")
    rows = np.arange(len(task.labels))
    first = misfit(task.name_values(task.start), rows)
    if len(rows) and first.size % len(rows):
        raise InputError(f"there are {first.size} misfits of {len(rows)} rows: each has as many")
    if first.size <= count:
        raise InputError(f"{first.size} misfit(s) are too few for {count} unknown(s)")
    if lost := np.flatnonzero(~np.isfinite(first)).tolist():
        row = 1 + lost[0] * len(rows) // first.size
        raise InputError(f"the misfit of row {row} is not finite where the search begins")
    search = task.make_search(rows)
    starts = task.draw_starts()
    starts[1:] = [start for start in starts[1:] if np.isfinite(search.misfit(start)).all()]
    trial = _TRIAL if len(starts) > 1 else None
    found = search.search(starts, evaluations=EVALUATIONS, trial=trial)
    evaluations, loss_scale = found.evaluations, 0.0
    if task.options.loss != "linear" and found.status != OUT_OF_TIME:
        loss_scale = ROBUST * measure_scatter(found.misfit)
    if loss_scale:
        search = task.make_search(rows, loss_scale)
        found = search.descend(found.point, evaluations=EVALUATIONS)
        evaluations += found.evaluations
    weights = weigh(found.misfit / search.loss_scale, search.loss)
    slope = found.slope / np.sqrt(np.maximum(weights[1], _TINY))[:, None] / task.scales
    of_misfit = np.repeat(rows, first.size // len(rows))
    return Estimation(
        task=task,
        point=task.place(found),
        misfit=found.misfit.reshape(first.shape),
        slope=slope,
        loss_scale=loss_scale,
        spread=measure_spread(slope, found.misfit, task.blocks, rows=of_misfit, weights=weights),
        at_bound=found.sides != 0,
        status=found.status,
        evaluations=evaluations,
    )
