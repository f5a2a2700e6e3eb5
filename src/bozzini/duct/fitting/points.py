"""Circles, super-ellipses and super-ellipsoids fitted to points, by least squares of distances."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array, check_number, check_points, check_range
from ...errors import GeometryError, InputError
from ...numeric.arrays import Floats
from ...numeric.least_squares import LeastSquares
from ...numeric.vectors import nearest_rotation
from ..checks import COORDINATE_MAX
from ..shapes.super_ellipses import (
    EXPONENT_MAX,
    EXPONENT_MIN,
    POWER_MAX,
    POWER_MIN,
    SuperEllipses,
    SuperEllipsoids,
    join_norm,
)

FLAT_MM = 1e-9
"""Points that spread across by no more than this lie in a plane, or on a line."""

EXACT = {"xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-14}


@dataclass(frozen=True, kw_only=True, eq=False)
class SuperEllipsoidFit:
    """A super-ellipsoid fitted to points of a wall.

    Attributes
    ----------
    centre, half_axes : (3,) float
        [mm].
    e1, e2 : float
        Exponents.
    rotation : (3, 3) float
        Columns are its axes.
    residual : float
        Root mean square distance of the points from the wall, on rays from the centre [mm].
    """

    centre: Floats
    half_axes: Floats
    e1: float
    e2: float
    rotation: Floats
    residual: float

    def to_duct(self) -> SuperEllipsoids:
        """Return the super-ellipsoid as a duct."""
        return SuperEllipsoids(
            self.centre[None],
            self.half_axes[None],
            e1=np.array([self.e1]),
            e2=np.array([self.e2]),
            rotations=self.rotation[None],
        )


def fit_super_ellipsoid(
    points: ArrayLike,
    *,
    frame: ArrayLike | None = None,
    half_length: float | None = None,
    centre: ArrayLike | None = None,
) -> SuperEllipsoidFit:
    """Fit a super-ellipsoid to points (n, 3) by bounded least squares of radial distances.

    Parameters
    ----------
    points : (n, 3) float
        On the wall [mm].
    frame : (3, 3) float, optional
        Columns are the axes to begin with, the third along the duct; by default the points'
        principal axes, the one of most spread the third.
    half_length : float, optional
        Half axis along the third axis [mm]. A piece of a duct has no ends, so that its wall does
        not determine its length: give it, from the spacing of the pieces. The centre then stays
        where it is along that axis.
    centre : (3,) float, optional
        Where to begin [mm]; by default the mean of the points.

    Raises
    ------
    InputError
        If there are fewer than 11 points, or an argument is not legal.
    GeometryError
        If they lie in a plane.
    """
    from scipy.spatial.transform import Rotation

    array = take_points(points, dim=3, least=11)
    middle, axes, spread = find_axes(array)
    if spread[-1] <= max(1e-9 * spread[0], FLAT_MM):
        raise GeometryError("the points lie in a plane: no super-ellipsoid goes through them")
    axes = axes[:, [1, 2, 0]]
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    base = axes if frame is None else check_points("frame", frame)
    origin = middle if centre is None else check_points("centre", centre)
    if half_length is not None:
        check_number("half length", half_length, low=0.0, low_open=True, unit="mm")
    if base.shape != (3, 3) or np.abs(base.T @ base - np.eye(3)).max() > 1e-9:
        raise InputError("frame must be (3, 3) and orthonormal")
    if np.linalg.det(base) < 0.0:
        raise InputError("frame has determinant -1: it must be right-handed, 1")
    local = (array - origin) @ base
    size = float(np.abs(local).max())
    local = local / size

    def residuals(x: Floats) -> Floats:
        own = (local - x[:3]) @ Rotation.from_rotvec(x[8:11]).as_matrix()
        scaled = np.abs(own) / x[3:6]
        flat = join_norm(scaled[:, 0], scaled[:, 1], 2.0 / x[7])
        return measure_radial(own, join_norm(flat, scaled[:, 2], 2.0 / x[6]))

    low = np.array([-2.0] * 3 + [1e-3] * 3 + [EXPONENT_MIN] * 2 + [-np.pi] * 3)
    high = np.array([2.0] * 3 + [20.0] * 3 + [EXPONENT_MAX] * 2 + [np.pi] * 3)
    reach = np.abs(local).max(axis=0)
    free = np.ones(len(low), dtype=bool)
    exponents = ((1.0, 1.0), (0.4, 0.4))
    if half_length is not None:
        reach[2] = half_length / size
        free[[2, 5]] = False
        exponents = ((0.5, 1.0), (0.5, 0.4))
    starts = [
        np.array([0.0, 0.0, 0.0, *reach, *pair, 0.0, 0.0, turn])
        for turn in (0.0, 0.25 * np.pi)
        for pair in exponents
    ]
    x, residual = _fit_best(residuals, starts, (low, high), free=free, evaluations=100)
    return SuperEllipsoidFit(
        centre=origin + size * (base @ x[:3]),
        half_axes=size * x[3:6],
        e1=float(x[6]),
        e2=float(x[7]),
        rotation=nearest_rotation(base @ Rotation.from_rotvec(x[8:11]).as_matrix()),
        residual=size * residual,
    )


def _fit_best(
    residuals: Callable[[Floats], Floats],
    starts: Sequence[Floats],
    bounds: tuple[Floats, Floats],
    *,
    free: NDArray[np.bool_],
    evaluations: int,
) -> tuple[Floats, float]:
    """Return the best bounded fit from several starts, and its root mean square; `free` moves."""
    full = starts[0].copy()

    def ask(x: Floats) -> Floats:
        full[free] = x
        return residuals(full)

    search = LeastSquares(
        misfit=ask, bounds=(bounds[0][free], bounds[1][free]), scale="jac",
        xtol=EXACT["xtol"], ftol=EXACT["ftol"], gtol=EXACT["gtol"],
    )  # fmt: skip
    best = search.search(
        [start[free] for start in starts],
        evaluations=evaluations,
        enough=lambda end: end.cost < 1e-20,
    )
    return full, float(np.sqrt(np.mean(ask(best.point) ** 2)))


def take_points(points: ArrayLike, *, dim: int, least: int) -> Floats:
    """Return at least so many points (n, dim), or raise `InputError`."""
    array = check_points("points", points, dim=dim)
    if array.ndim != 2 or len(array) < least:
        raise InputError(
            f"points has shape {array.shape}: it must be (n, {dim}) with n at least {least}"
        )
    check_range("points", array, -COORDINATE_MAX, COORDINATE_MAX, "mm")
    return array


def find_axes(
    points: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Return the mean, the principal axes as columns, and the spreads, most first."""
    middle = points.mean(axis=0)
    _, spread, rows = np.linalg.svd(points - middle, full_matrices=False)
    return middle, rows.T.copy(), spread


def measure_radial(local: Floats, gauge: Floats) -> Floats:
    """Return how far points (n, dim) lie outside a wall, on rays from its centre [mm]."""
    away = np.linalg.norm(local, axis=1)
    safe = np.where(gauge > 0.0, gauge, 1.0)
    # At the centre the wall is as far as along any ray: the mean is as good.
    return np.asarray(np.where(gauge > 0.0, away * (1.0 - 1.0 / safe), -1.0))


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

    centre: Floats
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

    centre: Floats
    half_axes: Floats
    power: float
    angle: float
    residual: float

    def to_duct(self) -> SuperEllipses:
        """Return the super-ellipse as a duct."""
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
    if size <= FLAT_MM:
        raise GeometryError("the points are all at one place: no circle goes through them")
    table = np.concatenate([2.0 * flat / size, np.ones((len(flat), 1))], axis=1)
    if np.linalg.svd(table[:, :2], compute_uv=False)[-1] < 1e-9 * len(flat) ** 0.5:
        raise GeometryError("the points lie on a line: no circle goes through them")
    square = (flat**2).sum(axis=1) / size**2
    answer = np.linalg.lstsq(root[:, None] * table, root * square, rcond=None)[0]
    radius = np.sqrt(answer[2] + answer[0] ** 2 + answer[1] ** 2)

    def residuals(x: Floats) -> Floats:
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
        residual=size * float(np.sqrt(np.mean(found.fun**2))),
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
    array = take_points(points, dim=2, least=6)
    middle, axes, spread = find_axes(array)
    if spread[-1] <= max(1e-9 * spread[0], FLAT_MM):
        raise GeometryError("the points lie on a line: no super-ellipse goes through them")
    start = float(np.arctan2(axes[1, 0], axes[0, 0]))
    size = float(np.abs(array - middle).max())
    flat = (array - middle) / size

    def residuals(x: Floats) -> Floats:
        cosine, sine = np.cos(x[5]), np.sin(x[5])
        local = (flat - x[:2]) @ np.array([[cosine, -sine], [sine, cosine]])
        gauge = join_norm(np.abs(local[:, 0]) / x[2], np.abs(local[:, 1]) / x[3], x[4])
        return measure_radial(local, gauge)

    starts = []
    for angle in (start, start + 0.25 * np.pi):
        turned = flat @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        reach = np.abs(turned).max(axis=0)
        starts += [np.array([0.0, 0.0, *reach, power, angle]) for power in (2.0, 5.0)]
    low = np.array([-2.0, -2.0, 1e-6, 1e-6, POWER_MIN, start - np.pi])
    high = np.array([2.0, 2.0, 20.0, 20.0, POWER_MAX, start + 1.25 * np.pi])
    free = np.ones(len(low), dtype=bool)
    x, residual = _fit_best(residuals, starts, (low, high), free=free, evaluations=600)
    return SuperEllipseFit(
        centre=middle + size * x[:2],
        half_axes=size * x[2:4],
        power=float(x[4]),
        angle=(float(x[5]) + 0.5 * np.pi) % np.pi - 0.5 * np.pi,
        residual=size * residual,
    )
