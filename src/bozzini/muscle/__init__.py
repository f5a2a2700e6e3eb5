"""Muscles: from a pneumatic muscle's dimensions to its force and contraction (thesis ch. 2-3).

What is in here is loaded when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..errors import ConvergenceError
    from .compose import AntagonisticJoint, Bundle
    from .data import Measurements, RepeatStatistics
    from .design import LOCKING_ANGLE, PRESETS, Braid, Muscle, Tube, preset
    from .ends import EndEffects, MountedMuscle, find_offset
    from .export import export_muscle
    from .files import FitSummary, MuscleFile, read_muscle, write_muscle
    from .hysteresis import Hysteresis
    from .model import CompiledMuscle, MuscleModel, MuscleState
    from .models import MODELS, CatalogueModel
    from .models.energy import EnergyMuscle
    from .models.thesis import ThesisMuscle
    from .muscle_fit import Calibration, FitOptions, calibrate
    from .prediction import Prediction, predict
    from .ranking import (
        Comparison,
        ModelScore,
        RankedModel,
        Ranking,
        RankOptions,
        compare_models,
        rank,
    )
    from .table import read_measurements, take_measurements, write_measurements
    from .terms import Creep, ScaledMuscle, TermFit, Thermal, fit_creep, fit_thermal

__all__ = [
    "LOCKING_ANGLE",
    "MODELS",
    "PRESETS",
    "AntagonisticJoint",
    "Braid",
    "Bundle",
    "Calibration",
    "CatalogueModel",
    "Comparison",
    "CompiledMuscle",
    "ConvergenceError",
    "Creep",
    "EndEffects",
    "EnergyMuscle",
    "FitOptions",
    "FitSummary",
    "Hysteresis",
    "Measurements",
    "ModelScore",
    "MountedMuscle",
    "Muscle",
    "MuscleFile",
    "MuscleModel",
    "MuscleState",
    "RankedModel",
    "Prediction",
    "RankOptions",
    "Ranking",
    "RepeatStatistics",
    "ScaledMuscle",
    "TermFit",
    "Thermal",
    "ThesisMuscle",
    "Tube",
    "calibrate",
    "compare_models",
    "export_muscle",
    "fit_creep",
    "fit_thermal",
    "find_offset",
    "predict",
    "preset",
    "rank",
    "read_measurements",
    "read_muscle",
    "take_measurements",
    "write_measurements",
    "write_muscle",
]

_MODULES = {
    "..errors": ("ConvergenceError",),
    ".compose": ("AntagonisticJoint", "Bundle"),
    ".data": ("Measurements", "RepeatStatistics"),
    ".design": ("LOCKING_ANGLE", "PRESETS", "Braid", "Muscle", "Tube", "preset"),
    ".export": ("export_muscle",),
    ".ends": ("EndEffects", "MountedMuscle", "find_offset"),
    ".files": ("FitSummary", "MuscleFile", "read_muscle", "write_muscle"),
    ".muscle_fit": ("Calibration", "FitOptions", "calibrate"),
    ".hysteresis": ("Hysteresis",),
    ".model": ("CompiledMuscle", "MuscleModel", "MuscleState"),
    ".models": ("MODELS", "CatalogueModel"),
    ".models.energy": ("EnergyMuscle",),
    ".models.thesis": ("ThesisMuscle",),
    ".prediction": ("Prediction", "predict"),
    ".ranking": ("Comparison", "ModelScore", "RankOptions", "RankedModel", "Ranking",
                 "compare_models", "rank"),
    ".terms": ("Creep", "ScaledMuscle", "TermFit", "Thermal", "fit_creep", "fit_thermal"),
    ".table": ("read_measurements", "take_measurements", "write_measurements"),
}  # fmt: skip
_HOMES = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(importlib.import_module(_HOMES[name], __name__), name)
        globals()[name] = value
        return value
    if name[:1].isupper():  # a model of the survey, by the name of its class
        from .models import MODELS

        for kind in MODELS.own.values():
            if kind.__name__ == name:
                return kind
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    from .models import MODELS

    return sorted({*__all__, *(kind.__name__ for kind in MODELS.own.values())})
