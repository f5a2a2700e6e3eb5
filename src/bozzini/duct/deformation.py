"""A deformation of tissue: where its places are displaced to, and where they were at rest."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array, check_points
from ..errors import DeformationError, InputError
from ..numeric.arrays import Floats

Displacement = Callable[[Floats], ArrayLike]
"""How far tissue at points (n, 3) of the tract at rest is displaced, (n, 3), world frame [mm]."""

TRACE_MM = 1e-7
"""Tissue is traced back until it is within so much of its place [mm]."""

TRACE_STEPS, NEWTON_STEPS, HALVINGS = 30, 30, 12
"""Steps of that at most: of ``x = y - u(x)``, then Newton's, each halved until it helps."""

NEWTON_MM = 0.01
"""For Newton's steps gradients are differences over so much to both sides [mm]."""


def carry_tissue(points: ArrayLike, last: Displacement, *, now: Displacement) -> Floats:
    """Return where the tissue at points (n, 3) in one frame is in another, world frame [mm].

    Parameters
    ----------
    last, now : callable
        Displacement in the frame of the points, and in the other one, as for `MovingField.update`.

    Raises
    ------
    DeformationError
        As `trace_back`.
    """
    return displace(trace_back(points, last), now)


def trace_back(points: ArrayLike, displacement: Displacement) -> Floats:
    """Return where the tissue that is at points (n, 3) now is at rest, world frame [mm].

    Raises
    ------
    DeformationError
        If that is not found: the displacement's gradient must be below 1.
    """
    now = check_points("points", points)
    rest, miss = trace(now, displacement, within=TRACE_MM)
    if len(miss) and miss.max() > TRACE_MM:
        worst = int(np.argmax(miss))
        steep = np.linalg.norm(_find_gradients(rest[[worst]], displacement)[0], 2)
        why = f"{miss[worst]:.2g} mm are left after {TRACE_STEPS + NEWTON_STEPS} steps"
        if steep >= 1.0:
            why = f"the displacement's gradient is {steep:.3g}, it must be below 1"
        raise DeformationError(
            f"the tissue now at {name_place(now[worst])} mm could not be traced back: {why}"
        )
    return rest


def trace(now: Floats, displacement: Displacement, *, within: float) -> tuple[Floats, Floats]:
    """Return places at rest whose tissue is at points now, and how far from it [mm].

    Where the gradient turns out to be 1 or more, infinitely far.
    """
    rest = now.copy()
    for _ in range(TRACE_STEPS):
        off = now - displace(rest, displacement)
        rest += off
        if np.abs(off).max(initial=0.0) <= within:
            return rest, np.zeros(len(rest))
    miss = np.linalg.norm(now - displace(rest, displacement), axis=1)
    for _ in range(NEWTON_STEPS):
        some = np.flatnonzero((miss > within) & np.isfinite(miss))
        if len(some) == 0:
            break
        gradient = _find_gradients(rest[some], displacement)
        folded = np.linalg.norm(gradient, 2, axis=(1, 2)) >= 1.0
        miss[some[folded]] = np.inf
        some, gradient = some[~folded], gradient[~folded]
        off = now[some] - displace(rest[some], displacement)
        step = np.linalg.solve(np.eye(3) + gradient, off[:, :, None])[:, :, 0]
        for _ in range(HALVINGS):
            tried = rest[some] + step
            left = np.linalg.norm(now[some] - displace(tried, displacement), axis=1)
            better = left < miss[some]
            rest[some[better]], miss[some[better]] = tried[better], left[better]
            some, step = some[~better], 0.5 * step[~better]
            if len(some) == 0:
                break
    return rest, miss


def _find_gradients(places: Floats, displacement: Displacement) -> Floats:
    """Return a displacement's gradient (n, 3, 3) at places, from differences."""
    probes = NEWTON_MM * np.concatenate([np.eye(3), -np.eye(3)])[:, None]
    moves = measure_displacement(displacement, (places + probes).reshape(-1, 3)).reshape(6, -1, 3)
    return np.asarray(np.moveaxis(moves[:3] - moves[3:], 0, -1) / (2.0 * NEWTON_MM))


def displace(points: Floats, displacement: Displacement) -> Floats:
    """Return where places (n, 3) at rest are displaced to [mm]."""
    return points + measure_displacement(displacement, points)


def measure_displacement(displacement: Displacement, points: Floats) -> Floats:
    """Return a displacement at places (n, 3) at rest, or raise where it is none [mm]."""
    moves = check_array("what displacement returns", displacement(points))
    if moves.shape != points.shape:
        raise InputError(
            f"displacement returns {moves.shape} for points {points.shape}: they must agree"
        )
    bad = np.flatnonzero(~np.isfinite(moves).all(axis=1))
    if len(bad):
        raise DeformationError(
            f"the displacement of the tissue at {name_place(points[bad[0]])} mm is not finite"
        )
    return moves


def name_place(point: Floats) -> str:
    """Return a place in words."""
    return "(" + ", ".join(f"{value:.1f}" for value in point) + ")"
