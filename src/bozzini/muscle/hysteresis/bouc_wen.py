"""Bouc-Wen: a differential equation in the input, (2.52)-(2.53), integrated exactly enough."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_number, refuse_first, show_apart
from ...errors import InputError
from ...numeric.arrays import Floats
from ..kernels import hysteresis as kernels
from .operator import HysteresisFit, LoopOptions, Loops, Operator, number

_HIGHEST = 20.0
_SHARE = 1e3
_FLAT = 1e-8  # height of h, in spans of the response, below which there is no loop
_LARGEST = 1e3  # height of h that a fit tries, in spans of the response


@dataclass(frozen=True, kw_only=True)
class BoucWen(Operator):
    """Hysteresis by a differential equation, thesis (2.52)-(2.53).

    The output has a line and a bounded state h::

        output = scale (slope P - h) + offset
        dh = alpha dP - gamma dP |h|**n - beta h |dP| |h|**(n - 1)

    Printed is an undefined z where h has to stand. From one input to the next the equation is
    integrated to about 1e-9 of the bound (in closed form for n = 1), so that more samples on the
    way change nothing. ``|h| <= (alpha / (beta + gamma))**(1/n)`` holds from rest; beta of 0 or
    more is needed for it beside ``beta + gamma > 0``: with a negative one h runs away after a
    return point. Without beta there is no loop.

    Parameters
    ----------
    scale, slope, offset : float
        k, k1 and rho of (2.52).
    alpha : float
        Change of h with the input where h = 0, above 0.
    beta : float
        0 or more.
    gamma : float
        Above -beta; beta / (beta + gamma) may be 1000 at most.
    exponent : float
        n, from 1 to 20: the larger, the sharper the knee.

    Raises
    ------
    InputError
        If they are no such numbers.
    """

    slope: float = number()
    alpha: float = number(0.0, low_open=True)
    beta: float = number(0.0)
    gamma: float = number()
    exponent: float = number(1.0, _HIGHEST, default=1.0)
    scale: float = number(default=1.0)
    offset: float = number(default=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        both = self.beta + self.gamma
        if both <= 0.0 or self.beta > _SHARE * both:
            least = max(0.0, self.beta / _SHARE)
            shown = show_apart(both, least)
            raise InputError(
                f"beta + gamma is {shown[0]}: it must be above {shown[1]} for h to be bounded"
            )
        with np.errstate(all="ignore"):
            ratio = np.float64(self.alpha) / self.bound
        if not (np.isfinite(ratio) and 0.0 < self.bound and ratio > 0.0):
            raise InputError(
                f"alpha / (beta + gamma) is {self.alpha / both:g}: with an exponent of "
                f"{self.exponent:g} the bound of h is not a number that can be used"
            )

    @property
    def memory_size(self) -> int:
        """One: h."""
        return 1

    @property
    def bound(self) -> float:
        """Largest size of h, to which it tends where the input goes on one way."""
        return float((self.alpha / (self.beta + self.gamma)) ** (1.0 / self.exponent))

    @classmethod
    def identify(
        cls,
        history: ArrayLike,
        response: ArrayLike,
        *,
        exponent: float | None = None,
        options: LoopOptions | None = None,
    ) -> HysteresisFit[BoucWen]:
        """Fit everything to measured loops.

        Another scale of h gives the same outputs: it is chosen so that the bound is 1. The slope,
        the offset and the height of the loop are linear and solved within a search for the rest,
        begun at several widths; a height of more than 1000 times the span of the response is not
        tried.

        History, response and options are those of all operators, see `Operator`.

        Parameters
        ----------
        exponent : float, optional
            n where it is known; fitted, between 1 and 10, without.
        """
        loops = Loops.take(history, response, options)
        inputs = loops.inputs
        span = float(inputs.max() - inputs.min())
        tall = float(np.ptp(loops.response[..., loops.skip :])) or 1.0
        known = exponent is not None
        if exponent is not None:
            exponent = check_number("exponent", exponent, low=1.0, high=_HIGHEST)

        def trace(point: Floats) -> Floats:
            power = exponent if exponent is not None else float(point[2])
            yield_input = float(np.exp(point[0]))
            state = _run_normalised(inputs, power, float(point[1]), yield_input)
            # What is carried is at least its own line less h, which is never negative.
            least = inputs / yield_input if loops.carried else 0.0
            return np.stack([inputs, least - state], axis=-1)

        widths = (-2.0, -1.0, -3.5)
        starts = [[np.log(span) + width, 0.6] + [1.5] * (not known) for width in widths]
        if options is not None and isinstance(options.start, BoucWen):
            start = options.start
            yield_input, beta_fraction = (
                start.bound / start.alpha,
                start.beta / (start.beta + start.gamma),
            )
            starts = [[np.log(yield_input), beta_fraction] + [start.exponent] * (not known)]
        low, high = [np.log(span) - 7.0, 0.0], [np.log(span) + 3.0, 5.0]
        point, found = loops.search(
            trace,
            starts,
            (low + [1.0] * (not known), high + [10.0] * (not known)),
            names=("slope", "alpha"),
            limits=(
                np.array([0.0 if loops.carried else -_LARGEST * tall / span, 0.0]),
                np.array([_LARGEST * tall / span, _LARGEST * tall]),
            ),
        )
        slope, height = found.values
        power = exponent if exponent is not None else float(point[2])
        lost: tuple[str, ...] = ()
        if height <= _FLAT * tall:
            height = _FLAT * tall
            lost = ("beta", "gamma", *(() if known else ("exponent",)))
        alpha, beta_fraction = 1.0 / float(np.exp(point[0])), float(point[1])
        slope += height * alpha if loops.carried else 0.0
        operator = cls(
            slope=slope / height,
            scale=height,
            alpha=alpha,
            beta=beta_fraction * alpha,
            gamma=(1.0 - beta_fraction) * alpha,
            exponent=power,
            offset=loops.find_offset(found),
        )
        return loops.report(operator, found, lost=lost)

    def _advance(self, inputs: Floats, last: Floats, memory: Floats) -> Floats:
        beta_fraction = self.beta / (self.beta + self.gamma)
        normalised = np.clip(memory / self.bound, -1.0, 1.0)
        state = self.bound * kernels.run_bouc_wen(
            inputs, self.exponent, beta_fraction, self.alpha / self.bound, last, normalised
        )
        memory[...] = normalised * self.bound
        return np.asarray(self.scale * (self.slope * inputs - state) + self.offset)

    def _check_memory(self, memory: Floats) -> None:
        beyond = np.abs(memory) > self.bound * (1.0 + 1e-12)
        must = f"it must lie in [{-self.bound:g}, {self.bound:g}]"
        refuse_first(beyond, "memory{} of the initial state", memory, must)


def _run_normalised(
    inputs: Floats, exponent: float, beta_fraction: float, yield_input: float
) -> Floats:
    """Return h over its bound (m, n), from rest; `yield_input` is the input that would yield it."""
    last, memory = np.zeros(len(inputs)), np.zeros((len(inputs), 1))
    state = kernels.run_bouc_wen(inputs, exponent, beta_fraction, 1.0 / yield_input, last, memory)
    return np.asarray(state)
