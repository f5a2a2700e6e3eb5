"""The motion of a fitted end-effector under a table of commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import quantity
from ..errors import InputError
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import ReasonedResult, measured, tabulated, take_axes
from ..task import Task
from .files import read_effector
from .measured import read_effector_measurements

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CHANNELS = ("tip x", "tip y", "tip z", "bend", "spot x", "spot y")


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedRuns(ReasonedResult):
    """Runs of a table, as an end-effector moves under their commands.

    Attributes
    ----------
    runs : ndarray of str, shape (n,)
        Run of each row.
    times : ndarray, shape (n,)
        Times [s].
    tip : ndarray, shape (n, 3)
        End of the backbone, in the frame of whoever looks [mm].
    bend : ndarray, shape (n,)
        Angle between the end's direction and the axis [rad].
    spot : ndarray, shape (n, 2)
        Reading of a pointer on the board of the fit [mm].
    channels : tuple of str
        What the rest of the fit is of; none without a rest.
    rest : ndarray, shape (n, q)
        What the rest adds to those, and is not in the others [mm, rad].
    largest_lateral : float
        Largest distance of the tip from the axis of the base [mm].
    """

    runs: NDArray[np.str_] = tabulated("", "run")
    times: Floats = tabulated("s", "time")
    tip: Floats = tabulated("mm", "tip_{}")
    bend: Floats = tabulated("rad")
    spot: Floats
    channels: tuple[str, ...] = ()
    rest: Floats
    largest_lateral: float = measured("mm")

    reason = ""
    residual = 0.0

    def list_columns(self) -> Mapping[str, object]:
        """Return the columns of `to_frame`, a row for each time."""
        spots = {f"spot_{axis}_mm": self.spot[:, k] for k, axis in enumerate("xy")}
        rests = {f"rest of {name}": self.rest[:, k] for k, name in enumerate(self.channels)}
        return {**super().list_columns(), **spots, **rests}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw both lateral coordinates of the tip over time, and return the axes."""
        axes = take_axes(ax, x="time [s]", y="tip, lateral [mm]")
        for name in dict.fromkeys(self.runs.tolist()):
            own = self.runs == name
            for k, axis in enumerate("xy"):
                axes.plot(self.times[own], self.tip[own, k], f"C{k}", label=f"{name} {axis}")
        axes.legend()
        return axes


@dataclass(frozen=True, kw_only=True)
class EffectorSimulation(Task):
    """Simulate a fitted end-effector under commands in time.

    COMMANDS has 'time [s]', and 'R pressure [kPa]' or 'command R [V]' of each muscle; runs are
    named in 'run'. A command holds from its time to the next. Each run begins with its first
    commands, held long before. What a rest adds that the fit has learned (--rest) stands in columns
    of its own.

    Exit code 0: done; 2: bad input.
    """

    name = "simulate"
    group = "effector"
    result = SimulatedRuns

    fit: str = quantity("file", "A file of 'bozzini effector fit --out'.")
    commands: str = quantity("file", "A table of commands over time.")

    def run(self, progress: Progress = no_progress) -> SimulatedRuns:
        """Return the motion of all runs."""
        file = read_effector(self.fit)
        data = read_effector_measurements(
            self.commands, per_volt=file.per_volt or None, seen_needed=False
        )
        if data.times is None or data.command != "pressure":
            raise InputError(
                f"{self.commands} has no column 'time [s]', or commands contractions: a motion "
                "needs pressures over time"
            )
        effector = file.build()
        data.check_range(effector.design.pressure_limit, scale=file.scale)
        columns = dict(zip(data.muscles, file.scale * data.commands.T, strict=True))
        tip, bend = np.empty((len(data), 3)), np.empty(len(data))
        largest = 0.0
        spot, rest = np.empty((len(data), 2)), file.build_rest()
        added = np.zeros((len(data), len(file.rest_channels)))
        for part in data.parts:
            own = {name: column[part] for name, column in columns.items()}
            track = effector.simulate(data.times[part], own)
            seen = file.view.observe(effector, track.bends, channels=CHANNELS)
            if rest is not None:
                added[part] = rest.predict(track.times - track.times[0], track.effective)
            largest = max(largest, float(np.hypot(*track.tip[:, :2].T).max()))
            tip[part], bend[part], spot[part] = seen[:, :3], seen[:, 3], seen[:, 4:]
        return SimulatedRuns(
            runs=data.runs,
            times=data.times,
            tip=tip,
            bend=bend,
            spot=spot,
            channels=file.rest_channels,
            rest=added,
            largest_lateral=largest,
        )

    def describe(self, found: SimulatedRuns) -> str:
        """Return where each run ends."""
        lines = []
        for name in dict.fromkeys(found.runs.tolist()):
            last = np.flatnonzero(found.runs == name)[-1]
            place = ", ".join(f"{value:.2f}" for value in found.tip[last])
            head = f"run {name}: " if name else ""
            lines.append(f"{head}after {found.times[last]:.4g} s the tip is at {place} mm")
        if found.channels:
            size = np.abs(found.rest).max()
            names = ", ".join(found.channels)
            lines.append(f"not in it: what the rest adds to {names}, {size:.3g} at most")
        return "\n".join(lines)
