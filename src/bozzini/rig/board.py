"""Boards that run the firmware on this computer and advance only when they are asked to."""

from __future__ import annotations

import ctypes
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number
from ..errors import InputError
from .firmware import build

__all__ = ["CompiledBoard", "NativeBoard"]

INPUTS = 6
"""Voltages: muscle 1 to 3, reservoir, stick x and y."""

OUTPUTS = 7
"""Duties: fill valves 1 to 3, bleed valves 1 to 3, supply valve."""

TICK = 1e-3
"""Period of measurement and control [s]."""

_BUFFER = 1 << 16

CType = Any
"""A type of ctypes, which has no public name for them all, or a function of a library."""

_SIGNATURES: dict[str, tuple[CType, tuple[CType, ...]]] = {
    "free": (None, (ctypes.c_void_p,)),
    "reset": (None, (ctypes.c_void_p,)),
    "set_voltages": (None, (ctypes.c_void_p, ctypes.c_void_p)),
    "write": (ctypes.c_int, (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t)),
    "read": (ctypes.c_size_t, (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t)),
    "count_resets": (ctypes.c_uint32, (ctypes.c_void_p,)),
}


class CompiledBoard:
    """A board in a compiled library. As a context manager it is freed at the end."""

    def __init__(self, library: Path, prefix: str) -> None:
        self._library = ctypes.CDLL(str(library))
        self._prefix = prefix
        self._buffer = ctypes.create_string_buffer(_BUFFER)
        for verb, (result, arguments) in _SIGNATURES.items():
            self._find(verb, result, *arguments)
        self._handle: int | None = None

    def _find(self, verb: str, result: CType, *arguments: CType) -> CType:
        """Return a function of the library, with its types set."""
        function = getattr(self._library, f"{self._prefix}_{verb}")
        function.restype, function.argtypes = result, arguments
        return function

    def _call(self, verb: str, *arguments: CType) -> CType:
        if self._handle is None:
            raise InputError("the board is closed")
        return getattr(self._library, f"{self._prefix}_{verb}")(self._handle, *arguments)

    def set_voltages(self, voltages: ArrayLike) -> None:
        """Set the analogue inputs [V]: muscle 1 to 3, reservoir, stick x and y.

        Raises
        ------
        InputError
            If they are not six finite numbers.
        """
        values = np.ascontiguousarray(check_array("voltages", voltages))
        if values.shape != (INPUTS,) or not np.isfinite(values).all():
            raise InputError(f"voltages are {values}: they must be {INPUTS} finite numbers")
        self._call("set_voltages", values.ctypes.data)

    def write(self, data: bytes) -> None:
        """Give the board bytes from the host; they take their time on the line."""
        if not self._call("write", data, len(data)):
            raise MemoryError("no memory for the bytes that wait for the board")

    def read(self) -> bytes:
        """Return the bytes that the board has sent since the last call."""
        parts = []
        while count := self._call("read", self._buffer, _BUFFER):
            parts.append(self._buffer.raw[:count])
        return b"".join(parts)

    def reset(self) -> None:
        """Reset the board as its reset pin does; bytes under way are lost."""
        self._call("reset")

    @property
    def watchdog_resets(self) -> int:
        """Resets by the watchdog."""
        return int(self._call("count_resets"))

    def close(self) -> None:
        """Free the board."""
        if self._handle is not None:
            self._call("free")
        self._handle = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __del__(self) -> None:
        if getattr(self, "_handle", None) is not None:
            self.close()


class NativeBoard(CompiledBoard):
    """The firmware's protocol, control and safety code compiled for this computer.

    Converter (10 bit), serial line (50 bytes a millisecond), clock and watchdog are modelled in
    steps of one millisecond; what the interrupts of the chip cost is not.

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
    """

    def __init__(self, *, is_test_build: bool = False, sources: Path | None = None) -> None:
        super().__init__(
            build("native-test.so" if is_test_build else "native.so", sources), "bz_native"
        )
        self._find("run", None, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_void_p)
        self._handle = self._find("new", ctypes.c_void_p)()
        self.set_voltages((0.5, 0.5, 0.5, 4.0, 2.5, 2.5))

    def run(self, duration: float) -> NDArray[np.float64]:
        """Advance by whole milliseconds.

        Parameters
        ----------
        duration : float
            Time, at least 0.001 s.

        Returns
        -------
        (7,) ndarray
            Duties averaged over the time: fill valves 1 to 3, bleed valves 1 to 3, supply valve.

        Raises
        ------
        InputError
            If the time is not whole milliseconds.
        """
        ticks = round(check_number("duration", duration, low=TICK, high=1e5, unit="s") / TICK)
        if abs(ticks * TICK - duration) > 1e-6 * TICK:
            raise InputError(f"duration is {duration:g} s: it must be whole milliseconds")
        duties = np.empty(OUTPUTS)
        self._call("run", ticks, duties.ctypes.data)
        return duties
