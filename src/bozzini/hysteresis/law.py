"""A law with memory from any input to any output: a curve over plays, or with a Bouc-Wen state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial

from ..errors import InputError
from ..muscle.hysteresis.operator import number, numbers, take_fields
from ..muscle.kernels import hysteresis as kernels
from ..numeric.arrays import Floats
from ..results import Shown

Fan = tuple[float, float]
"""Share by which plays widen from an apex, and that [input]."""
PARALLEL: Fan = (0.0, 0.0)
"""Of plays as wide everywhere."""
WHOLE = 2.0
"""All starts: from 0 to here."""


@dataclass(frozen=True, kw_only=True)
class LoopState(Shown):
    """What a law remembers: the last input, its plays, the Bouc-Wen state over its bound."""

    last: float = number()
    plays: tuple[float, ...] = numbers()
    yielded: float = number(-1.0, 1.0, default=0.0)

    def __post_init__(self) -> None:
        take_fields(self)


@dataclass(frozen=True, kw_only=True)
class LoopLaw(Shown):
    """A curve of a sum of plays of the input, plus a Bouc-Wen state.

    With plays ``H_j`` of half widths r_j (see `PrandtlIshlinskii`) and the state h of a `BoucWen`
    over its bound::

        z = sum of w_j H_j        output = c_0 + c_1 s + c_2 s**2 + c_3 s**3 + height h
        s = (z - centre) / half

    One play of no width and no height is a plain polynomial. With a fan plays widen away from an
    apex, as tendons with the capstan's friction do from where they have no tension::

        H = max(u - r - fan |u - apex|, min(u + r + fan |u - apex|, H before))

    What an input did before the first sample is one number, the start: where it turned last. 0 is
    a rise from afar; up to 1 a fall after ever larger rises, 1 from afar; up to 2 a rise again
    after ever larger falls. It goes round: 2 is 0.

    Parameters
    ----------
    thresholds : sequence of float
        Half widths r [input], increasing, 0 or more.
    weights : sequence of float
        w, as many; their sizes have the sum 1.
    coefficients : sequence of float
        c [output], constant first.
    centre, half : float
        [input]
    straight : sequence of float
        Lowest and highest s, beyond which the curve goes on straight.
    reach : float
        Half of the range of the input [input]: the measure of starts.
    fan : float
    apex : float
        [input]
    height : float
        [output]
    yield_input : float
        Input over which h would come from 0 to its bound at its first slope [input].
    beta_fraction, exponent : float
        beta / (beta + gamma) and n of `BoucWen`.
    """

    thresholds: tuple[float, ...] = numbers(increasing=True)
    weights: tuple[float, ...] = numbers(like="thresholds")
    coefficients: tuple[float, ...] = numbers()
    centre: float = number()
    half: float = number(0.0, low_open=True)
    straight: tuple[float, ...] = numbers()
    reach: float = number(0.0, low_open=True)
    fan: float = number(0.0, 0.95, default=0.0)
    apex: float = number(default=0.0)
    height: float = number(default=0.0)
    yield_input: float = number(0.0, low_open=True, default=1.0)
    beta_fraction: float = number(0.0, 10.0, default=0.5)
    exponent: float = number(1.0, 20.0, default=1.0)

    def __post_init__(self) -> None:
        take_fields(self)
        if len(self.straight) != 2 or self.straight[0] > self.straight[1]:
            raise InputError(
                f"straight is {list(self.straight)}: it must be a lowest and a highest s"
            )

    def trace(self, inputs: Floats, start: float | LoopState | None) -> Floats:
        """Return outputs (n,) along inputs (n,), from a start or on from a state.

        Without either all plays are in their middle.
        """
        return self.run(inputs, start)[0]

    def trace_starts(self, inputs: Floats, starts: Floats) -> Floats:
        """Return outputs (m, n) along inputs (n,) after starts (m,)."""
        first, fan = float(inputs[0]), (self.fan, self.apex)
        widths = np.array(self.thresholds)
        memory = [place_plays(first, widths, start, self.reach, fan) for start in starts.tolist()]
        rows = np.tile(inputs, (len(starts), 1))
        plays = _trace(rows, widths, np.array(memory), fan)
        output = self.bend(plays @ np.array(self.weights))
        if self.height:
            states = np.array([[_place_state(start)] for start in starts.tolist()])
            before = np.full(len(starts), first)
            output = output + self.height * self._trace_state(rows, before, states)
        return output

    def run(self, inputs: Floats, start: float | LoopState | None) -> tuple[Floats, LoopState]:
        """Return outputs (n,) along inputs (n,), and the state at their end."""
        fan = self.fan, self.apex
        plays = trace_plays(inputs, self.thresholds, start, self.reach, fan)
        output = self.bend(plays @ np.array(self.weights))
        last = 0.0
        if self.height:
            form = self.yield_input, self.beta_fraction, self.exponent
            state = trace_state(inputs, start, form)
            output, last = output + self.height * state, float(state[-1])
        return output, LoopState(
            last=float(inputs[-1]), plays=tuple(plays[-1].tolist()), yielded=last
        )

    def _trace_state(self, rows: Floats, before: Floats, states: Floats) -> Floats:
        form = self.exponent, self.beta_fraction, 1.0 / self.yield_input
        return np.asarray(kernels.run_bouc_wen(rows, *form, before, states))

    def bend(self, inner: Floats) -> Floats:
        """Return the curve at sums of plays (n,)."""
        place = (inner - self.centre) / self.half
        inside = np.clip(place, self.straight[0], self.straight[1])
        slope = polynomial.polyder(self.coefficients)
        return np.asarray(
            polynomial.polyval(inside, self.coefficients)
            + polynomial.polyval(inside, slope) * (place - inside)
        )


def place_plays(
    first: float, thresholds: Floats, start: float | None, reach: float, fan: Fan = PARALLEL
) -> Floats:
    """Return positions of plays (k,) at the first input, after a start."""
    if start is None:
        return np.full(len(thresholds), first)
    share, apex = fan
    turn = tell_turn(first, start, reach)
    here, there = (thresholds + share * abs(place - apex) for place in (first, turn))
    if start <= 1.0:  # it fell from above
        return np.minimum(first + here, turn - there)
    return np.maximum(first - here, turn + there)


def tell_turn(first: float, start: float, reach: float) -> float:
    """Return the input of the last turn before the first sample."""
    return first + 2.0 * reach * (start if start <= 1.0 else 1.0 - start)


def trace_plays(
    inputs: Floats,
    thresholds: tuple[float, ...] | Floats,
    start: float | LoopState | None,
    reach: float,
    fan: Fan = PARALLEL,
) -> Floats:
    """Return positions of plays (n, k) along inputs (n,)."""
    widths = np.asarray(thresholds, dtype=np.float64)
    if isinstance(start, LoopState):
        memory = np.array([start.plays])
    else:
        memory = place_plays(float(inputs[0]), widths, start, reach, fan)[None].copy()
    return np.asarray(_trace(inputs[None], widths, memory, fan)[0])


def _trace(rows: Floats, widths: Floats, memory: Floats, fan: Fan) -> Floats:
    """Return positions of plays (m, n, k) along inputs (m, n), all alike, from `memory` (m, k)."""
    share, apex = fan
    inputs = rows[0]
    # Edges are straight on either side of the apex.
    cuts = np.flatnonzero(np.diff(inputs >= apex)) + 1 if share else np.empty(0, dtype=np.intp)
    parts = []
    for part in np.split(rows, cuts, axis=1):
        slope = share if part[0, 0] >= apex else -share
        edges = np.zeros((2, len(widths), 3))
        edges[0, :, 0], edges[1, :, 0] = apex * slope - widths, widths - apex * slope
        edges[0, :, 1], edges[1, :, 1] = 1.0 - slope, 1.0 + slope
        part = np.ascontiguousarray(part)
        parts.append(kernels.trace_plays(part, edges[0], edges[1], memory))
    return np.concatenate(parts, axis=1)


def _place_state(start: float) -> float:
    """Return the Bouc-Wen state over its bound after a start."""
    return 1.0 - 2.0 * min(start, WHOLE - start)


def trace_state(
    inputs: Floats, start: float | LoopState | None, form: tuple[float, float, float]
) -> Floats:
    """Return the Bouc-Wen state over its bound (n,) along inputs (n,).

    `form` has the yield input, the fraction of beta and the exponent.
    """
    width, fraction, exponent = form
    last, first = float(inputs[0]), 0.0
    if isinstance(start, LoopState):
        last, first = start.last, start.yielded
    elif start is not None:
        first = _place_state(start)
    memory = np.array([[first]])
    return np.asarray(
        kernels.run_bouc_wen(
            inputs[None], exponent, fraction, 1.0 / width, np.array([last]), memory
        )[0]
    )


def count_constants(law: LoopLaw) -> int:
    """Return how many numbers of a law were fitted."""
    plays = sum(weight != 0.0 for weight in law.weights)
    widths = plays if law.thresholds != (0.0,) or law.fan else 0
    return len(law.coefficients) + widths + (4 if law.height else 0) + (2 if law.fan else 0)
