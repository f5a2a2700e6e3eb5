"""Bones of a scope: which poses become keys, and how each link is turned in them.

A bone sits at its link's head-side joint; its local -z runs towards the head, so that a camera
fixed to the first bone looks along the insertion (glTF cameras look down -z). Quaternions are
``(x, y, z, w)``, as in glTF.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["choose_keys", "compute_bone_rotations", "convert_to_matrices"]

Floats = NDArray[np.float64]


def choose_keys(steps: int, keys: int) -> NDArray[np.intp]:
    """Return at most `keys` step indices, evenly spread, the first and last step among them."""
    chosen = np.rint(np.linspace(0, steps - 1, min(steps, keys))).astype(np.intp)
    return np.unique(chosen)


def compute_bone_rotations(joints: Floats) -> Floats:
    """Turn every link by the smallest rotation from key to key, so that none rolls about itself.

    In the first key the frames are carried along the body from the head by smallest rotations
    (a Bishop frame); the head's +y is the world's anterior (+y) as nearly as its direction lets it.

    Parameters
    ----------
    joints : ndarray, shape (keys, joints, 3)
        Joint positions [any length]; joint 0 is the head. No link may have zero length.

    Returns
    -------
    ndarray, shape (keys, joints - 1, 4)
        Unit quaternions (x, y, z, w), sign-continuous over the keys.
    """
    back = np.diff(joints, axis=1)
    back /= np.linalg.norm(back, axis=2, keepdims=True)
    keys, bones = back.shape[:2]
    rotations = np.empty((keys, bones, 4))
    rotations[0, 0] = _orient_head(back[0, 0])
    turns = _find_smallest_rotation(back[0, :-1], back[0, 1:])
    for bone in range(1, bones):
        rotations[0, bone] = _multiply(turns[bone - 1], rotations[0, bone - 1])
    for key in range(1, keys):
        turn = _find_smallest_rotation(back[key - 1], back[key])
        rotations[key] = _multiply(turn, rotations[key - 1])
        rotations[key] /= np.linalg.norm(rotations[key], axis=1, keepdims=True)
    return rotations


def convert_to_matrices(rotations: Floats) -> Floats:
    """Return the rotation matrices of unit quaternions, shape (..., 4) to (..., 3, 3)."""
    x, y, z, w = np.moveaxis(rotations, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _orient_head(back: Floats) -> Floats:
    """Quaternion whose +z is `back` and whose +y is as near the world's +y (else +z) as can be."""
    up = np.array([0.0, 1.0, 0.0]) if abs(back[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    x = np.cross(up, back)
    x /= np.linalg.norm(x)
    y = np.cross(back, x)
    # Turn +z to `back` first, then about `back` until +x is right: two exact steps, no branches.
    swing = _find_smallest_rotation(np.array([[0.0, 0.0, 1.0]]), back[np.newaxis])[0]
    swung = convert_to_matrices(swing)[:, 0]
    half = 0.5 * np.arctan2(-(swung @ y), swung @ x)
    twist = np.append(np.sin(half) * back, np.cos(half))
    return _multiply(twist, swing)


def _find_smallest_rotation(start: Floats, end: Floats) -> Floats:
    """Smallest rotations that take unit vectors (n, 3) to others; w >= 0 always."""
    axis = np.cross(start, end)
    real = 1.0 + np.sum(start * end, axis=1)
    opposite = real < 1e-9
    if np.any(opposite):
        # Half a turn about any perpendicular: take the one across the smallest component.
        across = np.eye(3)[np.argmin(np.abs(start[opposite]), axis=1)]
        axis[opposite] = np.cross(start[opposite], across)
        real[opposite] = 0.0
    quaternion = np.concatenate([axis, real[:, np.newaxis]], axis=1)
    length: Floats = np.linalg.norm(quaternion, axis=1, keepdims=True)
    return quaternion / length


def _multiply(first: Floats, second: Floats) -> Floats:
    """Quaternion product: the rotation `second`, then the rotation `first`."""
    u, a = first[..., :3], first[..., 3:]
    v, b = second[..., :3], second[..., 3:]
    vector = a * v + b * u + np.cross(u, v)
    scalar = a * b - np.sum(u * v, axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)
