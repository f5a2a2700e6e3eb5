"""The models by name."""

from __future__ import annotations

from .arc import ArcModel
from .energy import EnergyModel
from .linkage import LinkageModel
from .rod import RodModel

__all__ = ["MODELS"]

MODELS: dict[str, type[ArcModel | LinkageModel | EnergyModel | RodModel]] = {
    "arc": ArcModel,
    "linkage": LinkageModel,
    "energy": EnergyModel,
    "rod": RodModel,
}
"""Model classes by name; each is built from a `ContinuumRobot`, with options of its own."""
