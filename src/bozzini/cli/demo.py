"""``bozzini demo``: the main job on a phantom tract that the package makes itself."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import click

from ._tract_options import choose_scope, count_notes, read_robot, scope_options, tell_findings
from .common import (
    QuantityType,
    force_option,
    json_option,
    progress_bar,
    quiet_option,
)
from .plan import write_result

__all__ = ["command"]


@click.command(name="demo")
@click.option("--seed", default=0, show_default=True, help="Another number, another anatomy.")
@scope_options
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
    from ..io.files import reserve_directory

    click.get_current_context().with_resource(reserve_directory(out, force=force))
    machine = read_robot(robot)
    scope = choose_scope(machine, diameter=diameter, link=link)
    with progress_bar(quiet=quiet) as progress:
        progress("phantom", 0.0)
        from ..anatomy.phantom import REGIONS, make_phantom
        from ..study import run_insertion

        begin = time.perf_counter()
        tract = make_phantom(seed=seed).to_labels(voxel=voxel)
        tract = replace(tract, organ="upper-tract", frame="RAS", label_names=REGIONS)
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
    count_notes(study.findings, "the report")
    write_result(study, out, force=force, as_json=as_json, quiet=quiet)
