"""Maps of a continuum robot's workspace: in how many directions, and how well, its tip moves.

Drawn with matplotlib's objects only (no pyplot); `bozzini.view.write_figure` writes the figure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..checks import check_number
from .palette import INK

if TYPE_CHECKING:
    from ..continuum.dexterity import DexterityMap

__all__ = ["draw_workspace"]

_GRID = "#e3e8ed"


def draw_workspace(found: DexterityMap, *, length: float | None = None) -> Figure:
    """Return a figure of a dexterity map: share of directions left, manipulability right.

    In the half-plane cells are rings about the base's axis, seen in section; in space each cell
    is a point.

    Parameters
    ----------
    found : DexterityMap
    length : float, optional
        Length of the robot [mm], to draw it at rest.

    Raises
    ------
    InputError
        If `length` is not positive.
    """
    if length is not None:
        check_number("length", length, low=0.0, low_open=True, unit="mm")
    figure = Figure(figsize=(10.4, 5.2), facecolor="white", layout="constrained")
    unit = {1: "mm/rad", 2: "mm²/rad²", 3: "mm³/rad³"}[found.rank]
    panels = (
        (found.direction_share, "share of directions", "viridis", 0.0),
        (found.manipulability, f"mean manipulability [{unit}]", "cividis", None),
    )
    for place, (values, name, colors, low) in enumerate(panels, start=1):
        if found.half_plane:
            axes: Any = figure.add_subplot(1, 2, place)
            drawn = _fill_cells(axes, found, values, colors, low)
            if length is not None:
                axes.plot([0.0, 0.0], [0.0, length], color=INK, linewidth=2.0, label="at rest")
                axes.legend(frameon=False, fontsize=9, loc="upper right")
            axes.set(xlabel="distance from the axis [mm]", ylabel="z [mm]", aspect="equal")
            axes.set_xlim(left=-found.cell)
        else:
            axes = figure.add_subplot(1, 2, place, projection="3d")
            drawn = axes.scatter(*found.centres.T, c=values, s=6.0, cmap=colors, vmin=low)
            if length is not None:
                axes.plot([0.0, 0.0], [0.0, 0.0], [0.0, length], color=INK, linewidth=2.0)
            axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]", aspect="equal")
        figure.colorbar(drawn, ax=axes, label=name, shrink=0.8)
    return figure


def _fill_cells(
    axes: Any, found: DexterityMap, values: NDArray[np.float64], colors: str, low: float | None
) -> Any:
    """Draw the cells of a half-plane as squares, those without a tip left white."""
    index = np.rint(found.centres[:, (0, 2)] / found.cell - 0.5).astype(np.int64)
    first, last = index.min(axis=0), index.max(axis=0)
    grid = np.full(tuple(last - first + 1), np.nan)
    grid[tuple((index - first).T)] = values
    edges = [found.cell * np.arange(first[k], last[k] + 2) for k in range(2)]
    drawn = axes.pcolormesh(*edges, np.ma.masked_invalid(grid.T), cmap=colors, vmin=low)
    axes.grid(color=_GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return drawn
