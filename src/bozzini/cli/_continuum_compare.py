"""``bozzini continuum compare``: all models on one robot."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import GeometryError
from ._continuum_options import (
    LOADS,
    MODEL_NAMES,
    describe_robot,
    displacement_option,
    make_consistent,
    make_model,
    model_options,
    parse_displacements,
    read_robot,
    robot_argument,
)
from ._continuum_text import find_fault
from ._tables import PICTURES, check_target, format_csv, format_rows
from .common import EXIT_NEGATIVE, emit, force_option, json_option, run_exit

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..continuum import ContinuumRobot, Shape

__all__ = ["compare_command"]

REFERENCE = "rod"
LONGEST = 0.3
"""Time spent on measuring the time of one model [s]."""
MOST_RUNS = 25


@click.command("compare")
@robot_argument
@displacement_option
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A picture of the backbones over each other, or the table (.csv).",
)
@model_options
@force_option
@json_option
def compare_command(
    robot_file: Path,
    displacement: str,
    out: Path | None,
    given: Mapping[str, Any],
    force: bool,
    as_json: bool,
) -> None:
    """Compare all models on one robot under one set of displacements.

    Tips are compared with that of the rod, the reference. Loads go to the rod alone: the others
    have none. Times are of one call after the first, the median of several.

    Exit code 0: every model that takes this robot has a shape; 1: one has none, and why is said;
    2: bad input.
    """
    check_target(out, (".csv", *PICTURES), force=force)
    robot = read_robot(robot_file)
    displacements, notes = make_consistent(robot, parse_displacements(robot, displacement), given)
    shapes: dict[str, Shape] = {}
    rows = {name: _try_model(name, robot, displacements, given, shapes) for name in MODEL_NAMES}
    if all(row["refused"] for row in rows.values()):
        raise GeometryError(str(rows[REFERENCE]["reason"]))
    _add_differences(rows, shapes)
    loads = [name for name in LOADS if given[name] is not None]
    if loads:
        notes.append("only the rod bears the load: the others are without")
    if given["tendon_stiffness"] is not None:
        notes.append("tendons stretch in the energy and the rod model only")
    missing = [name for name, row in rows.items() if row["reason"] and not row["refused"]]
    result: dict[str, Any] = {
        "displacements_mm": dict(zip(robot.tendon_names, displacements.tolist(), strict=True)),
        "reference": REFERENCE if REFERENCE in shapes else None,
        "models": rows,
        "notes": notes,
        "robot": describe_robot(robot),
        "file": None,
    }
    if out is not None and shapes:
        _write(rows, shapes, out)
        result["file"] = out
    text = "\n".join([_format(robot, rows), *(f"note: {line}" for line in notes)])
    emit(result, as_json=as_json, text=text)
    if missing:
        run_exit(EXIT_NEGATIVE)


def _try_model(
    name: str,
    robot: ContinuumRobot,
    displacements: NDArray[np.float64],
    given: Mapping[str, Any],
    shapes: dict[str, Shape],
) -> dict[str, Any]:
    """Return what a model says as plain values, and put its shape, if any, in `shapes`."""
    row: dict[str, Any] = {"refused": False, "converged": False, "reason": ""}
    try:
        model = make_model(name, robot, given, strict=False)
    except GeometryError as error:  # it does not take such a robot at all
        return row | {"refused": True, "reason": str(error)}
    try:
        shape = model.shape(displacements)
    except GeometryError as error:
        return row | {"reason": str(error)}
    reason = find_fault(shape)
    if reason:
        return row | {"reason": reason}
    shapes[name] = shape
    runs: list[float] = []
    begin = time.perf_counter()
    while not runs or (len(runs) < MOST_RUNS and time.perf_counter() - begin < LONGEST):
        start = time.perf_counter()
        model.shape(displacements)
        runs.append(time.perf_counter() - start)
    names = robot.tendon_names
    return row | {
        "converged": True,
        "tip_mm": shape.tip.tolist(),
        "tip_direction": shape.tip_frame[:3, 2].tolist(),
        "time_s": statistics.median(runs),
        "residual_mm": float(shape.residual),
        "iterations": int(shape.iterations),
        "tensions_N": dict(zip(names, shape.tensions.tolist(), strict=True))
        if shape.tensions.size
        else None,
        "slack": [name for name, loose in zip(names, shape.slack, strict=True) if loose],
    }


def _add_differences(rows: Mapping[str, dict[str, Any]], shapes: Mapping[str, Shape]) -> None:
    """Add to each row how far its tip is from the reference's, and how far it looks aside."""
    import numpy as np

    for name, row in rows.items():
        row["tip_from_rod_mm"] = row["direction_from_rod_rad"] = None
        if name in shapes and REFERENCE in shapes:
            ours, theirs = shapes[name].tip_frame, shapes[REFERENCE].tip_frame
            row["tip_from_rod_mm"] = float(np.linalg.norm(ours[:3, 3] - theirs[:3, 3]))
            aside = float(np.linalg.norm(np.cross(ours[:3, 2], theirs[:3, 2])))
            row["direction_from_rod_rad"] = math.atan2(aside, float(ours[:3, 2] @ theirs[:3, 2]))


def _write(rows: Mapping[str, dict[str, Any]], shapes: Mapping[str, Shape], out: Path) -> None:
    from ..files import write_text

    if out.suffix.lower() != ".csv":
        from ..view import write_figure
        from ..view.continuum_figures import draw_comparison

        reference = REFERENCE if REFERENCE in shapes else None
        write_figure(draw_comparison(shapes, reference=reference), out)
        return
    fields = ("tip_from_rod_mm", "direction_from_rod_rad", "time_s", "residual_mm", "iterations")
    table: dict[str, list[Any]] = {"model": list(shapes)}
    for k, axis in enumerate("xyz"):
        table[f"tip_{axis}_mm"] = [rows[name]["tip_mm"][k] for name in shapes]
    for field in fields:
        values = [rows[name][field] for name in shapes]
        table[field] = ["" if value is None else value for value in values]
    write_text(out, format_csv(table))


def _format(robot: ContinuumRobot, rows: Mapping[str, dict[str, Any]]) -> str:
    head = ["model", "tip [mm]", "from the rod [mm]", "[deg]", "time [ms]", "residual [mm]"]
    head.append("iterations")
    lines, told = [], []
    for name, row in rows.items():
        if not row["converged"]:
            told.append(f"{name}: {'refused' if row['refused'] else 'no shape'}: {row['reason']}")
            continue
        off, aside = row["tip_from_rod_mm"], row["direction_from_rod_rad"]
        lines.append(
            [
                name,
                ", ".join(f"{value:z.3f}" for value in row["tip_mm"]),
                "-" if off is None else f"{off:.4f}",
                "-" if aside is None else f"{math.degrees(aside):.4f}",
                f"{1e3 * row['time_s']:.3g}",
                f"{row['residual_mm']:.1e}",
                f"{row['iterations']}",
            ]
        )
    text = [format_rows(head, lines)] if lines else []
    pulled = [name for name, row in rows.items() if row["converged"] and row["tensions_N"]]
    if pulled:
        table = [
            [
                tendon,
                *(
                    "slack" if tendon in rows[name]["slack"] else f"{value:z.4f}"
                    for name in pulled
                    for value in [rows[name]["tensions_N"][tendon]]
                ),
            ]
            for tendon in robot.tendon_names
        ]
        text.append(format_rows(["tension [N]", *pulled], table))
    return "\n".join([*text, *told])
