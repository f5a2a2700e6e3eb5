"""Ducts: what a body tract is to a planner (thesis 5.3)."""

from __future__ import annotations

from .base import Duct
from .build import build_field, field_from_mask, field_from_mesh
from .centreline import Centreline, find_centreline
from .compose import Eroded, Moved, Union, Without, to_field, union, without
from .field import PlanarField, SampledField
from .refined import RefinedField, refine_field
from .shapes.cones import RoundCones
from .shapes.curves import BetweenCurves
from .shapes.cylinders import ConnectedCylinders
from .shapes.mesh import TriangleMesh
from .shapes.obstacles import Circles
from .shapes.points import PointCloud
from .shapes.polyhedron import ConvexPolyhedra
from .shapes.quads import Polygon, StitchedQuads
from .shapes.super_ellipses import SuperEllipses, SuperEllipsoids

__all__ = [
    "BetweenCurves",
    "Centreline",
    "Circles",
    "ConnectedCylinders",
    "ConvexPolyhedra",
    "Duct",
    "Eroded",
    "Moved",
    "PlanarField",
    "PointCloud",
    "Polygon",
    "RefinedField",
    "RoundCones",
    "SampledField",
    "StitchedQuads",
    "SuperEllipses",
    "SuperEllipsoids",
    "TriangleMesh",
    "Union",
    "Without",
    "build_field",
    "field_from_mask",
    "field_from_mesh",
    "find_centreline",
    "refine_field",
    "to_field",
    "union",
    "without",
]
