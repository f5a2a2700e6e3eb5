from __future__ import annotations

import hashlib
import re
import socket
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from bozzini.anatomy import CATALOGUE, PublicData, fetch_data
from bozzini.anatomy.fetch import find_data
from bozzini.errors import FileFormatError, OutputError

CONTENT = b"a small tract\n" * 200_000


def entry(url, **changes):
    values = {
        "name": "test",
        "what": "A tract for tests",
        "licence": "CC0",
        "citation": "Nobody, 'Nothing', 2026",
        "url": url,
        "file_name": "tract.stl",
    }
    return PublicData(**(values | changes))


@pytest.fixture
def local(tmp_path):
    path = tmp_path / "source.stl"
    path.write_bytes(CONTENT)
    return path.as_uri()


class Handler(BaseHTTPRequestHandler):
    def do_GET(self):
        if self.path == "/missing":
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Length", str(len(CONTENT)))
        self.end_headers()
        self.wfile.write(CONTENT[: 1000 if self.path == "/cut" else None])

    def log_message(self, *arguments):
        pass


@pytest.fixture(scope="module")
def server():
    server = HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def test_a_file_comes_whole_with_its_citation(tmp_path, local):
    digest = hashlib.sha256(CONTENT).hexdigest()
    steps = []
    done = fetch_data(
        entry(local, sha256=digest),
        tmp_path / "data",
        progress=lambda stage, fraction: steps.append(fraction),
    )
    assert done.path.read_bytes() == CONTENT
    assert (done.sha256, done.verified, done.size) == (digest, True, len(CONTENT))
    assert steps == sorted(steps)
    assert steps[-1] == 1.0
    said = done.citation_path.read_text(encoding="utf-8")
    assert done.citation_path.name == "tract.stl.citation.txt"
    for part in ("CC0", "Nobody, 'Nothing', 2026", local, digest):
        assert part in said
    assert "not verified" not in said


def test_an_unknown_checksum_is_computed_and_said_to_be_unverified(tmp_path, local):
    done = fetch_data(entry(local), tmp_path / "data")
    assert not done.verified
    assert done.sha256 == hashlib.sha256(CONTENT).hexdigest()
    assert "not verified" in done.citation_path.read_text(encoding="utf-8")


def test_a_wrong_checksum_leaves_nothing(tmp_path, local):
    with pytest.raises(FileFormatError, match="nothing was kept"):
        fetch_data(entry(local, sha256="0" * 64), tmp_path / "data")
    assert not (tmp_path / "data").exists()


def test_a_failed_fetch_keeps_what_was_there(tmp_path, local):
    (tmp_path / "data").mkdir()
    with pytest.raises(FileFormatError):
        fetch_data(entry(local, sha256="0" * 64), tmp_path / "data")
    assert (tmp_path / "data").is_dir()
    old = tmp_path / "data" / "tract.stl"
    old.write_text("old")
    with pytest.raises(OutputError, match="exists already"):
        fetch_data(entry(local), tmp_path / "data")
    with pytest.raises(FileFormatError):
        fetch_data(entry(local, sha256="0" * 64), tmp_path / "data", force=True)
    assert old.read_text(encoding="utf-8") == "old"
    assert list((tmp_path / "data").iterdir()) == [old]
    fetch_data(entry(local), tmp_path / "data", force=True)
    assert old.read_bytes() == CONTENT


def test_a_server_gives_the_same_file(tmp_path, server):
    assert fetch_data(entry(server + "/whole"), tmp_path).path.read_bytes() == CONTENT


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.mark.parametrize("place", ["/missing", "/cut", "refused", "file", "empty"])
def test_a_place_that_does_not_give_it_is_one_line(tmp_path, server, place):
    url = {
        "refused": f"http://127.0.0.1:{free_port()}/x",
        "file": (tmp_path / "nothing.stl").as_uri(),
        "empty": (tmp_path / "empty.stl").as_uri(),
    }.get(place, server + place)
    (tmp_path / "empty.stl").touch()
    with pytest.raises(FileFormatError) as caught:
        fetch_data(entry(url), tmp_path / "data")
    assert url in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "data").exists()


def test_the_catalogue_is_complete():
    names = [item.name for item in CATALOGUE]
    assert len(set(names)) == len(names)
    for item in CATALOGUE:
        assert find_data(item.name) is item
        assert item.url.startswith("https://")
        assert re.search(r"doi:10\.\d{4,}/", item.citation)
