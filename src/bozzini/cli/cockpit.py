"""``bozzini cockpit``: see a plan and drive the tip, in the browser."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..effector.design import DEFAULT_PRESET
from ..errors import InputError
from ..rig.choices import CONTROLLERS
from ..study.options import PathOptions, ReadOptions
from ._slicer import open_slicer
from ._tract_options import MovingBody, list_given, tract_options
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    PICTURES,
    Answer,
    CheckedCommand,
    answer_options,
    option,
    options_of,
    run_exit,
)

if TYPE_CHECKING:
    from ..study.estimating import ContinuumEstimating

__all__ = ["command"]


@click.command(name="cockpit", cls=CheckedCommand)
@click.argument("source", metavar="[INPUT]", required=False, type=INPUT)
@tract_options
@options_of(MovingBody, "body")
@options_of(PathOptions, "options")
@option(
    "--moving MOTION",
    "Let the tract move: breathing, peristalsis, or a file of displacements (.npz).",
)
@option(
    "--readings FILE|-",
    "Show --robot alone: the commanded shape and the one that is estimated from these rows, as "
    "'bozzini continuum estimate' takes them; - for stdin.",
)
@option("--rig RIG", "Drive a rig: demo (an emulated one), or serial:PORT.")
@option("--board", "Of the emulated rig.", ("emulated", "native"), default="emulated")
@option(
    "--controller",
    "Of the rig: see 'bozzini rig run'; the page has the choice too.",
    CONTROLLERS,
    default=CONTROLLERS[0],
)
@option(
    "--effector NAME|FILE",
    "The end-effector; or a file of 'bozzini effector fit --out', ending in .yaml or .json.",
    default=DEFAULT_PRESET,
)
@option(
    "--head FILE|default",
    "A distal head (.yaml, .json) at the scope's tip, with its still camera, in place of "
    "--effector.",
)
@click.option(
    "--targets",
    type=click.IntRange(1, 100),
    help="How many places of the wall there are to touch with --head; 5 if it is not given.",
)
@option(
    "--host ADDRESS",
    "Listen there, such as 0.0.0.0; others than this computer need the token.",
    default="127.0.0.1",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=8321,
    show_default=True,
    help="0 for any that is free.",
)
@click.option(
    "--name", "host_names", multiple=True, help="Name of this computer for others; may be repeated."
)
@click.option("--no-browser", is_flag=True, help="Do not open the page.")
@option(
    "--operator",
    "Let a script draw with the stick, write how well the tip follows, and end.",
    ("line", "circle"),
)
@answer_options(
    ".html",
    ".csv",
    *PICTURES,
    igtl=True,
    help="What the operator drew: a report (.html), a table, a picture; with --head the touches.",
)
def command(
    source: Path | None,
    reading: ReadOptions,
    body: MovingBody,
    options: PathOptions,
    moving: str | None,
    readings: str | None,
    rig: str | None,
    board: str,
    controller: str,
    effector: str,
    head: str | None,
    targets: int | None,
    host: str,
    port: int,
    host_names: tuple[str, ...],
    no_browser: bool,
    operator: str | None,
    answer: Answer,
) -> None:
    """See the motion through the tract in INPUT, plan it anew, and drive the tip.

    Without INPUT the phantom of 'bozzini demo' is shown. The page is served to this computer alone,
    until it is interrupted (Ctrl-C). Its stick, a gamepad or the keyboard bends the end-effector by
    inverse kinematics; with --rig the same stick drives a rig. A rig, and --host, need the link
    with the token, which is printed. Exit code 0: it was ended, or the operator has drawn all; 1:
    he has not; 2: bad input.
    """
    from ..cockpit.server import bind

    listener = bind(host, port)
    with listener:
        from ..cockpit.drive import check_rig
        from ..cockpit.planning import PlanningRequest
        from ..cockpit.run import Cockpit, CockpitOptions

        check_rig(rig)
        sensed = None
        if readings is not None:
            sensed = _open_readings(readings, body, INPUT=source, rig=rig, head=head, moving=moving,
                                    operator=operator, igtl=answer.igtl)  # fmt: skip
        if rig is None and controller != "static":
            raise InputError("--controller has no effect without --rig")
        if source is None and list_given(reading):
            raise InputError(f"--{list_given(reading)[0]} has no effect without an INPUT")
        if source is not None and not os.path.exists(source):
            raise InputError(f"{source}: there is no such file")
        if answer.out is not None and operator is None and head is None:
            raise InputError("--out has no effect without --operator or --head")
        if head is None and targets is not None:
            raise InputError("--targets has no effect without --head")
        if head is not None:
            _check_head(answer, rig=rig, operator=operator, moving=moving)
        if moving not in (None, "breathing", "peristalsis") and not os.path.isfile(moving):
            raise InputError(
                f"--moving is '{moving}': it must be breathing, peristalsis or a file that is there"
            )
        job = None
        if sensed is None:
            job = PlanningRequest(
                source=source,
                reading=reading,
                options=options,
                scope=body.scope,
                robot=body.machine,
                moving=moving,
            )
        chosen = CockpitOptions(
            host=host,
            port=port,
            names=host_names,
            rig=rig,
            board=board,
            effector=effector,
            controller=controller,
            head=head,
            targets=targets or 5,
            operator=operator,  # type: ignore[arg-type]
            is_shown=not no_browser,
            slicer=open_slicer(answer),
            sensed=sensed,
        )
        cockpit = Cockpit(job, chosen, listener=listener)
        cockpit.run(lambda address: click.echo(address, err=answer.as_json or operator is not None))
    if cockpit.run_of_targets is not None:
        run = cockpit.run_of_targets
        answer.write(run.list_columns(), run.plot)
        answer.give(run, run.describe())
    if cockpit.drawing is None:
        return
    drawing = cockpit.drawing
    if answer.out is not None and answer.out.suffix.lower() == ".html":
        drawing.write_report(answer.out)
    else:
        answer.write(drawing.list_columns(), drawing.plot)
    answer.give({**drawing.to_dict(), "file": answer.out}, drawing.describe())
    if not drawing.converged:
        run_exit(EXIT_NEGATIVE)


def _open_readings(table: str, body: MovingBody, **others: object) -> ContinuumEstimating:
    """Return robot and readings; raise `InputError` if there is no robot, or more is given."""
    from ..study.estimating import ContinuumEstimating

    if body.robot is None:
        raise InputError("--readings needs --robot: whose readings they are")
    given = {name: value for name, value in others.items() if value is not None}
    given |= {name: True for name in list_given(body) if name != "robot"}
    for name in given:
        option = name if name == "INPUT" else f"--{name}"
        raise InputError(f"{option} cannot be used with --readings: the robot is shown alone")
    if table != "-" and not os.path.isfile(table):
        raise InputError(f"{table}: there is no such file")
    return ContinuumEstimating(robot=str(body.robot), table=table)


def _check_head(answer: Answer, **others: str | None) -> None:
    """Raise `InputError` if something is given that a head has not."""
    for name, value in others.items():
        if value is not None:
            raise InputError(f"--{name} cannot be used with --head: the head is a model at rest")
    if answer.out is not None and answer.out.suffix.lower() == ".html":
        raise InputError(f"--out is '{answer.out}': with --head it is a table or a picture")
