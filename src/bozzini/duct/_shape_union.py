"""What unions of shapes of one kind share: their slices of the family's kernel."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._analytic import AnalyticDuct

if TYPE_CHECKING:
    from ._family_kernels import ShapesData

__all__ = ["ShapeUnion", "Slices"]


class Slices(NamedTuple):
    """Shapes for compiled kernels: kind, numbers of each, and bounding balls (k, 4) [mm]."""

    kind: int
    numbers: list[NDArray[np.float64]]
    balls: NDArray[np.float64]


class ShapeUnion(AnalyticDuct):
    """A union of shapes of one kind; a frozen dataclass with `inflation` and `wall_error`."""

    dim = 3

    @abstractmethod
    def _slice(self) -> Slices:
        """Return the shapes' numbers."""

    @property
    def kind(self) -> str:
        """The distance is a lower bound of the room."""
        return "bound"

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
