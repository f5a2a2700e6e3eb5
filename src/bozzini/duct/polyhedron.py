"""Unions of convex polyhedra: the half spaces of thesis eq. 5.33, made metric."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number
from ..errors import GeometryError, InputError
from ._analytic import freeze_array
from ._solids import Slices, SolidShapes, check_connected

__all__ = ["ConvexPolyhedra"]

THIN = 1e-9
"""Smallest inscribed radius of a piece that is solid, as a fraction of its largest coordinate."""


@dataclass(frozen=True, eq=False)
class ConvexPolyhedra(SolidShapes):
    """The union of convex polyhedra, each the meeting of half spaces.

    Parameters
    ----------
    pieces : sequence of (m, 4) float
        For each polyhedron its planes: outward normal and offset, a point x is on the inner side
        where ``normal . x + offset <= 0`` (thesis eq. 5.33). Normals of any length; kept as unit
        vectors.
    inflation : float
        The wall is moved outwards by this much [mm].
    connected : bool
        Whether pieces that do not all hang together are refused.
    wall : str
        What the wall is, in words.
    wall_error : float
        How far the true wall may be from the stated one [mm].

    Raises
    ------
    InputError
        If a plane is not finite or its normal has no length.
    GeometryError
        If a piece is empty, flat or has no end, or the union falls apart.

    Notes
    -----
    The value of a piece is the largest signed distance to its planes: the exact distance to the
    wall inside, at most the distance outside. Of a union it is the smallest over the pieces, a
    lower bound of the room where they overlap: pieces that only share a face leave no room there,
    so let them overlap. `kind` is "bound".
    """

    pieces: Sequence[NDArray[np.float64]]
    inflation: float = field(default=0.0, kw_only=True)
    connected: bool = field(default=True, kw_only=True)
    wall: str = field(default="union of convex polyhedra, ends closed", kw_only=True)
    wall_error: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        if np.ndim(self.pieces[0] if len(self.pieces) else ()) == 1 and len(self.pieces):
            raise InputError(
                f"pieces is one array of {len(self.pieces)} rows: it must be a sequence of arrays"
            )
        if len(self.pieces) == 0:
            raise InputError("pieces is empty: there must be at least one polyhedron")
        check_number("inflation", self.inflation, low=0.0, unit="mm")
        check_number("wall error", self.wall_error, low=0.0, unit="mm")
        pieces = []
        for k, given in enumerate(self.pieces):
            planes = np.array(freeze_array(f"pieces[{k}]", given, (4,), least=4))
            sizes = np.linalg.norm(planes[:, :3], axis=1)
            if sizes.min() == 0.0:
                raise InputError(
                    f"pieces[{k}][{int(np.argmin(sizes))}] has a normal of length 0: it is no plane"
                )
            planes = np.unique(planes / sizes[:, None], axis=0)
            planes.flags.writeable = False
            pieces.append(planes)
        object.__setattr__(self, "pieces", tuple(pieces))
        corners = tuple(_find_corners(f"piece {k}", planes) for k, planes in enumerate(pieces))
        object.__setattr__(self, "_corners", corners)
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
            points = freeze_array(f"groups[{k}]", group, (3,), least=4)
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

    def _slice(self) -> Slices:
        from ._family_kernels import HALFSPACES

        numbers = [np.concatenate([[len(piece)], piece.reshape(-1)]) for piece in self.pieces]
        return Slices(HALFSPACES, numbers, self._balls)

    def _check_union(self) -> None:
        balls = self._balls
        away = np.linalg.norm(balls[:, None, :3] - balls[None, :, :3], axis=-1)
        near = away <= balls[:, 3][:, None] + balls[:, 3][None]
        links = np.eye(len(balls), dtype=bool)
        for i, j in np.argwhere(np.triu(near, 1)):
            both = np.concatenate([self.pieces[i], self.pieces[j]])
            radius = _find_middle(both)[1]
            links[i, j] = links[j, i] = radius > THIN * float(np.abs(self.corners[i]).max())
        check_connected("piece", links, away)


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
    return np.asarray(meeting.intersections)
