"""Which unknowns of a model a fit can be for: its own constants, and fields of the muscle."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ._fit import Problem
from ._unknowns import choose_bounds
from .models.base import CatalogueModel

if TYPE_CHECKING:
    from .dataset import Measurements
    from .design import Muscle
    from .model import MuscleModel
    from .models.card import Parameter

__all__ = [
    "Unknowns",
    "choose_unknowns",
    "draw_point",
    "guess_constants",
    "list_own",
    "name_default_fields",
    "split_model",
]

_FIELDS: dict[str, tuple[str, ...]] = {
    "energy": ("modulus", "dead_length"),
    "thesis": ("modulus", "end_length"),
}
_TRIALS = 16  # points at which it is looked at what the data tell
_UNTOLD = 1e-5  # of a column of the Jacobian: what is left once those before it are taken off
_NO_EFFECT = 1e-9  # largest change of contraction by a step of an unknown that counts as none [mm]


@dataclass(frozen=True, kw_only=True)
class Unknowns:
    """What a fit of a model is for.

    Parameters
    ----------
    fields : tuple of str
        Fields of the muscle.
    start : dict
        The model's own constants that are fitted, and where to start.
    held : dict
        Constants and fields that are not fitted although nobody knows them, and why.
    build : callable
        Makes the model from a muscle and the constants in `start`.
    """

    fields: tuple[str, ...]
    start: dict[str, float]
    held: dict[str, str]
    build: Callable[..., MuscleModel]

    @property
    def free(self) -> tuple[str, ...]:
        """All that is fitted, by name."""
        return (*self.fields, *self.start)


def split_model(
    model_class: Callable[..., MuscleModel],
) -> tuple[type[CatalogueModel] | None, dict[str, Any]]:
    """Return the class of the catalogue behind what makes a model, and the keywords it has."""
    given: dict[str, Any] = {}
    make: Any = model_class
    while isinstance(make, functools.partial):
        given = {**make.keywords, **given}
        make = make.func
    if isinstance(make, type) and issubclass(make, CatalogueModel):
        return make, given
    return None, given


def list_own(model_class: Callable[..., MuscleModel]) -> dict[str, Parameter]:
    """Return the constants that a model has beside the muscle and that are not given, by name."""
    kind, given = split_model(model_class)
    if kind is None:
        return {}
    return {item.name: item for item in kind.card.parameters if item.name not in given}


def name_default_fields(model_class: Callable[..., MuscleModel]) -> tuple[str, ...]:
    """Return the fields of a muscle that are fitted if none are named."""
    make: Any = model_class
    while isinstance(make, functools.partial):
        make = make.func
    if getattr(make, "name", "") in _FIELDS:
        return _FIELDS[make.name]
    if isinstance(make, type) and issubclass(make, CatalogueModel):
        return tuple(name for name in ("modulus",) if name not in make.unused)
    return _FIELDS["energy"]


def choose_unknowns(
    model_class: Callable[..., MuscleModel],
    muscle: Muscle,
    data: Measurements,
    *,
    fields: tuple[str, ...] | None = None,
) -> Unknowns:
    """Return what can be fitted of a model to such data.

    Fitted are the constants that the model's source fitted, and those that it must be given and
    that are not. What the data do not tell, having no effect or the same as others, is held where
    the fit would start.

    Parameters
    ----------
    model_class : callable
        A model's class, or a ``functools.partial`` of it with the constants that are known.
    muscle : Muscle
    data : Measurements
    fields : tuple of str, optional
        Fields of the muscle to fit; `name_default_fields` by default.

    Raises
    ------
    MissingLawError
        If the model needs a law that is not given.
    InputError
        If the muscle and the constants do not go together.
    """
    wanted = name_default_fields(model_class) if fields is None else fields
    kind, given = split_model(model_class)
    if kind is None:
        return Unknowns(fields=wanted, start={}, held={}, build=model_class)
    guess = {**guess_constants(kind, muscle), **given}
    held = _find_lame(kind, given)
    own = {
        item.name: item
        for item in sorted(kind.card.parameters, key=lambda item: item.source != "fitted")
        if item.name not in given and item.name not in held and _is_unknown(item, given)
    }
    start = {name: float(guess[name]) for name in own}
    build = _hold(model_class, guess, start)
    build(muscle, **start)  # a law that is missing is told here
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
    untold = _find_untold(problem)
    start = {name: value for name, value in start.items() if name not in untold}
    return Unknowns(
        fields=tuple(name for name in wanted if name not in untold),
        start=start,
        held={**held, **untold},
        build=_hold(model_class, guess, start),
    )


def guess_constants(kind: type[CatalogueModel], muscle: Muscle) -> dict[str, float]:
    """Return where a fit of each constant may begin, those included that not every fit needs.

    Where the model has no guess: the muscle's length for a length, else the middle of the bounds.
    """
    guess = kind.guess_parameters(muscle)
    for item in kind.card.parameters:
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
    guess: Mapping[str, Any],
    free: Mapping[str, float],
) -> Callable[..., MuscleModel]:
    """Return what makes the model with the guess for all that is neither given nor free."""
    own = list_own(model_class)
    return functools.partial(
        model_class, **{name: guess[name] for name in own if name in guess and name not in free}
    )


def _is_unknown(item: Parameter, given: Mapping[str, Any]) -> bool:
    if item.only_with and not given.get(item.only_with) and item.source != "fitted":
        return False
    required = item.default is None and item.source != "unit"
    return item.source == "fitted" or required


def _find_lame(kind: type[CatalogueModel], given: Mapping[str, Any]) -> dict[str, str]:
    """Return the constants that stay at 0, since what they need beside them is not given."""
    lame: dict[str, list[str]] = {}
    for item in kind.card.parameters:
        needed = item.default is None and item.source != "fitted"
        if item.only_with and needed and item.name not in given:
            lame.setdefault(item.only_with, []).append(item.name)
    for law in kind.card.laws:
        if law.only_with and law.required and law.name not in given:
            lame.setdefault(law.only_with, []).append(f"the law {law.name} ({law.paper})")
    unknown = [item.name for item in kind.card.parameters if _is_unknown(item, given)]
    return {
        name: f"held at 0: it needs {' and '.join(needs)}"
        for name, needs in lame.items()
        if name not in given and name in unknown
    }


def _find_untold(problem: Problem) -> dict[str, str]:
    """Return the unknowns that such data do not tell, and why: those lost at every trial point."""
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
            words[name] = "held: these rows cannot tell it from the others"
            continue
        known.append(rest / left)
    return words
