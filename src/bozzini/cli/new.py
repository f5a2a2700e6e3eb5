"""``bozzini new``: commented files to start from, which run as they are."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import click

from ..units import INTERNAL_UNITS
from .common import (
    Answer,
    CheckedGroup,
    Command,
    NameType,
    answer_options,
)

if TYPE_CHECKING:
    from ..checks import Quantity
    from ..registry import Registry
    from ..task import Task

PLAN_SET = ("diameter", "link", "inflate", "method", "head_step")
"""The options that the template sets; the others are at rest."""

OPTIONS_HEAD = """\
# Options of 'bozzini {command}', named as there. Quantities carry their units; without one they are
# in mm, N, MPa, rad. A line that begins with '#' and a name is an option at rest.
#   bozzini {line} --options {{file}}

"""

MUSCLE_HEAD = """\
# A pneumatic muscle. Quantities carry their units; without one they are in mm, N, MPa and rad.
# Limits that depend on other sizes are those for the sizes here. A line that begins with '#' and a
# name is a field at rest.
#   bozzini muscle solve --muscle {file} --pressure 300kPa --load 1N
kind: bozzini-muscle
version: 1
muscle:
"""

MUSCLE_REST = """\
model: energy # one that 'bozzini muscle models' lists; without it, --model names it
#constants: {{}} # of the model, by name
#ends: {{offset: 0 mm, compliance: 0 mm/N}} # what the rig adds
#   offset: {offset}
#   compliance: {compliance}
#   slack_force: {slack_force}; none if left out
"""

STUDY = """\
# A study: many rows of one job. Quantities carry their units; without one they are in mm, N, MPa,
# rad and s. 'bozzini study jobs' lists the jobs. A line that begins with '#' and a name is a field
# at rest.
#   bozzini study run {file} --out results
format: bozzini-study-1
job: effector-design # a job, or module:function of your own
fixed: # inputs that do not vary
  preset: measured # {preset}
  deflection: 12 mm # what the tip is to reach to the side; {deflection}
  #pressure_limit: 0.827 MPa # {pressure_limit}
factors: # inputs that vary: a range, integers, normal, values or files each
  offset: {{range: [2.5 mm, 4.5 mm]}} # {offset}
  flexural_rigidity: {{range: [50 N mm^2, 400 N mm^2], scale: log}} # {flexural_rigidity}
  segments: {{integers: [10, 20]}} # {segments}; both ends included
  #muscle.braid_angle: {{values: [34 deg, 36 deg]}} # {muscle[braid_angle]}
  # mean and standard deviation; clip cuts the distribution
  muscle.modulus: {{normal: [0.15 MPa, 0.02 MPa], clip: [0.1 MPa, 0.2 MPa]}} # {muscle[modulus]}
# In place of sampling, a search for the best (evaluations: rows, 10 to 10,000,000):
#   search: {{minimise: [needed_pressure], method: differential-evolution, evaluations: 500}}
sampling:
  method: sobol # sobol, random, or grid: every combination, without a count
  count: 256 # rows, {count}; of a Sobol sequence a power of two
  #seed: 7 # of the random numbers, {seed}
#outputs: [needed_pressure, inner_radius, area] # columns to keep, all if left out
constraints: # what a row must keep to be feasible: at_least, at_most, or both
  inner_radius: {{at_least: 8 mm}} # mm
#chunk: 1000 # rows of one part, {chunk}; about a second's work if left out
"""


HEAD_HEAD = """\
# A distal head; one to three end-effectors, each with a preset, changes in its design, and an
# instrument: separate, integrated or none. Each field, with its range: bozzini schema head
"""

MANOEUVRE = """\
# A manoeuvre of a pushed scope, whose tip stands at the entry before the first step. Quantities
# carry their units; without one they are in mm, mm/s and rad. A line that begins with '#' and a
# name is a field at rest.
#   bozzini execute --drive push --manoeuvre {file}
kind: bozzini-manoeuvre
version: 1
steps: # each is one of push, pull, twist and bend
  - push: 60 mm # {push}
    #speed: 20 mm/s # {speed}
  - bend: 15 deg # {bend}
    #direction: 90 deg # {direction}
  - twist: 90 deg # {twist}
  - pull: 20 mm # {pull}
"""


@click.group("new", cls=CheckedGroup)
def command() -> None:
    """Write a file to start from, with comments, that runs as it is."""


def _file_options(name: str) -> Callable[[Command], Command]:
    """Return the options of an answer whose file is called so unless another name is given."""
    return answer_options(
        ".yaml", quiet=False, default=Path(name), show_default=True, help="The file."
    )


def _write(answer: Answer, text: str, line: str, **more: object) -> None:
    """Write a template, and tell the command line to try it with."""
    from ..io.files import write_text

    file = str(answer.target)
    write_text(answer.target, text.replace("{file}", file if file.isprintable() else "FILE"))
    first = line.format(file=file)
    answer.give({"file": file, **more, "try": first}, f"written: {file}; try {first}")


@command.command("plan")
@_file_options("plan.yaml")
def plan_command(answer: Answer) -> None:
    """Write the options of a plan, each with its unit and range."""
    _write(answer, format_plan(), "bozzini plan INPUT --options {file}")


def _find_tasks() -> Registry[Task]:
    from ..study.tasks import TASKS

    return TASKS


@command.command("task")
@click.argument("name", type=NameType("task", _find_tasks))
@_file_options("task.yaml")
def task_command(name: str, answer: Answer) -> None:
    """Write the options of a task, each with its unit and range."""
    kind = _find_tasks().choose(name)
    _write(answer, format_task(kind), f"bozzini {kind.command} --options {{file}}")


@command.command("muscle")
@_file_options("muscle.yaml")
def muscle_command(answer: Answer) -> None:
    """Write a muscle: sizes, materials, model and mounting."""
    line = "bozzini muscle solve --muscle {file} --pressure 300kPa --load 1N"
    _write(answer, format_muscle(), line)


@command.command("robot")
@click.option("--sections", default=2, show_default=True, help="Number of sections.")
@click.option(
    "--tendons", default=3, show_default=True, help="Tendons that end in each, 0 of a rod."
)
@_file_options("robot.yaml")
def robot_command(sections: int, tendons: int, answer: Answer) -> None:
    """Write a tendon robot: sections and tendons."""
    from ..continuum.template import suggest_option, write_template

    text = write_template(sections=sections, tendons=tendons, file="{file}")
    line = f"bozzini continuum pose {{file}} {suggest_option(tendons)}"
    _write(answer, text, line, sections=sections, tendons=sections * tendons)


@command.command("head")
@_file_options("head.yaml")
def head_command(answer: Answer) -> None:
    """Write a distal head: camera, cap, and an end-effector with its instrument."""
    from ..head.design import Head
    from ..io.records import format_yaml, write_record

    head = Head()
    text = format_yaml({"kind": head.kind, **write_record(head, with_units=True)})
    _write(answer, HEAD_HEAD + text, "bozzini head check --head {file}")


@command.command("study")
@_file_options("study.yaml")
def study_command(answer: Answer) -> None:
    """Write a study: what varies, how it is drawn, what is kept."""
    _write(answer, format_study(), "bozzini study run {file} --out results")


@command.command("manoeuvre")
@_file_options("manoeuvre.yaml")
def manoeuvre_command(answer: Answer) -> None:
    """Write a manoeuvre of a pushed scope: push, bend, twist, pull."""
    line = "bozzini execute --drive push --manoeuvre {file}"
    _write(answer, format_manoeuvre(), line)


def format_plan() -> str:
    """Return a file of options of ``bozzini plan``."""
    from ._tract_options import list_plan_options

    head = OPTIONS_HEAD.format(command="plan", line="plan INPUT")
    return head + format_options(list_plan_options(), PLAN_SET)


def format_task(kind: type[Task]) -> str:
    """Return a file of options of a task: those that it needs are set, as far as is shown."""
    head = OPTIONS_HEAD.format(command=kind.command, line=kind.command)
    options = kind.list_options().items()
    known = {name: (item.metadata["quantity"], item.default) for name, item in options}
    return head + format_options(known, [n for n, (_, d) in known.items() if d is MISSING])


def format_options(options: Mapping[str, tuple[Quantity, object]], are_set: Collection[str]) -> str:
    """Return options with what is known of them, their defaults or examples; some are set."""
    lines = []
    for name, (known, default) in options.items():
        shown = known.example
        if not shown and known.kind in INTERNAL_UNITS and isinstance(default, (int, float)):
            shown = f"{default:g} {known.unit}".rstrip()
        elif not shown:
            shown = "needed" if default is MISSING else str(default).lower()
        rest = "" if name in are_set and shown != "needed" else "#"
        about = fill(known.describe(), 98, initial_indent="# ", subsequent_indent="# ")
        lines.append(f"{about}\n{rest}{name}: {shown}\n")
    return "\n".join(lines)


def format_muscle() -> str:
    """Return a muscle file: a muscle of the thesis's end-effector."""
    from ..checks import list_quantities
    from ..io.records import write_record
    from ..muscle.design import Muscle, preset
    from ..muscle.ends import EndEffects

    muscle, known = preset("effector-45"), list_quantities(Muscle)
    fields = write_record(muscle, with_units=True)
    lines = [
        f"  {name}: {value} # {known[name].describe(muscle)}" for name, value in fields.items()
    ]
    ends = {name: item.describe() for name, item in list_quantities(EndEffects).items()}
    return MUSCLE_HEAD + "\n".join(lines) + "\n" + MUSCLE_REST.format(**ends)


def format_study() -> str:
    """Return a study file: a sweep of designs of an end-effector."""
    from ..checks import list_quantities
    from ..muscle.design import Muscle
    from ..study.factors import Sampling, StudySpec
    from ..study.tasks import choose_job

    inputs = choose_job("effector-design").list_inputs(())
    known = {**list_quantities(StudySpec), **list_quantities(Sampling), **inputs}
    words = {name: item.describe() for name, item in known.items()}
    muscle = {name: item.describe() for name, item in list_quantities(Muscle).items()}
    return STUDY.format(file="{file}", muscle=muscle, **words)


def format_manoeuvre() -> str:
    """Return a manoeuvre file: in, hook the tip, turn it, and pull back."""
    from ..checks import list_quantities
    from ..physics.manoeuvre import Step

    known = {name: item.describe() for name, item in list_quantities(Step).items()}
    return MANOEUVRE.format(file="{file}", **known)
