"""``bozzini duct``: fit shapes to a tract, look at them, and what limits links along it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ._tract_options import (
    count_notes,
    read_with_options,
    sort_options,
    tell_findings,
    tract_options,
)
from .common import (
    EXIT_NEGATIVE,
    PICTURES,
    QuantityType,
    check_target,
    emit,
    force_option,
    json_option,
    progress_bar,
    quiet_option,
    run_exit,
)

if TYPE_CHECKING:
    from ..anatomy.tract import Finding, LabelTract, SurfaceTract
    from ..duct.base import Duct
    from ..study.shapes import FitStudy, SectionStudy
    from ..study.traverse import LimitsStudy

# ``bozzini duct limits``: how long a link and how wide a body may be along a tract, and where.

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
        from ..plot.duct import draw_link_limits
        from ..plot.figures import write_figure

        write_figure(draw_link_limits(study.links, link=link), out)
    result = study.summarise() | {"input": source.name, "file": out}
    emit(result, as_json=as_json, text=_describe(study))
    if study.verdict != "passes":
        run_exit(EXIT_NEGATIVE)


def _read(
    source: Path, options: dict[str, Any], *, quiet: bool
) -> tuple[LabelTract | SurfaceTract | Duct, Sequence[Finding], dict[str, Any]]:
    """Return a tract or shapes, what is known of it, and its options for the study."""
    from ..duct.shape_files import SUFFIXES, load_shapes_file
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
                f"  none above {_round_up(bound)} mm passes{whose}; "
                f"the bend at {at:.0f} mm limits it"
            )
        else:
            lines.append(f"  no bend was found that limits links{whose}")
    high = f", none above {_round_up(widths.high)} mm" if math.isfinite(widths.high) else ""
    lines.append(f"Bodies below {_floor(widths.low)} mm pass by short links{high}.")
    if study.diameters_of_link is not None:
        narrow = study.diameters_of_link
        high = f", none above {_round_up(narrow.high)} mm" if math.isfinite(narrow.high) else ""
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


def _round_up(value: float) -> str:
    return f"{math.ceil(10.0 * value) / 10.0:.1f}"


SHAPES = (".json", ".yaml", ".yml")
KINDS = ("cones", "cylinders", "superellipsoids")


@click.group("duct")
def command() -> None:
    """Fit shapes to a tract, draw them, and find what limits links along it."""


command.add_command(limits_command)


@command.command("fit")
@click.argument("source", metavar="INPUT", type=click.Path(path_type=Path))
@click.option(
    "--as",
    "kind",
    type=click.Choice(KINDS),
    default="cones",
    show_default=True,
    help="What shapes stand for the lumen.",
)
@click.option(
    "--max-error",
    type=QuantityType("length"),
    default="1mm",
    show_default=True,
    help="How far outside the wall the shapes may reach.",
)
@click.option(
    "--pieces",
    type=int,
    help="How many shapes at most (default: so many that no more clearance than --max-error is "
    "lost).",
)
@click.option(
    "--least-squares",
    is_flag=True,
    help="Fit the wall, through it too, and not only from inside: not for planning.",
)
@tract_options
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Where to write the shapes (.json, .yaml).",
)
@force_option
@json_option
@quiet_option
def fit_command(
    source: Path,
    kind: str,
    max_error: float,
    pieces: int | None,
    least_squares: bool,
    out: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Fit shapes to the lumen in INPUT, and say what they keep of it.

    INPUT is a label volume or a surface, as for bozzini plan. Exit code 0: no point of the shapes
    is farther outside than --max-error, which is proved; 1: one is, or too much clearance is lost
    (the file is written, and the output names what); 2: bad input.
    """
    from ..checks import check_integer, check_number
    from ..duct.fitting.fit import PIECES_MAX
    from ..duct.shape_files import check_shapes_target
    from ..study.shapes import run_fit

    if out is not None:
        check_shapes_target(out, force=force)
    check_number("--max-error", max_error, low=0.0, low_open=True, unit="mm")
    if pieces is not None:
        check_integer("--pieces", pieces, low=1, high=PIECES_MAX)
    tract, ways = read_with_options(source, options, quiet=quiet)
    with progress_bar(quiet=quiet) as progress:
        study = run_fit(
            tract,
            kind,
            max_error=max_error,
            pieces=pieces,
            inside=not least_squares,
            progress=progress,
            **ways,
        )
    tell_findings(study.findings[len(tract.findings) :])
    count_notes(study.findings, "--json")
    if out is not None:
        note = f"{study.fitted.report.pieces} {kind} fitted to {source.name}"
        study.fitted.save(out, note=note, force=force)
    result = study.summarise() | {"input": source.name, "file": out}
    emit(result, as_json=as_json, text=_describe_fit(study, out))
    if not study.fitted.converged:
        run_exit(EXIT_NEGATIVE)


@command.command("show")
@click.argument("source", metavar="INPUT", type=click.Path(path_type=Path))
@click.option(
    "--over",
    type=click.Path(path_type=Path),
    metavar="TRACT",
    help="Draw shapes over the tract that they stand for.",
)
@click.option(
    "--spacing", type=QuantityType("length"), help="Of a tract's sections (default: 2mm)."
)
@tract_options
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A picture (.png, .svg, .pdf).",
)
@force_option
@json_option
@quiet_option
def show_command(
    source: Path,
    over: Path | None,
    spacing: float | None,
    out: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Show a file of shapes (.json, .yaml), or sections across the tract in INPUT.

    Of a tract: its inscribed circles, circles by least squares, and areas along the centreline.
    """
    from ..errors import InputError

    check_target(out, PICTURES, force=force)
    if source.suffix.lower() not in SHAPES:
        if over is not None:
            raise InputError(f"--over has no effect: {source} is no file of shapes ({SHAPES[0]})")
        result, text = _show_tract(source, out, spacing, options, quiet=quiet)
    else:
        if spacing is not None:
            raise InputError("--spacing has no effect on a file of shapes: leave it out")
        given = [f"--{name}" for name, value in options.items() if value not in (None, False, ())]
        if given and over is None:
            raise InputError(f"{given[0]} has no effect on a file of shapes: give --over too")
        result, text = _show_shapes(source, over, out, options, quiet=quiet)
    emit(result, as_json=as_json, text=text)


def _show_tract(
    source: Path, out: Path | None, spacing: float | None, options: dict[str, Any], *, quiet: bool
) -> tuple[dict[str, Any], str]:
    from ..checks import check_number
    from ..study.shapes import SPACING_MIN, run_sections

    if spacing is not None:
        check_number("--spacing", spacing, low=SPACING_MIN, unit="mm")
    tract, ways = read_with_options(source, options, quiet=quiet)
    with progress_bar(quiet=quiet) as progress:
        study = run_sections(
            tract, spacing=2.0 if spacing is None else spacing, progress=progress, **ways
        )
    tell_findings(study.findings[len(tract.findings) :])
    count_notes(study.findings, "--json")
    if out is not None:
        from ..plot.duct import draw_sections
        from ..plot.figures import write_figure

        circles = {"inscribed circle": study.inscribed, "least squares": study.fitted}
        figure = draw_sections(study.field, study.line, study.sections, circles, title=source.name)
        write_figure(figure, out)
    return study.summarise() | {"input": source.name, "file": out}, _describe_sections(study, out)


def _show_shapes(
    source: Path, over: Path | None, out: Path | None, options: dict[str, Any], *, quiet: bool
) -> tuple[dict[str, Any], str]:
    from ..duct.shape_files import count_pieces, load_shapes_file, write_shapes

    file = load_shapes_file(source)
    shapes = file.shapes
    data = write_shapes(shapes, fit=file.fit, note=file.note)
    low, high = shapes.bounds
    result = data | {"input": source.name, "pieces": count_pieces(shapes)}
    result |= {"bounds_mm": [low, high], "file": out}
    size = " x ".join(f"{value:.0f}" for value in high - low)
    content = f"{count_pieces(shapes)} {data['kind']}"
    text = f"{source}: {content} in {size} mm"
    field = line = None
    if over is not None:
        from ..study.shapes import run_sections

        tract, ways = read_with_options(over, options, quiet=quiet)
        with progress_bar(quiet=quiet) as progress:
            study = run_sections(tract, spacing=10.0, progress=progress, **ways)
        tell_findings(study.findings[len(tract.findings) :])
        count_notes(study.findings, "--json")
        field, line = study.field, study.line
    if out is not None:
        from ..plot.duct import draw_shapes
        from ..plot.figures import write_figure

        write_figure(draw_shapes(shapes, field=field, line=line, title=content), out)
        text += f"\n{out}"
    return result, text


def _describe_fit(study: FitStudy, out: Path | None) -> str:
    from ..motion.refusal import floor_mm

    fitted, report = study.fitted, study.fitted.report
    share = 100.0 / report.volume_true
    gained = share * report.volume_gained
    lines = [
        f"{report.pieces} {fitted.options.kind} keep {share * report.volume_kept:.1f} % of the "
        f"volume ({share * report.volume_lost:.1f} % lost, {gained:.2f} % gained, "
        f"+-{share * report.volume_error:.2f} %)",
        f"  no point is more than {_ceil(report.outside_bound)} mm outside the wall (proved); "
        f"found {report.outside:.2f} mm",
        f"  clearance lost on the centreline: {report.room_loss[3]:.2f} mm in the middle, "
        f"{report.room_loss[-1]:.2f} mm at most, at {report.room_loss_place:.0f} mm; at least "
        f"{floor_mm(_find_least_clearance(study))} mm is left",
    ]
    if not fitted.converged:
        lines.append(f"Not reached: {fitted.reason}")
    if out is not None:
        lines.append(f"Shapes: {out}")
    return "\n".join(lines)


def _find_least_clearance(study: FitStudy) -> float:
    """Return the least clearance of the shapes on the centreline, off its ends [mm]."""
    line = study.line
    inner = (line.arc_length > line.radius[0]) & (line.arc_length < line.length - line.radius[-1])
    points = line.points[inner] if inner.any() else line.points
    return float(-study.fitted.duct.signed_distance(points).max())


def _describe_sections(study: SectionStudy, out: Path | None) -> str:
    inscribed, fitted = study.inscribed.radii, study.fitted.radii
    index = int(inscribed.argmin())
    middle = len(inscribed) // 2
    ratio = float(sorted(fitted / inscribed)[middle])
    lines = [
        f"{len(inscribed)} sections along {study.line.length:.0f} mm: inscribed radius "
        f"{inscribed.min():.2f} mm at least, at {study.sections.arc_length[index]:.0f} mm, "
        f"{float(sorted(inscribed)[middle]):.2f} mm in the middle",
        f"  circles by least squares are {ratio:.2f} times as large in the middle: plan with the "
        "inscribed ones",
    ]
    if out is not None:
        lines.append(str(out))
    return "\n".join(lines)


def _ceil(value: float) -> str:
    """Write a bound rounded up, so that what is written is a bound too."""
    import math

    return f"{math.ceil(100.0 * value - 1e-9) / 100.0:.2f}"
