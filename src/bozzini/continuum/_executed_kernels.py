"""Numba kernels of the executed motion: points of arcs between steps, and how fast they bend."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ._arc_kernels import put_arc

__all__ = ["bound_bending", "fill_bodies"]


@njit(cache=True)
def bound_bending(lengths, bends, curving):
    """Fill `curving` (steps - 1,): bounds of the second derivative in time of any body point.

    Time counts steps. With A(s) the change of bend from the base to s, added up, it is the
    integral of A^2 over the body; A grows evenly in a section.
    """
    for step in range(bends.shape[0] - 1):
        total = 0.0
        near = 0.0
        for i in range(lengths.size):
            change = math.hypot(
                bends[step + 1, i, 0] - bends[step, i, 0], bends[step + 1, i, 1] - bends[step, i, 1]
            )
            far = near + change
            total += lengths[i] * (near * near + near * far + far * far) / 3.0
            near = far
        curving[step] = total


@njit(cache=True)
def fill_bodies(lengths, chords, frame, outward, total, bends, advances, steps, shares, joints):
    """Fill chains of points on the arcs at times between steps, tip first.

    Parameters
    ----------
    chords : (m,) int
        Chords of each section.
    frame : (4, 4) float
        The robot's base when wholly inserted.
    outward : (3,) float
        The way it is drawn back.
    total : float
        Length of the robot [mm].
    steps, shares : (n,) int, (n,) float
        Times: a share of the way from a step to the next.
    joints : (n, sum of chords + 1, 3) float
        Filled.
    """
    before = np.empty((4, 4))
    after = np.empty((4, 4))
    last = joints.shape[1] - 1
    for n in range(steps.size):
        step = steps[n]
        f = shares[n]
        following = min(step + 1, bends.shape[0] - 1)
        back = total - advances[step] - f * (advances[following] - advances[step])
        before[:] = frame
        for r in range(3):
            before[r, 3] += back * outward[r]
            joints[n, last, r] = before[r, 3]
        k = last
        for i in range(lengths.size):
            x = bends[step, i, 0] + f * (bends[following, i, 0] - bends[step, i, 0])
            y = bends[step, i, 1] + f * (bends[following, i, 1] - bends[step, i, 1])
            for c in range(chords[i]):
                share = (c + 1.0) / chords[i]
                put_arc(before, share * lengths[i], share * x, share * y, after)
                k -= 1
                for r in range(3):
                    joints[n, k, r] = after[r, 3]
            before[:] = after
