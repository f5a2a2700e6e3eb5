"""Walls that a robot touches: the signed distances of ducts, made smooth enough for Newton."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import show_value
from ..errors import InputError
from .checks import Floats
from .kernels import contact as kernels

FINEST_STEP = 0.02
"""Step of the lattice on which exact distances are made smooth [mm]."""

NODES_PER_DIAGONAL = 2.0 / math.sqrt(3.0)
"""Spacing of a sampled duct's nodes by its error, half the diagonal of a cell."""

STEEPEST = math.sqrt(3.0)
"""By how much an interpolated distance changes per mm, at most."""


@runtime_checkable
class Wall(Protocol):
    """A lumen, as `bozzini.duct.Duct` has it: a signed distance, negative inside [mm]."""

    @property
    def dim(self) -> int:
        """3, or 2 for a planar one, which takes x and y."""

    @property
    def error(self) -> float:
        """By how much the distance may be wrong [mm]; 0 unless sampled."""

    def signed_distance(self, points: ArrayLike, /) -> Floats:
        """Return the (...) signed distance at points (..., dim) [mm]."""


class Touched(NamedTuple):
    """Smooth gaps of m samples: which ones, the gap, its gradient and curvature by the place."""

    places: NDArray[np.int64]
    gap: Floats
    gradient: Floats
    curvature: Floats

    @classmethod
    def none(cls) -> Touched:
        """Return that of no sample."""
        empty = np.empty(0)
        return cls(np.empty(0, dtype=np.int64), empty, empty.reshape(0, 3), empty.reshape(0, 3, 3))


@dataclass(frozen=True, eq=False)
class Boundary:
    """One wall with its side: a lumen to stay inside, or an obstacle to stay outside."""

    duct: Wall
    outside: bool
    smoothing: float | None = None

    @cached_property
    def step(self) -> float:
        """Step of the lattice on which the distance is made smooth [mm]."""
        if self.smoothing is not None:
            return self.smoothing
        return max(FINEST_STEP, NODES_PER_DIAGONAL * float(self.duct.error))

    def measure(self, points: Floats, radii: Floats) -> Floats:
        """Return the gap (m,) between the wall and balls at points (m, 3) [mm], not smooth."""
        distance = self.duct.signed_distance(points[:, : self.duct.dim])
        return np.asarray((distance if self.outside else -distance) - radii)

    def measure_near(
        self, points: Floats, radii: Floats, held: NDArray[np.bool_], margin: float
    ) -> Touched:
        """Return smooth gaps of the balls that are nearer than `margin` [mm] or are `held`."""
        near = self.measure(points, radii) < margin + STEEPEST * 2.0 * self.step
        index = np.flatnonzero(near | held)
        if not len(index):
            return Touched.none()
        dim = self.duct.dim
        places = np.ascontiguousarray(points[index, :dim])
        nodes = np.empty((len(index), kernels.SPLINE_NODES**dim, dim))
        kernels.place_nodes(places, self.step, nodes)
        values = np.ascontiguousarray(self.duct.signed_distance(nodes), dtype=np.float64)
        distance, gradient = np.empty(len(index)), np.empty((len(index), 3))
        curvature = np.empty((len(index), 3, 3))
        kernels.weigh_nodes(places, self.step, values, distance, gradient, curvature)
        sign = 1.0 if self.outside else -1.0
        return Touched(index, sign * distance - radii[index], sign * gradient, sign * curvature)


def take_boundaries(duct: object, obstacles: object) -> tuple[Boundary, ...]:
    """Return the walls of a lumen, which may be None, and of obstacles.

    Raises
    ------
    InputError
        If one is no duct, or there is none.
    """
    others = tuple(obstacles) if isinstance(obstacles, (list, tuple)) else (obstacles,)
    found = []
    for name, wall, outside in (
        ("duct", duct, False),
        *((f"obstacles[{k}]", other, True) for k, other in enumerate(others)),
    ):
        if wall is None and not outside:
            continue
        if not isinstance(wall, Wall):
            raise InputError(f"{name} is {show_value(wall)}: it must be a duct")
        found.append(Boundary(wall, outside))
    if not found:
        raise InputError("there is no wall: give a duct, or obstacles")
    return tuple(found)
