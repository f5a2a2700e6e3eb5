"""The host: connects to a board, arms it, sends set-points in time and logs what comes back."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import InputError, MissingExtraError
from ..io.files import write_atomically
from ..progress import Progress, no_progress
from ..results import Json, Result, take_axes
from .link import Link
from .protocol import (
    PROTOCOL_VERSION,
    Arm,
    Clear,
    Command,
    Configuration,
    Disarm,
    Fault,
    Frame,
    FrameReader,
    GetConfiguration,
    Outcome,
    Reply,
    SetPoint,
    State,
    Telemetry,
    TelemetryInterval,
)

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]
_Frame = TypeVar("_Frame", bound=Frame)

ANSWER_LIMIT = 0.5
"""Time within which the board must answer a command [s]."""
BOOT_LIMIT = 3.0
"""Time within which the board must send telemetry after its port is opened [s]."""
POLL = 2e-3
"""Time between two looks for an answer [s]."""

Control = Callable[[float, Telemetry], tuple[SetPoint, Json]]
"""What is run each period: takes the time of the run [s] and the last telemetry, returns the
set-points and further columns of the log."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HostRun(Result):
    """A run of the host: a row for each period.

    Attributes
    ----------
    rows : list of dict
        The columns of `to_frame`, units in the names: time of the run, set-points, the board's
        telemetry, and what the control added.
    start : datetime
        When the run began (UTC).
    period : float
        Period asked for [s].
    link_start : float
        When it began by the clock of the link [s].
    ticks : (n,) ndarray
        When the periods really began [s].
    late : int
        Periods that began more than half a period late, or not at all.
    lost, bad, gaps : int
        Frames that the board dropped, that came damaged, and that are missing by their numbers.
    refused : int
        Frames that the board found damaged, or missing by their numbers.
    reason : str
        Why the run ended early; empty if it did not.
    """

    rows: list[Json] = field(repr=False)
    start: datetime
    link_start: float
    period: float
    ticks: Floats = field(repr=False)
    late: int
    lost: int
    bad: int
    gaps: int
    refused: int
    reason: str = ""

    @property
    def converged(self) -> bool:
        """Whether the run went to its end."""
        return not self.reason

    @property
    def residual(self) -> float:
        """Largest deviation of a period from the one asked for [s]."""
        return float(np.abs(self.periods - self.period).max(initial=0.0))

    @property
    def periods(self) -> Floats:
        """Times between ticks [s]."""
        return np.diff(self.ticks)

    @cached_property
    def jitter(self) -> dict[str, float]:
        """Percentiles of the periods [ms]."""
        if not self.periods.size:
            return {}
        values = 1e3 * np.percentile(self.periods, [50.0, 99.0, 99.9, 100.0])
        return dict(zip(("p50_ms", "p99_ms", "p99.9_ms", "max_ms"), values.tolist(), strict=True))

    def to_dict(self) -> Json:
        """Return the counters and the jitter as plain values."""
        return {
            "converged": self.converged,
            "reason": self.reason,
            "start": self.start.isoformat(),
            "rows": len(self.rows),
            "period_s": self.period,
            "jitter": self.jitter,
            "late": self.late,
            "lost": self.lost,
            "bad": self.bad,
            "gaps": self.gaps,
            "refused": self.refused,
        }

    def to_frame(self) -> pandas.DataFrame:
        """Return the log as a table, a row each period, with the time of day."""
        import pandas

        table = pandas.DataFrame(self.rows)
        if len(table):
            spans = pandas.to_timedelta(table["time_s"], unit="s")
            table.insert(0, "utc", pandas.Timestamp(self.start) + spans)
        table.attrs = {**self.to_dict(), "log": LOG_VERSION}
        return table

    def save(self, path: str | Path) -> Path:
        """Write the log as a Parquet file; see `load_log`.

        Raises
        ------
        MissingExtraError
            If ``pyarrow`` is not installed.
        OutputError
            If the file cannot be written.
        """
        _need_parquet()
        table = self.to_frame()
        return write_atomically(path, lambda target: table.to_parquet(target, index=False))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw set-points and measured pressures over time, and return the axes."""
        axes = take_axes(ax, x="time [s]", y="pressure [kPa]")
        table = self.to_frame()
        for k in range(1, 4):
            (line,) = axes.plot(
                table["time_s"], 1e3 * table[f"pressure_{k}_MPa"], label=f"muscle {k}"
            )
            axes.plot(
                table["time_s"], 1e3 * table[f"setpoint_{k}_MPa"], "--", color=line.get_color()
            )
        axes.legend(frameon=False)
        return axes


LOG_VERSION = 1
LOG_COLUMNS = ("time_s", *(f"setpoint_{k}_MPa" for k in (1, 2, 3)), "pressure_1_MPa")
"""Columns that a log must have."""


def load_log(path: str | Path) -> pandas.DataFrame:
    """Read a log that `HostRun.save` has written.

    Raises
    ------
    InputError
        If the file is not such a log.
    MissingExtraError
        If ``pyarrow`` is not installed.
    """
    import pandas

    _need_parquet()
    try:
        table = pandas.read_parquet(path)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except Exception as error:  # pyarrow raises errors of many kinds
        raise InputError(f"{path}: this is no Parquet file: {str(error).splitlines()[0]}") from None
    missing = [name for name in LOG_COLUMNS if name not in table]
    if missing or not len(table):
        raise InputError(
            f"{path}: this is no log of a rig: it lacks {missing[0] if missing else 'rows'}"
        )
    return table


def _need_parquet() -> None:
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        raise MissingExtraError("pyarrow", "parquet") from None


class Host:
    """A connection to a board.

    Parameters
    ----------
    link : Link
        The bytes to and from the board.
    period : float
        Of the host's loop, in [0.001, 0.05] s. A board trips after 0.1 s without set-points.

    Raises
    ------
    InputError
        If the period is not legal.
    """

    def __init__(self, link: Link, *, period: float = 0.01) -> None:
        self.link = link
        self.period = check_number("period", period, low=1e-3, high=0.05, unit="s")
        self.telemetry: Telemetry | None = None
        self.reader = FrameReader()
        self._answers: list[Frame] = []
        self._sequence = 0

    def connect(self) -> Configuration:
        """Wait for the board, check its protocol, and return its configuration.

        Raises
        ------
        InputError
            If no board answers, or one of another version of the protocol.
        """
        end = self.link.now + BOOT_LIMIT
        while self.telemetry is None or self.telemetry.state is State.BOOT:
            if self.link.now > end:
                raise InputError(f"no telemetry within {BOOT_LIMIT:g} s: is it a board of Bozzini?")
            self._pause()
        found = self._ask(GetConfiguration(), Configuration)
        if found.version != PROTOCOL_VERSION:
            raise InputError(
                f"the board's protocol is version {found.version}: this host has version "
                f"{PROTOCOL_VERSION}; see bozzini rig flash"
            )
        interval = max(1, min(255, round(500.0 * self.period)))
        self.command(TelemetryInterval(interval))
        return found

    def arm(self) -> None:
        """Arm the board, with all set-points at 0.

        Raises
        ------
        InputError
            If it does not arm; the message has the reason.
        """
        self.send(SetPoint((0.0, 0.0, 0.0)))
        self.command(Arm())
        self._wait_for(State.ARMED)

    def disarm(self) -> None:
        """Vent all muscles."""
        self.command(Disarm())
        self._wait_for(State.DISARMED)

    def clear(self) -> None:
        """Leave the fault state.

        Raises
        ------
        InputError
            If the cause, or pressure, is still present.
        """
        self.command(Clear())
        self._wait_for(State.DISARMED)

    def command(self, command: Command) -> None:
        """Send a command and wait for the answer.

        Raises
        ------
        InputError
            If the board refuses it, or does not answer.
        """
        reply = self._ask(command, Reply)
        if reply.outcome is not Outcome.OK:
            words = reply.outcome.name.lower().replace("_", " ")
            raise InputError(
                f"the board refuses {type(command).__name__}: {words}{self.describe_state()}"
            )

    def run(
        self, control: Control, duration: float, *, progress: Progress = no_progress
    ) -> HostRun:
        """Run a control in time, each period, from armed to disarmed.

        The control runs in one thread with all input and output, or, over a link without a clock
        of its own, in the caller's. If it hangs, the board receives nothing and vents. A period
        that was missed is counted and not made up for.

        Parameters
        ----------
        control : callable
            See `Control`.
        duration : float
            How long, in (0, 86400] s.
        progress : callable
            Is told how far the run is.

        Raises
        ------
        InputError
            If the duration is not legal, or the board refuses to arm.
        """
        try:
            return self.run_armed(control, duration, progress=progress)
        finally:
            self.send(Disarm())

    def run_armed(
        self, control: Control, duration: float, *, progress: Progress = no_progress
    ) -> HostRun:
        """Do as `run` does, but leave the board armed: it vents 0.1 s after the end."""
        span = check_number("duration", duration, low=0.0, low_open=True, high=86400.0, unit="s")
        self.arm()
        loop = _Loop(self, control, span)
        if self.link.real_time:
            loop.run_beside(progress)
        else:
            loop.run(progress)
        if loop.error is not None:
            raise loop.error
        return loop.finish()

    def _wait_for(self, state: State) -> None:
        """Wait until the telemetry shows a state that the board has agreed to."""
        end = self.link.now + ANSWER_LIMIT
        while self.telemetry is None or self.telemetry.state is not state:
            if self.link.now > end:
                raise InputError(f"the board does not become {state.name}{self.describe_state()}")
            self._pause()

    def describe_state(self) -> str:
        """Return the board's state for a message, empty if it is not known."""
        if self.telemetry is None:
            return ""
        words = f"; it is {self.telemetry.state.name}"
        if self.telemetry.faults:
            words += f" ({describe_faults(self.telemetry.faults)})"
        return words

    def _ask(self, command: Command, kind: type[_Frame]) -> _Frame:
        """Send a command and return its answer."""
        self._answers.clear()
        self.send(command)
        end = self.link.now + ANSWER_LIMIT
        while self.link.now <= end:
            self._pause()
            for frame in self._answers:
                if isinstance(frame, kind) and getattr(frame, "kind", command.kind) == command.kind:
                    return frame
        raise InputError(
            f"the board does not answer {type(command).__name__} within {ANSWER_LIMIT:g} s"
        )

    def _pause(self) -> None:
        self.link.wait(self.link.now + POLL)
        self.receive()

    def receive(self) -> None:
        """Take what has come from the board."""
        for frame in self.reader.read(self.link.read()):
            if isinstance(frame, Telemetry):
                self.telemetry = frame
            else:
                self._answers.append(frame)

    def send(self, command: Command) -> None:
        """Send a frame without waiting for an answer."""
        self.link.write(command.encode(self._sequence))
        self._sequence = (self._sequence + 1) % 256


class _Loop:
    """The periods of one run."""

    def __init__(self, host: Host, control: Control, duration: float) -> None:
        self.host, self.control = host, control
        self.count = max(1, round(duration / host.period))
        self.rows: list[Json] = []
        self.ticks: list[float] = []
        self.late = 0
        self.reason = ""
        self.error: BaseException | None = None
        self.done = 0
        self.begin = 0.0
        self.stop = threading.Event()
        self.before = _count_losses(host)
        self.start = datetime.now(UTC)

    def run_beside(self, progress: Progress) -> None:
        """Run in a thread of its own; an interrupt ends it."""
        thread = threading.Thread(target=self._run_caught, daemon=True)
        thread.start()
        try:
            while thread.is_alive():
                thread.join(0.1)
                progress("running", self.done / self.count)
        finally:
            self.stop.set()
            thread.join()

    def _run_caught(self) -> None:
        try:
            self.run(no_progress)
        except BaseException as error:  # raised again where the thread is joined
            self.error = error

    def run(self, progress: Progress) -> None:
        """Run all periods, or up to a fault."""
        host, link = self.host, self.host.link
        begin = self.begin = link.now
        command = SetPoint((0.0, 0.0, 0.0))
        while self.done < self.count and not self.stop.is_set():
            due = begin + self.done * host.period
            link.wait(due)
            now = link.now
            host.receive()
            host.send(command)
            told = host.telemetry
            if told is None or told.state is not State.ARMED:
                self.reason = f"the board has left ARMED{host.describe_state()}"
                return
            command, more = self.control(now - begin, told)
            self.ticks.append(now - begin)
            self.rows.append(_list_columns(now - begin, command, told) | more)
            behind = now - due
            self.late += behind > 0.5 * host.period
            self.done += 1
            skipped = min(
                int((link.now - begin) / host.period) - self.done + 1, self.count - self.done
            )
            if skipped > 1:  # periods that are over already are not made up for
                self.late += skipped - 1
                self.done += skipped - 1
            progress("running", self.done / self.count)

    def finish(self) -> HostRun:
        """Return the run."""
        lost, bad, gaps, refused = np.array(_count_losses(self.host)) - self.before
        return HostRun(
            rows=self.rows,
            start=self.start,
            link_start=self.begin,
            period=self.host.period,
            ticks=np.array(self.ticks),
            late=self.late,
            lost=int(lost) % 256,
            bad=int(bad),
            gaps=int(gaps),
            refused=int(refused) % 65536,
            reason=self.reason,
        )


def _count_losses(host: Host) -> tuple[int, int, int, int]:
    """Return the counters of lost, bad, missing and refused frames up to now."""
    told = host.telemetry
    lost, refused = (told.lost, told.bad + told.gaps) if told else (0, 0)
    return lost, host.reader.bad, host.reader.gaps, refused


def _list_columns(time: float, command: SetPoint, told: Telemetry) -> Json:
    """Return the columns of a row of the log."""
    columns: Json = {"time_s": time, "board_time_s": told.time, "state": told.state.name}
    columns["faults"] = describe_faults(told.faults)
    for name, values in (("setpoint", command.pressures), ("pressure", told.pressures)):
        columns |= {f"{name}_{k}_MPa": value for k, value in enumerate(values, 1)}
    columns["reservoir_MPa"] = told.reservoir_pressure
    columns |= {"stick_x": told.stick[0], "stick_y": told.stick[1]}
    for name, values in (("fill", told.fill), ("bleed", told.bleed)):
        columns |= {f"{name}_{k}": value for k, value in enumerate(values, 1)}
    return columns


def describe_faults(faults: Fault) -> str:
    """Return the names of faults, empty if there is none."""
    return ", ".join(str(fault.name).lower() for fault in Fault if fault & faults)
