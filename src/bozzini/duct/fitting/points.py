"""Circles, super-ellipses and super-ellipsoids fitted to points, by least squares of distances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array, check_number, check_points, check_range
from ...errors import GeometryError, InputError
from ..shapes.super_ellipses import (
    EXPONENT_MAX,
    EXPONENT_MIN,
    POWER_MAX,
    POWER_MIN,
    SuperEllipses,
    SuperEllipsoids,
    join_norm,
)

FLAT = 1e-9
"""Points that spread across by no more than this lie in a plane, or on a line [mm]."""

REACH = 1e6
"""No coordinate of a point is beyond this [mm]."""

EXACT: dict[str, Any] = {"xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-14}


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

    centre: NDArray[np.float64]
    half_axes: NDArray[np.float64]
    e1: float
    e2: float
    rotation: NDArray[np.float64]
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
        Half axis along the third axis [mm]. A piece of a duct has no ends, so that its length is
        not told by its wall: give it, from the spacing of the pieces. The centre then stays where
        it is along that axis.
    centre : (3,) float, optional
        Where to begin [mm]; by default the mean of the points.

    Raises
    ------
    InputError
        If there are fewer than 11 points, or an argument is not legal.
    GeometryError
        If they lie in a plane.
    """
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    array = take_points(points, dim=3, least=11)
    middle, axes, spread = find_axes(array)
    if spread[-1] <= max(1e-9 * spread[0], FLAT):
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
    fixed = None if half_length is None else half_length / size

    def split(x: NDArray[np.float64]) -> tuple[Any, ...]:
        shift = np.array([x[0], x[1], x[2] if fixed is None else 0.0])
        half = np.array([x[3], x[4], x[5] if fixed is None else fixed])
        return shift, half, x[6], x[7], Rotation.from_rotvec(x[8:11]).as_matrix()

    def residuals(x: NDArray[np.float64]) -> NDArray[np.float64]:
        shift, half, e1, e2, turn = split(x)
        own = (local - shift) @ turn
        scaled = np.abs(own) / half
        flat = join_norm(scaled[:, 0], scaled[:, 1], 2.0 / e2)
        return measure_radial(own, join_norm(flat, scaled[:, 2], 2.0 / e1))

    low = [-2.0] * 3 + [1e-3] * 3 + [EXPONENT_MIN] * 2 + [-np.pi] * 3
    high = [2.0] * 3 + [20.0] * 3 + [EXPONENT_MAX] * 2 + [np.pi] * 3
    reach = np.abs(local).max(axis=0)
    if fixed is not None:
        reach[2] = 1.0
    found = _search(residuals, reach, low, high, least_squares, along=fixed is not None)
    shift, half, e1, e2, turn = split(found.x)
    return SuperEllipsoidFit(
        centre=origin + size * (base @ shift),
        half_axes=size * half,
        e1=float(e1),
        e2=float(e2),
        rotation=_square(base @ turn),
        residual=size * mean_square_root(found.fun),
    )


def _search(
    residuals: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    reach: NDArray[np.float64],
    low: list[float],
    high: list[float],
    least_squares: Any,
    *,
    along: bool,
) -> Any:
    best: Any = None
    for turn in (0.0, 0.25 * np.pi):
        for e1, e2 in ((1.0, 1.0), (0.4, 0.4)) if not along else ((0.5, 1.0), (0.5, 0.4)):
            start = [0.0, 0.0, 0.0, *reach, e1, e2, 0.0, 0.0, turn]
            found = least_squares(
                residuals, start, bounds=(low, high), x_scale="jac", max_nfev=100, **EXACT
            )
            if best is None or found.cost < best.cost:
                best = found
            if best.cost < 1e-20:
                return best
    return best


def take_points(points: ArrayLike, *, dim: int, least: int) -> NDArray[np.float64]:
    """Return at least so many points (n, dim), or raise `InputError`."""
    array = check_points("points", points, dim=dim)
    if array.ndim != 2 or len(array) < least:
        raise InputError(
            f"points has shape {array.shape}: it must be (n, {dim}) with n at least {least}"
        )
    check_range("points", array, -REACH, REACH, "mm")
    return array


def find_axes(
    points: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean, the principal axes as columns, and the spreads, most first."""
    middle = points.mean(axis=0)
    _, spread, rows = np.linalg.svd(points - middle, full_matrices=False)
    return middle, rows.T.copy(), spread


def _square(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation nearest to a matrix that is one but for rounding."""
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ right)


def measure_radial(local: NDArray[np.float64], gauge: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far points (n, dim) lie outside a wall, on rays from its centre [mm]."""
    away = np.linalg.norm(local, axis=1)
    safe = np.where(gauge > 0.0, gauge, 1.0)
    # At the centre the wall is as far as along any ray: the mean is as good.
    return np.asarray(np.where(gauge > 0.0, away * (1.0 - 1.0 / safe), -1.0))


def mean_square_root(values: NDArray[np.float64]) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


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
        gauge = join_norm(np.abs(local[:, 0]) / x[2], np.abs(local[:, 1]) / x[3], x[4])
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
                    [-2.0, -2.0, 1e-6, 1e-6, POWER_MIN, angle - np.pi],
                    [2.0, 2.0, 20.0, 20.0, POWER_MAX, angle + np.pi],
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
