"""A band of friction about a mean curve, (2.49)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import broadcast, check_array, check_number, name_at
from ...errors import InputError
from . import _kernels
from ._loops import Loops
from .fit import HysteresisFit, fit_linear
from .operator import LIMIT, Operator, take_history

__all__ = ["FrictionBand"]

Floats = NDArray[np.float64]


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

    kappa1: float
    kappa2: float = 0.0

    def __post_init__(self) -> None:
        for name in ("kappa1", "kappa2"):
            value = check_number(name, getattr(self, name), low=-LIMIT, high=LIMIT)
            object.__setattr__(self, name, value)

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
        rows = int(np.prod(pressures.shape[:-1], dtype=np.int64))
        flat = np.ascontiguousarray(pressures.reshape(rows, pressures.shape[-1]))
        steps = np.sign(np.diff(flat, axis=-1, prepend=0.0))
        ways = _hold_last(steps).reshape(pressures.shape)
        return np.asarray(forces * (1.0 - ways * self.friction(pressures)))

    @classmethod
    def identify(
        cls, history: ArrayLike, response: ArrayLike, *, skip: int = 0
    ) -> HysteresisFit[FrictionBand]:
        """Fit kappa1 and kappa2 to measured loops: linear least squares with bounds.

        Parameters
        ----------
        history, response : array_like, shape (..., n)
            Pressures in the order of time, each history from rest at 0, and the pressures that
            would give the same without friction.
        skip : int
            Samples at the beginning of each history that only move the memory.

        Raises
        ------
        InputError
            If they are not finite arrays of one shape, or the pressure is constant.
        """
        loops = Loops.take(history, response, skip)
        inputs = loops.inputs
        low, high = float(inputs.min()), float(inputs.max())
        share = (inputs - low) / (high - low)
        ways = _hold_last(np.sign(np.diff(inputs, axis=-1, prepend=0.0)))
        loss = -ways * inputs
        columns = np.stack([loss * (1.0 - share), loss * share], axis=-1)
        rest = loops.target - loops.pick(inputs[..., None])[:, 0]
        found = fit_linear(
            loops.pick(columns), rest, names=("kappa1", "kappa2"), high=1.0, offset=False
        )
        first, last = found.values
        kappa2 = -(last - first) / (high - low)
        return loops.report(cls(-first - kappa2 * low, kappa2), found)

    def _advance(self, inputs: Floats, last: Floats, memory: Floats) -> Floats:
        return np.asarray(
            _kernels.run_friction_band(inputs, self.kappa1, self.kappa2, last, memory)
        )

    def _check_history(self, inputs: Floats, last: Floats | None) -> None:
        frictions = self.friction(inputs)
        beyond = (frictions < -1e-12) | (frictions > 1.0 + 1e-12)
        if beyond.any():
            index = int(np.argmax(beyond))
            raise InputError(
                f"{name_at('history', inputs, index)} is {inputs.flat[index]:g}: there mu = "
                f"-(kappa1 + kappa2 P) is {frictions.flat[index]:g}: it must lie in [0, 1]"
            )

    def _check_memory(self, memory: Floats) -> None:
        wrong = ~np.isin(memory, (-1.0, 0.0, 1.0))
        if wrong.any():
            index = int(np.argmax(wrong))
            raise InputError(
                f"{name_at('memory', memory, index)} of the initial state is "
                f"{memory.flat[index]:g}: it must be -1, 0 or 1"
            )


def _hold_last(steps: Floats) -> Floats:
    """Return the last step that was not 0, at each sample (m, n)."""
    places = np.where(steps != 0.0, np.arange(steps.shape[-1]), 0)
    return np.take_along_axis(steps, np.maximum.accumulate(places, axis=-1), axis=-1)
