"""Ducts: what a body tract is to a planner (thesis 5.3)."""

from __future__ import annotations

from .base import Duct, DuctShape, Eroded, PackedDuct, PlanarField, SampledField
from .centreline import Centreline, find_centreline
from .compose import Moved, Union, Without, union, without
from .deformation import carry_tissue, trace_back
from .field import RefinedField, build_field, field_from_mask, field_from_mesh, refine_field
from .fitting.fit import FittedDuct, ShapeFitOptions, fit
from .moving import MovedField, MovingField
from .shape_files import load_shapes as load
from .shape_files import save_shapes as save
from .shapes import DUCT_SHAPES
from .shapes.cones import Circles, RoundCones
from .shapes.curves import BetweenCurves
from .shapes.cylinders import ConnectedCylinders
from .shapes.mesh import TriangleMesh
from .shapes.points import PointCloud
from .shapes.polyhedron import ConvexPolyhedra
from .shapes.quads import Polygon, StitchedQuads
from .shapes.super_ellipses import SuperEllipses, SuperEllipsoids
from .tree import Branch, LumenTree, find_tree

__all__ = [
    "DUCT_SHAPES",
    "BetweenCurves",
    "Branch",
    "Centreline",
    "Circles",
    "ConnectedCylinders",
    "ConvexPolyhedra",
    "Duct",
    "Eroded",
    "ShapeFitOptions",
    "FittedDuct",
    "LumenTree",
    "Moved",
    "MovedField",
    "MovingField",
    "PackedDuct",
    "PlanarField",
    "PointCloud",
    "Polygon",
    "RefinedField",
    "RoundCones",
    "SampledField",
    "DuctShape",
    "StitchedQuads",
    "SuperEllipses",
    "SuperEllipsoids",
    "TriangleMesh",
    "Union",
    "Without",
    "build_field",
    "carry_tissue",
    "field_from_mask",
    "field_from_mesh",
    "find_centreline",
    "find_tree",
    "fit",
    "load",
    "refine_field",
    "save",
    "trace_back",
    "union",
    "without",
]


def __dir__() -> list[str]:
    return sorted(__all__)
