"""Unions of super-ellipsoids (thesis 5.3.3.1), with a metric distance in place of eq. 5.30."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import InputError
from ._analytic import freeze_array
from ._solids import Slices, SolidShapes, check_connected

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["SuperEllipsoids"]

EXPONENT_MIN = 0.1
"""Smallest exponent: below it powers overflow, and a corner is round by less than a hundredth."""

EXPONENT_MAX = 2.0
"""Largest exponent: beyond it a shape is pinched, not convex."""


@dataclass(frozen=True, eq=False)
class SuperEllipsoids(SolidShapes):
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
    inflation : float
        The wall is moved outwards by this much [mm].
    connected : bool
        Whether shapes that do not all hang together are refused.
    wall : str
        What the wall is, in words.
    wall_error : float
        How far the true wall may be from the stated one [mm].

    Raises
    ------
    InputError
        If a half axis is not positive, an exponent out of range, or a rotation none.
    GeometryError
        If the union falls apart, with the shapes between which it does.

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
    inflation: float = field(default=0.0, kw_only=True)
    connected: bool = field(default=True, kw_only=True)
    wall: str = field(default="union of super-ellipsoids", kw_only=True)
    wall_error: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        centres = freeze_array("centres", self.centres, (3,))
        half_axes = freeze_array("half axes", self.half_axes, (3,))
        e1 = freeze_array("e1", self.e1, ())
        e2 = freeze_array("e2", self.e2, ())
        rotations = freeze_array("rotations", self.rotations, (3, 3))
        for name, array in (
            ("half axes", half_axes),
            ("e1", e1),
            ("e2", e2),
            ("rotations", rotations),
        ):
            if len(array) != len(centres):
                raise InputError(
                    f"{name} has {len(array)} value(s): it must have one per centre, {len(centres)}"
                )
        for k, axes in enumerate(half_axes):
            if axes.min() <= 0.0:
                raise InputError(
                    f"half axes[{k}] is {axes.tolist()} mm: each must lie in (0, inf) mm"
                )
        for name, array in (("e1", e1), ("e2", e2)):
            bad = (array < EXPONENT_MIN) | (array > EXPONENT_MAX)
            if bad.any():
                k = int(np.argmax(bad))
                why = ", the shape would not be convex" if array[k] > EXPONENT_MAX else ""
                raise InputError(
                    f"{name}[{k}] is {array[k]:g}: it must lie in "
                    f"[{EXPONENT_MIN:g}, {EXPONENT_MAX:g}]{why}"
                )
        for k, rotation in enumerate(rotations):
            off = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
            if off > 1e-9 or np.linalg.det(rotation) < 0.0:
                raise InputError(
                    f"rotations[{k}] is no rotation: it must be orthonormal within 1e-9 (it is "
                    f"off by {off:.2g}) and right-handed"
                )
        check_number("inflation", self.inflation, low=0.0, unit="mm")
        check_number("wall error", self.wall_error, low=0.0, unit="mm")
        for name, array in (("centres", centres), ("half_axes", half_axes)):
            object.__setattr__(self, name, array)
        for name, array in (("e1", e1), ("e2", e2), ("rotations", rotations)):
            object.__setattr__(self, name, array)
        if self.connected and len(centres) > 1:
            _check_union(self)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) corners of the smallest box around the union [mm]."""
        reach = np.array(
            [[_support(self, k, axis) for axis in np.eye(3)] for k in range(len(self.centres))]
        )
        reach += self.inflation
        return np.stack([(self.centres - reach).min(axis=0), (self.centres + reach).max(axis=0)])

    @property
    def least_radii(self) -> NDArray[np.float64]:
        """(n,) radius of the largest ball inside each shape [mm]."""
        radii = [
            _least(_least(a, b, 2.0 / e2), c, 2.0 / e1)
            for (a, b, c), e1, e2 in zip(self.half_axes.tolist(), self.e1, self.e2, strict=True)
        ]
        return np.array(radii)

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
        from ..checks import check_points

        array = check_points("points", points)
        local = np.einsum("...nj,nji->...ni", array[..., None, :] - self.centres, self.rotations)
        scaled = np.abs(local) / self.half_axes
        flat = _join(scaled[..., 0], scaled[..., 1], 2.0 / self.e2)
        return _join(flat, scaled[..., 2], 2.0 / self.e1)

    def _slice(self) -> Slices:
        from ._family_kernels import SUPER_ELLIPSOID

        least = self.least_radii
        numbers = [
            np.concatenate(
                [
                    self.centres[k],
                    self.rotations[k].reshape(-1),
                    self.half_axes[k],
                    [2.0 / self.e2[k], 2.0 / self.e1[k], least[k]],
                ]
            )
            for k in range(len(self.centres))
        ]
        reach = [
            _most(_most(a, b, 2.0 / e2), c, 2.0 / e1)
            for (a, b, c), e1, e2 in zip(self.half_axes.tolist(), self.e1, self.e2, strict=True)
        ]
        return Slices(
            SUPER_ELLIPSOID, numbers, np.concatenate([self.centres, np.array(reach)[:, None]], 1)
        )


def _join(
    a: NDArray[np.float64], b: NDArray[np.float64], power: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(a^p + b^p)^(1/p), without overflow."""
    big = np.maximum(a, b)
    ratio = np.minimum(a, b) / np.where(big > 0.0, big, 1.0)
    return np.asarray(big * (1.0 + ratio**power) ** (1.0 / power))


def _least(a: float, b: float, power: float) -> float:
    """Least radius of |x/a|^p + |y/b|^p = 1, p >= 1 (Hoelder's inequality)."""
    small, big = min(a, b), max(a, b)
    if power >= 2.0:
        return small
    q = 2.0 * power / (2.0 - power)
    return float(small * (1.0 + (small / big) ** q) ** (-1.0 / q))


def _most(a: float, b: float, power: float) -> float:
    """Largest radius of the same."""
    small, big = min(a, b), max(a, b)
    if power <= 2.0:
        return big
    q = 2.0 * power / (power - 2.0)
    return float(big * (1.0 + (small / big) ** q) ** (1.0 / q))


def _support(duct: SuperEllipsoids, k: int, direction: NDArray[np.float64]) -> float:
    """How far shape k reaches from its centre along a direction: the dual norm."""
    a, b, c = np.abs(duct.half_axes[k] * (direction @ duct.rotations[k])).tolist()
    flat = _dual(a, b, 2.0 / float(duct.e2[k]))
    return _dual(flat, c, 2.0 / float(duct.e1[k]))


def _dual(a: float, b: float, power: float) -> float:
    if power <= 1.0 + 1e-9:
        return max(a, b)
    big = max(a, b)
    q = power / (power - 1.0)
    return float(big * (1.0 + (min(a, b) / big) ** q) ** (1.0 / q)) if big > 0.0 else 0.0


def _check_union(duct: SuperEllipsoids) -> None:
    """Raise `GeometryError` if the shapes do not hang together."""
    count = len(duct.centres)
    gauge = duct.evaluate_gauge(duct.centres)  # [i, k]: centre i in shape k
    away = np.linalg.norm(duct.centres[:, None] - duct.centres[None], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        # On the line between the centres both gauges are equal at g h / (g + h).
        between = np.where(away > 0.0, gauge * gauge.T / (gauge + gauge.T), 0.0)
        reach = np.where(gauge > 0.0, away / gauge, np.inf)
    links = between <= 1.0
    gaps = away - reach - reach.T
    balls = np.array(duct._slice().balls)
    near = away <= balls[:, 3][:, None] + balls[:, 3][None]
    if not links[np.arange(count - 1), np.arange(1, count)].all():
        for i, j in np.argwhere(np.triu(near & ~links, 1)):
            links[i, j] = links[j, i] = _overlap(duct, int(i), int(j))
    np.fill_diagonal(links, True)
    check_connected("shape", links, np.where(links, np.inf, gaps))


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
