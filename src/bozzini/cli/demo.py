"""``bozzini demo``: the main job on a phantom tract that the package makes itself."""

from __future__ import annotations

import time

import click

from ._tract_options import MovingBody, report_findings, report_study
from .common import (
    Answer,
    CheckedCommand,
    QuantityType,
    answer_options,
    options_of,
)
from .plan import reserve_target, write_result

__all__ = ["command"]


@click.command(name="demo", cls=CheckedCommand)
@click.option("--seed", default=0, show_default=True, help="Another number, another anatomy.")
@options_of(MovingBody, "body", leave_out=("length",))
@click.option("--voxel", type=QuantityType("length"), default="1.5mm", show_default=True)
@answer_options(
    default="bozzini-demo",
    show_default=True,
    metavar="DIRECTORY",
    help="Directory for plan, report, scene and summary.",
)
def command(seed: int, body: MovingBody, voxel: float, answer: Answer) -> None:
    """Move an endoscope through a phantom oesophagus, stomach and duodenum."""
    reserve_target(answer)
    scope = body.scope
    with answer.show_progress() as progress:
        progress("phantom", 0.0)
        from ..study import run_insertion
        from ..study.case import open_phantom

        begin = time.perf_counter()
        tract = open_phantom(seed=seed, voxel=voxel)
        seconds = {"phantom": time.perf_counter() - begin}
    report_findings(tract.findings)
    inputs = {"file": "phantom", "seed": seed, "voxel_mm": voxel}
    with answer.show_progress() as progress:
        study = run_insertion(tract, scope, robot=body.machine, inputs=inputs, progress=progress)
    report_study(study.findings, tract.findings, "the report")
    write_result(study, seconds, answer)
