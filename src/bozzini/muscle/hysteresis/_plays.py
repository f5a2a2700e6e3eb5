"""Sums of plays: what the three Prandtl-Ishlinskii operators share."""

from __future__ import annotations

from abc import abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_number, name_at
from ...errors import InputError
from . import _kernels
from .operator import LIMIT, HysteresisState, Operator, take_history

__all__ = ["PlaySum", "Plays", "SteppedPlaySum", "default_thresholds", "trace_plays"]

Floats = NDArray[np.float64]


class Plays(NamedTuple):
    """Plays ``H = max(lower(P), min(upper(P), H))`` and how they are added up.

    The edges (k, 3) are polynomials of the input, constant first; to the sum of `weights` (k,)
    times H come `slope` times the input and `offset`.
    """

    lower: Floats
    upper: Floats
    weights: Floats
    slope: float
    offset: float


class PlaySum(Operator):
    """An operator that is a weighted sum of plays."""

    @abstractmethod
    def _plays(self) -> Plays:
        """Return the plays."""

    @property
    def memory_size(self) -> int:
        """How many plays there are."""
        return len(self._plays().weights)

    def _advance(self, inputs: Floats, last: Floats, memory: Floats) -> Floats:
        return np.asarray(_kernels.run_plays(inputs, *self._plays(), memory))


class SteppedPlaySum(PlaySum):
    """A sum of plays that is inverted step by step, for want of a closed form."""

    @property
    @abstractmethod
    def _steepness(self) -> float:
        """A slope that the output has at least, whatever the plays do."""

    def invert_history(
        self,
        response: ArrayLike,
        *,
        between: tuple[float, float],
        initial: HysteresisState | None = None,
    ) -> Floats:
        """Return the inputs that give these outputs, sample by sample.

        The operator is continuous and increases with the input as long as the input goes one way,
        so each output has one input, which bisection finds to the last bits.

        Parameters
        ----------
        response : array_like, shape (..., n)
            Outputs in the order of time.
        between : tuple of float
            Smallest and largest input to look at.
        initial : HysteresisState, optional
            As in `run`.

        Raises
        ------
        InputError
            If the operator need not increase with its input, is not defined all over `between`, or
            gives none of the outputs there.
        """
        outputs = take_history("response", response)
        low = check_number("between[0]", between[0], low=-LIMIT, high=LIMIT)
        high = check_number("between[1]", between[1], low=low, high=LIMIT, low_open=True)
        if self._steepness <= 0.0:
            raise InputError(
                f"this operator has no inverse for certain: its slope is at least "
                f"{self._steepness:g}, from the plays that never stick: it must be above 0"
            )
        batch = outputs.shape[:-1]
        state = self.rest() if initial is None else self._take_state(initial, batch)
        self._check_history(np.array([low, high]), None if initial is None else state.last)
        rows = int(np.prod(batch, dtype=np.int64))
        flat = np.ascontiguousarray(outputs.reshape(rows, outputs.shape[-1]))
        memory = np.array(np.broadcast_to(state.memory, (*batch, self.memory_size)))
        memory = memory.reshape(rows, self.memory_size)
        inputs, row, sample, bottom, top = _kernels.invert_plays(
            flat, *self._plays(), memory, low, high
        )
        if row >= 0:
            index = row * flat.shape[1] + sample
            raise InputError(
                f"{name_at('response', outputs, index)} is {outputs.flat[index]:g}: between inputs "
                f"of {low:g} and {high:g} it must lie in [{bottom:g}, {top:g}]"
            )
        return np.asarray(inputs.reshape(outputs.shape))


def trace_plays(inputs: Floats, lower: Floats, upper: Floats) -> Floats:
    """Return the positions of plays (m, n, k) along inputs (m, n), from rest at 0."""
    return np.asarray(
        _kernels.trace_plays(inputs, lower, upper, np.zeros((len(inputs), len(lower))))
    )


def default_thresholds(inputs: Floats, count: int) -> tuple[float, ...]:
    """Return thresholds from 0, evenly spaced, up to half the span of the inputs: not included.

    A play that is wider never moves again once it has been at both ends.
    """
    span = float(inputs.max() - inputs.min())
    return tuple((0.5 * span * np.arange(count) / count).tolist())
