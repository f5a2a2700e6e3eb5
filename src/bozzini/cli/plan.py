"""``bozzini plan``: from a scan or a surface to the motion of a scope, with a report."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..checks import ceil_mm, floor_mm, list_fields
from ..study.options import InsertionOptions, ReadOptions
from ._slicer import open_slicer, take_points
from ._tract_options import (
    PLAN_OPTIONS,
    MovingBody,
    format_actuation,
    read_with_options,
    report_study,
    tract_options,
)
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    Answer,
    CheckedCommand,
    answer_options,
    options_file,
    options_of,
    run_exit,
    spell_command,
)

if TYPE_CHECKING:
    from ..scene import SlicerLink
    from ..study import InsertionStudy

__all__ = ["command", "write_result"]


@click.command(name="plan", cls=CheckedCommand)
@click.argument("source", metavar="INPUT", type=INPUT)
@options_file(list_fields(*PLAN_OPTIONS), "bozzini new plan")
@tract_options
@options_of(MovingBody, "body")
@options_of(InsertionOptions, "options")
@click.option(
    "--export",
    is_flag=True,
    help="Also write the distance field and the lumen as NIfTI volumes.",
)
@answer_options(
    igtl=True,
    default="bozzini-plan",
    show_default=True,
    metavar="DIRECTORY",
    help="Directory for plan, report, scene and summary.",
)
def command(
    source: Path,
    reading: ReadOptions,
    body: MovingBody,
    options: InsertionOptions,
    export: bool,
    answer: Answer,
) -> None:
    """Plan how a scope moves through the lumen in INPUT.

    INPUT is a label volume (.nii, .nii.gz, .nrrd, .nhdr, .mha, .mhd, .dcm, or a folder of masks), a
    surface (.stl, .ply, .obj, .off, .glb, .3mf, .vtk, .vtp, .vtu), or shapes (.json, .yaml), of
    which triangles are made. Lengths take units (5mm, 0.5cm). The organ decides which end is the
    entry: a colon is entered from its lower end, other organs from the higher one; of an unknown
    organ both ends are tried. With --robot the motion of a tendon robot is made too: tendons.csv is
    the time table of its drives. Exit code 0: it fits; 1: it does not, or that is not proved, and
    the report names the place; 2: bad input.
    """
    link = open_slicer(answer)
    reserve_target(answer)
    options.check(body.scope)
    from ..study import run_insertion
    from ..study.case import describe_source

    begin = time.perf_counter()
    tract = read_with_options(source, reading, answer)
    seconds = {"read": time.perf_counter() - begin}
    if link is not None:
        link, options = take_points(link, tract, options)
    inputs = describe_source(source, reading, tract=tract, options=options)
    with answer.show_progress() as progress:
        study = run_insertion(
            tract, body.scope, options=options, robot=body.machine, inputs=inputs, progress=progress
        )
    report_study(study.findings, tract.findings, "the report")
    write_result(study, seconds, answer, export=export, link=link)


def reserve_target(answer: Answer) -> None:
    """Keep the name of the output from other processes until the command ends."""
    from ..io.files import reserve_directory

    lock = reserve_directory(answer.target, force=answer.force)
    click.get_current_context().with_resource(lock)


def write_result(
    study: InsertionStudy,
    seconds: dict[str, float],
    answer: Answer,
    *,
    export: bool = False,
    link: SlicerLink | None = None,
) -> None:
    """Write the files of a plan and its summary, and end with the exit code of its verdict.

    Before it ends the motion is played in 3D Slicer, if there is a link.
    """
    out = answer.target
    plan = replace(study.plan, more={**study.plan.more, "command": spell_command()})
    study = replace(study, plan=plan, seconds=seconds | study.seconds)
    with answer.show_progress() as progress:
        summary = study.write(out, force=answer.force, export=export, progress=progress)
    answer.give(summary, _describe_result(study, summary, out))
    if link is not None:
        from ..scene.scene import SceneOptions, prepare_tract

        wall = prepare_tract(study.find_surface(), max_faces=SceneOptions().max_faces)
        link.send_wall(wall.vertices, wall.faces)
        link.send_line(study.line.points)
        joints, radius = study.place_body()
        link.play(joints, radius=radius)
    if not study.fits:
        run_exit(EXIT_NEGATIVE)


def _describe_result(study: InsertionStudy, summary: dict[str, Any], out: Path) -> str:
    """Return the result as text for people: the verdict, where the files are."""
    verdict = study.verdict
    lines = [f"{verdict.label}. {verdict.sentence}", *verdict.notes]
    if not summary["certified"] and summary["clearance_min_mm"] is not None:
        lines.append(
            f"Clearance is estimated to within {ceil_mm(summary['clearance_error_mm'])} mm of the "
            f"{summary['wall']}; it is not proved."
        )
    if study.largest is not None:
        found = study.largest
        lines.append(
            f"Largest found: diameter {floor_mm(found.diameter)} mm with links of "
            f"{found.link_tested:g} mm; links of {floor_mm(found.link)} mm at diameter "
            f"{found.diameter_tested:g} mm."
        )
    for item in summary.get("comparison", ()):
        proved = item["clearance_certified_mm"]
        bound = "-" if proved is None else f"{floor_mm(proved)} mm"
        lines.append(
            f"  {item['method']:<7}{item['status']:<9} at {item['inserted_mm']:6.1f} mm of its "
            f"head path, clearance {bound} proved, joints move up to "
            f"{item['joint_step_ratio_max']:.2f} x head"
        )
    if study.robot is not None:
        lines += format_actuation(study.robot, out)
    lines.append(f"Report: {out / 'report.html'}")
    lines.append(f"Animated scene: {out / 'scene.glb'} (Blender, any glTF viewer)")
    return "\n".join(lines)
