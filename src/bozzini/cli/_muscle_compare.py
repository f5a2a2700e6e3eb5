"""``bozzini muscle compare``: models against measurements."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ._muscle_constants import parse_settings, set_option
from ._muscle_data import (
    check_friction,
    data_argument,
    mean_option,
    note_data,
    read_data,
    units_option,
)
from ._muscle_options import (
    ModelType,
    check_fields,
    describe_muscle,
    design_options,
    list_kinds,
    make_class,
    make_muscle,
    model_options,
    select_choices,
)
from ._tables import PICTURES, check_target
from .common import EXIT_NEGATIVE, emit, force_option, json_option, progress_bar, run_exit

if TYPE_CHECKING:
    from ..muscle.compare import ModelScore
    from ..muscle.dataset import Measurements
    from ..muscle.design import Muscle
    from ..muscle.model import StaticModel
    from ..muscle.rank import RankedModel

__all__ = ["compare_command"]

_WARNED = 3  # so many models, the first, have the warnings of their fits shown


@click.command("compare")
@data_argument
@click.option(
    "--model",
    "model_names",
    type=ModelType(),
    multiple=True,
    help="A model to compare; can be repeated (default: fit and rank all, see 'models').",
)
@click.option(
    "--fit",
    is_flag=True,
    help="With --model, fit each model first, and rank: modulus, and dead length (energy) or end "
    "length (thesis); constants and modulus of the others.",
)
@click.option(
    "--by",
    "criterion",
    type=click.Choice(["aicc", "bic", "cv"]),
    help="Of a fit, rank by an information criterion or by the rows left out (default: aicc).",
)
@click.option(
    "--folds", type=int, help="Of a fit, parts for cross-validation; 0 for none (default: 5)."
)
@click.option("--seed", type=int, help="Of a fit, for folds and starts (default: 0).")
@units_option
@mean_option
@set_option
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="A picture.")
@design_options
@model_options
@force_option
@json_option
def compare_command(
    source: Path,
    model_names: tuple[str, ...],
    fit: bool,
    criterion: str | None,
    folds: int | None,
    seed: int | None,
    units: tuple[str, ...],
    take_mean: bool,
    settings: tuple[str, ...],
    out: Path | None,
    preset: str,
    ends: str | None,
    load_path: str | None,
    force: bool,
    as_json: bool,
    **fields: float | None,
) -> None:
    """Compare models with measurements; without --model, fit and rank all that can be fitted.

    DATA is a .csv or .parquet file with the columns pressure, contraction or length and, if there,
    load, direction and specimen; their units stand in the header, as in 'pressure [kPa]'. The
    standard error is also given as a percentage of the largest contraction.

    Models that are fitted are ranked: by AICc, which charges a model for its constants, unless --by
    says otherwise. 'left out' is the error at rows left out of the fit.

    Exit code 0: compared; 1: no model has an answer; 2: bad input. A picture is written only if a
    model has an answer.
    """
    from ..errors import InputError

    check_target(out, PICTURES, force=force)
    fit = fit or not model_names
    for option, value in (("--by", criterion), ("--folds", folds), ("--seed", seed)):
        if value is not None and not fit:
            raise InputError(f"{option} has no effect without --fit: leave it out")
    names = list(dict.fromkeys(model_names) if model_names else list_kinds())
    choices = select_choices(names, ends=ends, load_path=load_path)
    check_fields(names, fields)
    constants = parse_settings(names, settings)
    muscle = make_muscle(preset, fields)
    data = read_data(source, muscle, units, take_mean)
    check_friction(fields, data, free=())
    makes = {
        name: make_class(
            name, **{"ends": None, "load_path": None, **choices[name]}, constants=constants[name]
        )
        for name in names
    }
    result = {
        "rows": len(data),
        "preset": preset,
        "mean": take_mean,
        "choices": choices,
        "set": constants,
        "ignored_columns": data.ignored,
        "notes": data.notes,
        "largest_contraction_mm": data.largest_contraction,
    }
    compare = _rank if fit else _compare
    options = {"criterion": criterion or "aicc", "folds": folds, "seed": seed or 0}
    more, text, found = compare(makes, muscle, data, out, **(options if fit else {}))
    result.update(more, muscle=describe_muscle(muscle))
    emit(result, as_json=as_json, text=note_data(data) + text)
    if not found:
        run_exit(EXIT_NEGATIVE)


_Answer = tuple[dict[str, Any], str, bool]


def _compare(
    makes: Mapping[str, Callable[[Muscle], StaticModel]],
    muscle: Muscle,
    data: Measurements,
    out: Path | None,
) -> _Answer:
    """Compare the models as they are; return result, text, and whether there is an answer."""
    from ..errors import BozziniError
    from ..muscle import compare_models

    models: dict[str, StaticModel] = {}
    refusals: dict[str, str] = {}
    for name, make in makes.items():
        try:
            models[name] = make(muscle)
        except BozziniError as error:
            refusals[name] = str(error)
    comparison = compare_models(models, data, refusals=refusals)
    written = out if comparison.scores else None
    if written is not None:
        from ..view import write_figure
        from ..view.muscle_figures import draw_models

        write_figure(draw_models(comparison, models), written)
    result = {
        "models": [{**_describe_score(score), "fitted": {}} for score in comparison.scores],
        "refusals": comparison.refusals,
        "file": written,
    }
    return result, comparison.format_table(), bool(comparison.scores)


def _rank(
    makes: Mapping[str, Callable[[Muscle], StaticModel]],
    muscle: Muscle,
    data: Measurements,
    out: Path | None,
    **options: Any,
) -> _Answer:
    """Fit the models and rank them; return result, text, and whether there is an answer."""
    from ..muscle import rank_models

    with progress_bar() as progress:
        ranking = rank_models(muscle, data, models=makes, progress=progress, **options)
    written = out if ranking.models else None
    if written is not None:
        from ..view import write_figure
        from ..view.ranking_figures import draw_ranking

        write_figure(draw_ranking(ranking), written)
    result = {
        "ranked_by": ranking.criterion,
        "folds": ranking.folds,
        "seed": ranking.seed,
        "models": [_describe_ranked(entry) for entry in ranking.models],
        "refusals": ranking.refusals,
        "notes": ranking.notes,
        "file": written,
    }
    lines = [ranking.format_table()]
    for entry in ranking.models[:_WARNED]:
        found = entry.calibration
        if found is None:
            continue
        if not found.converged:
            lines.append(f"{entry.name}: not converged: {found.reason}")
        lines += [f"{entry.name}: warning: {text}" for text in found.warnings]
    return result, "\n".join(lines), bool(ranking.models)


def _describe_score(score: ModelScore) -> dict[str, Any]:
    return {
        "model": score.name,
        "standard_error_mm": score.standard_error,
        "standard_error_percent": score.standard_error_percent,
        "rmse_mm": score.rmse,
        "bias_mm": score.bias,
        "largest_error_mm": score.largest,
    }


def _describe_ranked(entry: RankedModel) -> dict[str, Any]:
    left_out = entry.validation
    result = {
        **_describe_score(entry.score),
        "aicc": entry.aicc,
        "bic": entry.bic,
        "weight": entry.weight,
        "parameters": entry.parameters,
        "left_out_mm": entry.validation_error,
        "left_out_reason": "" if left_out is None else left_out.reason,
        "left_out_not_converged": 0 if left_out is None else left_out.unsettled,
        "same_as": entry.same_as,
        "held": entry.held,
        "fitted": {},
    }
    found = entry.calibration
    if found is not None:
        result |= {
            "fitted": found.estimates,
            "fit_warnings": found.warnings,
            "fit_converged": found.converged,
            "fit_reason": found.reason,
        }
    return result
