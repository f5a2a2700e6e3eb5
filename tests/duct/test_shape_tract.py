"""Shapes as a tract: triangles that are on their wall, and plans inside them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.duct import Circles, ConvexPolyhedra, PointCloud, RoundCones, build_field, save
from bozzini.duct.shape_files import ShapesFile
from bozzini.duct.shape_tract import make_shape_tract, open_tract
from bozzini.errors import InputError


def _make_bend():
    turn = np.linspace(0.0, 0.5 * np.pi, 9)
    centres = 50.0 * np.stack([1.0 - np.cos(turn), 0.0 * turn, np.sin(turn)], axis=1)
    return RoundCones(centres, np.linspace(7.0, 9.0, 9))


def test_the_triangles_are_on_the_wall_of_round_cones():
    duct = _make_bend()
    tract = make_shape_tract(ShapesFile(shapes=duct))
    assert np.abs(duct.signed_distance(tract.vertices)).max() < 1e-3
    assert tract.wall_error < 0.1 and "off it at most" in tract.findings[0].message
    # Two routes to the distance inside: of the shapes, and of a grid over the triangles.
    field = build_field(tract, voxel=1.0)
    points = np.random.default_rng(0).uniform(*duct.bounds, (4000, 3))
    points = points[duct.signed_distance(points) < -1.0]
    off = field.signed_distance(points) - duct.signed_distance(points)
    assert len(points) > 100 and np.abs(off).max() < tract.wall_error + field.error


def test_the_volume_of_a_box_of_half_spaces_is_its_own():
    corners = np.array([[x, y, z] for x in (0.0, 30.0) for y in (0.0, 20.0) for z in (0.0, 12.0)])
    tract = make_shape_tract(ShapesFile(shapes=ConvexPolyhedra.from_points([corners])))
    assert tract.volume == pytest.approx(30.0 * 20.0 * 12.0, rel=0.01)


def test_a_cloud_of_points_is_a_tract_of_what_it_encloses(tmp_path):
    turn = np.arange(6000) * np.pi * (3.0 - np.sqrt(5.0))  # evenly over a sphere
    height = np.linspace(-1.0, 1.0, 6000)
    ring = np.sqrt(1.0 - height**2)
    points = 15.0 * np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)
    cloud = PointCloud(points, spacing=0.6, seeds=[[0.0, 0.0, 0.0]])
    save(cloud, tmp_path / "cloud.json")
    tract = open_tract(tmp_path / "cloud.json")
    radius = np.linalg.norm(tract.vertices, axis=1)
    assert 14.39 < radius.min() and radius.max() < 15.0  # the samples are balls of 0.6 mm
    assert tract.wall_error >= 0.6


def test_planar_shapes_and_options_of_files_are_refused(tmp_path):
    save(Circles(np.array([[0.0, 0.0]]), np.array([5.0])), tmp_path / "flat.json")
    with pytest.raises(InputError, match="planar shapes"):
        open_tract(tmp_path / "flat.json")
    with pytest.raises(InputError, match="has no labels, leave it out"):
        open_tract(tmp_path / "flat.json", labels=[1])


@pytest.mark.slow
def test_a_scope_is_planned_and_certified_inside_shapes(tmp_path, capsys):
    save(_make_bend(), tmp_path / "bend.yaml")
    command = ["plan", str(tmp_path / "bend.yaml"), "--link", "8mm", "--quiet", "--json"]
    assert main([*command, "--diameter", "6mm", "--out", str(tmp_path / "out")]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["status"] == "complete" and answer["certified"]
    plan = tmp_path / "out" / "plan.npz"
    assert main(["certify", str(plan), str(tmp_path / "bend.yaml"), "--json", "--quiet"]) == 0
    capsys.readouterr()
    assert main([*command, "--diameter", "15mm", "--out", str(tmp_path / "wide")]) == 1
