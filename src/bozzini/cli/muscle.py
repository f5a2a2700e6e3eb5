"""``bozzini muscle``: solve a muscle, compute its curves; compare and fit are beside."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ._muscle_data import compare_command, fit_command
from ._muscle_options import (
    PICTURES,
    check_target,
    describe_muscle,
    design_options,
    make_class,
    make_muscle,
    model_option,
    model_options,
)
from .common import EXIT_NEGATIVE, QuantityType, emit, force_option, json_option, run_exit

if TYPE_CHECKING:
    from ..muscle.model import MuscleModel

__all__ = ["command"]


@click.group("muscle")
def command() -> None:
    """Solve a pneumatic muscle, draw its curves, and fit models to measurements."""


@command.command("solve")
@model_option
@click.option("--pressure", type=QuantityType("pressure"), required=True, help="Gauge pressure.")
@click.option(
    "--load", type=QuantityType("force"), default="0N", show_default=True, help="Tension held."
)
@click.option(
    "--direction",
    type=click.Choice(["inflating", "deflating"]),
    help="Which way it came, for friction (default: neither).",
)
@design_options
@model_options
@json_option
def solve_command(
    model_name: str,
    pressure: float,
    load: float,
    direction: str | None,
    preset: str,
    ends: str,
    load_path: str,
    as_json: bool,
    **fields: float | None,
) -> None:
    """Find the contraction of a muscle at a pressure and a load.

    Exit code 0: solved; 1: no solution was found; 2: bad input.
    """
    muscle = make_muscle(preset, fields)
    model = make_class(model_name, ends=ends, load_path=load_path)(muscle)
    state = model.solve(pressure, load, direction=direction)
    band = float(model.dead_band())
    result = {
        "model": model_name,
        "preset": preset,
        "pressure_MPa": pressure,
        "load_N": load,
        "contraction_mm": _one(state.contraction),
        "length_mm": _one(state.length),
        "braid_angle_rad": _one(state.braid_angle),
        "contact_pressure_MPa": _one(state.contact_pressure),
        "dead_band_MPa": band,
        "converged": bool(_one(state.converged)),
        "residual": _one(state.residual),
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
    "--load", type=QuantityType("force"), default="0N", show_default=True, help="Tension held."
)
@click.option("--points", default=41, show_default=True, help="Rows of the table.")
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE", help="A table (.csv) or a picture."
)
@design_options
@model_options
@force_option
@json_option
def curve_command(
    model_name: str,
    kind: str,
    pressure: float,
    load: float,
    points: int,
    out: Path | None,
    preset: str,
    ends: str,
    load_path: str,
    force: bool,
    as_json: bool,
    **fields: float | None,
) -> None:
    """Compute a curve, as a table or a picture.

    The table goes to stdout, unless --out names a file.
    """
    from ..checks import check_integer
    from ..files import write_text

    check_target(out, (".csv", *PICTURES), force=force)
    check_integer("points", points, low=2, high=100_000)
    muscle = make_muscle(preset, fields)
    model = make_class(model_name, ends=ends, load_path=load_path)(muscle)
    columns = _compute_curve(model, kind, pressure, load, points)
    table = _format_csv(columns)
    text = table.rstrip("\n")
    if out is not None:
        text = f"{out}: {kind}, {points} points"
        if out.suffix.lower() == ".csv":
            write_text(out, table)
        else:
            _draw_curve(model, kind, pressure, load, out)
    result = {
        "model": model_name,
        "preset": preset,
        "of": kind,
        "load_N": load,
        "dead_band_MPa": float(model.dead_band()),
        "file": out,
        "columns": columns,
        "muscle": describe_muscle(muscle),
    }
    emit(result, as_json=as_json, text=text)


command.add_command(compare_command)
command.add_command(fit_command)


def _compute_curve(
    model: MuscleModel, kind: str, pressure: float, load: float, points: int
) -> dict[str, Any]:
    import numpy as np

    if kind == "force":
        free = max(0.0, float(model.free_contraction(pressure)))
        over = np.linspace(0.0, free, points)
        return {
            "contraction_mm": over,
            "force_N": model.force(pressure, over),
            "stiffness_N_per_mm": model.stiffness(pressure, over),
        }
    over = np.linspace(0.0, pressure, points)
    state = model.solve(over, load)
    return {
        "pressure_MPa": over,
        "contraction_mm": state.contraction,
        "braid_angle_rad": state.braid_angle,
    }


def _draw_curve(model: MuscleModel, kind: str, pressure: float, load: float, out: Path) -> None:
    from ..view import muscle_figures as figures
    from ..view import write_figure

    if kind == "force":
        figure = figures.draw_force(model, [0.25 * k * pressure for k in (1, 2, 3, 4)])
    elif kind == "angle":
        figure = figures.draw_braid_angle({model.name: model}, pressure=pressure, load=load)
    elif kind == "phases":
        figure = figures.draw_phases(model, pressure=pressure, load=load)
    else:
        figure = figures.draw_contraction({model.name: model}, pressure=pressure, load=load)
    write_figure(figure, out)


def _format_csv(columns: Mapping[str, Any]) -> str:
    rows = [",".join(columns)]
    for values in zip(*columns.values(), strict=True):
        rows.append(",".join(f"{float(value):.9g}" for value in values))
    return "\n".join(rows) + "\n"


def _one(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else value
