"""Bends and tendon displacements that bring a robot of arcs to a wanted tip, pose or curve.

Sections have fixed lengths, so there is no closed form for two or more: damped least squares
(Levenberg and Marquardt) over ``(theta cos(phi), theta sin(phi))``, which is smooth through the
straight section, with analytic derivatives. Every step is the best one inside the limits of bends
and tendon travel, not one that is cut back to them.

A target counts as out of reach when no start came near; that is a proof only where the reason
says that the target is further away than the backbone is long, and for one section.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number
from ..errors import GeometryError, InputError
from ._bend_limits import BendLimits, find_limits
from .arc import arc_frames
from .checks import check_directions, check_frame, check_places, check_values
from .kernels.inverse import REACHED, SETTLED, improve, move_inside, rank_starts, search
from .robot import ContinuumRobot
from .section import GRAIN

Floats = NDArray[np.float64]

# Bends from which the inverse starts, in closed form or evenly spread.

CANDIDATES = 256
"""Sets of bends among which starts are chosen."""


def bend_towards(place: Floats) -> Floats:
    """Return the bend of the arc from the base, along z, through a place [rad], shape (2,)."""
    across = math.hypot(place[0], place[1])
    if across == 0.0:
        return np.zeros(2)
    return np.asarray(2.0 * math.atan2(across, place[2]) * (place[:2] / across))


def guess_bends(robot: ContinuumRobot, places: Floats, along: Floats) -> Floats:
    """Return bends of arcs through the curve's points at the sections' ends, one after another."""
    order = np.argsort(along, kind="stable")
    arc = np.concatenate([[0.0], along[order]])
    line = np.concatenate([np.zeros((1, 3)), places[order]])
    bends = np.zeros((len(robot.sections), 2))
    for index, end in enumerate(robot.section_ends):
        if end > arc[-1] + GRAIN and robot.section_starts[index] >= arc[-1] - GRAIN:
            break
        reached = min(end, arc[-1])
        joint = np.array([np.interp(reached, arc, line[:, k]) for k in range(3)])
        frame = arc_frames(robot, bends, arc_length=[robot.section_starts[index]])[0]
        share = (reached - robot.section_starts[index]) / robot.sections[index].length
        bends[index] = bend_towards(frame[:3, :3].T @ (joint - frame[:3, 3])) / share
    return bends


@functools.lru_cache(maxsize=32)
def spread_bends(sections: int) -> Floats:
    """Return `CANDIDATES` sets of bends, the same ones each time, evenly in discs of radius 1."""
    draws = np.random.default_rng(20).random((CANDIDATES, sections, 2))
    angle = 2.0 * math.pi * draws[..., 0]
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(np.sqrt(draws[..., 1:]) * unit)


# The search behind the inverse: starts, the kernels' goal, and what is said of the result.

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


def solve_tip(
    robot: ContinuumRobot,
    target: ArrayLike,
    *,
    direction: ArrayLike | None = None,
    initial: ArrayLike | None = None,
    starts: int = 16,
    tolerance: float = 1e-6,
    angle_tolerance: float = 1e-6,
    smallest_bends: bool = False,
) -> InverseResult:
    """Bring the tip to a place, and if asked to look in a direction.

    Parameters
    ----------
    robot : ContinuumRobot
        A robot of parallel tendons.
    target : array_like, shape (3,)
        Place in the base's frame [mm].
    direction : array_like, shape (3,), optional
        Where the tip's tangent shall point, of any length.
    initial : array_like, shape (m, 2), optional
        Bends to start from [rad]; they are moved inside the limits if they are not.
    starts : int
        Starts that may be tried, in [1, 256]: `initial`, then an arc through the target, then the
        nearest of a fixed set of bends.
    tolerance : float
        Distance [mm] at which the tip has arrived.
    angle_tolerance : float
        Angle [rad] at which the tip looks there.
    smallest_bends : bool
        Whether to use the freedom that is left for bends whose squares have a small sum.

    Returns
    -------
    InverseResult

    Raises
    ------
    InputError
        If an input has another shape or is outside its range.
    GeometryError
        If the robot's tendons are not parallel, or its limits leave no shape at all.
    """
    place = check_values("target", target, (3,), unit="mm")
    axes = np.empty((0, 3))
    if direction is not None:
        way = check_directions("direction", direction)
        if way.shape != (3,):
            raise InputError(f"direction has shape {way.shape}: it must be (3,)")
        axes = way[None]
    return Search.of_tip(robot, place, axes).run(
        initial, starts, tolerance, angle_tolerance, smallest_bends=smallest_bends
    )


def solve_pose(
    robot: ContinuumRobot,
    target: ArrayLike,
    *,
    initial: ArrayLike | None = None,
    starts: int = 32,
    tolerance: float = 1e-6,
    angle_tolerance: float = 1e-6,
    smallest_bends: bool = False,
) -> InverseResult:
    """Bring the tip's frame to a pose.

    A pose has six freedoms and a section two: with fewer than three sections only special poses
    can be reached. Where the pose is not reached, an angle of one radian counts like a distance
    of the robot's length by pi.

    Parameters
    ----------
    robot : ContinuumRobot
        A robot of parallel tendons.
    target : array_like, shape (4, 4)
        Frame in the base's frame [mm]: columns x, y, tangent, place.
    initial, starts, tolerance, angle_tolerance, smallest_bends
        As of `solve_tip`.

    Returns
    -------
    InverseResult

    Raises
    ------
    InputError
        If an input has another shape or is outside its range, or `target` is no frame.
    GeometryError
        If the robot's tendons are not parallel, or its limits leave no shape at all.
    """
    frame = check_values("target", target, (4, 4))
    check_frame("target", frame)
    axes = np.ascontiguousarray(frame[:3, :3].T[[2, 0, 1]])
    return Search.of_tip(robot, frame[:3, 3], axes).run(
        initial, starts, tolerance, angle_tolerance, smallest_bends=smallest_bends
    )


def solve_curve(
    robot: ContinuumRobot,
    points: ArrayLike,
    *,
    arc_length: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    initial: ArrayLike | None = None,
    starts: int = 4,
    tolerance: float = 1e-6,
    smallest_bends: bool = False,
) -> InverseResult:
    """Lay the whole backbone along a curve, with the least sum of squared distances.

    A curve that is not made of arcs of the sections' lengths is not met exactly: give the
    tolerance that the task allows, or look at `residual`.

    Parameters
    ----------
    robot : ContinuumRobot
        A robot of parallel tendons.
    points : array_like, shape (k, 3)
        Points in the base's frame [mm], from base to tip.
    arc_length : array_like, shape (k,), optional
        Arc lengths of the backbone that belong to them [mm]; unless given, the length of the
        line through the base and the points up to each.
    weights : array_like, shape (k,), optional
        Weight of each point's distance, 1 unless given.
    initial, starts, smallest_bends
        As of `solve_tip`.
    tolerance : float
        Distance [mm] within which every point must lie.

    Returns
    -------
    InverseResult

    Raises
    ------
    InputError
        If an input has another shape or is outside its range, or the curve is longer than the
        robot.
    GeometryError
        If the robot's tendons are not parallel, or its limits leave no shape at all.
    """
    places = np.ascontiguousarray(check_places("points", points))
    if places.ndim != 2 or not len(places):
        raise InputError(f"points has shape {places.shape}: it must be (k, 3), k at least 1")
    if arc_length is None:
        steps = np.diff(places, axis=0, prepend=np.zeros((1, 3)))
        along = np.cumsum(np.linalg.norm(steps, axis=1))
    else:
        along = check_values("arc_length", arc_length, (len(places),), unit="mm")
    if along.min() < -GRAIN or along.max() > robot.length * (1.0 + 1e-9):
        raise InputError(
            f"arc_length of the points spans [{along.min():.6g}, {along.max():.6g}] mm: it must "
            f"lie in [0, {robot.length:g}] mm, the robot's length"
        )
    heavy = np.ones(len(places))
    if weights is not None:
        heavy = check_values("weights", weights, (len(places),))
        if not (heavy.min() >= 0.0 and heavy.max() > 0.0):
            raise InputError(f"weights has {heavy.min():g}: none may be negative, nor all 0")
    return Search.of_curve(robot, places, along, heavy).run(
        initial, starts, tolerance, 1.0, smallest_bends=smallest_bends
    )
