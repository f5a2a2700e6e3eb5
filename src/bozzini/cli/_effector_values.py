"""Ranges and lists of values that ``bozzini effector study`` reads."""

from __future__ import annotations

from typing import Any

from ..errors import InputError
from ._muscle_options import FIELDS

__all__ = ["KINDS", "MOST", "add_unit", "parse_range", "parse_segments", "parse_values"]

KINDS = {
    "offset": "length",
    "length": "length",
    "flexural_rigidity": "rigidity",
    "catheter_rigidity": "rigidity",
    "pressure_limit": "pressure",
    **{f"muscle.{name}": kind for name, (kind, _) in FIELDS.items() if name != "length"},
}
"""What has a range of numbers, and the kind of quantity."""
UNITS = {"length": "mm", "rigidity": "Nmm2", "pressure": "MPa", "angle": "rad"}
MOST = 10_000
MOST_SEGMENTS = 1000
_WHOLE = "muscle.strands"


def _split(option: str, item: str, form: str) -> tuple[str, str]:
    name, mark, values = (part.strip() for part in item.partition("="))
    name = name.replace("-", "_")
    if not (name and mark and values):
        raise InputError(f"{option} is '{item}': it must be {form}")
    return name, values


def _parse_number(option: str, name: str, text: str) -> float:
    from ..units import parse_quantity

    if name not in KINDS:
        raise InputError(f"{option} names '{name}': choose one of {', '.join(KINDS)}")
    return parse_quantity(text, KINDS[name])


def parse_values(item: str) -> tuple[str, list[Any]]:
    """Return the name and the values of one ``--vary``."""
    import numpy as np

    from ..units import parse_quantity

    name, values = _split("--vary", item, "NAME=LOW:HIGH:COUNT or NAME=VALUE,VALUE")
    if name == "segments":
        return name, parse_segments(values)
    if name == "angles":
        return name, [
            tuple(parse_quantity(angle, "angle") for angle in part.split("/"))
            for part in values.split(",")
        ]
    if name not in KINDS:
        known = ", ".join([*KINDS, "segments", "angles"])
        raise InputError(f"--vary names '{name}': choose one of {known}")
    if ":" not in values:
        return name, [_parse_number("--vary", name, part) for part in values.split(",")]
    parts = values.split(":")
    if len(parts) != 3 or not parts[2].strip().isdigit() or not 2 <= int(parts[2]) <= MOST:
        raise InputError(
            f"--vary is '{item}': it must be NAME=LOW:HIGH:COUNT with a whole COUNT in [2, {MOST}]"
        )
    low, high = (_parse_number("--vary", name, part) for part in parts[:2])
    steps = np.linspace(low, high, int(parts[2])).tolist()
    if name == _WHOLE and not all(step == round(step) for step in steps):
        raise InputError(
            f"--vary is '{item}': this gives {steps[1]:g} {name.removeprefix('muscle.')}, where "
            "only whole numbers are legal"
        )
    return name, steps


def parse_range(item: str) -> tuple[str, float, float]:
    """Return the name and the two ends of one ``--between``."""
    name, values = _split("--between", item, "NAME=LOW:HIGH")
    parts = values.split(":")
    if len(parts) != 2:
        raise InputError(f"--between is '{item}': it must be NAME=LOW:HIGH")
    low, high = (_parse_number("--between", name, part) for part in parts)
    return name, low, high


def parse_segments(text: str) -> list[int]:
    parts = [part.strip() for part in text.split(",")]
    if not all(
        part.isascii() and part.isdigit() and len(part) < 9 and 1 <= int(part) <= MOST_SEGMENTS
        for part in parts
    ):
        raise InputError(
            f"segments is '{text}': it must be whole numbers in [1, {MOST_SEGMENTS}], as 12,15"
        )
    return [int(part) for part in parts]


def add_unit(name: str) -> str:
    unit = UNITS.get(KINDS.get(name, ""), "")
    return f"{name}_{unit}" if unit else name
