"""What ducts of several parts share: the family's kernels if they can be had, else the parts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._analytic import AnalyticDuct
from ._sampling import to_field
from ._shape_checks import check_places
from ._wrapped import Eroded
from .protocol import Duct

if TYPE_CHECKING:
    from ._family_kernels import ShapesData
    from .field import SampledField
    from .planar_field import PlanarField

__all__ = ["Compound"]


class Compound(ABC):
    """A duct of several: through the family's kernels if it can be, else through its parts."""

    @property
    @abstractmethod
    def family_shapes(self) -> ShapesData | None:
        """Its shapes, if it is made of shapes."""

    @property
    @abstractmethod
    def wall(self) -> str:
        """What the wall is, in words."""

    @property
    @abstractmethod
    def _voxel(self) -> float:
        """Spacing of the nodes where it is sampled [mm]."""

    @property
    @abstractmethod
    def bounds(self) -> NDArray[np.float64]:
        """(2, dim) corners of a box that holds the duct [mm]."""

    @property
    @abstractmethod
    def _all(self) -> tuple[Duct, ...]:
        """All parts."""

    @abstractmethod
    def _decide(self, points: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the part that decides and the signed distance at points (n, dim)."""

    @abstractmethod
    def _bound(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the bound of the clearance at points (n, dim)."""

    @property
    def kind(self) -> str:
        """The distance is a lower bound of the room, or sampled."""
        return "sampled" if self.error > 0.0 else "bound"

    @property
    def error(self) -> float:
        """By how much the distance may promise too much room [mm]."""
        return 0.0 if self.family_shapes is not None else max(p.error for p in self._all)

    @property
    def wall_error(self) -> float | None:
        """How far the true wall may be from the stated one [mm]; None where it is not known."""
        errors = [part.wall_error for part in self._all]
        known = [error for error in errors if error is not None]
        return max(known) if len(known) == len(errors) else None

    @property
    def inflation(self) -> float:
        """By how much the wall was moved outwards, at most [mm]."""
        return max(part.inflation for part in self._all)

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (...) signed distance at points (..., dim) [mm], negative inside.

        Raises
        ------
        InputError
            If the points are not finite or not (..., dim).
        """
        if self.family_shapes is not None:
            return self._core.signed_distance(points)
        array, flat = self._flatten(points)
        return self._decide(flat)[1].reshape(array.shape[:-1])

    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., dim) gradient of the signed distance."""
        if self.family_shapes is not None:
            return self._core.gradient(points)
        array, flat = self._flatten(points)
        index, _ = self._decide(flat)
        result = np.empty_like(flat)
        for k, part in enumerate(self._all):
            mine = index == k
            if mine.any():
                result[mine] = self._sign(k) * part.gradient(flat[mine])
        return result.reshape(array.shape)

    def clearance_bound(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (...) rigorous lower bounds of the distance to the wall [mm]."""
        if self.family_shapes is not None:
            return self._core.clearance_bound(points)
        array, flat = self._flatten(points)
        return self._bound(flat).reshape(array.shape[:-1])

    def pack(self) -> Any:
        """Return the duct for compiled kernels: shapes, or else a sampled field."""
        return self._core.pack()

    def to_grid(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn world points (..., dim) into the kernels' frame (..., 3)."""
        return self._core.to_grid(points)

    def to_world(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn points (..., 3) of the kernels' frame into world points (..., dim)."""
        return self._core.to_world(points)

    def erode(self, clearance: float) -> Eroded:
        """Return the duct of all places with at least `clearance` mm to the wall."""
        return Eroded(self, clearance)

    def sample(self, voxel: float) -> SampledField | PlanarField:
        """Sample the signed distance on a grid with nodes `voxel` mm apart."""
        return to_field(self, voxel)

    def _sign(self, _part: int) -> float:
        return 1.0

    def _flatten(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        dim = self.bounds.shape[1]
        array = check_places("points", points, dim=dim)
        return array, array.reshape(-1, dim)

    @cached_property
    def _core(self) -> Duct:
        """What kernels see."""
        shapes = self.family_shapes
        if shapes is not None:
            return _Family(shapes, self.bounds)
        return to_field(self, self._voxel)


class _Family(AnalyticDuct):
    """Shapes of the family as they are."""

    kind = "bound"
    inflation = 0.0
    wall = "shapes"
    wall_error = 0.0

    def __init__(self, shapes: ShapesData, bounds: NDArray[np.float64]) -> None:
        self._shapes = shapes
        self._bounds = bounds
        self.dim = bounds.shape[1]  # type: ignore[misc]

    @property
    def bounds(self) -> NDArray[np.float64]:
        return self._bounds

    def pack(self) -> ShapesData:
        return self._shapes
