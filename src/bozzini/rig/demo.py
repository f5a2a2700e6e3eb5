"""What the rig does, shown: steps, a stick that goes in circles, and faults."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import Json, Result, take_axes
from .cosimulation import Cosimulation
from .host import EMPTY, Host, HostRun, describe_faults
from .link import LockstepLink
from .plant import Fault
from .protocol import SetPoint, State, Telemetry
from .steering import Steering
from .stick import BoardStick, ScriptedStick

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..effector import Effector


STEPS = ((0.6, 0.3, 0.1), (0.1, 0.6, 0.8))
"""Set-points of the three muscles [MPa], one second each."""
STEP_TIME = 1.0
"""Time between two steps [s]."""
VOLTS_PER_COUNT = 5.0 / 1024.0
"""Of the board's converter [V]."""


def _place_legend(axes: Axes) -> Axes:
    """Put the legend above the axes, where it hides nothing."""
    count = len(axes.get_legend_handles_labels()[1])
    options = {"frameon": False, "fontsize": 8, "ncols": min(count, 4)}
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), **options)
    return axes


@dataclass(frozen=True, kw_only=True, eq=False)
class StepResponses(Result):
    """Steps of the set-points.

    Attributes
    ----------
    run : HostRun
        The run.
    time, pressures : (n,), (n, 3) ndarray
        Time of the run [s] and pressures in the muscles [MPa].
    settle_time, overshoot, steady_error : (k, 3) ndarray
        Of each step and muscle: time after which the pressure stays within 2 % and 4 kPa of its
        set-point [s], largest excess beyond it [MPa], mean error over the last 0.2 s [MPa].
    """

    run: HostRun = field(repr=False)
    time: Floats = field(repr=False)
    pressures: Floats = field(repr=False)
    settle_time: Floats
    overshoot: Floats
    steady_error: Floats

    @property
    def converged(self) -> bool:
        """Whether the run went to its end."""
        return self.run.converged

    @property
    def reason(self) -> str:
        """Why it did not."""
        return str(self.run.reason)

    @property
    def residual(self) -> float:
        """Largest steady error [MPa]."""
        return float(self.steady_error.max(initial=0.0))

    def list_columns(self) -> Json:
        """Return the columns of `to_frame`, a row for each step and muscle."""
        steps, muscles = np.indices(self.settle_time.shape)
        return {
            "step": 1 + steps.ravel(),
            "muscle": 1 + muscles.ravel(),
            "settle_time_ms": 1e3 * self.settle_time.ravel(),
            "overshoot_kPa": 1e3 * self.overshoot.ravel(),
            "steady_error_kPa": 1e3 * self.steady_error.ravel(),
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw pressures in the muscles and set-points over time, and return the axes."""
        axes = take_axes(ax, x="time [s]", y="pressure [kPa]")
        wanted = {name: np.array(x) for name, x in self.run.list_columns().items()}
        for k in range(3):
            (line,) = axes.plot(self.time, 1e3 * self.pressures[:, k], label=f"muscle {k + 1}")
            column = 1e3 * wanted[f"setpoint_{k + 1}_MPa"]
            axes.step(wanted["time_s"], column, "--", where="post", color=line.get_color(), lw=0.8)
        axes.plot([], "--", color="0.4", lw=0.8, label="set-points")
        axes.set(xlim=(0.0, self.time[-1]), ylim=(0.0, None))
        return _place_legend(axes)


def run_steps(
    rig: Cosimulation,
    steps: Sequence[Sequence[float]] = STEPS,
    *,
    period: float = 0.01,
    progress: Progress = no_progress,
) -> StepResponses:
    """Let a rig follow steps of its set-points, one second each.

    Parameters
    ----------
    rig : Cosimulation
        The board and the plant.
    steps : sequence of 3 floats each
        Set-points [MPa].
    period : float
        Of the host [s].
    progress : callable
        Is called with how far it is.

    Raises
    ------
    InputError
        If a value is not legal, or the board does not arm.
    """
    link = LockstepLink(rig)
    host = Host(link, period=period)
    host.connect()

    def control(time: float, board: Telemetry) -> tuple[SetPoint, Json]:
        return SetPoint(steps[min(int(time / STEP_TIME + 1e-9), len(steps) - 1)]), {}

    run = host.run(control, STEP_TIME * len(steps), progress=progress)
    time, pressures = link.list_pressures()
    time = time - run.link_start
    found = np.full((3, len(steps), 3), np.nan)
    for i, wanted in enumerate(np.array(steps)):
        begin = np.searchsorted(time, i * STEP_TIME)
        part = pressures[begin : np.searchsorted(time, (i + 1) * STEP_TIME)]
        if run.converged:
            found[:, i] = judge_step(part, wanted, rig.period)
    return StepResponses(
        run=run,
        time=time,
        pressures=pressures,
        settle_time=found[0],
        overshoot=found[1],
        steady_error=found[2],
    )


def judge_step(pressures: Floats, wanted: Floats, period: float) -> Floats:
    """Return settle time [s], overshoot and steady error [MPa] of steps, shape (3, 3).

    Parameters
    ----------
    pressures : (n, 3) ndarray
        Pressures since the step [MPa], at intervals of `period` [s].
    wanted : (3,) ndarray
        Set-points [MPa].
    """
    away = np.abs(pressures - wanted) > 0.02 * wanted + 0.004
    last = len(away) - np.argmax(away[::-1], axis=0)
    settle = np.where(away.any(axis=0), last, 0) * period
    up = np.where(wanted >= pressures[0], 1.0, -1.0)
    over = np.maximum((up * (pressures - wanted)).max(axis=0), 0.0)
    steady = np.abs(pressures[-round(0.2 / period) :].mean(axis=0) - wanted)
    return np.array([settle, over, steady])


@dataclass(frozen=True, kw_only=True, eq=False)
class CircleRun(HostRun):
    """A run in which a stick went in circles."""

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw where the tip was wanted and where it was, seen along the axis."""
        axes = take_axes(ax, x="x [mm]", y="y [mm]", equal=True)
        table = self.list_columns()
        target = table["target_x_mm"], table["target_y_mm"]
        axes.plot(*target, color="0.75", lw=4.0, label="target, within the reach of the muscles")
        axes.plot(table["tip_x_mm"], table["tip_y_mm"], label="tip, from measured pressures")
        return _place_legend(axes)


def run_circle(
    rig: Cosimulation,
    effector: Effector,
    *,
    frequency: float = 0.5,
    duration: float = 6.0,
    period: float = 0.01,
    progress: Progress = no_progress,
) -> CircleRun:
    """Let the stick wired to the board go in circles, and steer the tip by it.

    Parameters
    ----------
    rig : Cosimulation
        The board and the plant.
    effector : Effector
        The end-effector that the muscles bend.
    frequency : float
        Turns a second [Hz].
    duration, period : float
        Of the run and of the host [s].
    progress : callable
        Is called with how far it is.

    Raises
    ------
    InputError
        If a value is not legal, or the board does not arm.
    """
    script = ScriptedStick.circle(frequency, duration)
    steering = Steering(effector, BoardStick())
    host = Host(LockstepLink(rig), period=period)
    host.connect()

    def control(time: float, board: Telemetry) -> tuple[SetPoint, Json]:
        rig.plant.stick_voltages = script.read(time, script.readings[0]) * VOLTS_PER_COUNT
        return steering(time, board)

    run = host.run(control, duration, progress=progress)
    return CircleRun(**{f.name: getattr(run, f.name) for f in fields(run)})


@dataclass(frozen=True, kw_only=True, eq=False)
class FaultResponses(Result):
    """What the board did about faults, a row for each.

    Attributes
    ----------
    names : list of str
        The faults.
    reported : list of str
        What the board reported.
    vent_time : (n,) ndarray
        From the fault to the command to vent [s]; NaN if it never came.
    empty_time : (n,) ndarray
        From the fault until all muscles are below 20 kPa [s]; NaN if not within `WATCHED`.
    peak, left : (n,) ndarray
        Largest pressure after the fault, and that at the end [MPa].
    time, pressures : (n, m), (n, m, 3) ndarray
        Time since the fault [s] and pressures in the muscles [MPa].
    """

    names: list[str]
    reported: list[str]
    vent_time: Floats
    empty_time: Floats
    peak: Floats
    left: Floats
    time: Floats = field(repr=False)
    pressures: Floats = field(repr=False)
    residual: float = 0.0

    @property
    def converged(self) -> bool:
        """Whether the board vented after each fault."""
        return bool(np.isfinite(self.vent_time).all())

    @property
    def reason(self) -> str:
        """After which faults it did not."""
        pairs = zip(self.names, self.vent_time, strict=True)
        missed = [name for name, time in pairs if not np.isfinite(time)]
        return f"not vented after: {', '.join(missed)}" if missed else ""

    def list_columns(self) -> Json:
        """Return the columns of `to_frame`."""
        return {
            "fault": self.names,
            "reported": self.reported,
            "vent_ms": 1e3 * self.vent_time,
            "empty_ms": 1e3 * self.empty_time,
            "peak_kPa": 1e3 * self.peak,
            "left_kPa": 1e3 * self.left,
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the highest pressure in a muscle after each fault, and return the axes.

        The dotted line is the pressure below which a muscle counts as empty.
        """
        axes = take_axes(ax, x="time since the fault [ms]", y="highest pressure in a muscle [kPa]")
        axes.axhline(1e3 * EMPTY, color="0.4", lw=0.8, ls=":", label=f"{1e3 * EMPTY:g} kPa")
        for k, name in enumerate(self.names):
            time, highest = 1e3 * self.time[k], 1e3 * self.pressures[k].max(axis=1)
            (line,) = axes.plot(time, highest, ls="-" if k % 2 else "--", label=name)
            vent = 1e3 * self.vent_time[k]
            axes.plot(vent, np.interp(vent, time, highest), "o", color=line.get_color(), ms=5)
        axes.plot([], "o", color="0.4", ms=5, label="command to vent")
        last = np.nanmax(self.empty_time, initial=0.1)
        axes.set(xlim=(0.0, min(1.3e3 * last, 1e3 * WATCHED)), ylim=(0.0, None))
        return _place_legend(axes)


SILENCE = "host silent"
FAULTS: dict[str, tuple[Fault, ...]] = {
    SILENCE: (),
    "sensor open": (Fault("sensor open", 0),),
    "sensor short": (Fault("sensor short", 0),),
    "fill valve stuck": (Fault("valve stuck", 0, 0.84),),
    "burst": (Fault("leak", 0, 1.0),),
}
"""The faults of the demonstration, by name."""

WATCHED = 2.0
"""How long a rig is watched after a fault [s]."""

HELD = (0.5, 0.5, 0.5)
"""Set-points at which a fault strikes [MPa]."""


def run_faults(
    make_rig: Callable[[], Cosimulation], *, progress: Progress = no_progress
) -> FaultResponses:
    """Let each of `FAULTS` strike a rig of its own that holds 500 kPa.

    Parameters
    ----------
    make_rig : callable
        Makes a rig.
    progress : callable
        Is called with how far it is.

    Raises
    ------
    InputError
        If a board does not arm.
    """
    rows = []
    for k, (name, faults) in enumerate(FAULTS.items()):
        progress("faults", k / len(FAULTS))
        rows.append(_strike(make_rig(), name, faults))
    reported, vent, empty, peak, left, times, pressures = zip(*rows, strict=True)
    count = min(map(len, times))
    return FaultResponses(
        names=list(FAULTS),
        reported=list(reported),
        vent_time=np.array(vent),
        empty_time=np.array(empty),
        peak=np.array(peak),
        left=np.array(left),
        time=np.array([time[:count] for time in times]),
        pressures=np.array([values[:count] for values in pressures]),
    )


def _strike(
    rig: Cosimulation, name: str, faults: tuple[Fault, ...]
) -> tuple[str, float, float, float, float, Floats, Floats]:
    """Return what a rig reports and does after a fault."""
    link = LockstepLink(rig)
    host = Host(link)
    host.connect()
    host.run_armed(lambda time, board: (SetPoint(HELD), {}), 1.0)
    begin = link.now
    rig.plant.set_faults(*faults)
    before = len(link.records)
    while link.now < begin + WATCHED:
        link.wait(link.now + host.period)
        host.receive()
        if name != SILENCE and host.state is State.ARMED:
            host.send(SetPoint(HELD))
    records = link.records[before:]
    time = np.concatenate([record.time for record in records]) - begin
    pressures = np.vstack([record.pressures for record in records])
    duty = np.vstack([record.duty for record in records])
    vented = np.flatnonzero((duty[:, 3:6] > 0.99).all(axis=1) & (duty[:, :3] < 0.01).all(axis=1))
    full = np.flatnonzero((pressures > EMPTY).any(axis=1))
    never = full.size and full[-1] == len(time) - 1
    return (
        describe_faults(host.faults),
        float(time[vented[0]]) if vented.size else np.nan,
        np.nan if never else float(time[full[-1]]) if full.size else 0.0,
        float(pressures.max()),
        float(pressures[-1].max()),
        time,
        pressures,
    )
