"""Shape the head path for a link length: bend it until every chord of that length is clear.

If all joints stay on the path, the body consists at any time of chords of length L, one family in
one parameter. Its clearance decides for all times, all joints, advancing or retracting.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..numeric.arrays import Floats
from ..numeric.polylines import measure_arc_length, resample_polyline
from .space import FreeSpace

TARGET_MM = 0.15
"""How much more clearance than needed the band aims at."""

SPACING_MM = 1.0
"""Distance between the band's points [mm]."""

REACH = 3
"""A push is spread over this many points to each side."""

SCHEDULES = (
    ((25, 0.5), (25, 0.5), (25, 0.5), (25, 0.5), (25, 0.5), (60, 0.2)),
    ((40, 0.5), (40, 0.4), (40, 0.3), (60, 0.2), (60, 0.1), (120, 0.05)),
)
"""Rounds of (sweeps, tension); the second is tried where the first almost succeeds."""

HOPELESS_MM = 1.5
"""A shape that lacks more than this after the first schedule is given up [mm]."""

POLISHES = (((150, 0.0),), ((60, 0.2), (60, 0.1), (150, 0.0)))
"""Rounds for a shape that lacks little: between walls that leave no `TARGET_MM`, aiming at it makes
the band swing from one to the other."""

POLISH_TARGET_MM = 0.03
"""How much more clearance than needed these aim at."""

POLISH_LACK_MM = 0.3
"""They are for a shape that lacks at most this much [mm]."""

SHORTEST_MM = 2.0
"""Links shorter than this are not tried [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapedPath:
    """A head path for one link length, introducer included, in the duct's own frame.

    Parameters
    ----------
    points : (n, 3) float
        From the far end of the introducer to the goal [mm].
    arc_length : (n,) float
        0 at the entry, negative in the introducer [mm].
    first : int
        Index of the entry.
    clearance : float
        Smallest rigorous clearance bound along any chord of the path [mm].
    tightest : float
        Arc length of the head where that is [mm].
    clear : bool
        Whether that is at least what was asked for.
    clear_until : float
        Arc length up to which all chords have what was asked for [mm].
    lacks : float
        Clearance bound of the first chord that has less [mm]; infinite if none has.
    """

    points: NDArray[np.float64]
    arc_length: NDArray[np.float64]
    first: int
    clearance: float
    tightest: float
    clear: bool
    clear_until: float
    lacks: float = math.inf

    @property
    def length(self) -> float:
        """Arc length from the entry to the goal [mm]."""
        return float(self.arc_length[-1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Band:
    """An elastic band that bends a path from the entry to the goal for one link length.

    Parameters
    ----------
    space : FreeSpace
    length : float
        Of a link [mm].
    clearance : float
        What every chord must have [mm].
    lead : float
        How far the introducer's straight line is continued outwards [mm].
    spacing : float
        Distance between the points of the shaped path [mm].
    """

    space: FreeSpace
    length: float
    clearance: float
    lead: float
    spacing: float = 0.5 * SPACING_MM

    def shape(self, path: Floats, *, thorough: bool = True) -> ShapedPath:
        """Shape a path (m, 3) in the duct's own frame, whose ends stay; return the best found.

        Its `clear` states whether it will do. If not `thorough`, one schedule is tried.
        """
        best = self.run(path, SCHEDULES[0])
        if best.clear or best.clearance < self.clearance - HOPELESS_MM or not thorough:
            return best
        best = self._polish(best)
        if best.clear:
            return best
        second = self._polish(self.run(path, SCHEDULES[1]))
        return second if second.clearance > best.clearance else best

    def _polish(self, best: ShapedPath) -> ShapedPath:
        for schedule in POLISHES:
            if best.clear or best.clearance < self.clearance - POLISH_LACK_MM:
                break
            again = self.run(best.points[best.first :], schedule, target=POLISH_TARGET_MM)
            best = again if again.clearance > best.clearance else best
        return best

    def grow_link(self, path: Floats) -> tuple[ShapedPath | None, float]:
        """Grow the link from `SHORTEST_MM`, shaping from the last success each time.

        Returns
        -------
        path : ShapedPath or None
            The path for the band's own length, or None.
        largest : float
            The largest link length that was shaped [mm]; 0 if none.
        """
        largest, current = 0.0, path
        trial, increment = min(SHORTEST_MM, self.length), 4.0
        while increment >= 0.5:
            last = trial >= self.length
            shaped = replace(self, length=trial).shape(current, thorough=last)
            if shaped.clear:
                largest, current = trial, shaped.points[shaped.first :]
                if last:
                    return shaped, largest
            elif largest == 0.0:
                break
            else:
                increment *= 0.5
            trial = min(largest + increment, self.length)
        return None, largest

    def run(
        self,
        path: Floats,
        schedule: tuple[tuple[int, float], ...],
        *,
        target: float = TARGET_MM,
    ) -> ShapedPath:
        """Run rounds of (sweeps, tension), aiming at `target` more than needed [mm]."""
        from .kernels.path import check_chords, relax_path

        space, aim = self.space.pack(), self.clearance + target
        inner = resample_polyline(path, SPACING_MM)
        outer = _lead_in(space.introducer, inner[0], self.lead)
        first = len(outer)
        for sweeps, tension in schedule:
            points = np.concatenate([outer, inner])
            relax_path(space, points, first, self.length, aim, sweeps, tension, REACH)
            inner = resample_polyline(points[first:], SPACING_MM)
        inner = resample_polyline(inner, self.spacing)
        points = np.concatenate([outer, inner])
        found = np.empty(len(points))
        aim = self.clearance + TARGET_MM
        worst = float(check_chords(space, points, first, self.length, aim, found))
        arc = measure_arc_length(points)
        arc -= arc[first]
        short = np.flatnonzero(found < self.clearance)
        return ShapedPath(
            points=points,
            arc_length=arc,
            first=first,
            clearance=worst,
            tightest=float(arc[int(np.argmin(found))]),
            clear=worst >= self.clearance,
            clear_until=max(0.0, float(arc[short[0] - 1] if len(short) else arc[-1])),
            lacks=float(found[short[0]]) if len(short) else math.inf,
        )


def _lead_in(introducer: Floats, entry: Floats, lead: float) -> Floats:
    """Return points on the introducer's line, from the outside up to just before the entry."""
    count = max(1, int(np.ceil(lead / SPACING_MM)))
    way = np.arange(count, 0, -1)[:, None] * SPACING_MM
    return np.asarray(entry + way * introducer[3:6])


def measure_folds(path: ShapedPath, length: float) -> NDArray[np.float64]:
    """Return (n,) cosines of the angle between each chord and the path at the chord's tail.

    Where it is small a joint must move far for a small head step; at 0 the path folds back.
    """
    from .kernels.path import measure_tail_cosines

    cosines = np.ones(len(path.points))
    measure_tail_cosines(path.points, path.first, length, cosines)
    return cosines


def cut_path(path: ShapedPath, arc: float) -> ShapedPath:
    """Return the part of a shaped path up to an arc length, all of whose chords are clear."""
    keep = max(int(np.searchsorted(path.arc_length, arc, "right")), path.first + 2)
    return replace(
        path,
        points=path.points[:keep],
        arc_length=path.arc_length[:keep],
        clear=arc <= path.clear_until,
        clear_until=min(arc, path.clear_until),
    )
