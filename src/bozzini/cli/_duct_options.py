"""Options of ``bozzini duct``: what a tract is read with, and where its centreline runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from .common import LabelsType, QuantityType, progress_bar
from .plan import EndType, tell_findings

if TYPE_CHECKING:
    from ..anatomy.tract import LabelTract, SurfaceTract

__all__ = ["read_with_options", "tract_options"]

_Function = TypeVar("_Function", bound=Callable[..., Any])


def tract_options(function: _Function) -> _Function:
    """Add what a tract is read with, and where its centreline runs."""
    for option in reversed(
        (
            click.option("--labels", type=LabelsType(), help="Labels that are lumen: 1,2,3."),
            click.option("--unit", help="Unit of a surface file (default: mm)."),
            click.option(
                "--voxel", type=QuantityType("length"), help="Grid of the distance field."
            ),
            click.option(
                "--inflate",
                type=QuantityType("length"),
                help="Move the wall outwards, as insufflation does (default: 0mm).",
            ),
            click.option("--start", type=EndType(), help="One end of the way: a point or a label."),
            click.option("--end", type=EndType(), help="The other end: a point or a label."),
            click.option("--reverse", is_flag=True, help="Go the other way round."),
        )
    ):
        function = option(function)
    return function


def read_with_options(
    source: Path, options: dict[str, Any], *, quiet: bool
) -> tuple[LabelTract | SurfaceTract, dict[str, Any]]:
    """Return the tract, and the rest of its options for a study."""
    from ..anatomy import read_tract

    ways = dict(options)
    labels, unit = ways.pop("labels"), ways.pop("unit")
    ways["inflate"] = 0.0 if ways["inflate"] is None else ways["inflate"]
    with progress_bar(quiet=quiet) as progress:
        progress("read", 0.0)
        tract = read_tract(source, labels=labels, unit="mm" if unit is None else unit)
    # Told at once, not with the result: a later stage may fail just because of them.
    tell_findings(tract.findings)
    return tract, ways
