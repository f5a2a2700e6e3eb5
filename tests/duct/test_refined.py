"""Finer nodes along a line: never more room than there is, and more of it proved."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.anatomy import LabelTract, SurfaceTract
from bozzini.duct import Duct, build_field, field_from_mask, refine_field
from bozzini.errors import InputError
from tests.duct.test_build import icosphere
from tests.exact import MeshWall, VoxelWall
from tests.motion.planted import plant


def make_tract(kind):
    random = np.random.default_rng(5)
    if kind == "surface":
        mesh = icosphere(radius=9.0)
        vertices = mesh.vertices + random.normal(size=mesh.vertices.shape) * 0.2
        tract = SurfaceTract(vertices=vertices, faces=mesh.faces, source="made")
        return tract, MeshWall(vertices, mesh.faces)
    labels = np.zeros((20, 22, 24), dtype=np.uint16)
    labels[3:-3, 3:-3, 3:-3] = random.random((14, 16, 18)) < 0.97
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    affine = np.eye(4)
    affine[:3, :3] = turn * [1.0, 0.8, 1.1]
    affine[:3, 3] = -affine[:3, :3] @ [10, 11, 12] + [1.0, 2.0, 3.0]
    return LabelTract(labels=labels, affine=affine, source="made"), VoxelWall(labels != 0, affine)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["surface", "labels"])
def test_bounds_hold_and_are_tighter_near_the_line(kind):
    tract, wall = make_tract(kind)
    field = build_field(tract, voxel=1.0)
    line = np.array([1.0, 2.0, 3.0]) + np.linspace(-3, 3, 7)[:, None] * [0.3, 0.2, 1.0]
    fine = refine_field(field, tract, line_points_world=line, distance=2.5)
    assert isinstance(fine, Duct) and fine.coarse is field
    random = np.random.default_rng(0)
    points = random.uniform(*field.bounds, (4000, 3))
    points = np.concatenate([points, line[3] + random.uniform(-3, 3, (1000, 3))])
    exact = wall.clearance(points)
    bound = fine.clearance_bound(points)
    inside = exact > 0.0
    assert np.all(bound[inside] <= exact[inside] + 1e-9)
    assert np.all(bound[~inside] <= 1e-9)
    assert np.all(np.abs(fine.signed_distance(points) + exact)[inside] <= fine.error)
    gaps = np.linalg.norm(points[:, None] - line, axis=2).min(axis=1)
    near, far = gaps <= 2.5, gaps > 2.5 + 8 * 0.5 * 3**0.5
    coarse = field.clearance_bound(points)
    assert near.sum() > 50 and far.sum() > 50
    assert bound[far] == pytest.approx(coarse[far], abs=1e-6)
    loose = (exact - coarse)[near & inside], (exact - bound)[near & inside]
    assert loose[1].max() <= 0.5 * 3**0.5 + 1e-5  # the diagonal of a finer cell
    assert loose[1].mean() < 0.6 * loose[0].mean()
    # The slope is that of the interpolant.
    inner = points[near & inside][:40]
    step = 1e-6
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        slope = fine.signed_distance(inner + shift) - fine.signed_distance(inner - shift)
        found = fine.gradient(inner)[:, axis]
        assert np.median(np.abs(found - slope / (2 * step))) < 1e-6


def test_nodes_are_those_of_a_field_that_is_fine_everywhere():
    tract, _ = make_tract("surface")
    field = build_field(tract, voxel=1.0)
    fine = refine_field(
        field, tract, line_points_world=field.bounds.mean(axis=0)[None], distance=60.0
    )
    whole = build_field(tract, voxel=0.5)
    assert (fine.table >= 0).all()
    points = np.random.default_rng(1).uniform(*field.bounds, (3000, 3))
    assert fine.signed_distance(points) == pytest.approx(whole.signed_distance(points), abs=1.0)
    bricks = np.argwhere(fine.table >= 0)[::7]
    for brick in bricks:
        corner = field.to_world(brick * 8 * fine.spacing)
        value = fine.values[fine.table[tuple(brick)]][0, 0, 0]
        assert value == pytest.approx(field.signed_distance(corner), abs=1e-6)


def test_inflation_moves_both_and_is_refused_beyond_the_reach():
    tract, wall = make_tract("labels")
    field = build_field(tract, voxel=1.0)
    fine = refine_field(field, tract, line_points_world=[[1.0, 2.0, 3.0]])
    wide = fine.inflate(2.0)
    assert wide.inflation == wide.coarse.inflation == 2.0
    points = np.random.default_rng(2).uniform(*field.bounds, (500, 3))
    assert wide.signed_distance(points) == pytest.approx(fine.signed_distance(points) - 2.0)
    with pytest.raises(InputError, match="it must be at most 4 mm"):
        fine.inflate(4.5)


@pytest.mark.slow
def test_a_field_of_another_tract_is_refused():
    labels, _ = make_tract("labels")
    surface, _ = make_tract("surface")
    with pytest.raises(InputError, match="do not belong together"):
        refine_field(build_field(surface), labels, line_points_world=[[1.0, 2.0, 3.0]])
    with pytest.raises(InputError, match="bricks, the limit is"):
        refine_field(build_field(surface), surface, line_points_world=[[1.0, 2.0, 3.0]], voxel=0.02)


@pytest.mark.slow
def test_tubes_that_coarse_nodes_refuse_are_passed():
    refused = 0
    for seed in range(6):
        tube = plant(seed, grid=1.0)
        tract = LabelTract(
            labels=np.pad(tube.wall.mask, 1).astype(np.uint16),
            affine=shift_affine(tube.wall),
            source="made",
        )
        field = field_from_mask(tract.mask, tract.affine, voxel=1.0)
        fine = refine_field(field, tract, line_points_world=tube.line.points)
        radius = 0.5 * tube.scope.diameter
        refused += field.clearance_bound(tube.curve).min() < radius
        assert radius <= fine.clearance_bound(tube.curve).min()
        assert np.all(fine.clearance_bound(tube.curve) <= tube.wall.clearance(tube.curve) + 1e-9)
    assert refused >= 1


def shift_affine(wall):
    affine = np.eye(4)
    affine[:3, :3] = wall.turn * wall.scale
    affine[:3, 3] = wall.origin - affine[:3, :3] @ np.ones(3)
    return affine
