"""Figures of a study: maps, parallel coordinates, fronts, indices, spreads, populations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..errors import InputError
from ..units import show_unit
from .style import AMBER, BLUE, COLORS, DASHES, GRID, make_panels, take_panel

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

T = TypeVar("T")

MOST_LINES = 400
MOST_POINTS = 2000
MOST_CELLS = 60
"""Values of a factor up to which each is a column of a map; of more, this many bins."""


def draw_map(rows: pandas.DataFrame, columns: Sequence[str]) -> Figure:
    """Draw a third column over two others; cells without a feasible row are grey.

    Parameters
    ----------
    rows : pandas.DataFrame
        With the column ``feasible``.
    columns : sequence of str
        Along x, along y, and what is shown: its mean over the feasible rows of a cell. With two,
        the share of the rows that are feasible.
    """
    columns = _take_columns(rows, columns, least=2, most=3)
    (x, x_edges), (y, y_edges) = (_bin(rows[name].to_numpy(), name) for name in columns[:2])
    feasible = rows["feasible"].to_numpy(dtype=bool)
    shape = (len(y_edges) - 1, len(x_edges) - 1)
    flat = y * shape[1] + x
    total = np.bincount(flat, minlength=shape[0] * shape[1]).reshape(shape)
    label = "share of rows that are feasible"
    chosen = np.ones(len(rows), dtype=bool)
    values = feasible.astype(np.float64)
    if len(columns) == 3:
        label, chosen = show_unit(columns[2]), feasible
        values = rows[columns[2]].to_numpy(dtype=float)
    count = np.bincount(flat[chosen], minlength=total.size).reshape(shape)
    summed = np.bincount(flat[chosen], values[chosen], minlength=total.size).reshape(shape)
    with np.errstate(invalid="ignore"):
        mean = np.where(count > 0, summed / count, np.nan)
    figure, axes = _start(columns[0], columns[1])
    axes.set_facecolor(GRID)
    drawn = axes.pcolormesh(x_edges, y_edges, np.ma.masked_invalid(mean), cmap="viridis")
    figure.colorbar(drawn, ax=axes, label=label)
    if np.any((count == 0) & (total > 0)):
        axes.set_title("grey: no feasible row", fontsize=9, loc="left")
    return figure


def draw_parallel(rows: pandas.DataFrame, columns: Sequence[str]) -> Figure:
    """Draw rows as lines over parallel axes, feasible ones in colour by the last column.

    At most 400 rows are drawn, evenly taken.
    """
    columns = _take_columns(rows, columns, least=2, most=20)
    step = max(1, len(rows) // MOST_LINES)
    shown = rows.iloc[::step]
    values = np.stack([_number(shown[name].to_numpy())[0] for name in columns], axis=1)
    with np.errstate(all="ignore"):
        low, high = _least(values), -_least(-values)
        shares = (values - low) / np.where(high > low, high - low, 1.0)
    figure, axes = _start("", "share of the range")
    from matplotlib import colormaps

    colors = colormaps["viridis"]
    for line, feasible in zip(shares, shown["feasible"], strict=True):
        lit = bool(feasible) and np.isfinite(line[-1])
        color = colors(line[-1]) if lit else GRID
        axes.plot(line, color=color, alpha=0.6, linewidth=0.8, zorder=2 if lit else 1)
    names = [
        f"{show_unit(name)}\n{a:.4g} to {b:.4g}"
        for name, a, b in zip(columns, low, high, strict=True)
    ]
    axes.set_xticks(range(len(columns)), names, fontsize=7)
    return figure


def draw_pareto(rows: pandas.DataFrame, columns: Sequence[str]) -> Figure:
    """Draw the feasible rows over two columns, and those that none betters in both.

    A name with ``-`` before it is better when larger.
    """
    signs = [-1.0 if name.startswith("-") else 1.0 for name in columns]
    plain = _take_columns(rows, [name.removeprefix("-") for name in columns], least=2, most=2)
    feasible = rows[rows["feasible"]]
    points = np.stack([feasible[name].to_numpy(dtype=float) for name in plain], axis=1)
    points = points[np.isfinite(points).all(axis=1)]
    front = points[find_front(points * signs)]
    front = front[np.argsort(front[:, 0])]
    figure, axes = _start(*plain)
    axes.plot(*points.T, ".", color=GRID, markersize=3, label="feasible")
    axes.plot(*front.T, "o-", color=BLUE, markersize=4, markeredgecolor=AMBER, label="front")
    axes.legend()
    return figure


def find_front(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the indices of points (n, 2) that no other is at most as large as in both."""
    order = np.lexsort((points[:, 1], points[:, 0]))
    second = points[order, 1]
    before = np.minimum.accumulate(np.concatenate([[np.inf], second[:-1]]))
    return np.asarray(order[second < before])


def draw_all(items: Mapping[str, T], draw: Callable[[str, T, Axes], Axes]) -> Figure:
    """Draw each of some named things in a panel of its own, at most nine."""
    shown = list(items.items())[:9]
    columns = min(len(shown), 3) or 1
    height = -(-len(shown) // columns) or 1
    figure, panels = make_panels(height, columns, size=(1.0 + 4.0 * columns, 0.4 + 3.4 * height))
    for axes, (name, item) in zip(panels, shown, strict=False):
        draw(name, item, axes)
    for axes in panels[len(shown) :]:
        axes.set_visible(False)
    return figure


def draw_indices(name: str, table: Mapping[str, object], ax: Axes | None = None) -> Axes:
    """Draw Sobol indices of an output as bars with their intervals; return the axes.

    Parameters
    ----------
    name : str
        The output.
    table : mapping
        Columns with a row for each factor: ``factor``, ``first``, ``first_low``, ``first_high``,
        and the same of ``total``.
    ax : Axes, optional
    """
    axes = take_panel(ax)
    factors = np.asarray(table["factor"])
    places = np.arange(len(factors))
    kinds = (
        ("first", BLUE, "alone (first order)"),
        ("total", AMBER, "with all it takes part in (total)"),
    )
    varies = False
    for k, (kind, color, label) in enumerate(kinds):
        values, low, high = (
            np.asarray(table[f"{kind}{end}"], dtype=np.float64) for end in ("", "_low", "_high")
        )
        varies = bool(np.isfinite(values).any())
        errors = np.nan_to_num(np.stack([values - low, high - values]))
        shown = np.nan_to_num(values)
        axes.barh(places + 0.4 * k - 0.2, shown, 0.38, xerr=errors, color=color, label=label)
    axes.set_yticks(places, [show_unit(str(factor)) for factor in factors])
    axes.invert_yaxis()
    title = show_unit(name) + ("" if varies else ": does not vary")
    axes.set(xlabel="share of the variance", title=title)
    axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.16))
    return axes


def draw_spread(name: str, values: NDArray[np.float64], ax: Axes | None = None) -> Axes:
    """Draw a histogram of an output with its mean and its middle 95 %; return the axes."""
    axes = take_panel(ax)
    if len(values):
        axes.hist(values, bins=min(60, max(10, len(values) // 50)), color=BLUE, alpha=0.8)
        axes.axvline(float(values.mean()), color=AMBER, label="mean")
        low, high = np.quantile(values, [0.025, 0.975])
        axes.axvspan(float(low), float(high), color=GRID, zorder=0, label="95 % of the rows")
        axes.legend(fontsize=7)
    axes.set(xlabel=show_unit(name), ylabel="rows")
    return axes


def draw_population(table: pandas.DataFrame, scopes: Sequence[str], ax: Axes | None = None) -> Axes:
    """Draw the share of patients that scopes fit, over the diameter, with the interval.

    Dashed is the share of which it is not proved that they do not fit.
    """
    axes = take_panel(ax)
    numbers = [name for name in scopes if table[name].dtype.kind in "if"]
    along = next((name for name in numbers if name.startswith("diameter")), next(iter(numbers), ""))
    others = [name for name in scopes if name != along]
    groups = table.groupby(others, sort=True) if others else [((), table)]
    for k, (key, group) in enumerate(groups):
        x = group[along].to_numpy(dtype=float) if along else np.zeros(len(group))
        words = [f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
                 for name, value in zip(others, key, strict=True)]  # fmt: skip
        color = COLORS[k % len(COLORS)]
        axes.plot(x, group["share"], "o-", color=color, label=", ".join(words) or "fits, proved")
        axes.fill_between(
            x, group["share_low"], group["share_high"], color=color, alpha=0.15, linewidth=0
        )
        axes.plot(x, 1.0 - group["share_not"], color=color, linestyle=DASHES[1], linewidth=1.0)
    axes.set(xlabel=show_unit(along), ylabel="share of patients that it fits", ylim=(-0.03, 1.03))
    axes.set_title("dashed: not proved that it does not fit", fontsize=9, loc="left")
    axes.legend(fontsize=7)
    return axes


def draw_tip_error(
    drawn: NDArray[np.float64],
    tip: NDArray[np.float64],
    *,
    covariance: NDArray[np.float64],
    level: float,
    names: Sequence[str] = ("x", "y"),
    ax: Axes | None = None,
) -> Axes:
    """Draw how far errors move a tip, in a plane, with their ellipse, and return the axes.

    Parameters
    ----------
    drawn : (n, 2) float
        Exact places [mm]; at most 2,000 are shown.
    tip : (2,) float
        Without errors [mm].
    covariance : (2, 2) float
        To first order [mm^2].
    level : float
        Share of the errors that the ellipse holds.
    names : (x, y)
        Of the axes.
    ax : Axes, optional
    """
    from scipy.stats import chi2

    axes = take_panel(ax)
    points = drawn[:MOST_POINTS].T
    axes.plot(*points, ".", color=BLUE, alpha=0.25, markersize=3, label="drawn errors")
    values, vectors = np.linalg.eigh(covariance)
    radii = np.sqrt(np.maximum(values, 0.0) * chi2.ppf(level, 2))
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    ring = (vectors * radii) @ np.stack([np.cos(angle), np.sin(angle)])
    label = f"{100.0 * level:g} % of these errors alone, first order"
    axes.plot(tip[0] + ring[0], tip[1] + ring[1], color=AMBER, label=label)
    axes.plot(*tip, "+", color=AMBER, markersize=10)
    axes.set(xlabel=f"{names[0]} [mm]", ylabel=f"{names[1]} [mm]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize=7)
    return axes


def _start(x: str, y: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel=show_unit(x), ylabel=show_unit(y))
    return figure, axes


def _take_columns(
    rows: pandas.DataFrame, columns: Sequence[str], *, least: int, most: int
) -> list[str]:
    if not least <= len(columns) <= most:
        many = f"{least}" if least == most else f"{least} to {most}"
        raise InputError(f"{len(columns)} columns are given: this figure takes {many}")
    for name in columns:
        if name not in rows:
            raise InputError(f"there is no column '{name}': choose from {', '.join(rows.columns)}")
    return list(columns)


def _number(values: NDArray[np.generic]) -> tuple[NDArray[np.float64], list[str]]:
    """Return numbers as they are, words by their place in the alphabet; and the words."""
    if values.dtype.kind in "biuf":
        return values.astype(np.float64), []
    words, places = np.unique(values.astype(str), return_inverse=True)
    return places.astype(np.float64), words.tolist()


def _least(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the least finite value of each column, 0 without any."""
    finite = np.where(np.isfinite(values), values, np.inf).min(axis=0)
    return np.where(np.isfinite(finite), finite, 0.0)


def _bin(values: NDArray[np.generic], name: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the cell of each value and the cells' edges."""
    numbers, _ = _number(values)
    if not np.isfinite(numbers).all():
        raise InputError(f"the column '{name}' has rows without a number: a map takes factors")
    levels = np.unique(numbers)
    if len(levels) > MOST_CELLS:
        edges = np.linspace(levels[0], levels[-1], MOST_CELLS + 1)
        return np.clip(np.searchsorted(edges, numbers, "right") - 1, 0, MOST_CELLS - 1), edges
    middle = 0.5 * (levels[1:] + levels[:-1])
    half = 0.5 if len(levels) == 1 else 0.5 * float(levels[1] - levels[0])
    last = half if len(levels) == 1 else 0.5 * float(levels[-1] - levels[-2])
    edges = np.concatenate([[levels[0] - half], middle, [levels[-1] + last]])
    return np.searchsorted(levels, numbers), edges
