"""Checks of a board, a row each: what it is, what it refuses, how it fails, how even time is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..progress import Progress, no_progress
from ..results import Json, Result
from .firmware import find_build_id
from .host import POLL, Host, HostRun, describe_faults
from .link import Link
from .protocol import Arm, Outcome, Reply, SetPoint, State, Telemetry, Trip, encode, pack_setpoints

ECHOES = 100
"""Round trips that are timed."""
RATES = (100.0, 500.0, 1000.0)
"""Rates of the host's loop that are tried [Hz]."""
RATE_TIME = 2.0
"""How long each [s]."""
SILENCE_LIMIT_MS = 110.0
"""By the board's clock: it trips after 100 ms; the rest is for its telemetry."""
ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class SelfTest(Result):
    """Checks of a board.

    Attributes
    ----------
    rows : list of dict
        ``check``, ``passed``, ``found`` and ``required``.
    runs : list of HostRun
        Those by which the evenness of time was measured, one for each of `RATES`.
    """

    rows: list[Json]
    runs: list[HostRun] = field(repr=False)
    residual: float = 0.0

    @property
    def converged(self) -> bool:
        """Whether all checks passed."""
        return all(row["passed"] for row in self.rows)

    @property
    def reason(self) -> str:
        """Which did not."""
        failed = [row["check"] for row in self.rows if not row["passed"]]
        return f"failed: {', '.join(failed)}" if failed else ""

    def list_columns(self) -> Json:
        """Return the columns of `to_frame`."""
        names = ("check", "passed", "found", "required")
        return {name: [row[name] for row in self.rows] for name in names}


def _find_time(host: Host, holds: Callable[[Telemetry], bool]) -> float:
    """Return the board's time [s] in the first telemetry of a kind; NaN if there is none in 1 s."""
    end = host.link.now + 1.0
    while host.link.now < end:
        host.link.wait(host.link.now + POLL)
        for frame in host.reader.read(host.link.read()):
            if isinstance(frame, Telemetry):
                host.telemetry = frame
                if holds(frame):
                    return frame.time
    return math.nan


def check_board(link: Link, *, progress: Progress = no_progress) -> SelfTest:
    """Check a board. No set-point is above 0, so no muscle moves.

    Parameters
    ----------
    link : Link
        To the board.
    progress : callable
        Is called with how far it is.

    Raises
    ------
    InputError
        If no board of Bozzini answers.
    """
    rows: list[Json] = []

    def add(check: str, passed: bool, found: str, required: str) -> None:
        rows.append({"check": check, "passed": passed, "found": found, "required": required})

    progress("checks", 0.0)
    host = Host(link)
    board = host.connect()
    mine = find_build_id()
    add("firmware", board.build_id == mine, f"{board.build_id:08x}", f"{mine:08x}")
    add("no test build", not board.is_test_build, str(not board.is_test_build), "True")
    if host.state is State.FAULT:
        host.clear()
    add("disarmed at the start", host.state is State.DISARMED, host.state.name, "DISARMED")
    trips = [1e3 * host.time_echo() for _ in range(ECHOES)]
    spread = f"p50 {np.median(trips):.1f}, p99 {np.percentile(trips, 99.0):.1f} ms"
    add("echo round trip", True, spread, "-")

    answer = host.ask(Arm(), Reply).outcome
    add("arming without set-points", answer is not Outcome.OK, answer.name, "refused")
    host.link.write(encode(SetPoint.kind, 0, pack_setpoints((0xFFFF,) * 3)))
    answer = host.wait_for(Reply, SetPoint.kind).outcome
    add("set-points out of range", answer is Outcome.BAD_VALUE, answer.name, "BAD_VALUE")
    host.arm()
    number = host.send(SetPoint(ZERO))
    begin = _find_time(host, lambda frame: frame.acknowledged == number)
    took = 1e3 * (_find_time(host, lambda frame: frame.state is not State.ARMED) - begin)
    right = host.state is State.FAULT and host.faults is Trip.HOST and took < SILENCE_LIMIT_MS
    found = f"{host.state.name} ({describe_faults(host.faults)}) after {took:.0f} ms"
    add("silence of the host", right, found, f"FAULT (host) within {SILENCE_LIMIT_MS:.0f} ms")
    host.clear()

    runs = []
    for k, rate in enumerate(RATES):
        progress("checks", 0.3 + 0.7 * k / len(RATES))
        timed = Host(link, period=1.0 / rate)
        timed.connect()
        run = timed.run(lambda time, board: (SetPoint(ZERO), {}), RATE_TIME)
        runs.append(run)
        spread = ", ".join(f"{name[:-3]} {value:.2f}" for name, value in run.jitter.items())
        words = f"{spread} ms; late {run.late}, lost {run.lost}, damaged {run.bad + run.refused}"
        fair = run.converged and run.bad + run.refused == 0
        add(f"host loop at {rate:g} Hz", fair, run.reason or words, "no damaged frame")
    return SelfTest(rows=rows, runs=runs)
