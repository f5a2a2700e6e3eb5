"""Logs of plans and of driven motions as MCAP files of ROS 2 messages: see `bozzini.io.mcap`."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..io.mcap import (
    METRE,
    Entry,
    Message,
    make_header,
    show_body,
    show_wall,
    to_quaternion,
    to_xyz,
    write_log,
)
from ..motion.plan import Plan
from ..numeric.arrays import Floats
from .execute import Execution
from .export import format_urdf, make_trajectory, name_joints
from .robots import PlanDrive
from .simulate import Chain

Triangles = tuple[Floats, NDArray[np.int64]]
"""Corners (n, 3) [mm] and faces (m, 3)."""

PLAN_TOPICS = {
    "/robot_description": "std_msgs/String",
    "/trajectory": "trajectory_msgs/JointTrajectory",
    "/wall": "visualization_msgs/MarkerArray",
    "/joint_states": "sensor_msgs/JointState",
    "/tf": "tf2_msgs/TFMessage",
    "/scope": "visualization_msgs/MarkerArray",
}
EXECUTION_TOPICS = {
    "/wall": "visualization_msgs/MarkerArray",
    "/tf": "tf2_msgs/TFMessage",
    "/scope": "visualization_msgs/MarkerArray",
    "/contacts": "geometry_msgs/WrenchStamped",
    "/push_force": "std_msgs/Float64",
}


def write_plan_log(
    plan: Plan,
    path: str | os.PathLike[str],
    *,
    wall: Triangles | None = None,
    speed: float = 20.0,
) -> Path:
    """Write a plan as an MCAP file, and return its path.

    Topics: the chain as `bozzini.physics.export.format_urdf` gives it and all of its trajectory,
    once; joint states, the frames of the links and the body at each step.

    Parameters
    ----------
    plan : Plan
    path : path-like
    wall : tuple, optional
        Its triangles.
    speed : float
        Of the head, for the times [mm/s].

    Raises
    ------
    OutputError, MissingExtraError
        As `bozzini.io.mcap.check_mcap`.
    """
    return write_log(path, PLAN_TOPICS, _list_steps(plan, PlanDrive(plan, speed), wall))


def _list_steps(plan: Plan, drive: PlanDrive, wall: Triangles | None) -> Iterator[Entry]:
    yield 0.0, "/robot_description", {"data": format_urdf(plan)}
    yield 0.0, "/trajectory", make_trajectory(drive)
    if wall is not None:
        yield 0.0, "/wall", show_wall(wall)
    names, radius = name_joints(drive.chain), plan.get_scope().radius
    for step, moment in enumerate(drive.times):
        time, row = float(moment), drive.table[step]
        position = [METRE * float(row[0]), *row[1:].tolist()]
        state = {"header": make_header(time), "name": names, "position": position}
        yield time, "/joint_states", state
        yield time, "/tf", {"transforms": list(_place_links(drive.chain, row, time))}
        yield time, "/scope", show_body(time, plan.joints[step], radius)


def _place_links(chain: Chain, row: Floats, time: float) -> Iterator[Message]:
    """Give where each link is at a row of slide and hinges, and the tip."""
    turn = chain.frame[:3, :3]
    place = chain.frame[:3, 3] + row[0] * turn[:, 2]
    bends = Rotation.from_euler("XY", row[1:].reshape(-1, 2)).as_matrix()
    for k, (bend, length) in enumerate(zip(bends, chain.lengths, strict=True)):
        turn = turn @ bend
        yield _place(f"link{k}", place, turn, time)
        place = place + length * turn[:, 2]
    yield _place("tip_frame", place, turn, time)


def _place(name: str, place: Floats, turn: Floats, time: float) -> Message:
    rotation = to_quaternion(Rotation.from_matrix(turn).as_quat())
    return {
        "header": make_header(time),
        "child_frame_id": name,
        "transform": {"translation": to_xyz(METRE * place), "rotation": rotation},
    }


def write_execution_log(
    execution: Execution, path: str | os.PathLike[str], *, wall: Triangles | None = None
) -> Path:
    """Write a motion that was driven with contact as an MCAP file, and return its path.

    Topics, at each row of the record: the body; for each link that touches, ``/contacts``, the
    wrench of its largest forces since the row before [N, N m], in the frame ``joint3`` of link 3:
    at the link's end towards the base, its axes the world's; the force at the mouth [N].

    Parameters
    ----------
    execution : Execution
    path : path-like
    wall : tuple, optional
        Its triangles.

    Raises
    ------
    OutputError, MissingExtraError
        As `bozzini.io.mcap.check_mcap`.
    """
    return write_log(path, EXECUTION_TOPICS, _list_rows(execution, wall))


def _list_rows(execution: Execution, wall: Triangles | None) -> Iterator[Entry]:
    first = float(execution.time[0])
    if wall is not None:
        yield first, "/wall", show_wall(wall)
    for row, joints in enumerate(execution.joints):
        time, ends = float(execution.time[row]), joints[::-1]
        frames = [_place(f"joint{k}", end, np.eye(3), time) for k, end in enumerate(ends)]
        yield time, "/tf", {"transforms": frames}
        yield time, "/scope", show_body(time, joints, execution.radius)
        yield time, "/push_force", {"data": float(execution.push_force[row])}
        touched = execution.touched[execution.touched[:, 0] == row]
        for link in np.unique(touched[:, 1]).astype(int).tolist():
            _, _, x, y, z, *force = touched[touched[:, 1] == link].T[:8]
            forces = np.column_stack(force)
            arms = METRE * (np.column_stack([x, y, z]) - ends[link])
            wrench = {
                "force": to_xyz(forces.sum(axis=0)),
                "torque": to_xyz(np.cross(arms, forces).sum(axis=0)),
            }
            header = make_header(time, f"joint{link}")
            yield time, "/contacts", {"header": header, "wrench": wrench}
