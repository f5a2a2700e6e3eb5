"""Unions of super-ellipses (thesis 5.3.2.1), with a metric distance in place of eq. 5.16."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number, check_points
from ..errors import GeometryError, InputError
from ._analytic import freeze_array
from ._overlap import Least, find_least
from ._solids import Slices, SolidShapes, check_connected

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from .compose import Eroded

__all__ = ["SuperEllipses"]

POWER_MIN = 1.0
"""Smallest power: below it a shape is pinched, not convex."""

POWER_MAX = 20.0
"""Largest power: a box whose corners are round by a twentieth."""


@dataclass(frozen=True, eq=False)
class SuperEllipses(SolidShapes):
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
        centres = freeze_array("centres", self.centres, (2,))
        half_axes = freeze_array("half axes", self.half_axes, (2,))
        powers = freeze_array("powers", self.powers, ())
        angles = freeze_array("angles", self.angles, ())
        for name, array in (("half axes", half_axes), ("powers", powers), ("angles", angles)):
            if len(array) != len(centres):
                raise InputError(
                    f"{name} has {len(array)} value(s): it must have one per centre, {len(centres)}"
                )
        for k, axes in enumerate(half_axes):
            if axes.min() <= 0.0:
                raise InputError(
                    f"half axes[{k}] is {axes.tolist()} mm: each must lie in (0, inf) mm"
                )
        bad = (powers < POWER_MIN) | (powers > POWER_MAX)
        if bad.any():
            k = int(np.argmax(bad))
            why = ", the shape would not be convex" if powers[k] < POWER_MIN else ""
            raise InputError(
                f"powers[{k}] is {powers[k]:g}: it must lie in [{POWER_MIN:g}, {POWER_MAX:g}]{why}"
            )
        check_number("inflation", self.inflation, low=0.0, unit="mm")
        check_number("wall error", self.wall_error, low=0.0, unit="mm")
        for name, array in (
            ("centres", centres),
            ("half_axes", half_axes),
            ("powers", powers),
            ("angles", angles),
        ):
            object.__setattr__(self, name, array)
        if self.connected:
            self._check_union(0.0)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 2) corners of the smallest box around the union [mm]."""
        c, s = np.abs(np.cos(self.angles)), np.abs(np.sin(self.angles))
        a, b = self.half_axes.T
        reach = np.stack([self._dual(a * c, b * s), self._dual(a * s, b * c)], axis=1)
        reach += self.inflation
        return np.stack([(self.centres - reach).min(axis=0), (self.centres + reach).max(axis=0)])

    @property
    def least_radii(self) -> NDArray[np.float64]:
        """(n,) radius of the largest circle inside each shape [mm]."""
        return self._radii(outer=False)

    @property
    def areas(self) -> NDArray[np.float64]:
        """(n,) area of each shape [mm^2]."""
        from scipy.special import gamma

        inverse = 1.0 / self.powers
        factor = gamma(1.0 + inverse) ** 2 / gamma(1.0 + 2.0 * inverse)
        return np.asarray(4.0 * self.half_axes.prod(axis=1) * factor)

    def evaluate_gauge(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., n) gauge of every shape: 1 on its wall, homogeneous about its centre."""
        array = check_points("points", points, dim=2)
        away = array[..., None, :] - self.centres
        c, s = np.cos(self.angles), np.sin(self.angles)
        u = np.abs(c * away[..., 0] + s * away[..., 1]) / self.half_axes[:, 0]
        v = np.abs(c * away[..., 1] - s * away[..., 0]) / self.half_axes[:, 1]
        return _join(u, v, self.powers)

    def outline(self, shape: int, *, count: int = 200) -> NDArray[np.float64]:
        """Return `count` points (count, 2) on the wall of one shape, counter-clockwise [mm]."""
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
        reach = self._radii(outer=True)[:, None]
        balls = np.concatenate([self.centres, np.zeros_like(reach), reach], axis=1)
        return Slices(SUPER_ELLIPSE, list(rows), balls)

    def _radii(self, *, outer: bool) -> NDArray[np.float64]:
        """Largest or least radius of each shape (Hoelder's inequality)."""
        small, big = self.half_axes.min(axis=1), self.half_axes.max(axis=1)
        n = self.powers
        plain = n <= 2.0 if outer else n >= 2.0
        base = big if outer else small
        q = 2.0 * n / np.where(plain, 1.0, np.abs(2.0 - n))
        factor = (1.0 + (small / big) ** q) ** ((1.0 if outer else -1.0) / q)
        return np.asarray(np.where(plain, base, base * factor))

    def _dual(self, u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far each shape reaches along a direction: the norm of power n / (n - 1)."""
        n = self.powers
        return np.where(n > 1.0, _join(u, v, n / np.maximum(n - 1.0, 1e-9)), np.maximum(u, v))

    def _search_seam(self, first: int, second: int, enough: float) -> Least:
        pair = [first, second]
        radii = self.least_radii[pair]
        reach = self._radii(outer=True)[pair][:, None]
        low = (self.centres[pair] - reach).max(axis=0)
        high = (self.centres[pair] + reach).min(axis=0)
        low, high = np.minimum(low, high), np.maximum(low, high)

        def deeper(points: NDArray[np.float64]) -> NDArray[np.float64]:
            values = radii * (self.evaluate_gauge(points)[:, pair] - 1.0)
            return np.asarray(values.max(axis=1))

        return find_least(deeper, low, high, tolerance=1e-6 * float(reach.max()), enough=enough)

    def _check_union(self, clearance: float) -> None:
        """Raise `GeometryError` if the shapes, drawn in by themselves, do not hang together."""
        count = len(self.centres)
        if count == 1:
            return
        reach = self._radii(outer=True)
        away = np.linalg.norm(self.centres[:, None] - self.centres[None], axis=-1)
        gaps = away - reach[:, None] - reach[None]
        links = np.eye(count, dtype=bool)

        def look(i: int, j: int) -> None:
            if gaps[i, j] <= 0.0 and not links[i, j]:
                found = self._search_seam(i, j, -clearance).value <= -clearance
                links[i, j] = links[j, i] = found

        for i in range(count - 1):
            look(i, i + 1)
        chained = links[np.arange(count - 1), np.arange(1, count)]
        if chained.all():
            return
        for i in range(count):
            for j in range(i + 2, count):
                look(i, j)
        try:
            check_connected("shape", links, np.where(links, np.inf, gaps))
        except GeometryError as error:
            if clearance == 0.0:
                raise
            k = int(np.argmin(chained))
            most = self.measure_seam(k, k + 1)
            raise GeometryError(
                f"clearance is {clearance:g} mm: {error}; between shape {k} and shape {k + 1} "
                f"it must be at most {most:.3g} mm"
            ) from None


def _join(
    a: NDArray[np.float64], b: NDArray[np.float64], power: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(a^p + b^p)^(1/p), without overflow."""
    big = np.maximum(a, b)
    ratio = np.minimum(a, b) / np.where(big > 0.0, big, 1.0)
    return np.asarray(big * np.exp(np.log1p(ratio**power) / power))
