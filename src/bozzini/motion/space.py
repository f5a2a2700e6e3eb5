"""The free space of a scope: a duct, the introducer before it, and the passages through it.

The passage bounds how wide any way from the entry to the goal can be, proved. If a scope of radius
r came through at all, its centre would have a clearance of r everywhere. Where its way crosses
from cell to cell, through a face, the nearest corner of that face is at most half a face's
diagonal away and so has at least r minus that; corners of faces of one cell are neighbours. So if
the widest way on the grid has less, nothing passes, whatever its links.

With inflation the field answers a lower bound of the clearance of the moved wall, which proves
nothing here. A node at least the inflation away from the lumen is in the moved wall, so the
distance to the nearest such node bounds the clearance of a node from above. Node distances are
never above the exact ones, so a node that has at least the inflation is known to be that far away.

An analytic duct is put on a grid for this. Its distance inside may be less than the true one, so
there the clearance of a node is bounded from above, by the distance to points that are known to
lie on the wall: outside, the distance is exact, and its foot point is one.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_kind
from ..duct.base import Duct, check_duct
from ..duct.centreline import Centreline, find_clear_path
from ..duct.checks import set_fields
from ..duct.field import SampledField
from ..duct.packed import Packed, SpaceData
from ..errors import InputError
from ..results import Shown
from .scope import Introducer


@dataclass(frozen=True, kw_only=True, eq=False)
class Passage(Shown):
    """The widest way between two points.

    Parameters
    ----------
    level : float
        Smallest clearance of the nodes along the widest way on the grid [mm]; -inf without one.
    bound : float
        No way at all has more clearance than this everywhere [mm]; proved. Infinite where nothing
        is known: no node of the grid lies in the moved wall.
    place : (dim,) float
        Where the widest way is tightest, world frame [mm].
    """

    level: float
    bound: float
    place: NDArray[np.float64]


REMEMBERED = 8
"""This many answers are kept with a sampled field."""

_KNOWN: WeakKeyDictionary[SampledField, dict[object, Passage]] = WeakKeyDictionary()

NODES_MAX = 300_000
"""An analytic duct is put on a grid of this many nodes at most."""

PITCH = 0.1
"""Nor are they nearer than this fraction of the larger clearance of the two ends."""


def find_passage(duct: Duct, start: ArrayLike, *, goal: ArrayLike) -> Passage:
    """Find the widest way from `start` to `goal` (world frame, mm) through a duct.

    In a sampled field the clearance is, with inflation, the inflation minus the signed distance to
    the wall before it. The last answers for a sampled field are remembered with it.
    """
    if not isinstance(duct, SampledField):
        return _find_in_shape(duct, start, goal)
    known = _KNOWN.setdefault(duct, {})
    key = (tuple(np.asarray(start, float).tolist()), tuple(np.asarray(goal, float).tolist()))
    if key not in known:
        known[key] = _find_in_field(duct, start, goal)
        if len(known) > REMEMBERED:
            known.pop(next(iter(known)))
    return known[key]


def _find_in_shape(duct: Duct, start: ArrayLike, goal: ArrayLike) -> Passage:
    from scipy.spatial import KDTree

    low, high = duct.bounds
    dim = len(low)
    clearances = [float(duct.clearance_bound(point)) for point in (start, goal)]
    if min(clearances) <= 0.0:
        raise InputError("start or goal of the passage lies outside the duct")
    floor = float(np.prod(high - low) / NODES_MAX) ** (1.0 / dim)
    pitch = max(PITCH * max(clearances), floor)
    axes = [np.arange(low[k] - pitch, high[k] + 2.0 * pitch, pitch) for k in range(dim)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    shape = (*nodes.shape[:-1], *(1,) * (3 - dim))
    nodes = nodes.reshape(-1, dim)
    distance = duct.signed_distance(nodes)
    # Nodes just outside, moved to the wall.
    rim = nodes[(distance > 0.0) & (distance < 2.0 * pitch)]
    feet = rim - duct.signed_distance(rim)[:, None] * duct.gradient(rim)
    inside = distance < 0.0
    above = np.full(len(nodes), -np.inf)
    above[inside] = KDTree(feet).query(nodes[inside])[0]
    ends = []
    for point in (start, goal):
        index = np.rint((np.asarray(point, dtype=np.float64) - low) / pitch).astype(int) + 1
        ends.append(int(np.ravel_multi_index((*index, *(0,) * (3 - dim)), shape)))
    every = np.arange(len(nodes))
    level = _find_widest(-distance, every, shape, ends)[0]
    _, limit, node = _find_widest(above, every, shape, ends)
    return Passage(
        level=level,
        bound=max(limit, 0.0) + 0.5 * pitch * float(np.sqrt(dim - 1)),
        place=nodes[max(node, 0)],
    )


def _find_widest(
    clearance: NDArray[np.floating],
    nodes: NDArray[np.int64],
    shape: tuple[int, ...],
    ends: list[int],
) -> tuple[float, float, int]:
    """Return the widest way's least clearance, the same without its two ends, and the node of that.

    Given is the clearance of some nodes, by rising flat index; all others have none. The nodes of
    the ends do not count for the proof: they are corners of cells where the way begins or ends,
    not of faces that it crosses.
    """
    from .kernels.passage import widest_level

    numbers = np.searchsorted(nodes, ends)
    own = [
        float(clearance[n]) if n < len(nodes) and nodes[n] == end else -np.inf
        for n, end in zip(numbers, ends, strict=True)
    ]
    lacking = sorted({end for end, has in zip(ends, own, strict=True) if has == -np.inf})
    where = np.searchsorted(nodes, lacking)
    nodes, raised = np.insert(nodes, where, lacking), np.insert(clearance, where, 0.0)
    numbers = np.searchsorted(nodes, ends)
    raised[numbers] = max(float(raised.max()), 1e-9)
    order = np.flatnonzero(raised > 0.0)
    order = order[np.argsort(-raised[order], kind="stable")]
    place = np.full(shape, -1, dtype=np.int32)
    limit, node = widest_level(raised, nodes, order, place, int(numbers[0]), int(numbers[1]))
    found = int(nodes[node]) if node >= 0 else -1
    return min(float(limit), *own), float(limit), found


def _find_in_field(duct: SampledField, start: ArrayLike, goal: ArrayLike) -> Passage:
    shape = duct.values.shape
    nodes = np.flatnonzero(duct.values < duct.inflation)
    clearance = duct.inflation - duct.values.reshape(-1)[nodes].astype(np.float64)
    ends = []
    for point in (start, goal):
        near = np.rint(duct.to_grid(point) / duct.spacing).astype(int)
        near = np.clip(near, 0, np.array(shape) - 1)
        ends.append(int(np.ravel_multi_index(tuple(near), shape)))
    level, limit, node = _find_widest(clearance, nodes, shape, ends)
    if duct.inflation > 0.0:
        limit = _find_widest(_bound_inflated_clearance(duct, nodes), nodes, shape, ends)[1]
    half = 0.5 * float(np.linalg.norm(np.sort(duct.spacing)[1:]))
    index = np.array(np.unravel_index(max(node, 0), shape))
    return Passage(
        level=level,
        bound=max(limit, 0.0) + half + duct.pack().slack,
        place=duct.to_world(index * duct.spacing),
    )


def _bound_inflated_clearance(duct: SampledField, nodes: NDArray[np.int64]) -> NDArray[np.float64]:
    """Upper bounds (n,) of the distance of nodes to the moved wall [mm]; infinite if unknown.

    The nearest node in the moved wall is next to one that is not: a step towards would be nearer.
    """
    from scipy.spatial import KDTree

    from .kernels.passage import find_rim

    level = np.float32(duct.inflation)
    level = np.nextafter(level, np.float32(np.inf)) if level < duct.inflation else level
    if not duct.exact_outside:
        return np.full(len(nodes), np.inf)
    rim = np.empty(find_rim(duct.values, level, np.empty(0, dtype=np.int64)), dtype=np.int64)
    if len(rim) == 0:
        return np.full(len(nodes), np.inf)
    find_rim(duct.values, level, rim)
    shape = duct.values.shape
    tree = KDTree(np.stack(np.unravel_index(rim, shape), axis=1) * duct.spacing)
    clearance = np.empty(len(nodes))
    for begin in range(0, len(nodes), 100_000):
        part = nodes[begin : begin + 100_000]
        places = np.stack(np.unravel_index(part, shape), axis=1) * duct.spacing
        clearance[begin : begin + len(part)] = tree.query(places)[0]
    return clearance


CLEARANCE_STEP_MM = 0.5
"""Paths along nodes are found for clearances that are multiples of this."""


def grid_of(duct: Duct) -> SampledField | None:
    """Return the grid that a duct can be searched on: itself, its coarse part, or none."""
    if isinstance(duct, SampledField):
        return duct
    coarse = getattr(duct, "coarse", None)
    return coarse if isinstance(coarse, SampledField) else None


class Passages:
    """The passages through one duct between two ends: what any scope's plan there can share.

    Parameters
    ----------
    duct, line
        As for `FreeSpace`.
    before : Passages, optional
        Of the same duct, inflated by less: its widest way is this one's, and so are its ways
        along nodes. How wide any way can be at most is then not bounded.
    """

    def __init__(self, duct: Duct, line: Centreline, *, before: Passages | None = None) -> None:
        self.grid = grid_of(duct)
        self.duct: Duct = duct if self.grid is None else self.grid
        self.ends = line.points[0], line.points[-1]
        self.bound = np.asarray(duct.clearance_bound(line.points))
        self._paths: dict[float, NDArray[np.float64] | None] = {}
        if before is not None and before.passage.level > 0.0:
            self._paths = before._paths
            more = self.duct.inflation - before.duct.inflation
            self.passage = replace(before.passage, level=before.passage.level + more, bound=np.inf)

    @cached_property
    def passage(self) -> Passage:
        """The widest way between the ends."""
        start, goal = self.ends
        return find_passage(self.duct, start, goal=goal)

    def find_path(self, clearance: float) -> NDArray[np.float64] | None:
        """Return a path along nodes that all have this clearance, or a little more [mm]."""
        grid = self.grid
        if grid is None:
            return None
        # Few different ways serve all scopes and inflations.
        level = np.ceil((clearance - grid.inflation) / CLEARANCE_STEP_MM - 1e-6) * CLEARANCE_STEP_MM
        level = min(level, self.passage.level - grid.inflation - 1e-6)
        level = round(float(max(level, clearance - grid.inflation)), 6)
        if level not in self._paths:
            self._paths[level] = find_clear_path(grid, *self.ends, clearance=level + grid.inflation)
        return self._paths[level]


@dataclass(frozen=True, eq=False)
class FreeSpace(Shown):
    """Where a scope may be: the lumen of a duct and the bore of an introducer.

    Planners, certificate and checks share it: duct and introducer are packed once for compiled
    code, and the passages are found once.

    Parameters
    ----------
    duct : Duct
        The lumen, 2-D or 3-D.
    line : Centreline, optional
        The way from the entry to the goal; only a certificate does without it.
    introducer : Introducer, optional
        The straight tube before the entry.

    Raises
    ------
    InputError
        If `duct` is none, or its signed distance is none: see `bozzini.duct.Duct.sample`.
    """

    duct: Duct
    line: Centreline | None = None
    introducer: Introducer | None = None
    _lumen: Packed = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_duct("duct", self.duct)
        if self.line is not None:
            check_kind("line", self.line, Centreline)
        if self.introducer is not None:
            check_kind("introducer", self.introducer, Introducer)
        set_fields(self, _lumen=self.duct.pack())

    @classmethod
    def at_entry(cls, duct: Duct, line: Centreline, *, along: float) -> FreeSpace:
        """Return the space with an introducer in line with the first `along` mm of `line`."""
        return cls(duct, line, Introducer.at_entry(duct, line, along=along))

    @property
    def centreline(self) -> Centreline:
        """The line; without one `InputError` is raised."""
        if self.line is None:
            raise InputError("this free space has no line from the entry to the goal: give one")
        return self.line

    @property
    def tube(self) -> Introducer:
        """The introducer; without one `InputError` is raised."""
        if self.introducer is None:
            raise InputError("this free space has no introducer: give one")
        return self.introducer

    def pack(self, *, bore: float | None = None) -> SpaceData:
        """Return lumen and introducer for compiled code, with another `bore` [mm] if given."""
        introducer = np.zeros(7)
        if self.introducer is not None:
            introducer = self.introducer.pack(self.duct)
            introducer[6] = self.introducer.bore if bore is None else bore
        return SpaceData(self._lumen, introducer)

    def pack_exempt(self, radius: float) -> SpaceData:
        """Return `pack` with the bore that is exempt from the wall for a body of `radius` mm."""
        if self.introducer is None:
            return self.pack()
        offered = float(self.duct.clearance_bound(self.introducer.entry))
        return self.pack(bore=self.introducer.exempt_bore(offered, radius=radius))

    @cached_property
    def passages(self) -> Passages:
        """The passages from the entry to the goal."""
        return Passages(self.duct, self.centreline)

    @cached_property
    def pitch(self) -> float:
        """Distance between the samples along a link at which clearances are estimated [mm]."""
        grid = grid_of(self.duct)
        return BODY_PITCH_MM if grid is None else 0.5 * float(np.min(grid.spacing))

    def for_link(self, length: float) -> FreeSpace:
        """Return the same space, and its passages, with an introducer for another link length."""
        other = FreeSpace.at_entry(self.duct, self.centreline, along=length)
        other.__dict__["passages"] = self.passages
        return other

    def moved_to(self, duct: Duct) -> FreeSpace:
        """Return the space of the same lumen inflated by more, without an introducer."""
        other = FreeSpace(duct, self.centreline)
        other.__dict__["passages"] = Passages(duct, self.centreline, before=self.passages)
        return other


BODY_PITCH_MM = 0.25
"""`FreeSpace.pitch` of an analytic duct."""
