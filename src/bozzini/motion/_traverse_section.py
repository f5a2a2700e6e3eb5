"""The longest segment that fits with its middle in a section of a duct, bounded from above.

A rigid link that comes from one end of a duct to the other has its middle in every section between
them at some time, and lies in the lumen then. So no link is longer than the longest segment with
its middle in one section.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._traverse_ceiling import Ceiling

__all__ = ["Segment", "bound_behind", "bound_through"]

SQUARES = 12
"""Squares of a section from its middle to the edge of the window, at first."""

WINDOWS = 5
"""How often the window is doubled until it holds the section."""

CELLS_MAX = 20_000
"""Branch and bound keeps this many cells open, and 100 per square, at most."""

GRAIN = 0.2
"""Smallest step along a ray, in distances between nodes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Segment:
    """What bounds a link at a section, or behind a point.

    Parameters
    ----------
    bound : float
        No link is longer [mm]; infinite where the section says nothing.
    valid_to : float
        The argument holds for links up to this length [mm]; longer ones would reach out of the
        duct's end there.
    ends : (2, dim) float
        A segment that comes near the bound, world frame [mm].
    """

    bound: float
    valid_to: float
    ends: NDArray[np.float64]


def bound_through(
    ceiling: Ceiling,
    line: NDArray[np.float64],
    index: int,
    *,
    radius: float,
    width: float,
    limit: float,
    tolerance: float,
) -> Segment:
    """Bound the links of a body `radius` that come through the section at a point of a line.

    Parameters
    ----------
    ceiling : Ceiling
    line : (n, 3) float
        From the duct's start to its end, local frame [mm].
    index : int
        Of the point of the line.
    radius : float
        Of the body [mm].
    width : float
        Room at the point [mm], to begin with.
    limit : float
        Longer segments are not looked for [mm].
    tolerance : float
        How far, as a factor, the bound may be above a segment that was found.
    """
    axes = _find_axes(line, index, width, planar=ceiling.planar)
    centre = line[index]
    nothing = Segment(
        bound=math.inf, valid_to=0.0, ends=ceiling.to_world(np.stack([centre, centre]))
    )
    section = _cover_section(ceiling, line, centre, axes, width)
    if section is None:
        return nothing
    squares, half = section
    corner = half if ceiling.planar else half * math.sqrt(2.0)
    gaps = [float(np.linalg.norm(squares - end, axis=1).min()) - corner for end in line[[0, -1]]]
    fits = ceiling.measure(squares) + corner >= radius
    valid_to = 2.0 * max(min(gaps), 0.0)
    if not fits.any():
        return Segment(bound=0.0, valid_to=valid_to, ends=nothing.ends)
    return _search(
        ceiling,
        np.ascontiguousarray(squares[fits]),
        half,
        axes,
        back=False,
        radius=radius,
        limit=limit,
        tolerance=tolerance,
        valid_to=valid_to,
    )


def bound_behind(
    ceiling: Ceiling,
    line: NDArray[np.float64],
    index: int,
    *,
    radius: float,
    width: float,
    limit: float,
    tolerance: float,
) -> Segment:
    """Bound the links whose head is at a point of a line, and whose tail is behind it.

    The parameters are those of `bound_through`.
    """
    axes = _find_axes(line, index, width, planar=ceiling.planar)
    return _search(
        ceiling,
        line[index : index + 1].copy(),
        0.0,
        axes,
        back=True,
        radius=radius,
        limit=limit,
        tolerance=tolerance,
        valid_to=float(np.linalg.norm(line[index] - line[0])),
    )


def _search(
    ceiling: Ceiling,
    starts: NDArray[np.float64],
    half: float,
    axes: NDArray[np.float64],
    *,
    back: bool,
    radius: float,
    limit: float,
    tolerance: float,
    valid_to: float,
) -> Segment:
    from ._traverse_kernels import CELL, find_longest

    bound, found = find_longest(
        ceiling.values,
        ceiling.step,
        ceiling.floor,
        starts,
        half,
        axes,
        ceiling.planar,
        back,
        radius,
        limit,
        GRAIN * float(ceiling.step.min()),
        1.0 + tolerance,
        np.empty((CELLS_MAX + 100 * len(starts), CELL)),
    )
    bound = math.inf if bound >= limit else float(bound)
    start, along = found[1:4], found[4:7] * found[0]
    ends = (start, start + along) if back else (start - 0.5 * along, start + 0.5 * along)
    return Segment(bound=bound, valid_to=valid_to, ends=ceiling.to_world(np.stack(ends)))


def _find_axes(
    line: NDArray[np.float64], index: int, width: float, *, planar: bool
) -> NDArray[Any]:
    """Return two axes of the section and its normal, as rows; see `find_longest` if planar."""
    gaps = np.linalg.norm(line - line[index], axis=1) <= max(0.5 * width, 1e-9)
    first, last = index, index
    while first > 0 and (gaps[first - 1] or first == index):
        first -= 1
    while last < len(line) - 1 and (gaps[last + 1] or last == index):
        last += 1
    normal = line[last] - line[first]
    normal = normal / np.linalg.norm(normal)
    if planar:
        return np.stack([np.array([-normal[1], normal[0], 0.0]), normal, normal])
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    one = np.cross(normal, helper)
    one = one / np.linalg.norm(one)
    return np.stack([one, np.cross(normal, one), normal])


def _cover_section(
    ceiling: Ceiling,
    line: NDArray[np.float64],
    centre: NDArray[np.float64],
    axes: NDArray[np.float64],
    width: float,
) -> tuple[NDArray[np.float64], float] | None:
    """Return squares (k, 3) that cover the section around `centre`, and half their side.

    None if they do not part the line's ends: the line crosses them an even number of times, or
    they do not end in the largest window.
    """
    from scipy import ndimage

    side = max(width, 2.0 * float(ceiling.step.max())) * 2.0 / SQUARES
    half = 0.5 * side
    reach = half if ceiling.planar else half * math.sqrt(2.0)
    count = SQUARES
    for _ in range(WINDOWS):
        ticks = np.arange(-count, count + 1)
        grid = np.stack(
            np.meshgrid(ticks, np.zeros(1) if ceiling.planar else ticks, indexing="ij"), axis=-1
        )
        places = centre + side * (grid[..., :1] * axes[0] + grid[..., 1:] * axes[1])
        room = ceiling.measure(places.reshape(-1, 3)).reshape(places.shape[:2])
        marks, _ = ndimage.label(room + reach >= 0.0, structure=np.ones((3, 3)))
        mark = marks[count, 0 if ceiling.planar else count]
        if mark == 0:
            return None
        inside = marks == mark
        rim = [inside[0], inside[-1]]
        if not ceiling.planar:
            rim += [inside[:, 0], inside[:, -1]]
        if not any(bool(part.any()) for part in rim):
            break
        count *= 2
    else:
        return None
    height = (line - centre) @ axes[2]
    crossed = np.flatnonzero((height[:-1] < 0.0) != (height[1:] < 0.0))
    share = height[crossed] / (height[crossed] - height[crossed + 1])
    spots = line[crossed] + share[:, None] * (line[crossed + 1] - line[crossed]) - centre
    cell = np.rint(spots @ axes[:2].T / side).astype(int) + count
    if ceiling.planar:
        cell[:, 1] = 0
    legal = np.all((cell >= 0) & (cell < inside.shape), axis=1)
    times = int(np.count_nonzero(inside[tuple(cell[legal].T)]))
    return (places[inside], half) if times % 2 == 1 else None
