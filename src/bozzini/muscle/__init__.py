"""Muscles: from a pneumatic muscle's dimensions to its force and contraction (thesis ch. 2-3)."""

from __future__ import annotations

from .braid import LOCKING_ANGLE, Braid
from .calibration import Calibration, calibrate
from .compare import Comparison, ModelScore, compare_models
from .dataset import Measurements, RepeatStatistics, read_measurements, write_measurements
from .design import Muscle
from .energy import EnergyMuscle
from .hysteresis import Hysteresis
from .model import ConvergenceError, HistoryModel, MuscleModel, MuscleState, StaticModel
from .models import CATALOGUE, MODELS
from .presets import PRESETS, preset
from .rank import RankedModel, Ranking, rank_models
from .thesis import ThesisMuscle
from .tube import Tube

__all__ = [
    "CATALOGUE",
    "LOCKING_ANGLE",
    "MODELS",
    "PRESETS",
    "Braid",
    "Calibration",
    "Comparison",
    "ConvergenceError",
    "EnergyMuscle",
    "HistoryModel",
    "Hysteresis",
    "Measurements",
    "ModelScore",
    "Muscle",
    "MuscleModel",
    "MuscleState",
    "RankedModel",
    "Ranking",
    "RepeatStatistics",
    "StaticModel",
    "ThesisMuscle",
    "Tube",
    "calibrate",
    "compare_models",
    "preset",
    "rank_models",
    "read_measurements",
    "write_measurements",
]
