"""Numba: the hinges of a chain from the directions of its links."""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_matrix, copy_vector


@kernel
def fill_bends(joints, base, bends):
    """Fill the hinges (s, 2 n) of chains (s, n + 1, 3), base first; `base` (3, 3) has its axes.

    A joint turns about its x first, then about its y.
    """
    turn, after = np.empty((3, 3)), np.empty((3, 3))
    for s in range(joints.shape[0]):
        copy_matrix(base, turn)
        for k in range(joints.shape[1] - 1):
            way = joints[s, k + 1] - joints[s, k]
            way /= math.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
            x = turn[0, 0] * way[0] + turn[1, 0] * way[1] + turn[2, 0] * way[2]
            y = turn[0, 1] * way[0] + turn[1, 1] * way[1] + turn[2, 1] * way[2]
            z = turn[0, 2] * way[0] + turn[1, 2] * way[1] + turn[2, 2] * way[2]
            a = math.atan2(-y, z)
            b = math.asin(min(max(x, -1.0), 1.0))
            bends[s, 2 * k] = a
            bends[s, 2 * k + 1] = b
            ca, sa, cb, sb = math.cos(a), math.sin(a), math.cos(b), math.sin(b)
            for i in range(3):
                middle = ca * turn[i, 1] + sa * turn[i, 2]
                ahead = -sa * turn[i, 1] + ca * turn[i, 2]
                after[i, 0] = cb * turn[i, 0] - sb * ahead
                after[i, 1] = middle
                after[i, 2] = sb * turn[i, 0] + cb * ahead
            copy_matrix(after, turn)


@kernel
def drag_joints(heads, joints, length):
    """Fill chains (s, n + 1, 3) that are dragged by their heads (s, 3), from the first one on."""
    for s in range(1, joints.shape[0]):
        copy_vector(heads[s], joints[s, 0])
        for k in range(1, joints.shape[1]):
            way = joints[s - 1, k] - joints[s, k - 1]
            way *= length / math.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
            for i in range(3):
                joints[s, k, i] = joints[s, k - 1, i] + way[i]
