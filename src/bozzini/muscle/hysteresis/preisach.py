"""Preisach: a weighted sum of relays, and van Damme's force with it (thesis 2.2.10)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...checks import broadcast, check_array, check_integer, check_range, refuse_first
from ...errors import InputError
from ...numeric.arrays import Floats
from ...results import Shown
from ..kernels import hysteresis as kernels
from .operator import (
    LIMIT,
    HysteresisFit,
    HysteresisState,
    LoopOptions,
    Loops,
    Operator,
    number,
    numbers,
    take_fields,
    take_history,
    take_increasing,
)


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

    levels: tuple[float, ...] = numbers(increasing=True, low=-LIMIT)
    weights: tuple[float, ...] = numbers()
    offset: float = number(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        count, steps = len(self.levels), len(self.levels) - 1
        if not 1 <= steps <= 200:
            raise InputError(f"levels has {count} number(s): it must have 2 to 201")
        if len(self.weights) != steps * (steps + 1) // 2:
            raise InputError(
                f"weights has {len(self.weights)} number(s): with {count} levels it must have "
                f"{steps * (steps + 1) // 2}"
            )

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
        options: LoopOptions | None = None,
    ) -> HysteresisFit[Preisach]:
        """Fit weights and offset to measured loops: linear least squares with bounds.

        To determine all weights it takes reversals at all levels: loops that grow or shrink step by
        step. `HysteresisFit.undetermined` names the weights that the history does not determine.

        History, response and options are those of all operators, see `Operator`.

        Parameters
        ----------
        levels : sequence of float, optional
            Levels; else `count` even steps over the span of the history.
        count : int
            How many steps, 1 to 40.
        signed : bool
            Whether weights may be negative; without, they are 0 or more.
        """
        loops = Loops.take(history, response, options)
        count = check_integer("count", count, low=1, high=40)
        inputs = loops.inputs
        given: Sequence[float] = (
            np.linspace(inputs.min(), inputs.max(), count + 1).tolist()
            if levels is None
            else levels
        )
        levels = take_increasing("levels", given, low=-LIMIT)
        steps = len(levels) - 1
        cls(levels, (0.0,) * (steps * (steps + 1) // 2))
        memory = np.full((len(inputs), steps * (steps + 1) // 2), -1.0)
        last = np.full(len(inputs), levels[0])
        # Of an operator that is carried the output at rest is 0, not that in the middle.
        low = -1.0 if loops.carried else 0.0
        found = loops.fit(
            kernels.trace_relays(inputs, np.array(levels), last, memory) - low,
            names=[f"weights[{i}]" for i in range(memory.shape[1])],
            limits=(-LIMIT if signed else 0.0, np.inf),
        )
        # A little more than their sum, or rounding could make the output at rest negative.
        total = (1.0 + 1e-12) * sum(found.values)
        middle = total if loops.carried else loops.find_offset(found)
        return loops.report(cls(levels, found.values, offset=middle), found)

    def _advance(self, inputs: Floats, last: Floats, memory: Floats) -> Floats:
        return np.asarray(
            kernels.run_relays(
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


@dataclass(frozen=True, kw_only=True)
class PreisachForce(Shown):
    """Force of a pleated muscle along a history of strains, thesis (2.50).

    A mean curve, and relays about it::

        F = P l0**2 f(e) (1 + scale (W[e] - W_fit(e)))
        f(e) = kappa0 / e + kappa1 + kappa2 e + kappa3 e**2 + kappa4 e**3

    M. Van Damme et al., Modeling hysteresis in pleated pneumatic artificial muscles, IEEE
    Conference on Robotics, Automation and Mechatronics, 2008. Neither the weights of W nor
    ``W_fit``, "a curve fitted between the two curves generated by W", are in the thesis; here it is
    the mean of both branches of W's major loop. There is no force at a strain of 0, a pole of f.

    Parameters
    ----------
    length : float
        l0 [mm].
    coefficients : sequence of float
        kappa0 to kappa4.
    scale : float
        kappa_scale; 0 for the mean curve alone.
    relays : Preisach
        W, over strains.

    Raises
    ------
    InputError
        If they are no such numbers, or `relays` is not a `Preisach`.
    """

    length: float = number(0.0, 1e6, low_open=True, kind="length")
    coefficients: tuple[float, ...] = numbers()
    scale: float = number()
    relays: Preisach

    def __post_init__(self) -> None:
        take_fields(self)
        if len(self.coefficients) != 5:
            raise InputError(f"coefficients has {len(self.coefficients)} number(s): it must have 5")
        if not isinstance(self.relays, Preisach):
            raise InputError(f"relays is a {type(self.relays).__name__}: it must be a Preisach")

    def mean_shape(self, strain: ArrayLike) -> Floats:
        """Return f, force over ``P l0**2`` on the mean curve.

        Raises
        ------
        InputError
            If a strain is not above 0.
        """
        strains = _take_strains(check_array("strain", strain))
        first, *rest = self.coefficients
        return np.asarray(first / strains + np.polynomial.polynomial.polyval(strains, rest))

    def force(self, pressure: ArrayLike, strain: ArrayLike) -> Floats:
        """Return the force [N] along a history of strains, from rest at the lowest level.

        Parameters
        ----------
        pressure : array_like, shape () or (..., n)
            Pressures [MPa].
        strain : array_like, shape (..., n)
            Contractions over the length, in the order of time, above 0 and at most 1.

        Raises
        ------
        InputError
            If pressures or strains are out of range, or their shapes do not go together.
        """
        pressures = check_array("pressure", pressure)
        check_range("pressure", pressures, 0.0, LIMIT, "MPa")
        pressures, strains = broadcast(
            ("pressure", pressures), ("strain", _take_strains(take_history("strain", strain)))
        )
        rising, falling = self.relays.trace_major(strains)
        apart = self.relays.apply(strains) - 0.5 * (rising + falling)
        mean = pressures * self.length**2 * self.mean_shape(strains)
        return np.asarray(mean * (1.0 + self.scale * apart))


def _take_strains(strains: Floats) -> Floats:
    refuse_first(~((strains > 0.0) & (strains <= 1.0)), "strain", strains, "it must lie in (0, 1]")
    return strains
