"""The command of a task: options, help, JSON, table and picture follow from its declaration."""

from __future__ import annotations

import dataclasses
import inspect
import sys
from collections.abc import Callable

import click

from ..checks import spell_option
from ..errors import InputError
from ..task import Task, has_converged, is_argument
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    PICTURES,
    Answer,
    CheckedCommand,
    Command,
    answer_options,
    description,
    gather,
    make_option,
    options_file,
    run_exit,
)


def make_command(kind: type[Task]) -> click.Command:
    """Return the command of a task: an input that is a file and has no default comes by itself."""
    fields = kind.list_fields().values()
    drawn = hasattr(kind.result, "plot")
    pages = [".html"] if kind.has_page else []
    formats = [".csv", *(PICTURES if drawn else ()), *pages, *kind.formats]
    help = f"A table (.csv){' or a picture' if drawn else ''}."
    if kind.has_page:
        help = "A table (.csv), a picture, or a page in 3-D (.html)."
    if kind.formats:
        help = f"{help.removesuffix('.')}; or {', '.join(kind.formats)}."

    @click.command(kind.name, cls=CheckedCommand, help=inspect.getdoc(kind))
    @gather(
        "task", lambda **given: kind.from_inputs(given), *(_make(kind, item) for item in fields)
    )
    @options_file(kind.list_fields(), f"bozzini new {kind.key}")
    @answer_options(*formats, help=help)
    def command(task: Task, answer: Answer) -> None:
        if kind.streamed and str(getattr(task, kind.streamed)) == "-":
            if answer.out is not None or answer.as_json:
                raise InputError("rows of stdin are answered on stdout: leave --out and --json out")
            every = True
            for text, answered in task.stream(sys.stdin):
                click.echo(text, nl=False)
                sys.stdout.flush()
                every = every and answered
            if not every:
                run_exit(EXIT_NEGATIVE)
            return
        with answer.show_progress() as progress:
            found = task.run(progress)
        ending = "" if answer.out is None else answer.out.name.lower()
        write = next((each for end, each in kind.formats.items() if ending.endswith(end)), None)
        if write is not None:
            write(found, answer.target)
        elif answer.is_page:
            found.show().save(answer.target)  # type: ignore[attr-defined]
        else:
            answer.write(found.list_table(), lambda: found.plot())  # type: ignore[attr-defined]
        result = {**found.to_dict(), "inputs": task.inputs, "file": answer.out}
        answer.give(result, task.describe(found))
        if not has_converged(found):
            run_exit(EXIT_NEGATIVE)

    return command


def _make(kind: type[Task], item: dataclasses.Field[object]) -> Callable[[Command], Command]:
    if item.name == kind.group:  # the file of what the command is about
        known = item.metadata["quantity"]
        return description(item.name, spell_option(item), about=known.help, kind=INPUT)
    if is_argument(item):
        return click.argument(item.name, metavar=item.name.upper(), type=INPUT)
    return make_option(item)
