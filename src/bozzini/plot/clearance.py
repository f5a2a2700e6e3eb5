"""The clearance map: how close each part of the scope comes to the wall, over the insertion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import ceil_mm
from ..motion.plan import Plan
from .plan_data import (
    MotionSample,
    PlanCentreline,
    Record,
    RefusalMark,
    find_radius,
    find_refusal,
    read_centreline,
    read_clearance,
    read_number,
    sample_motion,
)
from .scope import draw_color_bar
from .style import (
    AMBER,
    BLUE,
    INK,
    LUMEN,
    RED,
    ClearanceScale,
    choose_clearance_scale,
    draw_marker,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The lumen's inscribed radius along the tract, beside the scope's own.


def draw_radius(
    axes: Axes,
    plan: Plan,
    line: PlanCentreline,
    *,
    mark: RefusalMark | None,
    summary: Record,
    legend: Axes,
) -> None:
    """Draw radius across, place along the tract upwards, and mark what limits the scope.

    Parameters
    ----------
    axes : Axes
        The panel; its vertical axis is the place along the tract [mm].
    plan : Plan
    line : PlanCentreline
        Its radius is drawn to the goal, also where the plan ends before.
    mark : RefusalMark or None
    summary : mapping
        `passage_mm` is drawn if it is there.
    legend : Axes
        Empty axes to write the legend into.
    """
    axes.fill_betweenx(line.arc_length, 0.0, line.radius, color=LUMEN, lw=0)
    name = "lumen on the centreline" if line.is_centreline else "lumen on the head's path"
    handles = axes.plot(line.radius, line.arc_length, color=BLUE, linewidth=1.4, label=name)
    largest = float(line.radius.max())
    if line.is_centreline:
        soft = read_clearance(plan, summary).soft
        clearance = plan.path_radius - (0.0 if soft is None else soft.used)  # to the wall at rest
        handles += axes.plot(
            clearance, line.to_centreline(plan.path_arc_length), color="#6f7d8a", linewidth=1.1,
            linestyle=(0, (3, 1.2)), label="… on the head's path",
        )  # fmt: skip
        largest = max(largest, float(clearance.max()))
    scope = find_radius(plan)
    if scope > 0.0:
        handles.append(
            axes.axvline(
                scope, color=RED, linewidth=1.6, linestyle=(0, (5, 2)),
                label=f"the scope's, {scope:g} mm",
            )
        )  # fmt: skip
        axes.fill_betweenx(
            line.arc_length,
            0.0,
            scope,
            where=line.radius < scope,
            color=RED,
            alpha=0.4,
            lw=0,
        )
    passage = read_number(summary, "passage_mm")
    if passage is not None and passage > 0.0:
        handles.append(
            axes.axvline(
                passage, color=INK, linewidth=1.4, linestyle=(0, (1, 1.5)),
                label=f"passage, at most {ceil_mm(passage)} mm",
            )
        )  # fmt: skip
    if mark is not None and mark.needs is not None and mark.offers is not None:
        offers = max(0.0, mark.offers)
        axes.plot((offers, mark.needs), (mark.at, mark.at), color=AMBER, lw=3.0, clip_on=False)
        axes.plot(offers, mark.at, "o", color=AMBER, markersize=5, clip_on=False)
        handles += axes.plot(
            mark.needs, mark.at, "x", color=AMBER, markersize=9, markeredgewidth=2.4,
            linestyle="none", label="needs (✕), offers (●)", clip_on=False,
        )  # fmt: skip
        largest = max(largest, mark.needs)
    axes.set_xlim(0.0, 1.05 * max(largest, scope, 1e-9))
    axes.set_xlabel("inscribed radius [mm]")
    axes.tick_params(labelleft=False)
    legend.set_axis_off()
    legend.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(-0.03, -0.04), fontsize=8.5,
        frameon=False, borderpad=0.0, labelspacing=0.35, handlelength=1.9, handletextpad=0.6,
    )  # fmt: skip


_ROWS = 320
_GOAL = "#4b5a68"
_PAPER = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 2.5}


def draw_clearance(plan: Plan, *, summary: Record | None = None) -> Figure:
    """Return a figure of clearance over insertion and along the tract, with the lumen's radius.

    Top: smallest clearance of the whole body over insertion. Middle: clearance of the part of
    the scope that stands at each place of the tract. Right: inscribed radius of the lumen there
    and the scope's radius, to the goal if the plan holds the line. The tightest moment is
    marked, and the place where the planner refused to go on.

    Parameters
    ----------
    plan : Plan
    summary : mapping, optional
        `refusal` and `passage_mm` of it are drawn; a refusal in the plan is enough.

    Raises
    ------
    InputError
        If the plan's arrays do not fit each other.
    """
    sample = sample_motion(plan, count=600, worst_between=True)
    line, mark = read_centreline(plan), find_refusal(plan, summary)
    scale = choose_clearance_scale(sample.visible)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.6, 7.4), facecolor="white")
    grid = figure.add_gridspec(
        2, 3, width_ratios=(1.0, 0.28, 0.022), height_ratios=(0.32, 1.0), wspace=0.07, hspace=0.06
    )
    figure.subplots_adjust(left=0.075, right=0.925, top=0.985, bottom=0.085)
    top = figure.add_subplot(grid[0, 0])
    middle = figure.add_subplot(grid[1, 0], sharex=top)
    right = figure.add_subplot(grid[1, 1], sharey=middle)
    over, label = choose_abscissa(sample)

    fill_clearance(top, sample, scale=scale, ink=INK)
    top.set_ylabel("smallest\nclearance [mm]")
    top.tick_params(labelbottom=False)
    _draw_map(middle, sample, scale=scale, over=over, length=line.length)
    middle.set_xlabel(label)
    _mark_tightest(middle, sample, over=over, length=line.length)
    _mark_ends(middle, line, mark, over=over, tightest=sample.find_tightest(), sample=sample)
    draw_radius(
        right,
        plan,
        line,
        mark=mark,
        summary=summary or {},
        legend=figure.add_subplot(grid[0, 1:]),
    )
    right.axhline(line.length, color=_GOAL, linewidth=1.2)
    draw_color_bar(figure, figure.add_subplot(grid[1, 2]), scale, color=INK, vertical=True)
    for axes in (top, middle, right):
        style_axes(axes, grid=axes is not middle)
    return figure


def _draw_map(
    axes: Axes,
    sample: MotionSample,
    *,
    scale: ClearanceScale,
    over: NDArray[np.float64],
    length: float,
) -> None:
    image = map_clearance(sample, over=over, length=length)
    color_map, norm = scale.build_color_map()
    axes.imshow(
        np.ma.masked_invalid(image),
        origin="lower",
        extent=(*_widen(over), 0.0, length),
        cmap=color_map,
        norm=norm,
        aspect="auto",
        interpolation="nearest",
    )
    axes.set_ylabel("place along the tract [mm]")
    axes.set_ylim(0.0, 1.035 * length)


def _mark_tightest(
    axes: Axes, sample: MotionSample, *, over: NDArray[np.float64], length: float
) -> None:
    row, link = sample.find_tightest()
    if not sample.in_tract[row, link]:
        axes.text(
            0.5, 0.5, "nothing of the scope enters the tract", color=INK, ha="center",
            transform=axes.transAxes,
        )  # fmt: skip
        return
    spot = (over[row], 0.5 * (sample.places[row, link] + sample.places[row, link + 1]))
    for edge, wide in (("white", 4.0), (INK, 1.8)):
        draw_marker(axes, spot, "o", size=15, color=edge, width=wide, clip_on=False)
    side = -1 if over[row] > 0.5 * (over[0] + over[-1]) else 1
    axes.annotate(
        f"tightest: {_show(sample.visible[row, link])} mm",
        spot,
        xytext=(14 * side, -20 if spot[1] > 0.8 * length else 14),
        textcoords="offset points",
        color=INK,
        fontweight="bold",
        ha="left" if side > 0 else "right",
        bbox=_PAPER,
    )


def _mark_ends(
    axes: Axes,
    line: PlanCentreline,
    mark: RefusalMark | None,
    *,
    over: NDArray[np.float64],
    tightest: tuple[int, int],
    sample: MotionSample,
) -> None:
    """Draw the goal, how far the head got, and the place that was refused."""
    left, right = _widen(over)
    axes.axhline(line.length, color=_GOAL, linewidth=1.2)
    # Without the centreline a path that was refused is known only up to where it ends.
    word = "goal" if mark is None or line.is_centreline else "the head's path ends"
    if mark is None or abs(mark.at - line.length) > 0.06 * line.length:
        axes.text(
            0.008, line.length, f"{word}, {line.length:.0f} mm", color=_GOAL, fontsize=9,
            va="bottom", transform=axes.get_yaxis_transform(),
        )  # fmt: skip
    if mark is None:
        return
    axes.axhline(mark.at, color=AMBER, linewidth=1.6, linestyle=(0, (6, 2)))
    # Below the line, unless the tightest moment is written there; on the side away from it.
    row, link = tightest
    near = abs(float(sample.places[row, link]) - mark.at) < 0.15 * line.length
    leftwards = near and over[row] > 0.5 * (left + right)
    below = mark.at > 0.12 * line.length
    axes.annotate(
        f"✕ {mark.text}",
        (0.01 if leftwards else 0.99, mark.at),
        xycoords=axes.get_yaxis_transform(),
        xytext=(0, -5 if below else 5),
        textcoords="offset points",
        color=AMBER,
        fontweight="bold",
        ha="left" if leftwards else "right",
        va="top" if below else "bottom",
        bbox=_PAPER,
    )


def fill_clearance(axes: Axes, sample: MotionSample, *, scale: ClearanceScale, ink: str) -> None:
    """Draw the smallest clearance over insertion, coloured by its value, with the wall at 0."""
    from matplotlib.collections import LineCollection

    over, _ = choose_abscissa(sample)
    height = sample.smallest
    known = np.isfinite(height)
    over, height = over[known], height[known]
    if not len(over):
        axes.set_ylim(-1.0, 1.0)
        return
    axes.fill_between(over, height, 0.0, where=height < 0.0, color="#d63c3c", alpha=0.35, lw=0)
    points = np.stack([over, height], axis=-1)
    colors = scale.color(np.minimum(height[1:], height[:-1]))
    if len(over) == 1:
        axes.plot(over, height, "o", color=scale.color(height)[0], markersize=7)
    axes.add_collection(
        LineCollection(
            list(np.stack([points[:-1], points[1:]], axis=1)),
            colors=[tuple(color) for color in colors] if ink != INK else ink,
            linewidths=2.4 if ink != INK else 1.3,
            capstyle="round",
        )
    )
    axes.axhline(0.0, color=ink, linewidth=1.0)
    low = int(np.argmin(height))
    draw_marker(axes, (over[low], height[low]), "o", size=10, color=ink, width=1.6, clip_on=False)
    left_half = over[low] < 0.5 * (over[0] + over[-1])
    axes.annotate(
        f"{_show(height[low])} mm",
        (over[low], height[low]),
        xytext=(8 if left_half else -8, -3),  # below the lowest point there is no line
        textcoords="offset points",
        color=ink,
        fontsize=12,
        fontweight="bold",
        ha="left" if left_half else "right",
        va="top",
    )
    span = max(float(np.percentile(height, 90)), 0.0) - min(float(height.min()), 0.0)
    span = max(span, 0.5)
    axes.set_xlim(*_widen(over))
    axes.set_ylim(min(float(height.min()), 0.0) - 0.18 * span, max(_top(height), 0.0) + 0.15 * span)


def _top(height: NDArray[np.float64]) -> float:
    """Return an upper limit that the first millimetres near the entry do not dictate."""
    return min(float(height.max()), 1.6 * float(np.percentile(height, 90)) + 0.5)


def map_clearance(
    sample: MotionSample, *, over: NDArray[np.float64], length: float
) -> NDArray[np.float64]:
    """Return clearance on a regular raster: rows along the tract, columns over the motion.

    Parameters
    ----------
    sample : MotionSample
    over : (k,) float
        What the columns run over: insertion [mm] or step number; not decreasing.
    length : float
        Length of the tract [mm].

    Returns
    -------
    (rows, columns) float
        NaN where no link stands.
    """
    middles = (np.arange(_ROWS) + 0.5) * length / _ROWS
    image = np.full((_ROWS, len(over)), np.nan)
    for k in range(len(over)):
        fronts = sample.places[k, ::-1]  # rising: from the base to the head
        link = len(fronts) - 1 - np.searchsorted(fronts, middles, side="left")
        known = (link >= 0) & (link < len(fronts) - 1)
        image[known, k] = sample.visible[k, link[known]]
    image[np.isinf(image)] = np.nan
    left, right = _widen(over)
    columns = left + (np.arange(max(len(over), 2)) + 0.5) * (right - left) / max(len(over), 2)
    nearest = np.clip(np.searchsorted(over, columns), 0, len(over) - 1)
    return image[:, nearest]


def choose_abscissa(sample: MotionSample) -> tuple[NDArray[np.float64], str]:
    """Return insertion, or the step number where the scope goes back and forth."""
    if np.all(np.diff(sample.insertion) >= 0.0):
        return sample.insertion, "insertion [mm]"
    return sample.steps.astype(np.float64), "step"


def _widen(over: NDArray[np.float64]) -> tuple[float, float]:
    left, right = float(over[0]), float(over[-1])
    return (left, right) if right > left else (left - 0.5, right + 0.5)


def _show(value: float) -> str:
    return f"{value:.2f}".replace("-", "\N{MINUS SIGN}")
