"""The cockpit as a whole: server, drive, planning and operator, from beginning to end."""

from __future__ import annotations

import asyncio
import secrets
import threading
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from socket import socket
from typing import TYPE_CHECKING, Any

from ..effector.design import DEFAULT_PRESET
from ..errors import BozziniError, InputError
from .guard import LOOPBACK, Access
from .planning import PATIENCE, Planning, PlanningRequest, merge
from .session import Session, run_beside
from .wire import Change

if TYPE_CHECKING:
    from ..head import TargetRun
    from ..scene import SlicerLink
    from ..study.estimating import ContinuumEstimating
    from .drive import EffectorDrive
    from .operator import Drawing, FigureKind
    from .slicer import SlicerWindow

WAIT_FOR_WINDOW = 10.0
"""How long the operator waits for the page that is opened [s]."""


@dataclass(frozen=True, kw_only=True)
class CockpitOptions:
    """Where the cockpit is served, and what it drives.

    Attributes
    ----------
    host : str
        Address to listen at; another than this computer's own needs a token, which is made.
    port : int
        0 for any that is free.
    names : tuple of str
        Names of this computer for others.
    rig : str or None
        ``"demo"``, ``"serial:PORT"`` or None.
    board : {"emulated", "native"}
        Of the emulated rig.
    effector : str
        Preset of the end-effector, or file of a fitted one.
    controller : str
        Of the rig to begin with, one of `bozzini.rig.CONTROLLERS`.
    operator : {"line", "circle"} or None
        What a scripted operator draws; the cockpit ends after it.
    head : str or None
        File of a distal head, or ``"default"``; it is driven in place of the end-effector.
    targets : int
        How many the head's instrument has to touch.
    is_shown : bool
        Whether the page is opened in the browser.
    slicer : SlicerLink, optional
        Where else it is shown.
    sensed : ContinuumEstimating, optional
        A robot with its readings: it is shown alone, in place of a plan.
    """

    host: str = "127.0.0.1"
    port: int = 8321
    names: tuple[str, ...] = ()
    rig: str | None = None
    board: str = "emulated"
    effector: str = DEFAULT_PRESET
    controller: str = "static"
    operator: FigureKind | None = None
    head: str | None = None
    targets: int = 5
    is_shown: bool = True
    slicer: SlicerLink | None = None
    sensed: ContinuumEstimating | None = None

    @property
    def is_open(self) -> bool:
        """Whether it listens to other computers."""
        return self.host not in (*LOOPBACK, "::1")


class Cockpit:
    """A server with all that belongs to it.

    Parameters
    ----------
    job : PlanningRequest or None
        What is planned for; None: nothing.
    options : CockpitOptions
    listener : socket
        That `bozzini.cockpit.server.bind` has made.
    """

    def __init__(
        self, job: PlanningRequest | None, options: CockpitOptions, *, listener: socket
    ) -> None:
        self.job, self.options, self.listener = job, options, listener
        needs_token = options.is_open or options.rig is not None
        self.access = Access(
            port=listener.getsockname()[1],
            token=secrets.token_urlsafe(24) if needs_token else None,
            is_open=options.is_open,
            names=tuple(name.lower() for name in options.names),
        )
        self.session = Session(may_arm=needs_token)
        self.session.ask_plan = self._ask
        self.error: BozziniError | None = None
        self.drawing: Drawing | None = None
        self.run_of_targets: TargetRun | None = None
        self._planning: Planning | None = None
        self._slicer: SlicerWindow | None = None
        self._late: asyncio.TimerHandle | None = None
        self._waiting: Change | None = None
        self._has_ended = False

    @property
    def address(self) -> str:
        """Where the page is, with the token if there is one."""
        name = self.options.names[0] if self.options.names else self.options.host
        if name in ("0.0.0.0", "::", "::1"):
            name = "127.0.0.1" if name == "0.0.0.0" else "[::1]"
        query = f"?token={self.access.token}" if self.access.token else ""
        return f"http://{name}:{self.access.port}/{query}"

    def run(self, announce: Callable[[str], None]) -> None:
        """Serve until it is interrupted, or the operator has finished.

        Parameters
        ----------
        announce : callable
            Is given the address once it is served.

        Raises
        ------
        BozziniError
            If the rig, or the tract, cannot be had.
        """
        try:
            with suppress(KeyboardInterrupt):
                asyncio.run(self._serve(announce))
        finally:
            self._has_ended = True
            self.listener.close()
            if self._planning is not None:
                self._planning.close()
            if self.session.drive is not None:
                self.run_of_targets = self.session.drive.sum_up()
                self.session.drive.close()
        if self.error is not None:
            raise self.error

    async def _serve(self, announce: Callable[[str], None]) -> None:
        self._loop = asyncio.get_running_loop()
        if self.job is not None:
            self._planning = Planning(self.job, self._hear)  # first: it takes longest
        from .page import WEB, render_cockpit
        from .server import make_server, run_server

        self._server = make_server(self.session, self.access, page=render_cockpit(), folders=WEB)

        def begin() -> None:
            announce(self.address)
            if self.options.is_shown:
                threading.Thread(target=webbrowser.open, args=(self.address,), daemon=True).start()

        beside = [asyncio.create_task(self._prepare())]
        if self.options.slicer is not None:
            from .slicer import SlicerWindow

            self._slicer = SlicerWindow(self.options.slicer, self.session)
            beside.append(asyncio.create_task(self._slicer.run()))
        try:
            await run_server(self._server, self.listener, session=self.session, when_ready=begin)
        finally:
            for task in beside:
                task.cancel()
                with suppress(asyncio.CancelledError):
                    await task

    async def _prepare(self) -> None:
        """Open the drive beside the server, and let the operator draw."""
        options = self.options
        try:
            if options.sensed is not None:
                from .readings import SensedRobot

                await SensedRobot(options.sensed, self.session).run()
                return
            drive = await run_beside(self._open_drive)
            self.session.drive = drive
            if options.operator is not None:
                if options.is_shown:
                    await self._wait_for_window()
                from .operator import Figure, draw

                figure = Figure.within(options.operator, drive)
                self.drawing = await draw(figure, drive, self.access)
                self._server.should_exit = True
        except BozziniError as error:
            self._end(error)
        except Exception:  # raised once the server has ended
            self._server.should_exit = True
            raise

    def _open_drive(self) -> EffectorDrive:
        from .drive import open_drive

        options = self.options
        if options.head is not None:
            from ..head.design import read_head
            from .head import HeadDrive

            head = read_head(None if options.head == "default" else options.head)
            return HeadDrive(head, targets=options.targets)
        drive = open_drive(
            options.effector, rig=options.rig, board=options.board, controller=options.controller
        )
        if self._has_ended:
            drive.close()
        return drive

    async def _wait_for_window(self) -> None:
        for _ in range(int(20.0 * WAIT_FOR_WINDOW)):
            if self.session.windows:
                return
            await asyncio.sleep(0.05)

    def _end(self, error: BozziniError) -> None:
        """Stop because of an error."""
        self.error = self.error or error
        self._server.should_exit = True

    def _hear(self, kind: str, what: Any) -> None:
        """Take what the planning process says, in the server's own thread."""
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._take, kind, what)

    def _take(self, kind: str, what: Any) -> None:
        session = self.session
        if kind == "scene":
            if session.plan is None:  # a process that was started anew shows what was shown
                session.show_scene(what)
        elif kind == "plan":
            session.show(what)
            is_final = what.info["final"]
            self._tell("" if is_final else "looking for what would fit", busy=not is_final)
            if self._waiting is not None:
                self._ask(self._waiting)
        elif kind == "moved":
            session.show_moved(*what)
            if self._slicer is not None:
                self._slicer.wall = what[1]
        elif kind == "progress":
            session.planning = {**session.planning, "busy": True, "stage": what}
        elif kind == "done":
            self._tell(message=what)
        elif session.plan is None:  # refused, or lost, before there was anything to show
            self._end(InputError(what))
        elif kind == "lost":
            session.rest()
            self._tell(message=f"{what}: with the next change it is started anew")
            if self._planning is not None and self._planning.start_again():
                self._tell("starting anew", busy=True, message=f"{what}: it is started anew")
        else:
            self._tell(message=what)

    def _tell(self, stage: str = "", *, busy: bool = False, message: str = "") -> None:
        """Let the windows show what planning does."""
        if self._late is not None:
            self._late.cancel()
        self.session.planning = {"busy": busy, "stage": stage, "message": message}

    def _ask(self, change: Change) -> None:
        """Let something else be planned, after the first plan, and say so if it takes long."""
        if self.session.plan is None or self._planning is None:
            self._waiting = merge(self._waiting or Change(), change)
            words = "what you changed is planned for after the first plan"
            self.session.planning = {**self.session.planning, "message": words}
            return
        self._waiting = None
        is_new = self._planning.ask(change)
        self._tell("starting anew" if is_new else "plan", busy=True)

        def look() -> None:
            words = f"still at work: it takes longer than {PATIENCE:g} s"
            self.session.planning = {**self.session.planning, "message": words}

        self._late = self._loop.call_later(PATIENCE, look)
