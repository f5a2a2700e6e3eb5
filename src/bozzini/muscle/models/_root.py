"""Where a force falls to a load: the equilibrium that a muscle at its free length moves to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MAX_ITERATIONS", "STEPS", "Roots", "find_between", "find_roots"]

Floats = NDArray[np.float64]
Excess = Callable[[NDArray[np.intp], Floats], Floats]

STEPS = 64
"""Lengths tried between the free length and the end of the legal ones."""
MAX_ITERATIONS = 100

_TOLERANCE = 4.0 * float(np.finfo(np.float64).eps)
_JUMP = 1e-6  # of the forces at the ends of a bracket: more is left over only where a force jumps


@dataclass(frozen=True, eq=False)
class Roots:
    """What `find_roots` found, arrays of shape (n,).

    Attributes
    ----------
    lengths : ndarray
        The roots [mm]; where there is none, the last length tried.
    residuals : ndarray
        Pull less load there [N].
    iterations : ndarray of int
    found : ndarray of bool
        Whether pull less load changes sign on the way.
    jumps : ndarray of bool
        Whether it does so without passing zero.
    """

    lengths: Floats
    residuals: Floats
    iterations: NDArray[np.int64]
    found: NDArray[np.bool_]
    jumps: NDArray[np.bool_]


def find_roots(excess: Excess, start: Floats, low: Floats, high: Floats) -> Roots:
    """Return the first root on the way down from `start` where `excess` is positive, up otherwise.

    `STEPS` lengths on the way bracket it; two roots between neighbours are missed. Then by
    Chandrupatla's method (Advances in Engineering Software 28, 1997, 145-149).

    Parameters
    ----------
    excess : callable
        Pull less load [N] of elements ``index`` (k,) at lengths (k,) [mm].
    start, low, high : ndarray, shape (n,)
        Where to begin, and the ends of the way [mm].
    """
    every = np.arange(start.size)
    first = excess(every, start)
    ends = np.where(first > 0.0, low, high)
    lengths, residuals = start.copy(), first.copy()
    found = first == 0.0
    near, near_excess = start.copy(), first.copy()
    far, far_excess = start.copy(), first.copy()
    open_ones = every[~found]
    for step in range(1, STEPS + 1):
        if not open_ones.size:
            break
        at = start[open_ones] + (ends - start)[open_ones] * (step / STEPS)
        if step == STEPS:
            at = ends[open_ones]
        value = excess(open_ones, at)
        far[open_ones], far_excess[open_ones] = at, value
        crossed = value * np.sign(first[open_ones]) <= 0.0
        found[open_ones[crossed]] = True
        near[open_ones[~crossed]], near_excess[open_ones[~crossed]] = at[~crossed], value[~crossed]
        open_ones = open_ones[~crossed]
    lengths[open_ones], residuals[open_ones] = far[open_ones], far_excess[open_ones]
    flat = every[found & (first != 0.0) & (far_excess == 0.0)]
    far[flat], far_excess[flat] = _find_edge(excess, flat, near[flat], near_excess[flat], far[flat])
    bracketed = every[found & (first != 0.0)]
    iterations = np.zeros(start.size, dtype=np.int64)
    scale = np.maximum(np.abs(near_excess), np.abs(far_excess))
    best, left, taken = _polish(
        excess,
        bracketed,
        (far[bracketed], far_excess[bracketed]),
        (near[bracketed], near_excess[bracketed]),
    )
    lengths[bracketed], residuals[bracketed], iterations[bracketed] = best, left, taken
    jumps = found & (np.abs(residuals) > _JUMP * scale)
    return Roots(lengths, residuals, iterations, found, jumps)


def find_between(excess: Excess, one: Floats, other: Floats) -> Floats:
    """Return the lengths (n,) between `one` and `other` at which `excess` changes its sign [mm].

    NaN where it has the same sign at both. What `excess` takes and gives is as for `find_roots`.
    """
    every = np.arange(one.size)
    first, last = excess(every, one), excess(every, other)
    lengths = np.full(one.shape, np.nan)
    index = every[np.sign(first) * np.sign(last) <= 0.0]
    ends = ((one[index], first[index]), (other[index], last[index]))
    lengths[index], _, taken = _polish(excess, index, *ends)
    lengths[index[taken >= MAX_ITERATIONS]] = np.nan
    return lengths


def _find_edge(
    excess: Excess, index: NDArray[np.intp], near: Floats, near_excess: Floats, far: Floats
) -> tuple[Floats, Floats]:
    """Return the first length at which the excess is gone, where it stays at zero, and the excess.

    A pull that cannot fall below a threshold is flat there: the muscle stops where that begins.
    """
    near, far, left = near.copy(), far.copy(), np.zeros(far.shape)
    rest = np.arange(index.size)
    while rest.size:
        middle = 0.5 * (near + far)[rest]
        inside = (middle != near[rest]) & (middle != far[rest])
        rest, middle = rest[inside], middle[inside]
        value = excess(index[rest], middle)
        gone = value * np.sign(near_excess[rest]) <= 0.0
        far[rest[gone]], left[rest[gone]] = middle[gone], value[gone]
        near[rest[~gone]] = middle[~gone]
    return far, left


def _polish(
    excess: Excess,
    index: NDArray[np.intp],
    one: tuple[Floats, Floats],
    other: tuple[Floats, Floats],
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return roots between two ends of other signs, what is left there, and the iterations."""
    (a, fa), (b, fb) = ((x.copy(), f.copy()) for x, f in (one, other))
    c, fc = b.copy(), fb.copy()
    share = np.full(a.shape, 0.5)
    taken = np.full(a.shape, MAX_ITERATIONS, dtype=np.int64)
    rest = np.arange(index.size)
    for iteration in range(MAX_ITERATIONS):
        best_is_a = np.abs(fa) < np.abs(fb)
        best = np.where(best_is_a, a, b)
        width = np.abs(b - a)
        done = (width <= 2.0 * _TOLERANCE * np.abs(best)) | (fa == 0.0) | (fb == 0.0)
        taken[rest[done[rest]]] = iteration
        rest = rest[~done[rest]]
        if not rest.size:
            break
        # Keep clear of the ends, so that the bracket shrinks from both sides.
        edge = _TOLERANCE * np.abs(best[rest]) / width[rest]
        t = np.clip(share[rest], np.minimum(edge, 0.5), np.maximum(1.0 - edge, 0.5))
        at = a[rest] + t * (b - a)[rest]
        value = excess(index[rest], at)
        same = np.sign(value) == np.sign(fa[rest])
        c[rest] = np.where(same, a[rest], b[rest])
        fc[rest] = np.where(same, fa[rest], fb[rest])
        b[rest] = np.where(same, b[rest], a[rest])
        fb[rest] = np.where(same, fb[rest], fa[rest])
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
