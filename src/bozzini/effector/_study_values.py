"""Values of the parameters of a design study: names and ranges, told before anything is tried."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..checks import check_integer, check_number
from ..errors import InputError
from .design import LIMITS, MOST_SEGMENTS, EffectorDesign, PlacedMuscle

__all__ = ["check_parameter", "check_value", "is_of_muscle", "list_values"]

MOST_STRANDS = 10_000

# The other fields' ranges depend on fields that may be varied too.
_OWN_RANGE = (
    "length", "outer_radius", "braid_angle", "modulus", "poisson_ratio", "strand_modulus",
    "mooney_ratio",
)  # fmt: skip


def is_of_muscle(name: str) -> bool:
    """Return whether a parameter is a field of the muscles."""
    return name.startswith("muscle.")


def check_parameter(design: EffectorDesign, name: str) -> None:
    """Raise `InputError` if a parameter is not one."""
    own = design.muscles[0].muscle.__dataclass_fields__
    known = [*EffectorDesign.__dataclass_fields__, "length", "angles"]
    known += [f"muscle.{field}" for field in own]
    if name not in known:
        near = difflib.get_close_matches(str(name), known, n=1)
        hint = f"did you mean '{near[0]}'" if near else "give one such as 'offset'"
        raise InputError(
            f"there is no parameter '{name!s:.40}': {hint}; legal are a field of EffectorDesign, "
            "'length', 'angles', or 'muscle.' and a field of Muscle"
        )


def check_value(design: EffectorDesign, name: str, value: Any) -> Any:
    """Return a parameter's value as it is to be used, or raise `InputError` if it never is legal.

    Whether a design with it can be built may depend on the others, and is not looked at.
    """
    if is_of_muscle(name):
        return _check_of_muscle(design, name, value)
    words = name.replace("_", " ")
    if name == "muscles":
        if not isinstance(value, (tuple, list)) or not all(
            isinstance(one, PlacedMuscle) for one in value
        ):
            raise InputError(f"muscles is {value!r:.60}: it must be 1 to 12 PlacedMuscle")
        return tuple(value)
    if name == "angles":
        return check_angles(design, value)
    if name == "segments":
        return check_integer(words, value, low=1, high=MOST_SEGMENTS)
    if name == "beam_factor":
        return design.replace(beam_factor=value).beam_factor
    low, high, unit = LIMITS["backbone_length" if name == "length" else name]
    return check_number(words, value, low=low, high=high, unit=unit)


def check_angles(design: EffectorDesign, value: Any) -> tuple[float, ...]:
    """Return the angles of all muscles [rad], or raise `InputError`."""
    names = design.names
    if isinstance(value, str) or not isinstance(value, (Sequence, np.ndarray)):
        raise InputError(f"angles is {value!r:.60}: give {len(names)} numbers in rad")
    angles = tuple(np.ravel(value)) if isinstance(value, np.ndarray) else tuple(value)
    if len(angles) != len(names):
        raise InputError(
            f"angles has {len(angles)} value(s): give {len(names)}, one for each of the muscles "
            f"{', '.join(names)}"
        )
    placed = tuple(
        PlacedMuscle(name=one.name, muscle=one.muscle, angle=angle)
        for one, angle in zip(design.muscles, angles, strict=True)
    )
    return tuple(float(angle) for angle in design.replace(muscles=placed).angles)


def list_values(design: EffectorDesign, name: str, values: Any) -> tuple[Any, ...]:
    """Return the values of a parameter to try, each one checked."""
    check_parameter(design, name)
    if isinstance(values, str) or not isinstance(values, (Sequence, np.ndarray)):
        raise InputError(f"values of {name} is {values!r:.60}: give a sequence of values")
    listed = tuple(values) if isinstance(values, Sequence) else tuple(np.atleast_1d(values))
    if not listed:
        raise InputError(f"values of {name} is empty, there is nothing to vary: give 1 or more")
    return tuple(check_value(design, name, value) for value in listed)


def _check_of_muscle(design: EffectorDesign, name: str, value: Any) -> Any:
    field, words = name.removeprefix("muscle."), name.replace("_", " ")
    if field == "strands":
        return check_integer(words, value, low=2, high=MOST_STRANDS)
    low, high = 0.0, 1e6
    if field in _OWN_RANGE:
        low, high = design.muscles[0].muscle.legal_range(field)
    return check_number(words, value, low=low, high=high)
