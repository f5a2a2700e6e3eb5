"""``bozzini continuum``: displacements to shape and back; comparison and workspace are beside."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ._continuum_compare import compare_command
from ._continuum_options import (
    MODEL_NAMES,
    choose_model,
    describe_robot,
    displacement_option,
    make_consistent,
    make_model,
    model_options,
    parse_displacements,
    read_parallel_robot,
    read_robot,
    robot_argument,
)
from ._continuum_space import workspace_command
from ._continuum_text import (
    describe_shape,
    find_fault,
    format_bends,
    format_shape,
    list_bends,
)
from ._tables import PICTURES, check_target, format_csv, format_rows
from .common import EXIT_NEGATIVE, VectorType, emit, force_option, json_option, run_exit

if TYPE_CHECKING:
    from ..continuum import ContinuumRobot, Shape
    from ..continuum.inverse import InverseResult

__all__ = ["command"]


@click.group("continuum")
def command() -> None:
    """Bend a tendon-driven continuum robot: pose, reach, comparison of models, workspace."""


@command.command("pose")
@robot_argument
@displacement_option
@click.option(
    "--model",
    "model_name",
    type=click.Choice(MODEL_NAMES),
    help="By default arc for parallel tendons, energy for others, rod under loads.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A picture, or the backbone as a table (.csv).",
)
@model_options
@force_option
@json_option
def pose_command(
    robot_file: Path,
    displacement: str,
    model_name: str | None,
    out: Path | None,
    given: Mapping[str, Any],
    force: bool,
    as_json: bool,
) -> None:
    """Find the shape of a robot under tendon displacements.

    Exit code 0: there is one; 1: there is none, which tendon or section stops it and by how much
    is said, and nothing is written; 2: bad input.
    """
    from ..errors import GeometryError

    check_target(out, (".csv", *PICTURES), force=force)
    robot = read_robot(robot_file)
    displacements, notes = make_consistent(robot, parse_displacements(robot, displacement), given)
    name = choose_model(robot, given) if model_name is None else model_name
    model = make_model(name, robot, given)
    result: dict[str, Any] = {"model": name, "robot": describe_robot(robot), "file": None}
    result["notes"] = [*notes, *getattr(model, "notes", ())]
    shape = None
    try:
        shape = model.shape(displacements)
        reason = find_fault(shape)
    except GeometryError as error:  # a linkage that does not exist
        reason = str(error)
    result |= describe_shape(robot, displacements, shape, reason)
    if reason or shape is None:
        emit(result, as_json=as_json, text=f"no shape by the {name} model: {reason}")
        run_exit(EXIT_NEGATIVE)
    if out is not None:
        _write_shape(shape, out)
        result["file"] = out
    lines = [f"{name}: {format_shape(shape)}", *(f"note: {line}" for line in result["notes"])]
    emit(result, as_json=as_json, text="\n".join(lines))


@command.command("reach")
@robot_argument
@click.option(
    "--to",
    "target",
    type=VectorType("length"),
    required=True,
    metavar="X,Y,Z",
    help="Where the tip shall be, seen from the base, such as 30mm,10mm,80mm.",
)
@click.option(
    "--direction",
    type=VectorType("dimensionless"),
    metavar="X,Y,Z",
    help="Where it shall look, of any length.",
)
@click.option("--starts", default=16, show_default=True, help="Starts that may be tried.")
@click.option(
    "--smallest-bends", is_flag=True, help="Use the freedom that is left for small bends."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A picture, or the displacements as a table (.csv).",
)
@force_option
@json_option
def reach_command(
    robot_file: Path,
    target: tuple[float, ...],
    direction: tuple[float, ...] | None,
    starts: int,
    smallest_bends: bool,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Find the tendon displacements that bring the tip to a place.

    The sections are arcs; the tendons have to be parallel to the backbone.

    Exit code 0: reached; 1: not reached, the nearest that was found and the reason are said; 2:
    bad input.
    """
    from ..continuum.inverse import solve_tip

    check_target(out, (".csv", *PICTURES), force=force)
    robot = read_parallel_robot(robot_file, "reach")
    found = solve_tip(
        robot, target, direction=direction, starts=starts, smallest_bends=smallest_bends
    )
    reason = found.reason
    needed = _needed_length(robot, target) if not found.success else None
    if needed is not None:
        reason += f"; a section of {needed:.6g} mm would reach it"
    if out is not None and found.success:
        _write_reach(robot, found, target, direction, out)
    result = {
        "target_mm": target,
        "direction": direction,
        "success": found.success,
        "converged": found.converged,
        "reason": reason,
        "tip_mm": found.tip,
        "tip_direction": found.tip_frame[:3, 2],
        "residual_mm": found.residual,
        "angle_rad": found.angle,
        "iterations": found.iterations,
        "starts": found.starts,
        "at_limits": list(found.at_limits),
        "needed_length_mm": needed,
        "sections": list_bends(robot, found.bends),
        "displacements_mm": dict(
            zip(robot.tendon_names, found.displacements.tolist(), strict=True)
        ),
        "robot": describe_robot(robot),
        "file": out if found.success else None,
    }
    emit(result, as_json=as_json, text=_format_reach(robot, found, reason))
    if not found.success:
        run_exit(EXIT_NEGATIVE)


for _command in (compare_command, workspace_command):
    command.add_command(_command)


def _needed_length(robot: ContinuumRobot, target: tuple[float, ...]) -> float | None:
    """Return the length of the one section that would reach a place, where that is the matter."""
    from ..continuum.section_inverse import solve_section

    if len(robot.sections) != 1:
        return None
    section = robot.sections[0]
    alone = solve_section(section.length, target)
    if alone.success or not math.isfinite(alone.needed_length):
        return None
    return alone.needed_length


def _write_shape(shape: Shape, out: Path) -> None:
    from ..files import write_text

    if out.suffix.lower() == ".csv":
        columns = {"arc_length_mm": shape.arc_length}
        columns |= {f"{axis}_mm": shape.points[:, k] for k, axis in enumerate("xyz")}
        columns |= {f"tangent_{axis}": shape.frames[:, k, 2] for k, axis in enumerate("xyz")}
        write_text(out, format_csv(columns))
        return
    from ..view import write_figure
    from ..view.continuum_figures import draw_shape

    write_figure(draw_shape(shape), out)


def _write_reach(
    robot: ContinuumRobot,
    found: InverseResult,
    target: tuple[float, ...],
    direction: tuple[float, ...] | None,
    out: Path,
) -> None:
    from ..continuum import ArcModel
    from ..files import write_text

    if out.suffix.lower() == ".csv":
        columns = {"tendon": robot.tendon_names, "displacement_mm": found.displacements}
        write_text(out, format_csv(columns))
        return
    from ..view import write_figure
    from ..view.continuum_figures import draw_shape

    shape = ArcModel(robot, between=3).shape(found.displacements)
    write_figure(draw_shape(shape, target=target, direction=direction), out)


def _format_reach(robot: ContinuumRobot, found: InverseResult, reason: str) -> str:
    place = ", ".join(f"{value:z.3f}" for value in found.tip)
    head = f"reached: tip at {place} mm, {found.iterations} iterations in {found.starts} start(s)"
    if not found.success:
        head = f"not reached: {reason}\nnearest: tip at {place} mm"
    moved = [
        [name, f"{value:z.4f}"]
        for name, value in zip(robot.tendon_names, found.displacements, strict=True)
    ]
    return "\n".join(
        [
            head,
            format_bends(robot, found.bends),
            format_rows(["tendon", "displacement [mm]"], moved),
            *([f"limit: {line}" for line in found.at_limits] if found.success else []),
        ]
    )
