"""Numba kernel that draws bends evenly from all that a robot can take."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def _narrow(value, slope, low, high, interval):
    """Narrow an interval of steps to those with ``low <= value + step * slope <= high``."""
    if abs(slope) < 1e-300:
        return
    first = (low - value) / slope
    last = (high - value) / slope
    interval[0] = max(interval[0], min(first, last))
    interval[1] = min(interval[1], max(first, last))


@njit(cache=True)
def draw_bends(random, start, basis, limits, rows, low, high, thin, out):
    """Fill ``out`` (n, 2 m) by hit-and-run (Smith 1984), which tends to an even density.

    Parameters
    ----------
    random : Generator
        Source of random numbers.
    start : (2 m,) float
        Legal bends to walk from.
    basis : (p, 2 m) float
        Directions to walk in.
    limits, rows, low, high
        As of `measure_violation`.
    thin : int
        Steps from one sample to the next.
    """
    n = start.size
    x = start.copy()
    way = np.empty(n)
    interval = np.empty(2)
    for sample in range(out.shape[0]):
        for _ in range(thin):
            way[:] = 0.0
            for j in range(basis.shape[0]):
                part = random.standard_normal()
                for k in range(n):
                    way[k] += part * basis[j, k]
            interval[0] = -math.inf
            interval[1] = math.inf
            for i in range(limits.size):
                vx = way[2 * i]
                vy = way[2 * i + 1]
                square = vx * vx + vy * vy
                if square < 1e-300:
                    continue
                middle = -(x[2 * i] * vx + x[2 * i + 1] * vy) / square
                aside = (x[2 * i] * vy - x[2 * i + 1] * vx) / math.sqrt(square)
                half = math.sqrt(max(limits[i] ** 2 - aside * aside, 0.0) / square)
                interval[0] = max(interval[0], middle - half)
                interval[1] = min(interval[1], middle + half)
            for j in range(low.size):
                value = 0.0
                slope = 0.0
                for k in range(n):
                    value += rows[j, k] * x[k]
                    slope += rows[j, k] * way[k]
                if high[j] - low[j] > 1e-9:
                    _narrow(value, slope, low[j], high[j], interval)
            if interval[1] > interval[0]:
                step = interval[0] + random.random() * (interval[1] - interval[0])
                for k in range(n):
                    x[k] += step * way[k]
        out[sample] = x
