"""Numba kernels of a chain of 7-bar linkages in closed form.

A segment of length ``l`` whose tendons get shorter by ``2 a (e . m)`` has its link along
``(mx, my, mz)``, ``mz = sqrt(1 - mx^2 - my^2)``, and turns its end link by
``H = (1 - 2 m m') diag(1, 1, -1)``, a rotation by ``2 asin(|(mx, my)|)`` without twist.
"""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, error_model="numpy")
def fill_linkage_points(owner, shares, lengths, bends, points):
    """Fill joints ``points`` (n, k + 1, 3) for ``bends`` (n, m, 2).

    Segment ``k`` of length ``lengths[k]`` takes ``shares[k]`` of the bend of its section
    ``owner[k]``.
    """
    for n in range(bends.shape[0]):
        # Columns of the rotation so far.
        ax, ay, az = 1.0, 0.0, 0.0
        bx, by, bz = 0.0, 1.0, 0.0
        cx, cy, cz = 0.0, 0.0, 1.0
        x, y, z = 0.0, 0.0, 0.0
        points[n, 0, 0] = x
        points[n, 0, 1] = y
        points[n, 0, 2] = z
        section = -1
        share = -1.0
        mx = my = mz = 0.0
        for k in range(owner.size):
            if owner[k] != section or shares[k] != share:
                section = owner[k]
                share = shares[k]
                mx = 0.5 * share * bends[n, section, 0]
                my = 0.5 * share * bends[n, section, 1]
                mz = math.sqrt(max(0.0, 1.0 - mx * mx - my * my))
            # The link's direction; H mirrors the frame in the plane across it, then flips z.
            ux = ax * mx + bx * my + cx * mz
            uy = ay * mx + by * my + cy * mz
            uz = az * mx + bz * my + cz * mz
            length = lengths[k]
            x += length * ux
            y += length * uy
            z += length * uz
            points[n, k + 1, 0] = x
            points[n, k + 1, 1] = y
            points[n, k + 1, 2] = z
            ax -= 2.0 * mx * ux
            ay -= 2.0 * mx * uy
            az -= 2.0 * mx * uz
            bx -= 2.0 * my * ux
            by -= 2.0 * my * uy
            bz -= 2.0 * my * uz
            cx = 2.0 * mz * ux - cx
            cy = 2.0 * mz * uy - cy
            cz = 2.0 * mz * uz - cz


@njit(cache=True, error_model="numpy")
def fill_linkage_frames(owner, shares, lengths, bends, frames):
    """Fill ``frames`` (n, k + 1, 4, 4): the joint, and the axes of its coupler link."""
    for n in range(bends.shape[0]):
        for i in range(4):
            for j in range(4):
                frames[n, 0, i, j] = 1.0 if i == j else 0.0
        for k in range(owner.size):
            mx = 0.5 * shares[k] * bends[n, owner[k], 0]
            my = 0.5 * shares[k] * bends[n, owner[k], 1]
            mz = math.sqrt(max(0.0, 1.0 - mx * mx - my * my))
            for i in range(3):
                a = frames[n, k, i, 0]
                b = frames[n, k, i, 1]
                c = frames[n, k, i, 2]
                u = a * mx + b * my + c * mz
                frames[n, k + 1, i, 0] = a - 2.0 * mx * u
                frames[n, k + 1, i, 1] = b - 2.0 * my * u
                frames[n, k + 1, i, 2] = 2.0 * mz * u - c
                frames[n, k + 1, i, 3] = frames[n, k, i, 3] + lengths[k] * u
                frames[n, k + 1, 3, i] = 0.0
            frames[n, k + 1, 3, 3] = 1.0
