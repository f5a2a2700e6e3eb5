"""The emulated chip: converter, outputs, timing, repeatability; and the native board beside it."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.rig.board import NativeBoard
from bozzini.rig.emulator import CLOCK_RATE, EmulatedBoard
from bozzini.rig.protocol import Arm, SetPoint, State, TelemetryInterval
from tests.rig.host import Host, to_voltage

HALF = (0.3, 0.2, 0.4)


def test_converter_has_1024_counts_for_the_supply(ordinary_board):
    host = Host(ordinary_board)
    host.run(20)
    for voltage in np.linspace(0.0, 5.0, 101):
        host.voltages[4:] = voltage, 5.0 - voltage
        host.run(8)
        for read, given in zip(host.telemetry.stick, host.voltages[4:], strict=True):
            assert abs(read - min(int(given / 5.0 * 1024 + 1e-9), 1023)) <= 1


def test_pressures_are_read_within_a_count(ordinary_board):
    host = Host(ordinary_board)
    host.run(20)
    for pressure in np.linspace(0.0, 0.85, 41):
        host.voltages[:3] = to_voltage(pressure)
        host.run(4)
        assert np.allclose(host.telemetry.pressures, pressure, rtol=0, atol=0.7 * 1.034 / 819.2)


def test_duties_agree_with_the_levels_of_the_pins(toolchain):
    with EmulatedBoard() as board:
        host = Host(board)
        host.arm((0.0, 0.0, 0.0))
        hold = (0.5, 0.5, 0.5)
        for pressure in (0.45, 0.42, 0.53, 0.58):  # the integral stays off
            host.voltages[:3] = to_voltage([pressure, pressure + 0.02, pressure - 0.01])
            host.run(300, hold)
            assert host.telemetry.state == State.ARMED
            duties = host.run(1, hold)[0]
            assert np.abs(duties - board.levels).max() < 2e-3
            assert np.any((duties > 0.0) & (duties < 1.0))


def _run_script(seed, boards):
    """Run boards in turns through one script, and return a hash of all they did for each."""
    scripts = [np.random.default_rng(seed) for _ in boards]
    hosts = [Host(board) for board in boards]
    for k in range(40):
        for host, script in zip(hosts, scripts, strict=True):
            host.voltages[:3] = to_voltage(script.uniform(0.0, 0.04 if k < 5 else 0.8, 3))
            host.send(SetPoint(tuple(script.uniform(0.0, 0.8, 3))))
            if k == 4:
                host.send(Arm())
            host.run(10)
    return [
        hashlib.sha256(np.array(host.duties).tobytes() + repr(host.frames).encode()).hexdigest()
        for host in hosts
    ]


def test_runs_repeat_bit_by_bit_alone_and_side_by_side(toolchain):
    with EmulatedBoard() as first, EmulatedBoard() as second, EmulatedBoard() as third:
        (alone,) = _run_script(1, [first])
        assert _run_script(1, [second, third]) == [alone, alone]
    with EmulatedBoard() as other:
        assert _run_script(2, [other]) != [alone]


def test_both_boards_do_the_same(toolchain):
    logs = []
    for kind in (NativeBoard, EmulatedBoard):
        with kind() as board:
            host = Host(board)
            host.arm()
            rng = np.random.default_rng(5)
            for _ in range(30):
                host.voltages[:3] = to_voltage(rng.uniform(0.2, 0.25, 3))
                host.run(10, (0.3, 0.2, 0.25))
            host.run(150)
            logs.append((np.array(host.duties), host.telemetry.faults))
    (native, native_faults), (emulated, emulated_faults) = logs
    assert native_faults == emulated_faults
    # They may be a tick apart, as their clocks start at other places of the millisecond.
    apart = np.abs(native - emulated)
    assert np.quantile(apart, 0.9) < 0.02
    for shift in (-1, 1):
        apart = np.minimum(apart, np.abs(native - np.roll(emulated, shift, axis=0)))
    assert np.quantile(apart, 0.99) < 0.05


def test_control_pass_is_shorter_than_a_tick(toolchain):
    """With frames at 1 kHz both ways, the most that the line carries."""
    with EmulatedBoard() as board:
        host = Host(board)
        host.arm()
        host.send(TelemetryInterval(1))
        host.run(10)
        begin = len(host.list_telemetry())
        host.run(300, HALF, every=1)
        frames = host.list_telemetry()[begin:]
        assert max(frame.loop_time for frame in frames) < 0.9e-3
        assert (frames[-1].missed, frames[-1].lost, frames[-1].bad) == (0, 0, 0)
        assert frames[-1].accepted - frames[0].accepted == pytest.approx(300, abs=3)
        assert (host.reader.bad, host.reader.gaps) == (0, 0)


def test_stepping_is_exact_to_the_cycle(toolchain):
    """Steps of any size add up: what one reaches too far, the next is short of."""
    with EmulatedBoard() as board:
        for duration in (1e-3, 1e-5, 3.3e-4, 0.01):
            before = board.cycles
            for _ in range(50):
                board.run(duration)
            assert abs(board.cycles - before - 50 * duration * CLOCK_RATE) < 200


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), 1e9])
def test_illegal_time_is_refused(ordinary_board, duration):
    with pytest.raises(InputError, match="duration is"):
        ordinary_board.run(duration)


def test_native_board_runs_whole_milliseconds(toolchain):
    with NativeBoard() as board, pytest.raises(InputError, match="whole milliseconds"):
        board.run(1.5e-3)


def test_illegal_voltages_and_a_closed_board_are_refused(ordinary_board):
    for wrong in ([1.0] * 5, [1.0] * 5 + [float("nan")]):
        with pytest.raises(InputError, match="voltages are"):
            ordinary_board.set_voltages(wrong)
    ordinary_board.close()
    with pytest.raises(InputError, match="closed"):
        ordinary_board.run(1e-3)
