"""Muscles: from a pneumatic muscle's dimensions to its force and contraction (thesis ch. 2-3)."""

from __future__ import annotations

from .braid import LOCKING_ANGLE, Braid
from .design import Muscle
from .energy import EnergyMuscle
from .hysteresis import Hysteresis
from .model import MuscleModel, MuscleState
from .models import MODELS
from .presets import PRESETS, preset
from .thesis import ThesisMuscle
from .tube import Tube

__all__ = [
    "LOCKING_ANGLE",
    "MODELS",
    "PRESETS",
    "Braid",
    "EnergyMuscle",
    "Hysteresis",
    "Muscle",
    "MuscleModel",
    "MuscleState",
    "ThesisMuscle",
    "Tube",
    "preset",
]
