"""Fields of plain data as it was read: what they must be, in one line that names them."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

__all__ = ["show_value", "take_mapping", "take_numbers"]


def take_mapping(
    value: Any, field: str, known: tuple[str, ...], needed: tuple[str, ...]
) -> Mapping[str, Any]:
    """Return a mapping that has only known fields and all that it needs, or raise `InputError`."""
    if not isinstance(value, Mapping):
        raise InputError(
            f"{field} is {show_value(value)}: it must hold the fields {', '.join(known)}"
        )
    for key in value:
        if key not in known:
            raise InputError(
                f"{field} has an unknown field {show_value(key)}: known are {', '.join(known)}"
            )
    for key in needed:
        if key not in value:
            raise InputError(f"{field} has no '{key}': it needs {', '.join(needed)}")
    return value


def take_numbers(value: Any, field: str, count: int) -> NDArray[np.float64]:
    """Return `count` finite numbers, or raise; nine of them may be three rows of three."""
    flat = [value] if count == 1 else value
    if count == 9 and isinstance(value, (list, tuple)):
        flat = [item for row in value for item in (row if isinstance(row, (list, tuple)) else [])]
    legal = isinstance(flat, (list, tuple)) and len(flat) == count
    if not legal or not all(_is_number(item) for item in flat):
        form = {1: "a number", 3: "3 numbers", 9: "3 rows of 3 numbers"}[count]
        hint = _explain_text(flat) if legal else ""
        raise InputError(f"{field} is {show_value(value)}: it must be {form}, all finite{hint}")
    return np.array(flat, dtype=np.float64)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _explain_text(values: Any) -> str:
    """Return a hint for numbers that were read as text."""
    for value in values:
        if isinstance(value, str):
            try:
                float(value)
            except ValueError:
                continue
            return "; it is text: write it without quotes, and in YAML 1.0e-3 for 1e-3"
    return ""


def show_value(value: Any) -> str:
    """Return a value as one short line; of much data only the beginning is looked at."""
    brief = reprlib.Repr()
    brief.maxstring = brief.maxother = brief.maxlong = 60
    try:
        text = " ".join(brief.repr(value).split())
    except ValueError:  # an integer of more digits than Python writes
        return f"a huge {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:57]}..."
