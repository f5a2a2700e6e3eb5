"""Checks on numbers and arrays given by a user: pass the value on, or raise one clear line."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError

__all__ = ["check_integer", "check_number", "check_points"]


def check_number(
    name: str,
    value: float,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    low_open: bool = False,
    unit: str = "",
) -> float:
    """Return `value` as a finite float inside its legal range.

    Parameters
    ----------
    name : str
        What the value is, for the message.
    value : float
        The value received.
    low, high : float
        Legal range.
    low_open : bool
        Whether `low` itself is illegal.
    unit : str
        Unit for the message.

    Raises
    ------
    InputError
        If the value is not a finite number in the range.
    """
    suffix = f" {unit}" if unit else ""
    left = "(" if low_open or math.isinf(low) else "["
    right = ")" if math.isinf(high) else "]"
    legal = f"{left}{low:g}, {high:g}{right}{suffix}"
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{name} is {value!r}: it must be a number in {legal}") from None
    below = number <= low if low_open and not math.isinf(low) else number < low
    if not math.isfinite(number) or below or number > high:
        raise InputError(f"{name} is {number:g}{suffix}: it must lie in {legal}")
    return number


def check_integer(name: str, value: int, *, low: int, high: int | None = None) -> int:
    """Return `value` as an int inside `[low, high]`, or raise `InputError`."""
    legal = f"[{low}, {'inf' if high is None else high}]"
    try:
        number = int(value)
        whole = not isinstance(value, (bool, str)) and number == value
    except (TypeError, ValueError, OverflowError):
        whole = False
    if not whole:
        raise InputError(f"{name} is {value!r}: it must be a whole number in {legal}")
    if number < low or (high is not None and number > high):
        raise InputError(f"{name} is {number}: it must lie in {legal}")
    return number


def check_points(name: str, points: ArrayLike, *, dim: int = 3) -> NDArray[np.float64]:
    """Return `points` as a finite float array of shape `(..., dim)`, or raise `InputError`."""
    try:
        array = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be an array of numbers of shape (..., {dim})") from None
    if array.ndim == 0 or array.shape[-1] != dim:
        raise InputError(f"{name} has shape {array.shape}: it must be (..., {dim})")
    if not np.all(np.isfinite(array)):
        bad = int(np.count_nonzero(~np.isfinite(array).all(axis=-1)))
        raise InputError(f"{name} has {bad} point(s) that are not finite (NaN or infinite)")
    return array
