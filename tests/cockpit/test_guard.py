"""The guard: each row of its table, asked by a client that is no browser."""

from __future__ import annotations

import http.client

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from bozzini.cockpit.guard import HEADERS, Access

TOKEN = "a-token"


def _raw(port: int, *headers: tuple[str, str], path: str = "/state", method: str = "GET"):
    client = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    client.putrequest(method, path, skip_host=True)
    for name, value in headers:
        client.putheader(name, value)
    client.endheaders()
    answer = client.getresponse()
    answer.read()
    return answer


@pytest.fixture
def plain(serve):
    return serve()


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost", "LocalHost", "[::1]"])
def test_names_of_this_computer_are_served(plain, name) -> None:
    assert _raw(plain.access.port, ("Host", f"{name}:{plain.access.port}")).status == 200


@pytest.mark.parametrize(
    "hosts",
    [
        ("evil.example:{port}",),
        ("127.0.0.1.evil.example:{port}",),
        ("127.0.0.1",),
        ("localhost:1",),
        ("192.168.1.7:{port}",),
        ("[::1:{port}",),
        ("",),
        ("127.0.0.1:{port}", "127.0.0.1:{port}"),
        ("127.0.0.1:{port}", "evil.example"),
    ],
)
def test_foreign_hosts_are_refused(plain, hosts) -> None:
    port = plain.access.port
    answer = _raw(port, *(("Host", host.format(port=port)) for host in hosts))
    assert answer.status in (400, 403) and answer.status != 200
    if len(hosts) == 1 and hosts[0]:
        assert answer.status == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:{port}", ""])
def test_foreign_origins_are_refused(plain, origin) -> None:
    port = plain.access.port
    own = ("Host", f"127.0.0.1:{port}")
    assert _raw(port, own, ("Origin", origin.format(port=port))).status == 403
    assert _raw(port, own, ("Origin", f"http://127.0.0.1:{port}")).status == 200


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_other_sites_may_only_open_the_page(plain, site) -> None:
    port = plain.access.port
    headers = ("Host", f"127.0.0.1:{port}"), ("Sec-Fetch-Site", site)
    assert _raw(port, *headers).status == 403
    assert _raw(port, *headers, path="/").status == 200
    assert _raw(port, headers[0], ("Sec-Fetch-Site", "same-origin")).status == 200


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS"])
def test_nothing_but_reading(plain, method) -> None:
    own = ("Host", f"127.0.0.1:{plain.access.port}")
    assert _raw(plain.access.port, own, method=method).status == 405


def test_every_answer_has_the_policy(plain) -> None:
    port = plain.access.port
    own = ("Host", f"127.0.0.1:{port}")
    for path in ("/", "/state", "/none", "/web/none.js"):
        answer = _raw(port, own, path=path)
        assert {key: answer.getheader(key) for key in HEADERS} == HEADERS
        assert answer.getheader("server") is None
    assert _raw(port, ("Host", "evil.example")).getheader("content-security-policy")


@pytest.mark.parametrize(
    "given",
    [
        {"origin": "https://127.0.0.1:{port}"},
        {"origin": "http://127.0.0.1:1"},
        {"origin": "http://localhost:{port}"},
        {"origin": "null"},
        {"origin": None},
        {"additional_headers": {"Sec-Fetch-Site": "cross-site"}},
    ],
)
def test_web_sockets_of_other_pages_are_refused(plain, given) -> None:
    origin = given.get("origin", "http://127.0.0.1:{port}")
    given["origin"] = origin.format(port=plain.access.port) if origin else None
    with pytest.raises(InvalidStatus) as caught:
        plain.connect(**given)
    assert caught.value.response.status_code == 403
    assert plain.state()["windows"] == 0


def test_token_is_asked_for_everywhere_and_kept_in_a_cookie(serve) -> None:
    served = serve(token=TOKEN)
    port = served.access.port
    for path in ("/", "/state", "/?token=wrong", "/?token=", "/?token=%ff", f"/?tokens={TOKEN}"):
        assert served.get(path)[0] == 403
    status, headers, _ = served.get(f"/?a=b&token={TOKEN}")
    assert (status, headers["location"]) == (303, "/?a=b")
    cookie = headers["set-cookie"]
    assert cookie.startswith(f"bozzini-{port}={TOKEN};")
    assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
    shown = {"Cookie": f"other=1; bozzini-{port}={TOKEN}"}
    assert served.get("/state", shown)[0] == 200
    assert served.get("/state", {"Cookie": f"bozzini-{port + 1}={TOKEN}"})[0] == 403
    assert served.get("/state", {**shown, "Origin": "http://evil.example"})[0] == 403
    served.connect(additional_headers=shown)
    served.connect(origin=None, place=f"/ws?token={TOKEN}")
    for options in ({}, {"place": "/ws?token=wrong"}):
        with pytest.raises(InvalidStatus) as caught:
            served.connect(**options)
        assert caught.value.response.status_code == 403


def test_address_with_a_token_leads_nowhere_else(serve) -> None:
    served = serve(token=TOKEN)
    for path in (f"//evil.example/?token={TOKEN}", f"/%0d%0aX:1?token={TOKEN}"):
        status, headers, _ = served.get(path)
        assert status == 303 and "x" not in headers
        assert headers["location"].startswith("/") and not headers["location"].startswith("//")


def test_open_server_takes_addresses_and_its_names_only() -> None:
    access = Access(port=8000, token=TOKEN, is_open=True, names=("ward.local",))
    for host in ("192.168.1.7:8000", "[fe80::1]:8000", "ward.local:8000", "localhost:8000"):
        assert access.is_host(host)
    for host in (
        "evil.example:8000",
        "192.168.1.7",
        "fe80::1:8000",
        "[192.168.1.7]:8000",
        "1:8000",
    ):
        assert not access.is_host(host)
    assert Access(port=80).is_host("localhost") and not Access(port=80).is_host("localhost:8000")


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("no JSON", 1003),
        ("[1, 2]", 1003),
        ('{"kind": "unknown"}', 1003),
        ('{"kind": ["stick"]}', 1003),
        ('{"kind": "stick", "x": NaN, "y": 0}', 1003),
        ('{"kind": "stick", "x": 1e999, "y": 0}', 1003),
        ('{"kind": "stick", "x": 2, "y": 0}', 1003),
        ('{"kind": "stick", "x": "1", "y": 0}', 1003),
        ('{"kind": "stick", "x": true, "y": 0}', 1003),
        ('{"kind": "stick", "x": 0}', 1003),
        ('{"kind": "stick", "x": 0, "y": 0, "z": 0}', 1003),
        ('{"kind": "seek", "step": 1e999}', 1003),
        ('{"kind": "seek", "step": -Infinity}', 1003),
        ('{"kind": "seek", "step": ' + "9" * 400 + "}", 1003),
        ('{"kind": "play", "on": 1}', 1003),
        ('{"kind": "rig", "what": "fire"}', 1003),
        ('{"kind": "change", "diameter": 1e999}', 1003),
        ("[" * 4000, 1003),
        (b'{"kind": "seek", "step": 1}', 1003),
        ('{"kind": "seek", "step": 1}' + " " * 5000, 1009),
    ],
)
def test_malformed_messages_end_the_connection(plain, message, code) -> None:
    client = plain.connect()
    client.send(message)
    with pytest.raises(ConnectionClosed) as caught:
        while True:
            client.recv(timeout=10)
    assert caught.value.rcvd.code == code
    assert plain.get("/state")[0] == 200
