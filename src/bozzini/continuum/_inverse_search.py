"""The search behind the inverse: starts, the kernels' goal, and what is said of the result."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number
from ..errors import GeometryError
from ._bend_limits import BendLimits, find_limits
from ._inverse_kernels import REACHED, SETTLED, improve, move_inside, rank_starts, search
from ._inverse_starts import CANDIDATES, bend_towards, guess_bends, spread_bends
from ._places import check_values
from .arc import arc_frames
from .robot import ContinuumRobot
from .tendon import GRAIN

__all__ = ["InverseResult", "Search"]

Floats = NDArray[np.float64]

PLANS = np.array([[60, 12, 0], [600, 601, 1]])
"""Most steps, steps in which the cost must fall by a tenth, and whether to use second
derivatives: of each start, and of the best one at last."""

FINE = 0.01
"""Share of the tolerance at which the solver stops."""

SMALL = (1e-3, 1e-5, 1e-7)
"""Weights of the bends against the miss, in parts of the squared length, one after the other."""

Goal = tuple[Floats, NDArray[np.int64], Floats, Floats, Floats, Floats, float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class InverseResult:
    """What an inverse found; where it did not succeed, the nearest it found.

    Parameters
    ----------
    bends : (m, 2) ndarray
        ``(theta cos(phi), theta sin(phi))`` of each section [rad], inside all limits.
    displacements : (t,) ndarray
        Displacements of the tendons for them [mm].
    tip_frame : (4, 4) ndarray
        Frame of the tip at these bends [mm].
    success : bool
        Whether all that was asked for is met within the tolerances.
    converged : bool
        Whether the solver succeeded, or settled where no small change of the bends does better.
    iterations : int
        Steps of all starts together.
    starts : int
        Starts that were tried.
    residual : float
        Largest distance from what was asked for [mm].
    angle : float
        Angle of the tip from what was asked for [rad]; 0 if nothing was.
    at_limits : tuple of str
        Limits of sections and tendons that the bends lie at, a sentence each.
    reason : str
        Why it did not succeed, and by how much; empty on success.
    """

    bends: Floats
    displacements: Floats
    tip_frame: Floats
    success: bool
    converged: bool
    iterations: int
    starts: int
    residual: float
    angle: float
    at_limits: tuple[str, ...]
    reason: str

    @property
    def tip(self) -> Floats:
        """Place of the tip [mm], shape (3,)."""
        return np.asarray(self.tip_frame[:3, 3])

    def require(self) -> InverseResult:
        """Return this result if it succeeded.

        Raises
        ------
        GeometryError
            With the reason.
        """
        if not self.success:
            raise GeometryError(self.reason)
        return self


@dataclass(frozen=True, eq=False)
class Search:
    """A goal in the kernels' terms, and the closed-form start for it."""

    limits: BendLimits
    goal: Goal
    along: Floats
    guess: Floats

    @classmethod
    def of_tip(cls, robot: ContinuumRobot, place: Floats, axes: Floats) -> Search:
        """Return the search for a place of the tip and its axes, shape (0, 1 or 3, 3)."""
        limits = find_limits(robot)
        last = np.array([len(robot.sections) - 1])
        turn = robot.length / math.pi
        one = np.ones(1)
        goal = (limits.lengths, last, one, place[None].copy(), one, axes, turn, 0.0)
        bend = bend_towards(place)
        return cls(
            limits, goal, np.array([robot.length]), limits.lengths[:, None] / robot.length * bend
        )

    @classmethod
    def of_curve(
        cls, robot: ContinuumRobot, places: Floats, along: Floats, weights: Floats
    ) -> Search:
        """Return the search for places (k, 3) at arc lengths (k,) with weights (k,)."""
        limits = find_limits(robot)
        along = np.clip(along, 0.0, robot.length)
        owner = robot.section_at(along)
        share = (along - robot.section_starts[owner]) / limits.lengths[owner]
        share = np.clip(share, 0.0, 1.0)
        axes = np.empty((0, 3))
        goal = (limits.lengths, owner, share, places, weights, axes, 0.0, 0.0)
        return cls(limits, goal, along, guess_bends(robot, places, along))

    def run(
        self,
        initial: ArrayLike | None,
        starts: int,
        tolerance: float,
        angle_tolerance: float,
        *,
        smallest_bends: bool,
    ) -> InverseResult:
        """Search, and tell what was found."""
        check_integer("starts", starts, low=1, high=CANDIDATES)
        near = check_number("tolerance", tolerance, low=0.0, low_open=True, unit="mm")
        aside = check_number("angle_tolerance", angle_tolerance, low=0.0, low_open=True, unit="rad")
        bounds = self.limits.kernel
        if not move_inside(bounds, np.zeros_like(self.guess)):
            raise self.limits.explain_empty()
        tolerances = FINE * np.array([near, aside])
        bends = np.zeros_like(self.guess)
        code, steps, tried, _, far, off = search(
            self.goal,
            bounds,
            self._make_starts(initial, starts),
            tolerances,
            PLANS,
            bends,
        )
        met = far <= near and off <= aside
        if smallest_bends and met:
            bends, far, off, more = self._shrink(bends, tolerances, near, aside, far, off)
            steps += more
        return self._conclude(
            bends,
            success=bool(met),
            converged=bool(met or code in (REACHED, SETTLED)),
            steps=int(steps),
            tried=int(tried),
            far=float(far),
            off=float(off),
        )

    def _make_starts(self, initial: ArrayLike | None, count: int) -> Floats:
        given = [] if initial is None else [check_values("initial", initial, self.guess.shape)]
        first = [*given, self.guess]
        room = count - len(first)
        if room <= 0:
            return np.ascontiguousarray(first[:count])
        # Turned with the target, so that a turned target has turned bends.
        x, y = self.goal[3][-1, :2]
        size = math.hypot(x, y)
        cosine, sine = (x / size, y / size) if size > 0.0 else (1.0, 0.0)
        largest = np.minimum(self.limits.discs, math.pi)
        drawn = spread_bends(len(largest)) * largest[:, None]
        drawn = np.ascontiguousarray(drawn @ np.array([[cosine, sine], [-sine, cosine]]))
        costs = np.empty(len(drawn))
        rank_starts(self.goal, drawn, costs)
        best = np.argsort(costs, kind="stable")[:room]
        return np.concatenate([first, drawn[best]])

    def _shrink(
        self,
        bends: Floats,
        tolerances: Floats,
        near: float,
        aside: float,
        far: float,
        off: float,
    ) -> tuple[Floats, float, float, int]:
        """Follow the goal with a falling weight on the bends; keep it if it is met and smaller."""
        trial = bends.copy()
        steps = 0
        for share in (*SMALL, 0.0):
            goal = (*self.goal[:-1], share * self.limits.robot.length**2)
            _, took, _, distance, angle = improve(
                goal, self.limits.kernel, trial, tolerances, PLANS[1]
            )
            steps += took
        if distance <= near and angle <= aside and np.sum(trial**2) <= np.sum(bends**2):
            return trial, distance, angle, steps
        return bends, far, off, steps

    def _conclude(
        self,
        bends: Floats,
        *,
        success: bool,
        converged: bool,
        steps: int,
        tried: int,
        far: float,
        off: float,
    ) -> InverseResult:
        robot = self.limits.robot
        at_limits = self.limits.describe_limits(bends)
        displacements = self.limits.coupling.matrix @ bends.ravel()
        reason = ""
        if not success:
            reason = self._explain(bends, at_limits, far, off, tried)
            if not converged:
                reason += f"; the search had not settled after {steps} steps"
        else:
            held = self.limits.coupling.solve(displacements)
            if not held.converged or np.abs(held.bends - bends).max() > 1e-6:
                success = False
                loose = "the bends are met, but the tendons cannot hold them"
                reason = f"{loose}: {held.reason}" if not held.converged else f"{loose} tight"
        return InverseResult(
            bends=bends,
            displacements=displacements,
            tip_frame=arc_frames(robot, bends, arc_length=[robot.length])[0],
            success=success,
            converged=converged,
            iterations=steps,
            starts=tried,
            residual=far,
            angle=off,
            at_limits=at_limits,
            reason=reason,
        )

    def _explain(
        self, bends: Floats, at_limits: tuple[str, ...], far: float, off: float, tried: int
    ) -> str:
        _, _, _, places, _, axes, _, _ = self.goal
        robot = self.limits.robot
        words = []
        reach = np.linalg.norm(places, axis=1) - self.along
        beyond = int(np.argmax(reach))
        if reach[beyond] > GRAIN:
            words.append(
                f"the target lies {np.linalg.norm(places[beyond]):.6g} mm from the base, out of "
                f"reach of a backbone of {self.along[beyond]:g} mm"
            )
        if len(places) > 1 or self.along[0] < robot.length - GRAIN:
            order = np.argsort(self.along, kind="stable")
            frames = arc_frames(robot, bends, arc_length=self.along[order])
            apart = np.linalg.norm(frames[:, :3, 3] - places[order], axis=1)
            where = self.along[order][int(np.argmax(apart))]
            words.append(
                f"the nearest curve found in {tried} start(s) is up to {far:.6g} mm away, at arc "
                f"length {where:.4g} mm"
            )
        else:
            turned = f" and {math.degrees(off):.4g} deg from its direction" if len(axes) else ""
            words.append(
                f"the nearest tip found in {tried} start(s) is {far:.6g} mm from the target{turned}"
            )
            needs, has = 3 + min(len(axes) + 1, 3) * bool(len(axes)), 2 * len(bends)
            if has < needs:
                words.append(f"{len(bends)} section(s) have {has} freedoms, the target {needs}")
        if len(self.limits.basis) < bends.size:
            words.extend(self.limits.coupling.open_directions())
        return "; ".join([*words, *at_limits])
