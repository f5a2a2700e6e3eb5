"""The models by name: this package's, and those that other packages add by entry points."""

from __future__ import annotations

from ..registry import Registry, collect_named
from . import arc, energy, linkage, rod
from .model import ContinuumModel

MODULES = (arc, linkage, energy, rod)
"""Where the models of this package are; a new module is named here."""

CONTINUUM_MODELS: Registry[ContinuumModel] = Registry(
    "bozzini.continuum",
    lambda: ContinuumModel,
    lambda: collect_named(MODULES, ContinuumModel),  # type: ignore[type-abstract]
)
"""Classes of models by name; each is built from a robot, with options of its own."""
