"""Unions of super-ellipsoids (thesis 5.3.3.1), with a metric distance in place of eq. 5.30."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_integer
from ...errors import GeometryError
from ..base import Duct
from ..checks import (
    check_counts,
    check_exponents,
    check_half_axes,
    check_places,
    check_rotation,
    freeze_array,
    freeze_places,
    set_fields,
)
from ..search import Least, check_connected, describe_split, find_least, find_split, link_gauges
from .base import ShapeUnion

# Norms of two coordinates, (a^p + b^p)^(1/p): their duals, and the radii of their unit curves.

Array = NDArray[np.float64]


def join_norm(a: Array, b: Array, power: Array | float) -> Array:
    """Return (a^p + b^p)^(1/p) of numbers >= 0, without overflow."""
    big = np.maximum(a, b)
    ratio = np.minimum(a, b) / np.where(big > 0.0, big, 1.0)
    return np.asarray(big * np.exp(np.log1p(ratio**power) / power))


def dual_norm(a: Array, b: Array, power: Array) -> Array:
    """Return how far the unit curve of power p >= 1 reaches along (a, b): the norm of p/(p - 1)."""
    corner = power <= 1.0 + 1e-9
    q = power / np.where(corner, 1.0, power - 1.0)
    return np.where(corner, np.maximum(a, b), join_norm(a, b, q))


def least_radius(a: Array, b: Array, power: Array) -> Array:
    """Return the least radius of |x/a|^p + |y/b|^p = 1, p >= 1 (Hoelder's inequality)."""
    return _find_radius(a, b, power, outer=False)


def largest_radius(a: Array, b: Array, power: Array) -> Array:
    """Return the largest radius of the same."""
    return _find_radius(a, b, power, outer=True)


def _find_radius(a: Array, b: Array, power: Array, *, outer: bool) -> Array:
    small, big = np.minimum(a, b), np.maximum(a, b)
    # Up to p = 2 the farthest point is on the longer axis, from 2 on the nearest on the shorter.
    plain = power <= 2.0 if outer else power >= 2.0
    base = big if outer else small
    q = 2.0 * power / np.where(plain, 1.0, np.abs(2.0 - power))
    factor = (1.0 + (small / big) ** q) ** ((1.0 if outer else -1.0) / q)
    return np.asarray(np.where(plain, base, base * factor))


# Unions of super-ellipses (thesis 5.3.2.1), with a metric distance in place of eq. 5.16.

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
    connected : bool
        Whether shapes that are not all connected are refused; obstacles need not.
    inflation, wall, wall_error
        See `DuctShape`.

    Raises
    ------
    InputError
        If a half axis is not positive, or a power out of range.
    GeometryError
        If the union is not connected, with the shapes between which it is interrupted.

    Notes
    -----
    With y a point in a shape's frame ``G(y) = (|y1/a|^n + |y2/b|^n)^(1/n)`` is a norm for n >= 1.
    So ``r (G - 1)``, r the least radius of the shape, is 1-Lipschitz and never more than the
    distance to the wall, on either side. Inside it is what `signed_distance` answers; outside the
    distance to the shape's bounding circle, where that is more. Of several shapes the smallest
    value counts: where they overlap, that is less than the clearance (thesis eq. 5.18).
    """

    centres: NDArray[np.float64]
    half_axes: NDArray[np.float64]
    powers: NDArray[np.float64] = field(kw_only=True)
    angles: NDArray[np.float64] = field(kw_only=True)
    connected: bool = field(default=True, kw_only=True)
    wall: str = field(default="union of super-ellipses", kw_only=True)

    name = "superellipses"
    code = 0
    dim = 2
    columns = {
        "centre": ("centres", "lengths"),
        "half_axes": ("half_axes", "lengths"),
        "power": ("powers", "number"),
        "angle": ("angles", "angle"),
    }

    def __post_init__(self) -> None:
        centres = freeze_places("centres", self.centres, 2)
        half_axes = freeze_array("half axes", self.half_axes, (2,))
        powers = freeze_array("powers", self.powers, ())
        angles = freeze_array("angles", self.angles, ())
        check_counts(len(centres), {"half axes": half_axes, "powers": powers, "angles": angles})
        check_half_axes(half_axes)
        check_exponents("powers", powers, POWER_MIN, POWER_MAX, pinched="below")
        super().__post_init__()
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

    def erode(self, clearance: float) -> Duct:
        """Return the duct of all places with at least `clearance` mm to the wall.

        Raises
        ------
        GeometryError
            If what is left is not connected, with the shapes between which it is interrupted and
            the largest clearance there. As each shape is eroded by itself, that happens earlier
            than in the true lumen.
        """
        eroded = super().erode(clearance)
        if self.connected:
            self._check_union(clearance)
        return eroded

    def numbers(self) -> tuple[list[Array], Array]:
        """Return the numbers of each shape, and bounding balls [mm].

        Centre (2), cosine and sine of the angle, half axes (2), power, least radius.
        """
        turn = np.stack([np.cos(self.angles), np.sin(self.angles)], axis=1)
        columns = [self.centres, turn, self.half_axes, self.powers[:, None]]
        rows = np.concatenate([*columns, self.least_radii[:, None]], axis=1)
        reach = self._largest_radii[:, None]
        balls = np.concatenate([self.centres, np.zeros_like(reach), reach], axis=1)
        return list(rows), balls

    @staticmethod
    def move(row: Array, rotation: Array, shift: Array) -> bool:
        """Move the centre, turn the first axis."""
        row[:2] = rotation[:2, :2] @ row[:2] + shift[:2]
        row[2:4] = rotation[:2, :2] @ row[2:4]
        return True

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
        """Raise `GeometryError` if the shapes, each drawn in by itself, are not connected."""
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
        message = describe_split("shape", split)
        if clearance > 0.0:
            a, b = split
            message = (
                f"clearance is {clearance:g} mm: {message}; between shape {a} and shape {b} "
                f"it must be at most {self.measure_seam(a, b):.3g} mm"
            )
        raise GeometryError(message)


EXPONENT_MIN = 0.1
"""Smallest exponent: below it powers overflow, and a corner is round by less than a hundredth."""

EXPONENT_MAX = 2.0
"""Largest exponent: beyond it a shape is pinched, not convex."""


@dataclass(frozen=True, eq=False)
class SuperEllipsoids(ShapeUnion):
    """The union of convex super-ellipsoids.

    Parameters
    ----------
    centres : (n, 3) float
        Of the shapes [mm].
    half_axes : (n, 3) float
        Along each shape's own axes x, y, z [mm].
    e1, e2 : (n,) float
        Exponents in [0.1, 2]: `e2` rounds the section across z, `e1` the profile along it. 1 and
        1 is an ellipsoid, small ones a box, 2 and 2 an octahedron; 0.1 and 1 is nearly a
        cylinder. They are n and e of thesis eq. 5.30.
    rotations : (n, 3, 3) float
        Columns are the shape's axes.
    connected : bool
        Whether shapes that are not all connected are refused.
    inflation, wall, wall_error
        See `DuctShape`.

    Raises
    ------
    InputError
        If a half axis is not positive, an exponent out of range, or a rotation none.
    GeometryError
        If the union is not connected, with the shapes between which it is interrupted.

    Notes
    -----
    With ``y`` a point in a shape's frame, ``G(y) = ((|y1/a|^(2/e2) + |y2/b|^(2/e2))^(e2/e1) +
    |y3/c|^(2/e1))^(e1/2)`` is a norm for exponents up to 2 (thesis eq. 5.30 is ``G - 1``, without
    units). So ``r (G - 1)``, r the least radius of the shape, is 1-Lipschitz, and never more than
    the distance to the shape's wall, on either side: exact for a ball, and at the centre, and less
    elsewhere. `kind` is "bound".
    """

    centres: NDArray[np.float64]
    half_axes: NDArray[np.float64]
    e1: NDArray[np.float64] = field(kw_only=True)
    e2: NDArray[np.float64] = field(kw_only=True)
    rotations: NDArray[np.float64] = field(kw_only=True)
    connected: bool = field(default=True, kw_only=True)
    wall: str = field(default="union of super-ellipsoids", kw_only=True)

    name = "superellipsoids"
    code = 10
    dim = 3
    columns = {
        "centre": ("centres", "lengths"),
        "half_axes": ("half_axes", "lengths"),
        "e1": ("e1", "number"),
        "e2": ("e2", "number"),
        "axes": ("rotations", "axes"),
    }

    def __post_init__(self) -> None:
        centres = freeze_places("centres", self.centres, 3)
        half_axes = freeze_array("half axes", self.half_axes, (3,))
        e1 = freeze_array("e1", self.e1, ())
        e2 = freeze_array("e2", self.e2, ())
        rotations = freeze_array("rotations", self.rotations, (3, 3))
        given = {"half axes": half_axes, "e1": e1, "e2": e2, "rotations": rotations}
        check_counts(len(centres), given)
        check_half_axes(half_axes)
        for name, array in (("e1", e1), ("e2", e2)):
            check_exponents(name, array, EXPONENT_MIN, EXPONENT_MAX, pinched="above")
        for k, rotation in enumerate(rotations):
            check_rotation(f"rotations[{k}]", rotation)
        super().__post_init__()
        set_fields(self, centres=centres, half_axes=half_axes, e1=e1, e2=e2, rotations=rotations)
        if self.connected and len(centres) > 1:
            _check_union(self)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) corners of the smallest box around the union [mm]."""
        a, b, c = np.moveaxis(np.abs(self.half_axes[:, None] * self.rotations), -1, 0)
        flat = dual_norm(a, b, self._powers[0][:, None])
        reach = dual_norm(flat, c, self._powers[1][:, None])
        reach += self.inflation
        return np.stack([(self.centres - reach).min(axis=0), (self.centres + reach).max(axis=0)])

    @property
    def least_radii(self) -> NDArray[np.float64]:
        """(n,) radius of the largest ball inside each shape [mm]."""
        a, b, c = self.half_axes.T
        inner, outer = self._powers
        return least_radius(least_radius(a, b, inner), c, outer)

    @property
    def volumes(self) -> NDArray[np.float64]:
        """(n,) volume of each shape before inflation, overlaps counted twice [mm^3]."""
        from scipy.special import beta

        section = self.e2 * beta(0.5 * self.e2, 0.5 * self.e2)
        profile = 2.0 * self.e1 * beta(0.5 * self.e1 + 1.0, self.e1)
        return np.asarray(self.half_axes.prod(axis=1) * section * profile)

    def evaluate_gauge(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., n) gauge of every shape: 1 on its wall, homogeneous about its centre.

        Less 1 it is the function of thesis eq. 5.30, with absolute values and each shape's frame.
        """
        array = check_places("points", points)
        local = np.einsum("...nj,nji->...ni", array[..., None, :] - self.centres, self.rotations)
        scaled = np.abs(local) / self.half_axes
        inner, outer = self._powers
        flat = join_norm(scaled[..., 0], scaled[..., 1], inner)
        return join_norm(flat, scaled[..., 2], outer)

    @property
    def _powers(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n,) powers of the section across z, and of the profile along it."""
        return 2.0 / self.e2, 2.0 / self.e1

    @property
    def _largest_radii(self) -> NDArray[np.float64]:
        """(n,) radius of the smallest ball about its centre that holds each shape [mm]."""
        a, b, c = self.half_axes.T
        inner, outer = self._powers
        return largest_radius(largest_radius(a, b, inner), c, outer)

    def numbers(self) -> tuple[list[Array], Array]:
        """Return the numbers of each shape, and bounding balls [mm].

        Centre (3), axes as columns of a rotation (9, row by row), half axes (3), both powers,
        least radius.
        """
        flat_axes = self.rotations.reshape(-1, 9)
        powers = np.stack([*self._powers, self.least_radii], axis=1)
        rows = np.concatenate([self.centres, flat_axes, self.half_axes, powers], axis=1)
        balls = np.concatenate([self.centres, self._largest_radii[:, None]], axis=1)
        return list(rows), balls

    @staticmethod
    def move(row: Array, rotation: Array, shift: Array) -> bool:
        """Move the centre, turn the axes."""
        row[:3] = rotation @ row[:3] + shift
        row[3:12] = (rotation @ row[3:12].reshape(3, 3)).reshape(-1)
        return True


def _check_union(duct: SuperEllipsoids) -> None:
    """Raise `GeometryError` if the shapes are not connected."""
    levels = np.ones(len(duct.centres))
    links, gaps = link_gauges(duct.centres, duct.evaluate_gauge(duct.centres), levels)
    reach = duct._largest_radii
    away = np.linalg.norm(duct.centres[:, None] - duct.centres, axis=-1)
    check_connected(
        "shape",
        gaps,
        lambda i, j: _overlap(duct, i, j),
        links=links,
        far=away > reach[:, None] + reach,
    )


def _overlap(duct: SuperEllipsoids, i: int, j: int) -> bool:
    """Whether two shapes meet: the least of the larger of both gauges, a convex problem."""
    from dataclasses import replace

    from scipy.optimize import minimize

    pair = np.array([i, j])
    two = replace(
        duct,
        centres=duct.centres[pair],
        half_axes=duct.half_axes[pair],
        e1=duct.e1[pair],
        e2=duct.e2[pair],
        rotations=duct.rotations[pair],
        connected=False,
    )
    g, h = two.evaluate_gauge(two.centres[1])[0], two.evaluate_gauge(two.centres[0])[1]
    start = two.centres[0] + h / (g + h) * (two.centres[1] - two.centres[0])
    level = float(two.evaluate_gauge(start).max())
    answer = minimize(
        lambda p: p[3],
        [*start, level],
        constraints={"type": "ineq", "fun": lambda p: p[3] - two.evaluate_gauge(p[:3])},
        method="SLSQP",
        options={"maxiter": 200},
    )
    return bool(two.evaluate_gauge(answer.x[:3]).max() <= 1.0)
