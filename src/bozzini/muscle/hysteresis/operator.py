"""What all hysteresis operators share: histories in batches, memory, and fits to loops."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import (
    check_array,
    check_fields,
    check_integer,
    check_number,
    check_range,
    quantity,
    show_apart,
)
from ...errors import InputError
from ...numeric.arrays import Floats
from ...numeric.least_squares import LeastSquares, explain_end
from ...numeric.vectors import settle_layout
from ...results import Result, Shown

Fitted = TypeVar("Fitted", covariant=True)


@runtime_checkable
class Hysteresis(Protocol):
    """An operator with memory, from a history of pressures to the pressures that act.

    A model that carries one uses it in `MuscleModel.trace_contraction` only; `force`, `contraction`
    and `solve` have no history and leave it alone.
    """

    def apply(self, pressure: NDArray[np.float64], /) -> NDArray[np.float64]:
        """Return the pressures (n,) [MPa] that act, given the pressures (n,) in order of time.

        The operator starts anew at each call: its memory lives inside one history.
        """
        ...


LIMIT = 1e12
"""Largest legal size of an input or a constant, in any unit: a limit of the arithmetic."""


@dataclass(frozen=True, eq=False)
class HysteresisState(Shown):
    """What an operator remembers of the histories that it has seen.

    Parameters
    ----------
    last : (...) array_like
        The input at the end of each history.
    memory : (..., k) array_like
        The operator's inner variables: positions of plays, forces of elements, signs of relays.

    Raises
    ------
    InputError
        If they are not finite numbers, or their shapes do not go together.
    """

    last: Floats
    memory: Floats

    def __post_init__(self) -> None:
        for name in ("last", "memory"):
            array = np.array(check_array(name, getattr(self, name)))
            if not np.all(np.isfinite(array)):
                raise InputError(f"{name} of the state must be finite")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if self.memory.ndim == 0 or self.memory.shape[:-1] != self.last.shape:
            raise InputError(
                f"memory of the state has shape {self.memory.shape}: with last of shape "
                f"{self.last.shape} it must be {(*self.last.shape, 'k')}"
            )


def number(low: float = -LIMIT, high: float = LIMIT, **known: Any) -> Any:
    """Return a dataclass field that is a number; see `bozzini.checks.quantity`."""
    return quantity(low=low, high=high, **known)


def numbers(
    *, like: str = "", increasing: bool = False, default: object = MISSING, **limits: object
) -> Any:
    """Return a dataclass field that is a sequence of numbers, as many as `like` has.

    With `increasing` each is above the one before it; the limits are those of `take_numbers`.
    """
    metadata = {
        "take": take_increasing if increasing else take_numbers,
        "like": like,
        "limits": limits,
    }
    return field(default=default, metadata=metadata)


def take_fields(item: Any) -> None:
    """Check the fields of a dataclass made by `number` and `numbers`, and make them plain."""
    check_fields(item)
    known = [one for one in fields(item) if "take" in one.metadata]
    for one in known:
        given = one.metadata["take"](one.name, getattr(item, one.name), **one.metadata["limits"])
        object.__setattr__(item, one.name, given)
    for one in known:
        if like := one.metadata["like"]:
            take_same_count(like, getattr(item, like), one.name, getattr(item, one.name))


class Operator(Shown, ABC):
    """A rate-independent map from a history of inputs to a history of outputs.

    Only the order of the inputs counts, not their timing: a sample more on the way between two
    others changes nothing at those. All act along the last axis, over any leading ones.

    ``identify(history, response, *, options=None)`` of a subclass fits it to measured loops.
    `history` has the inputs in the order of time, (..., n), each history from rest, and `response`
    the outputs measured, of the same shape; the options are a `LoopOptions`. It raises
    `InputError` if these are not finite arrays of one shape, the history is constant, or an option
    is out of its range.
    """

    def __post_init__(self) -> None:
        take_fields(self)

    @property
    @abstractmethod
    def memory_size(self) -> int:
        """How many inner variables the operator has."""

    @property
    def rest_input(self) -> float:
        """Input at which the operator has never been moved."""
        return 0.0

    @property
    def rest_memory(self) -> float:
        """Value of all inner variables there."""
        return 0.0

    @classmethod
    @abstractmethod
    def identify(
        cls, history: ArrayLike, response: ArrayLike, *, options: LoopOptions | None = None
    ) -> HysteresisFit[Operator]:
        """Fit the operator to measured loops; see the class."""

    def rest(self, shape: tuple[int, ...] = ()) -> HysteresisState:
        """Return the state of an operator that has seen nothing, for histories ``(*shape, n)``."""
        return HysteresisState(
            np.full(shape, self.rest_input), np.full((*shape, self.memory_size), self.rest_memory)
        )

    def apply(self, history: ArrayLike, /) -> Floats:
        """Return the outputs along histories that begin at rest.

        Parameters
        ----------
        history : array_like, shape (..., n)
            Inputs in the order of time; each history has a memory of its own.

        Returns
        -------
        (..., n) ndarray
            Outputs. Nothing is remembered from one call to the next.

        Raises
        ------
        InputError
            As `run` does.
        """
        return self.run(history)[0]

    def run(
        self, history: ArrayLike, *, initial: HysteresisState | None = None
    ) -> tuple[Floats, HysteresisState]:
        """Return the outputs along histories, and what is remembered at their end.

        ``run(b, initial=run(a)[1])`` goes on where ``run(a)`` ended.

        Parameters
        ----------
        history : array_like, shape (..., n)
            Inputs in the order of time.
        initial : HysteresisState, optional
            Memory to begin with, one for all histories or one each; at rest without.

        Returns
        -------
        output : (..., n) ndarray
        state : HysteresisState
            Memory at the end of each history.

        Raises
        ------
        InputError
            If the history is no array of finite numbers of at least one axis, is outside the range
            on which the operator is defined, or `initial` is not a state of this operator.
        """
        inputs = take_history("history", history)
        batch = inputs.shape[:-1]
        state = self.rest() if initial is None else self._take_state(initial, batch)
        self._check_history(inputs, None if initial is None else state.last)
        flat, size = settle_layout(list_rows(inputs)), self.memory_size
        last = np.array(np.broadcast_to(state.last, batch)).reshape(len(flat))
        memory = np.array(np.broadcast_to(state.memory, (*batch, size)), order="C")
        memory = memory.reshape(len(flat), size)
        output = self._advance(flat, last, memory).reshape(inputs.shape)
        if inputs.shape[-1]:
            last = flat[:, -1]
        return output, HysteresisState(last.reshape(batch), memory.reshape(*batch, size))

    @abstractmethod
    def _advance(self, inputs: Floats, last: Floats, memory: Floats) -> Floats:
        """Outputs (m, n) along inputs (m, n), with `memory` (m, k) brought to their end."""

    def _check_history(self, inputs: Floats, last: Floats | None) -> None:  # noqa: B027  (optional)
        """Raise `InputError` where the operator is not defined on these inputs (..., n)."""

    def _check_memory(self, memory: Floats) -> None:  # noqa: B027  (optional)
        """Raise `InputError` if no history leads to this memory (..., k)."""

    def _take_state(self, state: HysteresisState, batch: tuple[int, ...]) -> HysteresisState:
        if not isinstance(state, HysteresisState):
            raise InputError(f"initial is a {type(state).__name__}: it must be a HysteresisState")
        if state.memory.shape[-1] != self.memory_size or state.last.shape not in ((), batch):
            raise InputError(
                f"initial has last {state.last.shape} and memory {state.memory.shape}: for these "
                f"histories it needs {batch} and {(*batch, self.memory_size)}, or () and "
                f"{(self.memory_size,)}"
            )
        check_range("last of the initial state", state.last, -LIMIT, LIMIT)
        self._check_memory(state.memory)
        return state


class InvertibleOperator(Operator):
    """An operator that increases with its input along the way, and so has an inverse."""

    @abstractmethod
    def invert_history(
        self,
        response: ArrayLike,
        *,
        between: tuple[float, float],
        initial: HysteresisState | None = None,
        clip: bool = False,
    ) -> Floats:
        """Return the inputs that give these outputs, sample by sample.

        Parameters
        ----------
        response : array_like, shape (..., n)
            Outputs in the order of time.
        between : tuple of float
            Smallest and largest input to look at.
        initial : HysteresisState, optional
            As in `run`.
        clip : bool
            Whether an output that is out of reach gets the nearest end of `between`, from where it
            goes on; it is an error without.

        Raises
        ------
        InputError
            If the operator need not increase with its input, is not defined all over `between`, or
            gives none of the outputs there and `clip` is not set.
        """


def list_rows(histories: Floats) -> Floats:
    """Return histories (..., n) as rows (m, n)."""
    count = int(np.prod(histories.shape[:-1], dtype=np.int64))
    return np.ascontiguousarray(histories.reshape(count, histories.shape[-1]))


def take_history(name: str, history: ArrayLike) -> Floats:
    """Return a history (..., n) of finite numbers, or raise `InputError`."""
    inputs = check_array(name, history)
    if inputs.ndim == 0:
        raise InputError(f"{name} is a single number: it must be an array of shape (..., n)")
    check_range(name, inputs, -LIMIT, LIMIT)
    return inputs


def take_numbers(
    name: str,
    values: Iterable[float],
    *,
    low: float = -LIMIT,
    high: float = LIMIT,
    low_open: bool = False,
    empty: bool = False,
) -> tuple[float, ...]:
    """Return numbers in a range as a tuple, or raise `InputError` that names the first outside."""
    if isinstance(values, (str, bytes)) or not isinstance(values, Iterable):
        raise InputError(f"{name} is {values!r}: it must be a sequence of numbers")
    numbers = tuple(
        check_number(f"{name}[{i}]", value, low=low, high=high, low_open=low_open)
        for i, value in enumerate(values)
    )
    if not numbers and not empty:
        raise InputError(f"{name} is empty: it must have at least one number")
    return numbers


def take_increasing(
    name: str, values: Iterable[float], *, low: float = 0.0, low_open: bool = False
) -> tuple[float, ...]:
    """Return numbers that increase from one to the next as a tuple, or raise `InputError`."""
    numbers = take_numbers(name, values, low=low, low_open=low_open)
    for i, (one, two) in enumerate(zip(numbers, numbers[1:], strict=False), start=1):
        if two <= one:
            shown = show_apart(two, one)
            raise InputError(
                f"{name}[{i}] is {shown[0]}: it must be above {shown[1]}, the one before it"
            )
    return numbers


def take_same_count(
    first: str, one: tuple[float, ...], second: str, two: tuple[float, ...]
) -> None:
    """Raise `InputError` unless two sequences are of one length."""
    if len(one) != len(two):
        raise InputError(f"{second} has {len(two)} number(s): it must have {len(one)}, as {first}")


Limits = tuple[float | Floats, float | Floats]


_SIGNIFICANT = 1e-7  # singular values below this share of the largest determine nothing
_SHARE = 1e-4  # of a parameter in what nothing determines, for it to be named


@dataclass(frozen=True, eq=False)
class LoopOptions(Shown):
    """How an operator is fitted to loops.

    Parameters
    ----------
    skip : int
        The first samples of each history that only move the memory and are not fitted.
    carried : bool
        Whether a muscle is to carry the operator: its output is 0 at rest, at an input of 0, and
        never negative where the inputs are not.
    weights : (..., n) array_like, optional
        What the residual of each sample is multiplied by, 0 or more; 1 without.
    terms : (..., n, k) array_like, optional
        Other causes of the response, such as a drift: each is fitted besides with a factor of any
        sign, and is no part of the operator.
    start : Operator, optional
        One of the same class for a search to begin at: `BoucWen` has one. Without, it begins at
        several places.
    """

    skip: int = 0
    carried: bool = False
    weights: ArrayLike | None = None
    terms: ArrayLike | None = None
    start: Operator | None = None


@dataclass(frozen=True, eq=False)
class HysteresisFit(Result, Generic[Fitted]):
    """What came of a fit.

    Attributes
    ----------
    operator : Operator
        The operator fitted.
    residual : (..., n) ndarray
        Response less the operator's output and the terms, at all samples, in the unit of the
        response.
    deviation : float
        Root mean square of the residual over the samples fitted, by their weights.
    converged : bool
        Whether the search met its tolerance.
    reason : str
        Why it stopped where it did not converge; empty where it did.
    evaluations : int
        How often the search computed a residual; 1 where the problem is linear.
    undetermined : tuple of str
        Parameters that these histories do not determine, alone or among each other: other values
        fit as well.
    terms : tuple of float
        Factors of `LoopOptions.terms`.
    """

    operator: Fitted
    residual: Floats
    deviation: float
    converged: bool
    reason: str
    evaluations: int
    undetermined: tuple[str, ...]
    terms: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Solution of bounded linear least squares: see `fit_linear`."""

    values: tuple[float, ...]
    free: tuple[float, ...]
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
    limits: Limits = (0.0, np.inf),
    free: Floats | None = None,
    judge: bool = True,
) -> LinearFit:
    """Fit ``columns @ values + free @ factors`` (n,) to a target, with bounds on the values (k,).

    A column that the free ones make up determines nothing and gets the value nearest to 0. With
    `judge` the names of values that are undetermined are looked for.
    """
    from scipy.optimize import lsq_linear

    count = columns.shape[1]
    lows = np.broadcast_to(np.asarray(limits[0], dtype=np.float64), (count,))
    highs = np.broadcast_to(np.asarray(limits[1], dtype=np.float64), (count,))
    values = np.clip(np.zeros(count), lows, highs)
    # What has no bounds is projected out, and the rest made as small as it has columns.
    others = np.empty((len(target), 0)) if free is None else free
    sides, sizes, _ = np.linalg.svd(others, full_matrices=False)
    sides = sides[:, sizes > 1e-12 * sizes.max(initial=0.0)]
    level = columns - sides @ (sides.T @ columns)
    scales = np.sqrt(np.square(level).sum(axis=0))
    varying = scales > 1e-9 * np.sqrt(np.square(columns).sum(axis=0))
    converged, reason = True, ""
    doubtful = ~varying
    if varying.any():
        rest = target - level @ np.where(varying, 0.0, values)
        rest = rest - sides @ (sides.T @ rest)
        size = float(np.abs(rest).max()) or 1.0
        both = np.column_stack([level[:, varying] / scales[varying], rest / size])
        small: Floats = np.asarray(np.linalg.qr(both, mode="r"))
        matrix = small[:, :-1]
        solution = lsq_linear(
            matrix,
            small[:, -1],
            bounds=(
                lows[varying] * scales[varying] / size,
                highs[varying] * scales[varying] / size,
            ),
            method="bvls",
            tol=1e-14,
            max_iter=10 * count + 100,
        )
        found = np.clip(solution.x * size / scales[varying], lows[varying], highs[varying])
        at = solution.active_mask.astype(np.int64)  # -1 at the lower bound, 1 at the upper
        values[varying] = np.choose(at + 1, (lows[varying], found, highs[varying]))
        converged = bool(solution.status > 0)
        reason = "" if converged else "bounded least squares ran out of iterations"
        if judge:
            _, sizes, directions = np.linalg.svd(matrix)
            rank = int(np.count_nonzero(sizes > _SIGNIFICANT * sizes[0]))
            doubtful[np.flatnonzero(varying)] = (np.abs(directions[rank:]) > _SHARE).any(axis=0)
    left = target - columns @ values
    factors = np.linalg.lstsq(others, left, rcond=1e-12)[0]
    return LinearFit(
        values=tuple(values.tolist()),
        free=tuple(factors.tolist()),
        residual=left - others @ factors,
        converged=converged,
        reason=reason,
        undetermined=tuple(str(name) for name, lost in zip(names, doubtful, strict=True) if lost),
    )


FittedOperator = TypeVar("FittedOperator", bound=Operator)

EVALUATIONS = 100
"""Largest number of evaluations of one search."""
_TRIAL = 8  # evaluations of each of its starts, of which the best goes on

_STILL = 0.05  # of the range of the inputs fitted: a play that moves less hardly moves
_FLAT = 1e-8  # what plays add at most, in spans of the response, below which it is of rounding


@dataclass(frozen=True, eq=False)
class Loops:
    """Histories and responses, one shape, and how they are fitted."""

    history: Floats
    response: Floats
    skip: int
    carried: bool
    weights: Floats
    terms: Floats

    @classmethod
    def take(
        cls, history: ArrayLike, response: ArrayLike, options: LoopOptions | None = None
    ) -> Loops:
        """Return loops, checked."""
        options = LoopOptions() if options is None else options
        inputs = take_history("history", history)
        outputs = take_history("response", response)
        if inputs.shape != outputs.shape:
            raise InputError(f"response has shape {outputs.shape}: it must be {inputs.shape}")
        if inputs.size == 0:
            raise InputError(f"history has shape {inputs.shape}: it must have at least 2 samples")
        skip = check_integer("skip", options.skip, low=0, high=max(0, inputs.shape[-1] - 2))
        if inputs.max() == inputs.min():
            raise InputError(f"history is {inputs.flat[0]:g} all along: it must change")
        weights, terms = np.ones(inputs.shape), np.empty((*inputs.shape, 0))
        if options.weights is not None:
            weights = check_array("weights", options.weights)
            check_range("weights", weights, 0.0, LIMIT)
        if options.terms is not None:
            terms = check_array("terms", options.terms)
            check_range("terms", terms, -LIMIT, LIMIT)
        if weights.shape != inputs.shape or terms.shape[:-1] != inputs.shape:
            raise InputError(
                f"weights have shape {weights.shape} and terms {terms.shape}: they must be "
                f"{inputs.shape} and {(*inputs.shape, 'k')}"
            )
        if not weights[..., skip:].any():
            raise InputError("weights are 0 at all samples: one must be above 0")
        return cls(inputs, outputs, skip, bool(options.carried), weights, terms)

    @property
    def inputs(self) -> Floats:
        """The histories as rows (m, n)."""
        return list_rows(self.history)

    @property
    def fitted_inputs(self) -> Floats:
        """Those of them that are fitted, without the first ones (m, n - skip)."""
        return self.inputs[:, self.skip :]

    def find_still(self, plays: Floats) -> NDArray[np.bool_]:
        """Return which plays (m, n, k) hardly move over the samples fitted, (k,).

        They move by less than 5 % of the range of the inputs. A weight of theirs is that of next to
        nothing: it would make up for an offset, and be wrong where the play moves more.
        """
        moved = np.ptp(plays[:, self.skip :], axis=1).max(axis=0)
        return np.asarray(moved < _STILL * np.ptp(self.fitted_inputs))

    def leave_still(self, plays: Floats) -> Floats:
        """Return plays (m, n, k) with 0 in place of those that hardly move: these get no weight."""
        return np.where(self.find_still(plays), 0.0, plays)

    @property
    def target(self) -> Floats:
        """The responses to be fitted, one after the other, times their weights."""
        return self.pick(list_rows(self.response)[..., None])[:, 0]

    def pick(self, columns: Floats) -> Floats:
        """Return columns (m, n, k) at the samples to be fitted (m (n - skip), k), weighted."""
        weighted = columns * list_rows(self.weights)[..., None]
        kept = weighted[:, self.skip :]
        return np.asarray(kept.reshape(kept.shape[0] * kept.shape[1], kept.shape[2]))

    def pick_free(self, *, offset: bool = True) -> Floats:
        """Return the columns of what is free: an offset, unless it is known, and the terms."""
        kinds = [self.terms.reshape(*self.inputs.shape, -1)]
        kinds += [np.ones((*self.inputs.shape, 1))] if offset and not self.carried else []
        return self.pick(np.concatenate(kinds, axis=-1))

    def fit(
        self,
        columns: Floats,
        *,
        names: Sequence[str],
        limits: Limits = (0.0, np.inf),
        offset: bool = True,
        judge: bool = True,
    ) -> LinearFit:
        """Fit columns (m, n, k), an offset and the terms: see `fit_linear`."""
        free = self.pick_free(offset=offset)
        picked = self.pick(columns)
        return fit_linear(picked, self.target, names=names, limits=limits, free=free, judge=judge)

    def find_offset(self, found: LinearFit) -> float:
        """Return the offset of a fit that has one; 0 where it is known to be."""
        return 0.0 if self.carried else found.free[-1]

    def distinguish(self, weight: float) -> bool:
        """Whether plays of this weight, 0 or more, can make a difference to the responses."""
        span = float(np.ptp(self.response[..., self.skip :]))
        return weight * float(np.ptp(self.history)) > _FLAT * span

    def report(
        self, operator: FittedOperator, found: LinearFit, *, lost: tuple[str, ...] = ()
    ) -> HysteresisFit[FittedOperator]:
        """Return the fit, with the residual that the operator itself leaves."""
        factors = found.free[: self.terms.shape[-1]]
        residual = self.response - operator.apply(self.history) - self.terms @ np.array(factors)
        fitted: Floats = (self.weights * residual)[..., self.skip :]
        size = np.square(self.weights[..., self.skip :]).sum()
        return HysteresisFit(
            operator=operator,
            residual=residual,
            deviation=float(np.sqrt(np.square(fitted).sum() / size)),
            converged=found.converged,
            reason=found.reason,
            evaluations=found.evaluations,
            undetermined=(*found.undetermined, *lost),
            terms=tuple(factors),
        )

    def search(
        self,
        columns_at: Callable[[Floats], Floats],
        starts: list[list[float]],
        bounds: tuple[ArrayLike, ArrayLike],
        *,
        names: Sequence[str],
        limits: Limits = (0.0, np.inf),
    ) -> tuple[Floats, LinearFit]:
        """Return the best parameters on which columns (m, n, k) depend, from several starts.

        What is linear in the columns is solved within, by `fit` with the options.
        """
        target, free = self.target, self.pick_free()
        scale = float(np.abs(target - target.mean()).max()) or 1.0

        def solve(point: Floats, *, judge: bool = True) -> LinearFit:
            columns = self.pick(columns_at(point))
            return fit_linear(columns, target, names=names, limits=limits, free=free, judge=judge)

        def miss(point: Floats) -> Floats:
            return solve(point, judge=False).residual / scale

        low, high = (np.asarray(side, dtype=np.float64) for side in bounds)

        search = LeastSquares(
            misfit=miss, bounds=(low, high), margin=1e-9, scale="jac",
            xtol=1e-10, ftol=1e-8, gtol=1e-14,
        )  # fmt: skip
        begins = [np.asarray(start, dtype=np.float64) for start in starts]
        best = search.search(begins, evaluations=EVALUATIONS, trial=_TRIAL)
        inner = solve(best.point)
        stopped = "" if best.converged else explain_end(best.status, EVALUATIONS)
        return best.point, replace(
            inner,
            converged=inner.converged and not stopped,
            reason="; ".join(word for word in (inner.reason, stopped) if word),
            evaluations=best.evaluations,
        )
