"""End-effectors that others have described, by name."""

from __future__ import annotations

import math
from typing import Any

from ..errors import InputError
from ..muscle import preset as muscle_preset
from .design import EffectorDesign, PlacedMuscle

__all__ = ["PRESETS", "preset"]

PRESETS: dict[str, EffectorDesign] = {
    "prototype": EffectorDesign(
        muscles=tuple(
            PlacedMuscle(name=name, muscle=muscle_preset("fitted-45"), angle=math.radians(degrees))
            for name, degrees in (("R", 307.5), ("G", 219.0), ("B", 75.0))
        )
    ),
}
"""End-effectors by name.

- ``prototype``: the thesis's, with muscles R, G and B at 307.5, 219 and 75 degrees (Fig. 4.9). Its
  offset of 4 mm and its ``EI`` of 200 N mm^2 are those that Tables 4.1-4.4 were computed with. The
  drawn holder has no room for a muscle so far out (`find_conflicts`).
"""


def preset(name: str, **overrides: Any) -> EffectorDesign:
    """Return an end-effector of `PRESETS`, with some fields changed.

    Raises
    ------
    InputError
        If there is no such preset, or a field or its value is not legal.
    """
    if name not in PRESETS:
        raise InputError(f"there is no effector preset '{name}': choose one of {sorted(PRESETS)}")
    return PRESETS[name].replace(**overrides)
