"""A model from an explicit force law: the pull gives all that a muscle model answers."""

from __future__ import annotations

import dataclasses
import inspect
import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import (
    broadcast,
    check_array,
    check_range,
    name_at,
    refuse_first,
    show_beside,
    show_range,
)
from ...errors import BozziniError, ConvergenceError, InputError
from ...numeric import roots as numeric_roots
from ...numeric.arrays import Floats
from ...results import Json
from ..design import LOCKING_ANGLE, PRESSURE_LIMIT, Braid, Muscle, check_muscle
from ..hysteresis import Hysteresis
from ..model import (
    LOAD_LIMIT,
    MuscleModel,
    MuscleState,
    check_hysteresis,
    describe_stop,
    parse_direction,
)
from .card import Card, describe_card, take_keywords

STEPS = 64
"""Lengths tried between the free length and the end of the legal ones."""

ANGLES = (math.radians(0.5), math.radians(89.0))
"""Braid angles at the ends of the legal lengths [rad]: strands nearly straight, nearly hoops."""

TYPICAL_PRESSURE = 0.5
"""Pressure at which a first guess of fitted constants is Gaylord's [MPa]."""

_JUMP_SHARE = 1e-6
"""Share of the forces at a bracket's ends: more is left over only where a force jumps."""


@dataclass(frozen=True, eq=False)
class Roots:
    """Lengths (n,) at which a pull meets a load [mm], what is left over [N], and how it went.

    Where there is no root the length is the last one tried. `jumps` is where pull less load
    changes its sign without passing zero.
    """

    lengths: Floats
    residuals: Floats
    iterations: NDArray[np.int64]
    found: NDArray[np.bool_]
    jumps: NDArray[np.bool_]

    def reshape(self, shape: tuple[int, ...]) -> Roots:
        """Return the roots as arrays of another shape."""
        return Roots(
            self.lengths.reshape(shape),
            self.residuals.reshape(shape),
            self.iterations.reshape(shape),
            self.found.reshape(shape),
            self.jumps.reshape(shape),
        )

    @property
    def stopped(self) -> NDArray[np.bool_]:
        """Whether the iteration ran out of steps."""
        return np.asarray(self.iterations >= numeric_roots.MAX_ITERATIONS)


def find_roots(excess: numeric_roots.Excess, start: Floats, low: Floats, high: Floats) -> Roots:
    """Return the first root on the way down from `start` where `excess` is positive, up otherwise.

    `STEPS` lengths on the way bracket it; two roots between neighbours are missed. All are (n,).
    """
    every = np.arange(start.size)
    first = excess(every, start)
    ends = np.where(first > 0.0, low, high)
    lengths, residuals = start.copy(), first.copy()
    found = first == 0.0
    near, near_excess = start.copy(), first.copy()
    far, far_excess = start.copy(), first.copy()
    open_ones = every[~found]
    for step in range(1, STEPS + 1):
        if not open_ones.size:
            break
        at = start[open_ones] + (ends - start)[open_ones] * (step / STEPS)
        if step == STEPS:
            at = ends[open_ones]
        value = excess(open_ones, at)
        far[open_ones], far_excess[open_ones] = at, value
        crossed = value * np.sign(first[open_ones]) <= 0.0
        found[open_ones[crossed]] = True
        near[open_ones[~crossed]], near_excess[open_ones[~crossed]] = at[~crossed], value[~crossed]
        open_ones = open_ones[~crossed]
    lengths[open_ones], residuals[open_ones] = far[open_ones], far_excess[open_ones]
    flat = every[found & (first != 0.0) & (far_excess == 0.0)]
    far[flat], far_excess[flat] = _find_edge(excess, flat, near[flat], near_excess[flat], far[flat])
    inside = every[found & (first != 0.0)]
    iterations = np.zeros(start.size, dtype=np.int64)
    scale = np.maximum(np.abs(near_excess), np.abs(far_excess))
    lengths[inside], residuals[inside], iterations[inside] = numeric_roots.polish(
        excess, inside, (far[inside], far_excess[inside]), (near[inside], near_excess[inside])
    )
    return Roots(
        lengths, residuals, iterations, found, found & (np.abs(residuals) > _JUMP_SHARE * scale)
    )


def _find_edge(
    excess: numeric_roots.Excess,
    index: NDArray[np.intp],
    near: Floats,
    near_excess: Floats,
    far: Floats,
) -> tuple[Floats, Floats]:
    """Return the first length at which the excess is gone, where it stays at zero, and the excess.

    A pull that cannot fall below a threshold is flat there: the muscle stops where that begins.
    """
    near, far, left = near.copy(), far.copy(), np.zeros(far.shape)
    rest = np.arange(index.size)
    while rest.size:
        middle = 0.5 * (near + far)[rest]
        inside = (middle != near[rest]) & (middle != far[rest])
        rest, middle = rest[inside], middle[inside]
        value = excess(index[rest], middle)
        gone = value * np.sign(near_excess[rest]) <= 0.0
        far[rest[gone]], left[rest[gone]] = middle[gone], value[gone]
        near[rest[~gone]] = middle[~gone]
    return far, left


def find_slope(
    force: Callable[[Floats], Floats], lengths: Floats, low: Floats, high: Floats
) -> Floats:
    """Return the slope at `lengths` of the quartic through five lengths near by [N/mm].

    They are 1/2000 of ``[low, high]`` apart and inside it, so that near an end the middle one is
    not the one asked for.
    """
    step = (high - low) / 2000.0
    middle = np.clip(lengths, low + 2.0 * step, high - 2.0 * step)
    away = (lengths - middle) / step
    two, one, here, more, most = (
        force(np.clip(middle + k * step, low, high)) for k in (-2.0, -1.0, 0.0, 1.0, 2.0)
    )
    first = (two - 8.0 * one + 8.0 * more - most) / 12.0
    second = (-two + 16.0 * one - 30.0 * here + 16.0 * more - most) / 24.0
    third = (-two + 2.0 * one - 2.0 * more + most) / 12.0
    fourth = (two - 4.0 * one + 6.0 * here - 4.0 * more + most) / 24.0
    slope = first + away * (2.0 * second + away * (3.0 * third + away * 4.0 * fourth))
    return np.asarray(slope / step)


class ExplicitModel(MuscleModel):
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
    def load_limits(self) -> tuple[float, float]:
        """Legal loads [N]: a muscle that gets longer under pressure can push, others cannot."""
        return (-LOAD_LIMIT if self._lengthens else 0.0), LOAD_LIMIT

    @property
    def _lengthens(self) -> bool:
        """Whether the braid is above its locking angle at rest."""
        return self.braid.angle > LOCKING_ANGLE

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
        """Return the pull of the muscle [N]."""
        pressures, lengths, signs, _, _ = self._take_lengths(pressure, contraction, direction)
        return self._total(pressures, lengths, signs)

    def try_force(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the pull [N], and where there is one: a state out of range is no error.

        Where there is none, the pull is that of the nearest legal state, 0 if that is not finite.
        """
        pressures, contractions, signs = broadcast(
            ("pressure", check_array("pressure", pressure)),
            ("contraction", check_array("contraction", contraction)),
            ("direction", parse_direction(direction)),
        )
        lengths, rest = self.braid.length - contractions, self.braid.length
        at = np.clip(pressures, *self.pressure_limits)
        slack = 1e-9 * rest
        try:
            with np.errstate(all="ignore"):
                low, high = self._find_lengths(at)
                legal = self._holds(at)
                pull = self._find_total(at, np.clip(lengths, low, high), signs)
        except BozziniError:  # a law that has no answer somewhere
            return super().try_force(pressure, contraction, direction=direction)
        held = (at == pressures) & (lengths >= low - slack) & (lengths <= high + slack) & legal
        finite = np.isfinite(pull)
        return np.where(finite, pull, 0.0), np.asarray(held & finite)

    def stiffness(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return ``-d force / d contraction`` [N/mm] at a pressure, along a branch of friction.

        The slope of a quartic through five lengths, 1/2000 of the legal ones apart: good to about
        1e-8 of the largest slope where the law is smooth, and a mean over a kink.
        """
        pressures, lengths, signs, low, high = self._take_lengths(pressure, contraction, direction)
        return find_slope(lambda at: self._total(pressures, at, signs), lengths, low, high)

    def contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the contraction under a load [mm]; negative where the muscle is longer."""
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
        """Return everything the model gives of the muscle under `pressure` and `load`.

        `MuscleState.residual` is pull less load.
        """
        pressures, loads, signs, roots = self._find_roots(pressure, load, direction)
        if not roots.found.all():
            raise self._refuse_load(int(np.argmin(roots.found)), pressures, loads, signs)
        stopped = roots.stopped
        reason = np.where(stopped, describe_stop(numeric_roots.MAX_ITERATIONS), "")
        contraction = np.asarray(self.braid.length - roots.lengths)
        return MuscleState(
            contraction=contraction,
            length=np.asarray(self.muscle.length - contraction),
            braid_angle=np.arccos(np.minimum(roots.lengths / self.braid.strand_length, 1.0)),
            contact_pressure=self._find_contact(pressures, roots.lengths),
            force=np.asarray(loads + roots.residuals),
            converged=np.asarray(~(stopped | roots.jumps)),
            residual=roots.residuals,
            iterations=roots.iterations,
            reason=np.where(roots.jumps & ~stopped, "the force jumps past the load", reason),
        )

    def try_contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the contraction [mm], and where there is one: a load too large is no error.

        Where there is none, the contraction is that of the last length tried.
        """
        pressures, loads, signs = broadcast(
            ("pressure", check_array("pressure", pressure)),
            ("load", check_array("load", load)),
            ("direction", parse_direction(direction)),
        )
        at, held = np.clip(pressures, *self.pressure_limits), np.clip(loads, *self.load_limits)
        with np.errstate(all="ignore"):
            holds = np.broadcast_to(self._holds(at), at.shape)
        legal = (at == pressures) & (held == loads) & holds
        try:
            roots = self._search_roots(at[holds], held[holds], signs[holds])
        except BozziniError:  # no answer on the way of one of them
            return super().try_contraction(pressure, load, direction=direction)
        found, good = np.zeros(at.shape), np.zeros(at.shape, dtype=np.bool_)
        found[holds] = self.braid.length - roots.lengths
        good[holds] = roots.found & ~roots.jumps & ~roots.stopped
        return found, good & legal

    def _find_roots(
        self, pressure: ArrayLike, load: ArrayLike, direction: ArrayLike | None
    ) -> tuple[Floats, Floats, Floats, Roots]:
        """Pressures, loads and signs of friction, and the lengths, all of one shape."""
        pressures, loads = check_array("pressure", pressure), check_array("load", load)
        check_range("pressure", pressures, *self.pressure_limits, "MPa")
        check_range("load", loads, *self.load_limits, "N")
        pressures, loads, signs = broadcast(
            ("pressure", pressures), ("load", loads), ("direction", parse_direction(direction))
        )
        return pressures, loads, signs, self._search_roots(pressures, loads, signs)

    def _search_roots(self, pressures: Floats, loads: Floats, signs: Floats) -> Roots:
        """Return the lengths at which the pull meets loads, all of one shape and legal."""
        low, high = self._limit(pressures)
        flat = [x.ravel() for x in (pressures, loads, signs, low, high)]

        def excess(index: NDArray[np.intp], lengths: Floats) -> Floats:
            return self._total(flat[0][index], lengths, flat[2][index]) - flat[1][index]

        start = np.clip(np.full(flat[0].shape, self.braid.length), flat[3], flat[4])
        return find_roots(excess, start, flat[3], flat[4]).reshape(pressures.shape)

    def dead_band(self) -> float:
        """Return the pressure below which the muscle does not contract [MPa]; 0 if it has none."""
        return 0.0

    @abstractmethod
    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        """Pull without friction [N]."""

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        """By how much less it pulls on the way up, and more on the way down [N]."""
        return np.zeros(np.shape(pressure))

    def _sign_friction(self, sign: Floats) -> Floats:
        """The sign of friction in the pull, along a branch."""
        return sign

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        """Pressure between tube and braid [MPa]: all of it, where the wall bears nothing."""
        return pressure

    def _length_limits(self, pressure: Floats) -> tuple[Floats | float, Floats | float]:
        """Smallest and largest legal length at each pressure [mm], or raise `InputError`."""
        return self._find_lengths(pressure)

    def _find_lengths(self, pressure: Floats) -> tuple[Floats | float, Floats | float]:
        """Smallest and largest legal length at each pressure [mm], without checks."""
        return self._base_lengths()

    def _holds(self, pressure: Floats) -> NDArray[np.bool_]:
        """Whether the model has legal lengths at each pressure; `_length_limits` raises if not."""
        return np.ones(pressure.shape, dtype=np.bool_)

    def _base_lengths(self) -> tuple[float, float]:
        """Smallest and largest legal length of all pressures [mm]."""
        strand = self.braid.strand_length
        return strand * math.cos(ANGLES[1]), strand * math.cos(ANGLES[0])

    def _total(self, pressure: Floats, length: Floats, sign: Floats) -> Floats:
        """Pull along a branch of friction, finite [N]."""
        with np.errstate(all="ignore"):
            pull = self._find_total(pressure, length, sign)
        self._demand_finite(pull, pressure, length)
        return pull

    def _find_total(self, pressure: Floats, length: Floats, sign: Floats) -> Floats:
        """Pull along a branch of friction, finite or not [N]."""
        pull = np.asarray(self._pull(pressure, length), dtype=np.float64)
        sign = self._sign_friction(sign)
        return pull + sign * self._friction(pressure, length) if sign.any() else pull

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
        pressures = check_array("pressure", pressure)
        given = check_array("contraction", contraction)
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
        refuse_first(
            ~((lengths >= low - slack) & (lengths <= high + slack)),
            "contraction",
            contractions,
            lambda index: (
                f"at a pressure of {pressures.flat[index]:g} MPa it must lie in "
                f"{show_range(contractions, index, rest - high, rest - low)} mm"
            ),
            unit="mm",
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
        least, most = max(self.load_limits[0], float(down.min())), float(up.max())
        legal = f"{show_range(loads, index, least, most)} N"
        if most < least:
            legal = f"what it pulls, and at most that is {most:.6g} N"
        return InputError(
            f"{name_at('load', loads, index)} is {show_beside(loads.flat[index], legal)} N: at a "
            f"pressure of {pressure[0]:g} MPa it must lie in {legal}"
        )


@dataclass(frozen=True, init=False)
class CatalogueModel(ExplicitModel):
    """A model of the survey (thesis chapter 2): an explicit pull at a pressure and a length.

    A subclass brings a `card` and what `ExplicitModel` asks for, its pull. It may bring `guesses`,
    where a fit of a parameter begins, as a number or from the muscle. Its friction is not asked
    for where the parameter ``friction`` is 0; with `prints_one_way` the print takes friction off at
    any direction.

    The survey's symbols are the muscle's: ``l0`` is `Muscle.active_length` (a dead length is in
    no paper, but costs nothing), ``r0`` is `Muscle.braid_radius`, ``t0`` the thickness of the
    tube, which touches the braid: the models know no gap. ``theta`` is measured from the axis.

    Parameters
    ----------
    muscle : Muscle
        The design.
    as_printed : bool
        Whether to take the equation as the thesis prints it, errata and all; no difference where
        the print is right.
    hysteresis : Hysteresis, optional
        Operator for `trace_contraction`.
    **given
        Parameters, choices and laws of the `card`.

    Raises
    ------
    MissingLawError
        If a law is needed that the survey does not hold; the message names the paper.
    InputError
        If a keyword is unknown, a parameter is missing or outside its bounds, or the printed
        equation cannot be evaluated.
    """

    muscle: Muscle
    as_printed: bool
    hysteresis: Hysteresis | None
    _given: tuple[tuple[str, object], ...]
    braid: Braid = field(repr=False, compare=False)

    card: ClassVar[Card]
    guesses: ClassVar[Mapping[str, float | Callable[[Muscle], float]]] = MappingProxyType({})
    prints_one_way: ClassVar[bool] = False

    def __init_subclass__(cls, **rest: object) -> None:
        super().__init_subclass__(**rest)
        card = cls.__dict__.get("card")
        if card is not None:
            cls.name = card.name
            cls.__doc__ = f"{inspect.cleandoc(cls.__doc__ or '')}\n\n{describe_card(card)}"
            fields = (item.name for item in dataclasses.fields(Muscle))
            cls.unused = tuple(name for name in fields if name not in card.uses)

    def __init__(
        self,
        muscle: Muscle,
        *,
        as_printed: bool = False,
        hysteresis: Hysteresis | None = None,
        **given: object,
    ) -> None:
        check_muscle(muscle, self)
        check_hysteresis(hysteresis)
        if as_printed and self.card.unprintable:
            raise InputError(
                f"the model {self.card.name} cannot be evaluated as printed: "
                f"{self.card.unprintable}; leave as_printed out"
            )
        taken = take_keywords(self.card, given, as_printed=as_printed)
        braid = Braid(
            length=muscle.active_length, radius=muscle.braid_radius, angle=muscle.braid_angle
        )
        for name, value in (
            ("muscle", muscle),
            ("as_printed", bool(as_printed)),
            ("hysteresis", hysteresis),
            ("_given", tuple(taken.items())),
            ("braid", braid),
        ):
            object.__setattr__(self, name, value)
        self._check()

    def __repr__(self) -> str:
        words = [repr(self.muscle)]
        words += ["as_printed=True"] if self.as_printed else []
        words += [] if self.hysteresis is None else [f"hysteresis={self.hysteresis!r}"]
        words += [f"{name}={value!r}" for name, value in self._given]
        return f"{type(self).__name__}({', '.join(words)})"

    @classmethod
    def guess_parameters(cls, muscle: Muscle) -> dict[str, float]:
        """Return where a fit of the parameters may begin, for a muscle.

        The default, else the neutral value, else the middle of the bounds; a model may know
        better. What is not needed while another parameter is 0 is left out.
        """
        guess = {}
        for item in cls.card.parameters:
            value = item.default if item.default is not None else item.neutral
            if value is not None or not item.only_with:
                guess[item.name] = sum(item.bounds) / 2.0 if value is None else value
        typical = muscle.fill()
        for item in cls.card.parameters:
            own = cls.guesses.get(item.name)
            if own is not None:
                guess[item.name] = float(own(typical) if callable(own) else own)
        return guess

    @property
    def keywords(self) -> Json:
        """Parameters, choices and laws of this model, as its constructor takes them."""
        return dict(self._given)

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the parameters of the `card`."""
        given = self.keywords
        return {item.name: given[item.name] for item in self.card.parameters if item.name in given}

    def replace(self, muscle: Muscle | None = None, **changes: object) -> CatalogueModel:
        """Return this model with another muscle, or some keywords changed.

        Raises
        ------
        InputError
            As the constructor does.
        """
        kept = {"as_printed": self.as_printed, "hysteresis": self.hysteresis, **self.keywords}
        return type(self)(self.muscle if muscle is None else muscle, **{**kept, **changes})

    def _sign_friction(self, sign: Floats) -> Floats:
        if self.parameters.get("friction", 1.0) == 0.0:
            return np.zeros(())
        if self.as_printed and self.prints_one_way:
            return np.full(sign.shape, -1.0)
        return -sign if self._lengthens else sign  # inflation moves it the other way

    def _check(self) -> None:
        """Raise `InputError` if muscle and keywords do not go together."""

    def _call(self, name: str, *arguments: Floats) -> Floats:
        """Answer of a law given by the user, of the arguments' shape and finite, or InputError.

        The law has arrays of its own, to write to as well.
        """
        law: Callable[..., ArrayLike] = self.keywords[name]
        words = f"answer of {name}"
        try:
            given = law(*(np.array(argument) for argument in arguments))
        except BozziniError:
            raise
        except Exception as error:  # a law is the user's: it may raise anything
            raise InputError(self._describe_failure(name, error)) from error
        answer = check_array(words, given)
        check_range(words, answer, -1e300, 1e300)
        try:
            return np.broadcast_to(answer, arguments[0].shape)
        except ValueError:
            raise InputError(
                f"{words} has shape {answer.shape}: it must be {arguments[0].shape}"
            ) from None

    def _describe_failure(self, name: str, error: Exception) -> str:
        law = next(law for law in self.card.laws if law.name == name)
        cause = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(": ")
        return (
            f"the law {name} of the model {self.name} raised {cause}: it must take arrays "
            f"({', '.join(law.arguments)}) and return one of their shape"
        )
