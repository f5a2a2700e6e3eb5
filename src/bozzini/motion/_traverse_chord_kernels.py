"""Numba kernels: the chords of a line that have the room for a body, and those that have not."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ..duct._clearance_kernels import clearance_bound

__all__ = ["TURN", "WALL", "scan_chords"]

WALL = 1
TURN = 2

NEAR = 16
"""Pairs of segments this near along the line are judged by the directions between them."""

SAMPLES = 128
"""A chord is looked at in about this many places at most."""

TABLE_MAX = 2500
"""For lines of more segments what is known of shorter chords is not kept: it takes their square."""


@njit(cache=True)
def _chord_room(duct, middles, i, j, need, grain):
    """Lower bound of the clearance along the chord between two places, or a value below need."""
    ax, ay, az = middles[i, 0], middles[i, 1], middles[i, 2]
    dx = middles[j, 0] - ax
    dy = middles[j, 1] - ay
    dz = middles[j, 2] - az
    size = math.sqrt(dx * dx + dy * dy + dz * dz)
    room = clearance_bound(duct, ax, ay, az)
    if room < need:
        return room
    least = room
    t = 0.0
    while t < size:
        hop = max(room - need, grain)
        end = min(t + hop, size)
        hop = end - t
        u = end / size
        last = clearance_bound(duct, ax + u * dx, ay + u * dy, az + u * dz)
        if last < need:
            return last
        # From either end the clearance falls by at most 1 per mm.
        least = min(least, 0.5 * (room + last - hop))
        if least < need:
            return least
        room = last
        t = end
    return least


@njit(cache=True)
def _gap_to_chord(middles, i, j, m):
    """Distance of a place from the chord between two others."""
    square = 0.0
    along = 0.0
    for c in range(3):
        d = middles[j, c] - middles[i, c]
        square += d * d
        along += d * (middles[m, c] - middles[i, c])
    u = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
    gap = 0.0
    for c in range(3):
        d = middles[m, c] - middles[i, c] - u * (middles[j, c] - middles[i, c])
        gap += d * d
    return math.sqrt(gap)


@njit(cache=True)
def _turns_back(points, i, j, pad):
    """Whether a chord from segment i to segment j may be 90 degrees or more from either."""
    n = points.shape[1]
    if j - i <= NEAR:
        ahead = True
        for k in range(i, j + 1):
            first = 0.0
            last = 0.0
            for c in range(n):
                part = points[k + 1, c] - points[k, c]
                first += part * (points[i + 1, c] - points[i, c])
                last += part * (points[j + 1, c] - points[j, c])
            if first <= 0.0 or last <= 0.0:
                ahead = False
                break
        if ahead:
            return False
    first = 0.0
    last = 0.0
    size_i = 0.0
    size_j = 0.0
    for c in range(n):
        chord = 0.5 * (points[j, c] + points[j + 1, c] - points[i, c] - points[i + 1, c])
        ti = points[i + 1, c] - points[i, c]
        tj = points[j + 1, c] - points[j, c]
        first += chord * ti
        last += chord * tj
        size_i += ti * ti
        size_j += tj * tj
    return first <= pad * math.sqrt(size_i) or last <= pad * math.sqrt(size_j)


@njit(cache=True)
def scan_chords(duct, points, radius, longest, stop, length, reason):
    """From every segment of a line, find the first later one to which a link does not fit.

    Points on segments i and j are at most half a segment from their middles, so every point of a
    chord between them is within half of the longer one of the chord between the middles.

    Parameters
    ----------
    duct : named tuple
        The packed duct.
    points : (n, 3) float
        The line, in the kernels' frame.
    radius : float
        Of the body [mm].
    longest : float
        Chords longer than this are not looked at [mm].
    stop : (n - 1,) int
        Filled with the segment j at which the scan from i ended; n - 1 if it never did.
    length : (n - 1,) float
        Filled with a lower bound of the length of chords there; infinite if it never ended.
    reason : (n - 1,) int
        Filled with `WALL` or `TURN`.
    """
    count = points.shape[0] - 1
    sides = np.empty(count)
    middles = np.empty((count, 3))
    for i in range(count):
        square = 0.0
        for c in range(3):
            square += (points[i + 1, c] - points[i, c]) ** 2
            middles[i, c] = 0.5 * (points[i, c] + points[i + 1, c])
        sides[i] = math.sqrt(square)
    # Lower bounds of the clearance along chords, from later rows on.
    kept = count if count <= TABLE_MAX else 0
    margins = np.full((kept, kept), -np.inf)
    for i in range(count - 1, -1, -1):
        margin = -np.inf
        stop[i] = count
        length[i] = np.inf
        reason[i] = 0
        for j in range(i, count):
            pad = 0.5 * max(sides[i], sides[j])
            both = 0.5 * (sides[i] + sides[j])
            why = 0
            square = 0.0
            for c in range(3):
                square += (middles[j, c] - middles[i, c]) ** 2
            size = math.sqrt(square)
            if size - both > longest:
                break
            if j > i and _turns_back(points, i, j, both):
                why = TURN
            if why == 0:
                if j > i:
                    margin -= 0.5 * (sides[j - 1] + sides[j])
                if margin < radius + pad and j > i + 1 and kept > 0:
                    # A chord is no farther from two shorter ones than the place between is.
                    m = (i + j) // 2
                    away = _gap_to_chord(middles, i, j, m)
                    margin = max(margin, min(margins[i, m], margins[m, j]) - away)
                if margin < radius + pad:
                    grain = max(0.25 * pad, size / SAMPLES)
                    margin = _chord_room(duct, middles, i, j, radius + pad, grain)
                if kept > 0:
                    margins[i, j] = margin
                if margin < radius + pad:
                    why = WALL
            if why != 0:
                stop[i] = j
                length[i] = max(size - both, 0.0)
                reason[i] = why
                break
