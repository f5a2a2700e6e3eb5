"""A model from an explicit force law: all that a muscle model answers follows from the pull."""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import broadcast, check_array, check_range, name_at
from ...errors import InputError
from ..braid import Braid
from ..model import (
    LOAD_LIMIT,
    ConvergenceError,
    MuscleState,
    StaticModel,
    describe_stop,
    parse_direction,
)
from ._root import MAX_ITERATIONS, STEPS, Roots, find_roots
from ._slope import find_slope

__all__ = ["ANGLES", "PRESSURE_LIMIT", "ExplicitModel"]

ANGLES = (math.radians(0.5), math.radians(89.0))
"""Braid angles at the ends of the legal lengths [rad]: strands nearly straight, nearly hoops."""

PRESSURE_LIMIT = 1e4
"""Largest legal pressure [MPa]: a limit of the arithmetic."""

Floats = NDArray[np.float64]


class ExplicitModel(StaticModel):
    """A muscle whose pull is a function of pressure and length, with or without friction.

    A subclass brings `_pull`; with friction also `_friction`, and whatever of `_length_limits`,
    `_base_lengths`, `_contact_pressure`, `pressure_limits` and `dead_band` is its own. All take and
    return float arrays of one shape, in MPa, mm and N.

    The contraction under a load is where the muscle stops that is let go at its free length: the
    first length on the way at which it pulls with the load. Some laws have others beyond it, past
    a hump for example. The way to the end of the legal lengths is searched in 64 steps; two such
    lengths within one step can both be missed.

    Attributes
    ----------
    braid : Braid
        The braid over the length that contracts.
    """

    braid: Braid

    @property
    def pressure_limits(self) -> tuple[float, float]:
        """Legal pressures [MPa]."""
        return 0.0, PRESSURE_LIMIT

    @property
    def contraction_limits(self) -> tuple[float, float]:
        """Legal contractions [mm], the widest of all pressures: strands straight, strands hoops.

        At some pressures some models have narrower ones; the message of the error has them.
        """
        low, high = self._base_lengths()
        return self.braid.length - high, self.braid.length - low

    def force(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the pull of the muscle [N].

        Parameters
        ----------
        pressure : array_like
            Pressure [MPa].
        contraction : array_like
            How much shorter than at rest the muscle is held [mm].
        direction : str or array of str, optional
            ``"inflating"`` or ``"deflating"`` for the branch of friction; None or ``""`` for the
            curve without friction.

        Raises
        ------
        InputError
            If an argument is outside its legal range, or the law has no finite value there.
        """
        pressures, lengths, signs, _, _ = self._take_lengths(pressure, contraction, direction)
        return self._total(pressures, lengths, signs)

    def stiffness(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return ``-d force / d contraction`` [N/mm] at a pressure, along a branch of friction.

        The slope of a quartic through five lengths, 1/2000 of the legal ones apart: good to about
        1e-8 of the largest slope where the law is smooth, and a mean over a kink.

        Raises
        ------
        InputError
            As `force` does.
        """
        pressures, lengths, signs, low, high = self._take_lengths(pressure, contraction, direction)
        return find_slope(lambda at: self._total(pressures, at, signs), lengths, low, high)

    def contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the contraction under a load [mm]; negative where the muscle is longer.

        Raises
        ------
        InputError
            If an argument is outside its legal range, or the muscle cannot hold the load.
        ConvergenceError
            If the force jumps past the load, or the solver stops short of its tolerance.
        """
        state = self.solve(pressure, load, direction=direction)
        if not state.converged.all():
            index = int(np.argmin(state.converged))
            given = np.broadcast_to(np.asarray(pressure, dtype=np.float64), state.converged.shape)
            raise ConvergenceError(
                f"no solution of the {self.name} model at {name_at('pressure', given, index)} = "
                f"{given.flat[index]:g} MPa: {state.reason.flat[index]}"
            )
        return state.contraction

    def solve(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> MuscleState:
        """Return everything the model says about the muscle under `pressure` and `load`.

        `MuscleState.residual` is pull less load.

        Raises
        ------
        InputError
            If an argument is outside its legal range, or the muscle cannot hold the load.
        """
        pressures, loads, signs, roots = self._find_roots(pressure, load, direction)
        if not roots.found.all():
            raise self._refuse_load(int(np.argmin(roots.found)), pressures, loads, signs)
        lengths = roots.lengths.reshape(pressures.shape)
        iterations = roots.iterations.reshape(pressures.shape)
        jumps = roots.jumps.reshape(pressures.shape)
        stopped = iterations >= MAX_ITERATIONS
        reason = np.where(stopped, describe_stop(MAX_ITERATIONS), "")
        residual = roots.residuals.reshape(pressures.shape)
        contraction = np.asarray(self.braid.length - lengths)
        return MuscleState(
            contraction=contraction,
            length=np.asarray(self.muscle.length - contraction),
            braid_angle=np.arccos(np.minimum(lengths / self.braid.strand_length, 1.0)),
            contact_pressure=self._find_contact(pressures, lengths),
            force=np.asarray(loads + residual),
            converged=np.asarray(~(stopped | jumps)),
            residual=residual,
            iterations=iterations,
            reason=np.where(jumps & ~stopped, "the force jumps past the load", reason),
        )

    def try_contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the contraction [mm], and where there is one: loads too large are no error.

        Where there is none, the contraction is that of the last length tried.

        Raises
        ------
        InputError
            If an argument is outside its legal range.
        """
        pressures, _, _, roots = self._find_roots(pressure, load, direction)
        good = roots.found & ~roots.jumps & (roots.iterations < MAX_ITERATIONS)
        shape = pressures.shape
        return (self.braid.length - roots.lengths).reshape(shape), good.reshape(shape)

    def _find_roots(
        self, pressure: ArrayLike, load: ArrayLike, direction: ArrayLike | None
    ) -> tuple[Floats, Floats, Floats, Roots]:
        """Pressures, loads and signs of friction, of one shape, and the lengths, flat."""
        pressures, loads = check_array("pressure", pressure), check_array("load", load)
        check_range("pressure", pressures, *self.pressure_limits, "MPa")
        check_range("load", loads, 0.0, LOAD_LIMIT, "N")
        pressures, loads, signs = broadcast(
            ("pressure", pressures), ("load", loads), ("direction", parse_direction(direction))
        )
        low, high = self._limit(pressures)
        flat = [x.ravel() for x in (pressures, loads, signs, low, high)]

        def excess(index: NDArray[np.intp], lengths: Floats) -> Floats:
            return self._total(flat[0][index], lengths, flat[2][index]) - flat[1][index]

        start = np.clip(np.full(flat[0].shape, self.braid.length), flat[3], flat[4])
        roots = find_roots(excess, start, flat[3], flat[4])
        return pressures, loads, signs, roots

    def dead_band(self) -> float:
        """Return the pressure below which the muscle does not contract [MPa]; 0 if it has none."""
        return 0.0

    @abstractmethod
    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        """Pull without friction [N]."""

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        """By how much less it pulls on the way up, and more on the way down [N]."""
        return np.zeros(np.shape(pressure))

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        """Pressure between tube and braid [MPa]: all of it, where the wall bears nothing."""
        return pressure

    def _length_limits(self, pressure: Floats) -> tuple[Floats | float, Floats | float]:
        """Smallest and largest legal length at each pressure [mm]."""
        return self._base_lengths()

    def _base_lengths(self) -> tuple[float, float]:
        """Smallest and largest legal length of all pressures [mm]."""
        strand = self.braid.strand_length
        return strand * math.cos(ANGLES[1]), strand * math.cos(ANGLES[0])

    def _total(self, pressure: Floats, length: Floats, sign: Floats) -> Floats:
        """Pull along a branch of friction, finite [N]."""
        with np.errstate(all="ignore"):
            pull = np.asarray(self._pull(pressure, length), dtype=np.float64)
            if sign.any():
                pull = pull + sign * self._friction(pressure, length)
        self._demand_finite(pull, pressure, length)
        return pull

    def _limit(self, pressures: Floats) -> tuple[Floats, Floats]:
        """Smallest and largest legal length, of the pressures' shape."""
        with np.errstate(all="ignore"):
            low, high = self._length_limits(pressures)
        shape = pressures.shape
        return np.broadcast_to(low, shape), np.broadcast_to(high, shape)

    def _take_lengths(
        self, pressure: ArrayLike, contraction: ArrayLike, direction: ArrayLike | None
    ) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Pressures, lengths, signs of friction, and legal lengths, of one shape."""
        pressures, given = (
            check_array("pressure", pressure),
            check_array("contraction", contraction),
        )
        check_range("pressure", pressures, *self.pressure_limits, "MPa")
        pressures, contractions, signs = broadcast(
            ("pressure", pressures),
            ("contraction", given),
            ("direction", parse_direction(direction)),
        )
        low, high = self._limit(pressures)
        rest = self.braid.length
        lengths = rest - contractions
        slack = 1e-9 * rest
        legal = (lengths >= low - slack) & (lengths <= high + slack)
        if not legal.all():
            index = int(np.argmin(legal))
            raise InputError(
                f"{name_at('contraction', contractions, index)} is {contractions.flat[index]:g} "
                f"mm: at a pressure of {pressures.flat[index]:g} MPa it must lie in "
                f"[{rest - high.flat[index]:g}, {rest - low.flat[index]:g}] mm"
            )
        return pressures, np.clip(lengths, low, high), signs, low, high

    def _find_contact(self, pressures: Floats, lengths: Floats) -> Floats:
        """Pressure between tube and braid, 0 where they part [MPa]."""
        with np.errstate(all="ignore"):
            contact = np.asarray(self._contact_pressure(pressures, lengths), dtype=np.float64)
        self._demand_finite(contact, pressures, lengths)
        return np.maximum(contact, 0.0)

    def _demand_finite(self, values: Floats, pressure: Floats, length: Floats) -> None:
        good = np.isfinite(values)
        if not good.all():
            index = int(np.argmin(good))
            raise InputError(
                f"pressure is {pressure.flat[index]:g} MPa and length {length.flat[index]:g} mm: "
                f"the model {self.name} has no answer there, they must be where its law is finite"
            )

    def _refuse_load(
        self, index: int, pressures: Floats, loads: Floats, signs: Floats
    ) -> InputError:
        """Return the error for a load that the muscle cannot hold, with those that it can."""
        pressure = np.full(STEPS + 1, pressures.flat[index])
        low, high = self._limit(pressure)
        start = np.clip(self.braid.length, low[0], high[0])
        sign = np.full(STEPS + 1, signs.flat[index])
        down, up = (
            self._total(pressure, np.linspace(start, end, STEPS + 1), sign)
            for end in (low[0], high[0])
        )
        least, most = max(0.0, float(down.min())), float(up.max())
        legal = f"[{least:.6g}, {most:.6g}] N"
        if most < least:
            legal = f"what it pulls, and at most that is {most:.6g} N"
        return InputError(
            f"{name_at('load', loads, index)} is {loads.flat[index]:g} N: at a pressure of "
            f"{pressure[0]:g} MPa it must lie in {legal}"
        )
