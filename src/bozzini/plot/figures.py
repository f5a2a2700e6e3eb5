"""Figures of a plan: the scope in the tract at several depths, and its clearance.

Drawn with matplotlib's objects only (no pyplot), so that no window, backend or global state is
touched. Every function returns a `Figure`; `write_figure` writes it.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..checks import check_integer
from ..errors import InputError
from ..io.files import write_atomically
from .clearance import choose_abscissa, fill_clearance
from .fluoroscopy import Projection, render_fluoroscopy
from .plan_data import (
    MotionSample,
    PlanCentreline,
    RefusalMark,
    find_radius,
    find_refusal,
    read_centreline,
    read_clearance,
    sample_motion,
)
from .scope import REST, draw_color_bar, draw_marks, draw_panel, draw_rest, draw_scope, list_marks
from .style import NIGHT, ClearanceScale, choose_clearance_scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..duct.field import SampledField
    from ..motion.plan import Plan

_FAINT = "#8fa1b3"


def write_figure(drawn: Figure | Axes, path: str | os.PathLike[str], *, dpi: float = 100.0) -> Path:
    """Write a figure in the format its suffix names (.png, .svg, .pdf) and return the path.

    Parameters
    ----------
    drawn : Figure or Axes
        A figure, or axes of it.
    path : path-like
    dpi : float
        Pixels an inch.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    from matplotlib.text import Text

    figure = drawn if isinstance(drawn, Figure) else drawn.get_figure(root=True)
    if figure is None:
        raise InputError("the axes belong to no figure: draw them again")
    for text in figure.findobj(Text):  # bytes of a file name that are not UTF-8 have no glyph
        text.set_text(text.get_text().encode("utf-8", "backslashreplace").decode("utf-8"))

    def save(temporary: Path) -> None:
        with warnings.catch_warnings():
            # A letter that the font lacks is drawn as a box.
            warnings.filterwarnings("ignore", message="Glyph", category=UserWarning)
            figure.savefig(temporary, dpi=dpi, facecolor=figure.get_facecolor())

    return write_atomically(path, save)


def draw_depths(
    plan: Plan,
    field: SampledField,
    *,
    depths: int = 5,
    views: tuple[str, ...] = ("coronal", "sagittal"),
) -> Figure:
    """Return a dark figure of the scope in the tract: one column a depth, one row a view.

    Parameters
    ----------
    plan : Plan
    field : SampledField
        The lumen that the plan was made in.
    depths : int
        How many insertion depths, the last being as far as the plan goes.
    views : tuple of str
        Views of `render_fluoroscopy`.

    Raises
    ------
    InputError
        If the plan's arrays do not fit each other, or an argument is out of range.
    """
    check_integer("number of depths", depths, low=1, high=12)
    view = _View(plan, sample_motion(plan, count=300))
    sample, scale, rest = view.sample, view.scale, view.rest
    rows = _pick_depths(sample, depths)
    pictures = [render_fluoroscopy(field, axis=name) for name in views]
    inches, head, foot, gap = 16.0, 0.42, 0.72, 0.06
    column = (inches - gap * (len(rows) + 1)) / len(rows)
    per_mm = min(
        column / max(picture.width for picture in pictures),
        9.0 / sum(picture.height for picture in pictures),
    )
    column = per_mm * max(picture.width for picture in pictures)
    inches = max(8.0, column * len(rows) + gap * (len(rows) + 1))
    tall = head + foot + sum(per_mm * picture.height + gap for picture in pictures)
    figure = Figure(figsize=(inches, tall), facecolor=NIGHT)
    for i, row in enumerate(rows):
        left = gap + i * (column + gap) + 0.5 * (inches - gap - len(rows) * (column + gap))
        figure.text(
            (left + 0.5 * column) / inches,
            1.0 - 0.5 * head / tall,
            f"{sample.insertion[row]:.0f} mm",
            color="white",
            fontsize=13,
            fontweight="bold",
            ha="center",
            va="center",
        )
        top = tall - head
        for picture in pictures:
            size = (per_mm * picture.width, per_mm * picture.height)
            top -= size[1]
            axes = _add_axes(figure, left + 0.5 * (column - size[0]), top, size[0], size[1])
            view.draw(axes, picture, row, first=i == 0)
            top -= gap
    shift = 0.0 if rest is None else 0.21 * inches
    wide = min(5.0, 0.45 * inches)
    bar = _add_axes(figure, 0.5 * inches - 0.5 * wide - shift, 0.5, wide, 0.12)
    soft = read_clearance(plan, {}).soft is not None
    below = "pushing the wall" if soft else "through the wall"
    draw_color_bar(figure, bar, scale, color="white", below=below)
    if rest is not None:
        _write_rest(figure, (0.98, 0.42 / tall), rest[2])
    return figure


def draw_overview(
    plan: Plan, field: SampledField, *, depths: int = 3, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Return one wide picture (1600 x 900 at 100 dpi): the scope at some depths, its clearance.

    Parameters
    ----------
    plan : Plan
    field : SampledField
        The lumen that the plan was made in.
    depths : int
        How many insertion depths.
    path : path-like, optional
        Also write the picture there.

    Raises
    ------
    InputError
        If the plan's arrays do not fit each other, or an argument is out of range.
    OutputError
        If the file cannot be written.
    """
    check_integer("number of depths", depths, low=1, high=8)
    view = _View(plan, sample_motion(plan, count=400, worst_between=True))
    sample, scale, rest = view.sample, view.scale, view.rest
    picture = render_fluoroscopy(field, axis="coronal")
    figure = Figure(figsize=(16.0, 9.0), facecolor=NIGHT)
    rows = _pick_depths(sample, depths)
    gap, strip = 0.12, 2.45
    cell_wide, cell_tall = (16.0 - gap) / len(rows) - gap, 9.0 - strip - 0.5
    per_mm = min(cell_wide / picture.width, cell_tall / picture.height)
    whole = len(rows) * (per_mm * picture.width + gap) - gap
    for i, row in enumerate(rows):
        wide, tall = per_mm * picture.width, per_mm * picture.height
        if whole < 15.0:  # spread narrow tracts over the whole width
            left = (16.0 / len(rows)) * (i + 0.5) - 0.5 * wide
        else:
            left = 0.5 * (16.0 - whole) + i * (wide + gap)
        place = (left, strip + 0.5 * (cell_tall - tall), wide, tall)
        view.draw(_add_axes(figure, *place), picture, row, first=i == 0)
        figure.text(
            (left + 0.5 * wide) / 16.0,
            8.78 / 9.0,
            f"{sample.insertion[row]:.0f} mm inserted",
            color="white",
            fontsize=16,
            fontweight="bold",
            ha="center",
            va="center",
        )
    strip_axes = _add_axes(figure, 1.05, 0.62, 12.6, strip - 0.82)
    _draw_strip(strip_axes, sample, scale, rows)
    bar = _add_axes(figure, 14.35, 0.62, 0.16, strip - 0.82)
    draw_color_bar(figure, bar, scale, color="white", vertical=True)
    if rest is not None:
        _write_rest(figure, (0.94, strip / 9.0 + 0.005), rest[2])
    if path is not None:
        write_figure(figure, path)
    return figure


def film_motion(
    plan: Plan, field: SampledField, *, count: int = 200
) -> Iterator[NDArray[np.uint8]]:
    """Give X-ray pictures (720, 1280, 3) of a motion, from its first to its last step.

    Parameters
    ----------
    plan : Plan
    field : SampledField
        The lumen that the plan was made in.
    count : int
        About how many pictures.

    Raises
    ------
    InputError
        If the plan's arrays do not fit each other, or `count` is below 2.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    view = _View(plan, sample_motion(plan, count=count))
    pictures = [render_fluoroscopy(field, axis=axis) for axis in ("coronal", "sagittal")]
    per_mm = min(12.4 / sum(p.width for p in pictures), 5.5 / max(p.height for p in pictures))
    for row, value in enumerate(view.sample.smallest):
        figure = Figure(figsize=(12.8, 7.2), dpi=100, facecolor=NIGHT)
        canvas = FigureCanvasAgg(figure)
        left = 6.4 - 0.5 * per_mm * sum(p.width for p in pictures)
        for picture in pictures:
            wide, tall = per_mm * picture.width, per_mm * picture.height
            place = _add_axes(figure, left, 1.6 + 0.5 * (5.5 - tall), wide, tall)
            view.draw(place, picture, row, first=picture is pictures[0])
            left += wide + 0.1
        strip = _add_axes(figure, 1.25, 0.62, 11.2, 0.9)
        _draw_strip(strip, view.sample, view.scale, [row])
        words = f"{view.sample.insertion[row]:.0f} mm inserted"
        if np.isfinite(value):
            words += f", clearance {value:.2f} mm".replace("-", "\N{MINUS SIGN}")
        figure.text(0.985, 0.965, words, color="white", fontsize=15, ha="right", va="top")
        canvas.draw()  # type: ignore[no-untyped-call]
        yield np.asarray(canvas.buffer_rgba())[..., :3]  # type: ignore[no-untyped-call]


def _pick_depths(sample: MotionSample, count: int) -> list[int]:
    """Return rows of the sample at evenly spread insertion, the last one included."""
    goal = float(sample.insertion.max())
    wanted = goal * np.arange(1, count + 1) / count
    rows = [int(np.argmin(np.abs(sample.insertion - depth))) for depth in wanted]
    return list(dict.fromkeys(rows))


class _View:
    """What is drawn into every picture of a motion."""

    def __init__(self, plan: Plan, sample: MotionSample) -> None:
        self.plan, self.sample = plan, sample
        self.scale = choose_clearance_scale(sample.visible)
        self.rest: tuple[PlanCentreline, float, RefusalMark | None] | None = None
        if plan.status == "stopped":
            reached = max(0.0, float(sample.places[:, 0].max()))
            self.rest = (read_centreline(plan), reached, find_refusal(plan))

    def draw(self, axes: Axes, picture: Projection, row: int, *, first: bool) -> None:
        """Draw the lumen, the centreline not reached and the scope at a row of the sample."""
        draw_panel(axes, picture, legend=first)
        if first:
            draw_marks(axes, picture, list_marks(self.plan))
        if self.rest is not None:
            line, reached, mark = self.rest
            draw_rest(axes, picture, line, reached=reached, mark=mark)
        radius = find_radius(self.plan)
        draw_scope(axes, picture, self.sample, row, scale=self.scale, radius=radius)


def _write_rest(figure: Figure, spot: tuple[float, float], mark: RefusalMark | None) -> None:
    words = "dotted: not reached"
    if mark is not None:
        words += f"    ✕ {mark.text}"
    figure.text(*spot, words, color=REST, fontsize=12, ha="right", va="bottom")


def _add_axes(figure: Figure, left: float, bottom: float, wide: float, tall: float) -> Axes:
    """Add axes at a place given in inches."""
    width, height = figure.get_size_inches()
    return figure.add_axes((left / width, bottom / height, wide / width, tall / height))


def _draw_strip(axes: Axes, sample: MotionSample, scale: ClearanceScale, rows: list[int]) -> None:
    """Draw smallest clearance over insertion on a dark ground."""
    fill_clearance(axes, sample, scale=scale, ink="white")
    over, label = choose_abscissa(sample)
    axes.set_facecolor(NIGHT)
    for row in rows:
        axes.axvline(over[row], color=_FAINT, linewidth=0.9, linestyle=(0, (2, 3)))
    axes.tick_params(colors="#d5dee6", labelsize=12)
    for spine in axes.spines.values():
        spine.set_color("#3a4957")
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel(label, color="white", fontsize=13)
    axes.set_ylabel("smallest\nclearance [mm]", color="white", fontsize=13)
    axes.grid(axis="y", color="#22303d", linewidth=0.8)
    axes.set_axisbelow(True)
