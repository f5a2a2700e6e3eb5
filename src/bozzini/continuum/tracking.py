"""Tracking in simulation: controllers of a tendon robot that is softer than they believe."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..checks import check_kind, check_number, quantity
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import Shown, tabulated
from ..task import Task
from ..tracking import TrackedPaths, find_rms, measure_distances, trace_places
from .control import (
    EstimatingController,
    LinearQuadratic,
    ProportionalIntegral,
    ResolvedRates,
    StaticTensions,
    TendonController,
    TensionPrediction,
)
from .dynamics import DynamicsOptions, ShapeHistory, simulate
from .kinematics import ContinuumRobot
from .robot import RobotDesign
from .unknowns import RobotSetup, Unknown, change_setup

TENDON_CONTROLLERS: dict[str, type[TendonController]] = {
    "static inverse": StaticTensions,
    "resolved rates": ResolvedRates,
    "proportional-integral": ProportionalIntegral,
    "linear quadratic": LinearQuadratic,
    "predictive": TensionPrediction,
}
"""Controllers by name."""
_NOTE = "tendons have no mass, and drives hold their tensions at once"
_FRICTION = "tendons have friction, which controllers know nothing of"
_UNDAMPED = (
    "controllers believe in no damping: resolved rates and proportional-integral control then have "
    "gains of 0 unless given, as any other makes the slowest mode grow"
)
_AT_LIMIT = 1e-9
"""Share of a limit by which a tension at it may miss it."""


class TendonRun(NamedTuple):
    """What a controller did.

    Attributes
    ----------
    commands : ndarray, shape (n, t)
        Given from the first time on, until it folds over [N].
    tip : ndarray, shape (n + 1, 2)
        True lateral places, the first before any command [mm]; NaN once the robot has folded over.
    controller_time, plant_time : float
        Time that the steps of each took [s].
    """

    commands: Floats
    tip: Floats
    controller_time: float
    plant_time: float


def soften(robot: ContinuumRobot, share: float) -> ContinuumRobot:
    """Return a robot whose backbone is softer, in bending and twist, by a share."""
    check_number("share", share, low=-10.0, high=0.99)
    every = Unknown("", "sections", "modulus", tuple(range(len(robot.sections))))
    changes = np.array([math.log1p(-share)])
    return change_setup(RobotSetup(robot), [every], changes).robot


def run_tendons(
    controller: TendonController,
    wanted: Floats,
    *,
    plant: RobotDesign,
    noise: float = 0.0,
    seed: int = 0,
) -> TendonRun:
    """Let a controller lead the tip of a plant along places (n + 1, 2), from rest.

    Parameters
    ----------
    controller : TendonController
    wanted : ndarray, shape (n + 1, 2)
        At times a period apart [mm].
    plant : RobotDesign
        What is moved, such as the controller's own robot.
    noise : float
        Standard deviation of the places that the controller sees [mm].
    seed : int
        Of the noise.
    """
    check_kind("controller", controller, TendonController)
    check_number("noise", noise, low=0.0, unit="mm")
    drawn = noise * np.random.default_rng(seed).standard_normal((len(wanted), 2))
    state = controller.begin(wanted[0])
    waiting = list(state.given)
    moved = _move(controller, plant, waiting[-1], None)
    tips, commands, spent = [moved.tip[0, :2]], [], [0.0, 0.0]
    for k in range(len(wanted) - 1):
        begin = time.perf_counter()
        command, state = controller.step(state, wanted[k:], seen=tips[-1] + drawn[k])
        between = time.perf_counter()
        waiting = [*waiting[1:], command]
        moved = _move(controller, plant, waiting[0], moved)
        spent[0] += between - begin
        spent[1] += time.perf_counter() - between
        commands.append(command)
        tips.append(moved.tip[-1, :2])
        if not moved.converged:
            tips[-1:] = np.full((len(wanted) - 1 - k, 2), math.nan)
            break
    return TendonRun(np.array(commands), np.array(tips), *spent)


def _move(
    controller: TendonController,
    plant: RobotDesign,
    tensions: Floats,
    initial: ShapeHistory | None,
) -> ShapeHistory:
    times = [0.0, controller.period]
    return simulate(plant, times, tensions=tensions, initial=initial, options=controller.options)


@dataclass(frozen=True)
class TendonTrackedBy(Shown):
    """How a controller did.

    Parameters
    ----------
    controller : str
    rms, largest : float
        Distance of the true tip from where it is wanted at that time, in the last turn [mm].
    at_limits : float
        Share of that time at which a tendon is at its largest tension or largest rate.
    controller_factor, plant_factor : float
        Time that passes by the time that computing takes: 1 is real time.
    """

    controller: str = tabulated()
    rms: float = tabulated("mm")
    largest: float = tabulated("mm")
    at_limits: float = tabulated()
    controller_factor: float = tabulated()
    plant_factor: float = tabulated()


@dataclass(frozen=True, kw_only=True, eq=False)
class TendonTracking(TrackedPaths):
    """Controllers of a tendon robot side by side, in simulation."""

    rows: tuple[TendonTrackedBy, ...]

    def format_table(self) -> str:
        """Return how the controllers did as text."""
        head = ["controller", "rms [mm]", "largest [mm]", "at limits [%]",
                "real time: controller", "robot"]  # fmt: skip
        rows = [
            [row.controller, f"{row.rms:.3f}", f"{row.largest:.3f}", f"{100.0 * row.at_limits:.0f}",
             f"{row.controller_factor:.1f}", f"{row.plant_factor:.1f}"]
            for row in self.rows
        ]  # fmt: skip
        return self.format_rows(head, rows)


@dataclass(frozen=True, kw_only=True)
class ContinuumTracking(Task):
    """Lead the tip of a tendon robot round a circle in simulation: four controllers.

    The robot is softer than the controllers believe; they are told the rest, but for the friction
    of its tendons. The tip goes round twice, from rest, across the axis of the base; the first turn
    is not counted. Commands are tensions, which hold for a period and act some periods later; they
    keep to limits of tension and rate, which of a calibrated robot are those commanded. What
    controllers see of the tip has noise.

    The baseline is the static inverse of the wrong robot, which sees nothing. Resolved rates use
    the Jacobian at rest; proportional-integral and linear quadratic control move the place that
    the inverse is asked for; the predictive one plans tensions within the limits.

    A robot that a controller makes fold over has no numbers.

    Exit code 0: done; 2: bad input.
    """

    name = "track"
    group = "continuum"
    result = TendonTracking

    robot: str = quantity("file", "A robot file, with weights.")
    radius: float = quantity("length", "Of the circle.", low=0.0, low_open=True, high=1e5)
    frequency: float = quantity("frequency", "Turns per second.", default=1.0, low=1e-3, high=100.0)
    softer: float = quantity(
        help="By which share the robot is softer than believed.",
        default=0.2,
        low=-10.0,
        high=0.9,
        by_name=True,
    )
    period: float = quantity("time", "Between commands.", default=0.01, low=1e-4, high=1.0)
    delay: int = quantity(
        help="Periods after which a command acts.",
        default=1,
        low=0,
        high=100,
        whole=True,
        by_name=True,
    )
    noise: float = quantity(
        "length", "Standard deviation of places seen.", default=0.1, low=0.0, high=1e3, by_name=True
    )
    highest: float = quantity(
        "force", "Largest tension.", default=20.0, low=1e-6, high=1e6, by_name=True
    )
    rate: float = quantity(
        help="Largest change of a tension [N/s].", default=200.0, low=1e-3, high=1e9
    )
    seed: int = quantity(help="Of the noise.", default=1, low=0, high=2**31, whole=True)
    options: DynamicsOptions = DynamicsOptions()

    def run(self, progress: Progress = no_progress) -> TendonTracking:
        """Return how all controllers do."""
        robot = ContinuumRobot.from_yaml(self.robot)
        plant = soften(robot, self.softer)
        scale = float(robot.to_tensions([1.0])[0])  # controllers plan what reaches the tendons
        wanted = trace_places(
            "circle", radius=self.radius, frequency=self.frequency, period=self.period
        )
        controllers = {}
        for name, kind in TENDON_CONTROLLERS.items():
            controllers[name] = kind(
                robot=robot,
                options=self.options,
                period=self.period,
                delay=self.delay,
                highest=scale * self.highest,
                rate=scale * self.rate,
                **({"noise": self.noise} if issubclass(kind, EstimatingController) else {}),
            )
        return compare_tendons(
            controllers, wanted, plant=plant, noise=self.noise, seed=self.seed, progress=progress
        )

    def describe(self, found: TendonTracking) -> str:
        """Return the table."""
        return found.format_table()


def compare_tendons(
    controllers: Mapping[str, TendonController],
    wanted: Floats,
    *,
    plant: RobotDesign,
    noise: float = 0.0,
    seed: int = 0,
    progress: Progress = no_progress,
) -> TendonTracking:
    """Return how controllers of one period do side by side, on a plant that may be another robot.

    Parameters
    ----------
    controllers : mapping
        By name.
    wanted, plant, noise, seed
        As of `run_tendons`; the first half of the places is not counted.
    progress : callable
        Told the share that is done.
    """
    rows, tips, period = [], [], 0.0
    notes = [_NOTE, *([_FRICTION] if plant.tendon_friction.any() else [])]
    for done, (name, controller) in enumerate(controllers.items()):
        progress(name, done / len(controllers))
        run = run_tendons(controller, wanted, plant=plant, noise=noise, seed=seed)
        if controller.linear.damping_ratio[0] == 0.0 and _UNDAMPED not in notes:
            notes.append(_UNDAMPED)
        rows.append(_measure(name, controller, run, wanted))
        tips.append(run.tip)
        period = controller.period
    progress("tracked", 1.0)
    return TendonTracking(
        rows=tuple(rows),
        times=np.multiply(period, np.arange(len(wanted)), dtype=np.float64),
        wanted=wanted,
        tips=np.array(tips),
        notes=tuple(notes),
    )


def _measure(
    name: str, controller: TendonController, run: TendonRun, wanted: Floats
) -> TendonTrackedBy:
    """Return how a controller did along places (n + 1, 2)."""
    distances = measure_distances(run.tip - wanted)
    changes = np.diff(run.commands, axis=0)
    full = np.abs(run.commands[1:]) >= (1.0 - _AT_LIMIT) * controller.highest
    full |= np.abs(changes) >= (1.0 - _AT_LIMIT) * controller.rate * controller.period
    passed, half = controller.period * len(run.commands), len(wanted) // 2
    return TendonTrackedBy(
        controller=name,
        rms=find_rms(distances),
        largest=float(distances.max()),
        at_limits=float(np.mean(full[half - 1 :].any(axis=1))) if len(full) >= half else math.nan,
        controller_factor=passed / run.controller_time,
        plant_factor=passed / run.plant_time,
    )
