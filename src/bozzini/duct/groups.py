"""The lumen on a coarse grid that keeps its topology: its ways, and where they end.

The nodes of a block of the grid that are joined within it are one group, which lies at the deepest
of them. So two limbs in a block stay apart, and what is joined stays joined.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..numeric.arrays import Floats
from ..numeric.polylines import measure_arc_length, resample_polyline

Numbers = NDArray[np.int64]

COST_POWER = 2.5
"""The paths cost ``length / clearance**COST_POWER``: so that they keep to the middle."""

BLOCK_SHARE = 0.25
"""A block of nodes is about this share of the lumen's radius wide."""

COVERED = 2.0
"""A tip within so many radii of another's path is none of its own."""

TIPS_MAX = 64
"""So many tips are told apart at most."""

CREST_AHEAD, CREST_NEXT = 0.8, 1.0
"""How far from a tip its crest is compared and sought, in radii of the lumen along the path."""

CREST_SLOPE = 0.08
"""A path goes on out of its tip for this much clearance each mm."""

CREST_VOXELS, CREST_SHARE = 0.5, 0.07
"""What it gains so is told from the grid's error by these shares of a voxel and of the radius."""


def measure_tip(points: Floats, depth: Floats, voxel: float = 0.0) -> float:
    """Return the length of path on which one that starts in a closed tip comes out of it [mm].

    At the first point with at least 0.8 of the clearance that the path has soon after it (within
    two radii) it is nearly out: an end that was only found, not given, need not be a narrow one.
    It is out where it would have the most clearance of the next radius if that went on growing by
    a mm each mm, from 0.9 of it on; or, where the lumen widens slowly, at the place of that radius
    that has the most clearance less 0.08 of the way there, if the grid can tell the two. The radius
    is the path's median.
    """
    arc, radius = measure_arc_length(points), float(np.median(depth))
    for here in range(len(points)):
        reach = arc[here] + max(2.0 * depth[here], CREST_AHEAD * radius)
        ahead = int(np.searchsorted(arc, reach, "right"))
        if depth[here] >= 0.8 * depth[here:ahead].max():
            break
    else:
        return 0.0
    ahead = int(np.searchsorted(arc, arc[here] + CREST_NEXT * radius, "right"))
    most = float(depth[here:ahead].max())
    at = here + int(np.argmax(depth[here:ahead] >= 0.9 * most))
    while at > 0 and depth[at - 1] >= 0.9 * most:
        at -= 1
    out = float(arc[at])
    if at > 0:
        out = float(np.interp(0.9 * most, depth[at - 1 : at + 1], arc[at - 1 : at + 1]))
    out = min(out + 0.1 * most, float(arc[-1]))
    wide = here + int(np.argmax(depth[here:ahead] - CREST_SLOPE * arc[here:ahead]))
    gain = float(depth[wide] - np.interp(out, arc, depth))
    told = gain > max(CREST_VOXELS * voxel, CREST_SHARE * most)
    return float(arc[wide]) if told else out


def find_first_crest(points: Floats, depth: Floats, voxel: float = 0.0) -> int:
    """Return the index of the first point of a path beyond the closed tip that it starts in."""
    arc = measure_arc_length(points)
    return int(np.searchsorted(arc, measure_tip(points, depth, voxel) - 1e-9 * arc[-1]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Flood:
    """The ways of least cost from some groups to all others.

    Attributes
    ----------
    before : (m,) int
        The group before on the way; itself at the sources.
    lengths : (m,) float
        Of the ways [mm]; -1 where there is none.
    """

    before: Numbers
    lengths: Floats

    def trace(self, group: int) -> Numbers:
        """Return the groups of the way to one."""
        way = [group]
        while (last := int(self.before[way[-1]])) != way[-1]:
            way.append(last)
        return np.array(way[::-1])


@dataclass(frozen=True, kw_only=True, eq=False)
class LumenWay:
    """A way through the lumen.

    Attributes
    ----------
    groups : (n,) int
        From tip to tip.
    both : bool
        Whether it begins in a tip that was found, as it ends in one.
    path : (k, 3) float
        The same without the closed tips that were found: grid frame [mm].
    length : float
        About what it is when the path is smoothed [mm].
    width : float
        Clearance at the end of the path [mm].
    """

    groups: Numbers
    both: bool
    path: Floats
    length: float
    width: float


class NodeGroups:
    """The groups of a lumen's nodes as a graph.

    Parameters
    ----------
    number, nodes, depths
        As in `bozzini.duct.centreline.LumenGraph`.
    spacing : (3,) float
        Between nodes [mm].

    Attributes
    ----------
    groups : (n,) int32
        The group of each node.
    nodes : (m,) int32
        The deepest node of each group.
    points, depths : (m, 3), (m,) float
        Its place in the grid frame and its clearance [mm].
    """

    def __init__(
        self,
        number: NDArray[np.int32],
        nodes: Numbers,
        depths: NDArray[np.float32],
        spacing: Floats,
    ) -> None:
        from scipy.sparse import coo_array

        from .kernels.graph import group_nodes, link_groups

        self.voxel = float(spacing.max())
        radius = 3.0 * float(depths.mean())  # of a round tube
        self.block = np.maximum(1, np.rint(BLOCK_SHARE * radius / spacing)).astype(np.int64)
        self.size = float(np.linalg.norm(self.block * spacing))
        self.groups = np.full(len(nodes), -1, dtype=np.int32)
        deepest = np.empty(len(nodes), dtype=np.int32)
        count = group_nodes(number, nodes, depths, self.block, self.groups, deepest)
        self.nodes = deepest[:count].copy()
        places = np.unravel_index(nodes[self.nodes], number.shape)
        self.points = np.stack(places, axis=1) * spacing
        self.depths = depths[self.nodes].astype(np.float64)
        links = np.empty((16 * count, 3), dtype=np.int32)
        while (
            found := link_groups(
                number, nodes, self.groups, np.full(count, -1, dtype=np.int32), links
            )
        ) > len(links):
            links = np.empty((found, 3), dtype=np.int32)
        one, two = links[:found, 0], links[:found, 1]
        gaps = np.linalg.norm(self.points[one] - self.points[two], axis=1)
        weights = (np.maximum(self.depths, 0.25 * spacing.min()) / radius) ** -COST_POWER
        pairs = (np.concatenate([one, two]), np.concatenate([two, one]))
        costs = 0.5 * gaps * (weights[one] + weights[two])
        self._gaps, self._costs = (
            coo_array((np.tile(values, 2), pairs), shape=(count, count)).tocsr()
            for values in (gaps, costs)
        )

    def flood(self, sources: Numbers | int) -> Flood:
        """Find the ways from one or more groups."""
        from scipy.sparse.csgraph import dijkstra

        found = dijkstra(
            self._costs, indices=np.atleast_1d(sources), min_only=True, return_predecessors=True
        )
        before = np.where(found[1] < 0, np.arange(len(self.nodes)), found[1]).astype(np.int64)
        lengths = np.linalg.norm(self.points - self.points[before], axis=1)
        last = before
        while not np.array_equal(last, last[last]):
            lengths += lengths[last]
            last = last[last]
        lengths[~np.isfinite(found[0])] = -1.0
        return Flood(before=before, lengths=lengths)

    def widen(self, way: Numbers) -> NDArray[np.bool_]:
        """Return which groups (m,) are on a way or beside it."""
        near = np.zeros(len(self.nodes), dtype=bool)
        near[way] = True
        near[self._gaps[way].indices] = True
        return near

    def find_tips(self, flood: Flood, among: Numbers | None = None) -> list[LumenWay]:
        """Return the ways of a flood to all ends (of some groups), the farthest first.

        Each ends in the farthest group that no way before covers.
        """
        from scipy.sparse.csgraph import dijkstra

        left = flood.lengths.copy()
        if among is not None:
            left[np.setdiff1d(np.arange(len(left)), among)] = -1.0
        on_way = np.zeros(len(self.nodes), dtype=bool)
        tips: list[LumenWay] = []
        while len(tips) < TIPS_MAX and left.max(initial=-1.0) >= 0.0:
            group = int(np.argmax(left))
            way = flood.trace(group)
            tips.append(self.make_way(way))
            new = way[~on_way[way]]
            on_way[new] = True
            reach = COVERED * self.depths + self.size
            gaps, _, source = dijkstra(
                self._gaps,
                indices=new,
                min_only=True,
                return_predecessors=True,
                limit=float(reach[new].max()),
            )
            near = np.flatnonzero(np.isfinite(gaps))
            left[near[gaps[near] <= reach[source[near]]]] = -1.0
        return tips

    def make_way(self, way: Numbers, *, both: bool = False) -> LumenWay:
        """Return a way without the closed tip of its end, or of `both` ends."""
        from scipy.ndimage import uniform_filter1d

        points, depth = self.points[way], self.depths[way]
        last = len(points) - find_first_crest(points[::-1], depth[::-1], self.voxel)
        first = find_first_crest(points, depth, self.voxel) if both else 0
        path = points[first:last]
        eased = path
        if len(path) > 1:
            eased = resample_polyline(path, 0.25 * float(np.median(depth)))
            eased = uniform_filter1d(eased, 5, axis=0, mode="nearest")
        return LumenWay(
            groups=way,
            both=both,
            path=path,
            length=float(measure_arc_length(eased)[-1]) if len(eased) > 1 else 0.0,
            width=float(depth[last - 1]),
        )
