"""The drive with an emulated rig: armed by a token only, neutral when nobody holds the stick."""

from __future__ import annotations

import asyncio
import json
import time

import numpy as np
import pytest

from bozzini.cockpit.drive import RigDrive, check_rig, open_drive
from bozzini.cockpit.operator import Drawing, Figure, draw
from bozzini.cockpit.session import Session
from bozzini.cockpit.wire import RigCommand, StickMove
from bozzini.effector import Effector
from bozzini.errors import InputError
from bozzini.rig import Fault, LockstepLink, emulate_rig
from bozzini.rig.firmware import find_missing_tools
from tests.cockpit.conftest import make_plan, next_frame, wait_until


@pytest.fixture
def rig():
    if missing := find_missing_tools():
        pytest.skip(f"no {', '.join(missing)}")
    effector = Effector.from_preset("prototype")
    plant = emulate_rig(effector.models, board="native")
    drive = RigDrive(effector, LockstepLink(plant))
    drive.plant = plant.plant
    yield drive
    drive.close()


@pytest.fixture
def session(rig) -> Session:
    made = Session(may_arm=True)
    made.drive = rig
    made.show(make_plan())
    return made


def _keep_on(session: Session, is_so, limit: float = 10.0) -> None:
    """Tick until something is so."""
    end = time.monotonic() + limit
    while not is_so():
        assert time.monotonic() < end
        session.tick(time.monotonic())
        time.sleep(0.005)


def test_stick_drives_the_rig_once_it_is_armed_and_letting_go_vents(session, rig) -> None:
    window = session.open()
    assert rig.state.name == "DISARMED"
    session.take(window, StickMove(x=0.3, y=0.0))
    session.take(window, RigCommand(what="arm"))
    assert "let go" in session.note and rig.state.name == "DISARMED"
    session.take(window, StickMove(x=0.0, y=0.0))
    session.take(window, RigCommand(what="arm"))
    _keep_on(session, lambda: rig.state.name == "ARMED")

    def is_there() -> bool:
        session.take(window, StickMove(x=0.3, y=0.0))
        state = rig.state
        return bool(state.target.any()) and np.hypot(*(state.tip - state.delivered)) < 0.5

    _keep_on(session, is_there)
    state = rig.state
    np.testing.assert_allclose(state.measured, state.setpoints, atol=0.02)
    np.testing.assert_allclose(state.target, [-0.3 * rig.scale, 0.0], atol=1e-9)
    session.close(window)  # a window that goes away
    _keep_on(session, lambda: rig.state.measured.max() < 0.02)
    assert rig.state.name == "ARMED" and not rig.state.setpoints.any()
    session.take(session.open(), RigCommand(what="disarm"))
    _keep_on(session, lambda: rig.state.name == "DISARMED")


def test_without_a_token_the_rig_stays_disarmed(session, rig) -> None:
    session.may_arm = False
    session.take(session.open(), RigCommand(what="arm"))
    assert "token" in session.note
    time.sleep(0.1)
    assert rig.state.name == "DISARMED"


def test_controller_is_chosen_while_disarmed(session, rig) -> None:
    window = session.open()
    assert session.describe()["controller"] == "static"
    session.take(window, RigCommand(what="predictive"))
    _keep_on(session, lambda: session.describe()["controller"] == "predictive")
    session.take(window, RigCommand(what="arm"))
    _keep_on(session, lambda: rig.state.name == "ARMED")
    session.take(window, StickMove(x=0.6, y=0.0))
    _keep_on(session, lambda: rig.state.target[0] < -1.0)
    _keep_on(session, lambda: np.hypot(*(rig.state.tip - rig.state.target)) < 0.5)
    assert rig.state.setpoints.min() > 0.05  # muscles are kept where they begin to pull
    session.take(window, RigCommand(what="static"))
    _keep_on(session, lambda: "disarm the rig before" in rig.state.note)
    assert rig.controller == "predictive" and rig.name == "emulated rig, predictive"
    session.take(window, RigCommand(what="disarm"))
    _keep_on(session, lambda: rig.state.name == "DISARMED")
    session.take(window, RigCommand(what="feedforward"))
    _keep_on(session, lambda: rig.controller == "feedforward")
    assert not rig.state.note


def test_session_that_hangs_lets_the_stick_go(session, rig) -> None:
    window = session.open()
    session.take(window, RigCommand(what="arm"))
    _keep_on(session, lambda: rig.state.name == "ARMED")
    rig.hold(np.array([0.4, 0.0]))
    wait_until(lambda: rig.state.setpoints.any())
    wait_until(lambda: not rig.state.setpoints.any())  # nothing holds it any more
    assert rig.state.name == "ARMED"


def test_fault_is_shown_and_cleared(serve, session, rig) -> None:
    served = serve(session)
    client = served.connect()
    client.send(json.dumps({"kind": "rig", "what": "arm"}))
    wait_until(lambda: served.state()["rig"] == "ARMED")
    rig.plant.set_faults(Fault("sensor open", 0))
    wait_until(lambda: served.state()["rig"] == "FAULT")
    assert "sensor" in served.state()["note"]
    assert next_frame(client, lambda frame: frame.head[6] & 16)
    rig.plant.set_faults()
    client.send(json.dumps({"kind": "rig", "what": "clear"}))
    wait_until(lambda: served.state()["rig"] == "DISARMED")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_drive_that_ends_by_any_error_is_shown_as_lost(session, rig) -> None:
    def fail(state) -> None:
        raise ValueError("no more")

    rig.listeners.append(fail)
    _keep_on(session, lambda: session.describe()["rig"] == "LOST")
    assert "no more" in session.describe()["note"]
    rig._thread.join(5.0)
    assert not rig._thread.is_alive()


def test_operator_whose_connection_ends_says_so(serve) -> None:
    served = serve()
    served.session.drive = drive = open_drive("prototype")

    async def cut() -> Drawing:
        drawing = asyncio.create_task(draw(Figure(kind="line", size=5.0), drive, served.access))
        while drive.state.target[0] == 0.0:
            await asyncio.sleep(0.01)
        served.server.should_exit = True
        return await drawing

    drawing = asyncio.run(asyncio.wait_for(cut(), 30.0))
    assert not drawing.converged and "connection" in drawing.reason


@pytest.mark.parametrize("rig", ["serial:", "serial", "usb:/dev/x", "Demo", ""])
def test_unknown_rigs_are_refused(rig) -> None:
    with pytest.raises(InputError, match="demo, or serial"):
        check_rig(rig)


def test_port_that_cannot_be_opened_is_named() -> None:
    pytest.importorskip("serial")
    with pytest.raises(InputError, match="/dev/none"):
        open_drive("prototype", rig="serial:/dev/none")


@pytest.mark.parametrize("kind", ["line", "circle"])
def test_figures_lie_where_they_are_wanted(kind) -> None:
    figure = Figure(kind=kind, size=5.0)
    places = np.array([figure.place(t) for t in np.linspace(0.0, figure.duration, 200)])
    assert not figure.place(0.0).any()
    np.testing.assert_allclose(figure.place(figure.duration), [5.0, 0.0], atol=1e-9)
    drawn = np.array([figure.place(t) for t in np.linspace(1.5, figure.duration, 200)])
    np.testing.assert_allclose(figure.measure_distance(drawn), 0.0, atol=1e-9)
    assert np.hypot(*places.T).max() <= 5.0 + 1e-9
    away = drawn + np.array([0.0, 2.0])
    assert figure.measure_distance(away).max() == pytest.approx(2.0, abs=1e-3)
