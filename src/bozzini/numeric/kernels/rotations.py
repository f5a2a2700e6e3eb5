"""Numba kernels of rotations as unit quaternions, scalar first."""

from __future__ import annotations

import math

from ..compiling import kernel


@kernel
def fill_quaternion_rotation(w, x, y, z, rotation):
    """Fill the rotation matrix (3, 3) of a unit quaternion."""
    rotation[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    rotation[0, 1] = 2.0 * (x * y - w * z)
    rotation[0, 2] = 2.0 * (x * z + w * y)
    rotation[1, 0] = 2.0 * (x * y + w * z)
    rotation[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    rotation[1, 2] = 2.0 * (y * z - w * x)
    rotation[2, 0] = 2.0 * (x * z - w * y)
    rotation[2, 1] = 2.0 * (y * z + w * x)
    rotation[2, 2] = 1.0 - 2.0 * (x * x + y * y)


@kernel
def turn_quaternion(quaternion, turn, out):
    """Fill ``out`` (4,) with the quaternion turned by a rotation vector in its own frame."""
    angle = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    share = 0.5 if angle < 1e-12 else math.sin(0.5 * angle) / angle
    a, b, c, d = math.cos(0.5 * angle), share * turn[0], share * turn[1], share * turn[2]
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    out[0] = w * a - x * b - y * c - z * d
    out[1] = w * b + x * a + y * d - z * c
    out[2] = w * c + y * a + z * b - x * d
    out[3] = w * d + z * a + x * c - y * b


@kernel
def find_turn(one, other, out):
    """Fill ``out`` (3,) with the rotation vector from the frame ``one`` to ``other``, in one's."""
    w, x, y, z = one[0], -one[1], -one[2], -one[3]
    a, b, c, d = other[0], other[1], other[2], other[3]
    scalar = w * a - x * b - y * c - z * d
    out[0] = w * b + x * a + y * d - z * c
    out[1] = w * c + y * a + z * b - x * d
    out[2] = w * d + z * a + x * c - y * b
    size = math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    share = 2.0 / scalar if size < 1e-12 else 2.0 * math.atan2(size, scalar) / size
    if scalar < 0.0 and size >= 1e-12:
        share = -2.0 * math.atan2(size, -scalar) / size
    for i in range(3):
        out[i] *= share
