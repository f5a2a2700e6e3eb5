"""The centreline of a lumen: minimum-cost path through the distance field, then smoothed inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number, check_points
from ..errors import GeometryError, InputError
from ..progress import Progress, no_progress
from .field import SampledField
from .protocol import Duct, count_dimensions

__all__ = [
    "Centreline",
    "find_centreline",
    "find_roomy_path",
    "measure_arc_length",
    "resample_polyline",
]

COST_POWER = 2.5
"""The path costs ``length / room**COST_POWER``: enough to keep to the middle of wide places."""

SPACING = 1.0
"""Distance between the points of a centreline [mm]."""


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
    """

    points: NDArray[np.float64]
    arc_length: NDArray[np.float64]
    radius: NDArray[np.float64]

    @classmethod
    def from_points(cls, points: ArrayLike, duct: Duct, *, spacing: float = SPACING) -> Centreline:
        """Take a given way through a duct as its centreline.

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
            If the way leaves the duct, with the place.
        """
        dim = count_dimensions(duct)
        given = check_points("points", points, dim=dim)
        check_number("spacing", spacing, low=0.0, low_open=True, unit="mm")
        if given.ndim != 2 or len(given) < 2:
            raise InputError(f"points has shape {given.shape}: it must be (n, {dim}), n at least 2")
        steps = np.linalg.norm(np.diff(given, axis=0), axis=1)
        if steps.min() <= 0.0:
            index = int(np.argmin(steps))
            raise InputError(f"points {index} and {index + 1} are the same: the way stands still")
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
                f"the way leaves the duct at ({place}) mm, by {-radius[index]:.2f} mm"
            )
        return cls(points=dense, arc_length=measure_arc_length(dense), radius=radius)

    @property
    def length(self) -> float:
        """Length of the curve [mm]."""
        return float(self.arc_length[-1])

    def reverse(self) -> Centreline:
        """Return the same curve from its end to its start."""
        return Centreline(
            points=self.points[::-1].copy(),
            arc_length=self.length - self.arc_length[::-1],
            radius=self.radius[::-1].copy(),
        )


def measure_arc_length(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (n,) arc length along a polyline (n, dim)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def resample_polyline(points: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return points on a polyline at (almost) equal arc length; the ends stay."""
    arc = measure_arc_length(points)
    count = max(2, round(float(arc[-1]) / spacing) + 1)
    wanted = np.linspace(0.0, arc[-1], count)
    return np.stack([np.interp(wanted, arc, column) for column in points.T], axis=1)


def find_centreline(
    field: SampledField,
    ends: tuple[ArrayLike | None, ArrayLike | None] = (None, None),
    *,
    regions: tuple[NDArray[np.float64] | None, NDArray[np.float64] | None] = (None, None),
    progress: Progress = no_progress,
) -> Centreline:
    """Find the centreline between two ends of a lumen.

    The path minimises the integral of ``1 / room**2.5`` over the grid graph, in the lumen before
    inflation, so that inflation never opens a short cut between neighbouring folds. It is then
    smoothed under tension and pushed back wherever it would lose room.

    Parameters
    ----------
    field : SampledField
        The lumen.
    ends : pair of (3,) float or None
        Start and end in the world frame [mm]. None: found as the ends of the longest way through
        the lumen; the one that lies higher (world z) is the start.
    regions : pair of (k, 3) float or None
        Candidate places for an end that is not given as a point: the one farthest from the other
        end is taken.

    Raises
    ------
    GeometryError
        If an end lies outside the lumen, or the ends are not connected.
    """
    progress("centreline", 0.0)
    graph = _Graph(field)
    start_nodes = graph.locate("start", ends[0], regions[0])
    end_nodes = graph.locate("end", ends[1], regions[1])
    start, goal = _choose_ends(graph, start_nodes, end_nodes)
    progress("centreline", 0.6)
    nodes = graph.find_path(start, goal)
    progress("centreline", 0.8)
    points = nodes * field.spacing
    fixed = (ends[0] is not None, ends[1] is not None)
    for position, end in ((0, ends[0]), (-1, ends[1])):
        if end is not None:
            points[position] = field.to_grid(check_points("end", end))
    depth = graph.measure_depth(points)
    first = 0 if fixed[0] else _find_first_crest(points, depth)
    last = len(points) if fixed[1] else len(points) - _find_first_crest(points[::-1], depth[::-1])
    if last - first < 2:
        raise GeometryError(
            f"the lumen is only {measure_arc_length(points)[-1]:.1f} mm long: no centreline in it"
        )
    points = _smooth(points[first:last], graph)
    if fixed == (False, False):
        ends_z = field.to_world(points[[0, -1]])[:, 2]
        if ends_z[0] < ends_z[1]:
            points = points[::-1]
    world = field.to_world(points)
    radius = -field.signed_distance(world)
    progress("centreline", 1.0)
    return Centreline(points=world, arc_length=measure_arc_length(world), radius=radius)


def find_roomy_path(
    field: SampledField, start: ArrayLike, goal: ArrayLike, *, room: float
) -> NDArray[np.float64] | None:
    """Find a way (n, 3) along nodes that all have at least `room`, in the middle where it can.

    Parameters
    ----------
    start, goal : (3,) float
        World frame [mm]; they become the ends.
    room : float
        Clearance in the inflated lumen [mm]. The way stays in the lumen before inflation.

    Returns
    -------
    (n, 3) float or None
        World frame [mm]; None if the grid has no such way.
    """
    graph = _Graph(field)
    free = graph.inside & (graph.room + field.inflation >= room)
    graph.cost = np.where(free, graph.cost, -1.0)
    nodes = []
    for point in (start, goal):
        node = np.rint(field.to_grid(point) / field.spacing).astype(int)
        low = np.maximum(node - 2, 0)
        block = np.argwhere(free[tuple(slice(a, b + 3) for a, b in zip(low, node, strict=True))])
        if len(block) == 0:
            return None
        gaps = np.linalg.norm(block + low - node, axis=1)
        nodes.append(block[int(np.argmin(gaps))] + low)
    mcp, costs = graph.search(nodes[0])
    target = tuple(int(v) for v in nodes[1])
    if not np.isfinite(costs[target]):
        return None
    middle = field.to_world(np.array(mcp.traceback(target)) * field.spacing)
    return np.concatenate(
        [np.asarray(start, dtype=np.float64)[None], middle[1:-1], np.asarray(goal)[None]]
    )


class _Graph:
    """The lumen's nodes as a graph for `skimage.graph.MCP_Geometric`."""

    def __init__(self, field: SampledField) -> None:
        # The topology is that of the lumen before inflation, where it has one at this voxel.
        self.field = field.inflate(-field.inflation)
        self.room = -self.field.values
        self.inside = self.room > 0.0
        self._last: tuple[tuple[int, ...], Any, NDArray[np.float64]] | None = None
        floor = 0.25 * float(self.field.spacing.min())
        self.cost = np.where(
            self.inside, (np.maximum(self.room, floor) / 10.0) ** -COST_POWER, -1.0
        )

    def locate(
        self, name: str, point: ArrayLike | None, region: NDArray[np.float64] | None
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
            nodes = np.rint(field.to_grid(region) / field.spacing).astype(int)
            nodes = np.unique(np.clip(nodes, 0, np.array(self.room.shape) - 1), axis=0)
            nodes = nodes[self.inside[tuple(nodes.T)]]
            if len(nodes) == 0:
                raise GeometryError(f"{name}: no node of the field lies in that label")
            return nodes
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
        """Minimum-cost paths from a node to all others: the search, and the costs.

        The last one is kept: settling the ends and the path itself often ask for the same.
        """
        from skimage.graph import MCP_Geometric

        key = tuple(int(v) for v in source)
        if self._last is None or self._last[0] != key:
            step = tuple(self.field.spacing)
            mcp = MCP_Geometric(self.cost, sampling=step, fully_connected=True)
            self._last = (key, mcp, np.asarray(mcp.find_costs([key])[0]))
        return self._last[1], self._last[2]

    def measure_taut(self, source: NDArray[np.int64]) -> NDArray[np.float64]:
        """Length of the shortest way from a node to every node [mm]; infinite outside."""
        from skimage.graph import MCP_Geometric

        cost = np.where(self.inside, 1.0, -1.0)
        mcp = MCP_Geometric(cost, sampling=tuple(self.field.spacing), fully_connected=True)
        return np.asarray(mcp.find_costs([tuple(int(v) for v in source)])[0])

    def farthest(
        self, source: NDArray[np.int64], among: NDArray[np.int64] | None
    ) -> NDArray[np.int64]:
        """Find the node (of `among`) whose middle way from `source` is the longest.

        The taut way is a bad measure of how far an end is: it cuts the bends of a wide lumen, and
        may call a pouch the far end. So the tips, the places of locally longest taut way, are
        compared by the length of their middle way.
        """
        taut = self.measure_taut(source)
        reachable = np.isfinite(taut)
        if among is not None:
            allowed = np.zeros_like(reachable)
            allowed[tuple(among.T)] = True
            reachable &= allowed
        if not reachable.any():
            raise GeometryError("start and end are not connected inside the lumen at this grid")
        tips = self._find_tips(np.where(reachable, taut, -1.0))
        search, _ = self.search(source)
        lengths = []
        for tip in tips:
            path = np.array(search.traceback(tuple(int(v) for v in tip))) * self.field.spacing
            depth = self.measure_depth(path)[::-1]
            lost = measure_arc_length(path[::-1])[_find_first_crest(path[::-1], depth)]
            lengths.append(measure_arc_length(path)[-1] - lost)
        return tips[int(np.argmax(lengths))]

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
        ends = tuple(tuple(int(v) for v in node) for node in (start, goal))
        if self._last is not None and self._last[0] == ends[1] != ends[0]:
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


def _choose_ends(
    graph: _Graph, start: NDArray[np.int64] | None, goal: NDArray[np.int64] | None
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Settle the ends that are open: as far as possible from the other one."""
    if start is not None and len(start) == 1:
        known = goal is not None and len(goal) == 1
        return start[0], goal[0] if goal is not None and known else graph.farthest(start[0], goal)
    if goal is not None and len(goal) == 1:
        return graph.farthest(goal[0], start), goal[0]
    deepest = np.array(np.unravel_index(int(np.argmax(graph.room)), graph.room.shape))
    taut = graph.measure_taut(deepest)
    if start is None:
        taut[~np.isfinite(taut)] = -1.0
        first = np.array(np.unravel_index(int(np.argmax(taut)), taut.shape))
    else:
        first = graph.farthest(deepest, start)
    second = graph.farthest(first, goal)
    return graph.farthest(second, start), second


def _find_first_crest(points: NDArray[np.float64], depth: NDArray[np.float64]) -> int:
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


def _smooth(points: NDArray[np.float64], graph: _Graph) -> NDArray[np.float64]:
    """Smooth a path of nodes; where that loses room against the path itself, push it back."""
    points = resample_polyline(points, SPACING)
    for sweeps, keep in ((120, 0.95), (40, 0.95)):
        target = keep * graph.measure_depth(points)
        spread = np.minimum(target, _running_minimum(target, 3))
        for _ in range(sweeps):
            middle = 0.5 * (points[:-2] + points[2:])
            moved = points.copy()
            moved[1:-1] += 0.5 * (middle - points[1:-1])
            lack = spread - graph.measure_depth(moved)
            push = np.clip(lack, 0.0, 0.5 * SPACING)[:, None] * graph.measure_slope(moved)
            moved[1:-1] += push[1:-1]
            points = moved
        points = resample_polyline(points, SPACING)
    return _stay_inside(points, graph)


def _running_minimum(values: NDArray[np.float64], half: int) -> NDArray[np.float64]:
    from scipy.ndimage import minimum_filter1d

    return np.asarray(minimum_filter1d(values, 2 * half + 1))


def _stay_inside(points: NDArray[np.float64], graph: _Graph) -> NDArray[np.float64]:
    """Push any point that smoothing left outside the lumen back in, or say where it cannot be."""
    for _ in range(50):
        depth = graph.measure_depth(points)
        bad = depth <= 0.0
        if not bad.any():
            return points
        points[bad] += (0.1 - depth[bad])[:, None] * graph.measure_slope(points[bad])
    worst = int(np.argmin(graph.measure_depth(points)))
    place = graph.field.to_world(points[worst])
    raise GeometryError(
        f"the centreline leaves the lumen near ({', '.join(f'{v:.1f}' for v in place)}) mm: "
        "the lumen is thinner than the grid there, use a smaller --voxel"
    )
