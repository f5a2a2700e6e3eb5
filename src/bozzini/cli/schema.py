"""``bozzini schema``: what a file may hold, as a JSON Schema."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import click

from ..results import Json
from ..units import INTERNAL_UNITS
from .common import (
    Answer,
    CheckedCommand,
    NameType,
    answer_options,
)

if TYPE_CHECKING:
    from ..checks import Quantity


def _describe_plan() -> Json:
    from ..motion.plan import make_plan_schema

    return make_plan_schema()


def _describe_options() -> Json:
    from ._tract_options import list_plan_options

    known = {name: known for name, (known, _) in list_plan_options().items()}
    return make_options_schema("Bozzini options of a plan", known)


def make_options_schema(title: str, options: Mapping[str, Quantity]) -> Json:
    """Return the schema of a file of options."""
    from ..io.schema import DRAFT, describe_quantity

    properties: dict[str, Json] = {}
    for name, known in options.items():
        schema: Json = {"type": ["string", "number", "array"]}
        if known.words:
            schema = {"enum": list(known.words)}
        elif known.kind == "flag":
            schema = {"type": "boolean"}
        elif known.kind in INTERNAL_UNITS:
            schema = describe_quantity(known)
        properties[name] = {**schema, "description": known.describe()}
    return {
        "$schema": DRAFT,
        "title": title,
        "type": "object",
        "properties": properties,
        "additionalProperties": False,
    }


def _describe_task(name: str) -> Json:
    from ..study.tasks import TASKS

    kind = TASKS.choose(name)
    known = {name: item.metadata["quantity"] for name, item in kind.list_options().items()}
    return make_options_schema(f"Bozzini options of {kind.command}", known)


def _describe_robot() -> Json:
    from ..continuum import ContinuumRobot
    from ..io.schema import make_schema

    schema = make_schema(ContinuumRobot, "Bozzini robot")
    schema["properties"]["sections"]["minItems"] = 1
    return schema


def _describe_muscle() -> Json:
    from ..io.schema import make_schema
    from ..muscle.files import MuscleFile

    return make_schema(MuscleFile, "Bozzini muscle")


def _describe_shapes() -> Json:
    from ..duct.shape_files import make_shapes_schema

    return make_shapes_schema()


def _describe_study() -> Json:
    from ..io.schema import make_schema
    from ..study.factors import FORMAT, StudySpec

    schema = make_schema(StudySpec, "Bozzini study")
    schema["properties"]["format"] = {"const": FORMAT}
    schema["properties"]["factors"]["minProperties"] = 1
    return schema


def _describe_head() -> Json:
    from ..head.design import Head
    from ..io.schema import make_schema

    return make_schema(Head, "Bozzini head")


def _describe_effector() -> Json:
    from ..effector.files import EffectorFile
    from ..io.schema import make_schema

    return make_schema(EffectorFile, "Bozzini end-effector")


def _describe_manoeuvre() -> Json:
    from ..io.schema import make_schema
    from ..physics.manoeuvre import Manoeuvre

    schema = make_schema(Manoeuvre, "Bozzini manoeuvre")
    schema["properties"]["steps"]["minItems"] = 1
    return schema


SCHEMAS: dict[str, Callable[[], Json]] = {
    "plan": _describe_plan,
    "options": _describe_options,
    "robot": _describe_robot,
    "muscle": _describe_muscle,
    "effector": _describe_effector,
    "head": _describe_head,
    "shapes": _describe_shapes,
    "study": _describe_study,
    "manoeuvre": _describe_manoeuvre,
}
"""What makes the schema of each file."""


def _list_makers() -> dict[str, Callable[[], Json]]:
    from ..study.tasks import TASKS

    return {**{name: partial(_describe_task, name) for name in TASKS}, **SCHEMAS}


@click.command("schema", cls=CheckedCommand)
@click.argument("file", metavar="|".join(SCHEMAS), type=NameType("file", _list_makers))
@answer_options(".json", help="A file for the schema, .json.", quiet=False)
def command(file: str, answer: Answer) -> None:
    """Write the JSON Schema of a file, with which an editor checks it as one types.

    A plan is an archive: its schema is that of the text 'meta' in it. "options" is the file of
    'bozzini plan --options'; the name of a task, as 'bozzini new' takes it, stands for the
    file of its options.
    """
    from ..io.files import write_text

    schema = _list_makers()[file]()
    text = json.dumps(schema, indent=2)
    if answer.out is None:
        answer.give(schema, text)
        return
    write_text(answer.out, f"{text}\n")
    answer.give({"file": str(answer.out)}, f"{answer.out}: written")
