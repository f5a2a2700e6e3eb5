"""The motion of a tendon robot along a plan: bends, fit, clearance and tendons, step by step.

Drawn with matplotlib's objects only (no pyplot); `bozzini.view.write_figure` writes the figure.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .palette import AMBER, GREEN, INK, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from ..continuum.actuation import Actuation

__all__ = ["draw_robot_motion"]

_BLUE = "#1f5fa8"
_GRID = "#e3e8ed"
NEAR = 1.5
"""Ratio to the largest bend from which the place where discs meet is not shown."""
_NAMED = 8
"""Sections or tendons that are told apart in a legend at most."""


def draw_robot_motion(actuation: Actuation) -> Figure:
    """Return a figure of a robot's motion: four panels over how far its tip is in.

    Bends of the sections with their limits; how far the body is off the path; estimated clearance
    with the proved bound; tendon displacements. Where the motion goes back and forth, it is drawn
    over the steps instead.

    Parameters
    ----------
    actuation : Actuation
    """
    figure = Figure(figsize=(11.0, 8.0), layout="constrained", facecolor="white")
    heads = actuation.head_arc_length
    onwards = bool(np.all(np.diff(heads) >= -1e-9))
    across = heads if onwards else np.arange(actuation.steps, dtype=np.float64)
    label = "tip along the path [mm]" if onwards else "step"
    panels = figure.subplots(2, 2, sharex=True)
    _draw_bends(panels[0, 0], actuation, across)
    _draw_fit(panels[0, 1], actuation, across)
    _draw_clearance(panels[1, 0], actuation, across)
    _draw_tendons(panels[1, 1], actuation, across)
    for axes in panels.flat:
        axes.grid(color=_GRID, linewidth=0.8)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in panels[1]:
        axes.set_xlabel(label)
    robot = actuation.robot
    told = f"{robot.name}: {len(robot.sections)} sections, {robot.length:g} mm long, "
    told += f"{2.0 * robot.radius:g} mm thick"
    figure.suptitle(told, color=INK, fontsize=13, x=0.01, ha="left")
    if actuation.status == "stopped":
        _mark_end(panels, across, actuation)
    return figure


def _draw_bends(axes: Axes, actuation: Actuation, across: NDArray[np.float64]) -> None:
    angles = np.degrees(np.linalg.norm(actuation.bends, axis=2))
    sections = actuation.robot.sections
    colors = _spread_colors(len(sections))
    for index, color in enumerate(colors):
        axes.plot(across, angles[:, index], color=color, linewidth=1.2)
    limits = sorted(
        {
            min(math.degrees(item.max_bend), meet)
            for item in sections
            for meet in [math.degrees(item.length / item.radius)]
            # Discs mostly meet far beyond: shown if a section comes near.
            if math.degrees(item.max_bend) <= meet or meet < NEAR * float(angles.max())
        }
    )
    for limit in limits[:3]:
        axes.axhline(limit, color=RED, linewidth=1.4, linestyle=(0, (5, 2)))
    highest = max([float(angles.max()), 1.0, *limits])
    axes.set_ylim(0.0, 1.3 * highest)
    axes.set_ylabel("bend of the sections [deg]")
    handles = [
        Line2D([], [], color=colors[0], label="first section"),
        Line2D([], [], color=colors[-1], label="last section, with the tip"),
    ]
    if limits:
        handles.append(Line2D([], [], color=RED, linestyle=(0, (5, 2)), label="limit"))
    axes.legend(handles=handles, frameon=False, fontsize=8.5, loc="upper left")


def _draw_fit(axes: Axes, actuation: Actuation, across: NDArray[np.float64]) -> None:
    axes.fill_between(across, 0.0, actuation.fit_max, color="#d7e3ee", lw=0, label="largest")
    axes.plot(across, actuation.fit_rms, color=_BLUE, linewidth=1.4, label="rms")
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("backbone off the path [mm]")
    axes.legend(frameon=False, fontsize=8.5, loc="upper left")


def _draw_clearance(axes: Axes, actuation: Actuation, across: NDArray[np.float64]) -> None:
    clearance = np.where(np.isfinite(actuation.clearance), actuation.clearance, np.nan)
    axes.plot(across, clearance, color=GREEN, linewidth=1.4, label="estimated at the steps")
    if actuation.certified:
        axes.axhline(
            actuation.certificate.clearance,
            color=INK,
            linewidth=1.2,
            linestyle=(0, (1, 1.5)),
            label="proved at all times",
        )
    axes.axhline(0.0, color=RED, linewidth=1.2)
    axes.set_ylabel("body to wall [mm]")
    axes.legend(frameon=False, fontsize=8.5, loc="upper right")


def _draw_tendons(axes: Axes, actuation: Actuation, across: NDArray[np.float64]) -> None:
    names = actuation.robot.tendon_names
    few = len(names) <= _NAMED
    sections = actuation.robot.tendon_sections
    colors = _spread_colors(len(names) if few else len(actuation.robot.sections))
    for index, name in enumerate(names):
        axes.plot(
            across,
            actuation.displacements[:, index],
            color=colors[index if few else int(sections[index])],
            linewidth=1.0,
            label=name,
        )
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set_ylabel("tendon displacement [mm], pulled > 0")
    if few:
        axes.legend(frameon=False, fontsize=8.5, loc="upper left", ncols=2)
    else:
        axes.text(
            0.02, 0.97, "colour: section where a tendon ends", transform=axes.transAxes,
            fontsize=8.5, va="top", color=INK,
        )  # fmt: skip


def _mark_end(panels: Any, across: NDArray[np.float64], told: Actuation) -> None:
    for axes in panels.flat:
        axes.axvline(across[-1], color=AMBER, linewidth=2.0)
    panels[0, 0].set_title(
        f"ends here: {told.reason_code.replace('_', ' ').lower()}",
        color=AMBER,
        fontsize=10,
        loc="right",
    )


def _spread_colors(count: int) -> list[tuple[float, float, float, float]]:
    """Return colours from dark (base) to light (tip)."""
    from matplotlib import colormaps

    return [colormaps["viridis"](value) for value in np.linspace(0.0, 0.88, max(count, 1))]
