"""``bozzini continuum contact`` and ``insert``: an elastic robot against walls, and pushed in."""

from __future__ import annotations

import dataclasses
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..continuum.contact import ContactOptions
from ..errors import InputError
from ..results import Json, format_rows
from ..study.options import PathOptions, ReadOptions
from ..units import parse_quantity
from ._tract_options import (
    check_shape_options,
    note_calibration,
    read_with_options,
    report_findings,
    tract_options,
)
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    OUTPUT,
    PICTURES,
    Answer,
    CheckedCommand,
    QuantityType,
    VectorType,
    answer_options,
    format_csv,
    gather_once,
    option,
    options_of,
    parse_pairs,
    run_exit,
    split_setting,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ..continuum import (
        ContactModel,
        ContactShape,
        ContinuumRobot,
        DriveTable,
        InsertionResult,
        LineLoad,
        PointLoad,
    )
    from ..continuum.checks import Floats
    from ..duct import Centreline, Duct

SHOWN_CONTACTS = 12
"""Contacts that are listed for people, the strongest first."""

contact_options = options_of(ContactOptions, "contact")
path_options = options_of(PathOptions, "options")


LOAD_EXAMPLE = "at=30mm,force=0:0:-1N,frame=body"

obstacle_option = click.option(
    "--obstacle",
    "obstacles",
    multiple=True,
    type=INPUT,
    metavar="SHAPES",
    help="A file of shapes (.json, .yaml) that the robot is outside of; may be repeated.",
)

load_option = option(
    "--load NAME=VALUE,...",
    f"A load on the body, such as {LOAD_EXAMPLE} (at: the tip unless given; moment as force; "
    "frame: base, world or body), or along a part of it, line=0:0:-1N/m,from=10mm,to=30mm; can be "
    "repeated.",
    multiple=True,
)


def parse_load(text: str, flag: str = "--load") -> PointLoad | LineLoad:
    """Return ``NAME=VALUE,...`` as a load; one with ``line`` is along a part of the backbone."""
    from ..continuum import LineLoad, PointLoad

    parts = (split_setting(flag, part.strip(), LOAD_EXAMPLE) for part in text.split(","))
    given = gather_once(flag, parts)
    along = "line" in given
    legal = ("line", "from", "to", "frame") if along else ("at", "force", "moment", "frame")
    for name in given:
        if name not in legal:
            raise InputError(
                f"{flag} names '{name}': a load {'along a line' if along else 'at a point'} has "
                f"{', '.join(legal)}, such as {LOAD_EXAMPLE}"
            )
    if not (along or "force" in given or "moment" in given):
        raise InputError(f"{flag} is '{text}': it has no force, moment or line")
    fields: Json = {"frame": given.get("frame", "base")}
    for name, field, kind in (
        ("at", "arc_length", "length"),
        ("from", "start", "length"),
        ("to", "end", "length"),
    ):
        if name in given:
            fields[field] = parse_quantity(given[name], kind)
    for name, field, kind in (
        ("force", "force", "force"),
        ("moment", "moment", "moment"),
        ("line", "force", "line force"),
    ):
        if name in given:
            fields[field] = _parse_components(f"{flag} {name}", given[name], kind)
    return LineLoad(**fields) if along else PointLoad(**fields)


def _parse_components(name: str, text: str, kind: str) -> tuple[float, ...]:
    """Return ``X:Y:Z`` as numbers; each but 0 has its unit, or none has one."""
    parts = [part.strip() for part in text.split(":")]
    if len(parts) != 3:
        raise InputError(f"{name} is '{text}': it must be X:Y:Z, such as 0:0:-1N")
    values = tuple(parse_quantity(part, kind) for part in parts)
    bare = [part for part, value in zip(parts, values, strict=True) if value and _is_number(part)]
    if bare and not all(_is_number(part) for part in parts):
        raise InputError(f"{name} is '{text}': {bare[0]} has no unit, give each one its own")
    return values


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def read_shapes(source: Path) -> Duct:
    """Return the shapes in a file."""
    from ..duct.shape_files import load_shapes_file

    return load_shapes_file(source).shapes


def read_lumen(
    source: Path, reading: ReadOptions, options: PathOptions, answer: Answer, *, line: bool
) -> tuple[Duct, Centreline | None]:
    """Return the lumen in a file of shapes or a tract, and its centreline if it is asked for."""
    from ..duct.shape_files import SUFFIXES
    from ..study.case import Case
    from ..study.traverse import prepare_duct

    if source.suffix.lower() in SUFFIXES:
        check_shape_options(source, reading)
        duct = read_shapes(source)
        if not line:
            return duct.inflate(options.inflate) if options.inflate else duct, None
        with answer.show_progress() as progress:
            duct, found = prepare_duct(duct, options, progress)
        return duct, found.reverse() if options.reverse else found
    tract = read_with_options(source, reading, answer)
    with answer.show_progress() as progress:
        case = Case.open(tract, options, progress=progress)
        if not line:
            return case.field, None
        report_findings(case.centreline.findings)
    return case.field, case.line


def _read_robot(path: Path) -> ContinuumRobot:
    from ..continuum import ContinuumRobot

    return ContinuumRobot.from_yaml(path)


def _read_commands(
    robot: ContinuumRobot, flag: str, text: str, kind: str, example: str
) -> dict[str, float]:
    owner = f"the tendons of robot '{robot.name}'"
    return parse_pairs(flag, text, kind, example=example, names=robot.tendon_names, owner=owner)


def _spell_options(words: str) -> str:
    """Return a message with options of the model as they are typed."""
    for name in ("segment_length", "smoothing"):
        words = re.sub(rf"\b{name}\b", f"--{name.replace('_', '-')}", words)
    return words


def _list_contacts(shape: ContactShape) -> str:
    import numpy as np

    order = np.argsort(-shape.normal_forces)[:SHOWN_CONTACTS]
    order = np.sort(order[shape.normal_forces[order] > 0.0])
    if not len(order):
        return "it touches no wall"
    rows = [
        [
            f"{shape.arc_length[k]:.2f}",
            ", ".join(f"{value:z.2f}" for value in shape.points[k]),
            f"{shape.normal_forces[k]:.4g}",
        ]
        for k in order
    ]
    return format_rows(["at [mm]", "place [mm]", "force [N]"], rows)


def _describe_shape(shape: ContactShape) -> str:
    tip = ", ".join(f"{value:z.3f}" for value in shape.tip)
    force = ", ".join(f"{value:z.4g}" for value in shape.resultant)
    tensions = [
        f"{name} {value:.4g} N"
        for name, value in zip(shape.robot.tendon_names, shape.tensions, strict=True)
        if value
    ]
    lines = [
        f"tip at {tip} mm; the walls push with {force} N in all",
        _list_contacts(shape),
        f"stability {shape.stability:.3g} (1 as at rest, 0 where it buckles)",
    ]
    return "\n".join([*lines, *(["tendons: " + ", ".join(tensions)] if tensions else [])])


@click.command("contact", cls=CheckedCommand)
@click.argument("robot_file", metavar="ROBOT.yaml", type=INPUT)
@click.argument("source", metavar="[INPUT]", required=False, type=INPUT)
@obstacle_option
@click.option(
    "--displacement",
    metavar="NAME=LENGTH,...",
    help="How far tendons are pulled, such as T1=2mm; those left out follow without tension.",
)
@click.option(
    "--tension",
    metavar="NAME=FORCE,...",
    help="Instead, their tensions, such as T1=2N; 0 for those left out.",
)
@click.option(
    "--tip-force",
    type=VectorType("force"),
    metavar="X,Y,Z",
    help="Force on the tip, in the world's axes.",
)
@load_option
@option("--inserted LENGTH", "Length beyond an introducer at the base (default: all).", "length")
@tract_options
@path_options
@contact_options
@answer_options(".csv", *PICTURES, help="A picture, or the forces as a table (.csv).")
def contact_command(
    robot_file: Path,
    source: Path | None,
    obstacles: tuple[Path, ...],
    displacement: str | None,
    tension: str | None,
    tip_force: tuple[float, float, float] | None,
    load: tuple[str, ...],
    inserted: float | None,
    reading: ReadOptions,
    options: PathOptions,
    contact: ContactOptions,
    answer: Answer,
) -> None:
    """Find the shape of a robot that touches walls, and the forces between them.

    INPUT is a label volume or a surface, as for bozzini plan, or a file of shapes (.json, .yaml):
    the lumen that the robot is in. The robot's base stands where its file states; zeros and scale
    of its calibration hold. Exit code 0:
    there is a shape in stable equilibrium; 1: there is none, and why; 2: bad input.
    """
    from ..continuum import ContactModel, PointLoad

    if displacement is not None and tension is not None:
        raise InputError("contact takes --displacement or --tension: give one of them")
    if source is None and not obstacles:
        raise InputError("contact needs a wall: give INPUT, or --obstacle")
    robot = _read_robot(robot_file)
    loads = tuple(map(parse_load, load))
    if tip_force is not None:
        loads += (PointLoad(force=tip_force, frame="world"),)
    commands: ArrayLike = ()
    if displacement is not None:
        pulls = _read_commands(robot, "--displacement", displacement, "length", "T1=2mm,T2=-1mm")
        commands = robot.to_displacements(robot.order_displacements(pulls))
    elif tension is not None:
        pulls = _read_commands(robot, "--tension", tension, "force", "T1=2N,T2=0.5N")
        commands = robot.to_tensions(robot.order_tensions(pulls))
    duct = None
    if source is not None:
        duct, _ = read_lumen(source, reading, options, answer, line=False)
    model = ContactModel(
        robot,
        duct,
        obstacles=tuple(map(read_shapes, obstacles)),
        loads=loads,
        options=contact,
    )
    with answer.show_progress() as progress:
        progress("contact", 0.0)
        solve = model.shape if tension is None else model.shape_under_tensions
        shape = solve(commands, inserted=inserted)
    result: Json = {"input": source, "file": None, "notes": model.notes} | shape.to_dict()
    if not shape.converged:
        result["reason"] = reason = _spell_options(shape.reason)
        answer.give(result, f"no stable shape: {reason}")
        run_exit(EXIT_NEGATIVE)
    answer.write(shape.list_columns(), shape.plot)
    text = "\n".join([_describe_shape(shape), *(f"note: {line}" for line in model.notes)])
    answer.give(result | {"file": answer.out}, text)


@click.command("insert", cls=CheckedCommand)
@click.argument("robot_file", metavar="ROBOT.yaml", type=INPUT)
@click.argument("source", metavar="INPUT", type=INPUT)
@click.option(
    "--drives",
    type=INPUT,
    metavar="TENDONS.csv",
    help="The time table of the drives that bozzini plan --robot writes (default: passive); the "
    "base stands as in the robot.npz beside it.",
)
@option("--to LENGTH", "Insert as much of the robot (default: all that the lumen holds).", "length")
@click.option("--step", type=QuantityType("length"), help="Largest step (default: two segments).")
@click.option(
    "--contacts",
    "forces",
    type=OUTPUT,
    metavar="FILE.csv",
    help="Also write the contact forces of all steps as a table.",
)
@load_option
@tract_options
@path_options
@contact_options
@answer_options(
    ".csv", *PICTURES, help="A picture, or the force on the base over the insertion (.csv)."
)
def insert_command(
    robot_file: Path,
    source: Path,
    drives: Path | None,
    to: float | None,
    step: float | None,
    forces: Path | None,
    load: tuple[str, ...],
    reading: ReadOptions,
    options: PathOptions,
    contact: ContactOptions,
    answer: Answer,
) -> None:
    """Push a robot into the lumen in INPUT along its centreline, in equilibrium at each step.

    What is not inserted is straight in an introducer at the entry. INPUT is a label volume or a
    surface, as for bozzini plan, or a file of shapes (.json, .yaml). Loads act on what is in; those
    in the base's axes are in those of the introducer. Exit code 0: it goes in; 1: it
    finds no equilibrium, buckles, loops or meets itself, and where; 2: bad input.
    """
    from ..continuum import ContactModel, DriveTable, insert_robot
    from ..io.files import check_new_file, write_text

    if drives is not None and to is not None:
        raise InputError("insert takes --drives or --to: give one of them")
    if forces is not None:
        check_new_file(forces, (".csv",), force=answer.force)
    robot = _read_robot(robot_file)
    if drives is not None:
        note_calibration(robot)
    table = None if drives is None else _read_drives(drives, robot)
    if to is not None:
        table = DriveTable.passive(robot, to)
    duct, line = read_lumen(source, reading, options, answer, line=True)
    model = ContactModel(robot, duct, loads=tuple(map(parse_load, load)), options=contact)
    points = start_inside(model, line)
    with answer.show_progress() as progress:
        found = insert_robot(model, points, drives=table, step=step, progress=progress)
    result: Json = {"input": source, "file": None, "contacts": None, "notes": model.notes}
    found = dataclasses.replace(found, reason=_spell_options(found.reason))
    result |= found.to_dict()
    result["last"]["reason"] = _spell_options(found.last.reason)
    answer.write(found.list_columns(), found.plot)
    if forces is not None:
        write_text(forces, format_csv(found.list_contacts()))
    text = "\n".join([_describe_insertion(found), *(f"note: {line}" for line in model.notes)])
    answer.give(result | {"file": answer.out, "contacts": forces}, text)
    if not found.converged:
        run_exit(EXIT_NEGATIVE)


def _read_drives(path: Path, robot: ContinuumRobot) -> DriveTable:
    """Return a planner's table of drives, with the base frame of the plan that it is from."""
    from ..continuum import DriveTable
    from ..motion.actuate import Actuation

    table = DriveTable.from_csv(path, robot)
    plan = path.parent / "robot.npz"
    if not os.path.isfile(plan):
        return table
    return dataclasses.replace(table, frame=Actuation.load(plan).frame)


def start_inside(model: ContactModel, line: Centreline | None) -> Floats:
    """Return the centreline from the first place on that has room for the body."""
    import numpy as np

    if line is None:
        raise InputError("there is no centreline")
    radius = model.robot.sections[-1].radius
    gaps = np.min([wall.measure(line.points, np.array([radius])) for wall in model.walls], axis=0)
    room = np.flatnonzero(gaps > 0.0)
    if len(room) == 0 or room[0] >= len(line.points) - 1:
        raise InputError(
            f"the centreline has at most {radius + gaps.max():.3g} mm to the wall: the body, of "
            f"radius {radius:g} mm, needs as much"
        )
    return line.points[room[0] :]


def _describe_insertion(found: InsertionResult) -> str:
    last = found.inserted[-1]
    worst = int(abs(found.push_force).argmax())
    lines = [
        f"inserted {last:.1f} mm, the tip {found.tip_progress[-1]:.1f} mm from the entry",
        f"force on the base up to {found.push_force[worst]:.4g} N, at {found.inserted[worst]:.1f} "
        f"mm; of the walls up to {found.largest_force.max():.4g} N at one station",
        _list_contacts(found.last),
    ]
    if not found.converged:
        lines.insert(0, f"it does not go in: {found.reason}")
    return "\n".join(lines)
