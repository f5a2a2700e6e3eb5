"""``bozzini continuum workspace``: where the tip gets, how freely, and the travel that it takes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError
from ._continuum_options import describe_robot, read_parallel_robot, robot_argument
from ._tables import PICTURES, check_target, format_csv, format_rows
from .common import (
    QuantityType,
    VectorType,
    emit,
    force_option,
    json_option,
    progress_bar,
    quiet_option,
)

if TYPE_CHECKING:
    from ..continuum.dexterity import DexterityMap

__all__ = ["workspace_command"]

FREEDOMS = 5
"""Of a place with a direction."""

CELLS = 30.0
"""Cells along the robot's length, where no size is asked for."""


@click.command("workspace")
@robot_argument
@click.option("--count", default=100_000, show_default=True, help="Shapes that are drawn.")
@click.option("--seed", default=0, show_default=True, help="Of the random numbers.")
@click.option(
    "--cell",
    type=QuantityType("length"),
    help="Edge of a cell of the map; by default a thirtieth of the robot's length.",
)
@click.option(
    "--bend-cap",
    type=QuantityType("angle"),
    default="180deg",
    show_default=True,
    help="Largest bend that is drawn where a section allows more.",
)
@click.option(
    "--in-space",
    is_flag=True,
    help="Map cubes; by default tips are turned about the base's axis into one half-plane.",
)
@click.option(
    "--at",
    "place",
    type=VectorType("length"),
    metavar="X,Y,Z",
    help="Also try in how many directions the tip can look from here, by the inverse.",
)
@click.option("--directions", default=100, show_default=True, help="Number of directions.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="The map as a table (.csv) or a picture.",
)
@quiet_option
@force_option
@json_option
def workspace_command(
    robot_file: Path,
    count: int,
    seed: int,
    cell: float | None,
    bend_cap: float,
    in_space: bool,
    place: tuple[float, ...] | None,
    directions: int,
    out: Path | None,
    quiet: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Draw shapes at random: the tip's workspace, its dexterity, and the tendon travel.

    The sections are arcs; the tendons have to be parallel to the backbone. Shapes are drawn
    evenly in the bends, within the limits of sections and tendons.
    """
    from ..continuum.dexterity import map_dexterity, measure_dexterity
    from ..continuum.workspace import measure_volume, sample_workspace, tendon_travel

    check_target(out, (".csv", *PICTURES), force=force)
    robot = read_parallel_robot(robot_file, "workspace")
    edge = robot.length / CELLS if cell is None else _check_cell(cell, robot.length)
    try:
        sample = sample_workspace(robot, count, seed=seed, bend_cap=bend_cap)
    except MemoryError:
        raise InputError(f"--count is {count}: not enough memory for so many shapes") from None
    volume = measure_volume(sample.tips, cell=edge)
    travel = tendon_travel(robot, sample.bends)
    dexterity = map_dexterity(sample, cell=edge, directions=directions, half_plane=not in_space)
    looked = None
    if place is not None:
        with progress_bar(quiet=quiet) as progress:
            looked = measure_dexterity(robot, place, directions=directions, progress=progress)
    if out is not None:
        _write(dexterity, robot.length, out)
    notes = []
    if place is not None and 2 * len(robot.sections) < FREEDOMS:
        notes.append(
            f"{len(robot.sections)} section(s) have {2 * len(robot.sections)} freedoms, a place "
            f"with a direction needs {FREEDOMS}: the directions at one place have no area"
        )
    best = int(dexterity.direction_share.argmax())
    result = {
        "count": count,
        "seed": seed,
        "reach_mm": volume.reach,
        "hull_mm3": volume.hull,
        "occupied_mm3": volume.occupied,
        "cell_mm": edge,
        "coverage": volume.coverage,
        "tendons": {
            name: {
                "low_mm": travel.low[k],
                "high_mm": travel.high[k],
                "stroke_mm": travel.stroke[k],
                "allowed_mm": travel.allowed[k],
            }
            for k, name in enumerate(travel.names)
        },
        "most_directions": {
            "place_mm": dexterity.centres[best],
            "share": dexterity.direction_share[best],
        },
        "directions_at": None
        if looked is None
        else {"place_mm": looked.place, "share": looked.share},
        "notes": notes,
        "map": _list_columns(dexterity),
        "manipulability_unit": f"mm^{dexterity.rank}/rad^{dexterity.rank}",
        "robot": describe_robot(robot),
        "file": out,
    }
    rows = [
        [name, f"{travel.low[k]:z.3f}", f"{travel.high[k]:z.3f}", f"{travel.stroke[k]:.3f}"]
        for k, name in enumerate(travel.names)
    ]
    x, _, z = dexterity.centres[best]
    lines = [
        f"tips up to {volume.reach:.2f} mm from the base, in a hull of {volume.hull:.4g} mm^3; "
        f"{volume.occupied:.4g} mm^3 in cells of {edge:.3g} mm",
        f"one more shape falls in a known cell in {100.0 * volume.coverage:.1f} % of the cases"
        + ("" if volume.coverage >= 0.9 else ": take more shapes or larger cells"),
    ]
    if not in_space:
        lines.append(
            f"most directions, {100.0 * float(dexterity.direction_share[best]):.0f} %, about "
            f"{x:z.1f} mm from the axis at z = {z:z.1f} mm"
        )
    if looked is not None:
        where = ", ".join(f"{value:zg}" for value in looked.place)
        share = 100.0 * looked.share
        lines.append(f"at {where} mm the tip can look in {share:.0f} % of the directions")
        lines += [f"note: {line}" for line in notes]
    head = ["tendon", "let out [mm]", "pulled [mm]", "stroke [mm]"]
    emit(result, as_json=as_json, text="\n".join([*lines, format_rows(head, rows)]))


def _check_cell(cell: float, length: float) -> float:
    from ..continuum.dexterity import check_cell

    try:
        return check_cell(cell, length)
    except InputError as error:
        raise InputError(f"--{error}") from None


def _list_columns(found: DexterityMap) -> dict[str, Any]:
    columns: dict[str, Any] = {
        "from_axis_mm" if found.half_plane else "x_mm": found.centres[:, 0],
        "y_mm": found.centres[:, 1],
        "z_mm": found.centres[:, 2],
        "tips": found.counts,
        "direction_share": found.direction_share,
        "manipulability": found.manipulability,
        "condition": found.condition,
    }
    if found.half_plane:
        del columns["y_mm"]
    return columns


def _write(found: DexterityMap, length: float, out: Path) -> None:
    from ..files import write_text

    if out.suffix.lower() == ".csv":
        write_text(out, format_csv(_list_columns(found)))
        return
    from ..view import write_figure
    from ..view.continuum_maps import draw_workspace

    write_figure(draw_workspace(found, length=length), out)
