"""Searches by branch and bound, and whether shapes are connected."""

from __future__ import annotations

from collections.abc import Callable
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
        raise GeometryError(tell_split(name, split))


def tell_split(name: str, split: tuple[int, int]) -> str:
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
    """Return two shapes between which a union is not connected; None if it hangs together.

    Parameters
    ----------
    gaps : (n, n) float
        How far apart two shapes are about [mm]: the nearest are asked first, and named.
    meet : callable
        Takes two indices, returns whether these shapes overlap. It is only asked of shapes that
        are not connected already, neighbours in order first, until all do.
    links : (n, n) bool, optional
        Pairs that are known to overlap.
    far : (n, n) bool, optional
        Pairs that are known not to.

    Returns
    -------
    (int, int) or None
        The nearest two shapes of which one hangs together with the first shape.
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
    """Say which convex shapes surely overlap, by what they hold of the lines between centres.

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


CROWD = 1000
"""Fewer points than this are asked as they come."""


def order_points(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the order (n,) in which points (n, 3) lie near to each other: by cubes, in rows.

    Searches from one to the next then find what they need in the cache, or start near the goal.
    """
    if len(points) < CROWD:
        return np.arange(len(points))
    size = max(float(np.ptp(points, axis=0).max()), 1e-300)
    cubes = ((points - points.min(axis=0)) * (63.0 / size)).astype(np.int64)
    cubes[:, 1] = np.where(cubes[:, 0] % 2, 63 - cubes[:, 1], cubes[:, 1])
    row = (cubes[:, 0] << 6) | cubes[:, 1]
    last = np.where(row % 2, 63 - cubes[:, 2], cubes[:, 2])
    return np.argsort((row << 6) | last, kind="stable")
