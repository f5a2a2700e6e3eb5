"""What the commands of ``bozzini continuum`` share: the robot, commands of its tendons, models."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import GeometryError, InputError
from .common import QuantityType, VectorType

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..continuum import ContinuumRobot, ShapeModel

__all__ = [
    "MODEL_NAMES",
    "choose_model",
    "describe_robot",
    "displacement_option",
    "make_consistent",
    "make_model",
    "model_options",
    "parse_displacements",
    "read_parallel_robot",
    "read_robot",
    "robot_argument",
    "take_options",
]

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
