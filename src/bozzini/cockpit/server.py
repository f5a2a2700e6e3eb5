"""The server: pages, scenes and web sockets of the cockpit, for one session."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from ..errors import InputError, MissingExtraError
from .guard import Access, Guard
from .session import Session, Window, run_beside
from .wire import MessageError, read_message

try:
    import uvicorn
    import websockets as _websockets  # noqa: F401  (uvicorn needs it)
    from starlette.applications import Starlette
    from starlette.responses import JSONResponse, Response
    from starlette.routing import Route, WebSocketRoute
    from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState
except ImportError as error:  # the extra is one: it names what lacks
    raise MissingExtraError((error.name or "starlette").partition(".")[0], "cockpit") from None

if TYPE_CHECKING:
    from starlette.requests import Request

LARGEST_MESSAGE = 4096
"""Bytes of a message of a page; a larger one ends its connection."""
MALFORMED = 1003
"""With this code a connection ends after a message that no page sends."""
KINDS = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
"""Endings of the page's files, and what they are."""


def bind(host: str, port: int) -> socket.socket:
    """Return a socket that listens; port 0 is any that is free.

    Raises
    ------
    InputError
        If the address is none of this computer, or the port is in use.
    """
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listener = socket.socket(family, kind, protocol)
    except OSError as error:
        raise InputError(f"host is '{host}': {error.strerror or error}") from None
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(place)
        listener.listen(64)
    except OSError as error:
        listener.close()
        raise InputError(
            f"port is {port}: it cannot be used at {host}: {error.strerror}; give another --port, "
            "0 for any that is free"
        ) from None
    return listener


def make_application(session: Session, *, page: str, folders: tuple[Path, ...]) -> Starlette:
    """Return the application without its guard.

    Parameters
    ----------
    session : Session
    page : str
        The page itself, HTML.
    folders : tuple of Path
        Where the page's scripts and styles are.
    """
    files = {
        file.name: file
        for folder in folders
        for file in sorted(folder.glob("*"))
        if file.suffix in KINDS
    }

    async def show_page(request: Request) -> Response:
        return Response(page, media_type="text/html")

    async def show_file(request: Request) -> Response:
        file = files.get(request.path_params["name"])
        if file is None:
            return Response("there is no such file\n", 404, media_type="text/plain")
        return Response(file.read_bytes(), media_type=KINDS[file.suffix])

    async def show_view(request: Request) -> Response:
        if not session.view:
            return Response("there is nothing to draw yet\n", 404, media_type="text/plain")
        return Response(session.view, media_type="application/octet-stream")

    async def show_info(request: Request) -> Response:
        return JSONResponse(await run_beside(lambda: describe_drive(session)))

    async def show_state(request: Request) -> Response:
        return JSONResponse(session.describe_all())

    async def show_tasks(request: Request) -> Response:
        forms = await run_beside(_load_forms)
        return JSONResponse(await run_beside(forms.list_forms))

    async def show_task(request: Request) -> Response:
        name, values = request.path_params["name"], dict(request.query_params)
        forms = await run_beside(_load_forms)
        return JSONResponse(await forms.fill_form(name, values))

    async def talk(connection: WebSocket) -> None:
        await _talk(session, connection)

    return Starlette(
        routes=[
            Route("/", show_page),
            Route("/web/{name}", show_file),
            Route("/view.bin", show_view),
            Route("/info.json", show_info),
            Route("/state", show_state),
            Route("/tasks.json", show_tasks),
            Route("/tasks/{name}", show_task),
            WebSocketRoute("/ws", talk),
        ]
    )


def _load_forms() -> ModuleType:
    """Return what knows the tasks: to import it takes longer than all that the page needs."""
    from . import forms

    return forms


def describe_drive(session: Session) -> dict[str, object]:
    """Return what a page needs to know of the drive once, for `GET /info.json`."""
    drive = session.drive
    if drive is None:
        return {"drive": None}
    return {"drive": {**drive.describe(), "may_arm": session.may_arm}}


async def _talk(session: Session, connection: WebSocket) -> None:
    """Serve one window until it, or the server, goes away."""
    await connection.accept()
    window = session.open()
    window.ready.set()
    tasks = {
        asyncio.create_task(_listen(session, connection, window)),
        asyncio.create_task(_show(session, connection, window)),
    }
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        session.close(window)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _listen(session: Session, connection: WebSocket, window: Window) -> None:
    """Take the messages of a window."""
    while True:
        event = await connection.receive()
        if event["type"] == "websocket.disconnect":
            return
        text = event.get("text")
        try:
            if text is None:
                raise MessageError("the message must be text")
            session.take(window, read_message(text))
        except MessageError as error:
            if connection.application_state is WebSocketState.CONNECTED:
                await connection.close(MALFORMED, str(error)[:120])
            return
        except InputError as error:
            session.refuse(str(error))


async def _show(session: Session, connection: WebSocket, window: Window) -> None:
    """Send a window the newest there is, whenever that has changed; what it missed is not sent."""
    try:
        while True:
            await window.ready.wait()
            window.ready.clear()
            if window.status_shown != session.status_number:
                window.status_shown = session.status_number
                await connection.send_text(json.dumps(session.status))
            if window.shown != session.number:
                await connection.send_bytes(session.frame_for(window))
            if session.tissue and window.tissue_shown != session.tissue_number:
                window.tissue_shown = session.tissue_number
                for surface in session.tissue:
                    await connection.send_bytes(surface)
    except (WebSocketDisconnect, RuntimeError):  # it has gone in the meantime
        return


def make_server(
    session: Session, access: Access, *, page: str, folders: tuple[Path, ...]
) -> uvicorn.Server:
    """Return a server, guarded, that has not begun."""
    application = make_application(session, page=page, folders=folders)
    config = uvicorn.Config(
        Guard(application, access),
        log_level="error",
        access_log=False,
        lifespan="off",
        ws="websockets-sansio",
        ws_max_size=LARGEST_MESSAGE,
        ws_per_message_deflate=False,
        proxy_headers=False,
        server_header=False,
        timeout_graceful_shutdown=1,
    )
    return uvicorn.Server(config)


async def run_server(
    server: uvicorn.Server,
    listener: socket.socket,
    *,
    session: Session,
    when_ready: Callable[[], None],
) -> None:
    """Serve until the server is told to stop, with the session's clock beside it.

    An error of the clock ends it, and is raised.
    """

    async def announce() -> None:
        while not server.started:
            await asyncio.sleep(0.005)
        when_ready()

    def stop(task: asyncio.Task[None]) -> None:
        if not task.cancelled() and task.exception() is not None:
            server.should_exit = True

    beside = [asyncio.create_task(session.run()), asyncio.create_task(announce())]
    for task in beside:
        task.add_done_callback(stop)
    try:
        await server.serve(sockets=[listener])
    finally:
        for task in beside:
            task.cancel()
        ends = await asyncio.gather(*beside, return_exceptions=True)
    for end in ends:
        if isinstance(end, Exception):
            raise end
