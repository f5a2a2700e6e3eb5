"""The models by name; a family of models is a module beside."""

from __future__ import annotations

from ..energy import EnergyMuscle
from ..thesis import ThesisMuscle

__all__ = ["MODELS"]

MODELS: dict[str, type[EnergyMuscle] | type[ThesisMuscle]] = {
    "energy": EnergyMuscle,
    "thesis": ThesisMuscle,
}
"""Model classes by name; each is built from a `Muscle`, with options of its own by keyword."""
