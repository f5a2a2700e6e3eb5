"""The centreline of a lumen: minimum-cost path through the distance field, then smoothed inside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number, check_points, check_range, floor_mm, show_value
from ..errors import GeometryError, InputError
from ..numeric.polylines import interpolate_polyline, measure_arc_length, resample_polyline
from ..progress import Progress, no_progress
from ..results import show_briefly, take_axes
from .base import Duct, SampledField
from .groups import (
    COST_POWER,
    COVERED,
    CREST_AHEAD,
    CREST_NEXT,
    Flood,
    LumenWay,
    NodeGroups,
    Numbers,
    measure_tip,
)
from .shapes.cones import RoundCones
from .shapes.cylinders import ConnectedCylinders

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# The nodes of a lumen as a graph: ends located, paths found, tips measured.

LAST_WAY = 1e4
"""So many times as much costs a place that is to be avoided."""


class Region:
    """The voxels of a label, in the grid frame: which points lie in it."""

    def __init__(self, centres: NDArray[np.float64], spacing: NDArray[np.float64]) -> None:
        step = spacing.copy()
        for axis in range(3):
            gaps = np.diff(np.unique(centres[:, axis]))
            gaps = gaps[gaps > 0.05 * spacing[axis]]
            step[axis] = gaps.min() if len(gaps) else spacing[axis]
        low = centres.min(axis=0)
        index = (centres - low) / step
        if np.abs(index - np.rint(index)).max() > 0.1 or np.prod(index.max(axis=0) + 1.0) > 2e8:
            # Not the centres of voxels: take the nodes of the field that are nearest.
            step, low = spacing, np.rint(low / spacing) * spacing
            index = np.maximum((centres - low) / step, 0.0)
        nodes = np.rint(index).astype(int)
        self.low, self.step = low, step
        self.mask = np.zeros(nodes.max(axis=0) + 1, dtype=bool)
        self.mask[tuple(nodes.T)] = True

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether points (n, 3) of the grid frame lie in one of the voxels."""
        # A little less than half a voxel: whoever rounds the point again finds the same voxel.
        scaled = (points - self.low) / self.step
        index = np.rint(scaled).astype(int)
        within = np.all((index >= 0) & (index < self.mask.shape), axis=1)
        within &= np.abs(scaled - index).max(axis=1) < 0.499
        within[within] = self.mask[tuple(index[within].T)]
        return np.asarray(within)


@dataclass(frozen=True, kw_only=True, eq=False)
class ShortestPaths:
    """The least costs from some nodes to all others of the lumen, and the paths."""

    graph: LumenGraph
    costs: NDArray[np.float64]
    before: NDArray[np.int32]

    def __getitem__(self, node: tuple[int, ...] | NDArray[np.int64]) -> float:
        """Return the cost of the path to a node; infinite where there is none."""
        number = int(self.graph.number[tuple(node)])
        return float(self.costs[number]) if number >= 0 else float("inf")

    def traceback(self, node: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the path (n, 3) to a node."""
        path = [int(self.graph.number[tuple(node)])]
        while self.before[path[-1]] >= 0:
            path.append(int(self.before[path[-1]]))
        return self.graph.places(np.array(path[::-1]))


class LumenGraph:
    """The lumen's nodes as a graph: each with its 26 neighbours.

    Attributes
    ----------
    nodes : (n,) int64
        Flat indices of the lumen's nodes.
    number : (nx, ny, nz) int32
        Which of them a node of the grid is; -1 outside the lumen.
    depths : (n,) float32
        Their clearance [mm].
    weights : (n,) float
        What a mm of path costs there.
    """

    def __init__(self, field: SampledField) -> None:
        from .kernels.graph import number_nodes

        # The topology is that of the lumen before inflation, where it has one at this voxel.
        self.field = field.inflate(-field.inflation)
        values = self.field.values
        self.number = np.full(values.shape, -1, dtype=np.int32)
        self.nodes = np.empty(0, dtype=np.int64)
        count = number_nodes(values, 0.0, self.number, self.nodes)
        self.nodes = np.empty(count, dtype=np.int64)
        number_nodes(values, 0.0, self.number, self.nodes)
        self.depths = -values.reshape(-1)[self.nodes]
        floor = 0.25 * float(self.field.spacing.min())
        self.weights = (np.maximum(self.depths.astype(float), floor) / 10.0) ** -COST_POWER

    @cached_property
    def groups(self) -> NodeGroups:
        """The same on a coarser grid."""
        return NodeGroups(self.number, self.nodes, self.depths, self.field.spacing)

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Which nodes of the grid are in the lumen (nx, ny, nz)."""
        return self.number >= 0

    def places(self, numbers: NDArray[np.int64] | None = None) -> NDArray[np.int64]:
        """Return grid indices (k, 3) of nodes by their numbers; by default of all."""
        flat = self.nodes if numbers is None else self.nodes[numbers]
        return np.stack(np.unravel_index(flat, self.number.shape), axis=1)

    def locate_region(self, name: str, centres: NDArray[np.float64] | None) -> Region | None:
        """Turn the voxels of a label into a region, or None if they cover the whole lumen."""
        if centres is None:
            return None
        field = self.field
        region = Region(field.to_grid(check_points(name, centres)), field.spacing)
        return None if region.contains(self.places() * field.spacing).all() else region

    def locate(
        self, name: str, point: ArrayLike | None, region: Region | None
    ) -> NDArray[np.int64] | None:
        """Turn an end into candidate nodes (k, 3), or None if it is to be found."""
        field = self.field
        if point is not None:
            position = check_points(name, point)
            if position.shape != (3,):
                raise InputError(f"{name} has shape {position.shape}: it must be (3,)")
            distance = float(field.signed_distance(position))
            if distance >= 0.0:
                raise GeometryError(
                    f"{name} ({', '.join(f'{v:g}' for v in position)}) mm lies outside the lumen "
                    f"by {_format_distance(field, distance)}: give a point inside it, or leave it "
                    "out"
                )
            node = np.rint(field.to_grid(position) / field.spacing).astype(int)
            return self._nearest_inside(node)[None]
        if region is not None:
            nodes = self.places()
            nodes = nodes[region.contains(nodes * field.spacing)]
            if len(nodes) == 0:
                raise GeometryError(
                    f"{name}: no node of the grid lies in that label, use a smaller --voxel"
                )
            return np.asarray(nodes)
        return None

    def _nearest_inside(self, node: NDArray[np.int64]) -> NDArray[np.int64]:
        low = np.maximum(node - 3, 0)
        block = self.number[tuple(slice(a, b + 4) for a, b in zip(low, node, strict=True))] >= 0
        candidates = np.argwhere(block) + low
        if len(candidates) == 0:
            raise GeometryError("no node of the field near that end: use a smaller --voxel")
        gaps = np.linalg.norm((candidates - node) * self.field.spacing, axis=1)
        return np.asarray(candidates[int(np.argmin(gaps))])

    def search(self, source: Numbers, near: NDArray[np.bool_] | None = None) -> ShortestPaths:
        """Minimum-cost paths from nodes (3,) or (k, 3) to all others, or all that are `near`."""
        from .kernels.graph import find_costs

        costs = np.full(len(self.nodes), np.inf)
        before = np.full(len(self.nodes), -1, dtype=np.int32)
        weights = self.weights if near is None else np.where(near, self.weights, np.inf)
        arguments = (self.number, self.nodes, weights, self.field.spacing)
        find_costs(*arguments, self._number(source), costs, before)
        return ShortestPaths(graph=self, costs=costs, before=before)

    def avoid(self, numbers: NDArray[np.int64]) -> None:
        """Make paths take the places of nodes (k,) and what is beside them only as a last way."""
        places = self.places() * self.field.spacing
        beside = 1.5 * float(self.field.spacing.max())
        for here in numbers:
            away = np.linalg.norm(places - places[here], axis=1)
            self.weights[away <= self.depths[here] + beside] *= LAST_WAY

    def measure_lengths(self, source: NDArray[np.int64]) -> NDArray[np.float64]:
        """Length (n,) of the shortest path from nodes (3,) or (k, 3) to all nodes [mm]."""
        from .kernels.graph import find_lengths

        lengths = np.full(len(self.nodes), np.inf)
        find_lengths(self.number, self.nodes, self.field.spacing, self._number(source), lengths)
        return lengths

    def find_deepest(self) -> NDArray[np.int64]:
        """Return the node (3,) with the most clearance."""
        return np.asarray(self.places(np.array([int(np.argmax(self.depths))]))[0])

    def find_remotest(self, source: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the node (3,) with the longest taut path from `source`."""
        lengths = self.measure_lengths(source)
        farthest = int(np.argmax(np.where(np.isfinite(lengths), lengths, -1.0)))
        return np.asarray(self.places(np.array([farthest]))[0])

    def _number(self, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        index = np.atleast_2d(np.asarray(nodes, dtype=np.int64))
        return np.asarray(self.number[tuple(index.T)], dtype=np.int64)

    def find_path(self, start: Numbers, goal: Numbers) -> Numbers:
        """Minimum-cost path (n, 3) of nodes that keeps to the middle.

        It is sought in the groups of nodes on the coarse way, and beside them.
        """
        first, last = (int(self.groups.groups[self._number(end)[0]]) for end in (start, goal))
        flood = self.groups.flood(first)
        if flood.lengths[last] < 0.0:
            raise GeometryError(self._explain_apart(start, goal))
        return self._follow(flood.trace(last), start, goal)

    def _follow(self, way: Numbers, start: Numbers, goal: Numbers) -> Numbers:
        """Return the path of nodes along a way of groups."""
        near = self.groups.widen(way)[self.groups.groups]
        return self.search(start, near).traceback(goal)

    def draw_way(self, way: LumenWay) -> NDArray[np.float64]:
        """Return a way (n, 3) as a centreline has it, without the closed tips that were found."""
        if len(way.groups) < 2:
            return way.path
        ends = self.places(self.groups.nodes[way.groups[[0, -1]]].astype(np.int64))
        points = self._follow(way.groups, *ends) * self.field.spacing
        tips = (self.measure_tip(points) if way.both else 0.0, self.measure_tip(points[::-1]))
        points = _cut_ends(points, *tips)
        return _smooth(points, self) if len(points) > 1 else points

    def measure_tip(self, points: NDArray[np.float64]) -> float:
        """Return the length of path (n, 3) in the closed tip that it starts in [mm]."""
        return measure_tip(points, self.measure_depth(points), float(self.field.spacing.max()))

    def measure_taut(self, way: LumenWay) -> float:
        """Return the length of a way that cuts corners [mm]."""
        points = self.draw_way(way)
        return float(measure_arc_length(points)[-1]) if len(points) > 1 else 0.0

    def choose_longest(self, ways: Sequence[LumenWay]) -> LumenWay:
        """Return the longest way, as it is with the corners of forks cut."""
        ways = sorted(ways, key=lambda way: -way.length)
        rivals = [way for way in ways if way.length >= RIVAL_SHARE * ways[0].length]
        if len(rivals) == 1:
            return rivals[0]
        return max(rivals[:RIVALS_MAX], key=self.measure_taut)

    def find_farthest(self, source: Numbers, among: Numbers | None) -> Numbers:
        """Find the node (of `among`) whose middle path from nodes (k, 3) is the longest."""
        groups = self.groups
        allowed = None if among is None else self._number(among)
        flood = groups.flood(groups.groups[self._number(source)].astype(np.int64))
        tips = groups.find_tips(
            flood, None if allowed is None else groups.groups[allowed].astype(np.int64)
        )
        if not tips:
            raise GeometryError(self._explain_apart(source, among))
        tip = self.choose_longest(tips)
        node = int(groups.nodes[tip.groups[-1]])
        if allowed is not None:
            own = allowed[groups.groups[allowed] == tip.groups[-1]]
            gaps = np.linalg.norm(self.places(own) - self.places(np.array([node])), axis=1)
            node = int(own[np.argmin(gaps)])
        return np.asarray(self.places(np.array([node]))[0])

    def find_ends(self) -> Numbers:
        """Return the nodes (2, 3) at both ends of the longest path through the lumen.

        In a tree an end of the longest path is farthest from wherever one begins, and all that may
        be one is about as far from one of its ends.
        """
        groups = self.groups
        first = groups.find_tips(groups.flood(int(np.argmax(groups.depths))))[0].groups[-1]
        ends: dict[int, Flood] = {}
        for _ in range(2):
            ends[first] = groups.flood(first)
            tips = groups.find_tips(ends[first])
            far = [tip for tip in tips if tip.length >= BRANCH_SHARE * tips[0].length]
            for tip in far[:RIVALS_MAX]:
                apart = 2.0 * COVERED * tip.width + groups.size
                if all(flood.lengths[tip.groups[-1]] > apart for flood in ends.values()):
                    ends[tip.groups[-1]] = groups.flood(tip.groups[-1])
            first = tips[0].groups[-1]
        pairs = combinations(ends, 2)
        ways = [groups.make_way(ends[one].trace(two), both=True) for one, two in pairs]
        if not ways:  # one ball
            return self.places(groups.nodes[[first, first]].astype(np.int64))
        way = self.choose_longest(ways)
        return self.places(groups.nodes[way.groups[[0, -1]]].astype(np.int64))

    def _explain_apart(self, start: NDArray[np.int64], goal: NDArray[np.int64] | None) -> str:
        """Explain where the lumen is closed between nodes, or sets of them, that no path joins."""
        from scipy.spatial import cKDTree

        text = "start and end are not connected inside the lumen at this grid"
        if goal is None:
            return text
        spacing = self.field.spacing
        wall = self.depths < 2.0 * float(spacing.max())
        sides = [
            self.places(np.flatnonzero(np.isfinite(self.measure_lengths(end)) & wall)) * spacing
            for end in (start, goal)
        ]
        gaps, nearest = cKDTree(sides[0]).query(sides[1])
        at = int(np.argmin(gaps))
        middle = self.field.to_world(0.5 * (sides[0][nearest[at]] + sides[1][at]))
        place = ", ".join(f"{value:.1f}" for value in middle)
        text += f": a wall closes it between them, its two sides are nearest at ({place}) mm"
        if gaps[at] <= 3.0 * float(spacing.max()):
            text += (
                f"; a passage there narrower than {float(spacing.max()):.2g} mm may be found with "
                "a smaller --voxel"
            )
        return text

    def measure_depth(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance to the wall at points (n, 3) of the grid frame, before inflation [mm]."""
        return -self.field.signed_distance(self.field.to_world(points))

    def measure_slope(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Direction (n, 3) of growing clearance, grid frame."""
        return -self.field.gradient(self.field.to_world(points)) @ self.field.rotation


def _format_distance(field: SampledField, distance: float) -> str:
    """Name how far outside a point lies; beyond its reach the field only knows "at least"."""
    known = distance < field.reach - field.error
    return f"{distance:.1f} mm" if known else f"at least {floor_mm(distance - field.error, 1)} mm"


SPACING = 1.0
"""Distance between the points of a centreline [mm]; less in a narrow lumen."""

SPACING_SHARE = 0.12
"""The same by the radius of the lumen along the path, if that is less; but at least a voxel. So
far apart are points while they are smoothed."""

BRANCH_SHARE = 0.8
"""An end that was not taken is reported if it is about as far, or if none is as wide."""

RIVAL_SHARE, RIVALS_MAX = 0.85, 8
"""Of so many ways at most that are about the longest, each is smoothed and measured."""

WIDER = 1.2
"""An end that is so many times as wide as both that were taken may be one, wherever it lies."""

SMOOTH_SWEEPS, KEEP = (120, 40), 0.95
"""How often a path of nodes is smoothed, and the share of its clearance that it keeps."""


@dataclass(frozen=True, kw_only=True)
class OtherEnd:
    """An end of the lumen that was not taken, though it lies about as far as the one that was.

    Parameters
    ----------
    end : {"start", "end"}
        Which end of the centreline it could be instead.
    point : (float, float, float)
        World frame [mm], inside the lumen.
    distance : float
        Length of the middle path to it from the opposite end of the centreline [mm].
    """

    end: str
    point: tuple[float, float, float]
    distance: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Centreline:
    """An ordered curve inside a lumen.

    Parameters
    ----------
    points : (n, dim) float
        World frame [mm], from the start to the end.
    arc_length : (n,) float
        Along the polyline, from 0 [mm].
    radius : (n,) float
        Inscribed radius: distance to the (inflated) wall [mm].
    other_ends : tuple of OtherEnd
        Where else an end that was found, not given, could be.
    """

    __repr__ = show_briefly

    points: NDArray[np.float64]
    arc_length: NDArray[np.float64]
    radius: NDArray[np.float64]
    other_ends: tuple[OtherEnd, ...] = ()

    @classmethod
    def from_points(cls, points: ArrayLike, duct: Duct, *, spacing: float = SPACING) -> Centreline:
        """Take a given path through a duct as its centreline.

        Parameters
        ----------
        points : (n, dim) float
            World frame [mm], from the start to the end. They stay; on longer segments points are
            put in between.
        duct : Duct
            The lumen, 3-D or planar.
        spacing : float
            Neighbouring points are at most this far apart [mm].

        Raises
        ------
        InputError
            If there are fewer than two different points, or they do not have the duct's
            dimension.
        GeometryError
            If the path leaves the duct, with the place.
        """
        dim = duct.dim
        given = check_points("points", points, dim=dim)
        check_number("spacing", spacing, low=0.0, low_open=True, unit="mm")
        if given.ndim != 2 or len(given) < 2:
            raise InputError(f"points has shape {given.shape}: it must be (n, {dim}), n at least 2")
        steps = np.linalg.norm(np.diff(given, axis=0), axis=1)
        if steps.min() <= 0.0:
            index = int(np.argmin(steps))
            raise InputError(f"points {index} and {index + 1} are the same: the path stands still")
        counts = np.ceil(steps / spacing - 1e-9).astype(int)
        parts = [
            given[k] + np.arange(count)[:, None] / count * (given[k + 1] - given[k])
            for k, count in enumerate(counts)
        ]
        dense = np.concatenate([*parts, given[-1:]])
        radius = -duct.signed_distance(dense)
        if radius.min() <= 0.0:
            index = int(np.argmin(radius))
            place = ", ".join(f"{value:g}" for value in dense[index])
            raise GeometryError(
                f"the path leaves the duct at ({place}) mm, by {-radius[index]:.2f} mm"
            )
        return cls(points=dense, arc_length=measure_arc_length(dense), radius=radius)

    @property
    def length(self) -> float:
        """Length of the curve [mm]."""
        return float(self.arc_length[-1])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the inscribed radius over the arc length and return the axes."""
        ax = take_axes(ax, x="arc length [mm]", y="inscribed radius [mm]")
        ax.plot(self.arc_length, self.radius)
        return ax

    def cut(self, length: float) -> Centreline:
        """Return the curve's first `length` mm."""
        inner = self.arc_length < length - 1e-9
        arc = np.append(self.arc_length[inner], min(length, self.length))
        points = interpolate_polyline(self.points, self.arc_length, arc)
        radius = np.interp(arc, self.arc_length, self.radius)
        return Centreline(points=points, arc_length=arc, radius=radius)

    def reverse(self) -> Centreline:
        """Return the same curve from its end to its start."""
        return Centreline(
            points=self.points[::-1].copy(),
            arc_length=self.length - self.arc_length[::-1],
            radius=self.radius[::-1].copy(),
            other_ends=_swap_ends(self.other_ends),
        )


def _swap_ends(others: tuple[OtherEnd, ...]) -> tuple[OtherEnd, ...]:
    return tuple(replace(o, end="start" if o.end == "end" else "end") for o in others)


def find_centreline(
    field: SampledField,
    ends: tuple[ArrayLike | None, ArrayLike | None] = (None, None),
    *,
    regions: tuple[NDArray[np.float64] | None, NDArray[np.float64] | None] = (None, None),
    via: Sequence[NDArray[np.float64]] = (),
    progress: Progress = no_progress,
) -> Centreline:
    """Find the centreline between two ends of a lumen.

    The path minimises the integral of ``1 / clearance**2.5`` over the grid graph, in the lumen
    before inflation, so that inflation never opens a short cut between neighbouring folds. It is
    then smoothed under tension and pushed back wherever it would lose clearance.

    Parameters
    ----------
    field : SampledField
        The lumen.
    ends : pair of (3,) float or None
        Start and end in the world frame [mm]. None: found as the ends of the longest path through
        the lumen; the one with the larger world z is the start. Which end a scope enters by is
        for the caller to know (`Centreline.reverse`).
    regions : pair of (k, 3) float or None
        Centres of the voxels of a label that an end lies in, for an end that is not given as a
        point: the place in it farthest from the other end is taken. An end that is not given at
        all is sought far from the other one's label. A label that covers the whole lumen does
        not state where an end is.
    via : sequence of (3,) or (k, 3) float
        Places that the path goes through in this order, from start to end: points in
        the world frame [mm], or the centres of the voxels of a label. The smoothed line passes
        them within its smoothing, a few mm.

    Raises
    ------
    InputError
        If `field` is no sampled field.
    GeometryError
        If an end lies outside the lumen, the ends are not connected, or an end is to be found and
        the lumen is no tube.
    """
    if not isinstance(field, SampledField):
        raise InputError(
            f"field is a {type(field).__name__}: it must be a SampledField, which build_field "
            "makes of a tract and sample() of a duct"
        )
    try:
        start_given, end_given = ends
    except (TypeError, ValueError):
        raise InputError(
            f"ends is {show_value(ends)}: it must be a pair of points (3,) or None"
        ) from None
    progress("centreline", 0.0)
    graph = LumenGraph(field)
    areas = (graph.locate_region("start", regions[0]), graph.locate_region("end", regions[1]))
    start_nodes = graph.locate("start", start_given, areas[0])
    end_nodes = graph.locate("end", end_given, areas[1])
    start, goal = _choose_ends(graph, start_nodes, end_nodes)
    progress("centreline", 0.6)
    nodes = _find_path_via(graph, start, goal, via)
    points = _trim_path(graph, nodes * field.spacing, ends, areas)
    progress("centreline", 0.8)
    others: list[OtherEnd] = []
    found = {"start": start_nodes is None, "end": end_nodes is None}
    if found["end"]:
        others += _find_other_ends(graph, "end", start, points, found=found["start"])
    if found["start"]:
        others += _find_other_ends(graph, "start", goal, points, found=found["end"], known=others)
    if start_nodes is None and end_nodes is None:
        ends_z = field.to_world(points[[0, -1]])[:, 2]
        if ends_z[0] < ends_z[1]:
            points = points[::-1]
            others = list(_swap_ends(tuple(others)))
    world = field.to_world(points)
    radius = -field.signed_distance(world)
    progress("centreline", 1.0)
    return Centreline(
        points=world,
        arc_length=measure_arc_length(world),
        radius=radius,
        other_ends=tuple(others),
    )


def _find_path_via(
    graph: LumenGraph,
    start: NDArray[np.int64],
    goal: NDArray[np.int64],
    via: Sequence[NDArray[np.float64]],
) -> NDArray[np.int64]:
    """Return the nodes (n, 3) of the path from `start` through all places to `goal`."""
    if not via:
        return graph.find_path(start, goal)
    from scipy.spatial import cKDTree

    stops = [start]
    for number, place in enumerate(via, start=1):
        name = f"via {number}"
        if place.ndim == 1:
            found = graph.locate(name, place, None)
        else:
            found = graph.locate(name, None, graph.locate_region(name, place))
        if found is None:  # a label that covers the whole lumen
            continue
        if len(found) > 1:
            # Of a label the places nearest to the path so far, and of those the one in the middle.
            spacing = graph.field.spacing
            path = graph.find_path(stops[-1], goal)
            gaps = cKDTree(path * spacing).query(found * spacing)[0]
            near = found[gaps <= gaps.min() + 3.0 * float(spacing.max())]
            found = near[[int(np.argmax(graph.measure_depth(near * spacing)))]]
        stops.append(found[0])
    stops.append(goal)
    legs = [graph.find_path(a, b) for a, b in pairwise(stops) if not np.array_equal(a, b)]
    return np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])]) if legs else goal[None]


def _trim_path(
    graph: LumenGraph,
    points: NDArray[np.float64],
    ends: tuple[ArrayLike | None, ArrayLike | None],
    areas: tuple[Region | None, Region | None],
) -> NDArray[np.float64]:
    """Smooth a path of nodes from end to end, without the closed tips of ends that were found."""
    field = graph.field
    fixed = (ends[0] is not None, ends[1] is not None)
    if all(fixed) and len(points) < 2:
        points = np.repeat(points, 2, axis=0)
    for position, end in ((0, ends[0]), (-1, ends[1])):
        if end is not None:
            points[position] = field.to_grid(check_points("end", end))
    cuts = []
    for end, area, path in ((ends[0], areas[0], points), (ends[1], areas[1], points[::-1])):
        cut = 0.0 if end is not None else graph.measure_tip(path)
        if cut > 0.0 and area is not None:
            arc = measure_arc_length(path)
            left = np.flatnonzero(~area.contains(path[: int(np.searchsorted(arc, cut)) + 1]))
            cut = float(arc[max(0, int(left[0]) - 1)]) if len(left) else cut
        cuts.append(cut)
    kept = _cut_ends(points, *cuts)
    length = float(measure_arc_length(kept)[-1]) if len(kept) > 1 else 0.0
    most = float(graph.measure_depth(points).max())
    if all(fixed):
        if length <= 0.0:
            raise GeometryError("start and end are the same point: no centreline between them")
    elif length < most:
        raise GeometryError(
            f"no tube was found in the lumen: the path through it is {length:.1f} mm long between "
            f"its tips, and it is {2.0 * most:.1f} mm wide; give both --start and --end as points "
            "inside it"
        )
    return _smooth(kept, graph)


def _cut_ends(points: NDArray[np.float64], first: float, last: float) -> NDArray[np.float64]:
    """Return a path without so much of its length at both ends; one point if none is left."""
    arc = measure_arc_length(points)
    stop = float(arc[-1]) - last
    if stop <= first:
        return points[:1]
    inner = arc[(arc > first + 1e-9 * stop) & (arc < stop - 1e-9 * stop)]
    return interpolate_polyline(points, arc, np.concatenate([[first], inner, [stop]]))


def _choose_spacing(graph: LumenGraph, radius: float) -> float:
    return min(SPACING, max(float(graph.field.spacing.min()), SPACING_SHARE * radius))


def find_clear_path(
    field: SampledField, start: ArrayLike, goal: ArrayLike, *, clearance: float
) -> NDArray[np.float64] | None:
    """Find a path (n, 3) along nodes that all have at least `clearance`, near the middle.

    Parameters
    ----------
    start, goal : (3,) float
        World frame [mm]; they become the ends.
    clearance : float
        Clearance in the inflated lumen [mm]. The path stays in the lumen before inflation.

    Returns
    -------
    (n, 3) float or None
        World frame [mm]; None if the grid has no such path.
    """
    graph = LumenGraph(field)
    free = graph.depths + field.inflation >= clearance
    graph.weights = np.where(free, graph.weights, np.inf)
    places = graph.places()
    nodes = []
    for point in (start, goal):
        near = np.rint(field.to_grid(point) / field.spacing).astype(int)
        block = places[np.all(np.abs(places - near) <= 2, axis=1) & free]
        if len(block) == 0:
            return None
        nodes.append(block[int(np.argmin(np.linalg.norm(block - near, axis=1)))])
    search = graph.search(nodes[0])
    if not np.isfinite(search[nodes[1]]):
        return None
    middle = field.to_world(search.traceback(nodes[1]) * field.spacing)
    return np.concatenate(
        [np.asarray(start, dtype=np.float64)[None], middle[1:-1], np.asarray(goal)[None]]
    )


def _choose_ends(
    graph: LumenGraph, start: Numbers | None, goal: Numbers | None
) -> tuple[Numbers, Numbers]:
    """Settle the ends that are open: as far as possible from the other one."""
    if start is None and goal is None:
        first, second = graph.find_ends()
        return first, second
    if start is not None and len(start) == 1:
        known = goal is not None and len(goal) == 1
        return start[0], goal[0] if goal is not None and known else graph.find_farthest(start, goal)
    if goal is None:
        return _choose_ends(graph, goal, start)[::-1]
    # From the whole label, so that an end that is not given lies far from all of it.
    first = graph.find_farthest(goal, start)
    second = graph.find_farthest(first[None], goal)
    return (first if start is None else graph.find_farthest(second[None], start)), second


def _find_other_ends(
    graph: LumenGraph,
    name: str,
    source: Numbers,
    points: NDArray[np.float64],
    *,
    found: bool,
    known: Sequence[OtherEnd] = (),
) -> list[OtherEnd]:
    """Return the ends of the lumen that could be the end `name` as well as the one that was taken.

    They lie about as far from the opposite end `source`, which may be one that was `found`, or one
    of them is the widest of all; and beyond the wall of the line (n, 3), of each other's paths and
    of those that are known.
    """
    from scipy.spatial import cKDTree

    groups = graph.groups
    flood = groups.flood(int(groups.groups[graph._number(source)[0]]))
    tips = groups.find_tips(flood)
    ends = graph.measure_depth(points[[0, -1]])
    widest = max(tips, key=lambda tip: tip.width)
    taken = [points]
    taken += [graph.field.to_grid(np.array([other.point])) for other in known]
    others = []
    for tip in sorted(tips, key=lambda tip: -tip.length):
        far = tip.length >= BRANCH_SHARE * tips[0].length
        if not far and not (tip is widest and tip.width > WIDER * ends.max()):
            continue
        before = np.concatenate(taken)
        gap, nearest = cKDTree(before).query(tip.path[-1])
        depth = float(graph.measure_depth(before[[nearest]])[0])
        if gap < COVERED * depth + tip.width:
            continue
        taken.append(tip.path)
        way = graph.draw_way(groups.make_way(flood.trace(tip.groups[-1]), both=found))
        x, y, z = (float(v) for v in graph.field.to_world(way[-1]))
        distance = float(measure_arc_length(way)[-1])
        others.append(OtherEnd(end=name, point=(x, y, z), distance=distance))
    return others


def _smooth(points: NDArray[np.float64], graph: LumenGraph) -> NDArray[np.float64]:
    """Smooth a path of nodes; where that loses clearance against the path itself, push it back."""
    from .kernels.line import smooth_path

    spacing = _choose_spacing(graph, float(np.median(graph.measure_depth(points))))
    points = resample_polyline(points, spacing)
    for sweeps in SMOOTH_SWEEPS:
        target = KEEP * graph.measure_depth(points)
        target = np.minimum(target, _running_minimum(target, 3))
        smooth_path(graph.field.pack(), points, target, 0.5 * spacing, sweeps)
        points = resample_polyline(points, spacing)
    return _stay_inside(points, graph)


def _running_minimum(values: NDArray[np.float64], half: int) -> NDArray[np.float64]:
    from scipy.ndimage import minimum_filter1d

    return np.asarray(minimum_filter1d(values, 2 * half + 1))


def _stay_inside(points: NDArray[np.float64], graph: LumenGraph) -> NDArray[np.float64]:
    """Push any point that smoothing left outside the lumen back in, or raise with the place."""
    inner = 0.1 * min(1.0, float(graph.field.spacing.min()))
    for _ in range(50):
        depth = graph.measure_depth(points)
        bad = depth <= 0.0
        if not bad.any():
            return points
        points[bad] += (inner - depth[bad])[:, None] * graph.measure_slope(points[bad])
    worst = int(np.argmin(graph.measure_depth(points)))
    place = graph.field.to_world(points[worst])
    raise GeometryError(
        f"the centreline leaves the lumen near ({', '.join(f'{v:.1f}' for v in place)}) mm: "
        "the lumen is thinner than the grid there, use a smaller --voxel"
    )


WINDOW_MM = 2.0
"""The direction of a centreline is taken over this much on either side [mm]."""


def find_tangents(centreline: Centreline, arc: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, 3) directions of a centreline at arc lengths (n,), over a short stretch."""
    window = min(WINDOW_MM, 0.5 * centreline.length)
    ahead, back = (
        interpolate_polyline(
            centreline.points,
            centreline.arc_length,
            np.clip(arc + step, 0.0, centreline.length),
        )
        for step in (window, -window)
    )
    sizes = np.linalg.norm(ahead - back, axis=1)
    if sizes.min() <= 0.0:
        index = int(np.argmin(sizes))
        raise GeometryError(f"the centreline turns back on itself at {arc[index]:.1f} mm")
    return np.asarray((ahead - back) / sizes[:, None])


# A path moved to where a duct itself has more clearance, not only the grid that it was found on.

STEPS = (1.0, 1.0, 0.5, 0.5, 0.25, 0.25, 0.12, 0.06)
"""How far points are moved across the path, one after the other [mm]."""

DIRECTIONS = 12

SHARE = 1.25
"""So many times the least clearance, or more, a point may have less of after smoothing."""


def widen_line(line: Centreline, duct: Duct) -> Centreline:
    """Return a path between the same ends with more clearance where it is tight, if one is near.

    Points move across the path to where the duct has more clearance, and are smoothed where that
    does not make a tight place tighter.

    Parameters
    ----------
    line : Centreline
        In space, inside the duct or nearly so.
    duct : Duct
        Its clearance is the negative of its signed distance.

    Raises
    ------
    GeometryError
        If the path found leaves the duct, with the place.
    """
    points = line.points.copy()
    turn = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    around = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    clearance = -duct.signed_distance(points)
    for step in STEPS:
        places = points[1:-1, None] + step * around @ _find_axes(points)[1:-1]
        found = -duct.signed_distance(places)
        best = found.argmax(axis=1)
        better = np.take_along_axis(found, best[:, None], axis=1)[:, 0] > clearance[1:-1]
        chosen = places[np.arange(len(places)), best]
        points[1:-1] = np.where(better[:, None], chosen, points[1:-1])
        clearance = -duct.signed_distance(points)
        enough = SHARE * float(clearance.min())
        for _ in range(3):
            smooth = points.copy()
            smooth[1:-1] = 0.5 * points[1:-1] + 0.25 * (points[:-2] + points[2:])
            left = -duct.signed_distance(smooth)
            keep = left >= np.minimum(clearance, enough)
            points[keep], clearance[keep] = smooth[keep], left[keep]
    wider = Centreline.from_points(resample_polyline(points, SPACING), duct)
    if wider.radius.min() <= float(-duct.signed_distance(line.points).max()):
        return Centreline.from_points(line.points, duct)
    return wider


def _find_axes(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return two axes (n, 2, 3) across a path at each of its points."""
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    helper = np.eye(3)[np.abs(along).argmin(axis=1)]
    one = np.cross(along, helper)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return np.stack([one, np.cross(along, one)], axis=1)


REACH = 1e6
"""No coordinate of an end is beyond this [mm]."""

POINTS_MAX = 10_000
"""A very long path has about this many points."""

INSET = 1e-3
"""The path begins this far, as a share of its first step, from the middle of an end's wall."""


def follow_chain(
    chain: RoundCones | ConnectedCylinders,
    ends: tuple[ArrayLike | None, ArrayLike | None] = (None, None),
) -> Centreline:
    """Return the path along the centres of a chain, from its first shape to its last.

    Parameters
    ----------
    chain : RoundCones or ConnectedCylinders
    ends : pair of (3,) float or None
        Start and end inside it [mm]: the path goes between the places of it nearest to them. None:
        the chain's own ends; of cylinders, whose ends are flat walls, so far from these that they
        do not take the clearance away.

    Raises
    ------
    InputError
        If an end has not three coordinates.
    GeometryError
        If an end lies outside, or there is no path: a single ball, or both ends at one place.
    """
    centres = np.asarray(chain.centres, dtype=np.float64)
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    centres = centres[np.concatenate([[True], steps > 0.0])]
    if len(centres) < 2:
        raise GeometryError("the chain is one ball: there is no path along it")
    # In the middle of a flat end there is no clearance yet.
    path = centres.copy()
    path[0] += INSET * (centres[1] - centres[0])
    path[-1] += INSET * (centres[-2] - centres[-1])
    spacing = max(SPACING, float(steps.sum()) / POINTS_MAX)
    line = Centreline.from_points(path, chain, spacing=spacing)
    first, goal = (
        _locate(chain, line, name, end) for name, end in zip(("start", "end"), ends, strict=True)
    )
    tips = _find_tips(chain, line)
    if first is None:
        first = tips[0] if goal is None else _go_far(line, goal, tips)
    if goal is None:
        goal = tips[1] if ends[0] is None else _go_far(line, first, tips)
    if first == goal:
        raise GeometryError(
            "start and end are at the same place of the chain: no path between them"
        )
    kept = line.points[min(first, goal) : max(first, goal) + 1]
    found = Centreline.from_points(kept, chain, spacing=spacing)
    return found if first < goal else found.reverse()


def _find_tips(chain: RoundCones | ConnectedCylinders, line: Centreline) -> tuple[int, int]:
    last = len(line.points) - 1
    if isinstance(chain, RoundCones):  # its ends are balls, with clearance in their middle
        return 0, last
    first = _find_crest(line.arc_length, line.radius)
    other = last - _find_crest(line.length - line.arc_length[::-1], line.radius[::-1])
    return (first, other) if first < other else (0, last)


def _find_crest(arc: NDArray[np.float64], depth: NDArray[np.float64]) -> int:
    """Return where a path out of a flat end first has its width: no grid blurs its clearance."""
    radius = float(np.median(depth))
    for here in range(len(arc)):
        reach = arc[here] + max(2.0 * depth[here], CREST_AHEAD * radius)
        if depth[here] >= 0.8 * depth[here : int(np.searchsorted(arc, reach, "right"))].max():
            near = depth[here : int(np.searchsorted(arc, arc[here] + CREST_NEXT * radius, "right"))]
            return here + int(np.argmax(near > 0.98 * near.max()))
    return 0


def _go_far(line: Centreline, place: int, tips: tuple[int, int]) -> int:
    """Return the one of both tips that is farther along the line."""
    return max(tips, key=lambda tip: abs(line.arc_length[tip] - line.arc_length[place]))


def _locate(
    chain: RoundCones | ConnectedCylinders, line: Centreline, name: str, end: ArrayLike | None
) -> int | None:
    """Return the point of the line nearest to an end that is given."""
    if end is None:
        return None
    point: NDArray[np.float64] = check_points(name, end)
    if point.shape != (3,):
        raise InputError(f"{name} has shape {point.shape}: it must be (3,)")
    check_range(name, point, -REACH, REACH, "mm")
    distance = float(chain.signed_distance(point))
    if distance >= 0.0:
        raise GeometryError(
            f"{name} ({', '.join(f'{v:g}' for v in point)}) mm lies outside the shapes by "
            f"{distance:.1f} mm: give a point inside them, or leave it out"
        )
    return int(np.argmin(np.linalg.norm(line.points - point, axis=1)))
