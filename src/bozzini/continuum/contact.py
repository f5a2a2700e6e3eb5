"""An elastic robot against walls: least energy with the body outside the wall of any duct."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array, check_kind, show_apart
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Json, Result, Shown, measured, tabulated, take_axes, to_plain
from .contact_solver import (
    DEEP,
    WARM,
    ContactProblem,
    ContactState,
    FreePart,
    Solution,
    check_solution,
    measure_depth,
    measure_push,
    measure_radii,
    settle_friction,
)
from .elastic import LIMIT_ROUND_OFF, check_pretensions, check_tension_commands
from .energy import FEWER, STIFF
from .equilibrium import LumpedLoads, measure_rest
from .kernels.energy import fill_frames
from .loads import Load, PackedLoads, pack_loads
from .model import BendMeasure, check_limits, check_tensions
from .profile import ROUND_OFF_MM
from .robot import RobotDesign
from .walls import Boundary, Wall, take_boundaries
from .walls import ContactOptions as ContactOptions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SEGMENTS = 60
"""Segments of a robot where their length is not given, and it is not thick."""

MOST_SEGMENTS = 1000
"""Segments of a robot at most: matrices are as large as their square."""

FIRST_PART, LEAST_PART = 0.125, 1.0 / 256.0
"""Parts of loads and displacements that are tried at once, the first and the least."""

PIECE = 2.0
"""Segments that are inserted at once where a robot is brought into a lumen."""


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
    depth : float
        How deep the body is in a wall anywhere, between stations too, by the wall's own distance
        and beyond what its compliance allows [mm]. A shape with more than a tenth of the radius,
        and what the duct's distance may be wrong by, has not converged.
    converged : bool
        Whether it is a stable equilibrium that is in no wall, does not meet itself, and passes no
        limit of its tendons and sections.
    reason : str
    """

    robot: RobotDesign = field(repr=False)
    arc_length: Floats = tabulated("mm")
    points: Floats = tabulated("mm", "{}")
    tangents: Floats = field()
    inserted: float = measured("mm")
    displacements: Floats = measured("mm")
    tensions: Floats = measured("N")
    gaps: Floats = tabulated("mm", "gap")
    normal_forces: Floats = tabulated("N", "normal_force")
    forces: Floats = tabulated("N", "force_{}")
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
    depth: float = measured("mm")
    converged: bool = True
    reason: str = ""
    settled: bool = field(repr=False)
    locked: bool = field(default=False, repr=False)
    state: ContactState = field(repr=False)
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
    space = 0.2 * float(np.ptp(flat, axis=0).max()) + 3.0 * last.robot.radius
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


class ContactCommand(NamedTuple):
    """What is asked of a robot: displacements, tensions of those that follow, length, and loads."""

    displacements: Floats
    tensions: Floats
    inserted: float
    load_factor: float = 1.0

    def take_part(self, load_factor: float, inserted: float) -> ContactCommand:
        """Return a part of the displacements, tensions and loads."""
        if load_factor == 0.0:
            return ContactCommand(
                np.full_like(self.tensions, np.nan), 0.0 * self.tensions, inserted, 0.0
            )
        return ContactCommand(
            load_factor * self.displacements, load_factor * self.tensions, inserted, load_factor
        )


@dataclass(frozen=True, eq=False)
class ContactModel(Shown):
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
        Forces and moments on the robot; weight is taken from the robot. Where one is a moment or
        turns with the body there is no energy: an equilibrium is found in its place.
    options : ContactOptions
        Compliance and friction of the wall, segments.

    Raises
    ------
    InputError
        If there is no wall, or a load is not on the robot.

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
        _ = self.walls, self._packed

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of the model with this robot, a sentence each."""
        if not self.robot.tendon_friction.any():
            return ()
        return ("among walls the friction of tendons is left out: without walls the rod has it",)

    @cached_property
    def walls(self) -> tuple[Boundary, ...]:
        """The lumen and the obstacles."""
        found = take_boundaries(self.duct, self.obstacles)
        base, smoothing = self.robot.base_frame[:3, 3], self.options.smoothing
        return tuple(dataclasses.replace(wall, smoothing=smoothing, origin=base) for wall in found)

    @cached_property
    def _packed(self) -> PackedLoads:
        return pack_loads(self.robot, self.loads)

    @cached_property
    def _whole(self) -> FreePart:
        return FreePart(self.robot, stations=self.stations)

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
            How far each tendon is pulled [mm]; NaN for one that follows under its pretension,
            slack without one. All follow unless given.
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
        commands = self._take("displacement", displacements)
        check_pretensions(self.robot, commands, self._compliances)
        return self._follow(commands, self.robot.pretensions, inserted, initial)

    def shape_under_tensions(
        self,
        tensions: ArrayLike | Mapping[str, ArrayLike],
        *,
        inserted: float | None = None,
        initial: ContactShape | None = None,
    ) -> ContactShape:
        """Return the shape under tendon tensions (t,) [N]; the others as of `shape`."""
        forces = check_tension_commands(self.robot, self._take("tension", tensions, unset=0.0))
        return self._follow(np.full(len(forces), np.nan), forces, inserted, initial)

    def _take(self, name: str, given: object, *, unset: float = math.nan) -> Floats:
        """Return displacements or tensions (t,); NaN, for one that follows, only if `unset` is."""
        names = self.robot.tendon_names
        if isinstance(given, Mapping):
            known = {key: float(value) for key, value in given.items()}
            self.robot.order_displacements({k: v for k, v in known.items() if not math.isnan(v)})
            array = np.array([known.get(key, unset) for key in names])
        elif isinstance(given, tuple) and not given:
            array = np.full(len(names), unset)
        else:
            array = np.array(check_array(f"{name}s", given))  # type: ignore[arg-type]
        if array.shape != (len(names),):
            raise InputError(
                f"{name}s have shape {array.shape}: they must be ({len(names)},), one for each "
                "tendon"
            )
        follows = math.isnan(unset)
        for index in np.flatnonzero(~np.isfinite(array) & ~(np.isnan(array) & follows)):
            legal = "finite, or NaN where it follows" if follows else "finite"
            raise InputError(
                f"{name} of tendon '{names[index]}' is {array[index]:g}: it must be {legal}"
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
            shown = show_apart(length, self.robot.length)
            raise InputError(
                f"inserted is {shown[0]} mm: it must lie in (0, {shown[1]}] mm, the robot's length"
            )
        command = ContactCommand(commands + self._pretension_stretches, tensions, length)
        shape = self._solve(command, initial)
        if not shape.settled or shape.depth > DEEP * self.robot.radius:
            words = self._find_buried_base(length)
            if words:
                return dataclasses.replace(shape, converged=False, reason=words)
        if shape.settled:
            return shape
        words = self._find_lock(command, initial)
        if words:
            return dataclasses.replace(shape, reason=words, locked=True)
        if initial is not None:
            return shape
        for piece in np.linspace(0.0, length, math.ceil(length / PIECE / self.longest) + 1)[1:]:
            before = self._solve(command.take_part(0.0, float(piece)), initial)
            if not before.settled:
                return before
            initial = before
        reached, part = 0.0, FIRST_PART
        while reached < 1.0:
            load_factor = min(1.0, reached + part)
            shape = self._solve(command.take_part(load_factor, length), initial)
            if shape.settled:
                reached, initial = load_factor, shape
            elif part <= LEAST_PART:
                words = f"at {100.0 * load_factor:.3g} % of loads and displacements, {shape.reason}"
                return dataclasses.replace(shape, reason=words)
            else:
                part *= 0.5
        return shape

    def _find_buried_base(self, inserted: float) -> str:
        """Return words if the body is in a wall where the base holds it; else nothing."""
        base = self.robot.base_frame[:3, 3]
        radii = measure_radii(self.robot, np.array([self.robot.length - inserted]))
        for wall in self.walls:
            deep = -float(wall.measure(base[None], radii)[0])
            if deep > DEEP * radii[0] + float(wall.duct.error):
                place = ", ".join(f"{value:z.6g}" for value in base)
                return (
                    f"the base stands in a wall: at ({place}) mm the body, of radius "
                    f"{radii[0]:g} mm, is {deep:.3g} mm in it"
                )
        return ""

    def _find_lock(self, command: ContactCommand, initial: ContactShape | None) -> str:
        """Return words if tendons that hardly stretch leave the body no play; else nothing."""
        soft = np.maximum(self._compliances, STIFF * self._whole.flexibility)
        rigid = np.isfinite(command.displacements) & (self._compliances < FEWER * soft)
        if np.count_nonzero(rigid) < 2 or not self._solve(command, initial, soft).settled:
            return ""
        stiffness = float((self._natural_lengths[rigid] / soft[rigid]).min())
        return (
            "tendons that hardly stretch lock the backbone, or contradict each other: with a "
            f"stiffness of {stiffness:.1g} N in the robot there is an equilibrium; state theirs, "
            "or let those on the other side follow"
        )

    @cached_property
    def _natural_lengths(self) -> Floats:
        """Length of each tendon in the robot at rest [mm], shape (t,)."""
        return measure_rest(self._whole)

    @cached_property
    def _rest_changes(self) -> Floats:
        """How much longer tendons are at rest than in the straight robot [mm], shape (t,)."""
        return np.asarray(self._natural_lengths - self._whole.straight.sum(axis=1))

    @cached_property
    def _compliances(self) -> Floats:
        """How much each tendon stretches [mm/N], shape (t,)."""
        return np.asarray(self._natural_lengths / self.robot.tendon_stiffness)

    @cached_property
    def _pretension_stretches(self) -> Floats:
        """How much shorter a tendon is for its pretension [mm], shape (t,)."""
        return np.asarray(self._compliances * self.robot.pretensions)

    @cached_property
    def longest(self) -> float:
        """Length of the longest segment [mm]."""
        return float(np.diff(self.stations).max())

    def _solve(
        self,
        command: ContactCommand,
        initial: ContactShape | None,
        compliances: Floats | None = None,
    ) -> ContactShape:
        robot = self.robot
        cut = max(robot.length - command.inserted, 0.0)
        idle = np.isnan(command.displacements) & (command.tensions == 0.0)
        part = FreePart(robot, stations=self.stations, cut=cut, whole=self._whole, idle=idle)
        lumped_loads = LumpedLoads.place(robot, part.arc_length, self._packed).scale(
            command.load_factor
        )
        count, n = len(robot.tendons), len(part.spans)
        # A tendon that ends in the introducer does nothing.
        limits = part.straight.sum(axis=1) + self._rest_changes - command.displacements
        limits[part.counts == 0] = np.nan
        compliances = self._compliances if compliances is None else compliances
        task = ContactProblem(part, lumped_loads, self.walls, limits, compliances, self.options)
        before = None
        if initial is None:
            none = np.zeros((len(self.walls), n))
            start = ContactState(part.rest, none, np.zeros(count), none)
        else:
            start = carry_state(initial, part)
            before = place_before(initial, part) - task.base[:3, 3]
        pulled = np.where(part.counts > 0, command.tensions, 0.0)
        start.tensions = np.where(task.held, start.tensions, pulled)
        solution = settle_friction(task, start, before, WARM if initial is not None else 0)
        commands = command.displacements - command.load_factor * self._pretension_stretches
        return self._describe(task, solution, commands)

    def _describe(self, task: ContactProblem, solution: Solution, commands: Floats) -> ContactShape:
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
        fill_frames(part.packed, solution.state.rotation_vectors, rotations, spare)
        points[k:] = base[:3, 3] + found.points
        tangents[k:] = rotations[1:, :, 2] @ base[:3, :3].T
        forces, normal = np.zeros((len(places), 3)), np.zeros(len(places))
        gaps = np.full(len(places), np.inf)
        normal[k:] = np.sqrt(np.sum(found.reaction.body**2, axis=1))
        normal[~task.find_felt(normal)] = 0.0
        forces[k:] = np.where(normal[k:, None] > 0.0, found.body_forces, 0.0)
        gaps[k:] = found.reaction.gaps
        at, loads, moments = task.measure_loads(solution.state.rotation_vectors)
        moment = np.cross(at - base[:3, 3], loads).sum(axis=0) + moments.sum(axis=0)
        moment += np.cross(found.points, forces[k:]).sum(axis=0)
        bent = solution.state.rotation_vectors - part.rest
        distance, pair = find_self_contact(robot, places, points)
        settled, reason = check_solution(task, solution)
        depth, words = measure_depth(task, solution)
        if settled and distance < 0.0:
            words = (
                f"the body meets itself: at {pair[0]:.4g} and {pair[1]:.4g} mm it is "
                f"{-distance:.3g} mm too near"
            )
        verdict = np.asarray(settled and not words), np.asarray(reason or words)
        bends = measure_bends(part, solution.state.rotation_vectors)
        verdict = check_limits(robot, commands, bends, verdict)
        passed, over = check_tensions(robot, found.tensions, verdict)
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
            loads=loads.sum(axis=0),
            base_force=-(loads.sum(axis=0) + forces.sum(axis=0)),
            base_moment=-moment,
            push_force=measure_push(task, solution),
            energy=0.5 * float(np.sum(part.stiffness * bent**2)),
            stability=solution.stability,
            left_unstable=solution.perturbed,
            self_distance=distance,
            self_places=pair,
            iterations=solution.steps,
            residual=found.violation,
            imbalance=solution.imbalance,
            depth=depth,
            converged=bool(passed),
            reason=str(over),
            settled=settled,
            state=solution.state,
            part=part,
            walls=self.walls,
        )


def measure_bends(part: FreePart, rotation_vectors: Floats) -> BendMeasure:
    """Return how sections bend beyond an introducer, by the rotations (n, 3) of the segments."""
    angles, count = (
        np.hypot(rotation_vectors[:, 0], rotation_vectors[:, 1]),
        len(part.robot.sections),
    )
    curvatures = np.zeros(count)
    np.maximum.at(curvatures, part.sections, angles / part.spans)
    bends = np.bincount(part.sections, angles, count).astype(np.float64)
    return BendMeasure(bends=bends, curvatures=curvatures, round_off=LIMIT_ROUND_OFF)


def carry_state(initial: ContactShape, part: FreePart) -> ContactState:
    """Return where to start from: curvatures and forces at the same distances from the base."""
    old, state = initial.part, initial.state
    if np.array_equal(old.arc_length, part.arc_length):
        return dataclasses.replace(state)
    here, there = part.middles, old.middles
    curvature = (state.rotation_vectors - old.rest) / old.spans[:, None]
    rotation_vectors = np.stack([np.interp(here, there, row) for row in curvature.T], axis=1)
    ends, before = part.arc_length[1:] - part.cut, old.arc_length[1:] - old.cut
    density = state.forces / old.tributary_lengths
    forces = np.stack([np.interp(ends, before, row) for row in density]) * part.tributary_lengths
    return ContactState(
        rotation_vectors * part.spans[:, None] + part.rest, forces, state.tensions, forces
    )


def place_before(initial: ContactShape, part: FreePart) -> Floats:
    """Return where the points of a part were in a shape before, (n, 3) [mm]."""
    return np.stack(
        [np.interp(part.arc_length[1:], initial.arc_length, row) for row in initial.points.T],
        axis=1,
    )


def place_stations(robot: RobotDesign, largest: float | None) -> Floats:
    """Return base, ends of sections and tendons, corners of routings, and places between [mm]."""
    step = max(robot.radius, robot.length / SEGMENTS) if largest is None else largest
    if robot.length > MOST_SEGMENTS * step:
        least = robot.length / MOST_SEGMENTS
        shown = show_apart(step, least)
        raise InputError(f"segment_length is {shown[0]} mm: it must lie in [{shown[1]}, inf) mm")
    fixed = [0.0, *robot.section_ends, *robot.tendon_ends]
    fixed += [place for tendon in robot.tendons for place in tendon.corners()]
    marks = np.unique(np.round(np.asarray(fixed), 9))
    marks = marks[np.append(True, np.diff(marks) > ROUND_OFF_MM)]
    parts = [
        np.linspace(a, b, max(1, math.ceil((b - a) / step - 1e-9)) + 1)[1:]
        for a, b in zip(marks[:-1], marks[1:], strict=True)
    ]
    return np.concatenate([[0.0], *parts])


def find_self_contact(robot: RobotDesign, places: Floats, points: Floats) -> tuple[float, Floats]:
    """Return the least distance of parts of the body less both radii [mm], and their places.

    Parts count that are more than half a turn of the tightest bend apart, whose discs would meet.
    """
    radii = measure_radii(robot, places)
    apart = np.sqrt(np.sum((points[:, None] - points[None]) ** 2, axis=-1))
    apart -= radii[:, None] + radii[None]
    near = np.abs(places[:, None] - places[None]) < math.pi * (radii[:, None] + radii[None])
    apart[near] = np.inf
    index = np.unravel_index(int(np.argmin(apart)), apart.shape)
    return float(apart[index]), places[list(index)]
