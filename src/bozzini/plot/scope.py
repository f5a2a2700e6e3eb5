"""Drawing one panel: the lumen's picture, the scope on it, scale bar and body directions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..motion.plan import Plan
from .fluoroscopy import Projection
from .plan_data import (
    MotionSample,
    PlanCentreline,
    RefusalMark,
    read_number,
)
from .style import ClearanceScale, color_lumen, draw_marker

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The ends of a tract as numbered marks: in the report's table and in its pictures.


@dataclass(frozen=True, kw_only=True, eq=False)
class EndMark:
    """One place where a centreline could begin or end.

    Attributes
    ----------
    number : int
        From 1, in the table and in the pictures.
    name, role : str
        What it is, and what it was taken for.
    point : (3,) float
        World frame [mm].
    radius, length : float or None
        Of an opening; of the centreline from the opposite end [mm].
    """

    number: int
    name: str
    role: str
    point: NDArray[np.float64]
    radius: float | None
    length: float | None

    @property
    def place(self) -> str:
        """The point for people."""
        return ", ".join(f"{value:.1f}" for value in self.point)


def list_marks(plan: Plan) -> list[EndMark]:
    """Return the ends that a plan records, [] where it records none."""
    records = plan.meta.get("ends")
    if isinstance(records, str) or not isinstance(records, Sequence):
        return []
    marks: list[EndMark] = []
    for record in records:
        if not isinstance(record, Mapping):
            continue
        point = np.asarray(record.get("point_mm"), dtype=np.float64)
        if point.shape != (3,) or not np.isfinite(point).all():
            continue
        kind = {"opening": "opening ", "landmark": "landmark "}.get(str(record.get("kind")), "")
        marks.append(
            EndMark(
                number=len(marks) + 1,
                name=f"{kind}{record.get('name')}",
                role=str(record.get("role") or ""),
                point=point,
                radius=read_number(record, "radius_mm"),
                length=read_number(record, "length_mm"),
            )
        )
    return marks


REST = "#ff9d3c"
"""Colour of what was not reached, and of the place that was refused, on dark ground."""

MARK = "#ffe066"
"""Colour of the numbered ends of the tract, on dark ground."""

_OUTLINE = "#05080c"
_INTRODUCER = "#7b8a99"


def draw_panel(axes: Axes, picture: Projection, *, legend: bool = True) -> None:
    """Draw the lumen into bare axes, and in its emptiest corners a scale bar and a compass."""
    axes.imshow(
        color_lumen(picture.image),
        extent=picture.extent,
        interpolation="bilinear",
        interpolation_stage="rgba",
        aspect="equal",
    )
    axes.set_xlim(picture.extent[:2])
    axes.set_ylim(picture.extent[2:])
    axes.set_axis_off()
    if legend:
        corners = _rank_corners(picture)
        _draw_bar(axes, picture, *corners[0])
        _draw_compass(axes, picture, *corners[1])


def _rank_corners(picture: Projection) -> list[tuple[int, int]]:
    """Return the corners (right?, top?) with the emptiest first, the lower ones before."""
    rows, columns = (max(1, round(0.2 * n)) for n in picture.image.shape)
    filled = {}
    for right, top in ((0, 0), (1, 0), (0, 1), (1, 1)):
        across = slice(-columns, None) if right else slice(0, columns)
        down = slice(0, rows) if top else slice(-rows, None)
        filled[right, top] = (
            round(float((picture.image[down, across] > 0.02).mean()), 1) + 0.15 * top
        )
    return sorted(filled, key=lambda corner: filled[corner])


def _draw_bar(axes: Axes, picture: Projection, right: int, top: int) -> None:
    length = choose_bar_length(picture.width)
    x = picture.extent[0] + 0.04 * picture.width
    if right:
        x = picture.extent[1] - 0.04 * picture.width - length
    y = picture.extent[2] + (0.93 if top else 0.04) * picture.height
    axes.plot([x, x + length], [y, y], color="white", linewidth=2.5, solid_capstyle="butt")
    axes.annotate(
        f"{length:g} mm",
        (x + 0.5 * length, y),
        xytext=(0, 4),
        textcoords="offset points",
        color="white",
        fontsize=10,
        ha="center",
    )


def _draw_compass(axes: Axes, picture: Projection, right: int, top: int) -> None:
    arm = 0.055 * min(picture.width, picture.height)
    u = picture.extent[int(right)] + (-1 if right else 1) * (2.2 * arm)
    v = picture.extent[2 + int(top)] + (-1 if top else 1) * (2.4 * arm)
    axes.plot([u - arm, u + arm], [v, v], color="#93a5b6", linewidth=1.0)
    axes.plot([u, u], [v - arm, v + arm], color="#93a5b6", linewidth=1.0)
    for text, across, over in zip(picture.labels, (-1, 1, 0, 0), (0, 0, -1, 1), strict=True):
        axes.text(
            u + 1.55 * arm * across,
            v + 1.65 * arm * over,
            text,
            color="#c3cfda",
            fontsize=10,
            ha="center",
            va="center",
        )


def choose_bar_length(width: float) -> float:
    """Return 50 mm, or the round length that suits a picture far smaller or larger [mm]."""
    if 80.0 <= width <= 500.0:
        return 50.0
    power = 10.0 ** math.floor(math.log10(0.4 * width))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= 0.4 * width)


def find_violations(clearance: NDArray[np.float64]) -> list[int]:
    """Return the worst link of every run of neighbouring links with negative clearance."""
    through = np.flatnonzero(clearance < 0.0)
    if not through.size:
        return []
    runs = np.split(through, np.flatnonzero(np.diff(through) > 1) + 1)
    return [int(run[np.argmin(clearance[run])]) for run in runs]


def draw_scope(
    axes: Axes,
    picture: Projection,
    sample: MotionSample,
    row: int,
    *,
    scale: ClearanceScale,
    radius: float = 0.0,
) -> None:
    """Draw the scope at one sampled step, links coloured by clearance, true to its diameter.

    Parameters
    ----------
    axes : Axes
        Axes already sized, with limits in picture coordinates.
    picture : Projection
    sample : MotionSample
    row : int
        Row of the sample.
    scale : ClearanceScale
    radius : float
        Radius of the scope [mm]; lines never get thinner than legible.
    """
    from matplotlib.collections import LineCollection

    place = picture.project(sample.joints[row])
    links = np.stack([place[:-1], place[1:]], axis=1)
    shown = sample.in_tract[row]
    points_per_mm = 72.0 * axes.get_window_extent().width / axes.figure.dpi / picture.width
    width = max(2.6, 2.0 * radius * points_per_mm)
    outside = links[~shown]
    if len(outside):
        axes.add_collection(
            LineCollection(list(outside), colors=_INTRODUCER, linewidths=0.55 * width, alpha=0.55)
        )
    # From the base to the head, so that the head lies on top.
    order = np.flatnonzero(shown)[::-1]
    colors = scale.color(sample.clearance[row])
    axes.add_collection(
        LineCollection(
            list(links[order]), colors=_OUTLINE, linewidths=width + 2.2, capstyle="round"
        )
    )
    axes.add_collection(
        LineCollection(list(links[order]), colors=colors[order], linewidths=width, capstyle="round")
    )
    size = max(6.5, 1.12 * width)
    draw_marker(axes, place[0], "o", size=size, face="white", color=_OUTLINE, width=1.4)
    spots = find_violations(sample.visible[row])
    if spots:
        middle = links[spots].mean(axis=1)
        ring = max(15.0, width + 12.0)
        for edge, wide in ((_OUTLINE, 3.4), ("#ffffff", 1.7)):
            draw_marker(axes, middle.T, "o", size=ring, color=edge, width=wide)


def draw_rest(
    axes: Axes,
    picture: Projection,
    line: PlanCentreline,
    *,
    reached: float,
    mark: RefusalMark | None,
) -> None:
    """Draw the centreline that was not reached as dots, and a cross where the planner refused.

    Parameters
    ----------
    axes : Axes
    picture : Projection
    line : PlanCentreline
    reached : float
        Arc length of the centreline where the motion ends [mm].
    mark : RefusalMark or None
    """
    rest = line.points_beyond(reached)
    if len(rest):
        place = picture.project(rest)
        axes.plot(*place.T, color=_OUTLINE, linewidth=3.0, alpha=0.5)
        axes.plot(
            *place.T, color=REST, linewidth=2.2, linestyle=(0, (0.1, 2.2)), dash_capstyle="round"
        )
    if mark is not None:
        spot = picture.project(line.point_at(mark.at))
        for color, wide, size in ((_OUTLINE, 6.0, 15.0), (REST, 3.0, 13.0)):
            draw_marker(axes, spot, "x", size=size, color=color, width=wide, zorder=4)


def draw_marks(axes: Axes, picture: Projection, marks: Sequence[EndMark]) -> None:
    """Draw the ends of the tract as numbered rings."""
    for mark in marks:
        u, v = picture.project(mark.point)
        draw_marker(axes, (u, v), "o", size=7.0, color=MARK, width=1.4, zorder=5)
        axes.annotate(
            str(mark.number),
            (u, v),
            xytext=(6, 3),
            textcoords="offset points",
            color=MARK,
            fontsize=9,
            zorder=5,
        )


def draw_color_bar(
    figure: Figure,
    axes: Axes,
    scale: ClearanceScale,
    *,
    color: str,
    vertical: bool = False,
    below: str = "through the wall",
) -> None:
    """Draw the clearance scale into the given axes."""
    from matplotlib.cm import ScalarMappable

    color_map, norm = scale.build_color_map()
    bar = figure.colorbar(
        ScalarMappable(norm, color_map),
        cax=axes,
        orientation="vertical" if vertical else "horizontal",
        ticks=choose_ticks(scale),
    )
    bar.outline.set_visible(False)
    axes.tick_params(colors=color, labelsize=10, length=3)
    label = f"clearance [mm], below 0 {below}"
    bar.set_label(label if not vertical else "clearance [mm]", color=color, fontsize=11)


def choose_ticks(scale: ClearanceScale) -> list[float]:
    """Return a few ticks with both ends and zero among them."""
    step = 1.0
    for step in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0):
        if (scale.high - scale.low) / step <= 8:
            break
    inner = np.arange(math.ceil(scale.low / step), math.floor(scale.high / step) + 1) * step
    return [float(tick) for tick in inner]
