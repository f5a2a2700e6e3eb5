"""What commands share that take a tract: how it is read, and where its centreline runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from .common import LabelsType, QuantityType, progress_bar

if TYPE_CHECKING:
    from ..anatomy.tract import Finding, LabelTract, Organ, SurfaceTract
    from ..continuum import ContinuumRobot
    from ..motion import Scope
    from ..motion.actuate.actuation import Actuation

# What moves: a scope, or a tendon robot (``--robot``) that goes the planned way.

DIAMETER, LINK = 9.0, 10.0
"""Of the scope, where neither it nor a robot is given [mm]."""


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
    from ..motion.actuate.actuate import check_robot

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


_Function = TypeVar("_Function", bound=Callable[..., Any])


class EndType(click.ParamType):  # type: ignore[type-arg]
    """An end of the way: ``x,y,z`` with units, a label (number or name), or a named place."""

    name = "x,y,z|label|name"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...] | int | str:
        """Return a label as int, a name as text, or a point as a tuple in mm."""
        from ..errors import BozziniError
        from ..units import parse_vector

        if not isinstance(value, str):
            return value  # type: ignore[no-any-return]
        text = value.strip()
        if text.isascii() and text.isdigit():
            return int(text)
        # A name has a letter first; what begins like a number is a point.
        if text[:1].isalpha() and text.partition(",")[0].lower() not in ("nan", "inf"):
            return text
        try:
            return parse_vector(value, "length")
        except BozziniError as error:
            self.fail(f"{error} (or give the number or name of a label or place)", param, ctx)


def tract_options(function: _Function) -> _Function:
    """Add what a tract is read with, and where its way runs; None where not given."""
    for option in reversed(
        (
            click.option(
                "--labels",
                type=LabelsType(),
                help="Labels that are lumen, by number or name: 1,2,colon; or all.",
            ),
            click.option(
                "--part",
                multiple=True,
                metavar="NAME|NUMBER",
                help="The part of a scene, or of a mesh (1 is the largest), to read; may be "
                "repeated: the parts are united.",
            ),
            click.option("--unit", help="Unit of a surface file (default: mm; GLB: m)."),
            click.option(
                "--frame",
                metavar="RAS|LPS|...",
                help="Where the file's axes point in the patient (default: as the file states).",
            ),
            click.option(
                "--repair", is_flag=True, help="Mend small faults of a surface, and list them."
            ),
            click.option(
                "--organ",
                type=click.Choice(_ORGANS),
                help="Which organ this is: it decides which end is the entry.",
            ),
            click.option(
                "--voxel", type=QuantityType("length"), help="Grid of the distance field."
            ),
            click.option(
                "--inflate",
                type=QuantityType("length"),
                help="Move the wall outwards, as insufflation does (default: 0mm).",
            ),
            click.option(
                "--start",
                type=EndType(),
                help="Where the way begins: a point, a label, a landmark, an opening or "
                "largest-opening.",
            ),
            click.option("--end", type=EndType(), help="Where the way ends; as --start."),
            click.option(
                "--via",
                type=EndType(),
                multiple=True,
                help="Where the way goes through; as --start; may be repeated.",
            ),
            click.option("--reverse", is_flag=True, help="Enter at the other end."),
        )
    ):
        function = option(function)
    return function


_ORGANS = ("upper-tract", "small-bowel", "colon")
# As `bozzini.anatomy.ORGANS`, which is not imported for --help; a test compares them.

_READING = ("labels", "part", "unit", "frame", "repair")


def sort_options(options: dict[str, Any]) -> tuple[dict[str, Any], Organ | None, dict[str, Any]]:
    """Return what a tract is read with, its organ, and the rest of the options for a study."""
    ways = dict(options)
    reading = {name: ways.pop(name) for name in _READING}
    part = reading["part"]
    if reading["labels"] == ("all",):
        reading["labels"] = "all"
    reading["part"] = (part[0] if len(part) == 1 else tuple(part)) if part else None
    organ = ways.pop("organ")
    ways["inflate"] = 0.0 if ways["inflate"] is None else ways["inflate"]
    return reading, organ, ways


def read_with_options(
    source: Path, options: dict[str, Any], *, quiet: bool
) -> tuple[LabelTract | SurfaceTract, dict[str, Any]]:
    """Return the tract, and the rest of its options for a study."""
    from dataclasses import replace

    from ..anatomy import read_tract
    from ..study.inputs import check_field_options

    reading, organ, ways = sort_options(options)
    check_field_options(voxel=ways["voxel"], inflate=ways["inflate"])  # before the file is read
    with progress_bar(quiet=quiet) as progress:
        progress("read", 0.0)
        tract = read_tract(source, **reading)
    # Written at once, not with the result: a later stage may fail just because of them.
    tell_findings(tract.findings)
    return (tract if organ is None else replace(tract, organ=organ)), ways


def tell_findings(findings: Sequence[Finding]) -> None:
    """Write the warnings among the findings on stderr, a line each."""
    for item in findings:
        if item.severity == "warning":
            click.echo(f"bozzini: warning: {' '.join(item.message.split())}", err=True)


def count_notes(findings: Sequence[Finding], place: str) -> None:
    """Write on stderr how many notes are left to read, and where they are."""
    number = sum(item.severity != "warning" for item in findings)
    if number:
        word = "note" if number == 1 else "notes"
        click.echo(f"bozzini: note: and {number} {word}: see {place}", err=True)
