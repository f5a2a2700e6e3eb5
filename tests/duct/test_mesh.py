"""A triangle mesh as a duct: exact distance, sign by winding, and where it is not closed."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.duct.base import Duct
from bozzini.duct.shapes.mesh import TriangleMesh
from bozzini.errors import GeometryError


def as_duct(mesh, **options):
    return TriangleMesh(np.asarray(mesh.vertices), np.asarray(mesh.faces), **options)


def lump(seed):
    """A ball with dents, turned."""
    random = np.random.default_rng(seed)
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=5.0)
    mesh.vertices *= random.uniform(0.7, 1.3, (len(mesh.vertices), 1))
    mesh.apply_transform(trimesh.transformations.random_rotation_matrix(random.random(3)))
    return random, mesh


def scatter(random, duct, count, margin=2.0):
    low, high = duct.bounds
    return random.uniform(low - margin, high + margin, (count, 3))


def test_a_box_is_exact():
    duct = as_duct(trimesh.creation.box(extents=(2, 4, 6)))
    points = scatter(np.random.default_rng(0), duct, 100_000)
    over = np.abs(points) - [1.0, 2.0, 3.0]
    exact = np.linalg.norm(np.maximum(over, 0.0), axis=1) + np.minimum(over.max(axis=1), 0.0)
    value = duct.signed_distance(points)
    assert np.abs(value - exact).max() < 1e-9
    assert np.array_equal(value < 0.0, exact < 0.0)
    assert duct.volume == pytest.approx(48.0)


def test_few_and_many_points_are_answered_alike():
    random, mesh = lump(3)
    duct = as_duct(mesh)
    points = scatter(random, duct, 5000)
    value = duct.signed_distance(points)
    gradient = duct.gradient(points)
    some = slice(0, 300)
    assert np.array_equal(duct.signed_distance(points[some]), value[some])
    assert np.array_equal(duct.gradient(points[some]), gradient[some])
    assert duct.signed_distance(points.reshape(50, 100, 3)).shape == (50, 100)


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_distance_is_that_of_another_library(seed):
    random, mesh = lump(seed)
    duct = as_duct(mesh)
    points = scatter(random, duct, 200)
    _, distance, _ = trimesh.proximity.closest_point(mesh, points)
    value = duct.signed_distance(points)
    assert np.abs(value) == pytest.approx(distance, abs=1e-9)
    assert np.array_equal(value < 0.0, mesh.contains(points))


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_winding_is_the_sum_of_solid_angles(seed):
    import igl

    random, mesh = lump(seed)
    # Two lumps through each other: wound about once or twice.
    other = lump(seed + 1)[1]
    both = trimesh.util.concatenate([mesh, other.apply_translation([3.0, 0.0, 0.0])])
    duct = as_duct(both)
    points = scatter(random, duct, 400)
    sums = igl.winding_number(duct.vertices, duct.faces, points)
    assert np.array_equal(duct.count_windings(points), np.rint(sums).astype(int))
    assert np.array_equal(duct.signed_distance(points) < 0.0, sums > 0.5)


def test_rays_through_corners_and_edges_count_once():
    corners = np.linspace(-2.0, 2.0, 5)
    mesh = trimesh.creation.box(extents=(4, 4, 4)).subdivide().subdivide()
    duct = as_duct(mesh)
    points = np.stack(np.meshgrid(corners, corners, corners, indexing="ij"), -1).reshape(-1, 3)
    points = np.concatenate([points * 0.5, points * 1.5])  # on and between the mesh's own lines
    inside = np.abs(points).max(axis=1) < 2.0
    wall = np.abs(points).max(axis=1) == 2.0
    assert np.array_equal((duct.count_windings(points) > 0)[~wall], inside[~wall])
    turned = TriangleMesh(duct.vertices[:, [1, 2, 0]], duct.faces)
    again = turned.count_windings(points[:, [1, 2, 0]])
    assert np.array_equal((again > 0)[~wall], inside[~wall])


def test_distance_changes_no_faster_than_the_point():
    random, mesh = lump(5)
    duct = as_duct(mesh)
    a = scatter(random, duct, 20_000)
    b = a + random.normal(size=a.shape) * random.choice([1e-4, 0.5], (len(a), 1))
    change = np.abs(duct.signed_distance(a) - duct.signed_distance(b))
    assert np.all(change <= np.linalg.norm(a - b, axis=1) + 1e-11)


def test_the_gradient_leads_to_the_wall_and_is_its_normal_there():
    random, mesh = lump(8)
    duct = as_duct(mesh)
    points = scatter(random, duct, 2000)
    gradient = duct.gradient(points)
    assert np.linalg.norm(gradient, axis=1) == pytest.approx(1.0)
    foot = points - duct.signed_distance(points)[:, None] * gradient
    assert np.abs(duct.signed_distance(foot)).max() < 1e-9
    box = as_duct(trimesh.creation.box(extents=(2, 2, 2)))
    assert box.gradient([1.0, 0.3, 0.2]) == pytest.approx([1.0, 0.0, 0.0])


def test_a_mesh_inside_out_is_turned():
    _, mesh = lump(1)
    duct = TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
    assert duct.volume > 0.0
    assert float(duct.signed_distance([0.0, 0.0, 0.0])) < 0.0


def test_kernels_get_a_rigorous_bound():
    random, mesh = lump(9)
    duct = as_duct(mesh)
    field = duct.sample(0.5)
    points = scatter(random, duct, 20_000)
    # Outside, a sampled field only knows distances up to its reach.
    known = np.minimum(duct.signed_distance(points), field.reach)
    assert np.all(field.clearance_bound(points) <= -known + 1e-9)
    again = duct.to_world(duct.to_grid(points))
    assert again == pytest.approx(points, abs=1e-9)
    assert duct.pack().values.shape == duct.sample().values.shape
    wider = duct.inflate(0.5)
    assert wider.signed_distance(points) == pytest.approx(duct.signed_distance(points) - 0.5)
    assert wider.pack().inflation == 0.5
    bound = duct.clearance_bound(points)
    assert np.all(bound < -duct.signed_distance(points)) and np.all(
        bound > -duct.signed_distance(points) - 1e-9
    )


def test_an_open_mesh_says_where():
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    middles = mesh.triangles_center
    order = np.argsort(np.linalg.norm(middles - [0.0, 10.0, 0.0], axis=1))
    keep = np.delete(np.arange(len(mesh.faces)), [*order[:6], int(np.argmin(middles[:, 1]))])
    with pytest.raises(GeometryError) as caught:
        TriangleMesh(mesh.vertices, mesh.faces[keep])
    text = str(caught.value)
    assert "the mesh is not closed: " in text and " in 2 holes, the largest with " in text
    place = np.array(text.split("near (")[1].split(")")[0].split(","), dtype=float)
    assert np.linalg.norm(place - [0.0, 10.0, 0.0]) < 1.0


def test_it_is_a_duct():
    _, mesh = lump(1)
    duct = as_duct(mesh, wall_error=0.2)
    assert isinstance(duct, Duct)
    assert (duct.kind, duct.error, duct.wall_error) == ("bound", 0.0, 0.2)
