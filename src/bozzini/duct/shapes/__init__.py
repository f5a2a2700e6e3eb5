"""The shapes that a duct can have, by name: of this package, and of others that are installed."""

from __future__ import annotations

from ...registry import Registry, collect_named
from ..base import Duct
from . import cones, curves, cylinders, mesh, points, polyhedron, quads, super_ellipses

__all__ = ["DUCT_SHAPES"]

MODULES = (quads, curves, super_ellipses, cones, cylinders, polyhedron, mesh, points)
"""Where the shapes of this package are; a new module is named here."""

DUCT_SHAPES: Registry[Duct] = Registry(
    "bozzini.ducts",
    lambda: Duct,
    lambda: collect_named(MODULES, Duct),  # type: ignore[type-abstract]
    noun="shape",
)
"""All shapes by their names in files."""
