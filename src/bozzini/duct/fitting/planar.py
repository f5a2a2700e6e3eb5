"""Circles and super-ellipses fitted to points in a plane, by least squares of distances in mm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array
from ...errors import GeometryError, InputError
from .points import (
    EXACT,
    FLAT,
    find_axes,
    join_powers,
    mean_square_root,
    measure_radial,
    take_points,
)

if TYPE_CHECKING:
    from ..shapes.super_ellipses import SuperEllipses

POWER_RANGE = (1.0, 20.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class CircleFit:
    """A circle in a plane, fitted to points.

    Attributes
    ----------
    centre : (2,) float
        [mm].
    radius : float
        [mm].
    residual : float
        Root mean square distance of the points from the circle, weighted [mm].
    """

    centre: NDArray[np.float64]
    radius: float
    residual: float


@dataclass(frozen=True, kw_only=True, eq=False)
class SuperEllipseFit:
    """A super-ellipse fitted to points in a plane.

    Attributes
    ----------
    centre, half_axes : (2,) float
        [mm].
    power, angle : float
        Power; angle of the first axis [rad], in [-pi/2, pi/2).
    residual : float
        Root mean square distance of the points from the curve, on rays from the centre [mm].
    """

    centre: NDArray[np.float64]
    half_axes: NDArray[np.float64]
    power: float
    angle: float
    residual: float

    def to_duct(self) -> SuperEllipses:
        """Return the super-ellipse as a duct."""
        from ..shapes.super_ellipses import SuperEllipses

        return SuperEllipses(
            self.centre[None],
            self.half_axes[None],
            powers=np.array([self.power]),
            angles=np.array([self.angle]),
        )


def fit_circle(
    points: ArrayLike, *, weights: ArrayLike | None = None, around: bool = False
) -> CircleFit:
    """Fit a circle to points (n, 2) by least squares of distances.

    The algebraic fit (Kasa's), which is biased towards small circles on short arcs, is only where
    the search begins.

    Parameters
    ----------
    points : (n, 2) float
        [mm].
    weights : (n,) float, optional
        How much each counts, positive: the length of wall that it stands for.
    around : bool
        The points go all around: keep the centre in their box. Without that, a slit is fitted
        best by a circle so large that it is nearly a line.

    Raises
    ------
    InputError
        If there are fewer than 3 points, or a weight is not positive.
    GeometryError
        If they lie on a line.
    """
    from scipy.optimize import least_squares

    array = take_points(points, dim=2, least=3)
    share = np.ones(len(array)) if weights is None else check_array("weights", weights)
    if share.shape != (len(array),) or not (np.isfinite(share).all() and share.min() > 0.0):
        raise InputError(
            f"weights have shape {share.shape}: they must be ({len(array)},), positive and finite"
        )
    root = np.sqrt(share / share.mean())
    middle = array.mean(axis=0)
    flat = array - middle
    size = float(np.abs(flat).max())
    if size <= FLAT:
        raise GeometryError("the points are all at one place: no circle goes through them")
    table = np.concatenate([2.0 * flat / size, np.ones((len(flat), 1))], axis=1)
    if np.linalg.svd(table[:, :2], compute_uv=False)[-1] < 1e-9 * len(flat) ** 0.5:
        raise GeometryError("the points lie on a line: no circle goes through them")
    square = (flat**2).sum(axis=1) / size**2
    answer = np.linalg.lstsq(root[:, None] * table, root * square, rcond=None)[0]
    radius = np.sqrt(answer[2] + answer[0] ** 2 + answer[1] ** 2)

    def residuals(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(root * (np.hypot(*(flat / size - x[:2]).T) - x[2]))

    start = np.array([answer[0], answer[1], radius])
    if around:
        low, high = flat.min(axis=0) / size, flat.max(axis=0) / size
        limits = np.append(low, 0.0), np.append(high, float(np.linalg.norm(high - low)))
        start = np.clip(start, 0.99 * limits[0], 0.99 * limits[1])
        found = least_squares(residuals, start, bounds=limits, **EXACT)
    else:
        found = least_squares(residuals, start, method="lm", **EXACT)
    return CircleFit(
        centre=middle + size * found.x[:2],
        radius=abs(size * float(found.x[2])),
        residual=size * mean_square_root(found.fun),
    )


def fit_super_ellipse(points: ArrayLike) -> SuperEllipseFit:
    """Fit a super-ellipse to points (n, 2) by bounded least squares of radial distances.

    The residual of a point is how far it is from the curve along the ray from the centre,
    ``|y| (1 - 1/G)`` with the gauge G. The power lies in [1, 20]. The search begins at the
    points' principal axes and at 45 deg to them.

    Raises
    ------
    InputError
        If there are fewer than 6 points.
    GeometryError
        If they lie on a line.
    """
    from scipy.optimize import least_squares

    array = take_points(points, dim=2, least=6)
    middle, axes, spread = find_axes(array)
    if spread[-1] <= max(1e-9 * spread[0], FLAT):
        raise GeometryError("the points lie on a line: no super-ellipse goes through them")
    start = float(np.arctan2(axes[1, 0], axes[0, 0]))
    size = float(np.abs(array - middle).max())
    flat = (array - middle) / size

    def residuals(x: NDArray[np.float64]) -> NDArray[np.float64]:
        cosine, sine = np.cos(x[5]), np.sin(x[5])
        local = (flat - x[:2]) @ np.array([[cosine, -sine], [sine, cosine]])
        gauge = join_powers(np.abs(local[:, 0]) / x[2], np.abs(local[:, 1]) / x[3], x[4])
        return measure_radial(local, gauge)

    best: Any = None
    for angle in (start, start + 0.25 * np.pi):
        turned = flat @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        reach = np.abs(turned).max(axis=0)
        for power in (2.0, 5.0):
            found = least_squares(
                residuals,
                [0.0, 0.0, *reach, power, angle],
                bounds=(
                    [-2.0, -2.0, 1e-6, 1e-6, POWER_RANGE[0], angle - np.pi],
                    [2.0, 2.0, 20.0, 20.0, POWER_RANGE[1], angle + np.pi],
                ),
                x_scale="jac",
                **EXACT,
            )
            if best is None or found.cost < best.cost:
                best = found
    half, turn = best.x[2:4], float(best.x[5])
    return SuperEllipseFit(
        centre=middle + size * best.x[:2],
        half_axes=size * half,
        power=float(best.x[4]),
        angle=(turn + 0.5 * np.pi) % np.pi - 0.5 * np.pi,
        residual=size * mean_square_root(best.fun),
    )
