"""What every muscle model answers, and what the models share."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import broadcast, check_array, check_range, name_at
from ..errors import BozziniError, InputError
from .design import Muscle
from .hysteresis import Hysteresis

__all__ = [
    "DIRECTIONS",
    "LOAD_LIMIT",
    "ConvergenceError",
    "HistoryModel",
    "MuscleModel",
    "MuscleState",
    "StaticModel",
    "broadcast",
    "check_array",
    "check_hysteresis",
    "check_range",
    "demand_convergence",
    "describe_stop",
    "name_at",
    "parse_direction",
]

Floats = NDArray[np.float64]

DIRECTIONS = {"inflating": -1.0, "": 0.0, "deflating": 1.0}
"""Sign of friction in the pull of the muscle: it pulls less on the way up, more on the way down."""


LOAD_LIMIT = 1e15
"""Largest legal load [N]: a limit of the arithmetic, above what any legal muscle pulls."""


class ConvergenceError(BozziniError, ArithmeticError):
    """An iteration ran out of steps before it met its tolerance."""


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


@runtime_checkable
class HistoryModel(MuscleModel, Protocol):
    """A `MuscleModel` that can carry hysteresis, as all models of this package do."""

    @property
    def hysteresis(self) -> Hysteresis | None:
        """The operator of `trace_contraction`; None without hysteresis."""
        ...

    def trace_contraction(self, pressure: ArrayLike, load: ArrayLike = 0.0) -> Floats:
        """Return the contraction [mm] along a history of pressures."""
        ...


class StaticModel(ABC):
    """What the models of this package share; a subclass brings `solve`, `force` and the rest.

    Attributes
    ----------
    unused : tuple of str
        Fields of `Muscle` that make no difference to the model.
    """

    unused: ClassVar[tuple[str, ...]] = ()

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
    def stiffness(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return ``-d force / d contraction`` [N/mm] at a pressure, along a branch of friction."""

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

        Raises
        ------
        InputError
            As `contraction` does, if the pressures are not a sequence, or if `hysteresis` gives
            other than a pressure for each.
        """
        history = np.atleast_1d(check_array("pressure", pressure))
        if history.ndim != 1:
            raise InputError(f"pressure has shape {history.shape}: a history has (n,)")
        if self.hysteresis is None:
            return self.contraction(history, load)
        acting = check_array("pressure from the hysteresis", self.hysteresis.apply(history))
        if acting.shape != history.shape:
            raise InputError(
                f"pressure from the hysteresis has shape {acting.shape}: it must be {history.shape}"
            )
        check_range("pressure from the hysteresis", acting, 0.0, math.inf, "MPa")
        return self.contraction(acting, load)


def check_hysteresis(operator: object) -> None:
    """Raise `InputError` if a model cannot carry this as its `hysteresis`."""
    if operator is not None and not isinstance(operator, Hysteresis):
        raise InputError(
            f"hysteresis is a {type(operator).__name__}: it must have a method 'apply', or be None"
        )


def demand_convergence(
    pressures: Floats, iterations: NDArray[np.int64], limit: int, *, model: str
) -> None:
    """Raise `ConvergenceError` that names the first pressure whose iteration ran to the limit."""
    if iterations.size and iterations.max() >= limit:
        index = int(np.argmax(iterations >= limit))
        raise ConvergenceError(
            f"no solution of the {model} model at {name_at('pressure', pressures, index)} = "
            f"{pressures.flat[index]:g} MPa: {describe_stop(limit)}"
        )


def describe_stop(limit: int) -> str:
    """Return why an iteration stopped that did not converge."""
    return f"the tolerance was not met within {limit} iterations"


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
