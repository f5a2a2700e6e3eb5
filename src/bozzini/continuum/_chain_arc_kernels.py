"""Numba kernels of a chain of arcs: any of its points, with the derivative by all bends.

A section's change of bend moves and turns its end, and with it, like one rigid body, all beyond.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ._arc_kernels import fill_arc

__all__ = ["fill_chain", "fill_tip_jacobians", "place_point"]


@njit(cache=True)
def fill_chain(lengths, bends, frames, slopes, turns):
    """Fill the frames at the starts of all sections and at the tip, and world derivatives.

    Parameters
    ----------
    lengths : (m,) float
        Lengths of the sections [mm].
    bends : (m, 2) float
        Their bends [rad].
    frames : (m + 1, 3, 4) float
        Filled with the frames of the sections' starts, and of the tip; the base's is kept.
    slopes : (m, 2, 3) float
        Filled with the derivative of each section's end with its own bend, in the base frame.
    turns : (m, 2, 3) float
        Filled with the rotation of each section's end with its own bend, in the base frame.
    """
    frame = np.empty((3, 4))
    slope = np.empty((2, 3))
    turn = np.empty((2, 3))
    for i in range(lengths.size):
        fill_arc(lengths[i], bends[i, 0], bends[i, 1], frame, slope, turn)
        for r in range(3):
            x = frames[i, r, 0]
            y = frames[i, r, 1]
            z = frames[i, r, 2]
            for k in range(4):
                frames[i + 1, r, k] = x * frame[0, k] + y * frame[1, k] + z * frame[2, k]
            frames[i + 1, r, 3] += frames[i, r, 3]
            for k in range(2):
                slopes[i, k, r] = x * slope[k, 0] + y * slope[k, 1] + z * slope[k, 2]
                turns[i, k, r] = x * turn[k, 0] + y * turn[k, 1] + z * turn[k, 2]


@njit(cache=True)
def place_point(lengths, bends, frames, slopes, turns, section, share, point, rows):
    """Place one point of the backbone, and its derivative with all bends.

    Parameters
    ----------
    lengths, bends, frames, slopes, turns
        As `fill_chain` leaves them.
    section : int
        Section of the point.
    share : float
        How far along its section it lies, in [0, 1].
    point : (3,) float
        Filled with the place [mm].
    rows : (2 m, 3) float
        Filled with the derivatives [mm/rad]; zero past `section`.
    """
    if share == 1.0:
        for r in range(3):
            point[r] = frames[section + 1, r, 3]
            rows[2 * section, r] = slopes[section, 0, r]
            rows[2 * section + 1, r] = slopes[section, 1, r]
    else:
        frame = np.empty((3, 4))
        slope = np.empty((2, 3))
        turn = np.empty((2, 3))
        # Part of an arc is the arc of that part of the length and of the bend.
        length = share * lengths[section]
        fill_arc(length, share * bends[section, 0], share * bends[section, 1], frame, slope, turn)
        for r in range(3):
            point[r] = frames[section, r, 3]
            for k in range(3):
                point[r] += frames[section, r, k] * frame[k, 3]
            for k in range(2):
                rows[2 * section + k, r] = share * (
                    frames[section, r, 0] * slope[k, 0]
                    + frames[section, r, 1] * slope[k, 1]
                    + frames[section, r, 2] * slope[k, 2]
                )
    for i in range(section):
        dx = point[0] - frames[i + 1, 0, 3]
        dy = point[1] - frames[i + 1, 1, 3]
        dz = point[2] - frames[i + 1, 2, 3]
        for k in range(2):
            wx = turns[i, k, 0]
            wy = turns[i, k, 1]
            wz = turns[i, k, 2]
            rows[2 * i + k, 0] = slopes[i, k, 0] + wy * dz - wz * dy
            rows[2 * i + k, 1] = slopes[i, k, 1] + wz * dx - wx * dz
            rows[2 * i + k, 2] = slopes[i, k, 2] + wx * dy - wy * dx
    rows[2 * section + 2 :] = 0.0


@njit(cache=True)
def fill_tip_jacobians(lengths, bends, tips, jacobians):
    """Fill tip frames (n, 4, 4) and geometric Jacobians (n, 6, 2 m) in the base frame.

    Rows are velocity of the tip's point, then angular velocity, per unit of each bend.
    """
    sections = lengths.size
    frames = np.zeros((sections + 1, 3, 4))
    slopes = np.empty((sections, 2, 3))
    turns = np.empty((sections, 2, 3))
    point = np.empty(3)
    rows = np.empty((2 * sections, 3))
    for r in range(3):
        frames[0, r, r] = 1.0
    for n in range(bends.shape[0]):
        fill_chain(lengths, bends[n], frames, slopes, turns)
        place_point(lengths, bends[n], frames, slopes, turns, sections - 1, 1.0, point, rows)
        tips[n] = 0.0
        tips[n, :3] = frames[sections]
        tips[n, 3, 3] = 1.0
        for column in range(2 * sections):
            for r in range(3):
                jacobians[n, r, column] = rows[column, r]
                jacobians[n, 3 + r, column] = turns[column // 2, column % 2, r]
