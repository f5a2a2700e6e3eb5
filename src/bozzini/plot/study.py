"""Figures of a study's rows: a map of two factors, parallel coordinates, a Pareto front."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..errors import InputError
from .style import AMBER, BLUE, GRID

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

MOST_LINES = 400
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
        label, chosen, values = columns[2], feasible, rows[columns[2]].to_numpy(dtype=float)
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
    names = [f"{name}\n{a:.4g} to {b:.4g}" for name, a, b in zip(columns, low, high, strict=True)]
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


def _start(x: str, y: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel=x, ylabel=y)
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
