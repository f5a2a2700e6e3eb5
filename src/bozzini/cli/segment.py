"""``bozzini segment``: the gas-filled lumen of a CT without labels."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import VectorType, emit, force_option, json_option, progress_bar, quiet_option

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..anatomy.labels import Volume
    from ..anatomy.segment import Segmentation

__all__ = ["command"]

LIMITS = (
    "Only gas is found: collapsed stretches, and fluid that is not bridged, are missing. The wall "
    "is where the image crosses the threshold. Compare the picture and the labels with the scan; "
    "this does not replace a segmentation tool."
)


@click.command("segment")
@click.argument("source", metavar="CT", type=click.Path(path_type=Path))
@click.option(
    "--out",
    "target",
    required=True,
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Labels to write: .nii or .nii.gz; a picture (.png) is put beside it.",
)
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
@force_option
@json_option
@quiet_option
def command(
    source: Path,
    target: Path,
    threshold: float,
    seeds: tuple[tuple[float, ...], ...],
    bridge_fluid: bool,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Find the gas-filled lumen in a CT without labels.

    CT is a NIfTI, NRRD or MetaImage file, or a folder with a DICOM series, in HU. Each connected
    body of gas inside the patient becomes a label, the largest first; lungs and the air outside
    are left out. Choose among them by --seed here, or by --labels in bozzini plan.
    """
    from ..anatomy.segment import segment_gas
    from ..anatomy.volumes import read_volume
    from ..anatomy.files import check_target, encode_labels
    from ..errors import InputError
    from ..io.files import check_new_file, write_atomically
    from ..plot.figures import write_figure

    if not target.name.lower().endswith((".nii", ".nii.gz")):
        raise InputError(f"{target}: labels are written as .nii or .nii.gz")
    check_target(target, force=force)
    picture = target.with_name(f"{target.name.removesuffix('.gz').removesuffix('.nii')}.png")
    check_new_file(picture, (".png",), force=force)
    with progress_bar(quiet=quiet) as progress:
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
    labels = encode_labels(
        target, result.labels, affine=result.affine, frame=result.frame, names=names
    )
    drawing = _draw(volume, result)

    def write(temporary: Path) -> None:
        temporary.write_bytes(labels)
        # Before the labels get their name: no labels without their picture.
        write_figure(drawing, picture)

    write_atomically(target, write)
    found = {
        "file": str(target),
        "picture": str(picture),
        "source": result.source,
        "frame": result.frame,
        "threshold_hu": result.threshold,
        "segments": [
            {
                "label": item.label,
                "volume_ml": item.volume / 1000.0,
                "fluid_ml": item.fluid / 1000.0,
                "point_mm": item.point,
                "at_border": item.at_border,
            }
            for item in result.segments
        ],
        "lungs_ml": result.lungs / 1000.0,
        "findings": [str(item) for item in result.findings],
        "limits": LIMITS,
    }
    emit(found, as_json=as_json, text=_describe(result, target, picture))


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


def _draw(volume: Volume, result: Segmentation) -> Figure:
    """Return a picture: mean of the scan, and the segments, from three sides."""
    import numpy as np
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure

    image: Any = volume.array.reshape(result.labels.shape, order="A")
    spacing = np.linalg.norm(result.affine[:3, :3], axis=0)
    figure = Figure(figsize=(12.0, 5.0), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    colours = ListedColormap([f"C{k % 10}" for k in range(len(result.segments))])
    inverse = np.linalg.inv(result.affine)
    for panel, axis in zip(figure.subplots(1, 3), (1, 0, 2), strict=True):
        across, up = (other for other in range(3) if other != axis)
        extent = (0.0, spacing[across] * image.shape[across], 0.0, spacing[up] * image.shape[up])
        mean = image.mean(axis=axis, dtype=np.float32).T
        panel.imshow(mean, cmap="gray", origin="lower", extent=extent)
        seen = result.labels.max(axis=axis).T
        panel.imshow(
            np.ma.masked_equal(seen, 0),
            cmap=colours,
            vmin=0.5,
            vmax=len(result.segments) + 0.5,
            origin="lower",
            extent=extent,
            alpha=0.6,
            interpolation="nearest",
        )
        for item in result.segments[:20]:
            place = (inverse @ (*item.point, 1.0))[:3] * spacing
            panel.annotate(str(item.label), (place[across], place[up]), color="white", ha="center")
        panel.set_xlabel(f"{'ijk'[across]} [mm]")
        panel.set_ylabel(f"{'ijk'[up]} [mm]")
    figure.suptitle(f"Gas below {result.threshold:g} HU in {result.source}, along the voxel axes")
    return figure
