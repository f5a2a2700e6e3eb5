"""Unions of super-ellipsoids (thesis 5.3.3.1), with a metric distance in place of eq. 5.30."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ._overlap import check_connected, link_gauges
from ._power_norms import dual_norm, join_norm, largest_radius, least_radius
from ._shape_checks import (
    check_counts,
    check_exponents,
    check_half_axes,
    check_places,
    check_rotation,
    check_wall,
    freeze_array,
    freeze_places,
    set_fields,
)
from ._shape_union import ShapeUnion, Slices

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["SuperEllipsoids"]

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
        check_wall(self.inflation, self.wall_error)
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

    def _slice(self) -> Slices:
        from ._family_kernels import SUPER_ELLIPSOID

        flat_axes = self.rotations.reshape(-1, 9)
        powers = np.stack([*self._powers, self.least_radii], axis=1)
        rows = np.concatenate([self.centres, flat_axes, self.half_axes, powers], axis=1)
        balls = np.concatenate([self.centres, self._largest_radii[:, None]], axis=1)
        return Slices(SUPER_ELLIPSOID, list(rows), balls)


def _check_union(duct: SuperEllipsoids) -> None:
    """Raise `GeometryError` if the shapes do not hang together."""
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
