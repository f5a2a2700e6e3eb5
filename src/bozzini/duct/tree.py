"""The tree of a lumen that branches: all branches from one flood, each with its centreline."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_points, choose
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..numeric.polylines import interpolate_polyline, measure_arc_length, resample_polyline
from ..progress import Progress, no_progress
from ..results import ClosedForm, Json, to_plain
from .base import SampledField
from .centreline import (
    SPACING,
    SPACING_SHARE,
    Centreline,
    LumenGraph,
    _stay_inside,
)

if TYPE_CHECKING:
    pass

LEAST_SPUR = 1.75
"""A branch reaches at least this many voxels beyond the wall of what it leaves: the steps of a wall
of voxels, the half voxel between a node and the middle, and their diagonals."""

MOST_LINES = 100_000
"""So many ends a tree has at most."""

SWEEPS = 20
"""How often the lines are smoothed and pushed back."""

KEEP = 0.95
"""Smoothing takes at most the rest of the clearance."""


@dataclass(frozen=True, eq=False, repr=False)
class Branch:
    """A piece of a tree between two places where it branches, or from there to an end.

    Parameters
    ----------
    name : str
        Where it is in the tree: ``"0"`` begins at the root, and of what leaves its end ``"0.0"`` is
        the widest, ``"0.1"`` the next.
    parent : int
        Index of the branch that it leaves; -1 at the root.
    points : (n, 3) float
        World frame [mm], from the place where it leaves its parent, a point of that too.
    radius : (n,) float
        Inscribed radius: distance to the (inflated) wall [mm].
    generation : int
        How many branches lie between it and the root.
    angle : float
        Between its direction and that of the end of its parent [rad]; 0 at the root.
    is_end : bool
        Whether nothing leaves its end.
    """

    name: str
    parent: int
    points: Floats
    radius: Floats
    generation: int
    angle: float
    is_end: bool

    @property
    def length(self) -> float:
        """Along the line [mm]."""
        return float(measure_arc_length(self.points)[-1])

    @property
    def mean_radius(self) -> float:
        """The median of its radius, where it has a parent beyond the ball in which it begins [mm]."""
        beyond = np.linalg.norm(self.points - self.points[0], axis=1) > self.radius[0]
        known = beyond.any() and self.parent >= 0
        return float(np.median(self.radius[beyond] if known else self.radius))

    def __repr__(self) -> str:
        return (
            f"Branch({self.name!r}, generation={self.generation}, length={self.length:.1f} mm, "
            f"radius={self.mean_radius:.2f} mm{', end' * self.is_end})"
        )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LumenTree(ClosedForm):
    """All branches of a lumen.

    Parameters
    ----------
    branches : tuple of Branch
        Each after its parent; those of one parent side by side, the widest first.
    """

    branches: tuple[Branch, ...]

    def __repr__(self) -> str:
        return (
            f"LumenTree({len(self.branches)} branches, {len(self.ends)} ends, "
            f"{self.generations} generations, {self.length:.0f} mm)"
        )

    @cached_property
    def names(self) -> dict[str, int]:
        """The index of each branch by its name."""
        return {branch.name: index for index, branch in enumerate(self.branches)}

    @property
    def ends(self) -> tuple[Branch, ...]:
        """The branches that nothing leaves."""
        return tuple(branch for branch in self.branches if branch.is_end)

    @property
    def generations(self) -> int:
        """How many branches follow each other at most."""
        return 1 + max(branch.generation for branch in self.branches)

    @property
    def length(self) -> float:
        """Of all branches [mm]."""
        return sum(branch.length for branch in self.branches)

    def find_branch(self, branch: str | int | Branch) -> int:
        """Return the index of a branch, by its name, its index or itself.

        Raises
        ------
        InputError
            If the tree has no such branch.
        """
        if isinstance(branch, Branch):
            branch = branch.name
        if isinstance(branch, str):
            choose("branch", branch, self.names)
            return self.names[branch]
        if not 0 <= branch < len(self.branches):
            raise InputError(f"branch is {branch}: the tree has 0 to {len(self.branches) - 1}")
        return int(branch)

    def list_route(self, branch: str | int | Branch) -> tuple[int, ...]:
        """Return the indices of the branches from the root to a branch, itself the last."""
        route = [self.find_branch(branch)]
        while self.branches[route[-1]].parent >= 0:
            route.append(self.branches[route[-1]].parent)
        return tuple(route[::-1])

    def path(self, branch: str | int | Branch) -> Centreline:
        """Return the line from the root to the end of a branch: those of its route, joined.

        Two paths have the same points as far as they have the same branches.
        """
        route = [self.branches[index] for index in self.list_route(branch)]
        points = [route[0].points, *(part.points[1:] for part in route[1:])]
        radius = [route[0].radius, *(part.radius[1:] for part in route[1:])]
        joined = np.concatenate(points)
        return Centreline(
            points=joined, arc_length=measure_arc_length(joined), radius=np.concatenate(radius)
        )

    def nearest(self, points: ArrayLike) -> tuple[NDArray[np.int64], Floats]:
        """Return the branch nearest to points (..., 3) [mm], and how far its line is [mm]."""
        places = check_points("points", points)
        gaps, index = self._points.query(places)
        return self._owners[index], np.asarray(gaps)

    @cached_property
    def _points(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(np.concatenate([branch.points for branch in self.branches]))

    @cached_property
    def _owners(self) -> NDArray[np.int64]:
        counts = [len(branch.points) for branch in self.branches]
        return np.repeat(np.arange(len(counts)), counts)

    def list_columns(self) -> Json:
        """Return the columns of the table, a row for each branch."""
        rows = self.branches
        first, last = (np.stack([branch.points[at] for branch in rows]) for at in (0, -1))
        columns: Json = {
            "name": [branch.name for branch in rows],
            "parent": [rows[b.parent].name if b.parent >= 0 else "" for b in rows],
            "generation": [branch.generation for branch in rows],
            "length_mm": [branch.length for branch in rows],
            "radius_mm": [branch.mean_radius for branch in rows],
            "radius_min_mm": [float(branch.radius.min()) for branch in rows],
            "angle_rad": [branch.angle for branch in rows],
            "is_end": [branch.is_end for branch in rows],
        }
        for name, places in (("start", first), ("end", last)):
            columns |= {f"{name}_{axis}_mm": places[:, k] for k, axis in enumerate("xyz")}
        return columns

    def to_dict(self) -> Json:
        """Return the tree as plain values, which JSON takes."""
        table = self.list_columns()
        rows = [
            {name: column[k] for name, column in table.items()}
            | {"points_mm": branch.points, "radii_mm": branch.radius}
            for k, branch in enumerate(self.branches)
        ]
        return to_plain({"branches": rows, "converged": True, "reason": "", "residual": 0.0})


def find_tree(
    field: SampledField, root: ArrayLike | None = None, *, progress: Progress = no_progress
) -> LumenTree:
    """Find all branches of a lumen.

    One flood from the root over the grid graph, at the cost ``1 / clearance**2.5`` of
    `find_centreline`, has the path to every node. Taken are the paths to the farthest node, then to
    the farthest that none taken covers, and so on: a path covers as far beyond the wall as its own
    clearance, so that a spur shorter than the local radius is no branch. All lines are then
    smoothed together under tension and pushed back wherever they lose clearance. The topology is
    that of the lumen before inflation.

    Parameters
    ----------
    field : SampledField
        The lumen.
    root : (3,) float, optional
        Where the tree begins, inside the lumen [mm]. By default the widest end; of equally wide
        ones that with the largest world z.

    Raises
    ------
    InputError
        If `field` is no sampled field.
    GeometryError
        If the root lies outside the lumen, or the lumen is no tube.
    """
    if not isinstance(field, SampledField):
        raise InputError(
            f"field is a {type(field).__name__}: it must be a SampledField, which build_field "
            "makes of a tract and sample() of a duct"
        )
    progress("tree", 0.0)
    graph = LumenGraph(field)
    given = graph.locate("root", root, None)
    source = _find_root(graph) if given is None else given[0]
    progress("tree", 0.4)
    lines = _Skeleton.trace(graph, source).split()
    progress("tree", 0.7)
    _trim(lines, graph, None if given is None else field.to_grid(check_points("root", root)))
    _centre(lines, graph)
    branches = _name(lines, field)
    progress("tree", 1.0)
    return LumenTree(branches=branches)


@dataclass(eq=False)
class _Line:
    """A branch while it is made: its points (n, 3) in the grid frame, and those of its ball."""

    points: Floats
    parent: int
    is_end: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class _Skeleton:
    """The nodes that lines run through: for each the one before on the way from the root."""

    graph: LumenGraph
    before: NDArray[np.int32]
    owner: NDArray[np.int32]
    tips: NDArray[np.int32]

    @classmethod
    def trace(cls, graph: LumenGraph, source: NDArray[np.int64]) -> _Skeleton:
        """Take the lines out of the flood from a node."""
        from .kernels.tree import add_lengths, take_lines

        search = graph.search(source)
        count = int(np.isfinite(search.costs).sum())
        spacing = graph.field.spacing
        grid = (graph.number, graph.nodes, search.before)
        lengths = np.full(len(graph.nodes), -1.0)
        add_lengths(np.argsort(search.costs)[:count], *grid, spacing, lengths)
        farthest = np.argsort(-lengths, kind="stable")[:count]
        owner = np.full(len(graph.nodes), -1, dtype=np.int32)
        tips = np.empty(MOST_LINES, dtype=np.int32)
        least = LEAST_SPUR * float(spacing.max())
        found = take_lines(farthest, *grid, graph.depths, spacing, least, owner, tips)
        return cls(graph=graph, before=search.before, owner=owner, tips=tips[:found])

    def split(self) -> list[_Line]:
        """Return the lines between root, branchings and tips; each after its parent."""
        kids: dict[int, list[int]] = {}
        for node in np.flatnonzero(self.owner >= 0).tolist():
            kids.setdefault(int(self.before[node]), []).append(node)
        (root,) = kids[-1]
        waiting = [(root, kid, -1) for kid in kids.get(root, [])]
        lines: list[_Line] = []
        while waiting:
            start, node, parent = waiting.pop()
            way = [start, node]
            while len(after := kids.get(node, [])) == 1:
                (node,) = after
                way.append(node)
            waiting += [(node, kid, len(lines)) for kid in after]
            points = self.graph.places(np.array(way)) * self.graph.field.spacing
            lines.append(_Line(points=points, parent=parent, is_end=not after))
        return lines


def _find_root(graph: LumenGraph) -> NDArray[np.int64]:
    """Return the node (3,) of the widest end; of equally wide ones the one with the largest z."""
    farthest = graph.find_remotest(graph.find_deepest())
    skeleton = _Skeleton.trace(graph, farthest)
    lines = skeleton.split()
    ends = [line.points for line in lines if line.is_end]
    ends += [line.points[::-1] for line in lines if line.parent < 0]
    best = max(ends, key=lambda points: _rate_end(points, graph))
    return np.rint(best[-1] / graph.field.spacing).astype(np.int64)


def _rate_end(points: Floats, graph: LumenGraph) -> tuple[int, float]:
    """Return the radius of the end of a line in voxels, and the world z of it."""
    crest = points[len(points) - 1 - _find_crest(points[::-1], graph)]
    radius = float(graph.measure_depth(crest[None])[0])
    z = float(graph.field.to_world(points[-1])[2])
    return round(radius / float(graph.field.spacing.max())), z


def _find_crest(points: Floats, graph: LumenGraph) -> int:
    """Return the index where a line that starts in a closed tip comes out of it.

    That is the last ball that still holds the tip, but not one that holds the other end.
    """
    depth = graph.measure_depth(points)
    slack = 0.5 * float(np.linalg.norm(graph.field.spacing))  # from a node to the wall
    holds = np.linalg.norm(points - points[0], axis=1) <= depth + slack
    holds &= np.linalg.norm(points - points[-1], axis=1) > depth
    return int(np.max(np.flatnonzero(holds), initial=0))


def _trim(lines: list[_Line], graph: LumenGraph, root: Floats | None) -> None:
    """Take away the closed tips, but for a root that is given."""
    for line in lines:
        if line.is_end:
            skip = _find_crest(line.points[::-1], graph)
            line.points = line.points[: len(line.points) - skip]
    first = [line for line in lines if line.parent < 0]
    for line in first:
        if root is not None:
            line.points[0] = root
        elif len(first) == 1:
            line.points = line.points[_find_crest(line.points, graph) :]
    length = sum(float(measure_arc_length(line.points)[-1]) for line in lines)
    widest = max((float(graph.measure_depth(line.points).max()) for line in lines), default=0.0)
    if length < max(widest, 1e-9):
        raise GeometryError(
            f"no tube was found in the lumen: the lines in it are {length:.1f} mm long, and it is "
            f"{2.0 * widest:.1f} mm wide"
        )


def _centre(lines: list[_Line], graph: LumenGraph) -> None:
    """Smooth all lines together; where that loses clearance, push them back.

    Lines that meet keep their common point; root and tips stay.
    """
    voxel = float(graph.field.spacing.min())
    parts: list[Floats] = []
    index: list[NDArray[np.int64]] = []
    count = 0
    for line in lines:
        radius = float(np.median(graph.measure_depth(line.points)))
        own = resample_polyline(line.points, min(SPACING, max(voxel, SPACING_SHARE * radius)))
        joined = line.parent >= 0 or count > 0
        start = index[line.parent][-1:] if line.parent >= 0 else np.zeros(1, dtype=np.int64)
        own = own[1:] if joined else own
        rest = np.arange(count, count + len(own))
        index.append(np.concatenate([start, rest]) if joined else rest)
        parts.append(own)
        count += len(own)
    points = np.concatenate(parts)
    web = _Web.join(index, count)
    fixed = np.array([0, *(own[-1] for own, line in zip(index, lines, strict=True) if line.is_end)])
    step = 0.5 * min(SPACING, voxel)
    for _ in range(2):
        target = KEEP * graph.measure_depth(points)
        target = np.minimum(target, web.spread_least(target, 3))
        for _ in range(SWEEPS):
            moved = points + 0.5 * (web.average(points) - points)
            lack = target - graph.measure_depth(moved)
            low = np.flatnonzero(lack > 0.0)
            push = np.minimum(lack[low], step)[:, None] * graph.measure_slope(moved[low])
            moved[low] += push
            moved[fixed] = points[fixed]
            points = moved
    points = _stay_inside(points, graph)
    for line, own in zip(lines, index, strict=True):
        line.points = points[own]


@dataclass(frozen=True, eq=False)
class _Web:
    """Which points (n) are neighbours: those of point i are `others` from `first[i]` on."""

    first: NDArray[np.int64]
    others: NDArray[np.int64]

    @classmethod
    def join(cls, lines: list[NDArray[np.int64]], count: int) -> _Web:
        """Join the points of each line, given by their numbers, in its order."""
        one = np.concatenate([own[:-1] for own in lines])
        two = np.concatenate([own[1:] for own in lines])
        start, end = np.concatenate([one, two]), np.concatenate([two, one])
        order = np.argsort(start, kind="stable")
        first = np.searchsorted(start[order], np.arange(count))
        return cls(first, end[order])

    def average(self, points: Floats) -> Floats:
        """Return the middle of the neighbours of each point."""
        counts = np.diff(np.append(self.first, len(self.others)))
        return np.asarray(np.add.reduceat(points[self.others], self.first) / counts[:, None])

    def spread_least(self, values: Floats, times: int) -> Floats:
        """Return the least value of each point and those up to `times` neighbours away."""
        for _ in range(times):
            values = np.minimum(values, np.minimum.reduceat(values[self.others], self.first))
        return values


def _name(lines: list[_Line], field: SampledField) -> tuple[Branch, ...]:
    """Return the branches, the widest of each place first."""
    branches = []
    for line in lines:
        points = field.to_world(line.points)
        radius = -field.signed_distance(points)
        branches.append(Branch("", line.parent, points, radius, 0, 0.0, line.is_end))
    kids: dict[int, list[int]] = {}
    for number, line in enumerate(lines):
        kids.setdefault(line.parent, []).append(number)

    def rank(number: int) -> tuple[float, ...]:
        branch = branches[number]
        return (-branch.mean_radius, -branch.length, *branch.points[-1])

    named: list[Branch] = []
    waiting = [(number, -1, f"{k}") for k, number in enumerate(sorted(kids[-1], key=rank))][::-1]
    while waiting:
        number, parent, name = waiting.pop()
        branch = branches[number]
        generation, angle = 0, 0.0
        if parent >= 0:
            generation = named[parent].generation + 1
            angle = _measure_angle(named[parent], branch)
        after = sorted(kids.get(number, []), key=rank)
        waiting += [(kid, len(named), f"{name}.{k}") for k, kid in enumerate(after)][::-1]
        named.append(replace(branch, name=name, parent=parent, generation=generation, angle=angle))
    return tuple(named)


def _measure_angle(parent: Branch, branch: Branch) -> float:
    """Return the angle between a branch and the end of its parent, outside of their common ball."""
    before = _find_direction(parent.points[::-1], float(branch.radius[0]))
    after = _find_direction(branch.points, float(branch.radius[0]))
    return math.acos(float(np.clip(-before @ after, -1.0, 1.0)))


def _find_direction(points: Floats, radius: float) -> Floats:
    """Return the direction of a line beyond the ball in which it begins, over a radius of that."""
    arc = measure_arc_length(points)
    reach = min(radius, 0.5 * arc[-1])
    ends = interpolate_polyline(points, arc, np.array([reach, min(2.0 * reach, arc[-1])]))
    way = ends[1] - ends[0]
    return np.asarray(way / np.linalg.norm(way))
