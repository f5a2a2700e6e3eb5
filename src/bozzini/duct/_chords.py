"""Two curves drawn as chords: how many it takes, how far the curves are from them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_points
from ..errors import GeometryError, InputError

__all__ = ["Curve", "Points", "check_rulings", "draw_chords", "take_function", "take_samples"]

Curve = Callable[[NDArray[np.float64]], ArrayLike]
"""Takes parameters (n,), returns points (n, 2) [mm]."""

Points = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""The same, checked."""

PIECES_MAX = 5000
"""A curve is drawn with at most this many chords."""

PROBES = 7
"""Points of a curve between two samples where its distance from the chord is looked at."""


def take_function(name: str, curve: Curve) -> Points:
    """Return a function whose points are checked: finite, and one for each parameter."""

    def take(u: NDArray[np.float64]) -> NDArray[np.float64]:
        points = check_points(f"{name}(u)", curve(u), dim=2)
        if points.shape != (len(u), 2):
            raise InputError(
                f"{name}(u) has shape {points.shape} for {len(u)} parameters: it must be "
                f"({len(u)}, 2)"
            )
        return points

    return take


def take_samples(samples: NDArray[np.float64], low: float, high: float) -> Points:
    """Return the curve through samples (n, 2), straight between them, u from `low` to `high`."""
    nodes = np.linspace(low, high, len(samples))
    return lambda u: np.stack([np.interp(u, nodes, column) for column in samples.T], axis=1)


def draw_chords(
    curves: tuple[Points, Points],
    low: float,
    high: float,
    *,
    tolerance: float,
    curvature: float | None,
) -> tuple[NDArray[np.float64], float]:
    """Choose parameters (n,) whose chords are near to both curves.

    Returns
    -------
    parameters : (n,) float
        Evenly spaced from `low` to `high`.
    error : float
        How far the curves may be from their chords, at most the tolerance [mm]: proved where
        `curvature` bounds their second derivatives, else twice the largest distance found.

    Raises
    ------
    InputError
        If that takes more than 5000 chords.
    """
    if curvature is not None:
        pieces = 1 + int((high - low) * np.sqrt(curvature / (8.0 * tolerance)))
        _check_count(pieces, tolerance)
        error = curvature * ((high - low) / pieces) ** 2 / 8.0
        return np.linspace(low, high, pieces + 1), float(error)
    pieces = 16
    while True:
        _check_count(pieces, tolerance)
        u = np.linspace(low, high, pieces + 1)
        error = 2.0 * max(_measure_chords(curve, u) for curve in curves)
        if error <= tolerance:
            return u, error
        pieces = max(pieces + 1, int(1.1 * pieces * np.sqrt(error / tolerance)))


def _check_count(pieces: int, tolerance: float) -> None:
    if pieces > PIECES_MAX:
        raise InputError(
            f"tolerance is {tolerance:g} mm: the curves would need {pieces} chords, it must be "
            f"so large that {PIECES_MAX} are enough"
        )


def _measure_chords(curve: Points, u: NDArray[np.float64]) -> float:
    """Return the largest distance found between a curve and its chords [mm]."""
    ends = curve(u)
    worst = 0.0
    for share in np.arange(1, PROBES + 1) / (PROBES + 1.0):
        middle = curve(u[:-1] + share * np.diff(u))
        away = middle - ends[:-1]
        chord = np.diff(ends, axis=0)
        square = np.maximum(np.sum(chord * chord, axis=1), 1e-300)
        t = np.clip(np.sum(away * chord, axis=1) / square, 0.0, 1.0)
        off = np.linalg.norm(away - t[:, None] * chord, axis=1)
        worst = max(worst, float(off.max()))
    return worst


def check_rulings(
    u: NDArray[np.float64], first: NDArray[np.float64], second: NDArray[np.float64]
) -> None:
    """Raise `GeometryError` if curves through points (n, 2) meet or their rulings cross.

    They do not if the determinant of (x_u, x_v), linear in v, keeps its sign in all quads.
    """
    width = second - first
    gap = np.linalg.norm(width, axis=1)
    size = float(np.ptp(np.concatenate([first, second]), axis=0).max())
    if gap.min() <= 1e-12 * size:
        k = int(np.argmin(gap))
        raise GeometryError(
            f"the curves meet at u = {u[k]:g}, at ({first[k, 0]:g}, {first[k, 1]:g}) mm: they "
            "must stay apart"
        )
    steps = [np.diff(first, axis=0), np.diff(second, axis=0)]
    turns = np.stack(
        [
            step[:, 0] * rung[:, 1] - step[:, 1] * rung[:, 0]
            for step in steps
            for rung in (width[:-1], width[1:])
        ],
        axis=1,
    )
    way = np.sign(turns.sum())
    wrong = (turns * way <= 0.0).any(axis=1)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise GeometryError(
            f"rulings cross between u = {u[k]:g} and {u[k + 1]:g}: the curves meet there, turn "
            "back, or are too far apart for their bend"
        )
