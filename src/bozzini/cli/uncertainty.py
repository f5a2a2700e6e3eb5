"""``bozzini uncertainty``: how sure a plan or a study is, and what that comes of."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..checks import check_number
from ..errors import InputError, OutputError
from ..results import format_rows
from ..study.options import ContactRiskOptions
from ..units import parse_quantity
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    Answer,
    CheckedCommand,
    answer_options,
    format_csv,
    gather,
    option,
    options_of,
    refuse_options,
    run_exit,
)
from .plan import reserve_target
from .study import engine_options

if TYPE_CHECKING:
    from ..study.definition import Study
    from ..study.population import Population
    from ..study.run import Engine
    from ..study.sensitivity import FailureRule, StudySpread

OUT = Path("bozzini-uncertainty")


@dataclass(frozen=True)
class _More:
    diameters: str | None
    failures: FailureRule
    level: float


@click.command("uncertainty", cls=CheckedCommand)
@click.argument("source", metavar="PLAN|STUDY", type=INPUT)
@click.argument("tract", metavar="[INPUT]", required=False, type=INPUT)
@options_of(ContactRiskOptions, "options")
@gather(
    "more",
    _More,
    option(
        "--diameters LENGTH,LENGTH,...",
        "Other diameters of the same motion (default: 0.6 to 1.2 times the scope's).",
        str,
    ),
    option(
        "--failures",
        "Of Sobol indices, what rows without an answer are: an error; an output of its own; or "
        "left out by narrowing the factors to a box in which none fails.",
        ("refuse", "indicator", "box"),
        default="refuse",
    ),
    option("--level", "Probability of the intervals of a study.", float, default=0.95),
)
@engine_options
@answer_options(
    metavar="DIRECTORY",
    help=f"Directory for summary, tables and figures (default of a plan: {OUT}).",
)
def command(
    source: Path,
    tract: Path | None,
    options: ContactRiskOptions,
    more: _More,
    engine: Engine,
    answer: Answer,
) -> None:
    """State how likely PLAN touches its wall, or how the outputs of STUDY are distributed.

    PLAN is a plan's .npz and INPUT the file that it was made from. The wall is moved along its
    normal: by the same everywhere, and by a random field with an error of its own every correlation
    length. With --replan it is also planned anew in the first random walls.

    STUDY is a study file, whose rows are computed into the directory of --out, or a directory of
    results. With the sampling saltelli it gives Sobol indices. Where tracts or phantoms are a
    factor of insertion-feasibility, it gives the share of them that each scope fits.

    Exit code 0: done; 1: the plan is not even proved clear of the wall as it is given; 2: bad
    input.
    """
    if tract is not None or source.suffix.lower() == ".npz":
        refuse_options(["failures", "level", "workers", "cluster"], "with a plan")
        if more.diameters is not None:
            sizes = tuple(parse_quantity(part, "length") for part in more.diameters.split(","))
            options = replace(options, diameters=sizes)
        _of_plan(source, tract, options, replace(answer, out=answer.out or OUT))
    else:
        refuse_options([item.name for item in fields(ContactRiskOptions)], "with a study")
        _of_study(source, more.failures, more.level, engine, answer)


def _of_plan(source: Path, path: Path | None, options: ContactRiskOptions, answer: Answer) -> None:
    """Find and write how likely a plan touches its wall."""
    from ..io.files import new_directory
    from ..study.contact_risk import study_contact
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


def _of_study(
    source: Path, failures: FailureRule, level: float, engine: Engine, answer: Answer
) -> None:
    """Answer for a study file or a directory of results."""
    from ..study.definition import Study
    from ..study.population import count_fits, is_population
    from ..study.run import open_study, read_rows, run_study
    from ..study.sensitivity import analyse_rows, analyse_study

    check_number("--level", level, low=0.5, high=0.9999)
    computed = os.path.isdir(source)
    study = open_study(source) if computed else Study.load(source)
    if not computed and answer.out is None:
        raise InputError("--out is missing: the directory of the results")
    folder = source if computed else answer.target
    sampling = study.spec.sampling
    if is_population(study) or sampling is None or sampling.method != "saltelli":
        refuse_options(["failures"], "without the sampling saltelli")
    if computed and failures != "box":
        refuse_options(["workers", "cluster"], "with results that are computed")
    if failures == "box" and computed and answer.out != source:
        raise InputError(
            f"--failures box computes more rows: give the study file, or --out {source}"
        )
    _check_out(answer.out, source)
    found: Population | StudySpread
    with answer.show_progress() as progress:
        if is_population(study):
            if not computed:
                run_study(study, folder, engine=engine, progress=progress)
            found = count_fits(study, read_rows(folder), level=level)
        elif computed and failures != "box":
            found = analyse_rows(study, read_rows(folder), failures=failures, level=level)
        else:
            found = analyse_study(
                study, folder, failures=failures, engine=engine, level=level, progress=progress
            )
    _write(found, study, answer)


def _check_out(out: Path | None, source: Path) -> None:
    """Refuse a directory of something else."""
    if out is None or not os.path.exists(out) or out == source:
        return
    if not out.is_dir():
        raise OutputError(f"{out} is a file: choose a directory")
    if any(out.iterdir()) and not (out / "study.json").exists():
        raise OutputError(f"{out} holds other files and no study: choose another directory")
    if os.path.isdir(source) and (out / "study.json").exists():
        raise OutputError(f"{out} holds the results of another study: choose another directory")


def _write(found: Population | StudySpread, study: Study, answer: Answer) -> None:
    from ..io.files import write_text
    from ..plot import write_figure
    from ..study.population import Population

    if isinstance(found, Population):
        table, text = "population", _format_population(found)
        figures = {"population.png": found.draw}
    else:
        table, text = "indices", _format_spread(found)
        figures = {"outputs.png": found.draw_spreads}
        if found.indices:
            figures["indices.png"] = found.draw_indices
    result = {"job": study.spec.job, "key": study.key, **found.to_dict()}
    if answer.out is not None:
        os.makedirs(os.path.realpath(answer.out), exist_ok=True)
        write_text(answer.out / "summary.json", json.dumps(result, indent=2) + "\n")
        columns = found.list_columns()
        if len(next(iter(columns.values()))):  # type: ignore[arg-type]
            write_text(answer.out / f"{table}.csv", format_csv(columns))
        for name, draw in figures.items():
            write_figure(draw(), answer.out / name)
    answer.give({**result, "folder": answer.out}, text)


def _format_spread(found: StudySpread) -> str:
    head = ["output", "rows", "failed", "mean", "sd", "2.5 %", "median", "97.5 %"]
    table = []
    for name, spread in found.spreads.items():
        plain = spread.to_dict()
        numbers = [plain["mean"], plain["sd"], *(plain["quantiles"][q] for q in _SHOWN)]
        counts = [str(plain["rows"]), str(plain["failed"])]
        table.append([name, *counts, *("-" if x is None else f"{x:.5g}" for x in numbers)])
    parts = [f"{found.rows} rows\n{format_rows(head, table)}"]
    if found.box is not None:
        lines = [f"  {name}: {_format_ends(ends)}" for name, ends in found.box.items()]
        parts.append("\n".join(["where no row fails:", *lines]))
    for output, each in found.indices.items():
        rows = [
            [name, *(f"{first:.3f}" for first in (a, *b)), *(f"{last:.3f}" for last in (c, *d))]
            for name, a, b, c, d in zip(
                each.factors, each.first, each.first_interval, each.total, each.total_interval,
                strict=True,
            )
        ]  # fmt: skip
        parts.append(format_rows([output, "first", "from", "to", "total", "from", "to"], rows))
    parts += [f"note: {found.note}"] if found.note else []
    return "\n\n".join(parts)


_SHOWN = ("0.025", "0.5", "0.975")


def _format_ends(ends: list[object]) -> str:
    return ", ".join(f"{end:.5g}" if isinstance(end, float) else str(end) for end in ends)


def _format_population(found: Population) -> str:
    head = [*found.scopes, "patients", "fits", "share", "interval", "fits not", "undecided",
            "errors"]  # fmt: skip
    rows = [
        [
            *(f"{row[name]:g}" if not isinstance(row[name], str) else row[name]
              for name in found.scopes),
            str(row["patients"]),
            str(row["fits"]),
            f"{row['share']:.2f}",
            f"{row['share_low']:.2f} to {row['share_high']:.2f}",
            str(row["fits_not"]),
            str(row["undecided"]),
            str(row["errors"]),
        ]
        for row in found.table.to_dict("records")
    ]  # fmt: skip
    why = "; errors: why, tells 'bozzini study status'" if found.table["errors"].any() else ""
    return (
        f"{format_rows(head, rows)}\nfits: proved; fits not: proved that no way through is so "
        f"wide; intervals of {100.0 * found.level:g} % (Wilson){why}"
    )
