"""``bozzini export``: a plan as files of other tools."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from ..errors import InputError
from ..physics.options import WallOptions
from .common import (
    INPUT,
    Answer,
    CheckedCommand,
    answer_options,
    option,
    options_of,
    refuse_options,
)

__all__ = ["command"]

_SUFFIXES = {"mujoco": ".xml", "urdf": ".urdf", "ros2": ".yaml", "mcap": ".mcap"}


@click.command(name="export", cls=CheckedCommand)
@click.argument("form", metavar="FORM", type=click.Choice(tuple(_SUFFIXES)))
@click.argument("source", metavar="PLAN", type=INPUT)
@click.argument("tract", metavar="[INPUT]", required=False, type=INPUT)
@options_of(WallOptions, "wall", leave_out=("kind", "stiffness", "damping", "friction"))
@option("--speed", "Of the head, for the times of a trajectory.", "speed", default="20mm/s")
@answer_options(*_SUFFIXES.values(), required=True, help="The file.")
def command(
    form: str, source: Path, tract: Path | None, wall: WallOptions, speed: float, answer: Answer
) -> None:
    """Write a PLAN for simulators and robots.

    FORM is mujoco (.xml: chain, servos and the wall of INPUT as prisms), urdf (.urdf: the chain),
    ros2 (.yaml: a trajectory_msgs JointTrajectory of the same joints) or mcap (.mcap: both, joint
    states, frames, body and, if it is given, the wall of INPUT as a log of ROS 2 messages), all in
    m, kg and s. INPUT is the file that the plan was made from; mujoco needs it.
    """
    suffix = _SUFFIXES[form]
    if answer.target.suffix.lower() != suffix:
        raise InputError(f"--out is {answer.target.name}: for {form} it must end in {suffix}")
    if tract is None and form == "mujoco":
        raise InputError(f"{source} is a plan: mujoco also needs the file that it was made from")
    if tract is not None and form not in ("mujoco", "mcap"):
        raise InputError(f"{form} takes no wall: leave out {tract}")
    if form != "mujoco":
        refuse_options(("faces", "thickness", "mouth"), f"for {form}")
    if form not in ("ros2", "mcap"):
        refuse_options(("speed",), f"for {form}")
    from ..checks import check_number
    from ..io.files import write_text
    from ..io.mcap import check_mcap
    from ..motion.plan import Plan
    from ..physics.export import format_mjcf, format_trajectory, format_urdf

    if form == "mcap":
        check_mcap(answer.target)
    plan = Plan.load(source)
    check_number("--speed", speed, low=0.1, high=1000.0, unit="mm/s")
    scenery = None
    if tract is not None:
        from ..physics.study import Scenery
        from .routing import reread_tract

        read, duct = reread_tract(plan, tract, answer)
        scenery = Scenery.from_plan(plan, read, duct=duct)
    if form == "mcap":
        from ..physics.log import write_plan_log
        from ..scene.make_view import draw_wall

        surface = None
        if scenery is not None:
            mesh, _ = draw_wall(scenery.tract or scenery.duct)
            surface = mesh.vertices, mesh.faces
        file = write_plan_log(plan, answer.target, wall=surface, speed=speed)
    else:
        if scenery is not None:
            prisms = replace(scenery, wall=replace(wall, kind="prism"))
            text = format_mjcf(plan, prisms.make_wall("plan"))
        else:
            text = format_urdf(plan) if form == "urdf" else format_trajectory(plan, speed=speed)
        file = write_text(answer.target, text)
    size = file.stat().st_size
    answer.give({"file": str(file), "bytes": size}, f"{file}: {size / 1e6:.2f} MB")
