"""Ducts made of ducts: unions, obstacles taken away, frames changed.

Each is a duct again. If all its parts are shapes of this package's kernels, so is it; if not, it
answers points through its parts and kernels through a sampled field.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number
from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.vectors import nearest_rotation
from .base import Duct, Kind, PackedDuct, SampledField, Wrapped, check_duct
from .checks import check_places, check_rotation
from .packed import ROUNDING, Packed, ShapesData, join_shapes
from .search import check_connected, find_least
from .shapes.base import move_shapes


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
        dim = self.duct.dim
        turn = self.rotation
        rotation = np.eye(dim) if turn is None else check_array("rotation", turn)
        if rotation.shape != (dim, dim):
            raise InputError(f"rotation has shape {rotation.shape}: it must be ({dim}, {dim})")
        check_rotation("rotation", rotation)
        shift = np.zeros(dim) if self.shift is None else check_places("shift", self.shift, dim=dim)
        if shift.ndim != 1:
            raise InputError(f"shift has shape {shift.shape}: it must be ({dim},)")
        object.__setattr__(self, "rotation", nearest_rotation(rotation))
        object.__setattr__(self, "shift", np.array(shift))

    @property
    def _inner(self) -> Duct:
        return self.duct

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

    def pack(self) -> Packed:
        """Return the duct for compiled kernels, in its own frame."""
        data = self.duct.pack()
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
        return replace(self, duct=self.duct.inflate(distance))

    @property
    def family_shapes(self) -> ShapesData | None:
        """The shapes of this package's kernels that it is made of; None if they cannot be moved."""
        shapes = self.duct.family_shapes
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


class Compound(Duct):
    """A duct of several: through one set of shapes if it can be, else through its parts."""

    voxel: float | None

    @property
    @abstractmethod
    def _all(self) -> tuple[Duct, ...]:
        """All parts."""

    @abstractmethod
    def _join(self, shapes: list[ShapesData]) -> ShapesData | None:
        """Return the shapes of all parts as one set, if they can be."""

    @abstractmethod
    def _decide(self, points: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Return the part that decides and the signed distance at points (n, dim)."""

    @abstractmethod
    def _bound(self, points: Floats) -> Floats:
        """Return the bound of the clearance at points (n, dim)."""

    @property
    def kind(self) -> Kind:
        """The distance is a lower bound of the clearance, or sampled."""
        return "sampled" if self.error > 0.0 else "bound"

    @property
    def error(self) -> float:
        """By how much the distance may promise too much clearance [mm]."""
        return 0.0 if self.family_shapes is not None else max(p.error for p in self._all)

    @property
    def wall_error(self) -> float | None:
        """How far the true wall may be from the stated one [mm]; None where it is not known."""
        known = [part.wall_error for part in self._all if part.wall_error is not None]
        return max(known) if len(known) == len(self._all) else None

    @property
    def inflation(self) -> float:
        """By how much the wall was moved outwards, at most [mm]."""
        return max(part.inflation for part in self._all)

    @property
    def inflation_max(self) -> float:
        """How far the wall can be moved outwards, in all [mm]."""
        return min(part.inflation_max for part in self._all)

    @property
    def family_shapes(self) -> ShapesData | None:
        """The shapes of this package's kernels that it is made of; None if it is not."""
        return self._shapes

    @cached_property
    def _shapes(self) -> ShapesData | None:
        known = [data for data in (part.family_shapes for part in self._all) if data is not None]
        return self._join(known) if len(known) == len(self._all) else None

    @cached_property
    def _core(self) -> Duct:
        if self._shapes is not None:
            return _Family(self._shapes, self.bounds)
        return self.sample()

    def signed_distance(self, points: ArrayLike, /) -> Floats:
        """Return the (...) signed distance at points (..., dim) [mm], negative inside."""
        if self._shapes is not None:
            return self._core.signed_distance(points)
        array = check_places("points", points, dim=self.dim)
        return self._decide(array.reshape(-1, self.dim))[1].reshape(array.shape[:-1])

    def gradient(self, points: ArrayLike, /) -> Floats:
        """Return the (..., dim) gradient of the signed distance."""
        if self._shapes is not None:
            return self._core.gradient(points)
        array = check_places("points", points, dim=self.dim)
        flat = array.reshape(-1, self.dim)
        index, _ = self._decide(flat)
        result = np.empty_like(flat)
        for k, part in enumerate(self._all):
            mine = index == k
            if mine.any():
                result[mine] = self._sign(k) * part.gradient(flat[mine])
        return result.reshape(array.shape)

    def clearance_bound(self, points: ArrayLike, /) -> Floats:
        """Return (...) rigorous lower bounds of the distance to the wall [mm]."""
        if self._shapes is not None:
            return self._core.clearance_bound(points)
        array = check_places("points", points, dim=self.dim)
        return self._bound(array.reshape(-1, self.dim)).reshape(array.shape[:-1])

    def _sign(self, part: int) -> float:
        return 1.0

    def _check_voxel(self) -> None:
        if self.voxel is not None:
            check_number("voxel", self.voxel, low=0.0, low_open=True, unit="mm")

    @property
    def _default_voxel(self) -> float:
        """Spacing of the finest sampled part, if 16 times the usual nodes allow it [mm]."""
        usual = super()._default_voxel
        own = [float(p.spacing.min()) for p in self._all if isinstance(p, SampledField)]
        if self.voxel is not None:
            return self.voxel
        return max(min(own), usual / 16.0 ** (1.0 / self.dim)) if own else usual


class _Family(PackedDuct):
    """Shapes of the family as they are."""

    def __init__(self, shapes: ShapesData, bounds: Floats) -> None:
        self._shapes = shapes
        self._bounds = bounds

    @property
    def bounds(self) -> Floats:
        return self._bounds

    def pack(self) -> ShapesData:
        return self._shapes


OVERLAP_MM = 1e-3
"""Parts of a union must overlap where the search can see it: about this deep."""


@dataclass(frozen=True, eq=False)
class Union(Compound):
    """All places that are in one of several ducts.

    Parameters
    ----------
    parts : tuple of Duct
        All planar or all 3-D.
    connected : bool
        Whether parts that are not all connected are refused.
    voxel : float, optional
        Spacing of the nodes where kernels need a sampled field [mm]. By default that of the
        finest sampled part, or about 4 million nodes.

    Raises
    ------
    InputError
        If there is no part, or planar and 3-D parts are mixed.
    GeometryError
        If the union is not connected, with the parts between which it is interrupted.

    Notes
    -----
    The value is the smallest of the parts': exact outside where theirs are, and inside a lower
    bound of the clearance.
    """

    parts: tuple[Duct, ...]
    connected: bool = field(default=True, kw_only=True)
    voxel: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts:
            raise InputError("a union has 0 parts: it must have at least 1")
        _check_dimensions("part", self.parts)
        self._check_voxel()
        if self.connected and len(self.parts) > 1:
            _check_union(self.parts)

    @property
    def wall(self) -> str:
        """What the wall is, in words."""
        return "union of " + " and ".join(dict.fromkeys(f"({part.wall})" for part in self.parts))

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, dim) corners of a box that holds the duct [mm]."""
        boxes = np.stack([part.bounds for part in self.parts])
        return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])

    def inflate(self, distance: float) -> Union:
        """Return the same with the walls of all parts moved outwards by `distance` mm more."""
        return replace(self, parts=tuple(part.inflate(distance) for part in self.parts))

    @property
    def _all(self) -> tuple[Duct, ...]:
        return self.parts

    def _join(self, shapes: list[ShapesData]) -> ShapesData | None:
        return join_shapes(shapes, [])

    def _decide(self, points: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        values = np.stack([part.signed_distance(points) for part in self.parts])
        return values.argmin(axis=0), values.min(axis=0)

    def _bound(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        bounds = [part.clearance_bound(points) for part in self.parts]
        return np.asarray(np.max(bounds, axis=0))


@dataclass(frozen=True, eq=False)
class Without(Compound):
    """A duct without the places that are in obstacles.

    Parameters
    ----------
    duct : Duct
        The lumen.
    obstacles : tuple of Duct
        What stands in it, of the same dimension. The inside of each is taken away.
    voxel : float, optional
        Spacing of the nodes where kernels need a sampled field [mm]. By default that of the
        duct if it is sampled, or about 4 million nodes.

    Raises
    ------
    InputError
        If there is no obstacle, planar and 3-D are mixed, or an obstacle is sampled or inflated:
        its value outside would not be at most its distance.

    Notes
    -----
    The value is the larger of the duct's and minus the obstacles'. `inflate` moves the wall of
    the duct, not the obstacles. Whether they cut the duct in two is not looked at.
    """

    duct: Duct
    obstacles: tuple[Duct, ...]
    voxel: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "obstacles", tuple(self.obstacles))
        if not self.obstacles:
            raise InputError("a duct has 0 obstacles: it must have at least 1")
        _check_dimensions("duct and obstacle", (self.duct, *self.obstacles))
        self._check_voxel()
        for k, obstacle in enumerate(self.obstacles):
            if obstacle.kind == "sampled":
                raise InputError(
                    f"obstacle {k} is sampled: it must have an exact distance or a lower bound of "
                    "it; sample the duct after the obstacle is taken away"
                )
            if obstacle.inflation > 0.0:
                raise InputError(
                    f"obstacle {k} has its wall moved outwards by {obstacle.inflation:g} mm: it "
                    "must be 0 mm; make the obstacle larger instead"
                )

    @property
    def wall(self) -> str:
        """What the wall is, in words."""
        return f"{self.duct.wall}, with {len(self.obstacles)} obstacle(s)"

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, dim) corners of a box that holds the duct [mm]."""
        return self.duct.bounds

    @property
    def inflation_max(self) -> float:
        """How far the wall of the duct can be moved outwards, in all [mm]."""
        return self.duct.inflation_max

    def inflate(self, distance: float) -> Without:
        """Return the same with the wall of the duct moved outwards by `distance` mm more."""
        return replace(self, duct=self.duct.inflate(distance))

    @property
    def _all(self) -> tuple[Duct, ...]:
        return (self.duct, *self.obstacles)

    def _join(self, shapes: list[ShapesData]) -> ShapesData | None:
        return join_shapes(shapes[:1], shapes[1:])

    def _sign(self, part: int) -> float:
        return 1.0 if part == 0 else -1.0

    def _decide(self, points: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        values = np.stack(
            [self._sign(k) * part.signed_distance(points) for k, part in enumerate(self._all)]
        )
        return values.argmax(axis=0), values.max(axis=0)

    def _bound(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        slack = ROUNDING * float(np.abs(self.bounds).max())
        bounds = [obstacle.signed_distance(points) - slack for obstacle in self.obstacles]
        return np.asarray(np.min([self.duct.clearance_bound(points), *bounds], axis=0))


def union(*ducts: Duct, connected: bool = True, voxel: float | None = None) -> Union:
    """Return the duct of all places that are in one of `ducts`; see `Union`."""
    return Union(ducts, connected=connected, voxel=voxel)


def without(duct: Duct, *obstacles: Duct, voxel: float | None = None) -> Without:
    """Return `duct` without the places that are in `obstacles`; see `Without`."""
    return Without(duct, obstacles, voxel=voxel)


def _check_dimensions(name: str, ducts: tuple[Duct, ...]) -> None:
    for k, duct in enumerate(ducts):
        check_duct(f"{name} {k}", duct)
    dims = [duct.dim for duct in ducts]
    for k, dim in enumerate(dims):
        if dim != dims[0]:
            raise InputError(
                f"{name} {k} has {dim} dimensions: it must have {dims[0]}, as {name} 0 has"
            )


def _check_union(parts: tuple[Duct, ...]) -> None:
    """Raise `GeometryError` if the parts are not connected."""
    boxes = np.stack([part.bounds for part in parts])
    low, high = (
        np.maximum(boxes[:, None, 0], boxes[:, 0]),
        np.minimum(boxes[:, None, 1], boxes[:, 1]),
    )
    gaps = np.linalg.norm(np.maximum(low - high, 0.0), axis=-1)
    far = gaps > 0.0

    def meet(i: int, j: int) -> bool:
        gaps[i, j] = gaps[j, i] = _measure_gap(parts[i], parts[j], low[i, j], high[i, j])
        return bool(gaps[i, j] <= 0.0)

    check_connected("part", gaps, meet, far=far)


def _measure_gap(a: Duct, b: Duct, low: NDArray[np.float64], high: NDArray[np.float64]) -> float:
    """Return the least of the larger of both values found in a box; at most 0 if they overlap."""
    least = find_least(
        lambda points: np.maximum(a.signed_distance(points), b.signed_distance(points)),
        low,
        high,
        tolerance=OVERLAP_MM,
        enough=0.0,
        slope=max(a._lipschitz, b._lipschitz),
    )
    return least.value
