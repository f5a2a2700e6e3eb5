"""What the analytic ducts share: they answer through the same kernels that planners use."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number
from ._shape_checks import check_places

if TYPE_CHECKING:
    from .field import SampledField
    from .planar_field import PlanarField

__all__ = ["ROUNDING", "AnalyticDuct"]

ROUNDING = 64.0 * 2.0**-52
"""Rounding error of a distance, as a fraction of the largest coordinate."""


class AnalyticDuct(ABC):
    """A duct given by formulas, without a sampling error; public kinds are frozen dataclasses."""

    dim: ClassVar[int]
    inflation: float
    wall: str
    wall_error: float

    @property
    @abstractmethod
    def kind(self) -> str:
        """``"exact"`` or ``"bound"`` (never more room than there is)."""

    @property
    def error(self) -> float:
        """The distance never promises too much room."""
        return 0.0

    @property
    @abstractmethod
    def bounds(self) -> NDArray[np.float64]:
        """(2, dim) corners of the box around the duct [mm]."""

    @abstractmethod
    def pack(self) -> Any:
        """Return the duct for compiled kernels."""

    def to_grid(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn points (..., dim) into the kernels' frame (..., 3): planar ones get z = 0."""
        array = np.asarray(points, dtype=np.float64)
        if self.dim == 3:
            return array
        return np.concatenate([array, np.zeros((*array.shape[:-1], 1))], axis=-1)

    def to_world(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn points (..., 3) of the kernels' frame into points (..., dim)."""
        return np.asarray(points, dtype=np.float64)[..., : self.dim]

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (...) signed distance at points (..., dim) [mm], negative inside.

        Raises
        ------
        InputError
            If the points are not finite or not (..., dim).
        """
        from ._clearance_kernels import evaluate_estimate

        return -self._evaluate(evaluate_estimate, points)

    def clearance_bound(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (...) rigorous lower bounds of the distance to the wall [mm].

        The negative signed distance, less the rounding error.
        """
        from ._clearance_kernels import evaluate_bound

        return self._evaluate(evaluate_bound, points)

    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., dim) gradient of the signed distance.

        Where it has several (the middle of a ball, equally near walls) one of them, or their mean.
        """
        from ._clearance_kernels import evaluate_slope

        array, flat = self._flatten(points)
        slope = np.empty((len(flat), 3))
        evaluate_slope(self.pack(), flat, slope)
        return self.to_world(-slope).reshape(array.shape)

    def inflate(self, distance: float) -> Self:
        """Return the same duct with its wall moved outwards by `distance` mm more."""
        check_number("distance", distance, low=0.0, unit="mm")
        return replace(self, inflation=self.inflation + distance)  # type: ignore[type-var]

    def erode(self, clearance: float) -> Any:
        """Return the duct of all places with at least `clearance` mm to the wall."""
        from .compose import Eroded

        return Eroded(self, clearance)

    def sample(self, voxel: float) -> SampledField | PlanarField:
        """Sample the signed distance on a grid with nodes `voxel` mm apart (`compose.to_field`)."""
        from .compose import to_field

        return to_field(self, voxel)

    def _flatten(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        array = check_places("points", points, dim=self.dim)
        return array, np.array(self.to_grid(array).reshape(-1, 3), order="C")

    def _evaluate(self, kernel: Any, points: ArrayLike) -> NDArray[np.float64]:
        array, flat = self._flatten(points)
        result = np.empty(len(flat))
        kernel(self.pack(), flat, result)
        return result.reshape(array.shape[:-1])
