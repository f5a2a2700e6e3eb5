"""What commands share that take a tract: how it is read, and where its centreline runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from .common import LabelsType, QuantityType, progress_bar

if TYPE_CHECKING:
    from ..anatomy.findings import Finding
    from ..anatomy.tract import LabelTract, SurfaceTract

__all__ = ["EndType", "read_with_options", "sort_options", "tell_findings", "tract_options"]

_Function = TypeVar("_Function", bound=Callable[..., Any])


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


def tract_options(function: _Function) -> _Function:
    """Add what a tract is read with, and where its centreline runs; None where not given."""
    for option in reversed(
        (
            click.option(
                "--labels", type=LabelsType(), help="Labels that are lumen: 1,2,3 (default: all)."
            ),
            click.option("--unit", help="Unit of a surface file (default: mm)."),
            click.option(
                "--voxel", type=QuantityType("length"), help="Grid of the distance field."
            ),
            click.option(
                "--inflate",
                type=QuantityType("length"),
                help="Move the wall outwards, as insufflation does (default: 0mm).",
            ),
            click.option("--start", type=EndType(), help="Where the way begins: a point or label."),
            click.option("--end", type=EndType(), help="Where the way ends: a point or label."),
            click.option("--reverse", is_flag=True, help="Enter at the other end."),
        )
    ):
        function = option(function)
    return function


def sort_options(
    options: dict[str, Any],
) -> tuple[tuple[int, ...] | None, str | None, dict[str, Any]]:
    """Return labels and unit, as given, and the rest of a tract's options for a study."""
    ways = dict(options)
    labels, unit = ways.pop("labels"), ways.pop("unit")
    ways["inflate"] = 0.0 if ways["inflate"] is None else ways["inflate"]
    return labels, unit, ways


def read_with_options(
    source: Path, options: dict[str, Any], *, quiet: bool
) -> tuple[LabelTract | SurfaceTract, dict[str, Any]]:
    """Return the tract, and the rest of its options for a study."""
    from ..anatomy import read_tract

    labels, unit, ways = sort_options(options)
    with progress_bar(quiet=quiet) as progress:
        progress("read", 0.0)
        tract = read_tract(source, labels=labels, unit="mm" if unit is None else unit)
    # Told at once, not with the result: a later stage may fail just because of them.
    tell_findings(tract.findings)
    return tract, ways


def tell_findings(findings: Sequence[Finding]) -> None:
    """Write what the checks found on stderr, a line each."""
    for item in findings:
        click.echo(f"bozzini: {item.severity}: {' '.join(item.message.split())}", err=True)
