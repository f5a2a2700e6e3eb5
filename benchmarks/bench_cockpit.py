"""The cockpit's server: frames a second, processor time, and time from the stick to the frame."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import threading
import time
from typing import Any

import numpy as np
import pytest
from websockets.sync.client import connect

SECONDS = 8.0
SERVER = """
import asyncio, sys, threading, time
from bozzini.cockpit.drive import Drive
from bozzini.cockpit.guard import Access
from bozzini.cockpit.server import bind, make_server, run_server
from bozzini.cockpit.session import Session
from bozzini.effector import Effector
from tests.cockpit.conftest import make_plan
session = Session()
session.drive = Drive(Effector.from_preset("prototype"))
session.show(make_plan(links=int(sys.argv[1]), steps=3000))
listener = bind("127.0.0.1", 0)
port = listener.getsockname()[1]
server = make_server(session, Access(port=port), page="", folders=())
def end():
    print(time.process_time(), flush=True)
    sys.stdin.readline()
    print(time.process_time(), flush=True)
    server.should_exit = True
def begin():
    print(port, flush=True)
    threading.Thread(target=end, daemon=True).start()
asyncio.run(run_server(server, listener, session=session, when_ready=begin))
"""


def _listen(port: int, found: list[tuple[float, list[float]]], *, steers: bool) -> None:
    """Count frames; one window also plays the plan and moves the stick ten times a second."""
    host = f"127.0.0.1:{port}"
    with connect(f"ws://{host}/ws", origin=f"http://{host}", max_size=None) as window:
        if steers:
            window.send(json.dumps({"kind": "play", "on": True, "speed": 100.0}))
        begin = asked = time.monotonic()
        count, echoed, delays = 0, 0.0, []
        while (now := time.monotonic()) < begin + SECONDS:
            data = window.recv()
            if not isinstance(data, bytes):
                continue
            count += 1
            echo = struct.unpack_from("<d", data, 40)[0]
            if echo != echoed:
                delays.append(time.monotonic() - echo)
                echoed = echo
            if steers and now > asked + 0.1:
                asked = now
                move = {"x": 0.1 + 0.3 * (len(delays) % 7) / 7, "y": 0.2}
                window.send(json.dumps({"kind": "stick", **move, "time": time.monotonic()}))
        found.append((count / SECONDS, delays))


@pytest.mark.parametrize(("links", "windows"), [(51, 1), (400, 1), (400, 4)])
def bench_frames(benchmark: Any, links: int, windows: int) -> None:
    command = [sys.executable, "-c", SERVER, str(links)]
    with subprocess.Popen(command, stdin=-1, stdout=-1, text=True) as server:
        assert server.stdin and server.stdout
        port, before = int(server.stdout.readline()), float(server.stdout.readline())
        found: list[tuple[float, list[float]]] = []

        def run() -> None:
            threads = [
                threading.Thread(target=_listen, args=(port, found), kwargs={"steers": k == 0})
                for k in range(windows)
            ]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()

        benchmark.pedantic(run, rounds=1)
        server.stdin.write("\n")
        server.stdin.flush()
        share = (float(server.stdout.readline()) - before) / SECONDS
    rate = min(rate for rate, _ in found)
    delays = np.concatenate([each for _, each in found])
    late = 1e3 * float(np.quantile(delays, 0.95))
    benchmark.extra_info.update(
        what=f"cockpit: frames of {links} links to {windows} window(s) while the head plays",
        measured=f"{rate:.0f} frames/s, {100.0 * share:.1f} % of a core; stick to frame "
        f"{1e3 * float(np.median(delays)):.0f} ms in the median, {late:.0f} ms at 95 %",
        required="55 frames/s, 15 % of a core, 35 ms",
    )
    assert rate >= 55.0 and share < 0.15 and late <= 35.0
