"""Fields built from masks and meshes: exact at the nodes, against brute force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from bozzini.anatomy import LabelTract
from bozzini.duct import build_field, field_from_mask, field_from_mesh
from bozzini.duct import field as walls
from bozzini.duct.field import MAX_NODES, divide_voxels
from bozzini.errors import GeometryError, InputError
from tests.exact import MeshWall


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
        # A point on a face between two wall boxes is off by rounding.
        result[k] = -depth if depth > 1e-9 else np.sqrt((to_lumen**2).sum(axis=1)).min()
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
    found = field.values[tuple(nodes.T)].astype(float)
    expected = np.minimum(expected, field.reach)
    assert np.all(np.abs(found) <= np.abs(expected) + 1e-12)
    assert found == pytest.approx(expected, rel=1.3e-7, abs=1.1e-6)


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
    assert field.reach == 8.0 and np.any(~near)
    assert np.all(values[~near] == 8.0)


def test_mesh_inside_is_right_for_a_shell_with_a_pouch():
    outer = trimesh.creation.box(extents=(10, 10, 10))
    inner = trimesh.creation.box(extents=(4, 4, 4))
    inner.invert()
    shell = trimesh.util.concatenate([outer, inner])
    field = field_from_mesh(shell.vertices, shell.faces, voxel=0.5)
    assert field.signed_distance([0.0, 0.0, 0.0]) == pytest.approx(2.0, abs=0.5)
    assert field.signed_distance([3.5, 0.0, 0.0]) == pytest.approx(-1.5, abs=1e-4)
    assert field.wall_error is None


def test_large_triangles_leave_no_gap_in_the_wall():
    mesh = trimesh.creation.box(extents=(40, 3, 3))
    field = field_from_mesh(mesh.vertices, mesh.faces, voxel=0.5)
    random = np.random.default_rng(1)
    points = random.uniform([-24, -6, -6], [24, 6, 6], (3000, 3))
    exact = -trimesh.proximity.signed_distance(mesh, points)
    sure = np.abs(exact) > field.error
    assert np.all((field.signed_distance(points)[sure] > 0) == (exact[sure] > 0))


def test_every_point_of_the_wall_has_a_marked_node_near():
    random = np.random.default_rng(5)
    faces = np.arange(90).reshape(-1, 3)
    scale = np.repeat(random.choice([0.2, 3.0, 12.0], 30), 3)[:, None]
    vertices = random.uniform(15, 25, (30, 3)).repeat(3, axis=0)
    vertices += scale * random.uniform(-1, 1, (90, 3))
    vertices[1::6] = vertices[0::6] + 0.01  # half of them slivers
    marked = np.zeros((41, 41, 41), dtype=np.uint8)
    slack = walls.MeshWall(vertices, faces).mark(marked, np.zeros(3), np.ones(3))
    weights = random.dirichlet([0.6, 0.6, 0.6], 400)
    points = np.einsum("kc,fcd->fkd", weights, vertices[faces]).reshape(-1, 3)
    far, _ = cKDTree(np.argwhere(marked)).query(points)
    assert far.max() <= 1.4434
    across, _ = cKDTree(np.argwhere(marked)).query(points, p=np.inf)
    assert across.max() <= slack.max() == walls.MARK_SLACK
    back, _ = cKDTree(points).query(np.argwhere(marked))
    assert back.max() < 3.0  # and no node is marked far from the wall


def test_a_capsule_of_long_thin_triangles_is_built_right():
    capsule = trimesh.creation.capsule(height=300.0, radius=10.0, count=[128, 128])
    assert len(capsule.faces) > 32_000
    field = field_from_mesh(capsule.vertices, capsule.faces, voxel=2.0)
    random = np.random.default_rng(6)
    nodes = np.array([random.integers(0, n, 4000) for n in field.values.shape]).T
    points = field.to_world(nodes * field.spacing)
    low, high = capsule.bounds[:, 2] + [10.0, -10.0]
    axis = np.stack([0 * points[:, 2], 0 * points[:, 2], np.clip(points[:, 2], low, high)], axis=1)
    exact = np.linalg.norm(points - axis, axis=1) - 10.0
    near = exact < field.reach
    assert field.values[tuple(nodes.T)][near] == pytest.approx(exact[near], abs=0.02)


@pytest.mark.parametrize("cosine", [3e-6, 1e-4, 9e-4])
def test_axes_not_quite_square_move_the_wall_by_no_more_than_is_said(cosine):
    mask = np.zeros((40, 30, 60), dtype=bool)
    mask[2:-2, 2:-2, 2:-2] = True
    random = np.random.default_rng(7)
    affine = np.eye(4)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    affine[:3, :3] = turn @ np.array([[1, cosine, 0], [0, 1, -cosine], [0, 0, 1]]) * [1.2, 1, 2.5]
    if cosine == 1e-4:
        affine[:3, :3] = np.round(affine[:3, :3] / [1.2, 1, 2.5], 4) * [1.2, 1, 2.5]
    affine[:3, 3] = [80.0, -30.0, 500.0]
    check_squared(mask, affine)


def check_squared(mask, affine):
    field = field_from_mask(mask, affine)
    shift = field.wall_error - 0.5 * np.linalg.norm(np.linalg.norm(affine[:3, :3], axis=0))
    assert 0.0 < shift < 0.2
    # Corners of the lumen in the world lie that near to the field's wall.
    index = np.argwhere(mask)
    ends = np.array([index.min(axis=0) - 0.5, index.max(axis=0) + 0.5])
    corners = np.array(np.meshgrid(*ends.T, indexing="ij")).reshape(3, -1).T
    world = corners @ affine[:3, :3].T + affine[:3, 3]
    rotation = field.rotation
    local = (world - world.mean(axis=0)) @ rotation
    size = (ends[1] - ends[0]) * np.linalg.norm(affine[:3, :3], axis=0)
    moved = np.linalg.norm(local - np.sign(local) * size / 2, axis=1).max()
    assert moved == pytest.approx(shift, rel=1e-3, abs=1e-9)
    middle = field.signed_distance(world.mean(axis=0))
    assert middle == pytest.approx(-size.min() / 2, abs=field.error)


def test_coarse_voxels_get_nodes_fine_enough_for_a_useful_bound():
    mask = np.zeros((5, 5, 14), dtype=bool)
    mask[1:4, 1:4, 1:13] = True
    field = field_from_mask(mask, np.diag([20.0, 20.0, 20.0, 1.0]))
    assert field.spacing.max() <= 1.5
    assert field.wall_error == pytest.approx(10.0 * np.sqrt(3.0))
    axis = np.stack([np.full(50, 40.0), np.full(50, 40.0), np.linspace(60, 200, 50)], axis=1)
    assert field.signed_distance(axis) == pytest.approx(-30.0, abs=field.error)
    bound = field.clearance_bound(axis)
    assert np.all(bound <= 30.0 + 1e-5)
    assert bound.min() > 30.0 - field.error


def test_a_grid_is_refined_only_as_far_as_it_may_grow():
    fine = divide_voxels(np.array([2.0, 3.0, 1.5]), np.array([100.0, 100.0, 100.0]))
    assert fine == pytest.approx([1.0, 1.5, 1.5])
    size = np.array([800.0, 800.0, 500.0])
    some = divide_voxels(np.full(3, 2.5), size)
    assert np.all(some <= 2.5) and np.any(some > 1.25)
    assert np.prod(size / some) <= MAX_NODES
    assert np.prod(size * 4 / divide_voxels(np.full(3, 2.5), size * 4)) <= MAX_NODES


@pytest.mark.parametrize("inflate", [0.0, 2.5])
def test_interpolation_error_is_within_its_statement(inflate):
    mesh = icosphere()
    field = field_from_mesh(mesh.vertices, mesh.faces, voxel=1.0, inflate=inflate)
    random = np.random.default_rng(2)
    points = random.uniform(*field.bounds, (4000, 3))
    exact = -trimesh.proximity.signed_distance(mesh, points) - inflate
    near = exact + inflate < field.reach - 2.0
    assert np.abs(field.signed_distance(points) - exact)[near].max() <= field.error
    # Farther out it is a lower bound, beyond the inflation: no room is promised there.
    least = np.minimum(exact, field.reach - inflate)
    assert np.all((field.signed_distance(points) - least) >= -field.error)
    assert field.reach - field.error > inflate


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


def lump(random, count, *, snap):
    """Overlapping boxes and balls, some corners exactly on nodes, and what only is a wall."""
    parts = []
    for _ in range(count):
        part = trimesh.creation.box(extents=random.integers(3, 9, 3))
        if random.random() < 0.5:
            part = trimesh.creation.icosphere(subdivisions=1, radius=random.uniform(2, 5))
        if not snap:
            part.apply_transform(trimesh.transformations.random_rotation_matrix(random.random(3)))
        shift = random.uniform(-4, 4, 3)
        part.apply_translation(np.rint(shift) if snap else shift)
        parts.append(part)
    body = trimesh.creation.box(extents=(2, 3, 2))
    body.apply_translation(random.uniform(-1, 1, 3))
    body.invert()
    corners = random.uniform(-3, 3, (3, 3))
    sheet = trimesh.Trimesh(corners, [[0, 1, 2], [2, 1, 0]], process=False)
    return trimesh.util.concatenate([*parts, body, sheet])


@pytest.mark.slow
@pytest.mark.parametrize("snap", [False, True])
@pytest.mark.parametrize("seed", [0, 1])
def test_every_node_agrees_with_winding_number_and_exact_distance(seed, snap):
    random = np.random.default_rng(seed)
    mesh = lump(random, 4, snap=snap)
    field = field_from_mesh(mesh.vertices, mesh.faces, voxel=0.5 if snap else 0.47)
    nodes = np.indices(field.values.shape).reshape(3, -1).T
    points = field.to_world(nodes * field.spacing)
    exact = MeshWall(mesh.vertices, mesh.faces)
    distance = exact.boxes.squared_distance(exact.vertices, exact.faces, points)[0] ** 0.5
    # The winding number summed over all triangles, not libigl's fast one, which is approximate.
    winding = winding_number(points, mesh.triangles)
    values = field.values.reshape(-1).astype(float)
    clear = distance > 1e-6
    assert np.array_equal((values < 0.0)[clear], (winding > 0.5)[clear])
    assert not (values < 0.0)[~clear].any()
    assert np.any(winding > 1.5) and np.any(values < 0.0)
    depth = np.where(values < 0.0, distance, np.minimum(distance, field.reach))
    assert np.all(np.abs(values) <= depth * (1.0 + 1e-12) + 1e-12)
    assert np.all(np.abs(values) >= depth * (1.0 - 1.3e-7) - 1.1e-6)


def winding_number(points, triangles):
    """Sum of the solid angles of triangles (m, 3, 3), over 4 pi (van Oosterom and Strackee)."""
    total = np.zeros(len(points))
    for begin in range(0, len(points), 2048):  # so few stay in the cache
        some = slice(begin, begin + 2048)
        places = np.ascontiguousarray(points[some].T)
        for triangle in triangles:
            a, b, c = (corner[:, None] - places for corner in triangle)
            la, lb, lc = (np.sqrt(_dot(v, v)) for v in (a, b, c))
            volume = _dot(a, [b[k - 2] * c[k - 1] - b[k - 1] * c[k - 2] for k in range(3)])
            sides = la * lb * lc + lc * _dot(a, b) + la * _dot(b, c) + lb * _dot(c, a)
            total[some] += 2.0 * np.arctan2(volume, sides)
    return total / (4.0 * np.pi)


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def test_a_hole_in_the_mesh_is_settled_by_the_winding_number():
    mesh = icosphere()
    faces = np.delete(mesh.faces, 17, axis=0)
    field = field_from_mesh(mesh.vertices, faces, voxel=0.5)
    whole = field_from_mesh(mesh.vertices, mesh.faces, voxel=0.5)
    differ = (field.values < 0.0) != (whole.values < 0.0)
    assert np.count_nonzero(differ) < 20
    assert field.signed_distance([1.0, 2.0, 3.0]) == pytest.approx(-8.0, abs=0.3)


def test_a_wall_that_reaches_outside_is_a_wall_but_cannot_be_moved():
    tube = trimesh.creation.capsule(height=20, radius=6, count=[16, 16])
    ball = trimesh.creation.icosphere(radius=2)
    ball.apply_translation([6, 0, 10])
    ball.invert()
    mesh = trimesh.util.concatenate([tube, ball])
    field = field_from_mesh(mesh.vertices, mesh.faces, voxel=0.5)
    assert field.signed_distance([5.0, 0.0, 10.0]) > 0.0  # in the polyp
    assert field.signed_distance([7.5, 0.0, 10.0]) > 0.0  # its other half
    assert field.signed_distance([2.0, 0.0, 10.0]) == pytest.approx(-2.0, abs=field.error)
    with pytest.raises(InputError, match=r"distance is 0\.5 mm: it must be 0 mm, because"):
        field.inflate(0.5)
    with pytest.raises(GeometryError, match="turned inside out near"):
        field_from_mesh(mesh.vertices, mesh.faces, voxel=0.5, reach=1.0)


def test_a_wall_is_moved_only_as_far_as_distances_are_known():
    mesh = icosphere()
    mask = np.ones((5, 5, 5), dtype=bool)
    for field in (
        field_from_mesh(mesh.vertices, mesh.faces, voxel=1.0),
        field_from_mask(mask, np.eye(4)),
    ):
        assert field.inflate(4.0).inflation == field.inflation_max == 4.0
        with pytest.raises(InputError, match=r"distance is 4\.5 mm: it must be at most 4 mm"):
            field.inflate(4.5)
        with pytest.raises(InputError, match=r"distance is 2 mm: it must be at most 1 mm"):
            field.inflate(3.0).inflate(2.0)
    wide = field_from_mesh(mesh.vertices, mesh.faces, voxel=1.0, reach=9.0)
    assert wide.reach == 11.0
    direct = field_from_mesh(mesh.vertices, mesh.faces, voxel=1.0, inflate=9.0)
    points = np.random.default_rng(0).uniform(*wide.bounds, (2000, 3))
    near = np.linalg.norm(points - [1.0, 2.0, 3.0], axis=1) < 8.0 + 9.0 + 0.5
    assert wide.inflate(9.0).signed_distance(points[near]) == pytest.approx(
        direct.signed_distance(points[near]), abs=2.0 * direct.error
    )
    assert np.all(wide.inflate(9.0).clearance_bound(points[~near]) <= 0.0)


def test_what_the_tract_states_of_its_wall_is_kept():
    labels = np.zeros((9, 9, 9), dtype=np.uint16)
    labels[3:6, 3:6, 3:6] = 1
    plain = LabelTract(labels=labels, affine=np.eye(4), source="made")
    stated = replace(plain, wall="a wall made elsewhere", wall_error=1.25)
    assert build_field(plain).wall_error == pytest.approx(0.5 * 3**0.5)
    field = build_field(stated)
    assert (field.wall, field.wall_error) == ("a wall made elsewhere", 1.25)


def test_progress_is_shown_and_ends():
    mesh = icosphere()
    seen = []
    field_from_mesh(
        mesh.vertices, mesh.faces, voxel=1.0, progress=lambda stage, part: seen.append(part)
    )
    assert len(seen) >= 10 and seen == sorted(seen) and seen[-1] == 1.0
