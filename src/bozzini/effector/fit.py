"""Fit an end-effector to measurements, and report what the data do not determine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..checks import check_kind
from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.estimate import EstimateOptions, Estimation, estimate
from ..progress import Progress, no_progress
from ..results import Json, Result, Shown, format_rows, rows_of, tabulated, take_axes, to_plain
from .linkage import lateral_deflection
from .measured import EffectorMeasurements
from .model import EffectorModel
from .rest import BASELINES, RESTS, Baseline, Rest
from .section import find_bends
from .unknowns import EffectorSetup, FreeNumber, change_setup, parse_unknowns
from .view import ANGLES, TipView

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..numeric.estimation import Places
    from .effector import Effector
    from .motion import Acting, EffectorMotion

COVERED = 0.95
"""Share of what was left out that the band of a prediction holds."""
POOR_SHARE = 0.05
"""A fit is poor if it misses by more than this share of the range of what was seen."""
BAD_NUMBERS = 1e6
"""Misfit of a setup that has no answer [mm]."""
_APART = 1e9
"""Between rows at rest, for a rest that looks back: none is the past of another [s]."""


@dataclass(frozen=True, kw_only=True)
class EffectorFitOptions(Shown):
    """How an end-effector is fitted, and checked.

    Parameters
    ----------
    leave_out : bool
        Whether each run is left out in turn, and predicted by the fit to the others.
    rest : str
        Name of a rule of `RESTS` that learns what the fit leaves over; empty for none.
    estimate : EstimateOptions
        Loss, starts and budget of the search.
    """

    leave_out: bool = True
    rest: str = ""
    estimate: EstimateOptions = field(default_factory=EstimateOptions)


@dataclass(frozen=True)
class FittedNumber(Shown):
    """A fitted number.

    Parameters
    ----------
    name : str
        What was fitted, with muscle or play.
    value, low, high : float
        The number, and the ends of its 95 % interval; infinite where it is not determined.
    unit : str
    standard_error : float
    """

    name: str = tabulated()
    value: float = tabulated()
    low: float = tabulated()
    high: float = tabulated()
    unit: str = tabulated()
    standard_error: float = tabulated()


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectorPrediction(Result):
    """What a fitted end-effector predicts of measurements, from the commands alone.

    Attributes
    ----------
    data : EffectorMeasurements
        With what they are compared.
    predicted : ndarray, shape (n, q)
        In the units of what was seen.
    rest : ndarray, shape (n, q), optional
        What a rest adds to that.
    weights : ndarray, shape (q,)
        Length that one unit of what was seen stands for in errors [mm].
    baselines : tuple of (Baseline, ndarray)
        Black boxes and what they predict, given the first two samples of each run.
    """

    data: EffectorMeasurements
    predicted: Floats
    rest: Floats | None
    weights: Floats
    baselines: tuple[tuple[Baseline, Floats], ...] = ()

    converged = True
    reason = ""

    def measure_error(self, predicted: Floats, run: str = "") -> float:
        """Return the root mean square distance of a prediction, over all rows or a run [mm]."""
        off = (predicted - self.data.seen) * self.weights
        rows = self.data.runs == run if run else np.ones(len(off), dtype=np.bool_)
        squares = np.where(np.isfinite(off[rows]), off[rows] ** 2, 0.0).sum(axis=-1)
        count = np.isfinite(off[rows]).any(axis=-1).sum()
        return math.sqrt(squares.sum() / count) if count else math.nan

    @property
    def rms(self) -> float:
        """Root mean square distance over all rows, without a rest [mm]."""
        return self.measure_error(self.predicted)

    @property
    def residual(self) -> float:
        """`rms` [mm]."""
        return self.rms

    @property
    def errors(self) -> dict[str, dict[str, float]]:
        """Root mean square distances by run and by what predicts it [mm]."""
        forms = {"fit": self.predicted}
        if self.rest is not None:
            forms["fit and rest"] = self.predicted + self.rest
        forms |= {one.name: found for one, found in self.baselines}
        names = list(dict.fromkeys(self.data.runs.tolist()))
        return {
            name: {form: self.measure_error(found, name) for form, found in forms.items()}
            for name in names
        }

    def measure_coverage(self, band: Floats) -> float:
        """Return the share of what was seen within a band (q,) about the prediction."""
        off = np.abs(self.predicted - self.data.seen)
        known = np.isfinite(off)
        return float(((off <= band) & known).sum() / known.sum())

    def list_columns(self) -> Mapping[str, object]:
        """Return the columns of `to_frame`, a row for each row of the measurements."""
        columns: Json = {"run": self.data.runs}
        if self.data.times is not None:
            columns["time_s"] = self.data.times
        for k, name in enumerate(self.data.channels):
            columns[f"{name} seen"] = self.data.seen[:, k]
            columns[f"{name} fitted"] = self.predicted[:, k]
            if self.rest is not None:
                columns[f"{name} rest"] = self.rest[:, k]
        return columns

    def to_dict(self) -> Json:
        """Return the errors as plain values."""
        return {"rms_mm": self.rms, "rows": len(self.data), "errors_mm": to_plain(self.errors)}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw what was seen, and what is predicted, over rows or time; return the axes."""
        timed = self.data.times is not None
        axes = take_axes(ax, x="time [s]" if timed else "row", y="seen and fitted [mm, rad, N]")
        part = self.data.parts[0]
        over = self.data.times[part] if timed else np.arange(len(self.data))  # type: ignore[index]
        rows = part if timed else slice(None)
        for k, name in enumerate(self.data.channels):
            axes.plot(over, self.data.seen[rows, k], f"C{k}" if timed else f"C{k}o", label=name)
            axes.plot(over, self.predicted[rows, k], "k--" if timed else "kx", linewidth=0.8)
        axes.legend()
        return axes


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectorFit(Result):
    """What a fit of an end-effector found, and how far it can be trusted.

    Attributes
    ----------
    effector : Effector
        With the fitted numbers.
    view : TipView
        With the fitted numbers.
    scale : float
        Factor on the commanded pressures.
    estimates : tuple of FittedNumber
    interval_rule : str
        What the intervals take as independent.
    prediction : EffectorPrediction
        The rows that were fitted, and baselines beside them.
    left_out : EffectorPrediction, optional
        Each run by the fit to the others; None if there is one run only, or it was not asked for.
    band : ndarray, shape (q,), optional
        Half width within which 95 % of what was left out lies about its prediction.
    rest : Rest, optional
        What learned the rest.
    undetermined : tuple of str
        Sets of numbers that the data do not determine, a sentence each.
    warnings : tuple of str
        What the numbers suffer from.
    converged : bool
    reason : str
        Why the search ended.
    evaluations : int
    """

    effector: Effector
    view: TipView
    scale: float
    estimates: tuple[FittedNumber, ...] = rows_of(FittedNumber)
    interval_rule: str
    prediction: EffectorPrediction
    left_out: EffectorPrediction | None
    band: Floats | None
    rest: Rest | None
    undetermined: tuple[str, ...]
    warnings: tuple[str, ...]
    converged: bool
    reason: str
    evaluations: int

    @property
    def rms(self) -> float:
        """Root mean square distance over all rows fitted [mm]."""
        return self.prediction.rms

    @property
    def residual(self) -> float:
        """`rms` [mm]."""
        return self.rms

    @property
    def error(self) -> float:
        """Root mean square distance of runs left out [mm]; of those fitted if none were."""
        return self.rms if self.left_out is None else self.left_out.rms

    @property
    def is_poor(self) -> bool:
        """Whether `error` is above 5 % of the range of what was seen."""
        return not self.error <= POOR_SHARE * self._span

    @property
    def _span(self) -> float:
        seen = self.prediction.data.seen * self.prediction.weights
        return float(np.max(np.nanmax(seen, axis=0) - np.nanmin(seen, axis=0)))

    def predict(self, data: EffectorMeasurements) -> EffectorPrediction:
        """Return what it predicts of other measurements, with the rest and baselines of the fit.

        Raises
        ------
        InputError
            If they have other muscles, or see what was not fitted.
        """
        setup = EffectorSetup(self.effector, self.view, self.scale)
        observed = _Observer(data, setup)
        predicted, states = observed.observe(setup)
        baselines = tuple(
            (one, _run_baseline(one, data)) for one, _ in self.prediction.baselines
        ) if data.channels == self.prediction.data.channels else ()  # fmt: skip
        rest = None if self.rest is None else _predict_rest(self.rest, data, states)
        return EffectorPrediction(
            data=data, predicted=predicted, rest=rest, weights=observed.weights,
            baselines=baselines,
        )  # fmt: skip

    def to_dict(self) -> Json:
        """Return the fit as plain values."""
        return {
            "estimates": {
                one.name: {
                    "value": to_plain(one.value),
                    "unit": one.unit,
                    "standard_error": to_plain(one.standard_error),
                    "interval_95": [to_plain(one.low), to_plain(one.high)],
                }
                for one in self.estimates
            },
            "interval_rule": self.interval_rule,
            "fitted": self.prediction.to_dict(),
            "left_out": None if self.left_out is None else self.left_out.to_dict(),
            "band_95": to_plain(self.band),
            "undetermined": list(self.undetermined),
            "warnings": list(self.warnings),
            "converged": self.converged,
            "reason": self.reason,
            "evaluations": self.evaluations,
        }

    def format_table(self) -> str:
        """Return the numbers and errors as text."""
        rows = [
            [one.name, f"{one.value:.4g}", f"{one.low:.4g}", f"{one.high:.4g}", one.unit]
            for one in self.estimates
        ]
        lines = [format_rows(["number", "value", "from", "to (95 %)", "unit"], rows)]
        data = self.prediction.data
        count = len(np.unique(data.runs))
        lines.append(
            f"{len(self.estimates)} numbers, {len(data)} rows of {count} run(s): "
            f"{self.rms:.3g} mm rms"
            + ("" if self.left_out is None else f"; runs left out {self.left_out.rms:.3g} mm")
        )
        if self.prediction.baselines:
            lines.append(format_errors(self.prediction))
        lines += [f"not determined: {text}" for text in self.undetermined]
        lines += [f"warning: {text}" for text in self.warnings]
        return "\n".join([*lines, self.interval_rule])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the first run as seen and fitted, and return the axes."""
        return self.prediction.plot(ax)


def format_errors(found: EffectorPrediction) -> str:
    """Return a table of errors [mm] by run and by what predicts it."""
    errors = found.errors
    heads = list(next(iter(errors.values())))
    rows = [[name, *(f"{row[head]:.3g}" for head in heads)] for name, row in errors.items()]
    return format_rows(["run [mm rms]", *heads], rows)


@dataclass(frozen=True)
class _Observer:
    """Measurements, and how a setup answers to them."""

    data: EffectorMeasurements
    start: EffectorSetup
    _acted: dict[int, tuple[EffectorMotion, Floats, Acting]] = field(
        init=False, repr=False, default_factory=dict
    )

    def __post_init__(self) -> None:
        design = self.start.effector.design
        for name in self.data.muscles:
            design.index(name)
        if self.data.command == "pressure":
            self.data.check_range(design.pressure_limit)

    @property
    def commands(self) -> Floats:
        """Commands (n, m) of all muscles; one without a column has none."""
        design = self.start.effector.design
        columns = dict(zip(self.data.muscles, self.data.commands.T, strict=True))
        none = np.zeros(len(self.data))
        return np.stack([columns.get(name, none) for name in design.names], axis=-1)

    @property
    def weights(self) -> Floats:
        """Length that one unit of a channel stands for [mm]."""
        design = self.start.effector.design
        return np.array([
            design.backbone_length if name in ANGLES
            else design.compliance if name.endswith(" force") else 1.0
            for name in self.data.channels
        ])  # fmt: skip

    def observe(
        self, setup: EffectorSetup, parts: Sequence[slice] | None = None
    ) -> tuple[Floats, Floats]:
        """Return what a setup shows (n, q), and pressures that act (n, m), of some runs or all."""
        effector, data = setup.effector, self.data
        commands = self.commands * (setup.scale if data.command == "pressure" else 1.0)
        predicted = np.full(data.seen.shape, np.nan)
        acting = np.zeros(commands.shape)
        chosen = data.parts if parts is None else parts
        if data.times is None:
            chosen = [slice(0, len(data))]
        rows = np.concatenate([np.arange(part.start, part.stop) for part in chosen])
        forces = None
        if data.command == "contraction":
            bends, forces = _contract(effector, commands[rows])
        elif data.times is None:
            acting[rows] = commands[rows]
            bends = find_bends(effector, acting[rows])
        else:
            acts = [
                self._act(effector.motion, part.start, data.times[part], commands[part])
                for part in chosen
            ]
            acting[rows] = np.concatenate([act.effective[0] for act in acts])
            bends = find_bends(effector, acting[rows])
            starts = np.cumsum([0, *(part.stop - part.start for part in chosen)])
            for part, act, start in zip(chosen, acts, starts[:-1], strict=True):
                own = bends[start : start + part.stop - part.start]
                own[:] = effector.motion.move(data.times[part], own[None], state=act.state)[0][0]
        predicted[rows] = self._look(setup, bends, forces, acting[rows])
        if "azimuth" in data.channels:  # as it was read: 350 deg is near -5 deg
            k = data.channels.index("azimuth")
            turns = np.round((data.seen[:, k] - predicted[:, k]) / (2.0 * np.pi))
            predicted[:, k] += 2.0 * np.pi * np.nan_to_num(turns)
        return predicted, acting

    def _act(self, motion: EffectorMotion, row: int, times: Floats, commands: Floats) -> Acting:
        """Return what acts in a run from a row on.

        Most numbers that a search changes leave it as it was.
        """
        known = self._acted.get(row)
        if known is None or known[0] != motion or not np.array_equal(known[1], commands):
            act = motion.act(times, commands[None].copy(), initial=None)
            known = self._acted[row] = motion, commands, act
        return known[2]

    def _look(
        self, setup: EffectorSetup, bends: Floats, forces: Floats | None, acting: Floats
    ) -> Floats:
        channels, names = self.data.channels, setup.effector.design.names
        pulls = [name for name in channels if name.endswith(" force")]
        places = [name for name in channels if name not in pulls]
        found = dict(
            zip(places, setup.view.observe(setup.effector, bends, channels=places).T, strict=True)
            if places else ()
        )  # fmt: skip
        for name in pulls:
            muscle = setup.effector.design.index(name.removesuffix(" force"))
            if forces is None:
                forces = _pull(setup.effector, acting)
            found[name] = forces[:, muscle]
        del names
        return np.stack([found[name] for name in channels], axis=-1)


def _contract(effector: Effector, contractions: Floats) -> tuple[Floats, Floats]:
    """Return lateral deflections (n, 2) and pulls (n, m) of muscles held at contractions (n, m)."""
    packed = effector.packed
    lateral = lateral_deflection(effector.design, contractions)
    bends = np.stack([lateral @ packed.cosines, lateral @ packed.sines], axis=-1)
    return bends, lateral / effector.design.compliance


def _pull(effector: Effector, pressures: Floats) -> Floats:
    """Return the pulls (n, m) of muscles at rest, each alone on the section."""
    return effector.forward(pressures).force


def _predict_rest(rest: Rest, data: EffectorMeasurements, states: Floats) -> Floats:
    found = np.empty(data.seen.shape)
    for over, own, part in _list_states(data, states):
        found[part] = rest.predict(over, own)
    return found


def _list_states(data: EffectorMeasurements, states: Floats) -> list[tuple[Floats, Floats, Places]]:
    """Return times and states of each run, and its rows."""
    times = _APART * np.arange(len(data)) if data.times is None else data.times
    runs = [np.flatnonzero(data.runs == name) for name in dict.fromkeys(data.runs.tolist())]
    return [(times[rows] - times[rows[0]], states[rows], rows) for rows in runs]


def _run_baseline(one: Baseline, data: EffectorMeasurements) -> Floats:
    found = np.empty(data.seen.shape)
    for part in data.parts:
        found[part] = one.predict(data.commands[part], data.seen[part])
    return found


def check_measurements(setup: EffectorSetup, data: EffectorMeasurements) -> None:
    """Raise `InputError` if a setup has no answer to measurements: other muscles, say."""
    _Observer(data, setup).observe(setup)


def fit_effector(
    effector: Effector,
    data: EffectorMeasurements,
    *,
    free: Sequence[str],
    view: TipView | None = None,
    options: EffectorFitOptions | None = None,
    progress: Progress = no_progress,
) -> EffectorFit:
    """Fit numbers of an end-effector, and of how it is seen, to measurements.

    A run in time is computed from its commands alone, its muscles brought up to the first ones
    before; the distances between what is computed and seen are made small.

    Parameters
    ----------
    effector : Effector
        Where the search begins; what is not free stays.
    data : EffectorMeasurements
    free : sequence of str
        Names of numbers, see `bozzini.effector.unknowns.parse_unknowns`.
    view : TipView, optional
        How it is seen, to begin with.
    options : EffectorFitOptions, optional
    progress : callable
        Told the share that is done.

    Raises
    ------
    InputError
        If a name, a muscle or a channel is not there, a command is not legal, or rows are too few.
    """
    check_kind("effector", effector, EffectorModel)
    check_kind("data", data, EffectorMeasurements)
    chosen = options or EffectorFitOptions()
    start = EffectorSetup(effector, view or TipView())
    unknowns = parse_unknowns(start, free)
    observer = _Observer(data, start)
    for name, column in zip(data.channels, data.seen.T, strict=True):
        if not np.isfinite(column).any():
            raise InputError(f"nothing was seen of '{name}': leave the column out")
    if chosen.rest and data.command != "pressure":
        raise InputError("a rest is learned of pressures: leave it out where there are none")
    kept = np.flatnonzero(np.isfinite(data.seen).any(axis=-1))
    part_of = np.repeat(np.arange(len(data.parts)), [p.stop - p.start for p in data.parts])

    def miss(changes: Mapping[str, Floats], rows: Places) -> Floats:
        places = kept[rows]
        parts = [data.parts[k] for k in np.unique(part_of[places])]
        try:
            setup = change_setup(start, unknowns, changes)
            predicted, _ = observer.observe(setup, parts)
        except InputError:  # between numbers that are legal one by one
            return np.full((len(places), len(data.channels)), BAD_NUMBERS)
        off = (predicted[places] - data.seen[places]) * observer.weights
        off[np.isnan(predicted[places])] = BAD_NUMBERS  # a spot that misses the board
        return np.where(np.isfinite(data.seen[places]), off, 0.0)

    observer.observe(start)  # refuses what has no answer to begin with
    progress("fitting", 0.0)
    found = estimate(
        miss,
        [one.parameter for one in unknowns],
        labels=data.runs[kept],
        options=chosen.estimate,
    )
    progress("leaving runs out", 0.5)
    setup = change_setup(start, unknowns, found.values)
    predicted, states = observer.observe(setup)
    timed = data.times is not None
    pairs = [(data.commands[part], data.seen[part]) for part in data.parts]
    boxes = [learn(pairs) for learn in BASELINES] if timed else []
    baselines = tuple((one, _run_baseline(one, data)) for one in boxes)
    left_out, band = None, None
    if chosen.leave_out and len(np.unique(data.runs[kept])) > 1:
        off = np.full(data.seen.shape, np.nan)
        off[kept] = found.leave_out() / observer.weights
        off[~np.isfinite(data.seen)] = np.nan
        away = data.seen + off
        left_out = EffectorPrediction(
            data=data, predicted=away, rest=None, weights=observer.weights
        )
        band = np.nanquantile(np.abs(off), COVERED, axis=0)
    rest, added = None, None
    if chosen.rest:
        listed = _list_states(data, states)
        rest = RESTS.choose(chosen.rest)().learn(
            [(over, own) for over, own, _ in listed],
            [data.seen[rows] - predicted[rows] for *_, rows in listed],
        )
        added = _predict_rest(rest, data, states)
    progress("fitted", 1.0)
    fit = EffectorFit(
        effector=setup.effector,
        view=setup.view,
        scale=setup.scale,
        estimates=_list_numbers(unknowns, found),
        interval_rule=found.spread.describe(),
        prediction=EffectorPrediction(
            data=data,
            predicted=predicted,
            rest=added,
            weights=observer.weights,
            baselines=baselines,
        ),
        left_out=left_out,
        band=band,
        rest=rest,
        undetermined=found.undetermined,
        warnings=found.warnings,
        converged=found.converged,
        reason=found.reason,
        evaluations=found.evaluations,
    )
    if fit.is_poor:
        poor = (
            f"the fit is poor: {fit.error:.3g} mm is more than {100.0 * POOR_SHARE:.0f} % of the "
            f"range of {fit._span:.3g} mm"
        )
        return _warn(fit, poor)
    return fit


def _warn(fit: EffectorFit, text: str) -> EffectorFit:
    import dataclasses

    return dataclasses.replace(fit, warnings=(*fit.warnings, text))


def _list_numbers(unknowns: Sequence[FreeNumber], found: Estimation) -> tuple[FittedNumber, ...]:
    """Return the numbers with their intervals: what was fitted are changes of where it began."""
    begin = np.concatenate([one.begin for one in unknowns])
    units = [one.known.unit for one in unknowns for _ in one.begin]
    rows = zip(found.names, begin, found.point, found.intervals, found.deviations, units,
               strict=True)  # fmt: skip
    return tuple(
        FittedNumber(name, float(was + x), float(was + low), float(was + high), unit, float(error))
        for name, was, x, (low, high), error, unit in rows
    )
