"""What rows left out of a fit of a robot tell: errors, baselines, and fewer constants."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.processes import open_processes
from ..results import Shown
from .command_baselines import predict_by_commands
from .fit_search import FitSearch, FoundChanges, RobotFitOptions, frees_base
from .kinematics import ContinuumRobot
from .measured import RobotMeasurements
from .prediction_band import name_kinds
from .robot_prediction import fill_gaps, measure_rms
from .section_residual import SectionStates, learn_residual
from .unknowns import change_setup

FEWEST_OF_KIND = 10
"""Rows of a kind of motion from which on it is left out as a block."""
Folds = tuple[NDArray[np.int64], ...]
"""The rows of each block that is left out."""


@dataclass(frozen=True)
class Validation(Shown):
    """Blocks of rows left out in turn, and predicted by the fit to the others.

    Parameters
    ----------
    names : tuple of str
        What was fitted.
    rms : float
        Root mean square distance over all rows, each left out once [mm].
    blocks : tuple of float
        The same of each block.
    labels : tuple of str
        What each block is; empty for runs of rows.
    """

    names: tuple[str, ...]
    rms: float
    blocks: tuple[float, ...]
    labels: tuple[str, ...] = ()

    def beats(self, other: Validation) -> bool:
        """Return whether its errors of the same blocks are less than those of another.

        The mean of the blocks' differences must be above its standard error, which is their
        standard deviation over the root of their number; and the error over all rows no larger.
        """
        gains = np.subtract(other.blocks, self.blocks)
        error = float(np.std(gains, ddof=1)) / math.sqrt(len(gains))
        return self.rms <= other.rms and bool(gains.mean() > error)


def make_folds(data: RobotMeasurements, options: RobotFitOptions) -> Folds:
    """Return the rows of each block that is left out.

    Raises
    ------
    InputError
        If there are too few rows or labels, or a random split tests no prediction.
    """
    if not options.folds:
        return ()
    rows = data.seen_rows
    labels = np.unique(data.blocks[rows])
    if options.split == "random":
        if data.is_ordered:
            raise InputError(
                "a random split tests no prediction of rows in time order, whose neighbours are "
                "alike: leave out blocks"
            )
        rows = np.random.default_rng(0).permutation(rows)
    elif len(labels) > 1:
        return tuple(rows[data.blocks[rows] == label] for label in labels)
    if len(rows) < options.folds:
        legal = f"2 to {len(rows)}, or 0 for none" if len(rows) > 1 else "0 for none"
        raise InputError(
            f"{len(rows)} row(s) are too few for {options.folds} folds: --folds must be {legal}"
        )
    return tuple(np.sort(part) for part in np.array_split(rows, options.folds))


def name_sections(robot: ContinuumRobot) -> tuple[str, ...]:
    """Return the names of the sections, those without one by their numbers."""
    return tuple(section.name or str(k + 1) for k, section in enumerate(robot.sections))


def label_blocks(data: RobotMeasurements, folds: Folds) -> tuple[str, ...]:
    """Return the labels that the data give the rows of each block; none if these are runs."""
    labels = tuple(str(data.blocks[fold[0]]) for fold in folds)
    return labels if len(set(labels)) > 1 else ()


def split_motions(
    search: FitSearch, found: FoundChanges, options: RobotFitOptions
) -> tuple[tuple[str, ...], Folds]:
    """Return blocks of rows by their motion, as the fit bends the sections, and what they are."""
    observation, rows = search.observation, search.observation.rows
    setup = change_setup(observation.setup, search.unknowns, found.changes)
    states = SectionStates.of(setup, found.observed.shape, found.observed.points)
    bends = np.nan_to_num(states.bends)
    largest = bends.max(axis=0)
    if options.split == "amplitude":
        far = np.max(bends / np.where(largest > 0.0, largest, np.inf), axis=-1)
        parts = np.array_split(np.argsort(far, kind="stable"), options.folds)
        if len(rows) < options.folds or not far.any():
            raise InputError(
                f"{len(rows)} row(s) in which sections bend by up to {largest.max():.3g} rad are "
                f"too few, or bend too little, for {options.folds} blocks by amplitude"
            )
        labels = tuple(f"to {far[part].max():.0%}" for part in parts)
        return labels, tuple(np.sort(rows[part]) for part in parts)
    kinds = name_kinds(bends, largest, name_sections(setup.robot))
    blocks = {str(kind): rows[kinds == kind] for kind in np.unique(kinds)}
    kept = {kind: block for kind, block in blocks.items() if len(block) >= FEWEST_OF_KIND}
    if len(kept) < 2:
        raise InputError(
            f"there is {len(kept)} kind of motion with {FEWEST_OF_KIND} rows or more: to leave "
            "kinds out the rows must have 2"
        )
    return tuple(kept), tuple(kept.values())


class LeftOutRows(NamedTuple):
    """What fits to other rows predict of those left out: predicted less measured [mm]."""

    rows: NDArray[np.int64]
    blocks: NDArray[np.int64]
    missed: Floats
    corrected: Floats
    bends: Floats

    def validate(
        self, names: tuple[str, ...], missed: Floats, labels: tuple[str, ...] = ()
    ) -> Validation:
        """Return the errors of these misses."""
        blocks = [measure_rms(missed[self.blocks == k]) for k in np.unique(self.blocks)]
        return Validation(names, measure_rms(missed), tuple(blocks), labels)


def leave_rows_out(
    search: FitSearch,
    start: Floats,
    folds: Folds,
    options: RobotFitOptions,
    progress: Callable[[float], None],
) -> LeftOutRows:
    """Return what fits to the other rows, which begin at `start`, predict of each block."""
    progress(0.0)
    todo = [_Task(search, start, folds, k, options.residual) for k in range(len(folds))]
    parts: list[LeftOutRows] = []
    jobs = options.jobs
    for one in _leave_out_apart(todo, jobs) if jobs > 1 else map(_leave_out, todo):
        parts.append(one)
        progress(len(parts) / len(todo))
    return LeftOutRows(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


class _Task(NamedTuple):
    """A block to leave out."""

    search: FitSearch
    start: Floats
    folds: Folds
    left: int
    residual: bool


def _leave_out_apart(todo: Sequence[_Task], jobs: int) -> Iterator[LeftOutRows]:
    """Yield what `_leave_out` returns, in processes of their own."""
    with open_processes(min(jobs, len(todo)), "fit_robot") as pool:
        yield from pool.map(_leave_out, todo)


def _leave_out(todo: _Task) -> LeftOutRows:
    """Return what a fit to the other rows predicts of a block."""
    search, fold = todo.search, todo.folds[todo.left]
    observation = search.observation
    kept = np.setdiff1d(observation.rows, fold)
    inside = dataclasses.replace(search, observation=dataclasses.replace(observation, rows=kept))
    found = inside.run(todo.start, loss=search.loss)
    outside = dataclasses.replace(observation, rows=fold)
    setup = change_setup(observation.setup, search.unknowns, found.changes)
    there = outside.observe(setup)
    missed = fill_gaps(there.points, outside.measured)
    states = SectionStates.of(setup, there.shape, there.points)
    corrected = missed
    if todo.residual:
        own = SectionStates.of(setup, found.observed.shape, found.observed.points)
        left = -fill_gaps(found.observed.points, inside.observation.measured)
        residual = learn_residual(own, left, label_rows(kept, todo.folds))
        corrected = missed + residual.shift(states)
    return LeftOutRows(fold, np.full(len(fold), todo.left), missed, corrected, states.bends)


def label_rows(rows: NDArray[np.int64], folds: Folds) -> NDArray[np.int64]:
    """Return the number of the block of each row; one more for rows of none."""
    labels = np.full(len(rows), len(folds))
    for k, fold in enumerate(folds):
        labels[np.isin(rows, fold)] = k
    return labels


def predict_baselines(data: RobotMeasurements, robot: ContinuumRobot, folds: Folds
                       ) -> tuple[Validation, ...]:  # fmt: skip
    """Return what commands alone predict of each block from the others."""
    commands = data.order_commands(robot)
    parts: dict[str, list[Floats]] = {}
    for fold in folds:
        kept = np.setdiff1d(data.seen_rows, fold)
        there = predict_by_commands(commands[kept], data.points[kept], commands[fold])
        for name, points in there.items():
            parts.setdefault(name, []).append(points - data.points[fold])
    return tuple(
        Validation(
            names=(name,),
            rms=measure_rms(np.concatenate(missed)),
            blocks=tuple(measure_rms(one) for one in missed),
        )
        for name, missed in parts.items()
    )


def try_smaller(
    search: FitSearch,
    found: FoundChanges,
    folds: Folds,
    validation: Validation,
    options: RobotFitOptions,
    progress: Callable[[float], None],
) -> Validation | None:
    """Return the validation of fewer constants, where that is better beyond chance.

    One set after the other is left out, the one without which rows left out are predicted best by
    the model linearised at the fit.
    """
    # A base that is free in all was aligned: as it was before it predicts nothing.
    aligned = frees_base(search.unknowns)
    families: dict[str, list[int]] = {}
    for index, one in enumerate(search.unknowns):
        if aligned and one.group == "base":
            continue
        key = f"{one.group}.{one.field}" if one.group != "base" else one.field.partition(".")[0]
        families.setdefault(key, []).append(index)
    linear = _Linear.make(search, found, folds)
    kept = list(range(len(search.unknowns)))
    best, least = kept, linear.measure(kept)
    while len(families) + aligned > 1:
        trials = [
            (linear.measure([i for i in kept if i not in members]), name)
            for name, members in families.items()
        ]
        error, name = min(trials)
        left = families.pop(name)
        kept = [i for i in kept if i not in left]
        if error < least * (1.0 + 1e-3):
            best, least = kept, min(error, least)
    if len(best) == len(search.unknowns):
        return None
    fewer = dataclasses.replace(search, unknowns=tuple(search.unknowns[i] for i in best))
    again = fewer.run(found.changes[best], loss=search.loss)
    plain = dataclasses.replace(options, residual=False)
    there = leave_rows_out(fewer, again.changes, folds, plain, progress)
    other = there.validate(tuple(one.name for one in fewer.unknowns), there.missed)
    return other if other.beats(validation) else None


@dataclass(frozen=True)
class _Linear:
    """A fit with the model linearised at its end."""

    jacobian: Floats
    target: Floats
    folds: tuple[NDArray[np.bool_], ...]

    @classmethod
    def make(cls, search: FitSearch, found: FoundChanges, folds: Folds) -> _Linear:
        """Return it from where a search ended."""
        seen = search.seen
        row = np.broadcast_to(search.observation.rows[:, None, None], seen.shape)[seen]
        target = found.jacobian @ found.changes - search.miss(found.observed)
        return cls(found.jacobian, target, tuple(np.isin(row, fold) for fold in folds))

    def measure(self, kept: Sequence[int]) -> float:
        """Return the sum of squares at rows left out, with some of the unknowns."""
        total = 0.0
        for out in self.folds:
            columns = self.jacobian[:, kept]
            values = np.linalg.lstsq(columns[~out], self.target[~out], rcond=1e-9)[0]
            total += float(np.sum((self.target[out] - columns[out] @ values) ** 2))
        return total
