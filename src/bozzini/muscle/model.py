"""The base of all muscle models, and what they share."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import broadcast, check_array, check_number, check_range, name_at, show_value
from ..errors import BozziniError, ConvergenceError, InputError
from ..numeric import roots
from ..numeric.arrays import Floats
from ..results import Result, Shown, tabulated, take_axes
from .design import PRESSURE_LIMIT, Muscle
from .hysteresis import Hysteresis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .models.card import Card, Parameter


DIRECTIONS = {"inflating": -1.0, "": 0.0, "deflating": 1.0}
"""Sign of friction in the pull of the muscle: it pulls less on the way up, more on the way down."""


NUMBERS_LIMIT = 32
"""Largest count of numbers of a compiled model."""

CURVE_POINTS = 201
"""Points of a curve that is drawn."""

_FIRST_PRESSURE = 0.02
"""First step from the lowest pressure when one is looked for that gives a force [MPa]."""

_FORCE_LEFT = 1e-6
"""Share of the forces at a bracket's ends: more is left over only where a force jumps."""

LOAD_LIMIT = 1e15
"""Largest legal load [N]: a limit of the arithmetic, above what any legal muscle pulls."""


@dataclass(frozen=True, kw_only=True)
class MuscleState(Result):
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

    rows_have_verdict = True

    contraction: Floats = tabulated("mm")
    length: Floats = tabulated("mm")
    braid_angle: Floats = tabulated("rad")
    contact_pressure: Floats = tabulated("MPa")
    force: Floats = tabulated("N")
    converged: NDArray[np.bool_]
    residual: Floats = tabulated("N")
    iterations: NDArray[np.int64]
    reason: NDArray[np.str_]

    @property
    def in_contact(self) -> NDArray[np.bool_]:
        """Whether the braid presses on the tube."""
        return np.asarray(self.contact_pressure > 0.0)


@dataclass(frozen=True)
class CompiledMuscle(Shown):
    """A model's equations as C functions, for loops over batches that run compiled.

    `bozzini.muscle.kernels.interface` has their signatures, and makes them of Python functions.
    The addresses hold in the running process only.

    Parameters
    ----------
    numbers : tuple of float
        What the functions take of the model, at most `NUMBERS_LIMIT`.
    start, pull, pressure : int
        Addresses.

    Raises
    ------
    InputError
        If there are more numbers.
    """

    numbers: tuple[float, ...]
    start: int
    pull: int
    pressure: int

    def __post_init__(self) -> None:
        if len(self.numbers) > NUMBERS_LIMIT:
            raise InputError(
                f"a compiled model has {len(self.numbers)} numbers: it must have at most "
                f"{NUMBERS_LIMIT}"
            )


class MuscleModel(Shown, ABC):
    """A model of a muscle: force from contraction, contraction from load, pressure from both.

    A subclass has `muscle` and `name`, and brings `force` and `contraction`. Everything else has a
    default that follows from these, and may be replaced by what the model knows better. All methods
    act on batches: arguments are broadcast, and the answer is an array of their common shape. An
    argument outside the legal range raises `InputError`; no answer is ever NaN.

    Attributes
    ----------
    muscle : Muscle
        The design.
    name : str
        The name in `MODELS`.
    hysteresis : Hysteresis or None
        Operator of `trace_contraction`.
    card : Card or None
        Source, equation and constants of a model of the literature.
    unused : tuple of str
        Fields of `Muscle` that make no difference to the model.
    fit_fields : tuple of str
        Fields of `Muscle`, and numbers of `list_parameters`, that a fit frees by default.
    choices : mapping
        Keywords of the constructor that take a word, and their words; the first is the default.
    extensile : bool
        Whether it holds for a braid above the locking angle, which gets longer under pressure.
    takes_load : bool
        Whether the contraction depends on the load.
    """

    muscle: Muscle
    name: str
    hysteresis: Hysteresis | None = None
    card: ClassVar[Card | None] = None
    unused: ClassVar[tuple[str, ...]] = ()
    fit_fields: ClassVar[tuple[str, ...]] = ("modulus",)
    choices: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType({})
    extensile: ClassVar[bool] = False

    @abstractmethod
    def force(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the pull of the muscle [N]; negative beyond the free contraction.

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
            If an argument is outside its legal range; the message has the first such value.
        """

    @abstractmethod
    def contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the contraction under a load [mm]; negative where the muscle is longer.

        Parameters
        ----------
        pressure : array_like
            Pressure [MPa].
        load : array_like
            Load that the muscle holds [N].
        direction : str or array of str, optional
            As in `force`.

        Raises
        ------
        InputError
            If an argument is outside its legal range, or the muscle cannot hold the load.
        ConvergenceError
            If the solver stops short of its tolerance; `solve` reports where.
        """

    def pressure(
        self, force: ArrayLike, length: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the pressure [MPa] at which the muscle pulls so at a length: the lowest.

        Parameters
        ----------
        force : array_like
            Pull of the muscle [N].
        length : array_like
            Length of the muscle [mm], `Muscle.length` less the contraction.
        direction : str or array of str, optional
            As in `force`.

        Raises
        ------
        InputError
            If no legal pressure gives that force at that length.
        """
        pressures, held = self.try_pressure(force, length, direction=direction)
        if not held.all():
            index = int(np.argmin(held))
            forces, lengths = np.broadcast_arrays(
                np.asarray(force, dtype=np.float64), np.asarray(length, dtype=np.float64)
            )
            low, high = self.pressure_limits
            raise InputError(
                f"{name_at('force', np.broadcast_to(forces, held.shape), index)} is "
                f"{np.broadcast_to(forces, held.shape).flat[index]:g} N: at a length of "
                f"{np.broadcast_to(lengths, held.shape).flat[index]:g} mm no pressure in "
                f"[{low:g}, {high:g}] MPa gives it"
            )
        return pressures

    @property
    def pressure_limits(self) -> tuple[float, float]:
        """Legal pressures [MPa]."""
        return 0.0, PRESSURE_LIMIT

    def try_force(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the pull [N] and where there is one, instead of an error; 0 where there is none.

        Raises
        ------
        InputError
            If the shapes do not go together or a direction is unknown.
        """
        one, other, signs = broadcast(
            ("pressure", check_array("pressure", pressure)),
            ("contraction", check_array("contraction", contraction)),
            ("direction", parse_direction(direction)),
        )
        low, high = getattr(self, "contraction_limits", (-math.inf, math.inf))
        least, most = self.pressure_limits
        legal = (one >= least) & (one <= most) & (other >= low) & (other <= high)
        values, held = np.zeros(one.shape), np.zeros(one.shape, dtype=np.bool_)
        words = None if direction is None else name_directions(signs)[legal]
        values[legal], held[legal] = try_rows(
            self.force, ("pressure", one[legal]), ("contraction", other[legal]), words
        )
        return values, held

    def try_contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the contraction [mm] and where there is one, instead of an error.

        Raises
        ------
        InputError
            If the shapes do not go together or a direction is unknown.
        """
        return try_rows(self.contraction, ("pressure", pressure), ("load", load), direction)

    def try_pressure(
        self, force: ArrayLike, length: ArrayLike, *, direction: ArrayLike | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the pressure [MPa] of a force [N] at a length [mm], and where there is one.

        Pressures are tried from the lowest, in steps that double; the first step in which the
        force passes the one asked for is refined to the last digits. Where it passes in none, it
        may do so twice in one, about a largest or smallest force: that is searched for about the
        pressure tried whose force is nearest.

        Raises
        ------
        InputError
            If the shapes do not go together or a direction is unknown.
        """
        forces, lengths, signs = broadcast(
            ("force", check_array("force", force)),
            ("length", check_array("length", length)),
            ("direction", parse_direction(direction)),
        )
        shape, wanted = forces.shape, forces.ravel()
        contraction = self.muscle.length - lengths.ravel()
        words = name_directions(signs).ravel()

        def excess(index: NDArray[np.intp], pressures: Floats) -> Floats:
            pull, held = self.try_force(pressures, contraction[index], direction=words[index])
            return np.where(held, pull - wanted[index], np.nan)

        every = np.arange(wanted.size)
        low, high = self.pressure_limits
        near = np.full(wanted.shape, low)
        near_excess = excess(every, near)
        tried, left_over = [low], [near_excess.copy()]
        far, far_excess = near.copy(), near_excess.copy()
        found = near_excess == 0.0
        rest, step = every[~found], _FIRST_PRESSURE
        while rest.size:
            at = np.full(rest.shape, min(low + step, high))
            value = excess(rest, at)
            tried.append(float(at[0]))
            left_over.append(np.full(wanted.shape, np.nan))
            left_over[-1][rest] = value
            crossed = near_excess[rest] * value <= 0.0
            found[rest[crossed]] = True
            far[rest], far_excess[rest] = at, value
            left = rest[~crossed]
            near[left], near_excess[left] = at[~crossed], value[~crossed]
            rest = left if at[0] < high else left[:0]
            step *= 2.0
        lost = every[~found]
        if lost.size and len(tried) > 1:
            table = np.array(left_over)[:, lost]
            missed = roots.find_dip(lambda k, x: excess(lost[k], x), np.array(tried), table)
            passed = lost[missed[2]]
            found[passed] = True
            (near[passed], near_excess[passed]), (far[passed], far_excess[passed]) = (
                (at[missed[2]], value[missed[2]]) for at, value in missed[:2]
            )
        inside = every[found & (near_excess != 0.0)]
        answer = near
        if inside.size:
            answer[inside], residual, taken = roots.polish(
                excess,
                inside,
                (near[inside], near_excess[inside]),
                (far[inside], far_excess[inside]),
            )
            ends = np.maximum(np.abs(near_excess), np.abs(far_excess))[inside]
            settled = (np.abs(residual) <= _FORCE_LEFT * ends) & (taken < roots.MAX_ITERATIONS)
            found[inside] = settled
        return np.where(found, answer, 0.0).reshape(shape), found.reshape(shape)

    @classmethod
    def list_parameters(cls) -> tuple[Parameter, ...]:
        """Return the numbers that the model takes beside the muscle, which a fit can free.

        They are those of its card. Without a card they are the fields of a dataclass that are made
        by `bozzini.checks.quantity`.
        """
        from .models.card import make_parameters

        return make_parameters(cls) if cls.card is None else cls.card.parameters

    @property
    def takes_load(self) -> bool:
        """Whether the contraction depends on the load."""
        return True

    @property
    def compiled(self) -> CompiledMuscle | None:
        """The model's equations without friction as compiled functions; None without."""
        return None

    def stiffness(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return ``-d force / d contraction`` [N/mm] at a pressure, along a branch of friction.

        Central differences of `force`, 2e-5 mm apart, unless the model has better.

        Raises
        ------
        InputError
            As `force` does.
        """
        step = 1e-5
        held = np.asarray(contraction, dtype=np.float64)
        behind, ahead = (
            self.force(pressure, held + away, direction=direction) for away in (-step, step)
        )
        return np.asarray((behind - ahead) / (2.0 * step))

    def dead_band(self) -> float:
        """Return the pressure below which the muscle does not contract [MPa]; 0 by default."""
        return 0.0

    def solve(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> MuscleState:
        """Return everything the model gives of the muscle under `pressure` and `load`.

        Where the solver stops short of its tolerance, `MuscleState.converged` is false. By default
        the angle is that of a braid along the whole length, and all of the pressure is on it.

        Raises
        ------
        InputError
            As `contraction` does.
        """
        contraction = np.asarray(self.contraction(pressure, load, direction=direction))
        shape = contraction.shape
        loads = np.broadcast_to(np.asarray(load, dtype=np.float64), shape)
        force = self.force(pressure, contraction, direction=direction) if self.takes_load else loads
        return self._report(
            contraction,
            braid_angle=self.muscle.braid.angle_at(self.muscle.length - contraction),
            contact_pressure=np.array(np.broadcast_to(np.asarray(pressure, np.float64), shape)),
            force=np.array(force),
            residual=np.asarray(force - loads),
            iterations=np.zeros(shape, dtype=np.int64),
        )

    @property
    def _iteration_limit(self) -> int:
        return 1

    def _report(
        self,
        contraction: Floats,
        *,
        braid_angle: Floats,
        contact_pressure: Floats,
        force: Floats,
        residual: Floats,
        iterations: NDArray[np.int64],
    ) -> MuscleState:
        """Return a state; one that took as many iterations as there may be did not converge."""
        limit = self._iteration_limit
        converged = np.asarray(iterations < limit)
        return MuscleState(
            contraction=contraction,
            length=np.asarray(self.muscle.length - contraction),
            braid_angle=braid_angle,
            contact_pressure=contact_pressure,
            force=force,
            converged=converged,
            residual=residual,
            iterations=iterations,
            reason=np.where(converged, "", describe_stop(limit)),
        )

    def blocked_force(self, pressure: ArrayLike) -> Floats:
        """Return the pull [N] at the free length."""
        return self.force(pressure, 0.0)

    def free_contraction(self, pressure: ArrayLike) -> Floats:
        """Return the contraction [mm] without load."""
        return self.contraction(pressure)

    def braid_angle(self, pressure: ArrayLike, load: ArrayLike = 0.0) -> Floats:
        """Return the angle between strands and axis [rad]."""
        return self.solve(pressure, load).braid_angle

    def plot_contraction(
        self,
        pressure: float = 0.8,
        *,
        load: float = 0.0,
        lowest: float = 0.0,
        ax: Axes | None = None,
    ) -> Axes:
        """Draw the contraction over the pressure, up to one [MPa], and return the axes.

        Raises
        ------
        InputError
            As `contraction` does, or if `lowest`, the first pressure drawn [MPa], is above
            `pressure`.
        """
        most = check_number("pressure", pressure, low=0.0, low_open=True, unit="MPa")
        first = check_number("lowest", lowest, low=0.0, high=most, unit="MPa")
        load = check_number("load", load, low=0.0, high=LOAD_LIMIT, unit="N")
        axes = take_axes(ax, x="pressure [kPa]", y="contraction [mm]")
        over = np.linspace(first, most, CURVE_POINTS)
        axes.plot(1e3 * over, self.contraction(over, load), label=self.name)
        return axes

    def plot_force(self, pressure: float = 0.8, *, ax: Axes | None = None) -> Axes:
        """Draw the force over the contraction at a pressure [MPa], and return the axes.

        Raises
        ------
        InputError
            As `force` does.
        """
        held = check_number("pressure", pressure, low=0.0, low_open=True, unit="MPa")
        axes = take_axes(ax, x="contraction [mm]", y="force [N]")
        over = np.linspace(0.0, float(self.free_contraction(held)), CURVE_POINTS)
        axes.plot(over, self.force(held, over), label=f"{1e3 * held:g} kPa")
        return axes

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


def take_arguments(
    pressure: ArrayLike,
    other: tuple[str, ArrayLike],
    direction: ArrayLike | None,
    *,
    most: float,
    limits: tuple[float, float] | None = None,
    slack: float = 0.0,
) -> tuple[Floats, Floats, Floats]:
    """Return pressures up to `most`, loads or contractions, and signs of friction, of one shape.

    The limits of loads are 0 to `LOAD_LIMIT` if none are given.
    """
    name, values = other
    pressures, others = check_array("pressure", pressure), check_array(name, values)
    check_range("pressure", pressures, 0.0, most, "MPa")
    low, high = (0.0, LOAD_LIMIT) if limits is None else limits
    check_range(name, others, low, high, "N" if name == "load" else "mm", slack=slack)
    first, second, third = broadcast(
        ("pressure", pressures), (name, others), ("direction", parse_direction(direction))
    )
    return first, second, third


def name_directions(signs: Floats) -> NDArray[np.str_]:
    """Return the directions that have some signs."""
    return np.array(["", "deflating", "inflating"])[signs.astype(np.int64)]


def try_rows(
    function: Callable[..., Floats],
    first: tuple[str, ArrayLike],
    second: tuple[str, ArrayLike],
    direction: ArrayLike | None,
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the answers of a function, and where it has one: refused batches are halved."""
    one, other, signs = broadcast(
        (first[0], check_array(*first)),
        (second[0], check_array(*second)),
        ("direction", parse_direction(direction)),
    )
    flat, rest = one.ravel(), other.ravel()
    branch = None if direction is None else name_directions(signs).ravel()
    values, held = np.zeros(flat.size), np.zeros(flat.size, dtype=np.bool_)
    parts = [np.arange(flat.size)] if flat.size else []
    while parts:
        rows = parts.pop()
        way = None if branch is None else branch[rows]
        try:
            values[rows] = function(flat[rows], rest[rows], direction=way)
            held[rows] = True
        except BozziniError:
            if rows.size > 1:
                parts += [rows[: rows.size // 2], rows[rows.size // 2 :]]
    return values.reshape(one.shape), held.reshape(one.shape)


def is_as_defined(model: MuscleModel, kind: type[MuscleModel]) -> bool:
    """Whether a model answers as its class does: a subclass may have other equations."""
    names = ("force", "contraction", "stiffness", "free_contraction", "solve")
    return all(getattr(type(model), name) is getattr(kind, name) for name in names)


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
    try:
        words = np.asarray(direction)
        if words.dtype.kind == "U":
            up, down = words == "inflating", words == "deflating"
            if (up | down | (words == "")).all():
                return np.asarray(down.astype(np.float64) - up)
        signs = [DIRECTIONS["" if word is None else str(word)] for word in words.ravel().tolist()]
    except (KeyError, ValueError) as error:  # no such word, or no array
        shown = f"'{error.args[0]}'" if isinstance(error, KeyError) else show_value(direction)
        raise InputError(
            f"direction is {shown}: it must be 'inflating', 'deflating' or empty"
        ) from None
    return np.asarray(signs, dtype=np.float64).reshape(words.shape)
