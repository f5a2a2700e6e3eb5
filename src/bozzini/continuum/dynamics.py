"""Motion of a tendon robot in time: inertia, damping, tendons and loads; and small oscillations.

The robot is the discrete rod of `EnergyModel`, so what is at rest here is an equilibrium there. The
equations, unknowns and the method are in `kernels.dynamics`. Masses sit at the middles of segments,
where `EnergyModel` has the weight, and at discs; they follow from the weights of the robot: density
of its wires, line weights, discs. Tendons have no mass. Their friction is the law of `friction`,
capstan's with memory, at each step (`kernels.capstan`); at the start they hold tensions evenly.

Walls give way and hold by friction, with the law of `contact`: in every step the wall is its
tangent plane where the body comes to, found from the signed distance of any duct.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, TypedDict, Unpack, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import (
    check_array,
    check_fields,
    check_integer,
    check_kind,
    check_number,
    quantity,
)
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..results import ClosedForm, Json, Result, Shown, list_coordinates, tabulated, take_axes
from .checks import check_frame, check_values
from .contact_solver import measure_radii
from .coupling import check_displacements
from .elastic import check_pretensions, check_tension_commands
from .energy import Grid, Segment
from .equilibrium import (
    Equilibrium,
    LoadedRod,
    LumpedLoads,
    TendonCommand,
    measure_rest,
)
from .gradients import Held
from .insertion import place_at_entry
from .kernels import dynamics as kernels
from .kernels.loads import locate_stations
from .loads import Load, PointLoad, check_loads, pack_loads
from .model import choose_stiffness
from .profile import ROUND_OFF_MM
from .robot import RobotDesign, Vector, check_robot
from .walls import Boundary, ContactOptions, Wall, take_boundaries
from .wire import GRAVITY

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from scipy.signal import StateSpace

    from .contact import ContactModel

FALL = 1e3 * GRAVITY
"""Standard acceleration of free fall [mm/s^2]."""

MOST_STEPS = 1e8
"""Steps of a simulation."""

DEEP_START = 0.5
"""How deep a body may be in a wall at the start, by its radius."""

PLAY_MM = 0.1
"""Play of the body in an introducer [mm]."""

TOLERANCE_MM = 1e-6
"""Error of tendon lengths in the equilibrium at the start [mm]."""

FRAME = "base at rest"
"""What places and velocities of a motion are in."""

GAINED = 0.1
"""Share of energy that may come from nowhere before it is told."""

LEAST_ENERGY = 1e-5
"""Energy of which shares are taken at least [N mm]."""

MOST_LOOKS = 4
"""How often the planes of walls in a step are taken anew, where it has come to."""

PLANE_ENERGY = 1e-3
"""Energy of walls that planes may miss in a step, by the most energy there or done."""

PRESLIDING = 1e-5
"""Slip at which friction of tendons acts in full, as a share of the robot's length."""


@dataclass(frozen=True, kw_only=True)
class DynamicsOptions(Shown):
    """What the motion of a robot depends on, besides the robot itself.

    Parameters
    ----------
    damping_time : float
        Kelvin-Voigt damping of the backbone: its stress is ``E (strain + damping_time strain')``
        [s].
    drag : float
        Force against the motion of the backbone by its length and velocity [N s/mm^2].
    tip_weight : float
        Weight of what the tip carries, such as a camera, a ball of the body's radius [N].
    gravity : (x, y, z)
        Acceleration of free fall in the world [m/s^2].
    between, segment, tendon_stiffness
        As of `EnergyModel`. Displacements can be commanded of tendons that have a stiffness only.
    max_step : float
        Largest step of time [s].
    step_tolerance : float
        Error of the place of any segment's end in one step [mm], by its estimate: steps are as
        small as it asks for, 1/1024 of the largest at least. Unless given, all are the largest.
    spectral_radius : float
        What is left of infinitely fast motion after one step, in [0, 1]: 1 keeps the energy of
        small motions, 0 damps most what the step does not resolve.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    damping_time: float = quantity(
        "time", "Stress of the backbone by the rate of its strain, by E.", low=0.0, default=0.0
    )
    drag: float = quantity(
        "line damping",
        "Force against the motion by length and velocity.",
        low=0.0,
        default=0.0,
        by_name=True,
    )
    tip_weight: float = quantity(
        "force", "Weight of what the tip carries.", low=0.0, default=0.0, by_name=True
    )
    gravity: Vector = (0.0, 0.0, -GRAVITY)
    between: int = quantity(
        help="Further cross-sections between two discs.",
        low=0,
        high=1000,
        whole=True,
        default=0,
    )
    segment: Segment = quantity(
        "text",
        "Straight links, arcs, or arcs with tendons in smooth channels.",
        words=get_args(Segment),
        default="chord",
        option="segment_kind",
    )
    tendon_stiffness: float | None = quantity(
        "force",
        "EA of tendons without one of their own; they do not stretch unless given.",
        low=0.0,
        low_open=True,
        default=None,
    )
    max_step: float = quantity(
        "time", "Largest step.", low=0.0, low_open=True, default=1e-3, by_name=True
    )
    step_tolerance: float | None = quantity(
        "length", "Error of places in a step, which it is made small for.",
        low=0.0, low_open=True, default=None,
        by_name=True,
    )  # fmt: skip
    spectral_radius: float = quantity(
        "dimensionless",
        "What is left of infinitely fast motion after a step.",
        low=0.0,
        high=1.0,
        default=0.8,
        by_name=True,
    )

    def __post_init__(self) -> None:
        check_fields(self)
        gravity = check_values("gravity", self.gravity, (3,), unit="m/s^2")
        object.__setattr__(self, "gravity", tuple(gravity.tolist()))


DEFAULT_OPTIONS = DynamicsOptions()


class RodMotion(NamedTuple):
    """Where a discrete rod is in its motion; arrays (n, 3).

    Attributes
    ----------
    rotation_vectors, momenta : ndarray
        Of the segments [rad], and their momenta [N mm s].
    rates, momentum_rates : ndarray
        Their derivatives, as the method carries them from step to step.
    slips, normal_forces : ndarray
        Elastic slip (w, n, 3) [mm] of the segments' ends on each wall, and its force (w, n) [N].
    pulls : ndarray
        Tensions of tendons with friction, at the drive and in the segments (t, n + 1) [N].
    shares, beyond : ndarray
        Share of friction that acts where they come into each segment, and their length without
        tension from there on [mm], (t, n).
    ground : ndarray
        Of a free base: its axes, place [mm], velocity, spin, the rod's momentum [N s] and moment of
        momentum about where the base was at rest [N mm s], their rates, and six rows of the last
        stage (16, 3).
    """

    rotation_vectors: Floats
    momenta: Floats
    rates: Floats
    momentum_rates: Floats
    slips: Floats = np.empty((0, 0, 3))
    normal_forces: Floats = np.empty((0, 0))
    pulls: Floats = np.empty((0, 0))
    shares: Floats = np.empty((0, 0))
    beyond: Floats = np.empty((0, 0))
    ground: Floats = np.empty((0, 3))


@dataclass(frozen=True, kw_only=True, eq=False)
class EnergyBalance(Shown):
    """Energies of a motion and what changed them [N mm], each (k,).

    Attributes
    ----------
    kinetic, elastic, gravity, tendons, walls : ndarray
        Of the motion, the backbone, its height, tendons that stretch and walls that give way.
        Those without friction count where their lengths are commanded only.
    work : ndarray
        Done by loads, tendons and a base that moves since the first time.
    dissipated : ndarray
        Lost by damping, drag and friction since the first time.
    friction : ndarray
        What of it friction of tendons took; it never falls.
    """

    kinetic: Floats
    elastic: Floats
    gravity: Floats
    tendons: Floats
    work: Floats
    dissipated: Floats
    walls: Floats
    friction: Floats

    @property
    def total(self) -> Floats:
        """Energy that is there [N mm], shape (k,)."""
        return np.asarray(self.kinetic + self.elastic + self.gravity + self.tendons + self.walls)

    @property
    def residual(self) -> Floats:
        """Energy that came from nowhere since the first time [N mm], shape (k,)."""
        return np.asarray(self.total - self.total[0] - self.work + self.dissipated)

    @property
    def gain(self) -> Floats:
        """Share that came from nowhere of the most there, done or lost up to a time, shape (k,)."""
        height = np.abs(self.gravity - self.gravity[0])
        there = self.kinetic + self.elastic + height + np.abs(self.tendons) + self.walls
        most = np.max([there, np.abs(self.work), np.abs(self.dissipated)], axis=0)
        return np.asarray(self.residual / np.maximum(np.maximum.accumulate(most), LEAST_ENERGY))


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapeHistory(Result):
    """The motion of a robot, in the frame of its base at rest.

    ``k`` counts times, ``s`` stations, ``t`` tendons.

    Parameters
    ----------
    robot : RobotDesign
        The robot.
    time : (k,) ndarray
        Times [s].
    arc_length : (s,) ndarray
        Stations [mm].
    frames : (k, s, 4, 4) ndarray
        Frames of the cross-sections [mm]: columns x, y, tangent, place.
    velocities : (k, s, 3) ndarray
        Of the stations [mm/s].
    tensions, displacements : (k, t) ndarray
        Of the tendons at their drives [N], [mm].
    wall_forces : (k, s, 3) ndarray
        Of the walls on the body at the stations, friction included [N].
    gaps : (k, s) ndarray
        Between body and nearest wall [mm], negative in it; infinite where it is far.
    energy : EnergyBalance
        Energies and their balance [N mm].
    iterations : (k,) ndarray of int
        Steps of Newton's method since the time before.
    reason : str
        Why it ends before the last time; empty where it does not.
    state : RodMotion
        Where it is at the last time, for ``initial=`` of what comes after it.
    rod : MovingRod
        The robot cut into segments, which what comes after it takes over.
    """

    robot: RobotDesign = field(repr=False)
    time: Floats
    arc_length: Floats
    frames: Floats
    velocities: Floats
    tensions: Floats
    displacements: Floats
    wall_forces: Floats = field(repr=False)
    gaps: Floats = field(repr=False)
    energy: EnergyBalance = field(repr=False)
    iterations: NDArray[np.int64]
    reason: str
    state: RodMotion = field(repr=False)
    rod: MovingRod = field(repr=False)

    @property
    def converged(self) -> bool:
        """Whether it goes to the last time."""
        return not self.reason

    @property
    def residual(self) -> float:
        """Largest energy that came from nowhere, or went there [N mm]."""
        return float(np.abs(self.energy.residual).max())

    @property
    def notes(self) -> tuple[str, ...]:
        """What is wrong with a motion that goes on: energy from nowhere, a tenth or more."""
        gain = self.energy.gain
        worst = int(np.argmax(gain))
        if gain[worst] <= GAINED:
            return ()
        return (
            f"{self.energy.residual[worst]:.3g} N mm of energy came from nowhere up to "
            f"{self.time[worst]:.4g} s, {100.0 * gain[worst]:.0f} % of the most that was there or "
            "done: take smaller steps, damping or a spectral radius below 0.5",
        )

    @property
    def points(self) -> Floats:
        """Points of the backbone at the stations, shape (k, s, 3) [mm]."""
        return self.frames[..., :3, 3]

    @property
    def tip(self) -> Floats:
        """Where the robot ends, shape (k, 3) [mm]."""
        return self.frames[:, -1, :3, 3]

    @property
    def tip_frames(self) -> Floats:
        """Frames of the robot's end, shape (k, 4, 4)."""
        return self.frames[:, -1]

    @property
    def wall_sum(self) -> Floats:
        """Sum of the sizes of the walls' forces [N], shape (k,)."""
        return np.asarray(np.linalg.norm(self.wall_forces, axis=-1).sum(axis=-1))

    def to_dict(self) -> Json:
        """Return verdict, times, tip, tendons and energies as plain values."""
        balance = self.energy
        return {
            "converged": self.converged,
            "reason": self.reason,
            "notes": list(self.notes),
            "frame": FRAME,
            "residual_N_mm": self.residual,
            "time_s": self.time.tolist(),
            "tip_mm": self.tip.tolist(),
            "tip_frames": self.tip_frames.tolist(),
            "iterations": self.iterations.tolist(),
            "tendons": {
                name: {
                    "tension_N": self.tensions[:, k].tolist(),
                    "displacement_mm": self.displacements[:, k].tolist(),
                }
                for k, name in enumerate(self.robot.tendon_names)
            },
            "wall_N": self.wall_sum.tolist(),
            "energy": {f"{name}_N_mm": value.tolist() for name, value in vars(balance).items()},
            "arc_length_mm": self.arc_length.tolist(),
            "backbone_mm": self.points.tolist(),
        }

    def list_columns(self) -> dict[str, NDArray[np.generic]]:
        """Return the columns of `to_frame`: tip, its velocity, tendons, energies; and the frame."""
        columns: dict[str, NDArray[np.generic]] = {"time_s": self.time}
        columns |= list_coordinates("tip", self.tip)
        columns |= {f"tip_v{axis}_mm_s": self.velocities[:, -1, k] for k, axis in enumerate("xyz")}
        for k, name in enumerate(self.robot.tendon_names):
            columns[f"{name}_N"] = self.tensions[:, k]
            columns[f"{name}_mm"] = self.displacements[:, k]
        columns["wall_N"] = self.wall_sum
        columns |= {f"{name}_N_mm": value for name, value in vars(self.energy).items()}
        return columns | {"frame": np.full(len(self.time), FRAME)}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the coordinates of the tip over time."""
        axes = take_axes(ax, x="time [s]", y="tip [mm]")
        for k, axis in enumerate("xyz"):
            axes.plot(self.time, self.tip[:, k], label=axis)
        return axes


@dataclass(frozen=True)
class _Points:
    """Points of a rod with mass or load, in the order of arc length."""

    segments: NDArray[np.int64]
    parts: Floats
    masses: Floats
    inertias: Floats
    drags: Floats

    @property
    def packed(self) -> tuple[NDArray[np.int64], Floats, Floats, Floats, Floats]:
        return self.segments, self.parts, self.masses, self.inertias, self.drags


@dataclass(frozen=True, eq=False)
class MovingRod:
    """A robot cut into segments, with its masses, damping, loads and tendons."""

    robot: RobotDesign
    options: DynamicsOptions
    loads: tuple[Load, ...]
    touches: bool = False

    def is_like(self, other: MovingRod) -> bool:
        """Whether another is of the same robot, options and loads."""
        return (
            self.robot is other.robot
            and self.touches == other.touches
            and self.options == other.options
            and len(self.loads) == len(other.loads)
            and all(one is two for one, two in zip(self.loads, other.loads, strict=True))
        )

    @cached_property
    def grid(self) -> Grid:
        """Its segments."""
        return Grid(self.robot, self.options.segment, self.options.between)

    @cached_property
    def damping(self) -> Floats:
        """Damping of the segments' rotations [N mm s], shape (n, 3)."""
        return self.options.damping_time * self.grid.stiffness

    @cached_property
    def natural_lengths(self) -> Floats:
        """Lengths of the tendons at rest, without loads [mm], shape (t,)."""
        return measure_rest(self.grid)

    @cached_property
    def compliances(self) -> Floats:
        """How much tendons stretch [mm/N], shape (t,)."""
        other = self.options.tendon_stiffness
        stiffness = choose_stiffness(self.robot, math.inf if other is None else other)
        return self.natural_lengths / stiffness

    @cached_property
    def rubbing(self) -> tuple[Floats, Floats, Floats, float]:
        """What `kernels.capstan` takes of tendons with friction; empty arrays without."""
        friction, straight = self.robot.tendon_friction, self.grid.straight
        if not friction.any():
            return np.empty(0), np.empty((0, 3)), np.empty((0, 0)), 1.0
        starts = np.array([[*tendon.slope_at(0.0), 1.0] for tendon in self.robot.tendons])
        compliances = straight * (self.compliances / straight.sum(axis=1))[:, None]
        return friction, starts, compliances, PRESLIDING * self.robot.length

    @cached_property
    def lumped(self) -> tuple[LumpedLoads, ...]:
        """Each load at points of the segments."""
        return tuple(self._lump(load) for load in self.loads)

    def _lump(self, load: Load) -> LumpedLoads:
        packed = pack_loads(self.robot, [load])
        count = int(isinstance(load, PointLoad))
        packed = packed._replace(
            points=packed.points[:count],
            forces=packed.forces[:count],
            moments=packed.moments[:count],
            frames=packed.frames[:count],
            down=np.zeros(3),
        )
        return LumpedLoads.place(self.robot, self.grid.arc_length, packed)

    @cached_property
    def points(self) -> _Points:
        """Points with mass or load."""
        robot, arc = self.robot, self.grid.arc_length
        rows: dict[tuple[int, float], Floats] = {}  # mass, three moments of inertia, drag

        def add(segment: int, part: float, values: ArrayLike) -> None:
            key = segment, round(part, 12)
            rows[key] = rows.get(key, np.zeros(5)) + np.asarray(values)

        spans, middles = self.grid.spans, 0.5 * (arc[1:] + arc[:-1])
        masses = robot.weight_at(middles) / FALL * spans
        for j, own in enumerate(self.grid.sections):
            section = robot.sections[own]
            square = section.radius**2
            inertia = masses[j] * square / 4.0
            if section.wire is not None:
                place = middles[j] - robot.section_starts[own]
                of_wire = section.wire.weight_at(place) / FALL * spans[j]
                outer, inner = section.wire.diameter_at(place), section.wire.inner_diameter
                inertia += of_wire * ((outer**2 + inner**2) / 16.0 - square / 4.0)
            drag = self.options.drag * spans[j]
            add(j, 0.5, [masses[j], inertia, inertia, 2.0 * inertia, drag])
        places = [*robot.disc_arc_length, robot.length]
        weights = [*robot.disc_weights, self.options.tip_weight]
        for index, (place, weight) in enumerate(zip(places, weights, strict=True)):
            if weight > 0.0:
                segment = int(np.searchsorted(arc, place - 1e-9)) - 1
                radius = robot.sections[int(robot.section_at(place))].radius
                mass = weight / FALL
                disc = mass * radius**2 * np.array([0.25, 0.25, 0.5])
                ball = np.full(3, 0.4 * mass * radius**2)
                own = ball if index == len(places) - 1 else disc
                add(segment, (place - arc[segment]) / spans[segment], [mass, *own, 0.0])
        if not all(
            any(key[0] == j and row[0] > 0.0 for key, row in rows.items())
            for j in range(len(spans))
        ):
            raise GeometryError(
                f"robot '{robot.name}' has parts without mass: give its wires a density, its "
                "sections a line_weight, or its discs a disc_weight"
            )
        for j in range(len(spans) if self.touches else 0):
            add(j, 1.0, np.zeros(5))
        for lumped in self.lumped:
            for segment, part in zip(lumped.segments.tolist(), lumped.parts.tolist(), strict=True):
                add(segment, part, np.zeros(5))
        keys = sorted(rows)
        table = np.array([rows[key] for key in keys])
        return _Points(
            segments=np.array([key[0] for key in keys], dtype=np.int64),
            parts=np.array([key[1] for key in keys]),
            masses=np.ascontiguousarray(table[:, 0]),
            inertias=np.ascontiguousarray(table[:, 1:4]),
            drags=np.ascontiguousarray(table[:, 4]),
        )

    @cached_property
    def load_vectors(self) -> tuple[Floats, Floats, Floats]:
        """Forces and moments of each load at the points, each (l, p, 3).

        And both of those that turn with the body, in its axes (l, 2, p, 3); (l, 2, 0, 3) if there
        is none.
        """
        points = self.points
        keys = list(zip(points.segments.tolist(), points.parts.tolist(), strict=True))
        index = {key: place for place, key in enumerate(keys)}
        found = np.zeros((2, len(self.lumped), 2, len(keys), 3))
        for row, lumped in enumerate(self.lumped):
            for k, (segment, part) in enumerate(
                zip(lumped.segments.tolist(), lumped.parts.tolist(), strict=True)
            ):
                place, follows = index[segment, round(part, 12)], int(lumped.follows[k])
                found[follows, row, 0, place] += lumped.forces[k]
                found[follows, row, 1, place] += lumped.moments[k]
        dead, turning = found
        own = turning if turning.any() else turning[:, :, :0]
        return dead[:, 0].copy(), dead[:, 1].copy(), own.copy()

    @cached_property
    def weights(self) -> Floats:
        """Weights of the points [N], shape (p, 3)."""
        down = self.robot.base_frame[:3, :3].T @ np.asarray(self.options.gravity)
        return np.asarray(1e3 * self.points.masses[:, None] * down)

    @property
    def packed(self) -> tuple[object, ...]:
        """What the kernels take as ``rod``."""
        return self.grid.packed, self.grid.rest, self.damping, self.points.packed

    def find_equilibrium(
        self,
        command: Floats,
        *,
        held: bool,
        factors: Floats,
        turned: Floats,
        initial: tuple[Floats, Floats] | None = None,
    ) -> Equilibrium:
        """Return the equilibrium under tendons and loads, followed from rest.

        `turned` (3, 3) is how the base is turned from its rest. From `initial`, rotation vectors
        and tensions, it is tried at once.
        """
        forces, moments, own = self.load_vectors
        points = self.points
        follow = np.tensordot(factors, own, 1)
        twice = 2 if follow.size else 1
        lumped = LumpedLoads(
            segments=np.tile(points.segments, twice),
            parts=np.tile(points.parts, twice),
            offsets=np.zeros((twice * len(points.parts), 3)),
            forces=np.concatenate(
                [(self.weights + np.tensordot(factors, forces, 1)) @ turned, follow[0]]
            ),
            moments=np.concatenate([np.tensordot(factors, moments, 1) @ turned, follow[1]]),
            follows=np.repeat([False, True][:twice], len(points.parts)),
        )
        count = len(command)
        rod = LoadedRod(
            self.grid, lumped, self.grid.rest, self.compliances, self.robot.pushes, TOLERANCE_MM
        )
        tendons = TendonCommand(
            free_lengths=self.find_limits(command) if held else self.natural_lengths,
            rest_lengths=self.natural_lengths,
            held=np.full(count, held),
            pulls=np.zeros(count) if held else command,
        )
        found = rod.follow(tendons, initial=initial)[-1]
        if not found.found or found.load_factor < 1.0:
            raise GeometryError(
                f"no equilibrium was found to start from: the command with its loads can be "
                f"followed to {math.floor(100.0 * found.load_factor)} % only"
            )
        return found

    def differentiate_tip(self, found: Equilibrium) -> tuple[Floats, Floats]:
        """Return the tip (3,) [mm], and its derivatives by the tensions (3, t) [mm/N]."""
        q, count = found.rotation_vectors, len(self.grid.spans)
        end = np.array([count - 1]), np.ones(1), np.zeros((1, 3))
        moved = self.grid.move_stations(q, end)[0, 3:]
        rows = found.length_gradients.reshape(-1, q.size)
        place = self.grid.place_frames(q[None])[0, -1, :3, 3]
        return place, -moved @ np.linalg.solve(found.hessian, rows.T)

    def find_limits(self, displacements: Floats) -> Floats:
        """Lengths of the tendons without tension (..., t) by displacements; and back [mm]."""
        pretension = self.compliances * self.robot.pretensions
        return np.asarray(self.natural_lengths - displacements - pretension)


class MotionCommands(TypedDict, total=False):
    """What acts on a robot over k times; each may be left out.

    Attributes
    ----------
    tensions, displacements : (k, t) or (t,) array_like, or mapping
        Of the tendons [N], [mm]; one of both, linear between times: what reaches them, which
        `to_tensions` and `to_displacements` of a calibrated robot give. Without either they have
        no tension.
    drive_rate : float
        Largest speed of drives that follow displacements, from where they are at the first time
        [mm/s]; unless given they are there at once.
    loads : sequence of PointLoad or LineLoad
        Loads on it; those in the axes of the body turn with it.
    load_factors : (k, l) array_like
        By what each load is multiplied, linear between times; 1 unless given.
    base : (k, 4, 4) array_like
        Frames of the base in its own frame at rest [mm], joined by cubics; still between two that
        are the same.
    free : bool
        Whether the base is let go at the first time, in place of `base`: of robots whose tendons
        have no friction, under tensions. With a spectral radius of 1 the roll of a thin rod, which
        has hardly any inertia, may grow.
    duct : Duct
        Lumen that the body stays in; its points are in the world.
    obstacles : Duct or sequence of Duct
        What the body stays outside of.
    contact : ContactOptions
        How it touches these: ``wall_stiffness`` must be given.
    introducer : float
        Length of a straight tube along the base's axis, from where it rests [mm]: the body passes
        it with a play of 0.1 mm, and touches the other walls beyond it.
    """

    tensions: ArrayLike | None
    displacements: ArrayLike | None
    drive_rate: float
    loads: Sequence[Load]
    load_factors: ArrayLike | None
    base: ArrayLike | None
    free: bool
    duct: Wall | None
    obstacles: Wall | Sequence[Wall]
    contact: ContactOptions
    introducer: float


def simulate(
    robot: RobotDesign,
    times: ArrayLike,
    *,
    held_by: Sequence[Load] | None = None,
    initial: ShapeHistory | None = None,
    options: DynamicsOptions = DEFAULT_OPTIONS,
    **commands: Unpack[MotionCommands],
) -> ShapeHistory:
    """Return the motion of a robot under commands over time, from an equilibrium or a state.

    Parameters
    ----------
    robot : RobotDesign
        The robot; every part of it has a weight, from which its mass follows.
    times : (k,) array_like
        Times of the rows [s], growing.
    held_by : sequence of PointLoad or LineLoad, optional
        What holds the robot at rest before the first time, in place of `loads`.
    initial : ShapeHistory, optional
        What went before, of the same lengths, tendons and segments; the equilibrium at the first
        time unless given.
    options : DynamicsOptions
    **commands
        See `MotionCommands`.

    Returns
    -------
    ShapeHistory
        One row for each time. If a step has no answer it ends there, with a reason.

    Raises
    ------
    InputError
        If an argument does not fit.
    GeometryError
        If a part of the robot has no mass, there is no equilibrium to start from, or it is deep in
        a wall.

    Notes
    -----
    The equilibrium at the start knows of no wall. A step in which a wall presses is of first order:
    a blow takes the speed across the wall. A step that would gain energy, 1 % of the most there or
    done, is made anew with a spectral radius of 0, then of first order, then in parts: large steps
    damp. Tendons with friction are not watched so; a tenth or more is in the `notes`.
    """
    check_robot(robot)
    check_kind("options", options, DynamicsOptions)
    if initial is not None:
        check_kind("initial", initial, ShapeHistory)
    rows = check_array("times", times)
    if rows.ndim != 1 or len(rows) < 2:
        raise InputError(f"times have shape {rows.shape}: they must be (k,), 2 or more, growing")
    if not np.isfinite(rows).all():
        raise InputError("times have values that are not finite (NaN or infinite)")
    falls = np.flatnonzero(np.diff(rows) <= 0.0)
    if len(falls):
        index = int(falls[0])
        raise InputError(
            f"times[{index + 1}] is {rows[index + 1]:g} s, after {rows[index]:g} s: they must grow"
        )
    steps = np.ceil(np.diff(rows) / options.max_step * (1.0 - 1e-9))
    if steps.sum() > MOST_STEPS:
        raise InputError(f"there would be {steps.sum():.3g} steps: {MOST_STEPS:g} are legal")
    for name in commands:
        if name not in MotionCommands.__annotations__:
            legal = ", ".join(MotionCommands.__annotations__)
            raise InputError(f"a motion has no command '{name}': it has {legal}")
    given, base = check_loads(robot, commands.get("loads", ())), commands.get("base")
    before = () if held_by is None else check_loads(robot, held_by)
    walls = _take_walls(commands)
    rod = MovingRod(robot, options, (*given, *before), touches=bool(walls))
    if initial is not None and rod.is_like(initial.rod):
        rod = initial.rod
    factors = np.zeros((len(rows), len(rod.loads)))
    factors[:, : len(given)] = _take_factors(rows, given, commands.get("load_factors"))
    command, held = _take_commands(
        rod, len(rows), commands.get("tensions"), commands.get("displacements")
    )
    free = commands.get("free", False)
    check_kind("free", free, bool)
    if free and (held or base is not None or robot.tendon_friction.any()):
        raise InputError(
            "free is true: no base, no displacements and no friction of tendons may be given then"
        )
    coefficients = _take_base(rows, base)
    if "drive_rate" in commands:
        if not held:
            raise InputError("drive_rate is given: displacements must be commanded with it")
        speed = check_number(
            "drive_rate", commands["drive_rate"], low=0.0, low_open=True, unit="mm/s"
        )
        start = command[0] if initial is None else initial.displacements[-1]
        turns, command = _limit_rate(rows, command, start, speed)
    else:
        turns = rows
    targets = rod.find_limits(command) if held else command
    tables = (
        np.ascontiguousarray(turns),
        _split_base(rows, coefficients, turns),
        rod.weights,
        *rod.load_vectors,
        _interpolate(turns, rows, factors),
        np.ascontiguousarray(targets),
    )
    steps = np.ceil(np.diff(turns) / options.max_step * (1.0 - 1e-9))
    tendons = rod.compliances, held, ~robot.pushes, rod.rubbing
    options_there = commands.get("contact", ContactOptions())
    contacts = _Contacts(rod, walls, options_there, _take_introducer(commands))
    if initial is None:
        at_start = factors[0].copy()
        if held_by is not None:
            at_start[:] = np.arange(len(at_start)) >= len(given)
        turned = np.eye(3) if base is None else np.asarray(base, dtype=np.float64)[0, :3, :3]
        found = rod.find_equilibrium(command[0], held=held, factors=at_start, turned=turned)
        shape = found.rotation_vectors.shape
        state = RodMotion(found.rotation_vectors.copy(), *(np.zeros(shape) for _ in range(3)))
        if free:
            state = state._replace(ground=np.eye(16, 3))
    else:
        (own, names), (other, others) = (
            ([section.length for section in one.sections], one.tendon_names)
            for one in (robot, initial.robot)
        )
        if own != other or names != others:
            raise InputError(
                f"initial is of another robot, with sections of {other} mm and {len(others)} "
                f"tendons: this one has {own} mm and {len(names)}"
            )
        if initial.state.rotation_vectors.shape != rod.grid.rest.shape:
            raise InputError(
                f"initial has {len(initial.state.rotation_vectors)} segments: it must have the "
                f"{len(rod.grid.rest)} of this robot and options"
            )
        state = RodMotion(*(array.copy() for array in initial.state))
        if free != bool(len(state.ground)):
            raise InputError("free is other than of initial: a base is let go at a first time")
        contacts.take(state)
    fresh = 2 if initial is None else 1
    moved = _run(rod, tendons, tables, contacts, (steps.astype(np.int64), fresh), state)
    return moved if turns is rows else _keep_rows(moved, np.searchsorted(turns, rows))


def push_in(
    model: ContactModel, path: ArrayLike, *, times: ArrayLike, speed: float
) -> tuple[RobotDesign, Floats]:
    """Return a robot that waits before the entry of a lumen, and its base pushed in at a speed.

    Parameters
    ----------
    model : ContactModel
        Robot and walls; the robot's own base pose is not used.
    path : (p, 3) array_like
        Points of the way into the lumen, the entry first [mm].
    times : (k,) array_like
        Times [s], growing.
    speed : float
        Of the base, from the first time until the whole robot is in [mm/s].

    Returns
    -------
    robot : RobotDesign
        With its tip at the entry, for `simulate` with its length as ``introducer``.
    base : (k, 4, 4) ndarray
        Frames of its base.

    Raises
    ------
    InputError
        If the speed is not positive, or the body does not fit at the entry.
    """
    check_number("speed", speed, low=0.0, low_open=True, unit="mm/s")
    robot = place_at_entry(model, np.asarray(path, dtype=np.float64), None).robot
    back = robot.base_frame[:3, 3] - robot.length * robot.base_frame[:3, 2]
    rows = np.asarray(times, dtype=np.float64)
    base = np.tile(np.eye(4), (len(rows), 1, 1))
    base[:, 2, 3] = np.minimum(speed * (rows - rows[0]), robot.length)
    return dataclasses.replace(robot, base_position=tuple(back.tolist())), base


def _limit_rate(
    times: Floats, commands: Floats, start: Floats, speed: float
) -> tuple[Floats, Floats]:
    """Return where drives are that follow commands (k, t) from a start, (m, t), and when (m,).

    Among the times are those given, and where a drive turns or catches up.
    """
    courses = []
    for wanted, place in zip(commands.T, start.tolist(), strict=True):
        course = [(float(times[0]), place)]
        for index in range(len(times) - 1):
            now, end = float(times[index]), float(times[index + 1])
            slope = float(wanted[index + 1] - wanted[index]) / (end - now)
            gap = float(wanted[index]) - place
            way = math.copysign(1.0, gap if gap != 0.0 else slope)
            if gap != 0.0 and speed > way * slope:  # it comes nearer
                met = now + abs(gap) / (speed - way * slope)
                if met < end - 1e-9 * (end - now):
                    place += way * speed * (met - now)
                    course.append((met, place))
                    now, gap, way = met, 0.0, math.copysign(1.0, slope)
            place += (slope if gap == 0.0 and abs(slope) <= speed else way * speed) * (end - now)
            if abs(place - wanted[index + 1]) <= ROUND_OFF_MM:
                place = float(wanted[index + 1])
            course.append((end, place))
        courses.append(np.array(course).T)
    turns = np.unique(np.concatenate([times, *(course[0] for course in courses)]))
    return turns, np.stack([np.interp(turns, *course) for course in courses], axis=1)


def _interpolate(times: Floats, rows: Floats, values: Floats) -> Floats:
    """Return values (k, l) at rows, linear between them, at times (m,)."""
    columns = [np.interp(times, rows, column) for column in values.T]
    return np.ascontiguousarray(np.array(columns).reshape(values.shape[1], len(times)).T)


def _split_base(rows: Floats, coefficients: Floats, times: Floats) -> Floats:
    """Return the coefficients of cubics, (k - 1, 4, 6) between rows, between more times."""
    index = np.searchsorted(rows, times[:-1], side="right") - 1
    after = (times[:-1] - rows[index])[:, None]
    a, b, c, d = np.moveaxis(coefficients[index], 1, 0)
    shifted = (
        a,
        b + 3.0 * a * after,
        c + (2.0 * b + 3.0 * a * after) * after,
        d + (c + (b + a * after) * after) * after,
    )
    return np.ascontiguousarray(np.stack(shifted, axis=1))


def _keep_rows(found: ShapeHistory, index: NDArray[np.int64]) -> ShapeHistory:
    """Return a motion at some of its times."""
    index = index[index < len(found.time)]
    counts = np.cumsum(found.iterations)[index]
    names = ("time", "frames", "velocities", "tensions", "displacements", "wall_forces", "gaps")
    parts = {name: getattr(found, name)[index] for name in names}
    energy = {name: value[index] for name, value in vars(found.energy).items()}
    return dataclasses.replace(
        found,
        **parts,
        energy=EnergyBalance(**energy),
        iterations=np.diff(counts, prepend=0),
    )


def _take_factors(times: Floats, loads: Sequence[Load], given: ArrayLike | None) -> Floats:
    """Return by what the loads (l,) are multiplied, (k, l)."""
    shape = len(times), len(loads)
    if given is None:
        return np.ones(shape)
    factors = check_array("load_factors", given)
    if factors.shape != shape:
        raise InputError(f"load_factors have shape {factors.shape}: they must have {shape}")
    if not np.isfinite(factors).all():
        raise InputError("load_factors have values that are not finite (NaN or infinite)")
    return factors


def _take_walls(commands: MotionCommands) -> tuple[Boundary, ...]:
    """Return what the body touches, none if no wall is given."""
    duct, obstacles = commands.get("duct"), commands.get("obstacles", ())
    if duct is None and isinstance(obstacles, (list, tuple)) and not obstacles:
        if "contact" in commands:
            raise InputError("contact is given without a wall: give a duct, or obstacles")
        return ()
    found = take_boundaries(duct, obstacles)
    if "contact" not in commands:
        raise InputError("there are walls: give contact, with the wall_stiffness [N/mm^2]")
    options = commands["contact"]
    check_kind("contact", options, ContactOptions)
    if options.wall_stiffness is None:
        raise InputError("wall_stiffness is not given [N/mm^2]: a wall in motion gives way")
    plain = ContactOptions()
    for name in ("segment_length", "tolerance"):
        if getattr(options, name) != getattr(plain, name):
            raise InputError(f"{name} of contact is of equilibria: a motion has `between`")
    return tuple(dataclasses.replace(wall, smoothing=options.smoothing) for wall in found)


def _take_introducer(commands: MotionCommands) -> float:
    """Return the length of the introducer [mm], 0 without one."""
    if "introducer" not in commands:
        return 0.0
    if commands.get("duct") is None:
        raise InputError("introducer is given without a duct that it leads to")
    return check_number("introducer", commands["introducer"], low=0.0, unit="mm")


class _Contacts:
    """Walls as `kernels.press_end` takes them: planes where the ends of segments are expected."""

    def __init__(
        self,
        rod: MovingRod,
        walls: tuple[Boundary, ...],
        options: ContactOptions,
        introducer: float = 0.0,
    ) -> None:
        frame, count = rod.robot.base_frame, len(rod.grid.spans) if walls else 0
        self.introducer, rows = introducer, len(walls) + 4 * (introducer > 0.0)
        self.axes = frame[:3, :3]
        self.walls = tuple(dataclasses.replace(wall, origin=frame[:3, 3]) for wall in walls)
        lengths = 0.5 * rod.grid.spans
        lengths[:-1] += 0.5 * rod.grid.spans[1:]
        self.radii = measure_radii(rod.robot, rod.grid.arc_length[1:])
        self.planes = (
            np.zeros((count, 3)),
            np.full((rows, count), math.inf),
            np.zeros((rows, count, 3)),
        )
        self.before = (
            np.zeros((rows, count, 3)),
            np.zeros((rows, count)),
            np.zeros((count, 3)),
        )
        filled = np.zeros_like(self.before[0]), np.zeros_like(self.before[1])
        stiffness = options.wall_stiffness or math.inf  # none without walls
        self.packed = (
            *self.planes,
            1.0 / (stiffness * lengths[:count]),
            (float(options.friction), float(options.slip)),
            self.before,
            (*filled, np.zeros((count, 3, 3))),
        )

    def take(self, state: RodMotion) -> None:
        """Go on with the slips and forces of a state, if it has them of these walls."""
        if state.slips.shape == self.before[0].shape:
            self.before[0][:], self.before[1][:] = state.slips, state.normal_forces

    def check_start(self) -> None:
        """Refuse a body that starts deep in a wall."""
        depth = -np.min(self.planes[1] / self.radii, axis=0, initial=0.0)
        worst = int(np.argmax(depth))
        if depth[worst] > DEEP_START:
            raise GeometryError(
                f"the robot starts {depth[worst] * self.radii[worst]:.3g} mm deep in a wall: hold "
                "it out of it (held_by), or place its base elsewhere"
            )

    def miss_energy(self, places: Floats) -> float:
        """Return by how much planes miss the energy of the walls at places (n, 3) [N mm]."""
        origins, gaps, normals = self.planes
        far = np.isinf(gaps)
        there = gaps + np.einsum("wni,ni->wn", normals, places - origins)
        kept = tuple(plane.copy() for plane in self.planes)
        self.look(places)
        depths = np.minimum(gaps, 0.0) ** 2 - np.minimum(np.where(far, math.inf, there), 0.0) ** 2
        for plane, before in zip(self.planes, kept, strict=True):
            plane[:] = before
        return float(0.5 * (np.abs(depths) / self.packed[3]).sum())

    def look(self, places: Floats) -> None:
        """Take the tangent planes of the walls at places (n, 3), in the frame of the base."""
        origins, gaps, normals = self.planes
        origins[:] = places
        gaps[:] = math.inf
        seen = places @ self.axes.T
        margin = float(self.radii.max())
        for row, wall in enumerate(self.walls):
            found = wall.measure_near(seen, self.radii, self.before[1][row] > 0.0, margin)
            gaps[row, found.places] = found.gap
            normals[row, found.places] = found.gradient @ self.axes
        if self.introducer > 0.0:
            inside = places[:, 2] < self.introducer
            gaps[:, inside] = math.inf
            # Four flat sides: a body that is thrown across finds the one that it comes to.
            for row, (axis, side) in enumerate(((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0))):
                gaps[row - 4, inside] = PLAY_MM - side * places[inside, axis]
                normals[row - 4, inside, axis] = -side


def _number_steps(steps: NDArray[np.int64]) -> tuple[list[int], list[int]]:
    """Return row, and number in it, of every step."""
    rows = np.repeat(np.arange(len(steps)), steps)
    numbers = np.arange(len(rows)) - np.repeat(np.cumsum(steps) - steps, steps)
    return rows.tolist(), numbers.tolist()


def _run(
    rod: MovingRod,
    tendons: tuple[Floats, bool, NDArray[np.bool_], tuple[Floats, Floats, Floats, float]],
    tables: tuple[Floats, ...],
    contacts: _Contacts,
    course: tuple[NDArray[np.int64], int],
    state: RodMotion,
) -> ShapeHistory:
    steps, fresh = course
    count, stations, strings = len(tables[0]), len(rod.grid.arc_length), len(tendons[0])
    frames = np.zeros((count, stations, 4, 4))
    rotations = np.empty((count, stations, 3, 3))
    places, velocities = np.empty((2, count, stations, 3))
    pulls, lengths = np.empty((2, count, strings))
    energies, iterations = np.zeros((count, 8)), np.zeros(count, dtype=np.int64)
    forces, gaps = np.zeros((count, stations, 3)), np.full((count, stations), math.inf)
    rho = rod.options.spectral_radius
    alpha_m, alpha_f = 0.5 * (3.0 - rho) / (1.0 + rho), 1.0 / (1.0 + rho)
    scheme = alpha_m, alpha_f, 0.5 + alpha_m - alpha_f, rod.options.step_tolerance or 0.0
    filled = rotations, places, velocities, pulls, lengths, energies, iterations, forces, gaps
    rubs = len(rod.rubbing[0]) > 0
    memory = kernels.make_memory(len(rod.grid.spans), len(rod.points.parts), strings, rubs)
    along = memory[2][7][1]
    if rubs and fresh == 1:
        for kept, known in zip(along, (state.pulls, state.shares, state.beyond), strict=True):
            kept[:] = known

    def advance(first: tuple[int, float], end: tuple[int, float], fresh: int) -> int:
        window = *first, *end, steps, fresh
        return int(
            kernels.advance(
                rod.packed, tendons, tables, contacts.packed, scheme, window,
                (*tuple(state)[:4], state.ground), memory, filled,
            )
        )  # fmt: skip

    if not contacts.walls:
        reached = advance((0, 0.0), (count - 1, 0.0), fresh)
    else:
        moved = memory[0][0][0]  # places and velocities of the last stage
        contacts.before[2][:] = _place_ends(rod, state, tables[1][0, 3])
        contacts.look(contacts.before[2])
        if fresh == 2:
            contacts.check_start()
            if contacts.planes[1].min() >= 0.0:  # an equilibrium beside walls knows of none
                contacts.planes[1][:] = math.inf
        reached = advance((0, 0.0), (0, 0.0), fresh)
        contacts.before[2][:] = moved[1][1:]
        totals: Floats = memory[4]
        changed: list[Floats] = [
            *state[:4], state.ground, memory[3], totals, *contacts.before, *along
        ]  # fmt: skip
        sizes = np.repeat(np.diff(tables[0]) / steps, steps)
        for row, step, size in zip(*_number_steps(steps), sizes.tolist(), strict=True):
            done, part = float(step), 1.0
            while done < step + 1.0 and reached == count:
                kept = [array.copy() for array in changed]
                part, least = min(part, step + 1.0 - done), part <= kernels.LEAST_CALM
                there = moved[1][1:] + part * size * moved[2][1:]
                motion = moved[1].copy(), moved[2].copy()
                for attempt in range(MOST_LOOKS):
                    contacts.look(there)
                    reached = advance((row, done), (row, done + part), 0)
                    if reached != count:
                        break
                    there = moved[1][1:].copy()
                    missed = contacts.miss_energy(there)
                    good = missed <= PLANE_ENERGY * totals[12]
                    if good or (least and attempt + 1 == MOST_LOOKS):
                        break
                    for array, before in zip(changed, kept, strict=True):
                        array[:] = before
                else:
                    reached = kernels.GAINED
                if reached == kernels.GAINED:
                    reached, part = count, 0.5 * part
                    for array, before in zip((moved[1], moved[2]), motion, strict=True):
                        array[:] = before
                    continue
                done += part
                part *= 2.0
    frames[..., :3, :3], frames[..., :3, 3], frames[..., 3, 3] = rotations, places, 1.0
    reason = ""
    if reached < count:
        reason = (
            f"no answer was found between {tables[0][max(reached - 1, 0)]:g} and "
            f"{tables[0][reached]:g} s, with the least step; the robot may fold over"
            + (" or be pressed into a wall" if contacts.walls else "")
        )
    own = max(reached, 1)
    # What is free of tension is as long as the limit of a length that is held.
    free = tables[-1] if tendons[1] else lengths
    kinds = ("kinetic", "elastic", "gravity", "tendons", "work", "dissipated", "walls", "friction")
    pulls_along, shares, beyond = along
    return ShapeHistory(
        robot=rod.robot,
        time=tables[0][:own],
        arc_length=rod.grid.arc_length,
        frames=frames[:own],
        velocities=velocities[:own],
        tensions=pulls[:own],
        displacements=rod.find_limits(free)[:own],
        wall_forces=forces[:own],
        gaps=gaps[:own],
        energy=EnergyBalance(**{kind: energies[:own, k] for k, kind in enumerate(kinds)}),
        iterations=iterations[:own],
        reason=reason,
        rod=rod,
        state=state._replace(
            slips=contacts.before[0],
            normal_forces=contacts.before[1],
            pulls=pulls_along,
            shares=shares,
            beyond=beyond,
        ),
    )


def _place_ends(rod: MovingRod, state: RodMotion, base: Floats) -> Floats:
    """Return the ends of segments (n, 3) in a state; `base` is its place and rotation vector."""
    from scipy.spatial.transform import Rotation

    ends = rod.grid.place_frames(state.rotation_vectors[None])[0, 1:, :3, 3]
    free = len(state.ground) > 0
    turn = state.ground[:3] if free else Rotation.from_rotvec(base[3:]).as_matrix()
    return np.asarray(ends @ turn.T + (state.ground[3] if free else base[:3]))


def _take_commands(
    rod: MovingRod, count: int, tensions: ArrayLike | None, displacements: ArrayLike | None
) -> tuple[Floats, bool]:
    """Return commands (k, t), and whether they are displacements."""
    robot = rod.robot
    if tensions is not None and displacements is not None:
        raise InputError("tensions and displacements are given: command one of them")
    if displacements is None:
        none = np.zeros(len(robot.tendons))
        command = check_tension_commands(robot, none if tensions is None else tensions)
    else:
        command = check_displacements(robot, displacements)
        check_pretensions(robot, command, rod.compliances)
        for index in np.flatnonzero(rod.compliances == 0.0):
            raise InputError(
                f"tendon '{robot.tendon_names[index]}' does not stretch: give it a stiffness, or "
                "tendon_stiffness, for its displacement to be commanded in time"
            )
    if command.shape not in ((len(robot.tendons),), (count, len(robot.tendons))):
        raise InputError(
            f"commands have shape {command.shape}: they must be {(count, len(robot.tendons))}, a "
            "row for each time"
        )
    whole = np.array(np.broadcast_to(command, (count, len(robot.tendons))))
    return whole, displacements is not None


def _take_base(times: Floats, base: ArrayLike | None) -> Floats:
    """Return coefficients (k - 1, 4, 6) of place and rotation vector of the base by time."""
    if base is None:
        return np.zeros((len(times) - 1, 4, 6))
    frames = check_array("base", base)
    if frames.shape != (len(times), 4, 4):
        raise InputError(f"base has shape {frames.shape}: it must be {(len(times), 4, 4)}")
    for index, frame in enumerate(frames):
        check_frame(f"base[{index}]", frame)
    from scipy.interpolate import CubicHermiteSpline, CubicSpline
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_matrix(frames[:, :3, :3]).as_rotvec()
    for index in range(1, len(turns)):  # a rotation has many vectors: the one next to the last
        angle = float(np.linalg.norm(turns[index]))
        if angle > 0.0:
            way = turns[index] / angle
            whole = np.round((turns[index - 1] @ way - angle) / (2.0 * math.pi))
            turns[index] += 2.0 * math.pi * whole * way
    values = np.concatenate([frames[:, :3, 3], turns], axis=1)
    spline = CubicSpline(times, values)
    slopes, still = spline(times, 1), (np.diff(values, axis=0) == 0.0).all(axis=1)
    if still.any() and not still.all():
        # No further than where it stops: flat there, and in the piece beside that monotone.
        between = np.diff(values, axis=0) / np.diff(times)[:, None]
        for index in np.flatnonzero(still).tolist():
            slopes[index : index + 2] = 0.0
            for piece, end in ((index - 1, index - 1), (index + 1, index + 2)):
                if 0 <= piece < len(between) and not still[piece]:
                    most = 3.0 * np.abs(between[piece])
                    same = slopes[end] * between[piece] > 0.0
                    slopes[end] = np.where(same, np.clip(slopes[end], -most, most), 0.0)
        spline = CubicHermiteSpline(times, values, slopes)
    return np.ascontiguousarray(spline.c.transpose(1, 0, 2))


MODES_SHOWN = 6
"""Modes of a picture of the response."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearDynamics(ClosedForm):
    """Small oscillations of a robot about an equilibrium, ``m`` modes from the slowest on.

    Parameters
    ----------
    robot : RobotDesign
        The robot.
    arc_length : (s,) ndarray
        Stations [mm].
    frames : (s, 4, 4) ndarray
        Frames of the equilibrium at the stations [mm].
    tensions : (t,) ndarray
        Tensions of the tendons in the equilibrium [N].
    frequency : (m,) ndarray
        Of the modes without damping [Hz].
    damping_ratio : (m,) ndarray
        Of each mode by itself, of critical damping.
    modes : (m, s, 3) ndarray
        Motion of the stations in each mode; its kinetic energy at rate 1 is 1/2 [mm].
    stiffness, damping, mass : (3 n, 3 n) ndarray
        By the rotation vectors of the segments [N mm], [N mm s], [N mm s^2].
    by_command : (3 n, t) ndarray
        Forces on these by tensions [N mm/N], or by displacements [N mm/mm].
    tip_jacobian : (3, 3 n) ndarray
        Motion of the tip by these [mm/rad].
    vectors : (m, 3 n) ndarray
        The modes in these.
    given : {"tensions", "displacements"}
        What of the tendons is commanded.
    """

    robot: RobotDesign = field(repr=False)
    arc_length: Floats
    frames: Floats
    tensions: Floats
    frequency: Floats = tabulated("Hz")
    damping_ratio: Floats = tabulated()
    modes: Floats
    stiffness: Floats = field(repr=False)
    damping: Floats = field(repr=False)
    mass: Floats = field(repr=False)
    by_command: Floats = field(repr=False)
    tip_jacobian: Floats = field(repr=False)
    vectors: Floats = field(repr=False)
    given: Held

    def state_space(self, modes: int | None = None) -> StateSpace:
        """Return the system from commands of tendons to the tip, about the equilibrium.

        Its states are the amplitudes of the slowest `modes`, all unless given, then their rates;
        inputs are tensions [N] or displacements [mm], outputs the motion of the tip [mm].

        Raises
        ------
        InputError
            If there are not so many modes.
        """
        from scipy.signal import StateSpace

        most = len(self.frequency)
        count = most if modes is None else check_integer("modes", modes, low=1, high=most)
        own = self.vectors[:count]
        zero, one = np.zeros((count, count)), np.eye(count)
        inner = np.diag((2.0 * math.pi * self.frequency[:count]) ** 2)
        inputs, outputs = own @ self.by_command, self.tip_jacobian @ own.T
        return StateSpace(
            np.block([[zero, one], [-inner, -own @ self.damping @ own.T]]),
            np.concatenate([np.zeros_like(inputs), inputs]),
            np.concatenate([outputs, np.zeros_like(outputs)], axis=1),
            np.zeros((3, inputs.shape[1])),
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw how far the slowest modes move the stations across the robot."""
        axes = take_axes(ax, x="arc length [mm]", y="motion, by the largest")
        for mode, frequency in zip(self.modes[:MODES_SHOWN], self.frequency, strict=False):
            _, _, ways = np.linalg.svd(mode, full_matrices=False)
            along = mode @ ways[0]
            axes.plot(self.arc_length, along / np.abs(along).max(), label=f"{frequency:.4g} Hz")
        return axes


def linearise(
    robot: RobotDesign,
    *,
    tensions: ArrayLike | None = None,
    displacements: ArrayLike | None = None,
    loads: Sequence[Load] = (),
    options: DynamicsOptions = DEFAULT_OPTIONS,
) -> LinearDynamics:
    """Return small oscillations about the equilibrium under tendons and loads.

    Parameters
    ----------
    robot, options
        As of `simulate`.
    loads : sequence of PointLoad or LineLoad
        Forces in the axes of the base or the world. Moments of fixed axes have no energy, as loads
        that turn with the body: modes are not of their kind, and `simulate` takes them.
    tensions, displacements : (t,) array_like or mapping, optional
        Of the tendons [N], [mm]; what is given is held, and is the input of the state space.

    Returns
    -------
    LinearDynamics

    Raises
    ------
    InputError
        If an argument does not fit.
    GeometryError
        If a part of the robot has no mass, or there is no stable equilibrium.
    """
    check_robot(robot)
    check_kind("options", options, DynamicsOptions)
    rod = MovingRod(robot, options, check_loads(robot, loads))
    if rod.load_vectors[2].size:
        raise InputError(
            "a load is given in the axes of the body: small oscillations are of loads in those of "
            "the base or the world"
        )
    if rod.load_vectors[1].any():
        raise InputError(
            "a load has a moment: small oscillations are of forces, a moment of fixed axes has no "
            "energy (simulate takes it)"
        )
    command, held = _take_commands(rod, 1, tensions, displacements)
    factors = np.ones(len(rod.loads))
    found = rod.find_equilibrium(command[0], held=held, factors=factors, turned=np.eye(3))
    q, points, grid = found.rotation_vectors, rod.points, rod.grid
    places = points.segments, points.parts, np.zeros((len(points.parts), 3))
    moved = grid.move_stations(q, places)
    axes = np.empty((len(points.parts), 3, 3))
    locate_stations(grid.packed, q, places, np.empty((len(axes), 3)), axes, np.empty((0, 6, 1)))
    inertias = np.einsum("pik,pk,pjk->pij", axes, points.inertias, axes)
    mass = np.einsum("pia,p,pib->ab", moved[:, 3:], points.masses, moved[:, 3:])
    mass += np.einsum("pia,pij,pjb->ab", moved[:, :3], inertias, moved[:, :3])
    damping = np.einsum("pia,p,pib->ab", moved[:, 3:], points.drags, moved[:, 3:])
    damping += np.diag(rod.damping.ravel())
    rows = found.length_gradients.reshape(len(found.tensions), q.size)
    by_command, stiffness = -rows.T, found.hessian
    if held:  # a displacement shortens the tendon, and pulls by its stiffness
        taut = (found.tensions > 0.0) | robot.pushes
        by_command = by_command * (taut / rod.compliances)
        stiffness = stiffness - by_command @ rows
    stiffness = 0.5 * (stiffness + stiffness.T)
    from scipy.linalg import eigh

    # The softest modes are the largest eigenvalues of the inverse problem, and come out best.
    try:
        flexible, vectors = eigh(mass, stiffness)
    except np.linalg.LinAlgError:
        raise GeometryError(
            "the equilibrium is not stable: take a smaller load or command"
        ) from None
    flexible, vectors = flexible[::-1], vectors[:, ::-1].T
    vectors = vectors / np.sqrt(flexible)[:, None]  # of mass 1, where they were of stiffness 1
    angular = 1.0 / np.sqrt(flexible)
    ends = np.arange(len(grid.spans)), np.ones(len(grid.spans)), np.zeros((len(grid.spans), 3))
    stations = np.concatenate([np.zeros((1, 3, q.size)), grid.move_stations(q, ends)[:, 3:]])
    return LinearDynamics(
        robot=robot,
        arc_length=grid.arc_length,
        frames=grid.place_frames(q[None])[0],
        tensions=found.tensions,
        frequency=angular / (2.0 * math.pi),
        damping_ratio=np.einsum("ma,ab,mb->m", vectors, damping, vectors) / (2.0 * angular),
        modes=np.einsum("sia,ma->msi", stations, vectors),
        stiffness=stiffness,
        damping=damping,
        mass=mass,
        by_command=by_command,
        tip_jacobian=stations[-1],
        vectors=vectors,
        given="displacements" if held else "tensions",
    )
