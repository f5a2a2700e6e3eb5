"""Where a calibration begins: what is free, and where the constants of a model start."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import InputError
from ._constants import choose_unknowns, guess_constants, name_default_fields, split_model
from ._unknowns import PARAMETER_UNITS
from .dataset import Measurements

if TYPE_CHECKING:
    from .design import Muscle
    from .model import MuscleModel
    from .models.card import Parameter

__all__ = ["choose_constants", "choose_free"]


def choose_free(
    free: Sequence[str] | None,
    model_class: Callable[..., MuscleModel],
    muscle: Muscle,
    data: Measurements,
    own: Mapping[str, Parameter],
) -> tuple[Callable[..., MuscleModel], tuple[str, ...], dict[str, str]]:
    """Return what makes the model, what is free, and what is held and why."""
    build, held = model_class, {}
    kind, given = split_model(model_class)
    constants = () if kind is None else kind.card.parameters
    known = {item.name for item in constants if item.name in given}
    if free is None:
        if kind is None:
            free = name_default_fields(model_class)
        else:
            unknowns = choose_unknowns(model_class, muscle, data)
            build, free, held = unknowns.build, unknowns.free, unknowns.held
    names = tuple(dict.fromkeys(free))
    if not names:
        raise InputError("no parameter is free: name one or more")
    for name in names:
        if name not in PARAMETER_UNITS and name not in own:
            why = "given, so it cannot be free" if name in known else "not known"
            legal = ", ".join((*PARAMETER_UNITS, *own))
            raise InputError(f"parameter '{name}' is {why}: use {legal}")
    if len(data) <= len(names):
        raise InputError(
            f"{len(data)} row(s) are too few for {len(names)} parameter(s): "
            f"there must be {len(names) + 1} or more"
        )
    return build, names, held


def choose_constants(
    model_class: Callable[..., MuscleModel],
    muscle: Muscle,
    names: tuple[str, ...],
    limits: NDArray[np.float64],
    own: Mapping[str, Parameter],
    start: Mapping[str, float] | None,
) -> dict[str, float]:
    """Return where the free constants of the model start."""
    kind, _ = split_model(model_class)
    for name in start or {}:
        if name not in own or name not in names:
            legal = ", ".join(name for name in names if name in own) or "none"
            raise InputError(f"a start is given for {name}: the free constants are {legal}")
    if kind is None:
        return {}
    guess = {**guess_constants(kind, muscle), **(start or {})}
    constants = {}
    for name, (low, high) in zip(names, limits, strict=True):
        if name in own:
            middle = 0.5 * (low + high)
            value = check_number(f"start of {name}", guess.get(name, middle), unit=own[name].unit)
            constants[name] = float(np.clip(value, low, high))
    return constants
