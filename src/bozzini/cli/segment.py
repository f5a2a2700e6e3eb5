"""``bozzini segment``: the gas-filled lumen of a CT without labels."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .common import (
    INPUT,
    Answer,
    CheckedCommand,
    VectorType,
    answer_options,
)

if TYPE_CHECKING:
    from ..anatomy.segment import Segmentation

__all__ = ["command"]

LIMITS = (
    "Only gas is found: collapsed stretches, and fluid that is not bridged, are missing. The wall "
    "is where the image crosses the threshold. Compare the picture and the labels with the scan; "
    "this does not replace a segmentation tool."
)


@click.command("segment", cls=CheckedCommand)
@click.argument("source", metavar="CT", type=INPUT)
@click.option(
    "--threshold",
    type=click.FloatRange(-1000.0, -400.0),
    default=-800.0,
    show_default=True,
    help="Gas lies below it [HU].",
)
@click.option(
    "--seed",
    "seeds",
    type=VectorType("length"),
    multiple=True,
    help="Keep only the segment at this point; may be given several times.",
)
@click.option(
    "--bridge-fluid",
    is_flag=True,
    help="Add fluid with contrast medium that lies under a level of gas.",
)
@answer_options(
    required=True,
    help="Labels to write: .nii or .nii.gz; a picture (.png) is put beside it.",
)
def command(
    source: Path,
    threshold: float,
    seeds: tuple[tuple[float, ...], ...],
    bridge_fluid: bool,
    answer: Answer,
) -> None:
    """Find the gas-filled lumen in a CT without labels.

    CT is a NIfTI, NRRD or MetaImage file, or a folder with a DICOM series, in HU. Each connected
    body of gas inside the patient becomes a label, the largest first; lungs and the air outside
    are left out. Choose among them by --seed here, or by --labels in bozzini plan.
    """
    from ..anatomy.files import check_target, encode_volume
    from ..anatomy.segment import segment_gas
    from ..anatomy.volumes import read_volume
    from ..errors import InputError
    from ..io.files import check_new_file, write_atomically
    from ..plot.figures import write_figure
    from ..plot.fluoroscopy import draw_segmentation

    target, force = answer.target, answer.force
    if not target.name.lower().endswith((".nii", ".nii.gz")):
        raise InputError(f"{target}: labels are written as .nii or .nii.gz")
    check_target(target, force=force)
    picture = target.with_name(f"{target.name.removesuffix('.gz').removesuffix('.nii')}.png")
    check_new_file(picture, (".png",), force=force)
    with answer.show_progress() as progress:
        progress("read", 0.0)
        volume = read_volume(source)
        result = segment_gas(
            volume,
            threshold=threshold,
            seeds=list(seeds) if seeds else None,
            bridge_fluid=bridge_fluid,
            progress=progress,
        )
    for item in result.findings:
        click.echo(f"bozzini: {item.severity}: {item.message}", err=True)
    names = {item.label: f"gas {item.label}" for item in result.segments}
    labels = encode_volume(
        target, result.labels, affine=result.affine, frame=result.frame, names=names
    )
    drawing = draw_segmentation(volume, result)

    def write(temporary: Path) -> None:
        temporary.write_bytes(labels)
        # Before the labels get their name: no labels without their picture.
        write_figure(drawing, picture)

    write_atomically(target, write)
    found = {"file": str(target), "picture": str(picture), **result.to_dict(), "limits": LIMITS}
    answer.give(found, _describe(result, target, picture))


def _describe(result: Segmentation, target: Path, picture: Path) -> str:
    number = len(result.segments)
    lines = [f"{number} {'segment' if number == 1 else 'segments'} of gas in {result.source}:"]
    for item in result.segments[:20]:
        place = ", ".join(f"{value:.0f}" for value in item.point)
        line = f"  label {item.label}: {item.volume / 1000.0:.1f} mL near ({place}) mm"
        if item.fluid:
            line += f", of it {item.fluid / 1000.0:.1f} mL fluid"
        lines.append(line + (", cut by the border of the image" if item.at_border else ""))
    if number > 20:
        lines.append(f"  and {number - 20} smaller ones")
    lines.append(f"Left out as lung: {result.lungs / 1000.0:.0f} mL")
    lines += [LIMITS, f"Labels: {target}", f"Picture: {picture}"]
    return "\n".join(lines)
