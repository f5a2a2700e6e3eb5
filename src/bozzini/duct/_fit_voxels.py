"""The wall of a label volume as a mesh: the faces between lumen voxels and the others."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import GeometryError
from .mesh import TriangleMesh

__all__ = ["mesh_from_mask"]


def mesh_from_mask(mask: ArrayLike, affine: ArrayLike, *, inflation: float = 0.0) -> TriangleMesh:
    """Return the mesh of the faces of voxels, whose distance is exact.

    Parameters
    ----------
    mask : (nx, ny, nz) bool
        The lumen.
    affine : (4, 4) float
        Voxel index (the centre of the voxel) to world [mm].
    inflation : float
        The wall is moved outwards by this much [mm].

    Raises
    ------
    GeometryError
        If the lumen is empty.
    """
    lumen = np.pad(np.asarray(mask, dtype=bool), 1)
    matrix = np.asarray(affine, dtype=np.float64)
    if not lumen.any():
        raise GeometryError("the lumen is empty: no voxel is set")
    shape = np.array(lumen.shape) + 1
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        change = np.diff(lumen.astype(np.int8), axis=axis)
        for sign in (1, -1):
            corner = np.argwhere(change == sign)
            corner[:, axis] += 1
            # Corners of the face in order, out of the lumen by the right hand.
            steps = [(0, 0), (1, 0), (1, 1), (0, 1)][::-sign]
            around = []
            for a, b in steps:
                place = corner.copy()
                place[:, u] += a
                place[:, v] += b
                around.append(np.ravel_multi_index(tuple(place.T), tuple(shape)))
            quads.append(np.stack(around, axis=1))
    corners = np.concatenate(quads)
    faces = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    names, numbers = np.unique(faces, return_inverse=True)
    # The pad moved indices by one, a voxel's first corner lies half a voxel before its centre.
    index = np.stack(np.unravel_index(names, tuple(shape)), axis=1) - 1.5
    vertices: NDArray[np.float64] = index @ matrix[:3, :3].T + matrix[:3, 3]
    spacing = np.linalg.norm(matrix[:3, :3], axis=0)
    return TriangleMesh(
        vertices,
        numbers.reshape(-1, 3),
        inflation=inflation,
        wall="faces between lumen voxels and the others",
        wall_error=0.5 * float(np.linalg.norm(spacing)),
    )
