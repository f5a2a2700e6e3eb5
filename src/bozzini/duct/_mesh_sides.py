"""Which side of a mesh's triangles is inside: parts that are turned inside out are found."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import GeometryError

__all__ = ["check_sides", "find_parts"]

ASIDE = 1e-6
"""How far off a triangle it is looked on which side is inside, as a fraction of the mesh's size."""


def check_sides(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    count_windings: Callable[[NDArray[np.float64]], NDArray[Any]],
    *,
    everywhere: bool,
) -> None:
    """Raise `GeometryError` where a closed mesh winds the wrong way about places beside it.

    Such places are outside, and the triangles around them no wall: moved outwards, these would
    make a lumen of nothing.

    Parameters
    ----------
    vertices : (n, 3) float
        [mm].
    faces : (m, 3) int
    count_windings : callable
        Takes points (k, 3), returns how often the mesh winds about them (k,).
    everywhere : bool
        Whether all triangles are looked at, by their middles; else those of connected parts with
        a negative volume, which are legal only as holes in others.
    """
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    part = find_parts(len(vertices), faces)
    around = corners[:, 0] - corners.mean(axis=(0, 1))
    volumes = np.bincount(part, weights=np.einsum("ij,ij->i", around, normals))
    sizes = np.linalg.norm(normals, axis=1)
    asked = np.flatnonzero((sizes > 0.0) & (everywhere | (volumes[part] < 0.0)))
    if len(asked) == 0:
        return
    aside = ASIDE * float(np.ptp(vertices, axis=0).max())
    middles = corners[asked].mean(axis=1)
    wrong = count_windings(middles + aside / sizes[asked, None] * normals[asked]) < -0.5
    if wrong.any():
        k = int(np.argmax(wrong))
        where = ", ".join(f"{x:.1f}" for x in middles[k])
        size = int(np.sum(part == part[asked[k]]))
        raise GeometryError(
            f"the mesh is turned inside out near ({where}) mm: {int(wrong.sum())} triangles, of a "
            f"part of {size}, have the inside in front of them"
        )


def find_parts(count: int, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the connected part (m,) of each triangle."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    start, stop = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    ones = np.ones(len(start), dtype=np.int8)
    graph = coo_matrix((ones, (start, stop)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1][faces[:, 0]], dtype=np.int64)
