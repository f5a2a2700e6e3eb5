"""Ducts made of ducts: unions, obstacles taken away, walls drawn in, frames changed, sampling.

Each is a duct again. If all its parts are shapes of the analytic family, so is it, and kernels
get it as such; if not, it answers points through its parts and kernels through a sampled field.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number
from ..errors import GeometryError, InputError
from .base import Duct, check_duct, check_places, check_rotation, count_dimensions
from .shapes.common import (
    ROUNDING,
    AnalyticDuct,
    check_connected,
    collect_shapes,
    find_least,
    join_shapes,
    move_shapes,
    shift_shapes,
)

if TYPE_CHECKING:
    from .field import PlanarField, SampledField
    from .kernels.family import ShapesData

# From any duct to a sampled field, with a rigorous error.

NODES_MAX = 400_000_000
"""A sampled grid may have this many nodes."""

NODES_WANTED = 4_000_000
"""And has about this many where nobody says how fine it should be."""

MARGIN = 2.0
"""How far the grid reaches beyond the duct [nodes]."""


def to_field(duct: Duct, voxel: float) -> SampledField | PlanarField:
    """Sample the signed distance of a duct on a grid with nodes `voxel` mm apart.

    Parameters
    ----------
    duct : Duct
        Planar or 3-D.
    voxel : float
        Distance between nodes [mm].

    Returns
    -------
    SampledField or PlanarField
        Its ``error`` bounds how far its answer is from the duct's value, itself made larger by
        the duct's own ``error`` (for a sampled duct sqrt(3) times that does); its
        ``clearance_bound`` is rigorous for the duct's wall.

    Raises
    ------
    InputError
        If `voxel` is not positive, or the grid would have more than 400 million nodes.

    Notes
    -----
    The interpolant T of a 1-Lipschitz value s is within e of it, e^2 = sum h_k^2 f_k (1 - f_k) at
    the fractions f_k of the cell (Jensen). The bound by squares holds too, though a node's value
    may be a lower bound b of the distance d: T[b^2] - e^2 <= T[d^2] - e^2 <= d^2.
    """
    from .field import PlanarField, SampledField

    check_duct("duct", duct)
    check_number("voxel", voxel, low=0.0, low_open=True, unit="mm")
    dim = count_dimensions(duct)
    size = np.ptp(duct.bounds, axis=0)
    least = (float(size.prod()) / NODES_MAX) ** (1.0 / dim)
    if voxel < 1e-3 * least:  # the number of nodes might overflow
        raise InputError(
            f"voxel is {voxel:g} mm: the grid would have far too many nodes, it must be at least "
            f"about {least:.2g} mm"
        )
    low, high = duct.bounds + MARGIN * voxel * np.array([[-1.0], [1.0]])
    counts = np.ceil((high - low) / voxel) + 1.0
    if counts.prod() > NODES_MAX:
        least = voxel * (counts.prod() / NODES_MAX) ** (1.0 / dim)
        raise InputError(
            f"voxel is {voxel:g} mm: the grid would have {counts.prod():.3g} nodes, it must "
            f"be at least about {least:.2g} mm"
        )
    axes = [low[k] + voxel * np.arange(int(counts[k])) for k in range(dim)]
    # The field takes its inflation off again.
    more = duct.error + duct.inflation
    origin = np.zeros(3)
    origin[:dim] = low
    spacing = np.full(3, float(voxel))
    if dim == 2:
        sheet = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        layer = (duct.signed_distance(sheet) + more).astype(np.float32)
        values = np.repeat(layer[..., None], 2, axis=-1)
    else:
        values = np.empty(tuple(len(axis) for axis in axes), dtype=np.float32)
        sheet = np.stack(np.meshgrid(axes[1], axes[2], indexing="ij"), axis=-1)
        for index, x in enumerate(axes[0]):
            points = np.concatenate([np.full((*sheet.shape[:-1], 1), x), sheet], axis=-1)
            values[index] = duct.signed_distance(points) + more
    # An interpolant is not exact; at its nodes only it may be.
    known_outside = duct.kind == "exact" or (
        duct.kind != "sampled" and bool(getattr(duct, "exact_outside", False))
    )
    sampled = SampledField(
        values=values,
        spacing=spacing,
        origin=origin,
        rotation=np.eye(3),
        inflation=duct.inflation,
        wall=f"{duct.wall}, sampled every {voxel:g} mm",
        wall_error=duct.wall_error,
        reach=math.inf if known_outside else 0.0,
        exact_outside=known_outside,
    )
    return PlanarField(sampled) if dim == 2 else sampled


def choose_voxel(bounds: NDArray[np.float64], parts: tuple[Duct, ...]) -> float:
    """Return the spacing of the finest sampled part, or one that makes about 4 million nodes [mm].

    A part with a field of its own but finer than that limit allows is sampled more coarsely.
    """
    from .field import SampledField

    size = bounds[1] - bounds[0]
    least = float((size.prod() / (16.0 * NODES_WANTED)) ** (1.0 / len(size)))
    own = [float(part.spacing.min()) for part in parts if isinstance(part, SampledField)]
    if own:
        return max(min(own), least)
    return float((size.prod() / NODES_WANTED) ** (1.0 / len(size)))


# A duct around one other: its wall drawn in, or its frame changed.

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
        from .kernels.family import ShapesData

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


# What ducts of several parts share: the family's kernels if they can be had, else the parts.


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


OVERLAP = 1e-3
"""Parts of a union must overlap where the search can see it: about this deep [mm]."""


@dataclass(frozen=True, eq=False)
class Union(Compound):
    """All places that are in one of several ducts.

    Parameters
    ----------
    parts : tuple of Duct
        All planar or all 3-D.
    connected : bool
        Whether parts that do not all hang together are refused.
    voxel : float, optional
        Spacing of the nodes where kernels need a sampled field [mm]. By default that of the
        finest sampled part, or about 4 million nodes.

    Raises
    ------
    InputError
        If there is no part, or planar and 3-D parts are mixed.
    GeometryError
        If the union falls apart, with the parts between which it does.

    Notes
    -----
    The value is the smallest of the parts': exact outside where theirs are, and inside a lower
    bound of the room.
    """

    parts: tuple[Duct, ...]
    connected: bool = field(default=True, kw_only=True)
    voxel: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts:
            raise InputError("a union has 0 parts: it must have at least 1")
        _check_dimensions("part", self.parts)
        if self.voxel is not None:
            check_number("voxel", self.voxel, low=0.0, low_open=True, unit="mm")
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
        return replace(self, parts=tuple(inflate_duct(part, distance) for part in self.parts))

    @property
    def family_shapes(self) -> ShapesData | None:
        """Its shapes, if it is made of shapes."""
        return self._shapes

    @cached_property
    def _shapes(self) -> ShapesData | None:
        shapes = [collect_shapes(part) for part in self.parts]
        known = [data for data in shapes if data is not None]
        return join_shapes(known, []) if len(known) == len(shapes) else None

    @property
    def _all(self) -> tuple[Duct, ...]:
        return self.parts

    @property
    def _voxel(self) -> float:
        return self.voxel if self.voxel is not None else choose_voxel(self.bounds, self.parts)

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
        if self.voxel is not None:
            check_number("voxel", self.voxel, low=0.0, low_open=True, unit="mm")
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

    def inflate(self, distance: float) -> Without:
        """Return the same with the wall of the duct moved outwards by `distance` mm more."""
        return replace(self, duct=inflate_duct(self.duct, distance))

    @property
    def family_shapes(self) -> ShapesData | None:
        """Its shapes, if it is made of shapes."""
        return self._shapes

    @cached_property
    def _shapes(self) -> ShapesData | None:
        lumen = collect_shapes(self.duct)
        shapes = [collect_shapes(obstacle) for obstacle in self.obstacles]
        known = [data for data in shapes if data is not None]
        if lumen is None or len(known) < len(shapes):
            return None
        return join_shapes([lumen], known)

    @property
    def _all(self) -> tuple[Duct, ...]:
        return (self.duct, *self.obstacles)

    @property
    def _voxel(self) -> float:
        return self.voxel if self.voxel is not None else choose_voxel(self.bounds, (self.duct,))

    def _sign(self, part: int) -> float:
        return 1.0 if part == 0 else -1.0

    def _decide(self, points: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        values = np.stack([self._sign(k) * p.signed_distance(points) for k, p in self._numbered()])
        return values.argmax(axis=0), values.max(axis=0)

    def _bound(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        slack = ROUNDING * float(np.abs(self.bounds).max())
        bounds = [obstacle.signed_distance(points) - slack for obstacle in self.obstacles]
        return np.asarray(np.min([self.duct.clearance_bound(points), *bounds], axis=0))

    def _numbered(self) -> list[tuple[int, Duct]]:
        return list(enumerate(self._all))


def union(*ducts: Duct, connected: bool = True, voxel: float | None = None) -> Union:
    """Return the duct of all places that are in one of `ducts`; see `Union`."""
    return Union(ducts, connected=connected, voxel=voxel)


def without(duct: Duct, *obstacles: Duct, voxel: float | None = None) -> Without:
    """Return `duct` without the places that are in `obstacles`; see `Without`."""
    return Without(duct, obstacles, voxel=voxel)


def _check_dimensions(name: str, ducts: tuple[Duct, ...]) -> None:
    for k, duct in enumerate(ducts):
        check_duct(f"{name} {k}", duct)
    dims = [count_dimensions(duct) for duct in ducts]
    for k, dim in enumerate(dims):
        if dim != dims[0]:
            raise InputError(
                f"{name} {k} has {dim} dimensions: it must have {dims[0]}, as {name} 0 has"
            )


def _check_union(parts: tuple[Duct, ...]) -> None:
    """Raise `GeometryError` if the parts do not hang together."""
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
    sampled = "sampled" in (a.kind, b.kind)
    least = find_least(
        lambda points: np.maximum(a.signed_distance(points), b.signed_distance(points)),
        low,
        high,
        tolerance=OVERLAP,
        enough=0.0,
        slope=3.0**0.5 if sampled else 1.0,
    )
    return least.value
