"""The rig: compressor, valves, muscles and transducers as a plant, and the board that drives it."""

from __future__ import annotations

from .board import NativeBoard
from .cosimulation import Board, Cosimulation, CosimulationRecord
from .emulator import EmulatedBoard, EmulationError
from .firmware import ToolchainError
from .host import Host, HostRun, load_log
from .link import Link, LockstepLink, SerialLink, emulated_port
from .plant import FAULT_KINDS, Chamber, Fault, Plant, PlantDesign
from .pneumatics import ATMOSPHERE, Orifice
from .stick import BoardStick, GamepadStick, ScriptedStick, StickSource

__all__ = [
    "ATMOSPHERE",
    "FAULT_KINDS",
    "Board",
    "BoardStick",
    "Chamber",
    "Cosimulation",
    "CosimulationRecord",
    "EmulatedBoard",
    "EmulationError",
    "Fault",
    "GamepadStick",
    "Host",
    "HostRun",
    "Link",
    "LockstepLink",
    "NativeBoard",
    "Orifice",
    "Plant",
    "PlantDesign",
    "ScriptedStick",
    "SerialLink",
    "StickSource",
    "ToolchainError",
    "emulated_port",
    "load_log",
]
