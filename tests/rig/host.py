"""A host for the tests: sends frames, keeps what comes back, millisecond by millisecond."""

from __future__ import annotations

import numpy as np

from bozzini.rig.board import CompiledBoard
from bozzini.rig.protocol import (
    Arm,
    Clear,
    Command,
    FrameReader,
    Reply,
    SetPoint,
    State,
    Telemetry,
)

VENTED = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0])
RESERVOIR = 0.9


def to_voltage(pressure):
    """Return the voltage of a pressure sensor: 0.5 V to 4.5 V for 0 to 1.034 MPa."""
    return 0.5 + 4.0 * np.asarray(pressure) / 1.034


class Host:
    """Talks with a board that runs in steps of a millisecond."""

    def __init__(self, board: CompiledBoard) -> None:
        self.board = board
        self.reader = FrameReader()
        self.sequence = 0
        self.frames = []
        self.duties = []
        self.voltages = np.append(to_voltage([0.0, 0.0, 0.0, RESERVOIR]), [2.5, 2.5])

    def send(self, command: Command) -> None:
        self.board.write(command.encode(self.sequence))
        self.sequence += 1

    def set_pressure(self, muscle: int, pressure: float) -> None:
        self.voltages[muscle] = to_voltage(pressure)

    def run(self, ticks, setpoint=None, every=10):
        """Run, sending set-points now and then; return the duties, shape (ticks, 7)."""
        for k in range(ticks):
            if setpoint is not None and k % every == 0:
                self.send(SetPoint(setpoint))
            self.board.set_voltages(self.voltages)
            self.duties.append(self.board.run(1e-3))
            self.frames += self.reader.read(self.board.read())
        return np.array(self.duties[-ticks:])

    def ask(self, command: Command, setpoint=None) -> Reply:
        """Send a command, and return the board's answer to it."""
        self.send(command)
        before = len(self.frames)
        self.run(4, setpoint)
        replies = [frame for frame in self.frames[before:] if isinstance(frame, Reply)]
        assert len(replies) == 1, replies
        return replies[0]

    def arm(self, setpoint=(0.0, 0.0, 0.0)):
        """Switch on and arm."""
        self.run(30, setpoint)
        assert self.ask(Arm(), setpoint).outcome == 0
        assert self.telemetry.state == State.ARMED

    def clear(self):
        return self.ask(Clear())

    @property
    def telemetry(self) -> Telemetry:
        return next(frame for frame in reversed(self.frames) if isinstance(frame, Telemetry))

    def list_telemetry(self):
        return [frame for frame in self.frames if isinstance(frame, Telemetry)]


def find_vent(duties) -> int:
    """Return after how many milliseconds all valves are, and stay, in the safe position."""
    safe = np.all(duties == VENTED, axis=1)
    assert safe[-1], f"not vented after {len(duties)} ms: {duties[-1]}"
    unsafe = np.flatnonzero(~safe)
    return int(unsafe[-1]) + 1 if unsafe.size else 0
