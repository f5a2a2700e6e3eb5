"""Wall, line and scope shown live in 3D Slicer, and its fiducials, by OpenIGTLink.

Slicer's module OpenIGTLinkIF shows ``POLYDATA`` as models, ``TRANSFORM`` as transforms, and sends
lists of points as ``POINT``, all in mm in RAS. pyigtl packs and unpacks them; the socket is our
own, since pyigtl's drops a model that is not taken within 10 ms.
"""

from __future__ import annotations

import ipaddress
import re
import select
import socket
import struct
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..anatomy.files import explain
from ..anatomy.frame import convert_frame
from ..checks import check_points
from ..errors import InputError, MissingExtraError, OutputError
from ..numeric.arrays import Floats
from ..results import Shown
from .gltf import build_tube, choose_keys, compute_bone_rotations, convert_to_matrices

PORT = 18944
"""Of OpenIGTLink."""

WAIT_FOR_SLICER = 60.0
"""How long it is waited for, where it does not listen itself [s]."""

PATIENCE = 30.0
"""How long one message may take [s]."""

FRAME_RATE, FRAMES = 20.0, 200
"""Of a plan that is played [Hz], and how many of its steps at most."""

ROLES = ("start", "end", "target")
"""What points are called that are taken."""

LARGEST_MESSAGE = 1 << 26
"""Bytes of a message that is read."""


def parse_address(address: str) -> tuple[str, int]:
    """Return host and port of ``HOST:PORT``, ``HOST`` or ``PORT``; by default this computer's.

    Raises
    ------
    InputError
        If it is none of these.
    """
    text = address.strip()
    host, colon, port = ("", ":", text) if text.isdigit() else text.rpartition(":")
    if not colon or text.endswith("]") or (text.count(":") > 1 and not host.endswith("]")):
        host, port = text, str(PORT)
    if not (port.isascii() and port.isdigit() and 1 <= int(port[:9]) <= 65535):
        raise InputError(
            f"'{address}' is no address: it must be HOST:PORT with a port in [1, 65535], such as "
            f"127.0.0.1:{PORT}"
        )
    return host.strip("[]") or "127.0.0.1", int(port)


def is_loopback(host: str) -> bool:
    """Whether a host is this computer, and reached by no other."""
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host.lower() == "localhost"


@dataclass(frozen=True, kw_only=True, eq=False)
class SlicerLink(Shown):
    """A connection to the module OpenIGTLinkIF of 3D Slicer.

    Parameters
    ----------
    connection : socket
        As `open` makes it.
    frame : str
        Of all coordinates that are given and returned, such as ``"LPS"``: see
        `bozzini.anatomy.frame.check_frame`.

    Raises
    ------
    InputError
        If the frame is none.
    """

    connection: socket.socket
    frame: str = "RAS"

    def __post_init__(self) -> None:
        _ = self._turn

    @classmethod
    def open(
        cls, address: str, *, announce: Callable[[str], None] = lambda text: None
    ) -> SlicerLink:
        """Connect to who listens at an address; where nobody does, listen there for a while.

        Parameters
        ----------
        address : str
            See `parse_address`.
        announce : callable
            Is told where it is listened, if it is.

        Raises
        ------
        InputError
            If it is no address, or nobody is there.
        MissingExtraError
            If pyigtl is not installed.
        """
        host, port = parse_address(address)
        try:
            import pyigtl  # noqa: F401
        except ImportError:
            raise MissingExtraError("pyigtl", "igtl") from None
        try:
            with suppress(ConnectionRefusedError):
                return cls(connection=socket.create_connection((host, port), PATIENCE))
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            with socket.create_server((host, port), family=family) as server:
                server.settimeout(WAIT_FOR_SLICER)
                announce(f"waiting for 3D Slicer at {host}:{port}, {WAIT_FOR_SLICER:g} s at most")
                connection, _ = server.accept()
        except OSError as error:
            raise InputError(
                f"there is no 3D Slicer at {host}:{port} ({explain(error)}): its OpenIGTLinkIF "
                f"must have an active connector"
            ) from None
        connection.settimeout(PATIENCE)
        return cls(connection=connection)

    def __enter__(self) -> SlicerLink:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.connection.close()

    @property
    def _turn(self) -> Floats:
        return convert_frame(np.eye(4), self.frame)[:3, :3]

    def send_wall(self, vertices: ArrayLike, faces: NDArray[np.int64]) -> None:
        """Show triangles as the model ``Wall``.

        Parameters
        ----------
        vertices : array_like, shape (n, 3)
            [mm].
        faces : ndarray, shape (m, 3)
            Anticlockwise seen from outside.

        Raises
        ------
        OutputError
            If Slicer takes nothing more.
        """
        outward = faces if np.linalg.det(self._turn) > 0.0 else faces[:, ::-1]
        self._send_model("Wall", check_points("vertices", vertices) @ self._turn.T, outward)

    def send_line(self, points: ArrayLike) -> None:
        """Show a line (n, 3) [mm] as the model ``Line``."""
        import pyigtl

        places = check_points("points", points) @ self._turn.T
        row = np.concatenate([[len(places)], np.arange(len(places))])
        self._send(pyigtl.PolyDataMessage(points=places, lines=row, device_name="Line"))

    def send_scope(self, joints: ArrayLike, *, radius: float) -> None:
        """Show a scope as the model ``Scope``, and its head as the transform ``ScopeTip``.

        Parameters
        ----------
        joints : array_like, shape (joints, 3)
            The head first [mm].
        radius : float
            [mm].

        Notes
        -----
        The transform's -z points ahead, as that of a camera; it does not roll with the scope.
        """
        self._send_poses(check_points("joints", joints)[None], radius=radius)

    def play(self, joints: ArrayLike, *, radius: float) -> None:
        """Show a motion (steps, joints, 3) [mm] as `send_scope` does, at `FRAME_RATE`.

        There are at most `FRAMES`, spread evenly over the steps.
        """
        chain = check_points("joints", joints)
        self._send_poses(chain[choose_keys(len(chain), FRAMES)], radius=radius)

    def _send_poses(self, poses: Floats, *, radius: float) -> None:
        import pyigtl

        poses = poses @ self._turn.T
        frames = convert_to_matrices(compute_bone_rotations(poses))
        begin = time.monotonic()
        for number, (pose, turns) in enumerate(zip(poses, frames, strict=True)):
            time.sleep(max(begin + number / FRAME_RATE - time.monotonic(), 0.0))
            tube = build_tube(pose, turns, radius=radius)
            self._send_model("Scope", tube.vertices, tube.faces)
            tip = np.eye(4)
            tip[:3, :3], tip[:3, 3] = turns[0], pose[0]
            self._send(pyigtl.TransformMessage(tip, device_name="ScopeTip"))

    def _send_model(self, name: str, vertices: Floats, faces: NDArray[np.int64]) -> None:
        import pyigtl

        cells = np.column_stack((np.full(len(faces), 3), faces)).ravel()
        self._send(pyigtl.PolyDataMessage(points=vertices, polygons=cells, device_name=name))

    def _send(self, message: object) -> None:
        try:
            self.connection.sendall(message.pack())  # type: ignore[attr-defined]
        except OSError as error:
            raise OutputError(f"3D Slicer takes nothing more: {explain(error)}") from None

    def receive_points(self, quiet: float = 1.0) -> dict[str, Floats]:
        """Return the points that Slicer sends until it is quiet for so long.

        Parameters
        ----------
        quiet : float
            [s].

        Returns
        -------
        dict of str to ndarray, shape (n, 3)
            By `ROLES`, as far as they were sent [mm]: that of a point is its own name without a
            number (``start``, ``Target-2``), else its list's.

        Raises
        ------
        InputError
            If what comes is no OpenIGTLink.
        """
        found: dict[str, list[tuple[float, ...]]] = {}
        end = time.monotonic() + 10.0 * quiet  # something else may be sent all the time
        while time.monotonic() < end and select.select([self.connection], [], [], quiet)[0]:
            try:
                message = self._receive()
            except (OSError, ValueError, struct.error) as error:
                text = f"what 3D Slicer sent cannot be read: {explain(error)}"
                raise InputError(text) from None
            if message is None:
                break
            found |= _sort_points(message)  # of a list that is sent twice the last one counts
        return {role: check_points(role, places) @ self._turn for role, places in found.items()}

    def _receive(self) -> object:
        """Return the next message, empty unless it has points; None at the end."""
        import pyigtl

        head = self._read(pyigtl.MessageBase.IGTL_HEADER_SIZE)
        if not head:
            return None
        fields = pyigtl.MessageBase.parse_header(head)
        if fields["body_size"] > LARGEST_MESSAGE:
            raise ValueError(f"a message of {fields['body_size']} bytes")
        body = self._read(fields["body_size"])
        if fields["message_type"] != "POINT":
            return pyigtl.MessageBase()
        message = pyigtl.PointMessage()
        message.unpack(fields, body)
        return message

    def _read(self, size: int) -> bytes:
        data = bytearray()
        while len(data) < size:
            piece = self.connection.recv(size - len(data))
            if not piece:
                return b""
            data += piece
        return bytes(data)


def _sort_points(message: object) -> dict[str, list[tuple[float, ...]]]:
    """Return the points of a message by their roles."""
    found: dict[str, list[tuple[float, ...]]] = {}
    names = getattr(message, "names", [])
    for name, place in zip(names, getattr(message, "positions", []), strict=True):
        for word in (name, getattr(message, "device_name", "")):
            role = re.sub(r"[-_ ]*\d*$", "", word.strip().lower())
            if role in ROLES:
                found.setdefault(role, []).append(place)
                break
    return found
