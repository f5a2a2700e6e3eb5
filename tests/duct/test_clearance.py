"""The clearance bound: never above the exact distance, and near to it where it matters."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.duct import field_from_mask, field_from_mesh
from tests.exact import MeshWall, VoxelWall, voxelise
from tests.shapes import bend_curve

ROUNDING = 1e-9


def random_frame(random, spacing, *, reflect=False):
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    if reflect != (np.linalg.det(turn) < 0.0):
        turn[:, 0] *= -1.0
    affine = np.eye(4)
    affine[:3, :3] = turn * spacing
    affine[:3, 3] = random.normal(size=3) * 20.0
    return affine


def blob(random, shape=(14, 12, 13)):
    """A ragged lumen: thresholded smooth noise, with wide places and thin ones."""
    from scipy.ndimage import gaussian_filter

    noise = gaussian_filter(random.normal(size=shape), 1.6)
    mask = noise > np.quantile(noise, 0.45)
    mask[shape[0] // 2, shape[1] // 2, shape[2] // 2] = True
    return mask


def points_around(random, field, count):
    """Points in the field's box and beyond it, and some on nodes and in the middle of edges."""
    size = (np.array(field.values.shape) - 1) * field.spacing
    grid = random.uniform(-0.2 * size, 1.2 * size, (count, 3))
    nodes = random.integers(0, field.values.shape, (count // 5, 3)) * field.spacing
    edges = nodes + 0.5 * field.spacing * random.integers(0, 2, nodes.shape)
    return field.to_world(np.concatenate([grid, nodes, edges]))


@settings(max_examples=12)
@given(
    seed=st.integers(0, 10_000),
    spacing=st.tuples(*[st.floats(0.3, 2.5)] * 3),
    reflect=st.booleans(),
    voxel=st.sampled_from([None, None, 1.3]),
)
def test_bound_never_exceeds_the_distance_to_voxel_faces(seed, spacing, reflect, voxel):
    random = np.random.default_rng(seed)
    mask = blob(random)
    affine = random_frame(random, np.array(spacing), reflect=reflect)
    field = field_from_mask(mask, affine, voxel=voxel)
    points = points_around(random, field, 4000)
    exact = VoxelWall(mask, affine).clearance(points)
    assert np.all(field.clearance_bound(points) <= np.maximum(exact, -field.reach) + ROUNDING)


@pytest.mark.parametrize("inflate", [0.0, 1.5])
def test_bound_never_exceeds_the_distance_to_triangles(inflate):
    random = np.random.default_rng(1)
    mesh = trimesh.creation.capsule(height=18.0, radius=6.0)
    mesh.apply_transform(trimesh.transformations.random_rotation_matrix(random.random(3)))
    mesh.vertices += 0.3 * random.normal(size=mesh.vertices.shape) * (mesh.vertices[:, :1] > 0)
    field = field_from_mesh(mesh.vertices, mesh.faces, voxel=0.9, inflate=inflate)
    points = points_around(random, field, 40_000)
    exact = MeshWall(mesh.vertices, mesh.faces).clearance(points)
    # The moved wall is at least `inflate` beyond the wall, seen from inside, and at `inflate`
    # minus the distance, seen from outside.
    known = np.maximum(exact, -field.reach)  # farther outside it only says "beyond its reach"
    assert np.all(field.clearance_bound(points) <= known + inflate + ROUNDING)


def test_bound_is_exact_at_nodes():
    random = np.random.default_rng(2)
    mask = blob(random)
    affine = random_frame(random, np.array([1.0, 1.5, 0.7]))
    field = field_from_mask(mask, affine)
    nodes = np.argwhere(field.values < 0.0) * field.spacing
    points = field.to_world(nodes)
    exact = VoxelWall(mask, affine).clearance(points)
    assert field.clearance_bound(points) == pytest.approx(exact, abs=1e-5)


def test_bound_is_near_to_the_distance_a_few_millimetres_from_the_wall():
    mask, affine = voxelise(bend_curve(25.0, 1.8, 20.0), 7.0)
    field = field_from_mask(mask, affine)
    random = np.random.default_rng(3)
    points = points_around(random, field, 100_000)
    exact = VoxelWall(mask, affine).clearance(points)
    asked = (exact > 2.0) & (exact < 5.0)
    gap = exact[asked] - field.clearance_bound(points[asked])
    assert asked.sum() > 2000
    assert gap.mean() < 0.25
    # Both routes of the bound are there: slope alone would leave half a cell's diagonal.
    assert np.quantile(gap, 0.99) < 0.87


def test_inflation_adds_to_the_bound_everywhere():
    mask = blob(np.random.default_rng(4))
    field = field_from_mask(mask, np.eye(4))
    points = points_around(np.random.default_rng(5), field, 2000)
    raised = field.inflate(2.5).clearance_bound(points)
    assert raised == pytest.approx(field.clearance_bound(points) + 2.5, abs=1e-9)


def test_bound_falls_with_the_distance_outside_the_grid():
    field = field_from_mask(blob(np.random.default_rng(6)), np.eye(4))
    corner = field.to_world(np.zeros(3))
    here = float(field.clearance_bound(corner))
    for far in (1.0, 30.0):
        there = float(field.clearance_bound(corner - np.array([far, 0.0, 0.0])))
        assert there == pytest.approx(here - far, abs=1e-9)
