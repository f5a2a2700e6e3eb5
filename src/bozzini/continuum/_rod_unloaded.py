"""The rod without loads: tensions for which its tendons are as long as asked.

The dual of the problem is concave, and strictly so but for redundant tendons: Newton's method with
a line search finds its only maximum. Where tendons push and are not parallel it may have several.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from ._energy_tension_kernels import solve_bounded
from ._rod_state import Rod, Shot, Target
from ._rod_unloaded_kernels import measure_unloaded

__all__ = ["improve_unloaded"]

Floats = NDArray[np.float64]

MOST_STEPS = 60
"""Newton steps for one part of a command."""

SMALLEST_CUT = 1e-4
"""Smallest part of a step."""

RIDGE = 1e-11
"""Added to the tendons' own flexibility, so that redundant tendons have one answer."""

SHARING = 1e-8
"""The same where the tensions are shared out."""


def improve_unloaded(rod: Rod, target: Target, share: float, loose: float, start: Shot) -> Shot:
    """Return the state for a `share` of the command, from `start` on, or why there is none."""
    found = dataclasses.replace(start, share=share, iterations=0, reason="")
    if target.tensions is not None:
        return dataclasses.replace(found, tensions=share * target.tensions)
    tensions = start.tensions.copy()
    limit = target.limit(share, loose)
    value, lengths, give = _measure(rod, target, tensions, limit)
    reason = "no equilibrium was found beyond it"
    for count in range(MOST_STEPS + 1):
        gaps = target.gaps(lengths, tensions, share, loose)
        if np.abs(gaps).max(initial=0.0) <= loose:
            shared = _share(target, give, tensions)
            _, shorter, _ = _measure(rod, target, shared, limit)
            left = target.gaps(shorter, shared, share, loose)
            if np.abs(left).max(initial=0.0) <= loose:
                tensions = shared
            return dataclasses.replace(found, tensions=tensions, iterations=count)
        if count == MOST_STEPS:
            break
        slope = lengths - target.compliances * tensions - limit
        high = np.full(len(tensions), rod.strongest)
        low = np.where(target.pushes, -high, 0.0)
        ridge = RIDGE * float(np.diag(give).max())
        matrix = give + np.diag(target.compliances + ridge)
        wanted = tensions.copy()
        if not solve_bounded(matrix, -slope - matrix @ tensions, low, high, wanted):
            break
        held = np.flatnonzero(np.abs(wanted) >= rod.strongest)
        if held.size and count > 0:
            names = ", ".join(f"'{target.names[k]}'" for k in held)
            reason = (
                f"{names} would have to stretch beyond it; let out tendons on the other side, or "
                "give a tendon_stiffness"
            )
            break
        change, part = wanted - tensions, 1.0
        rise = float(slope @ change)
        grain = 1e-13 * float(np.abs(tensions) @ lengths + np.abs(wanted) @ lengths)
        while part >= SMALLEST_CUT:
            trial = tensions + part * change
            after, longer, soft = _measure(rod, target, trial, limit)
            if after >= value + 1e-4 * part * rise - grain:
                break
            part *= 0.5
        else:
            break
        tensions, value, lengths, give = trial, after, longer, soft
    if reason.startswith("no"):
        worst = int(np.argmax(np.abs(gaps)))
        reason += f", tendon '{target.names[worst]}' misses by {abs(gaps[worst]):.3g} mm"
    return dataclasses.replace(found, iterations=count, reason=reason)


def _measure(
    rod: Rod, target: Target, tensions: Floats, limit: Floats
) -> tuple[float, Floats, Floats]:
    """The dual's value, lengths (t,), and how they give way to tension (t, t)."""
    lengths, give = np.empty(len(tensions)), np.empty((len(tensions), len(tensions)))
    value = measure_unloaded(rod.grid, tensions, lengths, give)
    if math.isnan(value):
        return -math.inf, lengths, give
    value -= float(tensions @ (limit + 0.5 * target.compliances * tensions))
    return value, lengths, give


def _share(target: Target, give: Floats, tensions: Floats) -> Floats:
    """Return the least tensions that do the same, where redundant tendons leave them open."""
    if target.compliances.any():
        return tensions
    taut = tensions != 0.0
    shared = tensions.copy()
    size = float(np.abs(tensions).max(initial=0.0))
    ridge = SHARING * float(np.diag(give).max(initial=0.0))
    vector = -give @ tensions
    right = vector
    for _ in range(3):
        # Each pass takes out what the ridge did to the one before it.
        low = np.where(target.pushes, -size, 0.0) * taut
        if not solve_bounded(give + ridge * np.eye(len(taut)), right, low, size * taut, shared):
            return tensions
        right = vector - ridge * shared
    return shared
