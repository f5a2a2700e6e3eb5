"""The host: connects, arms, runs in time, logs, replays; in lock-step and over a real port."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from queue import Queue

import numpy as np
import pytest

from bozzini.effector import Effector, effector_preset
from bozzini.errors import InputError
from bozzini.rig import (
    BoardStick,
    Cosimulation,
    GamepadStick,
    Host,
    LockstepLink,
    ScriptedStick,
    SerialLink,
    Steering,
    check_board,
    emulate_rig,
    load_log,
    replay_log,
    run_circle,
    run_faults,
    run_steps,
    serve,
)
from bozzini.rig import host as host_module
from bozzini.rig.plant import CHAMBER_POINTS, CHAMBER_PRESSURE, Chamber, Fault
from bozzini.rig.protocol import (
    Configuration,
    FrameReader,
    SetPoint,
    State,
    Telemetry,
    Trip,
    encode,
)

pytestmark = pytest.mark.usefixtures("toolchain")

OVER = np.linspace(0.0, CHAMBER_PRESSURE, CHAMBER_POINTS)
RIGID = Chamber(pressure=OVER, volume=np.full(OVER.size, 30.0), contraction=8.0 * OVER)
HELD = (0.5, 0.25, 0.1)


def make_rig(seed: int = 0) -> Cosimulation:
    return emulate_rig(RIGID, board="native", seed=seed)


def connect(link, **options):
    host = Host(link, **options)
    host.connect()
    return host


def hold(time, board):
    return SetPoint(HELD), {"twice_s": 2.0 * time}


@pytest.fixture
def port() -> Iterator[str]:
    """Give the port of a rig that runs in real time."""
    paths: Queue[str] = Queue()
    stop = threading.Event()
    thread = threading.Thread(target=serve, args=(make_rig(), paths.put), kwargs={"stop": stop})
    thread.start()
    yield paths.get(timeout=10.0)
    stop.set()
    thread.join()


def test_pressures_reach_the_set_points_and_the_log_has_a_row_each_period():
    run = connect(LockstepLink(make_rig())).run(hold, 1.0)
    table = run.to_frame()
    assert run.converged and len(table) == 100
    assert np.allclose(np.diff(table["time_s"]), 0.01)
    assert np.allclose(table["twice_s"], 2.0 * table["time_s"])
    last = table.iloc[-1]
    assert [last[f"pressure_{k}_MPa"] for k in (1, 2, 3)] == pytest.approx(HELD, abs=0.01)
    assert table["utc"].iloc[0] == run.start
    assert run.to_dict()["jitter"]["max_ms"] == pytest.approx(10.0)
    assert (run.late, run.lost, run.bad, run.gaps, run.refused) == (0, 0, 0, 0, 0)


def test_the_muscles_are_vented_after_a_run():
    link = LockstepLink(make_rig())
    host = connect(link)
    host.run(hold, 0.5)
    link.wait(link.now + 0.5)
    host.receive()
    assert host.state is State.DISARMED
    assert link.rig.plant.pressures.max() < 0.02


def test_a_fault_ends_the_run_with_its_name():
    rig = make_rig()
    host = connect(LockstepLink(rig))

    def control(time, board):
        if time > 0.3:
            rig.plant.set_faults(Fault("sensor open", 1))
        return hold(time, board)

    run = host.run(control, 1.0)
    assert not run.converged and "sensor" in run.reason
    assert 30 <= len(run.rows) <= 34
    with pytest.raises(InputError, match="Clear: cause present"):
        host.clear()
    rig.plant.set_faults()
    host.clear()
    assert host.state is State.DISARMED


def test_a_control_that_hangs_lets_the_board_vent():
    rig = make_rig()
    link = LockstepLink(rig)
    host = connect(link)

    def control(now, board):
        if now >= 0.5:
            link.wait(link.now + 0.3)  # it computes, and the clock goes on
        return hold(now, board)

    run = host.run(control, 1.0)
    assert not run.converged and "host" in run.reason
    assert rig.plant.pressures.max() < 0.02


def test_an_error_of_the_control_disarms():
    rig = make_rig()
    link = LockstepLink(rig)
    host = connect(link)

    def control(now, board):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        host.run(control, 1.0)
    link.wait(link.now + 0.05)
    host.receive()
    assert host.state is State.DISARMED


def test_another_protocol_is_refused(monkeypatch):
    monkeypatch.setattr(host_module, "PROTOCOL_VERSION", 250)
    with pytest.raises(InputError, match=r"version \d+: this host has version 250"):
        connect(LockstepLink(make_rig()))


class Translated(LockstepLink):
    """A board whose frames of one type have another layout, as those of a later version may."""

    kind = Telemetry

    def __init__(self, rig):
        super().__init__(rig)
        self.reader = FrameReader()

    def read(self):
        wire = b"\0"
        for frame in self.reader.read(super().read()):
            if isinstance(frame, self.kind):
                wire += encode(0x81 if self.kind is Telemetry else 0x83, frame.sequence, bytes(4))
            elif isinstance(frame, Telemetry):
                wire += encode(0x81, frame.sequence, bytes([1] + [0] * (Telemetry.layout.size - 1)))
        return wire


@pytest.mark.parametrize("kind", [Telemetry, Configuration])
def test_frames_of_another_layout_are_named_as_another_version(kind):
    link = Translated(make_rig())
    link.kind = kind
    with pytest.raises(InputError, match="frames of a right CRC are not of version 1"):
        connect(link)


def test_a_board_that_goes_silent_ends_the_run():
    class Fading(LockstepLink):
        def read(self):
            found = super().read()
            return found if self.now < 0.5 else b""

    link = Fading(make_rig())
    run = connect(link).run(hold, 3.0)
    assert not run.converged and "the board has been silent for 0.5" in run.reason
    assert link.now < 1.2


def test_no_board_is_one_line():
    class Deaf(LockstepLink):
        def read(self):
            return b"\x00\x01noise\x00"

    with pytest.raises(InputError, match="no telemetry within 3 s"):
        connect(Deaf(make_rig()))


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_a_log_returns_and_its_replay_is_the_run(tmp_path, suffix):
    run = connect(LockstepLink(make_rig())).run(hold, 0.6)
    log = load_log(run.save(tmp_path / f"log{suffix}"))
    assert np.allclose(log["pressure_1_MPa"], run.to_frame()["pressure_1_MPa"])
    again = replay_log(LockstepLink(make_rig()), log)
    assert again.residual < 1e-9
    other = replay_log(LockstepLink(make_rig(seed=5)), log)
    assert 0.0 < other.rms <= other.residual < 0.02


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", "lacks time_s"),
        ("", "is empty: a table has a header and rows"),
        ("time_s,x\n", "lacks setpoint_1_MPa"),
        ("time_s,\n1,2\n", "column 2 has no title and the number 2"),
    ],
)
def test_what_is_no_log_is_one_line(tmp_path, text, words):
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        load_log(path)


def test_a_log_with_text_for_numbers_is_refused(tmp_path):
    run = connect(LockstepLink(make_rig())).run(hold, 0.1)
    table = run.to_frame().astype({"setpoint_2_MPa": object})
    table.loc[3, "setpoint_2_MPa"] = "much"
    table.to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(InputError, match="is 'much': it must be a finite number"):
        load_log(tmp_path / "log.csv")


def test_steps_are_judged_as_they_are_drawn():
    found = run_steps(make_rig())
    table = found.to_frame()
    assert len(table) == 6 and found.converged
    assert table["settle_time_ms"].between(0.0, 1000.0).all()
    assert found.plot().lines


def test_the_board_vents_after_every_fault():
    found = run_faults(make_rig)
    table = found.to_frame().set_index("fault")
    assert found.converged, found.reason
    assert table.loc["host silent", "vent_ms"] <= 105.0
    assert table.loc[["sensor open", "sensor short"], "vent_ms"].max() <= 10.0
    assert table["peak_kPa"].max() < 900.0
    assert table["left_kPa"].max() < 20.0  # a stuck fill valve too: the supply valve is shut


def test_the_tip_follows_the_stick_of_the_board():
    effector = Effector(effector_preset("prototype"))
    rig = emulate_rig(effector.models, board="native")
    run = run_circle(rig, effector, duration=3.0)
    table = run.to_frame()
    later = table[table["time_s"] > 1.0]
    angle = np.unwrap(np.arctan2(later["target_y_mm"], later["target_x_mm"]))
    assert angle[-1] - angle[0] == pytest.approx(2.0 * np.pi, rel=0.1)  # two seconds of 0.5 Hz
    size = np.hypot(later["target_x_mm"], later["target_y_mm"]).mean()
    assert run.tip_error_rms < 0.6 * size


def test_a_script_on_the_host_and_the_same_stick_on_the_board_steer_alike():
    effector = Effector(effector_preset("prototype"))
    script = ScriptedStick.circle(0.5, 1.0)
    steering = Steering(effector, script)
    host = connect(LockstepLink(emulate_rig(effector.models, board="native")))
    by_host = host.run(steering, 1.0).to_frame()
    by_board = run_circle(
        emulate_rig(effector.models, board="native"), effector, duration=1.0
    ).to_frame()
    # The board's converter has whole counts, and reports them a period later.
    for name in ("target_x_mm", "target_y_mm"):
        early, late = by_host[name].to_numpy()[50:-3], by_board[name].to_numpy()[50:]
        best = min(np.abs(late[k : k + early.size] - early).max() for k in range(4))
        assert best < 0.2


def test_a_real_port_carries_a_run(port):
    link = SerialLink(port)
    run = connect(link, period=0.01).run(hold, 0.5)
    link.close()
    assert run.converged and run.bad == run.refused == 0
    assert run.rows[-1]["pressure_2_MPa"] == pytest.approx(HELD[1], abs=0.05)


@pytest.mark.slow
def test_a_board_passes_its_checks_over_a_port(port):
    link = SerialLink(port)
    found = check_board(link)
    link.close()
    table = found.to_frame().set_index("check")
    assert found.converged, found.reason
    assert len(found.runs) == 3 and len(table) == 10


def test_a_silent_host_over_a_port_is_noticed(port):
    link = SerialLink(port)
    host = connect(link)
    host.run_armed(hold, 0.3)
    begin = time.monotonic()
    while host.state is State.ARMED and time.monotonic() < begin + 5.0:
        host.pause()
    link.close()
    assert host.faults is Trip.HOST
    assert time.monotonic() - begin > 0.08


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: SerialLink("/dev/no such port"), "/dev/no such port"),
        (lambda: Host(LockstepLink(make_rig()), period=0.2), r"period is 0.2 s.*\[0.001, 0.05\] s"),
        (lambda: ScriptedStick([0.0, 0.0], np.zeros((2, 2))), "do not increase"),
        (lambda: ScriptedStick([0.0], np.zeros((2, 2))), r"\(n,\)"),
        (lambda: ScriptedStick([0.0], [[np.nan, 1.0]]), "not finite"),
        (lambda: ScriptedStick.circle(0.0, 1.0), "frequency is 0 Hz"),
        (lambda: emulate_rig(RIGID, board="arm"), "board is 'arm'"),
        (lambda: GamepadStick(98), "gamepad is 98"),
    ],
)
def test_wrong_input_is_one_line(make, words):
    with pytest.raises(InputError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_a_gamepad_is_read_in_counts(monkeypatch):
    pygame = pytest.importorskip("pygame")

    class Pad:
        def __init__(self, index):
            self.axes = (0.5, -1.0)

        def get_axis(self, axis):
            return self.axes[axis]

    monkeypatch.setattr(pygame.joystick, "get_count", lambda: 1)
    monkeypatch.setattr(pygame.joystick, "Joystick", Pad)
    assert GamepadStick().read(0.0, np.zeros(2)) == pytest.approx([768.0, 0.0])


def test_the_stick_of_the_board_is_what_it_reports():
    assert BoardStick().read(0.0, np.array([1.0, 2.0])) == pytest.approx([1.0, 2.0])
