"""The style of figures: colours, panels, and one scale for clearance.

All of it can be read by colour-blind people. Figures are drawn with matplotlib's objects only (no
pyplot), so that no window, backend or global state is touched; `bozzini.plot.write_figure` writes
them.

On the scale of clearance red is through the wall, yellow is just clear, blue is well clear. The
break at zero is sharp on purpose, and every place that is through the wall is marked by shape as
well as by colour.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

INK = "#17212b"
NIGHT = "#0b1118"
GREEN = "#0f7b6c"
AMBER = "#b26a00"
RED = "#b3261e"
BLUE = "#1f5fa8"
GRID = "#e3e8ed"
LUMEN = "#d7e3ee"

COLORS = (BLUE, AMBER, GREEN, RED, "#6f4fa8", "#45b5d9", "#7a6a58", INK)
"""Colours of lines, in turn."""

Dash = tuple[int, tuple[float, ...]]

DASHES: tuple[Dash, ...] = ((0, ()), (0, (6, 2)), (0, (2, 1.5)), (0, (6, 2, 1.5, 2)), (0, (1, 1)))
"""Styles of lines, in turn."""

Look = dict[str, Any]
"""Keywords of a line for matplotlib."""

_NEGATIVE = ("#7a0a2e", "#f2453d")
_POSITIVE = ("#ffe066", "#8fd6a8", "#45b5d9", "#2f7fd0")
_LUMEN = ((0.0, NIGHT), (0.25, "#223140"), (0.6, "#5d7388"), (1.0, "#cfdae3"))


def _parse_color(text: str) -> tuple[float, float, float]:
    red, green, blue = (int(text[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue


def _blend(stops: tuple[str, ...], fractions: NDArray[np.float64]) -> NDArray[np.float64]:
    knots = np.linspace(0.0, 1.0, len(stops))
    table = np.array([_parse_color(stop) for stop in stops])
    return np.stack([np.interp(fractions, knots, table[:, k]) for k in range(3)], axis=-1)


def color_lumen(image: ArrayLike) -> NDArray[np.float64]:
    """Return RGB in 0..1 of shape ``(..., 3)`` for a lumen picture with values 0..1."""
    values = np.clip(np.asarray(image, dtype=np.float64), 0.0, 1.0)
    knots = np.array([knot for knot, _ in _LUMEN])
    table = np.array([_parse_color(color) for _, color in _LUMEN])
    return np.stack([np.interp(values, knots, table[:, k]) for k in range(3)], axis=-1)


@dataclass(frozen=True, kw_only=True)
class ClearanceScale:
    """Map clearance [mm] to colour, with its break at zero.

    Parameters
    ----------
    low : float
        Clearance drawn in the darkest red, below 0 [mm].
    high : float
        Clearance drawn in the deepest blue, above 0 [mm].
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        check_number("lower end of the clearance scale", -self.low, low=0.0, low_open=True)
        check_number("upper end of the clearance scale", self.high, low=0.0, low_open=True)

    def color(self, clearance: ArrayLike) -> NDArray[np.float64]:
        """Return RGB in 0..1 of shape ``(..., 3)`` for clearances [mm]."""
        values = np.asarray(clearance, dtype=np.float64)
        through = _blend(_NEGATIVE, np.clip(1.0 - values / self.low, 0.0, 1.0))
        clear = _blend(_POSITIVE, np.clip(values / self.high, 0.0, 1.0))
        return np.where((values < 0.0)[..., None], through, clear)

    def build_color_map(self, count: int = 512) -> tuple[Colormap, Normalize]:
        """Return the same scale as a matplotlib colour map and norm, for a colour bar."""
        from matplotlib.colors import ListedColormap, Normalize

        step = (self.high - self.low) / count
        middles = self.low + step * (np.arange(count) + 0.5)
        color_map = ListedColormap([tuple(row) for row in self.color(middles)], name="clearance")
        return color_map.with_extremes(bad="#eef1f4"), Normalize(self.low, self.high)


def choose_clearance_scale(clearance: ArrayLike) -> ClearanceScale:
    """Return a scale that suits the finite values of `clearance` [mm], whatever they are."""
    values = np.asarray(clearance, dtype=np.float64)
    values = values[np.isfinite(values)]
    low = float(values.min()) if values.size else 0.0
    high = float(np.percentile(values, 70.0)) if values.size else 0.0
    return ClearanceScale(
        low=float(min(-1.0, np.floor(2.0 * low) / 2.0)),
        high=float(np.clip(np.ceil(high), 2.0, 8.0)),
    )


def list_clearance_colors(scale: ClearanceScale, count: int = 120) -> list[str]:
    """Return `count` hexadecimal colours from the low to the high end of the scale."""
    step = (scale.high - scale.low) / count
    rows = np.rint(255 * scale.color(scale.low + step * (np.arange(count) + 0.5))).astype(int)
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in rows]


def style_axes(axes: Axes, *, grid: bool = True) -> Axes:
    """Give a panel the common spines and, unless not wanted, the grid; return it."""
    if grid:
        axes.grid(color=GRID, linewidth=0.8)
        axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def make_panels(
    rows: int = 1, columns: int = 1, *, size: tuple[float, float] | None = None, **grid: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure and its panels in the common style, row by row.

    Parameters
    ----------
    rows, columns : int
    size : (width, height), optional
        [in]; by default that of one panel, or of two side by side.
    **grid
        For `matplotlib.figure.Figure.subplots`, such as ``width_ratios``.
    """
    figure = make_figure(size or (5.8 if rows * columns == 1 else 9.6, 4.2))
    panels = list(figure.subplots(rows, columns, squeeze=False, **grid).flat)
    return figure, [style_axes(axes) for axes in panels]


def make_figure(size: tuple[float, float]) -> Figure:
    """Return an empty white figure, its size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=size, facecolor="white", layout="constrained")


def take_panel(ax: Axes | None) -> Axes:
    """Return the axes to draw into: those given, or the only panel of a new figure."""
    return make_panels()[1][0] if ax is None else ax


def fit_space(space: Axes3D, points: NDArray[np.float64], *, least: float, zoom: float) -> None:
    """Give a 3-D panel equal scales around points (n, 3), and sides of at least `least` mm."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * np.maximum(1.04 * (high - low), least)
    for k, name in enumerate("xyz"):
        getattr(space, f"set_{name}lim")(middle[k] - half[k], middle[k] + half[k])
        axis = getattr(space, f"{name}axis")
        axis.get_major_locator().set_params(nbins=2 + round(3.0 * half[k] / half.max()))
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
    space.set_box_aspect(2.0 * half, zoom=zoom)
    space.tick_params(labelsize=8.5)
    space.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")


def draw_marker(axes: Axes, place: ArrayLike, marker: str, *, size: float, **look: Any) -> None:
    """Draw markers at (x, y) that are not joined: rings, if no `face` is given."""
    x, y = np.asarray(place)
    axes.plot(
        x, y, marker=marker, markersize=size, linestyle="none",
        markerfacecolor=look.pop("face", "none"), markeredgecolor=look.pop("color"),
        markeredgewidth=look.pop("width"), **look,
    )  # fmt: skip
