"""Sources of stick readings: the board's own stick, a script, a gamepad."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..checks import check_array, check_integer, check_number
from ..effector.steering import Stick
from ..errors import InputError, MissingExtraError
from ..results import Shown


class StickSource(Protocol):
    """Gives the readings of a stick, in the units that `bozzini.effector.Stick` takes."""

    def read(self, time: float, board: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the readings (2,) at a time [s] of the run.

        `board` (2,) is what the board last reported of its own stick.
        """
        ...


class BoardStick:
    """The stick wired to the board, as its telemetry reports it (thesis 4.6)."""

    def read(self, time: float, board: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the board's readings (2,)."""
        return board


@dataclass(frozen=True, eq=False)
class ScriptedStick(Shown):
    """Readings given beforehand, linear between their times and held after the last.

    Parameters
    ----------
    times : (n,) array_like
        Increasing times [s].
    readings : (n, 2) array_like
        Readings of x and y [counts].

    Raises
    ------
    InputError
        If there is no reading, a number is not finite, or the times do not increase.
    """

    times: NDArray[np.float64]
    readings: NDArray[np.float64]

    def __post_init__(self) -> None:
        times, readings = (check_array(name, getattr(self, name)) for name in ("times", "readings"))
        if times.ndim != 1 or not times.size or readings.shape != (times.size, 2):
            raise InputError(
                f"times has shape {times.shape} and readings {readings.shape}: they must be (n,) "
                "and (n, 2) with n of 1 or more"
            )
        if not (np.isfinite(times).all() and np.isfinite(readings).all()):
            raise InputError("times and readings hold a number that is not finite")
        if not (np.diff(times) > 0.0).all():
            raise InputError("times do not increase: each must be later than the one before")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "readings", readings)

    def read(self, time: float, board: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the readings (2,) at a time [s]."""
        return np.array([np.interp(time, self.times, column) for column in self.readings.T])

    @classmethod
    def circle(cls, frequency: float, duration: float, *, share: float = 0.6) -> ScriptedStick:
        """Return a stick that goes to the right within 0.5 s and then round in circles.

        Parameters
        ----------
        frequency : float
            Turns a second [Hz].
        duration : float
            How long [s].
        share : float
            Travel as a share of the full one.

        Raises
        ------
        InputError
            If a value is outside its legal range.
        """
        frequency = check_number("frequency", frequency, low=1e-3, high=50.0, unit="Hz")
        duration = check_number("duration", duration, low=0.01, high=3600.0, unit="s")
        share = check_number("share", share, low=0.0, high=1.0)
        begin = 0.5
        times = np.arange(0.0, duration + 0.002, 0.002)
        angles = 2.0 * math.pi * frequency * np.maximum(times - begin, 0.0)
        travel = share * np.minimum(times / begin, 1.0)
        unit = Stick()
        x = unit.centre + (unit.highest - unit.centre) * travel * np.cos(angles)
        y = unit.centre - (unit.highest - unit.centre) * travel * np.sin(angles)
        return cls(times, np.column_stack([x, y]))


class GamepadStick:
    """The left stick of a gamepad, read through pygame without a window.

    Parameters
    ----------
    index : int
        Which gamepad, counted from 0.

    Raises
    ------
    MissingExtraError
        If pygame is not installed.
    InputError
        If there is no such gamepad.
    """

    def __init__(self, index: int = 0) -> None:
        index = check_integer("gamepad", index, low=0, high=99)
        self._joystick = _open_gamepad(index)

    def read(self, time: float, board: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the readings (2,): right and down are positive, as on the board's stick."""
        import pygame

        pygame.event.pump()
        travel = np.array([self._joystick.get_axis(axis) for axis in (0, 1)])
        unit = Stick()
        return np.clip(unit.centre + unit.span * travel, 0.0, unit.highest)


def _open_gamepad(index: int) -> Any:
    """Return an opened gamepad of pygame."""
    import os

    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        import pygame
    except ImportError:
        raise MissingExtraError("pygame-ce", "rig") from None
    pygame.display.init()
    pygame.joystick.init()
    count = pygame.joystick.get_count()
    if index >= count:
        found = f"only 0 to {count - 1} are" if count else "none is"
        raise InputError(f"gamepad is {index}, counted from 0: {found} connected")
    return pygame.joystick.Joystick(index)


SOURCES = ("board", "gamepad", "circle")
"""The kinds of `make_stick`."""


def make_stick(kind: str, *, frequency: float = 0.5, duration: float = 10.0) -> StickSource:
    """Return a stick by its kind.

    Parameters
    ----------
    kind : {"board", "gamepad", "circle"}
        The stick wired to the board, the first gamepad, or a script that goes in circles.
    frequency, duration : float
        Of the circles [Hz], [s].

    Raises
    ------
    InputError
        If a value is not legal, or there is no gamepad.
    """
    if kind not in SOURCES:
        raise InputError(f"stick is {kind!r}: it must be one of {', '.join(SOURCES)}")
    if kind == "circle":
        return ScriptedStick.circle(frequency, duration)
    return BoardStick() if kind == "board" else GamepadStick()
