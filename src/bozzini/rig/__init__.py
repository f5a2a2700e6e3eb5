"""The rig: compressor, valves, muscles and transducers as a plant, and the board that drives it."""

from __future__ import annotations

from .board import NativeBoard
from .cosimulation import Board, Cosimulation, CosimulationRecord
from .curves import PressureCurve, read_curve, take_curve
from .emulator import EmulatedBoard, EmulationError
from .firmware import ToolchainError
from .identify import CurveFit, Identification, identify_fill, identify_leak
from .plant import FAULT_KINDS, Chamber, Fault, Plant, PlantDesign
from .pneumatics import ATMOSPHERE, Orifice

__all__ = [
    "ATMOSPHERE",
    "FAULT_KINDS",
    "Board",
    "Chamber",
    "Cosimulation",
    "CosimulationRecord",
    "CurveFit",
    "EmulatedBoard",
    "EmulationError",
    "Fault",
    "Identification",
    "NativeBoard",
    "Orifice",
    "Plant",
    "PlantDesign",
    "PressureCurve",
    "ToolchainError",
    "identify_fill",
    "identify_leak",
    "read_curve",
    "take_curve",
]
