"""Level sets on a grid, against scikit-image's marching cubes."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

from bozzini.numeric.level_sets import find_level_set

NODES = np.stack(np.meshgrid(*(np.arange(n) for n in (20, 24, 28)), indexing="ij"), axis=-1)
BALL = np.linalg.norm((NODES - 10.0) / (6.13, 7.27, 8.31), axis=-1) - 1.0
NOISE = np.pad(np.random.default_rng(0).normal(size=(9, 8, 7)), 1, constant_values=1.0)


def test_the_vertices_are_those_of_another_route() -> None:
    vertices, faces = find_level_set(BALL)
    wanted, triangles, _, _ = marching_cubes(BALL, 0.0)
    away, which = cKDTree(vertices).query(wanted)
    assert away.max() < 1e-5 and len(set(which.tolist())) == len(vertices) == len(wanted)
    assert len(faces) == len(triangles)
    ours = trimesh.Trimesh(vertices, faces, process=False)
    theirs = trimesh.Trimesh(wanted, triangles, process=False)
    # What a cell cuts out is a polygon that need not be flat: its diagonals may differ.
    assert ours.volume == pytest.approx(theirs.volume, rel=1e-3)


@pytest.mark.parametrize("values", [BALL, NOISE], ids=["ball", "noise"])
def test_the_surface_is_closed_and_turns_towards_larger_values(values: NDArray[np.float64]) -> None:
    mesh = trimesh.Trimesh(*find_level_set(values), process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0.0
    assert trimesh.Trimesh(*find_level_set(-values), process=False).volume < 0.0


@pytest.mark.parametrize("level", [-0.3, 0.0, 0.1])
def test_nodes_of_the_level_leave_neither_flat_triangles_nor_holes(level: float) -> None:
    values = np.round(BALL, 1)
    assert (values == level).any()
    mesh = trimesh.Trimesh(*find_level_set(values, level), process=False)
    assert mesh.area_faces.min() > 0.0
    _, counts = np.unique(np.sort(mesh.edges, axis=1), axis=0, return_counts=True)
    assert (counts % 2 == 0).all()
    wanted, triangles, _, _ = marching_cubes(values, level, allow_degenerate=False)
    other = trimesh.Trimesh(wanted, triangles, process=False)
    assert mesh.volume == pytest.approx(other.volume, rel=2e-3)


def test_a_level_outside_the_values_gives_nothing() -> None:
    for level in (-2.0, 9.0):
        vertices, faces = find_level_set(BALL, level)
        assert vertices.shape == faces.shape == (0, 3)
