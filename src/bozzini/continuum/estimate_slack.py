"""Cables that may be slack or taut: what that adds to the covariance of an estimate.

Over the gap ``g`` of a cable, longer than its free length, all that is computed has a kink:
``y = y* + J (x - x*) + j u``, with ``u`` what of ``g = g* + a (x - x*)`` is on the other side than
the most likely state ``x*``. On each side the readings are linear, so what is known there is a
normal distribution, cut at ``g = 0``. Both have the same density on the cut, which weighs them: by
the share ``Phi`` on their side over the density ``phi`` at the cut. Mean squares about ``x*`` of
state and ``u`` follow in closed form, for each cable with the others as they are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..numeric.arrays import Floats

NEAR = 4.0
"""Gap of a cable that counts as taut or slack for sure, by its standard deviation."""
SLACK = 1e6
"""How much more compliant a slack cable is than a taut one."""
LEAST, ROUND_OFF = 0.1, 1e-12
"""Share of the variance of the side of the likeliest state that is left at least; of nothing."""


class Tangent(NamedTuple):
    """The linear equations of an equilibrium: of the segments and then of the tendons that hold.

    Attributes
    ----------
    matrix : (3 n + h, 3 n + h) ndarray
    right : (3 n + h, q) ndarray
        What the numbers of a state do.
    tendons : (h,) ndarray of int
    give : (h,) ndarray
        Compliances of these where they are taut [mm/N].
    gaps : (h,) ndarray
        By which they are longer than their free lengths [mm].
    tensions : (h,) ndarray
        [N].
    """

    matrix: Floats
    right: Floats
    tendons: NDArray[np.int64]
    give: Floats
    gaps: Floats
    tensions: Floats


class Kinks(NamedTuple):
    """Cables near the end of their slack.

    Attributes
    ----------
    gaps : (k,) ndarray
        Of the cables if they held nothing [mm]; below 0 they are slack.
    ways : (k, q) ndarray
        Derivatives of these by the state.
    solved : (3 n + h, q + k) ndarray
        Derivatives of rotations [rad] and tensions [N] by the state, and by gaps on the other side.
    """

    gaps: Floats
    ways: Floats
    solved: Floats


def find_kinks(tangent: Tangent, cables: NDArray[np.int64], covariance: Floats) -> Kinks | None:
    """Return the kinks of cables of which a covariance (q, q) leaves open whether they are taut."""
    held, count = np.flatnonzero(np.isin(tangent.tendons, cables)), tangent.right.shape[1]
    if not len(held):
        return None
    at, gaps, give = (
        held + len(tangent.matrix) - len(tangent.gaps),
        tangent.gaps[held],
        tangent.give,
    )
    matrix = tangent.matrix.copy()
    now = np.where(gaps > 0.0, give, SLACK * give)
    matrix[at, at] = -now
    units = np.eye(len(matrix))[:, at]
    solved = np.linalg.solve(matrix, np.concatenate([tangent.right, units], axis=1))
    solved, pulled = solved[:, :count], solved[:, count:]
    alone = np.diagonal(pulled[at])
    ways = -solved[at] / alone[:, None]
    firmer = 1.0 + (now - give) * alone
    gaps = np.where(gaps > 0.0, -tangent.tensions[held] * firmer / alone, gaps)
    jumps = pulled / firmer * np.where(gaps > 0.0, 1.0, -1.0)
    spread = np.sqrt(np.einsum("kq,qr,kr->k", ways, covariance, ways))
    near = np.abs(gaps) < NEAR * spread
    if not near.any():
        return None
    return Kinks(gaps[near], ways[near], np.concatenate([solved, jumps[:, near]], axis=1))


def spread_over_kinks(
    kinks: Kinks, prior: Floats, first: Floats, missed: Floats, slopes: Floats
) -> Floats:
    """Return the mean squares of a state and of the gaps on the other sides (q + k, q + k).

    Parameters
    ----------
    kinks : Kinks
    prior : (q, q) ndarray
        Covariance before the readings.
    first : (q,) ndarray
        Mean before the readings, less the most likely state.
    missed, slopes : (m,), (m, q + k) ndarray
        Of the readings at the most likely state, and by state and gaps, by their noise.
    """
    count, ways = len(first), kinks.ways
    normal = _update(prior, first, missed, slopes[:, :count])
    spread, crosses, squares = normal[1].copy(), np.zeros((count, len(ways))), []
    for k, (gap, way) in enumerate(zip(kinks.gaps.tolist(), ways, strict=True)):
        jump = slopes[:, count + k]
        bent = slopes[:, :count] + np.outer(jump, way)
        other = _update(prior, first, missed - jump * gap, bent)
        side = 1.0 if gap > 0.0 else -1.0
        here, there = _cut(*normal, gap, way, side), _cut(*other, gap, way, -side)
        share = 1.0 / (1.0 + math.exp(min(here[0] - there[0], 700.0)))
        spread += (1.0 - share) * here[1] + share * there[1] - normal[1]
        crosses[:, k] = share * there[2]
        squares.append(share * there[3])
    # Parts of several cables may add up to less than nothing: no direction is left so little.
    root = _find_root(normal[1])
    inner = np.linalg.solve(root, np.linalg.solve(root, spread).T)
    sizes, axes = np.linalg.eigh(0.5 * (inner + inner.T))
    root = root @ axes * np.sqrt(np.maximum(sizes, LEAST))
    bound = np.linalg.solve(root, crosses)
    sizes, axes = np.linalg.eigh(np.diag(squares) - bound.T @ bound)
    gaps = bound.T @ bound + axes * np.maximum(sizes, 0.0) @ axes.T
    return np.block([[root @ root.T, crosses], [crosses.T, gaps]])


def _find_root(covariance: Floats) -> Floats:
    """Return a factor of a covariance that is hardly singular."""
    scale = np.sqrt(np.diagonal(covariance))
    sizes, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * axes * np.sqrt(np.maximum(sizes, ROUND_OFF)))


def _update(prior: Floats, first: Floats, missed: Floats, slopes: Floats) -> tuple[Floats, Floats]:
    """Return mean and covariance after linear readings."""
    crossed = slopes @ prior
    inner = crossed @ slopes.T + np.eye(len(crossed))
    gain = np.linalg.solve(inner, crossed).T
    return first + gain @ (missed - slopes @ first), prior - gain @ crossed


def _cut(
    mean: Floats, covariance: Floats, gap: float, way: Floats, side: float
) -> tuple[float, Floats, Floats, float]:
    """Return of a normal distribution where the gap is on a side, 1 or -1: log of its weight.

    And mean squares of the state, of state and gap, and of the gap.
    """
    from scipy.special import log_ndtr

    along = covariance @ way
    variance = max(float(way @ along), 1e-300)
    spread = math.sqrt(variance)
    middle = gap + float(way @ mean)
    far = side * middle / spread
    inside = float(log_ndtr(far))
    weight = inside + 0.5 * far**2 + math.log(spread)
    ratio = math.exp(-0.5 * far**2 - 0.5 * math.log(2.0 * math.pi) - inside)
    shift = side * spread * ratio
    left = variance * max(1.0 - ratio * (ratio + far), 0.0)
    lever = along / variance
    centre = mean + lever * shift
    square = covariance + np.outer(lever, lever) * (left - variance) + np.outer(centre, centre)
    mean_gap = middle + shift
    return weight, square, centre * mean_gap + lever * left, left + mean_gap**2
