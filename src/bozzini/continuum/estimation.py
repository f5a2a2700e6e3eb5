"""Where a robot is: shape, forces and slow errors from its model and its sensors, with intervals.

The state ``x`` (q,) is all that the model does not know: how the body is curved beside what it
computes, the stiffness of its sections, the zeros of its tendons and how they act on each other,
the pose of its base, constant errors of sensors, and loads. Each number has a normal distribution
before anything is read, of the sizes in `ModelError`; the unknown curvature is a Gaussian process
along the length. The elastic model makes a shape of commands and state, which sensors read::

    K (w - u - e(x)) + sum_k T_k dl_k/dw - loads(w, x) = 0 ,   l_k - c_k T_k = limit_k - zero_k(x)

With the covariance ``P`` of the state as it was, what is most likely after readings ``y`` with
noise ``R`` minimises ``(x - x0) P^-1 (x - x0) + (y - h(x)) R^-1 (y - h(x))``, by Gauss and Newton
with the exact derivatives of the equilibrium, and steps that are halved until it falls. Over time
each number forgets (`ModelError.memory`) or stays, which makes it an iterated Kalman filter: Bell
and Cathey, IEEE Transactions on Automatic Control 38 (1993) 294.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_kind, check_number, check_word
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..results import Shown
from .calibration import Command
from .checks import check_items
from .coupling import check_displacements
from .elastic import check_tension_commands
from .energy import STIFF, EnergyModel
from .equilibrium import LumpedLoads, TendonCommand
from .estimate_walls import PackedGrid, PressedRod, PressingWalls, WallPush
from .kernels.energy import CONVERGED
from .kernels.equilibrium import make_state, solve_equilibrium
from .kernels.loads import locate_stations
from .model_error import ModelError, UnknownLoad
from .observation import apply_screw
from .robot import RobotDesign
from .sensors import BodySensor, Miss, Sensed, TensionSensor
from .shape_estimate import (
    LIMIT,
    EstimatedContact,
    EstimatedLoad,
    EstimatorState,
    ShapeEstimate,
    measure_sizes,
)
from .walls import Wall, take_boundaries

MODES_LEFT = 1e-4
"""Share of the variance of the unknown curvature that modes may leave out."""
MOST_STEPS = 50
"""Steps of Gauss and Newton."""
SETTLED = 0.03
"""Step that ends the search, in standard deviations after the readings."""
ROUND_OFF = 1e-10
"""Share of a variance that keeps the covariance positive."""
MOST_TRIES, DAMPED_MORE, DAMPED_LESS, MOST_DAMPING = 25, 4.0, 0.125, 1e3
"""Tries of one step, by what its damping grows and falls, and that at which it says nothing."""
INNER_STEPS, INNER_TOLERANCE = 40, 1e-6
"""Steps of Newton's method for an equilibrium, and the error of a tendon's length [mm]."""
TAUT_OVER, MOST_SLACK = 0.001, 30.0
"""Length over which a cable becomes taut, by its offset; that counts as slack, by this length."""
TAUT_STEPS, TAUT_SHARE, TAUT_LEAST = 30, 1e-6, 1e-7
"""Steps to the tensions of cables, and their error, as a share of the largest and [N]."""
NO_SHAPE = "the model has no shape under these commands"
PLACE_STEP = 1e-3
"""Step for the derivative by the place of a load [mm]."""
LEAST_STRIDE, MOST_STRIDE, STRIDE_GROWTH, MOST_STRIDES = 5e-4, 0.02, 1.25, 40
"""Strides from a place to those beside it, by the length: the first at least, most, and growth."""
FAR, TAIL = 8.0, 0.025
"""Where a place counts as impossible, and the share beyond each end of an interval."""
KEPT = ("_modes", "_walls", "_stations", "_weights", "_base", "_compliances", "_ends")
"""What an estimator shares with one that knows the place of a load."""
DOUBTED, TURNED, BETTER = 0.01, 0.5, 0.1
"""Chance of a fit below which other cables are tried taut or slack, how far, by the deviation of
their zeros, and by what a cost must fall."""
FRESH = 0.99
"""Share of the first variance of a load's place from which on nothing is known of it."""
TRIED_PLACES, BEST_PLACES = 24, 3
"""Places where an unknown load is tried, and from how many of them it is searched."""


class _Part(NamedTuple):
    """Numbers that belong together, of which those with a deviation are in the state."""

    names: tuple[str, ...]
    whole: Floats
    inside: NDArray[np.int64]
    memory: float | None

    @classmethod
    def make(
        cls, names: Sequence[str], deviations: ArrayLike, *, memory: float | None = None
    ) -> _Part:
        """Return so many numbers of these standard deviations, or of one."""
        whole = np.broadcast_to(np.asarray(deviations, dtype=np.float64), (len(names),))
        inside = np.flatnonzero(whole)
        chosen = tuple(names[int(k)].replace(" []", "") for k in inside)
        return cls(chosen, whole, inside, memory)


_Start: TypeAlias = tuple[Floats, Floats]
"""Rotation vectors, and lengths of tendons, to begin with."""


class _Body(NamedTuple):
    """An equilibrium of one state, and its derivatives by the state."""

    found: bool
    rotation_vectors: Floats
    tensions: Floats
    lengths: Floats
    turned: Floats = np.empty(0)
    pulled: Floats = np.empty(0)
    push: WallPush | None = None


class _Fit(NamedTuple):
    """A state with its equilibrium: what readings miss there, and slopes, by the noise."""

    mean: Floats
    body: _Body
    missed: Floats
    slopes: Floats
    noises: tuple[Floats, ...] = ()
    kept: tuple[NDArray[np.int64], ...] = ()
    cost: float = math.inf
    steps: int = 0
    settled: bool = False


@dataclass(frozen=True, kw_only=True)
class ShapeEstimator(Shown):
    """Finds the shape of a robot, and what acts on it, from commands and sensors.

    Parameters
    ----------
    model : EnergyModel
        The robot with its known loads. Tendons have no friction here: what it does is part of the
        errors that have a `memory`. Tendons that do not stretch get a little flexibility.
    sensors : sequence of BodySensor
        What may be read.
    error : ModelError
        How far the model may be wrong.
    loads : sequence of UnknownLoad
        Loads that are looked for.
    command : {"displacement", "tension"}
        What is commanded of the tendons.
    duct : Duct, optional
        Lumen that the body is in, by balls of its radius about the stations but the first.
    wall_stiffness : float, optional
        Force of the wall per length of the body and depth [MPa]; rigid unless given.

    Raises
    ------
    InputError
        If a sensor or a load is not on the robot, two sensors have one name, or the duct is none.
    """

    model: EnergyModel
    sensors: Sequence[BodySensor] = ()
    error: ModelError = ModelError()
    loads: Sequence[UnknownLoad] = ()
    command: Command = "displacement"
    duct: Wall | None = None
    wall_stiffness: float | None = None

    def __post_init__(self) -> None:
        check_kind("model", self.model, EnergyModel)
        check_kind("error", self.error, ModelError)
        check_word("command", self.command, get_args(Command))
        object.__setattr__(self, "sensors", check_items("sensors", self.sensors, BodySensor))
        object.__setattr__(self, "loads", check_items("loads", self.loads, UnknownLoad))
        names, length = [sensor.name for sensor in self.sensors], self.robot.length
        for sensor in self.sensors:
            if names.count(sensor.name) > 1:
                raise InputError(f"there are two sensors '{sensor.name}': give each its own name")
            if isinstance(sensor, TensionSensor) and sensor.name not in self.robot.tendon_names:
                raise InputError(
                    f"sensor '{sensor.name}' is of no tendon: they are "
                    f"{', '.join(self.robot.tendon_names)}"
                )
        items: tuple[BodySensor | UnknownLoad, ...] = (*self.sensors, *self.loads)
        for item in items:
            if item.arc_length is not None and item.arc_length > length:
                what = "sensor" if isinstance(item, BodySensor) else "load"
                raise InputError(
                    f"{what}'s arc_length is {item.arc_length:g} mm: it must lie in [0, "
                    f"{length:g}] mm, the robot's length"
                )
        if self.wall_stiffness is not None:
            check_number("wall_stiffness", self.wall_stiffness, low=0.0, low_open=True, unit="MPa")
        _ = self._walls

    @property
    def robot(self) -> RobotDesign:
        """The robot."""
        return self.model.robot

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers of the state, with their units."""
        return tuple(name for part in self._parts.values() for name in part.names)

    def begin(self) -> EstimatorState:
        """Return what is known before anything is read."""
        rest, spread = self.model.rod.rest, np.diag(self._deviations**2)
        return EstimatorState(self._first, spread, rest, self.model.natural_lengths)

    def wait(self, state: EstimatorState, elapsed: float = 1.0) -> EstimatorState:
        """Return what is known of it later, after so many seconds without a reading."""
        check_number("elapsed", elapsed, low=0.0, unit="s")
        self._check_state(state)
        first = self._first
        kept, grown = self.fade(elapsed)
        covariance = kept[:, None] * state.covariance * kept + np.diag(grown)
        mean = first + kept * (state.mean - first)
        return dataclasses.replace(state, mean=mean, covariance=covariance)

    def fade(self, elapsed: float) -> tuple[Floats, Floats]:
        """Return the share of each number of the state left after so many seconds, and its gain.

        The gain is the variance that is added.
        """
        share = self._forget(elapsed)
        lasts = np.isnan(share)
        kept = np.where(lasts, 1.0, share)
        grown = np.where(lasts, self.error.drift**2 * elapsed, 1.0 - kept**2)
        return kept, grown * self._deviations**2

    def estimate(
        self,
        commands: ArrayLike,
        readings: Mapping[str, ArrayLike] = MappingProxyType({}),
        *,
        state: EstimatorState | None = None,
    ) -> ShapeEstimate:
        """Return the shape under commands, from what was known before and readings of now.

        Parameters
        ----------
        commands : array_like, shape (t,)
            Displacements [mm] or tensions [N] of the tendons.
        readings : mapping
            By name of the sensor, in mm, N, rad; NaN, or none, where it read nothing. Without any
            it is the prediction.
        state : EstimatorState, optional
            What was known before: that of the last estimate, after `wait`; nothing unless given.

        Raises
        ------
        InputError
            If a command or a reading is not legal.
        """
        asked = self._take_commands(commands)
        read = self._take_readings(readings)
        before = self.begin() if state is None else state
        self._check_state(before)
        start = before.rotation_vectors, before.lengths
        nominal = start if before.nominal is None else (before.nominal, before.lengths)
        alone = self._solve(asked, np.zeros(len(before.mean)), nominal, None)
        if self._walls is not None and state is None:
            before = dataclasses.replace(before, rotation_vectors=alone.rotation_vectors)
        short = self.model.natural_lengths - alone.lengths
        best = self._search(asked, read, before, short)
        if state is None and read and best.body.found:
            best = self._try_cables(asked, read, before, short, best)
        fresh = [k for k in range(len(self.loads)) if read and self._is_fresh(k, before)]
        for index in fresh:
            if best.body.found:
                for trial in self._try_places(asked, read, index, (before, best), short):
                    other = self._search(asked, read, before, short, start=trial)
                    best = other if other.cost < best.cost else best
        found = self._describe(before, best, alone)
        if not found.converged or not fresh:
            return found
        loads = list(found.loads)
        for index in fresh:
            known = before, best, short
            loads[index] = self._profile_place(asked, read, index, known, loads[index])
        return dataclasses.replace(found, loads=tuple(loads))

    def predict(
        self, commands: ArrayLike, *, state: EstimatorState | None = None
    ) -> dict[str, Floats]:
        """Return what sensors read of a state without noise, by name; of none, the model alone.

        Raises
        ------
        InputError
            If a command is not legal, or a sensor's reading depends on more than the body.
        GeometryError
            If there is no shape.
        """
        asked, own = self._take_commands(commands), self.begin() if state is None else state
        start = own.rotation_vectors, own.lengths
        alone = self._solve(asked, 0.0 * own.mean, start, None)
        near = alone.rotation_vectors, alone.lengths
        body = self._solve(asked, own.mean, near, self.model.natural_lengths - alone.lengths)
        if not body.found:
            raise GeometryError(NO_SHAPE)
        biases, seen = self._read("sensors", own.mean), self._sense(own.mean, body)
        return {
            sensor.name: sensor.predict(one) + bias
            for sensor, one, bias in zip(self.sensors, seen, biases, strict=True)
        }

    def miss(
        self, commands: ArrayLike, readings: Mapping[str, ArrayLike], *, state: EstimatorState
    ) -> tuple[Floats, Floats]:
        """Return what readings miss of a prediction, and the standard deviations expected of it.

        All numbers of all sensors, in their units; NaN where one read nothing. Of a sight it is
        the distance across the ray, two numbers, the rest NaN.
        """
        asked, read = self._take_commands(commands), self._take_readings(readings)
        start = state.rotation_vectors, state.lengths
        alone = self._solve(asked, 0.0 * state.mean, start, None)
        short = self.model.natural_lengths - alone.lengths
        fit = self._evaluate(asked, read, state.mean, start=start, short=short)
        counts = [sensor.count for sensor in self.sensors]
        both = np.full((2, sum(counts)), np.nan)
        spread = np.einsum("ki,ij,kj->k", fit.slopes, state.covariance, fit.slopes) + 1.0
        first, ends = 0, np.cumsum(counts)
        for k, noise, kept in zip(read, fit.noises, fit.kept, strict=False):  # none without a shape
            to = ends[k] - counts[k] + kept
            own = slice(first, first + len(noise))
            both[:, to] = fit.missed[own] * noise, np.sqrt(spread[own]) * noise
            first += len(noise)
        return both[0], both[1]

    def linearise(
        self, commands: ArrayLike, readings: Mapping[str, ArrayLike], *, state: EstimatorState
    ) -> tuple[Floats, Floats, EstimatorState]:
        """Return what readings miss of the model alone and slopes by the state, by their noise.

        And the state, to begin the next one from.
        """
        asked, read = self._take_commands(commands), self._take_readings(readings)
        none, start = 0.0 * state.mean, (state.rotation_vectors, state.lengths)
        alone = self._solve(asked, none, start, None)
        near = alone.rotation_vectors, alone.lengths
        short = self.model.natural_lengths - alone.lengths
        fit = self._evaluate(asked, read, none, start=near, short=short)
        after = dataclasses.replace(state, rotation_vectors=near[0], lengths=near[1])
        return fit.missed, fit.slopes, after if alone.found else state

    def find_slopes(self, commands: ArrayLike) -> tuple[list[Floats], Floats]:
        """Return how readings and shape depend on the state, where the model makes no error.

        Of each sensor by its noise, (k, q); and rotation and place of the stations, (n, 6, q).

        Raises
        ------
        GeometryError
            If the model has no shape under these commands.
        """
        asked, state = self._take_commands(commands), self.begin()
        none, start = 0.0 * state.mean, (state.rotation_vectors, state.lengths)
        alone = self._solve(asked, none, start, None)
        near = alone.rotation_vectors, alone.lengths
        body = self._solve(asked, none, near, self.model.natural_lengths - alone.lengths)
        if not body.found:
            raise GeometryError(NO_SHAPE)
        slopes, biased = [], self._parts["sensors"].inside.tolist()
        for k, (sensor, seen) in enumerate(zip(self.sensors, self._sense(none, body), strict=True)):
            miss = sensor.compare(sensor.predict(seen), seen)
            own = miss.slopes.copy()
            if k in biased:
                own[:, self._slices["sensors"].start + biased.index(k)] += 1.0
            slopes.append(own / miss.deviations[:, None])
        arc = self.model.rod.grid.arc_length
        return slopes, self._place(none, body, find_stations(arc, arc))[2]

    def measure_scale(self, other: ShapeEstimator) -> Floats:
        """Return by what slopes by this one's state are to be multiplied for that of another."""
        scale = np.ones(len(self._deviations))
        own = self._slices["curvature"]
        sizes = [np.linalg.norm(one._modes, axis=0) for one in (self, other)]
        scale[own] = sizes[1] / sizes[0]
        return scale

    # What the state is made of.

    @cached_property
    def _modes(self) -> Floats:
        """Modes of the unknown curvature, as rotations of the segments (3 n, r) [rad]."""
        grid, error = self.model.rod.grid, self.error
        middles = 0.5 * (grid.arc_length[1:] + grid.arc_length[:-1])
        apart = (middles[:, None] - middles) / error.reach
        sizes, ways = np.linalg.eigh(np.exp(-0.5 * apart**2))
        left = np.cumsum(sizes) / sizes.sum()  # from the smallest on
        own = (ways * np.sqrt(np.maximum(sizes, 0.0)))[:, left > MODES_LEFT][:, ::-1]
        deviations = np.array([error.curvature, error.curvature, error.twist])
        columns: list[Floats] = [
            (grid.spans * column)[:, None] * (deviations * np.eye(3)[axis])
            for axis in np.flatnonzero(deviations)
            for column in own.T
        ]
        return np.array(columns).reshape(len(columns), 3 * len(grid.spans)).T

    @cached_property
    def _parts(self) -> dict[str, _Part]:
        error, robot, count = self.error, self.robot, self._modes.shape[1]
        kept = math.inf if error.memory is None else error.memory
        tendons, pulled = robot.tendon_names, self.command == "tension"
        labels = [robot.section_label(k) for k in range(len(robot.sections))]
        unit = "N" if pulled else "mm"
        parts = {
            "curvature": _Part.make([f"curvature {k}" for k in range(count)], 1.0, memory=kept),
            "stiffness": _Part.make([f"stiffness of {label}" for label in labels], error.stiffness),
            "zero": _Part.make(
                [f"zero of {name} [{unit}]" for name in tendons],
                error.pull if pulled else error.zero,
                memory=kept,
            ),
            "coupling": _Part.make(
                [f"coupling of {a} by {b}" for a in tendons for b in tendons], error.coupling
            ),
            "rotation": _Part.make([f"base rotation {k} [rad]" for k in "xyz"], error.rotation),
            "position": _Part.make(
                [f"base position {k} [mm]" for k in "xyz"], error.position, memory=kept
            ),
            "sensors": _Part.make(
                [f"bias of {one.name} [{one.unit}]" for one in self.sensors],
                np.array([one.bias for one in self.sensors]),
            ),
        }
        for index, load in enumerate(self.loads):
            label = f"load {index + 1}"
            names = [f"{label} force {axis} [N]" for axis in "xyz"]
            names += [f"{label} moment {axis} [N mm]" for axis in "xyz"]
            parts[f"load {index}"] = _Part.make(names, load.deviations, memory=load.memory)
            spread = robot.length if load.arc_length is None else 0.0
            parts[f"place {index}"] = _Part.make(
                [f"{label} place [mm]"], spread, memory=load.memory
            )
        return parts

    @cached_property
    def _slices(self) -> dict[str, slice]:
        ends = np.cumsum([0, *(len(part.inside) for part in self._parts.values())]).tolist()
        pairs = zip(ends[:-1], ends[1:], strict=True)
        return {name: slice(*pair) for name, pair in zip(self._parts, pairs, strict=True)}

    @cached_property
    def _deviations(self) -> Floats:
        return np.concatenate([part.whole[part.inside] for part in self._parts.values()])

    @cached_property
    def _first(self) -> Floats:
        """What the numbers are before anything is read: a load is in the middle."""
        mean = np.zeros(len(self._deviations))
        for index, load in enumerate(self.loads):
            if load.arc_length is None:
                mean[self._slices[f"place {index}"]] = 0.5 * self.robot.length
        return mean

    def _check_state(self, state: EstimatorState) -> None:
        if state.mean.shape != self._first.shape:
            raise InputError(
                f"state has {state.mean.size} numbers: it must be of this estimator, which has "
                f"{self._first.size}"
            )

    def _forget(self, elapsed: float) -> Floats:
        """Return the share of each number that is left after a time; NaN of constants."""
        shares = []
        for part in self._parts.values():
            if part.memory is None:
                share = math.nan
            else:
                share = math.exp(-elapsed / part.memory) if part.memory else 0.0
            shares.append(np.full(len(part.inside), share))
        return np.concatenate(shares)

    def _read(self, name: str, mean: Floats) -> Floats:
        """Return all numbers of a part of a state, 0 where the model makes no error."""
        part = self._parts[name]
        values = np.zeros(len(part.whole))
        values[part.inside] = mean[self._slices[name]]
        return values

    def _place_load(self, index: int, mean: Floats) -> float:
        known = self.loads[index].arc_length
        place = float(mean[self._slices[f"place {index}"]][0]) if known is None else known
        return min(max(place, 0.0), self.robot.length)

    # Equilibria.

    @cached_property
    def _compliances(self) -> Floats:
        rod = self.model.rod
        return np.maximum(rod.compliances, STIFF * rod.grid.flexibility)

    def _load(self, mean: Floats) -> LumpedLoads:
        """Return the known loads and, behind them, the unknown ones of a state."""
        own, arc = self.model.rod.lumped_loads, self.model.rod.grid.arc_length
        if not self.loads:
            return own
        every = range(len(self.loads))
        sizes = np.array([self._read(f"load {k}", mean) for k in every])
        stations = find_stations(arc, [self._place_load(k, mean) for k in every])
        both = zip(own.places, stations, strict=True)
        segments, parts, offsets = (np.concatenate(pair) for pair in both)
        return LumpedLoads(
            segments=segments,
            parts=parts,
            offsets=offsets,
            forces=np.concatenate([own.forces, sizes[:, :3]]),
            moments=np.concatenate([own.moments, sizes[:, 3:]]),
            follows=np.concatenate([own.follows, np.ones(len(sizes), dtype=np.bool_)]),
        )

    def _solve(self, asked: Floats, mean: Floats, start: _Start, short: Floats | None) -> _Body:
        """Return the equilibrium under commands and a state; without `short` no derivatives."""
        rod, pulled = self.model.rod, self.command == "tension"
        grid, tendons = rod.grid, len(self.robot.tendons)
        acting = asked if pulled or short is None else short
        command = self._make_command(asked, mean, acting)
        stiffness = grid.stiffness * np.exp(self._read("stiffness", mean))[grid.sections][:, None]
        spans, _, paths, guides, counts, segment = grid.packed
        packed = spans, stiffness, paths, guides, counts, segment
        bent = rod.rest + (self._modes @ mean[self._slices["curvature"]]).reshape(-1, 3)
        lumped, held = self._load(mean), command.held
        if self._walls is not None:
            body, state = self._press(self._walls, mean, (packed, bent, lumped), command, start)
        else:
            body, state = self._balance((packed, bent, lumped), command, start)
        if short is None or not body.found:
            return body
        on_segments, on_commands = self._push(mean, body, (packed, bent), acting)
        _, compliances = self._stretch(body.lengths - command.free_lengths)
        slopes, size = state[2].reshape(tendons, -1), body.rotation_vectors.size
        matrix = np.zeros((size + int(held.sum()),) * 2)
        matrix[:size, :size] = state[6]
        matrix[:size, size:] = slopes[held].T
        matrix[size:, :size] = slopes[held]
        matrix[size:, size:] = -np.diag(compliances[held])
        by_tension = on_commands * pulled
        right = on_segments - slopes.T @ by_tension, -on_commands[held]
        solved = np.asarray(np.linalg.solve(matrix, np.concatenate(right)), dtype=np.float64)
        by_tension[held] = solved[size:]
        return body._replace(turned=solved[:size], pulled=by_tension)

    def _make_command(self, asked: Floats, mean: Floats, acting: Floats) -> TendonCommand:
        """Return what commands come to with the errors of a state."""
        tendons = len(self.robot.tendons)
        moved = asked + self._read("zero", mean)
        moved = moved + self._read("coupling", mean).reshape(tendons, tendons) @ acting
        pulled = self.command == "tension"
        return self.model.make_command(moved, "tensions" if pulled else "displacements")

    def _balance(
        self, rod: tuple[PackedGrid, Floats, LumpedLoads], command: TendonCommand, start: _Start
    ) -> tuple[_Body, tuple[Floats, ...]]:
        """Return the equilibrium of a grid, its rest and loads, and what the kernel knows of it."""
        (packed, bent, lumped), held = rod, command.held
        never = np.zeros(len(held), dtype=np.bool_)
        loads = lumped.places, (lumped.forces, lumped.moments, lumped.follows)
        state = make_state(len(bent), len(held))
        turned, lengths = (array.copy() for array in start)
        found = False
        for _ in range(TAUT_STEPS):
            # A cable is a spring on both sides, of the stiffness that it has at this length.
            pulls, compliances = self._stretch(lengths - command.free_lengths)
            free = lengths - compliances * pulls
            whole = (
                packed,
                bent,
                (compliances, held, never, 1.0 * command.pulls, 0.0 * pulls),
                *loads,
            )
            code, *_ = solve_equilibrium(
                whole, free, INNER_TOLERANCE, INNER_STEPS, turned, pulls, state
            )
            if code != CONVERGED:
                break
            lengths = state[0].copy()
            least, compliances = self._stretch(lengths - command.free_lengths)
            off = np.abs(least - state[1])[held]
            if off.max(initial=0.0) <= TAUT_SHARE * np.abs(least).max(initial=0.0) + TAUT_LEAST:
                found = True
                break
        return _Body(found, turned, state[1], lengths), state

    @cached_property
    def _walls(self) -> PressingWalls | None:
        if self.duct is None:
            return None
        origin = self._base[:3, 3]
        walls = tuple(
            dataclasses.replace(wall, origin=origin) for wall in take_boundaries(self.duct, ())
        )
        return PressingWalls(walls, self.robot, self.model.rod.grid.arc_length, self.wall_stiffness)

    def _press(
        self,
        walls: PressingWalls,
        mean: Floats,
        rod: tuple[PackedGrid, Floats, LumpedLoads],
        command: TendonCommand,
        start: _Start,
    ) -> tuple[_Body, tuple[Floats, ...]]:
        """Return the equilibrium among walls, as `_balance` does."""

        def pull(lengths: Floats) -> tuple[Floats, Floats]:
            tensions, compliances = self._stretch(lengths - command.free_lengths)
            return np.where(command.held, tensions, command.pulls), command.held / compliances

        axes, place, _ = self._move_base(mean)
        pressed = PressedRod(*rod, pull, axes, place - self._base[:3, 3])
        found = walls.settle(pressed, start[0])
        if found is None:
            return _Body(False, *start[:1], 0.0 * start[1], start[1]), ()
        turned, state, push, _ = found
        return _Body(True, turned, state[1], state[0], push=push), state

    def _stretch(self, gaps: Floats) -> tuple[Floats, Floats]:
        """Return tensions of tendons longer than their free lengths by gaps, and compliances.

        A cable does not become taut at once: so what sensors read depends smoothly on all errors.
        """
        soft = TAUT_OVER * self.model.rod.grid.reach.max(axis=1)
        share = np.clip(gaps / soft, -MOST_SLACK, MOST_SLACK)
        grown = np.where(share < MOST_SLACK, soft * np.log1p(np.exp(share)), gaps)
        gone = 1.0 / (1.0 + np.exp(-share))
        pushes, give = self.model.rod.pushes, self._compliances
        return np.where(pushes, gaps, grown) / give, give / np.where(pushes, 1.0, gone)

    def _push(
        self, mean: Floats, body: _Body, segments: tuple[PackedGrid, Floats], acting: Floats
    ) -> tuple[Floats, Floats]:
        """Return what the numbers of a state do to the segments, and to the commands."""
        packed, bent = segments
        stiffness, slices, grid = packed[1], self._slices, self.model.rod.grid
        turned, tendons = body.rotation_vectors, len(self.robot.tendons)
        on_segments = np.zeros((turned.size, len(mean)))
        on_segments[:, slices["curvature"]] = stiffness.reshape(-1, 1) * self._modes
        own = grid.sections[:, None] == self._parts["stiffness"].inside
        stiffer = (stiffness * (bent - turned))[:, :, None] * own[:, None]
        on_segments[:, slices["stiffness"]] = stiffer.reshape(turned.size, -1)
        for index in range(len(self.loads)):
            place, length = self._place_load(index, mean), self.robot.length
            ends = max(place - PLACE_STEP, 0.0), min(place + PLACE_STEP, length)
            here, less, more = self._find_levers(packed, turned, [place, *ends])
            inside = self._parts[f"load {index}"].inside
            on_segments[:, slices[f"load {index}"]] = here[:, inside]
            change = (more - less) @ self._read(f"load {index}", mean) / (ends[1] - ends[0])
            known = self.loads[index].arc_length is not None
            on_segments[:, slices[f"place {index}"]] = change[:, None][:, known:]
        if body.push is not None and (self.error.rotation or self.error.position):
            # The wall presses a body whose base moves: elsewhere, and in other axes.
            axes, _, left = self._move_base(mean)
            places, _, levers = _locate(packed, turned, self._ends)
            forces, blocks, _ = body.push
            change = np.zeros((len(places), 3, len(mean)))
            if self.error.rotation:
                change[..., slices["rotation"]] = np.cross(forces[:, None], left.T).swapaxes(1, 2)
                moved = np.cross(left.T, (places @ axes.T)[:, None]).swapaxes(1, 2)
                change[..., slices["rotation"]] -= blocks @ moved
            if self.error.position:
                change[..., slices["position"]] = -blocks @ self._base[:3, :3]
            on_segments += np.einsum("pij,pik->jk", axes @ levers[:, 3:], change)
        on_commands = np.zeros((tendons, len(mean)))
        on_commands[:, slices["zero"]] = np.eye(tendons)[:, self._parts["zero"].inside]
        if self.error.coupling:
            on_commands[:, slices["coupling"]] = np.kron(np.eye(tendons), acting)
        return on_segments, on_commands

    def _find_levers(self, packed: PackedGrid, turned: Floats, places: Sequence[float]) -> Floats:
        """Return what a force and a moment in the body's axes do to the segments, (p, 3 n, 6)."""
        stations = find_stations(self.model.rod.grid.arc_length, places)
        _, axes, moved = _locate(packed, turned, stations)
        turning, moving = moved[:, :3].swapaxes(1, 2), moved[:, 3:].swapaxes(1, 2)
        return np.concatenate([moving @ axes, turning @ axes], axis=2)

    @cached_property
    def _base(self) -> Floats:
        return self.robot.base_frame

    def _move_base(self, mean: Floats) -> tuple[Floats, Floats, Floats]:
        """Return axes and place of the base in a state, and how rotations turn them (3, 3)."""
        from scipy.spatial.transform import Rotation

        axes, place = self._base[:3, :3], self._base[:3, 3]
        if self.error.position:
            place = place + axes @ self._read("position", mean)
        if not self.error.rotation:
            return axes, place, np.zeros((3, 3))
        turn = self._read("rotation", mean)
        left = axes @ apply_screw(turn, np.eye(3)).T
        return axes @ Rotation.from_rotvec(turn).as_matrix(), place, left

    @cached_property
    def _ends(self) -> tuple[NDArray[np.int64], Floats, Floats]:
        """The stations but the first."""
        arc = self.model.rod.grid.arc_length
        return find_stations(arc, arc[1:])

    # Readings.

    @cached_property
    def _stations(self) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Where the sensors sit."""
        tip = self.robot.length
        places = [tip if one.arc_length is None else one.arc_length for one in self.sensors]
        segments, parts, _ = find_stations(self.model.rod.grid.arc_length, places)
        return segments, parts, np.array([one.at for one in self.sensors]).reshape(-1, 3)

    @cached_property
    def _weights(self) -> Floats:
        """Share of each segment's curvature in what a sensor sees, (p, n)."""
        grid, tip = self.model.rod.grid, self.robot.length
        middles = 0.5 * (grid.arc_length[1:] + grid.arc_length[:-1])
        weights = np.zeros((len(self.sensors), len(middles)))
        for row, sensor in zip(weights, self.sensors, strict=True):
            place = tip if sensor.arc_length is None else sensor.arc_length
            own = np.flatnonzero(grid.sections == self.robot.section_at(place))
            if len(own) == 1:
                row[own] = 1.0
                continue
            first = int(np.clip(np.searchsorted(middles[own], place) - 1, 0, len(own) - 2))
            one, two = own[first], own[first + 1]
            share = (place - middles[one]) / (middles[two] - middles[one])
            row[one], row[two] = 1.0 - share, share
        return weights

    def _place(
        self, mean: Floats, body: _Body, stations: tuple[NDArray[np.int64], Floats, Floats]
    ) -> tuple[Floats, Floats, Floats]:
        """Return places, axes and their derivatives by the state in the world, of stations."""
        places, rotations, moved = _locate(
            self.model.rod.grid.packed, body.rotation_vectors, stations
        )
        slices, (axes, origin, left) = self._slices, self._move_base(mean)
        slopes = moved @ body.turned
        arms = places @ axes.T
        slopes = np.concatenate([axes @ slopes[:, :3], axes @ slopes[:, 3:]], axis=1)
        if self.error.rotation:
            slopes[:, :3, slices["rotation"]] += left
            slopes[:, 3:, slices["rotation"]] += np.cross(left.T, arms[:, None]).swapaxes(1, 2)
        if self.error.position:
            slopes[:, 3:, slices["position"]] += self._base[:3, :3]
        return arms + origin, axes @ rotations, slopes

    def _sense(self, mean: Floats, body: _Body) -> list[Sensed]:
        """Return the body where each sensor sits."""
        places, rotations, slopes = self._place(mean, body, self._stations)
        spans = self.model.rod.grid.spans
        weights = self._weights / spans
        curvatures = weights @ body.rotation_vectors
        curved = weights @ body.turned.reshape(len(spans), 3 * len(mean))
        curved = curved.reshape(len(weights), 3, len(mean))
        names = self.robot.tendon_names
        each = zip(places, rotations, slopes, curvatures, curved, strict=True)
        return [Sensed(*one, body.tensions, body.pulled, names) for one in each]

    def _evaluate(
        self,
        asked: Floats,
        read: Mapping[int, Floats],
        mean: Floats,
        *,
        start: _Start,
        short: Floats,
    ) -> _Fit:
        """Return what readings miss at a state, and the slopes, by the noise."""
        body = self._solve(asked, mean, start, short)
        if not body.found:
            return _Fit(mean, body, np.empty(0), np.empty((0, len(mean))))
        seen = self._sense(mean, body)
        biases, biased = self._read("sensors", mean), self._parts["sensors"].inside.tolist()
        missed, slope_rows, noises, kept = [], [], [], []
        for k, reading in read.items():
            sensor = self.sensors[k]
            miss = sensor.compare(reading - biases[k], seen[k])
            known = np.flatnonzero(np.isfinite(miss.values))
            miss = Miss(*(one[known] for one in miss))
            kept.append(known)
            own = miss.slopes.copy()
            if k in biased:
                own[:, self._slices["sensors"].start + biased.index(k)] += 1.0
            missed.append(miss.values / miss.deviations)
            slope_rows.append(own / miss.deviations[:, None])
            noises.append(miss.deviations)
        if not missed:
            return _Fit(mean, body, np.empty(0), np.empty((0, len(mean))))
        rows = np.concatenate(missed), np.concatenate(slope_rows)
        return _Fit(mean, body, *rows, tuple(noises), tuple(kept))

    # Search.

    def _search(
        self,
        asked: Floats,
        read: Mapping[int, Floats],
        before: EstimatorState,
        short: Floats,
        start: _Fit | None = None,
    ) -> _Fit:
        """Return the most likely state after readings."""
        root = self._find_root(before)
        begin = before.rotation_vectors, before.lengths
        fit = start or self._evaluate(asked, read, before.mean, start=begin, short=short)
        if not read or not fit.body.found:
            return fit._replace(settled=fit.body.found)
        way = _whiten(root, fit.mean - before.mean)
        cost, damping = 0.5 * float(way @ way + fit.missed @ fit.missed), 0.0
        for count in range(1, MOST_STEPS + 1):
            slopes = fit.slopes @ root
            uphill = slopes.T @ fit.missed - way
            inner = slopes @ slopes.T
            for _ in range(MOST_TRIES):
                damped = np.linalg.solve(inner + (1.0 + damping) * np.eye(len(inner)),
                                         slopes @ uphill)  # fmt: skip
                step = (uphill - slopes.T @ damped) / (1.0 + damping)
                decrement = float(step @ step + np.sum((slopes @ step) ** 2))
                if decrement < SETTLED**2:
                    settled = damping < MOST_DAMPING
                    return fit._replace(cost=cost, steps=count, settled=settled)
                mean = self._limit(before.mean + root @ (way + step))
                near = fit.body.rotation_vectors, fit.body.lengths
                if self._walls is not None:
                    turned = fit.body.turned @ (mean - fit.mean)
                    near = near[0] + turned.reshape(near[0].shape), near[1]
                other = self._evaluate(asked, read, mean, start=near, short=short)
                if other.body.found:
                    tried = _whiten(root, mean - before.mean)
                    value = 0.5 * float(tried @ tried + other.missed @ other.missed)
                    if value <= cost:
                        break
                damping = max(DAMPED_MORE * damping, 1.0)
            else:
                return fit._replace(cost=cost, steps=count)
            promised = float(uphill @ step) - 0.5 * decrement
            if cost - value < 0.5 * promised:
                damping = max(DAMPED_MORE * damping, 1.0)
            else:
                damping = damping * DAMPED_LESS if damping > 0.1 else 0.0
            fit, way, cost = other, tried, value
        return fit._replace(cost=cost, steps=MOST_STEPS)

    def _find_root(self, before: EstimatorState) -> Floats:
        """Return the lower Cholesky factor of the covariance."""
        spread = self._deviations
        scaled = before.covariance / np.outer(spread, spread)
        regular = 0.5 * (scaled + scaled.T) + ROUND_OFF * np.eye(len(spread))
        return np.asarray(spread[:, None] * np.linalg.cholesky(regular))

    def _limit(self, mean: Floats) -> Floats:
        """Return a state with the places of loads on the robot."""
        for index in range(len(self.loads)):
            own = self._slices[f"place {index}"]
            mean[own] = np.clip(mean[own], 0.0, self.robot.length)
        return mean

    def _try_cables(
        self,
        asked: Floats,
        read: Mapping[int, Floats],
        before: EstimatorState,
        short: Floats,
        best: _Fit,
    ) -> _Fit:
        """Return the best fit from states where single cables are slack, not taut, or taut.

        The search itself may end where the wrong ones are. That is tried if readings are missed by
        more than one in a hundred are.
        """
        from scipy.special import chdtrc

        inside = self._parts["zero"].inside.tolist()
        if self.command == "tension" or chdtrc(len(best.missed), 2.0 * best.cost) > DOUBTED:
            return best
        tried = pushes = set(np.flatnonzero(self.model.rod.pushes).tolist())
        while left := [k for k in inside if k not in tried]:
            free = self._make_command(asked, best.mean, short).free_lengths
            gaps = best.body.lengths - free
            near = min(left, key=lambda k: abs(gaps[k]))
            tried = tried | {near}
            mean = best.mean.copy()
            over = math.copysign(TURNED * self.error.zero, gaps[near])
            mean[self._slices["zero"].start + inside.index(near)] -= gaps[near] + over
            begin = best.body.rotation_vectors, best.body.lengths
            start = self._evaluate(asked, read, mean, start=begin, short=short)
            if start.body.found:
                other = self._search(asked, read, before, short, start=start)
                if other.cost < best.cost - BETTER:
                    best, tried = other, {near} | pushes
        return best

    def _is_fresh(self, index: int, before: EstimatorState) -> bool:
        """Whether nothing is known of a load's place."""
        if self.loads[index].arc_length is not None:
            return False
        at = self._slices[f"place {index}"].start
        return bool(before.covariance[at, at] > FRESH * self._deviations[at] ** 2)

    def _try_places(
        self,
        asked: Floats,
        read: Mapping[int, Floats],
        index: int,
        known: tuple[EstimatorState, _Fit],
        short: Floats,
    ) -> list[_Fit]:
        """Return states from which to search for a load: those at the most likely places."""
        before, best = known
        own, place = self._slices[f"load {index}"], self._slices[f"place {index}"]
        root = self._find_root(before)
        tried = []
        for part in np.linspace(0.0, 1.0, TRIED_PLACES + 1)[1:]:
            mean = best.mean.copy()
            mean[own], mean[place] = 0.0, part * self.robot.length
            near = best.body.rotation_vectors, best.body.lengths
            fit = self._evaluate(asked, read, mean, start=near, short=short)
            if not fit.body.found:
                continue
            way = _whiten(root, mean - before.mean)
            slopes = fit.slopes @ root
            inner = slopes @ slopes.T + np.eye(len(slopes))
            off = fit.missed + slopes @ way
            solved = np.linalg.solve(inner, off)
            value = float(off @ solved + np.linalg.slogdet(inner)[1])
            guess = before.mean + root @ (slopes.T @ solved)
            guess[place] = mean[place]
            tried.append((value, guess))
        tried.sort(key=lambda pair: pair[0])
        chosen: list[Floats] = []
        apart = 1.5 * self.robot.length / TRIED_PLACES
        for _, guess in tried:
            if all(abs(guess[place] - one[place])[0] > apart for one in chosen):
                chosen.append(guess)
        begin = best.body.rotation_vectors, best.body.lengths
        fits = [
            self._evaluate(asked, read, guess, start=begin, short=short)
            for guess in chosen[:BEST_PLACES]
        ]
        return [fit for fit in fits if fit.body.found]

    def _profile_place(
        self,
        asked: Floats,
        read: Mapping[int, Floats],
        index: int,
        known: tuple[EstimatorState, _Fit, Floats],
        load: EstimatedLoad,
    ) -> EstimatedLoad:
        """Return a load with intervals by the likelihood of places beside the best one.

        Between two sensors that may be flat, or have two peaks. All else is normal at each place.
        """
        (state, best, short), length = known, self.robot.length
        at = self._slices[f"place {index}"].start
        kept = np.delete(best.mean, at)
        before = dataclasses.replace(
            state,
            mean=np.delete(state.mean, at),
            covariance=np.delete(np.delete(state.covariance, at, 0), at, 1),
        )
        rows = []
        first = (load.place_high - load.place_low) / (4.0 * LIMIT)
        least = np.clip(first, LEAST_STRIDE * length, MOST_STRIDE * length)
        for way in (0.0, -1.0, 1.0):
            place, stride, fit = load.place, least, best
            mean = kept
            for _ in range(MOST_STRIDES if way else 1):
                place = min(max(place + way * stride, 0.0), length)
                loads = list(self.loads)
                loads[index] = dataclasses.replace(loads[index], arc_length=place)
                there = dataclasses.replace(self, loads=tuple(loads))
                there.__dict__.update({name: getattr(self, name) for name in KEPT})
                near = fit.body.rotation_vectors, fit.body.lengths
                start = there._evaluate(asked, read, mean, start=near, short=short)
                if not start.body.found:
                    break
                fit = there._search(asked, read, before, short, start=start)
                mean = fit.mean
                rows.append((place, *there._weigh_place(index, before, fit)))
                if rows[-1][1] > rows[0][1] + FAR or place in (0.0, length):
                    break
                stride = min(STRIDE_GROWTH * stride, MOST_STRIDE * length)
        rows.sort(key=lambda row: row[0])
        places, costs = np.array([row[:2] for row in rows]).T
        weights = np.exp(costs.min() - costs) * np.gradient(places) if len(places) > 1 else costs**0
        weights /= weights.sum()
        edges = np.append(places[0], 0.5 * (places[1:] + places[:-1]))
        edges = np.append(edges, places[-1])
        shares = np.append(0.0, np.cumsum(weights))
        low, high = np.interp([TAIL, 1.0 - TAIL], shares, edges)
        least, most = measure_sizes([row[2:] for row in rows], weights)
        return dataclasses.replace(
            load,
            place=min(max(load.place, float(low)), float(high)),
            place_low=float(low),
            place_high=float(high),
            force_low=least,
            force_high=most,
        )

    def _weigh_place(
        self, index: int, before: EstimatorState, fit: _Fit
    ) -> tuple[float, Floats, Floats]:
        """Return the negative logarithm of how likely a place is, force and covariance there."""
        crossed = fit.slopes @ before.covariance
        inner = crossed @ fit.slopes.T + np.eye(len(crossed))
        covariance = before.covariance - crossed.T @ np.linalg.solve(inner, crossed)
        cost = fit.cost + 0.5 * float(np.linalg.slogdet(inner)[1])
        return cost, *self._take_force(index, fit.mean, covariance, slice(0, 3))

    def _take_force(
        self, index: int, mean: Floats, covariance: Floats, axes: slice
    ) -> tuple[Floats, Floats]:
        """Return force or moment of a load and its covariance, without axes that have none."""
        own, inside = self._slices[f"load {index}"], self._parts[f"load {index}"].inside
        chosen = np.flatnonzero((inside >= axes.start) & (inside < axes.stop)) + own.start
        return mean[chosen], covariance[np.ix_(chosen, chosen)]

    # Answers.

    def _describe(self, before: EstimatorState, fit: _Fit, alone: _Body) -> ShapeEstimate:
        grid, count = self.model.rod.grid, len(before.mean)
        covariance, likelihood, body = before.covariance, 0.0, fit.body
        expected = 0.0
        nominal = self._base @ grid.place_frames(alone.rotation_vectors[None])[0]
        if body.found and len(fit.missed):
            crossed = fit.slopes @ covariance
            inner = crossed @ fit.slopes.T + np.eye(len(crossed))
            root = _whiten(np.asarray(np.linalg.cholesky(inner)), crossed)
            covariance = covariance - root.T @ root
            off = fit.missed + fit.slopes @ (fit.mean - before.mean)
            expected = float(off @ np.linalg.solve(inner, off))
            likelihood = expected + float(np.linalg.slogdet(inner)[1])
            likelihood = -0.5 * (likelihood + len(off) * math.log(2.0 * math.pi))
            likelihood -= float(np.log(np.concatenate(fit.noises)).sum())
        frames = np.full((len(nominal), 4, 4), np.nan)
        spread = np.full((len(nominal), 6, 6), np.nan)
        tensions = np.full(len(body.tensions), np.nan)
        pulled, contact = np.zeros((len(self.robot.tendons), count)), None
        if body.found:
            stations = find_stations(grid.arc_length, grid.arc_length)
            places, axes, slopes = self._place(fit.mean, body, stations)
            frames = np.tile(np.eye(4), (len(places), 1, 1))
            frames[:, :3, :3], frames[:, :3, 3] = axes, places
            spread = slopes @ covariance @ slopes.swapaxes(1, 2)
            pulled, tensions = body.pulled, body.tensions
            if body.push is not None:
                contact = EstimatedContact.make(body.push, slopes[1:, 3:], covariance)
        tension_spread = np.einsum("ti,ij,tj->t", pulled, covariance, pulled)
        tension_spread[np.isnan(tensions)] = np.nan
        missed = math.sqrt(float(np.mean(fit.missed**2))) if len(fit.missed) else 0.0
        reason = ""
        if not body.found:
            reason = NO_SHAPE
        elif not fit.settled:
            reason = f"the search did not settle: it ended after {fit.steps} step(s)"
        return ShapeEstimate(
            robot=self.robot,
            arc_length=grid.arc_length,
            frames=frames,
            covariance=spread,
            commanded=nominal[:, :3, 3],
            tensions=tensions,
            tension_deviations=np.sqrt(np.maximum(tension_spread, 0.0)),
            loads=tuple(self._describe_load(k, fit.mean, covariance, body)
                        for k in range(len(self.loads))),
            contact=contact,
            names=self.names,
            state=EstimatorState(
                fit.mean,
                covariance,
                body.rotation_vectors if body.found else before.rotation_vectors,
                body.lengths if body.found else before.lengths,
                None if self._walls is None else alone.rotation_vectors,
            ),
            residual=missed,
            innovation=expected,
            numbers=len(fit.missed),
            log_likelihood=likelihood,
            steps=fit.steps,
            converged=not reason,
            reason=reason,
        )  # fmt: skip

    def _describe_load(
        self, index: int, mean: Floats, covariance: Floats, body: _Body
    ) -> EstimatedLoad:
        values = self._read(f"load {index}", mean)
        place, spread = self._place_load(index, mean), 0.0
        if self.loads[index].arc_length is None:
            at = self._slices[f"place {index}"].start
            spread = LIMIT * math.sqrt(max(covariance[at, at], 0.0))
        numbers: list[float] = []
        for axes in (slice(0, 3), slice(3, 6)):
            known = self._take_force(index, mean, covariance, axes)
            numbers += [float(np.linalg.norm(known[0])), *measure_sizes([known], np.ones(1))]
        force, moment = numbers[:3], numbers[3:]
        vector = np.full(3, np.nan)
        if body.found:
            stations = find_stations(self.model.rod.grid.arc_length, [place])
            vector = self._place(mean, body, stations)[1][0] @ values[:3]
        return EstimatedLoad(
            place=place,
            place_low=max(place - spread, 0.0),
            place_high=min(place + spread, self.robot.length),
            force=force[0],
            force_low=force[1],
            force_high=force[2],
            moment=moment[0],
            moment_low=moment[1],
            moment_high=moment[2],
            vector=tuple(vector.tolist()),
        )

    # Inputs.

    def _take_commands(self, commands: ArrayLike) -> Floats:
        if self.command == "tension":
            found = check_tension_commands(self.robot, commands)
        else:
            found = check_displacements(self.robot, commands, may_follow=True)
        if found.ndim != 1:
            raise InputError(f"commands have shape {found.shape}: one for each tendon of a moment")
        return found

    def _take_readings(self, readings: Mapping[str, ArrayLike]) -> dict[int, Floats]:
        names = [sensor.name for sensor in self.sensors]
        found = {}
        for name, reading in readings.items():
            if name not in names:
                raise InputError(f"there is no sensor '{name}': they are {', '.join(names)}")
            index = names.index(name)
            values = np.atleast_1d(check_array(f"reading of '{name}'", reading))
            if values.shape != (self.sensors[index].count,):
                raise InputError(
                    f"reading of '{name}' has shape {values.shape}: it must be "
                    f"({self.sensors[index].count},)"
                )
            if np.isinf(values).any():
                raise InputError(f"reading of '{name}' is infinite: NaN stands for none")
            if self.sensors[index].has_reading(values):
                found[index] = values
        return dict(sorted(found.items()))


def find_stations(arc: Floats, places: ArrayLike) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return the segments between stations `arc` where places are, the part of each before them."""
    at = np.asarray(places, dtype=np.float64)
    segments = np.clip(np.searchsorted(arc, at) - 1, 0, len(arc) - 2)
    parts = np.clip((at - arc[segments]) / np.diff(arc)[segments], 0.0, 1.0)
    return segments.astype(np.int64), parts, np.zeros((len(at), 3))


def _locate(
    packed: PackedGrid, turned: Floats, stations: tuple[NDArray[np.int64], Floats, Floats]
) -> tuple[Floats, Floats, Floats]:
    """Return places, axes and Jacobians (p, 6, 3 n) by the segments of points of the body."""
    count = len(stations[0])
    places, axes = np.empty((count, 3)), np.empty((count, 3, 3))
    moved = np.zeros((count, 6, turned.size))
    locate_stations(packed, turned, stations, places, axes, moved)
    return places, axes, moved


def _whiten(root: Floats, change: Floats) -> Floats:
    from scipy.linalg import solve_triangular

    return np.asarray(solve_triangular(root, change, lower=True, check_finite=False))
