"""A simple polygon: the planar duct, with exact signed distance."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import GeometryError
from ._analytic import ROUNDING, AnalyticDuct
from ._shape_checks import check_wall, freeze_places, set_fields

if TYPE_CHECKING:
    from ._clearance_kernels import PolygonData

__all__ = ["Polygon"]


@dataclass(frozen=True, eq=False)
class Polygon(AnalyticDuct):
    """The inside of a closed polygon that does not cross itself.

    Parameters
    ----------
    vertices : (n, 2) float
        In order, either way round [mm]; edge k joins vertices k and k + 1, the last one closes.
        The first vertex may be repeated at the end. Kept counter-clockwise.
    inflation : float
        The wall is moved outwards by this much [mm].
    wall : str
        What the wall is, in words.
    wall_error : float
        How far the true wall may be from the stated one [mm].

    Raises
    ------
    GeometryError
        If two edges cross or touch, or an edge has no length, with the numbers of the edges.
    InputError
        If there are fewer than 3 vertices, or one is not finite.

    Notes
    -----
    The signed distance is exact on both sides; with inflation it is exact outside and a lower
    bound of the depth inside.
    """

    vertices: NDArray[np.float64]
    inflation: float = field(default=0.0, kw_only=True)
    wall: str = field(default="polygon", kw_only=True)
    wall_error: float = field(default=0.0, kw_only=True)

    dim = 2

    def __post_init__(self) -> None:
        vertices = freeze_places("vertices", self.vertices, 2, least=3)
        if len(vertices) > 3 and np.array_equal(vertices[0], vertices[-1]):
            vertices = vertices[:-1]
        check_wall(self.inflation, self.wall_error)
        check_simple(vertices)
        if measure_area(vertices) < 0.0:
            vertices = vertices[::-1].copy()
            vertices.flags.writeable = False
        set_fields(self, vertices=vertices)

    @property
    def kind(self) -> str:
        """Exact; with inflation a lower bound of the room."""
        return "bound" if self.inflation > 0.0 else "exact"

    @property
    def exact_outside(self) -> bool:
        """Outside it is the distance, before inflation."""
        return True

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 2) corners of the box around the polygon [mm]."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        return np.stack([low - self.inflation, high + self.inflation])

    @property
    def area(self) -> float:
        """Area before inflation [mm^2]."""
        return measure_area(self.vertices)

    def pack(self) -> PolygonData:
        """Return the polygon for compiled kernels."""
        return self._data

    @cached_property
    def _data(self) -> PolygonData:
        from ._clearance_kernels import PolygonData

        start, stop = self.vertices, np.roll(self.vertices, -1, axis=0)
        square = np.sum((stop - start) ** 2, axis=1, keepdims=True)
        edges = np.concatenate([start, stop, 1.0 / square], axis=1)
        size = float(np.abs(self.vertices).max())
        return PolygonData(edges, float(self.inflation), ROUNDING * size)


def measure_area(vertices: NDArray[np.float64]) -> float:
    """Return the signed area of a closed polygon (n, 2), positive if counter-clockwise [mm^2]."""
    shifted = vertices - vertices[0]
    x, y = shifted[:, 0], shifted[:, 1]
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def check_simple(vertices: NDArray[np.float64]) -> None:
    """Raise `GeometryError` if edges of a closed polygon (n, 2) have no length, cross or touch."""
    start, stop = vertices, np.roll(vertices, -1, axis=0)
    along = stop - start
    count = len(vertices)
    flat = np.flatnonzero(np.all(along == 0.0, axis=1))
    if len(flat):
        k = int(flat[0])
        raise GeometryError(
            f"edge {k} of the polygon has no length: vertices {k} and {(k + 1) % count} are both "
            f"({start[k, 0]:g}, {start[k, 1]:g}) mm"
        )
    for i in range(count):
        after = (i + 1) % count
        back = _cross(along[i], along[after])
        if back == 0.0 and float(along[i] @ along[after]) < 0.0:
            raise GeometryError(f"edges {i} and {after} of the polygon fold back on each other")
        others = np.arange(i + 2, count if i > 0 else count - 1)
        if len(others) == 0:
            continue
        a, b, c, d = start[i], stop[i], start[others], stop[others]
        side_c, side_d = _cross(b - a, c - a), _cross(b - a, d - a)
        side_a, side_b = _cross(d - c, a - c), _cross(d - c, b - c)
        apart = (side_c * side_d > 0.0) | (side_a * side_b > 0.0)
        low, high = np.minimum(a, b), np.maximum(a, b)
        gap = np.any((np.minimum(c, d) > high) | (np.maximum(c, d) < low), axis=1)
        hits = others[~apart & ~gap]
        if len(hits):
            raise GeometryError(
                f"edges {i} and {int(hits[0])} of the polygon cross or touch: it must be simple"
            )


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
