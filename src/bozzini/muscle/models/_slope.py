"""The slope of a force in the length, by differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["find_slope"]

Floats = NDArray[np.float64]


def find_slope(
    force: Callable[[Floats], Floats], lengths: Floats, low: Floats, high: Floats
) -> Floats:
    """Return the slope at `lengths` of the quartic through five lengths near by [N/mm].

    They are 1/2000 of ``[low, high]`` apart and inside it, so that near an end the middle one is
    not the one asked for.
    """
    step = (high - low) / 2000.0
    middle = np.clip(lengths, low + 2.0 * step, high - 2.0 * step)
    away = (lengths - middle) / step
    two, one, here, more, most = (
        force(np.clip(middle + k * step, low, high)) for k in (-2.0, -1.0, 0.0, 1.0, 2.0)
    )
    first = (two - 8.0 * one + 8.0 * more - most) / 12.0
    second = (-two + 16.0 * one - 30.0 * here + 16.0 * more - most) / 24.0
    third = (-two + 2.0 * one - 2.0 * more + most) / 12.0
    fourth = (two - 4.0 * one + 6.0 * here - 4.0 * more + most) / 24.0
    slope = first + away * (2.0 * second + away * (3.0 * third + away * 4.0 * fourth))
    return np.asarray(slope / step)
