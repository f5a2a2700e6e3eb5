"""The reference: a Kirchhoff rod with tendons, a boundary-value problem."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_points, quantity
from ..errors import InputError
from ..numeric.kernels.linear_algebra import solve_bounded
from ..numeric.kernels.rotations import find_turn, turn_quaternion
from .checks import Floats
from .coupling import check_displacements
from .energy import place_stations
from .friction import Bending, Channels, Drive, FrictionState, Sliding
from .history import TendonHistory
from .kernels.rod import differentiate_piece, integrate_rod, measure_unloaded
from .model import (
    BendMeasure,
    ContinuumModel,
    advise_contradiction,
    check_limits,
    check_numbers,
    choose_stiffness,
    explain_contrast,
)
from .profile import ROUND_OFF_MM
from .robot import RobotDesign
from .section import LEAST_LEVER
from .shape import Shape

# A robot cut into steps, as the rod's kernels take it.

NUDGE = 1e-9
"""How far inside a smooth piece its ends are evaluated, against its length."""


@dataclass(frozen=True)
class RodGrid:
    """Steps of a robot, at least `steps` of them, and how its tendons pass them."""

    robot: RobotDesign
    between: int
    steps: int

    @cached_property
    def arc_length(self) -> Floats:
        """Stations: base, discs, tendon ends and points between [mm], shape (k,)."""
        return place_stations(self.robot, self.between)

    @cached_property
    def natural_lengths(self) -> Floats:
        """Length of each tendon in the straight robot [mm], shape (t,)."""
        slopes = np.sqrt(1.0 + np.sum(self.guides[..., 2:] ** 2, axis=-1)) * self.present[:, None]
        means = (slopes[:, 0] + 4.0 * slopes[:, 1] + slopes[:, 2]) / 6.0
        return np.asarray(np.sum(means * np.diff(self.places)[:, None], axis=0))

    @property
    def packed(self) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]]:
        """What the kernels take, see `integrate_rod`."""
        return self.places, self.stiffness, self.guides, self.present

    @cached_property
    def places(self) -> Floats:
        """Ends of the steps [mm], shape (n + 1,): stations and corners of tendons among them."""
        corners = [place for tendon in self.robot.tendons for place in tendon.corners()]
        breaks = np.unique(np.concatenate([self.arc_length, corners]))
        breaks = breaks[np.concatenate([[True], np.diff(breaks) > ROUND_OFF_MM])]
        widest = self.robot.length / self.steps
        pieces = [
            np.linspace(start, end, math.ceil((end - start) / widest - 1e-9) + 1)[1:]
            for start, end in zip(breaks[:-1], breaks[1:], strict=True)
        ]
        return np.concatenate([[0.0], *pieces])

    @cached_property
    def middles(self) -> Floats:
        """Middles of the steps [mm], shape (n,)."""
        return np.asarray(0.5 * (self.places[1:] + self.places[:-1]))

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """Whether each tendon runs in each step, shape (n, t)."""
        return np.asarray(self.middles[:, None] < self.robot.tendon_ends)

    @cached_property
    def guides(self) -> Floats:
        """Places and slopes of tendons at start, middle and end of steps, shape (n, 3, t, 4)."""
        guides = np.zeros((len(self.middles), 3, len(self.robot.tendons), 4))
        # Inside the step, where corners do not matter.
        edge = (0.5 - NUDGE) * np.diff(self.places)
        places = np.stack([self.middles - edge, self.middles, self.middles + edge], axis=1)
        for row, tendon in enumerate(self.robot.tendons):
            here = self.present[:, row]
            guides[here, :, row, :2] = tendon.place_at(places[here])
            guides[here, :, row, 2:] = tendon.slope_at(places[here])
        return guides

    @cached_property
    def stiffness(self) -> Floats:
        """EI, EI and GJ of the backbone in each step [N mm^2], shape (n, 3)."""
        return self.robot.stiffness_at(self.middles)[:, 3:]

    @cached_property
    def reaches(self) -> Floats:
        """Least distance of each tendon from the backbone, as a lever [mm], shape (t,).

        Of a tendon that comes near to the backbone, or crosses it, a share of its largest.
        """
        offsets = np.sqrt(np.sum(self.guides[..., :2] ** 2, axis=-1))
        most = offsets.max(axis=(0, 1))
        offsets = np.where(self.present[:, None], offsets, math.inf)
        return np.asarray(np.maximum(offsets.min(axis=(0, 1)), LEAST_LEVER * most))


# A rod to shoot, what is asked of it, and a state of it.


@dataclass(frozen=True, kw_only=True)
class Rod:
    """A rod cut into steps, as the kernels take it, and how many pieces to shoot.

    Attributes
    ----------
    grid : tuple of ndarray
        Steps' ends, stiffness, places of tendons, and where they run, see `integrate_rod`.
    tip_force, tip_moment, line_force : (3,) ndarray
        Loads [N], [N mm], [N/mm].
    pieces : int
        Pieces of the shooting.
    moment_scale, load : float
        Moment that bends the robot by about 1 rad [N mm], and the loads against it.
    unit_tension, strongest : float
        Tension that bends it by about 1 rad, and the one at which a command is impossible [N].
    changes : (n, 3, t) or (0, 3, 0) ndarray
        By how much friction makes tensions differ from those at the base [N].
    """

    grid: tuple[Floats, Floats, Floats, NDArray[np.bool_]]
    tip_force: Floats
    tip_moment: Floats
    line_force: Floats
    pieces: int
    moment_scale: float
    load: float
    unit_tension: float
    strongest: float
    changes: Floats = field(default_factory=lambda: np.zeros((0, 3, 0)))

    def load_with(self, share: float) -> tuple[Floats, Floats, Floats]:
        """Return a share of the loads and changes of tensions, as the kernels take them."""
        return share * self.tip_force, share * self.line_force, share * self.changes

    @property
    def cuts(self) -> NDArray[np.int64]:
        """First step of every piece, and the last one's end, shape (pieces + 1,)."""
        cuts = np.linspace(0.0, len(self.grid[0]) - 1.0, self.pieces + 1)
        return np.round(cuts).astype(np.int64)

    def rest(self, tendons: int, reason: str = "") -> Shot:
        """Return the straight rod under none of its command."""
        turns = np.zeros((self.pieces, 4))
        turns[:, 0] = 1.0
        return Shot(
            tensions=np.zeros(tendons),
            turns=turns,
            moments=np.zeros((self.pieces, 3)),
            share=0.0,
            reason=reason,
        )

    def trace(self, shot: Shot) -> tuple[Floats, Floats, bool]:
        """Return the states and bends at all places, and whether it got through."""
        states, bends, _, good = self._pass(shot)
        return states, bends, good

    def trace_jumps(self, shot: Shot) -> tuple[Floats, Floats, bool]:
        """Return the states, the jumps between pieces (pieces, 6), and whether it got through.

        The last row is the end against the load on it, without a turn.
        """
        states, _, jumps, good = self._pass(shot)
        return states, jumps, good

    def _pass(self, shot: Shot) -> tuple[Floats, Floats, Floats, bool]:
        states = np.zeros((len(self.grid[0]), 10 + len(shot.tensions)))
        bends = np.zeros((len(self.grid[0]), 3))
        jumps = np.zeros((self.pieces, 6))
        good = True
        cuts = self.cuts
        for index, (first, last) in enumerate(zip(cuts[:-1], cuts[1:], strict=True)):
            if index > 0:
                find_turn(shot.turns[index], states[first, 3:7], jumps[index - 1, :3])
                jumps[index - 1, 3:] = states[first, 7:10] - shot.moments[index]
            states[first, 3:7], states[first, 7:10] = shot.turns[index], shot.moments[index]
            good = good and integrate_rod(
                first,
                last,
                self.grid,
                shot.tensions,
                self.load_with(shot.share),
                states,
                bends,
            )
        jumps[-1, 3:] = states[-1, 7:10] - shot.share * self.tip_moment
        return states, bends, jumps, bool(good)


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
    natural, command : (t,) ndarray
        Their lengths in the straight robot, and the displacements asked for [mm].
    reaches : (t,) ndarray
        Their least distances from the backbone [mm].
    tensions : (t,) ndarray
        Tensions [N], in place of displacements.
    """

    names: tuple[str, ...]
    pushes: NDArray[np.bool_]
    compliances: Floats
    tolerance: float
    natural: Floats
    reaches: Floats
    command: Floats | None = None
    tensions: Floats | None = None

    def limit(self, share: float, loose: float) -> Floats:
        """Return the lengths of the cables for a share of the command [mm]; inf if not asked."""
        if self.command is None:
            return np.full(len(self.names), math.inf)
        return np.asarray(self.natural - share * self.command + loose * ~self.pushes)

    def gaps(self, lengths: Floats, tensions: Floats, share: float, loose: float) -> Floats:
        """Return how far lengths are from what is asked [mm]; 0 for slack cables."""
        if self.command is None:
            return np.zeros(len(self.names))
        gaps = lengths - self.compliances * tensions - self.limit(share, loose)
        free = ~self.pushes & (tensions == 0.0)
        return np.asarray(np.where(free, np.maximum(gaps, 0.0), gaps))

    def share(self, give: Floats, tensions: Floats, ridge: float) -> Floats:
        """Return the least tensions that do the same, where redundant tendons leave them open.

        `give` is how lengths give way to tension, `ridge` what is added to its diagonal, as a
        share of the largest.
        """
        if not give.size or self.compliances.any():
            return tensions
        taut, shared = tensions != 0.0, tensions.copy()
        high = float(np.abs(tensions).max(initial=0.0)) * taut
        low = np.where(self.pushes, -high, 0.0)
        added = ridge * float(np.abs(np.diag(give)).max(initial=0.0))
        matrix, vector = give + added * np.eye(len(taut)), -give @ tensions
        right = vector
        for _ in range(3):
            # Each pass takes out what the ridge did to the one before it.
            if not solve_bounded(matrix, right, low, high, shared):
                return tensions
            right = vector - added * shared
        return shared

    def explain_held(self, held: NDArray[np.int64]) -> str:
        """Return the reason why tendons that are as tight as can be stop the command."""
        names = ", ".join(f"'{self.names[k]}'" for k in held)
        return (
            f"{names} would have to stretch beyond it; let out tendons on the other side; "
            f"{advise_contradiction(self.tolerance)}"
        )


@dataclass(frozen=True, kw_only=True)
class Shot:
    """A state of the rod: tensions, and quaternion and moment at the start of every piece.

    `share` is the part of command and loads that it holds for; `reason` states why it is not all.
    `state` is that of tendons with friction, `inverse` that of derivatives of the jumps nearby.
    """

    tensions: Floats
    turns: Floats
    moments: Floats
    share: float = 1.0
    iterations: int = 0
    reason: str = ""
    state: FrictionState | None = None
    inverse: Floats = field(default_factory=lambda: np.zeros((0, 0)))


# Multiple shooting: moments, turns and tensions for which a rod and its tendons are as asked.

MOST_STEPS = 25
"""Newton steps for one part of a command."""

SMALL_JUMP, ROUGH_JUMP = 1e-10, 1e-5
"""Jumps between pieces that are none, in the end and on the way there [rad], or of moments."""

MOST_CORRECTIONS = 20
"""Steps with derivatives from nearby."""

TURN_LIMIT = 0.5
"""Largest turn between two pieces in one step [rad]."""

RIDGE = 1e-8
"""Added to the tendons' own flexibility, so that redundant tendons have one answer."""

SHARING = 1e-5
"""The same where the tensions are shared out: above what differences leave of such directions."""

DIFFERENCE = 1e-4
"""Step of the differences, against the size of what is changed."""


@dataclass
class Shooting:
    """Newton's method for one share of command and loads.

    ``loose`` is by how much cables may be longer than asked [mm]; `give` is how lengths give way to
    tension where it was last.
    """

    rod: Rod
    target: Target
    share: float
    loose: float
    give: Floats = field(default_factory=lambda: np.zeros((0, 0)))

    def correct(self, start: Shot, tolerance: float) -> tuple[Shot, Floats] | None:
        """Return the state under given tensions by derivatives from nearby; None if they fail.

        Beside it are the states at all places. `tolerance` is against the moments.
        """
        turns, moments, before = start.turns.copy(), start.moments.copy(), math.inf
        for _ in range(MOST_CORRECTIONS):
            shot = dataclasses.replace(start, turns=turns, moments=moments)
            states, jumps, good = self.rod.trace_jumps(shot)
            off = np.concatenate([jumps[:-1].ravel(), jumps[-1, 3:]])
            size = float(np.abs(off).max()) / (self.rod.moment_scale + float(np.abs(moments).max()))
            if not good or size > 0.9 * before:
                return None
            if size <= tolerance:
                return shot, states
            before = size
            self._move(turns, moments, -start.inverse @ off)
        return None

    def improve(self, start: Shot) -> Shot:
        """Return the state from `start` on, or where it stopped and why."""
        rod, target = self.rod, self.target
        tensions, turns, moments = start.tensions.copy(), start.turns.copy(), start.moments.copy()
        solves, known = target.command is not None, start.inverse
        if target.tensions is not None:
            tensions = self.share * target.tensions

        def stop(count: int, reason: str) -> Shot:
            return Shot(
                tensions=tensions,
                turns=turns,
                moments=moments,
                share=self.share,
                iterations=count,
                reason=reason,
                inverse=known,
            )

        gaps = np.zeros(0)
        for count in range(MOST_STEPS + 1):
            system = self._linearise(tensions, turns, moments)
            if system is None:
                return stop(count, "Newton's method fails beyond it")
            off, matrix, by_tension, lengths, length_slope = system
            gaps = target.gaps(lengths, tensions, self.share, self.loose)
            scale = rod.moment_scale + float(np.abs(moments).max())
            size = float(np.abs(off).max()) / scale
            if size <= SMALL_JUMP and np.abs(gaps).max(initial=0.0) <= self.loose:
                if solves and len(tensions):
                    tensions = self._share_tensions(tensions, turns, moments, scale)
                return stop(count, "")
            if count == MOST_STEPS:
                break
            inverse = self._invert(matrix, scale)
            if inverse is None:
                return stop(count, "the rod is about to buckle beyond it")
            known = inverse
            wanted = tensions
            if solves and len(tensions):
                wanted, why = self._pull(
                    lengths, tensions, off, inverse @ by_tension, inverse @ off, length_slope
                )
                if why:
                    return stop(count, why)
            move = -inverse @ (off + by_tension @ (wanted - tensions))
            part = self._move(turns, moments, move)
            tensions = tensions + part * (wanted - tensions)
        worst = int(np.argmax(np.abs(gaps))) if solves and len(gaps) else -1
        where = (
            f", tendon '{target.names[worst]}' misses by {abs(gaps[worst]):.3g} mm"
            if worst >= 0 and gaps[worst] != 0.0
            else ""
        )
        stiff = solves and rod.load > 0.0 and not target.compliances.any()
        advice = "; give a tendon_stiffness" if stiff else ""
        return stop(MOST_STEPS, f"no equilibrium was found beyond it{where}{advice}")

    def _invert(self, matrix: Floats, scale: float) -> Floats | None:
        # Turns in radians, moments in their own unit: one size for all.
        units = np.ones(6 * self.rod.pieces - 3)
        units[:3] = scale
        for index in range(1, self.rod.pieces):
            units[6 * index : 6 * index + 3] = scale
        try:
            return np.asarray(np.linalg.inv(matrix / units) / units[:, None])
        except np.linalg.LinAlgError:
            return None

    def _linearise(
        self, tensions: Floats, turns: Floats, moments: Floats
    ) -> tuple[Floats, Floats, Floats, Floats, Floats] | None:
        """Jumps between pieces, and lengths, with derivatives by unknowns and by tensions.

        Unknowns are the first piece's moment, then turn and moment of every other one's start.
        """
        rod, tendons, pieces = self.rod, len(tensions), self.rod.pieces
        cuts = rod.cuts
        size = 6 * pieces - 3
        off, matrix = np.zeros(size), np.zeros((size, size))
        by_tension = np.zeros((size, tendons))
        lengths, slope = np.zeros(tendons), np.zeros((tendons, size + tendons))
        states = np.zeros((len(rod.grid[0]), 10 + tendons))
        bends = np.zeros((len(rod.grid[0]), 3))
        values, local = np.zeros(6 + tendons), np.zeros((6 + tendons, 6 + tendons))
        end_moment = self.share * rod.tip_moment
        for index in range(pieces):
            final = index == pieces - 1
            states[cuts[index]] = 0.0
            states[cuts[index], 3:7], states[cuts[index], 7:10] = turns[index], moments[index]
            good = differentiate_piece(
                cuts[index],
                cuts[index + 1],
                rod.grid,
                tensions,
                rod.load_with(self.share),
                states,
                bends,
                turns[index] if final else turns[index + 1],
                DIFFERENCE * rod.moment_scale,
                DIFFERENCE * max(rod.unit_tension, float(np.abs(tensions).max(initial=0.0))),
                values,
                local,
            )
            if not good:
                return None
            # Rows of this piece's end, columns of its start: the base does not turn.
            rows = np.arange(3, 6) if final else np.arange(6)
            first = slice(6 * index, 6 * index + len(rows))
            inputs = np.arange(3, 6) if index == 0 else np.arange(6)
            begin = 0 if index == 0 else 6 * index - 3
            columns = slice(begin, begin + len(inputs))
            matrix[first, columns] = local[np.ix_(rows, inputs)]
            by_tension[first] = local[rows, 6:]
            slope[:, columns] += local[6:][:, inputs]
            slope[:, size:] += local[6:, 6:]
            lengths += values[6:]
            off[first] = values[rows]
            if final:
                off[first] -= end_moment
            else:
                off[6 * index + 3 : 6 * index + 6] -= moments[index + 1]
                following = slice(begin + len(inputs), begin + len(inputs) + 6)
                matrix[first, following] = -np.eye(6)
        return off, matrix, by_tension, lengths, slope

    def _pull(
        self,
        lengths: Floats,
        tensions: Floats,
        off: Floats,
        carried: Floats,
        straightened: Floats,
        length_slope: Floats,
    ) -> tuple[Floats, str]:
        """Tensions of the linear problem, or why there are none."""
        target = self.target
        size = len(off)
        exact = np.diag(target.compliances) - length_slope[:, size:]
        exact += length_slope[:, :size] @ carried
        give = 0.5 * (exact + exact.T)
        self.give = give
        largest = float(np.abs(np.diag(give)).max())
        strongest = self.rod.strongest
        centred = lengths - target.compliances * tensions - length_slope[:, :size] @ straightened
        free_length = target.limit(self.share, self.loose) - centred
        vector = free_length - give @ tensions
        low, high = np.where(target.pushes, -strongest, 0.0), np.full(len(give), strongest)
        wanted, right = np.zeros(len(give)), vector
        for _ in range(2):
            # The second pass takes out what the ridge did to the first.
            if not solve_bounded(
                give + RIDGE * largest * np.eye(len(give)), right, low, high, wanted
            ):
                return tensions, "no equilibrium was found beyond it"
            right = vector - RIDGE * largest * wanted
        held = np.flatnonzero(np.abs(wanted) >= strongest)
        if held.size:
            return tensions, target.explain_held(held)
        free = (wanted > low) & (wanted < high)
        if np.abs(exact - give).max() > 1e-6 * largest and free.any():
            # A moment of fixed direction has no potential: the problem is not symmetric.
            block = exact[np.ix_(free, free)] + RIDGE * largest * np.eye(int(free.sum()))
            moved = wanted[~free] - tensions[~free]
            change = np.linalg.solve(block, -free_length[free] - exact[np.ix_(free, ~free)] @ moved)
            trial = tensions[free] + change
            if np.all((trial > low[free]) & (trial < high[free])):
                wanted[free] = trial
        return wanted, ""

    def _move(self, turns: Floats, moments: Floats, move: Floats) -> float:
        """Take a step, cut short where it turns too far; returns the part that was taken."""
        inner = np.concatenate([np.zeros(3), move]).reshape(-1, 6)
        widest = float(np.linalg.norm(inner[:, :3], axis=1).max())
        part = min(1.0, TURN_LIMIT / widest) if widest > 0.0 else 1.0
        moments += part * inner[:, 3:]
        out = np.empty(4)
        for index in range(1, len(turns)):
            turn_quaternion(turns[index], part * inner[index, :3], out)
            turns[index] = out / np.linalg.norm(out)
        return part

    def _share_tensions(
        self, tensions: Floats, turns: Floats, moments: Floats, scale: float
    ) -> Floats:
        """Take the least tensions that do the same, where redundant ones differ."""
        shared = self.target.share(self.give, tensions, SHARING)
        # The same to first order only: it must hold of the lengths and joints themselves.
        shot = Shot(tensions=shared, turns=turns, moments=moments, share=self.share)
        states, jumps, good = self.rod.trace_jumps(shot)
        off, lengths = float(np.abs(jumps).max()), states[-1, 10:]
        gaps = self.target.gaps(lengths, shared, self.share, self.loose)
        fits = good and off <= 1e-9 * scale and np.abs(gaps).max(initial=0.0) <= self.loose
        return shared if fits else tensions


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

SHARING_UNLOADED = 1e-8
"""The same where the tensions are shared out."""


def improve_unloaded(rod: Rod, target: Target, share: float, loose: float, start: Shot) -> Shot:
    """Return the state for a `share` of the command, from `start` on, or why there is none."""
    found = dataclasses.replace(start, share=share, iterations=0, reason="")
    if target.tensions is not None:
        return dataclasses.replace(found, tensions=share * target.tensions)
    tensions = start.tensions.copy()
    limit = target.limit(share, loose)
    value, lengths, give = _measure(rod, target, tensions, limit)
    reason = "no equilibrium was found beyond it"
    for count in range(MOST_STEPS_UNLOADED + 1):
        gaps = target.gaps(lengths, tensions, share, loose)
        if np.abs(gaps).max(initial=0.0) <= loose:
            shared = target.share(give, tensions, SHARING_UNLOADED)
            _, shorter, _ = _measure(rod, target, shared, limit)
            left = target.gaps(shorter, shared, share, loose)
            if np.abs(left).max(initial=0.0) <= loose:
                tensions = shared
            return dataclasses.replace(found, tensions=tensions, iterations=count)
        if count == MOST_STEPS_UNLOADED:
            break
        slope = lengths - target.compliances * tensions - limit
        high = np.full(len(tensions), rod.strongest)
        low = np.where(target.pushes, -high, 0.0)
        ridge = RIDGE_UNLOADED * float(np.diag(give).max())
        matrix = give + np.diag(target.compliances + ridge)
        wanted = tensions.copy()
        if not solve_bounded(matrix, -slope - matrix @ tensions, low, high, wanted):
            break
        held = np.flatnonzero(np.abs(wanted) >= rod.strongest)
        if held.size and count > 0:
            reason = target.explain_held(held)
            break
        change, part = wanted - tensions, 1.0
        rise = float(slope @ change)
        round_off = 1e-13 * float(np.abs(tensions) @ lengths + np.abs(wanted) @ lengths)
        while part >= SMALLEST_CUT:
            trial = tensions + part * change
            after, longer, soft = _measure(rod, target, trial, limit)
            if after >= value + 1e-4 * part * rise - round_off:
                break
            part *= 0.5
        else:
            break
        tensions, value, lengths, give = trial, after, longer, soft
    if reason.startswith("no"):
        worst = int(np.argmax(np.abs(gaps)))
        reason += f", tendon '{target.names[worst]}' misses by {abs(gaps[worst]):.3g} mm"
    return dataclasses.replace(found, iterations=count, reason=reason)


def _measure(
    rod: Rod, target: Target, tensions: Floats, limit: Floats
) -> tuple[float, Floats, Floats]:
    """The dual's value, lengths (t,), and how they give way to tension (t, t)."""
    lengths, give = np.empty(len(tensions)), np.empty((len(tensions), len(tensions)))
    value = measure_unloaded(rod.grid, tensions, lengths, give)
    if math.isnan(value):
        return -math.inf, lengths, give
    value -= float(tensions @ (limit + 0.5 * target.compliances * tensions))
    return value, lengths, give


# A rod brought to a command and its loads, at once or else in parts.

SMALLEST_PART = 1.0 / 16.0
"""Smallest part, of the first one, by which it is raised where more of it fails."""

LOAD_STEP = 2.0
"""Largest part of the loads that is put on at once, against those that bend it by 1 rad."""

PLAY = 1e-4
"""Displacement of the tip that the tolerance may always make, against the rod's length."""

TIGHT = 0.1
"""Part of the tolerance that is left."""

LEVERS = 10.0
"""The same against what the tolerance makes of it over the lever of length by offset."""

PUSH_STEP = 0.5
"""Largest turn that tendons ask for at once, where there may be several equilibria [rad]."""


def follow(rod: Rod, target: Target, *, convex: bool) -> Shot:
    """Find the rod's state from the straight one on, as far as it can be followed.

    `convex` is whether there is only one without loads, whatever the way to it.
    """
    kept = rod.rest(len(target.names))
    # Little by little, where at once it may end on another branch.
    part, steps, reason = min(1.0, LOAD_STEP / max(rod.load, 1e-9)), 0, ""
    if target.command is not None and not convex:
        turn = float((np.abs(target.command) / target.reaches).max(initial=0.0))
        part = min(part, PUSH_STEP / max(turn, PUSH_STEP))
    smallest = SMALLEST_PART * part
    # As commanded to round-off; with the tolerance, and in parts, only where that cannot be.
    loose = 1e-3 * target.tolerance
    while kept.share < 1.0:
        share = min(1.0, kept.share + part)
        if share > 1.0 - 1e-9:
            share = 1.0
        if rod.load == 0.0:
            found = improve_unloaded(rod, target, share, loose, kept)
        else:
            found = Shooting(rod, target, share, loose).improve(kept)
        steps += found.iterations
        if not found.reason:
            kept = found
            continue
        reason = found.reason
        if loose < target.tolerance:
            loose = target.tolerance
        else:
            part *= 0.5
        if part < smallest:
            percent = math.floor(100.0 * kept.share)
            what = "command and loads" if rod.load > 0.0 else "the command"
            reason = f"{what} can be followed to {percent} % only: {reason}"
            break
    else:
        reason = find_play(rod, target, loose, kept)
    return dataclasses.replace(kept, iterations=steps, reason=reason)


def find_play(rod: Rod, target: Target, loose: float, found: Shot) -> str:
    """Return why the tip is undetermined within the tolerance of the displacements; else nothing.

    Parallel tendons that do not stretch hold the twist so that it grows with the root of what
    they have too much: then the tolerance decides where the tip is, not the loads.
    """
    if rod.load == 0.0 or target.command is None or target.compliances.any():
        return ""
    if not target.command.size:
        return ""
    if loose == target.tolerance:  # it was needed: without most of it
        other = Shooting(rod, target, 1.0, TIGHT * loose).improve(found)
    else:
        looser = dataclasses.replace(target, command=target.command - target.tolerance)
        other = Shooting(rod, looser, 1.0, loose).improve(found)
    what = (
        "tendons that do not stretch leave the shape open under these loads: for displacements "
        f"that differ by the tolerance of {target.tolerance:g} mm"
    )
    if other.reason:
        return f"{what} no equilibrium was found; give a tendon_stiffness"
    tips = [rod.trace(shot)[0][-1, :3] for shot in (found, other)]
    play, length = float(np.linalg.norm(tips[1] - tips[0])), float(rod.grid[0][-1])
    lever = length / float(target.reaches.min())
    if play <= max(PLAY * length, LEVERS * lever * target.tolerance):
        return ""
    return f"{what} the tip is {play:.2g} mm elsewhere; give a tendon_stiffness"


# The rod whose tendons have friction: from the state before to the next one.


def follow_sliding(
    rod: Rod, target: Target, channels: Channels, before: FrictionState, start: Shot | None
) -> Shot:
    """Find the rod's state after another one; `start` is a rod near to it."""
    found = rod.rest(len(target.names)) if start is None else start

    def bend(profile: Floats, rough: bool) -> Bending:
        nonlocal found, start
        if rod.load == 0.0:
            return Bending(moments=np.zeros((*profile.shape[:2], 3)))
        first = profile[0, 0].copy()
        pulled = dataclasses.replace(rod, changes=profile - first)
        given = dataclasses.replace(target, command=None, tensions=first)
        shooting = Shooting(pulled, given, 1.0, 0.0)
        if start is not None and start.inverse.size:
            moved = dataclasses.replace(start, tensions=first)
            near = shooting.correct(moved, ROUGH_JUMP if rough else SMALL_JUMP)
            if near is not None:
                found, states = near
                start = found
                return Bending(moments=_list_moments(states), lengths=states[-1, 10:])
        trial = None if start is None else shooting.improve(start)
        if trial is None or trial.reason:
            trial = follow(pulled, given, convex=True)
        if trial.reason:
            return Bending(reason=trial.reason)
        found = start = trial
        states, _, good = pulled.trace(found)
        if not good:
            return Bending(reason="no curvature was found")
        return Bending(moments=_list_moments(states), lengths=states[-1, 10:])

    high = np.full(len(target.names), rod.strongest)
    drive = Drive(
        tensions=target.tensions,
        limits=target.limit(1.0, 0.0),
        low=np.where(target.pushes, -high, 0.0),
        high=high,
        tolerance=0.1 * target.tolerance,
    )
    sliding = Sliding(channels=channels, before=before, bend=bend)
    state, reason = sliding.follow(drive)
    held = np.flatnonzero(np.abs(sliding.pulled) >= rod.strongest)
    if reason and held.size and target.command is not None:
        reason = target.explain_held(held)
    if reason:
        reason = f"the command can be followed in part only: {reason}"
    return dataclasses.replace(
        found,
        tensions=state.tensions[0, 0],
        share=1.0,
        iterations=sliding.iterations,
        reason=reason,
        state=state,
    )


def _list_moments(states: Floats) -> Floats:
    """Moments over the cross-sections at start, middle and end of steps, in their frames."""
    from scipy.spatial.transform import Rotation

    turns, moments = states[:, 3:7], states[:, 7:10]
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
class RodModel(ContinuumModel):
    """Kirchhoff rod with tendons in smooth channels, with friction or without, under loads.

    After Rucker and Webster (2011), for a rod that neither shears nor stretches and is straight at
    rest. It is there to check the energy model, and for loads: cables hold tension or are slack.

    Without loads every cross-section takes the curvature of least energy under the tensions, and
    those follow from a concave problem, by Newton's method with a line search. With cables only,
    or parallel tendons, there is one answer. Rods that push on other routings may have several
    equilibria: the command is raised in steps from the straight rod, and curvatures are minima,
    so that the rod is stable by itself; where that way ends, the reason states how far it went.

    With loads the rod is integrated from the base, and the base's moment and the tensions are
    found by multiple shooting. There may be several equilibria: this finds the one that is reached
    from the straight rod as loads and displacements are raised together, and does not check whether
    it is stable. Loads keep their direction as the robot bends. A moment of fixed direction has no
    potential.

    Where tendons have a coefficient of friction, tensions fall along them by the capstan law in the
    direction in which they slide, and a shape depends on those before it: `initial` is where they
    come from, the straight robot without tensions unless given. `bozzini.continuum.friction` has
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
        Force per length of backbone, in the base frame, weight for example [N/mm].
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

    tip_force: Vector = quantity(
        "force",
        "Force on the tip in the base's frame, such as 0,0,-0.1N; needs --tendon-stiffness.",
        default=ZERO,
        kw_only=True,
    )
    tip_moment: Vector = field(default=ZERO, kw_only=True)
    distributed_force: Vector = quantity(
        "line force",
        "Force per length in the base's frame, weight for example, such as 0,-0.001N/mm,0; "
        "needs --tendon-stiffness.",
        default=ZERO,
        kw_only=True,
        option="line_force",
    )
    tendon_stiffness: float = quantity(
        "force",
        "EA of tendons without one of their own (default: they do not stretch).",
        low=0.0,
        low_open=True,
        default=math.inf,
        kw_only=True,
    )
    between: int = quantity(
        help="Further stations between two discs.",
        low=0,
        high=1000,
        whole=True,
        default=0,
        kw_only=True,
    )
    steps: int = quantity(
        help="Least number of steps along the robot.",
        low=10,
        high=100_000,
        whole=True,
        default=200,
        kw_only=True,
    )

    name = "rod"
    heeds = frozenset({"stiffness of tendons", "tension limits"})
    takes_friction = True
    checked_by_class = ("tip_force", "tip_moment", "distributed_force")

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.checked_by_class:
            vector = check_points(name, getattr(self, name))
            if vector.shape != (3,):
                raise InputError(f"{name} has shape {vector.shape}: it must be (3,)")
            object.__setattr__(self, name, tuple(vector.tolist()))

    @property
    def arc_length(self) -> Floats:
        """Stations: base, discs, tendon ends and points between [mm], shape (k,)."""
        return self._grid.arc_length

    @property
    def natural_lengths(self) -> Floats:
        """Length of each tendon in the straight robot [mm], shape (t,)."""
        return self._grid.natural_lengths

    def shape(self, displacements: ArrayLike, *, initial: Shape | None = None) -> Shape:
        """Return the shapes under displacements and the loads; see `ContinuumModel.shape`.

        Parameters
        ----------
        displacements : array_like, shape (..., t)
            How far each tendon is pulled [mm].
        initial : Shape, optional
            Where tendons with friction come from: one shape of this model, or one for each command;
            the straight robot without tensions unless given.
        """
        commands = check_displacements(self.robot, displacements)
        states = self._take_states(initial, commands.shape[:-1])
        shots = [
            self._shoot(state, command=command)
            for state, command in zip(states, _rows(commands), strict=True)
        ]
        return self._answer(commands, shots)

    def shape_under_tensions(self, tensions: ArrayLike, *, initial: Shape | None = None) -> Shape:
        """Return the shapes under tensions of the tendons at the base, and the loads.

        Parameters
        ----------
        tensions : array_like, shape (..., t)
            Tension of each tendon [N]; 0 or more unless it is a rod that pushes.
        initial : Shape, optional
            Where tendons with friction come from: one shape of this model, or one for each command;
            the straight robot without tensions unless given.

        Returns
        -------
        Shape
            Its displacements are those of the tendons in that shape.

        Raises
        ------
        InputError
            If the tensions are not finite numbers of that shape, or a cable's is negative.
        """
        pulls = self._check_tensions(tensions)
        states = self._take_states(initial, pulls.shape[:-1])
        shots = [
            self._shoot(state, tensions=row)
            for state, row in zip(states, _rows(pulls), strict=True)
        ]
        return self._answer(pulls, shots, given=True)

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
        pulls = _check_history(self._check_tensions(history))
        shots = self._trace(initial, [{"tensions": row} for row in pulls])
        return TendonHistory(shapes=self._answer(pulls, shots, given=True), given="tensions")

    def trace_displacements(
        self, history: ArrayLike, *, initial: Shape | None = None
    ) -> TendonHistory:
        """Return the shapes on the way through displacements [mm]; see `trace_tensions`."""
        commands = _check_history(check_displacements(self.robot, history))
        shots = self._trace(initial, [{"command": row} for row in commands])
        return TendonHistory(shapes=self._answer(commands, shots), given="displacements")

    def _check_tensions(self, tensions: ArrayLike) -> Floats:
        count = len(self.robot.tendons)
        pulls = check_points("tensions", tensions, dim=count)
        low = np.where(self.robot.pushes, -math.inf, 0.0)
        if np.any(pulls < low):
            place = np.argwhere(pulls < low)[0]
            raise InputError(
                f"tension of tendon '{self.robot.tendon_names[place[-1]]}' is "
                f"{pulls[tuple(place)]:g} N: it must lie in [0, inf) N, for a cable does not push"
            )
        return pulls

    @cached_property
    def _grid(self) -> RodGrid:
        return RodGrid(self.robot, self.between, self.steps)

    @cached_property
    def _compliances(self) -> Floats:
        return self.natural_lengths / choose_stiffness(self.robot, self.tendon_stiffness)

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

    @cached_property
    def _channels(self) -> Channels | None:
        """What holds the tendons in their channels; None without friction."""
        friction = self.robot.tendon_friction
        if not friction.any():
            return None
        return Channels(
            grid=self._grid.packed,
            friction=friction,
            flexibility=1.0 / choose_stiffness(self.robot, self.tendon_stiffness),
        )

    def _take_states(
        self, initial: Shape | None, batch: tuple[int, ...]
    ) -> list[FrictionState | None]:
        """Return the state before each command of a batch; None without friction."""
        count = math.prod(batch)
        if initial is not None and not isinstance(initial, Shape):
            raise InputError(
                f"initial is of type {type(initial).__name__}: it must be a Shape of this model"
            )
        if self._channels is None:
            return [None] * count
        if initial is None:
            return [self._channels.rest()] * count
        state = initial.friction
        if state is None or state.tensions.shape[-3:] != self._channels.rest_rates.shape:
            raise InputError(
                f"initial is a shape of the {initial.model} model without tensions in the channels "
                "of this robot: it must be one of the same rod model, steps included"
            )
        initial.require()
        own = initial.displacements.shape[:-1]
        if own not in ((), batch):
            raise InputError(
                f"initial has shapes for {own}: it must be one shape, or one for each of {batch}"
            )
        return [state.pick(index if own else ()) for index in np.ndindex(batch)]

    def _trace(self, initial: Shape | None, commands: list[dict[str, Floats]]) -> list[Shot]:
        """Shoot one command after the other, each from the one before."""
        (state,) = self._take_states(initial, ())
        shots: list[Shot] = []
        start: Shot | None = None
        for command in commands:
            shot = self._shoot(state, start=start, **command)
            shots.append(shot)
            if not shot.reason and shot.state is not None:
                start, state = shot, shot.state
        return shots

    def _shoot(
        self,
        state: FrictionState | None,
        *,
        command: Floats | None = None,
        tensions: Floats | None = None,
        start: Shot | None = None,
    ) -> Shot:
        target = Target(
            names=self.robot.tendon_names,
            pushes=self.robot.pushes,
            compliances=self._compliances,
            tolerance=self.tolerance,
            natural=self.natural_lengths,
            reaches=self._grid.reaches,
            command=command,
            tensions=tensions,
        )
        if self._channels is not None and state is not None:
            return follow_sliding(self._rod, target, self._channels, state, start)
        convex = not self.robot.pushes.any() or self.robot.is_parallel
        return follow(self._rod, target, convex=convex)

    def _answer(self, commands: Floats, shots: list[Shot], *, given: bool = False) -> Shape:
        """Shapes of shots; `commands` are displacements, or tensions if `given`."""
        from scipy.spatial.transform import Rotation

        tendons = len(self.robot.tendons)
        places, ends = self._grid.places, self.robot.section_ends
        index = np.searchsorted(places, self.arc_length - EDGE)
        frames = np.zeros((len(shots), len(index), 4, 4))
        frames[..., 3, 3] = 1.0
        lengths = np.zeros((len(shots), tendons))
        stretched = np.zeros((len(shots), tendons))
        sums = np.zeros((len(shots), len(ends), 2))
        bends, curvatures = np.zeros((2, len(shots), len(ends)))
        edges = np.searchsorted(places, np.concatenate([[0.0], ends]) - EDGE)
        for row, shot in enumerate(shots):
            rod = self._rod
            if shot.state is not None and self._channels is not None:
                along = shot.state.tensions
                rod = dataclasses.replace(rod, changes=along - along[0, 0])
                stretched[row] = self._channels.stretch(along)
            else:
                stretched[row] = self._compliances * shot.tensions
            states, turned, good = rod.trace(shot)
            if not good:
                shots[row] = shot = self._rod.rest(tendons, "no curvature was found")
                states, turned, _ = self._rod.trace(shot)
            turned_by = Rotation.from_quat(np.roll(states[index, 3:7], -1, axis=1))
            frames[row, :, :3, :3] = turned_by.as_matrix()
            frames[row, :, :3, 3] = states[index, :3]
            lengths[row] = states[-1, 10:]
            parts = np.diff(turned[edges], axis=0)
            sums[row] = np.stack([parts[:, 1], -parts[:, 0]], axis=-1)
            turns = np.hypot(*np.diff(turned[:, :2], axis=0).T)
            bends[row] = np.add.reduceat(turns, edges[:-1])
            curvatures[row] = np.maximum.reduceat(turns / np.diff(places), edges[:-1])
        tensions = np.asarray([s.tensions for s in shots], dtype=np.float64)
        tensions = tensions.reshape(len(shots), tendons)
        if given:
            displacements = self.natural_lengths - lengths
            slack = ~self.robot.pushes & (_rows(commands) == 0.0)
            asked = lengths
        else:
            displacements = _rows(commands)
            shares = np.asarray([s.share for s in shots]).reshape(-1, 1)
            followed = self.natural_lengths - shares * displacements
            slack = ~self.robot.pushes & (lengths < followed - self.tolerance)
            asked = self.natural_lengths - displacements + stretched
        residual = np.abs(np.where(slack, 0.0, lengths - asked)).max(axis=1, initial=0.0)
        words = [f"{s.reason}{explain_contrast(self.robot)}" if s.reason else "" for s in shots]
        verdict = (
            np.asarray([not s.reason for s in shots], dtype=np.bool_),
            np.asarray(words, dtype=np.str_),
        )
        verdict = check_numbers(self, frames, residual, verdict)
        measure = BendMeasure(bends=bends, curvatures=curvatures, round_off=ROUND_OFF)
        made = self.make_shape(
            displacements.reshape(commands.shape),
            arc_length=self.arc_length,
            frames=frames,
            tendon_lengths=lengths,
            section_parameters=sums if self._bends_evenly else sums[:, :0],
            tensions=tensions,
            slack=slack,
            residual=residual,
            iterations=np.asarray([s.iterations for s in shots], dtype=np.int64),
            verdict=check_limits(self.robot, displacements, measure, verdict),
        )
        known = [shot.state for shot in shots if shot.state is not None]
        if not known:
            return made
        return dataclasses.replace(made, friction=FrictionState.join(known, commands.shape[:-1]))

    @cached_property
    def _bends_evenly(self) -> bool:
        loads = np.concatenate([self.tip_force, self.tip_moment, self.distributed_force])
        return self.robot.is_parallel and self._channels is None and not loads.any()


def _check_history(history: Floats) -> Floats:
    if history.ndim != 2 or not len(history):
        raise InputError(
            f"history has shape {history.shape}: it must be (n, {history.shape[-1]}), n at least 1"
        )
    return history


def _rows(array: Floats) -> Floats:
    """Return (..., t) as (b, t), where b or t may be 0."""
    return array.reshape(math.prod(array.shape[:-1]), array.shape[-1])
