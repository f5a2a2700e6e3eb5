"""Ducts: what a body tract is to a planner (thesis 5.3)."""

from __future__ import annotations

from .build import build_field, field_from_mask, field_from_mesh
from .centreline import Centreline, find_centreline
from .compose import Eroded, Moved, Union, Without, to_field, union, without
from .cones import RoundCones
from .curves import BetweenCurves
from .cylinders import ConnectedCylinders
from .field import SampledField
from .mesh import TriangleMesh
from .obstacles import Circles
from .planar_field import PlanarField
from .points import PointCloud
from .polygon import Polygon
from .polyhedron import ConvexPolyhedra
from .protocol import Duct
from .quads import StitchedQuads
from .refined import RefinedField, refine_field
from .super_ellipse import SuperEllipses
from .super_ellipsoid import SuperEllipsoids

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
