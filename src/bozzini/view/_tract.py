"""The tract's wall made ready for viewing: checked, decimated, turned outwards, with normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_points
from ..errors import InputError

__all__ = ["TractMesh", "prepare_tract"]

Floats = NDArray[np.float64]
Faces = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class TractMesh:
    """A triangle mesh whose faces turn outwards.

    Attributes
    ----------
    vertices, normals : ndarray, shape (n, 3)
    faces : ndarray, shape (m, 3)
    mean_width : float
        Four volumes by one area: the diameter, for a long round tube.
    """

    vertices: Floats
    normals: Floats
    faces: Faces
    mean_width: float

    def scaled(self, factor: float) -> TractMesh:
        """Return the mesh in another unit of length."""
        return TractMesh(
            vertices=self.vertices * factor,
            normals=self.normals,
            faces=self.faces,
            mean_width=self.mean_width * factor,
        )


def prepare_tract(surface: tuple[ArrayLike, ArrayLike], *, max_faces: int) -> TractMesh:
    """Check a surface and make it ready for viewing.

    Raises
    ------
    InputError
        If it has no faces, wrong shapes, vertices that are not finite, or indices out of range.
    """
    vertices, faces = _check_surface(surface)
    if len(vertices) == 3 * len(faces):  # a loose set of triangles: weld equal corners
        vertices, index = np.unique(vertices, axis=0, return_inverse=True)
        faces = index.reshape(-1)[faces]
    if len(faces) > max_faces:
        vertices, faces = _decimate(vertices, faces, max_faces)
    vertices, faces, crosses = _drop_flat(vertices, faces)
    centred = vertices - vertices.mean(axis=0)
    volume = float(np.sum(centred[faces[:, 0]] * crosses)) / 6.0
    area = 0.5 * float(np.linalg.norm(crosses, axis=1).sum())
    if volume < 0.0:
        faces, crosses = faces[:, ::-1], -crosses
    return TractMesh(
        vertices=vertices,
        normals=_find_normals(len(vertices), faces, crosses),
        faces=faces,
        mean_width=4.0 * abs(volume) / area,
    )


def _check_surface(surface: tuple[ArrayLike, ArrayLike]) -> tuple[Floats, Faces]:
    if not isinstance(surface, (tuple, list)) or len(surface) != 2:
        raise InputError("surface must be a pair: vertices (n, 3) and faces (m, 3)")
    vertices = check_points("surface vertices", surface[0])
    if vertices.ndim != 2:
        raise InputError(f"surface vertices has shape {vertices.shape}: it must be (n, 3)")
    faces = np.asarray(surface[1])
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise InputError(
            f"surface faces has shape {faces.shape} and type {faces.dtype}: it must be (m, 3) "
            "whole numbers"
        )
    if len(faces) == 0 or len(vertices) == 0:
        raise InputError(
            f"surface has {len(vertices)} vertices and {len(faces)} faces: it must have at least 1 "
            "face"
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(
            f"surface faces has indices {faces.min()} to {faces.max()}: they must lie in "
            f"[0, {len(vertices) - 1}]"
        )
    return vertices, faces.astype(np.int64)


def _decimate(vertices: Floats, faces: Faces, max_faces: int) -> tuple[Floats, Faces]:
    """Quadric edge collapse (Garland and Heckbert, SIGGRAPH 1997), by fast_simplification."""
    from fast_simplification import simplify

    centre = vertices.mean(axis=0)  # the library may work in single precision
    result = simplify(vertices - centre, faces.astype(np.int32), target_count=max_faces)
    coarse = np.asarray(result[0], dtype=np.float64)
    return coarse + centre, np.asarray(result[1], dtype=np.int64)


def _drop_flat(vertices: Floats, faces: Faces) -> tuple[Floats, Faces, Floats]:
    """Drop faces without area and vertices without faces; return the faces' cross products too."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    crosses = np.cross(b - a, c - a)
    keep = np.linalg.norm(crosses, axis=1) > 0.0
    if not np.any(keep):
        raise InputError(f"surface has {len(faces)} faces, all of zero area: it must have area")
    faces, crosses = faces[keep], crosses[keep]
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    number = np.cumsum(used) - 1
    return vertices[used], number[faces], crosses


def _find_normals(count: int, faces: Faces, crosses: Floats) -> Floats:
    """Vertex normals weighted by area; where faces cancel out, that of one of them."""
    normals = np.empty((count, 3))
    corners = faces.ravel()
    for axis in range(3):
        normals[:, axis] = np.bincount(corners, np.repeat(crosses[:, axis], 3), minlength=count)
    length = np.linalg.norm(normals, axis=1)
    largest = np.zeros(count)
    np.maximum.at(largest, corners, np.repeat(np.linalg.norm(crosses, axis=1), 3))
    cancelled = length <= 1e-6 * largest
    if np.any(cancelled):
        one = np.zeros((count, 3))
        one[corners] = np.repeat(crosses, 3, axis=0)
        normals[cancelled] = one[cancelled]
        length = np.linalg.norm(normals, axis=1)
    normals /= length[:, np.newaxis]
    return normals
