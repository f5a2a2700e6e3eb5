"""Extended unparallel Prandtl-Ishlinskii, (2.56): plays whose edges have different slopes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_integer, check_number, name_at
from ...errors import InputError
from ._loops import Loops, search
from ._plays import Plays, SteppedPlaySum, default_thresholds, trace_plays
from .fit import HysteresisFit, fit_linear
from .operator import LIMIT, take_ladder, take_numbers, take_same_count

__all__ = ["UnparallelPrandtlIshlinskii"]

Floats = NDArray[np.float64]

_STEEPEST = 20.0  # ratio of slopes that a fit tries


@dataclass(frozen=True)
class UnparallelPrandtlIshlinskii(SteppedPlaySum):
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

    thresholds: tuple[float, ...]
    weights: tuple[float, ...]
    ascending_slopes: tuple[float, ...]
    descending_slopes: tuple[float, ...]
    offset: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "thresholds", take_ladder("thresholds", self.thresholds))
        object.__setattr__(self, "weights", take_numbers("weights", self.weights))
        for name in ("ascending_slopes", "descending_slopes"):
            numbers = take_numbers(name, getattr(self, name), low=0.0, low_open=True)
            object.__setattr__(self, name, numbers)
        for name in ("weights", "ascending_slopes", "descending_slopes"):
            take_same_count("thresholds", self.thresholds, name, getattr(self, name))
        offset = check_number("offset", self.offset, low=-LIMIT, high=LIMIT)
        object.__setattr__(self, "offset", offset)

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
        skip: int = 0,
    ) -> HysteresisFit[UnparallelPrandtlIshlinskii]:
        """Fit weights, offset and one ratio of slopes to measured loops.

        Weights of 0 or more and the offset are linear and solved within a search for the ratio
        ``be / al``, which all plays of r > 0 share; al is 1. It keeps to what is legal on the
        history. A play of r = 0 is the input itself.

        Parameters
        ----------
        history, response : array_like, shape (..., n)
            Inputs in the order of time, each history from rest at 0, and the outputs measured.
        thresholds : sequence of float, optional
            Thresholds; else `count` of them, evenly from 0 to below half the span of the inputs.
        count : int
            How many, 2 to 200.
        skip : int
            Samples at the beginning of each history that only move the memory.

        Raises
        ------
        InputError
            If history and response are not finite arrays of one shape, the history is constant,
            there is no threshold above 0, or an option is out of its range.
        """
        loops = Loops.take(history, response, skip)
        count = check_integer("count", count, low=2, high=200)
        inputs = loops.inputs
        ladder = default_thresholds(inputs, count) if thresholds is None else thresholds
        rungs = take_ladder("thresholds", ladder)
        wide = np.array(rungs) > 0.0
        if not wide.any():
            raise InputError(f"thresholds is {list(rungs)}: it must have one above 0")
        first = rungs[int(np.argmax(wide))]
        names = [f"weights[{i}]" for i in range(len(rungs))]
        up = np.ones(len(rungs))

        def trace(ratio: float) -> Floats:
            down = np.where(wide, ratio, 1.0)
            return loops.pick(trace_plays(inputs, *_edges(rungs, up, down)))

        low, high = _legal_ratios(first, float(inputs.min()), float(inputs.max()))
        if high - low < 1e-6:
            ratio, found = 1.0, fit_linear(trace(1.0), loops.target, names=names)
        else:
            point, found = search(
                lambda point: trace(float(np.exp(point[0]))),
                loops.target,
                [[np.log(0.8)], [np.log(1.25)], [0.0]],
                ([np.log(low)], [np.log(high)]),
                names=names,
            )
            ratio = float(np.exp(point[0]))
        down = np.where(wide, ratio, 1.0)
        operator = cls(
            rungs, found.values, tuple(up.tolist()), tuple(down.tolist()), offset=found.offset
        )
        told = loops.tells(max(np.array(found.values)[wide]))
        return loops.report(operator, found, lost=() if told else ("descending_slopes",))

    def _plays(self) -> Plays:
        edges = _edges(self.thresholds, self.ascending_slopes, self.descending_slopes)
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
                raise InputError(
                    f"{name_at('history', inputs, index)} is {value:g}: there the ascending edge "
                    f"of play {play} is {up[play]:g}, which must be at most {down[play]:g}, its "
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


def _edges(
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
