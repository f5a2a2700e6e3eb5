"""What the main job says and writes of a tendon robot."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from ..anatomy.findings import Finding
from ..continuum.actuation import Actuation

__all__ = ["find_robot_trouble", "write_robot"]


def find_robot_trouble(actuation: Actuation) -> tuple[Finding, ...]:
    """Return why the robot does not go all the way, as a finding for report and command line."""
    if actuation.status == "complete":
        return ()
    name, reason = actuation.robot.name, actuation.reason
    return (Finding("robot", "warning", f"the robot '{name}' does not get there: {reason}"),)


def write_robot(actuation: Actuation, folder: Path) -> None:
    """Write time tables, figure and everything else of a robot's motion into a directory.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    from ..view import draw_robot_motion, write_figure

    actuation.write_csv(folder / "tendons.csv")
    if find_spec("pyarrow") is not None:
        actuation.write_parquet(folder / "tendons.parquet")
    actuation.save(folder / "robot.npz")
    write_figure(draw_robot_motion(actuation), folder / "robot.png")
