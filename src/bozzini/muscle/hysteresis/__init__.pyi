from .bouc_wen import BoucWen
from .friction import FrictionBand, MaxwellFriction, MaxwellSlip
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
    "MaxwellFriction",
    "MaxwellSlip",
    "MonotoneCurve",
    "Operator",
    "PrandtlIshlinskii",
    "Preisach",
    "PreisachForce",
    "UnparallelPrandtlIshlinskii",
]
