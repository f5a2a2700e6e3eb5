"""``bozzini execute``: drive a motion with contact, and say what forces act."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..errors import InputError
from ..physics.manoeuvre import LIMITS, Manoeuvre
from ..physics.options import ExecuteOptions, ScopeOptions, WallOptions
from ..results import format_rows
from ..study.options import InsertionOptions, ReadOptions
from ._tract_options import (
    MovingBody,
    list_given,
    read_with_options,
    report_findings,
    tract_options,
)
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    Answer,
    CheckedCommand,
    answer_options,
    options_of,
    run_exit,
)
from .plan import reserve_target

if TYPE_CHECKING:
    from ..physics.manoeuvre import StepReport
    from ..physics.study import ExecutionStudy, Scenery

__all__ = ["command"]


@click.command(name="execute", cls=CheckedCommand)
@click.argument("source", metavar="[PLAN|TRACT]", required=False, type=INPUT)
@click.argument("tract", metavar="[INPUT]", required=False, type=INPUT)
@tract_options
@options_of(MovingBody, "body")
@options_of(ExecuteOptions, "options")
@options_of(WallOptions, "wall")
@options_of(ScopeOptions, "scope")
@click.option(
    "--manoeuvre", type=INPUT, metavar="FILE",
    help="With --drive push: steps of push, pull, twist and bend, as 'bozzini new manoeuvre' "
    "writes them.",
)  # fmt: skip
@click.option("--compare", is_flag=True, help="Also drive the pushed scope, side by side.")
@click.option(
    "--check",
    is_flag=True,
    help="Also drive with half the step, friction 0 and 0.3: the change.",
)
@click.option(
    "--seeds", type=click.IntRange(1, 10_000), help="Drive in so many phantoms, from --seed on."
)
@click.option(
    "--repeats", type=click.IntRange(1, 1000), default=1, show_default=True,
    help="Starts in each phantom; after the first, pose, speed, friction and gains are drawn.",
)  # fmt: skip
@answer_options(
    default="bozzini-execution",
    show_default=True,
    metavar="DIRECTORY",
    help="Directory for tables, figures, the scene and the summary.",
)
def command(
    source: Path | None,
    tract: Path | None,
    reading: ReadOptions,
    body: MovingBody,
    options: ExecuteOptions,
    wall: WallOptions,
    scope: ScopeOptions,
    manoeuvre: Path | None,
    compare: bool,
    check: bool,
    seeds: int | None,
    repeats: int,
    answer: Answer,
) -> None:
    """Drive a motion with contact, and state forces, errors and loops.

    PLAN is a plan's .npz and INPUT the file that it was made from; a TRACT is planned in first.
    Without both it is the phantom of --seed. With --drive tendons the robot is that of --robot, or
    of the robot.npz beside PLAN. Exit code 0: it comes through; 1: it does not, it loops, a link
    leaves the lumen, or the planner refused it; 2: bad input. With a manoeuvre 0: all steps are
    made, no link outside.
    """
    if manoeuvre is not None and (options.drive != "push" or seeds is not None):
        raise InputError("--manoeuvre is of a pushed scope: give --drive push, without --seeds")
    if manoeuvre is None and scope.torsion != ScopeOptions().torsion:
        raise InputError("--torsion is of a shaft that is twisted: give --manoeuvre, too")
    steps = None if manoeuvre is None else Manoeuvre.load(manoeuvre)
    if seeds is not None:
        if source is not None or compare or check or options.drive == "tendons":
            raise InputError("--seeds takes no file, --compare, --check or --drive tendons")
        _refuse_without_file(reading, body)
        _run_trials(range(options.seed, options.seed + seeds), repeats, options, (wall, scope),
                    body, answer)  # fmt: skip
        return
    if repeats > 1:
        raise InputError(f"--repeats is {repeats}: without --seeds it must be 1")
    reserve_target(answer)
    scenery = _find_scenery(source, tract, reading, body, options, answer)
    if scenery is None:
        run_exit(EXIT_NEGATIVE)
    from ..physics.study import study_execution

    with answer.show_progress() as progress:
        study = study_execution(
            replace(scenery, wall=wall, scope=scope, manoeuvre=steps), options, compare=compare,
            check=check, progress=progress,
        )  # fmt: skip
    from ..io.files import new_directory

    with new_directory(answer.target, force=answer.force) as folder:
        summary = study.write(folder)
    for text in study.executions[0].findings:
        click.echo(f"bozzini: warning: {text}", err=True)
    answer.give(summary, _describe(study, answer.target))
    if not study.converged:
        run_exit(EXIT_NEGATIVE)


def _find_scenery(
    source: Path | None,
    tract: Path | None,
    reading: ReadOptions,
    body: MovingBody,
    options: ExecuteOptions,
    answer: Answer,
) -> Scenery | None:
    """Return the plan in its tract; None, after a word on why, if the planner refused it."""
    from ..motion.plan import Plan
    from ..physics.study import Scenery, plan_phantom

    if source is None:
        _refuse_without_file(reading, body)
        if options.drive == "tendons":
            raise InputError(
                "--drive is tendons: give a tract with --robot, or a plan made with one"
            )
        with answer.show_progress() as progress:
            progress("plan", 0.0)
            plan, duct = plan_phantom(options.seed, body.scope)
        return None if _refuse(plan, answer) else Scenery(plan=plan, duct=duct)
    if source.suffix.lower() == ".npz":
        from ..motion.actuate.actuation import Actuation
        from .routing import reread_tract

        plan = Plan.load(source)
        given = [*list_given(reading), *list_given(body)]
        if given:
            raise InputError(
                f"--{given[0]} has no effect with a plan, which states it: leave it out"
            )
        if tract is None:
            raise InputError(f"{source} is a plan: give the file that it was made from too")
        read, duct = reread_tract(plan, tract, answer)
        if _refuse(plan, answer):
            return None
        scenery = Scenery.from_plan(plan, read, duct=duct)
        beside = source.with_name("robot.npz")
        if options.drive == "tendons" and os.path.exists(beside):
            scenery = replace(scenery, actuation=Actuation.load(beside))
        return scenery
    if tract is not None:
        raise InputError(f"{source} is a tract: leave out {tract}")
    from ..study import run_insertion

    read = read_with_options(source, reading, answer)
    with answer.show_progress() as progress:
        study = run_insertion(
            read, body.scope, options=InsertionOptions(), robot=body.machine, progress=progress
        )
    report_findings(study.findings[len(read.findings) :])
    if _refuse(study.plan, answer):
        return None
    duct = study.duct.inflate(study.plan.displaced)
    return Scenery(plan=study.plan, duct=duct, tract=read, actuation=study.robot)


def _refuse_without_file(reading: ReadOptions, body: MovingBody) -> None:
    """Refuse what has no effect on a phantom."""
    given = list_given(reading) + ["robot"] * (body.robot is not None)
    if given:
        raise InputError(f"--{given[0]} has no effect on a phantom: give a file, or leave it out")


def _refuse(plan: object, answer: Answer) -> bool:
    """Say that a plan stops, if it does."""
    reason = getattr(plan, "reason", "")
    if getattr(plan, "status", "") == "complete":
        return False
    answer.give({"complete": False, "reason": reason}, f"Refused by the planner: {reason}.")
    return True


def _run_trials(
    seeds: range,
    repeats: int,
    options: ExecuteOptions,
    setting: tuple[WallOptions, ScopeOptions],
    body: MovingBody,
    answer: Answer,
) -> None:
    from ..io.files import new_directory, write_text
    from ..physics.study import run_trials
    from .common import format_csv

    reserve_target(answer)
    with answer.show_progress() as progress:
        found = run_trials(
            seeds, body.scope, repeats=repeats, options=options, setting=setting,
            progress=progress,
        )  # fmt: skip
    with new_directory(answer.target, force=answer.force) as folder:
        write_text(folder / "trials.csv", format_csv(dict(found.list_columns())))
        import json

        summary = found.to_dict() | {"files": ["summary.json", "trials.csv"]}
        write_text(folder / "summary.json", json.dumps(summary, indent=2, allow_nan=False))
    completed = int(found.complete.sum())
    text = [
        f"{completed} of {len(found.complete)} runs came through; the planner refused "
        f"{len(found.refused)} of {len(seeds)} phantoms."
    ]
    if len(found.normal_peak):
        text.append(f"Largest force of one place: {1e3 * found.normal_peak.max():.3g} mN.")
    answer.give(summary, "\n".join(text))
    if not found.converged:
        run_exit(EXIT_NEGATIVE)


def _describe(study: ExecutionStudy, out: Path) -> str:
    """Return the comparison as a table, and where the files are."""
    from ..physics.study import COMPARED

    rows = [each.summarise() for each in study.executions]
    table = [[words, *(_show(row[name]) for row in rows)] for name, words in COMPARED]
    lines = [format_rows(["", *(row["drive"] for row in rows)], table)]
    lines += [f"{row['drive']}: {row['reason']}." for row in rows if row["reason"]]
    if study.executions[0].steps:
        lines.append(_describe_steps(study.executions[0].steps))
        lines += [f"Limit: {limit}." for limit in LIMITS]
    if study.convergence is not None:
        checked = study.convergence.describe()
        names = list(study.convergence.values)
        changes = [[name, *(f"{each[name]['change']:+.2g}" for each in checked.values())]
                   for name in names]  # fmt: skip
        lines.append(format_rows(["changes with", *checked], changes))
    lines.append(f"Forces: {out / 'force.png'}, page: {out / 'view.html'}")
    return "\n".join(lines)


def _describe_steps(steps: tuple[StepReport, ...]) -> str:
    """Return what came of the steps of a manoeuvre as a table."""
    rows = [step.to_dict() for step in steps]
    titles = {
        "step": "step", "base_moved_mm": "base [mm]", "tip_moved_mm": "tip [mm]",
        "tip_progress_mm": "tip is at [mm]", "tip_turned_deg": "tip turns [deg]",
        "twist_arrived": "arrives", "torque_N_mm": "torque [N mm]",
        "normal_peak_N": "wall, most [N]", "inside_over_reached": "inside/reached",
    }  # fmt: skip
    table = [[row["step"], *(_show(row[key]) for key in list(titles)[1:])] for row in rows]
    return format_rows([*titles.values()], table)


def _show(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "-" if value is None else f"{value:.3g}"
