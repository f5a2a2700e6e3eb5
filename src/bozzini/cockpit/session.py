"""The session: one state that all windows share, and the clock that shows it to them."""

from __future__ import annotations

import asyncio
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.polylines import measure_arc_length
from ..results import Json
from .wire import (
    Change,
    Flags,
    HeadCommand,
    Message,
    Play,
    RigCommand,
    Seek,
    Slide,
    Snapshot,
    StickMove,
    echo_frame,
    pack_tissue,
    stamp_frame,
)

if TYPE_CHECKING:
    from .drive import DriveState, EffectorDrive


RATE = 60.0
"""Ticks of the clock a second [Hz]; a tick without a change sends nothing."""
STATUS_TICKS = 6
"""Ticks from one look at the status, which is text, to the next."""
STATES = {
    "MODEL": "No rig: the model alone",
    "BOOT": "Starting",
    "DISARMED": "Disarmed, vented",
    "ARMED": "Armed",
    "FAULT": "Fault, vented",
    "LOST": "No board",
}
"""States of the rig, for people."""
STRAIGHT = 0.01
"""A bend of less than this is none [mm]: a transducer at rest is never quite at 0."""
LONGEST_SILENCE = 0.8
"""Time after which a window that holds the stick and says nothing of it has let go of it [s]."""


Made = TypeVar("Made")


async def run_beside(make: Callable[[], Made]) -> Made:
    """Return what a function makes in a thread that nobody waits for at the end.

    `asyncio.to_thread` would: an interrupt would wait until all is compiled.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[Made] = loop.create_future()

    def give(made: Made | None, error: Exception | None) -> None:
        if done.cancelled():
            return
        if error is not None:
            done.set_exception(error)
        else:
            done.set_result(made)  # type: ignore[arg-type]

    def work() -> None:
        made, error = None, None
        try:
            made = make()
        except Exception as caught:
            error = caught
        with suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(give, made, error)

    threading.Thread(target=work, daemon=True).start()
    return await done


class Distance(Protocol):
    """Where a place is to the wall."""

    def signed_distance(self, points: Floats) -> Floats:
        """Return distances (n,) of points (n, 3) to the wall, negative inside [mm]."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Outline:
    """Wall and line of a plan, as other programs are shown them.

    Attributes
    ----------
    vertices, faces : (n, 3) float, (m, 3) int
        Of the wall [mm].
    line : (k, 3) float
        [mm].
    frame : str, optional
        Where the axes point in the patient.
    """

    vertices: Floats
    faces: NDArray[np.int64]
    line: Floats
    frame: str | None


@dataclass(frozen=True, kw_only=True, eq=False)
class ShownPlan:
    """A plan as the windows need it.

    Attributes
    ----------
    view : bytes
        What the page draws: see `bozzini.scene.view`.
    joints, clearance : (steps, links + 1, 3), (steps, links) float32
        Of the body [mm]; clearance is NaN where a link is not in the tract.
    travel : (steps,) float
        Way of the head [mm].
    radius : float
        Of the scope [mm].
    wall : Distance, optional
        The lumen, for the clearance of the bent tip; None: that of the plan before.
    tendons : (steps, n) float
        Displacements of a robot's tendons [mm].
    info : dict
        What the page shows of it: verdict, reason, sizes, tendons.
    outline : Outline, optional
        What 3D Slicer shows of it.
    up : (3,) float, optional
        Where up is at the beginning, as seen from the tip; None: along an axis.
    is_mirrored : bool
        Whether the axes are left-handed, as of a scan in LAS: pictures are mirrored then.
    """

    view: bytes = field(repr=False)
    joints: NDArray[np.float32] = field(repr=False)
    clearance: NDArray[np.float32] = field(repr=False)
    travel: Floats = field(repr=False)
    radius: float
    wall: Distance | None = field(default=None, repr=False)
    tendons: Floats = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    info: Json = field(default_factory=dict)
    outline: Outline | None = field(default=None, repr=False)
    up: Floats | None = field(default=None, repr=False)
    is_mirrored: bool = False

    @property
    def steps(self) -> int:
        """How many steps it has."""
        return len(self.joints)

    @cached_property
    def frames(self) -> Floats:
        """Left, up and along the head at each step (steps, 3, 3); turned as little as can be."""
        ahead = (self.joints[:, 0] - self.joints[:, 1]).astype(np.float64)
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        frames = np.empty((self.steps, 3, 3))
        hand = -1.0 if self.is_mirrored else 1.0
        up = np.zeros(3) if self.up is None else self.up
        if np.linalg.norm(np.cross(up, ahead[0])) < 0.1:
            up = np.eye(3)[int(np.argmin(np.abs(ahead[0])))]
        for k, way in enumerate(ahead):
            up = up - (up @ way) * way
            up = up / np.linalg.norm(up)
            frames[k] = hand * np.cross(up, way), up, way
        return frames

    def place(self, step: int, state: DriveState) -> PlacedBody:
        """Return the body with its tip bent.

        The bend of the end-effector is laid over the end of the body: straight it is the body as
        planned.
        """
        chain, frame = self.joints[step].astype(np.float64), self.frames[step]
        arcs, along = measure_arc_length(chain), measure_arc_length(state.backbone)
        length = float(along[-1])
        behind = np.minimum(length - along, arcs[-1])
        straight = np.stack([np.interp(behind, arcs, column) for column in chain.T], axis=1)
        aside = (state.backbone - along[:, None] * np.array([0.0, 0.0, 1.0])) @ frame
        is_bent = bool(np.abs(aside).max() > STRAIGHT)
        if not is_bent:
            aside[:] = 0.0
        tip = straight + aside
        near = arcs < length
        for axis in range(3):
            chain[near, axis] += np.interp(length - arcs[near], along, aside[:, axis])
        way = state.direction @ frame
        up = frame[1] - (frame[1] @ way) * way
        camera = np.stack([tip[-1], way, up / np.linalg.norm(up)])
        clearance, gap = self._measure(step, tip, arcs=arcs, behind=behind, is_bent=is_bent)
        return PlacedBody(chain, clearance, gap, tip, camera)

    def _measure(
        self, step: int, tip: Floats, *, arcs: Floats, behind: Floats, is_bent: bool
    ) -> tuple[NDArray[np.float32], float]:
        """Return the clearance of the links, and of the bent tip, as far as it is in the tract."""
        clearance = self.clearance[step]
        inside = int(np.isfinite(clearance).sum())
        here = behind <= arcs[inside] + 1e-6
        if self.wall is None or not inside or not here.any():
            return clearance, float("nan")
        gaps = -self.wall.signed_distance(tip) - self.radius
        if is_bent:
            clearance = clearance.copy()
            for link in np.unique(np.searchsorted(arcs, behind[here], side="right") - 1):
                on_it = (behind >= arcs[link] - 1e-6) & (behind <= arcs[link + 1] + 1e-6)
                if link < inside:
                    clearance[link] = gaps[on_it].min()
        return clearance, float(gaps[here].min())


@dataclass(frozen=True, eq=False)
class PlacedBody:
    """The body at a step, its tip bent.

    Attributes
    ----------
    joints, clearance : (links + 1, 3), (links,) float
        Clearances of links that the bend moves are those where they are now [mm].
    gap : float
        Clearance of the bent tip [mm]; NaN where it is not in the tract.
    tip : (points, 3) float
        Of the end-effector, to the end of its holder, or of a head's bodies [mm].
    camera : (3, 3) float
        Place, way and up.
    """

    joints: Floats
    clearance: NDArray[np.floating]
    gap: float
    tip: Floats
    camera: Floats


@dataclass(eq=False)
class Window:
    """One page that is connected."""

    ready: asyncio.Event = field(default_factory=asyncio.Event)
    travel: Floats = field(default_factory=lambda: np.zeros(2))
    heard: float = 0.0
    echo: float = 0.0
    shown: int = 0
    status_shown: int = 0
    tissue_shown: int = 0


class Session:
    """What is shown and steered, by whichever window.

    Parameters
    ----------
    may_arm : bool
        Whether windows have shown a token: without, no rig is armed.
    """

    def __init__(self, *, may_arm: bool = False) -> None:
        self.may_arm = may_arm
        self.windows: set[Window] = set()
        self.drive: EffectorDrive | None = None
        self.plan: ShownPlan | None = None
        self.view, self.view_version = b"", 0
        self.moved: ShownPlan | None = None
        self.moving: Json | None = None
        self.step, self.place, self.speed, self.is_playing = 0, 0.0, 20.0, False
        self.holder: Window | None = None
        self.planning: Json = {"busy": True, "stage": "starting", "message": ""}
        self.changes = 0
        self.name = secrets.token_hex(4)
        self.ask_plan: Callable[[Change], None] | None = None
        self.note = ""
        self.number, self.status_number, self.tissue_number = 0, 0, 0
        self.frame = bytearray()
        self.tissue: Sequence[bytes] = ()
        self.readings = self.waiting = ""
        self.status: Json = {}
        self.tip_clearance = float("nan")
        self._packed, self._ticks = b"", -1
        self._last_tick = time.monotonic()

    # What windows do.

    def open(self) -> Window:
        """Return a new window."""
        window = Window()
        self.windows.add(window)
        return window

    def close(self, window: Window) -> None:
        """Let a window go: its stick is let go with it."""
        self.windows.discard(window)
        if self.holder is window:
            self.holder = None

    def take(self, window: Window, message: Message) -> None:
        """Do what a window asks for."""
        if isinstance(message, StickMove):
            window.heard = time.monotonic()
            window.travel, window.echo = np.array([message.x, message.y]), message.time
            self._hold(window)
        elif isinstance(message, Seek):
            self.is_playing, window.echo = False, message.time
            self.go_to(message.step)
        elif isinstance(message, Play):
            self.is_playing, self.speed = message.on, message.speed
            if message.on and self.plan is not None and self._is_at_end:
                self.go_to(0 if message.speed >= 0.0 else self.plan.steps - 1)
        elif isinstance(message, RigCommand):
            self.note = self._command(message.what)
        elif isinstance(message, Slide | HeadCommand):
            self._handle_head(message)
        elif self.ask_plan is None:
            self.refuse("there is nothing to plan yet")
        else:
            self.changes += 1
            self.ask_plan(message)

    def refuse(self, words: str) -> None:
        """Say why a change is not planned for; the next that is takes the words away."""
        self.changes += 1
        self.planning = {**self.planning, "message": words}

    def _hold(self, window: Window) -> None:
        """Let one window at a time hold the stick: the first, until it lets go."""
        if window.travel.any():
            self.holder = self.holder or window
        elif self.holder is window:
            self.holder = None

    def _command(self, what: str) -> str:
        """Pass a command on to the rig; return why not."""
        if self.drive is None:
            return "the rig is not ready yet"
        if what == "arm" and not self.may_arm:
            return "arming needs a token: open the link that the command printed"
        if what == "arm" and self.holder is not None:
            return "let go of the stick before the rig is armed"
        try:
            self.drive.command(what)
        except InputError as error:
            return str(error)
        return ""

    def _handle_head(self, message: Slide | HeadCommand) -> None:
        """Let the drive do what is asked of its head; the note says why it does not."""
        if self.drive is None:
            return
        try:
            if isinstance(message, Slide):
                self.drive.slide(message.out, message.effector)
            else:
                self.drive.command_head(message.what, self.plan, self.step)
            self.note = ""
        except InputError as error:
            self.note = str(error)

    def go_to(self, step: float) -> None:
        """Show a step of the plan, the nearest there is."""
        if self.plan is not None:
            self.step = int(np.clip(step, 0, self.plan.steps - 1))
            self.place = float(self.plan.travel[self.step])

    @property
    def _is_at_end(self) -> bool:
        plan = self.plan
        return plan is not None and self.step == (plan.steps - 1 if self.speed >= 0.0 else 0)

    # What is made elsewhere.

    def show_scene(self, view: bytes) -> None:
        """Let the pages draw something else: see `bozzini.scene.view`."""
        self.view, self.view_version = view, self.view_version + 1

    def show(self, plan: ShownPlan) -> None:
        """Show another plan, with the head as far in as it was, or as it can be."""
        if plan.wall is None and self.plan is not None:
            plan = replace(plan, wall=self.plan.wall)
        self.plan, self.moved, self.moving, self.tissue = plan, None, None, ()
        self.show_scene(plan.view)
        self.step = int(np.clip(np.searchsorted(plan.travel, self.place), 0, plan.steps - 1))

    def show_moved(self, body: ShownPlan, vertices: Floats) -> None:
        """Show body and wall where the tissue has moved them to.

        Parameters
        ----------
        body : ShownPlan
            Of one step.
        vertices : (n, 3) float
            Of the wall [mm].
        """
        if self.plan is None:
            return
        plan = self.plan
        self.step = int(np.clip(np.searchsorted(plan.travel, body.travel[0]), 0, plan.steps - 1))
        up = plan.frames[self.step, 1]
        self.moved = replace(body, up=up, is_mirrored=plan.is_mirrored)
        self.moving = body.info
        self.show_surfaces([vertices])

    def show_surfaces(self, surfaces: Sequence[Floats]) -> None:
        """Show surfaces of the scene with vertices (n, 3) [mm] elsewhere, each by its number."""
        self.tissue, self.tissue_number = [*map(pack_tissue, surfaces)], self.tissue_number + 1
        self._wake()

    def rest(self) -> None:
        """Show body and wall as they are planned: nothing moves the tissue any more."""
        if self.moved is not None:
            self.moved, self.moving, self.tissue = None, None, ()
            self.show_scene(self.view)

    # The clock.

    async def run(self) -> None:
        """Tick for ever, at absolute times."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due = max(due + 1.0 / RATE, loop.time() - 1.0 / RATE)
            await asyncio.sleep(due - loop.time())
            self.tick(time.monotonic())

    def tick(self, now: float) -> None:
        """Go on to a time [s], and wake the windows if what they show has changed."""
        passed, self._last_tick = now - self._last_tick, now
        self._advance(passed)
        holder = self.holder
        if holder is not None and now - holder.heard > LONGEST_SILENCE:
            holder.travel, self.holder = np.zeros(2), None
        travel = np.zeros(2) if self.holder is None else self.holder.travel
        if self.drive is not None:
            self.drive.hold(travel)
        packed = self._snap(travel).pack()
        if packed != self._packed:
            self._packed, self.number = packed, self.number + 1
            self.frame = stamp_frame(packed, self.number, time=now)
            self._wake()
        self._ticks += 1
        if self._ticks % STATUS_TICKS == 0 and (status := self.describe()) != self.status:
            self.status, self.status_number = status, self.status_number + 1
            self._wake()

    def _wake(self) -> None:
        for window in self.windows:
            window.ready.set()

    def _advance(self, passed: float) -> None:
        """Let the head go on while it plays."""
        plan = self.plan
        if not self.is_playing or plan is None:
            return
        last = float(plan.travel[-1])
        self.place = float(np.clip(self.place + self.speed * passed, 0.0, last))
        self.step = int(np.clip(np.searchsorted(plan.travel, self.place), 0, plan.steps - 1))
        if self._is_at_end:
            self.is_playing = False

    def _snap(self, travel: Floats) -> Snapshot:
        """Return what is shown now."""
        drive, empty = self.drive, np.zeros((0, 3))
        plan, step = (self.plan, self.step) if self.moved is None else (self.moved, 0)
        state = None if drive is None else drive.state
        body = PlacedBody(empty, empty[:, 0], float("nan"), empty, np.zeros((3, 3)))
        if plan is not None and drive is not None:
            body = drive.place(plan, step)
        elif plan is not None:
            joints, frame = plan.joints[step], plan.frames[step]
            camera = np.stack([joints[0], frame[2], frame[1]])
            body = PlacedBody(joints, plan.clearance[step], float("nan"), empty, camera)
        self.tip_clearance = body.gap
        pressures, places = np.zeros((2, 0)), np.vstack([travel, np.zeros((3, 2))])
        if state is not None:
            pressures = np.stack([state.setpoints, state.measured])
            places = np.stack([travel, state.target, state.delivered, state.tip])
        return Snapshot(
            step=self.step,
            flags=self._flags(state),
            windows=len(self.windows),
            speed=self.speed,
            joints=body.joints,
            clearance=body.clearance,
            pressures=pressures,
            places=places,
            backbone=body.tip,
            camera=body.camera,
        )

    def _flags(self, state: DriveState | None) -> Flags:
        known = {
            Flags.PLAYING: self.is_playing,
            Flags.REACHED: state is None or state.reached,
            Flags.RIG: self.drive is not None and self.drive.has_rig,
            Flags.ARMED: state is not None and state.name == "ARMED",
            Flags.FAULT: state is not None and state.name in ("FAULT", "LOST"),
            Flags.INSIDE: bool(np.isfinite(self.tip_clearance)),
            Flags.PLANNING: bool(self.planning["busy"]),
            Flags.PRESSED: self.holder is not None,
        }
        flags = Flags.NONE
        for flag, is_set in known.items():
            flags |= flag if is_set else Flags.NONE
        return flags

    def describe(self) -> Json:
        """Return the status: what the windows show as text."""
        drive, plan = self.drive, self.plan
        state = None if drive is None else drive.state
        clear = self.tip_clearance
        return {
            "kind": "status",
            "rig": None if state is None else state.name,
            "state": None if state is None else STATES.get(state.name, state.name),
            "controller": None if drive is None else drive.controller,
            "note": "; ".join(filter(None, [state.note if state else "", self.note])),
            "reason": "" if state is None else state.reason,
            "head": None if drive is None else drive.tell(),
            "reservoir_MPa": None
            if state is None or not np.isfinite(state.reservoir)
            else round(state.reservoir, 2),
            "tip_clearance_mm": round(clear, 2) if np.isfinite(clear) else None,
            "tip": self._describe_tip(),
            "tendons_mm": None
            if plan is None or not plan.tendons.size
            else plan.tendons[self.step].round(2).tolist(),
            "readings": self.readings,
            "waiting": self.waiting or f"Reading the tract: {self.planning['stage']}…",
            "planning": {**self.planning, "asked": self.changes},
            "session": self.name,
            "moving": self.moving,
            "view": self.view_version,
            "plan": None if plan is None else plan.info,
        }

    def _describe_tip(self) -> str:
        """Return how far the tip is from the wall, and whose it is."""
        drive, plan, gap = self.drive, self.plan, self.tip_clearance
        if drive is None or plan is None:
            return ""
        if np.isfinite(gap):
            words = f"Tip clearance: {gap:.2f} mm{', through the wall' if gap < 0.0 else ''}."
        elif self.step == 0:
            words = "The tip is at the entry: play, or hold R on the pad, to move the scope in."
        else:
            words = "" if self.moving else "The tip is not in the tract."
        return "\n".join(filter(None, [words, drive.describe_tip(2.0 * plan.radius)]))

    def describe_all(self) -> Json:
        """Return the whole state, for `GET /state`."""
        state = None if self.drive is None else self.drive.state
        return {
            **self.describe(),
            "step": self.step,
            "drive": self.drive is not None,
            "steps": 0 if self.plan is None else self.plan.steps,
            "playing": self.is_playing,
            "windows": len(self.windows),
            "frames": self.number,
            "stick": [0.0, 0.0] if self.holder is None else self.holder.travel.tolist(),
            "reached": state is None or state.reached,
            "setpoints_MPa": None if state is None else state.setpoints.tolist(),
            "pressures_MPa": None if state is None else state.measured.tolist(),
            "target_mm": None if state is None else state.target.tolist(),
            "delivered_mm": None if state is None else state.delivered.tolist(),
            "tip_mm": None if state is None else state.tip.tolist(),
        }

    def frame_for(self, window: Window) -> bytes:
        """Return the newest frame for a window."""
        window.shown = self.number
        return echo_frame(self.frame, window.echo)
