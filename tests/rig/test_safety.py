"""The safety functions, on the board compiled for this computer and on the emulated chip."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.rig.protocol import (
    Arm,
    Command,
    Configuration,
    Disarm,
    Echo,
    EchoReply,
    GetConfiguration,
    Notice,
    Outcome,
    SetPoint,
    State,
    TelemetryInterval,
    Trip,
    encode,
    pack_setpoints,
)
from tests.rig.host import RESERVOIR, VENTED, Host, find_vent, to_voltage

STOP_ADC, STOP_TICK, HANG = 0x7D, 0x7E, 0x7F
WATCHDOG_RESET = 8
HALF = (0.3, 0.2, 0.4)


class Raw(Command):
    """A frame of any type and payload."""

    def __init__(self, kind: int, payload: bytes = b"") -> None:
        object.__setattr__(self, "raw", (kind, payload))

    def encode(self, sequence: int) -> bytes:
        return encode(self.raw[0], sequence, self.raw[1])


def test_muscles_are_vented_and_the_supply_is_shut_until_armed(board):
    host = Host(board)
    duties = host.run(30, HALF)
    assert np.all(duties == VENTED)
    states = [frame.state for frame in host.list_telemetry()]
    assert states == sorted(states)
    assert set(states) == {State.BOOT, State.DISARMED}
    host.arm(HALF)
    host.run(1, HALF)
    assert host.duties[-1][6] == 1.0
    assert host.telemetry.is_supply_open
    assert np.all(host.duties[-1][:3] > 0.3)
    assert host.ask(Disarm(), HALF).outcome == Outcome.OK
    host.run(2, HALF)
    assert np.array_equal(host.duties[-1], VENTED)
    assert host.telemetry.state == State.DISARMED


def test_host_silence_vents(board):
    host = Host(board)
    for _ in range(3):
        host.arm(HALF)
        host.run(10, HALF, every=20)
        host.send(SetPoint(HALF))
        assert 95 <= find_vent(host.run(120)) <= 105
        assert (host.telemetry.state, host.telemetry.faults) == (State.FAULT, Trip.HOST)
        assert host.ask(Arm(), HALF).outcome == Outcome.WRONG_STATE
        assert host.clear().outcome == Outcome.OK
        assert host.telemetry.state == State.DISARMED


def test_setpoints_out_of_range_are_no_sign_of_life(board):
    host = Host(board)
    host.arm(HALF)
    refused = Raw(0x01, pack_setpoints((3000, 8271, 4000)))
    before = len(host.duties)
    for _ in range(12):
        host.send(refused)
        host.run(10)
    assert find_vent(np.array(host.duties[before:])) <= 105
    assert host.telemetry.faults == Trip.HOST
    answers = [frame for frame in host.frames[-60:] if getattr(frame, "kind", 0) == 0x01]
    assert answers and all(frame.outcome == Outcome.BAD_VALUE for frame in answers)


@pytest.mark.parametrize("muscle", range(3))
@pytest.mark.parametrize("voltage", [0.0, 0.2, 4.8, 5.0])
def test_sensor_open_or_short_vents(board, muscle, voltage):
    host = Host(board)
    host.arm(HALF)
    host.run(20, HALF)
    host.voltages[muscle] = voltage
    assert find_vent(host.run(20, HALF)) <= 10
    assert host.telemetry.state == State.FAULT
    assert Trip.SENSOR in host.telemetry.faults
    assert (Trip.OVERPRESSURE in host.telemetry.faults) == (voltage > 4.5)


def test_overpressure_vents(board):
    host = Host(board)
    host.arm(HALF)
    host.set_pressure(1, 0.865)
    host.run(20, HALF)
    assert host.telemetry.state == State.ARMED
    host.set_pressure(1, 0.876)
    assert find_vent(host.run(20, HALF)) <= 5
    assert (host.telemetry.state, host.telemetry.faults) == (State.FAULT, Trip.OVERPRESSURE)
    assert not host.telemetry.is_supply_open


def test_program_that_hangs_is_reset_into_a_latched_fault(board):
    host = Host(board)
    host.arm(HALF)
    host.send(Raw(HANG))
    duties = host.run(100, HALF)
    assert find_vent(duties) <= 20  # 15 ms nominal, 17 ms emulated
    assert board.watchdog_resets == 1
    assert host.telemetry.state == State.FAULT
    assert host.telemetry.faults == Trip.WATCHDOG
    assert host.telemetry.reset_cause == WATCHDOG_RESET
    assert host.ask(Arm(), HALF).outcome == Outcome.WRONG_STATE
    assert host.clear().outcome == Outcome.OK
    assert host.telemetry.state == State.DISARMED


def test_lost_tick_is_reset_into_a_latched_fault(board):
    host = Host(board)
    host.arm(HALF)
    host.send(Raw(STOP_TICK))
    assert find_vent(host.run(100, HALF, every=2)) <= 20
    assert board.watchdog_resets == 1
    assert (host.telemetry.state, host.telemetry.faults) == (State.FAULT, Trip.WATCHDOG)


def test_lost_measurement_vents_before_the_watchdog(board):
    host = Host(board)
    host.arm(HALF)
    host.send(Raw(STOP_ADC))
    assert find_vent(host.run(12, HALF)) <= 7
    host.run(60, HALF)
    assert board.watchdog_resets == 1
    assert (host.telemetry.state, host.telemetry.faults) == (State.FAULT, Trip.WATCHDOG)


def test_clear_is_refused_while_the_cause_is_present(board):
    host = Host(board)
    host.arm(HALF)
    host.voltages[0] = 0.0
    host.run(20, HALF)
    assert host.clear().outcome == Outcome.CAUSE_PRESENT
    assert host.telemetry.state == State.FAULT
    host.set_pressure(0, 0.06)  # the sensor works again, but the muscle is not empty
    host.run(10, HALF)
    assert host.clear().outcome == Outcome.CAUSE_PRESENT
    host.set_pressure(0, 0.04)
    host.run(10, HALF)
    assert host.telemetry.faults == Trip.SENSOR  # latched
    assert host.clear().outcome == Outcome.OK
    assert (host.telemetry.state, host.telemetry.faults) == (State.DISARMED, Trip.NONE)
    assert np.array_equal(host.duties[-1], VENTED)


def test_clear_is_refused_while_the_host_is_silent(board):
    host = Host(board)
    host.arm(HALF)
    host.run(120)
    assert host.telemetry.faults == Trip.HOST
    assert host.clear().outcome == Outcome.CAUSE_PRESENT
    host.send(SetPoint(HALF))
    assert host.clear().outcome == Outcome.OK


def test_arming_needs_fresh_setpoints_and_empty_muscles(board):
    host = Host(board)
    host.run(30)
    assert host.ask(Arm()).outcome == Outcome.NO_SETPOINT
    host.send(SetPoint(HALF))
    host.run(101)
    assert host.ask(Arm()).outcome == Outcome.NO_SETPOINT
    host.set_pressure(2, 0.06)
    host.run(5, HALF)
    assert host.ask(Arm(), HALF).outcome == Outcome.CAUSE_PRESENT
    host.set_pressure(2, 0.0)
    host.run(3)
    assert host.ask(Raw(0x02, b"\x00\x00"), HALF).outcome == Outcome.BAD_VALUE
    assert host.telemetry.state == State.DISARMED
    assert host.ask(Arm(), HALF).outcome == Outcome.OK
    assert host.ask(Arm(), HALF).outcome == Outcome.WRONG_STATE


def test_clear_needs_its_key_and_a_fault(board):
    host = Host(board)
    host.run(30)
    assert host.clear().outcome == Outcome.WRONG_STATE
    host.voltages[0] = 0.0
    host.run(10)
    host.set_pressure(0, 0.0)
    host.run(10)
    assert host.ask(Raw(0x04, b"\xc4\x5a")).outcome == Outcome.BAD_VALUE
    assert host.telemetry.state == State.FAULT


def test_reference_follows_no_faster_than_the_slew_limit(board):
    """At a constant pressure the fill duty rises with the reference until it is at rest."""
    host = Host(board)
    host.arm()
    target = (0.1, 0.1, 0.1)
    duty = host.run(80, target)[:, 0]
    host.send(GetConfiguration())
    host.run(4, target)
    known = next(frame for frame in host.frames if isinstance(frame, Configuration))
    last = int(np.argmax(duty))
    assert abs(last - 1e3 * target[0] / known.slew_rate) <= 4
    # Each millisecond the reference moves on by the limit; the flow is choked, so that its
    # pressure is that of the reservoir.
    rise = np.diff(duty[6 : last - 3]) * known.pwm_counts
    rate = known.slew_rate * 1e-3 / known.loop_time
    expected = rate * known.fill_time * (known.pwm_counts - known.jump) / (RESERVOIR + 0.1013)
    assert rise.mean() == pytest.approx(expected, rel=0.02)
    assert rise.max() < expected + 1.0


def test_pressure_that_stays_off_its_reference_trips(board):
    host = Host(board)
    host.arm((0.3, 0.0, 0.0))
    assert 300 <= find_vent(host.run(400, (0.3, 0.0, 0.0))) <= 350
    assert host.telemetry.faults == Trip.TRACKING


def test_reservoir_is_warned_of(board):
    host = Host(board)
    host.run(30)
    assert host.telemetry.warnings == Notice.NONE
    assert host.telemetry.reservoir_pressure == pytest.approx(RESERVOIR, abs=1.3e-3)
    host.voltages[3] = to_voltage(0.80)
    host.run(10)
    assert host.telemetry.warnings == Notice.RESERVOIR_LOW
    host.voltages[3] = 5.0
    host.run(10)
    assert host.telemetry.warnings == Notice.RESERVOIR_SENSOR
    assert host.telemetry.state == State.DISARMED


def test_fill_and_bleed_are_never_both_open(board):
    rng = np.random.default_rng(3)
    host = Host(board)
    host.arm()
    for _ in range(60):
        host.voltages[:3] = to_voltage(rng.uniform(0.0, 0.8, 3))
        host.run(10, tuple(rng.uniform(0.0, 0.8, 3)))
        if host.telemetry.state == State.FAULT:
            break
    armed = [frame for frame in host.list_telemetry() if frame.state == State.ARMED]
    assert len(armed) > 100
    duties = np.array([(frame.fill, frame.bleed) for frame in armed])
    assert np.all(duties.prod(axis=1) == 0.0)
    assert np.all(duties.sum(axis=(0, 2)) > 0.0)


def test_feedforward_of_the_host_replaces_the_boards_own_for_20_ms(board):
    host = Host(board)
    hold = (0.1, 0.1, 0.1)
    host.arm(hold)
    host.voltages[:3] = to_voltage(0.1)
    host.run(80, hold)
    assert np.all(host.duties[-1][:6] == 0.0)
    host.send(SetPoint(hold, (0.1, -0.05, 0.0)))
    duties = host.run(40)
    jump = 248 / 800
    assert duties[5] == pytest.approx([jump + 0.1, 0, 0, 0, jump + 0.05, 0, 1], abs=2e-3)
    assert 19 <= np.count_nonzero(duties[:, 0] > 0.1) <= 22
    assert np.all(duties[-1][:6] == 0.0)
    too_much = Raw(0x08, pack_setpoints((0, 0, 0), (801, 0, 0)))
    assert host.ask(too_much, hold).outcome == Outcome.BAD_VALUE


def test_unknown_and_malformed_frames_are_answered_and_counted(board):
    host = Host(board)
    host.run(20)
    assert host.ask(Raw(0x55)).outcome == Outcome.UNKNOWN_TYPE
    assert host.ask(Raw(0x01, b"\0\0")).outcome == Outcome.BAD_LENGTH
    assert host.ask(Raw(0x01, bytes(7))).outcome == Outcome.BAD_VALUE  # the check is wrong
    assert host.ask(Raw(0x05, bytes(33))).outcome == Outcome.BAD_LENGTH
    assert host.ask(Raw(0x06, b"\0")).outcome == Outcome.BAD_VALUE
    host.send(Echo(b"\0ab\0"))
    host.run(4)
    assert [frame.data for frame in host.frames if isinstance(frame, EchoReply)] == [b"\0ab\0"]
    host.sequence += 7  # as if frames were lost
    host.send(SetPoint(HALF))
    host.run(4)
    telemetry = host.telemetry
    assert (telemetry.accepted, telemetry.bad, telemetry.gaps) == (2, 5, 7)
    assert telemetry.acknowledged == (host.sequence - 1) % 256
    assert (host.reader.bad, host.reader.gaps) == (0, 0)


def test_telemetry_comes_at_the_interval_asked_for(board):
    host = Host(board)
    host.run(20)
    for interval in (2, 1, 7):
        host.send(TelemetryInterval(interval))
        host.run(10)
        before = len(host.list_telemetry())
        host.run(140)
        spacing = np.diff([1e3 * frame.time for frame in host.list_telemetry()[before:]])
        assert np.mean(spacing) == pytest.approx(interval, abs=0.02)
    assert (host.telemetry.missed, host.telemetry.lost, host.reader.bad) == (0, 0, 0)


def test_measurements_stay_whole_when_frames_leave_no_time_for_them(board):
    host = Host(board)
    host.arm()
    host.send(TelemetryInterval(1))
    true = np.array([0.6, 0.55, 0.5])
    host.voltages[:3] = to_voltage(true)
    host.run(10, HALF)
    before = len(host.list_telemetry())
    for _ in range(150):
        host.send(SetPoint((0.62, 0.56, 0.52), (0.05, 0.05, -0.05)))
        host.send(SetPoint((0.5, 0.5, 0.6), (0.3, 0.3, -0.3)))
        host.run(1)
    frames = host.list_telemetry()[before:]
    assert len(frames) > 50
    assert np.abs(np.array([frame.pressures for frame in frames]) - true).max() < 1e-3


def test_reset_pin_vents_and_disarms(board):
    host = Host(board)
    host.arm(HALF)
    host.run(5, HALF)
    board.reset()
    assert find_vent(host.run(30)) <= 1
    assert host.telemetry.state == State.DISARMED
    assert host.telemetry.time < 0.04


def test_build_without_tests_cannot_be_stopped(ordinary_board):
    host = Host(ordinary_board)
    host.arm(HALF)
    for kind in (STOP_ADC, STOP_TICK, HANG):
        assert host.ask(Raw(kind), HALF).outcome == Outcome.UNKNOWN_TYPE
    host.run(50, HALF)
    assert host.telemetry.state == State.ARMED
    assert ordinary_board.watchdog_resets == 0
