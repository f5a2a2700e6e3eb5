"""Fields built from masks and meshes: exact at the nodes, against brute force."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.duct import field_from_mask, field_from_mesh
from bozzini.duct.build import MAX_NODES
from bozzini.errors import GeometryError, InputError


def box_signed_distance(points, mask, spacing):
    """Brute force: signed distance to the faces between lumen boxes and the others."""
    padded = np.pad(mask, 2)
    lumen = (np.argwhere(padded) - 2) * spacing
    wall = (np.argwhere(~padded) - 2) * spacing
    result = np.empty(len(points))
    for k, point in enumerate(points):
        to_wall = np.maximum(np.abs(point - wall) - spacing / 2, 0.0)
        to_lumen = np.maximum(np.abs(point - lumen) - spacing / 2, 0.0)
        # The wall goes on beyond the array.
        low, high = -2.5 * spacing, (np.array(mask.shape) + 1.5) * spacing
        beyond = np.any(point <= low) or np.any(point >= high)
        depth = 0.0 if beyond else np.sqrt((to_wall**2).sum(axis=1)).min()
        result[k] = -depth if depth > 0.0 else np.sqrt((to_lumen**2).sum(axis=1)).min()
    return result


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10_000),
    spacing=st.tuples(*[st.floats(0.4, 3.0)] * 3),
    voxel=st.one_of(st.none(), st.floats(0.8, 2.0)),
)
def test_mask_nodes_hold_the_exact_distance_to_voxel_faces(seed, spacing, voxel):
    random = np.random.default_rng(seed)
    mask = random.random((5, 4, 6)) < 0.5
    mask[2, 2, 2] = True
    spacing = np.array(spacing)
    affine = np.diag([*spacing, 1.0])
    affine[:3, 3] = random.normal(size=3)
    try:
        field = field_from_mask(mask, affine, voxel=voxel)
    except GeometryError:
        assert voxel is not None  # a grid coarser than the lumen may miss it, and says so
        return
    nodes = np.array([random.integers(0, n, 40) for n in field.values.shape]).T
    points = field.to_world(nodes * field.spacing) - affine[:3, 3]
    expected = box_signed_distance(points, mask, spacing)
    assert field.values[tuple(nodes.T)] == pytest.approx(expected, abs=1e-5)


def test_mask_default_grid_is_the_voxel_centres():
    mask = np.zeros((6, 6, 6), dtype=bool)
    mask[2:4, 2:4, 2:4] = True
    affine = np.diag([1.0, 1.5, 2.0, 1.0])
    affine[:3, 3] = [10.0, -4.0, 7.0]
    field = field_from_mask(mask, affine)
    centres = np.argwhere(mask) @ affine[:3, :3].T + affine[:3, 3]
    index = field.to_grid(centres) / field.spacing
    assert index == pytest.approx(np.rint(index), abs=1e-9)
    assert field.signed_distance(centres) == pytest.approx(-0.5)


def test_mask_field_is_carried_by_a_rotated_and_by_a_reflected_frame():
    random = np.random.default_rng(3)
    mask = random.random((6, 5, 7)) < 0.6
    scale = np.diag([1.0, 0.8, 1.3])
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    for frame in (turn, turn @ np.diag([1.0, -1.0, 1.0])):
        affine = np.eye(4)
        affine[:3, :3] = frame @ scale
        affine[:3, 3] = [5.0, 6.0, -7.0]
        plain = field_from_mask(mask, np.diag([1.0, 0.8, 1.3, 1.0]))
        turned = field_from_mask(mask, affine)
        points = random.uniform(-3, 9, (200, 3))
        moved = points @ frame.T + affine[:3, 3]
        assert turned.signed_distance(moved) == pytest.approx(
            plain.signed_distance(points), abs=1e-5
        )
        gradient = turned.gradient(moved)
        assert gradient == pytest.approx(plain.gradient(points) @ frame.T, abs=1e-4)


def icosphere(radius=8.0, centre=(1.0, 2.0, 3.0)):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    mesh.apply_translation(centre)
    return mesh


def test_mesh_nodes_hold_the_exact_distance_to_triangles():
    mesh = icosphere()
    field = field_from_mesh(mesh.vertices, mesh.faces, voxel=1.0, inflate=2.0)
    random = np.random.default_rng(0)
    nodes = np.array([random.integers(0, n, 2000) for n in field.values.shape]).T
    exact = -trimesh.proximity.signed_distance(mesh, field.to_world(nodes * field.spacing))
    values = field.values[tuple(nodes.T)]
    near = exact <= field.reach
    assert near.sum() > 300
    assert values[near] == pytest.approx(exact[near], abs=1e-5)
    assert np.all(values[~near] >= exact[~near] - 1e-5)


def test_mesh_inside_is_right_for_a_shell_with_a_pouch():
    outer = trimesh.creation.box(extents=(10, 10, 10))
    inner = trimesh.creation.box(extents=(4, 4, 4))
    inner.invert()
    shell = trimesh.util.concatenate([outer, inner])
    field = field_from_mesh(shell.vertices, shell.faces, voxel=0.5)
    assert field.signed_distance([0.0, 0.0, 0.0]) == pytest.approx(2.0, abs=0.5)
    assert field.signed_distance([3.5, 0.0, 0.0]) == pytest.approx(-1.5, abs=1e-4)


def test_large_triangles_leave_no_gap_in_the_wall():
    mesh = trimesh.creation.box(extents=(40, 3, 3))
    field = field_from_mesh(mesh.vertices, mesh.faces, voxel=0.5)
    random = np.random.default_rng(1)
    points = random.uniform([-24, -6, -6], [24, 6, 6], (3000, 3))
    exact = -trimesh.proximity.signed_distance(mesh, points)
    sure = np.abs(exact) > field.error
    assert np.all((field.signed_distance(points)[sure] > 0) == (exact[sure] > 0))


@pytest.mark.parametrize("inflate", [0.0, 2.5])
def test_interpolation_error_is_within_its_statement(inflate):
    mesh = icosphere()
    field = field_from_mesh(mesh.vertices, mesh.faces, voxel=1.0, inflate=inflate)
    random = np.random.default_rng(2)
    points = random.uniform(*field.bounds, (4000, 3))
    exact = -trimesh.proximity.signed_distance(mesh, points) - inflate
    near = exact + inflate < field.reach - 2.0
    assert np.abs(field.signed_distance(points) - exact)[near].max() <= field.error
    assert np.all((field.signed_distance(points) - exact) >= -field.error)


def test_inflated_lumen_promises_no_more_room_than_the_moved_wall_leaves():
    random = np.random.default_rng(4)
    mask = random.random((7, 7, 7)) < 0.35
    mask[3, 3, 3] = True
    inflation = 1.5
    field = field_from_mask(mask, np.eye(4), inflate=inflation)
    lumen = np.argwhere(mask)
    points = random.uniform(-2, 8, (300, 3))
    # The moved wall: every point farther than the inflation from the lumen boxes.
    samples = random.uniform(-6, 12, (60_000, 3))
    gap = np.full(len(samples), np.inf)
    for box in lumen:
        gap = np.minimum(gap, np.linalg.norm(np.maximum(np.abs(samples - box) - 0.5, 0), axis=1))
    wall = samples[gap >= inflation]
    for point in points:
        room = -field.signed_distance(point)
        assert room <= np.linalg.norm(wall - point, axis=1).min() + field.error


def test_bad_values_are_refused_with_the_range():
    mask = np.ones((4, 4, 4), dtype=bool)
    with pytest.raises(GeometryError, match="empty"):
        field_from_mask(np.zeros((3, 3, 3)), np.eye(4))
    with pytest.raises(GeometryError, match=f"limit is {MAX_NODES:,}, give at least"):
        field_from_mask(mask, np.eye(4), voxel=0.01)
    mesh = icosphere()
    with pytest.raises(GeometryError, match="smaller --voxel"):
        field_from_mask(mask[:1, :1, :1], np.diag([0.1, 0.1, 0.1, 1.0]), voxel=5.0)
    with pytest.raises(InputError, match="inflation is -1 mm"):
        field_from_mesh(mesh.vertices, mesh.faces, voxel=1.0).inflate(-1.0)
