"""What goes over the web socket: binary frames to the page, small JSON messages from it.

A frame is little-endian: eight u32 (`MAGIC`, number of the frame, step, links, points of the
backbone, muscles, flags, windows), three f64 (time, echo of the last input's time of this window,
speed), then f32: joints (links + 1, 3), clearance (links; NaN: not in the tract), set-points and
measured pressures (muscles each), stick, target, delivered and measured place of the tip (2 each,
the places in the end-effector's frame; those of a head are turned, so that -x is right and y up in
its camera's picture), backbone (points, 3), camera (place, way and up, 3 each). In place of the
backbone a head has its bodies, one after the other, as ``info.json`` lists them. Without links
there are no joints. Moved tissue is another kind of frame: `TISSUE`, number of the vertices, then
their places as f32 (vertices, 3); so are the shapes of a robot with sensors, see
`bozzini.cockpit.readings`. Lengths in mm, pressures in MPa, times in s, speed in mm/s.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_fields, check_number, quantity
from ..errors import InputError
from ..head.choices import CAMERAS, EFFECTORS
from ..io.records import check_depth
from ..rig.choices import CONTROLLERS

MAGIC = 0x315A4342
"""The first four bytes of a frame of the body, ``BCZ1``."""
TISSUE = 0x545A4342
"""The first four bytes of a frame of moved tissue, ``BCZT``."""
HEAD = struct.Struct("<8I3d")
ECHO = struct.Struct("<d")
ECHO_PLACE = 8 * 4 + 8
"""Where the echo stands, the one value in which the windows' frames differ."""

AnyFloats = NDArray[np.floating]


class Flags(IntFlag):
    """What is so at the time of a frame."""

    NONE = 0
    PLAYING = 1
    REACHED = 2
    """The stick's target is in the workspace."""
    RIG = 4
    ARMED = 8
    FAULT = 16
    INSIDE = 32
    """The tip is in the tract, and `tip clearance` is known."""
    PLANNING = 64
    PRESSED = 128
    """A window holds the stick."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Snapshot:
    """What all windows show: the contents of one frame.

    Attributes
    ----------
    step : int
        Of the plan.
    flags : Flags
    windows : int
        How many are open.
    speed : float
        Of the head while playing [mm/s].
    joints, clearance : (links + 1, 3), (links,) float
        Of the body [mm].
    pressures : (2, muscles) float
        Set-points and measured [MPa].
    places : (4, 2) float
        Stick, and wanted, delivered and measured place of the tip [mm].
    backbone : (points, 3) float
        Of the tip in the tract, or of a head's bodies [mm].
    camera : (3, 3) float
        Place [mm], way and up.
    """

    step: int
    flags: Flags
    windows: int
    speed: float
    joints: AnyFloats
    clearance: AnyFloats
    pressures: AnyFloats
    places: AnyFloats
    backbone: AnyFloats
    camera: AnyFloats

    def pack(self) -> bytes:
        """Return all but the head's number, time and echo: equal if nothing has changed."""
        parts = (self.joints, self.clearance, self.pressures, self.places, self.backbone)
        floats = [np.ascontiguousarray(part, dtype="<f4") for part in (*parts, self.camera)]
        counts = (len(self.clearance), len(self.backbone), self.pressures.shape[1])
        head = HEAD.pack(
            MAGIC, 0, self.step, *counts, int(self.flags), self.windows, 0.0, 0.0, self.speed
        )
        return head + b"".join(part.tobytes() for part in floats)


def stamp_frame(packed: bytes, number: int, *, time: float) -> bytearray:
    """Return a frame with its number and time [s]."""
    frame = bytearray(packed)
    struct.pack_into("<I", frame, 4, number % 2**32)
    struct.pack_into("<d", frame, 32, time)
    return frame


def echo_frame(frame: bytearray, echo: float) -> bytes:
    """Return a frame for one window: with the time of its last input."""
    own = bytearray(frame)
    ECHO.pack_into(own, ECHO_PLACE, echo)
    return bytes(own)


def pack_tissue(vertices: ArrayLike) -> bytes:
    """Return a frame of moved tissue: the vertices of its surface (n, 3) [mm]."""
    places = np.ascontiguousarray(vertices, dtype="<f4")
    return struct.pack("<2I", TISSUE, len(places)) + places.tobytes()


# Messages of the page.


@dataclass(frozen=True, kw_only=True)
class StickMove:
    """The stick of a window: right and up, as the tip's camera sees them; 1 is the full travel."""

    x: float = quantity(low=-1.0, high=1.0)
    y: float = quantity(low=-1.0, high=1.0)
    time: float = quantity("time", low=-1e15, high=1e15, default=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "stick ")


@dataclass(frozen=True, kw_only=True)
class Seek:
    """Go to a step of the plan; beyond its ends it is the first or the last."""

    step: float = quantity(low=-1e9, high=1e9)
    time: float = quantity("time", low=-1e15, high=1e15, default=0.0)

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class Play:
    """Let the head go on by itself at a speed [mm/s], or hold it."""

    on: bool = False
    speed: float = quantity("speed", low=-1000.0, high=1000.0, default=20.0)

    def __post_init__(self) -> None:
        if not isinstance(self.on, bool):
            raise InputError("play on must be true or false")
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class RigCommand:
    """Arm or disarm the rig, clear its fault, or choose its controller."""

    what: str = quantity("text", words=("arm", "disarm", "clear", *CONTROLLERS))

    def __post_init__(self) -> None:
        check_fields(self, "rig ")


@dataclass(frozen=True, kw_only=True)
class Slide:
    """Slide an instrument of a head out of its bore: 1 is as far as it reaches.

    It is that of an end-effector, from 1; None: of the one that is steered.
    """

    effector: int | None = quantity(default=None, low=1, high=3, whole=True)
    out: float = quantity(low=0.0, high=1.0)
    time: float = quantity("time", low=-1e15, high=1e15, default=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "slide ")


@dataclass(frozen=True, kw_only=True)
class HeadCommand:
    """Choose a head's camera, or the end-effector to steer; or set targets where it stands."""

    what: str = quantity("text", words=(*CAMERAS, "targets", *EFFECTORS))

    def __post_init__(self) -> None:
        check_fields(self, "head ")


@dataclass(frozen=True, kw_only=True)
class Change:
    """What is to be planned anew; what is None stays as it is.

    Attributes
    ----------
    diameter, link, inflate : float
        Of the scope and the wall [mm].
    start, end : tuple of 3 floats
        Ends of the way [mm].
    """

    diameter: float | None = quantity("length", low=0.1, high=500.0, default=None)
    link: float | None = quantity("length", low=0.1, high=10_000.0, default=None)
    inflate: float | None = quantity("length", low=0.0, high=30.0, default=None)
    start: tuple[float, ...] | None = None
    end: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("start", "end"):
            value = getattr(self, name)
            if value is None:
                continue
            if not isinstance(value, (list, tuple)) or len(value) != 3:
                raise InputError(f"{name} must be three lengths in mm")
            place = tuple(check_number(name, x, low=-1e6, high=1e6, unit="mm") for x in value)
            object.__setattr__(self, name, place)


Message = StickMove | Seek | Play | RigCommand | Slide | HeadCommand | Change
KINDS: Mapping[str, Callable[..., Message]] = {
    "stick": StickMove,
    "seek": Seek,
    "play": Play,
    "rig": RigCommand,
    "slide": Slide,
    "head": HeadCommand,
    "change": Change,
}
"""The messages by their ``kind``."""


class MessageError(InputError):
    """A message that the page never sends."""


def read_message(text: str) -> Message:
    """Return a message of the page.

    Raises
    ------
    MessageError
        If it is no JSON object of a known kind, or holds what is no finite number.
    InputError
        If a size to plan for is outside its legal range.
    """
    try:
        given = json.loads(text, parse_constant=_take_finite, parse_float=_take_finite)
        check_depth(given)
    except (ValueError, RecursionError):
        raise MessageError("the message is no JSON of finite numbers") from None
    if not isinstance(given, dict):
        raise MessageError("the message must be an object")
    kind = given.pop("kind", None)
    if not isinstance(kind, str) or kind not in KINDS:
        raise MessageError(f"the message must be of a kind in {', '.join(KINDS)}")
    try:
        return KINDS[kind](**given)
    except TypeError:
        words = f"the message of kind {kind} lacks a value or has one too many"
        raise MessageError(words) from None
    except InputError as error:
        raise error if kind == "change" else MessageError(str(error)) from None


def _take_finite(text: str) -> float:
    """Return a number; NaN, Infinity and 1e999 are none."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(text)
    return number
