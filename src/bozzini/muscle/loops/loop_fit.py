"""Operators fitted to recorded loops, with a drift and an offset of the record."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...checks import check_fields, choose, quantity
from ...errors import InputError
from ...numeric.arrays import Floats
from ...results import Json, Result, take_axes, to_plain
from ..hysteresis import HysteresisFit, LoopOptions, Operator
from ..model import MuscleModel
from .model import OPERATORS, LoopModel, StaticCurve, tabulate
from .record import LoopRecord, LoopSamples

if TYPE_CHECKING:
    from matplotlib.axes import Axes


DRIFTS = ("linear", "log", "none")
LOG_TIME = 1.0
"""Time constant of a logarithmic drift [s]."""

_ROUNDS = 8  # of the fit through a static model
_SETTLED = 1e-3  # share of the error by which the last round may change it
_TURN_SHARE = 0.05  # of the span of the pressure: less than that back is no turn
_DRIFT_SHARE = 0.01  # of the span of the response: a drift above is worth a warning
_FLAT_SHARE = 1e-3  # of the steepest: a static curve is taken to be at least so steep
_FIRST_RATIO = 3.0  # times the error of the rest: the first rise is another then
_RISE_SHARE = 0.5  # of the span: a record rises so much again after its first maximum, at least
_POOR_SHARE = 0.1  # of the span of the response: an error above is poor
_MISSED_RATIO = 3.0  # times the error of the fit: the part held out is another then
_HELPS = 0.9  # times the error of the part held out, at most: a drift that does helps
_MOST_NAMES = 4  # of what is not determined, in a note


@dataclass(frozen=True, kw_only=True)
class LoopFitOptions:
    """How recorded loops are fitted.

    Parameters
    ----------
    drift : str
        A drift of the response beside the hysteresis, from the record's first sample: ``"linear"``
        in time, ``"log"`` as ``log(1 + t / 1 s)``, which creep often is, or ``"none"``.
    samples : int
        How many samples are kept; see `LoopRecord.resample`.
    hold_out : float
        Last share of the record's time that is not fitted, and judges the fit.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    drift: str = quantity("text", "Drift beside the loops.", default="linear", words=DRIFTS)
    samples: int = quantity(
        help="Samples kept, evenly along the way, and one more at each turn.",
        default=2000,
        low=20,
        high=100_000,
        whole=True,
    )
    hold_out: float = quantity(
        help="Last share of the record that is not fitted.", default=0.0, low=0.0, high=0.9
    )

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, eq=False, kw_only=True)
class LoopFit(Result):
    """What came of a fit to recorded loops.

    Attributes
    ----------
    model : LoopModel
        The operator, and the static model if there is one.
    samples : LoopSamples
        What of the record was kept.
    predicted : (n,) ndarray
        Response of the operator, with offset and drift [mm or N].
    drift : float
        Drift from the first to the last sample of the record [mm or N].
    skipped : int
        First samples that were not fitted, as the record does not start at rest.
    held_out : int
        Last samples that were not fitted.
    fit : HysteresisFit
        The last fit of the operator alone.
    converged, reason
        Whether the search for the operator met its tolerance, and why not; `is_poor` says whether
        what it found is any good.
    notes : tuple of str
        Warnings, and what was changed of the record.
    record : LoopRecord
    """

    model: LoopModel
    record: LoopRecord
    samples: LoopSamples
    predicted: Floats
    drift: float
    options: LoopFitOptions
    skipped: int
    held_out: int
    fit: HysteresisFit[Operator]
    converged: bool
    reason: str
    notes: tuple[str, ...]

    @property
    def residual(self) -> Floats:
        """Measured less predicted (n,) [mm or N]."""
        return self.samples.response - self.predicted

    @property
    def span(self) -> float:
        """Span of the measured responses [mm or N]."""
        return float(np.ptp(self.samples.response))

    @property
    def fitted(self) -> int:
        """How many samples were fitted."""
        return len(self.samples) - self.skipped - self.held_out

    @property
    def error(self) -> float:
        """Root mean square of the part held out [mm or N], of that fitted if none was."""
        return self.parts.get("held out", self.deviation)

    @property
    def is_poor(self) -> bool:
        """Whether the part held out, or that fitted, is missed by more than a tenth of the span."""
        return max(self.error, self.deviation) > _POOR_SHARE * self.span

    @property
    def turns(self) -> bool:
        """Whether the pressure goes up and down over the samples fitted."""
        pressure = self.samples.pressure[self.skipped : len(self.samples) - self.held_out]
        fall = float((np.maximum.accumulate(pressure) - pressure).max())
        rise = float((pressure - np.minimum.accumulate(pressure)).max())
        return min(fall, rise) > _TURN_SHARE * float(np.ptp(pressure))

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters of the operator that the samples do not determine, and such a drift.

        On a pressure that never turns the plays make up any drift, and a drift any of them.
        """
        drift = () if self.turns or self.options.drift == "none" else ("drift",)
        return (*self.fit.undetermined, *drift)

    def describe_error(self) -> str:
        """Return how many samples counted, and both errors beside each other."""
        unit, shares = (
            self.record.unit,
            (100.0 / self.span) * np.array([self.deviation, self.error]),
        )
        held = (
            f"{self.error:.4g} {unit} held out ({shares[1]:.2g} %, {self.held_out} samples)"
            if self.held_out
            else "nothing held out, so that it is not known how well it predicts"
        )
        text = (
            f"rms {self.deviation:.4g} {unit} fitted ({shares[0]:.2g} % of the span of "
            f"{self.span:.4g} {unit}, {self.fitted} of {len(self.samples)} samples), {held}"
        )
        return text + (f"; {self.skipped} samples skipped" if self.skipped else "")

    @property
    def deviation(self) -> float:
        """Root mean square of the residual over the samples fitted [mm or N]."""
        return self.parts["fitted"]

    @property
    def parts(self) -> dict[str, float]:
        """Root mean square of the residual of each part that there is [mm or N].

        Fitted, of these rising, falling and at rest; before the first maximum, which is not fitted
        if the record does not start at rest; held out.
        """
        place = np.arange(len(self.samples))
        end = len(place) - self.held_out
        fitted = (place >= self.skipped) & (place < end)
        ways = self.samples.direction
        masks = {
            "fitted": fitted,
            "rising": fitted & (ways > 0.0),
            "falling": fitted & (ways < 0.0),
            "at rest": fitted & (ways == 0.0),
            "before the first maximum": place < self.skipped,
            "held out": place >= end,
        }
        return {
            name: float(np.sqrt(np.mean(np.square(self.residual[mask]))))
            for name, mask in masks.items()
            if mask.any()
        }

    def to_dict(self) -> Json:
        """Return the result as plain values, without the samples."""
        unit = self.record.unit
        values = {
            "operator": self.model.operator_name,
            "response": self.model.kind,
            "static": None if self.model.static is None else self.model.static.name,
            "samples": len(self.samples),
            "fitted": self.fitted,
            "skipped": self.skipped,
            "held_out": self.held_out,
            f"span_{unit}": self.span,
            f"rms_{unit}": self.parts,
            f"offset_{unit}": self.model.offset,
            "drift": self.options.drift,
            f"drift_{unit}": self.drift,
            "undetermined": self.undetermined,
            "poor": self.is_poor,
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.deviation,
            "notes": self.notes,
        }
        return {name: to_plain(value) for name, value in values.items()}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the loop measured and fitted over the pressure, and return the axes."""
        unit, end = self.record.unit, len(self.samples) - self.held_out
        axes = take_axes(ax, x="pressure [kPa]", y=f"{self.model.kind} [{unit}]")
        over = 1e3 * self.samples.pressure
        axes.plot(over, self.samples.response, ".", ms=2.5, color="0.4", label="measured")
        axes.plot(over[:end], self.predicted[:end], lw=1.2, label=self.model.operator_name)
        if self.held_out:
            axes.plot(over[end:], self.predicted[end:], lw=1.2, label="held out")
        held = f", held out {self.error:.3g} {unit}" if self.held_out else ""
        title = f"rms {self.deviation:.3g} {unit} fitted{held}"
        axes.set_title(title, fontsize=10, loc="left")
        axes.legend(frameon=False, fontsize=9)
        return axes


def fit_loop(
    record: LoopRecord,
    operator: str = "generalised",
    *,
    static: MuscleModel | None = None,
    options: LoopFitOptions | None = None,
) -> LoopFit:
    """Fit an operator to a recorded loop, so that a model can carry it.

    The response is that of the static model at the pressure that the operator gives, or what the
    operator gives itself, plus an offset and a drift of the record. The operator gives 0 without
    pressure and never less. With a static model the error in the response is made small by rounds
    of linearisation (Gauss-Newton) of its curve.

    A record that does not start at rest has a history that is not known: what comes before its
    first maximum, where most of it is forgotten, is not fitted. A record that does not rise again
    after that is fitted as if it had come from rest.

    Parameters
    ----------
    record : LoopRecord
    operator : str
        A key of `OPERATORS`.
    static : MuscleModel, optional
        The model without hysteresis that is to carry the operator.
    options : LoopFitOptions, optional

    Raises
    ------
    InputError
        If there is no such operator, the response is constant, too little is left to fit, or the
        static model has no answer
        or does not increase with pressure.
    """
    options = LoopFitOptions() if options is None else options
    kind = choose("operator", operator, OPERATORS)
    if not np.ptp(record.response) > 0.0:
        raise InputError(f"{record.kind} is {record.response[0]:g} all along: it must change")
    samples = record.resample(options.samples)
    time = samples.time - record.time[0]
    whole = float(record.time[-1] - record.time[0])
    end = int(np.count_nonzero(time <= (1.0 - options.hold_out) * whole))
    skip = 0 if record.starts_at_rest else _find_first_top(samples.pressure[:end])
    rises = np.maximum(np.diff(samples.pressure[skip:end]), 0.0).sum()
    if rises < _RISE_SHARE * np.ptp(samples.pressure):  # else nothing would be fitted on the way up
        skip = 0
    if end - skip < 3 or not np.ptp(samples.pressure[skip:end]) > 0.0:
        raise InputError(
            f"{max(end - skip, 0)} of {len(samples)} samples are left to fit, from the first "
            "maximum of the pressure to the part held out: record more loops"
        )
    columns = [np.ones(len(time)), _drift(options.drift, time, whole)]
    terms = np.stack(columns[: 1 if options.drift == "none" else 2], axis=-1)
    curve = None
    if static is not None:
        curve = tabulate(static, record.kind, record.held, float(record.pressure.max()))
    used = samples.take(slice(end))
    found, factors = _fit(kind, used, terms[:end], curve=curve, skip=skip)
    acting = found.operator.apply(samples.pressure)
    own = acting if curve is None else curve.apply(acting)
    result = LoopFit(
        model=LoopModel(
            operator=found.operator,
            kind=record.kind,
            static=static,
            held=record.held,
            pressures=(float(used.pressure.min()), float(used.pressure.max())),
            offset=float(terms[end - 1] @ factors),
            longest=record.longest,
            state=found.operator.run(used.pressure)[1],
        ),
        record=record,
        samples=samples,
        predicted=own + terms @ factors,
        drift=float(factors[1]) if len(factors) > 1 else 0.0,
        options=options,
        skipped=skip,
        held_out=len(time) - end,
        fit=found,
        converged=found.converged,
        reason=found.reason,
        notes=record.notes,
    )
    return _judge(result)


def _drift(kind: str, time: Floats, whole: float) -> Floats:
    """Return the drift over the times since the start, 1 at the end of the record."""
    if kind == "log":
        return np.asarray(np.log1p(time / LOG_TIME) / np.log1p(whole / LOG_TIME))
    return time / whole


def _find_first_top(pressure: Floats) -> int:
    """Return the first sample at the largest pressure, to a hundredth of the span."""
    return int(np.argmax(pressure >= pressure.max() - 0.01 * np.ptp(pressure)))


def _fit(
    kind: type[Operator],
    samples: LoopSamples,
    terms: Floats,
    *,
    curve: StaticCurve | None,
    skip: int,
) -> tuple[HysteresisFit[Operator], Floats]:
    """Return the operator's fit, and the factors of the terms."""
    if curve is None:
        options = LoopOptions(skip=skip, carried=True, terms=terms)
        found = kind.identify(samples.pressure, samples.response, options=options)
        return found, np.array(found.terms)
    # Begun where the offset makes the lowest responses those of the lowest pressures.
    lowest = samples.pressure <= samples.pressure.min() + 0.02 * np.ptp(samples.pressure)
    start = samples.response[lowest].mean() - curve.apply(samples.pressure[lowest]).mean()
    factors = np.zeros(terms.shape[-1])
    factors[0] = start
    acting = curve.invert(samples.response - start)
    least = _FLAT_SHARE * float(np.gradient(curve.response, curve.acting).max())
    best: tuple[float, HysteresisFit[Operator] | None, Floats] = (np.inf, None, factors)
    for _ in range(_ROUNDS):
        slopes = np.maximum(curve.find_slopes(acting), least)
        left = samples.response - terms @ factors - curve.apply(acting)
        options = LoopOptions(
            skip=skip,
            carried=True,
            weights=slopes,
            terms=terms / slopes[:, None],
            start=None if best[1] is None else best[1].operator,
        )
        found = kind.identify(samples.pressure, acting + left / slopes, options=options)
        factors = factors + found.terms
        acting = found.operator.apply(samples.pressure)
        left = (samples.response - terms @ factors - curve.apply(acting))[skip:]
        error = float(np.sqrt(np.mean(np.square(left))))
        before = best[0]
        if error < before:
            best = error, found, factors
        if error > (1.0 - _SETTLED) * before:
            break
    found = found if best[1] is None else best[1]
    return found, best[2]


def _judge_drift(fit: LoopFit) -> list[str]:
    """Return a note where the residual of the samples fitted drifts, and what would help.

    A drift is advised where it is seen to help on the part held out.
    """
    unit, kept = fit.record.unit, slice(fit.skipped, len(fit.samples) - fit.held_out)
    time = fit.samples.time[kept]
    drift = float(np.polyfit(time - time[0], fit.residual[kept], 1)[0]) * float(np.ptp(time))
    if abs(drift) <= _DRIFT_SHARE * fit.span:
        return []
    said = (
        f"the residual drifts by {drift:.3g} {unit} over the samples fitted, "
        f"{100.0 * abs(drift) / fit.span:.1f} % of the span"
    )
    if not fit.held_out:
        return [f"{said}: hold a part out to see whether a drift predicts it"]
    errors = {}
    for kind in (kind for kind in DRIFTS if kind != "none"):
        options = replace(fit.options, drift=kind)
        name, static = fit.model.operator_name, fit.model.static
        errors[kind] = fit_loop(fit.record, name, static=static, options=options).error
    kind = min(errors, key=errors.__getitem__)
    change = f"{kind} drift makes it {errors[kind]:.3g} {unit} in place of {fit.error:.3g} {unit}"
    if errors[kind] < _HELPS * fit.error:
        return [f"{said}; on the part held out a {change}: choose it"]
    return [f"{said}; a drift does not help on the part held out: a {change}"]


def _judge(fit: LoopFit) -> LoopFit:
    """Return the fit with what a user should know of it."""
    unit, notes = fit.record.unit, list(fit.notes)
    if fit.skipped:
        notes.append(
            f"the record does not start at rest, but at {1e3 * fit.record.pressure[0]:.4g} kPa: "
            f"{fit.skipped} samples before the first maximum are not fitted"
        )
    elif not fit.record.starts_at_rest:
        notes.append(
            f"the record does not start at rest, but at {1e3 * fit.record.pressure[0]:.4g} kPa, "
            "and hardly rises after its first maximum: it is fitted as if it had come from rest"
        )
    elif (first := _find_first_top(fit.samples.pressure)) and first < len(fit.samples) // 2:
        rise = float(np.sqrt(np.mean(np.square(fit.residual[:first]))))
        later = float(np.sqrt(np.mean(np.square(fit.residual[first:]))))
        if rise > _FIRST_RATIO * later:
            notes.append(
                f"the first rise is missed by {rise:.3g} {unit} rms, the rest by {later:.3g}: the "
                "muscle had not been at rest before the record"
            )
    if not fit.turns:
        alike = "drift" in fit.undetermined
        notes.append(
            "the pressure never turns over the samples fitted: they do not tell loops"
            + (", nor a drift from the operator: record a turn, or fit no drift" if alike else "")
        )
    elif fit.options.drift != "none" and abs(fit.drift) > _DRIFT_SHARE * fit.span:
        notes.append(
            f"a drift of {fit.drift:.3g} {unit} over the record, "
            f"{100.0 * abs(fit.drift) / fit.span:.1f} % of the span, {fit.options.drift} in time, "
            "is fitted and no part of the operator"
        )
    elif fit.options.drift == "none":
        notes += _judge_drift(fit)
    if fit.is_poor:
        which = "held out" if fit.error > fit.deviation else "fitted"
        worst = max(fit.error, fit.deviation)
        notes.append(f"the fit is poor: rms {100.0 * worst / fit.span:.0f} % of the span, {which}")
    if fit.error > _MISSED_RATIO * fit.deviation:
        notes.append(
            f"the part held out is missed by {fit.error:.3g} {unit} rms, "
            f"{fit.error / fit.deviation:.3g} times what is fitted: the rms of the fit is no error "
            "of what it predicts"
        )
    if lost := fit.fit.undetermined:  # of a drift it was said
        names = ", ".join(lost[:_MOST_NAMES])
        more = f" and {len(lost) - _MOST_NAMES} more" if len(lost) > _MOST_NAMES else ""
        notes.append(
            f"the samples fitted do not determine {names}{more}; plays that hardly move over them "
            "are left out, with weight 0"
        )
    return replace(fit, notes=tuple(notes))
