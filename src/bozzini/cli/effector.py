"""``bozzini effector``: pressures to pose and back; traces, workspace and studies are beside."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError
from ._effector_options import describe_design, effector_options, make_effector, parse_pairs, tell
from ._effector_space import curve_command, workspace_command
from ._effector_study import study_command
from ._effector_trace import trace_command
from ._tables import PICTURES, check_target, format_csv, format_rows
from .common import EXIT_NEGATIVE, VectorType, force_option, json_option, run_exit

if TYPE_CHECKING:
    from ..effector import Balance, Effector, EffectorPose

__all__ = ["command"]

SHOWN = 15
"""Rows of an iteration table that are shown to people; the files and --json have all."""
ON_AXIS = 5e-4
"""Deflection that is shown as none [mm]: it has no direction to speak of."""


@click.group("effector")
def command() -> None:
    """Bend a catheter tip by pneumatic muscles: pose, reach, workspace, traces, studies."""


@command.command("pose")
@click.option(
    "--pressure",
    required=True,
    metavar="NAME=PRESSURE,...",
    help="Gauge pressures, such as R=689.4kPa,G=413.6kPa; muscles left out have none.",
)
@click.option(
    "--method",
    type=click.Choice(["superposition", "thesis"]),
    default="superposition",
    show_default=True,
    help="How several muscles add up.",
)
@click.option(
    "--order",
    metavar="NAME,NAME",
    help="With --method thesis: which muscle is pressed first; by default as in the design.",
)
@click.option(
    "--table", "with_table", is_flag=True, help="The thesis's iteration of each muscle alone."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A picture, or the backbone as a table (.csv). With --table the picture or table of that.",
)
@effector_options
@force_option
@json_option
def pose_command(
    pressure: str,
    method: str,
    order: str | None,
    with_table: bool,
    out: Path | None,
    given: Mapping[str, Any],
    force: bool,
    as_json: bool,
) -> None:
    """Find where the tip goes under given pressures.

    Exit code 0: solved; 1: not solved, or the muscles demand more than the backbone can bend;
    2: bad input.
    """
    from ..effector import pose

    check_target(out, (".csv", *PICTURES), force=force)
    effector = make_effector(given)
    names = effector.design.names
    pressures = parse_pairs(
        "--pressure", pressure, "pressure", names=names, example="R=689.4kPa,G=413.6kPa"
    )
    names_in_order = None if order is None else [word.strip() for word in order.split(",")]
    found = pose(effector, pressures, method=method, order=names_in_order)
    tables, notes = _iterate(effector, pressures) if with_table else ({}, {})
    if with_table and out is not None and not tables:
        raise InputError(f"--table has nothing to write into {out}: {'; '.join(notes.values())}")
    if out is not None:
        _write_pose(effector, found, tables, out)
    result = {
        "method": method,
        "model": given["model_name"],
        "tip_mm": found.tip,
        "holder_tip_mm": found.holder_tip,
        "direction": found.direction,
        "lateral_mm": found.lateral,
        "lateral_vector_mm": found.lateral_vector,
        "azimuth_rad": found.azimuth,
        "demanded_lateral_mm": found.demanded_lateral,
        "saturated": bool(found.saturated),
        "converged": bool(found.converged),
        "reason": str(found.reason),
        "length_error_mm": found.length_error,
        "muscles": {
            name: {
                "pressure_MPa": found.pressures[k],
                "contraction_mm": found.contraction[k],
                "force_N": found.force[k],
                "iterations": found.iterations[k],
            }
            for k, name in enumerate(names)
        },
        "design": describe_design(effector.design),
        "file": out,
    }
    if with_table:
        result["tables"] = {name: _list_rows(table) for name, table in tables.items()}
        result["tables_converged"] = {
            name: name in tables and bool(tables[name].converged)
            for name, value in pressures.items()
            if value > 0.0
        }
    text = _format_pose(effector, found)
    for name, table in tables.items():
        text += f"\n\n{_format_table(name, pressures[name], table)}"
    tell(result, as_json=as_json, text=text, notes=list(notes.values()))
    if bool(found.saturated) or not bool(found.converged):
        run_exit(EXIT_NEGATIVE)


@command.command("reach")
@click.option(
    "--to",
    "target",
    type=VectorType("length", size=2),
    required=True,
    metavar="X,Y",
    help="Where the tip shall be, seen along the axis, such as 12mm,-5mm.",
)
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="A picture.")
@effector_options
@force_option
@json_option
def reach_command(
    target: tuple[float, ...],
    out: Path | None,
    given: Mapping[str, Any],
    force: bool,
    as_json: bool,
) -> None:
    """Find the pressures that bring the tip to a place seen along the axis.

    A target out of reach is answered by the farthest place in its direction.

    Exit code 0: reached; 1: out of reach, what is delivered instead is said; 2: bad input.
    """
    from ..effector import pose, solve_inverse

    check_target(out, PICTURES, force=force)
    effector = make_effector(given)
    names = effector.design.names
    found = solve_inverse(effector, target)
    posed = pose(effector, found.pressures)
    if out is not None:
        from ..effector import workspace
        from ..view import write_figure
        from ..view.effector_figures import draw_pose

        write_figure(draw_pose(effector, posed, workspace=workspace(effector), target=target), out)
    result = {
        "target_mm": target,
        "reachable": bool(found.reachable),
        "delivered_mm": found.delivered,
        "reason": str(found.reason),
        "converged": bool(found.converged),
        "residual_mm": found.residual,
        "iterations": found.iterations,
        "tip_mm": posed.tip,
        "holder_tip_mm": posed.holder_tip,
        "muscles": {
            name: {
                "pressure_MPa": found.pressures[k],
                "displacement_mm": found.displacements[k],
                "contraction_mm": found.contraction[k],
                "force_N": found.force[k],
            }
            for k, name in enumerate(names)
        },
        "model": given["model_name"],
        "design": describe_design(effector.design),
        "file": out,
    }
    rows = [
        [
            name,
            f"{1e3 * float(found.pressures[k]):.2f}",
            f"{float(found.displacements[k]):.3f}",
            f"{float(found.contraction[k]):.3f}",
            f"{float(found.force[k]):.3f}",
        ]
        for k, name in enumerate(names)
    ]
    head = ["muscle", "pressure [kPa]", "displacement [mm]", "contraction [mm]", "force [N]"]
    text = format_rows(head, rows)
    x, y = (float(value) for value in found.delivered)
    if not bool(found.converged):
        text = f"not solved: {found.reason}\n{text}"
    elif bool(found.reachable):
        text = f"reached: tip at {x:.3f}, {y:.3f} mm\n{text}"
    else:
        wanted = f"{target[0]:g}, {target[1]:g} mm"
        text = f"out of reach: {wanted}; delivered {x:.3f}, {y:.3f} mm: {found.reason}\n{text}"
    tell(result, as_json=as_json, text=text)
    if not (bool(found.reachable) and bool(found.converged)):
        run_exit(EXIT_NEGATIVE)


for _command in (workspace_command, curve_command, trace_command, study_command):
    command.add_command(_command)


def _iterate(
    effector: Effector, pressures: Mapping[str, float]
) -> tuple[dict[str, Balance], dict[str, str]]:
    """Return the thesis's iteration of every muscle under pressure, or why there is none."""
    from ..effector import balance

    tables: dict[str, Balance] = {}
    notes: dict[str, str] = {}
    for name, value in pressures.items():
        if value > 0.0:
            try:
                tables[name] = balance(effector, name, value, method="fixed-point")
            except InputError as error:  # the pose has its own root, which this does not touch
                notes[name] = f"no table, {error}"
    if not (tables or notes):
        notes[""] = "no table, no muscle is under pressure"
    return tables, notes


def _write_pose(
    effector: Effector, found: EffectorPose, tables: Mapping[str, Balance], out: Path
) -> None:
    from ..files import write_text

    if out.suffix.lower() == ".csv":
        if tables:
            rows = [
                (name, *row.values()) for name, table in tables.items() for row in _list_rows(table)
            ]
            head = ("muscle", "force_N", "contraction_mm", "lateral_mm", "next_force_N")
            write_text(out, format_csv(dict(zip(head, zip(*rows, strict=True), strict=True))))
            return
        line = found.backbone
        write_text(out, format_csv({"x_mm": line[:, 0], "y_mm": line[:, 1], "z_mm": line[:, 2]}))
        return
    from ..view import effector_figures as figures
    from ..view import write_figure

    if tables:
        write_figure(figures.draw_iteration(tables), out)
    else:
        from ..effector import workspace

        write_figure(figures.draw_pose(effector, found, workspace=workspace(effector)), out)


def _list_rows(found: Balance) -> list[dict[str, float]]:
    names = ("force_N", "contraction_mm", "lateral_mm", "next_force_N")
    return [dict(zip(names, map(float, row), strict=False)) for row in found.table]


def _format_pose(effector: Effector, found: EffectorPose) -> str:
    x, y, z = (float(value) for value in found.tip)
    lateral, longer = float(found.lateral), float(found.length_error)
    azimuth = math.degrees(float(found.azimuth)) % 360.0
    where = f"{lateral:.3f} mm from the axis, towards {azimuth:.2f} deg"
    if lateral < ON_AXIS:
        x, y, where = 0.0, 0.0, "on the axis"
    lines = [f"tip at {x:.3f}, {y:.3f}, {z:.3f} mm: {where}"]
    if abs(longer) > 1e-6:
        word = "longer" if longer > 0.0 else "shorter"
        lines.append(f"the eight steps make the backbone {abs(longer):.3g} mm {word}")
    if str(found.reason):
        lines.append(str(found.reason))
    rows = [
        [
            name,
            f"{1e3 * float(found.pressures[k]):.1f}",
            f"{float(found.contraction[k]):.3f}",
            f"{float(found.force[k]):.3f}",
            f"{int(found.iterations[k])}",
        ]
        for k, name in enumerate(effector.design.names)
    ]
    head = ["muscle", "pressure [kPa]", "contraction [mm]", "force [N]", "iterations"]
    return "\n".join([*lines, format_rows(head, rows)])


def _format_table(name: str, pressure: float, found: Balance) -> str:
    rows = [[f"{value:.4f}" for value in row.values()] for row in _list_rows(found)]
    if len(rows) > SHOWN:
        rows = [*rows[: SHOWN - 2], ["..."] * 4, rows[-1]]
    head = ["F [N]", "contraction [mm]", "deflection [mm]", "F* [N]"]
    lines = [f"muscle {name} alone at {1e3 * pressure:.1f} kPa, {len(found.table)} rows"]
    lines.append(format_rows(head, rows))
    if str(found.reason):
        lines.append(f"note: {found.reason}")
    return "\n".join(lines)
