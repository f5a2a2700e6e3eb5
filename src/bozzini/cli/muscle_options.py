"""What the commands of ``bozzini muscle`` share: options, constants, measurements."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..checks import check_integer, list_quantities
from ..errors import FileFormatError, InputError
from ..io.inputs import note_input
from ..muscle.design import Muscle
from ..units import parse_quantity
from .common import (
    INPUT,
    NameType,
    QuantityType,
    description,
    gather,
    gather_once,
    make_option,
    option,
    split_setting,
)

if TYPE_CHECKING:
    from ..muscle.data import Measurements
    from ..muscle.ends import EndEffects
    from ..muscle.files import MuscleFile
    from ..muscle.model import MuscleModel
    from ..muscle.models import ModelRegistry, Parameter

CHOICES = {"ends": ("energy", ("none", "trellis")), "load_path": ("thesis", ("none", "bulk"))}
"""Choices that have an option of their own: the model, and the words; the first is the default.

They are those of `MuscleModel.choices`, which is not loaded to write a help text.
"""

FIELDS = list_quantities(Muscle)
"""The fields of a muscle: kind of quantity, unit, and the help of the option."""

_Function = Callable[..., Any]


def design_options(function: _Function) -> _Function:
    """Add what makes a muscle: preset or file, and the fields by their names.

    Where fields begin is by default effector-45; no preset if length and outer radius are given.
    """
    for name, known in reversed(list(FIELDS.items())):
        item = Muscle.__dataclass_fields__[name]
        function = make_option(
            item, type=QuantityType(known.kind), default=None, show_default=False
        )(function)
    about = (
        "A muscle file (.yaml, .json) with its model, or a name of 'bozzini muscle presets' "
        "(default: effector-45; none with both length and outer_radius set)."
    )
    return description("muscle_file", "--muscle", "--preset", about=about, shown="MUSCLE")(function)


def model_options(function: _Function) -> _Function:
    """Add ``--ends`` and ``--load-path``, the choices that a model has; None if not given."""
    ends, path = (CHOICES[name][1] for name in ("ends", "load_path"))
    function = option("--load-path", "How the thesis's model takes a load (default: none).", path)(
        function
    )
    return option("--ends", "Taper of the energy model (default: none).", ends)(function)


model_option = option(
    "--model model_name",
    "The model: energy, thesis, or one that 'bozzini muscle models' lists (default: that of the "
    "muscle file, else energy).",
    NameType("model", lambda: list_kinds()),
)
direction_option = option(
    "--direction",
    "Whether the pressure rises or falls, for friction (default: neither).",
    ("inflating", "deflating"),
)


def is_file(text: str) -> bool:
    """Whether a description is the name of a file, not of a preset."""
    return Path(text).suffix.lower() in (".yaml", ".yml", ".json")


def take_muscle(text: str) -> Muscle:
    """Return a muscle by the name of a preset, or that of a muscle file alone."""
    from ..muscle.design import preset
    from ..muscle.files import read_muscle

    if not is_file(text):
        return preset(text)
    file = read_muscle(text)
    if file.model or file.ends:
        words = "the model, its constants and the ends of the file are left out: give --model"
        click.echo(f"note: {text}: {words}", err=True)
    return file.muscle


def list_kinds() -> ModelRegistry:
    """Return the classes of all models by name."""
    from ..muscle import MODELS

    return MODELS


def make_class(
    name: str,
    *,
    ends: str | None = None,
    load_path: str | None = None,
    constants: Mapping[str, object] | None = None,
) -> Callable[[Muscle], MuscleModel]:
    """Return what makes the model from a muscle; a choice that it does not have is refused."""
    chosen: Mapping[str, object] = select_choices([name], ends=ends, load_path=load_path)[name]
    return partial(list_kinds()[name], **{**(constants or {}), **chosen})


def select_choices(
    names: Sequence[str], *, ends: str | None, load_path: str | None
) -> dict[str, dict[str, str]]:
    """Return the choices given, by model; one that none of the models has is refused."""
    chosen: dict[str, dict[str, str]] = {name: {} for name in names}
    for choice, value in (("ends", ends), ("load_path", load_path)):
        owner, _ = CHOICES[choice]
        if value is None:
            continue
        if owner not in chosen:
            raise InputError(_describe_unused(f"--{choice.replace('_', '-')}", names))
        chosen[owner][choice] = value
    return chosen


def refuse_unused_fields(names: Sequence[str], fields: Mapping[str, float | None]) -> None:
    """Refuse a field of the muscle that was given and makes no difference to any of the models."""
    kinds = list_kinds()
    for field, value in fields.items():
        if value is not None and all(field in kinds[name].unused for name in names):
            raise InputError(_describe_unused(f"--{field.replace('_', '-')}", names))


def check_direction(
    model: MuscleModel,
    direction: str | None,
    fields: Mapping[str, float | None],
    *,
    pressure: float,
) -> None:
    """Refuse a direction without friction, and friction without a direction."""
    given = fields.get("friction_length") is not None
    if direction is None:
        if given:
            raise InputError(
                "--friction-length has no effect without --direction: give inflating or deflating"
            )
    elif model.card is not None:
        if not _has_friction(model, pressure):
            raise InputError(
                f"--direction has no effect in the model {model.name} without friction: leave it "
                "out, or --set the model's friction"
            )
    elif "friction_length" in model.unused:
        raise InputError(_describe_unused("--direction", [model.name]))
    elif model.muscle.friction_length == 0.0 and not given:
        raise InputError("--direction has no effect on a muscle without --friction-length")


def _has_friction(model: MuscleModel, pressure: float) -> bool:
    """Whether the direction makes a difference, at a pressure or at a typical one.

    Many have no friction at 0 MPa; without an answer at the typical pressure, it is taken to.
    """
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


@dataclass(frozen=True)
class Request:
    """A muscle and its model, as the options ask for them; no preset where there is none."""

    preset: str | None
    ends: str | None
    load_path: str | None
    settings: tuple[str, ...]
    fields: Mapping[str, float | None]
    file: MuscleFile | None = None
    is_named: bool = True
    model_name: str = ""
    direction: str | None = None
    side_by_side: int | None = None

    @classmethod
    def take(cls, **values: Any) -> Request:
        """Return the request of some options."""
        fields = {name: values.pop(name) for name in FIELDS}
        path, file = values.pop("muscle_file"), None
        values["preset"] = None
        if path is not None and is_file(path):
            from ..muscle.files import read_muscle

            note_input(path)
            file = read_muscle(path)
        elif path is not None:
            values["preset"] = path
        elif None in (fields["length"], fields["outer_radius"]):
            values |= {"preset": "effector-45", "is_named": False}
        if "model_name" in values and not values["model_name"]:
            own = "" if file is None else file.model
            if own and own not in list_kinds():
                names = ", ".join(list_kinds())
                raise FileFormatError(f"{path}: model is '{own}': choose one of {names}")
            values["model_name"] = own or "energy"
        return cls(fields=fields, file=file, **values)

    @cached_property
    def muscle(self) -> Muscle:
        """The muscle."""
        from ..muscle.design import preset

        changes: dict[str, float] = {
            name: value for name, value in self.fields.items() if value is not None
        }
        strands = changes.get("strands")
        if strands is not None and strands == int(strands):
            changes["strands"] = int(strands)
        if self.file is not None:
            return self.file.muscle.replace(**changes)
        if self.preset is not None:
            return preset(self.preset, **changes)
        size = changes["length"], changes["outer_radius"]
        return Muscle(length=size[0], outer_radius=size[1]).replace(**changes)

    @cached_property
    def constants(self) -> dict[str, object]:
        """What is set of the one model."""
        return parse_settings([self.model_name], self.settings)[self.model_name]

    def list_file_constants(self, name: str) -> Mapping[str, object]:
        """Return the constants that the muscle file has for a model."""
        is_own = self.file is not None and self.file.model == name
        return self.file.constants if self.file is not None and is_own else {}

    def make(self, *, with_file: bool = False) -> Callable[[Muscle], MuscleModel]:
        """Return what makes the one model, options without effect being refused.

        The constants of the muscle file are held only if they are asked for: a fit finds its own.
        """
        refuse_unused_fields([self.model_name], self.fields)
        known = self.list_file_constants(self.model_name) if with_file else {}
        return make_class(
            self.model_name,
            ends=self.ends,
            load_path=self.load_path,
            constants={**known, **self.constants},
        )

    def mount(self, model: MuscleModel, ends: EndEffects) -> MuscleModel:
        """Return a model with effects of the ends; without any, with those that its file has."""
        from ..muscle.ends import EndEffects

        is_own = self.file is not None and self.file.model in ("", model.name)
        if self.file is not None and is_own and self.file.ends and ends == EndEffects():
            ends = self.file.ends
        return ends.mount(model)

    def build(self, *, pressure: float) -> MuscleModel:
        """Return the one model of the muscle, for the direction asked for.

        It is mounted if the muscle file has effects of the ends. What the file has and the model
        does not use is named on stderr. Several side by side are a `Bundle`.
        """
        model = self._build_one(pressure=pressure)
        if self.side_by_side is None:
            return model
        from ..muscle.compose import Bundle

        count = check_integer("side by side", self.side_by_side, low=1, high=100)
        return Bundle((model,) * count)

    def _build_one(self, *, pressure: float) -> MuscleModel:
        from ..muscle.ends import EndEffects

        muscle = self.muscle
        model = self.make(with_file=True)(muscle)
        check_direction(model, self.direction, self.fields, pressure=pressure)
        if self.file is None:
            return model
        neutral = Muscle(length=muscle.length, outer_radius=muscle.outer_radius).given
        spare = [
            name.replace("_", " ")
            for name, value in self.file.muscle.given.items()
            if name in model.unused and value != neutral.get(name)
        ]
        if spare:
            words = ", ".join(spare)
            click.echo(f"note: the model {model.name} does not use: {words}", err=True)
        return self.mount(model, EndEffects())


def _describe_unused(option: str, names: Sequence[str]) -> str:
    return f"{option} has no effect in the model {' or '.join(names)}: leave it out"


def describe_model(model: MuscleModel) -> dict[str, object]:
    """Return the choices of a model, None where it has no such choice, and its constants.

    Of a bundle they are those of one of its muscles, with how many there are.
    """
    from ..muscle.compose import Bundle
    from ..muscle.models.card import make_parameters

    if isinstance(model, Bundle):
        return {**describe_model(model.models[0]), "side_by_side": len(model.models)}
    model = getattr(model, "model", model)  # of a mounted one
    own = {item.name: getattr(model, item.name) for item in make_parameters(type(model))}
    given: Mapping[str, object] = getattr(model, "keywords", own)
    constants = {name: value for name, value in given.items() if not callable(value)}
    return {**{option: getattr(model, option, None) for option in CHOICES}, "constants": constants}


_KINDS = {"mm": "length", "MPa": "pressure", "N": "force", "rad": "angle"}


def set_option(function: _Function) -> _Function:
    """Add ``--set``, which can be repeated."""
    return option(
        "--set settings [MODEL.]NAME=VALUE",
        "A constant of a model, see 'bozzini muscle models NAME'; can be repeated. MODEL is needed "
        "where several have one of that name.",
        multiple=True,
    )(function)


def parse_settings(names: Sequence[str], texts: Sequence[str]) -> dict[str, dict[str, object]]:
    """Return what is set in each model, from ``[MODEL.]NAME=VALUE``."""
    found: dict[str, dict[str, object]] = {name: {} for name in names}
    for text in texts:
        place, mark, value = (part.strip() for part in text.partition("="))
        model, dot, key = (part.strip() for part in place.rpartition("."))
        key = key.replace("-", "_")
        if not (key and mark and value) or bool(dot) != bool(model):
            raise InputError(
                f"--set is '{text}': it must be NAME=VALUE or MODEL.NAME=VALUE, such as kappa1=0.5"
            )
        owner = _find_owner([model] if model in names else names, model, key)
        if key in found[owner]:
            raise InputError(f"--set names {place} more than once: give it once")
        found[owner][key] = _parse_value(owner, key, value)
    return found


def _list_keywords(name: str) -> tuple[str, ...]:
    """Return the constants, choices and laws that a model takes."""
    kind = list_kinds()[name]
    if kind.card is not None:
        return kind.card.keywords
    return tuple(item.name for item in kind.list_parameters())


def _find_owner(names: Sequence[str], model: str, key: str) -> str:
    """Return the name of the one model of some that takes a constant."""
    kinds = list_kinds()
    if model and model not in names:
        known = "not among those taken" if model in kinds else "not known"
        raise InputError(
            f"--set names the model '{model}', which is {known}: it must be {_list_some(names)}"
        )
    owners = [name for name in names if key in _list_keywords(name)]
    if not owners:
        raise InputError(f"--set names '{key}': {_describe_settable(names)}")
    if len(owners) > 1:
        raise InputError(
            f"--set names '{key}', which several models have: name the model, as in "
            f"{owners[0]}.{key}=VALUE; they are {_list_some(owners)}"
        )
    return owners[0]


def _list_some(names: Sequence[str]) -> str:
    more = "" if len(names) <= 8 else f" or one of {len(names) - 8} more"
    return ", ".join(names[:8]) + more


def _describe_settable(names: Sequence[str]) -> str:
    if len(names) > 3:
        return "none of these models takes it"
    parts = []
    for name in names:
        card = list_kinds()[name].card
        laws = {law.name for law in card.laws} if card else set()
        legal = [word for word in _list_keywords(name) if word not in laws]
        parts.append(f"{name} takes {', '.join(legal) or 'no constants'}")
    return f"the model {' and '.join(parts)}"


def _parse_value(model: str, key: str, text: str) -> float | str:
    kind = list_kinds()[model]
    card = kind.card
    if card is None:
        known = list_quantities(kind)[key]
        return known.check(f"{key} of the model {model}", parse_quantity(text, known.kind))
    for item in card.parameters:
        if item.name == key:
            return card.check_parameter(key, parse_constant(item, text))
    for law in card.laws:
        if law.name == key:
            raise InputError(
                f"{key} of the model {model} is a law, a function of "
                f"{', '.join(law.arguments)}: it cannot be set here, give it in Python"
            )
    return card.check_choice(key, text)


def parse_constant(item: Parameter, text: str) -> float:
    """Return the value of a constant: a number in its unit, or a quantity where that is simple."""
    try:
        return float(text)
    except ValueError:
        if item.unit in _KINDS:
            return parse_quantity(text, _KINDS[item.unit])
    raise InputError(f"{item.name} is '{text}': it must be a number, in {item.unit or 'no unit'}")


@dataclass(frozen=True)
class DataRequest:
    """A table of measurements, as the options ask for it."""

    source: Path
    units: tuple[str, ...]
    columns: tuple[str, ...]
    take_mean: bool

    def read(self, asked: Request) -> Measurements:
        """Return the measurements of a muscle, which has to be named if the table has its size."""
        from ..io.sheets import parse_columns
        from ..muscle.data import describe_field
        from ..muscle.table import read_measurements

        form = "COLUMN=UNIT, such as pressure=kPa"
        pairs = (split_setting("--unit", item, form) for item in self.units)
        table = gather_once("--unit", pairs)
        titles = parse_columns(self.columns)
        data = read_measurements(self.source, muscle=asked.muscle, units=table, columns=titles)
        if data.geometry and not asked.is_named:
            columns = ", ".join(map(describe_field, data.geometry))
            raise InputError(
                f"{self.source}: the table has the geometry of its specimens ({columns}): name "
                "their muscle as well, before the table, or by --set length and outer_radius"
            )
        return data.mean_of_directions() if self.take_mean else data


column_option = option(
    "--column columns TITLE=OLD",
    "A title to read in place of one in the file, such as 'load [N]=cell 1'; can be repeated.",
    multiple=True,
)
data_options = gather(
    "table",
    DataRequest,
    click.argument("source", metavar="DATA", type=INPUT),
    option(
        "--unit units COLUMN=UNIT",
        "Unit of a column that states none, e.g. pressure=kPa; can be repeated.",
        multiple=True,
    ),
    column_option,
    option("--mean take_mean", "Take the mean of inflation and deflation.", is_flag=True),
)
request_options = gather("asked", Request.take, set_option, design_options, model_options)
one_model_options = gather(
    "asked", Request.take, model_option, set_option, design_options, model_options
)
bundle_option = option(
    "--side-by-side",
    "So many of the muscle between two plates: their pulls add and share the load (default: one).",
    int,
)
directed_options = gather(
    "asked",
    Request.take,
    model_option,
    direction_option,
    bundle_option,
    set_option,
    design_options,
    model_options,
)


def check_friction(
    fields: Mapping[str, float | None], data: Measurements, *, free: tuple[str, ...]
) -> None:
    """Refuse friction without a direction in the data."""
    given = fields.get("friction_length") is not None and "friction_length" not in free
    if given and not (data.direction != "").any():
        raise InputError("--friction-length has no effect: no row of the data has a direction")


def note_data(data: Measurements) -> str:
    """Return what a user should know of the data, as lines."""
    lines = [f"note: {text}\n" for text in data.notes]
    if data.ignored:
        lines.insert(0, f"ignored columns: {', '.join(data.ignored)}\n")
    return "".join(lines)
