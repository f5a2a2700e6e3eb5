"""The rig: compressor, valves, muscles and transducers as a plant, and the board that drives it."""

from __future__ import annotations

from .cosimulation import Board, Cosimulation, CosimulationRecord
from .plant import FAULT_KINDS, Chamber, Fault, Plant, PlantDesign
from .pneumatics import ATMOSPHERE, Orifice

__all__ = [
    "ATMOSPHERE",
    "FAULT_KINDS",
    "Board",
    "Chamber",
    "Cosimulation",
    "CosimulationRecord",
    "Fault",
    "Orifice",
    "Plant",
    "PlantDesign",
]
