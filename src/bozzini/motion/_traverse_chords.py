"""Which chords of a line have the room for a body: the bound of its links from below."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..duct.polyline import measure_arc_length, resample_polyline
from ..duct.protocol import Duct

__all__ = ["ChordScan", "scan_line"]

CHORDS_MAX = 1000
"""The line is divided into about this many segments at most for its chords."""

FINE = 0.25
"""Nor are they shorter than this [mm], or this fraction of the room to spare if that is less."""

SHARE = 0.02


@dataclass(frozen=True, kw_only=True, eq=False)
class ChordScan:
    """The chords of a line to which a link does not fit, the first from each place on.

    Parameters
    ----------
    start : (k, dim) float
        Where they begin [mm].
    first, last : (k,) float
        Arc length of their ends [mm].
    length : (k,) float
        Of the chords, at least [mm].
    value, by, place
        `LinkLimits.link_low`, `link_low_by` and `link_low_at`.
    """

    start: NDArray[np.float64]
    first: NDArray[np.float64]
    last: NDArray[np.float64]
    length: NDArray[np.float64]
    value: float
    by: str
    place: float

    def at(self, arc: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the shortest of them that spans each place (n,) at `points` (n, dim).

        A link that is stopped before it spans a place counts with the length that would.
        """
        gaps = np.linalg.norm(points[:, None] - self.start, axis=-1)
        length = np.where(self.last < arc[:, None], np.maximum(gaps, self.length), self.length)
        length = np.where(self.first <= arc[:, None], length, math.inf)
        return np.asarray(length.min(axis=1, initial=math.inf))


def scan_line(
    duct: Duct,
    points: NDArray[np.float64],
    radius: float,
    room: float,
    longest: float = math.inf,
) -> ChordScan:
    """Find the shortest chord of a line (n, dim) to which a body of some radius does not fit.

    Parameters
    ----------
    duct : Duct
    points : (n, dim) float
        World frame [mm].
    radius : float
        Of the body [mm].
    room : float
        Usual distance of the line from the wall [mm], to choose how finely to look.
    longest : float
        Longer chords are not looked at [mm]: a larger value only says that shorter ones fit.
    """
    from ._traverse_chord_kernels import TURN, scan_chords

    length = float(measure_arc_length(points)[-1])
    spare = max(room - radius, 0.1 * room)
    fine = max(min(FINE, SHARE * spare), length / CHORDS_MAX)
    dense = _divide(points, fine)
    count = len(dense) - 1
    stop, reason = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    reach = np.empty(count)
    local = np.ascontiguousarray(duct.to_grid(dense))
    scan_chords(duct.pack(), local, radius, longest, stop, reach, reason)
    arc = measure_arc_length(dense)
    hits = np.flatnonzero(stop < count)
    whole = float(np.linalg.norm(dense[-1] - dense[0]))
    low = ChordScan(
        start=dense[hits],
        first=arc[hits],
        last=arc[stop[hits] + 1],
        length=reach[hits],
        value=whole,
        by="length",
        place=math.inf,
    )
    if len(hits) == 0 or low.length.min() >= whole:
        return low
    worst = int(np.argmin(low.length))
    place = 0.5 * float(low.first[worst] + low.last[worst])
    if low.length[worst] == 0.0:  # no room even for one joint
        place = float(arc[int(np.argmax(duct.signed_distance(dense)))])
    return ChordScan(
        start=low.start,
        first=low.first,
        last=low.last,
        length=low.length,
        value=float(low.length[worst]),
        by="turn" if reason[hits[worst]] == TURN else "wall",
        place=place,
    )


def _divide(points: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return a polyline with every segment divided into equal parts of at most `spacing`."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    keep = np.concatenate([[True], steps > 0.0])
    kept = points[keep]
    parts = [
        resample_polyline(kept[k : k + 2], float(step) / math.ceil(float(step) / spacing))[:-1]
        for k, step in enumerate(steps[steps > 0.0])
    ]
    return np.concatenate([*parts, kept[-1:]])
