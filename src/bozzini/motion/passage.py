"""The passage: how much room any way from the entry to the goal can have, proved.

If a scope of radius r came through at all, its centre would have r of room everywhere. Where its
way crosses from cell to cell, through a face, the nearest corner of that face is at most half a
face's diagonal away and so has at least r minus that; corners of faces of one cell are
neighbours. So if the widest way on the grid has less, nothing passes, whatever its links.

With inflation the field answers a lower bound of the room inside the moved wall, which proves
nothing here. A node at least the inflation away from the lumen is in the moved wall, so the
distance to the nearest such node bounds the room of a node from above. Node distances are never
above the exact ones, so a node that has at least the inflation is known to be that far away.

An analytic duct is put on a grid for this. Its distance inside may be less than the true room, so
there the room of a node is bounded from above, by the distance to points that are known to lie on
the wall: outside, the distance is exact, and its foot point is one.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..duct.base import Duct
from ..duct.field import SampledField
from ..errors import InputError

__all__ = ["Passage", "find_passage"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Passage:
    """The widest way between two points.

    Parameters
    ----------
    level : float
        Smallest room of the nodes along the widest way on the grid [mm]; -inf if there is none.
    bound : float
        No way at all has more room than this everywhere [mm]; proved. Infinite where nothing is
        known: no node of the grid lies in the moved wall.
    place : (dim,) float
        Where the widest way is tightest, world frame [mm].
    """

    level: float
    bound: float
    place: NDArray[np.float64]


REMEMBERED = 8
"""So many answers are kept with a sampled field."""

_KNOWN: WeakKeyDictionary[SampledField, dict[object, Passage]] = WeakKeyDictionary()

NODES_MAX = 300_000
"""An analytic duct is put on a grid of this many nodes at most."""

PITCH = 0.1
"""Nor are they nearer than this fraction of the room at the roomier end."""


def find_passage(duct: Duct, start: ArrayLike, goal: ArrayLike) -> Passage:
    """Find the widest way from `start` to `goal` (world frame, mm) through a duct.

    In a sampled field room is what the field answers: with inflation, the inflation minus the
    signed distance to the wall before it. The last answers for a sampled field are remembered with
    it.
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
    rooms = [float(duct.clearance_bound(point)) for point in (start, goal)]
    if min(rooms) <= 0.0:
        raise InputError("start or goal of the passage lies outside the duct")
    floor = float(np.prod(high - low) / NODES_MAX) ** (1.0 / dim)
    pitch = max(PITCH * max(rooms), floor)
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
    room: NDArray[np.floating],
    nodes: NDArray[np.int64],
    shape: tuple[int, ...],
    ends: list[int],
) -> tuple[float, float, int]:
    """Return the widest way's least room, the same without its two ends, and the node of that.

    Given is the room of some nodes, by rising flat index; all others have none. The nodes of the
    ends do not count for the proof: they are corners of cells where the way begins or ends, not
    of faces that it crosses.
    """
    from .kernels.measures import widest_level

    numbers = np.searchsorted(nodes, ends)
    own = [
        float(room[n]) if n < len(nodes) and nodes[n] == end else -np.inf
        for n, end in zip(numbers, ends, strict=True)
    ]
    lacking = sorted({end for end, has in zip(ends, own, strict=True) if has == -np.inf})
    where = np.searchsorted(nodes, lacking)
    nodes, raised = np.insert(nodes, where, lacking), np.insert(room, where, 0.0)
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
    room = duct.inflation - duct.values.reshape(-1)[nodes].astype(np.float64)
    ends = []
    for point in (start, goal):
        near = np.rint(duct.to_grid(point) / duct.spacing).astype(int)
        near = np.clip(near, 0, np.array(shape) - 1)
        ends.append(int(np.ravel_multi_index(tuple(near), shape)))
    level, limit, node = _find_widest(room, nodes, shape, ends)
    if duct.inflation > 0.0:
        limit = _find_widest(_bound_inflated_room(duct, nodes), nodes, shape, ends)[1]
    half = 0.5 * float(np.linalg.norm(np.sort(duct.spacing)[1:]))
    index = np.array(np.unravel_index(max(node, 0), shape))
    return Passage(
        level=level,
        bound=max(limit, 0.0) + half + duct.pack().slack,
        place=duct.to_world(index * duct.spacing),
    )


def _bound_inflated_room(duct: SampledField, nodes: NDArray[np.int64]) -> NDArray[np.float64]:
    """Upper bounds (n,) of the distance of nodes to the moved wall [mm]; infinite if unknown.

    The nearest node in the moved wall is next to one that is not: a step towards would be nearer.
    """
    from scipy.spatial import KDTree

    from .kernels.measures import find_rim

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
    room = np.empty(len(nodes))
    for begin in range(0, len(nodes), 100_000):
        part = nodes[begin : begin + 100_000]
        places = np.stack(np.unravel_index(part, shape), axis=1) * duct.spacing
        room[begin : begin + len(part)] = tree.query(places)[0]
    return room
