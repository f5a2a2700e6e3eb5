"""Friction as hysteresis: Maxwell slips and a band about a mean curve (thesis 2.2.10)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ...checks import broadcast, check_array, check_integer, check_number, refuse_first
from ...errors import InputError
from ...numeric.arrays import Floats
from ..kernels import hysteresis as kernels
from .operator import (
    LIMIT,
    HysteresisFit,
    LoopOptions,
    Loops,
    Operator,
    list_rows,
    number,
    numbers,
    take_history,
    take_increasing,
    take_numbers,
    take_same_count,
)
from .prandtl_ishlinskii import BEYOND, Plays, PlaySum, PrandtlIshlinskii, choose_thresholds


@dataclass(frozen=True)
class MaxwellSlip(Operator):
    """Elements that stretch until they slip, in parallel; the text below the thesis's (2.51).

    Each element is a spring in series with a slider::

        F_i = min(max(F_i before + k_i (change of input), -w_i), w_i)      output = sum of F_i

    The thesis's way to the same is (2.51): every branch after a return point is the virgin curve,
    `load_virgin`, twice as large. The input is a contraction or a strain and the output
    a force, or both are pressures: `to_plays` then gives the pressure that is left.

    Parameters
    ----------
    stiffnesses : sequence of float
        k, above 0 [output per input].
    limits : sequence of float
        w, at which elements slip, above 0 [output].

    Raises
    ------
    InputError
        If they are no such numbers, or not as many.
    """

    stiffnesses: tuple[float, ...] = numbers(low=0.0, low_open=True)
    limits: tuple[float, ...] = numbers(low=0.0, low_open=True, like="stiffnesses")

    @property
    def memory_size(self) -> int:
        """How many elements there are; each remembers its force."""
        return len(self.limits)

    @property
    def saturation(self) -> float:
        """Largest output, with all elements slipping: the sum of the limits."""
        return sum(self.limits)

    def load_virgin(self, input_: ArrayLike) -> Floats:
        """Return the virgin curve y, the output where the input goes from rest one way only."""
        inputs = check_array("input", input_)[..., None]
        limits = np.array(self.limits)
        return np.asarray(np.clip(inputs * self.stiffnesses, -limits, limits).sum(axis=-1))

    def to_plays(self, *, slope: float = 1.0) -> PrandtlIshlinskii:
        """Return ``slope`` times the input less this operator, which is a `PrandtlIshlinskii`.

        An element is its stiffness times the input less a play of half width w / k. With inputs
        and outputs in MPa, that is the pressure that acts, for a muscle model to carry.

        Raises
        ------
        InputError
            If `slope` is not a number.
        """
        slope = check_number("slope", slope, low=-LIMIT, high=LIMIT)
        weights: dict[float, float] = {0.0: slope}
        for stiffness, limit in zip(self.stiffnesses, self.limits, strict=True):
            reach = limit / stiffness
            weights[0.0] -= stiffness
            weights[reach] = weights.get(reach, 0.0) + stiffness
        reaches = sorted(weights)
        return PrandtlIshlinskii(tuple(reaches), tuple(weights[reach] for reach in reaches))

    @classmethod
    def from_virgin_curve(cls, inputs: ArrayLike, outputs: ArrayLike) -> MaxwellSlip:
        """Return the elements of a virgin curve given by its corners, beyond which it is level.

        Parameters
        ----------
        inputs, outputs : array_like, shape (k,)
            Corners after (0, 0), in order. The slope must fall from each piece to the next.

        Raises
        ------
        InputError
            If they are not sequences of one length, or are no such curve.
        """
        points = take_increasing(
            "inputs", check_array("inputs", inputs).ravel().tolist(), low_open=True
        )
        heights = take_numbers("outputs", check_array("outputs", outputs).ravel().tolist())
        take_same_count("inputs", points, "outputs", heights)
        slopes = np.append(np.diff((0.0, *heights)) / np.diff((0.0, *points)), 0.0)
        stiffnesses = slopes[:-1] - slopes[1:]
        if stiffnesses.min() <= 0.0:
            index = int(np.argmax(stiffnesses <= 0.0))
            raise InputError(
                f"outputs[{index}] is {heights[index]:g}: the slope there goes from "
                f"{slopes[index]:g} to {slopes[index + 1]:g}, and must fall"
            )
        return cls(tuple(stiffnesses.tolist()), tuple((stiffnesses * points).tolist()))

    @classmethod
    def identify(
        cls,
        history: ArrayLike,
        response: ArrayLike,
        *,
        yields: Sequence[float] | None = None,
        count: int = 10,
        options: LoopOptions | None = None,
    ) -> HysteresisFit[MaxwellSlip]:
        """Fit the elements to measured loops: linear least squares with bounds.

        The output has no offset. Elements of which nothing is left are dropped.

        History, response and options are those of all operators, see `Operator`.

        Parameters
        ----------
        yields : sequence of float, optional
            Inputs w / k at which elements slip; else `count` of them, evenly up to half the span.
        count : int
            How many, 1 to 200.
        """
        loops = Loops.take(history, response, options)
        inputs = loops.inputs
        given = choose_thresholds(
            loops.fitted_inputs, yields, count, counts=(1, 200), from_zero=False
        )
        yields = take_increasing("yields", given, low_open=True)
        found = loops.fit(
            kernels.trace_slips(inputs, np.array(yields)),
            names=[f"stiffnesses[{i}]" for i in range(len(yields))],
            offset=False,
        )
        stiffest = max(found.values)
        pairs = [(k, r) for k, r in zip(found.values, yields, strict=True) if k > 1e-12 * stiffest]
        if not pairs:
            raise InputError(
                "response does not resist the history anywhere: stiffnesses of 0 fit it best"
            )
        operator = cls(tuple(k for k, _ in pairs), tuple(k * r for k, r in pairs))
        return loops.report(operator, found)

    def _advance(self, inputs: Floats, last: Floats, memory: Floats) -> Floats:
        stiffnesses, limits = np.array(self.stiffnesses), np.array(self.limits)
        return np.asarray(kernels.run_slips(inputs, stiffnesses, limits, last, memory))

    def _check_memory(self, memory: Floats) -> None:
        beyond = np.abs(memory) > np.array(self.limits) * (1.0 + 1e-12)

        def must(index: int) -> str:
            limit = self.limits[index % len(self.limits)]
            return f"it must lie in [{-limit:g}, {limit:g}]"

        refuse_first(beyond, "memory{} of the initial state", memory, must)


@dataclass(frozen=True)
class MaxwellFriction(PlaySum):
    """The pressure that Maxwell slips leave: ``slope`` times the input less a `MaxwellSlip`.

    It is `MaxwellSlip.to_plays`, so what a `PrandtlIshlinskii` with a play of half width 0 does, by
    the constants of springs and sliders; a model can carry it. `slips` is the friction alone.

    Parameters
    ----------
    slope : float
        Output per input with all elements slipping the same way.
    stiffnesses, limits : sequence of float
        Of `MaxwellSlip`.

    Raises
    ------
    InputError
        If they are no such numbers.
    """

    slope: float = number()
    stiffnesses: tuple[float, ...] = numbers(low=0.0, low_open=True)
    limits: tuple[float, ...] = numbers(low=0.0, low_open=True, like="stiffnesses")

    @property
    def slips(self) -> MaxwellSlip:
        """The slips, whose output is taken off."""
        return MaxwellSlip(self.stiffnesses, self.limits)

    @property
    def plays(self) -> PrandtlIshlinskii:
        """The same as plays."""
        return self.slips.to_plays(slope=self.slope)

    @classmethod
    def identify(
        cls,
        history: ArrayLike,
        response: ArrayLike,
        *,
        yields: Sequence[float] | None = None,
        count: int = 10,
        options: LoopOptions | None = None,
    ) -> HysteresisFit[MaxwellFriction]:
        """Fit slope and elements to measured loops, as `PrandtlIshlinskii.identify` does.

        History, response and options are those of all operators, see `Operator`. What is fitted
        has no offset. Elements of which nothing is left are dropped.

        Parameters
        ----------
        yields : sequence of float, optional
            Inputs w / k at which elements slip; else as many as `count` plays have, the first of
            which is the input itself.
        count : int
            How many plays, 2 to 200.

        Raises
        ------
        InputError
            If the response shows no friction.
        """
        count = check_integer("count", count, low=2, high=200)
        options = replace(LoopOptions() if options is None else options, carried=True)
        if yields is not None:
            yields = (0.0, *take_increasing("yields", yields, low_open=True))
        found = PrandtlIshlinskii.identify(
            history, response, thresholds=yields, count=count, options=options
        )
        weights, reaches = found.operator.weights, found.operator.thresholds
        slope = sum(weights)
        kept = [i for i in range(1, len(weights)) if weights[i] > 1e-12 * slope]
        if not kept:
            raise InputError("response shows no friction: plays of no width fit it best")
        operator = cls(
            slope,
            tuple(weights[i] for i in kept),
            tuple(weights[i] * reaches[i] for i in kept),
        )
        names = {f"weights[{i}]": f"stiffnesses[{place}]" for place, i in enumerate(kept)}
        lost = tuple(
            names.get(name, "slope") for name in found.undetermined
            if name in names or name == "weights[0]"
        )  # fmt: skip
        return HysteresisFit(**{**vars(found), "operator": operator, "undetermined": lost})

    def _plays(self) -> Plays:
        return self.plays._plays()

    @property
    def _steepness(self) -> float:
        return self.plays._steepness


@dataclass(frozen=True)
class FrictionBand(Operator):
    """A share of the static force is lost to friction one way and comes on top the other, (2.49).

    Along a history of pressures::

        F = F_stat (1 - mu) rising, F_stat (1 + mu) falling       mu = -(kappa1 + kappa2 P)

    As printed: friction is ``-mu F_stat = (kappa1 + kappa2 P) F_stat``, so kappa1 and kappa2 are
    such that mu is 0 or more. (The text below the equation calls them k1 and k2.) All that is
    remembered is which way the pressure went last; before it has changed, the mean curve holds. At
    a return point the output jumps.

    A model that carries it, by `apply`, gets the pressure ``P (1 -/+ mu)``: for a force that is in
    proportion to the pressure that is (2.49) itself. `force` is (2.49) for any.

    Parameters
    ----------
    kappa1, kappa2 : float
        Constants [-] and [1/MPa].

    Raises
    ------
    InputError
        If they are not numbers; at `run`, if a pressure has a mu outside [0, 1].
    """

    kappa1: float = number()
    kappa2: float = number(default=0.0)

    @property
    def memory_size(self) -> int:
        """One: +1 after a rise, -1 after a fall, 0 before either."""
        return 1

    def friction(self, pressure: ArrayLike) -> Floats:
        """Return mu at pressures [MPa]."""
        return np.asarray(-(self.kappa1 + self.kappa2 * check_array("pressure", pressure)))

    def force(self, static_force: ArrayLike, pressure: ArrayLike) -> Floats:
        """Return the force [N] along a history of pressures, thesis (2.49).

        Parameters
        ----------
        static_force : array_like, shape (..., n)
            Force without friction [N].
        pressure : array_like, shape (..., n)
            Pressures in the order of time [MPa].

        Raises
        ------
        InputError
            As `run` does, and if the shapes do not go together.
        """
        forces = check_array("static_force", static_force)
        forces, pressures = broadcast(
            ("static_force", take_history("static_force", np.atleast_1d(forces))),
            ("pressure", take_history("pressure", pressure)),
        )
        self._check_history(pressures, None)
        steps = np.sign(np.diff(list_rows(pressures), axis=-1, prepend=0.0))
        ways = _hold_last(steps).reshape(pressures.shape)
        return np.asarray(forces * (1.0 - ways * self.friction(pressures)))

    @classmethod
    def identify(
        cls, history: ArrayLike, response: ArrayLike, *, options: LoopOptions | None = None
    ) -> HysteresisFit[FrictionBand]:
        """Fit kappa1 and kappa2 to measured loops: linear least squares with bounds.

        History, response and options are those of all operators, see `Operator`; the response has
        the pressures that would give the same without friction.
        """
        loops = Loops.take(history, response, options)
        inputs = loops.inputs
        low, high = float(inputs.min()), float(inputs.max())
        if loops.carried:  # it is legal from rest to beyond what was seen
            low, high = min(low, 0.0), BEYOND * high
        share = (inputs - low) / (high - low)
        ways = _hold_last(np.sign(np.diff(inputs, axis=-1, prepend=0.0)))
        loss = -ways * inputs
        columns = np.stack([loss * (1.0 - share), loss * share], axis=-1)
        rest = replace(loops, response=loops.response - loops.history)
        found = rest.fit(columns, names=("kappa1", "kappa2"), offset=False, limits=(0.0, 1.0))
        first, last = found.values
        kappa2 = -(last - first) / (high - low)
        return loops.report(cls(-first - kappa2 * low, kappa2), found)

    def _advance(self, inputs: Floats, last: Floats, memory: Floats) -> Floats:
        return np.asarray(kernels.run_friction_band(inputs, self.kappa1, self.kappa2, last, memory))

    def _check_history(self, inputs: Floats, last: Floats | None) -> None:
        frictions = self.friction(inputs)
        beyond = (frictions < -1e-12) | (frictions > 1.0 + 1e-12)
        refuse_first(
            beyond,
            "history",
            inputs,
            lambda index: (
                f"there mu = -(kappa1 + kappa2 P) is {frictions.flat[index]:g}: it must lie in "
                "[0, 1]"
            ),
        )

    def _check_memory(self, memory: Floats) -> None:
        wrong = ~np.isin(memory, (-1.0, 0.0, 1.0))
        refuse_first(wrong, "memory{} of the initial state", memory, "it must be -1, 0 or 1")


def _hold_last(steps: Floats) -> Floats:
    """Return the last step that was not 0, at each sample (m, n)."""
    places = np.where(steps != 0.0, np.arange(steps.shape[-1]), 0)
    return np.take_along_axis(steps, np.maximum.accumulate(places, axis=-1), axis=-1)
