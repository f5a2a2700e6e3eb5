"""Bends and tendon displacements that bring a robot of arcs to a wanted tip, pose or curve.

Sections have fixed lengths, so there is no closed form for two or more: damped least squares
(Levenberg and Marquardt) over ``(theta cos(phi), theta sin(phi))``, which is smooth through the
straight section, with analytic derivatives. Every step is the best one inside the limits of bends
and tendon travel, not one that is cut back to them.

A target counts as out of reach when no start came near; that is a proof only where the reason
states that the target is further away than the backbone is long, and for one section.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number, show_apart
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..results import Json, Result, measured, to_plain
from .arc import ArcModel, arc_frames
from .checks import MAX_COORDINATE_MM, check_directions, check_frame, check_places, check_values
from .coupling import BendLimits, find_limits
from .kernels.inverse import REACHED, SETTLED, improve, move_inside, rank_starts, search
from .profile import ROUND_OFF_MM
from .robot import RobotDesign
from .shape import Shape, describe_bends

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Bends from which the inverse starts, in closed form or evenly spread.

START_CANDIDATES = 256
"""Sets of bends among which starts are chosen."""


def bend_towards(place: Floats) -> Floats:
    """Return the bend of the arc from the base, along z, through a place [rad], shape (2,)."""
    across = math.hypot(place[0], place[1])
    if across == 0.0:
        return np.zeros(2)
    return np.asarray(2.0 * math.atan2(across, place[2]) * (place[:2] / across))


def guess_bends(robot: RobotDesign, places: Floats, along: Floats) -> Floats:
    """Return bends of arcs through the curve's points at the sections' ends, one after another."""
    order = np.argsort(along, kind="stable")
    arc = np.concatenate([[0.0], along[order]])
    line = np.concatenate([np.zeros((1, 3)), places[order]])
    bends = np.zeros((len(robot.sections), 2))
    for index, end in enumerate(robot.section_ends):
        if end > arc[-1] + ROUND_OFF_MM and robot.section_starts[index] >= arc[-1] - ROUND_OFF_MM:
            break
        reached = min(end, arc[-1])
        joint = np.array([np.interp(reached, arc, line[:, k]) for k in range(3)])
        frame = arc_frames(robot, bends, arc_length=[robot.section_starts[index]])[0]
        share = (reached - robot.section_starts[index]) / robot.sections[index].length
        bends[index] = bend_towards(frame[:3, :3].T @ (joint - frame[:3, 3])) / share
    return bends


@functools.lru_cache(maxsize=32)
def spread_bends(sections: int) -> Floats:
    """Return sets of bends, the same ones each time, drawn evenly in discs of radius 1."""
    draws = np.random.default_rng(20).random((START_CANDIDATES, sections, 2))
    angle = 2.0 * math.pi * draws[..., 0]
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(np.sqrt(draws[..., 1:]) * unit)


# The search behind the inverse: starts, the kernels' goal, and the reasons in the result.

STAGES = np.array([[60, 12, 0], [600, 601, 1]])
"""Most steps, steps in which the cost must fall by a tenth, and whether to use second
derivatives: of each start, and of the best one at last."""

SOLVER_TOLERANCE_SHARE = 0.01
"""Share of the tolerance at which the solver stops."""

BEND_WEIGHTS = (1e-3, 1e-5, 1e-7)
"""Weights of the bends against the miss, in parts of the squared length, one after the other."""

Goal = tuple[Floats, NDArray[np.int64], Floats, Floats, Floats, Floats, float, float]


class InverseOptions(TypedDict, total=False):
    """How an inverse is searched; each may be left out.

    Attributes
    ----------
    initial : array_like, shape (m, 2)
        Bends to start from [rad]; they are moved inside the limits if they are not.
    starts : int
        Starts that may be tried, in [1, 256]: `initial`, then an arc through the target, then the
        nearest of a fixed set of bends. By default 16 for a place of the tip, 32 for a pose, 4 for
        a curve.
    tolerance : float
        Distance [mm] at which a point has arrived; 1e-6 by default.
    angle_tolerance : float
        Angle [rad] at which the tip looks as asked; 1e-6 by default.
    smallest_bends : bool
        Whether to use the freedom that is left for bends whose squares have a small sum.
    """

    initial: ArrayLike | None
    starts: int
    tolerance: float
    angle_tolerance: float
    smallest_bends: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class ContinuumInverse(Result):
    """What an inverse found; where the target is not met, the nearest that was found.

    Parameters
    ----------
    robot : RobotDesign
        The robot.
    bends : (m, 2) ndarray
        ``(theta cos(phi), theta sin(phi))`` of each section [rad], inside all limits; m is 0 of
        a model whose sections do not bend in arcs.
    displacements : (t,) ndarray
        Displacements of the tendons for them [mm].
    tip_frame : (4, 4) ndarray
        Frame of the tip at these bends [mm].
    converged : bool
        Whether the target is met within the tolerances, by bends that the tendons hold.
    settled : bool
        Whether the solver came to an end: at the target, or where no small change of the bends
        does better.
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
        Why the target is not met, and by how much; empty where `converged`.
    found : Shape, optional
        The shape by another model than arcs.
    """

    rows_have_verdict = True

    robot: RobotDesign
    bends: Floats
    displacements: Floats
    tip_frame: Floats
    converged: bool
    settled: bool
    iterations: int
    starts: int
    residual: float
    angle: float
    at_limits: tuple[str, ...]
    reason: str
    found: Shape | None = field(default=None, repr=False)

    @property
    def tensions(self) -> Floats:
        """Tensions of the tendons [N], shape (t,); (0,) by arcs."""
        return np.empty(0) if self.found is None else self.found.tensions

    @property
    def tip(self) -> Floats:
        """Place of the tip [mm], shape (3,)."""
        return np.asarray(self.tip_frame[:3, 3])

    def require(self) -> ContinuumInverse:
        """Return this result if the target is met.

        Raises
        ------
        GeometryError
            With the reason.
        """
        if not self.converged:
            raise GeometryError(self.reason)
        return self

    def to_dict(self) -> Json:
        """Return the result as plain values, units in the names."""
        moved = zip(self.robot.tendon_names, self.displacements, strict=True)
        pulled = zip(self.robot.tendon_names, self.tensions, strict=False)
        own = {} if self.found is None else {"model": self.found.model, "tensions_N": dict(pulled)}
        plain = to_plain(
            {
                "converged": self.converged,
                "settled": self.settled,
                "reason": self.reason,
                "tip_mm": self.tip,
                "tip_direction": self.tip_frame[:3, 2],
                "residual_mm": self.residual,
                "angle_rad": self.angle,
                "iterations": self.iterations,
                "starts": self.starts,
                "at_limits": self.at_limits,
                "sections": describe_bends(self.robot, self.bends),
                "displacements_mm": dict(moved),
            }
            | own
        )
        return dict(plain)

    def list_columns(self) -> Json:
        """Return the columns of `to_frame`: the displacement of each tendon, and its tension."""
        columns = {"tendon": self.robot.tendon_names, "displacement_mm": self.displacements}
        return columns | ({} if self.found is None else {"tension_N": self.tensions})

    def shape(self) -> Shape:
        """Return the shape: that of arcs at these displacements unless by another model."""
        if self.found is not None:
            return self.found
        return ArcModel(self.robot, between=3).shape(self.displacements)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the shape that was found, seen from the side, and return the axes."""
        return self.shape().plot(ax)


@dataclass(frozen=True, eq=False)
class InverseProblem:
    """A goal in the kernels' terms, and the closed-form start for it."""

    limits: BendLimits
    goal: Goal
    along: Floats
    guess: Floats

    @classmethod
    def of_tip(cls, robot: RobotDesign, place: Floats, axes: Floats) -> InverseProblem:
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
        cls, robot: RobotDesign, places: Floats, along: Floats, weights: Floats
    ) -> InverseProblem:
        """Return the search for places (k, 3) at arc lengths (k,) with weights (k,)."""
        limits = find_limits(robot)
        along = np.clip(along, 0.0, robot.length)
        owner = robot.section_at(along)
        share = (along - robot.section_starts[owner]) / limits.lengths[owner]
        share = np.clip(share, 0.0, 1.0)
        axes = np.empty((0, 3))
        goal = (limits.lengths, owner, share, places, weights, axes, 0.0, 0.0)
        return cls(limits, goal, along, guess_bends(robot, places, along))

    def run(self, options: InverseOptions, *, starts: int) -> ContinuumInverse:
        """Search, with `starts` starts unless the options have another number."""
        known = InverseOptions.__annotations__
        for name in options:
            if name not in known:
                raise InputError(f"the inverse has no option '{name}': it has {', '.join(known)}")
        count = check_integer("starts", options.get("starts", starts), low=1, high=START_CANDIDATES)
        near, aside = (
            check_number(name, options.get(name, 1e-6), low=0.0, low_open=True, unit=unit)  # type: ignore[arg-type]
            for name, unit in (("tolerance", "mm"), ("angle_tolerance", "rad"))
        )
        bounds = self.limits.kernel
        if not move_inside(bounds, np.zeros_like(self.guess)):
            raise self.limits.explain_empty()
        tolerances = SOLVER_TOLERANCE_SHARE * np.array([near, aside])
        bends = np.zeros_like(self.guess)
        tries = self._make_starts(options.get("initial"), count)
        code, steps, tried, _, far, off = search(
            self.goal, bounds, tries, tolerances, STAGES, bends
        )
        met = far <= near and off <= aside
        if options.get("smallest_bends", False) and met:
            smaller, distance, angle, more = self._shrink(bends, tolerances)
            steps += more
            if distance <= near and angle <= aside and np.sum(smaller**2) <= np.sum(bends**2):
                bends, far, off = smaller, distance, angle
        at_limits = self.limits.describe_limits(bends)
        displacements = self.limits.coupling.matrix @ bends.ravel()
        settled = bool(met or code in (REACHED, SETTLED))
        if met:
            reason = self._explain_hold(bends, displacements)
        else:
            reason = "; ".join([*self._explain(bends, far, off, tried), *at_limits])
            if not settled:
                reason += f"; the search had not settled after {steps} steps"
        robot = self.limits.robot
        return ContinuumInverse(
            robot=robot,
            bends=bends,
            displacements=displacements,
            tip_frame=arc_frames(robot, bends, arc_length=[robot.length])[0],
            converged=bool(met) and not reason,
            settled=settled,
            iterations=int(steps),
            starts=int(tried),
            residual=float(far),
            angle=float(off),
            at_limits=at_limits,
            reason=reason,
        )

    def _make_starts(self, initial: ArrayLike | None, count: int) -> Floats:
        given = [] if initial is None else [check_values("initial", initial, self.guess.shape)]
        first = [*given, self.guess]
        left = count - len(first)
        if left <= 0:
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
        best = np.argsort(costs, kind="stable")[:left]
        return np.concatenate([first, drawn[best]])

    def _shrink(self, bends: Floats, tolerances: Floats) -> tuple[Floats, float, float, int]:
        """Follow the goal with a falling weight on the bends."""
        trial, steps = bends.copy(), 0
        distance, angle = math.inf, math.inf
        for share in (*BEND_WEIGHTS, 0.0):
            goal = (*self.goal[:-1], share * self.limits.robot.length**2)
            _, took, _, distance, angle = improve(
                goal, self.limits.kernel, trial, tolerances, STAGES[1]
            )
            steps += took
        return trial, distance, angle, steps

    def _explain_hold(self, bends: Floats, displacements: Floats) -> str:
        """Why the tendons cannot hold bends that are as asked; empty if they can."""
        held = self.limits.coupling.solve(displacements)
        loose = "the bends are met, but the tendons cannot hold them"
        if not held.converged:
            return f"{loose}: {held.reason}"
        return f"{loose} tight" if np.abs(held.bends - bends).max() > 1e-6 else ""

    def _explain(self, bends: Floats, far: float, off: float, tried: int) -> list[str]:
        _, _, _, places, _, axes, _, _ = self.goal
        robot = self.limits.robot
        words = []
        reach = np.linalg.norm(places, axis=1) - self.along
        beyond = int(np.argmax(reach))
        if reach[beyond] > ROUND_OFF_MM:
            words.append(
                f"the target lies {np.linalg.norm(places[beyond]):.6g} mm from the base, out of "
                f"reach of a backbone of {self.along[beyond]:g} mm"
            )
        if len(places) > 1 or self.along[0] < robot.length - ROUND_OFF_MM:
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
        return words


def check_tip_target(target: ArrayLike, direction: ArrayLike | None) -> tuple[Floats, Floats]:
    """Return the place (3,) of a target, and the tangent that it asks for, (0 or 1, 3).

    Raises
    ------
    InputError
        If an input has another shape.
    """
    place = check_values("target", target, (3,), unit="mm")
    if direction is None:
        return place, np.empty((0, 3))
    way = check_directions("direction", direction)
    if way.shape != (3,):
        raise InputError(f"direction has shape {way.shape}: it must be (3,)")
    return place, way[None]


def check_pose_target(target: ArrayLike) -> tuple[Floats, Floats]:
    """Return the place (3,) of a frame (4, 4), and its tangent, x and y, (3, 3).

    Raises
    ------
    InputError
        If it has another shape, or is no frame.
    """
    frame = check_values("target", target, (4, 4))
    check_frame("target", frame)
    return frame[:3, 3], np.ascontiguousarray(frame[:3, :3].T[[2, 0, 1]])


def solve_tip(
    robot: RobotDesign,
    target: ArrayLike,
    *,
    direction: ArrayLike | None = None,
    **options: Unpack[InverseOptions],
) -> ContinuumInverse:
    """Bring the tip to a place, and if asked to look in a direction.

    Parameters
    ----------
    robot : RobotDesign
        A robot of parallel tendons.
    target : array_like, shape (3,)
        Place in the base's frame [mm].
    direction : array_like, shape (3,), optional
        Where the tip's tangent shall point, of any length.
    **options
        See `InverseOptions`.

    Raises
    ------
    InputError
        If an input has another shape or is outside its range.
    GeometryError
        If the robot's tendons are not parallel, or its limits leave no shape at all.
    """
    return InverseProblem.of_tip(robot, *check_tip_target(target, direction)).run(
        options, starts=16
    )


def solve_pose(
    robot: RobotDesign, target: ArrayLike, **options: Unpack[InverseOptions]
) -> ContinuumInverse:
    """Bring the tip's frame to a pose.

    A pose has six freedoms and a section two: with fewer than three sections only special poses
    can be reached. Where the pose is not reached, an angle of one radian counts like a distance
    of the robot's length by pi.

    Parameters
    ----------
    robot : RobotDesign
        A robot of parallel tendons.
    target : array_like, shape (4, 4)
        Frame in the base's frame [mm]: columns x, y, tangent, place.
    **options
        See `InverseOptions`.

    Raises
    ------
    InputError
        If an input has another shape or is outside its range, or `target` is no frame.
    GeometryError
        If the robot's tendons are not parallel, or its limits leave no shape at all.
    """
    return InverseProblem.of_tip(robot, *check_pose_target(target)).run(options, starts=32)


def solve_curve(
    robot: RobotDesign,
    points: ArrayLike,
    *,
    arc_length: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    **options: Unpack[InverseOptions],
) -> ContinuumInverse:
    """Lay the whole backbone along a curve, with the least sum of squared distances.

    A curve that is not made of arcs of the sections' lengths is not met exactly: give the
    tolerance that the task allows, or look at `residual`.

    Parameters
    ----------
    robot : RobotDesign
        A robot of parallel tendons.
    points : array_like, shape (k, 3)
        Points in the base's frame [mm], from base to tip.
    arc_length : array_like, shape (k,), optional
        Arc lengths of the backbone that belong to them [mm]; unless given, the length of the
        line through the base and the points up to each.
    weights : array_like, shape (k,), optional
        Weight of each point's distance, 1 unless given.
    **options
        See `InverseOptions`; every point must lie within the tolerance.

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
    if along.min() < -ROUND_OFF_MM or along.max() > robot.length * (1.0 + 1e-9):
        shown = show_apart(along.max(), robot.length)
        raise InputError(
            f"arc_length of the points spans [{along.min():g}, {shown[0]}] mm: it must "
            f"lie in [0, {shown[1]}] mm, the robot's length"
        )
    heavy = np.ones(len(places))
    if weights is not None:
        heavy = check_values("weights", weights, (len(places),))
        if not (heavy.min() >= 0.0 and heavy.max() > 0.0):
            raise InputError(f"weights has {heavy.min():g}: none may be negative, nor all 0")
    return InverseProblem.of_curve(robot, places, along, heavy).run(
        {**options, "angle_tolerance": 1.0}, starts=4
    )


# Inverse of one section of fixed length and constant curvature.


@dataclass(frozen=True, kw_only=True, eq=False)
class SectionResult(Result):
    """What the inverse of one section of fixed length found.

    Parameters
    ----------
    bend : (2,) ndarray
        ``(theta cos(phi), theta sin(phi))`` [rad].
    tip : (3,) ndarray
        Where the tip is then [mm]: the target, or the nearest place on the reachable surface.
    converged : bool
        Whether that is the target, within the tolerance.
    residual : float
        Its distance from the target [mm].
    needed_length : float
        Length of the arc through the target [mm]; infinite if there is none, or none shorter
        than 1e9 mm, as straight behind the start.
    reason : str
        Why the target is not met; empty where `converged`.
    """

    bend: Floats = measured("rad")
    tip: Floats = measured("mm")
    converged: bool
    residual: float = measured("mm")
    needed_length: float = measured("mm")
    reason: str


def solve_section(
    length: float, target: ArrayLike, *, max_bend: float = 2.0 * math.pi, tolerance: float = 1e-6
) -> SectionResult:
    """Bring the tip of one section of fixed length to a place, or as near as it goes.

    The plane of the bend is that of the target; in it the tip moves on a curve. A target on that
    curve has ``theta = 2 atan2(rho, z)`` in closed form; for another the nearest place of the
    curve is found, over all bends.

    Parameters
    ----------
    length : float
        Length of the section [mm].
    target : array_like, shape (3,)
        Place in the frame of the section's start [mm].
    max_bend : float
        Largest bend [rad], in (0, 2 pi].
    tolerance : float
        Distance at which the tip has arrived [mm].

    Returns
    -------
    SectionResult

    Raises
    ------
    InputError
        If a value has another shape or is outside its range.
    """
    check_number("length", length, low=0.0, high=MAX_COORDINATE_MM, low_open=True, unit="mm")
    check_number("max_bend", max_bend, low=0.0, high=2.0 * math.pi, low_open=True, unit="rad")
    check_number("tolerance", tolerance, low=0.0, low_open=True, unit="mm")
    x, y, z = (float(value) for value in check_values("target", target, (3,), unit="mm"))
    across = math.hypot(x, y)
    plane = np.array([x / across, y / across]) if across > 0.0 else np.array([1.0, 0.0])
    closed = 2.0 * math.atan2(across, z)
    needed = _needed_length(across, z)
    angle = min(closed, max_bend)
    if math.dist(_aside(length, angle), (across, z)) > tolerance:
        angle = _nearest_bend(length, across, z, max_bend)
    aside, along = _aside(length, angle)
    tip = np.array([*(aside * plane), along])
    miss = math.dist((aside, along), (across, z))
    reason = ""
    if miss > tolerance:
        reason = f"the nearest tip of a section of {length:g} mm is {miss:.6g} mm from the target"
        if math.isfinite(needed):
            reason += (
                f", which an arc of {needed:.6g} mm, bent {math.degrees(closed):.4g} deg, reaches"
            )
        if angle >= max_bend:
            reason += f"; it is at its largest bend, {math.degrees(max_bend):.4g} deg"
    return SectionResult(
        bend=angle * plane,
        tip=tip,
        converged=miss <= tolerance,
        residual=miss,
        needed_length=needed,
        reason=reason,
    )


def _aside(length: float, angle: float) -> tuple[float, float]:
    """Return where the tip of an arc is, aside and along."""
    half = 0.5 * angle
    chord = length * float(np.sinc(half / math.pi))
    return chord * math.sin(half), chord * math.cos(half)


def _needed_length(across: float, along: float) -> float:
    """Return the length of the arc to a place in the plane; infinite beyond `MAX_COORDINATE_MM`."""
    away = math.hypot(across, along)
    # The chord is the arc's length by sin(half) / half, and sin(half) is across / away.
    half = math.atan2(across, along)
    if half < 1e-8:  # straight to the last bit; a denormal ratio would have no digits
        return away if away > 0.0 else math.inf
    sine = across / away
    length = away * half / sine if sine > 0.0 else math.inf
    return length if length <= MAX_COORDINATE_MM else math.inf


def _nearest_bend(length: float, across: float, along: float, most: float) -> float:
    """Return the bend in ``[0, most]`` of the tip that is nearest to a place in the plane."""
    from scipy.optimize import minimize_scalar

    def measure(angle: float) -> float:
        aside, up = _aside(length, angle)
        return (aside - across) ** 2 + (up - along) ** 2

    grid = np.linspace(0.0, most, 257)
    values = [measure(angle) for angle in grid]
    best = int(np.argmin(values))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, 256)]
    found = minimize_scalar(measure, bounds=(low, high), method="bounded", options={"xatol": 1e-12})
    ends = min(low, high, key=measure)
    return float(found.x if found.fun < measure(ends) else ends)
