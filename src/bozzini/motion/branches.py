"""How far a scope comes into every branch of a lumen, certified, and near which targets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ..anatomy.tract import Finding
from ..checks import ceil_mm, check_fields, check_kind, floor_mm, quantity
from ..duct import Centreline
from ..duct.base import Duct, SampledField
from ..duct.tree import LumenTree
from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.polylines import interpolate_polyline, measure_arc_length
from ..progress import Progress, no_progress
from ..results import (
    Json,
    ReasonedResult,
    Shown,
    list_row,
    measured,
    rows_of,
    tabulated,
    take_axes,
    to_plain,
)
from .approach import Approach, describe_routes
from .plan import Plan
from .planner import make_planner
from .planners import PlannerOptions
from .scope import Scope
from .space import FreeSpace, grid_of
from .tube import MARGINS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..continuum import ContinuumRobot

Stop = Literal["", "diameter", "link", "bend", "angle", "length", "proof", "robot"]

STOPS: dict[str, Stop] = {
    "ENTRY_CLEARANCE": "diameter",
    "GOAL_CLEARANCE": "diameter",
    "HEAD_CLEARANCE": "diameter",
    "NO_PASSAGE": "diameter",
    "LINK_TOO_LONG": "link",
    "LIMBS_JOINED": "link",
    "FOLD": "bend",
    "ANGLE": "angle",
    "SCOPE_TOO_SHORT": "length",
    "CERTIFICATE_UNRESOLVED": "proof",
}
"""What stops a scope, by the code of a refusal."""

STOP_COLORS: dict[Stop, str] = {
    "diameter": "C3", "link": "C1", "bend": "C2", "angle": "C4", "length": "C8", "proof": "C6",
    "robot": "C9",
}  # fmt: skip
"""Of the marks in a picture, by what stops a scope."""

PANELS = 5
"""So many scopes have their tree in a picture."""

NEEDLE = 20.0
"""How far a biopsy needle reaches from the tip [mm]."""

MARGIN = MARGINS[-1] + 0.05
"""Clearance beyond its radius that a scope needs at its head: the planner's, and as much again that
an independent check of the certificate needs [mm]."""

END = 1.0
"""A branch is passed, or reached to its end, if no more than this of it is left [mm]."""

PLACES = 20_000
"""Places of the organ round a tree at which the share of its volume is counted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TreeReachOptions(Shown):
    """How scopes are tried in a tree.

    Parameters
    ----------
    planner : PlannerOptions
        As for `plan_insertion`; what would fit is not sought.
    robot : ContinuumRobot, optional
        That has to follow each motion; where it cannot, it stops.
    up : (3,) float
        What is up in the camera's picture at the root, world frame.
    needle : float
        How far a needle reaches from the scope [mm].
    """

    planner: PlannerOptions = field(default_factory=PlannerOptions)
    robot: ContinuumRobot | None = None
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    needle: float = quantity("length", low=0.0, high=1e3, default=NEEDLE)

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, eq=False)
class BranchWay:
    """The motion of a scope from the root towards one end of a tree, as far as it is certified.

    Attributes
    ----------
    depth : float
        How far the head gets along the centreline from the root [mm].
    plan : Plan or None
        The motion; None where the scope does not enter.
    stop : str
        What stops it: the lumen's width against the ``diameter``, the ``link``'s length, a
        ``bend`` in which the scope would fold, the limit of a joint's ``angle``, the scope's
        ``length``, the ``proof``, or what the ``robot`` can do; empty at the end of the branch.
    needs, offers : float or None
        Clearance of the scope's axis that is needed and that there is at that place [mm].
    reason : str
    branch : int
        Number of the end's branch.
    """

    depth: float
    plan: Plan | None
    stop: Stop = ""
    needs: float | None = None
    offers: float | None = None
    reason: str = ""
    branch: int = 0

    @property
    def clearance(self) -> float:
        """Certified clearance of the whole motion [mm]; NaN without one."""
        proved = None if self.plan is None else self.plan.proved
        return math.nan if proved is None else proved


@dataclass(frozen=True, kw_only=True)
class BranchReach:
    """How far a scope comes into one branch.

    Parameters
    ----------
    diameter, link : float
        Of the scope [mm].
    branch : str
        Its name.
    anatomy : str
        What it is called in anatomy, if that is known.
    generation : int
    length : float
        Of the branch [mm].
    reached : float
        How much of it the scope's head gets along [mm].
    depth : float
        The same from the root of the tree [mm].
    clearance : float
        Certified clearance of the motion that gets there [mm]; NaN where none enters.
    stop : str
        What stops it in or before this branch, see `BranchWay`; empty if it is passed.
    reason : str
    route : str
        Which way to take at each branching, as the scope's camera sees it.
    """

    diameter: float = tabulated("mm")
    link: float = tabulated("mm")
    branch: str = tabulated()
    anatomy: str = tabulated()
    generation: int = tabulated()
    length: float = tabulated("mm")
    reached: float = tabulated("mm")
    depth: float = tabulated("mm")
    clearance: float = tabulated("mm")
    stop: Stop = tabulated()
    reason: str = tabulated()
    route: str = tabulated()

    @property
    def passed(self) -> bool:
        """Whether the head comes into it, and to its end."""
        return self.reached > 0.0 and self.reached >= self.length - END


@dataclass(frozen=True, kw_only=True)
class ScopeReach:
    """What of a tree one scope reaches.

    Parameters
    ----------
    diameter, link : float
        Of the scope [mm].
    entered, passed : float
        Share of the branches whose beginning, and whose end, the head comes beyond and to.
    ends : float
        Share of the ends of the tree that are reached; NaN without any.
    length : float
        Share of the length of all branches.
    volume : float
        Share of the organ: of the convex hull of the tree beyond its first branching, every place
        of which belongs to the nearest place of the tree.
    near : float
        Share of that organ within a needle's reach of where the scope gets to.
    generation : int
        The highest that is entered.
    depth : float
        The largest, from the root [mm].
    clearance : float
        The smallest that is certified of a motion [mm]; NaN without one.
    """

    diameter: float = tabulated("mm")
    link: float = tabulated("mm")
    entered: float = tabulated()
    passed: float = tabulated()
    ends: float = tabulated()
    length: float = tabulated()
    volume: float = tabulated()
    near: float = tabulated()
    generation: int = tabulated()
    depth: float = tabulated("mm")
    clearance: float = tabulated("mm")


@dataclass(frozen=True, kw_only=True, eq=False)
class TreeReach(ReasonedResult):
    """How far scopes come into every branch of a tree.

    Attributes
    ----------
    tree : LumenTree
    scopes : tuple of ScopeReach
        What each scope reaches.
    rows : tuple of BranchReach
        Every branch for every scope.
    ways : tuple of tuple of BranchWay
        For every scope one to each tip of the tree; tips behind the same stop share it.
    approaches : tuple of Approach
        To a target, the shortest needle first; empty without one.
    ends, volume, near : float
        Shares that the first scope reaches, see `ScopeReach`.
    depth : float
        The largest of the first scope [mm].
    needle_needed : float or None
        The shortest to the target, of any scope [mm]; None without a target, or a way to it.
    reason : str
        Why no scope enters; empty otherwise.
    findings : tuple of Finding
        What is odd about the tree, or a target's place.
    """

    tree: LumenTree
    scopes: tuple[ScopeReach, ...]
    rows: tuple[BranchReach, ...] = rows_of(BranchReach)
    ways: tuple[tuple[BranchWay, ...], ...] = field(repr=False)
    approaches: tuple[Approach, ...] = ()
    ends: float = measured("")
    volume: float = measured("")
    near: float = measured("")
    depth: float = measured("mm")
    needle_needed: float | None = measured("mm")
    reason: str = ""
    findings: tuple[Finding, ...] = ()

    @property
    def residual(self) -> float:
        """Nothing is left over: every motion is certified, or its depth is 0."""
        return 0.0

    def to_dict(self) -> Json:
        """Return plain values with units in their names."""
        return {
            "converged": self.converged,
            "reason": self.reason,
            "ends": self.ends,
            "volume": self.volume,
            "near": self.near,
            "depth_mm": self.depth,
            "needle_needed_mm": self.needle_needed,
            "scopes": [list_row(each) for each in self.scopes],
            "branches": [list_row(each) for each in self.rows],
            "approaches": [list_row(each) for each in self.approaches],
            "findings": [to_plain(asdict(each)) for each in self.findings],
        }

    def list_columns(self) -> Json:
        """Return the columns of the table; with a target also the way from each branch to it."""
        columns: Json = dict(super().list_columns())
        if self.approaches:
            found = {(each.diameter, each.branch): each for each in self.approaches}
            near = [found.get((row.diameter, row.branch)) for row in self.rows]
            for name, column in (
                ("depth", "needle_depth_mm"), ("needle", "needle_mm"),
                ("angle", "needle_angle_rad"), ("vessels", "needle_vessels_mm"),
            ):  # fmt: skip
                columns[column] = [getattr(each, name, None) for each in near]
        return columns

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the tree laid flat as far as each scope gets, and the shares by generation.

        There is a panel for each scope, of many for the first `PANELS`, and one for the shares of
        all. Axes that are given take the tree of the first scope. The last axes are returned.
        """
        if ax is not None:
            return self._draw_tree(ax, 0)
        from matplotlib.figure import Figure

        count = min(len(self.scopes), PANELS)
        rows = count // 2 + 1
        figure = Figure(figsize=(12.8, 4.8 * rows), layout="constrained")
        panels = figure.subplots(rows, 2).ravel()
        for number, panel in enumerate(panels[:count]):
            self._draw_tree(panel, number)
        for panel in panels[count + 1 :]:
            panel.remove()
        return self._draw_shares(panels[count])

    def _draw_tree(self, ax: Axes, number: int) -> Axes:
        """Draw the tree as far as a scope gets, with a mark in the colour of what stops it."""
        count = len(self.tree.branches)
        rows = self.rows[number * count : (number + 1) * count]
        self.tree.plot(ax, reached=[row.reached for row in rows])
        stopped = [
            (row.stop, self.tree.columns[k], row.depth)
            for k, row in enumerate(rows)
            if row.stop and (row.reached > 0.0 or row.generation == 0)
        ]
        for stop, color in STOP_COLORS.items():
            places = np.array([place for what, *place in stopped if what == stop])
            if len(places):
                ax.plot(*places.T, "v", color=color, markersize=4, label=stop)
        if stopped:
            ax.legend(title="stopped by")
        ax.set_title(f"{self.scopes[number].diameter:g} mm")
        return ax

    def _draw_shares(self, ax: Axes) -> Axes:
        """Draw how far each scope gets into each branch, by generation."""
        take_axes(ax, x="generation", y="share of the length that is reached")
        highest = max(row.generation for row in self.rows)
        for scope in self.scopes:
            own = [row for row in self.rows if row.diameter == scope.diameter]
            shares = []
            for generation in range(highest + 1):
                there = [row for row in own if row.generation == generation]
                whole = sum(row.length for row in there)
                shares.append(sum(row.reached for row in there) / whole if whole else math.nan)
            ax.plot(range(highest + 1), shares, "o-", label=f"{scope.diameter:g} mm")
        ax.set_ylim(-0.02, 1.02)
        ax.legend(title="diameter")
        return ax


def find_ways(
    duct: Duct,
    tree: LumenTree,
    *,
    scope: Scope,
    options: TreeReachOptions | None = None,
    progress: Progress = no_progress,
) -> tuple[BranchWay, ...]:
    """Plan a scope's motion from the root of a tree towards each of its tips.

    The head gets along the centreline until the lumen is too narrow for it, if a certified motion
    to there is found; else as far as one is. Ends that lie behind the same place share the motion.

    Parameters
    ----------
    duct : Duct
        The lumen.
    tree : LumenTree
        Of that lumen.
    scope : Scope
    options : TreeReachOptions, optional
    progress : Progress

    Raises
    ------
    InputError
        If an option is not legal.
    """
    check_kind("tree", tree, LumenTree)
    check_kind("scope", scope, Scope)
    options = options or TreeReachOptions()
    planning = replace(options.planner, advise=False)
    make_planner("tube").check(scope, planning)
    free = _find_free(duct, scope.radius + MARGIN)
    known: dict[tuple[float, ...], tuple[int, BranchWay]] = {}
    ways = []
    for number, end in enumerate(tree.tips):
        progress("reach", number / len(tree.tips))
        line = tree.path(end)
        tries = _find_last(duct, line, free)
        place = tuple(line.points[max(tries[0], 0)].tolist())
        if place not in known:
            last, way = tries[0], _plan_way(duct, line, tries[0], scope=scope, options=planning)
            if way.depth < line.arc_length[max(tries[-1], 0)]:
                other = _plan_way(duct, line, tries[-1], scope=scope, options=planning)
                if other.depth > way.depth:
                    last, way = tries[-1], other
            way = way if options.robot is None else _follow(way, options.robot, duct, line)
            known[place] = last, way
        last, way = known[place]
        if way.stop == "diameter" and not way.reason:
            way = _tell_narrow(way, duct, line, last, free.needs)
        ways.append(replace(way, branch=end))
    progress("reach", 1.0)
    return tuple(ways)


@dataclass(frozen=True, eq=False)
class _Free:
    """Where a scope's axis may be: the clearance it needs, and the connected parts of nodes."""

    needs: float
    grid: SampledField | None
    parts: NDArray[np.int32]


def _find_free(duct: Duct, needs: float) -> _Free:
    from scipy import ndimage

    grid = grid_of(duct)
    if grid is None:
        return _Free(needs, None, np.zeros(0, dtype=np.int32))
    parts, _ = ndimage.label(grid.inflation - grid.values >= needs, structure=np.ones((3, 3, 3)))
    return _Free(needs, grid, parts)


def _find_last(duct: Duct, line: Centreline, free: _Free) -> list[int]:
    """Return the last points of a line that a scope may come to, the farther one first.

    The lumen is wide enough along the line up to the second. The line may be less clear than the
    middle of the lumen is, where branches part: up to the first a way beside it is wide enough.
    """
    wide = np.asarray(duct.clearance_bound(line.points)) >= free.needs
    straight = (len(wide) if wide.all() else int(np.argmin(wide))) - 1
    if free.grid is None or straight < 0 or straight == len(wide) - 1:
        return [straight]
    nodes = np.rint(free.grid.to_grid(line.points) / free.grid.spacing).astype(int)
    nodes = np.clip(nodes, 0, np.array(free.parts.shape) - 1)
    marks = free.parts[tuple(nodes.T)]
    joined = np.flatnonzero(wide & (marks == marks[straight]) & (marks > 0))
    farthest = int(joined[-1]) if len(joined) else straight
    return [straight] if farthest <= straight else [farthest, straight]


def _follow(way: BranchWay, robot: ContinuumRobot, duct: Duct, line: Centreline) -> BranchWay:
    """Return a way as far as a robot can follow it, certified."""
    from .actuate.actuate import actuate_plan

    if way.plan is None:
        return way
    driven = actuate_plan(way.plan, robot, duct)
    if driven.reason_code in ("", "PLAN_STOPPED"):
        return way
    arc = float(driven.head_arc_length[-1])
    tip = interpolate_polyline(way.plan.path, way.plan.path_arc_length, np.array([arc]))[0]
    near = int(np.argmin(np.linalg.norm(line.points - tip, axis=1)))
    depth = float(line.arc_length[near]) if len(driven.head_arc_length) > 1 else 0.0
    return replace(
        way,
        depth=min(depth, way.depth),
        stop="robot",
        needs=None,
        offers=None,
        reason=driven.reason,
    )


def _plan_way(
    duct: Duct, line: Centreline, last: int, *, scope: Scope, options: PlannerOptions
) -> BranchWay:
    """Plan along a line up to its point `last`, beyond which it is too narrow for the scope.

    Of a motion to there the reason is left out: see `_tell_narrow`.
    """
    whole = last == len(line.points) - 1
    wide = float(line.arc_length[max(last, 0)])
    if last >= 1 and wide < scope.link_length:
        link = f"a link of {scope.link_length:g} mm is longer than the way, {wide:.1f} mm"
        return BranchWay(0.0, None, "link", None, None, link)
    if last < 1:
        return BranchWay(0.0, None, "diameter")
    cut = line if whole else line.cut(wide)
    space, planner = FreeSpace(duct, cut), make_planner("tube")
    plan = planner.plan(space, scope, options=options)
    if scope.length is None and plan.path_arc_length[-1] > plan.links * scope.link_length:
        # The path is longer than the line: so must the scope be.
        longer = float(plan.path_arc_length[-1]) + 2.0 * scope.link_length
        plan = planner.plan(space, replace(scope, length=longer), options=options)
    plan = replace(plan, centreline=cut)
    refusal = plan.refusal
    if refusal is None:
        return BranchWay(cut.length, plan, "" if whole else "diameter")
    depth = refusal.at if refusal.ends_at is None else refusal.ends_at
    moved = plan if plan.steps > 1 and plan.certified else None
    depth = 0.0 if moved is None else depth
    code = refusal.ends_code or refusal.code
    reason = refusal.ends_what or refusal.reason
    stop = STOPS.get(code, "proof")
    return BranchWay(depth, moved, stop, refusal.needs, refusal.offers, reason)


def _tell_narrow(
    way: BranchWay, duct: Duct, line: Centreline, last: int, needs: float
) -> BranchWay:
    """Return a way with why a line is too narrow beyond its point `last`.

    Ends that share the way part there: what a scope is offered is that of each.
    """
    offers = float(duct.clearance_bound(line.points[min(last + 1, len(line.points) - 1)]))
    at = tuple(round(float(x), 1) for x in line.points[max(last, 0)])
    reason = (
        f"the lumen is too narrow beyond {line.arc_length[max(last, 0)]:.1f} mm, near {at} mm: the "
        f"scope needs {ceil_mm(needs)} mm from its axis to the wall"
    )
    if offers >= needs:  # wide again, but not joined with where the scope may be
        return replace(way, needs=needs, reason=reason)
    reason += f", and {floor_mm(offers)} mm are sure"
    return replace(way, needs=needs, offers=offers, reason=reason)


def reach_tree(
    duct: Duct,
    tree: LumenTree,
    *,
    scopes: Sequence[Scope],
    options: TreeReachOptions | None = None,
    progress: Progress = no_progress,
) -> TreeReach:
    """Find how far scopes come into every branch of a tree, each motion certified.

    Parameters
    ----------
    duct : Duct
        The lumen.
    tree : LumenTree
        Of that lumen.
    scopes : sequence of Scope
    options : TreeReachOptions, optional
    progress : Progress

    Raises
    ------
    InputError
        If an option is not legal, or two scopes have the same diameter.
    """
    sizes = [scope.diameter for scope in scopes]
    if len(set(sizes)) < len(sizes):
        told = ", ".join(f"{size:g}" for size in sizes)
        raise InputError(f"the scopes' diameters are {told} mm: each must be there once")
    ways, rows, found = [], [], []
    organ = _fill_organ(tree)
    options = options or TreeReachOptions()
    routes = describe_routes(tree, up=options.up)
    for number, scope in enumerate(scopes):

        def tell(stage: str, share: float, number: int = number) -> None:
            progress(stage, (number + share) / len(scopes))

        own = find_ways(duct, tree, scope=scope, options=options, progress=tell)
        branches = _list_branches(tree, own, scope, routes)
        ways.append(own)
        rows += branches
        found.append(_sum_up(tree, branches, scope, organ=organ, needle=options.needle))
    entered = any(row.depth > 0.0 for row in rows)
    first = found[0]
    return TreeReach(
        tree=tree,
        scopes=tuple(found),
        rows=tuple(rows),
        ways=tuple(ways),
        ends=first.ends,
        volume=first.volume,
        near=first.near,
        depth=first.depth,
        needle_needed=None,
        reason="" if entered else f"no scope enters: {ways[0][0].reason}",
        findings=tree.findings,
    )


def _list_branches(
    tree: LumenTree, ways: Sequence[BranchWay], scope: Scope, routes: Sequence[str]
) -> list[BranchReach]:
    """Return a row for every branch: the way that gets farthest into it counts.

    Of those that pass it that with the most certified clearance.
    """
    begins = tree.begins
    through = {k: [] for k in range(len(tree.branches))}  # type: dict[int, list[BranchWay]]
    for way in ways:
        for k in tree.list_route(way.branch):
            through[k].append(way)
    rows = []
    for k, branch in enumerate(tree.branches):
        past = begins[k] + branch.length

        def judge(way: BranchWay, past: float = past) -> tuple[float, float]:
            return min(way.depth, past - END), np.nan_to_num(way.clearance, nan=-1.0)

        best = max(through[k], key=judge)
        reached = float(np.clip(best.depth - begins[k], 0.0, branch.length))
        stops = reached <= 0.0 or best.depth < past - END
        rows.append(
            BranchReach(
                diameter=scope.diameter,
                link=scope.link_length,
                branch=branch.name,
                anatomy=branch.anatomy,
                generation=branch.generation,
                length=branch.length,
                reached=reached,
                depth=min(best.depth, past),
                clearance=best.clearance if reached > 0.0 else math.nan,
                stop=best.stop if stops else "",
                reason=best.reason if stops else "",
                route=routes[k],
            )
        )
    return rows


def _sum_up(
    tree: LumenTree, rows: Sequence[BranchReach], scope: Scope, *, organ: _Organ, needle: float
) -> ScopeReach:
    entered = [row for row in rows if row.reached > 0.0]
    ends = [row for row, branch in zip(rows, tree.branches, strict=True) if branch.is_end]
    volume, near = _measure_shares(tree, rows, organ, needle)
    return ScopeReach(
        diameter=scope.diameter,
        link=scope.link_length,
        entered=len(entered) / len(rows),
        passed=sum(row.passed for row in rows) / len(rows),
        ends=sum(row.passed for row in ends) / len(ends) if ends else math.nan,
        length=sum(row.reached for row in rows) / sum(row.length for row in rows),
        volume=volume,
        near=near,
        generation=max((row.generation for row in entered), default=0),
        depth=max((row.depth for row in entered), default=0.0),
        clearance=min((row.clearance for row in entered), default=math.nan),
    )


@dataclass(frozen=True, eq=False)
class _Organ:
    """Places (m, 3) of the organ round a tree, each with the branch and the arc nearest to it."""

    places: Floats
    branch: NDArray[np.int64]
    arc: Floats


def _fill_organ(tree: LumenTree) -> _Organ:
    """Return places in the convex hull of all branches that have a parent, on a regular grid.

    There are some `PLACES` of them; none where the tree is planar or does not branch.
    """
    from scipy.spatial import ConvexHull, Delaunay, QhullError, cKDTree

    none = _Organ(np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros(0))
    beyond = [branch.points for branch in tree.branches if branch.parent >= 0]
    if not beyond:
        return none
    points = np.concatenate(beyond)
    try:
        whole = ConvexHull(points)
        hull = Delaunay(points[whole.vertices])
    except QhullError:
        return none
    low, high = points.min(axis=0), points.max(axis=0)
    pitch = (whole.volume / PLACES) ** (1.0 / 3.0)
    axes = [np.arange(a + 0.5 * pitch, b, pitch) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    grid = grid[hull.find_simplex(grid) >= 0]
    counts = [len(branch.points) for branch in tree.branches]
    owner = np.repeat(np.arange(len(counts)), counts)
    arcs = np.concatenate([measure_arc_length(branch.points) for branch in tree.branches])
    _, near = cKDTree(np.concatenate([branch.points for branch in tree.branches])).query(grid)
    return _Organ(grid, owner[near], arcs[near])


def _measure_shares(
    tree: LumenTree, rows: Sequence[BranchReach], organ: _Organ, needle: float
) -> tuple[float, float]:
    """Return which share of an organ belongs to what is reached, and which a needle gets to."""
    from scipy.spatial import cKDTree

    reached = np.array([row.reached for row in rows])
    places = [
        branch.points[measure_arc_length(branch.points) <= row.reached]
        for branch, row in zip(tree.branches, rows, strict=True)
        if row.reached > 0.0
    ]
    if len(organ.places) == 0:
        return math.nan, math.nan
    own = organ.arc <= reached[organ.branch]
    own &= reached[organ.branch] > 0.0
    if not places:
        return 0.0, 0.0
    away, _ = cKDTree(np.concatenate(places)).query(organ.places)
    return float(np.mean(own)), float(np.mean(away <= needle))
