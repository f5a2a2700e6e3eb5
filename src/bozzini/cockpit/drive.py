"""The drive: from the stick to pressures and back to the tip, with a rig or by the model alone."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..effector import Effector, EffectorInverse, Stick, find_stick_scale, steer
from ..errors import BozziniError, InputError
from ..numeric.arrays import Floats
from ..results import Json
from ..rig.choices import CONTROLLERS
from ..rig.host import SILENCE_LIMIT, Host, describe_faults
from ..rig.hysteresis import MotionObserver
from ..rig.link import Link, LockstepLink
from ..rig.protocol import SETPOINT_MAX, State
from ..rig.steering import find_set_points, make_controller, open_rig_effector
from .session import PlacedBody, ShownPlan

if TYPE_CHECKING:
    from ..head import TargetRun

PERIOD = 0.01
"""Of the loop that drives the rig [s]."""
SEEN = np.array([-1.0, 1.0])
"""The stick's right and up are those of the tip's camera, which looks along the model's +z: there
the model's +x is left."""
HOLD_LIMIT = 0.5
"""Without a word of the session for longer than this [s] the stick counts as let go."""
BACKLOG = 0.05
"""An emulated rig that is behind its clock by more than this [s] lets the rest of it go."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DriveState:
    """What the drive does now.

    Attributes
    ----------
    name : str
        State of the board, or ``"MODEL"`` without a rig, or ``"LOST"`` without its telemetry.
    note : str
        Its faults, or why a command was refused.
    reason : str
        Why the stick's target is not delivered; empty if it is.
    time : float
        Of the rig's clock [s].
    travel : (2,) float
        Of the stick, right and up as the tip's camera sees them, as a share of the full one.
    target, delivered, tip : (2,) float
        Lateral place of the tip that the stick asks for, that the set-points give, and that the
        measured pressures give [mm].
    setpoints, measured : (3,) float
        Pressures [MPa].
    reservoir : float
        Its pressure [MPa]; NaN without a rig.
    backbone : (points, 3) float
        From the base, straight along +z, to the end of the holder, by the measured pressures [mm].
    direction : (3,) float
        Of the tip.
    """

    name: str = "MODEL"
    note: str = ""
    reason: str = ""
    time: float = 0.0
    travel: Floats
    target: Floats
    delivered: Floats
    tip: Floats
    setpoints: Floats
    measured: Floats
    reservoir: float = float("nan")
    backbone: Floats
    direction: Floats

    @property
    def reached(self) -> bool:
        """Whether the target is in the workspace."""
        return not self.reason


class EffectorDrive:
    """An end-effector that a stick steers, by its model alone: the pressures are the set-points.

    Parameters
    ----------
    effector : Effector
        Of three muscles, in the order of the board's.

    Raises
    ------
    InputError
        If it has not three muscles.
    """

    has_rig = False
    name = "model without a rig"
    """What is driven, for people."""
    controller = ""
    """Name of the controller of a rig, one of `bozzini.rig.CONTROLLERS`."""
    turn = np.eye(2)
    """Turns places as the tip's camera sees them (-x is right, y up) into the end-effector's."""

    def __init__(self, effector: Effector) -> None:
        self.listeners: list[Callable[[DriveState], None]] = []
        self.take(effector)

    def take(self, effector: Effector) -> None:
        """Drive this end-effector from now on, straight to begin with."""
        if len(effector.design.muscles) != 3:
            raise InputError(
                f"the end-effector has {len(effector.design.muscles)} muscles: a board has 3"
            )
        self.effector, self.scale = effector, find_stick_scale(effector)
        self.limit = effector.design.pressure_limit
        self.travel = np.zeros(2)
        self.state = self.find_state(self.solve(self.travel), np.zeros(3))

    def solve(self, travel: Floats) -> EffectorInverse:
        """Return the pressures for a travel of the stick, as `bozzini.rig.Steering` does."""
        unit = Stick()
        wanted = self.turn @ (SEEN * np.clip(travel, -1.0, 1.0))
        raw = unit.centre + unit.span * wanted * np.array([1.0, -1.0])  # y of a stick goes down
        return steer(self.effector, raw, stick=unit, scale=self.scale)

    def find_state(
        self, found: EffectorInverse, measured: Floats, *, acting: Floats | None = None
    ) -> DriveState:
        """Return the state under measured pressures [MPa], without what only a board knows.

        The muscles contract by those `acting`, by default the measured ones.
        """
        posed = self.effector.forward(
            np.clip(measured if acting is None else acting, 0.0, self.limit)
        )
        setpoints = np.clip(found.pressures, 0.0, SETPOINT_MAX)
        return DriveState(
            reason=str(found.reason),
            travel=self.travel,
            target=found.target @ self.turn,
            delivered=found.delivered @ self.turn,
            tip=posed.lateral_vector @ self.turn,
            setpoints=setpoints,
            measured=measured,
            backbone=np.vstack([posed.backbone, posed.holder_tip]),
            direction=posed.direction,
        )

    def hold(self, travel: Floats) -> None:
        """Take the travel (2,) of the stick; zeros let the tip go straight."""
        if not np.array_equal(travel, self.travel):
            self.travel = travel
            found = self.solve(travel)
            self.state = self.find_state(found, np.clip(found.pressures, 0.0, SETPOINT_MAX))
        for listen in self.listeners:
            listen(replace(self.state, time=time.monotonic()))

    def command(self, what: str) -> None:
        """Arm or disarm the rig, clear its fault, or choose its controller by name.

        Raises
        ------
        InputError
            Without a rig.
        """
        raise InputError(f"there is no rig to {what}: start the cockpit with --rig")

    def place(self, plan: ShownPlan, step: int) -> PlacedBody:
        """Return the body at a step of a plan, its tip bent."""
        return plan.place(step, self.state)

    def describe_tip(self, diameter: float) -> str:
        """Return how the tip that is bent belongs to the scope that is shown, of a diameter."""
        design = self.effector.design
        length = design.backbone_length + design.holder_length
        return (
            f"The tip is the end-effector, {design.holder_diameter:g} mm wide and {length:g} mm "
            f"long. It is drawn as the end of the scope, as wide as that: {diameter:g} mm."
        )

    def slide(self, out: float, number: int | None = None) -> None:
        """Slide a head's instrument out, as a share of its reach; None: the one that is steered."""
        raise InputError("there is no head: start the cockpit with --head")

    def command_head(self, what: str, plan: ShownPlan | None, step: int) -> None:
        """Choose a head's camera or end-effector, or set targets to touch."""
        raise InputError("there is no head: start the cockpit with --head")

    def describe(self) -> Json:
        """Return what the page needs to know once."""
        return {**describe_effector(self.effector, self.turn), "has_rig": self.has_rig}

    def sum_up(self) -> TargetRun | None:
        """Return how a head's targets were touched; None if there are none."""
        return None

    def tell(self) -> Json | None:
        """Return what the page shows of a head as text; None without one."""
        return None

    def close(self) -> None:
        """Let the drive go."""


def describe_effector(effector: Effector, turn: Floats) -> Json:
    """Return muscles and workspace as the page shows them; see `EffectorDrive.turn`."""
    space = effector.workspace(directions=72, samples=1)
    return {
        "muscles": list(effector.design.names),
        "pressure_limit_MPa": effector.design.pressure_limit,
        "full_stick_mm": find_stick_scale(effector),
        "workspace_mm": (space.boundary @ turn).round(3).tolist(),
    }


class RigDrive(EffectorDrive):
    """An end-effector with a rig: a thread of its own sends the set-points in time.

    If it stops, or the computer does, the board receives nothing and vents its muscles.

    Parameters
    ----------
    effector : Effector
    link : Link
        To a board on the bench, or to an emulated rig in lock-step, which is run in real time.
    controller : str
        One of `bozzini.rig.CONTROLLERS`, to begin with.

    Raises
    ------
    InputError
        If no board answers, or the effector's model cannot serve the controller.
    """

    has_rig = True

    def __init__(self, effector: Effector, link: Link, *, controller: str = "static") -> None:
        super().__init__(effector)
        self.host = Host(link, period=PERIOD)
        self._board = self.host.connect()
        self._take_controller(controller)
        self._observer, self._observed_at = MotionObserver(effector.motion), link.now
        self.note = ""
        self._held_at = time.monotonic()
        self._commands: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._heard: object = None
        self._heard_at = link.now
        self._update()
        self._thread = threading.Thread(target=self._run, name="rig", daemon=True)
        self._thread.start()

    def hold(self, travel: Floats) -> None:
        """Take the travel (2,) of the stick; the thread does the rest."""
        self.travel, self._held_at = travel, time.monotonic()

    def command(self, what: str) -> None:
        """Let the thread arm or disarm the rig, clear its fault, or choose its controller."""
        self._commands.put(what)

    def _take_controller(self, name: str) -> None:
        """Make a controller anew."""
        self._made = make_controller(name, self.effector, board=self._board, period=PERIOD)
        self.controller = name
        rig = "emulated rig" if isinstance(self.host.link, LockstepLink) else "rig on the bench"
        self.name = rig if name == CONTROLLERS[0] else f"{rig}, {name}"

    def _arm(self) -> None:
        self._take_controller(self.controller)  # one serves one run
        self.host.arm()

    def close(self) -> None:
        """Vent the muscles and end the connection."""
        self._stop.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        """Drive until it is stopped; at the end the muscles are vented."""
        host, link = self.host, self.host.link
        try:
            ahead = time.monotonic() - link.now
            due = link.now
            while not self._stop.is_set():
                due = max(due + PERIOD, link.now)
                ahead = self._wait(due, ahead)
                host.receive()
                self._obey()
                self._update()
                for listen in self.listeners:
                    listen(self.state)
            if host.state is State.ARMED:
                host.disarm()
        except BozziniError as error:
            self.state = replace(self.state, name="LOST", note=str(error))
        except Exception as error:
            self.state = replace(self.state, name="LOST", note=f"the drive has ended: {error!r}")
            raise
        finally:
            link.close()

    def _wait(self, due: float, ahead: float) -> float:
        """Wait for a time of the link; return how far the clock is ahead of an emulated one."""
        link = self.host.link
        link.wait(due)
        if isinstance(link, LockstepLink):
            link.records.clear()
            left = link.now + ahead - time.monotonic()
            if left < -BACKLOG:
                return time.monotonic() - link.now
            time.sleep(max(left, 0.0))
        return ahead

    def _obey(self) -> None:
        """Do what the windows command."""
        host = self.host
        acts = {"arm": self._arm, "disarm": host.disarm, "clear": host.clear}
        while not self._commands.empty():
            what = self._commands.get()
            try:
                if what in acts:
                    acts[what]()
                elif host.state is State.ARMED:
                    raise InputError("disarm the rig before its controller is changed")
                else:
                    self._take_controller(what)
                self.note = ""
            except InputError as error:
                self.note = str(error)

    def _update(self) -> None:
        """Send the set-points, if the board is armed, and look at what it measures."""
        host, board = self.host, self.host.telemetry
        now = host.link.now
        if board is None:
            return
        if board is not self._heard:
            self._heard, self._heard_at = board, now
        is_armed = host.state is State.ARMED
        if time.monotonic() - self._held_at > HOLD_LIMIT:
            self.travel = np.zeros(2)
        found = self.solve(self.travel if is_armed else np.zeros(2))
        measured = np.array(board.pressures, dtype=np.float64)
        acting = self._observer.observe(now - self._observed_at, measured)
        self._observed_at = now
        state = self.find_state(found, measured, acting=acting)
        if is_armed:
            sent = find_set_points(
                self._made, now, place=found.delivered, pressures=found.pressures, board=board
            )
            host.send(sent)
            state = replace(state, setpoints=np.array(sent.pressures))
        note = describe_faults(host.faults) or self.note
        name = host.state.name
        if now - self._heard_at > SILENCE_LIMIT:
            name, note = "LOST", f"the board has been silent for {now - self._heard_at:.1f} s"
        self.state = replace(
            state, name=name, note=note, time=now, travel=self.travel,
            reservoir=board.reservoir_pressure,
        )  # fmt: skip


def open_drive(
    effector_name: str,
    *,
    rig: str | None = None,
    board: str = "emulated",
    controller: str = "static",
) -> EffectorDrive:
    """Return the drive of an end-effector.

    Parameters
    ----------
    effector_name : str
        One of `bozzini.effector.EFFECTOR_PRESETS`, or a file of a fitted one.
    rig : str, optional
        ``"demo"`` for an emulated one, ``"serial:PORT"`` for a board on the bench; None: none.
    board : {"emulated", "native"}
        See `bozzini.rig.emulate_rig`.
    controller : str
        Of a rig: see `bozzini.rig.make_controller`.

    Raises
    ------
    InputError
        If the name or the rig is none, the effector is none for a rig, or no board answers.
    """
    from ..rig import SerialLink, emulate_rig

    check_rig(rig)
    effector = open_rig_effector(effector_name)
    if rig is None:
        return EffectorDrive(effector)
    if rig == "demo":
        emulated = emulate_rig(effector.models, board=board, motion=effector.motion)  # type: ignore[arg-type]
        link: Link = LockstepLink(emulated)
    else:
        link = SerialLink(rig.removeprefix("serial:"))
    return RigDrive(effector, link, controller=controller)


def check_rig(rig: str | None) -> None:
    """Raise `InputError` unless the rig is None, ``"demo"`` or ``"serial:PORT"``."""
    port = (rig or "").partition("serial:")[2]
    if rig not in (None, "demo") and not (port and rig == f"serial:{port}"):
        raise InputError(f"rig is '{rig}': it must be demo, or serial: and a port")
