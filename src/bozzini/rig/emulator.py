"""The firmware in an emulated ATmega2560 (simavr), cycle by cycle."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import BozziniError
from .board import OUTPUTS, CompiledBoard
from .firmware import ToolchainError, build

__all__ = ["CLOCK_RATE", "EmulatedBoard", "EmulationError"]

CLOCK_RATE = 16_000_000
"""Cycles of the chip per second [Hz]."""


class EmulationError(BozziniError, RuntimeError):
    """The emulated program has crashed."""


class EmulatedBoard(CompiledBoard):
    """An ATmega2560 that runs the firmware as it is flashed.

    Converter, timers, serial line and watchdog are those of simavr; noise on the line, brown-out,
    tolerance of the clock and floating inputs are not modelled. While the chip is in reset its
    outputs are at the level of the pull resistors: fill and supply valves shut, bleed valves open.

    Parameters
    ----------
    is_test_build : bool
        Whether to obey the frames that stop the board, for tests only.
    sources : Path, optional
        Directory with the firmware's sources, by default Bozzini's own.

    Raises
    ------
    ToolchainError
        If it cannot be built.

    Attributes
    ----------
    levels : (7,) ndarray
        Levels of the output pins averaged over the last `run`, the supply valve's last. They agree
        with the duties while these are constant; simavr loses a pulse where one changes.
    """

    def __init__(self, *, is_test_build: bool = False, sources: Path | None = None) -> None:
        super().__init__(build("emulator.so"), "bz_emulator")
        self.levels = np.zeros(OUTPUTS)
        program = build("firmware-test.elf" if is_test_build else "firmware.elf", sources)
        pointer = ctypes.c_void_p
        self._find("run", ctypes.c_int, pointer, ctypes.c_uint64, pointer, pointer)
        self._find("count_cycles", ctypes.c_uint64, ctypes.c_void_p)
        self._handle = self._find("new", ctypes.c_void_p, ctypes.c_char_p)(bytes(program))
        if not self._handle:
            raise ToolchainError(f"{program} is no program for the ATmega2560")
        self.set_voltages((0.5, 0.5, 0.5, 4.0, 2.5, 2.5))

    def run(self, duration: float) -> NDArray[np.float64]:
        """Advance by whole cycles.

        Parameters
        ----------
        duration : float
            Time, at least 1e-5 s.

        Returns
        -------
        (7,) ndarray
            Duties averaged over the time: fill valves 1 to 3, bleed valves 1 to 3, supply valve.

        Raises
        ------
        InputError
            If the time is not legal.
        EmulationError
            If the program has crashed.
        """
        span = check_number("duration", duration, low=1e-5, high=1e5, unit="s")
        duties = np.empty(OUTPUTS)
        means = duties.ctypes.data, self.levels.ctypes.data
        if not self._call("run", round(span * CLOCK_RATE), *means):
            raise EmulationError(f"the emulated program has crashed at {self.cycles} cycles")
        return duties

    @property
    def cycles(self) -> int:
        """Cycles since the start."""
        return int(self._call("count_cycles"))
