"""``bozzini continuum``: displacements to shape and back; comparison and workspace are beside."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import GeometryError, InputError
from .common import (
    EXIT_NEGATIVE,
    PICTURES,
    QuantityType,
    VectorType,
    check_target,
    emit,
    force_option,
    format_csv,
    format_rows,
    json_option,
    progress_bar,
    quiet_option,
    run_exit,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..continuum import ContinuumRobot, Shape, ShapeModel
    from ..continuum.inverse import ContinuumInverse
    from ..continuum.workspace import DexterityMap

# A shape in words and as plain values.

STRAIGHT = 1e-6
"""Bend that counts as none in words [rad]."""


def find_fault(shape: Shape) -> str:
    """Return why a shape is none, in the model's words; else empty."""
    return "" if bool(shape.converged) else str(shape.reason)


def describe_shape(
    robot: ContinuumRobot, displacements: NDArray[np.float64], shape: Shape | None, reason: str
) -> dict[str, Any]:
    """Return a shape as plain values; without its places if there is a reason against it."""
    good = shape is not None and not reason
    result: dict[str, Any] = {"converged": good, "reason": reason}
    tendons: dict[str, dict[str, Any]] = {
        name: {"displacement_mm": displacements[k]} for k, name in enumerate(robot.tendon_names)
    }
    if shape is not None and good:
        for k, row in enumerate(tendons.values()):
            row["length_mm"] = shape.tendon_lengths[k]
            row["slack"] = bool(shape.slack[k])
            row["tension_N"] = shape.tensions[k] if shape.tensions.size else None
        result |= {
            "tip_mm": shape.tip,
            "tip_direction": shape.tip_frame[:3, 2],
            "tip_frame": shape.tip_frame,
            "residual_mm": shape.residual,
            "iterations": shape.iterations,
            "sections": list_bends(robot, shape.section_parameters),
            "arc_length_mm": shape.arc_length,
            "backbone_mm": shape.points,
        }
    return result | {"tendons": tendons}


def list_bends(robot: ContinuumRobot, bends: NDArray[np.float64]) -> list[dict[str, Any]]:
    """Return the bends of sections, shape (m, 2) or (0, 2), as plain values."""
    return [
        {
            "name": robot.sections[k].name,
            "bend_rad": math.hypot(x, y),
            "direction_rad": math.atan2(y, x),
        }
        for k, (x, y) in enumerate(bends.tolist())
    ]


def format_bends(robot: ContinuumRobot, bends: NDArray[np.float64]) -> str:
    """Return the bends of sections for people; a straight one has no direction."""
    rows = []
    for k, row in enumerate(list_bends(robot, bends)):
        angle, towards = math.degrees(row["bend_rad"]), math.degrees(row["direction_rad"])
        told = f"{towards:z.2f}" if row["bend_rad"] > STRAIGHT else "-"
        rows.append([robot.section_label(k), f"{angle:z.2f}", told])
    return format_rows(["section", "bend [deg]", "towards [deg]"], rows)


def format_shape(shape: Shape) -> str:
    """Return a shape for people: tip, sections, tendons."""
    robot = shape.robot
    place = ", ".join(f"{value:z.3f}" for value in shape.tip)
    tangent = shape.tip_frame[:3, 2]
    aside = math.degrees(math.atan2(math.hypot(tangent[0], tangent[1]), tangent[2]))
    lines = [f"tip at {place} mm, looking {aside:.2f} deg away from the base's axis"]
    if len(shape.section_parameters):
        lines.append(format_bends(robot, shape.section_parameters))
    head = ["tendon", "displacement [mm]", "length [mm]"]
    if shape.tensions.size:
        head.append("tension [N]")
    rows = []
    for k, name in enumerate(robot.tendon_names):
        row = [name, f"{shape.displacements[k]:z.4f}", f"{shape.tendon_lengths[k]:.3f}"]
        if shape.tensions.size:
            row.append("slack" if shape.slack[k] else f"{shape.tensions[k]:z.4f}")
        elif shape.slack[k]:
            row.append("slack")
        rows.append(row)
    width = max(map(len, [head, *rows]))
    head += [""] * (width - len(head))
    rows = [row + [""] * (width - len(row)) for row in rows]
    lines.append(format_rows(head, rows))
    return "\n".join(lines)


# What the commands of ``bozzini continuum`` share: the robot, commands of its tendons, models.

MODEL_NAMES = ("arc", "linkage", "energy", "rod")

TAKES = {
    "arc": ("tolerance",),
    "linkage": ("segments", "tolerance"),
    "energy": ("between", "segment", "tendon_stiffness", "tolerance"),
    "rod": (
        "tip_force",
        "distributed_force",
        "tendon_stiffness",
        "between",
        "steps",
        "tolerance",
    ),
}
"""The options that each model has."""

LOADS = ("tip_force", "distributed_force")

DRAWN = 3
"""Stations between two discs of the arc model, for smooth pictures."""

ROUND_OFF = 1e-9
"""Contradiction between displacements that is none [mm]."""

_Function = Callable[..., Any]

robot_argument = click.argument("robot_file", metavar="ROBOT.yaml", type=click.Path(path_type=Path))

displacement_option = click.option(
    "--displacement",
    required=True,
    metavar="NAME=LENGTH,...",
    help="How far tendons are pulled, such as T1=2mm,T2=-1mm; negative lets them out, "
    "and those left out are held where they are at rest.",
)

_OPTIONS = {
    "segments": click.option(
        "--segments",
        type=int,
        help="linkage: segments in each section; by default one ends at each disc.",
    ),
    "segment": click.option(
        "--segment-kind",
        "segment",
        type=click.Choice(["chord", "arc", "channel"]),
        help="energy: straight links, arcs, or arcs with tendons in smooth channels.  "
        "[default: chord]",
    ),
    "between": click.option(
        "--between",
        type=int,
        help="energy, rod: further cross-sections between two discs.  [default: 0]",
    ),
    "steps": click.option(
        "--steps", type=int, help="rod: least number of steps along the robot.  [default: 200]"
    ),
    "tendon_stiffness": click.option(
        "--tendon-stiffness",
        type=QuantityType("force"),
        help="energy, rod: EA of every tendon; by default they do not stretch.",
    ),
    "tip_force": click.option(
        "--tip-force",
        type=VectorType("force"),
        metavar="X,Y,Z",
        help="rod: force on the tip, such as 0,0,-0.1N, in the base's frame; "
        "needs --tendon-stiffness.",
    ),
    "distributed_force": click.option(
        "--line-force",
        "distributed_force",
        type=VectorType("line force"),
        metavar="X,Y,Z",
        help="rod: force per length, weight for example, such as 0,-0.001N/mm,0; likewise.",
    ),
    "tolerance": click.option(
        "--tolerance",
        type=QuantityType("length"),
        default="1um",
        show_default=True,
        help="By how much a command may miss being consistent.",
    ),
}


def model_options(function: _Function) -> _Function:
    """Add the options of all models; they arrive as one mapping, `given`."""

    @wraps(function)
    def run(**values: Any) -> Any:
        given = {name: values.pop(name) for name in _OPTIONS}
        return function(given=given, **values)

    for option in reversed(_OPTIONS.values()):
        option(run)
    return run


def read_robot(path: Path) -> ContinuumRobot:
    """Return the robot in a YAML file.

    Raises
    ------
    FileFormatError
        If it holds none; one line names the file, the field and what is legal.
    """
    from ..continuum import ContinuumRobot

    return ContinuumRobot.from_yaml(path)


def read_parallel_robot(path: Path, command: str) -> ContinuumRobot:
    """Return the robot in a YAML file, for a command that takes its sections for arcs.

    Raises
    ------
    GeometryError
        If a tendon is not parallel to the backbone as far as its section's end.
    """
    from ..continuum.coupling import find_crooked

    robot = read_robot(path)
    crooked = find_crooked(robot)
    if crooked:
        raise GeometryError(
            f"{crooked}: {command} takes sections that bend in arcs, by tendons parallel to the "
            "backbone; only pose and compare take others"
        )
    return robot


def parse_displacements(robot: ContinuumRobot, text: str) -> NDArray[np.float64]:
    """Return ``NAME=LENGTH,...`` as displacements of all tendons [mm], shape (t,).

    Raises
    ------
    InputError
        If a part has no ``=``, a name comes twice, or is not among the robot's tendons.
    """
    import numpy as np

    from ..units import parse_quantity

    names = robot.tendon_names
    found: dict[str, float] = {}
    for part in text.split(","):
        name, mark, value = (word.strip() for word in part.partition("="))
        if not (name and mark and value):
            raise InputError(
                f"--displacement has the part '{part.strip()}': it must be NAME=LENGTH, such as "
                "T1=2mm,T2=-1mm"
            )
        if name not in names:
            raise InputError(
                f"--displacement names '{name}': the tendons of robot '{robot.name}' are "
                f"{', '.join(names) or 'none'}"
            )
        if name in found:
            raise InputError(f"--displacement names '{name}' more than once: give each once")
        found[name] = parse_quantity(value, "length")
    return np.array([found.get(name, 0.0) for name in names])


def make_consistent(
    robot: ContinuumRobot, displacements: NDArray[np.float64], given: Mapping[str, Any]
) -> tuple[NDArray[np.float64], list[str]]:
    """Return displacements without the contradictions of rounding, and a note if there were any.

    Typed numbers miss being consistent by their last digit, which tendons that do not stretch
    would take up by going slack. Parallel tendons that no shape slackens get those of the arcs
    that are nearest, if none is moved by more than the tolerance.
    """
    import numpy as np

    from ..continuum import ArcModel

    try:
        arcs = ArcModel(robot, tolerance=given["tolerance"])
    except GeometryError:
        return displacements, []
    found = arcs.solve(displacements)
    if not bool(found.converged) or bool(found.slack.any()):
        return displacements, []
    moved = float(np.abs(found.misfit).max())
    if moved < ROUND_OFF:
        return displacements, []
    note = f"displacements are moved by up to {moved:.2g} mm, so as to be consistent"
    return displacements - found.misfit, [note]


def choose_model(robot: ContinuumRobot, given: Mapping[str, Any]) -> str:
    """Return the model for a robot where none is asked for: by its loads and its routing."""
    from ..continuum.coupling import find_crooked

    if any(given[name] is not None for name in LOADS):
        return "rod"
    return "energy" if find_crooked(robot) else "arc"


def take_options(name: str, given: Mapping[str, Any], *, strict: bool = True) -> dict[str, Any]:
    """Return those of the options that a model has.

    Raises
    ------
    InputError
        If `strict`, and another one is given.
    """
    for option in given:
        if strict and given[option] is not None and option not in TAKES[name]:
            others = [other for other in MODEL_NAMES if option in TAKES[other]]
            raise InputError(
                f"--{spell_option(option)} is not for the {name} model: it is for "
                f"{' and '.join(others)}"
            )
    return {option: given[option] for option in TAKES[name] if given[option] is not None}


def spell_option(name: str) -> str:
    """Return how the command line calls an option."""
    words = {"segment": "segment-kind", "distributed_force": "line-force"}
    return words.get(name, name.replace("_", "-"))


def make_model(
    name: str, robot: ContinuumRobot, given: Mapping[str, Any], *, strict: bool = True
) -> ShapeModel:
    """Return the model that the options ask for.

    Raises
    ------
    InputError
        If the model does not take such a robot, or an option; or if there are loads, but the
        tendons do not stretch: parallel ones would lock the twist, and round-off decide.
    """
    from ..continuum import MODELS

    options = take_options(name, given, strict=strict)
    for load in LOADS:
        if load in options and "tendon_stiffness" not in options:
            raise InputError(
                f"--{spell_option(load)} needs --tendon-stiffness, EA of the tendons, such as 1e4N "
                "(steel wire of 0.25 mm): tendons that do not stretch lock the backbone's twist"
            )
    if name == "arc":
        options["between"] = DRAWN
    model: ShapeModel = MODELS[name](robot, **options)
    return model


def describe_robot(robot: ContinuumRobot) -> dict[str, Any]:
    """Return a robot as plain values, lengths in mm, angles in rad, stiffnesses in N mm^2."""
    return {"length_mm": robot.length, "radius_mm": robot.radius, **robot.to_dict()}


# ``bozzini continuum compare``: all models on one robot.

REFERENCE = "rod"
LONGEST = 0.3
"""Time spent on measuring the time of one model [s]."""
MOST_RUNS = 25


@click.command("compare")
@robot_argument
@displacement_option
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A picture of the backbones over each other, or the table (.csv).",
)
@model_options
@force_option
@json_option
def compare_command(
    robot_file: Path,
    displacement: str,
    out: Path | None,
    given: Mapping[str, Any],
    force: bool,
    as_json: bool,
) -> None:
    """Compare all models on one robot under one set of displacements.

    Tips are compared with that of the rod, the reference. Loads go to the rod alone: the others
    have none. Times are of one call after the first, the median of several.

    Exit code 0: every model that takes this robot has a shape; 1: one has none, and why is said;
    2: bad input.
    """
    check_target(out, (".csv", *PICTURES), force=force)
    robot = read_robot(robot_file)
    displacements, notes = make_consistent(robot, parse_displacements(robot, displacement), given)
    shapes: dict[str, Shape] = {}
    rows = {name: _try_model(name, robot, displacements, given, shapes) for name in MODEL_NAMES}
    if all(row["refused"] for row in rows.values()):
        raise GeometryError(str(rows[REFERENCE]["reason"]))
    _add_differences(rows, shapes)
    loads = [name for name in LOADS if given[name] is not None]
    if loads:
        notes.append("only the rod bears the load: the others are without")
    if given["tendon_stiffness"] is not None:
        notes.append("tendons stretch in the energy and the rod model only")
    missing = [name for name, row in rows.items() if row["reason"] and not row["refused"]]
    result: dict[str, Any] = {
        "displacements_mm": dict(zip(robot.tendon_names, displacements.tolist(), strict=True)),
        "reference": REFERENCE if REFERENCE in shapes else None,
        "models": rows,
        "notes": notes,
        "robot": describe_robot(robot),
        "file": None,
    }
    if out is not None and shapes:
        _write_comparison(rows, shapes, out)
        result["file"] = out
    text = "\n".join([_format(robot, rows), *(f"note: {line}" for line in notes)])
    emit(result, as_json=as_json, text=text)
    if missing:
        run_exit(EXIT_NEGATIVE)


def _try_model(
    name: str,
    robot: ContinuumRobot,
    displacements: NDArray[np.float64],
    given: Mapping[str, Any],
    shapes: dict[str, Shape],
) -> dict[str, Any]:
    """Return what a model says as plain values, and put its shape, if any, in `shapes`."""
    row: dict[str, Any] = {"refused": False, "converged": False, "reason": ""}
    try:
        model = make_model(name, robot, given, strict=False)
    except GeometryError as error:  # it does not take such a robot at all
        return row | {"refused": True, "reason": str(error)}
    try:
        shape = model.shape(displacements)
    except GeometryError as error:
        return row | {"reason": str(error)}
    reason = find_fault(shape)
    if reason:
        return row | {"reason": reason}
    shapes[name] = shape
    runs: list[float] = []
    begin = time.perf_counter()
    while not runs or (len(runs) < MOST_RUNS and time.perf_counter() - begin < LONGEST):
        start = time.perf_counter()
        model.shape(displacements)
        runs.append(time.perf_counter() - start)
    names = robot.tendon_names
    return row | {
        "converged": True,
        "tip_mm": shape.tip.tolist(),
        "tip_direction": shape.tip_frame[:3, 2].tolist(),
        "time_s": statistics.median(runs),
        "residual_mm": float(shape.residual),
        "iterations": int(shape.iterations),
        "tensions_N": dict(zip(names, shape.tensions.tolist(), strict=True))
        if shape.tensions.size
        else None,
        "slack": [name for name, loose in zip(names, shape.slack, strict=True) if loose],
    }


def _add_differences(rows: Mapping[str, dict[str, Any]], shapes: Mapping[str, Shape]) -> None:
    """Add to each row how far its tip is from the reference's, and how far it looks aside."""
    import numpy as np

    for name, row in rows.items():
        row["tip_from_rod_mm"] = row["direction_from_rod_rad"] = None
        if name in shapes and REFERENCE in shapes:
            ours, theirs = shapes[name].tip_frame, shapes[REFERENCE].tip_frame
            row["tip_from_rod_mm"] = float(np.linalg.norm(ours[:3, 3] - theirs[:3, 3]))
            aside = float(np.linalg.norm(np.cross(ours[:3, 2], theirs[:3, 2])))
            row["direction_from_rod_rad"] = math.atan2(aside, float(ours[:3, 2] @ theirs[:3, 2]))


def _write_comparison(
    rows: Mapping[str, dict[str, Any]], shapes: Mapping[str, Shape], out: Path
) -> None:
    from ..io.files import write_text

    if out.suffix.lower() != ".csv":
        from ..plot import write_figure
        from ..plot.continuum import draw_comparison

        reference = REFERENCE if REFERENCE in shapes else None
        write_figure(draw_comparison(shapes, reference=reference), out)
        return
    fields = ("tip_from_rod_mm", "direction_from_rod_rad", "time_s", "residual_mm", "iterations")
    table: dict[str, list[Any]] = {"model": list(shapes)}
    for k, axis in enumerate("xyz"):
        table[f"tip_{axis}_mm"] = [rows[name]["tip_mm"][k] for name in shapes]
    for field in fields:
        values = [rows[name][field] for name in shapes]
        table[field] = ["" if value is None else value for value in values]
    write_text(out, format_csv(table))


def _format(robot: ContinuumRobot, rows: Mapping[str, dict[str, Any]]) -> str:
    head = ["model", "tip [mm]", "from the rod [mm]", "[deg]", "time [ms]", "residual [mm]"]
    head.append("iterations")
    lines, told = [], []
    for name, row in rows.items():
        if not row["converged"]:
            told.append(f"{name}: {'refused' if row['refused'] else 'no shape'}: {row['reason']}")
            continue
        off, aside = row["tip_from_rod_mm"], row["direction_from_rod_rad"]
        lines.append(
            [
                name,
                ", ".join(f"{value:z.3f}" for value in row["tip_mm"]),
                "-" if off is None else f"{off:.4f}",
                "-" if aside is None else f"{math.degrees(aside):.4f}",
                f"{1e3 * row['time_s']:.3g}",
                f"{row['residual_mm']:.1e}",
                f"{row['iterations']}",
            ]
        )
    text = [format_rows(head, lines)] if lines else []
    pulled = [name for name, row in rows.items() if row["converged"] and row["tensions_N"]]
    if pulled:
        table = [
            [
                tendon,
                *(
                    "slack" if tendon in rows[name]["slack"] else f"{value:z.4f}"
                    for name in pulled
                    for value in [rows[name]["tensions_N"][tendon]]
                ),
            ]
            for tendon in robot.tendon_names
        ]
        text.append(format_rows(["tension [N]", *pulled], table))
    return "\n".join([*text, *told])


# ``bozzini continuum workspace``: where the tip gets, how freely, and the travel that it takes.

FREEDOMS = 5
"""Of a place with a direction."""

CELLS = 30.0
"""Cells along the robot's length, where no size is asked for."""


@click.command("workspace")
@robot_argument
@click.option("--count", default=100_000, show_default=True, help="Shapes that are drawn.")
@click.option("--seed", default=0, show_default=True, help="Of the random numbers.")
@click.option(
    "--cell",
    type=QuantityType("length"),
    help="Edge of a cell of the map; by default a thirtieth of the robot's length.",
)
@click.option(
    "--bend-cap",
    type=QuantityType("angle"),
    default="180deg",
    show_default=True,
    help="Largest bend that is drawn where a section allows more.",
)
@click.option(
    "--in-space",
    is_flag=True,
    help="Map cubes; by default tips are turned about the base's axis into one half-plane.",
)
@click.option(
    "--at",
    "place",
    type=VectorType("length"),
    metavar="X,Y,Z",
    help="Also try in how many directions the tip can look from here, by the inverse.",
)
@click.option("--directions", default=100, show_default=True, help="Number of directions.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="The map as a table (.csv) or a picture.",
)
@quiet_option
@force_option
@json_option
def workspace_command(
    robot_file: Path,
    count: int,
    seed: int,
    cell: float | None,
    bend_cap: float,
    in_space: bool,
    place: tuple[float, ...] | None,
    directions: int,
    out: Path | None,
    quiet: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Draw shapes at random: the tip's workspace, its dexterity, and the tendon travel.

    The sections are arcs; the tendons have to be parallel to the backbone. Shapes are drawn
    evenly in the bends, within the limits of sections and tendons.
    """
    from ..continuum.workspace import (
        map_dexterity,
        measure_dexterity,
        measure_volume,
        sample_workspace,
        tendon_travel,
    )

    check_target(out, (".csv", *PICTURES), force=force)
    robot = read_parallel_robot(robot_file, "workspace")
    edge = robot.length / CELLS if cell is None else _check_cell(cell, robot.length)
    try:
        sample = sample_workspace(robot, count, seed=seed, bend_cap=bend_cap)
    except MemoryError:
        raise InputError(f"--count is {count}: not enough memory for so many shapes") from None
    volume = measure_volume(sample.tips, cell=edge)
    travel = tendon_travel(robot, sample.bends)
    dexterity = map_dexterity(sample, cell=edge, directions=directions, half_plane=not in_space)
    looked = None
    if place is not None:
        with progress_bar(quiet=quiet) as progress:
            looked = measure_dexterity(robot, place, directions=directions, progress=progress)
    if out is not None:
        _write_workspace(dexterity, robot.length, out)
    notes = []
    if place is not None and 2 * len(robot.sections) < FREEDOMS:
        notes.append(
            f"{len(robot.sections)} section(s) have {2 * len(robot.sections)} freedoms, a place "
            f"with a direction needs {FREEDOMS}: the directions at one place have no area"
        )
    best = int(dexterity.direction_share.argmax())
    result = {
        "count": count,
        "seed": seed,
        "reach_mm": volume.reach,
        "hull_mm3": volume.hull,
        "occupied_mm3": volume.occupied,
        "cell_mm": edge,
        "coverage": volume.coverage,
        "tendons": {
            name: {
                "low_mm": travel.low[k],
                "high_mm": travel.high[k],
                "stroke_mm": travel.stroke[k],
                "allowed_mm": travel.allowed[k],
            }
            for k, name in enumerate(travel.names)
        },
        "most_directions": {
            "place_mm": dexterity.centres[best],
            "share": dexterity.direction_share[best],
        },
        "directions_at": None
        if looked is None
        else {"place_mm": looked.place, "share": looked.share},
        "notes": notes,
        "map": _list_columns(dexterity),
        "manipulability_unit": f"mm^{dexterity.rank}/rad^{dexterity.rank}",
        "robot": describe_robot(robot),
        "file": out,
    }
    rows = [
        [name, f"{travel.low[k]:z.3f}", f"{travel.high[k]:z.3f}", f"{travel.stroke[k]:.3f}"]
        for k, name in enumerate(travel.names)
    ]
    x, _, z = dexterity.centres[best]
    lines = [
        f"tips up to {volume.reach:.2f} mm from the base, in a hull of {volume.hull:.4g} mm^3; "
        f"{volume.occupied:.4g} mm^3 in cells of {edge:.3g} mm",
        f"one more shape falls in a known cell in {100.0 * volume.coverage:.1f} % of the cases"
        + ("" if volume.coverage >= 0.9 else ": take more shapes or larger cells"),
    ]
    if not in_space:
        lines.append(
            f"most directions, {100.0 * float(dexterity.direction_share[best]):.0f} %, about "
            f"{x:z.1f} mm from the axis at z = {z:z.1f} mm"
        )
    if looked is not None:
        where = ", ".join(f"{value:zg}" for value in looked.place)
        share = 100.0 * looked.share
        lines.append(f"at {where} mm the tip can look in {share:.0f} % of the directions")
        lines += [f"note: {line}" for line in notes]
    head = ["tendon", "let out [mm]", "pulled [mm]", "stroke [mm]"]
    emit(result, as_json=as_json, text="\n".join([*lines, format_rows(head, rows)]))


def _check_cell(cell: float, length: float) -> float:
    from ..continuum.workspace import check_cell

    try:
        return check_cell(cell, length)
    except InputError as error:
        raise InputError(f"--{error}") from None


def _list_columns(found: DexterityMap) -> dict[str, Any]:
    columns: dict[str, Any] = {
        "from_axis_mm" if found.half_plane else "x_mm": found.centres[:, 0],
        "y_mm": found.centres[:, 1],
        "z_mm": found.centres[:, 2],
        "tips": found.counts,
        "direction_share": found.direction_share,
        "manipulability": found.manipulability,
        "condition": found.condition,
    }
    if found.half_plane:
        del columns["y_mm"]
    return columns


def _write_workspace(found: DexterityMap, length: float, out: Path) -> None:
    from ..io.files import write_text

    if out.suffix.lower() == ".csv":
        write_text(out, format_csv(_list_columns(found)))
        return
    from ..plot import write_figure
    from ..plot.continuum import draw_workspace

    write_figure(draw_workspace(found, length=length), out)


@click.group("continuum")
def command() -> None:
    """Bend a tendon-driven continuum robot: pose, reach, comparison of models, workspace."""


@command.command("pose")
@robot_argument
@displacement_option
@click.option(
    "--model",
    "model_name",
    type=click.Choice(MODEL_NAMES),
    help="By default arc for parallel tendons, energy for others, rod under loads.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A picture, or the backbone as a table (.csv).",
)
@model_options
@force_option
@json_option
def pose_command(
    robot_file: Path,
    displacement: str,
    model_name: str | None,
    out: Path | None,
    given: Mapping[str, Any],
    force: bool,
    as_json: bool,
) -> None:
    """Find the shape of a robot under tendon displacements.

    Exit code 0: there is one; 1: there is none, which tendon or section stops it and by how much
    is said, and nothing is written; 2: bad input.
    """
    from ..errors import GeometryError

    check_target(out, (".csv", *PICTURES), force=force)
    robot = read_robot(robot_file)
    displacements, notes = make_consistent(robot, parse_displacements(robot, displacement), given)
    name = choose_model(robot, given) if model_name is None else model_name
    model = make_model(name, robot, given)
    result: dict[str, Any] = {"model": name, "robot": describe_robot(robot), "file": None}
    result["notes"] = [*notes, *getattr(model, "notes", ())]
    shape = None
    try:
        shape = model.shape(displacements)
        reason = find_fault(shape)
    except GeometryError as error:  # a linkage that does not exist
        reason = str(error)
    result |= describe_shape(robot, displacements, shape, reason)
    if reason or shape is None:
        emit(result, as_json=as_json, text=f"no shape by the {name} model: {reason}")
        run_exit(EXIT_NEGATIVE)
    if out is not None:
        _write_shape(shape, out)
        result["file"] = out
    lines = [f"{name}: {format_shape(shape)}", *(f"note: {line}" for line in result["notes"])]
    emit(result, as_json=as_json, text="\n".join(lines))


@command.command("reach")
@robot_argument
@click.option(
    "--to",
    "target",
    type=VectorType("length"),
    required=True,
    metavar="X,Y,Z",
    help="Where the tip shall be, seen from the base, such as 30mm,10mm,80mm.",
)
@click.option(
    "--direction",
    type=VectorType("dimensionless"),
    metavar="X,Y,Z",
    help="Where it shall look, of any length.",
)
@click.option("--starts", default=16, show_default=True, help="Starts that may be tried.")
@click.option(
    "--smallest-bends", is_flag=True, help="Use the freedom that is left for small bends."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A picture, or the displacements as a table (.csv).",
)
@force_option
@json_option
def reach_command(
    robot_file: Path,
    target: tuple[float, ...],
    direction: tuple[float, ...] | None,
    starts: int,
    smallest_bends: bool,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Find the tendon displacements that bring the tip to a place.

    The sections are arcs; the tendons have to be parallel to the backbone.

    Exit code 0: reached; 1: not reached, the nearest that was found and the reason are said; 2:
    bad input.
    """
    from ..continuum.inverse import solve_tip

    check_target(out, (".csv", *PICTURES), force=force)
    robot = read_parallel_robot(robot_file, "reach")
    found = solve_tip(
        robot, target, direction=direction, starts=starts, smallest_bends=smallest_bends
    )
    reason = found.reason
    needed = _needed_length(robot, target) if not found.success else None
    if needed is not None:
        reason += f"; a section of {needed:.6g} mm would reach it"
    if out is not None and found.success:
        _write_reach(robot, found, target, direction, out)
    result = {
        "target_mm": target,
        "direction": direction,
        "success": found.success,
        "converged": found.converged,
        "reason": reason,
        "tip_mm": found.tip,
        "tip_direction": found.tip_frame[:3, 2],
        "residual_mm": found.residual,
        "angle_rad": found.angle,
        "iterations": found.iterations,
        "starts": found.starts,
        "at_limits": list(found.at_limits),
        "needed_length_mm": needed,
        "sections": list_bends(robot, found.bends),
        "displacements_mm": dict(
            zip(robot.tendon_names, found.displacements.tolist(), strict=True)
        ),
        "robot": describe_robot(robot),
        "file": out if found.success else None,
    }
    emit(result, as_json=as_json, text=_format_reach(robot, found, reason))
    if not found.success:
        run_exit(EXIT_NEGATIVE)


for _command in (compare_command, workspace_command):
    command.add_command(_command)


def _needed_length(robot: ContinuumRobot, target: tuple[float, ...]) -> float | None:
    """Return the length of the one section that would reach a place, where that is the matter."""
    from ..continuum.section_inverse import solve_section

    if len(robot.sections) != 1:
        return None
    section = robot.sections[0]
    alone = solve_section(section.length, target)
    if alone.success or not math.isfinite(alone.needed_length):
        return None
    return alone.needed_length


def _write_shape(shape: Shape, out: Path) -> None:
    from ..io.files import write_text

    if out.suffix.lower() == ".csv":
        columns = {"arc_length_mm": shape.arc_length}
        columns |= {f"{axis}_mm": shape.points[:, k] for k, axis in enumerate("xyz")}
        columns |= {f"tangent_{axis}": shape.frames[:, k, 2] for k, axis in enumerate("xyz")}
        write_text(out, format_csv(columns))
        return
    from ..plot import write_figure
    from ..plot.continuum import draw_shape

    write_figure(draw_shape(shape), out)


def _write_reach(
    robot: ContinuumRobot,
    found: ContinuumInverse,
    target: tuple[float, ...],
    direction: tuple[float, ...] | None,
    out: Path,
) -> None:
    from ..continuum import ArcModel
    from ..io.files import write_text

    if out.suffix.lower() == ".csv":
        columns = {"tendon": robot.tendon_names, "displacement_mm": found.displacements}
        write_text(out, format_csv(columns))
        return
    from ..plot import write_figure
    from ..plot.continuum import draw_shape

    shape = ArcModel(robot, between=3).shape(found.displacements)
    write_figure(draw_shape(shape, target=target, direction=direction), out)


def _format_reach(robot: ContinuumRobot, found: ContinuumInverse, reason: str) -> str:
    place = ", ".join(f"{value:z.3f}" for value in found.tip)
    head = f"reached: tip at {place} mm, {found.iterations} iterations in {found.starts} start(s)"
    if not found.success:
        head = f"not reached: {reason}\nnearest: tip at {place} mm"
    moved = [
        [name, f"{value:z.4f}"]
        for name, value in zip(robot.tendon_names, found.displacements, strict=True)
    ]
    return "\n".join(
        [
            head,
            format_bends(robot, found.bends),
            format_rows(["tendon", "displacement [mm]"], moved),
            *([f"limit: {line}" for line in found.at_limits] if found.success else []),
        ]
    )
