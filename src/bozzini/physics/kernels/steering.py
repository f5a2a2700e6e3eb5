"""Numba: what an environment does around its steps: lead a chain, and look where its tip is."""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.rotations import fill_quaternion_rotation, turn_quaternion
from .chain import fill_bends
from .contact import measure_gap


@kernel
def turn_axes(axes, about_x, about_y):
    """Turn axes (3, 3), in columns, by a rotation vector in their own frame."""
    unit, found, turn = np.zeros(4), np.empty(4), np.empty((3, 3))
    unit[0] = 1.0
    turn_quaternion(unit, np.array([about_x, about_y, 0.0]), found)
    fill_quaternion_rotation(found[0], found[1], found[2], found[3], turn)
    for i in range(3):
        a, b, c = axes[i, 0], axes[i, 1], axes[i, 2]
        for j in range(3):
            axes[i, j] = a * turn[0, j] + b * turn[1, j] + c * turn[2, j]


@kernel
def lead_chain(trail, arcs, count, advance, heading, base, inserted, lengths, goal):
    """Move a leader's tip on or back along its trail, and put the links onto that.

    Of `trail` (n, 3) and its arc lengths `arcs` (n,), `count` rows are used; fills `goal` (u,), the
    slide and the hinges, and returns how many rows are used then.
    """
    last = count - 1
    if advance > 0.0:
        for i in range(3):
            trail[count, i] = trail[last, i] + advance * heading[i, 2]
        arcs[count] = arcs[last] + advance
        count += 1
    elif advance < 0.0:
        end = max(arcs[last] + advance, 0.0)
        while last > 1 and arcs[last - 1] >= end:
            last -= 1
        share = (end - arcs[last - 1]) / (arcs[last] - arcs[last - 1])
        for i in range(3):
            trail[last, i] = trail[last - 1, i] + share * (trail[last, i] - trail[last - 1, i])
        arcs[last] = end
        count = last + 1
    joints, bends = np.empty((1, lengths.shape[0] + 1, 3)), np.empty((1, 2 * lengths.shape[0]))
    place, row = arcs[count - 1], count - 1
    for k in range(lengths.shape[0], -1, -1):
        at = max(place, 0.0)
        while row > 1 and arcs[row - 1] > at:
            row -= 1
        share = (at - arcs[row - 1]) / (arcs[row] - arcs[row - 1])
        for i in range(3):
            joints[0, k, i] = trail[row - 1, i] + share * (trail[row, i] - trail[row - 1, i])
        if k > 0:
            place -= lengths[k - 1]
    for i in range(3):
        joints[0, 0, i] = trail[0, i] + inserted * base[i, 2]
    fill_bends(joints, base, bends)
    goal[0] = inserted
    for k in range(bends.shape[1]):
        goal[1 + k] = bends[0, k]
    return count


@kernel
def find_place(line, arcs, tip, before, span):
    """Return how far a tip is along a way (m, 3), not farther than `span` from `before` [mm]."""
    first = max(np.searchsorted(arcs, before - span) - 1, 0)
    last = min(np.searchsorted(arcs, before + span) + 1, arcs.shape[0])
    least, found = math.inf, before
    for k in range(first, last - 1):
        length = arcs[k + 1] - arcs[k]
        along = 0.0
        for i in range(3):
            along += (tip[i] - line[k, i]) * (line[k + 1, i] - line[k, i])
        share = min(max(along / max(length, 1e-12) ** 2, 0.0), 1.0)
        off = 0.0
        for i in range(3):
            off += (tip[i] - line[k, i] - share * (line[k + 1, i] - line[k, i])) ** 2
        if off < least:
            least, found = off, arcs[k] + share * length
    return found


@kernel
def look_along(line, arcs, tip, axes, place, aim):
    """Fill (3,) with the direction in the tip's frame to a place on a way [mm]."""
    place = min(max(place, arcs[0]), arcs[-1])
    k = min(max(np.searchsorted(arcs, place), 1), arcs.shape[0] - 1)
    share = (place - arcs[k - 1]) / max(arcs[k] - arcs[k - 1], 1e-12)
    for j in range(3):
        aim[j] = 0.0
    for i in range(3):
        off = line[k - 1, i] + share * (line[k, i] - line[k - 1, i]) - tip[i]
        for j in range(3):
            aim[j] += axes[i, j] * off
    size = max(math.sqrt(aim[0] ** 2 + aim[1] ** 2 + aim[2] ** 2), 1e-9)
    for j in range(3):
        aim[j] /= size


@kernel
def watch_tip(wall, line, arcs, tip, axes, before, ahead, aims):
    """Return how far the tip is along the way, and its clearance; fill `aims` (k, 3).

    `wall` is the packed duct, the introducer and the frame, as in `find_contacts`; `before` the
    place on the way and how far it may be off now; `ahead` (k,) how far ahead is looked.
    """
    duct, tube, frame = wall
    place = find_place(line, arcs, tip, before[0], before[1])
    again = find_place(line, arcs, tip, place, before[1])
    for k in range(ahead.shape[0]):
        look_along(line, arcs, tip, axes, again + ahead[k], aims[k])
    x, y, z = frame[3, 0], frame[3, 1], frame[3, 2]
    for j in range(3):
        x += frame[j, 0] * tip[j]
        y += frame[j, 1] * tip[j]
        z += frame[j, 2] * tip[j]
    return place, measure_gap(duct, tube, x, y, z)[0]
