"""Live planning: what is asked for is planned, what does not fit is refused with its reason."""

from __future__ import annotations

import queue
from dataclasses import replace

import numpy as np
import pytest

from bozzini.cockpit.planning import Bench, Job, Planning, Superseded, merge
from bozzini.cockpit.session import Session
from bozzini.cockpit.wire import Change
from bozzini.errors import InputError
from bozzini.motion import Scope
from bozzini.progress import no_progress
from bozzini.study.options import PathOptions, ReadOptions
from tests.cli.plan_cases import Tracts, write_tracts
from tests.scene.decode_view import decode_view


@pytest.fixture(scope="module")
def tracts(tmp_path_factory: pytest.TempPathFactory) -> Tracts:
    return write_tracts(tmp_path_factory.mktemp("tracts"))


def make_job(tracts: Tracts) -> Job:
    return Job(
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
        depth = -float(bench.rest.signed_distance(now[name]))
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


def test_process_plans_what_was_asked_last(tracts) -> None:
    heard: queue.Queue = queue.Queue()
    planning = Planning(make_job(tracts), lambda kind, what: heard.put((kind, what)))
    try:

        def wait_for(wanted: str):
            while True:
                kind, what = heard.get(timeout=120)
                assert kind in ("progress", "scene", "plan", "done", wanted), what
                if kind == wanted:
                    return what

        # The title over the picture is the same before there is a plan.
        titles = [decode_view(wait_for("scene"))["title"]]
        shown = wait_for("plan")
        assert shown.info["diameter_mm"] == 5.0
        titles.append(decode_view(shown.view)["title"])
        assert titles == ["Cockpit: tube.nii.gz"] * 2
        wait_for("done")
        for diameter in (4.0, 17.0, 6.0):
            planning.ask(Change(diameter=diameter))
        while (found := wait_for("plan").info)["diameter_mm"] != 6.0:
            pass
        assert found["status"] == "complete"
        planning.ask(Change(link=5000.0))
        assert "link" in wait_for("refused")
    finally:
        planning.close()
    assert not planning._process.is_alive()


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


def test_file_that_cannot_be_read_is_refused(tmp_path) -> None:
    (tmp_path / "bad.stl").write_text("no surface")
    job = Job(
        source=tmp_path / "bad.stl",
        reading=ReadOptions(),
        options=PathOptions(),
        scope=Scope(diameter=5.0, link_length=8.0),
    )
    with pytest.raises(InputError, match=r"bad\.stl"):
        Bench(job, no_progress)
