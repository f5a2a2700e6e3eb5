"""``bozzini plan``: from a scan or a surface to the motion of a scope, with a report."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ._robot_options import choose_scope, describe_robot, read_robot, robot_option
from .common import (
    EXIT_NEGATIVE,
    LabelsType,
    QuantityType,
    emit,
    force_option,
    json_option,
    progress_bar,
    quiet_option,
    run_exit,
)

if TYPE_CHECKING:
    from ..anatomy.findings import Finding
    from ..study import InsertionStudy

__all__ = ["command", "describe_result", "tell_findings"]

ROUTES = {"in": (1.0,), "in-out": (1.0, 0.0), "in-out-in": (1.0, 0.0, 1.0)}
"""What ``--route`` means: fractions of the way that the head goes to in turn."""


class EndType(click.ParamType):  # type: ignore[type-arg]
    """An end of the centreline: ``x,y,z`` with units, or the number of a label."""

    name = "x,y,z|label"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...] | int:
        """Return a label as int, or a point as a tuple in mm."""
        from ..errors import BozziniError
        from ..units import parse_vector

        if not isinstance(value, str):
            return value  # type: ignore[no-any-return]
        if value.strip().isascii() and value.strip().isdigit():
            return int(value)
        try:
            return parse_vector(value, "length")
        except BozziniError as error:
            self.fail(f"{error} (or give one label number)", param, ctx)


@click.command(name="plan")
@click.argument("source", metavar="INPUT", type=click.Path(path_type=Path))
@click.option("--labels", type=LabelsType(), help="Labels that are lumen: 1,2,3 (default: all).")
@click.option("--unit", default="mm", show_default=True, help="Unit of a surface file.")
@click.option("--voxel", type=QuantityType("length"), help="Grid of the distance field.")
@click.option(
    "--inflate",
    type=QuantityType("length"),
    default="0mm",
    show_default=True,
    help="Move the wall outwards, as insufflation does.",
)
@click.option("--start", type=EndType(), help="Where the scope enters: a point or a label.")
@click.option("--end", type=EndType(), help="Where it goes: a point or a label.")
@click.option("--reverse", is_flag=True, help="Enter at the other end.")
@robot_option
@click.option(
    "--diameter",
    type=QuantityType("length"),
    help="Outer diameter of the scope.  [default: 9mm, or the robot's]",
)
@click.option(
    "--link",
    type=QuantityType("length"),
    help="Length of a rigid link.  [default: 10mm, or half the robot's shortest section]",
)
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
    default="tube",
    show_default=True,
    help="The planner: tube (whole body, proved), follow (the leader), thesis (joints only).",
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
    help="The body may displace the wall by up to this; the report says where.",
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
    labels: tuple[int, ...] | None,
    unit: str,
    voxel: float | None,
    inflate: float,
    start: tuple[float, ...] | int | None,
    end: tuple[float, ...] | int | None,
    reverse: bool,
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
    largest: bool,
    compare: bool,
    out: Path,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Plan how a scope moves through the lumen in INPUT.

    INPUT is a label volume (.nii, .nii.gz) or a surface (.stl, .ply, .obj, .glb). Lengths take
    units (5mm, 0.5cm). With --robot the motion of a tendon robot is made too: tendons.csv tells its
    drives. Exit code 0: it fits; 1: it does not, and the report says where; 2: bad input.
    """
    from ..files import check_new_directory

    check_new_directory(out, force=force)
    machine = read_robot(robot)
    scope = choose_scope(machine, diameter=diameter, link=link, length=length)
    with progress_bar(quiet=quiet) as progress:
        progress("read", 0.0)
        from ..anatomy import read_tract
        from ..study import run_insertion

        begin = time.perf_counter()
        tract = read_tract(source, labels=labels, unit=unit)
        seconds = {"read": time.perf_counter() - begin}
    # Told at once, not with the result: a later stage may fail just because of them.
    tell_findings(tract.findings)
    with progress_bar(quiet=quiet) as progress:
        study = run_insertion(
            tract,
            scope=scope,
            start=start,
            end=end,
            reverse=reverse,
            voxel=voxel,
            inflate=inflate,
            method=method,
            head_step=head_step,
            slip=slip,
            angle_limit=angle_limit,
            route=ROUTES[route],
            soft_wall=soft_wall,
            largest=largest,
            compare=compare,
            robot=machine,
            inputs=_describe_input(source, labels, unit, voxel),
            seconds=seconds,
            progress=progress,
        )
    tell_findings(study.findings[len(tract.findings) :])
    with progress_bar(quiet=quiet) as progress:
        summary = study.write(out, force=force, progress=progress)
    emit(summary, as_json=as_json, text=describe_result(study, summary, out))
    if not study.fits:
        run_exit(EXIT_NEGATIVE)


def _describe_input(
    source: Path, labels: tuple[int, ...] | None, unit: str, voxel: float | None
) -> dict[str, Any]:
    return {
        "file": source.name,
        "sha256": hashlib.sha256(source.read_bytes()).hexdigest(),
        "labels": list(labels) if labels else None,
        "unit": unit,
        "voxel_mm": voxel,
    }


def tell_findings(findings: Sequence[Finding]) -> None:
    """Write what the checks found on stderr, a line each."""
    for item in findings:
        click.echo(f"bozzini: {item.severity}: {' '.join(item.message.split())}", err=True)


def describe_result(study: InsertionStudy, summary: dict[str, Any], out: Path) -> str:
    """Return the result as text for people: the verdict, where the files are."""
    from ..view.verdict import judge_plan

    verdict = judge_plan(study.plan, summary, error=summary["clearance_error_mm"])
    lines = [f"{verdict.label}. {verdict.sentence}"]
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
        lines.append(
            f"  {item['method']:<7}{item['status']:<9} at {item['inserted_mm']:6.1f} mm, clearance "
            f"{'-' if proved is None else f'{proved:.2f} mm'} proved, joints move up to "
            f"{item['joint_step_ratio_max']:.2f} x head"
        )
    if study.robot is not None:
        lines += describe_robot(study.robot, out)
    lines.append(f"Report: {out / 'report.html'}")
    lines.append(f"Animated scene: {out / 'scene.glb'} (Blender, any glTF viewer)")
    return "\n".join(lines)
