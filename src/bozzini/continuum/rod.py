"""The reference: a Kirchhoff rod with frictionless tendons, a boundary-value problem."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number, check_points
from ..errors import InputError
from ._checks import check_limit
from ._limits import check_limits, check_numbers, explain_contrast
from ._rod_follow import follow
from ._rod_grid import RodGrid
from ._rod_state import Rod, Shot, Target, rotate
from .coupling import check_displacements
from .robot import ContinuumRobot, check_robot
from .shape import Shape

__all__ = ["RodModel"]

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)

PIECES = 4
"""Least number of pieces of the shooting where there are loads."""

STRONGEST = 1e4
"""Tension at which a command counts as impossible, against one that bends the robot by 1 rad."""

EDGE = 1e-9
"""Distance at which a place counts as a step's end [mm]."""

ROUND_OFF = 1e-6
"""Share of a limit that is an error of the solver."""


@dataclass(frozen=True)
class RodModel:
    """Kirchhoff rod with frictionless tendons in smooth channels, under loads.

    After Rucker and Webster (2011), for a rod that neither shears nor stretches and is straight at
    rest. It is there to check the energy model, and for loads: cables hold tension or are slack.

    Without loads every cross-section takes the curvature of least energy under the tensions, and
    those follow from a concave problem, by Newton's method with a line search. With cables only,
    or parallel tendons, there is one answer. Rods that push on other routings may have several
    equilibria: the command is raised in steps from the straight rod, and curvatures are minima,
    so that the rod is stable by itself; where that way ends, the reason says how far it went.

    With loads the rod is integrated from the base, and the base's moment and the tensions are
    found by multiple shooting. There may be several equilibria: this finds the one that is reached
    from the straight rod as loads and displacements are raised together, and does not tell whether
    it is stable. Loads keep their direction as the robot bends. A moment of fixed direction has no
    potential.

    A shape beyond a tendon's travel or a section's `max_bend`, or so curved that discs meet, has
    not converged. A section's bend is here the integral of its curvature. Stiffnesses of the
    backbone may differ by a factor of 1e6.

    Parameters
    ----------
    robot : ContinuumRobot
        The robot; its sections' EI and GJ matter here. It may be without tendons.
    tip_force : (3,) array_like
        Force on the robot's end, in the base frame [N].
    tip_moment : (3,) array_like
        Moment on the robot's end, in the base frame [N mm].
    distributed_force : (3,) array_like
        Force per length of backbone, in the base frame, weight for example [N/mm].
    tendon_stiffness : float
        EA of every tendon [N]; infinite unless given. Parallel tendons that do not stretch leave
        a backbone that does not stretch no twist: a load that twists it needs this, and is
        refused without it where the tolerance would decide where the tip is.
    between : int
        Further stations of the shape, evenly between two discs.
    steps : int
        Least number of steps along the robot; their error is of fourth order.
    tolerance : float
        Displacement by which a command may miss being consistent [mm], in (0, 1].

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
        check_robot(self.robot)
        for name in ("tip_force", "tip_moment", "distributed_force"):
            vector = check_points(name, getattr(self, name))
            if vector.shape != (3,):
                raise InputError(f"{name} has shape {vector.shape}: it must be (3,)")
            object.__setattr__(self, name, tuple(vector.tolist()))
        stiffness = check_limit("tendon_stiffness", self.tendon_stiffness, unit="N")
        object.__setattr__(self, "tendon_stiffness", stiffness)
        check_integer("between", self.between, low=0, high=1000)
        check_integer("steps", self.steps, low=10, high=100000)
        check_number("tolerance", self.tolerance, low=0.0, high=1.0, low_open=True, unit="mm")

    @property
    def arc_length(self) -> Floats:
        """Stations: base, discs, tendon ends and points between [mm], shape (k,)."""
        return self._grid.arc_length

    @property
    def natural_lengths(self) -> Floats:
        """Length of each tendon in the straight robot [mm], shape (t,)."""
        return self._grid.natural_lengths

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
        shots = [self._shoot(command=command) for command in _rows(commands)]
        return self._answer(commands, shots)

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
        pulls = check_points("tensions", tensions, dim=count)
        low = np.where(self._pushes, -math.inf, 0.0)
        if np.any(pulls < low):
            place = np.argwhere(pulls < low)[0]
            raise InputError(
                f"tension of tendon '{self.robot.tendon_names[place[-1]]}' is "
                f"{pulls[tuple(place)]:g} N: it must lie in [0, inf) N, for a cable does not push"
            )
        shots = [self._shoot(tensions=row) for row in _rows(pulls)]
        return self._answer(pulls, shots, given=True)

    @cached_property
    def _grid(self) -> RodGrid:
        return RodGrid(self.robot, self.between, self.steps)

    @cached_property
    def _pushes(self) -> NDArray[np.bool_]:
        return np.asarray([tendon.pushes for tendon in self.robot.tendons], dtype=np.bool_)

    @cached_property
    def _convex(self) -> bool:
        """Whether without loads there is one equilibrium only."""
        tendons = self.robot.tendons
        return not self._pushes.any() or all(tendon.is_parallel for tendon in tendons)

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
        return float(moment * length / self._grid.stiffness.min())

    @cached_property
    def _rod(self) -> Rod:
        # Without loads no moment goes over from piece to piece: one is enough.
        pieces = 1 if self._load == 0.0 else PIECES + math.ceil(math.sqrt(self._load))
        scale = float(self._grid.stiffness.max() / self.robot.length)
        unit = scale / float(self._grid.reaches.min(initial=self.robot.radius))
        return Rod(
            grid=self._grid.packed,
            tip_force=np.asarray(self.tip_force),
            tip_moment=np.asarray(self.tip_moment),
            line_force=np.asarray(self.distributed_force),
            pieces=min(pieces, len(self._grid.places) - 1),
            moment_scale=scale,
            load=self._load,
            unit_tension=unit,
            strongest=STRONGEST * unit,
        )

    def _shoot(self, *, command: Floats | None = None, tensions: Floats | None = None) -> Shot:
        target = Target(
            names=self.robot.tendon_names,
            pushes=self._pushes,
            compliances=self._compliances,
            tolerance=self.tolerance,
            natural=self.natural_lengths,
            reaches=self._grid.reaches,
            command=command,
            tensions=tensions,
        )
        return follow(self._rod, target, convex=self._convex)

    def _answer(self, commands: Floats, shots: list[Shot], *, given: bool = False) -> Shape:
        batch, tendons = commands.shape[:-1], len(self.robot.tendons)
        places, ends = self._grid.places, self.robot.section_ends
        index = np.searchsorted(places, self.arc_length - EDGE)
        frames = np.zeros((len(shots), len(index), 4, 4))
        frames[..., 3, 3] = 1.0
        lengths = np.zeros((len(shots), tendons))
        sums = np.zeros((len(shots), len(ends), 2))
        bends, curvatures = np.zeros((2, len(shots), len(ends)))
        edges = np.searchsorted(places, np.concatenate([[0.0], ends]) - EDGE)
        for row, shot in enumerate(shots):
            states, turned, good = self._rod.trace(shot)
            if not good:
                shots[row] = shot = self._rod.rest(tendons, "no curvature was found")
                states, turned, _ = self._rod.trace(shot)
            frames[row, :, :3, :3] = rotate(states[index, 3:7])
            frames[row, :, :3, 3] = states[index, :3]
            lengths[row] = states[-1, 10:]
            parts = np.diff(turned[edges], axis=0)
            sums[row] = np.stack([parts[:, 1], -parts[:, 0]], axis=-1)
            turns = np.hypot(*np.diff(turned[:, :2], axis=0).T)
            bends[row] = np.add.reduceat(turns, edges[:-1])
            curvatures[row] = np.maximum.reduceat(turns / np.diff(places), edges[:-1])
        if not self._bends_evenly:
            sums = sums[:, :0]
        displacements = self.natural_lengths - lengths
        if not given:
            displacements = _rows(commands)
        shares = np.asarray([s.share for s in shots]).reshape(-1, 1)
        followed = self.natural_lengths - shares * displacements
        slack = ~self._pushes & (lengths < followed - self.tolerance)
        if given:
            slack = ~self._pushes & (_rows(commands) == 0.0)
        tensions = np.asarray([s.tensions for s in shots], dtype=np.float64)
        tensions = tensions.reshape(len(shots), tendons)
        asked = self.natural_lengths - displacements
        if not given:
            asked = asked + self._compliances * tensions
        missed = np.where(slack, 0.0, lengths - asked)
        residual = np.abs(missed).max(axis=1, initial=0.0)
        words = [f"{s.reason}{explain_contrast(self.robot)}" if s.reason else "" for s in shots]
        verdict = (
            np.asarray([not s.reason for s in shots], dtype=np.bool_),
            np.asarray(words, dtype=np.str_),
        )
        verdict = check_numbers(self.robot, frames, residual, self.tolerance, verdict)
        converged, reason = check_limits(
            self.robot, displacements, bends, verdict, curvatures=curvatures, round_off=ROUND_OFF
        )
        return Shape(
            robot=self.robot,
            model=self.name,
            arc_length=self.arc_length,
            frames=frames.reshape(*batch, *frames.shape[1:]),
            displacements=displacements.reshape(commands.shape).copy(),
            tendon_lengths=lengths.reshape(commands.shape),
            section_parameters=sums.reshape(*batch, *sums.shape[1:]),
            tensions=tensions.reshape(commands.shape),
            slack=slack.reshape(commands.shape),
            residual=residual.reshape(batch),
            iterations=np.asarray([s.iterations for s in shots], dtype=np.int64).reshape(batch),
            converged=converged.reshape(batch),
            reason=reason.reshape(batch),
            disc_arc_length=self.robot.disc_arc_length,
        )

    @cached_property
    def _bends_evenly(self) -> bool:
        loads = np.concatenate([self.tip_force, self.tip_moment, self.distributed_force])
        parallel = all(tendon.is_parallel for tendon in self.robot.tendons)
        return parallel and not loads.any()


def _rows(array: Floats) -> Floats:
    """Return (..., t) as (b, t), where b or t may be 0."""
    return array.reshape(math.prod(array.shape[:-1]), array.shape[-1])
