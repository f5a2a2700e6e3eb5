"""What ducts share whose walls are measured: kernels get them as a sampled field."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number
from ._analytic import ROUNDING
from ._shape_checks import check_places

if TYPE_CHECKING:
    from ._clearance_kernels import GridData
    from .compose import Eroded
    from .field import SampledField

__all__ = ["MeasuredDuct", "Nearest", "order_points"]

CROWD = 1000
"""Fewer points than this are asked as they come."""


class Nearest(NamedTuple):
    """The signed distance before inflation (n,) [mm], and its gradient (n, 3) if asked for."""

    distance: NDArray[np.float64]
    gradient: NDArray[np.float64]


class MeasuredDuct(ABC):
    """A 3-D duct that answers points itself, and kernels through a sampled field.

    A frozen dataclass with `inflation`, `wall` and `wall_error`. The field is sampled when first
    asked for.
    """

    inflation: float
    wall: str
    wall_error: float | None

    @property
    def kind(self) -> str:
        """What the distance is."""
        return "bound"

    @property
    def error(self) -> float:
        """The distance never promises too much room."""
        return 0.0

    @property
    @abstractmethod
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) corners of the box around the duct [mm]."""

    @abstractmethod
    def _measure(self, points: NDArray[np.float64], *, with_gradient: bool) -> Nearest:
        """Return the signed distance before inflation at points (n, 3), and its gradient."""

    @abstractmethod
    def _sample(self, voxel: float | None) -> SampledField:
        """Sample the signed distance, with inflation; by default with a spacing that suits."""

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (...) signed distance at points (..., 3) [mm], negative inside.

        Raises
        ------
        InputError
            If the points are not finite or not (..., 3).
        """
        array = check_places("points", points)
        flat = np.array(array.reshape(-1, 3), order="C")
        return (
            self._measure(flat, with_gradient=False).distance.reshape(array.shape[:-1])
            - self.inflation
        )

    def clearance_bound(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (...) rigorous lower bounds of the distance to the wall [mm]."""
        return -self.signed_distance(points) - ROUNDING * float(np.abs(self.bounds).max())

    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., 3) gradient of the signed distance; where there are several, one."""
        array = check_places("points", points)
        flat = np.array(array.reshape(-1, 3), order="C")
        return self._measure(flat, with_gradient=True).gradient.reshape(array.shape)

    def inflate(self, distance: float) -> Self:
        """Return the same duct with its wall moved outwards by `distance` mm more."""
        check_number("distance", distance, low=0.0, unit="mm")
        return replace(self, inflation=self.inflation + distance)  # type: ignore[type-var]

    def erode(self, clearance: float) -> Eroded:
        """Return the duct of all places with at least `clearance` mm to the wall."""
        from .compose import Eroded

        return Eroded(self, clearance)

    def sample(self, voxel: float | None = None) -> SampledField:
        """Sample the signed distance on a grid with nodes `voxel` mm apart.

        The field's `clearance_bound` is rigorous for the same wall.
        """
        if voxel is not None:
            check_number("voxel", voxel, low=0.0, low_open=True, unit="mm")
        return self._sample(voxel)

    def pack(self) -> GridData:
        """Return the duct for compiled kernels: sampled, with a rigorous bound."""
        return self._field.pack()

    def to_grid(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn world points (..., 3) into the sampled field's frame [mm]."""
        return self._field.to_grid(points)

    def to_world(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn points (..., 3) of the sampled field's frame into world points [mm]."""
        return self._field.to_world(points)

    @cached_property
    def _field(self) -> SampledField:
        return self._sample(None)


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
