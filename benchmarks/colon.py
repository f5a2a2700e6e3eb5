"""A colon made by formula: a winding tube of 1.2 m with folds, as triangles or as labels."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

KNOTS = np.array(
    [
        (0, 0, 0),
        (8, 25, 45),
        (-45, 35, 85),
        (-95, 0, 60),
        (-115, -10, 120),
        (-120, 0, 220),
        (-110, -5, 300),
        (-40, -50, 255),
        (40, -55, 250),
        (105, -10, 290),
        (120, 0, 210),
        (118, 0, 120),
        (105, 5, 70),
    ],
    dtype=float,
)
"""From the anus to the caecum [mm]; x to the left, y to the back, z to the head."""


def make_curve(length: float = 1200.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the mid-line (n, 3) and the radius (n,), 8 to 25 mm with a fold every 28 mm."""
    spline = CubicSpline(np.linspace(0.0, 1.0, len(KNOTS)), KNOTS)
    fine = spline(np.linspace(0.0, 1.0, 4000))
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    fine, arc = fine * length / arc[-1], arc * length / arc[-1]
    s = np.arange(0.0, length, 1.0)
    curve = np.stack([np.interp(s, arc, column) for column in fine.T], axis=1)
    share = s / length
    wide = 12.0 + 12.0 * share**1.5 + 1.5 * np.sin(2.0 * np.pi * s / 170.0)
    folds = 0.22 * wide * np.exp(-((((s % 28.0) - 14.0) / 4.0) ** 2))
    return curve, np.clip(wide - folds, 8.0, 25.0)


def sample_colon(voxel: float, length: float = 1200.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance to the union of balls on a grid (negative inside), and its origin."""
    curve, radius = make_curve(length)
    low = curve.min(axis=0) - 32.0
    counts = np.ceil((curve.max(axis=0) + 32.0 - low) / voxel).astype(int)
    nodes = low + voxel * np.indices(counts).reshape(3, -1).T
    near = cKDTree(curve).query(nodes, distance_upper_bound=30.0)[0] < 30.0
    found, index = cKDTree(curve).query(nodes[near], k=50)
    values = np.full(len(nodes), 10.0)
    values[near] = (found - radius[index]).min(axis=1)
    return values.reshape(counts), low


def make_surface(voxel: float = 4.3) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices [mm] and outward faces: about 20,000."""
    from skimage.measure import marching_cubes

    values, low = sample_colon(voxel)
    vertices, faces, _, _ = marching_cubes(values, level=0.0, spacing=(voxel,) * 3)
    corners = vertices[faces].astype(float)
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    outward = faces if volume > 0.0 else faces[:, ::-1]
    return vertices.astype(float) + low, np.ascontiguousarray(outward, dtype=np.int64)


def make_labels(voxel: float = 1.0, length: float = 1500.0) -> tuple[np.ndarray, np.ndarray]:
    """Return labels (nx, ny, nz) of 1 in the lumen, and their affine."""
    values, low = sample_colon(voxel, length)
    affine = np.diag([voxel, voxel, voxel, 1.0])
    affine[:3, 3] = low
    return (values < 0.0).astype(np.uint16), affine
