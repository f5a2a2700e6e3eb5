"""Pictures of how likely a plan touches its wall: clearances, diameters, places along the way."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..numeric.arrays import Floats
from ..results import take_axes
from .style import AMBER, BLUE, GREEN, INK, LUMEN, RED, make_panels, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


BINS = 60


def draw_clearances(clearance: Floats, certified: float, ax: Axes | None = None) -> Axes:
    """Draw how often which clearance [mm] comes out, contact in red, and what is certified."""
    axes = take_axes(ax, x="clearance in a draw [mm]", y="share of the draws")
    least, most = float(clearance.min()), float(clearance.max())
    width = max(most - least, 1e-3) / BINS  # 0 is an edge, so that no bar is on both sides of it
    edges = width * np.arange(np.floor(least / width), np.ceil(most / width) + 2)
    share = np.full(len(clearance), 1.0 / len(clearance))
    _, _, bars = axes.hist(clearance, bins=list(edges), weights=share, color=BLUE)
    for bar, edge in zip(bars, edges, strict=False):  # type: ignore[arg-type]
        if edge < -0.5 * width:
            bar.set_color(RED)
    if np.isfinite(certified):
        axes.axvline(certified, color=GREEN, linestyle="--", label="certified, no error")
        axes.legend(frameon=False, fontsize=8)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    return axes


def draw_uncertainty(
    clearance: Floats,
    place: Floats,
    *,
    stations: Mapping[str, Floats],
    diameters: Mapping[str, Floats],
    diameter: float,
    certified: float,
) -> Figure:
    """Return the figure of a plan's contact: clearances, diameters, and along the way.

    Parameters
    ----------
    clearance, place : (n,) float
        Of each draw: the clearance [mm], and where along the centreline that is [mm].
    stations, diameters : mapping
        Columns of `bozzini.study.wall.Stations.list_columns` and
        `bozzini.study.contact_risk.ContactRisk.over_diameters`.
    diameter : float
        Of the scope [mm].
    certified : float
        Clearance without an error [mm].
    """
    figure, panels = make_panels(2, 2, size=(10.5, 7.2))
    draw_clearances(clearance, certified, panels[0])
    axes = panels[1]
    axes.set(xlabel="diameter of the same motion [mm]", ylabel="probability of contact")
    size = diameters["diameter_mm"]
    axes.fill_between(size, diameters["contact_low"], diameters["contact_high"], color=LUMEN, lw=0)
    axes.plot(size, diameters["contact"], "o-", color=BLUE, markersize=3)
    axes.axvline(diameter, color=AMBER, linestyle="--", label="planned")
    axes.set_ylim(-0.02, 1.02)
    axes.legend(frameon=False, fontsize=8)
    axes = panels[2]
    along, low, middle, high = (
        stations[name]
        for name in (
            "place_mm",
            "clearance_5_percent_mm",
            "clearance_50_percent_mm",
            "clearance_95_percent_mm",
        )
    )
    axes.set(xlabel="along the centreline [mm]", ylabel="clearance [mm]")
    axes.fill_between(along, low, high, color=LUMEN, lw=0, label="5 to 95 % of the draws")
    axes.plot(along, middle, color=BLUE, linewidth=1.2, label="median")
    axes.plot(along, stations["clearance_mm"], color=INK, linewidth=0.8, label="no error")
    axes.axhline(0.0, color=RED, linewidth=0.8)
    axes.legend(frameon=False, fontsize=8)
    axes = panels[3]
    axes.set(xlabel="along the centreline [mm]", ylabel="share of the draws")
    share = np.full(len(place), 1.0 / len(place))
    edges = list(np.linspace(0.0, max(float(along.max()), float(place.max())) + 1e-9, BINS + 1))
    axes.hist(place, bins=edges, weights=share, color=LUMEN, label="least clearance is here")
    touching = clearance < 0.0
    if touching.any():
        axes.hist(place[touching], bins=edges, weights=share[touching], color=RED, label="contact")
    axes.legend(frameon=False, fontsize=8)
    for each in panels:
        style_axes(each)
    return figure
