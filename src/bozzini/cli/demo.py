"""``bozzini demo``: the main job on a phantom tract that the package makes itself."""

from __future__ import annotations

import time
from pathlib import Path

import click

from ._robot_options import choose_scope, read_robot, robot_option
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
from .plan import describe_result, tell_findings

__all__ = ["command"]


@click.command(name="demo")
@click.option("--seed", default=0, show_default=True, help="Another number, another anatomy.")
@robot_option
@click.option("--diameter", type=QuantityType("length"), help="[default: 9mm, or the robot's]")
@click.option(
    "--link",
    type=QuantityType("length"),
    help="[default: 10mm, or half the robot's shortest section]",
)
@click.option("--voxel", type=QuantityType("length"), default="1.5mm", show_default=True)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default="bozzini-demo",
    show_default=True,
    help="Directory for plan, report, scene and summary.",
)
@force_option
@json_option
@quiet_option
def command(
    seed: int,
    robot: Path | None,
    diameter: float | None,
    link: float | None,
    voxel: float,
    out: Path,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Move an endoscope through a phantom oesophagus, stomach and duodenum."""
    from ..files import check_new_directory

    check_new_directory(out, force=force)
    machine = read_robot(robot)
    scope = choose_scope(machine, diameter=diameter, link=link)
    with progress_bar(quiet=quiet) as progress:
        progress("phantom", 0.0)
        from ..anatomy import make_phantom
        from ..study import run_insertion

        begin = time.perf_counter()
        tract = make_phantom(seed=seed).to_labels(voxel=voxel)
        seconds = {"phantom": time.perf_counter() - begin}
    tell_findings(tract.findings)
    with progress_bar(quiet=quiet) as progress:
        study = run_insertion(
            tract,
            scope=scope,
            robot=machine,
            inputs={"file": "phantom", "seed": seed, "voxel_mm": voxel},
            seconds=seconds,
            progress=progress,
        )
    tell_findings(study.findings[len(tract.findings) :])
    with progress_bar(quiet=quiet) as progress:
        summary = study.write(out, force=force, progress=progress)
    emit(summary, as_json=as_json, text=describe_result(study, summary, out))
    if not study.fits:
        run_exit(EXIT_NEGATIVE)
