"""Numba kernels of a chain of arcs: any of its points, with the derivative by all bends.

A section's change of bend moves and rotates its end, and with it, like one rigid body, all beyond:
with the linear Jacobian ``v_i`` [mm/rad] and the angular one ``w_i`` of the end ``p_i`` of section
i by its own bend, in the base frame, a point ``p`` beyond moves by ``(v_i + w_i x (p - p_i))
db_i``. Bends come section by section, ``theta cos(phi)``, then ``theta sin(phi)`` [rad].
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_matrix, set_identity

# Numba kernels of constant-curvature chains, smooth through the straight robot.
#
# A section of length ``L`` that bends by ``b = theta (cos phi, sin phi)`` ends at
# ``L (f2 bx, f2 by, f1)``, turned by the rotation vector ``(-by, bx, 0)``, where
# ``f1 = sin(theta)/theta``, ``f2 = (1 - cos(theta))/theta^2``, ``f3 = (theta -
# sin(theta))/theta^3``. These are functions of ``theta^2``, taken as series where the closed forms
# would cancel.

SERIES = 0.25
"""``theta^2`` below which series are used; their first term left out is below 1e-18."""


@kernel
def arc_factors(square):
    """``f1, f2, f3`` and the slopes ``d f1 / theta d theta``, ``d f2 / theta d theta``."""
    if square < SERIES:
        f1 = 0.0
        f2 = 0.0
        f3 = 0.0
        g1 = 0.0
        g2 = 0.0
        power = 1.0  # (-square)^k
        factorial = 1.0  # (2 k + 1)!
        for k in range(9):
            n = 2.0 * k
            f1 += power / factorial
            f2 += power / (factorial * (n + 2.0))
            f3 += power / (factorial * (n + 2.0) * (n + 3.0))
            following = factorial * (n + 2.0) * (n + 3.0)
            g1 -= power * (n + 2.0) / following
            g2 -= power * (n + 2.0) / (following * (n + 4.0))
            power *= -square
            factorial = following
        return f1, f2, f3, g1, g2
    theta = math.sqrt(square)
    sine = math.sin(theta)
    half = math.sin(0.5 * theta)
    f1 = sine / theta
    f2 = 2.0 * half * half / square
    f3 = (1.0 - f1) / square
    g1 = (math.cos(theta) - f1) / square
    g2 = (f1 - 2.0 * f2) / square
    return f1, f2, f3, g1, g2


@kernel
def _close_arc(length, bx, by, f1, f2):
    """Place and upper half of the rotation at the end of an arc, ``1 + f1 [w] + f2 [w]^2``."""
    return (
        length * f2 * bx,
        length * f2 * by,
        length * f1,
        1.0 - f2 * bx * bx,
        -f2 * bx * by,
        f1 * bx,
        1.0 - f2 * by * by,
        f1 * by,
        1.0 - f2 * (bx * bx + by * by),
    )


@kernel
def put_arc(before, length, bend_x, bend_y, after):
    """Fill the frame `after` an arc that starts at the frame `before`."""
    f1, f2, _, _, _ = arc_factors(bend_x * bend_x + bend_y * bend_y)
    x, y, z, r00, r01, r02, r11, r12, r22 = _close_arc(length, bend_x, bend_y, f1, f2)
    for i in range(3):
        a = before[i, 0]
        b = before[i, 1]
        c = before[i, 2]
        after[i, 3] = before[i, 3] + a * x + b * y + c * z
        after[i, 0] = a * r00 + b * r01 - c * r02
        after[i, 1] = a * r01 + b * r11 - c * r12
        after[i, 2] = a * r02 + b * r12 + c * r22
    after[3, 0] = 0.0
    after[3, 1] = 0.0
    after[3, 2] = 0.0
    after[3, 3] = 1.0


@kernel
def fill_arc(length, bx, by, frame, linear, angular):
    """Fill frame, linear and angular Jacobian of one arc, in the frame of its start.

    Parameters
    ----------
    length, bx, by : float
        Length [mm] and bend [rad].
    frame : (3, 4) float
        Filled with rotation and place of the end.
    slope : (2, 3) float
        Filled with the derivative of the place with `bx` and `by` [mm/rad].
    turn : (2, 3) float
        Filled with the rotation of the end per change of `bx` and `by`:
        ``(1 + f2 [w] + f3 [w]^2) dw``, the left Jacobian of SO(3).
    """
    f1, f2, f3, g1, g2 = arc_factors(bx * bx + by * by)
    x, y, z, r00, r01, r02, r11, r12, r22 = _close_arc(length, bx, by, f1, f2)
    frame[0, 0] = r00
    frame[0, 1] = r01
    frame[0, 2] = r02
    frame[0, 3] = x
    frame[1, 0] = r01
    frame[1, 1] = r11
    frame[1, 2] = r12
    frame[1, 3] = y
    frame[2, 0] = -r02
    frame[2, 1] = -r12
    frame[2, 2] = r22
    frame[2, 3] = z
    linear[0, 0] = length * (f2 + bx * bx * g2)
    linear[0, 1] = length * bx * by * g2
    linear[0, 2] = length * bx * g1
    linear[1, 0] = linear[0, 1]
    linear[1, 1] = length * (f2 + by * by * g2)
    linear[1, 2] = length * by * g1
    angular[0, 0] = -f3 * bx * by
    angular[0, 1] = 1.0 - f3 * by * by
    angular[0, 2] = -f2 * by
    angular[1, 0] = f3 * bx * bx - 1.0
    angular[1, 1] = f3 * bx * by
    angular[1, 2] = f2 * bx


@kernel
def fill_arc_frames(lengths, owner, fractions, bends, frames):
    """Fill ``frames`` (n, k, 4, 4) for ``bends`` (n, m, 2).

    Station ``k`` lies in section ``owner[k]``, a ``fractions[k]`` of its length from its start.
    """
    start, end = np.empty((4, 4)), np.empty((4, 4))
    set_identity(end)
    for n in range(bends.shape[0]):
        section = 0
        set_identity(start)
        for k in range(owner.size):
            while section < owner[k]:
                put_arc(start, lengths[section], bends[n, section, 0], bends[n, section, 1], end)
                copy_matrix(end, start)
                section += 1
            part = fractions[k]
            put_arc(
                start,
                part * lengths[section],
                part * bends[n, section, 0],
                part * bends[n, section, 1],
                frames[n, k],
            )


@kernel
def fill_chain(lengths, bends, frames, linear_jacobians, angular_jacobians):
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
    linear = np.empty((2, 3))
    angular = np.empty((2, 3))
    for i in range(lengths.size):
        fill_arc(lengths[i], bends[i, 0], bends[i, 1], frame, linear, angular)
        for r in range(3):
            x = frames[i, r, 0]
            y = frames[i, r, 1]
            z = frames[i, r, 2]
            for k in range(4):
                frames[i + 1, r, k] = x * frame[0, k] + y * frame[1, k] + z * frame[2, k]
            frames[i + 1, r, 3] += frames[i, r, 3]
            for k in range(2):
                linear_jacobians[i, k, r] = x * linear[k, 0] + y * linear[k, 1] + z * linear[k, 2]
                angular_jacobians[i, k, r] = (
                    x * angular[k, 0] + y * angular[k, 1] + z * angular[k, 2]
                )


@kernel
def place_point(
    lengths,
    bends,
    frames,
    linear_jacobians,
    angular_jacobians,
    section,
    fraction,
    point,
    point_jacobian,
):
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
    if fraction == 1.0:
        for r in range(3):
            point[r] = frames[section + 1, r, 3]
            point_jacobian[2 * section, r] = linear_jacobians[section, 0, r]
            point_jacobian[2 * section + 1, r] = linear_jacobians[section, 1, r]
    else:
        frame = np.empty((3, 4))
        linear = np.empty((2, 3))
        angular = np.empty((2, 3))
        # Part of an arc is the arc of that part of the length and of the bend.
        length = fraction * lengths[section]
        fill_arc(
            length,
            fraction * bends[section, 0],
            fraction * bends[section, 1],
            frame,
            linear,
            angular,
        )
        for r in range(3):
            point[r] = frames[section, r, 3]
            for k in range(3):
                point[r] += frames[section, r, k] * frame[k, 3]
            for k in range(2):
                point_jacobian[2 * section + k, r] = fraction * (
                    frames[section, r, 0] * linear[k, 0]
                    + frames[section, r, 1] * linear[k, 1]
                    + frames[section, r, 2] * linear[k, 2]
                )
    for i in range(section):
        dx = point[0] - frames[i + 1, 0, 3]
        dy = point[1] - frames[i + 1, 1, 3]
        dz = point[2] - frames[i + 1, 2, 3]
        for k in range(2):
            wx = angular_jacobians[i, k, 0]
            wy = angular_jacobians[i, k, 1]
            wz = angular_jacobians[i, k, 2]
            point_jacobian[2 * i + k, 0] = linear_jacobians[i, k, 0] + wy * dz - wz * dy
            point_jacobian[2 * i + k, 1] = linear_jacobians[i, k, 1] + wz * dx - wx * dz
            point_jacobian[2 * i + k, 2] = linear_jacobians[i, k, 2] + wx * dy - wy * dx
    point_jacobian[2 * section + 2 :] = 0.0


@kernel
def fill_tip_jacobians(lengths, bends, tips, jacobians):
    """Fill tip frames (n, 4, 4) and geometric Jacobians (n, 6, 2 m) in the base frame.

    Rows are velocity of the tip's point, then angular velocity, per unit of each bend.
    """
    sections = lengths.size
    frames = np.zeros((sections + 1, 3, 4))
    linear_jacobians = np.empty((sections, 2, 3))
    angular_jacobians = np.empty((sections, 2, 3))
    point = np.empty(3)
    point_jacobian = np.empty((2 * sections, 3))
    for r in range(3):
        frames[0, r, r] = 1.0
    for n in range(bends.shape[0]):
        fill_chain(lengths, bends[n], frames, linear_jacobians, angular_jacobians)
        place_point(
            lengths,
            bends[n],
            frames,
            linear_jacobians,
            angular_jacobians,
            sections - 1,
            1.0,
            point,
            point_jacobian,
        )
        set_identity(tips[n])
        copy_matrix(frames[sections], tips[n])
        for column in range(2 * sections):
            for r in range(3):
                jacobians[n, r, column] = point_jacobian[column, r]
                jacobians[n, 3 + r, column] = angular_jacobians[column // 2, column % 2, r]


# Numba kernels of a chain of 7-bar linkages in closed form.


@kernel(error_model="numpy")
def fill_linkage_points(owner, fractions, lengths, bends, points):
    """Fill joints ``points`` (n, k + 1, 3) for ``bends`` (n, m, 2).

    Segment ``k`` of length ``lengths[k]`` takes ``fractions[k]`` of the bend of its section
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
        own_fraction = -1.0
        mx = my = mz = 0.0
        for k in range(owner.size):
            if owner[k] != section or fractions[k] != own_fraction:
                section = owner[k]
                own_fraction = fractions[k]
                mx = 0.5 * own_fraction * bends[n, section, 0]
                my = 0.5 * own_fraction * bends[n, section, 1]
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


@kernel(error_model="numpy")
def fill_linkage_frames(owner, fractions, lengths, bends, frames):
    """Fill ``frames`` (n, k + 1, 4, 4): the joint, and the axes of its coupler link."""
    for n in range(bends.shape[0]):
        for i in range(4):
            for j in range(4):
                frames[n, 0, i, j] = 1.0 if i == j else 0.0
        for k in range(owner.size):
            mx = 0.5 * fractions[k] * bends[n, owner[k], 0]
            my = 0.5 * fractions[k] * bends[n, owner[k], 1]
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
