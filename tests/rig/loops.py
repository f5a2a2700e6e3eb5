"""The firmware closed round the plant, and what its steps are like."""

from __future__ import annotations

import numpy as np

from bozzini.muscle import EnergyMuscle, preset
from bozzini.rig import Chamber, Cosimulation, Plant
from bozzini.rig.protocol import Arm, FrameReader, SetPoint, State, Telemetry

CHAMBER = Chamber.from_model(EnergyMuscle(preset("fitted-45")))
FRESH = 10
"""Milliseconds between set-point frames."""


class Loop:
    """A board and the plant; the host sends the present targets [MPa] and arms once."""

    def __init__(self, board, seed=0, **more) -> None:
        self.plant = Plant(CHAMBER, seed=seed, **more)
        self.board = board
        self.targets = (0.0, 0.0, 0.0)
        self.is_silent = False
        self.reader = FrameReader()
        self.frames = []
        self._loop = Cosimulation(board, self.plant, host=self._host)
        self._ticks = 0

    def _host(self, time, data) -> bytes:
        self.frames += self.reader.read(data)
        self._ticks += 1
        sent = b""
        if self._ticks % FRESH == 1 and not self.is_silent:
            sent += SetPoint(self.targets).encode(self._ticks)
        if self._ticks == 30:
            sent += Arm().encode(self._ticks)
        return sent

    def run(self, duration, targets=None):
        """Run and return the record."""
        self.targets = self.targets if targets is None else tuple(targets)
        return self._loop.run(duration)

    def arm(self):
        self.run(0.05)
        assert self.telemetry.state == State.ARMED
        return self

    @property
    def telemetry(self):
        return next(frame for frame in reversed(self.frames) if isinstance(frame, Telemetry))


def describe_step(pressures, before, target):
    """Return settling time [ms], overshoot, steady error and deviation [MPa] of one step, a muscle.

    Settled is within 2 % and 4 kPa of the target; steady is the last 150 ms.
    """
    off = np.abs(pressures - target) > 0.02 * target + 0.004
    settle = int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0
    beyond = (pressures - target) * np.sign(target - before)
    tail = pressures[-150:]
    return settle, float(beyond.max()), float(abs(tail.mean() - target)), float(tail.std())
