"""``bozzini study``: many rows from one file, on all cores or a cluster, resumable."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..errors import InputError
from ..results import format_rows
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    PICTURES,
    Answer,
    CheckedGroup,
    answer_options,
    describe_classes,
    gather,
    option,
    run_exit,
)

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from ..results import Json
    from ..study.run import Engine, StudyResult


def _make_engine(**given: object) -> Engine:
    from ..study.run import Engine

    return Engine(**given)  # type: ignore[arg-type]


engine_options = gather(
    "engine",
    _make_engine,
    option("--workers", "Processes (default: one for each processor).", int),
    option(
        "--cluster",
        "A Dask cluster instead: local, tcp://HOST:PORT, or a scheduler's file .json; needs the "
        "extra 'sweeps'.",
        str,
    ),
)
_FOLDER = click.argument("folder", type=INPUT)


@click.group("study", cls=CheckedGroup)
def command() -> None:
    """Compute many rows from one study file: sweeps, tolerances, maps, searches."""


def _give(found: StudyResult, answer: Answer, *, negative: bool) -> None:
    lines = [
        f"{found.folder}: {found.done} of {found.rows} rows, {found.feasible} feasible",
        *(f"{count:>9}  {reason}" for reason, count in found.reasons.items()),
    ]
    if found.seconds:
        lines[0] += f", {found.seconds:.1f} s"
    answer.give(found.to_dict(), "\n".join(lines))
    if negative:
        run_exit(EXIT_NEGATIVE)


@command.command("run")
@click.argument("file", type=INPUT)
@engine_options
@answer_options(
    required=True,
    metavar="DIRECTORY",
    help="Directory of the results; one that holds this study already is gone on with.",
)
def run_command(file: Path, engine: Engine, answer: Answer) -> None:
    """Compute the rows of a study file.

    A job module:function runs that module: trust such a study file like code.

    Interrupt it at any time: `bozzini study resume` goes on.

    Exit code 0: all rows are there and one or more is feasible; 1: none is; 2: bad input.
    """
    from ..study.definition import Study
    from ..study.run import run_study

    study = Study.load(file)
    with answer.show_progress() as progress:
        found = run_study(study, answer.target, engine=engine, progress=progress)
    _give(found, answer, negative=not found.feasible)


@command.command("resume")
@_FOLDER
@engine_options
@answer_options()
def resume_command(folder: Path, engine: Engine, answer: Answer) -> None:
    """Go on with a study that was interrupted: what is written stays.

    Exit code 0: all rows are there and one or more is feasible; 1: none is; 2: bad input.
    """
    from ..study.run import open_study, run_study

    study = open_study(folder)
    with answer.show_progress() as progress:
        found = run_study(study, folder, engine=engine, progress=progress)
    _give(found, answer, negative=not found.feasible)


@command.command("status")
@_FOLDER
@answer_options(quiet=False)
def status_command(folder: Path, answer: Answer) -> None:
    """Tell how many rows are there, how many are feasible, and why the others are not.

    Exit code 0: all rows are there; 1: some are missing; 2: bad input.
    """
    from ..study.run import read_status

    found = read_status(folder)
    _give(found, answer, negative=not found.converged)


@command.command("show")
@_FOLDER
@option(
    "--figure",
    "What --out draws: a map (x, y and perhaps a value), parallel coordinates, or the Pareto front "
    "of two columns (-NAME is better when larger).",
    ("map", "parallel", "pareto"),
    default="map",
)
@option("--columns NAME,NAME,...", "Columns of the figure.")
@answer_options(*PICTURES, quiet=False)
def show_command(folder: Path, figure: str, columns: str | None, answer: Answer) -> None:
    """Summarise the rows that are there, and draw them.

    Exit code 0: a row is feasible; 1: none is; 2: bad input.
    """
    from ..study.run import read_manifest, read_rows

    rows = read_rows(folder)
    known = read_manifest(folder).get("columns", {})
    names = [name for name in known.values() if name in rows and rows[name].dtype.kind in "if"]

    def draw() -> Figure:
        from ..plot import study as plots

        drawers = {
            "map": plots.draw_map,
            "parallel": plots.draw_parallel,
            "pareto": plots.draw_pareto,
        }
        given = names[: 20 if figure == "parallel" else 2]
        if columns is not None:
            given = [name.strip() for name in columns.split(",")]
        return drawers[figure](rows, given)

    if columns is not None and answer.out is None:
        raise InputError("--columns has no effect without --out: leave it out")
    answer.draw(draw)
    summary = _summarise(rows, names)
    head = ["feasible rows", "least", "median", "largest"]
    table = [[name, *(f"{value:.5g}" for value in row.values())] for name, row in summary.items()]
    feasible = int(rows["feasible"].sum())
    text = f"{folder}: {len(rows)} rows, {feasible} feasible"
    if feasible:
        text += f"\n{format_rows(head, table)}"
    answer.give(
        {"rows": len(rows), "feasible": feasible, "columns": summary, "file": answer.out}, text
    )
    if not feasible:
        run_exit(EXIT_NEGATIVE)


def _summarise(rows: pandas.DataFrame, names: list[str]) -> dict[str, Json]:
    feasible = rows[rows["feasible"]]
    return {
        name: {
            "least": float(feasible[name].min()),
            "median": float(feasible[name].median()),
            "largest": float(feasible[name].max()),
        }
        for name in names
        if len(feasible)
    }


@command.command("export")
@_FOLDER
@answer_options(".csv", ".parquet", required=True, help="A table, .csv or .parquet.", quiet=False)
def export_command(folder: Path, answer: Answer) -> None:
    """Write all rows into one table.

    Exit code 0: written; 2: bad input.
    """
    from ..study.run import export_rows

    count = export_rows(folder, answer.target)
    answer.give({"file": answer.out, "rows": count}, f"{answer.out}: {count} rows")


@command.command("jobs")
@answer_options(quiet=False)
def jobs_command(answer: Answer) -> None:
    """List the jobs that a study file may name, besides module:function."""
    from ..study.jobs import JOBS
    from ..study.tasks import TASKS

    rows, text = describe_classes(JOBS)
    more, tasks = describe_classes(TASKS)
    answer.give({**rows, **more}, f"{text}\n{tasks}")
