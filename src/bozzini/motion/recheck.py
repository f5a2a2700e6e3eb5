"""A second check of a motion's clearance, by another method than the certificate's.

It shares no code with planner, field or certificate: it measures exact distances to the triangles
of the wall (libigl), or to the faces of the lumen's voxels, and divides time and body until what
lies between the samples is decided. It is slower than the certificate and has no grid whose
looseness could hide or invent clearance, so each checks the other.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..numeric.arrays import Floats

__all__ = ["Recheck", "EntryTube", "TriangleWall", "recheck_motion", "surface_wall", "voxel_wall"]


BATCH = 1 << 16
"""Cells measured at a time."""

SAMPLES_MAX = 50_000_000
"""Exact distances measured at most."""

BLOCK = 16
"""Steps in a cell to begin with."""

ROUND_OFF_MM = 1e-9
"""Length that is round-off."""

BORE_ROUND_OFF_MM = 1e-3
"""How far a stated bore may lie above the clearance at the entry."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TriangleWall:
    """Triangles between the lumen and the rest, and which side is the lumen.

    Parameters
    ----------
    vertices : (n, 3) float
        World frame [mm].
    faces : (m, 3) int
    lumen : (i, j, k) bool, optional
        Voxels of the lumen; without them a point is in the lumen if the triangles wind about it.
    affine : (4, 4) float, optional
        Index of a voxel's centre to world [mm]; with `lumen`.
    """

    vertices: Floats
    faces: NDArray[np.int64]
    lumen: NDArray[np.bool_] | None = None
    affine: Floats | None = None
    _boxes: Any = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        import igl

        boxes = igl.AABB()
        boxes.init(self.vertices, self.faces)
        object.__setattr__(self, "_boxes", boxes)

    def measure_distance(self, points: Floats) -> Floats:
        """Return the exact distances (n,) of points (n, 3) to the nearest triangle [mm]."""
        return self.find_nearest(points)[0]

    def find_nearest(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the distances (n,) of points (n, 3) [mm], and the places (n, 3) of the wall."""
        # Neighbours one after the other find the same triangles in the processor's cache.
        order = np.lexsort(np.floor(points).T)
        squared, _, places = self._boxes.squared_distance(
            self.vertices, self.faces, np.ascontiguousarray(points[order])
        )
        back = np.argsort(order)
        return np.sqrt(squared)[back], np.asarray(places[back])

    def is_inside(self, points: Floats) -> NDArray[np.bool_]:
        """Return whether points (n, 3) lie in the lumen."""
        if self.lumen is None or self.affine is None:
            import igl

            winding = igl.fast_winding_number(
                self.vertices, self.faces, np.ascontiguousarray(points)
            )
            return np.asarray(winding > 0.5)
        index = np.rint(np.linalg.solve(self.affine[:3, :3], (points - self.affine[:3, 3]).T).T)
        within = ((index >= 0) & (index < self.lumen.shape)).all(axis=1)
        index[~within] = 0
        return np.asarray(self.lumen[tuple(index.astype(np.int64).T)] & within)

    def measure_clearance(self, points: ArrayLike) -> Floats:
        """Return (n,) distances to the wall [mm], negative outside the lumen."""
        places = np.asarray(points, dtype=np.float64)
        distance = self.measure_distance(places)
        return np.where(self.is_inside(places), distance, -distance)


def surface_wall(vertices: ArrayLike, faces: ArrayLike) -> TriangleWall:
    """Return the wall of closed triangles, turned outwards."""
    return TriangleWall(
        vertices=np.ascontiguousarray(vertices, dtype=np.float64),
        faces=np.ascontiguousarray(faces, dtype=np.int64),
    )


def voxel_wall(mask: ArrayLike, affine: ArrayLike) -> TriangleWall:
    """Return the faces between the voxels of the lumen and all others, as triangles.

    Parameters
    ----------
    mask : (i, j, k) bool
        The lumen.
    affine : (4, 4) float
        Index of a voxel's centre to world [mm].
    """
    lumen = np.pad(np.asarray(mask, dtype=bool), 1)
    matrix = np.array(affine, dtype=np.float64)
    matrix[:3, 3] -= matrix[:3, :3].sum(axis=1)  # the padding
    quads = []
    for axis in range(3):
        middle = np.argwhere(np.diff(lumen, axis=axis)).astype(np.float64)
        middle[:, axis] += 0.5
        side, other = 0.5 * np.eye(3)[[k for k in range(3) if k != axis]]
        corners = (-side - other, side - other, side + other, other - side)
        quads.append(np.stack([middle + corner for corner in corners], axis=1))
    corners_index = np.concatenate(quads).reshape(-1, 3)
    first = 4 * np.arange(len(corners_index) // 4)[:, None]
    return TriangleWall(
        vertices=np.ascontiguousarray(corners_index @ matrix[:3, :3].T + matrix[:3, 3]),
        faces=np.concatenate([first + [0, 1, 2], first + [0, 2, 3]]),
        lumen=lumen,
        affine=matrix,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class EntryTube:
    """The straight tube through which the scope comes in.

    Parameters
    ----------
    entry : (3,) float
        Centre of its inner end, world frame [mm].
    outward : (3,) float
        Unit vector out of the tract.
    bore : float
        Inner radius [mm].
    """

    entry: Floats
    outward: Floats
    bore: float

    def split(self, points: Floats) -> tuple[Floats, Floats]:
        """Return how far points (..., 3) are along the axis, and off it [mm]."""
        away = points - self.entry
        along = away @ self.outward
        return along, np.linalg.norm(away - along[..., None] * self.outward, axis=-1)

    def holds(self, points: Floats, radius: float) -> NDArray[np.bool_]:
        """Return whether a ball of `radius` around points (..., 3) is in the bore."""
        along, off = self.split(points)
        return np.asarray((along >= -ROUND_OFF_MM) & (off <= self.bore - radius + ROUND_OFF_MM))

    def leaves_at_end(self, inner: Floats, outer: Floats, radius: float) -> bool:
        """Return whether the way from a point in the bore to another leaves it at its end.

        That is where the ball of the bore's radius around the entry still covers it; farther out
        it would have to go through the side of the tube.
        """
        step = outer - inner
        along, _ = self.split(inner)
        forward = float(step @ self.outward)
        leaves = float(along) / -forward if forward < 0.0 else np.inf
        side = step - forward * self.outward
        away = inner - self.entry - along * self.outward
        # |away + u side| = bore - radius
        a, b = float(side @ side), float(away @ side)
        c = float(away @ away) - (self.bore - radius) ** 2
        if a > 0.0:
            leaves = min(leaves, (-b + np.sqrt(max(b * b - a * c, 0.0))) / a)
        place = inner + min(max(leaves, 0.0), 1.0) * step
        return float(np.linalg.norm(place - self.entry)) <= self.bore + 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Recheck:
    """What the second check found.

    Parameters
    ----------
    lower : float
        No point of the scope's surface comes nearer to the wall than this [mm], joints moving
        straight between steps; negative: nothing is proved. Infinite if the scope never leaves
        the introducer.
    found : float
        Smallest exact clearance of a sampled point [mm]; the true one lies between.
    step, link : float, int
        Where that was: fraction of a recorded step, and link j from joint j to joint j - 1.
    place : (3,) float
        World frame [mm].
    samples : int
        Exact distances measured.
    resolved : bool
        Whether the search ended within its tolerance.
    bore, offered : float
        Stated radius of the introducer, and exact clearance at its end [mm]; 0 and infinite
        without one. A bore that is wider than what is offered counts as negative clearance.
    """

    lower: float
    found: float
    step: float
    link: int
    place: Floats
    samples: int
    resolved: bool
    bore: float
    offered: float

    @property
    def clear(self) -> bool:
        """Whether it is shown that the body, as far as it is in the lumen, stays in it."""
        return 0.0 <= self.lower < np.inf


def recheck_motion(
    joints: ArrayLike,
    wall: TriangleWall,
    *,
    radius: float,
    tube: EntryTube | None = None,
    inflation: float = 0.0,
    tolerance: float = 0.05,
) -> Recheck:
    """Bound the clearance of a moving chain by exact distances to the wall.

    Parameters
    ----------
    joints : (steps, joints, 3) float
        World frame [mm]; joint 0 is the head, joints move straight between steps.
    wall : TriangleWall
        See `surface_wall` and `voxel_wall`.
    radius : float
        Of the body [mm].
    tube : EntryTube, optional
        The introducer. Free of the wall is only what stands in it from the tail on, came in
        through its end, and within the clearance at the entry.
    inflation : float
        All points within this of the lumen count as lumen [mm]: the clearance is this plus the
        distance to the wall inside, and this minus it outside.
    tolerance : float
        How far `lower` may stay below `found` [mm].

    Raises
    ------
    InputError
        If joints are not finite or not in 3-D, or a number is out of range.
    """
    chains = np.asarray(joints, dtype=np.float64)
    if chains.ndim != 3 or chains.shape[1] < 2 or chains.shape[2] != 3:
        raise InputError(f"joints have shape {chains.shape}: it must be (steps, joints, 3)")
    if not np.isfinite(chains).all():
        raise InputError("joints are not all finite")
    for name, value in (("radius", radius), ("inflation", inflation)):
        if not 0.0 <= value < np.inf:
            raise InputError(f"{name} is {value:g} mm: it must lie in [0, inf) mm")
    if not 1e-4 <= tolerance <= 10.0:
        raise InputError(f"tolerance is {tolerance:g} mm: it must lie in [0.0001, 10] mm")
    offered, bore = np.inf, 0.0
    if tube is not None:
        bore = tube.bore
        offered = float(wall.measure_clearance(tube.entry[None])[0]) + inflation
        tube = EntryTube(entry=tube.entry, outward=tube.outward, bore=min(bore, max(offered, 0.0)))
    search = _Search(chains, wall, radius, tube, inflation)
    lower = search.run(tolerance)
    found, place, at = search.found, search.place, search.at
    if tube is not None and bore > offered + BORE_ROUND_OFF_MM and offered - bore < lower:
        lower = min(lower, offered - bore)
        if lower < found:
            found, place, at = offered - bore, tube.entry, (0.0, 1)
    return Recheck(
        lower=float(lower),
        found=float(found),
        step=at[0],
        link=at[1],
        place=place,
        samples=search.samples,
        resolved=search.resolved,
        bore=float(bore),
        offered=float(offered),
    )


@dataclass(eq=False)
class _Cells:
    """Ranges of time and body: link j from joint j (u = 0) to joint j - 1 (u = 1)."""

    t0: Floats
    t1: Floats
    u0: Floats
    u1: Floats
    link: NDArray[np.int64]
    near: Floats
    """(n, 3): a place of which the clearance is known, ..."""
    known: Floats
    """... and that clearance before inflation; 0 where it is not."""

    def __len__(self) -> int:
        return len(self.link)

    def take(self, chosen: slice | NDArray[np.bool_]) -> _Cells:
        return _Cells(*(getattr(self, name)[chosen] for name in _COLUMNS))


_COLUMNS = ("t0", "t1", "u0", "u1", "link", "near", "known")


def _join(parts: list[_Cells]) -> _Cells:
    return _Cells(*(np.concatenate([getattr(p, name) for p in parts]) for name in _COLUMNS))


class _Search:
    """Branch and bound over one motion."""

    def __init__(
        self,
        joints: Floats,
        wall: TriangleWall,
        radius: float,
        tube: EntryTube | None,
        inflation: float,
    ) -> None:
        # A motion of one step stands still.
        self.joints = joints if len(joints) > 1 else np.concatenate([joints, joints])
        self.wall, self.radius, self.tube, self.inflation = wall, radius, tube, inflation
        moves = np.linalg.norm(np.diff(self.joints, axis=0), axis=2)
        self.travel = np.concatenate([np.zeros((1, moves.shape[1])), np.cumsum(moves, axis=0)])
        steps, count, _ = self.joints.shape
        self.waiting = np.full(steps, count, dtype=np.int64)
        self.sideways = np.ones(steps, dtype=bool)
        if tube is not None:
            self._mark_waiting(tube)
        self.later = _pile_maxima(self.waiting)
        self.found, self.samples, self.resolved = np.inf, 0, True
        self.place, self.at = np.zeros(3), (0.0, 0)

    def _mark_waiting(self, tube: EntryTube) -> None:
        """From which joint on the chain stands in the tube, at every step.

        A joint does not count if it came in through the side, and none does while the chain
        leaves the tube through its side.
        """
        joints, radius = self.joints, self.radius
        steps, count, _ = joints.shape
        held = tube.holds(joints, radius)
        from_tail = np.logical_and.accumulate(held[:, ::-1], axis=1).sum(axis=1)
        for t in range(steps):
            first = count - int(from_tail[t])
            if t > 0:
                for k in range(int(self.waiting[t - 1]) - 1, first - 1, -1):
                    if not tube.leaves_at_end(joints[t, k], joints[t - 1, k], radius):
                        first = k + 1
                        break
            self.sideways[t] = 0 < first < count and not tube.leaves_at_end(
                joints[t, first], joints[t, first - 1], radius
            )
            self.waiting[t] = count if self.sideways[t] else first

    def run(self, tolerance: float) -> float:
        """Return a lower bound of the clearance, `tolerance` or less below the smallest found."""
        self._look_first()
        stack = [self._cover()]
        lower = np.inf
        while stack:
            cells = stack.pop()
            if len(cells) > BATCH:
                stack.append(cells.take(slice(BATCH, None)))
                cells = cells.take(slice(0, BATCH))
            cells = cells.take(~self._excuse(cells))
            if not len(cells):
                continue
            clearance, reach, drift, along, centre = self._measure(cells)
            bound = clearance + self.inflation - self.radius - reach
            settled = (bound >= self.found - tolerance) | (reach <= 0.25 * tolerance)
            if self.samples >= SAMPLES_MAX:
                self.resolved = self.resolved and bool(settled.all())
                settled[:] = True
            if settled.any():
                lower = min(lower, float(bound[settled].min()))
            if not settled.all():
                cells.near, cells.known = centre, clearance
                stack.append(_halve(cells, drift > along, ~settled))
                if len(stack) > 1 and len(stack[-1]) + len(stack[-2]) <= BATCH:
                    last = stack.pop()
                    stack[-1] = _join([stack[-1], last])
        return lower

    def _cover(self) -> _Cells:
        """Return cells that cover all links and times."""
        steps, count, _ = self.joints.shape
        begins = np.arange(0, steps - 1, BLOCK)
        grid = np.meshgrid(begins, np.arange(1, count), indexing="ij")
        first, link = grid[0].ravel().astype(np.float64), grid[1].ravel().astype(np.int64)
        size = len(first)
        return _Cells(
            t0=first,
            t1=np.minimum(first + BLOCK, steps - 1.0),
            u0=np.zeros(size),
            u1=np.ones(size),
            link=link,
            near=np.zeros((size, 3)),
            known=np.zeros(size),
        )

    def _look_first(self) -> None:
        """Sample some thousand places, to have something to compare with."""
        steps, count, _ = self.joints.shape
        times = np.unique(np.linspace(0, steps - 1, min(steps, 60)).astype(np.int64))
        grid = np.meshgrid(times, np.arange(1, count), (0.0, 0.5, 1.0), indexing="ij")
        time, share = (grid[k].ravel().astype(np.float64) for k in (0, 2))
        link = grid[1].ravel().astype(np.int64)
        size = len(time)
        spots = _Cells(time, time, share, share, link, np.zeros((size, 3)), np.zeros(size))
        spots = spots.take(~self._excuse(spots))
        for start in range(0, len(spots), BATCH):
            self._measure(spots.take(slice(start, start + BATCH)))

    def _place(
        self, time: Floats, joint: NDArray[np.int64], values: Floats | None = None
    ) -> Floats:
        """Return where joints are at fractional steps (or their `values` then)."""
        table = self.joints if values is None else values
        before = np.minimum(time.astype(np.int64), len(table) - 2)
        part = time - before
        if table.ndim == 3:
            part = part[:, None]
        return np.asarray(table[before, joint] * (1.0 - part) + table[before + 1, joint] * part)

    def _excuse(self, cells: _Cells) -> NDArray[np.bool_]:
        """Return which cells lie in the introducer as a whole."""
        if self.tube is None:
            return np.zeros(len(cells), dtype=bool)
        first = cells.t0.astype(np.int64)
        last = np.ceil(cells.t1).astype(np.int64)
        most = _read_maximum(self.later, first, last)
        free = cells.link - 1 >= most
        # Of the link at the end of the tube the part within; its tail waits, or comes to or from.
        edge = ~free & (last - first <= 1) & (cells.link + 1 >= most)
        edge &= cells.link >= np.minimum(self.waiting[first], self.waiting[last])
        edge &= ~(self.sideways[first] | self.sideways[last])
        for time in (cells.t0, cells.t1):
            chosen = np.flatnonzero(edge)
            tails = self._place(time[chosen], cells.link[chosen])
            heads = self._place(time[chosen], cells.link[chosen] - 1)
            ends = tails + cells.u1[chosen, None] * (heads - tails)
            edge[chosen] = self.tube.holds(tails, self.radius) & self.tube.holds(ends, self.radius)
        return np.asarray(free | edge)

    def _measure(self, cells: _Cells) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Measure the middles of cells, and how far any point of a cell can be from its middle."""
        time, share = 0.5 * (cells.t0 + cells.t1), 0.5 * (cells.u0 + cells.u1)
        # Cells of several steps are measured at a step, where joints turn.
        time = np.where(cells.t1 - cells.t0 > 1.0, np.floor(time), time)
        tails, heads = self._place(time, cells.link), self._place(time, cells.link - 1)
        centre = tails + share[:, None] * (heads - tails)
        moved = []
        for joint in (cells.link, cells.link - 1):
            begin, now, end = (
                self._place(t, joint, self.travel) for t in (cells.t0, time, cells.t1)
            )
            moved.append(np.maximum(now - begin, end - now))
        drift = np.maximum(
            (1.0 - cells.u0) * moved[0] + cells.u0 * moved[1],
            (1.0 - cells.u1) * moved[0] + cells.u1 * moved[1],
        )
        along = 0.5 * (cells.u1 - cells.u0) * np.linalg.norm(heads - tails, axis=1)
        distance = self.wall.measure_distance(centre)
        # No wall lies between a place and another that is nearer to it than the wall.
        same = np.linalg.norm(centre - cells.near, axis=1) < np.abs(cells.known)
        inside = cells.known > 0.0
        if not same.all():
            inside[~same] = self.wall.is_inside(centre[~same])
        clearance = np.where(inside, distance, -distance)
        self.samples += len(centre)
        spots = _Cells(time, time, share, share, cells.link, centre, clearance)
        counted = np.flatnonzero(~self._excuse(spots))
        if len(counted):
            best = counted[int(np.argmin(clearance[counted]))]
            value = float(clearance[best]) + self.inflation - self.radius
            if value < self.found:
                self.found, self.place = value, centre[best]
                self.at = (float(time[best]), int(cells.link[best]))
        return clearance, drift + along, drift, along, centre


def _halve(cells: _Cells, in_time: NDArray[np.bool_], chosen: NDArray[np.bool_]) -> _Cells:
    """Cut the chosen cells in two, in time or along the link."""
    parts = []
    by_time = cells.take(chosen & in_time)
    middle = 0.5 * (by_time.t0 + by_time.t1)
    middle = np.where(by_time.t1 - by_time.t0 > 1.0, np.floor(middle), middle)
    every = slice(None)
    low, high = by_time.take(every), by_time.take(every)
    low.t1, high.t0 = middle, middle
    parts += [low, high]
    by_link = cells.take(chosen & ~in_time)
    middle = 0.5 * (by_link.u0 + by_link.u1)
    low, high = by_link.take(every), by_link.take(every)
    low.u1, high.u0 = middle, middle
    return _join([*parts, low, high])


def _pile_maxima(values: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return maxima of all runs of 1, 2, 4 ... values, for `_read_maximum`."""
    piles = [values]
    while 2 * (1 << (len(piles) - 1)) <= min(len(values), 2 * BLOCK):
        half = 1 << (len(piles) - 1)
        piles.append(np.maximum(piles[-1][:-half], piles[-1][half:]))
    return piles


def _read_maximum(
    piles: list[NDArray[np.int64]], first: NDArray[np.int64], last: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the maxima of the values from `first` to `last`, both included."""
    result = np.empty(len(first), dtype=np.int64)
    level = np.log2(last - first + 1).astype(np.int64)
    for k in np.unique(level):
        chosen = level == k
        pile = piles[k]
        result[chosen] = np.maximum(pile[first[chosen]], pile[last[chosen] - (1 << k) + 1])
    return result
