"""What the commands of ``bozzini effector`` share: options of a design, named values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError
from ._muscle_options import (
    FIELDS,
    Answer,
    describe_muscle,
    make_class,
    model_option,
    model_options,
)
from .common import QuantityType

if TYPE_CHECKING:
    from ..effector import Effector, EffectorDesign

__all__ = [
    "KINDS",
    "MOST",
    "add_unit",
    "describe_design",
    "effector_options",
    "make_design",
    "make_effector",
    "parse_pairs",
    "parse_range",
    "parse_segments",
    "parse_values",
    "report",
]

# What the commands of ``bozzini effector`` share: options of a design, named values, tables.


LENGTHS = {
    "offset": "Distance of the muscles from the axis (prototype: 4 mm).",
    "backbone_length": "Length of the backbone and of the muscles (prototype: 45 mm).",
    "holder_length": "Length of the straight holder beyond the backbone (prototype: 10 mm).",
}

_Function = Callable[..., Any]
Given = Mapping[str, Any]
"""The options of a design, by their names."""


_OPTIONS = {
    "preset": click.option(
        "--preset",
        default="prototype",
        show_default=True,
        metavar="NAME",
        help="Where the design begins: prototype.",
    ),
    "muscle_preset": click.option(
        "--muscle-preset",
        metavar="NAME",
        help="The muscles, by a name of bozzini muscle (prototype: fitted-45).",
    ),
    "angles": click.option(
        "--angles",
        metavar="NAME=ANGLE,...",
        help="The muscles, such as A=0deg,B=120deg,C=240deg "
        "(prototype: R=307.5deg,G=219deg,B=75deg).",
    ),
    **{
        name: click.option(
            "--" + name.replace("_", "-"), name, type=QuantityType("length"), help=text
        )
        for name, text in LENGTHS.items()
    },
    "segments": click.option(
        "--segments",
        type=int,
        help="Turns of the outer spring: part of the design, no mesh (prototype: 15).",
    ),
    "rigidity": click.option(
        "--rigidity",
        type=QuantityType("rigidity"),
        help="Flexural rigidity without a catheter (prototype: 200 N mm^2).",
    ),
    "rigidity_test": click.option(
        "--rigidity-test", metavar="FORCE,DEFLECTION", help="The same, from a load across the tip."
    ),
    "catheter": click.option(
        "--catheter",
        type=QuantityType("rigidity"),
        help="Flexural rigidity of the catheter; adds (prototype: 0).",
    ),
    "pressure_limit": click.option(
        "--pressure-limit",
        type=QuantityType("pressure"),
        help="Largest pressure of a muscle (prototype: 0.827 MPa).",
    ),
    "beam": click.option(
        "--beam",
        type=click.Choice(["2", "3"]),
        help="Beam formula M L^2 / (BEAM E I): 3 as printed, 2 as derived (prototype: 3).",
    ),
}
_MODEL = ("model_name", "ends", "load_path")


def effector_options(function: _Function) -> _Function:
    """Add the options of a design and of the muscle model; they arrive as one mapping, `given`."""

    @wraps(function)
    def run(**values: Any) -> Any:
        given = {name: values.pop(name) for name in (*_OPTIONS, *_MODEL)}
        return function(given=given, **values)

    model_option(model_options(run))
    for option in reversed(_OPTIONS.values()):
        option(run)
    return run


def make_design(given: Given) -> EffectorDesign:
    """Return the design that the options ask for."""
    from ..effector import PlacedMuscle, effector_preset, rigidity_from_test
    from ..muscle.design import preset as muscle_preset
    from ..units import parse_quantity

    design = effector_preset(given["preset"])
    placed = list(design.muscles)
    if given["angles"] is not None:
        angles = parse_pairs("--angles", given["angles"], "angle", example="A=0deg,B=120deg")
        muscle = placed[0].muscle
        placed = [PlacedMuscle(name=name, muscle=muscle, angle=angles[name]) for name in angles]
    if given["muscle_preset"] is not None:
        muscle = muscle_preset(given["muscle_preset"])
        placed = [replace(item, muscle=muscle) for item in placed]
    length = given["backbone_length"]
    length = placed[0].muscle.length if length is None else length
    placed = [replace(item, muscle=item.muscle.replace(length=length)) for item in placed]
    names = ("offset", "holder_length", "segments", "pressure_limit")
    changes = {name: given[name] for name in names if given[name] is not None}
    changes["backbone_length"] = length
    for option, name in (("rigidity", "flexural_rigidity"), ("catheter", "catheter_rigidity")):
        if given[option] is not None:
            changes[name] = given[option]
    if given["beam"] is not None:
        changes["beam_factor"] = float(given["beam"])
    if given["rigidity_test"] is not None:
        parts = given["rigidity_test"].split(",")
        if given["rigidity"] is not None:
            raise InputError("--rigidity and --rigidity-test both give the stiffness: give one")
        if len(parts) != 2:
            raise InputError(
                f"--rigidity-test is '{given['rigidity_test']}': it must be FORCE,DEFLECTION, "
                "such as 0.1N,15mm"
            )
        changes["flexural_rigidity"] = rigidity_from_test(
            parse_quantity(parts[0], "force"), parse_quantity(parts[1], "length"), length=length
        )
    return design.replace(muscles=tuple(placed), **changes)


def make_effector(given: Given) -> Effector:
    """Return the effector that the options ask for, with its muscle model."""
    from ..effector import Effector

    model = make_class(given["model_name"], ends=given["ends"], load_path=given["load_path"])
    return Effector(make_design(given), model)


def parse_pairs(
    option: str, text: str, kind: str, *, names: Sequence[str] | None = None, example: str
) -> dict[str, float]:
    """Return ``NAME=QUANTITY,NAME=QUANTITY`` as a mapping.

    Raises
    ------
    InputError
        If a part has no ``=``, a name comes twice, or is not among `names`.
    """
    from ..units import parse_quantity

    found: dict[str, float] = {}
    for part in text.split(","):
        name, mark, value = (word.strip() for word in part.partition("="))
        if not (name and mark and value):
            raise InputError(
                f"{option} has the part '{part.strip()}': it must be NAME={kind.upper()}, such as "
                f"{example}"
            )
        if names is not None and name not in names:
            raise InputError(
                f"{option} names '{name}': the muscles of this design are {', '.join(names)}"
            )
        if name in found:
            raise InputError(f"{option} names '{name}' more than once: give each muscle once")
        found[name] = parse_quantity(value, kind)
    return found


def describe_design(design: EffectorDesign) -> dict[str, Any]:
    """Return a design as plain values, with units in the names."""
    from ..effector import find_conflicts

    return {
        "muscles": {
            placed.name: {"angle_rad": placed.angle, **describe_muscle(placed.muscle)}
            for placed in design.muscles
        },
        "offset_mm": design.offset,
        "backbone_length_mm": design.backbone_length,
        "segments": design.segments,
        "flexural_rigidity_Nmm2": design.flexural_rigidity,
        "catheter_rigidity_Nmm2": design.catheter_rigidity,
        "holder_length_mm": design.holder_length,
        "pressure_limit_MPa": design.pressure_limit,
        "beam_factor": design.beam_factor,
        "compliance_mm_per_N": design.compliance,
        "conflicts": find_conflicts(design),
    }


def report(
    result: Mapping[str, Any], *, answer: Answer, text: str, notes: Sequence[str] = ()
) -> None:
    """Write a result on stdout, and what is to be known of it and of its design on stderr.

    With ``--json`` it is all in the object: ``notes``, and the design's ``conflicts``.
    """
    answer.give({**result, "notes": list(notes)}, text)
    if not answer.as_json:
        for line in (*notes, *result["design"]["conflicts"]):
            click.echo(f"note: {line}", err=True)


# Ranges and lists of values that ``bozzini effector study`` reads.


KINDS = {
    "offset": "length",
    "length": "length",
    "flexural_rigidity": "rigidity",
    "catheter_rigidity": "rigidity",
    "pressure_limit": "pressure",
    **{f"muscle.{name}": item.kind for name, item in FIELDS.items() if name != "length"},
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
