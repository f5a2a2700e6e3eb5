"""The rotated frame nearest to an affine whose voxel axes are not quite at right angles."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

__all__ = ["fit_frame", "measure_shift"]

Matrix = NDArray[np.float64]


def fit_frame(affine: Matrix) -> tuple[Matrix, NDArray[np.float64]]:
    """Return the orthonormal matrix nearest to the voxel axes, and the voxel sizes [mm]."""
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    left, _, right = np.linalg.svd(affine[:3, :3] / spacing)
    return left @ right, spacing


def measure_shift(affine: Matrix, shape: tuple[int, ...]) -> float:
    """Return how far the frame moves any place of a box of voxels, its centre held fixed [mm].

    The move is linear in the place, so it is largest at a corner of the box.
    """
    rotation, spacing = fit_frame(affine)
    change = affine[:3, :3] - rotation * spacing
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * np.array(shape)
    return float(np.linalg.norm(corners @ change.T, axis=1).max())
