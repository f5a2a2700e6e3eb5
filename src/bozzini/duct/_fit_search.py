"""The highest value of a 1-Lipschitz function over a region, by branch and bound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Highest", "find_highest"]

CELLS_MAX = 1_000_000
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
        Values below this need not be told apart.
    tolerance : float
        How far the bound may be above the value, where that is above the ceiling. Farther, but
        a bound still, if there are more cubes than `CELLS_MAX` before: where the function is
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
        if len(cells) * len(parts) > CELLS_MAX:
            settled = max(settled, float(most.max()))
            break
        half *= 0.5
        cells = (cells[:, None] + 2.0 * half * parts).reshape(-1, dim)
    above = np.concatenate(places)[-PLACES_MAX:]
    return Highest(value=best, place=place, bound=max(best, settled), places=above)
