"""Hysteresis: operators with memory, which a muscle model carries or which are fitted to loops.

`Hysteresis` is what a model asks for; the operators are those of the thesis's section 2.2.10.
"""

from __future__ import annotations

from .bouc_wen import BoucWen
from .friction import FrictionBand, MaxwellSlip
from .generalised import GeneralisedPrandtlIshlinskii, MonotoneCurve
from .operator import (
    Hysteresis,
    HysteresisFit,
    HysteresisState,
    InvertibleOperator,
    LoopOptions,
    Operator,
)
from .prandtl_ishlinskii import (
    AsymmetricPrandtlIshlinskii,
    PrandtlIshlinskii,
    UnparallelPrandtlIshlinskii,
)
from .preisach import Preisach, PreisachForce

__all__ = [
    "AsymmetricPrandtlIshlinskii",
    "BoucWen",
    "FrictionBand",
    "GeneralisedPrandtlIshlinskii",
    "Hysteresis",
    "HysteresisFit",
    "HysteresisState",
    "InvertibleOperator",
    "LoopOptions",
    "MaxwellSlip",
    "MonotoneCurve",
    "Operator",
    "PrandtlIshlinskii",
    "Preisach",
    "PreisachForce",
    "UnparallelPrandtlIshlinskii",
]
