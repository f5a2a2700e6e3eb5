"""The model for any routing: a discrete rod of least elastic energy under the tendons' lengths."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import quantity
from ..errors import GeometryError
from .checks import Floats
from .coupling import check_displacements
from .kernels import energy as kernels
from .kernels.energy import ARC, CHANNEL, CHORD, CONVERGED, FOLDED, measure_lengths, solve_commands
from .model import (
    BendMeasure,
    ContinuumModel,
    check_limits,
    check_numbers,
    choose_stiffness,
    explain_contrast,
)
from .profile import ROUND_OFF_MM
from .robot import RobotDesign
from .section import LEAST_LEVER
from .shape import Shape

# A robot cut into segments, as the energy model's kernels take it.

Segment = Literal["chord", "arc", "channel"]
"""What a segment of the energy model is."""

SEGMENTS: dict[Segment, int] = {"chord": CHORD, "arc": ARC, "channel": CHANNEL}


def place_stations(robot: RobotDesign, between: int, *, corners: bool = False) -> Floats:
    """Return base, discs, points `between` and tendon ends [mm], and corners of routings."""
    places = robot.stations(between=between)
    others = list(robot.tendon_ends)
    if corners:
        others += [place for tendon in robot.tendons for place in tendon.corners()]
    for other in others:
        if np.abs(places - other).min() > ROUND_OFF_MM:
            places = np.append(places, other)
    return np.sort(places)


@dataclass(frozen=True)
class Grid:
    """Segments of a robot between stations, and how its tendons pass them."""

    robot: RobotDesign
    segment: Segment
    between: int

    @cached_property
    def arc_length(self) -> Floats:
        """Stations [mm], shape (n + 1,)."""
        return place_stations(self.robot, self.between, corners=self.segment == "channel")

    @cached_property
    def packed(self) -> tuple[Floats, Floats, Floats, Floats, NDArray[np.int64], int]:
        """What the kernels take as ``grid``."""
        return (
            self.spans,
            self.stiffness,
            self.paths,
            self._guides,
            self.counts,
            SEGMENTS[self.segment],
        )

    @cached_property
    def spans(self) -> Floats:
        """Lengths of the segments [mm], shape (n,)."""
        return np.diff(self.arc_length)

    @cached_property
    def paths(self) -> Floats:
        """Places of the tendons in the cross-sections, shape (t, n + 1, 2); 0 past their ends."""
        paths = np.zeros((len(self.robot.tendons), len(self.arc_length), 2))
        for row, (tendon, end) in enumerate(
            zip(self.robot.tendons, self.robot.tendon_ends, strict=True)
        ):
            places = self.arc_length[self.arc_length <= end + ROUND_OFF_MM]
            paths[row, : len(places)] = tendon.place_at(np.minimum(places, end))
        return paths

    @cached_property
    def reach(self) -> Floats:
        """Distance of the tendons from the backbone [mm], shape (t, n + 1)."""
        return np.asarray(np.sqrt(np.sum(self.paths**2, axis=-1)))

    @cached_property
    def straight(self) -> Floats:
        """Length of each tendon in each segment of the straight robot [mm], shape (t, n)."""
        if self.segment == "channel":
            slopes = np.sqrt(1.0 + np.sum(self._guides[..., 2:] ** 2, axis=-1))
            long = np.asarray(self.spans * (slopes @ kernels.WEIGHTS))
        else:
            steps = np.diff(self.paths, axis=1)
            long = np.sqrt(self.spans**2 + np.sum(steps**2, axis=-1))
        return np.asarray(np.where(self._passed, long, 0.0))

    @cached_property
    def most_pull(self) -> Floats:
        """A bound on what each tendon can be pulled, shape (t,) [mm].

        A straight tendon is no shorter than the backbone's step less its two offsets.
        """
        if self.segment == "channel":
            return np.asarray(self.straight.sum(axis=1))
        # An arc of half a turn is the most bent one.
        step = self.spans if self.segment == "chord" else self.spans * (2.0 / math.pi)
        least = np.maximum(step - self.reach[:, 1:] - self.reach[:, :-1], 0.0)
        return np.asarray(np.maximum(self.straight - least, 0.0).sum(axis=1))

    @cached_property
    def give(self) -> Floats:
        """How much each tendon, alone and almost straight, gives way to tension, (t,) [mm/N].

        If the backbone were as stiff everywhere as where it is stiffest.
        """
        squares = self.reach[:, 1:] ** 2 * self._passed
        return np.asarray(np.sum(squares / self.stiffness[:, :2].max(), axis=1))

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """Segments that each tendon passes, shape (t,)."""
        return np.searchsorted(self.arc_length, self.robot.tendon_ends - ROUND_OFF_MM).astype(
            np.int64
        )

    @cached_property
    def sections(self) -> NDArray[np.int64]:
        """Section of each segment, shape (n,)."""
        return self.robot.section_at(0.5 * (self.arc_length[1:] + self.arc_length[:-1]))

    @cached_property
    def stiffness(self) -> Floats:
        """Moment by turn of each segment about x, y and z [N mm], shape (n, 3)."""
        middles = 0.5 * (self.arc_length[1:] + self.arc_length[:-1])
        return self.robot.stiffness_at(middles)[:, 3:] / self.spans[:, None]

    def place_frames(self, turns: Floats) -> Floats:
        """Frames at the stations, for turns (b, n, 3) of the segments, (b, n + 1, 4, 4)."""
        count, stations = len(turns), len(self.arc_length)
        frames = np.zeros((count, stations, 4, 4))
        frames[:, :, 3, 3] = 1.0
        rotations, points = np.empty((stations, 3, 3)), np.empty((stations, 3))
        for index in range(count):
            kernels.fill_frames(self.packed, turns[index], rotations, points)
            frames[index, :, :3, :3] = rotations
            frames[index, :, :3, 3] = points
        return frames

    def sum_bends(self, turns: Floats) -> Floats:
        """Bend of each section; none unless all tendons are parallel."""
        if not self.robot.is_parallel:
            return np.zeros((len(turns), 0, 2))
        bends = np.zeros((len(turns), len(self.robot.sections), 2))
        for index in range(len(self.robot.sections)):
            total = turns[:, self.sections == index].sum(axis=1)
            bends[:, index] = np.stack([total[:, 1], -total[:, 0]], axis=-1)
        return bends

    def measure_bends(self, turns: Floats) -> tuple[Floats, Floats]:
        """Angle by which each section bends, and its largest curvature, (b, m) [rad], [1/mm]."""
        angles = np.hypot(turns[..., 0], turns[..., 1])
        if self.segment == "chord":
            # As a linkage's: what the tendons see of it.
            angles = 2.0 * np.sin(0.5 * angles)
        count = len(self.robot.sections)
        bends, curvatures = np.zeros((2, len(turns), count))
        for index in range(count):
            own = self.sections == index
            bends[:, index] = angles[:, own].sum(axis=1)
            curvatures[:, index] = (angles[:, own] / self.spans[own]).max(axis=1)
        return bends, curvatures

    @cached_property
    def _passed(self) -> NDArray[np.bool_]:
        return np.asarray(np.arange(len(self.spans)) < self.counts[:, None])

    @cached_property
    def _guides(self) -> Floats:
        """Places and slopes of the tendons at the Gauss points of segments, (t, n, g, 4)."""
        guides = np.zeros((len(self.counts), len(self.spans), len(kernels.POINTS), 4))
        places = self.arc_length[:-1, None] + self.spans[:, None] * kernels.POINTS
        for row, (tendon, count) in enumerate(zip(self.robot.tendons, self.counts, strict=True)):
            guides[row, :count, :, :2] = tendon.place_at(places[:count])
            guides[row, :count, :, 2:] = tendon.slope_at(places[:count])
        return guides


# Whether an equilibrium of the discrete rod is stable.


def is_stable(
    grid: Grid, turns: Floats, tensions: Floats, taut: NDArray[np.bool_], compliances: Floats
) -> bool:
    """Whether the energy is a minimum among the shapes of the same tendon lengths.

    In channels every segment has to be one by itself. `compliances` (t,) are the tendons' [mm/N].
    """
    tendons, segments = len(taut), len(turns)
    slopes = np.empty((tendons, segments, 3))
    positive, whole = np.empty((2, segments, 3, 3))
    measure_lengths(grid.packed, turns, tensions, np.empty(tendons), slopes, positive, whole)
    scale = 1.0 / np.sqrt(grid.stiffness)
    if grid.segment == "channel":
        # In finer and finer segments, one that gives way alone is enough.
        blocks = whole * scale[:, :, None] * scale[:, None, :] + np.eye(3)
        return bool(np.linalg.eigvalsh(blocks).min() > -1e-9)
    hessian = np.zeros((segments, 3, segments, 3))
    index = np.arange(segments)
    hessian[index, :, index, :] = whole * scale[:, :, None] * scale[:, None, :]
    size = 3 * segments
    hessian = hessian.reshape(size, size) + np.eye(size)
    rows = (slopes * scale).reshape(tendons, size)[taut]
    if compliances.any():
        # Lengths are not held, but cost energy.
        hessian += rows.T @ (rows / compliances[taut, None])
        rows = rows[:0]
    _, sizes, ways = np.linalg.svd(rows, full_matrices=True)
    rank = int(np.count_nonzero(sizes > 1e-9 * sizes.max(initial=0.0)))
    free = ways[rank:]
    return bool(np.linalg.eigvalsh(free @ hessian @ free.T).min(initial=1.0) > -1e-9)


UNSTABLE = 4
"""Code, beside those of the kernels, of an equilibrium that is not a minimum."""

MOST_STEPS = 60
"""Steps of Newton's method for one part of a command."""

STRONGEST = 1e4
"""Tension at which a command counts as impossible, against one that turns a segment by 1 rad."""

PUSH_STEP = 0.5
"""Largest turn that tendons ask for at once, where there may be several equilibria [rad]."""

STIFF = 1e-3
"""Flexibility of the tendons that stand in for stiff ones in messages, against the backbone's."""

FEWER = 0.1
"""The same for a second try, by the first."""

ROUND_OFF = 1e-6
"""Share of a limit that is an error of the solver."""


class Answers(NamedTuple):
    """What the kernel fills for b commands: as `solve_commands` has it."""

    turns: Floats
    tensions: Floats
    lengths: Floats
    codes: NDArray[np.int64]
    steps: NDArray[np.int64]
    errors: Floats
    shares: Floats
    suspects: NDArray[np.int64]

    @classmethod
    def make(cls, count: int, segments: int, tendons: int) -> Answers:
        """Return arrays for so many commands, segments and tendons."""
        codes, steps, suspects = np.zeros((3, count), dtype=np.int64)
        errors, shares = np.zeros((2, count))
        tensions, lengths = np.zeros((2, count, tendons))
        turns = np.zeros((count, segments, 3))
        return cls(turns, tensions, lengths, codes, steps, errors, shares, suspects)


@dataclass(frozen=True)
class EnergyModel(ContinuumModel):
    """Discrete rod under tendon displacements, for any routing, without load or friction.

    One rotation vector ``w_j`` for each segment, of length ``h_j``::

        minimise   1/2 sum_j w_j . diag(EI, EI, GJ) w_j / h_j
        such that  sum_j l_kj <= length of cable k,  with equality for rods that push

    The multipliers of the lengths are the tensions: a cable never pushes, and one that is not
    needed goes slack. What is commanded is how much shorter a tendon gets than in the straight
    *discrete* robot. The tendons' lengths depend on the kind of `segment`:

    - ``"chord"``: ``l_kj = | h_j exp(w_j / 2) e_z + exp(w_j) r_k(s_{j+1}) - r_k(s_j) |``, a
      straight link and tendons straight between the discs. For parallel tendons it is the closed
      form of the linkage model, and its generalisation of the thesis's (5.11).
    - ``"arc"``: the backbone bends and twists evenly along the segment, its length kept; tendons
      straight between the discs. What a robot with few discs on an elastic rod does. Tendons
      on both sides of a bend are then a little shorter than constant curvature has them.
    - ``"channel"``: the same backbone, tendons in smooth channels. For parallel tendons it is the
      constant curvature of the arc model. With cables only, or parallel tendons, the problem is
      convex: its shape is the only one.

    In the limit of fine segments all are a Kirchhoff rod with frictionless tendons (Rucker and
    Webster 2011), with an error of second order. Redundant tendons share the load with the least
    sum of squared tensions.

    Chords, arcs, and rods that push on other than parallel routings may have several equilibria.
    The one that is reached from the straight rod is taken, in steps where rods push; where it
    ceases to be one, another may be, or the reason states how far it went. It is checked to be
    stable: among shapes of the same tendon lengths, and in channels in each segment by itself.

    A shape beyond a tendon's travel or a section's `max_bend`, or so curved that discs meet, has
    not converged. A section's bend is here the integral of its curvature. Stiffnesses of the
    backbone may differ by a factor of 1e6.

    Parameters
    ----------
    robot : RobotDesign
        The robot; its sections' EI and GJ matter here.
    between : int
        Further cross-sections that guide the tendons, evenly between two discs.
    segment : {"chord", "arc", "channel"}
        What a segment is, see above.
    tendon_stiffness : float
        EA of the tendons that have none of their own [N]; infinite unless given. With it, tendons
        that would contradict each other stretch instead.
    tolerance : float
        Displacement by which a command may miss being consistent [mm], in (0, 1].

    Raises
    ------
    InputError
        If an option is outside its legal range.
    GeometryError
        If the robot has no tendons.
    """

    between: int = quantity(
        help="Further cross-sections between two discs.",
        low=0,
        high=1000,
        whole=True,
        default=0,
        kw_only=True,
    )
    segment: Segment = quantity(
        "text",
        "Straight links, arcs, or arcs with tendons in smooth channels.",
        words=get_args(Segment),
        default="chord",
        kw_only=True,
        option="segment_kind",
    )
    tendon_stiffness: float = quantity(
        "force",
        "EA of tendons without one of their own (default: they do not stretch).",
        low=0.0,
        low_open=True,
        default=math.inf,
        kw_only=True,
    )

    name = "energy"
    heeds = frozenset({"stiffness of tendons", "tension limits"})

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.robot.tendons:
            raise GeometryError(f"robot '{self.robot.name}' has no tendons: nothing can move it")

    @property
    def arc_length(self) -> Floats:
        """Stations: base, discs, tendon ends and points between [mm], shape (n + 1,)."""
        return self._grid.arc_length

    @cached_property
    def natural_lengths(self) -> Floats:
        """Length of each tendon in the straight discrete robot [mm], shape (t,)."""
        return np.asarray(np.sum(self._grid.straight, axis=1))

    def shape(self, displacements: ArrayLike) -> Shape:
        """Return the shapes under tendon displacements; see `ContinuumModel.shape`.

        One that has not converged is the shape as far as the command can be followed, and the
        reason states how far that is and which tendon stops it.
        """
        commands = check_displacements(self.robot, displacements)
        flat = np.ascontiguousarray(commands.reshape(-1, commands.shape[-1]))
        found = self._solve(flat)
        frames = self._grid.place_frames(found.turns)
        followed = self.natural_lengths - found.shares[:, None] * flat
        slack = ~self.robot.pushes & (found.lengths < followed - self.tolerance)
        for index in np.flatnonzero((found.codes == CONVERGED) & (found.suspects > 0)):
            turns, tensions = found.turns[index], found.tensions[index]
            if not is_stable(self._grid, turns, tensions, ~slack[index], self._compliances):
                found.codes[index] = UNSTABLE
        converged = found.codes == CONVERGED
        words = np.full(len(flat), "", dtype=object)
        missed = found.lengths - (self.natural_lengths - flat) - self._compliances * found.tensions
        missed[slack] = 0.0
        for index in np.flatnonzero(~converged):
            code, share = int(found.codes[index]), float(found.shares[index])
            words[index] = self._explain(flat[index], code, share)
        residual = np.abs(missed).max(axis=1)
        verdict = check_numbers(self, frames, residual, (converged, words.astype(np.str_)))
        bends, curvatures = self._grid.measure_bends(found.turns)
        measure = BendMeasure(bends=bends, curvatures=curvatures, round_off=ROUND_OFF)
        return self.make_shape(
            commands,
            arc_length=self.arc_length,
            frames=frames,
            tendon_lengths=found.lengths,
            section_parameters=self._grid.sum_bends(found.turns),
            tensions=found.tensions,
            slack=slack,
            residual=residual,
            iterations=found.steps,
            verdict=check_limits(self.robot, flat, measure, verdict),
        )

    @cached_property
    def _grid(self) -> Grid:
        return Grid(self.robot, self.segment, self.between)

    @cached_property
    def _compliances(self) -> Floats:
        return self.natural_lengths / choose_stiffness(self.robot, self.tendon_stiffness)

    def _solve(self, commands: Floats, *, compliances: Floats | None = None) -> Answers:
        found = Answers.make(len(commands), len(self._grid.spans), len(self.robot.pushes))
        strongest = STRONGEST * self._grid.stiffness.max() / self._grid.reach.max(axis=1).min()
        rod = (
            self._grid.packed,
            self._compliances if compliances is None else compliances,
            np.where(self.robot.pushes, -strongest, 0.0),
            np.full(len(self.robot.pushes), strongest),
            MOST_STEPS,
        )
        firsts = self._first_parts(commands)
        solve_commands(rod, self.natural_lengths, commands, firsts, self.tolerance, tuple(found))
        return found

    def _first_parts(self, commands: Floats) -> Floats:
        """Part of each command that is tried at once: little where that may end elsewhere."""
        if not self.robot.pushes.any() or self.robot.is_parallel:  # there is one equilibrium
            return np.ones(len(commands))
        reach = self._grid.reach.copy()
        reach[reach == 0.0] = math.inf  # past a tendon's end
        levers = np.maximum(reach.min(axis=1), LEAST_LEVER * self._grid.reach.max(axis=1))
        turns = np.max(np.abs(commands) / levers, axis=1)
        return np.asarray(PUSH_STEP / np.maximum(turns, PUSH_STEP))

    def _explain(self, command: Floats, code: int, share: float) -> str:
        names = self.robot.tendon_names
        most = self._grid.most_pull
        over = command - most
        worst = int(np.argmax(over))
        if over[worst] > 0.0 and self.tendon_stiffness == math.inf:
            return (
                f"tendon '{names[worst]}' is pulled {command[worst]:.4g} mm, but its "
                f"{self._grid.counts[worst]} segments cannot make it shorter by more than "
                f"{most[worst]:.4g} mm: pull less, or take more discs"
            )
        if code == UNSTABLE:
            return (
                "the equilibrium that was found is not stable: the robot snaps away from it; "
                "pull less, or take a stiffer backbone"
            )
        followed = f"the command can be followed to {math.floor(100.0 * share)} % only: "
        stretches = self._measure_stretches(command)
        if stretches.size == 0:
            what = "a segment folds over" if code == FOLDED else "no equilibrium was found"
            worst = int(np.argmax(command if command.max() > 0.0 else -command))
            left = (1.0 - share) * command[worst]
            return followed + (
                f"{what} beyond it, with tendon '{names[worst]}' {left:.3g} mm short of its "
                f"{command[worst]:.3g} mm; pull less, or take more discs"
                f"{explain_contrast(self.robot)}"
            )
        worst = int(np.argmax(stretches))
        others = [
            f"'{names[k]}'"
            for k in np.argsort(-stretches)
            if k != worst and stretches[k] > 0.1 * stretches[worst]
        ]
        against = f" against {', '.join(others[:3])}" if others else ""
        return followed + (
            f"tendon '{names[worst]}' would have to stretch by {stretches[worst]:.3g} mm{against}; "
            "pull less, or let out those on the other side"
        )

    def _measure_stretches(self, command: Floats) -> Floats:
        """How much tendons far stiffer than the backbone stretch [mm], (t,); empty if unknown.

        And if it depends on how stiff they are: then it is no contradiction.
        """
        found = []
        for part in (1.0, FEWER):
            compliances = np.maximum(self._compliances, part * STIFF * self._grid.give)
            answer = self._solve(command[None], compliances=compliances)
            if answer.codes[0] != CONVERGED:
                return np.empty(0)
            found.append(np.abs(compliances * answer.tensions[0]))
        first, second = (float(stretches.max()) for stretches in found)
        kept = second > 0.5 * first and second > self.tolerance
        return np.asarray(found[1]) if kept else np.empty(0)
