"""Constants of the plant from measured pressure curves: filling a muscle, and leaking from it."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from ..checks import check_number, show_apart
from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.estimation import make_blocks, measure_spread
from ..numeric.least_squares import LeastSquares
from ..results import Result, measured, take_axes
from .curves import PressureCurve
from .kernels import fill as kernels
from .pneumatics import ATMOSPHERE, NOZZLE_RATIO, NOZZLE_SPEED, Orifice

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FillLaw = Literal["orifice", "regulator", "upstream", "growing"]
FILL_LAWS: tuple[FillLaw, ...] = get_args(FillLaw)
"""Laws of a fill, see `identify_fill`; the simpler ones first."""

LeakLaw = Literal["orifice leak", "laminar leak"]
LEAK_LAWS: tuple[LeakLaw, ...] = get_args(LeakLaw)
"""Laws of a leak, see `identify_leak`."""

SHARE = 0.9
"""Share of the change of pressure whose time is compared with the measured one."""
LEAST_CHANGE = 0.01
"""Smallest change of pressure that is a fill or a leak [MPa]."""
GRID = 240
"""Pressures at which the time of a leak is computed."""
POINTS = 160
"""Points of a curve that are fitted; longer ones are averaged to so many."""
USED_SPAN = 3.0
"""A fill is fitted up to so many times its time to 90 %."""
MISFIT = 0.03
"""Residual (rms, over the change) above which a law does not describe a curve."""
CHECK_MISFIT = 0.015
"""The same in a check, where a law has to do more than to describe."""
AS_GOOD = 1.1
"""A simpler law is preferred whose residual is at most so many times the smallest one."""
NEGLIGIBLE = 0.002
"""Residual (rms, over the change) below which a law needs no better one."""
CHECK_SHARE = 0.8
"""Share of the change up to which a curve is used in a check, by default."""
CHECK_POINTS = 10
"""Fewest points of a curve after its 5 % from which the rest is predicted."""
CHECK_ERROR = 0.01
"""Residual (over the change) that weighs as much as one standard deviation of a constant."""
LARGE_ERROR = 0.5
"""Standard error over the value above which a constant is not determined."""


@dataclass(frozen=True)
class _Constant:
    """A constant of a law, as a fit has it."""

    name: str
    unit: str = ""
    first: float = 0.0
    low: float = -math.inf
    high: float = math.inf
    spread: float = 1.0
    """How much of it matters, and the least spread between curves in a check."""
    is_log: bool = False


_CONSTANTS = {
    item.name: item
    for item in (
        _Constant("delay", "s"),
        _Constant("time constant", "s", is_log=True),
        _Constant("start", "MPa", spread=0.005),
        _Constant("supply", "MPa", spread=0.01),
        _Constant("critical ratio", first=0.4, low=0.05, high=0.9, spread=0.1),
        _Constant(
            "droop", first=math.log(0.3), low=math.log(0.01), high=math.log(20.0), spread=0.3,
            is_log=True,
        ),
        _Constant("growth", first=3.0, low=0.0, high=12.0, spread=1.0),
        _Constant("growth pressure", "MPa", first=0.15, low=0.0, high=0.5, spread=0.02),
        _Constant("growth width", "MPa", first=0.07, low=0.01, high=0.2, spread=0.015),
        _Constant("settling", "MPa", first=0.005, low=0.0, high=0.1, spread=0.005),
        _Constant("settling time", "s", is_log=True),
    )
}  # fmt: skip
_OWN = ("delay", "time constant", "start", "supply")
_LAWS: dict[str, tuple[str, ...]] = {
    "orifice": (*_OWN, "critical ratio"),
    "regulator": (*_OWN, "droop"),
    "upstream": (*_OWN, "droop"),
    "growing": (*_OWN, "droop", "growth", "growth pressure", "growth width"),
    "orifice leak": ("time constant", "start", "settling", "settling time"),
    "laminar leak": ("time constant", "start", "settling", "settling time"),
}
"""Laws and their constants; the fits take the laws in this order."""
_SHARED = ("critical ratio", "droop", "growth", "growth pressure", "growth width")

_FILL_NUMBERS = {name: 0.0 for name in _OWN} | {
    "critical ratio": NOZZLE_RATIO,
    "droop": 0.0,
    "growth": 0.0,
    "growth pressure": 0.0,
    "growth width": 1.0,
}
"""What a fill has where its law has no such constant, in the order of the kernel."""


def regulated_flow(ratio: Floats, critical: float, droop: float) -> Floats:
    """Return the flow of an orifice behind a regulator, over its choked flow without droop.

    The pressure before the orifice is ``1 - droop w`` of the supply's at a flow ``w``, and
    ``ratio`` is the pressure behind it over the supply's, both absolute. Choked that is linear in
    ``w``; on the ellipse of ISO 6358 it is a quadratic equation.
    """
    return np.asarray(kernels.regulated_flows(np.asarray(ratio, np.float64), critical, droop))


def _trace_leak(law: str, given: Mapping[str, float]) -> tuple[Floats, Floats]:
    """Return times [s] and gauge pressures [MPa] along a leak, before the gas settles."""
    start, tau = given["start"], given["time constant"]
    pressure = start * np.geomspace(1.0, 1e-3, GRID)
    if law == "orifice leak":
        clock = Orifice(area=1.0 / NOZZLE_SPEED).vent_time(1.0, start, end=pressure)
    else:
        whole = pressure + ATMOSPHERE
        share = (whole - ATMOSPHERE) / (whole + ATMOSPHERE)
        clock = np.log(share[0] / share)
    return tau * clock, pressure


def _predict(law: str, given: Mapping[str, float], time: Floats) -> Floats:
    """Return the gauge pressures of a law at rising times [MPa]."""
    if law in LEAK_LAWS:
        settling = given["settling"] * np.exp(-time / given["settling time"])
        return np.asarray(np.interp(time, *_trace_leak(law, given)) + settling)
    numbers = tuple(given.get(name, rest) for name, rest in _FILL_NUMBERS.items())
    return np.asarray(kernels.fill(numbers, law == "upstream", ATMOSPHERE, time))


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveFit(Result):
    """A law fitted to one curve.

    Attributes
    ----------
    curve : PressureCurve
        The curve.
    law : str
        One of `FILL_LAWS` or `LEAK_LAWS`.
    constants, standard_errors : dict
        Constants of the law by name, and their standard errors [s, MPa or shares], of runs of
        points that count as independent (`bozzini.numeric.estimation.measure_spread`).
    undetermined : tuple of str
        Constants that the curve does not determine.
    residual, largest : float
        Root mean square and largest residual of the points fitted [MPa].
    change : float
        Change of the pressure in the curve [MPa].
    measured_time, model_time : float
        Time from the curve's 5 % to 90 % of its change, measured and by the law [s].
    used : float
        Share of the change up to which the curve was used, 1 for all of it.
    converged : bool
        Whether the law describes the curve, up to `MISFIT` of its change.
    reason : str
        Why not.
    """

    curve: PressureCurve = field(repr=False)
    law: str
    constants: dict[str, float]
    standard_errors: dict[str, float]
    undetermined: tuple[str, ...]
    residual: float = measured("MPa")
    largest: float = measured("MPa")
    change: float = measured("MPa")
    measured_time: float = measured("s")
    model_time: float = measured("s")
    used: float
    converged: bool
    reason: str

    @property
    def time_error(self) -> float:
        """Error of the model's time over the measured one."""
        return self.model_time / self.measured_time - 1.0

    def find_area(self, volume: float) -> float:
        """Return the effective area [mm^2] of the orifice, or leak, of a known volume [mm^3].

        The volume is that of the grown muscle and its line: ``volume / (time constant v)``.

        Raises
        ------
        InputError
            If the law is no orifice, or the volume is not positive.
        """
        if self.law == "laminar leak":
            raise InputError("a laminar leak has no effective area: its law is no orifice")
        size = check_number("volume", volume, low=0.0, low_open=True, unit="mm^3")
        return size / (self.constants["time constant"] * NOZZLE_SPEED)

    def predict(self, time: Floats) -> Floats:
        """Return the gauge pressure of the law at times of the curve [MPa]."""
        return _predict(self.law, self.constants, np.asarray(time) - _begin(self.curve))

    def list_row(self) -> dict[str, object]:
        """Return the row of a table."""
        row: dict[str, object] = {
            "curve": self.curve.name,
            "law": self.law,
            "used": self.used,
            "residual_MPa": self.residual,
            "change_MPa": self.change,
            "measured_time_s": self.measured_time,
            "model_time_s": self.model_time,
            "time_error": self.time_error,
        }
        for name, known in _CONSTANTS.items():
            if name in self.constants:
                key = name.replace(" ", "_") + (f"_{known.unit}" if known.unit else "")
                row[key] = self.constants[name]
        return row | {"described": self.converged, "reason": self.reason}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the curve and its law, and return the axes."""
        axes = self.curve.plot(take_axes(ax, x="time [s]", y="pressure [kPa]"))
        time = np.linspace(self.curve.time[0], self.curve.time[-1], 800)
        color = axes.lines[-1].get_color()
        dash = "-" if self.used >= 1.0 else "--"
        axes.plot(time, 1e3 * self.predict(time), color=color, linewidth=1.2, linestyle=dash)
        return axes


def _begin(curve: PressureCurve) -> float:
    return float(curve.time[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class Identification(Result):
    """Laws fitted to curves of one kind, and how well they carry over to others.

    Attributes
    ----------
    kind : str
        ``"fill"`` or ``"leak"``.
    fits : tuple of CurveFit
        The curves that were fitted.
    checks : tuple of CurveFit
        The curves that were checked: used only up to a share of their change.
    notes : tuple of str
        What the data do not determine, and what was assumed.
    """

    kind: str
    fits: tuple[CurveFit, ...] = field(repr=False)
    checks: tuple[CurveFit, ...] = field(repr=False, default=())
    notes: tuple[str, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether a law describes each curve."""
        return all(fit.converged for fit in (*self.fits, *self.checks))

    @property
    def reason(self) -> str:
        """Which curves no law describes."""
        wrong = [f"{fit.curve.name}: {fit.reason}" for fit in self._all if not fit.converged]
        return "; ".join(wrong)

    @property
    def _all(self) -> tuple[CurveFit, ...]:
        return (*self.fits, *self.checks)

    @property
    def residual(self) -> float:
        """Root mean square of the residuals of the curves fitted [MPa]."""
        return float(np.sqrt(np.mean([fit.residual**2 for fit in self.fits])))

    @property
    def worst_time_error(self) -> float:
        """Largest error of the time to 90 %, of the checks if there are any."""
        return max(abs(fit.time_error) for fit in self.checks or self.fits)

    def list_columns(self) -> Mapping[str, object]:
        """Return the columns of `to_frame`, a row for each curve; None where a law has no value."""
        rows = [
            {"part": part, **fit.list_row()}
            for part, fits in (("fit", self.fits), ("check", self.checks))
            for fit in fits
        ]
        names = list(dict.fromkeys(name for row in rows for name in row))
        names = [n for n in names if n not in ("described", "reason")] + ["described", "reason"]
        return {name: [row.get(name) for row in rows] for name in names}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the curves and their laws, dashed where only the beginning was used."""
        axes = take_axes(ax, x="time [s]", y="pressure [kPa]")
        for fit in self._all:
            fit.plot(axes)
        if self.kind == "fill":
            begins = [_begin(fit.curve) for fit in self._all]
            spans = [2.0 * fit.measured_time for fit in self._all]
            ends = [begin + span for begin, span in zip(begins, spans, strict=True)]
            axes.set_xlim(min(begins), max(ends))
        axes.legend(frameon=False, fontsize=8, markerscale=4)
        return axes

    def check(
        self, curves: Sequence[PressureCurve], *, share: float = CHECK_SHARE
    ) -> Identification:
        """Return this identification with other curves checked.

        Of each only the part up to a share of its change is used. From this come its delay, time
        constant and start; the supply and the shape of the law are those of the curves fitted, each
        within its spread between them (a normal prior). What then is compared is the time to 90 %
        of the change, which is beyond what was used.

        Parameters
        ----------
        curves : sequence of PressureCurve
            Curves that were not fitted.
        share : float
            Share of the change, in [0.3, 0.89].

        Raises
        ------
        InputError
            If the share is not legal, or a curve is none of this kind.
        """
        part = check_number("share", share, low=0.3, high=0.89)
        found = tuple(_check_curve(curve, self, part) for curve in curves)
        return Identification(kind=self.kind, fits=self.fits, checks=found, notes=self.notes)


def find_kind(curve: PressureCurve) -> str:
    """Return ``"fill"`` for a curve that ends above its beginning, ``"leak"`` for another."""
    few = max(1, curve.time.size // 50)
    ends = np.median(curve.pressure[:few]), np.median(curve.pressure[-few:])
    return "fill" if ends[1] > ends[0] else "leak"


def identify_fill(curves: Sequence[PressureCurve]) -> Identification:
    """Find which law describes how muscles fill, and its constants, from curves of pressure.

    Four laws, each of a volume that fills through an orifice of ISO 6358 from a supply:

    - ``orifice``: constant supply, constant volume; the critical ratio is fitted;
    - ``regulator``: the pressure before the orifice falls with the flow, by the share `droop` at
      the orifice's choked flow without droop: a regulator, or a line that resists;
    - ``upstream``: the same, and the transducer is before the orifice;
    - ``growing``: ``regulator``, of a volume that grows by the factor ``1 + growth`` about a
      pressure, along a logistic of a width: the muscle.

    The simplest that is not much worse than the best is taken. `time constant` is the (grown)
    volume over effective area and `NOZZLE_SPEED`: from a pressure alone neither follows.

    Parameters
    ----------
    curves : sequence of PressureCurve
        At least one.

    Raises
    ------
    InputError
        If there is none, or a curve does not rise.
    """
    return _identify("fill", curves, FILL_LAWS)


def identify_leak(curves: Sequence[PressureCurve]) -> Identification:
    """Find which law describes how muscles leak, and its constants, from curves of pressure.

    A volume empties into the surroundings through an orifice of ISO 6358 (``orifice leak``,
    `time constant` as in `identify_fill`) or a narrow gap (``laminar leak``, ``dp/dt = -(p**2 -
    pa**2) / (2 pa tau)`` in absolute pressures). At first the pressure also settles by a few kPa,
    exponentially, as the gas cools and the muscle creeps.

    Parameters
    ----------
    curves : sequence of PressureCurve
        At least one.

    Raises
    ------
    InputError
        If there is none, or a curve does not fall.
    """
    return _identify("leak", curves, LEAK_LAWS)


def _identify(kind: str, curves: Sequence[PressureCurve], laws: Sequence[str]) -> Identification:
    if not curves:
        raise InputError(f"there are no curves: give at least one {kind}")
    fits = tuple(_fit_curve(curve, kind, laws) for curve in curves)
    return Identification(kind=kind, fits=fits, notes=tuple(_list_notes(kind, fits)))


def _list_notes(kind: str, fits: Sequence[CurveFit]) -> list[str]:
    names: dict[str, list[str]] = {}
    for fit in fits:
        for note in fit.curve.notes:
            names.setdefault(note, []).append(fit.curve.name)
    notes = [f"{', '.join(found)}: {note}" for note, found in names.items()]
    count = Counter(fit.law for fit in fits if fit.converged)
    for law, number in count.most_common():
        notes.append(f"{number} of {len(fits)} curves follow the law '{law}'")
    if kind == "leak":
        notes.append("volume and leak are not determined, only their ratio: the time constant")
        return notes
    notes.append("volume and area are not determined, only their ratio: the time constant")
    if any(law != "orifice" for law in count):
        notes.append(
            f"critical ratio held at {NOZZLE_RATIO:g}: beside a droop it changes the curve little"
        )
    steps = [float(np.median(np.diff(fit.curve.time))) for fit in fits]
    notes.append(
        f"a lag of valve or transducer below the sampling time of {1e3 * min(steps):.3g} ms is "
        "part of the delay"
    )
    return notes


@dataclass(frozen=True)
class _Shape:
    """What is read off a curve before any fit."""

    time: Floats
    smooth: Floats
    """Pressure made monotone."""
    start: float
    end: float
    resolution: float
    """Smallest step between two different readings [MPa]."""
    early: float = 0.0
    """Time at which 5 % of the change is passed."""
    late: float = 0.0
    """Time at which 90 % of the change is passed."""

    @property
    def change(self) -> float:
        return abs(self.end - self.start)

    def cross(self, share: float) -> float:
        """Return the time at which a share of the change is passed."""
        level = self.start + share * (self.end - self.start)
        rising = self.end > self.start
        index = int(np.argmax(self.smooth >= level if rising else self.smooth <= level))
        if index == 0:
            return float(self.time[0])
        low, high = self.smooth[index - 1], self.smooth[index]
        part = (level - low) / (high - low)
        return float(self.time[index - 1] + part * (self.time[index] - self.time[index - 1]))


def _read_shape(curve: PressureCurve, kind: str) -> _Shape:
    from scipy.optimize import isotonic_regression

    time = curve.time - _begin(curve)
    rising = kind == "fill"
    smooth = isotonic_regression(curve.pressure, increasing=rising).x
    few = max(1, curve.time.size // 100)
    start, end = float(smooth[0]), float(np.median(curve.pressure[-few:]))
    change = end - start if rising else start - end
    if not change > LEAST_CHANGE:
        shown = show_apart(1e3 * (end - start), 1e3 * LEAST_CHANGE)
        raise InputError(
            f"{curve.name}: the pressure changes by {shown[0]} kPa: a {kind} must "
            f"{'rise' if rising else 'fall'} by more than {shown[1]} kPa"
        )
    steps = np.diff(np.unique(curve.pressure))
    shape = _Shape(time, smooth, start, end, float(steps.min()))
    return dataclasses.replace(shape, early=shape.cross(0.05), late=shape.cross(SHARE))


def _select_points(curve: PressureCurve, until: float) -> tuple[Floats, Floats]:
    """Return at most `POINTS` means of a curve up to a time, evenly along it."""
    time = curve.time - _begin(curve)
    inside = time <= until
    time, pressure = time[inside], curve.pressure[inside]
    if time.size <= POINTS:
        return time, pressure
    # Half of the points go where the time goes, half where the pressure goes.
    rise = np.maximum.accumulate(np.abs(pressure - pressure[0]))
    along = time / max(time[-1], 1e-12) + rise / max(rise[-1], 1e-12)
    place = np.minimum((along / along[-1] * POINTS).astype(int), POINTS - 1)
    count = np.bincount(place, minlength=POINTS)
    held = count > 0
    return tuple(  # type: ignore[return-value]
        np.bincount(place, weights=values, minlength=POINTS)[held] / count[held]
        for values in (time, pressure)
    )


def _set_limits(shape: _Shape, law: str) -> dict[str, _Constant]:
    """Return the constants of a law with starts and ranges that suit a curve."""
    span = shape.late - shape.early
    far = max(shape.time[-1], span)
    step = shape.time[-1] / shape.time.size
    start = _Constant("start", "MPa", shape.start, shape.start - 0.03, shape.start + 0.03, 0.005)
    if law in LEAK_LAWS:
        drop = math.log((shape.start + ATMOSPHERE) / (shape.end + ATMOSPHERE))
        own: dict[str, tuple[float, float, float, float]] = {
            "time constant": (math.log(far / drop), math.log(1e-3 * far), math.log(1e6 * far), 0.3),
            "settling time": (math.log(0.05 * far), math.log(step), math.log(0.3 * far), 0.5),
        }
        low = max(0.5 * shape.start, shape.start - 0.2)
        start = _Constant("start", "MPa", shape.start, low, shape.start + 0.05, 0.02)
    else:
        middle = math.log(0.5 * span)
        own = {
            "delay": (shape.early, -span, shape.early + 0.3 * span + step, 0.05 * span + step),
            "time constant": (middle, middle - 6.0, middle + 4.5, 0.5),
            "supply": (
                shape.end,
                shape.end - 0.1 * shape.change,
                shape.end + 0.5 * shape.change,
                0.01,
            ),
        }
    limits = {
        name: _Constant(name, _CONSTANTS[name].unit, *values, is_log=_CONSTANTS[name].is_log)
        for name, values in own.items()
    }
    limits["start"] = start
    return {name: limits.get(name, _CONSTANTS[name]) for name in _LAWS[law]}


Prior = Mapping[str, tuple[float, float]]
"""Means and standard deviations of constants, logarithms where a fit has these."""


@dataclass(frozen=True)
class _Solution:
    law: str
    values: Floats
    """As the fit has them."""
    errors: Floats
    at_limit: tuple[str, ...]
    residuals: Floats
    """Of the points [MPa]."""

    @property
    def size(self) -> float:
        return _root_mean_square(self.residuals)

    @property
    def names(self) -> tuple[str, ...]:
        return _LAWS[self.law]

    @property
    def constants(self) -> dict[str, float]:
        pairs = zip(self.names, self.values, strict=True)
        return {n: math.exp(v) if _CONSTANTS[n].is_log else float(v) for n, v in pairs}


def _solve(
    law: str,
    shape: _Shape,
    points: tuple[Floats, Floats],
    prior: Prior | None = None,
    *,
    supply: float | None = None,
) -> _Solution:
    """Fit a law to points, from several starts."""
    known = _set_limits(shape, law)
    names = list(known)
    low, first, high = (
        np.array([getattr(item, part) for item in known.values()])
        for part in ("low", "first", "high")
    )
    if supply is not None and "supply" in names:
        place = names.index("supply")
        low[place], first[place], high[place] = supply - 1e-6, supply, supply + 1e-6
    means = prior or {}
    for name, (mean, _) in means.items():
        if name in names:
            place = names.index(name)
            low[place], high[place] = min(low[place], mean), max(high[place], mean)
            first[place] = mean
    first = np.clip(first, low + 1e-9 * (1.0 + np.abs(low)), high - 1e-9 * (1.0 + np.abs(high)))
    scale = np.array([item.spread for item in known.values()])
    time, pressure = points
    unit, enough = CHECK_ERROR * shape.change, NEGLIGIBLE * shape.change

    def find_residuals(values: Floats) -> Floats:
        pairs = zip(names, values, strict=True)
        given = {n: math.exp(v) if _CONSTANTS[n].is_log else float(v) for n, v in pairs}
        return np.asarray(_predict(law, given, time) - pressure)

    # The points of a curve err alike: together they weigh as much as the square root of them.
    weight = 1.0 / unit if prior is None else 1.0 / (unit * len(time) ** 0.25)

    def excess(values: Floats) -> Floats:
        parts = [weight * find_residuals(values)]
        pairs = zip(names, values, strict=True)
        parts += [np.array([(v - means[n][0]) / means[n][1]]) for n, v in pairs if n in means]
        return np.concatenate(parts)

    search = LeastSquares(
        misfit=excess, bounds=(low, high), margin=1e-6, scale=scale, loss="soft_l1",
        xtol=1e-6, ftol=1e-6, gtol=1e-6,
    )  # fmt: skip
    best = search.search(
        [first + shift for shift in _list_starts(law, names)],
        evaluations=120,
        enough=lambda end: _root_mean_square(find_residuals(end.point)) < enough,
    )
    values = best.point
    residuals = find_residuals(values)
    # The points are in the order of time; what was known before is a block for each constant.
    blocks, count = make_blocks([""] * len(time)), len(best.misfit)
    known_before = blocks.of_row.max() + 1 + np.arange(count - len(time))
    blocks = dataclasses.replace(blocks, of_row=np.append(blocks.of_row, known_before))
    misfit = best.misfit * (1.0 + best.misfit**2) ** 0.25  # as SciPy scales the Jacobian of soft_l1
    errors = measure_spread(best.slope, misfit, blocks, lost=True).deviations
    near = 1e-3 * (high - low)
    stuck = tuple(
        name
        for name, value, a, b, c in zip(names, values, low, high, near, strict=True)
        if name != "supply" and not a + c < value < b - c
    )
    return _Solution(law, values, errors, stuck, residuals)


def _root_mean_square(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _list_starts(law: str, names: list[str]) -> list[Floats]:
    """Return shifts of the first guess from which a law is fitted."""
    shifts = [np.zeros(len(names))]
    if "droop" in names:
        more = np.zeros(len(names))
        more[names.index("droop")], more[names.index("time constant")] = 1.2, -1.0
        shifts.append(more)
    return shifts


def _fit_curve(curve: PressureCurve, kind: str, laws: Sequence[str]) -> CurveFit:
    shape = _read_shape(curve, kind)
    if kind == "fill" and curve.supply is not None and curve.supply < shape.end - LEAST_CHANGE:
        raise InputError(
            f"{curve.name}: the supply is {curve.supply:g} MPa, below the {shape.end:g} MPa reached"
        )
    until = shape.time[-1]
    if kind == "fill":
        until = min(until, shape.early + USED_SPAN * (shape.late - shape.early))
    points = _select_points(curve, until)
    found: list[_Solution] = []
    for law in laws:
        found.append(_solve(law, shape, points, supply=curve.supply))
        if found[-1].size <= NEGLIGIBLE * shape.change:
            break
    least = min(item.size for item in found)
    enough = max(AS_GOOD * least, NEGLIGIBLE * shape.change)
    chosen = next(item for item in found if item.size <= enough)
    return _report(curve, shape, chosen, 1.0)


def _report(curve: PressureCurve, shape: _Shape, found: _Solution, used: float) -> CurveFit:
    errors = {}
    for name, value, error in zip(found.names, found.values, found.errors, strict=True):
        errors[name] = float(error) * (math.exp(value) if _CONSTANTS[name].is_log else 1.0)
    constants = found.constants
    loose = tuple(
        name
        for name in found.names
        if name in found.at_limit
        or (name in _SHARED and errors[name] > LARGE_ERROR * abs(constants[name]))
    )
    model_time = _find_model_time(shape, found)
    reason = _find_reason(shape, found.size, model_time, used)
    return CurveFit(
        curve=curve,
        law=found.law,
        constants=constants,
        standard_errors=errors,
        undetermined=loose,
        residual=found.size,
        largest=float(np.abs(found.residuals).max()),
        change=shape.change,
        measured_time=shape.late - shape.early,
        model_time=model_time,
        used=used,
        converged=not reason,
        reason=reason,
    )


def _find_reason(shape: _Shape, residual: float, model_time: float, used: float) -> str:
    """Return why a law does not describe a curve, or cannot predict the rest of it."""
    if used < 1.0:
        last = shape.cross(used)
        inside = int(np.count_nonzero((shape.time >= shape.early) & (shape.time <= last)))
        if inside < CHECK_POINTS:
            return (
                f"there are {inside} points between 5 and {100 * used:g} % of the change: at least "
                f"{CHECK_POINTS} are needed to predict the rest"
            )
    limit = MISFIT if used >= 1.0 else CHECK_MISFIT
    if residual > max(limit * shape.change, shape.resolution):
        share = 100.0 * residual / shape.change
        return f"no law fits: the residual is {share:.1f} % of the change"
    if not math.isfinite(model_time):
        return "by the law the pressure never passes 90 % of the change"
    return ""


def _find_model_time(shape: _Shape, found: _Solution) -> float:
    """Return the time from the measured 5 % to where the law passes 90 % [s]."""
    level = shape.start + SHARE * (shape.end - shape.start)
    rising = shape.end > shape.start
    last = shape.time[-1]
    for _ in range(8):
        time = np.linspace(0.0, last, 4000)
        pressure = _predict(found.law, found.constants, time)
        beyond = pressure >= level if rising else pressure <= level
        # From the last time that it is not yet beyond: a law may jump at first and come back.
        if beyond[-1]:
            index = beyond.size - int(np.argmin(beyond[::-1])) if not beyond.all() else 0
            return float(time[min(index, time.size - 1)]) - shape.early
        last *= 4.0
    return math.inf


def _check_curve(curve: PressureCurve, known: Identification, share: float) -> CurveFit:
    """Fit the beginning of a curve with what the others have in common, and predict the rest."""
    shape = _read_shape(curve, known.kind)
    points = _select_points(curve, shape.cross(share))
    good = [fit for fit in known.fits if fit.converged] or list(known.fits)
    usual = Counter(fit.law for fit in good).most_common(1)[0][0]
    candidates = list(dict.fromkeys([usual, *(fit.law for fit in good)]))
    if known.kind == "fill":
        candidates = list(dict.fromkeys([*candidates, "upstream"]))
    found = [_solve(law, shape, points, _find_prior(good, law)) for law in candidates]
    least = min(item.size for item in found)
    enough = max(2.0 * least, CHECK_ERROR * shape.change)
    chosen = next(item for item in found if item.size <= enough)
    return _report(curve, shape, chosen, share)


def _find_prior(fits: Sequence[CurveFit], law: str) -> Prior:
    """Return what fits have in common: mean and spread of the supply and of a law's shape."""
    prior: dict[str, tuple[float, float]] = {}
    for name in ("supply", *_SHARED):
        known = _CONSTANTS[name]
        alike = [fit for fit in fits if fit.law == law or name == "supply"]
        values = np.array([fit.constants[name] for fit in alike if name in fit.constants])
        if name not in _LAWS[law] or values.size == 0:
            continue
        values = np.log(values) if known.is_log else values
        prior[name] = float(np.median(values)), float(np.hypot(values.std(), known.spread))
    return prior
