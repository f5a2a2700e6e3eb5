"""The sampled field: signed distance to a wall on a regular grid, in the scanner's world frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number
from ..errors import InputError
from .base import check_places, check_rotation, check_wall, set_fields

if TYPE_CHECKING:
    from .compose import Eroded
    from .kernels.clearance import GridData

SPACING_MAX = 1e6
"""Nodes are at most this far apart [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledField:
    """Signed distance to a wall, exact at the nodes of a grid and interpolated between them.

    Parameters
    ----------
    values : (nx, ny, nz) float32
        Signed distance at the nodes to the wall before inflation [mm], negative inside.
    spacing : (3,) float
        Distance between nodes along each grid axis [mm].
    origin : (3,) float
        World position of node (0, 0, 0) [mm].
    rotation : (3, 3) float
        Columns are the grid axes in the world frame: orthonormal, a reflection is allowed.
    inflation : float
        The wall is moved outwards by this much [mm]: the field answers ``values - inflation``.
        Moved outwards means that all points within `inflation` of the lumen become lumen, so the
        answer is a lower bound of the room inside the moved wall.
    wall : str
        What the wall is, in words.
    wall_error : float or None
        How far the true wall may be from the stated one [mm]: half a voxel's diagonal for labels;
        None where it is not known, as for a surface from a file.
    reach : float
        Distances outside the lumen are exact up to this value [mm]; farther out the field has this
        value or another lower bound of the distance, so `inflate` must stay below it.
    exact_outside : bool
        Whether the wall may be moved outwards: distances outside the lumen are as `reach` says, and
        no body stands in the lumen, which would not move with the wall. Otherwise `inflate` is
        refused: it would promise too much.

    frame : str, optional
        Where the world's axes point in the patient, such as "RAS"; None where it is not known.

    Notes
    -----
    ``error`` is how far the trilinear interpolant of a 1-Lipschitz function can be from it: half
    the diagonal of a cell (by Jensen's inequality), plus the rounding of float32.
    """

    values: NDArray[np.float32]
    spacing: NDArray[np.float64]
    origin: NDArray[np.float64]
    rotation: NDArray[np.float64]
    inflation: float = 0.0
    wall: str = "sampled wall"
    wall_error: float | None = None
    reach: float = math.inf
    exact_outside: bool = True
    frame: str | None = None
    _rounding: float = dataclass_field(init=False, repr=False, default=0.0)

    def __post_init__(self) -> None:
        values = self.values
        if not isinstance(values, np.ndarray) or values.dtype not in (np.float32, np.float64):
            kind = getattr(values, "dtype", type(values).__name__)
            raise InputError(f"field values are {kind}: they must be an array of float32")
        if self.values.ndim != 3 or min(self.values.shape) < 2:
            raise InputError(
                f"field values have shape {self.values.shape}: it must be (nx, ny, nz), each >= 2"
            )
        low, high = float(self.values.min()), float(self.values.max())
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError("field values are not all finite")
        object.__setattr__(self, "_rounding", max(-low, high) * 2.0**-23)
        check_wall(self.inflation, self.wall_error)
        spacing, rotation = (
            check_array(f"field {name}", values)
            for name, values in (("spacing", self.spacing), ("rotation", self.rotation))
        )
        if spacing.shape != (3,) or not (spacing.min() > 0.0 and spacing.max() <= SPACING_MAX):
            raise InputError(
                f"field spacing is {spacing} mm: three lengths in (0, {SPACING_MAX:g}] mm"
            )
        if rotation.shape != (3, 3):
            raise InputError(f"field rotation has shape {rotation.shape}: it must be (3, 3)")
        check_rotation("field rotation", rotation, reflection=True)
        origin = check_places("field origin", self.origin)
        if origin.shape != (3,):
            raise InputError(f"field origin has shape {origin.shape}: it must be one point, (3,)")
        check_number("reach", min(self.reach, np.finfo(float).max), low=0.0, unit="mm")
        set_fields(self, spacing=spacing, rotation=rotation, origin=origin)

    @property
    def kind(self) -> str:
        """The answer is sampled: see `error`."""
        return "sampled"

    @property
    def error(self) -> float:
        """Largest error of the interpolant against the stated wall [mm]."""
        return 0.5 * float(np.linalg.norm(self.spacing)) + self._rounding

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) corners of the box around the grid, world frame [mm]."""
        size = (np.array(self.values.shape) - 1) * self.spacing
        corners = np.array(np.meshgrid(*[(0.0, s) for s in size], indexing="ij")).reshape(3, -1).T
        world = self.to_world(corners)
        return np.stack([world.min(axis=0), world.max(axis=0)])

    @property
    def inflation_max(self) -> float:
        """How far the wall can be moved outwards, in all: two cells less than the reach [mm]."""
        return self.reach - 2.0 * float(self.spacing.max())

    def to_grid(self, points_world: ArrayLike) -> NDArray[np.float64]:
        """Turn world points (..., 3) into the field's own frame [mm from node 0]."""
        points = np.asarray(points_world, dtype=np.float64)
        return np.asarray((points - self.origin) @ self.rotation)

    def to_world(self, points_grid: ArrayLike) -> NDArray[np.float64]:
        """Turn points (..., 3) of the field's own frame [mm from node 0] into world points."""
        return np.asarray(np.asarray(points_grid, dtype=np.float64) @ self.rotation.T + self.origin)

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (...) trilinear signed distance at world points (..., 3) [mm].

        Raises
        ------
        InputError
            If the points are not finite or not (..., 3).
        """
        return self._evaluate(points, with_gradient=False)[0]

    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., 3) gradient of the interpolant in the world frame."""
        return self._evaluate(points, with_gradient=True)[1]

    def pack(self) -> GridData:
        """Return the field for compiled kernels."""
        from .kernels.clearance import GridData

        return GridData(self.values, self.spacing, float(self.inflation), self._rounding)

    def clearance_bound(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (...) rigorous lower bounds of the distance to the wall at points (..., 3) [mm].

        From the squared node distances inside the lumen, and from the slope bound of a distance
        elsewhere; 0 or negative where the point may lie outside. With inflation the bound is for
        the moved wall.
        """
        from .kernels.clearance import evaluate_bound

        array = check_places("points", points)
        flat = np.ascontiguousarray(self.to_grid(array).reshape(-1, 3))
        result = np.empty(len(flat))
        evaluate_bound(self.pack(), flat, result)
        return result.reshape(array.shape[:-1])

    def inflate(self, distance: float) -> SampledField:
        """Return the same lumen with its wall moved outwards by `distance` mm more.

        Raises
        ------
        InputError
            If that is beyond `inflation_max`, or distances outside the lumen are not exact: inflate
            the duct before it is sampled.
        """
        check_number("distance", distance, unit="mm")
        if not self.exact_outside and distance > 0.0:
            raise InputError(
                f"distance is {distance:g} mm: it must be 0 mm, because this field only has lower "
                "bounds of the distance outside, or bodies in its lumen; inflate the duct before "
                "it is sampled"
            )
        most = self.inflation_max - self.inflation
        if distance > 0.0 and distance > most * (1.0 + 1e-12):
            raise InputError(
                f"distance is {distance:g} mm: it must be at most {max(most, 0.0):g} mm, because "
                f"distances outside this field's lumen are known up to {self.reach:g} mm; build "
                "the field with a larger reach or inflation"
            )
        return replace(self, inflation=self.inflation + distance)

    def erode(self, clearance: float) -> Eroded:
        """Return the duct of all places with at least `clearance` mm to the wall."""
        from .compose import Eroded

        return Eroded(self, clearance)

    def sample(self, voxel: float) -> SampledField | PlanarField:
        """Sample the interpolant on another grid, with nodes `voxel` mm apart (`to_field`)."""
        from .compose import to_field

        return to_field(self, voxel)

    def _evaluate(
        self, points: ArrayLike, *, with_gradient: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        from .kernels.field import evaluate_field

        array = check_places("points", points)
        flat = np.ascontiguousarray(self.to_grid(array).reshape(-1, 3))
        distance = np.empty(len(flat))
        gradient = np.empty((len(flat) if with_gradient else 0, 3))
        hx, hy, hz = (float(h) for h in self.spacing)
        evaluate_field(self.values, hx, hy, hz, self.inflation, flat, distance, gradient)
        shape = array.shape[:-1]
        if with_gradient:
            gradient = (gradient @ self.rotation.T).reshape(*shape, 3)
        return distance.reshape(shape), gradient


# A planar duct sampled on a grid: a sampled field of one layer.


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
