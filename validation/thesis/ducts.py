"""The thesis's constraint functions for planar ducts as printed, and as they should read.

Here for comparison: none is a distance, so planners use the ducts of `bozzini.duct`. Each function
has the number of its equation (thesis 5.3.1-5.3.2 and Appendix A) in its name; ``_printed`` marks a
form that is not right as printed, and its docstring explains why. Values below zero mean inside,
unless stated otherwise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bozzini.checks import check_array, check_number
from bozzini.duct.checks import check_half_axes, check_places, check_rotation, check_size
from bozzini.duct.shapes.quads import invert_quads
from bozzini.errors import GeometryError, InputError

Array = NDArray[np.float64]


def circle_5_14(points: ArrayLike, centre: ArrayLike, radius: float) -> Array:
    """Return ``|x - c|^2 - r^2`` [mm^2] at points (..., 2): above zero outside the obstacle.

    An area: the same value is far from a small circle and near a large one. `Circles` answers
    ``|x - c| - r``.
    """
    check_size("radius", radius)
    away = _points(points) - _point("centre", centre)
    return np.asarray(np.sum(away * away, axis=-1) - radius**2)


def super_ellipse_5_16(
    points: ArrayLike, centre: ArrayLike, half_axes: ArrayLike, power: float
) -> Array:
    """Return ``|(x - xc) / a|^n + |(y - yc) / b|^n - 1`` at points (..., 2), without a unit."""
    check_number("power", power, low=0.0, low_open=True)
    sides = _point("half axes", half_axes)
    check_half_axes(sides[None])
    scaled = np.abs(_points(points) - _point("centre", centre)) / sides
    return np.asarray(np.sum(scaled**power, axis=-1) - 1.0)


def frame_5_17(angle: float, centre: ArrayLike) -> Array:
    """Return the (4, 4) matrix T that takes a shape's coordinates to the world's."""
    check_number("angle", angle, unit="rad")
    x, y = _point("centre", centre)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0, x], [s, c, 0.0, y], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def to_shape_printed(points: ArrayLike, frame: ArrayLike) -> Array:
    """Return ``T^T [x, y, 0, 1]`` (..., 4) as the text has it: the centre is never taken off.

    The transpose of a frame is not its inverse; the fourth slot is no longer 1.
    """
    return _lift(points) @ _frame(frame)


def to_shape(points: ArrayLike, frame: ArrayLike) -> Array:
    """Return ``T^-1 [x, y, 0, 1]`` (..., 4). In eq. 5.16 the centre is then zero."""
    return np.asarray(_lift(points) @ np.linalg.inv(_frame(frame)).T)


def minimum_5_18(values: ArrayLike) -> Array:
    """Return the least of the values (..., m) of all shapes: inside the union where negative.

    The sign is right; the values of different shapes cannot be compared, nor can clearance.
    """
    array = check_array("values", values)
    if array.ndim == 0 or array.shape[-1] == 0:
        raise InputError(f"values have shape {array.shape}: they must be (..., m), m at least 1")
    return np.asarray(np.min(array, axis=-1))


def half_planes_5_20(points: ArrayLike, left: ArrayLike, right: ArrayLike) -> Array:
    """Return ``A x + B`` (..., m, 4) of the sides of quads, with unit normals outwards [mm].

    A point is in a quad where all four are negative, in the duct where that holds for one quad.
    """
    p, q = _sides(left, right)
    corners = np.stack([p[:-1], p[1:], q[1:], q[:-1]], axis=1)
    middle = corners.mean(axis=1, keepdims=True)
    along = np.roll(corners, -1, axis=1) - corners
    normals = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    sizes = np.linalg.norm(normals, axis=-1, keepdims=True)
    if sizes.min() == 0.0:
        raise GeometryError(f"quad {int(np.argmin(sizes)) // 4} has a side without length")
    normals /= sizes
    side = np.sign(np.sum(normals * (corners - middle), axis=-1, keepdims=True))
    if np.any(side == 0.0):
        raise GeometryError(f"quad {int(np.argmin(np.abs(side))) // 4} has no area beside a side")
    normals *= side
    away = _points(points)[..., None, None, :] - corners
    return np.asarray(np.sum(away * normals, axis=-1))


def quad_5_21_printed(left: ArrayLike, right: ArrayLike, u: ArrayLike, v: ArrayLike) -> Array:
    """Return eq. 5.21 of one quad (2, 2), (2, 2) as printed: its weights sum to 2 - u."""
    p, q = _sides(left, right)
    s, t = (np.asarray(a, dtype=np.float64)[..., None] for a in (u, v))
    return np.asarray((p[0] + (1.0 - s) * p[1]) * (1.0 - t) + (q[0] + (1.0 - s) * q[1]) * t)


def quad_5_21(left: ArrayLike, right: ArrayLike, u: ArrayLike, v: ArrayLike) -> Array:
    """Return the point (..., 2) of a quad at u and v, with weights that sum to 1.

    u is 1 at the first rung, as the printed form has it; `StitchedQuads` counts s = 1 - u.
    """
    p, q = _sides(left, right)
    s, t = (np.asarray(a, dtype=np.float64)[..., None] for a in (u, v))
    return np.asarray((s * p[0] + (1.0 - s) * p[1]) * (1.0 - t) + (s * q[0] + (1.0 - s) * q[1]) * t)


def membership_5_22(u: ArrayLike, v: ArrayLike) -> NDArray[np.bool_]:
    """Return whether ``0 <= u <= 1`` and ``0 < v < 1``: closed along, open across."""
    a, b = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
    return np.asarray((a >= 0.0) & (a <= 1.0) & (b > 0.0) & (b < 1.0))


def step_5_24(t: ArrayLike) -> Array:
    """Return chi: 1 for 0 <= t <= 1, else 0. That is H(t) - H(t - 1), not H(0) - H(1)."""
    array = np.asarray(t, dtype=np.float64)
    return np.where((array >= 0.0) & (array <= 1.0), 1.0, 0.0)


def quad_values_5_23(points: ArrayLike, left: ArrayLike, right: ArrayLike) -> tuple[Array, Array]:
    """Return (u, h), each (..., m): eq. 5.23 in every quad at the solution of eq. 5.21.

    Of two real solutions that with the least ``max(|u - 1/2|, |v - 1/2|)`` counts; where they are
    complex u and h are not numbers. As the point lies on the chord between both walls,
    ``h = -2 D^2 v (1 - v)`` with D the chord's length [mm^2]: below zero for 0 < v < 1, also
    outside the quad along u.
    """
    p, q = _sides(left, right)
    array = _points(points)
    s, v, _ = invert_quads(p, q, array.reshape(-1, 2))
    real = (s.imag == 0.0) & (v.imag == 0.0) & np.isfinite(s.real) & np.isfinite(v.real)
    off = np.where(real, np.maximum(np.abs(s.real - 0.5), np.abs(v.real - 0.5)), np.inf)
    pick = off.argmin(axis=-1)[..., None]
    known = np.take_along_axis(real, pick, axis=-1)[..., 0]
    along = np.take_along_axis(s.real, pick, axis=-1)[..., 0]
    a = np.where(known, along, 0.0)[..., None]
    one = (1.0 - a) * p[:-1] + a * p[1:]
    two = (1.0 - a) * q[:-1] + a * q[1:]
    x = array.reshape(-1, 1, 2)
    squares = [np.sum(d * d, axis=-1) for d in (one - x, two - x, one - two)]
    h = squares[0] + squares[1] - squares[2]
    shape = (*array.shape[:-1], len(p) - 1)
    u = np.where(known, 1.0 - along, np.nan)
    return u.reshape(shape), np.where(known, h, np.nan).reshape(shape)


def quads_5_25_printed(points: ArrayLike, left: ArrayLike, right: ArrayLike) -> Array:
    """Return ``sum chi(u_i) h_i`` (...) [mm^2] as printed.

    Another quad's strip, extended across, adds a positive h: points well inside are rejected.
    """
    u, h = quad_values_5_23(points, left, right)
    chi = step_5_24(np.nan_to_num(u, nan=-1.0))
    return np.asarray(np.sum(chi * np.nan_to_num(h), axis=-1))


def quads_5_25(points: ArrayLike, left: ArrayLike, right: ArrayLike) -> Array:
    """Return ``min chi(u_i) h_i`` (...) [mm^2]: below zero just where a point is in a quad."""
    u, h = quad_values_5_23(points, left, right)
    chi = step_5_24(np.nan_to_num(u, nan=-1.0))
    return np.asarray(np.min(chi * np.nan_to_num(h), axis=-1))


def solve_6_1_printed(
    point: ArrayLike, left: ArrayLike, right: ArrayLike
) -> NDArray[np.complex128]:
    """Return both (u, v), (2, 2) complex, of eq. 6.1 as printed.

    ``x - xP + v`` should be ``x - xP + v b1``. Appendix A's u runs across and its v along, unlike
    eq. 5.21.
    """
    a, b = _coefficients(point, left, right)
    v = _solve_v(a, b)
    return np.stack([(b[0] + v) / (a[2] + v * a[3]), v], axis=1)


def solve_6_1(point: ArrayLike, left: ArrayLike, right: ArrayLike) -> NDArray[np.complex128]:
    """Return both (u, v), (2, 2) complex: u across, v along; only one where k3 is zero.

    Where ``a2 + v a3`` vanishes, u is taken from the other row.
    """
    a, b = _coefficients(point, left, right)
    v = _solve_v(a, b)
    top, low = b[0] + v * b[1], a[2] + v * a[3]
    other, under = a[0] + v * a[1], b[2] + v * b[3]
    first = np.abs(low) >= np.abs(under)
    u = np.where(first, top, other) / np.where(first, low, under)
    return np.stack([u, v], axis=1)


def solve_6_2_printed(point: ArrayLike, left: ArrayLike, right: ArrayLike) -> Array:
    """Return (u, v) of eq. 6.2 as printed; v's numerator adds a length to an area."""
    a, b = _coefficients(point, left, right)
    low = a[1] * (b[0] - a[2]) + b[0] * (b[3] - b[2])
    return np.array([b[0] / a[2], (a[0] * a[2] - (a[3] + a[2])) / low])


def solve_6_2(point: ArrayLike, left: ArrayLike, right: ArrayLike) -> Array:
    """Return (u, v) where both walls are parallel to y (b1 = a3 = 0)."""
    a, b = _coefficients(point, left, right)
    if abs(b[1]) > 0.0 or abs(a[3]) > 0.0:
        raise InputError(
            f"b1 is {b[1]:g} mm and a3 is {a[3]:g} mm: both must be 0, the walls parallel to y"
        )
    return np.array([b[0] / a[2], (b[0] * b[2] - a[0] * a[2]) / (a[1] * a[2] - b[0] * b[3])])


def curves_5_27(points: ArrayLike) -> Array:
    """Return (..., 2) u and v of the thesis's example: between sin(x) and sin(x + pi/8) + 1.

    v is a share of the vertical gap, no distance: 1/2 is nearer to a wall than half the gap.
    """
    array = _points(points)
    x, y = array[..., 0], array[..., 1]
    gap = np.sin(x + np.pi / 8.0) - np.sin(x) + 1.0
    return np.stack([x, (y - np.sin(x)) / gap], axis=-1)


def _coefficients(
    point: ArrayLike, left: ArrayLike, right: ArrayLike
) -> tuple[list[float], list[float]]:
    """Return Appendix A's a0..a3 and b0..b3 of one quad (2, 2), (2, 2)."""
    p, q = _sides(left, right)
    x = _point("point", point)
    shear = (q[1] - p[1]) - (q[0] - p[0])
    a = [x[1] - p[0, 1], p[0, 1] - p[1, 1], q[0, 0] - p[0, 0], shear[0]]
    b = [x[0] - p[0, 0], p[0, 0] - p[1, 0], q[0, 1] - p[0, 1], shear[1]]
    return [float(value) for value in a], [float(value) for value in b]


def _solve_v(a: list[float], b: list[float]) -> NDArray[np.complex128]:
    """Roots of ``k3 v^2 + (k2 - k1) v + k4 = 0``; twice the one root where k3 is zero."""
    k1, k2 = b[1] * b[2] + b[0] * b[3], a[1] * a[2] + a[0] * a[3]
    k3, k4 = a[1] * a[3] - b[1] * b[3], a[0] * a[2] - b[0] * b[2]
    if k3 == 0.0:
        return np.full(2, k4 / (k1 - k2), dtype=complex)
    root = np.sqrt(complex((k2 - k1) ** 2 - 4.0 * k3 * k4))
    return np.array([(k1 - k2 + root) / (2.0 * k3), (k1 - k2 - root) / (2.0 * k3)])


def _points(points: ArrayLike) -> Array:
    return check_places("points", points, dim=2)


def _point(name: str, point: ArrayLike) -> Array:
    array = check_places(name, point, dim=2)
    if array.ndim != 1:
        raise InputError(f"{name} has shape {array.shape}: it must be one point, (2,)")
    return array


def _frame(frame: ArrayLike) -> Array:
    array = check_array("frame", frame)
    if array.shape != (4, 4):
        raise InputError(f"frame has shape {array.shape}: it must be (4, 4)")
    check_rotation("rotation of the frame", array[:3, :3])
    return array


def _lift(points: ArrayLike) -> Array:
    array = _points(points)
    tail = np.broadcast_to([0.0, 1.0], (*array.shape[:-1], 2))
    return np.concatenate([array, tail], axis=-1)


def _sides(left: ArrayLike, right: ArrayLike) -> tuple[Array, Array]:
    p, q = check_places("left", left, dim=2), check_places("right", right, dim=2)
    if p.ndim != 2 or p.shape != q.shape or len(p) < 2:
        raise InputError(
            f"left has shape {p.shape} and right {q.shape}: both must be (n, 2), n at least 2"
        )
    return p, q
