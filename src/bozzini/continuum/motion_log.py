"""Logs of motions and of estimates as MCAP files of ROS 2 messages: see `bozzini.io.mcap`.

Times are those of the motion, from its first one where they are none of ROS (negative, or from
2^31 s on).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..io.mcap import LAST_S, METRE, Entry, make_header, to_quaternion, to_xyz, write_log

if TYPE_CHECKING:
    from ..numeric.arrays import Floats
    from .dynamics import ShapeHistory
    from .error_fit import EstimateHistory

TOPICS = {
    "/shape": "nav_msgs/Path",
    "/tendons": "sensor_msgs/JointState",
    "/wall_force": "std_msgs/Float64",
}
TIP = {"/tip": "geometry_msgs/PoseWithCovarianceStamped"}


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
    motion = _Motion(
        names=history.robot.tendon_names,
        time=history.time,
        frames=history.robot.base_frame @ history.frames,
        displacements=history.displacements,
        tensions=history.tensions,
        wall_sum=np.asarray(history.wall_sum),
    )
    return write_log(path, TOPICS, _list_entries(motion))


def write_estimates(history: EstimateHistory, path: str | os.PathLike[str]) -> Path:
    """Write estimates as `write_mcap` does motions, with a ``/tip``, and return the path.

    That is a ``geometry_msgs/PoseWithCovarianceStamped``, in the world. Tendons have tensions only,
    and a moment without an estimate no messages.

    Raises
    ------
    InputError
        If it does not end in ``.mcap``, or cannot be written.
    MissingExtraError
        If the package that writes it is not installed.
    """
    rows = [k for k, one in enumerate(history.estimates) if np.isfinite(one.frames).all()]
    found = [history.estimates[k] for k in rows]
    stations = len(history.estimates[0].arc_length)
    order = np.r_[3:6, 0:3]
    scale = np.repeat([METRE, 1.0], 3)
    motion = _Motion(
        names=history.estimates[0].robot.tendon_names,
        time=history.times[rows],
        frames=np.array([one.frames for one in found]).reshape(len(found), stations, 4, 4),
        displacements=np.zeros((len(found), 0)),
        tensions=np.array([one.tensions for one in found]),
        wall_sum=np.array(
            [0.0 if one.contact is None else one.contact.sizes.sum() for one in found]
        ),
        covariances=np.array(
            [np.outer(scale, scale) * one.covariance[-1][np.ix_(order, order)] for one in found]
        ),
    )
    return write_log(path, TOPICS | TIP, _list_entries(motion))


class _Motion(NamedTuple):
    """What is written: names of tendons, times [s], and a row of each at each time.

    Frames (n, k, 4, 4) are in the world [mm]; covariances (n, 6, 6) of the tip are of place [m] and
    rotation [rad].
    """

    names: tuple[str, ...]
    time: Floats
    frames: Floats
    displacements: Floats
    tensions: Floats
    wall_sum: Floats
    covariances: Floats | None = None


def _list_entries(motion: _Motion) -> Iterator[Entry]:
    from scipy.spatial.transform import Rotation

    frames = motion.frames
    if not len(frames):
        return
    turns = Rotation.from_matrix(frames[..., :3, :3].reshape(-1, 3, 3)).as_quat()
    turns = turns.reshape(*frames.shape[:2], 4)
    first, last = float(motion.time[0]), float(motion.time[-1])
    zero = 0.0 if first >= 0.0 and last < LAST_S else first
    for row, moment in enumerate(motion.time):
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
            "name": list(motion.names),
            "position": (METRE * motion.displacements[row]).tolist(),
            "effort": motion.tensions[row].tolist(),
        }
        yield time, "/shape", {"header": header, "poses": poses}
        yield time, "/tendons", tendons
        yield time, "/wall_force", {"data": float(motion.wall_sum[row])}
        if motion.covariances is not None:
            covariance = motion.covariances[row].ravel().tolist()
            tip = {"pose": poses[-1]["pose"], "covariance": covariance}
            yield time, "/tip", {"header": header, "pose": tip}
