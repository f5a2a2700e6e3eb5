"""What the elastic models share: loads, tendons that stretch or follow, tensions, derivatives."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_kind, check_points, check_word, quantity, take_named
from ..errors import InputError
from ..numeric.arrays import Floats
from .checks import check_values
from .coupling import check_displacements
from .gradients import Held, Response, ShapeJacobian, move_rigidly
from .loads import Load, PackedLoads, check_loads, pack_loads
from .model import (
    BendMeasure,
    ContinuumModel,
    Feature,
    check_limits,
    check_numbers,
    choose_stiffness,
)
from .profile import ROUND_OFF_MM
from .robot import ZERO, RobotDesign, Vector
from .shape import Shape

LIMIT_ROUND_OFF = 1e-6
"""Share of a limit that is an error of the solver."""

REDUNDANT = 1e-9
"""Share of the largest flexibility below which tendons are redundant."""


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


def check_tension_commands(robot: RobotDesign, tensions: ArrayLike) -> Floats:
    """Return tensions (..., t) [N], perhaps by name, as an array; no cable's may be negative."""
    named = take_named("tensions", tensions)
    given = tensions if named is None else robot.order_tensions(named)
    pulls = check_points("tensions", given, dim=len(robot.tendons))
    low = np.where(robot.pushes, -math.inf, 0.0)
    if np.any(pulls < low):
        place = np.argwhere(pulls < low)[0]
        raise InputError(
            f"tension of tendon '{robot.tendon_names[place[-1]]}' is {pulls[tuple(place)]:g} N: "
            "it must lie in [0, inf) N, for a cable does not push"
        )
    return pulls


def check_pretensions(robot: RobotDesign, commands: Floats, compliances: Floats) -> None:
    """Refuse displacements (..., t) of tendons that have a pretension and do not stretch."""
    tense = (robot.pretensions > 0.0) & (compliances == 0.0)
    held = np.isfinite(commands).any(axis=tuple(range(commands.ndim - 1)))
    for index in np.flatnonzero(tense & held):
        raise InputError(
            f"tendon '{robot.tendon_names[index]}' has a pretension, and does not stretch:"
            " give it a stiffness, or command tensions"
        )


@dataclass(frozen=True)
class ElasticModel(ContinuumModel):
    """A model of forces: tendons with displacements or tensions, under loads.

    A subclass sets `name`, and defines `arc_length`, `natural_lengths`, `_solve` and
    `_differentiate`.

    Parameters
    ----------
    robot : RobotDesign
        The robot; its sections' EI and GJ matter here.
    tip_force : (3,) array_like
        Force on the robot's end, in the base frame [N].
    tip_moment : (3,) array_like
        Moment on the robot's end, in the base frame [N mm].
    distributed_force : (3,) array_like
        Force per length of backbone, in the base frame [N/mm].
    loads : sequence of PointLoad or LineLoad
        Further loads.
    tendon_stiffness : float
        EA of the tendons that have none of their own [N]; infinite unless given.
    tolerance : float
        Displacement by which a command may miss being consistent [mm], in (0, 1].

    Raises
    ------
    InputError
        If an option is outside its legal range.
    """

    tip_force: Vector = quantity(
        "force",
        "Force on the tip in the base's frame, such as 0,0,-0.1N; needs --tendon-stiffness.",
        default=ZERO,
        kw_only=True,
    )
    tip_moment: Vector = field(default=ZERO, kw_only=True)
    distributed_force: Vector = quantity(
        "line force",
        "Force per length in the base's frame, such as 0,-0.001N/mm,0; needs --tendon-stiffness.",
        default=ZERO,
        kw_only=True,
        option="line_force",
    )
    loads: Sequence[Load] = field(default=(), kw_only=True)
    tendon_stiffness: float = quantity(
        "force",
        "EA of tendons without one of their own (default: they do not stretch).",
        low=0.0,
        low_open=True,
        default=math.inf,
        kw_only=True,
    )

    heeds = frozenset(get_args(Feature))
    lets_follow = True
    checked_by_class = ("tip_force", "tip_moment", "distributed_force")

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "loads", check_loads(self.robot, self.loads))
        for name in self.checked_by_class:
            vector = check_values(name, getattr(self, name), (3,))
            object.__setattr__(self, name, tuple(vector.tolist()))

    @property
    @abstractmethod
    def arc_length(self) -> Floats:
        """Stations: base, discs, tendon ends and points between [mm], shape (k,)."""

    @property
    @abstractmethod
    def natural_lengths(self) -> Floats:
        """Length of each tendon in the robot at rest, without loads [mm], shape (t,)."""

    def shape(self, displacements: ArrayLike, *, initial: Shape | None = None) -> Shape:
        """Return the shapes under tendon displacements and the loads.

        Parameters
        ----------
        displacements : array_like, shape (..., t)
            How far each tendon is pulled [mm]. One that is NaN follows the robot under its
            pretension; a cable without one is slack.
        initial : Shape, optional
            Where the robot comes from: one shape of an elastic model, or one for each command; the
            robot at rest without tensions unless given. Where there are several equilibria the
            one next to it is taken, and tendons with friction depend on it.

        Returns
        -------
        Shape
            Not converged, with a reason, where there is none: then as far as it can be followed.

        Raises
        ------
        InputError
            If there is not one displacement for each tendon, one is infinite, or one is of a
            tendon that has a pretension and does not stretch.
        """
        return self._solve(self._take_displacements(displacements), "displacements", initial)

    def shape_under_tensions(self, tensions: ArrayLike, *, initial: Shape | None = None) -> Shape:
        """Return the shapes under tensions of the tendons at the base, and the loads.

        Parameters
        ----------
        tensions : array_like, shape (..., t)
            Tension of each tendon [N]; 0 or more unless it is a rod that pushes.
        initial : Shape, optional
            As of `shape`.

        Returns
        -------
        Shape
            Its displacements are those of the tendons in that shape.

        Raises
        ------
        InputError
            If the tensions are not finite numbers of that shape, or a cable's is negative.
        """
        return self._solve(check_tension_commands(self.robot, tensions), "tensions", initial)

    def jacobian(self, shape: Shape, *, held: Held = "displacements") -> ShapeJacobian:
        """Return how the frames of shapes change: the linearised equilibrium.

        Parameters
        ----------
        shape : Shape
            Shapes of this model that have converged.
        held : {"displacements", "tensions"}
            What of the tendons stays where a load, a stiffness, the routing or the base changes;
            displacements hold the tendons that have a tension, and the others follow.

        Raises
        ------
        InputError
            If the shape is not one of this model, or its tendons have friction: derivatives then
            depend on the direction.
        GeometryError
            If a shape has not converged.
        """
        check_word("held", held, get_args(Held))
        check_kind("shape", shape, Shape)
        batch = shape.displacements.shape[:-1]
        if 0 in batch:
            raise InputError("shape holds no shapes: there is nothing to differentiate")
        self._check_initial(shape, batch)
        if shape.model != self.name or shape.arc_length.shape != self.arc_length.shape:
            raise InputError(f"shape is of the {shape.model} model: it must be one of this model")
        shape.require()
        rows = [self._combine(shape, index, held) for index in np.ndindex(batch)]
        parts = {
            name: np.stack([row[name] for row in rows]).reshape(*batch, *rows[0][name].shape)
            for name in rows[0]
        }
        return ShapeJacobian(arc_length=self.arc_length, held=held, **parts)

    @abstractmethod
    def _solve(self, commands: Floats, given: Held, initial: Shape | None) -> Shape:
        """Return the shapes of commands (..., t), which have been checked."""

    @abstractmethod
    def _differentiate(self, shape: Shape, index: tuple[int, ...]) -> Response:
        """Return how one shape of a batch changes while tensions are held."""

    def _combine(self, shape: Shape, index: tuple[int, ...], held: Held) -> dict[str, Floats]:
        """Return the derivatives of one shape, as `ShapeJacobian` names them."""
        robot, tensions = self.robot, shape.tensions[index]
        found, count = self._differentiate(shape, index), len(robot.tendons)
        taut = np.flatnonzero((tensions != 0.0) | robot.pushes)
        own = np.ix_(taut, taut)
        stiffening = np.zeros((count, count))
        stiffening[own] = np.linalg.pinv(
            np.diag(self._compliances[taut]) - found.give[own], rcond=REDUNDANT
        )
        others, first = found.by_others, 6 + 2 * len(robot.sections)
        if held == "displacements":
            # Displacements count from lengths at rest, and longer tendons stretch more.
            more = (tensions - robot.pretensions) * self._compliances / self.natural_lengths
            longer = found.longer.copy()
            columns = first + np.arange(2 * count).reshape(count, 2)
            longer[np.arange(count)[:, None], columns] -= found.rest * (1.0 + more)[:, None]
            others = others + found.by_tension @ (stiffening @ longer)
        cuts = [6, first, first + 2 * count]
        wrench, stiffness, routing, turned = np.split(others, cuts, axis=-1)
        base = move_rigidly(shape.frames[index][:, :3, 3])
        base[..., :3] += turned
        return {
            "by_displacement": found.by_tension @ stiffening,
            "by_tension": found.by_tension,
            "by_tip_wrench": wrench,
            "by_stiffness": stiffness.reshape(*stiffness.shape[:2], -1, 2),
            "by_routing": routing.reshape(*routing.shape[:2], count, 2),
            "by_base": base,
            "tensions_by_displacement": stiffening,
        }

    def _take_displacements(self, displacements: ArrayLike) -> Floats:
        """Check displacements, of which those that are NaN follow."""
        commands = check_displacements(self.robot, displacements, may_follow=True)
        check_pretensions(self.robot, commands, self._compliances)
        return commands

    def _check_initial(self, initial: Shape, batch: tuple[int, ...]) -> list[tuple[int, ...]]:
        """Check where a search begins; return the place in its batch of each command's start."""
        if not isinstance(initial, Shape):
            raise InputError(
                f"initial is of type {type(initial).__name__}: it must be a Shape of this model"
            )
        own = initial.displacements.shape[:-1]
        if own not in ((), batch) or initial.tensions.shape[-1] != len(self.robot.tendons):
            raise InputError(
                f"initial is a shape of the {initial.model} model for {own} commands and "
                f"{initial.tensions.shape[-1]} tensions: it must be one shape, or one for each of "
                f"{batch}, of an elastic model of this robot"
            )
        return [index if own else () for index in np.ndindex(batch)]

    def _answer(
        self,
        displacements: Floats,
        words: Sequence[str],
        *,
        bends: tuple[Floats, Floats],
        frames: Floats,
        residual: Floats,
        **known: NDArray[np.generic],
    ) -> Shape:
        """Return shapes of displacements (..., t), with what is wrong with each, checked.

        `bends` are angles and largest curvatures of the sections; `known` as of `make_shape`.
        """
        measure = BendMeasure(bends=bends[0], curvatures=bends[1], round_off=LIMIT_ROUND_OFF)
        reasons = np.asarray(words, dtype=np.str_)
        verdict = check_numbers(self, frames, residual, (reasons == "", reasons))
        rows = displacements.reshape(len(words), displacements.shape[-1])
        return self.make_shape(
            displacements,
            arc_length=self.arc_length,
            frames=frames,
            discs=None,
            verdict=check_limits(self.robot, rows, measure, verdict),
            residual=residual,
            **known,
        )

    @cached_property
    def _packed_loads(self) -> PackedLoads:
        return pack_loads(
            self.robot,
            self.loads,
            tip_force=self.tip_force,
            tip_moment=self.tip_moment,
            distributed_force=self.distributed_force,
        )

    @cached_property
    def _world_loads(self) -> PackedLoads:
        """Weight and the loads that keep their direction in the world."""
        return pack_loads(self.robot, [load for load in self.loads if load.frame == "world"])

    @cached_property
    def _is_loaded(self) -> bool:
        """Whether loads act, or the robot is curved at rest."""
        return not (self._packed_loads.is_empty and self.robot.is_straight)

    @cached_property
    def _compliances(self) -> Floats:
        """How much each tendon stretches [mm/N], shape (t,)."""
        return self.natural_lengths / choose_stiffness(self.robot, self.tendon_stiffness)

    @cached_property
    def _pretension_stretches(self) -> Floats:
        """How much shorter a tendon is for its pretension [mm], shape (t,)."""
        return self._compliances * self.robot.pretensions
