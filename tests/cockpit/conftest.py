"""A cockpit in a thread, and raw clients that speak to it."""

from __future__ import annotations

import asyncio
import http.client
import json
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np
import pytest
import uvicorn
from websockets.sync.client import ClientConnection, connect

from bozzini.cockpit.guard import Access
from bozzini.cockpit.server import bind, make_server, run_server
from bozzini.cockpit.session import Session, ShownPlan

LINKS, STEPS = 5, 40


def wait_until(is_so: Callable[[], object], limit: float = 10.0) -> None:
    end = time.monotonic() + limit
    while not is_so():
        assert time.monotonic() < end, "it does not come about"
        time.sleep(0.005)


def make_plan(*, links: int = LINKS, steps: int = STEPS) -> ShownPlan:
    """A straight body of links of 10 mm that goes up by 1 mm a step."""
    heads = np.arange(steps, dtype=np.float64)
    joints = np.zeros((steps, links + 1, 3), dtype=np.float32)
    joints[:, :, 2] = heads[:, None] - 10.0 * np.arange(links + 1)
    clearance = np.where(joints[:, 1:, 2] < 0.0, np.nan, 2.0).astype(np.float32)
    return ShownPlan(view=b"view", joints=joints, clearance=clearance, travel=heads, radius=2.0)


@dataclass
class Served:
    """A running server."""

    session: Session
    access: Access
    server: uvicorn.Server
    sockets: ExitStack = field(default_factory=ExitStack)

    def connect(self, **given: object) -> ClientConnection:
        options = {"origin": f"http://127.0.0.1:{self.access.port}", "max_size": 2**24}
        place = given.pop("place", "/ws")
        options |= given
        port = self.access.port
        return self.sockets.enter_context(connect(f"ws://127.0.0.1:{port}{place}", **options))

    def get(self, path: str, headers: dict[str, str] | None = None) -> tuple[int, dict, bytes]:
        client = http.client.HTTPConnection("127.0.0.1", self.access.port, timeout=10)
        client.request("GET", path, headers=headers or {})
        answer = client.getresponse()
        found = answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()
        client.close()
        return found

    def state(self) -> dict:
        return json.loads(self.get("/state")[2])


@pytest.fixture
def serve() -> Iterator[Callable[..., Served]]:
    stops = []

    def start(session: Session | None = None, **given: object) -> Served:
        session = session or Session(may_arm=given.get("token") is not None)
        listener = bind("127.0.0.1", 0)
        access = Access(port=listener.getsockname()[1], **given)
        server = make_server(session, access, page="<p>page</p>", folders=())
        ready = threading.Event()

        def run() -> None:
            asyncio.run(run_server(server, listener, session=session, when_ready=ready.set))

        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        assert ready.wait(10)
        served = Served(session, access, server)
        stops.append((served, server, thread))
        return served

    yield start
    for served, server, thread in stops:
        served.sockets.close()
        server.should_exit = True
        thread.join(5)
        assert not thread.is_alive()


@dataclass
class Frame:
    """A frame as a page takes it apart."""

    head: tuple[int, ...]
    times: tuple[float, ...]
    parts: list[np.ndarray]

    @classmethod
    def read(cls, data: bytes) -> Frame:
        head, times = struct.unpack_from("<8I", data), struct.unpack_from("<3d", data, 32)
        links, points, muscles = head[3:6]
        sizes = [3 * (links + 1) if links else 0, links, 2 * muscles, 8, 3 * points, 9]
        floats = np.frombuffer(data, "<f4", offset=56)
        assert floats.size == sum(sizes)
        return cls(head, times, np.split(floats, np.cumsum(sizes)[:-1]))


def next_frame(client: ClientConnection, is_it: Callable[[Frame], object] = bool) -> Frame:
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        data = client.recv(timeout=10)
        if isinstance(data, bytes):
            frame = Frame.read(data)
            if is_it(frame):
                return frame
    raise AssertionError("no such frame")
