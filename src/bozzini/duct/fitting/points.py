"""A super-ellipsoid fitted to points of a wall, by least squares of distances in mm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_number, check_points, check_range
from ...errors import GeometryError, InputError

if TYPE_CHECKING:
    from ..shapes.super_ellipses import SuperEllipsoids

FLAT = 1e-9
"""Points that spread across by no more than this lie in a plane, or on a line [mm]."""

REACH = 1e6
"""No coordinate of a point is beyond this [mm]."""

EXPONENT_RANGE = (0.1, 2.0)
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
        from ..shapes.super_ellipses import SuperEllipsoids

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
        flat = join_powers(scaled[:, 0], scaled[:, 1], 2.0 / e2)
        return measure_radial(own, join_powers(flat, scaled[:, 2], 2.0 / e1))

    low = [-2.0] * 3 + [1e-3] * 3 + [EXPONENT_RANGE[0]] * 2 + [-np.pi] * 3
    high = [2.0] * 3 + [20.0] * 3 + [EXPONENT_RANGE[1]] * 2 + [np.pi] * 3
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


def join_powers(
    a: NDArray[np.float64], b: NDArray[np.float64], power: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    """Return (a^p + b^p)^(1/p), without overflow."""
    big = np.maximum(a, b)
    ratio = np.minimum(a, b) / np.where(big > 0.0, big, 1.0)
    return np.asarray(big * (1.0 + ratio**power) ** (1.0 / power))


def measure_radial(local: NDArray[np.float64], gauge: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far points (n, dim) lie outside a wall, on rays from its centre [mm]."""
    away = np.linalg.norm(local, axis=1)
    safe = np.where(gauge > 0.0, gauge, 1.0)
    # At the centre the wall is as far as along any ray: the mean is as good.
    return np.asarray(np.where(gauge > 0.0, away * (1.0 - 1.0 / safe), -1.0))


def mean_square_root(values: NDArray[np.float64]) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
