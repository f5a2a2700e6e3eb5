"""What all hysteresis operators share: histories in batches, memory in and out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array, check_number, check_range
from ...errors import InputError

__all__ = ["LIMIT", "HysteresisState", "Operator", "take_ladder", "take_numbers", "take_same_count"]

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


class Operator(ABC):
    """A rate-independent map from a history of inputs to a history of outputs.

    Only the order of the inputs counts, not their timing: a sample more on the way between two
    others changes nothing at those. All act along the last axis, over any leading ones.
    """

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
        count = int(np.prod(batch, dtype=np.int64))
        flat = np.ascontiguousarray(inputs.reshape(count, inputs.shape[-1]))
        size = self.memory_size
        last = np.array(np.broadcast_to(state.last, batch)).reshape(count)
        memory = np.array(np.broadcast_to(state.memory, (*batch, size))).reshape(count, size)
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


def take_ladder(
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
