"""An elastic robot against walls: least energy with the body outside the wall of any duct."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_fields, check_kind, quantity
from ..errors import InputError
from ..results import Json, Result, measured, take_axes, to_plain
from .checks import Floats
from .kernels.energy import CHANNEL, POINTS, WEIGHTS, fill_frames, measure_lengths
from .kernels.loads import measure_loads, place_spots
from .loads import BODY, Load, PackedLoads, pack_loads
from .profile import ROUND_OFF_MM
from .robot import RobotDesign
from .walls import Boundary, Wall, take_boundaries

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Packed = tuple[Floats, Floats, Floats, Floats, NDArray[np.int64], int]

SEGMENTS = 60
"""Segments of a robot where their length is not given, and it is not thick."""

SHORTEST = 0.3
"""A first segment shorter than this share of the next one is joined with it."""

TURN_LIMIT = 0.3
"""Largest turn of a segment in one step of Newton's method [rad]."""

MOST_STEPS = 100
"""Steps of Newton's method for one shape."""

ROUGH_MM, STEP_MM = 0.02, 1e-7
"""Step below which the multipliers are taken over, and the last one [mm]."""

BALANCED = 1e-8
"""Moment out of balance at which a shape is one of equilibrium, against the largest."""

UNFELT = 1e-6
"""Force that counts as none, against the largest."""

WRONG = 1e-6
"""Moment out of balance at which it is none, against those that act."""

STALE = 4
"""Steps without progress of the balance after which the rest of it is round-off."""

NEAR_MM = 0.02
"""What gaps and lengths may miss where the penalty is made harder [mm]."""

FRICTION_ROUNDS = 40
"""Rounds in which the normal forces of friction settle."""

FRICTION_SHARE = 1e-5
"""Change of the normal forces at which they have settled, against the largest."""

SHORT = 0.05
"""Share of a step that is so short that the penalty is made softer again."""

FAR = 5.0
"""Radii of the body beyond which a step is not taken, but a shorter one that turns to the slope."""

KICK_MM, KICK_RAD = 0.03, 0.03
"""Step below which an unstable shape is left, and the largest turn by which it is [mm], [rad]."""

FIRST_PART, LEAST_PART = 0.125, 1.0 / 256.0
"""Parts of loads and displacements that are tried at once, the first and the least."""

PIECE = 2.0
"""Segments that are inserted at once where a robot is brought into a lumen."""

SHIFTS = (0.0, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 1e2, 1e3, 1e4)
"""Shares of the backbone's stiffness that are added where the energy is not convex."""


@dataclass(frozen=True, kw_only=True)
class ContactOptions:
    """How a robot touches walls.

    Parameters
    ----------
    wall_stiffness : float, optional
        Force of the wall per length of the body and depth [N/mm^2 = MPa]; rigid unless given.
    friction : float
        Coefficient of Coulomb friction between body and wall.
    slip : float
        Slip below which friction is elastic [mm].
    segment_length : float
        Largest length of a segment [mm]; by default the body's radius, or a 60th of the robot if
        that is more.
    smoothing : float
        Distance over which a wall's kinks are rounded [mm]; by default the spacing of a sampled
        duct's nodes, and 0.02 mm for an exact one.
    tolerance : float
        How deep the body may be in the wall, or miss a tendon's length [mm].

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    wall_stiffness: float | None = quantity(
        "pressure",
        "Stiffness of the wall per length of the body (default: rigid).",
        low=0.0,
        low_open=True,
        default=None,
    )
    friction: float = quantity(
        "dimensionless", "Coefficient of friction on the wall.", low=0.0, high=2.0, default=0.0
    )
    slip: float = quantity(
        "length",
        "Slip below which friction is elastic.",
        low=1e-6,
        high=10.0,
        default=0.01,
    )
    segment_length: float | None = quantity(
        "length",
        "Largest segment (default: the body's radius, or a 60th of its length).",
        low=1e-3,
        default=None,
    )
    smoothing: float | None = quantity(
        "length",
        "Distance over which kinks of the wall are rounded (default: a sampled duct's spacing).",
        low=1e-4,
        high=100.0,
        default=None,
    )
    tolerance: float = quantity(
        "length", "How deep the body may be in the wall.", low=1e-9, high=0.1, default=1e-6
    )

    def __post_init__(self) -> None:
        check_fields(self)


def place_stations(robot: RobotDesign, largest: float | None) -> Floats:
    """Return base, ends of sections and tendons, corners of routings, and places between [mm]."""
    step = max(robot.radius, robot.length / SEGMENTS) if largest is None else largest
    fixed = [0.0, *robot.section_ends, *robot.tendon_ends]
    fixed += [place for tendon in robot.tendons for place in tendon.corners()]
    marks = np.unique(np.round(np.asarray(fixed), 9))
    marks = marks[np.append(True, np.diff(marks) > ROUND_OFF_MM)]
    parts = [
        np.linspace(a, b, max(1, math.ceil((b - a) / step - 1e-9)) + 1)[1:]
        for a, b in zip(marks[:-1], marks[1:], strict=True)
    ]
    return np.concatenate([[0.0], *parts])


@dataclass(frozen=True, eq=False)
class FreePart:
    """The part of a robot beyond an introducer, cut into segments.

    `cut` is the arc length where it begins [mm]; `stations` are those of the whole robot, `share`
    is how much of its loads acts.
    """

    robot: RobotDesign
    stations: Floats
    cut: float
    loads: PackedLoads
    share: float = 1.0

    @cached_property
    def first(self) -> int:
        """Index of the first station beyond the cut that ends a segment."""
        index = int(np.searchsorted(self.stations, self.cut + ROUND_OFF_MM))
        last = len(self.stations) - 1
        if index < last:
            gap = self.stations[index] - self.cut
            if gap < SHORTEST * (self.stations[index + 1] - self.stations[index]):
                index += 1
        return min(index, last)

    @cached_property
    def arc_length(self) -> Floats:
        """Ends of the segments [mm], shape (n + 1,)."""
        return np.concatenate([[self.cut], self.stations[self.first :]])

    @cached_property
    def spans(self) -> Floats:
        """Lengths of the segments [mm], shape (n,)."""
        return np.diff(self.arc_length)

    @cached_property
    def middles(self) -> Floats:
        """Middles of the segments [mm], shape (n,)."""
        return 0.5 * (self.arc_length[1:] + self.arc_length[:-1])

    @cached_property
    def shares(self) -> Floats:
        """Length of the body that each point but the first stands for [mm], shape (n,)."""
        shares = 0.5 * self.spans
        shares[:-1] += 0.5 * self.spans[1:]
        return shares

    @cached_property
    def radii(self) -> Floats:
        """Radius of the body at the points but the first [mm], shape (n,)."""
        radii = np.array([section.radius for section in self.robot.sections])
        return np.asarray(radii[self.robot.section_at(self.arc_length[1:])])

    @cached_property
    def stiffness(self) -> Floats:
        """Moment by turn of each segment about x, y and z [N mm], shape (n, 3)."""
        return np.asarray(self.robot.stiffness_at(self.middles)[:, 3:] / self.spans[:, None])

    @cached_property
    def rest(self) -> Floats:
        """Turns of the segments at rest [rad], shape (n, 3)."""
        return np.asarray(self.robot.curvature_at(self.middles) * self.spans[:, None])

    @cached_property
    def packed(self) -> Packed:
        """What the kernels take as ``grid``."""
        count = len(self.robot.tendons)
        paths = np.zeros((count, len(self.arc_length), 2))
        guides = np.zeros((count, len(self.spans), len(POINTS), 4))
        # Of a segment joined with a short one before it, a tendon that ends between leaves it out.
        ends = np.searchsorted(self.arc_length[1:], self.robot.tendon_ends + ROUND_OFF_MM, "right")
        places = self.arc_length[:-1, None] + self.spans[:, None] * POINTS
        for row, (tendon, end) in enumerate(zip(self.robot.tendons, ends, strict=True)):
            if end > 0:
                guides[row, :end, :, :2] = tendon.place_at(places[:end])
                guides[row, :end, :, 2:] = tendon.slope_at(places[:end])
        return self.spans, self.stiffness, paths, guides, ends.astype(np.int64), CHANNEL

    @cached_property
    def straight(self) -> Floats:
        """Length of each tendon in this part where it is straight [mm], shape (t,)."""
        slopes = np.sqrt(1.0 + np.sum(self.packed[3][..., 2:] ** 2, axis=-1))
        passed = np.arange(len(self.spans)) < self.packed[4][:, None]
        return np.asarray(np.sum(np.where(passed, self.spans * (slopes @ WEIGHTS), 0.0), axis=1))

    @cached_property
    def dead_forces(self) -> Floats:
        """Forces of loads and weight on the points but the first [N], base frame, (n, 3)."""
        forces = np.zeros((len(self.spans), 3))
        along, _ = self.loads.line_forces_at(self.robot, self.middles)
        along = along * self.spans[:, None]
        forces += 0.5 * along
        forces[:-1] += 0.5 * along[1:]
        for place, force in zip(self.loads.points, self.loads.forces, strict=True):
            if place <= self.cut:
                continue
            index = min(int(np.searchsorted(self.arc_length, place)), len(self.spans)) - 1
            share = (place - self.arc_length[index]) / self.spans[index]
            forces[index] += share * force
            if index > 0:
                forces[index - 1] += (1.0 - share) * force
        return self.share * forces

    @cached_property
    def spots(self) -> tuple[NDArray[np.int64], Floats, Floats]:
        """The points but the first, as kernels take them."""
        n = len(self.spans)
        return np.arange(n), np.ones(n), np.zeros((n, 3))

    @cached_property
    def penalty(self) -> Floats:
        """Compliance by which a point's contact is first tried, (n,) [mm/N]."""
        return np.asarray(0.25 * self.spans**2 / self.stiffness[:, 0])


@dataclass(eq=False)
class State:
    """Turns (n, 3) of the segments and multipliers: contacts (w, n) [N], tensions (t,) [N].

    `expected` (w, n) are the forces that the last step expects here [N].
    """

    turns: Floats
    forces: Floats
    tensions: Floats
    expected: Floats

    def copy(self) -> State:
        """Return a copy."""
        return dataclasses.replace(self, turns=self.turns.copy())


class Stage(NamedTuple):
    """How hard the penalty is against that of a segment, and where contact begins softly [mm]."""

    softness: float
    width: float


WIDTHS_MM = (0.02, 2e-3, 1e-4, 1e-6, 1e-9)
"""Distances over which contact begins, stage by stage of the solver [mm]."""

LEAST_SOFT = 10.0
"""Least compliance of the penalty in the first stage, against a segment's."""

SOFT_SHARE = 0.3
"""Share of the body's radius by which all loads press it in in the first stage."""

HARDNESS = (0.3, 0.03)
"""Compliance of the penalty against a segment's in the last two stages."""

WARM = 2
"""The stage at which a shape begins that follows another one."""


@dataclass(frozen=True, eq=False)
class Slip:
    """Where the points were before, (n, 3), and the contacts on which they rub, in the world."""

    before: Floats
    normals: Floats
    forces: Floats


@dataclass(eq=False)
class Measure:
    """Energy with penalties at a shape, and what follows from it."""

    value: float
    points: Floats
    forces: Floats
    tensions: Floats
    missed: float
    body_forces: Floats
    normals: Floats
    least_gap: Floats
    stiff: Floats
    slopes: Floats
    gradient: Floats = field(default_factory=lambda: np.empty(0))
    hessian: Floats = field(default_factory=lambda: np.empty(0))

    def expect(self, way: Floats) -> Floats:
        """Return the contact forces that are expected where the points have moved by (n, 3)."""
        change = self.stiff * np.sum(self.slopes * way, axis=-1)
        return np.asarray(np.maximum(self.forces - change, 1e-3 * self.forces))


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """What is minimised: elastic energy and potential, lengths of tendons, gaps to walls.

    Multipliers of an augmented Lagrangian: with gap c, compliance e of wall or tendon and that of
    the penalty r, the force is ``max(0, (r f - c) / (e + r))`` about the last one f.
    """

    part: FreePart
    boundaries: tuple[Boundary, ...]
    limits: Floats
    low: Floats
    compliances: Floats
    options: ContactOptions
    slip: Slip | None = None

    @cached_property
    def base(self) -> Floats:
        """Frame of the first point in the world, (4, 4)."""
        return self.part.robot.base_frame

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """Stages of the solver: the first so soft that all loads press the body in by its radius.

        A penalty that is hard from the start has a narrow valley for its least energy.
        """
        part = self.part
        bend = float((part.stiffness[:, 0] * part.spans).max()) / float(part.spans.sum()) ** 2
        load = bend + float(np.sqrt(np.sum(part.dead_forces**2, axis=1)).sum())
        soft = float(part.radii.min()) / load / float(np.median(part.penalty))
        soft = min(max(SOFT_SHARE * soft, LEAST_SOFT), 1e3)
        return tuple(map(Stage, (soft, math.sqrt(soft), 1.0, *HARDNESS), WIDTHS_MM))

    @cached_property
    def wall_compliance(self) -> Floats:
        """Of the wall at the points [mm/N], (n,)."""
        if self.options.wall_stiffness is None:
            return np.zeros(len(self.part.shares))
        return np.asarray(1.0 / (self.options.wall_stiffness * self.part.shares))

    @cached_property
    def tendon_penalty(self) -> Floats:
        """Compliance by which tendons are first held, (t,) [mm/N]."""
        guides = self.part.packed[3]
        reach = np.mean(np.sum(guides[..., :2] ** 2, axis=-1), axis=-1)
        give = np.sum(reach / self.part.stiffness[:, 0], axis=-1)
        return np.asarray(0.1 * give + 1e-12)

    def locate(self, turns: Floats) -> Floats:
        """Return the points but the first in the world, (n, 3) [mm]."""
        n = len(self.part.spans)
        rotations, points = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
        fill_frames(self.part.packed, turns, rotations, points)
        return np.asarray(points[1:] @ self.base[:3, :3].T + self.base[:3, 3])

    def measure(self, state: State, stage: Stage, *, whole: bool = True) -> Measure:
        """Return energy, forces and, if `whole`, derivatives about the multipliers of `state`."""
        softness, width = stage
        part, turns = self.part, state.turns
        n, count = len(part.spans), len(self.limits)
        bent = turns - part.rest
        moments = part.stiffness * bent
        value = 0.5 * float(np.sum(moments * bent))
        points = self.locate(turns)
        rotation = self.base[:3, :3]
        dead = part.dead_forces @ rotation.T
        value -= float(np.sum(dead * (points - self.base[:3, 3])))
        body, blocks = np.zeros((n, 3)), np.zeros((n, 3, 3))
        forces, normals, turned = np.zeros_like(state.forces), np.zeros((n, 3)), np.zeros((n, 3))
        least, missed = np.full(n, np.inf), 0.0
        stiff, slopes_at = np.zeros_like(state.forces), np.zeros((*state.forces.shape, 3))
        penalty = softness * part.penalty
        margin = float(part.radii.max())
        for row, boundary in enumerate(self.boundaries):
            index, gap, slope, curve = boundary.measure_near(
                points, part.radii, state.forces[row] > 0.0, margin
            )
            if not len(index):
                continue
            soft = self.wall_compliance[index] + penalty[index]
            wanted = (penalty[index] * state.forces[row, index] - gap) / soft
            root = np.sqrt(wanted**2 + 4.0 * (width / soft) ** 2)
            force = np.maximum(0.5 * (wanted + root), 0.0)
            # The stiffness of the contact about the force that is expected: primal-dual.
            rest = soft * (force - wanted) / np.maximum(state.expected[row, index], 1e-300)
            hold = np.where(
                width > 0.0, 1.0 / (soft + rest), np.where(wanted > 0.0, 1.0, 0.0) / soft
            )
            forces[row, index] = force
            value += float(np.sum(soft * integrate_force(wanted, root, width / soft)))
            moved = np.abs(penalty[index] * (state.forces[row, index] - force))
            missed = max(missed, float(moved.max()))
            body[index] += force[:, None] * slope
            normals[index] += force[:, None] * slope
            outer = slope[:, :, None] * slope[:, None, :]
            blocks[index] += hold[:, None, None] * outer
            stiff[row, index] = hold
            slopes_at[row, index] = slope
            likely = state.expected[row, index]
            blocks[index] -= likely[:, None, None] * curve
            turned[index] += (likely - force)[:, None] * slope
            np.minimum.at(least, index, gap)
        if self.slip is not None:
            value += self._rub(points, body, blocks)
        slopes, full = np.empty((count, n, 3)), np.empty((n, 3, 3))
        lengths, spare = np.empty(count), np.empty((n, 3, 3))
        measure_lengths(part.packed, turns, np.zeros(count), lengths, slopes, spare, full)
        held = softness * self.tendon_penalty
        soft = self.compliances + held
        gap = self.limits - lengths
        fixed = np.isnan(self.limits)
        wanted = np.where(fixed, state.tensions, (held * state.tensions - gap) / soft)
        tensions = np.where(fixed, wanted, np.maximum(wanted, self.low))
        value += float(np.sum(np.where(fixed, tensions * lengths, 0.5 * soft * tensions**2)))
        moved = np.abs(held * (state.tensions - tensions))
        missed = max(missed, float(np.max(np.where(fixed, 0.0, moved), initial=0.0)))
        found = Measure(
            value=value,
            points=points,
            forces=forces,
            tensions=tensions,
            missed=missed,
            body_forces=body,
            normals=normals,
            least_gap=least,
            stiff=stiff,
            slopes=slopes_at,
        )
        if whole:
            if count:
                measure_lengths(part.packed, turns, tensions, lengths, slopes, spare, full)
            else:
                full[:] = 0.0
            taut = ~fixed & (tensions > self.low)
            rows = slopes.reshape(count, 3 * n)
            held = np.where(taut, 1.0 / soft, 0.0)
            self._differentiate(found, turns, moments, (full, rows, held), (blocks, turned))
        return found

    def _rub(self, points: Floats, body: Floats, blocks: Floats) -> float:
        """Add friction to forces and blocks, and return its potential."""
        slip, small = self.slip, self.options.slip
        if slip is None:
            return 0.0
        move = points - slip.before
        move -= slip.normals * np.sum(slip.normals * move, axis=1, keepdims=True)
        size = np.sqrt(np.sum(move**2, axis=1))
        limit = self.options.friction * slip.forces
        sticks = size < small
        long = np.maximum(size, small)
        body -= (limit / long)[:, None] * move
        across = np.eye(3) - slip.normals[:, :, None] * slip.normals[:, None, :]
        way = move / long[:, None]
        turned = across - np.where(sticks, 0.0, 1.0)[:, None, None] * way[:, :, None] * way[:, None]
        blocks += (limit / long)[:, None, None] * turned
        return float(np.sum(limit * np.where(sticks, 0.5 * size**2 / small, size - 0.5 * small)))

    def _differentiate(
        self,
        found: Measure,
        turns: Floats,
        moments: Floats,
        tendons: tuple[Floats, Floats, Floats],
        bodies: tuple[Floats, Floats],
    ) -> None:
        """Fill gradient and Hessian by the turns.

        The Hessian is that of the Lagrangian with the forces that are expected.
        """
        part = self.part
        blocks, more = bodies
        n = len(part.spans)
        rotation = self.base[:3, :3]
        gradient, hessian = np.empty((n, 3)), np.empty((3 * n, 3 * n))
        forces = part.dead_forces + found.body_forces @ rotation
        none, fixed = np.zeros((n, 3)), np.zeros(n, dtype=np.bool_)
        measure_loads(part.packed, turns, part.spots, (forces, none, fixed), gradient, hessian)
        if more.any():
            likely = (forces + more @ rotation, none, fixed)
            measure_loads(part.packed, turns, part.spots, likely, np.empty((n, 3)), hessian)
        # The diagonal: elastic, and the tendons'.
        full, rows, held = tendons
        index = np.arange(n)
        view = hessian.reshape(n, 3, n, 3)
        view[index, :, index, :] += full
        hessian[np.arange(3 * n), np.arange(3 * n)] += part.stiffness.ravel()
        gradient = gradient.ravel() + moments.ravel()
        if len(rows):
            gradient += rows.T @ found.tensions
            hessian += rows.T @ (held[:, None] * rows)
        near = np.flatnonzero(np.abs(blocks).sum(axis=(1, 2)) > 0.0)
        if len(near):
            spots = tuple(np.ascontiguousarray(item[near]) for item in part.spots)
            jacobians = np.empty((len(near), 6, 3 * n))
            places, rotations = np.empty((len(near), 3)), np.empty((len(near), 3, 3))
            place_spots(part.packed, turns, spots, places, rotations, jacobians)
            moves = jacobians[:, 3:]
            local = rotation.T @ blocks[near] @ rotation
            size = 3 * len(near)
            hessian += moves.reshape(size, -1).T @ (local @ moves).reshape(size, -1)
        found.gradient, found.hessian = gradient, hessian


def integrate_force(wanted: Floats, root: Floats, half: Floats) -> Floats:
    """Return the integral of ``(z + sqrt(z^2 + 4 v^2)) / 2`` over ``z``."""
    return np.asarray(
        0.25 * (wanted**2 + wanted * root) + half**2 * np.arcsinh(wanted / (2.0 * half))
    )


@dataclass(eq=False)
class Solution:
    """Where the solver ends: state, its measure, steps, and what is known of stability."""

    state: State
    found: Measure
    steps: int = 0
    moved: float = math.inf
    kicked: bool = False
    stability: float = 0.0
    imbalance: float = math.inf
    rounds: int = 0


def factor(hessian: Floats, stiffness: Floats, start: int = 0) -> tuple[Floats, int]:
    """Return a Cholesky factor of the Hessian, and how often it had to be made more convex."""
    from scipy.linalg.lapack import dpotrf

    diagonal = np.arange(len(hessian))
    for index in range(start, len(SHIFTS)):
        shifted = hessian.copy()
        shifted[diagonal, diagonal] += SHIFTS[index] * stiffness
        lower, info = dpotrf(shifted, lower=1, overwrite_a=1)
        if info == 0:
            return lower, index
    return np.diag(np.sqrt(stiffness * SHIFTS[-1])), len(SHIFTS)


def solve(lower: Floats, vector: Floats) -> Floats:
    """Return the solution of a linear problem from its Cholesky factor."""
    from scipy.linalg.lapack import dpotrs

    return np.asarray(dpotrs(lower, vector, lower=1)[0])


def measure_stability(lower: Floats, stiffness: Floats) -> float:
    """Return the least eigenvalue of the Hessian against the backbone's stiffness."""
    scale = np.sqrt(stiffness)
    # A start that has a part along every shape.
    vector = np.cos(np.arange(len(scale)) ** 1.5)
    value = math.inf
    for _ in range(60):
        vector = scale * solve(lower, scale * vector)
        size, before = float(np.linalg.norm(vector)), value
        vector /= size
        value = 1.0 / size
        if abs(value - before) < 1e-4 * value:
            break
    return value


def minimise(task: Equilibrium, start: State, first: int = 0) -> Solution:
    """Return the stable equilibrium that is reached from a state, by Newton's method."""
    state = start.copy()
    stiffness = task.part.stiffness.ravel()
    stages = task.stages
    index, last = first, len(stages) - 1
    found = task.measure(state, stages[index])
    solution = Solution(state, found)
    longest, stale = float(task.part.radii.min()), 0
    for step in range(1, MOST_STEPS + 1):
        solution.steps = step
        stage = stages[index]
        lower, shift = factor(found.hessian, stiffness)
        move = -solve(lower, found.gradient).reshape(-1, 3)
        moved = measure_move(task, state.turns + move, found.points)
        while moved > FAR * longest and shift < len(SHIFTS) - 1:
            # Almost singular: the quadratic model does not hold so far away.
            lower, shift = factor(found.hessian, stiffness, shift + 1)
            move = -solve(lower, found.gradient).reshape(-1, 3)
            moved = measure_move(task, state.turns + move, found.points)
        if shift > 0 and moved < KICK_MM:
            # Almost stationary, not a minimum: along the way in which the energy falls most.
            move = find_fall(found, stiffness)
            moved = measure_move(task, state.turns + move, found.points)
            solution.kicked = True
        solution.moved = moved
        slope = float(np.sum(move.ravel() * found.gradient))
        share = min(1.0, TURN_LIMIT / max(float(np.abs(move).max()), 1e-300))
        share = min(share, longest / max(moved, 1e-300))
        # Below round-off of the energy only the gradient is of use.
        blind = shift == 0 and -slope < 1e-10 * (abs(found.value) + 1e-9)
        while True:
            tried = dataclasses.replace(state, turns=state.turns + share * move)
            after = task.measure(tried, stage, whole=False)
            if blind or after.value <= found.value + 1e-4 * share * slope or share < 1e-9:
                break
            share *= 0.5
        if share < SHORT and moved > ROUGH_MM and index > 0 and not blind:
            # In a narrow valley that is curved: a softer penalty makes it wider.
            index -= 1
        state = dataclasses.replace(tried, expected=found.expect(after.points - found.points))
        if share == 1.0 and shift == 0 and moved < ROUGH_MM:
            state = dataclasses.replace(state, forces=after.forces, tensions=after.tensions)
            if after.missed < NEAR_MM:
                index = min(index + 1, last)
        found = task.measure(state, stages[index])
        before, solution.imbalance = solution.imbalance, measure_imbalance(task, state, found)
        stale = 0 if solution.imbalance < 0.5 * before else stale + 1
        settled = solution.imbalance < BALANCED or stale >= STALE
        missed = max(found.missed, after.missed)
        if moved < STEP_MM and index == last and settled and missed < task.options.tolerance:
            break
    solution.state, solution.found = state, found
    lower, shift = factor(found.hessian, stiffness)
    solution.stability = measure_stability(lower, stiffness) if shift == 0 else -SHIFTS[shift - 1]
    return solution


def measure_move(task: Equilibrium, turns: Floats, points: Floats) -> float:
    """Return the largest way of a point to where other turns have it [mm]; infinite if far off."""
    if not np.abs(turns).max() < math.pi:
        return math.inf
    return float(np.sqrt(np.max(np.sum((task.locate(turns) - points) ** 2, axis=1))))


def find_fall(found: Measure, stiffness: Floats) -> Floats:
    """Return turns (n, 3) along which the energy is most concave, downwards."""
    scale = 1.0 / np.sqrt(stiffness)
    _, ways = np.linalg.eigh(scale[:, None] * found.hessian * scale)
    way = scale * ways[:, 0]
    way *= KICK_RAD / np.abs(way).max()
    return np.asarray((-way if way @ found.gradient > 0.0 else way).reshape(-1, 3))


def measure_imbalance(task: Equilibrium, state: State, found: Measure) -> float:
    """Return the moment by which a segment is out of balance, against those that act."""
    stiffness, start = task.part.stiffness, task.base[:3, 3]
    forces = np.concatenate([found.body_forces, task.part.dead_forces])
    arms = np.concatenate([found.points, found.points]) - start
    acting = float(np.sum(np.linalg.norm(forces, axis=1) * np.linalg.norm(arms, axis=1)))
    largest = max(float(np.abs(stiffness * state.turns).max()), acting)
    return float(np.abs(found.gradient).max()) / max(largest, 1e-6 * float(stiffness.max()))


def settle(task: Equilibrium, start: State, before: Floats | None, first: int) -> Solution:
    """Return the equilibrium from a state, after the normal forces of friction have settled."""
    if task.options.friction == 0.0 or before is None:
        return minimise(task, start, first)
    solution = minimise(task, start, first)
    steps = solution.steps
    for round_ in range(FRICTION_ROUNDS):
        normals = solution.found.normals
        size = np.sqrt(np.sum(normals**2, axis=1))
        slip = Slip(before, normals / np.maximum(size, 1e-300)[:, None], size)
        solution = minimise(dataclasses.replace(task, slip=slip), solution.state, WARM)
        steps += solution.steps
        solution.steps, solution.rounds = steps, round_ + 1
        change = np.abs(np.sqrt(np.sum(solution.found.normals**2, axis=1)) - size)
        if change.max() <= FRICTION_SHARE * max(float(size.max()), 1e-9):
            return solution
    solution.rounds = FRICTION_ROUNDS + 1
    return solution


# The model: a robot, its walls, and what they do to each other.


@dataclass(frozen=True, kw_only=True, eq=False)
class ContactShape(Result):
    """Shape of a robot among walls, in the world, and the forces between them.

    ``k`` counts the stations along the backbone from base to tip, ``t`` tendons.

    Attributes
    ----------
    robot : RobotDesign
        The robot.
    arc_length : (k,) ndarray
        Stations [mm].
    points, tangents : (k, 3) ndarray
        Backbone in the world [mm], and its direction.
    inserted : float
        Length of the robot that is not in an introducer [mm].
    displacements, tensions : (t,) ndarray
        Of the tendons [mm], [N].
    gaps : (k,) ndarray
        Distance between body and nearest wall [mm], as smoothed; infinite where it is far.
    normal_forces : (k,) ndarray
        Size of the wall's force across it [N]: a station has that of the body half-way to its
        neighbours.
    forces : (k, 3) ndarray
        Force of the walls on the body, friction included [N], world.
    loads : (3,) ndarray
        Sum of loads and weight on the part that is not in the introducer [N], world.
    base_force, base_moment : (3,) ndarray
        What holds the base, or the body where it leaves the introducer [N], [N mm], world.
    push_force : float
        Force that pushes the robot in [N]: how the least energy changes with the inserted length,
        with what friction takes. It is less than `base_force` along the axis by the energy that
        bends the body where it leaves the introducer.
    energy : float
        Elastic energy of the backbone [N mm].
    stability : float
        Least eigenvalue of the second variation, where bodies in contact keep it, against the
        stiffness of the straight rod.
    stable : bool
        Whether it is positive.
    left_unstable : bool
        Whether the shape that went before it lost its stability on the way to this one.
    self_distance : float
        Least distance between parts of the body that are not neighbours, less both radii [mm];
        infinite where none could meet.
    self_places : (2,) ndarray
        Arc lengths of these [mm].
    iterations : int
        Steps of Newton's method.
    residual : float
        How deep the body is in a wall beyond what its compliance allows, or how far a tendon's
        length is missed [mm].
    imbalance : float
        Moment by which a segment is out of balance, against the largest.
    converged : bool
    reason : str
    """

    robot: RobotDesign = field(repr=False)
    arc_length: Floats = measured("mm")
    points: Floats = measured("mm")
    tangents: Floats = field()
    inserted: float = measured("mm")
    displacements: Floats = measured("mm")
    tensions: Floats = measured("N")
    gaps: Floats = measured("mm")
    normal_forces: Floats = measured("N")
    forces: Floats = measured("N")
    loads: Floats = measured("N")
    base_force: Floats = measured("N")
    base_moment: Floats = measured("N mm")
    push_force: float = measured("N")
    energy: float = measured("N mm")
    stability: float = 0.0
    left_unstable: bool = False
    self_distance: float = measured("mm")
    self_places: Floats = measured("mm")
    iterations: int = 0
    residual: float = measured("mm")
    imbalance: float = 0.0
    converged: bool = True
    reason: str = ""
    state: State = field(repr=False)
    part: FreePart = field(repr=False)
    walls: tuple[Boundary, ...] = field(repr=False)

    @property
    def stable(self) -> bool:
        """Whether the energy is least among neighbouring shapes."""
        return self.stability > 0.0

    @property
    def tip(self) -> Floats:
        """Where the robot ends, (3,) [mm]."""
        return np.asarray(self.points[-1])

    @property
    def resultant(self) -> Floats:
        """Sum of the walls' forces on the body, (3,) [N]."""
        return np.asarray(self.forces.sum(axis=0))

    def to_dict(self) -> Json:
        """Return the shape as plain values; units are in the names."""
        plain = {"tip_mm": self.tip, "resultant_N": self.resultant, "stable": self.stable}
        touching = np.flatnonzero(self.normal_forces > 0.0)
        contacts = [
            {
                "arc_length_mm": self.arc_length[k],
                "place_mm": self.points[k],
                "normal_force_N": self.normal_forces[k],
                "force_N": self.forces[k],
            }
            for k in touching
        ]
        return {**super().to_dict(), **to_plain({**plain, "contacts": contacts})}

    def list_columns(self) -> Mapping[str, NDArray[np.generic]]:
        """Return the columns of `to_frame`: a row for each station."""
        columns: dict[str, NDArray[np.generic]] = {"arc_length_mm": self.arc_length}
        columns |= {f"{axis}_mm": self.points[:, k] for k, axis in enumerate("xyz")}
        columns |= {"gap_mm": self.gaps, "normal_force_N": self.normal_forces}
        return columns | {f"force_{axis}_N": self.forces[:, k] for k, axis in enumerate("xyz")}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw body, walls and forces in the plane that the body fills most; return the axes."""
        return draw_shapes((self,), ax)


def draw_shapes(shapes: Sequence[ContactShape], ax: Axes | None) -> Axes:
    """Draw shapes of one robot with the walls around, and the forces on the last one."""
    last = shapes[-1]
    points = np.concatenate([shape.points for shape in shapes])
    middle = points.mean(axis=0)
    if all(wall.duct.dim == 2 for wall in last.walls):
        view = np.eye(3)[:2]
    else:
        view = np.linalg.svd(points - middle, full_matrices=False)[2][:2]
    axes = take_axes(ax, x="along [mm]", y="across [mm]", equal=True)
    flat = (points - middle) @ view.T
    space = 0.1 * float(np.ptp(flat, axis=0).max()) + 3.0 * last.robot.radius
    low, high = flat.min(axis=0) - space, flat.max(axis=0) + space
    grid = np.meshgrid(*(np.linspace(a, b, 160) for a, b in zip(low, high, strict=True)))
    nodes = middle + np.stack(grid, axis=-1) @ view
    for wall in last.walls:
        distance = wall.duct.signed_distance(nodes[..., : wall.duct.dim])
        axes.contour(*grid, distance, levels=[0.0], colors="0.4", linewidths=1.2)
    for shape in shapes:
        line = (shape.points - middle) @ view.T
        shade = "0.75" if shape is not last else "black"
        axes.plot(*line.T, color=shade, linewidth=2.0 if shape is last else 0.8)
    largest = float(last.normal_forces.max(initial=0.0))
    if largest > 0.0:
        on = last.normal_forces > 0.0
        place = (last.points[on] - middle) @ view.T
        force = last.forces[on] @ view.T / largest * 0.15 * float((high - low).max())
        axes.quiver(
            *place.T, *force.T, angles="xy", scale_units="xy", scale=1.0, color="C3", width=0.004,
            label=f"force of the wall, up to {largest:.3g} N",
        )  # fmt: skip
        axes.legend(loc="best", fontsize=8)
    return axes


class Command(NamedTuple):
    """What is asked of a robot: displacements, tensions of those that follow, length, and loads."""

    displacements: Floats
    tensions: Floats
    inserted: float
    share: float = 1.0

    def take_part(self, share: float, inserted: float) -> Command:
        """Return a part of the displacements, tensions and loads."""
        if share == 0.0:
            return Command(np.full_like(self.tensions, np.nan), 0.0 * self.tensions, inserted, 0.0)
        return Command(share * self.displacements, share * self.tensions, inserted, share)


@dataclass(frozen=True, eq=False)
class ContactModel:
    """A tendon robot that touches walls: the shape of least energy outside them.

    The rod is cut into arcs with tendons in smooth channels (as `EnergyModel`'s ``"channel"``), and
    takes the least elastic energy, less the work of the loads, for which no tendon is longer than
    commanded and no ball of the body's radius about a station is beyond a wall. The forces of
    walls and tendons are the multipliers. An augmented Lagrangian is minimised by Newton's method
    with exact second derivatives, so that a shape that is found is a minimum: stable.

    Parameters
    ----------
    robot : RobotDesign
        The robot, its base where it stands in the world.
    duct : Duct, optional
        Lumen that the robot is in; any `bozzini.duct.Duct`, planar ones hold for all z.
    obstacles : sequence of Duct
        Bodies that it is outside of.
    loads : sequence of PointLoad or LineLoad
        Forces that keep their direction; weight is taken from the robot.
    options : ContactOptions
        Compliance and friction of the wall, segments.

    Raises
    ------
    InputError
        If there is no wall, or a load is a moment or turns with the body.

    Notes
    -----
    Distances are those of the duct: exact where its `kind` is, else with its stated error. They are
    made smooth on a lattice (`ContactOptions.smoothing`), which moves the wall by about the square
    of that over six times its radius of curvature. Friction acts on the motion since `initial`,
    with the normal forces settled in rounds.
    """

    robot: RobotDesign
    duct: Wall | None = None
    obstacles: tuple[Wall, ...] = field(default=(), kw_only=True)
    loads: tuple[Load, ...] = field(default=(), kw_only=True)
    options: ContactOptions = field(default_factory=ContactOptions, kw_only=True)

    def __post_init__(self) -> None:
        check_kind("robot", self.robot, RobotDesign)
        check_kind("options", self.options, ContactOptions)
        packed = self._packed
        if np.any(packed.moments) or BODY in packed.frames or BODY in packed.line_frames:
            raise InputError(
                "loads hold a moment or a force that turns with the body: contact takes forces "
                "that keep their direction"
            )
        _ = self.walls

    @cached_property
    def walls(self) -> tuple[Boundary, ...]:
        """The lumen and the obstacles."""
        found = take_boundaries(self.duct, self.obstacles)
        return tuple(dataclasses.replace(wall, smoothing=self.options.smoothing) for wall in found)

    @cached_property
    def _packed(self) -> PackedLoads:
        return pack_loads(self.robot, self.loads)

    @cached_property
    def stations(self) -> Floats:
        """Stations of the whole robot: ends of the segments [mm], shape (k,)."""
        return place_stations(self.robot, self.options.segment_length)

    def shape(
        self,
        displacements: ArrayLike | Mapping[str, ArrayLike] = (),
        *,
        inserted: float | None = None,
        initial: ContactShape | None = None,
    ) -> ContactShape:
        """Return the shape under tendon displacements.

        Parameters
        ----------
        displacements : array_like (t,) or mapping
            How far each tendon is pulled [mm]; NaN for one that follows without tension. All
            follow unless given.
        inserted : float, optional
            Length of the robot beyond an introducer that ends at its base frame [mm]; the rest
            is straight behind it. All of it unless given.
        initial : ContactShape, optional
            The shape before: where the solver starts, and what friction remembers.

        Raises
        ------
        InputError
            If the displacements or the length are not legal.
        """
        commands = self._take(displacements)
        return self._follow(commands, np.zeros(len(commands)), inserted, initial)

    def shape_under_tensions(
        self,
        tensions: ArrayLike | Mapping[str, ArrayLike],
        *,
        inserted: float | None = None,
        initial: ContactShape | None = None,
    ) -> ContactShape:
        """Return the shape under tendon tensions (t,) [N]; the others as of `shape`."""
        forces = self._take(tensions, unset=0.0)
        if np.any(forces < 0.0):
            raise InputError(f"tensions hold {forces.min():g} N: they must be at least 0 N")
        return self._follow(np.full(len(forces), np.nan), forces, inserted, initial)

    def _take(self, given: object, unset: float = math.nan) -> Floats:
        names = self.robot.tendon_names
        if isinstance(given, Mapping):
            known = {name: float(value) for name, value in given.items()}
            self.robot.order_displacements({k: v for k, v in known.items() if not math.isnan(v)})
            return np.array([known.get(name, unset) for name in names])
        if isinstance(given, tuple) and not given:
            return np.full(len(names), unset)
        array = np.array(check_array("displacements", given))  # type: ignore[arg-type]
        if array.shape != (len(names),) or np.isinf(array).any():
            raise InputError(
                f"displacements have shape {array.shape}: they must be ({len(names)},), finite"
            )
        return array

    def _follow(
        self,
        commands: Floats,
        tensions: Floats,
        inserted: float | None,
        initial: ContactShape | None,
    ) -> ContactShape:
        """Return the shape under commands: at once, or else from a robot at rest, in parts."""
        length = self.robot.length if inserted is None else float(inserted)
        if not 0.0 < length <= self.robot.length * (1.0 + 1e-12):
            raise InputError(
                f"inserted is {length:g} mm: it must lie in (0, {self.robot.length:g}] mm, the "
                "robot's length"
            )
        command = Command(commands, tensions, length)
        shape = self._solve(command, initial)
        if shape.converged or initial is not None or shape.self_distance < 0.0:
            return shape
        for piece in np.linspace(0.0, length, math.ceil(length / PIECE / self.longest) + 1)[1:]:
            before = self._solve(command.take_part(0.0, float(piece)), initial)
            if not before.converged:
                return before
            initial = before
        reached, part = 0.0, FIRST_PART
        while reached < 1.0:
            share = min(1.0, reached + part)
            shape = self._solve(command.take_part(share, length), initial)
            if shape.converged:
                reached, initial = share, shape
            elif part <= LEAST_PART:
                words = f"at {100.0 * share:.3g} % of loads and displacements, {shape.reason}"
                return dataclasses.replace(shape, reason=words)
            else:
                part *= 0.5
        return shape

    @cached_property
    def longest(self) -> float:
        """Length of the longest segment [mm]."""
        return float(np.diff(self.stations).max())

    def _solve(self, command: Command, initial: ContactShape | None) -> ContactShape:
        robot = self.robot
        part = FreePart(
            robot,
            self.stations,
            max(robot.length - command.inserted, 0.0),
            self._packed,
            command.share,
        )
        count, n = len(robot.tendons), len(part.spans)
        # A tendon that ends in the introducer does nothing.
        limits = np.where(part.packed[4] > 0, part.straight - command.displacements, np.nan)
        task = Equilibrium(
            part,
            self.walls,
            limits,
            np.where(robot.pushes, -np.inf, 0.0),
            robot.rest_lengths / robot.tendon_stiffness if count else np.zeros(0),
            self.options,
        )
        before = None
        if initial is None:
            none = np.zeros((len(self.walls), n))
            start = State(part.rest, none, np.zeros(count), none)
        else:
            start = carry_state(initial, part)
            before = place_before(initial, part)
        pulled = np.where(part.packed[4] > 0, command.tensions, 0.0)
        start.tensions = np.where(np.isnan(limits), pulled, start.tensions)
        solution = settle(task, start, before, WARM if initial is not None else 0)
        return self._describe(task, solution, command.displacements)

    def _describe(self, task: Equilibrium, solution: Solution, commands: Floats) -> ContactShape:
        part, found, base = task.part, solution.found, task.base
        robot = self.robot
        straight = self.stations[self.stations < part.arc_length[1] - ROUND_OFF_MM]
        places = np.concatenate([straight, part.arc_length[1:]])
        k = len(straight)
        points, tangents = np.empty((len(places), 3)), np.empty((len(places), 3))
        points[:k] = base[:3, 3] + (straight - part.cut)[:, None] * base[:3, 2]
        tangents[:k] = base[:3, 2]
        n = len(part.spans)
        rotations, spare = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
        fill_frames(part.packed, solution.state.turns, rotations, spare)
        points[k:], tangents[k:] = found.points, rotations[1:, :, 2] @ base[:3, :3].T
        forces, normal = np.zeros((len(places), 3)), np.zeros(len(places))
        gaps = np.full(len(places), np.inf)
        normal[k:] = np.sqrt(np.sum(found.normals**2, axis=1))
        normal[normal < UNFELT * normal.max()] = 0.0
        forces[k:] = np.where(normal[k:, None] > 0.0, found.body_forces, 0.0)
        gaps[k:] = found.least_gap
        dead = part.dead_forces @ base[:3, :3].T
        arms = found.points - base[:3, 3]
        bent = solution.state.turns - part.rest
        distance, pair = find_self_contact(robot, places, points)
        converged, reason = judge(task, solution)
        if converged and distance < 0.0:
            converged = False
            reason = (
                f"the body meets itself: at {pair[0]:.4g} and {pair[1]:.4g} mm it is "
                f"{-distance:.3g} mm too near"
            )
        return ContactShape(
            robot=robot,
            arc_length=places,
            points=points,
            tangents=tangents,
            inserted=robot.length - part.cut,
            displacements=commands,
            tensions=found.tensions,
            gaps=gaps,
            normal_forces=normal,
            forces=forces,
            loads=dead.sum(axis=0),
            base_force=-(dead + forces[k:]).sum(axis=0),
            base_moment=-np.cross(arms, dead + forces[k:]).sum(axis=0),
            push_force=measure_push(task, solution),
            energy=0.5 * float(np.sum(part.stiffness * bent**2)),
            stability=solution.stability,
            left_unstable=solution.kicked,
            self_distance=distance,
            self_places=pair,
            iterations=solution.steps,
            residual=found.missed,
            imbalance=solution.imbalance,
            converged=converged,
            reason=reason,
            state=solution.state,
            part=part,
            walls=self.walls,
        )


def judge(task: Equilibrium, solution: Solution) -> tuple[bool, str]:
    """Return whether a solution is an equilibrium, and else why not."""
    found, part = solution.found, task.part
    if not np.isfinite(found.value):
        return False, "the shape that was found is not finite"
    deep = np.where(np.isfinite(found.least_gap), found.least_gap, 0.0)
    deep = deep + np.where(found.forces.max(axis=0) > 0, task.wall_compliance, 0.0) * np.sqrt(
        np.sum(found.normals**2, axis=1)
    )
    worst = int(np.argmin(deep))
    if found.missed > task.options.tolerance and -deep[worst] > task.options.tolerance:
        return False, (
            f"there is no equilibrium outside the wall: at {part.arc_length[1 + worst]:.4g} mm the "
            f"body, of radius {part.radii[worst]:g} mm, is {-deep[worst]:.3g} mm in it"
        )
    if found.missed > task.options.tolerance:
        return False, f"a tendon misses its command by {found.missed:.3g} mm"
    if solution.moved > math.sqrt(STEP_MM):
        return False, (
            f"no equilibrium in {solution.steps} steps: the last moved the body by "
            f"{solution.moved:.3g} mm"
        )
    if solution.rounds > FRICTION_ROUNDS:
        return False, f"the forces of friction do not settle in {FRICTION_ROUNDS} rounds"
    if solution.imbalance > WRONG:
        return False, f"a segment is out of balance by a share of {solution.imbalance:.2g}"
    if solution.stability <= 0.0:
        return False, "unstable: the shape that was found buckles"
    return True, ""


def measure_push(task: Equilibrium, solution: Solution) -> float:
    """Return how the least energy changes with the inserted length [N]: multipliers stay."""
    part = task.part
    step = 1e-4 * float(part.spans[0])
    forces = part.dead_forces + solution.found.body_forces @ task.base[:3, :3]
    values = []
    for cut in (part.cut - step, part.cut + step):
        other = FreePart(part.robot, part.arc_length, part.cut, part.loads, part.share)
        places = part.arc_length.copy()
        places[0] = cut
        other.__dict__.update(first=1, arc_length=places)
        bent = solution.state.turns - other.rest
        value = 0.5 * float(np.sum(other.stiffness * bent**2))
        n, count = len(part.spans), len(task.limits)
        rotations, points = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
        fill_frames(other.packed, solution.state.turns, rotations, points)
        value -= float(np.sum(forces * points[1:]))
        if count:
            lengths, slopes = np.empty(count), np.empty((count, n, 3))
            full, spare = np.empty((2, n, 3, 3))
            tensions = solution.found.tensions
            measure_lengths(
                other.packed, solution.state.turns, tensions, lengths, slopes, spare, full
            )
            value += float(np.sum(tensions * (lengths - other.straight)))
        values.append(value)
    return (values[0] - values[1]) / (2.0 * step)


def carry_state(initial: ContactShape, part: FreePart) -> State:
    """Return where to start from: curvatures and forces at the same distances from the base."""
    old, state = initial.part, initial.state
    if np.array_equal(old.arc_length, part.arc_length):
        return state.copy()
    here, there = part.middles - part.cut, old.middles - old.cut
    curvature = (state.turns - old.rest) / old.spans[:, None]
    turns = np.stack([np.interp(here, there, row) for row in curvature.T], axis=1)
    ends, before = part.arc_length[1:] - part.cut, old.arc_length[1:] - old.cut
    density = state.forces / old.shares
    forces = np.stack([np.interp(ends, before, row) for row in density]) * part.shares
    return State(turns * part.spans[:, None] + part.rest, forces, state.tensions, forces)


def place_before(initial: ContactShape, part: FreePart) -> Floats:
    """Return where the points of a part were in a shape before, (n, 3) [mm]."""
    return np.stack(
        [np.interp(part.arc_length[1:], initial.arc_length, row) for row in initial.points.T],
        axis=1,
    )


def find_self_contact(robot: RobotDesign, places: Floats, points: Floats) -> tuple[float, Floats]:
    """Return the least distance of parts of the body less both radii [mm], and their places.

    Parts count that are more than half a turn of the tightest bend apart, whose discs would meet.
    """
    radii = np.array([section.radius for section in robot.sections])[robot.section_at(places)]
    apart = np.sqrt(np.sum((points[:, None] - points[None]) ** 2, axis=-1))
    apart -= radii[:, None] + radii[None]
    near = np.abs(places[:, None] - places[None]) < math.pi * (radii[:, None] + radii[None])
    apart[near] = np.inf
    index = np.unravel_index(int(np.argmin(apart)), apart.shape)
    return float(apart[index]), places[list(index)]
