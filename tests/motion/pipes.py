"""One bent pipe in every representation, as the example has it."""

from __future__ import annotations

import functools
import importlib.util
from pathlib import Path

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "duct_family.py"

PLANAR = (
    "polygon",
    "stitched quads",
    "super-ellipses",
    "between curves",
    "sampled, planar",
    "with obstacles",
)
SOLID = (
    "round cones",
    "cylinders",
    "super-ellipsoids",
    "convex polyhedra",
    "mesh",
    "points of the wall",
    "sampled field",
)
NAMES = PLANAR + SOLID


@functools.cache
def load_example():
    """The example as a module."""
    spec = importlib.util.spec_from_file_location("duct_family", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@functools.cache
def make_pipes():
    """The ducts by name."""
    example = load_example()
    return {**example.make_planar(), **example.make_solid()}
