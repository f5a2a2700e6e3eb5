"""Curves of the effector: deflection over pressure, iteration, traces.

`bozzini.view.effector_figures` has all figures of the effector in one place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_points
from ..errors import InputError
from .palette import AMBER, GREEN, INK, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..effector import Balance, CubicFit, Effector, Trace

__all__ = ["draw_deflection", "draw_iteration", "draw_trace"]

Floats = NDArray[np.float64]

BLUE = "#1f5fa8"
PALETTE = (BLUE, AMBER, GREEN, RED, "#6f4fa8", "#45b5d9", "#7a6a58", INK)
_OWN = {"R": RED, "G": GREEN, "B": BLUE}
DASHES = ((0, ()), (0, (6, 2)), (0, (2, 1.5)), (0, (6, 2, 1.5, 2)))
GRID = "#e3e8ed"
_RISING, _FALLING = (0, (4, 1.5)), (0, (1, 1.5))
_CUBIC: dict[str, Any] = {"color": INK, "linewidth": 1.1}
_SMALL = 1e-6  # an error of the trace that is round-off [mm]
_PRESSURE = "pressure [kPa]"


def pick_colors(names: Sequence[str]) -> dict[str, str]:
    """Return a colour for each muscle: R, G and B as they are called, others in a fixed order."""
    if set(names) <= set(_OWN):
        return {name: _OWN[name] for name in names}
    return {name: PALETTE[k % len(PALETTE)] for k, name in enumerate(names)}


def style_axes(axes: Axes) -> None:
    """Give a panel the grid and spines of the house."""
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def draw_deflection(
    effector: Effector,
    *,
    cubics: Mapping[str, CubicFit] | None = None,
    measured: ArrayLike | None = None,
    points: int = 201,
) -> Figure:
    """Return a figure of the deflection by each muscle alone over its pressure (Fig. 4.16).

    Muscles with the same curve share a line. With cubics, a second panel shows how far each is
    off; where a cubic falls, the controller cannot use it, and it is drawn dotted.

    Parameters
    ----------
    effector : Effector
    cubics : mapping of str to CubicFit, optional
        Cubic fits by the name of the muscle.
    measured : (n, 2) array_like, optional
        Measurements to draw beside it: pressure [MPa], deflection [mm].
    points : int
        Pressures of a line.

    Raises
    ------
    InputError
        If an argument is outside its legal range, or a muscle has no answer.
    """
    from ..effector import balance

    points = check_integer("points", points, low=2, high=1_000_000)
    fits = dict(cubics or {})
    figure, panels = make_panels(2 if fits else 1)
    axes, limit = panels[0], effector.design.pressure_limit
    over = np.linspace(0.0, limit, points)
    colors = pick_colors(effector.design.names)
    curves = {name: balance(effector, name, over) for name in colors}
    lines = {name: np.asarray(curve.lateral) for name, curve in curves.items()}
    for k, names in enumerate(_group_lines(lines)):
        line, style = lines[names[0]], DASHES[k % len(DASHES)]
        axes.plot(
            1e3 * over, line, color=colors[names[0]], linewidth=1.9, linestyle=style,
            label=", ".join(names),
        )  # fmt: skip
        full = np.asarray(curves[names[0]].saturated)
        if full.any():
            axes.plot(1e3 * over[full], line[full], color=RED, linewidth=4.0, alpha=0.35,
                      label=f"{', '.join(names)} saturated")  # fmt: skip
        fit = next((fits[name] for name in names if name in fits), None)
        if fit is None:
            continue
        reach = np.linspace(fit.start, fit.limit, points)
        cubic = _evaluate(fit, reach)
        rising = reach >= fit.rising_from
        axes.plot(1e3 * reach[rising], cubic[rising], linestyle=_RISING, **_CUBIC)
        axes.plot(1e3 * reach[~rising], cubic[~rising], linestyle=_FALLING, **_CUBIC)
        exact = np.interp(reach, over, line)
        panels[1].plot(
            1e3 * reach, cubic - exact, color=colors[names[0]], linewidth=1.6, linestyle=style,
            label=f"{', '.join(names)}: {fit.rms_error:.2f} mm rms",
        )  # fmt: skip
    if fits:
        axes.plot([], [], linestyle=_RISING, label="cubic", **_CUBIC)
        if not all(fit.monotone for fit in fits.values()):
            axes.plot([], [], linestyle=_FALLING, label="cubic, where it falls", **_CUBIC)
        panels[1].axhline(0.0, color=INK, linewidth=0.8)
        panels[1].set(xlabel=_PRESSURE, ylabel="cubic less exact [mm]", xlim=(0.0, 1e3 * limit))
        panels[1].legend(frameon=False, fontsize=9)
    if measured is not None:
        rows = check_points("measured", measured, dim=2).reshape(-1, 2)
        axes.plot(1e3 * rows[:, 0], rows[:, 1], "o", color=INK, markerfacecolor="none",
                  markersize=5.5, label="measured", zorder=4)  # fmt: skip
    axes.set(xlabel=_PRESSURE, ylabel="deflection of the backbone's tip [mm]",
             xlim=(0.0, 1e3 * limit))  # fmt: skip
    axes.legend(frameon=False, fontsize=9)
    return figure


def draw_iteration(balances: Mapping[str, Balance]) -> Figure:
    """Return a figure of the thesis's fixed-point iteration (Tables 4.1-4.4).

    Left the force against the deflection of every row, right how much the force still changes.

    Parameters
    ----------
    balances : mapping of str to Balance
        Results of ``balance(..., method="fixed-point")`` at one pressure each, by what the legend
        calls them.

    Raises
    ------
    InputError
        If there is none, or one has no table.
    """
    if not balances:
        raise InputError("there are 0 iterations to draw: give 1 or more")
    figure, (left, right) = make_panels(2)
    for k, (name, found) in enumerate(balances.items()):
        table = np.asarray(found.table, dtype=np.float64)
        if table.ndim != 2 or not len(table):
            raise InputError(
                f"the balance '{name}' has no single iteration table: it must come from one "
                "pressure with method='fixed-point'"
            )
        force, _, lateral, following = table[:, :4].T
        style: dict[str, Any] = {
            "color": PALETTE[k % len(PALETTE)],
            "markersize": 4.5,
            "linewidth": 1.5,
        }
        left.plot(np.arange(1, len(table) + 1), lateral, "o-", label=name, **style)
        change = np.abs(following - force)
        right.semilogy(
            np.flatnonzero(change > 0.0) + 1, change[change > 0.0], "o-", label=name, **style
        )
    rows = max(len(np.asarray(found.table)) for found in balances.values())
    for axes in (left, right):
        axes.set_xlabel("row of the table")
        axes.set_xlim(0.5, rows + 0.5)
        axes.xaxis.get_major_locator().set_params(integer=True)
    if not any(len(line.get_xdata()) for line in right.lines):
        right.set_yscale("linear")
        right.set_yticks([])
        right.text(0.5, 0.5, "nothing changes: no muscle pulls", transform=right.transAxes,
                   ha="center", fontsize=9.5)  # fmt: skip
    left.set_ylabel("deflection δe [mm]")
    right.set_ylabel("change of the force |F* − F| [N]")
    left.legend(frameon=False, fontsize=9)
    return figure


def draw_trace(trace: Trace, names: Sequence[str], *, outline: ArrayLike | None = None) -> Figure:
    """Return a figure of a trace, as the thesis's Figs 4.23 and 4.24.

    Left what was wanted and what the model does, seen from the tip; right the pressures, step by
    step, with the steps that are out of reach shaded.

    Parameters
    ----------
    trace : Trace
    names : sequence of str
        The muscles, in the order of the design.
    outline : (k, 2) array_like, optional
        Boundary of the workspace [mm].

    Raises
    ------
    InputError
        If there are not as many names as muscles.
    """
    pressures = np.asarray(trace.pressures)
    if len(names) != pressures.shape[1]:
        raise InputError(f"there are {len(names)} names: give {pressures.shape[1]}, one a muscle")
    figure, (plane, axes) = make_panels(2, ratios=(1.0, 1.25))
    if outline is not None:
        edge = check_points("outline", outline, dim=2)
        plane.fill(*edge.T, facecolor="#eef2f6", edgecolor="#a9b4bf", linewidth=1.0)
    plane.plot(*trace.targets.T, color=AMBER, linewidth=3.4, alpha=0.55, label="wanted")
    plane.plot(*trace.achieved.T, color=INK, linewidth=1.3, label="achieved")
    lost = ~np.asarray(trace.reachable, dtype=np.bool_)
    if lost.any():
        plane.plot(*trace.targets[lost].T, "x", color=RED, markersize=4.5, label="out of reach")
    plane.plot(*trace.achieved[0], "o", color=INK, markersize=5.5)
    plane.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    plane.set_adjustable("datalim")
    plane.legend(frameon=False, fontsize=9, loc="best")
    worst = trace.reachable_error
    title = f"largest error {f'{worst:.2g}' if worst > _SMALL else f'below {_SMALL:g}'} mm"
    if lost.all():
        title = "nothing in reach"
    if lost.any():
        title += f"\n{np.count_nonzero(lost)} of {len(lost)} out of reach, by up to "
        title += f"{trace.largest_error:.2g} mm"
    plane.set_title(title, fontsize=10, loc="left")
    steps = np.arange(len(pressures))
    for k, (name, color) in enumerate(pick_colors(names).items()):
        axes.plot(
            steps, 1e3 * pressures[:, k], color=color, linewidth=1.7, label=name,
            linestyle=DASHES[k % len(DASHES)],
        )  # fmt: skip
    for begin, end in _find_runs(lost):
        axes.axvspan(begin - 0.5, end - 0.5, color="#f6e0de", lw=0, zorder=0)
    axes.set(xlabel="step", ylabel=_PRESSURE, xlim=(0, max(1, len(steps) - 1)))
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, fontsize=9, ncols=3)
    axes.set_title(f"pressures, {trace.pressure_map}", fontsize=10, loc="left")
    return figure


def _evaluate(fit: CubicFit, pressure: Floats) -> Floats:
    return np.asarray(fit.find_lateral(np.clip(pressure, fit.start, fit.limit)))


def _group_lines(lines: Mapping[str, Floats]) -> list[list[str]]:
    """Return the names of equal lines together."""
    groups: list[list[str]] = []
    for name, line in lines.items():
        for group in groups:
            if np.allclose(lines[group[0]], line, rtol=0.0, atol=1e-9):
                group.append(name)
                break
        else:
            groups.append([name])
    return groups


def _find_runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end of every run of true values."""
    padded = np.concatenate([[False], flags, [False]]).astype(np.int8)
    edges = np.flatnonzero(np.diff(padded))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def make_panels(count: int, *, ratios: tuple[float, ...] | None = None) -> tuple[Figure, list[Any]]:
    """Return a figure and its panels side by side."""
    figure = Figure(
        figsize=(5.8 if count == 1 else 9.6, 4.2), facecolor="white", layout="constrained"
    )
    panels = list(figure.subplots(1, count, squeeze=False, width_ratios=ratios or [1.0] * count)[0])
    for axes in panels:
        style_axes(axes)
    return figure, panels
