"""The columns of a table of measurements as read-only arrays, and its rows by mask or index."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array
from ..errors import InputError

__all__ = ["take_index", "take_numbers", "take_row_numbers", "take_words"]


def take_numbers(name: str, values: Any, *, count: int | None = None) -> NDArray[np.float64]:
    array = np.array(check_array(name, values))  # a copy
    if array.ndim == 0 and count is not None:
        array = np.full(count, float(array))
    _check_shape(name, array, count)
    array.flags.writeable = False
    return array


def take_row_numbers(values: Any, count: int) -> NDArray[np.int64]:
    array = np.array(values)
    if array.size == 0:
        array = np.arange(1, count + 1)
    _check_shape("numbers", array, count)
    if array.dtype.kind not in "iu":
        raise InputError("numbers must be whole numbers, one for each row")
    array = array.astype(np.int64)
    array.flags.writeable = False
    return array


def take_index(rows: ArrayLike, count: int) -> NDArray[Any]:
    """Rows as a mask or indices that NumPy takes."""
    index = np.atleast_1d(np.asarray(rows))
    if index.size == 0:
        return np.zeros(0, dtype=np.int64)
    if index.ndim == 1 and index.dtype.kind == "b":
        if len(index) != count:
            raise InputError(f"the mask of rows has {len(index)} entries: it must have {count}")
        return index
    if index.ndim != 1 or index.dtype.kind not in "iu":
        raise InputError(f"rows has dtype {index.dtype}: it must be a mask or whole numbers (k,)")
    if index.min() < -count or index.max() >= count:
        wrong = index[(index < -count) | (index >= count)][0]
        raise InputError(f"row index is {wrong}: it must lie in [{-count}, {count - 1}]")
    return index


def take_words(name: str, values: Any, *, count: int) -> NDArray[np.str_]:
    array = np.array(values, dtype=np.str_)
    if array.ndim == 0:
        array = np.full(count, str(array))
    _check_shape(name, array, count)
    array = np.array([word.strip() for word in array.tolist()], dtype=np.str_)
    array.flags.writeable = False
    return array


def _check_shape(name: str, array: NDArray[Any], count: int | None) -> None:
    if array.ndim != 1 or (count is not None and len(array) != count):
        wanted = "(n,)" if count is None else f"({count},), one for each pressure"
        raise InputError(f"{name} has shape {array.shape}: it must be {wanted}")
