"""The session: what windows say and hear, by raw clients, and by hand where time matters."""

from __future__ import annotations

import asyncio
import json
import time
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from bozzini.cockpit.drive import EffectorDrive
from bozzini.cockpit.guard import Access
from bozzini.cockpit.server import bind, make_server, run_server
from bozzini.cockpit.session import LONGEST_SILENCE, Session
from bozzini.cockpit.wire import MAGIC, TISSUE, Change, Flags, Play, RigCommand, Seek, StickMove
from bozzini.effector import Effector
from tests.cockpit.conftest import LINKS, STEPS, Frame, make_plan, next_frame, wait_until


@pytest.fixture(scope="module")
def effector() -> Effector:
    return Effector.from_preset("prototype")


@pytest.fixture
def session(effector) -> Session:
    made = Session()
    made.drive = EffectorDrive(effector)
    made.show(make_plan())
    return made


def say(client, **message) -> None:
    client.send(json.dumps(message))


def test_frame_holds_the_step_that_was_asked_for(serve, session) -> None:
    client = serve(session).connect()
    say(client, kind="seek", step=7, time=12.5)
    frame = next_frame(client, lambda frame: frame.head[2] == 7)
    assert frame.head[0] == MAGIC and frame.head[3] == LINKS and frame.head[5] == 3
    assert frame.times[1] == 12.5
    joints, clearance, _, _, backbone, camera = frame.parts
    np.testing.assert_array_equal(joints, session.plan.joints[7].ravel())
    np.testing.assert_array_equal(clearance, session.plan.clearance[7])
    # A tip at rest is the body itself, and its camera looks along it.
    np.testing.assert_allclose(backbone[-3:], joints[:3], atol=1e-4)
    np.testing.assert_allclose(camera, [*joints[:3], 0.0, 0.0, 1.0, *camera[6:]], atol=1e-6)
    assert abs(camera[3:6] @ camera[6:]) < 1e-6


@pytest.mark.parametrize(("asked", "shown"), [(-5, 0), (1e9, STEPS - 1), (3.7, 3)])
def test_seek_is_clamped(session, asked, shown) -> None:
    session.take(session.open(), Seek(step=asked))
    assert session.step == shown


def test_two_windows_see_the_same_and_each_its_own_echo(serve, session) -> None:
    served = serve(session)
    first, second = served.connect(), served.connect()
    say(first, kind="seek", step=5, time=1.0)
    say(second, kind="stick", x=0.3, y=0.0, time=2.0)
    frames = [
        next_frame(each, lambda frame: frame.head[2] == 5 and frame.times[1] and frame.parts[3][0])
        for each in (first, second)
    ]
    assert [frame.times[1] for frame in frames] == [1.0, 2.0]
    assert [frame.head[7] for frame in frames] == [2, 2]
    np.testing.assert_array_equal(frames[0].parts[3], frames[1].parts[3])


def test_nothing_is_sent_where_nothing_changes_and_only_the_newest_to_the_slow(session) -> None:
    window = session.open()
    session.tick(time.monotonic())
    number = session.number
    for _ in range(10):
        session.tick(time.monotonic())
    assert session.number == number
    window.ready.clear()
    for step in range(5):
        session.go_to(step)
        session.tick(time.monotonic())
    assert window.ready.is_set() and session.number == number + 4
    assert Frame.read(session.frame_for(window)).head[2] == 4


def test_stick_bends_the_tip_within_the_workspace_and_says_why_not_further(session) -> None:
    window = session.open()
    for x, y in ((0.3, 0.2), (1.0, 0.4)):
        session.take(window, StickMove(x=x, y=y))
        session.tick(window.heard)
        state = session.drive.state
        np.testing.assert_allclose(state.target, session.drive.scale * np.array([-x, y]))
        np.testing.assert_allclose(state.tip, state.delivered, atol=1e-5)
        assert state.reached == np.allclose(state.target, state.delivered)
        assert bool(session.describe()["reason"]) == (not state.reached)
    assert not state.reached and "muscle" in session.describe()["reason"]
    # The bend is that of the model, laid over the body; the stick's right is the camera's.
    body = session.plan.place(session.step, state)
    frame = session.plan.frames[session.step]
    aside = body.tip[-1] - session.plan.joints[session.step, 0]
    np.testing.assert_allclose((aside @ frame.T)[:2], state.backbone[-1, :2], atol=1e-4)
    right = np.cross(frame[2], frame[1])
    np.testing.assert_allclose([aside @ right > 0.0, aside @ frame[1] > 0.0], [x > 0.0, y > 0.0])
    np.testing.assert_allclose(np.linalg.norm(body.camera[1:], axis=1), 1.0)
    np.testing.assert_allclose(body.joints[0], body.tip[-1], atol=1e-6)


@pytest.mark.parametrize("is_mirrored", [False, True])
def test_right_of_the_pad_is_right_in_the_picture_of_left_handed_axes_too(
    session, is_mirrored
) -> None:
    """A scan in LAS: the page shows what is mirrored in numbers as it is."""
    plan = replace(make_plan(), is_mirrored=is_mirrored, up=np.array([0.0, 1.0, 0.0]))
    session.show(plan)
    hand = -1.0 if is_mirrored else 1.0
    np.testing.assert_allclose(np.linalg.det(plan.frames), hand)
    np.testing.assert_allclose(plan.frames[0, 1], [0.0, 1.0, 0.0])
    for x, y in ((0.3, 0.0), (0.0, 0.3)):
        session.take(window := session.open(), StickMove(x=x, y=y))
        session.tick(window.heard)
        body = plan.place(0, session.drive.state)
        session.close(window)
        side = hand * np.cross(plan.frames[0, 2], plan.frames[0, 1])  # as `lookAlong` in math.js
        aside = body.tip[-1] - plan.joints[0, 0]
        seen = np.array([aside @ side, aside @ plan.frames[0, 1]])
        assert seen @ [x, y] > 0.99 * np.linalg.norm(seen) * np.hypot(x, y)


def test_moved_tissue_does_not_turn_the_picture(session) -> None:
    plan = replace(make_plan(), up=np.array([1.0, 1.0, 0.0]))
    session.show(plan)
    session.show_moved(make_plan(steps=1), np.zeros((4, 3)))
    np.testing.assert_allclose(session.moved.frames[0], plan.frames[0])


def test_page_says_at_the_start_how_to_go_in_and_whose_the_tip_is(session) -> None:
    session.show(replace(make_plan(), wall=Wall()))
    session.tick(time.monotonic())
    first, tip = session.describe()["tip"].split("\n")
    assert "entry" in first and "R on the pad" in first
    width = session.drive.effector.design.holder_diameter
    assert f"{width:g} mm wide" in tip and f"the scope, as wide as that: {4:g} mm" in tip
    session.go_to(STEPS - 1)
    session.tick(time.monotonic())
    assert session.describe()["tip"].startswith("Tip clearance: 8.00 mm.\n")


class Wall:
    """A straight round tube of 10 mm about the z axis."""

    def signed_distance(self, points):
        return np.hypot(points[:, 0], points[:, 1]) - 10.0


def test_tip_clearance_is_that_of_the_nearest_place(session) -> None:
    plan = make_plan()
    object.__setattr__(plan, "wall", Wall())
    session.show(plan)
    session.take(window := session.open(), StickMove(x=0.4, y=0.0))
    session.tick(window.heard)
    assert not np.isfinite(session.tip_clearance)  # the body stands in the introducer
    session.go_to(STEPS - 1)
    session.tick(window.heard)
    body = plan.place(session.step, session.drive.state)
    away = np.hypot(body.tip[:, 0], body.tip[:, 1])
    assert away.max() == away[-1] > 4.0
    assert session.tip_clearance == pytest.approx(10.0 - away.max() - plan.radius)
    # Links that the bend moves have their own clearance, those in the introducer none.
    assert body.clearance[0] == pytest.approx(session.tip_clearance)
    assert (np.diff(body.clearance[:3]) > 0.0).all()
    np.testing.assert_array_equal(
        np.isfinite(body.clearance), np.isfinite(plan.clearance[session.step])
    )
    session.take(window, StickMove(x=0.0, y=0.0))
    session.tick(window.heard)
    body = plan.place(session.step, session.drive.state)
    np.testing.assert_array_equal(body.clearance, plan.clearance[session.step])
    np.testing.assert_array_equal(body.joints, plan.joints[session.step])


def test_one_window_holds_the_stick_until_it_lets_go(session) -> None:
    first, second = session.open(), session.open()
    session.take(first, StickMove(x=0.5, y=0.0))
    session.take(second, StickMove(x=-0.5, y=0.0))
    assert session.holder is first
    session.take(first, StickMove(x=0.0, y=0.0))
    session.tick(first.heard)
    assert session.holder is None and not session.drive.state.setpoints.any()
    session.take(second, StickMove(x=-0.5, y=0.0))
    assert session.holder is second


def test_lost_or_silent_window_lets_go_of_the_stick(serve, session) -> None:
    served = serve(session)
    client = served.connect()
    say(client, kind="stick", x=0.5, y=0.5)
    wait_until(lambda: session.drive.state.setpoints.any())
    client.close()
    wait_until(lambda: not session.drive.state.setpoints.any())
    window = session.open()
    session.take(window, StickMove(x=0.5, y=0.0))
    session.tick(window.heard + 0.5 * LONGEST_SILENCE)
    assert session.drive.state.setpoints.any()
    session.tick(window.heard + 1.5 * LONGEST_SILENCE)
    assert not session.drive.state.setpoints.any()


def test_window_that_says_all_but_where_its_stick_is_lets_go_of_it(session) -> None:
    window = session.open()
    session.take(window, StickMove(x=0.5, y=0.0))
    heard = window.heard
    session.take(window, Seek(step=3.0))
    session.take(window, Play(on=False))
    session.tick(heard + 1.5 * LONGEST_SILENCE)
    assert session.holder is None and not session.drive.state.setpoints.any()


def test_new_window_gets_moved_tissue_only_while_it_moves(serve, session) -> None:
    served = serve(session)
    session.show_moved(make_plan(steps=1), np.zeros((4, 3)))
    assert TISSUE in _list_kinds(served.connect())
    version = session.view_version
    session.rest()
    assert session.view_version == version + 1 and session.describe()["moving"] is None
    assert TISSUE not in _list_kinds(served.connect())
    session.rest()  # nothing moved
    assert session.view_version == version + 1


def _list_kinds(client) -> set[int]:
    """The kinds of the frames that come at once."""
    found = set()
    with suppress(TimeoutError):
        while True:
            data = client.recv(timeout=0.5)
            if isinstance(data, bytes):
                found.add(int.from_bytes(data[:4], "little"))
    assert MAGIC in found
    return found


def test_clock_that_fails_ends_the_server_with_its_error(session) -> None:
    def fail(now: float) -> None:
        raise ValueError("no time")

    session.tick = fail
    listener = bind("127.0.0.1", 0)
    server = make_server(session, Access(port=1), page="", folders=())
    with pytest.raises(ValueError, match="no time"):
        asyncio.run(
            asyncio.wait_for(
                run_server(server, listener, session=session, when_ready=lambda: None), 20.0
            )
        )


@pytest.mark.parametrize("speed", [10.0, -10.0])
def test_head_plays_at_its_speed_and_stops_at_the_end(session, speed) -> None:
    window, begin = session.open(), time.monotonic()
    session.tick(begin)
    session.go_to(20)
    session.take(window, Play(on=True, speed=speed))
    session.tick(begin + 1.0)
    assert session.step == 20 + speed and session.is_playing
    session.tick(begin + 60.0)
    assert session.step == (STEPS - 1 if speed > 0.0 else 0) and not session.is_playing
    session.take(window, Play(on=True, speed=speed))  # from the other end again
    assert session.step == (0 if speed > 0.0 else STEPS - 1)


def test_clock_does_not_drift(session) -> None:
    async def count() -> int:
        ticks = []
        session.tick = lambda now: ticks.append(now)
        task = asyncio.create_task(session.run())
        await asyncio.sleep(0.1)
        begin = len(ticks)
        await asyncio.sleep(1.0)
        task.cancel()
        return len(ticks) - begin

    assert asyncio.run(count()) == pytest.approx(60, abs=6)


def test_without_a_rig_nothing_is_armed(session) -> None:
    for what, words in (("arm", "token"), ("disarm", "no rig"), ("clear", "no rig")):
        session.take(session.open(), RigCommand(what=what))
        assert words in session.note
    assert not session._flags(session.drive.state) & Flags.ARMED


def test_change_that_is_refused_is_said_until_the_next_one(session) -> None:
    session.take(session.open(), Change(diameter=5.0))
    assert "nothing to plan" in session.describe()["planning"]["message"] and not session.note
    asked: list[Change] = []
    session.ask_plan = asked.append
    count = session.describe()["planning"]["asked"]
    session.take(session.open(), Change(diameter=6.0))
    assert asked == [Change(diameter=6.0)]
    assert session.describe()["planning"]["asked"] == count + 1


def test_new_plan_keeps_the_head_where_it_was(session) -> None:
    session.go_to(30)
    session.show(make_plan(steps=100))
    assert session.step == 30
    session.show(make_plan(steps=10))
    assert session.step == 9
    session.show(make_plan(steps=100))
    assert session.step == 30
