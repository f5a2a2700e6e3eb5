"""What every muscle model answers, and what the models share."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .design import Muscle
from .hysteresis import Hysteresis

__all__ = ["DIRECTIONS", "MuscleModel", "MuscleState", "StaticModel"]

Floats = NDArray[np.float64]

DIRECTIONS = {"inflating": -1.0, "": 0.0, "deflating": 1.0}
"""Sign of friction in the pull of the muscle: it pulls less on the way up, more on the way down."""


@dataclass(frozen=True)
class MuscleState:
    """A muscle at rest under pressure and load. All attributes are arrays of one shape.

    Attributes
    ----------
    contraction, length : (...) ndarray
        How much shorter than at rest the muscle is, and how long it is [mm].
    braid_angle : (...) ndarray
        Angle between strands and axis [rad].
    contact_pressure : (...) ndarray
        Pressure between tube and braid [MPa]; 0 in the gap phase, when they do not touch.
    force : (...) ndarray
        Pull of the muscle, which is the load [N].
    converged : (...) ndarray of bool
        Whether the solver met its tolerance.
    residual : (...) ndarray
        Pull less load at the answer, or the model's own equation left over [N].
    iterations : (...) ndarray of int
        Steps of the solver.
    reason : (...) ndarray of str
        Why the solver stopped where it did not converge; empty where it did.
    """

    contraction: Floats
    length: Floats
    braid_angle: Floats
    contact_pressure: Floats
    force: Floats
    converged: NDArray[np.bool_]
    residual: Floats
    iterations: NDArray[np.int64]
    reason: NDArray[np.str_]

    @property
    def in_contact(self) -> NDArray[np.bool_]:
        """Whether the braid presses on the tube."""
        return np.asarray(self.contact_pressure > 0.0)


@runtime_checkable
class MuscleModel(Protocol):
    """Anything that tells force from contraction and contraction from load.

    Everything is batch-wise: arguments are broadcast and the answer is an array of their common
    shape. An argument outside the legal range raises `InputError`; no answer is ever NaN.
    """

    @property
    def muscle(self) -> Muscle:
        """The muscle's design."""
        ...

    @property
    def name(self) -> str:
        """The model's name in `MODELS`."""
        ...

    def force(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the pull [N] at `pressure` [MPa] and `contraction` [mm]."""
        ...

    def contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the contraction [mm] at `pressure` [MPa] under `load` [N]."""
        ...

    def stiffness(self, pressure: ArrayLike, contraction: ArrayLike) -> Floats:
        """Return ``-d force / d contraction`` [N/mm] at a pressure, without friction."""
        ...

    def blocked_force(self, pressure: ArrayLike) -> Floats:
        """Return the pull [N] at the free length."""
        ...

    def free_contraction(self, pressure: ArrayLike) -> Floats:
        """Return the contraction [mm] without load."""
        ...

    def dead_band(self) -> float:
        """Return the pressure at which the unloaded tube meets the braid [MPa]."""
        ...

    def braid_angle(self, pressure: ArrayLike, load: ArrayLike = 0.0) -> Floats:
        """Return the angle between strands and axis [rad]."""
        ...

    def solve(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> MuscleState:
        """Return everything the model says about the muscle under `pressure` and `load`."""
        ...


class StaticModel(ABC):
    """What the models of this package share; a subclass brings `solve`, `force` and the rest."""

    muscle: Muscle
    name: str
    hysteresis: Hysteresis | None

    @abstractmethod
    def force(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the pull [N] at `pressure` [MPa] and `contraction` [mm]."""

    @abstractmethod
    def contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the contraction [mm] at `pressure` [MPa] under `load` [N]."""

    @abstractmethod
    def stiffness(self, pressure: ArrayLike, contraction: ArrayLike) -> Floats:
        """Return ``-d force / d contraction`` [N/mm] at a pressure, without friction."""

    @abstractmethod
    def dead_band(self) -> float:
        """Return the pressure at which the unloaded tube meets the braid [MPa]."""

    @abstractmethod
    def solve(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> MuscleState:
        """Return everything the model says about the muscle under `pressure` and `load`."""

    def blocked_force(self, pressure: ArrayLike) -> Floats:
        """Return the pull [N] at the free length.

        Raises
        ------
        InputError
            As `force` does.
        """
        return self.force(pressure, 0.0)

    def free_contraction(self, pressure: ArrayLike) -> Floats:
        """Return the contraction [mm] without load.

        Raises
        ------
        InputError
            As `contraction` does.
        """
        return self.contraction(pressure)

    def braid_angle(self, pressure: ArrayLike, load: ArrayLike = 0.0) -> Floats:
        """Return the angle between strands and axis [rad].

        Raises
        ------
        InputError
            As `solve` does.
        """
        return self.solve(pressure, load).braid_angle

    def trace_contraction(self, pressure: ArrayLike, load: ArrayLike = 0.0) -> Floats:
        """Return the contraction [mm] along a history of pressures, with the muscle's hysteresis.

        Parameters
        ----------
        pressure : array_like, shape (n,)
            Pressures in the order of time [MPa].
        load : array_like, shape () or (n,)
            Loads [N].

        Returns
        -------
        (n,) ndarray
            Contraction after each pressure, from `contraction` at the pressure that
            `hysteresis.apply` puts in its place; the same as `contraction` without hysteresis.
        """
        history = np.atleast_1d(check_array("pressure", pressure))
        if self.hysteresis is not None:
            history = np.asarray(self.hysteresis.apply(history), dtype=np.float64)
        return self.contraction(history, load)


def check_array(name: str, values: ArrayLike) -> Floats:
    """Return `values` as an array of floats, or raise `InputError`."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} is {values!r}: it must be a number or an array") from None


def check_range(
    name: str, values: Floats, low: float, high: float, unit: str, *, slack: float = 0.0
) -> None:
    """Raise `InputError` that names the first of `values` outside `[low, high]`, NaN included.

    `slack` is what is let through on either side as round-off.
    """
    least, most = low - slack, high + slack
    if values.size and not (values.min() >= least and values.max() <= most):
        index = int(np.argmin((values >= least) & (values <= most)))
        raise InputError(
            f"{name_at(name, values, index)} is {values.flat[index]:g} {unit}: "
            f"it must lie in [{low:g}, {high:g}] {unit}"
        )


def name_at(name: str, values: NDArray[Any], index: int) -> str:
    """Return the name of the `index`-th of `values`, ``load[2, 1]`` for example."""
    if values.ndim == 0:
        return name
    place = ", ".join(str(i) for i in np.unravel_index(index, values.shape))
    return f"{name}[{place}]"


def broadcast(*named: tuple[str, Floats]) -> tuple[Floats, ...]:
    """Return the arrays, contiguous and of one shape, or raise `InputError`."""
    try:
        shape = np.broadcast_shapes(*(array.shape for _, array in named))
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in named)
        raise InputError(f"these shapes do not go together: {shapes}") from None
    # np.ascontiguousarray would turn a single number into an array of one.
    return tuple(np.require(np.broadcast_to(array, shape), requirements="C") for _, array in named)


def parse_direction(direction: ArrayLike | None) -> Floats:
    """Turn ``"inflating"``, ``"deflating"``, ``""`` or None, or an array of them, into signs."""
    if direction is None:
        return np.asarray(0.0)
    if isinstance(direction, str) and direction in DIRECTIONS:
        return np.asarray(DIRECTIONS[direction])
    words = np.asarray(direction)
    try:
        signs = [DIRECTIONS["" if word is None else str(word)] for word in words.ravel().tolist()]
    except KeyError as error:
        raise InputError(
            f"direction is '{error.args[0]}': it must be 'inflating', 'deflating' or empty"
        ) from None
    return np.asarray(signs, dtype=np.float64).reshape(words.shape)


def bisect(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where an increasing `function` crosses zero in `[low, high]`, to the last bits."""
    for _ in range(200):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if function(middle) > 0.0:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high) if math.isfinite(low + high) else low
