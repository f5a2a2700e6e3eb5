"""The search for numbers of a robot by which points of its body are where they were measured."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer, check_kind, check_word
from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.least_squares import ROBUST, LeastSquares, Loss, measure_scatter, weigh
from ..results import Shown
from .dynamics import DynamicsOptions
from .observation import Observation, Observed
from .robot_prediction import fill_gaps
from .unknowns import FIELDS, Unknown

Split = Literal["blocks", "random", "kinds", "amplitude"]
EVALUATIONS = 60
"""Largest number of evaluations of one search, derivatives apart."""
FLAT = 1e-3
"""Gradient of half the sum of squares that counts as none [mm^2]."""
NEARLY_NONE = 1e-3
"""Largest change from which a search begins as from none: its first step is as large as that."""
LEAST_SCATTER_MM = 1e-4
"""Scatter below which all misfits count alike [mm]."""
IDLE = 0.01
"""Share of the scatter: a number that moves points by less, all over its range, has no effect."""
HALF = 0.5
"""Weight of a coordinate below which its row is reported."""


@dataclass(frozen=True, kw_only=True)
class RobotFitOptions(Shown):
    """How a robot is fitted, and validated.

    Parameters
    ----------
    model : str, optional
        Name of the model; by default ``energy`` for displacements of a robot without weight,
        ``rod`` otherwise.
    model_options : mapping
        Options of the model; ``segment="channel"`` unless given, for the energy model.
    loss : {"soft_l1", "huber", "linear"}
        What of each coordinate's misfit is summed, as of `scipy.optimize.least_squares`. The
        robust ones count a misfit above 1.5 times the scatter less than by its square.
    folds : int
        Blocks of rows that are left out in turn, and predicted; 0 for none. Where nothing is free
        there is nothing to leave out of.
    split : {"blocks", "random", "kinds", "amplitude"}
        Whether blocks are runs of rows, drawn at random, the kinds of motion: the sections that
        bend together, or by how far sections bend: of the last block, the furthest, the error is
        that of an extrapolation. A random split is refused where rows that follow each other
        are alike: there it tests no prediction. Labels of the data, if there are any, take the
        place of runs.
    residual : bool
        Whether what the fit leaves over is learned on top of it, see `SectionResidual`.
    smaller : bool
        Whether fits of fewer constants are tried on the blocks left out.
    jobs : int
        Processes at the same time.
    dynamics : DynamicsOptions, optional
        How the robot moves, for rows of a motion from rest under the first command; None of shapes
        at rest.
    """

    model: str = ""
    model_options: Mapping[str, object] = field(default_factory=dict)
    loss: Loss = "soft_l1"
    folds: int = 4
    split: Split = "blocks"
    residual: bool = False
    smaller: bool = True
    jobs: int = 1
    dynamics: DynamicsOptions | None = None

    def __post_init__(self) -> None:
        if self.dynamics is not None:
            check_kind("dynamics", self.dynamics, DynamicsOptions)
            if self.model or self.model_options:
                raise InputError(
                    "a model of shapes at rest is given for a fit in time: leave it out"
                )
        check_word("loss", self.loss, get_args(Loss))
        check_word("split", self.split, get_args(Split))
        check_integer("jobs", self.jobs, low=1)
        if check_integer("folds", self.folds, low=0) == 1:
            raise InputError("folds is 1: it must be 2 or more, or 0 for none")
        if self.residual and not self.folds:
            raise InputError(
                "folds is 0: a residual is chosen by blocks left out, which must be 2 or more"
            )


DEFAULT_OPTIONS = RobotFitOptions()


@dataclass(frozen=True)
class FitSearch:
    """Unknowns of an observation, where they are looked for from, and what is made small."""

    observation: Observation
    unknowns: tuple[Unknown, ...]
    loss: Loss
    scale: float = 1.0

    def miss(self, found: Observed) -> Floats:
        """Return predicted less measured coordinates that were seen, as one row [mm]."""
        return fill_gaps(found.points, self.observation.measured)[self.seen]

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which coordinates were seen, (n, m, 3)."""
        return np.asarray(np.isfinite(self.observation.measured))

    @property
    def limits(self) -> tuple[Floats, Floats, Floats]:
        """Bounds of the changes, and where a search begins, (k,) each."""
        rows = [one.limit(self.observation.setup) for one in self.unknowns]
        low, high, begin = np.asarray(rows, dtype=np.float64).reshape(-1, 3).T
        return low, high, begin

    def run(self, start: Floats, *, loss: Loss, limit: int = EVALUATIONS) -> FoundChanges:
        """Return where the search ends."""
        low, high, _ = self.limits
        last: list[tuple[Floats, Observed]] = []

        def observe(changes: Floats) -> Observed:
            if not last or not np.array_equal(last[0][0], changes):
                last[:] = [(changes.copy(), self.observation.change(self.unknowns, changes))]
            return last[0][1]

        def slope(changes: Floats) -> Floats:
            rates = self.observation.differentiate(self.unknowns, changes, observe(changes))
            return np.nan_to_num(rates[self.seen])

        if self.unknowns and np.abs(start).max() < NEARLY_NONE:
            start = np.zeros_like(start)
        if not self.unknowns:
            found = observe(start)
            return FoundChanges(start, found, np.zeros((int(self.seen.sum()), 0)), 1, 1)
        search = LeastSquares(
            misfit=lambda changes: self.miss(observe(changes)),
            slope=slope,
            bounds=(low, high),
            scale="jac",
            loss=loss,
            loss_scale=self.scale,
            xtol=1e-6,
            ftol=1e-6,
            gtol=FLAT,
        )
        end = search.descend(np.clip(start, low, high), evaluations=limit)
        return FoundChanges(
            end.point, observe(end.point), slope(end.point), end.status, end.evaluations
        )


@dataclass(frozen=True)
class FoundChanges:
    """Where a search ended: changes, what they predict, and derivatives."""

    changes: Floats
    observed: Observed
    jacobian: Floats
    status: int
    evaluations: int


def search_all(search: FitSearch) -> tuple[FoundChanges, FitSearch]:
    """Return the best fit to all rows, and how it was searched for at the end."""
    start = search.limits[2]
    first = search.run(start, loss="linear")
    scatter = measure_scatter(search.miss(first.observed))
    if search.loss == "linear" or not search.unknowns or scatter < LEAST_SCATTER_MM:
        return first, dataclasses.replace(search, loss="linear")
    robust = dataclasses.replace(search, scale=ROBUST * scatter)
    found = robust.run(first.changes, loss=search.loss)
    evaluations = found.evaluations + first.evaluations
    return dataclasses.replace(found, evaluations=evaluations), robust


def leave_idle(search: FitSearch, found: FoundChanges) -> FoundChanges:
    """Return the fit with numbers that have no effect as they were, their derivatives 0.

    Such derivatives are round-off of the model: they would be scaled to length 1.
    """
    low, high, _ = search.limits
    width = np.where(np.isfinite(high - low), 0.5 * (high - low), search.observation.data.span)
    scatter = float(np.sqrt(np.mean(search.miss(found.observed) ** 2)))
    least = max(IDLE * scatter, LEAST_SCATTER_MM)
    moved = width * np.sqrt(np.mean(found.jacobian**2, axis=0))
    for index in np.flatnonzero(moved <= least):
        changes, jacobian = found.changes.copy(), found.jacobian.copy()
        changes[index], jacobian[:, index] = 0.0, 0.0
        observed = search.observation.change(search.unknowns, changes)
        both = observed.answered & found.observed.answered
        apart = (observed.points - found.observed.points)[search.seen & both[:, None, None]]
        if np.linalg.norm(apart) <= least * np.sqrt(apart.size):  # else it acts elsewhere
            found = dataclasses.replace(
                found, changes=changes, observed=observed, jacobian=jacobian
            )
    return found


def find_outliers(search: FitSearch, found: FoundChanges) -> tuple[int, ...]:
    """Return the rows of the data with a coordinate of less than half weight."""
    weight, _ = weigh(search.miss(found.observed) / search.scale, search.loss)
    rows = np.broadcast_to(search.observation.rows[:, None, None], search.seen.shape)
    return tuple(np.unique(rows[search.seen][weight < HALF]).tolist())


def frees_base(unknowns: Sequence[Unknown]) -> bool:
    """Return whether all of the base's pose is free."""
    return sum(one.group == "base" for one in unknowns) == len(FIELDS["base"])
