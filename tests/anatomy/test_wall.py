"""Whatever a file holds in the lumen or across its wall is wall for the certified motion."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from bozzini.anatomy import read_surface
from bozzini.duct import TriangleMesh, build_field, find_centreline
from bozzini.errors import GeometryError
from bozzini.motion import Scope
from tests.exact import outside_introducer, sample_body
from tests.motion.plans import insert

LENGTH = 70.0
RADIUS = 10.0
ENDS = ((0.0, 0.0, 27.0), (0.0, 0.0, -27.0))


def tube():
    mesh = trimesh.creation.cylinder(radius=RADIUS, height=LENGTH, sections=24)
    return mesh.subdivide().subdivide()


def sheet(low, high, z):
    """Return a rectangle across the tube, x from `low` to `high`, of two triangles."""
    corners = [(low, -14, z), (high, -14, z), (high, 14, z), (low, 14, z)]
    return trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False)


def disc(radius):
    turn = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)
    corners = np.vstack((np.zeros(3), np.stack((np.cos(turn), np.sin(turn), 0 * turn), 1) * radius))
    return trimesh.Trimesh(
        corners, [(0, 1 + k, 1 + (k + 1) % 12) for k in range(12)], process=False
    )


def ball(radius, *centre, inverted=False):
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    mesh.apply_translation(centre)
    if inverted:
        mesh.invert()
    return mesh


def shell(radius, *centre):
    mesh = ball(radius, *centre)
    mesh.update_faces(mesh.triangles_center[:, 2] > 0.0)
    return mesh


OBSTACLES = {
    "plate through the wall": [sheet(-14, 14, 1.3)],
    "plate within the lumen": [disc(9.7)],
    "half a plate": [sheet(-14, 1, 0.4)],
    "polyp in the wall": [ball(6.0, 9.0, 0, 0)],
    "polyp inside out": [ball(6.0, 9.0, 0, 0, inverted=True)],
    "polyp that fills the lumen": [ball(14.0, 4.0, 0, 0)],
    "bodies that overlap": [ball(4.0, 4.0, 0, 0), ball(4.0, 6.0, 0, 3, inverted=True)],
    "open shell": [shell(5.0, 7.0, 0, 0)],
}

BLOCKING = ("plate through the wall", "plate within the lumen", "polyp that fills the lumen")


def clearance(points, mesh):
    """Return the least distance from points to the triangles of a mesh, by trying all pairs."""
    least = np.full(len(points), np.inf)
    for corners in mesh.triangles:
        feet = trimesh.triangles.closest_point(np.tile(corners, (len(points), 1, 1)), points)
        least = np.minimum(least, np.linalg.norm(feet - points, axis=1))
    return least


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    path = tmp_path_factory.mktemp("bare") / "tube.stl"
    tube().export(path)
    return plan_through(read_surface(path))


def plan_through(tract):
    field = build_field(tract, voxel=1.0)
    line = find_centreline(field, ENDS)
    return insert(field, line, scope=Scope(diameter=8.0, link_length=8.0))


@pytest.mark.parametrize("name", list(OBSTACLES))
def test_no_certified_motion_goes_through_a_triangle_of_the_file(tmp_path, bare, name):
    assert bare.status == "complete"
    things = OBSTACLES[name]
    path = tmp_path / "tube.stl"
    trimesh.util.concatenate([tube(), *things]).export(path)
    tract = read_surface(path)
    codes = {item.code for item in tract.findings}
    assert codes & {"pieces-inside", "bodies-inside"}
    assert "components-dropped" not in codes
    try:
        plan = plan_through(tract)
    except GeometryError:  # no way at all from end to end
        assert name in BLOCKING
        return
    if name in BLOCKING:
        assert plan.status == "stopped"
    if plan.inserted == 0.0:
        return
    assert plan.certified
    points, *_ = sample_body(plan.joints, 1500, np.random.default_rng(0))
    points = points[outside_introducer(points, plan.introducer, 4.0)]
    near = points[np.abs(points[:, 2]) < 25.0]
    for thing in things:
        assert len(near) == 0 or clearance(near, thing).min() >= 4.0 - 1e-9


@pytest.mark.parametrize("name", list(OBSTACLES))
def test_the_mesh_itself_is_a_duct_with_the_same_wall(tmp_path, name):
    path = tmp_path / "tube.stl"
    trimesh.util.concatenate([tube(), *OBSTACLES[name]]).export(path)
    tract = read_surface(path)
    duct = TriangleMesh(tract.vertices, tract.faces)
    random = np.random.default_rng(1)
    points = random.uniform((-9, -9, -20), (9, 9, 20), (40, 3))
    whole = trimesh.util.concatenate([tube(), *OBSTACLES[name]])
    assert np.abs(duct.signed_distance(points)) == pytest.approx(clearance(points, whole), abs=1e-6)


def test_a_part_apart_from_the_lumen_is_left_out_with_its_volume(tmp_path):
    path = tmp_path / "tube.stl"
    trimesh.util.concatenate([tube(), ball(5.0, 40.0, 0, 0)]).export(path)
    tract = read_surface(path)
    assert np.abs(tract.vertices[:, 0]).max() < 11.0
    dropped = {item.code: item for item in tract.findings}["components-dropped"].message
    assert "320 triangles and 0.5" in dropped
    assert "wholly outside" in dropped
    assert sum(part.volume for part in tract.not_reached) == pytest.approx(
        ball(5.0, 0, 0, 0).volume, rel=1e-6
    )


def test_a_plate_welded_into_the_wall_divides_the_lumen(tmp_path):
    """Its border is the wall's own edges: three triangles meet there."""
    half = trimesh.creation.cylinder(radius=RADIUS, height=60.0, sections=24)
    side = half.faces[np.abs(half.triangles_center[:, 2]) < 29.9]
    lid = half.faces[half.triangles_center[:, 2] > 29.9]
    bottom = half.faces[half.triangles_center[:, 2] < -29.9]
    upper = trimesh.Trimesh(half.vertices + [0, 0, 60], np.vstack((side, lid)), process=False)
    lower = trimesh.Trimesh(half.vertices, np.vstack((side, lid, bottom)), process=False)
    path = tmp_path / "divided.stl"
    trimesh.util.concatenate([upper, lower]).export(path)
    tract = read_surface(path)
    volume = 0.5 * (half.volume + half.volume)
    assert tract.volume == pytest.approx(volume, rel=0.05)
    points = np.array([(0, 0, 0), (0, 0, 60)], dtype=float)
    field = build_field(tract)
    assert np.count_nonzero(field.signed_distance(points) < 0.0) == 1
