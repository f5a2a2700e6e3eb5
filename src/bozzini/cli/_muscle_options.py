"""What the commands of ``bozzini muscle`` share: the options of a design, models, targets."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from .common import QuantityType

if TYPE_CHECKING:
    from ..muscle.design import Muscle
    from ..muscle.model import MuscleModel, StaticModel

    _NameType = click.ParamType[str]  # generic in newer versions of click only
else:
    _NameType = click.ParamType

__all__ = [
    "FIELDS",
    "OWN_MODELS",
    "ModelType",
    "check_direction",
    "check_fields",
    "describe_choices",
    "describe_muscle",
    "design_options",
    "direction_option",
    "make_class",
    "list_kinds",
    "make_muscle",
    "model_option",
    "model_options",
    "select_choices",
    "unit_of",
]

OWN_MODELS = ("energy", "thesis")
"""The names in `bozzini.muscle.MODELS`, which is not loaded to write a help text."""
CHOICES = {"ends": ("energy", ("none", "trellis")), "load_path": ("thesis", ("none", "bulk"))}
"""What a model can be told: the model, and the words; the first is the default."""

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

_Function = Callable[..., Any]


def design_options(function: _Function) -> _Function:
    """Add the options that make a muscle: ``preset``, and the fields by their names."""
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
    """Add ``--ends`` and ``--load-path``, the choices that a model has; None if not given."""
    function = click.option(
        "--load-path",
        type=click.Choice(CHOICES["load_path"][1]),
        help="How the thesis's model takes a load (default: none).",
    )(function)
    return click.option(
        "--ends",
        type=click.Choice(CHOICES["ends"][1]),
        help="Taper of the energy model (default: none).",
    )(function)


class ModelType(_NameType):
    """The name of a muscle model, of this package or of the catalogue."""

    name = "name"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name if there is such a model."""
        kinds = list_kinds()
        if value not in kinds:
            self.fail(f"there is no model '{value}': choose one of {', '.join(kinds)}", param, ctx)
        return str(value)

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Return the names that begin so."""
        return [CompletionItem(name) for name in list_kinds() if name.startswith(incomplete)]


model_option = click.option(
    "--model",
    "model_name",
    type=ModelType(),
    default="energy",
    show_default=True,
    help="The model: energy, thesis, or one that 'bozzini muscle models' lists.",
)
direction_option = click.option(
    "--direction",
    type=click.Choice(["inflating", "deflating"]),
    help="Which way it came, for friction (default: neither).",
)


def make_muscle(preset_name: str, fields: Mapping[str, float | None]) -> Muscle:
    from ..muscle.presets import preset

    changes: dict[str, Any] = {name: value for name, value in fields.items() if value is not None}
    strands = changes.get("strands")
    if strands is not None and strands == int(strands):
        changes["strands"] = int(strands)
    return preset(preset_name, **changes)


def list_kinds() -> dict[str, Any]:
    """Return the classes of all models by name, those of this package first."""
    from ..muscle import CATALOGUE, MODELS

    return {**MODELS, **CATALOGUE}


def make_class(
    name: str,
    *,
    ends: str | None,
    load_path: str | None,
    constants: Mapping[str, Any] | None = None,
) -> Callable[[Muscle], StaticModel]:
    """Return what makes the model from a muscle; a choice that it does not have is refused."""
    chosen: Mapping[str, Any] = select_choices([name], ends=ends, load_path=load_path)[name]
    return partial(list_kinds()[name], **chosen, **(constants or {}))


def select_choices(
    names: Sequence[str], *, ends: str | None, load_path: str | None
) -> dict[str, dict[str, str]]:
    """Return the choices given, by model; one that none of the models has is refused."""
    from ..errors import InputError

    chosen: dict[str, dict[str, str]] = {name: {} for name in names}
    for option, value in (("ends", ends), ("load_path", load_path)):
        owner, _ = CHOICES[option]
        if value is None:
            continue
        if owner not in chosen:
            raise InputError(_say_unused(f"--{option.replace('_', '-')}", names))
        chosen[owner][option] = value
    return chosen


def check_fields(names: Sequence[str], fields: Mapping[str, float | None]) -> None:
    """Refuse a field of the muscle that was given and makes no difference to any of the models."""
    from ..errors import InputError

    kinds = list_kinds()
    for field, value in fields.items():
        if value is not None and all(field in kinds[name].unused for name in names):
            raise InputError(_say_unused(f"--{field.replace('_', '-')}", names))


def check_direction(
    model: StaticModel,
    direction: str | None,
    fields: Mapping[str, float | None],
    *,
    pressure: float,
) -> None:
    """Refuse a direction without friction, and friction without a direction."""
    from ..errors import InputError
    from ..muscle import CATALOGUE

    if direction is None:
        if fields.get("friction_length") is not None:
            raise InputError(
                "--friction-length has no effect without --direction: give inflating or deflating"
            )
        return
    if model.name in CATALOGUE:
        if not _has_friction(model, pressure):
            raise InputError(
                f"--direction has no effect in the model {model.name} without friction: leave it "
                "out, or --set the model's friction"
            )
        return
    if "friction_length" in model.unused:
        raise InputError(_say_unused("--direction", [model.name]))
    if model.muscle.friction_length == 0.0 and fields.get("friction_length") is None:
        raise InputError("--direction has no effect on a muscle without --friction-length")


def _has_friction(model: StaticModel, pressure: float) -> bool:
    """Whether the way makes a difference, at a pressure or at a typical one: many have none at 0.

    Where the model has no answer at the typical one, it is taken to.
    """
    from ..errors import InputError
    from ..muscle.models.base import TYPICAL_PRESSURE

    def differs(at: float) -> bool:
        up, down = (model.force(at, 0.0, direction=way) for way in ("inflating", "deflating"))
        return bool(up != down)

    if differs(pressure):
        return True
    try:
        return differs(TYPICAL_PRESSURE)
    except InputError:
        return True


def _say_unused(option: str, names: Sequence[str]) -> str:
    models = " or ".join(names)
    return f"{option} has no effect in the model {models}: leave it out"


def describe_choices(model: MuscleModel) -> dict[str, str | None]:
    """Return what the model was told, None where it has no such choice."""
    return {option: getattr(model, option, None) for option in CHOICES}


def describe_muscle(muscle: Muscle) -> dict[str, float]:
    return {name + _unit_suffix(name): value for name, value in dataclasses.asdict(muscle).items()}


def _unit_suffix(name: str) -> str:
    return UNITS[FIELDS[name][0]]


def unit_of(name: str) -> str:
    return _unit_suffix(name).removeprefix("_")
