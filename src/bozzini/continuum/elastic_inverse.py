"""Tensions that bring the tip of an elastic robot to a place, a direction or a pose.

The unknowns are the tensions of the tendons: a model has a shape under any of them, whatever the
routing, loads and stiffnesses, while displacements of many tendons contradict each other. Levenberg
and Marquardt's steps are each the best one between the least and the largest tensions (bounded
linear least squares). A weight on the tensions that falls to 0 leaves, of all that meet the target,
those of the least sum of squares. Travel of the drives counts as a residual where it is passed.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number
from ..errors import InputError
from ..numeric.arrays import Floats
from .checks import check_values
from .elastic import ElasticModel
from .inverse import ContinuumInverse, InverseOptions
from .model import ContinuumModel
from .robot import RobotDesign
from .shape import Shape

ELASTIC_STARTS = 8
"""Starts that may be tried: no tension first, then drawn ones."""

MOST_STARTS = 256

TENSION_WEIGHTS = (1e-4, 1e-7, 0.0)
"""Weights of the squared tensions against the squared miss by the length, one after the other."""

MET_COST = 1e-12
"""Squared miss, by the length, at which the goal counts as met where tensions are made smaller."""

LEAST_COST = 1e-26
"""Squared miss, by the length, that is round-off."""

GOAL_WEIGHT = 1e4
"""Weight of the goal against the tensions, where these are made smaller."""

SHRINKING_STEP, LEAST_SHRINKING = 0.2, 1e-5
"""Largest change of a tension in such a step, and that at which it ends, as of `LARGEST_STEP`."""

EDGE = 1e-15
"""What keeps bounds of a step from being one point: bounded least squares takes none."""

MOST_STEPS = 40
"""Steps with one weight."""

LEAST_FALL = 1e-3
"""Share by which a step must lower the cost, to go on with a weight that is not the last."""

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-12, 1e6

LARGEST_STEP = 1.0
"""Largest change of a tension in one step, in tensions that bend the robot by 1 rad."""

DIFFERENCE = 1e-5
"""Step of differences, in tensions that bend the robot by 1 rad."""

TRAVEL_WEIGHT = 100.0
"""Weight of the travel that is passed, against the miss of the tip."""

RANK_RATIO = 1e-6
"""Ratio of singular values below which the tip does not move."""

AT_LIMIT = 1e-6
"""Distance from a limit that counts as at it, as a share."""


class TensionTrial(NamedTuple):
    """Scaled tensions, the shape under them, its residual and cost."""

    pulls: Floats
    shape: Shape
    residual: Floats
    cost: float


@dataclass(frozen=True, eq=False)
class TipGoal:
    """A place of the tip, and its axes: none, the tangent, or the tangent, x and y, (0 | 1 | 3, 3).

    `length` and `turn` are the lengths that a miss of 1 and an angle of 1 rad count as [mm].
    """

    place: Floats
    axes: Floats
    length: float
    turn: float

    def measure(self, frame: Floats) -> Floats:
        """Return the residual of a tip's frame, by the length."""
        parts = [frame[:3, 3] - self.place]
        if len(self.axes) == 1:
            parts.append(self.turn * (frame[:3, 2] - self.axes[0]))
        elif len(self.axes):
            parts.append(self.turn * self._turn(frame))
        return np.concatenate(parts) / self.length

    def differentiate(self, frame: Floats, motion: Floats) -> Floats:
        """Return the derivative of the residual, given rotation and motion (6, t) of the tip."""
        parts = [motion[3:]]
        if len(self.axes) == 1:
            parts.append(self.turn * np.cross(motion[:3], frame[:3, 2], axisa=0).T)
        elif len(self.axes):
            parts.append(self.turn * motion[:3])  # exact where the target is met
        return np.concatenate(parts) / self.length

    def misses(self, frame: Floats) -> tuple[float, float]:
        """Return distance [mm] and angle [rad] of a tip's frame from the goal."""
        far = float(np.linalg.norm(frame[:3, 3] - self.place))
        if len(self.axes) == 1:
            across = np.linalg.norm(np.cross(frame[:3, 2], self.axes[0]))
            return far, float(np.arctan2(across, frame[:3, 2] @ self.axes[0]))
        return far, float(np.linalg.norm(self._turn(frame))) if len(self.axes) else 0.0

    def _turn(self, frame: Floats) -> Floats:
        from scipy.spatial.transform import Rotation

        wanted = self.axes[[1, 2, 0]].T
        return np.asarray(Rotation.from_matrix(frame[:3, :3] @ wanted.T).as_rotvec())

    @property
    def freedoms(self) -> int:
        """Freedoms that the goal takes."""
        return 3 + {0: 0, 1: 2, 3: 3}[len(self.axes)]


@dataclass(frozen=True, eq=False)
class ElasticSearch:
    """The search of a model's tensions for a goal."""

    model: ElasticModel
    goal: TipGoal

    @property
    def robot(self) -> RobotDesign:
        """The robot."""
        return self.model.robot

    @cached_property
    def unit(self) -> Floats:
        """Tension of each tendon that bends the robot by about 1 rad [N], shape (t,)."""
        stiffness = float(np.median(self.robot.section_stiffness[:, 0]))
        places = [
            tendon.place_at(np.linspace(0.0, end, 9))
            for tendon, end in zip(self.robot.tendons, self.robot.tendon_ends, strict=True)
        ]
        levers = np.array([np.hypot(*place.T).max() for place in places])
        return np.asarray(stiffness / (levers * self.robot.tendon_ends))

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Least and largest scaled tensions."""
        high = self.robot.tension_limits / self.unit
        return np.where(self.robot.pushes, -high, 0.0), high

    @cached_property
    def free_model(self) -> ElasticModel:
        """The model of the robot without limits of tendons and bends."""
        sections = tuple(
            dataclasses.replace(
                section,
                max_bend=math.inf,
                tendons=tuple(
                    dataclasses.replace(
                        tendon, travel=(-math.inf, math.inf), tension_limit=math.inf
                    )
                    for tendon in section.tendons
                ),
            )
            for section in self.robot.sections
        )
        return dataclasses.replace(
            self.model, robot=dataclasses.replace(self.robot, sections=sections)
        )

    def run(
        self, *, starts: int, near: float, aside: float, initial: ArrayLike | None
    ) -> ContinuumInverse:
        """Search from several starts, until one meets the goal."""
        best: TensionTrial | None = None
        steps = tried = 0
        for start in self._make_starts(starts, initial):
            tried += 1
            trial, took = self._improve(start)
            steps += took
            if trial is not None and (best is None or trial.cost < best.cost):
                best = trial
            if best is not None and self._meets(best.shape, near, aside):
                break
        if best is None:
            best = self._try(np.zeros(len(self.unit)), None)
        shape = self.model.shape_under_tensions(best.pulls * self.unit)
        far, off = self.goal.misses(shape.tip_frame)
        met = far <= near and off <= aside
        limits = self._list_limits(shape)
        words = [] if met else [*self._explain(shape, far, off, tried), *limits]
        if not shape.converged:
            words.insert(0, str(shape.reason))
        return ContinuumInverse(
            robot=self.robot,
            bends=np.zeros((0, 2)),
            displacements=shape.displacements,
            tip_frame=shape.tip_frame,
            converged=met and bool(shape.converged),
            settled=True,
            iterations=steps,
            starts=tried,
            residual=far,
            angle=off,
            at_limits=tuple(limits),
            reason="; ".join(words),
            found=shape,
        )

    def _meets(self, shape: Shape, near: float, aside: float) -> bool:
        far, off = self.goal.misses(shape.tip_frame)
        travel, moved = self.robot.tendon_travel, shape.displacements
        inside = np.all((moved >= travel[:, 0] - near) & (moved <= travel[:, 1] + near))
        return bool(far <= near and off <= aside and inside)

    def _make_starts(self, count: int, initial: ArrayLike | None) -> list[Floats]:
        tendons = len(self.unit)
        starts = []
        if initial is not None:
            starts.append(check_values("initial", initial, (tendons,), unit="N") / self.unit)
        starts.append(np.zeros(tendons))
        draws = np.random.default_rng(20).random((max(count, 1), tendons))
        starts.extend(2.0 * draws * (draws > np.median(draws, axis=1)[:, None]))
        low, high = self.bounds
        return [np.clip(start, low, high) for start in starts[:count]]

    def _try(self, pulls: Floats, before: Shape | None) -> TensionTrial:
        """Return the shape under scaled tensions, begun at the one before."""
        begin = None if self._slides else before
        shape = self.free_model.shape_under_tensions(pulls * self.unit, initial=begin)
        residual = self._measure(shape)
        cost = float(residual @ residual) if shape.converged else math.inf
        return TensionTrial(pulls, shape, residual, cost)

    def _measure(self, shape: Shape) -> Floats:
        tip = self.goal.measure(shape.tip_frame)
        if not self._limited.size:
            return tip
        travel = self.robot.tendon_travel[self._limited]
        moved = shape.displacements[self._limited]
        over = moved - np.clip(moved, travel[:, 0], travel[:, 1])
        return np.concatenate([tip, TRAVEL_WEIGHT * over / self.goal.length])

    @cached_property
    def _slides(self) -> bool:
        """Whether friction makes a shape depend on those before it."""
        return self.model.takes_friction and bool(self.robot.tendon_friction.any())

    @cached_property
    def _limited(self) -> NDArray[np.int64]:
        """Tendons whose travel has limits."""
        return np.flatnonzero(np.isfinite(self.robot.tendon_travel).any(axis=1))

    def _differentiate(self, trial: TensionTrial) -> Floats:
        """Return the derivative of the residual by the scaled tensions."""
        if not self._limited.size and not self._slides:
            jacobian = self.free_model.jacobian(trial.shape, held="tensions")
            motion = jacobian.by_tension[-1] * self.unit
            return self.goal.differentiate(trial.shape.tip_frame, motion)
        columns = []
        for step in DIFFERENCE * np.eye(len(self.unit)):
            moved = self._try(trial.pulls + step, trial.shape)
            columns.append((moved.residual - trial.residual) / DIFFERENCE)
        return np.stack(columns, axis=1)

    def _improve(self, start: Floats) -> tuple[TensionTrial | None, int]:
        """Return the best tensions near a start, and the steps that it took."""
        trial = self._try(start, None)
        if not math.isfinite(trial.cost):
            return None, 0
        steps = 0
        for weight in TENSION_WEIGHTS:
            trial, took = self._descend(trial, weight)
            steps += took
        if trial.cost > MET_COST:
            return trial, steps
        # Among those that meet the goal, those of the least sum of squares.
        smaller, took = self._shrink(trial)
        last, more = self._descend(smaller, 0.0)
        return (last if last.cost <= MET_COST else trial), steps + took + more

    def _descend(self, trial: TensionTrial, weight: float) -> tuple[TensionTrial, int]:
        """Take steps with one weight of the tensions, until they lead no further."""
        damping, steps = FIRST_DAMPING, 0
        while steps < MOST_STEPS:
            steps += 1
            trial, damping, fell = self._step(trial, damping, weight)
            cost = trial.cost + weight * self._size(trial)
            if fell <= (LEAST_FALL if weight else 1e-9) * cost or cost < LEAST_COST:
                break
        return trial, steps

    def _shrink(self, trial: TensionTrial) -> tuple[TensionTrial, int]:
        """Follow the goal to where no tensions nearby that meet it have smaller squares."""
        from scipy.optimize import lsq_linear

        low, high = self.bounds
        for count in range(MOST_STEPS):
            slope = self._differentiate(trial)
            heavy = GOAL_WEIGHT / (float(np.abs(slope).max(initial=0.0)) or 1.0)
            rows = np.concatenate([heavy * slope, np.diag(self._shares)])
            sides = np.concatenate([-heavy * trial.residual, -self._shares * trial.pulls])
            least = np.maximum(low - trial.pulls, -SHRINKING_STEP) - EDGE
            most = np.minimum(high - trial.pulls, SHRINKING_STEP) + EDGE
            step = lsq_linear(rows, sides, (least, most), method="bvls").x
            moved = self._try(np.clip(trial.pulls + step, low, high), trial.shape)
            if not math.isfinite(moved.cost) or np.abs(step).max() < LEAST_SHRINKING:
                return trial, count
            trial = moved
        return trial, MOST_STEPS

    @cached_property
    def _shares(self) -> Floats:
        """Units of the tensions, by the largest."""
        return np.asarray(self.unit / self.unit.max(initial=1e-300))

    def _size(self, trial: TensionTrial) -> float:
        """Sum of the squared tensions, by the largest unit."""
        return float(np.sum((self._shares * trial.pulls) ** 2))

    def _step(
        self, trial: TensionTrial, damping: float, weight: float
    ) -> tuple[TensionTrial, float, float]:
        """Take one step; return where it leads, the damping for the next, and the cost's fall."""
        from scipy.optimize import lsq_linear

        slope = self._differentiate(trial)
        count = len(trial.pulls)
        light = math.sqrt(weight) * self._shares
        before = trial.cost + weight * self._size(trial)
        low, high = self.bounds
        least = np.maximum(low - trial.pulls, -LARGEST_STEP) - EDGE
        most = np.minimum(high - trial.pulls, LARGEST_STEP) + EDGE
        scale = float(np.abs(slope).max(initial=0.0)) or 1.0
        while damping <= MOST_DAMPING:
            rows = [slope, np.diag(light)]
            sides = [-trial.residual, -light * trial.pulls]
            rows.append(scale * math.sqrt(damping) * np.eye(count))
            sides.append(np.zeros(count))
            step = lsq_linear(
                np.concatenate(rows), np.concatenate(sides), (least, most), method="bvls"
            ).x
            moved = self._try(np.clip(trial.pulls + step, low, high), trial.shape)
            after = moved.cost + weight * self._size(moved)
            if after < before:
                return moved, max(damping * 0.1, LEAST_DAMPING), before - after
            damping = max(10.0 * damping, 1e-8)
        return trial, FIRST_DAMPING, 0.0

    def _list_limits(self, shape: Shape) -> list[str]:
        """Return a sentence for each limit that a shape is at."""
        words = []
        for k, name in enumerate(self.robot.tendon_names):
            most = float(self.robot.tension_limits[k])
            if abs(shape.tensions[k]) >= most * (1.0 - AT_LIMIT):
                words.append(f"tendon '{name}' is at its limit, {most:g} N")
            low, high = self.robot.tendon_travel[k].tolist()
            moved, slack = float(shape.displacements[k]), AT_LIMIT * self.robot.length
            for end, passed in ((low, moved <= low + slack), (high, moved >= high - slack)):
                if math.isfinite(end) and passed:
                    words.append(f"tendon '{name}' is at the end of its travel, {end:g} mm")
        return words

    def _explain(self, shape: Shape, far: float, off: float, tried: int) -> list[str]:
        words = []
        away = float(np.linalg.norm(self.goal.place))
        if away > self.robot.length:
            words.append(
                f"the target lies {away:.6g} mm from the base, out of reach of a backbone of "
                f"{self.robot.length:g} mm"
            )
        aside = (
            f" and {math.degrees(off):.4g} deg from its direction" if len(self.goal.axes) else ""
        )
        words.append(
            f"the nearest tip found in {tried} start(s) is {far:.6g} mm from the target{aside}"
        )
        trial = self._try(shape.tensions / self.unit, None)
        if not trial.shape.converged:
            return words
        sizes = np.linalg.svd(self._differentiate(trial), compute_uv=False)
        has = int(np.count_nonzero(sizes > RANK_RATIO * sizes.max(initial=0.0)))
        if has < self.goal.freedoms:
            words.append(
                f"there the tendons move the tip in {has} independent ways, the target takes "
                f"{self.goal.freedoms}"
            )
        return words


def solve_elastic(
    model: ContinuumModel, target: Floats, axes: Floats, options: InverseOptions
) -> ContinuumInverse:
    """Bring the tip to a place (3,) with axes (0, 1 or 3, 3) by a model of tensions.

    Raises
    ------
    InputError
        If the model takes no tensions, or an option is not for it or outside its range.
    """
    if not isinstance(model, ElasticModel):
        raise InputError(
            f"the {model.name} model has no inverse: arc has, and models that take tensions, "
            "energy and rod"
        )
    known = ("initial", "starts", "tolerance", "angle_tolerance")
    for name in options:
        if name not in known:
            raise InputError(
                f"the inverse by the {model.name} model has no option '{name}': it has "
                f"{', '.join(known)}"
            )
    count = check_integer("starts", options.get("starts", ELASTIC_STARTS), low=1, high=MOST_STARTS)
    near = check_number(
        "tolerance", options.get("tolerance", 1e-4), low=0.0, low_open=True, unit="mm"
    )
    aside = check_number(
        "angle_tolerance", options.get("angle_tolerance", 1e-5), low=0.0, low_open=True, unit="rad"
    )
    length = model.robot.length
    goal = TipGoal(place=target, axes=axes, length=length, turn=length / math.pi)
    return ElasticSearch(model, goal).run(
        starts=count, near=near, aside=aside, initial=options.get("initial")
    )
