"""What 3D Slicer is shown over OpenIGTLink: pyigtl is at the other end."""

from __future__ import annotations

import asyncio
import json
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace

import numpy as np
import pyigtl
import pytest
from pyigtl import messages

from bozzini import Plan
from bozzini.cli.main import main
from bozzini.cockpit.session import Outline, Session
from bozzini.cockpit.slicer import SlicerWindow
from bozzini.cockpit.wire import Change
from bozzini.errors import InputError, OutputError
from bozzini.scene import SlicerLink, slicer
from tests.cli.plan_cases import CURVE, SCOPE, write_tracts
from tests.cockpit.conftest import make_plan

TO_RAS = np.diag([-1.0, -1.0, 1.0])
"""Of LPS."""
JOINTS = np.array([[3.0, 40.0, 7.0], [3.0, 30.0, 7.0], [1.0, 21.0, 7.0]])


class Model(messages.MessageBase):
    """POLYDATA as its page defines it: pyigtl packs it only."""

    def _unpack_content(self, content: bytes) -> None:
        head = struct.unpack(">10I", content[:40])
        points, (lines, line_bytes), (polygons, polygon_bytes) = head[0], head[3:5], head[5:7]
        assert (head[1:3], head[7:]) == ((0, 0), (0, 0, 0))
        ends = np.cumsum([40, 12 * points, line_bytes, polygon_bytes])
        assert ends[-1] == len(content)
        self.points = np.frombuffer(content[ends[0] : ends[1]], ">f4").reshape(-1, 3)
        self.line = np.frombuffer(content[ends[1] : ends[2]], ">u4")
        faces = np.frombuffer(content[ends[2] : ends[3]], ">u4").reshape(polygons, 4)
        assert (faces[:, 0] == 3).all() and lines in (0, 1)
        self.faces = faces[:, 1:].astype(int)


@pytest.fixture(autouse=True)
def models(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(messages.message_type_to_class_constructor, "POLYDATA", Model)
    monkeypatch.setattr(slicer, "FRAME_RATE", 1e9)


def find_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


@contextmanager
def serve(*points: messages.PointMessage) -> Iterator[tuple[pyigtl.OpenIGTLinkServer, str]]:
    server = pyigtl.OpenIGTLinkServer(port=0)
    for message in points:
        server.send_message(message, wait=False)
    try:
        yield server, f"127.0.0.1:{server.server_address[1]}"
    finally:
        server.stop()


def test_slicer_gets_wall_line_and_scope_in_ras() -> None:
    corners = np.array([[0.0, 0, 0], [9, 0, 0], [0, 8, 0], [0, 0, 7]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    with serve() as (server, address), SlicerLink.open(address) as link:
        link = SlicerLink(connection=link.connection, frame="LPS")
        link.send_wall(corners, faces)
        link.send_line(JOINTS)
        link.play(np.stack([JOINTS - 5.0, JOINTS]), radius=1.5)
        tip = server.wait_for_message("ScopeTip", timeout=5)
        while not np.allclose(tip.matrix[:3, 3], TO_RAS @ JOINTS[0]):
            tip = server.wait_for_message("ScopeTip", timeout=5)
        wall, line, scope = (server.wait_for_message(n, 5) for n in ("Wall", "Line", "Scope"))
    np.testing.assert_allclose(wall.points, corners @ TO_RAS)
    assert wall.faces.tolist() == faces.tolist()
    np.testing.assert_allclose(line.points, JOINTS @ TO_RAS)
    assert line.line.tolist() == [3, 0, 1, 2]
    np.testing.assert_allclose(tip.matrix[:3, 2], [0.0, 1.0, 0.0], atol=1e-6)  # to the tail, RAS
    assert np.linalg.det(tip.matrix) == pytest.approx(1.0)
    corner = scope.points[scope.faces]
    volume = np.einsum("ij,ij->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6.0
    assert volume == pytest.approx(np.pi * 1.5**2 * (19.2 + 1.0), rel=0.05)  # outwards
    gaps = np.linalg.norm(scope.points - TO_RAS @ JOINTS[0], axis=1)
    assert gaps.min() == pytest.approx(1.5, abs=1e-4)


def test_faces_turn_outwards_in_a_frame_of_the_other_hand() -> None:
    with serve() as (server, address), SlicerLink.open(address) as link:
        link = SlicerLink(connection=link.connection, frame="LAS")
        link.send_wall(JOINTS, np.array([[0, 1, 2]]))
        wall = server.wait_for_message("Wall", timeout=5)
    assert wall.faces.tolist() == [[2, 1, 0]]


def test_fiducials_are_known_by_their_own_name_or_their_list() -> None:
    places = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    lists = (
        pyigtl.PointMessage(places, names=["Start", "Polyp"], device_name="F"),
        pyigtl.TransformMessage(np.eye(4), device_name="Probe"),
        pyigtl.PointMessage(places, names=["F-1", "F-2"], device_name="Targets"),
        pyigtl.PointMessage(places[:1], names=["F-1"], device_name="target_1"),
    )
    with serve(*lists) as (_, address), SlicerLink.open(address) as link:
        found = SlicerLink(connection=link.connection, frame="LPS").receive_points(quiet=0.2)
    assert set(found) == {"start", "target"}
    np.testing.assert_allclose(found["start"], [[-1.0, -2.0, 3.0]])
    np.testing.assert_allclose(found["target"], [[-1.0, -2.0, 3.0]])


def test_a_plan_starts_and_ends_where_slicer_says(tmp_path, capsys) -> None:
    tract = write_tracts(tmp_path).surface
    port = find_port()  # a client: it is waited for
    client = pyigtl.OpenIGTLinkClient("127.0.0.1", port)
    ends = CURVE[[-6, 5]] - CURVE.min(axis=0) + 12.0
    client.send_message(
        pyigtl.PointMessage(ends @ TO_RAS, names=["start", "end"], device_name="F"), wait=False
    )
    out = tmp_path / "plan"
    line = ["plan", str(tract), *SCOPE, "--frame", "LPS", "--igtl", str(port), "--out", str(out)]
    code = main([*line, "--json", "--quiet"])
    printed = capsys.readouterr()
    assert code == 0, printed.err
    assert f"waiting for 3D Slicer at 127.0.0.1:{port}" in printed.err
    summary = json.loads(printed.out)
    assert summary["entry"]["point_mm"] == pytest.approx(ends[0], abs=2.0)
    assert summary["goal"]["point_mm"] == pytest.approx(ends[1], abs=2.0)
    assert "--start" in summary["command"] and "--igtl" not in summary["command"]
    plan = Plan.load(out / "plan.npz")
    time.sleep(0.2)
    tip = client.wait_for_message("ScopeTip", timeout=5)
    assert tip.matrix[:3, 3] @ TO_RAS == pytest.approx(plan.joints[-1, 0], abs=1e-3)
    wall = client.wait_for_message("Wall", timeout=5)
    line = client.wait_for_message("Line", timeout=5)
    client.stop()
    gaps = np.linalg.norm(wall.points[None] - line.points[::10, None], axis=2).min(axis=1)
    assert 6.0 < np.median(gaps) < 9.0


def test_the_cockpit_shows_its_step_and_plans_to_a_fiducial() -> None:
    faces = np.array([[0, 1, 2]])
    outline = Outline(vertices=JOINTS, faces=faces, line=JOINTS, frame="LPS")
    session, asked = Session(), []
    session.show(replace(make_plan(), outline=outline))
    session.ask_plan = asked.append

    async def show(link: SlicerLink, server: pyigtl.OpenIGTLinkServer) -> list[np.ndarray]:
        task = asyncio.create_task(SlicerWindow(link, session).run())
        tips = []
        for step in (3, 7):
            session.go_to(step)
            tip = await asyncio.to_thread(server.wait_for_message, "ScopeTip", 5)
            tips.append(tip.matrix[:3, 3])
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        return tips

    end = pyigtl.PointMessage([[1.0, 2.0, 3.0]], names=["end"], device_name="F")
    with serve(end) as (server, address), SlicerLink.open(address) as link:
        tips = asyncio.run(show(link, server))
        wall = server.wait_for_message("Wall", timeout=5)
    np.testing.assert_allclose(tips, session.plan.joints[[3, 7], 0] @ TO_RAS)
    np.testing.assert_allclose(wall.points, JOINTS @ TO_RAS)
    assert asked == [Change(end=(-1.0, -2.0, 3.0))]


@pytest.mark.parametrize(
    ("address", "host", "port"),
    [
        ("18945", "127.0.0.1", 18945),
        ("localhost", "localhost", 18944),
        ("lab-2:5000", "lab-2", 5000),
        ("[::1]:5000", "::1", 5000),
        ("::1", "::1", 18944),
    ],
)
def test_addresses(address: str, host: str, port: int) -> None:
    assert slicer.parse_address(address) == (host, port)
    assert slicer.is_loopback(host) == (host != "lab-2")


def test_another_host_is_warned_of_and_nobody_there_is_one_line(monkeypatch, capsys) -> None:
    monkeypatch.setattr(slicer, "WAIT_FOR_SLICER", 0.05)
    assert main(["plan", "tract.stl", "--igtl", f"0.0.0.0:{find_port()}"]) == 2
    warning, waiting, error = capsys.readouterr().err.splitlines()
    assert warning.startswith("bozzini: warning: 0.0.0.0 is not this computer alone")
    assert "waiting" in waiting and "there is no 3D Slicer" in error
    with pytest.raises(InputError, match="'host:0' is no address"):
        slicer.parse_address("host:0")


def test_a_connection_that_ends_is_told() -> None:
    ours, theirs = socket.socketpair()
    with SlicerLink(connection=ours) as link:
        theirs.sendall(b"x" * 58)
        with pytest.raises(InputError, match="cannot be read"):
            link.receive_points(quiet=0.05)
        theirs.close()
        assert link.receive_points(quiet=0.05) == {}
        with pytest.raises(OutputError, match="nothing more"):
            link.send_line(JOINTS)
