"""Sums of plays: Prandtl-Ishlinskii operators, symmetric and not (thesis 2.2.10)."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_integer, check_number, name_at, show_apart
from ...errors import InputError
from ...numeric.arrays import Floats
from ..kernels import hysteresis as kernels
from .operator import (
    LIMIT,
    HysteresisFit,
    HysteresisState,
    InvertibleOperator,
    LinearFit,
    LoopOptions,
    Loops,
    list_rows,
    number,
    numbers,
    take_history,
    take_increasing,
    take_numbers,
)


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


class PlaySum(InvertibleOperator):
    """An operator that is a weighted sum of plays."""

    @abstractmethod
    def _plays(self) -> Plays:
        """Return the plays."""

    @property
    def memory_size(self) -> int:
        """How many plays there are."""
        return len(self._plays().weights)

    @property
    @abstractmethod
    def _steepness(self) -> float:
        """A slope that the output has at least, whatever the plays do."""

    def _advance(self, inputs: Floats, last: Floats, memory: Floats) -> Floats:
        return np.asarray(kernels.run_plays(inputs - self._origin, *self._plays(), memory))

    @property
    def _origin(self) -> float:
        return 0.0

    def invert_history(
        self,
        response: ArrayLike,
        *,
        between: tuple[float, float],
        initial: HysteresisState | None = None,
        clip: bool = False,
    ) -> Floats:
        """Return the inputs that give these outputs, found by bisection to the last bits."""
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
        flat = list_rows(outputs)
        memory = np.array(np.broadcast_to(state.memory, (*batch, self.memory_size)), order="C")
        memory = memory.reshape(len(flat), self.memory_size)
        shift = self._origin
        inputs, row, sample, bottom, top = kernels.invert_plays(
            flat, *self._plays(), memory, low - shift, high - shift, clip
        )
        if row >= 0:
            index = row * flat.shape[1] + sample
            shown = show_apart(outputs.flat[index], bottom, top)
            raise InputError(
                f"{name_at('response', outputs, index)} is {shown[0]}: between inputs "
                f"of {low:g} and {high:g} it must lie in [{shown[1]}, {shown[2]}]"
            )
        return np.asarray(inputs.reshape(outputs.shape) + shift)


def trace_plays(inputs: Floats, lower: Floats, upper: Floats) -> Floats:
    """Return the positions of plays (m, n, k) along inputs (m, n), from rest at 0."""
    return np.asarray(
        kernels.trace_plays(inputs, lower, upper, np.zeros((len(inputs), len(lower))))
    )


def choose_thresholds(
    inputs: Floats,
    given: Sequence[float] | None,
    count: int,
    *,
    counts: tuple[int, int],
    from_zero: bool = True,
) -> Sequence[float]:
    """Return the thresholds of a fit: those given, or evenly spaced ones.

    These begin at 0, or above it, and stay below half the span of the inputs fitted: a play that is
    wider never moves again once it has been at both ends.
    """
    low, high = counts
    count = check_integer("count", count, low=low, high=high)
    if given is not None:
        return given
    parts = count + (not from_zero)
    span = float(inputs.max() - inputs.min())
    return tuple((0.5 * span * np.arange(not from_zero, parts) / parts).tolist())


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

    thresholds: tuple[float, ...] = numbers(increasing=True)
    weights: tuple[float, ...] = numbers(like="thresholds")
    origin: float = number(default=0.0, kw_only=True)
    offset: float = number(default=0.0, kw_only=True)

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
        options: LoopOptions | None = None,
    ) -> HysteresisFit[PrandtlIshlinskii]:
        """Fit weights and offset to measured loops: linear least squares with bounds.

        History, response and options are those of all operators, see `Operator`.

        Parameters
        ----------
        thresholds : sequence of float, optional
            Thresholds; else `count` of them, evenly from 0 to below half the span of the inputs.
        count : int
            How many, 1 to 200.
        origin : float
            Input at rest.
        signed : bool
            Whether weights may be negative; without, they are 0 or more.
        """
        origin = check_number("origin", origin, low=-LIMIT, high=LIMIT)
        loops = Loops.take(history, response, options)
        given = choose_thresholds(loops.fitted_inputs, thresholds, count, counts=(1, 200))
        thresholds = take_increasing("thresholds", given)
        found = loops.fit(
            loops.leave_still(trace_symmetric_plays(loops.inputs - origin, thresholds)),
            names=[f"weights[{i}]" for i in range(len(thresholds))],
            limits=(-LIMIT if signed and not loops.carried else 0.0, np.inf),
        )
        operator = cls(thresholds, found.values, origin=origin, offset=loops.find_offset(found))
        return loops.report(operator, found)

    def _plays(self) -> Plays:
        return Plays(*_symmetric_edges(self.thresholds), np.array(self.weights), 0.0, self.offset)

    @property
    def _origin(self) -> float:
        return self.origin

    @property
    def _steepness(self) -> float:
        return min(self.slopes) if self.thresholds[0] == 0.0 else 0.0


def trace_symmetric_plays(inputs: Floats, thresholds: Sequence[float] | Floats) -> Floats:
    """Return the positions of symmetric plays (m, n, k) along inputs (m, n), from rest at 0."""
    return trace_plays(inputs, *_symmetric_edges(thresholds))


def _symmetric_edges(thresholds: Sequence[float] | Floats) -> tuple[Floats, Floats]:
    """Return both edges of symmetric plays (k, 3)."""
    lower = np.zeros((len(thresholds), 3))
    lower[:, 1] = 1.0
    upper = lower.copy()
    lower[:, 0] = -np.asarray(thresholds)
    upper[:, 0] = thresholds
    return lower, upper


@dataclass(frozen=True)
class AsymmetricPrandtlIshlinskii(PlaySum):
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

    slope: float = number()
    thresholds: tuple[float, ...] = numbers(increasing=True)
    ascending_weights: tuple[float, ...] = numbers(like="thresholds")
    descending_weights: tuple[float, ...] = numbers(like="thresholds")
    envelope: tuple[float, ...] = numbers(default=(0.0, 1.0, 0.0))
    offset: float = number(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
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
        options: LoopOptions | None = None,
    ) -> HysteresisFit[AsymmetricPrandtlIshlinskii]:
        """Fit everything but the thresholds to measured loops.

        Weights of 0 or more, k1 and offset are linear and solved within a search for the envelope,
        which keeps to what is legal on the history. k1 is kept at or above the sum of all weights,
        so that the operator found does not fall as its input rises.

        History, response and options are those of all operators, see `Operator`.

        Parameters
        ----------
        thresholds : sequence of float, optional
            Thresholds; else `count` of them, evenly from above 0 to half the span of the inputs.
        count : int
            How many, 1 to 100.
        envelope : sequence of float, optional
            a0, a1, a2 where they are known; fitted without.
        """
        loops = Loops.take(history, response, options)
        inputs = loops.inputs
        given = choose_thresholds(
            loops.fitted_inputs, thresholds, count, counts=(1, 100), from_zero=False
        )
        thresholds = take_increasing("thresholds", given)
        names = ["slope"]
        names += [f"{way}_weights[{i}]" for way in _WAYS for i in range(len(thresholds))]
        low, high = min(float(inputs.min()), 0.0), max(float(inputs.max()), 0.0)

        def trace(curve: Sequence[float]) -> Floats:
            traced = loops.leave_still(trace_plays(inputs, *_enveloped_edges(thresholds, curve)))
            return np.concatenate([inputs[..., None], traced], axis=-1)

        found: LinearFit
        if envelope is None:
            place = _Legal(low, high, 2.0 * thresholds[0])
            # With this much less than the input its edges stay at 0 or above.
            least = -thresholds[0] if loops.carried else -2.0 * thresholds[0]
            point, found = loops.search(
                lambda point: trace(place.bend(point)),
                [[0.0, 0.7, 1.3], [0.0, 1.3, 0.7], [0.05 * (high - low), 1.0, 1.0]],
                ([least, 0.0, 0.0], [high - low, 10.0, 10.0]),
                names=names,
            )
            curve = place.bend(point)
        else:
            curve = _take_envelope(envelope)
            cls(0.0, thresholds, (0.0,) * len(thresholds), (0.0,) * len(thresholds), curve).apply(
                loops.history
            )
            found = loops.fit(trace(curve), names=names)
        free, *weights = found.values
        ascending, descending = weights[: len(thresholds)], weights[len(thresholds) :]
        operator = cls(
            free + sum(weights), thresholds, tuple(ascending), tuple(descending), curve,
            offset=loops.find_offset(found),
        )  # fmt: skip
        undetermined = envelope is None and not loops.distinguish(max(descending))
        return loops.report(operator, found, lost=("envelope",) if undetermined else ())

    def _plays(self) -> Plays:
        weights = np.array(self.ascending_weights + self.descending_weights)
        lower, upper = _enveloped_edges(self.thresholds, self.envelope)
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
        place = _find_lowest(a1, a2, low, high)
        short = a0 + (a1 - 1.0 + a2 * place) * place + 2.0 * self.thresholds[0]
        if short < -1e-9 * (abs(low) + abs(high) + self.thresholds[0]):
            shown = show_apart(place, place - 2.0 * self.thresholds[0])
            raise InputError(
                f"history comes by {shown[0]}: there the envelope is "
                f"{short - 2.0 * self.thresholds[0] + place:g}, which must be at least "
                f"{shown[1]}, the input less twice the first threshold"
            )


_WAYS = ("ascending", "descending")


@dataclass(frozen=True)
class _Legal:
    """Envelopes that are legal between two inputs, in three numbers with plain bounds."""

    low: float
    high: float
    depth: float

    def bend(self, point: Floats) -> tuple[float, float, float]:
        """From the least of g(P) - P and the slopes of g at both ends to a0, a1, a2."""
        least, first, second = (float(number) for number in point)
        a2 = 0.5 * (second - first) / (self.high - self.low)
        a1 = first - 2.0 * a2 * self.low
        place = _find_lowest(a1, a2, self.low, self.high)
        return max(least, -self.depth) - (a1 - 1.0 + a2 * place) * place, a1, a2


def _find_lowest(a1: float, a2: float, low: float, high: float) -> float:
    """Return the input between two at which an envelope is lowest above the input itself."""
    places = [low, high]
    if a2 > 0.0:
        places.append(min(max((1.0 - a1) / (2.0 * a2), low), high))
    return min(places, key=lambda p: (a1 - 1.0 + a2 * p) * p)


def _take_envelope(envelope: Sequence[float]) -> tuple[float, float, float]:
    numbers = take_numbers("envelope", envelope)
    if len(numbers) != 3:
        raise InputError(f"envelope has {len(numbers)} number(s): it must have 3")
    return numbers[0], numbers[1], numbers[2]


def _enveloped_edges(
    thresholds: Sequence[float], envelope: Sequence[float]
) -> tuple[Floats, Floats]:
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


_STEEPEST = 20.0  # ratio of slopes that a fit tries
BEYOND = 1.5
"""What is fitted for a muscle to carry is defined up to so many times the inputs of the fit."""


@dataclass(frozen=True)
class UnparallelPrandtlIshlinskii(PlaySum):
    """A weighted sum of plays with edges of their own slopes, thesis (2.56).

    The plays are::

        H_i = max(al_i (P - r_i), min(be_i (P + r_i), H_i before))   output = sum of w_i H_i

    With al = be = 1 it is a `PrandtlIshlinskii`. It is defined only where the edges do not cross,
    ``al (P - r) <= be (P + r)``; a history that goes beyond is refused. Only ``w al`` and
    ``be / al`` matter to the output. `offset` is not in (2.56).

    Parameters
    ----------
    thresholds : sequence of float
        Half widths r, increasing, 0 or more.
    weights : sequence of float
        Weights w, as many.
    ascending_slopes, descending_slopes : sequence of float
        al and be, as many, above 0.
    offset : float
        Output at rest.

    Raises
    ------
    InputError
        If they are no such numbers.
    """

    thresholds: tuple[float, ...] = numbers(increasing=True)
    weights: tuple[float, ...] = numbers(like="thresholds")
    ascending_slopes: tuple[float, ...] = numbers(low=0.0, low_open=True, like="thresholds")
    descending_slopes: tuple[float, ...] = numbers(low=0.0, low_open=True, like="thresholds")
    offset: float = number(default=0.0, kw_only=True)

    @property
    def _steepness(self) -> float:
        least = 0.0
        for threshold, weight, up, down in zip(
            self.thresholds, self.weights, self.ascending_slopes, self.descending_slopes,
            strict=True,
        ):  # fmt: skip
            if threshold == 0.0 and up == down:
                least += weight * up
            else:
                least += min(weight, 0.0) * max(up, down)
        return least

    @classmethod
    def identify(
        cls,
        history: ArrayLike,
        response: ArrayLike,
        *,
        thresholds: Sequence[float] | None = None,
        count: int = 8,
        options: LoopOptions | None = None,
    ) -> HysteresisFit[UnparallelPrandtlIshlinskii]:
        """Fit weights, offset and one ratio of slopes to measured loops.

        Weights of 0 or more and the offset are linear and solved within a search for the ratio
        ``be / al``, which all plays of r > 0 share; al is 1. It keeps to what is legal on the
        history. A play of r = 0 is the input itself.

        History, response and options are those of all operators, see `Operator`.

        Parameters
        ----------
        thresholds : sequence of float, optional
            Thresholds; else `count` of them, evenly from 0 to below half the span of the inputs.
        count : int
            How many, 2 to 200.
        """
        loops = Loops.take(history, response, options)
        inputs = loops.inputs
        given = choose_thresholds(loops.fitted_inputs, thresholds, count, counts=(2, 200))
        thresholds = take_increasing("thresholds", given)
        wide = np.array(thresholds) > 0.0
        if not wide.any():
            raise InputError(f"thresholds is {list(thresholds)}: it must have one above 0")
        first = thresholds[int(np.argmax(wide))]
        names = [f"weights[{i}]" for i in range(len(thresholds))]
        up = np.ones(len(thresholds))

        def trace(ratio: float) -> Floats:
            down = np.where(wide, ratio, 1.0)
            return loops.leave_still(trace_plays(inputs, *_sloped_edges(thresholds, up, down)))

        # It is defined beyond what was seen, too: a muscle that carries it may go there.
        low, high = _legal_ratios(first, *(BEYOND * end for end in (inputs.min(), inputs.max())))
        if high - low < 1e-6:
            ratio, found = 1.0, loops.fit(trace(1.0), names=names)
        else:
            point, found = loops.search(
                lambda point: trace(float(np.exp(point[0]))),
                [[np.log(0.8)], [np.log(1.25)], [0.0]],
                ([np.log(low)], [np.log(high)]),
                names=names,
            )
            ratio = float(np.exp(point[0]))
        down = np.where(wide, ratio, 1.0)
        operator = cls(
            thresholds,
            found.values,
            tuple(up.tolist()),
            tuple(down.tolist()),
            offset=loops.find_offset(found),
        )  # fmt: skip
        known = loops.distinguish(max(np.array(found.values)[wide]))
        return loops.report(operator, found, lost=() if known else ("descending_slopes",))

    def _plays(self) -> Plays:
        edges = _sloped_edges(self.thresholds, self.ascending_slopes, self.descending_slopes)
        return Plays(*edges, np.array(self.weights), 0.0, self.offset)

    def _check_history(self, inputs: Floats, last: Floats | None) -> None:
        if not inputs.size:
            return
        for index in (int(np.argmin(inputs)), int(np.argmax(inputs))):
            value = float(inputs.flat[index])
            up = np.array(self.ascending_slopes) * (value - np.array(self.thresholds))
            down = np.array(self.descending_slopes) * (value + np.array(self.thresholds))
            crossed = up - down > 1e-9 * (np.abs(up) + np.abs(down))
            if crossed.any():
                play = int(np.argmax(crossed))
                shown = show_apart(up[play], down[play])
                raise InputError(
                    f"{name_at('history', inputs, index)} is {value:g}: there the ascending edge "
                    f"of play {play} is {shown[0]}, which must be at most {shown[1]}, its "
                    "descending edge"
                )


def _legal_ratios(threshold: float, low: float, high: float) -> tuple[float, float]:
    """Return the ratios be / al at which the edges of a play do not cross between two inputs."""
    least, most = 1.0 / _STEEPEST, _STEEPEST
    if high > threshold:
        least = max(least, (high - threshold) / (high + threshold))
    if low < -threshold:
        most = min(most, (threshold - low) / (-low - threshold))
    return least, most


def _sloped_edges(
    thresholds: Sequence[float], up: Sequence[float] | Floats, down: Sequence[float] | Floats
) -> tuple[Floats, Floats]:
    """Return both edges of plays (k, 3)."""
    reach, rise, fall = (
        np.asarray(numbers, dtype=np.float64) for numbers in (thresholds, up, down)
    )
    nothing = np.zeros(len(reach))
    lower = np.column_stack([-rise * reach, rise, nothing])
    upper = np.column_stack([fall * reach, fall, nothing])
    return lower, upper
