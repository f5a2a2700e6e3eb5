"""Logs of motions as MCAP files of ROS 2 messages, which Foxglove and ``ros2 bag`` play.

Lengths are in metres, as ROS 2 has them (REP 103); times are those of the motion,
from its first one where they are none of ROS (negative, or from 2^31 s on).
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import MissingExtraError
from ..io.files import check_new_file, write_atomically

if TYPE_CHECKING:
    from ..numeric.arrays import Floats
    from .dynamics import ShapeHistory
    from .error_fit import EstimateHistory

METRE = 1e-3
"""Of a millimetre."""

LAST_S = 2.0**31 - 1.0
"""Where the stamps of ROS 2 end [s]."""

_RULE = "\n" + 80 * "=" + "\n"
_HEADER = "std_msgs/Header header\n"
_PARTS = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "geometry_msgs/PoseStamped": f"{_HEADER}geometry_msgs/Pose pose\n",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
}
"""Messages that those below are made of, as ROS 2 defines them."""
_POSES = tuple(name for name in _PARTS if not name.endswith("WithCovariance"))
_STAMP = ("std_msgs/Header", "builtin_interfaces/Time")
_MESSAGES = {
    "/shape": ("nav_msgs/msg/Path", f"{_HEADER}geometry_msgs/PoseStamped[] poses\n", _POSES),
    "/tendons": (
        "sensor_msgs/msg/JointState",
        f"{_HEADER}string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
        _STAMP,
    ),
    "/wall_force": ("std_msgs/msg/Float64", "float64 data\n", ()),
    "/tip": (
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        f"{_HEADER}geometry_msgs/PoseWithCovariance pose\n",
        tuple(name for name in _PARTS if name != "geometry_msgs/PoseStamped"),
    ),
}
"""Type, definition and parts of what stands on each topic."""


def check_mcap(path: str | os.PathLike[str]) -> Path:
    """Return where a log is written.

    Raises
    ------
    InputError
        If it does not end in ``.mcap``, or cannot be written.
    MissingExtraError
        If the package that writes it is not installed.
    """
    target = Path(path)
    check_new_file(target, (".mcap",), force=True)
    try:
        import mcap_ros2  # noqa: F401
    except ImportError:
        raise MissingExtraError("mcap-ros2-support", "mcap") from None
    return target


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
    target = check_mcap(path)
    log = _Log(
        names=history.robot.tendon_names,
        time=history.time,
        frames=history.robot.base_frame @ history.frames,
        displacements=history.displacements,
        tensions=history.tensions,
        wall_sum=np.asarray(history.wall_sum),
    )
    return write_atomically(target, lambda place: _put_log(log, place))


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
    target = check_mcap(path)
    rows = [k for k, one in enumerate(history.estimates) if np.isfinite(one.frames).all()]
    found = [history.estimates[k] for k in rows]
    stations = len(history.estimates[0].arc_length)
    order = np.r_[3:6, 0:3]
    scale = np.repeat([METRE, 1.0], 3)
    log = _Log(
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
    return write_atomically(target, lambda place: _put_log(log, place))


class _Log(NamedTuple):
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


def _put_log(history: _Log, place: Path) -> None:
    from mcap_ros2.writer import Writer
    from scipy.spatial.transform import Rotation

    frames = history.frames
    turns = np.empty((*frames.shape[:2], 4))
    if turns.size:
        turns = Rotation.from_matrix(frames[..., :3, :3].reshape(-1, 3, 3)).as_quat()
        turns = turns.reshape(*frames.shape[:2], 4)
    with place.open("wb") as file, Writer(file) as writer:
        schemas = {
            topic: writer.register_msgdef(
                kind, text + "".join(f"{_RULE}MSG: {part}\n{_PARTS[part]}" for part in parts)
            )
            for topic, (kind, text, parts) in _MESSAGES.items()
            if topic != "/tip" or history.covariances is not None
        }
        first, last = (float(time) for time in history.time[[0, -1]]) if len(turns) else (0.0, 0.0)
        zero = 0.0 if first >= 0.0 and last < LAST_S else first
        for row, time in enumerate(history.time):
            moment = round(1e9 * (float(time) - zero))
            stamp = {"sec": moment // 10**9, "nanosec": moment % 10**9}
            header = {"stamp": stamp, "frame_id": "world"}
            poses = [
                {
                    "header": header,
                    "pose": {
                        "position": dict(zip("xyz", point, strict=True)),
                        "orientation": dict(zip("xyzw", turn, strict=True)),
                    },
                }
                for point, turn in zip(
                    (METRE * frames[row, :, :3, 3]).tolist(), turns[row].tolist(), strict=True
                )
            ]
            tendons = {
                "header": header,
                "name": list(history.names),
                "position": (METRE * history.displacements[row]).tolist(),
                "velocity": [],
                "effort": history.tensions[row].tolist(),
            }
            wall = {"data": float(history.wall_sum[row])}
            messages = [{"header": header, "poses": poses}, tendons, wall]
            if history.covariances is not None:
                covariance = history.covariances[row].ravel().tolist()
                tip = {"pose": poses[-1]["pose"], "covariance": covariance}
                messages.append({"header": header, "pose": tip})
            for (topic, schema), message in zip(schemas.items(), messages, strict=True):
                writer.write_message(topic, schema, message, log_time=moment, publish_time=moment)
