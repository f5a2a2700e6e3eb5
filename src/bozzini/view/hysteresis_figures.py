"""Figures of hysteresis: loops of operators, and a fit against the loops measured.

Drawn with matplotlib's objects only (no pyplot). Every function returns a `Figure`, which
`bozzini.view.write_figure` writes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array
from ..errors import InputError
from .palette import AMBER, INK, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..muscle.hysteresis import Hysteresis, HysteresisFit

__all__ = ["draw_fit", "draw_loops", "fade_loops"]

_BLUE = "#1f5fa8"
_GRID = "#e3e8ed"


def fade_loops(
    largest: float, *, smallest: float = 0.0, loops: int = 4, count: int = 60
) -> NDArray[np.float64]:
    """Return a history of loops that shrink, each from `smallest` less far than the one before.

    Parameters
    ----------
    largest, smallest : float
        Turning points of the first loop.
    loops : int
        How many.
    count : int
        Samples of each branch.
    """
    parts: list[NDArray[np.float64]] = []
    for loop in range(loops):
        top = smallest + (largest - smallest) * (1.0 - loop / loops)
        up = np.linspace(smallest, top, count)
        parts += [up[1 if parts else 0 :], up[-2::-1]]
    return np.concatenate(parts)


def draw_loops(
    operators: Mapping[str, Hysteresis],
    history: ArrayLike,
    *,
    input_label: str = "input",
    output_label: str = "output",
) -> Figure:
    """Return a figure of what operators make of one history, a panel for each.

    The line gets darker with time; the return points of the history are marked.

    Parameters
    ----------
    operators : mapping of str to Hysteresis
        What to draw, by the title of its panel.
    history : array_like, shape (n,)
        Inputs in the order of time.
    input_label, output_label : str
        Labels of the axes, with units.

    Raises
    ------
    InputError
        If there is nothing to draw, or an operator refuses the history.
    """
    inputs = check_array("history", history)
    if inputs.ndim != 1 or len(inputs) < 2:
        raise InputError(f"history has shape {inputs.shape}: to be drawn it needs (n,), n >= 2")
    if not operators:
        raise InputError("there are 0 operators to draw: give 1 or more")
    columns = min(3, len(operators))
    rows = math.ceil(len(operators) / columns)
    figure, panels = _make_panels(rows, columns)
    turns = _find_turns(inputs)
    for axes, (name, operator) in zip(panels, operators.items(), strict=False):
        outputs = np.asarray(operator.apply(inputs), dtype=np.float64)
        _draw_path(axes, inputs, outputs)
        axes.plot(inputs[turns], outputs[turns], "o", color=AMBER, markersize=3.5, zorder=4)
        axes.set_title(name, fontsize=10, loc="left")
    for place, axes in enumerate(panels):
        if place >= len(operators):
            axes.set_visible(False)
        if place % columns == 0:
            axes.set_ylabel(output_label)
        if place + columns >= len(operators):
            axes.set_xlabel(input_label)
    return figure


def draw_fit(
    fit: HysteresisFit[Any],
    history: ArrayLike,
    response: ArrayLike,
    *,
    input_label: str = "input",
    output_label: str = "output",
) -> Figure:
    """Return a figure of loops measured and fitted, and what is left over the samples.

    Parameters
    ----------
    fit : HysteresisFit
    history, response : array_like, shape (n,)
        What was fitted.
    input_label, output_label : str
        Labels of the axes, with units.

    Raises
    ------
    InputError
        If the histories are not those of the fit.
    """
    inputs, outputs = check_array("history", history), check_array("response", response)
    if inputs.ndim != 1 or not inputs.shape == outputs.shape == fit.residual.shape:
        raise InputError(
            f"history has shape {inputs.shape} and response {outputs.shape}: the fit has "
            f"{fit.residual.shape}, and one history can be drawn"
        )
    figure, (left, right) = _make_panels(1, 2)
    left.plot(inputs, outputs, ".", color=INK, markersize=3.0, alpha=0.5, label="measured")
    name = type(fit.operator).__name__
    left.plot(inputs, outputs - fit.residual, color=_BLUE, linewidth=1.5, label=name)
    right.plot(fit.residual, ".", color=RED, markersize=3.0)
    right.axhline(0.0, color=INK, linewidth=0.8)
    left.set(xlabel=input_label, ylabel=output_label)
    right.set(xlabel="sample", ylabel="measured less fitted")
    stopped = "" if fit.converged else f", not converged: {fit.reason}"
    right.set_title(f"rms {fit.deviation:.3g}{stopped}", fontsize=10, loc="left")
    left.legend(frameon=False, fontsize=9)
    return figure


def _draw_path(axes: Axes, inputs: NDArray[np.float64], outputs: NDArray[np.float64]) -> None:
    from matplotlib.collections import LineCollection

    points = np.column_stack([inputs, outputs])
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    shades = np.linspace(0.35, 1.0, len(pieces))
    axes.add_collection(LineCollection(list(pieces), colors=_BLUE, alpha=shades, linewidths=1.4))
    axes.autoscale_view()
    axes.margins(0.06)


def _find_turns(inputs: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return where the history turns round."""
    moved = np.flatnonzero(np.diff(inputs))
    ways = np.sign(np.diff(inputs)[moved])
    return moved[np.flatnonzero(np.diff(ways)) + 1]


def _make_panels(rows: int, columns: int) -> tuple[Figure, list[Axes]]:
    size = (max(4.8, 3.4 * columns), max(3.4, 2.9 * rows))
    figure = Figure(figsize=size, layout="constrained")
    panels = [figure.add_subplot(rows, columns, place + 1) for place in range(rows * columns)]
    for axes in panels:
        axes.grid(True, color=_GRID, linewidth=0.8)
        axes.set_axisbelow(True)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    return figure, panels
