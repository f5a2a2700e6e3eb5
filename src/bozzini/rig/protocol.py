"""The frames between host and board: COBS and CRC-16 round a type, a number and a payload.

``COBS(type u8 | sequence u8 | payload | CRC-16 little endian) 0x00`` at 500 kbaud. The board's side
is ``firmware/src/protocol.h``. COBS: Cheshire and Baker, IEEE/ACM Trans. Networking 7(2), 1999.
Pressures are whole hPa of gauge pressure on the wire and MPa here.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import ClassVar

from ..checks import check_integer, check_number
from ..errors import InputError

__all__ = [
    "BAUD_RATE",
    "PROTOCOL_VERSION",
    "Arm",
    "Clear",
    "Command",
    "Configuration",
    "Disarm",
    "Echo",
    "EchoReply",
    "Trip",
    "Frame",
    "FrameReader",
    "GetConfiguration",
    "Outcome",
    "Reply",
    "SetPoint",
    "State",
    "Telemetry",
    "TelemetryInterval",
    "Notice",
    "decode_cobs",
    "decode_reply",
    "encode",
    "encode_cobs",
    "find_crc",
    "pack_setpoints",
]

BAUD_RATE = 500_000
"""Of the serial line [bit/s], 8 data bits, no parity, one stop bit."""

PROTOCOL_VERSION = 1
"""Of the frames described here."""

SETPOINT_MAX = 0.827
"""Largest set-point [MPa] (thesis 3.2)."""

BODY_MAX = 64
"""Longest frame before COBS [bytes]: type, sequence, payload and CRC."""

ECHO_MAX = 32
"""Longest payload of an echo [bytes]."""

FEEDFORWARD_COUNTS = 800
"""Counts of the PWM period: feed-forward of 1 is as many."""

_HPA = 1e-4  # [MPa]
_ARM_KEY = 0xA53C
_CLEAR_KEY = 0x5AC3


class State(IntEnum):
    """The board's state. The muscles are vented in all but `ARMED`."""

    BOOT = 0
    DISARMED = 1
    ARMED = 2
    FAULT = 3


class Trip(IntFlag):
    """Why the board has left `State.ARMED`; several may come together."""

    NONE = 0
    HOST = 1
    OVERPRESSURE = 2
    SENSOR = 4
    SCAN = 8
    WATCHDOG = 16
    TRACKING = 32


class Notice(IntFlag):
    """What the board reports without a trip."""

    NONE = 0
    RESERVOIR_LOW = 1
    RESERVOIR_SENSOR = 2


class Outcome(IntEnum):
    """The board's answer to a command."""

    OK = 0
    WRONG_STATE = 1
    NO_SETPOINT = 2
    CAUSE_PRESENT = 3
    BAD_VALUE = 4
    UNKNOWN_TYPE = 5
    BAD_LENGTH = 6


def find_crc(data: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF) of bytes."""
    return crc_hqx(data, 0xFFFF)


def encode_cobs(data: bytes) -> bytes:
    """Return bytes without any zero that stand for `data`, without the closing zero."""
    coded = bytearray()
    blocks = data.split(b"\0")
    for i, block in enumerate(blocks):
        while len(block) > 253 and (len(block) > 254 or i < len(blocks) - 1):
            coded += b"\xff" + block[:254]
            block = block[254:]
        coded += bytes([len(block) + 1]) + block
    return bytes(coded)


def decode_cobs(data: bytes) -> bytes:
    """Return what `encode_cobs` was given.

    Raises
    ------
    InputError
        If the bytes are not COBS.
    """
    decoded, at = bytearray(), 0
    while at < len(data):
        end = at + data[at]
        if data[at] == 0 or end > len(data):
            raise InputError(f"byte {at} of the frame is {data[at]}: no distance to a zero in it")
        decoded += data[at + 1 : end]
        if end < len(data) and data[at] < 255:
            decoded.append(0)
        at = end
    return bytes(decoded)


def encode(kind: int, sequence: int, payload: bytes = b"") -> bytes:
    """Return a frame of any type as it goes over the wire, its closing zero included.

    Parameters
    ----------
    kind : int
        Type of the frame, in [0, 255].
    sequence : int
        Its number; counted modulo 256.
    payload : bytes
        At most 60.

    Raises
    ------
    InputError
        If type or payload is not legal.
    """
    check_integer("kind", kind, low=0, high=255)
    check_integer("bytes of the payload", len(payload), low=0, high=BODY_MAX - 4)
    body = bytes([kind, sequence % 256]) + payload
    return encode_cobs(body + find_crc(body).to_bytes(2, "little")) + b"\0"


@dataclass(frozen=True)
class Command:
    """A frame from the host to the board."""

    kind: ClassVar[int]

    def pack(self) -> bytes:
        """Return the payload."""
        return b""

    def encode(self, sequence: int) -> bytes:
        """Return the frame as it goes over the wire; its number is counted modulo 256."""
        return encode(self.kind, sequence, self.pack())


def pack_setpoints(hectopascals: Sequence[int], counts: Sequence[int] = ()) -> bytes:
    """Return the payload of set-points, legal or not, with the complement of its sum behind it."""
    payload = struct.pack(f"<3H{len(counts)}h", *hectopascals, *counts)
    return payload + bytes([~sum(payload) & 0xFF])


@dataclass(frozen=True)
class SetPoint(Command):
    """Pressures asked for; the board also takes it as a sign that the host is alive.

    Parameters
    ----------
    pressures : sequence of 3 floats
        Gauge pressures [MPa], in [0, 0.827].
    feedforward : sequence of 3 floats, optional
        Opening of the valves beyond their dead zone as a share of full duty, in [-1, 1]: positive
        opens the fill valve, negative the bleed valve. It takes the place of the board's own
        feed-forward for 20 ms, or until the next set-points.

    Raises
    ------
    InputError
        If a value is outside its range.
    """

    pressures: Sequence[float]
    feedforward: Sequence[float] = ()
    kind: ClassVar[int] = 0x01

    def __post_init__(self) -> None:
        check_integer("number of pressures", len(self.pressures), low=3, high=3)
        for value in self.pressures:
            check_number("pressure", value, low=0.0, high=SETPOINT_MAX, unit="MPa")
        if len(self.feedforward) not in (0, 3):
            raise InputError(
                f"feedforward has {len(self.feedforward)} values: it must have 3 or none"
            )
        for value in self.feedforward:
            check_number("feedforward", value, low=-1.0, high=1.0)

    def pack(self) -> bytes:
        """Return the payload."""
        values = [round(value / _HPA) for value in self.pressures]
        counts = [round(value * FEEDFORWARD_COUNTS) for value in self.feedforward]
        return pack_setpoints(values, counts)

    def encode(self, sequence: int) -> bytes:
        """Return the frame as it goes over the wire; its number is counted modulo 256."""
        return encode(0x08 if self.feedforward else 0x01, sequence, self.pack())


@dataclass(frozen=True)
class Arm(Command):
    """Let the board control: refused without fresh set-points, or with pressure in a muscle."""

    kind: ClassVar[int] = 0x02

    def pack(self) -> bytes:
        """Return the payload."""
        return _ARM_KEY.to_bytes(2, "little")


@dataclass(frozen=True)
class Disarm(Command):
    """Vent all muscles."""

    kind: ClassVar[int] = 0x03


@dataclass(frozen=True)
class Clear(Command):
    """Leave `State.FAULT`: refused while a cause, or pressure in a muscle, is present."""

    kind: ClassVar[int] = 0x04

    def pack(self) -> bytes:
        """Return the payload."""
        return _CLEAR_KEY.to_bytes(2, "little")


@dataclass(frozen=True)
class Echo(Command):
    """Have bytes sent back, at most 32."""

    data: bytes
    kind: ClassVar[int] = 0x05

    def __post_init__(self) -> None:
        check_integer("bytes of the echo", len(self.data), low=0, high=ECHO_MAX)

    def pack(self) -> bytes:
        """Return the payload."""
        return self.data


@dataclass(frozen=True)
class TelemetryInterval(Command):
    """Set the time between telemetry frames: whole milliseconds, in [1, 255]."""

    milliseconds: int
    kind: ClassVar[int] = 0x06

    def __post_init__(self) -> None:
        check_integer("milliseconds", self.milliseconds, low=1, high=255)

    def pack(self) -> bytes:
        """Return the payload."""
        return bytes([self.milliseconds])


@dataclass(frozen=True)
class GetConfiguration(Command):
    """Ask for `Configuration`."""

    kind: ClassVar[int] = 0x07


@dataclass(frozen=True)
class Frame:
    """A frame from the board to the host.

    Attributes
    ----------
    sequence : int
        Its number, modulo 256.
    """

    sequence: int


Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Telemetry(Frame):
    """What the board measures and does.

    Attributes
    ----------
    state, faults, warnings : State, Trip, Notice
        State, all faults since the last `Clear`, and warnings now.
    is_supply_open : bool
        Whether the supply valve is energised.
    acknowledged : int
        Number of the last set-point frame that was obeyed.
    reset_cause : int
        The chip's register MCUSR at its last reset; bit 3 is the watchdog.
    time : float
        Since the last reset [s].
    pressures : 3 floats
        Gauge pressures in the muscles [MPa].
    reservoir_pressure : float
        Gauge pressure [MPa].
    stick : 2 ints
        Thumb-stick x and y, in [0, 1023].
    fill, bleed : 3 floats
        Duties of the valves, in [0, 1].
    accepted, bad, gaps : int
        Frames from the host: obeyed, of wrong check or content, missing by their numbers; modulo
        65536.
    loop_time : float
        Longest control pass since the telemetry before [s].
    missed : int
        Ticks that found the measurement before incomplete, modulo 256.
    lost : int
        Frames to the host that found no room on the line, modulo 256.
    """

    state: State
    faults: Trip
    warnings: Notice
    is_supply_open: bool
    acknowledged: int
    reset_cause: int
    time: float
    pressures: Triple
    reservoir_pressure: float
    stick: tuple[int, int]
    fill: Triple
    bleed: Triple
    accepted: int
    bad: int
    gaps: int
    loop_time: float
    missed: int
    lost: int

    layout: ClassVar[struct.Struct] = struct.Struct("<6BI4h2H6B4H2B")

    @classmethod
    def unpack(cls, sequence: int, payload: bytes) -> Telemetry:
        """Return the telemetry of a payload."""
        state, faults, warnings, supply, acknowledged, cause, ms, *rest = cls.layout.unpack(payload)
        pressures = [value * _HPA for value in rest[:4]]
        duties = [4.0 * value / FEEDFORWARD_COUNTS for value in rest[6:12]]
        accepted, bad, gaps, loop_us, missed, lost = rest[12:]
        return cls(
            sequence=sequence,
            state=State(state),
            faults=Trip(faults),
            warnings=Notice(warnings),
            is_supply_open=bool(supply),
            acknowledged=acknowledged,
            reset_cause=cause,
            time=1e-3 * ms,
            pressures=(pressures[0], pressures[1], pressures[2]),
            reservoir_pressure=pressures[3],
            stick=(rest[4], rest[5]),
            fill=(duties[0], duties[1], duties[2]),
            bleed=(duties[3], duties[4], duties[5]),
            accepted=accepted,
            bad=bad,
            gaps=gaps,
            loop_time=1e-6 * loop_us,
            missed=missed,
            lost=lost,
        )


@dataclass(frozen=True)
class Reply(Frame):
    """The answer to a command, or why a frame was refused.

    Attributes
    ----------
    kind : int
        Type of the frame that it answers.
    outcome : Outcome
        The answer.
    """

    kind: int
    outcome: Outcome

    layout: ClassVar[struct.Struct] = struct.Struct("<2B")

    @classmethod
    def unpack(cls, sequence: int, payload: bytes) -> Reply:
        """Return the reply of a payload."""
        kind, outcome = cls.layout.unpack(payload)
        return cls(sequence, kind, Outcome(outcome))


@dataclass(frozen=True)
class EchoReply(Frame):
    """The bytes of an `Echo`."""

    data: bytes

    @classmethod
    def unpack(cls, sequence: int, payload: bytes) -> EchoReply:
        """Return the echo of a payload."""
        return cls(sequence, payload)


@dataclass(frozen=True)
class Configuration(Frame):
    """What the board was built with.

    Attributes
    ----------
    version : int
        Of the protocol.
    is_test_build : bool
        Whether it obeys the frames that stop it, for tests only.
    build_id : int
        First 32 bits of the SHA-256 of the sources; see `bozzini.rig.firmware.find_build_id`.
    tick_rate : float
        Of measurement and control [Hz].
    setpoint_max, arm_max, overpressure : float
        Largest set-point, largest pressure at which it arms, trip [MPa].
    slew_rate : float
        Largest rate of the reference [MPa/s].
    host_timeout : float
        Silence of the host that trips [s].
    sensor_low, sensor_high : float
        Legal window of a pressure sensor [V].
    sensor_span : float
        Pressure between 0.5 V and 4.5 V [MPa].
    tracking_error, tracking_time : float
        Error [MPa] that trips when it lasts [s].
    pwm_counts, jump : int
        Counts of the PWM period, and to cross a valve's dead zone.
    fill_time, bleed_time : float
        Time constants of the fill and the bleed valve that the controller takes [s]: two thirds,
        and a half, of volume over area and speed of the flow through the open valve.
    loop_time : float
        Time in which an error is to decay [s].
    integral : float
        Gain of the integral [counts/(MPa s)].
    error_dead : float
        Error below which the valves stay shut [MPa].
    shaped_slew_rate : float
        Largest rate of the reference while a feed-forward from the host holds [MPa/s].
    """

    version: int
    is_test_build: bool
    build_id: int
    tick_rate: float
    setpoint_max: float
    arm_max: float
    overpressure: float
    slew_rate: float
    host_timeout: float
    sensor_low: float
    sensor_high: float
    sensor_span: float
    tracking_error: float
    tracking_time: float
    pwm_counts: int
    jump: int
    fill_time: float
    bleed_time: float
    loop_time: float
    integral: float
    error_dead: float
    shaped_slew_rate: float

    layout: ClassVar[struct.Struct] = struct.Struct("<BBI19H")

    @classmethod
    def unpack(cls, sequence: int, payload: bytes) -> Configuration:
        """Return the configuration of a payload."""
        version, is_test, build_id, *values = cls.layout.unpack(payload)
        return cls(
            sequence=sequence,
            version=version,
            is_test_build=bool(is_test),
            build_id=build_id,
            tick_rate=values[0],
            setpoint_max=values[1] * _HPA,
            arm_max=values[2] * _HPA,
            overpressure=values[3] * _HPA,
            slew_rate=values[4] * _HPA / 1e-3,
            host_timeout=values[5] * 1e-3,
            sensor_low=values[6] * 1e-3,
            sensor_high=values[7] * 1e-3,
            sensor_span=values[8] * _HPA,
            tracking_error=values[9] * _HPA,
            tracking_time=values[10] * 1e-3,
            pwm_counts=values[11],
            jump=values[12],
            fill_time=values[13] * 1e-3,
            bleed_time=values[14] * 1e-3,
            loop_time=values[15] * 1e-3,
            integral=values[16] / 4096 / _HPA / 1e-3,
            error_dead=values[17] * _HPA,
            shaped_slew_rate=values[18] * _HPA / 1e-3,
        )


_REPLIES: dict[int, type[Telemetry] | type[Reply] | type[Configuration] | type[EchoReply]] = {
    0x81: Telemetry,
    0x82: Reply,
    0x83: Configuration,
    0x85: EchoReply,
}


class ForeignFrameError(InputError):
    """A frame of a right CRC is not one of this version of the protocol."""


def decode_reply(wire: bytes) -> Frame:
    """Return the frame of the board that bytes stand for, without the closing zero.

    Raises
    ------
    ForeignFrameError
        If their CRC is right, but not their type, length or value.
    InputError
        If they are not COBS, or of a wrong CRC.
    """
    body = decode_cobs(wire)
    if len(body) < 4 or find_crc(body[:-2]) != int.from_bytes(body[-2:], "little"):
        raise InputError(f"the CRC of the frame {wire.hex()} is wrong")
    if body[0] not in _REPLIES:
        raise ForeignFrameError(
            f"a frame is of type {body[0]:#04x}: legal are 0x81, 0x82, 0x83 and 0x85"
        )
    try:
        return _REPLIES[body[0]].unpack(body[1], body[2:-2])
    except (struct.error, ValueError) as error:
        raise ForeignFrameError(
            f"a frame of type {body[0]:#04x} has no legal payload: {error}"
        ) from None


class FrameReader:
    """Frames of the board from a stream of bytes; what lies before the first zero is dropped.

    Attributes
    ----------
    good, bad : int
        Frames read, and frames of wrong check or content.
    foreign : int
        Those of the bad ones whose check is right: of another version of the protocol.
    gaps : int
        Frames missing by their numbers.
    """

    def __init__(self) -> None:
        self.good = self.bad = self.foreign = self.gaps = 0
        self._rest: bytearray | None = None
        self._last = -1

    def read(self, data: bytes) -> list[Frame]:
        """Take the bytes that came, and return the frames that are whole."""
        *whole, rest = data.split(b"\0")
        found = []
        for part in whole:
            wire, self._rest = None if self._rest is None else self._rest + part, bytearray()
            if not wire or len(wire) > BODY_MAX + 1:
                self.bad += bool(wire)
                continue
            try:
                frame = decode_reply(bytes(wire))
            except InputError as error:
                self.bad += 1
                self.foreign += isinstance(error, ForeignFrameError)
                continue
            if self._last >= 0:
                self.gaps += (frame.sequence - self._last - 1) % 256
            self._last = frame.sequence
            self.good += 1
            found.append(frame)
        if self._rest is not None and len(self._rest) <= BODY_MAX + 1:
            self._rest += rest
        return found
