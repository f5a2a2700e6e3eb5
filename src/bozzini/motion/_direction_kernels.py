"""Numba kernels on all directions of one link: the nearest one with room, and the roomiest.

A direction is given by its normal coordinates (a, b) around the old one, whose norm is the angle
between them; ``frame`` holds the old direction and two unit vectors normal to it. The exponential
map of a sphere never lengthens, so two tails are at most ``length`` times the distance of their
coordinates apart, and a duct whose value changes by at most `slope` per mm bounds a whole square
of directions by the value at its centre. In the plane b = 0, and squares are intervals.

The free space is a duct united with the introducer, a ray from ``intro[:3]`` along ``intro[3:6]``
with the radius ``intro[6]`` (a capsule, exact distance); a radius of 0 or less means none.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit

from ..duct._clearance_kernels import GridData, clearance_estimate, clearance_slope
from ._introducer_kernels import offset_from_ray

__all__ = [
    "TOLERANCE",
    "bound_packed_slope",
    "duct_and_gradient",
    "duct_value",
    "find_roomiest",
    "march_circle",
    "point_tail",
    "search_sphere",
]

TOLERANCE = 1e-9
"""Feasibility and convergence tolerance of the link step [mm]."""

MARCH = 1e-3
"""Least step of the march around a circle [mm]: a gap in the wall may hide in it."""


def bound_packed_slope(data: object) -> float:
    """Return by how much the value of a packed duct changes per mm at most; not compiled.

    1 for shapes; sqrt(3) for the trilinear interpolant of a sampled field, each of whose three
    partial derivatives is a mean of difference quotients of distances.
    """
    return math.sqrt(3.0) if isinstance(data, GridData) else 1.0


@njit(cache=True, inline="always")
def duct_value(duct, intro, x, y, z):
    """Signed distance to the lumen united with the introducer."""
    s = -clearance_estimate(duct, x, y, z)
    if intro[6] > 0.0:
        dx, dy, dz = offset_from_ray(intro, x, y, z)
        s = min(s, math.sqrt(dx * dx + dy * dy + dz * dz) - intro[6])
    return s


@njit(cache=True, inline="always")
def duct_and_gradient(duct, intro, x, y, z):
    """Signed distance to the lumen united with the introducer, and its gradient."""
    room, gx, gy, gz = clearance_slope(duct, x, y, z)
    s, gx, gy, gz = -room, -gx, -gy, -gz
    if intro[6] > 0.0:
        dx, dy, dz = offset_from_ray(intro, x, y, z)
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        if distance - intro[6] < s:
            s = distance - intro[6]
            scale = 1.0 / max(distance, 1e-12)
            gx = dx * scale
            gy = dy * scale
            gz = dz * scale
    return s, gx, gy, gz


@njit(cache=True)
def point_tail(head, frame, length, a, b, tail):
    """Fill `tail` with the point at `length` from `head` in the direction (a, b)."""
    angle = math.sqrt(a * a + b * b)
    ahead = length * math.cos(angle)
    aside = length * (math.sin(angle) / angle if angle > 1e-12 else 1.0)
    for n in range(3):
        tail[n] = head[n] + ahead * frame[0, n] + aside * (a * frame[1, n] + b * frame[2, n])


@njit(cache=True)
def _value_at(duct, intro, head, frame, length, room, a, b, tail):
    """Return how much room lacks in the direction (a, b), and fill `tail`."""
    point_tail(head, frame, length, a, b, tail)
    return duct_value(duct, intro, tail[0], tail[1], tail[2]) + room


@njit(cache=True)
def _first_room(duct, intro, head, frame, length, room, a, b, low, c_low, high, c_high, tail):
    """Return the fraction of (a, b), in (low, high], at which room begins; fill `tail`.

    False position with the Illinois rule; room lacks by `c_low` at `low`, and not at `high`.
    """
    scale = math.sqrt(a * a + b * b)
    last = c_high
    side = 0
    while last < -TOLERANCE and (high - low) * scale > 1e-12:
        middle = low + c_low / (c_low - c_high) * (high - low)
        if not low < middle < high:
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
        c = _value_at(duct, intro, head, frame, length, room, middle * a, middle * b, tail)
        if c <= 0.0:
            high = middle
            last = c_high = c
            if side == 1:
                c_low *= 0.5
            side = 1
        else:
            low = middle
            c_low = c
            if side == -1:
                c_high *= 0.5
            side = -1
    point_tail(head, frame, length, high * a, high * b, tail)
    return high


@njit(cache=True)
def march_circle(duct, intro, head, frame, length, room, slope, tail):
    """Find the nearest direction with room in the plane, marching both ways from the old one.

    Where room lacks by c, none is within a chord of c / slope. No step is shorter than `MARCH`:
    a stretch with room is only missed if it offers less than ``slope MARCH / 2`` more than asked.

    Returns
    -------
    found : bool
    angle : float
        Signed, of the direction found, whose point is put into `tail`.
    """
    start = _value_at(duct, intro, head, frame, length, room, 0.0, 0.0, tail)
    least = MARCH / length
    angles = np.zeros(2)
    lacks = np.full(2, start)
    limit = math.pi
    answer = 0.0
    found = False
    while True:
        side = 0 if angles[0] <= angles[1] else 1
        if angles[side] >= limit:
            break
        sign = 1.0 - 2.0 * side
        before = angles[side]
        c_before = lacks[side]
        skip = 2.0 * math.asin(min(0.5 * c_before / (slope * length), 1.0))
        after = min(before + max(skip, least), limit)
        c = _value_at(duct, intro, head, frame, length, room, sign * after, 0.0, tail)
        angles[side] = after
        lacks[side] = c
        if c <= 0.0:
            after = _first_room(
                duct, intro, head, frame, length, room, sign, 0.0, before, c_before, after, c, tail
            )
            found = True
            limit = after
            answer = sign * after
            angles[side] = after
    if found:
        point_tail(head, frame, length, answer, 0.0, tail)
    return found, answer


@njit(cache=True)
def _nearest_in_square(a, b, half):
    """Distance from the origin to the square around (a, b)."""
    da = max(abs(a) - half, 0.0)
    db = max(abs(b) - half, 0.0)
    return math.sqrt(da * da + db * db)


@njit(cache=True)
def search_sphere(
    duct, intro, head, frame, length, room, slope, known, gap, finest, budget, coordinates
):
    """Find the nearest direction with room, and a bound below which none is: branch and bound.

    Squares of directions are taken up nearest first, and divided where the bound on the value does
    not exclude room in them, down to `finest`.

    Parameters
    ----------
    known : float
        Angle of a direction known to have room; infinite if there is none.
    gap : float
        By how much an angle may miss the least one [rad].
    finest : float
        Half the side of the smallest squares [rad]: one with room is only missed if it offers
        less than ``slope * length * sqrt(2) * finest`` more than asked.
    budget : int
        Values of the duct at most.
    coordinates : (2,) float
        Filled with the direction found, where it is nearer than `known`.

    Returns
    -------
    found : bool
        Whether a nearer direction than `known` was found.
    angle : float
        Of the nearest direction, infinite if none has room.
    bound : float
        No direction nearer than this has room, but for the slack of `finest`.
    count : int
        Values of the duct used.
    """
    tail = np.empty(3)
    heap = [(0.0, 0.0, 0.0, math.pi)]
    angle = known
    bound = np.inf
    found = False
    count = 0
    while len(heap) > 0:
        key, a, b, half = heapq.heappop(heap)
        if key >= angle - gap or count >= budget:
            bound = min(bound, key)
            break
        c = _value_at(duct, intro, head, frame, length, room, a, b, tail)
        count += 1
        turn = math.sqrt(a * a + b * b)
        if c <= 0.0 and turn < angle and turn <= math.pi:
            start = _value_at(duct, intro, head, frame, length, room, 0.0, 0.0, tail)
            share = _first_room(
                duct, intro, head, frame, length, room, a, b, 0.0, start, 1.0, c, tail
            )
            angle = share * turn
            coordinates[0] = share * a
            coordinates[1] = share * b
            found = True
        reach = min(math.sqrt(2.0) * half, math.pi)
        if c > 2.0 * slope * length * math.sin(0.5 * reach):
            continue
        if half <= finest:
            if c <= 0.0:
                bound = min(bound, key)
            continue
        half *= 0.5
        for i in range(4):
            na = a + (half if i % 2 == 0 else -half)
            nb = b + (half if i < 2 else -half)
            near = _nearest_in_square(na, nb, half)
            if near < angle - gap and near < math.pi:
                heapq.heappush(heap, (near, na, nb, half))
    return found, angle, max(min(bound, angle - gap), 0.0), count


@njit(cache=True)
def find_roomiest(duct, intro, head, frame, length, room, slope, planar, floor, budget, tail):
    """Find the direction where least room lacks: branch and bound.

    Parameters
    ----------
    floor : float
        Where some room lacks everywhere that was looked, the search goes on until none can have
        more than this to spare [mm].

    Returns
    -------
    lack : float
        The least found [mm], at the point put into `tail`.
    bound : float
        No direction lacks less than this; within 0.01 mm of `lack`, or a hundredth of it if that
        is more, and at least `-floor` if `lack` is positive, if the budget of values was enough.
    """
    point = np.empty(3)
    best = np.inf
    best_a = 0.0
    best_b = 0.0
    enough = np.inf
    bound = np.inf
    heap = [(-np.inf, 0.0, 0.0, math.pi)]
    count = 0
    while len(heap) > 0:
        key, a, b, half = heapq.heappop(heap)
        if key >= enough or count >= budget:
            bound = key
            break
        half *= 0.5
        for i in range(2 if planar else 4):
            na = a + (half if i % 2 == 0 else -half)
            nb = 0.0 if planar else b + (half if i < 2 else -half)
            value = _value_at(duct, intro, head, frame, length, room, na, nb, point)
            count += 1
            if value < best:
                best = value
                best_a = na
                best_b = nb
                enough = best - max(0.01, 0.01 * best)
                if best > 0.0:
                    enough = max(enough, -floor)
            reach = min(half if planar else math.sqrt(2.0) * half, math.pi)
            low = value - 2.0 * slope * length * math.sin(0.5 * reach)
            if low < enough and _nearest_in_square(na, nb, half) < math.pi:
                heapq.heappush(heap, (low, na, nb, half))
    point_tail(head, frame, length, best_a, best_b, tail)
    return best, min(bound, enough)
