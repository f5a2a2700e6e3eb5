"""``bozzini uncertainty``: how likely a plan touches a wall that is not quite where it is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from ..errors import InputError
from ..study.options import ContactOptions
from ..units import parse_quantity
from .common import EXIT_NEGATIVE, Answer, answer_options, format_rows, option, options_of, run_exit
from .plan import reserve_target

__all__ = ["command"]


@click.command("uncertainty")
@click.argument("source", metavar="PLAN", type=click.Path(path_type=Path))
@click.argument("tract", metavar="[INPUT]", required=False, type=click.Path(path_type=Path))
@options_of(ContactOptions, "options")
@option(
    "--diameters LENGTH,LENGTH,...",
    "Other diameters of the same motion (default: 0.6 to 1.2 times the scope's).",
    str,
)
@answer_options(
    default="bozzini-uncertainty",
    show_default=True,
    metavar="DIRECTORY",
    help="Directory for tables, figure, report and summary.",
)
def command(
    source: Path,
    tract: Path | None,
    options: ContactOptions,
    diameters: str | None,
    answer: Answer,
) -> None:
    """State how likely PLAN touches its wall, if that is not quite where it is said to be.

    PLAN is a plan's .npz and INPUT the file that it was made from. The wall is moved along its
    normal: by the same everywhere, and by a random field with an error of its own every correlation
    length. With --replan it is also planned anew in the first random walls. Exit code 0: done; 1:
    the plan is not even proved clear of the wall as it is given; 2: bad input.
    """
    if source.suffix.lower() != ".npz":
        raise InputError(f"{source} is not a plan: give a plan's .npz")
    if diameters is not None:
        sizes = tuple(parse_quantity(part, "length") for part in diameters.split(","))
        options = replace(options, diameters=sizes)
    _run_contact(source, tract, options, answer)


def _run_contact(source: Path, path: Path | None, options: ContactOptions, answer: Answer) -> None:
    """Find and write how likely a plan touches its wall."""
    from ..io.files import new_directory
    from ..study.contact import study_contact
    from .routing import read_plan, reread_tract

    plan = read_plan(source)
    if path is None:
        raise InputError(f"{source} is a plan: give the file that it was made from too")
    reserve_target(answer)
    tract, duct = reread_tract(plan, path, answer)
    with answer.show_progress() as progress:
        found = study_contact(plan, tract, options=options, duct=duct, progress=progress)
    with new_directory(answer.target, force=answer.force) as folder:
        summary = found.write(folder)
    for note in found.notes:
        click.echo(f"bozzini: warning: {note}", err=True)
    table = format_rows(["", "P", "95 %"], found.list_answers())
    answer.give(summary, f"{table}\nReport: {answer.target / 'report.html'}")
    if not found.converged:
        run_exit(EXIT_NEGATIVE)
