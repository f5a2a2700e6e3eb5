"""Equilibria of a Cosserat rod with tendons: a boundary-value problem, by multiple shooting."""

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
from .equilibrium import ZERO_MODE, find_least, vary_twice
from .friction import Bending, Channels, DriveCommand, FrictionState, Sliding
from .kernels import shooting
from .kernels.rod import (
    LENGTHS,
    MOMENT,
    TURN,
    integrate_rod,
    measure_unloaded,
)
from .loads import BODY, PackedLoads
from .model import (
    advise_contradiction,
    explain_play,
)
from .rod_grid import EDGE, Packed, RodGrid
from .stability import count_negative, measure_stability

PackedRod = tuple[Packed, tuple[Floats, Floats, Floats], bool]
Steps = tuple[PackedRod, NDArray[np.int64]]
State = tuple[Floats, Floats, Floats, Floats, Floats]
Form = tuple[Floats, Floats, Floats, Floats]
Aim = tuple[float, Floats, NDArray[np.bool_], Floats, Floats, Floats]
Known = tuple[Floats, NDArray[np.int64], Floats, Floats, Floats]

FOUND, STOPPED, BROKEN, BUCKLING, HELD, UNSTABLE = range(6)
"""Codes: found; no equilibrium; no derivative; singular; tendons as tight as can be; a saddle."""

TURN_LIMIT = 0.5
"""Largest turn between two pieces in one step [rad]."""

RIDGE = 1e-8
"""Added to the tendons' own flexibility, so that redundant tendons have one answer."""

SLOW = 0.3
"""Factor by which jumps must fall where derivatives are those of another grid."""

MOST_STEPS, FEW_MORE = 25, 6
"""Newton steps for one part of a command, and with derivatives that are known."""

SMALL_JUMP, ROUGH_JUMP = 1e-10, 1e-3
"""Jumps between pieces that are none, in the end and on the way there [rad], or of moments."""

FAIR_JUMP = 3e-4
"""The same on few steps, one step of Newton's method before all of them are taken."""

MOST_HALVINGS = 4
"""Times that a step of Newton's method is halved where the rod breaks down or jumps grow."""

GROWTH = 3.0
"""Growth of the jumps at which a step is halved."""

ROUND_OFF = 1e-3
"""Part of the tolerance of lengths that is let through unless more is needed."""

SMALLEST_PART = 1.0 / 64.0
"""Smallest part, of the first one, by which a command is raised where more of it fails."""

BUCKLING_PART = 1e-4
"""Part of command and loads to which the load is found that makes a rod unstable."""

SOFT = 10.0
"""Singular values, against the least, of the ways in which a rod is about to buckle."""

LEAST_SIDE = 1e-9
"""Rate at which a rod leans to a side, by the share of its loads, that is not round-off [rad]."""

BEYOND = 1.05
"""Loads, against those under which a rod buckles, under which its bent branch is looked for."""

LEANS = (0.5, 1.0, 0.25, 2.0, 0.1)
"""Sizes of the bends from which it is looked for [rad]."""

PIECES = 0.5
"""Pieces of the shooting by the root of the loads, beside the first."""

NOTHING_KNOWN: Known = (
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


Place = tuple[Steps, Floats, Form]
"""Steps of a rod, the states at their ends, and the second variation there."""


class Limits(NamedTuple):
    """Jump and gap that are let through, the most steps, and from where on one step will do."""

    jump: float
    gap: float
    steps: int = MOST_STEPS
    enough: float = 0.0


# A rod to shoot, what is asked of it, and a state of it.


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

    def goals(self, share: float, loose: float) -> Floats:
        """Return what is asked for a share of the command; cables may be longer by `loose`."""
        return np.asarray(self.rest + share * self.change + loose * (self.holds & ~self.pushes))

    def aim(self, share: float, loose: float) -> Aim:
        """Return what `Rod.improve` takes for a share of command and loads."""
        return share, self.goals(share, loose), self.holds, *self.bounds

    def gaps(self, lengths: Floats, tensions: Floats, share: float, loose: float) -> Floats:
        """Return how far lengths are from what is asked [mm]; 0 for slack cables."""
        gaps = lengths - self.compliances * tensions - self.goals(share, loose)
        slack = ~self.pushes & (tensions == 0.0)
        return np.asarray(self.holds * np.where(slack, np.maximum(gaps, 0.0), gaps))

    def find_taut(self, states: Floats, tensions: Floats, share: float) -> NDArray[np.bool_]:
        """Return which tendons hold a length, (t,): with tension, or about to have one."""
        gaps = states[-1, LENGTHS:] - self.compliances * tensions - self.goals(share, 0.0)
        return np.asarray(self.holds & ((tensions != 0.0) | (gaps > -2.0 * self.tolerance)))

    def find_held(
        self, states: Floats, tensions: Floats, share: float
    ) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
        """Return compliances, which tendons are taut and which of these are idle cables."""
        taut = self.find_taut(states, tensions, share)
        return self.compliances, taut, taut & ~self.pushes & (tensions == 0.0)

    def share(self, give: Floats, tensions: Floats, ridge: float) -> Floats:
        """Return the least tensions that do the same, where redundant tendons leave them open.

        `give` is how lengths give way to tension, `ridge` what is added to its diagonal, as a
        share of the largest.
        """
        if not give.size or self.compliances.any():
            return tensions
        taut, shared = (tensions != 0.0) & self.holds, tensions.copy()
        high = np.where(taut, float(np.abs(tensions).max(initial=0.0)), tensions)
        low = np.where(taut, np.where(self.pushes, -high, 0.0), tensions)
        added = ridge * float(np.abs(np.diag(give)).max(initial=0.0))
        matrix, vector = give + added * np.eye(len(taut)), -give @ tensions
        right = vector
        for _ in range(3):
            # Each pass takes out what the ridge did to the one before it.
            if not solve_bounded(matrix, right, low, high, shared):
                return tensions
            right = vector - added * shared
        return shared

    def explain(self, code: int, tensions: Floats, gaps: Floats, *, loaded: bool) -> str:
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
        worst = int(np.argmax(np.abs(gaps))) if self.holds.any() else -1
        where = (
            f", tendon '{self.names[worst]}' misses by {abs(gaps[worst]):.3g} mm"
            if worst >= 0 and gaps[worst] != 0.0
            else ""
        )
        advice = "; give a tendon_stiffness" if loaded and self.is_rigid else ""
        return f"no equilibrium was found beyond it{where}{advice}"


@dataclass(frozen=True, kw_only=True)
class Shot:
    """A state of the rod: tensions, and quaternion, moment and force at the start of every piece.

    `share` is the part of command and loads that it holds for; `reason` states why it is not all.
    `states` are those at all places, `friction` that of tendons with friction, `known` the factors
    of its derivatives, and `stability` as of `Shape`.
    """

    tensions: Floats
    turns: Floats
    moments: Floats
    forces: Floats
    states: Floats
    share: float = 0.0
    iterations: int = 0
    reason: str = ""
    friction: FrictionState | None = None
    known: Known = NOTHING_KNOWN
    stability: float = 1.0

    @property
    def unknowns(self) -> tuple[Floats, Floats, Floats, Floats]:
        """What Newton's method improves, in place."""
        return self.tensions, self.turns, self.moments, self.forces

    @property
    def state(self) -> State:
        """The same, and the states at all places."""
        return *self.unknowns, self.states

    def copy_unknowns(self) -> list[Floats]:
        """Return them as they are now, for `restore`."""
        return [array.copy() for array in self.unknowns]

    def copy(self) -> Shot:
        """Return another one to be improved."""
        names = ("tensions", "turns", "moments", "forces", "states")
        return dataclasses.replace(self, **{name: getattr(self, name).copy() for name in names})


def restore(state: Iterable[Floats], kept: Iterable[Floats]) -> None:
    """Set arrays of a state to what they were."""
    for now, before in zip(state, kept, strict=False):
        now[:] = before


@dataclass(frozen=True, kw_only=True)
class Rod:
    """A rod cut into many steps, and into few to look for its state with.

    Attributes
    ----------
    many, few : RodGrid
        The steps.
    loads : PackedLoads
        Loads and weights.
    shears : bool
        Whether it shears and stretches.
    changes : (n, 3, t) or (0, 3, 0) ndarray
        By how much friction makes tensions differ from those at the base [N].
    """

    many: RodGrid
    few: RodGrid
    loads: PackedLoads
    shears: bool
    changes: Floats = field(default_factory=lambda: np.zeros((0, 3, 0)))

    @cached_property
    def load(self) -> float:
        """The loads, by their moments about the base, against what bends the robot by 1 rad."""
        places, grid = self.few.places, self.few
        dead, body = self.loads.line_forces_at(grid.robot, grid.inner_places[:, 1])
        lines = np.diff(places) * (np.linalg.norm(dead, axis=1) + np.linalg.norm(body, axis=1))
        total = float(grid.inner_places[:, 1] @ lines)
        total += float(self.loads.points @ np.linalg.norm(self.loads.forces, axis=1))
        total += float(np.linalg.norm(self.loads.moments, axis=1).sum())
        return total * grid.robot.length / float(grid.stiffness[..., 3:].min())

    @cached_property
    def unit(self) -> float:
        """Moment that bends the robot by about 1 rad [N mm]."""
        return float(self.many.stiffness[..., 3:].max() / self.many.robot.length)

    @cached_property
    def unit_tension(self) -> float:
        """Tension that bends it by about 1 rad [N]."""
        return self.unit / float(self.many.reaches.min(initial=self.many.robot.radius))

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
        return min(count, len(self.few.places) - 1)

    @cached_property
    def few_cuts(self) -> NDArray[np.int64]:
        """First of the few steps of every piece, and the last one's end, shape (pieces + 1,)."""
        cuts = np.linspace(0.0, len(self.few.places) - 1.0, self.pieces + 1)
        return np.round(cuts).astype(np.int64)

    @cached_property
    def many_cuts(self) -> NDArray[np.int64]:
        """The same among the many steps."""
        return np.searchsorted(self.many.places, self.few.places[self.few_cuts] - EDGE)

    @property
    def many_steps(self) -> Steps:
        """The same of the many steps."""
        return self.packed_many, self.many_cuts

    @cached_property
    def few_steps(self) -> Steps:
        """The few steps as of `integrate_rod`, and the first of every piece."""
        loads = *self._place_loads(self.few), np.zeros((0, 3, 0))
        return (self.few.packed, loads, self.shears), self.few_cuts

    @cached_property
    def packed_many(self) -> PackedRod:
        """What the kernels take of the many steps."""
        return self.many.packed, (*self._place_loads(self.many), self.changes), self.shears

    def with_changes(self, changes: Floats) -> Rod:
        """Return the rod with changes of tensions, and many steps alone."""
        made = dataclasses.replace(self, few=self.many, changes=changes)
        grid, (lines, points, _), shears = self.packed_many
        packed = grid, (lines, points, changes), shears
        known = {name: getattr(self, name) for name in ("load", "unit", "follows", "pieces")}
        made.__dict__.update(known, few_steps=(packed, self.many_cuts), packed_many=packed)
        made.__dict__.update(few_cuts=self.many_cuts, many_cuts=self.many_cuts)
        return made

    def rest(self) -> Shot:
        """Return the rod under none of its command."""
        return self._at_rest.copy()

    @cached_property
    def _at_rest(self) -> Shot:
        tendons = self.many.guides.shape[2]
        states = np.zeros((len(self.many.places), LENGTHS + tendons))
        states[:, TURN] = 1.0
        tensions, slopes = np.zeros(tendons), np.zeros((0, 0))
        sections, last = shooting.NO_SECTIONS, len(states) - 1
        integrate_rod(0, last, self.packed_many, 0.0, tensions, states, slopes, sections, EMPTY)
        return Shot(
            tensions=tensions,
            turns=states[self.many_cuts[:-1], TURN : TURN + 4].copy(),
            moments=np.zeros((self.pieces, 3)),
            forces=np.zeros((self.pieces, 3)),
            states=states,
        )

    def follow(self, target: Target, start: Shot, *, first: float, passes: bool = False) -> Shot:
        """Return the rod's state as command and loads are raised from that of `start`."""
        shot = start.copy()
        few_states = shot.states
        if self.few is not self.many:
            few_states = np.zeros((len(self.few.places), shot.states.shape[1]))
        known, form = self.make_known(len(shot.tensions)), make_form(self.few, len(shot.tensions))
        few_state, one = (*shot.unknowns, few_states), self.few is self.many
        code, steps, reached, part, failed = FOUND, 0, 0.0, first, 1.0
        kept, loose, leant = shot.copy_unknowns(), ROUND_OFF * target.tolerance, False
        while reached < 1.0:
            share = min(1.0, reached + part)
            share = 1.0 if share > 1.0 - 1e-9 else share
            limits = Limits(ROUGH_JUMP, max(loose, 1e-2 * ROUGH_JUMP * self.many.robot.length))
            if share == 1.0:
                limits = Limits(SMALL_JUMP, loose, enough=0.0 if one else FAIR_JUMP)
            aim = target.aim(share, loose)
            code, count = self.improve(self.few_steps, few_state, aim, known, limits, form)
            steps += count
            if code == FOUND and not passes:
                at = self.few_steps, few_states, form
                if not self.is_stable(target, at, shot.tensions, share):
                    code = UNSTABLE
            flips = reached > 0.0 and np.vdot(shot.moments, kept[2]) < 0.0
            if code == FOUND and flips and part > SMALLEST_PART * first and not passes:
                # Maybe to the other side, beyond buckling: smaller steps show it.
                restore(shot.unknowns, kept)
                part *= 0.5
                continue
            if code == FOUND:
                kept, reached, part = shot.copy_unknowns(), share, 1.5 * part
                continue
            failed = share
            restore(shot.unknowns, kept)
            if loose < target.tolerance and code not in (UNSTABLE, BUCKLING):
                loose = target.tolerance
                continue
            part *= 0.5
            if part < SMALLEST_PART * first and not leant:
                further = self.lean(target, shot, few_states, reached) if code == UNSTABLE else 0.0
                leant = further <= reached
                if not leant:
                    kept, reached, part = shot.copy_unknowns(), further, first
            if leant and (code != UNSTABLE or part < BUCKLING_PART):
                break
        at = self.few_steps, few_states, form
        if reached == 1.0:
            state, aim = shot.state, target.aim(1.0, loose)
            if not one:
                limits = Limits(SMALL_JUMP, loose, FEW_MORE)
                code, count = self.improve(self.many_steps, state, aim, known, limits)
                steps += count
            if code != FOUND:
                # Derivatives on few steps do not do: where they are almost singular.
                form = make_form(self.many, len(shot.tensions))
                limits = Limits(SMALL_JUMP, loose)
                code, count = self.improve(self.many_steps, state, aim, known, limits, form)
                steps += count
                at = self.many_steps, shot.states, form
        reason, stability = "", 1.0
        if code == FOUND or code == UNSTABLE:
            share = 1.0 if code == FOUND else failed
            stability = self.measure_stability(target, at, shot.tensions, share)
        what = "command and loads" if self.load > 0.0 else "the command"
        if code == UNSTABLE:
            reason = f"unstable: the robot buckles at {100.0 * reached:.3g} % of {what}"
            force = float(np.linalg.norm(self.loads.forces.sum(axis=0)))
            if force > 0.0 and len(self.loads.points):
                reason += f", {reached * force:.4g} N"
        elif code != FOUND:
            gaps = target.gaps(few_states[-1, LENGTHS:], shot.tensions, failed, loose)
            why = target.explain(code, shot.tensions, gaps, loaded=self.load > 0.0)
            percent = math.floor(100.0 * reached)
            reason = f"{what} can be followed to {percent} % only: {why}"
        return dataclasses.replace(
            shot, share=reached, iterations=steps, reason=reason, known=known, stability=stability
        )

    def improve(
        self, steps: Steps, state: State, aim: Aim, known: Known, limits: Limits, form: Form = EMPTY
    ) -> tuple[int, int]:
        """Improve a state by Newton's method; returns a code and the steps taken.

        `known` are the derivatives' factors: the matrix, its order, how unknowns follow tensions
        (n, k), lengths' derivatives by unknowns (k, n), and how lengths give way to tension (k, k);
        they are filled unless `form` is empty, and otherwise taken as they are.
        """
        matrix, order, carried, by_unknown, give = known
        (packed, cuts), tensions, fresh = steps, state[0], len(form[0]) > 0
        share, goals, holds, compliances, low, _ = aim
        units = self.unit, float(self.many.places[-1])
        by_pull, step = np.empty_like(give), np.empty(len(order))
        kept: Iterable[Floats] = state
        taken, before, part, halved, count = step, math.inf, 1.0, 0, -1
        # What is a tension is so at once: the lengths follow.
        wanted = np.where(holds, tensions, goals)
        tensions[:] = wanted
        while True:
            count += 1
            system = matrix, carried, by_unknown, by_pull
            off = shooting.shoot(packed, cuts, self.unit, share, state, step, system, form)
            if off == math.inf or (fresh and off > max(GROWTH * before, 0.1)):
                if not fresh or not count or halved == MOST_HALVINGS:
                    return BROKEN, count
                halved, part = halved + 1, 0.5 * part
                restore(state, kept)
            else:
                if fresh:
                    if not factor_lu(matrix, order):
                        return BUCKLING, count
                    solve_lu(matrix, order, carried)
                    give[:] = by_unknown @ carried - by_pull
                    give.flat[:: len(give) + 1] += compliances
                gaps = state[4][-1, LENGTHS:] - compliances * tensions - goals
                over = np.where((low == 0.0) & (tensions == 0.0), gaps, np.abs(gaps))
                gap = float(over.max(initial=0.0, where=holds))
                if off <= limits.jump and gap <= limits.gap:
                    return FOUND, count
                off = max(off, gap / units[1])
                if count >= limits.steps or (not fresh and off > SLOW * before):
                    return STOPPED, count
                solve_lu(matrix, order, step[:, None])
                code, wanted = pull(aim, give, gaps - by_unknown @ step, tensions)
                if code != FOUND:
                    tensions[:] = wanted
                    return code, count
                taken = -step - carried @ (wanted - tensions)
                kept, before, part, halved = [array.copy() for array in state[:4]], off, 1.0, 0
                if self.pieces > 1:
                    free = 9 if self.follows else 6
                    turns = [taken[at : at + 3] for at in range(free - 3, len(taken), free)]
                    widest = float(np.linalg.norm(turns, axis=1).max())
                    part = TURN_LIMIT / max(widest, TURN_LIMIT)
            shooting.move(state, *units, taken, part)
            tensions += part * (wanted - tensions)
            if before <= limits.enough:
                return FOUND, count + 1

    def lean(self, target: Target, shot: Shot, few_states: Floats, share: float) -> float:
        """Bring a rod that is about to buckle under a share of its loads to the bent branch beyond.

        That on the side to which it leans as loads grow. Improves the shot's unknowns and returns
        the share that it then bears; 0, and leaves them, if there is no side or no such branch.
        """
        kept, state = shot.copy_unknowns(), (*shot.unknowns, few_states)
        known, form = self.make_known(len(kept[0])), make_form(self.few, len(kept[0]))
        loose, length = ROUND_OFF * target.tolerance, float(self.many.places[-1])
        limits = Limits(SMALL_JUMP, loose)
        self.improve(self.few_steps, state, target.aim(share, loose), known, limits, form)
        taut = target.find_taut(few_states, shot.tensions, share)
        side = self._find_side(target, state, share, taut)
        size, pulls = len(known[1]), shot.tensions.copy()
        pulls[taut] += side[size:] * self.unit_tension
        # A cable about to have a tension has two sides of its own.
        loses = bool((taut & ~target.pushes & (shot.tensions == 0.0)).any())
        further = min(1.0 - 1e-6, BEYOND * share)
        for part in () if loses or not side.any() else LEANS:
            restore(shot.unknowns, kept)
            shooting.move(state, self.unit, length, side[:size].copy(), part)
            pulled = shot.tensions + part * (pulls - shot.tensions)
            np.maximum(pulled, target.bounds[1], out=shot.tensions)
            aim = target.aim(further, loose)
            code, _ = self.improve(self.few_steps, state, aim, known, limits, form)
            if code != FOUND:
                continue
            ways = [side[at : at + 3] for at in range(0, size, 9 if self.follows else 6)]
            at = self.few_steps, few_states, form
            stable = self.is_stable(target, at, shot.tensions, further)
            if stable and np.vdot(shot.moments - kept[2], ways) > 0.0:
                return further
        restore(shot.unknowns, kept)
        return 0.0

    def _find_side(
        self, target: Target, state: State, share: float, taut: NDArray[np.bool_]
    ) -> Floats:
        """Unit step of unknowns and taut tendons to where a soft rod bends as loads grow; or 0."""
        tendons, change = len(taut), 1e-6
        matrix, _, by_tension, by_unknown, _ = self.make_known(tendons)
        form, by_pull = make_form(self.few, tendons), np.zeros((tendons, tendons))
        jumps, before = np.empty((2, len(matrix)))
        system = matrix, by_tension, by_unknown, by_pull
        shooting.shoot(*self.few_steps, self.unit, share - change, state, before, system, form)
        lengths = state[4][-1, LENGTHS:].copy()
        shooting.shoot(*self.few_steps, self.unit, share, state, jumps, system, form)
        given = np.where(target.holds, 0.0, target.change)
        longer = (state[4][-1, LENGTHS:] - lengths) / change - target.change + by_pull @ given
        stiff = (by_pull - np.diag(target.compliances))[np.ix_(taut, taut)]
        units, length = self.unit_tension, float(self.many.places[-1])
        whole = np.block(
            [
                [matrix, by_tension[:, taut] * units],
                [by_unknown[taut] / length, stiff * units / length],
            ]
        )
        rates = np.concatenate(
            [(jumps - before) / change + by_tension @ given, longer[taut] / length]
        )
        ways, sizes, modes = np.linalg.svd(whole)
        soft = sizes <= SOFT * sizes[-1]
        side = -(ways[:, soft].T @ rates / sizes[soft]) @ modes[soft]
        rate = float(np.linalg.norm(side))
        return np.asarray(side / rate if rate > LEAST_SIDE else 0.0 * side)

    def is_stable(self, target: Target, at: Place, tensions: Floats, share: float) -> bool:
        """Return whether an equilibrium under a share of the loads is stable."""
        if not self.has_potential:
            return self._measure_divergence(target, at, tensions, share) >= -ZERO_MODE
        return not count_negative(at[2], target.find_held(at[1], tensions, share), 0.0)

    def measure_stability(self, target: Target, at: Place, tensions: Floats, share: float) -> float:
        """Return the stability of an equilibrium, as of `Shape`."""
        if not self.has_potential:
            return self._measure_divergence(target, at, tensions, share)
        return measure_stability(at[2], target.find_held(at[1], tensions, share))

    def _measure_divergence(
        self, target: Target, at: Place, tensions: Floats, share: float
    ) -> float:
        """Least real part of the eigenvalues of the tangent, of loads without a potential.

        Turned by small rotations ``f``, forces of the body change by ``f x F``, and moments do the
        work ``M . (df + f x df / 2)`` (Ziegler 1968): with ``[M]`` the matrix of the cross product,
        the tangent has ``-[M] / 2`` more where a moment keeps its direction, ``[M] / 2`` where it
        turns with the body. Points move by the turns alone.
        """
        from scipy.spatial.transform import Rotation

        ((grid, (lines, points, _), _), _), states, (matrices, metrics, rows, softness) = at
        count, spans = len(matrices), np.diff(grid[0])
        turns = np.roll(states[:, TURN : TURN + 4], -1, axis=1)
        axes = Rotation.from_quat(turns).as_matrix()[1:]
        # By the turns (n + 1, 3) at the steps' ends, the base's among them.
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
            force, line = share * axes[n] @ points[n + 1, 2], share * axes[n] @ lines[n, 1, 1]
            work = moved.reshape(3, -1).T @ cross_matrix(force)
            tangent[:, :, n + 1] += work.reshape(-1, 3, 3)
            work = half.reshape(3, -1).T @ cross_matrix(0.5 * spans[n] * line)
            tangent[:, :, n : n + 2] += work.reshape(-1, 3, 1, 3)
            moment = 0.5 * share * (axes[n] @ points[n + 1, 3] - points[n + 1, 1])
            tangent[n + 1, :, n + 1] += cross_matrix(moment)
        # By the turns of the steps, which the backbone's own energy is a sum over.
        tangent = tangent[1:, :, 1:][::-1].cumsum(axis=0)[::-1]
        tangent = tangent[:, :, ::-1].cumsum(axis=2)[:, :, ::-1]
        lengths = lengths[:, :0:-1].cumsum(axis=1)[:, ::-1]
        scale = np.linalg.inv(np.linalg.cholesky(metrics))
        tangent = np.einsum("nij,njmk,mlk->niml", scale, tangent, scale)
        lengths = np.einsum("tnj,nij->tni", lengths, scale)
        taut = target.find_taut(states, tensions, share)
        give = np.diag(target.compliances) + softness.sum(axis=0)
        gives, ways = np.linalg.eigh(give[np.ix_(taut, taut)])
        held = ways.T @ lengths[taut].reshape(-1, 3 * count)
        size = 3 * count
        matrix = vary_twice(tangent.reshape(size, size), np.ones(size), held, gives)
        return min(1.0, find_least(matrix, symmetric=False))

    def trace(self, shot: Shot, form: Form) -> bool:
        """Fill a shot's states at all places; and `form`, of the many steps, if not empty."""
        tendons = len(shot.tensions)
        matrix, _, carried, by_unknown, give = self.make_known(tendons)
        jumps = np.empty(len(matrix))
        state = shot.state
        system = matrix, carried, by_unknown, give
        at = *self.many_steps, self.unit, shot.share
        return bool(shooting.shoot(*at, state, jumps, system, form) < math.inf)

    def make_known(self, tendons: int) -> Known:
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


def pull(aim: Aim, give: Floats, gaps: Floats, tensions: Floats) -> tuple[int, Floats]:
    """Return a code, and the tensions for which lengths would be as asked.

    `give` is how lengths give way to tension (k, k), `gaps` are those without a change of tension,
    those of slack tendons too.
    """
    _, goals, holds, compliances, low, high = aim
    wanted = np.where(holds, tensions, goals)
    if not holds.any():
        return FOUND, wanted
    low, high, now = low[holds], high[holds], tensions[holds]
    vector = (give @ (wanted - tensions) - gaps)[holds]
    exact = give.copy() if holds.all() else give[np.ix_(holds, holds)]
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


def improve_unloaded(
    grid: Packed, target: Target, share: float, loose: float, tensions: Floats
) -> tuple[Floats, int, str]:
    """Return tensions for a `share` of the command, steps, and why there are none."""
    low, high = target.bounds[1:]
    limit = target.goals(share, loose)
    if not target.holds.any():
        return limit, 0, ""
    low, high = (np.where(target.holds, bound, limit) for bound in (low, high))
    tensions = np.where(target.holds, tensions, limit)
    limit = np.where(target.holds, limit, 0.0)
    value, lengths, give = _measure(grid, target, tensions, limit)
    reason = ""
    for count in range(MOST_STEPS_UNLOADED + 1):
        gaps = target.gaps(lengths, tensions, share, loose)
        if np.abs(gaps).max(initial=0.0) <= loose:
            shared = target.share(give, tensions, SHARING)
            _, shorter, _ = _measure(grid, target, shared, limit)
            left = target.gaps(shorter, shared, share, loose)
            kept = np.abs(left).max(initial=0.0) <= loose
            return shared if kept else tensions, count, ""
        if count == MOST_STEPS_UNLOADED:
            break
        slope = lengths - target.compliances * tensions - limit
        ridge = RIDGE_UNLOADED * float(np.diag(give).max())
        matrix = give + np.diag(target.compliances + ridge)
        wanted = tensions.copy()
        if not solve_bounded(matrix, -slope - matrix @ tensions, low, high, wanted):
            break
        if np.any(target.holds & (np.abs(wanted) >= target.strongest)) and count > 0:
            reason = target.explain(HELD, wanted, gaps, loaded=False)
            break
        change, part = wanted - tensions, 1.0
        rise = float(slope @ change)
        round_off = 1e-13 * float(np.abs(tensions) @ lengths + np.abs(wanted) @ lengths)
        while part >= SMALLEST_CUT:
            trial = tensions + part * change
            after, longer, soft = _measure(grid, target, trial, limit)
            if after >= value + 1e-4 * part * rise - round_off:
                break
            part *= 0.5
        else:
            break
        tensions, value, lengths, give = trial, after, longer, soft
    return tensions, count, reason or target.explain(FOUND, tensions, gaps, loaded=False)


def _measure(
    grid: Packed, target: Target, tensions: Floats, limit: Floats
) -> tuple[float, Floats, Floats]:
    """The dual's value, lengths (t,), and how they give way to tension (t, t)."""
    lengths, give = np.empty(len(tensions)), np.empty((len(tensions), len(tensions)))
    value = measure_unloaded(grid, tensions, lengths, give)
    if math.isnan(value):
        return -math.inf, lengths, give
    value -= float(tensions @ (limit + 0.5 * target.compliances * tensions))
    return value, lengths, give


def follow_unloaded(rod: Rod, target: Target, first: float) -> Shot:
    """Return the state of a rod without loads as the command is raised."""
    shot = rod.rest()
    kept, reached, part, steps, reason = shot.tensions, 0.0, first, 0, ""
    # As commanded to round-off; with the tolerance, and in parts, only where that cannot be.
    loose = ROUND_OFF * target.tolerance
    while reached < 1.0:
        share = min(1.0, reached + part)
        share = 1.0 if share > 1.0 - 1e-9 else share
        found, count, reason = improve_unloaded(rod.many.packed, target, share, loose, kept)
        steps += count
        if not reason:
            kept, reached = found, share
        elif loose < target.tolerance:
            loose = target.tolerance
        else:
            part *= 0.5
            if part < first / 16.0:
                percent = math.floor(100.0 * reached)
                reason = f"the command can be followed to {percent} % only: {reason}"
                break
    shot = dataclasses.replace(shot, tensions=kept, share=reached, iterations=steps, reason=reason)
    return settle(rod, target, shot)


def settle(rod: Rod, target: Target, shot: Shot) -> Shot:
    """Return a state of the rod with its places and its stability; unstable, with a reason."""
    form = make_form(rod.many, len(shot.tensions))
    if not rod.trace(shot, form):
        rest = rod.rest()
        return dataclasses.replace(rest, reason="no curvature was found")
    at = rod.many_steps, shot.states, form
    stability = rod.measure_stability(target, at, shot.tensions, shot.share)
    unstable = "unstable: the robot snaps away from the equilibrium that was found"
    reason = shot.reason or (unstable if stability < -ZERO_MODE else "")
    return dataclasses.replace(shot, stability=stability, reason=reason)


# A rod brought to a command and its loads, at once or else in parts.

LOAD_STEP = 2.0
"""Largest part of the loads that is put on at once, against those that bend it by 1 rad."""

TIGHT = 0.01
"""Part of the tolerance that is left."""

PUSH_STEP = 0.5
"""Largest turn that tendons ask for at once, where there may be several equilibria [rad]."""


def follow(rod: Rod, target: Target, *, convex: bool, start: Shot | None = None) -> Shot:
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
        turn = float((np.abs(target.change) * target.holds / target.reaches).max(initial=0.0))
        first = min(first, PUSH_STEP / max(turn, PUSH_STEP))
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


def share_tensions(rod: Rod, target: Target, found: Shot) -> Shot:
    """Return the state with the least tensions that do the same, where redundant ones differ."""
    shared = found.copy()
    shared.tensions[:] = target.share(found.known[-1], found.tensions, SHARING)
    # The same to first order only: it must hold of the lengths and joints themselves.
    loose = ROUND_OFF * target.tolerance
    gaps = target.gaps(found.states[-1, LENGTHS:], found.tensions, 1.0, loose)
    most = max(loose, float(np.abs(gaps).max(initial=0.0)))
    aim = 1.0, shared.tensions.copy(), np.zeros(len(gaps), dtype=np.bool_), *target.bounds
    limits = Limits(SMALL_JUMP, math.inf, FEW_MORE)
    code, _ = rod.improve(rod.many_steps, shared.state, aim, found.known, limits)
    gaps = target.gaps(shared.states[-1, LENGTHS:], shared.tensions, 1.0, loose)
    return shared if code == FOUND and np.abs(gaps).max(initial=0.0) <= most else found


def find_play(rod: Rod, target: Target, found: Shot) -> str:
    """Return why the tip is open within the tolerance of displacements; else nothing."""
    loose = ROUND_OFF * target.tolerance
    gaps = target.gaps(found.states[-1, LENGTHS:], found.tensions, 1.0, loose)
    needed = float(np.abs(gaps).max(initial=0.0)) > 2.0 * loose
    # Where most of the tolerance was needed, without it.
    change = 0.0 if needed else target.tolerance
    other_loose = TIGHT * target.tolerance if needed else loose
    rest = target.rest + change * target.holds
    looser = dataclasses.replace(target, rest=rest)
    known, form = rod.make_known(len(gaps)), make_form(rod.many, len(gaps))
    other = found.copy()
    limits, aim = Limits(SMALL_JUMP, other_loose), looser.aim(1.0, other_loose)
    code, _ = rod.improve(rod.many_steps, other.state, aim, known, limits, form)
    way = other.states[-1, :3] - found.states[-1, :3]
    play = float(np.linalg.norm(way)) if code == FOUND else math.inf
    length, lever = float(rod.many.places[-1]), float(target.reaches.min())
    return explain_play(target.tolerance, play, length=length, lever=lever)


# The rod whose tendons have friction: from the state before to the next one.

ROUGH_SLIDING = 1e-5
"""Jumps between pieces that are none on the way to a state with friction."""


def follow_sliding(
    rod: Rod, target: Target, channels: Channels, before: FrictionState, start: Shot | None
) -> Shot:
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
        if start is not None and start.known[1].size:
            near = dataclasses.replace(start.copy(), share=1.0)
            limits = Limits(ROUGH_SLIDING if rough else SMALL_JUMP, 0.0)
            aim = given.aim(1.0, 0.0)
            code, _ = pulled.improve(pulled.many_steps, near.state, aim, near.known, limits)
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

    goals = target.goals(1.0, 0.0)
    _, low, high = target.bounds
    drive = DriveCommand(
        tensions=None if target.holds.any() else target.change,
        limits=goals,
        low=np.where(target.holds, low, goals),
        high=np.where(target.holds, high, goals),
        tolerance=0.1 * target.tolerance,
    )
    sliding = Sliding(channels=channels, before=before, bend=bend)
    state, reason = sliding.follow(drive)
    if reason and np.any(target.holds & (np.abs(sliding.pulled) >= high)):
        reason = target.explain(HELD, sliding.pulled, 0.0 * high, loaded=False)
    if reason:
        reason = f"the command can be followed in part only: {reason}"
    along = state.tensions
    shot = dataclasses.replace(
        found.copy(),
        tensions=along[0, 0].copy(),
        share=1.0,
        iterations=sliding.iterations,
        reason=reason,
        friction=state,
    )
    return settle(alone.with_changes(along - along[0, 0]), target, shot)


def _list_moments(states: Floats) -> Floats:
    """Moments over the cross-sections at start, middle and end of steps, in their frames."""
    from scipy.spatial.transform import Rotation

    turns, moments = states[:, TURN : TURN + 4], states[:, MOMENT : MOMENT + 3]
    near = np.sign(np.sum(turns[1:] * turns[:-1], axis=1))[:, None]
    frames = [turns[:-1], turns[:-1] + near * turns[1:], turns[1:]]
    over = [moments[:-1], 0.5 * (moments[:-1] + moments[1:]), moments[1:]]
    return np.stack(
        [
            Rotation.from_quat(np.roll(turn, -1, axis=1)).apply(moment, inverse=True)
            for turn, moment in zip(frames, over, strict=True)
        ],
        axis=1,
    )
