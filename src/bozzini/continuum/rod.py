"""The reference: a Cosserat rod with tendons, a boundary-value problem."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_points, check_word, quantity
from ..errors import InputError
from ..numeric.kernels.linear_algebra import solve_bounded
from .checks import Floats
from .coupling import check_displacements
from .energy import place_stations
from .friction import Bending, Channels, Drive, FrictionState, Sliding
from .gradients import Held, ShapeJacobian
from .history import TendonHistory
from .kernels import shooting
from .kernels.rod import (
    BEND,
    BY_LENGTHS,
    FORCE,
    LENGTHS,
    MOMENT,
    TURN,
    integrate_rod,
    measure_unloaded,
)
from .kernels.shooting import BUCKLING, FEW_MORE, FOUND, HELD, MOST_STEPS, SMALL_JUMP, UNSTABLE
from .kernels.stability import measure_stability
from .loads import BODY, Load, PackedLoads, check_loads, pack_loads
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
from .section import LEAST_LEVER, Section
from .shape import Shape

# A robot cut into steps, as the rod's kernels take it.

NUDGE_MM = 10.0 * ROUND_OFF_MM
"""How far inside a step its ends are evaluated [mm]."""

RIGID = 1e10
"""Stiffness that stands for an infinite one, against bending stiffness by the length's square."""

Packed = tuple[Floats, Floats, Floats, Floats, NDArray[np.bool_]]
PackedRod = tuple[Packed, tuple[Floats, Floats, Floats], bool]
Aim = tuple[Floats, NDArray[np.bool_], Floats, Floats, Floats]
Known = tuple[Floats, NDArray[np.int64], Floats, Floats, Floats]

NOTHING_KNOWN: Known = (
    np.zeros((0, 0)),
    np.zeros(0, dtype=np.int64),
    np.zeros((0, 0)),
    np.zeros((0, 0)),
    np.zeros((0, 0)),
)


@dataclass(frozen=True)
class RodGrid:
    """Steps of a robot, and how its tendons pass them.

    `places` (n + 1,) are the steps' ends [mm]; wherever something jumps is one of them.
    """

    robot: RobotDesign
    places: Floats

    @classmethod
    def cut(cls, robot: RobotDesign, stations: Floats, steps: int) -> RodGrid:
        """Return at least so many steps, with stations and corners of tendons among their ends."""
        corners = [place for tendon in robot.tendons for place in tendon.corners()]
        breaks = _unique(np.concatenate([stations, corners]))
        widest = robot.length / steps
        pieces = [
            np.linspace(start, end, math.ceil((end - start) / widest - 1e-9) + 1)[1:]
            for start, end in zip(breaks[:-1], breaks[1:], strict=True)
        ]
        return cls(robot, np.concatenate([[0.0], *pieces]))

    def thin(self, breaks: Floats, steps: int) -> RodGrid:
        """Return about so many of these steps, joined between breaks."""
        kept, widest = [0], self.robot.length / steps * (1.0 + 1e-9)
        fixed = np.isin(np.arange(len(self.places)), np.searchsorted(self.places, breaks - EDGE))
        for index in range(1, len(self.places) - 1):
            if fixed[index] or self.places[index + 1] - self.places[kept[-1]] > widest:
                kept.append(index)
        return RodGrid(self.robot, self.places[[*kept, -1]])

    @cached_property
    def natural_lengths(self) -> Floats:
        """Length of each tendon in the straight robot [mm], shape (t,)."""
        slopes = np.sqrt(1.0 + np.sum(self.guides[..., 2:] ** 2, axis=-1)) * self.present[:, None]
        means = (slopes[:, 0] + 4.0 * slopes[:, 1] + slopes[:, 2]) / 6.0
        return np.asarray(np.sum(means * np.diff(self.places)[:, None], axis=0))

    @property
    def packed(self) -> Packed:
        """What the kernels take, see `integrate_rod`."""
        return self.places, self.stiffness, self.rest, self.guides, self.present

    @cached_property
    def inner_places(self) -> Floats:
        """Start, middle and end of the steps [mm], inside of them, shape (n, 3)."""
        middles = 0.5 * (self.places[1:] + self.places[:-1])
        width = np.diff(self.places)
        edge = np.maximum(0.5 * width - NUDGE_MM, 0.25 * width)
        return np.stack([middles - edge, middles, middles + edge], axis=1)

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """Whether each tendon runs in each step, shape (n, t)."""
        return np.asarray(self.inner_places[:, 1, None] < self.robot.tendon_ends)

    @cached_property
    def guides(self) -> Floats:
        """Places and slopes of tendons at start, middle and end of steps, shape (n, 3, t, 4)."""
        guides = np.zeros((len(self.places) - 1, 3, len(self.robot.tendons), 4))
        for row, tendon in enumerate(self.robot.tendons):
            here = self.present[:, row]
            guides[here, :, row, :2] = tendon.place_at(self.inner_places[here])
            guides[here, :, row, 2:] = tendon.slope_at(self.inner_places[here])
        return guides

    @cached_property
    def stiffness(self) -> Floats:
        """Stiffnesses of the backbone as of `RobotDesign.stiffness_at`, shape (n, 3, 6)."""
        found = self.robot.stiffness_at(self.inner_places)
        rigid = RIGID * found[..., 3:].max() / self.robot.length**2
        return np.ascontiguousarray(np.where(np.isfinite(found), found, rigid))

    @cached_property
    def rest(self) -> Floats:
        """Curvatures and twist at rest [1/mm], shape (n, 3, 3)."""
        return np.ascontiguousarray(self.robot.curvature_at(self.inner_places))

    @cached_property
    def reaches(self) -> Floats:
        """Least distance of each tendon from the backbone, as a lever [mm], shape (t,).

        Of a tendon that comes near to the backbone, or crosses it, a share of its largest.
        """
        offsets = np.sqrt(np.sum(self.guides[..., :2] ** 2, axis=-1))
        most = offsets.max(axis=(0, 1))
        offsets = np.where(self.present[:, None], offsets, math.inf)
        return np.asarray(np.maximum(offsets.min(axis=(0, 1)), LEAST_LEVER * most))


def _unique(places: Floats) -> Floats:
    """Return sorted places, those that differ by round-off once."""
    ordered = np.unique(places)
    return np.asarray(ordered[np.concatenate([[True], np.diff(ordered) > ROUND_OFF_MM])])


def list_breaks(robot: RobotDesign, loads: PackedLoads) -> Floats:
    """Return the arc lengths inside a robot where its sections, tendons or loads change [mm]."""
    corners = [place for tendon in robot.tendons for place in tendon.corners()]
    knots = [
        start + knot
        for start, section in zip(robot.section_starts, robot.sections, strict=True)
        for knot in list_knots(section)
    ]
    found = _unique(
        np.concatenate(
            [
                robot.section_ends,
                robot.tendon_ends,
                corners,
                knots,
                loads.points,
                loads.line_spans.ravel(),
            ]
        )
    )
    return found[(found > ROUND_OFF_MM) & (found < robot.length - ROUND_OFF_MM)]


def list_knots(section: Section) -> list[float]:
    """Return the places of all knots of a section's profiles, from its start [mm]."""
    profiles: list[object] = [
        section.bending_stiffness,
        section.torsional_stiffness,
        section.stretch_stiffness,
        section.shear_stiffness,
        section.line_weight,
        section.curvature,
        section.wire.diameter if section.wire else None,
    ]
    rows = [row for profile in profiles if isinstance(profile, tuple) for row in profile]
    return [float(row[0]) for row in rows if isinstance(row, tuple)]


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
        """Return what the kernels take for a share of the command, see `miss_lengths`."""
        return self.goals(share, loose), self.holds, *self.bounds

    def gaps(self, lengths: Floats, tensions: Floats, share: float, loose: float) -> Floats:
        """Return how far lengths are from what is asked [mm]; 0 for slack cables."""
        gaps = np.zeros(len(self.names))
        shooting.miss_lengths(self.aim(share, loose), lengths, tensions, gaps)
        return gaps

    def find_taut(self, states: Floats, tensions: Floats, share: float) -> NDArray[np.bool_]:
        """Return which tendons hold a length, (t,), in states under a share of the command."""
        aim = self.aim(share, 0.0)
        found = shooting.find_taut(aim, states[-1, LENGTHS:], tensions, self.tolerance)
        return np.asarray(found)

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

    def copy(self) -> Shot:
        """Return another one to be improved."""
        names = ("tensions", "turns", "moments", "forces", "states")
        return dataclasses.replace(self, **{name: getattr(self, name).copy() for name in names})


Form = tuple[Floats, Floats, Floats, Floats]


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

    @cached_property
    def packed_few(self) -> PackedRod:
        """What the kernels take of the few steps, see `integrate_rod`."""
        return self.few.packed, (*self._place_loads(self.few), np.zeros((0, 3, 0))), self.shears

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
        made.__dict__.update(known, packed_few=packed, packed_many=packed)
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
        rods = (
            (self.packed_few, self.few_cuts, few_states),
            (self.packed_many, self.many_cuts, shot.states),
        )
        known, form = self.make_known(len(shot.tensions)), make_form(self.few, len(shot.tensions))
        code, steps, reached, failed, loose = shooting.follow(
            rods,
            self.unit,
            (target.rest, target.change, target.holds),
            target.bounds,
            shot.unknowns,
            known,
            (form, EMPTY),
            (first, target.tolerance, passes),
        )
        if code != FOUND and reached == 1.0:
            # Derivatives on few steps do not do: where they are almost singular.
            form = make_form(self.many, len(shot.tensions))
            code, count = shooting.improve(
                self.packed_many,
                self.many_cuts,
                self.unit,
                1.0,
                target.aim(1.0, loose),
                (*shot.unknowns, shot.states),
                known,
                form,
                (SMALL_JUMP, loose, MOST_STEPS),
            )
            steps += count
        reason, stability = "", 1.0
        if code == FOUND or code == UNSTABLE:
            share = 1.0 if code == FOUND else failed
            taut = target.find_taut(few_states, shot.tensions, share)
            stability = measure_stability(form, target.compliances, taut)
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

    def trace(self, shot: Shot, form: Form) -> bool:
        """Fill a shot's states at all places; and `form`, of the many steps, if not empty."""
        tendons = len(shot.tensions)
        matrix, _, carried, by_unknown, give = self.make_known(tendons)
        jumps = np.empty(len(matrix))
        state = *shot.unknowns, shot.states
        system = matrix, carried, by_unknown, give
        packed = self.packed_many
        return bool(
            shooting.shoot(
                packed, self.many_cuts, self.unit, shot.share, state, jumps, system, form
            )
        )

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
    loose = shooting.ROUND_OFF * target.tolerance
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
    """Return a state of the rod with its places and its stability."""
    form = make_form(rod.many, len(shot.tensions))
    if not rod.trace(shot, form):
        rest = rod.rest()
        return dataclasses.replace(rest, reason="no curvature was found")
    taut = target.find_taut(shot.states, shot.tensions, shot.share)
    return dataclasses.replace(shot, stability=measure_stability(form, target.compliances, taut))


# A rod brought to a command and its loads, at once or else in parts.

LOAD_STEP = 2.0
"""Largest part of the loads that is put on at once, against those that bend it by 1 rad."""

PLAY = 1e-4
"""Displacement of the tip that the tolerance may always make, against the rod's length."""

TIGHT = 0.01
"""Part of the tolerance that is left."""

LEVERS = 10.0
"""The same against what the tolerance makes of it over the lever of length by offset."""

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


EMPTY: Form = (
    np.zeros((0, 6, 6)),
    np.zeros((0, 3, 3)),
    np.zeros((0, 0, 6)),
    np.zeros((0, 0, 0)),
)


def share_tensions(rod: Rod, target: Target, found: Shot) -> Shot:
    """Return the state with the least tensions that do the same, where redundant ones differ."""
    shared = found.copy()
    shared.tensions[:] = target.share(found.known[-1], found.tensions, SHARING)
    # The same to first order only: it must hold of the lengths and joints themselves.
    loose = shooting.ROUND_OFF * target.tolerance
    gaps = target.gaps(found.states[-1, LENGTHS:], found.tensions, 1.0, loose)
    most = max(loose, float(np.abs(gaps).max(initial=0.0)))
    aim = shared.tensions.copy(), np.zeros(len(gaps), dtype=np.bool_), *target.bounds
    code, _ = shooting.improve(
        rod.packed_many,
        rod.many_cuts,
        rod.unit,
        1.0,
        aim,
        (*shared.unknowns, shared.states),
        found.known,
        EMPTY,
        (SMALL_JUMP, math.inf, FEW_MORE),
    )
    gaps = target.gaps(shared.states[-1, LENGTHS:], shared.tensions, 1.0, loose)
    return shared if code == FOUND and np.abs(gaps).max(initial=0.0) <= most else found


def find_play(rod: Rod, target: Target, found: Shot) -> str:
    """Return why the tip is undetermined within the tolerance of the displacements; else nothing.

    Parallel tendons that do not stretch hold the twist so that it grows with the root of what
    they have too much: then the tolerance decides where the tip is, not the loads.
    """
    loose = shooting.ROUND_OFF * target.tolerance
    gaps = target.gaps(found.states[-1, LENGTHS:], found.tensions, 1.0, loose)
    needed = float(np.abs(gaps).max(initial=0.0)) > 2.0 * loose
    # Where most of the tolerance was needed, without it.
    change = 0.0 if needed else target.tolerance
    other_loose = TIGHT * target.tolerance if needed else loose
    rest = target.rest + change * target.holds
    looser = dataclasses.replace(target, rest=rest)
    known, form = rod.make_known(len(gaps)), make_form(rod.many, len(gaps))
    other = found.copy()
    code, _ = shooting.improve(
        rod.packed_many,
        rod.many_cuts,
        rod.unit,
        1.0,
        looser.aim(1.0, other_loose),
        (*other.unknowns, other.states),
        known,
        form,
        (SMALL_JUMP, other_loose, MOST_STEPS),
    )
    what = (
        "tendons that do not stretch leave the shape open under these loads: for displacements "
        f"that differ by the tolerance of {target.tolerance:g} mm"
    )
    if code != FOUND:
        return f"{what} no equilibrium was found; give a tendon_stiffness"
    play = float(np.linalg.norm(other.states[-1, :3] - found.states[-1, :3]))
    length = float(rod.many.places[-1])
    lever = length / float(target.reaches.min())
    if play <= max(PLAY * length, LEVERS * lever * target.tolerance):
        return ""
    return f"{what} the tip is {play:.2g} mm elsewhere; give a tendon_stiffness"


# The rod whose tendons have friction: from the state before to the next one.

ROUGH_JUMP = 1e-5
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
            code, _ = shooting.improve(
                pulled.packed_many,
                pulled.many_cuts,
                pulled.unit,
                1.0,
                given.aim(1.0, 0.0),
                (*near.unknowns, near.states),
                near.known,
                EMPTY,
                (ROUGH_JUMP if rough else SMALL_JUMP, 0.0, MOST_STEPS),
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

    goals = target.goals(1.0, 0.0)
    _, low, high = target.bounds
    drive = Drive(
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


Vector = tuple[float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)

PIECES = 0.5
"""Pieces of the shooting by the root of the loads, beside the first."""

FEW_STEPS = 24
"""Steps on which a state is looked for."""

STRONGEST = 1e4
"""Tension at which a command counts as impossible, against one that bends the robot by 1 rad."""

REDUNDANT = 1e-9
"""Share of the largest flexibility below which tendons are redundant."""

EDGE = 1e-9
"""Distance at which a place counts as a step's end [mm]."""

ROUND_OFF = 1e-6
"""Share of a limit that is an error of the solver."""


@dataclass(frozen=True)
class RodModel(ContinuumModel):
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
    shape has not converged and the reason states where it buckles. Loads that turn with the body
    have no potential: they are taken to keep their direction in this.

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
    stretches: bool = field(default=False, kw_only=True)
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
    heeds = frozenset(
        {"weight", "curvature at rest", "stiffness of tendons", "pretension", "tension limits"}
    )
    lets_follow = True
    takes_friction = True
    checked_by_class = ("tip_force", "tip_moment", "distributed_force", "loads", "stretches")

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.checked_by_class[:3]:
            vector = check_points(name, getattr(self, name))
            if vector.shape != (3,):
                raise InputError(f"{name} has shape {vector.shape}: it must be (3,)")
            object.__setattr__(self, name, tuple(vector.tolist()))
        object.__setattr__(self, "loads", check_loads(self.robot, self.loads))
        if not isinstance(self.stretches, bool):
            raise InputError(f"stretches is {self.stretches!r}: it must be true or false")
        if self.stretches and self.robot.tendon_friction.any():
            raise InputError(
                "stretches is true, and tendons have friction: it must be false for such a robot"
            )

    @cached_property
    def arc_length(self) -> Floats:
        """Stations: base, discs, tendon ends and points between [mm], shape (k,)."""
        return place_stations(self.robot, self.between)

    @property
    def natural_lengths(self) -> Floats:
        """Length of each tendon in the straight robot [mm], shape (t,)."""
        return self._rod.many.natural_lengths

    def shape(self, displacements: ArrayLike, *, initial: Shape | None = None) -> Shape:
        """Return the shapes under displacements and the loads; see `ContinuumModel.shape`.

        Parameters
        ----------
        displacements : array_like, shape (..., t)
            How far each tendon is pulled [mm]; one that is NaN follows the robot under its
            pretension, a cable without one is slack.
        initial : Shape, optional
            Where the robot comes from: one shape of this model, or one for each command; the robot
            at rest without tensions unless given. Tendons with friction depend on it, and where
            there are several equilibria the one next to it is taken.
        """
        commands = self._check_commands(displacements)
        return self._solve(commands, self._drive(_rows(commands)), initial)

    def shape_under_tensions(self, tensions: ArrayLike, *, initial: Shape | None = None) -> Shape:
        """Return the shapes under tensions of the tendons at the base, and the loads.

        Parameters
        ----------
        tensions : array_like, shape (..., t)
            Tension of each tendon [N]; 0 or more unless it is a rod that pushes.
        initial : Shape, optional
            Where the robot comes from: one shape of this model, or one for each command; the robot
            at rest without tensions unless given. Tendons with friction depend on it, and where
            there are several equilibria the one next to it is taken.

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
        return self._solve(pulls, self._pull(_rows(pulls)), initial, given=True)

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
        shots = self._trace(initial, self._pull(pulls))
        shapes = self._answer(pulls, self._pull(pulls), shots, given=True)
        return TendonHistory(shapes=shapes, given="tensions")

    def trace_displacements(
        self, history: ArrayLike, *, initial: Shape | None = None
    ) -> TendonHistory:
        """Return the shapes on the way through displacements [mm]; see `trace_tensions`."""
        commands = _check_history(self._check_commands(history))
        shots = self._trace(initial, self._drive(commands))
        shapes = self._answer(commands, self._drive(commands), shots)
        return TendonHistory(shapes=shapes, given="displacements")

    def jacobian(self, shape: Shape, *, held: Held = "displacements") -> ShapeJacobian:
        """Return how the frames of shapes change: the linearised rod, integrated along it.

        Parameters
        ----------
        shape : Shape
            Shapes of this model that have converged.
        held : {"displacements", "tensions"}
            What of the tendons stays where a load or a stiffness changes; displacements hold the
            tendons that have a tension, and the others follow.

        Raises
        ------
        InputError
            If the shape is not one of this model, or tendons have friction: derivatives then
            depend on the direction.
        GeometryError
            If a shape has not converged.
        """
        check_word("held", held, get_args(Held))
        if self._channels is not None:
            raise InputError("tendons have friction: derivatives depend on the direction then")
        self._take_states(shape, ())
        if shape.model != self.name or shape.frames.shape[-3] != len(self.arc_length):
            raise InputError(f"shape is of the {shape.model} model: it must be one of this model")
        shape.require()
        batch = shape.frames.shape[:-3]
        rows = [self._differentiate(shape, index, held) for index in np.ndindex(batch)]
        parts = {
            name: np.stack([row[name] for row in rows]).reshape(*batch, *rows[0][name].shape)
            for name in rows[0]
        }
        return ShapeJacobian(arc_length=self.arc_length, held=held, **parts)

    def _differentiate(self, shape: Shape, index: tuple[int, ...], held: Held) -> dict[str, Floats]:
        """Derivatives of one shape."""
        rod, tendons = self._rod, len(self.robot.tendons)
        parts = len(self.robot.sections)
        tensions = shape.tensions[index]
        start = self._start_at(shape, index)
        if rod.load > 0.0 or rod.shears:
            start = rod.follow(self._aim(np.full(tendons, math.nan), tensions), start, first=1.0)
        owners = self.robot.section_at(rod.many.inner_places[:, 1])
        slopes = np.zeros((12 + tendons, 9 + tendons + 2 * parts))
        slopes[3:9, 3:9] = np.eye(6)
        states = np.zeros_like(start.states)
        states[0, TURN] = 1.0
        states[0, FORCE:MOMENT] = start.states[0, FORCE:MOMENT]
        states[0, MOMENT : MOMENT + 3] = start.moments[0]
        found = np.zeros((len(self.arc_length), 6, slopes.shape[1]))
        stops = np.searchsorted(rod.many.places, self.arc_length - EDGE)
        for station, (first, last) in enumerate(zip(stops[:-1], stops[1:], strict=True), start=1):
            integrate_rod(
                first,
                last,
                rod.packed_many,
                1.0,
                tensions,
                states,
                slopes,
                (owners, parts),
                EMPTY,
            )
            found[station, :3], found[station, 3:] = slopes[:3], slopes[-3:]
        # The loads on the tip fix moment and force at the base.
        ends, lengths = slopes[3:9], slopes[BY_LENGTHS : BY_LENGTHS + tendons]
        solved = np.linalg.solve(ends[:, 3:9], np.hstack([np.eye(6), -ends[:, 9:]]))
        moved = found[..., 3:9] @ solved
        moved[..., 6:] += found[..., 9:]
        longer = lengths[:, 3:9] @ solved
        longer[:, 6:] += lengths[:, 9:]
        by_tension, give = moved[..., 6 : 6 + tendons], longer[:, 6 : 6 + tendons]
        others = [*range(6), *range(6 + tendons, moved.shape[-1])]
        by_others = moved[..., others]
        taut = np.flatnonzero((tensions != 0.0) | self.robot.pushes)
        stiffening = np.zeros((tendons, tendons))
        own = np.ix_(taut, taut)
        stiffening[own] = np.linalg.pinv(
            np.diag(self._compliances[taut]) - give[own], rcond=REDUNDANT
        )
        if held == "displacements":
            by_others = by_others + by_tension @ (stiffening @ longer[:, others])
        return {
            "by_displacement": by_tension @ stiffening,
            "by_tension": by_tension,
            "by_tip_wrench": by_others[..., :6],
            "by_stiffness": by_others[..., 6:].reshape(len(found), 6, parts, 2),
            "tensions_by_displacement": stiffening,
        }

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

    def _check_commands(self, displacements: ArrayLike) -> Floats:
        """Check displacements, of which those that are NaN follow."""
        commands = check_displacements(self.robot, displacements, may_follow=True)
        tense = (self.robot.pretensions > 0.0) & (self._compliances == 0.0)
        held = np.isfinite(_rows(commands)).any(axis=0)
        for index in np.flatnonzero(tense & held):
            raise InputError(
                f"tendon '{self.robot.tendon_names[index]}' has a pretension, and does not stretch:"
                " give it a stiffness, or command tensions"
            )
        return commands

    @cached_property
    def _rod(self) -> Rod:
        loads = pack_loads(
            self.robot,
            self.loads,
            tip_force=self.tip_force,
            tip_moment=self.tip_moment,
            distributed_force=self.distributed_force,
        )
        breaks = list_breaks(self.robot, loads)
        many = RodGrid.cut(self.robot, np.concatenate([self.arc_length, breaks]), self.steps)
        few = many.thin(breaks, FEW_STEPS)
        few = many if len(few.places) == len(many.places) else few
        return Rod(many=many, few=few, loads=loads, shears=self.stretches)

    @cached_property
    def _compliances(self) -> Floats:
        return self.natural_lengths / choose_stiffness(self.robot, self.tendon_stiffness)

    @cached_property
    def _channels(self) -> Channels | None:
        """What holds the tendons in their channels; None without friction."""
        friction = self.robot.tendon_friction
        if not friction.any():
            return None
        return Channels(
            grid=self._rod.many.packed,
            friction=friction,
            flexibility=1.0 / choose_stiffness(self.robot, self.tendon_stiffness),
        )

    def _drive(self, commands: Floats) -> list[Target]:
        """What displacements (b, t) ask of the tendons."""
        tensions = np.broadcast_to(self.robot.pretensions, commands.shape)
        return [self._aim(*rows) for rows in zip(commands, tensions, strict=True)]

    def _pull(self, tensions: Floats) -> list[Target]:
        """What tensions (b, t) ask of the tendons."""
        return [self._aim(np.full(row.shape, math.nan), row) for row in tensions]

    def _aim(self, command: Floats, tensions: Floats) -> Target:
        holds = np.isfinite(command)
        lengths = -command - self._compliances * self.robot.pretensions
        return Target(
            names=self.robot.tendon_names,
            pushes=self.robot.pushes,
            compliances=self._compliances,
            tolerance=self.tolerance,
            reaches=self._rod.many.reaches,
            holds=holds,
            rest=np.where(holds, self.natural_lengths, 0.0),
            change=np.where(holds, lengths, tensions),
            strongest=STRONGEST * self._rod.unit_tension,
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

    def _solve(
        self, commands: Floats, targets: list[Target], initial: Shape | None, *, given: bool = False
    ) -> Shape:
        batch = commands.shape[:-1]
        states = self._take_states(initial, batch)
        starts: list[Shot | None] = [None] * len(targets)
        if initial is not None and self._channels is None:
            own = initial.displacements.shape[:-1]
            starts = [self._start_at(initial, index if own else ()) for index in np.ndindex(batch)]
        shots = [
            self._shoot(target, state, start)
            for target, state, start in zip(targets, states, starts, strict=True)
        ]
        return self._answer(commands, targets, shots, given=given)

    def _trace(self, initial: Shape | None, targets: list[Target]) -> list[Shot]:
        """Shoot one command after the other, each from the one before."""
        (state,) = self._take_states(initial, ())
        start = None
        if initial is not None and self._channels is None:
            start = self._start_at(initial, ())
        shots: list[Shot] = []
        for target in targets:
            shot = self._shoot(target, state, start)
            shots.append(shot)
            if not shot.reason:
                start, state = shot, shot.friction
        return shots

    def _shoot(self, target: Target, state: FrictionState | None, start: Shot | None) -> Shot:
        if self._channels is not None and state is not None:
            return follow_sliding(self._rod, target, self._channels, state, start)
        convex = not self.robot.pushes.any() or self.robot.is_parallel
        return follow(self._rod, target, convex=convex, start=start)

    def _answer(
        self, commands: Floats, targets: list[Target], shots: list[Shot], *, given: bool = False
    ) -> Shape:
        """Shapes of shots; `commands` are displacements, or tensions if `given`."""
        from scipy.spatial.transform import Rotation

        count, rod = len(self.robot.tendons), self._rod
        places, stations = rod.many.places, self.arc_length
        index = np.searchsorted(places, stations - EDGE)
        ends = self.robot.section_ends
        edges = np.searchsorted(places, np.concatenate([[0.0], ends]) - EDGE)
        states = (
            np.stack([shot.states for shot in shots])
            if shots
            else np.zeros((0, len(places), LENGTHS + count))
        )
        frames = np.zeros((len(shots), len(index), 4, 4))
        frames[..., 3, 3] = 1.0
        if shots:
            turns = np.roll(states[:, index, TURN : TURN + 4], -1, axis=-1).reshape(-1, 4)
            frames[..., :3, :3] = (
                Rotation.from_quat(turns).as_matrix().reshape(*frames.shape[:2], 3, 3)
            )
        frames[..., :3, 3] = states[:, index, :3]
        lengths = states[:, -1, LENGTHS:]
        turned = states[:, :, BEND : BEND + 3]
        parts = np.diff(turned[:, edges], axis=1)
        sums = np.stack([parts[..., 1], -parts[..., 0]], axis=-1)
        steps = np.hypot(*np.moveaxis(np.diff(turned[..., :2], axis=1), -1, 0))
        bends = np.add.reduceat(steps, edges[:-1], axis=1)
        curvatures = np.maximum.reduceat(steps / np.diff(places), edges[:-1], axis=1)
        tensions = np.array([shot.tensions for shot in shots]).reshape(len(shots), count)
        if self._channels is None:
            stretched = self._compliances * tensions
        else:
            stretched = np.array(
                [
                    self._channels.stretch(shot.friction.tensions)
                    for shot in shots
                    if shot.friction is not None
                ]
            ).reshape(tensions.shape)
        slack_at_rest = self._compliances * self.robot.pretensions
        if given:
            displacements = self.natural_lengths - lengths
            slack = ~self.robot.pushes & (_rows(commands) == 0.0)
            asked = lengths
        else:
            followed = self.natural_lengths - lengths + stretched - slack_at_rest
            displacements = np.where(np.isnan(_rows(commands)), followed, _rows(commands))
            shares = np.array([shot.share for shot in shots]).reshape(-1, 1)
            limits = self.natural_lengths - shares * (displacements + slack_at_rest)
            loose = (lengths < limits - self.tolerance) | np.isnan(_rows(commands))
            slack = ~self.robot.pushes & loose & (tensions == 0.0)
            asked = self.natural_lengths - displacements - slack_at_rest + stretched
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
            arc_length=stations,
            frames=frames,
            tendon_lengths=lengths,
            section_parameters=sums if self._bends_evenly else sums[:, :0],
            tensions=tensions,
            slack=slack,
            residual=residual,
            iterations=np.asarray([s.iterations for s in shots], dtype=np.int64),
            stability=np.asarray([s.stability for s in shots], dtype=np.float64),
            verdict=check_limits(self.robot, displacements, measure, verdict),
        )
        known = [shot.friction for shot in shots if shot.friction is not None]
        if not known:
            return made
        return dataclasses.replace(made, friction=FrictionState.join(known, commands.shape[:-1]))

    def _start_at(self, initial: Shape, index: tuple[int, ...]) -> Shot:
        """Return a state near to a shape: forces and moments balance the loads on it."""
        from scipy.spatial.transform import Rotation, Slerp

        rod, places = self._rod, self._rod.many.places
        frames = initial.frames[index]
        turns = Slerp(initial.arc_length, Rotation.from_matrix(frames[:, :3, :3]))(places)
        points = np.stack(
            [np.interp(places, initial.arc_length, frames[:, k, 3]) for k in range(3)], axis=1
        )
        (lines, at, _), matrices = rod.packed_many[1], turns.as_matrix()
        middle = 0.5 * (matrices[1:] + matrices[:-1])
        loads = np.diff(places)[:, None] * (
            lines[:, 1, 0] + np.einsum("nij,nj->ni", middle, lines[:, 1, 1])
        )
        own = at[:, :2] + np.einsum("nij,nkj->nki", matrices, at[:, 2:])
        centres = 0.5 * (points[1:] + points[:-1])
        start = rod.rest()
        start.tensions[:] = initial.tensions[index]
        for piece, first in enumerate(rod.many_cuts[:-1]):
            here = points[first]
            start.turns[piece] = np.roll(turns[first].as_quat(), 1)
            later = own[first + 1 :]
            start.forces[piece] = loads[first:].sum(axis=0) + later[:, 0].sum(axis=0)
            start.moments[piece] = (
                np.cross(centres[first:] - here, loads[first:]).sum(axis=0)
                + np.cross(points[first + 1 :] - here, later[:, 0]).sum(axis=0)
                + later[:, 1].sum(axis=0)
            )
        return start

    @cached_property
    def _bends_evenly(self) -> bool:
        plain = self._rod.loads.is_empty and self.robot.is_straight
        return self.robot.is_parallel and self._channels is None and plain


def _check_history(history: Floats) -> Floats:
    if history.ndim != 2 or not len(history):
        raise InputError(
            f"history has shape {history.shape}: it must be (n, {history.shape[-1]}), n at least 1"
        )
    return history


def _rows(array: Floats) -> Floats:
    """Return (..., t) as (b, t), where b or t may be 0."""
    return array.reshape(math.prod(array.shape[:-1]), array.shape[-1])
