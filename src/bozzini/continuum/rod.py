"""The reference: a Cosserat rod with tendons, a boundary-value problem."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..checks import quantity, show_apart
from ..errors import InputError
from ..numeric.arrays import Floats
from .elastic import ElasticModel, check_tension_commands, place_stations
from .friction import Channels, FrictionState
from .gradients import Held, Response
from .history import TendonHistory
from .kernels.rod import (
    BEND,
    BY_LENGTHS,
    FORCE,
    LENGTHS,
    MOMENT,
    QUATERNION,
    integrate_rod,
)
from .model import choose_stiffness, explain_contrast
from .rod_grid import RodGrid, list_breaks
from .rod_solver import EMPTY, Rod, RodState, Target, follow, follow_sliding
from .shape import Shape

FEW_STEPS = 24
"""Steps on which a state is looked for."""

LARGEST_LOAD = 1e4
"""Loads at most, against those that bend the robot by 1 rad."""

STRONGEST = 1e4
"""Tension at which a command counts as impossible, against one that bends the robot by 1 rad."""

SLOPE_STEPS = 50
"""Steps on which derivatives are carried along."""


@dataclass(frozen=True)
class RodModel(ElasticModel):
    """Cosserat rod with tendons in smooth channels, with friction or without, under loads.

    After Rucker and Webster (2011). It is there to check the energy model, and for loads: cables
    hold tension or are slack. Shear and stretch are left out unless `stretches`. Sections may be
    curved at rest and change along their length; weights of backbone and discs act along -z of the
    world.

    Without loads every cross-section takes the curvature of least energy under the tensions, and
    those follow from a concave problem, by Newton's method with a line search. With cables only,
    or parallel tendons, there is one answer. Rods that push on other routings may have several
    equilibria: the command is raised in steps from the rod at rest, and curvatures are minima,
    so that the rod is stable by itself; where that way ends, the reason states how far it went.

    With loads the rod is integrated from the base, and the base's moment and the tensions are
    found by multiple shooting with exact derivatives. There may be several equilibria: this finds
    the one that is reached from the rod at rest as loads and displacements are raised together, or
    the one next to `initial`.

    Every equilibrium has the sign of its second variation, with lengths or tensions held as they
    are commanded (`Shape.stability`); where the way to a command ends in an unstable one, the
    shape has not converged and the reason states where it buckles. One that leans to a side as its
    loads grow is followed on that side beyond. Moments, and loads that turn with the body, have no
    potential: for them it is stability against divergence, by the least real part of the tangent's
    eigenvalues.

    Where tendons have a coefficient of friction, tensions fall along them by the capstan law in the
    direction in which they slide, and a shape depends on those before it: `initial` is where they
    come from, the rod at rest without tensions unless given. `bozzini.continuum.friction` has
    the equations. Displacements that leave tensions open, as those of more tendons than the robot
    has freedoms do, take the least tensions at the base.

    A shape beyond a tendon's travel or a section's `max_bend`, or so curved that discs meet, has
    not converged. A section's bend is here the integral of its curvature. Stiffnesses of the
    backbone may differ by a factor of 1e6.

    Parameters
    ----------
    robot : RobotDesign
        The robot; its sections' EI and GJ matter here. It may be without tendons.
    tip_force : (3,) array_like
        Force on the robot's end, in the base frame [N].
    tip_moment : (3,) array_like
        Moment on the robot's end, in the base frame [N mm].
    distributed_force : (3,) array_like
        Force per length of backbone, in the base frame [N/mm].
    loads : sequence of PointLoad or LineLoad
        Further loads.
    stretches : bool
        Whether the backbone shears and stretches, by EA and GA of the sections.
    tendon_stiffness : float
        EA of the tendons that have none of their own [N]; infinite unless given. Parallel
        tendons that do not stretch leave a backbone that does not stretch no twist: a load that
        twists it needs this, and is refused without it where the tolerance would decide where
        the tip is.
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

    stretches: bool = field(default=False, kw_only=True)
    between: int = quantity(
        help="Further stations between two discs.",
        low=0,
        high=1000,
        whole=True,
        default=0,
        kw_only=True,
        by_name=True,
    )
    steps: int = quantity(
        help="Least number of steps along the robot.",
        low=10,
        high=100_000,
        whole=True,
        default=200,
        kw_only=True,
        by_name=True,
    )

    name = "rod"
    takes_friction = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.stretches, bool):
            raise InputError(f"stretches is {self.stretches!r}: it must be true or false")
        if self.stretches and self.robot.tendon_friction.any():
            raise InputError(
                "stretches is true, and tendons have friction: it must be false for such a robot"
            )
        middles = 0.5 * (self.robot.section_starts + self.robot.section_ends)
        if self.stretches and not np.isfinite(self.robot.stiffness_at(middles)[:, :3]).any():
            raise InputError(
                "stretches is true, and no section has a finite stretch_stiffness (EA) or "
                "shear_stiffness (GA): give one, or leave stretches false"
            )

    @cached_property
    def arc_length(self) -> Floats:
        """Stations: base, discs, tendon ends and points between [mm], shape (k,)."""
        return place_stations(self.robot, self.between)

    @property
    def natural_lengths(self) -> Floats:
        """Length of each tendon in the robot at rest, without loads [mm], shape (t,)."""
        return self._rod.fine.natural_lengths

    def trace_tensions(self, history: ArrayLike, *, initial: Shape | None = None) -> TendonHistory:
        """Return the shapes on the way through tensions of the tendons, each from the one before.

        Parameters
        ----------
        history : array_like, shape (n, t)
            Tensions at the base [N], in the order of time. Their rate does not matter.
        initial : Shape, optional
            Where the first one comes from; the straight robot without tensions unless given.

        Raises
        ------
        InputError
            As `shape_under_tensions`, or if the history has another shape.
        """
        return self._trace(check_tension_commands(self.robot, history), "tensions", initial)

    def trace_displacements(
        self, history: ArrayLike, *, initial: Shape | None = None
    ) -> TendonHistory:
        """Return the shapes on the way through displacements [mm]; see `trace_tensions`."""
        return self._trace(self._take_displacements(history), "displacements", initial)

    def _differentiate(self, shape: Shape, index: tuple[int, ...]) -> Response:
        if self._channels is not None:
            raise InputError("tendons have friction: derivatives depend on the direction then")
        rod, count = self._derivative_rod, len(self.robot.tendons)
        grid, (lines, points, none), shears = rod.packed_fine
        (world_lines, world_points, _) = self._world.packed_fine[1]
        lines = np.concatenate([lines, world_lines[:, :, :1]], axis=2)
        points = np.concatenate([points, world_points[:, :2]], axis=1)
        packed = grid, (lines, points, none), shears
        parts, tensions = len(self.robot.sections), shape.tensions[index]
        start = self._start_at(rod, shape, index)
        if rod.load > 0.0 or rod.shears:
            start = rod.follow(self._make_target(tensions, "tensions"), start, first=1.0)
        owners = self.robot.section_at(rod.fine.inner_places[:, 1])
        slopes = np.zeros((12 + count, 12 + 3 * count + 2 * parts))
        slopes[3:9, 3:9] = np.eye(6)
        states = np.zeros_like(start.states)
        states[0, QUATERNION] = 1.0
        states[0, FORCE:MOMENT] = start.states[0, FORCE:MOMENT]
        states[0, MOMENT : MOMENT + 3] = start.moments[0]
        found = np.zeros((len(self.arc_length), 6, slopes.shape[1]))
        stops = rod.fine.find(self.arc_length)
        sections = owners, parts
        for station, span in enumerate(zip(stops[:-1], stops[1:], strict=True), start=1):
            integrate_rod(*span, packed, 1.0, tensions, states, slopes, sections, EMPTY)
            found[station, :3], found[station, 3:] = slopes[:3], slopes[-3:]
        # The loads on the tip fix moment and force at the base.
        ends, lengths = slopes[3:9], slopes[BY_LENGTHS : BY_LENGTHS + count]
        solved = np.linalg.solve(ends[:, 3:9], np.hstack([np.eye(6), -ends[:, 9:]]))
        moved, longer = found[..., 3:9] @ solved, lengths[:, 3:9] @ solved
        moved[..., 6:] += found[..., 9:]
        longer[:, 6:] += lengths[:, 9:]
        pulled = slice(6, 6 + count)
        return Response(
            by_tension=moved[..., pulled],
            by_others=np.delete(moved, pulled, axis=-1),
            give=longer[:, pulled],
            longer=np.delete(longer, pulled, axis=-1),
            rest=rod.fine.rest_changes,
        )

    @cached_property
    def _derivative_rod(self) -> Rod:
        """The rod in as many steps as derivatives need."""
        rod = self._rod
        fixed = np.concatenate([self.arc_length, list_breaks(self.robot, rod.loads)])
        return dataclasses.replace(rod, fine=rod.fine.thin(fixed, SLOPE_STEPS))

    @cached_property
    def _world(self) -> Rod:
        """The same under loads of the world alone."""
        return dataclasses.replace(self._derivative_rod, loads=self._world_loads)

    @cached_property
    def _rod(self) -> Rod:
        loads = self._packed_loads
        breaks = list_breaks(self.robot, loads)
        fine = RodGrid.cut(self.robot, np.concatenate([self.arc_length, breaks]), self.steps)
        coarse = fine.thin(breaks, FEW_STEPS)
        coarse = fine if len(coarse.places) == len(fine.places) else coarse
        return Rod(fine=fine, coarse=coarse, loads=loads, shears=self.stretches)

    @cached_property
    def _channels(self) -> Channels | None:
        """What holds the tendons in their channels; None without friction."""
        friction = self.robot.tendon_friction
        if not friction.any():
            return None
        return Channels(
            grid=self._rod.fine.packed,
            friction=friction,
            flexibility=1.0 / choose_stiffness(self.robot, self.tendon_stiffness),
        )

    def _make_target(self, command: Floats, given: Held) -> Target:
        """What displacements or tensions (t,) ask of the tendons."""
        pulled = given == "tensions"
        holds = np.isfinite(command) & (not pulled)
        lengths = -command - self._pretension_stretches
        return Target(
            names=self.robot.tendon_names,
            pushes=self.robot.pushes,
            compliances=self._compliances,
            tolerance=self.tolerance,
            reaches=self._rod.fine.reaches,
            holds=holds,
            rest=np.where(holds, self.natural_lengths, 0.0),
            change=np.where(holds, lengths, command if pulled else self.robot.pretensions),
            strongest=STRONGEST * self._rod.unit_tension,
        )

    def _begin(
        self, initial: Shape | None, batch: tuple[int, ...]
    ) -> list[tuple[FrictionState | None, RodState | None]]:
        """Return the state of friction before each command of a batch, and where to begin."""
        channels = self._channels
        if initial is None:
            return [(None if channels is None else channels.rest(), None)] * math.prod(batch)
        places = self._check_initial(initial, batch)
        if channels is None:
            return [(None, self._start_at(self._rod, initial, place)) for place in places]
        state = initial.friction
        if state is None or state.tensions.shape[-3:] != channels.rest_rates.shape:
            raise InputError(
                f"initial is a shape of the {initial.model} model without tensions in the channels "
                "of this robot: it must be one of the same rod model, steps included"
            )
        initial.require()
        return [(state.pick(place), None) for place in places]

    def _solve(self, commands: Floats, given: Held, initial: Shape | None) -> Shape:
        targets = [self._make_target(row, given) for row in _rows(commands)]
        begins = self._begin(initial, commands.shape[:-1])
        rod_states = [self._shoot(t, *begin) for t, begin in zip(targets, begins, strict=True)]
        return self._describe(commands, given, rod_states)

    def _trace(self, history: Floats, given: Held, initial: Shape | None) -> TendonHistory:
        """Shoot one command after the other, each from the one before."""
        if history.ndim != 2 or not len(history):
            raise InputError(
                f"history has shape {history.shape}: it must be (n, {history.shape[-1]}), n at "
                "least 1"
            )
        ((friction_state, start),) = self._begin(initial, ())
        rod_states: list[RodState] = []
        for row in history:
            state = self._shoot(self._make_target(row, given), friction_state, start)
            rod_states.append(state)
            if not state.reason:
                start, friction_state = state, state.friction
        return TendonHistory(shapes=self._describe(history, given, rod_states), given=given)

    def _shoot(
        self, target: Target, state: FrictionState | None, start: RodState | None
    ) -> RodState:
        if self._rod.load > LARGEST_LOAD:
            shown = show_apart(self._rod.load, LARGEST_LOAD)
            raise InputError(
                f"loads and weight are {shown[0]} times what bends the robot by 1 rad: "
                f"it must be at most {shown[1]} times"
            )
        if self._channels is not None and state is not None:
            return follow_sliding(self._rod, target, self._channels, state, start)
        convex = not self.robot.pushes.any() or self.robot.is_parallel
        return follow(self._rod, target, convex=convex, start=start)

    def _describe(self, commands: Floats, given: Held, rod_states: list[RodState]) -> Shape:
        """Shapes of shots."""
        from scipy.spatial.transform import Rotation

        count, rod = len(self.robot.tendons), self._rod
        places, stations = rod.fine.places, self.arc_length
        index = rod.fine.find(stations)
        ends = self.robot.section_ends
        edges = rod.fine.find(np.concatenate([[0.0], ends]))
        states = (
            np.stack([state.states for state in rod_states])
            if rod_states
            else np.zeros((0, len(places), LENGTHS + count))
        )
        frames = np.zeros((len(rod_states), len(index), 4, 4))
        frames[..., 3, 3] = 1.0
        if rod_states:
            quaternions = np.roll(
                states[:, index, QUATERNION : QUATERNION + 4], -1, axis=-1
            ).reshape(-1, 4)
            frames[..., :3, :3] = (
                Rotation.from_quat(quaternions).as_matrix().reshape(*frames.shape[:2], 3, 3)
            )
        frames[..., :3, 3] = states[:, index, :3]
        lengths = states[:, -1, LENGTHS:]
        turned = states[:, :, BEND : BEND + 3]
        parts = np.diff(turned[:, edges], axis=1)
        sums = np.stack([parts[..., 1], -parts[..., 0]], axis=-1)
        steps = np.hypot(*np.moveaxis(np.diff(turned[..., :2], axis=1), -1, 0))
        bends = np.add.reduceat(steps, edges[:-1], axis=1)
        curvatures = np.maximum.reduceat(steps / np.diff(places), edges[:-1], axis=1)
        tensions = np.array([state.tensions for state in rod_states]).reshape(
            len(rod_states), count
        )
        if self._channels is None:
            stretched = self._compliances * tensions
        else:
            stretched = np.array(
                [
                    self._channels.stretch(state.friction.tensions)
                    for state in rod_states
                    if state.friction is not None
                ]
            ).reshape(tensions.shape)
        slack_at_rest = self._pretension_stretches
        followed = self.natural_lengths - lengths + stretched - slack_at_rest
        if given == "tensions":
            displacements = followed
            slack = ~self.robot.pushes & (_rows(commands) == 0.0)
            asked = lengths
        else:
            displacements = np.where(np.isnan(_rows(commands)), followed, _rows(commands))
            load_factors = np.array([state.load_factor for state in rod_states]).reshape(-1, 1)
            limits = self.natural_lengths - load_factors * (displacements + slack_at_rest)
            loose = (lengths < limits - self.tolerance) | np.isnan(_rows(commands))
            slack = ~self.robot.pushes & loose & (tensions == 0.0)
            asked = self.natural_lengths - displacements - slack_at_rest + stretched
        residual = np.abs(np.where(slack, 0.0, lengths - asked)).max(axis=1, initial=0.0)
        words = [
            f"{s.reason}{explain_contrast(self.robot)}" if s.reason else "" for s in rod_states
        ]
        made = self._answer(
            displacements.reshape(commands.shape),
            words,
            bends=(bends, curvatures),
            frames=frames,
            tendon_lengths=lengths,
            section_parameters=sums if self._bends_evenly else sums[:, :0],
            tensions=tensions,
            slack=slack,
            residual=residual,
            iterations=np.asarray([s.iterations for s in rod_states], dtype=np.int64),
            stability=np.asarray([s.stability for s in rod_states], dtype=np.float64),
        )
        known = [state.friction for state in rod_states if state.friction is not None]
        if not known:
            return made
        return dataclasses.replace(made, friction=FrictionState.join(known, commands.shape[:-1]))

    def _start_at(self, rod: Rod, initial: Shape, index: tuple[int, ...]) -> RodState:
        """Return a state near to a shape: forces and moments balance the loads on it."""
        from scipy.spatial.transform import Rotation

        places, cuts, frames = rod.fine.places, rod.fine_cuts[:-1], initial.frames[index]
        quaternions = Rotation.from_matrix(frames[:, :3, :3]).as_quat()
        # Of the two quaternions of a rotation the one that is near to that before.
        quaternions[1:] *= np.cumprod(np.sign(np.sum(quaternions[1:] * quaternions[:-1], axis=1)))[
            :, None
        ]
        known = np.hstack([frames[:, :3, 3], quaternions]).T
        points, quaternions = np.split(
            np.stack([np.interp(places, initial.arc_length, row) for row in known], axis=1), [3], 1
        )
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
        (lines, at, _), matrices = rod.packed_fine[1], Rotation.from_quat(quaternions).as_matrix()
        middles = 0.5 * (matrices[1:] + matrices[:-1])
        loads = np.diff(places)[:, None] * (
            lines[:, 1, 0] + np.einsum("nij,nj->ni", middles, lines[:, 1, 1])
        )
        own = at[1:, :2] + np.einsum("nij,nkj->nki", matrices[1:], at[1:, 2:])
        # Forces of all steps from here on, and their moments about the base.
        levers = 0.5 * (points[1:] + points[:-1]), points[1:]
        moments = np.cross(levers[0], loads) + np.cross(levers[1], own[:, 0]) + own[:, 1]
        sums = np.hstack([loads + own[:, 0], moments])[::-1].cumsum(axis=0)[::-1][cuts]
        start = rod.rest()
        start.tensions[:] = initial.tensions[index]
        start.quaternions[:] = np.roll(quaternions[cuts], 1, axis=1)
        start.forces[:] = sums[:, :3]
        start.moments[:] = sums[:, 3:] - np.cross(points[cuts], sums[:, :3])
        return start

    @cached_property
    def _bends_evenly(self) -> bool:
        return self.robot.is_parallel and self._channels is None and not self._is_loaded


def _rows(array: Floats) -> Floats:
    """Return (..., t) as (b, t), where b or t may be 0."""
    return array.reshape(math.prod(array.shape[:-1]), array.shape[-1])
