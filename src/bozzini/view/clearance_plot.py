"""The clearance map: how close each part of the scope comes to the wall, over the insertion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from .palette import INK, RED, ClearanceScale, choose_clearance_scale
from .sampling import MotionSample, find_radius, sample_motion
from .scope_drawing import draw_color_bar

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..motion.plan import Plan

__all__ = ["draw_clearance", "fill_clearance", "map_clearance"]

_ROWS = 320
_BLUE = "#1f5fa8"
_GRID = "#e3e8ed"


def draw_clearance(plan: Plan) -> Figure:
    """Return a figure of clearance over insertion and along the tract, with the lumen's radius.

    Top: smallest clearance of the whole body over insertion. Middle: clearance of the part of
    the scope that stands at each place of the tract. Right: inscribed radius of the lumen there
    and the scope's radius. The tightest moment is marked.

    Raises
    ------
    InputError
        If the plan's arrays do not fit each other.
    """
    sample = sample_motion(plan, count=600, worst_between=True)
    scale = choose_clearance_scale(sample.visible)
    figure = Figure(figsize=(11.6, 7.4), facecolor="white")
    grid = figure.add_gridspec(
        2, 3, width_ratios=(1.0, 0.26, 0.022), height_ratios=(0.32, 1.0), wspace=0.07, hspace=0.06
    )
    figure.subplots_adjust(left=0.075, right=0.925, top=0.985, bottom=0.085)
    top = figure.add_subplot(grid[0, 0])
    middle = figure.add_subplot(grid[1, 0], sharex=top)
    right = figure.add_subplot(grid[1, 1], sharey=middle)
    bar = figure.add_subplot(grid[1, 2])
    over, label = _choose_abscissa(sample)

    fill_clearance(top, sample, scale=scale, ink=INK)
    top.set_ylabel("smallest\nclearance [mm]")
    top.tick_params(labelbottom=False)

    length = float(plan.path_arc_length[-1])
    image = map_clearance(sample, over=over, length=length)
    color_map, norm = scale.build_color_map()
    middle.imshow(
        np.ma.masked_invalid(image),
        origin="lower",
        extent=(*_widen(over), 0.0, length),
        cmap=color_map,
        norm=norm,
        aspect="auto",
        interpolation="nearest",
    )
    middle.set_xlabel(label)
    middle.set_ylabel("place along the tract [mm]")
    middle.set_ylim(0.0, length)
    row, link = sample.find_tightest()
    if sample.in_tract[row, link]:
        spot = (over[row], 0.5 * (sample.places[row, link] + sample.places[row, link + 1]))
        for edge, wide in (("white", 4.0), (INK, 1.8)):
            middle.plot(
                *spot,
                "o",
                markersize=15,
                markerfacecolor="none",
                markeredgecolor=edge,
                mew=wide,
                clip_on=False,
            )
        high = spot[1] > 0.8 * length
        side = -1 if over[row] > 0.5 * (over[0] + over[-1]) else 1
        middle.annotate(
            f"tightest: {_show(sample.visible[row, link])} mm",
            spot,
            xytext=(14 * side, -20 if high else 14),
            textcoords="offset points",
            color=INK,
            fontweight="bold",
            ha="left" if side > 0 else "right",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 2.5},
        )
    _draw_radius(right, plan)
    draw_color_bar(figure, bar, scale, color=INK, vertical=True)
    for axes in (top, right):
        axes.grid(color=_GRID, linewidth=0.8)
        axes.set_axisbelow(True)
    for axes in (top, middle, right):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def fill_clearance(axes: Axes, sample: MotionSample, *, scale: ClearanceScale, ink: str) -> None:
    """Draw the smallest clearance over insertion, coloured by its value, with the wall at 0."""
    from matplotlib.collections import LineCollection

    over, _ = _choose_abscissa(sample)
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
    axes.plot(
        over[low], height[low], "o", markersize=10, markerfacecolor="none", markeredgecolor=ink,
        markeredgewidth=1.6, clip_on=False,
    )  # fmt: skip
    left_half = over[low] < 0.5 * (over[0] + over[-1])
    axes.annotate(
        f"{_show(height[low])} mm",
        (over[low], height[low]),
        xytext=(11 if left_half else -11, 0),
        textcoords="offset points",
        color=ink,
        fontsize=12,
        fontweight="bold",
        ha="left" if left_half else "right",
        va="center",
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


def _choose_abscissa(sample: MotionSample) -> tuple[NDArray[np.float64], str]:
    """Return insertion, or the step number where the scope goes back and forth."""
    if np.all(np.diff(sample.insertion) >= 0.0):
        return sample.insertion, "insertion [mm]"
    return sample.steps.astype(np.float64), "step"


def _widen(over: NDArray[np.float64]) -> tuple[float, float]:
    left, right = float(over[0]), float(over[-1])
    return (left, right) if right > left else (left - 0.5, right + 0.5)


def _show(value: float) -> str:
    return f"{value:.2f}".replace("-", "\N{MINUS SIGN}")


def _draw_radius(axes: Axes, plan: Plan) -> None:
    """Draw the inscribed radius along the tract beside the map, and the scope's own."""
    place, radius = plan.path_arc_length, plan.path_radius
    axes.fill_betweenx(place, 0.0, radius, color="#d7e3ee", lw=0)
    axes.plot(radius, place, color=_BLUE, linewidth=1.4)
    scope = find_radius(plan)
    if scope > 0.0:
        axes.axvline(scope, color=RED, linewidth=1.6, linestyle=(0, (5, 2)))
        axes.fill_betweenx(place, 0.0, scope, where=radius < scope, color=RED, alpha=0.45, lw=0)
        axes.text(
            scope, 1.005, f" scope {scope:g} mm", color=RED, transform=axes.get_xaxis_transform(),
            va="bottom", ha="left", fontsize=9,
        )  # fmt: skip
    axes.set_xlim(0.0, 1.05 * max(float(radius.max()), scope, 1e-9))
    axes.set_xlabel("inscribed radius [mm]")
    axes.tick_params(labelleft=False)
