"""Figures of muscles: curves, phases, models against measurements, rankings, loops."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_integer, check_number
from ..errors import BozziniError, InputError
from ..muscle.design import LOCKING_ANGLE
from ..muscle.problem import FitData
from ..numeric.roots import bisect
from .style import (
    AMBER,
    BLUE,
    COLORS,
    DASHES,
    INK,
    RED,
    Look,
    make_panels,
    take_panel,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..muscle.data import Measurements
    from ..muscle.hysteresis import Hysteresis, HysteresisFit
    from ..muscle.model import MuscleModel
    from ..muscle.ranking import Comparison, ModelScore, Ranking

# Drawn without pyplot; `bozzini.plot.write_figure` writes the figures. Pressures are in kPa.

_MARKS = {"inflating": "^", "deflating": "v", "": "o"}
_PRESSURE = "pressure [kPa]"
_CONTRACTION = "contraction [mm]"
_FINE = 201
_PHASES: tuple[Look, ...] = (
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
    By some models the muscle gets longer, and has to contract to its length at rest
    first. The phases are those of `MuscleState.in_contact`.

    The model's keywords are those of `draw_contraction`.

    Raises
    ------
    InputError
        If the pressure does not exceed the dead band, or the model has no answer.
    """
    band = float(model.dead_band())
    check_number("pressure", pressure, low=band, low_open=True, unit="MPa")
    figure, (left, right) = make_panels(1, 2, width_ratios=(1.0, 1.5))
    near = min(2.5 * band, pressure) if band > 0.0 else 0.2 * pressure
    if lowest >= near:
        near = pressure
    for axes, top in ((left, near), (right, pressure)):
        over = np.linspace(lowest, top, _FINE)
        state = model.solve(over, load, direction=direction)
        line = state.contraction
        phases = np.where(state.in_contact, np.where(line < 0.0, 1, 2), 0)
        for phase, low, high in _list_phases(model, over, phases, load, direction):
            if phase < 2:
                axes.axvspan(1e3 * low, 1e3 * high, lw=0, **_PHASES[phase])
        axes.axhline(0.0, color=INK, linewidth=0.8)
        axes.plot(1e3 * over, line, color=BLUE, linewidth=1.8)
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
        end = float(over[index + 1])
        if 0 in phases[[index, index + 1]]:
            side = 1.0 if phases[index + 1] > 0 else -1.0

            def touch(at: float, side: float = side) -> float:
                state = model.solve(at, load, direction=direction)
                return side if bool(state.in_contact) else -side

            end = bisect(touch, float(over[index]), end)
        ends.append(end)
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
    ax: Axes | None = None,
) -> Axes:
    """Draw contraction over pressure, a line for each model, length or angle.

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
    ax : Axes, optional
        Axes to draw into.

    Raises
    ------
    InputError
        If there is nothing to draw, or a model has no answer.
    """
    check_number("pressure", pressure, low=0.0, low_open=True, unit="MPa")
    axes = take_panel(ax)
    over = np.linspace(lowest, pressure, _FINE)
    for style, (name, model) in zip(_list_styles(models), models.items(), strict=True):
        line = model.contraction(over, load, direction=direction)
        axes.plot(1e3 * over, line, label=name, **style)
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set(xlabel=_PRESSURE, ylabel=_CONTRACTION, xlim=(0.0, 1e3 * pressure))
    axes.set_title(f"load {load:g} N", fontsize=10, loc="left")
    axes.legend(frameon=False, fontsize=9)
    return axes


def draw_force(
    model: MuscleModel,
    pressures: ArrayLike,
    *,
    count: int = 101,
    direction: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw force over contraction, a line for each pressure, blocked to free.

    Parameters
    ----------
    model : MuscleModel
    pressures : array_like
        Pressures [MPa].
    count : int
        Points of a line.
    direction : str, optional
        ``"inflating"`` or ``"deflating"`` for a branch of friction.
    ax : Axes, optional
        Axes to draw into.

    Raises
    ------
    InputError
        If there is no pressure, or the model has no answer.
    """
    levels = np.unique(check_array("pressures", pressures))
    if not len(levels):
        raise InputError("there are 0 pressures to draw: give 1 or more")
    check_integer("count", count, low=2)
    axes = take_panel(ax)
    shades = np.linspace(0.25, 1.0, len(levels))
    for level, shade in zip(levels, shades, strict=True):
        free = max(0.0, float(model.contraction(float(level), direction=direction)))
        over = np.linspace(0.0, free, count)
        force = model.force(float(level), over, direction=direction)
        axes.plot(
            over, force, color=BLUE, alpha=float(shade), linewidth=1.6,
            label=f"{1e3 * level:.0f} kPa",
        )  # fmt: skip
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set(xlabel=_CONTRACTION, ylabel="force [N]")
    axes.set_title(model.name, fontsize=10, loc="left")
    axes.legend(frameon=False, fontsize=9)
    return axes


def draw_braid_angle(
    models: Mapping[str, MuscleModel],
    *,
    pressure: float,
    load: float = 0.0,
    direction: str | None = None,
    lowest: float = 0.0,
    ax: Axes | None = None,
) -> Axes:
    """Draw the braid angle over a wide range of pressure, and where it locks.

    The range may go far beyond what a muscle bears, as in Fig. 3.17 of the thesis, to show
    whether a model comes to the locking angle of 54.74 degrees, and from which side.
    The axis of pressure is logarithmic over four decades; the arguments are those of
    `draw_contraction`.

    Raises
    ------
    InputError
        If there is nothing to draw, or a model has no answer.
    """
    check_number("pressure", pressure, low=0.0, low_open=True, unit="MPa")
    axes = take_panel(ax)
    over = np.geomspace(max(1e-4 * pressure, lowest), pressure, _FINE)
    for style, (name, model) in zip(_list_styles(models), models.items(), strict=True):
        state = model.solve(over, load, direction=direction)
        axes.semilogx(1e3 * over, np.degrees(state.braid_angle), label=name, **style)
    locking = math.degrees(LOCKING_ANGLE)
    axes.axhline(locking, color=INK, linewidth=1.0, linestyle=(0, (1, 1.5)))
    axes.text(
        0.01, locking, f"locking, {locking:.2f}°", va="bottom", fontsize=9, color=INK,
        transform=axes.get_yaxis_transform(),
    )  # fmt: skip
    axes.set(xlabel=_PRESSURE, ylabel="braid angle [°]", xlim=1e3 * over[[0, -1]])
    axes.legend(frameon=False, fontsize=9, loc="lower right")
    return axes


def draw_models(comparison: Comparison, models: Mapping[str, MuscleModel]) -> Figure:
    """Return a figure of measurements and models, as Figs 3.11 to 3.16 of the thesis.

    Of a response of force or pressure it is that of the models over the measured one. Of the
    contraction, left the measured rows and a line for each model, load and direction; the legend
    gives the standard error as a percentage of the largest contraction. Right model less
    measurement.

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
    figure, (left, right) = make_panels(1, 2, width_ratios=(1.5, 1.0))
    if comparison.response != "contraction":
        task = FitData(muscle=next(iter(models.values())).muscle, data=data,
                    response=comparison.response)  # fmt: skip
        for style, score in zip(_list_styles(comparison.scores), comparison.scores, strict=True):
            label = f"{score.name}: {score.standard_error_percent:.1f} %"
            _draw_agreement(left, right, task, score, {**style, "label": label})
        return figure
    _draw_rows(left, data)
    names = [score.name for score in comparison.scores]
    for style, score in zip(_list_styles(names), comparison.scores, strict=True):
        if score.name not in models:
            raise InputError(f"model '{score.name}' was compared, but is not among those given")
        label = f"{score.name}: {score.standard_error_percent:.1f} %"
        _draw_lines(left, models[score.name], data, score.predicted, {**style, "label": label})
        right.plot(
            1e3 * data.pressure, score.predicted - data.contraction, "o", markersize=3.5,
            color=style["color"],
        )  # fmt: skip
    right.axhline(0.0, color=INK, linewidth=0.8)
    right.set(xlabel=_PRESSURE, ylabel="model less measurement [mm]")
    left.legend(frameon=False, fontsize=9)
    return figure


def _draw_agreement(left: Axes, right: Axes, task: FitData, score: ModelScore, style: Look) -> None:
    """Draw the response of a model over the measured one, and what it misses by."""
    rows, color = score.answered, style["color"]
    measured, found = task.measured[rows], score.predicted[rows]
    left.plot(measured, found, "o", markersize=2.5, color=color, label=style["label"])
    right.plot(measured, found - measured, "o", markersize=2.5, color=color)
    ends = [float(task.measured.min()), float(task.measured.max())]
    left.plot(ends, ends, color=INK, linewidth=0.8)
    right.axhline(0.0, color=INK, linewidth=0.8)
    name = f"measured {task.response} [{task.unit}]"
    left.set(xlabel=name, ylabel=f"{task.response} of the model [{task.unit}]")
    right.set(xlabel=name, ylabel=f"model less measurement [{task.unit}]")
    left.legend(frameon=False, fontsize=9)


def _draw_rows(axes: Axes, data: Measurements) -> None:
    """Draw measured rows, a mark for each direction."""
    for direction, mark in _MARKS.items():
        rows = data.direction == direction
        if rows.any():
            axes.plot(
                1e3 * data.pressure[rows], data.contraction[rows], mark, color=INK, markersize=4.5,
                markerfacecolor="none", label=f"measured {direction}".strip(), zorder=4,
            )  # fmt: skip
    axes.set(xlabel=_PRESSURE, ylabel=_CONTRACTION)
    loads = np.unique(data.load)
    if len(loads) > 1:
        axes.set_title(f"loads {loads[0]:g} to {loads[-1]:g} N", fontsize=10, loc="left")


def _draw_lines(
    axes: Axes,
    model: MuscleModel,
    data: Measurements,
    predicted: NDArray[np.float64],
    style: Look,
) -> None:
    """Draw a model between the rows of each load and direction; without an answer, at the rows."""
    label = style.get("label")
    for load, direction in dict.fromkeys(
        zip(data.load.tolist(), data.direction.tolist(), strict=True)
    ):
        rows = (data.load == load) & (data.direction == direction)
        pressure, line = data.pressure[rows], predicted[rows]
        over = np.linspace(pressure.min(), pressure.max(), _FINE)
        try:
            line = np.asarray(model.contraction(over, load, direction=direction or None))
        except BozziniError:
            order = np.argsort(pressure, kind="stable")
            over, line = pressure[order], line[order]
        axes.plot(1e3 * over, line, **{**style, "label": label})
        label = None


def _list_styles(names: Collection[object]) -> list[Look]:
    if not len(names):
        raise InputError("there are 0 models to draw: give 1 or more")
    return [
        {
            "color": COLORS[i % len(COLORS)],
            "linestyle": DASHES[i % len(DASHES)],
            "linewidth": 1.7,
        }
        for i in range(len(names))
    ]


_RANK_CURVES = 5
_LEAST = 1e-3  # a percentage below is drawn there


def draw_ranking(ranking: Ranking, *, curves: int = 4) -> Figure:
    """Return a figure of a ranking, the best model on top.

    Left, as percentages of the largest measured response, the error of each model at the rows that
    it was fitted to (dots; crosses if the fit did not converge) and at rows left out of the fit
    (rings; a triangle at the edge if one of those fits has no answer there), and the difference of
    AICc to the smallest. Right the measurements and the best models that differ, or of a
    response other than the contraction what these miss by.

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
    check_integer("curves", curves, low=1, high=_RANK_CURVES)
    if not ranking.models:
        raise InputError("there are 0 models to draw: give 1 or more")
    height = max(4.2, 1.4 + 0.21 * len(ranking.models))
    figure, (left, right) = make_panels(1, 2, width_ratios=(1.25, 1.0), size=(11.0, height))
    shown = [entry for entry in ranking.models if not entry.same_as][:curves]
    styles = dict(zip((entry.name for entry in shown), _list_styles(shown), strict=True))
    _draw_errors(left, ranking, {name: style["color"] for name, style in styles.items()})
    if ranking.task.response != "contraction":
        unit = ranking.task.unit
        for entry in shown:
            rows, color = entry.score.answered, styles[entry.name]["color"]
            measured = ranking.task.measured[rows]
            right.plot(measured, entry.score.predicted[rows] - measured, "o", markersize=2.5,
                       color=color, label=entry.name)  # fmt: skip
        right.axhline(0.0, color=INK, linewidth=0.8)
        right.set(xlabel=f"measured {ranking.task.response} [{unit}]",
                  ylabel=f"model less measurement [{unit}]")  # fmt: skip
        right.legend(frameon=False, fontsize=8)
        return figure
    _draw_rows(right, ranking.data)
    for entry in shown:
        style = {**styles[entry.name], "label": entry.name}
        _draw_lines(right, entry.model, ranking.data, entry.score.predicted, style)
    right.legend(frameon=False, fontsize=8)
    return figure


def _draw_errors(axes: Axes, ranking: Ranking, colors: dict[str, str]) -> None:
    scale = 100.0 / float(ranking.task.measured.max())
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
    labels = [f"{entry.name} ({entry.parameters})" for entry in ranking.models]
    axes.set_yticks(range(len(labels)), labels)
    axes.tick_params(axis="y", labelsize=8)
    axes.set_ylim(len(ranking.models) - 0.4, -1.6)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    from matplotlib.ticker import LogLocator

    axes.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    axes.xaxis.set_minor_formatter("{x:g}")
    axes.set_xlabel(f"root mean square [% of the largest {ranking.task.response}]")
    words = {"aicc": "AICc", "bic": "BIC", "cv": "the rows left out"}[ranking.criterion]
    axes.set_title(f"ranked by {words}; number of constants fitted", fontsize=10, loc="left")
    axes.legend(frameon=False, fontsize=8, loc="lower left")


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
    size = (max(4.8, 3.4 * columns), max(3.4, 2.9 * rows))
    figure, panels = make_panels(rows, columns, size=size)
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
    figure, (left, right) = make_panels(1, 2, size=(6.8, 3.4))
    left.plot(inputs, outputs, ".", color=INK, markersize=3.0, alpha=0.5, label="measured")
    name = type(fit.operator).__name__
    left.plot(inputs, outputs - fit.residual, color=BLUE, linewidth=1.5, label=name)
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
    axes.add_collection(LineCollection(list(pieces), colors=BLUE, alpha=shades, linewidths=1.4))
    axes.autoscale_view()
    axes.margins(0.06)


def _find_turns(inputs: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return where the history turns round."""
    moved = np.flatnonzero(np.diff(inputs))
    ways = np.sign(np.diff(inputs)[moved])
    return moved[np.flatnonzero(np.diff(ways)) + 1]
