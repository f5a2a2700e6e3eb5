"""The nodes of a lumen as a graph: ends located, ways found, tips measured."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_points
from ..errors import GeometryError, InputError
from .field import SampledField
from .polyline import measure_arc_length

__all__ = ["LumenGraph", "Region", "Tip", "find_first_crest"]

COST_POWER = 2.5
"""The path costs ``length / room**COST_POWER``: enough to keep to the middle of wide places."""

Key = tuple[tuple[int, ...], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Tip:
    """A place of locally longest taut way: its node, the middle way to it, and that one's use."""

    node: NDArray[np.int64]
    path: NDArray[np.float64]
    length: float


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
class Search:
    """The least costs from some nodes to all others of the lumen, and the ways."""

    graph: LumenGraph
    costs: NDArray[np.float64]
    before: NDArray[np.int32]

    def __getitem__(self, node: tuple[int, int, int]) -> float:
        """Return the cost of the way to a node; infinite where there is none."""
        number = int(self.graph.number[node])
        return float(self.costs[number]) if number >= 0 else float("inf")

    def traceback(self, node: tuple[int, ...] | NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the way (n, 3) to a node."""
        way = [int(self.graph.number[tuple(node)])]
        while self.before[way[-1]] >= 0:
            way.append(int(self.before[way[-1]]))
        return self.graph.places(np.array(way[::-1]))


class LumenGraph:
    """The lumen's nodes as a graph: each with its 26 neighbours.

    Attributes
    ----------
    nodes : (n,) int64
        Flat indices of the lumen's nodes.
    number : (nx, ny, nz) int32
        Which of them a node of the grid is; -1 outside the lumen.
    depths : (n,) float32
        Their room [mm].
    weights : (n,) float
        What a mm of way costs there.
    """

    def __init__(self, field: SampledField) -> None:
        from ._graph_kernels import number_nodes

        # The topology is that of the lumen before inflation, where it has one at this voxel.
        self.field = field.inflate(-field.inflation)
        values = self.field.values
        self.number = np.full(values.shape, -1, dtype=np.int32)
        self.nodes = np.empty(0, dtype=np.int64)
        count = number_nodes(values, 0.0, self.number, self.nodes)
        self.nodes = np.empty(count, dtype=np.int64)
        number_nodes(values, 0.0, self.number, self.nodes)
        self.depths = -values.reshape(-1)[self.nodes]
        self._last: tuple[Key, Search] | None = None
        self._tips: dict[Key, list[Tip]] = {}
        floor = 0.25 * float(self.field.spacing.min())
        self.weights = (np.maximum(self.depths.astype(float), floor) / 10.0) ** -COST_POWER

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
                    f"by {_say_distance(field, distance)}: give a point inside it, or leave it out"
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

    def search(self, source: NDArray[np.int64]) -> tuple[Search, Search]:
        """Minimum-cost paths from nodes (3,) or (k, 3) to all others: the search, and the costs.

        The last one is kept: settling the ends and the path itself often ask for the same.
        """
        from ._graph_kernels import find_costs

        key = make_key(source)
        if self._last is None or self._last[0] != key:
            costs = np.full(len(self.nodes), np.inf)
            before = np.full(len(self.nodes), -1, dtype=np.int32)
            arguments = (self.number, self.nodes, self.weights, self.field.spacing)
            find_costs(*arguments, self._number(source), costs, before)
            self._last = (key, Search(graph=self, costs=costs, before=before))
        return self._last[1], self._last[1]

    def measure_lengths(self, source: NDArray[np.int64]) -> NDArray[np.float64]:
        """Length (n,) of the shortest way from nodes (3,) or (k, 3) to all nodes [mm]."""
        from ._graph_kernels import find_lengths

        lengths = np.full(len(self.nodes), np.inf)
        find_lengths(self.number, self.nodes, self.field.spacing, self._number(source), lengths)
        return lengths

    def measure_taut(self, source: NDArray[np.int64]) -> NDArray[np.float32]:
        """Length of the shortest way from nodes to every node of the grid [mm]; else infinite."""
        dense = np.full(self.number.shape, np.inf, dtype=np.float32)
        dense.reshape(-1)[self.nodes] = self.measure_lengths(source)
        return dense

    def find_deepest(self) -> NDArray[np.int64]:
        """Return the node (3,) with the most room."""
        return np.asarray(self.places(np.array([int(np.argmax(self.depths))]))[0])

    def find_remotest(self, source: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the node (3,) with the longest taut way from `source`."""
        lengths = self.measure_lengths(source)
        farthest = int(np.argmax(np.where(np.isfinite(lengths), lengths, -1.0)))
        return np.asarray(self.places(np.array([farthest]))[0])

    def _number(self, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        index = np.atleast_2d(np.asarray(nodes, dtype=np.int64))
        return np.asarray(self.number[tuple(index.T)], dtype=np.int64)

    def farthest(
        self, source: NDArray[np.int64], among: NDArray[np.int64] | None
    ) -> NDArray[np.int64]:
        """Find the node (of `among`) whose middle way from `source` is the longest.

        The taut way is a bad measure of how far an end is: it cuts the bends of a wide lumen, and
        may call a pouch the far end. So the tips, the places of locally longest taut way, are
        compared by the length of their middle way.
        """
        return max(self.measure_tips(source, among), key=lambda tip: tip.length).node

    def measure_tips(
        self, source: NDArray[np.int64], among: NDArray[np.int64] | None = None
    ) -> list[Tip]:
        """Return the tips (of `among`) seen from nodes (3,) or (k, 3), with their middle ways."""
        key = make_key(source)
        if among is None and key in self._tips:
            return self._tips[key]
        with ThreadPoolExecutor(1) as pool:  # the two searches know nothing of each other
            searching = pool.submit(self.search, source)
            lengths = self.measure_lengths(source)
            search, _ = searching.result()
        lengths[~np.isfinite(lengths)] = -1.0
        if among is not None:
            allowed = np.zeros(len(lengths), dtype=bool)
            allowed[self._number(among)] = True
            lengths[~allowed] = -1.0
        if lengths.max() < 0.0:
            raise GeometryError(self._explain_apart(source, among))
        tips = []
        for node in self._find_tips(lengths):
            path = search.traceback(node) * self.field.spacing
            crest = find_first_crest(path[::-1], self.measure_depth(path)[::-1])
            path = path[: len(path) - crest]
            tips.append(Tip(node=node, path=path, length=float(measure_arc_length(path)[-1])))
        if among is None:
            self._tips[key] = tips
        return tips

    def _find_tips(self, lengths: NDArray[np.float64], most: int = 12) -> list[NDArray[np.int64]]:
        """Return the nodes of locally longest taut way, longest first, well apart."""
        apart = 25.0
        reach = np.ceil(apart / self.field.spacing).astype(int)
        left = np.flatnonzero(lengths > 0.5 * float(lengths.max()))
        if len(left) == 0:  # the source is all there is
            left = np.array([int(np.argmax(lengths))])
        places = self.places(left).astype(np.int32)
        tips: list[NDArray[np.int64]] = []
        while len(tips) < most and len(left) > 0:
            tip = places[int(np.argmax(lengths[left]))]
            tips.append(tip.astype(np.int64))
            near = np.ones(len(left), dtype=bool)
            for axis in range(3):
                near &= np.abs(places[:, axis] - tip[axis]) <= reach[axis]
            left, places = left[~near], places[~near]
        return tips

    def find_path(self, start: NDArray[np.int64], goal: NDArray[np.int64]) -> NDArray[np.int64]:
        """Minimum-cost path (n, 3) of nodes that keeps to the middle."""
        keys = make_key(start), make_key(goal)
        if self._last is not None and self._last[0] == keys[1] != keys[0]:
            return self.find_path(goal, start)[::-1]
        search, costs = self.search(start)
        target = tuple(int(v) for v in goal)
        if not np.isfinite(costs[target]):  # type: ignore[index]
            raise GeometryError(self._explain_apart(start, goal))
        return search.traceback(target)

    def _explain_apart(self, start: NDArray[np.int64], goal: NDArray[np.int64] | None) -> str:
        """Say where the lumen is closed between two nodes, or sets of them, that no way joins."""
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
        """Room at points (n, 3) of the grid frame, before inflation [mm]."""
        return -self.field.signed_distance(self.field.to_world(points))

    def measure_slope(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Direction (n, 3) of growing room, grid frame."""
        return -self.field.gradient(self.field.to_world(points)) @ self.field.rotation


def _say_distance(field: SampledField, distance: float) -> str:
    """Name how far outside a point lies; beyond its reach the field only knows "at least"."""
    known = distance < field.reach - field.error
    return f"{distance:.1f} mm" if known else f"at least {distance - field.error:.1f} mm"


def make_key(nodes: NDArray[np.int64]) -> Key:
    return tuple(map(tuple, np.atleast_2d(nodes).tolist()))


def find_first_crest(points: NDArray[np.float64], depth: NDArray[np.float64]) -> int:
    """Index where a path that starts in a closed tip comes out of it.

    That is the first point with at least 0.8 of the room that the path has soon after it (within
    two radii, at least 8 mm), and from there the roomiest within the next 10 mm: an end that was
    only found, not given, need not be a narrow one.
    """
    arc = measure_arc_length(points)
    for here in range(len(points)):
        reach = arc[here] + max(2.0 * depth[here], 8.0)
        ahead = int(np.searchsorted(arc, reach, "right"))
        if depth[here] >= 0.8 * depth[here:ahead].max():
            ahead = int(np.searchsorted(arc, arc[here] + 10.0, "right"))
            return here + int(np.argmax(depth[here:ahead] > 0.98 * depth[here:ahead].max()))
    return 0
