"""Methods side by side, drawn: clearance over the insertion, joint steps, joint movement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..errors import InputError
from ..motion.plan import Plan
from .plan_data import (
    METHOD_NAMES,
    Record,
    list_methods,
    read_centreline,
    read_movement,
    sample_motion,
    share_centreline,
)
from .style import INK, RED, Dash, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STYLES: dict[str, tuple[str, str | Dash]] = {
    "tube": ("#0072b2", "-"),
    "follow": ("#d55e00", (0, (6, 1.6))),
    "thesis": ("#6a3d9a", (0, (1.6, 1.2))),
}
# Okabe and Ito's colours, for methods that have none yet.
_SPARE: tuple[tuple[str, str | Dash], ...] = (
    ("#009e73", "-"),
    ("#a06c00", (0, (4, 1, 1, 1))),
    ("#56707f", (0, (3, 3))),
)


def draw_comparison(plans: Sequence[Plan], *, records: Sequence[Record] = ()) -> Figure:
    """Return a figure of several plans for the same tract and scope.

    Left: smallest clearance of the whole body over the insertion. Right: largest joint step per
    head step, and how far joints move in all against a freely pulled chain.

    Parameters
    ----------
    plans : sequence of Plan
        One a method, the one of most interest first.
    records : sequence of mapping
        The summary's `comparison`; what is missing is computed.

    Raises
    ------
    InputError
        If there is no plan, or arrays of a plan do not fit each other.
    """
    if not plans:
        raise InputError("no plan to compare was given: at least 1 is needed")
    rows = {str(row.get("method")): row for row in list_methods(plans, records)}
    plans = share_centreline(plans)
    names, styles = _name_plans(plans)
    figure = Figure(figsize=(11.6, 5.0), facecolor="white")
    main = figure.add_axes((0.065, 0.115, 0.475, 0.86))
    _draw_clearances(main, plans, names, styles)
    chosen = [rows[plan.method] for plan in plans]
    bars = (
        ("largest joint step per head step", [read_movement(row)["step"] for row in chosen]),
        (
            "joint movement, of a freely pulled chain's",
            [read_movement(row)["tractrix"] for row in chosen],
        ),
    )
    for k, (title, values) in enumerate(bars):
        axes = figure.add_axes((0.765, 0.60 - 0.485 * k, 0.2, 0.30))
        shown = [plan.method for plan in plans]
        _draw_bars(axes, title, values, shown, [style[0] for style in styles])
    return figure


def _name_plans(plans: Sequence[Plan]) -> tuple[list[str], list[tuple[str, str | Dash]]]:
    spare = iter(_SPARE * len(plans))
    names = [METHOD_NAMES.get(plan.method, plan.method) for plan in plans]
    return names, [_STYLES.get(plan.method) or next(spare) for plan in plans]


def _draw_clearances(
    axes: Axes, plans: Sequence[Plan], names: list[str], styles: list[tuple[str, str | Dash]]
) -> None:
    samples = [sample_motion(plan, count=500, worst_between=True) for plan in plans]
    forward = all(np.all(np.diff(sample.insertion) >= 0.0) for sample in samples)
    ends, low, high = [], 0.0, 0.5
    for plan, sample, name, (color, dash) in zip(plans, samples, names, styles, strict=True):
        if forward:
            over = np.maximum(read_centreline(plan).to_centreline(sample.insertion), 0.0)
        else:
            over = 100.0 * sample.steps / max(plan.steps - 1, 1)
        height = sample.smallest
        known = np.isfinite(height)
        over, height = over[known], height[known]
        proved = ",\nproved" if plan.meta.get("certified") else ""
        words = name + (proved if plan.status == "complete" else ",\nstops")
        if not len(over):
            ends.append((0.0, 0.0, f"{name},\ndoes not enter", color))
            continue
        axes.plot(over, height, color=color, linestyle=dash, linewidth=1.8)
        axes.plot(over[-1], height[-1], "o" if plan.status == "complete" else "X", color=color)
        ends.append((over[-1], height[-1], words, color))
        low = min(low, float(height.min()))
        # The first millimetres near the entry do not dictate the scale.
        top = 1.5 * float(np.percentile(height, 90)) + 0.3
        high = max(high, min(float(height.max()), top))
    margin = 0.08 * (high - low)
    axes.set_ylim(low - margin if low < 0.0 else -margin, high + margin)
    axes.axhspan(axes.get_ylim()[0], 0.0, color=RED, alpha=0.08, lw=0)
    axes.axhline(0.0, color=INK, linewidth=1.0)
    if low < 0.0:
        axes.text(
            0.01, 0.015, "through the wall", color=RED, fontsize=9, va="bottom",
            transform=axes.transAxes,
        )  # fmt: skip
    right = max(end[0] for end in ends) if forward else 100.0
    axes.set_xlim(0.0, max(right, 1.0))
    axes.set_xlabel("head's place along the tract [mm]" if forward else "share of the motion [%]")
    axes.set_ylabel("smallest clearance of the whole body [mm]")
    style_axes(axes)
    _label_ends(axes, ends)


def _label_ends(axes: Axes, ends: Sequence[tuple[float, float, str, str]]) -> None:
    """Write names to the right of the panel, none on another, each tied to its line's end."""
    bottom, top = axes.get_ylim()
    wanted = np.clip([end[1] for end in ends], bottom, top)
    heights = spread(np.asarray(wanted, dtype=np.float64), gap=0.105 * (top - bottom))
    for (x, y, words, color), height in zip(ends, heights, strict=True):
        axes.annotate(
            words,
            (x, y),
            xytext=(1.03, height),
            textcoords=axes.get_yaxis_transform(),
            color=color,
            fontsize=10,
            linespacing=1.05,
            fontweight="bold",
            va="center",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": color, "lw": 0.8, "alpha": 0.6 if x else 0.0},
        )


def spread(values: NDArray[np.float64], *, gap: float) -> NDArray[np.float64]:
    """Return `values` (n,) moved apart as little as needed to be `gap` from each other."""
    order = np.argsort(values, kind="stable")
    result = values.astype(np.float64).copy()
    for _ in range(50 * len(values)):
        lower, upper = result[order[:-1]], result[order[1:]]
        lack = gap - (upper - lower)
        worst = int(np.argmax(lack)) if len(lack) else 0
        if not len(lack) or lack[worst] <= 1e-9 * gap:
            break
        result[order[worst]] -= 0.5 * lack[worst]
        result[order[worst + 1]] += 0.5 * lack[worst]
    return result


def _draw_bars(
    axes: Axes,
    title: str,
    values: Sequence[float | None],
    names: Sequence[str],
    colors: Sequence[str],
) -> None:
    lengths = [0.0 if value is None else value for value in values]
    rows = np.arange(len(lengths))[::-1]
    axes.barh(rows, lengths, color=list(colors), height=0.62)
    longest = max([*lengths, 1.0])
    axes.axvline(1.0, color=INK, linewidth=1.0, linestyle=(0, (2, 2)))
    for row, value in zip(rows, values, strict=True):
        text = "–" if value is None else f"{value:.2f}×"
        axes.text(
            (value or 0.0) + 0.03 * longest, row, text, va="center", color=INK, fontsize=10,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.9},
        )  # fmt: skip
    axes.set_yticks(rows, names)
    for tick, color in zip(axes.get_yticklabels(), colors, strict=True):
        tick.set_color(color)
    axes.set_xlim(0.0, 1.3 * longest)
    axes.set_ylim(-0.6, len(lengths) - 0.4)
    axes.set_title(title, fontsize=10.5, color=INK, loc="right", x=1.08)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(left=False)
