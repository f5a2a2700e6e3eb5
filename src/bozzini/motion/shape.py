"""Shape the head path for a link length: bend it until every chord of that length is clear.

If all joints stay on the path, the body consists at any time of chords of length L, one family in
one parameter. Its clearance decides for all times, all joints, advancing or retracting.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..numeric.polylines import measure_arc_length, resample_polyline

__all__ = ["ShapedPath", "continue_length", "cut_path", "measure_folds", "shape_path"]

TARGET = 0.15
"""How much more room than needed the band aims at [mm]."""

SPACING = 1.0
"""Distance between the band's points [mm]."""

REACH = 3
"""A push is spread over this many points to each side."""

SCHEDULES = (
    ((25, 0.5), (25, 0.5), (25, 0.5), (25, 0.5), (25, 0.5), (60, 0.2)),
    ((40, 0.5), (40, 0.4), (40, 0.3), (60, 0.2), (60, 0.1), (120, 0.05)),
)
"""Rounds of (sweeps, tension); the second is tried where the first almost succeeds."""

HOPELESS = 1.5
"""A shape that lacks more than this after the first schedule is given up [mm]."""

POLISHES = (((150, 0.0),), ((60, 0.2), (60, 0.1), (150, 0.0)))
"""Rounds for a shape that lacks little: between walls that leave no `TARGET`, aiming at it makes
the band swing from one to the other."""

POLISH_TARGET = 0.03
"""How much more room than needed these aim at [mm]."""

POLISH_LACK = 0.3
"""They are for a shape that lacks at most this much [mm]."""

SHORTEST = 2.0
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
    room : float
        Smallest rigorous clearance bound along any chord of the path [mm].
    tightest : float
        Arc length of the head where that is [mm].
    clear : bool
        Whether that is at least what was asked for.
    clear_until : float
        Arc length up to which all chords have what was asked for [mm].
    """

    points: NDArray[np.float64]
    arc_length: NDArray[np.float64]
    first: int
    room: float
    tightest: float
    clear: bool
    clear_until: float

    @property
    def length(self) -> float:
        """Arc length from the entry to the goal [mm]."""
        return float(self.arc_length[-1])


def shape_path(
    data: Any,
    intro: NDArray[np.float64],
    path: NDArray[np.float64],
    *,
    length: float,
    room: float,
    lead: float,
    thorough: bool = True,
) -> ShapedPath:
    """Shape a path from the entry to the goal for a link length.

    Parameters
    ----------
    data : named tuple
        The packed duct.
    intro : (7,) float
        The packed introducer.
    path : (m, 3) float
        First guess, in the duct's own frame; its ends stay.
    length : float
        Of a link [mm].
    room : float
        Clearance that every chord must have [mm].
    lead : float
        How far the introducer's straight line is continued outwards [mm].
    thorough : bool
        Whether to try more than the first schedule.

    Returns
    -------
    ShapedPath
        The best found; `clear` says whether it will do.
    """
    best = _run(data, intro, path, SCHEDULES[0], length, room, lead)
    if best.clear or best.room < room - HOPELESS or not thorough:
        return best
    best = _polish(data, intro, best, length, room, lead)
    if best.clear:
        return best
    second = _run(data, intro, path, SCHEDULES[1], length, room, lead)
    second = _polish(data, intro, second, length, room, lead)
    return second if second.room > best.room else best


def _polish(
    data: Any,
    intro: NDArray[np.float64],
    shaped: ShapedPath,
    length: float,
    room: float,
    lead: float,
) -> ShapedPath:
    best = shaped
    for schedule in POLISHES:
        if best.clear or best.room < room - POLISH_LACK:
            break
        points = best.points[best.first :]
        again = _run(data, intro, points, schedule, length, room, lead, target=POLISH_TARGET)
        best = again if again.room > best.room else best
    return best


def continue_length(
    data: Any,
    intro: NDArray[np.float64],
    path: NDArray[np.float64],
    *,
    length: float,
    room: float,
    lead: float,
) -> tuple[ShapedPath | None, float]:
    """Grow the link from `SHORTEST` to `length`, shaping from the last success each time.

    Returns
    -------
    path : ShapedPath or None
        The path for `length`, or None.
    largest : float
        The largest link length that was shaped [mm]; 0 if none.
    """
    largest, current = 0.0, path
    trial, increment = min(SHORTEST, length), 4.0
    while increment >= 0.5:
        shaped = shape_path(
            data, intro, current, length=trial, room=room, lead=lead, thorough=trial >= length
        )
        if shaped.clear:
            largest, current = trial, shaped.points[shaped.first :]
            if trial >= length:
                return shaped, largest
        elif largest == 0.0:
            break
        else:
            increment *= 0.5
        trial = min(largest + increment, length)
    return None, largest


def _run(
    data: Any,
    intro: NDArray[np.float64],
    path: NDArray[np.float64],
    schedule: tuple[tuple[int, float], ...],
    length: float,
    room: float,
    lead: float,
    *,
    target: float = TARGET,
) -> ShapedPath:
    from .kernels.path import relax_path

    inner = resample_polyline(path, SPACING)
    outer = _lead_in(intro, inner[0], lead)
    first = len(outer)
    for sweeps, tension in schedule:
        points = np.concatenate([outer, inner])
        relax_path(data, intro, points, first, length, room + target, sweeps, tension, REACH)
        inner = resample_polyline(points[first:], SPACING)
    return _finish(data, intro, outer, inner, length, room)


def _finish(
    data: Any,
    intro: NDArray[np.float64],
    outer: NDArray[np.float64],
    inner: NDArray[np.float64],
    length: float,
    room: float,
) -> ShapedPath:
    from .kernels.path import check_chords

    inner = resample_polyline(inner, 0.5 * SPACING)
    points = np.concatenate([outer, inner])
    first = len(outer)
    clearance = np.empty(len(points))
    worst = float(check_chords(data, intro, points, first, length, room + TARGET, clearance))
    arc = measure_arc_length(points)
    arc -= arc[first]
    short = np.flatnonzero(clearance < room)
    return ShapedPath(
        points=points,
        arc_length=arc,
        first=first,
        room=worst,
        tightest=float(arc[int(np.argmin(clearance))]),
        clear=worst >= room,
        clear_until=max(0.0, float(arc[short[0] - 1] if len(short) else arc[-1])),
    )


def _lead_in(
    intro: NDArray[np.float64], entry: NDArray[np.float64], lead: float
) -> NDArray[np.float64]:
    """Points on the introducer's line, from the outside up to just before the entry."""
    count = max(1, int(np.ceil(lead / SPACING)))
    way = np.arange(count, 0, -1)[:, None] * SPACING
    return np.asarray(entry + way * intro[3:6])


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
