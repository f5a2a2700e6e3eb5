"""Upper bounds of a duct's clearance, on a grid.

A proof that a link does not come through needs them; a duct itself answers lower bounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..duct.field import SampledField
from ..duct.protocol import Duct, count_dimensions

__all__ = ["Ceiling", "make_ceiling"]

NODES_MAX = {2: 150_000, 3: 400_000}
"""An analytic duct, planar or 3-D, is put on a grid of about this many nodes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ceiling:
    """Upper bounds of the clearance at the nodes of a grid, as negative distances.

    Parameters
    ----------
    values : (nx, ny, nz) float32
        Minus an upper bound of the clearance [mm].
    step : (3,) float
        Distance between nodes [mm].
    origin : (3,) float
        Node (0, 0, 0) in the world frame, whose axes the grid has; not used for a sampled field,
        which keeps its own grid [mm].
    floor : float
        Bounds below this only say that the clearance is below it [mm].
    duct : Duct
    """

    values: NDArray[np.float32]
    step: NDArray[np.float64]
    origin: NDArray[np.float64]
    floor: float
    duct: Duct

    @property
    def planar(self) -> bool:
        """Whether the duct is planar."""
        return count_dimensions(self.duct) == 2

    def to_local(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn world points (..., dim) into the grid's frame (..., 3) [mm]."""
        if isinstance(self.duct, SampledField):
            return self.duct.to_grid(points)
        if self.planar:
            points = np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)
        return np.asarray(points - self.origin)

    def to_world(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn points (..., 3) of the grid's frame into world points (..., dim) [mm]."""
        if isinstance(self.duct, SampledField):
            return self.duct.to_world(points)
        return np.asarray((points + self.origin)[..., : count_dimensions(self.duct)])

    def measure(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return upper bounds (n,) of the clearance at local points (n, 3) [mm]."""
        from ._traverse_kernels import measure_ceilings

        result = np.empty(len(points))
        measure_ceilings(self.values, self.step, self.floor, points, result)
        return result


def make_ceiling(duct: Duct) -> Ceiling:
    """Put upper bounds of a duct's clearance on a grid.

    An exact distance is its own bound at nodes. Otherwise the distance inside may promise too
    little, in a sampled field too if it was sampled from such a one. But every point within the
    distance of a node outside is outside too, and the distance to such points bounds the clearance.
    """
    if isinstance(duct, SampledField):
        step = np.asarray(duct.spacing, dtype=np.float64)
        shape = duct.values.shape
        # Beyond the reach distances are only known to be at least that: as bounds of the clearance
        # from above these are right, but no wall can be found from there.
        beyond = max(duct.reach - duct.inflation, 0.0)
        values = _measure_outside(
            duct,
            lambda flat: duct.to_world(np.stack(np.unravel_index(flat, shape), axis=-1) * step),
            duct.values,
            step,
            inflation=duct.inflation,
            known=duct.values < np.float64(duct.reach - duct.error),
        )
        return Ceiling(
            values=_round_down(values), step=step, origin=np.zeros(3), floor=-beyond, duct=duct
        )
    low, high = duct.bounds
    dim = len(low)
    pitch = float(np.prod(high - low) / NODES_MAX[dim]) ** (1.0 / dim)
    axes = [np.arange(low[k] - 2.0 * pitch, high[k] + 3.0 * pitch, pitch) for k in range(dim)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    origin = np.zeros(3)
    origin[:dim] = nodes.reshape(-1, dim)[0]
    distance: NDArray[np.floating[Any]] = duct.signed_distance(nodes) - duct.error
    if duct.kind != "exact" or duct.inflation > 0.0:
        points = nodes.reshape(-1, dim)
        distance = _measure_outside(duct, points.__getitem__, distance, np.full(dim, pitch))
    if dim == 2:  # two equal sheets: points of the plane are in the lower one
        distance = np.repeat(distance[..., None], 2, axis=-1)
    return Ceiling(
        values=_round_down(distance),
        step=np.full(3, pitch),
        origin=origin,
        floor=-math.inf,
        duct=duct,
    )


def _measure_outside(
    duct: Duct,
    find_nodes: Callable[[NDArray[np.int64]], NDArray[np.float64]],
    distance: NDArray[np.floating[Any]],
    step: NDArray[np.float64],
    inflation: float = 0.0,
    known: NDArray[np.bool_] | bool = True,
) -> NDArray[np.floating[Any]]:
    """Return the distance where it is positive; elsewhere minus that to a point known outside.

    The array has the type of `distance`, from which the inflation is taken; nodes are asked for by
    their flat numbers. Sums are made in float64, whatever the type.

    That is the foot of the nearest node outside, on the wall or between it and the node.
    """
    from scipy import ndimage

    moved = np.float64(inflation)  # a float of Python's would be rounded to float32 first
    inside = distance <= moved
    outside = ~inside & known
    result = np.empty_like(distance)
    np.subtract(distance, moved, out=result, casting="same_kind")
    if not outside.any():
        result[inside] = -math.inf
        return result
    nearest = ndimage.distance_transform_edt(
        ~outside, sampling=tuple(step), return_distances=False, return_indices=True
    )
    found = np.ravel_multi_index(tuple(index[inside] for index in nearest), distance.shape)
    rim, place = np.unique(found, return_inverse=True)
    points = find_nodes(rim)
    slope = duct.gradient(points)
    slope = slope / np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-12)
    feet = points - (distance.ravel()[rim] - moved)[:, None] * slope
    nodes = find_nodes(np.flatnonzero(inside))
    result[inside] = -np.linalg.norm(nodes - feet[place], axis=-1)
    return result


def _round_down(values: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    return np.nextafter(values.astype(np.float32, copy=False), np.float32(-np.inf))
