"""What the commands share that take a tract: what moves in it, how it is read, its findings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..checks import Quantity, floor_mm, list_quantities, quantity
from ..errors import InputError
from ..study.options import InsertionOptions, PathOptions, ReadOptions
from .common import Answer, options_of

if TYPE_CHECKING:
    from ..anatomy.tract import Finding, LabelTract, SurfaceTract
    from ..continuum import ContinuumRobot
    from ..motion import Scope
    from ..motion.actuate.actuation import Actuation

DIAMETER, LINK = 9.0, 10.0
"""Of the scope, where neither it nor a robot is given [mm]."""

tract_options = options_of(ReadOptions, "reading")


@dataclass(frozen=True, kw_only=True)
class MovingBody:
    """What moves: a scope, or a tendon robot that follows the plan.

    Parameters
    ----------
    robot : path-like, optional
        File of the robot.
    diameter, link, length : float, optional
        Of the scope [mm]; by default the robot's, `DIAMETER` and `LINK`, and the tract's length.
    """

    robot: Path | None = quantity(
        "file", "Also make the motion of this tendon robot (a YAML file), and prove it.",
        default=None, example="robot.yaml",
    )  # fmt: skip
    diameter: float | None = quantity(
        "length",
        "Outer diameter of the scope.  [default: 9mm, or the robot's]",
        default=None,
        example="9 mm",
    )
    link: float | None = quantity(
        "length",
        "Length of a rigid link.  [default: 10mm, or half the robot's shortest section]",
        default=None,
        example="10 mm",
    )
    length: float | None = quantity(
        "length", "Length of the scope (default: the tract's).", default=None, example="1 m"
    )

    @cached_property
    def machine(self) -> ContinuumRobot | None:
        """The robot in the file.

        Raises
        ------
        InputError
            If it is not one, or cannot follow a path.
        """
        if self.robot is None:
            return None
        from ..continuum import ContinuumRobot
        from ..motion.actuate.actuate import check_robot

        robot = ContinuumRobot.from_yaml(self.robot)
        check_robot(robot)
        note_calibration(robot)
        return robot

    @cached_property
    def scope(self) -> Scope:
        """The scope; what is not given is the robot's, or as by default."""
        from ..motion import Scope

        diameter, link = DIAMETER, LINK
        if self.machine is not None:
            diameter = 2.0 * self.machine.radius
            link = 0.5 * min(section.length for section in self.machine.sections)
        return Scope(
            diameter=diameter if self.diameter is None else self.diameter,
            link_length=link if self.link is None else self.link,
            length=self.length,
        )


PLAN_OPTIONS = (ReadOptions, MovingBody, InsertionOptions)
"""Whose fields are the options of ``bozzini plan``."""


def list_plan_options() -> dict[str, tuple[Quantity, object]]:
    """Return what is known of each option of ``bozzini plan``, and its default."""
    from ..motion import Scope

    scope = list_quantities(Scope)
    ranges = {"diameter": "diameter", "link": "link_length", "length": "length"}
    found = {}
    for kind in PLAN_OPTIONS:
        defaults = {item.name: item.default for item in fields(kind)}
        for name, known in list_quantities(kind).items():
            if kind is MovingBody and name in ranges:
                size = scope[ranges[name]]
                known = replace(known, low=size.low, high=size.high, low_open=size.low_open)
            found[name] = (known, defaults[name])
    return found


def read_with_options(
    source: Path, reading: ReadOptions, answer: Answer
) -> LabelTract | SurfaceTract:
    """Return the tract in a file; its warnings are written at once, as a later stage may fail."""
    with answer.show_progress() as progress:
        progress("read", 0.0)
        tract = reading.read(source)
    report_findings(tract.findings)
    return tract


def list_given(options: ReadOptions | PathOptions | MovingBody) -> list[str]:
    """Return the names of the options that were given."""
    return [name for name, value in vars(options).items() if value not in (None, False, ())]


def report_findings(findings: Sequence[Finding]) -> None:
    """Write the warnings among the findings on stderr, a line each."""
    for item in findings:
        if item.severity == "warning":
            click.echo(f"bozzini: warning: {' '.join(item.message.split())}", err=True)


def note_calibration(robot: ContinuumRobot) -> None:
    """Write on stderr that a table of drives is not converted, if the robot has a calibration."""
    if robot.calibration is not None:
        click.echo(
            f"bozzini: note: the calibration of robot '{robot.name}' is not applied: tables of "
            "drives hold displacements, without its zeros, scale and backlash",
            err=True,
        )


def report_study(findings: Sequence[Finding], known: Sequence[Finding], place: str) -> None:
    """Write on stderr the warnings not yet known, how many notes there are, and where these are."""
    report_findings(findings[len(known) :])
    number = sum(item.severity != "warning" for item in findings)
    if number:
        word = "note" if number == 1 else "notes"
        click.echo(f"bozzini: note: and {number} {word}: see {place}", err=True)


def format_actuation(actuation: Actuation, out: Path) -> list[str]:
    """Return what people read of a robot's motion."""
    summary = actuation.to_dict()
    name, fit, bend = summary["name"], summary["fit"], summary["bend"]
    if actuation.fits:
        verdict = f"Robot '{name}' gets there"
    else:
        verdict = f"Robot '{name}' does not get there: {actuation.reason}"
    proof = summary["certificate"]["clearance_mm"]
    if proof is not None:
        verdict += f"; proved to keep {floor_mm(proof)} mm from the wall at all times"
    travel = max(
        (max(abs(item["min_mm"]), abs(item["max_mm"])) for item in summary["tendons"].values()),
        default=0.0,
    )
    return [
        f"{verdict}.",
        f"  off the path {fit['rms_max_mm']:.2f} mm rms at most, {fit['max_mm']:.2f} mm at one "
        f"point; bends up to {math.degrees(bend['max_rad']):.1f} deg ({bend['section']}, head at "
        f"{bend['head_mm']:.1f} mm); tendons move up to {travel:.2f} mm",
        f"Tendon displacements: {out / 'tendons.csv'}",
    ]


def check_shape_options(source: Path, reading: ReadOptions) -> None:
    """Refuse what a file of shapes is not read with."""
    if reading.labels is not None:
        raise InputError(f"{source} holds shapes: it has no labels to select")
    if reading.unit not in (None, "mm"):
        raise InputError(f"unit is '{reading.unit}': a file of shapes is in mm, leave it out")
    given = [name for name in list_given(reading) if name != "unit"]
    if given:
        raise InputError(f"--{given[0]} has no effect on a file of shapes: leave it out")
