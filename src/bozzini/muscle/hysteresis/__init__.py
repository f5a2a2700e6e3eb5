"""Hysteresis: operators with memory, which a muscle model carries or which are fitted to loops.

`Hysteresis` is what a model asks for; the operators of the thesis's section 2.2.10 are beside.
"""

from __future__ import annotations

from .asymmetric import AsymmetricPrandtlIshlinskii
from .bouc_wen import BoucWen
from .fit import HysteresisFit
from .friction_band import FrictionBand
from .maxwell_slip import MaxwellSlip
from .operator import HysteresisState, Operator
from .prandtl_ishlinskii import PrandtlIshlinskii
from .preisach import Preisach
from .preisach_force import PreisachForce
from .protocol import Hysteresis
from .unparallel import UnparallelPrandtlIshlinskii

__all__ = [
    "AsymmetricPrandtlIshlinskii",
    "BoucWen",
    "FrictionBand",
    "Hysteresis",
    "HysteresisFit",
    "HysteresisState",
    "MaxwellSlip",
    "Operator",
    "PrandtlIshlinskii",
    "Preisach",
    "PreisachForce",
    "UnparallelPrandtlIshlinskii",
]
