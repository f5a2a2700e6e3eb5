"""Figures of robots designed for a curve or a tract."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..motion.routing.design import RoutingDesign
from ..numeric.polylines import interpolate_polyline, measure_arc_length
from .style import AMBER, BLUE, INK, fit_space, make_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..motion.routing.tract import TractRobot


def draw_design(found: RoutingDesign | TractRobot) -> Figure:
    """Return a figure of a design: of a routing its shape, its tendons and its error.

    Parameters
    ----------
    found : RoutingDesign or TractRobot
    """
    if not isinstance(found, RoutingDesign):
        figure = make_figure((6.4, 4.4))
        found.plot(style_axes(figure.add_subplot()))
        return figure
    figure = make_figure((13.0, 4.6))
    grid = figure.add_gridspec(1, 3, width_ratios=(1.1, 1.2, 1.0))
    space = figure.add_subplot(grid[0], projection="3d")
    points = found.points
    space.plot(*found.curve.T, color=AMBER, linewidth=3.0, label="curve")
    space.plot(*points.T, color=INK, linewidth=1.2, label="backbone")
    fit_space(space, points, least=0.25 * float(np.ptp(points, axis=0).max()), zoom=1.0)
    space.legend(fontsize="small")
    found.plot(style_axes(figure.add_subplot(grid[1])))
    arc = measure_arc_length(found.curve)
    off = np.linalg.norm(points - interpolate_polyline(found.curve, arc, found.places), axis=1)
    axes = style_axes(figure.add_subplot(grid[2]))
    axes.plot(found.places, off, color=BLUE)
    axes.set(xlabel="arc length [mm]", ylabel="distance from the curve [mm]")
    return figure
