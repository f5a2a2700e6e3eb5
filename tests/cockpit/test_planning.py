"""Live planning: what is asked for is planned, what does not fit is refused with its reason."""

from __future__ import annotations

import os
import queue
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bozzini.cockpit.planning import Bench, Planning, PlanningRequest, Superseded, merge
from bozzini.cockpit.run import Cockpit, CockpitOptions
from bozzini.cockpit.server import bind
from bozzini.cockpit.session import Session
from bozzini.cockpit.wire import Change
from bozzini.continuum import ContinuumRobot
from bozzini.errors import InputError
from bozzini.motion import Scope
from bozzini.progress import no_progress
from bozzini.study.options import PathOptions, ReadOptions
from tests.cli.plan_cases import Tracts, write_tracts
from tests.cockpit.conftest import make_plan
from tests.scene.decode_view import decode_view

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def tracts(tmp_path_factory: pytest.TempPathFactory) -> Tracts:
    return write_tracts(tmp_path_factory.mktemp("tracts"))


def make_job(tracts: Tracts) -> PlanningRequest:
    return PlanningRequest(
        source=tracts.volume,
        reading=ReadOptions(),
        options=PathOptions(),
        scope=Scope(diameter=5.0, link_length=8.0),
    )


@pytest.fixture(scope="module")
def bench(tracts) -> Bench:
    return Bench(make_job(tracts), no_progress)


def plan(bench: Bench, **asked: object):
    return list(bench.plan(Change(**asked), no_progress))


def test_plan_is_certified_and_as_the_windows_need_it(bench) -> None:
    (shown,) = plan(bench, diameter=5.0, link=8.0, inflate=0.0)
    assert shown.info["certified"] and shown.info["status"] == "complete"
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(shown.joints, axis=1), axis=2), 8.0, atol=1e-3
    )
    known = np.isfinite(shown.clearance)
    assert not known[0, 1:].any() and known[-1].any()
    assert np.nanmin(shown.clearance) >= shown.info["proved_mm"] - 1e-6
    assert (np.diff(shown.travel) >= 0.0).all()
    frames = shown.frames
    np.testing.assert_allclose(
        frames @ frames.transpose(0, 2, 1), np.broadcast_to(np.eye(3), frames.shape), atol=1e-9
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    # From step to step the view turns no more than the head does.
    ahead = np.arccos(np.clip((frames[1:, 2] * frames[:-1, 2]).sum(axis=1), -1.0, 1.0))
    up = np.arccos(np.clip((frames[1:, 1] * frames[:-1, 1]).sum(axis=1), -1.0, 1.0))
    assert (up <= ahead + 1e-6).all()


def test_wider_wall_gives_more_clearance_and_is_what_the_tip_is_measured_in(bench) -> None:
    (narrow,) = plan(bench, inflate=0.0)
    (wide,) = plan(bench, inflate=2.0)
    assert wide.info["proved_mm"] > narrow.info["proved_mm"] + 1.0
    session = Session()
    session.show(wide)
    before = session.plan.wall.signed_distance(wide.joints[-1, :1].astype(float))
    (again,) = plan(bench, diameter=4.5)
    assert again.wall is None  # as it was: not sent again
    session.show(again)
    assert session.plan.wall.signed_distance(wide.joints[-1, :1].astype(float)) == before


@pytest.mark.slow
def test_scope_that_does_not_fit_is_shown_as_far_as_it_goes_and_then_what_would_fit(bench) -> None:
    first, last = plan(bench, diameter=17.0, inflate=0.0)
    assert not first.info["final"] and last.info["final"]
    for shown in (first, last):
        assert shown.info["status"] == "stopped" and shown.info["reason"]
    found = last.info["would_fit_mm"]["diameter_max"]
    assert found < 16.0
    assert plan(bench, diameter=round(found - 0.01, 2))[0].info["status"] == "complete"
    plan(bench, diameter=5.0)


def test_ends_are_moved(bench) -> None:
    (whole,) = plan(bench)
    middle = whole.joints[len(whole.joints) // 2, 0].tolist()
    (half,) = plan(bench, end=tuple(middle))
    assert half.info["centreline_mm"] < 0.7 * whole.info["centreline_mm"]
    assert np.linalg.norm(np.array(half.info["goal_mm"]) - middle) < 8.0


@pytest.mark.parametrize("reverse", [False, True])
def test_click_on_the_wall_moves_an_end_beside_it_and_leaves_the_other(tracts, reverse) -> None:
    job = replace(make_job(tracts), options=PathOptions(reverse=reverse))
    bench = Bench(job, no_progress)
    (whole,) = plan(bench)
    places = {"start": np.array(whole.info["entry_mm"]), "end": np.array(whole.info["goal_mm"])}
    wall = bench.view_wall().surfaces[0].vertices
    for click in wall[np.linspace(0, len(wall) - 1, 12).astype(int)]:
        gaps = {name: np.linalg.norm(place - click) for name, place in places.items()}
        name = min(gaps, key=lambda key: gaps[key])
        bench.asked = Change(diameter=5.0, link=8.0, inflate=0.0)
        (moved,) = plan(bench, **{name: tuple(click.tolist())})
        assert moved.info["status"] == "complete"
        now = {"start": np.array(moved.info["entry_mm"]), "end": np.array(moved.info["goal_mm"])}
        depth = -float(bench.rest.field.signed_distance(now[name]))
        # The tube's radius is 8 mm, in voxels of 1.5 mm: it is about its middle, or in a tip.
        assert depth > 5.0 and np.linalg.norm(now[name] - click) < 2.0 * depth
        (other,) = places.keys() - {name}
        np.testing.assert_allclose(now[other], places[other], atol=0.02)


def test_click_on_moved_tissue_is_a_click_on_it_at_rest(tracts) -> None:
    bench = Bench(replace(make_job(tracts), moving="breathing"), no_progress)
    plan(bench)
    wall = bench.view_wall().surfaces[0].vertices
    middle = int(np.argmin(np.abs(wall[:, 2] - 20.0)))
    (still,) = plan(bench, end=tuple(wall[middle].tolist()))
    frames = bench.follow()
    for _ in range(6):
        _, vertices = next(frames)
    assert np.linalg.norm(vertices[middle] - wall[middle]) > 2.0
    (moved,) = plan(bench, end=tuple(vertices[middle].tolist()))
    assert moved.info["goal_mm"] == still.info["goal_mm"]


def test_what_is_not_legal_leaves_what_was_asked_before(bench) -> None:
    asked = bench.asked
    for change in ({"link": 5000.0}, {"end": (1e5, 0.0, 0.0)}, {"inflate": 25.0}):
        with pytest.raises(InputError):
            plan(bench, **change)
        assert bench.asked == asked


def test_work_that_is_superseded_ends(bench) -> None:
    def stop(stage: str, fraction: float) -> None:
        raise Superseded

    asked = bench.asked
    with pytest.raises(Superseded):
        list(bench.plan(Change(diameter=6.0), stop))
    assert bench.asked == asked


def test_changes_add_up() -> None:
    asked = merge(Change(diameter=5.0, link=8.0), Change(link=9.0, end=(1.0, 2.0, 3.0)))
    assert (asked.diameter, asked.link, asked.start) == (5.0, 9.0, None)
    assert asked.end == (1.0, 2.0, 3.0)


class Heard:
    """A planning process, and what it says."""

    def __init__(self, job: PlanningRequest) -> None:
        self.messages: queue.Queue = queue.Queue()
        self.planning = Planning(job, lambda kind, what: self.messages.put((kind, what)))

    def wait_for(self, wanted: str):
        while True:
            kind, what = self.messages.get(timeout=120)
            assert kind in ("progress", "scene", "plan", "done", wanted), what
            if kind == wanted:
                return what


@pytest.fixture
def heard(tracts) -> Iterator[Heard]:
    made = Heard(make_job(tracts))
    yield made
    made.planning.close()
    assert not made.planning._process.is_alive()


@pytest.mark.slow
def test_process_plans_what_was_asked_last(heard) -> None:
    # The title over the picture is the same before there is a plan.
    titles = [decode_view(heard.wait_for("scene"))["title"]]
    shown = heard.wait_for("plan")
    assert shown.info["diameter_mm"] == 5.0
    titles.append(decode_view(shown.view)["title"])
    assert titles == ["Cockpit: tube.nii.gz"] * 2
    heard.wait_for("done")
    for diameter in (4.0, 17.0, 6.0):
        heard.planning.ask(Change(diameter=diameter))
    while (found := heard.wait_for("plan").info)["diameter_mm"] != 6.0:
        pass
    assert found["status"] == "complete"
    heard.planning.ask(Change(link=5000.0))
    assert "link" in heard.wait_for("refused")
    # What is legal is planned, whatever is asked with it.
    heard.planning.ask(Change(link=5000.0, diameter=4.0))
    assert heard.wait_for("plan").info["diameter_mm"] == 4.0
    assert "link" in heard.wait_for("refused")


@pytest.mark.slow
def test_process_that_was_killed_is_started_anew_with_the_next_change(heard) -> None:
    planning, first = heard.planning, heard.planning._process
    heard.wait_for("done")
    planning.ask(Change(inflate=1.0))
    heard.wait_for("done")
    os.kill(first.pid, signal.SIGSTOP)
    planning.ask(Change(diameter=4.0))
    planning.ask(Change(link=9.0))
    first.kill()
    assert "signal 9" in heard.wait_for("lost")
    planning.ask(Change(link=8.5))
    assert planning._process is not first and not planning.start_again()
    info = heard.wait_for("plan").info
    # What was shown before holds on, and what the process had not taken is not lost.
    assert (info["inflate_mm"], info["diameter_mm"], info["link_mm"]) == (1.0, 4.0, 8.5)


@pytest.mark.slow
def test_asking_does_not_wait_for_a_process_that_does_not_read(heard) -> None:
    heard.wait_for("done")
    os.kill(heard.planning._process.pid, signal.SIGSTOP)
    changes = [Change(end=(float(k), 0.0, 0.0), diameter=5.0 + 1e-4 * k) for k in range(5000)]
    asking = threading.Thread(target=lambda: [*map(heard.planning.ask, changes)], daemon=True)
    asking.start()
    asking.join(30.0)
    assert not asking.is_alive()
    assert heard.planning._waiting == changes[-1]


def test_legal_part_of_a_change_is_planned(bench) -> None:
    before, line = bench.asked, bench._found.line
    (shown,) = plan(bench, diameter=4.0, link=5000.0, inflate=1.0, end=(1e5, 0.0, 0.0))
    assert (shown.info["diameter_mm"], shown.info["inflate_mm"]) == (4.0, 1.0)
    assert (bench.asked.link, bench.asked.end) == (before.link, before.end)
    assert len(bench.refused) == 2
    assert any("link" in reason for reason in bench.refused)
    # A link that is legal on the new way only, beside something that never is.
    lengths = {}
    for place in line.points[[len(line.points) // 3, -1]]:
        plan(bench, link=8.0, end=tuple(place.tolist()))
        lengths[bench._found.line.length] = bench.asked.end
    plan(bench, end=lengths[min(lengths)])
    link = sum(lengths) / 2
    plan(bench, link=link, end=lengths[max(lengths)], start=(1e5, 0.0, 0.0))
    assert bench.asked.link == link and len(bench.refused) == 1
    plan(bench, diameter=5.0, link=8.0, inflate=0.0)
    assert bench.refused == ()


class Clock:
    """A loop that calls what is due only when it is told."""

    def __init__(self) -> None:
        self.due: list[Clock] = []

    def call_later(self, delay: float, act: Callable[[], None]) -> Clock:
        handle = Clock()
        handle.act = act
        self.due.append(handle)
        return handle

    def cancel(self) -> None:
        self.act = lambda: None


class Idle:
    """A planning process that only takes what it is asked."""

    def __init__(self) -> None:
        self.changes: list[Change] = []
        self.is_new = False

    def ask(self, change: Change) -> bool:
        self.changes.append(change)
        return self.is_new

    def start_again(self) -> bool:
        return self.is_new


@pytest.fixture
def cockpit(tracts) -> Iterator[Cockpit]:
    with bind("127.0.0.1", 0) as listener:
        made = Cockpit(make_job(tracts), CockpitOptions(), listener=listener)
        made._loop, made._planning = Clock(), Idle()
        made._take("scene", b"wall")
        made._take("plan", replace(make_plan(), info={"final": True}))
        yield made


def test_windows_hear_that_planning_has_ended_and_go_on(cockpit) -> None:
    session, planning = cockpit.session, cockpit._planning
    session.take(session.open(), Change(diameter=4.0))
    assert session.planning["busy"] and planning.changes == [Change(diameter=4.0)]
    session.show_moved(make_plan(steps=1), np.zeros((3, 3)))
    cockpit._take("lost", "it has ended")
    assert not session.planning["busy"] and "it has ended" in session.planning["message"]
    assert cockpit.error is None and session.moved is None and len(session.windows) == 1
    # Another one shows its wall only once it has a plan.
    planning.is_new = True
    session.take(session.open(), Change(diameter=4.5))
    cockpit._take("scene", b"wall")
    assert session.planning["busy"] and session.view == make_plan().view
    cockpit._take("lost", "it has ended")
    assert session.planning["busy"] and "anew" in session.planning["message"]


def test_what_is_changed_while_the_first_plan_runs_is_planned_after_it(tracts) -> None:
    with bind("127.0.0.1", 0) as listener:
        cockpit = Cockpit(make_job(tracts), CockpitOptions(), listener=listener)
        cockpit._loop, cockpit._planning = Clock(), Idle()
        session, window = cockpit.session, cockpit.session.open()
        session.take(window, Change(diameter=4.0))
        session.take(window, Change(link=7.0))
        assert "first plan" in session.describe()["planning"]["message"]
        assert not cockpit._planning.changes
        cockpit._take("plan", replace(make_plan(), info={"final": True}))
        assert cockpit._planning.changes == [Change(diameter=4.0, link=7.0)]
        assert session.planning["busy"]  # until it is planned the page shows what was typed
        cockpit._take("plan", replace(make_plan(), info={"final": True}))
        assert len(cockpit._planning.changes) == 1 and not session.planning["busy"]


def test_windows_hear_that_it_takes_long_only_while_it_does(cockpit) -> None:
    session, due = cockpit.session, cockpit._loop.due
    window = session.open()
    for diameter in (4.0, 4.5):
        session.take(window, Change(diameter=diameter))
        cockpit._take("progress", "certify")
    due[0].act()  # of the first change
    assert session.planning["message"] == ""
    due[1].act()
    assert "longer" in session.planning["message"] and session.planning["stage"] == "certify"
    session.take(window, Change(diameter=5.0))
    cockpit._take("plan", replace(make_plan(), info={"final": False}))
    due[2].act()  # what is at work now is something else
    assert session.planning["busy"] and session.planning["message"] == ""
    cockpit._take("refused", "why")
    assert session.planning == {"busy": False, "stage": "", "message": "why"}


def test_tract_that_moves_carries_body_and_wall(tracts) -> None:
    bench = Bench(replace(make_job(tracts), moving="breathing"), no_progress)
    (shown,) = plan(bench)
    session = Session()
    session.show(shown)
    rest = bench.view_wall().surfaces[0].vertices
    moves = []
    for body, vertices in bench.follow():
        session.show_moved(body, vertices)
        assert body.info["status"] in ("held", "now")
        moves.append(np.abs(vertices - rest).max())
        links = np.linalg.norm(np.diff(body.joints[0], axis=0), axis=1)
        np.testing.assert_allclose(links, 8.0, atol=1e-3)
        assert session.describe()["moving"]["proved_mm"] > 0.0
        if len(moves) == 4:
            break
    assert moves[0] == 0.0 and (np.diff(moves) > 0.0).all() and session.tissue_number == 4
    session.show(shown)
    assert session.moved is None and session.describe()["moving"] is None


def test_tract_moves_while_it_is_found_out_what_a_robot_does(tracts) -> None:
    robot = ContinuumRobot.from_yaml(EXAMPLES / "thin_gastroscope.yaml")
    still, moving = (
        Bench(replace(make_job(tracts), robot=robot, moving=moving), no_progress)
        for moving in (None, "breathing")
    )
    first, wanted = plan(still)
    gate = threading.Event()
    follow = moving._follow
    moving._follow = lambda *given: gate.wait(60) and follow(*given)
    (shown,) = plan(moving)  # it does not wait for the robot
    motion = moving.follow()
    next(motion)
    assert moving.take_robot() is None
    gate.set()
    while (found := moving.take_robot()) is None:
        next(motion)
    assert found.info["robot"] == wanted.info["robot"] and shown.info["robot"] is None
    np.testing.assert_allclose(found.tendons, wanted.tendons)
    assert moving.take_robot() is None and moving.explain_rest() == ""


def test_tract_that_cannot_be_moved_says_so(tracts) -> None:
    bench = Bench(replace(make_job(tracts), moving="breathing"), no_progress)
    assert plan(bench, diameter=17.0)[-1].info["status"] == "stopped"
    assert list(bench.follow()) == [] and "does not move" in bench.explain_rest()


def test_file_that_cannot_be_read_is_refused(tmp_path) -> None:
    (tmp_path / "bad.stl").write_text("no surface")
    job = PlanningRequest(
        source=tmp_path / "bad.stl",
        reading=ReadOptions(),
        options=PathOptions(),
        scope=Scope(diameter=5.0, link_length=8.0),
    )
    with pytest.raises(InputError, match=r"bad\.stl"):
        Bench(job, no_progress)


def test_a_click_into_a_branch_is_planned_to_from_the_trachea(tmp_path) -> None:
    """Wherever the click is, the scope enters at the root of the tree."""
    from bozzini.anatomy.airway import make_airway
    from bozzini.anatomy.files import write_tract

    phantom = make_airway()
    write_tract(tmp_path / "airway.nii.gz", phantom.to_labels(1.0))
    job = PlanningRequest(
        source=tmp_path / "airway.nii.gz",
        reading=ReadOptions(organ="airway"),
        options=PathOptions(),
        scope=Scope(diameter=3.5, link_length=5.0),
    )
    own = Bench(job, no_progress)
    for number in (3, 6):
        branch = phantom.branches[number]
        side = np.cross(branch.way, [0.3, 0.5, 0.8])
        click = 0.5 * (branch.start + branch.end) + branch.radius * side / np.linalg.norm(side)
        *_, shown = plan(own, end=tuple(click.tolist()))
        assert shown.info["certified"] and shown.info["status"] == "complete"
        assert np.linalg.norm(shown.joints[0, 0] - phantom.branches[0].start) < 12.0
        assert np.linalg.norm(shown.joints[-1, 0] - click) < 1.5 * branch.radius + 1.0
