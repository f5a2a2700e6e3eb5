"""The figure of a ranking of muscle models: how far off each is, and the curves of the best.

Drawn with matplotlib's objects only (no pyplot); `bozzini.view.write_figure` writes it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from ..checks import check_integer
from ..errors import BozziniError, InputError
from .palette import AMBER, GREEN, INK, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..muscle.rank import RankedModel, Ranking

__all__ = ["draw_ranking"]

_COLORS = ("#1f5fa8", AMBER, GREEN, RED, "#6f4fa8")
_DASHES = ((0, ()), (0, (6, 2)), (0, (2, 1.5)), (0, (6, 2, 1.5, 2)), (0, (1, 1)))
_MARKS = {"inflating": "^", "deflating": "v", "": "o"}
_GRID = "#e3e8ed"
_LEAST = 1e-3  # a percentage below is drawn there
_FINE = 101


def draw_ranking(ranking: Ranking, *, curves: int = 4) -> Figure:
    """Return a figure of a ranking, the best model on top.

    Left, as percentages of the largest contraction, the error of each model at the rows that it was
    fitted to (dots; crosses if the fit did not converge) and at rows left out of the fit (rings; a
    triangle at the edge if one of those fits has no answer there), and the difference of AICc to
    the smallest. Right the measurements and the best models that differ.

    Parameters
    ----------
    ranking : Ranking
    curves : int
        Largest number of models on the right, 1 to 5.

    Raises
    ------
    InputError
        If no model is ranked.
    """
    check_integer("curves", curves, low=1, high=len(_COLORS))
    if not ranking.models:
        raise InputError("there are 0 models to draw: give 1 or more")
    height = max(4.2, 1.4 + 0.21 * len(ranking.models))
    figure = Figure(figsize=(11.0, height), facecolor="white", layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    for axes in (left, right):
        axes.grid(color=_GRID, linewidth=0.8)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    shown = [entry for entry in ranking.models if not entry.same_as][:curves]
    colors = {entry.name: color for entry, color in zip(shown, _COLORS[: len(shown)], strict=True)}
    _draw_errors(left, ranking, colors)
    _draw_curves(right, ranking, shown)
    return figure


def _draw_errors(axes: Axes, ranking: Ranking, colors: dict[str, str]) -> None:
    scale = 100.0 / ranking.data.largest_contraction
    least = min(entry.aicc for entry in ranking.models)
    named: set[str] = set()

    def name(label: str) -> str | None:
        known = label in named
        named.add(label)
        return None if known else label

    for row, entry in enumerate(ranking.models):
        color = colors.get(entry.name, INK)
        fitted = max(scale * entry.score.rmse, _LEAST)
        settled = entry.calibration is None or entry.calibration.converged
        axes.plot(fitted, row, "o" if settled else "X", color=color, markersize=5.5,
                  label=name("rows of the fit" if settled else "not converged"))  # fmt: skip
        if np.isfinite(entry.validation_error):
            other = max(scale * entry.validation_error, _LEAST)
            axes.plot([fitted, other], [row, row], "-", color=color, linewidth=0.9)
            axes.plot(other, row, "o", color=color, markersize=7.5, markerfacecolor="none",
                      label=name("rows left out"))  # fmt: skip
        elif entry.validation is not None:
            axes.plot(0.985, row, ">", color=color, markersize=6.5, markerfacecolor="none",
                      transform=axes.get_yaxis_transform(),
                      label=name("no answer at rows left out"))  # fmt: skip
        above = f"{entry.aicc - least:.1f}" if np.isfinite(entry.aicc - least) else "none"
        axes.text(1.02, row, f"{above}", transform=axes.get_yaxis_transform(), fontsize=8,
                  va="center", color=INK)  # fmt: skip
    axes.text(1.02, -1.0, "ΔAICc", transform=axes.get_yaxis_transform(), fontsize=8,
              va="center", color=INK)  # fmt: skip
    axes.set_yticks(range(len(ranking.models)), [_label(entry) for entry in ranking.models])
    axes.tick_params(axis="y", labelsize=8)
    axes.set_ylim(len(ranking.models) - 0.4, -1.6)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xlabel("root mean square [% of the largest contraction]")
    words = {"aicc": "AICc", "bic": "BIC", "cv": "the rows left out"}[ranking.criterion]
    axes.set_title(f"ranked by {words}; number of constants fitted", fontsize=10, loc="left")
    axes.legend(frameon=False, fontsize=8, loc="lower left")


def _label(entry: RankedModel) -> str:
    return f"{entry.name} ({entry.parameters})"


def _draw_curves(axes: Axes, ranking: Ranking, shown: list[RankedModel]) -> None:
    data = ranking.data
    for direction, mark in _MARKS.items():
        rows = data.direction == direction
        if rows.any():
            axes.plot(
                1e3 * data.pressure[rows], data.contraction[rows], mark, color=INK, markersize=4.0,
                markerfacecolor="none", label=f"measured {direction}".strip(), zorder=4,
            )  # fmt: skip
    for entry, color, dash in zip(shown, _COLORS, _DASHES, strict=False):
        label: str | None = entry.name
        for load, direction in dict.fromkeys(
            zip(data.load.tolist(), data.direction.tolist(), strict=True)
        ):
            rows = (data.load == load) & (data.direction == direction)
            style = {"color": color, "linestyle": dash, "linewidth": 1.5, "label": label}
            _draw_line(axes, entry, data.pressure[rows], load, direction, rows, style)
            label = None
    axes.set(xlabel="pressure [kPa]", ylabel="contraction [mm]")
    loads = np.unique(data.load)
    if len(loads) > 1:
        axes.set_title(f"loads {loads[0]:g} to {loads[-1]:g} N", fontsize=10, loc="left")
    axes.legend(frameon=False, fontsize=8)


def _draw_line(
    axes: Axes,
    entry: RankedModel,
    pressure: Any,
    load: float,
    direction: str,
    rows: Any,
    style: dict[str, Any],
) -> None:
    """Draw a model between the rows as well; where it has no answer there, only at them."""
    over = np.linspace(pressure.min(), pressure.max(), _FINE)
    try:
        line = np.asarray(entry.model.contraction(over, load, direction=direction or None))
    except BozziniError:
        order = np.argsort(pressure, kind="stable")
        over, line = pressure[order], entry.score.predicted[rows][order]
    axes.plot(1e3 * over, line, **style)
