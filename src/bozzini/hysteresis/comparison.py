"""Laws with memory side by side on measured loops, judged by what they predict.

- ``line``, ``cubic``: of the input, without memory.
- ``backlash-cubic``: a cubic of one play, whose half width is fitted.
- ``capstan``: the same with a play that widens in proportion to the distance from an apex.
- ``prandtl-ishlinskii``: a line over a sum of plays of half widths 0, 0.1 to 0.8 of half the range,
  and that of the backlash, of weights of one sign: they lag, or lead, all alike.
- ``generalised``: a cubic of such a sum, or of half widths 0, 0.1 and 0.3, whichever predicts
  better.
- ``bouc-wen``: a cubic of the input and a state of either sign.

Five blocks of the rows fitted are left out in turn, with the starts of all runs kept: their
residuals choose the law and give the band (split conformal prediction).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..checks import check_number, check_word
from ..errors import InputError
from ..io.sheets import split_title
from ..numeric.arrays import Floats
from ..numeric.estimation import find_conformal_limit
from ..progress import Progress, no_progress
from ..results import (
    Json,
    ReasonedResult,
    Shown,
    format_rows,
    rows_of,
    tabulated,
    take_axes,
    to_plain,
)
from .constants import Constant, identify_tendon, judge_constants
from .fitting import (
    Fitted,
    Mask,
    Samples,
    fit_backlash,
    fit_bouc_wen,
    fit_capstan,
    fit_generalised,
    fit_plays,
    fit_polynomial,
    settle_starts,
)
from .law import count_constants, tell_turn
from .record import LoopRuns

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BASELINES = ("line", "cubic", "backlash-cubic")
"""Laws that are always compared."""
LAWS = (*BASELINES, "capstan", "prandtl-ishlinskii", "generalised", "bouc-wen")
"""All laws, the simpler first."""
DRIFTS = ("none", "linear", "log")

_LADDERS = ("few", "many")
_FOLDS = 5
_GAIN = 0.97
"""Times the error of a simpler law, at most: a law that predicts so well is chosen."""
_WINS = 4
"""Of the blocks left out, in which it must be better."""
_HELPS = 0.9
"""Times the error without a drift, at most: a drift with that is advised."""
_POOR = 0.1
"""Share of the span of the output: an error above is poor."""
_ODD, _ODD_SHARE = 10.0, 0.05
"""Scatters, and share of the span and of the rows, of outliers."""
_COVERED = 0.95
_LEAD_WAY = 0.5
_LEAD_SHARE = 0.2
_FEWEST_FITTED = 20
_TURN = 0.05


@dataclass(frozen=True, kw_only=True)
class LoopRow(Shown):
    """How a law does; root mean squares in the unit of the output.

    Parameters
    ----------
    law : str
    constants : int
        How many were fitted, starts apart.
    fitted, left_out, held_out : float
        Error of the rows fitted, of these predicted by fits without a fifth of them each, and of
        the rows held out, NaN without any.
    share : float
        The last of these that there is, in % of the span of the output.
    """

    law: str = tabulated()
    constants: int = tabulated()
    fitted: float = tabulated()
    left_out: float = tabulated()
    held_out: float = tabulated()
    share: float = tabulated("%")

    @property
    def error(self) -> float:
        """The error by which laws are compared: held out, or left out without that."""
        return self.left_out if math.isnan(self.held_out) else self.held_out


class LoopParts(NamedTuple):
    """Which rows (n,) are fitted, held out, and only settle the start of a run held out."""

    fitted: Mask
    held_out: Mask
    lead: Mask


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopComparison(ReasonedResult):
    """Laws on measured loops.

    Attributes
    ----------
    rows : tuple of LoopRow
        All laws, the simpler first.
    best : str
        The law that predicts rows left out best: one is better than a simpler one if its error is
        less by 3 %, and less in four of the five blocks.
    law : str
        The one asked for, or the best: `fit` is its.
    runs : LoopRuns
    fit : Fitted
    parts : LoopParts
    predicted : ndarray, shape (n,)
        Of all rows, with the drift.
    band : float
        95 % of the rows left out are predicted to plus and minus so much.
    coverage : float
        Share of the rows held out within the band; NaN without any.
    outside : float
        Share of the rows held out whose input is beyond those fitted.
    constants : tuple of Constant
        With intervals.
    drift : str
    drifted : float
        Drift over the record.
    notes : tuple of str
    reason : str
        Why it is not to be trusted; empty if it is.
    residual : float
        The error of the law.
    """

    rows: tuple[LoopRow, ...] = rows_of(LoopRow)
    best: str
    law: str
    runs: LoopRuns
    fit: Fitted
    parts: LoopParts
    kept: int
    predicted: Floats
    band: float
    coverage: float
    outside: float
    constants: tuple[Constant, ...]
    drift: str
    drifted: float
    notes: tuple[str, ...]
    reason: str

    @property
    def row(self) -> LoopRow:
        """How the law does."""
        return next(row for row in self.rows if row.law == self.law)

    @property
    def residual(self) -> float:
        """The error of the law."""
        return self.row.error

    @property
    def span(self) -> float:
        """Span of the output."""
        return _find_span(self.runs)

    def to_dict(self) -> Json:
        """Return the result as plain values, without the rows of the table."""
        unit = self.runs.unit
        counts = {name: int(mask.sum()) for name, mask in self.parts._asdict().items()}
        law = self.fit.law
        values: Json = {
            "laws": [vars(row) for row in self.rows],
            "best": self.best,
            "law": self.law,
            "input": self.runs.input_title,
            "output": self.runs.output_title,
            "unit": unit,
            "span": self.span,
            "rows": len(self.runs),
            "kept": self.kept,
            **counts,
            "runs": dict(zip(self.runs.labels, self.list_turns(), strict=True)),
            "still_half_widths": self.fit.still,
            "identified": [vars(item) for item in self.constants],
            "undetermined": [item.name for item in self.constants if not item.is_determined],
            "band_95": self.band,
            "coverage": self.coverage,
            "outside": self.outside,
            "drift": self.drift,
            "drifted": self.drifted,
            "constants": {name: getattr(law, name) for name in law.__dataclass_fields__},
            "notes": self.notes,
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.residual,
        }
        return {name: to_plain(value) for name, value in values.items()}

    def list_turns(self) -> list[float]:
        """Return for each run the input at which it is taken to have turned before."""
        law = self.fit.law
        return [
            tell_turn(float(self.runs.input[first]), start, law.reach)
            for first, start in zip(self.runs.first, self.fit.starts, strict=True)
        ]

    def list_table(self) -> Json:
        """Return the rows measured and predicted, with their band, and the part each is in."""
        runs = self.runs
        words = np.array(["", "fitted", "held out", "start"])
        kinds = self.parts.fitted + 2 * self.parts.held_out + 3 * self.parts.lead
        name, unit = split_title(runs.output_title)
        end = f" [{unit}]" if unit else ""
        return {
            "run": runs.list_labels(),
            runs.time_title or "row": runs.time,
            runs.input_title: runs.input,
            runs.output_title: runs.output,
            f"predicted {name}{end}": self.predicted,
            f"lowest {name}{end}": self.predicted - self.band,
            f"highest {name}{end}": self.predicted + self.band,
            "part": words[kinds].tolist(),
        }

    def format_table(self) -> str:
        """Return the laws as text."""
        unit = f" [{self.runs.unit}]" if self.runs.unit else ""
        head = ["law", "constants", f"fitted{unit}", f"left out{unit}", f"held out{unit}", "[%]"]
        rows = [
            [
                row.law + (" *" if row.law == self.best else ""),
                f"{row.constants}",
                f"{row.fitted:.4g}",
                f"{row.left_out:.4g}",
                "-" if math.isnan(row.held_out) else f"{row.held_out:.4g}",
                f"{row.share:.2g}",
            ]
            for row in self.rows
        ]
        return format_rows(head, rows)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the loops measured and predicted over the input, and return the axes."""
        runs = self.runs
        axes = take_axes(ax, x=runs.input_title, y=runs.output_title)
        axes.plot(runs.input, runs.output, ".", ms=2.5, color="0.4", label="measured")
        shown = False
        for place in runs.slices:
            for kind, mask, colour in (
                (self.law, self.parts.fitted, "C0"), ("held out", self.parts.held_out, "C1"),
            ):  # fmt: skip
                own = np.where(mask[place], self.predicted[place], np.nan)
                label = None if shown else kind
                axes.plot(runs.input[place], own, lw=1.2, color=colour, label=label)
            shown = True
        axes.set_title(
            f"rms {self.row.fitted:.3g} fitted, {self.row.error:.3g} predicted {runs.unit}".strip(),
            fontsize=10,
            loc="left",
        )
        axes.legend(frameon=False, fontsize=9)
        return axes


def compare_laws(
    runs: LoopRuns,
    *,
    law: str = "best",
    drift: str = "none",
    hold_out: float | tuple[str, ...] = 0.0,
    samples: int = 2000,
    progress: Progress = no_progress,
) -> LoopComparison:
    """Fit all laws to measured loops and judge them by what they predict.

    Parameters
    ----------
    runs : LoopRuns
    law : str
        One of `LAWS`, or ``"best"``: that which the result carries.
    drift : str
        Beside all laws, over the time t of the table, of length T: none, t, or log(1 + 9 t / T).
        A time that restarts in a run goes on from the run before.
    hold_out : float or tuple of str
        Last share of all rows that is not fitted, or the runs that are not.
    samples : int
        How many means of rows are fitted at most; errors are those of all rows.
    progress : callable
        Told the law and the share that is done.

    Raises
    ------
    InputError
        If an option is not legal, too little is left to fit, or the input or output is constant.
    """
    check_word("law", law, (*LAWS, "best"))
    check_word("drift", drift, DRIFTS)
    parts = _part(runs, hold_out)
    work = _Work.begin(runs, parts, drift, samples)
    fits, left = work.fit_all(progress)
    fits = {name: work.settle_held_out(fit) for name, fit in fits.items()}
    rows = tuple(_make_row(name, fits[name], left[name], work) for name in LAWS)
    best = LAWS[0]
    for name in LAWS[1:]:
        best = name if _is_better(left[name], left[best]) else best
    chosen = best if law == "best" else law
    fit = fits[chosen]
    predicted = fit.predict(work.every)
    band = find_conformal_limit(np.abs(left[chosen]), _COVERED)
    held = parts.held_out
    missed = np.abs(runs.output - predicted)[held]
    inputs = runs.input[parts.fitted]
    beyond = (runs.input[held] < inputs.min()) | (runs.input[held] > inputs.max())
    result = LoopComparison(
        rows=rows,
        best=best,
        law=chosen,
        runs=runs,
        fit=fit,
        parts=parts,
        kept=len(work.few.outputs),
        predicted=predicted,
        band=band,
        coverage=float(np.mean(missed <= band)) if held.any() else math.nan,
        outside=float(np.mean(beyond)) if held.any() else 0.0,
        constants=_find_constants(fit, work),
        drift=drift,
        drifted=float(fit.factors @ np.ptp(work.every.terms, axis=0)) if len(fit.factors) else 0.0,
        notes=(),
        reason="",
    )
    return _judge(result, fits, work)


def _part(runs: LoopRuns, hold_out: float | tuple[str, ...]) -> LoopParts:
    """Return which rows are fitted, held out, and settle starts alone."""
    held = np.zeros(len(runs), dtype=np.bool_)
    if isinstance(hold_out, tuple):
        for label in hold_out:
            check_word("hold out", label, runs.labels)
            held[runs.slices[runs.labels.index(label)]] = True
    else:
        share = check_number("hold out", hold_out, low=0.0, high=0.9)
        held[len(runs) - round(share * len(runs)) :] = True
    known = np.isfinite(runs.output)
    fitted = known & ~held
    if np.count_nonzero(fitted) < _FEWEST_FITTED:
        raise InputError(
            f"{np.count_nonzero(fitted)} rows are left to fit: there must be {_FEWEST_FITTED}"
        )
    for name, values in (("input", runs.input), ("output", runs.output)):
        if not np.ptp(values[fitted]) > 0.0:
            raise InputError(
                f"the {name} is {values[fitted][0]:g} in all rows fitted: it must change"
            )
    lead = np.zeros(len(runs), dtype=np.bool_)
    for place in runs.slices:
        if held[place].all():
            lead[place.start : place.start + count_lead(runs.input[place])] = True
    return LoopParts(fitted, known & held & ~lead, known & lead)


def _spread(mask: Mask, known: Mask) -> Mask:
    """Return a mask (n,) in which rows that are not known are as the last one known before."""
    seen = np.flatnonzero(known)
    place = np.searchsorted(seen, np.arange(len(mask)), side="right") - 1
    return np.asarray(mask[seen[np.maximum(place, 0)]])


def count_lead(inputs: Floats) -> int:
    """Return how many first rows settle the start of a run whose output is to be predicted.

    Those until the way of the input is half its range, a fifth of the rows at most.
    """
    way = np.append(0.0, np.cumsum(np.abs(np.diff(inputs))))
    count = int(np.searchsorted(way, _LEAD_WAY * float(np.ptp(inputs)), side="right"))
    return max(min(count, int(_LEAD_SHARE * len(inputs))), min(3, len(inputs)))


@dataclass(frozen=True, eq=False)
class _Work:
    """All rows, the few that are fitted, and which of these are which."""

    runs: LoopRuns
    parts: LoopParts
    every: Samples
    few: Samples
    few_fitted: Mask
    folds: Floats
    few_folds: Floats

    @classmethod
    def begin(cls, runs: LoopRuns, parts: LoopParts, drift: str, count: int) -> _Work:
        runs = replace(runs, time=runs.join_times())
        # A row without an output is in the part of the row before that has one.
        rank = np.cumsum(parts.fitted)
        folds = np.floor(_FOLDS * np.maximum(rank - 1, 0) / rank[-1])
        folds = np.where(_spread(parts.fitted, np.isfinite(runs.output)), folds, -1.0)
        few, first = runs.thin(count, folds)
        begin, whole = float(runs.time.min()), float(np.ptp(runs.time)) or 1.0

        def take(some: LoopRuns) -> Samples:
            share = (some.time - begin) / whole
            kinds = {"none": [], "linear": [share], "log": [np.log1p(9.0 * share) / np.log(10.0)]}
            terms = np.stack(kinds[drift], axis=-1) if kinds[drift] else np.empty((len(some), 0))
            return Samples(tuple(some.input[place] for place in some.slices), some.output, terms)

        own = first.astype(np.intp)
        few_fitted = (folds[own] >= 0.0) & np.isfinite(few.output)
        return cls(runs, parts, take(runs), take(few), few_fitted, folds, folds[own])

    def fit_all(self, progress: Progress) -> tuple[dict[str, Fitted], dict[str, Floats]]:
        """Return the fit of each law, and the residuals of the rows that it left out (n,)."""
        fits: dict[str, Fitted] = {}
        left: dict[str, Floats] = {}
        for done, name in enumerate(LAWS):
            progress(name, done / len(LAWS))
            for ladder in _LADDERS if name == "generalised" else ("",):
                fit = _fit_law(name, self.few, self.few_fitted, fits, ladder)
                residual = self.leave_out(name, fit, fits)
                if name not in fits or _size(residual) < _GAIN * _size(left[name]):
                    fits[name], left[name] = fit, residual
        return fits, left

    def leave_out(self, name: str, fit: Fitted, known: Mapping[str, Fitted]) -> Floats:
        """Return the residuals of the rows fitted, each block predicted by a fit without it."""
        residual = np.zeros(len(self.runs))
        for fold in range(_FOLDS):
            mask = self.few_fitted & (self.few_folds != fold)
            own = self.folds == fold
            found = _fit_law(name, self.few, mask, known, "", before=fit)
            residual[own] = (self.every.outputs - found.predict(self.every))[own]
        return residual[self.parts.fitted]

    def settle_held_out(self, fit: Fitted) -> Fitted:
        """Return a fit with the starts of runs held out, from their first rows."""
        if not self.parts.lead.any():
            return fit
        return settle_starts(fit, self.every, self.parts.lead)


def _fit_law(
    name: str,
    samples: Samples,
    mask: Mask,
    known: Mapping[str, Fitted],
    ladder: str,
    before: Fitted | None = None,
) -> Fitted:
    """Return the fit of a law; with one of all rows before, from its starts on."""
    if name in ("line", "cubic"):
        return fit_polynomial(samples, mask, 1 if name == "line" else 3)
    if name == "backlash-cubic":
        return fit_backlash(samples, mask, before)
    if name == "capstan":
        return fit_capstan(samples, mask, known["backlash-cubic"], before)
    if name == "prandtl-ishlinskii":
        return fit_plays(samples, mask, known["backlash-cubic"], before)
    if name == "generalised":
        return fit_generalised(samples, mask, known, ladder, before)
    return fit_bouc_wen(samples, mask, known["backlash-cubic"], before)


def _find_constants(fit: Fitted, work: _Work) -> tuple[Constant, ...]:
    """Return the constants of a law, and what they say of a tendon."""
    own = judge_constants(fit, work.few, work.few_fitted)
    units = {"input_unit": work.runs.input_unit, "output_unit": work.runs.unit}
    return (*own, *identify_tendon(fit.law, own, **units))


def _is_better(one: Floats, two: Floats) -> bool:
    """Whether residuals left out are smaller than those of a simpler law, in most blocks too."""
    blocks = zip(np.array_split(one, _FOLDS), np.array_split(two, _FOLDS), strict=True)
    wins = sum(_size(first) < _size(second) for first, second in blocks)
    return wins >= _WINS and _size(one) < _GAIN * _size(two)


def _size(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else math.nan


def _make_row(name: str, fit: Fitted, left: Floats, work: _Work) -> LoopRow:
    residual = work.every.outputs - fit.predict(work.every)
    held = _size(residual[work.parts.held_out])
    predicted = _size(left)
    error = predicted if math.isnan(held) else held
    return LoopRow(
        law=name,
        constants=count_constants(fit.law),
        fitted=_size(residual[work.parts.fitted]),
        left_out=predicted,
        held_out=held,
        share=100.0 * error / _find_span(work.runs),
    )


def _find_span(runs: LoopRuns) -> float:
    return float(np.nanmax(runs.output) - np.nanmin(runs.output))


def _judge(result: LoopComparison, fits: Mapping[str, Fitted], work: _Work) -> LoopComparison:
    """Return the comparison with what a user should know of it."""
    runs, parts, notes = result.runs, result.parts, list(result.runs.notes)
    unit = f" {runs.unit}" if runs.unit else ""
    known = f" {runs.input_unit}" if runs.input_unit else ""
    for name in LAWS:
        if fits[name].still:
            shown = ", ".join(f"{width:.3g}" for width in fits[name].still)
            notes.append(
                f"{name}: plays of half width {shown}{known} hardly move over the rows fitted: "
                "left out"
            )
    baseline = min((row for row in result.rows if row.law in BASELINES), key=lambda r: r.error)
    kind = "held out" if parts.held_out.any() else "left out"
    worse = [
        row
        for row in result.rows
        if row.law not in BASELINES and _GAIN * row.error > baseline.error
    ]
    if worse:
        names = " or ".join(row.law for row in worse)
        notes.append(f"the baseline {baseline.law} predicts the rows {kind} better than {names}")
    if len(parts.lead.nonzero()[0]):
        notes.append(f"{parts.lead.sum()} first rows of runs held out settle their start alone")
    if result.outside > 0.0:
        notes.append(
            f"{100.0 * result.outside:.0f} % of the rows held out are beyond the inputs fitted"
        )
    if doubtful := [item.name for item in result.constants if not item.is_determined]:
        notes.append(f"the rows do not determine {', '.join(doubtful)}")
    if result.drift != "none" and (work.runs.time != runs.time).any():
        notes.append(
            "the time restarts: the drift is over that of all runs, one right after the other"
        )
    notes += _find_odd_rows(result)
    notes += _advise_drift(result, fits, work)
    reasons = []
    if not any(_turns(runs.input[place][parts.fitted[place]]) for place in runs.slices):
        reasons.append("the input never turns over the rows fitted: they do not tell loops")
    if result.residual > _POOR * result.span:
        reasons.append(
            f"the fit is poor: rms {result.residual:.4g}{unit} {kind}, "
            f"{100.0 * result.residual / result.span:.0f} % of the span"
        )
    return replace(result, notes=tuple(notes), reason="; ".join(reasons))


def _find_odd_rows(result: LoopComparison) -> list[str]:
    """Return a note where a few rows are far off: outliers, which least squares heeds."""
    off = np.abs(result.runs.output - result.predicted)
    odd = np.flatnonzero(
        off > max(_ODD * 1.4826 * float(np.nanmedian(off)), _ODD_SHARE * result.span)
    )
    if not 0 < len(odd) <= _ODD_SHARE * len(off):
        return []
    return [
        f"{len(odd)} rows are off by more than {_ODD:g} times most, the first by "
        f"{off[odd[0]]:.4g} at row {odd[0] + 1} of those read: if they are outliers, leave them out"
    ]


def _turns(inputs: Floats) -> bool:
    """Whether an input goes up and down."""
    if not inputs.size:
        return False
    fall = float((np.maximum.accumulate(inputs) - inputs).max())
    rise = float((inputs - np.minimum.accumulate(inputs)).max())
    return min(fall, rise) > _TURN * float(np.ptp(inputs))


def _advise_drift(result: LoopComparison, fits: Mapping[str, Fitted], work: _Work) -> list[str]:
    """Return a note where a drift predicts the rows held out better, each block of them."""
    held = np.flatnonzero(result.parts.held_out)
    if result.drift != "none" or len(held) < _FEWEST_FITTED or not result.runs.time_title:
        return []
    plain = (result.runs.output - result.predicted)[held]
    for kind in DRIFTS[1:]:
        drifting = _Work.begin(result.runs, work.parts, kind, len(work.few.outputs))
        few, mask = drifting.few, drifting.few_fitted
        fit = _fit_law(result.law, few, mask, fits, "", before=result.fit)
        left = (drifting.every.outputs - fit.predict(drifting.every))[held]
        blocks = zip(np.array_split(left, 4), np.array_split(plain, 4), strict=True)
        helps = all(_size(one) < _size(two) for one, two in blocks)
        if helps and _size(left) < _HELPS * _size(plain):
            return [
                f"a {kind} drift makes the error held out {_size(left):.3g} in place of "
                f"{_size(plain):.3g}, and less in each of 4 blocks: choose it"
            ]
    return []
