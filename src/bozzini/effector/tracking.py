"""Tracking in simulation: controllers of a fitted end-effector side by side."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..checks import check_kind, quantity
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import tabulated
from ..task import Task
from ..tracking import TrackedPaths, find_rms, measure_distances, trace_places
from .control import (
    PERIOD,
    Controller,
    InverseInTime,
    LagFeedforward,
    PredictiveControl,
    StaticInverse,
)
from .effector import Effector
from .unknowns import EffectorSetup, change_setup, parse_unknowns

if TYPE_CHECKING:
    from .files import EffectorFile

CONTROLLERS: dict[str, tuple[type[Controller], bool]] = {
    "static inverse": (StaticInverse, False),
    "feed-forward of the lag": (LagFeedforward, False),
    "inverse in time": (InverseInTime, False),
    "predictive": (PredictiveControl, False),
    "predictive, tip seen": (PredictiveControl, True),
}
"""Controllers by name, and whether they see the tip."""
PREVIEW = 0.5
"""How far ahead controllers are told where the tip is wanted [s]."""
SIGMAS = 1.959964
"""Half width of a 95 % interval in standard errors."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlRun:
    """What a controller did.

    Attributes
    ----------
    start : ndarray, shape (m,)
        Pressures commanded long before [MPa].
    commands : ndarray, shape (n, m)
        From the first time on [MPa].
    tip : ndarray, shape (n + 1, 2)
        Lateral places, the first before any command [mm].
    step_times : ndarray, shape (n,)
        Processor time that a step took [s].
    """

    start: Floats
    commands: Floats
    tip: Floats
    step_times: Floats


def run_control(
    controller: Controller, wanted: Floats, *, plant: Effector, seen: bool = False,
    gain: float = 1.0,
) -> ControlRun:  # fmt: skip
    """Let a controller lead the tip of a plant along places (n + 1, 2), from rest at the first.

    Parameters
    ----------
    controller : Controller
    wanted : ndarray, shape (n + 1, 2)
        At times a period apart [mm].
    plant : Effector
        What is moved, such as the controller's own model.
    seen : bool
        Whether the controller is told where the tip is.
    gain : float
        Pressure that the plant is given, over the command.
    """
    start = controller.rest_at(wanted[0])
    state = controller.begin(start)
    ahead = math.ceil(PREVIEW / controller.period)
    over = np.array([0.0, controller.period])
    highest = plant.design.pressure_limit
    moved = plant.simulate([0.0], np.minimum(gain * start, highest)[None])
    tips, commands, spent = [moved.tip[0, :2]], [], []
    for k in range(1, len(wanted)):
        begin = time.thread_time()
        command, state = controller.step(
            state, wanted[k : k + ahead], seen=tips[-1] if seen else None
        )
        spent.append(time.thread_time() - begin)
        given = np.minimum(gain * command, highest)
        moved = plant.simulate(over, np.stack([given, given])[None], initial=moved.state)
        tips.append(moved.tip[0, 1, :2])
        commands.append(command)
    return ControlRun(
        start=start, commands=np.array(commands), tip=np.array(tips), step_times=np.array(spent)
    )


def draw_plant(file: EffectorFile, random: np.random.Generator) -> tuple[Effector, float]:
    """Return an end-effector whose fitted constants are off, and its factor on commands.

    Each is off by its own standard error times a normal number, within its legal range: as the
    constants' errors depend on each other, that is more than the fit is uncertain by.
    """
    setup = EffectorSetup(file.build(), file.view, file.scale)
    names = list(dict.fromkeys(name.partition("[")[0] for name in file.intervals))
    unknowns = parse_unknowns(setup, names)
    changes = {}
    for one in unknowns:
        ends = [
            numbers
            for name, numbers in file.intervals.items()
            if name.partition("[")[0] == one.name
        ]
        errors = [(x[-1] - x[-2]) / (2.0 * SIGMAS) if len(x) == 3 else 0.0 for x in ends]
        change = np.array(errors) * random.standard_normal(len(errors))
        known = one.parameter
        changes[one.name] = np.clip(change, known.low, known.high)
    setup = change_setup(setup, unknowns, changes)
    return setup.effector, setup.scale / file.scale


@dataclass(frozen=True)
class TrackedBy:
    """How a controller did.

    Parameters
    ----------
    controller : str
    rms, largest : float
        Distance of the tip from where it is wanted at that time, after the first turn, on the arm
        as it was fitted [mm].
    rms_off : float
        The same on arms whose constants are off, over all of them [mm].
    step_median, step_p99 : float
        Processor time that a step takes, and that one in a hundred exceeds [s].
    """

    controller: str = tabulated()
    rms: float = tabulated("mm")
    largest: float = tabulated("mm")
    rms_off: float = tabulated("mm")
    step_median: float = tabulated("s")
    step_p99: float = tabulated("s")


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracking(TrackedPaths):
    """Controllers of an end-effector side by side, in simulation; the tips on the arm as fitted."""

    rows: tuple[TrackedBy, ...]

    def format_table(self) -> str:
        """Return how the controllers did as text."""
        head = ["controller", "rms [mm]", "largest [mm]", "constants off: rms [mm]",
                "step: median [ms]", "p99 [ms]"]  # fmt: skip
        rows = []
        for row in self.rows:
            off = "" if math.isnan(row.rms_off) else f"{row.rms_off:.3f}"
            steps = (f"{1e3 * x:.2f}" for x in (row.step_median, row.step_p99))
            rows.append([row.controller, f"{row.rms:.3f}", f"{row.largest:.3f}", off, *steps])
        return self.format_rows(head, rows)


@dataclass(frozen=True, kw_only=True)
class EffectorTracking(Task):
    """Track a circle or a line in simulation: four controllers of a fitted end-effector.

    The tip goes round twice, from rest; the first turn is not counted. Commands come at 50 Hz and
    keep to the limits of pressure, of the design, and rate. The static inverse knows the section
    at rest; the feed-forward leads the lag, too; the inverse in time undoes plays and creep as
    well; the predictive one looks half a second ahead, and is shown with the tip seen, too.

    The plant is the arm as it was fitted, and arms whose constants are off by normal errors of the
    size of their standard errors.

    Exit code 0: done; 2: bad input.
    """

    name = "track"
    group = "effector"
    result = Tracking

    fit: str = quantity("file", "A file of 'bozzini effector fit --pulls --out'.")
    trace: str = quantity("text", "What is tracked.", default="circle", words=("circle", "line"))
    radius: float = quantity(
        "length", "Of the circle; half the line.", low=0.0, low_open=True, high=1e5
    )
    frequency: float = quantity("frequency", "Turns per second.", default=0.5, low=1e-3, high=5.0)
    rate: float = quantity(
        help="Largest change of a command [MPa/s].", default=3.0, low=1e-3, high=1e9
    )
    plants: int = quantity(
        help="Arms whose constants are off.", default=3, low=0, high=1000, whole=True
    )
    seed: int = quantity(help="Of their constants.", default=1, low=0, high=2**31, whole=True)

    def run(self, progress: Progress = no_progress) -> Tracking:
        """Return how all controllers do."""
        from .files import read_effector

        file = read_effector(self.fit)
        random = np.random.default_rng(self.seed)
        off = [draw_plant(file, random) for _ in range(self.plants)]
        wanted = trace_places(
            self.trace, radius=self.radius, frequency=self.frequency, period=PERIOD
        )
        found = compare_controllers(
            file.build(), wanted, rate=self.rate, off=off, progress=progress
        )
        if not file.rest:
            return found
        seen = ", ".join(file.rest_channels)
        words = f"the rest that the fit has learned of {seen} is left out: it has no place in a tip"
        return replace(found, notes=(words,))

    def describe(self, found: Tracking) -> str:
        """Return the table."""
        return found.format_table()


def compare_controllers(
    effector: Effector,
    wanted: Floats,
    *,
    rate: float = 3.0,
    off: Sequence[tuple[Effector, float]] = (),
    progress: Progress = no_progress,
) -> Tracking:
    """Return how all controllers of an end-effector do in simulation.

    Parameters
    ----------
    effector : Effector
        The model, and the plant.
    wanted : ndarray, shape (n, 2)
        Lateral places of the tip at times 20 ms apart [mm]; the first half is not counted.
    rate : float
        Largest change of a command [MPa/s].
    off : sequence of tuple
        Other plants, and pressure over command of each.
    progress : callable
        Told the share that is done.

    Raises
    ------
    InputError
        If the end-effector has no pulls, or the tip cannot bend as far.
    """
    check_kind("effector", effector, Effector)
    rows, tips = [], []
    for done, (name, (kind, seen)) in enumerate(CONTROLLERS.items()):
        progress(name, done / len(CONTROLLERS))
        controller = kind(effector=effector, rate=rate)
        run = run_control(controller, wanted, plant=effector, seen=seen)
        misses = [
            run_control(controller, wanted, plant=plant, seen=True, gain=gain).tip - wanted
            if seen
            else _repeat(run, plant, gain) - wanted
            for plant, gain in off
        ]
        own = measure_distances(run.tip - wanted)
        rows.append(
            TrackedBy(
                controller=name,
                rms=find_rms(own),
                largest=float(own.max()),
                rms_off=find_rms(np.concatenate([measure_distances(one) for one in misses]))
                if misses
                else math.nan,
                step_median=float(np.median(run.step_times[1:])),
                step_p99=float(np.percentile(run.step_times[1:], 99.0)),
            )
        )
        tips.append(run.tip)
    progress("tracked", 1.0)
    times = np.multiply(PERIOD, np.arange(len(wanted)), dtype=np.float64)
    return Tracking(rows=tuple(rows), times=times, wanted=wanted, tips=np.array(tips))


def _repeat(run: ControlRun, plant: Effector, gain: float) -> Floats:
    """Return lateral places (n, 2) of the tip of another plant under the commands of a run."""
    given = np.concatenate([run.commands, run.commands[-1:]])
    given = np.minimum(gain * given, plant.design.pressure_limit)
    times = np.multiply(PERIOD, np.arange(len(given)), dtype=np.float64)
    before = plant.motion.begin(np.minimum(gain * run.start, plant.design.pressure_limit)[None])
    return plant.simulate(times, given[None], initial=before).tip[0, :, :2]
