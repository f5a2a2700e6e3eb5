"""``bozzini muscle compare``: models against measurements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ._muscle_data import (
    FITTED,
    check_friction,
    data_argument,
    mean_option,
    note_data,
    read_data,
    units_option,
)
from ._muscle_options import (
    MODEL_NAMES,
    check_fields,
    describe_muscle,
    design_options,
    make_class,
    make_muscle,
    model_options,
    select_choices,
)
from ._tables import PICTURES, check_target
from .common import EXIT_NEGATIVE, emit, force_option, json_option, run_exit

if TYPE_CHECKING:
    from ..muscle.calibration import Calibration
    from ..muscle.model import StaticModel

__all__ = ["compare_command"]


@click.command("compare")
@data_argument
@click.option(
    "--model",
    "model_names",
    type=click.Choice(MODEL_NAMES),
    multiple=True,
    default=MODEL_NAMES,
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
    ends: str | None,
    load_path: str | None,
    force: bool,
    as_json: bool,
    **fields: float | None,
) -> None:
    """Compare models with measurements.

    DATA is a .csv or .parquet file with the columns pressure, contraction or length and, if there,
    load, direction and specimen; their units stand in the header, as in 'pressure [kPa]'. The
    standard error is also given as a percentage of the largest contraction.

    Exit code 0: compared; 1: no model has an answer; 2: bad input. A picture is written only if a
    model has an answer.
    """
    from ..errors import BozziniError
    from ..muscle import calibrate, compare_models

    check_target(out, PICTURES, force=force)
    names = list(dict.fromkeys(model_names))
    choices = select_choices(names, ends=ends, load_path=load_path)
    check_fields(names, fields)
    muscle = make_muscle(preset, fields)
    data = read_data(source, muscle, units, take_mean)
    check_friction(fields, data, free=())
    models: dict[str, StaticModel] = {}
    fits: dict[str, Calibration] = {}
    refusals: dict[str, str] = {}
    for name in names:
        make = make_class(name, **{"ends": None, "load_path": None, **choices[name]})
        try:
            if fit:
                fits[name] = calibrate(make, muscle, data, free=FITTED[name])
            models[name] = make(fits[name].muscle if fit else muscle)
        except BozziniError as error:
            refusals[name] = str(error)
    counts = {name: len(found.free) for name, found in fits.items() if name in models}
    comparison = compare_models(models, data, fitted=counts, refusals=refusals)
    written = out if comparison.scores else None
    if written is not None:
        from ..view import write_figure
        from ..view.muscle_figures import draw_models

        write_figure(draw_models(comparison, models), written)
    result = {
        "rows": len(data),
        "preset": preset,
        "mean": take_mean,
        "choices": choices,
        "ignored_columns": data.ignored,
        "notes": data.notes,
        "largest_contraction_mm": data.largest_contraction,
        "models": [
            {
                "model": score.name,
                "standard_error_mm": score.standard_error,
                "standard_error_percent": score.standard_error_percent,
                "rmse_mm": score.rmse,
                "bias_mm": score.bias,
                "largest_error_mm": score.largest,
                **_describe_comparison_fit(fits.get(score.name)),
            }
            for score in comparison.scores
        ],
        "refusals": comparison.refusals,
        "file": written,
        "muscle": describe_muscle(muscle),
    }
    lines = [note_data(data) + comparison.format_table()]
    for name, found in fits.items():
        if not found.converged:
            lines.append(f"{name}: not converged: {found.reason}")
        lines += [f"{name}: warning: {text}" for text in found.warnings]
    emit(result, as_json=as_json, text="\n".join(lines))
    if not comparison.scores:
        run_exit(EXIT_NEGATIVE)


def _describe_comparison_fit(found: Calibration | None) -> dict[str, Any]:
    if found is None:
        return {"fitted": {}}
    return {
        "fitted": found.estimates,
        "fit_warnings": found.warnings,
        "fit_converged": found.converged,
        "fit_reason": found.reason,
    }
