"""Numba kernels of a chain of arcs: any of its points, with the derivative by all bends.

Notation of `_arc_kernels`: a section that bends by ``b`` turns about ``w = (-by, bx, 0)``; a change
``db`` turns its end by ``(1 + f2 [w] + f3 [w]^2) dw``, the left Jacobian of SO(3).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ._arc_kernels import arc_factors

__all__ = ["fill_arc", "fill_chain", "place_point"]


@njit(cache=True)
def fill_arc(length, bx, by, frame, slope, turn):
    """Fill frame, derivatives and turns of one arc, in the frame of its start.

    Parameters
    ----------
    length, bx, by : float
        Length [mm] and bend [rad].
    frame : (3, 4) float
        Filled with rotation and place of the end.
    slope : (2, 3) float
        Filled with the derivative of the place with `bx` and `by` [mm/rad].
    turn : (2, 3) float
        Filled with the rotation of the end per change of `bx` and `by`.
    """
    f1, f2, f3, g1, g2 = arc_factors(bx * bx + by * by)
    frame[0, 0] = 1.0 - bx * bx * f2
    frame[0, 1] = -bx * by * f2
    frame[0, 2] = bx * f1
    frame[1, 0] = frame[0, 1]
    frame[1, 1] = 1.0 - by * by * f2
    frame[1, 2] = by * f1
    frame[2, 0] = -frame[0, 2]
    frame[2, 1] = -frame[1, 2]
    frame[2, 2] = 1.0 - (bx * bx + by * by) * f2
    frame[0, 3] = length * bx * f2
    frame[1, 3] = length * by * f2
    frame[2, 3] = length * f1
    slope[0, 0] = length * (f2 + bx * bx * g2)
    slope[0, 1] = length * bx * by * g2
    slope[0, 2] = length * bx * g1
    slope[1, 0] = slope[0, 1]
    slope[1, 1] = length * (f2 + by * by * g2)
    slope[1, 2] = length * by * g1
    turn[0, 0] = -f3 * bx * by
    turn[0, 1] = 1.0 - f3 * by * by
    turn[0, 2] = -f2 * by
    turn[1, 0] = f3 * bx * bx - 1.0
    turn[1, 1] = f3 * bx * by
    turn[1, 2] = f2 * bx


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
