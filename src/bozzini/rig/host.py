"""The host: connects to a board, arms it, sends set-points in time and logs what comes back."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_number
from ..errors import InputError
from ..io.files import check_parquet, write_parquet
from ..io.sheets import read_sheet, take_numbers, write_table
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import Json, ReasonedResult, Result, take_axes
from .link import Link
from .protocol import (
    PROTOCOL_VERSION,
    Arm,
    Clear,
    Command,
    Configuration,
    Disarm,
    Echo,
    EchoReply,
    Frame,
    FrameReader,
    GetConfiguration,
    Outcome,
    Reply,
    SetPoint,
    State,
    Telemetry,
    TelemetryInterval,
    Trip,
)

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

_Frame = TypeVar("_Frame", bound=Frame)

ANSWER_LIMIT = 0.5
"""Time within which the board must answer a command [s]."""
BOOT_LIMIT = 3.0
"""Time within which the board must send telemetry after its port is opened [s]."""
EMPTY_LIMIT = 2.0
"""Time for the muscles to be vented before a fault is cleared [s]."""
EMPTY = 0.02
"""Gauge pressure below which a muscle counts as empty [MPa]; the board accepts 0.05."""
SILENCE_LIMIT = 0.5
"""Time without telemetry after which a run ends [s]: its pressures would be old ones."""
POLL = 1e-3
"""Time between two looks for an answer [s]."""

Control = Callable[[float, Telemetry], tuple[SetPoint, Json]]
"""What is run each period: takes the time of the run [s] and the last telemetry, returns the
set-points and further columns of the log."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HostRun(ReasonedResult):
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
    def residual(self) -> float:
        """Largest deviation of a period from the one asked for [s]."""
        return float(np.abs(self.periods - self.period).max(initial=0.0))

    @property
    def periods(self) -> Floats:
        """Times between ticks [s]."""
        return np.diff(self.ticks)

    @cached_property
    def tip_errors(self) -> Floats:
        """Distances of the tip from its targets [mm]; empty if the log has no targets."""
        if not self.rows or "target_x_mm" not in self.rows[0]:
            return np.zeros(0)
        names = ("tip_x_mm", "target_x_mm", "tip_y_mm", "target_y_mm")
        x, wanted_x, y, wanted_y = (np.array([row[name] for row in self.rows]) for name in names)
        return np.asarray(np.hypot(x - wanted_x, y - wanted_y))

    @property
    def tip_error_rms(self) -> float:
        """Root mean square of `tip_errors` [mm]; 0 if there are none."""
        return float(np.sqrt(np.mean(self.tip_errors**2))) if self.tip_errors.size else 0.0

    @property
    def tip_error_max(self) -> float:
        """Largest of `tip_errors` [mm]; 0 if there are none."""
        return float(self.tip_errors.max(initial=0.0))

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
            "tip_error_rms_mm": self.tip_error_rms if self.tip_errors.size else None,
            "tip_error_max_mm": self.tip_error_max if self.tip_errors.size else None,
        }

    def list_columns(self) -> Json:
        """Return the columns of `to_frame`, a row each period, with the time of day."""
        if not self.rows:
            return {}
        times = [self.start + timedelta(seconds=row["time_s"]) for row in self.rows]
        names = dict.fromkeys(name for row in self.rows for name in row)
        return {"utc": times, **{name: [row.get(name) for row in self.rows] for name in names}}

    def to_frame(self) -> pandas.DataFrame:
        """Return the log as a table of pandas, the counters in its attributes."""
        table = super().to_frame()
        table.attrs = {**self.to_dict(), "log": LOG_VERSION}
        return table

    def save(self, path: str | Path) -> Path:
        """Write the log as a table (.parquet or .csv); `load_log` reads both.

        Raises
        ------
        MissingExtraError
            If it is Parquet and ``pyarrow`` is not installed.
        OutputError
            If the file cannot be written.
        """
        if Path(path).suffix.lower() == ".csv":
            return write_table(path, self.list_columns())
        check_parquet()
        return write_parquet(path, self.to_frame())

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw set-points and measured pressures over time, and return the axes."""
        axes = take_axes(ax, x="time [s]", y="pressure [kPa]")
        table = {name: np.array(values) for name, values in self.list_columns().items()}
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
LOG_COLUMNS = (
    "time_s",
    *(f"{name}_{k}_MPa" for name in ("setpoint", "pressure") for k in (1, 2, 3)),
)
"""Columns that a log must have."""


def load_log(path: str | Path) -> dict[str, Floats]:
    """Read times, set-points and pressures, see `LOG_COLUMNS`, of a log that `save` has written.

    Raises
    ------
    InputError
        If the file is not such a log.
    MissingExtraError
        If it is Parquet and ``pyarrow`` is not installed.
    """
    sheet = read_sheet(Path(path))
    missing = [name for name in LOG_COLUMNS if name not in sheet.titles]
    if missing or not sheet.rows:
        words = missing[0] if missing else "rows"
        raise InputError(f"{path}: this is no log of a rig: it lacks {words}")
    where = f"{path}: "
    return {n: take_numbers(sheet, sheet.titles.index(n), where=where) for n in LOG_COLUMNS}


@dataclass(frozen=True, kw_only=True, eq=False)
class Replay(Result):
    """A run with the set-points of a log, and how far its pressures are from those of the log.

    Attributes
    ----------
    run : HostRun
        The run.
    differences : (n, 3) ndarray
        Pressures of the run less those of the log, at the same times [MPa].
    """

    run: HostRun
    differences: Floats

    @property
    def converged(self) -> bool:
        """Whether the run went to its end."""
        return self.run.converged

    @property
    def reason(self) -> str:
        """Why it did not."""
        return self.run.reason

    @property
    def residual(self) -> float:
        """Largest difference [MPa]."""
        return float(np.abs(self.differences).max(initial=0.0))

    @property
    def rms(self) -> float:
        """Root mean square of the differences [MPa]."""
        return float(np.sqrt(np.mean(self.differences**2))) if self.differences.size else 0.0

    def to_dict(self) -> Json:
        """Return the differences and the counters of the run as plain values."""
        return {"rms_MPa": self.rms, "largest_MPa": self.residual, **self.run.to_dict()}

    def list_columns(self) -> Json:
        """Return the columns of `to_frame`: those of the log of the run, and the differences."""
        more = {f"difference_{k + 1}_MPa": self.differences[:, k] for k in range(3)}
        return self.run.list_columns() | more

    def save(self, path: str | Path) -> Path:
        """Write the log of the run; see `HostRun.save`."""
        return self.run.save(path)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the run; see `HostRun.plot`."""
        return self.run.plot(ax)


def replay_log(
    link: Link, log: Mapping[str, ArrayLike], *, progress: Progress = no_progress
) -> Replay:
    """Send the set-points of a log again, each held until the next.

    Parameters
    ----------
    link : Link
        To the board.
    log : mapping or DataFrame
        As `load_log` returns it.
    progress : callable
        Is called with how far it is.

    Raises
    ------
    InputError
        If the times of the log do not increase, a set-point is not legal, or the board does not
        arm.
    """
    times = np.asarray(log["time_s"], dtype=np.float64)
    steps = np.diff(times)
    if not np.all(steps > 0.0):
        raise InputError("the times of the log do not increase")
    wanted = np.transpose([log[f"setpoint_{k}_MPa"] for k in (1, 2, 3)]).astype(np.float64)
    commands = [SetPoint(tuple(row)) for row in wanted.tolist()]
    period = float(np.median(steps)) if steps.size else 0.01
    host = Host(link, period=min(max(period, 1e-3), 0.05))
    host.connect()

    def control(time: float, board: Telemetry) -> tuple[SetPoint, Json]:
        index = int(np.searchsorted(times - times[0], time + 1e-9)) - 1
        return commands[max(index, 0)], {}

    run = host.run(control, times[-1] - times[0] + host.period, progress=progress)
    measured = np.array([[row[f"pressure_{k}_MPa"] for k in (1, 2, 3)] for row in run.rows])
    known = [np.asarray(log[f"pressure_{k}_MPa"], dtype=np.float64) for k in (1, 2, 3)]
    before = [np.interp(run.ticks, times - times[0], values) for values in known]
    return Replay(run=run, differences=measured.reshape(-1, 3) - np.transpose(before))


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
        while self.state is State.BOOT:
            if self.link.now > end:
                hint = self._describe_foreign() or ": is it a board of Bozzini?"
                raise InputError(f"no telemetry within {BOOT_LIMIT:g} s{hint}")
            self.pause()
        found = self.ask(GetConfiguration(), Configuration)
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
        """Leave the fault state, once the muscles are empty.

        Raises
        ------
        InputError
            If the cause, or pressure, is still present.
        """
        end = self.link.now + EMPTY_LIMIT
        while self.telemetry and max(self.telemetry.pressures) > EMPTY and self.link.now < end:
            self.pause()
        self.send(SetPoint((0.0, 0.0, 0.0)))  # the host is there again
        self.command(Clear())
        self._wait_for(State.DISARMED)

    def command(self, command: Command) -> None:
        """Send a command and wait for the answer.

        Raises
        ------
        InputError
            If the board refuses it, or does not answer.
        """
        reply = self.ask(command, Reply)
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
            Is called with how far it is.

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
        while self.state is not state:
            if self.link.now > end:
                raise InputError(f"the board does not become {state.name}{self.describe_state()}")
            self.pause()

    def describe_state(self) -> str:
        """Return the board's state for a message."""
        words = f"; it is {self.state.name}"
        return f"{words} ({describe_faults(self.faults)})" if self.faults else words

    def ask(self, command: Command, kind: type[_Frame]) -> _Frame:
        """Send a command and return its answer.

        Raises
        ------
        InputError
            If there is none.
        """
        self.send(command)
        return self.wait_for(kind, command.kind)

    def wait_for(self, kind: type[_Frame], answered: int) -> _Frame:
        """Return the next frame of a kind that answers a type of command.

        Raises
        ------
        InputError
            If there is none.
        """
        self._answers.clear()
        end = self.link.now + ANSWER_LIMIT
        while self.link.now <= end:
            self.pause()
            for frame in self._answers:
                if isinstance(frame, kind) and getattr(frame, "kind", answered) == answered:
                    return frame
        raise InputError(
            f"the board does not answer a frame of type {answered:#04x} within {ANSWER_LIMIT:g} s"
            f"{self._describe_foreign()}"
        )

    def _describe_foreign(self) -> str:
        """Return the hint that the board speaks another version; empty if nothing shows it."""
        count = self.reader.foreign
        return (
            f": {count} frames of a right CRC are not of version {PROTOCOL_VERSION} of the "
            "protocol, the host's; see bozzini rig flash"
            if count
            else ""
        )

    def time_echo(self) -> float:
        """Return how long an echo takes [s]."""
        begin = self.link.now
        self.ask(Echo(b"echo"), EchoReply)
        return self.link.now - begin

    @property
    def state(self) -> State:
        """The board's state, as last reported."""
        return State.BOOT if self.telemetry is None else self.telemetry.state

    @property
    def faults(self) -> Trip:
        """The board's faults, as last reported."""
        return Trip.NONE if self.telemetry is None else self.telemetry.faults

    def pause(self) -> None:
        """Let a little time pass, and take what has come from the board."""
        self.link.wait(self.link.now + POLL)
        self.receive()

    def receive(self) -> None:
        """Take what has come from the board."""
        for frame in self.reader.read(self.link.read()):
            if isinstance(frame, Telemetry):
                self.telemetry = frame
            else:
                self._answers.append(frame)

    def send(self, command: Command) -> int:
        """Send a frame without waiting for an answer, and return its number."""
        number = self._sequence
        self.link.write(command.encode(number))
        self._sequence = (number + 1) % 256
        return number


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
        """Run all periods, or up to a fault or a board that goes silent."""
        host, link = self.host, self.host.link
        begin = self.begin = heard_at = link.now
        heard = host.telemetry
        while self.done < self.count and not self.stop.is_set():
            due = begin + self.done * host.period
            link.wait(due)
            now = link.now
            host.receive()
            telemetry = host.telemetry
            if telemetry is None or telemetry.state is not State.ARMED:
                self.reason = f"the board has left ARMED{host.describe_state()}"
                return
            if telemetry is not heard:
                heard, heard_at = telemetry, now
            elif now - heard_at > SILENCE_LIMIT:
                self.reason = f"the board has been silent for {now - heard_at:.2g} s"
                return
            command, more = self.control(now - begin, telemetry)
            host.send(command)
            self.ticks.append(now - begin)
            self.rows.append(_list_columns(now - begin, command, telemetry) | more)
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
    last = host.telemetry
    lost, refused = (last.lost, last.bad + last.gaps) if last else (0, 0)
    return lost, host.reader.bad, host.reader.gaps, refused


def _list_columns(time: float, command: SetPoint, board: Telemetry) -> Json:
    """Return the columns of a row of the log."""
    columns: Json = {"time_s": time, "board_time_s": board.time, "state": board.state.name}
    columns["faults"] = describe_faults(board.faults)
    for name, values in (("setpoint", command.pressures), ("pressure", board.pressures)):
        columns |= {f"{name}_{k}_MPa": value for k, value in enumerate(values, 1)}
    columns["reservoir_MPa"] = board.reservoir_pressure
    columns |= {"stick_x": board.stick[0], "stick_y": board.stick[1]}
    for name, values in (("fill", board.fill), ("bleed", board.bleed)):
        columns |= {f"{name}_{k}": value for k, value in enumerate(values, 1)}
    return columns


def describe_faults(faults: Trip) -> str:
    """Return the names of faults, empty if there is none."""
    return ", ".join(str(fault.name).lower() for fault in Trip if fault & faults)
