"""Unions of convex polyhedra: the half spaces of thesis eq. 5.33, made metric."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import show_apart
from ...errors import GeometryError, InputError
from ..checks import (
    COORDINATE_MAX,
    freeze_array,
    freeze_places,
    scale_to_unit_normals,
    set_fields,
)
from ..search import check_connected
from .base import ShapeUnion

OFFSET_MAX = 2.0 * COORDINATE_MAX
"""A plane farther from the origin than this does not meet the space that shapes may be in [mm]."""

THIN = 1e-9
"""Smallest inscribed radius of a piece that is solid, as a fraction of its largest coordinate."""


@dataclass(frozen=True, eq=False)
class ConvexPolyhedra(ShapeUnion):
    """The union of convex polyhedra, each the meeting of half spaces.

    Parameters
    ----------
    pieces : sequence of (m, 4) float
        For each polyhedron its planes: outward normal and offset, a point x is on the inner side
        where ``normal . x + offset <= 0`` (thesis eq. 5.33). Normals of any length; kept as unit
        vectors.
    connected : bool
        Whether pieces that are not all connected are refused.
    inflation, wall, wall_error
        See `DuctShape`.

    Raises
    ------
    InputError
        If a plane is not finite or its normal has no length.
    GeometryError
        If a piece is empty, flat or has no end, or the union is not connected.

    Notes
    -----
    The value of a piece is the largest signed distance to its planes: the exact distance to the
    wall inside, at most the distance outside. Of a union it is the smallest over the pieces, a
    lower bound of the clearance where they overlap: pieces that only share a face leave none there,
    so let them overlap. `kind` is "bound".
    """

    pieces: Sequence[NDArray[np.float64]]
    connected: bool = field(default=True, kw_only=True)
    wall: str = field(default="union of convex polyhedra, ends closed", kw_only=True)

    name = "polyhedra"
    unit_kinds = {"pieces": ("dimensionless", "dimensionless", "dimensionless", "length")}
    code = 12
    dim = 3

    def __post_init__(self) -> None:
        given: object = self.pieces
        if isinstance(given, str) or not hasattr(given, "__len__"):
            raise InputError(
                f"pieces is a {type(given).__name__}: it must be a sequence of arrays (m, 4)"
            )
        if len(self.pieces) == 0:
            raise InputError("pieces is empty: there must be at least one polyhedron")
        if np.ndim(self.pieces[0]) == 1:
            raise InputError(
                f"pieces is one array of {len(self.pieces)} rows: it must be a sequence of arrays"
            )
        super().__post_init__()
        pieces = []
        for k, rows in enumerate(self.pieces):
            planes = freeze_array(f"pieces[{k}]", rows, (4,), least=4)
            planes = scale_to_unit_normals(f"normal of pieces[{k}]", planes)
            far = np.abs(planes[:, 3]) > OFFSET_MAX
            if far.any():
                i = int(np.argmax(far))
                shown = show_apart(abs(planes[i, 3]), OFFSET_MAX)
                raise InputError(
                    f"pieces[{k}][{i}] is a plane {shown[0]} mm from the origin: it "
                    f"must be at most {shown[1]} mm"
                )
            planes = np.unique(planes, axis=0)
            planes.flags.writeable = False
            pieces.append(planes)
        corners = tuple(_find_corners(f"piece {k}", planes) for k, planes in enumerate(pieces))
        set_fields(self, pieces=tuple(pieces), _corners=corners)
        if self.connected and len(pieces) > 1:
            self._check_union()

    @classmethod
    def from_points(cls, groups: Sequence[ArrayLike], *, connected: bool = True) -> ConvexPolyhedra:
        """Return the union of the convex hulls of groups of points, each (m, 3) [mm].

        The hull of all points of a tract would fill its bends: cut it into convex groups.

        Raises
        ------
        GeometryError
            If the points of a group lie in a plane.
        """
        from scipy.spatial import ConvexHull, QhullError

        pieces = []
        for k, group in enumerate(groups):
            points = freeze_places(f"groups[{k}]", group, 3, least=4)
            try:
                hull = ConvexHull(points)
            except QhullError:
                raise GeometryError(
                    f"groups[{k}] has no hull: its {len(points)} points lie in a plane"
                ) from None
            pieces.append(hull.equations)
        return cls(pieces, connected=connected)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) corners of the box around the union [mm]."""
        corners = np.concatenate(self.corners)
        return np.stack(
            [corners.min(axis=0) - self.inflation, corners.max(axis=0) + self.inflation]
        )

    @property
    def corners(self) -> tuple[NDArray[np.float64], ...]:
        """Corners (k, 3) of each piece [mm]."""
        corners: tuple[NDArray[np.float64], ...] = self.__dict__["_corners"]
        return corners

    @cached_property
    def _balls(self) -> NDArray[np.float64]:
        balls = []
        for corners in self.corners:
            middle = corners.mean(axis=0)
            reach = float(np.linalg.norm(corners - middle, axis=1).max())
            # Corners are where planes meet, up to the rounding of their equations.
            balls.append([*middle, reach * (1.0 + 1e-9) + 1e-9])
        return np.array(balls)

    def numbers(self) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
        """Return the numbers of each piece, and bounding balls [mm].

        How many planes, then normal (3) and offset of each.
        """
        rows = [np.concatenate([[len(piece)], piece.reshape(-1)]) for piece in self.pieces]
        return rows, self._balls

    @staticmethod
    def move(
        row: NDArray[np.float64], rotation: NDArray[np.float64], shift: NDArray[np.float64]
    ) -> bool:
        """Turn the normals, move the planes."""
        planes = row[1:].reshape(-1, 4)
        planes[:, :3] = planes[:, :3] @ rotation.T
        planes[:, 3] -= planes[:, :3] @ shift
        return True

    def _check_union(self) -> None:
        balls = self._balls
        reach = balls[:, 3]
        gaps = np.linalg.norm(balls[:, None, :3] - balls[:, :3], axis=-1) - reach[:, None] - reach

        def meet(i: int, j: int) -> bool:
            both = np.concatenate([self.pieces[i], self.pieces[j]])
            return _find_middle(both)[1] > THIN * float(np.abs(self.corners[i]).max())

        check_connected("piece", gaps, meet, far=gaps > 0.0)


def _find_middle(planes: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return centre and radius of the largest ball inside planes; the radius may be negative."""
    from scipy.optimize import linprog

    matrix = np.concatenate([planes[:, :3], np.ones((len(planes), 1))], axis=1)
    answer = linprog(
        [0.0, 0.0, 0.0, -1.0], A_ub=matrix, b_ub=-planes[:, 3], bounds=[(None, None)] * 4
    )
    if answer.status != 0:
        return np.zeros(3), np.inf
    return np.asarray(answer.x[:3]), float(answer.x[3])


def _find_corners(name: str, planes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners of a polyhedron, or raise `GeometryError` if it is none."""
    from scipy.spatial import HalfspaceIntersection, QhullError

    middle, radius = _find_middle(planes)
    endless = f"{name} has no end: its {len(planes)} planes do not close it"
    if not np.isfinite(radius):
        raise GeometryError(endless)
    if radius <= THIN * max(float(np.abs(planes[:, 3]).max()), float(np.abs(middle).max())):
        raise GeometryError(
            f"{name} is empty or flat: the largest ball inside has a radius of {radius:.2g} mm"
        )
    try:
        with np.errstate(divide="ignore", invalid="ignore"):  # of corners at infinity
            meeting = HalfspaceIntersection(planes, middle)
    except QhullError:
        raise GeometryError(endless) from None
    # The middle is inside the dual hull exactly if the planes close the piece.
    if meeting.dual_equations[:, -1].max() * radius > -1e-9:
        raise GeometryError(endless)
    corners = np.asarray(meeting.intersections)
    if not np.abs(corners).max() <= COORDINATE_MAX:
        shown = show_apart(np.abs(corners).max(), COORDINATE_MAX)
        raise GeometryError(
            f"{name} reaches to {shown[0]} mm: it must stay within "
            f"{shown[1]} mm of the origin along each axis"
        )
    return corners
