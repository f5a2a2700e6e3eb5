"""``bozzini muscle fit``: fields of a muscle from measurements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ._muscle_constants import find_card, parse_constant, parse_settings, set_option
from ._muscle_data import (
    check_friction,
    data_argument,
    mean_option,
    note_data,
    read_data,
    units_option,
)
from ._muscle_options import (
    FIELDS,
    check_fields,
    describe_choices,
    describe_muscle,
    design_options,
    make_class,
    make_muscle,
    model_option,
    model_options,
    unit_of,
)
from ._tables import PICTURES, check_target
from .common import EXIT_NEGATIVE, emit, force_option, json_option, run_exit

if TYPE_CHECKING:
    from ..muscle.calibration import Calibration
    from ..muscle.models import Parameter

__all__ = ["fit_command"]


@click.command("fit")
@data_argument
@model_option
@click.option(
    "--free",
    help="Fields of the muscle and constants of the model to fit, separated by commas; the options "
    "below are where fields start (default: modulus,dead-length in energy, modulus,end-length in "
    "thesis, in others what is unknown of them).",
)
@click.option(
    "--bound",
    "bound_texts",
    multiple=True,
    metavar="FIELD=LOW:HIGH",
    help="Bounds of a field that is fitted, e.g. modulus=0.1MPa:2MPa; can be repeated.",
)
@click.option("--anyway", is_flag=True, help="Fit also what the data cannot tell apart.")
@units_option
@mean_option
@set_option
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="A picture.")
@design_options
@model_options
@force_option
@json_option
def fit_command(
    source: Path,
    model_name: str,
    free: str | None,
    bound_texts: tuple[str, ...],
    anyway: bool,
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
    """Fit fields of a muscle, and constants of a model, to measurements.

    DATA is a .csv or .parquet file, see 'bozzini muscle compare --help'.

    Exit code 0: fitted, and nothing speaks against the estimates; 1: fitted, but with warnings,
    or no minimum was found; 2: bad input.
    """
    from ..muscle import calibrate, compare_models

    check_target(out, PICTURES, force=force)
    muscle = make_muscle(preset, fields)
    check_fields([model_name], fields)
    constants = parse_settings([model_name], settings)[model_name]
    make = make_class(model_name, ends=ends, load_path=load_path, constants=constants)
    own = _list_constants(model_name)
    bounds = _parse_bounds(bound_texts, own)
    data = read_data(source, muscle, units, take_mean)
    names = None if free is None else tuple(_name_field(part) for part in free.split(","))
    check_friction(fields, data, free=names or ())
    found = calibrate(make, muscle, data, free=names, bounds=bounds, force=anyway)
    if out is not None:
        from ..view import write_figure
        from ..view.muscle_figures import draw_models

        models = {model_name: found.fitted}
        comparison = compare_models(models, data, fitted={model_name: len(found.free)})
        write_figure(draw_models(comparison, models), out)
    result = {
        "model": model_name,
        "preset": preset,
        **describe_choices(found.fitted),
        "set": constants,
        "held": found.held,
        "mean": take_mean,
        "anyway": anyway,
        "bounds": bounds,
        "rows": len(data),
        "ignored_columns": data.ignored,
        "notes": data.notes,
        "estimates": {
            name: {
                "value": found.estimates[name],
                "unit": _find_unit(name, own),
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
    emit(result, as_json=as_json, text=note_data(data) + _format_fit(found, own))
    if not found.trusted:
        run_exit(EXIT_NEGATIVE)


def _name_field(text: str) -> str:
    return text.strip().replace("-", "_")


def _list_constants(name: str) -> dict[str, Parameter]:
    card = find_card(name)
    return {} if card is None else {item.name: item for item in card.parameters}


def _find_unit(name: str, own: dict[str, Parameter]) -> str:
    return own[name].unit if name in own else unit_of(name)


def _parse_bounds(
    texts: tuple[str, ...], own: dict[str, Parameter]
) -> dict[str, tuple[float, float]]:
    from ..errors import InputError
    from ..units import parse_quantity

    bounds: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, _, pair = text.partition("=")
        field = _name_field(name)
        ends = pair.split(":")
        if (field not in FIELDS and field not in own) or len(ends) != 2:
            raise InputError(
                f"--bound is '{text}': it must be FIELD=LOW:HIGH, such as modulus=0.1MPa:2MPa"
            )
        if field in bounds:
            raise InputError(f"--bound names {name.strip()} more than once: give it once")
        if field in own:
            bounds[field] = (
                parse_constant(own[field], ends[0]),
                parse_constant(own[field], ends[1]),
            )
            continue
        kind = FIELDS[field][0]
        bounds[field] = (parse_quantity(ends[0], kind), parse_quantity(ends[1], kind))
    return bounds


def _format_fit(found: Calibration, own: dict[str, Parameter]) -> str:
    lines = []
    wide = max(16, *(len(name) + 1 for name in found.free))
    for name in found.free:
        low, high = found.intervals[name]
        lines.append(
            f"{name:<{wide}}{found.estimates[name]:10.4g} {_find_unit(name, own):<4} "
            f"95 %: {low:.4g} to {high:.4g}"
        )
    lines.append(
        f"residuals {found.sigma:.3g} mm, condition {found.condition:.1f}; "
        f"{'converged' if found.converged else 'not converged'}: {found.reason}"
    )
    lines += [f"{name}: {reason}" for name, reason in found.held.items()]
    return "\n".join([*lines, *(f"warning: {text}" for text in found.warnings)])
