"""Prandtl-Ishlinskii: a weighted sum of plays, (2.54), with its inverse in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_integer, check_number
from ...errors import InputError
from . import _kernels
from ._loops import Loops
from ._plays import Plays, PlaySum, default_thresholds, trace_plays
from .fit import HysteresisFit, fit_linear
from .operator import LIMIT, HysteresisState, take_ladder, take_numbers, take_same_count

__all__ = ["PrandtlIshlinskii"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PrandtlIshlinskii(PlaySum):
    """A weighted sum of plays (backlashes) of growing width, thesis (2.54).

    Each play drags behind the input::

        H_i = max(P - r_i, min(P + r_i, H_i before))       output = sum of w_i H_i

    As printed, each play is moved on from the whole output before it instead of from its own
    position, which is the same only for one play of weight 1; here each has a memory of its own.
    Loops are symmetric under a half turn. With `origin` and `offset`, which (2.54) has not, the
    rest is at the input `origin`, with the output `offset`.

    Parameters
    ----------
    thresholds : sequence of float
        Half widths r of the plays, increasing, 0 or more, in the unit of the input. A play of
        half width 0 is the input itself.
    weights : sequence of float
        Weights w, as many; they may be negative.
    origin, offset : float
        Input and output at rest.

    Raises
    ------
    InputError
        If they are no such numbers.
    """

    thresholds: tuple[float, ...]
    weights: tuple[float, ...]
    origin: float = field(default=0.0, kw_only=True)
    offset: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "thresholds", take_ladder("thresholds", self.thresholds))
        object.__setattr__(self, "weights", take_numbers("weights", self.weights))
        take_same_count("thresholds", self.thresholds, "weights", self.weights)
        for name in ("origin", "offset"):
            value = check_number(name, getattr(self, name), low=-LIMIT, high=LIMIT)
            object.__setattr__(self, name, value)

    @property
    def rest_input(self) -> float:
        """Input at rest: `origin`."""
        return self.origin

    @property
    def slopes(self) -> tuple[float, ...]:
        """Slopes of the virgin curve, past each threshold: the weights added up one by one."""
        return tuple(np.cumsum(self.weights).tolist())

    def load_virgin(self, input_: ArrayLike) -> Floats:
        """Return the output where the input goes from rest one way only, an odd curve."""
        way = np.asarray(input_, dtype=np.float64)[..., None] - self.origin
        beyond = np.maximum(np.abs(way) - self.thresholds, 0.0) * np.sign(way)
        return np.asarray(self.offset + (beyond * self.weights).sum(axis=-1))

    def invert(self) -> PrandtlIshlinskii:
        """Return the inverse, a `PrandtlIshlinskii` as well, whose virgin curve is the inverse one.

        With r_0 = 0 and W_i the weights added up to the i-th, its thresholds are
        ``sum of w_j (r_i - r_j) for j < i``, its weights ``1 / w_0`` and ``1 / W_i - 1 / W_i-1``
        (K. Kuhnen, Modeling, identification and compensation of complex hysteretic nonlinearities,
        European Journal of Control, 2003).

        Raises
        ------
        InputError
            If the first threshold is not 0, or the virgin curve does not rise all along: weights of
            0 or more, the first above 0, are enough.
        """
        if self.thresholds[0] != 0.0:
            raise InputError(
                f"thresholds[0] is {self.thresholds[0]:g}: for an inverse it must be 0, or small "
                "changes of the input are lost"
            )
        slopes = np.cumsum(self.weights)
        if slopes.min() <= 0.0:
            index = int(np.argmax(slopes <= 0.0))
            raise InputError(
                f"weights[0] to weights[{index}] add up to {slopes[index]:g}: for an inverse it "
                "must be above 0"
            )
        gaps = np.diff(self.thresholds)
        thresholds = np.concatenate([[0.0], np.cumsum(slopes[:-1] * gaps)])
        changes = -np.array(self.weights[1:]) / (slopes[1:] * slopes[:-1])
        return PrandtlIshlinskii(
            tuple(thresholds.tolist()),
            (1.0 / float(slopes[0]), *changes.tolist()),
            origin=self.offset,
            offset=self.origin,
        )

    def invert_state(self, state: HysteresisState) -> HysteresisState:
        """Return the state of `invert` that belongs to a state of this operator.

        The i-th play of the inverse stands at the sum of ``w_j H_i`` for j <= i and ``w_j H_j`` for
        the j beyond.

        Raises
        ------
        InputError
            If there is no inverse, or it is not a state of this operator.
        """
        self.invert()
        state = self._take_state(state, state.last.shape)
        weights = np.array(self.weights)
        parts = weights * state.memory
        total = parts.sum(axis=-1)
        own = np.cumsum(weights) * state.memory
        wider = total[..., None] - np.cumsum(parts, axis=-1)
        return HysteresisState(self.offset + total, own + wider)

    @classmethod
    def identify(
        cls,
        history: ArrayLike,
        response: ArrayLike,
        *,
        thresholds: Sequence[float] | None = None,
        count: int = 10,
        origin: float = 0.0,
        signed: bool = False,
        skip: int = 0,
    ) -> HysteresisFit[PrandtlIshlinskii]:
        """Fit weights and offset to measured loops: linear least squares with bounds.

        Parameters
        ----------
        history, response : array_like, shape (..., n)
            Inputs in the order of time, each history from rest, and the outputs measured.
        thresholds : sequence of float, optional
            Thresholds; else `count` of them, evenly from 0 to below half the span of the inputs.
        count : int
            How many, 1 to 200.
        origin : float
            Input at rest.
        signed : bool
            Whether weights may be negative; without, they are 0 or more.
        skip : int
            Samples at the beginning of each history that only move the memory: the first branch,
            where the muscle was not at rest before it.

        Raises
        ------
        InputError
            If history and response are not finite arrays of one shape, the history is constant, or
            an option is out of its range.
        """
        origin = check_number("origin", origin, low=-LIMIT, high=LIMIT)
        loops = Loops.take(history, response, skip)
        count = check_integer("count", count, low=1, high=200)
        ladder = default_thresholds(loops.inputs, count) if thresholds is None else thresholds
        rungs = take_ladder("thresholds", ladder)
        lower, upper = _edges(rungs)
        columns = loops.pick(trace_plays(loops.inputs - origin, lower, upper))
        found = fit_linear(
            columns,
            loops.target,
            names=[f"weights[{i}]" for i in range(len(rungs))],
            low=-LIMIT if signed else 0.0,
        )
        operator = cls(rungs, found.values, origin=origin, offset=found.offset)
        return loops.report(operator, found)

    def _plays(self) -> Plays:
        return Plays(*_edges(self.thresholds), np.array(self.weights), 0.0, self.offset)

    def _advance(self, inputs: Floats, last: Floats, memory: Floats) -> Floats:
        return np.asarray(_kernels.run_plays(inputs - self.origin, *self._plays(), memory))


def _edges(thresholds: Sequence[float]) -> tuple[Floats, Floats]:
    """Return both edges of symmetric plays (k, 3)."""
    lower = np.zeros((len(thresholds), 3))
    lower[:, 1] = 1.0
    upper = lower.copy()
    lower[:, 0] = -np.asarray(thresholds)
    upper[:, 0] = thresholds
    return lower, upper
