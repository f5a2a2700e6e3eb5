"""Equilibria of the discrete rod under loads, followed from rest, and whether they are stable.

With rotation vectors ``w`` (n, 3) of the segments [rad], ``u`` at rest, ``K = diag(EI, EI, GJ) /
h`` and tendon lengths ``l_k(w)``, an equilibrium is::

    K (w - u) + sum_k T_k dl_k/dw - (dx/dw)^T F - (dtheta/dw)^T M = 0
    l_k - c_k T_k = limit_k  of a rod that pushes;  of a cable  <= ,  T_k >= 0 , one with equality

or ``T_k`` given. ``x`` and ``theta`` are place and rotation of the points where forces ``F`` and
moments ``M`` act; line loads are lumped at the middles of the segments. `kernels.equilibrium`
solves it from a start; here one factor of command and loads is raised from the robot at rest, by
increments in which rotations change by at most 1 rad in sum.

*Stability* is the least eigenvalue of ``K^-1/2 (tangent + sum_k dl_k dl_k^T / c_k) K^-1/2`` over
the taut tendons of which the length is held; rigid ones, ``c_k = 0``, are projected out. Without a
potential it is the least real part. docs/theory/continuum.md has its limits.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..numeric.arrays import Floats
from .kernels.energy import CHANNEL, CONVERGED, NOT_CONVERGED, measure_lengths
from .kernels.equilibrium import (
    fill_proximities,
    make_state,
    measure_equilibrium,
    solve_equilibrium,
)
from .loads import BODY, PackedLoads
from .robot import RobotDesign

if TYPE_CHECKING:
    from .energy import Grid

MOST_STEPS = 80
"""Steps of Newton's method for one part of a command and its loads."""

LEAST_INCREMENT = 1.0 / 64.0
"""Smallest increment of the factor by which a command and its loads are raised."""

LARGEST_CHANGE = 1.0
"""Change of the segments' rotations, summed, beyond which an increment is halved [rad]."""

INCREMENT_ROTATION = 2.0
"""Rotation that the first increment may bring, as a guess from the straight rod [rad]."""

ZERO_MODE = 1e-9
"""Stability, against the straight rod's, that is round-off."""

KICK = 1e-3
"""Turn of the softest mode, of all segments together, by which a shape is tried [rad]."""

BUCKLING_SHARE = 1e-4
"""Relative error of the buckling load."""


@dataclass(frozen=True, eq=False)
class LumpedLoads:
    """Loads lumped at points of a discrete rod, as the kernels take them.

    Attributes
    ----------
    segments, parts, offsets : (p,), (p,), (p, 3) ndarray
        Segment, part of it before the point, in [0, 1], and place in the cross-section [mm].
    forces, moments : (p, 3) ndarray
        Forces [N] and moments [N mm], in base axes or in those of the body.
    follows : (p,) ndarray of bool
        Which turn with the body.
    """

    segments: NDArray[np.int64]
    parts: Floats
    offsets: Floats
    forces: Floats
    moments: Floats
    follows: NDArray[np.bool_]

    @classmethod
    def place(cls, robot: RobotDesign, arc_length: Floats, packed: PackedLoads) -> LumpedLoads:
        """Put loads on the segments between stations; forces along the rod by their middles.

        Those before the first station act on nothing that moves.
        """
        edges = np.unique(np.concatenate([arc_length, packed.line_spans.ravel()]))
        edges = edges[edges >= arc_length[0]]
        middles = 0.5 * (edges[1:] + edges[:-1])
        dead, body = packed.line_forces_at(robot, middles)
        spans = np.diff(edges)[:, None]
        places = np.concatenate([packed.points, middles, middles])
        forces = np.concatenate([packed.forces, spans * dead, spans * body])
        moments = np.zeros_like(forces)
        moments[: len(packed.points)] = packed.moments
        follows = np.repeat([False, True], len(middles))
        follows = np.concatenate([packed.frames == BODY, follows])
        used = (forces.any(axis=1) | moments.any(axis=1)) & (places > arc_length[0])
        segments = np.searchsorted(arc_length, places[used], side="left") - 1
        segments = np.clip(segments, 0, len(arc_length) - 2)
        spans = np.diff(arc_length)[segments]
        return cls(
            segments=segments.astype(np.int64),
            parts=np.clip((places[used] - arc_length[segments]) / spans, 0.0, 1.0),
            offsets=np.zeros((len(segments), 3)),
            forces=forces[used],
            moments=moments[used],
            follows=follows[used],
        )

    def scale(self, load_factor: float) -> LumpedLoads:
        """Return the loads times a factor."""
        return dataclasses.replace(
            self, forces=load_factor * self.forces, moments=load_factor * self.moments
        )

    @property
    def places(self) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Segments, parts and offsets, as the kernels take points."""
        return self.segments, self.parts, self.offsets

    @property
    def have_potential(self) -> bool:
        """Whether all are forces of one direction."""
        return not (self.follows.any() or self.moments.any())

    @cached_property
    def reach(self) -> float:
        """Size of the loads as a moment, with lever 1 of every point and moments [N, N mm]."""
        return float(np.linalg.norm(self.forces, axis=1).sum())


@dataclass(frozen=True)
class Factors:
    """How much of the command and of the loads there is."""

    command: float = 1.0
    loads: float = 1.0


WHOLE = Factors()


@dataclass(frozen=True, eq=False)
class TendonCommand:
    """What the tendons of one robot are told to do.

    Parameters
    ----------
    free_lengths : (t,) ndarray
        Lengths of the tendons without tension [mm]; where a tension is commanded they do not count.
    rest_lengths : (t,) ndarray
        The same where nothing is commanded.
    held : (t,) ndarray of bool
        Which lengths are held; the tension of the others is.
    pulls : (t,) ndarray
        Tensions of those that are not held [N].
    """

    free_lengths: Floats
    rest_lengths: Floats
    held: NDArray[np.bool_]
    pulls: Floats

    def limits(self, factors: Factors) -> Floats:
        """Lengths without tension under a part of the command [mm], shape (t,)."""
        return self.rest_lengths + factors.command * (self.free_lengths - self.rest_lengths)


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """An equilibrium of a discrete rod, or how far one got.

    Attributes
    ----------
    rotation_vectors : (n, 3) ndarray
        Rotations of the segments [rad].
    tensions, lengths : (t,) ndarray
        Of the tendons [N], [mm].
    length_gradients : (t, n, 3) ndarray
        Derivatives of the lengths by the rotations [mm/rad].
    blocks : (n, 3, 3) ndarray
        Second derivatives of the lengths, times the tensions.
    gradient, hessian : (n, 3), (3 n, 3 n) ndarray
        Residual of the equilibrium [N mm], and its tangent with the tensions held.
    code, steps, error : int, int, float
        Of the kernel; steps of Newton's method; largest error of a length [mm].
    load_factor : float
        Part of command and loads under which it is one.
    """

    rotation_vectors: Floats
    tensions: Floats
    lengths: Floats
    length_gradients: Floats
    blocks: Floats
    gradient: Floats
    hessian: Floats
    code: int
    steps: int
    error: float
    load_factor: float = 1.0

    @property
    def found(self) -> bool:
        """Whether it is one."""
        return self.code == CONVERGED


def make_equilibrium(
    rotation_vectors: Floats, state: tuple[Floats, ...], *, code: int, steps: int, error: float
) -> Equilibrium:
    """Return an equilibrium of what the kernels fill."""
    lengths, trial, length_gradients, _, blocks, gradient, hessian = state
    return Equilibrium(
        rotation_vectors=rotation_vectors,
        tensions=trial,
        lengths=lengths,
        length_gradients=length_gradients,
        blocks=blocks,
        gradient=gradient,
        hessian=hessian,
        code=code,
        steps=steps,
        error=error,
    )


@dataclass(frozen=True, eq=False)
class LoadedRod:
    """A discrete rod with its natural shape, its tendons and its loads."""

    grid: Grid
    lumped_loads: LumpedLoads
    rest: Floats
    compliances: Floats
    pushes: NDArray[np.bool_]
    tolerance: float

    def solve(
        self,
        command: TendonCommand,
        factors: Factors,
        start: tuple[Floats, Floats],
    ) -> Equilibrium:
        """Return the equilibrium that Newton's method finds from rotation vectors and tensions."""
        rotation_vectors, tensions = start[0].copy(), start[1].copy()
        state = make_state(len(rotation_vectors), len(tensions))
        one_sided = command.held & ~self.pushes
        pulls = factors.command * command.pulls
        rod = self._pack(command.held, pulls, factors.loads)
        limits = command.limits(factors)
        round_off = 1e-11 * float(limits.max(initial=0.0))
        # As commanded to round-off; with the tolerance only where that cannot be.
        code, count, error = NOT_CONVERGED, 0, 0.0
        for allowed in (1e-4 * self.tolerance, 0.5 * self.tolerance):
            rotation_vectors[:], tensions[:] = start
            code, steps, error, _ = solve_equilibrium(
                rod,
                limits + np.where(one_sided, allowed, 0.0),
                allowed + round_off,
                MOST_STEPS,
                rotation_vectors,
                tensions,
                state,
            )
            count += steps
            if code == CONVERGED or not command.held.any():
                break
        return make_equilibrium(
            rotation_vectors, state, code=int(code), steps=count, error=float(error)
        )

    def measure(self, factors: Factors, rotation_vectors: Floats, tensions: Floats) -> Equilibrium:
        """Return residual and tangent at given rotations and tensions, in equilibrium or not."""
        state = make_state(len(rotation_vectors), len(tensions))
        rod = self._pack(np.zeros(len(tensions), dtype=np.bool_), tensions, factors.loads)
        measure_equilibrium(rod, tensions, rotation_vectors, tensions, state)
        return make_equilibrium(rotation_vectors, state, code=CONVERGED, steps=0, error=0.0)

    def _pack(
        self, held: NDArray[np.bool_], pulls: Floats, load_factor: float
    ) -> tuple[object, ...]:
        """The rod as the kernels take it, with its loads times a factor."""
        proximities = np.empty(len(pulls))
        fill_proximities(self.grid.packed, self.compliances, held, proximities)
        tendons = self.compliances, held, held & ~self.pushes, pulls, proximities
        own = self.lumped_loads
        loads = load_factor * own.forces, load_factor * own.moments, own.follows
        return self.grid.packed, self.rest, tendons, own.places, loads

    def follow(
        self, command: TendonCommand, *, initial: tuple[Floats, Floats] | None = None
    ) -> list[Equilibrium]:
        """Return equilibria up to the whole command and loads, raised together from rest.

        By increments so small that shapes follow each other, unless the rod snaps. If the last one
        is not that of the whole, it is as far as they can be followed. From `initial`, rotation
        vectors and tensions, it is tried at once.
        """
        if initial is not None:
            found = self.solve(command, WHOLE, initial)
            if found.found:
                return [found]
        state = self.rest.copy(), np.where(command.held, 0.0, command.pulls)
        path: list[Equilibrium] = []
        reached, increment, steps = 0.0, self._first_increment(command), 0
        while True:
            load_factor = min(1.0, reached + increment)
            load_factor = 1.0 if load_factor > 1.0 - 1e-9 else load_factor
            found = self.solve(command, Factors(load_factor, load_factor), state)
            steps += found.steps
            change = np.linalg.norm(found.rotation_vectors - state[0], axis=1).sum()
            halved = increment > LEAST_INCREMENT and (not found.found or change > LARGEST_CHANGE)
            if halved:
                increment *= 0.5
                continue
            if not found.found:
                last = path[-1] if path else self.measure(Factors(0.0, 0.0), *state)
                ended = dataclasses.replace(last, code=found.code, steps=steps, load_factor=reached)
                return [*path, ended]
            reached, state = load_factor, (found.rotation_vectors, found.tensions)
            path.append(dataclasses.replace(found, load_factor=reached, steps=steps))
            if reached == 1.0:
                return path
            increment = min(2.0 * increment, 1.0)

    def start_path(
        self,
        command: TendonCommand,
        factors: Factors,
        *,
        initial: tuple[Floats, Floats] | None = None,
    ) -> Equilibrium:
        """Return the equilibrium under a part of command and loads, followed from rest."""
        part = dataclasses.replace(
            command,
            free_lengths=command.limits(factors),
            pulls=factors.command * command.pulls,
        )
        return dataclasses.replace(
            self, lumped_loads=self.lumped_loads.scale(factors.loads)
        ).follow(part, initial=initial)[-1]

    def measure_energy(self, found: Equilibrium) -> float:
        """Return the elastic energy of backbone and tendons [N mm]."""
        bent = found.rotation_vectors - self.rest
        stretched = self.compliances * found.tensions**2
        return 0.5 * float((self.grid.stiffness * bent**2).sum() + stretched.sum())

    def measure_stability(self, command: TendonCommand, found: Equilibrium) -> float:
        """Return the least eigenvalue of the second variation, against the straight rod's.

        Lengths that are held and carry tension do not change, or stretch their tendon. Loads
        without a potential have a tangent that is not symmetric: least real part then.
        """
        matrix = self._second_variation(command, found)
        least = find_least_eigenvalue(matrix, symmetric=self.lumped_loads.have_potential)
        if self.grid.packed[5] == CHANNEL:
            # In finer and finer segments, one that gives way alone is enough.
            scale = 1.0 / np.sqrt(self.grid.stiffness)
            own = found.blocks * scale[:, :, None] * scale[:, None, :] + np.eye(3)
            alone = float(np.linalg.eigvalsh(own).min())
            least = min(least, alone) if alone < -ZERO_MODE else least
        return least

    def _find_softest_mode(self, command: TendonCommand, found: Equilibrium) -> Floats:
        """Rotations (n, 3) of the softest mode, under loads with a potential."""
        modes = np.linalg.eigh(self._second_variation(command, found))[1]
        return np.asarray(modes[:, 0].reshape(-1, 3) / np.sqrt(self.grid.stiffness))

    def _second_variation(self, command: TendonCommand, found: Equilibrium) -> Floats:
        taut = command.held & ((found.tensions != 0.0) | self.pushes)
        rows = found.length_gradients.reshape(len(taut), -1)[taut]
        return vary_twice(found.hessian, self.grid.stiffness.ravel(), rows, self.compliances[taut])

    def settle(
        self, command: TendonCommand, found: Equilibrium, factors: Factors = WHOLE
    ) -> tuple[Equilibrium, float]:
        """Return the equilibrium and its stability; kicked where tendons without tension may hold.

        A tendon of the commanded length without tension holds what would lengthen it: then the
        shape comes back from a kick.
        """
        least = self.measure_stability(command, found)
        limits = command.limits(factors)
        idle = command.held & ~self.pushes & (found.tensions == 0.0)
        idle &= found.lengths > limits - 2.0 * self.tolerance
        if least > -ZERO_MODE or not idle.any() or not self.lumped_loads.have_potential:
            return found, least
        mode = self._find_softest_mode(command, found)
        kick = KICK * mode / np.linalg.norm(mode)
        for sign in (1.0, -1.0):
            other = self.solve(
                command, factors, (found.rotation_vectors + sign * kick, found.tensions)
            )
            if (
                not other.found
                or np.abs(other.rotation_vectors - found.rotation_vectors).max() > KICK
            ):
                return found, least
            known = self.measure_stability(command, other)
            if known <= -ZERO_MODE:
                return found, least
            back, value = other, known
        return dataclasses.replace(back, steps=found.steps, load_factor=found.load_factor), value

    def find_buckling(
        self, command: TendonCommand, path: list[Equilibrium]
    ) -> tuple[float, tuple[Floats, Floats]]:
        """Return from which part of command and loads on a followed path is unstable.

        1 if it is not; and rotation vectors and tensions just before.
        """
        low, high = 0.0, 1.0
        state = self.rest, np.where(command.held, 0.0, command.pulls)
        for found in path:
            if self.settle(command, found, Factors(found.load_factor, found.load_factor))[1] < 0.0:
                high = found.load_factor
                break
            low, state = found.load_factor, (found.rotation_vectors, found.tensions)
        while high - low > BUCKLING_SHARE * high:
            middle = 0.5 * (low + high)
            part = Factors(middle, middle)
            found = self.solve(command, part, state)
            if not found.found:
                break
            if self.settle(command, found, part)[1] < 0.0:
                high = middle
            else:
                low, state = middle, (found.rotation_vectors, found.tensions)
        return high, state

    def _first_increment(self, command: TendonCommand) -> float:
        """First increment of the load factor: what may rotate the straight rod little."""
        ends = self.grid.arc_length[self.lumped_loads.segments + 1]
        moment = float(np.linalg.norm(self.lumped_loads.forces, axis=1) @ ends)
        moment += float(np.linalg.norm(self.lumped_loads.moments, axis=1).sum())
        rotation = moment * float((1.0 / self.grid.stiffness[:, :2]).max(axis=1).sum())
        reach = self.grid.reach.max(axis=1)
        pulled = np.where(command.held, np.abs(command.free_lengths - command.rest_lengths), 0.0)
        rotation += float((pulled / reach).max(initial=0.0))
        increment = 1.0
        while increment * rotation > INCREMENT_ROTATION and increment > LEAST_INCREMENT:
            increment *= 0.5
        return increment


MOST_INVERSE_ITERATIONS, LEAST_CHANGE = 60, 1e-7
"""Steps of the search for the least eigenvalue, and its relative change at the last one."""

STIFF_MODE = 1e3
"""Stability that stands for a direction which is held."""


def vary_twice(hessian: Floats, stiffness: Floats, rows: Floats, compliances: Floats) -> Floats:
    """Return the second variation (n, n) in rotations scaled by the backbone's stiffness (n,).

    `rows` (h, n) are the gradients of what is held, a length or a gap, with a compliance (h,)
    [mm/N]; rigid ones are stiff directions.
    """
    scale = 1.0 / np.sqrt(stiffness)
    matrix = hessian * scale[:, None] * scale
    rows, soft = rows * scale, compliances > 0.0
    matrix += rows[soft].T @ (rows[soft] / compliances[soft, None])
    rows = rows[~soft]
    if len(rows):
        from scipy.linalg import qr

        basis, pivots, _ = qr(rows.T, mode="economic", pivoting=True)
        pivots = np.abs(np.diag(pivots))
        fixed = basis.T[: len(pivots)][pivots > 1e-9 * pivots.max(initial=0.0)]
        across = fixed @ matrix
        inner = across @ fixed.T + STIFF_MODE * np.eye(len(fixed))
        matrix += fixed.T @ (inner @ fixed - across) - (matrix @ fixed.T) @ fixed
    return np.asarray(matrix)


def find_least_eigenvalue(matrix: Floats, *, symmetric: bool) -> float:
    """Return the least eigenvalue, or real part of one.

    Loads without a potential have a tangent that is not symmetric. By inverse iteration where all
    are positive and the least stands alone enough.
    """
    if not symmetric:
        return float(np.linalg.eigvals(matrix).real.min())
    from scipy.linalg.lapack import dpotrf, dpotrs

    lower, info = dpotrf(matrix, lower=1)
    # A start that has a part along every shape.
    vector, value = np.cos(np.arange(len(matrix)) ** 1.5), np.inf
    for _ in range(MOST_INVERSE_ITERATIONS if info == 0 else 0):
        image = dpotrs(lower, vector, lower=1)[0]
        before, value = value, float(image @ vector) / float(image @ image)
        if abs(value - before) <= LEAST_CHANGE * value:
            return value
        vector = image / np.linalg.norm(image)
    return float(np.linalg.eigvalsh(matrix)[0])


def measure_rest(grid: Grid) -> Floats:
    """Return the tendons' lengths in the robot at rest, without loads [mm], shape (t,)."""
    count, segments = len(grid.counts), len(grid.spans)
    lengths, length_gradients = np.empty(count), np.empty((count, segments, 3))
    blocks = np.empty((2, segments, 3, 3))
    measure_lengths(grid.packed, grid.rest, np.zeros(count), lengths, length_gradients, *blocks)
    return lengths
