"""Roots of functions of one unknown: of many at once, by Chandrupatla's method, and of one.

SciPy's `optimize.elementwise.find_root` is the same method; for the few elements of a muscle's
batches it takes three times as long, and it cannot start from values that are known already.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .arrays import Floats

Ends = tuple[Floats, Floats]
Excess = Callable[[NDArray[np.intp], Floats], Floats]
"""From indices (k,) of elements and points (k,) to values (k,)."""

MAX_ITERATIONS = 100
"""Steps that an element may take."""

_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_SECTIONS = 60  # golden sections of a search: they leave a share of 1e-12

TOLERANCE = 4.0 * float(np.finfo(np.float64).eps)
"""Half the width of a bracket at which a root is found, relative to it."""


def bisect(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where an increasing `function` crosses zero in `[low, high]`, to the last bits."""
    for _ in range(200):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if function(middle) > 0.0:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high) if math.isfinite(low + high) else low


def find_between(excess: Excess, one: Floats, other: Floats) -> Floats:
    """Return the points (n,) between `one` and `other` at which `excess` changes its sign.

    NaN where it has the same sign at both, and where the tolerance was not met.
    """
    every = np.arange(one.size)
    first, last = excess(every, one), excess(every, other)
    points = np.full(one.shape, np.nan)
    index = every[np.sign(first) * np.sign(last) <= 0.0]
    ends = (one[index], first[index]), (other[index], last[index])
    points[index], _, taken = polish(excess, index, *ends)
    points[index[taken >= MAX_ITERATIONS]] = np.nan
    return points


def find_dip(excess: Excess, tried: Floats, values: Floats) -> tuple[Ends, Ends, NDArray[np.bool_]]:
    """Return brackets of roots between points tried at which `excess` has one sign, and where.

    The smallest `excess`, without sign, is searched for by golden sections between the neighbours
    of the smallest one tried, until one has the other sign. The bracket is from the lower
    neighbour, or from the last point below with the old sign.

    Parameters
    ----------
    excess : callable
    tried : ndarray, shape (m,)
        Points, increasing.
    values : ndarray, shape (m, k)
        Their values; NaN where there is none.
    """
    every = np.arange(values.shape[1])
    size = np.where(np.isfinite(values), np.abs(values), np.inf)
    place = np.argmin(size, axis=0)
    low, high = tried[np.maximum(place - 1, 0)], tried[np.minimum(place + 1, len(tried) - 1)]
    sign = np.sign(values[place, every])
    low_value = values[np.maximum(place - 1, 0), every]
    far, far_value = low.copy(), low_value.copy()
    found = np.zeros(every.size, dtype=np.bool_)
    one, other = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    rest = every[np.isfinite(low_value) & np.isfinite(values[place, every])]
    ends = np.full((2, every.size), np.nan)
    ends[:, rest] = excess(rest, one[rest]), excess(rest, other[rest])
    for _ in range(_SECTIONS):
        for at, value in ((other, ends[1]), (one, ends[0])):  # the lower one last
            passed = rest[value[rest] * sign[rest] <= 0.0]
            far[passed], far_value[passed], found[passed] = at[passed], value[passed], True
        rest = rest[~found[rest] & np.isfinite(ends[:, rest]).all(axis=0)]
        if not rest.size:
            break
        lower = np.abs(ends[0, rest]) < np.abs(ends[1, rest])
        down, up = rest[lower], rest[~lower]
        high[down], other[down], ends[1, down] = other[down], one[down], ends[0, down]
        low[up], low_value[up] = one[up], ends[0, up]
        one[up], ends[0, up] = other[up], ends[1, up]
        one[down] = high[down] - _GOLDEN * (high[down] - low[down])
        other[up] = low[up] + _GOLDEN * (high[up] - low[up])
        ends[0, down], ends[1, up] = excess(down, one[down]), excess(up, other[up])
    return (low, low_value), (far, far_value), found


def polish(
    excess: Excess, index: NDArray[np.intp], one: Ends, other: Ends
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return roots between two ends of other signs, what is left there, and the iterations.

    By Chandrupatla's method (Advances in Engineering Software 28, 1997, 145-149). `MAX_ITERATIONS`
    is what an element took that did not meet the tolerance.

    Parameters
    ----------
    excess : callable
    index : ndarray of int, shape (k,)
        The elements.
    one, other : tuple of ndarray, shape (k,)
        Points and values at both ends.
    """
    (a, fa), (b, fb) = ((x.copy(), f.copy()) for x, f in (one, other))
    c, fc = b.copy(), fb.copy()
    share = np.full(a.shape, 0.5)
    taken = np.full(a.shape, MAX_ITERATIONS, dtype=np.int64)
    rest = np.arange(index.size)
    for iteration in range(MAX_ITERATIONS):
        best = np.where(np.abs(fa) < np.abs(fb), a, b)
        width = np.abs(b - a)
        done = (width <= 2.0 * TOLERANCE * np.abs(best)) | (fa == 0.0) | (fb == 0.0)
        taken[rest[done[rest]]] = iteration
        rest = rest[~done[rest]]
        if not rest.size:
            break
        # Keep clear of the ends, so that the bracket shrinks from both sides.
        edge = TOLERANCE * np.abs(best[rest]) / width[rest]
        t = np.clip(share[rest], np.minimum(edge, 0.5), np.maximum(1.0 - edge, 0.5))
        at = a[rest] + t * (b - a)[rest]
        value = excess(index[rest], at)
        same = np.sign(value) == np.sign(fa[rest])
        c[rest], fc[rest] = np.where(same, a[rest], b[rest]), np.where(same, fa[rest], fb[rest])
        b[rest], fb[rest] = np.where(same, b[rest], a[rest]), np.where(same, fb[rest], fa[rest])
        a[rest], fa[rest] = at, value
        share[rest] = _choose_share(*(x[rest] for x in (a, fa, b, fb, c, fc)))
    best_is_a = np.abs(fa) < np.abs(fb)
    return np.where(best_is_a, a, b), np.where(best_is_a, fa, fb), taken


def _choose_share(a: Floats, fa: Floats, b: Floats, fb: Floats, c: Floats, fc: Floats) -> Floats:
    """Return where between `a` and `b` to go next: inverse quadratic if it is safe, else half."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        safe = (1.0 - np.sqrt(1.0 - xi) < phi) & (phi < np.sqrt(xi))
        alpha = (c - a) / (b - a)
        quadratic = fa / (fb - fa) * fc / (fb - fc) + alpha * fa / (fc - fa) * fb / (fc - fb)
        return np.where(safe & np.isfinite(quadratic), quadratic, 0.5)
