"""What a fit of hysteresis to loops reports, and the bounded linear least squares under all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["HysteresisFit", "LinearFit", "fit_linear"]

Floats = NDArray[np.float64]
Fitted = TypeVar("Fitted")

_TOLD = 1e-7  # singular values below this share of the largest tell nothing
_SHARE = 1e-4  # of a parameter in what nothing tells, for it to be named


@dataclass(frozen=True, eq=False)
class HysteresisFit(Generic[Fitted]):
    """What came of a fit.

    Attributes
    ----------
    operator : Operator
        The operator fitted.
    residual : (..., n) ndarray
        Response less the operator's output, at all samples, in the unit of the response.
    deviation : float
        Root mean square of the residual over the samples fitted.
    converged : bool
        Whether the search met its tolerance.
    reason : str
        Why it stopped where it did not converge; empty where it did.
    evaluations : int
        How often the search computed a residual; 1 where the problem is linear.
    undetermined : tuple of str
        Parameters that these histories do not tell, alone or among each other: other values fit as
        well.
    """

    operator: Fitted
    residual: Floats
    deviation: float
    converged: bool
    reason: str
    evaluations: int
    undetermined: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Solution of bounded linear least squares: see `fit_linear`."""

    values: tuple[float, ...]
    offset: float
    residual: Floats
    converged: bool
    reason: str
    undetermined: tuple[str, ...]
    evaluations: int = 1


def fit_linear(
    columns: Floats,
    target: Floats,
    *,
    names: Sequence[str],
    low: float | Floats = 0.0,
    high: float | Floats = np.inf,
    offset: bool = True,
    judge: bool = True,
) -> LinearFit:
    """Fit ``columns @ values + offset`` to a target, with bounds on the values.

    Parameters
    ----------
    columns : (n, k) ndarray
    target : (n,) ndarray
    names : sequence of str
        Of the values.
    low, high : float or (k,) ndarray
        Bounds of the values; a column that is constant tells nothing and gets the value nearest
        to 0.
    offset : bool
        Whether there is an offset; it has no bounds.
    judge : bool
        Whether to look for what is undetermined.
    """
    from scipy.optimize import lsq_linear

    count = columns.shape[1]
    lows = np.broadcast_to(np.asarray(low, dtype=np.float64), (count,))
    highs = np.broadcast_to(np.asarray(high, dtype=np.float64), (count,))
    values = np.clip(np.zeros(count), lows, highs)
    # An offset without bounds takes all that is constant: it is fitted to the means.
    middle = columns.mean(axis=0) if offset else np.zeros(count)
    mean = float(target.mean()) if offset else 0.0
    level = columns - middle
    scales = np.sqrt(np.square(level).sum(axis=0))
    told = scales > 1e-9 * np.sqrt(np.square(columns).sum(axis=0))
    converged, reason = True, ""
    doubtful = ~told
    if told.any():
        matrix = level[:, told] / scales[told]
        rest = target - mean - level @ np.where(told, 0.0, values)
        size = float(np.abs(rest).max()) or 1.0
        solution = lsq_linear(
            matrix,
            rest / size,
            bounds=(lows[told] * scales[told] / size, highs[told] * scales[told] / size),
            method="bvls",
            tol=1e-14,
            max_iter=10 * count + 100,
        )
        free = np.clip(solution.x * size / scales[told], lows[told], highs[told])
        at = solution.active_mask.astype(np.int64)  # -1 at the lower bound, 1 at the upper
        values[told] = np.choose(at + 1, (lows[told], free, highs[told]))
        converged = bool(solution.status > 0)
        reason = "" if converged else "bounded least squares ran out of iterations"
        if judge:
            _, sizes, directions = np.linalg.svd(matrix, full_matrices=len(matrix) < count)
            rank = int(np.count_nonzero(sizes > _TOLD * sizes[0]))
            doubtful[np.flatnonzero(told)] = (np.abs(directions[rank:]) > _SHARE).any(axis=0)
    constant = mean - float(middle @ values)
    return LinearFit(
        values=tuple(values.tolist()),
        offset=constant,
        residual=target - columns @ values - constant,
        converged=converged,
        reason=reason,
        undetermined=tuple(str(name) for name, lost in zip(names, doubtful, strict=True) if lost),
    )
