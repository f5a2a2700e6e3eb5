"""Unions of super-ellipses (thesis 5.3.2.1), with a metric distance in place of eq. 5.16."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer
from ..errors import GeometryError
from ._overlap import Least, find_least, find_split, link_gauges, tell_split
from ._power_norms import dual_norm, join_norm, largest_radius, least_radius
from ._shape_checks import (
    check_counts,
    check_exponents,
    check_half_axes,
    check_places,
    check_wall,
    freeze_array,
    freeze_places,
    set_fields,
)
from ._shape_union import ShapeUnion, Slices

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from .compose import Eroded

__all__ = ["SuperEllipses"]

POWER_MIN = 1.0
"""Smallest power: below it a shape is pinched, not convex."""

POWER_MAX = 20.0
"""Largest power: a box whose corners are round by a twentieth."""


@dataclass(frozen=True, eq=False)
class SuperEllipses(ShapeUnion):
    """The union of convex super-ellipses, turned and placed; also an obstacle (`without`).

    Parameters
    ----------
    centres : (n, 2) float
        Of the shapes [mm].
    half_axes : (n, 2) float
        Along each shape's own axes [mm].
    powers : (n,) float
        In [1, 20]: 2 is an ellipse, 1 a rhomb, a large one a box. They are n of thesis eq. 5.16,
        and 2 / e of a super-ellipsoid's exponents.
    angles : (n,) float
        From the x axis to a shape's first axis [rad].
    inflation : float
        The wall is moved outwards by at most this much [mm].
    connected : bool
        Whether shapes that do not all hang together are refused; obstacles need not.
    wall : str
        What the wall is, in words.
    wall_error : float
        How far the true wall may be from the stated one [mm].

    Raises
    ------
    InputError
        If a half axis is not positive, or a power out of range.
    GeometryError
        If the union falls apart, with the shapes between which it does.

    Notes
    -----
    With y a point in a shape's frame ``G(y) = (|y1/a|^n + |y2/b|^n)^(1/n)`` is a norm for n >= 1.
    So ``r (G - 1)``, r the least radius of the shape, is 1-Lipschitz and never more than the
    distance to the wall, on either side. Inside it is what `signed_distance` answers; outside the
    distance to the shape's bounding circle, where that is more. Of several shapes the smallest
    value counts: where they overlap, that is less than the room (thesis eq. 5.18).
    """

    centres: NDArray[np.float64]
    half_axes: NDArray[np.float64]
    powers: NDArray[np.float64] = field(kw_only=True)
    angles: NDArray[np.float64] = field(kw_only=True)
    inflation: float = field(default=0.0, kw_only=True)
    connected: bool = field(default=True, kw_only=True)
    wall: str = field(default="union of super-ellipses", kw_only=True)
    wall_error: float = field(default=0.0, kw_only=True)

    dim = 2

    def __post_init__(self) -> None:
        centres = freeze_places("centres", self.centres, 2)
        half_axes = freeze_array("half axes", self.half_axes, (2,))
        powers = freeze_array("powers", self.powers, ())
        angles = freeze_array("angles", self.angles, ())
        check_counts(len(centres), {"half axes": half_axes, "powers": powers, "angles": angles})
        check_half_axes(half_axes)
        check_exponents("powers", powers, POWER_MIN, POWER_MAX, pinched="below")
        check_wall(self.inflation, self.wall_error)
        set_fields(self, centres=centres, half_axes=half_axes, powers=powers, angles=angles)
        if self.connected:
            self._check_union(0.0)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 2) corners of the smallest box around the union [mm]."""
        c, s = np.abs(np.cos(self.angles)), np.abs(np.sin(self.angles))
        a, b = self.half_axes.T
        along, across = (dual_norm(a * x, b * y, self.powers) for x, y in ((c, s), (s, c)))
        reach = np.stack([along, across], axis=1)
        reach += self.inflation
        return np.stack([(self.centres - reach).min(axis=0), (self.centres + reach).max(axis=0)])

    @property
    def least_radii(self) -> NDArray[np.float64]:
        """(n,) radius of the largest circle inside each shape [mm]."""
        a, b = self.half_axes.T
        return least_radius(a, b, self.powers)

    @property
    def areas(self) -> NDArray[np.float64]:
        """(n,) area of each shape [mm^2]."""
        from scipy.special import gamma

        inverse = 1.0 / self.powers
        factor = gamma(1.0 + inverse) ** 2 / gamma(1.0 + 2.0 * inverse)
        return np.asarray(4.0 * self.half_axes.prod(axis=1) * factor)

    def evaluate_gauge(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., n) gauge of every shape: 1 on its wall, homogeneous about its centre."""
        array = check_places("points", points, dim=2)
        away = array[..., None, :] - self.centres
        c, s = np.cos(self.angles), np.sin(self.angles)
        u = np.abs(c * away[..., 0] + s * away[..., 1]) / self.half_axes[:, 0]
        v = np.abs(c * away[..., 1] - s * away[..., 0]) / self.half_axes[:, 1]
        return join_norm(u, v, self.powers)

    def outline(self, shape: int, *, count: int = 200) -> NDArray[np.float64]:
        """Return `count` points (count, 2) on the wall of one shape, counter-clockwise [mm]."""
        self._check_index("shape", shape)
        check_integer("count", count, low=1)
        turn = 2.0 * np.pi * np.arange(count) / count
        local = np.stack([np.cos(turn), np.sin(turn)], axis=1) * self.half_axes[shape]
        c, s = np.cos(self.angles[shape]), np.sin(self.angles[shape])
        away = local @ np.array([[c, s], [-s, c]])
        gauge = self.evaluate_gauge(self.centres[shape] + away)[:, shape]
        return np.asarray(self.centres[shape] + away / gauge[:, None])

    def measure_seam(self, first: int, second: int) -> float:
        """Return how deep two shapes overlap: the largest value both have in common, negated [mm].

        Both eroded by less overlap still; negative if they are apart.
        """
        self._check_index("first", first)
        self._check_index("second", second)
        return -self._search_seam(first, second, -np.inf).value

    def erode(self, clearance: float) -> Eroded:
        """Return the duct of all places with at least `clearance` mm to the wall.

        Raises
        ------
        GeometryError
            If that falls apart, with the shapes between which it does and the largest clearance
            there. As each shape is drawn in by itself, it falls apart earlier than the true room.
        """
        from .compose import Eroded

        eroded = Eroded(self, clearance)
        if self.connected:
            self._check_union(clearance)
        return eroded

    def _slice(self) -> Slices:
        from ._family_kernels import SUPER_ELLIPSE

        turn = np.stack([np.cos(self.angles), np.sin(self.angles)], axis=1)
        columns = [self.centres, turn, self.half_axes, self.powers[:, None]]
        rows = np.concatenate([*columns, self.least_radii[:, None]], axis=1)
        reach = self._largest_radii[:, None]
        balls = np.concatenate([self.centres, np.zeros_like(reach), reach], axis=1)
        return Slices(SUPER_ELLIPSE, list(rows), balls)

    @property
    def _largest_radii(self) -> NDArray[np.float64]:
        """(n,) radius of the smallest circle about its centre that holds each shape [mm]."""
        a, b = self.half_axes.T
        return largest_radius(a, b, self.powers)

    def _check_index(self, name: str, shape: int) -> None:
        check_integer(name, shape, low=0, high=len(self.centres) - 1)

    def _search_seam(self, first: int, second: int, enough: float) -> Least:
        pair = [first, second]
        radii = self.least_radii[pair]
        reach = self._largest_radii[pair][:, None]
        low = (self.centres[pair] - reach).max(axis=0)
        high = (self.centres[pair] + reach).min(axis=0)
        low, high = np.minimum(low, high), np.maximum(low, high)

        def deeper(points: NDArray[np.float64]) -> NDArray[np.float64]:
            values = radii * (self.evaluate_gauge(points)[:, pair] - 1.0)
            return np.asarray(values.max(axis=1))

        return find_least(deeper, low, high, tolerance=1e-6 * float(reach.max()), enough=enough)

    def _check_union(self, clearance: float) -> None:
        """Raise `GeometryError` if the shapes, drawn in by themselves, do not hang together."""
        if len(self.centres) == 1:
            return
        levels = 1.0 - clearance / self.least_radii
        links, gaps = link_gauges(self.centres, self.evaluate_gauge(self.centres), levels)
        reach = self._largest_radii
        away = np.linalg.norm(self.centres[:, None] - self.centres, axis=-1)

        def meet(i: int, j: int) -> bool:
            return self._search_seam(i, j, -clearance).value <= -clearance

        far = away > reach[:, None] + reach
        split = find_split(gaps, meet, links=links, far=far)
        if split is None:
            return
        told = tell_split("shape", split)
        if clearance > 0.0:
            a, b = split
            told = (
                f"clearance is {clearance:g} mm: {told}; between shape {a} and shape {b} "
                f"it must be at most {self.measure_seam(a, b):.3g} mm"
            )
        raise GeometryError(told)
