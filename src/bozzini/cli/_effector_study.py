"""``bozzini effector study``: many designs side by side, and the one of least pressure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..checks import check_number
from ..errors import InputError
from ._effector_options import describe_design, effector_options, make_effector, tell
from ._effector_values import MOST, add_unit, parse_range, parse_segments, parse_values
from ._tables import PICTURES, check_target, format_csv, format_rows
from .common import (
    EXIT_NEGATIVE,
    QuantityType,
    force_option,
    json_option,
    progress_bar,
    quiet_option,
    run_exit,
)

if TYPE_CHECKING:
    from ..effector import Sweep, SweepRow

__all__ = ["study_command"]

deflection_option = click.option(
    "--deflection",
    type=QuantityType("length"),
    help="Deflection that every muscle alone must reach.",
)


@click.group("study")
def study_command() -> None:
    """Try many designs: sweep, least-pressure."""


@study_command.command("sweep")
@click.option(
    "--vary",
    "varied",
    multiple=True,
    required=True,
    metavar="NAME=VALUES",
    help="What to vary: LOW:HIGH:COUNT or values with commas, as offset=3mm:5mm:5, segments=12,15; "
    "for angles, sets of them: angles=0deg/120deg/240deg. Can be repeated.",
)
@deflection_option
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE", help="A table (.csv) or a picture."
)
@effector_options
@quiet_option
@force_option
@json_option
def sweep_command(
    varied: tuple[str, ...],
    deflection: float | None,
    out: Path | None,
    given: Mapping[str, Any],
    quiet: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Try every combination of some values; designs that do not work are listed with the reason.

    Exit code 0: at least one design works; 1: none does; 2: bad input.
    """
    from ..effector import sweep

    check_target(out, (".csv", *PICTURES), force=force)
    effector = make_effector(given)
    parameters: dict[str, Sequence[Any]] = {}
    for item in varied:
        name, values = parse_values(item)
        if name in parameters:
            raise InputError(f"--vary names '{name}' more than once: give it once, with all values")
        parameters[name] = values
    total = 1
    for choices in parameters.values():
        total *= len(choices)
    if total > MOST:
        raise InputError(f"--vary asks for {total} designs: at most {MOST} are tried at once")
    wanted = 0.0
    if deflection is not None:
        wanted = check_number("deflection", deflection, low=0.0, low_open=True, unit="mm")
    with progress_bar(quiet=quiet) as progress:
        found = sweep(effector, parameters, deflection=wanted, progress=progress)
    columns = _list_columns(found)
    if out is not None:
        _write_sweep(found, columns, out)
    result = {
        "parameters": found.parameters,
        "deflection_mm": found.deflection,
        "designs": len(found.rows),
        "feasible": len(found.feasible),
        "columns": columns,
        "model": given["model_name"],
        "design": describe_design(effector.design),
        "file": out,
    }
    text = f"{out}: {len(found.feasible)} of {len(found.rows)} designs work"
    if out is None:
        *others, reason = columns
        rows = zip(*(map(_format_value, columns[name]) for name in others), strict=True)
        lines = format_rows(others, [list(row) for row in rows]).splitlines()
        ends = [reason, *columns[reason]]
        text = "\n".join(f"{a}  {b}".rstrip() for a, b in zip(lines, ends, strict=True))
    tell(result, as_json=as_json, text=text)
    if not found.feasible:
        run_exit(EXIT_NEGATIVE)


@study_command.command("least-pressure")
@click.option(
    "--between",
    "ranges",
    multiple=True,
    required=True,
    metavar="NAME=LOW:HIGH",
    help="What may be changed, as offset=3mm:4.5mm; up to 4 times.",
)
@click.option(
    "--choose-segments", metavar="N,N,...", help="Numbers of segments to choose from, as 12,15,18."
)
@click.option(
    "--deflection",
    type=QuantityType("length"),
    required=True,
    help="Deflection that every muscle alone must reach.",
)
@effector_options
@quiet_option
@json_option
def least_command(
    ranges: tuple[str, ...],
    choose_segments: str | None,
    deflection: float,
    given: Mapping[str, Any],
    quiet: bool,
    as_json: bool,
) -> None:
    """Find the design that reaches a deflection with the least pressure.

    Exit code 0: found; 1: no design within the ranges reaches it; 2: bad input.
    """
    from ..effector import optimise_design

    effector = make_effector(given)
    bounds: dict[str, tuple[float, float]] = {}
    for item in ranges:
        name, low, high = parse_range(item)
        if name in bounds:
            raise InputError(f"--between names '{name}' more than once: give each once")
        bounds[name] = (low, high)
    numbers = None if choose_segments is None else parse_segments(choose_segments)
    with progress_bar(quiet=quiet) as progress:
        found = optimise_design(
            effector, deflection, bounds=bounds, segments=numbers, progress=progress
        )
    result = {
        "success": found.success,
        "reason": found.reason,
        "deflection_mm": found.deflection,
        "changes": {add_unit(name): value for name, value in found.changes.items()},
        "pressure_MPa": found.pressure,
        "pressure_before_MPa": found.pressure_before,
        "evaluations": found.evaluations,
        "infeasible": found.infeasible,
        "model": given["model_name"],
        "design": describe_design(found.effector.design),
    }
    told = ", ".join(f"{add_unit(name)} {value:.6g}" for name, value in found.changes.items())
    text = f"{1e3 * found.pressure:.2f} kPa with {told}"
    if found.pressure_before > 0.0:
        text += f"; before {1e3 * found.pressure_before:.2f} kPa"
    text += f"\nnote: {found.reason}" if found.reason else ""
    if not found.success:
        text = f"no design: {found.reason}"
    tell(result, as_json=as_json, text=text)
    if not found.success:
        run_exit(EXIT_NEGATIVE)


def _list_columns(found: Sweep) -> dict[str, list[Any]]:
    columns: dict[str, list[Any]] = {
        "angles_deg" if name == "angles" else add_unit(name): [
            _tell_angles(row.changes[name]) if name == "angles" else row.changes[name]
            for row in found.rows
        ]
        for name in found.parameters
    }
    columns |= {
        "feasible": [row.feasible for row in found.rows],
        "least_amplitude_mm": [_blank(row, row.least_amplitude) for row in found.rows],
        "largest_amplitude_mm": [_blank(row, row.largest_amplitude) for row in found.rows],
        "inner_radius_mm": [_blank(row, row.inner_radius) for row in found.rows],
        "area_mm2": [_blank(row, row.area) for row in found.rows],
    }
    if found.deflection > 0.0:
        # 0 is no pressure that anything needs: none reaches it.
        columns["needed_pressure_MPa"] = [row.needed_pressure or None for row in found.rows]
    columns["reason"] = [row.reason for row in found.rows]
    return columns


def _blank(row: SweepRow, value: float) -> float | None:
    """Return a number of a design, None if it cannot be built."""
    return value if row.built else None


def _tell_angles(angles: Sequence[float]) -> str:
    import math

    return "/".join(f"{math.degrees(angle):g}" for angle in angles)


def _format_value(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None:
        return "-"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _write_sweep(found: Sweep, columns: Mapping[str, Sequence[Any]], out: Path) -> None:
    from ..files import write_text
    from ..view import write_figure
    from ..view.effector_figures import draw_sweep

    if out.suffix.lower() == ".csv":
        write_text(out, format_csv(columns))
    else:
        write_figure(draw_sweep(found), out)
