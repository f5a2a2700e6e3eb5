"""A duct around one other: its wall drawn in, or its frame changed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number
from ..errors import GeometryError, InputError
from ._analytic import ROUNDING
from ._family import collect_shapes, move_shapes, shift_shapes
from ._overlap import find_least
from ._sampling import to_field
from ._shape_checks import check_places, check_rotation
from .protocol import Duct, check_duct, count_dimensions

if TYPE_CHECKING:
    from ._family_kernels import ShapesData
    from .field import SampledField
    from .planar_field import PlanarField

__all__ = ["Eroded", "Moved", "inflate_duct"]

EMPTY = 1e-4
"""A place with more room than the clearance by this share of the duct's half width is found."""


class Wrapped(ABC):
    """A duct around one other, in the same kernels."""

    duct: Duct

    @property
    def kind(self) -> str:
        """The distance is a lower bound of the room, or sampled."""
        return "sampled" if self.duct.kind == "sampled" else "bound"

    @property
    def error(self) -> float:
        """By how much the distance may promise too much room [mm]."""
        return self.duct.error

    @property
    def wall(self) -> str:
        """What the wall is, in words."""
        return self.duct.wall

    @property
    def wall_error(self) -> float | None:
        """How far the true wall may be from the stated one [mm]; None where it is not known."""
        return self.duct.wall_error

    @property
    def inflation(self) -> float:
        """By how much the wall was moved outwards [mm]."""
        return self.duct.inflation

    @property
    @abstractmethod
    def bounds(self) -> NDArray[np.float64]:
        """(2, dim) corners of a box that holds the duct [mm]."""

    @abstractmethod
    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (...) signed distance at points (..., dim) [mm], negative inside."""

    @abstractmethod
    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., dim) gradient of the signed distance."""

    @abstractmethod
    def clearance_bound(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (...) rigorous lower bounds of the distance to the wall [mm]."""

    @abstractmethod
    def pack(self) -> Any:
        """Return the duct for compiled kernels."""

    def to_grid(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn world points (..., dim) into the kernels' frame (..., 3)."""
        return self.duct.to_grid(points)

    def to_world(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn points (..., 3) of the kernels' frame into world points (..., dim)."""
        return self.duct.to_world(points)

    def erode(self, clearance: float) -> Eroded:
        """Return the duct of all places with at least `clearance` mm to the wall."""
        return Eroded(self, clearance)

    def sample(self, voxel: float) -> SampledField | PlanarField:
        """Sample the signed distance on a grid with nodes `voxel` mm apart."""
        return to_field(self, voxel)


@dataclass(frozen=True, eq=False)
class Eroded(Wrapped):
    """All places of a duct with at least some distance to its wall.

    Parameters
    ----------
    duct : Duct
        What is drawn in.
    clearance : float
        By how much [mm].

    Raises
    ------
    InputError
        If the clearance is negative or more than half the duct's box.
    GeometryError
        If no place is left, with the most room found.

    Notes
    -----
    The value is that of the duct plus the clearance: where the duct's is a lower bound of the
    room, the places are some of those with the clearance, never others.
    """

    duct: Duct
    clearance: float

    def __post_init__(self) -> None:
        check_duct("duct", self.duct)
        check_number("clearance", self.clearance, low=0.0, unit="mm")
        size = float(np.ptp(self.duct.bounds, axis=0).min())
        if 2.0 * self.clearance >= size:
            raise InputError(
                f"clearance is {self.clearance:g} mm: nothing is left of a duct whose box is "
                f"{size:g} mm across, it must lie in [0, {0.5 * size:g}) mm"
            )
        if self.clearance > 0.0:
            self._check_left(0.5 * size)

    @property
    def wall(self) -> str:
        """What the wall is, in words."""
        return f"{self.duct.wall}, {self.clearance:g} mm inside"

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, dim) corners of a box that holds the duct [mm]."""
        return np.asarray(self.duct.bounds + np.array([[self.clearance], [-self.clearance]]))

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (...) signed distance at points (..., dim) [mm], negative inside."""
        return self.duct.signed_distance(points) + self.clearance

    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., dim) gradient of the signed distance."""
        return self.duct.gradient(points)

    def clearance_bound(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (...) rigorous lower bounds of the distance to the wall [mm]."""
        return self.duct.clearance_bound(points) - self.clearance

    def _check_left(self, half: float) -> None:
        """Raise `GeometryError` if no place has the clearance."""
        low, high = self.duct.bounds
        least = find_least(
            lambda points: self.duct.signed_distance(points) + self.clearance,
            low,
            high,
            tolerance=EMPTY * half,
            enough=0.0,
            slope=3.0**0.5 if self.duct.kind == "sampled" else 1.0,
        )
        if least.value > 0.0:
            most, place = self.clearance - least.value, ", ".join(f"{x:.4g}" for x in least.place)
            raise GeometryError(
                f"clearance is {self.clearance:g} mm: nothing is left, the most room found is "
                f"{most:.4g} mm, at ({place}) mm"
            )

    def pack(self) -> Any:
        """Return the duct for compiled kernels."""
        return self._data

    def inflate(self, distance: float) -> Eroded:
        """Return the same with the wall of the duct moved outwards by `distance` mm more."""
        return replace(self, duct=inflate_duct(self.duct, distance))

    @property
    def family_shapes(self) -> ShapesData | None:
        """Its shapes, if it is made of shapes."""
        shapes = collect_shapes(self.duct)
        return None if shapes is None else shift_shapes(shapes, -self.clearance)

    @cached_property
    def _data(self) -> Any:
        from ._family_kernels import ShapesData

        data: Any = self.duct.pack()
        if isinstance(data, ShapesData):
            return shift_shapes(data, -self.clearance)
        # All others answer their inflation less the distance.
        return data._replace(inflation=data.inflation - self.clearance)


@dataclass(frozen=True, eq=False)
class Moved(Wrapped):
    """A duct in another place: ``x -> rotation x + shift``.

    Parameters
    ----------
    duct : Duct
        What is moved.
    rotation : (dim, dim) float, optional
        Right-handed and orthonormal.
    shift : (dim,) float, optional
        After the rotation [mm].

    Raises
    ------
    InputError
        If the rotation is none, or a shape does not fit the duct's dimension.
    """

    duct: Duct
    rotation: NDArray[np.float64] | None = field(default=None, kw_only=True)
    shift: NDArray[np.float64] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        check_duct("duct", self.duct)
        dim = count_dimensions(self.duct)
        turn = self.rotation
        rotation = np.eye(dim) if turn is None else check_array("rotation", turn)
        if rotation.shape != (dim, dim):
            raise InputError(f"rotation has shape {rotation.shape}: it must be ({dim}, {dim})")
        check_rotation("rotation", rotation)
        left, _, right = np.linalg.svd(rotation)
        shift = np.zeros(dim) if self.shift is None else check_places("shift", self.shift, dim=dim)
        if shift.ndim != 1:
            raise InputError(f"shift has shape {shift.shape}: it must be ({dim},)")
        object.__setattr__(self, "rotation", left @ right)
        object.__setattr__(self, "shift", np.array(shift))

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, dim) corners of a box around the moved box of the duct [mm]."""
        sides = self.duct.bounds.T
        corners = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, len(sides))
        moved = corners @ self._turn.T + self._offset
        return np.stack([moved.min(axis=0), moved.max(axis=0)])

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (...) signed distance at points (..., dim) [mm], negative inside."""
        return self.duct.signed_distance(self._back(points))

    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., dim) gradient of the signed distance."""
        return np.asarray(self.duct.gradient(self._back(points)) @ self._turn.T)

    def clearance_bound(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (...) rigorous lower bounds of the distance to the wall [mm]."""
        return self.duct.clearance_bound(self._back(points)) - self._slack

    def pack(self) -> Any:
        """Return the duct for compiled kernels, in its own frame."""
        data: Any = self.duct.pack()
        return data._replace(slack=data.slack + self._slack)

    def to_grid(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn world points (..., dim) into the kernels' frame (..., 3)."""
        array = np.asarray(points, dtype=np.float64)
        return self.duct.to_grid((array - self._offset) @ self._turn)

    def to_world(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn points (..., 3) of the kernels' frame into world points (..., dim)."""
        return np.asarray(self.duct.to_world(points) @ self._turn.T + self._offset)

    def inflate(self, distance: float) -> Moved:
        """Return the same with the wall of the duct moved outwards by `distance` mm more."""
        return replace(self, duct=inflate_duct(self.duct, distance))

    @property
    def family_shapes(self) -> ShapesData | None:
        """Its shapes, if it is made of shapes that can be moved."""
        shapes = collect_shapes(self.duct)
        if shapes is None:
            return None
        dim = len(self._turn)
        rotation, shift = np.eye(3), np.zeros(3)
        rotation[:dim, :dim], shift[:dim] = self._turn, self._offset
        return move_shapes(shapes, rotation, shift)

    @property
    def _turn(self) -> NDArray[np.float64]:
        return np.asarray(self.rotation)

    @property
    def _offset(self) -> NDArray[np.float64]:
        return np.asarray(self.shift)

    @property
    def _slack(self) -> float:
        return ROUNDING * float(np.abs(self.bounds).max())

    def _back(self, points: ArrayLike) -> NDArray[np.float64]:
        array = check_places("points", points, dim=len(self._turn))
        return np.asarray((array - self._offset) @ self._turn)


def inflate_duct(duct: Duct, distance: float) -> Duct:
    """Return a duct with its wall moved outwards by `distance` mm more, if it can be."""
    inflate = getattr(duct, "inflate", None)
    if inflate is None:
        raise InputError(f"the wall of a {type(duct).__name__} cannot be moved outwards")
    moved: Duct = inflate(distance)
    return moved
