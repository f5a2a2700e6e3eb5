"""Where to put sensors on a robot so that its tip or its whole shape is known best."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_integer, check_word, quantity
from ..errors import InputError
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import ReasonedResult, Shown, format_rows, rows_of, tabulated, take_axes
from ..task import Task
from .energy import EnergyModel
from .estimation import ShapeEstimator
from .kinematics import ContinuumRobot
from .measured import read_timed_commands
from .model_error import ModelError
from .sensor_table import SensorNoise
from .sensors import BodySensor, CurvatureSensor, PlaceSensor, PoseSensor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SensorKind = Literal["place", "pose", "curvature"]
SensorAim = Literal["tip", "shape"]
"""Of what the worst standard deviation is to be least."""
MOST_SETS = 20_000
"""Sets of places that are all tried; beyond, places are added one by one only."""


@dataclass(frozen=True)
class SensorChoice(Shown):
    """So many sensors, where they are best.

    Parameters
    ----------
    sensors : int
    greedy_place : float
        Where the last one is added to those before [mm]; 0 of none.
    greedy : float
        Worst standard deviation with these [mm].
    exact : float
        The same with the best set of places [mm]; NaN if there are too many sets to try.
    places : tuple of float
        The best places known [mm].
    """

    sensors: int = tabulated()
    greedy_place: float = tabulated("mm")
    greedy: float = tabulated("mm", "deviation_greedy")
    exact: float = tabulated("mm", "deviation_exact")
    places: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorPlan(ReasonedResult):
    """What each further sensor buys, at its best place.

    Parameters
    ----------
    choices : tuple of SensorChoice
        From none on.
    candidates : (c,) ndarray
        Places that were tried [mm].
    note : str
        Why sets were not all tried; empty otherwise.
    """

    choices: tuple[SensorChoice, ...] = rows_of(SensorChoice)
    candidates: Floats
    note: str = ""

    reason = ""
    residual = 0.0

    @property
    def best(self) -> SensorChoice:
        """The last choice."""
        return self.choices[-1]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the worst standard deviation over the number of sensors, and return the axes."""
        axes = take_axes(ax, x="sensors", y="worst standard deviation [mm]")
        counts = [one.sensors for one in self.choices]
        axes.plot(counts, [one.greedy for one in self.choices], "o-", label="one by one")
        axes.plot(counts, [one.exact for one in self.choices], "x", label="best set")
        axes.set_ylim(0.0, None)
        axes.legend()
        return axes


def place_sensor(kind: SensorKind, place: float, noise: SensorNoise) -> BodySensor:
    """Return a sensor of a kind at a place."""
    name = f"{kind} at {place:g} mm"
    if kind == "curvature":
        return CurvatureSensor(
            name=name, arc_length=place, deviation=noise.bend, share=noise.bend_share
        )
    if kind == "pose":
        return PoseSensor(
            name=name, arc_length=place, deviation=noise.place, rotation_deviation=noise.angle
        )
    return PlaceSensor(name=name, arc_length=place, deviation=noise.place)


def plan_sensors(
    estimator: ShapeEstimator,
    candidates: Sequence[BodySensor],
    *,
    commands: ArrayLike,
    count: int = 3,
    aim: SensorAim = "tip",
) -> SensorPlan:
    """Return where so many of the candidates are best, beside the sensors of an estimator.

    Least is the worst standard deviation of a place in any direction, of all commands: of the tip,
    or of any station. Shapes and readings are linearised where the model makes no error. Places are
    added one by one; and all sets are tried while there are at most 20,000.

    Parameters
    ----------
    estimator : ShapeEstimator
        Model, its errors, and sensors that are there already.
    candidates : sequence of BodySensor
    commands : array_like, shape (n, t)
        What the robot is to be seen under.
    count : int
        Largest number of further sensors.
    aim : {"tip", "shape"}

    Raises
    ------
    InputError
        If an input is not legal.
    GeometryError
        If the model has no shape under a command.
    """
    check_word("aim", aim, get_args(SensorAim))
    check_integer("count", count, low=1, high=len(candidates))
    rows = np.atleast_2d(np.asarray(commands, dtype=np.float64))
    there = len(estimator.sensors)
    whole = ShapeEstimator(
        model=estimator.model,
        sensors=(*estimator.sensors, *candidates),
        error=estimator.error,
        loads=estimator.loads,
        command=estimator.command,
    )
    spread = np.sqrt(np.diag(whole.begin().covariance))
    informed, seen = [], []
    for row in rows:
        slopes, moved = whole.find_slopes(row)
        own = np.array([(way * spread).T @ (way * spread) for way in slopes])
        informed.append((np.eye(len(spread)) + own[:there].sum(axis=0), own[there:]))
        stations = moved[-1:, 3:] if aim == "tip" else moved[1:, 3:]
        seen.append(stations * spread)

    def measure(chosen: Sequence[int]) -> float:
        worst = 0.0
        for (before, own), ways in zip(informed, seen, strict=True):
            inverse = np.linalg.inv(before + own[list(chosen)].sum(axis=0))
            worst = max(
                worst, float(np.linalg.eigvalsh(ways @ inverse @ ways.swapaxes(1, 2)).max())
            )
        return math.sqrt(worst)

    tip = estimator.robot.length
    places = np.array([tip if one.arc_length is None else one.arc_length for one in candidates])
    none = measure(())
    choices = [SensorChoice(0, 0.0, none, none)]
    chosen: list[int] = []
    note = ""
    for size in range(1, count + 1):
        left = [k for k in range(len(candidates)) if k not in chosen]
        values = [measure([*chosen, k]) for k in left]
        chosen.append(left[int(np.argmin(values))])
        greedy, exact, best = min(values), math.nan, tuple(chosen)
        if math.comb(len(candidates), size) <= MOST_SETS:
            sets = list(itertools.combinations(range(len(candidates)), size))
            every = [measure(one) for one in sets]
            exact, best = min(every), sets[int(np.argmin(every))]
        else:
            note = f"more than {MOST_SETS} sets of {size} places: added one by one only"
        choices.append(
            SensorChoice(
                size, float(places[chosen[-1]]), greedy, exact, tuple(places[list(best)].tolist())
            )
        )
    return SensorPlan(choices=tuple(choices), candidates=places, note=note)


@dataclass(frozen=True, kw_only=True)
class SensorPlanning(Task):
    """Where to put sensors along a robot so that its tip, or whole shape, is known best.

    The table says what each further sensor buys: the worst standard deviation of a place, in any
    direction, with sensors added one by one at their best places, and with the best set of places.
    Without a table of commands the robot is at rest.

    Exit code 0: done; 2: bad input.
    """

    name = "sensors"
    group = "continuum"
    result = SensorPlan

    robot: str = quantity("file", "A robot file.")
    commands: str | None = quantity(
        "file", "A table: time [s], T1 displacement [mm] or tensions.", default=None
    )
    kind: str = quantity(
        "text", "What is sensed.", words=get_args(SensorKind), default="place", option="kind"
    )
    aim: str = quantity(
        "text",
        "What is to be known best.",
        words=get_args(SensorAim),
        default="tip",
        option="aim",
        by_name=True,
    )
    count: int = quantity(help="Most sensors.", default=3, low=1, high=50, whole=True)
    candidates: int = quantity(
        help="Places that are tried, evenly along the robot.", default=12, low=1, high=200,
        whole=True,
        by_name=True,
    )  # fmt: skip
    noise: SensorNoise = SensorNoise()
    error: ModelError = ModelError()

    def run(self, progress: Progress = no_progress) -> SensorPlan:
        """Return what each further sensor buys."""
        if self.count > self.candidates:
            raise InputError(f"count is {self.count}: it must be at most {self.candidates} places")
        robot = ContinuumRobot.from_yaml(self.robot)
        rows, command = np.zeros((1, len(robot.tendons))), "displacement"
        if self.commands is not None:
            timed = read_timed_commands(self.commands, robot)
            command = timed.command
            if command == "tension":
                rows = robot.to_tensions(timed.commands)
            else:
                rows = robot.to_displacements(timed.commands, in_time=True)
        estimator = ShapeEstimator(
            model=EnergyModel(robot, segment="channel"),
            error=self.error,
            command=command,  # type: ignore[arg-type]
        )
        places = robot.length * np.arange(1, self.candidates + 1) / self.candidates
        sensors = [place_sensor(self.kind, place, self.noise) for place in places.tolist()]  # type: ignore[arg-type]
        return plan_sensors(estimator, sensors, commands=rows, count=self.count, aim=self.aim)  # type: ignore[arg-type]

    def describe(self, found: SensorPlan) -> str:
        """Return the table."""
        head = ["sensors", "added at [mm]", "worst sd [mm]", "best set [mm]", "its places [mm]"]
        rows = [
            [
                str(one.sensors),
                f"{one.greedy_place:.1f}" if one.sensors else "-",
                f"{one.greedy:.3g}",
                "-" if math.isnan(one.exact) else f"{one.exact:.3g}",
                ", ".join(f"{place:.1f}" for place in one.places) or "-",
            ]
            for one in found.choices
        ]
        lines = [format_rows(head, rows), *([f"note: {found.note}"] if found.note else [])]
        return "\n".join(lines)
