"""Figures of a fitted end-effector: traces, errors over time, loops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .style import BLUE, INK, RED, make_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..effector.fit import EffectorFit

SHOWN = 2000
"""Rows of a run that are shown."""


def draw_fit(fit: EffectorFit) -> Figure:
    """Draw what was seen and fitted, the errors, and the loops over the commands, of a run."""
    data, found = fit.prediction.data, fit.prediction.predicted
    rows = np.arange(len(data))[data.parts[0]][:SHOWN] if data.times is not None else np.arange(
        len(data))  # fmt: skip
    over = rows if data.times is None else data.times[rows]
    figure, (traces, errors, loops) = make_panels(1, 3, size=(14.4, 4.2))
    colors = (BLUE, RED, INK)
    name = "row" if data.times is None else "time [s]"
    look = "o" if data.times is None else "-"
    for k, channel in enumerate(data.channels):
        color = colors[k % len(colors)]
        traces.plot(over, data.seen[rows, k], look, color=color, label=channel, markersize=3)
        traces.plot(over, found[rows, k], "--" if look == "-" else "x", color=INK, linewidth=0.8)
        errors.plot(over, (found - data.seen)[rows, k], look, color=color, markersize=3,
                    linewidth=0.8)  # fmt: skip
    moved = int(np.argmax(np.ptp(data.commands[rows], axis=0)))
    shown = int(np.argmax(np.nan_to_num(np.ptp(found[rows], axis=0))))
    scale = 1e3 if data.command == "pressure" else 1.0
    at = scale * data.commands[rows, moved]
    loops.plot(at, data.seen[rows, shown], look, color=BLUE, linewidth=0.8, markersize=3)
    loops.plot(at, found[rows, shown], "--" if look == "-" else "x", color=INK, linewidth=0.8)
    traces.set(xlabel=name, ylabel="seen, fitted (dashed)")
    errors.set(xlabel=name, ylabel="fitted less seen")
    unit = "kPa" if data.command == "pressure" else "mm"
    loops.set(xlabel=f"command {data.muscles[moved]} [{unit}]", ylabel=data.channels[shown])
    traces.legend()
    return figure
