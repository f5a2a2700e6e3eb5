"""Asymmetric Prandtl-Ishlinskii, (2.55): plays whose descending edge is a curve of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_integer, check_number, name_at
from ...errors import InputError
from ._loops import Loops, search
from ._plays import Plays, SteppedPlaySum, default_thresholds, trace_plays
from .fit import HysteresisFit, LinearFit, fit_linear
from .operator import LIMIT, take_ladder, take_numbers, take_same_count

__all__ = ["AsymmetricPrandtlIshlinskii"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class AsymmetricPrandtlIshlinskii(SteppedPlaySum):
    """Ascending and descending plays, thesis (2.55), for loops that are not symmetric.

    The sum is::

        output = k1 P + sum of wa_i (Ha_i - P) + sum of wd_i (Hd_i - P) + offset
        Ha_i = max(P - r_i, min(P + r_i, Ha_i before))
        Hd_i = max(P - r_i, min(g(P) + r_i, Hd_i before))      g(P) = a0 + a1 P + a2 P**2

    The thesis prints neither of the two plays, only that the descending one has a quadratic
    function: that it is its descending edge is our reading. With ``g(P) = P`` both are the same
    and the sum is a `PrandtlIshlinskii` of weights ``k1 - sum of w`` at r = 0 and ``wa_i + wd_i``.
    The printed constraints (one of them twice) want plays that are 1 at an input of 1, as no play
    of r > 0 is on its way up; they are not imposed. `offset` is not in (2.55).

    Parameters
    ----------
    slope : float
        k1, output per input.
    thresholds : sequence of float
        Half widths r, increasing, 0 or more.
    ascending_weights, descending_weights : sequence of float
        wa and wd, as many each.
    envelope : sequence of float
        Coefficients a0, a1, a2. On the histories g must not fall, nor lie below P - 2 r.
    offset : float
        Output at rest.

    Raises
    ------
    InputError
        If they are no such numbers.
    """

    slope: float
    thresholds: tuple[float, ...]
    ascending_weights: tuple[float, ...]
    descending_weights: tuple[float, ...]
    envelope: tuple[float, float, float] = (0.0, 1.0, 0.0)
    offset: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        for name in ("slope", "offset"):
            value = check_number(name, getattr(self, name), low=-LIMIT, high=LIMIT)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "thresholds", take_ladder("thresholds", self.thresholds))
        for name in ("ascending_weights", "descending_weights", "envelope"):
            object.__setattr__(self, name, take_numbers(name, getattr(self, name)))
        for name in ("ascending_weights", "descending_weights"):
            take_same_count("thresholds", self.thresholds, name, getattr(self, name))
        if len(self.envelope) != 3:
            raise InputError(f"envelope has {len(self.envelope)} number(s): it must have 3")

    @property
    def _steepness(self) -> float:
        free = self.slope - sum(self.ascending_weights) - sum(self.descending_weights)
        if min(self.descending_weights) < 0.0:
            return -math.inf
        return free + sum(min(weight, 0.0) for weight in self.ascending_weights)

    @classmethod
    def identify(
        cls,
        history: ArrayLike,
        response: ArrayLike,
        *,
        thresholds: Sequence[float] | None = None,
        count: int = 6,
        envelope: Sequence[float] | None = None,
        skip: int = 0,
    ) -> HysteresisFit[AsymmetricPrandtlIshlinskii]:
        """Fit everything but the thresholds to measured loops.

        Weights of 0 or more, k1 and offset are linear and solved within a search for the envelope,
        which keeps to what is legal on the history. k1 is kept at or above the sum of all weights,
        so that the operator found does not fall as its input rises.

        Parameters
        ----------
        history, response : array_like, shape (..., n)
            Inputs in the order of time, each history from rest at 0, and the outputs measured.
        thresholds : sequence of float, optional
            Thresholds; else `count` of them, evenly from above 0 to half the span of the inputs.
        count : int
            How many, 1 to 100.
        envelope : sequence of float, optional
            a0, a1, a2 where they are known; fitted without.
        skip : int
            Samples at the beginning of each history that only move the memory.

        Raises
        ------
        InputError
            If history and response are not finite arrays of one shape, the history is constant, or
            an option is out of its range.
        """
        loops = Loops.take(history, response, skip)
        count = check_integer("count", count, low=1, high=100)
        inputs = loops.inputs
        ladder = default_thresholds(inputs, count + 1)[1:] if thresholds is None else thresholds
        rungs = take_ladder("thresholds", ladder)
        names = ["slope"]
        names += [f"{way}_weights[{i}]" for way in _WAYS for i in range(len(rungs))]
        low, high = min(float(inputs.min()), 0.0), max(float(inputs.max()), 0.0)

        def trace(curve: Sequence[float]) -> Floats:
            traced = trace_plays(inputs, *_edges(rungs, curve))
            return loops.pick(np.concatenate([inputs[..., None], traced], axis=-1))

        found: LinearFit
        if envelope is None:
            place = _Legal(low, high, 2.0 * rungs[0])
            point, found = search(
                lambda point: trace(place.bend(point)),
                loops.target,
                [[0.0, 0.7, 1.3], [0.0, 1.3, 0.7], [0.05 * (high - low), 1.0, 1.0]],
                ([-2.0 * rungs[0], 0.0, 0.0], [high - low, 10.0, 10.0]),
                names=names,
            )
            curve = place.bend(point)
        else:
            curve = _take_envelope(envelope)
            cls(0.0, rungs, (0.0,) * len(rungs), (0.0,) * len(rungs), curve).apply(loops.history)
            found = fit_linear(trace(curve), loops.target, names=names)
        free, *weights = found.values
        ascending, descending = weights[: len(rungs)], weights[len(rungs) :]
        operator = cls(
            free + sum(weights), rungs, tuple(ascending), tuple(descending), curve,
            offset=found.offset,
        )  # fmt: skip
        untold = envelope is None and not loops.tells(max(descending))
        return loops.report(operator, found, lost=("envelope",) if untold else ())

    def _plays(self) -> Plays:
        weights = np.array(self.ascending_weights + self.descending_weights)
        lower, upper = _edges(self.thresholds, self.envelope)
        return Plays(lower, upper, weights, self.slope - float(weights.sum()), self.offset)

    def _check_history(self, inputs: Floats, last: Floats | None) -> None:
        if not inputs.size:
            return
        a0, a1, a2 = self.envelope
        seen = inputs if last is None else np.append(inputs, last)
        low, high = float(seen.min()), float(seen.max())
        for index in (int(np.argmin(inputs)), int(np.argmax(inputs))):
            value = float(inputs.flat[index])
            if a1 + 2.0 * a2 * value < -1e-9 * (1.0 + abs(a1)):
                raise InputError(
                    f"{name_at('history', inputs, index)} is {value:g}: there the envelope falls, "
                    f"with a slope of {a1 + 2.0 * a2 * value:g}, which must be 0 or more"
                )
        places = [low, high]
        if a2 > 0.0:
            places.append(min(max((1.0 - a1) / (2.0 * a2), low), high))
        place = min(places, key=lambda p: a0 + (a1 - 1.0 + a2 * p) * p)
        short = a0 + (a1 - 1.0 + a2 * place) * place + 2.0 * self.thresholds[0]
        if short < -1e-9 * (abs(low) + abs(high) + self.thresholds[0]):
            raise InputError(
                f"history comes by {place:g}: there the envelope is "
                f"{short - 2.0 * self.thresholds[0] + place:g}, which must be at least "
                f"{place - 2.0 * self.thresholds[0]:g}, the input less twice the first threshold"
            )


_WAYS = ("ascending", "descending")


@dataclass(frozen=True)
class _Legal:
    """Envelopes that are legal between two inputs, in three numbers with plain bounds."""

    low: float
    high: float
    room: float

    def bend(self, point: Floats) -> tuple[float, float, float]:
        """From the least of g(P) - P and the slopes of g at both ends to a0, a1, a2."""
        least, first, second = (float(number) for number in point)
        a2 = 0.5 * (second - first) / (self.high - self.low)
        a1 = first - 2.0 * a2 * self.low
        places = [self.low, self.high]
        if a2 > 0.0:
            places.append(min(max((1.0 - a1) / (2.0 * a2), self.low), self.high))
        bottom = min((a1 - 1.0 + a2 * p) * p for p in places)
        return max(least, -self.room) - bottom, a1, a2


def _take_envelope(envelope: Sequence[float]) -> tuple[float, float, float]:
    numbers = take_numbers("envelope", envelope)
    if len(numbers) != 3:
        raise InputError(f"envelope has {len(numbers)} number(s): it must have 3")
    return numbers[0], numbers[1], numbers[2]


def _edges(thresholds: Sequence[float], envelope: Sequence[float]) -> tuple[Floats, Floats]:
    """Return both edges of ascending and descending plays (2 k, 3)."""
    count = len(thresholds)
    lower = np.zeros((2 * count, 3))
    lower[:, 0] = -np.tile(thresholds, 2)
    lower[:, 1] = 1.0
    upper = np.zeros((2 * count, 3))
    upper[:count, 1] = 1.0
    upper[count:] = envelope
    upper[:, 0] += np.tile(thresholds, 2)
    return lower, upper
