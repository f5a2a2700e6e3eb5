"""What a study's outputs are uncertain by, and of which factors that comes: Sobol indices.

The indices are Saltelli's estimates of 2010, as `scipy.stats.sobol_indices` has them, from the rows
that a study with the sampling ``saltelli`` computes. One row without an answer makes each of them
wrong: SciPy gives zeros, and a large number in its place gives indices of failing. Such rows are
therefore refused by default.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number, check_word
from ..errors import InputError
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import ClosedForm, Json, tabulated, to_plain
from .definition import Study
from .factors import Axis, Factor, draw_shares
from .run import Engine, read_rows, run_study

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FailureRule = Literal["refuse", "indicator", "box"]
FAILURE_RULES: tuple[FailureRule, ...] = ("refuse", "indicator", "box")

FAILED = "failed"
"""The output that says whether a row has no answer: 1 or 0."""

QUANTILES = (0.025, 0.25, 0.5, 0.75, 0.975)
RESAMPLES = 200
"""Resamples of the draws, for the intervals."""

ROUNDING = 1e-12
"""Range of an output, as a share of its largest value, up to which it does not vary."""

PEEL = 0.02
"""Share of a box's side that is cut off at a time."""
ROUNDS = 8
"""How often a box is narrowed, as rows of the last one failed in it."""
LEAST_BOX = 1e-3
"""Smallest share of the rows that a box may keep."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Indices(ClosedForm):
    """The Sobol indices of one output; NaN if it does not vary.

    Attributes
    ----------
    factors : tuple of str
    first, total : (d,) float
        Share of the variance that a factor has alone, and with all that it takes part in.
    first_interval, total_interval : (d, 2) float
        By the draws resampled, normal. Sobol draws are more even than independent ones: the
        intervals are rather too wide.
    level : float
        Their probability.
    """

    factors: tuple[str, ...] = tabulated(name="factor")
    first: Floats = tabulated()
    first_interval: Floats = tabulated(name="first_{}", over="ends")
    total: Floats = tabulated()
    total_interval: Floats = tabulated(name="total_{}", over="ends")
    level: float

    ends = ("low", "high")


@dataclass(frozen=True, kw_only=True, eq=False)
class Spread(ClosedForm):
    """How one output is distributed, over the rows that have it.

    Attributes
    ----------
    values : (n,) float
        In the unit of its column.
    failed : int
        Rows without one.
    """

    values: Floats
    failed: int

    def to_dict(self) -> Json:
        """Return mean, standard deviation and quantiles; None without any row."""
        values = self.values if len(self.values) else np.array([math.nan])
        return {
            "rows": len(self.values),
            "failed": self.failed,
            "mean": to_plain(float(values.mean())),
            "sd": to_plain(float(values.std(ddof=1)) if len(values) > 1 else math.nan),
            "quantiles": {f"{q:g}": to_plain(float(np.quantile(values, q))) for q in QUANTILES},
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class StudySpread(ClosedForm):
    """Distributions and Sobol indices of the outputs of a study.

    Attributes
    ----------
    spreads : dict of str to Spread
        By column, with units in the names.
    indices : dict of str to Indices
        By column; empty of a sampling other than ``saltelli``.
    rows : int
        Rows of the study; of indices those of all designs.
    failures : dict of str to int
        Reasons of the rows without an answer.
    box : dict of str to list, or None
        Where none fails, if one was sought: by factor its ends, or its values.
    note : str
        Why there are no indices, or of what they are not.
    """

    spreads: dict[str, Spread]
    indices: dict[str, Indices]
    rows: int
    failures: dict[str, int]
    box: Json | None = None
    note: str = ""

    def to_dict(self) -> Json:
        """Return all as plain values."""
        return {
            "rows": self.rows,
            "failures": self.failures,
            "outputs": {name: spread.to_dict() for name, spread in self.spreads.items()},
            "sobol": {
                name: to_plain({"level": found.level, **found.list_columns()})
                for name, found in self.indices.items()
            },
            "box": self.box,
            "note": self.note,
        }

    def list_columns(self) -> Mapping[str, object]:
        """Return a row for each output and factor."""
        tables = [found.list_columns() for found in self.indices.values()]
        outputs = [[name] * len(found.factors) for name, found in self.indices.items()]
        return {
            "output": sum(outputs, []),
            **{
                name: np.concatenate([np.asarray(table[name]) for table in tables])
                for name in (tables[0] if tables else ())
            },
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the indices of the first output as bars; return the axes."""
        from ..plot.study import draw_indices

        if not self.indices:
            raise InputError(f"there are no indices to draw: {self.note}")
        name, found = next(iter(self.indices.items()))
        return draw_indices(name, found.list_columns(), ax)

    def draw_indices(self) -> Figure:
        """Return bars of the indices, a panel for each output."""
        from ..plot.study import draw_all, draw_indices

        return draw_all({k: v.list_columns() for k, v in self.indices.items()}, draw_indices)

    def draw_spreads(self) -> Figure:
        """Return histograms of the outputs."""
        from ..plot.study import draw_all, draw_spread

        return draw_all({k: v.values for k, v in self.spreads.items()}, draw_spread)


def find_indices(values: Floats, names: tuple[str, ...], *, level: float, seed: int) -> Indices:
    """Return the Sobol indices of an output at the rows of a ``saltelli`` design.

    Parameters
    ----------
    values : (n (d + 2),) float
        In the order of the rows: of each draw A, B, and A with each factor of B.
    names : tuple of str
        The d factors.
    level : float
        Probability of the intervals.
    seed : int
        Of the resamples.
    """
    dim = len(names)
    rows = values.reshape(-1, dim + 2) - values.mean()
    a, b, mixed = rows[:, :1], rows[:, 1:2], rows[:, 2:]
    varies = np.ptp(values) > ROUNDING * np.abs(values).max()
    # Means over the draws of these are all that the estimates need, of resamples too.
    parts = np.hstack(
        [0.5 * (a + b), 0.5 * (a**2 + b**2), b * (mixed - a), mixed - a, 0.5 * (mixed - a) ** 2]
    )

    def estimate(means: Floats) -> Floats:
        mean, square = means[:, :1], means[:, 1:2]
        product, change, half = np.split(means[:, 2:], 3, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.stack([product - mean * change, half]) / (square - mean**2)
        return np.where(np.isfinite(found) & varies, found, math.nan)

    draws = len(rows)
    random = np.random.default_rng(seed)
    drawn = np.stack([
        np.bincount(random.integers(draws, size=draws), minlength=draws) @ parts / draws
        for _ in range(RESAMPLES)
    ])  # fmt: skip
    (first, total), spread = estimate(parts.mean(axis=0)[None])[:, 0], estimate(drawn).std(axis=1)
    from scipy.special import ndtri

    half = float(ndtri(0.5 + 0.5 * level)) * spread
    low, high = np.stack([first, total]) - half, np.stack([first, total]) + half
    ends = np.stack([low, high], axis=-1)
    return Indices(
        factors=names,
        first=first,
        total=total,
        first_interval=ends[0],
        total_interval=ends[1],
        level=level,
    )


def analyse_rows(
    study: Study, rows: pandas.DataFrame, *, failures: FailureRule = "refuse", level: float = 0.95
) -> StudySpread:
    """Return distributions and Sobol indices of the outputs of a study whose rows are computed.

    Parameters
    ----------
    study : Study
    rows : pandas.DataFrame
        All of them, in order, as `read_rows` gives them.
    failures : {"refuse", "indicator"}
        Whether a row without an answer is an error, or the indices are those of failing itself,
        beside those of the outputs that every row has.
    level : float
        Probability of the intervals.

    Raises
    ------
    InputError
        If an output has no finite value in a row, which is named; or rows are missing.
    """
    check_word("failures", failures, FAILURE_RULES[:2])
    check_number("level", level, low=0.5, high=0.9999)
    sampling = study.spec.sampling
    if sampling is None:
        raise InputError("the study is a search: its rows are no sample")
    if len(rows) != study.rows:
        raise InputError(f"{study.rows - len(rows)} of {study.rows} rows are missing: resume it")
    columns = [study.columns[name] for name in study.outputs]
    values = {name: rows[name].to_numpy(dtype=np.float64) for name in columns}
    failed = ~np.isfinite(np.stack(list(values.values()))).all(axis=0)
    indexed = sampling.method == "saltelli"
    names = tuple(study.columns[axis.name] for axis in study.axes)
    drawn = np.ones(len(rows), dtype=bool)  # A and B: the others are no draws of their own
    if indexed:
        drawn = np.arange(len(rows)) % (len(names) + 2) < 2
    indices, note = {}, ""
    if indexed:
        if failed.any() and failures == "refuse":
            row = int(np.argmax(failed))
            lacking = next(name for name in columns if not np.isfinite(values[name][row]))
            raise InputError(
                f"row {rows['row'].iloc[row]} has no {lacking} "
                f"({rows['reason'].iloc[row] or 'it is not finite'}), as {failed.sum()} of "
                f"{len(rows)} rows: one makes all indices wrong; take failures as 'indicator', for "
                "indices of failing itself, or 'box', for those where none fails"
            )
        whole = {name: value for name, value in values.items() if np.isfinite(value).all()}
        if failed.any():
            whole[FAILED] = failed.astype(np.float64)
            lacking = ", ".join(name for name in columns if name not in whole)
            note = f"rows without an answer: there are no indices of {lacking}"
        indices = {
            name: find_indices(value, names, level=level, seed=sampling.seed)
            for name, value in whole.items()
        }
    else:
        note = "indices need the sampling saltelli, such as {method: saltelli, count: 1024}"
    return StudySpread(
        spreads={
            name: Spread(
                values=value[drawn & np.isfinite(value)],
                failed=int((drawn & ~np.isfinite(value)).sum()),
            )
            for name, value in values.items()
        },
        indices=indices,
        rows=len(rows),
        failures={str(k): int(v) for k, v in rows["reason"][failed].value_counts().items() if v},
        note=note,
    )


def analyse_study(
    study: Study,
    folder: str | os.PathLike[str],
    *,
    failures: FailureRule = "refuse",
    engine: Engine | None = None,
    level: float = 0.95,
    progress: Progress = no_progress,
) -> StudySpread:
    """Compute a study, and return distributions and Sobol indices of its outputs.

    Parameters
    ----------
    study : Study
    folder : path-like
        Of the results, as of `run_study`; boxes are beside the rows, as ``box-1``.
    failures : {"refuse", "indicator", "box"}
        As `analyse_rows`; or narrow the factors to a box in which no row fails, and compute the
        study there.
    engine, progress
        As of `run_study`.
    level : float

    Raises
    ------
    InputError
        As `analyse_rows`; or no box is found.
    """
    check_word("failures", failures, FAILURE_RULES)
    check_number("level", level, low=0.5, high=0.9999)
    run_study(study, folder, engine=engine, progress=progress)
    rows = read_rows(folder)
    if failures != "box":
        return analyse_rows(study, rows, failures=failures, level=level)
    columns = [study.columns[name] for name in study.outputs]
    axes, part = study.axes, study
    low, high = np.zeros(len(axes)), np.ones(len(axes))
    shares, failed = np.empty((0, len(axes))), np.empty(0, dtype=bool)
    box: Json | None = None
    total = 0
    for turn in range(1, ROUNDS + 1):
        own = draw_shares(len(axes), part.spec.sampling or study.spec.sampling, 0, len(rows))  # type: ignore[arg-type]
        new = ~np.isfinite(rows[columns].to_numpy(dtype=np.float64)).all(axis=1)
        shares = np.vstack([shares, low + own * (high - low)])
        failed = np.concatenate([failed, new])
        total += len(rows)
        if not new.any():
            found = analyse_rows(part, rows, level=level)
            return replace(found, box=box, rows=total)
        low, high = find_box(axes, shares, failed)
        factors = {axis.name: narrow_factor(axis, low[k], high[k]) for k, axis in enumerate(axes)}
        part = Study(replace(study.spec, factors=factors), study.base)
        box = {study.columns[axis.name]: list_ends(axis) for axis in part.axes}
        place = Path(folder, f"box-{turn}")
        run_study(part, place, engine=engine, progress=progress)
        rows = read_rows(place)
    raise InputError(f"rows still fail in the box after {ROUNDS} rounds: narrow the factors")


def find_box(axes: list[Axis], shares: Floats, failed: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Return the ends of a box, as shares (d,), that holds no row that failed.

    What is cut off at a time is the slice with the most failed rows for its size.

    Raises
    ------
    InputError
        If what is left has hardly any rows.
    """
    low, high = np.zeros(len(axes)), np.ones(len(axes))
    inside = np.ones(len(shares), dtype=bool)
    while failed[inside].any():
        best = (-1.0, 0, 0.0, 0.0)
        for k, axis in enumerate(axes):
            width = high[k] - low[k]
            step = 1.0 / axis.levels if axis.kind not in ("range", "normal") else PEEL * width
            if step > width - 1e-9:
                continue
            for ends in ((low[k] + step, high[k]), (low[k], high[k] - step)):
                out = (shares[:, k] < ends[0]) | (shares[:, k] >= ends[1])
                rate = float((failed & inside & out).sum()) * width / step
                best = max(best, (rate, k, *ends))
        rate, k, low[k], high[k] = best
        inside &= (shares[:, k] >= low[k]) & (shares[:, k] < high[k])
        if rate < 0.0 or inside.mean() < LEAST_BOX:
            raise InputError("no box of the factors was found in which no row fails")
    for side, whole in ((low, 0.0), (high, 1.0)):  # cut off on the way, and not needed
        for k in range(len(axes)):
            before, side[k] = side[k], whole
            if failed[((shares >= low) & (shares < high)).all(axis=1)].any():
                side[k] = before
    return low, high


def narrow_factor(axis: Axis, low: float, high: float) -> Factor:
    """Return a factor that has only what lies between two shares of it."""
    if axis.kind in ("range", "normal"):
        if (low, high) == (0.0, 1.0):
            return axis.factor
        first, last = (float(value) for value in axis.place(np.clip([low, high], 0.0, 1.0 - 1e-16)))
        ends = (first, last)
        if axis.kind == "range":
            return replace(axis.factor, range=ends)
        return replace(axis.factor, clip=ends)
    begin, end = round(low * axis.levels), round(high * axis.levels)
    kept = [value.item() if hasattr(value, "item") else value
            for value in axis.pick(np.arange(begin, end))]  # fmt: skip
    if axis.kind == "files":
        return Factor(files=tuple(kept))
    return Factor(values=tuple(kept))


def list_ends(axis: Axis) -> list[object]:
    """Return the ends of a range or a normal distribution, or the values of another factor."""
    if axis.kind in ("range", "normal"):
        return [
            to_plain(float(end)) for end in (axis.values if axis.kind == "range" else axis.clip)
        ]
    return to_plain(list(axis.pick(np.arange(axis.levels))))  # type: ignore[no-any-return]
