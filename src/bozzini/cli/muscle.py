"""``bozzini muscle``: solve a muscle, compute its curves; compare, fit and models are beside."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ._muscle_compare import compare_command
from ._muscle_constants import describe_constants, parse_settings, set_option
from ._muscle_fit import fit_command
from ._muscle_models import models_command
from ._muscle_options import (
    check_direction,
    check_fields,
    describe_choices,
    describe_muscle,
    design_options,
    direction_option,
    make_class,
    make_muscle,
    model_option,
    model_options,
)
from ._tables import PICTURES, check_target, format_csv
from .common import EXIT_NEGATIVE, QuantityType, emit, force_option, json_option, run_exit

if TYPE_CHECKING:
    from ..muscle.model import StaticModel

__all__ = ["command"]


@click.group("muscle")
def command() -> None:
    """Solve a pneumatic muscle, list its models, and fit them to measurements."""


@command.command("solve")
@model_option
@click.option("--pressure", type=QuantityType("pressure"), required=True, help="Gauge pressure.")
@click.option(
    "--load", type=QuantityType("force"), default="0N", show_default=True, help="Tension held."
)
@direction_option
@set_option
@design_options
@model_options
@json_option
def solve_command(
    model_name: str,
    pressure: float,
    load: float,
    direction: str | None,
    settings: tuple[str, ...],
    preset: str,
    ends: str | None,
    load_path: str | None,
    as_json: bool,
    **fields: float | None,
) -> None:
    """Find the contraction of a muscle at a pressure and a load.

    Exit code 0: solved; 1: no solution was found; 2: bad input.
    """
    muscle = make_muscle(preset, fields)
    check_fields([model_name], fields)
    constants = parse_settings([model_name], settings)[model_name]
    make = make_class(model_name, ends=ends, load_path=load_path, constants=constants)
    model = make(muscle)
    check_direction(model, direction, fields, pressure=pressure)
    state = model.solve(pressure, load, direction=direction)
    band = float(model.dead_band())
    result = {
        "model": model_name,
        "preset": preset,
        "pressure_MPa": pressure,
        "load_N": load,
        "direction": direction,
        **describe_choices(model),
        "constants": describe_constants(model),
        "contraction_mm": _one(state.contraction),
        "length_mm": _one(state.length),
        "braid_angle_rad": _one(state.braid_angle),
        "contact_pressure_MPa": _one(state.contact_pressure),
        "dead_band_MPa": band,
        "converged": bool(_one(state.converged)),
        "residual_N": _one(state.residual),
        "iterations": int(_one(state.iterations)),
        "reason": str(_one(state.reason)),
        "muscle": describe_muscle(muscle),
    }
    angle = math.degrees(result["braid_angle_rad"])
    text = (
        f"contraction {result['contraction_mm']:.4g} mm, length {result['length_mm']:.5g} mm, "
        f"braid angle {angle:.2f} deg, dead band {1e3 * band:.1f} kPa"
    )
    if not result["converged"]:
        text = f"no solution: {result['reason']}"
    emit(result, as_json=as_json, text=text)
    if not result["converged"]:
        run_exit(EXIT_NEGATIVE)


@command.command("curve")
@model_option
@click.option(
    "--of",
    "kind",
    type=click.Choice(["contraction", "force", "angle", "phases"]),
    default="contraction",
    show_default=True,
    help="What over what: contraction or angle over pressure, force over contraction.",
)
@click.option(
    "--pressure",
    type=QuantityType("pressure"),
    default="0.8MPa",
    show_default=True,
    help="Largest pressure; with --of force, the pressure.",
)
@click.option(
    "--load", type=QuantityType("force"), help="Tension held; not with --of force (default: 0N)."
)
@direction_option
@click.option("--points", type=int, help="Rows of the table (default: 41).")
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE", help="A table (.csv) or a picture."
)
@set_option
@design_options
@model_options
@force_option
@json_option
def curve_command(
    model_name: str,
    kind: str,
    pressure: float,
    load: float | None,
    direction: str | None,
    points: int | None,
    out: Path | None,
    settings: tuple[str, ...],
    preset: str,
    ends: str | None,
    load_path: str | None,
    force: bool,
    as_json: bool,
    **fields: float | None,
) -> None:
    """Compute a curve, as a table or a picture.

    The table goes to stdout, unless --out names a file. It begins without pressure, or at the
    lowest one at which the model holds the load.
    """
    from ..checks import check_integer, check_number
    from ..errors import InputError
    from ..files import write_text

    check_target(out, (".csv", *PICTURES), force=force)
    is_picture = out is not None and out.suffix.lower() in PICTURES
    if is_picture and points is not None:
        raise InputError("--points has no effect on a picture: leave it out, or write a .csv")
    if kind == "force" and load is not None:
        raise InputError("--load has no effect with --of force, which is over all loads")
    rows = check_integer("points", 41 if points is None else points, low=2, high=100_000)
    check_number("pressure", pressure, low=0.0, low_open=True, unit="MPa")
    muscle = make_muscle(preset, fields)
    check_fields([model_name], fields)
    constants = parse_settings([model_name], settings)[model_name]
    make = make_class(model_name, ends=ends, load_path=load_path, constants=constants)
    model = make(muscle)
    check_direction(model, direction, fields, pressure=pressure)
    held = 0.0 if load is None else load
    columns = _compute_curve(model, kind, pressure, held, direction, rows)
    table = format_csv(columns)
    text = table.rstrip("\n")
    if out is not None:
        text = f"{out}: {kind}, {rows} points"
        if is_picture:
            text = f"{out}: {kind}"
            _draw_curve(model, kind, pressure, held, direction, out)
        else:
            write_text(out, table)
    result = {
        "model": model_name,
        "preset": preset,
        "of": kind,
        "pressure_MPa": pressure,
        "load_N": None if kind == "force" else held,
        "direction": direction,
        **describe_choices(model),
        "constants": describe_constants(model),
        "dead_band_MPa": float(model.dead_band()),
        "file": out,
        "columns": columns,
        "muscle": describe_muscle(muscle),
    }
    emit(result, as_json=as_json, text=text)


command.add_command(compare_command)
command.add_command(fit_command)
command.add_command(models_command)


def _compute_curve(
    model: StaticModel,
    kind: str,
    pressure: float,
    load: float,
    direction: str | None,
    points: int,
) -> dict[str, Any]:
    import numpy as np

    from ..errors import InputError

    if kind == "force":
        free = float(model.contraction(pressure, 0.0, direction=direction))
        if not free > 0.0:
            raise InputError(
                f"pressure is {pressure:g} MPa: with --of force it must be more, so that the "
                f"muscle contracts (its dead band ends at {model.dead_band():g} MPa)"
            )
        over = np.linspace(0.0, free, points)
        return {
            "contraction_mm": over,
            "force_N": model.force(pressure, over, direction=direction),
            "stiffness_N_per_mm": model.stiffness(pressure, over, direction=direction),
        }
    over = np.linspace(_find_lowest(model, pressure, load, direction), pressure, points)
    state = model.solve(over, load, direction=direction)
    columns = {
        "pressure_MPa": over,
        "contraction_mm": state.contraction,
        "braid_angle_rad": state.braid_angle,
    }
    if kind == "phases":
        columns["contact_pressure_MPa"] = state.contact_pressure
    return columns


def _find_lowest(model: StaticModel, pressure: float, load: float, direction: str | None) -> float:
    """Return the lowest pressure from which on, up to one, a model has an answer [MPa].

    Found by bisection: of models that have none somewhere in between, that is not reported.

    Raises
    ------
    InputError
        If it has none at the highest one.
    """
    from ..errors import InputError
    from ..muscle.models import CatalogueModel

    if not isinstance(model, CatalogueModel):
        return 0.0
    model.solve(pressure, load, direction=direction)

    def answers(at: float) -> bool:
        try:
            return bool(model.try_contraction(at, load, direction=direction)[1])
        except InputError:
            return False

    low, high = model.pressure_limits[0], pressure
    if answers(low):
        return low
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if answers(middle) else (middle, high)
    return high


def _draw_curve(
    model: StaticModel, kind: str, pressure: float, load: float, direction: str | None, out: Path
) -> None:
    from ..view import muscle_figures as figures
    from ..view import write_figure

    models = {model.name: model}
    if kind == "force":
        figure = figures.draw_force(model, [pressure], direction=direction)
        write_figure(figure, out)
        return
    options: dict[str, Any] = {"pressure": pressure, "load": load, "direction": direction}
    options["lowest"] = _find_lowest(model, pressure, load, direction)
    if kind == "angle":
        figure = figures.draw_braid_angle(models, **options)
    elif kind == "phases":
        figure = figures.draw_phases(model, **options)
    else:
        figure = figures.draw_contraction(models, **options)
    write_figure(figure, out)


def _one(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else value
