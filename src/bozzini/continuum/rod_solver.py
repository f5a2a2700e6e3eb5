"""Equilibria of a Cosserat rod with tendons: a boundary-value problem, by multiple shooting.

With force ``N`` and moment ``M`` of all loads beyond a cross-section, force per length ``f``, in
base axes; curvature ``u``, and places ``r_k`` and unit tangents ``t_k`` of the tendons, in the axes
``R`` of the cross-section; tensions ``T_k``; lengths ``l_k`` of the tendons from the base on::

    p' = R e_z ,  R' = R [u] ,  N' = -f ,  M' = -p' x N ,  l_k' = |e_z + u x r_k + r_k'|
    K (u - u*) + sum_k T_k r_k x t_k(u) = R^T M

after Rucker and Webster (2011); `kernels.rod` has shear and stretch, docs/theory/continuum.md the
rest. At the base ``p = 0`` and ``R = 1``, beyond the load on the tip ``N = M = 0``. Of each tendon
the tension is given, or its length ``l_k - c_k T_k = goal_k`` with its compliance ``c_k``; of a
cable ``T_k >= 0`` and ``l_k - c_k T_k <= goal_k``, one of them with equality.

*Unknowns*, the rod being cut into pieces: ``M`` at the base, then at the start of each further
piece its rotation about base axes [rad] and ``M``; after each ``M`` also ``N`` if loads turn with
the body, for otherwise ``N`` is known: 6 p - 3 or 9 p - 3 of them, moments by `Rod.unit`, forces by
that over the length. Beside them the tensions (t,) [N].

*Method*: Newton's method with exact derivatives on the defects between the pieces, the tensions
from a complementarity problem of t unknowns in each step. One load factor multiplies command and
loads and is raised from the rod at rest; each equilibrium on the way must have a positive second
variation. That is done on a coarse grid; the last state is improved on the fine one until defects
are at most 1e-10 and lengths are right within the tolerance. Without loads ``M = 0``, and the
tensions maximise the concave ``sum over s of min_u (1/2 (u - u*) K (u - u*) + sum_k T_k |t_k(u)|) -
T goal - 1/2 c T^2`` (``t_k`` not normalised), by Newton's method with a line search.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..numeric.arrays import Floats
from ..numeric.kernels.linear_algebra import factor_lu, solve_bounded, solve_complementary, solve_lu
from .equilibrium import ZERO_MODE, find_least_eigenvalue, vary_twice
from .friction import Bending, Channels, DriveCommand, FrictionState, Sliding
from .kernels import shooting
from .kernels.rod import (
    LENGTHS,
    MOMENT,
    QUATERNION,
    integrate_rod,
    measure_unloaded,
)
from .loads import BODY, PackedLoads
from .model import (
    advise_contradiction,
    explain_play,
)
from .rod_grid import Packed, RodGrid
from .stability import count_negative, measure_stability

PackedRod = tuple[Packed, tuple[Floats, Floats, Floats], bool]
Steps = tuple[PackedRod, NDArray[np.int64]]
Variables = tuple[Floats, Floats, Floats, Floats, Floats]
Form = tuple[Floats, Floats, Floats, Floats]
Conditions = tuple[float, Floats, NDArray[np.bool_], Floats, Floats, Floats]
Linearisation = tuple[Floats, NDArray[np.int64], Floats, Floats, Floats]

FOUND, STOPPED, BROKEN, BUCKLING, HELD, UNSTABLE = range(6)
"""Codes: found; no equilibrium; rod breaks down; singular; tensions at their limit; a saddle."""

ROTATION_LIMIT = 0.5
"""Largest rotation of a piece's start in one step [rad]."""

RIDGE = 1e-8
"""Added to the tendons' own flexibility, so that redundant tendons have one answer."""

SLOW = 0.3
"""Factor by which defects must fall where derivatives are those of another grid."""

MOST_STEPS, FEW_MORE = 25, 6
"""Newton steps at one load factor, and with derivatives that are known."""

SMALL_DEFECT, ROUGH_DEFECT = 1e-10, 1e-3
"""Defects between pieces that are none, in the end and on the way there [rad], or of moments."""

FAIR_DEFECT = 3e-4
"""The same on the coarse grid, one step of Newton's method before the fine one is taken."""

MOST_HALVINGS = 4
"""Times that a step of Newton's method is halved where the rod breaks down or defects grow."""

GROWTH = 3.0
"""Growth of the defects at which a step is halved."""

ROUND_OFF = 1e-3
"""Part of the tolerance of lengths that is let through unless more is needed."""

SMALLEST_PART = 1.0 / 64.0
"""Smallest increment of the load factor, by the first one, where larger ones fail."""

BUCKLING_PART = 1e-4
"""Load factor to which the load is found that makes a rod unstable."""

SOFT = 10.0
"""Singular values, against the least, of the ways in which a rod is about to buckle."""

LEAST_BRANCH_RATE = 1e-9
"""Rate of bending to a side, by the load factor, that is not round-off [rad]."""

BEYOND = 1.05
"""Loads, against those under which a rod buckles, under which its bent branch is looked for."""

BRANCH_AMPLITUDES = (0.5, 1.0, 0.25, 2.0, 0.1)
"""Sizes of the bends from which it is looked for [rad]."""

PIECES = 0.5
"""Pieces of the shooting by the root of the loads, beside the first."""

NO_LINEARISATION: Linearisation = (
    np.zeros((0, 0)),
    np.zeros(0, dtype=np.int64),
    np.zeros((0, 0)),
    np.zeros((0, 0)),
    np.zeros((0, 0)),
)

EMPTY: Form = (
    np.zeros((0, 6, 6)),
    np.zeros((0, 3, 3)),
    np.zeros((0, 0, 6)),
    np.zeros((0, 0, 0)),
)


Solved = tuple[Steps, Floats, Form]
"""Steps of a rod, the states at their ends, and the second variation there."""


class Limits(NamedTuple):
    """Defect and residual of lengths that are let through, and the most steps.

    From a defect of `enough` on, one more step will do.
    """

    defect: float
    residual: float
    steps: int = MOST_STEPS
    enough: float = 0.0


# What is prescribed of the tendons, a state of the rod, and the rod.


@dataclass(frozen=True, kw_only=True)
class Target:
    """What is asked of the tendons.

    Attributes
    ----------
    names : tuple of str
        Their names.
    pushes : (t,) ndarray of bool
        Which of them are rods.
    compliances : (t,) ndarray
        How much they stretch by their tension [mm/N].
    tolerance : float
        Error of their lengths that is let through [mm].
    reaches : (t,) ndarray
        Their least distances from the backbone [mm].
    holds : (t,) ndarray of bool
        Of which of them the length is given, of the others the tension.
    rest, change : (t,) ndarray
        Lengths [mm] or tensions [N] without a command, and how it changes them.
    strongest : float
        Tension at which a command is impossible [N].
    """

    names: tuple[str, ...]
    pushes: NDArray[np.bool_]
    compliances: Floats
    tolerance: float
    reaches: Floats
    holds: NDArray[np.bool_]
    rest: Floats
    change: Floats
    strongest: float

    @cached_property
    def bounds(self) -> tuple[Floats, Floats, Floats]:
        """Compliances, lowest and highest tensions, as the kernels take them."""
        high = np.full(len(self.names), self.strongest)
        return self.compliances, np.where(self.pushes, -high, 0.0), high

    @property
    def is_rigid(self) -> bool:
        """Whether lengths are given of tendons, and none stretches."""
        return bool(self.holds.any()) and not self.compliances.any()

    def prescribe(self, load_factor: float, length_tolerance: float) -> Floats:
        """Return lengths [mm] or tensions [N] at a load factor, cables longer by a tolerance."""
        return np.asarray(
            self.rest + load_factor * self.change + length_tolerance * (self.holds & ~self.pushes)
        )

    def make_conditions(self, load_factor: float, length_tolerance: float) -> Conditions:
        """Return what `Rod.improve` takes at a load factor."""
        return load_factor, self.prescribe(load_factor, length_tolerance), self.holds, *self.bounds

    def find_residuals(
        self, lengths: Floats, tensions: Floats, load_factor: float, length_tolerance: float
    ) -> Floats:
        """Return how far lengths are from what is asked [mm]; 0 for slack cables."""
        residuals = (
            lengths - self.compliances * tensions - self.prescribe(load_factor, length_tolerance)
        )
        slack = ~self.pushes & (tensions == 0.0)
        return np.asarray(self.holds * np.where(slack, np.maximum(residuals, 0.0), residuals))

    def find_taut(self, states: Floats, tensions: Floats, load_factor: float) -> NDArray[np.bool_]:
        """Return which tendons hold a length, (t,): with tension, or about to have one."""
        residuals = (
            states[-1, LENGTHS:] - self.compliances * tensions - self.prescribe(load_factor, 0.0)
        )
        return np.asarray(self.holds & ((tensions != 0.0) | (residuals > -2.0 * self.tolerance)))

    def find_held(
        self, states: Floats, tensions: Floats, load_factor: float
    ) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
        """Return compliances, which tendons are taut and which of these are idle cables."""
        taut = self.find_taut(states, tensions, load_factor)
        return self.compliances, taut, taut & ~self.pushes & (tensions == 0.0)

    def resolve_redundancy(self, flexibility: Floats, tensions: Floats, ridge: float) -> Floats:
        """Return the least tensions that do the same, where redundant tendons leave them open.

        `flexibility` is that of lengths under tension (t, t) [mm/N], `ridge` what is added to its
        diagonal, by the largest of it.
        """
        if not flexibility.size or self.compliances.any():
            return tensions
        taut, shared = (tensions != 0.0) & self.holds, tensions.copy()
        high = np.where(taut, float(np.abs(tensions).max(initial=0.0)), tensions)
        low = np.where(taut, np.where(self.pushes, -high, 0.0), tensions)
        added = ridge * float(np.abs(np.diag(flexibility)).max(initial=0.0))
        matrix, vector = flexibility + added * np.eye(len(taut)), -flexibility @ tensions
        right = vector
        for _ in range(3):
            # Each pass takes out what the ridge did to the one before it.
            if not solve_bounded(matrix, right, low, high, shared):
                return tensions
            right = vector - added * shared
        return shared

    def explain(self, code: int, tensions: Floats, residuals: Floats, *, loaded: bool) -> str:
        """Return the reason why there is no equilibrium beyond where the rod is."""
        if code == HELD:
            held = np.flatnonzero(self.holds & (np.abs(tensions) >= self.strongest))
            names = ", ".join(f"'{self.names[k]}'" for k in held)
            return (
                f"{names} would have to stretch beyond it; let out tendons on the other side; "
                f"{advise_contradiction(self.tolerance)}"
            )
        if code == BUCKLING:
            return "the rod is about to buckle beyond it"
        worst = int(np.argmax(np.abs(residuals))) if self.holds.any() else -1
        where = (
            f", tendon '{self.names[worst]}' misses by {abs(residuals[worst]):.3g} mm"
            if worst >= 0 and residuals[worst] != 0.0
            else ""
        )
        advice = "; give a tendon_stiffness" if loaded and self.is_rigid else ""
        return f"no equilibrium was found beyond it{where}{advice}"


@dataclass(frozen=True, kw_only=True)
class RodState:
    """A state of the rod: tensions, and quaternion, moment and force at the start of every piece.

    Attributes
    ----------
    tensions : (t,) ndarray
        At the base [N].
    quaternions : (p, 4) ndarray
        Axes of the cross-sections at the pieces' starts, real part first.
    moments, forces : (p, 3) ndarray
        Of all loads beyond them, in base axes [N mm], [N].
    states : (n + 1, 16 + t) ndarray
        At all steps' ends, columns as of `kernels.rod`.
    load_factor : float
        Part of command and loads that it holds for; `reason` states why it is not 1.
    friction : FrictionState, optional
        Of tendons with friction.
    linearisation : Linearisation
        Factors of its derivatives, see `Rod.improve`.
    stability : float
        As of `Shape`.
    """

    tensions: Floats
    quaternions: Floats
    moments: Floats
    forces: Floats
    states: Floats
    load_factor: float = 0.0
    iterations: int = 0
    reason: str = ""
    friction: FrictionState | None = None
    linearisation: Linearisation = NO_LINEARISATION
    stability: float = 1.0

    @property
    def unknowns(self) -> tuple[Floats, Floats, Floats, Floats]:
        """What Newton's method improves in place: tensions, quaternions, moments, forces."""
        return self.tensions, self.quaternions, self.moments, self.forces

    @property
    def variables(self) -> Variables:
        """The same, and the states at all places."""
        return *self.unknowns, self.states

    def copy_unknowns(self) -> list[Floats]:
        """Return them as they are now, for `restore`."""
        return [array.copy() for array in self.unknowns]

    def copy(self) -> RodState:
        """Return another one to be improved."""
        names = ("tensions", "quaternions", "moments", "forces", "states")
        return dataclasses.replace(self, **{name: getattr(self, name).copy() for name in names})


def restore(variables: Iterable[Floats], kept: Iterable[Floats]) -> None:
    """Set arrays of a state to what they were."""
    for now, before in zip(variables, kept, strict=False):
        now[:] = before


@dataclass(frozen=True, kw_only=True)
class Rod:
    """A rod on a fine grid, and on a coarse one to look for its state with.

    Attributes
    ----------
    fine, coarse : RodGrid
        The steps.
    loads : PackedLoads
        Loads and weights.
    shears : bool
        Whether it shears and stretches.
    changes : (n, 3, t) or (0, 3, 0) ndarray
        By how much friction makes tensions differ from those at the base [N].
    """

    fine: RodGrid
    coarse: RodGrid
    loads: PackedLoads
    shears: bool
    changes: Floats = field(default_factory=lambda: np.zeros((0, 3, 0)))

    @cached_property
    def load(self) -> float:
        """Moment of loads about the straight base, by the least stiffness over the length."""
        places, grid = self.coarse.places, self.coarse
        dead, body = self.loads.line_forces_at(grid.robot, grid.inner_places[:, 1])
        lines = np.diff(places) * (np.linalg.norm(dead, axis=1) + np.linalg.norm(body, axis=1))
        total = float(grid.inner_places[:, 1] @ lines)
        total += float(self.loads.points @ np.linalg.norm(self.loads.forces, axis=1))
        total += float(np.linalg.norm(self.loads.moments, axis=1).sum())
        return total * grid.robot.length / float(grid.stiffness[..., 3:].min())

    @cached_property
    def unit(self) -> float:
        """Unit of moments: the largest stiffness over the length [N mm], for about 1 rad."""
        return float(self.fine.stiffness[..., 3:].max() / self.fine.robot.length)

    @cached_property
    def unit_tension(self) -> float:
        """Tension that bends it by about 1 rad [N]."""
        return self.unit / float(self.fine.reaches.min(initial=self.fine.robot.radius))

    @cached_property
    def follows(self) -> bool:
        """Whether there are loads that turn with the body."""
        return bool((self.loads.frames == BODY).any() or (self.loads.line_frames == BODY).any())

    @cached_property
    def has_potential(self) -> bool:
        """Whether all loads are forces of one direction."""
        return not (self.follows or self.loads.moments.any())

    @cached_property
    def pieces(self) -> int:
        """Pieces of the shooting: without loads no moment goes over from one to the next."""
        count = 1 + math.ceil(PIECES * math.sqrt(self.load))
        return min(count, len(self.coarse.places) - 1)

    @cached_property
    def coarse_cuts(self) -> NDArray[np.int64]:
        """First coarse step of every piece, and the last one's end, shape (pieces + 1,)."""
        cuts = np.linspace(0.0, len(self.coarse.places) - 1.0, self.pieces + 1)
        return np.round(cuts).astype(np.int64)

    @cached_property
    def fine_cuts(self) -> NDArray[np.int64]:
        """The same on the fine grid."""
        return self.fine.find(self.coarse.places[self.coarse_cuts])

    @property
    def fine_steps(self) -> Steps:
        """The fine steps as of `integrate_rod`, and the first of every piece."""
        return self.packed_fine, self.fine_cuts

    @cached_property
    def coarse_steps(self) -> Steps:
        """The coarse steps as of `integrate_rod`, and the first of every piece."""
        loads = *self._place_loads(self.coarse), np.zeros((0, 3, 0))
        return (self.coarse.packed, loads, self.shears), self.coarse_cuts

    @cached_property
    def packed_fine(self) -> PackedRod:
        """What the kernels take of the fine steps."""
        return self.fine.packed, (*self._place_loads(self.fine), self.changes), self.shears

    def with_changes(self, changes: Floats) -> Rod:
        """Return the rod with changes of tensions, and the fine steps alone."""
        made = dataclasses.replace(self, coarse=self.fine, changes=changes)
        grid, (lines, points, _), shears = self.packed_fine
        packed = grid, (lines, points, changes), shears
        kept = {name: getattr(self, name) for name in ("load", "unit", "follows", "pieces")}
        made.__dict__.update(kept, coarse_steps=(packed, self.fine_cuts), packed_fine=packed)
        made.__dict__.update(coarse_cuts=self.fine_cuts, fine_cuts=self.fine_cuts)
        return made

    def rest(self) -> RodState:
        """Return the rod under none of its command."""
        return self._at_rest.copy()

    @cached_property
    def _at_rest(self) -> RodState:
        tendons = self.fine.guides.shape[2]
        states = np.zeros((len(self.fine.places), LENGTHS + tendons))
        states[:, QUATERNION] = 1.0
        tensions, slopes = np.zeros(tendons), np.zeros((0, 0))
        sections, last = shooting.NO_SECTIONS, len(states) - 1
        integrate_rod(0, last, self.packed_fine, 0.0, tensions, states, slopes, sections, EMPTY)
        return RodState(
            tensions=tensions,
            quaternions=states[self.fine_cuts[:-1], QUATERNION : QUATERNION + 4].copy(),
            moments=np.zeros((self.pieces, 3)),
            forces=np.zeros((self.pieces, 3)),
            states=states,
        )

    def follow(
        self, target: Target, start: RodState, *, first: float, passes: bool = False
    ) -> RodState:
        """Return the rod's state as command and loads are raised from that of `start`."""
        state = start.copy()
        coarse_states = state.states
        if self.coarse is not self.fine:
            coarse_states = np.zeros((len(self.coarse.places), state.states.shape[1]))
        linearisation = self.make_linearisation(len(state.tensions))
        form = make_form(self.coarse, len(state.tensions))
        coarse_variables, one = (*state.unknowns, coarse_states), self.coarse is self.fine
        code, steps, reached, increment, failed = FOUND, 0, 0.0, first, 1.0
        kept, length_tolerance = state.copy_unknowns(), ROUND_OFF * target.tolerance
        branched = False
        while reached < 1.0:
            # Equilibrium at the next load factor, on the coarse grid.
            load_factor = min(1.0, reached + increment)
            load_factor = 1.0 if load_factor > 1.0 - 1e-9 else load_factor
            limits = Limits(
                ROUGH_DEFECT, max(length_tolerance, 1e-2 * ROUGH_DEFECT * self.fine.robot.length)
            )
            if load_factor == 1.0:
                limits = Limits(SMALL_DEFECT, length_tolerance, enough=0.0 if one else FAIR_DEFECT)
            conditions = target.make_conditions(load_factor, length_tolerance)
            code, count = self.improve(
                self.coarse_steps, coarse_variables, conditions, linearisation, limits, form
            )
            steps += count
            if code == FOUND and not passes:
                solved = self.coarse_steps, coarse_states, form
                if not self.is_stable(target, solved, state.tensions, load_factor):
                    code = UNSTABLE
            flips = reached > 0.0 and np.vdot(state.moments, kept[2]) < 0.0
            if code == FOUND and flips and increment > SMALLEST_PART * first and not passes:
                # Maybe to the other side, beyond buckling: smaller increments show it.
                restore(state.unknowns, kept)
                increment *= 0.5
                continue
            if code == FOUND:
                kept, reached, increment = state.copy_unknowns(), load_factor, 1.5 * increment
                continue
            # None there, or no stable one: the whole tolerance, smaller increments, other branches.
            failed = load_factor
            restore(state.unknowns, kept)
            if length_tolerance < target.tolerance and code not in (UNSTABLE, BUCKLING):
                length_tolerance = target.tolerance
                continue
            increment *= 0.5
            if increment < SMALLEST_PART * first and not branched:
                further = (
                    self.switch_branch(target, state, coarse_states, reached)
                    if code == UNSTABLE
                    else 0.0
                )
                branched = further <= reached
                if not branched:
                    kept, reached, increment = state.copy_unknowns(), further, first
            if branched and (code != UNSTABLE or increment < BUCKLING_PART):
                break
        solved = self.coarse_steps, coarse_states, form
        if reached == 1.0:
            # The same on the fine grid, with the derivatives of the coarse one.
            variables, conditions = state.variables, target.make_conditions(1.0, length_tolerance)
            if not one:
                limits = Limits(SMALL_DEFECT, length_tolerance, FEW_MORE)
                code, count = self.improve(
                    self.fine_steps, variables, conditions, linearisation, limits
                )
                steps += count
            if code != FOUND:
                # Derivatives of the coarse grid do not do: where they are almost singular.
                form = make_form(self.fine, len(state.tensions))
                limits = Limits(SMALL_DEFECT, length_tolerance)
                code, count = self.improve(
                    self.fine_steps, variables, conditions, linearisation, limits, form
                )
                steps += count
                solved = self.fine_steps, state.states, form
        reason, stability = "", 1.0
        if code == FOUND or code == UNSTABLE:
            load_factor = 1.0 if code == FOUND else failed
            stability = self.measure_stability(target, solved, state.tensions, load_factor)
        what = "command and loads" if self.load > 0.0 else "the command"
        if code == UNSTABLE:
            reason = f"unstable: the robot buckles at {100.0 * reached:.3g} % of {what}"
            force = float(np.linalg.norm(self.loads.forces.sum(axis=0)))
            if force > 0.0 and len(self.loads.points):
                reason += f", {reached * force:.4g} N"
        elif code != FOUND:
            residuals = target.find_residuals(
                coarse_states[-1, LENGTHS:], state.tensions, failed, length_tolerance
            )
            why = target.explain(code, state.tensions, residuals, loaded=self.load > 0.0)
            percent = math.floor(100.0 * reached)
            reason = f"{what} can be followed to {percent} % only: {why}"
        return dataclasses.replace(
            state,
            load_factor=reached,
            iterations=steps,
            reason=reason,
            linearisation=linearisation,
            stability=stability,
        )

    def improve(
        self,
        steps: Steps,
        variables: Variables,
        conditions: Conditions,
        linearisation: Linearisation,
        limits: Limits,
        form: Form = EMPTY,
    ) -> tuple[int, int]:
        """Improve a state by Newton's method; returns a code and the steps taken.

        With defects ``d(x, T)`` of n unknowns ``x`` and residuals ``g(x, T) = l - c T - goal`` of t
        lengths, a step solves::

            d + d_x dx + d_T dT = 0 ,   g + g_x dx + (g_T - c) dT = 0  (or T = 0 of a slack cable)

        by ``dx = -d_x^-1 d - (d_x^-1 d_T) dT``. `linearisation` are the factors of ``d_x`` (n, n)
        and its order of rows, ``d_x^-1 d_T`` (n, t), ``g_x`` (t, n), and the flexibility of lengths
        ``g_x d_x^-1 d_T - g_T + c`` (t, t) [mm/N]. They are filled unless `form` is empty, and
        otherwise taken as they are.
        """
        matrix, order, variable_by_tension, length_by_variable, flexibility = linearisation
        (packed, cuts), tensions, fresh = steps, variables[0], len(form[0]) > 0
        load_factor, prescribed, holds, compliances, low, _ = conditions
        units = self.unit, float(self.fine.places[-1])
        length_by_tension, step = np.empty_like(flexibility), np.empty(len(order))
        kept: Iterable[Floats] = variables
        taken, before, damping, halved, count = step, math.inf, 1.0, 0, -1
        # Given tensions are taken at once: the lengths follow.
        wanted = np.where(holds, tensions, prescribed)
        tensions[:] = wanted
        while True:
            count += 1
            system = matrix, variable_by_tension, length_by_variable, length_by_tension
            defect = shooting.shoot(
                packed, cuts, self.unit, load_factor, variables, step, system, form
            )
            if defect == math.inf or (fresh and defect > max(GROWTH * before, 0.1)):
                if not fresh or not count or halved == MOST_HALVINGS:
                    return BROKEN, count
                halved, damping = halved + 1, 0.5 * damping
                restore(variables, kept)
            else:
                if fresh:
                    # Eliminate the unknowns: what is left is the flexibility of the lengths.
                    if not factor_lu(matrix, order):
                        return BUCKLING, count
                    solve_lu(matrix, order, variable_by_tension)
                    flexibility[:] = length_by_variable @ variable_by_tension - length_by_tension
                    flexibility.flat[:: len(flexibility) + 1] += compliances
                residuals = variables[4][-1, LENGTHS:] - compliances * tensions - prescribed
                over = np.where((low == 0.0) & (tensions == 0.0), residuals, np.abs(residuals))
                residual = float(over.max(initial=0.0, where=holds))
                if defect <= limits.defect and residual <= limits.residual:
                    return FOUND, count
                defect = max(defect, residual / units[1])
                if count >= limits.steps or (not fresh and defect > SLOW * before):
                    return STOPPED, count
                # Tensions for which lengths are right to first order, then the unknowns by them.
                solve_lu(matrix, order, step[:, None])
                code, wanted = solve_tensions(
                    conditions, flexibility, residuals - length_by_variable @ step, tensions
                )
                if code != FOUND:
                    tensions[:] = wanted
                    return code, count
                taken = -step - variable_by_tension @ (wanted - tensions)
                kept, before, damping, halved = (
                    [array.copy() for array in variables[:4]],
                    defect,
                    1.0,
                    0,
                )
                if self.pieces > 1:
                    free = 9 if self.follows else 6
                    rotations = [taken[at : at + 3] for at in range(free - 3, len(taken), free)]
                    widest = float(np.linalg.norm(rotations, axis=1).max())
                    damping = ROTATION_LIMIT / max(widest, ROTATION_LIMIT)
            shooting.move(variables, *units, taken, damping)
            tensions += damping * (wanted - tensions)
            if before <= limits.enough:
                return FOUND, count + 1

    def switch_branch(
        self, target: Target, state: RodState, coarse_states: Floats, load_factor: float
    ) -> float:
        """Bring a rod that is about to buckle at a load factor to the bent branch beyond.

        That on the side to which it bends as loads grow. Improves the state's unknowns and returns
        the load factor that it then bears; 0, and leaves them, if there is no side or no such
        branch.
        """
        kept, variables = state.copy_unknowns(), (*state.unknowns, coarse_states)
        linearisation, form = (
            self.make_linearisation(len(kept[0])),
            make_form(self.coarse, len(kept[0])),
        )
        length_tolerance, length = ROUND_OFF * target.tolerance, float(self.fine.places[-1])
        limits = Limits(SMALL_DEFECT, length_tolerance)
        self.improve(
            self.coarse_steps,
            variables,
            target.make_conditions(load_factor, length_tolerance),
            linearisation,
            limits,
            form,
        )
        taut = target.find_taut(coarse_states, state.tensions, load_factor)
        direction = self._find_branch_direction(target, variables, load_factor, taut)
        size, pulls = len(linearisation[1]), state.tensions.copy()
        pulls[taut] += direction[size:] * self.unit_tension
        # A cable about to have a tension has two sides of its own.
        loses = bool((taut & ~target.pushes & (state.tensions == 0.0)).any())
        further = min(1.0 - 1e-6, BEYOND * load_factor)
        for amplitude in () if loses or not direction.any() else BRANCH_AMPLITUDES:
            restore(state.unknowns, kept)
            shooting.move(variables, self.unit, length, direction[:size].copy(), amplitude)
            pulled = state.tensions + amplitude * (pulls - state.tensions)
            np.maximum(pulled, target.bounds[1], out=state.tensions)
            conditions = target.make_conditions(further, length_tolerance)
            code, _ = self.improve(
                self.coarse_steps, variables, conditions, linearisation, limits, form
            )
            if code != FOUND:
                continue
            ways = [direction[at : at + 3] for at in range(0, size, 9 if self.follows else 6)]
            at = self.coarse_steps, coarse_states, form
            stable = self.is_stable(target, at, state.tensions, further)
            if stable and np.vdot(state.moments - kept[2], ways) > 0.0:
                return further
        restore(state.unknowns, kept)
        return 0.0

    def _find_branch_direction(
        self, target: Target, variables: Variables, load_factor: float, taut: NDArray[np.bool_]
    ) -> Floats:
        """Unit step of unknowns and taut tendons to where a soft rod bends as loads grow; or 0.

        With the matrix ``A`` of defects and residuals of taut lengths by unknowns and tensions, and
        their rate ``b`` by the load factor, it is the part of ``-A^-1 b`` along the singular
        vectors of the least singular values.
        """
        tendons, change = len(taut), 1e-6
        matrix, _, defect_by_tension, length_by_variable, _ = self.make_linearisation(tendons)
        form, length_by_tension = make_form(self.coarse, tendons), np.zeros((tendons, tendons))
        defects, before = np.empty((2, len(matrix)))
        system = matrix, defect_by_tension, length_by_variable, length_by_tension
        shooting.shoot(
            *self.coarse_steps, self.unit, load_factor - change, variables, before, system, form
        )
        lengths = variables[4][-1, LENGTHS:].copy()
        shooting.shoot(*self.coarse_steps, self.unit, load_factor, variables, defects, system, form)
        given = np.where(target.holds, 0.0, target.change)
        longer = (
            (variables[4][-1, LENGTHS:] - lengths) / change
            - target.change
            + length_by_tension @ given
        )
        stiff = (length_by_tension - np.diag(target.compliances))[np.ix_(taut, taut)]
        units, length = self.unit_tension, float(self.fine.places[-1])
        whole = np.block(
            [
                [matrix, defect_by_tension[:, taut] * units],
                [length_by_variable[taut] / length, stiff * units / length],
            ]
        )
        rates = np.concatenate(
            [(defects - before) / change + defect_by_tension @ given, longer[taut] / length]
        )
        ways, sizes, modes = np.linalg.svd(whole)
        soft = sizes <= SOFT * sizes[-1]
        direction = -(ways[:, soft].T @ rates / sizes[soft]) @ modes[soft]
        rate = float(np.linalg.norm(direction))
        return np.asarray(direction / rate if rate > LEAST_BRANCH_RATE else 0.0 * direction)

    def is_stable(
        self, target: Target, solved: Solved, tensions: Floats, load_factor: float
    ) -> bool:
        """Return whether an equilibrium at a load factor is stable."""
        if not self.has_potential:
            return self._measure_divergence(target, solved, tensions, load_factor) >= -ZERO_MODE
        return not count_negative(
            solved[2], target.find_held(solved[1], tensions, load_factor), 0.0
        )

    def measure_stability(
        self, target: Target, solved: Solved, tensions: Floats, load_factor: float
    ) -> float:
        """Return the stability of an equilibrium, as of `Shape`."""
        if not self.has_potential:
            return self._measure_divergence(target, solved, tensions, load_factor)
        return measure_stability(solved[2], target.find_held(solved[1], tensions, load_factor))

    def _measure_divergence(
        self, target: Target, solved: Solved, tensions: Floats, load_factor: float
    ) -> float:
        """Least real part of the eigenvalues of the tangent, of loads without a potential.

        Under small rotations ``f``, forces of the body change by ``f x F``, and moments do the work
        ``M . (df + f x df / 2)`` (Ziegler 1968): with ``[M]`` the matrix of the cross product, the
        tangent has ``-[M] / 2`` more where a moment keeps its direction, ``[M] / 2`` where it turns
        with the body. Points move by the rotations alone.
        """
        from scipy.spatial.transform import Rotation

        ((grid, (lines, points, _), _), _), states, (matrices, metrics, rows, softness) = solved
        count, spans = len(matrices), np.diff(grid[0])
        quaternions = np.roll(states[:, QUATERNION : QUATERNION + 4], -1, axis=1)
        axes = Rotation.from_quat(quaternions).as_matrix()[1:]
        # By the rotations (n + 1, 3) at the steps' ends, the base's among them.
        tangent = np.zeros((count + 1, 3, count + 1, 3))
        lengths = np.zeros((len(tensions), count + 1, 3))
        moved = np.zeros((3, count + 1, 3))
        steps = np.cross(np.eye(3), np.diff(states[:, :3], axis=0)[:, None]).swapaxes(1, 2)
        for n in range(count):
            ends = slice(n, n + 2)
            tangent[ends, :, ends] += matrices[n].reshape(2, 3, 2, 3)
            lengths[:, ends] += rows[n].reshape(-1, 2, 3)
            half, moved[:, ends] = moved.copy(), moved[:, ends] + 0.5 * steps[n][:, None]
            half = 0.5 * (half + moved)
            force, line = (
                load_factor * axes[n] @ points[n + 1, 2],
                load_factor * axes[n] @ lines[n, 1, 1],
            )
            work = moved.reshape(3, -1).T @ cross_matrix(force)
            tangent[:, :, n + 1] += work.reshape(-1, 3, 3)
            work = half.reshape(3, -1).T @ cross_matrix(0.5 * spans[n] * line)
            tangent[:, :, n : n + 2] += work.reshape(-1, 3, 1, 3)
            moment = 0.5 * load_factor * (axes[n] @ points[n + 1, 3] - points[n + 1, 1])
            tangent[n + 1, :, n + 1] += cross_matrix(moment)
        # By the rotations of the steps, which the backbone's own energy is a sum over.
        tangent = tangent[1:, :, 1:][::-1].cumsum(axis=0)[::-1]
        tangent = tangent[:, :, ::-1].cumsum(axis=2)[:, :, ::-1]
        lengths = lengths[:, :0:-1].cumsum(axis=1)[:, ::-1]
        scale = np.linalg.inv(np.linalg.cholesky(metrics))
        tangent = np.einsum("nij,njmk,mlk->niml", scale, tangent, scale)
        lengths = np.einsum("tnj,nij->tni", lengths, scale)
        taut = target.find_taut(states, tensions, load_factor)
        flexibility = np.diag(target.compliances) + softness.sum(axis=0)
        tendon_flexibilities, ways = np.linalg.eigh(flexibility[np.ix_(taut, taut)])
        held = ways.T @ lengths[taut].reshape(-1, 3 * count)
        size = 3 * count
        matrix = vary_twice(tangent.reshape(size, size), np.ones(size), held, tendon_flexibilities)
        return min(1.0, find_least_eigenvalue(matrix, symmetric=False))

    def trace(self, state: RodState, form: Form) -> bool:
        """Fill the states at all steps' ends; and `form`, of the fine steps, if not empty."""
        tendons = len(state.tensions)
        matrix, _, variable_by_tension, length_by_variable, flexibility = self.make_linearisation(
            tendons
        )
        defects = np.empty(len(matrix))
        variables = state.variables
        system = matrix, variable_by_tension, length_by_variable, flexibility
        at = *self.fine_steps, self.unit, state.load_factor
        return bool(shooting.shoot(*at, variables, defects, system, form) < math.inf)

    def make_linearisation(self, tendons: int) -> Linearisation:
        """Return arrays for `improve`: factors of derivatives."""
        size = (9 if self.follows else 6) * self.pieces - 3
        return (
            np.zeros((size, size)),
            np.zeros(size, dtype=np.int64),
            np.zeros((size, tendons)),
            np.zeros((tendons, size)),
            np.zeros((tendons, tendons)),
        )

    def _place_loads(self, grid: RodGrid) -> tuple[Floats, Floats]:
        """Forces per length in the steps, and loads at their ends, as the kernels take them."""
        lines = np.stack(self.loads.line_forces_at(grid.robot, grid.inner_places), axis=2)
        points = np.zeros((len(grid.places), 4, 3))
        for place, force, moment, code in zip(
            self.loads.points, self.loads.forces, self.loads.moments, self.loads.frames, strict=True
        ):
            index = int(np.argmin(np.abs(grid.places - place)))
            own = 2 if code == BODY else 0
            points[index, own] += force
            points[index, own + 1] += moment
        return np.ascontiguousarray(lines), points


def solve_tensions(
    conditions: Conditions, flexibility: Floats, residuals: Floats, tensions: Floats
) -> tuple[int, Floats]:
    """Return a code, and the tensions for which lengths would be as prescribed.

    With flexibility ``A`` (t, t) [mm/N] and residuals ``g`` (t,) [mm] without a change of tension,
    those of slack tendons too: ``A dT = g``, with tensions between their bounds, as a linear
    complementarity problem.
    """
    _, prescribed, holds, compliances, low, high = conditions
    wanted = np.where(holds, tensions, prescribed)
    if not holds.any():
        return FOUND, wanted
    low, high, now = low[holds], high[holds], tensions[holds]
    vector = (flexibility @ (wanted - tensions) - residuals)[holds]
    exact = flexibility.copy() if holds.all() else flexibility[np.ix_(holds, holds)]
    even = 0.5 * (exact + exact.T)
    # By the change of tensions, so that neither the ridge nor the symmetry is left in the answer.
    ridge = RIDGE * np.abs(even.diagonal()).max()
    even.flat[:: len(now) + 1] += ridge
    exact.flat[:: len(now) + 1] += ridge * (compliances[holds] == 0.0)
    found = now.copy()
    definite = solve_bounded(even, vector - even @ now, low, high, found)
    if not definite:
        # Buckled but for its tendons: those that pull, or are too long, are taken to be taut.
        found = np.where((low == 0.0) & (now == 0.0) & (vector < 0.0), 1e-9 * high, now)
    # A moment of fixed direction has no potential: then the problem is not symmetric.
    kept = found.copy()
    if not solve_complementary(exact, vector - exact @ now, low, high, found):
        if not definite:
            return STOPPED, wanted
        found = kept
    wanted[holds] = found
    return HELD if (np.abs(found) >= high).any() else FOUND, wanted


def cross_matrix(vector: Floats) -> Floats:
    """Return the matrix whose product with another vector is the cross product."""
    return np.cross(vector, -np.eye(3))


def make_form(grid: RodGrid, tendons: int) -> Form:
    """Return arrays for the second variation of the energy, see `fill_form`."""
    steps = len(grid.places) - 1
    return (
        np.zeros((steps, 6, 6)),
        np.zeros((steps, 3, 3)),
        np.zeros((steps, tendons, 6)),
        np.zeros((steps, tendons, tendons)),
    )


# The rod without loads: tensions for which its tendons are as long as asked.
#
# The dual of the problem is concave, and strictly so but for redundant tendons: Newton's method
# with a line search finds its only maximum. Where tendons push and are not parallel it may have
# several.

MOST_STEPS_UNLOADED = 60
"""Newton steps for one part of a command."""

SMALLEST_CUT = 1e-4
"""Smallest part of a step."""

RIDGE_UNLOADED = 1e-11
"""Added to the tendons' own flexibility, so that redundant tendons have one answer."""

SHARING = 1e-8
"""The same where the tensions are shared out."""


def solve_unloaded(
    grid: Packed, target: Target, load_factor: float, length_tolerance: float, tensions: Floats
) -> tuple[Floats, int, str]:
    """Return tensions at a load factor of the command, steps, and why there are none."""
    low, high = target.bounds[1:]
    limit = target.prescribe(load_factor, length_tolerance)
    if not target.holds.any():
        return limit, 0, ""
    low, high = (np.where(target.holds, bound, limit) for bound in (low, high))
    tensions = np.where(target.holds, tensions, limit)
    limit = np.where(target.holds, limit, 0.0)
    value, lengths, flexibility = _measure(grid, target, tensions, limit)
    reason = ""
    for count in range(MOST_STEPS_UNLOADED + 1):
        residuals = target.find_residuals(lengths, tensions, load_factor, length_tolerance)
        if np.abs(residuals).max(initial=0.0) <= length_tolerance:
            shared = target.resolve_redundancy(flexibility, tensions, SHARING)
            _, shorter, _ = _measure(grid, target, shared, limit)
            left = target.find_residuals(shorter, shared, load_factor, length_tolerance)
            kept = np.abs(left).max(initial=0.0) <= length_tolerance
            return shared if kept else tensions, count, ""
        if count == MOST_STEPS_UNLOADED:
            break
        slope = lengths - target.compliances * tensions - limit
        ridge = RIDGE_UNLOADED * float(np.diag(flexibility).max())
        matrix = flexibility + np.diag(target.compliances + ridge)
        wanted = tensions.copy()
        if not solve_bounded(matrix, -slope - matrix @ tensions, low, high, wanted):
            break
        if np.any(target.holds & (np.abs(wanted) >= target.strongest)) and count > 0:
            reason = target.explain(HELD, wanted, residuals, loaded=False)
            break
        change, damping = wanted - tensions, 1.0
        rise = float(slope @ change)
        round_off = 1e-13 * float(np.abs(tensions) @ lengths + np.abs(wanted) @ lengths)
        while damping >= SMALLEST_CUT:
            trial = tensions + damping * change
            after, longer, soft = _measure(grid, target, trial, limit)
            if after >= value + 1e-4 * damping * rise - round_off:
                break
            damping *= 0.5
        else:
            break
        tensions, value, lengths, flexibility = trial, after, longer, soft
    return tensions, count, reason or target.explain(FOUND, tensions, residuals, loaded=False)


def _measure(
    grid: Packed, target: Target, tensions: Floats, limit: Floats
) -> tuple[float, Floats, Floats]:
    """The dual's value, lengths (t,) [mm], and their flexibility under tension (t, t) [mm/N]."""
    lengths, flexibility = np.empty(len(tensions)), np.empty((len(tensions), len(tensions)))
    value = measure_unloaded(grid, tensions, lengths, flexibility)
    if math.isnan(value):
        return -math.inf, lengths, flexibility
    value -= float(tensions @ (limit + 0.5 * target.compliances * tensions))
    return value, lengths, flexibility


def follow_unloaded(rod: Rod, target: Target, first: float) -> RodState:
    """Return the state of a rod without loads as the command is raised."""
    state = rod.rest()
    kept, reached, increment, steps, reason = state.tensions, 0.0, first, 0, ""
    # As commanded to round-off; with the tolerance, and in parts, only where that cannot be.
    length_tolerance = ROUND_OFF * target.tolerance
    while reached < 1.0:
        load_factor = min(1.0, reached + increment)
        load_factor = 1.0 if load_factor > 1.0 - 1e-9 else load_factor
        found, count, reason = solve_unloaded(
            rod.fine.packed, target, load_factor, length_tolerance, kept
        )
        steps += count
        if not reason:
            kept, reached = found, load_factor
        elif length_tolerance < target.tolerance:
            length_tolerance = target.tolerance
        else:
            increment *= 0.5
            if increment < first / 16.0:
                percent = math.floor(100.0 * reached)
                reason = f"the command can be followed to {percent} % only: {reason}"
                break
    state = dataclasses.replace(
        state, tensions=kept, load_factor=reached, iterations=steps, reason=reason
    )
    return settle(rod, target, state)


def settle(rod: Rod, target: Target, state: RodState) -> RodState:
    """Return a state of the rod with its places and its stability; unstable, with a reason."""
    form = make_form(rod.fine, len(state.tensions))
    if not rod.trace(state, form):
        rest = rod.rest()
        return dataclasses.replace(rest, reason="no curvature was found")
    solved = rod.fine_steps, state.states, form
    stability = rod.measure_stability(target, solved, state.tensions, state.load_factor)
    unstable = "unstable: the robot snaps away from the equilibrium that was found"
    reason = state.reason or (unstable if stability < -ZERO_MODE else "")
    return dataclasses.replace(state, stability=stability, reason=reason)


# A rod brought to a command and its loads, at once or else in parts.

LOAD_STEP = 2.0
"""Largest load that is put on at once, as of `Rod.load`."""

TIGHT = 0.01
"""Part of the tolerance that is left."""

PUSH_STEP = 0.5
"""Largest bend that tendons ask for at once, where there may be several equilibria [rad]."""


def follow(rod: Rod, target: Target, *, convex: bool, start: RodState | None = None) -> RodState:
    """Find the rod's state from the straight one on, as far as it can be followed.

    `convex` is whether there is only one without loads, whatever the way to it. `start` is a state
    near to the whole command.
    """
    if start is not None and (rod.load > 0.0 or rod.shears):
        found = rod.follow(target, start, first=1.0)
        if not found.reason:
            return found
    # Little by little, where at once it may end on another branch.
    first = min(1.0, LOAD_STEP / max(rod.load, 1e-9))
    if target.holds.any() and not convex:
        bend = float((np.abs(target.change) * target.holds / target.reaches).max(initial=0.0))
        first = min(first, PUSH_STEP / max(bend, PUSH_STEP))
    if rod.load == 0.0 and not rod.shears:
        return follow_unloaded(rod, target, first)
    if target.is_rigid:
        # Few steps are not as exact as tendons that do not stretch ask for.
        rod = rod.with_changes(rod.changes)
    found = rod.follow(target, rod.rest(), first=first)
    if found.reason:
        if not rod.trace(found, EMPTY):
            found = dataclasses.replace(rod.rest(), reason=found.reason)
        return found
    if target.is_rigid:
        found = share_tensions(rod, target, found)
        found = dataclasses.replace(found, reason=find_play(rod, target, found))
    return found


def share_tensions(rod: Rod, target: Target, found: RodState) -> RodState:
    """Return the state with the least tensions that do the same, where redundant ones differ."""
    shared = found.copy()
    shared.tensions[:] = target.resolve_redundancy(found.linearisation[-1], found.tensions, SHARING)
    # The same to first order only: it must hold of the lengths and joints themselves.
    length_tolerance = ROUND_OFF * target.tolerance
    residuals = target.find_residuals(
        found.states[-1, LENGTHS:], found.tensions, 1.0, length_tolerance
    )
    most = max(length_tolerance, float(np.abs(residuals).max(initial=0.0)))
    conditions = (
        1.0,
        shared.tensions.copy(),
        np.zeros(len(residuals), dtype=np.bool_),
        *target.bounds,
    )
    limits = Limits(SMALL_DEFECT, math.inf, FEW_MORE)
    code, _ = rod.improve(rod.fine_steps, shared.variables, conditions, found.linearisation, limits)
    residuals = target.find_residuals(
        shared.states[-1, LENGTHS:], shared.tensions, 1.0, length_tolerance
    )
    return shared if code == FOUND and np.abs(residuals).max(initial=0.0) <= most else found


def find_play(rod: Rod, target: Target, found: RodState) -> str:
    """Return why the tip is open within the tolerance of displacements; else nothing."""
    length_tolerance = ROUND_OFF * target.tolerance
    residuals = target.find_residuals(
        found.states[-1, LENGTHS:], found.tensions, 1.0, length_tolerance
    )
    needed = float(np.abs(residuals).max(initial=0.0)) > 2.0 * length_tolerance
    # Where most of the tolerance was needed, without it.
    change = 0.0 if needed else target.tolerance
    other_tolerance = TIGHT * target.tolerance if needed else length_tolerance
    rest = target.rest + change * target.holds
    looser = dataclasses.replace(target, rest=rest)
    linearisation, form = (
        rod.make_linearisation(len(residuals)),
        make_form(rod.fine, len(residuals)),
    )
    other = found.copy()
    limits, conditions = (
        Limits(SMALL_DEFECT, other_tolerance),
        looser.make_conditions(1.0, other_tolerance),
    )
    code, _ = rod.improve(rod.fine_steps, other.variables, conditions, linearisation, limits, form)
    way = other.states[-1, :3] - found.states[-1, :3]
    play = float(np.linalg.norm(way)) if code == FOUND else math.inf
    length, lever = float(rod.fine.places[-1]), float(target.reaches.min())
    return explain_play(target.tolerance, play, length=length, lever=lever)


# The rod whose tendons have friction: from the state before to the next one.

ROUGH_SLIDING = 1e-5
"""Defects between pieces that are none on the way to a state with friction."""


def follow_sliding(
    rod: Rod, target: Target, channels: Channels, before: FrictionState, start: RodState | None
) -> RodState:
    """Find the rod's state after another one; `start` is a rod near to it."""
    found = rod.rest() if start is None else start
    alone = rod.with_changes(np.zeros((0, 3, 0)))

    def bend(profile: Floats, rough: bool) -> Bending:
        nonlocal found, start
        first = profile[0, 0].copy()
        given = dataclasses.replace(
            target, holds=np.zeros(len(first), dtype=np.bool_), rest=0.0 * first, change=first
        )
        if rod.load == 0.0:
            return Bending(moments=np.zeros((*profile.shape[:2], 3)))
        pulled = alone.with_changes(profile - first)
        if start is not None and start.linearisation[1].size:
            near = dataclasses.replace(start.copy(), load_factor=1.0)
            limits = Limits(ROUGH_SLIDING if rough else SMALL_DEFECT, 0.0)
            conditions = given.make_conditions(1.0, 0.0)
            code, _ = pulled.improve(
                pulled.fine_steps, near.variables, conditions, near.linearisation, limits
            )
            if code == FOUND:
                found = start = near
                return Bending(
                    moments=_list_moments(near.states), lengths=near.states[-1, LENGTHS:]
                )
        trial = None if start is None else pulled.follow(given, start, first=1.0, passes=True)
        if trial is None or trial.reason:
            step = min(1.0, LOAD_STEP / max(rod.load, 1e-9))
            trial = pulled.follow(given, rod.rest(), first=step, passes=True)
        if trial.reason:
            return Bending(reason=trial.reason)
        pulled.trace(trial, EMPTY)
        found = start = trial
        return Bending(moments=_list_moments(trial.states), lengths=trial.states[-1, LENGTHS:])

    prescribed = target.prescribe(1.0, 0.0)
    _, low, high = target.bounds
    drive = DriveCommand(
        tensions=None if target.holds.any() else target.change,
        limits=prescribed,
        low=np.where(target.holds, low, prescribed),
        high=np.where(target.holds, high, prescribed),
        tolerance=0.1 * target.tolerance,
    )
    sliding = Sliding(channels=channels, before=before, bend=bend)
    friction_state, reason = sliding.follow(drive)
    if reason and np.any(target.holds & (np.abs(sliding.pulled) >= high)):
        reason = target.explain(HELD, sliding.pulled, 0.0 * high, loaded=False)
    if reason:
        reason = f"the command can be followed in part only: {reason}"
    along = friction_state.tensions
    state = dataclasses.replace(
        found.copy(),
        tensions=along[0, 0].copy(),
        load_factor=1.0,
        iterations=sliding.iterations,
        reason=reason,
        friction=friction_state,
    )
    return settle(alone.with_changes(along - along[0, 0]), target, state)


def _list_moments(states: Floats) -> Floats:
    """Moments over the cross-sections at start, middle and end of steps, in their frames."""
    from scipy.spatial.transform import Rotation

    quaternions, moments = states[:, QUATERNION : QUATERNION + 4], states[:, MOMENT : MOMENT + 3]
    near = np.sign(np.sum(quaternions[1:] * quaternions[:-1], axis=1))[:, None]
    frames = [quaternions[:-1], quaternions[:-1] + near * quaternions[1:], quaternions[1:]]
    over = [moments[:-1], 0.5 * (moments[:-1] + moments[1:]), moments[1:]]
    return np.stack(
        [
            Rotation.from_quat(np.roll(quaternion, -1, axis=1)).apply(moment, inverse=True)
            for quaternion, moment in zip(frames, over, strict=True)
        ],
        axis=1,
    )
