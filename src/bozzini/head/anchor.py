"""A head at the tip of a planned scope: what of the wall its instruments reach, and from where."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import (
    check_fields,
    check_integer,
    check_kind,
    check_number,
    check_points,
    floor_mm,
    quantity,
    show_apart,
)
from ..duct.base import Duct
from ..effector.inverse import find_reach, split
from ..errors import InputError
from ..motion.plan import Plan
from ..motion.verify import is_made_from, read_input, rebuild_field
from ..numeric.arrays import Floats
from ..numeric.level_sets import find_level_set
from ..numeric.polylines import carry_frames
from ..progress import Progress, no_progress
from ..results import Json, ReasonedResult, Shown, measured, rows_of, tabulated, take_axes
from ..task import Task
from ..units import parse_vector
from .check import ResultOfRows, head_field
from .design import Head, PlacedEffector, SectionPoses, read_head
from .shape import ROUND_OFF, Capsules, make_camera_chains, make_chains, measure_gaps

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TRACE_STEP = 0.5  # mm along an instrument
_ROLLS = 24
_MOST = 10_000_000  # nodes of the grid round the head, and places of tips, that are looked at
_ZOOMS = 4
"""How often the places round the best one are looked at more closely."""
OUT_OF_REACH, BLOCKED, REACHED = 0, 1, 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Stand(Shown):
    """Where the face of a head stands in the world.

    Attributes
    ----------
    insertion : float
        Arc length of the scope's head along its path [mm].
    origin : (3,) float
        Middle of the face [mm].
    frame : (3, 3) float
        Columns are the head's axes; the third is the way ahead. The others are carried along the
        scope from its tail without twist.
    """

    insertion: float
    origin: Floats
    frame: Floats

    def roll(self, angle: float) -> Floats:
        """Return the axes (3, 3) of the head when it is rolled about its own [rad]."""
        cosine, sine = math.cos(angle), math.sin(angle)
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(self.frame @ turn)


def stand_head(plan: Plan, at: float | None = None) -> Stand:
    """Return where a head stands whose face is the tip of a planned scope.

    Parameters
    ----------
    plan : Plan
        In space. It plans for the scope alone: the head stands beyond its tip.
    at : float, optional
        Arc length of the scope's head along its path [mm]; the farthest by default. Between steps
        joints are taken to move straight.

    Raises
    ------
    InputError
        If the plan is planar, or the scope never gets there.
    """
    check_kind("plan", plan, Plan)
    if plan.joints.shape[2] != 3:
        raise InputError("the plan has 2 dimensions: a head stands in 3")
    stop = int(np.argmax(plan.head_arc_length)) + 1
    heads = np.maximum.accumulate(plan.head_arc_length[:stop])
    low, high = float(heads[0]), float(heads[-1])
    wanted = high if at is None else check_number("insertion", at, unit="mm")
    if not low - 1e-9 <= wanted <= high + 1e-9:
        shown = show_apart(wanted, low, high)
        raise InputError(
            f"insertion is {shown[0]} mm: it must lie in [{shown[1]}, {shown[2]}] mm, where the "
            "plan's scope gets to"
        )
    place = float(np.interp(wanted, heads, np.arange(stop)))
    k = min(int(place), stop - 1)
    after, share = min(k + 1, stop - 1), place - k
    joints = (1.0 - share) * plan.joints[k] + share * plan.joints[after]
    links = -np.diff(joints, axis=0)[::-1]  # from the tail on
    frames = carry_frames(links / np.linalg.norm(links, axis=1, keepdims=True))
    return Stand(insertion=wanted, origin=joints[0], frame=frames[-1])


@dataclass(frozen=True, kw_only=True)
class ReachOptions:
    """How densely a head's reach is looked at.

    Parameters
    ----------
    roll : float, optional
        Of the scope about its own axis [rad], from where it is carried without twist; free if it is
        not given, at 24 angles and closer ones about the best.
    samples : int
        Places of the backbone's end that are tried, all of them reachable; at a free roll so many
        for each.
    tolerance : float
        A place counts as reached if the instrument's tip comes as near [mm].
    spacing : float
        Of the grid on which the wall is looked at [mm].
    """

    roll: float | None = quantity(
        "angle", "Roll of the scope about its axis; free if it is not given.", default=None,
        low=-7.0, high=7.0, example="0 deg",
    )  # fmt: skip
    samples: int = quantity(
        help="Places of the backbone's end.", default=400, low=10, high=100_000, whole=True
    )
    tolerance: float = quantity(
        "length", "How near the tip has to come.", default=1.5, low=0.0, low_open=True, high=20.0
    )
    spacing: float = quantity(
        "length", "Grid on which the wall is looked at.", default=2.0, low=0.25, high=20.0
    )

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def rolls(self) -> Floats:
        """Angles that are looked at [rad]."""
        if self.roll is not None:
            return np.array([self.roll])
        return 2.0 * math.pi * np.arange(_ROLLS) / _ROLLS


@dataclass(frozen=True, eq=False)
class _Lines:
    """Instruments (n) as they slide: from the holder's end on, as far as they get.

    Attributes
    ----------
    start, way : (n, 3)
        World [mm], unit.
    free : (n,)
        How far the tip gets before it meets the wall [mm]; negative where the pose is not free.
    bends : (n, 2)
    rolls : (n,)
    """

    start: Floats
    way: Floats
    free: Floats
    bends: Floats
    rolls: Floats

    def measure(self, place: Floats) -> tuple[Floats, Floats]:
        """Return how near (n,) the tips come to a place, and how far out they are then [mm]."""
        along = ((place - self.start) * self.way).sum(axis=1)
        along = np.clip(along, 0.0, np.maximum(self.free, 0.0))
        away = np.linalg.norm(self.start + along[:, None] * self.way - place, axis=1)
        return np.where(self.free < 0.0, np.inf, away), along


@dataclass(frozen=True, kw_only=True)
class ReachedFrom(Shown):
    """What became of a place that is to be reached, from one insertion.

    Parameters
    ----------
    insertion : float
        [mm]
    miss : float
        How near the tip comes without going through the wall before [mm]: infinite if no pose is
        free, and not looked at where it would not come near enough without walls.
    miss_of_poses : float
        How near it would come without walls [mm].
    effector : int
        Which end-effector comes nearest, from 1.
    roll : float
        Of the scope there [rad].
    deflection_x, deflection_y : float
        Of the backbone's end there, in the section's own frame [mm].
    out : float
        How far the instrument is out there [mm].
    """

    insertion: float = tabulated("mm")
    miss: float = tabulated("mm")
    miss_of_poses: float = tabulated("mm")
    effector: int = tabulated()
    roll: float = tabulated("rad")
    deflection_x: float = tabulated("mm")
    deflection_y: float = tabulated("mm")
    out: float = tabulated("mm")

    @property
    def nearness(self) -> float:
        """How near the tip comes, as far as it was looked at [mm]."""
        return self.miss if math.isfinite(self.miss) else self.miss_of_poses

    @property
    def deflection(self) -> float:
        """Of the backbone's end [mm]."""
        return math.hypot(self.deflection_x, self.deflection_y)


@dataclass(frozen=True, kw_only=True, eq=False)
class HeadReach(ResultOfRows, ReasonedResult):
    """What of the wall a head's instruments reach at the tip of a planned scope.

    Attributes
    ----------
    insertion : float
        The one looked at, or the one from which the target is reached best: with the least
        deflection, or else from which the tip comes nearest [mm].
    head : Head
    stand : Stand
    target : (3,) float or None
        World [mm].
    rows : tuple of ReachedFrom
        The target from each insertion; empty without one.
    pressures : dict
        By muscle, for the target from `insertion` [MPa]; empty if it is not reached.
    miss : float or None
        Distance of the tip from the target [mm].
    vertices, faces : (n, 3) float, (m, 3) int
        The wall round the head, world [mm].
    codes : (n,) int
        Of the vertices: 0 out of reach of all poses; 1 in reach of a pose, but wall or parts are in
        the way; 2 reached.
    area_reached, area_blocked : float
        Of the wall [mm^2].
    free_share : float
        Share of the poses in which neither the wall nor another part is touched.
    notes : tuple of str
    reason : str
        Why the target is not reached; empty if it is, or none was given.
    """

    insertion: float = measured("mm")
    head: Head
    stand: Stand
    target: Floats | None = measured("mm")
    rows: tuple[ReachedFrom, ...] = rows_of(ReachedFrom)
    pressures: dict[str, float]
    miss: float | None = measured("mm")
    vertices: Floats = field(repr=False)
    faces: NDArray[np.int64] = field(repr=False)
    codes: NDArray[np.int64] = field(repr=False)
    area_reached: float = measured("mm2")
    area_blocked: float = measured("mm2")
    free_share: float = measured("")
    notes: tuple[str, ...]
    reason: str

    @property
    def residual(self) -> float:
        """Distance of the tip from the target [mm]; 0 without one."""
        return 0.0 if self.miss is None else self.miss

    @property
    def reached_from(self) -> ReachedFrom | None:
        """How the target is reached from `insertion`; None if it is not, or there is none."""
        rows = () if self.reason else self.rows
        return next((row for row in rows if row.insertion == self.insertion), None)

    def list_columns(self) -> Json:
        """Return the target from each insertion; without one, the wall's places and their codes."""
        if self.rows:
            return dict(super().list_columns())
        places = {f"{axis}_mm": self.vertices[:, k] for k, axis in enumerate("xyz")}
        return {**places, "code": self.codes}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the wall unrolled about the head's axis, coloured by reach, and return the axes."""
        axes = take_axes(ax, x="round the head's axis [deg]", y="ahead of its face [mm]")
        seen = (self.vertices - self.stand.origin) @ self.stand.frame
        around = np.degrees(np.arctan2(seen[:, 1], seen[:, 0]))
        for code, color, label in (
            (OUT_OF_REACH, "0.85", "out of reach"),
            (BLOCKED, "C1", "in reach, something is in the way"),
            (REACHED, "C2", "reached"),
        ):
            own = self.codes == code
            axes.plot(around[own], seen[own, 2], ".", color=color, markersize=3.0, label=label)
        if self.target is not None:
            x, y, z = (self.target - self.stand.origin) @ self.stand.frame
            axes.plot(math.degrees(math.atan2(y, x)), z, "kx", markersize=9.0, label="target")
        axes.set_title(f"insertion {self.insertion:.1f} mm")
        axes.legend(fontsize="x-small", loc="lower right")
        return axes


def find_reached(
    head: Head,
    stands: Stand | Sequence[Stand],
    *,
    duct: Duct,
    target: ArrayLike | None = None,
    options: ReachOptions | None = None,
    progress: Progress = no_progress,
) -> HeadReach:
    """Find what of the wall a head's instruments reach from where it stands.

    A place is reached if a legal pressure of the muscles brings the instrument's line to it, its
    tip meets no wall before, and neither the end-effector nor the camera touch the wall, or each
    other; the camera and other end-effectors also stay clear of the instrument as far as it
    reaches. The instrument slides: its tip is anywhere from the end of the holder to as far as it
    reaches. For the wall its line is looked at, not its thickness; other end-effectors are at rest.

    Parameters
    ----------
    head : Head
    stands : Stand or sequence of Stand
        Where it may stand: the target is looked at from all, the wall from the best. See
        `stand_head`.
    duct : Duct
        The lumen.
    target : array_like, shape (3,), optional
        A place in the world [mm].
    options : ReachOptions, optional
    progress : callable

    Raises
    ------
    InputError
        If there is no stand, the target is not three finite numbers, or the samples or the grid
        would be too many.
    """
    check_kind("head", head, Head)
    check_kind("duct", duct, Duct)
    known = options or ReachOptions()
    check_kind("options", known, ReachOptions)
    goal = None if target is None else check_points("target", target)
    if goal is not None and goal.shape != (3,):
        raise InputError(f"target has shape {goal.shape}: it must be (3,)")
    places = [stands] if isinstance(stands, Stand) else list(stands)
    if not places:
        raise InputError("there is no stand: give one or more")
    _check_size(head, known)
    poses = [placed.shape(placed.list_bends(known.samples)) for placed in head.effectors]
    rows = []
    if goal is not None:
        for k, stand in enumerate(places):
            rows.append(_reach_target(_Search(head, stand, duct), goal, poses, known))
            progress("insertions", (k + 1) / len(places))
    best = _choose_best(rows, known.tolerance)
    stand = places[best]
    search = _Search(head, stand, duct)
    lines = [search.trace(k, pose, known.rolls) for k, pose in enumerate(poses)]
    vertices, faces = _find_wall(stand, duct, head.length, known.spacing)
    codes = _color_wall(vertices, head, lines, known.tolerance)
    share = codes[faces]
    sides = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    areas = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    row = rows[best] if rows else None
    reached = row is not None and row.miss <= known.tolerance
    free = np.concatenate([line.free >= 0.0 for line in lines])
    return HeadReach(
        insertion=stand.insertion,
        head=head,
        stand=stand,
        target=goal,
        rows=tuple(rows),
        pressures=_find_pressures(head, row) if reached and row else {},
        miss=None if row is None else row.nearness,
        vertices=vertices,
        faces=faces,
        codes=codes,
        area_reached=float((areas * (share == REACHED).mean(axis=1)).sum()),
        area_blocked=float((areas * (share == BLOCKED).mean(axis=1)).sum()),
        free_share=float(free.mean()),
        notes=(),
        reason="" if row is None or reached else _explain(row, known),
    )


def _check_size(head: Head, options: ReachOptions) -> None:
    """Raise `InputError` if more would be looked at than fits in memory."""
    longest = max(head.effectors, key=lambda placed: placed.instrument.reach)
    rolls = len(options.rolls)
    most = _MOST // (rolls * _count_steps(longest))
    if options.samples > most:
        raise InputError(
            f"samples is {options.samples}: it must be at most {most} for {rolls} rolls and an "
            f"instrument of {longest.instrument.reach:g} mm"
        )
    finest = head.length * (4.0 / _MOST) ** (1.0 / 3.0)
    if options.spacing < finest:
        raise InputError(
            f"spacing is {options.spacing:g} mm: it must be at least {finest:.2g} mm for a head "
            f"that reaches {head.length:g} mm"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Touches(Shown):
    """Places (n) at which an instrument's tip meets the wall, with nothing in the way.

    Attributes
    ----------
    place : (n, 3) float
        World [mm].
    bends : (n, 2) float
        Of the backbone's end there, in the section's own frame [mm].
    out : (n,) float
        How far the instrument is out there [mm].
    """

    place: Floats
    bends: Floats
    out: Floats

    def choose(self, count: int) -> Touches:
        """Return so many, far from each other: each the farthest from those before it.

        Raises
        ------
        InputError
            If there are fewer.
        """
        count = check_integer("targets", count, low=1, high=100)
        if len(self.place) < count:
            raise InputError(
                f"targets is {count}: the instrument touches the wall at {len(self.place)} of the "
                "places looked at; stand where more wall is in reach, or give fewer"
            )
        away = np.linalg.norm(self.place - self.place.mean(axis=0), axis=1)
        chosen = [int(np.argmin(away))]
        far = np.full(len(away), np.inf)
        while len(chosen) < count:
            apart = np.linalg.norm(self.place - self.place[chosen[-1]], axis=1)
            far = np.minimum(far, apart)
            chosen.append(int(np.argmax(far)))
        return Touches(place=self.place[chosen], bends=self.bends[chosen], out=self.out[chosen])


def list_insertions(plan: Plan, *, step: float) -> list[float]:
    """Return insertions of a plan from its first to its farthest, so far apart [mm]."""
    return [*np.arange(float(plan.head_arc_length[0]), plan.inserted, step).tolist(), plan.inserted]


def list_touches(
    head: Head, stand: Stand, *, duct: Duct, number: int = 1, samples: int = 400
) -> Touches:
    """Return where an end-effector's instrument meets the wall, of so many poses; others rest.

    See `find_reached` for what is in the way; the roll is 0.

    Raises
    ------
    InputError
        If there is no such end-effector, or `samples` is outside [10, 100000].
    """
    check_kind("head", head, Head)
    check_kind("duct", duct, Duct)
    samples = check_integer("samples", samples, low=10, high=100_000)
    placed = head.get_effector(number)
    poses = placed.shape(placed.list_bends(samples))
    lines = _Search(head, stand, duct).trace(number - 1, poses, np.zeros(1))
    own = (lines.free > 0.0) & (lines.free < placed.instrument.reach)
    out = lines.free[own]
    return Touches(
        place=lines.start[own] + out[:, None] * lines.way[own], bends=lines.bends[own], out=out
    )


@dataclass(frozen=True, eq=False)
class _Search:
    """A head on a stand, in a lumen; without one, as if there were no walls."""

    head: Head
    stand: Stand
    duct: Duct | None

    def trace(self, index: int, poses: SectionPoses, rolls: Floats) -> _Lines:
        """Return an instrument's lines of all poses at all rolls."""
        placed = self.head.effectors[index]
        count, size = len(poses.bends), len(rolls)
        frames = np.stack([self.stand.roll(angle) for angle in rolls])

        def place(points: Floats) -> Floats:
            """Return points (n, k, 3) of the head's frame in the world (r, n, k, 3)."""
            return np.asarray(self.stand.origin + np.einsum("rij,nkj->rnki", frames, points))

        start = place(poses.holder_tip[:, None])[:, :, 0]
        way = np.einsum("rij,nj->rni", frames, poses.direction)
        free = np.full((size, count), placed.instrument.reach)
        if self.duct is not None:
            others = _list_others(self.head, index)
            own = make_chains(placed, poses)
            apart = measure_gaps(own, others)[:, 0] >= -ROUND_OFF
            clear = np.broadcast_to(apart, free.shape).copy()
            for chain in (*others, own[0]):
                middles = 0.5 * (chain.lines[:, 1:] + chain.lines[:, :-1])
                points = place(np.concatenate([chain.lines, middles], axis=1))
                clear &= (self.duct.signed_distance(points) <= -chain.radius).all(axis=-1)
            steps = np.linspace(0.0, placed.instrument.reach, _count_steps(placed))
            free[clear] = find_wall_along(self.duct, start[clear], way[clear], steps)
            free[~clear] = -1.0
        return _Lines(
            start=start.reshape(-1, 3),
            way=way.reshape(-1, 3),
            free=free.ravel(),
            bends=np.tile(poses.bends, (size, 1)),
            rolls=np.repeat(rolls, count),
        )

    def find_nearest(
        self, index: int, poses: SectionPoses, goal: Floats, options: ReachOptions
    ) -> ReachedFrom:
        """Return the pose whose tip comes nearest to a place: first of all, then beside it."""
        placed = self.head.effectors[index]
        known = find_reach(placed.effector)
        width = math.sqrt(float(np.prod(np.ptp(poses.bends, axis=0))) / len(poses.bends))
        turn = math.pi / _ROLLS
        rolls = options.rolls
        least, roll, bend, out = math.inf, 0.0, np.zeros(2), 0.0
        for zoom in range(_ZOOMS + 1):
            lines = self.trace(index, poses, rolls)
            miss, along = lines.measure(goal)
            k = int(np.argmin(miss))
            if miss[k] < least:
                least, roll, bend, out = miss[k], lines.rolls[k], lines.bends[k], along[k]
            if not math.isfinite(least):
                break
            half = width / 3.0**zoom
            side = half * np.linspace(-1.0, 1.0, 7)
            near = bend + np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
            near = near[split(known.sectors, near, known.amplitudes, known.peak).reachable]
            poses = placed.shape(np.concatenate([near, bend[None]]))
            if options.roll is None:
                rolls = roll + turn / 3.0**zoom * np.linspace(-1.0, 1.0, 5)
        return ReachedFrom(
            insertion=self.stand.insertion,
            miss=math.inf if self.duct is None else float(least),
            miss_of_poses=float(least),
            effector=index + 1,
            roll=math.remainder(roll, math.tau),
            deflection_x=float(bend[0]),
            deflection_y=float(bend[1]),
            out=float(out),
        )


def _count_steps(placed: PlacedEffector) -> int:
    return max(2, math.ceil(placed.instrument.reach / _TRACE_STEP) + 1)


def _list_others(head: Head, index: int) -> tuple[Capsules, ...]:
    """Return the camera, and the other end-effectors at rest, their instruments drawn in."""
    others = [
        make_chains(placed, placed.shape(np.zeros((1, 2))))[0]
        for k, placed in enumerate(head.effectors)
        if k != index
    ]
    return (*make_camera_chains(head), *others)


def find_wall_along(duct: Duct, start: Floats, way: Floats, steps: Floats) -> Floats:
    """Return how far (n,) lines get before the wall [mm]; negative where they start beyond it."""
    if not len(start):
        return np.empty(0)
    away = duct.signed_distance(start[:, None] + steps[:, None] * way[:, None])
    beyond = away > 0.0
    first = np.argmax(beyond, axis=1)
    rows, last = np.arange(len(start)), np.maximum(first - 1, 0)
    inside, outside = away[rows, last], away[rows, first]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(outside > inside, -inside / (outside - inside), 0.0)
    met = steps[last] + share * (steps[first] - steps[last])
    return np.where(beyond[:, 0], -1.0, np.where(beyond.any(axis=1), met, steps[-1]))


def _reach_target(
    search: _Search, goal: Floats, poses: Sequence[SectionPoses], options: ReachOptions
) -> ReachedFrom:
    """Return how near a place all end-effectors come from one stand."""
    found = []
    for k, own in enumerate(poses):
        row = replace(search, duct=None).find_nearest(k, own, goal, options)
        if row.miss_of_poses <= options.tolerance:
            walled = search.find_nearest(k, own, goal, options)
            row = replace(walled, miss_of_poses=min(row.miss_of_poses, walled.miss))
        found.append(row)
    return min(found, key=lambda row: (row.miss, row.miss_of_poses))


def _choose_best(rows: Sequence[ReachedFrom], tolerance: float) -> int:
    """Return the insertion from which a target is reached best; 0 without a target."""

    def rank(k: int) -> tuple[bool, float]:
        missed = rows[k].miss > tolerance
        return missed, rows[k].nearness if missed else rows[k].deflection

    return min(range(len(rows)), key=rank, default=0)


def _find_pressures(head: Head, row: ReachedFrom) -> dict[str, float]:
    effector = head.effectors[row.effector - 1].effector
    found = effector.inverse([row.deflection_x, row.deflection_y])
    return dict(zip(effector.design.names, found.pressures.tolist(), strict=True))


def _find_wall(
    stand: Stand, duct: Duct, reach: float, spacing: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the wall round a head as triangles, world [mm], by distances on a grid of its own."""
    side = spacing * np.arange(-math.ceil(reach / spacing) - 1, math.ceil(reach / spacing) + 2)
    ahead = side[side >= -2.0 * spacing]
    nodes = np.stack(np.meshgrid(side, side, ahead, indexing="ij"), axis=-1)
    values = duct.signed_distance(stand.origin + nodes @ stand.frame.T)
    vertices, faces = find_level_set(values.astype(np.float32))
    first = np.array([side[0], side[0], ahead[0]])
    return stand.origin + (first + spacing * vertices) @ stand.frame.T, faces


def _color_wall(
    vertices: Floats, head: Head, lines: Sequence[_Lines], tolerance: float
) -> NDArray[np.int64]:
    """Return whether places of the wall are out of reach, blocked or reached."""
    from scipy.spatial import cKDTree

    codes = np.full(len(vertices), OUT_OF_REACH)
    for placed, own in zip(head.effectors, lines, strict=True):
        steps = np.linspace(0.0, placed.instrument.reach, _count_steps(placed))
        tips = own.start[:, None] + steps[:, None] * own.way[:, None]
        free = np.minimum(steps, np.maximum(own.free, 0.0)[:, None])
        stopped = own.start[:, None] + free[..., None] * own.way[:, None]
        for code, places in ((BLOCKED, tips), (REACHED, stopped[own.free >= 0.0])):
            tree = cKDTree(places.reshape(-1, 3))
            away, _ = tree.query(vertices, distance_upper_bound=tolerance)
            codes[away <= tolerance] = np.maximum(codes[away <= tolerance], code)
    return codes


def read_lumen(plan: Plan, tract: str, progress: Progress) -> Duct:
    """Return the lumen that a plan was made in, from the file of its tract.

    Raises
    ------
    InputError
        If the plan was not made from that.
    """
    if is_made_from(plan, tract) is False:
        raise InputError(f"{tract} is not the file that the plan was made from")
    duct = rebuild_field(plan, read_input(plan, tract), progress=progress)
    outside = float(duct.signed_distance(plan.path).max())
    if outside > duct.error:
        raise InputError(
            f"{tract} is not what the plan was made from: its path leaves the lumen by "
            f"{outside:.1f} mm"
        )
    return duct


def _list_notes(head: Head, plan: Plan) -> tuple[str, ...]:
    notes = []
    if plan.scope is not None and plan.scope.diameter < head.diameter:
        notes.append(
            f"the plan is for a scope of {plan.scope.diameter:g} mm, the head is "
            f"{head.diameter:g} mm across: plan for that"
        )
    if plan.inflation > 0.0:
        notes.append(f"the wall is moved outwards by {plan.inflation:g} mm, as in the plan")
    return tuple(notes)


def _explain(row: ReachedFrom, options: ReachOptions) -> str:
    if row.miss_of_poses > options.tolerance:
        return (
            f"the target is out of reach: the tip comes as near as {row.miss_of_poses:.1f} mm, "
            f"from {row.insertion:.1f} mm of insertion"
        )
    near = f"to {row.miss:.1f} mm" if math.isfinite(row.miss) else "nowhere"
    return (
        f"the target is in reach of a pose from {row.insertion:.1f} mm of insertion, but the wall "
        f"or another part is in the way: without touching it the tip comes {near}"
    )


@dataclass(frozen=True, kw_only=True)
class HeadReaching(Task):
    """Tell what of the wall a distal head reaches at the tip of a planned scope.

    PLAN is a plan's .npz, TRACT the file that it was made from. The head's face stands at the
    scope's tip, and the head beyond it. With --target all insertions are looked at, --step apart,
    for the one from which the target is reached with the least deflection; with --at only that one.
    A picture is the wall there, unrolled, and a page the same in 3-D with the head; a table has the
    target from each insertion, or else the wall's places: 0 out of reach, 1 something is in the
    way, 2 reached.

    Exit code 0: the target is reached, or none was given; 1: it is not; 2: bad input.
    """

    name = "reach"
    group = "head"
    result = HeadReach
    has_page = True

    plan: str = quantity("file", "A plan (.npz).")
    tract: str = quantity("file", "The file that it was made from.")
    head: str | None = head_field()
    at: float | None = quantity(
        "length", "How far the scope is inserted; its farthest without a target.", default=None,
        low=0.0, high=1e6, example="412 mm",
    )  # fmt: skip
    target: str | None = quantity(
        "text", "A place to reach: X,Y,Z with units.", default=None, example="12mm,-5mm,0mm"
    )
    step: float = quantity(
        "length", "Between insertions that are looked at.", default=5.0, low=0.1, high=1e3
    )
    options: ReachOptions

    def run(self, progress: Progress = no_progress) -> HeadReach:
        """Return what is reached."""
        goal = None if self.target is None else parse_vector(self.target, "length")
        head, plan = read_head(self.head), Plan.load(self.plan)
        every = self.at is None and self.target is not None
        insertions = list_insertions(plan, step=self.step) if every else [self.at]
        stands = [stand_head(plan, at) for at in insertions]
        duct = read_lumen(plan, self.tract, progress)
        found = find_reached(
            head, stands, duct=duct, target=goal, options=self.options, progress=progress
        )
        return replace(found, notes=_list_notes(head, plan))

    def describe(self, found: HeadReach) -> str:
        """Return what is reached, and how."""
        lines = [
            f"At {found.insertion:.1f} mm of insertion {found.area_reached / 100.0:.1f} cm^2 of "
            f"the wall are reached; {found.area_blocked / 100.0:.1f} cm^2 more are in reach, but "
            "something is in the way",
            f"In {100.0 * found.free_share:.0f} % of the poses nothing touches; the roll is "
            f"{'free' if self.options.roll is None else 'given'}",
        ]
        row = found.reached_from
        if row is not None:
            count = sum(each.miss <= self.options.tolerance for each in found.rows)
            given = ", ".join(f"{k} {1e3 * p:.0f} kPa" for k, p in found.pressures.items())
            lines.append(
                f"The target is reached to {row.miss:.2f} mm by end-effector {row.effector}, "
                f"{floor_mm(row.out, 1)} mm out, at a roll of {math.degrees(row.roll):.0f} deg: "
                f"{given}; from {count} of {len(found.rows)} insertions in all"
            )
        lines += [f"Note: {note}" for note in found.notes]
        return "\n".join([*lines, *filter(None, [found.reason])])
