"""The figure of how long a link may be along a duct.

Drawn with matplotlib's objects only (no pyplot); `bozzini.view.write_figure` writes the figure.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ..checks import check_number
from .palette import AMBER, GREEN, INK, RED

if TYPE_CHECKING:
    from ..motion.traverse import LinkLimits

__all__ = ["draw_link_limits"]

_GRID = "#e3e8ed"


def draw_link_limits(limits: LinkLimits, *, link: float | None = None) -> Figure:
    """Return a figure of the bounds of the link over the place, and of the lumen below.

    Parameters
    ----------
    limits : LinkLimits
    link : float, optional
        A length to mark [mm].
    """
    if link is not None:
        check_number("link", link, low=0.0, low_open=True, unit="mm")
    figure = Figure(figsize=(9.6, 6.0), facecolor="white", layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    where, named = limits.arc_length, []
    lines = (
        (limits.rigid, RED, "no longer link passes", limits.link_high, limits.link_high_at),
        (
            limits.head_on_line,
            AMBER,
            "… with its head on the centreline",
            limits.link_head,
            limits.link_head_at,
        ),
        (
            limits.on_line,
            GREEN,
            "shorter links pass, joints on the centreline",
            limits.link_low,
            limits.link_low_at,
        ),
    )
    for values, color, name, best, place in lines:
        shown = np.where(np.isfinite(values), values, np.nan)
        upper.plot(where, shown, color=color, linewidth=1.7, label=name)
        if math.isfinite(place):
            upper.plot(place, best, "o", color=color, markersize=6)
            named.append(best)
    if link is not None:
        upper.axhline(link, color=INK, linewidth=1.3, linestyle=(0, (5, 2)), label=f"{link:g} mm")
        named.append(link)
    top = 3.0 * max(named) if named and max(named) > 0.0 else None
    upper.set_ylim(0.0, top)
    upper.set_ylabel("length of a link [mm]")
    upper.set_title(f"body of {limits.diameter:g} mm", fontsize=10, loc="left")
    # Above the axes: the curves fill them.
    upper.legend(
        frameon=False,
        fontsize=9,
        ncols=2,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderpad=0.0,
    )
    lower.fill_between(where, 0.0, limits.radius, color="#d7e3ee", lw=0)
    lower.axhline(0.5 * limits.diameter, color=RED, linewidth=1.3, linestyle=(0, (5, 2)))
    lower.set(xlabel="place along the centreline [mm]", ylabel="room there [mm]")
    lower.set_ylim(bottom=0.0)
    for axes in (upper, lower):
        axes.grid(color=_GRID, linewidth=0.8)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    return figure
