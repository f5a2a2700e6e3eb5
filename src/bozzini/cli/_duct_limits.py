"""``bozzini duct limits``: how long a link and how wide a body may be along a tract, and where."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ._tables import PICTURES, check_target
from ._tract_options import (
    count_notes,
    read_with_options,
    sort_options,
    tell_findings,
    tract_options,
)
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

if TYPE_CHECKING:
    from ..anatomy.findings import Finding
    from ..anatomy.tract import LabelTract, SurfaceTract
    from ..duct.protocol import Duct
    from ..study.traverse import LimitsStudy

__all__ = ["limits_command"]

_BY = {
    "wall": "the wall at {place} limits them",
    "turn": "a tail would go backwards in the bend at {place}",
    "length": "longer ones are longer than the way",
}

_CAVEATS = {
    "inscribed": "All this is about the shapes, which are inside the tract and leave out a part of "
    "it: upper bounds do not hold for the tract.",
    "least squares": "All this is about the shapes, which go through the wall of the tract: no "
    "bound holds for the tract.",
}


@click.command("limits")
@click.argument("source", metavar="INPUT", type=click.Path(path_type=Path))
@click.option(
    "--diameter",
    type=QuantityType("length"),
    default="9mm",
    show_default=True,
    help="Outer diameter of the body.",
)
@click.option("--link", type=QuantityType("length"), help="Length of a rigid link, to judge.")
@tract_options
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A picture of the limits along the tract (.png, .svg, .pdf).",
)
@force_option
@json_option
@quiet_option
def limits_command(
    source: Path,
    diameter: float,
    link: float | None,
    out: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Bound the longest link and the largest diameter along the lumen in INPUT, and say where.

    INPUT is a label volume or a surface, as for bozzini plan, or fitted shapes (.json, .yaml). All
    bounds are proved; of shapes they are about the shapes, and where these were fitted to a tract,
    what does not pass them may pass the tract. Exit code 0: the link passes (without --link: short
    ones do); 1: it does not, or these bounds do not decide it; 2: bad input.
    """
    check_target(out, PICTURES, force=force)
    from ..study.traverse import run_limits

    given, known, ways = _read(source, options, quiet=quiet)
    with progress_bar(quiet=quiet) as progress:
        study = run_limits(given, diameter=diameter, link=link, progress=progress, **ways)
    tell_findings(study.findings[len(known) :])
    count_notes(study.findings, "--json")
    if out is not None:
        from ..view.figures import write_figure
        from ..view.traverse_figures import draw_link_limits

        write_figure(draw_link_limits(study.links, link=link), out)
    result = study.summarise() | {"input": source.name, "file": out}
    emit(result, as_json=as_json, text=_describe(study))
    if study.verdict != "passes":
        run_exit(EXIT_NEGATIVE)


def _read(
    source: Path, options: dict[str, Any], *, quiet: bool
) -> tuple[LabelTract | SurfaceTract | Duct, Sequence[Finding], dict[str, Any]]:
    """Return a tract or shapes, what is known of it, and its options for the study."""
    from ..duct.shapes_file import SUFFIXES, load_shapes_file
    from ..errors import InputError

    if source.suffix.lower() not in SUFFIXES:
        tract, ways = read_with_options(source, options, quiet=quiet)
        return tract, tract.findings, ways
    reading, organ, ways = sort_options(options)
    if reading["labels"] is not None:
        raise InputError(f"{source} holds shapes: it has no labels to select")
    if reading["unit"] not in (None, "mm"):
        raise InputError(f"unit is '{reading['unit']}': a file of shapes is in mm, leave it out")
    others = reading | {"labels": None, "unit": None, "organ": organ}
    given = [name for name, value in others.items() if value]
    if given:
        raise InputError(f"--{given[0]} has no effect on a file of shapes: leave it out")
    file = load_shapes_file(source)
    return file.shapes, (), ways | {"fit": file.fit}


def _describe(study: LimitsStudy) -> str:
    links, widths = study.links, study.diameters
    of = " of the shapes" if study.fit else ""
    lines = [f"A body of {links.diameter:g} mm along {study.line.length:.0f} mm{of}:"]
    if links.link_low > 0.0:
        by = _BY[links.link_low_by].format(place=f"{links.link_low_at:.0f} mm")
        lines.append(
            f"  links below {_floor(links.link_low)} mm pass with all joints on the centreline; "
            f"{by}"
        )
    else:
        lines.append(f"  the centreline has no clearance for it at {links.link_low_at:.0f} mm")
    for bound, at, whose in (
        (links.link_head, links.link_head_at, " with its head on the centreline"),
        (links.link_high, links.link_high_at, " at all"),
    ):
        if bound == 0.0:
            lines.append(f"  no link passes{whose}; there is no clearance at {at:.0f} mm")
        elif math.isfinite(bound):
            lines.append(
                f"  none above {_ceil(bound)} mm passes{whose}; the bend at {at:.0f} mm limits it"
            )
        else:
            lines.append(f"  no bend was found that limits links{whose}")
    high = f", none above {_ceil(widths.high)} mm" if math.isfinite(widths.high) else ""
    lines.append(f"Bodies below {_floor(widths.low)} mm pass by short links{high}.")
    if study.diameters_of_link is not None:
        narrow = study.diameters_of_link
        high = f", none above {_ceil(narrow.high)} mm" if math.isfinite(narrow.high) else ""
        lines.append(
            f"With links of {narrow.link:g} mm: bodies below {_floor(narrow.low)} mm pass{high}."
        )
        verdict = {
            "passes": "pass",
            "too wide": "do not pass: the body is too wide",
            "too long": "do not pass: they are too long",
            "undecided": "are not decided by these bounds: plan their motion",
        }[study.verdict]
        lines.append(f"Links of {narrow.link:g} mm {verdict}.")
    if study.fit:
        lines.append(_CAVEATS[study.fit])
    return "\n".join(lines)


def _floor(value: float) -> str:
    return f"{math.floor(10.0 * value) / 10.0:.1f}"


def _ceil(value: float) -> str:
    return f"{math.ceil(10.0 * value) / 10.0:.1f}"
