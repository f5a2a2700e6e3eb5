"""Lines of other tools that overlap or touch, joined to one tree."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError
from ..numeric.arrays import Floats
from ..numeric.polylines import measure_arc_length

SAME = 1e-5
"""Points nearer to each other than this share of the extent of all are one: files round."""

NEAR = 0.25
"""Lines nearer to each other than this share of the radius run along the same branch."""

PART = 3.0
"""Lines that share a point exactly, and leave each other within so many radii, part there."""


@dataclass(eq=False)
class Nodes:
    """Nodes of a tree: for each its place and radius, and the numbers of its neighbours."""

    values: list[Floats] = field(default_factory=list)
    beside: list[list[int]] = field(default_factory=list)
    before: list[int] = field(default_factory=list)
    """Another node of the same part; that of its first node is itself."""

    def add(self, value: Floats) -> int:
        """Add a node (4,) that has no neighbours, and return its number."""
        self.values.append(value)
        self.beside.append([])
        self.before.append(len(self.before))
        return len(self.values) - 1

    def join(self, one: int, two: int) -> bool:
        """Make two nodes neighbours; where they are connected already return False instead."""
        new, old = self.find_part(one), self.find_part(two)
        if old == new:
            return False
        self.beside[one].append(two)
        self.beside[two].append(one)
        self.before[old] = new
        return True

    def find_part(self, node: int) -> int:
        """Return the first node of all that are connected with one."""
        while self.before[node] != node:
            self.before[node] = node = self.before[self.before[node]]
        return node

    def sample(self) -> tuple[Floats, NDArray[np.int64]]:
        """Return places (m, 3) along all links, and the node nearest to each."""
        table = np.array(self.values)
        links = [(k, n) for k, others in enumerate(self.beside) for n in others if k < n]
        one, two = np.array(links, dtype=np.int64).reshape(-1, 2).T
        gaps = np.linalg.norm(table[one, :3] - table[two, :3], axis=1)
        fine = 0.4 * NEAR * np.minimum(table[one, 3], table[two, 3])
        counts = np.ceil(gaps / fine).astype(np.int64)
        which = np.repeat(np.arange(len(links)), counts)
        step = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        share = (step / counts[which])[:, None]
        places = (1.0 - share) * table[one[which], :3] + share * table[two[which], :3]
        owner = np.where(share[:, 0] < 0.5, one[which], two[which])
        return (
            np.concatenate([places, table[:, :3]]),
            np.concatenate([owner, np.arange(len(table))]),
        )


def join_lines(lines: Sequence[Floats], radius: Sequence[Floats], source: object) -> Nodes:
    """Return the nodes of the one tree that lines are of.

    Lines that touch as the branches of a tree do are taken as they are. Of others, such as those
    from one inlet to all outlets, the longest comes first. Of each other one what runs along those
    before it is left out, and what leaves them is joined where it does: at the last point that both
    have, if they share points, or else at the node nearest to where it is `NEAR` of the radius
    away.

    Parameters
    ----------
    lines : sequence of (n, 3) float
    radius : sequence of (n,) float
    source : object
        What a refusal names.

    Raises
    ------
    FileFormatError
        If they are not connected, or there is a loop.
    """
    from scipy.spatial import cKDTree

    extent = float(np.ptp(np.concatenate(list(lines)), axis=0).max())
    if (branches := _join_branches(lines, radius, extent)) is not None:
        return branches
    nodes = Nodes()
    for line, around in sorted(
        zip(lines, radius, strict=True), key=lambda pair: -measure_arc_length(pair[0])[-1]
    ):
        keep = np.append(True, np.linalg.norm(np.diff(line, axis=0), axis=1) > 0.0)
        line, around = line[keep], around[keep]
        if len(line) < 2:
            continue
        near = np.full(len(line), -1, dtype=np.int64)
        gaps = np.full(len(line), np.inf)
        if nodes.values:
            places, owner = nodes.sample()
            gaps, index = cKDTree(places).query(line)
            near = owner[index]
        same = np.zeros(len(line), dtype=bool)
        if nodes.values:
            apart = np.linalg.norm(np.array(nodes.values)[near, :3] - line, axis=1)
            same = apart <= SAME * extent
        covered = _find_covered(line, around, gaps, same)
        if same[0] and same[-1] and nodes.find_part(near[0]) != nodes.find_part(near[-1]):
            covered = same
        for first, last in _find_runs(covered):
            for k in range(first, last):
                if covered[k + 1] and near[k] != near[k + 1]:
                    nodes.join(int(near[k]), int(near[k + 1]))
        for first, last in _find_runs(~covered):
            ends = [int(near[k]) for k in (first - 1, last + 1) if 0 <= k < len(line)]
            if len(ends) == 2 and nodes.find_part(ends[0]) == nodes.find_part(ends[1]):
                if (gaps[first : last + 1] <= around[first : last + 1]).all():
                    continue
                at = ", ".join(f"{value:.1f}" for value in line[(first + last) // 2])
                raise FileFormatError(f"{source}: its lines close a loop at ({at}) mm, a tree has "
                                      "none")  # fmt: skip
            own = [nodes.add(np.append(line[k], around[k])) for k in range(first, last + 1)]
            way = ends[:1] * (first > 0) + own + ends[-1:] * (last + 1 < len(line))
            for one, two in itertools.pairwise(way):
                nodes.join(one, two)
    parts = len({nodes.find_part(k) for k in range(len(nodes.values))})
    if parts != 1:
        raise FileFormatError(f"{source} has lines in {parts} parts that are not joined: a tree "
                              "has 1")  # fmt: skip
    return nodes


def _join_branches(
    lines: Sequence[Floats], radius: Sequence[Floats], extent: float
) -> Nodes | None:
    """Return the tree of lines that touch in single points; None if it is none, or a star."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    points = np.concatenate(list(lines))
    pairs = cKDTree(points).query_pairs(SAME * extent, output_type="ndarray")
    count = len(points)
    joined = coo_array((np.ones(len(pairs), dtype=bool), tuple(pairs.T)), shape=(count, count))
    number, group = connected_components(joined, directed=False)
    ways = np.split(group, np.cumsum([len(line) for line in lines])[:-1])
    if len(ways) > 1 and set.intersection(*(set(way.tolist()) for way in ways)):
        return None
    radii = np.concatenate(list(radius))
    nodes = Nodes()
    for k in np.unique(group, return_index=True)[1]:
        nodes.add(np.append(points[k], radii[k]))
    for way in ways:
        for one, two in itertools.pairwise(way.tolist()):
            if one != two and not nodes.join(one, two):
                return None
    return nodes if len({*map(nodes.find_part, range(number))}) == 1 else None


def _find_covered(
    line: Floats, radius: Floats, gaps: Floats, same: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which points of a line run along what there is already."""
    covered = gaps <= NEAR * radius
    covered |= same
    arc = measure_arc_length(line)
    for first, last in list(_find_runs(covered)):
        shared = first + np.flatnonzero(same[first : last + 1])
        if len(shared) == 0:
            continue
        one, two = int(shared[0]), int(shared[-1])
        if first > 0 and arc[one] - arc[first] <= PART * radius[one]:
            covered[first:one] = False
        if last + 1 < len(line) and arc[last] - arc[two] <= PART * radius[two]:
            covered[two + 1 : last + 1] = False
    return covered


def _find_runs(which: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Give the first and the last number of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], which, [False]]).astype(np.int8)))
    for first, end in edges.reshape(-1, 2).tolist():
        yield first, end - 1
