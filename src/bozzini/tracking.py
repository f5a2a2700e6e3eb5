"""Paths across the axis that tips are led along, and how near controllers keep to them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from .numeric.arrays import Floats
from .results import Json, ReasonedResult, format_rows, list_row, tabulated, take_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class _Row(Protocol):
    @property
    def controller(self) -> str: ...

    @property
    def rms(self) -> float: ...


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackedPaths(ReasonedResult):
    """Paths of a tip by controllers side by side, in simulation.

    Attributes
    ----------
    rows : sequence
        How each controller did.
    times : ndarray, shape (n,)
        Times [s].
    wanted : ndarray, shape (n, 2)
        Lateral places [mm].
    tips : ndarray, shape (c, n, 2)
        Those of the tip by each controller [mm].
    notes : tuple of str
        What is not in the model.
    """

    rows: Sequence[_Row]
    times: Floats = tabulated("s", "time")
    wanted: Floats
    tips: Floats
    notes: tuple[str, ...] = ()

    reason = ""
    residual = 0.0

    def to_dict(self) -> Json:
        """Return how the controllers did as plain values."""
        rows = {row.controller: list_row(row) for row in self.rows}
        for values in rows.values():
            del values["controller"]
        return {"controllers": rows, "notes": list(self.notes)}

    def format_rows(self, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
        """Return a table of the controllers, and the notes."""
        return "\n".join([format_rows(head, rows), *(f"note: {text}" for text in self.notes)])

    def list_columns(self) -> Json:
        """Return the columns of `to_frame`, a row for each time."""
        columns = dict(super().list_columns())
        for k, axis in enumerate("xy"):
            columns[f"wanted_{axis}_mm"] = self.wanted[:, k]
            for row, tip in zip(self.rows, self.tips, strict=True):
                columns[f"{row.controller} {axis}_mm"] = tip[:, k]
        return columns

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the last turn as wanted and as tracked, seen along the axis; return the axes."""
        axes = take_axes(ax, x="x [mm]", y="y [mm]", equal=True)
        half = len(self.times) // 2
        axes.plot(*self.wanted[half:].T, "k--", label="wanted", zorder=3)
        for row, tip in zip(self.rows, self.tips, strict=True):
            axes.plot(*tip[half:].T, label=f"{row.controller}, {row.rms:.2f} mm rms")
        axes.legend(loc="center", fontsize="x-small")
        return axes


def trace_places(kind: str, *, radius: float, frequency: float, period: float) -> Floats:
    """Return places (n, 2), a period apart, of two turns of a circle, or of a line [mm]."""
    turn = max(round(1.0 / (frequency * period)), 2)
    phases = 2.0 * math.pi * np.arange(2 * turn + 1) / turn
    across = np.sin(phases) if kind == "circle" else 0.0 * phases
    return np.asarray(radius * np.stack([np.cos(phases), across], axis=-1))


def measure_distances(off: Floats) -> Floats:
    """Return the distances (n,) after the first half of misses."""
    return np.asarray(np.hypot(*off[len(off) // 2 :].T))


def find_rms(off: Floats) -> float:
    """Return the root mean square."""
    return math.sqrt(float(np.mean(np.square(off))))
