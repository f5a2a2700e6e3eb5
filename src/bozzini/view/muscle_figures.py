"""Figures of muscles: phases, contraction, force, braid angle, models against measurements.

Drawn with matplotlib's objects only (no pyplot). Every function returns a `Figure`, which
`bozzini.view.write_figure` writes. Pressure is shown in kPa, angles in degrees.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_integer, check_number
from ..errors import InputError
from .palette import AMBER, GREEN, INK, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..muscle.compare import Comparison
    from ..muscle.model import MuscleModel

__all__ = [
    "draw_braid_angle",
    "draw_contraction",
    "draw_force",
    "draw_models",
    "draw_phases",
]

LOCKING_ANGLE = math.degrees(math.atan(math.sqrt(2.0)))
_COLORS = ("#1f5fa8", AMBER, GREEN, RED, "#6f4fa8", "#45b5d9", "#7a6a58", INK)
_DASHES = ((0, ()), (0, (6, 2)), (0, (2, 1.5)), (0, (6, 2, 1.5, 2)))
_MARKS = {"inflating": "^", "deflating": "v", "": "o"}
_GRID = "#e3e8ed"
_PRESSURE = "pressure [kPa]"
_CONTRACTION = "contraction [mm]"
_FINE = 201
_PHASES: tuple[dict[str, Any], ...] = (
    {"color": "#d7e3ee", "label": "gap: the tube grows alone"},
    {"color": "#fbe7c6", "label": "contact, longer than at rest"},
)


def draw_phases(
    model: MuscleModel,
    *,
    pressure: float,
    load: float = 0.0,
    direction: str | None = None,
    lowest: float = 0.0,
) -> Figure:
    """Return a figure of the phases of deformation, the beginning enlarged on the left.

    While the tube grows in the gap alone, it does not press on the braid: that is the dead band of
    a muscle without load. A load can stretch the tube until the braid grips it, and close the gap.
    Where the model says so, the muscle gets longer, and has to contract to its length at rest
    first. The phases are those of `MuscleState.in_contact`.

    Parameters
    ----------
    model : MuscleModel
    pressure : float
        Largest pressure [MPa].
    load : float
        Tension that the muscle holds [N].
    direction : str, optional
        ``"inflating"`` or ``"deflating"`` for a branch of friction.
    lowest : float
        Pressure at which the line begins [MPa], for a model without an answer below it.

    Raises
    ------
    InputError
        If the pressure does not exceed the dead band, or the model has no answer.
    """
    band = float(model.dead_band())
    check_number("pressure", pressure, low=band, low_open=True, unit="MPa")
    figure, (left, right) = _make_panels(2, ratios=(1.0, 1.5))
    near = min(2.5 * band, pressure) if band > 0.0 else 0.2 * pressure
    if lowest >= near:
        near = pressure
    for axes, top in ((left, near), (right, pressure)):
        over = np.linspace(lowest, top, _FINE)
        state = model.solve(over, load, direction=direction)
        line = np.asarray(state.contraction, dtype=np.float64)
        phases = np.where(state.in_contact, np.where(line < 0.0, 1, 2), 0)
        for phase, low, high in _list_phases(model, over, phases, load, direction):
            if phase < 2:
                axes.axvspan(1e3 * low, 1e3 * high, lw=0, **_PHASES[phase])
        axes.axhline(0.0, color=INK, linewidth=0.8)
        axes.plot(1e3 * over, line, color=_COLORS[0], linewidth=1.8)
        axes.set(xlabel=_PRESSURE, xlim=(0.0, 1e3 * top))
    left.set_ylabel(_CONTRACTION)
    if right.get_legend_handles_labels()[1]:
        right.legend(frameon=False, fontsize=9, loc="center right")
    left.set_title(f"dead band without load: {1e3 * band:.1f} kPa", fontsize=10, loc="left")
    right.set_title(f"{model.name}, {load:g} N", fontsize=10, loc="left")
    return figure


def _list_phases(
    model: MuscleModel,
    over: NDArray[np.float64],
    phases: NDArray[np.int64],
    load: float,
    direction: str | None,
) -> list[tuple[int, float, float]]:
    """Return the phases and between which pressures they last; contact is found by bisection."""
    ends = [float(over[0])]
    changes = np.flatnonzero(np.diff(phases))
    for index in changes:
        low, high = float(over[index]), float(over[index + 1])
        if 0 in phases[[index, index + 1]]:
            touches = phases[index + 1] > 0
            for _ in range(50):
                middle = 0.5 * (low + high)
                state = model.solve(middle, load, direction=direction)
                if bool(state.in_contact) == touches:
                    high = middle
                else:
                    low = middle
        ends.append(high)
    ends.append(float(over[-1]))
    kinds = phases[np.append(changes, len(phases) - 1)].tolist()
    return list(zip(kinds, ends[:-1], ends[1:], strict=True))


def draw_contraction(
    models: Mapping[str, MuscleModel],
    *,
    pressure: float,
    load: float = 0.0,
    direction: str | None = None,
    lowest: float = 0.0,
) -> Figure:
    """Return a figure of contraction over pressure, a line for each model, length or angle.

    Parameters
    ----------
    models : mapping of str to MuscleModel
        What to draw, by the name in the legend.
    pressure : float
        Largest pressure [MPa].
    load : float
        Tension that the muscle holds [N].
    direction : str, optional
        ``"inflating"`` or ``"deflating"`` for a branch of friction.
    lowest : float
        Pressure at which the line begins [MPa], for a model without an answer below it.

    Raises
    ------
    InputError
        If there is nothing to draw, or a model has no answer.
    """
    check_number("pressure", pressure, low=0.0, low_open=True, unit="MPa")
    figure, (axes,) = _make_panels(1)
    over = np.linspace(lowest, pressure, _FINE)
    for style, (name, model) in zip(_list_styles(models), models.items(), strict=True):
        line = model.contraction(over, load, direction=direction)
        axes.plot(1e3 * over, np.asarray(line, dtype=np.float64), label=name, **style)
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set(xlabel=_PRESSURE, ylabel=_CONTRACTION, xlim=(0.0, 1e3 * pressure))
    axes.set_title(f"load {load:g} N", fontsize=10, loc="left")
    axes.legend(frameon=False, fontsize=9)
    return figure


def draw_force(
    model: MuscleModel, pressures: ArrayLike, *, count: int = 101, direction: str | None = None
) -> Figure:
    """Return a figure of force over contraction, a line for each pressure, blocked to free.

    Parameters
    ----------
    model : MuscleModel
    pressures : array_like
        Pressures [MPa].
    count : int
        Points of a line.
    direction : str, optional
        ``"inflating"`` or ``"deflating"`` for a branch of friction.

    Raises
    ------
    InputError
        If there is no pressure, or the model has no answer.
    """
    levels = _take_levels(pressures)
    check_integer("count", count, low=2)
    figure, (axes,) = _make_panels(1)
    shades = np.linspace(0.25, 1.0, len(levels))
    for level, shade in zip(levels, shades, strict=True):
        free = max(0.0, float(model.contraction(float(level), direction=direction)))
        over = np.linspace(0.0, free, count)
        force = np.asarray(model.force(float(level), over, direction=direction), dtype=np.float64)
        axes.plot(
            over, force, color=_COLORS[0], alpha=float(shade), linewidth=1.6,
            label=f"{1e3 * level:.0f} kPa",
        )  # fmt: skip
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set(xlabel=_CONTRACTION, ylabel="force [N]")
    axes.set_title(model.name, fontsize=10, loc="left")
    axes.legend(frameon=False, fontsize=9)
    return figure


def draw_braid_angle(
    models: Mapping[str, MuscleModel],
    *,
    pressure: float,
    load: float = 0.0,
    direction: str | None = None,
    lowest: float = 0.0,
) -> Figure:
    """Return a figure of the braid angle over a wide range of pressure, and where it locks.

    The range may go far beyond what a muscle bears, as in Fig. 3.17 of the thesis, to show
    whether a model comes to the locking angle of 54.74 degrees, and from which side.

    Parameters
    ----------
    models : mapping of str to MuscleModel
        What to draw, by the name in the legend.
    pressure : float
        Largest pressure [MPa]; the axis is logarithmic over four decades.
    load : float
        Tension that the muscle holds [N].
    direction : str, optional
        ``"inflating"`` or ``"deflating"`` for a branch of friction.
    lowest : float
        Pressure at which the line begins [MPa], for a model without an answer below it.

    Raises
    ------
    InputError
        If there is nothing to draw, or a model has no answer.
    """
    check_number("pressure", pressure, low=0.0, low_open=True, unit="MPa")
    figure, (axes,) = _make_panels(1)
    over = np.geomspace(max(1e-4 * pressure, lowest), pressure, _FINE)
    for style, (name, model) in zip(_list_styles(models), models.items(), strict=True):
        state = model.solve(over, load, direction=direction)
        angle = np.asarray(state.braid_angle, dtype=np.float64)
        axes.semilogx(1e3 * over, np.degrees(angle), label=name, **style)
    axes.axhline(LOCKING_ANGLE, color=INK, linewidth=1.0, linestyle=(0, (1, 1.5)))
    axes.text(
        0.01, LOCKING_ANGLE, f"locking, {LOCKING_ANGLE:.2f}°", va="bottom", fontsize=9, color=INK,
        transform=axes.get_yaxis_transform(),
    )  # fmt: skip
    axes.set(xlabel=_PRESSURE, ylabel="braid angle [°]", xlim=1e3 * over[[0, -1]])
    axes.legend(frameon=False, fontsize=9, loc="lower right")
    return figure


def draw_models(comparison: Comparison, models: Mapping[str, MuscleModel]) -> Figure:
    """Return a figure of measurements and models, as Figs 3.11 to 3.16 of the thesis.

    Left the measured rows and a line for each model, load and direction; the legend gives the
    standard error as a percentage of the largest contraction. Right model less measurement.

    Parameters
    ----------
    comparison : Comparison
    models : mapping of str to MuscleModel
        The models compared, by the same names.

    Raises
    ------
    InputError
        If a model of the comparison is not there.
    """
    data = comparison.data
    figure, (left, right) = _make_panels(2, ratios=(1.5, 1.0))
    loads = np.unique(data.load)
    for direction, mark in _MARKS.items():
        rows = data.direction == direction
        if rows.any():
            left.plot(
                1e3 * data.pressure[rows], data.contraction[rows], mark, color=INK, markersize=4.5,
                markerfacecolor="none", label=f"measured {direction}".strip(), zorder=4,
            )  # fmt: skip
    names = [score.name for score in comparison.scores]
    for style, score in zip(_list_styles(names), comparison.scores, strict=True):
        if score.name not in models:
            raise InputError(f"model '{score.name}' was compared, but is not among those given")
        label: str | None = f"{score.name}: {score.standard_error_percent:.1f} %"
        for load in loads:
            for direction in dict.fromkeys(data.direction[data.load == load].tolist()):
                rows = (data.load == load) & (data.direction == direction)
                _draw_line(left, models[score.name], data.pressure[rows], load, direction,
                           score.predicted[rows], {**style, "label": label})  # fmt: skip
                label = None
        right.plot(
            1e3 * data.pressure, score.predicted - data.contraction, "o", markersize=3.5,
            color=style["color"],
        )  # fmt: skip
    right.axhline(0.0, color=INK, linewidth=0.8)
    left.set(xlabel=_PRESSURE, ylabel=_CONTRACTION)
    right.set(xlabel=_PRESSURE, ylabel="model less measurement [mm]")
    if len(loads) > 1:
        left.set_title(f"loads {loads[0]:g} to {loads[-1]:g} N", fontsize=10, loc="left")
    left.legend(frameon=False, fontsize=9)
    return figure


def _draw_line(
    axes: Axes,
    model: MuscleModel,
    pressure: NDArray[np.float64],
    load: float,
    direction: str,
    predicted: NDArray[np.float64],
    style: dict[str, Any],
) -> None:
    """Draw a model between the rows as well; where it has no answer there, only at them."""
    over = np.linspace(pressure.min(), pressure.max(), _FINE)
    try:
        line = np.asarray(model.contraction(over, load, direction=direction or None))
    except InputError:
        order = np.argsort(pressure, kind="stable")
        over, line = pressure[order], predicted[order]
    axes.plot(1e3 * over, line, **style)


def _take_levels(pressures: ArrayLike) -> NDArray[np.float64]:
    levels = np.unique(check_array("pressures", pressures))
    if not len(levels):
        raise InputError("there are 0 pressures to draw: give 1 or more")
    return levels


def _list_styles(names: Any) -> list[dict[str, Any]]:
    if not len(names):
        raise InputError("there are 0 models to draw: give 1 or more")
    return [
        {
            "color": _COLORS[i % len(_COLORS)],
            "linestyle": _DASHES[i % len(_DASHES)],
            "linewidth": 1.7,
        }
        for i in range(len(names))
    ]


def _make_panels(count: int, *, ratios: tuple[float, ...] = (1.0,)) -> tuple[Figure, list[Axes]]:
    figure = Figure(
        figsize=(5.8 if count == 1 else 9.6, 4.2), facecolor="white", layout="constrained"
    )
    panels = list(figure.subplots(1, count, squeeze=False, width_ratios=ratios)[0])
    for axes in panels:
        axes.grid(color=_GRID, linewidth=0.8)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    return figure, panels
