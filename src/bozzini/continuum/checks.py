"""Checks of what robots are built from, and of places, directions and frames."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array, check_number, check_points, show_apart, show_value
from ..errors import InputError
from ..numeric.arrays import Floats as Floats

_Item = TypeVar("_Item")


def check_name(what: str, name: object) -> str:
    """Return a name as plain text that tables and the command line can hold."""
    if not isinstance(name, str) or not name.strip():
        raise InputError(f"{what} name is {show_value(name)}: it must be a text that is not empty")
    if name != name.strip() or not name.isprintable() or any(mark in name for mark in ",="):
        raise InputError(
            f"{what} name is {str(name)!r}: it must be printable, without ',' and '=', and "
            "without blanks around it"
        )
    return str(name)


def check_text(what: str, given: object) -> str:
    """Return a text as a plain one."""
    if not isinstance(given, str):
        raise InputError(f"{what} is {show_value(given)}: it must be a text")
    return str(given)


def check_travel(name: str, travel: object) -> tuple[float, float]:
    """Return the smallest and largest displacement; None, -inf and inf are no limit."""
    limits = (-math.inf, math.inf)
    pair = limits if travel is None else take_items(f"{name} travel", travel, "a pair in mm")
    if len(pair) != 2:
        raise InputError(
            f"{name} travel is {show_value(travel)}: it must be (smallest, largest) displacement "
            "in mm"
        )
    low, high = (
        free
        if value is None or (isinstance(value, float) and value == free)
        else check_number(f"{name} travel[{index}]", value, unit="mm")
        for index, (value, free) in enumerate(zip(pair, limits, strict=True))
    )
    if not low <= high:
        raise InputError(
            f"{name} travel is {(low, high)} mm: the smallest must not be above the largest"
        )
    return low, high


def take_items(name: str, items: object, what: str) -> tuple[Any, ...]:
    """Return what `items` holds; one thing, text and mappings are no sequence."""
    if not isinstance(items, (str, bytes, dict)) and isinstance(items, Iterable):
        with suppress(TypeError):  # a quantity of pint has iter() and does not iterate
            return tuple(items)
    raise InputError(f"{name} is {show_value(items)}: it must be {what}")


def check_items(name: str, items: object, kind: type[_Item]) -> tuple[_Item, ...]:
    """Return a sequence as a tuple of one kind."""
    found = take_items(name, items, f"a sequence of {kind.__name__}")
    for item in found:
        if not isinstance(item, kind):
            raise InputError(f"{name} hold {show_value(item)}: each must be a {kind.__name__}")
    return found


MOST_CELLS = 1000
"""Cells of a map along the robot's length."""

AXES_TOLERANCE = 1e-6
"""How far the axes of a frame may miss being orthonormal."""

MAX_COORDINATE_MM = 1e9
"""Largest coordinate of a place [mm]: beyond, squares would lose what a robot's length adds."""


def check_values(name: str, given: ArrayLike, shape: tuple[int, ...], *, unit: str = "") -> Floats:
    """Return a copy of `given` as an array of one shape, its values in [-1e9, 1e9].

    Raises
    ------
    InputError
        If it is no such array.
    """
    array = np.array(check_array(name, given))
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}: it must be {shape}")
    _check_size(name, array, unit)
    return array


def check_places(name: str, given: ArrayLike) -> Floats:
    """Return places (..., 3) [mm] as an array, their coordinates in [-1e9, 1e9] mm.

    Raises
    ------
    InputError
        If they are no such array.
    """
    places = check_points(name, check_array(name, given))
    _check_size(name, places, "mm")
    return places


def check_directions(name: str, given: ArrayLike) -> Floats:
    """Return directions (..., 3), of any length but 0, as vectors of length 1.

    Raises
    ------
    InputError
        If they are no such array, or one is zero.
    """
    ways = check_points(name, check_array(name, given))
    # The squares of very long or very short ones are out of a float's range.
    largest = np.abs(ways).max(axis=-1, keepdims=True)
    if not np.all(largest > 0.0):
        verb = "is" if ways.ndim == 1 else "holds"
        raise InputError(f"{name} {verb} (0, 0, 0): a direction must not be zero")
    ways = ways / largest
    return np.asarray(ways / np.linalg.norm(ways, axis=-1, keepdims=True))


def check_turn(name: str, given: ArrayLike) -> Floats:
    """Return a rotation, as a vector (3,) [rad] or a matrix (3, 3), as a vector.

    Raises
    ------
    InputError
        If it is neither.
    """
    array = check_array(name, given)
    if array.shape != (3, 3):
        return check_values(name, array, (3,), unit="rad")
    frame = np.eye(4)
    frame[:3, :3] = array
    check_frame(name, frame)
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(array).as_rotvec())


def check_frame(name: str, frame: Floats) -> None:
    """Raise `InputError` unless `frame` (4, 4) is a place and right-handed orthonormal axes."""
    turn = frame[:3, :3]
    miss = float(np.abs(turn.T @ turn - np.eye(3)).max())
    wrong = ""
    if not miss <= AXES_TOLERANCE:
        wrong = f"its axes miss being orthonormal by {miss:.3g}: by {AXES_TOLERANCE:g} they may"
    elif np.linalg.det(turn) < 0.0:
        wrong = "its axes are left-handed, a mirror image: they must be right-handed"
    elif np.any(frame[3] != (0.0, 0.0, 0.0, 1.0)):
        wrong = f"its last row is {frame[3].tolist()}: it must be [0, 0, 0, 1]"
    if wrong:
        raise InputError(f"{name} is no frame: {wrong}")


def check_cell(cell: float, length: float) -> float:
    """Return the edge of a map's cells [mm], or raise `InputError` if there would be too many."""
    try:
        return check_number(
            "cell", cell, low=length / MOST_CELLS, high=MAX_COORDINATE_MM, unit="mm"
        )
    except InputError as error:
        raise InputError(
            f"{error}, at most {MOST_CELLS} cells along the robot's {length:g} mm"
        ) from None


def _check_size(name: str, array: Floats, unit: str) -> None:
    if not np.isfinite(array).all():
        raise InputError(f"{name} has values that are not finite (NaN or infinite)")
    if array.size and np.abs(array).max() > MAX_COORDINATE_MM:
        worst = array.flat[int(np.argmax(np.abs(array)))]
        suffix = f" {unit}" if unit else ""
        shown = show_apart(worst, -MAX_COORDINATE_MM, MAX_COORDINATE_MM)
        raise InputError(
            f"{name} has the value {shown[0]}{suffix}: it must lie in "
            f"[{shown[1]}, {shown[2]}]{suffix}"
        )
