"""What the commands of ``bozzini muscle`` share: the options of a design, models, targets."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import QuantityType

if TYPE_CHECKING:
    from ..muscle.design import Muscle
    from ..muscle.model import MuscleModel

__all__ = [
    "PICTURES",
    "check_target",
    "describe_muscle",
    "design_options",
    "make_class",
    "make_muscle",
    "model_option",
    "model_options",
    "unit_of",
]

FIELDS = {
    "length": ("length", "Free length between the fittings."),
    "outer_radius": ("length", "Outer radius of the tube."),
    "inner_radius": ("length", "Inner radius of the tube."),
    "braid_angle": ("angle", "Angle between strands and axis at rest."),
    "gap": ("length", "Gap between tube and braid."),
    "strands": ("dimensionless", "Number of strands."),
    "strand_radius": ("length", "Radius of a strand."),
    "end_length": ("length", "Length of each conical end (thesis)."),
    "dead_length": ("length", "Length that does not contract (energy)."),
    "modulus": ("pressure", "Young's modulus of the tube."),
    "poisson_ratio": ("dimensionless", "Poisson's ratio of the tube (thesis)."),
    "strand_modulus": ("pressure", "Young's modulus of a strand (thesis)."),
    "mooney_ratio": ("dimensionless", "C01 / (C10 + C01) of the wall (energy)."),
    "friction_length": ("length", "Friction at the crossings (energy)."),
}
"""The fields of a muscle: the kind of quantity, and the help of the option."""
UNITS = {"length": "_mm", "angle": "_rad", "pressure": "_MPa", "dimensionless": ""}
PICTURES = (".png", ".svg", ".pdf")

_Function = Callable[..., Any]


def design_options(function: _Function) -> _Function:
    """Add the options that make a muscle; they arrive as ``design``."""
    for name in reversed(FIELDS):
        kind, text = FIELDS[name]
        option = "--" + name.replace("_", "-")
        function = click.option(option, name, type=QuantityType(kind), help=text)(function)
    return click.option(
        "--preset",
        default="effector-45",
        show_default=True,
        metavar="NAME",
        help="Where the fields begin: thesis-40, thesis-45, thesis-60, effector-45, fitted-45.",
    )(function)


def model_options(function: _Function) -> _Function:
    """Add ``--ends`` and ``--load-path``, the choices that a model has."""
    function = click.option(
        "--load-path",
        default="none",
        show_default=True,
        help="How the thesis's model takes a load: none, bulk.",
    )(function)
    return click.option(
        "--ends",
        default="none",
        show_default=True,
        help="Taper of the energy model: none, trellis.",
    )(function)


model_option = click.option(
    "--model", "model_name", default="energy", show_default=True, help="The model: energy, thesis."
)


def make_muscle(preset_name: str, fields: Mapping[str, float | None]) -> Muscle:
    from ..muscle.presets import preset

    changes: dict[str, Any] = {name: value for name, value in fields.items() if value is not None}
    strands = changes.get("strands")
    if strands is not None and strands == int(strands):
        changes["strands"] = int(strands)
    return preset(preset_name, **changes)


def make_class(name: str, *, ends: str, load_path: str) -> Callable[[Muscle], MuscleModel]:
    from ..errors import InputError
    from ..muscle import MODELS

    if name not in MODELS:
        raise InputError(f"model is '{name}': it must be one of {', '.join(MODELS)}")
    options: dict[str, dict[str, Any]] = {
        "energy": {"ends": ends},
        "thesis": {"load_path": load_path},
    }
    return partial(MODELS[name], **options.get(name, {}))


def check_target(out: Path | None, suffixes: tuple[str, ...], *, force: bool) -> None:
    from ..errors import OutputError

    if out is None:
        return
    if out.suffix.lower() not in suffixes:
        raise OutputError(f"{out} ends in '{out.suffix}': it must end in {', '.join(suffixes)}")
    if not out.parent.is_dir():
        raise OutputError(f"cannot write {out}: {out.parent} is not a directory")
    if out.exists() and not force:
        raise OutputError(f"{out} exists already: choose another file or give --force")


def describe_muscle(muscle: Muscle) -> dict[str, float]:
    return {name + _unit_suffix(name): value for name, value in dataclasses.asdict(muscle).items()}


def _unit_suffix(name: str) -> str:
    return UNITS[FIELDS[name][0]]


def unit_of(name: str) -> str:
    return _unit_suffix(name).removeprefix("_")
