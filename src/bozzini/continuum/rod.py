"""The reference: a Kirchhoff rod with frictionless tendons, a boundary-value problem."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number, check_points
from ..errors import GeometryError, InputError
from ._energy_grid import place_stations
from ._rod_newton import shoot
from ._rod_state import Rod, Shot, Target
from .coupling import check_displacements
from .robot import ContinuumRobot
from .shape import Shape
from .tendon import GRAIN

__all__ = ["RodModel"]

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)

PIECES = 4
"""Least number of pieces of the shooting where there are loads."""

NUDGE = 1e-9
"""How far inside a smooth piece its ends are evaluated, against its length."""


@dataclass(frozen=True)
class RodModel:
    """Kirchhoff rod with frictionless tendons in smooth channels, under loads.

    After Rucker and Webster (2011), for a rod that neither shears nor stretches and is straight at
    rest. It is integrated from the base, and the base's moment and the tensions are found by
    Newton's method (multiple shooting): cables hold tension or are slack. It costs about a hundred
    times what the energy model does, and is there to check that, and for loads.

    A rod under loads may have several equilibria: this finds the one that is reached from the
    straight rod, and does not tell whether it is stable. Loads keep their direction as the robot
    bends, and are raised together with the displacements. A moment of fixed direction has no
    potential.

    Parameters
    ----------
    robot : ContinuumRobot
        The robot; its sections' EI and GJ matter here.
    tip_force : (3,) array_like
        Force on the robot's end, in the base frame [N].
    tip_moment : (3,) array_like
        Moment on the robot's end, in the base frame [N mm].
    distributed_force : (3,) array_like
        Force per length of backbone, in the base frame, weight for example [N/mm].
    tendon_stiffness : float
        EA of every tendon [N]; infinite unless given. Parallel tendons that do not stretch leave
        a backbone that does not stretch no twist: a load that twists it needs this.
    between : int
        Further stations of the shape, evenly between two discs.
    steps : int
        Least number of steps along the robot; their error is of fourth order.
    tolerance : float
        Displacement by which a command may miss being consistent [mm].

    Raises
    ------
    InputError
        If an option is outside its legal range.
    """

    robot: ContinuumRobot
    tip_force: Vector = field(default=ZERO, kw_only=True)
    tip_moment: Vector = field(default=ZERO, kw_only=True)
    distributed_force: Vector = field(default=ZERO, kw_only=True)
    tendon_stiffness: float = field(default=math.inf, kw_only=True)
    between: int = field(default=0, kw_only=True)
    steps: int = field(default=200, kw_only=True)
    tolerance: float = field(default=1e-6, kw_only=True)

    name = "rod"

    def __post_init__(self) -> None:
        for name in ("tip_force", "tip_moment", "distributed_force"):
            vector = check_points(name, getattr(self, name))
            if vector.shape != (3,):
                raise InputError(f"{name} has shape {vector.shape}: it must be (3,)")
            object.__setattr__(self, name, tuple(vector.tolist()))
        if self.tendon_stiffness != math.inf:
            check_number(
                "tendon_stiffness", self.tendon_stiffness, low=0.0, low_open=True, unit="N"
            )
        check_integer("between", self.between, low=0, high=1000)
        check_integer("steps", self.steps, low=10, high=100000)
        check_number("tolerance", self.tolerance, low=0.0, high=1.0, low_open=True, unit="mm")

    @cached_property
    def arc_length(self) -> Floats:
        """Stations: base, discs, tendon ends and points between [mm], shape (k,)."""
        return place_stations(self.robot, self.between)

    @cached_property
    def natural_lengths(self) -> Floats:
        """Length of each tendon in the straight robot [mm], shape (t,)."""
        slopes = np.sqrt(1.0 + np.sum(self._guides[..., 2:] ** 2, axis=-1)) * self._present[:, None]
        means = (slopes[:, 0] + 4.0 * slopes[:, 1] + slopes[:, 2]) / 6.0
        return np.asarray(np.sum(means * np.diff(self._places)[:, None], axis=0))

    def shape(self, displacements: ArrayLike) -> Shape:
        """Return the shapes under tendon displacements and the loads.

        Parameters
        ----------
        displacements : array_like, shape (..., t)
            How much each tendon is pulled [mm], negative where it is let out.

        Raises
        ------
        InputError
            If the displacements are not finite numbers of that shape.
        """
        commands = check_displacements(self.robot, displacements)
        flat = commands.reshape(-1, len(self.robot.tendons))
        return self._answer(commands, [self._shoot(command=command) for command in flat])

    def shape_under_tensions(self, tensions: ArrayLike) -> Shape:
        """Return the shapes under tensions of the tendons and the loads.

        Parameters
        ----------
        tensions : array_like, shape (..., t)
            Tension of each tendon [N]; 0 or more unless it is a rod that pushes.

        Returns
        -------
        Shape
            Its displacements are those of the tendons in that shape.

        Raises
        ------
        InputError
            If the tensions are not finite numbers of that shape, or a cable's is negative.
        """
        count = len(self.robot.tendons)
        pulls = check_points("tensions", tensions, dim=count) if count else np.zeros(0)
        low = np.where(self._pushes, -math.inf, 0.0)
        if np.any(pulls < low):
            place = np.argwhere(pulls < low)[0]
            raise InputError(
                f"tension of tendon '{self.robot.tendon_names[place[-1]]}' is "
                f"{pulls[tuple(place)]:g} N: it must lie in [0, inf) N, for a cable does not push"
            )
        return self._answer(
            pulls, [self._shoot(tensions=row) for row in pulls.reshape(-1, count)], given=True
        )

    @cached_property
    def _pushes(self) -> NDArray[np.bool_]:
        return np.asarray([tendon.pushes for tendon in self.robot.tendons], dtype=np.bool_)

    @cached_property
    def _places(self) -> Floats:
        """Ends of the steps [mm], shape (n + 1,): stations and corners of tendons among them."""
        corners = [place for tendon in self.robot.tendons for place in tendon.corners()]
        breaks = np.unique(np.concatenate([self.arc_length, corners]))
        breaks = breaks[np.concatenate([[True], np.diff(breaks) > GRAIN])]
        widest = self.robot.length / self.steps
        pieces = [
            np.linspace(start, end, math.ceil((end - start) / widest - 1e-9) + 1)[1:]
            for start, end in zip(breaks[:-1], breaks[1:], strict=True)
        ]
        return np.concatenate([[0.0], *pieces])

    @cached_property
    def _middles(self) -> Floats:
        return np.asarray(0.5 * (self._places[1:] + self._places[:-1]))

    @cached_property
    def _present(self) -> NDArray[np.bool_]:
        """Whether each tendon runs in each step, shape (n, t)."""
        return np.asarray(self._middles[:, None] < self.robot.tendon_ends)

    @cached_property
    def _guides(self) -> Floats:
        """Places and slopes of tendons at start, middle and end of steps, shape (n, 3, t, 4)."""
        guides = np.zeros((len(self._middles), 3, len(self.robot.tendons), 4))
        # Inside the step, where corners do not matter.
        edge = (0.5 - NUDGE) * np.diff(self._places)
        places = np.stack([self._middles - edge, self._middles, self._middles + edge], axis=1)
        for row, tendon in enumerate(self.robot.tendons):
            here = self._present[:, row]
            guides[here, :, row, :2] = tendon.path(places[here])
            guides[here, :, row, 2:] = tendon.path_slope(places[here])
        return guides

    @cached_property
    def _stiffness(self) -> Floats:
        sections = [
            (section.bending_stiffness, section.bending_stiffness, section.torsional_stiffness)
            for section in self.robot.sections
        ]
        return np.asarray(sections, dtype=np.float64)[self.robot.section_at(self._middles)]

    @cached_property
    def _compliances(self) -> Floats:
        return self.natural_lengths / self.tendon_stiffness

    @cached_property
    def _load(self) -> float:
        """The loads, by the moment about the base, against what bends the robot by 1 rad."""
        length = self.robot.length
        force = np.linalg.norm(self.tip_force) + 0.5 * length * np.linalg.norm(
            self.distributed_force
        )
        moment = length * force + np.linalg.norm(self.tip_moment)
        return float(moment * length / self._stiffness.min())

    @cached_property
    def _rod(self) -> Rod:
        # Without loads no moment goes over from piece to piece: one is enough.
        pieces = 1 if self._load == 0.0 else PIECES + math.ceil(math.sqrt(self._load))
        return Rod(
            grid=(self._places, self._stiffness, self._guides, self._present),
            tip_force=np.asarray(self.tip_force),
            tip_moment=np.asarray(self.tip_moment),
            line_force=np.asarray(self.distributed_force),
            pieces=min(pieces, len(self._places) - 1),
            moment_scale=float(self._stiffness.max() / self.robot.length),
            load=self._load,
        )

    def _shoot(self, *, command: Floats | None = None, tensions: Floats | None = None) -> Shot:
        target = Target(
            names=self.robot.tendon_names,
            pushes=self._pushes,
            compliances=self._compliances,
            tolerance=self.tolerance,
            natural=self.natural_lengths,
            command=command,
            tensions=tensions,
        )
        return shoot(self._rod, target)

    def _answer(self, commands: Floats, shots: list[Shot], *, given: bool = False) -> Shape:
        batch, tendons = commands.shape[:-1], len(self.robot.tendons)
        index = np.searchsorted(self._places, self.arc_length - GRAIN)
        frames = np.zeros((len(shots), len(index), 4, 4))
        frames[..., 3, 3] = 1.0
        lengths = np.zeros((len(shots), tendons))
        bends = np.zeros((len(shots), len(self.robot.sections), 2))
        edges = np.searchsorted(
            self._places, np.concatenate([[0.0], self.robot.section_ends]) - GRAIN
        )
        for row, shot in enumerate(shots):
            states, turned, good = self._rod.trace(shot)
            if not good:
                raise GeometryError("the rod's equations broke down at a state that held before")
            frames[row, :, :3, :3] = _rotate(states[index, 3:7])
            frames[row, :, :3, 3] = states[index, :3]
            lengths[row] = states[-1, 10:]
            parts = np.diff(turned[edges], axis=0)
            bends[row] = np.stack([parts[:, 1], -parts[:, 0]], axis=-1)
        if not self._bends_evenly:
            bends = bends[:, :0]
        displacements = self.natural_lengths - lengths
        if not given:
            displacements = commands.reshape(-1, tendons)
        followed = self.natural_lengths - np.asarray([[s.share] for s in shots]) * displacements
        slack = ~self._pushes & (lengths < followed - self.tolerance)
        if given:
            slack = ~self._pushes & (commands.reshape(-1, tendons) == 0.0)
        tensions = np.asarray([s.tensions for s in shots]).reshape(-1, tendons)
        asked = self.natural_lengths - displacements
        if not given:
            asked = asked + self._compliances * tensions
        missed = np.where(slack, 0.0, lengths - asked)
        return Shape(
            robot=self.robot,
            model=self.name,
            arc_length=self.arc_length,
            frames=frames.reshape(*batch, *frames.shape[1:]),
            displacements=displacements.reshape(commands.shape),
            tendon_lengths=lengths.reshape(commands.shape),
            section_parameters=bends.reshape(*batch, *bends.shape[1:]),
            tensions=tensions.reshape(commands.shape),
            slack=slack.reshape(commands.shape),
            residual=np.abs(missed).max(axis=1, initial=0.0).reshape(batch),
            iterations=np.asarray([s.iterations for s in shots], dtype=np.int64).reshape(batch),
            converged=np.asarray([not s.reason for s in shots]).reshape(batch),
            reason=np.asarray([s.reason for s in shots], dtype=np.str_).reshape(batch),
            disc_arc_length=self.robot.disc_arc_length,
        )

    @cached_property
    def _bends_evenly(self) -> bool:
        loads = np.concatenate([self.tip_force, self.tip_moment, self.distributed_force])
        parallel = all(tendon.is_parallel for tendon in self.robot.tendons)
        return parallel and not loads.any()


def _rotate(quaternions: Floats) -> Floats:
    """Rotation matrices (n, 3, 3) of unit quaternions (n, 4), scalar first."""
    w, x, y, z = quaternions.T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.asarray(rows), -1, 0)
