"""What the numbers of ducts must be, and how a frozen dataclass keeps them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number, check_points, check_range, show_apart
from ..errors import InputError

COORDINATE_MAX = 1e6
"""A shape lies within this of the origin along each axis [mm]."""

SIZE_MIN, SIZE_MAX = 1e-6, 1e6
"""Radii, half axes and other sizes lie between these [mm]."""

PLACE_MAX = 1e9
"""A duct may be asked at points within this of the origin along each axis [mm]."""

ORTHONORMAL = 1e-9
"""How far a rotation may be from orthonormal."""


def freeze_array(
    name: str, values: ArrayLike, shape: tuple[int, ...], *, least: int = 1
) -> NDArray[np.float64]:
    """Return a read-only copy of finite numbers of shape (n, *shape), n at least `least`."""
    wanted = ", ".join(str(n) for n in ("n", *shape)) + ("," if not shape else "")
    try:
        array = np.array(check_array(name, values), order="C")
    except InputError:
        raise InputError(f"{name} must be an array of numbers of shape ({wanted})") from None
    if array.ndim != 1 + len(shape) or array.shape[1:] != shape or len(array) < least:
        raise InputError(
            f"{name} has shape {array.shape}: it must be ({wanted}) with n at least {least}"
        )
    finite = np.isfinite(array).reshape(len(array), -1).all(axis=1)
    if not finite.all():
        index = int(np.argmin(finite))
        raise InputError(f"{name}[{index}] is {array[index].tolist()}: it must be finite")
    array.flags.writeable = False
    return array


def freeze_places(name: str, values: ArrayLike, dim: int, *, least: int = 1) -> NDArray[np.float64]:
    """Return a read-only copy of points (n, dim) within a million mm of the origin."""
    array = freeze_array(name, values, (dim,), least=least)
    check_range(name, array, -COORDINATE_MAX, COORDINATE_MAX, "mm")
    return array


def check_places(name: str, points: ArrayLike, *, dim: int = 3) -> NDArray[np.float64]:
    """Return points (..., dim) a duct may be asked at, or raise `InputError`."""
    array = check_points(name, points, dim=dim)
    if array.size and max(-array.min(), array.max()) > PLACE_MAX:
        check_range(name, array, -PLACE_MAX, PLACE_MAX, "mm")
    return array


def check_size(name: str, value: float) -> float:
    """Return a size that a shape can have [mm], or raise `InputError`."""
    return check_number(name, value, low=SIZE_MIN, high=SIZE_MAX, unit="mm")


def scale_to_unit_normals(name: str, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows (n, 3 or more) divided by the length of their normals, the first three numbers.

    Lengths may be of any size but 0: squares of tiny ones vanish, so they are scaled up first.
    """
    most = np.abs(rows[:, :3]).max(axis=1)
    if most.min() == 0.0:
        raise InputError(f"{name}[{int(np.argmin(most))}] is zero: it must have a length")
    with np.errstate(over="ignore"):  # of a plane's offset, which is checked then
        scaled = rows / most[:, None]
    return np.asarray(scaled / np.linalg.norm(scaled[:, :3], axis=1, keepdims=True))


def check_rotation(name: str, rotation: NDArray[np.float64], *, reflection: bool = False) -> None:
    """Raise unless a matrix (dim, dim) is a rotation; or a reflection, where that is allowed."""
    with np.errstate(over="ignore", invalid="ignore"):
        off = float(np.abs(rotation.T @ rotation - np.eye(len(rotation))).max())
    if not off <= ORTHONORMAL:
        raise InputError(
            f"{name} is no rotation: it must be orthonormal within {ORTHONORMAL:g}, and is off by "
            f"{off:.2g}"
        )
    turn = float(np.linalg.det(rotation))
    if turn < 0.0 and not reflection:
        raise InputError(
            f"{name} is a reflection, its determinant is {turn:.3g}: a rotation's must be 1"
        )


def check_counts(
    count: int, arrays: dict[str, NDArray[np.float64]], *, per: str = "centre"
) -> None:
    """Raise unless each array has `count` rows, one per centre."""
    for name, array in arrays.items():
        if len(array) != count:
            raise InputError(
                f"{name} has {len(array)} value(s): it must have one per {per}, {count}"
            )


def check_radii(radii: NDArray[np.float64]) -> None:
    """Raise unless all radii (n,) are sizes a shape can have, with the first that is not."""
    check_range("radii", radii, SIZE_MIN, SIZE_MAX, "mm")


def check_half_axes(half_axes: NDArray[np.float64]) -> None:
    """Raise unless all half axes (n, dim) are sizes, with the first shape's that are not."""
    bad = (half_axes.min(axis=1) < SIZE_MIN) | (half_axes.max(axis=1) > SIZE_MAX)
    if bad.any():
        k = int(np.argmax(bad))
        raise InputError(
            f"half axes[{k}] is {half_axes[k].tolist()} mm: each must lie in "
            f"[{SIZE_MIN:g}, {SIZE_MAX:g}] mm"
        )


def check_exponents(
    name: str, values: NDArray[np.float64], low: float, high: float, *, pinched: str
) -> None:
    """Raise unless all values (n,) lie in [low, high]; `pinched` ones are ``"below"`` or above."""
    bad = (values < low) | (values > high)
    if bad.any():
        k = int(np.argmax(bad))
        beyond = values[k] < low if pinched == "below" else values[k] > high
        why = ", the shape would not be convex" if beyond else ""
        shown = show_apart(values[k], low, high)
        raise InputError(f"{name}[{k}] is {shown[0]}: it must lie in [{shown[1]}, {shown[2]}]{why}")


def check_wall(inflation: float, wall_error: float | None = None) -> None:
    """Raise unless inflation and, if known, wall error are lengths [mm]."""
    check_number("inflation", inflation, low=0.0, high=SIZE_MAX, unit="mm")
    if wall_error is not None:
        check_number("wall error", wall_error, low=0.0, high=SIZE_MAX, unit="mm")


def set_fields(shape: object, **values: object) -> None:
    """Set fields of a frozen dataclass while it is built."""
    for name, value in values.items():
        object.__setattr__(shape, name, value)
