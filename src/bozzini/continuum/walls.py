"""Walls that a robot touches: the signed distances of ducts, made smooth enough for Newton."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_fields, quantity, show_value
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Shown
from .kernels import contact as kernels

FINEST_STEP = 0.02
"""Step of the lattice on which exact distances are made smooth [mm]."""

NODES_PER_DIAGONAL = 2.0 / math.sqrt(3.0)
"""Spacing of a sampled duct's nodes by its error, half the diagonal of a cell."""

STEEPEST = math.sqrt(3.0)
"""By how much an interpolated distance changes per mm, at most."""


@dataclass(frozen=True, kw_only=True)
class ContactOptions(Shown):
    """How a robot touches walls.

    Parameters
    ----------
    wall_stiffness : float, optional
        Force of the wall per length of the body and depth [N/mm^2 = MPa]; rigid unless given.
    friction : float
        Coefficient of Coulomb friction between body and wall.
    slip : float
        Slip below which friction is elastic [mm].
    segment_length : float
        Largest length of a segment [mm]; by default the body's radius, or a 60th of the robot if
        that is more.
    smoothing : float
        Distance over which a wall's kinks are rounded [mm]; by default the spacing of a sampled
        duct's nodes, and 0.02 mm for an exact one.
    tolerance : float
        How deep the body may be in the wall, or miss a tendon's length [mm].

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    wall_stiffness: float | None = quantity(
        "pressure",
        "Stiffness of the wall per length of the body (default: rigid).",
        low=0.0,
        low_open=True,
        default=None,
    )
    friction: float = quantity(
        "dimensionless", "Coefficient of friction on the wall.", low=0.0, high=2.0, default=0.0
    )
    slip: float = quantity(
        "length",
        "Slip below which friction is elastic.",
        low=1e-6,
        high=10.0,
        default=0.01,
        by_name=True,
    )
    segment_length: float | None = quantity(
        "length",
        "Largest segment (default: the body's radius, or a 60th of its length).",
        low=1e-3,
        default=None,
        by_name=True,
    )
    smoothing: float | None = quantity(
        "length",
        "Distance over which kinks of the wall are rounded (default: a sampled duct's spacing).",
        low=1e-4,
        high=100.0,
        default=None,
        by_name=True,
    )
    tolerance: float = quantity(
        "length",
        "How deep the body may be in the wall.",
        low=1e-9,
        high=0.1,
        default=1e-6,
        by_name=True,
    )

    def __post_init__(self) -> None:
        check_fields(self)


MOST_CELLS = 20_000
"""Cells of the lattice whose distances are kept, about 10 MB."""


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
    """One wall with its side: a lumen to stay inside, or an obstacle to stay outside.

    Smooth gaps are those of points seen from `origin` (3,) in the axes of the world [mm], such as a
    robot's base: then round-off of the places does not grow with the distance to the world's.
    """

    duct: Wall
    outside: bool
    smoothing: float | None = None
    origin: Floats = field(default_factory=lambda: np.zeros(3))

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
        """Return smooth gaps of the balls that are nearer than `margin` [mm] or are `held`.

        The points (m, 3) are seen from the origin.
        """
        near = self.measure(self.origin + points, radii) < margin + STEEPEST * 2.0 * self.step
        index = np.flatnonzero(near | held)
        if not len(index):
            return Touched.none()
        places = np.ascontiguousarray(points[index, : self.duct.dim])
        values = self._read_cells(np.floor(places / self.step).astype(np.int64))
        distance, gradient = np.empty(len(index)), np.empty((len(index), 3))
        curvature = np.empty((len(index), 3, 3))
        kernels.weigh_nodes(places, self.step, values, distance, gradient, curvature)
        sign = 1.0 if self.outside else -1.0
        return Touched(index, sign * distance - radii[index], sign * gradient, sign * curvature)

    @cached_property
    def _known(self) -> dict[tuple[int, ...], Floats]:
        """Distances at the nodes around cells of the lattice that were asked for before."""
        return {}

    def _read_cells(self, cells: NDArray[np.int64]) -> Floats:
        """Return the distances at the nodes around cells (m, dim) of the lattice, (m, 4^dim)."""
        known, keys = self._known, list(map(tuple, cells.tolist()))
        missing = list({key: None for key in keys if key not in known})
        if missing:
            if len(known) > MOST_CELLS:
                known.clear()
                missing = list(dict.fromkeys(keys))
            around = np.indices((kernels.SPLINE_NODES,) * cells.shape[1])[::-1] - 1
            around = around.reshape(cells.shape[1], -1).T  # the first axis fastest
            nodes = self.step * (np.array(missing)[:, None] + around)
            nodes += self.origin[: cells.shape[1]]
            values = np.asarray(self.duct.signed_distance(nodes), dtype=np.float64)
            known.update(zip(missing, values, strict=True))
        return np.array([known[key] for key in keys])


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
