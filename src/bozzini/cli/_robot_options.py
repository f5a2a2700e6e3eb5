"""What moves: a scope, or a tendon robot (``--robot``) that goes the planned way."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from .common import QuantityType

if TYPE_CHECKING:
    from ..continuum import ContinuumRobot
    from ..continuum.actuation import Actuation
    from ..motion import Scope

__all__ = ["choose_scope", "describe_robot", "read_robot", "scope_options"]

DIAMETER, LINK = 9.0, 10.0
"""Of the scope, where neither it nor a robot is given [mm]."""

_Function = TypeVar("_Function", bound=Callable[..., Any])


def scope_options(function: _Function) -> _Function:
    """Add what moves: ``--robot``, ``--diameter`` and ``--link``; None where not given."""
    for option in reversed(
        (
            click.option(
                "--robot",
                type=click.Path(path_type=Path),
                metavar="ROBOT.yaml",
                help="Also make the motion of this tendon robot, and prove it.",
            ),
            click.option(
                "--diameter",
                type=QuantityType("length"),
                help="Outer diameter of the scope.  [default: 9mm, or the robot's]",
            ),
            click.option(
                "--link",
                type=QuantityType("length"),
                help="Length of a rigid link.  [default: 10mm, or half the robot's shortest "
                "section]",
            ),
        )
    ):
        function = option(function)
    return function


def read_robot(path: Path | None) -> ContinuumRobot | None:
    """Return the robot in a YAML file.

    Raises
    ------
    InputError
        If it is not one, or cannot follow a path.
    """
    if path is None:
        return None
    from ..continuum import ContinuumRobot
    from ..continuum.actuate import check_robot

    robot = ContinuumRobot.from_yaml(path)
    check_robot(robot)
    return robot


def choose_scope(
    robot: ContinuumRobot | None,
    *,
    diameter: float | None,
    link: float | None,
    length: float | None = None,
) -> Scope:
    """Return the scope of the options; what is not given is the robot's, or as by default."""
    from ..motion import Scope

    if robot is not None:
        shortest = min(section.length for section in robot.sections)
        diameter = 2.0 * robot.radius if diameter is None else diameter
        link = 0.5 * shortest if link is None else link
    return Scope(
        diameter=DIAMETER if diameter is None else diameter,
        link_length=LINK if link is None else link,
        length=length,
    )


def describe_robot(actuation: Actuation, out: Path) -> list[str]:
    """Return what is said to people of a robot's motion."""
    from ..motion.refusal import floor_mm

    told = actuation.summarise()
    name, fit, bend = told["name"], told["fit"], told["bend"]
    if actuation.fits:
        verdict = f"Robot '{name}' gets there"
    else:
        verdict = f"Robot '{name}' does not get there: {actuation.reason}"
    proof = told["certificate"]["clearance_mm"]
    if proof is not None:
        verdict += f"; proved to keep {floor_mm(proof)} mm from the wall at all times"
    travel = max(
        (max(-item["min_mm"], item["max_mm"]) for item in told["tendons"].values()), default=0.0
    )
    return [
        f"{verdict}.",
        f"  off the path {fit['rms_max_mm']:.2f} mm rms at most, {fit['max_mm']:.2f} mm at one "
        f"point; bends up to {math.degrees(bend['max_rad']):.1f} deg ({bend['section']}, head at "
        f"{bend['head_mm']:.1f} mm); tendons move up to {travel:.2f} mm",
        f"Tendon displacements: {out / 'tendons.csv'}",
    ]
