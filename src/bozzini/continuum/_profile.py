"""A quantity along the robot: one number, or knots of arc length and value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import InputError

__all__ = ["INTERPOLATIONS", "Knots", "Profile", "evaluate_profile", "read_profile"]

Floats = NDArray[np.float64]

Knots = tuple[tuple[float, float], ...]
Profile = float | Knots

INTERPOLATIONS = ("linear", "cubic")


def read_profile(name: str, given: Any, *, low: float, low_open: bool, unit: str) -> Profile:
    """Return `given` as a float or as checked knots, or raise `InputError`."""
    if not _is_row(given):
        return check_number(name, given, low=low, low_open=low_open, unit=unit)
    knots: list[tuple[float, float]] = []
    for index, pair in enumerate(given):
        if not _is_row(pair) or len(pair) != 2:
            raise InputError(f"{name} knot {index} is {pair!r}: it must be (arc length, value)")
        place = check_number(f"{name} knot {index} arc length", pair[0], low=0.0, unit="mm")
        value = check_number(f"{name} knot {index}", pair[1], low=low, low_open=low_open, unit=unit)
        if knots and place <= knots[-1][0]:
            raise InputError(
                f"{name} knot {index} stands at {place:g} mm, not after the one before it "
                f"at {knots[-1][0]:g} mm: arc lengths must increase"
            )
        knots.append((place, value))
    if len(knots) < 2:
        raise InputError(f"{name} has {len(knots)} knot(s): give a number or at least 2 knots")
    return tuple(knots)


def _is_row(given: Any) -> bool:
    if isinstance(given, np.ndarray):
        return given.ndim > 0
    return isinstance(given, Sequence) and not isinstance(given, str)


def evaluate_profile(profile: Profile, places: Floats, interpolation: str) -> tuple[Floats, Floats]:
    """Return value and slope at arc lengths inside the knots.

    Straight lines between knots, or monotone cubics (Fritsch and Carlson 1980), which never
    leave the range of the knots at either side. A slope at a corner is that of the right side.
    """
    if isinstance(profile, float):
        return np.full(places.shape, profile), np.zeros(places.shape)
    knots = np.asarray(profile)
    if interpolation == "cubic":
        from scipy.interpolate import PchipInterpolator

        curve = PchipInterpolator(knots[:, 0], knots[:, 1])
        return np.asarray(curve(places)), np.asarray(curve(places, 1))
    piece = np.clip(np.searchsorted(knots[:, 0], places, side="right") - 1, 0, len(knots) - 2)
    slopes = np.diff(knots[:, 1]) / np.diff(knots[:, 0])
    return knots[piece, 1] + slopes[piece] * (places - knots[piece, 0]), slopes[piece]
