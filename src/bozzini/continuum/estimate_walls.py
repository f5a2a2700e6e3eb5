"""Walls around a robot that is estimated: springs on its rod that begin softly.

A ball of the body's radius about each station has the gap ``c`` to a wall, by the smooth signed
distance of `walls`. Its force is ``f = s / e log(1 + exp(-c / s))``: with a compliance ``e`` so
small that a rigid wall is hardly entered, and a beginning ``s`` so short that it is hardly felt
before. So shape, forces and readings depend smoothly on the state, and have exact derivatives. The
equilibrium is found by Newton's method, with steps that end near the least energy along them, and
where that fails from a shape far off, through softer walls.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.linalg import solve
from numpy.typing import NDArray

from ..numeric.arrays import Floats
from .contact_solver import factor, measure_radii
from .equilibrium import LumpedLoads
from .kernels.contact import add_contacts
from .kernels.energy import fill_frames, measure_lengths
from .kernels.equilibrium import make_state, measure_equilibrium
from .robot import RobotDesign
from .walls import Boundary

PackedGrid: TypeAlias = tuple[Floats, Floats, Floats, Floats, NDArray[np.int64], int]
"""A grid as the kernels take it."""

BEGINS, GIVES = 1e-3, 4e-4
"""Where the force of a wall begins, and how deep `bend` presses the body in, by its radius."""
FELT = 30.0
"""Beginnings away from a wall that feel nothing of it."""
STEPS, STEP_LIMIT, LEAST_PART = 60, 0.3, 1e-6
"""Steps of Newton's method, the largest turn of a segment in one [rad], least part of a step."""
PASSED = 0.5
"""Slope of the energy at the end of a step, against that at its beginning, if it went too far."""
STILL = 1e-8
"""Turn of a step after which the equilibrium is found [rad]."""
SOFTER = (1e3, 1e2, 10.0, 1.0)
"""Walls through which a shape far off is brought in, by their compliance and beginning."""


class WallPush(NamedTuple):
    """What walls do to the stations but the first, in the world.

    Attributes
    ----------
    forces : (n, 3) ndarray
        [N].
    blocks : (n, 3, 3) ndarray
        How they fall with the place [N/mm].
    gaps : (n,) ndarray
        Between body and nearest wall [mm]; infinite where it is far.
    """

    forces: Floats
    blocks: Floats
    gaps: Floats


class PressedRod(NamedTuple):
    """A rod that walls press: the grid, its rest, loads, tendons, and its base in the world.

    Attributes
    ----------
    grid : tuple
        As the kernels take it.
    rest : (n, 3) ndarray
        Rotation vectors [rad].
    loads : LumpedLoads
    pull : callable
        Returns tensions [N] and stiffnesses [N/mm] of tendons of lengths [mm].
    axes, shift : (3, 3), (3,) ndarray
        Of the base in the world, and how far it is from where the walls are seen from [mm].
    """

    grid: PackedGrid
    rest: Floats
    loads: LumpedLoads
    pull: Callable[[Floats], tuple[Floats, Floats]]
    axes: Floats
    shift: Floats


class Pressed(NamedTuple):
    """A rod among walls at some rotation vectors.

    Attributes
    ----------
    rotation_vectors : (n, 3) ndarray
        [rad].
    state : tuple
        Of `measure_equilibrium`; the Hessian has the walls, not the tendons.
    push : WallPush
    matrix : (3 n, 3 n) ndarray
        The Hessian with the tendons.
    """

    rotation_vectors: Floats
    state: tuple[Floats, ...]
    push: WallPush
    matrix: Floats


@dataclass(frozen=True, eq=False)
class PressingWalls:
    """Walls of a robot whose stations are at arc lengths (n + 1,) [mm], rigid unless given."""

    boundaries: tuple[Boundary, ...]
    robot: RobotDesign
    arc_length: Floats
    wall_stiffness: float | None = None

    @cached_property
    def radii(self) -> Floats:
        """Of the body at the stations but the first [mm], (n,)."""
        return measure_radii(self.robot, self.arc_length[1:])

    @cached_property
    def compliances(self) -> Floats:
        """Of the walls at these [mm/N], (n,)."""
        middles = 0.5 * (self.arc_length[1:] + self.arc_length[:-1])
        bend = float(self.robot.stiffness_at(middles)[:, 3].max()) / self.robot.length**2
        rigid = GIVES * self.radii / bend
        if self.wall_stiffness is None:
            return np.asarray(rigid)
        spans = np.append(np.diff(self.arc_length), 0.0)
        return np.asarray(rigid + 2.0 / (self.wall_stiffness * (spans[1:] + spans[:-1])))

    def push(self, points: Floats, softer: float = 1.0) -> WallPush:
        """Return what walls do to the stations at points (n, 3) seen from their origin [mm]."""
        from scipy.special import expit

        count = len(points)
        forces, blocks = np.zeros((count, 3)), np.zeros((count, 3, 3))
        gaps, nothing = np.full(count, np.inf), np.zeros(count, dtype=np.bool_)
        begin, give = softer * BEGINS * self.radii, softer * self.compliances
        for wall in self.boundaries:
            margin = FELT * float(begin.max())
            own, gap, gradient, curvature = wall.measure_near(points, self.radii, nothing, margin)
            share = gap / begin[own]
            force = begin[own] / give[own] * np.logaddexp(0.0, -share)
            stiffness = expit(-share) / give[own]
            gaps[own] = np.minimum(gaps[own], gap)
            forces[own] += force[:, None] * gradient
            both = gradient[:, :, None] * gradient[:, None]
            blocks[own] += stiffness[:, None, None] * both - force[:, None, None] * curvature
        return WallPush(forces, blocks, gaps)

    def measure(self, rod: PressedRod, rotation_vectors: Floats, softer: float) -> Pressed:
        """Return a rod at rotation vectors (n, 3), out of balance."""
        n = len(rotation_vectors)
        axes, points = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
        fill_frames(rod.grid, rotation_vectors, axes, points)
        push = self.push(points[1:] @ rod.axes.T + rod.shift, softer)
        never = np.zeros(len(rod.grid[4]), dtype=np.bool_)
        state = make_state(n, len(never))
        measure_lengths(rod.grid, rotation_vectors, 0.0 * state[0], *state[:1], *state[2:5])
        pulls, stiffnesses = rod.pull(state[0])
        none = np.zeros(len(never))
        places = (np.arange(n), np.ones(n), np.zeros((n, 3)))
        stations = tuple(map(np.concatenate, zip(rod.loads.places, places, strict=True)))
        loads = (
            np.concatenate([rod.loads.forces, push.forces @ rod.axes]),
            np.concatenate([rod.loads.moments, np.zeros((n, 3))]),
            np.concatenate([rod.loads.follows, np.zeros(n, dtype=np.bool_)]),
        )
        whole = rod.grid, rod.rest, (none, never, never, pulls, none), stations, loads
        measure_equilibrium(whole, none, rotation_vectors, none, state)
        blocks = np.ascontiguousarray(rod.axes.T @ push.blocks @ rod.axes)
        add_contacts(rod.grid, rotation_vectors, blocks, np.zeros((n, 3)), *state[5:])
        slopes = state[2].reshape(len(never), -1)
        return Pressed(
            rotation_vectors, state, push, state[6] + slopes.T @ (stiffnesses[:, None] * slopes)
        )

    def settle(self, rod: PressedRod, start: Floats) -> Pressed | None:
        """Return the equilibrium that is found from rotation vectors (n, 3); None without one."""
        found = self._settle(rod, start, 1.0)
        if found is not None:
            return found
        for softer in SOFTER:
            found = self._settle(rod, start, softer)
            if found is None:
                return None
            start = found.rotation_vectors
        return found

    def _settle(self, rod: PressedRod, start: Floats, softer: float) -> Pressed | None:
        from scipy.linalg import cho_solve

        found, stiffness = self.measure(rod, start.copy(), softer), rod.grid[1].ravel()
        for _ in range(STEPS):
            slope = found.state[5].ravel()
            lower, shift = factor(found.matrix, stiffness)
            symmetric = shift > 0 or rod.loads.have_potential
            step = -cho_solve((lower, True), slope) if symmetric else -solve(found.matrix, slope)
            size = math.sqrt(float((step.reshape(-1, 3) ** 2).sum(axis=1).max()))
            begin, part = float(slope @ step), min(1.0, STEP_LIMIT / max(size, 1e-300))
            while True:
                turned = found.rotation_vectors + part * step.reshape(-1, 3)
                other = self.measure(rod, turned, softer)
                if size <= STILL:
                    return other
                end = float(other.state[5].ravel() @ step)
                if end <= PASSED * abs(begin):
                    break
                part *= min(max(begin / (begin - end), 0.1), 0.5)
                if part < LEAST_PART:
                    return None
            found = other
        return None
