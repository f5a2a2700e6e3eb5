"""``bozzini duct``: fit shapes to a tract, look at them, and what limits links along it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..checks import ceil_mm, floor_mm
from ..motion.chain_task import ChainTask
from ..results import Json
from ..study.options import FITTED_KINDS, PathOptions, ReadOptions, TractFitOptions
from ._tract_options import (
    check_shape_options,
    list_given,
    read_with_options,
    report_study,
    tract_options,
)
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    PICTURES,
    Answer,
    CheckedGroup,
    QuantityType,
    answer_options,
    describe_classes,
    options_of,
    run_exit,
)
from .task import make_command

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..study.shapes import FitStudy, SectionStudy
    from ..study.traverse import LimitsStudy

_LIMITED_BY = {
    "wall": "the wall at {place} limits them",
    "turn": "a tail would go backwards in the bend at {place}",
    "length": "longer ones are longer than the centreline",
}

_CAVEATS = {
    "inscribed": "All this is about the shapes, which are inside the tract and leave out a part of "
    "it: upper bounds do not hold for the tract.",
    "least squares": "All this is about the shapes, which go through the wall of the tract: no "
    "bound holds for the tract.",
}


@click.group("duct", cls=CheckedGroup)
def command() -> None:
    """Fit shapes to a tract, draw them, and find what limits links along it."""


path_options = options_of(PathOptions, "options")


@command.command("kinds")
@answer_options(quiet=False)
def kinds_command(answer: Answer) -> None:
    """List the kinds of shapes, those of other installed packages too.

    A file of shapes states the name of its kind.
    """
    from ..duct.shapes import DUCT_SHAPES

    rows, text = describe_classes(DUCT_SHAPES)
    answer.give({"kinds": rows}, text)


@command.command("limits")
@click.argument("source", metavar="INPUT", type=INPUT)
@click.option(
    "--diameter",
    type=QuantityType("length"),
    default="9mm",
    show_default=True,
    help="Outer diameter of the body.",
)
@click.option("--link", type=QuantityType("length"), help="Length of a rigid link, to judge.")
@tract_options
@path_options
@answer_options(*PICTURES, help="A picture of the limits along the tract (.png, .svg, .pdf).")
def limits_command(
    source: Path,
    diameter: float,
    link: float | None,
    reading: ReadOptions,
    options: PathOptions,
    answer: Answer,
) -> None:
    """Bound the longest link and the largest diameter along the lumen in INPUT.

    INPUT is a label volume or a surface, as for bozzini plan, or fitted shapes (.json, .yaml). All
    bounds are proved; of shapes they are about the shapes, and where these were fitted to a tract,
    what does not pass them may pass the tract. Exit code 0: the link passes (without --link: short
    ones do); 1: it does not, or these bounds do not decide it; 2: bad input.
    """
    from ..duct.shape_files import SUFFIXES, load_shapes_file
    from ..plot.duct import draw_link_limits
    from ..study.traverse import run_limits

    given: Any
    fit = ""
    if source.suffix.lower() in SUFFIXES:
        check_shape_options(source, reading)
        file = load_shapes_file(source)
        given, fit = file.shapes, file.fit
    else:
        given = read_with_options(source, reading, answer)
    with answer.show_progress() as progress:
        study = run_limits(given, options, diameter=diameter, link=link, fit=fit, progress=progress)
    report_study(study.findings, getattr(given, "findings", ()), "--json")
    answer.draw(lambda: draw_link_limits(study.links, link=link))
    result = study.to_dict() | {"input": source.name, "file": answer.out}
    answer.give(result, _describe_limits(study))
    if not study.converged:
        run_exit(EXIT_NEGATIVE)


def _describe_limits(study: LimitsStudy) -> str:
    links, widths = study.links, study.diameters
    of = " of the shapes" if study.fit else ""
    lines = [f"A body of {links.diameter:g} mm along {study.line.length:.0f} mm{of}:"]
    if links.link_low > 0.0:
        by = _LIMITED_BY[links.link_low_by].format(place=f"{links.link_low_at:.0f} mm")
        lines.append(
            f"  links below {floor_mm(links.link_low, 1)} mm pass with all joints on the "
            "centreline; "
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
                f"  none above {ceil_mm(bound, 1)} mm passes{whose}; "
                f"the bend at {at:.0f} mm limits it"
            )
        else:
            lines.append(f"  no bend was found that limits links{whose}")
    high = f", none above {ceil_mm(widths.high, 1)} mm" if math.isfinite(widths.high) else ""
    lines.append(f"Bodies below {floor_mm(widths.low, 1)} mm pass by short links{high}.")
    if study.diameters_of_link is not None:
        narrow = study.diameters_of_link
        high = f", none above {ceil_mm(narrow.high, 1)} mm" if math.isfinite(narrow.high) else ""
        lines.append(
            f"With links of {narrow.link:g} mm: bodies below {floor_mm(narrow.low, 1)} mm "
            f"pass{high}."
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


@command.command("fit")
@click.argument("source", metavar="INPUT", type=INPUT)
@tract_options
@options_of(TractFitOptions, "options")
@answer_options(help="Where to write the shapes (.json, .yaml).")
def fit_command(
    source: Path, reading: ReadOptions, options: TractFitOptions, answer: Answer
) -> None:
    """Fit shapes to the lumen in INPUT, and measure how much of it they keep.

    INPUT is a label volume or a surface, as for bozzini plan. Exit code 0: no point of the shapes
    is farther outside than --max-error, which is proved; 1: one is, or too much clearance is lost
    (the file is written, and the output names what); 2: bad input.
    """
    from ..duct.shape_files import check_shapes_target
    from ..study.shapes import run_fit

    if answer.out is not None:
        check_shapes_target(answer.out, force=answer.force)
    tract = read_with_options(source, reading, answer)
    with answer.show_progress() as progress:
        study = run_fit(tract, options, progress=progress)
    report_study(study.findings, tract.findings, "--json")
    if answer.out is not None:
        note = f"{study.fitted.report.pieces} {options.kind} fitted to {source.name}"
        study.fitted.save(answer.out, note=note, force=answer.force)
    result = study.to_dict() | {"input": source.name, "file": answer.out}
    answer.give(result, _describe_fit(study, answer.out))
    if not study.converged:
        run_exit(EXIT_NEGATIVE)


@command.command("show")
@click.argument("source", metavar="INPUT", type=INPUT)
@click.option(
    "--over",
    type=INPUT,
    metavar="TRACT",
    help="Draw shapes over the tract that they stand for.",
)
@click.option(
    "--spacing", type=QuantityType("length"), help="Of a tract's sections (default: 2mm)."
)
@tract_options
@path_options
@answer_options(*PICTURES, help="A picture (.png, .svg, .pdf).")
def show_command(
    source: Path,
    over: Path | None,
    spacing: float | None,
    reading: ReadOptions,
    options: PathOptions,
    answer: Answer,
) -> None:
    """Show a file of shapes (.json, .yaml), or sections across the tract in INPUT.

    Of a tract: its inscribed circles, circles by least squares, and areas along the centreline.
    """
    from ..duct.shape_files import SUFFIXES, load_shapes_file, write_shapes
    from ..errors import InputError
    from ..plot import duct as figures

    if source.suffix.lower() not in SUFFIXES:
        if over is not None:
            raise InputError(f"--over has no effect: {source} is no file of shapes ({SUFFIXES[0]})")
        study = _cut_sections(source, reading, options, answer, 2.0 if spacing is None else spacing)
        parts = study.field, study.line, study.sections, study.circles
        answer.draw(lambda: figures.draw_sections(*parts, title=source.name))
        result = study.to_dict() | {"input": source.name, "file": answer.out}
        answer.give(result, _describe_sections(study, answer.out))
        return
    if spacing is not None:
        raise InputError("--spacing has no effect on a file of shapes: leave it out")
    given = [*list_given(reading), *list_given(options)]
    if given and over is None:
        raise InputError(f"--{given[0]} has no effect on a file of shapes: give --over too")
    file = load_shapes_file(source)
    data = write_shapes(file.shapes, fit=file.fit, note=file.note)
    low, high = file.shapes.bounds
    count = file.shapes.shape_count
    size = " x ".join(f"{value:.0f}" for value in high - low)
    content = f"{count} {data['kind']}"
    text = f"{source}: {content} in {size} mm"
    under: Json = {}
    if over is not None:
        study = _cut_sections(over, reading, options, answer, 10.0)
        under = {"field": study.field, "line": study.line}

    def draw() -> Figure | Axes:
        if over is None and data["kind"] not in FITTED_KINDS:
            return file.shapes.plot()
        return figures.draw_shapes(file.shapes, title=content, **under)

    answer.draw(draw)
    result = {"input": source.name, "pieces": count, "bounds_mm": [low, high], "file": answer.out}
    answer.give(data | result, text if answer.out is None else f"{text}\n{answer.out}")


def _cut_sections(
    source: Path, reading: ReadOptions, options: PathOptions, answer: Answer, spacing: float
) -> SectionStudy:
    """Read a tract and cut sections across it."""
    from ..checks import check_number
    from ..study.shapes import SPACING_MIN, run_sections

    check_number("--spacing", spacing, low=SPACING_MIN, unit="mm")
    tract = read_with_options(source, reading, answer)
    with answer.show_progress() as progress:
        study = run_sections(tract, options, spacing=spacing, progress=progress)
    report_study(study.findings, tract.findings, "--json")
    return study


def _describe_fit(study: FitStudy, out: Path | None) -> str:
    fitted, report = study.fitted, study.fitted.report
    share = 100.0 / report.volume_true
    gained = share * report.volume_gained
    lines = [
        f"{report.pieces} {fitted.options.kind} keep {share * report.volume_kept:.1f} % of the "
        f"volume ({share * report.volume_lost:.1f} % lost, {gained:.2f} % gained, "
        f"+-{share * report.volume_error:.2f} %)",
        f"  no point is more than {ceil_mm(report.outside_bound)} mm outside the wall "
        f"(proved); found {report.outside:.2f} mm",
        f"  clearance lost on the centreline: {report.clearance_loss[3]:.2f} mm in the middle, "
        f"{ceil_mm(report.clearance_loss[-1])} mm at most, at {report.clearance_loss_place:.0f} "
        "mm; "
        f"at least {floor_mm(study.clearance_min)} mm is left",
    ]
    if not fitted.converged:
        lines.append(f"Not reached: {fitted.reason}")
    if out is not None:
        lines.append(f"Shapes: {out}")
    return "\n".join(lines)


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


command.add_command(make_command(ChainTask))
