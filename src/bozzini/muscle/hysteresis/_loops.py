"""Measured loops as the fits take them: histories (m, n) and what is fitted of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_integer
from ...errors import InputError
from .fit import HysteresisFit, LinearFit, fit_linear
from .operator import Operator, take_history

__all__ = ["EVALUATIONS", "Loops", "search"]

Floats = NDArray[np.float64]
Fitted = TypeVar("Fitted", bound=Operator)

EVALUATIONS = 100
"""Largest number of evaluations of one search."""

_FLAT = 1e-8  # what plays add at most, in spans of the response, below which it is of rounding


@dataclass(frozen=True, eq=False)
class Loops:
    """Histories and responses, one shape, of which the first `skip` samples are not fitted."""

    history: Floats
    response: Floats
    skip: int

    @classmethod
    def take(cls, history: ArrayLike, response: ArrayLike, skip: int) -> Loops:
        """Return loops, checked.

        Raises
        ------
        InputError
            If they are not finite arrays of one shape, the history does not move, or nothing is
            left to fit.
        """
        inputs = take_history("history", history)
        outputs = take_history("response", response)
        if inputs.shape != outputs.shape:
            raise InputError(f"response has shape {outputs.shape}: it must be {inputs.shape}")
        if inputs.size == 0:
            raise InputError(f"history has shape {inputs.shape}: it must have at least 2 samples")
        skip = check_integer("skip", skip, low=0, high=max(0, inputs.shape[-1] - 2))
        if inputs.max() == inputs.min():
            raise InputError(f"history is {inputs.flat[0]:g} all along: it must change")
        return cls(inputs, outputs, skip)

    @property
    def inputs(self) -> Floats:
        """The histories as rows (m, n)."""
        return np.ascontiguousarray(self.history.reshape(-1, self.history.shape[-1]))

    @property
    def target(self) -> Floats:
        """The responses to be fitted, one after the other."""
        return self.response[..., self.skip :].ravel()

    def pick(self, columns: Floats) -> Floats:
        """Return columns (m, n, k) at the samples to be fitted (m (n - skip), k)."""
        return columns[:, self.skip :].reshape(-1, columns.shape[-1])

    def tells(self, weight: float) -> bool:
        """Whether plays of this weight, 0 or more, can make a difference to the responses."""
        return weight * float(np.ptp(self.history)) > _FLAT * float(np.ptp(self.target))

    def report(
        self, operator: Fitted, found: LinearFit, *, lost: tuple[str, ...] = ()
    ) -> HysteresisFit[Fitted]:
        """Return the fit, with the residual that the operator itself leaves."""
        residual = self.response - operator.apply(self.history)
        fitted = residual[..., self.skip :]
        return HysteresisFit(
            operator=operator,
            residual=residual,
            deviation=float(np.sqrt(np.mean(np.square(fitted)))),
            converged=found.converged,
            reason=found.reason,
            evaluations=found.evaluations,
            undetermined=(*found.undetermined, *lost),
        )


def search(
    columns_at: Callable[[Floats], Floats],
    target: Floats,
    starts: list[list[float]],
    bounds: tuple[ArrayLike, ArrayLike],
    **options: Any,
) -> tuple[Floats, LinearFit]:
    """Find parameters of which columns depend; what is linear in the columns is solved within.

    Parameters
    ----------
    columns_at : callable
        From parameters to columns (n, k).
    target : (n,) ndarray
    starts : list of list of float
        Where to begin; the best end counts.
    bounds : tuple of array_like
        Of the parameters.
    **options
        For `fit_linear`.
    """
    from scipy.optimize import least_squares

    scale = float(np.abs(target - target.mean()).max()) or 1.0

    def miss(point: Floats) -> Floats:
        return fit_linear(columns_at(point), target, judge=False, **options).residual / scale

    low, high = (np.asarray(side, dtype=np.float64) for side in bounds)
    best, evaluations = None, 0
    for start in starts:
        begin = np.clip(start, low + 1e-9 * (high - low), high - 1e-9 * (high - low))
        found = least_squares(
            miss, begin, bounds=(low, high), xtol=1e-12, ftol=1e-12, gtol=1e-14,
            x_scale="jac", max_nfev=EVALUATIONS,
        )  # fmt: skip
        evaluations += int(found.nfev)
        if best is None or found.cost < best.cost:
            best = found
    if best is None:
        raise InputError("a search needs at least one start")
    inner = fit_linear(columns_at(best.x), target, **options)
    stopped = "" if best.status > 0 else f"the search ran out of its {EVALUATIONS} evaluations"
    return np.asarray(best.x), replace(
        inner,
        converged=inner.converged and not stopped,
        reason="; ".join(word for word in (inner.reason, stopped) if word),
        evaluations=evaluations,
    )
