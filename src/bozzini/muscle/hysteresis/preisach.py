"""Preisach: a weighted sum of relays, the W of (2.50)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array, check_integer, check_number, check_range
from ...errors import InputError
from . import _kernels
from ._loops import Loops
from .fit import HysteresisFit, fit_linear
from .operator import LIMIT, HysteresisState, Operator, take_ladder, take_numbers

__all__ = ["Preisach"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Preisach(Operator):
    """A weighted sum of relays, thesis section 2.2.10.

    After I. Mayergoyz, Mathematical Models of Hysteresis, 1991::

        output = sum of w_ij R_ij + offset

    The relay ``R_ij``, j <= i, turns to +1 as the input comes up to ``levels[i + 1]`` and to -1 as
    it comes down to ``levels[j]``. At rest, at the lowest level, all are -1. The output goes in
    steps, one at each level: more levels, finer steps.

    Parameters
    ----------
    levels : sequence of float
        L + 1 inputs, increasing, 1 to 200 steps between them.
    weights : sequence of float
        L (L + 1) / 2 weights in the order w_00, w_10, w_11, w_20 ...
    offset : float
        Output in the middle: half the sum of both saturations.

    Raises
    ------
    InputError
        If they are no such numbers.
    """

    levels: tuple[float, ...]
    weights: tuple[float, ...]
    offset: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        levels = take_ladder("levels", self.levels, low=-LIMIT)
        weights = take_numbers("weights", self.weights)
        steps = len(levels) - 1
        if not 1 <= steps <= 200:
            raise InputError(f"levels has {len(levels)} number(s): it must have 2 to 201")
        if len(weights) != steps * (steps + 1) // 2:
            raise InputError(
                f"weights has {len(weights)} number(s): with {len(levels)} levels it must have "
                f"{steps * (steps + 1) // 2}"
            )
        offset = check_number("offset", self.offset, low=-LIMIT, high=LIMIT)
        for name, value in (("levels", levels), ("weights", weights), ("offset", offset)):
            object.__setattr__(self, name, value)

    @property
    def memory_size(self) -> int:
        """How many relays there are; each remembers its sign."""
        return len(self.weights)

    @property
    def rest_input(self) -> float:
        """Input at rest: the lowest level."""
        return self.levels[0]

    @property
    def rest_memory(self) -> float:
        """Sign of all relays at rest."""
        return -1.0

    @property
    def saturation(self) -> tuple[float, float]:
        """Output with all relays off, and with all on."""
        total = sum(self.weights)
        return self.offset - total, self.offset + total

    def trace_major(self, input_: ArrayLike) -> tuple[Floats, Floats]:
        """Return both branches of the major loop, up from all off and down from all on.

        Parameters
        ----------
        input_ : array_like
            Inputs, any shape.

        Raises
        ------
        InputError
            If an input is not a finite number.
        """
        inputs = check_array("input", input_)
        check_range("input", inputs, -LIMIT, LIMIT)
        rows, columns = np.tril_indices(len(self.levels) - 1)
        on = np.concatenate([[0.0], np.cumsum(np.bincount(rows, weights=self.weights))])
        off = np.concatenate([[0.0], np.cumsum(np.bincount(columns, weights=self.weights)[::-1])])
        low, high = self.saturation
        turned_on = np.searchsorted(self.levels[1:], inputs, side="right")
        turned_off = len(off) - 1 - np.searchsorted(self.levels[:-1], inputs, side="left")
        up = np.asarray(low + 2.0 * on[turned_on])
        down = np.asarray(high - 2.0 * off[turned_off])
        return up, down

    @classmethod
    def identify(
        cls,
        history: ArrayLike,
        response: ArrayLike,
        *,
        levels: Sequence[float] | None = None,
        count: int = 10,
        signed: bool = False,
        skip: int = 0,
    ) -> HysteresisFit[Preisach]:
        """Fit weights and offset to measured loops: linear least squares with bounds.

        To tell all weights it takes reversals at all levels: loops that grow or shrink step by
        step. `HysteresisFit.undetermined` names the weights that the history does not tell.

        Parameters
        ----------
        history, response : array_like, shape (..., n)
            Inputs in the order of time, each history from rest below all levels, and the outputs
            measured.
        levels : sequence of float, optional
            Levels; else `count` even steps over the span of the history.
        count : int
            How many steps, 1 to 40.
        signed : bool
            Whether weights may be negative; without, they are 0 or more.
        skip : int
            Samples at the beginning of each history that only move the memory.

        Raises
        ------
        InputError
            If history and response are not finite arrays of one shape, the history is constant, or
            an option is out of its range.
        """
        loops = Loops.take(history, response, skip)
        count = check_integer("count", count, low=1, high=40)
        inputs = loops.inputs
        ladder: Sequence[float] = (
            np.linspace(inputs.min(), inputs.max(), count + 1).tolist()
            if levels is None
            else levels
        )
        rungs = take_ladder("levels", ladder, low=-LIMIT)
        steps = len(rungs) - 1
        cls(rungs, (0.0,) * (steps * (steps + 1) // 2))
        memory = np.full((len(inputs), steps * (steps + 1) // 2), -1.0)
        last = np.full(len(inputs), rungs[0])
        found = fit_linear(
            loops.pick(_kernels.trace_relays(inputs, np.array(rungs), last, memory)),
            loops.target,
            names=[f"weights[{i}]" for i in range(memory.shape[1])],
            low=-LIMIT if signed else 0.0,
        )
        return loops.report(cls(rungs, found.values, offset=found.offset), found)

    def _advance(self, inputs: Floats, last: Floats, memory: Floats) -> Floats:
        return np.asarray(
            _kernels.run_relays(
                inputs, np.array(self.levels), np.array(self.weights), self.offset, last, memory
            )
        )

    def _take_state(self, state: HysteresisState, batch: tuple[int, ...]) -> HysteresisState:
        state = super()._take_state(state, batch)
        steps = len(self.levels) - 1
        rows, columns = np.tril_indices(steps)
        levels = np.array(self.levels)
        last = state.last[..., None]
        on, off = last >= levels[rows + 1], last <= levels[columns]
        wrong = (np.abs(state.memory) != 1.0) | (on & (state.memory < 0.0))
        wrong |= off & (state.memory > 0.0)
        if wrong.any():
            index = int(np.argmax(wrong)) % self.memory_size
            raise InputError(
                f"memory of the initial state has a relay {index} that an input cannot leave so: "
                "relays are -1 or +1, +1 from the level at which they turn on, -1 from the one at "
                "which they turn off"
            )
        return state
