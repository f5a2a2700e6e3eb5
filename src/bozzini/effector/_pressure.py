"""The pressure at which any muscle model pulls so much at a contraction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..muscle import MuscleModel

__all__ = ["find_model_pressures"]

Floats = NDArray[np.float64]

MAX_ITERATIONS = 200


def find_model_pressures(
    model: MuscleModel, contraction: Floats, force: Floats, *, limit: float
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return pressures in [0, limit], what pull is left over, and iterations, all (n,).

    By Anderson and Bjoerck's regula falsi with bisections between, for all at once. Where the
    muscle would not contract so far without load, its free contraction is what is looked at: some
    models have no pull beyond it. No contraction is 0 MPa.
    """
    count = contraction.size
    pressure, iterations = np.zeros(count), np.zeros(count, dtype=np.int64)
    left_over = np.zeros(count)
    active = np.flatnonzero(contraction > 0.0)
    if not active.size:
        return pressure, left_over, iterations
    left, right = np.zeros(count), np.full(count, limit)
    miss_left = -force
    miss_right = np.zeros(count)
    miss_right[active] = _measure(model, right[active], contraction[active], force[active])
    pressure[active] = limit
    left_over[active] = miss_right[active]
    active = active[miss_right[active] > 0.0]
    for iteration in range(1, MAX_ITERATIONS):
        if not active.size:
            break
        low, high = left[active], right[active]
        below, above = miss_left[active], miss_right[active]
        middle = (low * above - high * below) / (above - below)
        halved = 0.5 * (low + high)
        stuck = (iteration % 4 == 0) | ~((low < middle) & (middle < high))
        middle = np.where(stuck, halved, middle)
        miss = _measure(model, middle, contraction[active], force[active])
        last = pressure[active]
        pressure[active], left_over[active] = middle, miss
        iterations[active] = iteration
        with np.errstate(divide="ignore", invalid="ignore"):
            to_right = 1.0 - miss / above
            to_left = 1.0 - miss / below
        up = miss > 0.0
        miss_left[active] = np.where(up, below * np.where(to_right > 0.0, to_right, 0.5), miss)
        miss_right[active] = np.where(up, miss, above * np.where(to_left > 0.0, to_left, 0.5))
        left[active] = np.where(up, low, middle)
        right[active] = np.where(up, middle, high)
        width = np.minimum(right[active] - left[active], np.abs(middle - last))
        ended = (np.abs(miss) <= 1e-14 * force[active]) | (width <= 4e-16 * limit)
        active = active[~ended]
    return pressure, left_over, iterations


def _measure(model: MuscleModel, pressure: Floats, contraction: Floats, force: Floats) -> Floats:
    """Pull less force; where the free contraction is too short, how much so in its place."""
    short = model.free_contraction(pressure) - contraction
    miss = -force + force / contraction * np.minimum(short, 0.0)
    enough = short > 0.0
    if np.any(enough):
        miss[enough] = model.force(pressure[enough], contraction[enough]) - force[enough]
    return miss
