"""Searches for the least squares: bounds, robust losses, several starts, a budget of time.

All are calls of `scipy.optimize.least_squares`, by trust regions (M. A. Branch, T. F. Coleman,
Y. Li, *SIAM Journal on Scientific Computing* 21, 1999, 1-23).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import BozziniError, InputError
from .arrays import Floats

Loss = Literal["linear", "soft_l1", "huber"]
"""What of each misfit is summed; the robust ones count a large one less than by its square."""

ROBUST = 1.5
"""Scatters from which a robust loss counts a misfit less than by its square."""

OUT_OF_TIME = -3
"""Status of a search that used up its time."""


class OutOfTimeError(BozziniError):
    """A fit used up the time that it was given."""


class Clock:
    """Seconds of this process's own work that a fit may take; none are counted without a limit."""

    def __init__(self, limit: float | None = None) -> None:
        self.limit = math.inf if limit is None else limit
        self._begin = time.process_time()

    @property
    def is_over(self) -> bool:
        """Whether the time is used up."""
        return time.process_time() - self._begin > self.limit


@dataclass(frozen=True, kw_only=True, eq=False)
class Minimum:
    """Where a search ended.

    Parameters
    ----------
    point : ndarray, shape (k,)
    misfit : ndarray, shape (n,)
        Misfits there.
    slope : ndarray, shape (n, k)
        Their derivatives; of a robust loss as SciPy scales them, the normal matrix that of the
        loss.
    cost : float
        Half the sum of squares, or of the loss.
    sides : ndarray of int, shape (k,)
        -1 at the lower bound, 1 at the upper, 0 between.
    status : int
        As of SciPy, or `OUT_OF_TIME`.
    evaluations : int
        How often all misfits were computed, numeric derivatives apart.
    """

    point: Floats
    misfit: Floats
    slope: Floats
    cost: float
    sides: NDArray[np.int64]
    status: int
    evaluations: int

    @property
    def converged(self) -> bool:
        """Whether it is a minimum, to the tolerances."""
        return self.status > 0


@dataclass(frozen=True, kw_only=True, eq=False)
class LeastSquares:
    """Misfits whose squares are made small, and how.

    Parameters
    ----------
    misfit : callable
        Returns misfits (n,) at a point (k,).
    slope : callable, optional
        Returns their derivatives (n, k); without it they are differences to one side.
    bounds : tuple
        Smallest and largest values, a number or (k,) each.
    margin : float
        Share of the range between bounds, finite ones, by which a start is kept off them.
    scale : ndarray, float or "jac"
        How much of each unknown matters; "jac" takes it from the derivatives.
    loss : {"linear", "soft_l1", "huber"}
    loss_scale : float
        Misfit from which a robust loss counts less than the square.
    xtol, ftol, gtol : float
        Relative changes of the point and of the cost, and the gradient, that count as none.
    clock : Clock, optional
        When a search is stopped: at the best point until then. There is one evaluation at least.
    """

    misfit: Callable[[Floats], Floats]
    slope: Callable[[Floats], Floats] | None = None
    bounds: tuple[Floats | float, Floats | float] = (-math.inf, math.inf)
    margin: float = 0.0
    scale: Floats | float | Literal["jac"] = 1.0
    loss: Loss = "linear"
    loss_scale: float = 1.0
    xtol: float = 1e-8
    ftol: float = 1e-8
    gtol: float = 1e-8
    clock: Clock | None = None

    def descend(self, start: Floats, *, evaluations: int | None = None) -> Minimum:
        """Return where the search from a start (k,) ends, after so many evaluations at most.

        Raises
        ------
        InputError
            If a derivative is not finite.
        """
        if self.margin:
            low, high = (np.asarray(side, dtype=np.float64) for side in self.bounds)
            margin = self.margin * (high - low)
            start = np.clip(start, low + margin, high - margin)
        best: list[tuple[float, Floats]] = []
        count = 0

        def ask(point: Floats) -> Floats:
            nonlocal count
            if self.clock is None:
                return self.misfit(point)
            if best and self.clock.is_over:
                raise OutOfTimeError("the time of the fit is used up")
            values, count = self.misfit(point), count + 1
            cost = sum_loss(values / self.loss_scale, self.loss)
            if not best or cost < best[0][0]:
                best[:] = [(cost, np.array(point))]
            return values

        try:
            return self._call(ask, start, evaluations)
        except OutOfTimeError:
            end = self._call(self.misfit, best[0][1], 1)
            return replace(end, status=OUT_OF_TIME, evaluations=count)

    def search(
        self,
        starts: Iterable[Floats],
        *,
        evaluations: int | None = None,
        trial: int | None = None,
        enough: Callable[[Minimum], bool] | None = None,
    ) -> Minimum:
        """Return the least of the minima from several starts; `evaluations` counts them all.

        Parameters
        ----------
        starts : iterable of ndarray, shape (k,)
        evaluations : int, optional
            Largest number of them of one search.
        trial : int, optional
            The same from each start; the best of them goes on, then.
        enough : callable, optional
            Whether no other start is tried after a minimum.
        """
        ends: list[Minimum] = []
        for start in starts:
            ends.append(self.descend(start, evaluations=trial or evaluations))
            if enough is not None and enough(ends[-1]):
                break
        best = min(ends, key=lambda end: end.cost)
        if trial:
            best = self.descend(best.point, evaluations=evaluations)
            ends.append(best)
        return replace(best, evaluations=sum(end.evaluations for end in ends))

    def _call(
        self, misfit: Callable[[Floats], Floats], start: Floats, evaluations: int | None
    ) -> Minimum:
        from scipy.optimize import least_squares

        try:
            found = least_squares(
                misfit,
                start,
                jac="2-point" if self.slope is None else self.slope,
                bounds=self.bounds,
                x_scale=self.scale,
                loss=self.loss,
                f_scale=self.loss_scale,
                xtol=self.xtol,
                ftol=self.ftol,
                gtol=self.gtol,
                max_nfev=evaluations,
            )
        except ValueError as error:
            if "infs or NaNs" not in str(error):  # as the singular value decomposition says it
                raise
            raise InputError("a derivative of the misfits is not finite on the way") from None
        return Minimum(
            point=np.asarray(found.x),
            misfit=np.asarray(found.fun),
            slope=np.asarray(found.jac),
            cost=float(found.cost),
            sides=np.asarray(found.active_mask, dtype=np.int64),
            status=int(found.status),
            evaluations=int(found.nfev),
        )


def weigh(misfit: Floats, loss: Loss) -> tuple[Floats, Floats]:
    """Return the influence of a misfit over its scale by the misfit, and the slope of it.

    The influence is the derivative of the loss by the misfit (Huber 1981, *Robust Statistics*).
    """
    if loss == "soft_l1":
        square = 1.0 + misfit**2
        return 1.0 / np.sqrt(square), square**-1.5
    if loss == "huber":
        size = np.abs(misfit)
        return 1.0 / np.maximum(size, 1.0), (size <= 1.0).astype(np.float64)
    return np.ones(len(misfit)), np.ones(len(misfit))


def sum_loss(misfit: Floats, loss: Loss) -> float:
    """Return the sum of the loss of misfits over its scale."""
    square = misfit**2
    if loss == "soft_l1":
        square = 2.0 * (np.sqrt(1.0 + square) - 1.0)
    if loss == "huber":
        square = np.where(square <= 1.0, square, 2.0 * np.abs(misfit) - 1.0)
    return float(square.sum())


def measure_scatter(misfit: Floats) -> float:
    """Return the standard deviation of most misfits: 1.4826 of the median of their sizes."""
    return 1.4826 * float(np.median(np.abs(misfit)))


def explain_end(status: int, evaluations: int, *, what: str = "parameters") -> str:
    """Return why a search of so many evaluations at most ended."""
    if status == OUT_OF_TIME:
        return "stopped: the time of the fit is used up"
    if status <= 0:
        return f"no minimum within {evaluations} evaluations"
    reasons = {1: "the gradient vanished", 2: "the sum of squares settled"}
    return reasons.get(status, f"the {what} settled")


def describe_bounds(names: Sequence[str], at: NDArray[np.bool_]) -> list[str]:
    """Return a sentence for each parameter that is at a bound."""
    return [
        f"{name} is at its bound, where its interval does not hold"
        for name, held in zip(names, at, strict=True)
        if held
    ]
