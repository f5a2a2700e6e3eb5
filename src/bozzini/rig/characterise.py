"""The thesis's experiment on a muscle: pressure in stairs, up and down, and its length (3.2)."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..checks import check_integer, check_number, describe_fields
from ..errors import InputError, OutputError
from ..io.files import write_text
from ..io.sheets import format_table, write_table
from ..muscle.data import Measurements
from ..progress import Progress, no_progress
from ..results import Json, ReasonedResult, Shown, take_axes, to_plain
from .host import Host, describe_faults
from .plant import MUSCLES, Plant
from .protocol import SetPoint, State
from .stairs import Stairs

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Gauge = Callable[[], float]
"""Returns the contraction of the muscle at this moment [mm]."""

SILENCE_LIMIT = 0.2
"""Time without telemetry after which an experiment ends [s]."""
HOOK_POLL = 2e-3
"""Time between two looks whether a program has ended [s]."""


class PlantGauge:
    """Reads a muscle's contraction off the plant, with the error of a picture.

    Parameters
    ----------
    plant : Plant
        The plant.
    muscle : int
        Which muscle, 1 to 3.
    deviation : float
        Standard deviation of a reading [mm]; by default half of the largest error of thesis
        Fig. 3.5, about 0.1 mm.
    seed : int
        Of the errors.
    """

    def __init__(
        self, plant: Plant, muscle: int = 1, *, deviation: float = 0.05, seed: int = 0
    ) -> None:
        self.plant = plant
        self.muscle = check_integer("muscle", muscle, low=1, high=MUSCLES)
        self.deviation = check_number("deviation of a reading", deviation, low=0.0, unit="mm")
        self._random = np.random.default_rng(seed)

    def __call__(self) -> float:
        """Return a reading [mm]."""
        error = self._random.normal(0.0, self.deviation)
        return float(self.plant.contractions[self.muscle - 1] + error)


class PictureSource(Shown, ABC):
    """Takes pictures of the muscle into a folder.

    Attributes
    ----------
    folder : Path
        Where the pictures go; made if there is none, otherwise it must be empty.
    """

    folder: Path

    def check_folder(self) -> None:
        """Check that the folder is empty or can be made.

        Raises
        ------
        OutputError
            If not.
        """
        try:
            empty = not os.path.exists(self.folder) or not any(self.folder.iterdir())
        except OSError as error:
            raise OutputError(f"cannot write {self.folder}: {error.strerror or error}") from None
        if not empty:
            raise OutputError(f"{self.folder} is not empty: pictures need an empty directory")

    @abstractmethod
    def take(self, path: Path, step: Mapping[str, str], *, idle: Callable[[], object]) -> list[str]:
        """Take a picture.

        Parameters
        ----------
        path : Path
            The file to write.
        step : dict
            Texts of the ``pressure`` [MPa], ``direction`` and ``repeat`` of the step.
        idle : callable
            To be called again and again while it waits: the pressure is held by it.

        Returns
        -------
        list of str
            What went wrong.
        """


@dataclass(frozen=True, kw_only=True)
class PictureHook(PictureSource):
    """A program that takes a picture of the muscle at the end of each step.

    It is run without a shell. In its arguments ``{file}`` stands for the picture to write,
    ``{pressure}`` for the set-point [MPa], ``{direction}`` for inflating or deflating, ``{repeat}``
    for the number of the repeat. If it fails, takes too long or writes no picture, the step is
    flagged.

    Parameters
    ----------
    command : str
        Program and arguments, with quotes as in a POSIX shell.
    folder : path-like
        Where the pictures go; made if there is none, otherwise it must be empty.
    timeout : float
        Longest time a picture may take, 0.1 to 600 s.

    Raises
    ------
    InputError
        If the command is no command, has no ``{file}`` or an unknown name in braces, or the
        program is not found.
    """

    command: str
    folder: Path
    timeout: float = 10.0

    def __post_init__(self) -> None:
        check_number("timeout of the hook", self.timeout, low=0.1, high=600.0, unit="s")
        unknown = set(_NAME_IN_BRACES.findall(self.command)) - set(_HOOK_NAMES)
        if unknown or "{file}" not in self.command:
            raise InputError(
                f"hook is '{self.command}': it must have {{file}}, and may have "
                "{pressure}, {direction} and {repeat}"
                + (f", but not {{{min(unknown)}}}" if unknown else "")
            )
        program = self._split()[0]
        if shutil.which(program) is None:
            raise InputError(f"hook is '{self.command}': there is no program '{program}'")
        object.__setattr__(self, "folder", Path(self.folder).absolute())

    def _split(self) -> list[str]:
        try:
            return shlex.split(self.command)
        except ValueError as error:
            raise InputError(f"hook is '{self.command}': {str(error).lower()}") from None

    def take(self, path: Path, step: Mapping[str, str], *, idle: Callable[[], object]) -> list[str]:
        """Run the program in a group of processes of its own; see `PictureSource.take`."""
        values = {**step, "file": str(path)}

        def fill(match: re.Match[str]) -> str:
            return values[match.group(1)]

        none = subprocess.DEVNULL
        try:
            process = subprocess.Popen(
                [_NAME_IN_BRACES.sub(fill, part) for part in self._split()],
                stdin=none,
                stdout=none,
                stderr=none,
                start_new_session=True,
            )
        except OSError as error:
            return [f"hook: {error.strerror or error}"]
        try:
            end = time.monotonic() + self.timeout
            while process.poll() is None and time.monotonic() < end:
                idle()
        finally:
            late = process.poll() is None
            if late:
                _kill(process)
            code = process.wait()
        if late:
            return [f"hook: not done within {self.timeout:g} s"]
        return [f"hook: exit status {code}"] if code else []


_HOOK_NAMES = ("pressure", "direction", "repeat", "file")
_NAME_IN_BRACES = re.compile(r"\{(\w+)\}")


@dataclass(frozen=True, kw_only=True)
class StairStep:
    """A step of the stairs, as it was measured.

    Attributes
    ----------
    repeat : int
        Number of the repeat, from 1.
    direction : str
        ``"inflating"`` or ``"deflating"``.
    setpoint, pressure, deviation : float
        Pressure asked for, mean and standard deviation of that measured at the end [MPa].
    overshoot : float
        How far the pressure went beyond the set-point, in the direction of the step [MPa]; with the
        transducer's noise. A muscle with hysteresis remembers it.
    contraction : float, optional
        At the end [mm]; None without a gauge.
    time : float
        When it ended, since the beginning [s].
    image : str
        Path of the picture; empty without one.
    flags : tuple of str
        What is wrong with it.
    """

    repeat: int
    direction: str
    setpoint: float
    pressure: float
    deviation: float
    overshoot: float
    contraction: float | None
    time: float
    image: str = ""
    flags: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Characterisation(ReasonedResult):
    """What was measured, a step each row; steps that did not settle are flagged, not left out.

    Attributes
    ----------
    stairs : Stairs
        What was asked for.
    rows : tuple of StairStep
        What was measured.
    start : datetime
        When it began (UTC).
    end : str
        Why it ended early; empty if it did not.
    """

    stairs: Stairs
    rows: tuple[StairStep, ...] = field(repr=False)
    start: datetime
    end: str = ""

    @property
    def flagged(self) -> int:
        """How many steps are flagged."""
        return sum(bool(row.flags) for row in self.rows)

    @property
    def reason(self) -> str:
        """Why it ended early, and how many steps are flagged; empty if all is well."""
        words = [self.end] if self.end else []
        if self.flagged:
            first = next(row for row in self.rows if row.flags)
            words.append(
                f"{self.flagged} of {len(self.rows)} steps are flagged, the first at "
                f"{1e3 * first.setpoint:g} kPa, {first.direction}: {', '.join(first.flags)}"
            )
        return "; ".join(words)

    @property
    def residual(self) -> float:
        """Largest difference of a step's mean pressure from its set-point [MPa]."""
        return max((abs(row.pressure - row.setpoint) for row in self.rows), default=0.0)

    @property
    def has_contraction(self) -> bool:
        """Whether the contraction was read, not only pictures taken."""
        return any(row.contraction is not None for row in self.rows)

    def to_dict(self) -> Json:
        """Return the outcome and the columns of the table as plain values."""
        return {
            "converged": self.converged,
            "reason": self.reason,
            "residual_MPa": self.residual,
            "start": self.start.isoformat(),
            "rows": len(self.rows),
            "flagged": self.flagged,
            "stairs": describe_fields(self.stairs),
            "columns": to_plain(self.list_columns()),
        }

    def list_columns(self) -> Mapping[str, object]:
        """Return the columns of `to_frame`, as `bozzini.muscle.read_measurements` takes them.

        A mean pressure below that of the surroundings, an error of the transducer, is 0 there.
        Without a gauge there is no column of contractions.
        """
        rows, count = self.rows, len(self.rows)
        columns: dict[str, object] = {"pressure [MPa]": [max(r.pressure, 0.0) for r in rows]}
        if self.has_contraction:
            columns["contraction [mm]"] = [r.contraction for r in rows]
        return columns | {
            "load [N]": [self.stairs.load] * count,
            "direction": [r.direction for r in rows],
            "specimen": [self.stairs.specimen] * count,
            "repeat": [r.repeat for r in rows],
            "setpoint [MPa]": [r.setpoint for r in rows],
            "deviation [MPa]": [r.deviation for r in rows],
            "overshoot [MPa]": [r.overshoot for r in rows],
            "time [s]": [r.time for r in rows],
            "image": [r.image for r in rows],
            "flags": ["; ".join(r.flags) for r in rows],
        }

    def to_measurements(self) -> Measurements:
        """Return the rows as `bozzini.muscle.calibrate` takes them.

        Raises
        ------
        InputError
            If there is no row, or no contraction was read.
        """
        if not self.has_contraction:
            raise InputError("no contraction was read: measure the pictures first")
        return Measurements(
            pressure=np.array([max(row.pressure, 0.0) for row in self.rows]),
            contraction=np.array([row.contraction for row in self.rows], dtype=np.float64),
            load=np.array(self.stairs.load),
            direction=np.array([row.direction for row in self.rows]),
            specimen=np.array(self.stairs.specimen),
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the table as a .csv or a .parquet file.

        Raises
        ------
        MissingExtraError
            If it is a .parquet file and ``pyarrow`` is not installed.
        OutputError
            If the file cannot be written.
        """
        return write_table(path, self.list_columns())

    def list_pictures(self, folder: str | os.PathLike[str]) -> Json:
        """Return columns of the pictures for ``bozzini vision length``, paths from a folder.

        Each has the pressure measured at it; that command groups the repeats, and compares the
        directions, by the set-point.

        Raises
        ------
        InputError
            If no picture was taken.
        """
        rows = [row for row in self.rows if row.image]
        if not rows:
            raise InputError("no picture was taken")
        short = {"inflating": "inflate", "deflating": "deflate"}
        return {
            "image": [Path(os.path.relpath(r.image, folder)).as_posix() for r in rows],
            "specimen": self.stairs.specimen,
            "pressure_kpa": [1e3 * max(r.pressure, 0.0) for r in rows],
            "setpoint_kpa": [1e3 * r.setpoint for r in rows],
            "direction": [short[r.direction] for r in rows],
            "repeat": [r.repeat for r in rows],
            "load_n": self.stairs.load,
            "note": ["; ".join(r.flags) for r in rows],
        }

    def save_pictures(self, path: str | os.PathLike[str]) -> Path:
        """Write the list of `list_pictures` as a .csv file, paths from its place.

        Raises
        ------
        InputError
            If no picture was taken.
        OutputError
            If the file cannot be written.
        """
        columns = self.list_pictures(Path(path).absolute().parent)
        return write_text(path, format_table(columns))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the contraction, or without it the pressure's error, and return the axes.

        Bars are two standard deviations of the repeats.
        """
        label = "contraction [mm]" if self.has_contraction else "pressure less set-point [kPa]"
        axes = take_axes(ax, x="pressure [kPa]", y=label)
        found: dict[str, dict[float, list[float]]] = {}
        for r in self.rows:
            y = r.contraction if self.has_contraction else 1e3 * (r.pressure - r.setpoint)
            if y is not None:
                found.setdefault(r.direction, {}).setdefault(1e3 * r.setpoint, []).append(y)
        for direction, steps in found.items():
            places = sorted(steps)
            mean = [np.mean(steps[x]) for x in places]
            spread = [2.0 * np.std(steps[x], ddof=len(steps[x]) > 1) for x in places]
            axes.errorbar(places, mean, yerr=spread, fmt="o-", capsize=2, label=direction)
        if self.rows:
            axes.legend(frameon=False)
        return axes


def ignore_result(result: Characterisation) -> None:
    """Do nothing with what was measured before an interruption."""


def characterise_muscle(
    host: Host,
    stairs: Stairs | None = None,
    *,
    gauge: Gauge | None = None,
    camera: PictureSource | None = None,
    keep: Callable[[Characterisation], object] = ignore_result,
    progress: Progress = no_progress,
) -> Characterisation:
    """Move a muscle's pressure in stairs, and measure it at the end of each step.

    The muscles are vented at the end, and when anything interrupts the experiment.

    Parameters
    ----------
    host : Host
        A connection to a board, of hardware or of the plant; `Host.connect` has been called.
    stairs : Stairs, optional
        The steps.
    gauge : callable, optional
        Reads the contraction at the end of each step; on the plant a `PlantGauge`.
    camera : PictureSource, optional
        Takes a picture then, such as a `PictureHook`. In lock-step the clock of the plant stands
        still meanwhile; otherwise the pressure is held.
    keep : callable
        Takes what was measured before an interruption, which then goes on.
    progress : callable
        Is called with how far it is.

    Returns
    -------
    Characterisation
        Also when the board leaves its armed state, or is lost: the reason is in it.

    Raises
    ------
    InputError
        If there is neither a gauge nor a camera, or the board refuses to arm.
    OutputError
        If the folder of the pictures is not empty.
    """
    if gauge is None and camera is None:
        raise InputError("there is neither a gauge nor a camera: nothing of the muscle is measured")
    run = _Run(host, stairs or Stairs(), gauge, camera)
    if camera is not None:
        camera.check_folder()
    host.arm()
    try:
        run.measure(progress)
    except InputError as error:  # the board has failed or is lost
        run.end = str(error)
    except BaseException:
        run.end = "interrupted"
        try:
            run.vent()
        finally:
            keep(run.finish())
        raise
    run.vent()
    return run.finish()


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End a program and what it has started."""
    if sys.platform == "win32":
        process.kill()
    else:
        os.killpg(process.pid, signal.SIGKILL)


class _Run:
    """An experiment under way."""

    def __init__(
        self, host: Host, stairs: Stairs, gauge: Gauge | None, camera: PictureSource | None
    ) -> None:
        self.host, self.stairs, self.gauge, self.camera = host, stairs, gauge, camera
        self.rows: list[StairStep] = []
        self.start = datetime.now(UTC)
        self.end = ""
        self.setpoint = SetPoint((0.0,) * MUSCLES)
        self.heard = host.telemetry
        self.heard_at = host.link.now

    def measure(self, progress: Progress) -> None:
        """Go through all steps."""
        stairs, link = self.stairs, self.host.link
        steps = stairs.list_steps()
        begin = link.now
        count = max(1, round(stairs.hold / self.host.period))
        used = max(1, round(stairs.window * count))
        for index, (repeat, direction, setpoint) in enumerate(steps):
            wanted = [0.0] * MUSCLES
            wanted[stairs.muscle - 1] = setpoint
            self.setpoint = SetPoint(wanted)
            pressures = []
            for tick in range(count):
                pressures.append(self._tick())
                progress("measuring", (index + (tick + 1) / count) / len(steps))
            mean, spread = float(np.mean(pressures[-used:])), float(np.std(pressures[-used:]))
            beyond = np.array(pressures) - setpoint
            overshoot = beyond.max() if direction == "inflating" else -beyond.min()
            flags = self._judge(mean - setpoint, spread)
            contraction = None if self.gauge is None else float(self.gauge())
            ended = link.now - begin
            image, trouble = self._take_picture(index, repeat, direction, setpoint)
            self.rows.append(
                StairStep(
                    repeat=repeat,
                    direction=direction,
                    setpoint=setpoint,
                    pressure=mean,
                    deviation=spread,
                    overshoot=max(float(overshoot), 0.0),
                    contraction=contraction,
                    time=ended,
                    image=image,
                    flags=(*flags, *trouble),
                )
            )

    def _judge(self, error: float, spread: float) -> list[str]:
        flags = []
        if abs(error) > self.stairs.tolerance:
            flags.append(f"not settled: mean off by {1e3 * error:.1f} kPa")
        if spread > self.stairs.deviation:
            flags.append(f"not settled: deviation {1e3 * spread:.1f} kPa")
        return flags

    def _tick(self) -> float:
        """Hold the set-point for a period, and return the muscle's pressure [MPa]."""
        host, link = self.host, self.host.link
        link.wait(link.now + host.period)
        host.receive()
        host.send(self.setpoint)
        if host.telemetry is not self.heard:
            self.heard, self.heard_at = host.telemetry, link.now
        if self.heard is None or link.now - self.heard_at > SILENCE_LIMIT:
            raise InputError("the board has gone silent")
        if self.heard.state is not State.ARMED:
            words = describe_faults(self.heard.faults)
            raise InputError(f"the board has left ARMED: {words or self.heard.state.name}")
        return float(self.heard.pressures[self.stairs.muscle - 1])

    def _take_picture(
        self, index: int, repeat: int, direction: str, setpoint: float
    ) -> tuple[str, tuple[str, ...]]:
        """Return the path of a picture and what went wrong; the pressure is held meanwhile."""
        if self.camera is None:
            return "", ()
        name = f"{index + 1:04d}-{direction}-{1e3 * setpoint:.1f}kPa.png"
        path = self.camera.folder / name
        step = {"pressure": f"{setpoint:.6g}", "direction": direction, "repeat": str(repeat)}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            return "", (f"picture: {error.strerror or error}",)
        trouble = self.camera.take(path, step, idle=self._idle)
        if not os.path.isfile(path) or not path.stat().st_size:
            return "", (*trouble, "no picture")
        return str(path), tuple(trouble)

    def _idle(self) -> None:
        """Hold the pressure; the plant's clock stands still in lock-step."""
        if self.host.link.real_time:
            self._tick()
        else:
            time.sleep(HOOK_POLL)

    def vent(self) -> None:
        """Let the board vent; one that is lost vents by itself."""
        try:
            if self.heard is not None and self.heard.state is State.ARMED:
                self.host.disarm()
        except InputError as error:
            self.end = self.end or f"the board was lost at the end: {error}"

    def finish(self) -> Characterisation:
        return Characterisation(
            stairs=self.stairs, rows=tuple(self.rows), start=self.start, end=self.end
        )
