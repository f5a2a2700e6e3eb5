"""``bozzini plan``: from a scan or a surface to the motion of a scope, with a report."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..motion.planners import PLANNERS
from ._tract_options import (
    choose_scope,
    count_notes,
    describe_robot,
    read_robot,
    read_with_options,
    scope_options,
    tell_findings,
    tract_options,
)
from .common import (
    EXIT_NEGATIVE,
    QuantityType,
    emit,
    force_option,
    json_option,
    progress_bar,
    quiet_option,
    run_exit,
)

if TYPE_CHECKING:
    from ..anatomy.tract import LabelTract, SurfaceTract
    from ..study import InsertionStudy

__all__ = ["command", "write_result"]

ROUTES = {"in": (1.0,), "in-out": (1.0, 0.0), "in-out-in": (1.0, 0.0, 1.0)}
"""What ``--route`` means: fractions of the way that the head goes to in turn."""


@click.command(name="plan")
@click.argument("source", metavar="INPUT", type=click.Path(path_type=Path))
@tract_options
@scope_options
@click.option(
    "--length", type=QuantityType("length"), help="Length of the scope (default: the tract's)."
)
@click.option(
    "--head-step",
    type=QuantityType("length"),
    default="0.25mm",
    show_default=True,
    help="How far the head moves per step.",
)
@click.option(
    "--method",
    type=click.Choice(tuple(PLANNERS)),
    default="best",
    show_default=True,
    help="The planner: best (of the next two and some between), tube (whole body, proved), follow "
    "(the leader), thesis (joints only).",
)
@click.option(
    "--slip",
    type=QuantityType("dimensionless"),
    default="0",
    show_default=True,
    help="0: tails are pulled; 1: they move like the head (thesis App. C).",
)
@click.option(
    "--angle-limit", type=QuantityType("angle"), help="Largest angle between links, e.g. 45deg."
)
@click.option(
    "--route",
    type=click.Choice(["in", "in-out", "in-out-in"]),
    default="in",
    show_default=True,
    help="Advance only, or also retract, or go in again.",
)
@click.option(
    "--soft-wall",
    type=QuantityType("length"),
    default="0mm",
    show_default=True,
    help="The body may displace the wall by up to this; the report names the places.",
)
@click.option(
    "--label-error",
    type=QuantityType("length"),
    help="How far the given wall may be from the true one; exit code 1 if the proof does not "
    "cover it.",
)
@click.option(
    "--export",
    is_flag=True,
    help="Also write the distance field and the lumen as NIfTI volumes.",
)
@click.option("--largest", is_flag=True, help="Also find the largest diameter and longest link.")
@click.option("--compare", is_flag=True, help="Also plan by the other methods, side by side.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default="bozzini-plan",
    show_default=True,
    help="Directory for plan, report, scene and summary.",
)
@force_option
@json_option
@quiet_option
def command(
    source: Path,
    robot: Path | None,
    diameter: float | None,
    link: float | None,
    length: float | None,
    head_step: float,
    method: str,
    slip: float,
    angle_limit: float | None,
    route: str,
    soft_wall: float,
    label_error: float | None,
    export: bool,
    largest: bool,
    compare: bool,
    out: Path,
    force: bool,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Plan how a scope moves through the lumen in INPUT.

    INPUT is a label volume (.nii, .nii.gz, .nrrd, .nhdr, .mha, .mhd, or a folder of masks) or a
    surface (.stl, .ply, .obj, .off, .glb, .vtk, .vtp). Lengths take units (5mm, 0.5cm). The organ
    decides which end is the entry: a colon is entered from its lower end, other organs from the
    higher one; of an unknown organ both ends are tried. With --robot the motion of a tendon robot
    is made too: tendons.csv is the time table of its drives. Exit code 0: it fits; 1: it does not,
    or that is not proved, and the report names the place; 2: bad input.
    """
    from ..io.files import reserve_directory

    click.get_current_context().with_resource(reserve_directory(out, force=force))
    machine = read_robot(robot)
    scope = choose_scope(machine, diameter=diameter, link=link, length=length)
    from ..study import run_insertion
    from ..study.inputs import check_options

    motion: dict[str, Any] = {
        "scope": scope,
        "method": method,
        "head_step": head_step,
        "slip": slip,
        "angle_limit": angle_limit,
        "route": ROUTES[route],
        "soft_wall": soft_wall,
        "label_error": label_error,
    }
    check_options(**motion, voxel=options["voxel"], inflate=options["inflate"] or 0.0)
    begin = time.perf_counter()
    tract, ways = read_with_options(source, options, quiet=quiet)
    seconds = {"read": time.perf_counter() - begin}
    with progress_bar(quiet=quiet) as progress:
        study = run_insertion(
            tract,
            largest=largest,
            compare=compare,
            robot=machine,
            inputs=_describe_input(source, tract, options),
            seconds=seconds,
            progress=progress,
            **motion,
            **ways,
        )
    tell_findings(study.findings[len(tract.findings) :])
    count_notes(study.findings, "the report")
    write_result(study, out, force=force, export=export, as_json=as_json, quiet=quiet)


def _describe_input(
    source: Path, tract: LabelTract | SurfaceTract, options: dict[str, Any]
) -> dict[str, Any]:
    """Return what the input was read with: enough to read it again, by `read_tract`."""
    from ..anatomy.read import hash_input

    labels, parts = options["labels"], options["part"]
    return {
        "file": source.name,
        "sha256": hash_input(source),
        "labels": list(labels) if labels else None,
        "part": (parts[0] if len(parts) == 1 else list(parts)) if parts else None,
        "unit": options["unit"],
        "frame": options["frame"],
        "repair": options["repair"],
        "organ": tract.organ,
        "voxel_mm": options["voxel"],
        "inflate_mm": options["inflate"] or 0.0,
    }


def write_result(
    study: InsertionStudy,
    out: Path,
    *,
    force: bool,
    as_json: bool,
    quiet: bool,
    export: bool = False,
) -> None:
    """Write the files of a plan and its summary, and end with the exit code that it says."""
    with progress_bar(quiet=quiet) as progress:
        summary = study.write(out, force=force, export=export, progress=progress)
    emit(summary, as_json=as_json, text=_describe_result(study, summary, out))
    if not study.fits:
        run_exit(EXIT_NEGATIVE)


def _describe_result(study: InsertionStudy, summary: dict[str, Any], out: Path) -> str:
    """Return the result as text for people: the verdict, where the files are."""
    from ..report.verdict import judge_plan

    verdict = judge_plan(study.plan, summary, error=summary["clearance_error_mm"])
    lines = [f"{verdict.label}. {verdict.sentence}", *verdict.notes]
    if not summary["certified"] and summary["clearance_min_mm"] is not None:
        lines.append(
            f"Clearance is estimated to within {summary['clearance_error_mm']:.2f} mm of the "
            f"{summary['wall']}; it is not proved."
        )
    if study.largest is not None:
        found = study.largest
        lines.append(
            f"Largest found: diameter {found.diameter:.2f} mm with links of "
            f"{found.link_tested:g} mm; links of {found.link:.2f} mm at diameter "
            f"{found.diameter_tested:g} mm."
        )
    for item in summary.get("comparison", ()):
        proved = item["clearance_certified_mm"]
        bound = "-" if proved is None else f"{proved:.2f} mm"
        lines.append(
            f"  {item['method']:<7}{item['status']:<9} at {item['inserted_mm']:6.1f} mm of its "
            f"head path, clearance {bound} proved, joints move up to "
            f"{item['joint_step_ratio_max']:.2f} x head"
        )
    if study.robot is not None:
        lines += describe_robot(study.robot, out)
    lines.append(f"Report: {out / 'report.html'}")
    lines.append(f"Animated scene: {out / 'scene.glb'} (Blender, any glTF viewer)")
    return "\n".join(lines)
