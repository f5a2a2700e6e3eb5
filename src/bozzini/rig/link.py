"""Links to a board: in lock-step with an emulated rig, or over a serial port."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..checks import show_value
from ..errors import InputError, MissingExtraError
from .protocol import BAUD_RATE

if TYPE_CHECKING:
    from .cosimulation import Cosimulation, CosimulationRecord


class Link(Protocol):
    """Bytes to and from a board, and the clock by which they are sent."""

    real_time: bool
    """Whether the clock runs by itself."""

    @property
    def now(self) -> float:
        """Time of the link's clock [s]."""
        ...

    def wait(self, until: float) -> None:
        """Return when the clock has reached a time [s]."""
        ...

    def read(self) -> bytes:
        """Return what has arrived since the last call, without waiting."""
        ...

    def write(self, data: bytes) -> None:
        """Send bytes."""
        ...

    def close(self) -> None:
        """End the connection."""
        ...


class LockstepLink:
    """A board and its plant that advance only while the host waits: deterministic.

    Parameters
    ----------
    rig : Cosimulation
        The board and the plant, without a host of its own.

    Attributes
    ----------
    records : list of CosimulationRecord
        What happened, one after the other.
    """

    real_time = False

    def __init__(self, rig: Cosimulation) -> None:
        self.rig = rig
        self.records: list[CosimulationRecord] = []

    @property
    def now(self) -> float:
        """Simulated time [s]."""
        return self.rig.plant.time

    def wait(self, until: float) -> None:
        """Simulate up to a time [s], in whole periods of the co-simulation."""
        count = math.ceil((until - self.now) / self.rig.period - 1e-6)
        if count > 0:
            self.records.append(self.rig.run(count * self.rig.period))

    def list_pressures(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return time [s] (n,) and pressures in the muscles [MPa] (n, 3) of all records."""
        time = np.concatenate([record.time for record in self.records])
        return time, np.vstack([record.pressures for record in self.records])

    def read(self) -> bytes:
        """Return what the board has sent since the last call."""
        return self.rig.board.read()

    def write(self, data: bytes) -> None:
        """Send bytes to the board."""
        self.rig.board.write(data)

    def close(self) -> None:
        """Do nothing: the simulation ends with the object."""


class SerialLink:
    """A board at a serial port, or behind a pseudo-terminal.

    Opening the port of an ATmega2560 board resets it: it boots, vented and disarmed.

    Parameters
    ----------
    port : str
        Such as ``/dev/ttyACM0``, ``COM3``, or the path that `emulated_port` gives.

    Raises
    ------
    MissingExtraError
        If pyserial is not installed.
    InputError
        If the port cannot be opened.
    """

    real_time = True

    def __init__(self, port: str) -> None:
        try:
            import serial
        except ImportError:
            raise MissingExtraError("pyserial", "rig") from None
        try:
            self._port: Any = serial.Serial(port, BAUD_RATE, timeout=0, exclusive=True)
        except (serial.SerialException, ValueError, TypeError) as error:
            raise InputError(f"port is {show_value(port)}: it cannot be opened: {error}") from None
        self._port.reset_input_buffer()

    @property
    def now(self) -> float:
        """Time since an arbitrary start [s]; it never goes back."""
        return time.monotonic()

    def wait(self, until: float) -> None:
        """Sleep up to a time [s]."""
        time.sleep(max(until - time.monotonic(), 0.0))

    def read(self) -> bytes:
        """Return what has arrived."""
        try:
            return bytes(self._port.read(self._port.in_waiting))
        except OSError as error:  # of pyserial, too
            raise InputError(
                f"port is {self._port.port}: the connection is lost: {error}"
            ) from None

    def write(self, data: bytes) -> None:
        """Send bytes."""
        try:
            self._port.write(data)
        except OSError as error:
            raise InputError(
                f"port is {self._port.port}: the connection is lost: {error}"
            ) from None

    def close(self) -> None:
        """Close the port."""
        self._port.close()
