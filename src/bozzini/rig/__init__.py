"""The rig: compressor, valves, muscles and transducers as a plant, and the board that drives it."""

from __future__ import annotations

from .board import NativeBoard
from .emulator import EmulatedBoard, EmulationError
from .firmware import ToolchainError

__all__ = [
    "EmulatedBoard",
    "EmulationError",
    "NativeBoard",
    "ToolchainError",
]
