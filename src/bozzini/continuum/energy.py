"""The model for any routing: a discrete rod of least elastic energy under the tendons' lengths.

`EnergyModel` states the problem. *Unknowns*: the rotation vectors ``w`` (n, 3) of the segments
[rad], base first, about x, y, z of the frame where each begins; beside them the tensions ``T`` (t,)
[N], the multipliers of the lengths. With stiffness ``K_j = diag(EI, EI, GJ) / h_j`` its conditions
are those of `equilibrium`. The base is fixed, the tip free but for its load.

*Without loads* segments know of each other by the tensions alone: `kernels.energy` solves a
quadratic problem in each step of Newton's method, whose dual has t unknowns. *With loads*, or
curved at rest, `equilibrium` follows command and loads from rest with the whole Hessian
(`kernels.equilibrium`), and `continuation` past limit points. *Converged*: the last step rotates no
segment by more than 1e-10 rad, or 1e-6 where steps get no smaller, lengths are right to the
tolerance, and the second variation is positive. Derivatives by tensions, loads, stiffness and
routing follow from the theorem of implicit functions.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_integer, check_word, quantity
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from .continuation import EquilibriumPath, Point, Tracer, Varied
from .elastic import ElasticModel, check_tension_commands, place_stations
from .equilibrium import (
    WHOLE,
    ZERO_MODE,
    Equilibrium,
    LoadedRod,
    LumpedLoads,
    TendonCommand,
    measure_rest,
)
from .gradients import Held, Response
from .kernels import energy as kernels
from .kernels.energy import (
    ARC,
    CHANNEL,
    CHORD,
    CONVERGED,
    FOLDED,
    share_tensions,
    solve_commands,
)
from .kernels.loads import locate_stations
from .model import advise_contradiction, explain_contrast, explain_play
from .profile import ROUND_OFF_MM
from .robot import RobotDesign
from .section import LEAST_LEVER
from .shape import Shape

# A robot cut into segments, as the energy model's kernels take it.

Segment = Literal["chord", "arc", "channel"]
"""What a segment of the energy model is."""

SEGMENTS: dict[Segment, int] = {"chord": CHORD, "arc": ARC, "channel": CHANNEL}


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
    def flexibility(self) -> Floats:
        """Flexibility of each tendon's length, alone and almost straight, (t,) [mm/N].

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
        """Moment by rotation of each segment about x, y and z [N mm/rad], shape (n, 3)."""
        middles = 0.5 * (self.arc_length[1:] + self.arc_length[:-1])
        return self.robot.stiffness_at(middles)[:, 3:] / self.spans[:, None]

    @cached_property
    def rest(self) -> Floats:
        """Rotation vectors of the segments at rest, shape (n, 3) [rad]."""
        middles = 0.5 * (self.arc_length[1:] + self.arc_length[:-1])
        return self.robot.curvature_at(middles) * self.spans[:, None]

    def place_frames(self, rotation_vectors: Floats) -> Floats:
        """Frames at the stations, for rotation vectors (b, n, 3), (b, n + 1, 4, 4)."""
        count, stations = len(rotation_vectors), len(self.arc_length)
        frames = np.zeros((count, stations, 4, 4))
        frames[:, :, 3, 3] = 1.0
        rotations, points = np.empty((stations, 3, 3)), np.empty((stations, 3))
        for index in range(count):
            kernels.fill_frames(self.packed, rotation_vectors[index], rotations, points)
            frames[index, :, :3, :3] = rotations
            frames[index, :, :3, 3] = points
        return frames

    def move_stations(
        self, rotation_vectors: Floats, stations: tuple[NDArray[np.int64], Floats, Floats]
    ) -> Floats:
        """Return rotation and motion of points of the body by rotations (n, 3), (p, 6, 3 n)."""
        count = len(stations[0])
        moved = np.zeros((count, 6, rotation_vectors.size))
        locate_stations(
            self.packed,
            rotation_vectors,
            stations,
            np.empty((count, 3)),
            np.empty((count, 3, 3)),
            moved,
        )
        return moved

    def differentiate_routing(self, rotation_vectors: Floats) -> tuple[Floats, Floats]:
        """Return tendon lengths (t, 2) and their gradients (t, 2, n, 3) by the routing."""
        lengths = np.empty((len(self.counts), 2))
        slopes = np.empty((*lengths.shape, *rotation_vectors.shape))
        kernels.differentiate_routing(self.packed, rotation_vectors, lengths, slopes)
        return lengths, slopes

    def sum_bends(self, rotation_vectors: Floats) -> Floats:
        """Bend of each section; none unless all tendons are parallel."""
        if not self.robot.is_parallel:
            return np.zeros((len(rotation_vectors), 0, 2))
        bends = np.zeros((len(rotation_vectors), len(self.robot.sections), 2))
        for index in range(len(self.robot.sections)):
            total = rotation_vectors[:, self.sections == index].sum(axis=1)
            bends[:, index] = np.stack([total[:, 1], -total[:, 0]], axis=-1)
        return bends

    def measure_bends(self, rotation_vectors: Floats) -> tuple[Floats, Floats]:
        """Angle by which each section bends, and its largest curvature, (b, m) [rad], [1/mm]."""
        angles = np.hypot(rotation_vectors[..., 0], rotation_vectors[..., 1])
        if self.segment == "chord":
            # As a linkage's: what the tendons see of it.
            angles = 2.0 * np.sin(0.5 * angles)
        count = len(self.robot.sections)
        bends, curvatures = np.zeros((2, len(rotation_vectors), count))
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


UNSTABLE = 4
"""Code, beside those of the kernels, of an equilibrium that is not a minimum."""

MOST_STEPS = 60
"""Steps of Newton's method for one part of a command."""

Start = tuple[Floats, Floats]
"""Rotation vectors (n, 3) [rad] and tensions (t,) [N] to begin with."""

STRONGEST = 1e4
"""Tension at which a command counts as impossible, against one that bends a segment by 1 rad."""

PUSH_STEP = 0.5
"""Largest bend that tendons ask for at once, where there may be several equilibria [rad]."""

STIFF = 1e-3
"""Flexibility of the tendons that stand in for stiff ones in messages, against the backbone's."""

FEWER = 0.1
"""The same for a second try, by the first."""


class Answers(NamedTuple):
    """What the kernel fills for b commands: as `solve_commands` has it."""

    rotation_vectors: Floats
    tensions: Floats
    lengths: Floats
    codes: NDArray[np.int64]
    steps: NDArray[np.int64]
    errors: Floats
    load_factors: Floats
    stability: Floats

    @classmethod
    def make(cls, count: int, segments: int, tendons: int) -> Answers:
        """Return arrays for so many commands, segments and tendons."""
        codes, steps = np.zeros((2, count), dtype=np.int64)
        errors, load_factors, stability = np.zeros((3, count))
        tensions, lengths = np.zeros((2, count, tendons))
        rotation_vectors = np.zeros((count, segments, 3))
        return cls(
            rotation_vectors, tensions, lengths, codes, steps, errors, load_factors, stability
        )


def measure_rotation_vectors(frames: Floats) -> Floats:
    """Return the rotation vectors (..., n, 3) between frames (..., n + 1, 4, 4) [rad]."""
    from scipy.spatial.transform import Rotation

    axes = frames[..., :3, :3]
    steps = np.swapaxes(axes[..., :-1, :, :], -1, -2) @ axes[..., 1:, :, :]
    rotation_vectors = Rotation.from_matrix(steps.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(rotation_vectors.reshape(steps.shape[:-1]))


@dataclass(frozen=True)
class EnergyModel(ElasticModel):
    """Discrete rod under tendons and loads, for any routing, without friction.

    One rotation vector ``w_j`` for each segment, of length ``h_j``, and ``u_j`` at rest::

        minimise   1/2 sum_j (w_j - u_j) . diag(EI, EI, GJ) (w_j - u_j) / h_j  -  work of the loads
        such that  sum_j l_kj <= length of cable k,  with equality for rods that push

    The multipliers of the lengths are the tensions: a cable never pushes, and one that is not
    needed goes slack. What is commanded is how much shorter a tendon gets than in the *discrete*
    robot at rest, without loads; or its tension. A tendon whose displacement is NaN follows, with
    its pretension. The tendons' lengths depend on the kind of `segment`:

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

    Under loads, command and loads are raised together from the robot at rest, in steps in which
    shapes follow each other, unless the robot snaps; each is a minimum of the energy, found by
    Newton's method with its exact Hessian. Forces along the robot act at the middles of segments.
    Where a path leads to an equilibrium that is not stable, such as that of a straight robot under
    more than its buckling load, the shape has not converged and the reason states that load.
    Loads that follow the body, and moments, have no energy: what is found is an equilibrium, and
    its stability that against divergence, by the least real part of the tangent's eigenvalues.
    `Shape.stability` without loads is a lower bound, that of the segments by themselves, unless
    that is negative: the eigenvalue would take two thirds of the time of a shape.

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
        by_name=True,
    )
    segment: Segment = quantity(
        "text",
        "Straight links, arcs, or arcs with tendons in smooth channels.",
        words=get_args(Segment),
        default="chord",
        kw_only=True,
        option="segment_kind",
        by_name=True,
    )
    name = "energy"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.robot.tendons:
            raise GeometryError(f"robot '{self.robot.name}' has no tendons: nothing can move it")
        most = float(np.linalg.norm(self._grid.rest, axis=1).max())
        if most >= math.pi:
            raise InputError(
                f"the curvature at rest turns a segment by {most:.3g} rad: it must be below pi; "
                "take more discs or between="
            )

    @property
    def arc_length(self) -> Floats:
        """Stations: base, discs, tendon ends and points between [mm], shape (n + 1,)."""
        return self._grid.arc_length

    @cached_property
    def natural_lengths(self) -> Floats:
        """Length of each tendon in the discrete robot at rest, without loads [mm], shape (t,)."""
        if self.robot.is_straight:
            return np.asarray(np.sum(self._grid.straight, axis=1))
        return measure_rest(self._grid)

    def _solve(self, commands: Floats, given: Held, initial: Shape | None) -> Shape:
        flat = np.ascontiguousarray(commands.reshape(-1, commands.shape[-1]))
        held = ~np.isnan(flat)
        if given == "tensions" or self._is_loaded or initial is not None or not held.all():
            todo = [self.make_command(row, given) for row in flat]
            return self._shape_loaded(commands, todo, self._take_starts(initial, commands))
        stretched = flat + self._pretension_stretches
        found = self._solve_unloaded(stretched)
        followed = self.natural_lengths - found.load_factors[:, None] * stretched
        slack = ~self.robot.pushes & (found.lengths < followed - self.tolerance)
        stability = found.stability
        for index in np.flatnonzero((found.codes == CONVERGED) & (stability < 0.0)):
            command = self.make_command(flat[index], given)
            stability[index] = self._measure_stability(found, int(index), command)
            if stability[index] < -ZERO_MODE:
                found.codes[index] = UNSTABLE
        residuals = found.lengths - self.natural_lengths + stretched
        residuals -= self._compliances * found.tensions
        residuals[slack] = 0.0
        words = np.full(len(flat), "", dtype=object)
        for index in np.flatnonzero(found.codes != CONVERGED):
            code, load_factor = int(found.codes[index]), float(found.load_factors[index])
            words[index] = self._explain(stretched[index], code, load_factor)
        return self._answer(
            commands,
            words.tolist(),
            bends=self._grid.measure_bends(found.rotation_vectors),
            frames=self._grid.place_frames(found.rotation_vectors),
            tendon_lengths=found.lengths,
            section_parameters=self._grid.sum_bends(found.rotation_vectors),
            tensions=found.tensions,
            slack=slack,
            residual=np.abs(residuals).max(axis=1),
            iterations=found.steps,
            stability=np.where(words == "", np.maximum(stability, 0.0), stability),
        )

    def _shape_loaded(
        self, commands: Floats, todo: Sequence[TendonCommand], starts: Sequence[Start | None]
    ) -> Shape:
        """Shapes of commands (..., t), one by one, under the loads."""
        rod, natural = self.rod, self.natural_lengths
        solved: list[Equilibrium] = []
        stability, words = np.zeros(len(todo)), np.full(len(todo), "", dtype=object)
        for index, (command, start) in enumerate(zip(todo, starts, strict=True)):
            path = rod.follow(command, initial=start)
            last = path[-1]
            if last.found:
                last, stability[index] = rod.settle(command, last)
                if stability[index] < -ZERO_MODE:
                    path = path if start is None else rod.follow(command)
                    load_factor, before = rod.find_buckling(command, path)
                    words[index] = self._explain_unstable(load_factor)
                    if (
                        load_factor == 1.0 and start is None
                    ):  # steps were too long: from just before
                        other, value = rod.settle(command, rod.solve(command, WHOLE, before))
                        if other.found and value >= -ZERO_MODE:
                            last, stability[index], words[index] = other, value, ""
                else:
                    words[index] = self._find_play(command, last)
            else:
                words[index] = self._explain_loaded(command, last)
                stability[index] = rod.measure_stability(command, last)
            solved.append(last)
        rows = len(todo), len(natural)
        rotation_vectors = np.array([found.rotation_vectors for found in solved]).reshape(
            rows[0], *rod.rest.shape
        )
        lengths = np.array([found.lengths for found in solved]).reshape(rows)
        held = np.array([command.held for command in todo], dtype=np.bool_).reshape(rows)
        shared = [self._resolve_redundancy(*pair) for pair in zip(todo, solved, strict=True)]
        tensions = np.array(shared).reshape(rows)
        load_factors = np.array([found.load_factor for found in solved]).reshape(-1, 1)
        free = np.array([command.free_lengths for command in todo]).reshape(rows)
        followed = natural + load_factors * (free - natural)
        idle = np.where(held, lengths < followed - self.tolerance, tensions == 0.0)
        slack = ~self.robot.pushes & idle
        residuals = lengths - free - self._compliances * tensions
        residuals[slack | ~held] = 0.0
        displacements = natural - self._pretension_stretches
        displacements = displacements - np.where(held, free, lengths - self._compliances * tensions)
        return self._answer(
            displacements.reshape(commands.shape),
            words.tolist(),
            bends=self._grid.measure_bends(rotation_vectors),
            frames=self._grid.place_frames(rotation_vectors),
            tendon_lengths=lengths,
            section_parameters=np.zeros((len(todo), 0, 2)),
            tensions=tensions,
            slack=slack,
            residual=np.abs(residuals).max(axis=1),
            iterations=np.array([found.steps for found in solved], dtype=np.int64),
            stability=np.where(words == "", np.maximum(stability, 0.0), stability),
        )

    def trace_path(
        self,
        command: ArrayLike,
        *,
        given: Held = "displacements",
        varied: Varied = "loads",
        factors: tuple[float, float] = (0.0, 1.0),
        initial: Shape | None = None,
        most_points: int = 1000,
    ) -> EquilibriumPath:
        """Return equilibria as loads or command grow, past limit points and unstable ones too.

        Parameters
        ----------
        command : array_like, shape (t,)
            Displacements [mm], NaN where a tendon follows, or tensions [N].
        given : {"displacements", "tensions"}
            Which of them.
        varied : {"loads", "command", "both"}
            What the factor multiplies: all loads, weight included; the command; or both.
        factors : (float, float)
            Where the path begins and where it ends. It begins at the shape that is followed from
            rest, and also ends where it comes back to the first factor.
        initial : Shape, optional
            Where the search of the first shape begins instead.
        most_points : int
            Points after which the path ends, in [2, 100000].

        Raises
        ------
        InputError
            If an input is outside its range.
        GeometryError
            If there is no shape at the first factor.
        """
        check_word("given", given, get_args(Held))
        check_word("varied", varied, get_args(Varied))
        ends = check_array("factors", factors)
        if ends.shape != (2,):
            raise InputError(f"factors has shape {ends.shape}: it must be (2,)")
        low, high = ends.tolist()
        if low == high:
            raise InputError(f"factors are {low:g} and {high:g}: they must differ")
        most = check_integer("most_points", most_points, low=2, high=100_000)
        flat = (
            check_tension_commands(self.robot, command)
            if given == "tensions"
            else self._take_displacements(command)
        )
        if flat.ndim != 1:
            raise InputError(f"command has shape {flat.shape}: it must be ({flat.shape[-1]},)")
        whole = self.make_command(flat, given)
        tracer = Tracer(self.rod, whole, varied, (low, high))
        first = self.rod.start_path(
            whole, tracer.factors(low), initial=self._take_starts(initial, flat)[0]
        )
        if not first.found:
            raise GeometryError(f"at the factor {low:g}: {self._explain_loaded(whole, first)}")
        points, limits, reason = tracer.trace(first, most)
        stability = np.asarray([self.rod.measure_stability(whole, p.found) for p in points])
        stability[np.abs(stability) < ZERO_MODE] = 0.0  # a rotation that costs nothing
        turned = [p.tangent[-1] for p in points]
        branches = [
            index
            for index in range(1, len(points))
            if stability[index] * stability[index - 1] < 0.0
            and turned[index] * turned[index - 1] > 0.0
            and not {index, index - 1} & set(limits)
        ]
        return EquilibriumPath(
            shapes=self._make_path(tracer, points, stability),
            factors=np.asarray([p.factor for p in points]),
            varied=varied,
            energy=np.asarray([self.rod.measure_energy(p.found) for p in points]),
            limit_points=tuple(limits),
            branch_points=tuple(branches),
            reason=reason,
        )

    def _make_path(self, tracer: Tracer, points: list[Point], stability: Floats) -> Shape:
        """Shapes of a path."""
        rotation_vectors = np.stack([point.rotation_vectors for point in points])
        lengths = np.stack([point.found.lengths for point in points])
        tensions = np.stack([point.tensions for point in points])
        held = tracer.command.held
        limits = np.stack([tracer.command.limits(tracer.factors(p.factor)) for p in points])
        asked = np.where(held, limits, lengths - self._compliances * tensions)
        slack = ~self.robot.pushes & (tensions == 0.0) & (lengths < asked - self.tolerance)
        residuals = np.where(slack, 0.0, lengths - asked - self._compliances * tensions)
        residuals[:, ~held] = 0.0
        return self.make_shape(
            self.natural_lengths - asked - self._pretension_stretches,
            arc_length=self.arc_length,
            frames=self._grid.place_frames(rotation_vectors),
            tendon_lengths=lengths,
            section_parameters=np.zeros((len(points), 0, 2)),
            tensions=tensions,
            slack=slack,
            residual=np.abs(residuals).max(axis=1),
            stability=stability,
        )

    def _differentiate(self, shape: Shape, index: tuple[int, ...]) -> Response:
        rotation_vectors, tensions = (
            measure_rotation_vectors(shape.frames[index]),
            shape.tensions[index],
        )
        rod, grid = self.rod, self._grid
        found = rod.measure(WHOLE, rotation_vectors, tensions)
        size, tendons, stations = rotation_vectors.size, len(tensions), len(grid.spans)
        slopes = found.length_gradients.reshape(tendons, size)
        ends = np.arange(stations), np.ones(stations), np.zeros((stations, 3))
        moved = np.concatenate([np.zeros((1, 6, size)), grid.move_stations(rotation_vectors, ends)])
        # Right sides by tensions, a wrench on the tip, stiffnesses, routing, orientation of the
        # base.
        bent = (grid.stiffness * (rotation_vectors - grid.rest))[:, None, None, :]
        own = grid.sections[:, None] == np.arange(len(self.robot.sections))
        kinds = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        stiffer = (own[:, :, None, None] * kinds * bent).transpose(0, 3, 1, 2)
        wound, gradients = grid.differentiate_routing(rotation_vectors)
        routed = (tensions[:, None, None, None] * gradients).reshape(-1, size)
        world = self._world_loads_lumped
        # As the base rotates a load of the world turns back: by its cross product with the axis.
        wrenches = np.concatenate([world.moments, world.forces], axis=1).reshape(-1, 2, 3)
        turned = np.cross(wrenches[..., None, :], np.eye(3)).transpose(2, 0, 1, 3)
        sag = turned.reshape(3, -1) @ grid.move_stations(rotation_vectors, world.places).reshape(
            -1, size
        )
        right = [-slopes.T, moved[-1].T, -stiffer.reshape(size, -1), -routed.T, sag.T]
        solved = np.linalg.solve(found.hessian, np.concatenate(right, axis=1))
        by_all, longer = moved @ solved, slopes @ solved
        first = tendons + 6 + 2 * len(self.robot.sections)
        for k in range(tendons):
            longer[k, first + 2 * k : first + 2 * k + 2] += wound[k]
        return Response(
            by_tension=by_all[..., :tendons],
            by_others=by_all[..., tendons:],
            give=longer[:, :tendons],
            longer=longer[:, tendons:],
            rest=grid.differentiate_routing(grid.rest)[0],
        )

    @cached_property
    def _world_loads_lumped(self) -> LumpedLoads:
        return LumpedLoads.place(self.robot, self.arc_length, self._world_loads)

    @cached_property
    def rod(self) -> LoadedRod:
        """The discrete rod with its loads."""
        return LoadedRod(
            grid=self._grid,
            lumped_loads=LumpedLoads.place(self.robot, self.arc_length, self._packed_loads),
            rest=self._grid.rest,
            compliances=self._compliances,
            pushes=self.robot.pushes,
            tolerance=self.tolerance,
        )

    def make_command(self, command: Floats, given: Held) -> TendonCommand:
        """Return what displacements or tensions (t,), checked, ask of the tendons."""
        pulled = given == "tensions"
        moved = 0.0 if pulled else np.nan_to_num(command) + self._pretension_stretches
        return TendonCommand(
            free_lengths=self.natural_lengths - moved,
            rest_lengths=self.natural_lengths,
            held=np.isfinite(command) & (not pulled),
            pulls=command if pulled else self.robot.pretensions,
        )

    def _take_starts(self, initial: Shape | None, commands: Floats) -> list[Start | None]:
        """Rotation vectors and tensions to begin with, for each command."""
        batch = commands.shape[:-1]
        if initial is None:
            return [None] * math.prod(batch)
        places = self._check_initial(initial, batch)
        if initial.arc_length.shape != self.arc_length.shape:
            raise InputError(
                f"initial has {len(initial.arc_length)} stations: it must be a shape at the "
                f"{len(self.arc_length)} stations of this model"
            )
        rotation_vectors = measure_rotation_vectors(initial.frames)
        return [(rotation_vectors[place], initial.tensions[place]) for place in places]

    def _measure_stability(self, found: Answers, index: int, command: TendonCommand) -> float:
        """Stability of one answer of the unloaded rod."""
        start = found.rotation_vectors[index], found.tensions[index]
        same = self.rod.solve(command, WHOLE, start)
        return self.rod.measure_stability(command, same)

    def _resolve_redundancy(self, command: TendonCommand, found: Equilibrium) -> Floats:
        """Least tensions that hold the rod as it is, where the lengths leave them open."""
        tensions = found.tensions.copy()
        if not found.found or self._compliances.any() or command.held.sum() < 2:
            return tensions
        held = np.where(command.held, tensions, 0.0)
        rotation_vectors = -np.tensordot(held, found.length_gradients, 1) / self._grid.stiffness
        limits = found.lengths - command.free_lengths > -2.0 * self.tolerance
        taut = command.held & (self.robot.pushes | limits)
        strongest = np.full(len(tensions), self._strongest)
        share_tensions(
            self._grid.stiffness,
            self._grid.counts,
            found.length_gradients,
            rotation_vectors,
            taut,
            np.where(self.robot.pushes, -strongest, 0.0),
            strongest,
            held,
        )
        return np.where(command.held, held, tensions)

    @cached_property
    def _grid(self) -> Grid:
        return Grid(self.robot, self.segment, self.between)

    def _solve_unloaded(self, commands: Floats, *, compliances: Floats | None = None) -> Answers:
        found = Answers.make(len(commands), len(self._grid.spans), len(self.robot.pushes))
        strongest = self._strongest
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

    @cached_property
    def _strongest(self) -> float:
        """Tension at which a command counts as impossible [N]."""
        return float(STRONGEST * self._grid.stiffness.max() / self._grid.reach.max(axis=1).min())

    def _first_parts(self, commands: Floats) -> Floats:
        """Part of each command that is tried at once: little where that may end elsewhere."""
        if not self.robot.pushes.any() or self.robot.is_parallel:  # there is one equilibrium
            return np.ones(len(commands))
        rotation_vectors = np.max(np.abs(commands) / self._levers, axis=1)
        return np.asarray(PUSH_STEP / np.maximum(rotation_vectors, PUSH_STEP))

    @cached_property
    def _levers(self) -> Floats:
        """Least distance of each tendon from the backbone [mm], (t,), or a share of its largest."""
        reach = self._grid.reach
        least = np.where(reach == 0.0, math.inf, reach).min(axis=1)  # it is 0 past a tendon's end
        return np.asarray(np.maximum(least, LEAST_LEVER * reach.max(axis=1)))

    def _explain(self, command: Floats, code: int, load_factor: float) -> str:
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
                "unstable: the robot snaps away from the equilibrium that was found; "
                "pull less, or take a stiffer backbone"
            )
        followed = f"the command can be followed to {math.floor(100.0 * load_factor)} % only: "
        stretches = self._measure_stretches(command)
        if stretches.size == 0:
            what = "a segment folds over" if code == FOLDED else "no equilibrium was found"
            worst = int(np.argmax(command if command.max() > 0.0 else -command))
            left = (1.0 - load_factor) * command[worst]
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
            f"pull less, or let out those on the other side; {advise_contradiction(self.tolerance)}"
        )

    def _explain_loaded(self, command: TendonCommand, last: Equilibrium) -> str:
        """Why command and loads could not be followed."""
        if command.held.any():
            asked = np.where(command.held, self.natural_lengths - command.free_lengths, 0.0)
            stretches = self._measure_stretches(asked)
            if stretches.size:
                return self._explain(asked, last.code, last.load_factor)
        percent = math.floor(100.0 * last.load_factor)
        followed = f"the command with its loads can be followed to {percent} %"
        soft = np.maximum(self._compliances, STIFF * self._grid.flexibility)
        rigid = command.held & (self._compliances < FEWER * soft)
        if np.count_nonzero(rigid) > 1:
            if dataclasses.replace(self.rod, compliances=soft).follow(command)[-1].found:
                stiffness = float((self.natural_lengths[rigid] / soft[rigid]).min())
                return (
                    f"{followed} only: tendons that hardly stretch lock the backbone beyond it; "
                    f"give their stiffness, with {stiffness:.1g} N there is an equilibrium, or let "
                    "those on the other side follow"
                )
        what = "a segment folds over" if last.code == FOLDED else "no equilibrium was found"
        return (
            f"{followed} only: {what} beyond it; take smaller loads, or more discs"
            f"{explain_contrast(self.robot)}"
        )

    def _find_play(self, command: TendonCommand, found: Equilibrium) -> str:
        """Why tendons that do not stretch leave the tip open under loads; else nothing."""
        rigid = command.held & (self._compliances == 0.0) & (found.tensions != 0.0)
        if self._packed_loads.is_empty or np.count_nonzero(rigid) < 2:
            return ""
        loose = np.where(command.held, self.tolerance, 0.0)
        looser = dataclasses.replace(command, free_lengths=command.free_lengths + loose)
        other = self.rod.solve(looser, WHOLE, (found.rotation_vectors, found.tensions))
        tips = self._grid.place_frames(np.stack([other.rotation_vectors, found.rotation_vectors]))[
            :, -1, :3, 3
        ]
        play = float(np.linalg.norm(tips[0] - tips[1])) if other.found else math.inf
        lever = float(self._levers.min())
        return explain_play(self.tolerance, play, length=self.robot.length, lever=lever)

    def _explain_unstable(self, load_factor: float) -> str:
        """From which part of the loads on the robot is not stable."""
        force = np.linalg.norm(self.rod.lumped_loads.forces.sum(axis=0))
        loads = f" of the load, {load_factor * force:.3g} N" if force > 0.0 else " of the command"
        return (
            f"unstable: it buckles at {load_factor:.3g}{loads}; the robot snaps away from the "
            "equilibrium that was found"
        )

    def _measure_stretches(self, command: Floats) -> Floats:
        """How much tendons far stiffer than the backbone stretch [mm], (t,); empty if unknown.

        And if it depends on how stiff they are: then it is no contradiction.
        """
        found = []
        for part in (1.0, FEWER):
            compliances = np.maximum(self._compliances, part * STIFF * self._grid.flexibility)
            answer = self._solve_unloaded(command[None], compliances=compliances)
            if answer.codes[0] != CONVERGED:
                return np.empty(0)
            found.append(np.abs(compliances * answer.tensions[0]))
        first, second = (float(stretches.max()) for stretches in found)
        kept = second > 0.5 * first and second > self.tolerance
        return np.asarray(found[1]) if kept else np.empty(0)
