"""Frames: the code in Python against the board's in C, and what damage does to a frame."""

from __future__ import annotations

import ctypes
import random
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.errors import InputError
from bozzini.rig.board import NativeBoard
from bozzini.rig.emulator import EmulatedBoard
from bozzini.rig.firmware import build
from bozzini.rig.protocol import (
    Arm,
    Disarm,
    Echo,
    FrameReader,
    GetConfiguration,
    Outcome,
    Reply,
    SetPoint,
    State,
    TelemetryInterval,
    decode_cobs,
    decode_reply,
    encode,
    encode_cobs,
    find_crc,
    pack_setpoints,
)
from tests.rig.host import Host


def test_crc_is_the_catalogued_one():
    assert find_crc(b"123456789") == 0x29B1


@given(st.binary(max_size=600) | st.lists(st.sampled_from([0, 1, 255]), max_size=600).map(bytes))
def test_cobs_has_no_zero_and_is_undone(data):
    coded = encode_cobs(data)
    assert 0 not in coded
    assert len(coded) <= len(data) + 1 + len(data) // 254
    assert decode_cobs(coded) == data


@pytest.mark.parametrize("length", [253, 254, 255, 508, 509])
def test_cobs_of_long_runs_without_zero(length):
    for data in (b"x" * length, b"x" * length + b"\0", b"\0" + b"x" * length):
        assert decode_cobs(encode_cobs(data)) == data


@given(
    st.lists(st.floats(0.0, 0.827), min_size=3, max_size=3),
    st.none() | st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3),
    st.integers(0, 1000),
)
def test_setpoints_are_hectopascals_on_the_wire(pressures, feedforward, sequence):
    body = decode_cobs(SetPoint(pressures, feedforward or ()).encode(sequence)[:-1])
    assert body[:2] == bytes([8 if feedforward else 1, sequence % 256])
    values = struct.unpack_from("<3H", body, 2)
    assert np.allclose(np.array(values) * 1e-4, pressures, rtol=0, atol=0.5001e-4)
    if feedforward:
        counts = struct.unpack_from("<3h", body, 8)
        assert np.allclose(np.array(counts) / 800, feedforward, rtol=0, atol=0.5001 / 800)


@pytest.mark.parametrize(
    "make",
    [
        lambda: SetPoint((0.1, 0.2, 0.83)),
        lambda: SetPoint((0.1, -0.001, 0.2)),
        lambda: SetPoint((0.1, float("nan"), 0.2)),
        lambda: SetPoint((0.1, 0.2)),
        lambda: SetPoint((0.1, 0.2, 0.3), (0.0, 1.1, 0.0)),
        lambda: SetPoint((0.1, 0.2, 0.3), (0.0, 0.1)),
        lambda: TelemetryInterval(0),
        lambda: TelemetryInterval(256),
        lambda: Echo(bytes(33)),
        lambda: encode(256, 0),
        lambda: encode(1, 0, bytes(61)),
        lambda: decode_cobs(b"\x05ab"),
        lambda: decode_reply(b"\x01"),
        lambda: decode_reply(encode(0x70, 0, b"12")[:-1]),
        lambda: decode_reply(encode(0x81, 0, b"12")[:-1]),
        lambda: decode_reply(encode(0x82, 0, b"\x01\x77")[:-1]),
    ],
)
def test_what_is_not_legal_is_refused(make):
    with pytest.raises(InputError):
        make()


def test_reader_counts_and_comes_into_step_again():
    frames = [encode(0x82, k, bytes([1, 0])) for k in range(6)]
    reader = FrameReader()
    assert reader.read(frames[0]) == []  # nothing is known of what came before the first zero
    assert reader.read(frames[1][:3]) == []
    assert [frame.sequence for frame in reader.read(frames[1][3:] + b"\0\0" + frames[2])] == [1, 2]
    damaged = bytearray(frames[3])
    damaged[2] ^= 4
    found = reader.read(bytes(damaged) + b"x" * 500 + b"\0" + frames[5])
    assert found == [Reply(5, 1, 0)]
    assert (reader.good, reader.bad, reader.gaps) == (3, 2, 2)


class Codec:
    """The board's frames in C."""

    def __init__(self, sources=None) -> None:
        self.sources = sources
        library = ctypes.CDLL(str(build("native.so", sources)))
        self._encode = library.bz_native_encode
        self._parse = library.bz_native_parse
        self._parse.restype = ctypes.c_size_t
        self._parse.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_char_p, ctypes.c_void_p]

    def encode(self, kind, sequence, payload):
        body = ctypes.create_string_buffer(bytes([kind, sequence]) + payload, 64)
        wire = ctypes.create_string_buffer(66)
        length = self._encode(body, 2 + len(payload), wire)
        return wire.raw[:length]

    def parse(self, stream):
        """Return the bodies accepted, and the number of bad frames."""
        to = ctypes.create_string_buffer(len(stream) + 64)
        bad = ctypes.c_uint32()
        size = self._parse(stream, len(stream), to, ctypes.byref(bad))
        raw, bodies, at = to.raw[:size], [], 0
        while at < size:
            bodies.append(raw[at + 1 : at + 1 + raw[at]])
            at += 1 + raw[at]
        return bodies, bad.value


@pytest.fixture(scope="module")
def codec(toolchain):
    return Codec()


def test_both_codes_agree(codec):
    rng = np.random.default_rng(1)
    stream, expected = [], []
    for k in range(20_000):
        payload = rng.integers(0, 256 if k % 2 else 3, k % 61, dtype=np.uint8).tobytes()
        kind = int(rng.integers(256))
        stream.append(encode(kind, k, payload))
        expected.append(bytes([kind, k % 256]) + payload)
        assert codec.encode(kind, k % 256, payload) == stream[-1]
    assert codec.parse(b"".join(stream)) == (expected, 0)


def _damage(frame: bytes, kind: int, rng: random.Random) -> bytes:
    """Return a frame with one of eight kinds of damage; the closing zero stays, except for one."""
    data = bytearray(frame)
    at = rng.randrange(len(data) - 1)
    if kind < 4:
        count = 1 + kind if kind < 3 else rng.randint(4, 12)
        for bit in rng.sample(range(8 * len(data) - 8), count):
            data[bit // 8] ^= 1 << (bit % 8)
    elif kind == 4:
        del data[at]
    elif kind == 5:
        data.insert(at, rng.randrange(256))
    elif kind == 6:
        del data[at:-1]
    else:  # the delimiter is lost: two frames in one
        data[-1:] = frame
    return bytes(data)


def make_damaged(count, seed):
    """Return damaged frames of legal set-points."""
    rng = random.Random(seed)
    frames = [
        encode(1, k, pack_setpoints([rng.randint(0, 8270) for _ in range(3)]))
        for k in range(min(count, 10_000))
    ]
    damaged = []
    for k in range(count):
        frame = new = rng.choice(frames)
        while new.strip(b"\0") == frame.strip(b"\0"):
            new = _damage(frame, k % 8, rng)
        damaged.append(new)
    return damaged


def _is_frame(part: bytes) -> bool:
    try:
        body = decode_cobs(part)
    except InputError:
        return False
    return len(body) >= 4 and find_crc(body[:-2]) == int.from_bytes(body[-2:], "little")


@pytest.mark.parametrize(
    "count", [10_000, pytest.param(1_000_000, marks=pytest.mark.slow)], ids=["1e4", "1e6"]
)
def test_no_damaged_frame_is_obeyed(codec, count):
    """The CRC lets one in 65 536 pass of what still looks like a frame; then comes the check."""
    stream = b"".join(make_damaged(count, 2))
    bodies, bad = codec.parse(stream)
    parts = [part for part in stream.split(b"\0") if part]
    assert len(bodies) + bad == len(parts)
    assert len(bodies) <= max(1, 2 * count / 65536)
    if count <= 10_000:  # the code in Python finds the same
        assert len(bodies) == sum(map(_is_frame, parts))
    with NativeBoard(sources=codec.sources) as board:
        host = Host(board)
        board.write(stream)
        for _ in range(len(stream) // 50_000 + 1):
            board.run(1.0)
            host.frames = host.reader.read(board.read())[-10:]
        assert (host.telemetry.accepted, host.telemetry.acknowledged) == (0, 0)
        assert host.telemetry.bad == len(parts) % 65536


@pytest.mark.parametrize(
    "count", [2_000, pytest.param(100_000, marks=pytest.mark.slow)], ids=["2e3", "1e5"]
)
def test_no_damaged_frame_is_obeyed_by_the_emulated_chip(codec, count):
    stream = b"".join(make_damaged(count, 3))
    with EmulatedBoard() as board:
        host = Host(board)
        host.run(20)
        board.write(stream)
        for _ in range(len(stream) // 40_000 + 1):
            board.run(1.0)
            host.frames = host.reader.read(board.read())[-10:]
        assert (host.telemetry.accepted, host.telemetry.acknowledged) == (0, 0)
        assert host.telemetry.bad == sum(map(bool, stream.split(b"\0"))) % 65536
        assert host.ask(Arm()).outcome == Outcome.NO_SETPOINT
        assert (host.telemetry.state, host.reader.bad) == (State.DISARMED, 0)


def test_frame_after_garbage_is_good(codec):
    rng = np.random.default_rng(4)
    for _ in range(300):
        garbage = rng.integers(0, 256, rng.integers(1, 200), dtype=np.uint8).tobytes()
        good = encode(3, 7)
        bodies, _ = codec.parse(garbage + b"\0" + good)
        assert bodies[-1] == b"\x03\x07"
        # Without a zero behind it the garbage takes one frame with it, and no more.
        assert codec.parse(garbage + good + good)[0][-1] == b"\x03\x07"


def test_emulated_chip_comes_into_step_again(toolchain):
    rng = np.random.default_rng(5)
    with EmulatedBoard() as board:
        host = Host(board)
        host.run(20)
        for k in range(20):
            board.write(
                rng.integers(0, 256, rng.integers(1, 100), dtype=np.uint8).tobytes() + b"\0"
            )
            host.run(4)
            before = host.telemetry.accepted
            assert host.ask(Disarm() if k % 2 else GetConfiguration()).outcome == 0
            host.run(4)
            assert host.telemetry.accepted == before + 1
