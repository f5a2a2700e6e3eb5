"""``bozzini muscle fit-loop`` and others: operators from recorded loops, and their inverse."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..errors import FileFormatError, InputError
from ..results import Json
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    OUTPUT,
    PICTURES,
    Answer,
    CheckedCommand,
    NameType,
    answer_options,
    check_target,
    format_csv,
    gather,
    gather_once,
    option,
    run_exit,
    split_setting,
)
from .muscle_options import Request, design_options, list_kinds, model_options, set_option

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..muscle.loops import LoopFitOptions, LoopModel, LoopRecord
    from ..muscle.loops.record import Response

OPERATORS = (
    *("generalised", "prandtl-ishlinskii", "asymmetric", "unparallel", "bouc-wen", "preisach"),
    *("friction-band", "maxwell-slip"),
)
"""Those of `bozzini.muscle.loops.OPERATORS`, which is not loaded to write a help text."""
_RECORDS = (".yaml", ".yml", ".json")
_TABLES = (".csv", ".parquet")


def _parse_units(texts: tuple[str, ...]) -> dict[str, str]:
    form = "COLUMN=UNIT, such as pressure=kPa"
    return gather_once("--unit", (split_setting("--unit", item, form) for item in texts))


@dataclass(frozen=True)
class LoopRequest:
    """A record of loops and how it is fitted, as the options ask for it."""

    source: Path
    response: Response | None
    load: float | None
    contraction: float | None
    units: tuple[str, ...]
    drift: str
    samples: int
    hold_out: float

    def read(self) -> LoopRecord:
        """Return the record."""
        from ..muscle.loops import read_loop

        if self.load is not None and self.contraction is not None:
            raise InputError("--load and --contraction are both given: only one of them is held")
        known = self.response
        if self.load is not None or self.contraction is not None:
            implied: Response = "contraction" if self.load is not None else "force"
            if known not in (None, implied):
                given = "--load" if self.load is not None else "--contraction"
                raise InputError(f"{given} has no effect with --response {known}")
            known = implied
        held = self.contraction if self.load is None else self.load
        return read_loop(self.source, kind=known, held=held, units=_parse_units(self.units))

    @property
    def options(self) -> LoopFitOptions:
        """How it is fitted."""
        from ..muscle.loops import LoopFitOptions

        return LoopFitOptions(drift=self.drift, samples=self.samples, hold_out=self.hold_out)


resume_option = option(
    "--resume", "Begin at the end of what was fitted, instead of at rest.", is_flag=True
)
unit_option = option(
    "--unit units COLUMN=UNIT",
    "Unit of a column that states none, e.g. pressure=kPa; can be repeated.",
    multiple=True,
)
loop_options = gather(
    "loop",
    LoopRequest,
    click.argument("source", metavar="LOOP", type=INPUT),
    option(
        "--response",
        "What was recorded (default: the column that changes more).",
        ("contraction", "force"),
    ),
    option("--load", "Tension held while the contraction was recorded.", "force"),
    option("--contraction", "Contraction held while the force was recorded.", "length"),
    unit_option,
    option(
        "--drift",
        "Drift of the response beside the loops; log is log(1 + t / 1 s).",
        ("linear", "log", "none"),
        default="linear",
    ),
    option(
        "--samples",
        "Samples kept along the way of the pressure; each turn adds one.",
        int,
        default=2000,
    ),
    option("--hold-out", "Last share of the record that is not fitted.", float, default=0.0),
)


def _take_static(**values: object) -> Request | None:
    """Return the static model asked for; None without, where no option of a muscle may be given."""
    if values["model_name"] is None and values["muscle_file"] is None:
        for name, value in values.items():
            if value not in (None, ()):
                shown = {"settings": "set"}.get(name, name).replace("_", "-")
                raise InputError(f"--{shown} has no effect without --static")
        return None
    return Request.take(**values)


static_options = gather(
    "asked",
    _take_static,
    option(
        "--static model_name MODEL",
        "The model without hysteresis that is to carry the operator, see 'bozzini muscle models', "
        "or that of the muscle file; without, the operator gives the response itself.",
        NameType("model", lambda: list_kinds()),
    ),
    set_option,
    design_options,
    model_options,
)


@click.command("fit-loop", cls=CheckedCommand)
@loop_options
@option("--operator", "The operator.", OPERATORS, default="generalised")
@static_options
@option("--figure plot FILE", "A picture of the loop with the fit.", OUTPUT)
@answer_options(*_RECORDS, help="The operator (.yaml, .json), for trace and invert.", quiet=False)
def fit_command(
    loop: LoopRequest, operator: str, asked: Request | None, plot: Path | None, answer: Answer
) -> None:
    """Fit an operator to a recorded loop, with an offset and a drift of the record.

    LOOP is a .csv or .parquet file with the columns time, pressure and contraction, length or
    force, units in their names.

    The error of a fit is that of the part of --hold-out; without one it is not known how well it
    predicts.

    Exit code 0: fitted; 1: the search for the operator did not converge, the record does not tell a
    drift from it, or the fit is poor: off by more than 10 % of the span, fitted or held out; 2: bad
    input.
    """
    from ..muscle.loops import fit_loop, save_loop_model
    from ..plot import write_figure

    check_target(plot, PICTURES, force=answer.force)
    options = loop.options
    record = loop.read()
    static = None if asked is None else asked.build(pressure=0.0)
    found = fit_loop(record, operator, static=static, options=options)
    result = found.to_dict() | {"source": record.source, "file": answer.out, "plot": plot}
    if answer.out is not None:
        said = {key: result[key] for key in result if key not in ("file", "plot", "residual")}
        save_loop_model(answer.out, found.model, fit=said)
    if plot is not None:
        write_figure(found.plot(), plot)
    unit = record.unit
    lines = [f"note: {text}" for text in found.notes]
    lines += [
        f"{operator}: {found.describe_error()}",
        *(
            f"  {name}: {value:.4g} {unit}"
            for name, value in found.parts.items()
            if name not in ("fitted", "held out")
        ),
    ]
    lines += [f"offset at the end of what was fitted {found.model.offset:.4g} {unit}"]
    doubtful = "drift" in found.undetermined
    words = f"drift {found.drift:.4g} {unit}, {options.drift}"
    lines += [words + (", not determined" if doubtful else "")] if found.drift else []
    lines += [str(path) for path in (answer.out, plot) if path is not None]
    answer.give(result, "\n".join(lines + ([] if found.converged else [found.reason])))
    if not found.converged or doubtful or found.is_poor:
        run_exit(EXIT_NEGATIVE)


model_argument = click.argument("fitted", metavar="FIT", type=INPUT)


@click.command("trace-loop", cls=CheckedCommand)
@model_argument
@click.argument("source", metavar="HISTORY", type=INPUT)
@resume_option
@unit_option
@answer_options(*_TABLES, help="The table (.csv, .parquet).", quiet=False)
def trace_command(
    fitted: Path, source: Path, resume: bool, units: tuple[str, ...], answer: Answer
) -> None:
    """Compute the contraction or force along a history of pressures.

    FIT is a file of 'bozzini muscle fit-loop'; HISTORY has a column pressure and perhaps
    time. The table goes to stdout, unless --out names a file.
    """
    from ..muscle.loops import load_loop_model

    model = load_loop_model(fitted)
    columns = _read_history(source, ("time", "pressure"), units)
    if "pressure" not in columns:
        raise FileFormatError(f"{source.name}: there is no column pressure")
    response = model.trace(columns["pressure"], resume=resume)
    table = _name_columns(columns) | {f"{model.kind}_{_unit(model)}": response}
    _give_table(table, _describe(model) | {"file": answer.out}, answer, f"{len(response)} samples")


@click.command("invert-loop", cls=CheckedCommand)
@model_argument
@click.argument("source", metavar="WANTED", type=INPUT)
@option("--highest", "Highest pressure (default: the highest of the fit).", "pressure")
@resume_option
@unit_option
@answer_options(*_TABLES, *PICTURES, help="A table (.csv, .parquet) or a picture.", quiet=False)
def invert_command(
    fitted: Path,
    source: Path,
    highest: float | None,
    resume: bool,
    units: tuple[str, ...],
    answer: Answer,
) -> None:
    """Compute the pressures that give a history of contractions or forces.

    FIT is a file of 'bozzini muscle fit-loop'; WANTED has a column contraction, length or
    force, as the sensor of the record would show it, and perhaps time. The table goes to stdout,
    unless --out names a file. Where nothing legal reaches what is wanted the pressure is 0 or the
    highest.

    Exit code 0: all is reached; 1: some is out of reach; 2: bad input.
    """
    from ..muscle.loops import load_loop_model

    model = load_loop_model(fitted)
    column = "load" if model.kind == "force" else "length" if model.longest else "contraction"
    columns = _read_history(source, ("time", column), units)
    if column not in columns:
        asked = "force" if column == "load" else column
        raise FileFormatError(f"{source.name}: there is no column {asked}, which FIT was fitted to")
    wanted = columns.pop(column)
    wanted = model.longest - wanted if column == "length" else wanted
    found = model.compensate(wanted, highest=highest, resume=resume)
    table = _name_columns(columns) | found.list_columns()
    text = found.reason or f"{len(found.wanted)} samples, all reached"
    result = _describe(model) | {
        "highest_MPa": found.highest,
        "bounds": found.bounds,
        "converged": found.converged,
        "reason": found.reason,
        "residual": float(abs(found.residual).max()),
        "file": answer.out,
    }
    if answer.out is not None and answer.out.suffix.lower() in PICTURES:
        answer.draw(found.plot)
        answer.give(result | {"columns": table}, f"{answer.out}: {text}")
    else:
        _give_table(table, result, answer, text)
    if not found.converged:
        run_exit(EXIT_NEGATIVE)


def _read_history(source: Path, names: tuple[str, ...], units: tuple[str, ...]) -> Json:
    from ..muscle.table import read_columns

    return dict(read_columns(source, names, units=_parse_units(units))[0])


def _unit(model: LoopModel) -> str:
    from ..muscle.loops.record import RESPONSES

    return RESPONSES[model.kind]


def _name_columns(columns: Mapping[str, NDArray[np.float64]]) -> Json:
    names = {"time": "time_s", "pressure": "pressure_MPa"}
    return {names[name]: values for name, values in columns.items()}


def _describe(model: LoopModel) -> Json:
    return {
        "operator": model.operator_name,
        "response": model.kind,
        "static": None if model.static is None else model.static.name,
        "held": model.held,
    }


def _give_table(table: Json, result: Json, answer: Answer, text: str) -> None:
    """Write a table to its file or to stdout."""
    shown = format_csv(table).rstrip("\n") if answer.out is None else f"{answer.out}: {text}"
    if answer.out is not None and answer.out.suffix.lower() == ".parquet":
        from ..io.sheets import write_table

        write_table(answer.out, table)
    elif answer.out is not None:
        from ..io.files import write_text

        write_text(answer.out, format_csv(table))
    answer.give(result | {"columns": table}, shown)
