"""What is driven: the planned chain, an elastic scope that is pushed, and a tendon robot."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import numpy as np

from ..checks import show_apart
from ..continuum.robot import RobotDesign
from ..errors import InputError
from ..motion.actuate.actuation import Actuation
from ..motion.plan import Plan
from ..motion.scope import Introducer
from ..numeric.arrays import Floats
from ..numeric.polylines import (
    carry_frames,
    follow_way,
    interpolate_polyline,
    measure_arc_length,
)
from ..results import Shown
from .manoeuvre import Manoeuvre, StepReport
from .options import ScopeOptions
from .simulate import Chain, Route, Simulation

SERVO_DAMPING_S = 0.0045
"""Damping of a joint's servo over its gain [s]; assumed."""

RAMP_S = 0.5
"""Time in which a drive comes up to speed."""

REST_S = 0.3
"""Time after a step of a manoeuvre in which the scope comes to rest."""

TWIST_RATE = 1.0
"""How fast the handle is turned [rad/s]; assumed."""

TENDON_STIFFNESS_N = 5000.0
"""EA of a tendon that the robot's file says does not stretch."""

_OFF_AXIS_MM = 0.02  # of the last joint, which is left as it is


class Drive(Protocol):
    """What commands a chain: its start, and where its drives are to be at a time."""

    @property
    def name(self) -> str:
        """How it is called."""

    chain: Chain
    start: Floats
    """Slide and hinges (v,) at the beginning."""
    duration: float
    """Of the whole motion [s]."""

    def command(self, time: float, simulation: Simulation) -> tuple[Floats, Floats | None]:
        """Return control and rates (u,) for the step that ends at a time [s]."""

    def find_goal(self, time: float) -> Floats | None:
        """Return where the tip is to be [mm]; None where the drive does not say."""


def clock_motion(way: Floats, speed: float) -> Floats:
    """Return the times (n,) [s] at which a motion is at cumulated lengths (n,), after a ramp."""
    return np.where(
        way < 0.5 * speed * RAMP_S,
        np.sqrt(2.0 * way * RAMP_S / speed),
        0.5 * RAMP_S + way / speed,
    )


def read_table(table: Floats, times: Floats, time: float) -> tuple[Floats, Floats]:
    """Return the row (u,) of a table (n, u) at a time between its own, and its rates; then rest."""
    k = int(np.clip(np.searchsorted(times, time, "right") - 1, 0, len(times) - 2))
    span, move = times[k + 1] - times[k], table[k + 1] - table[k]
    share = (time - times[k]) / span
    if share >= 1.0:
        return table[k + 1], np.zeros_like(move)
    return table[k] + share * move, move / span


def find_bends(joints: Floats, base: Floats) -> Floats:
    """Return the hinges (steps, 2 n) [rad] of chains (steps, n + 1, 3), base first.

    Parameters
    ----------
    joints : (steps, n + 1, 3) float
        World [mm].
    base : (3, 3) float
        Axes of the base as columns; z is the way in.
    """
    from .kernels.chain import fill_bends

    bends = np.empty((joints.shape[0], 2 * (joints.shape[1] - 1)))
    fill_bends(np.ascontiguousarray(joints, dtype=np.float64), np.ascontiguousarray(base), bends)
    return bends


def stand_outside(introducer: Introducer, length: float) -> Floats:
    """Return the frame (4, 4) of the base of a straight robot whose tip stands at the entry."""
    frame = np.eye(4)
    frame[:3, :3] = carry_frames(-introducer.outward[None])[0]
    frame[:3, 3] = introducer.entry + length * introducer.outward
    return frame


@dataclass(eq=False)
class PlanDrive(Shown):
    """The planned chain: each joint follows the plan by a servo.

    Parameters
    ----------
    plan : Plan
    speed : float
        Of the head along its path [mm/s].
    options : ScopeOptions

    Raises
    ------
    InputError
        If the plan has no introducer, or its last joint is off its axis by more than a link.
    """

    plan: Plan
    speed: float = 20.0
    options: ScopeOptions = field(default_factory=ScopeOptions)
    name: str = "plan"

    def __post_init__(self) -> None:
        plan, scope = self.plan, self.plan.get_scope()
        tube = plan.get_introducer()
        joints = _hold_tail(plan.joints[:, ::-1], tube, scope.link_length)
        lengths = np.linalg.norm(np.diff(joints[0], axis=0), axis=1)
        frame = stand_outside(tube, float(lengths.sum()))
        slide = (joints[:, 0] - frame[:3, 3]) @ frame[:3, 2]
        count = len(lengths)
        self.chain = Chain(
            lengths=lengths,
            radius=scope.radius,
            frame=frame,
            springs=np.zeros(count),
            servos=np.full(count, self.options.servo),
            servo_damping=SERVO_DAMPING_S * self.options.servo,
        )
        self.table = np.column_stack([slide, find_bends(joints, frame[:3, :3])])
        self.table[:, 1:] = np.unwrap(self.table[:, 1:], axis=0)
        way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(plan.head_arc_length)))])
        moves = np.abs(np.diff(slide))
        way += 1e-9 * np.concatenate([[0.0], np.cumsum(moves + 1.0)])  # strictly rising
        self.times = clock_motion(way, self.speed)
        self.duration = float(self.times[-1])
        self.start = self.table[0]

    def command(self, time: float, simulation: Simulation) -> tuple[Floats, Floats]:
        """Return the joints of the plan at a time, and how fast they move."""
        return read_table(self.table, self.times, time)

    def find_goal(self, time: float) -> Floats:
        """Return the head of the plan at a time."""
        heads = self.plan.joints[:, 0]
        return np.asarray(interpolate_polyline(heads, self.times, np.array([time]))[0])


def drag_chain(plan: Plan) -> Plan:
    """Return the plan's head path with a chain that follows as a tractrix, whatever the walls.

    Each joint moves towards the one before it, so that the link keeps its length: the plain
    follower that a certified plan is compared with. Its clearance is not known.
    """
    from .kernels.chain import drag_joints

    joints = plan.joints.copy()
    arc = plan.path_arc_length
    heads = interpolate_polyline(plan.path, arc, plan.head_arc_length)
    drag_joints(np.ascontiguousarray(heads), joints, plan.get_scope().link_length)
    clearance = np.full_like(plan.clearance, np.nan)
    return dataclasses.replace(plan, joints=joints, clearance=clearance, certificate=None)


def _hold_tail(joints: Floats, tube: Introducer, link: float) -> Floats:
    """Return chains (steps, n, 3), base first, whose base stays on the introducer's axis.

    Where the last joint leaves the axis a link more holds it, from a place on the axis.
    """
    way = joints[:, 0] - tube.entry
    along = way @ tube.outward
    off = np.linalg.norm(way - along[:, None] * tube.outward, axis=1)
    if off.max() <= _OFF_AXIS_MM:
        return joints
    if off.max() >= link:
        shown = show_apart(off.max(), link)
        raise InputError(
            f"the plan's last joint is up to {shown[0]} mm off the introducer's axis: it must "
            f"be less than the length of a link, {shown[1]} mm"
        )
    back = along + np.sqrt(link**2 - off**2)
    base = tube.entry + back[:, None] * tube.outward
    return np.concatenate([base[:, None], joints], axis=1)


def spread_rigidity(rigidity: Floats, lengths: Floats) -> Floats:
    """Return the stiffness (n,) of joints at the bases of links that stand for an elastic rod.

    Each has the rod of half a link on both sides; the first one, whose base is held, half of that.

    Parameters
    ----------
    rigidity : (n,) float
        EI of the rod at each link [N mm^2].
    lengths : (n,) float
        [mm].
    """
    before = np.concatenate([[0.0], lengths[:-1]])
    return np.asarray(rigidity / (0.5 * (before + lengths)))


def _bend_evenly(count: int, tip: int, turn: Floats) -> Floats:
    """Return hinges (2 n) where the last `tip` links share a bend about x and y."""
    bends = np.zeros((count, 2))
    bends[count - tip :] = turn / tip
    return bends.ravel()


@dataclass(eq=False)
class PushDrive(Shown):
    """An elastic scope that is pushed from outside, and steered at its tip along a line.

    The operator looks `ahead` along the line, and bends the tip towards that place.

    Parameters
    ----------
    line : (m, 3) float
        The way, the entry first [mm].
    introducer : Introducer
    diameter, length, link : float
        Of the scope, and of its links [mm].
    speed : float
        Of the base [mm/s].
    options : ScopeOptions
    steered : bool
        Whether the tip is steered; otherwise it is as elastic as the shaft.
    """

    line: Floats
    introducer: Introducer
    diameter: float
    length: float
    link: float = 10.0
    speed: float = 20.0
    options: ScopeOptions = field(default_factory=ScopeOptions)
    steered: bool = True

    name: ClassVar[str] = "push"

    def __post_init__(self) -> None:
        options = self.options
        count = max(2, math.ceil(self.length / self.link))
        lengths = np.full(count, self.length / count)
        self.tip = min(count - 1, max(1, round(options.tip_length / lengths[0])))
        springs = spread_rigidity(np.full(count, options.rigidity), lengths)
        servos = np.zeros(count)
        if self.steered:
            servos[count - self.tip :] = springs[count - self.tip :]
            springs[count - self.tip :] = 0.0
        self.chain = Chain(
            lengths=lengths,
            radius=0.5 * self.diameter,
            frame=stand_outside(self.introducer, self.length),
            springs=springs,
            servos=servos,
            servo_damping=0.02 * float(servos.max(initial=0.0)),
        )
        self.start = np.zeros(1 + 2 * count)
        self.duration = float(clock_motion(np.array([self.length]), self.speed)[0])
        self.turn = np.zeros(2)
        self._last = 0.0
        self._arc = measure_arc_length(self.line)

    def command(self, time: float, simulation: Simulation) -> tuple[Floats, Floats]:
        """Push on, and turn the tip towards the line ahead."""
        speed = self.speed * min(1.0, time / RAMP_S)
        way = self.speed * (time - 0.5 * RAMP_S if time > RAMP_S else 0.5 * time**2 / RAMP_S)
        if not self.steered:
            return np.array([min(way, self.length)]), np.array([speed])
        self.steer(self.aim(simulation), time - self._last)
        self._last = time
        turns = _bend_evenly(self.tip, self.tip, self.turn)
        rates = np.zeros(1 + 2 * self.tip)
        rates[0] = speed
        return np.concatenate([[min(way, self.length)], turns]), rates

    def aim(self, simulation: Simulation) -> Floats:
        """Return how far the line ahead is off the tip's axis, about its x and y [rad]."""
        tip, frame = simulation.joints[0], simulation.tip_frame
        near = int(np.argmin(np.linalg.norm(self.line - tip, axis=1)))
        ahead = self._arc[near] + max(2.0 * self.diameter, 0.5 * self.options.tip_length)
        target = interpolate_polyline(self.line, self._arc, np.array([ahead]))[0]
        local = frame.T @ (target - tip)
        angle = math.atan2(math.hypot(local[0], local[1]), local[2])
        across = np.array([-local[1], local[0]])
        return angle * across / max(float(np.linalg.norm(across)), 1e-9)

    def steer(self, off: Floats, span: float) -> None:
        """Bend the tip on by what it is off, as fast as it can."""
        rate = 2.0 * off
        size = float(np.linalg.norm(rate))
        if size > self.options.tip_rate:
            rate *= self.options.tip_rate / size
        self.turn = self.turn + span * rate
        size = float(np.linalg.norm(self.turn))
        if size > self.options.tip_bend:
            self.turn *= self.options.tip_bend / size

    def find_goal(self, time: float) -> None:
        """Return nothing: nobody says where a pushed scope's tip is to be."""
        return


@dataclass(eq=False)
class ManoeuvreDrive(PushDrive):
    """A pushed scope that is moved by an operator's steps: pushed, pulled, twisted, bent.

    Its shaft is elastic in torsion too. `reports` has what came of the steps that were begun.

    Parameters
    ----------
    manoeuvre : Manoeuvre

    Raises
    ------
    InputError
        If a step pushes in more than the scope's length, or bends its tip farther than it goes.
    """

    manoeuvre: Manoeuvre = field(kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        steps, most = self.manoeuvre.steps, self.options.tip_bend
        for k, (step, inside) in enumerate(zip(steps, self.manoeuvre.insertions, strict=True)):
            if inside > self.length:
                raise InputError(
                    f"steps[{k}].push is {step.amount:g} mm: with it {inside:g} mm are in, and the "
                    f"scope has {self.length:.4g} mm"
                )
            if step.move == "bend" and not self.options.tip_rate:
                raise InputError(f"tip rate is 0: steps[{k}] bends the tip, it must be above 0")
            if step.move == "bend" and step.amount > most:
                shown = show_apart(math.degrees(step.amount), math.degrees(most))
                raise InputError(
                    f"steps[{k}].bend is {shown[0]} deg: it must be at most the tip's bend, "
                    f"{shown[1]} deg"
                )
        lengths = self.chain.lengths
        torsion = np.full(len(lengths), self.options.torsion)
        self.chain = dataclasses.replace(self.chain, twists=spread_rigidity(torsion, lengths))
        self.start = np.zeros(1 + 3 * len(lengths))
        self._spans = [self._find_span(k) for k in range(len(steps))]
        self._ends = np.cumsum([span + RAMP_S + REST_S for span in self._spans])
        self.duration = float(self._ends[-1])
        self._base, self._handle = 0.0, 0.0
        self._place, self._angle = 0.0, 0.0
        self._before = np.zeros(0)
        self._since = 0.0, 0.0  # inserted, and the tip's angle, before the step
        self.reports: list[StepReport] = []

    def _find_span(self, k: int) -> float:
        """Return how long a step takes at full speed [s]."""
        step = self.manoeuvre.steps[k]
        if step.move == "twist":
            return max(abs(step.amount) / TWIST_RATE, 1e-9)
        if step.move == "bend":
            return (step.amount + self.options.tip_bend) / self.options.tip_rate
        return max(step.amount / (step.speed or self.speed), 1e-9)

    def command(self, time: float, simulation: Simulation) -> tuple[Floats, Floats]:
        """Go on with the step of a time."""
        k = min(int(np.searchsorted(self._ends, time - 1e-9)), len(self._ends) - 1)
        self._look(k, simulation)
        step, span = self.manoeuvre.steps[k], self._spans[k]
        since = time - (self._ends[k - 1] if k else 0.0)
        share, rate = _ease(since, span)
        moves = np.zeros(2), np.zeros(2)  # of base and handle, and how fast
        which = {"push": (0, 1.0), "pull": (0, -1.0), "twist": (1, 1.0)}.get(step.move)
        if which is not None:
            moves[0][which[0]] = which[1] * share * step.amount
            moves[1][which[0]] = which[1] * rate * step.amount
        if step.move == "bend":
            side = step.direction or 0.0
            goal = step.amount * np.array([-math.sin(side), math.cos(side)])
            off = goal - self.turn
            far = float(np.linalg.norm(off))
            most = self.options.tip_rate * (time - self._last)
            self.turn = self.turn + off * min(1.0, most / max(far, 1e-12))
        elif step.push and rate > 0.0:
            self.steer(self.aim(simulation), time - self._last)
        self._last = time
        turns = _bend_evenly(self.tip, self.tip, self.turn)
        control = np.concatenate([np.array([self._base, self._handle]) + moves[0], turns])
        rates = np.zeros(len(control))
        rates[:2] = moves[1]
        return control, rates

    def _look(self, k: int, simulation: Simulation) -> None:
        """Note where a step has come to; begin its report, from where the one before ended."""
        tip, steps = simulation.joints[0], self.manoeuvre.steps
        angle = simulation.twist
        turned = (angle - self._angle + math.pi) % math.tau - math.pi
        self._angle += turned
        while len(self.reports) <= k:
            done = len(self.reports)
            if done:
                last = steps[done - 1]
                self._base = self.manoeuvre.insertions[done - 1]
                self._handle += last.twist or 0.0
            self.reports.append(StepReport(step=steps[done].describe()))
            self._before = tip
            self._since = simulation.inserted, self._angle
        report = self.reports[k]
        report.base_moved = simulation.inserted - self._since[0]
        report.tip_moved = float(np.linalg.norm(tip - self._before))
        self._place = follow_way(self.line, self._arc, tip, before=self._place)
        report.tip_progress = self._place
        report.tip_turned = self._angle - self._since[1]
        if steps[k].twist:
            report.twist_arrived = report.tip_turned / steps[k].amount
        report.torque = max(report.torque, abs(simulation.torque))
        peak = float(simulation.touch.normals.max(initial=0.0))
        report.normal_peak = max(report.normal_peak, peak)
        if self._place >= self.diameter:
            report.inside_over_reached = simulation.inserted / self._place


def _ease(time: float, span: float) -> tuple[float, float]:
    """Return the share of a way that is done, and its rate [1/s], with a ramp at both ends."""
    ends = np.array([time, time - RAMP_S])
    done = np.clip(ends / span, 0.0, 1.0)
    sums = 0.5 * span * done**2 + np.maximum(ends - span, 0.0)
    return float(sums[0] - sums[1]) / RAMP_S, float(done[0] - done[1]) / RAMP_S


def build_tendon_chain(robot: RobotDesign, frame: Floats, *, most: float = 5.0) -> Chain:
    """Return a tendon robot as even parts of each section, elastic in bending, with its tendons.

    A joint stands in the middle of each part, so that a section's joints bend as far as its arc
    does and its end is turned as that of the arc. What a tendon is pulled by a joint is the lever
    arm of its routing there times the angle, as in the middle of a backbone that bends evenly.
    The half part behind the first joint belongs to the base.

    Twist, shear and stretch of the backbone, weight and friction of tendons are left out.

    Parameters
    ----------
    robot : RobotDesign
    frame : (4, 4) float
        Its base where the slide is at 0, world [mm].
    most : float
        Longest part [mm].
    """
    stations = np.append(0.0, robot.section_ends)
    cuts = [
        np.linspace(a, b, max(1, math.ceil((b - a) / most)) + 1)
        for a, b in zip(stations[:-1], stations[1:], strict=True)
    ]
    places = np.concatenate([0.5 * (cut[1:] + cut[:-1]) for cut in cuts])
    parts = np.concatenate([np.diff(cut) for cut in cuts])
    routes = []
    for tendon, end, stiffness in zip(
        robot.tendons, robot.tendon_ends, robot.tendon_stiffness, strict=True
    ):
        on = places < end
        there = tendon.place_at(places[on])
        slope = np.linalg.norm(tendon.slope_at(places[on]), axis=1)
        arms = np.zeros((len(places), 2))
        arms[on] = np.column_stack([there[:, 1], -there[:, 0]]) / np.hypot(1.0, slope)[:, None]
        whole = TENDON_STIFFNESS_N if math.isinf(stiffness) else float(stiffness)
        routes.append(
            Route(name=tendon.name, arms=arms, stiffness=whole / float(end), pushes=tendon.pushes)
        )
    base = frame.copy()
    base[:3, 3] += places[0] * base[:3, 2]
    return Chain(
        lengths=np.diff(np.append(places, robot.length)),
        radius=robot.radius,
        frame=base,
        springs=robot.stiffness_at(places)[:, 3] / parts,
        servos=np.zeros(len(parts)),
        tendons=tuple(routes),
    )


@dataclass(eq=False)
class TendonDrive(Shown):
    """A tendon robot that is moved as a planner's time table says.

    Parameters
    ----------
    actuation : Actuation
        Robot, displacements and advance; see `bozzini plan --robot`.
    speed : float
        Of the tip along the plan's path [mm/s].
    goals : (steps, 3) float, optional
        Where the tip is to be at each step [mm].
    """

    actuation: Actuation
    speed: float = 20.0
    goals: Floats | None = None

    name: ClassVar[str] = "tendons"

    def __post_init__(self) -> None:
        given = self.actuation
        robot = given.robot
        frame = given.frame.copy()
        frame[:3, 3] -= robot.length * frame[:3, 2]
        self.chain = build_tendon_chain(robot, frame)
        self.start = np.zeros(1 + 2 * len(self.chain.lengths))
        self.start[0] = given.base_advance[0]
        way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(given.head_arc_length)))])
        way += 1e-9 * np.arange(len(way))
        self.times = clock_motion(way, self.speed)
        self.duration = float(self.times[-1])
        self.table = np.column_stack([given.base_advance, -given.displacements])
        self._pretension = robot.pretensions

    def command(self, time: float, simulation: Simulation) -> tuple[Floats, Floats]:
        """Return the base's advance and how much longer tendons are to be than at the start."""
        row, rates = read_table(self.table, self.times, time)
        stretch = self._pretension / np.array([r.stiffness for r in self.chain.tendons])
        return np.append(row[0], row[1:] - stretch), rates

    def find_goal(self, time: float) -> Floats | None:
        """Return the tip of the plan at a time."""
        if self.goals is None:
            return None
        return np.asarray(interpolate_polyline(self.goals, self.times, np.array([time]))[0])
