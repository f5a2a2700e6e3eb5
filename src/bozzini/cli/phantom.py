"""``bozzini phantom``: write the phantom tract as a surface or as labels."""

from __future__ import annotations

import click

from .common import (
    Answer,
    CheckedCommand,
    QuantityType,
    answer_options,
)

__all__ = ["command"]


@click.command("phantom", cls=CheckedCommand)
@click.option(
    "--seed",
    type=int,
    default=0,
    show_default=True,
    help="0 is the standard anatomy; any other whole number varies it.",
)
@click.option(
    "--voxel",
    type=QuantityType("length"),
    default=1.0,
    show_default="1mm",
    help="Voxel of the labels, or of the grid that the surface is made on (0.5mm to 4mm).",
)
@answer_options(
    required=True,
    help="File to write: .stl, .ply, .obj, .glb (the wall) or .nii, .nii.gz (labels).",
    quiet=False,
)
def command(seed: int, voxel: float, answer: Answer) -> None:
    """Write a phantom upper gastro-intestinal tract as a surface or as labels.

    Oesophagus (label 1), J-shaped stomach (2) and C-shaped duodenum (3), made from published
    dimensions. Everything is in mm, GLB too; +x to the patient's right, +y to the front, +z to
    the head.
    """
    from ..anatomy.files import check_target, write_tract
    from ..anatomy.phantom import REGIONS, make_phantom
    from ..checks import check_number

    check_number("voxel", voxel, low=0.5, high=4.0, unit="mm")
    target, force = answer.target, answer.force
    kind = check_target(target, force=force)
    phantom = make_phantom(seed=seed)
    tract = phantom.to_labels(voxel) if kind == "labels" else phantom.to_surface(voxel)
    write_tract(target, tract, force=force)
    lengths = phantom.region_lengths()
    result = {
        "file": str(target),
        "kind": kind,
        "unit": "mm",
        "seed": seed,
        "voxel_mm": voxel,
        "labels": {name: label for label, name in REGIONS.items()},
        "centreline_length_mm": phantom.length,
        "region_lengths_mm": lengths,
        "radius_min_mm": float(phantom.radii.min()),
        "radius_max_mm": float(phantom.radii.max()),
        "volume_ml": tract.volume / 1000.0,
        "start_mm": phantom.centreline[0],
        "end_mm": phantom.centreline[-1],
        "dimensions_mm": dict(phantom.dimensions),
    }
    parts = ", ".join(f"{name} {length:.0f} mm" for name, length in lengths.items())
    answer.give(
        result,
        f"{target}: {kind} of phantom {seed}, in mm; {parts}; {tract.volume / 1000:.0f} mL",
    )
