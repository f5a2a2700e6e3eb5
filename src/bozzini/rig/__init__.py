"""The rig: compressor, valves, muscles and transducers as a plant, and the board that drives it."""

from __future__ import annotations

from .board import NativeBoard
from .cosimulation import Board, Cosimulation, CosimulationRecord
from .demo import FaultResponses, StepResponses, run_faults, run_steps
from .emulate import emulate_rig, emulated_port, serve
from .emulator import EmulatedBoard, EmulationError
from .firmware import ToolchainError
from .host import Host, HostRun, load_log
from .link import Link, LockstepLink, SerialLink
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
    "FaultResponses",
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
    "StepResponses",
    "StickSource",
    "ToolchainError",
    "emulate_rig",
    "emulated_port",
    "load_log",
    "run_faults",
    "run_steps",
    "serve",
]
