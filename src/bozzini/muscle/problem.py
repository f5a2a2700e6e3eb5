"""A fit as a least-squares problem: predictions of a model, unknowns, derivatives."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number, list_quantities
from ..errors import BozziniError, InputError, PluginError
from .data import Measurements
from .design import BRAID_ANGLES, Muscle
from .model import MuscleModel
from .models.base import CatalogueModel, ExplicitModel

if TYPE_CHECKING:
    from .models.card import Parameter


def answer_rows(
    answer: Callable[[Measurements], NDArray[np.float64]], data: Measurements
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return what a model answers at the rows, and which rows it has an answer for.

    Where it refuses a batch, the halves are asked, down to single rows.
    """
    try:
        values = answer(data)
        return values, np.ones(len(data), dtype=np.bool_)
    except PluginError:
        raise
    except BozziniError:
        if len(data) == 1:
            return np.zeros((1, 1)), np.zeros(1, dtype=np.bool_)
    half = len(data) // 2
    rows = np.arange(len(data))
    parts = [answer_rows(answer, data.select(part)) for part in (rows[:half], rows[half:])]
    width = max(values.shape[1] for values, _ in parts)
    table = [np.broadcast_to(values, (len(values), width)) for values, _ in parts]
    return np.concatenate(table), np.concatenate([held for _, held in parts])


def predict_contraction(model: MuscleModel, data: Measurements) -> NDArray[np.float64]:
    """Return the model's contraction at each row [mm]; an error names the row."""
    try:
        return model.contraction(data.pressure, data.load, direction=data.branch)
    except BozziniError as error:
        for row in range(len(data)):
            word = str(data.direction[row]) or None
            try:
                model.contraction(float(data.pressure[row]), float(data.load[row]), direction=word)
            except BozziniError as at_row:
                raise type(at_row)(f"{data.name_row(row)}: {at_row}") from None
        raise error


def try_contraction(
    model: MuscleModel, data: Measurements
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the contraction at each row [mm], and which rows the model has one for."""
    if isinstance(model, ExplicitModel):
        with contextlib.suppress(BozziniError):
            return model.try_contraction(data.pressure, data.load, direction=data.branch)

    def answer(rows: Measurements) -> NDArray[np.float64]:
        return model.contraction(rows.pressure, rows.load, direction=rows.branch)[:, None]

    predicted, held = answer_rows(answer, data)
    return predicted[:, 0], held


PARAMETER_UNITS = {
    name: quantity.unit
    for name, quantity in list_quantities(Muscle).items()
    if name not in ("length", "strands")
}
"""The parameters of a `Muscle` that may be fitted, and their units.

The free length is not one of them: a table of lengths becomes contractions by it, so it has to be
measured.
"""


def choose_scale(name: str, start: float, *, own: bool) -> float:
    """Return how much of an unknown matters."""
    scale = 0.1 * abs(start) or 0.1
    known = None if own else list_quantities(Muscle)[name].scale
    return scale if known is None else known


def choose_bounds(
    free: Sequence[str],
    muscle: Muscle,
    bounds: Mapping[str, tuple[float, float]],
    own: Mapping[str, Parameter] | None = None,
) -> NDArray[np.float64]:
    """Return the bounds of the free parameters, shape (k, 2): those given, or wide ones."""
    radius = muscle.outer_radius
    wide = {
        "modulus": (0.01, 20.0),
        "dead_length": (0.0, 0.8 * muscle.length),
        "gap": (0.0, 0.5 * radius),
        "braid_angle": (math.radians(15.0), BRAID_ANGLES[1]),
        "friction_length": (0.0, 0.25 * radius),
        "mooney_ratio": (0.0, 1.0),
        "inner_radius": (0.05 * radius, 0.95 * radius),
        "outer_radius": (1.05 * muscle.given.get("inner_radius", 0.0), 3.0 * radius),
        "end_length": (0.0, 0.4 * muscle.length),
        "poisson_ratio": (0.3, 0.4999),
    }
    if not isinstance(bounds, Mapping):
        raise InputError(
            f"bounds must be a mapping from names to pairs: it is a {type(bounds).__name__}"
        )
    for name in bounds:
        if name not in free:
            raise InputError(f"bounds are given for {name}: the free ones are {', '.join(free)}")
    table = []
    for name in free:
        constant = (own or {}).get(name)
        least, most = muscle.legal_range(name) if constant is None else constant.bounds
        unit = PARAMETER_UNITS[name] if constant is None else constant.unit
        if name in bounds:
            low, high = _take_pair(name, bounds[name], least, most, unit)
        elif constant is not None:
            low, high = constant.bounds
        else:
            value = float(getattr(muscle, name))
            # Inside the legal range, with a margin for the steps of numeric differences.
            low, high = wide.get(name, (0.2 * value, 5.0 * value))
            low, high = max(low, least), min(high, most - 1e-4 * (most - least))
        table.append((low, high))
    return np.array(table, dtype=np.float64)


def _take_pair(
    name: str, pair: object, least: float, most: float, unit: str
) -> tuple[float, float]:
    if not isinstance(pair, Sequence) or isinstance(pair, str) or len(pair) != 2:
        raise InputError(f"bounds of {name} is {pair!r:.60}: it must be a pair (low, high)")
    low = check_number(f"lower bound of {name}", pair[0], low=least, high=most, unit=unit)
    high = check_number(
        f"upper bound of {name}", pair[1], low=low, high=most, low_open=True, unit=unit
    )
    return low, high


_NO_ANSWER_MM = 1e5  # what the search sees at a row that a trial has no answer for [mm]
_STEEPEST = 1e9  # of a derivative, so that its square is finite [mm]
_LEAST_STIFFNESS_N_PER_MM = 1e-12  # keeps a quotient finite where a model has no stiffness [N/mm]
_STEP = 1e-4  # of a difference, in scales: small against curvature, large against round-off


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A least-squares problem whose unknowns are those of a muscle and a model, each in its scale.

    Free are fields of the muscle and constants of the model; these are where they start. Limits
    are (k, 2), and `model_class` makes the model from a muscle and constants by their names.
    """

    model_class: Callable[..., MuscleModel]
    muscle: Muscle
    free: tuple[str, ...]
    data: Measurements
    limits: NDArray[np.float64]
    constants: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def start(self) -> dict[str, float]:
        """Where the free parameters start."""
        known = {**vars(self.muscle), **self.constants}
        return {name: float(known[name]) for name in self.free}

    @cached_property
    def scales(self) -> NDArray[np.float64]:
        """How much of each parameter matters, shape (k,)."""
        return np.array(
            [
                choose_scale(name, value, own=name in self.constants)
                for name, value in self.start.items()
            ]
        )

    def choose_start(self) -> NDArray[np.float64]:
        """Return where to start, off the bounds: a search hardly leaves one."""
        start = np.array(list(self.start.values()))
        low, high = self.limits.T
        margin = np.minimum(0.5 * self.scales, 0.25 * (high - low))
        inside: NDArray[np.float64] = np.clip(start, low + margin, high - margin)
        return inside / self.scales

    def name_values(self, point: NDArray[np.float64]) -> dict[str, float]:
        """Return the parameters at a point of the search."""
        values = np.clip(point * self.scales, self.limits[:, 0], self.limits[:, 1])
        return dict(zip(self.free, values.tolist(), strict=True))

    def build(self, values: Mapping[str, float]) -> MuscleModel:
        """Return the model with some parameters."""
        own = {name: value for name, value in values.items() if name in self.constants}
        fields = {name: value for name, value in values.items() if name not in own}
        return self.model_class(self.muscle.replace(**fields), **own)

    def evaluate(self, point: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return model less measurement [mm], and which rows the trial has an answer for."""
        try:
            model = self.build(self.name_values(point))
        except BozziniError:  # each value is legal, but not all together
            return np.zeros(len(self.data)), np.zeros(len(self.data), dtype=np.bool_)
        predicted, held = try_contraction(model, self.data)
        return np.where(held, predicted - self.data.contraction, 0.0), held

    def miss(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the search makes small: `evaluate`, huge in rows without an answer.

        With constants of the model, which may start far off, it is `steps` there, moved away from
        0, so that the search finds back.
        """
        miss, held = self.evaluate(point)
        if held.all() or not self.constants:
            return np.where(held, miss, _NO_ANSWER_MM)
        steps = self.steps(point)
        return np.where(held, miss, steps + np.copysign(self.muscle.length, steps))

    def slope(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivatives of `miss`, shape (n, k).

        In rows without an answer 0, or with constants of the model those of `steps`.
        """
        residuals, held = self.evaluate(point)
        table = np.zeros((len(self.data), len(self.free)))
        if held.any():
            rows = self.data.select(held)
            table[held] = self.scales * differentiate(
                self.build,
                self.name_values(point),
                bounds=self.limits,
                scales=self.scales,
                data=rows,
                predicted=residuals[held] + rows.contraction,
            )
        if self.constants and not held.all():
            here = self.steps(point)
            for column, step in enumerate(self._choose_steps(point)):
                there = point.copy()
                there[column] += step
                table[~held, column] = ((self.steps(there) - here) / step)[~held]
        return np.clip(np.nan_to_num(table), -_STEEPEST, _STEEPEST)

    def steps(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a step of Newton's method from each measured state, shape (n,) [mm].

        It is ``(force - load) / stiffness``, to first order the model's contraction less the
        measured one, bent to stay below half the muscle's length; that length in rows without an
        answer.
        """
        most = 0.5 * self.muscle.length
        try:
            model = self.build(self.name_values(point))
        except BozziniError:
            return np.full(len(self.data), most)

        def answer(rows: Measurements) -> NDArray[np.float64]:
            force = model.force(rows.pressure, rows.contraction, direction=rows.branch)
            stiffness = model.stiffness(rows.pressure, rows.contraction, direction=rows.branch)
            return np.stack([force - rows.load, stiffness], axis=1)

        table, held = answer_rows(answer, self.data)
        with np.errstate(all="ignore"):
            steps = table[:, 0] / (np.abs(table[:, -1]) + _LEAST_STIFFNESS_N_PER_MM)
            bent = steps / np.hypot(1.0, steps / most)
        return np.where(held & np.isfinite(bent), bent, most)

    def _choose_steps(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return small steps that stay inside the bounds, in scales."""
        return np.where(point + _STEP * 10.0 <= self.limits[:, 1] / self.scales, 1.0, -1.0) * (
            _STEP * 10.0
        )


def differentiate(
    build: Callable[[Mapping[str, float]], MuscleModel],
    values: Mapping[str, float],
    *,
    bounds: NDArray[np.float64],
    scales: NDArray[np.float64],
    data: Measurements,
    predicted: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the derivatives of contraction by the parameters, shape (n, k).

    By the theorem of implicit functions, dx/dp = (dF/dp) / stiffness: the one is a difference of
    the force, which has a closed form in `EnergyMuscle`, the other the model's own. For a model
    without force, or where a difference leaves its domain, they are differences of the contraction.
    """
    pairs = []
    for (name, value), (low, high), scale in zip(values.items(), bounds, scales, strict=True):
        step = _STEP * max(scale, abs(value))  # the start may have been next to 0
        pairs.append((name, max(low, value - step), min(high, value + step)))
    try:
        return _differentiate_implicitly(build, values, pairs, data, predicted)
    except (BozziniError, ZeroDivisionError, FloatingPointError):
        return _differentiate_directly(build, values, pairs, data)


def _differentiate_implicitly(
    build: Callable[[Mapping[str, float]], MuscleModel],
    values: Mapping[str, float],
    pairs: Sequence[tuple[str, float, float]],
    data: Measurements,
    predicted: NDArray[np.float64],
) -> NDArray[np.float64]:
    at, branch = (data.pressure, predicted), data.branch
    stiffness = build(values).stiffness(*at, direction=branch)
    columns = []
    for name, low, high in pairs:
        less, more = (build({**values, name: x}).force(*at, direction=branch) for x in (low, high))
        columns.append((more - less) / (high - low))
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        table: NDArray[np.float64] = np.stack(columns, axis=-1) / stiffness[:, None]
    return table


def _differentiate_directly(
    build: Callable[[Mapping[str, float]], MuscleModel],
    values: Mapping[str, float],
    pairs: Sequence[tuple[str, float, float]],
    data: Measurements,
) -> NDArray[np.float64]:
    at, branch = (data.pressure, data.load), data.branch
    columns = []
    for name, low, high in pairs:
        less, more = (
            build({**values, name: x}).contraction(*at, direction=branch) for x in (low, high)
        )
        columns.append((more - less) / (high - low))
    return np.stack(columns, axis=-1)


_TRIALS = 16  # points at which the data are examined
_UNTOLD = 1e-5  # of a column of the Jacobian: what is left once those before it are taken off
_NO_EFFECT = 1e-9  # largest change of contraction by a step of an unknown that counts as none [mm]


@dataclass(frozen=True, kw_only=True)
class Unknowns:
    """Fields of the muscle and constants of a model that are fitted, with where these start.

    `held` are unknowns that are not fitted, and why. `build` makes the model from a
    muscle and the constants in `start`.
    """

    fields: tuple[str, ...]
    start: dict[str, float]
    held: dict[str, str]
    build: Callable[..., MuscleModel]

    @property
    def free(self) -> tuple[str, ...]:
        """All that is fitted, by name."""
        return (*self.fields, *self.start)


def unwrap(make: Callable[..., MuscleModel]) -> tuple[object, dict[str, object]]:
    """Return the class behind what makes a model, and the keywords it is given."""
    given: dict[str, object] = {}
    while isinstance(make, functools.partial):
        given = {**make.keywords, **given}
        make = make.func
    return make, given


def split_model(
    model_class: Callable[..., MuscleModel],
) -> tuple[type[CatalogueModel] | None, dict[str, object]]:
    """Return the class of the catalogue behind what makes a model, and the keywords it has."""
    make, given = unwrap(model_class)
    found = isinstance(make, type) and issubclass(make, CatalogueModel)
    return (make if found else None), given  # type: ignore[return-value]


def list_parameters(model_class: Callable[..., MuscleModel]) -> tuple[Parameter, ...]:
    """Return the constants that a model has beside the muscle."""
    kind, _ = unwrap(model_class)
    is_model = isinstance(kind, type) and issubclass(kind, MuscleModel)
    return kind.list_parameters() if is_model else ()  # type: ignore[attr-defined]


def list_own(model_class: Callable[..., MuscleModel]) -> dict[str, Parameter]:
    """Return the constants of a model that are not given, by name."""
    _, given = unwrap(model_class)
    return {item.name: item for item in list_parameters(model_class) if item.name not in given}


def list_unused(model_class: Callable[..., MuscleModel]) -> tuple[str, ...]:
    """Return the fields of a muscle that make no difference to a model."""
    return tuple(getattr(unwrap(model_class)[0], "unused", ()))


def name_default_fields(model_class: Callable[..., MuscleModel]) -> tuple[str, ...]:
    """Return the fields of a muscle that are fitted if none are named."""
    fields = getattr(unwrap(model_class)[0], "fit_fields", ("modulus", "dead_length"))
    return tuple(name for name in fields if name not in list_unused(model_class))


def choose_unknowns(
    model_class: Callable[..., MuscleModel],
    muscle: Muscle,
    data: Measurements,
    *,
    fields: tuple[str, ...] | None = None,
) -> Unknowns:
    """Return what can be fitted of a model to such data.

    Fitted are the constants that the model's source fitted, and those that it must be given and
    that are not. What the data do not determine, having no effect or the same as others, is held
    where the fit would start.
    """
    wanted = name_default_fields(model_class) if fields is None else fields
    kind, given = split_model(model_class)
    known = list_own(model_class)
    wanted = tuple(name for name in wanted if name not in {*known, *given})
    if kind is None and not any(item.source == "fitted" for item in known.values()):
        return Unknowns(fields=wanted, start={}, held={}, build=model_class)
    muscle = muscle.fill(wanted)
    begin = guess_constants(model_class, muscle)
    guess = {**begin, **given}
    held = {} if kind is None else _find_unsupported(kind, given)
    own = {
        item.name: item
        for item in sorted(known.values(), key=lambda item: item.source != "fitted")
        if item.name not in held and _is_unknown(item, given)
    }
    start = {name: begin[name] for name in own}
    build = _hold(model_class, guess, start)
    build(muscle, **start)  # raises if a law is missing
    names = (*wanted, *own)
    if not names:
        return Unknowns(fields=(), start={}, held=held, build=build)
    problem = Problem(
        model_class=build,
        muscle=muscle,
        free=names,
        data=data,
        limits=choose_bounds(names, muscle, {}, own),
        constants=start,
    )
    undetermined = _find_undetermined(problem)
    start = {name: value for name, value in start.items() if name not in undetermined}
    return Unknowns(
        fields=tuple(name for name in wanted if name not in undetermined),
        start=start,
        held={**held, **undetermined},
        build=_hold(model_class, guess, start),
    )


def guess_constants(model_class: Callable[..., MuscleModel], muscle: Muscle) -> dict[str, float]:
    """Return where a fit of each constant may begin, those included that not every fit needs.

    A model outside the catalogue begins at its defaults. Without a guess or a default it is the
    muscle's length for a length, else the middle of the bounds.
    """
    kind, _ = split_model(model_class)
    items = list_parameters(model_class)
    defaults = {item.name: item.default for item in items if item.default is not None}
    guess = defaults if kind is None else kind.guess_parameters(muscle)
    for item in items:
        low, high = item.bounds
        middle = muscle.active_length if item.unit == "mm" else 0.5 * (low + high)
        if item.source == "fitted":
            guess.setdefault(item.name, min(max(middle, low), high))
    return guess


def draw_point(problem: Problem, random: np.random.Generator) -> NDArray[np.float64]:
    """Return a point of the search somewhere about the start.

    A constant moves by a factor between 1/4 and 4, one that starts at 0 to something between
    1/100 and 3, of either sign if that is legal.
    """
    values = []
    for (name, value), (low, _) in zip(problem.start.items(), problem.limits, strict=True):
        factor = 4.0 ** random.uniform(-1.0, 1.0)
        if name not in problem.constants:
            factor = 1.25 ** random.uniform(-1.0, 1.0)
        elif value == 0.0:
            value = 1.0 if low >= 0.0 else float(random.choice([-1.0, 1.0]))
            factor = 10.0 ** random.uniform(-2.0, 0.5)
        values.append(value * factor)
    return np.asarray(np.clip(np.array(values), *problem.limits.T) / problem.scales)


def _hold(
    model_class: Callable[..., MuscleModel],
    guess: Mapping[str, object],
    free: Mapping[str, float],
) -> Callable[..., MuscleModel]:
    """Return what makes the model with the guess for all that is neither given nor free."""
    own = list_own(model_class)
    return functools.partial(
        model_class, **{name: guess[name] for name in own if name in guess and name not in free}
    )


def _is_unknown(item: Parameter, given: Mapping[str, object]) -> bool:
    if item.only_with and not given.get(item.only_with) and item.source != "fitted":
        return False
    required = item.default is None and item.source != "unit"
    return item.source == "fitted" or required


def _find_unsupported(kind: type[CatalogueModel], given: Mapping[str, object]) -> dict[str, str]:
    """Return the constants that stay at 0, since what they need beside them is not given."""
    lacking: dict[str, list[str]] = {}
    for item in kind.card.parameters:
        needed = item.default is None and item.source != "fitted"
        if item.only_with and needed and item.name not in given:
            lacking.setdefault(item.only_with, []).append(item.name)
    for law in kind.card.laws:
        if law.only_with and law.required and law.name not in given:
            lacking.setdefault(law.only_with, []).append(f"the law {law.name} ({law.paper})")
    unknown = [item.name for item in kind.card.parameters if _is_unknown(item, given)]
    return {
        name: f"held at 0: it needs {' and '.join(needs)}"
        for name, needs in lacking.items()
        if name not in given and name in unknown
    }


def _find_undetermined(problem: Problem) -> dict[str, str]:
    """Return the unknowns that such data leave undetermined, and why."""
    random = np.random.default_rng(0)
    lost: list[dict[str, str]] = []
    for _ in range(_TRIALS):
        point = draw_point(problem, random)
        table = problem.slope(point)[problem.evaluate(point)[1]]
        if np.isfinite(table).all() and table.any():
            lost.append(_find_dependent(problem.free, table))
    if not lost:
        return {}
    return {name: text for name, text in lost[0].items() if all(name in one for one in lost)}


def _find_dependent(names: tuple[str, ...], table: NDArray[np.float64]) -> dict[str, str]:
    """Return the columns that are no more than those before them, and in what words."""
    words = {}
    known: list[NDArray[np.float64]] = []
    for name, column in zip(names, table.T, strict=True):
        length = float(np.linalg.norm(column))
        if length <= _NO_EFFECT:
            words[name] = "held: it has no effect at these rows"
            continue
        rest = column / length
        for other in known:
            rest = rest - (rest @ other) * other
        left = float(np.linalg.norm(rest))
        if left <= _UNTOLD:
            words[name] = "held: these rows do not distinguish it"
            continue
        known.append(rest / left)
    return words
