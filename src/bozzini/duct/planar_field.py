"""A planar duct sampled on a grid: a sampled field of one layer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ._shape_checks import check_places
from .field import SampledField

if TYPE_CHECKING:
    from ._clearance_kernels import GridData
    from .compose import Eroded

__all__ = ["PlanarField"]


@dataclass(frozen=True, eq=False)
class PlanarField:
    """Signed distance in the plane, known at the nodes of a grid and interpolated between them.

    Parameters
    ----------
    layer : SampledField
        A field whose values are the same at both nodes across the plane; `to_field` makes one.
    """

    layer: SampledField

    def __post_init__(self) -> None:
        layer = self.layer
        if not isinstance(layer, SampledField):
            raise InputError(f"layer is a {type(layer).__name__}: it must be a SampledField")
        values = layer.values
        if values.shape[2] != 2 or not np.array_equal(values[..., 0], values[..., 1]):
            raise InputError(
                f"layer has values of shape {values.shape}: it must have two equal sheets, "
                "(nx, ny, 2)"
            )
        if np.abs(layer.rotation[2]).tolist() != [0.0, 0.0, 1.0]:
            raise InputError("layer is tilted: its third axis must be across the plane")

    @property
    def kind(self) -> str:
        """The answer is sampled: see `error`."""
        return "sampled"

    @property
    def error(self) -> float:
        """Largest error of the interpolant against the stated wall [mm]."""
        across = 0.5 * float(np.linalg.norm(self.layer.spacing[:2]))
        return across + self.layer.error - 0.5 * float(np.linalg.norm(self.layer.spacing))

    @property
    def wall(self) -> str:
        """What the wall is, in words."""
        return self.layer.wall

    @property
    def wall_error(self) -> float | None:
        """How far the true wall may be from the stated one [mm]; None where it is not known."""
        return self.layer.wall_error

    @property
    def inflation(self) -> float:
        """By how much the wall was moved outwards [mm]."""
        return self.layer.inflation

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 2) corners of the box around the grid [mm]."""
        return self.layer.bounds[:, :2]

    def to_grid(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn points (..., 2) into the field's own frame (..., 3)."""
        array = np.asarray(points, dtype=np.float64)
        flat = np.concatenate([array, np.zeros((*array.shape[:-1], 1))], axis=-1)
        return self.layer.to_grid(flat)

    def to_world(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn points (..., 3) of the field's own frame into points (..., 2)."""
        return self.layer.to_world(points)[..., :2]

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (...) interpolated signed distance at points (..., 2) [mm].

        Raises
        ------
        InputError
            If the points are not finite or not (..., 2).
        """
        return self.layer.signed_distance(_lift(points))

    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., 2) gradient of the interpolant."""
        return self.layer.gradient(_lift(points))[..., :2]

    def clearance_bound(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (...) rigorous lower bounds of the distance to the wall [mm]."""
        return self.layer.clearance_bound(_lift(points))

    def pack(self) -> GridData:
        """Return the field for compiled kernels."""
        return self.layer.pack()

    def inflate(self, distance: float) -> PlanarField:
        """Return the same duct with its wall moved outwards by `distance` mm more."""
        return replace(self, layer=self.layer.inflate(distance))

    def erode(self, clearance: float) -> Eroded:
        """Return the duct of all places with at least `clearance` mm to the wall."""
        from .compose import Eroded

        return Eroded(self, clearance)

    def sample(self, voxel: float) -> SampledField | PlanarField:
        """Sample the interpolant on another grid, with nodes `voxel` mm apart (`to_field`)."""
        from .compose import to_field

        return to_field(self, voxel)


def _lift(points: ArrayLike) -> NDArray[np.float64]:
    array = check_places("points", points, dim=2)
    return np.concatenate([array, np.zeros((*array.shape[:-1], 1))], axis=-1)
