"""``bozzini muscle compare`` and ``bozzini muscle fit``: models against measurements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ._muscle_options import (
    PICTURES,
    check_target,
    describe_muscle,
    design_options,
    make_class,
    make_muscle,
    model_option,
    model_options,
    unit_of,
)
from .common import EXIT_NEGATIVE, emit, force_option, json_option, run_exit

if TYPE_CHECKING:
    from ..muscle.calibrate import Calibration
    from ..muscle.dataset import Measurements
    from ..muscle.design import Muscle

__all__ = ["compare_command", "fit_command"]

FITTED = {"energy": ("modulus", "dead_length"), "thesis": ("modulus", "end_length")}
"""What ``compare --fit`` fits in each model."""

data_argument = click.argument("source", metavar="DATA", type=click.Path(path_type=Path))
units_option = click.option(
    "--unit",
    "units",
    multiple=True,
    metavar="COLUMN=UNIT",
    help="Unit of a column that states none, e.g. pressure=kPa; can be repeated.",
)
mean_option = click.option(
    "--mean", "take_mean", is_flag=True, help="Take the mean of inflation and deflation."
)


@click.command("compare")
@data_argument
@click.option(
    "--model",
    "model_names",
    multiple=True,
    default=("energy", "thesis"),
    show_default=True,
    help="A model to compare; can be repeated.",
)
@click.option(
    "--fit", is_flag=True, help="Fit each model first: modulus, and dead length or end length."
)
@units_option
@mean_option
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="A picture.")
@design_options
@model_options
@force_option
@json_option
def compare_command(
    source: Path,
    model_names: tuple[str, ...],
    fit: bool,
    units: tuple[str, ...],
    take_mean: bool,
    out: Path | None,
    preset: str,
    ends: str,
    load_path: str,
    force: bool,
    as_json: bool,
    **fields: float | None,
) -> None:
    """Compare models with measurements.

    DATA is a .csv or .parquet file with the columns pressure, contraction or length and, if there,
    load, direction and specimen; their units stand in the header, as in 'pressure [kPa]'. The
    standard error is also given as a percentage of the largest contraction.
    """
    from ..muscle.calibrate import calibrate
    from ..muscle.compare import compare_models

    check_target(out, PICTURES, force=force)
    muscle = make_muscle(preset, fields)
    data = _read_data(source, muscle, units, take_mean)
    models, counts, notes = {}, {}, {}
    for name in dict.fromkeys(model_names):
        make = make_class(name, ends=ends, load_path=load_path)
        models[name] = make(muscle)
        if fit:
            found = calibrate(make, muscle, data, free=FITTED[name])
            models[name] = make(found.muscle)
            counts[name] = len(found.free)
            notes[name] = found.estimates
    comparison = compare_models(models, data, fitted=counts)
    if out is not None:
        from ..view import write_figure
        from ..view.muscle_figures import draw_models

        write_figure(draw_models(comparison, models), out)
    result = {
        "rows": len(data),
        "ignored_columns": data.ignored,
        "largest_contraction_mm": data.largest_contraction,
        "models": [
            {
                "model": score.name,
                "standard_error_mm": score.standard_error,
                "standard_error_percent": score.standard_error_percent,
                "rmse_mm": score.rmse,
                "bias_mm": score.bias,
                "largest_error_mm": score.largest,
                "fitted": notes.get(score.name, {}),
            }
            for score in comparison.scores
        ],
        "refusals": comparison.refusals,
        "file": out,
    }
    emit(result, as_json=as_json, text=_note_ignored(data) + comparison.format_table())
    if not comparison.scores:
        run_exit(EXIT_NEGATIVE)


@click.command("fit")
@data_argument
@model_option
@click.option(
    "--free",
    default="modulus,dead-length",
    show_default=True,
    help="Fields to fit, separated by commas; the options below are where they start.",
)
@click.option("--anyway", is_flag=True, help="Fit also what the data cannot tell apart.")
@units_option
@mean_option
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="A picture.")
@design_options
@model_options
@force_option
@json_option
def fit_command(
    source: Path,
    model_name: str,
    free: str,
    anyway: bool,
    units: tuple[str, ...],
    take_mean: bool,
    out: Path | None,
    preset: str,
    ends: str,
    load_path: str,
    force: bool,
    as_json: bool,
    **fields: float | None,
) -> None:
    """Fit fields of a muscle to measurements.

    DATA is a .csv or .parquet file, see 'bozzini muscle compare --help'.

    Exit code 0: fitted, and nothing speaks against the estimates; 1: fitted, but with warnings,
    or no minimum was found; 2: bad input.
    """
    from ..muscle.calibrate import calibrate
    from ..muscle.compare import compare_models

    check_target(out, PICTURES, force=force)
    muscle = make_muscle(preset, fields)
    make = make_class(model_name, ends=ends, load_path=load_path)
    data = _read_data(source, muscle, units, take_mean)
    names = [part.strip().replace("-", "_") for part in free.split(",")]
    found = calibrate(make, muscle, data, free=names, force=anyway)
    if out is not None:
        from ..view import write_figure
        from ..view.muscle_figures import draw_models

        models = {model_name: make(found.muscle)}
        comparison = compare_models(models, data, fitted={model_name: len(found.free)})
        write_figure(draw_models(comparison, models), out)
    result = {
        "model": model_name,
        "rows": len(data),
        "ignored_columns": data.ignored,
        "estimates": {
            name: {
                "value": found.estimates[name],
                "unit": unit_of(name),
                "standard_error": found.standard_errors[name],
                "interval_95": found.intervals[name],
            }
            for name in found.free
        },
        "correlations": found.correlations,
        "condition": found.condition,
        "sigma_mm": found.sigma,
        "warnings": found.warnings,
        "converged": found.converged,
        "reason": found.reason,
        "muscle": describe_muscle(found.muscle),
        "file": out,
    }
    emit(result, as_json=as_json, text=_note_ignored(data) + _format_fit(found))
    if not found.trusted:
        run_exit(EXIT_NEGATIVE)


def _read_data(
    source: Path, muscle: Muscle, units: tuple[str, ...], take_mean: bool
) -> Measurements:
    from ..errors import InputError
    from ..muscle.dataset import read_measurements

    table = {}
    for item in units:
        name, mark, unit = item.partition("=")
        if not (name and mark and unit):
            raise InputError(f"--unit is '{item}': it must be COLUMN=UNIT, such as pressure=kPa")
        table[name.strip()] = unit.strip()
    data = read_measurements(source, muscle=muscle, units=table)
    return data.mean_of_directions() if take_mean else data


def _format_fit(found: Calibration) -> str:
    lines = []
    for name in found.free:
        low, high = found.intervals[name]
        lines.append(
            f"{name:<16}{found.estimates[name]:10.4g} {unit_of(name):<4} "
            f"95 %: {low:.4g} to {high:.4g}"
        )
    lines.append(
        f"residuals {found.sigma:.3g} mm, condition {found.condition:.1f}; "
        f"{'converged' if found.converged else 'not converged'}: {found.reason}"
    )
    return "\n".join([*lines, *(f"warning: {text}" for text in found.warnings)])


def _note_ignored(data: Measurements) -> str:
    return f"ignored columns: {', '.join(data.ignored)}\n" if data.ignored else ""
