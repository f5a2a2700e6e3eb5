"""Logs of motions as MCAP files of ROS 2 messages: see `bozzini.io.mcap`.

Times are those of the motion, from its first one where they are none of ROS (negative, or from
2^31 s on).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..io.mcap import LAST_S, METRE, Entry, make_header, to_quaternion, to_xyz, write_log

if TYPE_CHECKING:
    from .dynamics import ShapeHistory

TOPICS = {
    "/shape": "nav_msgs/Path",
    "/tendons": "sensor_msgs/JointState",
    "/wall_force": "std_msgs/Float64",
}


def write_mcap(history: ShapeHistory, path: str | os.PathLike[str]) -> Path:
    """Write a motion as an MCAP file of ROS 2 messages, and return its path.

    Topics, at each time: ``/shape``, a ``nav_msgs/Path`` of the cross-sections in the frame
    ``world``; ``/tendons``, a ``sensor_msgs/JointState`` with displacements as positions [m] and
    tensions as efforts [N]; ``/wall_force``, the sum of the walls' forces [N].

    Raises
    ------
    InputError
        If it does not end in ``.mcap``, or cannot be written.
    MissingExtraError
        If the package that writes it is not installed.
    """
    return write_log(path, TOPICS, _list_entries(history))


def _list_entries(history: ShapeHistory) -> Iterator[Entry]:
    from scipy.spatial.transform import Rotation

    frames = history.robot.base_frame @ history.frames
    turns = Rotation.from_matrix(frames[..., :3, :3].reshape(-1, 3, 3)).as_quat()
    turns = turns.reshape(*frames.shape[:2], 4)
    first, last = float(history.time[0]), float(history.time[-1])
    zero = 0.0 if first >= 0.0 and last < LAST_S else first
    for row, moment in enumerate(history.time):
        time = float(moment) - zero
        header = make_header(time)
        poses = [
            {
                "header": header,
                "pose": {"position": to_xyz(point), "orientation": to_quaternion(turn)},
            }
            for point, turn in zip(METRE * frames[row, :, :3, 3], turns[row], strict=True)
        ]
        tendons = {
            "header": header,
            "name": list(history.robot.tendon_names),
            "position": (METRE * history.displacements[row]).tolist(),
            "effort": history.tensions[row].tolist(),
        }
        yield time, "/shape", {"header": header, "poses": poses}
        yield time, "/tendons", tendons
        yield time, "/wall_force", {"data": float(np.asarray(history.wall_sum)[row])}
