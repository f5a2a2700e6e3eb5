"""Walls moved outwards: no place farther than that from the lumen becomes one with room."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

import bozzini.duct as ducts
from bozzini.anatomy import SurfaceTract
from bozzini.duct import (
    BetweenCurves,
    Circles,
    ConnectedCylinders,
    ConvexPolyhedra,
    Duct,
    DuctShape,
    Eroded,
    Moved,
    MovedField,
    PackedDuct,
    PlanarField,
    PointCloud,
    Polygon,
    RefinedField,
    RoundCones,
    SampledField,
    StitchedQuads,
    SuperEllipses,
    SuperEllipsoids,
    TriangleMesh,
    Union,
    Without,
    build_field,
    refine_field,
    union,
    without,
)
from bozzini.errors import GeometryError, InputError

MORE = 0.6
SIDES = np.array([(0, 0), (8, 0), (8, 3), (3, 4), (3, 9), (0, 9)], dtype=float)


def cones():
    return RoundCones([(0, 0, 0), (6, 0, 0), (6, 5, 0)], [1.5, 1.0, 2.0])


def boxes():
    cube = np.concatenate([np.eye(3), -np.eye(3)])
    planes = [
        np.column_stack([cube, np.full(6, -2.0) - cube @ centre])
        for centre in ((0, 0, 0), (3, 0, 0))
    ]
    return ConvexPolyhedra(planes)


def ellipsoids():
    return SuperEllipsoids(
        [(0, 0, 0), (3, 0, 0)],
        [(3, 1, 1.5), (1, 3, 1)],
        e1=[0.3, 1.5],
        e2=[0.5, 1.0],
        rotations=[np.eye(3)] * 2,
    )


def solid():
    """Two boxes that cross."""
    first = trimesh.creation.box(extents=(6, 2, 2))
    second = trimesh.creation.box(extents=(2, 6, 2.2))
    mesh = trimesh.util.concatenate([first, second])
    return TriangleMesh(mesh.vertices, mesh.faces)


def hollow():
    """Two boxes that cross, and a body in one of them: all that a mesh may have at rest."""
    first = trimesh.creation.box(extents=(6, 2, 2))
    second = trimesh.creation.box(extents=(2, 6, 2.2))
    hole = trimesh.creation.box(extents=(0.5, 0.5, 0.5))
    hole.apply_translation([-2.2, 0.1, 0.0])
    hole.invert()
    mesh = trimesh.util.concatenate([first, second, hole])
    return TriangleMesh(mesh.vertices, mesh.faces)


def curves(**options):
    return BetweenCurves(
        lambda u: np.stack([u, np.sin(u)], axis=1),
        lambda u: np.stack([u, 2.0 + np.cos(u)], axis=1),
        span=(0.0, 5.0),
        **options,
    )


def refined():
    mesh = trimesh.creation.capsule(height=6.0, radius=2.0, count=[16, 16])
    tract = SurfaceTract(vertices=mesh.vertices, faces=mesh.faces, source="made")
    field = build_field(tract, voxel=0.5)
    return refine_field(field, tract, line_points_world=mesh.vertices, voxel=0.25, distance=2.0)


TURN = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])

DUCTS = {
    Polygon: lambda: Polygon(SIDES),
    StitchedQuads: lambda: StitchedQuads([(0, 0), (4, 1), (8, 0)], [(0, 3), (4, 3), (9, 5)]),
    BetweenCurves: lambda: curves(curvature=1.0, tolerance=0.05),
    SuperEllipses: lambda: SuperEllipses(
        [(0, 0), (3, 0)], [(3, 1), (1, 3)], powers=[8.0, 1.2], angles=[0.4, 0.0]
    ),
    Circles: lambda: Circles([(0, 0), (2, 1)], [1.5, 1.0]),
    PlanarField: lambda: Polygon(SIDES).sample(0.4),
    RoundCones: cones,
    ConnectedCylinders: lambda: ConnectedCylinders(
        [(0, 0, 0), (4, 0, 0), (7, 2, 0)], [(1, 0, 0), (1, 0.3, 0), (1, 1, 0)], [1.5, 1.0, 1.2]
    ),
    SuperEllipsoids: ellipsoids,
    ConvexPolyhedra: boxes,
    TriangleMesh: solid,
    SampledField: lambda: cones().sample(0.25),
    RefinedField: lambda: refined(),
    Union: lambda: union(cones(), Moved(boxes(), shift=[0.0, 1.0, 0.0])),
    Moved: lambda: Moved(ellipsoids(), rotation=TURN, shift=[1.0, -2.0, 0.5]),
}
"""One duct of each kind whose wall can be moved; wrappers that have two walls come below."""


def scatter(duct, count=30_000):
    low, high = duct.bounds
    reach = 4.0 * MORE
    return np.random.default_rng(0).uniform(low - reach, high + reach, (count, len(low)))


def measure_outside(duct, points, nodes_most=300_000):
    """Distances to the lumen, by its places on a grid, and how much too large they may be."""
    low, high = duct.bounds
    dim = len(low)
    pitch = float((np.prod(high - low) / nodes_most) ** (1.0 / dim))
    axes = [np.arange(low[k], high[k] + pitch, pitch) for k in range(dim)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dim)
    lumen = nodes[duct.signed_distance(nodes) <= duct.error]
    # No corner of these lumens is so sharp that it holds no node within two cells.
    return cKDTree(lumen).query(points)[0], 2.0 * pitch


def test_every_duct_with_a_wall_to_move_is_here():
    kinds = [getattr(ducts, name) for name in ducts.__all__]
    movable = {kind for kind in kinds if isinstance(kind, type) and hasattr(kind, "inflate")}
    fixed = {PointCloud, MovedField}  # they refuse it
    assert movable - set(DUCTS) == {Duct, PackedDuct, DuctShape, Eroded, Without} | fixed


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(DUCTS), ids=lambda kind: kind.__name__)
def test_room_is_made_within_reach_of_the_lumen_only(kind):
    duct = DUCTS[kind]()
    wide = duct.inflate(MORE)
    # The box of a refined field is its coarse grid's, much larger than its lumen.
    more = 10 if kind is RefinedField else 1
    points = scatter(duct, more * 30_000)
    away, slack = measure_outside(duct, points, more * 300_000)
    room = wide.clearance_bound(points) > 0.0
    assert room.any() and np.all(away[room] <= MORE + slack)
    assert np.all(room[duct.clearance_bound(points) > 0.0])
    assert np.any(room & (duct.signed_distance(points) > slack))
    # What planners see of it promises no more.
    from bozzini.duct.kernels.clearance import evaluate_bound

    packed = np.empty(len(points))
    evaluate_bound(wide.pack(), np.array(wide.to_grid(points), order="C"), packed)
    assert np.all(away[packed > 0.0] <= MORE + slack)


def test_bodies_in_a_mesh_do_not_move_with_its_wall():
    for move in (
        lambda: hollow().inflate(MORE),
        lambda: ducts.field_from_mesh(hollow().vertices, hollow().faces, inflate=MORE),
    ):
        with pytest.raises(GeometryError, match=r"bodies, sheets .* near \(-2\."):
            move()


def test_what_is_drawn_in_is_moved_with_its_duct():
    duct = boxes()
    wide, thin = duct.inflate(MORE), Eroded(duct, 0.3).inflate(MORE)
    points = scatter(duct)
    assert thin.signed_distance(points) == pytest.approx(wide.signed_distance(points) + 0.3)


def test_obstacles_stay_where_they_are():
    stone = Circles([(4.0, 1.5)], [0.8])
    wide = without(Polygon(SIDES), stone).inflate(MORE)
    points = scatter(wide)
    away, slack = measure_outside(Polygon(SIDES), points)
    room = wide.clearance_bound(points) > 0.0
    assert np.all(away[room] <= MORE + slack)
    assert np.all(stone.signed_distance(points[room]) > 0.0)


def sphere():
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    return PointCloud(mesh.vertices, 1.0, seeds=[(0, 0, 0)])


@pytest.mark.parametrize(
    "make",
    [
        sphere,
        lambda: sphere().sample(0.8),
        lambda: union(sphere()),
        lambda: Moved(sphere(), shift=[1.0, 0.0, 0.0]),
        lambda: sphere().erode(1.0),
    ],
)
def test_a_cloud_of_points_does_not_know_what_is_beyond_its_wall(make):
    duct = make()
    with pytest.raises(InputError, match=r"distance is 0\.5 mm: it must be 0 mm, because"):
        duct.inflate(0.5)
    assert duct.inflate(0.0).inflation == 0.0
    # Beyond the samples no room is promised, however it is asked.
    beyond = np.random.default_rng(1).normal(size=(2000, 3))
    beyond *= np.linspace(10.5, 14.0, 2000)[:, None] / np.linalg.norm(beyond, axis=1)[:, None]
    assert np.all(duct.clearance_bound(beyond + duct.bounds.mean(axis=0)) <= 0.0)


@pytest.mark.parametrize("inflation", [0.0, 1.0])
def test_a_part_of_a_mesh_that_is_inside_out_is_named(inflation):
    tube = trimesh.creation.capsule(height=20, radius=6, count=[16, 16])
    ball = trimesh.creation.icosphere(radius=2)
    ball.apply_translation([50, 0, 0])
    ball.invert()
    mesh = trimesh.util.concatenate([tube, ball])
    with pytest.raises(
        GeometryError, match=r"turned inside out near \((4[89]|5[0-2])\..*of a part"
    ):
        TriangleMesh(mesh.vertices, mesh.faces, inflation=inflation)
    if inflation > 0.0:
        with pytest.raises(GeometryError, match="turned inside out near"):
            ducts.field_from_mesh(mesh.vertices, mesh.faces, voxel=1.0, inflate=inflation)
    else:  # then it is only a wall where none is needed
        field = ducts.field_from_mesh(mesh.vertices, mesh.faces, voxel=1.0)
        assert field.signed_distance([50.0, 0.0, 0.0]) > 0.0
        with pytest.raises(InputError, match="it must be 0 mm, because"):
            field.inflate(0.5)


def test_a_fold_that_is_inside_out_only_matters_if_the_wall_is_moved():
    # A corner of a box pushed through the box: it comes out beyond, inside out.
    box = trimesh.creation.box(extents=(4, 4, 4))
    vertices = np.array(box.vertices)
    vertices[0] *= -3.0
    duct = TriangleMesh(vertices, box.faces)
    with pytest.raises(GeometryError, match="turned inside out near"):
        duct.inflate(0.5)
