"""``bozzini continuum design`` and ``rank``: a robot for a curve, a plan or a tract."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..checks import ceil_mm, floor_mm
from ..continuum.routing import RoutingLimits
from ..errors import FileFormatError, InputError
from ..motion.routing.options import InsertionRankOptions, RobotSearch
from ..results import format_rows
from ..study.options import ReadOptions
from ._tract_options import read_with_options, report_findings, tract_options
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    OUTPUT,
    PICTURES,
    Answer,
    CheckedCommand,
    answer_options,
    check_target,
    gather,
    option,
    options_of,
    refuse_options,
    run_exit,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..anatomy.tract import LabelTract, SurfaceTract
    from ..duct.base import Duct
    from ..motion.plan import Plan
    from ..motion.routing import InsertionRank, RoutingDesign, TractRobot

__all__ = ["design_command", "rank_command"]

WALL_DOUBT = 1.0
"""By which a wall may differ from that of a plan [mm], beside one and a half voxels."""


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What of a routing is asked for."""

    lumen: Path | None
    robot: Path | None
    tendons: int
    straight: bool


_asked = gather(
    "asked",
    Asked,
    click.option(
        "--lumen",
        metavar="INPUT",
        type=INPUT,
        help="The file that PLAN was made from: the pose is certified in it.",
    ),
    click.option(
        "--robot",
        metavar="ROBOT.yaml",
        type=INPUT,
        help="A robot of one section, whose radius and stiffnesses are taken.",
    ),
    click.option("--tendons", default=2, show_default=True, help="Number of tendons: 1 to 4."),
    click.option(
        "--straight", is_flag=True, help="Straight tendons, up to 12, each with an end of its own."
    ),
)


@click.command("design", cls=CheckedCommand)
@click.argument("source", metavar="[CURVE.csv | PLAN.npz]", required=False, type=INPUT)
@click.option(
    "--tract", metavar="INPUT", type=INPUT, help="Find a robot of sections for this tract."
)
@_asked
@options_of(RoutingLimits, "limits")
@options_of(RobotSearch, "search")
@tract_options
@click.option("--figure", metavar="FILE", type=OUTPUT, help="Also write a picture of the design.")
@answer_options(".yaml", ".yml", help="The robot's file.")
def design_command(
    source: Path | None,
    tract: Path | None,
    asked: Asked,
    limits: RoutingLimits,
    search: RobotSearch,
    reading: ReadOptions,
    figure: Path | None,
    answer: Answer,
) -> None:
    """Route tendons so that a robot holds a curve, or find a robot of sections for a tract.

    A curve is a table with the columns x, y and z (or x_mm, y_mm, z_mm) from the base on; of a plan
    it is the head's path. With --tract the widest robot of sections is sought that comes through,
    certified. Exit code 0: there is a robot; 1: there is none within the limits, the reason is
    reported and no robot is written; 2: bad input.
    """
    check_target(figure, PICTURES, force=answer.force)
    if tract is not None and source is None:
        refuse_options(_list_names(Asked, RoutingLimits), "with --tract")
        found = _search_tract(tract, reading, search, answer)
        _give(found, answer, figure, _format_search(found))
    elif source is not None and tract is None:
        refuse_options(_list_names(RobotSearch, ReadOptions), "without --tract")
        if asked.straight:
            refuse_options(("core_radius", "slope_max", "gap_min"), "with --straight")
        design = _design(source, asked, limits, answer)
        _give(design, answer, figure, _format_design(design))
    else:
        raise click.UsageError("give either a curve or a plan, or --tract")


def _list_names(*kinds: type) -> list[str]:
    return [item.name for kind in kinds for item in fields(kind)]


def _design(source: Path, asked: Asked, limits: RoutingLimits, answer: Answer) -> RoutingDesign:
    from ..continuum import ContinuumRobot
    from ..motion.routing import design_routing

    curve: Plan | NDArray[np.float64]
    duct = None
    robot = None if asked.robot is None else ContinuumRobot.from_yaml(asked.robot)
    if source.suffix.lower() == ".npz":
        curve = read_plan(source)
        if asked.lumen is not None:
            duct = rebuild_lumen(curve, asked.lumen, answer)
    elif asked.lumen is not None:
        raise InputError("--lumen goes with a plan: a curve does not state how the file was read")
    else:
        curve = read_points(source)
    return design_routing(
        curve,
        tendons=asked.tendons,
        limits=limits,
        robot=robot,
        duct=duct,
        routing="straight" if asked.straight else "curved",
    )


def read_plan(path: Path) -> Plan:
    """Return the plan in a file."""
    from ..motion.plan import Plan

    return Plan.load(path)


def rebuild_lumen(plan: Plan, path: Path, answer: Answer) -> Duct:
    """Return the lumen that a plan was made in, read from its file again."""
    return reread_tract(plan, path, answer)[1]


def reread_tract(plan: Plan, path: Path, answer: Answer) -> tuple[LabelTract | SurfaceTract, Duct]:
    """Return the tract that a plan was made in, read from its file again, and its lumen.

    Warnings are written at once.

    Raises
    ------
    InputError
        If it is another one.
    """
    from ..motion.verify import is_made_from, read_input, rebuild_field

    known = is_made_from(plan, path)
    if known is False:
        raise InputError(f"{path} is not the file that the plan was made from")
    with answer.show_progress() as progress:
        tract = read_input(plan, path)
        report_findings(tract.findings)
        field = rebuild_field(plan, tract, progress=progress)
    if known is None:
        check_lumen(plan, path, field)
    return tract, field


def check_lumen(plan: Plan, path: Path, lumen: Duct) -> None:
    """Raise `InputError` if a plan's centreline is not as far from a wall as the plan states.

    This is for a plan that does not state its file's hash, as that of the demo.
    """
    import numpy as np

    from ..plot.plan_data import read_centreline

    line = read_centreline(plan)
    off = np.abs(-lumen.signed_distance(line.points) - line.radius)
    place = int(np.nanargmax(off))
    step = np.max(getattr(lumen, "spacing", 0.0))
    if off[place] > 1.5 * step + WALL_DOUBT:
        where = ", ".join(f"{value:.1f}" for value in line.points[place])
        raise InputError(
            f"{path} is not what the plan was made from: at {where} mm its wall is "
            f"{off[place]:.1f} mm from where the plan has it"
        )


def read_points(path: Path) -> NDArray[np.float64]:
    """Return the points (m, 3) [mm] of a table with the columns x, y and z.

    Raises
    ------
    FileFormatError
        If the file cannot be read, or has no such columns.
    """
    import numpy as np

    from ..io.sheets import read_sheet, split_title, take_numbers
    from ..units import parse_unit

    sheet = read_sheet(path)
    places = {name: (k, unit) for k, (name, unit) in enumerate(map(split_title, sheet.titles))}
    for names in (("x_mm", "y_mm", "z_mm"), ("x", "y", "z")):
        if sheet.rows and set(names) <= set(places):
            columns = [
                take_numbers(sheet, place, where=f"{path}: ") * parse_unit(unit or "mm", "length")
                for place, unit in map(places.__getitem__, names)
            ]
            return np.stack(columns, axis=-1)
    if not sheet.rows:
        raise FileFormatError(f"{path} holds no points: it has the names of columns alone")
    raise FileFormatError(
        f"{path} has the columns {', '.join(sheet.titles)}: it needs x, y and z, or x_mm and so on"
    )


def _search_tract(
    tract: Path, reading: ReadOptions, search: RobotSearch, answer: Answer
) -> TractRobot:
    from ..motion.routing import design_robot
    from ..study.case import Case

    read = read_with_options(tract, reading, answer)
    with answer.show_progress() as progress:
        case = Case.open(read, progress=progress)
        return design_robot(case.field, case.line, options=search, progress=progress)


def _give(
    found: RoutingDesign | TractRobot, answer: Answer, figure: Path | None, text: str
) -> None:
    """Write the robot, the picture and the answer, and end with the exit code."""
    if figure is not None:
        from ..plot import write_figure
        from ..plot.routing import draw_design

        write_figure(draw_design(found), figure)
    if found.converged and answer.out is not None:
        found.to_yaml(answer.out)
    written = answer.out if found.converged else None
    answer.give(found.to_dict() | {"file": written, "figure": figure}, text)
    if not found.converged:
        run_exit(EXIT_NEGATIVE)


def _format_design(design: RoutingDesign) -> str:
    """Return a design for people."""
    names = design.robot.tendon_names
    rows = [
        [name, f"{tension:.3f}", f"{pull:z.3f}", f"{by_tension:.2f}", f"{by_pull:.2f}"]
        for name, tension, pull, by_tension, by_pull in zip(
            (*names, "all"),
            (*design.tensions, design.tensions.sum()),
            (*design.displacements, math.nan),
            design.by_tension,
            design.by_displacement,
            strict=True,
        )
    ]
    rows[-1][2] = "-"
    head = ["tendon", "tension [N]", "displacement [mm]", "+1 % tension [mm]", "+0.1 mm [mm]"]
    gap = f", {design.gap:.2f} mm apart" if math.isfinite(design.gap) else ""
    lines = [
        f"a robot of {design.robot.length:.1f} mm with {len(names)} {design.routing} tendon(s): "
        f"{design.error_rms:.3f} mm rms and {ceil_mm(design.error_max, 3)} mm at most from the "
        "curve "
        f"(energy model: {design.energy_error_rms:.3f} and {design.energy_error_max:.3f} mm)",
        f"tendons {design.offset_least:.2f} to {design.offset_most:.2f} mm from the backbone"
        f"{gap}, slope up to {ceil_mm(design.slope, 3)}",
        format_rows(head, rows),
        "the last two columns are how far the backbone moves, without a wall, if an input is off",
    ]
    proof = design.certificate
    if proof is not None and proof.certified:
        lines.append(
            f"the pose is certified at least {floor_mm(proof.clearance, 3)} mm clear of the wall"
        )
    if not design.converged:
        lines.append(f"not within the limits: {design.reason}")
    return "\n".join(lines)


def _format_search(found: TractRobot) -> str:
    """Return the search for a tract's robot for people."""
    rows = [
        [
            f"{trial.diameter:g}",
            f"{trial.sections}{'' if trial.even else ' uneven'}" if trial.sections else "scope",
            f"{trial.head:.1f}",
            floor_mm(trial.clearance, 3) if trial.passed else "-",
        ]
        for trial in found.trials
    ]
    head = ["diameter [mm]", "sections", "head [mm]", "clearance [mm]"]
    lines = [format_rows(head, rows)] if rows else []
    lines += [
        f"{trial.diameter:g} mm, {trial.sections or 'a scope'}"
        f"{'' if trial.even else ' uneven'}: {trial.reason}"
        for trial in found.trials
        if trial.reason
    ]
    high = f"{ceil_mm(found.limits.high)} mm" if math.isfinite(found.limits.high) else "not known"
    lines.append(
        f"bounds: any body below {floor_mm(found.limits.low)} mm passes, none above {high}"
    )
    if found.robot is None:
        return "\n".join([*lines, f"no robot: {found.reason}"])
    bends = [math.degrees(section.max_bend) for section in found.robot.sections]
    lengths = ", ".join(f"{section.length:.1f}" for section in found.robot.sections)
    lines.append(
        f"a robot of {2.0 * found.robot.radius:g} mm with {len(bends)} sections of {lengths} mm, "
        f"bend limits {', '.join(f'{bend:.0f}' for bend in bends)} deg"
    )
    return "\n".join(lines)


@click.command("rank", cls=CheckedCommand)
@click.argument("plan", metavar="PLAN.npz", type=INPUT)
@options_of(InsertionRankOptions, "options")
@option("--modes N,...", "Numbers of routings.", default="4,6,8,10,12,16")
@option("--sections N,...", "Numbers of sections.", default="4,6,8,12")
@answer_options(".csv", *PICTURES, help="The table (.csv) or a picture.")
def rank_command(
    plan: Path, options: InsertionRankOptions, modes: str, sections: str, answer: Answer
) -> None:
    """Find how many tendons the whole way in takes, against sections with as many cables.

    A robot follows its leader along the plan's path. The bound is on the mean square of curvature
    in the linear law; positions are fitted, in the linear law and in the rod's.
    """
    from ..motion.routing import insertion_rank

    asked = replace(
        options,
        modes=_parse_counts("--modes", modes),
        sections=_parse_counts("--sections", sections),
    )
    with answer.show_progress() as progress:
        found = insertion_rank(read_plan(plan), options=asked, progress=progress)
    answer.write(found.list_columns(), found.plot)
    answer.give(found.to_dict() | {"file": answer.out}, _format_rank(found))


def _parse_counts(name: str, text: str) -> tuple[int, ...]:
    """Return whole numbers between commas."""
    try:
        return tuple(int(part) for part in text.split(",") if part.strip())
    except ValueError:
        raise InputError(f"{name} is {text!r}: it must be whole numbers, such as 4,8,12") from None


def _format_rank(found: InsertionRank) -> str:
    """Return the table for people."""

    def show(value: float | None, digits: int) -> str:
        return "-" if value is None else f"{value:.{digits}f}"

    rows = [
        [
            f"{way.count} {'sections' if way.source == 'sections' else f'by {way.source}'}",
            str(way.cables),
            f"{way.bound:.3f}",
            f"{way.rms:.3f}",
            f"{way.largest:.2f}",
            show(way.exact_rms, 3),
            show(way.exact_largest, 2),
            show(way.tension_sum, 1),
        ]
        for way in found.ways
    ]
    head = ["robot", "cables", "bound", "rms [mm]", "max [mm]", "exact rms", "max", "tension [N]"]
    return "\n".join(
        [
            f"follow the leader over {found.length:.1f} mm, {len(found.insertions)} poses",
            format_rows(head, rows),
            "bound: share of the curvature that no routings of that number leave out less of, in "
            "the linear law; it is no bound on positions",
        ]
    )
