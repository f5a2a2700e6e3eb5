"""MCAP files of ROS 2 messages, which Foxglove, ``rosbags`` and ``ros2 bag`` play.

Lengths are in metres, as ROS 2 has them (REP 103). Messages are those of ROS 2 Humble and later.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import MissingExtraError
from ..numeric.arrays import Floats
from .files import check_new_file, write_atomically

METRE = 1e-3
"""Of a millimetre."""

LAST_S = 2.0**31 - 1.0
"""Where the stamps of ROS 2 end [s]."""

Message = Mapping[str, object]
"""A message, or a part of one, by its fields; those that lack are empty or 0."""

Entry = tuple[float, str, Message]
"""Time [s], topic and message."""

_RULE = "\n" + 80 * "=" + "\n"
_HEADER = "std_msgs/Header header\n"
_MESSAGES = {
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec\n",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    "geometry_msgs/PoseStamped": f"{_HEADER}geometry_msgs/Pose pose\n",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
    "geometry_msgs/PoseWithCovarianceStamped": (
        f"{_HEADER}geometry_msgs/PoseWithCovariance pose\n"
    ),
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/Transform": (
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
    ),
    "geometry_msgs/TransformStamped": (
        f"{_HEADER}string child_frame_id\ngeometry_msgs/Transform transform\n"
    ),
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
    "geometry_msgs/WrenchStamped": f"{_HEADER}geometry_msgs/Wrench wrench\n",
    "nav_msgs/Path": f"{_HEADER}geometry_msgs/PoseStamped[] poses\n",
    "sensor_msgs/CompressedImage": f"{_HEADER}string format\nuint8[] data\n",
    "sensor_msgs/JointState": (
        f"{_HEADER}string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    ),
    "std_msgs/ColorRGBA": "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n",
    "std_msgs/Float64": "float64 data\n",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "std_msgs/String": "string data\n",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "trajectory_msgs/JointTrajectory": (
        f"{_HEADER}string[] joint_names\ntrajectory_msgs/JointTrajectoryPoint[] points\n"
    ),
    "trajectory_msgs/JointTrajectoryPoint": (
        "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\n"
        "builtin_interfaces/Duration time_from_start\n"
    ),
    "visualization_msgs/Marker": (
        f"{_HEADER}string ns\nint32 id\nint32 type\nint32 action\ngeometry_msgs/Pose pose\n"
        "geometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n"
        "builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\n"
        "std_msgs/ColorRGBA[] colors\nstring texture_resource\n"
        "sensor_msgs/CompressedImage texture\nvisualization_msgs/UVCoordinate[] uv_coordinates\n"
        "string text\nstring mesh_resource\nvisualization_msgs/MeshFile mesh_file\n"
        "bool mesh_use_embedded_materials\n"
    ),
    "visualization_msgs/MarkerArray": "visualization_msgs/Marker[] markers\n",
    "visualization_msgs/MeshFile": "string filename\nuint8[] data\n",
    "visualization_msgs/UVCoordinate": "float32 u\nfloat32 v\n",
}
"""Messages as ROS 2 defines them."""

LINE_STRIP, TRIANGLES = 4, 11
"""Types of a marker."""


def check_mcap(path: str | os.PathLike[str]) -> Path:
    """Return where a log is written.

    Raises
    ------
    OutputError
        If it does not end in ``.mcap``, or cannot be written.
    MissingExtraError
        If the package that writes it is not installed.
    """
    target = Path(path)
    check_new_file(target, (".mcap",), force=True)
    if not has_mcap():
        raise MissingExtraError("mcap-ros2-support", "mcap")
    return target


def has_mcap() -> bool:
    """Whether the package that writes logs is installed."""
    try:
        import mcap_ros2  # noqa: F401
    except ImportError:
        return False
    return True


def write_log(
    path: str | os.PathLike[str], topics: Mapping[str, str], entries: Iterable[Entry]
) -> Path:
    """Write messages as an MCAP file, and return its path.

    Parameters
    ----------
    path : path-like
    topics : mapping of str to str
        The kind of message of each topic, such as ``"sensor_msgs/JointState"``.
    entries : iterable of (float, str, mapping)
        Time [s], topic and message, in the order of time.

    Raises
    ------
    OutputError, MissingExtraError
        As `check_mcap`.
    """
    target = check_mcap(path)
    return write_atomically(target, lambda place: _put_log(place, topics, entries))


def _put_log(place: Path, topics: Mapping[str, str], entries: Iterable[Entry]) -> None:
    from mcap_ros2.writer import Writer

    with place.open("wb") as file, Writer(file) as writer:
        kinds = {}
        for kind in dict.fromkeys(topics.values()):
            parts = "".join(f"{_RULE}MSG: {part}\n{_MESSAGES[part]}" for part in _list_parts(kind))
            package, _, name = kind.partition("/")
            kinds[kind] = writer.register_msgdef(f"{package}/msg/{name}", _MESSAGES[kind] + parts)
        for time, topic, message in entries:
            moment = round(1e9 * time)
            writer.write_message(
                topic, kinds[topics[topic]], message, log_time=moment, publish_time=moment
            )


def _list_parts(kind: str) -> Iterator[str]:
    """Give the messages that a message is made of, each once."""
    found, waiting = {kind}, [kind]
    while waiting:
        for part in re.findall(r"^(\w+/\w+)", _MESSAGES[waiting.pop()], re.M):
            if part not in found:
                found.add(part)
                waiting.append(part)
                yield part


# Parts of messages.


def make_header(time: float, frame: str = "world") -> Message:
    """Return a header: a time [s], and the frame of the coordinates."""
    return {"stamp": make_stamp(time), "frame_id": frame}


def make_stamp(time: float) -> Message:
    """Return a time [s] as a stamp, or as a duration."""
    moment = round(1e9 * time)
    return {"sec": moment // 10**9, "nanosec": moment % 10**9}


def to_xyz(vector: ArrayLike) -> Message:
    """Return a vector (3,) by its axes."""
    return dict(zip("xyz", np.asarray(vector, dtype=np.float64).tolist(), strict=True))


def to_quaternion(turn: ArrayLike) -> Message:
    """Return a quaternion (4,), its real part last, by its parts."""
    return dict(zip("xyzw", np.asarray(turn, dtype=np.float64).tolist(), strict=True))


def show_wall(surface: tuple[Floats, NDArray[np.int64]]) -> Message:
    """Return triangles, corners (n, 3) [mm] and faces (m, 3), as a message ``MarkerArray``."""
    vertices, faces = surface
    corners = METRE * vertices[faces].reshape(-1, 3)
    return _mark(TRIANGLES, 0.0, corners, scale=(1.0, 1.0, 1.0), color=(0.85, 0.58, 0.54, 0.35))


def show_body(time: float, joints: Floats, radius: float) -> Message:
    """Return a chain (n, 3) and its radius [mm] at a time [s] as a message ``MarkerArray``."""
    thick = (2.0 * METRE * radius, 0.0, 0.0)
    return _mark(LINE_STRIP, time, METRE * joints, scale=thick, color=(0.25, 0.4, 0.6, 1.0))


def _mark(
    kind: int, time: float, points: Floats, *, scale: Sequence[float], color: Sequence[float]
) -> Message:
    marker = {
        "header": make_header(time),
        "type": kind,
        "pose": {"orientation": {"w": 1.0}},
        "scale": to_xyz(scale),
        "color": dict(zip("rgba", color, strict=True)),
        "points": [to_xyz(point) for point in points],
    }
    return {"markers": [marker]}
