"""The surface on which values on a grid have a level, by marching cubes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
"""Of a cell, in the order of libigl."""


def find_level_set(
    values: NDArray[np.floating], level: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices (n, 3), in steps of the grid, and triangles (m, 3) of a level set.

    The triangles turn towards larger values, and none is flat. If the level is not between the
    values both are empty.

    Parameters
    ----------
    values : (i, j, k) ndarray
        Values at the nodes, two or more in every direction.
    level : float
        Of the surface.
    """
    import igl

    below = values <= level  # as libigl has it
    i, j, k = np.array(below.shape) - 1
    some = np.zeros((i, j, k), dtype=bool)
    every = np.ones((i, j, k), dtype=bool)
    for a, b, c in _CORNERS:
        corner = below[a : i + a, b : j + b, c : k + c]
        some |= corner
        every &= corner
    some &= ~every
    cells = np.ravel_multi_index(np.nonzero(some), below.shape)
    del some, every
    places = cells[:, None] + np.ravel_multi_index(np.array(_CORNERS).T, below.shape)
    marked = np.zeros(below.size, dtype=bool)
    marked[places] = True
    flat = np.flatnonzero(marked)
    index = np.searchsorted(flat, places)
    nodes = np.column_stack(np.unravel_index(flat, below.shape)).astype(np.float64)
    heights = np.asarray(values).reshape(-1)[flat].astype(np.float64)
    vertices, faces, _ = igl.marching_cubes(heights, nodes, index, level)
    if (heights == level).any():  # vertices that meet in a node make flat triangles
        vertices, index = np.unique(vertices, axis=0, return_inverse=True)
        faces = index.reshape(-1)[faces]
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
        used, index = np.unique(faces, return_inverse=True)
        vertices, faces = vertices[used], index.reshape(-1, 3)
    return np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
