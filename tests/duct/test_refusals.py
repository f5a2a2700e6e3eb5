"""Refusals of every function of the duct package: one clear line with the field and the range."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh

from bozzini.duct import (
    BetweenCurves,
    Centreline,
    Circles,
    ConnectedCylinders,
    ConvexPolyhedra,
    Duct,
    Eroded,
    Moved,
    PlanarField,
    PointCloud,
    Polygon,
    RoundCones,
    SampledField,
    StitchedQuads,
    SuperEllipses,
    SuperEllipsoids,
    TriangleMesh,
    field_from_mask,
    field_from_mesh,
    union,
    without,
)
from bozzini.duct.centreline import follow_chain
from bozzini.duct.fitting.measure import cut_sections
from bozzini.duct.fitting.points import fit_circle, fit_super_ellipse, fit_super_ellipsoid
from bozzini.errors import GeometryError, InputError
from tests.shapes import bend_curve
from validation.thesis import ducts as forms
from validation.thesis import solids
from validation.thesis import traverse_curvature as curvature

HUGE = 1e300
CUBE = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
GRID = np.array([(x, y, z) for x in (0, 1, 2) for y in (0, 1, 2) for z in (0, 1, 2)]) * 0.5
PLANES = np.column_stack([np.concatenate([np.eye(3), -np.eye(3)]), np.full(6, -1.0)])
ELL = Polygon([(0, 0), (100, 0), (100, 10), (10, 10), (10, 100), (0, 100)])
TUBE = RoundCones([(0, 0, 0), (0, 0, 40)], [5.0, 5.0])
STRIP = StitchedQuads([(0, 2.5), (40, 2.5)], [(0, -2.5), (40, -2.5)])
BEND = bend_curve(40.0, 0.5 * np.pi, 20.0, spacing=5.0)
CHAIN = RoundCones(BEND, np.full(len(BEND), 8.0))
LINE = Centreline.from_points([(0, 0, 0), (0, 0, 40)], TUBE)
EYE = np.eye(3)
CENTRES = [(0, 0, 0), (0, 0, 4), (0, 0, 8)]
UP = [(0, 0, 1)] * 3
SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
ICO = trimesh.creation.icosphere(subdivisions=1, radius=3.0)
MASK = np.ones((4, 4, 4), dtype=bool)
SPAN = (0.0, 1.0)
MIDDLE = [(0.5, 0.5)]
FLAT = np.c_[np.random.default_rng(0).normal(size=(9, 2)), np.zeros(9)]


class Opaque(Duct):
    """A duct of which only the distance is known."""

    kind, error, wall, inflation = "bound", 0.0, "opaque", 0.0

    @property
    def bounds(self) -> np.ndarray:
        return TUBE.bounds

    def signed_distance(self, points: Any) -> np.ndarray:
        return TUBE.signed_distance(points)

    def clearance_bound(self, points: Any) -> np.ndarray:
        return TUBE.clearance_bound(points)

    def gradient(self, points: Any) -> np.ndarray:
        return TUBE.gradient(points)


def lower(u: Any) -> np.ndarray:
    return np.stack([u, 0.0 * u], axis=1)


def upper(u: Any) -> np.ndarray:
    return np.stack([u, 1.0 + 0.0 * u], axis=1)


def between(first: Any, second: Any, **options: Any) -> object:
    return BetweenCurves(first, second, **options)


def ellipse(half_axes: Any = (5.0, 1.0), **change: Any) -> SuperEllipses:
    given = {"half_axes": [half_axes], "powers": [2.0], "angles": [0.0]}
    return SuperEllipses([(0, 0)], **(given | change))


def ellipsoid(**change: Any) -> object:
    given = {
        "centres": [(0, 0, 0)], "half_axes": [(1, 1, 1)], "e1": [1.0], "e2": [1.0],
        "rotations": [EYE],
    }  # fmt: skip
    return SuperEllipsoids(**(given | change))


def field(**change: Any) -> SampledField:
    given = {
        "values": np.zeros((2, 2, 2), np.float32), "spacing": np.ones(3), "origin": np.zeros(3),
        "rotation": EYE,
    }  # fmt: skip
    return SampledField(**(given | change))


def cloud(points: Any = CUBE, spacing: float = 0.8, **options: Any) -> object:
    return PointCloud(points, spacing, **options)


def box(low: Any, high: Any) -> np.ndarray:
    return np.column_stack([np.concatenate([EYE, -EYE]), np.concatenate([-np.array(high), low])])


def disagreeing() -> object:
    faces = np.array(ICO.faces)
    faces[17] = faces[17][::-1]
    return TriangleMesh(ICO.vertices, faces)


# fmt: off
REFUSALS: list[tuple[Callable[[], object], type[InputError], str, str]] = [
    # Fields
    (lambda: field(values=np.zeros((1, 4, 4), np.float32)),
     InputError, "field values have shape (1, 4, 4)", "(nx, ny, nz), each >= 2"),
    (lambda: field(values=np.full((2, 2, 2), np.nan, np.float32)),
     InputError, "field values are not all finite", ""),
    (lambda: field(values=np.zeros((2, 2, 2), int)),
     InputError, "field values are int64", "an array of float32"),
    (lambda: field(values=[1.0]), InputError, "field values are list", "an array of float32"),
    (lambda: field(spacing=np.array([1.0, 0.0, 1.0])),
     InputError, "field spacing is [1. 0. 1.] mm", "(0, 1e+06] mm"),
    (lambda: field(spacing=np.full(3, np.inf)),
     InputError, "field spacing is [inf inf inf] mm", "(0, 1e+06] mm"),
    (lambda: field(spacing=[1.0, np.nan, 1.0]),
     InputError, "field spacing is [ 1. nan  1.] mm", "(0, 1e+06] mm"),
    (lambda: field(rotation=2.0 * EYE),
     InputError, "field rotation is no rotation", "orthonormal within 1e-09, and is off by 3"),
    (lambda: field(inflation=-1.0), InputError, "inflation is -1 mm", "[0, 1e+06] mm"),
    (lambda: field(reach=-1.0), InputError, "reach is -1 mm", "[0, inf) mm"),
    (lambda: field(origin=np.full(3, np.nan)),
     InputError, "field origin has 1 point(s) that are not finite (NaN or", ""),
    (lambda: field(origin=np.zeros(2)), InputError, "field origin has shape (2,)", "(..., 3)"),
    (lambda: field().signed_distance([0.0, np.nan, 0.0]),
     InputError, "points has 1 point(s) that are not finite (NaN or", ""),
    (lambda: field().signed_distance([0.0, 0.0]), InputError, "points has shape (2,)", "(..., 3)"),
    (lambda: PlanarField(3), InputError, "layer is a int", "a SampledField"),
    (lambda: PlanarField(TUBE.sample(2.0)),
     InputError, "layer has values of shape (10, 10, 30)", "two equal sheets, (nx, ny, 2)"),
    (lambda: PlanarField(field(rotation=EYE[[0, 2, 1]])),
     InputError, "layer is tilted", "its third axis must be across the plane"),
    (lambda: field_from_mask(np.zeros((3, 3, 3)), np.eye(4)),
     GeometryError, "the lumen is empty", "no voxel is set"),
    (lambda: field_from_mask(MASK, np.eye(4), voxel=0.01),
     GeometryError, "voxel 0.01 mm makes a grid of", "the limit is"),
    (lambda: field_from_mask(MASK[:1, :1, :1], np.diag([0.1, 0.1, 0.1, 1.0]), voxel=5.0),
     GeometryError, "no node of the 5 mm grid lies inside the lumen", "use a smaller --voxel"),
    (lambda: field_from_mesh(ICO.vertices, ICO.faces, voxel=1.0).inflate(-1.0),
     InputError, "inflation is -1 mm", "[0, 1e+06] mm"),
    # Round cones, circles and polygons
    (lambda: RoundCones([(0, 0)], [1.0]), InputError, "centres has shape (1, 2)", "at least 1"),
    (lambda: RoundCones(np.empty((0, 3)), []),
     InputError, "centres has shape (0, 3)", "at least 1"),
    (lambda: RoundCones([(0, 0, 0), (0, np.nan, 1)], [1.0, 1.0]),
     InputError, "centres[1] is [0.0, nan, 1.0]", "finite"),
    (lambda: RoundCones([(0, 0, 0), (1, 0, 0)], [1.0]),
     InputError, "radii has 1 value(s)", "one per centre, 2"),
    (lambda: RoundCones([(0, 0, 0), (1, 0, 0)], [1.0, 0.0]),
     InputError, "radii[1] is 0 mm", "[1e-06, 1e+06] mm"),
    (lambda: RoundCones([(0, 0, 0)], ["wide"]),
     InputError, "radii must be an array of numbers of shape (n,)", ""),
    (lambda: RoundCones([(0, 0, HUGE)], [1.0]),
     InputError, "centres[0, 2] is 1e+300 mm", "[-1e+06, 1e+06] mm"),
    (lambda: RoundCones([(0, 0, 0)], [HUGE]),
     InputError, "radii[0] is 1e+300 mm", "[1e-06, 1e+06] mm"),
    (lambda: RoundCones([(0, 0, 0)], [1e-300]),
     InputError, "radii[0] is 1e-300 mm", "[1e-06, 1e+06] mm"),
    (lambda: RoundCones([(0, 0, 0)], [1.0], inflation=HUGE),
     InputError, "inflation is 1e+300 mm", "[0, 1e+06] mm"),
    (lambda: RoundCones(np.zeros((1, 3), complex), [1.0]),
     InputError, "centres must be an array of numbers of shape (n, 3)", ""),
    (lambda: RoundCones(EYE * 10.0, [4.0, 1.5, 3.0]).erode(1.5),
     InputError, "clearance is 1.5 mm", "below the radius of every ball, and ball 1"),
    (lambda: RoundCones([(0, 0, 0), (1000, 1000, 1000)], [5.0, 5.0]).sample(0.5),
     InputError, "voxel is 0.5 mm", "at least about 1.4 mm"),
    (lambda: Circles([(0, HUGE)], [1.0]),
     InputError, "centres[0, 1] is 1e+300 mm", "[-1e+06, 1e+06] mm"),
    (lambda: Circles([(0.0, 0.0), (5.0, 0.0)], [1.0, 0.0]),
     InputError, "radii[1] is 0 mm", "[1e-06, 1e+06] mm"),
    (lambda: Circles([(0.0, 0.0), (5.0, 0.0)], [1.0]),
     InputError, "radii has 1 value(s)", "one per centre, 2"),
    (lambda: Polygon([(0, 0), (10, 10), (10, 0), (0, 10)]),
     GeometryError, "edges 0 and 2 of the polygon cross or touch", "simple"),
    (lambda: Polygon([(0, 0), (10, 0), (10, 5), (5, 0), (0, 5)]),
     GeometryError, "edges 0 and 2 of the polygon cross or touch", "simple"),
    (lambda: Polygon([(0, 0), (10, 0), (5, 0), (5, 5)]),
     GeometryError, "edges 0 and 1 of the polygon fold back on each other", ""),
    (lambda: Polygon([(0, 0), (10, 0), (10, 0), (0, 10)]),
     GeometryError, "edge 1 of the polygon has no length", "(10, 0) mm"),
    (lambda: Polygon([(0, 0), (10, 0), (20, 0)]),
     GeometryError, "edges 1 and 2 of the polygon fold back on each other", ""),
    (lambda: Polygon([(0, 0), (1, 0)]), InputError, "vertices has shape (2, 2)", "at least 3"),
    (lambda: Polygon([(0, 0, 0)] * 4), InputError, "vertices has shape (4, 3)", "at least 3"),
    (lambda: Polygon([(0, 0), (np.inf, 0), (0, 1)]),
     InputError, "vertices[1] is [inf, 0.0]", "finite"),
    (lambda: Polygon([(0, 0), (HUGE, 0), (0, 1)]),
     InputError, "vertices[1, 0] is 1e+300 mm", "[-1e+06, 1e+06] mm"),
    # Quads and curves
    (lambda: STRIP.locate(5, 0.5, across=0.5), InputError, "quad is 5", "[0, 0]"),
    (lambda: STRIP.locate(-1, 0.5, across=0.5), InputError, "quad is -1", "[0, 0]"),
    (lambda: STRIP.locate(0.5, 0.5, across=0.5), InputError, "quad is 0.5", "[0, 0]"),
    (lambda: STRIP.locate(0, np.nan, across=0.5),
     InputError, "along is nan", "it must be finite"),
    (lambda: StitchedQuads([(0, 1), (4, 1), (8, -1)], [(0, -1), (4, -1), (8, 1)]),
     GeometryError, "quad 1 crosses itself", "its sides must not meet"),
    (lambda: StitchedQuads([(0, 1), (4, 1), (8, 1)], [(0, -1), (4, -1), (4.5, 0.8)]),
     GeometryError, "quad 1 is not convex at corner right[2] (4.5, 0.8) mm",
     "all its corners must turn the same way"),
    (lambda: StitchedQuads([(0, 1), (4, 1), (2, 1)], [(0, -1), (4, -1), (2, -1)]),
     GeometryError, "quad 1 is turned over", "left and right change sides at rung 1"),
    (lambda: StitchedQuads([(0, 1), (0, 1)], [(0, -1), (4, -1)]),
     GeometryError, "quad 0 is not convex at corner left[0] (0, 1) mm",
     "all its corners must turn the same way"),
    (lambda: StitchedQuads([(0, 1), (4, 1)], [(0, -1)]),
     InputError, "right has shape (1, 2)", "at least 2"),
    (lambda: StitchedQuads([(0, 1), (4, 1)], [(0, -1), (2, -1), (4, -1)]),
     InputError, "right has 3 point(s)", "as many as left, 2"),
    (lambda: StitchedQuads([(0, 0), (2e6, 0)], [(0, 1), (1, 1)]),
     InputError, "left[1, 0] is 2e+06 mm", "[-1e+06, 1e+06] mm"),
    (lambda: between(lower, upper), InputError, "span is missing", "the first and last parameter"),
    (lambda: between(lower, upper, span=(1.0, 1.0)), InputError, "span[1] is 1", "(1, inf)"),
    (lambda: between(lower, upper, span=SPAN, tolerance=0.0),
     InputError, "tolerance is 0 mm", "(0, inf) mm"),
    (lambda: between(lower, lambda u: np.stack([u, 1 + u**2], axis=1), span=SPAN, tolerance=1e-12),
     InputError, "tolerance is 1e-12 mm", "the curves would need"),
    (lambda: between(lower, [(0, 0), (1, 1)], span=SPAN),
     InputError, "first and second must both be functions, or both samples", ""),
    (lambda: between(lower, lambda u: u, span=SPAN),
     InputError, "second(u) has shape (17,)", "(..., 2)"),
    (lambda: between(lower, lambda u: lower(u) / 0.0, span=SPAN),
     InputError, "second(u) has 17 point(s) that are not finite (NaN or", ""),
    (lambda: between(lower, lower, span=(1.0, 4.0)),
     GeometryError, "the curves meet at u = 1, at (1, 0) mm", "stay apart"),
    (lambda: between([(0, 0), (1, 0), (2, 0)], [(0, 1), (1, 1)]),
     InputError, "second has 2 point(s)", "as many as first, 3"),
    (lambda: between([(0, 0), (1, 0), (2, 0)], [(0, 1), (3, 1), (2, 1)], span=(0.0, 20.0)),
     GeometryError, "rulings cross between u = 10 and 20",
     "the curves meet there, turn back, or are"),
    (lambda: between([(0, 0), (1, 0)], [(0, 0), (1, 1)]),
     GeometryError, "the curves meet at u = 0, at (0, 0) mm", "stay apart"),
    (lambda: between([(0, 0), (2e6, 0)], [(0, 1), (1, 1)]),
     InputError, "first[1, 0] is 2e+06 mm", "[-1e+06, 1e+06] mm"),
    # Super-ellipses and super-ellipsoids
    (lambda: ellipse((1.0, 0.0)), InputError, "half axes[0] is [1.0, 0.0] mm", "[1e-06, 1e+06] mm"),
    (lambda: ellipse((1e-9, 1.0)),
     InputError, "half axes[0] is [1e-09, 1.0] mm", "[1e-06, 1e+06] mm"),
    (lambda: ellipse(powers=[2.0, 2.0]), InputError, "powers has 2 value(s)", "one per centre, 1"),
    (lambda: ellipse(powers=[0.7]), InputError, "powers[0] is 0.7", "[1, 20]"),
    (lambda: ellipse(powers=[30.0]), InputError, "powers[0] is 30", "[1, 20]"),
    (lambda: ellipse(angles=[np.nan]), InputError, "angles[0] is nan", "finite"),
    (lambda: ellipse(inflation=-1.0), InputError, "inflation is -1 mm", "[0, 1e+06] mm"),
    (lambda: ellipse().outline(5), InputError, "shape is 5", "[0, 0]"),
    (lambda: ellipse().outline(0, count=0), InputError, "count is 0", "[1, inf]"),
    (lambda: ellipse().measure_seam(0, 3), InputError, "second is 3", "[0, 0]"),
    (lambda: ellipsoid(half_axes=[(2, 0, 2)]),
     InputError, "half axes[0] is [2.0, 0.0, 2.0] mm", "[1e-06, 1e+06] mm"),
    (lambda: ellipsoid(half_axes=[(1, 2e6, 1)]),
     InputError, "half axes[0] is [1.0, 2000000.0, 1.0] mm", "[1e-06, 1e+06] mm"),
    (lambda: ellipsoid(e1=[2.5]), InputError, "e1[0] is 2.5", "[0.1, 2]"),
    (lambda: ellipsoid(e2=[0.05]), InputError, "e2[0] is 0.05", "[0.1, 2]"),
    (lambda: ellipsoid(e1=[1.0, 1.0]), InputError, "e1 has 2 value(s)", "one per centre, 1"),
    (lambda: ellipsoid(rotations=[2.0 * EYE]),
     InputError, "rotations[0] is no rotation", "orthonormal within 1e-09, and is off by 3"),
    (lambda: ellipsoid(rotations=[np.diag([1, 1, -1])]),
     InputError, "rotations[0] is a reflection, its determinant is -1", "a rotation's must be 1"),
    (lambda: ellipsoid(centres=[(np.inf, 0, 0)]),
     InputError, "centres[0] is [inf, 0.0, 0.0]", "finite"),
    (lambda: ellipsoid(centres=[(0, 0, -HUGE)]),
     InputError, "centres[0, 2] is -1e+300 mm", "[-1e+06, 1e+06] mm"),
    (lambda: ellipsoid(inflation=-1.0), InputError, "inflation is -1 mm", "[0, 1e+06] mm"),
    # Cylinders
    (lambda: ConnectedCylinders([(0, 0, 0)], [(0, 0, 1)], [1.0]),
     InputError, "centres has shape (1, 3)", "at least 2"),
    (lambda: ConnectedCylinders(CENTRES, UP, [1, 0, 1]),
     InputError, "radii[1] is 0 mm", "[1e-06, 1e+06] mm"),
    (lambda: ConnectedCylinders(CENTRES[:2], [(0, 0, 1), (0, 0, 0)], [1, 1]),
     InputError, "normals[1] is zero", "a length"),
    (lambda: ConnectedCylinders(CENTRES[:2], UP, [1, 1]),
     InputError, "normals has 3 value(s)", "one per centre, 2"),
    (lambda: ConnectedCylinders([(0, 0, 0), (0, 0, 0)], UP[:2], [1, 1]),
     GeometryError, "circles 0 and 1 have the same centre", "there is no axis"),
    (lambda: ConnectedCylinders([(0, 0, 0), (0, 0, 4), (0, 0, 1)], UP, [1, 1, 1]),
     GeometryError, "circle 1 does not lie across the duct",
     "its normal is 0 deg and 180 deg off the directions"),
    (lambda: ConnectedCylinders([(0, 0, 0), (2, 0, 1)], [(0, 0, 1), (1, 0, 0.2)], [3.0, 3.0]),
     GeometryError, "circles 0 and 1 overlap", "the spacing 2.24 mm is too short for a bend"),
    # Meshes, clouds and polyhedra
    (lambda: disagreeing(), GeometryError, "triangles 14 and 17", "(-2.2, 0.8, -1.6) mm"),
    (lambda: TriangleMesh([(0, 0, 0)] * 3, [(0, 1, 2)]),
     InputError, "vertices has shape (3, 3)", "at least 4"),
    (lambda: TriangleMesh(SQUARE, [(0, 1, 4)]),
     InputError, "faces point at vertices [0, 4]", "[0, 3]"),
    (lambda: TriangleMesh(SQUARE, [(0, 1, -1)]),
     InputError, "faces point at vertices [-1, 1]", "[0, 3]"),
    (lambda: TriangleMesh(SQUARE, [(0.0, 1.0, 2.0)]),
     InputError, "faces are float64 of shape (1, 3)", "integers (m, 3)"),
    (lambda: TriangleMesh(SQUARE, np.empty((0, 3), int)),
     InputError, "faces point at vertices none at all", "[0, 3]"),
    (lambda: TriangleMesh(SQUARE, [(0, 1, 1)]),
     GeometryError, "triangle 0 has two equal corners", ""),
    (lambda: TriangleMesh(SQUARE, [(0, 1, 2), (0, 2, 1)]),
     GeometryError, "the mesh encloses no volume", "0 mm^3"),
    (lambda: TriangleMesh(CUBE * HUGE, [(0, 1, 2)]),
     InputError, "vertices[1, 2] is 1e+300 mm", "[-1e+06, 1e+06] mm"),
    (lambda: cloud(), InputError, "neither of seeds and normals are given", "one of them"),
    (lambda: cloud(seeds=[(0, 0, 0)], normals=CUBE),
     InputError, "both of seeds and normals are given", "one of them"),
    (lambda: cloud(spacing=0.0, seeds=[(0, 0, 0)]),
     InputError, "spacing is 0 mm", "[1e-06, 1e+06] mm"),
    (lambda: cloud(spacing=HUGE, seeds=[(0, 0, 0)]),
     InputError, "spacing is 1e+300 mm", "[1e-06, 1e+06] mm"),
    (lambda: cloud(normals=CUBE[:3]), InputError, "normals has 3 value(s)", "one per point, 8"),
    (lambda: cloud(CUBE[:3], seeds=[(0, 0, 0)]),
     InputError, "points has shape (3, 3)", "at least 4"),
    (lambda: cloud(seeds=[(HUGE, 0, 0)]),
     InputError, "seeds[0, 0] is 1e+300 mm", "[-1e+06, 1e+06] mm"),
    (lambda: cloud(seeds=[(0.5, 0.1, 0.5)]),
     GeometryError, "seeds[0] at (0.5, 0.1, 0.5) mm is 0.714 mm from a sample",
     "farther than the spacing, 0.8 mm"),
    (lambda: cloud(seeds=[(5, 5, 5)]),
     GeometryError, "seeds[0] at (5.0, 5.0, 5.0) mm lies outside the cloud", ""),
    (lambda: cloud([(x, y, 0) for x in range(4) for y in range(4)], seeds=[(0, 0, 3)]),
     GeometryError, "the 16 points of the cloud lie in a plane", "they enclose nothing"),
    (lambda: cloud(spacing=0.1, normals=CUBE),
     GeometryError, "the cloud encloses nothing with a spacing of 0.1 mm",
     "its balls leave an opening or fill the lumen"),
    (lambda: ConvexPolyhedra([]),
     InputError, "pieces is empty", "there must be at least one polyhedron"),
    (lambda: ConvexPolyhedra(None),
     InputError, "pieces is a NoneType", "a sequence of arrays (m, 4)"),
    (lambda: ConvexPolyhedra("abc"), InputError, "pieces is a str", "a sequence of arrays (m, 4)"),
    (lambda: ConvexPolyhedra(box((0, 0, 0), (1, 1, 1))),
     InputError, "pieces is one array of 6 rows", "a sequence of arrays"),
    (lambda: ConvexPolyhedra([np.zeros((4, 3))]),
     InputError, "pieces[0] has shape (4, 3)", "at least 4"),
    (lambda: ConvexPolyhedra([np.r_[box((0, 0, 0), (1, 1, 1)), [[0, 0, 0, 1]]]]),
     InputError, "normal of pieces[0][6] is zero", "a length"),
    (lambda: ConvexPolyhedra([PLANES * [1, 1, 1, HUGE]]),
     InputError, "pieces[0][0] is a plane 1e+300 mm from the origin", "at most 2e+06 mm"),
    (lambda: ConvexPolyhedra([PLANES * [1e-305, 1, 1, 1]]),
     InputError, "pieces[0][0] is a plane 1e+305 mm from the origin", "at most 2e+06 mm"),
    (lambda: ConvexPolyhedra([PLANES * [1, 1, 1, 1.5e6]]),
     GeometryError, "piece 0 reaches to 1.5e+06 mm", "stay within 1e+06 mm of the origin along"),
    (lambda: ConvexPolyhedra([box((0, 0, 0), (1, 1, 1))[:5]]),
     GeometryError, "piece 0 has no end", "its 5 planes do not close it"),
    (lambda: ConvexPolyhedra([box((0, 0, 0), (1, 1, 1))[[0, 1, 3, 4]]]),
     GeometryError, "piece 0 has no end", "its 4 planes do not close it"),
    (lambda: ConvexPolyhedra([box((1, 0, 0), (0, 1, 1))]),
     GeometryError, "piece 0 is empty or flat", "the largest ball inside has a radius"),
    (lambda: ConvexPolyhedra([box((0, 0, 0), (1, 1, 0))]),
     GeometryError, "piece 0 is empty or flat", "the largest ball inside has a radius"),
    (lambda: ConvexPolyhedra([box((0, 0, 0), (1, 1, 1)), box((1, 0, 0), (2, 1, 1))]),
     GeometryError, "the union is not connected", "piece 0 and piece 1 come nearest, and do"),
    (lambda: ConvexPolyhedra.from_points([FLAT]),
     GeometryError, "groups[0] has no hull", "its 9 points lie in a plane"),
    # Compositions
    (lambda: union(), InputError, "a union has 0 parts", "at least 1"),
    (lambda: union(3), InputError, "part 0 is a int", "a duct"),
    (lambda: union(STRIP, TUBE), InputError, "part 1 has 3 dimensions", "2, as part 0 has"),
    (lambda: union(TUBE, voxel=0.0), InputError, "voxel is 0 mm", "(0, inf) mm"),
    (lambda: union(Opaque()).inflate(1.0),
     InputError, "the wall of a Opaque cannot be moved outwards", ""),
    (lambda: without(STRIP), InputError, "a duct has 0 obstacles", "at least 1"),
    (lambda: without(STRIP, TUBE),
     InputError, "duct and obstacle 1 has 3 dimensions", "2, as duct and obstacle 0 has"),
    (lambda: without(TUBE, TUBE.sample(1.0)),
     InputError, "obstacle 0 is sampled", "an exact distance or a lower bound of it;"),
    (lambda: without(TUBE, TUBE.inflate(1.0)),
     InputError, "obstacle 0 has its wall moved outwards by 1 mm",
     "0 mm; make the obstacle larger instead"),
    (lambda: Eroded(STRIP, -1.0), InputError, "clearance is -1 mm", "[0, inf) mm"),
    (lambda: Eroded(STRIP, 9.0), InputError, "clearance is 9 mm", "[0, 2.5) mm"),
    (lambda: Eroded(3, 1.0), InputError, "duct is a int", "a duct"),
    (lambda: Eroded("x", 1.0), InputError, "duct is a str", "a duct"),
    (lambda: Moved("x"), InputError, "duct is a str", "a duct"),
    (lambda: Moved(STRIP, rotation=EYE), InputError, "rotation has shape (3, 3)", "(2, 2)"),
    (lambda: Moved(STRIP, rotation=[[1, 0], [0, -1]]),
     InputError, "rotation is a reflection, its determinant is -1", "a rotation's must be 1"),
    (lambda: Moved(STRIP, rotation=[[1, np.nan], [0, 1]]),
     InputError, "rotation is no rotation", "orthonormal within 1e-09, and is off by nan"),
    (lambda: Moved(STRIP, shift=[1.0, 2.0, 3.0]), InputError, "shift has shape (3,)", "(..., 2)"),
    (lambda: Moved(TUBE, rotation=np.diag([1, 1, -1])),
     InputError, "rotation is a reflection, its determinant is -1", "a rotation's must be 1"),
    (lambda: Moved(TUBE, rotation=EYE * HUGE),
     InputError, "rotation is no rotation", "orthonormal within 1e-09, and is off by inf"),
    (lambda: TUBE.sample(1e-3), InputError, "voxel is 0.001 mm", "at least about 0.023 mm"),
    (lambda: TUBE.sample(1e-300), InputError, "voxel is 1e-300 mm", "at least about 0.023 mm"),
    (lambda: STRIP.sample(0.0), InputError, "voxel is 0 mm", "(0, inf) mm"),
    (lambda: TUBE.sample(0.5).inflate("a"),
     InputError, "distance is 'a'", "a number in (-inf, inf) mm"),
    (lambda: ELL.sample(2.0).inflate("a"),
     InputError, "distance is 'a'", "a number in (-inf, inf) mm"),
    # Centrelines and sections
    (lambda: Centreline.from_points([(0, 0, 0), (30, 40, 0)], TUBE),
     GeometryError, "the path leaves the duct at (30, 40, 0) mm, by 45.00 mm", ""),
    (lambda: Centreline.from_points([(0, 0, 0)], TUBE),
     InputError, "points has shape (1, 3)", "at least 2"),
    (lambda: Centreline.from_points([(0, 0), (1, 0)], TUBE),
     InputError, "points has shape (2, 2)", "(..., 3)"),
    (lambda: Centreline.from_points([(0, 0, 0), (0, 0, 1), (0, 0, 1)], TUBE),
     InputError, "points 1 and 2 are the same", "the path stands still"),
    (lambda: follow_chain(RoundCones(np.zeros((1, 3)), np.ones(1))),
     GeometryError, "the chain is one ball", "there is no path along it"),
    (lambda: follow_chain(CHAIN, (BEND[0] + [0.0, 0.0, 50.0], None)),
     GeometryError, "start (0, 0, 30) mm lies outside the shapes by 2.1 mm",
     "give a point inside them, or leave it out"),
    (lambda: follow_chain(CHAIN, (BEND[5], BEND[5])),
     GeometryError, "start and end are at the same place of the chain", "no path between them"),
    (lambda: follow_chain(CHAIN, (None, [HUGE, 0.0, 0.0])),
     InputError, "end[0] is 1e+300 mm", "[-1e+06, 1e+06] mm"),
    (lambda: follow_chain(CHAIN, (BEND[:2], None)), InputError, "start has shape (2, 3)", "(3,)"),
    (lambda: cut_sections(TUBE, LINE, stations=[1.0, 50.0]),
     InputError, "stations[1] is 50 mm", "[0, 40] mm"),
    (lambda: cut_sections(TUBE, LINE, stations=[3.0, 1.0]),
     InputError, "stations have shape (2,)", "(n,) ascending arc lengths"),
    (lambda: cut_sections(TUBE, LINE, spacing=-1.0), InputError, "spacing is -1 mm", "(0, inf) mm"),
    (lambda: cut_sections(TUBE, LINE, rays=3), InputError, "rays is 3", "[8, 10000]"),
    (lambda: cut_sections(RoundCones([[0, 0, -20.0]], [5.0]), LINE),
     GeometryError, "the centreline leaves the duct at (0.0, 0.0, 40.0) mm, by", ""),
    (lambda: cut_sections(ELL, LINE),
     InputError, "the duct has 2 dimensions", "sections are cut of one that has 3"),
    # Fits of points
    (lambda: fit_circle([[0, 0], [1, 1]]), InputError, "points has shape (2, 2)", "at least 3"),
    (lambda: fit_circle([[0, 0], [1, 1], [2, 2], [5, 5]]),
     GeometryError, "the points lie on a line", "no circle goes through them"),
    (lambda: fit_circle(np.zeros((5, 2))),
     GeometryError, "the points are all at one place", "no circle goes through them"),
    (lambda: fit_circle(np.full((5, 2), 7.3)),
     GeometryError, "the points are all at one place", "no circle goes through them"),
    (lambda: fit_circle(HUGE * np.eye(5, 2)),
     InputError, "points[0, 0] is 1e+300 mm", "[-1e+06, 1e+06] mm"),
    (lambda: fit_super_ellipse(np.zeros((9, 2))),
     GeometryError, "the points lie on a line", "no super-ellipse goes through them"),
    (lambda: fit_super_ellipse(HUGE * np.eye(9, 2)),
     InputError, "points[0, 0] is 1e+300 mm", "[-1e+06, 1e+06] mm"),
    (lambda: fit_super_ellipsoid(np.zeros((30, 3))),
     GeometryError, "the points lie in a plane", "no super-ellipsoid goes through them"),
    (lambda: fit_super_ellipsoid(HUGE * np.eye(30, 3)),
     InputError, "points[0, 0] is 1e+300 mm", "[-1e+06, 1e+06] mm"),
    (lambda: fit_super_ellipsoid(GRID, frame=np.diag([1.0, 1.0, -1.0])),
     InputError, "frame has determinant -1", "right-handed, 1"),
    # The printed forms
    (lambda: forms.circle_5_14(MIDDLE, (0, 0), -1.0),
     InputError, "radius is -1 mm", "[1e-06, 1e+06] mm"),
    (lambda: forms.circle_5_14(MIDDLE, (0, 0), np.nan),
     InputError, "radius is nan mm", "[1e-06, 1e+06] mm"),
    (lambda: forms.circle_5_14(MIDDLE, np.zeros((3, 2)), 1.0),
     InputError, "centre has shape (3, 2)", "one point, (2,)"),
    (lambda: forms.super_ellipse_5_16(MIDDLE, (0, 0), (0, 1), 2.0),
     InputError, "half axes[0] is [0.0, 1.0] mm", "[1e-06, 1e+06] mm"),
    (lambda: forms.super_ellipse_5_16(MIDDLE, (0, 0), (-1, 1), 2.0),
     InputError, "half axes[0] is [-1.0, 1.0] mm", "[1e-06, 1e+06] mm"),
    (lambda: forms.super_ellipse_5_16((0.0, 0.0), (0.0, 0.0), (1.0, 1.0), 0.0),
     InputError, "power is 0", "(0, inf)"),
    (lambda: forms.frame_5_17(np.nan, (0, 0)), InputError, "angle is nan rad", "(-inf, inf) rad"),
    (lambda: forms.to_shape(MIDDLE, np.zeros((4, 4))),
     InputError, "rotation of the frame is no rotation",
     "orthonormal within 1e-09, and is off by 1"),
    (lambda: forms.to_shape(MIDDLE, EYE), InputError, "frame has shape (3, 3)", "(4, 4)"),
    (lambda: forms.half_planes_5_20(MIDDLE, [(0, 0)] * 2, [(0, 0)] * 2),
     GeometryError, "quad 0 has a side without length", ""),
    (lambda: forms.half_planes_5_20(MIDDLE, [(0, 0), (1, 0)], [(2, 0), (4, 0)]),
     GeometryError, "quad 0 has no area beside a side", ""),
    (lambda: forms.minimum_5_18([]), InputError, "values have shape (0,)", "(..., m)"),
    (lambda: forms.solve_6_1(MIDDLE, [(0, 0), (1, 0)], [(0, 1), (1, 1)]),
     InputError, "point has shape (1, 2)", "one point, (2,)"),
    (lambda: forms.quads_5_25((0.0, 0.0), [(0.0, 0.0)], [(1.0, 0.0)]),
     InputError, "left has shape (1, 2) and right (1, 2)", "at least 2"),
    (lambda: solids.super_ellipsoid_form([(0, 0, 0)], (1, 1, 1), e=0.0, n=1.0),
     InputError, "e is 0", "(0, inf)"),
    (lambda: solids.super_ellipsoid_form([(0, 0, 0)], (1, 0, 1), e=1.0, n=1.0),
     InputError, "half axes are [1.0, 0.0, 1.0] mm", "(0, inf) mm"),
    (lambda: solids.PrintedCircle((0, 0, 0), 0.0, 0.0, 0.0),
     InputError, "radius is 0 mm", "(0, inf) mm"),
    (lambda: solids.half_space_form([(0, 0, 0)], EYE),
     InputError, "triangles has shape (3, 3)", "(m, 3, 3)"),
    (lambda: curvature.relative_curvature(0.1, 0.0),
     InputError, "radius is 0 mm", "[1e-06, 1e+06] mm"),
    (lambda: curvature.relative_curvature([np.nan], 1.0),
     InputError, "curvatures are not all finite", ""),
    (lambda: curvature.measure_curve([1, 0], [0, 1], side="up"),
     InputError, "side is 'up'", "'left' or 'right'"),
    (lambda: curvature.measure_curve([0, 0], [0, 1]),
     InputError, "first derivative of the curve is 0 somewhere", "not stand still"),
    (lambda: curvature.is_traversable([], 1.0),
     InputError, "curvatures is empty", "there must be at least one number"),
    (lambda: curvature.find_rolling_radius([]),
     InputError, "curvatures is empty", "there must be at least one number"),
    (lambda: curvature.measure_curve(np.ones((3, 2)), np.ones((4, 2))),
     InputError, "these shapes do not go together", "(3, 2)"),
    (lambda: curvature.printed_curve(np.ones(3), np.ones(2), 1.0),
     InputError, "these shapes do not go together", "first (3,), second (2,)"),
    (lambda: curvature.measure_surface(
        np.ones((3, 3)), np.ones((2, 3)), EYE[2], EYE[2], EYE[2], toward=EYE[2]),
     InputError, "these shapes do not go together", "first_v (2, 3)"),
    (lambda: curvature.measure_surface(EYE[0], 2 * EYE[0], EYE[2], EYE[2], EYE[2], toward=EYE[2]),
     InputError, "first derivatives of the surface are parallel somewhere", ""),
    (lambda: curvature.measure_surface(EYE[0], EYE[1], EYE[2], EYE[2], EYE[2], toward=EYE[0]),
     InputError, "toward lies in the surface somewhere", "point to one side"),
    (lambda: curvature.measure_mesh(EYE, [[0, 1, 3]]),
     InputError, "faces name vertices outside [0, 2]", ""),
]
# fmt: on
"""What is asked, the error, the field that the message names, and what it states as legal."""


@pytest.mark.parametrize(("call", "error", "field", "legal"), REFUSALS)
def test_refused(
    call: Callable[[], object], error: type[InputError], field: str, legal: str
) -> None:
    with warnings.catch_warnings(), np.errstate(divide="ignore", invalid="ignore"):
        warnings.simplefilter("error")
        with pytest.raises(error) as caught:
            call()
    line = str(caught.value)
    assert line.startswith(field) and legal in line
    assert "\n" not in line and len(line) < 300
