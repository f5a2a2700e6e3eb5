"""Muscles that others have described, by name."""

from __future__ import annotations

from typing import Any

from ..errors import InputError
from .design import Muscle

__all__ = ["PRESETS", "preset"]

PRESETS: dict[str, Muscle] = {
    "thesis-40": Muscle(length=40.0, outer_radius=0.55),
    "thesis-45": Muscle(length=45.0, outer_radius=0.55),
    "thesis-60": Muscle(length=60.0, outer_radius=0.55),
    "effector-45": Muscle(length=45.0, outer_radius=0.75),
    "fitted-45": Muscle(length=45.0, outer_radius=0.75, modulus=0.56, dead_length=11.7),
}
"""Muscles by name.

- ``thesis-40``, ``thesis-45``, ``thesis-60``: the captions of the thesis's Figs 3.11, 3.16 and
  3.12, a tube of 1.1 mm outer diameter.
- ``effector-45``: the muscle of the thesis's chapter 4. Chapter 4 does not give its tube; one of
  1.5 mm outer diameter is what reproduces its contractions (see `ThesisMuscle`).
- ``fitted-45``: the same, with the modulus and dead length for which `EnergyMuscle` meets the
  three contractions without load of chapter 4. Two parameters fitted to three numbers.
"""


def preset(name: str, **overrides: Any) -> Muscle:
    """Return a muscle of `PRESETS`, with some fields changed.

    Raises
    ------
    InputError
        If there is no such preset, or a field or its value is not legal.
    """
    if name not in PRESETS:
        raise InputError(f"there is no muscle preset '{name}': choose one of {sorted(PRESETS)}")
    return PRESETS[name].replace(**overrides)
