"""Ducts made of ducts: unions, obstacles taken away, walls drawn in, frames changed, sampling.

Each is a duct again. If all its parts are shapes of the analytic family, so is it, and kernels
get it as such; if not, it answers points through its parts and kernels through a sampled field.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import InputError
from ._analytic import ROUNDING
from ._compound import Compound
from ._family import collect_shapes, join_shapes
from ._overlap import check_connected, find_least
from ._sampling import choose_voxel, to_field
from ._wrapped import Eroded, Moved, inflate_duct
from .protocol import Duct, check_duct, count_dimensions

if TYPE_CHECKING:
    from ._family_kernels import ShapesData

__all__ = ["Eroded", "Moved", "Union", "Without", "to_field", "union", "without"]

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
