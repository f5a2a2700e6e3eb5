"""Checks on what robots and models are built from: pass it on, or raise one clear line."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from ..checks import check_number
from ..errors import InputError

__all__ = ["STIFFNESSES", "TORSIONS", "check_limit", "check_name", "check_travel", "take_items"]

STIFFNESSES = (1e-9, 1e15)
"""Least and largest EI [N mm^2]."""

TORSIONS = (1e-10, 1e15)
"""Least and largest GJ [N mm^2]."""


def check_limit(name: str, value: Any, *, unit: str) -> float:
    """Return a positive number, or infinity where there is no limit."""
    if isinstance(value, float) and value == math.inf:
        return math.inf
    return check_number(name, value, low=0.0, low_open=True, unit=unit)


def check_name(what: str, name: Any) -> str:
    """Return a name as plain text that tables and the command line can hold."""
    if not isinstance(name, str) or not name.strip():
        raise InputError(f"{what} name is {name!r}: it must be a text that is not empty")
    if name != name.strip() or not name.isprintable() or any(mark in name for mark in ",="):
        raise InputError(
            f"{what} name is {str(name)!r}: it must be printable, without ',' and '=', and "
            "without blanks around it"
        )
    return str(name)


def check_travel(name: str, travel: Any) -> tuple[float, float]:
    """Return the smallest and largest displacement; -inf and inf where there is no limit."""
    pair = take_items(f"{name} travel", travel, "(smallest, largest) displacement in mm")
    if len(pair) != 2:
        raise InputError(
            f"{name} travel is {travel!r}: it must be (smallest, largest) displacement in mm"
        )
    low, high = (
        value
        if isinstance(value, float) and value == free
        else check_number(f"{name} travel[{index}]", value, unit="mm")
        for index, (value, free) in enumerate(zip(pair, (-math.inf, math.inf), strict=True))
    )
    if not low <= high:
        raise InputError(
            f"{name} travel is {(low, high)} mm: the smallest must not be above the largest"
        )
    return low, high


def take_items(name: str, items: Any, what: str) -> tuple[Any, ...]:
    """Return what `items` holds; one thing, text and mappings are no sequence."""
    if isinstance(items, (str, bytes, dict)) or not isinstance(items, Iterable):
        raise InputError(f"{name} is {items!r}: it must be {what}")
    return tuple(items)
