"""Inverse of one section of fixed length and constant curvature.

The tip of such a section reaches only a surface: two freedoms, not three. A place on it has its
bend in closed form, for another the nearest place is found.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number
from ..errors import InputError
from .checks import FARTHEST, check_values

__all__ = ["LARGEST_RATIO", "SectionResult", "bend_for_ratio", "solve_section"]

Floats = NDArray[np.float64]

STEEPEST_BEND = 2.331122370414423
"""Bend at which the tip is furthest aside [rad]: the root of ``tan(theta / 2) = theta``."""

LARGEST_RATIO = (1.0 - math.cos(STEEPEST_BEND)) / STEEPEST_BEND
"""Largest distance aside over length that an arc reaches, 0.7246."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SectionResult:
    """What the inverse of one section of fixed length found.

    Parameters
    ----------
    bend : (2,) ndarray
        ``(theta cos(phi), theta sin(phi))`` [rad].
    tip : (3,) ndarray
        Where the tip is then [mm]: the target, or the nearest place on the reachable surface.
    success : bool
        Whether that is the target, within the tolerance.
    residual : float
        Its distance from the target [mm].
    needed_length : float
        Length of the arc through the target [mm]; infinite if there is none, or none shorter
        than 1e9 mm, as straight behind the start.
    reason : str
        Why it did not succeed; empty on success.
    """

    bend: Floats
    tip: Floats
    success: bool
    residual: float
    needed_length: float
    reason: str


def bend_for_ratio(ratio: ArrayLike) -> Floats:
    """Return the bend whose tip is aside by ``ratio`` times the section's length.

    It solves ``(1 - cos(theta)) / theta = ratio`` on ``[0, 2.331]``, where the ratio grows up to
    0.7246; beyond, more bend brings the tip back.

    Parameters
    ----------
    ratio : array_like, shape (...)
        Distance from the axis over the length of the section.

    Returns
    -------
    (...) ndarray
        Bend [rad].

    Raises
    ------
    InputError
        If a ratio is outside ``[0, 0.7246]``.
    """
    wanted = check_array("ratio", ratio)
    if not np.all((wanted >= 0.0) & (wanted <= LARGEST_RATIO)):
        bad = wanted[~((wanted >= 0.0) & (wanted <= LARGEST_RATIO))].flat[0]
        raise InputError(
            f"ratio of distance aside to length is {bad:g}: "
            f"it must lie in [0, {LARGEST_RATIO:.6g}], which an arc can reach"
        )
    low, high = np.zeros_like(wanted), np.full_like(wanted, STEEPEST_BEND)
    bend = 2.0 * wanted
    for _ in range(60):
        half = np.sin(0.5 * bend)
        sinc = np.sinc(0.5 * bend / math.pi)
        miss = half * sinc - wanted
        low, high = np.where(miss <= 0.0, bend, low), np.where(miss > 0.0, bend, high)
        # d/dtheta of sin(theta/2)^2 / (theta/2)
        slope = 0.5 * sinc * (2.0 * np.cos(0.5 * bend) - sinc)
        with np.errstate(divide="ignore", invalid="ignore"):
            following = bend - miss / slope
        inside = (following >= low) & (following <= high)
        following = np.where(inside, following, 0.5 * (low + high))
        if np.all(np.abs(following - bend) <= 1e-15 * (1.0 + bend)):
            break
        bend = following
    return np.asarray(bend)


def solve_section(
    length: float, target: ArrayLike, *, max_bend: float = 2.0 * math.pi, tolerance: float = 1e-6
) -> SectionResult:
    """Bring the tip of one section of fixed length to a place, or as near as it goes.

    The plane of the bend is that of the target; in it the tip moves on a curve. A target on that
    curve has ``theta = 2 atan2(rho, z)`` in closed form; for another the nearest place of the
    curve is found, over all bends.

    Parameters
    ----------
    length : float
        Length of the section [mm].
    target : array_like, shape (3,)
        Place in the frame of the section's start [mm].
    max_bend : float
        Largest bend [rad], in (0, 2 pi].
    tolerance : float
        Distance at which the tip has arrived [mm].

    Returns
    -------
    SectionResult

    Raises
    ------
    InputError
        If a value has another shape or is outside its range.
    """
    check_number("length", length, low=0.0, high=FARTHEST, low_open=True, unit="mm")
    check_number("max_bend", max_bend, low=0.0, high=2.0 * math.pi, low_open=True, unit="rad")
    check_number("tolerance", tolerance, low=0.0, low_open=True, unit="mm")
    x, y, z = (float(value) for value in check_values("target", target, (3,), unit="mm"))
    across = math.hypot(x, y)
    plane = np.array([x / across, y / across]) if across > 0.0 else np.array([1.0, 0.0])
    closed = 2.0 * math.atan2(across, z)
    needed = _needed_length(across, z)
    angle = min(closed, max_bend)
    if math.dist(_aside(length, angle), (across, z)) > tolerance:
        angle = _nearest_bend(length, across, z, max_bend)
    aside, along = _aside(length, angle)
    tip = np.array([*(aside * plane), along])
    miss = math.dist((aside, along), (across, z))
    reason = ""
    if miss > tolerance:
        reason = f"the nearest tip of a section of {length:g} mm is {miss:.6g} mm from the target"
        if math.isfinite(needed):
            reason += (
                f", which an arc of {needed:.6g} mm, bent {math.degrees(closed):.4g} deg, reaches"
            )
        if angle >= max_bend:
            reason += f"; it is at its largest bend, {math.degrees(max_bend):.4g} deg"
    return SectionResult(
        bend=angle * plane,
        tip=tip,
        success=miss <= tolerance,
        residual=miss,
        needed_length=needed,
        reason=reason,
    )


def _aside(length: float, angle: float) -> tuple[float, float]:
    """Return where the tip of an arc is, aside and along."""
    half = 0.5 * angle
    chord = length * float(np.sinc(half / math.pi))
    return chord * math.sin(half), chord * math.cos(half)


def _needed_length(across: float, along: float) -> float:
    """Return the length of the arc to a place in the plane; infinite beyond `FARTHEST`."""
    away = math.hypot(across, along)
    # The chord is the arc's length by sin(half) / half, and sin(half) is across / away.
    half = math.atan2(across, along)
    if half < 1e-8:  # straight to the last bit; a denormal ratio would have no digits
        return away if away > 0.0 else math.inf
    sine = across / away
    length = away * half / sine if sine > 0.0 else math.inf
    return length if length <= FARTHEST else math.inf


def _nearest_bend(length: float, across: float, along: float, most: float) -> float:
    """Return the bend in ``[0, most]`` of the tip that is nearest to a place in the plane."""
    from scipy.optimize import minimize_scalar

    def measure(angle: float) -> float:
        aside, up = _aside(length, angle)
        return (aside - across) ** 2 + (up - along) ** 2

    grid = np.linspace(0.0, most, 257)
    values = [measure(angle) for angle in grid]
    best = int(np.argmin(values))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, 256)]
    found = minimize_scalar(measure, bounds=(low, high), method="bounded", options={"xatol": 1e-12})
    ends = min(low, high, key=measure)
    return float(found.x if found.fun < measure(ends) else ends)
