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
)
from ...errors import InputError
from ...results import Result


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


Floats = NDArray[np.float64]

LIMIT = 1e12
"""Largest legal size of an input or a constant, in any unit: a limit of the arithmetic."""


@dataclass(frozen=True, eq=False)
class HysteresisState:
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


class Operator(ABC):
    """A rate-independent map from a history of inputs to a history of outputs.

    Only the order of the inputs counts, not their timing: a sample more on the way between two
    others changes nothing at those. All act along the last axis, over any leading ones.

    ``identify(history, response, skip=0)`` of a subclass fits it to measured loops. `history` has
    the inputs in the order of time, (..., n), each history from rest, and `response` the outputs
    measured, of the same shape. The first `skip` samples of each history only move the memory. It
    raises `InputError` if these are not finite arrays of one shape, the history is constant, or an
    option is out of its range.
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
        flat, size = list_rows(inputs), self.memory_size
        last = np.array(np.broadcast_to(state.last, batch)).reshape(len(flat))
        memory = np.array(np.broadcast_to(state.memory, (*batch, size))).reshape(len(flat), size)
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
            raise InputError(f"{name}[{i}] is {two:g}: it must be above {one:g}, the one before it")
    return numbers


def take_same_count(
    first: str, one: tuple[float, ...], second: str, two: tuple[float, ...]
) -> None:
    """Raise `InputError` unless two sequences are of one length."""
    if len(one) != len(two):
        raise InputError(f"{second} has {len(two)} number(s): it must have {len(one)}, as {first}")


Fitted = TypeVar("Fitted")

_SIGNIFICANT = 1e-7  # singular values below this share of the largest determine nothing
_SHARE = 1e-4  # of a parameter in what nothing determines, for it to be named


@dataclass(frozen=True, eq=False)
class HysteresisFit(Result, Generic[Fitted]):
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
        Parameters that these histories do not determine, alone or among each other: other values
        fit as well.
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
    limits: tuple[float | Floats, float | Floats] = (0.0, np.inf),
    offset: bool = True,
    judge: bool = True,
) -> LinearFit:
    """Fit ``columns @ values + offset`` (n,) to a target, with bounds on the values (k,).

    A constant column determines nothing and gets the value nearest to 0. The offset, if there is
    one, has no bounds. With `judge` the names of values that are undetermined are looked for.
    """
    from scipy.optimize import lsq_linear

    count = columns.shape[1]
    lows = np.broadcast_to(np.asarray(limits[0], dtype=np.float64), (count,))
    highs = np.broadcast_to(np.asarray(limits[1], dtype=np.float64), (count,))
    values = np.clip(np.zeros(count), lows, highs)
    # An offset without bounds takes all that is constant: it is fitted to the means.
    middle = columns.mean(axis=0) if offset else np.zeros(count)
    mean = float(target.mean()) if offset else 0.0
    level = columns - middle
    scales = np.sqrt(np.square(level).sum(axis=0))
    varying = scales > 1e-9 * np.sqrt(np.square(columns).sum(axis=0))
    converged, reason = True, ""
    doubtful = ~varying
    if varying.any():
        matrix = level[:, varying] / scales[varying]
        rest = target - mean - level @ np.where(varying, 0.0, values)
        size = float(np.abs(rest).max()) or 1.0
        solution = lsq_linear(
            matrix,
            rest / size,
            bounds=(
                lows[varying] * scales[varying] / size,
                highs[varying] * scales[varying] / size,
            ),
            method="bvls",
            tol=1e-14,
            max_iter=10 * count + 100,
        )
        free = np.clip(solution.x * size / scales[varying], lows[varying], highs[varying])
        at = solution.active_mask.astype(np.int64)  # -1 at the lower bound, 1 at the upper
        values[varying] = np.choose(at + 1, (lows[varying], free, highs[varying]))
        converged = bool(solution.status > 0)
        reason = "" if converged else "bounded least squares ran out of iterations"
        if judge:
            _, sizes, directions = np.linalg.svd(matrix, full_matrices=len(matrix) < count)
            rank = int(np.count_nonzero(sizes > _SIGNIFICANT * sizes[0]))
            doubtful[np.flatnonzero(varying)] = (np.abs(directions[rank:]) > _SHARE).any(axis=0)
    constant = mean - float(middle @ values)
    return LinearFit(
        values=tuple(values.tolist()),
        offset=constant,
        residual=target - columns @ values - constant,
        converged=converged,
        reason=reason,
        undetermined=tuple(str(name) for name, lost in zip(names, doubtful, strict=True) if lost),
    )


FittedOperator = TypeVar("FittedOperator", bound=Operator)

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
        """Return loops, checked."""
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
        return list_rows(self.history)

    @property
    def target(self) -> Floats:
        """The responses to be fitted, one after the other."""
        return self.response[..., self.skip :].ravel()

    def pick(self, columns: Floats) -> Floats:
        """Return columns (m, n, k) at the samples to be fitted (m (n - skip), k)."""
        return columns[:, self.skip :].reshape(-1, columns.shape[-1])

    def distinguish(self, weight: float) -> bool:
        """Whether plays of this weight, 0 or more, can make a difference to the responses."""
        return weight * float(np.ptp(self.history)) > _FLAT * float(np.ptp(self.target))

    def report(
        self, operator: FittedOperator, found: LinearFit, *, lost: tuple[str, ...] = ()
    ) -> HysteresisFit[FittedOperator]:
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
    """Return the best parameters on which columns (n, k) depend, from several starts.

    What is linear in the columns is solved within, by `fit_linear` with the options.
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
