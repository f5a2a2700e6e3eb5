"""Directories of files to make a robot's body or an end-effector's holders from."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..checks import describe_fields
from ..io.files import new_directory, write_bytes, write_text
from ..io.sheets import write_table
from ..results import Json, to_plain
from .effector import HolderOptions, build_holders, draw_template
from .part import Part
from .robot import BodyOptions, build_body, tabulate_routing
from .step import check_step, write_step

if TYPE_CHECKING:
    from ..continuum import RobotDesign
    from ..effector import EffectorDesign


def write_body(
    robot: RobotDesign,
    directory: str | os.PathLike[str],
    *,
    options: BodyOptions | None = None,
    step: bool = False,
    force: bool = False,
) -> Json:
    """Write what a tendon robot's body is made from, and return the summary.

    The directory holds an STL of each part, ``routing.csv``, ``routing.png`` and ``summary.json``.

    Parameters
    ----------
    robot : RobotDesign
    directory : path-like
    options : BodyOptions, optional
    step : bool
        Also write each part as STEP; needs the extra ``cad``.
    force : bool
        Replace a result that exists.

    Raises
    ------
    GeometryError
        If the robot cannot be made so, see `build_body`.
    MissingExtraError
        If STEP is asked for without the extra ``cad``.
    OutputError
        If the directory cannot be written.
    """
    from matplotlib.figure import Figure

    given = options or BodyOptions()
    if step:
        check_step()
    with new_directory(directory, force=force) as folder:
        parts = build_body(robot, given)
        routing = tabulate_routing(robot)
        figure = Figure(figsize=(8.0, 4.2), layout="constrained")
        routing.plot(figure.add_subplot())
        write_table(folder / "routing.csv", routing.list_table(), digits=9)
        figure.savefig(folder / "routing.png", dpi=150.0)
        described = _write_parts(folder, parts, wall=given.wall, step=step)
        return _write_summary(
            folder,
            {
                "robot": robot.name,
                "form": given.form,
                "options": describe_fields(given),
                "parts": described,
                "tendons": routing.to_dict(),
            },
        )


def write_holders(
    design: EffectorDesign,
    directory: str | os.PathLike[str],
    *,
    options: HolderOptions | None = None,
    step: bool = False,
    force: bool = False,
) -> Json:
    """Write what an end-effector's holders and fittings are made from, and return the summary.

    The directory holds an STL of each part, ``template.svg`` and ``summary.json``.

    Parameters
    ----------
    design : EffectorDesign
    directory : path-like
    options : HolderOptions, optional
    step : bool
        Also write each part as STEP; needs the extra ``cad``.
    force : bool
        Replace a result that exists.

    Raises
    ------
    InputError, GeometryError
        If the parts cannot be made so, see `build_holders`.
    MissingExtraError
        If STEP is asked for without the extra ``cad``.
    OutputError
        If the directory cannot be written.
    """
    given = options or HolderOptions()
    if step:
        check_step()
    with new_directory(directory, force=force) as folder:
        parts = build_holders(design, given)
        write_text(folder / "template.svg", draw_template(design))
        described = _write_parts(folder, parts, wall=given.wall, step=step)
        summary = {
            "design": design.to_dict(),
            "options": describe_fields(given),
            "parts": described,
        }
        return _write_summary(folder, summary)


def _write_parts(folder: Path, parts: Sequence[Part], *, wall: float, step: bool) -> list[Json]:
    from trimesh.exchange.stl import export_stl

    rows = []
    for part in parts:
        mesh = part.mesh(wall)
        write_bytes(folder / f"{part.name}.stl", export_stl(mesh))
        if step:
            write_step(part, folder / f"{part.name}.step")
        rows.append({**part.to_dict(), "facets": len(mesh.faces), "mesh_volume_mm3": mesh.volume})
    return rows


def _write_summary(folder: Path, summary: Json) -> Json:
    files = sorted([*(file.name for file in folder.iterdir()), "summary.json"])
    plain: Json = to_plain({"files": files, **summary})
    write_text(folder / "summary.json", f"{json.dumps(plain, indent=2, allow_nan=False)}\n")
    return plain
