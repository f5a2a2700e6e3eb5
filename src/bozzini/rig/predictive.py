"""Predictive control of the tip on a rig: set-points by a model in time of the section."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_number
from ..effector import Effector, PredictiveControl
from ..effector.control import PERIOD
from ..numeric.arrays import Floats
from .hysteresis import MotionObserver
from .protocol import Configuration, SetPoint, Telemetry

BOARD_LAG = 0.015
"""Lag with which pressures follow set-points that change slowly, in the model [s]."""
FORESEEN = 3
"""Samples ahead for which the tip goes on as it did since the last one."""
LARGEST_SPEED = 100.0
"""Above this the tip's goal jumps, and is not foreseen [mm/s]."""


class PredictiveSteering:
    """Set-points by `bozzini.effector.PredictiveControl` at 50 Hz, from the pressures measured.

    The model is the section with its plays and creep, behind a lag in place of the board, valves
    and lines. It is put at the measured pressures each time. Where the tip will be wanted is not
    known: it goes on for 60 ms as it did in the last 20 ms. One object serves one run.

    Parameters
    ----------
    effector : Effector
        The model, of three muscles.
    board : Configuration
        Its slew rate and its largest set-point are the limits.
    period : float
        Of the host [s].

    Raises
    ------
    InputError
        If the period is not legal.
    """

    def __init__(self, effector: Effector, board: Configuration, *, period: float) -> None:
        host = check_number("period", period, low=1e-3, high=0.05, unit="s")
        motion = replace(effector.motion, fill_lag=BOARD_LAG, bleed_lag=BOARD_LAG)
        limit = min(effector.design.pressure_limit, board.setpoint_max)
        design = effector.design.replace(pressure_limit=limit)
        self.control = PredictiveControl(
            effector=replace(effector, design=design, motion=motion),
            rate=board.slew_rate,
            period=max(PERIOD, host),
        )
        self._observer = MotionObserver(motion)
        self._state = self.control.begin()
        self._goal: Floats | None = None
        self._time, self._due = 0.0, -math.inf

    def shape(self, time: float, place: ArrayLike, *, board: Telemetry) -> SetPoint:
        """Return the set-points of a period.

        Parameters
        ----------
        time : float
            Time of the run [s]; it must grow from call to call.
        place : (2,) array_like
            Where the tip is wanted [mm].
        board : Telemetry
            The last telemetry.
        """
        measured = np.clip(board.pressures, 0.0, self.control.highest)
        self._observer.observe(time - self._time, measured)
        self._time = time
        period = self.control.period
        if time > self._due - 1e-6:
            self._due = time + period if time > self._due + period else self._due + period
            now = replace(self._observer.state, bend=self._state.motion.bend)
            _, self._state = self.control.step(
                replace(self._state, motion=now), self._foresee(np.asarray(place, dtype=np.float64))
            )
        return SetPoint(tuple(self._state.command.tolist()))

    def _foresee(self, goal: Floats) -> Floats:
        """Return where the tip will be wanted at the next samples (n, 2)."""
        change = np.zeros(2) if self._goal is None else goal - self._goal
        self._goal = goal
        if np.hypot(*change) > LARGEST_SPEED * self.control.period:
            change = np.zeros(2)
        ahead = goal + np.arange(1.0, FORESEEN + 1.0)[:, None] * change
        size = np.hypot(*ahead.T)[:, None]
        return np.asarray(ahead * np.minimum(1.0, self.control.farthest / np.maximum(size, 1e-9)))
