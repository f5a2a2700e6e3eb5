"""``bozzini continuum``: displacements to a shape and back, models side by side, the workspace.

Robots for a curve, a plan or a tract (``design``, ``rank``) are in `bozzini.cli.routing`.
"""

from __future__ import annotations

import dataclasses
import math
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import click

from ..checks import show_apart, spell_option
from ..continuum import CONTINUUM_MODELS, ContactOptions, DynamicsOptions, ElasticModel
from ..continuum.kinematics import LOADS
from ..continuum.predicting import RobotPredicting
from ..continuum.sensing import SensorPlanning
from ..continuum.tracking import ContinuumTracking
from ..errors import GeometryError, InputError, PluginError
from ..fabricate import BodyOptions
from ..io.files import write_text
from ..results import Json, format_rows
from ..study.estimating import ContinuumEstimating
from ..study.options import PathOptions, ReadOptions
from ._tract_options import tract_options
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    PICTURES,
    Answer,
    CheckedGroup,
    Command,
    NameType,
    QuantityType,
    VectorType,
    answer_options,
    describe_classes,
    format_csv,
    format_parts,
    gather,
    make_option,
    option,
    options_of,
    parse_pairs,
    refuse_options,
    run_exit,
    step_option,
)
from .contact import (
    contact_command,
    insert_command,
    load_option,
    obstacle_option,
    parse_load,
    path_options,
    read_lumen,
    read_shapes,
    start_inside,
)
from .fit import command as fit_command
from .fit import parse_settings
from .routing import design_command, rank_command
from .task import make_command
from .tip import InputSpread, draw_options, give_tip_error, parse_deviations, tip_answer

FILMS = (".gif", ".mp4")

if TYPE_CHECKING:
    from ..continuum import (
        ContinuumInverse,
        ContinuumModel,
        ContinuumRobot,
        ContinuumWorkspace,
        InverseOptions,
        MotionCommands,
        Shape,
        ShapeHistory,
    )
    from ..continuum.gradients import ShapeJacobian
    from ..continuum.robot import RobotDesign
    from ..duct import Duct
    from ..numeric.arrays import Floats
    from ..progress import Progress
    from ..study.tip import DrawOptions

STRAIGHT_BEND_RAD = 1e-6
"""Bend that counts as none in words [rad]."""

STATIONS_BETWEEN_DISCS = 3
"""Stations between two discs of the arc model, for smooth pictures."""

ROUND_OFF_MM = 1e-9
"""Contradiction between displacements that is none [mm]."""

REFERENCE_MODEL = "rod"
"""The model with which the others are compared."""

TYPED_TOLERANCE = "1um"
"""How far displacements that are typed may miss being consistent; it is what all models take."""

TIMING_LIMIT_S = 0.3
"""Time spent on measuring the time of one model [s]."""

MOST_RUNS = 25

NEEDED_FREEDOMS = 5
"""Of a place with a direction."""


def _figures() -> ModuleType:
    """Return what draws, which loads matplotlib: only where a picture is asked for."""
    from ..plot import continuum

    return continuum


# Options: a robot, displacements of its tendons, and what its models take.


robot_argument = click.argument("robot_file", metavar="ROBOT.yaml", type=INPUT)

DISPLACEMENT_HELP = (
    "How far tendons are pulled, such as T1=2mm,T2=-1mm; negative lets them out, and those left "
    "out follow the others."
)


def _list_options() -> dict[str, tuple[dataclasses.Field[object], list[str]]]:
    """Return the options of this package's models, each with the names of those that have it."""
    found: dict[str, tuple[dataclasses.Field[object], list[str]]] = {}
    for name, kind in CONTINUUM_MODELS.own.items():
        for item in dataclasses.fields(kind):
            if "quantity" in item.metadata:
                found.setdefault(item.name, (item, []))[1].append(name)
    return found


OPTIONS = _list_options()


def _make_option(name: str) -> Callable[[Command], Command]:
    """Return the option of a field of some models, whose default is left to the model."""
    item, models = OPTIONS[name]
    known, default = item.metadata["quantity"], item.default
    if len(models) == len(CONTINUUM_MODELS.own):
        return make_option(item, default=TYPED_TOLERANCE)
    other: Json = {"help": f"{', '.join(models)}: {known.help}", "default": None}
    if isinstance(default, (int, str)):
        other["help"] += f"  [default: {default}]"
    if isinstance(default, tuple):
        other |= {"type": VectorType(known.kind), "metavar": "X,Y,Z", "multiple": False}
    return make_option(item, show_default=False, **other)


model_options = gather("given", dict, *map(_make_option, OPTIONS))


def read_robot(path: Path) -> ContinuumRobot:
    """Return the robot in a YAML file."""
    from ..continuum import ContinuumRobot

    return ContinuumRobot.from_yaml(path)


def check_arcs(
    robot: ContinuumRobot, command: str, *, others: str = "only pose and compare take others"
) -> None:
    """Raise `GeometryError` unless a robot's tendons are parallel, as a command needs them."""
    from ..continuum.coupling import find_crooked

    crooked = find_crooked(robot)
    if crooked:
        raise GeometryError(
            f"{crooked}: {command} takes sections that bend in arcs, by tendons parallel to the "
            f"backbone; {others}"
        )


def read_displacements(
    robot: ContinuumRobot, text: str | None, *, history: Sequence[str] = ()
) -> Floats:
    """Return ``NAME=LENGTH,...`` as displacements of all tendons [mm], after those of a history.

    They have the shape (h + 1, t), and are converted where the robot is calibrated. Without a text
    all tendons follow.
    """
    import numpy as np

    names, owner = robot.tendon_names, f"the tendons of robot '{robot.name}'"
    spelled = [*(("--history", before) for before in history), ("--displacement", text)]
    found: list[dict[str, float]] = [
        {}
        if part is None
        else parse_pairs(option, part, "length", example="T1=2mm,T2=-1mm", names=names, owner=owner)
        for option, part in spelled
    ]
    commands = np.stack([robot.order_displacements(one) for one in found])
    return robot.to_displacements(commands, in_time=True)


def read_tensions(robot: ContinuumRobot, text: str) -> Floats:
    """Return ``NAME=FORCE,...`` as tensions of all tendons [N], shape (t,), converted."""
    names, owner = robot.tendon_names, f"the tendons of robot '{robot.name}'"
    found = parse_pairs(
        "--tension", text, "force", example="T1=2N,T2=0.5N", names=names, owner=owner
    )
    return robot.to_tensions(robot.order_tensions(found))


def make_consistent(
    robot: ContinuumRobot, displacements: Floats, tolerance: float
) -> tuple[Floats, list[str]]:
    """Return displacements without the contradictions of rounding, and a note if there were any.

    Typed numbers miss being consistent by their last digit, which tendons that do not stretch
    would take up by going slack. Parallel tendons that no shape slackens get those of the arcs
    that are nearest, if none is moved by more than the tolerance.
    """
    import numpy as np

    from ..continuum import ArcModel

    try:
        found = ArcModel(robot, tolerance=tolerance).solve(displacements)
    except GeometryError:
        return displacements, []
    moved = float(np.abs(found.misfit).max())
    if not bool(found.converged) or bool(found.slack.any()) or moved < ROUND_OFF_MM:
        return displacements, []
    note = f"displacements are moved by up to {moved:.2g} mm, so as to be consistent"
    return displacements - found.misfit, [note]


def make_model(
    name: str,
    robot: ContinuumRobot,
    given: Mapping[str, object],
    *,
    strict: bool = True,
    pulled: bool = False,
) -> ContinuumModel:
    """Return the model that the options ask for; unless `strict`, others' options are left out.

    Whether tendons are `pulled` with tensions: then it does not matter how they stretch.
    """
    options = {key: value for key, value in given.items() if value is not None}
    known = {item.name for item in dataclasses.fields(CONTINUUM_MODELS[name])}
    if name == "arc":
        known -= {"between"}  # its stations are for pictures only
    if "loads" in options and "loads" not in known:
        takers = [other for other, kind in CONTINUUM_MODELS.own.items() if hasattr(kind, "loads")]
        raise InputError(
            f"--load is not for the {name} model: it is for {' and '.join(takers) or 'none'}"
        )
    for key in set(options) - known if strict else ():
        item, models = OPTIONS[key]
        others = " and ".join(other for other in models if other != name)
        raise InputError(f"{spell_option(item)} is not for the {name} model: it is for {others}")
    options = {key: value for key, value in options.items() if key in known}
    stretches = pulled or "tendon_stiffness" in options or _stretch(robot)
    for load in LOADS:
        if load in options and not stretches:
            spelled = "--load" if load == "loads" else spell_option(OPTIONS[load][0])
            raise InputError(
                f"{spelled} needs --tendon-stiffness, EA of the tendons, "
                "such as 1e4N (steel wire of 0.25 mm): tendons that do not stretch lock the "
                "backbone's twist"
            )
    if name == "arc":
        options["between"] = STATIONS_BETWEEN_DISCS
    return robot.model(name, **options)


def _stretch(robot: ContinuumRobot) -> bool:
    """Whether each tendon of a robot has a stiffness of its own."""
    return all(math.isfinite(stiffness) for stiffness in robot.tendon_stiffness)


# Results as plain values, as text, and as files.


def describe_robot(robot: ContinuumRobot) -> Json:
    """Return a robot as plain values, lengths in mm, angles in rad, stiffnesses in N mm^2."""
    return {"length_mm": robot.length, "radius_mm": robot.radius, **robot.to_dict()}


def format_place(place: Iterable[float]) -> str:
    """Return a place for people [mm]."""
    return ", ".join(f"{value:z.3f}" for value in place)


def format_bends(robot: RobotDesign, rows: list[Json]) -> str:
    """Return the bends of sections for people; a straight one has no direction."""
    lines = []
    for k, row in enumerate(rows):
        angle, towards = math.degrees(row["bend_rad"]), math.degrees(row["direction_rad"])
        shown = f"{towards:z.2f}" if row["bend_rad"] > STRAIGHT_BEND_RAD else "-"
        lines.append([robot.section_label(k), f"{angle:z.2f}", shown])
    return format_rows(["section", "bend [deg]", "towards [deg]"], lines)


def format_shape(robot: ContinuumRobot, shape: Json) -> str:
    """Return a shape, as of `Shape.to_dict`, for people: tip, sections, tendons."""
    x, y, z = shape["tip_direction"]
    aside = math.degrees(math.atan2(math.hypot(x, y), z))
    place = format_place(shape["tip_mm"])
    placed = "tip_world_mm" in shape
    where = " in the frame of the base" if placed else ""
    lines = [f"tip at {place} mm{where}, looking {aside:.2f} deg away from the base's axis"]
    if placed:
        lines.append(f"in the world at {format_place(shape['tip_world_mm'])} mm")
    if "stability" in shape:
        lines.append(f"stable: as stiff as {shape['stability']:.3g} of the unloaded robot at rest")
    if shape["sections"]:
        lines.append(format_bends(robot, shape["sections"]))
    tendons = shape["tendons"]
    if not tendons:
        return "\n".join(lines)
    pulled = any(row["tension_N"] is not None for row in tendons.values())
    head = ["tendon", "displacement [mm]", "length [mm]"]
    if pulled or any(row["slack"] for row in tendons.values()):
        head.append("tension [N]" if pulled else "")
    rubs = any("end_tension_N" in row for row in tendons.values())
    head += ["at its end [N]"] if rubs else []
    rows = []
    for name, row in tendons.items():
        force = row["tension_N"]
        last = "slack" if row["slack"] else "" if force is None else f"{force:z.4f}"
        cells = [name, f"{row['displacement_mm']:z.4f}", f"{row['length_mm']:.3f}", last]
        cells += [f"{row['end_tension_N']:z.4f}"] if rubs else []
        rows.append(cells[: len(head)])
    return "\n".join([*lines, format_rows(head, rows)])


@click.group("continuum", cls=CheckedGroup)
def command() -> None:
    """Bend a tendon-driven continuum robot: pose, reach, comparison of models, workspace."""


@command.command("models")
@answer_options(quiet=False)
def models_command(answer: Answer) -> None:
    """List the models, those of other installed packages too."""
    rows, text = describe_classes(CONTINUUM_MODELS)
    answer.give({"models": rows}, text)


@command.command("pose")
@robot_argument
@option("--displacement NAME=LENGTH,...", DISPLACEMENT_HELP)
@option(
    "--tension NAME=FORCE,...",
    "Instead, tensions of tendons at the base, such as T1=2N; 0 for those left out.",
)
@load_option
@click.option(
    "--model",
    "model_name",
    type=NameType("model", lambda: CONTINUUM_MODELS, show=True),
    help="By default that of a fit; arc for parallel tendons, energy for others, rod under loads, "
    "tensions or friction.",
)
@option(
    "--history NAME=LENGTH,...",
    "Displacements that come before, from rest, for tendons with friction or backlash; can be "
    "repeated, in the order of time.",
    multiple=True,
)
@model_options
@option(
    "--set settings NAME=VALUE",
    "A further option of the model, such as stretches=true of the rod; can be repeated.",
    multiple=True,
)
@answer_options(
    ".csv", *PICTURES, quiet=False, help="A picture, or the backbone as a table (.csv)."
)
def pose_command(
    robot_file: Path,
    displacement: str | None,
    tension: str | None,
    load: tuple[str, ...],
    history: tuple[str, ...],
    model_name: str | None,
    given: Json,
    settings: tuple[str, ...],
    answer: Answer,
) -> None:
    """Find the shape of a robot under displacements or tensions of its tendons.

    Under loads alone all tendons follow; a robot without tendons needs no more than its file.
    Weight and the pose of the base are in the robot's file. One that `fit` wrote has zeros, scale
    and backlash of the commands as well, and the model that was fitted; markers are then placed in
    the world, with how far predictions miss at such motions, where rows were left out.

    Exit code 0: there is one; 1: there is none, which tendon or section stops it and by how much
    is reported, and nothing is written; 2: bad input.
    """
    if displacement is not None and tension is not None:
        raise InputError("pose takes --displacement or --tension: give one of them")
    if displacement is None and history:
        raise InputError("--history goes with --displacement: give what comes after it")
    robot = read_robot(robot_file)
    given = {**given, "loads": tuple(map(parse_load, load)) or None}
    loaded = any(given.get(name) is not None for name in LOADS)
    if displacement is None and tension is None and robot.tendons and not loaded:
        raise InputError("pose needs --displacement or --tension, or a load: give one of them")
    name = model_name or robot.choose_model(given, pulled=displacement is None)
    settings_given = {**given, **parse_settings([CONTINUUM_MODELS[name]], settings, taken=OPTIONS)}
    model = make_model(name, robot, settings_given, pulled=displacement is None)
    if tension is not None:
        notes = list(model.notes)
        shape = model.shape_under_tensions(read_tensions(robot, tension))
    else:
        moved = read_displacements(robot, displacement, history=history)
        rows = [make_consistent(robot, row, given["tolerance"]) for row in moved]
        (displacements, notes), before = rows[-1], [row for row, _ in rows[:-1]]
        plays = robot.calibration is not None and robot.calibration.backlash > 0.0
        shape = _find_pose(model, displacements, before, plays=plays)
        notes += [*model.notes, *_note_held(model, displacements)]
    result = {"model": model.name, "robot": describe_robot(robot), "file": None, "notes": notes}
    result |= shape.to_dict()
    if not shape.converged:
        answer.give(result, f"no shape by the {model.name} model: {shape.reason}")
        run_exit(EXIT_NEGATIVE)
    answer.write(shape.list_columns(), lambda: _figures().draw_shape(shape))
    seen = _place_markers(robot, shape)
    lines = [f"{model.name}: {format_shape(robot, result)}"]
    if seen:
        command = "displacement" if tension is None else "tension"
        within = None if loaded else _find_band(robot, shape, command, [*seen])
        result |= {"markers_world_mm": seen, "prediction_band": within}
        lines += _format_markers(seen, within)
    lines += [f"note: {line}" for line in notes]
    answer.give(result | {"file": answer.out}, "\n".join(lines))


def _place_markers(robot: ContinuumRobot, shape: Shape) -> dict[str, Floats]:
    """Return where the markers of a calibrated robot are in the world [mm]."""
    from ..continuum.observation import place_markers
    from ..continuum.unknowns import RobotSetup

    setup = RobotSetup.of(robot)
    if not setup.markers:
        return {}
    names = [marker.name for marker in setup.markers]
    return dict(zip(names, place_markers(setup, shape), strict=True))


def _find_band(
    robot: ContinuumRobot, shape: Shape, command: str, markers: Sequence[str]
) -> Json | None:
    """Return how far markers may be off, by the fit of a robot; None if it does not tell.

    It is of the model and the commands that were fitted.
    """
    from ..continuum.predicting import find_band

    known = robot.calibration
    if known is None or (known.model, known.command) != (shape.model, command):
        return None
    band = find_band(robot, shape, markers)
    if band is None:
        return None
    radii = dict(zip(markers, band.radii[0].tolist(), strict=True))
    radii = {name: radius for name, radius in radii.items() if math.isfinite(radius)}
    return {"kind": str(band.kinds[0]), "radii_mm": radii, "level": band.level}


def _format_markers(seen: Mapping[str, Floats], within: Json | None) -> list[str]:
    """Return where markers are, and how far they may be off, for people."""
    radii = {} if within is None else within["radii_mm"]
    lines = [
        f"marker {name} in the world at {format_place(at)} mm"
        + (f", within {radii[name]:.3g} mm" if name in radii else "")
        for name, at in seen.items()
    ]
    if within is not None and radii:
        lines.append(
            f"{within['level']:.0%} of predictions at such motions ({within['kind']}) are so near, "
            "by rows left out of the fit"
        )
    elif within is not None:
        lines.append(
            f"no row of the fit was of such motions ({within['kind']}): how far predictions miss "
            "there is not known"
        )
    return lines


def _note_held(model: ContinuumModel, displacements: Floats) -> list[str]:
    """Return a note on tendons that do not follow, though none was named."""
    held = [
        name
        for name, moved in zip(model.robot.tendon_names, displacements, strict=True)
        if math.isnan(moved) and not model.lets_follow
    ]
    if not held:
        return []
    return [
        f"the {model.name} model holds tendons that are not named where they are at rest: "
        f"{', '.join(held)}"
    ]


def _find_pose(
    model: ContinuumModel, displacements: Floats, before: list[Floats], *, plays: bool
) -> Shape:
    """Return the shape under displacements, after those before it; `plays`: they have backlash."""
    import numpy as np

    from ..continuum import RodModel

    if not before:
        return model.find_shape(displacements)
    if not isinstance(model, RodModel) or not model.robot.tendon_friction.any():
        if plays:
            return model.find_shape(displacements)
        raise InputError(
            f"--history has no effect on the {model.name} model of robot '{model.robot.name}': it "
            "is for the rod model and tendons with friction, and for backlash"
        )
    way = model.trace_displacements(before)
    last = way.pick(-1 if way.converged else int(np.argmin(way.shapes.converged)))
    if not way.converged:
        return dataclasses.replace(last, reason=np.asarray(f"of --history {way.reason}"))
    return model.shape(displacements, initial=last)


def _choose_fitted(robot: ContinuumRobot, names: Sequence[str]) -> str:
    """Return the name of the model that a robot was fitted with if it is legal, else the first."""
    fitted = "" if robot.calibration is None else robot.calibration.model
    return fitted if fitted in names else names[0]


MOTION_ROWS = ("turn_x", "turn_y", "turn_z", "move_x", "move_y", "move_z")
"""Rows of a Jacobian: rotation [rad] and motion [mm] in the base's frame."""

WRENCH_COLUMNS = ("moment_x", "moment_y", "moment_z", "force_x", "force_y", "force_z")


@command.command("jacobian")
@robot_argument
@option("--displacement NAME=LENGTH,...", DISPLACEMENT_HELP)
@option("--tension NAME=FORCE,...", "Instead, tensions of tendons at the base; 0 if left out.")
@option("--load NAME=VALUE,...", "A load on the body, see pose; can be repeated.", multiple=True)
@option(
    "--at place LENGTH", "Arc length, moved to the nearest station (default: the tip).", "length"
)
@option("--model model_name NAME", "By default that of a fit, or energy.", ("energy", "rod"))
@model_options
@answer_options(".csv", quiet=False, help="The derivatives as a table (.csv).")
def jacobian_command(
    robot_file: Path,
    displacement: str | None,
    tension: str | None,
    load: tuple[str, ...],
    place: float | None,
    model_name: str | None,
    given: Json,
    answer: Answer,
) -> None:
    """Differentiate a shape: how the tip moves and turns with tendons, loads, routing and base.

    With displacements their tendons hold while loads, routing or base change, with tensions these
    do. By the base is the motion in the world, seen from the base.

    Exit code 0: there is a shape; 1: there is none; 2: bad input.
    """
    import numpy as np

    if (displacement is None) == (tension is None):
        raise InputError("jacobian takes --displacement or --tension: give one of them")
    robot = read_robot(robot_file)
    given = {**given, "loads": tuple(map(parse_load, load)) or None}
    model_name = model_name or _choose_fitted(robot, ("energy", "rod"))
    model = make_model(model_name, robot, given, pulled=tension is not None)
    if place is not None and not 0.0 <= place <= robot.length:
        shown = show_apart(place, robot.length)
        raise InputError(f"--at is {shown[0]} mm: it must lie in [0, {shown[1]}] mm")
    if not isinstance(model, ElasticModel):
        raise InputError(f"the {model_name} model has no derivatives: take --model energy")
    if tension is not None:
        shape = model.shape_under_tensions(read_tensions(robot, tension))
    else:
        shape = model.find_shape(read_displacements(robot, str(displacement))[0])
    verdict = {"model": model.name, "converged": bool(shape.converged), "reason": str(shape.reason)}
    verdict["notes"] = model.notes
    if not shape.converged:
        answer.give(verdict, f"no shape by the {model.name} model: {shape.reason}")
        run_exit(EXIT_NEGATIVE)
    found = model.jacobian(shape, held="displacements" if tension is None else "tensions")
    index = int(np.argmin(np.abs(found.arc_length - (robot.length if place is None else place))))
    blocks = _list_derivatives(robot, found, index)
    result = verdict | {
        "held": found.held,
        "arc_length_mm": float(found.arc_length[index]),
        "rows": MOTION_ROWS,
        "tip_mm": shape.tip,
        **{name: columns for name, _, columns in blocks},
        "robot": describe_robot(robot),
        "file": answer.out,
    }
    lines = [
        f"at {found.arc_length[index]:.6g} mm, turns in rad and moves in mm, {found.held} held"
    ]
    table: Json = {"row": MOTION_ROWS}
    for name, unit, columns in blocks:
        rows = zip(MOTION_ROWS, *columns.values(), strict=True)
        cells = [[row, *(f"{value:.4g}" for value in values)] for row, *values in rows]
        lines.append(format_rows([f"{name.replace('_', ' ')} [{unit}]", *columns], cells))
        table |= {f"{name}_{column}": values for column, values in columns.items()}
    lines += [f"note: {line}" for line in model.notes]
    if answer.out is not None:
        write_text(answer.out, format_csv(table))
    answer.give(result, "\n".join(lines))


@command.command("tip-error")
@robot_argument
@option("--displacement NAME=LENGTH,...", DISPLACEMENT_HELP)
@option("--tension NAME=FORCE,...", "Instead, tensions of tendons at the base; 0 if left out.")
@gather(
    "spread",
    InputSpread,
    option(
        "--displacement-sd command_sd",
        "Standard deviation of each displacement that is given.",
        "length",
        default="0mm",
    ),
    option(
        "--tension-sd", "Standard deviation of each tension that is given.", "force", default="0N"
    ),
    option(
        "--sd deviations NAME=VALUE",
        "Standard deviation of a number of the robot, as 'fit' names them: relative for those that "
        "it changes by a factor, as in sections.1.bending_stiffness=0.05, else with its unit, as "
        "in tendons.T1.zero=0.02mm. Can be repeated.",
        multiple=True,
    ),
    option(
        "--fit FIT.json",
        "What 'bozzini continuum fit ROBOT.yaml DATA.csv --json' wrote: the covariance of the "
        "numbers that were fitted. Of a robot that has others, those of the fit are taken.",
        INPUT,
    ),
)
@draw_options
@tip_answer
def tip_error_command(
    robot_file: Path,
    displacement: str | None,
    tension: str | None,
    spread: InputSpread,
    options: DrawOptions,
    answer: Answer,
) -> None:
    """Tell how far errors move the tip from where the model puts it.

    Errors of commands and of numbers of the robot are propagated to first order, as an ellipsoid,
    and drawn and computed exactly beside it. Measured poses are off by the error of the model as
    well, which is not in it: how far rows left out of the fit were missed stands beside it, where
    it is known. Places are in the frame of the robot's base. Tendons that are left out follow the
    others.

    Exit code 0: done; 1: the two differ by more than 10 %, take the draws; 2: bad input.
    """
    from ..continuum.unknowns import FIELDS
    from ..study.tip import Errors, is_factor, read_robot_fit, robot_tip_error
    from ..units import INTERNAL_UNITS

    if (displacement is None) == (tension is None):
        raise InputError("tip-error takes --displacement or --tension: give one of them")
    pulled = tension is not None
    refuse_options(["command_sd" if pulled else "tension_sd"], "without its commands")
    robot = read_robot(robot_file)
    commands = parse_pairs(
        "--tension" if pulled else "--displacement",
        str(tension if pulled else displacement),
        "force" if pulled else "length",
        example="T1=2N" if pulled else "T1=2mm",
        names=robot.tendon_names,
        owner=f"the tendons of robot '{robot.name}'",
    )
    kinds = {unit: kind for kind, unit in INTERNAL_UNITS.items()} | {"": "dimensionless"}
    units = {name: known.unit for fields in FIELDS.values() for name, known in fields.items()}

    def find_unit(name: str) -> str:
        return "" if is_factor(name) else units.get(name.rpartition(".")[2], "")

    deviations = parse_deviations(
        spread.deviations,
        lambda name: kinds[find_unit(name)],
        example="sections.1.bending_stiffness=0.05",
    )
    errors = Errors.independent(deviations, {name: find_unit(name) for name in deviations})
    notes: tuple[str, ...] = ()
    if spread.fit is not None:
        fit = read_robot_fit(spread.fit)
        robot, notes = fit.take_robot(robot)
        errors = errors.join(fit.errors)
    found = robot_tip_error(
        robot,
        commands,
        held="tensions" if pulled else "displacements",
        command_sd=spread.tension_sd if pulled else spread.command_sd,
        parameters=errors,
        options=options,
    )
    more = {"commands": commands, "robot": describe_robot(robot)}
    give_tip_error(found, more, answer, notes=notes)


def _list_derivatives(
    robot: ContinuumRobot, found: ShapeJacobian, index: int
) -> list[tuple[str, str, dict[str, Floats]]]:
    """Return name, unit and columns of the derivatives at one station."""
    pulled = found.held == "tensions"
    name, unit = ("by_tension", "1/N") if pulled else ("by_displacement", "1/mm")
    known = robot.calibration
    same = known is not None and known.command == ("tension" if pulled else "displacement")
    scale = known.scale if known is not None and same else 1.0
    tendons = scale * (found.by_tension if pulled else found.by_displacement)[index]
    wrench = found.by_tip_wrench[index]
    return [
        (name, unit, _name_tendons(robot, tendons)),
        ("by_tip_wrench", "1/N mm, 1/N", dict(zip(WRENCH_COLUMNS, wrench.T, strict=True))),
        ("by_offset", "by relative change", _name_tendons(robot, found.by_routing[index, ..., 0])),
        ("by_clocking", "1/rad", _name_tendons(robot, found.by_routing[index, ..., 1])),
        ("by_base", "1/rad, 1/mm", dict(zip(MOTION_ROWS, found.by_base[index].T, strict=True))),
    ]


def _name_tendons(robot: ContinuumRobot, rows: Floats) -> dict[str, Floats]:
    """Return columns (6, t) by the names of tendons."""
    return dict(zip(robot.tendon_names, rows.T, strict=True))


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
@option(
    "--model model_name NAME",
    "arc, for parallel tendons; or energy or rod, for any: then the least tensions are found, "
    "under loads and weight.  [default: that of a fit, or arc]",
    ("arc", "energy", "rod"),
)
@option("--load NAME=VALUE,...", "A load on the body, see pose; can be repeated.", multiple=True)
@model_options
@click.option("--starts", type=int, help="Starts that may be tried (default: 16, 8 with tensions).")
@click.option(
    "--smallest-bends", is_flag=True, help="arc: use the freedom that is left for small bends."
)
@answer_options(
    ".csv", *PICTURES, quiet=False, help="A picture, or the displacements as a table (.csv)."
)
def reach_command(
    robot_file: Path,
    target: tuple[float, ...],
    direction: tuple[float, ...] | None,
    model_name: str | None,
    load: tuple[str, ...],
    given: Json,
    starts: int | None,
    smallest_bends: bool,
    answer: Answer,
) -> None:
    """Find the tendon displacements that bring the tip to a place.

    Of a robot that `fit` wrote, what is to be commanded for them is given as well. By default the
    sections are arcs; then the tendons have to be parallel to the backbone.

    Exit code 0: reached; 1: not reached, the nearest that was found and the reason are reported; 2:
    bad input.
    """
    robot = read_robot(robot_file)
    model_name = model_name or _choose_fitted(robot, ("arc", "energy", "rod"))
    arcs = model_name == "arc"
    if arcs:
        check_arcs(robot, "reach", others="give --model energy or --model rod")
    given = {**given, "loads": tuple(map(parse_load, load)) or None}
    model = make_model(model_name, robot, given, pulled=True)
    if smallest_bends and not arcs:
        raise InputError(f"--smallest-bends is not for the {model_name} model: it is for arc")
    options: InverseOptions = {} if starts is None else {"starts": starts}
    if arcs:
        options["smallest_bends"] = smallest_bends
    found = robot.inverse(target, direction=direction, model=model, **options)
    needed = _find_needed_length(robot, target) if arcs and not found.converged else None
    result = found.to_dict()
    commands = _find_commands(robot, found)
    result |= commands
    result |= {
        "success": found.converged,
        "converged": result.pop("settled"),
        "target_mm": target,
        "direction": direction,
        "needed_length_mm": needed,
        "robot": describe_robot(robot),
        "file": answer.out if found.converged else None,
    }
    if needed is not None:
        result["reason"] += f"; a section of {needed:.6g} mm would reach it"
    if found.converged:
        answer.write(
            found.list_columns(),
            lambda: _figures().draw_shape(found.shape(), target=target, direction=direction),
        )
    answer.give(result, _format_reach(found, result["reason"], commands))
    if not found.converged:
        run_exit(EXIT_NEGATIVE)


def _find_needed_length(robot: ContinuumRobot, target: tuple[float, ...]) -> float | None:
    """Return the length of the one section that would reach a place, if its length is the limit."""
    from ..continuum import solve_section

    if len(robot.sections) != 1:
        return None
    alone = solve_section(robot.sections[0].length, target)
    known = not alone.converged and math.isfinite(alone.needed_length)
    return alone.needed_length if known else None


def _find_commands(robot: ContinuumRobot, found: ContinuumInverse) -> dict[str, dict[str, float]]:
    """Return what is to be commanded of a calibrated robot, by its key."""
    if robot.calibration is None:
        return {}
    pulled = robot.calibration.command == "tension"
    values = found.tensions if pulled else found.displacements
    if not values.size:  # arcs have no tensions
        return {}
    moved = robot.to_commands(values).tolist()
    named = dict(zip(robot.tendon_names, moved, strict=True))
    return {"commands_N" if pulled else "commands_mm": named}


def _format_reach(
    found: ContinuumInverse, reason: str, commands: Mapping[str, Mapping[str, float]]
) -> str:
    place, result = format_place(found.tip), found.to_dict()
    head = f"reached: tip at {place} mm, {found.iterations} iterations in {found.starts} start(s)"
    if not found.converged:
        head = f"not reached: {reason}\nnearest: tip at {place} mm"
    moved = [[name, f"{value:z.4f}"] for name, value in result["displacements_mm"].items()]
    titles = ["tendon", "displacement [mm]"]
    if "tensions_N" in result:
        titles.append("tension [N]")
        for row, pull in zip(moved, result["tensions_N"].values(), strict=True):
            row.append(f"{pull:z.4f}")
    for key, named in commands.items():
        titles.append(f"command [{key.partition('_')[2]}]")
        for row, value in zip(moved, named.values(), strict=True):
            row.append(f"{value:z.4f}")
    return "\n".join(
        [
            head,
            *([format_bends(found.robot, result["sections"])] if result["sections"] else []),
            format_rows(titles, moved),
            *([f"limit: {line}" for line in found.at_limits] if found.converged else []),
        ]
    )


# All models on one robot.


@command.command("compare")
@robot_argument
@option("--displacement NAME=LENGTH,...", DISPLACEMENT_HELP, required=True)
@model_options
@answer_options(
    ".csv",
    *PICTURES,
    quiet=False,
    help="A picture of the backbones over each other, or the table (.csv).",
)
def compare_command(robot_file: Path, displacement: str, given: Json, answer: Answer) -> None:
    """Compare all models on one robot under one set of displacements.

    Tips are compared with that of the rod, the reference. Loads go to the energy and the rod model:
    the others have none. Times are of one call after the first, the median of several.

    Exit code 0: every model that takes this robot has a shape; 1: one has none, with the reason;
    2: bad input.
    """
    robot = read_robot(robot_file)
    displacements, notes = make_consistent(
        robot, read_displacements(robot, displacement)[0], given["tolerance"]
    )
    shapes: dict[str, Shape] = {}
    rows: dict[str, Json] = {}
    for name in CONTINUUM_MODELS:
        rows[name] = {"refused": False, "converged": False, "reason": ""}
        try:
            model = make_model(name, robot, given, strict=False)
            shape = model.find_shape(displacements)
            notes += _note_held(model, displacements)
        except (GeometryError, PluginError) as error:  # it takes no such robot, or is broken
            rows[name] |= {"refused": True, "reason": str(error)}
            continue
        rows[name]["reason"] = str(shape.reason)
        if shape.converged:
            shapes[name] = shape
            rows[name] |= _describe_model(shape, _measure_time(model, displacements))
    if all(row["refused"] for row in rows.values()):
        raise GeometryError(str(rows[REFERENCE_MODEL]["reason"]))
    _add_differences(rows, shapes)
    if any(given.get(name) is not None for name in LOADS):
        notes.append("the energy and the rod model bear the load: the others are without")
    if robot.tendon_friction.any():
        notes.append("only the rod has the friction of the tendons: the others are without")
    if given["tendon_stiffness"] is not None:
        notes.append("tendons stretch in the energy and the rod model only")
    reference = REFERENCE_MODEL if REFERENCE_MODEL in shapes else None
    if shapes:
        answer.write(
            _list_columns(rows, shapes),
            lambda: _figures().draw_comparison(shapes, reference=reference),
        )
    result = {
        "displacements_mm": dict(zip(robot.tendon_names, displacements.tolist(), strict=True)),
        "reference": reference,
        "models": rows,
        "notes": notes,
        "robot": describe_robot(robot),
        "file": answer.out if shapes else None,
    }
    text = "\n".join([_format_comparison(robot, rows), *(f"note: {line}" for line in notes)])
    answer.give(result, text)
    if any(row["reason"] and not row["refused"] for row in rows.values()):
        run_exit(EXIT_NEGATIVE)


def _measure_time(model: ContinuumModel, displacements: Floats) -> float:
    runs: list[float] = []
    begin = time.perf_counter()
    while not runs or (len(runs) < MOST_RUNS and time.perf_counter() - begin < TIMING_LIMIT_S):
        start = time.perf_counter()
        model.find_shape(displacements)
        runs.append(time.perf_counter() - start)
    return statistics.median(runs)


def _describe_model(shape: Shape, seconds: float) -> Json:
    """Return what a comparison holds of a model's shape."""
    plain = shape.to_dict()
    row = {
        name: plain[name]
        for name in ("converged", "tip_mm", "tip_direction", "residual_mm", "iterations")
    }
    tendons = plain["tendons"]
    pulls = {name: tendon["tension_N"] for name, tendon in tendons.items()}
    return row | {
        "time_s": seconds,
        "tensions_N": pulls if shape.tensions.size else None,
        "slack": [name for name, tendon in tendons.items() if tendon["slack"]],
    }


def _add_differences(rows: Mapping[str, Json], shapes: Mapping[str, Shape]) -> None:
    """Add to each row how far its tip is from the reference's, and how far it looks aside."""
    import numpy as np

    for name, row in rows.items():
        row["tip_from_rod_mm"] = row["direction_from_rod_rad"] = None
        if name in shapes and REFERENCE_MODEL in shapes:
            ours, theirs = shapes[name].tip_frame, shapes[REFERENCE_MODEL].tip_frame
            row["tip_from_rod_mm"] = float(np.linalg.norm(ours[:3, 3] - theirs[:3, 3]))
            aside = float(np.linalg.norm(np.cross(ours[:3, 2], theirs[:3, 2])))
            row["direction_from_rod_rad"] = math.atan2(aside, float(ours[:3, 2] @ theirs[:3, 2]))


def _list_columns(rows: Mapping[str, Json], shapes: Mapping[str, Shape]) -> dict[str, list[object]]:
    fields = ("tip_from_rod_mm", "direction_from_rod_rad", "time_s", "residual_mm", "iterations")
    places = zip(*(rows[name]["tip_mm"] for name in shapes), strict=True)
    tips = {f"tip_{axis}_mm": list(place) for axis, place in zip("xyz", places, strict=True)}
    return {
        "model": list(shapes),
        **tips,
        **{field: [rows[name][field] for name in shapes] for field in fields},
    }


def _format_comparison(robot: ContinuumRobot, rows: Mapping[str, Json]) -> str:
    head = ["model", "tip [mm]", "from the rod [mm]", "[deg]", "time [ms]", "residual [mm]"]
    lines, missing = [], []
    for name, row in rows.items():
        if not row["converged"]:
            what = "refused" if row["refused"] else "no shape"
            missing.append(f"{name}: {what}: {row['reason']}")
            continue
        off, aside = row["tip_from_rod_mm"], row["direction_from_rod_rad"]
        lines.append(
            [
                name,
                format_place(row["tip_mm"]),
                "-" if off is None else f"{off:.4f}",
                "-" if aside is None else f"{math.degrees(aside):.4f}",
                f"{1e3 * row['time_s']:.3g}",
                f"{row['residual_mm']:.1e}",
                f"{row['iterations']}",
            ]
        )
    text = [format_rows([*head, "iterations"], lines)] if lines else []
    pulled = {name: row for name, row in rows.items() if row.get("tensions_N")}
    if pulled:
        table = []
        for tendon in robot.tendon_names:
            cells = [
                "slack" if tendon in row["slack"] else f"{row['tensions_N'][tendon]:z.4f}"
                for row in pulled.values()
            ]
            table.append([tendon, *cells])
        text.append(format_rows(["tension [N]", *pulled], table))
    return "\n".join([*text, *missing])


# Where the tip gets, how freely, and the travel that it takes.


@command.command("workspace")
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
@answer_options(".csv", *PICTURES, help="The map as a table (.csv) or a picture.")
def workspace_command(robot_file: Path, answer: Answer, **asked: Any) -> None:
    """Draw shapes at random: the tip's workspace, its dexterity, and the tendon travel.

    The sections are arcs; the tendons have to be parallel to the backbone. Shapes are drawn
    evenly in the bends, within the limits of sections and tendons.
    """
    from ..continuum import measure_dexterity, measure_workspace, sample_workspace
    from ..continuum.checks import check_cell

    robot = read_robot(robot_file)
    check_arcs(robot, "workspace")
    count, seed, place = asked["count"], asked["seed"], asked["place"]
    if asked["cell"] is not None:
        try:
            check_cell(asked["cell"], robot.length)
        except InputError as error:
            raise InputError(f"--{error}") from None
    try:
        sample = sample_workspace(robot, count, seed=seed, bend_cap=asked["bend_cap"])
    except MemoryError:
        raise InputError(f"--count is {count}: not enough memory for so many shapes") from None
    found = measure_workspace(
        sample,
        cell=asked["cell"],
        directions=asked["directions"],
        half_plane=not asked["in_space"],
    )
    notes, looked = [], None
    if place is not None:
        with answer.show_progress() as progress:
            looked = measure_dexterity(
                robot, place, directions=asked["directions"], progress=progress
            )
        freedoms = 2 * len(robot.sections)
        if freedoms < NEEDED_FREEDOMS:
            notes.append(
                f"{len(robot.sections)} section(s) have {freedoms} freedoms, a place with a "
                f"direction needs {NEEDED_FREEDOMS}: the directions at one place have no area"
            )
    answer.write(
        found.list_columns(), lambda: _figures().draw_workspace(found.map, length=robot.length)
    )
    verdict = ("converged", "reason", "residual")  # the answer has the coverage for them
    result = {name: value for name, value in found.to_dict().items() if name not in verdict} | {
        "count": count,
        "seed": seed,
        "directions_at": looked and {"place_mm": looked.place, "share": looked.share},
        "notes": notes,
        "robot": describe_robot(robot),
        "file": answer.out,
    }
    lines = _format_workspace(found)
    if looked is not None:
        where = ", ".join(f"{value:zg}" for value in looked.place)
        share = 100.0 * looked.share
        lines.append(f"at {where} mm the tip can look in {share:.0f} % of the directions")
    rows = [
        [name, *(f"{row[key]:z.3f}" for key in ("low_mm", "high_mm", "stroke_mm"))]
        for name, row in result["tendons"].items()
    ]
    table = format_rows(["tendon", "let out [mm]", "pulled [mm]", "stroke [mm]"], rows)
    answer.give(result, "\n".join([*lines, *(f"note: {line}" for line in notes), table]))


def _format_workspace(found: ContinuumWorkspace) -> list[str]:
    volume = found.volume
    again = "" if found.converged else f": {found.reason}"
    lines = [
        f"tips up to {volume.reach:.2f} mm from the base, in a hull of {volume.hull:.4g} mm^3; "
        f"{volume.occupied:.4g} mm^3 in cells of {volume.cell:.3g} mm",
        f"one more shape falls in a known cell in {100.0 * volume.coverage:.1f} % of the cases"
        + again,
    ]
    if found.map.half_plane:
        (x, _, z), share = found.map.most_directions
        lines.append(
            f"most directions, {100.0 * share:.0f} %, about {x:z.1f} mm from the axis at "
            f"z = {z:z.1f} mm"
        )
    return lines


# Motion in time.


@command.command("simulate")
@robot_argument
@click.argument("table", metavar="TABLE.csv", type=INPUT)
@click.option("--tract", type=INPUT, metavar="INPUT", help="What the body touches, as of insert.")
@option("--speed SPEED", "Push it into --tract, from an introducer before the entry.", "speed")
@option("--drive-rate SPEED", "Largest speed of drives to displacements.", "speed")
@load_option
@option(
    "--held-by NAME=VALUE,...",
    "What holds it until the first time in place of --load, as that; can be repeated.",
    multiple=True,
)
@click.option("--free", is_flag=True, help="Let the base go at the first time.")
@click.option(
    "--gravity",
    type=VectorType("dimensionless"),
    metavar="X,Y,Z",
    help="Acceleration of free fall in the world [m/s^2] (default: 0,0,-9.80665).",
)
@obstacle_option
@tract_options
@path_options
@options_of(ContactOptions, "contact", leave_out=("wall_stiffness", "segment_length", "tolerance"))
@option("--wall-stiffness PRESSURE", "Stiffness of walls per length of the body.", "pressure")
@options_of(DynamicsOptions, "dynamics")
@answer_options(
    *(".csv", ".html", ".mcap", *FILMS, *PICTURES),
    help="Tip, tendons and energies by time (.csv), a picture of the tip, or the robot in 3-D: a "
    "page (.html), a film of it (.gif, .mp4) or a log of ROS 2 messages (.mcap).",
)
def simulate_command(
    robot_file: Path,
    table: Path,
    tract: Path | None,
    speed: float | None,
    drive_rate: float | None,
    load: tuple[str, ...],
    held_by: tuple[str, ...],
    free: bool,
    gravity: tuple[float, float, float] | None,
    obstacles: tuple[Path, ...],
    wall_stiffness: float | None,
    reading: ReadOptions,
    options: PathOptions,
    contact: ContactOptions,
    dynamics: DynamicsOptions,
    answer: Answer,
) -> None:
    """Simulate a robot under commands of its tendons over time, from rest under the first ones.

    TABLE has 'time [s]', and 'T1 tension [N]' or 'T1 displacement [mm]' of tendons; between rows
    they change evenly, and there is a row of the answer for each. Masses follow from the weights in
    the robot file. Tendons have no mass; their displacements need their stiffness. At the start
    those with friction hold their tension evenly. A calibrated robot converts the commands, as in
    pose; places are in the frame of the base at rest. The walls of --tract and --obstacle give way
    (--wall-stiffness); with --speed the base is pushed in from the first time on, until the whole
    robot is in.

    TABLE may also have 'load 1', by what the first --load is multiplied, and so on; and where the
    base is, in its frame at rest: 'base x [mm]', y and z, and 'base rx [deg]', ry and rz, a
    rotation vector. What it does not have is 1, and 0.

    Exit code 0: simulated to the end; 1: not, and where, or energy came from nowhere; 2: bad input.
    """
    from ..continuum import ContactModel, push_in, read_timed_commands, simulate, write_mcap
    from ..io.mcap import check_mcap

    logged = answer.out is not None and answer.out.suffix.lower() == ".mcap"
    if answer.out is not None and logged:
        check_mcap(answer.out)
    if answer.out is not None and answer.out.suffix.lower() in FILMS:
        from ..scene.film import check_view_film

        check_view_film(answer.out)
    robot = read_robot(robot_file)
    given = read_timed_commands(table, robot)
    duct: Duct | None = None
    commands: MotionCommands = {
        "loads": [parse_load(text) for text in load],
        "load_factors": given.take_factors(len(load)),
        "base": given.base,
        "free": free,
    }
    if gravity is not None:
        dynamics = dataclasses.replace(dynamics, gravity=gravity)
    contact = dataclasses.replace(contact, wall_stiffness=wall_stiffness)
    if given.command == "tension":
        commands["tensions"] = robot.to_tensions(given.commands)
    else:
        commands["displacements"] = robot.to_displacements(given.commands, in_time=True)
    if drive_rate is not None:
        known = robot.calibration
        commands["drive_rate"] = drive_rate * (known.scale if known is not None else 1.0)
    placed: RobotDesign = robot
    if tract is not None:
        duct, line = read_lumen(tract, reading, options, answer, line=speed is not None)
        commands |= {"duct": duct}
        if line is not None and speed is not None:
            model = ContactModel(robot, duct, options=contact)
            if given.base is not None:
                raise InputError("--speed is given, and the table moves the base: give one of them")
            placed, base = push_in(model, start_inside(model, line), times=given.times, speed=speed)
            commands |= {"base": base, "introducer": robot.length}
    elif speed is not None:
        raise InputError("--speed is given without --tract")
    elif contact != ContactOptions() and not obstacles:
        raise InputError("what touches a wall is given without --tract or --obstacle")
    if tract is not None or obstacles:
        commands |= {"obstacles": tuple(map(read_shapes, obstacles)), "contact": contact}
    before = tuple(parse_load(text, "--held-by") for text in held_by) or None
    found = simulate(placed, given.times, held_by=before, options=dynamics, **commands)
    if answer.out is not None and answer.out.suffix.lower() in (".html", *FILMS):
        with answer.show_progress() as progress:
            _show_motion(found, duct, answer.out, progress)
    elif answer.out is not None and logged:
        write_mcap(found, answer.out)
    else:
        answer.write(found.list_columns(), found.plot)
    result = {**found.to_dict(), "file": answer.out}
    result["notes"] += given.notes
    lines = [_describe_motion(found), *(f"note: {line}" for line in given.notes)]
    answer.give(result, "\n".join(lines))
    if not found.converged or found.notes:
        run_exit(EXIT_NEGATIVE)


def _show_motion(found: ShapeHistory, duct: Duct | None, path: Path, progress: Progress) -> None:
    """Write the page of a motion, or a film of it."""
    from ..scene.film import FilmOptions, record_view
    from ..scene.make_view import make_view
    from ..scene.page import render_page

    view = make_view(found, duct)
    if path.suffix.lower() == ".html":
        write_text(path, render_page(view))
        return
    seconds = float(found.time[-1] - found.time[0])
    lasting = min(max(seconds, 0.5), 60.0)
    record_view(view, path, options=FilmOptions(duration=lasting), progress=progress)


def _describe_motion(found: ShapeHistory) -> str:
    """Return where the tip goes, and whether energy is in balance."""
    import numpy as np

    last = f"after {found.time[-1]:.4g} s the tip is at {format_place(found.tip[-1])} mm"
    last += ", in the frame of the base at rest"
    speed = np.linalg.norm(found.velocities[:, -1], axis=1)
    balance, walls = found.energy, found.wall_sum
    return "\n".join(
        [
            *([found.reason] if found.reason else []),
            f"{last}, moving at {speed[-1]:.4g} mm/s",
            f"fastest {speed.max():.4g} mm/s at {found.time[int(speed.argmax())]:.4g} s",
            *(
                [f"walls press with {walls[-1]:.4g} N, {walls.max():.4g} N at most"]
                if walls.any()
                else []
            ),
            f"work {balance.work[-1]:.4g} N mm, dissipated {balance.dissipated[-1]:.4g} N mm, "
            f"out of balance by {found.residual:.2g} N mm at most",
            *(f"note: {line}" for line in found.notes),
        ]
    )


# What to make it from.


@command.command("fabricate")
@robot_argument
@options_of(BodyOptions, "options")
@step_option
@answer_options(
    required=True,
    metavar="DIRECTORY",
    help="Directory for the parts, the table and the picture of the routing.",
    quiet=False,
)
def fabricate_command(robot_file: Path, options: BodyOptions, step: bool, answer: Answer) -> None:
    """Write channelled discs or sleeves as STL, and the routing as a table and a picture."""
    from ..fabricate import write_body

    summary = write_body(
        read_robot(robot_file), answer.target, options=options, step=step, force=answer.force
    )
    answer.give({"output": answer.target, **summary}, format_parts(summary, answer.target))


command.add_command(design_command)
command.add_command(rank_command)
command.add_command(contact_command)
command.add_command(insert_command)
command.add_command(fit_command)
command.add_command(make_command(RobotPredicting))
command.add_command(make_command(ContinuumTracking))
command.add_command(make_command(ContinuumEstimating))
command.add_command(make_command(SensorPlanning))
