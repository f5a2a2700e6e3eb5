"""Who may speak to the cockpit: a guard round the whole application, web sockets included.

A page of another origin can send requests to a server on this computer, and by a name that it
makes point here it can even read the answers. So the names of the host are checked, the origin of
the page that asks, and, where others could connect or a rig is driven, a token.
"""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Awaitable, Callable, Iterator, MutableMapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl, quote, urlencode

Scope = MutableMapping[str, Any]
Event = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Event]]
Send = Callable[[Event], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
"""Names of this computer that no other one can have."""

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}
"""Of every answer."""


@dataclass(frozen=True, kw_only=True)
class Access:
    """Under which names the server is reached, and by whom.

    Parameters
    ----------
    port : int
        It listens there.
    token : str or None
        What every request must show, in a cookie or once as ``?token=``; None: nothing.
    is_open : bool
        Whether it listens to other computers: then addresses and `names` are legal hosts too.
    names : tuple of str
        Names of this computer for others.
    """

    port: int
    token: str | None = None
    is_open: bool = False
    names: tuple[str, ...] = ()

    @property
    def cookie(self) -> str:
        """Name of the cookie with the token; ports of one host share their cookies."""
        return f"bozzini-{self.port}"

    def is_host(self, host: str) -> bool:
        """Whether a request may name this host and port."""
        name, colon, port = host.rpartition(":")
        if not colon or name.endswith(":") or (name.startswith("[") != name.endswith("]")):
            name, port = host, "80"
        if port != str(self.port):
            return False
        name = name.lower()
        return name in LOOPBACK or (self.is_open and (name in self.names or _is_address(name)))

    def is_token(self, given: str | None) -> bool:
        """Whether a token is the right one."""
        if self.token is None or given is None:
            return False
        return hmac.compare_digest(given.encode("utf-8", "replace"), self.token.encode())


def _is_address(name: str) -> bool:
    """Whether a host is a literal address: no name that somebody could make point here."""
    inside = name[1:-1] if name.startswith("[") and name.endswith("]") else name
    try:
        address = ipaddress.ip_address(inside)
    except ValueError:
        return False
    return (address.version == 6) == (inside != name)


class Guard:
    """Refuses what is not from the cockpit's own page, or lacks the token, with status 403.

    Parameters
    ----------
    application : ASGI application
        What answers the rest.
    access : Access
    """

    def __init__(self, application: Application, access: Access) -> None:
        self.application, self.access = application, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request or web socket."""
        if scope["type"] == "lifespan":
            await self.application(scope, receive, send)
            return
        refusal = self._refuse(scope)
        if scope["type"] == "websocket":
            if refusal:
                await receive()
                await send({"type": "websocket.close", "code": 1008, "reason": refusal})
            else:
                await self.application(scope, receive, send)
        elif refusal:
            await _answer(send, 403, refusal)
        elif scope["method"] not in ("GET", "HEAD"):
            await _answer(send, 405, "only GET and HEAD are answered")
        elif self.access.token is not None and "token" in dict(_read_query(scope)):
            await self._give_cookie(scope, send)
        else:
            await self.application(scope, receive, _add_headers(send))

    def _refuse(self, scope: Scope) -> str:
        """Return why a request is refused; empty if it is not."""
        access, is_socket = self.access, scope["type"] == "websocket"
        hosts, origins = list(_list(scope, b"host")), list(_list(scope, b"origin"))
        if len(hosts) != 1 or not access.is_host(hosts[0]):
            return f"this host is not served: open http://127.0.0.1:{access.port}/"
        if len(origins) > 1 or (origins and origins[0] != f"http://{hosts[0]}"):
            return "this page is not of this server"
        if not origins and is_socket and access.token is None:
            return "a web socket needs an origin"
        sites = set(_list(scope, b"sec-fetch-site"))
        if sites & {"cross-site", "same-site"} and (is_socket or scope["path"] != "/"):
            return "this page is not of this server"
        if access.token is not None and not self._shows_token(scope):
            return "the token is missing or wrong: open the link that the command printed"
        return ""

    def _shows_token(self, scope: Scope) -> bool:
        given = [value for name, value in _read_query(scope) if name == "token"]
        for line in _list(scope, b"cookie"):
            for part in line.split(";"):
                name, _, value = part.strip().partition("=")
                given += [value] if name == self.access.cookie else []
        return any(map(self.access.is_token, given))

    async def _give_cookie(self, scope: Scope, send: Send) -> None:
        """Answer with a cookie and the way to the same page without the token in its address."""
        rest = urlencode([(name, value) for name, value in _read_query(scope) if name != "token"])
        place = f"/{quote(scope['path'].lstrip('/'))}" + (f"?{rest}" if rest else "")
        cookie = f"{self.access.cookie}={self.access.token}; Path=/; HttpOnly; SameSite=Strict"
        more = {"location": place, "set-cookie": cookie}
        await _answer(send, 303, "", more)


def _list(scope: Scope, name: bytes) -> Iterator[str]:
    """Give the values of a header."""
    return (value.decode("latin-1") for key, value in scope["headers"] if key.lower() == name)


def _read_query(scope: Scope) -> list[tuple[str, str]]:
    return parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True)


def _add_headers(send: Send) -> Send:
    """Return a `send` that adds `HEADERS` to the answer."""

    async def send_with_headers(event: Event) -> None:
        if event["type"] == "http.response.start":
            own = [(key, value) for key, value in event["headers"] if key.decode() not in HEADERS]
            event = {**event, "headers": [*own, *_encode(HEADERS)]}
        await send(event)

    return send_with_headers


def _encode(headers: dict[str, str]) -> list[tuple[bytes, bytes]]:
    return [(key.encode("latin-1"), value.encode("latin-1")) for key, value in headers.items()]


async def _answer(send: Send, status: int, text: str, more: dict[str, str] | None = None) -> None:
    """Send a short answer of plain text."""
    headers = {**HEADERS, "content-type": "text/plain; charset=utf-8", **(more or {})}
    await send({"type": "http.response.start", "status": status, "headers": _encode(headers)})
    await send({"type": "http.response.body", "body": f"{text}\n".encode() if text else b""})
