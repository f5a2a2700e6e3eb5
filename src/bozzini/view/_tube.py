"""The scope's skin: one tube over all links, rounded at the head, closed at the tail."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Tube", "build_tube"]

Floats = NDArray[np.float64]

_SIDES = 16
_CAP_RINGS = 4
_INSET = 0.2


@dataclass(frozen=True, kw_only=True)
class Tube:
    """A skinned mesh, in the pose in which it is bound.

    Attributes
    ----------
    vertices, normals : ndarray, shape (n, 3)
        In the unit of the joints; normals of unit length.
    faces : ndarray, shape (m, 3)
        Counter-clockwise seen from outside.
    bones : ndarray, shape (n, 4)
        Bone indices; 0 where the weight is 0.
    weights : ndarray, shape (n, 4)
        Each row sums to 1. One bone of weight 1 on a link, two of 1/2 where two links meet.
    """

    vertices: Floats
    normals: Floats
    faces: NDArray[np.int64]
    bones: NDArray[np.int64]
    weights: Floats


def build_tube(joints: Floats, frames: Floats, *, radius: float) -> Tube:
    """Build the skin around a chain of links.

    Each link carries two rigid rings, set in from its joints; where two links meet, one more ring
    follows both half and half. The head ends in a half-sphere about joint 0, so that the skin is
    the body that clearances are computed for; the tail ends in a flat disc.

    Parameters
    ----------
    joints : ndarray, shape (joints, 3)
        Joint positions in the pose to bind in; joint 0 is the head.
    frames : ndarray, shape (joints - 1, 3, 3)
        Rotation of each bone; its third column points from the head to the tail.
    radius : float
        Radius of the scope, in the unit of the joints.
    """
    bones = len(frames)
    lengths = np.linalg.norm(np.diff(joints, axis=0), axis=1)
    angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(_SIDES)], axis=1)

    # Rings from head to tail: first and second bone, place along each, radius, normal's slope.
    rows: list[tuple[int, int, float, float, float, float]] = []
    for ring in range(_CAP_RINGS):
        height = 0.5 * np.pi * (ring + 1) / _CAP_RINGS
        sine, cosine = float(np.sin(height)), float(np.cos(height))
        rows.append((0, 0, -radius * cosine, -radius * cosine, radius * sine, -cosine))
    for bone, length in enumerate(lengths.tolist()):
        if bone:
            rows.append((bone - 1, bone, float(lengths[bone - 1]), 0.0, radius, 0.0))
        rows.append((bone, bone, _INSET * length, _INSET * length, radius, 0.0))
        rows.append((bone, bone, (1 - _INSET) * length, (1 - _INSET) * length, radius, 0.0))
    end = float(lengths[-1])
    rows.append((bones - 1, bones - 1, end, end, radius, 0.0))
    table = np.array(rows)
    pairs = table[:, :2].astype(np.int64)

    points, normals = [], []
    for side in range(2):
        owner, along = pairs[:, side], table[:, 2 + side]
        local = table[:, 4, None, None] * circle + along[:, None, None] * [0.0, 0.0, 1.0]
        slope = table[:, 5]
        local_normals = np.sqrt(1 - slope**2)[:, None, None] * circle
        local_normals = local_normals + slope[:, None, None] * [0.0, 0.0, 1.0]
        turned = np.einsum("rij,rsj->rsi", frames[owner], local)
        points.append(turned + joints[owner][:, None])
        normals.append(np.einsum("rij,rsj->rsi", frames[owner], local_normals))
    rings = 0.5 * (points[0] + points[1])
    ring_normals = normals[0] + normals[1]
    folded = np.linalg.norm(ring_normals, axis=2) < 1e-6  # a link folded back on its neighbour
    ring_normals[folded] = normals[0][folded]

    # The apex, the rings, and the tail's disc with its own normals.
    back, last = frames[0, :, 2], frames[-1, :, 2]
    vertices = np.concatenate(
        [[joints[0] - radius * back], rings.reshape(-1, 3), rings[-1], [joints[-1]]]
    )
    tail = np.tile(last, (_SIDES + 1, 1))
    all_normals = np.concatenate([[-back], ring_normals.reshape(-1, 3), tail])
    all_normals /= np.linalg.norm(all_normals, axis=1, keepdims=True)
    first = np.concatenate([[0], np.repeat(pairs[:, 0], _SIDES), np.full(_SIDES + 1, bones - 1)])
    second = np.concatenate([[0], np.repeat(pairs[:, 1], _SIDES), np.full(_SIDES + 1, bones - 1)])
    shared = first != second
    indices = np.zeros((len(vertices), 4), dtype=np.int64)
    weights = np.zeros((len(vertices), 4))
    indices[:, 0], indices[shared, 1] = first, second[shared]
    weights[:, 0], weights[shared, 1] = np.where(shared, 0.5, 1.0), 0.5
    return Tube(
        vertices=vertices,
        normals=all_normals,
        faces=_connect(len(rows)),
        bones=indices,
        weights=weights,
    )


def _connect(rings: int) -> NDArray[np.int64]:
    """Faces of apex, rings and tail disc; rings run from the head (-z) to the tail (+z)."""
    here = np.arange(_SIDES)
    after = (here + 1) % _SIDES
    apex = np.stack([np.zeros_like(here), 1 + after, 1 + here], axis=1)
    start = 1 + _SIDES * np.arange(rings - 1)[:, None]
    a, b = start + here, start + after
    c, d = a + _SIDES, b + _SIDES
    sides = np.concatenate(
        [np.stack([a, b, d], axis=-1).reshape(-1, 3), np.stack([a, d, c], axis=-1).reshape(-1, 3)]
    )
    disc = 1 + _SIDES * rings
    centre = np.full(_SIDES, disc + _SIDES)
    tail = np.stack([centre, disc + here, disc + after], axis=1)
    faces: NDArray[np.int64] = np.concatenate([apex, sides, tail]).astype(np.int64)
    return faces
