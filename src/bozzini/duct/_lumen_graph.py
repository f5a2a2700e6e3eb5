"""The nodes of a lumen as a graph: ends located, ways found, tips measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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


class LumenGraph:
    """The lumen's nodes as a graph for `skimage.graph.MCP_Geometric`."""

    def __init__(self, field: SampledField) -> None:
        # The topology is that of the lumen before inflation, where it has one at this voxel.
        self.field = field.inflate(-field.inflation)
        self.room = -self.field.values
        self.inside = self.room > 0.0
        self._last: tuple[Key, Any, NDArray[np.float64]] | None = None
        self._tips: dict[Key, list[Tip]] = {}
        floor = 0.25 * float(self.field.spacing.min())
        self.cost = np.where(
            self.inside, (np.maximum(self.room, floor) / 10.0) ** -COST_POWER, -1.0
        )

    def locate_region(self, name: str, centres: NDArray[np.float64] | None) -> Region | None:
        """Turn the voxels of a label into a region, or None if they cover the whole lumen."""
        if centres is None:
            return None
        field = self.field
        region = Region(field.to_grid(check_points(name, centres)), field.spacing)
        inside = np.argwhere(self.inside)
        return None if region.contains(inside * field.spacing).all() else region

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
                    f"by {distance:.1f} mm: give a point inside it, or leave it out"
                )
            node = np.rint(field.to_grid(position) / field.spacing).astype(int)
            return self._nearest_inside(node)[None]
        if region is not None:
            nodes = np.argwhere(self.inside)
            nodes = nodes[region.contains(nodes * field.spacing)]
            if len(nodes) == 0:
                raise GeometryError(
                    f"{name}: no node of the grid lies in that label, use a smaller --voxel"
                )
            return np.asarray(nodes)
        return None

    def _nearest_inside(self, node: NDArray[np.int64]) -> NDArray[np.int64]:
        low = np.maximum(node - 3, 0)
        block = self.inside[tuple(slice(a, b + 4) for a, b in zip(low, node, strict=True))]
        candidates = np.argwhere(block) + low
        if len(candidates) == 0:
            raise GeometryError("no node of the field near that end: use a smaller --voxel")
        gaps = np.linalg.norm((candidates - node) * self.field.spacing, axis=1)
        return np.asarray(candidates[int(np.argmin(gaps))])

    def search(self, source: NDArray[np.int64]) -> tuple[Any, NDArray[np.float64]]:
        """Minimum-cost paths from nodes (3,) or (k, 3) to all others: the search, and the costs.

        The last one is kept: settling the ends and the path itself often ask for the same.
        """
        from skimage.graph import MCP_Geometric

        key = make_key(source)
        if self._last is None or self._last[0] != key:
            step = tuple(self.field.spacing)
            mcp = MCP_Geometric(self.cost, sampling=step, fully_connected=True)
            self._last = (key, mcp, np.asarray(mcp.find_costs(list(key))[0]))
        return self._last[1], self._last[2]

    def measure_taut(self, source: NDArray[np.int64]) -> NDArray[np.float64]:
        """Length of the shortest way from nodes to every node [mm]; infinite outside."""
        from skimage.graph import MCP_Geometric

        cost = np.where(self.inside, 1.0, -1.0)
        mcp = MCP_Geometric(cost, sampling=tuple(self.field.spacing), fully_connected=True)
        return np.asarray(mcp.find_costs(list(make_key(source)))[0])

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
        taut = self.measure_taut(source)
        reachable = np.isfinite(taut)
        if among is not None:
            allowed = np.zeros_like(reachable)
            allowed[tuple(among.T)] = True
            reachable &= allowed
        if not reachable.any():
            raise GeometryError("start and end are not connected inside the lumen at this grid")
        search, _ = self.search(source)
        tips = []
        for node in self._find_tips(np.where(reachable, taut, -1.0)):
            path = np.array(search.traceback(tuple(int(v) for v in node))) * self.field.spacing
            crest = find_first_crest(path[::-1], self.measure_depth(path)[::-1])
            path = path[: len(path) - crest]
            tips.append(Tip(node=node, path=path, length=float(measure_arc_length(path)[-1])))
        if among is None:
            self._tips[key] = tips
        return tips

    def _find_tips(self, taut: NDArray[np.float64], most: int = 12) -> list[NDArray[np.int64]]:
        """Return the nodes of locally longest taut way, longest first, well apart."""
        left = taut.copy()
        apart = 25.0
        tips: list[NDArray[np.int64]] = []
        floor = 0.5 * float(taut.max())
        while len(tips) < most:
            node = np.array(np.unravel_index(int(np.argmax(left)), left.shape))
            if left[tuple(node)] <= floor and tips:
                break
            tips.append(node)
            reach = np.ceil(apart / self.field.spacing).astype(int)
            low = np.maximum(node - reach, 0)
            left[tuple(slice(a, b + 1) for a, b in zip(low, node + reach, strict=True))] = -1.0
        return tips

    def find_path(self, start: NDArray[np.int64], goal: NDArray[np.int64]) -> NDArray[np.int64]:
        """Minimum-cost path (n, 3) of nodes that keeps to the middle."""
        keys = make_key(start), make_key(goal)
        if self._last is not None and self._last[0] == keys[1] != keys[0]:
            return self.find_path(goal, start)[::-1]
        mcp, costs = self.search(start)
        target = tuple(int(v) for v in goal)
        if not np.isfinite(costs[target]):
            raise GeometryError(
                "start and end are not connected inside the lumen at this grid: use a smaller "
                "--voxel, or other ends"
            )
        return np.array(mcp.traceback(target))

    def measure_depth(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Room at points (n, 3) of the grid frame, before inflation [mm]."""
        return -self.field.signed_distance(self.field.to_world(points))

    def measure_slope(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Direction (n, 3) of growing room, grid frame."""
        return -self.field.gradient(self.field.to_world(points)) @ self.field.rotation


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
