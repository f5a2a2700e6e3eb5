"""``bozzini phantom``: write the phantom tract as a surface or as labels."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from .common import (
    Answer,
    CheckedCommand,
    QuantityType,
    answer_options,
)

if TYPE_CHECKING:
    from ..anatomy.phantom import Phantom
    from ..results import Json

__all__ = ["command"]


@click.command("phantom", cls=CheckedCommand)
@click.option(
    "--organ",
    type=click.Choice(["upper-tract", "airway"]),
    default="upper-tract",
    show_default=True,
    help="Oesophagus, stomach and duodenum; or the airways.",
)
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
    help="Voxel of the labels, or of the grid that the surface is made on (0.5mm to 4mm, airways "
    "0.2mm to 2mm).",
)
@answer_options(
    required=True,
    help="File to write: .stl, .ply, .obj, .glb (the wall) or .nii, .nii.gz (labels).",
    quiet=False,
)
def command(organ: str, seed: int, voxel: float, answer: Answer) -> None:
    """Write a phantom tract as a surface or as labels.

    Oesophagus (label 1), J-shaped stomach (2) and C-shaped duodenum (3), or the airways from the
    trachea on (label 1), made from published dimensions. Everything is in mm, GLB too; +x to the
    patient's right, +y to the front, +z to the head.
    """
    from ..anatomy.airway import AirwayPhantom, make_airway
    from ..anatomy.files import check_target, write_tract
    from ..anatomy.phantom import Phantom, make_phantom
    from ..checks import check_number

    kinds: dict[str, tuple[type[Phantom], Callable[..., Phantom]]] = {
        "upper-tract": (Phantom, make_phantom), "airway": (AirwayPhantom, make_airway)
    }  # fmt: skip
    phantom_class, make = kinds[organ]
    low, high = phantom_class.voxel_range
    check_number("voxel", voxel, low=low, high=high, unit="mm")
    target, force = answer.target, answer.force
    kind = check_target(target, force=force)
    phantom = make(seed=seed)
    tract = phantom.to_labels(voxel) if kind == "labels" else phantom.to_surface(voxel)
    write_tract(target, tract, force=force)
    lengths = phantom.region_lengths()
    result = {
        "file": str(target),
        "kind": kind,
        "unit": "mm",
        "seed": seed,
        "voxel_mm": voxel,
        "organ": organ,
        "labels": {name: label for label, name in phantom.regions.items()},
        "centreline_length_mm": phantom.length,
        "region_lengths_mm": lengths,
        "radius_min_mm": float(phantom.radii.min()),
        "radius_max_mm": float(phantom.radii.max()),
        "volume_ml": tract.volume / 1000.0,
        "start_mm": phantom.centreline[0],
        **_list_ends(phantom),
        "dimensions_mm": dict(phantom.dimensions),
    }
    parts = ", ".join(f"{name} {length:.0f} mm" for name, length in lengths.items())
    answer.give(
        result,
        f"{target}: {kind} of phantom {seed}, in mm; {parts}; {tract.volume / 1000:.0f} mL",
    )


def _list_ends(phantom: Phantom) -> Json:
    """Return the end of a tube, or how many branches and ends a tree has."""
    from ..anatomy.airway import AirwayPhantom

    if isinstance(phantom, AirwayPhantom):
        return {"branches": len(phantom.branches), "ends": len(phantom.ends)}
    return {"end_mm": phantom.centreline[-1]}
