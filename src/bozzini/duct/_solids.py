"""What the solid shapes share: their slices of the family's kernel, moving and sampling."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import GeometryError
from ._analytic import AnalyticDuct

if TYPE_CHECKING:
    from ._family_kernels import ShapesData

__all__ = ["Slices", "SolidShapes", "check_connected"]


class Slices(NamedTuple):
    """Shapes for compiled kernels: kind, numbers of each, and bounding balls (k, 4) [mm]."""

    kind: int
    numbers: list[NDArray[np.float64]]
    balls: NDArray[np.float64]


class SolidShapes(AnalyticDuct):
    """A union of solid shapes of one kind; a frozen dataclass with `inflation` and `wall_error`."""

    inflation: float
    wall: str
    wall_error: float

    dim = 3

    @abstractmethod
    def _slice(self) -> Slices:
        """Return the shapes' numbers."""

    @property
    def kind(self) -> str:
        """The distance is a lower bound of the room."""
        return "bound"

    def inflate(self, distance: float) -> Self:
        """Return the same duct with its wall moved outwards by `distance` mm more."""
        check_number("distance", distance, low=0.0, unit="mm")
        return replace(self, inflation=self.inflation + distance)  # type: ignore[type-var]

    def pack(self) -> ShapesData:
        """Return the duct for compiled kernels."""
        return self._data

    @cached_property
    def _data(self) -> ShapesData:
        from ._family import make_shapes

        slices = self._slice()
        return make_shapes(
            slices.kind, slices.numbers, slices.balls, inflation=float(self.inflation)
        )


def check_connected(name: str, links: NDArray[np.bool_], gaps: NDArray[np.float64]) -> None:
    """Raise `GeometryError` if shapes do not hang together.

    Parameters
    ----------
    name : str
        What one of the shapes is called.
    links : (n, n) bool
        Whether two shapes overlap.
    gaps : (n, n) float
        How far apart two shapes are about [mm], for the message.
    """
    count = len(links)
    part = np.zeros(count, dtype=bool)
    part[0] = True
    while True:
        grown = part | links[part].any(axis=0)
        if np.array_equal(grown, part):
            break
        part = grown
    if part.all():
        return
    inside, outside = np.flatnonzero(part), np.flatnonzero(~part)
    table = gaps[np.ix_(inside, outside)]
    i, j = np.unravel_index(int(np.argmin(table)), table.shape)
    a, b = sorted((int(inside[i]), int(outside[j])))
    raise GeometryError(
        f"the union falls apart: {name} {a} and {name} {b} come nearest, and do not overlap"
    )
