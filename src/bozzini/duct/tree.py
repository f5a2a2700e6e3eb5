"""The tree of a lumen that branches: all branches from one flood, each with its centreline."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..anatomy.tract import Finding
from ..checks import check_points, show_value
from ..errors import BozziniError, GeometryError, InputError
from ..numeric.arrays import Floats
from ..numeric.polylines import interpolate_polyline, measure_arc_length, resample_polyline
from ..progress import Progress, no_progress
from ..results import ClosedForm, Json, Shown, take_axes, to_plain
from .base import SampledField
from .centreline import (
    SPACING,
    SPACING_SHARE,
    Centreline,
    LumenGraph,
    _stay_inside,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from networkx import DiGraph  # type: ignore[import-untyped]
    from scipy.spatial import cKDTree

LEAST_SPUR = 1.75
"""A branch reaches at least this many voxels beyond the wall of what it leaves: the steps of a wall
of voxels, the half voxel between a node and the middle, and their diagonals."""

MOST_LINES = 100_000
"""So many ends a tree has at most."""

SWEEPS = 20
"""How often the lines are smoothed and pushed back."""

KEEP = 0.95
"""Smoothing takes at most the rest of the clearance."""


BRIDGES_MAX = 100
"""No further flood is done once so many bridges have been avoided."""

BRIDGE = 0.8
"""A place of a loop with less than this share of the clearance where it closes is a bridge."""

NAMED = 24
"""So many branches have their names in a picture."""

ISLAND = 8.0
"""A loop of at most so many voxels goes round a voxel of wall or two, where branches part."""

FRONTS_MAX = 200_000
"""So many neighbours on both sides of fronts are looked at."""

LEAK = 1.5
"""A branch so many times as wide as its parent is reported."""


@dataclass(frozen=True, eq=False, repr=False)
class Branch(Shown):
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
        Of the lumen [mm]: the clearance and, where corners of voxels stand into it, what these
        take away, half a voxel's diagonal. An estimate.
    clearance : (n,) float
        Distance to the (inflated) wall, voxels taken as they are [mm].
    generation : int
        How many branches lie between it and the root.
    angle : float
        Between its direction and that of the end of its parent [rad]; 0 at the root.
    is_end : bool
        Whether nothing leaves its end, and no loop closes there.
    anatomy : str
        What it is called in anatomy, such as ``"RB3"``; empty where that is not known.
    """

    name: str
    parent: int
    points: Floats
    radius: Floats
    clearance: Floats
    generation: int
    angle: float
    is_end: bool
    anatomy: str = ""

    @property
    def length(self) -> float:
        """Along the line [mm]."""
        return float(measure_arc_length(self.points)[-1])

    @property
    def mean_radius(self) -> float:
        """The median of its radius, beyond the ball in which it leaves its parent [mm]."""
        return float(np.median(self.radius[self.own]))

    @property
    def own(self) -> NDArray[np.bool_]:
        """Which points (n,) lie beyond the ball in which it leaves its parent; the last does."""
        beyond = np.linalg.norm(self.points - self.points[0], axis=1) > self.radius[0]
        beyond |= self.parent < 0
        beyond[-1] = True
        return np.asarray(beyond)

    def __repr__(self) -> str:
        return (
            f"Branch({self.name!r}, generation={self.generation}, length={self.length:.1f} mm, "
            f"radius={self.mean_radius:.2f} mm{', end' * self.is_end})"
        )


@dataclass(frozen=True)
class TreeFinding(Finding):
    """One thing that is odd about a tree.

    Parameters
    ----------
    code : str
        ``"loop"``, ``"leak"``, ``"loose-part"``, ``"hole"``, ``"thin-end"``, ``"root-inside"`` or
        ``"unnamed"``.
    branch : str
        The name of the branch that it is about; empty for none.
    point : (float, float, float)
        Where [mm].
    size : float
        Of a loop its length [mm], of a leak by what factor it is wider than the parent, of a loose
        part or a hole its volume [mm^3], of a thin end its width [mm], of a root inside a
        branch the length behind it [mm], and of a name that no branch has 0.
    """

    branch: str
    point: tuple[float, float, float]
    size: float


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LumenTree(ClosedForm):
    """All branches of a lumen.

    Parameters
    ----------
    branches : tuple of Branch
        Each after its parent, in the order of their names.
    findings : tuple of Finding
        Loops, leaks, parts and ends that are not what they seem, each a `TreeFinding`; before them,
        in that of a file, what was found in reading.
    frame : str, optional
        Where the world's axes point in the patient, such as ``"RAS"``, as far as that is known.
    """

    branches: tuple[Branch, ...]
    findings: tuple[Finding, ...] = ()
    frame: str | None = None

    def __repr__(self) -> str:
        return (
            f"LumenTree({len(self.branches)} branches, {len(self.ends)} ends, "
            f"{self.generations} generations, {self.length:.0f} mm, {len(self.findings)} findings)"
        )

    @cached_property
    def names(self) -> dict[str, int]:
        """The index of each branch by its name."""
        return {branch.name: index for index, branch in enumerate(self.branches)}

    @property
    def ends(self) -> tuple[Branch, ...]:
        """The branches that end in the lumen's ends."""
        return tuple(branch for branch in self.branches if branch.is_end)

    @cached_property
    def tips(self) -> tuple[int, ...]:
        """Indices of the branches that nothing leaves: the ends, and where a loop closes."""
        parents = {branch.parent for branch in self.branches}
        return tuple(k for k in range(len(self.branches)) if k not in parents)

    @property
    def generations(self) -> int:
        """How many branches follow each other at most."""
        return 1 + max(branch.generation for branch in self.branches)

    @property
    def length(self) -> float:
        """Of all branches [mm]."""
        return sum(branch.length for branch in self.branches)

    @cached_property
    def begins(self) -> Floats:
        """How far from the root each branch begins [mm], shape (b,)."""
        begins = np.zeros(len(self.branches))
        for k, branch in enumerate(self.branches):
            if branch.parent >= 0:
                begins[k] = begins[branch.parent] + self.branches[branch.parent].length
        return begins

    def find_branch(self, branch: str | int | Branch) -> int:
        """Return the index of a branch, by one of its names, its index or itself.

        Raises
        ------
        InputError
            If the tree has no such branch.
        """
        if isinstance(branch, Branch):
            branch = branch.name
        if isinstance(branch, str):
            called = branch.strip().lower()
            known = [k for k, each in enumerate(self.branches) if each.anatomy.lower() == called]
            if branch not in self.names and called and len(known) == 1:
                return known[0]
            if branch not in self.names:
                raise InputError(
                    f"there is no branch {show_value(branch)} among the tree's "
                    f"{len(self.branches)}: 'bozzini tree' lists their names"
                )
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

        Two paths have the same points as far as they have the same branches. Its radius is the
        clearance.
        """
        route = [self.branches[index] for index in self.list_route(branch)]
        points = [route[0].points, *(part.points[1:] for part in route[1:])]
        clearance = [route[0].clearance, *(part.clearance[1:] for part in route[1:])]
        joined = np.concatenate(points)
        return Centreline(
            points=joined, arc_length=measure_arc_length(joined), radius=np.concatenate(clearance)
        )

    def nearest(self, points: ArrayLike) -> tuple[NDArray[np.int64], Floats]:
        """Return the branch nearest to points (..., 3) [mm], and how far its line is [mm]."""
        places = check_points("points", points)
        gaps, index = self._points.query(places)
        return self._owners[index], np.asarray(gaps)

    @cached_property
    def _points(self) -> cKDTree:
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
            "anatomy": [branch.anatomy for branch in rows],
            "parent": [rows[b.parent].name if b.parent >= 0 else "" for b in rows],
            "generation": [branch.generation for branch in rows],
            "length_mm": [branch.length for branch in rows],
            "radius_mm": [branch.mean_radius for branch in rows],
            "clearance_min_mm": [float(branch.clearance.min()) for branch in rows],
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
        findings = [asdict(finding) for finding in self.findings]
        verdict = {"converged": self.converged, "reason": self.reason, "residual": self.residual}
        found: Json = to_plain({"branches": rows, "findings": findings, **verdict})
        return found

    def to_networkx(self) -> DiGraph:
        """Return the tree as a directed graph of ``networkx``: an edge for each branch.

        Nodes are the root, ``""``, and the ends of the branches by name, each with its ``point``;
        an edge has the row of the table, ``points`` and ``radius``.

        Raises
        ------
        BozziniError
            If ``networkx`` is not installed.
        """
        try:
            import networkx
        except ImportError:
            raise BozziniError(
                "this needs the package 'networkx', which is not installed: pip install networkx"
            ) from None
        graph = networkx.DiGraph()
        graph.add_node("", point=self.branches[0].points[0])
        table = self.list_columns()
        for k, branch in enumerate(self.branches):
            row = {name: column[k] for name, column in table.items()}
            graph.add_node(branch.name, point=branch.points[-1])
            graph.add_edge(row["parent"], branch.name, **row, points=branch.points,
                           radius=branch.radius)  # fmt: skip
        return graph

    @cached_property
    def columns(self) -> Floats:
        """Where each branch stands in the tree laid flat, shape (b,): its tips lie 1 apart."""
        columns, kids = np.zeros(len(self.branches)), np.zeros(len(self.branches))
        count = 0
        for k in range(len(self.branches) - 1, -1, -1):  # each before its parent
            columns[k] = columns[k] / kids[k] if kids[k] else -count
            count += not kids[k]
            parent = self.branches[k].parent
            if parent >= 0:
                columns[parent] += columns[k]
                kids[parent] += 1
        return columns

    def plot(self, ax: Axes | None = None, *, reached: Sequence[float] | None = None) -> Axes:
        """Draw the tree laid flat and return the axes: down from the root, a line for each branch.

        It is as long as the branch, and as wide as its radius is beside the others'. Where names of
        all ends are too many, those of the last generation that fits are written.

        Parameters
        ----------
        ax : Axes, optional
        reached : (b,) sequence of float, optional
            How much of each branch is in colour [mm]; by default all.
        """
        ax = take_axes(ax, x="ends, side by side", y="way from the root [mm]")
        widest = max(branch.mean_radius for branch in self.branches)
        for k, branch in enumerate(self.branches):
            x, top = self.columns[k], self.begins[k]
            wide = max(8.0 * branch.mean_radius / widest, 0.5)
            own = branch.length if reached is None else reached[k]
            for color, low, high in (("C0", 0.0, own), ("#c8ccd0", own, branch.length)):
                if high > low:
                    ax.plot([x, x], [top + low, top + high], color=color, linewidth=wide,
                            solid_capstyle="butt")  # fmt: skip
            if branch.parent >= 0:
                ax.plot([self.columns[branch.parent], x], [top, top], "C7", linewidth=0.5)
        for k in self._choose_named():
            branch = self.branches[k]
            end, tip = self.begins[k] + branch.length, k in self.tips
            ax.annotate(branch.anatomy or branch.name, (self.columns[k], end), rotation=90,
                        fontsize=5, ha="center" if tip else "right", va="top" if tip else "bottom",
                        xytext=(0, -2) if tip else (-2, 0),
                        textcoords="offset points")  # fmt: skip
        ax.set_xticks([])
        ax.margins(y=0.15)  # room for the names
        ax.invert_yaxis()
        return ax

    def _choose_named(self) -> list[int]:
        """Return the branches at which a picture has names: the tips, or others in place of them.

        These are of the last generation of which, with the tips before it, no more than `NAMED` are
        there.
        """
        tips = set(self.tips)
        for last in range(self.generations - 1, 0, -1):
            generations = [branch.generation for branch in self.branches]
            named = [k for k, g in enumerate(generations) if g == last or (g < last and k in tips)]
            if len(named) <= NAMED:
                return named
        return [0]


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
    given = None if root is None else check_points("root", root)
    nodes = graph.locate("root", given, None)
    source = _find_root(graph) if nodes is None else nodes[0]
    progress("tree", 0.4)
    skeleton, loops = _trace_without_bridges(graph, source)
    lines = skeleton.split()
    progress("tree", 0.7)
    _trim(lines, graph, None if given is None else field.to_grid(given))
    _centre(lines, graph)
    tree = LumenTree(branches=_name(lines, field))
    progress("tree", 0.9)
    tree = _add_loops(tree, loops, graph)
    findings = [*tree.findings, *_find_odd_branches(tree, field), *_find_parts(graph, skeleton)]
    progress("tree", 1.0)
    return replace(tree, findings=tuple(findings))


@dataclass(eq=False)
class _Line:
    """A branch while it is made: its points (n, 3) in the grid frame, and those of its ball."""

    points: Floats
    parent: int
    is_end: bool


@dataclass(frozen=True, eq=False)
class _Loop:
    """A loop of the lumen: the way round it by the lines, as numbers of nodes.

    The first and the last are neighbours from both sides of its front. `island` is how long it is
    at least [mm], if it goes round no more than a voxel or two where branches part; else infinite.
    """

    way: NDArray[np.int64]
    island: float


@dataclass(frozen=True, kw_only=True, eq=False)
class _Skeleton:
    """The nodes that lines run through: for each the one before on the way from the root."""

    graph: LumenGraph
    before: NDArray[np.int32]
    lengths: Floats
    owner: NDArray[np.int32]

    @classmethod
    def trace(cls, graph: LumenGraph, source: NDArray[np.int64]) -> _Skeleton:
        """Take the lines out of the flood from a node."""
        from .kernels.tree import add_lengths, take_lines

        search = graph.search(source)
        count = int(np.isfinite(search.costs).sum())
        spacing = graph.field.spacing
        before = search.before.copy()
        grid = (graph.number, graph.nodes, before)
        lengths = np.full(len(graph.nodes), -1.0)
        order = np.argsort(search.costs)[:count]
        add_lengths(order, *grid, spacing, lengths)
        farthest = np.argsort(-lengths, kind="stable")[:count]
        owner = np.full(len(graph.nodes), -1, dtype=np.int32)
        tips = np.empty(MOST_LINES, dtype=np.int32)
        least = LEAST_SPUR * float(spacing.max())
        floods = (search.costs, lengths, graph.depths)
        take_lines(farthest, *grid, *floods, spacing, least, owner, tips)
        add_lengths(order, *grid, spacing, lengths)  # of the steps that were changed
        return cls(graph=graph, before=before, lengths=lengths, owner=owner)

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

    def find_loops(self) -> list[_Loop]:
        """Return the loops of the lumen, the longest way round first."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        from .kernels.graph import find_costs
        from .kernels.tree import find_fronts

        graph = self.graph
        feet = np.full(len(self.owner), -1, dtype=np.int32)
        lines = np.flatnonzero(self.owner >= 0)
        gaps = np.full(len(feet), np.inf)
        grid = (graph.number, graph.nodes)
        find_costs(*grid, np.ones(len(feet)), graph.field.spacing, lines, gaps, feet)
        feet = np.where(feet >= 0, feet, np.arange(len(feet), dtype=np.int32))
        while not np.array_equal(feet, after := feet[feet]):
            feet = after
        fronts = np.empty((FRONTS_MAX, 2), dtype=np.int32)
        is_open = np.empty(FRONTS_MAX, dtype=bool)
        lengths = (self.before, graph.depths, self.lengths)
        voxel = float(graph.field.spacing.max())
        found = min(find_fronts(*grid, *lengths, feet, voxel, fronts, is_open), FRONTS_MAX)
        if found == 0:
            return []
        fronts, is_open = fronts[:found], is_open[:found]
        nodes, sides = np.unique(fronts, return_inverse=True)
        joined = coo_array(
            (np.ones(found, dtype=bool), tuple(sides.reshape(-1, 2).T)), shape=(len(nodes),) * 2
        )
        label = connected_components(joined, directed=False)[1][sides.reshape(-1, 2)[:, 0]]
        loops = []
        closed = ~np.isin(label, label[is_open])
        for one in np.unique(label[closed]):
            own = fronts[label == one]
            middle = own[int(np.argmax(graph.depths[own].min(axis=1)))]
            way = self._close(*feet[middle].tolist())
            way = np.concatenate([middle[:1], way, middle[1:]])
            loops.append(_Loop(way, _measure_island(graph, own, fronts[closed])))
        return sorted(loops, key=lambda loop: len(loop.way), reverse=True)

    @cached_property
    def reached(self) -> NDArray[np.bool_]:
        """Which nodes of the grid are reached, cropped to them with one layer of others around."""
        places = self.graph.places(np.flatnonzero(self.lengths >= 0.0))
        low, high = places.min(axis=0), places.max(axis=0)
        mask = np.zeros(high - low + 3, dtype=bool)
        mask[tuple((places - low + 1).T)] = True
        return mask

    def _close(self, one: int, two: int) -> NDArray[np.int64]:
        """Return the way from a node back to where its path and that of another meet, and on."""
        ways: tuple[list[int], list[int]] = ([one], [two])
        while ways[0][-1] != ways[1][-1]:
            longer = max(ways, key=lambda way: float(self.lengths[way[-1]]))
            longer.append(int(self.before[longer[-1]]))
        return np.array([*ways[0], *ways[1][-2::-1]])


def _measure_island(graph: LumenGraph, own: NDArray[np.int32], fronts: NDArray[np.int32]) -> float:
    """Return the length of the shortest loop that crosses a front once, and no other [mm].

    It is infinite beyond `ISLAND`; `own` are the pairs of that front, `fronts` those of all.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    spacing = graph.field.spacing
    most = ISLAND * float(spacing.max())
    around = graph.places(own.ravel().astype(np.int64))
    reach = math.ceil(0.5 * most / spacing.min()) + 1
    low = np.maximum(around.min(axis=0) - reach, 0)
    block = graph.number[tuple(map(slice, low, around.max(axis=0) + reach + 1))]
    nodes = block[block >= 0].astype(np.int64)  # in the order of their numbers, as fronts are
    places = graph.places(nodes)
    pairs = cKDTree(places).query_pairs(1.8, output_type="ndarray")
    key = np.array([len(graph.nodes), 1])
    pairs = pairs[~np.isin(nodes[pairs] @ key, fronts @ key)]
    steps = np.linalg.norm((places[pairs[:, 0]] - places[pairs[:, 1]]) * spacing, axis=1)
    ways = coo_array((steps, tuple(pairs.T)), shape=(len(nodes),) * 2).tocsr()
    ends = np.searchsorted(nodes, own)
    across = np.linalg.norm((places[ends[:, 0]] - places[ends[:, 1]]) * spacing, axis=1)
    starts, row = np.unique(ends[:, 0], return_inverse=True)
    found = dijkstra(ways, directed=False, indices=starts, limit=most)
    length = float((found[row, ends[:, 1]] + across).min())
    return length if length <= most else math.inf


def find_holes(mask: NDArray[np.bool_]) -> list[tuple[NDArray[np.int64], int]]:
    """Return the holes that voxels enclose: of each a voxel in it, and how many it has."""
    from scipy.ndimage import label

    outside, count = label(~mask)
    if count < 2:
        return []
    sizes = np.bincount(outside.ravel())
    firsts = np.unique(outside, return_index=True)[1]
    around = outside[0, 0, 0]
    return [
        (np.array(np.unravel_index(firsts[k], mask.shape)), int(sizes[k]))
        for k in range(1, count + 1)
        if k != around
    ]


def _trace_without_bridges(
    graph: LumenGraph, source: NDArray[np.int64]
) -> tuple[_Skeleton, list[_Loop]]:
    """Return the lines, and the loops, each closed where it is narrowest.

    Where the flood went through that place, such as a false bridge between two branches, it is
    done again, and goes there last.
    """
    avoided: set[int] = set()
    while True:
        skeleton = _Skeleton.trace(graph, source)
        loops = skeleton.find_loops()
        again = set()
        for loop in loops:
            way = loop.way
            neck = int(way[np.argmin(graph.depths[way])])
            through = graph.depths[neck] < BRIDGE * graph.depths[way[[0, -1]]].min()
            if through and skeleton.lengths[way].min() > 0.0:  # the root's tip is narrow too
                again.add(neck)
        again -= avoided
        if not again or len(avoided) >= BRIDGES_MAX:
            break
        graph.avoid(np.array(sorted(again)))
        avoided |= again
    return skeleton, loops


def _find_root(graph: LumenGraph) -> NDArray[np.int64]:
    """Return the node (3,) of the widest end; of equally wide ones the one with the largest z."""
    farthest = graph.find_remotest(graph.find_deepest())
    skeleton = _Skeleton.trace(graph, farthest)
    lines = skeleton.split()
    ends = [line.points for line in lines if line.is_end]
    ends += [line.points[::-1] for line in lines if line.parent < 0]
    if not ends:  # all is one ball, and refused later
        return farthest
    best = max(ends, key=lambda points: _rate_end(points, graph))
    return np.asarray(np.rint(best[-1] / graph.field.spacing), dtype=np.int64)


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
    if length < max(widest, 2.0 * float(graph.field.spacing.min())):
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
    for line, numbers in zip(lines, index, strict=True):
        line.points = points[numbers]


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
        return np.asarray(values)


def _name(lines: list[_Line], field: SampledField) -> tuple[Branch, ...]:
    """Return the branches, the widest of each place first."""
    corners = min(field.wall_error or 0.0, 0.5 * float(np.linalg.norm(field.spacing)))
    branches = []
    for line in lines:
        points = field.to_world(line.points)
        clearance = -field.signed_distance(points)
        radius = clearance + corners
        branches.append(Branch("", line.parent, points, radius, clearance, 0, 0.0, line.is_end))
    return order_branches(branches)


def order_branches(branches: Sequence[Branch]) -> tuple[Branch, ...]:
    """Return branches in the order of their names, the widest of each place first.

    Parameters
    ----------
    branches : sequence of Branch
        Each after its parent; names, generations and angles are not looked at.
    """
    kids: dict[int, list[int]] = {}
    for number, branch in enumerate(branches):
        kids.setdefault(branch.parent, []).append(number)

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


def _add_loops(tree: LumenTree, loops: list[_Loop], graph: LumenGraph) -> LumenTree:
    """Return the tree with a finding for each loop, and no end where one closes."""
    field = graph.field
    findings: list[TreeFinding] = []
    closed: set[str] = set()
    for loop in loops:
        places = field.to_world(graph.places(loop.way) * field.spacing)
        length = float(measure_arc_length(places)[-1])
        place = 0.5 * (places[0] + places[-1])
        if math.isfinite(loop.island):
            sides = [tree.branches[k] for k in tree.nearest(places[[0, -1]])[0]]
            message = (
                f"{_list_names(sides)} touch once more a voxel or two beyond where they part, at "
                f"({_show(place)}) mm: a loop of {loop.island:.1f} mm"
            )
            island = _find("loop", message, sides[0].name, place, loop.island)
            findings.append(replace(island, severity="note"))
            continue
        clearance = np.max(-field.signed_distance(places[[0, -1]]))
        beside = 2.0 * float(clearance) + 3.0 * float(field.spacing.max())
        away = np.flatnonzero(np.linalg.norm(places - place, axis=1) > beside)
        outer = places[away[[0, -1]]] if len(away) else places[[0, -1]]
        sides = [tree.branches[k] for k in tree.nearest(outer)[0]]
        closed |= {b.name for b in sides if np.linalg.norm(b.points[-1] - place) <= beside}
        message = (
            f"a loop of {length:.1f} mm closes at ({_show(place)}) mm, on {_list_names(sides)}: "
            "branches that touch, or a bridge; it is not followed"
        )
        findings.append(_find("loop", message, sides[0].name, place, length))
    branches = tuple(
        replace(branch, is_end=branch.is_end and branch.name not in closed)
        for branch in tree.branches
    )
    return LumenTree(branches=branches, findings=tuple(findings))


def _find_odd_branches(tree: LumenTree, field: SampledField) -> list[TreeFinding]:
    """Return leaks, ends that are no wider than a voxel, and a root that is not at an end."""
    voxel = float(field.spacing.max())
    found = []
    first = [branch for branch in tree.branches if branch.parent < 0]
    if len(first) > 1:
        names = ", ".join(f"'{branch.name}'" for branch in first)
        least = min(first, key=lambda branch: branch.length)
        message = (
            f"the root is at no end of the lumen but inside a branch: {names} leave it, the "
            f"shortest is {least.length:.1f} mm long"
        )
        found.append(_find("root-inside", message, least.name, least.points[0], least.length))
    for branch in tree.branches:
        own = np.flatnonzero(branch.own)
        at = own[int(np.argmax(branch.radius[own]))]
        widest = float(branch.radius[at])
        # A leak that is the widest end is taken for the root.
        before = (tree.branches[branch.parent] if branch.parent >= 0 else branch).mean_radius
        if widest > LEAK * before + voxel:
            factor = widest / before
            than = "its parent" if branch.parent >= 0 else "it is in the middle"
            message = (
                f"branch '{branch.name}' is {factor:.1f} times as wide as {than} at "
                f"({_show(branch.points[at])}) mm, {2.0 * widest:.1f} mm: a leak of the "
                "segmentation?"
            )
            found.append(_find("leak", message, branch.name, branch.points[at], factor))
        width = 2.0 * float(np.median(branch.clearance[own]))
        if branch.is_end and width <= 1.05 * voxel:
            message = f"the end '{branch.name}' is no wider than a voxel, {width:.2f} mm"
            end = _find("thin-end", message, branch.name, branch.points[-1], width)
            found.append(replace(end, severity="note"))
    return found


def _find_parts(graph: LumenGraph, skeleton: _Skeleton) -> list[TreeFinding]:
    """Return the parts of the lumen that the tree does not reach, and the holes in it."""
    from scipy.ndimage import label, maximum_position

    field = graph.field
    volume = float(np.prod(field.spacing))
    found = []
    left = np.flatnonzero(skeleton.lengths < 0.0)
    if len(left):
        depths = np.zeros(graph.number.shape, dtype=np.float32)
        depths[tuple(graph.places(left).T)] = graph.depths[left]
        parts, count = label(depths > 0.0, np.ones((3, 3, 3)))
        sizes = np.bincount(parts.ravel())[1:]
        places = np.array(maximum_position(depths, parts, np.arange(1, count + 1)))
        for k in np.argsort(-sizes, kind="stable"):
            place, size = field.to_world(places[k] * field.spacing), float(sizes[k]) * volume
            message = (
                f"a loose part of {size:.3g} mm^3 at ({_show(place)}) mm is not joined with the "
                "tree: it is not followed"
            )
            found.append(_find("loose-part", message, "", place, size))
    corner = graph.places(np.flatnonzero(skeleton.lengths >= 0.0)).min(axis=0) - 1
    for voxel, cells in find_holes(skeleton.reached):
        place, size = field.to_world((corner + voxel) * field.spacing), cells * volume
        message = f"the lumen has a hole of {size:.3g} mm^3 at ({_show(place)}) mm, taken as wall"
        found.append(_find("hole", message, "", place, size))
    return found


def _find(code: str, message: str, branch: str, place: Floats, size: float) -> TreeFinding:
    x, y, z = (float(value) for value in place)
    return TreeFinding(code, "warning", message, branch, (x, y, z), size)


def _list_names(branches: Sequence[Branch]) -> str:
    return "branch " + " and ".join(sorted({f"'{branch.name}'" for branch in branches}))


def _show(place: Floats) -> str:
    return ", ".join(f"{value:.1f}" for value in place)


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
