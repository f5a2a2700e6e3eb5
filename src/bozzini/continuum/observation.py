"""Where markers of a robot are seen for given commands, and how that depends on unknowns."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..numeric.arrays import Floats
from .dynamics import DynamicsOptions, ShapeHistory, simulate
from .measured import RobotMeasurements
from .model import ContinuumModel
from .rod import RodModel
from .shape import Shape
from .unknowns import RobotSetup, Unknown, change_setup

FACTOR_STEP = 1e-4
"""Step of the logarithm of a factor, and of an angle [rad], for a derivative."""
STEP_MM = 1e-3
"""Step of a length or of another number, for a derivative."""
FRICTION_STEP = 0.02
"""Step of a coefficient of friction: shapes after a history have small jumps over it."""


def interpolate_frames(shape: Shape, places: Floats) -> Floats:
    """Return frames (n, m, 4, 4) of shapes (n,) at arc lengths (m,), along arcs between stations.

    Between two stations a body moves along the screw from one frame to the other.
    """
    from scipy.spatial.transform import Rotation

    stations = shape.arc_length
    index = np.clip(np.searchsorted(stations, places, side="left") - 1, 0, len(stations) - 2)
    part = (places - stations[index]) / (stations[index + 1] - stations[index])
    first, last = shape.frames[..., index, :, :], shape.frames[..., index + 1, :, :]
    batch = first.shape[:-2]
    turns = np.swapaxes(first[..., :3, :3], -1, -2)
    step = np.einsum("...ij,...j->...i", turns, last[..., :3, 3] - first[..., :3, 3])
    turn = Rotation.from_matrix((turns @ last[..., :3, :3]).reshape(-1, 3, 3)).as_rotvec()
    turn = turn.reshape(*batch, 3)
    velocity = solve_screw(turn, step)
    moved = turn * part[:, None]
    frames = np.zeros((*batch, 4, 4))
    own = Rotation.from_rotvec(moved.reshape(-1, 3)).as_matrix().reshape(*batch, 3, 3)
    frames[..., :3, :3] = first[..., :3, :3] @ own
    along = apply_screw(moved, velocity * part[:, None])
    frames[..., :3, 3] = first[..., :3, 3] + np.einsum(
        "...ij,...j->...i", first[..., :3, :3], along
    )
    frames[..., 3, 3] = 1.0
    return frames


def apply_screw(turn: Floats, velocity: Floats) -> Floats:
    """Return where a screw goes: the left Jacobian of SO(3) times its velocity (Barfoot 2017)."""
    angle = np.linalg.norm(turn, axis=-1)[..., None]
    square = np.maximum(angle, 1e-4) ** 2
    small = angle < 1e-4
    first = np.where(small, 0.5, (1.0 - np.cos(angle)) / square)
    second = np.where(small, 1.0 / 6.0, (1.0 - np.sinc(angle / np.pi)) / square)
    once = np.cross(turn, velocity)
    return np.asarray(velocity + first * once + second * np.cross(turn, once))


def solve_screw(turn: Floats, step: Floats) -> Floats:
    """Return the velocity of the screw that goes so far: the inverse of `apply_screw`."""
    angle = np.linalg.norm(turn, axis=-1)[..., None]
    half = 0.5 * np.maximum(angle, 1e-4)
    share = np.where(angle < 1e-4, 1.0 / 12.0, (1.0 - half / np.tan(half)) / (2.0 * half) ** 2)
    once = np.cross(turn, step)
    return np.asarray(step - 0.5 * once + share * np.cross(turn, once))


def place_markers(setup: RobotSetup, shape: Shape) -> Floats:
    """Return where the markers are in the world, (n, m, 3) [mm]."""
    tip = setup.robot.length
    places = np.array([tip if m.arc_length is None else m.arc_length for m in setup.markers])
    frames = interpolate_frames(shape, np.minimum(places, tip))
    offsets = np.array([marker.offset for marker in setup.markers])
    local = frames[..., :3, 3] + np.einsum("...mij,mj->...mi", frames[..., :3, :3], offsets)
    base = setup.robot.base_frame
    return np.asarray(local @ base[:3, :3].T + base[:3, 3])


def select_shapes(history: ShapeHistory, rows: NDArray[np.int64]) -> Shape:
    """Return the shapes of rows of a motion; those it did not come to have NaN and its reason."""
    there = rows < len(history.time)
    known, missed = rows[there], (len(rows) - int(there.sum()))

    def take(values: Floats) -> Floats:
        gap = np.full((missed, *values.shape[1:]), np.nan)
        return np.concatenate([values[known], gap])

    tensions, displacements = take(history.tensions), take(history.displacements)
    free = history.rod.find_limits(displacements)
    return Shape(
        robot=history.robot,
        model="motion",
        arc_length=history.arc_length,
        frames=take(history.frames),
        displacements=displacements,
        tendon_lengths=free + history.rod.compliances * tensions,
        section_parameters=np.zeros((len(rows), 0, 2)),
        tensions=tensions,
        slack=(tensions <= 0.0) & ~history.robot.pushes,
        residual=np.zeros(len(rows)),
        iterations=np.append(history.iterations[known], np.zeros(missed, dtype=np.int64)),
        converged=there,
        reason=np.where(there, "", history.reason),
    )


def convert_rows(setup: RobotSetup, commands: Floats, *, pulled: bool) -> Floats:
    """Return what reaches the tendons of commands (n, t) in time; `pulled`: by tensions."""
    if pulled and any(setup.zeros):
        raise InputError("tendons.*.zero is for displacements: the commands are tensions")
    reached = setup.convert(commands)
    if pulled:  # noise of a measured tension about 0: a cable does not push
        return np.where(setup.robot.pushes, reached, np.maximum(reached, 0.0))
    return reached


def solve_rows(
    model: ContinuumModel, commands: Floats, *, pulled: bool, rows: NDArray[np.int64]
) -> Shape:
    """Return the shapes of rows of `convert_rows`; with friction, after all rows before them."""
    if isinstance(model, RodModel) and model.robot.tendon_friction.any():
        trace = model.trace_tensions if pulled else model.trace_displacements
        return trace(commands[: rows[-1] + 1]).select(rows)
    if pulled:
        return model.shape_under_tensions(commands[rows])
    return model.find_shape(commands[rows])


@dataclass(frozen=True)
class Observed:
    """What a setup predicts.

    Parameters
    ----------
    shape : Shape
        The shapes of the rows.
    points : ndarray, shape (n, m, 3)
        Where the markers are, NaN without a shape [mm].
    """

    shape: Shape
    points: Floats

    @property
    def answered(self) -> NDArray[np.bool_]:
        """Which rows have a converged shape, (n,)."""
        return np.asarray(self.shape.converged)


@dataclass(frozen=True)
class Observation:
    """Rows of measurements of a setup, by a model.

    Parameters
    ----------
    setup : RobotSetup
        The robot before anything is changed.
    data : RobotMeasurements
        All rows, in the order in which they were recorded.
    model : str
        Name of the model.
    options : mapping
        Options of the model.
    rows : ndarray of int
        The rows that are compared; the others are the history of those after them.
    """

    setup: RobotSetup
    data: RobotMeasurements
    model: str
    options: Mapping[str, object]
    rows: NDArray[np.int64]

    @property
    def measured(self) -> Floats:
        """Points that were seen (n, m, 3) [mm]."""
        return np.asarray(self.data.points[self.rows])

    def solve(self, setup: RobotSetup) -> Shape:
        """Return the shapes of the rows; with friction of tendons, after all rows before them."""
        pulled = self.data.command == "tension"
        commands = convert_rows(setup, self.data.order_commands(setup.robot), pulled=pulled)
        if setup.dynamics is not None:
            return self._move(setup, setup.dynamics, commands)
        model = setup.robot.model(self.model, **self.options)
        return solve_rows(model, commands, pulled=pulled, rows=self.rows)

    def _move(self, setup: RobotSetup, dynamics: DynamicsOptions, commands: Floats) -> Shape:
        """Return the shapes of the rows of a motion from rest under the first command."""
        last = int(self.rows[-1]) + 1
        times, given = self.data.times[: max(last, 2)], commands[: max(last, 2)]
        if self.data.command == "tension":
            history = simulate(setup.robot, times, tensions=given, options=dynamics)
        else:
            history = simulate(setup.robot, times, displacements=given, options=dynamics)
        return select_shapes(history, self.rows)

    def observe(self, setup: RobotSetup, shape: Shape | None = None) -> Observed:
        """Return what a setup predicts; with `shape`, from shapes that are known."""
        shape = self.solve(setup) if shape is None else shape
        return Observed(shape, place_markers(setup, shape))

    def change(self, unknowns: Sequence[Unknown], changes: Floats) -> Observed:
        """Return what the setup with changed numbers predicts."""
        return self.observe(change_setup(self.setup, unknowns, changes))

    def differentiate(self, unknowns: Sequence[Unknown], changes: Floats, at: Observed) -> Floats:
        """Return derivatives (n, m, 3, k) of the points with respect to changes."""
        columns = np.empty((*at.points.shape, len(unknowns)))
        loaded = bool(self.setup.robot.has_line_weight or self.setup.robot.disc_weights.any())
        loaded = loaded or self.setup.dynamics is not None
        for index, one in enumerate(unknowns):
            fine = one.known.unit == "rad" or one.known.change == "factor"
            step = FACTOR_STEP if fine else STEP_MM
            step = FRICTION_STEP if one.field == "friction" else step
            keeps = not (one.moves_robot or (loaded and one.field.startswith("rotation")))
            if changes[index] + step > one.limit(self.setup)[1]:
                step = -step
            moved = changes.copy()
            moved[index] += step
            setup = change_setup(self.setup, unknowns, moved)
            there = self.observe(setup, at.shape if keeps else None)
            columns[..., index] = (there.points - at.points) / step
        return columns


def align_base(observation: Observation) -> RobotSetup:
    """Return the setup with its base where the points fit best, by Kabsch's rotation.

    Kabsch, W. (1976), *Acta Crystallographica* A32, 922-923.
    """
    from scipy.spatial.transform import Rotation

    setup = observation.setup
    points, measured = observation.observe(setup).points, observation.measured
    seen = np.isfinite(points + measured).all(axis=-1)
    ours, theirs = points[seen], measured[seen]
    u, _, v = np.linalg.svd((ours - ours.mean(axis=0)).T @ (theirs - theirs.mean(axis=0)))
    turn = (u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v).T
    frame = setup.robot.base_frame
    place = turn @ (frame[:3, 3] - ours.mean(axis=0)) + theirs.mean(axis=0)
    rotation = Rotation.from_matrix(turn @ frame[:3, :3]).as_rotvec()
    robot = dataclasses.replace(
        setup.robot, base_position=tuple(place.tolist()), base_rotation=tuple(rotation.tolist())
    )
    return dataclasses.replace(setup, robot=robot)
