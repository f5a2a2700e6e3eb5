"""Profiles: quantities along a robot, one number or knots of arc length and value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, TypeGuard

import numpy as np

from ..checks import Quantity, show_apart, show_value
from ..errors import InputError
from ..numeric.arrays import Floats

ARC_LENGTH = Quantity(kind="length", help="Arc length from the base.", low=0.0)

ROUND_OFF_MM = 1e-9
"""Length that is round-off [mm]."""

ArcLength = Annotated[float, ARC_LENGTH]

Knots = tuple[tuple[ArcLength, float], ...]

Interpolation = Literal["linear", "cubic"]

Profile = float | Knots


def check_profile(name: str, given: object, known: Quantity) -> Profile:
    """Return `given` as a float or as checked knots, or raise `InputError`."""
    if not _is_row(given):
        return known.check(name, given)
    knots: list[tuple[float, float]] = []
    for index, pair in enumerate(given):
        if not _is_row(pair) or len(pair) != 2:
            raise InputError(f"{name} knot {index} is {pair!r}: it must be (arc length, value)")
        place = ARC_LENGTH.check(f"{name} knot {index} arc length", pair[0])
        value = known.check(f"{name} knot {index}", pair[1])
        if knots and place <= knots[-1][0]:
            raise InputError(
                f"{name} knot {index} stands at {place:g} mm, not after the one before it "
                f"at {knots[-1][0]:g} mm: arc lengths must increase"
            )
        knots.append((place, value))
    if len(knots) < 2:
        raise InputError(f"{name} has {len(knots)} knot(s): give a number or at least 2 knots")
    return tuple(knots)


def _is_row(given: object) -> TypeGuard[Sequence[object]]:
    if isinstance(given, np.ndarray):
        return given.ndim > 0
    return isinstance(given, Sequence) and not isinstance(given, str)


def evaluate_profile(
    profile: Profile, places: Floats, interpolation: Interpolation
) -> tuple[Floats, Floats]:
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


PathKnots = tuple[tuple[ArcLength, float, float], ...]
"""Knots of arc length, x and y [mm]."""


def check_path(name: str, given: object) -> PathKnots:
    """Return `given` as checked knots of arc length, x and y, or raise `InputError`."""
    if not _is_row(given):
        raise InputError(f"{name} is {given!r}: it must be knots (arc length, x, y)")
    rows = [row if _is_row(row) and len(row) == 3 else None for row in given]
    if None in rows:
        index = rows.index(None)
        raise InputError(f"{name} knot {index} is {given[index]!r}: it must be (arc length, x, y)")
    coordinate = Quantity(kind="length")
    columns = [
        check_profile(f"{name} {axis}", [(row[0], row[k]) for row in rows if row], coordinate)
        for k, axis in ((1, "x"), (2, "y"))
    ]
    pairs = zip(*(column for column in columns if not isinstance(column, float)), strict=True)
    path = tuple((place, x, y) for (place, x), (_, y) in pairs)
    if not any(x or y for _, x, y in path):
        raise InputError(f"{name} runs along the backbone's axis: it must leave it somewhere")
    return path


def evaluate_path(
    path: Sequence[Sequence[float]], places: Floats, interpolation: Interpolation
) -> tuple[Floats, Floats]:
    """Return place and slope, both (..., 2), at arc lengths inside the knots.

    Straight lines between knots, or cubic splines with two continuous derivatives.
    """
    knots = np.asarray(path)
    if interpolation == "cubic":
        from scipy.interpolate import CubicSpline

        curve = CubicSpline(knots[:, 0], knots[:, 1:])
        return np.asarray(curve(places)), np.asarray(curve(places, 1))
    columns = [
        evaluate_profile(tuple(zip(knots[:, 0], column, strict=True)), places, "linear")
        for column in knots[:, 1:].T
    ]
    return (
        np.stack([value for value, _ in columns], axis=-1),
        np.stack([slope for _, slope in columns], axis=-1),
    )


CurvatureKnots = tuple[tuple[ArcLength, float, float, float], ...]
"""Knots of arc length [mm], curvature about x and about y, and twist [rad/mm]."""

Curvature = tuple[float, float, float] | CurvatureKnots


def check_curvature(name: str, given: object, known: Quantity) -> Curvature:
    """Return `given` as three numbers, or as checked knots of arc length and three numbers."""
    words = f"{name} is {show_value(given)}: it must be (ux, uy, uz) or knots (s, ux, uy, uz)"
    if not _is_row(given) or not len(given):
        raise InputError(words)
    if not _is_row(given[0]):
        if len(given) != 3:
            raise InputError(words)
        x, y, z = (known.check(f"{name}[{k}]", value) for k, value in enumerate(given))
        return x, y, z
    if not all(_is_row(row) and len(row) == 4 for row in given):
        raise InputError(words)
    rows = [tuple(row) for row in given if _is_row(row)]
    columns = [
        np.asarray(check_profile(f"{name} {axis}", [(row[0], row[k]) for row in rows], known))
        for k, axis in ((1, "x"), (2, "y"), (3, "z"))
    ]
    table = np.column_stack([columns[0], columns[1][:, 1], columns[2][:, 1]])
    return tuple((s, x, y, z) for s, x, y, z in table.tolist())


def check_span(name: str, profile: Profile | Curvature, end: float) -> None:
    """Raise `InputError` unless knots reach from 0 to `end` [mm], the section's length."""
    rows = profile if isinstance(profile, tuple) else ()
    knots = [row for row in rows if isinstance(row, tuple)]
    if knots and not (knots[0][0] <= ROUND_OFF_MM and knots[-1][0] >= end - ROUND_OFF_MM):
        shown = show_apart(knots[-1][0], end)
        raise InputError(
            f"{name} has knots from {knots[0][0]:g} to {shown[0]} mm: they must reach from 0 "
            f"mm, the section's start, to {shown[1]} mm, its end"
        )


def smallest_of(profile: Profile) -> float:
    """Return the smallest value of a profile of straight lines."""
    return profile if isinstance(profile, float) else min(value for _, value in profile)


def largest_of(profile: Profile) -> float:
    """Return the largest value of a profile of straight lines."""
    return profile if isinstance(profile, float) else max(value for _, value in profile)
