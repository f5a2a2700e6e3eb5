"""``bozzini demo``: the main job on a phantom tract that the package makes itself."""

from __future__ import annotations

import time
from pathlib import Path

import click

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
@click.option("--diameter", type=QuantityType("length"), default="9mm", show_default=True)
@click.option("--link", type=QuantityType("length"), default="10mm", show_default=True)
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
    diameter: float,
    link: float,
    voxel: float,
    out: Path,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Move an endoscope through a phantom oesophagus, stomach and duodenum."""
    from ..files import check_new_directory
    from ..motion import Scope

    check_new_directory(out, force=force)
    scope = Scope(diameter=diameter, link_length=link)
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
