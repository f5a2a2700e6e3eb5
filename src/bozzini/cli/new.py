"""``bozzini new``: commented files to start from, which run as they are."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING, dataclass
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import click

from ..units import INTERNAL_UNITS
from .common import (
    Answer,
    CheckedCommand,
    CheckedGroup,
    Command,
    answer_options,
    gather,
)

if TYPE_CHECKING:
    from ..checks import Quantity
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
#   bozzini muscle solve {file} --pressure 300kPa --load 1N
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


EFFECTOR_HEAD = """\
# A catheter tip that pneumatic muscles bend. All numbers but those of the muscles are
# plain, in mm, N mm^2, MPa and rad.
#   bozzini effector pose {file} --pressure R=300kPa
kind: bozzini-effector
version: 1
"""

SHAPES = """\
# A lumen of shapes: a tube of cones with round ends, each centre with its radius, in mm. Further
# kinds, with their fields: bozzini duct kinds
#   bozzini show {file}
format: bozzini shapes
version: 1
kind: cones
units: mm
shapes:
- {centre: [0, 0, 0], radius: 9}
- {centre: [0, 0, 60], radius: 8}
- {centre: [20, 0, 100], radius: 7}
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


@dataclass(frozen=True)
class Kind:
    """A kind of description: what it is, who writes its text, and the command that takes it."""

    about: str
    write: Callable[..., str]
    line: str
    options: tuple[Callable[[Command], Command], ...] = ()
    describe: Callable[..., dict[str, object]] = dict


def make_command(name: str, kind: Kind) -> click.Command:
    """Return the command that writes a description to start from."""
    file = Path(f"{name if name in KINDS else 'task'}.yaml")

    @click.command(name, cls=CheckedCommand, help=kind.about)
    @gather("given", dict, *kind.options)
    @answer_options(".yaml", quiet=False, default=file, positional=True)
    def command(given: dict[str, object], answer: Answer) -> None:
        from ..io.files import write_text

        text, path = kind.write(**given), str(answer.target)
        write_text(answer.target, text.replace("{file}", path if path.isprintable() else "FILE"))
        known = kind.describe(**given)
        line = kind.line.format(file=path, **known)
        said = {name: known[name] for name in given}
        answer.give({"file": path, **said, "try": line}, f"written: {path}; try {line}")

    return command


class _Kinds(CheckedGroup):
    """The kinds of the table, then the options of each task, by its key."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the kinds of the table."""
        return [*KINDS]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return what writes such a description, or the options of such a task."""
        if cmd_name in KINDS:
            return make_command(cmd_name, KINDS[cmd_name])
        from ..study.tasks import TASKS

        if cmd_name not in TASKS:
            near = difflib.get_close_matches(cmd_name, [*KINDS, *TASKS], n=1)
            meant = f", did you mean '{near[0]}'?" if near else f": {', '.join(KINDS)}, or a task"
            raise click.UsageError(f"there is no kind '{cmd_name}'{meant}", ctx)
        task = TASKS.choose(cmd_name)
        line = f"bozzini {task.command} --options {{file}}"
        return make_command(cmd_name, Kind(f"Write the options of '{task.command}'.",
                                           partial(format_task, task), line))  # fmt: skip


@click.group("new", cls=_Kinds, subcommand_metavar="KIND [FILE]")
def command() -> None:
    """Write a file to start from, with comments, that runs as it is.

    KIND is one of these, or a task such as head-check, for the file of its options.
    """


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


def format_robot(sections: int, tendons: int) -> str:
    """Return a robot file."""
    from ..continuum.template import write_template

    return write_template(sections=sections, tendons=tendons, file="{file}")


def _describe_robot(sections: int, tendons: int) -> dict[str, object]:
    from ..continuum.template import suggest_option

    option = suggest_option(tendons)
    return {"sections": sections, "tendons": sections * tendons, "option": option}


def format_head() -> str:
    """Return a head file."""
    from ..head.design import Head
    from ..io.records import format_yaml, write_record

    head = Head()
    return HEAD_HEAD + format_yaml({"kind": head.kind, **write_record(head, with_units=True)})


def format_effector() -> str:
    """Return the file of an end-effector: that which was measured."""
    from ..checks import list_quantities
    from ..effector.design import DEFAULT_PRESET, PRESET_MODELS, EffectorDesign, effector_preset
    from ..io.records import format_yaml, write_record

    design, (model, choices) = (
        effector_preset(DEFAULT_PRESET),
        PRESET_MODELS.get(DEFAULT_PRESET, ("energy", {})),
    )
    muscles = [
        {"name": one.name, "angle": one.angle,
         "muscle": write_record(one.muscle, with_units=True)}
        for one in design.muscles
    ]  # fmt: skip
    fields = [
        f"  {name}: {getattr(design, name):g} # {known.describe()}"
        for name, known in list_quantities(EffectorDesign).items()
    ]
    last = format_yaml({"model": model, "choices": dict(choices), "muscles": muscles})
    return "\n".join([EFFECTOR_HEAD.rstrip(), "section:", *fields, last])


KINDS = {
    "plan": Kind(
        "Write the options of a plan, each with its unit and range.",
        format_plan,
        "bozzini plan INPUT --options {file}",
    ),
    "robot": Kind(
        "Write a tendon robot: sections and tendons.",
        format_robot,
        "bozzini continuum pose {file} {option}",
        (
            click.option("--sections", default=2, show_default=True, help="Number of sections."),
            click.option(
                "--tendons",
                default=3,
                show_default=True,
                help="Tendons that end in each, 0 of a rod.",
            ),
        ),
        _describe_robot,
    ),
    "muscle": Kind(
        "Write a muscle: sizes, materials, model and mounting.",
        format_muscle,
        "bozzini muscle solve {file} --pressure 300kPa --load 1N",
    ),
    "effector": Kind(
        "Write a catheter tip: muscles, where they stand, and the backbone.",
        format_effector,
        "bozzini effector pose {file} --pressure R=300kPa",
    ),
    "head": Kind(
        "Write a distal head: camera, cap, and an end-effector with its instrument.",
        format_head,
        "bozzini head check {file}",
    ),
    "shapes": Kind(
        "Write a lumen of shapes: a tube that bends.",
        lambda: SHAPES,
        "bozzini show {file}",
    ),
    "study": Kind(
        "Write a study: what varies, how it is drawn, what is kept.",
        format_study,
        "bozzini study run {file} --out results",
    ),
    "manoeuvre": Kind(
        "Write a manoeuvre of a pushed scope: push, bend, twist, pull.",
        format_manoeuvre,
        "bozzini execute --drive push --manoeuvre {file}",
    ),
}
"""The kinds of descriptions; the schema of each is in `bozzini.cli.schema`."""
