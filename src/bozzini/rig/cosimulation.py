"""A board and the plant in lock-step: one clock, no threads, the same numbers every time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_number, show_apart
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import ClosedForm, tabulated, take_axes
from .plant import MUSCLES, Plant

if TYPE_CHECKING:
    from matplotlib.axes import Axes


PERIOD = 1e-3
"""Time between two exchanges of voltages and duties [s]."""

Host = Callable[[float, bytes], bytes]
"""A host: takes the time [s] and what the board has sent, returns what it sends to the board."""


class ControlBoard(Protocol):
    """A controller board, emulated or run natively, that advances only when it is asked to."""

    def set_voltages(self, voltages: ArrayLike) -> None:
        """Set the analogue inputs [V], shape (6,): muscle 1 to 3, reservoir, stick x and y."""

    def run(self, duration: float) -> Floats:
        """Advance [s], and return the duties averaged over it, shape (7,).

        They are those of the fill valves 1 to 3, the bleed valves 1 to 3 and the supply valve,
        which is 1 for a board that has none.
        """

    def write(self, data: bytes) -> None:
        """Give the board bytes from the host."""

    def read(self) -> bytes:
        """Return the bytes that the board has sent since the last call."""

    def reset(self) -> None:
        """Reset the board as its reset pin does."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CosimulationRecord(ClosedForm):
    """What happened, a row at the end of each period.

    Attributes
    ----------
    time : (n,) ndarray
        Time of the plant [s].
    pressures, line_pressures, contractions : (n, 3) ndarray
        Gauge pressures in muscles and lines [MPa], contractions [mm].
    reservoir_pressure : (n,) ndarray
        Gauge pressure [MPa].
    voltages : (n, 6) ndarray
        What the board's inputs saw during the period [V].
    duty : (n, 7) ndarray
        Mean duties during the period: fill valves, bleed valves, supply valve.
    """

    time: Floats = tabulated("s")
    pressures: Floats = tabulated("MPa", "pressure_{}", over="muscles")
    line_pressures: Floats = tabulated("MPa", "line_pressure_{}", over="muscles")
    contractions: Floats = tabulated("mm", "contraction_{}", over="muscles")
    reservoir_pressure: Floats = tabulated("MPa")
    voltages: Floats = tabulated("V", "voltage_{}", over="inputs")
    duty: Floats = tabulated(name="{}", over="valves")

    muscles = tuple(str(k + 1) for k in range(MUSCLES))
    inputs = (*muscles, "reservoir", "stick_x", "stick_y")
    valves = (*(f"{way}_{k + 1}" for way in ("fill", "bleed") for k in range(MUSCLES)), "supply")

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the pressures in the muscles over time, and return the axes."""
        axes = take_axes(ax, x="time [s]", y="pressure [kPa]")
        for k in range(MUSCLES):
            axes.plot(self.time, 1e3 * self.pressures[:, k], label=f"muscle {k + 1}")
        axes.legend(frameon=False)
        return axes


class Cosimulation:
    """A board and a plant that exchange voltages and duties once a period.

    In each period the board first sees the plant's voltages, then runs for the period, and then
    the plant runs through the same period under the board's mean duties. The delay of one period
    is that of a board that samples once.

    Parameters
    ----------
    board : ControlBoard
        The board.
    plant : Plant
        The plant.
    host : callable, optional
        The host, called before each period; see `Host`.
    period : float
        Time between two exchanges, in [1e-5, 0.1] s.

    Raises
    ------
    InputError
        If the period is not legal.
    """

    def __init__(
        self, board: ControlBoard, plant: Plant, *, host: Host | None = None, period: float = PERIOD
    ) -> None:
        self.board, self.plant, self.host = board, plant, host
        self.period = check_number("period", period, low=1e-5, high=0.1, unit="s")

    def run(self, duration: float) -> CosimulationRecord:
        """Go on for a duration, and return what happened.

        Parameters
        ----------
        duration : float
            Whole periods, at least one [s].

        Raises
        ------
        InputError
            If the duration is not a whole number of periods.
        """
        span = check_number("duration", duration, low=self.period, high=1e5, unit="s")
        count = round(span / self.period)
        if abs(count * self.period - span) > 1e-6 * self.period:
            shown = show_apart(span, self.period)
            raise InputError(f"duration is {shown[0]} s: it must be a multiple of {shown[1]} s")
        board, plant = self.board, self.plant
        time, reservoir = np.empty(count), np.empty(count)
        pressures, lines, contractions = np.empty((3, count, MUSCLES))
        voltages, duty = np.empty((count, 2 * MUSCLES)), np.empty((count, 2 * MUSCLES + 1))
        for i in range(count):
            if self.host is not None:
                sent = self.host(plant.time, board.read())
                if sent:
                    board.write(sent)
            voltages[i] = plant.sensor_voltages()
            board.set_voltages(voltages[i])
            duty[i] = board.run(self.period)
            plant.step(duty[i], self.period)
            time[i], reservoir[i] = plant.time, plant.reservoir_pressure
            pressures[i], lines[i] = plant.pressures, plant.line_pressures
            contractions[i] = plant.contractions
        return CosimulationRecord(
            time=time,
            pressures=pressures,
            line_pressures=lines,
            contractions=contractions,
            reservoir_pressure=reservoir,
            voltages=voltages,
            duty=duty,
        )
