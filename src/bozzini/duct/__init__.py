"""Ducts: what a body tract is to a planner (thesis 5.3)."""

from __future__ import annotations

from .build import build_field, field_from_mask, field_from_mesh
from .centreline import Centreline, find_centreline
from .cones import RoundCones
from .field import SampledField
from .polygon import Polygon
from .protocol import Duct

__all__ = [
    "Centreline",
    "Duct",
    "Polygon",
    "RoundCones",
    "SampledField",
    "build_field",
    "field_from_mask",
    "field_from_mesh",
    "find_centreline",
]
