"""Searches by branch and bound, and whether shapes are connected."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import GeometryError

# Whether shapes overlap and are connected, and how deep two overlap.
#
# Depth is found by branch and bound on a function with bounded slope.

CELLS_MAX = 400_000
"""The search ends when this many boxes are open."""


class Least(NamedTuple):
    """The least value found, where, and a bound below which there is none."""

    value: float
    place: NDArray[np.float64]
    bound: float


def find_least(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    *,
    tolerance: float,
    enough: float = -np.inf,
    slope: float = 1.0,
) -> Least:
    """Search a box for the least value of a function.

    Parameters
    ----------
    function : callable
        Takes points (n, dim), returns (n,) values that change by at most `slope` per mm.
    low, high : (dim,) float
        Corners of the box [mm].
    tolerance : float
        The search ends when the value is known this well.
    enough : float
        It ends also at a value this low, and when there can be none.
    slope : float
        Lipschitz constant.

    Raises
    ------
    GeometryError
        If the function is NaN somewhere.

    Notes
    -----
    Each box is halved along its longer sides; one whose value at the middle less `slope` times
    half its diagonal is above the best so far is dropped.
    """
    dim = len(low)
    centres = 0.5 * (low + high)[None]
    half = 0.5 * (high - low)
    values = function(centres)
    best = float(values[0])
    place = centres[0]
    while True:
        reach = slope * float(np.linalg.norm(half))
        bound = float(values.min()) - reach
        if np.isnan(bound):
            where = ", ".join(f"{x:.4g}" for x in centres[int(np.argmin(values))])
            raise GeometryError(f"the signed distance is nan at ({where}) mm: it must be finite")
        done = best <= enough or bound > enough > -np.inf or best - bound <= tolerance
        if done or len(centres) > CELLS_MAX or reach <= 1e-15 * (1.0 + abs(best)):
            return Least(best, place, min(bound, best))
        cut = half > 0.6 * half.max()
        steps = [np.array([-0.5, 0.5]) * half[a] if cut[a] else np.zeros(1) for a in range(dim)]
        shifts = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, dim)
        half = np.where(cut, 0.5 * half, half)
        centres = (centres[:, None] + shifts[None]).reshape(-1, dim)
        values = function(centres)
        index = int(np.argmin(values))
        if values[index] < best:
            best, place = float(values[index]), centres[index]
        keep = values - slope * float(np.linalg.norm(half)) <= best
        if not keep.any():
            keep[index] = True
        centres, values = centres[keep], values[keep]


def check_connected(
    name: str,
    gaps: NDArray[np.float64],
    meet: Callable[[int, int], bool],
    *,
    links: NDArray[np.bool_] | None = None,
    far: NDArray[np.bool_] | None = None,
) -> None:
    """Raise `GeometryError` if shapes are not connected; see `find_split`.

    Parameters
    ----------
    name : str
        What one of the shapes is called.
    """
    split = find_split(gaps, meet, links=links, far=far)
    if split is not None:
        raise GeometryError(describe_split(name, split))


def describe_split(name: str, split: tuple[int, int]) -> str:
    """Return the words for a union that is not connected."""
    a, b = split
    return f"the union is not connected: {name} {a} and {name} {b} come nearest, and do not overlap"


def find_split(
    gaps: NDArray[np.float64],
    meet: Callable[[int, int], bool],
    *,
    links: NDArray[np.bool_] | None = None,
    far: NDArray[np.bool_] | None = None,
) -> tuple[int, int] | None:
    """Return two shapes between which a union is not connected; None if it is.

    Parameters
    ----------
    gaps : (n, n) float
        How far apart two shapes are about [mm]: the nearest are tried first, and named.
    meet : callable
        Takes two indices, returns whether these shapes overlap. It is called only for shapes that
        are not connected already, neighbours in order first, until all do.
    links : (n, n) bool, optional
        Pairs that are known to overlap.
    far : (n, n) bool, optional
        Pairs that are known not to.

    Returns
    -------
    (int, int) or None
        The nearest two shapes of which one is connected with the first shape.
    """
    from scipy.sparse.csgraph import connected_components

    links = np.zeros(gaps.shape, dtype=bool) if links is None else links
    part = connected_components(links, directed=False)[1]
    if part.max() == 0:
        return None
    ask = part[:, None] != part
    if far is not None:
        ask &= ~far
    first, second = np.nonzero(np.triu(ask, 1))
    order = np.lexsort((gaps[first, second], second - first > 1))
    for a, b in zip(first[order].tolist(), second[order].tolist(), strict=True):
        if part[a] != part[b] and meet(a, b):
            part[part == part[b]] = part[a]
            if np.all(part == part[0]):
                return None
    inside, outside = np.flatnonzero(part == part[0]), np.flatnonzero(part != part[0])
    table = gaps[np.ix_(inside, outside)]
    i, j = np.unravel_index(int(np.argmin(table)), table.shape)
    a, b = sorted((int(inside[i]), int(outside[j])))
    return a, b


def link_gauges(
    centres: NDArray[np.float64], gauges: NDArray[np.float64], levels: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Return which convex shapes surely overlap, by what they hold of the lines between centres.

    Parameters
    ----------
    centres : (n, dim) float
        Of the shapes [mm].
    gauges : (n, n) float
        Gauge of shape k at the centre of shape i.
    levels : (n,) float
        A shape is where its gauge is at most this.

    Returns
    -------
    links : (n, n) bool
        Whether the line between two centres has a point in both, so that they overlap. They may
        without.
    gaps : (n, n) float
        How far apart they are along that line [mm]; negative where they overlap.
    """
    away = np.linalg.norm(centres[:, None] - centres, axis=-1)
    # From its centre shape i holds the line to centre k up to the share levels[i] / gauges[k, i].
    held = np.maximum(levels, 0.0) / np.where(gauges > 0.0, gauges, 1.0)
    share = np.where(gauges > 0.0, held, 1.0)
    total = share + share.T
    legal = (levels >= 0.0)[:, None] & (levels >= 0.0)
    return (total >= 1.0) & legal, away * (1.0 - total)


# The highest value of a 1-Lipschitz function over a region, by branch and bound.

CUBES_MAX = 1_000_000
"""The search ends when it would ask more cubes than this at once."""

PLACES_MAX = 5_000

Values = tuple[NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Highest:
    """What `find_highest` found.

    Attributes
    ----------
    value : float
        The highest value found; -inf if no point of the region was.
    place : (dim,) float
        Where.
    bound : float
        No point of the region has a value above this; at least `value`.
    places : (k, dim) float
        Points of the region with values above the ceiling, where there are any.
    """

    value: float
    place: NDArray[np.float64]
    bound: float
    places: NDArray[np.float64]


def find_highest(
    value: Callable[[NDArray[np.float64]], Values],
    region: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    bounds: NDArray[np.float64],
    *,
    ceiling: float,
    tolerance: float,
    slack: float = 0.0,
) -> Highest:
    """Return the highest value of a function over a region, with a bound that nothing exceeds.

    Parameters
    ----------
    value : callable
        Takes points (n, dim), returns estimates (n,) and upper bounds (n,) of a function that
        changes no faster than 1.
    region : callable
        Takes points (n, dim), returns a signed distance (n,) of the region, negative inside,
        that is never more than the true one.
    bounds : (2, dim) float
        Corners of a box that holds the region.
    ceiling : float
        Values below this need not be distinguished.
    tolerance : float
        How far the bound may be above the value, where that is above the ceiling. Farther, but
        a bound still, if there are more cubes than `CUBES_MAX` before: where the function is
        nearly highest over a wide surface.
    slack : float
        Error of `region`.
    """
    low, high = bounds
    dim = len(low)
    half = 0.5 * float((high - low).max()) / 16.0
    counts = np.maximum(np.ceil((high - low) / (2.0 * half)).astype(int), 1)
    axes = [low[k] + half * (2.0 * np.arange(counts[k]) + 1.0) for k in range(dim)]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dim)
    parts = np.stack(np.meshgrid(*[[-0.5, 0.5]] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    best, place, settled = -np.inf, cells[0], -np.inf
    places = [np.empty((0, dim))]
    while len(cells):
        reach = half * dim**0.5 * (1.0 + 1e-9)
        side = region(cells)
        near = side <= reach + slack
        cells, side = cells[near], side[near]
        if len(cells) == 0:
            break
        found, most = value(cells)
        inside = side <= 0.0
        if inside.any():
            index = int(np.argmax(np.where(inside, found, -np.inf)))
            if found[index] > best:
                best, place = float(found[index]), cells[index]
            places.append(cells[inside & (found > ceiling)])
        most = most + reach
        done = most <= (ceiling if best <= ceiling else best + tolerance)
        if done.any():
            settled = max(settled, float(most[done].max()))
        cells, most = cells[~done], most[~done]
        if len(cells) * len(parts) > CUBES_MAX:
            settled = max(settled, float(most.max()))
            break
        half *= 0.5
        cells = (cells[:, None] + 2.0 * half * parts).reshape(-1, dim)
    above = np.concatenate(places)[-PLACES_MAX:]
    return Highest(value=best, place=place, bound=max(best, settled), places=above)
